"""The call of a ufunc in slices of the samples: for threads, short axes and casts."""

from __future__ import annotations

import itertools
import math
import os
import time
from _thread import start_new_thread
from collections.abc import Callable, Iterator, Sequence
from queue import SimpleQueue
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.arrays import Block, split_into_blocks

Arrays = Sequence[NDArray[Any]]

_MIN_WORK: Final = 1_000_000  # least operations of a thread: about 0.1 ms, as handing it work takes
_MAX_CAST_BYTES: Final = 4_000_000  # most that are cast to another dtype at a time
_SHORT_AXIS: Final = 16  # samples that are too few for one run of the inner loop, along the innermost axis
_MIN_SAMPLES: Final = 512  # least of one call, so that the call itself takes little of the time
_MAX_COPIED_NUMBERS: Final = 500_000  # of inputs, copied so that samples of short axes follow each other


def run_slices(
    ufunc: Callable[..., Any],
    inputs: Arrays,
    outputs: Arrays,
    ranks: Sequence[int],
    shape: tuple[int, ...],
    *,
    operations: int,
    workers: int,
) -> None:
    """Call a ufunc for all samples, and write its results into `outputs`.

    Args:
        ufunc: takes the inputs, and `out`.
        inputs: arrays whose leading axes broadcast to the samples.
        outputs: arrays of the dtype in which the ufunc computes.
        ranks: number of axes of one sample of each input and output.
        shape: shape of the samples.
        operations: of one sample.
        workers: threads at most.
    """
    size, dtype = math.prod(shape), outputs[0].dtype
    input_ranks, output_ranks = ranks[: len(inputs)], ranks[len(inputs) :]
    blocks: list[Block] = [tuple(slice(0, n) for n in shape)]
    short = _short_axes((*inputs, *outputs), ranks, shape) if len(shape) > 1 else []
    # A call for each index of the short axes where each has many samples.
    if short and size // math.prod(shape[axis] for axis in short) >= _MIN_SAMPLES:
        pieces = (
            [slice(k, k + 1) for k in range(n)] if axis in short else [slice(0, n)] for axis, n in enumerate(shape)
        )
        blocks = list(itertools.product(*pieces))
    # Else copies, whose samples fill the lanes; so many axes that these are large are left to NumPy.
    elif short:
        samples = [math.prod(one.shape[one.ndim - rank :]) for one, rank in zip(inputs, input_ranks, strict=True)]
        if size * sum(samples) <= _MAX_COPIED_NUMBERS:
            inputs = [
                np.ascontiguousarray(np.broadcast_to(one, (*shape, *one.shape[one.ndim - rank :])))
                for one, rank in zip(inputs, input_ranks, strict=True)
            ]
    # Samples of a slice: as many as there are threads for, and as a cast may hold.
    most = size
    workers = max(1, min(workers, size * operations // _MIN_WORK))
    if workers > 1:
        most = -(-size // workers)
    cast = sum(dtype.itemsize * one.size for one in inputs if one.dtype != dtype)
    if cast > _MAX_CAST_BYTES:
        most = min(most, max(1, size * _MAX_CAST_BYTES // cast))
    if most < size:
        blocks = [part for block in blocks for part in _cut(block, most)]
    if len(blocks) == 1:
        ufunc(*inputs, out=tuple(outputs), dtype=dtype)
        return

    def run(own: Sequence[Block]) -> None:
        """Call the ufunc for these blocks."""
        for block in own:
            ufunc(
                *(_part(one, rank, block) for one, rank in zip(inputs, input_ranks, strict=True)),
                out=tuple(_part(one, rank, block) for one, rank in zip(outputs, output_ranks, strict=True)),
                dtype=dtype,
            )

    run_in_threads(run, [blocks[k::workers] for k in range(min(workers, len(blocks)))])


def _cut(block: Block, most: int) -> Iterator[Block]:
    """Yield parts of a block, of at most `most` samples each."""
    for part in split_into_blocks(tuple(axis.stop - axis.start for axis in block), most):
        yield tuple(
            slice(axis.start + own.start, axis.start + own.stop) for axis, own in zip(block, part, strict=True)
        )


def _part(array: NDArray[Any], rank: int, block: Block) -> NDArray[Any]:
    """Return the samples of an array that a block selects; axes of length 1 and missing ones broadcast."""
    axes = array.ndim - rank
    own = zip(block[len(block) - axes :], array.shape[:axes], strict=True)
    return array[tuple(piece if n != 1 else slice(None) for piece, n in own)]


def _short_axes(arrays: Arrays, ranks: Sequence[int], shape: tuple[int, ...]) -> list[int]:
    """Return the axes of the samples along which NumPy's inner loop would not fill the lanes of a kernel: short ones
    that do not merge with a neighbour, beside a longer axis.
    """
    steps = []
    for array, rank in zip(arrays, ranks, strict=True):
        axes = array.ndim - rank
        own = (0 if n == 1 else step for n, step in zip(array.shape[:axes], array.strides[:axes], strict=True))
        steps.append([*[0] * (len(shape) - axes), *own])
    # NumPy merges neighbouring axes if one stride leads through both of each array.
    merged: list[list[int]] = []
    for axis, n in enumerate(shape):
        if n == 1:
            continue
        last = merged[-1][-1] if merged else 0
        if merged and all(one[last] == one[axis] * n for one in steps):
            merged[-1].append(axis)
        else:
            merged.append([axis])
    lengths = [math.prod(shape[axis] for axis in axes) for axes in merged]
    if len(merged) < 2:
        return []
    return [
        axis for axes, n in zip(merged, lengths, strict=True) for axis in axes if n < _SHORT_AXIS and n < max(lengths)
    ]


class _Chunks:
    """A function that threads call for one `run_in_threads`; after a stop, no further call begins.

    Without a lock, which an interrupt could leave held: a call says that it has started, and then looks for a stop.
    """

    def __init__(self, function: Callable[[Any], None]) -> None:
        self._function = function
        self._started: list[None] = []
        self._ended: list[None] = []
        self._stopped = False
        self.results: SimpleQueue[BaseException | None] = SimpleQueue()  # of the calls, as they end

    def __call__(self, argument: Any) -> None:
        self._started.append(None)
        error: BaseException | None = None
        try:
            if not self._stopped:
                self._function(argument)
        except BaseException as raised:
            error = raised
        finally:
            self._ended.append(None)
            self.results.put(error)

    def stop(self) -> None:
        """Begin no further call, and wait until those that run have ended, whatever interrupts come meanwhile."""
        interrupt: KeyboardInterrupt | None = None
        while True:
            try:
                self._stopped = True
                while len(self._ended) < len(self._started):
                    time.sleep(1e-3)
                break
            except KeyboardInterrupt as error:
                interrupt = error
        if interrupt is not None:
            raise interrupt


def run_in_threads(function: Callable[[Any], None], arguments: Sequence[Any]) -> None:
    """Call `function` with each of the arguments, at the same time, and wait until all calls have ended, also where
    one of them fails or the user interrupts. The first runs in the calling thread.
    """
    if len(arguments) == 1:
        function(arguments[0])
        return
    chunks, workers = _Chunks(function), _Workers.of_process
    try:
        workers.start(len(arguments) - 1)
        for argument in arguments[1:]:
            workers.tasks.put((chunks, argument))
        function(arguments[0])
        for _ in arguments[1:]:
            error = chunks.results.get()
            if error is not None:
                raise error
    finally:
        chunks.stop()


class _Workers:
    """Threads that wait for tasks, and end with the process.

    An interrupt may come between any two steps of Python code, and a lock of a ThreadPoolExecutor stayed held: queues
    and threads written in C have no such steps.
    """

    of_process: ClassVar[_Workers]

    def __init__(self) -> None:
        self.tasks: SimpleQueue[tuple[_Chunks, Any]] = SimpleQueue()
        self._count = 0

    def start(self, count: int) -> None:
        """Start threads until `count` exist, or as many as processors if that is more."""
        while self._count < max(count, os.cpu_count() or 1):
            self._count += 1
            start_new_thread(self._work, ())

    def _work(self) -> None:
        """Run tasks for ever."""
        while True:
            chunks, argument = self.tasks.get()
            chunks(argument)
            del chunks, argument  # a waiting thread holds no arrays


def _new_workers() -> None:
    _Workers.of_process = _Workers()


_new_workers()
if hasattr(os, "register_at_fork"):  # threads do not survive a fork
    os.register_at_fork(after_in_child=_new_workers)
