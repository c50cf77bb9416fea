"""Bounds on the rounding errors of a robot's results."""

from __future__ import annotations

import functools

from hingepair.mechanism.robots.computations import RobotComputation
from hingepair.mechanism.robots.constants import frame_numbers, number_bounds, program_numbers
from hingepair.numeric.arrays import Float64Array
from hingepair.plans.arguments import Arguments
from hingepair.plans.bounds import Known, output_bounds
from hingepair.plans.trees import FRAME_OUTPUTS, compute_request


def error_bounds(
    computation: RobotComputation, values: Arguments, gravity: tuple[float, ...]
) -> dict[str, Float64Array]:
    """Return by output the largest bound on the errors of its components: (...), of frames' motion (..., frames)."""
    constants, frames, request = computation.constants, computation.frames, computation.request
    constants.tree.plain()
    numbers = [*program_numbers(constants), *(x for frame in frames for x in frame_numbers(constants, frame))]
    errors = [float(error) for error in number_bounds(constants, frames)]
    # Which constants fold is said by their errors here: one that is 0 may be 1e-17 in the exact robot.
    form = computation.form._replace(known=(None,) * len(computation.form.known))
    program = functools.partial(compute_request, form, request._replace(known=(None,) * len(request.known)))
    known = {**computation.known, "gravity": gravity, "constants": Known(tuple(numbers), tuple(errors))}
    shown = 0 if request.single else len(request.shown_frames)
    parts = {name: shown if name in FRAME_OUTPUTS else 0 for name in request.outputs}
    return output_bounds(program, values, computation.inputs, known, parts)
