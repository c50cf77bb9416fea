"""What a prepared call of a pair may be asked."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import Any, Final

from numpy.typing import ArrayLike

from hingepair.engine.backend import Execution
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.pair import dynamics
from hingepair.pair.computations import computation_of
from hingepair.pair.constants import ADDED_HINGE_FRAME_VECTOR_NAMES, with_hinge_frames
from hingepair.pair.derivatives import POSE_SENSITIVITY_NAMES, VELOCITY_SENSITIVITY_NAMES
from hingepair.plans.arguments import (
    check_outputs,
)
from hingepair.plans.computation import QUATERNIONS
from hingepair.plans.dynamics_steps import ACCELERATIONS, FORCES, LOADS, MASS_CONSTANTS
from hingepair.plans.plan import (
    PLANAR_MOTION_KIND,
    SPATIAL_MOTION_KIND,
    default_outputs,
    make_plan,
)
from hingepair.plans.prepared import Prepared
from hingepair.plans.steps import (
    ATTITUDE1_AND_CHECK_STEPS_BY_INPUT_NAME,
)
from hingepair.rotations.sequences import find_sequence

# The names of inputs for which a keyword such as "velocity" stands.
_INPUT_NAMES_BY_PREPARED_COMPUTATION_NAME: Final = {
    "pose": ("q",),
    "velocity": ("q", "qd"),
    "acceleration": ("q", "qd", "qdd"),
    "inverse_dynamics": ("S1", "omega1", "a1", "alpha1", "psi", "psid", "psidd"),
    "forward_dynamics": ("S1", "omega1", "psi", "psid", *FORCES),
}
# All inputs that a prepared call can take.
_ALLOWED_INPUT_NAMES: Final = (
    *("q", "qd", "qdd", "psi", "psid", "psidd", "R1", "S1", "v1", "omega1", "a1", "alpha1"),
    *("R2", "S2", "v2", "omega2", "a2", "alpha2", *QUATERNIONS, *LOADS),
)
_TWO_BODY_OUTPUT_NAMES: Final = (
    *("gap", "tilt", "tilt_angle", "psi", "gap_rate", "tilt_rate", "slip", "psid", "gap_acceleration"),
    *("tilt_acceleration", "psidd", "constraint_jacobian", "constraint_bias"),
)
"""Outputs that need the motions of both bodies."""
_ALLOWED_OUTPUT_NAMES: Final = (
    *SPATIAL_MOTION_KIND.levels,
    *("jacobian", "coordinate_jacobian", "coordinate_jacobian_rate", "acceleration_bias"),
    *POSE_SENSITIVITY_NAMES,
    *VELOCITY_SENSITIVITY_NAMES,
    *_TWO_BODY_OUTPUT_NAMES,
    *FORCES,
    *("bearing_torque", "mass_matrix", "kinetic", "potential", "linear", "angular"),
)
"""All outputs that a prepared call can compute."""


def prepare(
    pair: Any,
    given: str | Iterable[str],
    outputs: Iterable[str] | None,
    sequence: str,
    gravity: ArrayLike,
    execution: Execution,
) -> Prepared:
    """Return the call that `HingePair.prepare` describes. Issue a DynamicsWarning for assumed masses.

    Raises:
        ArgumentError: unknown names, missing inputs or missing masses.
    """
    names = _checked_input_names(given)
    bodies, constants = (pair.body1, pair.body2), pair.constants
    forward = any(name in LOADS for name in names)
    if outputs is None and forward:
        outputs = ACCELERATIONS
    elif outputs is None and given == "inverse_dynamics":
        outputs = FORCES
    rows = "q" in names
    if rows:
        find_sequence(sequence)
    level = sum(name in names for name in (("qd", "qdd") if rows else ("psid", "psidd")))
    output_names = default_outputs(level) if outputs is None else check_outputs(outputs, _ALLOWED_OUTPUT_NAMES)
    plan_of = functools.partial(make_plan, sequence=sequence if rows else None, has_home="home" in constants.values)
    plan = plan_of(output_names, given_names=names)
    if not plan.inputs.isdisjoint(MASS_CONSTANTS):
        constants = dynamics.with_loads_and_masses(constants, bodies, gravity, plan)
    if "S2" in names:
        constants = with_hinge_frames(constants)
    known_names = {*names, *constants.values}
    for name in output_names:
        of_both = names if forward or name not in _TWO_BODY_OUTPUT_NAMES else (*names, "S2")
        missing = sorted(plan_of((name,), given_names=of_both).inputs - known_names - ADDED_HINGE_FRAME_VECTOR_NAMES)
        if missing:  # a plan without q takes the results of coordinates as inputs
            needed = ", ".join("q" if one == name else one for one in missing)
            raise ArgumentError("given", f"names with {needed}, which output {name} needs", ", ".join(names))
    computation = computation_of(SPATIAL_MOTION_KIND, constants, output_names, sequence if rows else None)
    remade = functools.partial(
        pair.prepare, names, outputs=output_names, sequence=sequence, gravity=gravity,
        workers=execution.workers, backend=execution.backend,
    )  # fmt: skip
    may_be_singular = forward and "psidd" in output_names and dynamics.may_be_singular(constants)
    watch = functools.partial(dynamics.watch, pair) if may_be_singular else None
    return Prepared(computation, names, execution, None, remade, watch)


def prepare_planar(
    pair: Any, given: str | Iterable[str], outputs: Iterable[str] | None, execution: Execution
) -> Prepared:
    """Return the call that `PlanarPair.prepare` describes.

    Raises:
        ArgumentError: unknown names, or missing inputs.
    """
    names = _checked_input_names(given, ("q", "qd", "qdd"))
    kind, level = PLANAR_MOTION_KIND, sum(name in names for name in ("qd", "qdd"))
    output_names = default_outputs(level, kind) if outputs is None else check_outputs(outputs, kind.levels)
    for name in output_names:
        missing = make_plan((name,), None, False, kind=kind, given_names=names).inputs - {*names, "u1", "u2"}
        if missing:
            needed = ", ".join(one for one, parts in kind.parts.items() if not missing.isdisjoint(parts))
            raise ArgumentError("given", f"names with {needed}, which output {name} needs", ", ".join(names))
    remade = functools.partial(
        pair.prepare, names, outputs=output_names, workers=execution.workers, backend=execution.backend
    )
    computation = computation_of(kind, pair.constants, output_names, None)
    return Prepared(computation, names, execution, None, remade)


def _checked_input_names(
    given: str | Iterable[str], allowed: tuple[str, ...] = _ALLOWED_INPUT_NAMES
) -> tuple[str, ...]:
    """Return the names of the inputs for which `given`, a word or the names themselves, stands."""
    words = {
        word: names for word, names in _INPUT_NAMES_BY_PREPARED_COMPUTATION_NAME.items() if {*names} <= {*allowed}
    }
    try:
        names = words[given] if isinstance(given, str) else tuple(given)
    except (KeyError, TypeError):
        raise ArgumentError("given", f"{choices(tuple(words))}, or a tuple of names", quoted(given)) from None
    for name in names:
        if name not in allowed:
            raise ArgumentError("given", choices(allowed), quoted(name))
    attitudes = [name for name in names if name in {"q", *ATTITUDE1_AND_CHECK_STEPS_BY_INPUT_NAME}]
    if len(attitudes) != 1 or len({*names}) != len(names):
        raise ArgumentError("given", "one attitude of body 1: q, S1, quat_xyzw or quat_wxyz", quoted(names))
    return names
