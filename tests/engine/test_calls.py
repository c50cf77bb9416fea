"""Calls: the quick way gives what the general way gives, looks at every argument, and lets other threads go on."""

from __future__ import annotations

import itertools
import sys
import threading
import time

import numpy as np
import pytest

from hingepair.engine.array_reader import MAX_SAMPLE_RANK_READ_BY_MACHINE_CODE
from hingepair.engine.backend import BreakEvenCounter, Execution
from hingepair.engine.binding import bind, bind_constant
from hingepair.engine.calls import Call
from hingepair.engine.loops import Loop, Program
from hingepair.engine.results import Results, writable_arrays
from hingepair.errors import ArgumentError, CompilationError, ShapeError

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


LEADS = [(), (1,), (7,), (64,)]


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize("lead", [list(leads) for leads in itertools.product(LEADS, repeat=3)], ids=str)
def test_a_quick_call_gives_what_the_general_way_gives(lead, backend):
    one, given = call(backend), arrays(lead)
    shapes = dict(zip(GIVEN, lead, strict=True))
    values = dict(zip(GIVEN, given, strict=True))
    try:
        shape = np.broadcast_shapes(*lead)
    except ValueError:
        assert one.fast_path(*given) is None
        with pytest.raises(ShapeError):
            one.run(values, shapes)
        return
    y, trace = expected(*given)
    quick = one.fast_path(*given)
    assert (quick is not None) == (backend == "compiled" or shape == ())
    for state in filter(None, (quick, one.run(values, shapes))):
        assert state.shape == shape
        assert state.outputs == ("y", "trace")
        np.testing.assert_allclose(state.y, y, rtol=1e-14, atol=1e-14)
        np.testing.assert_allclose(state["trace"], trace, rtol=1e-14, atol=1e-14)
        assert state.y.shape == y.shape
        assert np.shape(state["trace"]) == shape
        assert not state.y.flags.writeable
    if quick is not None and backend == "compiled":
        threads = one.run(values, shapes, workers=2)
        np.testing.assert_array_equal(quick.y, threads.y)


LAYOUTS = {
    "every other": lambda a: np.repeat(a, 2, axis=0)[::2],
    "backwards": lambda a: a[::-1].copy()[::-1],
    "one for all": lambda a: np.broadcast_to(a[:1], a.shape),
    "spread components": lambda a: np.repeat(a, 3, axis=-1)[..., ::3] if a.ndim > 1 else a,
    "columns": np.asfortranarray,
    "float32": lambda a: a.astype(np.float32),
    "other byte order": lambda a: a.astype(">f8"),
    "integers": lambda a: np.rint(a * 10).astype(int),
    "a class of its own": lambda a: a.view(type("Own", (np.ndarray,), {})),
}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("place", range(3))
def test_every_layout_is_read_where_it_lies_or_left_to_the_general_way(layout, place):
    one, given = call(), arrays([(9,)] * 3)
    given[place] = LAYOUTS[layout](given[place])
    y, trace = expected(*(np.asarray(a, float) for a in given))
    quick = one.fast_path(*given)
    state = quick or one.run(dict(zip(GIVEN, given, strict=True)), dict.fromkeys(GIVEN, (9,)))
    np.testing.assert_allclose(state.y, y, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(state["trace"], trace, rtol=1e-13, atol=1e-13)


REFUSED = {
    "a text": "rubbish",
    "nothing": None,
    "a list": [0.0, 0.0],
    "one component more": np.zeros((9, 3)),
    "one component less": np.zeros((9, 1)),
    "no sample": np.zeros((0, 2)),
    "two axes of samples": np.zeros((3, 3, 2)),
    "other samples": np.zeros((8, 2)),
    "a number for a vector": 1.0,
}


@pytest.mark.parametrize("kind", REFUSED)
def test_an_argument_that_no_output_needs_is_looked_at_all_the_same(kind):
    _, m, x = arrays([(9,)] * 3)
    one = call()
    assert one.fast_path(np.zeros((9, 2)), m, x) is not None
    assert one.fast_path(REFUSED[kind], m, x) is None


def test_numbers_beside_arrays():
    unused, m, _ = arrays([(), (4,), ()])
    for x in (0.5, np.float64(0.5), np.array(0.5)):
        np.testing.assert_array_equal(
            call().fast_path(unused, m, x).y, call().fast_path(unused, m, np.full(4, 0.5)).y
        )


def test_large_batches_go_the_quick_way():
    one, given = call(), arrays([(70_000,)] * 3)
    state = one.fast_path(*given)
    y, trace = expected(*given)
    np.testing.assert_allclose(state.y, y, atol=1e-14)
    out = np.empty_like(y)
    assert np.shares_memory(one.run_into(given, {"y": out}).y, out)
    np.testing.assert_array_equal(out, state.y)
    np.testing.assert_allclose(state["trace"], trace, atol=1e-14)


@pytest.mark.parametrize("lead", [(2,), (3_000,)], ids=["few", "many"])
def test_a_batch_is_counted_once_towards_the_price_of_its_kernel(lead, monkeypatch):
    counted = []
    monkeypatch.setattr(
        BreakEvenCounter, "count_call", lambda _, samples, chain_length=1: counted.append((samples, chain_length))
    )
    one = Call(Loop("counted", product, {"m": (3, 3), "k": (3,), "x": ()}, OUTPUTS), GIVEN, CONSTANTS, Product)
    one.run(dict(zip(GIVEN, arrays([lead] * 3), strict=True)), dict.fromkeys(GIVEN, lead))
    assert counted == [(lead[0], 1)]


class Counted(tuple):
    """A tuple that counts how often it is gone through."""

    count = 0

    def __iter__(self):
        Counted.count += 1
        return super().__iter__()


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_constants_are_sorted_once_for_all_calls(backend):
    one, lead = Call(LOOP, GIVEN, {"k": Counted((2.0, 0.0, 0.25))}, Product, backend=backend), (2, 3)
    given = arrays([lead] * 3)
    Counted.count = 0
    state = one.run(dict(zip(GIVEN, given, strict=True)), dict.fromkeys(GIVEN, lead))
    assert Counted.count == 0
    np.testing.assert_allclose(state.y, expected(*given)[0], atol=1e-14)


@pytest.mark.parametrize("value", [(0.0, 1.0, 2.5), np.array([0.0, 1.0, 2.5]), (np.array(3.0), -1.0, 0.5)], ids=repr)
@pytest.mark.parametrize("moving", [False, True])
def test_constants_that_were_sorted_once_are_bound_as_they_are(value, moving):
    spec = (("k", (3,)), ("x", ()))
    once = bind_constant("k", (3,), value)
    x = np.ones(4)
    plain, other = (bind(spec, {"k": k, "x": x}, keep_single_samples=moving) for k in (value, once))
    assert (plain.pattern, plain.constants) == (other.pattern, other.constants)
    assert len(plain.arrays) == len(other.arrays)


@pytest.mark.parametrize("lead", [(), (9,)], ids=["one", "many"])
def test_outputs_are_written_in_place(lead):
    one, given = call(), arrays([lead] * 3)
    y = np.full((*lead, 3, 2), np.nan)[..., 0]  # components two numbers apart
    state = one.run_into(given, {"y": y})
    np.testing.assert_array_equal(y, one.fast_path(*given).y)
    np.testing.assert_array_equal(state["trace"], one.fast_path(*given)["trace"])
    assert np.shares_memory(state.y, y)
    assert not state.y.flags.writeable
    assert y.flags.writeable


@pytest.mark.parametrize("lead", [(), (9,)], ids=["one", "many"])
def test_outputs_are_not_touched_by_a_call_that_is_refused(lead):
    given = arrays([lead] * 3)
    y = np.full((*lead, 3), 7.0)
    limited = call(limits={"checked": {8: 1.0}})
    x = np.full(lead, 0.5)
    assert limited.run_into((*given[:2], x), {"y": y.copy()}) is not None
    x[...] = np.nan
    assert limited.run_into((*given[:2], x), {"y": y.copy()}) is not None
    x.flat[-1] = 2.0
    with pytest.raises(RefusedError):
        limited.run_into((*given[:2], x), {"y": y})
    with pytest.raises(RefusedError):
        limited.run({**dict(zip(GIVEN, given, strict=True)), "x": x}, dict.fromkeys(GIVEN, lead), {"y": y})
    with pytest.raises(RefusedError):
        limited.fast_path(*given[:2], x)
    one = call()
    frozen = y.copy()
    frozen.flags.writeable = False
    for bad in (y[..., :2], y.astype(np.float32), y[None, None], frozen, y.tolist(), None):
        assert one.run_into(given, {"y": bad}) is None
    memory = np.arange(200.0)
    m, over = (memory[at : at + 9 * (9 if lead else 1)] for at in (0, 3))
    size = 3 * (9 if lead else 1)
    m, over = m.reshape(*lead, 3, 3), over[:size].reshape(*lead, 3)
    assert one.run_into((given[0], m, given[2]), {"y": over}) is None
    np.testing.assert_array_equal(memory, np.arange(200.0))
    both = np.full((*lead, 4), 7.0)
    assert one.run_into(given, {"y": both[..., :3], "trace": both[..., 2]}) is None
    assert (both == 7).all()
    assert (y == 7).all()


def test_threads_that_compile_at_once_get_one_kernel():
    loop = Loop("own", product, dict(LOOP.inputs), OUTPUTS)
    given, made, gate = arrays([(50,)] * 3), [], threading.Barrier(4)

    def work():
        gate.wait()
        one = Call(loop, GIVEN, CONSTANTS, Product, backend="compiled")
        for _ in range(50):
            made.append((one.kernel, one.fast_path(*given).y))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({id(kernel) for kernel, _ in made}) == 1
    for _, y in made:
        np.testing.assert_array_equal(y, made[0][1])


def test_a_quick_call_owns_its_machine_code():
    """The loop, its program and its kernel may be gone: what can be called still runs."""
    loop = Loop("gone", product, dict(LOOP.inputs), OUTPUTS)
    one, given = Call(loop, GIVEN, CONSTANTS, Product, backend="compiled"), arrays([(5,)] * 3)
    quick, before = one.fast_path, one.fast_path(*given).y.copy()
    loop.program.cache_clear()
    del loop, one
    for _ in range(3):  # code that was freed is likely to be written over
        Call(Loop("other", product, dict(LOOP.inputs), OUTPUTS), GIVEN, CONSTANTS, Product, backend="compiled")
    np.testing.assert_array_equal(quick(*given).y, before)


def test_a_long_call_lets_other_threads_go_on():
    """No thread is asked to make room: only a call that releases the interpreter's lock lets another one count."""
    one, count, stop = call(), [0], threading.Event()
    given = arrays([(30_000,)] * 3)

    def counting():
        while not stop.is_set():
            count[0] += 1
            time.sleep(1e-6)  # gives the lock away

    thread, interval = threading.Thread(target=counting), sys.getswitchinterval()
    one.fast_path(*given)
    sys.setswitchinterval(1000)
    try:
        thread.start()
        for _ in range(20_000):  # some seconds, in which a busy machine finds time for the other thread
            before = count[0]
            one.fast_path(*given)
            if count[0] > before:
                break
        assert count[0] > before
    finally:
        sys.setswitchinterval(interval)
        stop.set()
        thread.join()


def test_more_axes_than_the_code_reads_go_the_general_way():
    tail = (2,) * (MAX_SAMPLE_RANK_READ_BY_MACHINE_CODE + 1)
    loop = Loop("deep", lambda v: {"b": tuple(2.0 * c for c in v["a"])}, {"a": tail}, {"b": tail})
    a = np.random.default_rng(6).normal(size=(5, *tail))
    state = Call(loop, {"a": tail}, {}, Results, backend="compiled").run({"a": a}, {"a": (5,)})
    np.testing.assert_array_equal(state["b"], 2 * a)


@pytest.mark.parametrize("backend", ["auto", "numpy", "compiled"])
def test_a_chosen_backend_gives_the_same_bits_at_every_call(backend):
    loop = Loop(
        "bits", lambda v: {"s": v["a"].sine() * v["a"] + 1.0} if hasattr(v["a"], "sine") else {}, {"a": ()}, {"s": ()}
    )
    one = Call(loop, {"a": ()}, {}, Results, backend=backend)
    a = np.linspace(-3, 3, 40)
    first = [one.run({"a": a[:count]}, {"a": (count,)})["s"] for count in (1, 3, 40)]
    single = [one.run({"a": x}, {"a": ()})["s"] for x in a]
    loop.run({"a": a}, {"s": np.empty(40)}, (40,), np.dtype(float), Execution("compiled", 1))
    if backend != "auto":
        for count, before in zip((1, 3, 40), first, strict=True):
            np.testing.assert_array_equal(one.run({"a": a[:count]}, {"a": (count,)})["s"], before)
        np.testing.assert_array_equal([one.run({"a": x}, {"a": ()})["s"] for x in a], single)


def test_a_kernel_that_llvm_refuses_leaves_the_others_alone(monkeypatch):
    written = Program.llvm_ir

    def broken(self, *key, fuse):
        return "no code" if self.loop.name == "broken" else written(self, *key, fuse=fuse)

    monkeypatch.setattr(Program, "llvm_ir", broken)
    given = arrays([(400,)] * 3)
    values, shapes = dict(zip(GIVEN, given, strict=True)), dict.fromkeys(GIVEN, (400,))
    loop, other = (Loop(name, product, dict(LOOP.inputs), OUTPUTS) for name in ("broken", "other"))
    with pytest.raises(CompilationError, match="'broken'"):
        Call(loop, GIVEN, CONSTANTS, Product, backend="compiled")
    one = Call(loop, GIVEN, CONSTANTS, Product)
    with pytest.warns(RuntimeWarning, match="'broken'.*computing with NumPy"):
        one.compile()
    for _ in range(3):
        one.compile()  # warns once
        np.testing.assert_allclose(one.run(values, shapes).y, expected(*given)[0], rtol=1e-14, atol=1e-14)
    assert Call(other, GIVEN, CONSTANTS, Product, backend="compiled").fast_path(*given) is not None


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize("lead", [(), (4,), (2, 2)], ids=str)
def test_results_that_nobody_holds_can_be_written_to(lead, backend):
    one, values = call(backend), dict(zip(GIVEN, arrays([lead] * 3), strict=True))
    for array in writable_arrays(one.run(values, dict.fromkeys(GIVEN, lead))).values():
        array[...] = 3.0
        assert (array == 3).all()


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
@pytest.mark.parametrize("lead", [(), (9,), (2, 3)])
def test_one_output_alone_is_returned_itself(lead, backend):
    loop = Loop("product", product, dict(LIMITED.inputs), {"y": (3,), "checked": ()})
    one = Call(loop, GIVEN, CONSTANTS, None, backend=backend, limits={"checked": {8: 1.0}}, on_limit=refuse)
    given = arrays([lead] * 3)
    given[2][...] = -1.0
    wanted = expected(*given)[0]
    shapes = dict.fromkeys(GIVEN, lead)
    for _ in range(2):  # not the same array again
        found = one.run(dict(zip(GIVEN, given, strict=True)), shapes)
        np.testing.assert_allclose(found, wanted, rtol=1e-14)
        found[...] = 0.0
    quick = one.fast_path(*given)
    if quick is not None:
        np.testing.assert_allclose(quick, wanted, rtol=1e-14)
        quick[...] = 0.0
    out = np.empty((*lead, 3))
    assert np.shares_memory(one.run(dict(zip(GIVEN, given, strict=True)), shapes, {"y": out}), out)
    np.testing.assert_allclose(out, wanted, rtol=1e-14)
    with pytest.raises(RefusedError):
        one.run(dict(zip(GIVEN, (*given[:2], given[2] + 3.0), strict=True)), shapes)
