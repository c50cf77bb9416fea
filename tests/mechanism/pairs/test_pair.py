"""The pair as a value: one of its constants changed, and what cannot be used refused in our own words."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.requests import subject_of
from support.hinged import made
from support.states import generator
from support.states import pair as random_pair

EVERYTHING = {"name": "knee", "limits": (-1, 2), "body1": hp.Body(2.0), "body2": hp.Body(3.0)}


def test_one_constant_is_replaced_and_computed_with():
    pair, other = made(**EVERYTHING), made(1)
    given = dict(zip(("u1", "u2", "n", "home"), random_pair(generator(85, 0)), strict=True))
    for name in given:
        changed = replace(pair, **{name: getattr(other, name)})
        expected = hp.HingePair(**given | {name: getattr(other, name)})
        assert np.array_equal(getattr(changed, name), getattr(expected, name))
        q = np.linspace(-1, 1, 7)
        assert np.array_equal(changed.forward_kinematics(q).R2, expected.forward_kinematics(q).R2)
        assert (changed.name, changed.limits) == ("knee", (-1, 2))
        assert (changed.body1, changed.body2) == (pair.body1, pair.body2)
    assert replace(pair, limits=None).limits is None


def test_values_are_replaced_in_the_plane_and_of_a_motion():
    flat = replace(hp.PlanarPair(u1=(1, 0), u2=(-1, 0), name="flat"), u1=(2, 0))
    assert flat.forward_kinematics((0, 0, 0, 0)).R2.tolist() == [3.0, 0.0]
    assert flat.name == "flat"
    motion = replace(hp.BodyMotion(R=np.zeros(3), S=np.eye(3)), R=np.ones((5, 3)))
    assert motion.shape == (5,)


def copies(value):
    return (copy.copy(value), copy.deepcopy(value), pickle.loads(pickle.dumps(value)))


@pytest.mark.parametrize("key", range(20))
def test_what_is_not_replaced_keeps_its_last_bits(key):
    """A unit axis has been rounded: a pair that is made anew from it would be another."""
    pair = made(key)
    others = (*copies(pair), replace(pair, name="knee"), replace(replace(pair, u1=(1, 2, 3)), u1=pair.u1))
    for other in others:
        for name, array in subject_of(pair).arrays.items():
            assert subject_of(other).arrays[name].tobytes() == array.tobytes(), name
    assert np.array_equal(replace(pair, n=made(key + 1).n).n, hp.HingePair((0, 0, 0), (0, 0, 0), made(key + 1).n).n)


VALUES = {
    "pair": (made(**EVERYTHING), ("u1", "u2", "n", "home")),
    "planar": (hp.PlanarPair((1, 0), (1, 0)), ("u1", "u2")),
    "motion": (hp.BodyMotion(R=np.zeros(3), S=np.eye(3), v=np.ones(3)), ("R", "S", "v")),
    "body": (hp.Body(2.0, shapes=[hp.Sphere(1.0)]), ("centre_of_mass", "inertia")),
    "box": (hp.Box((1, 2, 3)), ("size", "center")),
    "cylinder": (hp.Cylinder(1, 2), ("center", "axis")),
    "sphere": (hp.Sphere(1), ("center",)),
    "state": (made().forward_kinematics(np.zeros((2, 7))), ("R2", "S2", "d")),
    "one state": (made().forward_kinematics(np.zeros(7)), ("R2", "S2", "d")),
    "trajectory": (hp.integrate(made(), np.linspace(0, 1, 5), (0, 0, 1), 1.0), ("t", "psi", "quat_wxyz", "S1", "R2")),
    "residuals": (made().residuals(*[hp.BodyMotion(R=np.zeros(3), S=np.eye(3))] * 2), ("gap", "tilt")),
}


@pytest.mark.parametrize("kind", VALUES)
def test_copies_and_pickles_are_as_frozen_as_the_value(kind):
    value, names = VALUES[kind]
    for other in (value, *copies(value)):
        for name in names:
            assert np.array_equal(getattr(other, name), getattr(value, name))
            with pytest.raises(ValueError, match="read-only"):
                getattr(other, name)[...] = 100.0
        if kind == "pair":
            assert (other.name, other.limits, other.body1.mass) == ("knee", (-1.0, 2.0), 2.0)
            assert not other.body1.inertia.flags.writeable


def test_limits_in_degrees_are_suspected_of_hinges_alone():
    with pytest.warns(hp.DynamicsWarning, match="limits: 180 is taken for radians"):
        pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), limits=(-180, 180))
    assert replace(pair, name="again").limits == (-180, 180)  # said once
    assert hp.Slider((0, 0, 0), (0, 0, 0), (0, 0, 1), limits=(-180, 180)).limits == (-180, 180)
