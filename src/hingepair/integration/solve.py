"""From rates to angles (E12): a method, the steps that a tolerance asks for, and how far the result is off."""

from __future__ import annotations

import functools
import math
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.engine.backend import Execution
from hingepair.errors import ArgumentError, GimbalLockError, MissingDependencyError
from hingepair.integration.error_estimate import estimated_error
from hingepair.integration.euler_angles import euler_angles, quaternions_of_euler
from hingepair.integration.integrals import Angle, Attitude, Integral
from hingepair.integration.methods import RULES, quaternion_product
from hingepair.integration.signals import Samples, Signal
from hingepair.integration.stamp_rounding import stamp_deviations, stamp_error
from hingepair.integration.step_selection import MOST_STEPS, SelectedSteps, selected_steps
from hingepair.integration.stepping import Steps
from hingepair.integration.trajectory import Later
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import check_choice, finite_number
from hingepair.rotations.euler import matrix_to_euler
from hingepair.rotations.matrices import matrix_to_quaternion

METHODS: Final = (*RULES, "euler_angles", "dop853")

MOST_LOOKS: Final = 1_000_000
"""At omega1, one at a time, that SciPy's solver may take: some twenty seconds."""

_BEST = RULES["magnus6"]
_CERTAIN = 1e-14  # the tolerance of what others are compared with [rad]
_STEPS_TO_LOCK = 50_000  # that are tried for a motion that comes near gimbal lock
_SCIPY_TOLERANCE = 1e-12
_SHARPEST = 3e-14  # SciPy takes no smaller relative tolerance


class Course(NamedTuple):
    """How to go."""

    t: Array  # the instants
    method: str  # one of METHODS; in the plane, of RULES
    tol: float | None  # the error that is aimed at [rad], or None: one step for each interval
    how: Execution
    body: bool  # whether omega is in body axes
    names: tuple[str, str] = ("omega1", "psid")  # what the rates are called in errors


class Solution(NamedTuple):
    """What was found at the instants, and how far it is off at the worst of them [rad]."""

    turned: Array  # attitudes of body 1, unit quaternions (N, 4) without a jump of sign; in the plane its angles (N,)
    psi: Array  # hinge angles (N,)
    steps: int  # how many were made; 0 where SciPy chose them
    error: Later
    psi_error: Later

    @property
    def worst(self) -> float:
        """The larger error; NaN, not known, where one is."""
        return float(np.maximum(self.error(), self.psi_error()))

    def check(self, course: Course) -> None:
        """Refuse a tolerance that was not reached.

        Raises:
            ArgumentError: says what is left, and by which rate.
        """
        if course.tol is not None and not self.worst <= course.tol:
            left = (self.error(), self.psi_error())
            each = ", ".join(f"{name} leaves {error:.2g}" for name, error in zip(course.names, left, strict=True))
            raise ArgumentError("tol", f"at least the error that is left, {self.worst:.2g} rad ({each})", course.tol)


class _Found(NamedTuple):
    """Attitudes or angles."""

    values: Array  # at the instants
    steps: int  # that were made
    error: Later


def solve(course: Course, omega: Signal, psid: Signal, start: Array | float, psi_0: float) -> Solution:
    """Attitudes of body 1 (in the plane its angles) and hinge angles at the instants; `start` is the first of them.

    Raises:
        ArgumentError: the tolerance is no positive number, something overflows, or SciPy's solver gives up.
        GimbalLockError: `euler_angles` came too near to lock, or its steps are too long.
        MissingDependencyError: `dop853` without SciPy.
    """
    if course.tol is not None and not finite_number("tol", course.tol) > 0:
        raise ArgumentError("tol", "a positive number", course.tol)
    flat = np.ndim(start) == 0
    check_choice("method", course.method, tuple(RULES) if flat else METHODS)
    rule = {"euler_angles": RULES["rk4_quaternion"], "dop853": _BEST, **RULES}[course.method]
    attitude = Attitude(course.names[0], omega, rule, course.how, course.body)
    hinge = Angle(course.names[1], psid, rule, course.how)
    if course.method in RULES:
        turning = Angle(course.names[0], omega, rule, course.how) if flat else attitude
        selected = selected_steps((turning, hinge), course.t, course.tol)
        turned = _integrated(turning, start if flat else matrix_to_quaternion(np.asarray(start)), selected)
    else:
        find = _by_euler_angles if course.method == "euler_angles" else _by_scipy
        turned = find(course, replace(attitude, rule=_BEST), np.asarray(start))
        tol = _SCIPY_TOLERANCE if course.tol is None and course.method == "dop853" else course.tol
        selected = selected_steps((hinge,), course.t, tol)
    swung = _integrated(hinge, psi_0, selected)
    sampled = [rate for rate in (omega, psid) if isinstance(rate, Samples)]

    @functools.cache
    def deviations() -> Array:
        return stamp_deviations(sampled)

    def with_stamps(error: Later, rate: Signal, farthest: float) -> Later:
        if not isinstance(rate, Samples):
            return error
        return Later(lambda: min(error() + stamp_error(rate, deviations()), farthest))

    errors = (
        with_stamps(turned.error, omega, math.inf if flat else math.pi),
        with_stamps(swung.error, psid, math.inf),
    )
    return Solution(turned.values, swung.values, turned.steps, *errors)


def _integrated(integral: Integral, start: Any, selected: SelectedSteps) -> _Found:
    steps = selected.steps
    values, known = integral.over(steps, start), selected.known.get(integral)
    error = Later(lambda: min(estimated_error(integral, steps, values, known), integral.farthest))
    return _Found(steps.asked(values), steps.made, error)


def _by_euler_angles(course: Course, turning: Attitude, S1_0: Array) -> _Found:
    """Steps are halved for all intervals alike until the error is small enough, or no longer falls (of samples).

    Where a tolerance lets them, they are halved as well where they are too long to tell lock from a fast turn.
    """
    steps, before = Steps(course.t), math.inf
    while True:
        try:
            phi = euler_angles(turning.rate, steps, course.how, matrix_to_euler(S1_0), body=course.body)
        except GimbalLockError:
            if course.tol is None or 2 * steps.made > max(_STEPS_TO_LOCK, 4 * (len(course.t) - 1)):
                raise
        else:
            found = _compared(
                turning, course.t, matrix_to_quaternion(S1_0), quaternions_of_euler(steps.asked(phi)), steps.made
            )
            in_vain = isinstance(turning.rate, Samples) and not found.error() < 0.9 * before
            if course.tol is None or not found.error() > course.tol or steps.made > MOST_STEPS or in_vain:
                return found
            before = found.error()
        steps = steps.refined(steps.t[:-1] + 0.5 * np.diff(steps.t))


def _by_scipy(course: Course, turning: Attitude, S1_0: Array) -> _Found:
    """By DOP853, from q' = omega q / 2 (body axes: q omega / 2), in the time since the first instant."""
    try:
        from scipy.integrate import solve_ivp
    except ImportError as error:
        raise MissingDependencyError("method", "scipy (pip install scipy), or another method", str(error)) from None
    t, tol = course.t, max(_SCIPY_TOLERANCE if course.tol is None else 0.01 * course.tol, _SHARPEST)
    start, since, looks = matrix_to_quaternion(S1_0), t - t[0], 0

    def rate(time: float, q: Any) -> Any:
        nonlocal looks
        looks += 1
        if looks > MOST_LOOKS:
            got = f"{MOST_LOOKS:,} looks at omega1 until {time:.3g} s of {since[-1]:.3g} s"
            raise ArgumentError("method", "'magnus6' for a motion so long or fast that 'dop853' takes minutes", got)
        k = int(np.searchsorted(since, time, side="right")) - 1
        omega = turning.rate.nodes(t[k : k + 1], np.array([time - since[k]]), (1.0,))[0, 0]
        w = (0.0, *(0.5 * omega).tolist())
        p = tuple(q.tolist())
        return quaternion_product(p, w) if course.body else quaternion_product(w, p)

    rows = start[None]
    if len(t) > 1:
        done = solve_ivp(rate, (0.0, since[-1]), start, method="DOP853", t_eval=since, rtol=tol, atol=tol)
        if not done.success:
            raise ArgumentError("method", "a motion that 'dop853' can follow", done.message)
        rows = done.y.T
    return _compared(turning, t, start, rows / np.sqrt((rows**2).sum(axis=1, keepdims=True)), 0)


def _compared(best: Attitude, t: Array, start: Array, quats: Array, steps: int) -> _Found:
    """The error of attitudes that depend on one another: how far they are from those of the best rule."""

    def error() -> float:
        other = _integrated(best, start, selected_steps((best,), t, _CERTAIN))
        w, x, y, z = quaternion_product(tuple(quats.T), tuple((other.values * [1, -1, -1, -1]).T))
        apart = 2 * np.arctan2(np.sqrt(x * x + y * y + z * z), np.abs(w))
        return min(float(apart.max()) + other.error(), math.pi)

    return _Found(quats, steps, Later(error))
