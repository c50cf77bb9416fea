"""Calls over Dask arrays: one task a chunk, which computes all outputs.

Nothing here imports Dask before an argument is a Dask array.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hingepair.engine.binding import ArrayShape
from hingepair.engine.results import Results
from hingepair.errors import ArgumentError, DtypeError, ShapeError, quoted
from hingepair.numeric.arrays import broadcast_shape, is_zero, real_array


def is_dask(value: Any) -> bool:
    """Return whether a value is a Dask array. While Dask is not imported, none is."""
    arrays: Any = sys.modules.get("dask.array")
    return arrays is not None and isinstance(value, arrays.Array)


def over_chunks(
    function: Callable[..., Any], given: Mapping[str, Any], tails: Sequence[ArrayShape], outputs: Mapping[str, Any]
) -> dict[str, Any]:
    """Return lazy Dask arrays of the outputs of a function, by name.

    Axes of samples may be chunked in any way, and broadcast; the axes of one sample become one chunk.

    Args:
        function: takes an array for each argument, and returns results, or the only output; can be pickled.
        given: the arguments, Dask or NumPy arrays, by the names of messages.
        tails: shape of one sample of each.
        outputs: shape of one sample of each output.

    Raises:
        ArgumentError: an argument has another shape, or no real numbers.
    """
    from dask.array import apply_gufunc

    arrays = []
    for (name, value), tail in zip(given.items(), tails, strict=True):
        array = value if is_dask(value) else np.zeros(tail) if is_zero(value) else real_array(name, value)
        if array.shape[max(0, array.ndim - len(tail)) :] != tail:
            raise ShapeError(name, f"shape (..., {', '.join(map(str, tail))})", f"shape {array.shape}")
        if array.dtype.kind not in "iu" and array.dtype not in (np.float64, np.float32):
            raise DtypeError(name, "real numbers (float64, float32 or integers)", str(array.dtype))
        arrays.append(array)
    leads = {name: one.shape[: one.ndim - len(t)] for name, one, t in zip(given, arrays, tails, strict=True)}
    broadcast_shape({name: lead for name, lead in leads.items() if not np.isnan(lead).any()})  # NaN is unknown
    single = all(array.dtype == np.float32 for array in arrays)
    # A dimension is called by its size.
    left, right = (",".join(f"({','.join(map(str, one))})" for one in shapes) for shapes in (tails, outputs.values()))
    found = apply_gufunc(
        _Chunk(function, tuple(outputs)), f"{left}->{right}", *arrays, allow_rechunk=True,
        output_dtypes=[np.dtype(np.float32 if single else np.float64)] * len(outputs),
        output_sizes={str(size): size for tail in outputs.values() for size in tail},
    )  # fmt: skip
    return dict(zip(outputs, found if len(outputs) > 1 else [found], strict=True))


def refuse_out(out: Any) -> None:
    """Refuse arrays to write into."""
    if out is not None:
        raise ArgumentError("out", "None, since Dask makes its own arrays", quoted(out))


class _Chunk:
    """What a task calls with the arrays of a chunk; returns those of the outputs in order, or the only one."""

    __name__ = "hingepair"  # which the names of the arrays begin with

    def __init__(self, function: Callable[..., Any], outputs: tuple[str, ...]) -> None:
        self.function, self.outputs = function, outputs

    def __call__(self, *arrays: Any) -> Any:
        found = self.function(*arrays)
        results = found.arrays() if isinstance(found, Results) else {self.outputs[0]: found}
        parts = tuple(np.asarray(results[name]) for name in self.outputs)
        return parts if len(parts) > 1 else parts[0]
