"""Laws of the hinge pair on seeded random states; tolerances in units of u * scale (docs/concepts/accuracy.md)."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import OUTPUTS, euler_scales
from support.states import coordinates, generator, pair, rotations

U = 2.0**-53
COUNT = 60
KINDS = {
    "general": {},
    "no_home": {"home": None},
    "axis_x": {"n": np.array([1.0, 0.0, 0.0])},
    "axis_minus_y": {"n": np.array([0.0, -2.0, 0.0])},
    "u1_zero": {"u1": np.zeros(3)},
    "u2_zero": {"u2": np.zeros(3), "home": None},
}


class Case:
    """A pair, a motion, all outputs and their scales."""

    def __init__(self, kind):
        rng = generator(30, list(KINDS).index(kind))
        constants = dict(zip(("u1", "u2", "n", "home"), pair(rng), strict=True)) | KINDS[kind]
        self.constants, self.rng = constants, rng
        self.pair = hp.HingePair(**constants)
        self.motion = coordinates(rng, COUNT)
        self.scales = euler_scales(tuple(constants.values()), *self.motion)
        self.state = self.pair.forward_kinematics(*self.motion, outputs=OUTPUTS)
        self.n = constants["n"] / np.linalg.norm(constants["n"])
        self.home = np.eye(3) if constants["home"] is None else constants["home"]
        self.psi, self.psid, self.psidd = (c[:, 6] for c in self.motion)

    def body1(self):
        R1, v1, a1 = (c[:, :3] for c in self.motion)
        s = self.state
        return hp.BodyMotion(R=R1, S=s.S1, v=v1, omega=s.omega1, a=a1, alpha=s.alpha1)

    def require(self, name, got, expected, ulps):
        """Equal to so many u * scale of an output, sample by sample."""
        gap = abs(np.asarray(got) - np.asarray(expected)).reshape(COUNT, -1).max(axis=-1)
        assert np.all(gap <= ulps * U * self.scales[name]), (name, float((gap / (U * self.scales[name])).max()))


@pytest.fixture(scope="module", params=list(KINDS))
def case(request):
    return Case(request.param)


def turned(S, u):
    return (np.asarray(S) @ np.asarray(u)[..., None])[..., 0]


def test_hinge_point_is_shared(case):
    """E1 and E7, and d is what lies between the reference points."""
    s, R1 = case.state, case.motion[0][:, :3]
    r1, r2 = turned(s.S1, case.constants["u1"]), turned(s.S2, case.constants["u2"])
    case.require("d", s.d, r1 - r2, 12)
    case.require("R2", R1 + r1, s.R2 + r2, 16)
    case.require("R2", R1 + s.d, s.R2, 4)


def test_hinge_point_moves_as_one(case):
    """E8, E9: velocity and classical acceleration of the hinge point are the same on both bodies."""
    s, (_, v1, a1) = case.state, (c[:, :3] for c in case.motion)
    r1, r2 = turned(s.S1, case.constants["u1"]), turned(s.S2, case.constants["u2"])
    case.require("v2", v1 + np.cross(s.omega1, r1), s.v2 + np.cross(s.omega2, r2), 24)
    a = [np.cross(al, r) + np.cross(om, np.cross(om, r)) for om, al, r in zip(
        (s.omega1, s.omega2), (s.alpha1, s.alpha2), (r1, r2), strict=True)]  # fmt: skip
    case.require("a2", a1 + a[0], s.a2 + a[1], 24)


@pytest.mark.slow
def test_a_matrix_of_nine_digits_keeps_the_hinge_together(case):
    """What is given is a rotation to 1e-10 only: E1, E8 and E9 hold to round-off all the same."""
    S = case.body1().S + 1e-10 * case.rng.normal(size=(COUNT, 3, 3))
    body1 = hp.BodyMotion(S=S, **{name: getattr(case.body1(), name) for name in ("R", "v", "omega", "a", "alpha")})
    for backend in ("numpy", "compiled"):
        s = case.pair.forward_kinematics_from_body1(body1, case.psi, case.psid, case.psidd, backend=backend)
        r1, r2 = turned(S, case.constants["u1"]), turned(s.S2, case.constants["u2"])
        case.require("d", s.d, r1 - r2, 12)
        case.require("v2", body1.v + np.cross(body1.omega, r1), s.v2 + np.cross(s.omega2, r2), 24)
        a = [np.cross(al, r) + np.cross(om, np.cross(om, r)) for om, al, r in zip(
            (body1.omega, s.omega2), (body1.alpha, s.alpha2), (r1, r2), strict=True)]  # fmt: skip
        case.require("a2", body1.a + a[0], s.a2 + a[1], 32)


def test_bodies_turn_apart_about_the_hinge_axis_only(case):
    """E2, and the axis S1 n = S2 C^T n is fixed in both bodies."""
    s, axis = case.state, turned(case.state.S1, case.n)
    apart = s.omega2 - s.omega1
    case.require("omega2", np.cross(apart, axis), 0.0, 16)
    case.require("omega2", apart, axis * case.psid[:, None], 16)
    case.require("S2", turned(s.S2, case.home.T @ case.n), axis, 32)


def test_relative_attitude_is_the_hinge_rotation(case):
    """E5: S1^T S2 C^T turns about n by psi, right hand."""
    s = case.state
    Sh = np.swapaxes(s.S1, -1, -2) @ s.S2 @ case.home.T
    across = np.cross(case.n, np.roll(case.n, 1) + np.array([0.3, -0.2, 0.5]))
    across /= np.linalg.norm(across)
    moved = Sh @ across
    case.require("S2", moved @ across, np.cos(case.psi), 48)
    case.require("S2", moved @ np.cross(case.n, across), np.sin(case.psi), 48)


def test_turned_and_shifted_scene(case):
    """Turn and shift everything: body 2 turns and shifts along."""
    Q, b = rotations(case.rng, 1)[0], case.rng.normal(size=3)
    body1, s = case.body1(), case.state
    moved = hp.BodyMotion(
        R=body1.R @ Q.T + b, S=Q @ body1.S, v=body1.v @ Q.T, omega=body1.omega @ Q.T, a=body1.a @ Q.T,
        alpha=body1.alpha @ Q.T,
    )  # fmt: skip
    got = case.pair.forward_kinematics_from_body1(moved, case.psi, case.psid, case.psidd)
    case.require("S2", got.S2, Q @ s.S2, 48)
    size = 1 + abs(b).max() / np.abs(case.scales["R2"]).min()
    case.require("R2", got.R2, s.R2 @ Q.T + b, 48 * size)
    for name in ("d", "v2", "omega2", "a2", "alpha2"):
        case.require(name, getattr(got, name), getattr(s, name) @ Q.T, 48)


def test_bodies_swapped(case):
    """From body 2, with n' = -C^T n and C' = C^T, the same hinge leads back to body 1."""
    C, s = case.home, case.state
    back = hp.HingePair(u1=case.constants["u2"], u2=case.constants["u1"], n=-C.T @ case.constants["n"], home=C.T)
    body2 = hp.BodyMotion(R=s.R2, S=s.S2, v=s.v2, omega=s.omega2, a=s.a2, alpha=s.alpha2)
    got = back.forward_kinematics_from_body1(body2, case.psi, case.psid, case.psidd)
    body1 = case.body1()
    expected = {"R2": body1.R, "S2": body1.S, "v2": body1.v, "omega2": body1.omega, "a2": body1.a}
    for name, value in (expected | {"alpha2": body1.alpha, "d": -np.asarray(s.d)}).items():
        case.require(name, getattr(got, name), value, 64)


def test_axis_reversed(case):
    """About -n by -psi is about n by psi."""
    turned_about = hp.HingePair(**(case.constants | {"n": -case.constants["n"]}))
    motion = [np.concatenate([c[:, :6], -c[:, 6:]], axis=-1) for c in case.motion]
    got = turned_about.forward_kinematics(*motion)
    for name in ("R2", "S2", "d", "v2", "omega2", "a2", "alpha2"):
        case.require(name, getattr(got, name), getattr(case.state, name), 16)
