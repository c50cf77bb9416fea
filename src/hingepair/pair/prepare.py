"""Prepared calls of pairs, in space and in the plane."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import Any, Final

from numpy.typing import ArrayLike

from hingepair.engine.backend import Execution
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.numeric.arrays import one_constant
from hingepair.pair import dynamics
from hingepair.pair.computations import ROWS, STATES, TASKS, computation_of
from hingepair.pair.constants import HINGE_FRAMES, with_hinge_frames
from hingepair.plans.arguments import check_outputs
from hingepair.plans.computation import QUATERNIONS
from hingepair.plans.dynamics_steps import LOADS, MASS_NUMBERS
from hingepair.plans.plan import PLANAR_MOTION_KIND, SPATIAL_MOTION_KIND, default_outputs, make_plan
from hingepair.plans.prepared import Prepared
from hingepair.plans.steps import ATTITUDE_STEPS
from hingepair.rotations.sequences import find_sequence

_INPUTS: Final = {  # that a prepared call can take
    SPATIAL_MOTION_KIND: (
        *(*ROWS, "psi", "psid", "psidd", "R1", "S1", "v1", "omega1", "a1", "alpha1"),
        *("R2", "S2", "v2", "omega2", "a2", "alpha2", *QUATERNIONS, *LOADS),
    ),
    PLANAR_MOTION_KIND: (*ROWS, *LOADS),
}
_OF_BOTH_BODIES: Final = (  # outputs that need the motions of both
    *("gap", "tilt", "tilt_angle", "psi", "gap_rate", "tilt_rate", "slip", "psid", "gap_acceleration"),
    *("tilt_acceleration", "psidd", "constraint_jacobian", "constraint_bias"),
)


def prepare(
    pair: Any,
    given: str | Iterable[str],
    outputs: Iterable[str] | None,
    sequence: str | None,
    gravity: ArrayLike,
    execution: Execution,
) -> Prepared:
    """Return the call that `HingePair.prepare` and `PlanarPair.prepare` describe; `sequence` is None in the plane.

    Raises:
        ArgumentError: unknown names, missing inputs or missing masses.
    """
    constants = pair.constants
    kind = constants.kind
    tasks = TASKS[kind]
    names = _checked_names(kind, given)
    forward, rows = any(name in LOADS for name in names), "q" in names
    if sequence is not None and rows:
        find_sequence(sequence)
    order = sequence if rows else None
    if outputs is not None:
        further = _OF_BOTH_BODIES if kind is SPATIAL_MOTION_KIND else ()
        known = dict.fromkeys(
            (*constants.levels, *(name for task in tasks.values() for name in task.outputs), *further)
        )
        output_names = check_outputs(outputs, known)
    elif isinstance(given, str):
        output_names = tasks[given].outputs
    elif forward:
        output_names = tasks["forward_dynamics"].outputs
    else:
        level = sum(name in names for name in (("qd", "qdd") if rows else ("psid", "psidd")))
        output_names = default_outputs(level, kind)
    plan_of = functools.partial(
        make_plan, sequence=order, has_home="home" in constants.values, kind=kind, points=constants.points
    )
    plan = plan_of(output_names, given_names=names)
    if not plan.inputs.isdisjoint(MASS_NUMBERS):
        dynamics.check_masses({one: getattr(pair, one) for one in _bodies(tasks, output_names)})
        constants = pair.with_masses()
    if "S2" in names:
        constants = with_hinge_frames(constants)
    known_names = {*names, *constants.values, "gravity"}
    for name in output_names:
        of_both = names if forward or name not in _OF_BOTH_BODIES or "S2" in names else (*names, "S2")
        missing = sorted(plan_of((name,), given_names=of_both).inputs - known_names - HINGE_FRAMES)
        if missing:  # a plan without q takes the results of coordinates as inputs
            needed = ", ".join("q" if one == name else one for one in missing)
            raise ArgumentError("given", f"names with {needed}, which output {name} needs", ", ".join(names))
    computation = computation_of(kind, constants, output_names, order, STATES[kind])
    remade = functools.partial(
        pair.prepare, names, outputs=output_names, gravity=gravity, workers=execution.workers,
        backend=execution.backend, **({} if sequence is None else {"sequence": sequence}),
    )  # fmt: skip
    solved = tasks["forward_dynamics"].outputs[-1]
    watched = forward and solved in output_names and dynamics.may_be_singular(pair.massive().with_masses())
    watch = functools.partial(dynamics.watch, pair, solved) if watched else None
    vector = tuple(one_constant("gravity", gravity, len(kind.gravity)).tolist())
    return Prepared(computation, names, execution, vector, remade, watch)


def _bodies(tasks: Any, outputs: tuple[str, ...]) -> set[str]:
    """Return the bodies, "body1" or "body2", whose masses the outputs need."""
    fewest: dict[str, tuple[str, ...]] = {}
    for task in tasks.values():
        for name in task.outputs:
            if name not in fewest or len(task.masses) < len(fewest[name]):
                fewest[name] = task.masses
    return {body for name in outputs for body in fewest.get(name, ())}


def _checked_names(kind: Any, given: str | Iterable[str]) -> tuple[str, ...]:
    """Return the names of the inputs that `given` means: a key of TASKS such as "velocity", or the names themselves.
    Refuse unknown and repeated names, and any but one attitude of body 1.
    """
    tasks, allowed = TASKS[kind], _INPUTS[kind]
    try:
        names = tasks[given].given if isinstance(given, str) else tuple(given)
    except (KeyError, TypeError):
        raise ArgumentError("given", f"{choices(tuple(tasks))}, or a tuple of names", quoted(given)) from None
    for name in names:
        if name not in allowed:
            raise ArgumentError("given", choices(allowed), quoted(name))
    attitudes = [name for name in names if name in {"q", *ATTITUDE_STEPS}]
    if len(attitudes) != 1 or len({*names}) != len(names):
        expected = "q" if kind is PLANAR_MOTION_KIND else "one attitude of body 1: q, S1, quat_xyzw or quat_wxyz"
        raise ArgumentError("given", expected, quoted(names))
    return names
