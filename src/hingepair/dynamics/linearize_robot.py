"""Linearization of the motion of a robot about states, from the exact derivatives of its accelerations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.methods import Wrenches
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import read_only, vectors
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.dynamics import DEFAULT_GRAVITY

_DRIFT = 1e-7  # of the largest pole: double poles at 0 come out as the root of rounding errors


@dataclass(frozen=True, eq=False)
class RobotLinearization:
    """Linearized motion of a robot, x' = rates + A x + B u for small changes x of the state and u of the loads."""

    #: derivatives of the state's rates by the state; shape (..., k, k)
    A: Array
    #: derivatives of the state's rates by tau; with a free base by force1, torque1 and tau; shape (..., k, k/2)
    B: Array
    #: rates of the state; 0 at an equilibrium; shape (..., k)
    rates: Array
    #: names of the k components of the state: q and qd; with a free base its displacement R1 and rotations phi [rad]
    #: before q, v1 and omega1 before qd, all along world axes
    names: tuple[str, ...]

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A that are not 0 [1/s], sorted by magnitude, of each conjugate pair the one with a positive
        imaginary part; of one state.

        Raises:
            ArgumentError: there are several states.
        """
        if self.A.ndim > 2:
            raise ArgumentError("poles", "the linearization about one state", f"{self.A.shape[:-2]} of them")
        found: NDArray[np.complex128] = np.linalg.eigvals(self.A).astype(np.complex128)
        found = found[(np.abs(found) > _DRIFT * np.abs(found).max(initial=0.0)) & (found.imag >= 0)]
        return np.asarray(found[np.argsort(np.abs(found))])

    @property
    def natural_frequencies(self) -> Array:
        """Absolute values of the poles [rad/s]."""
        return np.abs(self.poles)

    @property
    def damping_ratios(self) -> Array:
        """Damping ratio of each pole; 0 without damping, 1 for real poles, below 0 if the motion grows."""
        poles = self.poles
        return np.asarray(-poles.real / np.abs(poles), np.float64)


def linearize_robot(
    robot: Mechanism,
    q: ArrayLike,
    qd: ArrayLike | None = None,
    tau: ArrayLike | None = None,
    *,
    gravity: ArrayLike = DEFAULT_GRAVITY,
    wrenches: Wrenches = None,
    joint_loads: bool | None = None,
    force1: ArrayLike = 0,
    torque1: ArrayLike = 0,
    base_motion: BodyMotion | None = None,
    workers: int = 1,
    backend: str = "auto",
) -> RobotLinearization:
    """Linearize the motion of a robot about one state or many, exactly up to rounding (T11); `hp.linearize` does so
    for robots.

    Args:
        robot: the robot.
        q: coordinates, shape (..., dof) [rad for hinges, m for sliders].
        qd: first time derivatives of q; 0 by default.
        tau: torques of hinges [N m] and forces of sliders [N]; by default those of `inverse_dynamics` at qdd = 0.
        gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).
        wrenches: loads on links, which keep their values in world axes, as for `inverse_dynamics`.
        joint_loads: whether springs, dampers and dry friction of the joints act, as for `inverse_dynamics`.
        force1: force on a free base, as for `forward_dynamics`.
        torque1: torque on a free base.
        base_motion: motion of the base, as for `forward_dynamics`.
        workers: number of threads.
        backend: as for `forward_kinematics`.

    Raises:
        ArgumentError: an argument cannot be used, or the robot has too many joints.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> rod = hp.Body(mass=2, inertia=(0.01, 1, 1), centre_of_mass=(1, 0, 0))
    >>> arm = hp.Mechanism([hp.HingePair(u1=(0, 0, 0), u2=(0, 0, 0), n=(0, 1, 0), body2=rod)])
    >>> hp.linearize(arm, [np.pi / 2]).natural_frequencies.round(4)
    array([2.5573])
    """
    free, zeros = robot.base == "free", np.zeros(robot.dof)
    common: dict[str, Any] = {"gravity": gravity, "wrenches": wrenches, "base_motion": base_motion}
    common["joint_loads"] = joint_loads
    run: dict[str, Any] = {"workers": workers, "backend": backend}
    q, qd = vectors("q", q, robot.dof), zeros if qd is None else vectors("qd", qd, robot.dof)
    if tau is None:
        tau = robot.inverse_dynamics(q, qd, zeros, outputs=("tau",), **common, **run).tau
    loads: dict[str, Any] = {"force1": force1, "torque1": torque1}
    a = robot.forward_dynamics(q, qd, tau, **common, **loads, **run)
    d = robot.forward_dynamics_derivatives(q, qd, tau, **common, **loads, **run)
    n, lead = d.qdd_q.shape[-1], a.qdd.shape[:-1]
    A = np.zeros((*lead, 2 * n, 2 * n))
    A[..., :n, n:], A[..., n:, :n], A[..., n:, n:] = np.eye(n), d.qdd_q, d.qdd_qd
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
