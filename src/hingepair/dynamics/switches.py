"""Events of a motion: kinks of the torque at the hinge, friction that sticks and slips, rigid stops, and the user's.

A hinge whose friction sticks, or that lies against a rigid stop, is held: psi stays, and what holds it is the torque
that takes psi'' to 0. It is let go where more than the friction, or a pull of the stop, would be needed. At a rigid
stop psi' turns back by the coefficient of restitution, while the momenta of a free or pinned pair, which are states
of their own, go on unchanged.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.dynamics.bases import PairMotion
from hingepair.dynamics.collocation import Array
from hingepair.dynamics.loads import Moving
from hingepair.errors import ArgumentError, DtypeError, ShapeError, quoted
from hingepair.numeric.arrays import real_array
from hingepair.pair.hinge_load import call_with_arrays

Until: TypeAlias = Callable[[Array, Moving], ArrayLike]

_LOWER, _UPPER, _SLOWER, _FASTER = "lower angle", "upper angle", "lower rate", "upper rate"
_DOWN, _UP, _UNTIL = "let go downwards", "let go upwards", "until"
_TOUCH: Final = 0.01  # of the tolerance: a hinge that would rebound from a stop by less stays there
_CERTAIN_VALUE: Final = 1e-6  # of the largest in the first step: a value of the user's event whose sign counts
_ZERO_VALUE: Final = 1e-12  # of the largest so far: a value of the user's event that counts as 0 where it lands
_SAME_INSTANT: Final = 1e-13  # of the time: events so close to each other happen at once
_HOLD_MARGIN: Final = 1e-12  # of the torques: what holds a hinge may pass its limit by so much, for rounding


class HingeSwitches:
    """The side of each kink on which a motion is, how far it is from the next event, and what follows from one.

    Args:
        motion: the motion, whose side and hold are set here.
        start: the first instant [s].
        tol: largest error of a step [rad].
        until: the user's event, a callable of (t, now); ends the motion where it passes 0.
    """

    def __init__(self, motion: PairMotion, start: float, tol: float, until: Until | None) -> None:
        self._motion, self._start, self._tol, self._until = motion, start, tol, until
        loads = motion.loads
        self._levels, self._rate_levels = (-np.inf, *loads.levels, np.inf), (-np.inf, *loads.rate_levels, np.inf)
        self._friction, self._rigid = loads.friction, loads.rigid_stops
        self._direction: Any = getattr(until, "direction", 0)
        if not isinstance(self._direction, int | float | np.number) or self._direction not in (-1, 0, 1):
            expected = "1 (where it rises), -1 (where it falls) or 0 (both)"
            raise ArgumentError("until.direction", expected, quoted(self._direction))
        self._sign = 0.0  # of the user's event; 0 where it is not known yet
        self._largest = 0.0  # value of the user's event so far
        self._passed_at = -np.inf  # when the user's event last passed 0 against its direction [s]
        self._limits = (0.0, 0.0)  # of the torque that holds the hinge
        psi, psid = map(float, motion.state[motion.angle : motion.angle + 2])
        inside = loads.rigid_range[0] == psi  # of a rigid stop that it touches
        self._place = sum(level < psi for level in loads.levels) + inside
        self._rate_place = sum(level < psid for level in loads.rate_levels)
        self._names: tuple[str, ...] = ()
        self._set_side()
        if psid == 0 and (self._friction or psi in self._rigid):
            self._rest(0.0, motion.state)

    @property
    def needed(self) -> bool:
        """Whether there is any event."""
        return bool(self._motion.loads.levels or self._motion.loads.rate_levels or self._until)

    def distances(self, t: Array, states: Array) -> tuple[Array, Array]:
        """Compute how far instants and states are from each event, and the sizes of what is compared."""
        psi, psid = states[:, self._motion.angle], states[:, self._motion.angle + 1]
        rows: dict[str, tuple[Array, float]] = {}
        if self._motion.held:
            torque = self._motion.holding_torque(self._start + t, states)
            size = _HOLD_MARGIN / 2e-15 * (self._friction + float(np.abs(torque).max()))
            lowest, highest = self._limits
            rows |= {_UP: (torque - lowest, size)} if lowest > -np.inf else {}
            rows |= {_DOWN: (highest - torque, size)} if highest < np.inf else {}
        else:
            lower, upper = self._levels[self._place : self._place + 2]
            slower, faster = self._rate_levels[self._rate_place : self._rate_place + 2]
            size, rate_size = 1 + float(np.abs(psi).max()), 1 + float(np.abs(psid).max())
            for name, distance, scale in (
                (_LOWER, psi - lower, size),
                (_UPPER, upper - psi, size),
                (_SLOWER, psid - slower, rate_size),
                (_FASTER, faster - psid, rate_size),
            ):
                if np.isfinite(distance).all():
                    rows[name] = distance, scale
        if self._until is not None:
            values = self._user_values(self._start + t, states)
            if not self._sign:  # of a value that is 0 at the start, that of the first that is more than round-off
                certain = values[np.abs(values) > _CERTAIN_VALUE * np.abs(values).max()]
                self._sign = float(np.sign(certain[0])) if certain.size else 0.0
            size = float(np.abs(values).max())
            self._largest = max(self._largest, size)
            rows[_UNTIL] = self._sign * values, size
        self._names = tuple(rows)
        distances = np.stack([distance for distance, _ in rows.values()], axis=-1) if rows else np.ones((len(t), 0))
        return distances, np.array([size for _, size in rows.values()])

    def switch(self, event: int, t: float, state: Array) -> Array | None:
        """Return the state after an event; None where it is the user's, which ends the motion."""
        name, angle = self._names[event], self._motion.angle
        state = state.copy()
        if name == _UNTIL:
            ends = self._ends_motion()
            self._sign, self._passed_at = -self._sign, t
            return None if ends else state
        if name in (_LOWER, _UPPER):
            level = self._levels[self._place + (name == _UPPER)]
            if level in self._rigid:
                self._strike(t, state, level, 1 if name == _UPPER else -1)
                return None if self._lands_on_zero(t, state) else state
            self._place += 1 if name == _UPPER else -1
        elif name in (_SLOWER, _FASTER):
            level = self._rate_levels[self._rate_place + (name == _FASTER)]
            if level == 0 and self._friction:
                state[angle + 1] = 0.0
                self._rest(t, state)
                return None if self._lands_on_zero(t, state) else state
            self._rate_place += 1 if name == _FASTER else -1
        else:
            self._slide(1 if name == _UP else -1)
        self._set_side()
        return state

    def _ends_motion(self) -> bool:
        """Return whether the user's event ends the motion where its value now comes to 0: its direction decides."""
        return bool(self._direction * self._sign <= 0)

    def _lands_on_zero(self, t: float, state: Array) -> bool:
        """Return whether an impact, or friction that stops the hinge, ends the motion by a value of exactly 0.

        From there the value may stay 0 or turn back, so that it never passes 0.
        """
        if self._until is None or not self._sign:
            return False
        value = float(self._user_values(np.array([self._start + t]), state[None])[0])
        if abs(value) > _ZERO_VALUE * self._largest:
            return False
        ends = self._ends_motion() and t - self._passed_at > _SAME_INSTANT * max(1.0, t)
        self._sign = 0.0
        return ends

    def _user_values(self, t: Array, states: Array) -> Array:
        """Compute the values of the user's event at some instants; shape (m,)."""
        answer = call_with_arrays("until", self._until, t, self._motion.moving(t, states))  # type: ignore[arg-type]
        if isinstance(answer, bool) or getattr(answer, "dtype", None) == np.bool_:
            raise DtypeError("until", "a number that passes 0, such as now.psi - 0.3", "a truth value")
        values = real_array("until", answer)
        if values.shape != t.shape:
            expected = f"shape (n,), one value for each instant of t (here {len(t)}), such as now.psi - 0.3"
            raise ShapeError("until", expected, values.shape)
        return np.array(values, np.float64)

    def _set_side(self) -> None:
        """Set the side of the kinks on which the motion is."""
        held = self._motion.held
        self._motion.side = (
            _between(self._levels, self._place),
            0.0 if held else _between(self._rate_levels, self._rate_place),
        )

    def _slide(self, sense: int) -> None:
        """Let the hinge go, upwards (1) or downwards (-1)."""
        self._motion.held = False
        if self._friction:
            self._rate_place = self._rate_levels.index(0.0) - (sense < 0)
        self._set_side()

    def _rest(self, t: float, state: Array) -> None:
        """Hold the hinge, whose rate is 0, or let it go where what is needed is more than can be had."""
        psi = float(state[self._motion.angle])
        lowest = -np.inf if psi in self._rigid and self._is_upper(psi) else -self._friction
        highest = np.inf if psi in self._rigid and not self._is_upper(psi) else self._friction
        self._motion.held = True
        self._set_side()
        torque = float(self._motion.holding_torque(np.array([self._start + t]), state[None])[0])
        margin = _HOLD_MARGIN * (self._friction + abs(torque))
        if not lowest - margin <= torque <= highest + margin:
            self._slide(-1 if torque > highest else 1)
        self._limits = lowest, highest

    def _is_upper(self, angle: float) -> bool:
        """Return whether a rigid stop bounds the angles from above."""
        return bool(self._levels[self._place + 1] == angle)

    def _strike(self, t: float, state: Array, level: float, sense: int) -> None:
        """Turn the hinge back from a rigid stop, above (1) or below (-1), or hold it there."""
        angle = self._motion.angle
        state[angle] = level
        state[angle + 1] *= -self._rigid[level]
        rate = float(state[angle + 1])
        if not rate:
            self._rest(t, state)
            return
        self._rate_place = sum(bound < rate for bound in self._rate_levels[1:-1])
        self._set_side()
        pressing = sense * self._motion.hinge_acceleration(self._start + t, state)
        if pressing > 0 and rate**2 <= 2 * pressing * _TOUCH * self._tol:
            state[angle + 1] = 0.0
            self._rest(t, state)


def _between(levels: tuple[float, ...], place: int) -> float:
    """Return a value between a level and the next."""
    lower, upper = levels[place : place + 2]
    if lower == -np.inf:
        return upper - 1 if upper < np.inf else 0.0
    return (lower + upper) / 2 if upper < np.inf else lower + 1
