"""Gauss collocation: steps of order 16 whose eight nodes are evaluated together, and a polynomial in between.

The derivative is a polynomial of degree 7 through its values at the eight Gauss nodes of a step, found by iteration
(Picard). What the last Legendre coefficients have left says how far that polynomial is off. The method is symmetric
and keeps quadratic invariants; Hairer, Lubich, Wanner, *Geometric Numerical Integration*, II.1.3, VIII.6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Rates: TypeAlias = Callable[[Array, Array], Array]
"""The derivatives at all nodes: of times (8,) and states (8, k), an array (8, k)."""

NODES: Final = 8
_ROUNDS: Final = 30  # of the iteration; a step that needs more is too long
_SAFETY, _SHRINK, _GROW = 0.8, 0.2, 3.0

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


class TooStiffError(Exception):
    """No step was short enough."""

    def __init__(self, t: float) -> None:
        super().__init__(t)
        self.t = t


@dataclass(frozen=True, slots=True)
class Piece:
    """One step.

    Attributes:
        start: its first instant.
        length: how long it is.
        state: at its start; shape (k,).
        slopes: derivatives at the nodes; shape (8, k).
    """

    start: float
    length: float
    state: Array
    slopes: Array

    def at(self, t: Array) -> Array:
        """The states at instants of the step; shape (m, k)."""
        return self.state + self.length * (integrals((t - self.start) / self.length) @ self.slopes)


class Stepper:
    """Steps of one motion, each as long as the tolerance allows.

    Args:
        rates: derivatives of the state.
        t: first instant.
        state: there; shape (k,).
        sizes: what an error of each component is measured by, of a velocity times the length of a step; shape (k,).
        moving: which components are velocities or momenta; shape (k,).
        tol: largest error of a step, in these sizes.
        length: first length to try.
    """

    def __init__(
        self, rates: Rates, t: float, state: Array, sizes: Array, moving: NDArray[np.bool_], tol: float, length: float
    ) -> None:
        self.rates = rates
        self.t = t
        self.state = state
        self.sizes = sizes
        self.moving = moving
        self.tol = tol
        self.length = length
        self._lost = np.zeros_like(state)  # what rounding took from the sum of the steps
        self._before: Piece | None = None

    def step(self, stop: float) -> Piece:
        """Make a step that does not go past `stop`.

        Raises:
            TooStiffError: the shortest step is too long.
        """
        while True:
            last = self.t + self.length * (1 + 1e-3) >= stop
            length = stop - self.t if last else self.length
            if length <= 16 * np.spacing(max(abs(self.t), abs(stop))):
                raise TooStiffError(self.t)
            slopes = self._slopes(length)
            error = np.inf if slopes is None else self._error(slopes, length)
            factor = _SHRINK if not error < np.inf else _SAFETY * max(error, 1e-12) ** (-1 / (NODES + 1))
            self.length = length * min(max(factor, _SHRINK), _GROW)
            if slopes is not None and error <= 1:
                break
        piece = self._before = Piece(self.t, length, self.state, slopes)
        self.t = stop if last else self.t + length
        self._move(length * (_END @ slopes))
        return piece

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
            slopes = self.rates(times, found)
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

    def _error(self, slopes: Array, length: float) -> float:
        """How far the polynomial may be off in between, in units of the tolerance."""
        first, second, third = map(
            float, np.abs(_TO_SERIES[-3:] @ slopes * (length / self._sizes(length))).max(axis=1)
        )
        ratio = min(1.0, max(third / second if second else 0.0, second / first if first else 0.0))
        return max(third, second * ratio) * ratio / self.tol
