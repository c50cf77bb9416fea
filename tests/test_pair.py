"""The pair as a value: one of its constants changed, and what cannot be used refused in our own words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hingepair as hp
from states import generator
from states import pair as random_pair

U = 2.0**-53
EVERYTHING = {"name": "knee", "limits": (-1, 2), "body1": hp.Body(2.0), "body2": hp.Body(3.0)}


def made(key=0, **changes):
    return hp.HingePair(
        **dict(zip(("u1", "u2", "n", "home"), random_pair(generator(98, key)), strict=True)) | changes
    )


def test_one_constant_is_replaced_and_computed_with():
    pair, other = made(**EVERYTHING), made(1)
    for name in ("u1", "u2", "n", "home"):
        changed = replace(pair, **{name: getattr(other, name)})
        expected = hp.HingePair(
            **{key: getattr(other if key == name else pair, key) for key in ("u1", "u2", "n", "home")}
        )
        assert np.array_equal(getattr(changed, name), getattr(expected, name))
        q = np.linspace(-1, 1, 7)
        assert np.array_equal(changed.forward_kinematics(q).R2, expected.forward_kinematics(q).R2)
        assert (changed.name, changed.limits) == ("knee", (-1, 2))
        assert (changed.body1, changed.body2) == (pair.body1, pair.body2)
    assert replace(pair, limits=None).limits is None
    with pytest.raises(hp.ArgumentError, match="u1: expected finite numbers"):
        replace(pair, u1=(0, 0, np.nan))


def test_values_are_replaced_in_the_plane_and_of_a_motion():
    flat = replace(hp.PlanarPair(u1=(1, 0), u2=(-1, 0), name="flat"), u1=(2, 0))
    assert flat.forward_kinematics((0, 0, 0, 0)).R2.tolist() == [3.0, 0.0]
    assert flat.name == "flat"
    motion = replace(hp.BodyMotion(R=np.zeros(3), S=np.eye(3)), R=np.ones((5, 3)))
    assert motion.shape == (5,)


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ({"u2": (4, 3)}, r"u2: expected leading shape that broadcasts with \(5,\), got shape \(4,\)"),
        ({"n": (2, 3)}, r"n: expected leading shape that broadcasts with \(5,\), got shape \(2,\)"),
        ({"home": (4, 3, 3)}, r"home: expected leading shape that broadcasts with \(5,\), got shape \(4,\)"),
    ],
)
def test_leading_axes_that_do_not_fit_are_named(shapes, message):
    ones = {"u2": np.ones(3), "n": np.ones(3), "home": np.eye(3)}
    arrays = {name: np.broadcast_to(one, shapes.get(name, one.shape)) for name, one in ones.items()}
    with pytest.raises(hp.ShapeError, match=message):
        hp.HingePair(u1=np.zeros((5, 3)), **arrays)
