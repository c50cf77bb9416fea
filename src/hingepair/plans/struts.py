"""Struts: forces along the line between two points of a mechanism, such as springs, dampers and gas springs.

The force of a strut of the length l pushes its points apart where it is positive:

    F = c0 + c1 l + sum of d_k max(l - l_k, 0) - damping l' - friction sign(l')

which is a spring, a gas spring or a table of forces by length, and what opposes the motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from hingepair.engine.trace import square_root, where_less
from hingepair.equations.spatial import Scalar, Vector, dot, scale, subtract


class StrutForm(NamedTuple):
    """Structure of a strut."""

    bodies: tuple[int, int]  # numbers of the bodies of its points
    knots: int  # lengths at which the slope of the force changes

    @property
    def size(self) -> int:
        """How many numbers it has: both points, five of the force, and two of each knot."""
        return 11 + 2 * self.knots


class Strut(NamedTuple):
    """A strut of a mechanism: its points, in the axes of their bodies, and its force."""

    form: StrutForm
    first: Vector
    second: Vector
    at_zero: Scalar  # c0 [N]
    slope: Scalar  # c1 [N/m]
    damping: Scalar  # [N s/m]
    friction: Scalar  # [N]
    energy: Scalar  # constant of the potential energy [J]
    knots: tuple[tuple[Scalar, Scalar], ...]  # l_k [m] and d_k [N/m]

    @classmethod
    def of_numbers(cls, form: StrutForm, numbers: Sequence[Scalar]) -> Strut:
        """Return a strut from its numbers in order."""
        x1, y1, z1, x2, y2, z2, at_zero, slope, damping, friction, energy, *knots = numbers
        pairs = tuple(zip(knots[::2], knots[1::2], strict=True))
        return cls(form, (x1, y1, z1), (x2, y2, z2), at_zero, slope, damping, friction, energy, pairs)

    def points(self) -> tuple[tuple[int, Vector], tuple[int, Vector]]:
        """Return the bodies of both points, and the points in their axes."""
        return (self.form.bodies[0], self.first), (self.form.bodies[1], self.second)

    def force(self, length: Scalar, rate: Scalar) -> Scalar:
        """Return the force [N] at a length and its rate."""
        force = self.at_zero + self.slope * length - self.damping * rate
        for knot, change in self.knots:
            force = force + change * _above(length, knot)
        if type(self.friction) is float and self.friction == 0:
            return force
        still = where_less(rate, 0.0, self.friction, 0.0)
        return force + where_less(0.0, rate, -self.friction, still)

    def potential(self, length: Scalar) -> Scalar:
        """Return the potential energy [J] of the part of the force that depends on the length alone."""
        work = self.at_zero * length + self.slope * (length * length * 0.5)
        for knot, change in self.knots:
            above = _above(length, knot)
            work = work + change * (above * above * 0.5)
        return self.energy - work


def _above(length: Scalar, knot: Scalar) -> Scalar:
    return where_less(knot, length, length - knot, 0.0)


def line_of_action(first: Vector, second: Vector) -> tuple[Scalar, Vector]:
    """Return the length of a strut, and the unit vector from its first point to its second."""
    apart = subtract(second, first)
    length = square_root(dot(apart, apart))
    return length, scale(apart, 1.0 / length)
