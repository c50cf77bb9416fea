"""Dask arrays in, Dask arrays out: as NumPy gives them, one task a chunk, and nothing is computed."""

from __future__ import annotations

import pickle
from typing import NamedTuple

import numpy as np
import pytest

import hingepair as hp
from hingepair.pair import residuals
from support.states import body1 as random_body
from support.states import coordinates, generator
from support.states import pair as random_pair

pytest.importorskip("dask.distributed", reason="the extra dask is not installed")

import dask
import dask.array as da
import dask.dataframe as dd
import pandas as pd
import xarray as xr

from support.lazy import computed, refusing_scheduler

COUNT, CHUNK = 50, 20
U = 2.0**-53


def assert_close(found, expected):
    """Equal but for the last bits, which depend on the backend that "auto" takes."""
    assert (found.shape, found.dtype) == (np.shape(expected), np.asarray(expected).dtype)
    assert np.abs(found - expected).max() <= 256 * U * np.abs(expected).max()


LETTERS = ("R", "S", "v", "omega", "a", "alpha")
MASS = hp.Body(2.0, (0.1, 0.2, 0.3), inertia=(0.2, 0.3, 0.4))


nothing_is_computed = pytest.fixture(autouse=True)(refusing_scheduler)


def chunked(array: np.ndarray) -> da.Array:
    return da.from_array(array, chunks=(CHUNK, *array.shape[1:]))


def tasks(lazy: da.Array) -> int:
    """Number of tasks that are left when Dask has put together what it can, but for those of the inputs."""
    (graph,) = dask.optimize(lazy)
    return sum(not str(key).startswith("('array-") for key in graph.__dask_graph__())


PAIR = hp.HingePair(*random_pair(generator(400)), body1=MASS, body2=MASS)
FLAT = hp.PlanarPair((0.5, 0.2), (-0.3, 0.1), body1=MASS, body2=MASS)
Q, QD, QDD = coordinates(generator(401), COUNT)
BODY = hp.BodyMotion(**dict(zip(LETTERS, random_body(generator(402), COUNT), strict=True)))
S1_OF_Q = np.asarray(PAIR.forward_kinematics(Q, outputs=("S1",)).S1)
OTHER = hp.BodyMotion(**dict(zip(LETTERS, random_body(generator(403), COUNT), strict=True)))
PSI = generator(404).normal(size=(3, COUNT))
LOAD = generator(405).normal(size=(COUNT, 3))


def lazy_body(body: hp.BodyMotion) -> hp.BodyMotion:
    return hp.BodyMotion(**{letter: chunked(getattr(body, letter)) for letter in LETTERS})


class Given(NamedTuple):
    """What calls are given, of NumPy or of Dask."""

    q: list
    body: hp.BodyMotion | None = None
    other: hp.BodyMotion | None = None
    psi: list = ()
    load: np.ndarray | None = None


CALLS = {
    "forward_kinematics": lambda g: PAIR.forward_kinematics(*g.q),
    "one_output": lambda g: PAIR.forward_kinematics(*g.q[:2], outputs=("v2",)),
    "another_sequence": lambda g: PAIR.forward_kinematics(g.q[0], sequence="ZYX"),
    "from_body1": lambda g: PAIR.forward_kinematics_from_body1(g.body, *g.psi),
    "error_bounds": lambda g: PAIR.error_bounds(*g.q),
    "jacobian": lambda g: PAIR.jacobian(g.body, g.psi[0]),
    "acceleration_bias": lambda g: PAIR.acceleration_bias(g.body, *g.psi[:2]),
    "propagate_covariance": lambda g: PAIR.propagate_covariance(g.body, g.psi[0], u1_std=1),
    "constraint_jacobian": lambda g: PAIR.constraint_jacobian(g.body, g.other),
    "constraint_bias": lambda g: PAIR.constraint_bias(g.body, g.other),
    "mass_matrix": lambda g: PAIR.mass_matrix(g.body, g.psi[0]),
    "inverse_dynamics": lambda g: PAIR.inverse_dynamics(g.body, *g.psi, gravity=(0, 0, -1)),
    "forward_dynamics": lambda g: PAIR.forward_dynamics(g.body, *g.psi[:2], force2=g.load),
    "hinge_wrench": lambda g: PAIR.hinge_wrench(g.body, *g.psi),
    "energy": lambda g: PAIR.energy(g.body, *g.psi[:2]),
    "momentum": lambda g: PAIR.momentum(g.body, *g.psi[:2]),
}

FLAT_CALLS = {
    "forward_kinematics": lambda g: FLAT.forward_kinematics(*g.q),
    "error_bounds": lambda g: FLAT.error_bounds(*g.q),
    "mass_matrix": lambda g: FLAT.mass_matrix(g.q[0]),
    "inverse_dynamics": lambda g: FLAT.inverse_dynamics(*g.q),
    "hinge_wrench": lambda g: FLAT.hinge_wrench(*g.q),
    "forward_dynamics": lambda g: FLAT.forward_dynamics(*g.q[:2], torque2=g.q[0][:, 0], force1=g.q[1][:, :2]),
    "energy": lambda g: FLAT.energy(*g.q[:2]),
    "momentum": lambda g: FLAT.momentum(*g.q[:2]),
}


def arrays_of(result) -> dict[str, np.ndarray]:
    if isinstance(result, np.ndarray | da.Array):
        return {"": result}
    if hasattr(result, "arrays"):
        return result.arrays()
    if isinstance(result, dict):
        return result
    names = [name for name in result.__slots__ if getattr(result, name) is not None]
    return {name: getattr(result, name) for name in names}


def check_same(lazy, plain) -> None:
    assert type(lazy) is type(plain) or isinstance(plain, np.ndarray)
    expected, found = arrays_of(plain), arrays_of(lazy)
    assert found.keys() == expected.keys()
    for name, array in expected.items():
        if array.shape[:1] != (COUNT,):  # the same for all samples
            assert_close(found[name], array)
            continue
        own = found[name]
        assert isinstance(own, da.Array)
        assert (own.shape, own.dtype, own.chunks[0]) == (array.shape, array.dtype, (20, 20, 10))
        assert (type(own._meta), own._meta.dtype, own._meta.ndim) == (np.ndarray, array.dtype, array.ndim)
        values = computed(own)
        assert values.dtype == array.dtype
        assert_close(values, array)


@pytest.mark.slow
@pytest.mark.parametrize("name", CALLS)
def test_a_pair_in_space_gives_what_numpy_gives(name):
    plain = Given([Q, QD, QDD], BODY, OTHER, [*PSI], LOAD)
    lazy = Given([*map(chunked, plain.q)], lazy_body(BODY), lazy_body(OTHER), [*map(chunked, PSI)], chunked(LOAD))
    check_same(CALLS[name](lazy), CALLS[name](plain))


@pytest.mark.slow
@pytest.mark.parametrize("name", FLAT_CALLS)
def test_a_pair_in_the_plane_gives_what_numpy_gives(name):
    plain = Given([row[:, :4].copy() for row in (Q, QD, QDD)])
    check_same(FLAT_CALLS[name](Given([*map(chunked, plain.q)])), FLAT_CALLS[name](plain))


RESIDUAL_ARRAYS = ("gap", "tilt", "tilt_angle", "psi", "gap_rate", "tilt_rate", "psid", "tilt_acceleration", "psidd")


def check_same_report(found, expected):
    """Equal but for the last bits of sums over samples, and of what "auto" computes."""
    assert (found.name, found.shape, found.skipped, found.u) == (
        expected.name,
        expected.shape,
        expected.skipped,
        expected.u,
    )
    assert len(found.rows) == len(expected.rows)
    for row, other in zip(found.rows, expected.rows, strict=True):
        for key, value in row._asdict().items():
            wanted = getattr(other, key)
            assert value == (pytest.approx(wanted, rel=1e-9, nan_ok=True) if type(wanted) is float else wanted), key
    assert found.verdict == expected.verdict


@pytest.mark.slow
@pytest.mark.parametrize("timed", [False, True], ids=["without t", "with t"])
def test_a_report_is_computed_when_it_is_asked_for(timed):
    body = hp.BodyMotion(**{letter: np.array(getattr(BODY, letter)) for letter in LETTERS})
    body.R.base[31] = np.nan
    t = np.arange(COUNT) / 8 if timed else None
    lazy = PAIR.residuals(lazy_body(body), lazy_body(OTHER), {"gap": 0.5}, t=t)
    plain = PAIR.residuals(body, OTHER, {"gap": 0.5}, t=t)
    assert plain.skipped == 1
    assert str(lazy).startswith(
        f"{PAIR.name}: two motions against the constraints, samples of shape (50,); not computed"
    )
    assert "report.compute(), or dask.compute(report), computes it; report.compute_summary() computes" in str(lazy)
    assert repr(lazy).startswith("LazyResiduals(shape=(50,), not computed, outputs=(gap, tilt,")
    for name in ("rows", "ok", "verdict", "skipped"):
        with pytest.raises(AttributeError, match=rf"no '{name}' before it is computed: report.compute\(\)"):
            getattr(lazy, name)
    for name in RESIDUAL_ARRAYS:
        array = getattr(lazy, name)
        assert (array.dtype, array.shape, array.chunks[0]) == (np.float64, getattr(plain, name).shape, (20, 20, 10))
    report = computed(lazy)
    summary = lazy.compute_summary(scheduler="synchronous")
    for found in (report, summary, lazy.compute(scheduler="synchronous")):
        assert type(found) is type(plain)
        check_same_report(found, plain)
        assert found.rows[0].worst_time == (found.rows[0].worst_sample[0] / 8 if timed else None)
    assert str(report).count("\n") == str(plain).count("\n")
    for name in RESIDUAL_ARRAYS:
        assert not getattr(report, name).flags.writeable
        assert isinstance(getattr(summary, name), da.Array)
        np.testing.assert_allclose(getattr(report, name), getattr(plain, name), rtol=1e-9, atol=1e-12)
    assert report.unwrapped_psi().shape == (COUNT,)
    with pytest.raises(hp.ArgumentError, match="psi: expected an array in memory"):
        summary.unwrapped_psi()


@pytest.mark.slow
def test_chunks_of_a_report_are_merged_in_any_number_of_axes():
    """The worst sample counts from the first of all, whatever the chunks."""
    gap = np.zeros((6, 4, 3))
    gap[4, 1, 0], gap[4, 2, 0], gap[5, 0, 1] = 2.0, 1.9, 1.8
    gap[0, 3] = np.nan
    still = hp.BodyMotion(R=np.zeros(3), S=np.eye(3))
    S2 = PAIR.forward_kinematics_from_body1(still, 0.5).S2
    R2 = PAIR.forward_kinematics_from_body1(still, 0.5).R2 - gap
    t = np.array("2026-01-01", "M8[s]") + np.arange(24).reshape(6, 4)
    plain = PAIR.residuals(still, hp.BodyMotion(R=R2, S=S2), {"gap": 1}, t=t)
    assert plain.rows[0].worst_sample == (4, 1)
    for chunks in ((4, 2, 3), (6, 4, 3), (1, 1, 3)):
        other = hp.BodyMotion(R=da.from_array(R2, chunks=chunks), S=S2)
        check_same_report(computed(PAIR.residuals(still, other, {"gap": 1}, t=t)), plain)
    unknown = da.from_array(R2[:, 0], chunks=(2, 3))
    unknown = unknown[da.from_array(np.arange(6) != 1, chunks=2)]
    found = computed(PAIR.residuals(still, hp.BodyMotion(R=unknown, S=S2)))
    assert (found.shape, found.rows[0].worst_sample) == ((5,), (4,))
    none = hp.BodyMotion(R=da.full((6, 3), np.nan, chunks=(2, 3)), S=S2)
    assert computed(PAIR.residuals(still, none)).verdict.startswith("NOTHING COMPARED: no finite sample of gap")
    single = computed(PAIR.residuals(still, hp.BodyMotion(R=da.from_array(R2[4, 1]), S=S2)))
    check_same_report(single, PAIR.residuals(still, hp.BodyMotion(R=R2[4, 1], S=S2)))


def test_a_report_shares_the_task_of_each_chunk_with_its_arrays(monkeypatch):
    calls, residual_arrays = [], residuals.residual_arrays
    lazy = PAIR.residuals(lazy_body(BODY), lazy_body(OTHER))
    (kept,) = dask.persist(lazy, scheduler="synchronous")
    assert type(kept) is type(lazy)
    assert len(kept.gap.__dask_graph__()) == 3  # chunks
    check_same_report(computed(kept), computed(lazy))
    monkeypatch.setattr(residuals, "residual_arrays", lambda *given: calls.append(1) or residual_arrays(*given))
    computed(lazy)
    assert len(calls) == 3  # chunks
    copy = pickle.loads(pickle.dumps(lazy))
    assert computed(copy.ratio).tolist() == computed(lazy.ratio).tolist()


def test_what_a_lazy_report_cannot_use_is_refused_at_once():
    assert computed(da.nanmax(PAIR.residuals(lazy_body(BODY), lazy_body(OTHER)).ratio)) == pytest.approx(
        max(row.ratio for row in PAIR.residuals(BODY, OTHER).rows), rel=1e-9
    )
    for options, message in (
        ({"t": np.arange(7)}, r"t: expected instants that broadcast to the samples' shape \(50,\), got shape \(7,\)"),
        ({"t": da.arange(COUNT)}, r"t: expected instants in memory, such as t.compute\(\), got a Dask Array"),
        ({"tolerances": {"gap": -1}}, r"tolerances\['gap'\]: expected a positive number \[m\], got -1"),
    ):
        with pytest.raises(hp.ArgumentError, match=message):
            PAIR.residuals(lazy_body(BODY), lazy_body(OTHER), **options)


def test_lazy_residuals_pass_where_those_of_numpy_arrays_do():
    state = PAIR.forward_kinematics(Q)
    body1, body2 = hp.BodyMotion(R=Q[:, :3], S=S1_OF_Q), hp.BodyMotion(R=state.R2, S=state.S2)
    bent, holed = np.array(state.R2), np.array(state.R2)
    bent[17, 1] += 0.01
    holed[23] = np.nan

    def ratio(R2, **tolerances):
        other = hp.BodyMotion(R=chunked(R2), S=chunked(np.asarray(state.S2)))
        first = hp.BodyMotion(R=chunked(body1.R), S=chunked(S1_OF_Q))
        return computed(PAIR.residuals(first, other, tolerances or None).ratio)

    assert PAIR.residuals(body1, body2).ok
    assert (ratio(state.R2) <= 1).all()
    assert [*np.flatnonzero(ratio(bent) > 1)] == [17]
    assert ratio(bent, gap=0.02)[17] == pytest.approx(0.5)
    # A sample whose position is not finite is judged by its tilt alone, as by NumPy.
    assert np.isfinite(ratio(holed)).all()
    assert (ratio(holed) <= 1).all()


@pytest.mark.parametrize("outputs", [("R2",), ("R2", "S2", "v2", "omega2")], ids=["one", "several"])
def test_there_is_one_task_a_chunk(outputs):
    state = PAIR.forward_kinematics(chunked(Q), chunked(QD), outputs=outputs)
    assert tasks(state.R2) == 3  # chunks
    assert tasks(state.R2.max(axis=0)) <= 3 + 1 + 3


def test_float32_stays_and_integers_become_float64():
    single = PAIR.forward_kinematics(chunked(Q.astype(np.float32)), outputs=("R2",)).R2
    assert single.dtype == computed(single).dtype == np.float32
    whole = PAIR.forward_kinematics(chunked(np.ones((COUNT, 7), int)), outputs=("R2",)).R2
    assert whole.dtype == computed(whole).dtype == np.float64


@pytest.mark.slow
def test_chunks_of_any_kind_broadcast_beside_numpy_arrays_and_numbers():
    q = da.from_array(Q.reshape(5, 10, 7), chunks=(2, 5, 3))  # the coordinates are cut too
    lazy = PAIR.forward_kinematics(q, QD[:10], outputs=("v2",)).v2
    assert lazy.chunks == ((2, 2, 1), (5, 5), (3,))
    assert_close(computed(lazy), PAIR.forward_kinematics(Q.reshape(5, 10, 7), QD[:10]).v2)
    parts = (*(chunked(column) for column in Q.T[:6]), 0.25)
    assert_close(computed(PAIR.forward_kinematics(parts).R2), PAIR.forward_kinematics((*Q.T[:6], 0.25)).R2)
    wide = PAIR.forward_kinematics_from_body1(lazy_body(BODY), da.from_array(PSI[0][:4, None], chunks=(1, 1)))
    assert wide.R2.chunks == ((1,) * 4, (20, 20, 10), (3,))
    assert_close(computed(wide.R2), PAIR.forward_kinematics_from_body1(BODY, PSI[0][:4, None]).R2)
    one = PAIR.forward_kinematics(da.from_array(Q[0]))
    assert one.R2.shape == (3,)
    assert_close(computed(one.R2), PAIR.forward_kinematics(Q[0]).R2)


def test_xarray_objects_and_data_frames_are_not_computed_either():
    labelled = xr.DataArray(chunked(Q), dims=("time", "coordinate"))
    assert_close(computed(PAIR.forward_kinematics(labelled).R2), PAIR.forward_kinematics(Q).R2)
    body = hp.BodyMotion(R=xr.DataArray(chunked(BODY.R)), S=xr.DataArray(chunked(BODY.S)))
    found = PAIR.forward_kinematics_from_body1(body, xr.DataArray(chunked(PSI[0])))
    assert_close(computed(found.S2), PAIR.forward_kinematics_from_body1(BODY, PSI[0]).S2)
    names = ("x", "y", "z", "phi_x", "phi_y", "phi_z", "psi")
    table = pd.DataFrame(dict(zip(names, Q.T, strict=True)))[[*reversed(names)]]
    lazy = PAIR.forward_kinematics(dd.from_pandas(table, npartitions=3)).R2
    assert lazy.numblocks == (3, 1)
    assert_close(computed(lazy), PAIR.forward_kinematics(Q).R2)
    with pytest.raises(hp.ArgumentError, match="q: expected the columns x, y, z"):
        PAIR.forward_kinematics(dd.from_pandas(table.rename(columns={"x": "east"}), npartitions=3))


def test_quaternions_and_rotation_vectors_make_lazy_motions():
    quat, turn = generator(406).normal(size=(COUNT, 4)), generator(407).normal(size=(COUNT, 3))
    for make, name, array in (
        (hp.BodyMotion.from_quaternion_xyzw, "quat_xyzw", quat),
        (hp.BodyMotion.from_quaternion_wxyz, "quat_wxyz", quat),
        (hp.BodyMotion.from_rotvec, "rotvec", turn),
    ):
        lazy = make(R=chunked(BODY.R), **{name: chunked(array)})
        assert_close(computed(lazy.S), make(R=BODY.R, **{name: array}).S)


def test_a_chunk_that_fails_names_itself():
    S = BODY.S.copy()
    S[43] *= 1.1
    body = hp.BodyMotion(R=chunked(BODY.R), S=chunked(S))
    lazy = PAIR.forward_kinematics_from_body1(body, 0.5)
    with pytest.raises(hp.RotationError, match=r"chunk \(2,\): body1\.S: expected rotations") as caught:
        computed(lazy.R2)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda q: PAIR.forward_kinematics(q[:, :6]), r"q: expected shape \(..., 7\), got shape \(50, 6\)"),
        (lambda q: PAIR.forward_kinematics(q, q[:30]), r"qd: expected leading shape that broadcasts with \(50,\)"),
        (lambda q: PAIR.forward_kinematics(q, outputs=("v2",)), "qd: expected a value, since output v2 needs it"),
        (lambda q: PAIR.forward_kinematics(q, outputs=("R3",)), "outputs: expected"),
        (lambda q: PAIR.forward_kinematics(q > 0), "q: expected real numbers"),
        (lambda q: PAIR.forward_kinematics(q, out={"R2": Q}), "out: expected None, since Dask"),
        (
            lambda q: hp.sample_pairs(PAIR, 50, u1_std=1).forward_kinematics(q),
            "pair: expected one pair if the arguments are Dask",
        ),
        (lambda q: hp.rodrigues(q[:, :3], 0.1), r"n: expected an array in memory, such as n.compute\(\)"),
        (lambda _: hp.fit(lazy_body(BODY), lazy_body(OTHER)), "body1: expected arrays in memory"),
    ],
)
def test_what_cannot_be_used_is_refused_before_anything_is_computed(call, message):
    with pytest.raises(hp.ArgumentError, match=message):
        call(chunked(Q))


@pytest.mark.parametrize("told", [True, False], ids=["seen at once", "seen in a chunk"])
def test_masked_chunks_are_refused(told):
    q = da.from_array(np.ma.masked_array(np.ones((4, 7)), mask=True), chunks=2)
    if not told:
        q = da.from_array(np.ones((4, 7)), chunks=2).map_blocks(np.ma.masked_array, meta=np.empty((0, 0)))
    with pytest.raises(hp.errors.DtypeError, match="q: expected an array without a mask"):
        computed(PAIR.forward_kinematics(q).R2)


def test_results_are_computed_whole():
    """`dask.compute` takes a state as it takes an array; what is in memory stays what it is."""
    lazy = PAIR.forward_kinematics(chunked(Q), chunked(QD))
    state = computed(lazy)
    assert type(state) is type(lazy)
    assert (state.shape, state.outputs) == (lazy.shape, lazy.outputs)
    expected = PAIR.forward_kinematics(Q, QD)
    for name, array in state.arrays().items():
        assert type(array) is np.ndarray
        assert_close(array, getattr(expected, name))
    assert lazy.compute(scheduler="synchronous").R2.tolist() == state.R2.tolist()
    assert state.compute() is state
    (kept,) = dask.persist(lazy, scheduler="synchronous")
    assert len(kept.R2.__dask_graph__()) == 3  # chunks
    assert computed(kept.v2).tolist() == state.v2.tolist()
    assert dask.base.tokenize(lazy) == dask.base.tokenize(PAIR.forward_kinematics(chunked(Q), chunked(QD)))


def test_what_is_sent_to_another_process_is_loaded_once():
    from hingepair.numeric.dask_arrays import ChunkTask, load_chunk_task

    task = ChunkTask(PAIR.forward_kinematics, {}, {}, ("R2",))
    load_chunk_task.cache_clear()
    first, second = (pickle.loads(pickle.dumps(task)) for _ in range(2))
    assert first is second
    assert first.method.__self__.n.tolist() == PAIR.n.tolist()


def test_equal_calls_have_equal_names_and_others_do_not():
    lazy = [PAIR.forward_kinematics(chunked(Q), outputs=("R2",), sequence=s).R2.name for s in ("XYZ", "XYZ", "ZYX")]
    assert lazy[0] == lazy[1] != lazy[2]
