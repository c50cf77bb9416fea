"""Dask arrays in, Dask arrays out: as NumPy gives them, one task a chunk, and nothing is computed unasked."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.near import U
from support.trees import Robot, random_model, record_of

pytest.importorskip("dask.array", reason="the extra dask is not installed")

import dask
import dask.array as da

COUNT, CHUNK = 10, 4
BODY = hp.Body(2.0, (0.1, 0.2, 0.3), inertia=(0.2, 0.3, 0.4))
PAIR = hp.HingePair((0.5, 0, 0.1), (-0.25, 0.1, 0), (1, 2, 0), body1=BODY, body2=BODY)
FLAT = hp.PlanarPair((0.5, 0.2), (-0.3, 0.1))
ROBOT = Robot(record_of(random_model(1, 3)))
FREE = Robot(record_of(random_model(1, 3)), "free")
RNG = np.random.default_rng(1)
STILL = hp.BodyMotion(R=(1, 2, 3), S=hp.rotation_exp((1, 2, 3)), v=(0, 0, 0), omega=(1, 0, 1))
FORCE = {ROBOT.links[-1]: ((1, 2, 3), 0)}

CALLS = {
    "pose": (7, PAIR.forward_kinematics, 1),
    "acceleration": (7, PAIR.forward_kinematics, 3),
    "sequence": (7, lambda q, qd: PAIR.forward_kinematics(q, qd, sequence="ZYX", outputs=("omega1", "S2")), 2),
    "prepared": (7, PAIR.prepare("velocity"), 2),
    "attitude": (3, lambda x: PAIR.prepare(("S1", "psi"), outputs=("S2",))(hp.rotation_exp((1, 2, 3)), x[:, 0]), 1),
    "mass_matrix": (3, lambda x: PAIR.mass_matrix(STILL, x[:, 0]), 1),
    "plane": (4, FLAT.forward_kinematics, 3),
    "frames": (3, ROBOT.forward_kinematics, 3),
    "torques": (3, lambda *x: ROBOT.inverse_dynamics(*x, gravity=(1, 0, -9), wrenches=FORCE), 3),
    "accelerations": (3, ROBOT.forward_dynamics, 3),
    "jacobian": (3, lambda q: ROBOT.jacobian(q, ROBOT.tips[0], base_motion=STILL), 1),
    "free": (3, lambda *x: FREE.inverse_dynamics(*x, base_motion=hp.BodyMotion(
        R=STILL.R, S=STILL.S, v=STILL.v, omega=STILL.omega, a=STILL.R, alpha=STILL.R)), 3),
}  # fmt: skip


@pytest.fixture(autouse=True)
def nothing_is_computed_unasked():
    def refuse(*_, **__):
        pytest.fail("computed without being asked")

    with dask.config.set(scheduler=refuse):
        yield


def chunked(array):
    return da.from_array(array, chunks=(CHUNK, *array.shape[1:]))


def arrays_of(result):
    return result.arrays() if hasattr(result, "arrays") else {"": result}


@pytest.mark.slow
@pytest.mark.parametrize("name", CALLS)
def test_chunks_are_what_numpy_gives(name):
    width, call, count = CALLS[name]
    given = RNG.normal(size=(count, COUNT, width))
    lazy, expected = call(*map(chunked, given)), call(*given)
    assert type(lazy) is type(expected) or isinstance(lazy, da.Array)
    assert getattr(lazy, "shape", None) == getattr(expected, "shape", None)
    found = arrays_of(lazy)
    assert {part.numblocks[0] for part in found.values()} == {3}
    computed = dask.compute(*found.values(), scheduler="synchronous")
    for part, array in zip(computed, arrays_of(expected).values(), strict=True):
        assert part.dtype == array.dtype
        np.testing.assert_allclose(part, array, rtol=0, atol=512 * U * np.abs(array).max())


def test_a_chunk_is_computed_once_for_all_outputs_and_what_is_not_chunked_is_shared():
    calls = []
    q = chunked(RNG.normal(size=(COUNT, 7)))
    counted = q.map_blocks(lambda block: calls.append(len(block)) or block, dtype=q.dtype, meta=np.empty((0, 7)))
    state = PAIR.forward_kinematics(counted, np.ones(7))
    dask.compute(*state.arrays().values(), scheduler="synchronous")
    assert sorted(calls) == [2, 4, 4]
    single = PAIR.forward_kinematics(q.astype(np.float32))
    assert single.R2.dtype == np.float32
    assert dask.compute(single.R2, scheduler="synchronous")[0].dtype == np.float32
    split = PAIR.forward_kinematics(q.rechunk((5, 2)))  # the seven of a sample are brought together
    np.testing.assert_array_equal(*dask.compute(split.R2, PAIR.forward_kinematics(q).R2, scheduler="synchronous"))


@pytest.mark.slow(5)
def test_other_processes_make_the_call_again():
    q = chunked(RNG.normal(size=(COUNT, 7)))
    for state in (PAIR.forward_kinematics(q), PAIR.prepare("pose")(q)):
        here, there = (dask.compute(state.R2, scheduler=one)[0] for one in ("synchronous", "processes"))
        np.testing.assert_array_equal(here, there)
