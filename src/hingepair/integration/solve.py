"""Solution of E12: attitudes and angles from rates by any method, with steps by a tolerance and error estimates."""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.engine.backend import Execution
from hingepair.errors import ArgumentError, GimbalLockError, MissingDependencyError
from hingepair.integration.error_estimate import estimate_error
from hingepair.integration.euler_angles import euler_to_quaternions, integrate_euler_angles
from hingepair.integration.integrals import AngleIntegral, AttitudeIntegral, Integral
from hingepair.integration.methods import STEP_RULE_BY_NAME, quaternion_product
from hingepair.integration.signals import SampledSignal, Signal
from hingepair.integration.stamp_rounding import stamp_deviations, stamp_error
from hingepair.integration.step_selection import MAX_SELECTED_STEP_COUNT, SelectedSteps, select_steps
from hingepair.integration.stepping import Steps
from hingepair.integration.trajectory import LazyValue
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import check_choice, finite_number
from hingepair.rotations.euler import matrix_to_euler
from hingepair.rotations.matrices import matrix_to_quaternion

METHOD_NAMES: Final = (*STEP_RULE_BY_NAME, "euler_angles", "dop853")
"""Names of the methods of integration."""

MAX_OMEGA1_EVALUATIONS_BY_SCIPY: Final = 1_000_000
"""Largest number of evaluations of omega1 by SciPy's solver, one at a time: some twenty seconds."""

_STEP_RULE_OF_REFERENCE_SOLUTION = STEP_RULE_BY_NAME["magnus6"]  # that other methods are compared with
_TOLERANCE_OF_REFERENCE_SOLUTION_IN_RAD = 1e-14  # rad: of the solution that other methods are compared with
_DEFAULT_TOLERANCE_OF_DOP853_IN_RAD = 1e-12  # rad: of `dop853` without tol
_MIN_SCIPY_RTOL = 3e-14  # the smallest relative tolerance that SciPy takes


class SolveOptions(NamedTuple):
    """Options of a solver: the instants, the name of the method, the tolerance [rad] or None, the Execution
    (backend), whether omega is in body axes, and the names of both rates for errors.
    """

    t: Array  # instants [s]
    method: str  # one of METHOD_NAMES; in the plane, of STEP_RULE_BY_NAME
    tol: float | None  # largest error [rad]; None: one step for each interval
    execution: Execution
    omega_in_body_axes: bool
    rate_names: tuple[str, str] = ("omega1", "psid")  # names of the rates in errors


class Solution(NamedTuple):
    """Result of a solver for one motion: orientations of body 1 (unit quaternions, in the plane angles), hinge angles
    psi, the number of steps (0 if SciPy chose them), and lazy estimates of the errors of the orientations and of psi
    [rad].
    """

    orientations: Array  # of body 1: unit quaternions (N, 4) without a jump of sign; in the plane angles (N,) [rad]
    psi: Array  # hinge angles [rad]; shape (N,)
    steps: int  # number of steps; 0 where SciPy chose them
    error: LazyValue  # of the orientations [rad]
    psi_error: LazyValue  # of psi [rad]

    @property
    def largest_error(self) -> float:
        """The larger of both error estimates [rad], a float; NaN if one of them is NaN. They are computed at the
        first access.
        """
        return float(np.maximum(self.error(), self.psi_error()))

    def check_tolerance(self, options: SolveOptions) -> None:
        """Raise an ArgumentError if the SolveOptions have a tolerance and an error estimate is above it or NaN.

        Raises:
            ArgumentError: the tolerance was not reached; names the error of each rate.
        """
        if options.tol is not None and not self.largest_error <= options.tol:
            errors = (self.error(), self.psi_error())
            each = ", ".join(
                f"{name} leaves {error:.2g}" for name, error in zip(options.rate_names, errors, strict=True)
            )
            raise ArgumentError(
                "tol", f"at least the error that is left, {self.largest_error:.2g} rad ({each})", options.tol
            )


class _IntegratedValues(NamedTuple):
    """Quaternions or angles at the instants, with the number of steps and a lazy estimate of the error [rad]."""

    values: Array  # quaternions (N, 4) or angles (N,)
    steps: int  # number of steps
    error: LazyValue  # rad


def integrate_together(
    options: SolveOptions, omega: Signal, psid: Signal, start: Array, psi_0: Array
) -> tuple[Array, Array] | None:
    """Integrate M motions over common steps, from `start` (attitudes, in the plane angles) and hinge angles psi_0;
    omega and psid are Signals. Return a pair of arrays, the orientations (quaternions (M, N, 4), in the plane angles
    (M, N)) and the hinge angles (M, N). Return None if the options give each motion steps of its own.

    That is so with a tolerance, by Euler angles and by SciPy's solver. Overflow is not refused.

    Args:
        options: as for `solve`.
        omega: signal of M motions, or one that all share.
        psid: signal of M motions, or one that all share.
        start: attitudes (M, 3, 3), in the plane angles (M,) [rad].
        psi_0: hinge angles at the first instant [rad]; shape (M,).
    """
    if options.tol is not None or options.method not in STEP_RULE_BY_NAME:
        return None
    rule, steps = STEP_RULE_BY_NAME[options.method], Steps(options.t)
    hinge = AngleIntegral(options.rate_names[1], psid, rule, options.execution).integrate(steps, psi_0)
    if start.ndim == 1:
        return AngleIntegral(options.rate_names[0], omega, rule, options.execution).integrate(steps, start), hinge
    attitude = AttitudeIntegral(options.rate_names[0], omega, rule, options.execution, options.omega_in_body_axes)
    quat_by_matrix = {S.tobytes(): matrix_to_quaternion(S) for S in {S.tobytes(): S for S in start}.values()}
    quats = np.array([quat_by_matrix[S.tobytes()] for S in start])
    return attitude.integrate(steps, quats), hinge


def solve(
    options: SolveOptions,
    omega: Signal,
    psid: Signal,
    start: Array | float,
    psi_0: float,
    integrated: tuple[Array, Array] | None = None,
) -> Solution:
    """Integrate the attitude and the hinge angle of one motion from the Signals `omega` and `psid` (E12), starting at
    the attitude `start` (in the plane an angle) and the hinge angle psi_0; return a `Solution`. `integrated`, unless
    None, is the pair of orientations and hinge angles that `integrate_together` returned, which are then not computed
    again. Raise an ArgumentError if the tolerance is not positive, a result overflows or SciPy's solver fails, a
    GimbalLockError near gimbal lock, or a MissingDependencyError without SciPy.

    Raises:
        ArgumentError: the tolerance is no positive number, a result overflows, or SciPy's solver gives up.
        GimbalLockError: `euler_angles` came too near to gimbal lock, or its steps are too long.
        MissingDependencyError: `dop853` without SciPy.
    """
    if options.tol is not None and not finite_number("tol", options.tol) > 0:
        raise ArgumentError("tol", "a positive number", options.tol)
    is_planar = np.ndim(start) == 0
    check_choice("method", options.method, tuple(STEP_RULE_BY_NAME) if is_planar else METHOD_NAMES)
    rule = {
        "euler_angles": STEP_RULE_BY_NAME["rk4_quaternion"],
        "dop853": _STEP_RULE_OF_REFERENCE_SOLUTION,
        **STEP_RULE_BY_NAME,
    }[options.method]
    attitude = AttitudeIntegral(options.rate_names[0], omega, rule, options.execution, options.omega_in_body_axes)
    hinge = AngleIntegral(options.rate_names[1], psid, rule, options.execution)
    if options.method in STEP_RULE_BY_NAME:
        body1_angle = AngleIntegral(options.rate_names[0], omega, rule, options.execution) if is_planar else attitude
        selected = select_steps((body1_angle, hinge), options.t, options.tol)
        if integrated is None:
            begin = start if is_planar else matrix_to_quaternion(np.asarray(start))
            orientation = _integrate(body1_angle, begin, selected)
        else:
            orientation = _integrate(body1_angle, None, selected, integrated[0])
    else:
        solve_orientation = _solve_by_euler_angles if options.method == "euler_angles" else _solve_by_scipy
        orientation = solve_orientation(
            options, replace(attitude, rule=_STEP_RULE_OF_REFERENCE_SOLUTION), np.asarray(start)
        )
        tol = (
            _DEFAULT_TOLERANCE_OF_DOP853_IN_RAD if options.tol is None and options.method == "dop853" else options.tol
        )
        selected = select_steps((hinge,), options.t, tol)
    hinge_angle = _integrate(hinge, psi_0, selected, None if integrated is None else integrated[1])
    sampled_rates = [rate for rate in (omega, psid) if isinstance(rate, SampledSignal)]

    @functools.cache
    def deviations() -> Array:
        return stamp_deviations(sampled_rates)

    def with_stamps(error: LazyValue, rate: Signal, max_error: float) -> LazyValue:
        if not isinstance(rate, SampledSignal):
            return error
        return LazyValue(lambda: min(error() + stamp_error(rate, deviations()), max_error))

    errors = (
        with_stamps(orientation.error, omega, math.inf if is_planar else math.pi),
        with_stamps(hinge_angle.error, psid, math.inf),
    )
    return Solution(orientation.values, hinge_angle.values, orientation.steps, *errors)


def _integrate(
    integral: Integral, start: Any, selected_steps: SelectedSteps, values: Array | None = None
) -> _IntegratedValues:
    """Integrate a rate from `start` over `selected_steps`, a SelectedSteps object; return `_IntegratedValues` at the
    instants. `values`, unless None, is the integral at the ends of the steps, which is then not computed again. Raise
    an ArgumentError if the integral overflows.
    """
    steps, measured_errors = selected_steps.steps, selected_steps.measured_errors.get(integral)
    if values is None:
        values = integral.integrate(steps, start)
    else:
        integral.check_finite(values.reshape(len(values), -1), steps)
    error = LazyValue(lambda: min(estimate_error(integral, steps, values, measured_errors), integral.max_error))
    return _IntegratedValues(steps.at_instants(values), steps.step_count, error)


def _solve_by_euler_angles(options: SolveOptions, attitude: AttitudeIntegral, S1_0: Array) -> _IntegratedValues:
    """Integrate Euler angles from the attitude S1_0; return `_IntegratedValues` with the attitudes as quaternions.
    `attitude` is the AttitudeIntegral of omega, which also gives the reference for the error. With a tolerance, halve
    all steps until the error is below the tolerance or stagnates, or there are more than MAX_SELECTED_STEP_COUNT
    steps. Raise a GimbalLockError near gimbal lock.

    Only errors of samples can stagnate. With a tolerance, steps are also halved where they are too long to tell
    gimbal lock from a fast turn.
    """
    steps, last_error = Steps(options.t), math.inf
    max_step_count_after_gimbal_lock = max(50_000, 4 * (len(options.t) - 1))
    while True:
        try:
            phi = integrate_euler_angles(
                attitude.rate,
                steps,
                options.execution,
                matrix_to_euler(S1_0),
                omega_in_body_axes=options.omega_in_body_axes,
            )
        except GimbalLockError:
            if options.tol is None or 2 * steps.step_count > max_step_count_after_gimbal_lock:
                raise
        else:
            result = _with_reference_error(
                attitude,
                options.t,
                matrix_to_quaternion(S1_0),
                euler_to_quaternions(steps.at_instants(phi)),
                steps.step_count,
            )
            stagnates = isinstance(attitude.rate, SampledSignal) and not result.error() < 0.9 * last_error
            if (
                options.tol is None
                or not result.error() > options.tol
                or steps.step_count > MAX_SELECTED_STEP_COUNT
                or stagnates
            ):
                return result
            last_error = result.error()
        steps = steps.refine(steps.t[:-1] + 0.5 * np.diff(steps.t))


def _solve_by_scipy(options: SolveOptions, attitude: AttitudeIntegral, S1_0: Array) -> _IntegratedValues:
    """Integrate q' = omega q / 2 (in body axes q omega / 2) by SciPy's DOP853 from the attitude S1_0; return
    `_IntegratedValues` with unit quaternions. `attitude` is the AttitudeIntegral of omega, which also gives the
    reference for the error. Raise a MissingDependencyError without SciPy, or an ArgumentError if the solver gives up
    or evaluates omega too often.
    """
    try:
        from scipy.integrate import solve_ivp
    except ImportError as error:
        raise MissingDependencyError("method", "scipy (pip install scipy), or another method", str(error)) from None
    t, tol = (
        options.t,
        max(_DEFAULT_TOLERANCE_OF_DOP853_IN_RAD if options.tol is None else 0.01 * options.tol, _MIN_SCIPY_RTOL),
    )
    start, since, evaluations = matrix_to_quaternion(S1_0), t - t[0], 0

    def rate(time: float, q: Any) -> Any:
        """Return q' at the quaternion q and a time since the first instant [s] as a tuple. Raise an ArgumentError
        after too many evaluations.
        """
        nonlocal evaluations
        evaluations += 1
        if evaluations > MAX_OMEGA1_EVALUATIONS_BY_SCIPY:
            got = f"{MAX_OMEGA1_EVALUATIONS_BY_SCIPY:,} evaluations of omega1 until {time:.3g} s of {since[-1]:.3g} s"
            raise ArgumentError("method", "'magnus6' for a motion so long or fast that 'dop853' takes minutes", got)
        k = int(np.searchsorted(since, time, side="right")) - 1
        omega = attitude.rate.values_at_nodes(t[k : k + 1], np.array([time - since[k]]), (1.0,))[0, 0]
        w = (0.0, *(0.5 * omega).tolist())
        p = tuple(q.tolist())
        return quaternion_product(p, w) if options.omega_in_body_axes else quaternion_product(w, p)

    rows = start[None]
    if len(t) > 1:
        result = solve_ivp(rate, (0.0, since[-1]), start, method="DOP853", t_eval=since, rtol=tol, atol=tol)
        if not result.success:
            raise ArgumentError("method", "a motion that 'dop853' can follow", result.message)
        rows = result.y.T
    return _with_reference_error(attitude, t, start, rows / np.sqrt((rows**2).sum(axis=1, keepdims=True)), 0)


def _with_reference_error(
    attitude: AttitudeIntegral, t: Array, start: Array, quats: Array, step_count: int
) -> _IntegratedValues:
    """Return the quaternions `quats` (N, 4) and the number of steps as `_IntegratedValues` with a lazy estimate of
    the error of the quaternions, the largest angle from a reference solution of small tolerance. The AttitudeIntegral
    `attitude` computes the reference solution from the quaternion `start`.
    """

    def error() -> float:
        """Return the sum of the largest angle from the reference solution and the error of the reference solution
        [rad], at most pi.
        """
        reference = _integrate(attitude, start, select_steps((attitude,), t, _TOLERANCE_OF_REFERENCE_SOLUTION_IN_RAD))
        w, x, y, z = quaternion_product(tuple(quats.T), tuple((reference.values * [1, -1, -1, -1]).T))
        angles = 2 * np.arctan2(np.sqrt(x * x + y * y + z * z), np.abs(w))
        return min(float(angles.max()) + reference.error(), math.pi)

    return _IntegratedValues(quats, step_count, LazyValue(error))
