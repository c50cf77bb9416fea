"""Motions of a robot by steps of constant length, forwards."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from hingepair.engine.loops import Loop
from hingepair.engine.outputs import Out, output_arrays
from hingepair.engine.scans import Scan
from hingepair.numeric.arrays import Float64Array, FloatArray, broadcast_shape
from hingepair.plans.rollouts import RolloutStep, step_loop
from hingepair.rollouts.tracks import Track

# Of each stage of "rk4": the share of a step until the next stage, that of the stage in the mean, whether it ends a
# step.
_SHARES: Final = np.array([[0.5, 1 / 6, 0], [0.5, 1 / 3, 0], [1, 1 / 3, 0], [0, 1 / 6, 1]])


class Motions:
    """Motions of a robot from given states, under given loads.

    Args:
        step: a step.
        known: inputs of the step that are the same for all motions and steps.
        starts: parts of the states at the start, (..., *one sample).
        tracks: all other inputs.
        steps: number of steps; those behind the last record are left out.
        every: steps of a record.
        workers: number of threads.

    Attributes:
        shape: leading shape of the motions.
        count: number of motions.
        records: number of records after the start.
        scan: the compiled step.

    Raises:
        ArgumentError: the shapes do not broadcast.
        CompilationError: LLVM fails.
    """

    def __init__(
        self,
        step: RolloutStep,
        known: Mapping[str, Any],
        starts: Mapping[str, Float64Array],
        tracks: Mapping[str, Track],
        steps: int,
        every: int,
        workers: int,
    ) -> None:
        self.step, self.known, self.starts, self.tracks = step, known, starts, tracks
        self.records, self.every, self.workers = steps // every, every, workers
        leads = {name: array.shape[: array.ndim - len(step.state[name])] for name, array in starts.items()}
        self.shape = broadcast_shape({**leads, **{one.label: one.lead for one in tracks.values()}})
        self.count = math.prod(self.shape)
        self._flat = {name: one.flat(self.shape) for name, one in tracks.items()}
        self.scan = compiled_scan(step_loop(step), known)

    def run(self, out: Out) -> dict[str, FloatArray]:
        """Return the states at the start and at the end of each record, (..., records + 1, *one sample).

        Args:
            out: arrays by output name, or None.

        Raises:
            ArgumentError: `out` cannot be used.
        """
        tails, shape = self.step.state, (*self.shape, self.records + 1)
        inputs = {**self.starts, **{name: one.values for name, one in self.tracks.items()}}
        outputs = output_arrays(tails.items(), shape, np.dtype(np.float64), out, inputs)
        flat = {name: self.flat(array) for name, array in outputs.items()}
        for name, array in flat.items():
            array[:, 0] = np.broadcast_to(self.starts[name], (*self.shape, *tails[name])).reshape(array[:, 0].shape)
        arrays = self.state_at({name: array[:, 0] for name, array in flat.items()})
        arrays |= self.inputs(slice(None), slice(0, self.records))
        arrays |= {f"next_{name}": array[:, 1:, None, None] for name, array in flat.items()}
        self.scan.run(arrays, self.count, self.records, self.every, self.step.stages, self.workers)
        for name, array in flat.items():  # an array of the user's that has other strides was copied
            if not np.may_share_memory(array, outputs[name]):
                outputs[name][...] = array.reshape(outputs[name].shape)
        return outputs

    def flat(self, states: FloatArray) -> FloatArray:
        """Return recorded states, (..., records + 1, ...), with one axis of motions."""
        return states.reshape(self.count, *states.shape[len(self.shape) :])

    def state_at(self, recorded: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return new arrays of what passes from stage to stage, at a recorded state, (motions, *one sample)."""
        found = {name: array.copy() for name, array in recorded.items()}
        if self.step.stages > 1:
            parts = [array for name, array in found.items() if name != "S1"]
            if self.step.request.free:
                parts.append(np.zeros_like(found["R1"]))  # the rotation since the start of the step
            start = np.concatenate(parts, axis=1)
            found |= {"stage": start, "total": start.copy()}
        return found

    def inputs(self, motions: slice, records: slice) -> dict[str, FloatArray]:
        """Return the inputs of the scan but the state, by name, for some motions and records: axes of motions,
        records, steps and stages, of length 1 where a value holds for all.
        """
        steps = slice(records.start * self.every, records.stop * self.every)
        found: dict[str, FloatArray] = {}
        for name, array in self._flat.items():
            own = array[motions] if len(array) > 1 else array
            if self.tracks[name].instants == 1:
                found[name] = own[:, :, None, None]
                continue
            own = own[:, steps, None]
            found[name] = own.reshape(len(own), records.stop - records.start, self.every, *own.shape[2:])
        if self.step.stages > 1:
            found["shares"] = _SHARES[None, None, None]
        return found


def compiled_scan(loop: Loop, known: Mapping[str, Any]) -> Scan:
    """Return the compiled Scan of a loop, in which inputs are `known`; the last 64 are cached.

    Raises:
        CompilationError: LLVM fails.
    """
    return _compiled_scan(loop, tuple((name, tuple(np.ravel(value).tolist())) for name, value in known.items()))


@functools.lru_cache(maxsize=64)
def _compiled_scan(loop: Loop, known: tuple[tuple[str, tuple[float, ...]], ...]) -> Scan:
    return Scan(loop, dict(known))
