"""The way of a chain of joints that one coordinate drives: followed once, and fitted by series, from which the Newton
steps of programs start.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.numeric.arrays import Float64Array
from hingepair.plans.closures import Turn

_GRID: Final = 256  # points of a full turn, or of a range, to which a start is fitted
_MAX_TERMS: Final = 60  # of a series; more would cost more than further Newton steps
_FIT_ERROR: Final = 1e-9  # from here one Newton step leads to rounding; a second is taken near dead points
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

    def _turn(self, places: Sequence[int]) -> Start | None:
        """Return the start by trigonometric series; None if the chain does not come back after a turn."""
        # Apart from a quarter or half of a turn, where change points are.
        grid = self._home.s + 2 * np.pi * (np.arange(_GRID + 1) + 0.37) / _GRID
        points, point = [], self._home
        for s in grid:
            point, reached = self._advance(point, float(s))
            if not reached:
                return None
            points.append(point)
        x = np.array([one.x for one in points])
        windings = np.where(self._turns, np.round((x[-1] - x[0]) / (2 * np.pi)), 0.0)
        if np.abs(x[-1] - x[0] - 2 * np.pi * windings).max() > 1e-7 * max(1.0, self._size):
            return None
        around = (x[:-1] - np.outer(grid[:-1], windings))[:, places]
        modes = np.fft.rfft(around, axis=0) / _GRID * np.exp(-1j * np.outer(np.arange(_GRID // 2 + 1), grid[:1]))
        left = np.cumsum(np.abs(modes)[::-1], axis=0)[::-1].max(axis=1)  # what is left out from each term on
        terms = next((k for k in range(1, _MAX_TERMS + 1) if left[k] < _FIT_ERROR / 4), _MAX_TERMS + 1) - 1
        series = []
        for winding, mode in zip(windings[places], modes.T, strict=True):
            a, b = (_without_dust(part[1 : terms + 1]) for part in (2 * mode.real, -2 * mode.imag))
            series.append(Turn(float(winding), float(mode[0].real), a, b))
        numbers = [number for winding, mean, a, b in series for number in (winding, mean, *a, *b)]
        if len(places) == len(self._dependent) and self._closes(series, grid):
            return Start("exact", terms, 0, numbers)
        return Start("turn", terms, _steps(float(left[terms + 1])), numbers)

    def _closes(self, series: Sequence[Turn], grid: Float64Array) -> bool:
        """Return whether series close the loops up to rounding."""
        values = np.array([turn.value(grid) + np.zeros_like(grid) for turn in series]).T
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
        """Return the start by polynomials between the ends of the chain's way."""
        low, high = self._end(-1.0), self._end(1.0)
        centre, half = (low + high) / 2, (high - low) / 2
        theta = np.pi * (np.arange(_GRID) + 0.5) / _GRID
        s = centre + half * np.cos(theta)
        found: dict[int, Float64Array] = {}
        home_index = int(np.searchsorted(-s, -self._home.s))
        for order in (range(home_index, _GRID), range(home_index - 1, -1, -1)):
            point = self._home
            for k in order:
                point, reached = self._advance(point, float(s[k]))
                if not reached:
                    break
                found[k] = point.x
        rows = sorted(found)
        x = np.cos(theta[rows])
        values = np.array([found[k] for k in rows])[:, places]
        root = np.sqrt(np.maximum(1 - x * x, 1e-12))
        best: tuple[float, int, Float64Array] | None = None
        for terms in (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 18, 22, 26, 30):
            T = np.polynomial.chebyshev.chebvander(x, terms - 1)
            basis = np.hstack((T, root[:, None] * T))
            fitted = np.linalg.lstsq(basis[::2], values[::2], rcond=1e-13)[0]
            error = float(np.abs(basis @ fitted - values).max())
            if best is None or error < 0.5 * best[0]:
                best = error, terms, fitted
            if error < _FIT_ERROR:
                break
        error, terms, fitted = best  # type: ignore[misc]
        numbers = [centre, 1 / half]
        for column in fitted.T:
            numbers += [*_without_dust(column[:terms]), *_without_dust(column[terms:])]
        return Start("range", terms, _steps(error), [float(n) for n in numbers])


def _without_dust(numbers: Iterable[float]) -> list[float]:
    """Return coefficients with 0 in place of rounding, which programs fold."""
    return [0.0 if abs(number) < 1e-12 else float(number) for number in numbers]


def _steps(error: float) -> int:
    """Return the number of Newton steps from a start of this error, with one to spare."""
    steps = 2
    while error > 1e-9 and steps < 7:
        error, steps = error * error, steps + 1
    return steps
