"""Which backend, how many threads: NumPy for few samples, compiled kernels once they pay."""

from __future__ import annotations

import functools
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass

from hingepair.errors import ArgumentError, MissingDependencyError, quoted
from hingepair.evaluation import kernel_cache
from hingepair.numeric.arrays import check_choice

BACKENDS = ("auto", "numpy", "numba")

WORTH_LOADING = 100_000
"""Samples in this process, all calls together, after which Numba is imported: a second, or five the first time."""

_seen = 0


@dataclass(frozen=True, slots=True)
class How:
    """A choice of backend and threads.

    Attributes:
        backend: one of BACKENDS.
        workers: threads, at least 1.
    """

    backend: str
    workers: int

    def compiles(self, samples: int, loaded: Callable[[], bool] = kernel_cache.loaded) -> bool:
        """Whether a batch of so many samples goes to the compiled kernels; `loaded` says if they are in memory."""
        if self.backend != "auto":
            return self.backend == "numba"
        if loaded():
            return True
        global _seen  # noqa: PLW0603 (what a process has computed so far decides whether compiling pays)
        _seen += samples
        return _seen >= WORTH_LOADING and _can_load()

    def compiles_one(self) -> bool:
        """Whether one state goes to the compiled kernels: where they are in memory, they are faster."""
        return self.backend == "numba" or (self.backend == "auto" and kernel_cache.loaded())


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


@functools.cache
def _can_load() -> bool:
    """Whether the kernels can be had; said once where Numba is installed but does not work."""
    if not kernel_cache.available():
        return False
    try:
        kernel_cache.kernels()
    except MissingDependencyError as error:
        warnings.warn(f"{error}; computing with NumPy", RuntimeWarning, stacklevel=2)
        return False
    return True
