"""Events of a motion: kinks of the torque at the hinge, stick and slip, rigid stops, and the user's event.

A hinge whose friction sticks, or that lies against a rigid stop, is held: psi stays, and a holding torque makes psi''
zero. The hinge is released where the holding torque would exceed the friction, or would pull at the stop. At a rigid
stop psi' is reversed with the coefficient of restitution, while the momenta of a free or pinned pair, which are other
components of the state, do not change.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.dynamics.collocation import event_margin
from hingepair.dynamics.loads import MotionAtInstants
from hingepair.dynamics.pair_motion import PairMotion
from hingepair.errors import ArgumentError, DtypeError, ShapeError, quoted
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import real_array
from hingepair.pair.hinge_load import call_with_arrays

UserEvent: TypeAlias = Callable[[Array, MotionAtInstants], ArrayLike]
"""Event of the user: a callable of instants (n,) and the motion at them that returns values (n,), 0 at the event."""

# Names of events: the next kinks in angle and rate, release of a held hinge, and the user's event.
_LOWER_ANGLE, _UPPER_ANGLE = "lower angle", "upper angle"
_LOWER_RATE, _UPPER_RATE = "lower rate", "upper rate"
_RELEASE_DOWN, _RELEASE_UP = "release downwards", "release upwards"
_USER = "until"  # as the argument of `simulate`
_HOLDING: Final = 1e-12  # of the torques: by which the holding torque may exceed its limit, for rounding


class HingeEvents:
    """Events of a hinge, which switch the motion's `side`, the smooth branch of the hinge torque, and `held`.

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
        self, motion: PairMotion, start: float, tol: float, user_event: UserEvent | None, span: float = 0.0
    ) -> None:
        self._motion, self._start, self._tol, self._user_event, self._span = motion, start, tol, user_event, span
        loads = motion.loads
        self._angle_kinks, self._rate_kinks = (-np.inf, *loads.kinks, np.inf), (-np.inf, *loads.rate_kinks, np.inf)
        self._friction, self._rigid_stops = loads.friction, loads.rigid_stops
        self._direction: Any = getattr(user_event, "direction", 0)
        if not isinstance(self._direction, int | float | np.number) or self._direction not in (-1, 0, 1):
            expected = "1 (where it rises), -1 (where it falls) or 0 (both)"
            raise ArgumentError("until.direction", expected, quoted(self._direction))
        self._sign = 0.0  # of the value of the user's event; 0 while it is not known
        self._largest = 0.0  # absolute value of the user's event so far
        self._passed_at = -np.inf  # when the user's event last passed 0 against its direction [s]
        self._torque_limits = (0.0, 0.0)  # of the holding torque [N m]
        psi, psid = map(float, motion.state[motion.psi_index : motion.psi_index + 2])
        touches_lower_stop = loads.rigid_range[0] == psi  # whether the hinge touches the lower rigid stop
        self._angle_interval = sum(kink < psi for kink in loads.kinks) + touches_lower_stop
        self._rate_interval = sum(kink < psid for kink in loads.rate_kinks)
        self._names: tuple[str, ...] = ()
        self._update_torque_branch()
        if psid == 0 and (self._friction or psi in self._rigid_stops):
            self._hold(0.0, motion.state)

    @property
    def any_events(self) -> bool:
        """Whether any event can happen."""
        return bool(self._motion.loads.kinks or self._motion.loads.rate_kinks or self._user_event)

    def distances(self, t: Array, states: Array) -> tuple[Array, Array]:
        """Return the distances from each event, (m, e), at instants from the start on, and the sizes (e,) that scale
        their rounding errors.
        """
        psi, psid = states[:, self._motion.psi_index], states[:, self._motion.psi_index + 1]
        rows: dict[str, tuple[Array, float]] = {}
        if self._motion.held:
            torque = self._motion.holding_torque(self._start + t, states)
            size = _HOLDING / 2e-15 * (self._friction + float(np.abs(torque).max()))
            lowest, highest = self._torque_limits
            rows |= {_RELEASE_UP: (torque - lowest, size)} if lowest > -np.inf else {}
            rows |= {_RELEASE_DOWN: (highest - torque, size)} if highest < np.inf else {}
        else:
            lower_angle, upper_angle = self._angle_kinks[self._angle_interval : self._angle_interval + 2]
            lower_rate, upper_rate = self._rate_kinks[self._rate_interval : self._rate_interval + 2]
            size, rate_size = 1 + float(np.abs(psi).max()), 1 + float(np.abs(psid).max())
            for name, distance, scale in (
                (_LOWER_ANGLE, psi - lower_angle, size),
                (_UPPER_ANGLE, upper_angle - psi, size),
                (_LOWER_RATE, psid - lower_rate, rate_size),
                (_UPPER_RATE, upper_rate - psid, rate_size),
            ):
                if np.isfinite(distance).all():
                    rows[name] = distance, scale
        if self._user_event is not None:
            values = self._user_values(self._start + t, states)
            finite = values[np.isfinite(values)]  # at others the stepper stops, and `apply` refuses them
            size = float(np.abs(finite).max(initial=0.0))
            if not self._sign:  # where the value is 0 at the start, the sign of the first certain value
                certain_values = finite[np.abs(finite) > 1e-6 * size]
                self._sign = float(np.sign(certain_values[0])) if certain_values.size else 0.0
            self._largest = max(self._largest, size)
            rows[_USER] = np.where(np.isfinite(values), self._sign * values, np.nan), size
        self._names = tuple(rows)
        distances = np.stack([distance for distance, _ in rows.values()], axis=-1) if rows else np.ones((len(t), 0))
        return distances, np.array([size for _, size in rows.values()])

    def apply(self, event_index: int, t: float, state: Array) -> Array | None:
        """Apply an event out of the last result of `distances`; return the state after it, a copy, or None where the
        motion ends.
        """
        name, psi_index = self._names[event_index], self._motion.psi_index
        state = state.copy()
        if name == _USER:
            self._check_user_value(t, state)
            ends = self._ends_motion()
            self._sign, self._passed_at = -self._sign, t
            return None if ends else state
        if name in (_LOWER_ANGLE, _UPPER_ANGLE):
            kink = self._angle_kinks[self._angle_interval + (name == _UPPER_ANGLE)]
            if kink in self._rigid_stops:
                self._rebound(t, state, kink, 1 if name == _UPPER_ANGLE else -1)
                return None if self._lands_on_zero(t, state) else state
            self._angle_interval += 1 if name == _UPPER_ANGLE else -1
        elif name in (_LOWER_RATE, _UPPER_RATE):
            kink = self._rate_kinks[self._rate_interval + (name == _UPPER_RATE)]
            if kink == 0 and self._friction:
                state[psi_index + 1] = 0.0
                self._hold(t, state)
                return None if self._lands_on_zero(t, state) else state
            self._rate_interval += 1 if name == _UPPER_RATE else -1
        else:
            self._release(1 if name == _RELEASE_UP else -1)
        self._update_torque_branch()
        return state

    def _check_user_value(self, t: float, state: Array) -> None:
        value = float(self._user_values(np.array([self._start + t]), state[None])[0])
        if not np.isfinite(value):
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
        return ends

    def _user_values(self, t: Array, states: Array) -> Array:
        """Return the values of the user's event, (m,).

        Raises:
            DtypeError, ShapeError: it does not return one number for each instant.
        """
        result = call_with_arrays("until", self._user_event, t, self._motion.motion_at(t, states))  # type: ignore[arg-type]
        if isinstance(result, bool) or getattr(result, "dtype", None) == np.bool_:
            raise DtypeError("until", "a number that passes 0, such as now.psi - 0.3", "a bool")
        values = real_array("until", result)
        if values.shape != t.shape:
            expected = f"shape (n,), one value for each instant of t (here {len(t)}), such as now.psi - 0.3"
            raise ShapeError("until", expected, values.shape)
        return np.array(values, np.float64)

    def _update_torque_branch(self) -> None:
        """Set `side` of the motion by the present intervals of angle and rate between kinks."""
        held = self._motion.held
        self._motion.side = (
            _value_in_interval(self._angle_kinks, self._angle_interval),
            0.0 if held else _value_in_interval(self._rate_kinks, self._rate_interval),
        )

    def _release(self, direction: int) -> None:
        """Set the hinge free to move upwards (1) or downwards (-1)."""
        self._motion.held = False
        if self._friction:
            self._rate_interval = self._rate_kinks.index(0.0) - (direction < 0)
        self._update_torque_branch()

    def _hold(self, t: float, state: Array) -> None:
        """Hold the hinge in a state with rate 0, unless the torque that holds it exceeds friction, or pulls at a
        stop.
        """
        psi = float(state[self._motion.psi_index])
        lowest = -np.inf if psi in self._rigid_stops and self._is_upper(psi) else -self._friction
        highest = np.inf if psi in self._rigid_stops and not self._is_upper(psi) else self._friction
        self._motion.held = True
        self._update_torque_branch()
        torque = float(self._motion.holding_torque(np.array([self._start + t]), state[None])[0])
        margin = _HOLDING * (self._friction + abs(torque))
        if not lowest - margin <= torque <= highest + margin:
            self._release(-1 if torque > highest else 1)
        self._torque_limits = lowest, highest

    def _is_upper(self, stop: float) -> bool:
        """Return whether a rigid stop is the upper limit of the present interval of angles."""
        return bool(self._angle_kinks[self._angle_interval + 1] == stop)

    def _rebound(self, t: float, state: Array, stop: float, side: int) -> None:
        """Put the state, in place, after an impact at a rigid stop on the upper (1) or lower (-1) side. A hinge that
        would rebound too little to be followed is held.
        """
        psi_index = self._motion.psi_index
        state[psi_index] = stop
        state[psi_index + 1] *= -self._rigid_stops[stop]
        rate = float(state[psi_index + 1])
        if not rate:
            self._hold(t, state)
            return
        self._rate_interval = sum(bound < rate for bound in self._rate_kinks[1:-1])
        self._update_torque_branch()
        pressing_acceleration = side * self._motion.hinge_acceleration(self._start + t, state)
        # The next impact can be located only if the hinge rises well above the margin within which
        # `Stepper` takes it for still at the stop; small tolerances lie below that margin.
        margin = event_margin(1 + abs(stop), abs(rate), np.spacing(max(t, self._span)))
        lowest = max(0.01 * self._tol, 8 * margin)  # a lower rebound is held
        if pressing_acceleration > 0 and rate**2 <= 2 * pressing_acceleration * lowest:
            state[psi_index + 1] = 0.0
            self._hold(t, state)


def _value_in_interval(kinks: tuple[float, ...], interval_index: int) -> float:
    """Return a number between kinks[interval_index] and kinks[interval_index + 1]; either of these two, or both, may
    be infinite.
    """
    lower, upper = kinks[interval_index : interval_index + 2]
    if lower == -np.inf:
        return upper - 1 if upper < np.inf else 0.0
    return (lower + upper) / 2 if upper < np.inf else lower + 1
