"""Derivatives of prepared calls of pairs and planar pairs, against the Jacobians that the equations give."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS, exactly, unit
from hingepair.mechanism.pairs.geometry import constants_of
from support.exact import Exact, tree_of_pair
from support.exact_robot import LETTERS
from support.states import body1 as random_body
from support.states import generator

EPS = 2.0**-53
CONSTANTS = ("masses", "first_moments", "inertias", "u1", "u2", "n", "home")
ENTRIES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # of inertias, in Pinocchio's order
BODY1 = hp.Body(1.4, (0.1, -0.2, 0.3), inertia=((2, 0.2, -0.1), (0.2, 2.5, 0.3), (-0.1, 0.3, 3)))
BODY2 = hp.Body(2.1, (-0.2, 0.3, 0.1), inertia=((3, -0.4, 0.2), (-0.4, 2, 0.1), (0.2, 0.1, 2.4)))
HOME = hp.rotation_exp(np.array((0.3, -0.8, 0.5)))
PAIR = hp.HingePair((0.5, -0.2, 0.1), (-0.3, 0.4, 0.2), (1, 2, -1.3), HOME, body1=BODY1, body2=BODY2)


@pytest.fixture
def states():
    return np.random.default_rng(11).uniform(-2, 2, (2, 5, 7))


def test_body_2_changes_by_coordinates_as_it_moves_by_their_rates(states):
    q, qd = states
    found = PAIR.prepare("velocity", outputs=("R2", "S2", "v2", "omega2")).jacobian((q, qd))
    np.testing.assert_allclose(found["R2"]["q"], found["v2"]["qd"], atol=64 * EPS)
    np.testing.assert_allclose(found["S2"]["q"], found["omega2"]["qd"], atol=64 * EPS)
    state = PAIR.forward_kinematics(q, qd)
    for name in ("v2", "omega2"):  # linear in qd
        np.testing.assert_allclose(np.einsum("nij,nj->ni", found[name]["qd"], qd), state[name], atol=64 * EPS)


def test_a_turn_of_body_1_and_of_the_hinge_moves_body_2_as_the_jacobian_says(states):
    turns, psi = hp.rotation_exp(states[0, :, :3]), states[0, :, 6]
    R1 = states[1, :, :3]
    J = PAIR.jacobian(hp.BodyMotion(R=R1, S=turns), psi)
    found = PAIR.prepare(("R1", "S1", "psi"), outputs=("R2", "S2")).jacobian((R1, turns, psi))
    for rows, output in ((slice(0, 3), "R2"), (slice(3, 6), "S2")):
        np.testing.assert_allclose(found[output]["S1"], J[:, rows, 3:6], atol=64 * EPS)
        np.testing.assert_allclose(found[output]["psi"], J[:, rows, 6], atol=64 * EPS)
    np.testing.assert_array_equal(found["R2"]["R1"], np.broadcast_to(np.eye(3), (5, 3, 3)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["quat_xyzw", "quat_wxyz"])
def test_a_quaternion_of_any_length_changes_by_rotations_about_world_axes(states, name):
    axis, size = np.array([0.6, 0.0, -0.8]), 1.7
    vector, w, S1 = size * np.sin(0.55) * axis, size * np.cos(0.55), hp.rotation_exp(1.1 * axis)
    quat = [*vector, w] if name == "quat_xyzw" else [w, *vector]
    rest = states[0, 0, :3], states[1, 0, :3], 0.3, 0.2
    given, outputs = ("omega1", "psi", "psid"), ("d", "S2", "v2")
    found = PAIR.prepare(("v1", name, *given), outputs=outputs).jacobian((rest[0], quat, *rest[1:]))
    expected = PAIR.prepare(("v1", "S1", *given), outputs=outputs).jacobian((rest[0], S1, *rest[1:]))
    for output in outputs:
        np.testing.assert_allclose(found[output][name], expected[output]["S1"], atol=64 * EPS)


# ---- by constants


def test_a_turn_of_home_turns_body_2_about_the_hinge_point(states):
    psi, R1, S1 = states[0, :, 6], states[1, :, :3], hp.rotation_exp(states[0, :, :3])
    found = PAIR.prepare(("R1", "S1", "psi"), outputs=("R2", "S2")).jacobian((R1, S1, psi), wrt="home")
    S2 = PAIR.forward_kinematics_from_body1(hp.BodyMotion(R=R1, S=S1), psi).S2
    turns = S2 @ HOME.T  # world axes, one for each axis of body 1
    np.testing.assert_allclose(found["S2"]["home"], turns, rtol=0, atol=64 * EPS)
    moved = -np.cross(turns, (S2 @ PAIR.u2)[:, :, None], axis=1)
    np.testing.assert_allclose(found["R2"]["home"], moved, rtol=0, atol=64 * EPS)


def forces_of(numbers, motion, psi):
    """Forces in 60 digits, from masses, first moments and inertias about the reference points, u1, u2, n and home."""
    masses, first, inertias, u1, u2, n, home = numbers
    bodies = []
    for m, h, J in zip(masses, first, inertias, strict=True):
        c = h / m
        full = np.empty((3, 3), object)
        for (i, j), entry in zip(ENTRIES, J, strict=True):
            full[i, j] = full[j, i] = entry
        bodies.append((m, c, full - m * (exactly(np.eye(3)) * (c @ c) - np.outer(c, c))))
    one, two = (SimpleNamespace(mass=m, centre_of_mass=c, inertia=J) for m, c, J in bodies)
    pair = SimpleNamespace(u1=u1, u2=u2, n=n, home=home, body1=one, body2=two)
    given = dict(zip(LETTERS, motion, strict=True)) | dict(
        zip(("q", "qd", "qdd"), np.reshape(psi, (3, -1, 1)), strict=True)
    )
    force1, torque1, tau = Exact(*tree_of_pair(pair), True, given, (1.0, -2.0, -9.81)).forces
    return {"force1": force1, "torque1": torque1, "hinge_torque": tau[:, 0]}


@pytest.mark.slow(5)
def test_forces_follow_constants_as_sixty_digits_say():
    rng, step = generator(3), mpmath.mpf("1e-20")
    motion = random_body(rng, 2)
    psi = rng.normal(size=(3, 2))
    pair = PAIR.prepare("inverse_dynamics", gravity=(1.0, -2.0, -9.81))
    found = pair.jacobian((motion[1], motion[3], motion[4], motion[5], *psi), wrt=CONSTANTS)
    with mpmath.workdps(DIGITS):
        inertias = []
        for body in (BODY1, BODY2):
            c = exactly(body.centre_of_mass)
            J = exactly(body.inertia) + exactly(body.mass) * (exactly(np.eye(3)) * (c @ c) - np.outer(c, c))
            inertias.append(np.array([J[at] for at in ENTRIES]))
        masses = exactly(np.array([BODY1.mass, BODY2.mass]))
        first = masses[:, None] * exactly(np.stack([BODY1.centre_of_mass, BODY2.centre_of_mass]))
        given = [masses, first, np.stack(inertias), exactly(PAIR.u1), exactly(PAIR.u2),
                 unit(constants_of(PAIR).axis), exactly(PAIR.home)]  # fmt: skip
        for k, name in enumerate(CONSTANTS):
            shape = (3,) if name == "home" else given[k].shape
            for index in np.ndindex(shape):
                sides = []
                for sign in (1, -1):
                    change = exactly(np.zeros(shape))
                    change[index] = sign * step
                    if name == "home":
                        x, y, z = change
                        change = np.array([[0 * x, -z, y], [z, 0 * x, -x], [-y, x, 0 * x]]) @ given[k]
                    sides.append(forces_of([*given[:k], given[k] + change, *given[k + 1 :]], motion, psi))
                for output, ours in found.items():
                    exact = ((sides[0][output] - sides[1][output]) / (2 * step)).astype(float)
                    size = max(1.0, abs(ours[name]).max())
                    np.testing.assert_allclose(ours[name][(..., *index)], exact, rtol=0, atol=64 * EPS * size)


@pytest.mark.slow(8)
def test_accelerations_take_back_what_constants_add_to_forces():
    """M times the change of the accelerations, and that of the forces at these accelerations, make 0."""
    rng = np.random.default_rng(5)
    S1, (omega1, force1, torque1), psi = hp.rotation_exp(rng.normal(size=3)), rng.normal(size=(3, 3)), (0.4, -0.7)
    forward = PAIR.prepare("forward_dynamics")
    given = (S1, omega1, *psi, force1, torque1, 0.3)
    a = forward(*given)
    by = forward.jacobian(given, wrt=CONSTANTS)
    still = PAIR.prepare("inverse_dynamics").jacobian((S1, omega1, a.a1, a.alpha1, *psi, a.psidd), wrt=CONSTANTS)
    M = PAIR.mass_matrix(hp.BodyMotion(R=np.zeros(3), S=S1), psi[0])
    for name in CONSTANTS:
        moved, lacking = (
            np.concatenate([np.atleast_2d(one[output][name].reshape(rows, -1)) for output, rows in parts])
            for one, parts in (
                (by, (("a1", 3), ("alpha1", 3), ("psidd", 1))),
                (still, (("force1", 3), ("torque1", 3), ("hinge_torque", 1))),
            )
        )
        near = 512 * EPS * np.linalg.cond(M) * max(1.0, abs(lacking).max())
        np.testing.assert_allclose(M @ moved, -lacking, rtol=0, atol=near)


@pytest.mark.slow(6)
def test_constraints_follow_the_geometry_as_difference_quotients_say(states):
    motions = [
        hp.BodyMotion(R=part[:3], S=hp.rotation_exp(turn[:3]), v=part[3:6], omega=turn[3:6])
        for part, turn in zip(states[0, :2], states[1, :2], strict=True)
    ]
    outputs = ("gap", "tilt", "psi", "gap_rate", "tilt_rate", "psid")
    names = ("R1", "S1", "v1", "omega1", "R2", "S2", "v2", "omega2")
    given = tuple(getattr(motion, letter) for motion in motions for letter in ("R", "S", "v", "omega"))
    found, h = PAIR.prepare(names, outputs=outputs).jacobian(given, wrt=("u1", "u2", "n", "home")), 1e-5
    for name in ("u1", "u2", "n", "home"):
        for k, e in enumerate(np.eye(3) * h):
            sides = []
            for step in (e, -e):
                value = getattr(PAIR, name)
                moved = hp.rotation_exp(step) @ value if name == "home" else value + step
                pair = dataclasses.replace(PAIR, **{name: moved})
                sides.append(pair.prepare(names, outputs=outputs, backend="numpy")(*given))
            for output in outputs:
                quotient = (sides[0][output] - sides[1][output]) / (2 * h)
                np.testing.assert_allclose(found[output][name][..., k], quotient, rtol=0, atol=10 * h * h)


@pytest.mark.slow(6)
def test_products_with_derivatives_by_constants_are_products(states):
    call = PAIR.prepare("acceleration", outputs=("R2", "a2"))
    given, names = (*states, states[0]), ("u1", "n", "home")
    rng, J = np.random.default_rng(2), call.jacobian(given, wrt=("q", *names))
    changes = {name: rng.normal(size=J["a2"][name].shape[-1]) for name in names}
    value, rates = call.jvp(given, changes)
    expected = sum(np.einsum("sij,j->si", J["a2"][name], change) for name, change in changes.items())
    np.testing.assert_allclose(rates["a2"], expected, rtol=0, atol=1e3 * EPS)
    weight = rng.normal(size=rates["a2"].shape)
    same, gradient = call.vjp(given, {"a2": weight}, wrt=names)
    assert set(gradient) == {*names}
    for name in names:
        np.testing.assert_allclose(gradient[name], np.einsum("sij,si->sj", J["a2"][name], weight), atol=1e3 * EPS)
    for ours in (value, same):
        np.testing.assert_allclose(ours.a2, call(*given).a2, rtol=0, atol=1e3 * EPS)
