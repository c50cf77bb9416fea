"""Bounds on the rounding errors of a robot's results: the recursions run over numbers that carry an error bound."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hingepair.mechanism.arguments import InputValues
from hingepair.mechanism.constants import frame_numbers, number_bounds, program_numbers
from hingepair.mechanism.evaluate import RobotComputation
from hingepair.mechanism.states import FRAME_MOTION_OUTPUT_NAMES
from hingepair.numeric.array_libraries import is_foreign
from hingepair.numeric.arrays import Float64Array, broadcast_shape, result_dtype
from hingepair.numeric.blocks import Named, components_of, tabulate
from hingepair.numeric.bounded import Bounded, bounded_class, conversion_error
from hingepair.plans.trees import compute_request


def error_bounds(
    computation: RobotComputation, values: InputValues, gravity: tuple[float, ...]
) -> dict[str, Float64Array]:
    """Compute bounds on the rounding errors of the outputs of a RobotComputation for the InputValues `values` and a
    gravity vector [m/s^2], and return a dict of arrays by output name. At every sample, an output has one bound for
    its largest component; an output of motion has one such bound for each frame, along the last axis.
    """
    form, request, constants = computation.form, computation.request, computation.constants
    complete = computation.complete(values, gravity)
    components = [c for name in values.value_by_input for c in _as_tuple(values.value_by_input[name])]
    kind = bounded_class(result_dtype(components))
    frame_count = len(request.frames)
    numbers = program_numbers(constants)
    numbers += [number for frame in computation.frames for number in frame_numbers(constants, frame)]
    pairs = [*zip(numbers, number_bounds(constants, computation.frames), strict=True)]
    # Only an exact number folds: in a program, one may be 0 that would be 1e-17.
    known = tuple(number if bound == 0 and number in {0.0, 1.0, -1.0} else None for number, bound in pairs)
    form, request = form._replace(known=known[: len(form.known)]), request._replace(known=known[len(form.known) :])
    parameters = [kind.rounded(*pair) for pair, folded in zip(pairs, known, strict=True) if folded is None]

    def block_bounds(block_inputs: Named) -> Mapping[str, Any]:
        """Return a dict of the error bounds of all outputs by name, for one block of samples. `block_inputs` is a
        dict of tuples of components by input name.
        """
        bounded_inputs: dict[str, Any] = {
            name: tuple(map(kind.rounded, block_inputs[name], block_inputs[f"{name} error"])) for name in groups
        }
        bounded_inputs["constants"] = tuple(parameters)
        results = compute_request(form, request, bounded_inputs)
        return {
            name: _largest_bounds(results[name], frame_count if name in FRAME_MOTION_OUTPUT_NAMES else 0)
            for name in request.outputs
        }

    groups = {
        name: _input_components(complete[name], sample_shape)
        for name, sample_shape in computation.inputs.items()
        if name != "constants"
    }
    errors = {f"{name} error": tuple(map(conversion_error, group)) for name, group in groups.items()}
    bound_shapes = {name: (frame_count,) if name in FRAME_MOTION_OUTPUT_NAMES else () for name in request.outputs}
    return tabulate(
        block_bounds, groups | errors, bound_shapes, broadcast_shape(values.shape_by_argument), np.dtype(np.float64)
    )


def _as_tuple(value: Any) -> tuple[Any, ...]:
    """Return a tuple as it is, and any other value as a tuple that holds it."""
    return value if isinstance(value, tuple) else (value,)


def _input_components(value: Any, sample_shape: tuple[int, ...]) -> tuple[Any, ...]:
    """Return the components of an input as a tuple of numbers or NumPy arrays. `value` is an array of samples, each
    with the shape `sample_shape`, or a tuple of components, which may be arrays of other libraries.
    """
    if isinstance(value, tuple):
        return tuple(np.asarray(c) if is_foreign(c) else c for c in value)
    array = np.asarray(value)
    if array.ndim == len(sample_shape):
        return tuple(array.ravel().tolist()) if array.dtype.char == "d" else tuple(array.ravel())
    flat = array.reshape(*array.shape[: array.ndim - len(sample_shape)], math.prod(sample_shape))
    return components_of(flat)


def _largest_bounds(components: Any, frame_count: int) -> Any:
    """Return the largest error bound of an output's components, a number or an array with one element for each
    sample; components without a bound count as exact. If `frame_count` is not 0, return a tuple with the largest
    bound of each frame; the components of a frame are consecutive.
    """
    errors = [c.error if isinstance(c, Bounded) else 0.0 for c in _as_tuple(components)]
    if not frame_count:
        return functools.reduce(np.maximum, errors, 0.0)
    count = len(errors) // frame_count
    return tuple(functools.reduce(np.maximum, errors[k * count : (k + 1) * count]) for k in range(frame_count))
