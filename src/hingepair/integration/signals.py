"""Signals, rates as functions of time: a constant, a callable, or samples at the instants; and positions of body 1.

Samples are interpolated by the polynomial of degree 5 through the six nearest (through all, where there are fewer),
which keeps order 6 of an integral over them.
"""

from __future__ import annotations

import functools
import itertools
import math
import operator
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.loops import Loop
from hingepair.errors import ArgumentError, HingePairError, ShapeError
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import real_array

INTERPOLATION_POINT_COUNT: Final = 6
"""Samples that an interpolating polynomial goes through; its degree is one less."""

_R1_TUPLE_PART_NAMES = ("R1", "v1", "a1")  # of the parts of a tuple that is given as R1


class ConstantSignal:
    """Signal that has one value at every time, for one motion or for each of many motions. `values_at` and
    `values_at_nodes` return it as arrays.
    """

    motions: tuple[int, ...]  # leading shape of the motions; () for one

    def __init__(self, value: Array, motions: tuple[int, ...] = ()) -> None:
        self.value = value
        self.motions = motions

    def values_at(self, times: Array) -> Array:
        """Return the constant value at times of any shape, as a read-only array (*times.shape, ...)."""
        return np.broadcast_to(self.value, times.shape + self.value.shape)

    def values_at_nodes(self, start: Array, _: Array, nodes: tuple[float, ...]) -> Array:
        """Return the value, repeated for the nodes of steps; shape (steps, nodes, ...), of many motions (*motions,
        steps, nodes, ...). `start` gives only the number of the steps; their lengths, the second argument, are not
        used.
        """
        motions, value_shape = self.motions, self.value.shape[len(self.motions) :]
        value = self.value.reshape(*motions, 1, 1, *value_shape)
        return np.broadcast_to(value, (*motions, len(start), len(nodes), *value_shape))


class CallableSignal:
    """Signal whose values a callable of an array of times computes, called by `values_at` and `values_at_nodes`;
    `name` is the name of the argument in errors.
    """

    motions: tuple[int, ...] = ()

    def __init__(self, name: str, function: Callable[[Array], Any], value_shape: tuple[int, ...]) -> None:
        self.name = name
        self.function = function
        self.value_shape = value_shape

    def values_at(self, times: Array) -> Array:
        """Return the callable's values at times of any shape; the callable gets the times as an array (n,). Raise an
        ArgumentError if the callable fails, if a value is not finite, or if there is neither one value for each time
        nor one for all times.

        Raises:
            ShapeError, DtypeError: the callable does not return one value for each time.
            ArgumentError: a value is not finite; names the first time.
        """
        row = pad_ambiguous_times(np.ravel(times), self.value_shape)
        values = real_array(f"{self.name}(t)", call_with_times(self.name, self.function, row))
        expected = row.shape + self.value_shape
        if values.shape not in {expected, self.value_shape}:
            got = f"shape {values.shape}"
            raise ShapeError(f"{self.name}(t)", f"shape {expected} for t of shape {row.shape}", got)
        values = np.broadcast_to(values, expected)[: np.size(times)].astype(np.float64, copy=False)
        if not np.isfinite(values).all():
            first = _first_not_finite(values)
            raise ArgumentError(f"{self.name}(t)", "finite numbers", f"{values[first]} at t = {float(row[first])!r}")
        return values.reshape(times.shape + self.value_shape)

    def values_at_nodes(self, start: Array, h: Array, nodes: tuple[float, ...]) -> Array:
        """Return the callable's values at the nodes of steps, the times start + node h; shape (steps, nodes, ...)."""
        return self.values_at(start[:, None] + h[:, None] * np.array(nodes))


class SampledSignal:
    """Signal of samples (N,) or (N, k) of one or of many motions at their instants. `values_at` returns the samples,
    and `values_at_nodes` values that are interpolated by polynomials through the nearest samples.

    Only differences of neighbouring instants enter, so that stamps since 1970 are not rounded again.
    """

    motions: tuple[int, ...]  # leading shape of the motions, whose values are (..., N) or (..., N, k); () for one

    def __init__(self, t: Array, values: Array, execution: Execution, motions: tuple[int, ...] = ()) -> None:
        self.t = t
        self.values = values
        self.execution = execution
        self.motions = motions
        self._columns = values.reshape(*motions, len(t), -1)

    def values_at(self, _: Array) -> Array:
        """Return all samples, at their own instants; the times are not used."""
        return self.values

    def values_at_nodes(self, start: Array, h: Array, nodes: tuple[float, ...]) -> Array:
        """Return interpolated values at the nodes of steps; shape (steps, nodes, ...). The steps begin at `start` and
        have the lengths h [s]; `nodes` are fractions of the lengths. No step may extend beyond the two samples around
        its start.
        """
        count = min(INTERPOLATION_POINT_COUNT, len(self.t))
        first = int(np.searchsorted(self.t, start[0]))
        if np.array_equal(self.t[first : first + len(start)], start):
            interval = np.arange(first, first + len(start))
        else:
            interval = np.searchsorted(self.t, start, side="right") - 1
        lowest = np.clip(interval - (count // 2 - 1), 0, len(self.t) - count)
        offsets = np.multiply.outer(nodes, h).T  # by columns, so that eight steps lie side by side in memory
        motions, column_count = self.motions, self._columns.shape[-1]
        values = np.empty((*motions, *offsets.shape, column_count))
        loop = interpolation_loop(count, len(nodes), column_count)
        t, columns = sliding_window_view(self.t, count), sliding_window_view(self._columns, count, axis=-2)
        for steps, rows in _runs_of_consecutive_steps(lowest):
            x = (t[rows].T - start[steps]).T
            arguments = {"x": x, "values": columns[..., rows, :, :], "offsets": offsets[steps]}
            out = {"values": values[..., steps, :, :]}
            loop.run(arguments, out, (*motions, len(x)), values.dtype, self.execution)
        return values.reshape(*motions, *offsets.shape, *self.values.shape[len(motions) + 1 :])


def _runs_of_consecutive_steps(first_samples: NDArray[np.intp]) -> Iterator[tuple[slice, slice | NDArray[np.intp]]]:
    """Yield a pair of slices for each run of steps whose first samples are consecutive: the slice of the steps and
    the slice of their first samples. `first_samples` holds the index of the first sample of each step. If there are
    more than 8 runs, yield one pair instead, the slice of all steps and the array `first_samples`.
    """
    stops = np.flatnonzero(np.diff(first_samples, append=-1) != 1) + 1
    if len(stops) > 8:  # each slice takes a kernel call; more runs share one call
        yield slice(None), first_samples
    else:
        for first, stop in itertools.pairwise((0, *stops.tolist())):
            yield slice(first, stop), slice(first_samples[first], first_samples[first] + stop - first)


Signal: TypeAlias = ConstantSignal | CallableSignal | SampledSignal


def read_signals(
    name: str, value: Any, t: Array, value_shape: tuple[int, ...], execution: Execution
) -> NDArray[np.object_]:
    """Return a rate as an array of signals, one for each motion; the array has the motions' shape, () for one.
    `value` is the rate as the user gives it, a callable of t, a constant of shape `value_shape`, or samples at the
    instants t. Raise an ArgumentError that names the argument `name` if the rate is of another kind or shape.

    The rate of many motions is an array (..., N, *value_shape), or (..., 1, *value_shape) where the rate of each
    motion is constant.

    Raises:
        ShapeError, DtypeError, ArgumentError: the value is none of these. Whether numbers are finite is not checked.
    """
    if value is None:
        raise ArgumentError(name, "a callable, a constant, or samples at t", None)
    if callable(value):
        return object_array((), [CallableSignal(name, value, value_shape)])
    array = real_array(name, value).astype(np.float64)
    motions_shape, instant_count = _split_shape(array.shape, value_shape)
    is_constant = array.shape == value_shape
    if instant_count not in {1, len(t)} or array.shape[array.ndim - len(value_shape) :] != value_shape:
        samples = ", ".join(map(str, ("...", len(t), *value_shape)))
        expected = f"a callable, a constant of shape {value_shape}, or samples of shape ({samples})"
        raise ShapeError(name, expected, f"shape {array.shape}")
    rows = array.reshape(*motions_shape, instant_count, *value_shape)
    are_constant = is_constant or instant_count < len(t)
    signals = [
        ConstantSignal(rows[index][0]) if are_constant else SampledSignal(t, rows[index], execution)
        for index in np.ndindex(motions_shape)
    ]
    return object_array(motions_shape, signals)


def check_finite_values(name: str, signal: Signal) -> None:
    """Raise an ArgumentError if the constant or a sample of one motion's Signal is not finite. The error names the
    argument `name` and the index of the first such sample. A callable is not checked.
    """
    if isinstance(signal, ConstantSignal) and not np.isfinite(signal.value).all():
        raise ArgumentError(name, "finite numbers", f"{signal.value}")
    if isinstance(signal, SampledSignal) and not np.isfinite(signal.values).all():
        first = _first_not_finite(signal.values)
        raise ArgumentError(name, "finite numbers", f"{signal.values[first]} at index {first}")


def _split_shape(shape: tuple[int, ...], value_shape: tuple[int, ...]) -> tuple[tuple[int, ...], int]:
    """Return a pair: the leading shape of the motions, and the number of instants. `shape` is the shape of an array
    of samples, (..., N, *value_shape), or of a single value, value_shape. A single value counts as one instant of one
    motion.
    """
    leading = shape[: len(shape) - len(value_shape)]
    return leading[:-1], leading[-1] if leading else 1


def object_array(shape: tuple[int, ...], values: Sequence[Any]) -> NDArray[np.object_]:
    """Return an array of objects with the given shape, filled with values in C order."""
    array = np.empty(len(values), object)
    array[:] = values
    return array.reshape(shape)


def stack_signals(signals: Sequence[Signal]) -> Signal:
    """Return one signal that has the values of M signals of one kind, constants or samples, for M motions. If all are
    the same object, return that signal.
    """
    first = signals[0]
    if all(signal is first for signal in signals):
        return first
    if isinstance(first, SampledSignal):
        values = np.stack([signal.values for signal in signals if isinstance(signal, SampledSignal)])
        return SampledSignal(first.t, values, first.execution, (len(signals),))
    return ConstantSignal(np.stack([s.value for s in signals if isinstance(s, ConstantSignal)]), (len(signals),))


def values_at(signals: NDArray[np.object_], t: Array, value_shape: tuple[int, ...]) -> Array:
    """Return the values of the signals of all motions at their instants t; shape (..., N, *value_shape). `signals` is
    an array of Signal objects, one for each motion.
    """
    rows = [signal.values_at(t) for signal in signals.ravel()]
    return rows[0] if signals.shape == () else np.array(rows).reshape(*signals.shape, len(t), *value_shape)


def pad_ambiguous_times(times: Array, value_shape: tuple[int, ...]) -> Array:
    """Return times (n,), with the last one repeated if `value_shape` is (n,) too. An array (n, n) of values, whose
    axes cannot be told apart, can then not occur.

    For n = 3 times, an array of vectors by rows, (n, 3), cannot be distinguished from one by columns, (3, n).
    """
    return np.append(times, times[-1]) if times.shape == value_shape else times


def call_with_times(name: str, function: Callable[[Array], Any], times: Array) -> Any:
    """Call a user's function with a copy of the times (n,), and return what it returns. Raise an ArgumentError that
    names the argument `name` if the function fails with a TypeError or a ValueError.
    """
    try:
        return function(times.copy())
    except HingePairError:
        raise
    except (TypeError, ValueError) as error:
        expected = (
            "a callable vectorised over t, which takes an array of times as numpy.cos does and math.cos does not"
        )
        raise ArgumentError(name, expected, f"{type(error).__name__}: {error}") from error


def read_position(R1: Any, t: NDArray[np.float64], dimension: int) -> dict[str, NDArray[Any]]:
    """Return a dict of the array R1 and, if they are known, the arrays v1 and a1, each of shape (dimension,), (...,
    1, dimension) or (..., N, dimension). `R1` is the argument of the user: points, a tuple (R1, v1) or (R1, v1, a1),
    or a callable of t. A point at rest has zeros as v1 and a1. Raise an ArgumentError if R1 is of another kind or
    shape.

    R1 is one point, which stays where it is, of many motions (..., 1, dimension); a point for each instant, (...,
    N, dimension); a tuple (R1, v1) or (R1, v1, a1); or a callable of t that returns one of these.

    Raises:
        ShapeError, DtypeError, ArgumentError: R1 is none of these.
    """
    name, times = "R1", t
    if callable(R1):
        times = np.append(
            t, [t[-1]] * (len(_R1_TUPLE_PART_NAMES) + 1 - len(t))
        )  # more instants than a tuple has parts or a point has coordinates
        name, R1 = "R1(t)", call_with_times("R1", R1, times)
    if isinstance(R1, tuple) and len(R1) <= len(_R1_TUPLE_PART_NAMES) and len(R1) and np.ndim(R1[0]) > 0:
        if len(R1) == len(times) > 1 and all(np.ndim(part) == 1 for part in R1):
            expected = f"an array of shape {(len(t), dimension)}, or (R1, v1) with R1 of that shape"
            raise ArgumentError(name, expected, f"a tuple of {len(t)} points, which could be either")
        names = _R1_TUPLE_PART_NAMES[: len(R1)]
        return {part: _read_points(f"{name}[{i}]", R1[i], t, times, dimension) for i, part in enumerate(names)}
    if R1 is None:
        raise ArgumentError(name, "a point, points, or (R1, v1, a1)", None)
    point = _read_points(name, R1, t, times, dimension)
    if point.ndim == 1 or point.shape[-2] < len(t):
        return {"R1": point, "v1": np.zeros(dimension), "a1": np.zeros(dimension)}
    return {"R1": point}


def _read_points(name: str, value: Any, t: NDArray[Any], times: NDArray[Any], dimension: int) -> NDArray[Any]:
    """Return points as an array, (dimension,) or (..., 1, dimension) for points at rest, otherwise (..., N,
    dimension) at the N instants t. `value` must have one point, or one for each of `times`, which begin with the
    instants; the further points are dropped. Raise a ShapeError that names the argument `name` for another shape.
    """
    points = real_array(name, value)
    if points.shape[-1:] != (dimension,) or _split_shape(points.shape, (dimension,))[1] not in {1, len(times)}:
        expected = f"shape ({dimension},) or (..., {len(times)}, {dimension})"
        raise ShapeError(name, expected, f"shape {points.shape}")
    return points if points.ndim == 1 else points[..., : len(t), :]


def _first_not_finite(values: Array) -> int:
    """Return the index of the first row that holds a value that is not finite."""
    bad = ~np.isfinite(values)
    return int(np.argmax(bad.reshape(len(values), -1).any(axis=1)))


@functools.cache
def interpolation_loop(sample_count: int, node_count: int, column_count: int) -> Loop:
    """Return the cached `Loop` that evaluates interpolating polynomials at `node_count` nodes of each step. The
    polynomials of a step go through `sample_count` samples of `column_count` columns.
    """

    def interpolate(v: dict[str, Any]) -> dict[str, Any]:
        """Return the interpolated values at the nodes of one step as {"values": ...}. `v` is a dict of the times x
        and the values of the samples, and the times `offsets` of the nodes; all times are relative to the start of
        the step.
        """
        x = v["x"]
        samples = [v["values"][sample_count * k : sample_count * (k + 1)] for k in range(column_count)]
        scales = [1 / math.prod(one - other for i, other in enumerate(x) if i != j) for j, one in enumerate(x)]
        values = []
        for node in v["offsets"]:
            distances = [node - one for one in x]
            before = list(itertools.accumulate(distances[:-1], operator.mul, initial=1.0))
            after = list(itertools.accumulate(distances[:0:-1], operator.mul, initial=1.0))[::-1]
            weights = [s * (p * q) for s, p, q in zip(scales, before, after, strict=True)]
            values += [functools.reduce(operator.add, map(operator.mul, weights, column)) for column in samples]
        return {"values": tuple(values)}

    shapes = {"x": (sample_count,), "values": (column_count, sample_count), "offsets": (node_count,)}
    return Loop("interpolation", interpolate, shapes, {"values": (node_count, column_count)})
