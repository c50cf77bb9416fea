"""The motion of a pair from its rates (E12): attitude of body 1 and hinge angle, with estimates of their errors."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from hingepair.engine.backend import Execution
from hingepair.errors import ArgumentError
from hingepair.motion.error_estimate import StepErrors, estimate_error
from hingepair.motion.integrals import AngleIntegral, AttitudeIntegral, Integral
from hingepair.motion.signals import Signal
from hingepair.motion.step_selection import select_steps
from hingepair.motion.stepping import Steps
from hingepair.motion.trajectory import Deferred
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import finite_number
from hingepair.rotations.matrices import matrix_to_quaternion


class SolveOptions(NamedTuple):
    """Options of a solver."""

    t: Array  # instants [s]
    tol: float | None  # largest error [rad]; None: one step for each interval
    execution: Execution
    omega_in_body_axes: bool
    rate_names: tuple[str, str] = ("omega1", "psid")  # in errors

    def check(self) -> None:
        """Raise an ArgumentError if the tolerance cannot be used."""
        if self.tol is not None and not finite_number("tol", self.tol) > 0:
            raise ArgumentError("tol", "a positive number", self.tol)

    def integrals(self, omega: Signal, psid: Signal, *, planar: bool) -> tuple[Integral, AngleIntegral]:
        """Return the integrals of both rates."""
        names = self.rate_names
        hinge = AngleIntegral(names[1], psid, self.execution)
        if planar:
            return AngleIntegral(names[0], omega, self.execution), hinge
        return AttitudeIntegral(names[0], omega, self.execution, self.omega_in_body_axes), hinge


class Solution(Deferred):
    """The motion of a pair at the instants, and estimates of its errors, made when they are first asked for.

    Args:
        steps: steps of integration.
        integrals: those of the orientation of body 1 and of psi.
        values: their values at the ends of the steps.
        errors: measured errors of the steps, as far as there are.
    """

    def __init__(
        self,
        steps: Steps,
        integrals: tuple[Integral, AngleIntegral],
        values: tuple[Array, Array],
        errors: Mapping[Integral, StepErrors],
    ) -> None:
        self._steps, self._integrals, self._values, self._errors = steps, integrals, values, errors
        #: of body 1: unit quaternions (N, 4) without a jump of sign; in the plane angles (N,) [rad]
        self.orientations = steps.at_instants(values[0])
        #: hinge angles [rad]; shape (N,)
        self.psi = steps.at_instants(values[1])
        #: number of steps
        self.steps = steps.step_count

    @functools.cached_property
    def error(self) -> float:
        """Estimate of the largest error of the orientations [rad]."""
        return self._estimate(0)

    @functools.cached_property
    def psi_error(self) -> float:
        """Estimate of the largest error of psi [rad]."""
        return self._estimate(1)

    @property
    def largest_error(self) -> float:
        """The larger of both error estimates [rad]; NaN if one of them is."""
        return float(np.maximum(self.error, self.psi_error))

    def _estimate(self, k: int) -> float:
        integral = self._integrals[k]
        estimate = estimate_error(integral, self._steps, self._values[k], self._errors.get(integral))
        return min(estimate, integral.max_error)

    def check_tolerance(self, options: SolveOptions) -> None:
        """Raise an ArgumentError if there is a tolerance and an error estimate is above it or NaN."""
        if options.tol is not None and not self.largest_error <= options.tol:
            each = ", ".join(
                f"{name} leaves {error:.2g}"
                for name, error in zip(options.rate_names, (self.error, self.psi_error), strict=True)
            )
            raise ArgumentError(
                "tol", f"at least the error that is left, {self.largest_error:.2g} rad ({each})", options.tol
            )


def start_values(start: Any) -> Any:
    """Return attitudes (..., 3, 3) as unit quaternions (..., 4); angles as they are."""
    return matrix_to_quaternion(np.asarray(start)) if np.ndim(start) >= 2 else start


def solve_together(options: SolveOptions, omega: Signal, psid: Signal, start: Array, psi_0: Array) -> Any:
    """Return the orientations (M, N, 4), in the plane (M, N), and the hinge angles (M, N) of M motions over common
    steps, one for each interval. `start` are attitudes (M, 3, 3), in the plane angles (M,). Overflow is not refused.
    """
    steps = Steps(options.t)
    body1, hinge = options.integrals(omega, psid, planar=start.ndim == 1)
    return body1.integrate(steps, start_values(start)), hinge.integrate(steps, psi_0)


def solve(
    options: SolveOptions,
    omega: Signal,
    psid: Signal,
    start: Array | float,
    psi_0: float,
    integrated: tuple[Array, Array] | None = None,
) -> Solution:
    """Integrate the attitude and the hinge angle of one motion (E12).

    Args:
        options: instants, method and tolerance.
        omega: angular velocity of body 1, in the plane a scalar.
        psid: hinge rate.
        start: attitude of body 1 at the first instant (3, 3), in the plane an angle [rad].
        psi_0: hinge angle at the first instant [rad].
        integrated: orientations and hinge angles that `solve_together` has computed already.

    Raises:
        ArgumentError: a result overflows.
    """
    planar = np.ndim(start) == 0
    integrals = options.integrals(omega, psid, planar=planar)
    steps, errors = select_steps(integrals, options.t, options.tol)
    if integrated is None:
        integrated = integrals[0].integrate(steps, start_values(start)), integrals[1].integrate(steps, psi_0)
    else:
        for integral, values in zip(integrals, integrated, strict=True):
            integral.check_finite(values.reshape(len(values), -1), steps)

    return Solution(steps, integrals, integrated, errors)
