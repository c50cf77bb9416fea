"""The NumPy backend: a function of components, run over the samples in blocks that fit the cache."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric import array_libraries
from hingepair.numeric.arrays import Block, Component, broadcast_shape, load, split_into_blocks

Components: TypeAlias = tuple[Component, ...]
Named: TypeAlias = dict[str, Any]  # by name: a component, or the tuple of components of a vector or matrix

MIN_COSINE_TO_COMPUTE_VERSINE_FROM_SINE = 0.7
"""Where the cosine of a turn is above this, 1 - cos is taken from the sine."""

SAMPLES_PER_BLOCK = 4096
"""Samples a block: 32 kB a component, so that what a block computes on the way stays in the cache."""


def components_of(array: NDArray[Any], rank: int = 1) -> Components:
    """Return a tuple of views of the components of an array whose last axes are vectors (rank 1) or matrices (rank 2,
    components row by row); of scalars (rank 0), the array itself.
    """
    if rank == 0:
        return (array,)
    if rank == 2:
        rows, columns = array.shape[-2:]
        return tuple(array[..., i, j] for i in range(rows) for j in range(columns))
    return tuple(array[..., i] for i in range(array.shape[-1]))


def numbers(array: NDArray[Any], rank: int = 1) -> Components:
    """Return the components of a single vector (rank 1) or matrix (rank 2, row by row) as a tuple of Python floats.
    For an array of several, return the result of `components_of`, a tuple of arrays.
    """
    return tuple(array.ravel().tolist()) if array.ndim == rank else components_of(array, rank)


def tabulate(
    function: Callable[[Named], Mapping[str, Any]],
    inputs: Named,
    sample_shapes: Mapping[str, tuple[int, ...]],
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
) -> dict[str, NDArray[Any]]:
    """Evaluate a function for all samples, block by block, and return its results as a dict of new arrays by name,
    each of shape (*shape, *sample_shape). `function` takes a dict by name of the inputs, and returns a mapping by
    name of the results; each is a component or a tuple of components. `sample_shapes` maps each result's name to the
    shape of one sample of it; `shape` is the shape of the samples.

    A component of one element reaches the function as a number, so that what depends on such components alone costs
    nothing per sample, and a single sample needs no array at all.
    """
    out = {name: np.empty((*shape, *sample_shape), dtype) for name, sample_shape in sample_shapes.items()}
    targets = [view for array in out.values() for view in components_of(array, array.ndim - len(shape))]
    values = {name: _map_components(group, lambda c: _number_or_array(c, dtype)) for name, group in inputs.items()}
    moving = {name: group for name, group in values.items() if _holds_array(group)}

    def results(*loaded: Component) -> list[Component]:
        """Return the components of all results for those of the inputs that vary."""
        rest = iter(loaded)
        parts = {name: _map_components(group, lambda _: next(rest)) for name, group in moving.items()}
        found = function({**values, **parts})
        return [component for name in out for component in components(found[name])]

    blocks = split_into_blocks(shape, SAMPLES_PER_BLOCK) if moving else [()]
    fill_blocks(results, [c for group in moving.values() for c in components(group)], targets, dtype, blocks)
    return out


def fill_blocks(
    function: Callable[..., Iterable[Any]],
    inputs: Sequence[Component],
    targets: Sequence[NDArray[Any]],
    dtype: np.dtype[Any],
    blocks: Iterable[Block],
) -> None:
    """Evaluate a function of components for blocks of samples, one after the other, and write its results into
    `targets`, one array for each. A NaN stays in its sample in silence.
    """
    with np.errstate(all="ignore"):
        for block in blocks:
            results = function(*(load(component, block, dtype) for component in inputs))
            for target, result in zip(targets, results, strict=True):
                target[block] = result


def tabulate_one(
    function: Callable[[Named], Any], inputs: Named, sample_shape: tuple[int, ...], dtype: np.dtype[Any]
) -> NDArray[Any]:
    """Evaluate a function for all samples and return its only result as a new array, of shape (..., *sample_shape).
    `function` takes a dict of the components of the inputs by name and returns a component or a tuple of them. Raise
    ShapeError if the inputs do not broadcast.

    Raises:
        ShapeError: the inputs do not broadcast.
    """
    groups = {name: components(group) for name, group in inputs.items()}
    shape = broadcast_shape({name: np.broadcast_shapes(*(c.shape for c in g)) for name, g in groups.items()})
    results = tabulate(lambda values: {"result": function(values)}, inputs, {"result": sample_shape}, shape, dtype)
    return results["result"]


def sine(x: Component) -> Component:
    """Return the sine of a float or of each element of an array, of NumPy or another library; NaN where x is
    infinite. For an object with a method `sine`, return the result of this method.
    """
    if type(x) is float:
        return math.sin(x) if math.isfinite(x) else math.nan
    return np.sin(x) if isinstance(x, np.ndarray | np.generic) else _apply_by_name(x, "sine")


def cosine(x: Component) -> Component:
    """Return the cosine of a float or of each element of an array, of NumPy or another library; NaN where x is
    infinite. For an object with a method `cosine`, return the result of this method.
    """
    if type(x) is float:
        return math.cos(x) if math.isfinite(x) else math.nan
    return np.cos(x) if isinstance(x, np.ndarray | np.generic) else _apply_by_name(x, "cosine")


def angle_terms(phi: Components) -> Components:
    """Return (sin, cos) of each of the angles phi, one after the other, as one tuple."""
    return tuple(function(angle) for angle in phi for function in (sine, cosine))


def turn_terms(phi1: Component) -> Components:
    """Return the tuple (sin, cos) of one angle."""
    return sine(phi1), cosine(phi1)


def hinge_terms(psi: Component) -> Components:
    """Return the tuple (sin psi, 1 - cos psi, cos psi). For small angles, 1 - cos psi is computed from the sine,
    which avoids cancellation.
    """
    s, c = sine(psi), cosine(psi)
    if not isinstance(psi, float | np.ndarray | np.generic):
        return s, _apply_by_name(psi, "versine"), c
    return s, (versines if isinstance(c, np.ndarray) else versine)(s, c), c


def versine(sine: float, cosine: float) -> float:
    """Return 1 - cos of an angle as a float, from the sine and cosine of the angle."""
    return sine * sine / (1 + cosine) if cosine > MIN_COSINE_TO_COMPUTE_VERSINE_FROM_SINE else 1 - cosine


def versines(sine: Component, cosine: Component) -> Component:
    """Return 1 - cos of angles as an array, from the sines and cosines of the angles."""
    return np.where(cosine > MIN_COSINE_TO_COMPUTE_VERSINE_FROM_SINE, sine * sine / (1 + cosine), 1 - cosine)


def hinge_cosine(hinge: Components) -> Component:
    """Return the cosine from the tuple `hinge` that `hinge_terms` returns."""
    return hinge[2]


def _apply_by_name(x: Component, function_name: str) -> Component:
    """Return the sine, cosine or another function of x, which `function_name`, such as "sine", names. It is computed
    by the method of x with this name or, if there is none, by the array library of x.
    """
    method = getattr(x, function_name, None)
    return array_libraries.apply_function(function_name, x) if method is None else method()


def components(value: Any) -> tuple[Any, ...]:
    """Return the components of a vector as a tuple; return a scalar as a tuple of one component."""
    return value if isinstance(value, tuple) else (value,)


def _map_components(group: Any, function: Callable[[Component], Component]) -> Any:
    """Return the results of a function for each component of a tuple, or for the only component."""
    return tuple(map(function, group)) if isinstance(group, tuple) else function(group)


def _holds_array(group: Any) -> bool:
    """Return whether a component, or one of a tuple of components, is a NumPy array."""
    return any(isinstance(c, np.ndarray) for c in components(group))


def _number_or_array(component: Component, dtype: np.dtype[Any]) -> Component:
    """Return a component as a number of the dtype (a Python float for float64) if it is a number or an array of one
    element. Return any other array as it is.
    """
    if isinstance(component, np.ndarray):
        if component.size != 1:
            return component
        component = component.item()
    return float(component) if dtype == np.float64 else dtype.type(component)
