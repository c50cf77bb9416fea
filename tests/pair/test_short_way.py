"""The short way from arrays to a state: the same bits as the long one, and what it does not take goes that way."""

from __future__ import annotations

import copy
import pickle
import threading

import numpy as np
import pytest

import hingepair as hp
from hingepair.evaluation import front
from hingepair.pair import short_way
from support.states import coordinates, generator, rotations

OUTPUTS = ("S2", "R2", "omega2", "v2", "S1")
PAIRS = {
    "slanted": hp.HingePair((0.5, 0.2, 0.1), (-0.25, 0.1, 0.3), (1, 2, -0.5), home=rotations(generator(3), 1)[0]),
    "along": hp.HingePair((0.5, 0, 0), (-0.25, 0, 0), (1, 0, 0)),
}


@pytest.fixture(params=PAIRS)
def pair(request, monkeypatch):
    """A pair that takes the short way from its second call on."""
    monkeypatch.setattr(short_way, "WORTH", 1)
    return copy.deepcopy(PAIRS[request.param])


def long_way(pair, *motion, **how):
    return copy.deepcopy(pair).forward_kinematics(*motion, backend="compiled", **how)


def opened(pair, *motion, **how):
    """The pair's answer by the short way."""
    pair.forward_kinematics(*motion, backend="compiled", **how)
    ways = [way for way in pair.constants.short.values() if way.one is not None]
    before = len(ways)
    state = pair.forward_kinematics(*motion, backend="compiled", **how)
    (way,) = [way for way in pair.constants.short.values() if way.one is not None][before:] or ways[-1:]
    out = how.get("out")
    assert way(motion, out) is not None
    return state


def same(found, expected):
    assert found.outputs == expected.outputs
    assert found.shape == expected.shape
    for name in expected.outputs:
        array = getattr(found, name)
        np.testing.assert_array_equal(array, getattr(expected, name))
        assert not array.flags.writeable


@pytest.mark.parametrize("outputs", [None, OUTPUTS, ("R2",)], ids=["defaults", "several", "one"])
@pytest.mark.parametrize("parts", [1, 2, 3])
def test_one_state(pair, parts, outputs):
    if outputs == OUTPUTS:
        outputs = [("S2", "S1"), OUTPUTS, (*OUTPUTS, "a2")][parts - 1]
    motion = [part[0] for part in coordinates(generator(5), 1)[:parts]]
    if outputs == ("R2",) and parts > 1:  # qd is not needed: it is looked at all the same
        assert pair.forward_kinematics(*motion, outputs=outputs).v2 is None
        with pytest.raises(hp.ShapeError):
            pair.forward_kinematics(motion[0], motion[1][:6], outputs=outputs)
        return
    same(opened(pair, *motion, outputs=outputs), long_way(pair, *motion, outputs=outputs))


@pytest.mark.parametrize("count", [2, 7, 8, 9, 100, front.MOST])
def test_batches_fresh_and_into_arrays(pair, count):
    motion = coordinates(generator(6), count)[:2]
    expected = long_way(pair, *motion, outputs=OUTPUTS)
    same(opened(pair, *motion, outputs=OUTPUTS), expected)
    out = {name: np.full_like(getattr(expected, name), np.nan) for name in reversed(OUTPUTS)}
    found = opened(pair, *motion, outputs=OUTPUTS, out=out)
    same(found, expected)
    for name in OUTPUTS:
        np.testing.assert_array_equal(out[name], getattr(expected, name))
        assert np.shares_memory(out[name], getattr(found, name))


def strided(array):
    return np.repeat(array, 2, axis=-1)[..., ::2]


FORMS = {
    "strided": strided,
    "turned": lambda a: a[::-1],
    "by columns": np.asfortranarray,
    "single": lambda a: a.astype(np.float32),
    "big-endian": lambda a: a.astype(">f8"),
    "integers": lambda a: a.astype(int),
    "lists": lambda a: a.tolist(),
    "a kind of array": lambda a: a.view(np.recarray),
    "more axes": lambda a: a.reshape(2, -1, 7),
    "one row": lambda a: a[:1],
    "none": lambda a: a[:0],
    "too many": lambda a: np.repeat(a, front.MOST, axis=0),
}


@pytest.mark.parametrize("form", FORMS)
def test_what_is_not_taken_goes_the_long_way(pair, form):
    motion = coordinates(generator(7), 6)[:2]
    opened(pair, *motion)
    changed = [FORMS[form](part) for part in motion]
    same(pair.forward_kinematics(*changed, backend="compiled"), long_way(pair, *changed))
    mixed = motion[0], changed[1]
    try:
        expected = long_way(pair, *mixed)
    except hp.ArgumentError as error:
        with pytest.raises(type(error)):
            pair.forward_kinematics(*mixed, backend="compiled")
    else:
        same(pair.forward_kinematics(*mixed, backend="compiled"), expected)


def test_a_wrong_room_is_refused_and_nothing_is_written(pair):
    motion = coordinates(generator(8), 6)[:2]
    names = ("R2", "v2", "S2")
    room = {"R2": np.zeros((6, 3)), "v2": np.zeros((6, 3)), "S2": np.zeros((6, 3, 3))}
    opened(pair, *motion, outputs=names, out=room)
    frozen = np.zeros((6, 3))
    frozen.setflags(write=False)
    both = np.zeros((7, 3))
    for wrong in (
        {"R2": frozen},
        {"R2": both[:6], "v2": both[1:]},
        {"R2": motion[0][:, :3]},
        {"R2": np.lib.stride_tricks.as_strided(motion[1], (6, 3), (24, 8))},
        {"R2": np.zeros((5, 3))},
        {"S2": np.zeros((6, 9))},
        {"R2": np.zeros((6, 3), np.float32)},
        {"R2": [[0.0] * 3] * 6},
        {"R2": None},
    ):
        copies = [part.copy() for part in motion]
        with pytest.raises(hp.ArgumentError, match="out"):
            pair.forward_kinematics(*motion, outputs=names, out=room | wrong, backend="compiled")
        np.testing.assert_array_equal(motion, copies)
    loose = np.zeros((6, 5))
    pair.forward_kinematics(*motion, outputs=names, out=room | {"v2": loose[:, 1:4]}, backend="compiled")
    np.testing.assert_array_equal(loose[:, 1:4], long_way(pair, *motion).v2)


def test_wrong_arguments_are_refused_as_before(pair):
    q, qd, qdd = coordinates(generator(9), 6)
    opened(pair, q, qd)
    for wrong in ((q, qd[:5]), (q[:, :6], qd[:, :6]), (q, None, qdd), (q, "rates"), (None, qd)):
        with pytest.raises(hp.ArgumentError):
            pair.forward_kinematics(*wrong, backend="compiled")
    with pytest.raises(hp.ArgumentError, match="outputs"):
        pair.forward_kinematics(q, qd, outputs=("R2", "R3"), backend="compiled")
    same(pair.forward_kinematics(q, qd, outputs=["R2"], backend="compiled"), long_way(pair, q, qd, outputs=("R2",)))


def test_pairs_of_one_build_keep_their_own_constants(monkeypatch):
    monkeypatch.setattr(short_way, "WORTH", 1)
    q, qd = (part[0] for part in coordinates(generator(10), 1)[:2])
    first = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
    second = hp.HingePair(u1=(0.7, 0.3, 0.4), u2=(0.25, 0.9, 0.2), n=(3, 2, 0.5))
    for pair in (first, second, first):
        same(opened(pair, q, qd), long_way(pair, q, qd))
        for again in (copy.deepcopy(pair), pickle.loads(pickle.dumps(pair))):
            assert not again.constants.short


def test_threads_do_not_meet(pair):
    motions = [coordinates(generator(11, k), 50)[:2] for k in range(4)]
    opened(pair, *motions[0])
    expected = [long_way(pair, *motion) for motion in motions]

    def work(k):
        for _ in range(200):
            found = pair.forward_kinematics(*motions[k], backend="compiled")
            wrong[k] += not np.array_equal(found.v2, expected[k].v2)

    wrong = [0] * 4
    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == [0] * 4


def test_where_heads_are_not_known_the_long_way_is_taken(pair, monkeypatch):
    monkeypatch.setattr(front, "heads_are_known", lambda: False)
    pair = hp.HingePair(u1=(0.5, 0.2, 0), u2=(0, 0.1, 0.3), n=(1, 2, 0))  # a build that no other test has
    q, qd = coordinates(generator(12), 3)[:2]
    for _ in range(3):
        same(pair.forward_kinematics(q, qd, backend="compiled"), long_way(pair, q, qd))
    assert all(way.one is None for way in pair.constants.short.values())
