"""What is integrated (E12): the attitude that an angular velocity makes, and the angle that a rate makes.

Each knows what its steps come to, and how far apart two ways to take them are: `step_selection` and `error_estimate`
ask no more of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np

from hingepair.engine.backend import Execution
from hingepair.errors import ArgumentError
from hingepair.integration.methods import RULES, Rule, quaternion_product, rises, turns
from hingepair.integration.signals import Constant, Signal
from hingepair.integration.stepping import ROTATIONS, SUMS, Division, Steps
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.twofold import HighLow, exact_sum, pair_product, pair_sum

_U = 2.0**-53
_INVERSE = np.array([1.0, -1.0, -1.0, -1.0])
_F8 = np.dtype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class _OfRate:
    """What a rate makes."""

    name: str  # of the rate, for messages
    rate: Signal
    rule: Rule  # that makes the steps
    how: Execution
    finite: ClassVar[str]

    def check_finite(self, rows: Array, steps: Steps) -> None:
        """Refuse what has overflowed on the way, which the last row shows; names the first interval that did."""
        if not np.isfinite(rows[-1]).all():
            first = int(np.argmin(np.isfinite(steps.asked(rows)).all(axis=1)))
            raise ArgumentError(self.name, self.finite, f"overflow between the instants {first - 1} and {first}")


@dataclass(frozen=True, slots=True, eq=False)
class Angle(_OfRate):
    """The integral of a rate."""

    finite: ClassVar[str] = "a rate whose integral is finite"
    neutral: ClassVar[Any] = 0.0  # where it may start if only changes matter
    farthest: ClassVar[float] = math.inf

    @property
    def exact(self) -> bool:
        """Whether steps of any length are exact."""
        return isinstance(self.rate, Constant)

    @np.errstate(all="ignore")
    def over(self, steps: Steps, start: float) -> Array:
        """The angles between steps, to the last bit or so of the sum; shape (steps + 1,)."""
        if isinstance(self.rate, Constant):
            turned = pair_product((self.rate.value, 0.0), exact_sum(steps.t, -steps.t[0]))
            found = np.stack(pair_sum(turned, (start, 0.0)), axis=-1)
        else:
            found = SUMS.over(steps, (start, 0.0), self._fill, self.how)
        self.check_finite(found, steps)
        return found[:, 0].copy()

    def _fill(self, begin: Array, h: HighLow, rows: Array) -> None:
        given = {"rate": self.rate.nodes(begin, h[0], self.rule.nodes), "h": h}
        rises(self.rule).run(given, {"sum": rows}, h[0].shape, _F8, self.how)

    def apart(self, coarse: Division, fine: Division, nodes: tuple[Array, Array]) -> Array:
        """What the steps of one division of intervals make less what those of a finer one make; shape (P, 1)."""
        sums = [
            parts.added(self.rule.integral(values, parts.h))
            for parts, values in zip((coarse, fine), nodes, strict=True)
        ]
        return sums[0] - sums[1]

    def rounded(self, sizes: Array, _: Array) -> Array:
        """How far rounding takes sums over intervals, whose size is that of the integral."""
        return _U * sizes

    def rounded_on_the_way(self, values: Array, _: float) -> float:
        """How far rounding takes the angles at the instants, beside that of steps."""
        return _U * float(np.abs(values).max())

    def added_up(self, _: Array, errors: Array) -> Array:
        """Errors of intervals as they add up."""
        return errors


@dataclass(frozen=True, slots=True, eq=False)
class Attitude(_OfRate):
    """The solution of S' = [omega]x S, or of S' = S [omega]x in body axes, as unit quaternions (w, x, y, z).

    The latter is the former for S^T and -omega; a step depends on h omega only, so that -h serves.
    """

    body: bool
    finite: ClassVar[str] = "angles of each step that have a sine"
    neutral: ClassVar[Any] = np.array([1.0, 0.0, 0.0, 0.0])
    farthest: ClassVar[float] = math.pi

    @property
    def exact(self) -> bool:
        """Whether steps have no truncation: rotations about one axis, but for Runge and Kutta's."""
        return isinstance(self.rate, Constant) and self.rule is not RULES["rk4_quaternion"]

    @np.errstate(all="ignore")
    def over(self, steps: Steps, start: Array) -> Array:
        """The attitudes between steps, without a jump of their sign; shape (steps + 1, 4)."""
        begin = start * _INVERSE if self.body else start
        found = ROTATIONS.over(steps, tuple(begin.tolist()), self._fill, self.how)
        self.check_finite(found, steps)
        return found * _INVERSE if self.body else found

    def _fill(self, begin: Array, h: HighLow, rows: Array) -> None:
        self._turns(self.rate.nodes(begin, h[0], self.rule.nodes), h[0], rows)

    def _turns(self, nodes: Array, h: Array, rows: Array) -> None:
        turns(self.rule).run({"omega": nodes, "h": -h if self.body else h}, {"q": rows}, h.shape, _F8, self.how)

    def apart(self, coarse: Division, fine: Division, nodes: tuple[Array, Array]) -> Array:
        """The rotation from what a finer division of intervals makes to what a coarse one makes; vectors (P, 3)."""
        a, b = (self._whole(*of) for of in zip((coarse, fine), nodes, strict=True))
        w, x, y, z = quaternion_product(tuple(a), (b[0], -b[1], -b[2], -b[3]))
        length = np.sqrt(x * x + y * y + z * z)
        factor = np.where(length > 0, 2 * np.arctan2(length, np.abs(w)) / np.where(length > 0, length, 1.0), 2.0)
        factor *= np.copysign(1.0, -w if self.body else w)
        return np.asarray(np.stack([x, y, z], axis=-1) * factor[:, None])

    def _whole(self, division: Division, nodes: Array) -> Array:
        """The rotations over intervals, shape (4, P): neighbours are multiplied until one is left."""
        rows = np.empty((len(division.h), 4))
        self._turns(nodes, division.h, rows)
        q, part = rows.T.copy(), division.part
        while len(part) > len(division.counts):
            even = np.flatnonzero(part % 2 == 0)
            later = np.minimum(even + 1, len(part) - 1)
            paired = part[later] == part[even] + 1
            rest, last = even[paired], later[paired]
            q[:, rest] = quaternion_product(tuple(q[:, last]), tuple(q[:, rest]))
            q, part = q[:, even], part[even] // 2
        return q

    def rounded(self, sizes: Array, steps: Array) -> Array:
        """How far rounding takes products over intervals that turn by so much in so many steps: a random walk."""
        return np.asarray(_U * np.minimum(sizes, 4 * np.sqrt(np.minimum(sizes, steps))))

    def rounded_on_the_way(self, values: Array, size: float) -> float:
        """How far rounding takes the attitudes at the instants, beside that of steps that turn by so much in all."""
        return _U * (8 + 4 * math.sqrt(min(size, len(values))))

    def added_up(self, quats: Array, errors: Array) -> Array:
        """Errors of intervals turned back to the first instant, where they add up; quats at their ends."""
        q = quats if self.body else quats * _INVERSE
        w, axis = q[:, :1], q[:, 1:]
        twice = 2 * np.cross(axis, errors)
        return np.asarray(errors + w * twice + np.cross(axis, twice))


Integral: TypeAlias = Angle | Attitude
