"""A pair as a robot of one joint: its arguments of `simulate` and `linearize` in those of robots."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Final, TypeAlias

from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, SimulationError, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.bodies.hinge_load import HingeTorque
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.subject import check_pair
from hingepair.mechanism.requests import subject_of
from hingepair.motion.given import LoadArgument
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import is_zero

BaseArgument: TypeAlias = str | Callable[[Array], BodyMotion]
"""What holds body 1, as users give it: the name of a base, or a callable of t that returns the motion of body 1."""
JOINT_OF_PAIR: Final = "psi"
"""Name of the joint, and of body 2, in the robot that stands for a pair."""
BASES: Final = ("free", "pinned", "fixed")  # what may hold body 1, beside a callable
# Names in messages about robots, and those of the same values of a pair.
_NAMES: Final = {
    f"q0['{JOINT_OF_PAIR}']": "psi_0",
    f"qd0['{JOINT_OF_PAIR}']": "psid_0",
    f"loads['{JOINT_OF_PAIR}']": "hinge_torque",
    f"wrenches['{JOINT_OF_PAIR}'][0]": "force2",
    f"wrenches['{JOINT_OF_PAIR}'][1]": "torque2",
    "base_motion": "body1",
    "robot": "pair.body2",
    f"body2 of '{JOINT_OF_PAIR}'": "pair.body2",
    "body1 of the first pair": "pair.body1",
    "base, qd": "base, psid_0",
}


def pair_as_robot(
    pair: HingePair,
    base: BaseArgument,
    body1: BodyMotion | None,
    hinge_torque: HingeTorque,
    forces: Mapping[str, LoadArgument],
    gravity: ArrayLike,
) -> tuple[Mechanism, dict[str, Any]]:
    """Return the robot of one joint, psi, that a pair is, and the robot's arguments.

    Args:
        pair: a pair.
        base: what holds body 1.
        body1: its motion at the start; at rest at the origin unless given.
        hinge_torque: torque at the hinge.
        forces: force1, torque1, force2 and torque2.
        gravity: acceleration of free fall.

    Raises:
        ArgumentError: an argument cannot be used, or a body that moves lacks mass properties.
    """
    check_pair(pair)
    moving, moves_body1 = callable(base), base in ("free", "pinned")
    if moving and body1 is not None:
        raise ArgumentError("body1", "None for a base that moves as given", quoted(body1))
    if pair.body2 is not None and subject_of(pair).constants.pivot_thresholds[0] > 0:  # what is below is rounding
        expected = "masses that resist every motion: body 2 has no inertia about the hinge axis, to round-off"
        raise ArgumentError("pair.body2", expected, pair.body2)
    held = "free" if moves_body1 else "fixed"
    robot = Mechanism([replace(pair, name=JOINT_OF_PAIR)], base=held, name=pair.name or "pair")
    on_bodies = dict(forces)
    wrench = on_bodies.pop("force2"), on_bodies.pop("torque2")
    given: dict[str, Any] = {"gravity": gravity, **on_bodies, "loads": {JOINT_OF_PAIR: hinge_torque}}
    given["wrenches"] = {} if all(is_zero(load) for load in wrench) else {JOINT_OF_PAIR: wrench}
    given |= {"base": "moving", "base_motion": base} if moving else {"base": base, "base_motion": body1}
    return robot, given


@contextlib.contextmanager
def in_words_of_pairs(base: BaseArgument) -> Iterator[None]:
    """Tell errors of the block, about the robot that stands for a pair, in the names of the pair's arguments."""
    names = {**_NAMES, "base_motion": "base"} if callable(base) else _NAMES
    try:
        yield
    except ArgumentError as error:
        head, dot, tail = error.name.partition(".")
        name = names.get(error.name, names.get(head, head) + dot + tail)
        raise (error if name == error.name else error.renamed(name)) from None
    except SimulationError as error:
        raise SimulationError(error.t, words_of_pairs(error.why)) from None


def words_of_pairs(sentence: str) -> str:
    """Return a sentence about the robot that stands for a pair with the names that the pair's arguments have."""
    for name, of_pair in {**_NAMES, "base_motion.omega": "body1.omega"}.items():
        sentence = sentence.replace(name, of_pair) if "[" in name or "." in name else sentence
    return sentence
