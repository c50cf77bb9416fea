"""Programs that are repeated in steps for many samples at once, with a state that passes from step to step."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from hingepair.engine.binding import bind, bind_constant
from hingepair.engine.llvm.builder import LANES
from hingepair.engine.llvm.scan import SCAN_WORDS
from hingepair.engine.loops import Loop
from hingepair.engine.threads import run_in_threads
from hingepair.numeric.arrays import FloatArray

_CALL_STEPS: Final = 200_000  # steps of all samples in one call, which no interrupt ends: some ten milliseconds
_BYTES: Final = 8  # of a number
_PROTOTYPE: Final = ctypes.CFUNCTYPE(None, ctypes.c_void_p, *[ctypes.c_int64] * 4)  # of a compiled loop


class Scan:
    """A compiled loop that is repeated in steps for many samples.

    Attributes:
        inputs: names of the inputs that are not known.

    Args:
        loop: the program. The next value of an input `x` is its output `next_x`, if there is one.
        known: inputs that are the same for all samples and steps.

    Raises:
        CompilationError: LLVM fails.
    """

    def __init__(self, loop: Loop, known: Mapping[str, Any]) -> None:
        # The coordinates of a robot without joints have no components.
        taken = tuple((name, tail) for name, tail in loop.inputs if 0 not in tail)
        values = {name: bind_constant(tail, known[name]) if name in known else np.empty(tail) for name, tail in taken}
        bound = bind(taken, values)
        self._ranks = {name: len(tail) for name, tail in taken if name not in known}  # of one sample, as in the table
        self.inputs = tuple(self._ranks)
        outputs = dict(loop.outputs)
        self._read = {name for name in self.inputs if f"next_{name}" not in outputs}  # and not replaced
        self._ranks |= {name: len(tail) for name, tail in loop.outputs if 0 not in tail}
        self._constants = np.array(bound.numbers)
        self._kernel = loop.program(bound.pattern).scan_kernel(self.inputs)
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
        """Run the program for all samples in all stages of all steps; replace the state, and write recorded outputs.

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
        rows = [[self._constants.ctypes.data, 0, _BYTES, 0, 0, 0]] if self._constants.size else []
        kept = []  # arrays, so that their memory stays
        for name, rank in self._ranks.items():
            if name in arrays:
                kept.append(_with_rows(arrays[name], rank, None if name in self._read else False))
                rows.append(_table_row(kept[-1]))
            else:
                rows.append([0] * SCAN_WORDS)
        table = np.array(rows, np.int64)
        most = max(LANES, min(-(-samples // workers), _CALL_STEPS // (records * every * stages)))
        size = -(-most // LANES) * LANES

        def run(start: int, _kept: object = kept) -> None:
            """Run the chunk of samples that begins at `start`; keeps the arrays, of which the table has addresses."""
            own = table.copy()
            own[:, 0] += start * table[:, 1]
            self._function(own.ctypes.data, min(size, samples - start), records, every, stages)

        run_in_threads(run, range(0, samples, size), workers)


def _with_rows(array: FloatArray, rank: int, copy: bool | None) -> FloatArray:
    """Return an array in which the components of a sample are the last axis: a view, or a copy if `copy` is None and
    there is no such view.
    """
    if rank == 1:
        return array
    lead = array.shape[: array.ndim - rank]
    return np.reshape(array, (*lead, math.prod(array.shape[array.ndim - rank :])), copy=copy)


def _table_row(array: FloatArray) -> list[int]:
    """Return the row of a scan's table: address, and strides of samples, components, records, steps and stages."""
    address, _ = array.__array_interface__["data"]
    samples, *steps = (0 if n == 1 else stride for n, stride in zip(array.shape[:-1], array.strides, strict=False))
    step = array.strides[-1] if array.shape[-1] > 1 else _BYTES
    return [address, samples, step, *steps, *[0] * (3 - len(steps))]
