"""Dask arrays in `integrate`: what arrays in memory give, one task for each chunk of motions, nothing computed."""

from __future__ import annotations

import pickle
import subprocess
import sys

import numpy as np
import pytest

import hingepair as hp

pytest.importorskip("dask.array", reason="the extra dask is not installed")

import dask
import dask.array as da
import xarray as xr

from support.lazy import computed, refusing_scheduler
from support.many_motions import ERROR_NAMES, FLAT, PAIR, SPATIAL_NAMES, many_motions

COUNT, MOTIONS, CHUNK = 24, 5, 2
CHUNKS = (2, 2, 1)
T = np.linspace(0, 1, COUNT)
OMEGA1, PSID, R1, V1, S1_0, PSI_0 = many_motions(710, MOTIONS, T)


nothing_is_computed = pytest.fixture(autouse=True)(refusing_scheduler)


def chunked(array):
    return da.from_array(array, chunks=(CHUNK, *array.shape[1:]))


def lazily(value):
    if isinstance(value, tuple):
        return tuple(map(lazily, value))
    return chunked(value) if isinstance(value, np.ndarray) and value.shape[0] == MOTIONS else value


CASES = {
    "rates": {"omega1": OMEGA1, "psid": PSID},
    "one rate for all": {"omega1": OMEGA1, "psid": PSID[0], "psi_0": PSI_0},
    "constants": {"omega1": (0, 0, 1), "psid": PSID[:, :1].copy()},
    "points and starts": {"omega1": OMEGA1, "psid": 0.5, "R1": (R1, V1), "S1_0": S1_0, "psi_0": PSI_0},
    "points at rest": {"omega1": OMEGA1, "psid": np.cos, "R1": R1[:, :1].copy(), "tol": 1e-6},
    "a velocity for all": {"omega1": OMEGA1, "psid": lambda t: t, "R1": (R1, V1[0]), "alpha1": OMEGA1, "psidd": 0},
    "body axes": {"omega1": OMEGA1, "psid": PSID, "frame": "body", "outputs": ("R2",), "method": "midpoint"},
    "nothing of body 2": {"omega1": OMEGA1, "psid": PSID, "outputs": ()},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_lazy_motions_are_those_of_arrays_in_memory(name):
    arguments = CASES[name] | {"backend": "numpy"}
    lazy = hp.integrate(PAIR, T, **{key: lazily(value) for key, value in arguments.items()})
    plain = hp.integrate(PAIR, T, **arguments)
    assert lazy.motions == plain.motions == (MOTIONS,)
    arrays = {key: getattr(lazy, key) for key in (*SPATIAL_NAMES, *ERROR_NAMES)}
    values = computed(arrays)
    for key, array in arrays.items():
        expected = getattr(plain, key)
        if expected is None:
            assert array is None
            continue
        assert isinstance(array, da.Array)
        assert (array.shape, array.dtype, array.chunks[0]) == (expected.shape, expected.dtype, CHUNKS)
        assert (type(array._meta), array._meta.dtype, array._meta.ndim) == (np.ndarray, expected.dtype, expected.ndim)
        assert all(len(sizes) == 1 for sizes in array.chunks[1:])
        np.testing.assert_array_equal(values[key], expected)


def test_motions_in_the_plane_are_lazy_too():
    arguments = {"omega1": OMEGA1[..., 0].copy(), "psid": PSID, "R1": R1[..., :2].copy(), "phi_0": PSI_0}
    lazy = hp.integrate(FLAT, T, **{key: lazily(value) for key, value in arguments.items()}, backend="numpy")
    plain = hp.integrate(FLAT, T, **arguments, backend="numpy")
    values = computed({key: getattr(lazy, key) for key in ("phi", "psi", "R2", "phi2", "d", "omega2", *ERROR_NAMES)})
    for key, array in values.items():
        np.testing.assert_array_equal(array, getattr(plain, key))


@pytest.mark.slow
def test_compute_returns_the_trajectory_in_memory():
    lazy = hp.integrate(PAIR, T, chunked(OMEGA1), chunked(PSID), tol=1e-6, backend="numpy")
    plain = hp.integrate(PAIR, T, OMEGA1, PSID, tol=1e-6, backend="numpy")
    steps = f"{plain.steps.min()}..{plain.steps.max()}"
    assert repr(lazy) == (
        "Trajectory(magnus6, steps=not computed, motions=(5,), samples=24, t=0..1, outputs=(R2, S2, d, v2, omega2))"
    )
    whole = lazy.compute(scheduler="synchronous")
    estimate = f"{plain.error_estimate.max():.2g}"
    assert repr(whole) == repr(lazy).replace("not computed", steps).replace(
        "0..1,", f"0..1, error_estimate={estimate},"
    )
    for key in (*SPATIAL_NAMES, *ERROR_NAMES):
        assert type(getattr(whole, key)) is type(getattr(plain, key))
        np.testing.assert_array_equal(getattr(whole, key), getattr(plain, key))
    assert not any(array.flags.writeable for array in (whole.psi, whole.R2, whole.steps, whole.quat_wxyz))
    one = computed(lazy[3])
    assert type(one.steps) is int
    assert type(one.error_estimate) is float
    assert repr(one) == repr(computed(lazy)[3])
    with dask.config.set(scheduler="synchronous"):
        kept = lazy.persist() if hasattr(lazy, "persist") else dask.persist(lazy)[0]
    assert isinstance(kept.R2, da.Array)
    assert len(kept.R2.__dask_graph__()) == len(CHUNKS)
    assert plain.compute() is plain


def tasks(lazy):
    """Number of tasks after Dask has put together what it can, but for those of the inputs."""
    (graph,) = dask.optimize(lazy)
    return sum(not str(key).startswith("('array-") for key in graph.__dask_graph__())


def test_there_is_one_task_a_chunk_and_time_is_one_chunk():
    split = da.from_array(OMEGA1, chunks=(CHUNK, 7, 2))
    for omega1 in (chunked(OMEGA1), split):
        motion = hp.integrate(PAIR, T, omega1, chunked(PSID), outputs=("R2",))
        assert motion.R2.chunks == (CHUNKS, (COUNT,), (3,))
    motion = hp.integrate(PAIR, T, chunked(OMEGA1), chunked(PSID), outputs=("R2",))
    for array in (motion.R2, motion.psi, motion.steps, motion.error_estimate):
        assert tasks(array) == len(CHUNKS)
    assert tasks(motion.S1) == 2 * len(CHUNKS)


@pytest.mark.slow
def test_leading_axes_broadcast_in_chunks():
    psid = da.from_array(PSID[:3, None], chunks=(1, 1, COUNT))
    lazy = hp.integrate(PAIR, T, chunked(OMEGA1), psid, outputs=("R2",), backend="numpy")
    plain = hp.integrate(PAIR, T, OMEGA1, PSID[:3, None], outputs=("R2",), backend="numpy")
    assert lazy.R2.chunks == ((1, 1, 1), CHUNKS, (COUNT,), (3,))
    np.testing.assert_array_equal(computed(lazy.R2), plain.R2)
    one = hp.integrate(PAIR, T, da.from_array(OMEGA1[0], chunks=(7, 3)), 0.5, backend="numpy")
    assert (one.motions, one.R2.shape, one.R2.numblocks) == ((), (COUNT, 3), (1, 1))
    np.testing.assert_array_equal(computed(one).R2, hp.integrate(PAIR, T, OMEGA1[0], 0.5, backend="numpy").R2)


def test_labelled_arrays_come_and_go_lazily():
    omega1 = xr.DataArray(chunked(OMEGA1), dims=("motion", "time", "xyz"))
    lazy = hp.integrate(PAIR, T, omega1, xr.DataArray(chunked(PSID)), backend="numpy")
    labelled = lazy.to_xarray()
    assert labelled.R2.chunks == (CHUNKS, (COUNT,), (3,))
    plain = hp.integrate(PAIR, T, OMEGA1, PSID, backend="numpy")
    xr.testing.assert_identical(labelled.compute(scheduler="synchronous"), plain.to_xarray())


def test_a_motion_that_fails_names_itself_by_its_index_among_all():
    psid = PSID.copy()
    psid[3] = 1e308
    lazy = hp.integrate(PAIR, 10 * T, chunked(OMEGA1), chunked(psid))
    with pytest.raises(hp.ArgumentError, match=r"chunk \(1,\): psid of motion 3: expected a rate") as caught:
        computed(lazy.psi)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    starts = S1_0.copy()
    starts[4] *= 1.1
    wide = hp.integrate(PAIR, T, chunked(OMEGA1)[None], 0.5, S1_0=chunked(starts))
    with pytest.raises(hp.RotationError, match=r"chunk \(0, 2\): S1_0 of motion \(0, 4\): expected rotations"):
        computed(wide.psi)
    unknown = chunked(OMEGA1)[da.from_array(np.arange(MOTIONS) > 0, chunks=CHUNK)]
    assert np.isnan(unknown.shape[0])
    lazy = hp.integrate(PAIR, T, unknown, 0.5, backend="numpy")
    np.testing.assert_array_equal(computed(lazy.R2), hp.integrate(PAIR, T, OMEGA1[1:], 0.5, backend="numpy").R2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"t": da.from_array(T)}, "t: expected instants in memory, which all motions share, got a Dask Array"),
        ({"omega1": chunked(OMEGA1[:, :9].copy())}, r"omega1: expected shape \(..., 24, 3\), got shape \(5, 9, 3\)"),
        ({"omega1": chunked(OMEGA1[..., :2].copy())}, r"omega1: expected shape \(..., 24, 3\)"),
        ({"psid": chunked(PSID[:, :9].copy())}, r"psid: expected shape \(..., 24\), got shape \(5, 9\)"),
        ({"psid": PSID[:, :9]}, r"psid: expected shape \(..., 24\), got shape \(5, 9\)"),
        ({"psid": PSID[:2]}, r"psid: expected leading shape that broadcasts with \(5,\), got shape \(2,\)"),
        ({"psid": None}, "psid: expected a callable, a constant, or samples at t, got None"),
        ({"R1": (chunked(R1), V1[:2])}, r"R1\[1\]: expected leading shape that broadcasts"),
        ({"R1": chunked(R1[:, :9].copy())}, r"R1: expected shape \(..., 24, 3\)"),
        ({"omega1": chunked(OMEGA1) > 0}, "omega1: expected real numbers"),
        ({"outputs": ("a2",)}, "alpha1: expected a value, since output a2 needs it"),
        ({"outputs": ("R3",)}, "outputs: expected one of"),
        ({"method": "euler"}, "method: expected one of"),
        ({"backend": "cuda"}, "backend: expected one of"),
        ({"tol": -1.0}, "tol: expected a positive number"),
        ({"phi_0": 0.5}, "phi_0: expected None for a HingePair"),
        ({"pair": None}, "pair: expected a HingePair"),
        ({"S1_0": 2 * np.eye(3)}, "S1_0: expected rotations"),
    ],
)
def test_what_cannot_be_used_is_refused_before_anything_is_computed(change, message):
    arguments = {"pair": PAIR, "t": T, "omega1": chunked(OMEGA1), "psid": 0.5, **change}
    with pytest.raises(hp.ArgumentError, match=message):
        hp.integrate(**arguments)


def test_what_needs_arrays_in_memory_says_so():
    lazy = hp.integrate(PAIR, T, da.from_array(OMEGA1[0]), 0.5)
    for call in (lazy.to_dataframe, lambda: hp.plot(lazy), lambda: lazy.save("motion.csv")):
        with pytest.raises(hp.ArgumentError, match=r"trajectory: expected a motion in memory, .*compute\(\)"):
            call()
    with pytest.raises(hp.ArgumentError, match="expected an array in memory"):
        lazy.euler_angles(1)


COUNT_KERNELS = """
import numpy as np
import dask
import dask.array as da
import hingepair as hp
from hingepair.engine.llvm import native

names, compile_module = [], native._compile_module
native._compile_module = lambda name, *rest, **options: names.append(name) or compile_module(name, *rest, **options)
dask.config.set(scheduler="synchronous")
pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
omega1 = da.ones((40, 100, 3), chunks=(4, 100, 3))
motion = hp.integrate(pair, np.linspace(0, 1, 100), omega1, 0.5, backend="compiled", outputs=("R2",))
for part in (motion.R2[:4], motion.R2):
    part.compute()
    print(len(names))
"""


@pytest.mark.slow
def test_kernels_are_compiled_once_for_all_chunks():
    """In a process of its own, since kernels that were compiled before are found again."""
    printed = subprocess.run([sys.executable, "-c", COUNT_KERNELS], capture_output=True, text=True, check=True).stdout
    of_one_chunk, of_all = map(int, printed.split())
    assert of_one_chunk == of_all > 0
