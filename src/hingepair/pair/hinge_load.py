"""What acts at the hinge about its axis: motor, spring, damper, friction and stops."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeAlias, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import Float64Array, finite_number

HingeTorque: TypeAlias = float | Callable[[Float64Array, Float64Array, Float64Array], ArrayLike]
HINGE_PARTS: Final = ("motor", "spring", "damper", "friction", "stop")
"""What the torque of a `HingeLoad` consists of; among all loads each is called with _torque behind."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HingeLoad:
    """Torque at the hinge from motor, spring, damper, friction and stops; a `hinge_torque` for `simulate`.

    torque = motor - stiffness (psi - rest) - damping psi' - friction tanh(psi' / friction_rate), and beyond a stop
    -stop_stiffness (psi - stop) - stop_damping psi'. A damped stop pulls at a hinge that leaves it quickly; friction
    does not hold: what sticks creeps.

    Args:
        stiffness: of the spring [N m/rad].
        rest: hinge angle where the spring is slack [rad].
        damping: of the damper [N m s/rad].
        friction: torque of dry friction [N m].
        friction_rate: rate at which friction has reached three quarters of its torque [rad/s]; what sticks creeps.
        stops: least and greatest hinge angle, such as `pair.limits` [rad]; none unless given.
        stop_stiffness: of the springs that the stops are [N m/rad].
        stop_damping: beyond a stop [N m s/rad]; without it the hinge leaves a stop as fast as it came.
        motor: what is added [N m]: a number, or a callable of arrays (t, psi, psid).

    Raises:
        ArgumentError: a value is not finite or below 0; names it.

    >>> import hingepair as hp
    >>> spring = hp.HingeLoad(stiffness=10, damping=0.5)
    >>> spring(0.0, psi=0.2, psid=1.0)
    -2.5
    """

    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    friction_rate: float = 1e-2
    stops: tuple[float, float] | None = None
    stop_stiffness: float = 1e4
    stop_damping: float = 0.0
    motor: HingeTorque = 0.0

    def __post_init__(self) -> None:
        if callable(self.motor):
            check_callable("motor", self.motor, "t", "psi", "psid")
        numbers = ["stiffness", "rest", "damping", "friction", "friction_rate", "stop_stiffness", "stop_damping"]
        for name in numbers if callable(self.motor) else ["motor", *numbers]:
            value = getattr(self, name)
            number = finite_number(name, value)
            if name not in {"motor", "rest"} and (number < 0 or (number == 0 and name == "friction_rate")):
                raise ArgumentError(name, "a number above 0" if name == "friction_rate" else "0 or above", value)
            object.__setattr__(self, name, number)
        stops: Any = self.stops
        if stops is not None:
            if not isinstance(stops, tuple | list | np.ndarray) or len(stops) != 2:
                raise ArgumentError("stops", "(lower, upper)", stops)
            ends = finite_number("stops[0]", stops[0]), finite_number("stops[1]", stops[1])
            if not ends[0] < ends[1]:
                raise ArgumentError("stops", "(lower, upper) with lower < upper", stops)
            object.__setattr__(self, "stops", ends)

    @property
    def kinks(self) -> tuple[float, ...]:
        """Where in psi the torque changes from one smooth function to another, its motor's too, increasing."""
        of_motor = self.motor.kinks if is_named(self.motor) else ()
        return tuple(sorted({*(self.stops or ()), *of_motor}))

    @property
    def tightest_stops(self) -> tuple[float, float]:
        """The greatest lower and the least upper stop [rad], its motor's among them; infinite where none is."""
        lower, upper = self.stops or (-np.inf, np.inf)
        if isinstance(self.motor, HingeLoad):
            own = self.motor.tightest_stops
            lower, upper = max(lower, own[0]), min(upper, own[1])
        return lower, upper

    def __call__(self, t: Any, psi: Any, psid: Any) -> Any:
        """Compute the torque [N m] at instants [s], hinge angles [rad] and rates [rad/s]; of floats or arrays."""
        return self.smooth(psi, t, psi, psid)

    def smooth(self, side: Any, t: Any, psi: Any, psid: Any) -> Any:
        """Compute the torque [N m] as it goes on smoothly from the angle `side`, on one side of each kink."""
        return sum(self._terms(side, t, psi, psid).values())

    def parts(self, t: Any, psi: Any, psid: Any) -> dict[str, Any]:
        """Compute what the torque consists of [N m]: motor, and spring, damper, friction, stop where there are any.

        Args:
            t: instants [s]; shape (...,).
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).

        Returns:
            The torques by part, whose sum is the torque; those of a HingeLoad that is the motor are added to these.

        >>> import hingepair as hp
        >>> hp.HingeLoad(stiffness=10, damping=0.5, motor=3).parts(0.0, psi=0.2, psid=1.0)
        {'motor': 3.0, 'spring': -2.0, 'damper': -0.5}
        """
        terms = self._terms(psi, t, psi, psid)
        inner = self.motor.parts(t, psi, psid) if is_named(self.motor) else {"motor": terms["motor"]}
        acting = {"spring": self.stiffness, "damper": self.damping, "friction": self.friction, "stop": self.stops}
        own = {name: terms[name] for name, coefficient in acting.items() if coefficient}
        return {
            name: sum(terms[name] for terms in (own, inner) if name in terms)
            for name in HINGE_PARTS
            if name in own or name in inner
        }

    def _terms(self, side: Any, t: Any, psi: Any, psid: Any) -> dict[str, Any]:
        """Compute the terms of the torque [N m], beyond the stops as they go on smoothly from the angle `side`."""
        terms = {"spring": -self.stiffness * (psi - self.rest), "damper": -self.damping * psid}
        if is_named(self.motor):
            terms["motor"] = self.motor.smooth(side, t, psi, psid)
        else:
            terms["motor"] = self.motor(t, psi, psid) if callable(self.motor) else self.motor
        if self.friction:
            terms["friction"] = -self.friction * np.tanh(psid / self.friction_rate)
        if self.stops is not None:
            held = np.clip(side, *self.stops)
            beyond = -self.stop_stiffness * (psi - held) - self.stop_damping * psid
            terms["stop"] = np.where(side == held, 0.0, beyond)
        return terms


def is_named(torque: object) -> TypeGuard[HingeLoad]:
    """Return whether the kinks and parts of a torque are known: those of a class derived from HingeLoad are not."""
    return type(torque) is HingeLoad


def check_callable(name: str, function: Callable[..., Any], *arguments: str) -> None:
    """Refuse a callable that does not take so many arguments.

    Raises:
        ArgumentError: names it.
    """
    try:
        inspect.signature(function).bind(*arguments)
    except TypeError:
        expected = f"a callable of ({', '.join(arguments)})"
        raise ArgumentError(name, expected, f"one of {inspect.signature(function)}") from None
    except ValueError:  # some of C have no signature
        return
