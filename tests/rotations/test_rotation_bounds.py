"""The bounds that the rotation functions state, through every branch; in units of u, against extended precision."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.rotations.sequences import SEQUENCE_NAMES
from support import extended
from support.sparse import sparse
from support.states import generator

U = 2.0**-53
COUNT = 2000
ZERO = np.zeros(3)


def off(found, truth):
    """The largest error of each sample, in units of u."""
    return (abs(np.asarray(found, extended.LONG) - truth).reshape(len(found), -1).max(axis=-1) / U).astype(float)


def rotvecs(rng, shortest=-12.0):
    """Rotation vectors of lengths log-spaced up to pi, around pi and around where series would switch."""
    length = np.logspace(shortest, np.log10(np.pi), COUNT)
    length[:300] = np.pi - 10.0 ** rng.uniform(-15, -1, 300)
    length[300:600] = 10.0 ** rng.uniform(-9, -3, 300)
    axis = rng.normal(size=(COUNT, 3)) * (rng.random((COUNT, 3)) < 0.8)
    axis[~axis.any(axis=-1)] = 1.0
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    return axis * np.minimum(length, np.pi)[:, None]


@pytest.mark.parametrize("psi", [1e-160, 1e-12, 1e-9, 1e-8, 1e-6, 1e-3, 0.1])
def test_small_turn_keeps_its_digits(psi):
    """Sh - I, component by component, relatively: 1 - cos psi would have no digit left at 1e-9."""
    axis = np.array([1.0, 1.0, 0.0])
    Sh = hp.rodrigues(axis, psi)
    with mpmath.workdps(2 * 160 + 60):
        half = mpmath.sin(mpmath.mpf(psi) / 2) ** 2
        sine = mpmath.sin(mpmath.mpf(psi)) / mpmath.sqrt(2)
        expected = {(0, 1): half, (1, 0): half, (0, 2): sine, (2, 0): -sine, (1, 2): -sine, (2, 1): sine}
        for place, value in expected.items():
            floor = mpmath.mpf(2) ** -1074  # 1 - cos 1e-160 is subnormal
            assert abs(mpmath.mpf(float(Sh[place])) - value) <= 6 * mpmath.mpf(2) ** -53 * abs(value) + floor, place


def test_rotation_exp():
    rotvec = rotvecs(generator(60))
    assert off(hp.rotation_exp(rotvec), extended.attitude_of_rotvec(rotvec)).max() <= 6


def test_rotation_exp_of_long_vectors():
    rng = generator(61)
    rotvec = rng.normal(size=(COUNT, 3)) * 10.0 ** rng.uniform(0, 3, (COUNT, 1))
    rotvec[0] = -5.8179657166846575, 1.1424925892435627, 7.743639087270632  # 7.7 u with the axis in one double
    rotvec[1] = 367.9465755673078, 476.1173971353937, -261.73459915028883  # the worst of 26 million: 4.35 u
    assert off(hp.rotation_exp(rotvec), extended.attitude_of_rotvec(rotvec)).max() <= 6


@pytest.mark.parametrize("shortest", [-300.0, -12.0])
def test_rotation_log_of_exp(shortest):
    """Relative to the angle, near 0 and near pi too; at pi either sign of the axis is right."""
    rotvec = rotvecs(generator(62), shortest)
    angle = np.hypot.reduce(rotvec, axis=-1)
    back = hp.rotation_log(hp.rotation_exp(rotvec))
    gap = np.minimum(off(back, rotvec), np.where(angle > np.pi - 32 * U, off(-back, rotvec), np.inf))
    assert np.all(gap <= 6 * angle)


def test_rotation_log_of_rounded_rotations():
    """Of the matrix next to the exact one: what any other program hands over."""
    rotvec = rotvecs(generator(63))
    angle = np.hypot.reduce(rotvec, axis=-1)
    back = hp.rotation_log(extended.attitude_of_rotvec(rotvec).astype(float))
    gap = np.minimum(off(back, rotvec), np.where(angle > np.pi - 32 * U, off(-back, rotvec), np.inf))
    assert np.all(gap <= 6 * angle)


def test_half_turns_and_the_identity():
    for S in (np.eye(3), np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, 1.0, -1.0]), np.diag([-1.0, -1.0, 1.0])):
        rotvec = hp.rotation_log(S)
        assert np.linalg.norm(rotvec) in (0.0, np.pi)
        assert abs(hp.rotation_exp(rotvec) - S).max() <= 6 * U


@pytest.mark.parametrize("scale", [1e-300, 1e-170, 1.0, 1e170, 1e300], ids=str)
def test_quaternions_of_any_length(scale):
    quat = generator(64).normal(size=(COUNT, 4))
    quat[:100] *= 10.0 ** generator(65).uniform(-12, 0, (100, 4))
    truth = extended.attitude_of_quaternion(quat)
    xyzw = hp.BodyMotion.from_quaternion_xyzw(R=ZERO, quat_xyzw=quat * scale).S
    wxyz = hp.BodyMotion.from_quaternion_wxyz(R=ZERO, quat_wxyz=np.roll(quat * scale, 1, axis=-1)).S
    assert off(xyzw, truth).max() <= 6
    assert np.array_equal(xyzw, wxyz)


def around_lock(rng, sequence):
    """Angles of which half are within 0.1 to 1e-300 of gimbal lock, some at it, and some multiples of pi/2."""
    proper = sequence[0] == sequence[2]
    phi = rng.uniform(-np.pi, np.pi, (COUNT, 3))
    lock = rng.choice([0.0, np.pi] if proper else [np.pi / 2, -np.pi / 2], COUNT)
    near = COUNT // 2
    phi[:near, 1] = lock[:near] + rng.choice([-1, 1], near) * 10.0 ** rng.uniform(-18, -1, near)
    phi[:200, 1] = lock[:200]
    if proper:
        phi[200:300, 1] = 10.0 ** rng.uniform(-300, -18, 100)
    phi[300:500, ::2] = np.pi / 2 * rng.integers(-2, 3, (200, 2))
    return phi


@pytest.mark.parametrize("sequence", sparse(SEQUENCE_NAMES, 8))
def test_euler_angles_give_the_attitude_back(sequence):
    """S(euler(S)) to 6 u, at lock too: the angles that come back are a representative, whatever the outer two are."""
    phi = around_lock(generator(66), sequence)
    exact = extended.attitude_of_angles(phi, sequence)
    assert off(hp.euler_to_matrix(phi, sequence), exact).max() <= 6
    S = exact.astype(float)
    back = hp.matrix_to_euler(S, sequence)
    assert off(extended.attitude_of_angles(back, sequence), S).max() <= 6
    assert off(hp.euler_to_matrix(back, sequence), S).max() <= 6


LOCK = {
    np.float64: (1e-12, (0.3, 1e-3, 1e-9, 4e-12, 2e-13, 1e-14, 0.0)),
    np.float32: (5e-4, (0.3, 1e-2, 2e-3, 6e-4, 4e-4, 1e-5, 0.0)),
}


@pytest.mark.slow
@pytest.mark.parametrize("dtype", LOCK)
def test_lock_is_told(dtype):
    """Where euler_rates refuses angles."""
    for sequence in SEQUENCE_NAMES:
        check_lock(sequence, dtype)


def check_lock(sequence, dtype):
    proper = sequence[0] == sequence[2]
    limit, gaps = LOCK[dtype][0], np.array(LOCK[dtype][1])
    phi = np.stack([0.4 + 0 * gaps, (0.0 if proper else np.pi / 2) + gaps, 0 * gaps - 0.7], axis=-1)
    S, phi = extended.attitude_of_angles(phi, sequence).astype(dtype), phi.astype(dtype)
    assert np.isfinite(hp.matrix_to_euler(S, sequence)).all()
    for angles, lock in zip(phi, gaps < limit, strict=True):
        if lock:
            with pytest.raises(hp.errors.GimbalLockError):
                hp.euler_rates(angles, ZERO.astype(dtype), sequence)
        else:
            hp.euler_rates(angles, ZERO.astype(dtype), sequence)


@pytest.mark.slow
def test_projection():
    rng = generator(67)
    S = extended.attitude_of_quaternion(rng.normal(size=(COUNT, 4))).astype(float)
    for noise, bound in ((1e-15, 6), (1e-7, 6), (1e-2, 6), (0.15, 24)):
        M = S + noise * rng.normal(size=S.shape)
        assert off(hp.project_to_rotation(M), extended.nearest_rotation(M)).max() <= bound
        assert off(hp.project_to_rotation(M * 1e200), extended.nearest_rotation(M)).max() <= bound
    hp.BodyMotion(R=ZERO, S=hp.project_to_rotation(S + 1e-3 * rng.normal(size=S.shape)))
