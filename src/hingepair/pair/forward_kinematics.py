"""Forward kinematics: coordinates or a body's motion in, a plan of steps over them, a state out."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any

import numpy as np

from hingepair.errors import ArgumentError, choices, quoted
from hingepair.evaluation.backend import How
from hingepair.evaluation.plan import (
    OUTPUTS,
    PLANAR,
    SPATIAL,
    Plan,
    check_outputs,
    default_outputs,
    make_plan,
    outputs_of,
)
from hingepair.evaluation.steps import COORDINATES, PARTS, PLANAR_COORDINATES, PLANAR_PARTS
from hingepair.numeric.array_libraries import foreign_components, is_foreign, library_of
from hingepair.numeric.blocks import Named
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import (
    Coordinates,
    Out,
    Outputs,
    StateT,
    component,
    evaluate,
    evaluate_foreign,
    evaluate_one,
    float_row,
    leading_shapes,
    parts_of,
    read_coordinates,
    written,
)
from hingepair.pair.prepared import Prepared
from hingepair.pair.states import PairState, PlanarState
from hingepair.rotations.sequences import find_sequence

_OF_COORDINATES = {part: name for parts in (PARTS, PLANAR_PARTS) for name, own in parts.items() for part in own}
HINGE = ("psi", "psid", "psidd")
_LETTERS = {"R1": "R", "S1": "S", "v1": "v", "omega1": "omega", "a1": "a", "alpha1": "alpha"}
_OF_BODY1 = {name: f"body1.{letter}" for name, letter in _LETTERS.items()} | {"psid": "psid", "psidd": "psidd"}


def from_coordinates(
    pair: Constants, q: Any, qd: Any, qdd: Any, outputs: Outputs, out: Out, sequence: str, how: How
) -> PairState:
    """The pair's state from the seven coordinates and as many derivatives as are given (E1-E10)."""
    rows = (q,) if qd is None else (q, qd) if qdd is None else (q, qd, qdd)
    ready: Prepared | None = None
    short = how.workers == 1 and (qd is not None or qdd is None)
    if type(outputs) is list:
        outputs = tuple(outputs)
    if out is not None:
        short = short and type(outputs) is tuple and type(out) is dict and out.keys() <= {*outputs}
    if short:
        try:
            ready = pair.prepared.get((outputs, sequence, how.backend, len(rows)))
        except TypeError:  # outputs that are no key
            short = False
        else:
            found: PairState | None = None if ready is None else ready.short(*rows)
            if found is not None:
                inputs = dict(zip(PARTS, rows, strict=False)) if found.shape else {}
                return found if out is None else written(found, out, inputs)
            if ready is not None and out is None:
                state: PairState | None = ready.short(*[float_row(value, len(COORDINATES)) for value in rows])
                if state is not None:
                    return state
    plan, given = plan_from_coordinates(pair, q, qd, qdd, outputs, out, sequence, foreign=True)
    state = _of_rows(PairState, plan, pair, given, out, how)
    if short and pair.single and given.library is None:
        if ready is None:
            ready = Prepared(pair, tuple(given.parts), plan.outputs, sequence, how, now=False)
            pair.prepared[outputs, sequence, how.backend, len(rows)] = ready
        if how.backend != "numpy":
            ready.learn(rows)
    return state


def plan_from_coordinates(
    pair: Constants, q: Any, qd: Any, qdd: Any, outputs: Outputs, out: Out, sequence: str, foreign: bool = False
) -> tuple[Plan, Coordinates]:
    """What to compute from the seven coordinates, and of what."""
    if type(sequence) is not str or sequence != "XYZ":
        find_sequence(sequence)
    given = read_coordinates(q, qd, qdd, COORDINATES, foreign)
    level, home = len(given.parts) - 1, "home" in pair.values
    if outputs is None and out is None:
        return make_plan(default_outputs(level), sequence, home), given
    names = _wanted(outputs, out, level)
    return _plan_for(names, (sequence, home), _parts(given, PARTS, pair), _OF_COORDINATES), given


def planar_from_coordinates(
    pair: Constants, q: Any, qd: Any, qdd: Any, outputs: Outputs, out: Out, how: How
) -> PlanarState:
    """The planar pair's state from (x, y, phi, psi) and as many derivatives as are given (E11)."""
    plan, given = plan_planar(pair, q, qd, qdd, outputs, out, foreign=True)
    return _of_rows(PlanarState, plan, pair, given, out, how)


def plan_planar(
    pair: Constants, q: Any, qd: Any, qdd: Any, outputs: Outputs, out: Out, foreign: bool = False
) -> tuple[Plan, Coordinates]:
    """What to compute from the four coordinates of a planar pair, and of what."""
    given = read_coordinates(q, qd, qdd, PLANAR_COORDINATES, foreign)
    names = _wanted(outputs, out, len(given.parts) - 1, PLANAR)
    return _plan_for(names, (None, False), _parts(given, PLANAR_PARTS, pair), _OF_COORDINATES, PLANAR), given


def _parts(given: Coordinates, parts: Mapping[str, tuple[str, ...]], pair: Constants) -> set[str]:
    """What a plan can start from."""
    return {*pair.values, *(part for name in given.parts for part in parts[name])}


def _of_rows(state: type[StateT], plan: Plan, pair: Constants, given: Coordinates, out: Out, how: How) -> StateT:
    if given.library is not None:
        values = parts_of(given, plan.kind == PLANAR)
        return evaluate_foreign(state, plan, pair, values, leading_shapes(given), given.library, out, how)
    if given.single and pair.single:
        return evaluate_one(state, plan, True, pair, given.parts, out, how)
    return evaluate(state, plan, True, pair, given.parts, leading_shapes(given), out, how)


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
        return evaluate_one(PairState, plan, False, pair, values, out, how)
    return evaluate(PairState, plan, False, pair, values, shapes, out, how)


def plan_from_body1(
    pair: Constants, body1: BodyMotion, psi: Any, psid: Any, psidd: Any, outputs: Outputs, out: Out
) -> tuple[Plan, Named, dict[str, tuple[int, ...]]]:
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
    plan = _plan_for(_wanted(outputs, out, len(hinge) - 1), (None, "home" in pair.values), known, _OF_BODY1)
    shapes = {"body1": body1.shape, **{name: np.shape(value) for name, value in hinge.items()}}
    return plan, {**arrays, **hinge}, shapes


def _is_double(name: str, value: Any) -> bool:
    """Whether it is a float of the hinge, or an array of body 1 in float64."""
    return type(value) is float if name in HINGE else value.dtype.char == "d"


def _wanted(outputs: Outputs, out: Out, level: int, kind: str = SPATIAL) -> tuple[str, ...]:
    """What to compute: the names asked for, or the level's defaults and whatever `out` has room for."""
    if out is not None and not isinstance(out, Mapping):
        raise ArgumentError("out", "a dict of arrays by output name", quoted(out))
    if outputs is None and not out:
        return default_outputs(level, kind)
    room = tuple(out or ())
    for name in room:
        if name not in outputs_of(kind):
            raise ArgumentError("out", choices(tuple(outputs_of(kind))), quoted(name))
    if outputs is None:
        return tuple(dict.fromkeys((*default_outputs(level, kind), *room)))
    names = check_outputs(outputs, kind)
    for name in room:
        if name not in names:
            raise ArgumentError("out", f"arrays for nothing but the outputs named ({', '.join(names)})", quoted(name))
    return names


def _plan_for(
    names: tuple[str, ...],
    form: tuple[str | None, bool],
    given: Set[str],
    sources: Mapping[str, str],
    kind: str = SPATIAL,
) -> Plan:
    """The plan for some outputs, if what is given suffices; `sources` are the arguments that inputs come from."""
    sequence, home = form
    plan = make_plan(names, sequence, home, kind=kind)
    if plan.inputs <= given:
        return plan
    for name in names:
        for missing in sorted(make_plan((name,), sequence, home, kind=kind).inputs - given):
            raise ArgumentError(sources[missing], f"a value, since output {name} needs it", None)
    return plan
