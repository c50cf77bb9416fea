"""Gauss collocation: steps of order 16 whose eight nodes are evaluated together, with a polynomial between them.

The derivative is a polynomial of degree 7 through its values at the eight Gauss nodes of a step. The states at the
nodes are found by fixed-point (Picard) iteration, or, where the accelerations q'' of the joints depend stiffly on q
and q', by a simplified Newton method in these two. The error of a step is estimated by the last Legendre coefficients
of the polynomial and by its residual between the nodes: at both ends of a step, between each two nodes, and, where
loads are callables, at a given spacing. Steps end at events, where distances from them pass 0. The method is
symmetric and keeps quadratic invariants; Hairer, Lubich, Wanner, *Geometric Numerical Integration*, II.1.3, VIII.6;
for stiff equations Hairer, Wanner, *Solving Ordinary Differential Equations II*, IV.8.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from hingepair.numeric.arrays import Float64Array as Array

StateRates: TypeAlias = Callable[[Array, Array], Array]
"""Derivatives (m, k) of the state at times (m,) and states (m, k), smooth until the next event."""

NODES: Final = 8  # of a step
_SAFETY = 0.8  # of the length that the estimate of the error allows
_MIN_GROWTH, _MAX_GROWTH = 0.2, 3.0  # from the length of one step to that of the next
_STIFF = 0.5  # stiffness times length of a step: below it fixed points converge without Newton's method

# Matrices take values at the nodes to other values of the polynomial through them. Times are relative to the step: 0
# at its start, 1 at its end.
_gauss_nodes, _gauss_weights = legendre.leggauss(NODES)
NODE_TIMES: Final[Array] = (_gauss_nodes + 1) / 2  # of the nodes; (8,)
_SERIES: Final[Array] = np.stack(  # from values to the coefficients of their Legendre series; (8, 8)
    [(2 * k + 1) / 2 * _gauss_weights * legendre.legval(_gauss_nodes, np.eye(NODES)[k]) for k in range(NODES)]
)
_antiderivatives = [legendre.legint(unit, lbnd=-1) for unit in np.eye(NODES)]
_INTEGRAL_SERIES: Final[Array] = (  # from values to the coefficients of the Legendre series of their integral; (9, 8)
    np.stack([np.pad(c, (0, NODES + 1 - len(c))) for c in _antiderivatives], axis=1) @ _SERIES / 2
)


def integration_matrix(times: Array) -> Array:
    """Return the matrix (m, 8) from values at the nodes to integrals from the start of the step to the times."""
    return _legendre(2 * times - 1, NODES) @ _INTEGRAL_SERIES


def interpolation_matrix(times: Array) -> Array:
    """Return the matrix (m, 8) from values at the nodes to values at the times."""
    return _legendre(2 * times - 1, NODES - 1) @ _SERIES


def _legendre(x: Array, degree: int) -> Array:
    """Return Legendre polynomials at x, (m, degree + 1); for few x twice as fast as `legvander`."""
    rows = [np.ones_like(x), x]
    for k in range(2, degree + 1):
        rows.append(((2 * k - 1) * x * rows[-1] - (k - 1) * rows[-2]) / k)
    return np.stack(rows, axis=-1)


_INTEGRALS: Final[Array] = integration_matrix(NODE_TIMES)  # from values to integrals up to each node; (8, 8)
_DERIVATIVES: Final[Array] = np.asarray(np.linalg.inv(_INTEGRALS), np.float64)  # from these integrals to values
WEIGHTS: Final[Array] = integration_matrix(np.ones(1))[0]
"""Weights of the values at the nodes in the integral over a step from 0 to 1; shape (8,)."""
# Where the residual is checked: between the nodes and at both ends; (9,).
_BETWEEN: Final[Array] = np.hstack([0.0, (NODE_TIMES[1:] + NODE_TIMES[:-1]) / 2, 1.0])
# Distances between the nodes, or ends, on both sides of these times; (9, 1).
_GAPS: Final[Array] = np.diff(NODE_TIMES, prepend=0.0, append=1.0)[:, None]
_TO_STATES, _TO_RATES = integration_matrix(_BETWEEN), interpolation_matrix(_BETWEEN)
# Where distances from events are evaluated, at least; (17,).
_EVENT_TIMES: Final[Array] = np.sort(np.hstack([NODE_TIMES, _BETWEEN]))
# From these distances to the coefficients of their Legendre series; (17, 17).
_EVENT_SERIES: Final[Array] = np.asarray(np.linalg.inv(legendre.legvander(2 * _EVENT_TIMES - 1, 16)), np.float64)


class TooStiffError(Exception):
    """Even the shortest possible step from the instant `t` [s] is too long for the tolerance."""

    def __init__(self, t: float) -> None:
        super().__init__(t)
        self.t = t


@dataclass(frozen=True, slots=True)
class StepPolynomial:
    """Polynomial in time of the state over one step."""

    start: float  # first instant of the step [s]
    length: float  # of the step [s]
    state: Array  # at the start of the step; (k,)
    rates: Array  # derivatives of the state at the nodes; (8, k)

    def states_at(self, t: Array) -> Array:
        """Return the states at instants t [s] of the step; (m, k)."""
        return self.state + self.length * (integration_matrix((t - self.start) / self.length) @ self.rates)


@dataclass
class Stepper:
    """Makes steps that are as long as the tolerance allows and end at events."""

    rates: StateRates  # derivatives of the state
    events: Any  # at which steps end: the `JointEvents` of `motion.events`, or None
    t: float  # present instant [s]
    state: Array  # present state; (k,)
    sizes: Array  # scales of errors; those of velocities are divided by the length of recent steps; (k,)
    rate_mask: NDArray[np.bool_]  # whether each component is a velocity or a momentum; (k,)
    q: slice  # of the coordinates of the joints in the state; their rates follow them
    tol: float  # largest error of a step, in units of the sizes
    length: float  # of the next step to try [s]
    spacing: float = np.inf  # largest distance between instants at which the residual is checked [s]
    instants: Array = field(default_factory=lambda: np.empty(0))  # more instants of checks, increasing [s]
    trials: int = 0  # steps tried so far

    def __post_init__(self) -> None:
        self._recent_step_length = 0.0
        self._rounding_residue = np.zeros_like(self.state)  # of the sum of the steps: compensated summation
        self._last_step: StepPolynomial | None = None
        self._dof = self.q.stop - self.q.start
        self._qd = slice(self.q.stop, self.q.stop + self._dof)
        self._slopes: tuple[Array, Array] | None = None  # of q'' by q and q', (8, dof, dof), where Newton is needed
        self._pending_event: int | None = None  # at the end of the last step; not yet applied
        self.ended = False  # whether an event has ended the motion

    def step(self, stop: float) -> StepPolynomial | None:
        """Make one step, neither past the instant `stop` nor past an event; return it, or None if an event at its
        start ends the motion. An event at its end is applied by `apply_pending_event` only.

        Raises:
            TooStiffError: the shortest step is too long.
        """
        end, applied_count, time_rounding = stop, 0, np.spacing(max(abs(self.t), abs(stop)))
        expected_event: int | None = None  # the event at which a longer step has ended
        while True:
            is_last = self.t + self.length * (1 + 1e-3) >= end
            length = end - self.t if is_last else self.length
            if length <= 16 * time_rounding:
                raise TooStiffError(self.t)
            self.trials += 1
            extra_times = self._extra_check_times(length)
            node_rates = self._node_rates(length)
            error, good_share = np.inf, 0.0
            if node_rates is not None:
                error, good_share = self._estimate_error(node_rates, length, 64 * time_rounding, extra_times)
            factor = _MIN_GROWTH if not error < np.inf else _SAFETY * max(error, 1e-12) ** (-1 / (NODES + 1))
            next_length = length * min(max(factor, _MIN_GROWTH), _MAX_GROWTH)
            if node_rates is None or not error <= 1:
                self.length = min(good_share, _SAFETY) * length if good_share else next_length
                continue
            self.length = max(self.length, next_length) if is_last and end < stop else next_length
            first_event = self._find_first_event(
                node_rates, length, time_rounding, extra_times, expected_event if is_last else None
            )
            if first_event is None:
                break
            share, event = first_event
            if share * length <= 32 * time_rounding:  # it starts at an event
                if applied_count == 8 * max(1, self._dof):  # more at one instant: the next is ignored
                    first_event = None
                    break
                self._apply_event(event)
                if self.ended:
                    return None
                applied_count, end, expected_event = applied_count + 1, stop, None
            elif (1 - share) * length <= 32 * time_rounding:
                break
            else:
                end, expected_event = self.t + share * length, event
        piece = self._last_step = StepPolynomial(self.t, length, self.state, node_rates)
        self._recent_step_length = max(length, 0.9 * self._recent_step_length)
        self.t = end if is_last else self.t + length
        self._advance(length * (WEIGHTS @ node_rates))
        self._pending_event = None if first_event is None else first_event[1]
        return piece

    def apply_pending_event(self) -> None:
        """Apply the event at the end of the last step, if there is one; set `ended` to whether it ends the motion."""
        if self._pending_event is not None:
            self._apply_event(self._pending_event)
            self._pending_event = None

    def set_state(self, state: Array) -> None:
        """Replace the present state, after an event or for coordinates that are reset after every step."""
        self._rounding_residue = np.where(state == self.state, self._rounding_residue, 0.0)
        self.state = state

    def _apply_event(self, event_index: int) -> None:
        """Apply an event to the present state, or set `ended` if it ends the motion."""
        state = self.events.apply(event_index, self.t, self.state) if self.events else None
        self.ended = state is None
        if state is not None:
            self.set_state(state)

    def _extra_check_times(self, length: float) -> Array:
        """Return further times, in parts of the step, for checks of residual and events: callables may jump."""
        first, last = np.searchsorted(self.instants, (self.t, self.t + length), side="right")
        count = int(length / self.spacing)
        return np.hstack([(self.instants[first:last] - self.t) / length, np.arange(1, count + 1) / (count + 1)])

    def _find_first_event(
        self, node_rates: Array, length: float, time_rounding: float, extra_times: Array, expected_event: int | None
    ) -> tuple[float, int] | None:
        """Return when the first event happens, in parts of the step, and its index; None if there is none. An
        `expected_event` has ended a longer step before.
        """
        if self.events is None:
            return None

        def distances(times: Array) -> tuple[Array, Array]:
            states = self.state + length * (integration_matrix(times) @ node_rates)
            found: tuple[Array, Array] = self.events.distances(self.t + length * times, states)
            return found

        times = np.unique(np.hstack([_EVENT_TIMES, extra_times]))
        values, sizes = distances(times)
        slopes = np.abs(np.diff(values, axis=0) / np.diff(times)[:, None])
        slopes = np.where(np.isfinite(slopes), slopes, 0.0).max(axis=0) / length  # NaN is found as a crossing
        margins = event_margin(sizes, slopes, time_rounding)
        crossings = []
        for event, margin in enumerate(margins.tolist()):
            distance_at = functools.partial(lambda event, times: distances(times)[0][:, event], event)
            bracket = _bracket_crossing(times, values[:, event], margin, distance_at)
            if bracket is not None:
                precision = min(1e-15 * float(sizes[event]), margin / 2)
                crossings.append((_bisect_crossing(*bracket, precision, distance_at), event))
        if not crossings and expected_event is not None and values[-1, expected_event] <= margins[expected_event]:
            return 1.0, expected_event
        return min(crossings, default=None)

    def _advance(self, change: Array) -> None:
        """Add a change to the present state by compensated summation."""
        change = change + self._rounding_residue
        state = self.state + change
        self._rounding_residue = change - (state - self.state)
        self.state = state

    def _node_rates(self, length: float) -> Array | None:
        """Return the derivatives at the nodes of a step, (8, k); None if no iteration converges."""
        if self._stiffness(length) < _STIFF:
            self._slopes = None
            node_rates = self._solve_nodes(length, use_newton=False)
            if node_rates is not None:
                return node_rates
        node_rates = self._solve_nodes(length, use_newton=True)
        if node_rates is None:
            self._slopes = None
        return node_rates

    def _stiffness(self, length: float) -> float:
        """Return the stiffness of q'' over a step, without unit; 0 if it is not known."""
        if self._slopes is None or not self._dof:
            return 0.0
        if not all(np.isfinite(slopes).all() for slopes in self._slopes):
            return 0.0
        by_q, by_qd = (float(np.abs(np.linalg.eigvals(slopes)).max()) for slopes in self._slopes)
        return float(length * max(by_qd, np.sqrt(by_q)))

    def _solve_nodes(self, length: float, use_newton: bool) -> Array | None:
        """Iterate the states at the nodes by fixed points (Picard) or by a simplified Newton method in (q, q').
        Return the derivatives there, (8, k); None if the iteration fails, or the other one suits better.
        """
        times, sizes, last_change = self.t + length * NODE_TIMES, self._error_sizes(length), np.inf
        states = self.state + length * (_INTEGRALS @ self._predict_rates(times))
        for iteration in range(30):  # a step that needs more is too long
            if use_newton and iteration % 4 == 0:  # new derivatives of q''
                self._slopes = self._qdd_slopes(times, states)
                if not iteration and not self._stiffness(length) > _STIFF:
                    return None
                inverse, by_q = self._newton_matrices(length)
            # Picard's step, in q and q' corrected by Newton's.
            node_rates = self.rates(times, states)
            new_states = self.state + length * (_INTEGRALS @ node_rates)
            if use_newton:
                q, qd = ((new_states - states)[:, block] for block in (self.q, self._qd))
                qd = (inverse @ (qd.ravel() + by_q @ q.ravel())).reshape(q.shape)
                new_states[:, self.q] = states[:, self.q] + q + length * (_INTEGRALS @ qd)
                new_states[:, self._qd] = states[:, self._qd] + qd
            change = float(np.abs((new_states - states) / sizes).max())
            states = new_states
            if not change < np.inf:
                return None
            if change <= 4e-16 or (change >= last_change / 2 and change <= 1e-3 * self.tol):
                if use_newton:  # rates that belong to the states: rounding of q' would be magnified in q''
                    node_rates, block = node_rates.copy(), slice(self.q.start, self._qd.stop)
                    node_rates[:, block] = _DERIVATIVES @ (states[:, block] - self.state[block]) / length
                return node_rates
            if change > 2 * last_change and change > self.tol:
                return None
            # Do fixed points converge too slowly, because q'' is stiff?
            if not use_newton and iteration and iteration % 4 == 0 and change > 0.1 * last_change:
                self._slopes = self._qdd_slopes(times, states)
                if self._stiffness(length) > _STIFF:
                    return None
                self._slopes = None
            last_change = change
        return None

    def _qdd_slopes(self, times: Array, states: Array) -> tuple[Array, Array]:
        """Return the derivatives of q'' by q and q', (m, dof, dof) each, by forward differences."""
        # 1.5e-8 is the square root of the spacing of doubles at 1, which balances truncation and rounding errors.
        columns = np.arange(self.q.start, self._qd.stop)
        increments = 1.5e-8 * (1 + np.abs(states[:, columns]))
        shifted = np.repeat(states[None], 1 + len(columns), axis=0)
        for k, column in enumerate(columns):
            shifted[1 + k, :, column] += increments[:, k]
        rates = self.rates(np.tile(times, len(shifted)), shifted.reshape(-1, states.shape[1]))[:, self._qd]
        unshifted, *others = rates.reshape(len(shifted), len(times), self._dof)
        slopes = np.zeros((len(times), self._dof, 2 * self._dof))
        for k, x in enumerate(others):
            slopes[..., k] = (x - unshifted) / increments[:, k, None]
        return slopes[..., : self._dof], slopes[..., self._dof :]

    def _newton_matrices(self, length: float) -> tuple[Array, Array]:
        """Return the square matrices of Newton's method, of 8 dof rows: the second takes residuals of q to residuals
        of q', the first the sum of these and those of q' to the change of q'.
        """
        size, integrals = NODES * self._dof, length * _INTEGRALS
        by_q, by_qd = (
            np.einsum("ij,jab->iajb", integrals, slopes).reshape(size, size)
            for slopes in self._slopes or (np.zeros((NODES, self._dof, self._dof)),) * 2
        )
        matrix = np.eye(size) - by_qd - by_q @ np.kron(integrals, np.eye(self._dof))
        return np.asarray(np.linalg.inv(matrix), np.float64), by_q

    def _damp_stiff_errors(self, errors: Array, length: float) -> Array:
        """Return errors of derivatives, (m, k), without what stiff accelerations damp within the step."""
        if self._slopes is None:
            return errors
        by_q, by_qd = (length * slopes.mean(axis=0) for slopes in self._slopes)
        eye = np.eye(self._dof)
        errors, block = errors.copy(), slice(self.q.start, self._qd.stop)
        matrix = np.block([[eye, -length * eye], [-by_q, eye - by_qd]])
        errors[:, block] = np.linalg.solve(matrix, errors[:, block].T).T
        return errors

    def _predict_rates(self, times: Array) -> Array:
        """Return the derivatives at the nodes that the polynomial of the last step predicts, (8, k); 0 at first."""
        last_step = self._last_step
        if last_step is None:
            return np.zeros((NODES, len(self.state)))
        relative_times = (times - last_step.start) / last_step.length
        times = relative_times if relative_times[-1] <= _MAX_GROWTH else np.ones(NODES)
        return interpolation_matrix(times) @ last_step.rates

    def _error_sizes(self, length: float) -> Array:
        """Return the scales of errors, (k,); those of velocities and momenta are divided by the length."""
        return np.where(self.rate_mask, self.sizes / length, self.sizes)

    def _estimate_error(
        self, node_rates: Array, length: float, shortest_length: float, extra_times: Array
    ) -> tuple[float, float]:
        """Return an estimate of the error between the nodes, in units of the tolerance, and the share of the step
        that could be kept: 0 unless only checks at the extra times find an error above 1. Steps of at most
        `shortest_length` [s] count as steps across a jump.
        """
        jumps = length <= max(1e-12 * self._recent_step_length, shortest_length)
        sizes = self._error_sizes(length if jumps else max(length, self._recent_step_length))
        units = length / (self.tol * sizes + 1e-15 * np.abs(self.state))
        tails = np.abs(self._damp_stiff_errors(_SERIES[-3:] @ node_rates, length) * units).max(axis=1)
        first, second, third = map(float, tails)
        ratio = min(1.0, max(third / second if second else 0.0, second / first if first else 0.0))
        error = max(third, second * ratio) * ratio
        if not error <= 1:
            return error, 0.0
        times, gaps, to_states, to_rates = _BETWEEN, _GAPS, _TO_STATES, _TO_RATES
        if extra_times.size:
            times, order = np.unique(np.hstack([_BETWEEN, extra_times]), return_index=True)
            gaps = (np.diff(times, prepend=0.0) + np.diff(times, append=1.0))[:, None]
            is_check_time = order < len(_BETWEEN)
            gaps[is_check_time] = _GAPS[order[is_check_time]]
            to_states, to_rates = integration_matrix(times), interpolation_matrix(times)
        rates = self.rates(self.t + length * times, self.state + length * (to_states @ node_rates))
        differences = self._damp_stiff_errors(rates - to_rates @ node_rates, length)
        residuals = (np.abs(differences) * gaps * units).max(axis=1)
        worst = float(residuals.max())
        if worst <= 1 or not extra_times.size:
            return max(error, worst), 0.0
        first_failed = int(np.argmax(~(residuals <= 1)))
        return worst, float(times[first_failed - 1]) if first_failed else 0.0


def event_margin(size: Any, slope: Any, time_rounding: float) -> Any:
    """Return the distance past an event that rounding alone may cause; closer, events cannot be told apart."""
    return 2e-15 * size + 64 * time_rounding * slope


def _bracket_crossing(
    times: Array, distances: Array, margin: float, distance_at: Callable[[Array], Array]
) -> tuple[float, float] | None:
    """Return two times between which the distance from an event first falls below -margin, or None. Between the given
    times, a crossing is searched for where the polynomial through the distances at _EVENT_TIMES is negative.
    """
    below = np.flatnonzero(~(distances >= -margin))
    bracket = (float(times[max(below[0] - 1, 0)]), float(times[below[0]])) if below.size else None
    series = _EVENT_SERIES @ distances[np.searchsorted(times, _EVENT_TIMES)]
    if not series[0] - float(np.abs(series[1:]).sum()) < -margin:
        return bracket
    series = np.asarray(legendre.legtrim(series, margin / 64))  # rounding errors would have roots of their own
    roots = legendre.legroots(series).real
    ends = np.hstack([-1.0, np.sort(roots[np.abs(roots) < 1]), 1.0])
    middles = (ends[1:] + ends[:-1]) / 2
    candidates = (middles[legendre.legval(middles, series) < -margin] + 1) / 2
    for candidate in candidates:
        if bracket and candidate >= bracket[1]:
            break
        if distance_at(np.array([candidate]))[0] < -margin:
            return float(times[np.searchsorted(times, candidate) - 1]), float(candidate)
    return bracket


def _bisect_crossing(start: float, end: float, margin: float, distance_at: Callable[[Array], Array]) -> float:
    """Return the first time in the bracket at which the distance is below -margin, as it is at the end."""
    while end - start > 2e-16 * (1 + end):
        times = np.linspace(start, end, 17)
        below = int(np.argmax(~(distance_at(times) >= -margin)))
        if not below:
            return float(times[0])
        if (float(times[below - 1]), float(times[below])) == (start, end):
            break
        start, end = float(times[below - 1]), float(times[below])
    return end
