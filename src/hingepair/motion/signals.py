"""Signals, rates as functions of time: a constant, a callable, or samples at the instants; and positions of body 1.

A signal may hold many motions, on leading axes.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Final, Self, TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.loops import Loop
from hingepair.errors import ArgumentError, HingePairError, ShapeError
from hingepair.numeric.arrays import FLOAT64, real_array
from hingepair.numeric.arrays import Float64Array as Array

_DEGREE: Final = 5  # of the spline through samples, which keeps order 6 of an integral over them
_NEAR_END: Final = 64  # steps after which an end of the samples changes nothing: coefficients fade by 0.43 a step
_MANY_STEPS: Final = 64  # for which kernels are worth their call
R1_PARTS: Final = {"R1": "R1", "v1": "R1[1]", "a1": "R1[2]"}  # parts of the argument R1, and their names in messages


class _ArraySignal:
    """Values of all motions in one array, the motions on leading axes."""

    def __init__(self, values: Array, motions: tuple[int, ...] = ()) -> None:
        self.values = values
        self.motions = motions

    def _with(self, values: Array, motions: tuple[int, ...]) -> Self:
        return type(self)(values, motions)

    def __getitem__(self, index: Any) -> Self:
        values = self.values[index]
        return self._with(values, values.shape[: values.ndim - self.values.ndim + len(self.motions)])

    def flattened(self, motions: tuple[int, ...]) -> Self:
        """Return the signal with one axis of motions, to which it is broadcast."""
        tail = self.values.shape[len(self.motions) :]
        values = np.broadcast_to(self.values, (*motions, *tail)).reshape(-1, *tail)
        return self._with(values, values.shape[:1])


class ConstantSignal(_ArraySignal):
    """A value that holds at every time: (*motions, ...)."""

    def first_bad(self) -> tuple[tuple[int, ...], str] | None:
        """Return the index of the first motion with a number that is not finite, and its value as text; or None."""
        bad = _first_not_finite(self.values)
        motion = () if bad is None else bad[: len(self.motions)]
        return None if bad is None else (motion, f"{self.values[motion]}")

    def values_at(self, times: Array) -> Array:
        """Return the value at times (N,); (*motions, N, ...)."""
        count = len(self.motions)
        value = np.expand_dims(self.values, count)
        return np.broadcast_to(value, (*self.motions, len(times), *value.shape[count + 1 :]))

    def values_at_nodes(self, start: Array, _: Array, nodes: tuple[float, ...]) -> Array:
        """Return the value at the nodes of steps; (*motions, steps, nodes, ...)."""
        count = len(self.motions)
        value = np.expand_dims(self.values, (count, count + 1))
        return np.broadcast_to(value, (*self.motions, len(start), len(nodes), *value.shape[count + 2 :]))


class CallableSignal:
    """A signal that a user's function of an array of times computes, one for all motions."""

    motions: tuple[int, ...] = ()

    def __init__(self, name: str, function: Callable[[Array], Any], value_shape: tuple[int, ...]) -> None:
        self.name = name  # of the argument, for errors
        self.function = function
        self.value_shape = value_shape

    def first_bad(self) -> None:
        """Return None: values are checked where they are computed."""

    def values_at(self, times: Array) -> Array:
        """Return the values at times of any shape; (*times.shape, ...).

        Raises:
            ShapeError, DtypeError: the function does not return one value for each time, or one for all.
            ArgumentError: the function fails, or a value is not finite.
        """
        row = _pad_ambiguous_times(np.ravel(times), self.value_shape)
        values = real_array(f"{self.name}(t)", _call_with_times(self.name, self.function, row))
        expected = row.shape + self.value_shape
        if values.shape not in {expected, self.value_shape}:
            got = f"shape {values.shape}"
            raise ShapeError(f"{self.name}(t)", f"shape {expected} for t of shape {row.shape}", got)
        values = np.broadcast_to(values, expected)[: np.size(times)].astype(np.float64, copy=False)
        bad = _first_not_finite(values)
        if bad is not None:
            got = f"{values[bad[0]]} at t = {float(row[bad[0]])!r}"
            raise ArgumentError(f"{self.name}(t)", "finite numbers", got)
        return values.reshape(times.shape + self.value_shape)

    def values_at_nodes(self, start: Array, h: Array, nodes: tuple[float, ...]) -> Array:
        """Return the values at the times start + node h; (steps, nodes, ...)."""
        return self.values_at(start[:, None] + h[:, None] * np.array(nodes))


class SampledSignal(_ArraySignal):
    """Samples at instants: (*motions, N) or (*motions, N, k). Only times since the first instant enter, so that
    stamps since 1970 are not rounded again.
    """

    def __init__(self, t: Array, values: Array, motions: tuple[int, ...] = ()) -> None:
        super().__init__(values, motions)
        self.t = t

    def _with(self, values: Array, motions: tuple[int, ...]) -> Self:
        return type(self)(self.t, values, motions)

    def thinned(self) -> SampledSignal:
        """Return the signal of every second sample and the last one, of a single motion. Gaps become longer by a
        sixth: what the samples beside them leave open would not show else.
        """
        kept, h = np.arange(len(self.t)) % 2 == 0, np.diff(self.t)
        for k in np.flatnonzero(h > 4 * np.median(h)):
            ends = self.t[k] - h[k] / 12, self.t[k + 1] + h[k] / 12
            kept[slice(*np.searchsorted(self.t, ends))] = False
        kept[[0, -1]] = True
        return SampledSignal(self.t[kept], self.values[kept])

    def first_bad(self) -> tuple[tuple[int, ...], str] | None:
        """Return the index of the first motion with a number that is not finite, and the sample as text; or None."""
        bad, count = _first_not_finite(self.values), len(self.motions)
        return None if bad is None else (bad[:count], f"{self.values[bad[: count + 1]]} at index {bad[count]}")

    def values_at(self, times: Array) -> Array:
        """Return the samples at `times`, the first of the signal's instants; (*motions, N, ...)."""
        return self.values[(slice(None),) * len(self.motions) + (slice(len(times)),)]

    def values_at_nodes(self, start: Array, h: Array, nodes: tuple[float, ...]) -> Array:
        """Return interpolated values at the nodes of steps; (*motions, steps, nodes, ...)."""
        count, last = len(start), len(self.t) - 1
        first = int(np.searchsorted(self.t, start[0])) if count else 0
        inner = range(max(first, _NEAR_END), min(first + count, last - _NEAR_END))
        # Are these steps from sample to sample, and these evenly spaced?
        if len(inner) < _MANY_STEPS or first + count > last or self._coefficients is None:
            return self._spline_at(start, h, nodes)
        if not np.array_equal(self.t[first : first + count], start) or self.t[first + count] != start[-1] + h[-1]:
            return self._spline_at(start, h, nodes)
        of_all = (slice(None),) * len(self.motions)
        tail = self.values.shape[len(of_all) + 1 :]
        values = np.empty((*self.motions, count, len(nodes), *tail))
        windows = sliding_window_view(self._coefficients, _DEGREE + 1, len(of_all))
        windows = windows[(*of_all, slice(inner.start - 2, inner.stop - 2))]
        inside = np.moveaxis(values[(*of_all, slice(inner.start - first, inner.stop - first))], len(of_all) + 1, -1)
        spline_loop(nodes).run(
            {"coefficients": windows}, {"values": inside}, inside.shape[:-1], FLOAT64, Execution("compiled", 1)
        )
        near = 4 * _NEAR_END
        for part, samples in (
            (slice(0, inner.start - first), slice(0, near)),
            (slice(inner.stop - first, count), slice(-near, None)),
        ):
            if len(start[part]):
                end = SampledSignal(self.t[samples], self.values[(*of_all, samples)], self.motions)
                values[(*of_all, part)] = end._spline_at(start[part], h[part], nodes)
        return values

    def _spline_at(self, start: Array, h: Array, nodes: tuple[float, ...]) -> Array:
        """Return values of the spline at the nodes of any steps."""
        times = (start - self.t[0])[:, None] + h[:, None] * np.array(nodes)
        return np.ascontiguousarray(self._spline(times))

    @functools.cached_property
    def _coefficients(self) -> Array | None:
        """Coefficients of cardinal B-splines, one for each of evenly spaced samples, which are those of the spline
        but near both ends; None where the samples are too few or not evenly spaced.
        """
        from scipy.ndimage import spline_filter1d

        even = np.linspace(self.t[0], self.t[-1], len(self.t))
        if len(self.t) < 8 * _NEAR_END or np.abs(self.t - even).max() > 4 * np.spacing(np.abs(self.t).max()):
            return None
        coefficients: Array = spline_filter1d(self.values, _DEGREE, axis=len(self.motions))
        return coefficients

    @functools.cached_property
    def _spline(self) -> Any:
        """The spline of degree 5 through the samples; of fewer than six, the polynomial through all."""
        from scipy.interpolate import make_interp_spline

        degree = min(_DEGREE, len(self.t) - 1)
        return make_interp_spline(self.t - self.t[0], self.values, degree, axis=len(self.motions), check_finite=False)


@functools.cache
def spline_loop(nodes: tuple[float, ...]) -> Loop:
    """Return the loop from six coefficients of cardinal B-splines to values at nodes between the middle two."""
    from scipy.interpolate import BSpline

    basis = BSpline.basis_element(np.arange(-3, 4), extrapolate=False)
    weights = [[float(basis(node - j)) for j in range(-2, 4)] for node in nodes]

    def values(v: dict[str, Any]) -> dict[str, Any]:
        return {
            "values": tuple(sum((w * c for w, c in zip(row, v["coefficients"], strict=True)), 0.0) for row in weights)
        }

    return Loop("spline", values, {"coefficients": (_DEGREE + 1,)}, {"values": (len(nodes),)})


Signal: TypeAlias = ConstantSignal | CallableSignal | SampledSignal


def read_signal(name: str, value: Any, t: Array, value_shape: tuple[int, ...]) -> Signal:
    """Return a rate as a signal. `value` is a callable of t, a constant of shape `value_shape`, samples (..., N,
    *value_shape), or (..., 1, *value_shape) where the rate of each motion is constant. Whether numbers are finite is
    not checked.
    """
    if value is None:
        raise ArgumentError(name, "a callable, a constant, or samples at t", None)
    if callable(value):
        return CallableSignal(name, value, value_shape)
    array = real_array(name, value).astype(np.float64)
    motions, instant_count = _split_shape(array.shape, value_shape)
    if instant_count not in {1, len(t)} or array.shape[array.ndim - len(value_shape) :] != value_shape:
        samples = ", ".join(map(str, ("...", len(t), *value_shape)))
        expected = f"a callable, a constant of shape {value_shape}, or samples of shape ({samples})"
        raise ShapeError(name, expected, f"shape {array.shape}")
    if array.shape == value_shape or instant_count < len(t):
        return ConstantSignal(array.reshape((*motions, *value_shape)), motions)
    return SampledSignal(t, array, motions)


def _split_shape(shape: tuple[int, ...], value_shape: tuple[int, ...]) -> tuple[tuple[int, ...], int]:
    """Return the leading shape of the motions and the number of instants of an array (..., N, *value_shape). A single
    value counts as one instant of one motion.
    """
    leading = shape[: len(shape) - len(value_shape)]
    return leading[:-1], leading[-1] if leading else 1


def _pad_ambiguous_times(times: Array, value_shape: tuple[int, ...]) -> Array:
    """Return times (n,), with the last one repeated if `value_shape` is (n,) too: of 3 times, vectors by rows (n, 3)
    could not be told from vectors by columns (3, n).
    """
    return np.append(times, times[-1]) if times.shape == value_shape else times


def _call_with_times(name: str, function: Callable[[Array], Any], times: Array) -> Any:
    """Return what a user's function gives for times (n,); its TypeError or ValueError becomes an ArgumentError."""
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
    """Return the arrays R1 and, as far as they are known, v1 and a1, each of shape (dimension,), (..., 1, dimension)
    or (..., N, dimension). `R1` is a point, which is at rest; points (..., 1, dimension) at rest; points for each
    instant; a tuple (R1, v1) or (R1, v1, a1); or a callable of t that returns one of these.
    """
    name, times = "R1", t
    if callable(R1):
        # More instants than a tuple has parts or a point has coordinates.
        times = np.append(t, [t[-1]] * (len(R1_PARTS) + 1 - len(t)))
        name, R1 = "R1(t)", _call_with_times("R1", R1, times)
    if isinstance(R1, tuple) and len(R1) <= len(R1_PARTS) and len(R1) and np.ndim(R1[0]) > 0:
        if len(R1) == len(times) > 1 and all(np.ndim(part) == 1 for part in R1):
            expected = f"an array of shape {(len(t), dimension)}, or (R1, v1) with R1 of that shape"
            raise ArgumentError(name, expected, f"a tuple of {len(t)} points, which could be either")
        names = list(R1_PARTS)[: len(R1)]
        return {part: _read_points(f"{name}[{i}]", R1[i], t, times, dimension) for i, part in enumerate(names)}
    if R1 is None:
        raise ArgumentError(name, "a point, points, or (R1, v1, a1)", None)
    point = _read_points(name, R1, t, times, dimension)
    if point.ndim == 1 or point.shape[-2] < len(t):
        return {"R1": point, "v1": np.zeros(dimension), "a1": np.zeros(dimension)}
    return {"R1": point}


def _read_points(name: str, value: Any, t: NDArray[Any], times: NDArray[Any], dimension: int) -> NDArray[Any]:
    """Return points as an array; of a point for each of `times`, those at the instants t, with which they begin."""
    points = real_array(name, value)
    if points.shape[-1:] != (dimension,) or _split_shape(points.shape, (dimension,))[1] not in {1, len(times)}:
        expected = f"shape ({dimension},) or (..., {len(times)}, {dimension})"
        raise ShapeError(name, expected, f"shape {points.shape}")
    return points if points.ndim == 1 else points[..., : len(t), :]


def _first_not_finite(values: Array) -> tuple[int, ...] | None:
    """Return the index of the first number that is not finite; None if all are."""
    bad = ~np.isfinite(values)
    return tuple(int(i) for i in np.unravel_index(np.argmax(bad), bad.shape)) if bad.any() else None
