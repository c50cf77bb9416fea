"""Integrals of rates over steps (E12): the attitude of an angular velocity, and the angle of a scalar rate.

S' = [omega]x S, so S(t + h) = exp([Omega]x) S(t), and Omega is a Magnus series in commutators; those of [a]x and
[b]x are [a x b]x (Blanes, Casas, Ros: three Gauss nodes, order 6). Strapdown navigation knows the same terms as
multi-sample coning corrections (Bortz; Miller; Savage), with samples in place of nodes.

omega does not depend on the attitude, so the rotations of all steps are computed at once; the attitudes are their
prefix products. A scan works by a tree: it multiplies groups of neighbours one after the other, then the groups'
products in the same way, and hands those down to the groups' members. A small rotation is rounded in proportion to
its angle, and the tree multiplies small ones by small ones: only the last few levels round at the size of 1, as often
as the whole motion has radians, where a running product rounds at each of k steps. psi is a compensated sum.

A rotation is a quaternion (w, x, y, z). As in `equations`, a scalar is any value that adds and multiplies.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.loops import Loop
from hingepair.engine.trace import square_root, where_less
from hingepair.equations.spatial import Scalar, Vector, add, cross, dot, scale, subtract
from hingepair.errors import ArgumentError
from hingepair.motion.signals import ConstantSignal, Signal
from hingepair.numeric.arrays import FLOAT64
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.blocks import cosine, sine
from hingepair.numeric.bounded import UNIT_ROUNDOFF
from hingepair.numeric.twofold import (
    exact_product,
    exact_sum,
    twofold_product,
    twofold_quotient,
    twofold_sum,
)

Quaternion: TypeAlias = tuple[Scalar, Scalar, Scalar, Scalar]

_SQRT_15 = 3.872983346207417
NODES: Final = (0.5 - _SQRT_15 / 10, 0.5, 0.5 + _SQRT_15 / 10)  # Gauss nodes, as fractions of a step
_WEIGHTS = (5, 8, 5)  # of the nodes in an integral, to be divided by their sum
ORDER: Final = 6  # the error of the integral goes as h^ORDER


def quaternion_product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the product p q of quaternions: the rotation q followed by the rotation p."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - (b * x + c * y + d * z),
        (a * x + b * w) + (c * z - d * y),
        (a * y + c * w) + (d * x - b * z),
        (a * z + d * w) + (b * y - c * x),
    )


def quaternion_unit(q: Quaternion) -> Quaternion:
    """Return a quaternion of nearly unit norm, normalised by one Newton step for the inverse square root."""
    w, x, y, z = q
    f = 1.5 - 0.5 * ((w * w + x * x) + (y * y + z * z))
    return w * f, x * f, y * f, z * f


def quaternion_exp(Omega: Vector) -> Quaternion:
    """Return the unit quaternion of a rotation vector Omega [rad], of floats or traced values."""
    square = 0.25 * dot(Omega, Omega)
    if square == 0:  # a float; a traced value never compares equal to 0
        return 1.0, *scale(Omega, 0.5)
    half = square_root(square)
    f = where_less(0.0, square, 0.5 * sine(half) / half, 0.5)
    return cosine(half), Omega[0] * f, Omega[1] * f, Omega[2] * f


def magnus6(w1: Vector, w2: Vector, w3: Vector, h: Scalar) -> Vector:
    """Return the rotation vector Omega [rad] of a step of length h, from omega at three Gauss nodes; order 6.

    a1, a2 and a3 are h times omega at the middle node and times its first and second difference:
    Omega = a1 + a3/12 + [-20 a1 - a3 + c1, a2 + c2] / 240, c1 = [a1, a2], c2 = -[a1, 2 a3 + c1] / 60.
    """
    a1 = scale(w2, h)
    a2 = scale(subtract(w3, w1), h * (_SQRT_15 / 3))
    a3 = scale(subtract(subtract(w3, w2), subtract(w2, w1)), h * (10 / 3))
    c1 = cross(a1, a2)
    c2 = scale(cross(a1, add(scale(a3, 2), c1)), -1 / 60)
    outer = cross(subtract(c1, add(scale(a1, 20), a3)), add(a2, c2))
    return add(a1, add(scale(a3, 1 / 12), scale(outer, 1 / 240)))


def step_integrals(values: Any, h: Any) -> Any:
    """Return the integrals (steps, columns) over steps of lengths h of a quantity whose `values` at the nodes have
    the shape (steps, nodes, ...).
    """
    columns = values.reshape(len(h), len(NODES), -1)
    return h[:, None] * np.einsum("n,snk->sk", np.array(_WEIGHTS) / sum(_WEIGHTS), columns)


@functools.cache
def rotation_loop() -> Loop:
    """Return the `Loop` that computes the quaternions of steps from omega at the nodes and the step length h. For
    omega in body axes, h is to be negated; the quaternions are then those of the inverse rotations.
    """

    def step(v: dict[str, Any]) -> dict[str, Any]:
        w = v["omega"]
        return {"q": quaternion_exp(magnus6(w[:3], w[3:6], w[6:], v["h"]))}

    return Loop("turns_magnus6", step, {"omega": (len(NODES), 3), "h": ()}, {"q": (4,)})


@functools.cache
def angle_loop() -> Loop:
    """Return the `Loop` that integrates a scalar rate over each step, from the rate at the nodes and the step length
    h. The step length and the integral are sums of two doubles.
    """

    def step(v: dict[str, Any]) -> dict[str, Any]:
        weighted = [exact_product(p, float(weight)) for p, weight in zip(v["rate"], _WEIGHTS, strict=True)]
        total = functools.reduce(twofold_sum, weighted)
        return {"sum": twofold_product(twofold_quotient(total, float(sum(_WEIGHTS))), v["h"])}

    return Loop("rises_magnus6", step, {"rate": (len(NODES),), "h": (2,)}, {"sum": (2,)}, exact=True)


CHUNK: Final = 32768  # steps that are computed at a time: 2.4 MB of omega at three nodes
GROUP: Final = 16  # rotations that one kernel multiplies one after the other
_SEQUENTIAL = 64  # rotations up to which Python floats are faster than kernels
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])  # times a unit quaternion: its inverse


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

    def chunks(self) -> Iterator[slice]:
        """Return an iterator over slices of so few steps that their arrays stay in the caches."""
        return (slice(first, min(first + CHUNK, self.step_count)) for first in range(0, self.step_count, CHUNK))


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


@functools.cache
def _group_loop() -> Loop:
    """Return the `Loop` that multiplies the rotations of a group: all but the first, each with those before it."""

    def products(v: dict[str, Any]) -> dict[str, Any]:
        rotations = [v["q"][4 * k : 4 * k + 4] for k in range(GROUP)]
        return {"products": tuple(itertools.chain.from_iterable([*_products(rotations)][1:]))}

    return Loop("rotations_in_group", products, {"q": (GROUP, 4)}, {"products": (GROUP - 1, 4)})


@functools.cache
def _prefix_loop() -> Loop:
    """Return the `Loop` that multiplies a rotation with that before its group."""

    def product(v: dict[str, Any]) -> dict[str, Any]:
        return {"product": quaternion_unit(quaternion_product(v["q"], v["before"]))}

    return Loop("rotations_of_groups", product, {"q": (4,), "before": (4,)}, {"product": (4,)})


def _products(rotations: Any) -> Iterator[Any]:
    """Return the running products, later rotations on the left."""
    return itertools.accumulate(rotations, lambda before, later: quaternion_product(later, before))


def rotation_rows(count: int) -> Array:
    """Return rows for `count` rotations, as `multiply_rotations` needs them: further ones complete a group."""
    rows = np.empty((count if count <= _SEQUENTIAL else -(-count // GROUP) * GROUP, 4))
    rows[count:] = 1.0, 0.0, 0.0, 0.0
    return rows


def multiply_rotations(rows: Array, start: Quaternion, execution: Execution) -> None:
    """Replace each row k of `rotation_rows` in place by the product row_k ... row_1 row_0 start, normalised."""
    if len(rows) <= _SEQUENTIAL:
        for k, product in enumerate(_products(map(tuple, rows.tolist()))):
            rows[k] = quaternion_unit(quaternion_product(product, start))
        return
    groups = rows.reshape(-1, GROUP, 4)
    _group_loop().run({"q": groups}, {"products": groups[:, 1:]}, groups.shape[:1], FLOAT64, execution)
    ends = rotation_rows(len(groups))
    ends[: len(groups)] = groups[:, -1]
    multiply_rotations(ends, start, execution)
    before = np.concatenate([[start], ends[: len(groups) - 1]])[:, None]
    _prefix_loop().run({"q": groups, "before": before}, {"product": groups}, groups.shape[:2], FLOAT64, execution)


@dataclass(frozen=True, slots=True, eq=False)
class _RateIntegral:
    """Integral of a rate over steps."""

    name: str  # of the rate, for messages
    rate: Signal
    execution: Execution
    expected_rate: ClassVar[str]  # of messages on overflow

    @property
    def is_exact(self) -> bool:
        """Whether steps of any length have no truncation error."""
        return isinstance(self.rate, ConstantSignal)

    def check_finite(self, rows: Array, steps: Steps) -> None:
        """Raise an ArgumentError if the results at the ends of `steps` have overflowed."""
        if not np.isfinite(rows[-1]).all():
            first = int(np.argmin(np.isfinite(steps.at_instants(rows)).all(axis=1)))
            raise ArgumentError(
                self.name, self.expected_rate, f"overflow between the instants {first - 1} and {first}"
            )


@dataclass(frozen=True, slots=True, eq=False)
class AngleIntegral(_RateIntegral):
    """Integral of a scalar rate, an angle [rad]."""

    expected_rate: ClassVar[str] = "a rate whose integral is finite"
    default_start: ClassVar[Any] = 0.0  # where only changes matter

    @np.errstate(all="ignore")
    def integrate(self, steps: Steps, start: float) -> Array:
        """Return the angles [rad] at the ends of steps, accurate to about the last bit; shape (steps + 1,)."""
        if isinstance(self.rate, ConstantSignal):
            angles, _ = twofold_sum(
                twofold_product((self.rate.values, 0.0), exact_sum(steps.t, -steps.t[0])), (start, 0.0)
            )
        else:
            rows = np.zeros((1 + steps.step_count, 2))  # integrals of the steps, each a sum of two doubles
            rows[0, 0] = start
            for part in steps.chunks():
                begin, h = steps.t[:-1][part], exact_sum(steps.t[1:][part], -steps.t[:-1][part])
                rates = self.rate.values_at_nodes(begin, h[0], NODES)
                out = rows[1:][part]
                angle_loop().run({"rate": rates, "h": h}, {"sum": out}, out.shape[:1], FLOAT64, self.execution)
            # What each addition of the running sum loses is added up beside it.
            sums = np.cumsum(rows[:, 0])
            rows[1:, 1] += exact_sum(sums[:-1], rows[1:, 0])[1]
            angles = sums + np.cumsum(rows[:, 1])
        self.check_finite(angles[:, None], steps)
        return np.asarray(angles)

    def difference(self, coarse: Subdivision, fine: Subdivision, node_values: tuple[Array, ...]) -> Array:
        """Return the integrals over intervals by coarse steps less those by fine steps [rad]; (intervals, 1).
        `node_values` are the rates at the nodes of both.
        """
        sums = [
            steps.sum_over_intervals(step_integrals(values, steps.h))
            for steps, values in zip((coarse, fine), node_values, strict=True)
        ]
        return sums[0] - sums[1]

    def rounding_at_instants(self, values: Array, _: float) -> float:
        """Return the largest rounding error [rad] of the angles `values`, without the rounding of the steps."""
        return UNIT_ROUNDOFF * float(np.abs(values).max())

    def errors_at_start(self, _: Array, errors: Array) -> Array:
        """Return `errors` unchanged: errors of angles add up as they are."""
        return errors


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeIntegral(_RateIntegral):
    """Integral of an angular velocity omega, as unit quaternions (w, x, y, z): the solution of S' = [omega]x S.

    In body axes S' = S [omega]x, and S^T solves the first equation with -omega; a step depends on h omega only, so
    that h is negated.
    """

    omega_in_body_axes: bool
    expected_rate: ClassVar[str] = "a rate that turns by a finite angle in each step"
    default_start: ClassVar[Any] = np.array([1.0, 0.0, 0.0, 0.0])  # where only changes matter

    @np.errstate(all="ignore")
    def integrate(self, steps: Steps, start: Array) -> Array:
        """Return the attitudes at the ends of steps, without a jump of sign; shape (steps + 1, 4)."""
        start = start * _CONJUGATE if self.omega_in_body_axes else start
        count = steps.step_count
        rows = rotation_rows(count)
        for part in steps.chunks():
            begin, h = steps.t[:-1][part], np.diff(steps.t[part.start : part.stop + 1])
            self._compute_rotations(self.rate.values_at_nodes(begin, h, NODES), h, rows[part])
        multiply_rotations(rows, tuple(start.tolist()), self.execution)
        quats = np.concatenate([start[None], rows[:count]])
        self.check_finite(quats, steps)
        return quats * _CONJUGATE if self.omega_in_body_axes else quats

    def _compute_rotations(self, node_omega: Array, h: Array, quats: Array) -> None:
        """Write the rotation of each step, not accumulated, to `quats`: its inverse if omega is in body axes."""
        rotation_loop().run(
            {"omega": node_omega, "h": -h if self.omega_in_body_axes else h},
            {"q": quats},
            quats.shape[:-1],
            FLOAT64,
            self.execution,
        )

    def difference(self, coarse: Subdivision, fine: Subdivision, node_values: tuple[Array, ...]) -> Array:
        """Return the rotation vectors [rad] from the rotations over intervals by fine steps to those by coarse steps;
        (intervals, 3). `node_values` are omega at the nodes of both.
        """
        a, b = (self._interval_rotations(*steps) for steps in zip((coarse, fine), node_values, strict=True))
        w, x, y, z = quaternion_product(tuple(a), (b[0], -b[1], -b[2], -b[3]))
        length = np.sqrt(x * x + y * y + z * z)
        factor = np.where(length > 0, 2 * np.arctan2(length, np.abs(w)) / np.where(length > 0, length, 1.0), 2.0)
        factor *= np.copysign(1.0, -w if self.omega_in_body_axes else w)
        return np.asarray(np.stack([x, y, z], axis=-1) * factor[:, None])

    def _interval_rotations(self, subdivision: Subdivision, node_omega: Array) -> Array:
        """Return the products of the rotations of each interval's steps, by `_compute_rotations`; (4, intervals)."""
        quats = np.empty((len(subdivision.h), 4))
        self._compute_rotations(node_omega, subdivision.h, quats)
        q, part = quats.T.copy(), subdivision.part
        while len(part) > len(subdivision.counts):  # multiply neighbours
            even = np.flatnonzero(part % 2 == 0)
            later = np.minimum(even + 1, len(part) - 1)
            paired = part[later] == part[even] + 1
            first, second = even[paired], later[paired]
            q[:, first] = quaternion_product(tuple(q[:, second]), tuple(q[:, first]))
            q, part = q[:, even], part[even] // 2
        return q

    def rounding_at_instants(self, values: Array, size: float) -> float:
        """Return the largest rounding error [rad] of the attitudes `values`, without the rounding of the steps, which
        turn by `size` [rad] in all.
        """
        return UNIT_ROUNDOFF * (8 + 4 * math.sqrt(min(size, len(values))))

    def errors_at_start(self, quats: Array, errors: Array) -> Array:
        """Return errors of intervals, rotation vectors (..., P, 3), in the axes of the first instant, in which they
        add up. `quats` are the attitudes at the ends of the intervals.
        """
        q = quats if self.omega_in_body_axes else quats * _CONJUGATE
        w, axis = q[:, :1], q[:, 1:]
        twice = 2 * np.cross(axis, errors)
        return np.asarray(errors + w * twice + np.cross(axis, twice))


Integral: TypeAlias = AngleIntegral | AttitudeIntegral
