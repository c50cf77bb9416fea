"""Events of a motion: kinks of the loads of joints, stick and slip, rigid stops, and the user's event.

A joint whose friction sticks, or that lies against a rigid stop, is held: it stays, and a holding effort makes its
acceleration zero. It is released where the holding effort would exceed the friction, or would pull at the stop.
Where a joint comes to rest, the friction of all joints at rest is solved at once, since each of them is felt by the
others. At a rigid stop an impulse reverses the rate of the joint with the coefficient of restitution. It changes the
rates of all joints through the mass matrix, but not the momenta of a free or pinned base, which are other components
of the state.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, DtypeError, ShapeError, quoted
from hingepair.mechanism.bodies.hinge_load import call_with_arrays, rate_kinks, stop_angles, stop_range
from hingepair.motion.collocation import event_margin
from hingepair.motion.equations_of_motion import RobotMotion
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import real_array


def forces_within_limits(mobility: Array, free: Array, lowest: Array, highest: Array) -> Array:
    """Return the forces f between their limits with which each element of a = free + mobility f is 0, or is at
    least 0 where f is at its lowest, or at most 0 where f is at its highest.

    The mobility is symmetric and positive definite: the forces minimise f^T mobility f / 2 + free^T f, and with the
    Cholesky factor of the mobility this is a problem of least squares.

    Args:
        mobility: accelerations by unit forces; shape (n, n).
        free: accelerations without these forces; shape (n,).
        lowest: lower limits of the forces, -inf where there is none; shape (n,).
        highest: upper limits, at least the lower ones; shape (n,).

    >>> forces_within_limits(np.eye(2), np.array([-3.0, 1.0]), np.zeros(2), np.full(2, 2.0))
    array([2., 0.])
    """
    from scipy.optimize import lsq_linear

    root = np.linalg.cholesky(mobility)
    scale = float(np.abs(np.linalg.solve(mobility, free)).max(initial=0.0)) or 1.0  # the tolerance is absolute
    bounds = lowest / scale, highest / scale
    found = lsq_linear(root.T, np.linalg.solve(root, -free / scale), bounds, method="bvls", tol=1e-15)
    side = found.active_mask  # of each force: at its lowest (-1), within its limits (0), at its highest (1)
    return np.where(side < 0, lowest, np.where(side > 0, highest, scale * found.x))


UserEvent: TypeAlias = Callable[[Array, Any], ArrayLike]
"""Event of the user: a callable of instants (n,) and the motion at them that returns values (n,), 0 at the event."""

# Kinds of events: the next kinks in coordinate and rate, release of a held joint, and the user's event.
_LOWER_ANGLE, _UPPER_ANGLE = "lower angle", "upper angle"
_LOWER_RATE, _UPPER_RATE = "lower rate", "upper rate"
_RELEASE_DOWN, _RELEASE_UP = "release downwards", "release upwards"
_USER = "until"  # as the argument of `simulate`
_MARK = "mark"
_HOLDING: Final = 1e-12  # of the efforts: by which the holding effort may exceed its limit, for rounding


class JointEvents:
    """Events of the joints, which switch the motion's `side` and `held`.

    Args:
        motion: the motion.
        start: the first instant [s].
        tol: largest error of a step [rad].
        user_event: ends the motion where its value passes 0; None: no such event.
        span: length of the whole motion [s].

    Raises:
        ArgumentError: the event's `direction` is none.
    """

    def __init__(
        self, motion: RobotMotion, start: float, tol: float, user_event: UserEvent | None, span: float = 0.0
    ) -> None:
        self._motion, self._start, self._tol, self._user_event, self._span = motion, start, tol, user_event, span
        loads = motion.joint_loads
        self._angle_kinks = [(-np.inf, *stop_angles(load), np.inf) for load in loads]
        self._rate_kinks = [(-np.inf, *rate_kinks(load), np.inf) for load in loads]
        self._friction = np.array([load.sticking_friction for load in loads])
        self._rigid_stops = [load.rigid_stops for load in loads]
        self._direction: Any = getattr(user_event, "direction", 0)
        if not isinstance(self._direction, int | float | np.number) or self._direction not in (-1, 0, 1):
            expected = "1 (where it rises), -1 (where it falls) or 0 (both)"
            raise ArgumentError("until.direction", expected, quoted(self._direction))
        self._sign = 0.0  # of the value of the user's event; 0 while it is not known
        self._largest = 0.0  # absolute value of the user's event so far
        self.ended_by = ""  # why the motion ended; "" while it goes on
        self._mark_signs = np.sign(motion.marks.distances(motion.state[None, motion.q])[0]).tolist()
        self._passed_at = -np.inf  # when the user's event last passed 0 against its direction [s]
        self._effort_limits = [(0.0, 0.0)] * len(loads)  # of the holding efforts
        self._qd = slice(motion.q.stop, 2 * motion.q.stop - motion.q.start)
        q, qd = motion.state[motion.q].tolist(), motion.state[self._qd].tolist()
        # A joint at its lower rigid stop is above it.
        self._angle_intervals = [
            sum(kink < x for kink in stop_angles(load)) + (stop_range(load, rigid=True)[0] == x)
            for load, x in zip(loads, q, strict=True)
        ]
        self._rate_intervals = [sum(kink < x for kink in rate_kinks(load)) for load, x in zip(loads, qd, strict=True)]
        self._rows: list[tuple[str, int]] = []  # kind and joint of each event
        self._update_branches()
        self._settle(0.0, motion.state)

    @property
    def any_events(self) -> bool:
        """Whether any event can happen."""
        return bool(
            self._user_event
            or self._motion.marks.ends
            or any(stop_angles(load) or rate_kinks(load) for load in self._motion.joint_loads)
        )

    def distances(self, t: Array, states: Array) -> tuple[Array, Array]:
        """Return the distances from each event, (m, e), positive until it happens, at times t since the start [s],
        and the sizes (e,) that scale their rounding errors.
        """
        motion = self._motion
        rows: dict[tuple[str, int], tuple[Array, float]] = {}
        efforts = motion.holding_efforts(self._start + t, states) if motion.held.any() else None
        for k, held in enumerate(motion.held.tolist()):
            if held and efforts is not None:
                effort, (lowest, highest) = efforts[:, k], self._effort_limits[k]
                size = _HOLDING / 2e-15 * (self._friction[k] + float(np.abs(effort).max()))
                rows |= {(_RELEASE_UP, k): (effort - lowest, size)} if lowest > -np.inf else {}
                rows |= {(_RELEASE_DOWN, k): (highest - effort, size)} if highest < np.inf else {}
                continue
            for kinks, interval, column, lower, upper in (
                (self._angle_kinks[k], self._angle_intervals[k], motion.q.start + k, _LOWER_ANGLE, _UPPER_ANGLE),
                (self._rate_kinks[k], self._rate_intervals[k], self._qd.start + k, _LOWER_RATE, _UPPER_RATE),
            ):
                least, most = kinks[interval : interval + 2]
                if least == -np.inf and most == np.inf:
                    continue
                values = states[:, column]
                size = 1 + float(np.abs(values).max())
                rows |= {(lower, k): (values - least, size)} if least > -np.inf else {}
                rows |= {(upper, k): (most - values, size)} if most < np.inf else {}
        marks = motion.marks.distances(states[:, motion.q]) if motion.marks.ends else np.empty((len(states), 0))
        for i, (values, sign) in enumerate(zip(marks.T, self._mark_signs, strict=True)):
            if sign:
                rows[_MARK, i] = sign * values, 1 + float(np.abs(values[np.isfinite(values)]).max(initial=0.0))
        if self._user_event is not None:
            values = self._user_values(self._start + t, states)
            finite = values[np.isfinite(values)]  # at others the stepper stops, and `apply` refuses them
            size = float(np.abs(finite).max(initial=0.0))
            if not self._sign:  # where the value is 0 at the start, the sign of the first certain value
                certain_values = finite[np.abs(finite) > 1e-6 * size]
                self._sign = float(np.sign(certain_values[0])) if certain_values.size else 0.0
            self._largest = max(self._largest, size)
            rows[_USER, -1] = np.where(np.isfinite(values), self._sign * values, np.nan), size
        self._rows = [*rows]
        distances = np.stack([distance for distance, _ in rows.values()], axis=-1) if rows else np.ones((len(t), 0))
        return distances, np.array([size for _, size in rows.values()])

    def apply(self, event_index: int, t: float, state: Array) -> Array | None:
        """Apply an event out of the last result of `distances`; return the state after it, a copy, or None where the
        motion ends.
        """
        kind, k = self._rows[event_index]
        state = state.copy()
        if kind == _USER:
            self._check_user_value(t, state)
            self.ended_by = _USER if self._ends_motion() else ""
            self._sign, self._passed_at = -self._sign, t
            return None if self.ended_by else state
        if kind == _MARK:
            self.ended_by = self._motion.marks.ends[k] if self._mark_signs[k] > 0 else ""
            self._mark_signs[k] *= -1
            return None if self.ended_by else state
        if kind in (_LOWER_ANGLE, _UPPER_ANGLE):
            kink = self._angle_kinks[k][self._angle_intervals[k] + (kind == _UPPER_ANGLE)]
            if kink in self._rigid_stops[k]:
                self._rebound(t, state, k, kink, 1 if kind == _UPPER_ANGLE else -1)
                return None if self._lands_on_zero(t, state) else state
            self._angle_intervals[k] += 1 if kind == _UPPER_ANGLE else -1
        elif kind in (_LOWER_RATE, _UPPER_RATE):
            kink = self._rate_kinks[k][self._rate_intervals[k] + (kind == _UPPER_RATE)]
            if kink == 0 and self._friction[k]:
                state[self._qd.start + k] = 0.0
                self._settle(t, state)
                return None if self._lands_on_zero(t, state) else state
            self._rate_intervals[k] += 1 if kind == _UPPER_RATE else -1
        else:
            self._release(k, 1 if kind == _RELEASE_UP else -1)
        self._update_branches()
        return state

    def _check_user_value(self, t: float, state: Array) -> None:
        """Refuse a value of the user's event that is not finite, here or just behind the event."""
        now, ahead = np.array([self._start + t]), 1e-12 * max(1.0, self._span)  # s, more than events are rounded by
        later = state + ahead * self._motion.rates(now, state[None])[0]
        values = self._user_values(np.append(now, now + ahead), np.stack([state, later]))
        if not np.isfinite(values).all():
            value = values[~np.isfinite(values)][0]
            raise ArgumentError("until", "a finite number at every instant", f"{value} at t = {self._start + t:.9g}")

    def _ends_motion(self) -> bool:
        """Return whether the user's event ends the motion when its value passes 0 from its present sign."""
        return bool(self._direction * self._sign <= 0)

    def _lands_on_zero(self, t: float, state: Array) -> bool:
        """Return whether the motion ends because an impact, or friction that stops the hinge, leaves the value of the
        user's event at exactly 0: from there it may stay 0 or turn back, and never pass.
        """
        if self._user_event is None or not self._sign:
            return False
        value = float(self._user_values(np.array([self._start + t]), state[None])[0])
        if abs(value) > 1e-12 * self._largest:
            return False
        tolerance = 1e-13 * max(1.0, t)  # events so close happen at once
        ends = self._ends_motion() and t - self._passed_at > tolerance
        self._sign = 0.0
        self.ended_by = _USER if ends else ""
        return ends

    def _user_values(self, t: Array, states: Array) -> Array:
        """Return the values of the user's event, (m,)."""
        now = self._motion.motion_at(t, states)
        result = call_with_arrays("until", self._user_event, t, now)  # type: ignore[arg-type]
        example = "now.psi - 0.3" if hasattr(now, "psi") else "now.q[:, 1] - 0.3"
        if isinstance(result, bool) or getattr(result, "dtype", None) == np.bool_:
            raise DtypeError("until", f"a number that passes 0, such as {example}", "a bool")
        values = real_array("until", result)
        if values.shape != t.shape:
            expected = f"shape (n,), one value for each instant of t (here {len(t)}), such as {example}"
            raise ShapeError("until", expected, values.shape)
        return np.array(values, np.float64)

    def _update_branches(self) -> None:
        """Set `side` of the motion by the present intervals of coordinates and rates between kinks."""
        angles = [_value_in_interval(*one) for one in zip(self._angle_kinks, self._angle_intervals, strict=True)]
        rates = [_value_in_interval(*one) for one in zip(self._rate_kinks, self._rate_intervals, strict=True)]
        self._motion.side = np.array(angles), np.where(self._motion.held, 0.0, rates)

    def _release(self, k: int, direction: int) -> None:
        """Set a joint free to move upwards (1) or downwards (-1)."""
        self._motion.held[k] = False
        if self._friction[k]:
            self._rate_intervals[k] = self._rate_kinks[k].index(0.0) - (direction < 0)

    def _settle(self, t: float, state: Array) -> None:
        """Hold those joints at rest whose friction and stops suffice for that, all together, and release the others;
        each of those that move is on the branch of its rate.
        """
        motion, resting = self._motion, list[int]()
        q, qd = state[motion.q].tolist(), state[self._qd].tolist()
        for k, rate in enumerate(qd):
            if not rate and (self._friction[k] or q[k] in self._rigid_stops[k]):
                resting.append(k)
            elif rate:
                motion.held[k] = False
        if not resting:
            self._update_branches()
            return
        # The accelerations without what may hold the joints.
        motion.held[resting] = True
        self._update_branches()  # friction does not act on them
        motion.held[resting] = False
        free = motion.joint_accelerations(self._start + t, state)[resting]
        mobility = motion.joint_mobility(self._start + t, state)[np.ix_(resting, resting)]
        limits = [self._limits(k, q[k]) for k in resting]
        lowest, highest = np.array(limits).T
        efforts = forces_within_limits(mobility, free, lowest, highest)
        margins = _HOLDING * (self._friction[resting] + np.abs(efforts))
        motion.held[resting] = True
        for i, k in enumerate(resting):
            self._effort_limits[k] = limits[i]
            at_lowest, at_highest = efforts[i] <= lowest[i], efforts[i] >= highest[i]
            if at_lowest or at_highest:
                # By less than rounding beyond what holds it?
                needed = efforts[i] - (free[i] + mobility[i] @ efforts) / mobility[i, i]
                if not lowest[i] - margins[i] <= needed <= highest[i] + margins[i]:
                    self._release(k, 1 if at_lowest else -1)
        self._update_branches()

    def _limits(self, k: int, q: float) -> tuple[float, float]:
        """Return the limits of the effort that can hold a joint at q."""
        at_stop, is_upper = q in self._rigid_stops[k], self._is_upper(k, q)
        friction = float(self._friction[k])
        return -np.inf if at_stop and is_upper else -friction, np.inf if at_stop and not is_upper else friction

    def _is_upper(self, k: int, stop: float) -> bool:
        """Return whether a rigid stop is the upper limit of the present interval of a joint."""
        return bool(self._angle_kinks[k][self._angle_intervals[k] + 1] == stop)

    def _rebound(self, t: float, state: Array, k: int, stop: float, side: int) -> None:
        """Put the state, in place, after an impact of a joint at a rigid stop on the upper (1) or lower (-1) side. A
        joint that would rebound too little to be followed comes to rest.
        """
        column = self._qd.start + k
        state[self._motion.q.start + k] = stop
        before, held = state[self._qd].copy(), self._motion.held.copy()
        self._collide(t, state, k, self._rigid_stops[k][stop], side)
        rate = float(state[column])
        if rate:
            pressing_acceleration = side * self._motion.joint_accelerations(self._start + t, state)[k]
            # The next impact can be located only if the joint rises well above the margin within which `Stepper`
            # takes it for still at the stop; small tolerances lie below that margin.
            margin = event_margin(1 + abs(stop), abs(rate), np.spacing(max(t, self._span)))
            lowest = max(0.01 * self._tol, 8 * margin)  # a lower rebound is held
            if pressing_acceleration > 0 and rate**2 <= 2 * pressing_acceleration * lowest:
                state[self._qd], self._motion.held[:] = before, held
                self._collide(t, state, k, 0.0, side)

    def _collide(self, t: float, state: Array, k: int, restitution: float, side: int) -> None:
        """Change the rates of a state, in place, by the impulse at a stop of a joint, and by those at the stops at
        which other joints rest; dry friction gives no impulse.
        """
        motion = self._motion
        rates, q = state[self._qd], state[motion.q].tolist()
        before = rates.copy()
        stopped = [k] + [i for i, held in enumerate(motion.held) if held and i != k and q[i] in self._rigid_stops[i]]
        inward = np.array([-side] + [-1 if self._is_upper(i, q[i]) else 1 for i in stopped[1:]])
        if len(rates) > 1:
            mobility = motion.joint_mobility(self._start + t, state)
            among = mobility[np.ix_(stopped, stopped)] * inward * inward[:, None]
            leaving = inward * before[stopped] * np.where(np.arange(len(stopped)) == 0, 1 + restitution, 1.0)
            impulses = forces_within_limits(among, leaving, np.zeros(len(stopped)), np.full(len(stopped), np.inf))
            changes = mobility[:, stopped] @ (inward * impulses)
            # A joint at rest that nothing couples to the impact rests on, in spite of rounding.
            changes[(before == 0) & (np.abs(changes) <= 1e-14 * np.abs(changes).max(initial=0.0))] = 0.0
            rates += changes
            for i, impulse in zip(stopped[1:], impulses[1:], strict=True):
                if impulse > 0:
                    rates[i] = 0.0
        rates[k] = -restitution * before[k]
        for i, rate in enumerate(rates.tolist()):
            if rate:
                self._rate_intervals[i] = sum(bound < rate for bound in self._rate_kinks[i][1:-1])
        self._settle(t, state)


def _value_in_interval(kinks: tuple[float, ...], interval_index: int) -> float:
    """Return a number between kinks[interval_index] and kinks[interval_index + 1]; either of these two, or both, may
    be infinite.
    """
    lower, upper = kinks[interval_index : interval_index + 2]
    if lower == -np.inf:
        return upper - 1 if upper < np.inf else 0.0
    return (lower + upper) / 2 if upper < np.inf else lower + 1
