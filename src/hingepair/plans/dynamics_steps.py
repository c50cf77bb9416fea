"""The steps of dynamics: which equation computes which quantity, for inverse and for forward dynamics."""

from __future__ import annotations

import functools
import operator

from hingepair.equations import dynamics as dyn
from hingepair.equations import spatial as eq
from hingepair.equations.spatial import Vector
from hingepair.plans.steps import ARM_STEPS, Step, same


def _nothing() -> Vector:
    return 0.0, 0.0, 0.0


_LEVERS = (
    *ARM_STEPS,
    Step("centre1", eq.rotate, ("S1", "c1")),
    Step("centre2", eq.rotate, ("S2", "c2")),
    Step("from_hinge", eq.subtract, ("c2", "u2")),
    Step("h", eq.rotate, ("S2", "from_hinge")),
    Step("e", eq.add, ("r1", "h")),
    Step("push", eq.cross, ("axis", "h")),
    Step("mass", operator.add, ("m1", "m2")),
    Step("share", operator.truediv, ("m2", "mass")),
    Step("J1", dyn.world_inertia, ("S1", "I1")),
    Step("J2", dyn.world_inertia, ("S2", "I2")),
    Step("J", dyn.matrix_sum, ("J1", "J2")),
    Step("spread1", dyn.spread, ("m1", "centre1")),
    Step("J_R1", dyn.matrix_sum, ("J", "spread1")),
    Step("about_R1", dyn.resistance, ("J_R1", "J2", "axis", "push", "m2", "e")),
    Step("apart", eq.subtract, ("e", "centre1")),
    Step("reduced", operator.mul, ("m1", "share")),
    Step("about_centre", dyn.resistance, ("J", "J2", "axis", "push", "reduced", "apart")),
    Step("to_centre", eq.scale, ("apart", "share")),
    Step("centre", eq.add, ("centre1", "to_centre")),
)
"""Steps to the centres of mass, world axes, and to the inertias (D1-D6)."""

_INVERSE = (
    Step("f1", dyn.inertial_force, ("m1", "a1", "omega1", "alpha1", "centre1", "gravity")),
    Step("f2", dyn.inertial_force, ("m2", "a2", "omega2", "alpha2", "centre2", "gravity")),
    Step("t1", dyn.inertial_torque, ("S1", "I1", "omega1", "alpha1")),
    Step("t2", dyn.inertial_torque, ("S2", "I2", "omega2", "alpha2")),
    Step("moment", dyn.torque_about, ("t2", "h", "f2")),
    Step("hinge_torque", eq.dot, ("axis", "moment")),
    Step("about_axis", eq.scale, ("axis", "hinge_torque")),
    Step("bearing_torque", eq.subtract, ("moment", "about_axis")),
    Step("force1", eq.add, ("f1", "f2")),
    Step("about1", dyn.torque_about, ("t1", "centre1", "f1")),
    Step("about2", dyn.torque_about, ("t2", "e", "f2")),
    Step("torque1", eq.add, ("about1", "about2")),
)
"""Steps of inverse dynamics (D1-D5)."""

_ENERGIES = (
    Step("v_centre1", dyn.point_velocity, ("v1", "omega1", "centre1")),
    Step("v_centre2", dyn.point_velocity, ("v2", "omega2", "centre2")),
    Step("at1", eq.add, ("R1", "centre1")),
    Step("at2", eq.add, ("R1", "e")),
    Step("kinetic1", dyn.kinetic_energy, ("m1", "v_centre1", "omega1", "J1")),
    Step("kinetic2", dyn.kinetic_energy, ("m2", "v_centre2", "omega2", "J2")),
    Step("kinetic", operator.add, ("kinetic1", "kinetic2")),
    Step("potential", dyn.potential_energy, ("m1", "at1", "m2", "at2", "gravity")),
    Step("linear", dyn.linear_momentum, ("m1", "v_centre1", "m2", "v_centre2")),
    Step("angular1", dyn.angular_momentum, ("m1", "at1", "v_centre1", "J1", "omega1")),
    Step("angular2", dyn.angular_momentum, ("m2", "at2", "v_centre2", "J2", "omega2")),
    Step("angular", eq.add, ("angular1", "angular2")),
)
"""Steps to energy and momentum (D7, D8)."""

MASS_STEPS = (
    *_LEVERS,
    *_INVERSE,
    Step("mass_matrix", dyn.mass_matrix, ("m1", "m2", "centre1", "e", "push", "about_R1")),
    *_ENERGIES,
)
"""All steps from a known motion: its forces, the mass matrix, energy and momentum."""

LOADS = ("force1", "torque1", "force2", "torque2", "hinge_torque")
"""Names of the loads that forward dynamics take."""
MASSES = ("m1", "m2", "c1", "c2", "I1", "I2", "gravity")
"""Names of the constants that dynamics take: masses, centres of mass, inertias, gravity."""
REQUIRED = ("force1", "torque1", "hinge_torque")
"""Names of the outputs of inverse dynamics."""
MOVES = ("a1", "alpha1", "psidd")
"""Names of the outputs of forward dynamics."""

_LOADED = (
    Step("pushed", eq.add, ("force1", "force2")),
    Step("force", eq.subtract, ("pushed", "force1_bias")),
    Step("torque2_about1", dyn.torque_about, ("torque2", "d", "force2")),
    Step("turned", eq.add, ("torque1", "torque2_about1")),
    Step("torque", eq.subtract, ("turned", "torque1_bias")),
    Step("torque2_at_hinge", dyn.hinge_torque_of, ("axis", "torque2", "r2", "force2")),
    Step("acting", operator.add, ("hinge_torque", "torque2_at_hinge")),
    Step("motor", operator.sub, ("acting", "hinge_torque_bias")),
)
"""Steps to the loads less the forces of a motion without accelerations."""

_POINTS = {
    "free": (Step("point", same, ("centre",)), Step("about", same, ("about_centre",))),
    "pinned": (Step("point", _nothing, ()), Step("about", same, ("about_R1",))),
    "carried": (Step("about", dyn.resistance, ("J2", "J2", "axis", "push", "m2", "e")),),
}
"""Steps to the point about which a pair turns, from R1, and to the inertia there, by the base."""

# Steps to the angular accelerations, from the loads about the point.
_TURNING = (
    Step("solved", dyn.turning, ("about", "J2", "torque_there", "motor_there")),
    Step("alpha1", operator.itemgetter(0), ("solved",)),
    Step("psidd", operator.itemgetter(1), ("solved",)),
    Step("kept", operator.itemgetter(2), ("solved",)),
)
_SOLVED = {
    "free": (
        Step("torque_there", dyn.torque_from, ("torque", "centre", "force")),
        Step("motor_there", lambda motor, share, push, force: motor - share * eq.dot(push, force),
             ("motor", "share", "push", "force")),
        *_TURNING,
        Step("a_centre", lambda force, mass: eq.scale(force, 1 / mass), ("force", "mass")),
        Step("drift", operator.mul, ("share", "psidd")),
        Step("a1", dyn.from_centre, ("a_centre", "alpha1", "centre", "push", "drift")),
    ),
    "pinned": (
        Step("torque_there", same, ("torque",)),
        Step("motor_there", same, ("motor",)),
        *_TURNING,
        Step("a1", same, ("none",)),
    ),
    "carried": (Step("psidd", lambda motor, about: motor / about[2], ("motor", "about")),),
}  # fmt: skip
"""Steps to the accelerations, by the base."""
# The accelerations that are solved for, by the base.
_SOLVED_OUTPUTS = {"free": ("a1", "alpha1", "psidd"), "pinned": ("a1", "alpha1", "psidd"), "carried": ("psidd",)}


def lever_steps(base: str) -> tuple[Step, ...]:
    """Return the steps to where the masses are, and to the point about which a pair turns; see `forward_steps`."""
    return (*_LEVERS, *_POINTS[base])


@functools.lru_cache(maxsize=64)
def forward_steps(kinematics: tuple[Step, ...], base: str = "free") -> tuple[Step, ...]:
    """Return the steps to a1, alpha1 and psidd under the loads (D6), and to what follows from them.

    Args:
        kinematics: steps to S1, omega1 and what the hinge makes of them.
        base: what holds body 1: nothing ("free"), a ball joint at R1 ("pinned"), or its given motion ("carried").
    """
    sought = _SOLVED_OUTPUTS[base]
    still = {"a1": "none", "alpha1": "none", "psidd": "zero"}
    bias = {name: still[name] for name in sought}
    fixed, follows = [], []
    for step in kinematics:
        if step.result in sought:
            continue
        if any(name in bias for name in step.arguments):
            bias[step.result] = f"{step.result}_bias"
            follows.append(step)
        else:
            fixed.append(step)
    bias |= {step.result: f"{step.result}_bias" for step in _INVERSE}
    at_rest = [
        step._replace(result=bias[step.result], arguments=tuple(bias.get(name, name) for name in step.arguments))
        for step in (*follows, *_INVERSE)
    ]
    none = (Step("none", _nothing, ()), Step("zero", float, ()))
    return (*fixed, *lever_steps(base), *none, *at_rest, *_LOADED, *_SOLVED[base], *follows)
