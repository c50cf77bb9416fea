"""Rates as functions of time: a constant, a callable, or samples at the instants; and positions of body 1."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.loops import Loop
from hingepair.errors import ArgumentError, ShapeError
from hingepair.mechanism.bodies.hinge_load import call_with_arrays
from hingepair.numeric.arrays import FLOAT64, real_array
from hingepair.numeric.arrays import Float64Array as Array

_DEGREE: Final = 5  # of the spline through samples, which keeps order 6 of an integral over them
_NEAR_END: Final = 64  # even samples after which an end changes nothing: effects fade by 0.43 a sample


class ConstantSignal:
    """A value that holds at every time."""

    def __init__(self, values: Array) -> None:
        self.values = values

    def values_at(self, times: Array) -> Array:
        """Return the value at times (N,); (N, ...)."""
        return np.broadcast_to(self.values, (len(times), *self.values.shape))

    def values_at_nodes(self, start: Array, _: Array, nodes: tuple[float, ...]) -> Array:
        """Return the value at the nodes of steps; (steps, nodes, ...)."""
        return np.broadcast_to(self.values, (len(start), len(nodes), *self.values.shape))


class CallableSignal:
    """A signal that a user's function of an array of times computes."""

    def __init__(self, name: str, function: Callable[[Array], Any], value_shape: tuple[int, ...]) -> None:
        self.name = name  # of the argument, for errors
        self.function = function
        self.value_shape = value_shape

    def values_at(self, times: Array) -> Array:
        """Return the values at times of any shape; (*times.shape, ...).

        Raises:
            ShapeError, DtypeError: the function does not return one value for each time, or one for all.
            ArgumentError: the function fails, or a value is not finite.
        """
        row = np.ravel(times)
        if row.shape == self.value_shape:  # of 3 times, vectors by rows (n, 3) could not be told from columns (3, n)
            row = np.append(row, row[-1])
        name, expected = f"{self.name}(t)", row.shape + self.value_shape
        values = real_array(name, call_with_arrays(self.name, self.function, row.copy()))
        if values.shape not in {expected, self.value_shape}:
            raise ShapeError(name, f"shape {expected} for t of shape {row.shape}", f"shape {values.shape}")
        values = np.broadcast_to(values, expected)[: np.size(times)].astype(np.float64, copy=False)
        bad = _first_not_finite(values)
        if bad is not None:
            raise ArgumentError(name, "finite numbers", f"{values[bad]} at t = {float(row[bad])!r}")
        return values.reshape(times.shape + self.value_shape)

    def values_at_nodes(self, start: Array, h: Array, nodes: tuple[float, ...]) -> Array:
        """Return the values at the times start + node h; (steps, nodes, ...)."""
        return self.values_at(start[:, None] + h[:, None] * np.array(nodes))


class SampledSignal:
    """Samples at instants (N,) or (N, k), and the spline of degree 5 through them; of fewer than six samples, the
    polynomial through all. Only times since the first instant enter, so that stamps since 1970 are not rounded again.
    """

    def __init__(self, t: Array, values: Array) -> None:
        self.t = t
        self.values = values
        self._degree = min(_DEGREE, len(t) - 1)
        self.spline: Any = None  # knots and coefficients (columns, ...), once they are computed

    def thinned(self) -> SampledSignal:
        """Return the signal of every second sample and the last one. Gaps become longer by a sixth: what the samples
        beside them leave open would not show else.
        """
        kept, h = np.arange(len(self.t)) % 2 == 0, np.diff(self.t)
        for k in np.flatnonzero(h > 4 * np.median(h)):
            ends = self.t[k] - h[k] / 12, self.t[k + 1] + h[k] / 12
            kept[slice(*np.searchsorted(self.t, ends))] = False
        kept[[0, -1]] = True
        return SampledSignal(self.t[kept], self.values[kept])

    def values_at(self, times: Array) -> Array:
        """Return the samples at `times`, the first of the signal's instants; (N, ...)."""
        return self.values[: len(times)]

    def values_at_nodes(self, start: Array, h: Array, nodes: tuple[float, ...]) -> Array:
        """Return interpolated values at the nodes of steps between neighbouring samples; (steps, nodes, ...)."""
        degree, count, tail = self._degree, len(start), self.values.shape[1:]
        if not degree or not count:
            return np.broadcast_to(self.values[:1, None], (count, len(nodes), *tail))
        if self.spline is None:
            interpolate([self])
        knots, coefficients = self.spline
        first: Any = int(np.searchsorted(self.t, start[0]))
        from_samples = np.array_equal(self.t[first : first + count], start)
        if not from_samples:
            first = np.minimum(np.searchsorted(self.t, start, side="right") - 1, len(self.t) - 2)

        def around(row: Array, size: int) -> list[Array]:
            """Return the numbers at and after the first of each step, as `size` arrays."""
            return [row[first + k : first + k + count] if from_samples else row[first + k] for k in range(size)]

        near = around(knots, 2 * degree + 1)[1:]
        weighted = tuple(one for row in coefficients for one in around(row, degree + 1))
        inputs = {
            **{"knots": tuple(near), "coefficients": weighted},
            **{"begin": start - self.t[0] - near[degree - 1], "h": h},
        }
        values = np.empty((count, len(nodes), len(coefficients)))
        loop = spline_loop(degree, len(coefficients), nodes)
        loop.run(inputs, {"values": values}, (count,), FLOAT64, Execution("compiled", 1))
        return values.reshape(count, len(nodes), *tail)


def interpolate(signals: Sequence[Any]) -> None:
    """Compute the splines of SampledSignals with the same instants."""
    from scipy.ndimage import spline_filter1d

    if not signals or len(signals[0].t) < 2:
        return
    t = signals[0].t - signals[0].t[0]
    rows = np.ascontiguousarray(np.concatenate([one.values.reshape(len(t), -1).T for one in signals]))
    even = np.linspace(0.0, t[-1], len(t))
    if len(t) >= 8 * _NEAR_END and np.abs(t - even).max() <= 4 * np.spacing(np.abs(signals[0].t).max()):
        # A filter is five times as fast, but near the ends, which are those of shorter splines.
        coefficients = np.empty((len(rows), len(t) + _DEGREE - 1))
        spline_filter1d(rows, _DEGREE, output=coefficients[:, 2:-2])
        near = 2 * _NEAR_END
        coefficients[:, :near] = _coefficients(t[: 2 * near], rows[:, : 2 * near])[:, :near]
        coefficients[:, -near:] = _coefficients(t[-2 * near :], rows[:, -2 * near :])[:, -near:]
    else:
        coefficients = _coefficients(t, rows)
    knots = np.pad(t, signals[0]._degree, mode="edge")
    ends = np.cumsum([one.values[0].size for one in signals])
    for one, own in zip(signals, np.split(coefficients, ends[:-1]), strict=True):
        one.spline = knots, own


def _coefficients(t: Array, rows: Array) -> Array:
    """Return the coefficients of the splines through rows of samples, with knots at all instants."""
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(t, rows.T, min(_DEGREE, len(t) - 1), check_finite=False)
    for knot in {*t[1:3].tolist(), *t[-3:-1].tolist()} - {float(t[0]), float(t[-1])}:  # where it has none
        spline = spline.insert_knot(knot)
    return np.ascontiguousarray(spline.c.T)


@functools.cache
def spline_loop(degree: int, columns: int, nodes: tuple[float, ...]) -> Loop:
    """Return the loop from the knots and coefficients around a piece of a spline to its values at the nodes of a step
    that begins at a time `begin` since the piece (de Boor; Piegl, Tiller, *The NURBS Book*, A2.2).
    """

    def values(v: dict[str, Any]) -> dict[str, Any]:
        knots, c, here = v["knots"], v["coefficients"], degree - 1
        left = [knots[here] - knots[here - k] for k in range(degree)]  # from knots before the piece to its start
        right = [knots[here + 1 + k] - knots[here] for k in range(degree)]
        inverse = {(j, k): 1.0 / (left[j] + right[k]) for j in range(degree) for k in range(degree - j)}
        found: list[Any] = []
        for node in nodes:
            x = v["begin"] + v["h"] * node
            basis = [1.0]
            for order in range(degree):
                shares = [part * inverse[order - k, k] for k, part in enumerate(basis)]
                up = [share * (x + left[order - k]) for k, share in enumerate(shares)]
                down = [share * (right[k] - x) for k, share in enumerate(shares)]
                basis = [down[0], *(a + b for a, b in zip(up[:-1], down[1:], strict=True)), up[-1]]
            parts = ([w * one for w, one in zip(basis, c[k * (degree + 1) :], strict=False)] for k in range(columns))
            found += [sum(own[1:], own[0]) for own in parts]
        return {"values": tuple(found)}

    inputs = {"knots": (2 * degree,), "coefficients": (columns, degree + 1), "begin": (), "h": ()}
    return Loop("spline", values, inputs, {"values": (len(nodes), columns)})


Signal: TypeAlias = ConstantSignal | CallableSignal | SampledSignal


def read_signal(name: str, value: Any, t: Array, value_shape: tuple[int, ...]) -> Signal:
    """Return a rate as a signal. `value` is a callable of t, a constant of shape `value_shape`, or samples (N,
    *value_shape).
    """
    if value is None:
        raise ArgumentError(name, "a callable, a constant, or samples at t", None)
    if callable(value):
        return CallableSignal(name, value, value_shape)
    array = real_array(name, value).astype(np.float64)
    sampled = array.shape == (len(t), *value_shape)
    if not sampled and array.shape != value_shape:
        expected = f"a callable, a constant of shape {value_shape}, or samples of shape {(len(t), *value_shape)}"
        raise ShapeError(name, f"{expected}; of several motions one at a time", f"shape {array.shape}")
    bad = _first_not_finite(array)
    if bad is not None:
        raise ArgumentError(name, "finite numbers", f"{array[bad]} at index {bad}" if sampled else f"{array}")
    return SampledSignal(t, array) if sampled else ConstantSignal(array)


def read_position(R1: Any, t: NDArray[np.float64], size: int = 3) -> dict[str, NDArray[Any]]:
    """Return the arrays R1 and, as far as they are known, v1 and a1, each of shape (size,) or (N, size).
    `R1` is a point, which is at rest; points at t; a tuple (R1, v1) or (R1, v1, a1); or a callable of t that returns
    one of these.
    """
    R1 = call_with_arrays("R1", R1, t.copy()) if callable(R1) else R1
    parts = {"R1": R1}
    if isinstance(R1, tuple) and 0 < len(R1) <= 3 and np.ndim(R1[0]) > 0:
        parts = {f"R1[{i}]": part for i, part in enumerate(R1)}
    found = {}
    for key, (label, value) in zip(("R1", "v1", "a1"), parts.items(), strict=False):
        if value is None:
            raise ArgumentError(label, "a point, points, or (R1, v1, a1)", None)
        found[key] = real_array(label, value)
        if found[key].shape not in {(size,), (len(t), size)}:
            raise ShapeError(label, f"shape {(size,)} or {(len(t), size)}", f"shape {found[key].shape}")
    if "R1" in parts and found["R1"].ndim == 1:  # one point, at rest
        found |= {"v1": np.zeros(size), "a1": np.zeros(size)}
    return found


def _first_not_finite(values: Array) -> tuple[int, ...] | None:
    """Return the index of the first row with a number that is not finite, () of a single value; None if all are."""
    bad = ~np.isfinite(values)
    return tuple(int(i) for i in np.unravel_index(np.argmax(bad), bad.shape))[:1] if bad.any() else None
