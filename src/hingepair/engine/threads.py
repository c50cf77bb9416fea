"""Threads that compute beside the calling one, and whom no exception leaves behind.

Handlers of signals, such as those of Ctrl-C and of time limits, run in the main thread between any two steps of
Python, and may raise there. A lock that Python code holds may then stay held, as one of ThreadPoolExecutor does;
queues and threads written in C have no such steps.
"""

from __future__ import annotations

import os
import threading
from _thread import start_new_thread
from collections import deque
from collections.abc import Callable, Sequence
from queue import SimpleQueue
from typing import Any, ClassVar, Final, TypeVar

T = TypeVar("T")

_STACK: Final = 2**23  # bytes of the stack of a thread, whatever the user has set for others


def core_count() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_in_threads(function: Callable[[Any], None], arguments: Sequence[Any], workers: int) -> None:
    """Call `function` with each of the arguments, and wait until all calls have ended, also where one of them fails
    or the handler of a signal raises.

    A thread keeps the function, and so must what it writes to be kept by the function.

    Args:
        function: called with one argument at a time.
        arguments: the arguments; after a failure, those that are left are not taken.
        workers: threads at most, of which one is the calling thread; never more than cores.
    """
    helpers = min(workers, len(arguments), core_count()) - 1
    if helpers < 1:
        for argument in arguments:
            function(argument)
        return
    job = _Job(function, arguments)

    def begin() -> None:
        _Pool.of_process.hand(job, helpers)
        job.work()

    _finish(job, begin)


def call_apart(function: Callable[[], T]) -> T:
    """Return what a function returns that a thread of its own calls, so that no handler of a signal interrupts it:
    what such a handler raises, is raised afterwards. The thread's stack is large.
    """
    found: list[T] = []
    job = _Job(lambda _: found.append(function()), [None])

    def begin() -> None:
        try:
            _start(job.help)
        except RuntimeError:  # the system has no more threads
            job.work()
        else:
            job.wait(1)

    _finish(job, begin)
    return found[0]


def _finish(job: _Job, begin: Callable[[], None]) -> None:
    """Begin a job, and return when nobody works at it, whatever handlers of signals raise meanwhile; raise that, or
    else the error of a helper, then.
    """
    raised: BaseException | None = None
    try:
        begin()
    finally:
        while True:  # not in a function, whose call could be interrupted before its `try`
            try:
                job.stop()
                break
            except BaseException as error:
                raised = error
    for one in (raised, *job.ended):
        if one is not None:
            raise one


class _Job:
    """A function that threads call with the arguments that are left. A thread says that it has begun before it looks
    for an argument, and a stop takes the arguments away before it looks who has begun.
    """

    def __init__(self, function: Callable[[Any], None], arguments: Sequence[Any]) -> None:
        self._function = function
        self._left = deque(arguments)
        self._begun: list[None] = []
        self.ended: list[BaseException | None] = []  # the error of each helper that has ended, if there was one
        self._news: SimpleQueue[None] = SimpleQueue()  # after each entry in `ended`

    def work(self) -> None:
        """Call the function until no argument is left; the others end, too, if it fails."""
        try:
            while True:
                try:
                    argument = self._left.popleft()
                except IndexError:
                    return
                self._function(argument)
        except BaseException:
            self._left.clear()
            raise

    def help(self) -> None:
        """Work in another thread."""
        self._begun.append(None)
        error: BaseException | None = None
        try:
            self.work()
        except BaseException as raised:
            error = raised
        finally:
            self.ended.append(error)
            self._news.put(None)

    def stop(self) -> None:
        """Begin no further call, and wait until those that run have ended."""
        self._left.clear()
        while len(self.ended) < len(self._begun):
            self._news.get()

    def wait(self, count: int) -> None:
        """Wait until so many helpers have ended."""
        while len(self.ended) < count:
            self._news.get()


class _Pool:
    """Threads that wait for jobs, and end with the process."""

    of_process: ClassVar[_Pool]

    def __init__(self) -> None:
        self._jobs: SimpleQueue[_Job] = SimpleQueue()
        self._count = 0

    def hand(self, job: _Job, count: int) -> None:
        """Hand a job to `count` threads, or as many as the system lets this process start."""
        while self._count < count:
            try:
                _start(self._wait_for_jobs)
            except RuntimeError:
                break
            self._count += 1
        for _ in range(min(count, self._count)):
            self._jobs.put(job)

    def _wait_for_jobs(self) -> None:
        while True:
            job = self._jobs.get()
            job.help()
            del job  # a waiting thread holds no arrays


def _start(function: Callable[[], None]) -> None:
    """Start a thread with a stack that machine code and LLVM find large enough."""
    before = threading.stack_size(_STACK)
    try:
        start_new_thread(function, ())
    finally:
        threading.stack_size(before)


def _new_pool() -> None:
    _Pool.of_process = _Pool()


_new_pool()
if hasattr(os, "register_at_fork"):  # threads do not survive a fork
    os.register_at_fork(after_in_child=_new_pool)
