"""Forward kinematics: coordinates or a body's motion in, a plan of steps over them, a state out."""

from __future__ import annotations

from typing import Any

import numpy as np

from hingepair.errors import ArgumentError, quoted
from hingepair.evaluation.backend import How
from hingepair.evaluation.plan import FLAT, OUTPUTS, PLANAR, Plan, default_outputs, make_plan
from hingepair.numeric.array_libraries import foreign_components, is_foreign, library_of
from hingepair.numeric.blocks import Values
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import (
    Coordinates,
    Out,
    Outputs,
    component,
    evaluate,
    evaluate_one,
    leading_shapes,
    plan_for,
    read_coordinates,
    wanted,
)
from hingepair.pair.foreign_arrays import evaluate_foreign
from hingepair.pair.states import PairState, PlanarState
from hingepair.rotations.sequences import find_sequence

COORDINATES = ("x", "y", "z", "phi_x", "phi_y", "phi_z", "psi")
PARTS = {"q": ("R1", "phi", "psi"), "qd": ("v1", "phid", "psid"), "qdd": ("a1", "phidd", "psidd")}
PLANAR_COORDINATES = ("x", "y", "phi", "psi")
PLANAR_PARTS = {"q": ("R1", "phi1", "psi"), "qd": ("v1", "phi1d", "psid"), "qdd": ("a1", "phi1dd", "psidd")}
_OF_COORDINATES = {part: name for parts in (PARTS, PLANAR_PARTS) for name, own in parts.items() for part in own}
HINGE = ("psi", "psid", "psidd")
_LETTERS = {"R1": "R", "S1": "S", "v1": "v", "omega1": "omega", "a1": "a", "alpha1": "alpha"}
_OF_BODY1 = {name: f"body1.{letter}" for name, letter in _LETTERS.items()} | {"psid": "psid", "psidd": "psidd"}


def from_coordinates(
    pair: Constants, q: Any, qd: Any, qdd: Any, outputs: Outputs, out: Out, sequence: str, how: How
) -> PairState:
    """The pair's state from the seven coordinates and as many derivatives as are given (E1-E10)."""
    plan, values, given = plan_from_coordinates(pair, q, qd, qdd, outputs, out, sequence)
    if given.library is not None:
        return evaluate_foreign(PairState, plan, pair, values, leading_shapes(given), given.library, out, how)
    if given.single and pair.single:
        return evaluate_one(PairState, plan, {**pair.values, **values}, out, how)
    plan, values = flattened(plan, pair, values)
    return evaluate(PairState, plan, pair, values, leading_shapes(given), out, how)


def plan_from_coordinates(
    pair: Constants, q: Any, qd: Any, qdd: Any, outputs: Outputs, out: Out, sequence: str
) -> tuple[Plan, Values, Coordinates]:
    """What to compute from the seven coordinates, and of what."""
    if type(sequence) is not str or sequence != "XYZ":
        find_sequence(sequence)
    given = read_coordinates(q, qd, qdd, COORDINATES)
    values = values_of(given)
    home = "home" in pair.values
    if outputs is None and out is None:
        plan = make_plan(default_outputs(len(given.parts) - 1), sequence, home)
    else:
        names = wanted(outputs, out, len(given.parts) - 1)
        plan = plan_for(names, (sequence, home), values.keys() | pair.values.keys(), _OF_COORDINATES)
    return plan, values, given


def planar_from_coordinates(
    pair: Constants, q: Any, qd: Any, qdd: Any, outputs: Outputs, out: Out, how: How
) -> PlanarState:
    """The planar pair's state from (x, y, phi, psi) and as many derivatives as are given (E11)."""
    plan, values, given = plan_planar(pair, q, qd, qdd, outputs, out)
    if given.library is not None:
        return evaluate_foreign(PlanarState, plan, pair, values, leading_shapes(given), given.library, out, how)
    if given.single and pair.single:
        return evaluate_one(PlanarState, plan, {**pair.values, **values}, out, how)
    return evaluate(PlanarState, plan, pair, values, leading_shapes(given), out, how)


def plan_planar(
    pair: Constants, q: Any, qd: Any, qdd: Any, outputs: Outputs, out: Out
) -> tuple[Plan, Values, Coordinates]:
    """What to compute from the four coordinates of a planar pair, and of what."""
    given = read_coordinates(q, qd, qdd, PLANAR_COORDINATES)
    values: Values = {}
    for name, four in given.parts.items():
        point, angle, hinge = PLANAR_PARTS[name]
        if isinstance(four, np.ndarray):
            values[point], values[angle], values[hinge] = four[..., 0:2], four[..., 2], four[..., 3]
        else:
            values[point], values[angle], values[hinge] = four[0:2], four[2], four[3]
    names = wanted(outputs, out, len(given.parts) - 1, PLANAR)
    return plan_for(names, (None, False), values.keys() | pair.values.keys(), _OF_COORDINATES, PLANAR), values, given


def from_body1(
    pair: Constants, body1: BodyMotion, psi: Any, psid: Any, psidd: Any, outputs: Outputs, out: Out, how: How
) -> PairState:
    """The pair's state from the motion of body 1 and the hinge angle with its derivatives (E1, E2, E5-E9)."""
    plan, values, shapes = plan_from_body1(pair, body1, psi, psid, psidd, outputs, out)
    library = library_of({_OF_BODY1.get(name, name): value for name, value in values.items()})
    if library is not None:
        parts = {n: v if n in HINGE else foreign_components(n, v, *OUTPUTS[n].tail) for n, v in values.items()}
        return evaluate_foreign(PairState, plan, pair, parts, shapes, library, out, how)
    if body1.shape == () and pair.single and all(_is_double(name, value) for name, value in values.items()):
        one = {n: value if type(value) is float else tuple(value.ravel().tolist()) for n, value in values.items()}
        return evaluate_one(PairState, plan, {**pair.values, **one}, out, how)
    return evaluate(PairState, plan, pair, values, shapes, out, how)


def plan_from_body1(
    pair: Constants, body1: BodyMotion, psi: Any, psid: Any, psidd: Any, outputs: Outputs, out: Out
) -> tuple[Plan, Values, dict[str, tuple[int, ...]]]:
    """What to compute from the motion of body 1 and the hinge angle, of what, and of which shapes."""
    if not isinstance(body1, BodyMotion):
        raise ArgumentError("body1", "a BodyMotion", quoted(body1))
    if psidd is not None and psid is None:
        raise ArgumentError("psid", "the first derivative beside the second", None)
    if psi is None:
        raise ArgumentError("psi", "hinge angles", None)
    given = {"psi": psi, "psid": psid, "psidd": psidd}
    known_hinge = {name: value for name, value in given.items() if value is not None}
    hinge = {name: v if is_foreign(v) else component(name, v) for name, v in known_hinge.items()}
    arrays = {name: array for name, letter in _LETTERS.items() if (array := getattr(body1, letter)) is not None}
    known = hinge.keys() | arrays.keys() | pair.values.keys()
    plan = plan_for(wanted(outputs, out, len(hinge) - 1), (None, "home" in pair.values), known, _OF_BODY1)
    shapes = {"body1": body1.shape, **{name: np.shape(value) for name, value in hinge.items()}}
    return plan, {**arrays, **hinge}, shapes


def values_of(given: Coordinates) -> Values:
    """Position, Euler angles and hinge angle, and their derivatives, by the names of a plan's inputs."""
    values: Values = {}
    for name, seven in given.parts.items():
        point, angles, hinge = PARTS[name]
        if isinstance(seven, np.ndarray):
            values[point], values[angles], values[hinge] = seven[..., 0:3], seven[..., 3:6], seven[..., 6]
        else:
            values[point], values[angles], values[hinge] = seven[0:3], seven[3:6], seven[6]
    return values


def flattened(plan: Plan, pair: Constants, values: Values) -> tuple[Plan, Values]:
    """The plan of motion whose turns are all about z (E11), where constants prove that these are such.

    That is: the hinge axis is e_z or -e_z, home turns about z, and of the Euler angles two are the number 0, and so
    are their rates, the third being the only one about z. Else what came.
    """
    letters = (plan.sequence or "").lower()
    if letters.count("z") != 1 or not _is_upright(pair):
        return plan, values
    index, own = letters.index("z"), dict(values)
    for name, flat_name in (("phi", "phi1"), ("phid", "phi1d"), ("phidd", "phi1dd")):
        if name in plan.inputs:
            angles = own.pop(name)
            if not isinstance(angles, tuple) or any(not _is_zero(a) for i, a in enumerate(angles) if i != index):
                return plan, values
            own[flat_name] = angles[index]
    return make_plan(plan.outputs, plan.sequence, plan.home, kind=FLAT), own


def _is_upright(pair: Constants) -> bool:
    n, home = pair.values["n"], pair.values.get("home", (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
    if not all(type(value) is float for value in (*n, *home)):
        return False
    about_z = home[2::3] == home[6:] == (0.0, 0.0, 1.0)
    return bool(n[0] == n[1] == 0.0 and about_z and home[0] == home[4] and home[1] == -home[3])


def _is_double(name: str, value: Any) -> bool:
    """Whether it is a float of the hinge, or an array of body 1 in float64."""
    return type(value) is float if name in HINGE else value.dtype.char == "d"


def _is_zero(value: Any) -> bool:
    return type(value) is float and value == 0.0
