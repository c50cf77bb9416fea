"""Torque at the hinge about its axis: motor, spring, damper, friction and stops."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeAlias, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, HingePairError, quoted
from hingepair.numeric.arrays import Float64Array, Frozen, finite_number, set_frozen

HingeTorque: TypeAlias = float | Callable[[Float64Array, Float64Array, Float64Array], ArrayLike]
TORQUE_PARTS: Final = ("motor", "spring", "damper", "friction", "stop")
"""The parts of the torque of a `HingeLoad`. In records of all loads, their names end in _torque."""
_STOP_STIFFNESS: Final = 1e4  # [N m/rad] of stops, unless given
# Parts of the errors of NumPy and Python where an array is used as a number.
_SCALAR_MESSAGES = ("truth value of an array", "arrays can be converted to Python scalars")


@dataclass(frozen=True, slots=True, kw_only=True)
class HingeLoad(Frozen):
    """Torque about the hinge axis that motor, spring, damper, friction and stops exert on body 2, for `hinge_torque`
    of `simulate`: a callable of t, psi and psid, numbers or arrays.

    Without stops, torque = motor - stiffness (psi - rest) - damping psi' - friction sign(psi'). Beyond a stop by the
    angle delta, a stop that is a spring pushes back with stop_stiffness delta (1 + stop_damping delta'), or 0 if that
    is negative (Hunt and Crossley). At psi' = 0, `simulate` keeps the hinge at rest as long as `friction` can.

    Args:
        stiffness: stiffness of the spring [N m/rad].
        rest: hinge angle at which the spring exerts no torque [rad].
        damping: coefficient of the damper [N m s/rad].
        friction: torque of dry friction [N m].
        friction_rate: with a hinge rate above 0 [rad/s], friction is -friction tanh(psi' / friction_rate), smooth,
            but the hinge creeps under a load instead of sticking.
        stops: smallest and largest hinge angle [rad], such as `pair.limits`; shape (2,). An infinite one is no stop.
        stop_stiffness: stiffness of stops that are springs [N m/rad].
        stop_damping: damping of stops that are springs [s/rad]. With 0, the hinge leaves a stop as fast as it
            arrived, else slower.
        stop_restitution: makes the stops rigid in `simulate`: the hinge leaves with this fraction, 0 to 1, of the
            rate at which it arrived. Rigid stops add nothing to the torque that a call returns.
        motor: torque of the motor [N m]: a number; a callable of arrays (t, psi, psid); or another HingeLoad, whose
            torque is added.

    Raises:
        ArgumentError: a value other than rest, stops and motor is negative; friction_rate is 0; stop_restitution is
            above 1, or given beside stop_stiffness or stop_damping; or stops are not in increasing order.

    >>> import hingepair as hp
    >>> spring = hp.HingeLoad(stiffness=10, damping=0.5)
    >>> spring(0.0, psi=0.2, psid=1.0)
    -2.5
    """

    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    friction_rate: float | None = None
    stops: tuple[float, float] | None = None
    stop_stiffness: float = _STOP_STIFFNESS
    stop_damping: float = 0.0
    stop_restitution: float | None = None
    motor: HingeTorque = 0.0

    def __post_init__(self) -> None:
        if callable(self.motor):
            check_callable("motor", self.motor, "t", "psi", "psid")
        numbers = ["stiffness", "rest", "damping", "friction", "stop_stiffness", "stop_damping"]
        numbers += [name for name in ("friction_rate", "stop_restitution") if getattr(self, name) is not None]
        for name in numbers if callable(self.motor) else ["motor", *numbers]:
            value = getattr(self, name)
            number = finite_number(name, value)
            if name not in {"motor", "rest"} and (number < 0 or (number == 0 and name == "friction_rate")):
                raise ArgumentError(name, "a number above 0" if name == "friction_rate" else "0 or above", value)
            set_frozen(self, **{name: number})
        if self.stop_restitution is not None and self.stop_restitution > 1:
            raise ArgumentError("stop_restitution", "a number from 0 to 1", self.stop_restitution)
        if self.stop_restitution is not None and self.stop_damping:
            raise ArgumentError("stop_damping", "0, since stop_restitution describes rigid stops", self.stop_damping)
        if self.stop_restitution is not None and self.stop_stiffness != _STOP_STIFFNESS:
            expected = "no value, since stop_restitution describes rigid stops"
            raise ArgumentError("stop_stiffness", expected, self.stop_stiffness)
        stops: Any = self.stops
        if stops is not None:
            if not isinstance(stops, tuple | list | np.ndarray) or len(stops) != 2:
                raise ArgumentError("stops", "(lower, upper)", stops)
            ends = _stop("stops[0]", stops[0], -np.inf), _stop("stops[1]", stops[1], np.inf)
            if not ends[0] < ends[1]:
                raise ArgumentError("stops", "(lower, upper) with lower < upper", stops)
            set_frozen(self, stops=ends)

    @property
    def sticking_friction(self) -> float:
        """Largest friction torque [N m] that can keep the hinge at rest, of this and nested loads without
        `friction_rate`.
        """
        return sum(load.friction for load in nested_loads(self) if load.friction_rate is None)

    @property
    def rigid_stops(self) -> dict[float, float]:
        """Coefficients of restitution by the angles of the rigid stops [rad], of nested loads too."""
        stiff = [load for load in nested_loads(self) if load.stops and load.stop_restitution is not None]
        ends = [(angle, load) for load in stiff for angle in load.stops or () if np.isfinite(angle)]
        return {angle: float(load.stop_restitution or 0.0) for angle, load in ends}

    def __call__(self, t: Any, psi: Any, psid: Any) -> Any:
        """Return the torque [N m] at instants t [s], hinge angles psi [rad] and rates psid [rad/s]."""
        return self.smooth((psi, psid), t, psi, psid)

    def smooth(self, side: tuple[Any, Any], t: Any, psi: Any, psid: Any) -> Any:
        """Compute the torque [N m] at instants t, angles psi and rates psid. The pair `side` = (angle, rate), not psi
        and psid, decides which stop acts and in which direction dry friction acts. For one value of `side`, the
        torque is a smooth function of psi and psid unless a callable `motor` is not smooth.

        A stop acts if the angle in `side` is beyond the stop and the torque of the stop at this angle and rate pushes
        back. The formula of `HingeLoad` for the torque of the stop is then used for all psi and psid; negative values
        are not replaced by 0, so the stop can also pull. Solvers use this method, since a stop or dry
        friction must not switch on or off within an integration step.

        Args:
            side: pair of a hinge angle [rad] and a hinge rate [rad/s]; each is a number or an array of the shape of
                psi. Without a `friction_rate`, the sign of the rate determines the direction of dry friction; if the
                rate is 0, dry friction does not act. With a `friction_rate`, friction depends on psid instead.
            t: instants [s]; shape (...,).
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).

        Returns:
            The torque on body 2 about the hinge axis [N m]; shape (...,).
        """
        return sum(self.parts(t, psi, psid, side).values())

    def parts(self, t: Any, psi: Any, psid: Any, side: tuple[Any, Any] | None = None) -> dict[str, Any]:
        """Return the terms of the torque [N m] by name: those of motor, spring, damper, friction and stops.

        Args:
            t: instants [s]; shape (...,).
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
            side: pair of a hinge angle [rad] and a hinge rate [rad/s], as for the method `HingeLoad.smooth`; by
                default (psi, psid).

        Returns:
            A dict whose values are torques [N m], numbers or arrays (...,). Their sum is the torque of this load. The
            key "motor" is always present. The key "spring" is present if `stiffness` is not 0, "damper" if `damping`
            is not 0, "friction" if `friction` is not 0, and "stop" if there are stops. If the `motor` of this load is
            another HingeLoad, the terms of that load are added under the same keys.

        >>> import hingepair as hp
        >>> hp.HingeLoad(stiffness=10, damping=0.5, motor=3).parts(0.0, psi=0.2, psid=1.0)
        {'motor': 3.0, 'spring': -2.0, 'damper': -0.5}
        """
        angle, rate = side = (psi, psid) if side is None else side
        motor = self.motor
        if is_plain_hinge_load(motor):
            found = motor.parts(t, psi, psid, side)
        else:
            found = {"motor": call_with_arrays("motor", motor, t, psi, psid) if callable(motor) else motor}
        own = {}
        if self.stiffness:
            own["spring"] = -self.stiffness * (psi - self.rest)
        if self.damping:
            own["damper"] = -self.damping * psid
        if self.friction:
            smooth = self.friction_rate is not None
            own["friction"] = -self.friction * (np.tanh(psid / self.friction_rate) if smooth else np.sign(rate))
        if self.stops is not None:
            stop_angle = np.clip(angle, *self.stops)  # the angle itself between the stops
            beyond = np.sign(angle - stop_angle)
            stop_torque = -self.stop_stiffness * (psi - stop_angle) * (1 + self.stop_damping * beyond * psid)
            is_pushing = (beyond != 0) & (self.stop_restitution is None)
            if self.stop_damping:
                is_pushing &= beyond * rate > -1 / self.stop_damping
            own["stop"] = np.where(is_pushing, stop_torque, 0.0)
        found |= {name: found[name] + torque if name in found else torque for name, torque in own.items()}
        return {name: found[name] for name in TORQUE_PARTS if name in found}


def nested_loads(load: HingeLoad) -> tuple[HingeLoad, ...]:
    """Return a load and all HingeLoads nested in it: its motor, the motor of that, and so on."""
    return (load, *(nested_loads(load.motor) if is_plain_hinge_load(load.motor) else ()))


def stop_angles(load: HingeLoad) -> tuple[float, ...]:
    """Return the angles of all stops [rad], of nested loads too, in increasing order."""
    return tuple(sorted({angle for one in nested_loads(load) for angle in one.stops or () if np.isfinite(angle)}))


def rate_kinks(load: HingeLoad) -> tuple[float, ...]:
    """Return the rates [rad/s], in increasing order, at which the torque has a kink or a jump, of nested loads too: 0
    is that of dry friction, others are where the torque of a stop is cut off.
    """
    kinks = {0.0} if load.sticking_friction else set()
    for one in nested_loads(load):
        if one.stops and one.stop_damping:
            kinks |= {-1 / one.stop_damping, 1 / one.stop_damping}
    return tuple(sorted(kinks))


def stop_range(load: HingeLoad, *, rigid: bool = False) -> tuple[float, float]:
    """Return the range of psi between all stops [rad] or the rigid ones, of nested loads too; (-inf, inf) without."""
    stops = [one.stops for one in nested_loads(load) if one.stops and not (rigid and one.stop_restitution is None)]
    return max((lower for lower, _ in stops), default=-np.inf), min((upper for _, upper in stops), default=np.inf)


def _stop(name: str, value: Any, none: float) -> float:
    """Return the angle of a stop, or the infinite number `none` that is no stop."""
    return none if isinstance(value, float | np.floating) and value == none else finite_number(name, value)


def is_plain_hinge_load(torque: object) -> TypeGuard[HingeLoad]:
    """Return whether a hinge torque is a HingeLoad, whose kinks and parts are known.

    Raises:
        ArgumentError: a derived class computes another torque, whose stops and friction would not be followed.
    """
    if not isinstance(torque, HingeLoad):
        return False
    kind = type(torque)
    if any(getattr(kind, name) is not getattr(HingeLoad, name) for name in ("__call__", "smooth", "parts")):
        expected = "a HingeLoad as it is: its motor= takes a callable of (t, psi, psid)"
        raise ArgumentError("hinge_torque", expected, f"a {kind.__name__}, which computes another torque")
    return True


def check_callable(name: str, function: Callable[..., Any], *arguments: str) -> None:
    """Refuse what cannot be called with positional arguments of these names."""
    expected = f"a callable of ({', '.join(arguments)})"
    if not callable(function):
        raise ArgumentError(name, expected, quoted(function))
    try:
        inspect.signature(function).bind(*arguments)
    except TypeError:
        raise ArgumentError(name, expected, f"one of {inspect.signature(function)}") from None
    except ValueError:  # some functions written in C have no signature
        return


def call_with_arrays(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Return what a user's function of arrays returns; explain the errors of one that takes single numbers.

    Raises:
        ArgumentError: it compares or converts an array as if it were one number, or takes instants for columns; other
            errors are passed on.
    """
    try:
        return function(*arguments)
    except HingePairError:
        raise
    except IndexError as error:
        if f"axis 0 with size {len(arguments[0])}" not in str(error):
            raise
        expected = "a callable of arrays with a row for each instant: now.q[:, 1] is the second column"
        raise ArgumentError(name, expected, f"one that takes rows for columns ({error})") from error
    except (TypeError, ValueError) as error:
        if not any(sign in str(error) for sign in _SCALAR_MESSAGES):
            raise
        expected = "a callable of arrays, one element for each instant: np.where instead of if, np.sin of math.sin"
        raise ArgumentError(name, expected, f"one that takes single numbers ({error})") from error
