"""What acts on the pair: constants, and functions of time and motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import finite_number, one_constant
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_load import HingeLoad, HingeTorque, call_with_arrays, check_callable, is_named

Array: TypeAlias = NDArray[np.float64]
Load: TypeAlias = ArrayLike | Callable[[Array, "Moving"], ArrayLike]
Base: TypeAlias = str | Callable[[Array], BodyMotion]
Side: TypeAlias = tuple[Array | float, Array | float]
"""An angle and a rate between kinks of the torque at the hinge: it goes on smoothly from there."""


class Moving(NamedTuple):
    """The pair at some instants, for loads that depend on it.

    Attributes:
        R1: reference point of body 1, world axes [m]; shape (n, 3).
        S1: its rotation, body to world; shape (n, 3, 3).
        v1: velocity of R1, world axes [m/s]; shape (n, 3).
        omega1: angular velocity of body 1, world axes [rad/s]; shape (n, 3).
        psi: hinge angle [rad]; shape (n,).
        psid: hinge rate [rad/s]; shape (n,).
    """

    R1: Array
    S1: Array
    v1: Array
    omega1: Array
    psi: Array
    psid: Array

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"now has no {name!r}; known: {', '.join(self._fields)}")


class Loads:
    """What acts on a pair at any instants.

    Forces are force1, torque1, force2 and torque2: constants, the number 0, or callables of (t, now). In the plane
    (`flat`) forces and gravity have two components, and torques one.

    Raises:
        ArgumentError: a constant is not finite or of the wrong shape, or a callable takes other arguments; names it.
    """

    def __init__(
        self, forces: Mapping[str, Load], hinge_torque: HingeTorque, gravity: ArrayLike, *, flat: bool
    ) -> None:
        self._flat = flat
        self._moving = {name: load for name, load in forces.items() if callable(load)}
        for name, load in self._moving.items():
            check_callable(name, load, "t", "now")
        still = {"gravity": gravity, **{name: load for name, load in forces.items() if not callable(load)}}
        self.known: dict[str, Any] = {name: self._constant(name, load) for name, load in still.items()}
        self._hinge = hinge_torque if callable(hinge_torque) else None
        if callable(hinge_torque):
            check_callable("hinge_torque", hinge_torque, "t", "psi", "psid")
        else:
            self.known["hinge_torque"] = finite_number("hinge_torque", hinge_torque)
        self.look_at_motion = bool(self._moving)
        named = hinge_torque if is_named(hinge_torque) else HingeLoad()
        self.levels, self.rate_levels = named.kinks, named.rate_kinks
        """Values of psi and psi', increasing, where what acts changes from one smooth function to another."""
        self.friction = named.sticking_friction
        self.rigid_stops, self.rigid_range = named.rigid_stops, named.rigid_range
        self.callables = tuple(self._moving) + (("hinge_torque",) if _has_callable(hinge_torque) else ())
        """Names of the loads of which nothing is known between the instants at which they are called."""

    def at(self, t: Array, now: Moving | None, psi: Array, psid: Array, side: Side | None = None) -> dict[str, Array]:
        """Compute the loads that change, by name: forces and torques on the bodies, (n, 3), and hinge_torque, (n,).

        With a side, what a HingeLoad gives is the smooth function of that side of its kinks.
        """
        found = {}
        for name, load in self._moving.items():
            own = self._answer(name, call_with_arrays(name, load, t, now), (len(t), *self._tail(name)))
            found[name] = _lifted(own, len(self._tail(name))) if self._flat else own
        if self._hinge is not None:
            if is_named(self._hinge) and side is not None:
                torque: Any = self._hinge.smooth(side, t, psi, psid)
            else:
                torque = call_with_arrays("hinge_torque", self._hinge, t, psi, psid)
            found["hinge_torque"] = self._answer("hinge_torque", torque, t.shape)
        return found

    def everything(self, t: Array, now: Moving, side: Side | None = None) -> dict[str, Array]:
        """Compute all loads but gravity by name, the parts of a HingeLoad beside it.

        Forces and torques on the bodies have shape (n, 3); hinge_torque, motor_torque, spring_torque, damper_torque,
        friction_torque and stop_torque (n,).
        """
        still = {name: np.array(load) for name, load in self.known.items() if name != "gravity"}
        loads = {name: np.broadcast_to(load, (len(t), *load.shape)) for name, load in still.items()}
        loads |= self.at(t, now, now.psi, now.psid, side)
        if is_named(self._hinge):
            parts = self._hinge.parts(t, now.psi, now.psid, side)
            loads |= {f"{part}_torque": self._answer("hinge_torque", own, t.shape) for part, own in parts.items()}
        return loads

    def _tail(self, name: str) -> tuple[int, ...]:
        if not self._flat:
            return (3,)
        return () if name.startswith("torque") else (2,)

    def _constant(self, name: str, load: Any) -> tuple[float, ...]:
        tail = self._tail(name)
        if isinstance(load, int | float) and load == 0:
            return (0.0, 0.0, 0.0)
        value = one_constant(name, load, *tail) if tail else np.array(finite_number(name, load))
        return tuple((_lifted(value, len(tail)) if self._flat else value).tolist())

    @staticmethod
    def _answer(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
        """What acts, one value for each instant."""
        try:
            return np.broadcast_to(np.asarray(value, dtype=np.float64), shape)
        except (TypeError, ValueError):
            expected = f"a callable that returns shape {shape}, or what broadcasts to it"
            raise ArgumentError(name, expected, value) from None


def _has_callable(torque: object) -> bool:
    """Return whether a torque at the hinge is a callable other than a HingeLoad, or has one as its motor."""
    return _has_callable(torque.motor) if is_named(torque) else callable(torque)


def _lifted(value: Array, rank: int) -> Array:
    """A vector of the plane, or a turn about z, in space."""
    columns = [value[..., 0], value[..., 1], 0 * value[..., 0]] if rank else [0 * value, 0 * value, value]
    return np.stack(columns, axis=-1)
