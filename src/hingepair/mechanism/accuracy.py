"""Bounds on the rounding errors of a robot's results: the recursions run over numbers that carry an error bound."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from hingepair.mechanism.computations import RobotComputation
from hingepair.mechanism.constants import frame_numbers, number_bounds, program_numbers
from hingepair.numeric.arrays import Float64Array, broadcast_shape, result_dtype
from hingepair.numeric.blocks import Named, components_of, tabulate
from hingepair.numeric.bounded import Bounded, bounded_class, conversion_error
from hingepair.plans.arguments import Arguments
from hingepair.plans.trees import FRAME_OUTPUTS, compute_request

_DOUBLE = np.dtype(np.float64)  # of all bounds


class _BoundedProgram:
    """Program of a robot's outputs, run with numbers that carry error bounds, in the precision of the arguments."""

    def __init__(self, computation: RobotComputation, values: Arguments) -> None:
        computation.constants.tree.plain()
        components = [c for name in values.values for c in _as_tuple(values.values[name])]
        self._kind = bounded_class(result_dtype(components))
        constants, frames = computation.constants, computation.frames
        numbers = program_numbers(constants)
        numbers += [number for frame in frames for number in frame_numbers(constants, frame)]
        pairs = [*zip(numbers, number_bounds(constants, frames), strict=True)]
        # Only an exact number folds: in a program, one may be 0 that would be 1e-17.
        known = tuple(number if bound == 0 and number in {0.0, 1.0, -1.0} else None for number, bound in pairs)
        count = len(computation.form.known)
        self._form = computation.form._replace(known=known[:count])
        self._request = computation.request._replace(known=known[count:])
        self._constants = tuple(
            self._kind.rounded(*pair) for pair, folded in zip(pairs, known, strict=True) if folded is None
        )

    def run(self, block: Named, names: Iterable[str]) -> dict[str, Any]:
        """Return the bounded outputs for a block of the inputs `names`, as `_with_conversion_errors` returns them."""
        inputs: dict[str, Any] = {
            name: tuple(map(self._kind.rounded, block[name], block[f"{name} error"])) for name in names
        }
        return compute_request(self._form, self._request, inputs | {"constants": self._constants})


def error_bounds(
    computation: RobotComputation, values: Arguments, gravity: tuple[float, ...]
) -> dict[str, Float64Array]:
    """Return by output the largest bound on the errors of its components: (...), of frames' motion (..., frames)."""
    names, frame_count = computation.request.outputs, len(computation.frames)
    program = _BoundedProgram(computation, values)
    groups = _input_groups(computation, computation.complete(values, gravity))

    def block_bounds(block: Named) -> Mapping[str, Any]:
        results = program.run(block, groups)
        return {name: _largest_bounds(results[name], frame_count if name in FRAME_OUTPUTS else 0) for name in names}

    shapes = {name: (frame_count,) if name in FRAME_OUTPUTS else () for name in names}
    samples = broadcast_shape(values.shapes)
    return tabulate(block_bounds, _with_conversion_errors(groups), shapes, samples, _DOUBLE)


def _input_groups(computation: RobotComputation, values: Mapping[str, Any]) -> dict[str, tuple[Any, ...]]:
    """Return the inputs of a computation that `values` has, each as a tuple of components; without the constants."""
    return {
        name: _input_components(values[name], sample_shape)
        for name, sample_shape in computation.inputs.items()
        if name in values and name != "constants"
    }


def _with_conversion_errors(groups: Mapping[str, tuple[Any, ...]]) -> Named:
    """Return the groups and, by "NAME error", what converting each component to float64 changes."""
    return {**groups, **{f"{name} error": tuple(map(conversion_error, group)) for name, group in groups.items()}}


def _as_tuple(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _input_components(value: Any, sample_shape: tuple[int, ...]) -> tuple[Any, ...]:
    """Return the components of an array of samples, or of a tuple, as numbers or arrays."""
    if isinstance(value, tuple):
        return value
    array = np.asarray(value)
    if array.ndim == len(sample_shape):
        return tuple(array.ravel().tolist()) if array.dtype.char == "d" else tuple(array.ravel())
    flat = array.reshape(*array.shape[: array.ndim - len(sample_shape)], math.prod(sample_shape))
    return components_of(flat)


def _largest_bounds(components: Any, frame_count: int) -> Any:
    """Return the largest bound of components, or one for each of `frame_count` frames; plain numbers are exact."""
    errors = [c.error if isinstance(c, Bounded) else 0.0 for c in _as_tuple(components)]
    if not frame_count:
        return functools.reduce(np.maximum, errors, 0.0)
    count = len(errors) // frame_count
    return tuple(functools.reduce(np.maximum, errors[k * count : (k + 1) * count]) for k in range(frame_count))
