"""Gauss collocation: steps of order 16 whose eight nodes are evaluated together, and a polynomial in between.

The derivative is a polynomial of degree 7 through its values at the eight Gauss nodes of a step, found by iteration
(Picard). What the last Legendre coefficients have left says how far that polynomial is off, and so do the derivatives
beside the nodes: at both ends of a step and between each two nodes, where a kink may lie that no node sees. Where the
derivative is known to change from one smooth function to another, a step ends there. The method is symmetric and
keeps quadratic invariants; Hairer, Lubich, Wanner, *Geometric Numerical Integration*, II.1.3, VIII.6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Rates: TypeAlias = Callable[[Array, Array, int], Array]
"""The derivatives: of times (m,), states (m, k) and how many of the levels lie below, an array (m, k)."""

NODES: Final = 8
_ROUNDS: Final = 30  # of the iteration; a step that needs more is too long
_SAFETY, _SHRINK, _GROW = 0.8, 0.2, 3.0
_FADE = 0.9  # of the length that errors of velocities are measured by, with each shorter step
_JUMP = 1e-12  # of that length: in a step so short the derivative jumps, and no shorter one would be better

_x, _w = legendre.leggauss(NODES)
TIMES: Final[Array] = (_x + 1) / 2
"""The nodes of a step from 0 to 1."""
_TO_SERIES: Final[Array] = np.stack(
    [(2 * k + 1) / 2 * _w * legendre.legval(_x, np.eye(NODES)[k]) for k in range(NODES)]
)


_TO_INTEGRAL: Final[Array] = (
    np.stack([np.pad(c := legendre.legint(unit, lbnd=-1), (0, NODES + 1 - len(c))) for unit in np.eye(NODES)], axis=1)
    @ _TO_SERIES
    / 2
)


def integrals(times: Array) -> Array:
    """The integral from 0 to each time of the polynomial through eight values at the nodes: a matrix (m, 8)."""
    return legendre.legvander(2 * times - 1, NODES) @ _TO_INTEGRAL


def values(times: Array) -> Array:
    """The value at each time of the polynomial through eight values at the nodes: a matrix (m, 8)."""
    return legendre.legvander(2 * times - 1, NODES - 1) @ _TO_SERIES


_INNER: Final[Array] = integrals(TIMES)
_END: Final[Array] = integrals(np.ones(1))[0]
BESIDE: Final[Array] = np.hstack([0.0, (TIMES[1:] + TIMES[:-1]) / 2, 1.0])
"""Where a step is looked at beside its nodes."""
_GAPS: Final[Array] = np.diff(TIMES, prepend=0.0, append=1.0)[:, None]
_TO_BESIDE, _VALUES_BESIDE = integrals(BESIDE), values(BESIDE)


class TooStiffError(Exception):
    """No step was short enough."""

    def __init__(self, t: float) -> None:
        super().__init__(t)
        self.t = t


@dataclass(frozen=True, slots=True)
class Piece:
    """One step."""

    start: float  # its first instant
    length: float
    state: Array  # at its start; (k,)
    slopes: Array  # derivatives at the nodes; (8, k)

    def at(self, t: Array) -> Array:
        """The states at instants of the step; shape (m, k)."""
        return self.state + self.length * (integrals((t - self.start) / self.length) @ self.slopes)


@dataclass
class Stepper:
    """Steps of one motion, each as long as the tolerance allows."""

    rates: Rates  # derivatives of the state
    t: float  # where it stands
    state: Array  # there; (k,)
    sizes: Array  # what errors are measured by, of a velocity times the length of this step or those before; (k,)
    moving: NDArray[np.bool_]  # which components are velocities or momenta; (k,)
    tol: float  # largest error of a step, in these sizes
    length: float  # to try next
    levels: tuple[float, ...] = ()  # of the component `angle`, increasing; on both sides the derivatives are smooth
    angle: int = 0

    def __post_init__(self) -> None:
        self._levels: tuple[float, ...] = (-np.inf, *self.levels, np.inf)
        self._side = sum(level < self.state[self.angle] for level in self.levels)
        self._reach = 0.0
        self._lost = np.zeros_like(self.state)  # what rounding took from the sum of the steps
        self._before: Piece | None = None

    def step(self, stop: float) -> Piece:
        """Make a step that goes neither past `stop` nor past a level.

        Raises:
            TooStiffError: the shortest step is too long.
        """
        end, turned, instant = stop, 0, np.spacing(max(abs(self.t), abs(stop)))
        while True:
            last = self.t + self.length * (1 + 1e-3) >= end
            length = end - self.t if last else self.length
            if length <= 16 * instant:
                raise TooStiffError(self.t)
            slopes = self._slopes(length)
            error = np.inf if slopes is None else self._error(slopes, length, 64 * instant)
            factor = _SHRINK if not error < np.inf else _SAFETY * max(error, 1e-12) ** (-1 / (NODES + 1))
            next_length = length * min(max(factor, _SHRINK), _GROW)
            if slopes is None or not error <= 1:
                self.length = next_length
                continue
            self.length = max(self.length, next_length) if last and end < stop else next_length
            where, sense = self._leaves(slopes, length, 64 * instant)
            if not sense or turned == len(self._levels):
                break
            if where * length <= 32 * instant:  # it starts at a level and goes to the other side
                self._side, turned, end = self._side + sense, turned + 1, stop
            elif (1 - where) * length <= 32 * instant:
                break
            else:
                end = self.t + where * length
        piece = self._before = Piece(self.t, length, self.state, slopes)
        self._reach = max(length, _FADE * self._reach)
        self.t = end if last else self.t + length
        self._move(length * (_END @ slopes))
        return piece

    def _leaves(self, slopes: Array, length: float, instant: float) -> tuple[float, int]:
        """After which share of a step it leaves its side, by more than round-off, and to which one: -1, 1, or 0."""
        if len(self._levels) == 2:
            return 1.0, 0
        psi, rate = self.state[self.angle], slopes[:, self.angle]
        series = length * (_TO_INTEGRAL @ rate)
        margin = 2e-15 * (1 + abs(psi)) + instant * float(np.abs(rate).max())
        series = np.asarray(legendre.legtrim(series, margin / 64), np.float64)  # round-off has roots of its own
        found = [(1.0, 0)]
        for sense, level in ((-1, self._levels[self._side]), (1, self._levels[self._side + 1])):
            if not sense * (psi - level) + float(np.abs(series).sum()) > margin:
                continue
            past = sense * np.hstack([psi - level + series[0], series[1:]])
            roots = legendre.legroots(past).real
            ends = np.hstack([-1.0, np.sort(roots[np.abs(roots) < 1]), 1.0])
            outside = np.flatnonzero(legendre.legval((ends[1:] + ends[:-1]) / 2, past) > margin)
            if outside.size:
                root = _polished(past, float(ends[outside[0]])) if outside[0] else -1.0
                found.append(((root + 1) / 2, sense))
        return min(found)

    def turn(self, state: Array) -> None:
        """Go on from another state: coordinates that begin anew at every step."""
        self._lost = np.where(state == self.state, self._lost, 0.0)
        self.state = state

    def _move(self, change: Array) -> None:
        change = change + self._lost
        state = self.state + change
        self._lost = change - (state - self.state)
        self.state = state

    def _slopes(self, length: float) -> Array | None:
        """The derivatives at the nodes of a step, or None where the iteration does not settle."""
        times, sizes, change = self.t + length * TIMES, self._sizes(length), np.inf
        found = self.state + length * (_INNER @ self._guess(times))
        for _ in range(_ROUNDS):
            slopes = self.rates(times, found, self._side)
            better = self.state + length * (_INNER @ slopes)
            latest = float(np.abs((better - found) / sizes).max())
            found = better
            if not latest < np.inf:
                return None
            if latest <= 4e-16 or (latest >= change / 2 and latest <= 1e-3 * self.tol):
                return slopes
            if latest > 2 * change and latest > self.tol:
                return None
            change = latest
        return None

    def _guess(self, times: Array) -> Array:
        """The derivatives as the step before goes on, or as they are at its end."""
        before = self._before
        if before is None:
            return np.zeros((NODES, len(self.state)))
        ahead = (times - before.start) / before.length
        return values(ahead if ahead[-1] <= _GROW else np.ones(NODES)) @ before.slopes

    def _sizes(self, length: float) -> Array:
        return np.where(self.moving, self.sizes / length, self.sizes)

    def _error(self, slopes: Array, length: float, shortest: float) -> float:
        """How far the polynomial may be off in between, in units of the tolerance."""
        jump = length <= max(_JUMP * self._reach, shortest)
        sizes = self._sizes(length if jump else max(length, self._reach))
        units = length / (self.tol * sizes + 1e-15 * np.abs(self.state))
        first, second, third = map(float, np.abs(_TO_SERIES[-3:] @ slopes * units).max(axis=1))
        ratio = min(1.0, max(third / second if second else 0.0, second / first if first else 0.0))
        error = max(third, second * ratio) * ratio
        if not error <= 1:
            return error
        there = self.rates(self.t + length * BESIDE, self.state + length * (_TO_BESIDE @ slopes), self._side)
        return max(error, float((np.abs(there - _VALUES_BESIDE @ slopes) * _GAPS * units).max()))


def _polished(series: Array, root: float) -> float:
    """A root of a Legendre series, by Newton's method."""
    slope = legendre.legder(series)
    for _ in range(3):
        change = legendre.legval(root, series) / legendre.legval(root, slope)
        if not abs(change) < 1e-3:
            break
        root = float(np.clip(root - change, -1, 1))
    return root
