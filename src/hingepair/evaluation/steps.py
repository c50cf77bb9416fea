"""The steps of a plan: which equation makes what of what, for each kind of motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from hingepair.equations import planar
from hingepair.equations import spatial as eq
from hingepair.numeric.blocks import hinge_terms, turn_terms


class Step(NamedTuple):
    """One equation: result = function(*arguments), all by name."""

    result: str
    function: Callable[..., Any]
    arguments: tuple[str, ...]


HINGE_STEPS = (
    Step("Sh", eq.hinge_rotation, ("n", "hinge")),
    Step("S2", eq.attitude2, ("S1", "Sh", "home")),
    Step("swing", eq.swing, ("across", "around", "hinge", "cosine")),
    Step("d", eq.offset, ("S1", "along", "swing")),
    Step("R2", eq.position2, ("R1", "d")),
    Step("axis", eq.rotate, ("S1", "n")),
    Step("omega2", eq.angular_velocity2, ("omega1", "axis", "psid")),
    Step("slide", eq.slide, ("S1", "across", "around", "hinge", "cosine")),
    Step("v2", eq.velocity2, ("v1", "omega1", "d", "slide", "psid")),
    Step("alpha2", eq.angular_acceleration2, ("alpha1", "omega1", "axis", "psid", "psidd")),
    Step("pull", eq.rotate, ("S1", "swing")),
    Step("relative", eq.relative_acceleration, ("slide", "pull", "psid", "psidd")),
    Step("a2", eq.acceleration2, ("a1", "omega1", "alpha1", "d", "slide", "psid", "relative")),
)
"""Body 2 from body 1 and the hinge (E1, E2, E5-E9)."""

ARM_STEPS = (Step("r1", eq.rotate, ("S1", "u1")), Step("r2", eq.rotate, ("S2", "u2")))
"""The hinge point from either reference point, in world axes: no output needs it, Jacobians do."""

LEVER_STEPS = (
    Step("arm", eq.rotate, ("home", "u2")),
    Step("around", eq.cross, ("n", "arm")),
    Step("across", eq.cross, ("around", "n")),
    Step("along", eq.along, ("u1", "arm", "across")),
)
"""What the hinge turns of the levers u1 and u2, and what it leaves; a pair takes these steps once, in twice the
precision, so that a plan in doubles starts from constants that are right to the last bit."""

WITHOUT_HOME = Step("S2", eq.compose, ("S1", "Sh"))

GIVEN_S1 = {
    "slide": (Step("reach", eq.rotate, ("S1", "swing")), Step("slide", eq.cross, ("axis", "reach"))),
    "pull": (Step("pull", eq.cross, ("slide", "axis")),),
}
"""A matrix from outside may be a rotation to nine digits only: there the cross products of E2 and E8, as they stand,
keep the hinge point of both bodies together to the last digit."""

_TURN1 = (Step("hinge", hinge_terms, ("psi",)), Step("turn1", turn_terms, ("phi1",)))

PLANAR_STEPS = (
    *_TURN1,
    Step("turn2", planar.planar_turn, ("turn1", "hinge")),
    Step("phi2", planar.planar_rate, ("phi1", "psi")),
    Step("r1", planar.planar_rotate, ("turn1", "u1")),
    Step("r2", planar.planar_rotate, ("turn2", "u2")),
    Step("d", planar.planar_difference, ("r1", "r2")),
    Step("R2", planar.planar_sum, ("R1", "d")),
    Step("omega2", planar.planar_rate, ("phi1d", "psid")),
    Step("v2", planar.planar_velocity2, ("v1", "phi1d", "r1", "omega2", "r2")),
    Step("alpha2", planar.planar_rate, ("phi1dd", "psidd")),
    Step("a2", planar.planar_acceleration2, ("a1", "phi1d", "phi1dd", "r1", "omega2", "alpha2", "r2")),
)
"""A planar pair (E11)."""

FLAT_STEPS = (
    *_TURN1,
    Step("turn2", planar.flat_turn_home, ("turn1", "hinge", "n", "home")),
    Step("S1", planar.flat_attitude, ("turn1",)),
    Step("S2", planar.flat_attitude, ("turn2",)),
    Step("r1", planar.flat_rotate, ("turn1", "u1")),
    Step("r2", planar.flat_rotate, ("turn2", "u2")),
    Step("d", eq.subtract, ("r1", "r2")),
    Step("R2", eq.position2, ("R1", "d")),
    Step("omega1", planar.flat_spin1, ("phi1d",)),
    Step("omega2", planar.flat_spin2, ("phi1d", "n", "psid")),
    Step("v2", planar.flat_velocity2, ("v1", "phi1d", "r1", "omega2", "r2")),
    Step("alpha1", planar.flat_spin1, ("phi1dd",)),
    Step("alpha2", planar.flat_spin2, ("phi1dd", "n", "psidd")),
    Step("a2", planar.flat_acceleration2, ("a1", "phi1d", "phi1dd", "r1", "omega2", "alpha2", "r2")),
)
"""A pair in space whose turns are all about z (E11 in three coordinates)."""

FLAT_WITHOUT_HOME = Step("turn2", planar.flat_turn, ("turn1", "hinge", "n"))
