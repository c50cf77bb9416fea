"""The 24 Euler sequences, each as the equations of one canonical sequence with its axes renamed (E4, E10).

Angles stand in the order of the sequence's letters, as SciPy writes them: upper case turns about the body's own
axes (intrinsic), lower case about the world's (extrinsic). "XYZ" is E10.
"""

from __future__ import annotations

import functools
import itertools
from typing import Any, NamedTuple

from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import check_choice

# The twelve intrinsic Euler sequences, in capitals.
_INTRINSIC = tuple(
    "".join(letters) for letters in itertools.product("XYZ", repeat=3) if letters[0] != letters[1] != letters[2]
)
# Capitals for intrinsic sequences, small letters for extrinsic ones.
SEQUENCE_NAMES = (*_INTRINSIC, *(name.lower() for name in _INTRINSIC))


class EulerSequence(NamedTuple):
    """An Euler sequence, described by how it differs from the canonical sequence Sx Sy Sz or, if `proper`, Sx Sy Sx.

    An extrinsic sequence is the intrinsic one with letters and angles reversed. Renaming the axes keeps the
    equations, but for the sign of every angle where the renaming changes the handedness.
    """

    proper: bool  # the first axis comes back as the third (Sx Sy Sx)
    backward: bool  # the angles are taken in reverse order
    place: tuple[int, int, int]  # for world axis i, its canonical axis
    sign: int  # of the canonical angles, +1 or -1

    def angles(self, phi: eq.Vector) -> eq.Vector:
        """Return angles phi, or their rates, converted from the order of the sequence's letters to the canonical
        order and sign. The same call converts them back.
        """
        x, y, z = phi
        if self.backward:
            x, z = z, x
        return (x, y, z) if self.sign > 0 else (-x, -y, -z)

    def attitude(self, trig: tuple[Any, ...]) -> eq.Matrix:
        """Return the matrix S as nine entries (E10); `trig` is (sin, cos) of each canonical angle, six numbers."""
        S = eq.proper_euler_attitude(trig) if self.proper else eq.tait_bryan_attitude(trig)
        return nine(S[3 * i + j] for i in self.place for j in self.place)

    def axes(self, trig: tuple[Any, ...]) -> tuple[Any, ...]:
        """Return the five entries of J that are not constant, column by column, in canonical axes (E4): the argument
        `canonical_axes` of other methods. trig = (sin, cos) of the three canonical angles: six numbers.
        """
        return eq.proper_euler_axes(trig) if self.proper else eq.tait_bryan_axes(trig)

    def angular_velocity(self, canonical_axes: tuple[Any, ...], phid: eq.Vector) -> eq.Vector:
        """Return omega = J phi' in world axes (E4), with the rates phid in the order of the sequence's letters."""
        return self.vector(eq.angular_velocity1(canonical_axes, self.angles(phid)))

    def angular_acceleration(self, canonical_axes: tuple[Any, ...], phid: eq.Vector, phidd: eq.Vector) -> eq.Vector:
        """Return alpha = J phi'' + J' phi' in world axes (E4, differentiated), with phid and phidd in the order of
        the sequence's letters.
        """
        return self.vector(eq.angular_acceleration1(canonical_axes, self.angles(phid), self.angles(phidd)))

    def columns(self, canonical_axes: tuple[Any, ...]) -> tuple[eq.Vector, ...]:
        """Return the three columns of J in world axes, in the order of the sequence's letters."""
        canonical = eq.euler_axes(canonical_axes)
        columns = canonical[::-1] if self.backward else canonical
        return tuple((c[self.place[0]], c[self.place[1]], c[self.place[2]]) for c in columns)

    def vector(self, canonical: eq.Vector) -> eq.Vector:
        """Return an angular velocity or acceleration, converted from canonical axes to world axes."""
        x, y, z = (canonical[i] for i in self.place)
        return (x, y, z) if self.sign > 0 else (-x, -y, -z)


def find_sequence(name: str) -> EulerSequence:
    """Return the sequence of a name such as "XYZ" (intrinsic) or "zyx" (extrinsic).

    Raises:
        ArgumentError: no such sequence.

    >>> find_sequence("zyx").backward
    True
    """
    if not isinstance(name, str):
        raise ArgumentError("sequence", "three letters such as 'XYZ' or 'zyx'", name)
    return _cached_sequence(name)


@functools.cache
def _cached_sequence(name: str) -> EulerSequence:
    """Return what `find_sequence` returns, of any string."""
    check_choice("sequence", name, SEQUENCE_NAMES)
    letters = name.upper()[::-1] if name.islower() else name
    axes = ["XYZ".index(letter) for letter in letters]
    proper = axes[0] == axes[2]
    if proper:
        axes[2] = 3 - axes[0] - axes[1]
    sign = 1 if (axes[1] - axes[0]) % 3 == 1 else -1
    place = (axes.index(0), axes.index(1), axes.index(2))
    return EulerSequence(proper, name.islower(), place, sign)


def nine(entries: Any) -> eq.Matrix:
    """Return the nine entries of an iterable as a matrix, row by row; ValueError if there are not nine."""
    a, b, c, d, e, f, g, h, i = entries
    return a, b, c, d, e, f, g, h, i
