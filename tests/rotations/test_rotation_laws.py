"""Rotations against SciPy's: quaternions in both orders, and all 24 Euler sequences there and back."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import hingepair as hp
from hingepair.rotations.sequences import SEQUENCE_NAMES
from support.states import generator, rotations

U = 2.0**-53


def test_the_nearest_rotation_is_the_orthogonal_factor_of_the_polar_decomposition():
    """M = S P with P symmetric and positive: S is the only rotation for which it is."""
    rng = generator(54)
    M = rotations(rng, 40) + 0.2 * rng.normal(size=(40, 3, 3))
    M *= 10 ** rng.uniform(-200, 200, (40, 1, 1))
    S = hp.project_to_rotation(M)
    assert abs(np.swapaxes(S, -1, -2) @ S - np.eye(3)).max() <= 8 * U
    assert (np.linalg.det(S) > 0).all()
    P = np.swapaxes(S, -1, -2) @ (M / abs(M).max(axis=(-2, -1), keepdims=True))
    assert abs(P - np.swapaxes(P, -1, -2)).max() <= 32 * U
    assert (np.linalg.eigvalsh(P) > 0).all()
    assert np.array_equal(hp.project_to_rotation(M[3]), S[3])
    M[5, 0, 1] = np.nan
    assert np.array_equal(np.isnan(hp.project_to_rotation(M)).any(axis=(-2, -1)), np.arange(40) == 5)
    flat = np.diag((1.0, 1.0, 0.0))
    for bad, count in (([flat, np.eye(3)], "1 of 2"), (-np.eye(3), "1 of 1"), (np.zeros((3, 3)), "1 of 1")):
        with pytest.raises(hp.RotationError, match=f"positive determinant, got {count} without"):
            hp.project_to_rotation(bad)


@pytest.fixture(params=range(4), ids=["turned, Tait-Bryan", "turned, proper", "fixed, Tait-Bryan", "fixed, proper"])
def sequences(request):
    """The six sequences of one kind."""
    lower, proper = divmod(request.param, 2)
    return [name for name in SEQUENCE_NAMES if name.islower() == lower and (name[0] == name[2]) == proper]


def test_angles_come_back(sequences):
    """Angles in the standard range come back themselves; at gimbal lock they give the same attitude."""
    for sequence in sequences:
        proper = sequence[0] == sequence[2]
        middle = (0.1, np.pi - 0.1) if proper else (0.1 - np.pi / 2, np.pi / 2 - 0.1)
        rng = generator(54)
        phi = rng.uniform(-np.pi, np.pi, (50, 3))
        phi[:, 1] = rng.uniform(*middle, 50)
        back = hp.matrix_to_euler(hp.euler_to_matrix(phi, sequence), sequence)
        assert abs(back - phi).max() <= 32 * U / 0.1
        expected = Rotation.from_matrix(hp.euler_to_matrix(phi, sequence)).as_euler(sequence)
        assert abs(back - expected).max() <= 64 * U / 0.1
        for lock in (0.0, np.pi) if proper else (np.pi / 2, -np.pi / 2):
            for off in (0.0, 1e-9, 1e-12, 1e-160):
                phi[:, 1] = lock - np.copysign(off, lock - 1e-9)
                S = hp.euler_to_matrix(phi, sequence)
                again = hp.euler_to_matrix(hp.matrix_to_euler(S, sequence), sequence)
                assert abs(again - S).max() <= 32 * U, (lock, off)


def test_a_projection_does_not_raise_what_numpy_is_told_to_raise():
    M = np.array([[1, 1e-320, 0], [0, 1, 0], [0, 0, 1]])
    with np.errstate(all="raise"):
        assert np.array_equal(hp.project_to_rotation(M).round(15), np.eye(3))
