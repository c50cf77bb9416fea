"""Running a request for a robot: over NumPy arrays by the engine, or over arrays of other libraries.

Everything of this wing that allocates outputs and runs loops stands here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from hingepair.engine.backend import Execution
from hingepair.engine.binding import bind
from hingepair.engine.calls import Call, Out
from hingepair.engine.loops import OperationCounts
from hingepair.engine.results import Results
from hingepair.errors import ArgumentError
from hingepair.mechanism.arguments import AT_REST, LETTERS, NO_LOADS, Values, read_out
from hingepair.mechanism.constants import Constants, frame_numbers, known_and_parameters
from hingepair.mechanism.tree import Frame
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.plans.trees import Form, Request, inputs_of, loop_of
from hingepair.rotations.matrices import TOLERANCE, check_rotation

WEIGHTLESS = ("R", "S", "d", "v", "omega", "a", "alpha", "jacobian", "acceleration_bias")
"""The outputs that masses have no part in."""


_TAILS: Final = {**dict.fromkeys(LETTERS, (3,)), "S1": (3, 3), "force1": (3,), "torque1": (3,)}
_ROTATION_LIMITS: Final = {size: 2 * tolerance for size, tolerance in TOLERANCE.items()}
_MAX_CALLS: Final = 64  # kept of one problem: of names, gravity and backend


class Problem:
    """A request to one robot, with the constants that it takes.

    Args:
        constants: of the robot.
        outputs: names out of `plans.trees.OUTPUTS`.
        free: whether the base moves as forces have it.
        frames: whose motion is computed, and those that wrenches act on.
        loaded: places among the frames of the latter.
        result: the class of what is returned; None where the one output is returned itself.

    Attributes:
        form: the robot's build.
        request: what is computed.
        parameters: the constants that are no part of the program.
        bounds: how far each of them may be from the exact number.
        inputs: shapes of one sample of the inputs, by name.
        weighs: whether masses have a part in it.
    """

    def __init__(
        self,
        constants: Constants,
        outputs: tuple[str, ...],
        free: bool,
        frames: tuple[Frame, ...],
        loaded: tuple[int, ...],
        result: type[Results] | None,
    ) -> None:
        numbers = [number for frame in frames for number in frame_numbers(constants, frame)]
        known, parameters = known_and_parameters(numbers)
        self.form: Form = constants.form
        self.request = Request(outputs, free, tuple(frame.body for frame in frames), known, loaded)
        self.parameters: Float64Array = read_only(np.array([*constants.numbers, *parameters], dtype=np.float64))
        self.bounds: Float64Array = read_only(np.array([*constants.bounds, *(0.0 for _ in parameters)]))
        self.inputs = inputs_of(self.form, self.request)
        self.weighs = any(name not in WEIGHTLESS for name in outputs)
        self.result = result
        self._calls: dict[Any, Call] = {}

    def complete(self, values: Values, gravity: tuple[float, ...]) -> dict[str, Any]:
        """Return all inputs: a base that is not said to move rests, and what is not said to act does not."""
        assumed = {**AT_REST, **NO_LOADS, "gravity": gravity, "constants": self.parameters}
        return {name: values.parts[name] if name in values.parts else assumed[name] for name in self.inputs}

    def call(self, given: tuple[str, ...], gravity: tuple[float, ...], backend: str, checked: bool = False) -> Call:
        """Return the call for arguments of these names, made once; where `checked`, it refuses an S1 that is none."""
        key = given, gravity, backend, checked
        found = self._calls.get(key)
        if found is None:
            backend = backend if self.form.dof else "numpy"  # machine code reads and writes arrays that have numbers
            check = {"attitude_check": _ROTATION_LIMITS} if checked and "S1" in given else {}
            loop = loop_of(self.form, self.request._replace(outputs=(*self.request.outputs, *check)))
            assumed = {**AT_REST, **NO_LOADS, "gravity": gravity, "constants": self.parameters}
            constants = {name: assumed[name] for name, _ in loop.inputs if name not in given}
            shapes = {name: _TAILS.get(name, (self.form.dof,)) for name in given}
            shapes |= {name: tail for name, tail in loop.inputs if name in given}
            found = Call(
                loop, shapes, constants, self.result, backend=backend, constants_name="robot",
                limits=check, on_limit=lambda values: check_rotation("S1", np.asarray(values["S1"])),
            )  # fmt: skip
            if len(self._calls) >= _MAX_CALLS:
                self._calls.clear()
            self._calls[key] = found
        return found

    def run(
        self, values: Values, gravity: tuple[float, ...], out: Out, execution: Execution, checked: bool = False
    ) -> Any:
        """Return the outputs at all samples; arguments are those of `call`.

        Raises:
            ArgumentError: the arguments do not broadcast, or `out` cannot be used.
        """
        read_out(out, self.request.outputs)
        call = self.call(tuple(values.parts), gravity, execution.backend, checked)
        if values.library is not None:
            return call.run_foreign(values.parts, values.shapes, values.library, out, execution.workers)
        try:
            return call.run(values.parts, values.shapes, out, execution.workers)
        except ArgumentError as error:
            if self.result is not None or error.name != f"out[{call.outputs[0]!r}]":
                raise
            raise type(error)("out", error.expected, error.got) from None  # the one array is what users call out

    def count_operations(self, given: Mapping[str, Any] | None = None) -> OperationCounts:
        """Return how many operations are left of a program for arrays of samples, of those with nothing known.

        Args:
            given: arguments by input name, of which numbers are known; arrays of samples unless given.
        """
        loop = loop_of(self.form, self.request)
        many = {name: np.empty((2, *tail)) for name, tail in loop.inputs}
        full = loop.program(bind(loop.inputs, many).pattern)
        known = {
            **many,
            **{name: value for name, value in AT_REST.items() if name in many},
            "constants": self.parameters,
            **{name: value for name, value in (given or {}).items() if name in many},
        }
        return loop.program(bind(loop.inputs, known).pattern).count_operations(full)
