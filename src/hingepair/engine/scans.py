"""Programs that are repeated in steps for many samples at once, with a state that passes from step to step."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from hingepair.engine.binding import ComponentSource, bind_constant
from hingepair.engine.llvm.builder import LANES
from hingepair.engine.llvm.scan import SCAN_WORDS
from hingepair.engine.loops import Loop
from hingepair.engine.slices import run_in_threads
from hingepair.numeric.arrays import FloatArray

_CALL_STEPS: Final = 200_000  # of all samples in a call, which no interrupt ends: some ten milliseconds
_PROTOTYPE: Final = ctypes.CFUNCTYPE(None, ctypes.c_void_p, *[ctypes.c_int64] * 4)


class Scan:
    """A compiled loop that is repeated in steps.

    Attributes:
        inputs: names of the inputs that are not known.

    Args:
        loop: the program. The next value of an input `x` is its output `next_x`, if there is one.
        known: inputs that are the same for all samples and steps.

    Raises:
        CompilationError: LLVM fails.
    """

    def __init__(self, loop: Loop, known: Mapping[str, Any]) -> None:
        pattern: list[ComponentSource] = []
        constants: list[float] = []
        self._ranks: dict[str, int] = {}  # of one sample, in the order of the table
        for name, tail in loop.inputs:
            if name in known:
                bound = bind_constant(name, tail, known[name])
                pattern += bound.pattern
                constants += bound.constants
            else:
                pattern += [(len(self._ranks), k) for k in range(math.prod(tail))]
                self._ranks[name] = len(tail)
        self.inputs = tuple(self._ranks)
        self._ranks |= {name: len(tail) for name, tail in loop.outputs}
        self._first = int(bool(constants))  # row of the first array
        self._constants = np.array(constants)
        self._kernel = loop.program(tuple(pattern)).scan_kernel()
        self._function = _PROTOTYPE(self._kernel.address("scan"))

    def run(
        self,
        arrays: Mapping[str, FloatArray],
        samples: int,
        records: int,
        every: int = 1,
        stages: int = 1,
        workers: int = 1,
    ) -> None:
        """Repeat the program in all stages of all steps.

        Args:
            arrays: the state, (samples, *one sample), which is replaced by the last; further inputs, and outputs that
                are recorded, (samples, records, steps of a record, stages of a step, *one sample). There, an axis of
                length 1 stands for all; an output is written at the end of what it stands for.
            samples: number of samples.
            records: number of records.
            every: steps of a record.
            stages: stages of a step.
            workers: number of threads.
        """
        if not samples or not records:
            return
        table = np.zeros((len(self._ranks) + self._first, SCAN_WORDS), np.int64)
        if self._first:
            table[0, :3] = self._constants.ctypes.data, 0, self._constants.itemsize
        rows = []  # kept alive
        for row, (name, rank) in zip(table[self._first :], self._ranks.items(), strict=True):
            if name in arrays:
                rows.append(_with_rows(arrays[name], rank))
                stride, *steps = (
                    0 if n == 1 else step for n, step in zip(rows[-1].shape, rows[-1].strides, strict=True)
                )
                row[:3] = rows[-1].ctypes.data, stride, rows[-1].strides[-1]
                row[3 : 2 + len(steps)] = steps[:-1]
        most = max(LANES, min(-(-samples // workers), _CALL_STEPS // (records * every * stages)))
        size = -(-most // LANES) * LANES

        def run(starts: range) -> None:
            own = table.copy()
            for start in starts:
                own[:, 0] = table[:, 0] + start * table[:, 1]
                self._function(own.ctypes.data, min(size, samples - start), records, every, stages)

        starts = range(0, samples, size)
        workers = min(workers, len(starts))
        run_in_threads(run, [starts[k::workers] for k in range(workers)])


def _with_rows(array: FloatArray, rank: int) -> FloatArray:
    """Return an array in which the components of a sample are one axis."""
    lead = array.shape[: array.ndim - rank]
    return np.reshape(array, (*lead, math.prod(array.shape[array.ndim - rank :])), copy=False)
