"""Steps in chunks, and prefix scans over them: from steps to attitudes and angles at the instants (E12).

omega does not depend on the attitude, so the rotations of all steps are computed at once; the attitudes are their
prefix products. A scan works by a tree: it multiplies groups of neighbours one after the other, then the groups'
products in the same way, and hands those down to the groups' members. A small rotation is rounded in proportion to
its angle, and the tree multiplies small ones by small ones: only the last few levels round at the size of 1, as often
as the whole motion has radians, where a running product rounds at each of k steps. psi is summed in sums of two
doubles.
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
from hingepair.motion.methods import quaternion_product, quaternion_unit
from hingepair.numeric.arrays import FLOAT64
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.twofold import HighLow, exact_sum, twofold_sum

CHUNK: Final = 16384  # steps that are computed at a time: 1.2 MB of omega at three nodes
GROUP: Final = 16  # elements of a scan that one kernel combines one after the other
_SEQUENTIAL = 64  # elements up to which Python floats are faster than kernels


class Steps(NamedTuple):
    """Times between which steps of integration go, and which of them are instants asked for."""

    t: Array  # shape (steps + 1,)
    instant_indices: NDArray[np.intp] | None = None  # which of the times are the instants asked for; None: all

    @property
    def step_count(self) -> int:
        """Number of steps."""
        return len(self.t) - 1

    def at_instants(self, rows: Array) -> Array:
        """Return the rows at the instants of the result; `rows` has a row for each of the times `t`."""
        return rows if self.instant_indices is None else rows[self.instant_indices]

    def refine(self, times: Array) -> Steps:
        """Return Steps that end at `times` as well; the instants of the result stay the same."""
        t = np.union1d(self.t, times)
        return Steps(t, np.searchsorted(t, self.at_instants(self.t)))

    def chunks(self) -> Iterator[tuple[int, int]]:
        """Return an iterator over the first step of each chunk and the first one after it."""
        return ((first, min(first + CHUNK, self.step_count)) for first in range(0, self.step_count, CHUNK))

    def starts_and_lengths(self, first: int, last: int) -> tuple[Array, HighLow]:
        """Return the starts [s] of the steps from `first` to before `last`, and their lengths as two doubles [s]."""
        return self.t[first:last], exact_sum(self.t[first + 1 : last + 1], -self.t[first:last])


class Subdivision(NamedTuple):
    """Intervals that are divided into equal steps each."""

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
    """Divide the intervals from `start` to `stop` into `counts` equal steps each. Within an interval, the end of a
    step is exactly the start of the next one.
    """
    ends = np.cumsum(counts)
    part = np.arange(ends[-1]) - np.repeat(ends - counts, counts)
    begin = np.repeat(start, counts) + part * np.repeat((stop - start) / counts, counts)
    after = np.append(begin[1:], stop[-1])
    after[ends - 1] = stop
    return Subdivision(counts, begin, after, part)


class PrefixScan:
    """Prefix scan: for each k the product of the first k elements, with later elements on the left.

    Args:
        name: of the kernels.
        combine: the operation, of a later and an earlier element; associative.
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
        width = len(neutral)

        def products(v: dict[str, Any]) -> dict[str, Any]:
            elements = [v["elements"][width * k : width * (k + 1)] for k in range(GROUP)]
            later = itertools.islice(itertools.accumulate(elements, lambda a, b: combine(b, a)), 1, None)
            return {"products": tuple(itertools.chain.from_iterable(later))}

        def prefixed(v: dict[str, Any]) -> dict[str, Any]:
            return {"product": finish(combine(v["element"], v["prefix"]))}

        # All elements but the first become their products with those before them.
        self._multiply_group = Loop(
            f"{name}_in_group", products, {"elements": (GROUP, width)}, {"products": (GROUP - 1, width)}, exact=exact
        )
        pair = {"element": (width,), "prefix": (width,)}
        self._apply_prefix = Loop(f"{name}_of_groups", prefixed, pair, {"product": (width,)}, exact=exact)

    def scan_steps(
        self,
        steps: Steps,
        start: tuple[Any, ...],
        write_elements: Callable[[Array, HighLow, Array], None],
        execution: Execution,
        motions: tuple[int, ...] = (),
    ) -> Array:
        """Return the products of the elements of the first k steps and of `start`, for all k.

        Args:
            steps: the steps.
            start: components of the first element; of many motions arrays that broadcast to `motions`.
            write_elements: takes starts and lengths (two doubles) of steps, and writes their elements into rows.
            execution: backend and number of threads.
            motions: leading shape of many motions.

        Returns:
            Products, shape (*motions, steps + 1, width), each but `start` itself finished.
        """
        rows = np.empty((*motions, 1 + _padded_length(steps.step_count), len(start)))
        rows[..., 0, :], rows[..., 1 + steps.step_count :, :] = np.stack(start, axis=-1), self.neutral
        # Chunks are combined pairwise, so that no long part is combined with a much shorter one.
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
        """Return rows for `count` elements of each motion, as `scan` needs them: neutral ones complete a group."""
        rows = np.empty((*motions, _padded_length(count), len(self.neutral)))
        rows[..., count:, :] = self.neutral
        return rows

    def scan(self, rows: Array, start: tuple[Any, ...], execution: Execution) -> Any:
        """Replace each row k of `rows`, a `padded_buffer`, in place by finish(row_k ... row_1 row_0 start). Return
        the product of all rows, without `start` and unfinished.
        """
        motions, count = rows.shape[:-2], rows.shape[-2]
        if count <= _SEQUENTIAL:
            # Of one motion the components are floats, which are faster than arrays of one element.
            elements = np.moveaxis(rows, (-2, -1), (0, 1)).copy() if motions else rows.tolist()
            products = list(itertools.accumulate(map(tuple, elements), lambda a, b: self.combine(b, a)))
            finished = [self.finish(self.combine(product, start)) for product in products]
            rows[:] = np.moveaxis(np.array(finished), (0, 1), (-2, -1)) if motions else finished
            return products[-1]
        # Within groups.
        groups = rows.reshape(*motions, -1, GROUP, rows.shape[-1])
        shape = groups.shape[:-2]
        self._multiply_group.run({"elements": groups}, {"products": groups[..., 1:, :]}, shape, FLOAT64, execution)
        # Over the products of whole groups.
        ends = self.padded_buffer(shape[-1], motions)
        ends[..., : shape[-1], :] = groups[..., -1, :]
        whole = self.scan(ends, start, execution)
        # Into the groups.
        first = np.broadcast_to(np.stack(start, axis=-1), (*motions, rows.shape[-1]))[..., None, :]
        before = np.concatenate([first, ends[..., : shape[-1] - 1, :]], axis=-2)[..., None, :]
        self._apply_prefix.run(
            {"element": groups, "prefix": before}, {"product": groups}, groups.shape[:-1], FLOAT64, execution
        )
        return whole


def _padded_length(count: int) -> int:
    return count if count <= _SEQUENTIAL else -(-count // GROUP) * GROUP


# Attitudes from the rotations of steps, and sums of two doubles from their integrals.
ROTATION_SCAN: Final = PrefixScan("rotations", quaternion_product, (1.0, 0.0, 0.0, 0.0), quaternion_unit)
HIGH_LOW_SUM_SCAN: Final = PrefixScan("sums", twofold_sum, (0.0, 0.0), exact=True)
