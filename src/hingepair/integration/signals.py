"""What is given as a function of time: a constant, a callable, or samples at the instants; and where body 1 is.

Samples are interpolated by the polynomial of degree 5 through the six nearest (through all, where there are fewer),
which keeps order 6 of an integral over them.
"""

from __future__ import annotations

import functools
import itertools
import math
import operator
from collections.abc import Callable, Iterator
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.loops import Loop
from hingepair.errors import ArgumentError, HingePairError, ShapeError
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import real_array

POINTS: Final = 6
"""Samples that an interpolating polynomial goes through."""

_POINT = ("R1", "v1", "a1")

_MANY = 8  # runs of steps from sample to sample, for each of which a kernel is called


class Constant:
    """The same value at every time."""

    def __init__(self, value: Array) -> None:
        self.value = value

    def instants(self, times: Array) -> Array:
        """The values at times of any shape."""
        return np.broadcast_to(self.value, times.shape + self.value.shape)

    def nodes(self, start: Array, _: Array, c: tuple[float, ...]) -> Array:
        """The values at the nodes of steps; shape (steps, nodes, ...)."""
        return np.broadcast_to(self.value, (len(start), len(c), *self.value.shape))


class Function:
    """A callable of an array of times."""

    def __init__(self, name: str, function: Callable[[Array], Any], tail: tuple[int, ...]) -> None:
        self.name = name
        self.function = function
        self.tail = tail

    def instants(self, times: Array) -> Array:
        """The values at times of any shape; the callable sees them in a row.

        Raises:
            ShapeError, DtypeError: the callable returns something else than one value for each time.
            ArgumentError: a value is not finite; names the first time.
        """
        row = unmistakable(np.ravel(times), self.tail)
        values = real_array(f"{self.name}(t)", called(self.name, self.function, row))
        wanted = row.shape + self.tail
        if values.shape not in {wanted, self.tail}:
            raise ShapeError(f"{self.name}(t)", f"shape {wanted} for t of shape {row.shape}", f"shape {values.shape}")
        values = np.broadcast_to(values, wanted)[: np.size(times)].astype(np.float64, copy=False)
        if not np.isfinite(values).all():
            first = _first_not_finite(values)
            raise ArgumentError(f"{self.name}(t)", "finite numbers", f"{values[first]} at t = {float(row[first])!r}")
        return values.reshape(times.shape + self.tail)

    def nodes(self, start: Array, h: Array, c: tuple[float, ...]) -> Array:
        """The values at the nodes start + c h of steps; shape (steps, nodes, ...)."""
        return self.instants(start[:, None] + h[:, None] * np.array(c))


class Samples:
    """Values (N,) or (N, k) at the instants, and between them a polynomial through those nearby.

    Only differences of instants that are near each other enter, so that stamps since 1970 are not rounded again.
    """

    def __init__(self, t: Array, values: Array, how: Execution) -> None:
        self.t = t
        self.values = values
        self.how = how
        self._columns = values.reshape(len(values), -1)

    def instants(self, _: Array) -> Array:
        """The samples."""
        return self.values

    def nodes(self, start: Array, h: Array, c: tuple[float, ...]) -> Array:
        """The values at the nodes of steps of which each lies between two samples; shape (steps, nodes, ...)."""
        count = min(POINTS, len(self.t))
        first = int(np.searchsorted(self.t, start[0]))
        if np.array_equal(self.t[first : first + len(start)], start):
            interval = np.arange(first, first + len(start))
        else:
            interval = np.searchsorted(self.t, start, side="right") - 1
        lowest = np.clip(interval - (count // 2 - 1), 0, len(self.t) - count)
        later = np.multiply.outer(c, h).T  # columns: what eight steps have side by side
        found = np.empty((*later.shape, self._columns.shape[1]))
        loop = interpolation(count, len(c), found.shape[2])
        t, columns = sliding_window_view(self.t, count), sliding_window_view(self._columns, count, axis=0)
        for own, rows in _runs(lowest):
            x = (t[rows].T - start[own]).T
            given = {"x": x, "values": columns[rows], "later": later[own]}
            loop.run(given, {"values": found[own]}, x.shape[:1], found.dtype, self.how)
        return found.reshape(*later.shape, *self.values.shape[1:])


def _runs(lowest: NDArray[np.intp]) -> Iterator[tuple[slice, slice | NDArray[np.intp]]]:
    """Steps, and where their samples begin: steps from sample to sample as slices, unless these are many."""
    stops = np.flatnonzero(np.diff(lowest, append=-1) != 1) + 1
    if len(stops) > _MANY:
        yield slice(None), lowest
    else:
        for first, stop in itertools.pairwise((0, *stops.tolist())):
            yield slice(first, stop), slice(lowest[first], lowest[first] + stop - first)


Signal: TypeAlias = Constant | Function | Samples


def read_signal(name: str, value: Any, t: Array, tail: tuple[int, ...], how: Execution) -> Signal:
    """What was given as a signal: a callable of t; one value of shape `tail`; or samples at the instants t.

    Raises:
        ShapeError, DtypeError: it is none of these.
        ArgumentError: a number is not finite; names the index of the first.
    """
    if value is None:
        raise ArgumentError(name, "a callable, a constant, or samples at t", None)
    if callable(value):
        return Function(name, value, tail)
    array = real_array(name, value).astype(np.float64)
    if array.shape not in {tail, t.shape + tail}:
        shapes = f"a callable, a constant of shape {tail}, or samples of shape {t.shape + tail}"
        raise ShapeError(name, shapes, f"shape {array.shape}")
    if not np.isfinite(array).all():
        first = _first_not_finite(array.reshape(-1, *tail))
        where = f" at index {first}" if array.shape != tail else ""
        raise ArgumentError(name, "finite numbers", f"{array.reshape(-1, *tail)[first]}{where}")
    return Constant(array) if array.shape == tail else Samples(t, array, how)


def unmistakable(row: Array, tail: tuple[int, ...]) -> Array:
    """Times, with the last one twice where there are as many as a value has components.

    Array one below the other, (n, 3), and side by side, (3, n), could not be told apart.
    """
    return np.append(row, row[-1]) if row.shape == tail else row


def called(name: str, function: Callable[[Array], Any], times: Array) -> Any:
    """What a callable makes of an array of times, of which it gets a copy: it may work in place.

    Raises:
        ArgumentError: it fails as one made for a single number does; names it.
    """
    try:
        return function(times.copy())
    except HingePairError:
        raise
    except (TypeError, ValueError) as error:
        wanted = "a callable vectorised over t, which takes an array of times as numpy.cos does and math.cos does not"
        raise ArgumentError(name, wanted, f"{type(error).__name__}: {error}") from error


def read_position(R1: Any, t: NDArray[np.float64], size: int) -> dict[str, NDArray[Any]]:
    """R1 and, as far as they are known, v1 and a1; each of shape (size,) or (N, size).

    Given is one point, which stays where it is; a point for each instant; a tuple (R1, v1) or (R1, v1, a1); or a
    callable of t that returns one of these.

    Raises:
        ShapeError, DtypeError, ArgumentError: it is none of these.
    """
    name, times = "R1", t
    if callable(R1):
        times = np.append(t, [t[-1]] * (len(_POINT) + 1 - len(t)))  # more than a tuple has parts, or a point
        name, R1 = "R1(t)", called("R1", R1, times)
    if isinstance(R1, tuple) and len(R1) <= len(_POINT) and len(R1) and np.ndim(R1[0]) > 0:
        if len(R1) == len(times) > 1 and all(np.ndim(part) == 1 for part in R1):
            either = f"an array of shape {(len(t), size)}, or (R1, v1) with R1 of that shape"
            raise ArgumentError(name, either, f"a tuple of {len(t)} points, which could be either")
        return {own: _points(f"{name}[{i}]", R1[i], t, times, size) for i, own in enumerate(_POINT[: len(R1)])}
    if R1 is None:
        raise ArgumentError(name, "a point, points, or (R1, v1, a1)", None)
    point = _points(name, R1, t, times, size)
    if point.ndim == 1:
        return {"R1": point, "v1": np.zeros(size), "a1": np.zeros(size)}
    return {"R1": point}


def _points(name: str, value: Any, t: NDArray[Any], times: NDArray[Any], size: int) -> NDArray[Any]:
    points = real_array(name, value)
    if points.shape not in {(size,), (len(times), size)}:
        raise ShapeError(name, f"shape ({size},) or {(len(times), size)}", f"shape {points.shape}")
    return points if points.ndim == 1 else points[: len(t)]


def _first_not_finite(values: Array) -> int:
    bad = ~np.isfinite(values)
    return int(np.argmax(bad.reshape(len(values), -1).any(axis=1)))


@functools.cache
def interpolation(points: int, nodes: int, columns: int) -> Loop:
    """The values at nodes of polynomials through so many points (columns first), by Lagrange's weights."""

    def interpolate(v: dict[str, Any]) -> dict[str, Any]:
        x = v["x"]
        each = [v["values"][points * k : points * (k + 1)] for k in range(columns)]
        scales = [1 / math.prod(one - other for i, other in enumerate(x) if i != j) for j, one in enumerate(x)]
        found = []
        for node in v["later"]:
            apart = [node - one for one in x]
            below = list(itertools.accumulate(apart[:-1], operator.mul, initial=1.0))
            above = list(itertools.accumulate(apart[:0:-1], operator.mul, initial=1.0))[::-1]
            weights = [s * (p * q) for s, p, q in zip(scales, below, above, strict=True)]
            found += [functools.reduce(operator.add, map(operator.mul, weights, own)) for own in each]
        return {"values": tuple(found)}

    shapes = {"x": (points,), "values": (columns, points), "later": (nodes,)}
    return Loop("interpolation", interpolate, shapes, {"values": (nodes, columns)})
