"""Gap, tilt, hinge angle and their derivatives of any two motions, against Taylor series of 60 digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS, Series, exactly, nearest_rotation, skew, unit
from hingepair.validation.pinocchio_twin import to_pinocchio
from support.hinged import pair_of
from support.sparse import sparse
from support.states import body1 as random_body
from support.states import generator
from support.states import pair as random_pair

U = 2.0**-53
COUNT = 12


def motion(rng):
    R, S, v, omega, a, alpha = random_body(rng, COUNT)
    return hp.BodyMotion(R=R / 10, S=S, v=v, omega=omega, a=a, alpha=alpha)


def lever(pair):
    return 1 + np.linalg.norm(pair.u1) + np.linalg.norm(pair.u2)


def near(pair, rng, size):
    """Body 1, and a body 2 that is about so far from being hinged to it, in attitude, place and all rates."""
    body1 = motion(rng)
    psi, psid, psidd = rng.normal(size=(3, COUNT))
    s = pair.forward_kinematics_from_body1(body1, psi, psid, psidd)
    off = rng.normal(size=(6, COUNT, 3)) * size
    return body1, hp.BodyMotion(
        R=s.R2 + off[0],
        S=hp.rotation_exp(off[1]) @ s.S2,
        v=s.v2 + off[2],
        omega=s.omega2 + off[3],
        a=s.a2 + off[4],
        alpha=s.alpha2 + off[5],
    )


def series_of(body):
    """R and S as Taylor polynomials: S' = [omega]x S, S'' = ([alpha]x + [omega]x^2) S."""
    W = skew(exactly(body.omega))
    S = nearest_rotation(exactly(body.S))
    R = (exactly(part)[..., None] for part in (body.R, body.v, body.a / 2))
    return Series(*R), Series(S, W @ S, (skew(exactly(body.alpha)) + W @ W) @ S / 2)


def across(n):
    """The axis furthest from n made perpendicular to it, and n x that."""
    furthest = np.argmin(abs(n.astype(float)))
    e1 = unit(exactly(np.eye(3)[furthest]) - n * n[furthest])
    return e1, np.cross(n, e1)


def truth(constants, body1, body2):
    """(value, first, second derivative) of gap, tilt and psi."""
    u1, u2, n, home = constants
    with mpmath.workdps(DIGITS):
        n = unit(n)
        home = nearest_rotation(exactly(np.eye(3) if home is None else home))
        (R1, S1), (R2, S2) = series_of(body1), series_of(body2)
        gap = R1 + S1 @ exactly(u1)[:, None] - (R2 + S2 @ exactly(u2)[:, None])
        e1, e2 = across(n)
        frame = np.stack([e1, e2, n], axis=-1)
        transposed = Series(*(np.swapaxes(c, -1, -2) for c in (S1.c0, S1.c1, S1.c2)))
        turn = transposed @ S2 @ (home.T @ frame)
        turned = [frame.T @ c for c in (turn.c0, turn.c1, 2 * turn.c2)]
        tilt = [np.stack([-c[:, 1, 2], c[:, 0, 2]], axis=-1) for c in turned]
        (s, sd, sdd), (c, cd, cdd) = (
            [m[:, 1, 0] - m[:, 0, 1] for m in turned],
            [m[:, 0, 0] + m[:, 1, 1] for m in turned],
        )
        size = s * s + c * c
        psi = np.array([mpmath.atan2(y, x) for y, x in zip(s, c, strict=True)], dtype=object)
        psid = (c * sd - s * cd) / size
        psidd = (c * sdd - s * cdd - psid * 2 * (s * sd + c * cd)) / size
    gaps = [x[..., 0] for x in (gap.c0, gap.c1, 2 * gap.c2)]
    return {"gap": gaps, "tilt": tilt, "psi": [psi, psid, psidd]}


NAMES = {
    "gap": ("gap", "gap_rate", "gap_acceleration"),
    "tilt": ("tilt", "tilt_rate", "tilt_acceleration"),
    "psi": ("psi", "psid", "psidd"),
}


@pytest.mark.parametrize("size", [0.0, 1e-6, 0.1, 0.5])
@pytest.mark.parametrize("home", sparse([True, False], 2, lambda home: "home" if home else "no_home"))
def test_residuals_and_derivatives_are_exact_on_the_hinge_and_off_it(size, home):
    """A tilt of up to about one radian; the twist divides by 1 + h1 . h2."""
    rng = generator(80, home)
    constants = random_pair(rng, home)
    pair = pair_of(constants)
    body1, body2 = near(pair, rng, size)
    found = pair.residuals(body1, body2)
    W = np.linalg.norm(body1.omega, axis=-1) + np.linalg.norm(body2.omega, axis=-1)
    A = W * W + sum(np.linalg.norm(x, axis=-1) for b in (body1, body2) for x in (b.a, b.alpha, b.v, b.R)) + 1
    worth = 2 / (1 + np.cos(found.tilt_angle))
    for kind, values in truth(constants, body1, body2).items():
        for name, expected in zip(NAMES[kind], values, strict=True):
            error = abs(getattr(found, name) - expected.astype(float)).reshape(COUNT, -1).max(axis=-1)
            assert np.all(error <= 32 * U * A * lever(pair) * worth**2), name


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.0, 0.5])
def test_constraint_jacobian_and_bias_give_the_derivatives(size):
    """G @ velocities = (gap', tilt'), G @ accelerations + bias = (gap'', tilt'')."""
    rng = generator(81)
    constants = random_pair(rng)
    pair = pair_of(constants)
    body1, body2 = near(pair, rng, size)
    exact = truth(constants, body1, body2)
    G, bias = pair.constraint_jacobian(body1, body2), pair.constraint_bias(body1, body2)
    assert (G.shape, bias.shape) == ((COUNT, 5, 12), (COUNT, 5))
    rates = np.concatenate([body1.v, body1.omega, body2.v, body2.omega], axis=-1)
    changes = np.concatenate([body1.a, body1.alpha, body2.a, body2.alpha], axis=-1)
    W = np.linalg.norm(rates, axis=-1)
    for order, found, scale in (
        (1, G @ rates[..., None], W),
        (2, G @ changes[..., None] + bias[..., None], W * W + np.linalg.norm(changes, axis=-1)),
    ):
        expected = np.concatenate([exact["gap"][order], exact["tilt"][order]], axis=-1).astype(float)
        assert np.all(abs(found[..., 0] - expected).max(axis=-1) <= 32 * U * scale * lever(pair))


AXES = [(1, 0, 0), (0, 1, 0), (0, 0, -1), (1, 1, 1), (1, 1e-12, -1e-170), (1, -1, 0), (0.57735,) * 3, (1e-300,) * 3]


@pytest.mark.slow
@pytest.mark.parametrize("n", AXES, ids=str)
def test_the_constraints_allow_what_the_pair_does_and_nothing_else(n):
    """G (I; Jac) = 0, and G has rank 5 with turns of unit length: nothing of it depends on where n points."""
    rng = generator(82)
    pair = hp.HingePair(u1=rng.normal(size=3), u2=rng.normal(size=3), n=n, home=random_pair(rng)[3])
    body1, psi = motion(rng), rng.normal(size=COUNT)
    state = pair.forward_kinematics_from_body1(body1, psi)
    G = pair.constraint_jacobian(body1, hp.BodyMotion(R=state.R2, S=state.S2))
    allowed = np.concatenate([np.broadcast_to(np.eye(6, 7), (COUNT, 6, 7)), pair.jacobian(body1, psi)], axis=-2)
    assert abs(G @ allowed).max() <= 16 * U * lever(pair)
    turns = G[:, 3:, 9:]
    assert abs(turns @ np.swapaxes(turns, -1, -2) - np.eye(2)).max() <= 16 * U
    assert np.all(np.linalg.svd(G, compute_uv=False)[:, -1] >= 0.5)


@pytest.mark.slow
def test_forces_of_constraint_give_the_dynamics_of_pinocchio():
    """Two free bodies under gravity and the forces G^T lambda of G a + bias = 0 move as the articulated body does."""
    rng = generator(84)
    pair = pair_of(random_pair(rng))
    body1, (psi, psid) = motion(rng), rng.normal(size=(2, COUNT))
    s = pair.forward_kinematics_from_body1(body1, psi, psid)
    body2 = hp.BodyMotion(R=s.R2, S=s.S2, v=s.v2, omega=s.omega2)
    G, bias = pair.constraint_jacobian(body1, body2), pair.constraint_bias(body1, body2)
    masses, inertias = (2.0, 3.0), (np.diag((0.5, 0.75, 1.0)), np.diag((1.5, 1.25, 0.5)))
    twin = to_pinocchio(pair)
    model = twin.model
    model.appendBodyToJoint(1, pin.Inertia(masses[0], np.zeros(3), inertias[0]), pin.SE3.Identity())
    place = pin.SE3(np.array(pair.home), -(pair.home @ pair.u2))
    model.appendBodyToJoint(2, pin.Inertia(masses[1], np.zeros(3), inertias[1]), place)
    data, gravity = model.createData(), np.array((0, 0, -9.81))
    model.gravity.linear = gravity
    q, v = twin.configuration(body1, psi), twin.velocity(body1, psi, psid)
    for i in range(COUNT):
        M, force = np.zeros((12, 12)), np.zeros(12)
        for k, (body, m, inertia) in enumerate(zip((body1, body2), masses, inertias, strict=True)):
            turned = body.S[i] @ inertia @ body.S[i].T
            M[6 * k : 6 * k + 3, 6 * k : 6 * k + 3] = m * np.eye(3)
            M[6 * k + 3 : 6 * k + 6, 6 * k + 3 : 6 * k + 6] = turned
            force[6 * k : 6 * k + 6] = *(m * gravity), *-np.cross(body.omega[i], turned @ body.omega[i])
        system = np.block([[M, -G[i].T], [G[i], np.zeros((5, 5))]])
        found = np.linalg.solve(system, np.concatenate([force, -bias[i]]))[:6]
        other, *_ = twin.motion(q[i], v[i], pin.aba(model, data, q[i], v[i], np.zeros(7)))
        expected = np.concatenate([other.a, other.alpha])
        assert abs(found - expected).max() <= 8 * U * np.linalg.cond(system) * abs(expected).max()


@pytest.mark.slow
def test_pairs_of_their_own_and_other_dtypes():
    rng = generator(83)
    u1, n = rng.normal(size=(2, COUNT, 3))
    home = np.stack([random_pair(rng)[3] for _ in range(COUNT)])
    many = hp.HingePair(u1=u1, u2=(0.1, 0.2, 0.3), n=n, home=home)
    body1, body2 = near(many, rng, 0.3)
    G, bias, found = (f(body1, body2) for f in (many.constraint_jacobian, many.constraint_bias, many.residuals))
    for i in (0, COUNT - 1):
        one = hp.HingePair(u1=u1[i], u2=(0.1, 0.2, 0.3), n=n[i], home=home[i])
        own = [
            hp.BodyMotion(**{k: getattr(b, k)[i] for k in ("R", "S", "v", "omega", "a", "alpha")})
            for b in (body1, body2)
        ]
        assert abs(one.constraint_jacobian(*own) - G[i]).max() <= 8 * U * lever(one)
        assert abs(one.constraint_bias(*own) - bias[i]).max() <= 64 * U * lever(one) * 10
        assert abs(one.residuals(*own).psidd - found.psidd[i]) <= 64 * U * 100
    homes = hp.HingePair(u1=u1[0], u2=(0.1, 0.2, 0.3), n=n[0], home=home)
    assert np.array_equal(homes.constraint_jacobian(body1, body2)[0], G[0])
    single = hp.BodyMotion(R=np.zeros(3, np.float32), S=np.eye(3, dtype=np.float32), omega=np.ones(3, np.float32))
    assert many.constraint_jacobian(single, single).dtype == np.float32
    assert many.constraint_bias(single, single).shape == (COUNT, 5)
