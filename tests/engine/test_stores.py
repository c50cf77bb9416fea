"""Kernels write every sample where it belongs and nothing beside, at any offset, width, count and thread."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from hingepair.engine.backend import Execution
from hingepair.engine.llvm import arithmetic, ir, kernels, schedule
from hingepair.engine.llvm.builder import CACHE_LINE
from hingepair.engine.llvm.memory import MAX_STREAMED
from hingepair.engine.llvm.schedule import MAX_NARROW
from hingepair.engine.loops import Loop
from hingepair.engine.trace import square_root, where_less

F8, F4 = np.dtype(np.float64), np.dtype(np.float32)
GUARD = 7.0
LEAST_BYTES = {"streamed": 0, "plain": 2**62}
FAST_WIDTHS = {1, 3, 8, MAX_NARROW, MAX_NARROW + 1, 24, 67, MAX_STREAMED + 1}
WIDTHS = sorted({*range(1, 41, 3), *FAST_WIDTHS, 64, 300, MAX_STREAMED, 600})
SHIFTS = (0, 8, 16, 32, 56)


@pytest.fixture(params=LEAST_BYTES)
def stores(request, monkeypatch):
    monkeypatch.setattr(ir, "MIN_STREAMED_BYTES", LEAST_BYTES[request.param])
    return request.param


@functools.cache
def doubled(width, stores):  # noqa: ARG001 (each way to store has kernels of its own)
    return Loop("doubled", lambda v: {"b": tuple(2 * x for x in v["a"])}, {"a": (width,)}, {"b": (width,)})


def room_of(count, shift, dtype):
    """An array full of guards, and where in it lie `count` elements that start so many bytes behind a cache line."""
    lines = CACHE_LINE // dtype.itemsize
    room = np.full(count + 3 * lines, GUARD, dtype)
    start = (-room.ctypes.data % CACHE_LINE + shift) // dtype.itemsize + lines
    return room, slice(start, start + count)


def check_doubled(loop, shape, cut, shift, dtype, workers=1):
    """What is written into a part of an array is right, and the rest of the array is as it was."""
    room, place = room_of(int(np.prod(shape)), shift, dtype)
    out = room[place].reshape(shape)[cut]
    a = np.random.default_rng(out.size).normal(size=out.shape).astype(dtype)
    loop.run({"a": a}, {"b": out}, out.shape[:-1], dtype, Execution("compiled", workers))
    np.testing.assert_array_equal(out, 2 * a)
    out[...] = GUARD
    assert (room == GUARD).all()


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [F8, F4], ids=str)
def test_every_width_at_every_offset(dtype, stores):
    for width in WIDTHS if dtype == F8 else FAST_WIDTHS:
        for shift in (*SHIFTS, dtype.itemsize):
            for samples in (1, 7, 8, 9, 43):
                check_doubled(doubled(width, stores), (samples, width), ..., shift, dtype)


@pytest.mark.parametrize("width", [3, 20, 37])
def test_threads_share_cache_lines(width, stores, monkeypatch):
    """Where the samples of one thread end amid a line, the other thread's begin."""
    monkeypatch.setattr(kernels, "_MIN_WORK", 1)
    for shift in SHIFTS:
        check_doubled(doubled(width, stores), (1003, width), ..., shift, F8, workers=3)


CUTS = {
    "the last axis cut": np.s_[:, :7, :16],
    "samples left out": np.s_[:, :, ::2],
    "rows left out": np.s_[::2],
    "samples backward": np.s_[:, :, ::-1],
    "components left out": np.s_[..., ::2],
}


@pytest.mark.slow
@pytest.mark.parametrize("cut", CUTS.values(), ids=CUTS)
@pytest.mark.parametrize("width", [2, 36, 2 * MAX_STREAMED + 20])
def test_outputs_of_any_layout(cut, width, stores):
    for shift in (0, 16):
        shape = (3, 8, 17, width)
        count = np.empty(shape)[cut].shape[-1]
        check_doubled(doubled(count, stores), shape, cut, shift, F8)


@pytest.mark.parametrize("width", [5, 20])
def test_an_output_may_lie_over_the_input(width, stores):
    a = np.random.default_rng(0).normal(size=(43, width))
    out = a.copy()
    doubled(width, stores).run({"a": out}, {"b": out}, (43,), F8, Execution("compiled", 1))
    np.testing.assert_array_equal(out, 2 * a)


def test_wide_outputs_of_constants_and_of_one_value_twice(stores):
    def filled(v):
        x = v["x"]
        return {"y": (0.0,) * 9 + (x, x, -1.5, 0.0) + (1.0,) * 16 + (x * x, x) + (2.5,) * 11}

    loop = Loop(f"filled {stores}", filled, {"x": ()}, {"y": (42,)})
    x, y = np.random.default_rng(1).normal(size=43), np.full((43, 42), GUARD)
    loop.run({"x": x}, {"y": y}, (43,), F8, Execution("compiled", 1))
    np.testing.assert_array_equal(y, np.stack([np.broadcast_to(c, 43) for c in filled({"x": x})["y"]], axis=-1))


@pytest.mark.parametrize("dtype", [F8, F4], ids=str)
@pytest.mark.parametrize("width", [3, 20])
@pytest.mark.parametrize("count", [7, 43])
def test_inputs_are_read_in_any_order(width, count, dtype):
    """As rows, as columns, backwards, one in three, and unaligned."""
    rows = np.random.default_rng(6).normal(size=(count, width)).astype(dtype)
    room = np.zeros(rows.nbytes + 1, np.uint8)
    unaligned = room[1:].view(dtype).reshape(width, count).T
    unaligned[...] = rows
    layouts = {
        "columns": np.asfortranarray(rows),
        "backwards": np.asfortranarray(rows[::-1])[::-1],
        "one in three": np.repeat(rows, 3, axis=0)[::3],
        "unaligned": unaligned,
    }
    for name, a in layouts.items():
        b = np.full((count, width), GUARD, dtype)
        doubled(width, "any").run({"a": a}, {"b": b}, (count,), dtype, Execution("compiled", 1))
        np.testing.assert_array_equal(b, 2 * rows, err_msg=name)


def long_function(v):
    """Values that live long and short ones, sines of sines, inputs that are read late, still and moving."""
    *x, y, z = v["x"]
    early = [x[0] * v["c"], x[1] * v["c"], square_root(v["c"] * v["c"] + 1.0), v["c"].sine()]
    turn = (x[2] * early[3]).sine() + x[2].cosine()
    chain, seen = turn, []
    for k in range(60):
        chain = chain * 0.5 + x[k % 18] * early[k % 4]
        if k % 3 == 0:
            seen.append(chain)
    last = where_less(chain, y, (chain * z).versine(), early[0] - z)
    return {"seen": tuple(seen), "narrow": (early[0], last, turn), "wide": (*seen, last, z, early[2], 1.0)}


@pytest.mark.parametrize("dtype", [F8, F4], ids=str)
def test_constants_are_numbers_and_vectors(dtype):
    """Also where sines are taken of them, and where they are components of a wide output."""
    count = MAX_NARROW + 1

    def function(v):
        a, b, *c = v["c"]
        x = v["x"]
        return {"y": (a.sine() * x, b * x + c[0], *c[: count - 2]), "z": (x * c[-1], b)}

    constants = np.random.default_rng(4).normal(size=count + 2).tolist()
    x = np.random.default_rng(5).normal(size=19).astype(dtype)
    y, z = np.full((19, count), GUARD, dtype), np.full((19, 2), GUARD, dtype)
    loop = Loop("shared", function, {"x": (), "c": (count + 2,)}, {"y": (count,), "z": (2,)})
    loop.run({"x": x, "c": tuple(constants)}, {"y": y, "z": z}, (19,), dtype, Execution("compiled", 1))
    a, b, *c = constants
    expected = [np.sin(a) * x, b * x + c[0], *(np.full(19, number) for number in c[: count - 2])]
    eps = np.finfo(dtype).eps
    np.testing.assert_allclose(y, np.stack(expected, axis=-1), rtol=4 * eps, atol=4 * eps)
    np.testing.assert_array_equal(z, np.stack([x * dtype.type(c[-1]), np.full(19, b, dtype)], axis=-1))


def run_long(values, samples):
    loop = Loop("long", long_function, {"x": (20,), "c": ()}, {"seen": (20,), "narrow": (3,), "wide": (24,)})
    out = {name: np.full((samples, *tail), GUARD) for name, tail in loop.outputs}
    loop.run(values, out, (samples,), F8, Execution("compiled", 1))
    return out


@pytest.mark.slow
@pytest.mark.parametrize("length", [1, 2, 7, 30])
@pytest.mark.parametrize("distance", [0, 1000])
@pytest.mark.parametrize("still", [True, False], ids=["still", "moving"])
def test_a_program_in_parts_gives_the_bits_of_the_whole(length, distance, still, monkeypatch):
    rng = np.random.default_rng(2)
    values = {"x": rng.normal(size=(19, 20)), "c": 0.3 if still else rng.normal(size=19)}
    whole = run_long(values, 19)
    monkeypatch.setattr(schedule, "_UNSPLIT", 0)
    monkeypatch.setattr(schedule, "_SPLIT", length)
    monkeypatch.setattr(arithmetic, "_MAX_AGE", distance)
    for name, array in run_long(values, 19).items():
        np.testing.assert_array_equal(array, whole[name])
