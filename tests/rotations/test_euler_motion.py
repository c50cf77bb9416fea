"""Euler kinematics of all 24 sequences against series of 60 digits, near gimbal lock too."""

from __future__ import annotations

import functools
import math

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS, angular_motion, exactly, rotation
from hingepair.rotations.sequences import SEQUENCE_NAMES
from support.states import generator

U = 2.0**-53
COUNT = 12
EACH = [  # of every kind; test_rotation_laws.py has all 24
    "XYZ", "zxz", "yxz", *(pytest.param(name, marks=pytest.mark.slow) for name in ("ZYX", "YXY", "xyz")),
]  # fmt: skip
STEP = 1e-20


def truth(phi, sequence):
    """J, column by column: the angular velocity of the series of S when one angle moves at unit rate."""
    columns = []
    for moving in range(3):
        turns = [
            rotation(
                exactly(np.eye(3)["XYZ".index(k.upper())]),
                (phi[:, i], exactly(np.full(len(phi), i == moving)), 0 * phi[:, i]),
            )
            for i, k in enumerate(sequence)
        ]
        S = functools.reduce(lambda a, b: a @ b, turns if sequence.isupper() else turns[::-1])
        columns.append(angular_motion(S)[0])
    return np.stack(columns, axis=-1)


def angles(proper, *key):
    rng = generator(110, *key)
    phi, phid = rng.uniform(-math.pi, math.pi, (COUNT, 3)), rng.normal(size=(COUNT, 3))
    lock = 0.0 if proper else math.pi / 2
    away = np.array([1e-9, -1e-9, 1e-6, -1e-3, 0.1, 0.5])
    phi[:6, 1] = lock + away
    phi[6:9, 1] = math.pi + lock + away[3:]
    return phi, phid


@pytest.mark.slow
@pytest.mark.parametrize("sequence", EACH)
def test_matrices_are_exact(sequence):
    phi, phid = angles(sequence[0] == sequence[2], SEQUENCE_NAMES.index(sequence))
    found = hp.euler_kinematics(phi, phid, sequence)
    with mpmath.workdps(DIGITS):
        exact = exactly(phi)
        J = truth(exact, sequence)
        h = exactly(phid) * mpmath.mpf(STEP)
        J_dot = (truth(exact + h, sequence) - truth(exact - h, sequence)) / (2 * mpmath.mpf(STEP))
        inverse = [np.array(mpmath.inverse(mpmath.matrix(m.tolist())).tolist()) for m in J]
    assert abs(found.J - J.astype(float)).max() <= 4 * U
    assert np.array_equal(found.J, hp.euler_rate_matrix(phi, sequence))
    W = abs(phid).sum(axis=-1)
    assert np.all(abs(found.J_dot - J_dot.astype(float)).max(axis=(-2, -1)) <= 6 * U * W)
    gap = abs(found.J_inverse - np.array(inverse).astype(float)).max(axis=(-2, -1))
    assert np.all(gap <= 8 * U * found.condition)


@pytest.mark.slow
@pytest.mark.parametrize("sequence", EACH)
def test_condition_and_distance_are_relatively_exact_near_lock(sequence):
    """From the singular values in 60 digits; NumPy's own condition number loses all digits there."""
    phi, _ = angles(sequence[0] == sequence[2], 1)
    found = hp.euler_kinematics(phi, sequence=sequence)
    assert found.J_dot is None
    with mpmath.workdps(DIGITS):
        for i, J in enumerate(truth(exactly(phi), sequence)):
            sizes = mpmath.svd_r(mpmath.matrix(J.tolist()), compute_uv=False)
            assert abs(found.condition[i] / (max(sizes) / min(sizes)) - 1) <= 8 * U
            first = 0 if sequence[0] == sequence[2] else mpmath.pi / 2
            off = (mpmath.mpf(phi[i, 1]) - first) / mpmath.pi
            distance = abs(off - mpmath.nint(off)) * mpmath.pi
            assert abs(found.lock_distance[i] / distance - 1) <= 4 * U


def test_at_lock_the_inverse_is_missing_and_the_neighbours_are_not():
    found = hp.euler_kinematics([(0.1, math.pi / 2, 0.2), (0.1, 0.2, 0.3), (0.1, math.nan, 0.3)])
    assert np.isnan(found.J_inverse[0]).all()
    assert found.condition[0] > 1e16
    assert found.lock_distance[0] < 1e-16
    assert np.isfinite(found.J_inverse[1]).all()
    assert np.isnan(found.condition[2])
    proper = hp.euler_kinematics((0.1, 0.0, 0.2), sequence="ZXZ")
    assert (proper.condition, proper.lock_distance) == (math.inf, 0.0)
    assert np.isnan(proper.J_inverse).all()


@pytest.mark.slow
@pytest.mark.parametrize("sequence", ["XYZ", "zxz", "YXZ"])
def test_body2_moves_by_its_own_angles(sequence):
    """phi2' and phi2'' of body 2, taken from S2, omega2 and alpha2, give omega2 and alpha2 back."""
    pair = hp.HingePair(u1=(1, 0, 0), u2=(0, 1, 0), n=(1, 2, 3))
    q, qd, qdd = generator(111).normal(size=(3, 40, 7))
    state = pair.forward_kinematics(q, qd, qdd)
    phi2 = hp.matrix_to_euler(state.S2, sequence)
    phid2 = hp.euler_rates(phi2, state.omega2, sequence)
    body2 = hp.euler_kinematics(phi2, phid2, sequence)
    change = state.alpha2 - (body2.J_dot @ phid2[..., None])[..., 0]
    phidd2 = (body2.J_inverse @ change[..., None])[..., 0]
    other = np.concatenate([np.zeros((40, 3)), phi2, np.zeros((40, 1))], axis=-1)
    rates = [np.concatenate([np.zeros((40, 3)), x, np.zeros((40, 1))], axis=-1) for x in (phid2, phidd2)]
    names = ("S1", "omega1", "alpha1")
    again = pair.forward_kinematics(other, *rates, sequence=sequence, outputs=names)
    W = abs(phid2).sum(axis=-1)
    for name, scale in zip(names, (1 + 0 * W, W, W * W + abs(phidd2).sum(axis=-1)), strict=True):
        given = getattr(state, name.replace("1", "2"))
        gap = abs(getattr(again, name) - given).reshape(40, -1).max(axis=-1)
        assert np.all(gap <= 32 * U * scale * body2.condition), name


def test_shapes_dtypes_and_errors():
    phi = np.full((2, 1, 3), 0.25, np.float32)
    found = hp.euler_kinematics(phi, np.ones((4, 3), np.float32), "ZYX")
    assert (found.J_dot.shape, found.J.dtype, found.J_inverse.dtype) == ((2, 4, 3, 3), np.float32, np.float32)
    assert not found.condition.flags.writeable
    for arguments, message in (
        (((0, 0),), "phi: expected shape"),
        (((0, 0, 0), (1, 2)), "phid: expected shape"),
        (((0, 0, 0), np.zeros((2, 3)), "XXZ"), "sequence: expected one of"),
        ((np.zeros((2, 3)), np.zeros((3, 3))), "phid: expected leading shape"),
    ):
        with pytest.raises(hp.ArgumentError, match=message):
            hp.euler_kinematics(*arguments)
