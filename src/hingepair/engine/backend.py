"""The choice of a backend and of threads: NumPy for few samples, compiled kernels once compiling them pays."""

from __future__ import annotations

import contextlib
import functools
import os
import warnings
from collections.abc import Iterator
from contextvars import ContextVar
from typing import NamedTuple

import numpy as np

from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import check_choice

BACKEND_NAMES = ("auto", "numpy", "compiled")
"""Accepted values of the argument `backend`."""

# Seconds of compiling, measured on one machine; on another machine all times here differ by about one common factor.
_SHARED_CODE_COMPILE_SECONDS_PER_PROCESS = 0.07  # importing llvmlite, and compiling the code that all kernels share
_COMPILE_SECONDS_PER_KERNEL = 0.025  # for each kernel
_COMPILE_SECONDS_PER_OPERATION = 5e-5  # for each operation of a kernel
# Seconds that an operation takes without a kernel beyond the time that it takes with one.
_NUMPY_SECONDS_BEYOND_KERNEL_PER_OPERATION_AND_CALL = 4.5e-7  # for each call by NumPy
_NUMPY_SECONDS_BEYOND_KERNEL_PER_OPERATION_AND_SAMPLE = 7.5e-10  # for each sample of a call by NumPy
_PYTHON_SECONDS_BEYOND_KERNEL_PER_OPERATION = 1.5e-8  # for one state in Python

_compiles_at_first_call: ContextVar[bool] = ContextVar("_compiles_at_first_call", default=False)
_kernels_disabled = False
_shared_code_compiled = False


class Execution(NamedTuple):
    """Execution policy of a call: `backend` ("auto", "numpy" or "compiled") says what computes it, and `workers` is
    the number of threads (at least 1).

    Attributes:
        backend: one of BACKEND_NAMES.
        workers: number of threads, at least 1.
    """

    backend: str
    workers: int


def execution_of(backend: str, workers: int) -> Execution:
    """Check the arguments `backend` and `workers`, and return them as an `Execution`, in which the number of cores
    replaces -1 workers. Raises an ArgumentError if one of the arguments is not accepted.

    Args:
        backend: one of BACKEND_NAMES.
        workers: number of threads; -1 for all cores.

    Raises:
        ArgumentError: the backend is unknown, or the number of workers is neither -1 nor positive.

    >>> execution_of("numpy", 2)
    Execution(backend='numpy', workers=2)
    """
    if type(backend) is not str:
        check_choice("backend", backend, BACKEND_NAMES)
    if type(workers) is not int and isinstance(workers, np.integer):
        workers = int(workers)
    if type(workers) is not int or (workers < 1 and workers != -1):
        raise ArgumentError("workers", "a positive integer, or -1 for all cores", quoted(workers))
    return _cached_execution(backend, workers)


@functools.lru_cache(maxsize=64)
def _cached_execution(backend: str, workers: int) -> Execution:
    """Check the name of the backend, and return the cached `Execution` for a number of workers that is positive, or
    -1 for all cores. Raises an ArgumentError if the backend is unknown.
    """
    check_choice("backend", backend, BACKEND_NAMES)
    return Execution(backend, workers if workers > 0 else _core_count())


def _core_count() -> int:
    """Return the number of cores that this process may use. If the operating system does not tell that number, return
    the number of all cores, or 1 if that is unknown too.
    """
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class BreakEvenCounter:
    """Counter of the estimated seconds that calls have lost because a kernel was not yet compiled. `count_call` and
    `count_state_call` add the loss of one call and return whether to compile the kernel now. It is to be compiled if
    kernels are not disabled and either the loss has reached the time of compiling or `compile_at_first_call` is
    active.

    A kernel is compiled once the time lost without it equals the time of compiling it (the break-even rule of the
    ski-rental problem). Whatever calls come, their time is at most twice that of the better backend in hindsight, and
    no call waits for a kernel that does not pay. The times are estimated from the number of operations, so that the
    choice of the backend does not depend on how busy the machine is.

    Args:
        operations: number of operations of the program.
        components: number of components of the program's outputs; storing one takes as long as an operation.

    Attributes:
        operations: number of operations of the program.
        operations_and_stores: number of operations and of stored components.
        seconds_without_kernel: estimated time [s] that the calls so far have lost without a kernel.
    """

    def __init__(self, operations: int, components: int = 0) -> None:
        self.operations = operations
        self.operations_and_stores = operations + components
        self.seconds_without_kernel = 0.0

    @property
    def seconds_to_compile(self) -> float:
        """Estimated time [s] of compiling the kernel."""
        first = 0.0 if _shared_code_compiled else _SHARED_CODE_COMPILE_SECONDS_PER_PROCESS
        return _COMPILE_SECONDS_PER_KERNEL + _COMPILE_SECONDS_PER_OPERATION * self.operations + first

    def count_call(self, samples: int, chain_length: int = 1) -> bool:
        """Add the seconds that a kernel would have saved in one call by NumPy with `samples` samples to the sum of
        all calls, and return whether to compile the kernel now, by the rule of `_kernel_pays`. `chain_length` is the
        number of samples of each chain of a scan, which NumPy computes one after the other; it is 1 without a scan.

        Args:
            samples: number of samples of the call.
            chain_length: number of samples of each chain of a scan, which NumPy computes one after the other.
        """
        seconds = (
            chain_length * _NUMPY_SECONDS_BEYOND_KERNEL_PER_OPERATION_AND_CALL
            + samples * _NUMPY_SECONDS_BEYOND_KERNEL_PER_OPERATION_AND_SAMPLE
        )
        self.seconds_without_kernel += self.operations_and_stores * seconds
        return self._kernel_pays()

    def count_state_call(self) -> bool:
        """Add the estimated loss of one call for a single state in Python to the sum of all calls, and return whether
        to compile the kernel now, by the rule of `_kernel_pays`.
        """
        self.seconds_without_kernel += self.operations_and_stores * _PYTHON_SECONDS_BEYOND_KERNEL_PER_OPERATION
        return self._kernel_pays()

    def _kernel_pays(self) -> bool:
        """Return whether a kernel should be compiled: kernels are not disabled, and either the time lost has reached
        the estimated time of compiling, or `compile_at_first_call` is active.
        """
        reached = self.seconds_without_kernel >= self.seconds_to_compile or _compiles_at_first_call.get()
        return reached and not _kernels_disabled


@contextlib.contextmanager
def compile_at_first_call() -> Iterator[None]:
    """Make the backend "auto" compile each kernel at its first call within a `with` block (context manager), whatever
    calls came before. Other threads are not affected.

    So results do not depend on earlier calls.
    """
    token = _compiles_at_first_call.set(True)
    try:
        yield
    finally:
        _compiles_at_first_call.reset(token)


def mark_shared_code_compiled() -> None:
    """Record for this process that the code which all kernels share is compiled. The estimated time of compiling a
    kernel is shorter from now on.
    """
    global _shared_code_compiled  # noqa: PLW0603 (there is one process)
    _shared_code_compiled = True


def disable_kernels(error: Exception) -> None:
    """Stop the backend "auto" from compiling kernels in this process. If kernels are not disabled yet, issue a
    RuntimeWarning that quotes the error.
    """
    global _kernels_disabled  # noqa: PLW0603 (what cannot be loaded once is not tried at every call)
    if not _kernels_disabled:
        _kernels_disabled = True
        warnings.warn(f"{error}; computing with NumPy", RuntimeWarning, stacklevel=2)
