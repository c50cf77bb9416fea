"""What a scene computes and what it leaves out, in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hingepair.engine.loops import OperationCounts
from hingepair.pair.computations import computation_of
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.plans.plan import PLANAR_MOTION_KIND, SPATIAL_MOTION_KIND, all_steps, default_outputs, make_plan
from hingepair.plans.points import result_of
from hingepair.plans.steps import SPATIAL_PARTS, WITHOUT_HOME
from hingepair.scenes.motions.known import KnownMotion

# What a step of a plan computes, by its name.
_STEPS = {
    "hinge": "sine, versine and cosine of psi",
    "cosine": "cosine of psi, out of hinge",
    "angles": "Euler angles in canonical order",
    "trig": "sines and cosines of phi",
    "S1": "attitude of body 1 (E10)",
    "axes": "axes of the Euler rates (E4)",
    "omega1": "angular velocity of body 1 (E4)",
    "alpha1": "angular acceleration of body 1 (E4)",
    "Sh": "hinge rotation (E6)",
    "S2": "attitude of body 2 (E5)",
    "r1": "hinge point from body 1's reference point, S1 u1",
    "r2": "hinge point from body 2's reference point, S2 u2",
    "arm": "hinge point from body 2's reference point at psi = 0, C u2",
    "lever_sin": "factor of sin psi in Sh C u2",
    "lever_cos": "factor of cos psi in Sh C u2",
    "lever_fixed": "part of u1 - Sh C u2 that psi does not move",
    "lever_moving": "part of Sh C u2 that psi moves, body-1 axes (E6)",
    "lever_by_psi": "derivative of S2 u2 by psi",
    "lever_in_world": "lever_moving in world axes",
    "centripetal": "lever_moving in world axes, away from the axis",
    "relative": "acceleration that the hinge alone makes (E9)",
    "d": "offset of the reference points (E7)",
    "R2": "position of body 2 (E7)",
    "turn1": "sine and cosine of the angle of body 1 (E11)",
    "turn2": "sine and cosine of the angle of body 2 (E11)",
    "phi2": "angle of body 2 (E11)",
    "axis": "hinge axis in world axes, S1 n",
    "omega2": "angular velocity of body 2 (E2)",
    "v2": "velocity of body 2 (E8)",
    "alpha2": "angular acceleration of body 2 (E9)",
    "a2": "acceleration of body 2 (E9)",
}


def _meaning(name: str) -> str:
    """Return what a step or an output of a point is, as text."""
    ofs = {"_v": "velocity", "_a": "acceleration"}
    return _STEPS.get(name) or f"{ofs.get(name[-2:], 'position')} of a point"


@dataclass(frozen=True, slots=True)
class ScenePlan:
    """What a pair's scene computes and skips."""

    #: names of the outputs
    outputs: tuple[str, ...]
    #: (step name, "once" or "each") in order; "each" is a step that is computed at each instant
    computed: tuple[tuple[str, str], ...]
    #: (description of the work that is left out, reason)
    skipped: tuple[tuple[str, str], ...]
    #: number of operations at each instant, and number before constants were folded
    operations: OperationCounts

    def __str__(self) -> str:
        left = f"{self.operations.per_sample} operations at each instant, of {self.operations.unfolded} in all"
        lines = [f"outputs: {', '.join(self.outputs)}", f"computed: {left}"]
        width = max(len(name) for name, _ in self.computed) + 2 if self.computed else 0
        lines += [
            f"  {name:<{width}}{_meaning(name)}{' - once' if often == 'once' else ''}"
            for name, often in self.computed
        ]
        lines += ["skipped:", *(f"  {what}: {why}" for what, why in self.skipped)] if self.skipped else []
        return "\n".join(lines)


def explain(
    pair: HingePair | PlanarPair, motion: KnownMotion, outputs: tuple[str, ...] | None, motion_level: int
) -> ScenePlan:
    """Return the ScenePlan of outputs (None: all of body 2) without computing them. `motion` has the derivatives that
    they need, `motion_level` is the highest derivative order (0 to 2) that the scene's motion has.
    """
    kind = PLANAR_MOTION_KIND if isinstance(pair, PlanarPair) else SPATIAL_MOTION_KIND
    names, constant = default_outputs(motion.level, kind) if outputs is None else outputs, motion.constant_names()
    form = motion.sequence, "home" in pair.constants.values
    points = pair.constants.points
    plan = make_plan(names, *form, kind=kind, points=points)
    others = [step.result for step in all_steps(*form, kind=kind)]
    rows = dict(zip(SPATIAL_PARTS, motion.derivatives, strict=False))
    varying = {
        name: tuple(np.empty(2) if isinstance(c, np.ndarray) else c for c in row) for name, row in rows.items()
    }
    operations = computation_of(kind, pair.constants, names, motion.sequence).count_operations(varying)
    still, computed = {*constant} | {"u1", "u2", "n", "home", "lever_fixed", "lever_cos", "lever_sin"}, []
    for step in plan.steps:
        once = still.issuperset(step.arguments)
        still |= {step.result} if once else set()
        if step.result in _STEPS:
            computed.append((step.result, "once" if once else "each"))
        computed += [(name, "once" if once else "each") for name in names if step.result == result_of(name)]
    reasons = ["no output needs them" if i < motion_level else "the motion does not give them" for i in range(2)]
    skipped = [
        (f"{('first', 'second')[i]} derivatives of the coordinates", reasons[i]) for i in range(motion.level, 2)
    ]
    if operations.folded:
        skipped.append(
            (f"{operations.folded} of {operations.unfolded} operations", "what is known to be 0, 1 or -1 is left out")
        )
    if operations.shared:
        skipped.append((f"{operations.shared} operations at each instant", "they depend on constants only"))
    made = {step.result for step in plan.steps}
    skipped += [(_STEPS[name], "no output needs it") for name in others if name in _STEPS and name not in made]
    skipped += [(f"the point {point.name}", "no output needs it") for point in points if point not in plan.points]
    if motion.sequence is None and kind is SPATIAL_MOTION_KIND:
        skipped.append(("Euler angles, their sines and cosines", "the attitude of body 1 is given"))
    if WITHOUT_HOME in plan.steps:
        skipped.append(("the product with C", "home is the identity"))
    for name in ("phi_x", "phi_y", "phi_z", "psi"):
        if name in constant and any(step.result in {"trig", "hinge"} for step in plan.steps):
            skipped.append((f"sine and cosine of {name} at each instant", f"{name} is constant"))
    return ScenePlan(plan.outputs, tuple(computed), tuple(skipped), operations)


@dataclass(frozen=True, slots=True)
class RobotPlan:
    """What a robot's scene computes and skips."""

    #: number of operations by the description of the computed outputs
    computed: Mapping[str, OperationCounts]
    #: names of the joints that do not move
    still: tuple[str, ...]
    #: highest order of the needed derivatives
    order: int
    #: highest order of the derivatives that the motion has
    level: int
    #: whether the base rests at the origin
    base_rests: bool

    def __str__(self) -> str:
        lines = ["computed:"]
        for what, operations in self.computed.items():
            left = f"{operations.per_sample} operations at each instant"
            lines.append(f"  {what}: {left}, of {operations.unfolded} in all")
            if operations.shared:
                lines.append(f"    and {operations.shared} once, since they depend on constants only")
        skipped = [f"joints that do not move, whose sines and cosines are constants: {', '.join(self.still)}"]
        reasons = ["no output needs them" if i < self.level else "the motion does not give them" for i in range(2)]
        skipped = skipped if self.still else []
        skipped += [
            f"{('first', 'second')[i]} derivatives of the coordinates: {reasons[i]}" for i in range(self.order, 2)
        ]
        skipped += ["the motion of the base: it rests at the origin"] * self.base_rests
        return "\n".join([*lines, *(["skipped:"] if skipped else []), *(f"  {reason}" for reason in skipped)])
