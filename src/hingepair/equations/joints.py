"""Kinds of joints: how far each turns and shifts its body for one unit of its coordinate q.

A joint turns its body about its axis by c q and shifts it along the axis by e q. These two numbers are all that the
equations of trees (T1-T14) ask of a kind: numbers 0 and 1 fold, so that a hinge costs what a hinge costs.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from hingepair.equations.spatial import Scalar, Vector


class Axis(NamedTuple):
    """What a joint does along its axis.

    >>> force, torque = (0, 0, 5), (0, 0, 7)
    >>> HINGE.effort(force, torque), SLIDER.effort(force, torque), Axis(1.0, 0.5).effort(force, torque)
    (7, 5, 9.5)
    """

    turns: float  # c [rad per unit of q]
    shifts: float  # e [m per unit of q]

    def turn(self, x: Scalar) -> Scalar:
        """Return c x."""
        return _times(self.turns, x)

    def shift(self, x: Scalar) -> Scalar:
        """Return e x."""
        return _times(self.shifts, x)

    def effort(self, force: Vector, torque: Vector) -> Scalar:
        """Return e_z . (c t + e f), the effort along q of a force f and a torque t in joint axes (T3)."""
        if not self.shifts:
            return self.turn(torque[2])
        return self.turn(torque[2]) + self.shift(force[2]) if self.turns else self.shift(force[2])


HINGE: Final = Axis(1.0, 0.0)  # turns by q
SLIDER: Final = Axis(0.0, 1.0)  # shifts by q


def _times(factor: float, x: Scalar) -> Scalar:
    # Products with 0 and 1 are left out, since 0 * inf is not 0.
    return (x if factor == 1 else factor * x) if factor else 0.0
