"""What a prepared call of a robot may be asked."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from hingepair.errors import ArgumentError, choices, quoted
from hingepair.mechanism.arguments import BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME, ZERO_BASE_LOAD_BY_INPUT_NAME

ARGUMENT_NAMES_BY_PREPARED_COMPUTATION_NAME: Final = {
    "pose": ("q",),
    "velocity": ("q", "qd"),
    "acceleration": ("q", "qd", "qdd"),
    "jacobian": ("q",),
    "jacobian_in_frame": ("q",),
    "acceleration_bias": ("q", "qd"),
    "inverse_dynamics": ("q", "qd", "qdd"),
    "joint_wrenches": ("q", "qd", "qdd"),
    "forward_dynamics": ("q", "qd", "tau"),
    "mass_matrix": ("q",),
    "bias_forces": ("q", "qd"),
    "gravity_forces": ("q",),
    "centroidal_momentum_matrix": ("q",),
}
"""Names of the arguments of a prepared call, by the method or level of motion for which it is prepared."""

_JOINT_ARGUMENT_NAMES: Final = ("q", "qd", "qdd", "tau")  # which have a component for each coordinate
# Names that the argument `given` of `prepare` may hold.
_ARGUMENT_NAMES_OF_PREPARED_CALLS: Final = (
    *_JOINT_ARGUMENT_NAMES,
    *BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME,
    *ZERO_BASE_LOAD_BY_INPUT_NAME,
)


def checked_given(given: str | Iterable[str], needed_inputs: Iterable[str] = ()) -> tuple[str, ...]:
    """Check the argument `given` of `prepare`, the name of a computation or an iterable of argument names, and return
    a tuple of the names of the call's arguments. Raise an ArgumentError for an unknown or repeated name, and if q,
    qd, qdd or tau is among `needed_inputs` but not among these names.

    Raises:
        ArgumentError: an unknown name, or one twice.
    """
    try:
        names = ARGUMENT_NAMES_BY_PREPARED_COMPUTATION_NAME[given] if isinstance(given, str) else tuple(given)
    except (KeyError, TypeError):
        raise ArgumentError(
            "given",
            f"{choices(tuple(ARGUMENT_NAMES_BY_PREPARED_COMPUTATION_NAME))}, or a tuple of names",
            quoted(given),
        ) from None
    for name in names:
        if name not in _ARGUMENT_NAMES_OF_PREPARED_CALLS:
            raise ArgumentError("given", choices(_ARGUMENT_NAMES_OF_PREPARED_CALLS), quoted(name))
    if len({*names}) < len(names):
        raise ArgumentError("given", "each name once", quoted(names))
    for name in needed_inputs:
        if name in _JOINT_ARGUMENT_NAMES and name not in names:
            raise ArgumentError("given", f"{name} too, since the outputs need it", ", ".join(names))
    return names
