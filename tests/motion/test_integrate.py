"""Integration (E12): orders, accuracy, and that the ways to say the same thing agree."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS
from hingepair.engine.backend import Execution
from hingepair.motion.magnus import CHUNK, multiply_rotations
from hingepair.motion.trajectory import unwrap_euler_angles
from support.sparse import sparse
from support.spins import REFERENCE, SPINS, TURNED, U
from support.states import generator, rotations

PAIR = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5), home=rotations(generator(120), 1)[0])
BACKENDS = ("numpy", "compiled")
spins = pytest.mark.parametrize("spin", SPINS.values(), ids=SPINS)
backends = pytest.mark.parametrize("backend", BACKENDS)


def instants(stop, h):
    return np.linspace(0, stop, round(stop / h) + 1)


def attitudes(spin, t, **options):
    return hp.integrate(PAIR, t, spin.omega, 1.0, S1_0=spin.S1_0, outputs=(), **options)


@spins
def test_error_falls_with_the_sixth_power_of_the_step(spin):
    """A wrong sign or weight of any commutator costs an order."""
    errors = []
    for step in (0.05, 0.025):
        t = instants(1.0, step)
        errors.append(spin.error(t, attitudes(spin, t).S1))
    assert math.log2(errors[0] / errors[1]) == pytest.approx(6, abs=0.2)  # the order, of steps that are not 0


@spins
@pytest.mark.parametrize(("h", "bound"), [(0.01, 2e-11), (0.002, 3e-14)])
def test_promised_accuracy(spin, h, bound):
    t = instants(10.0, h)
    assert spin.error(t, attitudes(spin, t).S1) <= bound


def test_samples_whose_instants_are_milliseconds_are_warned_of():
    """A slow motion that is sampled each second is not; the same with its instants in milliseconds is."""
    t, still = np.arange(50.0), np.zeros(50)
    for omega, psid in ((np.tile((0, 0, 0.01), (50, 1)), still), (np.zeros((50, 3)), still + 0.01)):
        hp.integrate(PAIR, t, omega, psid)
        with pytest.warns(hp.MeasurementWarning, match="^t steps by 1e[+]03 s: is it in seconds"):
            hp.integrate(PAIR, 1e3 * t, omega, psid)
    hp.integrate(PAIR, 1e3 * t, (0, 0, 0.01), 0.01)


def test_body_axes_are_world_axes_turned():
    """S' = [omega]x S and S' = S [S^T omega]x are one motion, of the same accuracy."""
    t = instants(0.9, 0.01)
    options = {"S1_0": TURNED.S1_0, "frame": "body", "outputs": ("omega1",)}
    motion = hp.integrate(PAIR, t, TURNED.body_omega, 1.0, **options)
    error = TURNED.error(t, motion.S1)
    assert error <= 2e-11  # rad: the promise, as above
    assert error / 10 <= motion.error_estimate <= 10 * error
    np.testing.assert_allclose(motion.omega1, TURNED.omega(t), rtol=0, atol=20 * error)
    tol = 1e-10
    sharp = hp.integrate(PAIR, t[::10], TURNED.body_omega, 1.0, tol=tol, **options)
    assert TURNED.error(t[::10], sharp.S1) <= tol


@pytest.mark.parametrize("backend", sparse(["numpy", "compiled"], 2))
@pytest.mark.parametrize(("size", "bound"), [(1.0, 100), (1e-2, 8)])
def test_the_tree_is_the_product_in_order(size, bound, backend):
    """All products of the first factors against one multiplication after the other, in the order of time.

    Of small rotations the rounding is as small, but for that of the few products that make large ones of them.
    """
    factors = generator(121).normal(size=(4, 8229))
    factors[1:] *= size
    factors[0] += 1 / size
    factors /= np.sqrt((factors**2).sum(axis=0))
    rows = factors.T.copy()
    multiply_rotations(rows, Execution(backend, 1))
    product = np.array([1.0, 0, 0, 0], dtype=np.longdouble)
    for k, factor in enumerate(factors.T):
        product = _times(factor.astype(np.longdouble), product)
        product /= np.sqrt((product**2).sum())
        assert np.abs(product - rows[k]).max() <= bound * U


def _times(p, q):
    a, b, c, d = p
    w, x, y, z = q
    return np.array([
        a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y, a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    ])  # fmt: skip


@backends
def test_psi_is_a_compensated_sum(backend):
    """Psi = t + 0.3 sin t to 2u of psi, over several slabs."""
    t = np.linspace(0, 50, 2 * CHUNK + 5)
    motion = hp.integrate(PAIR, t, 0 * t[:3], lambda s: 1 + 0.3 * np.cos(s), psi_0=0.1, outputs=(), backend=backend)
    with mpmath.workdps(DIGITS):
        for i in np.linspace(0, len(t) - 1, 400).astype(int):
            exact = mpmath.mpf(0.1) + mpmath.mpf(t[i]) + mpmath.mpf(3) / 10 * mpmath.sin(mpmath.mpf(t[i]))
            assert abs(motion.psi[i] - exact) <= 1.1 * U * abs(exact)
    assert motion.psi_error_estimate <= 2 * U * 50


@backends
def test_attitudes_are_rotations_to_4u(backend):
    t = np.linspace(0, 10, CHUNK + 100)
    S = attitudes(TURNED, t, backend=backend).S1.astype(np.longdouble)
    gap = np.abs(np.einsum("nji,njk->nik", S, S) - np.eye(3))
    assert gap.max() <= 4 * U


def test_state_is_that_of_the_coordinates():
    """Everything about body 2 as forward_kinematics has it from Euler angles."""
    t = instants(1.5, 0.005)
    full = PAIR.forward_kinematics(
        (3 * t, t**2, 1.0, 3 * t, t, 5 * t, np.sin(t)),
        (3.0, 2 * t, 0.0, 3.0, 1.0, 5.0, np.cos(t)),
        (0.0, 2.0, 0.0, 0.0, 0.0, 0.0, -np.sin(t)),
    )
    one = 1 + 0 * t
    R1 = np.stack([3 * t, t**2, one], -1), np.stack([3 * one, 2 * t, 0 * t], -1), np.array([0, 2.0, 0])
    motion = hp.integrate(PAIR, t, REFERENCE.omega, np.cos, R1=R1, alpha1=REFERENCE.alpha, psidd=lambda s: -np.sin(s))
    assert motion.state.outputs == ("R2", "S2", "d", "v2", "omega2", "a2", "alpha2")
    for name in motion.state.outputs:
        size = np.abs(getattr(full, name)).max()
        np.testing.assert_allclose(getattr(motion, name), getattr(full, name), rtol=0, atol=2**14 * U * (1 + size))


def test_euler_angles_stay_continuous_through_lock():
    """phi_y = t goes through pi/2 and on; matrix_to_euler alone would jump."""
    t = instants(10.0, 0.01)
    phi = unwrap_euler_angles(hp.matrix_to_euler(attitudes(REFERENCE, t).S1))
    np.testing.assert_allclose(phi, np.stack([3 * t, t, 5 * t], -1), rtol=0, atol=1e-7)  # rad: lock magnifies


def test_planar_pair_is_two_integrals():
    """phi_1 = int omega, phi_2 = int (omega + psi'), and the rest as PlanarPair has it (E11)."""
    pair = hp.PlanarPair(u1=(0.5, 0.2), u2=(-0.25, 0.1))
    t = instants(3.0, 0.01)
    rates = {"alpha1": lambda t: -np.sin(t), "psidd": np.cos}
    motion = hp.integrate(pair, t, np.cos, np.sin, R1=(1.0, 2.0), phi_0=0.5, psi_0=-1.0, **rates)
    np.testing.assert_allclose(motion.phi, 0.5 + np.sin(t), rtol=0, atol=3 * U)
    np.testing.assert_allclose(motion.psi, -np.cos(t), rtol=0, atol=3 * U)
    assert motion.error_estimate <= 4 * U
    q, qd = (1.0, 2.0, motion.phi, motion.psi), (0.0, 0.0, np.cos(t), np.sin(t))
    expected = pair.forward_kinematics(q, qd, (0.0, 0.0, -np.sin(t), np.cos(t)))
    assert motion.state.outputs == expected.outputs
    for name in expected.outputs:
        np.testing.assert_allclose(getattr(motion, name), getattr(expected, name), rtol=0, atol=8 * U)
    np.testing.assert_allclose(motion.S1, hp.rotation_exp(motion.phi[:, None] * [0, 0, 1]), rtol=0, atol=4 * U)
