"""The truth of a pair, computed once for all backends that are held against it, and the limits of errors."""

from __future__ import annotations

import functools

import mpmath
import numpy as np

from hingepair.bench import truth
from hingepair.bench.truth import DIGITS, exactly, given_motion, rotation, unit
from support.exact_robot import required

BOUNDS = {
    "S1": 6, "S2": 13, "d": 10, "R2": 10, "omega1": 4, "omega2": 6, "v2": 10, "alpha1": 4, "alpha2": 8, "a2": 12,
}  # fmt: skip
"""What all keep to that are not searched for; what is proved is more (`pair.accuracy`)."""
ORDINARY = BOUNDS | {"S2": 12, "d": 8, "R2": 8, "omega1": 3, "omega2": 3, "v2": 6, "alpha2": 4, "a2": 6}
"""What random states keep to, thousands of them, and hard ones."""


def remembered(function):
    """The same for the same numbers."""
    known = {}

    def key_of(value):
        if isinstance(value, tuple | list):
            return tuple(map(key_of, value))
        if isinstance(value, np.ndarray):
            numbers = tuple(x._mpf_ for x in value.flat) if value.dtype == object else value.tobytes()
            return value.shape, value.dtype.str, numbers
        return value

    @functools.wraps(function)
    def remembering(*arguments, **options):
        key = key_of((arguments, tuple(options.items())))
        if key not in known:
            known[key] = function(*arguments, **options)
        return known[key]

    return remembering


from_euler = remembered(truth.from_euler)


@remembered
def forces_from_attitude(pair, bodies, body1, psi, psid, psidd, gravity):
    """Return what must act: force1, torque1 about R1, (N, 3), and hinge_torque, (N,).

    Args:
        pair: the pair.
        bodies: of both, mass, centre of mass and inertia about it, body axes.
        body1: as in `from_attitude`; psi and its rates likewise.
        psi: hinge angle.
        psid: hinge rate.
        psidd: hinge acceleration.
        gravity: (3,).
    """
    with mpmath.workdps(DIGITS):
        R1, S1 = given_motion(body1)
        u1, u2 = (exactly(u)[..., None] for u in pair[:2])
        S2 = S1 @ rotation(unit(pair[2]), (exactly(psi), exactly(psid), exactly(psidd) / 2))
        if pair[3] is not None:
            S2 = S2 @ exactly(pair[3])
        hinge = R1 + S1 @ u1
        poses = (R1, S1), (hinge - S2 @ u2, S2)
        acting = [required(*pose, body, exactly(gravity)) for pose, body in zip(poses, bodies, strict=True)]
        (force1, *_), (force2, *_) = acting
        torque1 = sum(t + np.cross(x - R1.c0[..., 0], f) for f, t, x in acting)
        force, torque, centre = acting[1]
        moment = torque + np.cross(centre - hinge.c0[..., 0], force)
        axis = (S1 @ unit(pair[2])[..., None]).c0[..., 0]
        return force1 + force2, np.asarray(torque1), (axis * moment).sum(axis=-1)


def largest_errors(got, exact, axes):
    """Return the largest error of a component of each sample, as floats; a sample has `axes` axes."""
    with mpmath.workdps(DIGITS):
        gap = np.abs(np.asarray(got).astype(object) - exact).reshape(*np.shape(exact)[: np.ndim(exact) - axes], -1)
        return np.asarray(gap.max(axis=-1).astype(float))
