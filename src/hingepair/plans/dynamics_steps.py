"""The steps of dynamics: which equation computes which quantity, for inverse and for forward dynamics."""

from __future__ import annotations

import functools
import operator

from hingepair.equations import dynamics as dyn
from hingepair.equations import spatial as eq
from hingepair.equations.spatial import Vector
from hingepair.plans.steps import BODIES_TO_HINGE_POINT_VECTOR_STEPS, Step, same


def _zero_vector() -> Vector:
    """Return the zero vector, a tuple of three zeros."""
    return eq.ZERO_VECTOR


_MASS_CENTRE_AND_INERTIA_STEPS = (
    *BODIES_TO_HINGE_POINT_VECTOR_STEPS,
    Step("centre1", eq.rotate, ("S1", "c1")),
    Step("centre2", eq.rotate, ("S2", "c2")),
    Step("hinge_to_centre2", eq.subtract, ("c2", "u2")),
    Step("h", eq.rotate, ("S2", "hinge_to_centre2")),
    Step("e", eq.add, ("r1", "h")),
    Step("partial_velocity2", eq.cross, ("axis", "h")),
    Step("mass", operator.add, ("m1", "m2")),
    Step("mass_fraction2", operator.truediv, ("m2", "mass")),
    Step("J1", dyn.world_inertia, ("S1", "I1")),
    Step("J2", dyn.world_inertia, ("S2", "I2")),
    Step("J", dyn.matrix_sum, ("J1", "J2")),
    Step("point_inertia1", dyn.point_mass_inertia, ("m1", "centre1")),
    Step("J_R1", dyn.matrix_sum, ("J", "point_inertia1")),
    Step("inertia_about_R1", dyn.pair_inertia, ("J_R1", "J2", "axis", "partial_velocity2", "m2", "e")),
    Step("centre1_to_centre2", eq.subtract, ("e", "centre1")),
    Step("reduced_mass", operator.mul, ("m1", "mass_fraction2")),
    Step(
        "inertia_about_centre",
        dyn.pair_inertia,
        ("J", "J2", "axis", "partial_velocity2", "reduced_mass", "centre1_to_centre2"),
    ),
    Step("centre1_to_centre", eq.scale, ("centre1_to_centre2", "mass_fraction2")),
    Step("centre", eq.add, ("centre1", "centre1_to_centre")),
)
"""Steps to the centres of mass, world axes, and to the inertias (D1-D6)."""

_INVERSE_DYNAMICS_STEPS = (
    Step("f1", dyn.inertial_force, ("m1", "a1", "omega1", "alpha1", "centre1", "gravity")),
    Step("f2", dyn.inertial_force, ("m2", "a2", "omega2", "alpha2", "centre2", "gravity")),
    Step("t1", dyn.inertial_torque, ("S1", "I1", "omega1", "alpha1")),
    Step("t2", dyn.inertial_torque, ("S2", "I2", "omega2", "alpha2")),
    Step("moment", dyn.torque_about, ("t2", "h", "f2")),
    Step("hinge_torque", eq.dot, ("axis", "moment")),
    Step("about_axis", eq.scale, ("axis", "hinge_torque")),
    Step("bearing_torque", eq.subtract, ("moment", "about_axis")),
    Step("force1", eq.add, ("f1", "f2")),
    Step("t1_about_R1", dyn.torque_about, ("t1", "centre1", "f1")),
    Step("t2_about_R1", dyn.torque_about, ("t2", "e", "f2")),
    Step("torque1", eq.add, ("t1_about_R1", "t2_about_R1")),
)
"""Steps of inverse dynamics (D1-D5)."""

_ENERGY_AND_MOMENTUM_STEPS = (
    Step("v_centre1", dyn.point_velocity, ("v1", "omega1", "centre1")),
    Step("v_centre2", dyn.point_velocity, ("v2", "omega2", "centre2")),
    Step("R_centre1", eq.add, ("R1", "centre1")),
    Step("R_centre2", eq.add, ("R1", "e")),
    Step("kinetic1", dyn.kinetic_energy, ("m1", "v_centre1", "omega1", "J1")),
    Step("kinetic2", dyn.kinetic_energy, ("m2", "v_centre2", "omega2", "J2")),
    Step("kinetic", operator.add, ("kinetic1", "kinetic2")),
    Step("potential", dyn.potential_energy, ("m1", "R_centre1", "m2", "R_centre2", "gravity")),
    Step("linear", dyn.linear_momentum, ("m1", "v_centre1", "m2", "v_centre2")),
    Step("angular1", dyn.angular_momentum, ("m1", "R_centre1", "v_centre1", "J1", "omega1")),
    Step("angular2", dyn.angular_momentum, ("m2", "R_centre2", "v_centre2", "J2", "omega2")),
    Step("angular", eq.add, ("angular1", "angular2")),
)
"""Steps to energy and momentum (D7, D8)."""

KNOWN_MOTION_DYNAMICS_STEPS = (
    *_MASS_CENTRE_AND_INERTIA_STEPS,
    *_INVERSE_DYNAMICS_STEPS,
    Step("mass_matrix", dyn.mass_matrix, ("m1", "m2", "centre1", "e", "partial_velocity2", "inertia_about_R1")),
    *_ENERGY_AND_MOMENTUM_STEPS,
)
"""All steps from a known motion: its forces, the mass matrix, energy and momentum."""

FORWARD_DYNAMICS_LOAD_NAMES = ("force1", "torque1", "force2", "torque2", "hinge_torque")
"""Names of the loads that forward dynamics take."""
DYNAMICS_CONSTANT_NAMES = ("m1", "m2", "c1", "c2", "I1", "I2", "gravity")
"""Names of the constants that dynamics take: masses, centres of mass, inertias, gravity."""
INVERSE_DYNAMICS_OUTPUT_NAMES = ("force1", "torque1", "hinge_torque")
"""Names of the outputs of inverse dynamics."""
FORWARD_DYNAMICS_OUTPUT_NAMES = ("a1", "alpha1", "psidd")
"""Names of the outputs of forward dynamics."""

_LOAD_MINUS_BIAS_STEPS = (
    Step("total_force", eq.add, ("force1", "force2")),
    Step("force", eq.subtract, ("total_force", "force1_bias")),
    Step("torque2_about1", dyn.torque_about, ("torque2", "d", "force2")),
    Step("total_torque", eq.add, ("torque1", "torque2_about1")),
    Step("torque", eq.subtract, ("total_torque", "torque1_bias")),
    Step("torque2_at_hinge", dyn.hinge_torque_of, ("axis", "torque2", "r2", "force2")),
    Step("total_hinge_torque", operator.add, ("hinge_torque", "torque2_at_hinge")),
    Step("net_hinge_torque", operator.sub, ("total_hinge_torque", "hinge_torque_bias")),
)
"""Steps to the loads less the forces of a motion without accelerations."""

_ROTATION_POINT_AND_INERTIA_STEPS_BY_BASE_NAME = {
    "free": (Step("point", same, ("centre",)), Step("inertia_about_point", same, ("inertia_about_centre",))),
    "pinned": (Step("point", _zero_vector, ()), Step("inertia_about_point", same, ("inertia_about_R1",))),
    "carried": (Step("inertia_about_point", dyn.pair_inertia, ("J2", "J2", "axis", "partial_velocity2", "m2", "e")),),
}
"""Steps to the point about which a pair turns, from R1, and to the inertia there, by the base."""

# Steps to the angular accelerations, from the loads about the point.
_FREE_OR_PINNED_ALPHA1_AND_PSIDD_STEPS = (
    Step(
        "solution",
        dyn.angular_accelerations,
        ("inertia_about_point", "J2", "torque_at_point", "hinge_torque_at_point"),
    ),
    Step("alpha1", operator.itemgetter(0), ("solution",)),
    Step("psidd", operator.itemgetter(1), ("solution",)),
    Step("pivot_ratios", operator.itemgetter(2), ("solution",)),
)
_ACCELERATION_STEPS_BY_BASE_NAME = {
    "free": (
        Step("torque_at_point", dyn.torque_from, ("torque", "centre", "force")),
        Step("hinge_torque_at_point", lambda torque, fraction, v, f: torque - fraction * eq.dot(v, f),
             ("net_hinge_torque", "mass_fraction2", "partial_velocity2", "force")),
        *_FREE_OR_PINNED_ALPHA1_AND_PSIDD_STEPS,
        Step("a_centre", lambda force, mass: eq.scale(force, 1 / mass), ("force", "mass")),
        Step("psidd_fraction", operator.mul, ("mass_fraction2", "psidd")),
        Step("a1", dyn.reference_point_rate, ("a_centre", "alpha1", "centre", "partial_velocity2", "psidd_fraction")),
    ),
    "pinned": (
        Step("torque_at_point", same, ("torque",)),
        Step("hinge_torque_at_point", same, ("net_hinge_torque",)),
        *_FREE_OR_PINNED_ALPHA1_AND_PSIDD_STEPS,
        Step("a1", same, ("none",)),
    ),
    "carried": (Step("psidd", lambda torque, J: torque / J[2], ("net_hinge_torque", "inertia_about_point")),),
}  # fmt: skip
"""Steps to the accelerations, by the base."""
# The accelerations that are solved for, by the base.
_UNKNOWN_ACCELERATION_NAMES_BY_BASE_NAME = {
    "free": ("a1", "alpha1", "psidd"),
    "pinned": ("a1", "alpha1", "psidd"),
    "carried": ("psidd",),
}


def inertia_steps(base: str) -> tuple[Step, ...]:
    """Return a tuple of the steps that compute centres of mass, inertias, and the inertia about the point about which
    the pair rotates. `base` says what holds body 1: nothing ("free"), a ball joint at R1 ("pinned"), or its given
    motion ("carried").

    The values of `base` are explained in `forward_dynamics_steps`.
    """
    return (*_MASS_CENTRE_AND_INERTIA_STEPS, *_ROTATION_POINT_AND_INERTIA_STEPS_BY_BASE_NAME[base])


@functools.lru_cache(maxsize=64)
def forward_dynamics_steps(kinematic_steps: tuple[Step, ...], base: str = "free") -> tuple[Step, ...]:
    """Return a cached tuple of the steps that solve forward dynamics: the given `kinematic_steps`, the steps from
    loads to a1, alpha1 and psidd (D6), and the steps to all quantities that depend on these accelerations. `base`
    says what holds body 1: nothing ("free"), a ball joint at R1 ("pinned"), or its given motion ("carried"). If it is
    "carried", only psidd is solved for.

    Args:
        kinematic_steps: steps to S1, omega1 and to the motion of body 2.
        base: what holds body 1: nothing ("free"), a ball joint at R1 ("pinned"), or its given motion ("carried").
    """
    unknown = _UNKNOWN_ACCELERATION_NAMES_BY_BASE_NAME[base]
    zero_names = {"a1": "none", "alpha1": "none", "psidd": "zero"}
    bias_names = {name: zero_names[name] for name in unknown}
    motion_steps, following_steps = [], []
    for step in kinematic_steps:
        if step.result in unknown:
            continue
        if any(name in bias_names for name in step.arguments):
            bias_names[step.result] = f"{step.result}_bias"
            following_steps.append(step)
        else:
            motion_steps.append(step)
    bias_names |= {step.result: f"{step.result}_bias" for step in _INVERSE_DYNAMICS_STEPS}
    bias_steps = [
        step._replace(
            result=bias_names[step.result], arguments=tuple(bias_names.get(name, name) for name in step.arguments)
        )
        for step in (*following_steps, *_INVERSE_DYNAMICS_STEPS)
    ]
    zero_steps = (Step("none", _zero_vector, ()), Step("zero", float, ()))
    return (
        *motion_steps,
        *inertia_steps(base),
        *zero_steps,
        *bias_steps,
        *_LOAD_MINUS_BIAS_STEPS,
        *_ACCELERATION_STEPS_BY_BASE_NAME[base],
        *following_steps,
    )
