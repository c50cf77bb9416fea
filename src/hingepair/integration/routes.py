"""The ways from rates to angles (E12): rules for single steps, Euler angles, SciPy; each estimates its error."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from hingepair.errors import ArgumentError, GimbalLockError
from hingepair.evaluation.backend import How
from hingepair.integration.attitude_steps import RULES, Rule, Steps, angles, attitudes, loops
from hingepair.integration.euler_route import RULE as EULER_RULE
from hingepair.integration.euler_route import euler_angles, quaternions_of_euler
from hingepair.integration.increments import quaternion_product
from hingepair.integration.later import Later
from hingepair.integration.scipy_route import TOLERANCE, quaternions
from hingepair.integration.signals import Samples, Signal, Values
from hingepair.integration.step_control import angle_error, angle_rounding, attitude_error, attitude_rounding
from hingepair.integration.step_counts import MOST_STEPS, substeps
from hingepair.numeric.arrays import finite_number
from hingepair.rotations.euler import matrix_to_euler
from hingepair.rotations.matrices import matrix_to_quaternion

METHODS: Final = (*RULES, "euler_angles", "dop853")

_BEST = RULES["magnus6"]
_CERTAIN = 1e-14  # the tolerance of what others are compared with [rad]
_STEPS_TO_LOCK = 50_000  # that are tried for a motion that comes near gimbal lock
_U = 2.0**-53


class Course(NamedTuple):
    """How to go.

    Attributes:
        t: the instants.
        method: one of METHODS.
        tol: the error allowed, or None.
        how: backend.
        body: whether omega is in body axes.
    """

    t: Values
    method: str
    tol: float | None
    how: How
    body: bool


class Turned(NamedTuple):
    """Attitudes (quaternions) or angles at the instants, how far they are off, and the steps made."""

    values: Values
    error: Later
    steps: Steps


def space_attitudes(course: Course, omega: Signal, psid: Signal, S1_0: Values) -> Turned:
    """The attitudes of body 1 at the instants."""
    start = matrix_to_quaternion(S1_0)
    if course.method == "euler_angles":
        return _by_euler_angles(course, omega, start, S1_0)
    if course.method == "dop853":
        return _by_scipy(course, omega, start)
    rule = RULES[course.method]
    steps = Steps(course.t, substeps(omega, (psid,), course.t, rule, course.tol, body=course.body))
    return _by_rule(course, omega, start, steps, rule)


def hinge_angles(course: Course, psid: Signal, psi_0: float, steps: Steps) -> Turned:
    """The hinge angle at the instants, in the steps of the attitude, or in steps of its own."""
    rule = {"euler_angles": EULER_RULE, "dop853": _BEST}.get(course.method) or RULES[course.method]
    if course.method not in RULES:
        steps = plain_steps(course, (psid,), rule)
    return plane_angle(course, "psid", psid, psi_0, steps, rule)


def plane_angle(course: Course, name: str, rate: Signal, start: float, steps: Steps, rule: Rule) -> Turned:
    """The integral of a rate of this name, from a value at the first instant."""
    values = angles(name, rate, start, steps, rule, loops(course.how, steps))

    def error() -> float:
        return angle_error(rate, steps, rule) + angle_rounding(rate, steps) + _U * float(np.abs(values).max())

    return Turned(values, Later(error), steps)


def plain_steps(course: Course, rates: Sequence[Signal], rule: Rule) -> Steps:
    """The steps that angles need, no attitude being integrated in them."""
    tol = TOLERANCE if course.tol is None and course.method == "dop853" else course.tol
    return Steps(course.t, substeps(None, rates, course.t, rule, tol))


def _by_rule(course: Course, omega: Signal, start: Values, steps: Steps, rule: Rule) -> Turned:
    quats = attitudes(omega, steps, rule, loops(course.how, steps), start, body=course.body)

    def error() -> float:
        error = attitude_error(omega, steps, rule, quats, body=course.body) + attitude_rounding(omega, steps)
        return min(error, math.pi)

    return Turned(quats, Later(error), steps)


def _by_euler_angles(course: Course, omega: Signal, start: Values, S1_0: Values) -> Turned:
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


def _by_scipy(course: Course, omega: Signal, start: Values) -> Turned:
    tol = TOLERANCE if course.tol is None else 0.01 * course.tol
    plain = Steps(course.t, np.ones(len(course.t) - 1, np.int64))
    quats = quaternions(omega, course.t, start, body=course.body, tol=tol)
    return _checked(course, omega, start, quats, plain)


def _checked(course: Course, omega: Signal, start: Values, quats: Values, steps: Steps) -> Turned:
    """The error of attitudes that depend on one another: how far they are from those of the best rule."""

    def error() -> float:
        enough = Steps(course.t, substeps(omega, (), course.t, _BEST, _CERTAIN, body=course.body))
        best = _by_rule(course, omega, start, enough, _BEST)
        w, x, y, z = quaternion_product(tuple(quats.T), tuple((best.values * [1, -1, -1, -1]).T))
        apart = 2 * np.arctan2(np.sqrt(x * x + y * y + z * z), np.abs(w))
        return min(float(apart.max()) + best.error(), math.pi)

    return Turned(quats, Later(error), steps)


def check_tolerance(tol: float | None) -> None:
    """Refuse a tolerance that is no positive number.

    Raises:
        ArgumentError: names `tol`.
    """
    if tol is not None and not finite_number("tol", tol) > 0:
        raise ArgumentError("tol", "a positive number", tol)


def check_reached(tol: float | None, errors: Mapping[str, Later]) -> None:
    """Refuse a tolerance that was not reached.

    Args:
        tol: the tolerance.
        errors: what each rate leaves, by the rate's name.

    Raises:
        ArgumentError: says what is left, and by which rate.
    """
    if tol is None:
        return
    left = {name: error() for name, error in errors.items()}
    worst = max(left.values(), key=lambda e: math.inf if math.isnan(e) else e)
    if not worst <= tol:
        each = ", ".join(f"{name} leaves {error:.2g}" for name, error in left.items())
        raise ArgumentError("tol", f"at least the error that is left, {worst:.2g} rad ({each})", tol)
