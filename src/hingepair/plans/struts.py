"""Struts: forces along the line between two points of a mechanism, such as springs, dampers and gas springs.

The force of a strut of the length l pushes its points apart where it is positive:

    F = c0 + c1 l + sum of d_k max(l - l_k, 0) - damping l' - friction s(l')

which is a spring, a gas spring, a table of forces by length, stops, and what opposes the motion. s is the sign of the
rate, but below 0.1 mm/s in proportion to it, so that a motion in time can come to rest there. Beyond the limits of
the law the force is NaN.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from hingepair.engine.trace import square_root, where_less
from hingepair.equations.spatial import Scalar, Vector, dot, scale, subtract


class StrutForm(NamedTuple):
    """Structure of a strut."""

    bodies: tuple[int, int]  # numbers of the bodies of its points
    knots: int  # lengths at which the slope of the force changes
    limited: bool  # whether its force is unknown beyond limits

    @property
    def size(self) -> int:
        """How many numbers it has: both points, those of a `Law`."""
        return 6 + 5 + 2 * self.knots + 2 * self.limited


_CREEP = 1e-4  # m/s: below this rate of a strut, its friction is in proportion to the rate


class Law(NamedTuple):
    """Numbers of the force of a strut."""

    at_zero: Scalar = 0.0  # c0 [N]
    slope: Scalar = 0.0  # c1 [N/m]
    damping: Scalar = 0.0  # [N s/m]
    friction: Scalar = 0.0  # [N]
    energy: Scalar = 0.0  # constant of the potential energy [J]
    knots: tuple[tuple[Scalar, Scalar], ...] = ()  # l_k [m] and d_k [N/m]
    limits: tuple[Scalar, ...] = ()  # lengths [m] between which the force is known; (): everywhere

    def flat(self) -> list[Scalar]:
        """Return all numbers in a row."""
        return [*self[:5], *(number for knot in self.knots for number in knot), *self.limits]


class Strut(NamedTuple):
    """A strut of a mechanism: its points, in the axes of their bodies, and its force."""

    form: StrutForm
    first: Vector
    second: Vector
    law: Law

    @classmethod
    def of_numbers(cls, form: StrutForm, numbers: Sequence[Scalar]) -> Strut:
        """Return a strut from its numbers in order."""
        x1, y1, z1, x2, y2, z2, *law = numbers
        plain, knots, limits = law[:5], law[5 : 5 + 2 * form.knots], law[5 + 2 * form.knots :]
        pairs = tuple(zip(knots[::2], knots[1::2], strict=True))
        return cls(form, (x1, y1, z1), (x2, y2, z2), Law._make([*plain, pairs, tuple(limits)]))

    def points(self) -> tuple[tuple[int, Vector], tuple[int, Vector]]:
        """Return the bodies of both points, and the points in their axes."""
        return (self.form.bodies[0], self.first), (self.form.bodies[1], self.second)

    def force(self, length: Scalar, rate: Scalar) -> Scalar:
        """Return the force [N] at a length and its rate."""
        law = self.law
        force = law.at_zero + law.slope * length - law.damping * rate + self._doubt(length)
        for knot, change in law.knots:
            force = force + change * _above(length, knot)
        if type(law.friction) is float and law.friction == 0:
            return force
        share = rate / _CREEP
        share = where_less(share, -1.0, -1.0, where_less(1.0, share, 1.0, share))
        return force - law.friction * share

    def potential(self, length: Scalar) -> Scalar:
        """Return the potential energy [J] of the part of the force that depends on the length alone."""
        law = self.law
        work = law.at_zero * length + law.slope * (length * length * 0.5)
        for knot, change in law.knots:
            above = _above(length, knot)
            work = work + change * (above * above * 0.5)
        return law.energy - work + self._doubt(length)

    def _doubt(self, length: Scalar) -> Scalar:
        """Return NaN beyond the limits of the law, else 0."""
        if not self.law.limits:
            return 0.0
        low, high = self.law.limits
        return where_less(length, low, math.nan, where_less(high, length, math.nan, 0.0))


def _above(length: Scalar, knot: Scalar) -> Scalar:
    return where_less(knot, length, length - knot, 0.0)


def line_of_action(first: Vector, second: Vector) -> tuple[Scalar, Vector]:
    """Return the length of a strut, and the unit vector from its first point to its second."""
    apart = subtract(second, first)
    length = square_root(dot(apart, apart))
    return length, scale(apart, 1.0 / length)
