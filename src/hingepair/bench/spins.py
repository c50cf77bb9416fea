"""The motions of `bench integrate`, whose attitude is known in closed form, and the ways to integrate them."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.integration.integrate import integrate
from hingepair.integration.scipy_route import quaternions
from hingepair.integration.signals import Function
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.matrices import matrix_to_quaternion, rotation_exp

Array = NDArray[np.float64]

STOP: Final = 10.0
COMPARED: Final = 25  # instants, evenly spread; every method has them among its own

_PAIR = HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 0, 0))


class Spin(NamedTuple):
    """The reference example's S(t), turned: S = Q S_ref, omega = Q omega_ref."""

    name: str
    Q: Array

    def omega(self, t: Array) -> Array:
        """The angular velocity, world axes; shape (n, 3)."""
        x = 3 + 5 * np.sin(t)
        y = np.cos(3 * t) - 2.5 * (np.sin(2 * t) + np.sin(4 * t))
        z = np.sin(3 * t) + 2.5 * (np.cos(4 * t) + np.cos(2 * t))
        return np.stack([a * x + b * y + c * z for a, b, c in self.Q.tolist()], axis=-1)

    def exact(self, t: Array) -> list[Any]:
        """The attitudes to 50 digits, matrices."""
        import mpmath

        found = []
        with mpmath.workdps(50):
            for time in t.tolist():
                turns = []
                for axis, rate in enumerate((3, 1, 5)):
                    s, c = mpmath.sin(rate * mpmath.mpf(time)), mpmath.cos(rate * mpmath.mpf(time))
                    turn = mpmath.eye(3)
                    i, j = (axis + 1) % 3, (axis + 2) % 3
                    turn[i, i] = turn[j, j] = c
                    turn[i, j], turn[j, i] = -s, s
                    turns.append(turn)
                found.append(mpmath.matrix(self.Q.tolist()) * turns[0] * turns[1] * turns[2])
        return found

    def error(self, quats: Array, exact: list[Any]) -> float:
        """The largest angle between attitudes and the exact ones [rad].

        Q is a rotation only to rounding, so that S^T exact has a symmetric part of that size, which is left out.
        """
        from hingepair.integration.trajectory import rotations

        worst = 0.0
        for S, truth in zip(rotations(quats), exact, strict=True):
            import mpmath

            with mpmath.workdps(50):
                turn = mpmath.matrix(S.tolist()).T * truth
                parts = [(turn[k, j] - turn[j, k]) / 2 for j, k in ((1, 2), (2, 0), (0, 1))]
                sine = min(mpmath.sqrt(sum(p * p for p in parts)), mpmath.mpf(1))
                cosine = (turn[0, 0] + turn[1, 1] + turn[2, 2] - 1) / 2
                worst = max(worst, float(mpmath.atan2(sine, cosine)))
        return worst


SPINS: Final = (Spin("reference", np.eye(3)), Spin("turned", rotation_exp((0.3, -0.2, 0.25)).astype(float)))


class Way(NamedTuple):
    """A method with its finenesses.

    Attributes:
        name: the method.
        finenesses: numbers of steps, or tolerances of a solver that chooses its steps.
        solver: whether it chooses its steps.
        run: of a spin and a fineness, the attitudes at the compared instants, quaternions (w, x, y, z).
        needs: the package it needs.
    """

    name: str
    finenesses: tuple[float, ...]
    solver: bool
    run: Callable[[Spin, float], Array]
    needs: str


def compared() -> Array:
    """The instants at which all are compared; shape (COMPARED + 1,)."""
    return np.linspace(0, STOP, COMPARED + 1)


def ways() -> tuple[Way, ...]:
    """All methods, ours first."""
    steps = tuple(COMPARED * k for k in (2, 5, 10, 20, 40, 100, 200, 400))
    ours = ("magnus6", "magnus4", "cf4", "midpoint", "rk4_quaternion", "euler_angles")
    tolerances = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-12, 1e-13)
    return (
        *(Way(name, tuple(map(float, steps)), False, _ours(name), "numpy") for name in ours),
        *(Way(f"SciPy {name}", tolerances, True, _scipy(name), "scipy") for name in ("DOP853", "RK45", "LSODA")),
        Way("SciPy DOP853, scalar omega", tolerances, True, _scalar, "scipy"),
    )


def installed(way: Way) -> bool:
    """Whether the package that a method needs is there."""
    return importlib.util.find_spec(way.needs) is not None


def _ours(method: str) -> Callable[[Spin, float], Array]:
    def run(spin: Spin, steps: float) -> Array:
        t = np.linspace(0, STOP, int(steps) + 1)
        motion = integrate(_PAIR, t, spin.omega, 0.0, S1_0=spin.Q, method=method, outputs=(), backend="numba")
        return motion.quat_wxyz[:: int(steps) // COMPARED]

    return run


def _scipy(solver: str) -> Callable[[Spin, float], Array]:
    def run(spin: Spin, tol: float) -> Array:
        omega = Function("omega1", spin.omega, (3,))
        return quaternions(omega, compared(), _start(spin), body=False, tol=tol, solver=solver)

    return run


def _scalar(spin: Spin, tol: float) -> Array:
    """The same solver with the angular velocity written out for a single time, which Python computes faster."""
    from scipy.integrate import solve_ivp

    (a, b, c), (d, e, f), (g, h, i) = spin.Q.tolist()
    sin, cos = math.sin, math.cos

    def rate(t: float, q: Any) -> tuple[float, ...]:
        u = 1.5 + 2.5 * sin(t)
        v = 0.5 * cos(3 * t) - 1.25 * (sin(2 * t) + sin(4 * t))
        w = 0.5 * sin(3 * t) + 1.25 * (cos(4 * t) + cos(2 * t))
        x, y, z = a * u + b * v + c * w, d * u + e * v + f * w, g * u + h * v + i * w
        k, l, m, n = q.tolist()  # noqa: E741
        return -(x * l + y * m + z * n), x * k + y * n - z * m, y * k + z * l - x * n, z * k + x * m - y * l

    done = solve_ivp(
        rate, (0, STOP), _start(spin), method="DOP853", t_eval=compared(), rtol=max(tol, 3e-14), atol=tol
    )
    q = done.y.T
    unit: Array = q / np.sqrt((q**2).sum(axis=1, keepdims=True))
    return unit


def _start(spin: Spin) -> Array:
    quat = matrix_to_quaternion(spin.Q)
    return quat / np.sqrt(quat @ quat)
