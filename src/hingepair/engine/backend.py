"""Which backend, how many threads: NumPy for few samples, compiled kernels once they pay."""

from __future__ import annotations

import functools
import os
import warnings
from typing import NamedTuple

from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import check_choice

BACKENDS = ("auto", "numpy", "compiled")

_IMPORTING = 0.035  # seconds that llvmlite takes
_COMPILING, _A_LINE = 0.02, 0.0002  # seconds for a kernel, and for each of its operations
_A_CALL, _A_SAMPLE = 1.0e-6, 1.0e-9  # seconds that NumPy takes for each operation, beyond what a kernel does
_A_STATE = 1.2e-8  # seconds that Python takes for each operation on one state, likewise

_broken = False


class How(NamedTuple):
    """A choice of backend and threads.

    Attributes:
        backend: one of BACKENDS.
        workers: threads, at least 1.
    """

    backend: str
    workers: int


def choose(backend: str, workers: int) -> How:
    """The choice that two arguments make.

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
    """The cores that this process may use; all of them where the system does not say."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Account:
    """Whether a kernel pays: what NumPy has cost so far beyond it, against what compiling costs.

    Skis are rented until the rent has come to their price, then bought: whatever calls come, their time is at most
    twice that of the better backend in hindsight, and no call waits for a kernel that it does not pay for. The costs
    are estimates by the number of operations, so that what runs does not depend on how busy the machine is.
    """

    def __init__(self, operations: int) -> None:
        self.operations = operations
        self.owed = 0.0
        self.price = _IMPORTING + _COMPILING + _A_LINE * operations

    def pays(self, samples: int, links: int = 1) -> bool:
        """Count a call over so many samples, in chains of so many links, and say whether a kernel pays now."""
        self.owed += self.operations * (links * _A_CALL + samples * _A_SAMPLE)
        return self.owed >= self.price and not _broken

    def pays_one(self) -> bool:
        """The same for one state, in Python."""
        self.owed += self.operations * _A_STATE
        return self.owed >= self.price and not _broken


def give_up(error: Exception) -> None:
    """Say once that kernels cannot be had, and ask for none again."""
    global _broken  # noqa: PLW0603 (what cannot be loaded once is not tried at every call)
    if not _broken:
        _broken = True
        warnings.warn(f"{error}; computing with NumPy", RuntimeWarning, stacklevel=2)
