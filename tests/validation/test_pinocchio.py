"""The pair's twin in Pinocchio, and the way there and back."""

from __future__ import annotations

import math
import sys

import numpy as np
import pinocchio as pin
import pytest

from hingepair.errors import ArgumentError, MissingDependencyError, ShapeError
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.validation.cross_validate import cross_validate
from hingepair.validation.pinocchio_twin import to_pinocchio
from support import states
from support.hinged import pair_of

U = 2.0**-53


def body1_of(rng, *shape):
    R, S, v, omega, a, alpha = (
        array.reshape(*shape, *array.shape[1:]) for array in states.body1(rng, math.prod(shape))
    )
    return BodyMotion(R=R, S=S, v=v, omega=omega, a=a, alpha=alpha)


# ---------------------------------------------------------------- the twin


@pytest.mark.parametrize("shape", [(), (1,), (50,), (4, 5), (0,)], ids=str)
def test_coordinates_come_back_from_pinocchio(shape):
    rng = states.generator(50)
    twin = to_pinocchio(pair_of(states.pair(rng)))
    body1, (psi, psid, psidd) = body1_of(rng, *shape), rng.normal(size=(3, *shape))
    q, v, a = (
        twin.configuration(body1, psi),
        twin.velocity(body1, psi, psid),
        twin.acceleration(body1, psi, psid, psidd),
    )
    assert (q.shape, v.shape, a.shape) == ((*shape, 8), (*shape, 7), (*shape, 7))
    back, *hinge = twin.motion(q, v, a)
    size = (
        1
        + np.abs(body1.a)
        + np.linalg.norm(body1.omega, axis=-1, keepdims=True) * np.abs(body1.v).max(axis=-1, keepdims=True, initial=0)
    )
    assert np.array_equal(back.R, body1.R)
    assert np.all(np.abs(back.S - body1.S) <= 8 * U)
    for name in ("v", "omega", "alpha"):
        given = getattr(body1, name)
        scale = np.linalg.norm(given, axis=-1, keepdims=True)
        assert np.all(np.abs(getattr(back, name) - given) <= 16 * U * scale), name
    assert np.all(np.abs(back.a - body1.a) <= 32 * U * np.linalg.norm(size, axis=-1, keepdims=True))
    for got, given in zip(hinge, (psi, psid, psidd), strict=True):
        assert np.array_equal(got, given)


def test_what_was_not_given_does_not_come_back():
    rng = states.generator(51)
    twin, body1 = to_pinocchio(pair_of(states.pair(rng))), body1_of(rng)
    q, v = twin.configuration(body1, 0.3), twin.velocity(body1, 0.3, 2.0)
    pose, velocity = twin.motion(q), twin.motion(q, v)
    assert (pose[0].v, pose[0].a, pose[2], pose[3]) == (None, None, None, None)
    assert (velocity[0].a, velocity[2], velocity[3]) == (None, 2.0, None)
    with pytest.raises(ArgumentError, match="v: expected the velocity that belongs to a"):
        twin.motion(q, None, v)
    assert twin.velocity(BodyMotion(R=body1.R, S=body1.S), 0.0, 2.0).tolist() == [0, 0, 0, 0, 0, 0, 2]  # at rest
    with pytest.raises(ArgumentError, match="omega"):
        twin.velocity(BodyMotion(R=body1.R, S=body1.S, v=body1.v), 0.0, 0.0)
    with pytest.raises(ShapeError, match="qd"):
        twin.velocity(body1, np.zeros(3), np.zeros(2))


@pytest.mark.parametrize("shape", [(), (1,), (4, 5), (0,)], ids=str)
def test_body_2_is_read_out_of_pinocchio(shape):
    """World axes, classical accelerations, the leading shape of what was given."""
    rng = states.generator(58)
    pair = pair_of(states.pair(rng))
    twin, body1, (psi, psid, psidd) = to_pinocchio(pair), body1_of(rng, *shape), rng.normal(size=(3, *shape))
    q, v, a = (
        twin.configuration(body1, psi),
        twin.velocity(body1, psi, psid),
        twin.acceleration(body1, psi, psid, psidd),
    )
    state = pair.forward_kinematics_from_body1(body1, psi, psid, psidd)
    for given, names in (((q,), "R S"), ((q, v), "R S v omega"), ((q, v, a), "R S v omega a alpha")):
        found = twin.body2(*given)
        for name in ("R", "S", "v", "omega", "a", "alpha"):
            value, expected = getattr(found, name), getattr(state, f"{name}2")
            assert (value is not None) == (name in names.split()), name
            if value is not None:
                assert value.shape == expected.shape
                assert np.all(np.abs(value - expected) <= 512 * U * (1 + np.abs(expected).max(initial=0))), name
    assert pair.residuals(body1, twin.body2(q, v, a)).ok or 0 in shape


def test_body_2_takes_quaternions_of_any_length_and_refuses_the_rest():
    rng = states.generator(59)
    twin, body1 = to_pinocchio(pair_of(states.pair(rng))), body1_of(rng, 3)
    q, v = twin.configuration(body1, 0.3), twin.velocity(body1, 0.3, 2.0)
    longer = q * np.r_[1, 1, 1, [-1e-200] * 4, 1]
    assert np.abs(twin.body2(longer).S - twin.body2(q).S).max() <= 8 * U
    assert twin.body2(q[0], v).v.shape == (3, 3)
    with pytest.raises(ArgumentError, match="v: expected the velocity that belongs to a"):
        twin.body2(q, None, v)
    with pytest.raises(ArgumentError, match="q: expected non-zero quaternions"):
        twin.body2(q * np.r_[1, 1, 1, 0, 0, 0, 0, 1])
    with pytest.raises(ArgumentError, match=r"q: expected shape \(..., 8\)"):
        twin.body2(v)


def test_the_twin_is_a_free_flyer_and_a_hinge():
    twin = to_pinocchio(pair_of(states.pair(states.generator(54))))
    assert (twin.model.nq, twin.model.nv, twin.model.name) == (8, 7, "hinge_pair")
    assert twin.model.frames[twin.body2_frame].name == "body2"
    assert twin.model.frames[twin.body2_frame].type == pin.FrameType.OP_FRAME


# ---------------------------------------------------------------- the package around it


@pytest.mark.parametrize("module", [None, sys])
def test_a_missing_pinocchio_is_said(monkeypatch, module):
    monkeypatch.setitem(sys.modules, "pinocchio", module)
    monkeypatch.setattr(sys, "__file__", "elsewhere", raising=False)
    pair = pair_of(states.REFERENCE_PAIR)
    with pytest.raises(MissingDependencyError, match="pip install 'pin"):
        to_pinocchio(pair)
    with pytest.raises(ImportError, match="pip install 'pin"):
        cross_validate(pair, np.zeros(7))
