"""Integrals of rates (E12): the attitude of an angular velocity, and the angle of a scalar rate.

Both can be evaluated over steps and compared between two subdivisions of the same intervals, which is all that
`step_selection` and `error_estimate` need.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np

from hingepair.engine.backend import Execution
from hingepair.errors import ArgumentError
from hingepair.motion.methods import NODES, angle_loop, quaternion_product, rotation_loop, step_integrals
from hingepair.motion.signals import ConstantSignal, Signal
from hingepair.motion.stepping import HIGH_LOW_SUM_SCAN, ROTATION_SCAN, Steps, Subdivision
from hingepair.numeric.arrays import FLOAT64
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.bounded import UNIT_ROUNDOFF
from hingepair.numeric.twofold import HighLow, exact_sum, twofold_product, twofold_sum

_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])  # times a unit quaternion: its inverse


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
        """Raise an ArgumentError if the results of one motion at the ends of `steps` have overflowed."""
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
    max_error: ClassVar[float] = math.inf  # rad

    @np.errstate(all="ignore")
    def integrate(self, steps: Steps, start: Any) -> Array:
        """Return the angles [rad] at the ends of steps, accurate to about the last bit; shape (steps + 1,). Starts
        (...,) of many motions give (..., steps + 1), in which overflow is not refused.
        """
        motions = np.broadcast_shapes(np.shape(start), self.rate.motions)
        if isinstance(self.rate, ConstantSignal):
            change = twofold_product((np.asarray(self.rate.value)[..., None], 0.0), exact_sum(steps.t, -steps.t[0]))
            angles = np.stack(twofold_sum(change, (np.asarray(start)[..., None], 0.0)), axis=-1)
        else:
            low = np.zeros(np.shape(start)) if motions else 0.0
            angles = HIGH_LOW_SUM_SCAN.scan_steps(
                steps, (start, low), self._write_step_integrals, self.execution, motions
            )
        if not motions:
            self.check_finite(angles, steps)
        return angles[..., 0].copy()

    def _write_step_integrals(self, begin: Array, h: HighLow, rows: Array) -> None:
        """Write the integral of each step, a sum of two doubles, to `rows` (..., steps, 2)."""
        arguments = {"rate": self.rate.values_at_nodes(begin, h[0], NODES), "h": h}
        angle_loop().run(arguments, {"sum": rows}, rows.shape[:-1], FLOAT64, self.execution)

    def difference(self, coarse: Subdivision, fine: Subdivision, node_values: tuple[Array, Array]) -> Array:
        """Return the integrals over intervals by coarse steps less those by fine steps [rad]; (intervals, 1).
        `node_values` are the rates at the nodes of both.
        """
        sums = [
            steps.sum_over_intervals(step_integrals(values, steps.h))
            for steps, values in zip((coarse, fine), node_values, strict=True)
        ]
        return sums[0] - sums[1]

    def rounding_of_sums(self, sizes: Array, _: Array) -> Array:
        """Return the rounding errors [rad] of sums over intervals; `sizes` are the integrals of abs(rate) [rad]."""
        return UNIT_ROUNDOFF * sizes

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
    max_error: ClassVar[float] = math.pi  # rad

    @np.errstate(all="ignore")
    def integrate(self, steps: Steps, start: Array) -> Array:
        """Return the attitudes at the ends of steps, without a jump of sign; shape (steps + 1, 4). Starts (..., 4) of
        many motions give (..., steps + 1, 4), in which overflow is not refused.
        """
        begin = start * _CONJUGATE if self.omega_in_body_axes else start
        motions = np.broadcast_shapes(start.shape[:-1], self.rate.motions)
        components = tuple(np.moveaxis(begin, -1, 0)) if motions else tuple(begin.tolist())
        quats = ROTATION_SCAN.scan_steps(steps, components, self._write_step_rotations, self.execution, motions)
        if not motions:
            self.check_finite(quats, steps)
        return quats * _CONJUGATE if self.omega_in_body_axes else quats

    def _write_step_rotations(self, begin: Array, h: HighLow, rows: Array) -> None:
        self._compute_rotations(self.rate.values_at_nodes(begin, h[0], NODES), h[0], rows)

    def _compute_rotations(self, node_omega: Array, h: Array, quats: Array) -> None:
        """Write the rotation of each step, not accumulated, to `quats`: its inverse if omega is in body axes."""
        rotation_loop().run(
            {"omega": node_omega, "h": -h if self.omega_in_body_axes else h},
            {"q": quats},
            quats.shape[:-1],
            FLOAT64,
            self.execution,
        )

    def difference(self, coarse: Subdivision, fine: Subdivision, node_values: tuple[Array, Array]) -> Array:
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

    def rounding_of_sums(self, sizes: Array, steps: Array) -> Array:
        """Return the rounding errors [rad] of products of rotations over intervals, which grow as a random walk.
        `sizes` are the angles turned in the intervals [rad], `steps` their numbers of steps.
        """
        return np.asarray(UNIT_ROUNDOFF * np.minimum(sizes, 4 * np.sqrt(np.minimum(sizes, steps))))

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
