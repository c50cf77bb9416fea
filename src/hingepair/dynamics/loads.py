"""Loads on a pair: constants, and functions of time and motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import finite_number, is_zero, one_constant
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_load import HingeLoad, HingeTorque, call_with_arrays, check_callable, is_plain_hinge_load

LoadArgument: TypeAlias = ArrayLike | Callable[[Array, "MotionAtInstants"], ArrayLike]
"""A force or torque on a body as users give it: a constant, or a callable of (t, now)."""
BaseArgument: TypeAlias = str | Callable[[Array], BodyMotion]
"""What holds body 1, as users give it: the name of a base, or a callable of t that returns the motion of body 1."""
KinkSide: TypeAlias = tuple[Array | float, Array | float]
"""An angle [rad] and a rate [rad/s] that select one smooth branch of the torque at the hinge, between its kinks."""


class MotionAtInstants(NamedTuple):
    """Pose R1, S1 and velocities v1, omega1 of body 1, and hinge angle psi and rate psid, arrays at n instants. Loads
    and events that are callables get an object of this class as their argument `now`.

    Attributes:
        R1: reference point of body 1, world axes [m]; shape (n, 3).
        S1: rotation of body 1, body to world; shape (n, 3, 3).
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
    """Checked loads on a pair, constants and callables.

    Args:
        forces: force1, torque1, force2 and torque2: constants, the number 0, or callables of (t, now).
        hinge_torque: torque at the hinge [N m]: a number, a HingeLoad, or a callable of (t, psi, psid).
        gravity: acceleration of free fall [m/s^2].
        is_planar: whether the pair is planar: forces and gravity have two components then, and torques one.

    Raises:
        ArgumentError: a constant is not finite or of the wrong shape, or a callable takes other arguments.
    """

    def __init__(
        self, forces: Mapping[str, LoadArgument], hinge_torque: HingeTorque, gravity: ArrayLike, *, is_planar: bool
    ) -> None:
        self._is_planar = is_planar
        self._callables = {name: load for name, load in forces.items() if callable(load)}
        for name, load in self._callables.items():
            check_callable(name, load, "t", "now")
        constant_loads = {"gravity": gravity, **{name: load for name, load in forces.items() if not callable(load)}}
        self.constants: dict[str, Any] = {
            name: self._checked_constant(name, load) for name, load in constant_loads.items()
        }
        self._hinge = hinge_torque if callable(hinge_torque) else None
        if callable(hinge_torque):
            check_callable("hinge_torque", hinge_torque, "t", "psi", "psid")
        else:
            self.constants["hinge_torque"] = finite_number("hinge_torque", hinge_torque)
        self.need_motion = bool(self._callables)
        hinge_load = hinge_torque if is_plain_hinge_load(hinge_torque) else HingeLoad()
        self.kinks, self.rate_kinks = hinge_load.kinks, hinge_load.rate_kinks
        """Values of psi [rad] and psi' [rad/s], increasing, at which the torque changes its smooth branch."""
        self.friction = hinge_load.sticking_friction
        self.rigid_stops, self.rigid_range = hinge_load.rigid_stops, hinge_load.rigid_range
        lower, upper = self.rigid_range
        if not upper - lower > 1e-9:  # rad; impacts closer together could not be told apart
            expected = "rigid stops at least 1e-9 rad apart (hinge= holds an angle)"
            raise ArgumentError("hinge_torque", expected, f"{lower!r} to {upper!r} rad")
        self.callable_names = tuple(self._callables) + (("hinge_torque",) if _has_callable(hinge_torque) else ())
        """Names of the loads that are callables, known only at the instants at which they are called."""

    def callables_at(
        self, t: Array, now: MotionAtInstants | None, psi: Array, psid: Array, side: KinkSide | None = None
    ) -> dict[str, Array]:
        """Return the loads that are callables at instants t, (n,): (n, 3), and hinge_torque, (n,). `side` selects the
        smooth branch of a HingeLoad; `now` may be None if no load needs it.

        Raises:
            ArgumentError: a result does not fit.
        """
        loads = {}
        for name, load in self._callables.items():
            value = self._broadcast_load(
                name, call_with_arrays(name, load, t, now), (len(t), *self._load_shape(name))
            )
            loads[name] = _to_space(value, len(self._load_shape(name))) if self._is_planar else value
        if self._hinge is not None:
            if is_plain_hinge_load(self._hinge) and side is not None:
                torque: Any = self._hinge.smooth(side, t, psi, psid)
            else:
                torque = call_with_arrays("hinge_torque", self._hinge, t, psi, psid)
            loads["hinge_torque"] = self._broadcast_load("hinge_torque", torque, t.shape)
        return loads

    def all_at(self, t: Array, now: MotionAtInstants, side: KinkSide | None = None) -> dict[str, Array]:
        """Return all loads but gravity, and the parts of a HingeLoad, such as motor_torque, at instants t; as
        `callables_at`.
        """
        constants = {name: np.array(load) for name, load in self.constants.items() if name != "gravity"}
        loads = {name: np.broadcast_to(load, (len(t), *load.shape)) for name, load in constants.items()}
        loads |= self.callables_at(t, now, now.psi, now.psid, side)
        if is_plain_hinge_load(self._hinge):
            parts = self._hinge.parts(t, now.psi, now.psid, side)
            for part, torque in parts.items():
                loads[f"{part}_torque"] = self._broadcast_load("hinge_torque", torque, t.shape)
        return loads

    def _load_shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of one value of a load as users give it."""
        if not self._is_planar:
            return (3,)
        return () if name.startswith("torque") else (2,)

    def _checked_constant(self, name: str, load: Any) -> tuple[float, ...]:
        """Return a constant force, torque or gravity as three components in space."""
        tail = self._load_shape(name)
        if is_zero(load):
            return (0.0, 0.0, 0.0)
        value = one_constant(name, load, *tail) if tail else np.array(finite_number(name, load))
        return tuple((_to_space(value, len(tail)) if self._is_planar else value).tolist())

    @staticmethod
    def _broadcast_load(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
        """Return the result of a callable load, one value for each instant."""
        try:
            if value is None:  # NumPy reads it as NaN
                raise TypeError
            return np.broadcast_to(np.asarray(value, dtype=np.float64), shape)
        except (TypeError, ValueError):
            expected = f"a callable that returns shape {shape}, or what broadcasts to it"
            raise ArgumentError(name, expected, value) from None


def _has_callable(torque: object) -> bool:
    """Return whether a torque is a callable other than a HingeLoad, or has one as its motor."""
    return _has_callable(torque.motor) if is_plain_hinge_load(torque) else callable(torque)


def _to_space(value: Array, rank: int) -> Array:
    """Return values for planar pairs as vectors in space: vectors in the plane (rank 1), or torques (rank 0)."""
    columns = [value[..., 0], value[..., 1], 0 * value[..., 0]] if rank else [0 * value, 0 * value, value]
    return np.stack(columns, axis=-1)
