"""The compiled backend's kernels: the steps of a plan, run over blocks of samples in a small scratch array.

A block is transposed into the scratch array, one row a component; each step is a loop over the block that LLVM
vectorises; the results are transposed out, straight into the arrays of the caller. Which steps run is data, so that
two kernels (float64, float32) serve every input, output, level and Euler sequence.

Imported with Numba, that is only when the first compiled kernel is asked for.
"""

from __future__ import annotations

from typing import Any

from numba import njit

from hingepair.evaluation.kernel_flat_steps import flat
from hingepair.evaluation.kernel_math import FLAGS
from hingepair.evaluation.kernel_memory import (
    REGISTER,
    fence,
    load,
    load_block,
    prefetch,
    store,
    store_matrices,
    store_matrices_past,
    store_pairs,
    store_pairs_past,
    store_vectors,
    store_vectors_past,
)
from hingepair.evaluation.kernel_rows import LANES, OPERATIONS, PAST_CACHES
from hingepair.evaluation.kernel_steps import body1, pose2, rates2

_HINGE_TERMS, _TAIT_BRYAN, _PLACE_ALPHA1 = (OPERATIONS.index(n) for n in ("hinge", "tait_bryan", "place_alpha1"))
_AXIS_1, _TURN1 = OPERATIONS.index("axis"), OPERATIONS.index("turn1")


AHEAD = 4  # blocks from the one being computed to the one whose inputs are asked for


@njit(fastmath=FLAGS)
def _run(s: Any, operations: Any, place: Any) -> None:
    for operation in operations:
        if operation < _HINGE_TERMS or _TAIT_BRYAN <= operation <= _PLACE_ALPHA1:
            body1(s, operation, place)
        elif operation >= _TURN1:
            flat(s, operation)
        elif operation >= _AXIS_1:
            rates2(s, operation)
        else:
            pose2(s, operation)


@njit(fastmath=FLAGS, forceinline=True)
def _take(s: Any, inputs: Any, c: int, address: int, stride: int, count: int) -> None:
    """Load group c, the samples `stride` bytes apart, and give it its sign."""
    row, components, step = inputs[c, 0], inputs[c, 1], inputs[c, 2]
    ahead = address + AHEAD * LANES * stride
    if abs(step) >= 64:  # the components are each a run of its own
        for i in range(1, components):
            for k in range(0, LANES * stride, max(stride, 64)):
                prefetch(ahead + i * step + k)
    for k in range(0, LANES * stride, max(stride, 64)):
        prefetch(ahead + k)
    if stride == s.itemsize and count == LANES:
        for i in range(components):
            load_block(s, row + i * LANES, address + i * step)
    elif components == 3:
        for k in range(count):
            a = address + k * stride
            s[row + k] = load(s, a)
            s[row + LANES + k] = load(s, a + step)
            s[row + 2 * LANES + k] = load(s, a + 2 * step)
    else:
        for i in range(components):
            for k in range(count):
                s[row + i * LANES + k] = load(s, address + k * stride + i * step)
    if inputs[c, 3] < 0:
        for k in range(components * LANES):
            s[row + k] = -s[row + k]


@njit(fastmath=FLAGS, forceinline=True)
def _give(s: Any, outputs: Any, c: int, address: int, stride: int, count: int) -> None:
    """Store group c.

    Each kind has a loop of its own: one loop with the choice inside took 40 ns a sample where this takes 24.
    """
    row, components, step = outputs[c, 0], outputs[c, 1], outputs[c, 2]
    past = outputs[c, 3] == PAST_CACHES and address % 16 == 0
    side_by_side = count == LANES and step == s.itemsize and stride == components * step
    if side_by_side and components == 3 and past:
        for k in range(0, LANES, REGISTER // s.itemsize):
            store_vectors_past(s, row + k, address + k * stride)
    elif side_by_side and components == 3:
        for k in range(0, LANES, REGISTER // s.itemsize):
            store_vectors(s, row + k, address + k * stride)
    elif side_by_side and components == 2 and past:
        for k in range(0, LANES, REGISTER // s.itemsize):
            store_pairs_past(s, row + k, address + k * stride)
    elif side_by_side and components == 2:
        for k in range(0, LANES, REGISTER // s.itemsize):
            store_pairs(s, row + k, address + k * stride)
    elif side_by_side and components == 9 and past:
        for k in range(0, LANES, REGISTER // s.itemsize):
            store_matrices_past(s, row + k, address + k * stride)
    elif side_by_side and components == 9:
        for k in range(0, LANES, REGISTER // s.itemsize):
            store_matrices(s, row + k, address + k * stride)
    else:
        for i in range(components):
            for k in range(count):
                store(s, address + k * stride + i * step, s[row + i * LANES + k])


def kernel(s: Any, shape: Any, inputs: Any, outputs: Any, once: Any, each: Any, place: Any) -> None:
    """Run a plan over samples of two axes.

    Args:
        s: scratch array, of the dtype computed in; shape (kernel_rows.ROWS["end"],).
        shape: (outer, inner) samples.
        inputs: of each group of components (row, components, bytes between them, sign, address,
            outer stride, inner stride), all in bytes; shape (count, 7). Of what does not change along the inner axis
            the inner stride is 0.
        outputs: the same, but PAST_CACHES in place of the sign where they are too many to stay in the caches.
        once: operations that only need what does not change along the inner axis.
        each: the other operations.
        place: where the axes go: nine of a matrix, three of a vector, and the sign of the sequence.
    """
    for i in range(shape[0]):
        for c in range(len(inputs)):
            if inputs[c, 6] == 0:
                _take(s, inputs, c, inputs[c, 4] + i * inputs[c, 5], 0, LANES)
        _run(s, once, place)
        for start in range(0, shape[1], LANES):
            count = min(LANES, shape[1] - start)
            for c in range(len(inputs)):
                stride = inputs[c, 6]
                if stride != 0:
                    _take(s, inputs, c, inputs[c, 4] + i * inputs[c, 5] + start * stride, stride, count)
            _run(s, each, place)
            for c in range(len(outputs)):
                stride = outputs[c, 6]
                _give(s, outputs, c, outputs[c, 4] + i * outputs[c, 5] + start * stride, stride, count)
    fence()


def one_state(s: Any, values: Any, rows: Any, outputs: Any, operations: Any, place: Any, out: Any) -> None:
    """Run a plan on one state: values[i] goes to rows[i], and the rows in `outputs` to `out`."""
    for i in range(len(rows)):
        for k in range(LANES):
            s[rows[i] + k] = values[i]
    _run(s, operations, place)
    for i in range(len(outputs)):
        out[i] = s[outputs[i]]
