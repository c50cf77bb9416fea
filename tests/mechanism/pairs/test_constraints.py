"""Gap, tilt, hinge angle and their derivatives of any two motions, against Taylor series of 60 digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS, Series, exactly, nearest_rotation, skew, unit
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
