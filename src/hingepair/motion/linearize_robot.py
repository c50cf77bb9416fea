"""Linearization of the motion of a robot about states, from the exact derivatives of its accelerations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.methods import Wrenches
from hingepair.motion.loads import has_callable
from hingepair.motion.robot_loads import loads_by_joint
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import finite_number, read_only, vectors
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_load import HingeLoad, HingeTorque, stop_range
from hingepair.pair.requests import DEFAULT_GRAVITY


@dataclass(frozen=True, eq=False)
class SmallMotion:
    """Linearized motion, x' = rates + A x + B u for small changes x of the state and u of the loads."""

    #: derivatives of the state's rates by the state; shape (..., k, k)
    A: Array

    _drift: ClassVar[float] = 1e-7
    """Of the largest pole: double poles at 0 come out as the root of rounding errors, and count as 0 below this."""

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A that are not 0 [1/s], sorted by magnitude, of each conjugate pair the one with a positive
        imaginary part; of one state.

        Raises:
            ArgumentError: there are several states.
        """
        if self.A.ndim > 2:
            raise ArgumentError("poles", "the linearization about one state", f"{self.A.shape[:-2]} of them")
        found = np.linalg.eigvals(self.A).astype(np.complex128)
        found = found[(np.abs(found) > self._drift * np.abs(found).max(initial=0.0)) & (found.imag >= 0)]
        # Poles of equal magnitude are sorted by their real parts, whatever rounding says.
        sizes = [float(f"{abs(pole):.9g}") for pole in found]
        return np.asarray(found[np.lexsort((found.real, sizes))])

    @property
    def natural_frequencies(self) -> Array:
        """Absolute values of the poles [rad/s]."""
        return np.abs(self.poles)

    @property
    def damping_ratios(self) -> Array:
        """Damping ratio of each pole; 0 without damping, 1 for real poles, below 0 if the motion grows."""
        poles = self.poles
        return np.asarray(-poles.real / np.abs(poles), np.float64)


@dataclass(frozen=True, eq=False)
class RobotLinearization(SmallMotion):
    """Linearized motion of a robot, x' = rates + A x + B u for small changes x of the state and u of the loads."""

    #: derivatives of the state's rates by tau; with a free base by force1, torque1 and tau; shape (..., k, k/2)
    B: Array
    #: rates of the state; 0 at an equilibrium; shape (..., k)
    rates: Array
    #: names of the k components of the state: q and qd; with a free base its displacement R1 and rotations phi [rad]
    #: before q, v1 and omega1 before qd, all along world axes
    names: tuple[str, ...]


def linearize_robot(
    robot: Mechanism,
    q: ArrayLike,
    qd: ArrayLike | None = None,
    tau: ArrayLike | None = None,
    *,
    loads: Mapping[str, HingeTorque] | None = None,
    t: float = 0.0,
    gravity: ArrayLike = DEFAULT_GRAVITY,
    wrenches: Wrenches = None,
    joint_loads: bool | None = None,
    force1: ArrayLike = 0,
    torque1: ArrayLike = 0,
    base_motion: BodyMotion | None = None,
    workers: int = 1,
    backend: str = "auto",
) -> RobotLinearization:
    """Linearize the motion of a robot; `hp.linearize` says what the arguments are."""
    free, zeros = robot.base == "free", np.zeros(robot.dof)
    common: dict[str, Any] = {"gravity": gravity, "wrenches": wrenches, "base_motion": base_motion}
    run: dict[str, Any] = {"workers": workers, "backend": backend}
    q, qd = vectors("q", q, robot.dof), zeros if qd is None else vectors("qd", qd, robot.dof)
    if loads is not None and joint_loads is not None:
        raise ArgumentError("joint_loads", "None beside loads", quoted(joint_loads))
    common["joint_loads"] = joint_loads if loads is None else False
    efforts, efforts_q, efforts_qd = _joint_efforts(robot, loads, q, qd, finite_number("t", t))
    if tau is None:
        total = robot.inverse_dynamics(q, qd, zeros, outputs=("tau",), **common, **run).tau
    else:
        total = vectors("tau", tau, robot.dof) + efforts
    on_base: dict[str, Any] = {"force1": force1, "torque1": torque1}
    a = robot.forward_dynamics(q, qd, total, **common, **on_base, **run)
    d = robot.forward_dynamics_derivatives(q, qd, total, **common, **on_base, **run)
    n, lead = d.qdd_q.shape[-1], a.qdd.shape[:-1]
    A = np.zeros((*lead, 2 * n, 2 * n))
    A[..., :n, n:], A[..., n:, :n], A[..., n:, n:] = np.eye(n), d.qdd_q, d.qdd_qd
    of_joints = d.qdd_tau[..., n - robot.dof :]
    A[..., n:, n - robot.dof : n] += of_joints * efforts_q[..., None, :]
    A[..., n:, 2 * n - robot.dof :] += of_joints * efforts_qd[..., None, :]
    B = np.concatenate((np.zeros_like(d.qdd_tau), d.qdd_tau), axis=-2)
    parts: list[Any] = [qd, a.qdd]
    if free:
        given = (None, None) if base_motion is None else (base_motion.v, base_motion.omega)
        v1, omega1 = (np.zeros(3) if one is None else np.asarray(one) for one in given)
        x, y, z = np.moveaxis(omega1, -1, 0)
        for (i, j), part in {(0, 1): -z, (0, 2): y, (1, 0): z, (1, 2): -x, (2, 0): -y, (2, 1): x}.items():
            A[..., 3 + i, 3 + j] = part  # phi' = omega1 x phi + change of omega1
        parts = [v1, omega1, qd, a.a1, a.alpha1, a.qdd]
    rates = np.concatenate([np.broadcast_to(part, (*lead, np.shape(part)[-1])) for part in parts], axis=-1)
    base = [f"{letter}_{axis}" for letter in ("R1", "phi") for axis in "xyz"] if free else []
    base_rates = [f"{letter}_{axis}" for letter in ("v1", "omega1") for axis in "xyz"] if free else []
    names = (*base, *robot.names, *base_rates, *(f"{name}_dot" for name in robot.names))
    return RobotLinearization(read_only(A), read_only(B), read_only(rates), names)


def _joint_efforts(
    robot: Mechanism, loads: Mapping[str, HingeTorque] | None, q: Array, qd: Array, t: float
) -> tuple[Array, Array, Array]:
    """Return the efforts of HingeLoads in states (..., dof), and their derivatives by q and by qd."""
    q, qd = np.broadcast_arrays(np.asarray(q, np.float64), np.asarray(qd, np.float64))
    efforts, by_q, by_qd = (np.zeros(q.shape) for _ in range(3))
    for k, (name, load) in enumerate(zip(robot.names, loads_by_joint(robot, loads), strict=True)):
        if load == HingeLoad():
            continue
        x, rate = q[..., k].ravel(), qd[..., k].ravel()
        lower, upper = stop_range(load, rigid=True)
        if (load.sticking_friction and not rate.all()) or ((x <= lower) | (x >= upper)).any():
            expected = "a load with a linearization: friction that sticks (without friction_rate) or a stop holds it"
            raise ArgumentError(f"loads[{name!r}]", expected, quoted(load))
        times = np.full(x.shape, t)
        efforts[..., k] = np.reshape(load.smooth((x, rate), times, x, rate) + 0 * x, q.shape[:-1])
        by_q[..., k] = _slope(load, times, x, rate, (1, 0)).reshape(q.shape[:-1])
        by_qd[..., k] = _slope(load, times, x, rate, (0, 1)).reshape(q.shape[:-1])
    return efforts, by_q, by_qd


def _slope(load: HingeLoad, t: Array, q: Array, qd: Array, direction: tuple[int, int]) -> Array:
    """Return the derivative of a load along a direction of (q, qd), (n,)."""

    def at(step: complex) -> Any:
        return load.smooth((q, qd), t, q + step * direction[0], qd + step * direction[1]) + 0 * q

    if has_callable(load):  # which need not take complex numbers
        h = 1e-5
        return np.asarray((8 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12 * h), np.float64)
    return np.asarray(np.imag(at(1e-30j)) / 1e-30, np.float64)
