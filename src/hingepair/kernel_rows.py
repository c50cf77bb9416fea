"""Where everything stands in the scratch array of the compiled kernels, and the steps that they know.

Free of Numba, so that a plan can be turned into operations before anything is compiled.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from hingepair.euler import find_sequence
from hingepair.plan import Plan

LANES: Final = 16
"""Samples a block: every row of the scratch array holds one component of so many samples."""

_COUNTS = {
    **dict.fromkeys(("R1", "phi", "v1", "phid", "a1", "phidd", "omega1", "alpha1", "u1", "u2", "n"), 3),
    **dict.fromkeys(("psi", "psid", "psidd"), 1),
    **dict.fromkeys(("S1", "home", "trig", "Sh", "S2", "spare"), 9),
    **dict.fromkeys(("r1", "r2", "d", "R2", "axis", "omega2", "v2", "alpha2", "a2"), 3),
    "hinge": 3,
    "axes": 5,
    "end": 0,
}
ROWS: Final = {name: LANES * sum(list(_COUNTS.values())[:i]) for i, name in enumerate(_COUNTS)}
"""By name of a value: where its first component starts in the scratch array; `end` is the array's size."""

OPERATIONS: Final = (
    *("trig_x", "trig_y", "trig_z", "hinge", "tait_bryan", "tait_bryan_axes", "proper", "proper_axes"),
    *("omega1", "alpha1", "place_S1", "place_omega1", "place_alpha1", "Sh", "S2", "S2_home", "r1", "r2", "d", "R2"),
    *("axis", "omega2", "v2", "alpha2", "a2"),
)
"""The steps that the kernels know, in the order of their numbers."""


def operations(plan: Plan, fixed: frozenset[str]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The numbers of a plan's operations: those that need nothing but what is fixed, and the others.

    Args:
        plan: the plan.
        fixed: names of the inputs that are the same for every sample; of single angles as `phi_x`, `phi_y`, `phi_z`.
    """
    constant = set(fixed)
    if {"phi_x", "phi_y", "phi_z"} <= fixed:
        constant.add("phi")
    once: list[str] = []
    each: list[str] = []
    for step in plan.steps:
        if step.result == "angles":
            continue
        arguments = {"phi" if name == "angles" else name for name in step.arguments}
        is_constant = arguments <= constant
        if is_constant:
            constant.add(step.result)
        for name in _names(plan, step.result):
            (once if is_constant or name.replace("trig", "phi") in fixed else each).append(name)
    return tuple(map(OPERATIONS.index, once)), tuple(map(OPERATIONS.index, each))


def place(plan: Plan) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Where the sequence takes the axes: nine components of a matrix, three of a vector, and its sign."""
    if plan.sequence is None:
        return np.array([*range(9), *range(3), 1])
    order = find_sequence(plan.sequence)
    return np.array([*(3 * i + j for i in order.place for j in order.place), *order.place, order.sign])


def _names(plan: Plan, result: str) -> tuple[str, ...]:
    """The operations of one step."""
    if result == "trig":
        return ("trig_x", "trig_y", "trig_z")
    if result == "S2":
        return ("S2_home",) if plan.home else ("S2",)
    if plan.sequence is None or result not in {"S1", "axes", "omega1", "alpha1"}:
        return (result,)
    kind = "proper" if find_sequence(plan.sequence).proper else "tait_bryan"
    name = {"S1": kind, "axes": f"{kind}_axes"}.get(result, result)
    return (name,) if plan.sequence == "XYZ" or result == "axes" else (name, f"place_{result}")
