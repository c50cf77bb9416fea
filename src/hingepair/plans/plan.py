"""What to compute: the equations as a graph of steps, of which a plan takes those that the outputs need.

Every way to evaluate the pair - one state in Python floats, blocks of NumPy arrays, SymPy symbols, mpmath numbers -
runs the steps of one plan, so the equations are put together here and nowhere else.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from hingepair.engine.loops import Loop
from hingepair.engine.trace import name_components
from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.numeric.blocks import angle_terms, hinge_cosine, hinge_terms
from hingepair.plans.dynamics_steps import LOADS, MASS_STEPS, forward_steps
from hingepair.plans.steps import (
    ATTITUDE2_STEPS,
    ATTITUDE_STEPS,
    CONSTRAINT_STEPS,
    COORDINATES,
    GIVEN_S1,
    HINGE_STEPS,
    JACOBIAN_STEPS,
    LEVER_STEPS,
    PARTS,
    PLANAR_COORDINATES,
    PLANAR_PARTS,
    PLANAR_ROW_STEPS,
    PLANAR_STEPS,
    ROW_STEPS,
    SENSITIVITY_STEPS,
    WITHOUT_HOME,
    Step,
    coordinate_steps,
    same,
)
from hingepair.rotations.sequences import find_sequence

Tail: TypeAlias = tuple[int, ...]
Terms: TypeAlias = tuple[Callable[..., Any], Callable[..., Any]]

POSE, VELOCITY, ACCELERATION = 0, 1, 2

# Shapes of one sample of everything that can be given or computed in space, by name.
_SHAPES: Final[dict[str, Tail]] = {
    **dict.fromkeys(("R1", "v1", "omega1", "a1", "alpha1", "R2", "v2", "omega2", "a2", "alpha2", "d"), (3,)),
    **dict.fromkeys(("phi", "phid", "phidd", "u1", "u2", "n", "lever_fixed", "lever_cos", "lever_sin"), (3,)),
    **dict.fromkeys(("e1", "e2", "e1_in_2", "e2_in_2", "n_in_2"), (3,)),
    **dict.fromkeys(("psi", "psid", "psidd", "phi1", "phi1d", "phi1dd", "psid_given"), ()),
    **dict.fromkeys(("S1", "S2"), (3, 3)),
    **dict.fromkeys(("quat_xyzw", "quat_wxyz"), (4,)),
    **dict.fromkeys(("q", "qd", "qdd"), (7,)),
    **dict.fromkeys(("jacobian", "coordinate_jacobian", "coordinate_jacobian_rate"), (6, 7)),
    "acceleration_bias": (6,),
    **dict.fromkeys(("d_by_u1", "d_by_u2", "d_by_n", "S2_by_psi"), (3, 3)),
    **dict.fromkeys(("v2_by_u1", "v2_by_u2", "v2_by_n", "omega2_by_n"), (3, 3)),
    **dict.fromkeys(("d_by_psi", "v2_by_psi"), (3,)),
    "S2_by_n": (3, 3, 3),
    **dict.fromkeys(("gap", "gap_rate", "gap_acceleration", "slip"), (3,)),
    **dict.fromkeys(("tilt", "tilt_rate", "tilt_acceleration"), (2,)),
    "tilt_angle": (),
    "constraint_jacobian": (5, 12),
    "constraint_bias": (5,),
    **dict.fromkeys(("m1", "m2", "hinge_torque", "kinetic", "potential"), ()),
    **dict.fromkeys(("c1", "c2", "gravity", "force1", "torque1", "force2", "torque2"), (3,)),
    **dict.fromkeys(("f2", "moment", "bearing_torque", "linear", "angular"), (3,)),
    **dict.fromkeys(("home", "I1", "I2"), (9,)),
    "pivot_ratios": (4,),
    "mass_matrix": (7, 7),
    **dict.fromkeys(("attitude1_check", "attitude2_check"), ()),
    **dict.fromkeys(("state", "state_rates"), (14,)),
    **dict.fromkeys(("point", "offset_velocity", "initial_angular_momentum"), (3,)),
    "S0": (9,),
}


@dataclass(frozen=True, slots=True, eq=False)
class Kind:
    """A kind of motion, in space or in the plane: names and shapes of everything that can be given or computed.

    Attributes:
        coordinates: what the components of q are called.
        parts: of q, qd, qdd, what a plan calls the position, the angles and the hinge angle.
        shapes: of one sample of everything that can be given or computed.
        levels: of everything of the bodies that can be computed, the level at which it is a default output; None
            where it is computed only when named.
    """

    coordinates: tuple[str, ...]
    parts: Mapping[str, tuple[str, ...]]
    shapes: Mapping[str, Tail]
    levels: Mapping[str, int | None]


# The level at which an output of body 2 is a default output.
_OF_BODY2 = {
    **dict.fromkeys(("R2", "S2", "d"), POSE),
    **dict.fromkeys(("v2", "omega2"), VELOCITY),
    **dict.fromkeys(("a2", "alpha2"), ACCELERATION),
}
SPATIAL: Final = Kind(
    COORDINATES, PARTS, _SHAPES, {**_OF_BODY2, **dict.fromkeys(("R1", "S1", "v1", "omega1", "a1", "alpha1"))}
)
"""Motion in space."""
PLANAR: Final = Kind(
    PLANAR_COORDINATES,
    PLANAR_PARTS,
    {
        **_SHAPES,
        **dict.fromkeys(("R1", "v1", "a1", "u1", "u2", "R2", "d", "v2", "a2"), (2,)),
        **dict.fromkeys(("phi2", "omega2", "alpha2"), ()),
        **dict.fromkeys(("q", "qd", "qdd"), (4,)),
    },
    {{"S2": "phi2"}.get(name, name): level for name, level in _OF_BODY2.items()},
)
"""Motion in two coordinates (E11)."""

_LABELS = {
    "hinge": ("sin_psi", "versine_psi", "cos_psi"),
    "trig": ("sin_x", "cos_x", "sin_y", "cos_y", "sin_z", "cos_z"),
    "turn1": ("sin_phi", "cos_phi"),
    "axes": ("b_y", "b_z", "c_x", "c_y", "c_z"),
}
"""Names of components in generated code, where the step's name and a letter would say less."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The steps that lead from what is given to the outputs, in order.

    Attributes:
        outputs: names, in the order asked for.
        steps: what is computed.
        inputs: which of the given things are needed.
        kind: SPATIAL or PLANAR.
    """

    outputs: tuple[str, ...]
    steps: tuple[Step, ...]
    inputs: frozenset[str]
    kind: Kind

    def run(self, values: dict[str, Any]) -> dict[str, Any]:
        """Run the steps on values by name; the results join the values."""
        for result, function, arguments in self.steps:
            made = values[result] = function(*[values[name] for name in arguments])
            name_components(result, made, _LABELS.get(result))
        return values


NUMERIC: Final[Terms] = (angle_terms, hinge_terms)
"""Functions by which floats and arrays make the sines and cosines of phi and of psi."""


@functools.lru_cache(maxsize=1024)
def make_plan(
    outputs: tuple[str, ...],
    sequence: str | None = "XYZ",
    home: bool = True,
    terms: Terms = NUMERIC,
    kind: Kind = SPATIAL,
    given: tuple[str, ...] = (),
) -> Plan:
    """Return the plan for some outputs.

    Args:
        outputs: their names.
        sequence: of the Euler angles; None where S1, omega1 and alpha1 are given.
        home: whether C differs from the identity.
        terms: what makes (sin, cos) of the three angles and (sin, 1 - cos) of psi in the numbers at hand. Exact
            numbers (other terms than NUMERIC) go through LEVER_STEPS as well; doubles find them done in the pair.
        kind: SPATIAL or PLANAR; the latter takes phi1 for the three angles.
        given: what comes in beside the pair's constants: names out of the kind's shapes; nothing for the parts of
            the coordinates and of body 1's motion, as far as they are needed.

    Returns:
        The same object where the same steps are taken, however they are asked for: programs and kernels hang on it.
    """
    taken, _ = needed_steps(steps_of(sequence, home, terms, kind, given), outputs)
    return _plan(taken, outputs, kind)


@functools.lru_cache(maxsize=1024)
def _plan(taken: tuple[Step, ...], outputs: tuple[str, ...], kind: Kind) -> Plan:
    return Plan(outputs, *needed_steps(taken, outputs), kind)


@functools.lru_cache(maxsize=1024)
def plan_loop(plan: Plan) -> Loop:
    """Return the loop that runs a plan over samples."""
    shapes = plan.kind.shapes
    labels = {name: tuple(f"{one}{name[1:]}" for one in plan.kind.coordinates) for name in plan.kind.parts}
    inputs, outputs = ({name: shapes[name] for name in names} for names in (sorted(plan.inputs), plan.outputs))
    return Loop("state", plan.run, inputs, outputs, labels=labels)


def needed_steps(steps: Iterable[Step], outputs: Iterable[str]) -> tuple[tuple[Step, ...], frozenset[str]]:
    """Return the steps that lead to the outputs, and the names of what must be given for them."""
    needed = set(outputs)
    taken = []
    for step in reversed(tuple(steps)):
        if step.result in needed:
            taken.append(step)
            needed.remove(step.result)
            needed.update(step.arguments)
    return tuple(reversed(taken)), frozenset(needed)


@functools.cache
def default_outputs(level: int, kind: Kind = SPATIAL) -> tuple[str, ...]:
    """Return the outputs that a level brings without being named."""
    return tuple(name for name, own in kind.levels.items() if own is not None and own <= level)


def check_outputs(outputs: Any, known: Collection[str]) -> tuple[str, ...]:
    """Return the names asked for, each once.

    Raises:
        ArgumentError: not a collection of known names.
    """
    try:
        names = () if isinstance(outputs, str) else tuple(dict.fromkeys(outputs))
    except TypeError:
        names = ()
    if not names:
        raise ArgumentError("outputs", "a tuple of names such as ('R2', 'v2')", quoted(outputs))
    for name in names:
        if name not in known:
            raise ArgumentError("outputs", choices(tuple(known)), quoted(name))
    return names


@functools.lru_cache(maxsize=256)
def steps_of(
    sequence: str | None, home: bool, terms: Terms = NUMERIC, kind: Kind = SPATIAL, given: tuple[str, ...] = ()
) -> tuple[Step, ...]:
    """Return the steps to everything that can be computed; the arguments are those of `make_plan`."""
    if kind is PLANAR:
        return (*(PLANAR_ROW_STEPS if "q" in given else ()), *_planar_steps(terms))
    steps = [step for name in given for step in ATTITUDE_STEPS.get(name, ())]
    steps += ATTITUDE2_STEPS if "S2" in given else ()
    steps += [*(ROW_STEPS if "q" in given else ()), *_spatial_steps(sequence, home, terms)]
    if not given:
        return tuple(steps)
    if any(name in LOADS for name in given):
        return forward_steps(tuple(steps))
    steps += CONSTRAINT_STEPS if "S2" in given else MASS_STEPS
    steps += [*JACOBIAN_STEPS, *SENSITIVITY_STEPS]
    if sequence is not None:
        steps += coordinate_steps(sequence)
    return tuple(step for step in steps if step.result not in given)


def _spatial_steps(sequence: str | None, home: bool, terms: Terms) -> tuple[Step, ...]:
    """Return the steps to both bodies from body 1 and the hinge."""
    angle_terms, hinge_terms = terms
    if terms is NUMERIC:
        steps = [Step("hinge", hinge_terms, ("psi",)), Step("cosine", hinge_cosine, ("hinge",))]
    else:
        arm = LEVER_STEPS[0] if home else Step("arm", same, ("u2",))
        steps = [
            Step("hinge", hinge_terms, ("psi",)),
            Step("cosine", eq.cosine_of_psi, ("hinge",)),
            arm,
            *LEVER_STEPS[1:],
        ]
    if sequence == "XYZ":
        steps.append(Step("trig", angle_terms, ("phi",)))
    elif sequence is not None:
        steps.append(Step("angles", find_sequence(sequence).angles, ("phi",)))
        steps.append(Step("trig", angle_terms, ("angles",)))
    if sequence is not None:  # body 1 from its Euler angles (E4, E10)
        order = find_sequence(sequence)
        steps += (
            Step("S1", order.attitude, ("trig",)),
            Step("axes", order.axes, ("trig",)),
            Step("omega1", order.angular_velocity, ("axes", "phid")),
            Step("alpha1", order.angular_acceleration, ("axes", "phid", "phidd")),
        )
    own = GIVEN_S1 if sequence is None else {}
    for step in HINGE_STEPS:
        steps += own.get(step.result, (step,))
    return tuple(steps if home else [WITHOUT_HOME if step.result == "S2" else step for step in steps])


def _planar_steps(terms: Terms) -> tuple[Step, ...]:
    """Return the steps to both bodies of a planar pair; `terms` make the sines and cosines of the two angles."""
    if terms == NUMERIC:
        return PLANAR_STEPS
    angle_terms, hinge_terms = terms
    own: dict[str, Callable[..., Any]] = {
        "hinge": hinge_terms,
        "cosine": eq.cosine_of_psi,
        "turn1": lambda phi1: angle_terms((phi1,)),
    }
    return tuple(step._replace(function=own.get(step.result, step.function)) for step in PLANAR_STEPS)
