"""Steps in chunks, and prefix scans over them: from steps to attitudes and angles at the instants (E12).

omega does not depend on the attitude, so the rotations of all steps are computed at once; the attitudes are their
prefix products. A scan works by a tree: it multiplies groups of SCAN_GROUP_SIZE neighbours one after the other, then
the groups' products in the same way, and hands those down to the groups' members. A small rotation is rounded in
proportion to its angle, and the tree multiplies small ones by small ones: only the last few levels round at the size
of 1, as often as the whole motion has radians, where a running product rounds at each of k steps. psi is summed in
sums of two doubles.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.loops import Loop
from hingepair.integration.methods import quaternion_product, quaternion_unit
from hingepair.numeric.arrays import FLOAT64_DTYPE
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.twofold import HighLow, exact_sum, twofold_sum

STEPS_PER_CHUNK: Final = 16384
"""Steps that are computed at a time: 1.2 MB of omega at three nodes."""

SCAN_GROUP_SIZE: Final = 16
"""Elements of a group of a prefix scan, which are combined one after the other."""
MAX_SEQUENTIAL_SCAN_ELEMENTS: Final = 64
"""Elements that a scan combines one after the other as Python floats, without groups."""


class Steps(NamedTuple):
    """Steps of integration between consecutive times `t`. `instant_indices` are the indices of the times that are
    instants of the result; None means all times.
    """

    t: Array  # shape (steps + 1,)
    instant_indices: NDArray[np.intp] | None = None  # which of the times are the instants asked for; None: all

    @property
    def step_count(self) -> int:
        """Number of steps."""
        return len(self.t) - 1

    def at_instants(self, rows: Array) -> Array:
        """Return the rows of an array at the instants of the result; `rows` has a row for each of the times `t`."""
        return rows if self.instant_indices is None else rows[self.instant_indices]

    def refine(self, times: Array) -> Steps:
        """Return Steps that end at `times` as well; the instants of the result stay the same."""
        t = np.union1d(self.t, times)
        return Steps(t, np.searchsorted(t, self.at_instants(self.t)))

    def chunks(self) -> Iterator[tuple[int, int]]:
        """Return an iterator over pairs (first, last) of step indices, one for each chunk of at most STEPS_PER_CHUNK
        steps. The step with the index `last` is not in the chunk.
        """
        return (
            (first, min(first + STEPS_PER_CHUNK, self.step_count))
            for first in range(0, self.step_count, STEPS_PER_CHUNK)
        )

    def starts_and_lengths(self, first: int, last: int) -> tuple[Array, HighLow]:
        """Return a pair: the starts [s] of the steps with indices from `first` to before `last`, and their lengths
        [s] as a pair of arrays (high and low part).
        """
        return self.t[first:last], exact_sum(self.t[first + 1 : last + 1], -self.t[first:last])


class Subdivision(NamedTuple):
    """Intervals that are divided into equal steps each. `counts` are the numbers of steps of the intervals; `start`,
    `stop` and `part` are the start, the stop and the index in its interval of each step.
    """

    counts: NDArray[np.int64]  # steps of each interval
    start: Array  # of each step
    stop: Array  # of each step
    part: NDArray[np.int64]  # index of each step in its interval

    @property
    def h(self) -> Array:
        """Lengths of the steps [s]."""
        return self.stop - self.start

    def sum_over_intervals(self, rows: Array) -> Array:
        """Return the sums of `rows`, one row for each step, over the steps of each interval."""
        return np.asarray(np.add.reduceat(rows, np.cumsum(self.counts) - self.counts))


def subdivide(start: Array, stop: Array, counts: NDArray[np.int64]) -> Subdivision:
    """Divide the intervals from `start` to `stop` into `counts` equal steps each; return a `Subdivision`. Within an
    interval, the end of a step is exactly the start of the next one.
    """
    ends = np.cumsum(counts)
    part = np.arange(ends[-1]) - np.repeat(ends - counts, counts)
    begin = np.repeat(start, counts) + part * np.repeat((stop - start) / counts, counts)
    after = np.append(begin[1:], stop[-1])
    after[ends - 1] = stop
    return Subdivision(counts, begin, after, part)


class PrefixScan:
    """Prefix scan, which computes for each k the product of the first k elements, with later elements on the left. An
    element is a tuple of numbers, and the product is any associative operation on two elements. `scan` works on an
    array of elements in place, and `scan_steps` on the elements of integration steps.

    Args:
        name: of the operation, for the names of kernels.
        combine: the operation, of a later and an earlier element.
        neutral: the element that changes nothing.
        finish: applied to every final result, as a normalisation.
        exact: whether the operation must not be fused or reordered by the compiler.
    """

    def __init__(
        self,
        name: str,
        combine: Callable[[Any, Any], Any],
        neutral: tuple[float, ...],
        finish: Callable[[Any], Any] = lambda result: result,
        *,
        exact: bool = False,
    ) -> None:
        self.combine = combine
        self.neutral = neutral
        self.finish = finish
        shape = (len(neutral),)
        inputs, out = {"element": shape, "prefix": shape}, {"element": shape}

        def combine_and_finish(v: dict[str, Any]) -> dict[str, Any]:
            return {"element": finish(combine(v["element"], v["prefix"]))}

        self._scan_group = Loop(
            f"{name}_in_group",
            lambda v: {"element": combine(v["element"], v["prefix"])},
            inputs,
            out,
            exact=exact,
            carry={"prefix": "element"},
        )
        self._apply_prefix = Loop(f"{name}_of_groups", combine_and_finish, inputs, out, exact=exact)

    def scan_steps(
        self,
        steps: Steps,
        start: tuple[Any, ...],
        write_elements: Callable[[Array, HighLow, Array], None],
        execution: Execution,
        motions: tuple[int, ...] = (),
    ) -> Array:
        """Return, for all k from 0 to the number of steps, the product of the elements of the first k steps, with
        later steps on the left, and of the element `start`, a tuple of components, on the right. Every product but
        `start` itself goes through the scan's function `finish`. The result is an array of shape (*motions, steps +
        1, width). `write_elements` is a function of starts and lengths (two doubles) of steps and of rows, into which
        it writes the elements of these steps. `motions` is the leading shape of many motions.

        Products of chunks are combined pairwise, so that no long part is combined with a much shorter one. Of many
        motions rows are (*motions, steps + 1, k), and the components of the start arrays that broadcast to the
        motions.
        """
        rows = np.empty((*motions, 1 + _padded_length(steps.step_count), len(start)))
        rows[..., 0, :], rows[..., 1 + steps.step_count :, :] = np.stack(start, axis=-1), self.neutral
        parts: list[tuple[int, tuple[Any, ...]]] = []  # number of chunks, a power of two, and their product
        for first, last in steps.chunks():
            stop = rows.shape[-2] if last == steps.step_count else last + 1
            count, chunk = 1, rows[..., first + 1 : stop, :]
            write_elements(*steps.starts_and_lengths(first, last), chunk[..., : last - first, :])
            before = functools.reduce(lambda whole, part: self.combine(part[1], whole), parts, start)
            product = self.scan(chunk, before, execution)
            while parts and parts[-1][0] == count:
                product, count = self.combine(product, parts.pop()[1]), 2 * count
            parts.append((count, product))
        return rows[..., : steps.step_count + 1, :]

    def padded_buffer(self, count: int, motions: tuple[int, ...] = ()) -> Array:
        """Return a new array of rows for `count` elements of each motion, as `scan` needs it; `motions` is the
        leading shape of the motions. Only the additional rows, which complete groups, are filled, with the neutral
        element.
        """
        rows = np.empty((*motions, _padded_length(count), len(self.neutral)))
        rows[..., count:, :] = self.neutral
        return rows

    def scan(self, rows: Array, start: tuple[Any, ...], execution: Execution) -> Any:
        """Replace each row k of `rows`, a `padded_buffer`, in place by finish(row_k ... row_1 row_0 start). `start`
        is a tuple of components, and `finish` is the function that the scan applies to every final result, such as a
        normalisation. Return the product of all rows as a tuple, without `start` and unfinished.
        """
        motions, count = rows.shape[:-2], rows.shape[-2]
        if count <= MAX_SEQUENTIAL_SCAN_ELEMENTS:
            # Of one motion the components are floats, which are faster than arrays of one element.
            elements = np.moveaxis(rows, (-2, -1), (0, 1)).copy() if motions else rows.tolist()
            products = list(itertools.accumulate(map(tuple, elements), lambda a, b: self.combine(b, a)))
            finished = [self.finish(self.combine(product, start)) for product in products]
            rows[:] = np.moveaxis(np.array(finished), (0, 1), (-2, -1)) if motions else finished
            return products[-1]
        groups = rows.reshape(*motions, -1, SCAN_GROUP_SIZE, rows.shape[-1])
        group_count = groups.shape[-3]
        neutral = np.broadcast_to(self.neutral, groups[..., 0, :].shape)
        self._run_in_place(self._scan_group, groups, neutral, execution)
        ends = self.padded_buffer(group_count, motions)
        ends[..., :group_count, :] = groups[..., -1, :]
        whole = self.scan(ends, start, execution)
        first = np.broadcast_to(np.stack(start, axis=-1), (*motions, rows.shape[-1]))[..., None, :]
        before = np.concatenate([first, ends[..., : group_count - 1, :]], axis=-2)
        self._run_in_place(self._apply_prefix, groups, before[..., None, :], execution)
        return whole

    def _run_in_place(self, loop: Loop, elements: Array, prefixes: Array, execution: Execution) -> None:
        """Run a Loop that replaces `elements` in place by their products with `prefixes`, the products of all
        elements before them, on the right; return None.
        """
        loop.run(
            {"element": elements, "prefix": prefixes},
            {"element": elements},
            elements.shape[:-1],
            FLOAT64_DTYPE,
            execution,
        )


def _padded_length(count: int) -> int:
    """Return the number of rows of a buffer for `count` elements: a multiple of SCAN_GROUP_SIZE, or `count` if there
    are at most MAX_SEQUENTIAL_SCAN_ELEMENTS.
    """
    return count if count <= MAX_SEQUENTIAL_SCAN_ELEMENTS else -(-count // SCAN_GROUP_SIZE) * SCAN_GROUP_SIZE


ROTATION_SCAN: Final = PrefixScan("rotations", quaternion_product, (1.0, 0.0, 0.0, 0.0), quaternion_unit)
"""Scan of rotations, quaternions (w, x, y, z) that are multiplied."""
HIGH_LOW_SUM_SCAN: Final = PrefixScan("sums", twofold_sum, (0.0, 0.0), exact=True)
"""Scan of angles, sums of two doubles that are added."""
