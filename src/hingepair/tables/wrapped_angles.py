"""Angles that were brought into one turn: told from angles that truly jump, and freed of their jumps."""

from __future__ import annotations

import numpy as np

from hingepair.numeric.arrays import Float64Array


def is_wrapped(angles: Float64Array, turn: float = 2 * np.pi) -> bool:
    """Return whether samples of an angle were reduced to one turn, such as [-pi, pi): all lie within one turn, and
    some neighbours differ by nearly a whole turn.

    An angle that truly changes by more than half a turn from sample to sample soon leaves the turn, and is not called
    wrapped.

    Args:
        angles: samples of one angle along time; shape (N,). NaN is stepped over.
        turn: one turn in the unit of the angles: 2 pi, or 360 to find angles in degrees.

    >>> t = np.arange(40) / 10
    >>> is_wrapped(np.angle(np.exp(2j * t))), is_wrapped(2 * t), is_wrapped(50 * t)
    (True, False, False)
    """
    known = angles[np.isfinite(angles)]
    if known.size < 2:
        return False
    jumps = np.abs(np.diff(known))
    # Noise that was added after wrapping leaves one turn a little. Where an angle was wrapped, it truly turned by
    # less than a quarter, the other way.
    return bool(np.ptp(known) <= 1.05 * turn and jumps.max() >= 0.75 * turn)


def unwrap_if_wrapped(angles: Float64Array) -> Float64Array:
    """Return samples of an angle [rad] without their jumps if they were reduced to one turn, else as they are.

    Args:
        angles: shape (N,) rad. NaN is stepped over.
    """
    if not is_wrapped(angles):
        return angles
    continuous = angles.copy()
    known = np.isfinite(angles)
    continuous[known] = np.unwrap(angles[known])
    return continuous
