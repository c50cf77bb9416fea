"""A second oracle, for millions of states: the definitions of `reference` in the processor's 64-bit-mantissa floats.

Eleven bits more than a double: errors in units of 2^-53 come out to about 0.02, thousands of times as fast as with 60
digits. The test of this oracle is the other one.
"""

from __future__ import annotations

import numpy as np

from support.reference import Series, euler_scales, skew

LONG = np.longdouble
WIDE = np.finfo(LONG).nmant >= 63
_AXES = dict(zip("XYZ", np.eye(3, dtype=LONG), strict=True))


class Extended:
    """The outputs by name, (N, ...) arrays of longdouble, and their scales."""

    def __init__(self, values, scales):
        self.values, self.scales = values, scales

    def errors(self, name, got):
        """The largest component's error of each sample in units of u * scale; inf where got is not finite."""
        unit = 2.0**-24 if got.dtype == np.float32 else 2.0**-53
        gap = abs(np.asarray(got, LONG) - self.values[name]).reshape(len(got), -1).max(axis=-1)
        scale = unit * np.asarray(self.scales[name], LONG)
        ratio = np.where(gap == 0, 0, gap / np.where(scale > 0, scale, np.finfo(LONG).tiny))
        return np.where(np.isfinite(ratio), ratio, np.inf).astype(float)


def from_euler(pair, q, qd, qdd, sequence="XYZ"):
    """The outputs for coordinates of shape (N, 7); pair = (u1, u2, n, home), each of one pair or of N."""
    Q, QD, QDD = (np.asarray(c, LONG) for c in (q, qd, qdd))
    series = [(Q[:, i], QD[:, i], QDD[:, i] / 2) for i in range(7)]
    turns = [rotation(_AXES[letter.upper()], series[3 + i]) for i, letter in enumerate(sequence)]
    letters = range(3) if sequence.isupper() else range(2, -1, -1)
    S1, turning = None, Series(0, 0, 0)
    for i in letters:
        turning += _rate(S1, _AXES[sequence[i].upper()], series[3 + i])
        S1 = turns[i] if S1 is None else S1 @ turns[i]
    u1, u2, n, home = (None if c is None else np.asarray(c, LONG) for c in pair)
    n = n / np.sqrt((n * n).sum(axis=-1, keepdims=True))
    S2 = S1 @ rotation(n, series[6])
    if home is not None:
        S2 = S2 @ home
    u1, u2 = (np.broadcast_to(u, (len(Q), 3))[..., None] for u in (u1, u2))
    d = S1 @ u1 - S2 @ u2
    turning2 = turning + _rate(S1, n, series[6])
    (omega1, alpha1), (omega2, alpha2) = ((c.c0[..., 0], c.c1[..., 0]) for c in (turning, turning2))
    values = {
        "S1": S1.c0, "S2": S2.c0, "omega1": omega1, "alpha1": alpha1, "omega2": omega2, "alpha2": alpha2,
        "d": d.c0[..., 0], "R2": Q[:, :3] + d.c0[..., 0], "v2": QD[:, :3] + d.c1[..., 0],
        "a2": QDD[:, :3] + 2 * d.c2[..., 0],
    }  # fmt: skip
    return Extended(values, euler_scales(pair, *(np.asarray(c, float) for c in (q, qd, qdd))))


def _rate(S, axis, angle):
    """The angular velocity of a turn about an axis of the frame S: S e angle', as a series."""
    _, f1, f2 = angle
    column = np.broadcast_to(axis, (len(f1), 3))[..., None]
    spin = Series(column * f1[:, None, None], column * 2 * f2[:, None, None], 0 * column)
    return spin if S is None else S @ spin


def rotation(axis, angle):
    """I + sin K + (1 - cos) K^2 of an angle that is a series."""
    f0, f1, f2 = angle
    s, c, half = np.sin(f0), np.cos(f0), np.sin(f0 / 2)
    sine = (s, c * f1, c * f2 - s * f1 * f1 / 2)
    versine = (2 * half * half, s * f1, s * f2 + c * f1 * f1 / 2)
    K = skew(axis)
    terms = [x[:, None, None] * K + y[:, None, None] * (K @ K) for x, y in zip(sine, versine, strict=True)]
    return Series(terms[0] + np.eye(3, dtype=LONG), terms[1], terms[2])


def attitude_of_angles(phi, sequence):
    """The rotations of Euler angles, (N, 3) -> (N, 3, 3)."""
    still = np.zeros(len(phi), LONG)
    turns = [
        rotation(_AXES[a.upper()], (np.asarray(phi[:, i], LONG), still, still)).c0 for i, a in enumerate(sequence)
    ]
    first, second, third = turns if sequence.isupper() else reversed(turns)
    return first @ second @ third


def attitude_of_rotvec(rotvec):
    """The rotations of rotation vectors, (N, 3) -> (N, 3, 3)."""
    vector = np.asarray(rotvec, LONG)
    angle = np.sqrt((vector * vector).sum(axis=-1))
    axis = vector / np.where(angle > 0, angle, 1)[:, None]
    return rotation(axis, (angle, 0 * angle, 0 * angle)).c0


def attitude_of_quaternion(quat_xyzw):
    """The rotations of quaternions: w^2 - v.v + 2 v v^T + 2 w [v]x, of the unit one."""
    quat = np.asarray(quat_xyzw, LONG)
    quat = quat / np.sqrt((quat * quat).sum(axis=-1, keepdims=True))
    v, w = quat[:, :3], quat[:, 3][:, None, None]
    square = (v * v).sum(axis=-1)[:, None, None]
    return (w * w - square) * np.eye(3, dtype=LONG) + 2 * v[:, :, None] * v[:, None, :] + 2 * w * skew(v)


def nearest_rotation(matrix):
    """The orthogonal polar factor: Newton's steps X -> (X + X^-T) / 2, X^-T by cofactors."""
    X = np.asarray(matrix, LONG)
    for _ in range(30):
        a, b, c = X[:, 0], X[:, 1], X[:, 2]
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
        X = (X + cofactors / (a * cofactors[:, 0]).sum(axis=-1)[:, None, None]) / 2
    return X
