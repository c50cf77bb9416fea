"""What crosses the border, as properties of values (Hypothesis): any shape, layout, type; NaN; what is refused."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import hingepair as hp
from hingepair.bench.truth import OUTPUTS, euler_scales
from support.states import generator, rotations

backends = pytest.mark.usefixtures("each_backend")

U = 2.0**-53
PAIR = (
    np.array([0.5, -0.2, 0.1]),
    np.array([-0.25, 0.1, 0.3]),
    np.array([1.0, -2.0, 3.0]),
    rotations(generator(70), 1)[0],
)
few = settings(
    max_examples=12, derandomize=True, deadline=None, database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)  # fmt: skip


@pytest.mark.slow
@few
@given(hnp.arrays(np.float64, 3, elements=st.floats(-1.0, 1.0)), st.integers(-1000, 1000))
def test_an_axis_has_no_length(axis, exponent):
    """Times a power of two: the very same pair; and n is of unit length, whatever came."""
    largest = abs(axis).max()
    if largest < 1e-3 or (abs(axis)[axis != 0] < 1e-3).any():
        axis = np.array([0.3, -0.4, 0.5])
    pairs = [hp.HingePair(u1=PAIR[0], u2=PAIR[1], n=n) for n in (axis, np.ldexp(axis, exponent))]
    q, qd = np.linspace(-1.0, 1.0, 7), np.linspace(2.0, -1.0, 7)
    one, other = (p.forward_kinematics(q, qd) for p in pairs)
    assert np.array_equal(pairs[0].n, pairs[1].n)
    assert np.array_equal(one.v2, other.v2)
    assert np.array_equal(one.omega2, other.omega2)
    assert abs(np.linalg.norm(pairs[1].n) - 1) <= 2 * U
    assert abs(np.swapaxes(one.S2, -1, -2) @ one.S2 - np.eye(3)).max() <= 24 * U


@pytest.mark.slow
@backends
@pytest.mark.parametrize("varying", [("u1",), ("u2", "n"), ("home",), ("u1", "u2", "n", "home")], ids="-".join)
def test_pairs_that_vary(varying):
    """Constants with a leading axis, each on its own, are so many pairs."""
    rng, count = generator(73), 3
    motion = rng.uniform(-100, 100, (3, 2, 7))
    own = {name: rng.normal(size=(count, 3)) for name in ("u1", "u2", "n")} | {"home": rotations(rng, count)}
    shaped = {k: v[:, None] if k in varying else v[0] for k, v in own.items()}
    found = hp.HingePair(**shaped).forward_kinematics(*motion, outputs=OUTPUTS)
    for i in range(count):
        constants = {k: v[i] if k in varying else v[0] for k, v in own.items()}
        expected = hp.HingePair(**constants).forward_kinematics(*motion, outputs=OUTPUTS)
        scales = euler_scales(tuple(constants.values()), *motion)
        for name in OUTPUTS:
            error = abs(found[name][i] - expected[name]).reshape(2, -1).max(axis=-1)
            assert np.all(error <= 2 * U * scales[name] + np.finfo(float).tiny), name


@few
@given(st.integers(0, 3), st.integers(0, 2), st.sampled_from([np.nan, np.inf, -np.inf]))
def test_attitudes_of_other_forms(sample, place, bad):
    """A quaternion or rotation vector that is no number poisons its own sample; a quaternion of zero is refused."""
    rng, R = generator(74), np.zeros(3)
    forms = (
        (hp.BodyMotion.from_quaternion_xyzw, "quat_xyzw", rng.normal(size=(4, 4))),
        (hp.BodyMotion.from_quaternion_wxyz, "quat_wxyz", rng.normal(size=(4, 4))),
        (hp.BodyMotion.from_rotvec, "rotvec", rng.normal(size=(4, 3))),
    )
    for make, name, numbers in forms:
        dirty = numbers.copy()
        dirty[sample, place] = bad
        clean, found = (np.asarray(make(R=R, **{name: x}).S) for x in (numbers, dirty))
        others = [i for i in range(4) if i != sample]
        assert np.array_equal(found[others], clean[others])
        assert not np.isfinite(found[sample]).all()
        if name != "rotvec":
            dirty[sample] = 0.0
            with pytest.raises(hp.RotationError) as caught:
                make(R=R, **{name: dirty})
            assert caught.value.name == name


@few
@given(st.floats(0.0, 2e-10), st.floats(1e-8, 0.5), hnp.arrays(np.float64, (3, 3), elements=st.floats(-1.0, 1.0)))
def test_how_far_from_a_rotation(honest, bad, noise):
    """Round-off and honest data pass; what is further off is refused, with the way out named; a reflection too."""
    S = rotations(generator(72), 1)[0]
    hp.BodyMotion(R=np.zeros(3), S=S + honest * noise)
    hp.HingePair(u1=PAIR[0], u2=PAIR[1], n=PAIR[2], home=S + honest * noise)
    stretched = S * (1 + bad)
    for refused in (stretched, -S, S[::-1]):
        with pytest.raises(hp.RotationError, match=r"S: .*project_to_rotation"):
            hp.BodyMotion(R=np.zeros(3), S=refused)
        with pytest.raises(hp.RotationError, match=r"home: .*project_to_rotation"):
            hp.HingePair(u1=PAIR[0], u2=PAIR[1], n=PAIR[2], home=refused)
    hp.BodyMotion(R=np.zeros(3), S=hp.project_to_rotation(stretched))


@pytest.mark.parametrize("shape", [(7,), (5, 7)], ids=["state", "batch"])
def test_arrays_of_a_dtype_that_came_from_a_pickle_are_as_any_others(shape):
    """NumPy has such dtypes beside its own: equal, but another object, which its copies keep."""
    q = np.random.default_rng(3).normal(size=shape)
    sent = pickle.loads(pickle.dumps(q))
    assert sent.dtype is not q.dtype
    knee = hp.HingePair((1, 0, 0), (0, 0, 0), (0, 0, 1))
    for pair in (knee, hp.Mechanism([knee])):
        args = (q, sent) if pair is knee else (q[..., :1], sent[..., :1])
        for backend in ("numpy", "compiled"):
            here, there = (pair.forward_kinematics(one, backend=backend) for one in args)
            name = "R2" if pair is knee else "R"
            np.testing.assert_array_equal(getattr(there, name), getattr(here, name))
