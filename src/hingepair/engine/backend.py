"""The choice of a backend and of threads: NumPy for few samples, compiled kernels once they pay."""

from __future__ import annotations

import contextlib
import functools
import os
import warnings
from collections.abc import Iterator
from contextvars import ContextVar
from typing import NamedTuple

from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import check_choice

BACKENDS = ("auto", "numpy", "compiled")

# What is paid, measured on one machine; on others all of it takes longer or shorter by about the same factor.
_START_SECONDS = 0.07  # once in a process: llvmlite is imported, and what all kernels share is compiled
_KERNEL_SECONDS = 0.025  # for a kernel
_KERNEL_OPERATION_SECONDS = 5e-5  # and for each of its operations
# What an operation takes without a kernel, beyond what it takes with one.
_NUMPY_CALL_SECONDS = 4.5e-7  # in a call by NumPy
_NUMPY_SAMPLE_SECONDS = 7.5e-10  # and for each of its samples
_PYTHON_STATE_SECONDS = 1.5e-8  # for one state in Python

_compile_at_once: ContextVar[bool] = ContextVar("_compile_at_once", default=False)
_broken = False
_started = False


class How(NamedTuple):
    """A choice of backend and threads.

    Attributes:
        backend: one of BACKENDS.
        workers: threads, at least 1.
    """

    backend: str
    workers: int


def choose(backend: str, workers: int) -> How:
    """Return the choice that two arguments make.

    Raises:
        ArgumentError: an unknown backend, or a number of workers that is neither -1 nor positive.

    >>> choose("numpy", 2)
    How(backend='numpy', workers=2)
    """
    if type(backend) is not str:
        check_choice("backend", backend, BACKENDS)
    if type(workers) is not int or (workers < 1 and workers != -1):
        raise ArgumentError("workers", "a positive integer, or -1 for all cores", quoted(workers))
    return _choice(backend, workers)


@functools.lru_cache(maxsize=64)
def _choice(backend: str, workers: int) -> How:
    check_choice("backend", backend, BACKENDS)
    return How(backend, workers if workers > 0 else _cores())


def _cores() -> int:
    """Return the number of cores that this process may use; of all of them where the system does not say."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Account:
    """A record of what calls have cost without a kernel, which says when a kernel pays.

    Skis are rented until the rent has come to their price, then bought: whatever calls come, their time is at most
    twice that of the better backend in hindsight, and no call waits for a kernel that it does not pay for. The costs
    are estimated from the number of operations, so that what runs does not depend on how busy the machine is.

    Args:
        operations: number of operations of the program.
        components: number of components of its outputs; storing one takes as long as an operation.
    """

    def __init__(self, operations: int, components: int = 0) -> None:
        self.operations = operations
        self.lines = operations + components
        self.owed = 0.0  # seconds

    @property
    def price(self) -> float:
        """Seconds until the kernel is there."""
        return _KERNEL_SECONDS + _KERNEL_OPERATION_SECONDS * self.operations + (0.0 if _started else _START_SECONDS)

    def pays(self, samples: int, links: int = 1) -> bool:
        """Count a call over so many samples, in chains of so many links, and return whether a kernel pays now."""
        self.owed += self.lines * (links * _NUMPY_CALL_SECONDS + samples * _NUMPY_SAMPLE_SECONDS)
        return (self.owed >= self.price or _compile_at_once.get()) and not _broken

    def pays_one(self) -> bool:
        """Count a call of one state in Python, and return whether a kernel pays now."""
        self.owed += self.lines * _PYTHON_STATE_SECONDS
        return (self.owed >= self.price or _compile_at_once.get()) and not _broken


@contextlib.contextmanager
def compiling_at_once() -> Iterator[None]:
    """Let "auto" compile at the first call, so that no result depends on what was computed before it.

    Holds in this thread, until the block is left.
    """
    token = _compile_at_once.set(True)
    try:
        yield
    finally:
        _compile_at_once.reset(token)


def started() -> None:
    """Note that kernels share what was compiled for the first of them: the next ones cost less."""
    global _started  # noqa: PLW0603 (there is one process)
    _started = True


def give_up(error: Exception) -> None:
    """Warn once that kernels cannot be had, and ask for none again."""
    global _broken  # noqa: PLW0603 (what cannot be loaded once is not tried at every call)
    if not _broken:
        _broken = True
        warnings.warn(f"{error}; computing with NumPy", RuntimeWarning, stacklevel=2)
