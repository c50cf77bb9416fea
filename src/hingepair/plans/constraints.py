"""What to compute of two motions that a hinge should join: how much they violate E1 and E2, and the hinge angle."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Mapping
from typing import Any, Final

from hingepair.engine.derivatives import pushforward
from hingepair.engine.trace import arc_tangent, hypotenuse
from hingepair.equations import spatial as eq
from hingepair.equations.spatial import Scalar, Vector
from hingepair.numeric.blocks import components
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.plans.attitudes import rotation_defect
from hingepair.plans.changes import sum_of, with_variables


class ConstraintQuantities:
    """The quantities of two motions, world axes; those that several outputs need are computed at first access.

    Args:
        values: by name: R1, S1, v1, omega1, a1, alpha1 of body 1, the same of body 2, and the constants
            u1, u2, e1, e2, n, e1_in_2, e2_in_2 and n_in_2 of the pair.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self.values = values

    def _turned(self, k: int, name: str) -> Vector:
        """Return a constant vector of body k in world axes."""
        return eq.rotate(self.values[f"S{k}"], self.values[name])

    @lock_free_cached_property
    def arms(self) -> tuple[Vector, Vector]:
        """Vectors from both reference points to the hinge point of the body."""
        return self._turned(1, "u1"), self._turned(2, "u2")

    @lock_free_cached_property
    def h(self) -> tuple[Vector, Vector]:
        """The hinge axis, as it is fixed in body 1 and in body 2."""
        return self._turned(1, "n"), self._turned(2, "n_in_2")

    @lock_free_cached_property
    def f(self) -> tuple[Vector, Vector]:
        """Unit vectors of body 1 across the axis: across h1 to the last bit, also where the S1 given is a rotation
        to nine digits only, so that it shows no tilt of its own.
        """
        h1 = self.h[0]
        return eq.cross(self._turned(1, "e2"), h1), eq.cross(h1, self._turned(1, "e1"))

    def gap(self) -> Vector:
        """Return the gap between the hinge points of both bodies."""
        (r1, r2), values = self.arms, self.values
        return eq.hinge_gap(values["R1"], r1, values["R2"], r2)

    @lock_free_cached_property
    def tilt(self) -> tuple[Scalar, Scalar]:
        """Tilt of the axes."""
        return eq.tilt(*self.f, self.h[1])

    def tilt_angle(self) -> Scalar:
        """Return the angle between the axes."""
        return arc_tangent(hypotenuse(*self.tilt), eq.dot(*self.h))

    def psi(self) -> Scalar:
        """Return the hinge angle."""
        return arc_tangent(*eq.hinge_angle_terms(self.f, self._turned(2, "e1_in_2"), self._turned(2, "e2_in_2")))

    def psid(self) -> Scalar:
        """Return the hinge rate (E2), of tilted hinges too."""
        (h1, h2), values = self.h, self.values
        relative = eq.subtract(values["omega2"], values["omega1"])
        return eq.dot(relative, eq.add(h1, h2)) / (1.0 + eq.dot(h1, h2))

    def in_time(
        self, function: Callable[[ConstraintQuantities], Any], order: int, times: int | None = None
    ) -> tuple[Scalar, ...]:
        """Return the first or the second time derivative of what a function makes of both attitudes (E3); the
        derivative once of what it makes of attitudes and angular velocities, with the order 2 and `times` 1.
        """
        parts = [(f"{letter}{k}", tail) for letter, tail in (("S", (3, 3)), ("omega", (3,)))[:order] for k in "12"]
        variables, moves = with_variables({name: self.values[name] for name, _ in parts}, parts)
        given: Any = self.values  # those of fronts are computed where they are read
        values = ChainMap(variables, given)
        rates = {"S1": "omega1", "S2": "omega2", "omega1": "alpha1", "omega2": "alpha2"}
        change = sum_of(pair for name, _ in parts for pair in zip(values[rates[name]], moves[name], strict=True))
        found = [*components(function(ConstraintQuantities(values)))]
        for _ in range(times or order):
            found = pushforward(found, change)
        return tuple(found)

    def gap_in_time(self, order: int) -> Vector:
        """Return the first or the second time derivative of the gap (E1)."""
        letter, values = "va"[order - 1], self.values
        x, y, z = self.in_time(lambda c: eq.subtract(*c.arms), order)
        return eq.add(eq.subtract(values[f"{letter}1"], values[f"{letter}2"]), (x, y, z))


_C = ConstraintQuantities
_ARMS: Final = ("S1", "S2", "u1", "u2")
_HINGES: Final = ("S1", "S2", "n", "n_in_2")
_AXES: Final = (*_HINGES, "e1", "e2")
_OMEGA: Final = ("omega1", "omega2")
_ALPHA: Final = (*_OMEGA, "alpha1", "alpha2")
CONSTRAINTS: Final[Mapping[str, tuple[tuple[str, ...], Callable[[ConstraintQuantities], Any]]]] = {
    "gap": ((*_ARMS, "R1", "R2"), _C.gap),
    "tilt": (_AXES, lambda c: c.tilt),
    "tilt_angle": (_AXES, _C.tilt_angle),
    "psi": ((*_AXES, "e1_in_2", "e2_in_2"), _C.psi),
    "gap_rate": ((*_ARMS, *_OMEGA, "v1", "v2"), lambda c: c.gap_in_time(1)),
    "tilt_rate": ((*_AXES, *_OMEGA), lambda c: c.in_time(lambda moved: moved.tilt, 1)),
    "psid": ((*_HINGES, *_OMEGA), _C.psid),
    "gap_acceleration": ((*_ARMS, *_ALPHA, "a1", "a2"), lambda c: c.gap_in_time(2)),
    "tilt_acceleration": ((*_AXES, *_ALPHA), lambda c: c.in_time(lambda moved: moved.tilt, 2)),
    "psidd": ((*_HINGES, *_ALPHA), lambda c: c.in_time(_C.psid, 2, times=1)),
    "S2_check": (("S2",), lambda c: rotation_defect(c.values["S2"])),
}
"""All that can be computed of two motions: the names of the values that it depends on, and how."""
