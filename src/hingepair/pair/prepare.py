"""What a call can be prepared for: the names that it will bring, and what is computed of them."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import Final

from numpy.typing import ArrayLike

from hingepair.engine.backend import How
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.pair import dynamics
from hingepair.pair.constants import HINGE_FRAMES, Constants, with_hinge_frames
from hingepair.pair.derivatives import POSE_SENSITIVITIES, RATE_SENSITIVITIES
from hingepair.pair.prepared import CHECK, QUATERNIONS, Prepared
from hingepair.plans.dynamics_steps import LOADS, MASSES, MOVES, REQUIRED
from hingepair.plans.plan import SPATIAL, check_outputs, default_outputs, make_plan
from hingepair.plans.steps import ATTITUDE_STEPS
from hingepair.rotations.sequences import find_sequence

_KINDS: Final = {
    "pose": ("q",),
    "velocity": ("q", "qd"),
    "acceleration": ("q", "qd", "qdd"),
    "inverse_dynamics": ("S1", "omega1", "a1", "alpha1", "psi", "psid", "psidd"),
    "forward_dynamics": ("S1", "omega1", "psi", "psid", *REQUIRED),
}
_GIVEN: Final = (
    *("q", "qd", "qdd", "psi", "psid", "psidd", "R1", "S1", "v1", "omega1", "a1", "alpha1"),
    *("R2", "S2", "v2", "omega2", "a2", "alpha2", *QUATERNIONS, *LOADS),
)
_OF_BOTH: Final = (
    *("gap", "tilt", "tilt_angle", "psi", "gap_rate", "tilt_rate", "slip", "psid", "gap_acceleration"),
    *("tilt_acceleration", "psidd", "constraint_jacobian", "constraint_bias"),
)
"""What can be had of two motions."""
_OUTPUTS: Final = (
    *SPATIAL.levels,
    *("jacobian", "coordinate_jacobian", "coordinate_jacobian_rate", "acceleration_bias"),
    *POSE_SENSITIVITIES,
    *RATE_SENSITIVITIES,
    *_OF_BOTH,
    *REQUIRED,
    *("bearing_torque", "mass_matrix", "kinetic", "potential", "linear", "angular"),
)
"""All that can be prepared."""


def prepare(
    pair: Constants,
    bodies: dynamics.Bodies,
    given: str | Iterable[str],
    outputs: Iterable[str] | None,
    sequence: str,
    gravity: ArrayLike,
    how: How,
) -> Prepared:
    """A plan made ready; see `HingePair.prepare`."""
    names = _checked_given(given)
    forward = any(name in LOADS for name in names)
    if outputs is None and forward:
        outputs = MOVES
    elif outputs is None and given == "inverse_dynamics":
        outputs = REQUIRED
    rows = "q" in names
    if rows:
        find_sequence(sequence)
    level = sum(name in names for name in (("qd", "qdd") if rows else ("psid", "psidd")))
    wanted = default_outputs(level) if outputs is None else check_outputs(outputs, _OUTPUTS)
    plan_of = functools.partial(make_plan, sequence=sequence if rows else None, home="home" in pair.values)
    plan = plan_of(wanted if rows else (*wanted, CHECK), given=names)
    if not plan.inputs.isdisjoint(MASSES):
        pair = dynamics.for_calls(pair, bodies, gravity, plan.inputs)
    if forward:
        dynamics.check_resistance(pair, bodies)
    if "S2" in names:
        pair = with_hinge_frames(pair)
    known = {*names, *pair.values}
    for name in wanted:
        of_both = names if forward or name not in _OF_BOTH else (*names, "S2")
        missing = sorted(plan_of((name,), given=of_both).inputs - known - HINGE_FRAMES)
        if missing:
            raise ArgumentError("given", f"what output {name} needs too: {', '.join(missing)}", ", ".join(names))
    return Prepared(pair, plan, names, how, now=True)


def _checked_given(given: str | Iterable[str]) -> tuple[str, ...]:
    try:
        names = _KINDS[given] if isinstance(given, str) else tuple(given)
    except (KeyError, TypeError):
        raise ArgumentError("given", f"{choices(tuple(_KINDS))}, or a tuple of names", quoted(given)) from None
    for name in names:
        if name not in _GIVEN:
            raise ArgumentError("given", choices(tuple(_GIVEN)), quoted(name))
    attitudes = [name for name in names if name in {"q", *ATTITUDE_STEPS}]
    if len(attitudes) != 1 or len({*names}) != len(names):
        raise ArgumentError("given", "one attitude of body 1: q, S1, quat_xyzw or quat_wxyz", quoted(names))
    return names
