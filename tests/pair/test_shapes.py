"""What may come in and what goes out: any leading shape, layout and type; batch and single state alike."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import OUTPUTS, UNIT, euler_scales
from support.states import coordinates, generator, pair

pytestmark = pytest.mark.usefixtures("each_backend")

U = 2.0**-53
TAIL = {name: (3, 3) if name.startswith("S") else (3,) for name in OUTPUTS}
LEVELS = [("R2", "S2", "d"), ("v2", "omega2"), ("a2", "alpha2")]


@pytest.fixture
def given(each_backend):  # noqa: ARG001 (what is expected comes from the same backend)
    """A pair, 24 states of it, their outputs and scales."""
    rng = generator(40)
    u1, u2, n, home = pair(rng)
    motion = coordinates(rng, 24)
    one = hp.HingePair(u1=u1, u2=u2, n=n, home=home)
    expected = one.forward_kinematics(*motion, outputs=OUTPUTS)
    return one, motion, expected, euler_scales((u1, u2, n, home), *motion)


def require(found, expected, scales, ulps=2, index=slice(None)):
    """Equal to so many u * scale; the samples of `expected` in the order of `found`."""
    for name in OUTPUTS:
        got, want = np.asarray(getattr(found, name)), np.asarray(getattr(expected, name))[index]
        unit = UNIT[got.dtype]
        gap = abs(got.reshape(want.shape).astype(float) - want).reshape(len(want), -1).max(axis=-1)
        assert np.all(gap <= ulps * unit * scales[name][index]), name


def test_batch_equals_single_states(given):
    one, motion, expected, scales = given
    for i in range(24):
        alone = one.forward_kinematics(*(c[i] for c in motion), outputs=OUTPUTS)
        assert alone.R2.shape == (3,)
        assert alone.S2.shape == (3, 3)
        require(alone, expected, scales, index=slice(i, i + 1))


def test_a_large_batch_equals_its_parts(given):
    """More samples than any block holds, in an order of its own."""
    one, motion, expected, scales = given
    order = generator(41).integers(0, 24, 9001)
    found = one.forward_kinematics(*(c[order] for c in motion), outputs=OUTPUTS)
    require(found, expected, scales, index=order)


@pytest.mark.parametrize("shape", [(24,), (1, 24), (4, 6), (2, 3, 4), (24, 1, 1)], ids=str)
def test_any_leading_shape(given, shape):
    one, motion, expected, scales = given
    found = one.forward_kinematics(*(c.reshape(*shape, 7) for c in motion), outputs=OUTPUTS)
    for name in OUTPUTS:
        assert getattr(found, name).shape == (*shape, *TAIL[name])
    require(found, expected, scales)


@pytest.mark.parametrize("shape", [(0,), (3, 0), (0, 4)], ids=str)
def test_no_samples_at_all(given, shape):
    found = given[0].forward_kinematics(*(np.zeros((*shape, 7)),) * 3, outputs=OUTPUTS)
    for name in OUTPUTS:
        assert getattr(found, name).shape == (*shape, *TAIL[name])


def strided(c):
    wide = np.full((48, 14), np.nan)
    wide[::2, ::2] = c
    return wide[::2, ::2]


def frozen(c):
    c = c.copy()
    c.flags.writeable = False
    return c


LAYOUTS = {
    "strided": strided,
    "reversed": lambda c: np.ascontiguousarray(c[::-1])[::-1],
    "fortran": np.asfortranarray,
    "big_endian": lambda c: c.astype(">f8"),
    "read_only": frozen,
    "nested_lists": lambda c: c.tolist(),
    "transposed": lambda c: np.ascontiguousarray(c.T).T,
}


@pytest.mark.parametrize("layout", LAYOUTS.values(), ids=LAYOUTS)
def test_any_layout(given, layout):
    one, motion, expected, scales = given
    require(one.forward_kinematics(*map(layout, motion), outputs=OUTPUTS), expected, scales)


def test_inputs_are_not_changed(given):
    one, motion, _, _ = given
    mine = [c.copy() for c in motion]
    one.forward_kinematics(*mine, outputs=OUTPUTS)
    one.forward_kinematics(tuple(mine[0].T), tuple(mine[1].T), tuple(mine[2].T), outputs=OUTPUTS)
    for before, after in zip(motion, mine, strict=True):
        assert np.array_equal(before, after)


def test_tuple_of_seven_equals_packed(given):
    one, motion, expected, scales = given
    require(one.forward_kinematics(*(tuple(c.T) for c in motion), outputs=OUTPUTS), expected, scales)


def test_coordinates_broadcast(given):
    """Scalars, rows and columns among the seven, and a single q against many qd."""
    one, motion, _, _ = given
    u, v = motion[0][:4, 5], motion[0][:3, 6]
    q = (0.5, 1, 0.0, 0.25, np.array(0.1), u[:, None], v)
    found = one.forward_kinematics(q, (0.0,) * 7, outputs=("R2", "S1", "omega2"))
    assert (found.R2.shape, found.S1.shape, found.omega2.shape) == ((4, 3, 3), (4, 3, 3, 3), (4, 3, 3))
    packed = np.stack(np.broadcast_arrays(*(np.asarray(x, float) for x in q)), axis=-1)
    assert abs(found.R2 - one.forward_kinematics(packed).R2).max() <= 32 * U
    assert one.forward_kinematics(motion[0][0], motion[1]).v2.shape == (24, 3)


def test_integers_are_numbers(given):
    one = given[0]
    q = np.arange(14).reshape(2, 7)
    whole, same = one.forward_kinematics(q, q), one.forward_kinematics(q.astype(float), q.astype(float))
    assert whole.R2.dtype == np.float64
    assert np.array_equal(whole.R2, same.R2)
    assert np.array_equal(whole.v2, same.v2)


def test_float32_stays_float32(given):
    one, motion, _, _ = given
    found = one.forward_kinematics(*(c.astype(np.float32) for c in motion), outputs=OUTPUTS)
    assert {getattr(found, name).dtype for name in OUTPUTS} == {np.dtype(np.float32)}


@pytest.mark.parametrize("level", [0, 1, 2])
def test_level_follows_the_inputs(given, level):
    one, motion, expected, _ = given
    found = one.forward_kinematics(*motion[: level + 1])
    for k, names in enumerate(LEVELS):
        for name in names:
            value = getattr(found, name)
            assert (value is None) == (k > level), name
            if value is not None:
                assert np.array_equal(value, getattr(expected, name)), name


@pytest.mark.parametrize("names", [(name,) for name in OUTPUTS] + [("S1", "omega1", "alpha1", "R2")], ids="+".join)
def test_exactly_the_outputs_asked_for(given, names):
    one, motion, expected, scales = given
    found = one.forward_kinematics(*motion, outputs=names)
    for name in OUTPUTS:
        value = getattr(found, name)
        if name not in names:
            assert value is None, name
            continue
        gap = abs(value - getattr(expected, name)).reshape(24, -1).max(axis=-1)
        assert np.all(gap <= 2 * U * scales[name]), name


def test_out_is_written_in_place(given):
    one, motion, expected, scales = given
    wide = np.full((24, 9), np.nan)
    out = {"R2": wide[:, 1:4], "omega2": np.empty((24, 3))}
    found = one.forward_kinematics(*motion, out=out)
    assert np.shares_memory(found.R2, wide)
    assert np.shares_memory(found.omega2, out["omega2"])
    for name, array in out.items():
        assert np.all(abs(array - getattr(expected, name)).max(axis=-1) <= 2 * U * scales[name]), name
    assert np.isnan(wide[:, [0, 4, 5, 6, 7, 8]]).all()


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_out_lies_over_no_input_and_no_other_output(backend):
    """At the first call, and where arrays of the same kind came before."""
    pair, names = hp.HingePair(u1=(1, 2, 3), u2=(3, 2, 1), n=(1, 2, 3)), ("R2", "v2")
    room, own = np.zeros(100), np.zeros((10, 3))
    q, qd = room[:70].reshape(10, 7), np.ones((10, 7))
    apart = {"R2": room[70:].reshape(10, 3), "v2": own}
    for _ in range(3):
        for bad in ({"R2": room[69:99].reshape(10, 3)}, {"R2": own, "v2": own}, {"R2": own[:], "v2": own}):
            with pytest.raises(hp.ArgumentError, match="memory of its own"):
                pair.forward_kinematics(q, qd, outputs=names, out=apart | bad, backend=backend)
        pair.forward_kinematics(q, qd, outputs=names, out=apart, backend=backend)


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_one_state_into_given_arrays(backend):
    pair, q, qd = hp.HingePair(u1=(1, 2, 3), u2=(3, 2, 1), n=(1, 2, 3)), (0.1,) * 7, (0.2,) * 7
    out = {"S2": np.full((3, 3), np.nan), "v2": np.full(3, np.nan)}
    state = pair.forward_kinematics(q, qd, out=out, backend=backend)
    alone = pair.forward_kinematics(q, qd, backend=backend)
    for name in alone.outputs:
        np.testing.assert_array_equal(getattr(state, name), getattr(alone, name))
    for name, array in out.items():
        np.testing.assert_array_equal(array, getattr(alone, name))
        assert np.shares_memory(array, getattr(state, name))
    before = {"S2": np.zeros((3, 3)), "v2": np.zeros(4)}
    with pytest.raises(hp.ShapeError, match=r"out\['v2'\]: expected shape \(3,\)"):
        pair.forward_kinematics(q, qd, out=before, backend=backend)
    assert not before["S2"].any()


@pytest.mark.parametrize("backend", ["auto", "numpy", "compiled"])
@pytest.mark.parametrize("shape", [(7,), (3, 7)])
def test_constants_beyond_float32_are_refused_by_name(backend, shape):
    far = hp.HingePair(u1=(1e39, 0, 0), u2=(0, 0, 0), n=(1, 0, 0))
    with np.errstate(all="raise"), pytest.raises(hp.ArgumentError, match=r"pair: expected numbers below 3\.4e38"):
        far.forward_kinematics(np.zeros(shape, np.float32), backend=backend)
    assert far.forward_kinematics(np.zeros(shape), backend=backend).R2.flat[0] == 1e39
