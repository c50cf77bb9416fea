"""The hinge from gyroscopes and accelerometers alone."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.recorded import HOME, N1, U1, U2

T = np.arange(1000) / 100
PAIR = hp.HingePair(u1=U1, u2=U2, n=N1, home=HOME)
N2 = HOME.T @ N1


def felt(moving: float = 1.0, hinge: float = 1.0, noise: float = 0.0, seed: int = 0) -> list[np.ndarray]:
    """omega1, f1, omega2, f2 in the axes of their bodies."""
    t, zero = T, np.zeros_like(T)
    parts = [
        (np.sin(t), np.cos(t), -np.sin(t)),
        (0.3 * np.cos(2 * t), -0.6 * np.sin(2 * t), -1.2 * np.cos(2 * t)),
        (zero, zero, zero),
        *(
            (
                moving * a * np.sin(w * t + p),
                moving * a * w * np.cos(w * t + p),
                -moving * a * w * w * np.sin(w * t + p),
            )
            for a, w, p in ((1.0, 1.3, 0.0), (0.6, 2.1, 1.0), (1.0, 0.9, 1.6))
        ),
        (hinge * np.sin(2.3 * t), hinge * 2.3 * np.cos(2.3 * t), -hinge * 5.29 * np.sin(2.3 * t)),
    ]
    q, qd, qdd = (np.stack(own, axis=-1) for own in zip(*parts, strict=True))
    state = PAIR.forward_kinematics(q, qd, qdd, outputs=("S1", "omega1", "a1", "S2", "omega2", "a2"))
    g = np.array([0, 0, -9.81])
    world = ((state.S1, state.omega1), (state.S1, state.a1 - g), (state.S2, state.omega2), (state.S2, state.a2 - g))
    rng = np.random.default_rng(seed)
    exact = [np.einsum("nji,nj->ni", S, v) for S, v in world]
    return [v + k * noise * rng.standard_normal(v.shape) for v, k in zip(exact, (1, 5, 1, 5), strict=True)]


def test_exact_rates_give_both_axes_and_the_sign_between_them() -> None:
    omega1, _, omega2, _ = felt()
    found = hp.fit_axis(omega1, omega2)
    assert found.ok
    assert np.abs(found.n1 - N1).max() < 1e-14
    assert np.abs(found.n2 - N2).max() < 1e-14
    assert hp.fit_axis(omega2, omega1).n1 @ (np.sign(N2[1]) * N2) == pytest.approx(1, abs=1e-14)


@pytest.mark.parametrize("moving", [1.0, 0.2])
def test_noisy_rates_give_them_within_what_is_told(moving: float) -> None:
    for seed in range(3):
        omega1, _, omega2, _ = felt(moving, noise=1e-2, seed=seed)
        found = hp.fit_axis(omega1, omega2)
        assert found.ok
        assert np.linalg.norm(found.n1 - N1) < 4 * np.sqrt(2) * found.std[0]
        assert np.linalg.norm(found.n2 - N2) < 4 * np.sqrt(2) * found.std[1]
        assert found.rms == pytest.approx(np.sqrt(2) * 1e-2, rel=0.1)


@pytest.mark.parametrize("noise", [0.0, 1e-2], ids=["exact", "noisy"])
def test_axes_that_are_not_shown_are_not_told(noise: float) -> None:
    omega1, _, omega2, _ = felt(moving=0.0, noise=noise)
    found = hp.fit_axis(omega1, omega2)
    assert not found.ok
    assert found.std[0] == np.inf
    assert "axis in body 1's axes" in found.findings[0]
    assert abs(found.n2 @ N2) == pytest.approx(1, abs=1e-5)  # it turns about nothing else
    omega1, _, omega2, _ = felt(hinge=0.0, noise=noise)
    assert (hp.fit_axis(omega1, omega2).std == np.inf).all()


def test_missing_rates_are_left_out() -> None:
    omega1, _, omega2, _ = felt()
    omega1[500:520] = np.nan
    omega2[700, 1] = np.nan
    assert np.abs(hp.fit_axis(omega1, omega2).n1 - N1).max() < 1e-14


def test_forces_give_the_point_closest_to_sensor_1() -> None:
    omega1, f1, omega2, f2 = felt()
    found = hp.fit_anchor(T + 1.7e9, omega1, f1, omega2, f2, N1, N2)
    slide = -(U1 @ N1)
    assert found.ok
    assert np.abs(found.u1 - (U1 + slide * N1)).max() < 1e-5  # stamps of 1.7e9 s are rounded to 2.4e-7 s
    assert np.abs(found.u2 - (U2 + slide * N2)).max() < 1e-5


def test_noisy_forces_give_it_within_what_is_told() -> None:
    omega1, f1, omega2, f2 = felt(noise=1e-2)
    found = hp.fit_anchor(T, omega1, f1, omega2, f2, N1, N2)
    slide = -(U1 @ N1)
    error = np.concatenate((found.u1 - U1 - slide * N1, found.u2 - U2 - slide * N2))
    assert (np.abs(error) < 4 * np.sqrt(np.diagonal(found.covariance)) + 1e-3).all()
    assert np.abs(error).max() < 5e-3
    bare = hp.fit_anchor(T, omega1, f1, omega2, f2)
    across = np.eye(3) - np.outer(N1, N1)
    assert np.abs(across @ (bare.u1 - U1)).max() < 5e-3
    assert bare.u1 @ N1 + bare.u2 @ N2 == pytest.approx(0, abs=2e-3)


def test_a_point_that_is_not_shown_is_not_told() -> None:
    omega1, f1, omega2, f2 = felt(hinge=0.0, noise=1e-2)
    found = hp.fit_anchor(T, omega1, f1, omega2, f2)
    assert not found.ok
    assert "The hinge point is not shown" in found.findings[0]


def test_what_cannot_be_used_is_named() -> None:
    omega1, f1, omega2, f2 = felt()
    with pytest.raises(hp.ShapeError, match="omega2_b2"):
        hp.fit_axis(omega1, omega2[1:])
    with pytest.raises(hp.FitError, match="omega1_b1"):
        hp.fit_axis(np.zeros((20, 3)), np.zeros((20, 3)))
    with pytest.raises(hp.ArgumentError, match="n2"):
        hp.fit_anchor(T, omega1, f1, omega2, f2, n1=N1)
    with pytest.raises(hp.FitError, match="finite samples"):
        hp.fit_anchor(T, omega1, np.nan * f1, omega2, f2)
    with pytest.raises(hp.ShapeError, match="as t"):
        hp.fit_anchor(T[1:], omega1, f1, omega2, f2)
