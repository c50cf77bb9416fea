"""From a plan and the values that it takes to arrays: room for the results, many samples, arrays of other libraries.

`pair` is a pair's constants, `values` are the other inputs by name, `shapes` those of the samples by argument, and
`out` holds arrays to write into.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import How
from hingepair.engine.binding import bind
from hingepair.engine.loops import Operations
from hingepair.errors import ArgumentError, DtypeError, ShapeError, quoted
from hingepair.numeric.array_libraries import Library, foreign_components, is_foreign
from hingepair.numeric.arrays import broadcast_shape, result_dtype
from hingepair.pair.constants import Constants
from hingepair.pair.states import PairState, PlanarState
from hingepair.plans.plan import PLANAR, SPATIAL, Plan, Tail, loop_of

Out: TypeAlias = Mapping[str, NDArray[Any]] | None

AUTO = How("auto", 1)
STATES: Mapping[Any, type[PairState | PlanarState]] = {SPATIAL: PairState, PLANAR: PlanarState}
"""What comes out, by the kind of plan."""


def dtype_of(values: Mapping[str, Any]) -> np.dtype[Any]:
    """The dtype that values are computed in."""
    return result_dtype(c for group in values.values() for c in (group if isinstance(group, tuple) else (group,)))


def evaluate(
    pair: Constants,
    plan: Plan,
    values: Mapping[str, Any],
    shapes: Mapping[str, tuple[int, ...]],
    out: Out = None,
    how: How = AUTO,
    dtype: np.dtype[Any] | None = None,
) -> Any:
    """The state at all samples; computed in the dtype of the values unless one is given."""
    shape = broadcast_shape({**shapes, "pair": pair.shape})
    loop, dtype = loop_of(plan), dtype or dtype_of(values)
    arrays = rooms(loop.outputs, shape, dtype, out, values)
    loop.run({**(pair.values if pair.single else pair.arrays), **values}, arrays, shape, dtype, how)
    return STATES[plan.kind](arrays, shape)


def count_operations(plan: Plan, pair: Constants, values: Mapping[str, Any]) -> Operations:
    """How many operations of a plan are left for a pair, where some coordinates are known numbers.

    Args:
        plan: what is computed.
        pair: the constants of one pair.
        values: inputs of the plan of which something is known, as tuples of numbers and arrays, or one of either.
    """
    loop, moving = loop_of(plan), np.empty(2)  # whatever the number of samples, which may be one

    def unknown(c: Any) -> Any:
        return moving + 0 if isinstance(c, np.ndarray) else c

    many = {name: np.empty((2, *tail)) for name, tail in loop.inputs}
    own = {name: tuple(map(unknown, v)) if isinstance(v, tuple) else unknown(v) for name, v in values.items()}
    full = loop.program(bind(loop.inputs, many).pattern)
    return loop.program(bind(loop.inputs, {**many, **pair.values, **own}).pattern).count(full)


def rooms(
    tails: Iterable[tuple[str, Tail]],
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    out: Out,
    values: Mapping[str, Any],
) -> dict[str, NDArray[Any]]:
    """Arrays for results: those of `out`, which overlap none of the values, and new ones."""
    sizes = {name: (*shape, *tail) for name, tail in tails}
    own = {name: _room_for(name, array, sizes[name], dtype) for name, array in (out or {}).items()}
    if own:
        _check_apart(own, values)
    return {name: own[name] if name in own else np.empty(size, dtype) for name, size in sizes.items()}


def _room_for(output: str, array: Any, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """An array to write into, if it is one of this shape and dtype."""
    name = f"out[{output!r}]"
    if not isinstance(array, np.ndarray):
        raise ArgumentError(name, "an array to write into", quoted(array))
    if array.shape != shape:
        raise ShapeError(name, f"shape {shape}", f"shape {array.shape}")
    if array.dtype != dtype:
        raise DtypeError(name, f"dtype {dtype.name}", f"dtype {array.dtype}")
    if not array.flags.writeable:
        raise ArgumentError(name, "a writable array", "a read-only one")
    return array


def written(state: Any, out: Mapping[str, NDArray[Any]], given: Mapping[str, Any]) -> Any:
    """The state, copied into arrays: for a few samples, quicker than to compute them there."""
    arrays = state.arrays()
    own = {name: _room_for(name, room, arrays[name].shape, arrays[name].dtype) for name, room in out.items()}
    _check_apart(out, given)
    for name, room in own.items():
        room[...] = arrays[name]
    return type(state)(arrays | own, state.shape)


def _check_apart(out: Mapping[str, NDArray[Any]], groups: Mapping[str, Any]) -> None:
    """Refuse an output that lies over an input or over another output: blocks would read what they wrote."""
    taken = [
        (name, c, c.flags.owndata)
        for name, group in groups.items()
        for c in (group if isinstance(group, tuple) else (group,))
        if isinstance(c, np.ndarray)
    ]
    for name, array in out.items():
        own = array.flags.owndata
        for other, c, owned in taken:
            apart = own and owned and array is not c  # two arrays with memory of their own
            if not apart and np.may_share_memory(array, c) and np.shares_memory(array, c):
                raise ArgumentError(f"out[{name!r}]", "memory of its own", f"an array that overlaps {other}")
        taken.append((f"out[{name!r}]", array, own))


def evaluate_foreign(
    pair: Constants,
    plan: Plan,
    values: Mapping[str, Any],
    shapes: Mapping[str, tuple[int, ...]],
    library: Library,
    out: Out,
    how: How,
) -> Any:
    """The state at all samples, as arrays of the library.

    Raises:
        ArgumentError: an option that is of NumPy arrays only.
    """
    _check_options(library, out, how)
    shape = broadcast_shape({**shapes, "pair": pair.shape})
    tails = plan.kind.shapes
    parts = {
        name: foreign_components(name, v, *tails[name]) if tails[name] else v if is_foreign(v) else float(v)
        for name, v in values.items()
    }
    constants = {
        name: tuple(library.array(c) if isinstance(c, np.ndarray) else c for c in group)  # a number stays one
        if isinstance(group, tuple)
        else group
        for name, group in pair.values.items()
    }
    found = plan.run({**constants, **parts})
    if library.name == "jax":
        _teach_jax()
    arrays = {}
    for name in plan.outputs:
        components = found[name] if isinstance(found[name], tuple) else (found[name],)
        arrays[name] = library.joined(components, shape, tails[name])
    return STATES[plan.kind](arrays, shape)


def _check_options(library: Library, out: Out, how: How) -> None:
    """Refuse what is of NumPy arrays only.

    Raises:
        ArgumentError: names the option.
    """
    if out is not None:
        raise ArgumentError("out", f"None, since {library.name} makes its own arrays", quoted(out))
    if how.backend != "auto":
        raise ArgumentError("backend", f"'auto', since {library.name} runs the equations", quoted(how.backend))
    if how.workers != 1:
        raise ArgumentError("workers", f"1, since {library.name} has threads of its own", how.workers)


@functools.cache
def _teach_jax() -> None:
    """Tell JAX what states are made of, so that its functions take and return them."""
    from jax.tree_util import register_pytree_node

    def parts(state: Any) -> tuple[tuple[Any, ...], tuple[tuple[str, ...], int]]:
        arrays = tuple(state.arrays().values())
        return arrays, (state.outputs, arrays[0].ndim - len(state.shape))

    def joined(state: Any, form: tuple[tuple[str, ...], int], arrays: Any) -> Any:
        names, axes = form  # of the first output, how many axes one sample has
        own = dict(zip(names, arrays, strict=True))
        shape = getattr(own[names[0]], "shape", ())  # JAX also asks for states of what is no array
        return state(own, tuple(shape[: len(shape) - axes]))

    for state in (PairState, PlanarState):
        register_pytree_node(state, parts, functools.partial(joined, state))
