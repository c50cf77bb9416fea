"""Loops: NumPy and compiled code agree for every size, layout and dtype."""

from __future__ import annotations

import platform

import numpy as np
import pytest

from hingepair.engine.backend import Execution
from hingepair.engine.llvm import kernels, native
from hingepair.engine.llvm.ir import LANES
from hingepair.engine.loops import Loop
from hingepair.engine.trace import arc_tangent, hypotenuse, square_root, where_less
from hingepair.equations import spatial as eq
from hingepair.errors import ShapeError
from support.sparse import sparse

F8, F4 = np.dtype(np.float64), np.dtype(np.float32)
NUMPY, COMPILED = Execution("numpy", 1), Execution("compiled", 1)


def turned(v):
    x, y, z = v["u"]
    turn = v["angle"]
    length = square_root(eq.dot(v["u"], v["u"]) + v["more"])
    big = where_less(length, 2.0, (x, y), (z, length))
    return {
        "r": (x * turn.cosine() - y * turn.sine(), x * turn.sine() + y * turn.cosine(), z * turn.versine()),
        "length": length / (1.0 + turn * turn) + (x * y - z),
        "m": (*big, arc_tangent(y, x), hypotenuse(z, x)),
    }


MAP = Loop("turned", turned, {"u": (3,), "angle": (), "more": ()}, {"r": (3,), "length": (), "m": (2, 2)})


def run(loop, values, shape, dtype=F8, execution=COMPILED, out=None):
    out = out or {name: np.full((*shape, *tail), np.nan, dtype) for name, tail in loop.outputs}
    loop.run(values, out, shape, dtype, execution)
    return out


def agree(a, b, dtype=F8):
    for name in a:
        np.testing.assert_allclose(
            a[name], b[name], rtol=0, atol=8 * np.finfo(dtype).eps * (1 + np.abs(a[name]).max())
        )


def given(count, dtype=F8, seed=0):
    rng = np.random.default_rng(seed)
    return {
        "u": rng.normal(size=(count, 3)).astype(dtype),
        "angle": rng.uniform(-9, 9, count).astype(dtype),
        "more": 0.5,
    }


@pytest.mark.parametrize("dtype", [F8, F4], ids=str)
@pytest.mark.parametrize("count", [1, 2, 7, LANES, 9, 15, 16, 17, 1000])
def test_every_count(count, dtype):
    values = given(count, dtype)
    room = {name: np.full((count + 2, *tail), 7.0, dtype) for name, tail in MAP.outputs}
    found = run(MAP, values, (count,), dtype, out={name: array[1:-1] for name, array in room.items()})
    agree(run(MAP, values, (count,), dtype, NUMPY), found, dtype)
    assert all((array[[0, -1]] == 7.0).all() for array in room.values())


def test_lanes_do_not_know_of_each_other():
    values = given(40)
    whole = run(MAP, values, (40,))
    for start in range(3):
        for stop in range(start + 2, 27):
            part = {"u": values["u"][start:stop], "angle": values["angle"][start:stop], "more": 0.5}
            for name, array in run(MAP, part, (stop - start,)).items():
                np.testing.assert_array_equal(array, whole[name][start:stop])


CPUS = {
    "with AVX2": ("haswell", "+fma"),
    "without fused arithmetic": ("x86-64", ""),
    "with AVX-512": ("skylake-avx512", "+fma"),
}


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() not in {"x86_64", "AMD64"}, reason="names of processors of one kind")
@pytest.mark.parametrize("kind", sparse(CPUS, 3))
def test_other_processors(monkeypatch, kind):
    processor = CPUS[kind]
    """Code for a processor with fewer features runs here, and gives the same numbers."""
    needed = {"haswell": "+avx2", "skylake-avx512": "+avx512f", "x86-64": ""}[processor[0]]
    if needed not in native.host_processor()[1]:
        pytest.skip("this processor cannot run it")
    monkeypatch.setattr(native, "host_processor", lambda: processor)
    native.can_fuse.cache_clear()
    try:
        loop = Loop("turned", turned, dict(MAP.inputs), dict(MAP.outputs))
        values = given(41)
        values["angle"][[3, 20, 40]] = 1e300, 2e7, -1e7
        agree(run(loop, values, (41,), execution=NUMPY), run(loop, values, (41,)))
        single = given(41, F4)
        agree(run(loop, single, (41,), F4, NUMPY), run(loop, single, (41,), F4), F4)
    finally:
        monkeypatch.undo()
        native.can_fuse.cache_clear()


SHAPES = [
    ((3000, 1), (1, 2)),
    ((1, 2), (3000, 1)),
    ((5, 1), (1, 4)),
    ((2, 1, 700), (3, 1)),
    ((4, 4), (4, 4)),
    ((40, 1, 2), (3, 1)),
]


@pytest.mark.parametrize(("one", "other"), SHAPES, ids=str)
@pytest.mark.parametrize("workers", [1, 2])
def test_axes_that_do_not_fill_the_lanes(one, other, workers, monkeypatch):
    monkeypatch.setattr(kernels, "_MIN_WORK", 1)
    rng = np.random.default_rng(6)
    values = {"u": rng.normal(size=(*one, 3)), "angle": rng.normal(size=other), "more": 0.5}
    shape = np.broadcast_shapes(one, other)
    whole = {
        "u": np.broadcast_to(values["u"], (*shape, 3)).copy(),
        "angle": np.broadcast_to(values["angle"], shape).copy(),
        "more": 0.5,
    }
    expected, found = run(MAP, whole, shape), run(MAP, values, shape, execution=Execution("compiled", workers))
    for name, array in found.items():
        np.testing.assert_array_equal(array, expected[name])


@pytest.mark.parametrize("dtype", [F4, F8], ids=str)
@pytest.mark.parametrize(("inputs", "outputs"), [(70, 1), (2, 70), (40, 40)])
def test_more_arrays_than_a_ufunc_takes(inputs, outputs, dtype):
    names = [f"x{k}" for k in range(inputs)]

    def function(v):
        total = sum(v[name] * (k + 1.0) for k, name in enumerate(names))
        return {"y": (total, 2.0 * total, total, total)} | {f"z{k}": total * (k + 2.0) for k in range(1, outputs)}

    shapes = {"y": (2, 2)} | {f"z{k}": () for k in range(1, outputs)}
    loop = Loop("sum", function, dict.fromkeys(names, ()), shapes)
    values = {name: np.arange(50.0).reshape(10, 5)[:: 1 + 9 * (k % 2)] * k for k, name in enumerate(names)}
    found, expected = (run(loop, values, (10, 5), dtype, execution) for execution in (COMPILED, NUMPY))
    for name, array in found.items():
        np.testing.assert_allclose(array, expected[name], rtol=(inputs + 2) * np.finfo(dtype).eps)


@pytest.mark.parametrize("tail", [(), (2,), (4,), (3, 3)])
@pytest.mark.parametrize("execution", [NUMPY, COMPILED], ids=["numpy", "compiled"])
def test_results_of_another_shape_than_the_output_are_refused(tail, execution):
    loop = Loop("doubled", lambda v: {"y": tuple(2.0 * x for x in v["x"])}, {"x": (3,)}, {"y": tail})
    with pytest.raises(ShapeError, match="y: expected"):
        run(loop, {"x": np.ones((5, 3))}, (5,), execution=execution)
