"""Gradients through motions: from the last record back to the start.

Between two records, motions are stepped forwards once more with the states of all stages kept, then backwards.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from hingepair.engine.llvm.builder import LANES
from hingepair.engine.threads import run_in_threads
from hingepair.errors import ShapeError
from hingepair.numeric.arrays import FloatArray, real_array
from hingepair.plans.arguments import chosen_names
from hingepair.plans.changes import change_shape
from hingepair.plans.rollouts import BASE_STATE, backward_loop
from hingepair.rollouts.motions import Motions, compiled_scan

_KEPT_BYTES: Final = 2_000_000  # of states kept at a time, which then leave space in the caches
_MAX_MOTIONS: Final = 64  # that a thread takes back at a time
_BACKWARDS: Final = slice(None, None, -1)


def gradients(
    motions: Motions,
    states: Mapping[str, FloatArray],
    cotangents: Mapping[str, ArrayLike],
    wrt: str | Iterable[str] | None,
) -> dict[str, FloatArray]:
    """Return the gradient of a weighted sum of recorded states; the arguments are those of `Rollout.vjp`.

    Raises:
        ArgumentError: a name is unknown, or weights have another shape.
    """
    state = motions.step.state
    names = {"q0": "q", "qd0": "qd"} | {name: name for name in state if name in BASE_STATE}
    names |= {name: name for name in motions.step.control.shapes(motions.step.form.dof) if name != "limit"}
    wanted = chosen_names("wrt", names if wrt is None else wrt, names)
    weights = {}
    for name in chosen_names("cotangents", cotangents, state):
        shape = (*motions.shape, motions.records + 1, *change_shape(name, state[name]))
        array = np.asarray(real_array(f"cotangents[{name!r}]", cotangents[name]), np.float64)
        try:
            weights[name] = motions.flat(np.broadcast_to(array, shape))
        except ValueError:
            raise ShapeError(f"cotangents[{name!r}]", f"shape {shape}", f"shape {array.shape}") from None
    inputs = tuple(names[name] for name in wanted if names[name] not in state)
    flat = {name: motions.flat(array) for name, array in states.items()}
    back = _Backward(motions, inputs, flat, weights)
    chunks = [slice(k, min(k + back.size, motions.count)) for k in range(0, motions.count, back.size)]
    run_in_threads(back.run, chunks, motions.workers)
    found: dict[str, FloatArray] = {}
    for name in wanted:
        gradient = back.found[names[name]]
        instants = (1,) if names[name] in back.held and motions.tracks[names[name]].has_steps else ()
        found[name] = gradient.reshape(*motions.shape, *instants, *gradient.shape[1:])
    return found


class _Backward:
    """Gradients by the backward pass, from the last record of motions to their start.

    Args:
        motions: the motions.
        inputs: inputs of the step by which gradients are taken, beside the state.
        states: recorded states by name, (motions, records + 1, *one sample).
        weights: derivatives of the loss by recorded states, in the same form.

    Attributes:
        held: those of the inputs that do not change from step to step.
        found: gradients by input, (motions, *one sample) or (motions, steps, *one sample).
        size: how many motions are taken back at a time.
    """

    def __init__(
        self,
        motions: Motions,
        inputs: tuple[str, ...],
        states: Mapping[str, FloatArray],
        weights: Mapping[str, FloatArray],
    ) -> None:
        self.motions, self.inputs, self.states, self.weights = motions, inputs, states, weights
        step, tracks = motions.step, motions.tracks
        self.held = tuple(name for name in inputs if tracks[name].instants == 1)
        self.shapes = {name: change_shape(name, tail) for name, tail in step.passed.items()}
        self.found = {name: np.zeros((motions.count, *self.shapes[name])) for name in step.state}
        for name in inputs:
            instants = () if name in self.held else (tracks[name].instants,)
            self.found[name] = np.zeros((motions.count, *instants, *tracks[name].tail))
        known: dict[str, Any] = {**motions.known}
        known |= {f"weight_{name}": np.zeros(self.shapes[name]) for name in step.state if name not in weights}
        known |= {"begins": 1.0} if step.stages == 1 else {}
        known |= {"ends": 1.0} if step.stages * motions.every == 1 else {}
        self.scan = compiled_scan(backward_loop(step, inputs, self.held), known)
        numbers = step.stages * sum(math.prod(tail) for tail in step.passed.values())
        rows = _KEPT_BYTES // (8 * numbers * motions.every)  # records of a motion whose states are kept
        self.size = max(LANES, min(rows, _MAX_MOTIONS) // LANES * LANES)
        self.records = max(1, rows // min(self.size, motions.count or 1))

    def run(self, chunk: slice) -> None:
        """Compute the gradients of a chunk of motions, and write them to `found`."""
        step, tracks, last = self.motions.step, self.motions.tracks, self.motions.records
        count = chunk.stop - chunk.start
        passed = {f"adjoint_{name}": np.zeros((count, *tail)) for name, tail in self.shapes.items()}
        passed |= {f"sum_{name}": np.zeros((count, *tracks[name].tail)) for name in self.inputs}
        for end in range(last, 0, -self.records):
            self._back(chunk, slice(max(0, end - self.records), end), passed)
        place = 0
        for name in step.state:
            found = passed[f"adjoint_{name}"]
            if name in self.weights:
                found += self.weights[name][chunk, 0]
            if step.stages > 1 and name != "S1":  # at the start, the vectors of the method are the state
                for vector in ("stage", "total"):
                    found += passed[f"adjoint_{vector}"][:, place : place + found.shape[1]]
                place += found.shape[1]
            self.found[name][chunk] = found
        for name in self.held:
            self.found[name][chunk] = passed[f"sum_{name}"]

    def _back(self, chunk: slice, records: slice, passed: Mapping[str, FloatArray]) -> None:
        """Step through these records forwards, then backwards; replace the adjoints and sums in `passed`."""
        motions, step = self.motions, self.motions.step
        count, every = chunk.stop - chunk.start, motions.every
        counts = (records.stop - records.start, every, step.stages)
        inputs = motions.inputs(chunk, records)
        # Forwards, to the state at each stage.
        state = motions.state_at({name: array[chunk, records.start] for name, array in self.states.items()})
        trail = {name: np.empty((count, math.prod(counts) + 1, *array.shape[1:])) for name, array in state.items()}
        for name, array in state.items():
            trail[name][:, 0] = array
        ends = {
            f"next_{name}": array[:, 1:].reshape(count, *counts, *array.shape[2:]) for name, array in trail.items()
        }
        motions.scan.run({**state, **inputs, **ends}, count, *counts)
        # Backwards.
        arrays = {name: array[:, :-1].reshape(count, *counts, *array.shape[2:]) for name, array in trail.items()}
        for name, array in self.weights.items():
            arrays[f"weight_{name}"] = array[chunk, records.start + 1 : records.stop + 1, None, None]
        for name in self.inputs:
            if name not in self.held:
                own = self.found[name][chunk, records.start * every : records.stop * every]
                arrays[f"next_sum_{name}"] = own.reshape(count, *counts[:2], 1, *own.shape[2:])
        arrays |= {"ends": np.zeros((1, 1, *counts[1:])), "begins": np.zeros((1, 1, 1, step.stages))}
        arrays["ends"][..., -1, -1] = arrays["begins"][..., -1] = 1.0
        reverse = (slice(None), _BACKWARDS, _BACKWARDS, _BACKWARDS)
        turned = {name: array[reverse] for name, array in (arrays | inputs).items()}
        self.scan.run({**turned, **passed}, count, *counts)
