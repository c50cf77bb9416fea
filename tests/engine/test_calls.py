"""Calls: kernels read every layout and dtype, and every argument is looked at; what is refused writes nothing."""

from __future__ import annotations

import gc
import pickle
import sys
import threading
import time

import numpy as np
import pytest

from hingepair.engine import ufunc
from hingepair.engine.backend import Execution
from hingepair.engine.binding import bind, bind_constant
from hingepair.engine.calls import Call
from hingepair.engine.llvm import direct
from hingepair.engine.loops import Loop, Program
from hingepair.engine.results import Results
from hingepair.errors import ArgumentError, CompilationError
from hingepair.numeric.blocks import sine
from support.near import U, assert_near
from support.work import in_threads

GIVEN = {"unused": (2,), "m": (3, 3), "x": ()}
OUTPUTS = {"y": (3,), "trace": ()}


class Product(Results):
    """A result with one attribute, beside one that has only a name."""

    __slots__ = ("y",)


def product(v):
    m, x, (a, b, c) = v["m"], v["x"], v["k"]
    y = tuple(m[3 * i] * a + m[3 * i + 1] * b + m[3 * i + 2] * (c + x) for i in range(3))
    return {"y": y, "trace": m[0] + m[4] + m[8] - x, "checked": x}


LOOP = Loop("product", product, {"m": (3, 3), "k": (3,), "x": ()}, OUTPUTS)
LIMITED = Loop("product", product, {"m": (3, 3), "k": (3,), "x": ()}, {**OUTPUTS, "checked": ()})
CONSTANTS = {"k": (2.0, 0.0, 0.25)}


class RefusedError(ArgumentError):
    """Raised where a limit is passed."""


def refuse(values):
    raise RefusedError("x", "a number up to 1", values["x"])


def call(backend="compiled", limits=None):
    loop = LOOP if limits is None else LIMITED
    return Call(loop, GIVEN, CONSTANTS, Product, backend=backend, limits=limits, on_limit=refuse)


def arrays(lead):
    """Arguments with these leading shapes, in the order of GIVEN."""
    rng = np.random.default_rng(5)
    return [rng.normal(size=(*shape, *tail)) for shape, tail in zip(lead, GIVEN.values(), strict=True)]


def expected(unused, m, x):
    shape = np.broadcast_shapes(unused.shape[:-1], m.shape[:-2], np.shape(x))
    k = np.broadcast_to((2.0, 0.0, 0.25), (*shape, 3)).copy()
    k[..., 2] += x
    trace = np.trace(np.broadcast_to(m, (*shape, 3, 3)), axis1=-2, axis2=-1) - x
    return np.einsum("...ij,...j->...i", m, k), trace


REFUSED = {
    "a text": "rubbish",
    "nothing": None,
    "a list": [0.0, 0.0, 0.0],
    "one component more": np.zeros((9, 3)),
    "one component less": np.zeros((9, 1)),
    "no sample": np.zeros((0, 2)),
    "other samples": np.zeros((8, 2)),
    "a number for a vector": 1.0,
    "masked": np.ma.masked_array(np.zeros((9, 2)), True),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_an_argument_that_no_output_needs_is_looked_at_all_the_same(kind):
    _, m, x = arrays([(9,)] * 3)
    one = call()
    assert one.rows(np.zeros((9, 2)), m, x) is not None
    assert one.rows(REFUSED[kind], m, x) is None


def test_casts_of_large_batches_take_little_memory():
    tracemalloc = pytest.importorskip("tracemalloc")
    count = 1_000_000
    given = [np.zeros(2), np.ones((3, 3)), np.ones(count, np.int32)]
    y, trace = np.empty((count, 3)), np.empty(count)
    one = call()
    one.rows(*given, out={"y": y, "trace": trace})
    tracemalloc.start()
    one.rows(*given, out={"y": y, "trace": trace})
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 6e6
    assert (y[-1] == (3.25, 3.25, 3.25)).all()


def test_known_numbers_fold_and_those_in_arrays_are_parameters():
    assert bind_constant((3,), (0.0, 1.0, 2.5)) == ((0.0, 1.0, None), (2.5,))
    assert bind_constant((3,), np.array([0.0, 1.0, 2.5])) == ((None,) * 3, (0.0, 1.0, 2.5))
    assert bind_constant((3,), (np.array(3.0), -1.0, 0.5)) == ((None, -1.0, None), (3.0, 0.5))
    varying = np.zeros((4, 3))
    assert bind_constant((3,), varying) is varying
    assert bind((("k", (3,)), ("x", ())), {"k": (0.0, 2.5, varying[:, 0]), "x": varying[:, 1]}).numbers == [2.5]


@pytest.mark.parametrize("backend", ["auto", "numpy", "compiled"])
@pytest.mark.parametrize("lead", [(), (9,)], ids=["one", "many"])
def test_out_is_not_touched_by_a_call_that_is_refused(lead, backend):
    one, given = call(backend), arrays([lead] * 3)
    shapes, values = dict.fromkeys(GIVEN, lead), dict(zip(GIVEN, given, strict=True))
    y = np.full((*lead, 3), 7.0)
    frozen = y.copy()
    frozen.flags.writeable = False
    masked, matrix = np.ma.masked_array(y.copy(), True), np.zeros((9, 3)).view(np.matrix)
    both = np.full((*lead, 4), 7.0)
    unfit = [
        {"y": bad}
        for bad in (y[..., :2], y.astype(np.float32), y[None, None], frozen, y.tolist(), None, masked, matrix)
    ]
    over, kept = given[1].reshape(*lead, 9)[..., 1:4], given[1].copy()  # lies over an input
    for out in (*unfit, {"y": both[..., :3], "trace": both[..., 2]}, {"y": over}):
        for attempt in (lambda out=out: one.rows(*given, out=out), lambda out=out: one.run(values, shapes, out)):
            try:
                assert attempt() is None
            except ArgumentError as error:
                assert error.name.startswith("out[")  # noqa: PT017
                break
        else:
            pytest.fail("not refused")
    assert (y == 7).all()
    assert (both == 7).all()
    assert (masked.data == 7).all()
    assert (given[1] == kept).all()


@pytest.mark.parametrize("lead", [(), (9,)], ids=["one", "many"])
def test_values_beyond_a_limit_are_refused(lead):
    given = arrays([lead] * 3)
    limited, x, y = call(limits={"checked": {8: 1.0, 4: 1.0}}), np.full(lead, 0.5), np.empty((*lead, 3))
    shapes = dict.fromkeys(GIVEN, lead)
    for value in (np.nan, 0.5):
        x[...] = value
        assert limited.rows(*given[:2], x, out={"y": y}) is not None
    x.flat[-1] = 2.0
    for kind in (float, np.float32, np.int64):
        with pytest.raises(RefusedError):
            limited.rows(*given[:2], x.astype(kind))
    with pytest.raises(RefusedError):
        limited.rows(*given[:2], x, out={"y": y})
    with pytest.raises(RefusedError):
        limited.run({**dict(zip(GIVEN, given, strict=True)), "x": x}, shapes, {"y": y})


# ---- the ufunc


def guarded(shape, dtype):
    """An array between guard bytes."""
    room = np.full(int(np.prod(shape)) + 32, 7.0, dtype)
    return room[16:-16].reshape(shape), room


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("lead", [(), (1,), (11,), (3, 5)], ids=str)
def test_a_ufunc_writes_its_outputs_and_nothing_beside(lead, dtype):
    ufunc, given = call().ufunc, [a.astype(dtype) for a in arrays([lead] * 3)]
    assert ufunc.signature == "(2),(3,3),()->(3),()"
    assert ufunc.types == ["ddd->dd", "fff->ff"]
    (y, around_y), (trace, around_trace) = guarded((*lead, 3), dtype), guarded(lead, dtype)
    ufunc(*given, out=(y, trace))
    for found, wanted in zip((y, trace), expected(*given), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=8 * np.finfo(dtype).eps * np.abs(wanted).max())
    for room in (around_y, around_trace):
        assert (room[:16] == 7).all()
        assert (room[-16:] == 7).all()
    for k, tail in enumerate(GIVEN.values()):
        if tail:
            with pytest.raises(ValueError, match="core dimension"):
                ufunc(*given[:k], given[k][..., :-1], *given[k + 1 :])


def test_a_ufunc_lives_on_when_all_else_is_gone():
    loop = Loop("gone", product, dict(LOOP.inputs), OUTPUTS)
    ufunc, given = Call(loop, GIVEN, CONSTANTS, Product).ufunc, arrays([(5,)] * 3)
    before = ufunc(*given)
    loop.program.cache_clear()
    del loop
    gc.collect()
    for k in range(3):  # code that was freed is likely to be written over
        Call(
            Loop(f"other {k}", product, dict(LOOP.inputs), OUTPUTS), GIVEN, {"k": (3.0, 2.0, 1.0)}, Product
        ).compile()
    for found, wanted in zip(ufunc(*given), before, strict=True):
        np.testing.assert_array_equal(found, wanted)
    assert ufunc.__name__ == "gone"
    with pytest.raises((pickle.PicklingError, AttributeError)):
        pickle.dumps(ufunc)


@pytest.mark.parametrize("count", [1, 5, 8, 13])
def test_no_numbers_raise_no_flags_and_stay_in_their_sample(count):
    one, given = call(), arrays([(count,)] * 3)
    given[1][0] = np.nan
    given[2][0] = np.inf
    with np.errstate(all="raise"):
        assert np.isnan(one.rows(*(a[0] for a in given)).y).all()
        for y in (one.rows(*given).y, one.ufunc(*given)[0]):
            assert np.isnan(y[0]).all()
            if count > 1:
                np.testing.assert_array_equal(y[1:], one.rows(*(a[1:] for a in given)).y)
    with np.errstate(divide="warn"), pytest.warns(RuntimeWarning):
        np.float64(1.0) / np.zeros(1)  # flags of the caller work as before


def test_few_samples_of_a_shared_call_do_not_depend_on_constants():
    """Pairs share one kernel; it gives what their own kernels give."""
    loop = Loop("shared", product, dict(LOOP.inputs), OUTPUTS)
    given, sizes = arrays([(50,)] * 3), []
    for k in ((2.0, 0.0, 0.25), (1.0, 1.0, -1.0), (0.0, 0.5, 0.0)):
        one, own = (Call(loop, GIVEN, {"k": k}, Product, shared=shared) for shared in (True, False))
        found = one.rows(*given)
        sizes.append(loop.program.cache_info().currsize)
        np.testing.assert_allclose(found.y, own.rows(*given).y, rtol=4 * U, atol=4 * U)
    assert sizes[0] == 1


def test_threads_that_compile_at_once_get_one_kernel():
    loop = Loop("own", product, dict(LOOP.inputs), OUTPUTS)
    given, made, gate = arrays([(50,)] * 3), [], threading.Barrier(4)

    def work(_):
        gate.wait()
        one = Call(loop, GIVEN, CONSTANTS, Product, backend="compiled")
        for _ in range(50):
            made.append((id(one.machine_code("d").kernel), one.rows(*given).y))

    in_threads(work, 4)
    assert len({kernel for kernel, _ in made}) == 1
    for _, y in made:
        np.testing.assert_array_equal(y, made[0][1])


UNFIT = {
    "strided": lambda a: np.repeat(a, 2, axis=-1)[..., ::2],
    "float32": lambda a: a.astype(np.float32),
    "swapped": lambda a: a.astype(">f8"),
    "misaligned": lambda a: np.frombuffer(b" " + a.tobytes(), np.uint8)[1:].view(np.float64).reshape(a.shape),
    "a subclass": lambda a: a.view(np.recarray),
    "other samples": lambda a: np.concatenate([a, a]),
    "one component less": lambda a: np.ascontiguousarray(a[..., 1:]),
    "no samples": lambda a: a[:0],
    "a list": lambda a: a.tolist(),
    "many samples": lambda a: np.repeat(a, 1000, axis=0),
}


@pytest.mark.parametrize("place", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("kind", UNFIT)
def test_direct_calls_take_what_fits_and_leave_the_rest_alone(kind, place):
    """Arguments and arrays to write into: whatever else they are, nothing is written."""
    code, lead = call().machine_code("d"), (9,)
    make, fill = direct.direct_calls(code, "d", 50, freeze=True)
    given, out = arrays([lead] * 3), [np.full((*lead, 3), 7.0), np.full(lead, 7.0)]
    made = make(*given)
    for found, wanted in zip(made, expected(*given), strict=True):
        assert_near(found, wanted, 16)
        assert (found.shape, found.flags.writeable, found.flags.owndata) == (wanted.shape, False, True)
    values = [*given, *out]
    values[place] = UNFIT[kind](values[place])
    if place < 3 and kind != "no samples":
        assert make(*values[:3]) is None
    assert fill(*values) is None
    assert (np.asarray(values[3]) == 7).all()
    assert (np.asarray(values[4]) == 7).all()
    assert fill(*given, *out)[0] is out[0]
    np.testing.assert_array_equal(out[0], made[0])


def test_direct_calls_broadcast_single_samples_and_refuse_shared_memory():
    code = call().machine_code("d")
    make, fill = direct.direct_calls(code, "d", 50, freeze=False)
    given = [np.ones((4, 2)), np.eye(3), np.arange(4.0)]
    y, trace = make(*given)
    assert_near(y, expected(*given)[0], 16)
    assert trace.flags.writeable
    memory = np.zeros(20)
    y, trace = memory[:12].reshape(4, 3), memory[12:16]
    assert fill(*given, y, trace) is not None  # side by side
    for other in (memory[11:15], given[2]):
        assert fill(*given, y, other) is None
    y.flags.writeable = False
    assert fill(*given, y, trace) is None
    assert make(*given[:2]) is make(*given, y) is make() is None


def test_a_long_call_lets_other_threads_go_on():
    """No thread is asked to make room: only a call that releases the interpreter's lock lets another one count."""
    one, count, stop = call(), [0], threading.Event()
    given = arrays([(30_000,)] * 3)

    def counting():
        while not stop.is_set():
            count[0] += 1
            time.sleep(1e-6)  # gives the lock away

    thread, interval = threading.Thread(target=counting), sys.getswitchinterval()
    one.rows(*given)
    sys.setswitchinterval(1000)
    try:
        thread.start()
        for _ in range(20_000):  # some seconds, in which a busy machine finds time for the other thread
            before = count[0]
            one.rows(*given)
            if count[0] > before:
                break
        assert count[0] > before
    finally:
        sys.setswitchinterval(interval)
        stop.set()
        thread.join()


@pytest.mark.parametrize("backend", ["auto", "numpy", "compiled"])
def test_a_chosen_backend_gives_the_same_bits_at_every_call(backend):
    loop = Loop("bits", lambda v: {"s": sine(v["a"]) * v["a"] + 1.0}, {"a": ()}, {"s": ()})
    one = Call(loop, {"a": ()}, {}, Results, backend=backend)
    a = np.linspace(-3, 3, 40)

    def found():
        return [
            *(one.run({"a": a[:count]}, {"a": (count,)})["s"] for count in (1, 3, 40)),
            *(one.run({"a": x}, {"a": ()})["s"] for x in a),
        ]

    first = found()
    for other in ("compiled", "numpy"):
        loop.run({"a": a}, {"s": np.empty(40)}, (40,), np.dtype(float), Execution(other, 1))
    for one_result, before in zip(found(), first, strict=True):
        np.testing.assert_array_equal(one_result, before)


def test_a_kernel_that_llvm_refuses_is_an_error_and_leaves_the_others_alone(monkeypatch):
    written = Program.llvm_ir

    def broken(self, *key):
        return "no code" if self.loop.name == "broken" else written(self, *key)

    monkeypatch.setattr(Program, "llvm_ir", broken)
    given = arrays([(400,)] * 3)
    loop, other = (Loop(name, product, dict(LOOP.inputs), OUTPUTS) for name in ("broken", "other"))
    for backend in ("compiled", "auto"):
        with pytest.raises(CompilationError, match="'broken'"):
            Call(loop, GIVEN, CONSTANTS, Product, backend=backend).rows(*given)
    found = Call(loop, GIVEN, CONSTANTS, Product, backend="numpy").rows(*given)
    assert_near(found.y, expected(*given)[0], 16)
    assert Call(other, GIVEN, CONSTANTS, Product, backend="compiled").rows(*given) is not None


@pytest.mark.parametrize("count", [9, 3_000, 60_000])
def test_an_output_that_is_kept_does_not_hold_the_others(count):
    given = arrays([(count,)] * 3)
    for state in (
        call().rows(*given),
        call().run(dict(zip(GIVEN, given, strict=True)), dict.fromkeys(GIVEN, (count,))),
    ):
        owner = state["trace"]
        while isinstance(owner.base, np.ndarray):
            owner = owner.base
        assert owner.nbytes == state["trace"].nbytes


def test_without_numpys_tables_of_functions_kernels_compute_and_there_is_no_ufunc(monkeypatch):
    for module in (direct, ufunc):
        monkeypatch.setattr(module, "numpy_function", lambda *_: 0)
    loop, given = Loop("fresh", product, dict(LOOP.inputs), OUTPUTS), arrays([(4,)] * 3)
    one = Call(loop, GIVEN, CONSTANTS, Product, backend="compiled")
    assert_near(one.rows(*given).y, expected(*given)[0], 16)
    with pytest.raises(CompilationError, match="NumPy"):
        _ = one.ufunc
