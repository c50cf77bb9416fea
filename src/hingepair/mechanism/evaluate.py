"""The computations of a robot."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from hingepair.engine.loops import Loop
from hingepair.engine.results import Results
from hingepair.mechanism.arguments import (
    BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME,
    RESTING_BASE_VALUE_BY_INPUT_NAME,
    ZERO_BASE_LOAD_BY_INPUT_NAME,
)
from hingepair.mechanism.constants import RobotConstants, frame_numbers, robot_constants, split_numbers
from hingepair.mechanism.states import MechanismDerivatives
from hingepair.mechanism.tree import Frame
from hingepair.numeric.arrays import read_only
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.plans.arguments import Arguments, CoordinateNames
from hingepair.plans.computation import Computation
from hingepair.plans.derivatives import body_constants
from hingepair.plans.trees import Request, estimated_operations, input_shapes, request_loop

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
    """

    def __init__(
        self,
        constants: RobotConstants,
        outputs: tuple[str, ...],
        free: bool,
        frames: tuple[Frame, ...],
        loaded_frames: tuple[int, ...],
        result: type[Results] | None,
    ) -> None:
        numbers = [number for frame in frames for number in frame_numbers(constants, frame)]
        folded, parameters = split_numbers(numbers)
        self.constants, self.frames, self.form = constants, frames, constants.form
        self.request = Request(outputs, free, tuple(frame.body for frame in frames), folded, loaded_frames)
        self.inputs = input_shapes(self.form, self.request)
        self.asked: tuple[Any, ...] = ()  # by which `Mechanism._computation_of` makes it anew
        self.needs_masses = any(name not in MASS_INDEPENDENT_OUTPUT_NAMES for name in outputs)
        known = {
            **RESTING_BASE_VALUE_BY_INPUT_NAME,
            **ZERO_BASE_LOAD_BY_INPUT_NAME,
            "constants": read_only(np.array([*constants.numbers, *parameters], dtype=np.float64)),
            "axes": np.array(constants.axes).ravel(),
        }
        super().__init__(
            self._request_loop, outputs,
            {**_BASE_SHAPES, **dict.fromkeys(("q", "qd", "qdd", "tau"), (self.form.dof,)), **self.inputs},
            known, result, CoordinateNames(constants.names, noun="joints"), derivatives=MechanismDerivatives,
            owner="robot", operations=estimated_operations(self.form, self.request),
            constant_shapes=body_constants(len(self.form.parents), free),
        )  # fmt: skip

    @lock_free_cached_property
    def by_constants(self) -> RobotComputation:
        """The same outputs from constants in which each body keeps its own masses, and can change them."""
        constants = robot_constants(self.constants.tree, self.constants.free, whole=True)
        request = self.request
        return RobotComputation(constants, self.outputs, request.free, self.frames, request.loaded, self.result)

    def _request_loop(self, outputs: tuple[str, ...], _: tuple[str, ...]) -> Loop:
        return request_loop(self.form, self.request._replace(outputs=outputs))

    def complete(self, arguments: Arguments, gravity: tuple[float, ...]) -> dict[str, Any]:
        """Return the values of all inputs of the program, given or known."""
        values = {**self.known, "gravity": gravity, **arguments.values}
        return {name: values[name] for name in self.inputs}
