"""Sentences about numbers that are probably in another unit than expected: milliseconds, degrees, millimetres.

A suspicion is no error: the numbers can be right. So nothing here raises; callers add the sentences to their notes,
findings or warnings. Each function returns a list of sentences, which is empty where nothing is suspicious.
"""

from __future__ import annotations

import numpy as np

from hingepair.numeric.arrays import Float64Array, row_norms

_MIN_TIME_STEP_COUNT_FOR_INSTANT_SUSPICIONS = 8  # of instants that are a recording; fewer are suspicious of nothing
_MIN_SUSPICIOUSLY_LONG_MEDIAN_TIME_STEP_IN_SECONDS = 1.0  # [s]: sensors of motion take at least one sample a second
# No sensor of motion takes a million samples a second.
_MAX_SUSPICIOUSLY_SHORT_MEDIAN_TIME_STEP_IN_SECONDS = 1e-6
_MIN_SUSPICIOUS_ANGLE_SPAN, _MAX_SUSPICIOUS_ANGLE_SPAN = 4 * np.pi, 720.0
"""Spans of hinge angles that are suspicious [rad]: more than two turns, and fewer than two turns if read as degrees.
What spans more is a wheel in either unit."""
# Between the reference points of two bodies that share a hinge.
_MIN_SUSPICIOUS_MEDIAN_BODY_DISTANCE_IN_METRES = 50.0
# Usual gyroscopes end at 2000 degrees a second, 35 rad/s.
_MAX_UNSUSPICIOUS_GYROSCOPE_RATE_IN_RAD_PER_SECOND = 40.0
_MIN_SUSPICIOUS_FORCE, _MAX_SUSPICIOUS_FORCE = 0.5, 2.0
"""Median sizes of what an accelerometer feels that are suspicious [m/s^2]: of a slow sensor that counts in g."""
_ROUND_ANGLE, _ROUND_RATE = 5.0, 45.0  # whole multiples of which degrees, and degrees a second, are
# Of the levers of a body: a larger radius of gyration is suspicious.
_MAX_UNSUSPICIOUS_GYRATION_RADIUS_TO_LEVER_RATIO = 30.0


def instant_suspicions(name: str, t: Float64Array) -> list[str]:
    """Return a list with one sentence, which calls the data `name`, if instants t are probably not in seconds, judged
    by the median time step; an empty list otherwise.

    Args:
        name: what the caller's messages call the instants, such as "t" or "log.csv: t".
        t: instants, increasing; shape (N,) s. NaN is stepped over.

    >>> instant_suspicions("t", np.arange(10) * 2.0)
    ['t steps by 2 s: is it in seconds? Milliseconds become seconds by 1e-3 * t.']
    """
    steps = np.diff(t[np.isfinite(t)])
    if steps.size < _MIN_TIME_STEP_COUNT_FOR_INSTANT_SUSPICIONS:
        return []
    step = float(np.median(steps))
    if step >= _MIN_SUSPICIOUSLY_LONG_MEDIAN_TIME_STEP_IN_SECONDS:
        # Each unit with the largest step of a usual recording in it.
        units = (500.0, "Milliseconds", "1e-3"), (5e5, "Microseconds", "1e-6"), (np.inf, "Nanoseconds", "1e-9")
        unit, factor = next((unit, factor) for largest_step, unit, factor in units if step <= largest_step)
        return [f"{name} steps by {step:.3g} s: is it in seconds? {unit} become seconds by {factor} * t."]
    if 0 < step <= _MAX_SUSPICIOUSLY_SHORT_MEDIAN_TIME_STEP_IN_SECONDS:
        return [f"{name} steps by {step:.3g} s: is it in seconds? Days become seconds by 86400 * t."]
    return []


def angle_suspicions(name: str, angles: Float64Array) -> list[str]:
    """Return a list with one sentence, which calls the data `name`, if a hinge angle, or another angle, is probably
    in degrees and not in radians, judged by its span; an empty list otherwise.

    Args:
        name: what the caller's messages call the angle, such as "psi".
        angles: samples of one angle; shape (N,) rad. NaN is stepped over.

    >>> angle_suspicions("psi", np.array([-90.0, 20.0, 90.0]))
    ['psi spans 180 rad, 28.6 turns: is it in radians? Degrees become radians by numpy.radians(psi).']
    """
    finite = angles[np.isfinite(angles)]
    span = float(np.ptp(finite)) if finite.size else 0.0
    if not _MIN_SUSPICIOUS_ANGLE_SPAN < span <= _MAX_SUSPICIOUS_ANGLE_SPAN:
        return []
    turns = f"{name} spans {span:.3g} rad, {span / (2 * np.pi):.3g} turns"
    return [f"{turns}: is it in radians? Degrees become radians by numpy.radians({name})."]


def _finite_norms(vectors: Float64Array) -> Float64Array:
    """Return the Euclidean norms of the vectors (N, 3), without the norms that are not finite."""
    norms = row_norms(vectors)
    return norms[np.isfinite(norms)]


def gyroscope_suspicions(name: str, omega: Float64Array) -> list[str]:
    """Return a list with one sentence, which calls the data `name`, if the readings `omega` (N, 3) of a gyroscope are
    probably in degrees a second and not in rad/s, judged by the largest magnitude; an empty list otherwise.

    Args:
        name: what the caller's messages call the readings, such as "omega1_b1".
        omega: shape (N, 3) rad/s. NaN is stepped over.

    >>> gyroscope_suspicions("omega1_b1", np.array([[0.0, 90.0, 0.0]]))
    ['omega1_b1 comes to 90 rad/s: is it in rad/s? Degrees a second become rad/s by numpy.radians(omega1_b1).']
    """
    largest = float(_finite_norms(omega).max(initial=0.0))
    if largest <= _MAX_UNSUSPICIOUS_GYROSCOPE_RATE_IN_RAD_PER_SECOND:
        return []
    size = f"{name} comes to {largest:.3g} rad/s"
    return [f"{size}: is it in rad/s? Degrees a second become rad/s by numpy.radians({name})."]


def accelerometer_suspicions(name: str, force: Float64Array) -> list[str]:
    """Return a list with one sentence, which calls the data `name`, if the readings `force` (N, 3) of an
    accelerometer are probably multiples of g and not in m/s^2, judged by their median magnitude; an empty list
    otherwise.

    Args:
        name: what the caller's messages call the readings, such as "f1_b1".
        force: shape (N, 3) m/s^2. NaN is stepped over.

    >>> accelerometer_suspicions("f1_b1", np.array([[0.1, 0.0, 1.0]]))
    ['f1_b1 is of the size of 1 m/s^2: is it in m/s^2? Multiples of g become m/s^2 by 9.80665 * f1_b1.']
    """
    norms = _finite_norms(force)
    middle = float(np.median(norms)) if norms.size else 0.0
    if not _MIN_SUSPICIOUS_FORCE < middle < _MAX_SUSPICIOUS_FORCE:
        return []
    size = f"{name} is of the size of {middle:.2g} m/s^2"
    return [f"{size}: is it in m/s^2? Multiples of g become m/s^2 by 9.80665 * {name}."]


def distance_suspicions(name: str, distances: Float64Array) -> list[str]:
    """Return a list with one sentence, which calls the data `name`, if distances between the bodies of a pair are
    probably in millimetres and not in metres, judged by their median; an empty list otherwise.

    Args:
        name: what the caller's messages call the distance, such as "R2 - R1".
        distances: shape (N,) m. NaN is stepped over.

    >>> distance_suspicions("R2 - R1", np.array([480.0, 510.0, 520.0]))
    ['R2 - R1 is 510 m long: is it in metres? Millimetres become metres by the factor 1e-3.']
    """
    finite = distances[np.isfinite(distances)]
    middle = float(np.median(finite)) if finite.size else 0.0
    if middle < _MIN_SUSPICIOUS_MEDIAN_BODY_DISTANCE_IN_METRES:
        return []
    return [f"{name} is {middle:.3g} m long: is it in metres? Millimetres become metres by the factor 1e-3."]


def degree_suspicions(name: str, values: Float64Array, *, rates: bool = False) -> list[str]:
    """Return a list with one sentence, which calls the data `name`, if values that a person has written, angles or
    (if `rates` is True) angular velocities, are probably in degrees, since all of them are round numbers of degrees;
    an empty list otherwise.

    Degrees are written in whole fives, and angular velocities in parts of a turn; radians hardly ever are.

    Args:
        name: what the caller's messages call the values, such as "stops".
        values: angles that should be radians, or rates that should be rad/s; shape (n,).
        rates: whether the values are rates.

    >>> degree_suspicions("stops", np.array([-90.0, 90.0])), degree_suspicions("psid_0", np.array([3.0]), rates=True)
    (['stops: 90 is taken for radians, 14.3 turns; degrees become radians by numpy.radians(90).'], [])
    """
    part, least, unit = (_ROUND_RATE, _ROUND_RATE, "rad/s") if rates else (_ROUND_ANGLE, 2 * _ROUND_ANGLE, "radians")
    largest = float(np.abs(values).max(initial=0.0))
    if largest < least or np.any(np.mod(values, part)):
        return []
    turns = f"{largest / (2 * np.pi):.3g} turns{' a second' if rates else ''}"
    return [
        f"{name}: {largest:g} is taken for {unit}, {turns}; degrees become radians by numpy.radians({largest:g})."
    ]


def inertia_suspicions(name: str, mass: float, inertia: Float64Array, lever: float) -> list[str]:
    """Return a list with one sentence, which calls the data `name`, if the inertia of a body is probably not in kg
    m^2, judged by its radius of gyration for the given mass compared with `lever`, a length on the body [m]; an empty
    list otherwise.

    Args:
        name: what the caller's messages call the inertia, such as "body2.inertia".
        mass: of the body [kg].
        inertia: about its centre of mass [kg m^2]; shape (3, 3).
        lever: the longest distance between its points that are named [m]; 0 says nothing.

    >>> inertia_suspicions("body2.inertia", 2.0, 1e5 * np.eye(3), 0.5)
    ['body2.inertia: its radius of gyration is 224 m, beside levers of 0.5 m: is it in kg m^2?']
    """
    radius = float(np.sqrt(np.linalg.eigvalsh(inertia)[-1] / mass)) if mass > 0 else 0.0
    if not lever or radius <= _MAX_UNSUSPICIOUS_GYRATION_RADIUS_TO_LEVER_RATIO * lever:
        return []
    return [f"{name}: its radius of gyration is {radius:.3g} m, beside levers of {lever:.3g} m: is it in kg m^2?"]
