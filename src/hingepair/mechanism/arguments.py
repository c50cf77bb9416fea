"""Arguments that only robots have: the motion of the base, and wrenches on links."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.pair.body_motion import BodyMotion
from hingepair.plans.arguments import Arguments, CoordinateNames, read_arguments

BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME: Final = {
    "R1": "R",
    "S1": "S",
    "v1": "v",
    "omega1": "omega",
    "a1": "a",
    "alpha1": "alpha",
}
"""Attributes of a BodyMotion by the names of the inputs that describe the base's motion."""

RESTING_BASE_VALUE_BY_INPUT_NAME: Final[Mapping[str, tuple[float, ...]]] = {
    **dict.fromkeys(("R1", "v1", "omega1", "a1", "alpha1"), (0.0, 0.0, 0.0)),
    "S1": (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
}
"""Inputs of a base that rests at the origin, by name."""

ZERO_BASE_LOAD_BY_INPUT_NAME: Final[Mapping[str, tuple[float, ...]]] = dict.fromkeys(
    ("force1", "torque1"), (0.0, 0.0, 0.0)
)
"""Inputs of a base without loads, by name."""


def read_robot_arguments(
    joint_names: tuple[str, ...],
    coordinates: Mapping[str, Any],
    base_motion: BodyMotion | None,
    needed_inputs: Iterable[str],
    labelled_loads: Mapping[str, Any],
) -> Arguments:
    """Check the arguments of a robot's method, and return them in the form that calls take.

    Args:
        joint_names: names of the joints with a coordinate, in order.
        coordinates: q, qd, qdd or tau by argument name.
        base_motion: the motion of the base; None where it rests at the origin.
        needed_inputs: names of the inputs that the outputs need.
        labelled_loads: forces and torques by input name: a value, and its name for messages.

    Raises:
        ArgumentError: an argument cannot be used; the error names it and the joint.
    """
    base = _base_arrays(base_motion, needed_inputs)
    labels = {name: f"base_motion.{BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME[name]}" for name in base}
    labels |= {name: label for name, (_, label) in labelled_loads.items()}
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys((*base, *labelled_loads), (3,))
    shapes |= {"S1": (3, 3), **dict.fromkeys(coordinates, (len(joint_names),))}
    loads = {name: value for name, (value, _) in labelled_loads.items()}
    given = {**coordinates, **base, **loads}
    arguments = read_arguments(given, shapes, CoordinateNames(joint_names, noun="joints"), labels)
    if base_motion is not None:  # its arrays that are not needed broadcast, too
        for name in base:
            del arguments.shapes[labels[name]]
        arguments.shapes["base_motion"] = base_motion.shape
    return arguments


def _base_arrays(base_motion: BodyMotion | None, needed_inputs: Iterable[str]) -> dict[str, Any]:
    """Return those arrays of a BodyMotion that are among `needed_inputs`, as a dict by input name such as "R1"; for
    None, return an empty dict. If the motion has only a pose, velocities and accelerations are not needed. Raise an
    ArgumentError if `base_motion` is not a BodyMotion, or if a needed array is missing.
    """
    if base_motion is None:
        return {}
    if not isinstance(base_motion, BodyMotion):
        raise ArgumentError("base_motion", "a BodyMotion", quoted(base_motion))
    arrays = {}
    at_rest = all(getattr(base_motion, letter) is None for letter in ("v", "omega", "a", "alpha"))
    for name in needed_inputs:
        if name in BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME and (name in {"R1", "S1"} or not at_rest):
            letter = BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME[name]
            arrays[name] = getattr(base_motion, letter)
            if arrays[name] is None:
                expected = f"a value, as in BodyMotion(..., {letter}=...): an output needs it"
                raise ArgumentError(f"base_motion.{letter}", expected, None)
    return arrays


def read_wrenches(wrenches: Any, links: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    """Check the argument `wrenches`, None or a dict of pairs by link, and return a dict of (force, torque) by link,
    which is empty for None. Raise an ArgumentError for a link that is not a key of `links`, or for a value that is
    not a pair. The forces and torques are not checked.

    Raises:
        ArgumentError: an unknown link, or no pair of vectors; the error names it.
    """
    if wrenches is None:
        return {}
    if not isinstance(wrenches, Mapping):
        raise ArgumentError("wrenches", "(force, torque) by the link's name", quoted(wrenches))
    for link, value in wrenches.items():
        if link not in links:
            link_names = tuple(links)
            raise ArgumentError("wrenches", choices(link_names) + nearest(str(link), link_names), quoted(link))
        if not isinstance(value, tuple | list) or len(value) != 2:
            raise ArgumentError(f"wrenches[{link!r}]", "a pair (force, torque)", quoted(value))
    return {link: (value[0], value[1]) for link, value in wrenches.items()}
