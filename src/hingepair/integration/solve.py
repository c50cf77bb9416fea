"""From rates to angles (E12): a method, the steps that a tolerance asks for, and how far the result is off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.errors import ArgumentError, GimbalLockError, MissingDependencyError
from hingepair.evaluation.backend import How
from hingepair.integration.error_estimate import angle_error, attitude_error
from hingepair.integration.euler_angles import RULE as EULER_RULE
from hingepair.integration.euler_angles import euler_angles, quaternions_of_euler
from hingepair.integration.methods import RULES, Rule, quaternion_product
from hingepair.integration.signals import Samples, Signal, Values
from hingepair.integration.step_selection import MOST_STEPS, selected_steps
from hingepair.integration.stepping import Steps, angles, attitudes
from hingepair.integration.trajectory import Later
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
    """How to go.

    Attributes:
        t: the instants.
        method: one of METHODS; in the plane, of RULES.
        tol: the error that is aimed at [rad], or None: one step for each interval.
        how: backend.
        body: whether omega is in body axes.
        names: what omega1 and psi' are called in errors.
    """

    t: Values
    method: str
    tol: float | None
    how: How
    body: bool
    names: tuple[str, str] = ("omega1", "psid")


class Solution(NamedTuple):
    """What was found at the instants.

    Attributes:
        turned: attitudes of body 1, unit quaternions (N, 4) without a jump of sign; in the plane its angles (N,).
        psi: hinge angles (N,).
        steps: how many steps were made; 0 where SciPy chose them.
        error: how far the attitudes are off at the worst instant [rad].
        psi_error: the same of psi.
    """

    turned: Values
    psi: Values
    steps: int
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


class _Turned(NamedTuple):
    """Attitudes or angles at the instants that the steps are between, how far they are off, and the steps made."""

    values: Values
    error: Later
    steps: Steps

    @property
    def asked(self) -> Values:
        """The values at the instants that were asked for."""
        return self.values if self.steps.asked is None else self.values[self.steps.asked]


def solve(course: Course, omega: Signal, psid: Signal, start: Values | float, psi_0: float) -> Solution:
    """Attitudes and hinge angles at the instants.

    Args:
        course: how to go.
        omega: angular velocity of body 1.
        psid: hinge rate.
        start: attitude of body 1 at the first instant, shape (3, 3); in the plane its angle.
        psi_0: hinge angle then.

    Raises:
        ArgumentError: the tolerance is no positive number, something overflows, or SciPy's solver gives up.
        GimbalLockError: `euler_angles` came too near to lock, or its steps are too long.
        MissingDependencyError: `dop853` without SciPy.
    """
    if course.tol is not None and not finite_number("tol", course.tol) > 0:
        raise ArgumentError("tol", "a positive number", course.tol)
    flat = np.ndim(start) == 0
    check_choice("method", course.method, tuple(RULES) if flat else METHODS)
    if flat:
        rule = RULES[course.method]
        steps = _steps_of_angles(course, (omega, psid), rule)
        turned = _angle(course, course.names[0], omega, float(start), steps, rule)
    else:
        turned = _attitudes(course, omega, psid, np.asarray(start))
        rule, steps = {"euler_angles": EULER_RULE, "dop853": _BEST, **RULES}[course.method], turned.steps
        if course.method not in RULES:
            steps = _steps_of_angles(course, (psid,), rule)
    hinge = _angle(course, course.names[1], psid, psi_0, steps, rule)
    made = 0 if course.method == "dop853" else int(turned.steps.counts.sum())
    return Solution(turned.asked, hinge.asked, made, turned.error, hinge.error)


def _attitudes(course: Course, omega: Signal, psid: Signal, S1_0: Values) -> _Turned:
    start = matrix_to_quaternion(S1_0)
    if course.method == "euler_angles":
        return _by_euler_angles(course, omega, start, S1_0)
    if course.method == "dop853":
        return _by_scipy(course, omega, start)
    rule = RULES[course.method]
    return _by_rule(course, omega, start, _steps_of_attitude(course, omega, (psid,), rule, course.tol), rule)


def _angle(course: Course, name: str, rate: Signal, start: float, steps: Steps, rule: Rule) -> _Turned:
    """The integral of a rate of this name, from a value at the first instant."""
    values = angles(name, rate, start, steps, rule, course.how)
    last_bit = 2.0**-53 * float(np.abs(values).max())
    return _Turned(values, Later(lambda: angle_error(rate, steps, rule) + last_bit), steps)


def _steps_of_angles(course: Course, rates: Sequence[Signal], rule: Rule) -> Steps:
    """The steps that angles need, no attitude being integrated in them."""
    tol = _SCIPY_TOLERANCE if course.tol is None and course.method == "dop853" else course.tol
    return selected_steps(None, rates, course.t, rule, tol, course.how)


def _steps_of_attitude(
    course: Course, omega: Signal, rates: Sequence[Signal], rule: Rule, tol: float | None
) -> Steps:
    return selected_steps(omega, rates, course.t, rule, tol, course.how, body=course.body)


def _by_rule(course: Course, omega: Signal, start: Values, steps: Steps, rule: Rule) -> _Turned:
    quats = attitudes(omega, steps, rule, course.how, start, body=course.body)
    error = Later(lambda: min(attitude_error(omega, steps, rule, quats, course.how, body=course.body), math.pi))
    return _Turned(quats, error, steps)


def _by_euler_angles(course: Course, omega: Signal, start: Values, S1_0: Values) -> _Turned:
    """Steps are halved for all intervals alike until the error is small enough, or no longer falls (of samples).

    Where a tolerance lets them, they are halved as well where they are too long to tell lock from a fast turn.
    """
    counts, before = np.ones(len(course.t) - 1, np.int64), math.inf
    while True:
        steps = Steps(course.t, counts)
        try:
            phi = euler_angles(omega, steps, course.how, matrix_to_euler(S1_0), body=course.body)
        except GimbalLockError:
            if course.tol is None or 2 * counts.sum() > max(_STEPS_TO_LOCK, 4 * len(counts)):
                raise
            counts = 2 * counts
            continue
        found = _checked(course, omega, start, quaternions_of_euler(phi), steps)
        in_vain = isinstance(omega, Samples) and not found.error() < 0.9 * before
        if course.tol is None or not found.error() > course.tol or counts.sum() > MOST_STEPS or in_vain:
            return found
        counts, before = 2 * counts, found.error()


def _by_scipy(course: Course, omega: Signal, start: Values) -> _Turned:
    """By DOP853, from q' = omega q / 2 (body axes: q omega / 2), in the time since the first instant."""
    try:
        from scipy.integrate import solve_ivp
    except ImportError as error:
        raise MissingDependencyError("method", "scipy (pip install scipy), or another method", str(error)) from None
    t, tol = course.t, max(_SCIPY_TOLERANCE if course.tol is None else 0.01 * course.tol, _SHARPEST)
    since, looks = t - t[0], 0

    def rate(time: float, q: Any) -> Any:
        nonlocal looks
        looks += 1
        if looks > MOST_LOOKS:
            got = f"{MOST_LOOKS:,} looks at omega1 until {time:.3g} s of {since[-1]:.3g} s"
            raise ArgumentError("method", "'magnus6' for a motion so long or fast that 'dop853' takes minutes", got)
        w = (0.0, *(0.5 * omega.nodes(t[:1], np.array([time]), (1.0,))[0, 0]).tolist())
        p = tuple(q.tolist())
        return quaternion_product(p, w) if course.body else quaternion_product(w, p)

    rows = start[None]
    if len(t) > 1:
        done = solve_ivp(rate, (0.0, since[-1]), start, method="DOP853", t_eval=since, rtol=tol, atol=tol)
        if not done.success:
            raise ArgumentError("method", "a motion that 'dop853' can follow", done.message)
        rows = done.y.T
    quats = rows / np.sqrt((rows**2).sum(axis=1, keepdims=True))
    return _checked(course, omega, start, quats, Steps(t, np.ones(len(t) - 1, np.int64)))


def _checked(course: Course, omega: Signal, start: Values, quats: Values, steps: Steps) -> _Turned:
    """The error of attitudes that depend on one another: how far they are from those of the best rule."""

    def error() -> float:
        enough = _steps_of_attitude(course, omega, (), _BEST, _CERTAIN)
        best = _by_rule(course, omega, start, enough, _BEST)
        w, x, y, z = quaternion_product(tuple(quats.T), tuple((best.asked * [1, -1, -1, -1]).T))
        apart = 2 * np.arctan2(np.sqrt(x * x + y * y + z * z), np.abs(w))
        return min(float(apart.max()) + best.error(), math.pi)

    return _Turned(quats, Later(error), steps)
