"""What to compute of two motions that a hinge should join: how much they violate E1 and E2, and the hinge angle."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from hingepair.engine.trace import arc_tangent, hypotenuse
from hingepair.equations import constraints as ce
from hingepair.equations import spatial as eq
from hingepair.equations.spatial import Scalar, Vector
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.plans.attitudes import rotation_defect

Two = tuple[Scalar, Scalar]


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

    def _motion(self, letter: str) -> tuple[Any, Any]:
        return self.values[f"{letter}1"], self.values[f"{letter}2"]

    # ---- poses

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
        (R1, R2), (r1, r2) = self._motion("R"), self.arms
        return eq.hinge_gap(R1, r1, R2, r2)

    @lock_free_cached_property
    def tilt(self) -> Two:
        """Tilt of the axes."""
        return ce.tilt(*self.f, self.h[1])

    def tilt_angle(self) -> Scalar:
        """Return the angle between the axes."""
        return arc_tangent(hypotenuse(*self.tilt), eq.dot(*self.h))

    def psi(self) -> Scalar:
        """Return the hinge angle."""
        return arc_tangent(*ce.hinge_angle_terms(self.f, self._turned(2, "e1_in_2"), self._turned(2, "e2_in_2")))

    # ---- rates

    @lock_free_cached_property
    def tilt_axes(self) -> tuple[Vector, Vector]:
        """Axes about which a relative rate tilts."""
        return ce.tilt_axes(*self.f, self.h[1])

    @lock_free_cached_property
    def relative_omega(self) -> Vector:
        """Return omega2 - omega1."""
        return ce.relative_rate(*self._motion("omega"))

    def gap_rate(self) -> Vector:
        """Return the time derivative of the gap."""
        (v1, v2), (omega1, omega2), (r1, r2) = self._motion("v"), self._motion("omega"), self.arms
        return ce.gap_rate(v1, omega1, r1, v2, omega2, r2)

    def tilt_rate(self) -> Two:
        """Return the time derivative of the tilt."""
        return ce.tilt_rate(self.tilt_axes, self.relative_omega)

    @lock_free_cached_property
    def psid(self) -> Scalar:
        """Hinge rate."""
        numerator, denominator = ce.hinge_rate(*self.h, self.relative_omega)
        return numerator / denominator

    @lock_free_cached_property
    def tilt_bias(self) -> Two:
        """Second derivative of the tilt without accelerations."""
        return ce.tilt_bias(self.f, self.h[1], *self._motion("omega"), self.relative_omega)

    # ---- accelerations

    @lock_free_cached_property
    def relative_alpha(self) -> Vector:
        """Return alpha2 - alpha1."""
        return ce.relative_rate(*self._motion("alpha"))

    def gap_acceleration(self) -> Vector:
        """Return the second time derivative of the gap."""
        both = zip(self._motion("omega"), self._motion("alpha"), self.arms, strict=True)
        turned1, turned2 = (eq.point_acceleration(*one) for one in both)
        a1, a2 = self._motion("a")
        return ce.gap_acceleration(a1, turned1, a2, turned2)

    def tilt_acceleration(self) -> Two:
        """Return the second time derivative of the tilt."""
        return ce.tilt_acceleration(self.tilt_axes, self.relative_alpha, self.tilt_bias)

    def psidd(self) -> Scalar:
        """Return the second time derivative of the hinge angle."""
        numerator, denominator = ce.hinge_acceleration(
            self.h, self._motion("omega"), self.relative_omega, self.relative_alpha, self.psid
        )
        return numerator / denominator


_AXES: Final = ("S1", "S2", "e1", "e2", "n", "n_in_2")
_SPINS: Final = (*_AXES, "omega1", "omega2")
_ARMS: Final = ("S1", "S2", "u1", "u2")
_C = ConstraintQuantities
CONSTRAINTS: Final[Mapping[str, tuple[tuple[str, ...], Callable[[ConstraintQuantities], Any]]]] = {
    "gap": ((*_ARMS, "R1", "R2"), _C.gap),
    "tilt": (_AXES, lambda c: c.tilt),
    "tilt_angle": (_AXES, _C.tilt_angle),
    "psi": ((*_AXES, "e1_in_2", "e2_in_2"), _C.psi),
    "gap_rate": ((*_ARMS, "v1", "v2", "omega1", "omega2"), _C.gap_rate),
    "tilt_rate": (_SPINS, _C.tilt_rate),
    "psid": (("S1", "S2", "n", "n_in_2", "omega1", "omega2"), lambda c: c.psid),
    "gap_acceleration": ((*_ARMS, "omega1", "omega2", "a1", "a2", "alpha1", "alpha2"), _C.gap_acceleration),
    "tilt_acceleration": ((*_SPINS, "alpha1", "alpha2"), _C.tilt_acceleration),
    "psidd": (("S1", "S2", "n", "n_in_2", "omega1", "omega2", "alpha1", "alpha2"), _C.psidd),
    "S2_check": (("S2",), lambda c: rotation_defect(c.values["S2"])),
}
"""All that can be computed of two motions: the names of the values that it depends on, and how."""
