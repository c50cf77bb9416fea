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
