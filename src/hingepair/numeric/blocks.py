"""The NumPy backend: a function of components, run over the samples in blocks that fit the cache."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.arrays import Block, Component, broadcast_shape, load, split_into_blocks

Components: TypeAlias = tuple[Component, ...]
Named: TypeAlias = dict[str, Any]  # by name: a component, or the tuple of components of a vector or matrix

VERSINE_SWITCH = 0.7  # cosine of a turn above which 1 - cos is computed from the sine
BLOCK = 4096  # samples: 32 kB a component, so that what a block computes on the way stays in the cache


def components_of(array: NDArray[Any], rank: int = 1) -> Components:
    """Return views of the components of vectors (rank 1), of matrices row by row (rank 2), or of scalars (rank 0)."""
    if rank == 0:
        return (array,)
    if rank == 2:
        rows, columns = array.shape[-2:]
        return tuple(array[..., i, j] for i in range(rows) for j in range(columns))
    return tuple(array[..., i] for i in range(array.shape[-1]))


def numbers(array: NDArray[Any], rank: int = 1) -> Components:
    """Return the components of one vector or matrix as Python floats, of several as `components_of` does."""
    return tuple(array.ravel().tolist()) if array.ndim == rank else components_of(array, rank)


def tabulate(
    function: Callable[[Named], Mapping[str, Any]],
    inputs: Named,
    sample_shapes: Mapping[str, tuple[int, ...]],
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
) -> dict[str, NDArray[Any]]:
    """Return the results of a function for all samples, block by block, as new arrays by name.

    A component of one element reaches the function as a number, so that what depends on such components alone costs
    nothing per sample, and a single sample needs no array at all.

    Args:
        function: takes the inputs and returns the results by name, each a component or a tuple of components.
        inputs: inputs by name, each a component or a tuple of components.
        sample_shapes: shape of one sample of each result.
        shape: shape of the samples.
        dtype: of the results.
    """
    out = {name: np.empty((*shape, *sample_shape), dtype) for name, sample_shape in sample_shapes.items()}
    targets = [view for array in out.values() for view in components_of(array, array.ndim - len(shape))]
    values = {name: _map_components(group, lambda c: _number_or_array(c, dtype)) for name, group in inputs.items()}
    moving = {name: group for name, group in values.items() if _holds_array(group)}

    def results(*loaded: Component) -> list[Component]:
        """Return the results for the loaded components of one block, in the order of `targets`."""
        rest = iter(loaded)
        parts = {name: _map_components(group, lambda _: next(rest)) for name, group in moving.items()}
        found = function({**values, **parts})
        return [component for name in out for component in components(found[name])]

    blocks = split_into_blocks(shape, BLOCK) if moving else [()]
    fill_blocks(results, [c for group in moving.values() for c in components(group)], targets, dtype, blocks)
    return out


def fill_blocks(
    function: Callable[..., Iterable[Any]],
    inputs: Sequence[Component],
    targets: Sequence[NDArray[Any]],
    dtype: np.dtype[Any],
    blocks: Iterable[Block],
) -> None:
    """Write the results of a function of components, block by block, into `targets`, without warnings of NumPy."""
    with np.errstate(all="ignore"):
        for block in blocks:
            results = function(*(load(component, block, dtype) for component in inputs))
            for target, result in zip(targets, results, strict=True):
                target[block] = result


def tabulate_one(
    function: Callable[[Named], Any], inputs: Named, sample_shape: tuple[int, ...], dtype: np.dtype[Any]
) -> NDArray[Any]:
    """Return the only result of a function of components by name, for all samples; shape (..., *sample_shape)."""
    groups = {name: components(group) for name, group in inputs.items()}
    shape = broadcast_shape({name: np.broadcast_shapes(*(c.shape for c in g)) for name, g in groups.items()})
    results = tabulate(lambda values: {"result": function(values)}, inputs, {"result": sample_shape}, shape, dtype)
    return results["result"]


def sine(x: Component) -> Component:
    """Return the sine of a float, of an array, or by an object's own method; NaN of infinity."""
    if type(x) is float:
        return math.sin(x) if math.isfinite(x) else math.nan
    return np.sin(x) if isinstance(x, np.ndarray | np.generic) else x.sine()


def cosine(x: Component) -> Component:
    """Return the cosine of a float, of an array, or by an object's own method; NaN of infinity."""
    if type(x) is float:
        return math.cos(x) if math.isfinite(x) else math.nan
    return np.cos(x) if isinstance(x, np.ndarray | np.generic) else x.cosine()


def angle_terms(phi: Components) -> Components:
    """Return (sin, cos) of each angle, one after the other."""
    return tuple(function(angle) for angle in phi for function in (sine, cosine))


def hinge_terms(psi: Component) -> Components:
    """Return (sin psi, 1 - cos psi, cos psi), without cancellation at small angles."""
    s, c = sine(psi), cosine(psi)
    if not isinstance(psi, float | np.ndarray | np.generic):
        return s, psi.versine(), c
    return s, (versines if isinstance(c, np.ndarray) else versine)(s, c), c


def versine(sine: float, cosine: float) -> float:
    """Return 1 - cos of an angle from its sine and cosine."""
    return sine * sine / (1 + cosine) if cosine > VERSINE_SWITCH else 1 - cosine


def versines(sine: Component, cosine: Component) -> Component:
    """Return 1 - cos of angles from their sines and cosines."""
    return np.where(cosine > VERSINE_SWITCH, sine * sine / (1 + cosine), 1 - cosine)


def components(value: Any) -> tuple[Any, ...]:
    """Return the components of a vector, or a scalar as the only one."""
    return value if isinstance(value, tuple) else (value,)


def _map_components(group: Any, function: Callable[[Component], Component]) -> Any:
    return tuple(map(function, group)) if isinstance(group, tuple) else function(group)


def _holds_array(group: Any) -> bool:
    return any(isinstance(c, np.ndarray) for c in components(group))


def _number_or_array(component: Component, dtype: np.dtype[Any]) -> Component:
    """Return an array of more than one element as it is, and all else as a number of the dtype."""
    if isinstance(component, np.ndarray):
        if component.size != 1:
            return component
        component = component.item()
    return float(component) if dtype == np.float64 else dtype.type(component)
