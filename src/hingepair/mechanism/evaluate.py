"""The execution of a robot's computations: over NumPy arrays by the engine, or over arrays of other libraries.

This module alone allocates the outputs of a robot and runs loops.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from hingepair.engine.backend import Execution
from hingepair.engine.binding import bind
from hingepair.engine.calls import Call, Out
from hingepair.engine.loops import OperationCounts
from hingepair.engine.results import Results
from hingepair.errors import ArgumentError
from hingepair.mechanism.arguments import (
    BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME,
    RESTING_BASE_VALUE_BY_INPUT_NAME,
    ZERO_BASE_LOAD_BY_INPUT_NAME,
    InputValues,
    check_out_names,
)
from hingepair.mechanism.constants import RobotConstants, frame_numbers, split_numbers
from hingepair.mechanism.states import MechanismDerivatives
from hingepair.mechanism.tree import Frame
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.plans.derivatives import Derivative, change_shape, derivative_loop
from hingepair.plans.trees import Form, Request, estimated_operations, input_shapes, request_loop
from hingepair.rotations.matrices import MAX_ORTHOGONALITY_ERROR_BY_DTYPE_ITEMSIZE, check_rotation

MASS_INDEPENDENT_OUTPUT_NAMES = ("R", "S", "d", "v", "omega", "a", "alpha", "jacobian", "acceleration_bias")
"""Outputs that do not depend on masses."""


# Shapes of one sample of the inputs that describe the base.
_SAMPLE_SHAPE_BY_BASE_INPUT_NAME: Final = {
    **dict.fromkeys(BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME, (3,)),
    "S1": (3, 3),
    "force1": (3,),
    "torque1": (3,),
}
_MAX_DERIVED_OPERATIONS: Final = 10_000_000  # of an estimate; 2.5 million take some 5 s to compile
# Number of calls (for names, gravity and backend) that a computation keeps; at it, all of them are dropped.
_NUM_CACHED_CALLS_AT_WHICH_CACHE_IS_CLEARED: Final = 64


class RobotComputation:
    """Computation of named outputs of one robot for some frames. `run` computes them from checked arguments; the
    compiled calls that it uses are cached.

    Args:
        constants: constants of the robot.
        outputs: names out of `plans.trees.TREE_OUTPUT_BY_NAME`.
        free: whether forces move the base.
        frames: frames whose motion is computed, and frames on which wrenches act.
        loaded_frames: indices of the frames on which wrenches act.
        result: class of the result; None to return the only output as a bare array.

    Attributes:
        form: structure of the robot, on which programs depend.
        request: request of outputs and frames.
        parameters: constants that are no part of the program.
        constants: constants of the robot.
        frames: frames of the request.
        inputs: shapes of one sample of the inputs, by name.
        needs_masses: whether the outputs depend on masses.
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
        self.form: Form = constants.form
        self.request = Request(outputs, free, tuple(frame.body for frame in frames), folded, loaded_frames)
        self.parameters: Float64Array = read_only(np.array([*constants.numbers, *parameters], dtype=np.float64))
        self.constants, self.frames = constants, frames
        self.inputs = input_shapes(self.form, self.request)
        self.needs_masses = any(name not in MASS_INDEPENDENT_OUTPUT_NAMES for name in outputs)
        self.result = result
        self._calls: dict[Any, Call] = {}

    def complete(self, values: InputValues, gravity: tuple[float, ...]) -> dict[str, Any]:
        """Return a dict of the values of all inputs of the program by name. They are the checked `values`, the vector
        `gravity` [m/s^2], the robot's constants, and the values of a base at rest without loads for inputs that are
        not given.
        """
        assumed = self._assumed(gravity)
        return {
            name: values.value_by_input[name] if name in values.value_by_input else assumed[name]
            for name in self.inputs
        }

    def call(
        self,
        argument_names: tuple[str, ...],
        gravity: tuple[float, ...],
        backend: str,
        check_attitude: bool = False,
        derivative: Derivative | None = None,
    ) -> Call:
        """Return the Call for arguments with the names `argument_names`; it is made at its first use and cached.
        `gravity` [m/s^2] is a constant in it. If `check_attitude` is True, the call raises a RotationError for an S1
        that is not a rotation. With a `derivative`, the call computes that, and takes its weights or changes too.
        """
        key = argument_names, gravity, backend, check_attitude, derivative
        call = self._calls.get(key)
        if call is None:
            backend = backend if self.form.dof else "numpy"  # machine code needs arrays that are not empty
            has_check = check_attitude and "S1" in argument_names
            check = {"attitude_check": MAX_ORTHOGONALITY_ERROR_BY_DTYPE_ITEMSIZE} if has_check else {}
            request = self.request._replace(outputs=(*self.request.outputs, *check))
            if derivative is None:
                loop = request_loop(self.form, request)
            else:
                loop = derivative_loop(self.form, request, derivative)
            result = MechanismDerivatives if derivative else self.result
            assumed = self._assumed(gravity)
            constants = {name: assumed[name] for name, _ in loop.inputs if name not in argument_names}
            shapes = {name: _SAMPLE_SHAPE_BY_BASE_INPUT_NAME.get(name, (self.form.dof,)) for name in argument_names}
            shapes |= {name: tail for name, tail in loop.inputs if name in argument_names}
            call = Call(
                loop, shapes, constants, result, backend=backend, constants_name="robot",
                limits=check, on_limit=lambda values: check_rotation("S1", np.asarray(values["S1"])),
            )  # fmt: skip
            if len(self._calls) >= _NUM_CACHED_CALLS_AT_WHICH_CACHE_IS_CLEARED:
                self._calls.clear()
            self._calls[key] = call
        return call

    def check_differentiable(self, derivative: Derivative) -> None:
        """Refuse a derivative whose program would take too long to make.

        Raises:
            ArgumentError: the robot has too many joints.
        """
        shapes = [math.prod(change_shape(*argument)) for argument in derivative.arguments]
        columns = sum(shapes) if derivative.kind == "jacobian" else 1
        untraced = not request_loop(self.form, self.request).traced
        if untraced or columns * estimated_operations(self.form, self.request) > _MAX_DERIVED_OPERATIONS:
            by = ", ".join(name for name, _ in derivative.arguments)
            got = f"{self.form.dof} joints, derivatives by {by}"
            raise ArgumentError("robot", "fewer joints, or derivatives by fewer arguments", got)

    def run(
        self,
        values: InputValues,
        gravity: tuple[float, ...],
        out: Out,
        execution: Execution,
        check_attitude: bool = False,
        derivative: Derivative | None = None,
    ) -> Any:
        """Compute the outputs for checked argument values at all samples. Return an object of the class
        `self.result`, or, if this class is None, the only output as a bare array. Write into the arrays of `out`,
        None or a dict by output name. Raise an ArgumentError if `out` or a shape cannot be used or, if
        `check_attitude` is True, if S1 is not a rotation. `execution` holds the backend and the number of threads.
        With a `derivative`, compute its arrays instead, as MechanismDerivatives.

        Raises:
            ArgumentError: the arguments do not broadcast, or `out` cannot be used.
        """
        call = self.call(tuple(values.value_by_input), gravity, execution.backend, check_attitude, derivative)
        check_out_names(out, call.outputs)
        if values.library is not None:
            return call.run_foreign(
                values.value_by_input, values.shape_by_argument, values.library, out, execution.workers
            )
        return call.run(
            values.value_by_input, values.shape_by_argument, out, execution.workers, labels=values.label_by_input
        )

    def _assumed(self, gravity: tuple[float, ...]) -> dict[str, Any]:
        """Return the values of the inputs that a call may leave out, by name."""
        loads, constants = ZERO_BASE_LOAD_BY_INPUT_NAME, {"gravity": gravity, "constants": self.parameters}
        return {**RESTING_BASE_VALUE_BY_INPUT_NAME, **loads, **constants}

    def count_operations(self, values: Mapping[str, Any], gravity: tuple[float, ...]) -> OperationCounts:
        """Count the operations of the program for these arguments, and of the program that folds no input; return
        both as OperationCounts. A number among the `values`, by input name, is a known value, an array is not.
        """
        loop = request_loop(self.form, self.request)
        sample_arrays = {name: np.empty((2, *tail)) for name, tail in loop.inputs}
        full = loop.program(bind(loop.inputs, sample_arrays).pattern)
        inputs = {**self._assumed(gravity), **values}
        bound = bind(loop.inputs, {name: inputs[name] for name, _ in loop.inputs})
        return loop.program(bound.pattern).count_operations(full)
