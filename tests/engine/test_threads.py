"""Threads: no exception leaves one behind, and no thread that is missing is waited for."""

from __future__ import annotations

import os
import signal
import threading
import time

import numpy as np
import pytest

from hingepair.engine import threads
from support.work import HANG, python

TIMER = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="interrupts by a timer")


@pytest.fixture(autouse=True)
def four_cores(monkeypatch):
    monkeypatch.setattr(threads, "core_count", lambda: 4)


class StrikeError(Exception):
    """Raised by the handler of a signal."""


@pytest.mark.parametrize("workers", [1, 2, 9])
def test_every_argument_is_taken_once(workers):
    taken: list[int] = []
    threads.run_in_threads(taken.append, range(100), workers)
    assert sorted(taken) == [*range(100)]
    threads.run_in_threads(taken.append, [], workers)
    assert len(taken) == 100


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit, StrikeError])
@pytest.mark.parametrize("caller_fails", [True, False])
def test_a_failure_ends_all_calls_before_it_is_raised(error, caller_fails):
    """Of the calling thread or of another one; no further argument is taken, and nothing is written any more."""
    caller, gate, ended = threading.get_ident(), threading.Barrier(2), []

    def work(_):
        gate.wait(HANG)
        if (threading.get_ident() == caller) is caller_fails:
            raise error
        time.sleep(0.05)
        ended.append(None)

    with pytest.raises(error):
        threads.run_in_threads(work, range(50), 2)
    assert len(ended) == 1


@TIMER
def test_signals_that_raise_while_the_caller_waits_wait_too():
    """A time limit, then a request to end, both while another thread computes."""
    written, struck, begun = np.zeros(1), [], threading.Event()
    caller = threading.get_ident()

    def strike(*_):
        struck.append(None)
        raise StrikeError

    def work(_):
        if threading.get_ident() == caller:
            begun.wait(HANG)
            return
        begun.set()
        for _ in range(100):
            time.sleep(2e-3)
            written[0] += 1

    before = signal.signal(signal.SIGALRM, strike)
    try:
        with pytest.raises(StrikeError):  # noqa: PT012
            signal.setitimer(signal.ITIMER_REAL, 0.05, 0.05)
            threads.run_in_threads(work, range(2), 2)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert len(struck) > 1
    assert written[0] == 100


@pytest.mark.parametrize("started", [0, 1])
def test_threads_that_cannot_be_started_are_not_waited_for(monkeypatch, started):
    pool, start, count = threads._Pool(), threads._start, []

    def refuse(function):
        if len(count) >= started:
            raise RuntimeError("can't start new thread")
        count.append(None)
        start(function)

    monkeypatch.setattr(threads._Pool, "of_process", pool)
    monkeypatch.setattr(threads, "_start", refuse)
    for _ in range(4):
        taken: list[int] = []
        threads.run_in_threads(taken.append, range(8), 4)
        assert sorted(taken) == [*range(8)]
    assert threads.call_apart(lambda: 5) == 5
    assert len(count) == started


def test_no_more_threads_than_cores_are_started(monkeypatch):
    pool, count = threads._Pool(), []
    monkeypatch.setattr(threads._Pool, "of_process", pool)
    monkeypatch.setattr(threads, "_start", count.append)
    threads.run_in_threads(lambda _: None, range(1000), 1000)
    assert len(count) == 3


def test_what_is_called_apart_returns_and_raises_as_itself():
    assert threads.call_apart(threading.get_ident) != threading.get_ident()
    with pytest.raises(StrikeError):
        threads.call_apart(lambda: (_ for _ in ()).throw(StrikeError()))


@TIMER
def test_no_signal_interrupts_what_is_called_apart():
    ended: list[int] = []

    def strike(*_):
        raise StrikeError

    before = signal.signal(signal.SIGALRM, strike)
    try:
        with pytest.raises(StrikeError):  # noqa: PT012
            signal.setitimer(signal.ITIMER_REAL, 0.02)
            threads.call_apart(lambda: (time.sleep(0.1), ended.append(1)))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert ended == [1]


STACK = """
import sys, threading, numpy as np
from hingepair.engine.backend import Execution
from hingepair.engine.loops import Loop

def function(v):
    values = [v["x"][k % 3] * (1.0 + k) for k in range(3000)]
    return {"y": tuple(values), "z": tuple(reversed(values))}

loop, x = Loop("wide", function, {"x": (3,)}, {"y": (3000,), "z": (3000,)}), np.ones((20, 6))[:, ::2]
def work():
    out = {name: np.zeros((20, 2, 3000))[:, 0] for name in "yz"}
    loop.run({"x": x}, out, (20,), x.dtype, Execution("compiled", 1))
    print((out["y"] == np.arange(1.0, 3001)).all() and (out["z"] == out["y"][:, ::-1]).all())
threading.stack_size(128 * 1024)
thread = threading.Thread(target=work)
thread.start()
thread.join()
"""


@pytest.mark.slow(2)
def test_a_large_program_computes_in_a_thread_with_a_small_stack():
    assert python(STACK).strip() == "True"


FORK = """
import os, numpy as np, hingepair as hp
from hingepair.engine import threads
threads.core_count = lambda: 2
pair, q = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0)), np.ones((100_000, 7))
wanted = pair.forward_kinematics(q, workers=2).R2
child = os.fork()
found = pair.forward_kinematics(q, workers=2).R2
assert (found == wanted).all()
if not child:
    os._exit(0)
print(os.waitpid(child, 0)[1])
"""


@pytest.mark.slow(2)
@pytest.mark.skipif(not hasattr(os, "fork"), reason="a system without forks")
def test_a_forked_process_has_threads_of_its_own():
    assert python(FORK).strip() == "0"
