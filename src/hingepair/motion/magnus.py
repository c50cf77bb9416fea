"""Integrals of rates over steps (E12): the attitude of an angular velocity, and the angle of a scalar rate.

S' = [omega]x S, so S(t + h) = exp([Omega]x) S(t), and Omega is a Magnus series in commutators; those of [a]x and
[b]x are [a x b]x (Blanes, Casas, Ros: three Gauss nodes, order 6). Strapdown navigation knows the same terms as
multi-sample coning corrections (Bortz; Miller; Savage), with samples in place of nodes.

omega does not depend on the attitude, so the rotations of all steps are computed at once; the attitudes are their
prefix products: neighbours are multiplied in pairs, the pairs in the same way, and the attitudes after each pair give
those between. A small rotation is rounded in proportion to its angle, and small ones are multiplied by small ones:
only the last few levels round at the size of 1, as often as the whole motion has radians, where a running product
rounds at each of k steps. psi is a compensated sum.

A rotation is a quaternion (w, x, y, z). As in `equations`, a scalar is any value that adds and multiplies.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.loops import Loop
from hingepair.engine.trace import square_root, where_less
from hingepair.equations.spatial import Scalar, Vector, add, cross, dot, scale, subtract
from hingepair.motion.signals import Signal
from hingepair.numeric.arrays import FLOAT64
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.blocks import cosine, sine
from hingepair.numeric.bounded import UNIT_ROUNDOFF
from hingepair.numeric.twofold import exact_sum

Quaternion: TypeAlias = tuple[Scalar, Scalar, Scalar, Scalar]

_SQRT_15 = 3.872983346207417
NODES: Final = (0.5 - _SQRT_15 / 10, 0.5, 0.5 + _SQRT_15 / 10)  # Gauss nodes, as fractions of a step
ORDER: Final = 6  # the error of the integral goes as h^ORDER
CHUNK: Final = 32768  # steps that are computed at a time: 2.4 MB of omega at three nodes
_SEQUENTIAL = 64  # rotations up to which Python floats are faster than kernels
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])  # times a unit quaternion: its inverse


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


def step_means(values: Array) -> Array:
    """Return the means over steps of a quantity with `values` at the nodes, (steps, nodes, ...)."""
    return np.asarray((5 * values[:, 0] + 8 * values[:, 1] + 5 * values[:, 2]) / 18)  # integers: 5/18 is rounded


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
def _product_loop() -> Loop:
    """Return the `Loop` that multiplies rotations with those before them."""

    def product(v: dict[str, Any]) -> dict[str, Any]:
        return {"product": quaternion_unit(quaternion_product(v["q"], v["before"]))}

    return Loop("rotations_of_pairs", product, {"q": (4,), "before": (4,)}, {"product": (4,)})


def multiply_rotations(rows: Array, execution: Execution) -> None:
    """Replace each row k of quaternions in place by the product row_k ... row_1 row_0, normalised."""

    def multiply(q: Array, before: Array, out: Array) -> None:
        _product_loop().run({"q": q, "before": before}, {"product": out}, out.shape[:1], FLOAT64, execution)

    if len(rows) <= _SEQUENTIAL:
        before = tuple(rows[0].tolist())
        for k, row in enumerate(rows[1:].tolist(), 1):
            rows[k] = before = quaternion_unit(quaternion_product(tuple(row), before))
        return
    pairs = np.empty((len(rows) // 2, 4))
    multiply(rows[1::2], rows[: 2 * len(pairs) : 2], pairs)
    multiply_rotations(pairs, execution)
    rows[1::2] = pairs
    later = rows[2::2]
    multiply(later, pairs[: len(later)], later)


class Steps(NamedTuple):
    """Times between which steps of integration go, and which of them are instants asked for."""

    t: Array  # shape (steps + 1,)
    instant_indices: NDArray[np.intp] | None = None  # which of the times are the instants asked for; None: all

    @property
    def step_count(self) -> int:
        """Number of steps."""
        return len(self.t) - 1

    @property
    def h(self) -> Array:
        """Lengths of the steps [s]."""
        return np.diff(self.t)

    def at_instants(self, rows: Array) -> Array:
        """Return the rows at the instants of the result; `rows` has a row for each of the times `t`."""
        return rows if self.instant_indices is None else rows[self.instant_indices]

    def divided(self, counts: NDArray[np.int64]) -> Steps:
        """Return each step divided into so many equal ones."""
        first = np.cumsum(np.append(0, counts))  # of the parts of each step
        part = np.arange(first[-1]) - np.repeat(first[:-1], counts)
        t = np.repeat(self.t[:-1], counts) + part * np.repeat(self.h / counts, counts)
        own: Any = self.at_instants(first)
        return Steps(np.append(t, self.t[-1]), own)

    def no_longer_than(self, share: float) -> Steps:
        """Return the steps, those that are longer than a share of the whole time divided."""
        parts = np.ceil(self.h / (share * (self.t[-1] - self.t[0])))
        return self.divided(np.clip(np.nan_to_num(parts, nan=1.0), 1, 1 / share).astype(np.int64))

    def chunks(self) -> Iterator[tuple[slice, Array, Array]]:
        """Yield slices of so few steps that their arrays stay in the caches, with their starts and lengths."""
        for first in range(0, self.step_count, CHUNK):
            part = slice(first, first + CHUNK)
            yield part, self.t[:-1][part], np.diff(self.t[first : first + CHUNK + 1])


@dataclass(frozen=True, slots=True, eq=False)
class AngleIntegral:
    """Integral of a scalar rate, an angle [rad]."""

    name: str  # of the rate, for messages
    rate: Signal
    execution: Execution
    start: Any  # at the first instant

    @np.errstate(all="ignore")
    def changes(self, steps: Steps) -> Array:
        """Return the changes over steps; shape (steps,)."""
        found = np.empty(steps.step_count)
        for part, start, h in steps.chunks():
            found[part] = h * step_means(self.rate.values_at_nodes(start, h, NODES))
        return found

    @np.errstate(all="ignore")
    def accumulated(self, changes: Array) -> Array:
        """Return the angles [rad] at the ends of steps, accurate to about the last bit; shape (steps + 1,)."""
        sums = np.cumsum(np.append(self.start, changes))
        lost = exact_sum(sums[:-1], changes)[1]  # by each addition
        return np.asarray(sums + np.append(0.0, np.cumsum(lost)))

    @staticmethod
    def of_groups(changes: Array, size: int) -> Array:
        """Return the changes over groups of so many steps."""
        return np.asarray(changes.reshape(-1, size).sum(axis=1))

    @staticmethod
    def distances(a: Array, b: Array) -> Array:
        """Return the distances between angles [rad]."""
        return np.abs(a - b)

    def rounding(self, angles: Array) -> float:
        """Return the largest rounding error [rad] of the angles, without the rounding of the steps."""
        return UNIT_ROUNDOFF * float(np.abs(angles).max())


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeIntegral:
    """Integral of an angular velocity omega, as unit quaternions (w, x, y, z): the solution of S' = [omega]x S.

    In body axes S' = S [omega]x, and S^T solves the first equation with -omega; a step depends on h omega only, so
    that h is negated.
    """

    name: str  # of the rate, for messages
    rate: Signal
    execution: Execution
    start: Array
    omega_in_body_axes: bool

    @np.errstate(all="ignore")
    def changes(self, steps: Steps) -> Array:
        """Return the rotations of steps: their inverses if omega is in body axes; shape (steps, 4)."""
        found = np.empty((steps.step_count, 4))
        for part, start, h in steps.chunks():
            inputs = {
                "omega": self.rate.values_at_nodes(start, h, NODES),
                "h": -h if self.omega_in_body_axes else h,
            }
            rotation_loop().run(inputs, {"q": found[part]}, h.shape, FLOAT64, self.execution)
        return found

    @np.errstate(all="ignore")
    def accumulated(self, changes: Array) -> Array:
        """Return the attitudes at the ends of steps, without a jump of sign; shape (steps + 1, 4)."""
        conjugate = _CONJUGATE if self.omega_in_body_axes else 1.0
        rows = np.concatenate([(self.start * conjugate)[None], changes])
        multiply_rotations(rows, self.execution)
        return rows * conjugate if self.omega_in_body_axes else rows

    @staticmethod
    def of_groups(changes: Array, size: int) -> Array:
        """Return the rotations of groups of so many steps."""
        product: Any = tuple(changes[::size].T)
        for k in range(1, size):
            product = quaternion_product(tuple(changes[k::size].T), product)
        return np.stack(product, axis=-1)

    @staticmethod
    def distances(a: Array, b: Array) -> Array:
        """Return the angles between rotations [rad]."""
        inverse, other = tuple((a * _CONJUGATE).T), tuple(b.T)
        w, x, y, z = quaternion_product(inverse, other)
        return np.asarray(2 * np.arctan2(np.sqrt(x * x + y * y + z * z), np.abs(w)))

    def rounding(self, quats: Array) -> float:
        """Return the largest rounding error [rad] of the attitudes, without the rounding of the steps."""
        turned = float(self.distances(quats[:-1], quats[1:]).sum())
        return UNIT_ROUNDOFF * (8 + 4 * math.sqrt(min(turned, len(quats))))


Integral: TypeAlias = AngleIntegral | AttitudeIntegral
