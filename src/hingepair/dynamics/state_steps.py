"""The steps of simulation: the accelerations of a pair about its common centre of mass (D1-D6).

The recursions of trees would do, too (T5, T6). But the state of a simulation holds the angular momentum about the
common centre, so that its programs need the inertia there in any case, and there nothing cancels.
"""

from __future__ import annotations

import functools
import operator

from hingepair.equations import dynamics as dyn
from hingepair.equations import spatial as eq
from hingepair.equations.spatial import Vector
from hingepair.plans.steps import BODIES_TO_HINGE_POINT_VECTOR_STEPS, Step, same


def _zero() -> Vector:
    return eq.ZERO_VECTOR


# Centres of mass, world axes, and inertias.
_INERTIAS = (
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

# D1-D5
_FORCES = (
    Step("f1", dyn.inertial_force, ("m1", "a1", "omega1", "alpha1", "centre1", "gravity")),
    Step("f2", dyn.inertial_force, ("m2", "a2", "omega2", "alpha2", "centre2", "gravity")),
    Step("t1", dyn.inertial_torque, ("S1", "I1", "omega1", "alpha1")),
    Step("t2", dyn.inertial_torque, ("S2", "I2", "omega2", "alpha2")),
    Step("moment", dyn.torque_about, ("t2", "h", "f2")),
    Step("hinge_torque", eq.dot, ("axis", "moment")),
    Step("force1", eq.add, ("f1", "f2")),
    Step("t1_about_R1", dyn.torque_about, ("t1", "centre1", "f1")),
    Step("t2_about_R1", dyn.torque_about, ("t2", "e", "f2")),
    Step("torque1", eq.add, ("t1_about_R1", "t2_about_R1")),
)

# The loads less the forces of a motion without accelerations.
_NET_LOADS = (
    Step("total_force", eq.add, ("force1", "force2")),
    Step("force", eq.subtract, ("total_force", "force1_bias")),
    Step("torque2_about1", dyn.torque_about, ("torque2", "d", "force2")),
    Step("total_torque", eq.add, ("torque1", "torque2_about1")),
    Step("torque", eq.subtract, ("total_torque", "torque1_bias")),
    Step("torque2_at_hinge", dyn.hinge_torque_of, ("axis", "torque2", "r2", "force2")),
    Step("total_hinge_torque", operator.add, ("hinge_torque", "torque2_at_hinge")),
    Step("net_hinge_torque", operator.sub, ("total_hinge_torque", "hinge_torque_bias")),
)

# The point about which the pair turns, from R1, and the inertia there, by the base.
_POINTS = {
    "free": (Step("point", same, ("centre",)), Step("inertia_about_point", same, ("inertia_about_centre",))),
    "pinned": (Step("point", _zero, ()), Step("inertia_about_point", same, ("inertia_about_R1",))),
    "carried": (Step("inertia_about_point", dyn.pair_inertia, ("J2", "J2", "axis", "partial_velocity2", "m2", "e")),),
}

_SOLUTION = (
    Step(
        "solution",
        dyn.angular_accelerations,
        ("inertia_about_point", "torque_at_point", "hinge_torque_at_point"),
    ),
    Step("alpha1", operator.itemgetter(0), ("solution",)),
    Step("psidd", operator.itemgetter(1), ("solution",)),
)
_ACCELERATIONS = {
    "free": (
        Step("torque_at_point", dyn.torque_from, ("torque", "centre", "force")),
        Step("hinge_torque_at_point", lambda torque, fraction, v, f: torque - fraction * eq.dot(v, f),
             ("net_hinge_torque", "mass_fraction2", "partial_velocity2", "force")),
        *_SOLUTION,
        Step("a_centre", lambda force, mass: eq.scale(force, 1 / mass), ("force", "mass")),
        Step("psidd_fraction", operator.mul, ("mass_fraction2", "psidd")),
        Step("a1", dyn.reference_point_rate, ("a_centre", "alpha1", "centre", "partial_velocity2", "psidd_fraction")),
    ),
    "pinned": (
        Step("torque_at_point", same, ("torque",)),
        Step("hinge_torque_at_point", same, ("net_hinge_torque",)),
        *_SOLUTION,
        Step("a1", same, ("none",)),
    ),
    "carried": (Step("psidd", lambda torque, J: torque / J[2], ("net_hinge_torque", "inertia_about_point")),),
}  # fmt: skip


def inertia_steps(base: str) -> tuple[Step, ...]:
    """Return the steps to centres of mass, to inertias, and to the inertia about the point about which the pair
    turns; `base` is as for `forward_dynamics_steps`.
    """
    return (*_INERTIAS, *_POINTS[base])


@functools.lru_cache(maxsize=64)
def forward_dynamics_steps(kinematic_steps: tuple[Step, ...], base: str) -> tuple[Step, ...]:
    """Return a cached tuple of the steps that solve forward dynamics (D6), and of the kinematic steps before and
    after them.

    Args:
        kinematic_steps: steps to S1, omega1 and to the motion of body 2.
        base: what holds body 1: nothing ("free"), a ball joint at R1 ("pinned"), or its given motion ("carried"), for
            which only psidd is solved.
    """
    unknown = ("psidd",) if base == "carried" else ("a1", "alpha1", "psidd")
    zeros = {"a1": "none", "alpha1": "none", "psidd": "zero"}
    biases = {name: zeros[name] for name in unknown}  # names of what a motion without accelerations has
    before, after = [], []
    for step in kinematic_steps:
        if step.result in unknown:
            continue
        if any(name in biases for name in step.arguments):
            biases[step.result] = f"{step.result}_bias"
            after.append(step)
        else:
            before.append(step)
    biases |= {step.result: f"{step.result}_bias" for step in _FORCES}
    bias_steps = [
        step._replace(result=biases[step.result], arguments=tuple(biases.get(name, name) for name in step.arguments))
        for step in (*after, *_FORCES)
    ]
    return (
        *before, *inertia_steps(base), Step("none", _zero, ()), Step("zero", float, ()), *bias_steps,
        *_NET_LOADS, *_ACCELERATIONS[base], *after,
    )  # fmt: skip
