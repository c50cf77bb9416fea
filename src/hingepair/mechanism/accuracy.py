"""Bounds on the rounding errors of a robot's results: the recursions run over numbers that carry an error bound."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hingepair.mechanism.arguments import InputValues
from hingepair.mechanism.evaluate import RobotComputation
from hingepair.numeric.array_libraries import is_foreign
from hingepair.numeric.arrays import Float64Array, broadcast_shape, result_dtype
from hingepair.numeric.blocks import Named, components_of, tabulate
from hingepair.numeric.bounded import Bounded, kind_of
from hingepair.plans.trees import compute_request

_FRAME_OUTPUTS = ("R", "S", "d", "v", "omega", "a", "alpha")  # which have a bound for each frame


def error_bounds(
    computation: RobotComputation, values: InputValues, gravity: tuple[float, ...]
) -> dict[str, Float64Array]:
    """Return the bound on each output's rounding error at every sample; for motion, one bound for each frame."""
    form, request = computation.form, computation.request
    complete = computation.complete(values, gravity)
    components = [c for name in values.parts for c in _as_tuple(values.parts[name])]
    kind = kind_of(result_dtype(components))
    frames = len(request.frames)

    def bounds(numbers: Named) -> Mapping[str, Any]:
        """Return the bounds of all outputs for the inputs of one block of samples."""
        known = {name: tuple(kind.rounded(c) for c in group) for name, group in numbers.items()}
        pairs = zip(computation.parameters.tolist(), computation.bounds.tolist(), strict=True)
        known["constants"] = tuple(kind.rounded(number, bound) for number, bound in pairs)
        results = compute_request(form, request, known)
        return {
            name: _largest_bounds(results[name], frames if name in _FRAME_OUTPUTS else 0) for name in request.outputs
        }

    groups = {
        name: _input_components(complete[name], tail)
        for name, tail in computation.inputs.items()
        if name != "constants"
    }
    tails = {name: (frames,) if name in _FRAME_OUTPUTS else () for name in request.outputs}
    return tabulate(bounds, groups, tails, broadcast_shape(values.shapes), np.dtype(np.float64))


def _as_tuple(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _input_components(value: Any, tail: tuple[int, ...]) -> tuple[Any, ...]:
    """Return the components of an input as numbers or NumPy arrays."""
    if isinstance(value, tuple):
        return tuple(np.asarray(c) if is_foreign(c) else c for c in value)
    array = np.asarray(value)
    if array.ndim == len(tail):
        return tuple(array.ravel().tolist()) if array.dtype.char == "d" else tuple(array.ravel())
    flat = array.reshape(*array.shape[: array.ndim - len(tail)], math.prod(tail))
    return components_of(flat)


def _largest_bounds(group: Any, frames: int) -> Any:
    """Return the largest error bound of some components; for motion, the largest bound of each frame."""
    errors = [c.error if isinstance(c, Bounded) else 0.0 for c in _as_tuple(group)]
    if not frames:
        return functools.reduce(np.maximum, errors, 0.0)
    each = len(errors) // frames
    return tuple(functools.reduce(np.maximum, errors[k * each : (k + 1) * each]) for k in range(frames))
