"""Mass properties, shapes and limits: what no body or hinge can have is refused; the kinematics ignore the rest."""

from __future__ import annotations

import copy
import dataclasses
import math
import pickle

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.bodies import body_motion
from hingepair.rotations.matrices import rotation_exp
from support import states

U = 2.0**-53


def turned(moments, rotvec=(0.4, -1.1, 2.0)):
    turn = rotation_exp(rotvec)
    return turn @ np.diag(moments) @ turn.T


@pytest.mark.parametrize(
    "moments", [(1, 1, 1), (1, 2, 2.5), (1e-9, 1, 1), (1, 2, 3), (1, 1, 2), (1e200, 2e200, 2e200)]
)
def test_an_inertia_that_a_rigid_body_can_have_is_kept(moments):
    given = turned(moments)
    inertia = hp.Body(inertia=given).inertia
    assert np.abs(inertia - given).max() <= 2 * U * max(moments)
    assert np.array_equal(inertia, inertia.T)


def test_the_centre_of_mass_is_that_of_the_shapes_whether_or_not_an_inertia_is_given():
    shapes = [hp.Box((0.9, 0.04, 2), center=(0.45, 0, 1))]
    free, given = hp.Body(20, shapes=shapes), hp.Body(20, inertia=(7, 8, 1.4), shapes=shapes)
    assert given.centre_of_mass.tolist() == free.centre_of_mass.tolist() == [0.45, 0, 1]
    assert free.assumed == ()
    assert hp.Body(20, (0, 0, 0), (7, 8, 1.4), shapes).centre_of_mass.tolist() == [0, 0, 0]
    assert hp.Body(20, (0, 0, 0), (7, 8, 1.4), shapes).assumed == ()


def test_moments_of_no_rigid_body_are_refused_in_turned_axes_too():
    with pytest.raises(hp.ArgumentError, match=r"^inertia: expected no principal moment above the sum"):
        hp.Body(inertia=turned((1, 2, 3.007)))


@pytest.mark.parametrize("moments", [(0.0417, 0.0416, 0.0834), (1, 1, 2.003), (0.1, 0.2, 0.30000000000000004)])
def test_the_rounded_moments_of_a_flat_body_are_taken(moments):
    given = turned(moments)
    body = hp.Body(mass=2, inertia=given)
    assert np.abs(body.inertia - given).max() <= 2 * U * max(moments)
    assert body.assumed == ()


def test_a_value_is_assumed_where_it_is_not_given_and_not_where_it_equals_the_default():
    assert hp.Body(mass=100, inertia=(1, 1, 1)).assumed == ()
    assert hp.Body(mass=1.0, inertia=(1, 1, 1)).assumed == ()
    assert hp.Body(mass=3, shapes=[hp.Sphere(math.sqrt(0.025))]).assumed == ()
    assert [sentence.split(" is given")[0] for sentence in hp.Body().assumed] == ["no mass", "no inertia"]
    assert [sentence.split(" is given")[0] for sentence in hp.Body(mass=100).assumed] == ["no inertia"]
    assert all("in a scene" in sentence for sentence in hp.Body().assumed)


def test_replace_keeps_what_was_given_and_computes_the_rest_again():
    whole = hp.Body(2, (1, 2, 3), (2, 3, 4), [hp.Sphere(2)])
    other = dataclasses.replace(whole, mass=3)
    assert repr(other) == repr(whole).replace("mass=2.0", "mass=3.0")
    ball = hp.Body(mass=2, shapes=[hp.Sphere(0.5, center=(1, 0, 0))])
    heavy = dataclasses.replace(ball, mass=6)
    np.testing.assert_allclose(heavy.inertia, 3 * ball.inertia, rtol=4 * U)
    moved = dataclasses.replace(heavy, shapes=[hp.Sphere(0.5, center=(0, 2, 0))])
    assert (moved.mass, moved.centre_of_mass.tolist()) == (6.0, [0, 2, 0])
    np.testing.assert_array_equal(moved.inertia, heavy.inertia)


def test_replace_assumes_what_was_assumed_until_it_is_given():
    body = hp.Body()
    assert dataclasses.replace(body, centre_of_mass=(1, 0, 0)).assumed == body.assumed
    heavy = dataclasses.replace(body, mass=3)
    assert heavy.assumed == body.assumed[1:]
    np.testing.assert_array_equal(heavy.inertia, 0.03 * np.eye(3))
    assert dataclasses.replace(body, mass=1.0, inertia=(0.01, 0.01, 0.01)).assumed == ()
    assert dataclasses.replace(heavy, inertia=0.03 * np.eye(3)).assumed == ()


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda body: pickle.loads(pickle.dumps(body))])
def test_copies_of_a_body_assume_the_same(copied):
    body = hp.Body(mass=2)
    again = copied(body)
    assert (repr(again), again.assumed) == (repr(body), body.assumed)
    assert dataclasses.replace(again, mass=3).assumed == body.assumed
    unknown = hp.Body(shapes=[hp.Sphere(radius=0.1)])
    moved = [
        dataclasses.replace(one, centre_of_mass=(0, 0, 1)) for one in (unknown, pickle.loads(pickle.dumps(unknown)))
    ]
    assert moved[0].assumed == moved[1].assumed != ()
    np.testing.assert_array_equal(dataclasses.replace(again, mass=3).inertia, 0.03 * np.eye(3))


@pytest.mark.slow
def test_body_2_is_body_1_of_the_next_pair(monkeypatch):
    """Three joints in series, from states handed on, as from motions that are checked; nothing is checked again."""
    rng = states.generator(70)
    motion = states.coordinates(rng, 6)
    links = [hp.HingePair(u1=u1, u2=u2, n=n, home=C) for u1, u2, n, C in (states.pair(rng) for _ in range(3))]
    handed = slow = links[0].forward_kinematics(*motion)
    angles = rng.normal(size=(2, 3, 6))
    for link, angle in zip(links[1:], angles, strict=True):
        body = hp.BodyMotion(R=slow.R2, S=slow.S2, v=slow.v2, omega=slow.omega2, a=slow.a2, alpha=slow.alpha2)
        slow = link.forward_kinematics_from_body1(body, *angle)
    with monkeypatch.context() as patched:
        patched.setattr(body_motion, "check_rotation", lambda *_: pytest.fail("checked"))
        for link, angle in zip(links[1:], angles, strict=True):
            handed = link.forward_kinematics_from_body1(handed.body2, *angle)
        hp.BodyMotion.from_rotvec(R=motion[0][:, :3], rotvec=motion[0][:, 3:6])
    for name in handed.outputs:
        np.testing.assert_array_equal(handed[name], slow[name])
    first = links[0].forward_kinematics(*motion, outputs=("R1", "S1", "v1", "omega1", "R2"))
    assert [getattr(first.body1, name) is not None for name in ("R", "S", "v", "omega", "a")] == [True] * 4 + [False]
    with pytest.raises(hp.ArgumentError, match=r"^outputs: expected R2 and S2"):
        _ = first.body2
