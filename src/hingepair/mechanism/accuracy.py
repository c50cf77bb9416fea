"""Bounds on the rounding errors of what a robot's methods give: the recursions over numbers that carry a bound."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hingepair.mechanism.arguments import Values
from hingepair.mechanism.evaluate import Problem
from hingepair.numeric.array_libraries import is_foreign
from hingepair.numeric.arrays import Float64Array, broadcast_shape, result_dtype
from hingepair.numeric.blocks import Named, components_of, tabulate
from hingepair.numeric.bounded import Bounded, kind_of
from hingepair.plans.trees import compute

_BY_FRAME = ("R", "S", "d", "v", "omega", "a", "alpha")


def error_bounds(problem: Problem, values: Values, gravity: tuple[float, ...]) -> dict[str, Float64Array]:
    """Return the bound of each output at every sample; of motion one for each frame."""
    form, request = problem.form, problem.request
    complete = problem.complete(values, gravity)
    given = [c for name in values.parts for c in _group(values.parts[name])]
    kind = kind_of(result_dtype(given))
    frames = len(request.frames)

    def bounds(numbers: Named) -> Mapping[str, Any]:
        known = {name: tuple(kind.rounded(c) for c in group) for name, group in numbers.items()}
        pairs = zip(problem.parameters.tolist(), problem.bounds.tolist(), strict=True)
        known["constants"] = tuple(kind.rounded(number, bound) for number, bound in pairs)
        found = compute(form, request, known)
        return {name: _largest(found[name], frames if name in _BY_FRAME else 0) for name in request.outputs}

    groups = {name: _components(complete[name], tail) for name, tail in problem.inputs.items() if name != "constants"}
    tails = {name: (frames,) if name in _BY_FRAME else () for name in request.outputs}
    return tabulate(bounds, groups, tails, broadcast_shape(values.shapes), np.dtype(np.float64))


def _group(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _components(value: Any, tail: tuple[int, ...]) -> tuple[Any, ...]:
    """Return the components of an input, numbers or arrays of NumPy."""
    if isinstance(value, tuple):
        return tuple(np.asarray(c) if is_foreign(c) else c for c in value)
    array = np.asarray(value)
    if array.ndim == len(tail):
        return tuple(array.ravel().tolist()) if array.dtype.char == "d" else tuple(array.ravel())
    flat = array.reshape(*array.shape[: array.ndim - len(tail)], math.prod(tail))
    return components_of(flat)


def _largest(group: Any, frames: int) -> Any:
    """Return the largest bound of some components, of each frame by itself where there are frames."""
    errors = [c.error if isinstance(c, Bounded) else 0.0 for c in _group(group)]
    if not frames:
        return functools.reduce(np.maximum, errors, 0.0)
    each = len(errors) // frames
    return tuple(functools.reduce(np.maximum, errors[k * each : (k + 1) * each]) for k in range(frames))
