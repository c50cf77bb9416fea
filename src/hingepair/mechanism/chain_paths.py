"""The way of a chain of joints that one coordinate drives: followed once, and fitted by series, from which the Newton
steps of programs start.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import Float64Array
from hingepair.plans.closures import Series

_GRID: Final = 256  # points of a full turn, or of a range, to which a start is fitted
_MAX_TERMS: Final = 60  # of a series
_TERMS_OF_STEP: Final = 8  # as many terms take the time of a Newton step
_NEAR: Final = 1e-2  # from starts with a larger error, Newton steps may lead to another assembly
_EXACT: Final = 2e-15  # of the size of the mechanism; a series that leaves no larger gap needs no Newton step
_MAX_REACH: Final = 20.0  # multiples of its size [m] by which a length or a slider is followed


class Start(NamedTuple):
    """Where programs begin to close a chain, see `plans.closures.Chains`."""

    kind: str
    terms: int
    steps: int
    numbers: list[float]


class _Point(NamedTuple):
    """Where a chain is closed."""

    s: float  # the coordinate that drives it
    x: Float64Array  # its dependent coordinates
    slope: Float64Array  # dx/ds


class ChainPath:
    """The way of a chain.

    Args:
        conditions: function of values by key and of keys, which returns the conditions of the chain and their
            derivatives by these keys.
        key: of the coordinate that drives it.
        dependent: keys of the coordinates that follow.
        turns: for each of these, whether it is an angle.
        values: values by key where the chain is assembled.
        size: of the mechanism [m].
        shifts: whether the coordinate that drives it is a length.
    """

    def __init__(
        self,
        conditions: Callable[[Mapping[int, float], Sequence[int]], tuple[Any, Any]],
        key: int,
        dependent: Sequence[int],
        turns: Sequence[bool],
        values: Mapping[int, float],
        size: float,
        shifts: bool,
    ) -> None:
        self._conditions, self._key, self._dependent, self._turns = conditions, key, dependent, turns
        self._size, self._shifts = size, shifts
        self._unit = size if shifts else 1.0  # what counts as a long step: the size of the mechanism, or a radian
        s, x = values[key], np.array([values[column] for column in dependent])
        _, A, B = self._linear(s, x)
        self._home = _Point(s, x, np.linalg.lstsq(A, -B, rcond=None)[0])

    def reached(self, s: float) -> Float64Array | None:
        """Return the dependent coordinates at s; None where the way ends before."""
        point, there = self._advance(self._home, s)
        return point.x if there else None

    def start(self, wanted: Sequence[int]) -> Start:
        """Return the start for some of the dependent coordinates."""
        places = [self._dependent.index(key) for key in wanted]
        found = None if self._shifts else self._turn(places)
        return self._range(places) if found is None else found

    def _linear(self, s: float, x: Float64Array) -> tuple[Any, Any, Any]:
        """Return conditions, and their derivatives by the dependent coordinates and by the one that drives."""
        keys = [*self._dependent, self._key]
        gaps, A = self._conditions(dict(zip(keys, (*x.tolist(), s), strict=True)), keys)
        return gaps, A[:, :-1], A[:, -1]

    def _closed(self, s: float, x: Float64Array) -> _Point | None:
        """Return the closed assembly next to coordinates; None if Newton steps do not lead to one close by."""
        for _ in range(7):
            gaps, A, B = self._linear(s, x)
            if not np.isfinite(gaps).all():
                return None
            step, slope = np.linalg.lstsq(A, np.stack((gaps, -B), axis=1), rcond=None)[0].T
            if np.abs(step).max() < 1e-13 * max(1.0, np.abs(x).max()):
                return _Point(s, x - step, slope) if np.linalg.norm(gaps) < 1e-11 * self._size else None
            x = x - step
        return None

    def _advance(self, point: _Point, target: float) -> tuple[_Point, bool]:
        """Follow the chain to s = target, in steps as short as they must be; False where it ends before."""
        step = target - point.s
        while abs(target - point.s) > 1e-15 * max(1.0, abs(target)):
            step = math.copysign(min(abs(step), abs(target - point.s)), step)
            ahead = self._closed(point.s + step, point.x + step * point.slope)
            if ahead is not None:
                # Along one branch, the mean of both slopes leads to the next point.
                moved = ahead.x - point.x
                error = np.abs(moved - 0.5 * step * (point.slope + ahead.slope)).max()
                if error < 0.05 * max(np.abs(moved).max(), 0.02 * abs(step)):
                    point, step = ahead, 2 * step
                    continue
            step /= 2
            if abs(step) < 1e-13 * self._unit:
                return point, False
        return point, True

    def _along(self, way: Iterable[float]) -> list[Float64Array]:
        """Return the dependent coordinates at values of s, one after the other, as far as the chain leads."""
        point, found = self._home, list[Float64Array]()
        for s in way:
            point, reached = self._advance(point, float(s))
            if not reached:
                break
            found.append(point.x)
        return found

    def _turn(self, places: Sequence[int]) -> Start | None:
        """Return the start by the angle s itself; None if the chain does not come back after a turn."""
        # Apart from a quarter or half of a turn, where change points are.
        grid = self._home.s + 2 * np.pi * (np.arange(_GRID + 1) + 0.37) / _GRID
        x = np.array(self._along(grid))
        if len(x) < len(grid):
            return None
        windings = np.where(self._turns, np.round((x[-1] - x[0]) / (2 * np.pi)), 0.0)
        if np.abs(x[-1] - x[0] - 2 * np.pi * windings).max() > 1e-7 * max(1.0, self._size):
            return None
        around = (x - np.outer(grid, windings))[:, places]
        start, series = _fitted("turn", grid[:-1], around[:-1], windings[places], (0.0, 1.0))
        if len(places) == len(self._dependent) and self._closes(series, grid):
            return start._replace(kind="exact", steps=0)
        return start

    def _closes(self, series: Sequence[Series], grid: Float64Array) -> bool:
        """Return whether series close the loops up to rounding."""
        at = grid, np.sin(grid), np.cos(grid)
        values = np.array([one.value(*at) + np.zeros_like(grid) for one in series]).T
        gaps = [self._linear(s, x)[0] for s, x in zip(grid.tolist(), values, strict=True)]
        return bool(np.abs(gaps).max() < _EXACT * self._size)

    def _end(self, direction: float) -> float:
        """Return how far the chain can be followed in a direction: to a dead point, a turn, or many lengths."""
        point, reached = self._home, True
        limit = self._home.s + direction * (_MAX_REACH * self._size if self._shifts else 2 * np.pi)
        while reached and (limit - point.s) * direction > 0:
            point, reached = self._advance(point, point.s + direction * 0.05 * self._unit)
        return point.s

    def _range(self, places: Sequence[int]) -> Start:
        """Return the start by an angle whose cosine leads from end to end of the chain's way: near a dead point, the
        dependent coordinates are smooth in its sine.
        """
        low, high = self._end(-1.0), self._end(1.0)
        centre, half = (low + high) / 2, (high - low) / 2
        theta = np.pi * (np.arange(_GRID) + 0.5) / _GRID
        s = centre + half * np.cos(theta)
        home = int(np.searchsorted(-s, -self._home.s))
        back, ahead = self._along(s[home:]), self._along(s[:home][::-1])
        if low == high or len(ahead) + len(back) < _GRID / 2:  # it was not assembled exactly enough to lead on
            got = f"a dead point, where the coordinate that drives it is {self._home.s:.6g}"
            raise ArgumentError("at", "coordinates away from a dead point of the linkage", got)
        x = np.array([*ahead[::-1], *back])[:, places]
        reached = theta[home - len(ahead) : home + len(back)]
        return _fitted("range", reached, x, np.zeros(len(places)), (centre, 1 / half))[0]


def _fitted(
    kind: str, angle: Float64Array, x: Float64Array, windings: Float64Array, scaling: tuple[float, float]
) -> tuple[Start, list[Series]]:
    """Return the start by trigonometric series of an angle, fitted to values x, (points, columns)."""
    least, fewest = (math.inf, 0), _TERMS_OF_STEP * _steps(0.0)
    for terms in range(_MAX_TERMS + 1):
        angles = np.outer(angle, np.arange(1, terms + 1))
        basis = np.hstack((np.ones((len(angle), 1)), np.cos(angles), np.sin(angles)))
        # Along half a turn, sines and cosines are nearly dependent: small coefficients suit float32, too.
        found = np.linalg.lstsq(basis[::2], x[::2], rcond=1e-8)[0]
        error = float(np.abs(basis @ found - x).max())
        steps = _steps(error)
        effort = max(error, _NEAR), terms + _TERMS_OF_STEP * steps
        if effort < least:
            least, best = effort, (terms, steps, found)
        if (_NEAR, terms + fewest) >= least:
            break
    count, steps, found = best
    found[np.abs(found) < 1e-12] = 0.0  # rounding, which programs fold away
    columns = zip(windings.tolist(), found.T.tolist(), strict=True)
    series = [Series(winding, mean, rest[:count], rest[count:]) for winding, (mean, *rest) in columns]
    numbers = [number for winding, mean, a, b in series for number in (winding, mean, *a, *b)]
    return Start(kind, count, steps, [*scaling, *numbers]), series


def _steps(error: float) -> int:
    """Return the number of Newton steps from a start of this error: one leads from 1e-9 to rounding, and one is to
    spare near dead points.
    """
    steps = 2
    while error > 1e-9 and steps < 7:
        error, steps = 10 * error * error, steps + 1
    return steps
