"""Gauss collocation: steps of order 16 whose eight nodes are evaluated together, and a polynomial in between.

The derivative is a polynomial of degree 7 through its values at the eight Gauss nodes of a step. The states at the
nodes are iterated by fixed points (Picard), or, where psi'' answers stiffly to psi and psi', by a simplified Newton
method in these two. What the last Legendre coefficients have left says how far that polynomial is off, and so do the
derivatives beside the nodes: at both ends of a step, between each two nodes, and, of functions that nothing is known
of, at a given spacing. Steps end at events, where distances from them pass 0. The method is symmetric and keeps
quadratic invariants; Hairer, Lubich, Wanner, *Geometric Numerical Integration*, II.1.3, VIII.6; for stiff equations
Hairer, Wanner, *Solving Ordinary Differential Equations II*, IV.8.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, Protocol, TypeAlias

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Rates: TypeAlias = Callable[[Array, Array], Array]
"""The derivatives, an array (m, k): of times (m,) and states (m, k), as they go on smoothly until the next event."""

NODES: Final = 8
_ROUNDS: Final = 30  # of the iteration; a step that needs more is too long
_SAFETY, _SHRINK, _GROW = 0.8, 0.2, 3.0
_FADE = 0.9  # of the length that errors of velocities are measured by, with each shorter step
_RENEWED = 4  # rounds after which Newton's method looks at the derivatives of psi'' again
_PATIENCE, _SLOW = 4, 0.1  # rounds after which fixed points that come nearer by no more are left to Newton's method
_MIN_STIFFNESS = 0.5  # of a step: below, the fixed points are found as well without Newton's method
_NUDGE = 1.5e-8  # rad and rad/s: by which psi and psi' are changed for the derivatives of psi''
_MAX_SWITCHES = 8  # at one instant: if events follow each other for ever, the last of them is passed
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
WEIGHTS: Final[Array] = integrals(np.ones(1))[0]
"""What the values at the nodes count in the integral over a step from 0 to 1."""
BESIDE: Final[Array] = np.hstack([0.0, (TIMES[1:] + TIMES[:-1]) / 2, 1.0])
"""Where a step is looked at beside its nodes."""
_GAPS: Final[Array] = np.diff(TIMES, prepend=0.0, append=1.0)[:, None]
_TO_BESIDE, _VALUES_BESIDE = integrals(BESIDE), values(BESIDE)
_FROM_STATES: Final[Array] = np.asarray(np.linalg.inv(_INNER), np.float64)
_SAMPLES: Final[Array] = np.sort(np.hstack([TIMES, BESIDE]))
"""Where the distances from events are looked at, at least."""
_SAMPLES_TO_SERIES: Final[Array] = np.asarray(
    np.linalg.inv(legendre.legvander(2 * _SAMPLES - 1, len(_SAMPLES) - 1)), np.float64
)


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


class Switches(Protocol):
    """Where the derivatives change from one smooth function to another, and what happens there."""

    def distances(self, t: Array, states: Array) -> tuple[Array, Array]:
        """Compute how far instants and states are from each event, and the sizes by which its rounding is measured.

        Returns:
            Distances, positive until the event happens, shape (m, e); and sizes, shape (e,).
        """

    def switch(self, event: int, t: float, state: Array) -> Array | None:
        """Return the state after an event, whose derivatives apply from now on; None where the motion ends."""


@dataclass
class Stepper:
    """Steps of one motion, each as long as the tolerance allows."""

    rates: Rates  # derivatives of the state
    switches: Switches | None  # events, at which steps end; None where there are none
    t: float  # where it stands
    state: Array  # there; (k,)
    sizes: Array  # what errors are measured by, of a velocity times the length of this step or those before; (k,)
    moving: NDArray[np.bool_]  # which components are velocities or momenta; (k,)
    angle: int  # which component is psi; the next one is psi'
    tol: float  # largest error of a step, in these sizes
    length: float  # to try next
    spacing: float = np.inf  # largest distance between instants at which the derivatives are looked at
    instants: Array = field(default_factory=lambda: np.empty(0))  # where they are looked at besides, increasing
    trials: int = 0  # steps that were tried

    def __post_init__(self) -> None:
        self._reach = 0.0
        self._lost = np.zeros_like(self.state)  # what rounding took from the sum of the steps
        self._before: Piece | None = None
        self._stiff: tuple[Array, Array] | None = None  # derivatives of psi'' by psi and psi', where Newton is needed
        self._event: int | None = None  # at the end of the last step, whose switch is due
        self.ended = False  # whether an event has ended the motion

    def step(self, stop: float) -> Piece | None:
        """Make a step that goes neither past `stop` nor past an event; None where an event ends the motion at once.

        What happens at the end of the step is left to `switch`.

        Raises:
            TooStiffError: the shortest step is too long.
        """
        end, switched, instant = stop, 0, np.spacing(max(abs(self.t), abs(stop)))
        expected: int | None = None  # the event at which a longer step has ended
        while True:
            last = self.t + self.length * (1 + 1e-3) >= end
            length = end - self.t if last else self.length
            if length <= 16 * instant:
                raise TooStiffError(self.t)
            self.trials += 1
            looks = self._looks(length)
            slopes = self._slopes(length)
            error, clear = (np.inf, 0.0) if slopes is None else self._error(slopes, length, 64 * instant, looks)
            factor = _SHRINK if not error < np.inf else _SAFETY * max(error, 1e-12) ** (-1 / (NODES + 1))
            next_length = length * min(max(factor, _SHRINK), _GROW)
            if slopes is None or not error <= 1:
                self.length = min(clear, _SAFETY) * length if clear else next_length
                continue
            self.length = max(self.length, next_length) if last and end < stop else next_length
            crossing = self._crossing(slopes, length, 64 * instant, looks, expected if last else None)
            if crossing is None:
                break
            where, event = crossing
            if where * length <= 32 * instant:  # it starts at an event
                if switched == _MAX_SWITCHES:
                    crossing = None
                    break
                self._switch(event)
                if self.ended:
                    return None
                switched, end, expected = switched + 1, stop, None
            elif (1 - where) * length <= 32 * instant:
                break
            else:
                end, expected = self.t + where * length, event
        piece = self._before = Piece(self.t, length, self.state, slopes)
        self._reach = max(length, _FADE * self._reach)
        self.t = end if last else self.t + length
        self._move(length * (WEIGHTS @ slopes))
        self._event = None if crossing is None else crossing[1]
        return piece

    def switch(self) -> None:
        """Go on after the event at the end of the last step, if there is one."""
        if self._event is not None:
            self._switch(self._event)
            self._event = None

    def turn(self, state: Array) -> None:
        """Go on from another state: coordinates that begin anew at every step, or an impact."""
        self._lost = np.where(state == self.state, self._lost, 0.0)
        self.state = state

    def _switch(self, event: int) -> None:
        state = self.switches.switch(event, self.t, self.state) if self.switches else None
        self.ended = state is None
        if state is not None:
            self.turn(state)

    def _looks(self, length: float) -> Array:
        """Return where in a step of this length, from 0 to 1, the derivatives are looked at beside BESIDE."""
        first, last = np.searchsorted(self.instants, (self.t, self.t + length), side="right")
        count = int(length / self.spacing)
        return np.hstack([(self.instants[first:last] - self.t) / length, np.arange(1, count + 1) / (count + 1)])

    def _crossing(
        self, slopes: Array, length: float, instant: float, looks: Array, expected: int | None
    ) -> tuple[float, int] | None:
        """Return after which share of a step the first event happens, and which; None where none does.

        An event that is expected at the end happens there if rounding alone may keep it from it.
        """
        if self.switches is None:
            return None

        def distances(times: Array) -> tuple[Array, Array]:
            return self.switches.distances(  # type: ignore[union-attr]
                self.t + length * times, self.state + length * (integrals(times) @ slopes)
            )

        times = np.unique(np.hstack([_SAMPLES, looks]))
        ahead, sizes = distances(times)
        speeds = np.abs(np.diff(ahead, axis=0) / np.diff(times)[:, None]).max(axis=0) / length
        margins = 2e-15 * sizes + instant * speeds
        found = []
        of_series = np.searchsorted(times, _SAMPLES)
        for event, margin in enumerate(margins):
            one = functools.partial(lambda event, times: distances(times)[0][:, event], event)
            dip = _first_dip(times, ahead[:, event], ahead[of_series, event], float(margin), one)
            if dip is not None:
                found.append((_crossed(*dip, min(1e-15 * float(sizes[event]), float(margin) / 2), one), event))
        if not found and expected is not None and ahead[-1, expected] <= margins[expected]:
            return 1.0, expected
        return min(found, default=None)

    def _move(self, change: Array) -> None:
        change = change + self._lost
        state = self.state + change
        self._lost = change - (state - self.state)
        self.state = state

    def _slopes(self, length: float) -> Array | None:
        """Compute the derivatives at the nodes of a step; None where the iteration does not settle."""
        if self._stiffness(length) < _MIN_STIFFNESS:
            self._stiff = None
            slopes = self._iterated(length, newton=False)
            if slopes is not None:
                return slopes
        slopes = self._iterated(length, newton=True)
        if slopes is None:
            self._stiff = None
        return slopes

    def _stiffness(self, length: float) -> float:
        """Return by how much psi'' answers to psi and psi' in a step of this length, without unit."""
        if self._stiff is None:
            return 0.0
        by_angle, by_rate = (float(np.abs(slope).max()) for slope in self._stiff)
        return float(length * max(by_rate, np.sqrt(by_angle)))

    def _iterated(self, length: float, newton: bool) -> Array | None:
        """Iterate the states at the nodes: by fixed points (Picard), or by a simplified Newton method in (psi, psi').

        There the derivatives of psi'' by psi and psi' at each node are found by differences; all other components are
        iterated by fixed points.
        """
        times, sizes, change = self.t + length * TIMES, self._sizes(length), np.inf
        states = self.state + length * (_INNER @ self._guess(times))
        block = slice(self.angle, self.angle + 2)
        for round_ in range(_ROUNDS):
            if newton and round_ % _RENEWED == 0:
                self._stiff = self._answers(times, states)
                if not round_ and not self._stiffness(length) > _MIN_STIFFNESS:
                    return None
                inverse, by_angle = self._inverse(length)
            slopes = self.rates(times, states)
            better = self.state + length * (_INNER @ slopes)
            if newton:
                angle, rate = (better - states)[:, block].T
                rate = inverse @ (rate + by_angle @ angle)
                angle = angle + length * (_INNER @ rate)
                better[:, block] = states[:, block] + np.stack([angle, rate], axis=-1)
            latest = float(np.abs((better - states) / sizes).max())
            states = better
            if not latest < np.inf:
                return None
            if latest <= 4e-16 or (latest >= change / 2 and latest <= 1e-3 * self.tol):
                if newton:  # slopes that belong to the states: round-off of psi' would be magnified in psi''
                    slopes = slopes.copy()
                    slopes[:, block] = _FROM_STATES @ (states[:, block] - self.state[block]) / length
                return slopes
            if latest > 2 * change and latest > self.tol:
                return None
            if not newton and round_ and round_ % _PATIENCE == 0 and latest > _SLOW * change:
                self._stiff = self._answers(times, states)
                if self._stiffness(length) > _MIN_STIFFNESS:
                    return None
                self._stiff = None
            change = latest
        return None

    def _answers(self, times: Array, states: Array) -> tuple[Array, Array]:
        """Compute the derivatives of psi'' by psi and psi' at some instants; shape (m,) each."""
        nudges = _NUDGE * (1 + np.abs(states[:, self.angle : self.angle + 2]))
        moved = np.concatenate([states] * 3)
        moved[len(times) : 2 * len(times), self.angle] += nudges[:, 0]
        moved[2 * len(times) :, self.angle + 1] += nudges[:, 1]
        here, by_angle, by_rate = self.rates(np.tile(times, 3), moved)[:, self.angle + 1].reshape(3, -1)
        return (by_angle - here) / nudges[:, 0], (by_rate - here) / nudges[:, 1]

    def _inverse(self, length: float) -> tuple[Array, Array]:
        """Compute what takes the residuals of psi' and psi at the nodes to the change of psi'; shape (8, 8) each."""
        by_angle, by_rate = self._stiff or (np.zeros(NODES), np.zeros(NODES))
        inner = length * _INNER
        matrix = np.eye(NODES) - inner * by_rate - (inner * by_angle) @ inner
        return np.asarray(np.linalg.inv(matrix), np.float64), inner * by_angle

    def _filtered(self, errors: Array, length: float) -> Array:
        """Return what of errors of the slopes times the length stays in the state, where psi'' answers stiffly."""
        if self._stiff is None:
            return errors
        by_angle, by_rate = (length * float(slope.mean()) for slope in self._stiff)
        matrix = np.array([[1, -length], [-by_angle, 1 - by_rate]])
        errors, block = errors.copy(), slice(self.angle, self.angle + 2)
        errors[:, block] = np.linalg.solve(matrix, errors[:, block].T).T
        return errors

    def _guess(self, times: Array) -> Array:
        """The derivatives as the step before goes on, or as they are at its end."""
        before = self._before
        if before is None:
            return np.zeros((NODES, len(self.state)))
        ahead = (times - before.start) / before.length
        return values(ahead if ahead[-1] <= _GROW else np.ones(NODES)) @ before.slopes

    def _sizes(self, length: float) -> Array:
        return np.where(self.moving, self.sizes / length, self.sizes)

    def _error(self, slopes: Array, length: float, shortest: float, looks: Array) -> tuple[float, float]:
        """Compute how far the polynomial may be off in between, in units of the tolerance.

        Returns:
            The error, and, where a look beside the nodes alone shows one above 1, up to which share of the step none
            does; 0 elsewhere.
        """
        jump = length <= max(_JUMP * self._reach, shortest)
        sizes = self._sizes(length if jump else max(length, self._reach))
        units = length / (self.tol * sizes + 1e-15 * np.abs(self.state))
        tails = np.abs(self._filtered(_TO_SERIES[-3:] @ slopes, length) * units).max(axis=1)
        first, second, third = map(float, tails)
        ratio = min(1.0, max(third / second if second else 0.0, second / first if first else 0.0))
        error = max(third, second * ratio) * ratio
        if not error <= 1:
            return error, 0.0
        times, gaps, to_states, to_slopes = BESIDE, _GAPS, _TO_BESIDE, _VALUES_BESIDE
        if looks.size:
            times, order = np.unique(np.hstack([BESIDE, looks]), return_index=True)
            gaps = (np.diff(times, prepend=0.0) + np.diff(times, append=1.0))[:, None]
            beside = order < len(BESIDE)
            gaps[beside] = _GAPS[order[beside]]
            to_states, to_slopes = integrals(times), values(times)
        there = self.rates(self.t + length * times, self.state + length * (to_states @ slopes))
        beside_error = (np.abs(self._filtered(there - to_slopes @ slopes, length)) * gaps * units).max(axis=1)
        worst = float(beside_error.max())
        if worst <= 1 or not looks.size:
            return max(error, worst), 0.0
        first_bad = int(np.argmax(~(beside_error <= 1)))
        return worst, float(times[first_bad - 1]) if first_bad else 0.0


def _first_dip(
    times: Array, distances: Array, samples: Array, margin: float, look: Callable[[Array], Array]
) -> tuple[float, float] | None:
    """Return two instants between which a distance first falls below -margin; None where it does not.

    Between the instants the polynomial through `samples`, those at _SAMPLES, says where to look.
    """
    below = np.flatnonzero(~(distances >= -margin))
    found = (float(times[max(below[0] - 1, 0)]), float(times[below[0]])) if below.size else None
    series = _SAMPLES_TO_SERIES @ samples
    if not series[0] - float(np.abs(series[1:]).sum()) < -margin:
        return found
    series = np.asarray(legendre.legtrim(series, margin / 64), np.float64)  # round-off has roots of its own
    roots = legendre.legroots(series).real
    ends = np.hstack([-1.0, np.sort(roots[np.abs(roots) < 1]), 1.0])
    middles = (ends[1:] + ends[:-1]) / 2
    candidates = (middles[legendre.legval(middles, series) < -margin] + 1) / 2
    for candidate in candidates:
        if found and candidate >= found[1]:
            break
        if look(np.array([candidate]))[0] < -margin:
            return float(times[np.searchsorted(times, candidate) - 1]), float(candidate)
    return found


def _crossed(start: float, end: float, margin: float, look: Callable[[Array], Array]) -> float:
    """Return where between two instants a distance first is below 0 by more than round-off, as it is at the end."""
    while end - start > 2e-16 * (1 + end):
        times = np.linspace(start, end, 17)
        below = int(np.argmax(~(look(times) >= -margin)))
        if not below:
            return float(times[0])
        if (float(times[below - 1]), float(times[below])) == (start, end):
            break
        start, end = float(times[below - 1]), float(times[below])
    return end
