"""The choice of a backend and of threads, by the arguments of a call alone."""

from __future__ import annotations

import os
import threading
from typing import NamedTuple

import numpy as np

from hingepair.engine.threads import core_count
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import check_choice

BACKEND_NAMES = ("auto", "numpy", "compiled")
"""Accepted values of the argument `backend`."""

compiler_lock = threading.RLock()
"""Lock that is held while the compiler is imported, and while code is compiled."""
if hasattr(os, "register_at_fork"):  # a fork waits for the lock: the child must not inherit it locked
    os.register_at_fork(
        before=compiler_lock.acquire, after_in_parent=compiler_lock.release, after_in_child=compiler_lock.release
    )


class Execution(NamedTuple):
    """What computes a call, and by how many threads."""

    backend: str  # one of BACKEND_NAMES
    workers: int  # threads, at least 1


def execution_of(backend: str, workers: int) -> Execution:
    """Return the execution that the arguments `backend` and `workers` ask for, which are checked.

    Args:
        backend: one of BACKEND_NAMES.
        workers: number of threads; -1 for all cores.

    >>> execution_of("numpy", 2)
    Execution(backend='numpy', workers=2)
    """
    check_choice("backend", backend, BACKEND_NAMES)
    if isinstance(workers, bool) or not isinstance(workers, int | np.integer) or (workers < 1 and workers != -1):
        raise ArgumentError("workers", "a positive integer, or -1 for all cores", quoted(workers))
    return Execution(backend, int(workers) if workers > 0 else core_count())


def execution_of_steps(backend: str, steps: int) -> Execution:
    """Return the execution, by one thread, of steps computed in many chunks: "auto" compiles many steps."""
    chosen = ("compiled" if steps >= 10_000 else "numpy") if backend == "auto" else backend
    return execution_of(chosen, 1)
