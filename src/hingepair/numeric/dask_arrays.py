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
from hingepair.numeric.caching import lock_free_cached_property

Returned = TypeVar("Returned")
SampleShape: TypeAlias = tuple[int, ...]
"""Shape of one sample of an array."""
SampleShapeByArgument: TypeAlias = Mapping[str, Any]
"""Shape of one sample by argument; of an object, a mapping with the shapes of its attributes."""

_TASKS: Final = 64  # unpickled tasks that a process keeps, with the kernels that it compiled for them


def holds_dask(*values: Any) -> bool:
    """Return whether any argument contains a Dask array or data frame. While Dask is not imported, none does."""
    return "dask" in sys.modules and any(map(_contains_dask, values))


def _contains_dask(value: Any) -> bool:
    """Return whether a value is, or contains at any depth, a Dask array or data frame."""
    if value is None or type(value) in {np.ndarray, float, int}:
        return False
    if isinstance(value, Frozen):
        return any(_contains_dask(getattr(value, one.name, None)) for one in fields(value))  # type: ignore[arg-type]
    if isinstance(value, Mapping):
        return any(map(_contains_dask, value.values()))
    if isinstance(value, tuple | list):
        return any(map(_contains_dask, value))
    return _is_dask_array(value) or _is_dask_table(value)


def unwrap_lazy_xarray(value: Any) -> Any:
    """Return the Dask array that an xarray object holds, and any other value unchanged."""
    if type(value).__module__.partition(".")[0] == "xarray" and _is_dask_array(getattr(value, "data", None)):
        return value.data
    return value


def _is_dask_array(value: Any) -> bool:
    """Return whether a value is a Dask array, or an xarray object that holds one."""
    arrays: Any = sys.modules.get("dask.array")
    value = value.data if type(value).__module__.partition(".")[0] == "xarray" else value
    return arrays is not None and isinstance(value, arrays.Array)


def _is_dask_table(value: Any) -> bool:
    """Return whether a value is a Dask data frame."""
    return type(value).__module__.startswith("dask.dataframe") and hasattr(value, "columns")


class DaskCollection:
    """Base class of results whose arrays may be Dask arrays: `dask.compute` and `dask.persist` take a result as one
    collection, and return a result of the same class.
    """

    __slots__ = ()

    def _dask_parts(self) -> tuple[Mapping[str, Any], Callable[[Mapping[str, Any]], Any]]:
        """Return the Dask arrays by name, and a function that returns the result with others instead. The function
        can be pickled, and holds no Dask array.
        """
        raise NotImplementedError

    def _dask_arrays(self) -> list[Any]:
        return list(self._dask_parts()[0].values()) if "dask" in sys.modules else []

    def compute(self, **options: Any) -> Any:
        """Compute all Dask arrays together, and return a result of the same class with NumPy arrays; options are
        those of `dask.compute`.
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
        arrays, make_result = self._dask_parts()
        finalizers = [array.__dask_postcompute__() for array in arrays.values()]
        return _make_computed_result, (tuple(arrays), finalizers, make_result)

    def __dask_postpersist__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        arrays, make_result = self._dask_parts()
        rebuilders = [(array.__dask_keys__(), *array.__dask_postpersist__()) for array in arrays.values()]
        return _make_persisted_result, (tuple(arrays), rebuilders, make_result)


def _make_computed_result(
    blocks_by_array: Sequence[Any], names: Sequence[str], finalizers: Sequence[Any], make_result: Callable[..., Any]
) -> Any:
    """Return a result of computed blocks, which Dask's finalizers join into arrays."""
    parts = zip(blocks_by_array, finalizers, strict=True)
    arrays = [finalize(blocks, *arguments) for blocks, (finalize, arguments) in parts]
    return make_result(dict(zip(names, arrays, strict=True)))


def _make_persisted_result(
    graph: Mapping[Any, Any],
    names: Sequence[str],
    rebuilders: Sequence[Any],
    make_result: Callable[..., Any],
    **options: Any,
) -> Any:
    """Return a result of persisted blocks, which Dask's rebuilders make arrays."""
    from dask.core import flatten

    arrays = []
    for keys, make, arguments in rebuilders:
        blocks = {key: graph[key] for key in flatten(keys) if key in graph}
        arrays.append(make(blocks or graph, *arguments, **options))
    return make_result(dict(zip(names, arrays, strict=True)))


class _ArrayIndex(NamedTuple):
    """Index of an array among the chunked arguments; it stands for the array in a template."""

    value: int


class _ObjectTemplate(NamedTuple):
    """Template of an argument that is an object with arrays as attributes."""

    object_class: type
    attributes: Mapping[str, Any]  # with an index in place of each array that has chunks


class _ChunkedArgument(NamedTuple):
    """Dask array among the arguments of a call."""

    name: str  # for messages
    array: Any
    sample_shape: SampleShape

    @property
    def num_sample_axes(self) -> int:
        """Number of leading axes, those of the samples."""
        return int(self.array.ndim) - len(self.sample_shape)


def apply_to_chunks(
    method: Callable[..., Returned],
    arguments: Mapping[str, Any],
    sample_shapes: SampleShapeByArgument,
    column_names_of: Callable[[str, Any], Sequence[str]] | None = None,
    template_function: Callable[..., Any] | None = None,
    first_index_name: str | None = None,
) -> Returned:
    """Return the result of a method for arguments that hold Dask arrays, as lazy Dask arrays: a task computes each
    chunk.

    The method is called with one made-up sample, which shows the shapes and dtypes of its results; arguments that it
    cannot use are refused then. Axes of samples may be chunked in any way; the axes of one sample are made one chunk.

    Args:
        method: a function, or a method of something that can be pickled; takes the arguments by name.
        arguments: by name: arrays of Dask or NumPy, numbers, None, xarray objects, tables, tuples of components, or
            values with attributes that are such.
        sample_shapes: shape of one sample by argument; the other arguments are options, the same for all chunks. In
            a tuple or a mapping the first axis of the sample is that of its parts; of a tuple also a list of the
            shapes of its parts.
        column_names_of: function of the argument's name and an empty table; returns the columns to take, in order.
        template_function: function of the same arguments that is called with the made-up sample in place of the
            method, and returns arrays of the same shapes and dtypes.
        first_index_name: name of an argument of the method that gets the index of the chunk's first sample, a tuple;
            None where the sizes of chunks are not known.

    Raises:
        ArgumentError: what the method refuses, `out` that is not None, or arrays that do not broadcast.
    """
    options = {name: value for name, value in arguments.items() if name not in sample_shapes}
    if options.get("out") is not None:
        raise ArgumentError("out", "None, since Dask makes its own arrays", quoted(options["out"]))
    chunked_arguments: list[_ChunkedArgument] = []
    templates = {
        name: _replace_arrays(name, value, sample_shapes[name], chunked_arguments, column_names_of)
        for name, value in arguments.items()
        if name in sample_shapes
    }
    num_axes = max(argument.num_sample_axes for argument in chunked_arguments)
    broadcast_shape(
        {argument.name: argument.array.shape[: argument.num_sample_axes] for argument in chunked_arguments}
    )
    probe_options = options | ({"backend": "auto"} if "backend" in options else {})
    probe_options |= {} if first_index_name is None else {first_index_name: None}
    probe = (template_function or method)(
        **_fill_in_arrays(templates, [_placeholder_sample(argument) for argument in chunked_arguments]),
        **probe_options,
    )
    parts = _arrays_by_name(probe)
    lazy = {name: part for name, part in parts.items() if np.shape(part)[:num_axes] == (1,) * num_axes}
    task = ChunkTask(method, templates, options, tuple(lazy), first_index_name)
    arrays = _make_lazy_arrays(task, chunked_arguments, num_axes, lazy)
    shape = next(iter(arrays.values())).shape[:num_axes] if arrays else ()
    result: Returned = _with_arrays(probe, parts | arrays, shape)
    return result


def _replace_arrays(
    name: str,
    value: Any,
    sample_shape: Any,
    chunked_arguments: list[_ChunkedArgument],
    column_names_of: Callable[[str, Any], Sequence[str]] | None,
) -> Any:
    """Return the template of an argument, with indices for arrays, and append these to `chunked_arguments`."""
    value = unwrap_lazy_xarray(value)
    if isinstance(value, Frozen):
        attributes = {one.name: getattr(value, one.name) for one in fields(value) if one.name in sample_shape}  # type: ignore[arg-type]
        parts = {
            key: _replace_arrays(f"{name}.{key}", part, sample_shape[key], chunked_arguments, column_names_of)
            for key, part in attributes.items()
        }
        return _ObjectTemplate(type(value), parts)
    if isinstance(value, Mapping):
        return {
            key: _replace_arrays(f"{name}[{key!r}]", v, sample_shape[1:], chunked_arguments, column_names_of)
            for key, v in value.items()
        }
    if isinstance(value, tuple) and (isinstance(sample_shape, list) or _contains_dask(value)):
        part_shapes = sample_shape if isinstance(sample_shape, list) else [sample_shape[1:]] * len(value)
        return tuple(
            _replace_arrays(f"{name}[{i}]", v, part_shapes[i], chunked_arguments, column_names_of)
            for i, v in enumerate(value)
        )
    if _is_dask_table(value):
        if column_names_of is None:
            raise ArgumentError(name, "a Dask array, since a table has no meaning here", quoted(type(value).__name__))
        value = value[list(column_names_of(name, value._meta))].to_dask_array()
    if _is_dask_array(value):
        array = _check_and_rechunk(name, value, sample_shape)
    elif value is None or isinstance(value, str | bool | int | float) or np.ndim(value) <= len(sample_shape):
        return value
    else:
        import dask.array

        array = _check_and_rechunk(name, dask.array.from_array(real_array(name, value)), sample_shape)
    chunked_arguments.append(_ChunkedArgument(name, array, sample_shape))
    return _ArrayIndex(len(chunked_arguments) - 1)


def _check_and_rechunk(name: str, array: Any, sample_shape: SampleShape) -> Any:
    """Return a Dask array of real numbers with one chunk along the axes of a sample."""
    num_axes = array.ndim - len(sample_shape)
    if num_axes < 0 or tuple(array.shape[num_axes:]) != sample_shape:
        expected = f"shape (..., {', '.join(map(str, sample_shape))})" if sample_shape else "shape (...)"
        raise ShapeError(name, expected, f"shape {array.shape}")
    if array.dtype.kind not in "iu" and array.dtype not in {np.dtype(np.float64), np.dtype(np.float32)}:
        raise DtypeError(name, "real numbers (float64, float32 or integers)", str(array.dtype))
    if isinstance(getattr(array, "_meta", None), np.ma.MaskedArray):
        raise DtypeError(name, "an array without a mask (use dask.array.ma.filled)", "a Dask array of masked chunks")
    new_chunks = {axis: -1 for axis in range(num_axes, array.ndim) if array.numblocks[axis] > 1}
    return array.rechunk(new_chunks) if new_chunks else array


def _placeholder_sample(argument: _ChunkedArgument) -> NDArray[Any]:
    """Return a made-up sample: the identity for a 3 x 3 matrix, and ones for other shapes."""
    sample = np.eye(3) if argument.sample_shape == (3, 3) else np.ones(argument.sample_shape)
    return sample.astype(argument.array.dtype).reshape((1,) * argument.num_sample_axes + argument.sample_shape)


def _fill_in_arrays(template: Any, arrays: Sequence[NDArray[Any]]) -> Any:
    """Return an argument made of its template and the arrays."""
    if isinstance(template, _ArrayIndex):
        return arrays[template.value]
    if isinstance(template, _ObjectTemplate):
        return template.object_class(
            **{key: _fill_in_arrays(part, arrays) for key, part in template.attributes.items()}
        )
    if isinstance(template, Mapping):
        return {key: _fill_in_arrays(part, arrays) for key, part in template.items()}
    if type(template) is tuple:
        return tuple(_fill_in_arrays(part, arrays) for part in template)
    return template


def _arrays_by_name(result: Any) -> dict[str, Any]:
    """Return the arrays of a result (an object, named tuple or mapping) by name; that of a single array is ""."""
    if hasattr(result, "arrays"):
        arrays: dict[str, Any] = result.arrays()
        return arrays
    if isinstance(result, tuple):
        return dict(zip(type(result)._fields, result, strict=True))  # type: ignore[attr-defined]
    if isinstance(result, Frozen):
        attributes = {one.name: getattr(result, one.name) for one in fields(result)}  # type: ignore[arg-type]
        return {name: value for name, value in attributes.items() if value is not None}
    return dict(result) if isinstance(result, Mapping) else {"": result}


def _with_arrays(result: Any, arrays: Mapping[str, Any], shape: SampleShape) -> Any:
    """Return a copy of a result with other arrays, and `shape` as the leading shape of the samples."""
    if hasattr(result, "arrays"):
        return type(result)(arrays, shape)
    if isinstance(result, tuple | Frozen):
        return type(result)(**arrays)
    return dict(arrays) if isinstance(result, Mapping) else arrays[""]


@dataclass(eq=False)
class ChunkTask:
    """Callable that returns the result arrays of one chunk. It is pickled at most once, and a process that gets it as
    bytes unpickles it once.
    """

    method: Callable[..., Any]  # of the arguments and options by name
    templates: Mapping[str, Any]  # the arguments by name, with array indices in place of arrays
    options: Mapping[str, Any]  # other arguments
    output_names: tuple[str, ...]  # results that differ from sample to sample
    first_index_name: str | None = None  # argument that gets the index of the chunk's first sample

    @lock_free_cached_property
    def pickled(self) -> bytes:
        """The pickled task, by which Dask names it, so that equal tasks have one name."""
        values = (self.method, self.templates, self.options, self.output_names, self.first_index_name)
        try:
            return pickle.dumps(values)
        except (pickle.PicklingError, AttributeError, TypeError):  # a callable that has no name in a module
            cloudpickle = importlib.import_module("cloudpickle")  # which comes with Dask
            return bytes(cloudpickle.dumps(values))

    def __dask_tokenize__(self) -> bytes:
        return self.pickled

    def __reduce__(self) -> tuple[Any, ...]:
        return load_chunk_task, (self.pickled,)

    def __call__(self, chunk_index: tuple[int, ...], slices: tuple[slice, ...] | None, *blocks: Any) -> Any:
        """Return the result arrays of one chunk as a tuple, or the only array.

        Args:
            chunk_index: index of the chunk, for messages.
            slices: range of the chunk among all samples, by axis; None where sizes of chunks are not known.
            blocks: the arrays of the chunk.
        """
        first = None if slices is None else tuple(one.start for one in slices)
        options = {**self.options, **({} if self.first_index_name is None else {self.first_index_name: first})}
        try:
            result = self.method(
                **_fill_in_arrays(self.templates, [_unwrap_block(block) for block in blocks]), **options
            )
        except ArgumentError as error:
            raise type(error)(f"chunk {chunk_index}: {error.name}", error.expected, error.got) from None
        except Exception as error:
            error.add_note(f"in chunk {chunk_index}")
            raise
        parts = _arrays_by_name(result)
        arrays = tuple(np.asarray(parts[name]) for name in self.output_names)
        return arrays if len(arrays) > 1 else arrays[0]


@functools.lru_cache(maxsize=_TASKS)
def load_chunk_task(pickled: bytes) -> ChunkTask:
    """Return the task of these bytes: equal bytes give the same task, which keeps the kernels that it compiled."""
    return ChunkTask(*pickle.loads(pickled))


def _unwrap_block(nested_block: Any) -> NDArray[Any]:
    """Return the only array in nested lists, in which Dask passes blocks whose axes the results lack."""
    while isinstance(nested_block, list):
        (nested_block,) = nested_block
    masked = isinstance(nested_block, np.ma.MaskedArray)  # which the method refuses by name
    return nested_block if masked else np.asarray(nested_block)


def _make_lazy_arrays(
    task: ChunkTask, chunked_arguments: Sequence[_ChunkedArgument], num_axes: int, result_samples: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the lazy arrays that a task computes, by name; `result_samples` have their shapes and dtypes."""
    from dask.array import blockwise
    from dask.array.core import unify_chunks
    from dask.layers import ArrayBlockIdDep, ArraySliceDep

    sample_axes = tuple(range(num_axes))
    inner_axes = itertools.count(num_axes)  # numbers of the axes of one sample, which no two arrays share
    indices = [
        (
            *sample_axes[num_axes - argument.num_sample_axes :],
            *itertools.islice(inner_axes, len(argument.sample_shape)),
        )
        for argument in chunked_arguments
    ]
    pairs = zip((argument.array for argument in chunked_arguments), indices, strict=True)
    chunks_of, arrays = unify_chunks(*itertools.chain.from_iterable(pairs))
    chunks = tuple(chunks_of[axis] for axis in sample_axes)
    is_known = not any(math.isnan(size) for sizes in chunks for size in sizes)
    ranges = (ArraySliceDep(chunks), sample_axes) if is_known else (None, None)
    inputs = itertools.chain((ArrayBlockIdDep(chunks), sample_axes), ranges, *zip(arrays, indices, strict=True))
    common_options: dict[str, Any] = {
        "align_arrays": False,
        "token": getattr(task.method, "__name__", "hingepair").strip("_"),
    }
    if len(result_samples) > 1:
        meta = np.empty((0,) * num_axes, object)
        packed = blockwise(task, sample_axes, *inputs, dtype=object, meta=meta, **common_options)
    lazy_arrays = {}
    for position, (name, sample) in enumerate(result_samples.items()):
        sample_shape = np.shape(sample)[num_axes:]
        own_inner_axes = tuple(itertools.islice(inner_axes, len(sample_shape)))
        array_options: dict[str, Any] = {
            "new_axes": dict(zip(own_inner_axes, sample_shape, strict=True)),
            "dtype": sample.dtype,
        }
        array_options["meta"] = np.empty((0,) * (num_axes + len(sample_shape)), sample.dtype)
        if len(result_samples) > 1:
            lazy_arrays[name] = blockwise(
                _take_array,
                (*sample_axes, *own_inner_axes),
                packed,
                sample_axes,
                position,
                None,
                **array_options,
                **common_options,
            )
        else:
            lazy_arrays[name] = blockwise(
                task, (*sample_axes, *own_inner_axes), *inputs, **array_options, **common_options
            )
    return lazy_arrays


def _take_array(arrays: tuple[NDArray[Any], ...], position: int) -> NDArray[Any]:
    return arrays[position]
