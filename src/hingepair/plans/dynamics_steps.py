"""The steps of a pair's dynamics: the recursions of trees (T1-T10) with one hinge and a free base, body 1."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection
from typing import Any

from hingepair.equations.joints import HINGE
from hingepair.equations.spatial import Scalar, Vector, rotate
from hingepair.plans.steps import Step, in_plane, in_space, vector_along_z, z_component
from hingepair.plans.trees import Form, Request, TreeQuantities

LOADS = ("force1", "torque1", "force2", "torque2", "hinge_torque")
"""Names of the loads that forward dynamics take."""
MASS_NUMBERS = ("tree", "whole_body2", "arm2")
"""Constants of a pair that dynamics take; `pair.dynamics.tree_numbers` explains them."""
FORCES = ("force1", "torque1", "hinge_torque")
"""Outputs of inverse dynamics."""
ACCELERATIONS = ("a1", "alpha1", "psidd")
"""Outputs of forward dynamics."""

_PLACE = (None,) * 12  # in `Form.known`: attitude and point of the hinge, numbers that come with each call
_ROTOR = (0.0, 1.0, 0.0)  # armature, multiplier and offset of a hinge that follows none
# A pair as a tree: body 2 without the matter that counts with body 1 (T9): m = 0, h_z = 0 and N_zz = 0.
_PAIR = Form(
    (0,), (HINGE,), (0,),
    ((None,) * 10 + _PLACE + (0.0, None, None, 0.0, None, None, None, None, None, 0.0) + _ROTOR + (None,) * 3),
)  # fmt: skip
# A pair as a tree for the load of its hinge, which bears the whole of body 2; body 1 does not count.
_BODY2 = Form((0,), (HINGE,), (0,), (0.0,) * 10 + _PLACE + (None,) * 10 + _ROTOR + (0.0,) * 3)
_UNLOADED = Request((), free=True)  # without loads on body 2
# force2 and torque2 act in a frame of body 2 with the axes of the tree.
_LOADED = Request((), True, (1,), (None, None, None, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), (0,))

# Names in a tree of the values of a pair; each of the second becomes a tuple of one.
_TREE_NAMES = {"force2": "force_0", "torque2": "torque_0"}
_TREE_COORDINATES = {"psi": "q", "psid": "qd", "psidd": "qdd", "hinge_torque": "tau"}


def _compute(form: Form, request: Request, names: tuple[str, ...], *values: Any) -> TreeQuantities:
    """Return the quantities of a pair as a tree, from values with these names; constants are joined."""
    given: dict[str, Any] = {"constants": ()}
    for name, value in zip(names, values, strict=True):
        if name in MASS_NUMBERS:
            given["constants"] += value
        elif name in _TREE_COORDINATES:
            given[_TREE_COORDINATES[name]] = (value,)
        else:
            given[_TREE_NAMES.get(name, name)] = value
    return TreeQuantities(form, request, given)


def _computed(result: str, form: Form, request: Request, *names: str) -> Step:
    return Step(result, functools.partial(_compute, form, request, names), names)


def _output(result: str, function: Callable[[TreeQuantities], Any], computation: str) -> Step:
    return Step(result, function, (computation,))


def _hinge_force(c: TreeQuantities) -> Vector:
    return c.joint_wrenches[0][0]


def _hinge_moment(c: TreeQuantities) -> Vector:
    return c.joint_wrenches[0][1]


def _bearing_torque(c: TreeQuantities) -> Vector:
    """Return the torque of the hinge across its axis."""
    x, y, _ = c.transmitted_wrenches[1][1]
    return rotate(c.poses[1].S, (x, y, 0.0))


def _hinge_torque(c: TreeQuantities) -> Scalar:
    return c.efforts()[0]


DYNAMICS_STEPS = (
    _computed("tree_at_rest", _PAIR, _UNLOADED, "tree", "S1", "psi"),
    _output("mass_matrix", TreeQuantities.mass_matrix, "tree_at_rest"),
    *(
        _computed(result, form, _UNLOADED, masses, "S1", "omega1", "a1", "alpha1", "psi", "psid", "psidd", "gravity")
        for result, form, masses in (("tree_forces", _PAIR, "tree"), ("hinge_load", _BODY2, "whole_body2"))
    ),
    _output("force1", lambda c: c.base_wrench(0), "tree_forces"),
    _output("torque1", lambda c: c.base_wrench(1), "tree_forces"),
    _output("hinge_torque", _hinge_torque, "tree_forces"),
    _output("hinge_force", _hinge_force, "hinge_load"),
    _output("hinge_moment", _hinge_moment, "hinge_load"),
    _output("bearing_torque", _bearing_torque, "hinge_load"),
    _computed("moving_tree", _PAIR, _UNLOADED, "tree", "R1", "S1", "v1", "omega1", "psi", "psid"),
    _output("kinetic", TreeQuantities.kinetic, "moving_tree"),
    _output("linear", lambda c: c.momentum[0], "moving_tree"),
    _output("angular", lambda c: c.angular_momentum_about(c.values["R1"]), "moving_tree"),
    _computed("heavy_tree", _PAIR, _UNLOADED, "tree", "R1", "S1", "psi", "gravity"),
    _output("potential", TreeQuantities.potential, "heavy_tree"),
)
"""All steps from a known motion: its forces, the mass matrix, energy and momentum."""

# Steps that solve for the accelerations of a pair in space.
_FORWARD_STEPS = (
    _computed("pushed_tree", _PAIR, _LOADED, "tree", "arm2", "S1", "omega1", "psi", "psid", "gravity", *LOADS),
    _output("a1", lambda c: c.solved[0], "pushed_tree"),
    _output("alpha1", lambda c: c.solved[1], "pushed_tree"),
    _output("psidd", lambda c: c.solved[2][0], "pushed_tree"),
    _output("pivots", lambda c: (*c.pivots, *c.base_pivots), "pushed_tree"),
)


_PLANE = (0, 1, 5, 6)  # places of planar velocities among v1, omega1 and psi'
# How values of a planar pair become those of space, and back.
_FROM_PLANE = {
    **dict.fromkeys(("force1", "force2", "gravity"), in_space),
    **dict.fromkeys(("torque1", "torque2"), vector_along_z),
}
_TO_PLANE: dict[str, Callable[..., Any]] = {
    **dict.fromkeys(("force1", "hinge_force", "linear"), in_plane),
    **dict.fromkeys(("torque1", "hinge_moment", "bearing_torque", "angular"), z_component),
    "mass_matrix": lambda M: tuple(M[7 * i + j] for i in _PLANE for j in _PLANE),
}


def _in_space(step: Step, results: Collection[str]) -> Step:
    """Return a step of space for a planar pair: vectors and the named results get names that end in _in_space."""
    moved = ("R1", "v1", "a1", "gravity", "force1", "force2", "torque1", "torque2")
    arguments = tuple(f"{name}_in_space" if name in moved else name for name in step.arguments)
    return Step(f"{step.result}_in_space" if step.result in results else step.result, step.function, arguments)


PLANAR_DYNAMICS_STEPS = (
    Step("gravity_in_space", in_space, ("gravity",)),
    *(_in_space(step, _TO_PLANE) for step in DYNAMICS_STEPS),
    *(Step(name, function, (f"{name}_in_space",)) for name, function in _TO_PLANE.items()),
)
"""Steps from a known motion of a planar pair."""
PLANAR_FORWARD_STEPS = (
    *(Step(f"{name}_in_space", function, (name,)) for name, function in _FROM_PLANE.items()),
    *(_in_space(step, ACCELERATIONS) for step in _FORWARD_STEPS),
    Step(
        "qdd",
        lambda a1, alpha1, psidd: (a1[0], a1[1], alpha1[2], psidd),
        ("a1_in_space", "alpha1_in_space", "psidd_in_space"),
    ),
)
"""Steps that solve for the accelerations of a planar pair."""


@functools.lru_cache(maxsize=64)
def forward_dynamics_steps(kinematic_steps: tuple[Step, ...]) -> tuple[Step, ...]:
    """Return a cached tuple of the steps that solve for a1, alpha1 and psidd, between those of the kinematic steps
    that do not depend on them and those that do.
    """
    before, after, solved = [], [], {*ACCELERATIONS}
    for step in kinematic_steps:
        if step.result in ACCELERATIONS:
            continue
        if solved.isdisjoint(step.arguments):
            before.append(step)
        else:
            solved.add(step.result)
            after.append(step)
    return (*before, *_FORWARD_STEPS, *after)
