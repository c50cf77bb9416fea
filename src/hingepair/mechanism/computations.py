"""What is computed of robots, and the arguments that only robots have: the motion of the base, wrenches on links."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np

from hingepair.engine.loops import Loop
from hingepair.engine.results import Results
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism.constants import (
    RobotConstants,
    frame_numbers,
    load_numbers,
    robot_constants,
    split_numbers,
)
from hingepair.mechanism.states import MechanismDerivatives
from hingepair.mechanism.tree import Frame
from hingepair.numeric.arrays import read_only
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.pair.body_motion import BodyMotion, motion_inputs
from hingepair.plans.arguments import Arguments, CoordinateNames, read_arguments
from hingepair.plans.computation import Computation
from hingepair.plans.derivatives import body_constants
from hingepair.plans.trees import Request, estimated_operations, input_shapes, request_loop

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
    which is empty for None. The forces and torques are not checked.

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


MASS_INDEPENDENT_OUTPUT_NAMES = (
    "R",
    "S",
    "d",
    "v",
    "omega",
    "a",
    "alpha",
    "jacobian",
    "jacobian_in_frame",
    "acceleration_bias",
    "torque_regressor",
)
"""Outputs that do not depend on masses."""

_BASE_SHAPES: Final = {
    **dict.fromkeys((*BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME, *ZERO_BASE_LOAD_BY_INPUT_NAME), (3,)),
    "S1": (3, 3),
}


class RobotComputation(Computation):
    """Outputs of a robot and of its frames.

    Args:
        constants: constants of the robot.
        outputs: names out of `plans.trees.TREE_OUTPUT_BY_NAME`.
        free: whether forces move the base.
        frames: frames whose motion is computed, and frames on which wrenches act.
        loaded_frames: indices of the frames on which wrenches act.
        result: class of the result; None to return the only output as a bare array.
        joint_loads: whether springs, dampers and dry friction act at the joints.
    """

    def __init__(
        self,
        constants: RobotConstants,
        outputs: tuple[str, ...],
        free: bool,
        frames: tuple[Frame, ...],
        loaded_frames: tuple[int, ...],
        result: type[Results] | None,
        joint_loads: bool = False,
    ) -> None:
        numbers = [number for frame in frames for number in frame_numbers(constants, frame)]
        if joint_loads:
            numbers += load_numbers(constants.tree)
        folded, parameters = split_numbers(numbers)
        self.constants, self.frames, self.form = constants, frames, constants.form
        self.needs_masses = any(name not in MASS_INDEPENDENT_OUTPUT_NAMES for name in outputs)
        samples = constants.tree.samples
        has_samples = samples is not None and bool(constants.varied) and (self.needs_masses or bool(samples.points))
        bodies = tuple(frame.body for frame in frames)
        self.request = Request(
            outputs, free, bodies, folded, loaded_frames, joint_loads, constants.varied if has_samples else ()
        )
        self.inputs = input_shapes(self.form, self.request)
        self.asked: tuple[Any, ...] = ()  # by which `Mechanism._computation_of` makes it anew
        known: dict[str, Any] = {
            **RESTING_BASE_VALUE_BY_INPUT_NAME,
            **ZERO_BASE_LOAD_BY_INPUT_NAME,
            "constants": read_only(np.array([*constants.numbers, *parameters], dtype=np.float64)),
            "axes": np.array(constants.axes).ravel(),
        }
        if has_samples:
            known["samples"] = constants.samples
        super().__init__(
            self._request_loop, outputs,
            {**_BASE_SHAPES, **dict.fromkeys(("q", "qd", "qdd", "tau"), (self.form.dof,)), **self.inputs},
            known, result, CoordinateNames(constants.names, noun="joints"), derivatives=MechanismDerivatives,
            owner="robot", shape=constants.sample_shape if has_samples else (),
            operations=estimated_operations(self.form, self.request),
            constant_shapes=body_constants(len(self.form.parents), free),
        )  # fmt: skip

    @lock_free_cached_property
    def by_constants(self) -> RobotComputation:
        """The same outputs from constants in which each body keeps its own masses, and can change them."""
        constants = robot_constants(self.constants.tree, self.constants.free, whole=True)
        request = self.request
        return RobotComputation(
            constants, self.outputs, request.free, self.frames, request.loaded, self.result, request.joint_loads
        )

    def _request_loop(self, outputs: tuple[str, ...], _: tuple[str, ...]) -> Loop:
        return request_loop(self.form, self.request._replace(outputs=outputs))

    def complete(self, arguments: Arguments, gravity: tuple[float, ...]) -> dict[str, Any]:
        """Return the values of all inputs of the program, given or known."""
        values = {**self.known, "gravity": gravity, **arguments.values}
        return {name: values[name] for name in self.inputs}


ARGUMENT_NAMES_BY_PREPARED_COMPUTATION_NAME: Final = {
    "pose": ("q",),
    "velocity": ("q", "qd"),
    "acceleration": ("q", "qd", "qdd"),
    "jacobian": ("q",),
    "jacobian_in_frame": ("q",),
    "acceleration_bias": ("q", "qd"),
    "inverse_dynamics": ("q", "qd", "qdd"),
    "joint_wrenches": ("q", "qd", "qdd"),
    "torque_regressor": ("q", "qd", "qdd"),
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
    a tuple of the names of the call's arguments.

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
