"""What to compute: the equations as a graph of steps, of which a plan takes those that the outputs need.

Every way to evaluate the pair - one state in Python floats, blocks of NumPy arrays, SymPy symbols, mpmath numbers -
runs the steps of one plan, so the equations are put together here and nowhere else.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from hingepair.engine.binding import ArrayShape
from hingepair.engine.loops import Loop
from hingepair.equations import spatial as eq
from hingepair.equations.quantities import QUANTITIES, sample_shape
from hingepair.numeric.blocks import angle_terms, hinge_cosine, hinge_terms
from hingepair.plans.constant_steps import PLANAR_CONSTANT_STEPS, SPATIAL_CONSTANT_STEPS
from hingepair.plans.dynamics_steps import (
    DYNAMICS_STEPS,
    LOADS,
    PLANAR_DYNAMICS_STEPS,
    PLANAR_FORWARD_STEPS,
    forward_dynamics_steps,
)
from hingepair.plans.points import (
    Point,
    named_results,
    planar_point_steps,
    point_outputs,
    point_shapes,
    result_of,
    spatial_point_steps,
)
from hingepair.plans.steps import (
    ARM_STEPS,
    ATTITUDE2_CHECK_STEPS,
    ATTITUDE_STEPS,
    BODY2_KINEMATICS_STEPS,
    CONSTRAINT_STEPS,
    GIVEN_ATTITUDE_STEPS,
    JACOBIAN_STEPS,
    LEVER_CONSTANT_STEPS,
    PLANAR_COORDINATE_NAMES,
    PLANAR_KINEMATICS_STEPS,
    PLANAR_PARTS,
    PLANAR_SPLIT_STEPS,
    SPATIAL_COORDINATE_NAMES,
    SPATIAL_PARTS,
    SPATIAL_SPLIT_STEPS,
    WITHOUT_HOME,
    Step,
    same,
)
from hingepair.rotations.sequences import find_sequence

TrigFunctions: TypeAlias = tuple[Callable[..., Any], Callable[..., Any]]  # of phi and of psi: NUMERIC_TRIG, or exact

_VELOCITIES: Final = 7  # v1, omega1 and psi'
_INNER_SHAPES: Final[dict[str, ArrayShape]] = {  # of constants, and of what steps alone know
    **dict.fromkeys(("lever_fixed", "lever_cos", "lever_sin"), (3,)),
    **dict.fromkeys(("e1", "e2", "e1_in_2", "e2_in_2", "n_in_2"), (3,)),
    **dict.fromkeys(("phi1", "phi1d", "phi1dd", "psid_given"), ()),
    "arm2": (3,),
    "home": (9,),
    "tree": (32,),
    "whole_body2": (22,),
    "pivots": (7,),
    **{"least_axis": (3,), "masses": (2,), "first_moments": (6,), "inertias": (12,), "least_pivots": (3,)},
}


def _sample_shapes(coordinates: int) -> dict[str, ArrayShape]:
    """Return the shape of a sample of all that can be given or computed of a pair in space."""
    sizes = {"coordinates": coordinates, "velocities": _VELOCITIES, "joints": 1, "parameters": 20}
    sizes |= {"tree": 1, "conditions": 0, "struts": 0}  # of mechanisms with loops and struts
    shapes = {name: sample_shape(name, sizes) for name in QUANTITIES}
    return {**shapes, **_INNER_SHAPES}


@dataclass(frozen=True, slots=True, eq=False)
class MotionKind:
    """A kind of motion of a pair, in space or in a plane."""

    coordinates: tuple[str, ...]  # names of the components of q
    parts: Mapping[str, tuple[str, ...]]  # names of position, angles and hinge angle in q, qd and qdd
    shapes: Mapping[str, ArrayShape]  # of one sample of all that can be given or computed
    levels: Mapping[str, int | None]  # from which an output is a default output; None if it never is one
    gravity: tuple[float, ...]  # acceleration of free fall unless given [m/s^2]

    def __reduce__(self) -> str:  # the two kinds are compared by identity
        return "SPATIAL_MOTION_KIND" if len(self.coordinates) == 7 else "PLANAR_MOTION_KIND"


_BODY1: Final = ("R1", "S1", "v1", "omega1", "a1", "alpha1")  # outputs only if they are named


def _levels(*of_body2: str) -> dict[str, int | None]:
    return {name: QUANTITIES[name].order for name in of_body2}


SPATIAL_MOTION_KIND: Final = MotionKind(
    SPATIAL_COORDINATE_NAMES,
    SPATIAL_PARTS,
    _sample_shapes(7),
    {**_levels("R2", "S2", "d", "v2", "omega2", "a2", "alpha2"), **dict.fromkeys(_BODY1)},
    (0.0, 0.0, -9.81),
)
"""Motion in space."""
PLANAR_MOTION_KIND: Final = MotionKind(
    PLANAR_COORDINATE_NAMES,
    PLANAR_PARTS,
    {
        **_sample_shapes(4),
        **dict.fromkeys(("R1", "v1", "a1", "u1", "u2", "R2", "d", "v2", "a2"), (2,)),
        **dict.fromkeys(("phi2", "omega2", "alpha2"), ()),
        **dict.fromkeys(("gravity", "force1", "force2", "hinge_force", "linear"), (2,)),
        **dict.fromkeys(("torque1", "torque2", "hinge_moment", "bearing_torque", "angular"), ()),
        **{"mass_matrix": (4, 4), "first_moments": (4,), "inertias": (2,)},
    },
    _levels("R2", "phi2", "d", "v2", "omega2", "a2", "alpha2"),
    (0.0, -9.81),  # y points up
)
"""Motion in two coordinates (E11)."""


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """The steps that compute outputs of a pair from inputs, in order."""

    outputs: tuple[str, ...]  # names of the outputs, in the requested order
    steps: tuple[Step, ...]  # the steps, each after those on which it depends
    inputs: frozenset[str]  # names of the inputs that the steps need
    kind: MotionKind  # SPATIAL_MOTION_KIND or PLANAR_MOTION_KIND
    points: tuple[Point, ...] = ()  # that the outputs may be of

    def run(self, values: dict[str, Any]) -> dict[str, Any]:
        """Run the steps on `values`, the inputs by name; add the result of each step to it, and return it."""
        for result, function, arguments in self.steps:
            values[result] = function(*[values[name] for name in arguments])
        if self.points:
            named_results(values, self.outputs)
        return values


NUMERIC_TRIG: Final[TrigFunctions] = (angle_terms, hinge_terms)
"""Functions by which floats and arrays make the sines and cosines of phi and of psi."""


@functools.lru_cache(maxsize=1024)
def make_plan(
    outputs: tuple[str, ...],
    sequence: str | None = "XYZ",
    has_home: bool = True,
    trig_functions: TrigFunctions = NUMERIC_TRIG,
    kind: MotionKind = SPATIAL_MOTION_KIND,
    given_names: tuple[str, ...] = (),
    points: tuple[Point, ...] = (),
) -> Plan:
    """Return the `Plan` that computes the named outputs of a pair in space or in a plane (`kind`).

    Args:
        outputs: names of the outputs.
        sequence: of the Euler angles; None where S1, omega1 and alpha1 are given.
        has_home: whether C differs from the identity.
        trig_functions: functions that return (sin, cos) of the three angles, and (sin, 1 - cos) of psi. Exact
            numbers, which have other functions than NUMERIC_TRIG, go through
            LEVER_CONSTANT_STEPS as well; for doubles, the pair has taken these steps already.
        kind: SPATIAL_MOTION_KIND or PLANAR_MOTION_KIND; the latter takes phi1 for the three angles.
        given_names: names of the inputs beside the pair's constants, out of the kind's shapes; empty for the parts of
            the coordinates and of body 1's motion, as far as they are needed.
        points: points of the pair, of which outputs may be.

    Returns:
        The same object for the same steps, whatever the arguments are: programs and kernels are cached by plan.
    """
    known = point_outputs(points)
    asked = tuple(point for point in points if any(name in point_outputs((point,)) for name in outputs))
    results = tuple(result_of(name) if name in known else name for name in outputs)
    steps, _ = needed_steps(all_steps(sequence, has_home, trig_functions, kind, given_names, asked), results)
    return _plan(steps, outputs, results, kind, asked)


@functools.lru_cache(maxsize=1024)
def _plan(
    steps: tuple[Step, ...],
    outputs: tuple[str, ...],
    results: tuple[str, ...],
    kind: MotionKind,
    points: tuple[Point, ...],
) -> Plan:
    """Return the cached plan of those steps that the results need."""
    return Plan(outputs, *needed_steps(steps, results), kind, points)


@functools.lru_cache(maxsize=1024)
def shapes_with_points(kind: MotionKind, points: tuple[Point, ...]) -> Mapping[str, ArrayShape]:
    """Return the shape of one sample of all that can be given or computed of a pair with points."""
    return {**kind.shapes, **point_shapes(points, len(kind.gravity))} if points else kind.shapes


@functools.lru_cache(maxsize=256)
def from_constants(plan: Plan) -> Plan:
    """Return a plan that first computes the constants of its steps from the geometry and masses of the pair."""
    constant_steps = PLANAR_CONSTANT_STEPS if plan.kind is PLANAR_MOTION_KIND else SPATIAL_CONSTANT_STEPS
    steps, inputs = needed_steps(constant_steps, plan.inputs)
    return Plan(plan.outputs, (*steps, *plan.steps), inputs, plan.kind, plan.points)


@functools.lru_cache(maxsize=1024)
def plan_loop(plan: Plan) -> Loop:
    """Return the cached `Loop` that runs a plan over samples."""
    shapes = shapes_with_points(plan.kind, plan.points)
    inputs, outputs = ({name: shapes[name] for name in names} for names in (sorted(plan.inputs), plan.outputs))
    return Loop("state", plan.run, inputs, outputs)


def needed_steps(steps: Iterable[Step], outputs: Iterable[str]) -> tuple[tuple[Step, ...], frozenset[str]]:
    """Return the steps on which the outputs depend, in order, and the names of the inputs that are needed: all
    arguments of these steps and all outputs that no step computes.
    """
    needed = set(outputs)
    selected = []
    for step in reversed(tuple(steps)):
        if step.result in needed:
            selected.append(step)
            needed.remove(step.result)
            needed.update(step.arguments)
    return tuple(reversed(selected)), frozenset(needed)


@functools.cache
def default_outputs(level: int, kind: MotionKind = SPATIAL_MOTION_KIND) -> tuple[str, ...]:
    """Return the names of the outputs that are computed if the user names none: those of a level (0 pose, 1 velocity,
    2 acceleration) and of the levels below it.
    """
    return tuple(name for name, lowest in kind.levels.items() if lowest is not None and lowest <= level)


@functools.lru_cache(maxsize=256)
def all_steps(
    sequence: str | None,
    has_home: bool,
    trig_functions: TrigFunctions = NUMERIC_TRIG,
    kind: MotionKind = SPATIAL_MOTION_KIND,
    given_names: tuple[str, ...] = (),
    points: tuple[Point, ...] = (),
) -> tuple[Step, ...]:
    """Return a cached tuple of all steps that are possible with the given inputs, of which a plan takes those that it
    needs; the arguments are those of `make_plan`.
    """
    if kind is PLANAR_MOTION_KIND:
        split = PLANAR_SPLIT_STEPS if "q" in given_names else ()
        dynamic = PLANAR_FORWARD_STEPS if any(name in LOADS for name in given_names) else PLANAR_DYNAMICS_STEPS
        kinematic = *_planar_steps(trig_functions), *planar_point_steps(points)
        return (*split, *kinematic, *(dynamic if given_names else ()))
    steps = [step for name in given_names for step in ATTITUDE_STEPS.get(name, ())]
    steps += ATTITUDE2_CHECK_STEPS if "S2" in given_names else ()
    steps += [
        *(SPATIAL_SPLIT_STEPS if "q" in given_names else ()),
        *_spatial_steps(sequence, has_home, trig_functions),
        *spatial_point_steps(points),
    ]
    if not given_names:
        return tuple(steps)
    if any(name in LOADS for name in given_names):
        return forward_dynamics_steps(tuple(steps))
    if "S2" in given_names:
        steps += CONSTRAINT_STEPS
    else:
        steps += [*ARM_STEPS, *DYNAMICS_STEPS]
    steps += JACOBIAN_STEPS
    return tuple(step for step in steps if step.result not in given_names)


def _spatial_steps(sequence: str | None, has_home: bool, trig_functions: TrigFunctions) -> tuple[Step, ...]:
    """Return the steps of the motion of both bodies in space, with these functions for sines and cosines."""
    angle_terms, hinge_terms = trig_functions
    if trig_functions is NUMERIC_TRIG:
        steps = [Step("hinge", hinge_terms, ("psi",)), Step("cosine", hinge_cosine, ("hinge",))]
    else:
        arm = LEVER_CONSTANT_STEPS[0] if has_home else Step("arm", same, ("u2",))
        steps = [
            Step("hinge", hinge_terms, ("psi",)),
            Step("cosine", eq.cosine_of_psi, ("hinge",)),
            arm,
            *LEVER_CONSTANT_STEPS[1:],
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
    replaced_steps = GIVEN_ATTITUDE_STEPS if sequence is None else {}
    for step in BODY2_KINEMATICS_STEPS:
        steps += replaced_steps.get(step.result, (step,))
    return tuple(steps if has_home else [WITHOUT_HOME if step.result == "S2" else step for step in steps])


def _planar_steps(trig_functions: TrigFunctions) -> tuple[Step, ...]:
    """Return the steps of the motion of both bodies in the plane, with these functions for sines and cosines."""
    if trig_functions == NUMERIC_TRIG:
        return PLANAR_KINEMATICS_STEPS
    angle_terms, hinge_terms = trig_functions
    replaced_functions: dict[str, Callable[..., Any]] = {
        "hinge": hinge_terms,
        "cosine": eq.cosine_of_psi,
        "turn1": lambda phi1: angle_terms((phi1,)),
    }
    return tuple(
        step._replace(function=replaced_functions.get(step.result, step.function)) for step in PLANAR_KINEMATICS_STEPS
    )
