"""Arguments that only robots have: the motion of the base, and wrenches on links."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.pair.body_motion import BodyMotion, motion_inputs
from hingepair.plans.arguments import Arguments, CoordinateNames, read_arguments

BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME: Final = {
    f"{letter}1": letter for letter in ("R", "S", "v", "omega", "a", "alpha")
}
"""Attributes of a BodyMotion by the names of the inputs that describe the base's motion."""

BASE_LABELS: Final = {
    name: f"base_motion.{letter}" for name, letter in BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME.items()
}
"""Names of these inputs in messages."""

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
    base = base_inputs(base_motion, needed_inputs)
    labels = BASE_LABELS | {name: label for name, (_, label) in labelled_loads.items()}
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys((*base, *labelled_loads), (3,))
    shapes |= {"S1": (3, 3), **dict.fromkeys(coordinates, (len(joint_names),))}
    given = {**coordinates, **base, **{name: value for name, (value, _) in labelled_loads.items()}}
    return read_arguments(given, shapes, CoordinateNames(joint_names, noun="joints"), labels)


def base_inputs(base_motion: BodyMotion | None, needed_inputs: Iterable[str]) -> dict[str, Any]:
    """Return the arrays of a base's motion by input name. Where it has a pose alone, the base is at rest.

    Raises:
        ArgumentError: not a BodyMotion, or an input that is needed is missing.
    """
    if base_motion is None:
        return {}
    if not isinstance(base_motion, BodyMotion):
        raise ArgumentError("base_motion", "a BodyMotion", quoted(base_motion))
    arrays = motion_inputs("base1", base_motion)
    at_rest = arrays.keys() <= {"R1", "S1"}
    for name in needed_inputs:
        if name in BASE_LABELS and name not in arrays and (name in {"R1", "S1"} or not at_rest):
            letter = BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME[name]
            expected = f"a value, as in BodyMotion(..., {letter}=...): an output needs it"
            raise ArgumentError(BASE_LABELS[name], expected, None)
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
