"""Sentences about numbers that are probably in another unit than expected: milliseconds, degrees, millimetres.

A suspicion is no error: the numbers can be right. So nothing here raises; callers add the sentences to their notes,
findings or warnings. A quantity is an entry of `_QUANTITIES`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hingepair.numeric.arrays import Float64Array, row_norms

DEGREES_IN_SCENES: Final = '"deg({})"'
"""How degrees are written in a scene file, for messages."""

_FULL_TURN = 2 * np.pi  # [rad]


class _Doubt(NamedTuple):
    """When values of a quantity are suspicious, and the sentence on them."""

    size: Callable[[Float64Array], float]  # of finite values
    least: float  # suspicious size
    sentence: str  # format of {name}, {size}, {turns}, {largest} (with its sign) and {convert_...}
    most: float = np.inf  # suspicious size


def _median_step(t: Float64Array) -> float:
    """Return the median time step of a recording; NaN of fewer than nine instants, which tell nothing."""
    return float(np.median(np.diff(t))) if t.size > 8 else np.nan


def _median(values: Float64Array) -> float:
    return float(np.median(values)) if values.size else np.nan


def _span(values: Float64Array) -> float:
    return float(np.ptp(values)) if values.size else np.nan


def _turned(angles: Float64Array) -> float:
    """Return how far an angle turns in all if it never turns back (NaN unless by multiples of 45), else its span."""
    steps = np.diff(angles)
    if (steps < 0).any() and (steps > 0).any():
        return _span(angles)
    turn = abs(float(steps.sum()))  # a wheel, unless whole degrees
    return turn if min(turn % 45, -turn % 45) < 1e-9 * turn else np.nan


def _largest(values: Float64Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def _round(part: float) -> Callable[[Float64Array], float]:
    """Return a function that returns the largest size if all values are whole multiples of `part`, else NaN."""
    return lambda values: np.nan if np.mod(values, part).any() else _largest(values)


def _swing(rates: Float64Array) -> float:
    """Return the largest size of a rate that changes its sign, NaN of one that does not: a motor."""
    return _largest(rates) if rates.size and rates.min() < 0 < rates.max() else np.nan


_STEPS = "{name} steps by {size:.3g} s: is it in seconds? "
_SPAN = "rad, {turns:.3g} turns: is it in radians? "
_TAKEN = "{name}: {largest:g} is taken for "
_DEGREES = "degrees become radians by {convert_largest}."
_MILLIMETRES = "Millimetres become metres by the factor 1e-3."
_TWO_TURNS = 2.000001 * _FULL_TURN  # [rad]; two turns of a wheel are not suspicious
# How values are judged, by what they are.
_QUANTITIES: Final[Mapping[str, tuple[_Doubt, ...]]] = {
    # Sensors of motion take at least a sample a second and at most a million.
    "instants": (
        _Doubt(_median_step, 1.0, _STEPS + "Milliseconds become seconds by 1e-3 * {name}.", 500.0),
        _Doubt(_median_step, 500.0, _STEPS + "Microseconds become seconds by 1e-6 * {name}.", 5e5),
        _Doubt(_median_step, 5e5, _STEPS + "Nanoseconds become seconds by 1e-9 * {name}."),
        _Doubt(_median_step, np.finfo(float).tiny, _STEPS + "Days become seconds by 86400 * {name}.", 1e-6),
    ),
    # A recorded angle: more than two turns, and fewer than two if read as degrees. What spans more is a wheel.
    "angle": (
        _Doubt(
            _span,
            _TWO_TURNS,
            "{name} spans {size:.3g} " + _SPAN + "Degrees become radians by {convert_name}.",
            720.0,
        ),
    ),
    # An angle as a function that somebody wrote: as a recorded one, but one that never turns back may be a wheel.
    "turning": (
        _Doubt(_turned, _TWO_TURNS, "{name} turns by {size:.3g} " + _SPAN + "30 degrees are {convert_30}.", 720.0),
    ),
    # What somebody wrote: degrees are written in whole fives and rates in parts of a turn, radians hardly ever.
    "written angles": (_Doubt(_round(5.0), 10.0, _TAKEN + "radians, {turns:.3g} turns; " + _DEGREES, 36e3),),
    "assembled angles": (_Doubt(_largest, 10.0, _TAKEN + "radians, {turns:.3g} turns; " + _DEGREES),),
    "written rates": (_Doubt(_round(45.0), 45.0, _TAKEN + "rad/s, {turns:.3g} turns a second; " + _DEGREES),),
    "written lengths": (_Doubt(_largest, 50.0, _TAKEN + "metres. " + _MILLIMETRES),),
    # A rate as a function that somebody wrote: motors that turn one way may be fast.
    "rate": (_Doubt(_swing, 40.0, "{name} comes to {size:.3g} rad/s: is it in rad/s? 30 degrees are {convert_30}."),),
    # Usual gyroscopes end at 2000 degrees a second, 35 rad/s.
    "gyroscope": (
        _Doubt(
            lambda omega: _largest(row_norms(omega)),
            40.0,
            "{name} comes to {size:.3g} rad/s: is it in rad/s? Degrees a second become rad/s by {convert_name}.",
        ),
    ),
    # Of a slow sensor that counts in g.
    "accelerometer": (
        _Doubt(
            lambda force: _median(row_norms(force)),
            0.5,
            "{name} is of the size of {size:.2g} m/s^2: is it in m/s^2? Multiples of g become m/s^2 by "
            "9.80665 * {name}.",
            2.0,
        ),
    ),
    # Between the reference points of two bodies that share a hinge, and on one body.
    "distance": (_Doubt(_median, 50.0, "{name} is {size:.3g} m long: is it in metres? " + _MILLIMETRES),),
    # The first component of quaternions: 1 is half a turn about x, and no turn at all if it is the scalar.
    "quaternion x": (
        _Doubt(
            lambda x: _median(np.abs(x)),
            0.95,
            "{name} has a median size of {size:.2g}, half a turn about x: is it the scalar? The order is qx, qy, qz, "
            "qw.",
        ),
    ),
}


def suspicions(kind: str, name: str, values: ArrayLike, *, radians: str = "numpy.radians({})") -> list[str]:
    """Return a list with one sentence, which calls the data `name`, if values of a quantity are probably in another
    unit than that of hingepair, judged by their size; an empty list otherwise.

    Args:
        kind: the quantity, a key of `_QUANTITIES`.
        name: what the caller's messages call the values, such as "psi".
        values: in the unit of hingepair; samples along the first axis. Samples that are not finite are stepped over.
        radians: how degrees, {}, are written where the values stand: `DEGREES_IN_SCENES` in a scene.

    >>> suspicions("angle", "psi", [-90.0, 20.0, 90.0])
    ['psi spans 180 rad, 28.6 turns: is it in radians? Degrees become radians by numpy.radians(psi).']
    >>> suspicions("written angles", "stops", [-90, 90]), suspicions("written rates", "psid_0", 3.0)
    (['stops: 90 is taken for radians, 14.3 turns; degrees become radians by numpy.radians(90).'], [])
    """
    array = np.atleast_1d(np.asarray(values, dtype=np.float64))
    array = array[np.isfinite(array).all(axis=tuple(range(1, array.ndim)))]
    for measure, least, sentence, most in _QUANTITIES[kind]:
        with np.errstate(all="ignore"):
            size = measure(array)
        if least <= size <= most:
            largest = max(array.flat, key=lambda x: (abs(x), x))
            by_key = {"convert_largest": f"{largest:g}", "convert_name": name, "convert_30": "30"}
            converted = {key: radians.format(text) for key, text in by_key.items()}
            return [sentence.format(name=name, size=size, largest=largest, turns=size / _FULL_TURN, **converted)]
    return []
