"""Dask arrays in, Dask arrays out: a function of NumPy arrays, run over chunks, one task a chunk.

Nothing here imports Dask before an argument holds a Dask array.
"""

from __future__ import annotations

import functools
import importlib
import itertools
import math
import pickle
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, Final, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, DtypeError, ShapeError, quoted
from hingepair.numeric.arrays import Frozen, broadcast_shape, real_array

Returned = TypeVar("Returned")
Tail: TypeAlias = tuple[int, ...]
Tails: TypeAlias = Mapping[str, Any]
"""Shape of one sample by argument; of an argument with attributes, a mapping of theirs."""

_MAX_LOADED_FUNCTIONS: Final = 64  # of other processes that a worker keeps, with what they have compiled


def holds_dask(*values: Any) -> bool:
    """Return whether an argument is, or holds, a Dask array; also in a tuple, a mapping, a motion, xarray or a table.

    Costs nothing where Dask is not loaded.
    """
    return "dask" in sys.modules and any(map(_holds_dask, values))


def _holds_dask(value: Any) -> bool:
    """Return whether a value is, or holds at any depth, a lazy array or data frame of Dask."""
    if value is None or type(value) in {np.ndarray, float, int}:
        return False
    if isinstance(value, Frozen):
        return any(_holds_dask(getattr(value, one.name, None)) for one in fields(value))  # type: ignore[arg-type]
    if isinstance(value, Mapping):
        return any(map(_holds_dask, value.values()))
    if isinstance(value, tuple | list):
        return any(map(_holds_dask, value))
    return _is_array(value) or _is_table(value)


def lazy_data(value: Any) -> Any:
    """Return the Dask array that an xarray object holds; anything else as it is."""
    if type(value).__module__.partition(".")[0] == "xarray" and _is_array(getattr(value, "data", None)):
        return value.data
    return value


def _is_array(value: Any) -> bool:
    arrays: Any = sys.modules.get("dask.array")
    value = value.data if type(value).__module__.partition(".")[0] == "xarray" else value
    return arrays is not None and isinstance(value, arrays.Array)


def _is_table(value: Any) -> bool:
    return type(value).__module__.startswith("dask.dataframe") and hasattr(value, "columns")


class DaskCollection:
    """Base class of results that `dask.compute` and `dask.persist` take whole where their arrays are Dask arrays."""

    __slots__ = ()

    def _dask_parts(self) -> tuple[Mapping[str, Any], Callable[[Mapping[str, Any]], Any]]:
        """Return the Dask arrays by name, and a function that makes the result of other arrays of these names.

        The function can be pickled, and holds no Dask array.
        """
        raise NotImplementedError

    def _dask_arrays(self) -> list[Any]:
        return list(self._dask_parts()[0].values()) if "dask" in sys.modules else []

    def compute(self, **options: Any) -> Any:
        """Return the result with NumPy arrays, all computed by Dask in one go; `options` are those of `dask.compute`.

        A result that holds no Dask arrays is returned as it is.
        """
        if not self._dask_arrays():
            return self
        import dask

        (result,) = dask.compute(self, **options)
        return result

    def __dask_graph__(self) -> Any:
        arrays = self._dask_arrays()
        if not arrays:
            return None
        from dask.highlevelgraph import HighLevelGraph

        return HighLevelGraph.merge(*(array.__dask_graph__() for array in arrays))

    def __dask_keys__(self) -> list[Any]:
        return [array.__dask_keys__() for array in self._dask_arrays()]

    def __dask_layers__(self) -> tuple[str, ...]:
        return tuple(itertools.chain.from_iterable(array.__dask_layers__() for array in self._dask_arrays()))

    def __dask_tokenize__(self) -> Any:
        from dask.base import normalize_token

        parts, _ = self._dask_parts()
        return type(self).__name__, normalize_token(dict(parts)) if parts else id(self)

    @staticmethod
    def __dask_optimize__(graph: Any, keys: Any, **options: Any) -> Any:
        from dask.array.optimization import optimize

        return optimize(graph, keys, **options)

    @staticmethod
    def __dask_scheduler__(*arguments: Any, **options: Any) -> Any:
        from dask.threaded import get

        return get(*arguments, **options)

    def __dask_postcompute__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        arrays, rebuild = self._dask_parts()
        finalizers = [array.__dask_postcompute__() for array in arrays.values()]
        return _finalize_parts, (tuple(arrays), finalizers, rebuild)

    def __dask_postpersist__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        arrays, rebuild = self._dask_parts()
        rebuilders = [(array.__dask_keys__(), *array.__dask_postpersist__()) for array in arrays.values()]
        return _rebuild_persisted, (tuple(arrays), rebuilders, rebuild)


def _finalize_parts(
    results: Sequence[Any], names: Sequence[str], finalizers: Sequence[Any], rebuild: Callable[..., Any]
) -> Any:
    """Return a result of the computed blocks of each of its arrays."""
    parts = zip(results, finalizers, strict=True)
    arrays = [finalize(blocks, *arguments) for blocks, (finalize, arguments) in parts]
    return rebuild(dict(zip(names, arrays, strict=True)))


def _rebuild_persisted(
    graph: Mapping[Any, Any],
    names: Sequence[str],
    rebuilders: Sequence[Any],
    rebuild: Callable[..., Any],
    **options: Any,
) -> Any:
    """Return a result of Dask arrays whose blocks are in a graph of computed tasks."""
    from dask.core import flatten

    arrays = []
    for keys, make, arguments in rebuilders:
        own = {key: graph[key] for key in flatten(keys) if key in graph}
        arrays.append(make(own or graph, *arguments, **options))
    return rebuild(dict(zip(names, arrays, strict=True)))


class _Place(NamedTuple):
    """Position of a numbered array among the arguments."""

    number: int


class _Attributes(NamedTuple):
    """An argument by its attributes, and its class."""

    kind: type
    values: Mapping[str, Any]


class _Leaf(NamedTuple):
    """An array among the arguments: its name for messages, itself, and the shape of one sample."""

    name: str
    array: Any
    tail: Tail

    @property
    def lead(self) -> int:
        """The number of axes of samples."""
        return int(self.array.ndim) - len(self.tail)


def over_chunks(
    method: Callable[..., Returned],
    arguments: Mapping[str, Any],
    tails: Tails,
    column_names_of: Callable[[str, Any], Sequence[str]] | None = None,
    template_of: Callable[..., Any] | None = None,
    index_name: str | None = None,
) -> Returned:
    """Return the results of a method for Dask arrays as lazy Dask arrays, to be computed chunk by chunk.

    The result is of the method's own kind. The method runs on one made-up sample, which shows what it returns and
    refuses what it cannot use, and then in each chunk, as one task. Axes of samples may be chunked in any way;
    the axes of one sample are made one chunk.

    Args:
        method: a function, or a method of something that can be pickled; takes the arguments by name.
        arguments: by name: arrays of Dask or NumPy, numbers, None, xarray objects, tables, tuples of components, or
            values with attributes that are such.
        tails: shape of one sample by argument; those not named are options, the same for all chunks. In a tuple or a
            mapping the first axis of the sample is that of its parts; of a tuple also a list of the shapes of its
            parts.
        column_names_of: function of the argument's name and an empty table; returns the columns to take, in order.
        template_of: function of the same arguments that returns what the method would for one sample, as far as
            shapes and dtypes go; the method itself unless given.
        index_name: name of an argument of the method that gets the index of the chunk's first sample, a tuple, or
            None where sizes of chunks are not known.

    Raises:
        ArgumentError: what the method refuses, `out` that is not None, or arrays that do not broadcast.
    """
    options = {name: value for name, value in arguments.items() if name not in tails}
    if options.get("out") is not None:
        raise ArgumentError("out", "None, since Dask makes its own arrays", quoted(options["out"]))
    leaves: list[_Leaf] = []
    skeleton = {
        name: _skeleton(name, value, tails[name], leaves, column_names_of)
        for name, value in arguments.items()
        if name in tails
    }
    axes = max(leaf.lead for leaf in leaves)
    broadcast_shape({leaf.name: leaf.array.shape[: leaf.lead] for leaf in leaves})
    probe_options = options | ({"backend": "auto"} if "backend" in options else {})
    probe_options |= {} if index_name is None else {index_name: None}
    probe = (template_of or method)(**_filled(skeleton, [_made_up(leaf) for leaf in leaves]), **probe_options)
    parts = _result_arrays(probe)
    lazy = {name: part for name, part in parts.items() if np.shape(part)[:axes] == (1,) * axes}
    task = ChunkTask(method, skeleton, options, tuple(lazy), index_name)
    arrays = _lazy_arrays(task, leaves, axes, lazy)
    shape = next(iter(arrays.values())).shape[:axes] if arrays else ()
    found: Returned = _rebuilt(probe, parts | arrays, shape)
    return found


def _skeleton(
    name: str, value: Any, tail: Any, leaves: list[_Leaf], column_names_of: Callable[[str, Any], Sequence[str]] | None
) -> Any:
    """Return an argument with its arrays replaced by their places among the leaves."""
    value = lazy_data(value)
    if isinstance(value, Frozen):
        own = {one.name: getattr(value, one.name) for one in fields(value) if one.name in tail}  # type: ignore[arg-type]
        parts = {
            key: _skeleton(f"{name}.{key}", part, tail[key], leaves, column_names_of) for key, part in own.items()
        }
        return _Attributes(type(value), parts)
    if isinstance(value, Mapping):
        return {key: _skeleton(f"{name}[{key!r}]", v, tail[1:], leaves, column_names_of) for key, v in value.items()}
    if isinstance(value, tuple) and (isinstance(tail, list) or _holds_dask(value)):
        part_tails = tail if isinstance(tail, list) else [tail[1:]] * len(value)
        return tuple(
            _skeleton(f"{name}[{i}]", v, part_tails[i], leaves, column_names_of) for i, v in enumerate(value)
        )
    if _is_table(value):
        if column_names_of is None:
            raise ArgumentError(name, "a Dask array, since a table has no meaning here", quoted(type(value).__name__))
        value = value[list(column_names_of(name, value._meta))].to_dask_array()
    if _is_array(value):
        array = _check_dask_array(name, value, tail)
    elif value is None or isinstance(value, str | bool | int | float) or np.ndim(value) <= len(tail):
        return value
    else:
        import dask.array

        array = _check_dask_array(name, dask.array.from_array(real_array(name, value)), tail)
    leaves.append(_Leaf(name, array, tail))
    return _Place(len(leaves) - 1)


def _check_dask_array(name: str, array: Any, tail: Tail) -> Any:
    """Return a Dask array whose samples are of one chunk; refuse another shape or type of number."""
    lead = array.ndim - len(tail)
    if lead < 0 or tuple(array.shape[lead:]) != tail:
        expected = f"shape (..., {', '.join(map(str, tail))})" if tail else "shape (...)"
        raise ShapeError(name, expected, f"shape {array.shape}")
    if array.dtype.kind not in "iu" and array.dtype not in {np.dtype(np.float64), np.dtype(np.float32)}:
        raise DtypeError(name, "real numbers (float64, float32 or integers)", str(array.dtype))
    split = {axis: -1 for axis in range(lead, array.ndim) if array.numblocks[axis] > 1}
    return array.rechunk(split) if split else array


def _made_up(leaf: _Leaf) -> NDArray[Any]:
    """Return one sample of an array: ones, or where it may be a rotation the identity."""
    sample = np.eye(3) if leaf.tail == (3, 3) else np.ones(leaf.tail)
    return sample.astype(leaf.array.dtype).reshape((1,) * leaf.lead + leaf.tail)


def _filled(skeleton: Any, arrays: Sequence[NDArray[Any]]) -> Any:
    """Return an argument with arrays at their places."""
    if isinstance(skeleton, _Place):
        return arrays[skeleton.number]
    if isinstance(skeleton, _Attributes):
        return skeleton.kind(**{key: _filled(part, arrays) for key, part in skeleton.values.items()})
    if isinstance(skeleton, Mapping):
        return {key: _filled(part, arrays) for key, part in skeleton.items()}
    if type(skeleton) is tuple:
        return tuple(_filled(part, arrays) for part in skeleton)
    return skeleton


def _result_arrays(result: Any) -> dict[str, Any]:
    """Return the arrays of a result by name; of one array, itself."""
    if hasattr(result, "arrays"):
        found: dict[str, Any] = result.arrays()
        return found
    if isinstance(result, tuple):
        return dict(zip(type(result)._fields, result, strict=True))  # type: ignore[attr-defined]
    if isinstance(result, Frozen):
        own = {one.name: getattr(result, one.name) for one in fields(result)}  # type: ignore[arg-type]
        return {name: value for name, value in own.items() if value is not None}
    return dict(result) if isinstance(result, Mapping) else {"": result}


def _rebuilt(result: Any, arrays: Mapping[str, Any], shape: Tail) -> Any:
    """Return a result of the same kind, of other arrays."""
    if hasattr(result, "arrays"):
        return type(result)(arrays, shape)
    if isinstance(result, tuple | Frozen):
        return type(result)(**arrays)
    return dict(arrays) if isinstance(result, Mapping) else arrays[""]


@dataclass(eq=False)
class ChunkTask:
    """Computation of one chunk.

    Attributes:
        method: a function of the arguments and options by name.
        skeleton: the arguments, with places for the arrays.
        options: other arguments.
        names: of the results that differ from sample to sample.
        index_name: name of the argument that gets the index of the chunk's first sample, if there is one.
    """

    method: Callable[..., Any]
    skeleton: Mapping[str, Any]
    options: Mapping[str, Any]
    names: tuple[str, ...]
    index_name: str | None = None

    @functools.cached_property
    def pickled(self) -> bytes:
        """The task as bytes, by which Dask knows it."""
        values = (self.method, self.skeleton, self.options, self.names, self.index_name)
        try:
            return pickle.dumps(values)
        except (pickle.PicklingError, AttributeError, TypeError):  # a callable that has no name in a module
            cloudpickle = importlib.import_module("cloudpickle")  # which comes with Dask
            return bytes(cloudpickle.dumps(values))

    def __dask_tokenize__(self) -> bytes:
        return self.pickled

    def __reduce__(self) -> tuple[Any, ...]:
        return loaded_task, (self.pickled,)

    def __call__(self, block: tuple[int, ...], slices: tuple[slice, ...] | None, *blocks: Any) -> Any:
        """Return the arrays of one chunk: a tuple, or the only one; `slices` are its range of all samples."""
        first = None if slices is None else tuple(one.start for one in slices)
        options = {**self.options, **({} if self.index_name is None else {self.index_name: first})}
        try:
            result = self.method(**_filled(self.skeleton, [_only_array(own) for own in blocks]), **options)
        except ArgumentError as error:
            raise type(error)(f"chunk {block}: {error.name}", error.expected, error.got) from None
        except Exception as error:
            error.add_note(f"in chunk {block}")
            raise
        parts = _result_arrays(result)
        arrays = tuple(np.asarray(parts[name]) for name in self.names)
        return arrays if len(arrays) > 1 else arrays[0]


@functools.lru_cache(maxsize=_MAX_LOADED_FUNCTIONS)
def loaded_task(pickled: bytes) -> ChunkTask:
    """Return a task that another process sent; the same one for all of its chunks."""
    return ChunkTask(*pickle.loads(pickled))


def _only_array(block: Any) -> NDArray[Any]:
    """Return the only array in nested lists, as Dask gives what has axes that the results lack."""
    while isinstance(block, list):
        (block,) = block
    return np.asarray(block)


def _lazy_arrays(task: ChunkTask, leaves: Sequence[_Leaf], axes: int, samples: Mapping[str, Any]) -> dict[str, Any]:
    """Return the results as Dask arrays, from those of one sample, which show their shape and dtype."""
    from dask.array import blockwise
    from dask.array.core import unify_chunks
    from dask.layers import ArrayBlockIdDep, ArraySliceDep

    lead = tuple(range(axes))
    own_axes = itertools.count(axes)  # names of the axes of one sample, which no two arrays share
    indices = [(*lead[axes - leaf.lead :], *itertools.islice(own_axes, len(leaf.tail))) for leaf in leaves]
    pairs = zip((leaf.array for leaf in leaves), indices, strict=True)
    chunks_of, arrays = unify_chunks(*itertools.chain.from_iterable(pairs))
    chunks = tuple(chunks_of[axis] for axis in lead)
    is_known = not any(math.isnan(size) for sizes in chunks for size in sizes)
    ranges = (ArraySliceDep(chunks), lead) if is_known else (None, None)
    inputs = itertools.chain((ArrayBlockIdDep(chunks), lead), ranges, *zip(arrays, indices, strict=True))
    how: dict[str, Any] = {"align_arrays": False, "token": getattr(task.method, "__name__", "hingepair").strip("_")}
    if len(samples) > 1:
        none = np.empty((0,) * axes, object)
        packed = blockwise(task, lead, *inputs, dtype=object, meta=none, **how)
    found = {}
    for place, (name, sample) in enumerate(samples.items()):
        tail = np.shape(sample)[axes:]
        behind = tuple(itertools.islice(own_axes, len(tail)))
        shape: dict[str, Any] = {"new_axes": dict(zip(behind, tail, strict=True)), "dtype": sample.dtype}
        shape["meta"] = np.empty((0,) * (axes + len(tail)), sample.dtype)
        if len(samples) > 1:
            found[name] = blockwise(_take_array, (*lead, *behind), packed, lead, place, None, **shape, **how)
        else:
            found[name] = blockwise(task, (*lead, *behind), *inputs, **shape, **how)
    return found


def _take_array(arrays: tuple[NDArray[Any], ...], place: int) -> NDArray[Any]:
    return arrays[place]
