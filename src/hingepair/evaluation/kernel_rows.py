"""Where everything stands in the scratch array of the compiled kernels, and the steps that they know.

Free of Numba, so that a plan can be turned into operations before anything is compiled.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from hingepair.evaluation.plan import PLANAR, SPATIAL, Plan, outputs_of
from hingepair.rotations.sequences import find_sequence

PAST_CACHES: Final = 2
"""In a table of outputs, in place of the sign that inputs have: store past the caches."""

LANES: Final = 32
"""Samples a block: every row of the scratch array holds one component of so many samples."""

_INSTEAD = {"angles": "phi", "cosine": "hinge"}  # steps that the kernels take along with others
_EULER = frozenset(("phi", "phid", "phidd"))
_COUNTS = {
    **dict.fromkeys(("R1", "phi", "v1", "phid", "a1", "phidd", "omega1", "alpha1", "u1", "u2", "n"), 3),
    **dict.fromkeys(("psi", "psid", "psidd", "phi1", "phi1d", "phi1dd", "phi2"), 1),
    **dict.fromkeys(("S1", "home", "trig", "Sh", "S2", "spare"), 9),
    **dict.fromkeys(("along", "across", "around", "swing", "slide", "reach", "pull", "relative"), 3),
    **dict.fromkeys(("r1", "r2", "d", "R2", "axis", "omega2", "v2", "alpha2", "a2"), 3),
    "hinge": 3,
    "axes": 5,
    "turn1": 3,
    "turn2": 2,
    "end": 0,
}
ROWS: Final = {name: LANES * sum(list(_COUNTS.values())[:i]) for i, name in enumerate(_COUNTS)}
"""By name of a value: where its first component starts in the scratch array; `end` is the array's size."""

OPERATIONS: Final = (
    *("trig_x", "trig_y", "trig_z", "hinge", "tait_bryan", "tait_bryan_axes", "proper", "proper_axes"),
    *("omega1", "alpha1", "place_S1", "place_omega1", "place_alpha1", "Sh", "S2", "S2_home", "swing", "d", "R2"),
    *("axis", "omega2", "slide", "v2", "alpha2", "reach", "slide_given", "pull", "pull_given"),
    *("relative", "a2"),
    *("turn1", "turn2", "turn2_home", "phi2", "flat_S1", "flat_S2", "flat_r1", "flat_r2", "flat_d"),
    *("flat_omega1", "flat_omega2", "flat_v2", "flat_alpha1", "flat_alpha2", "flat_a2", "flat_frame", "planar_frame"),
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
    once: list[str] = [] if plan.kind == SPATIAL else [f"{plan.kind}_frame"]
    each: list[str] = []
    for step in plan.steps:
        if step.result in _INSTEAD:
            continue
        arguments = {_INSTEAD.get(name, name) for name in step.arguments}
        is_constant = arguments <= constant
        if is_constant:
            constant.add(step.result)
        for name in _names(plan, step.result):
            (once if is_constant or name.replace("trig", "phi") in fixed else each).append(name)
    return tuple(map(OPERATIONS.index, once)), tuple(map(OPERATIONS.index, each))


def place(plan: Plan) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Where the sequence takes the axes: nine components of a matrix, three of a vector, and its sign."""
    if plan.sequence is None or plan.kind != SPATIAL:
        return np.array([*range(9), *range(3), 1])
    order = find_sequence(plan.sequence)
    return np.array([*(3 * i + j for i in order.place for j in order.place), *order.place, order.sign])


def input_rows(plan: Plan, name: str) -> tuple[int, ...]:
    """The rows of an input's components; Euler angles and their rates in canonical order."""
    if name.startswith(("psi", "phi1")):
        return (ROWS[name],)
    count = 9 if name in {"S1", "home"} else 2 if plan.kind == PLANAR else 3
    rows = tuple(ROWS[name] + i * LANES for i in range(count))
    backward = name in _EULER and plan.sequence is not None and find_sequence(plan.sequence).backward
    return rows[::-1] if backward else rows


def input_sign(plan: Plan, name: str) -> int:
    """The sign that an input's components get: sequences of odd order turn backwards."""
    return find_sequence(plan.sequence).sign if name in _EULER and plan.sequence is not None else 1


def output_rows(plan: Plan, name: str) -> tuple[int, ...]:
    """The rows of an output's components: of a planar pair's turns, those about z."""
    count = math.prod(outputs_of(plan.kind)[name].tail)
    first = 2 if name in {"omega2", "alpha2"} and count == 1 else 0
    return tuple(ROWS[name] + (first + i) * LANES for i in range(count))


def _names(plan: Plan, result: str) -> tuple[str, ...]:
    """The operations of one step."""
    if plan.kind != SPATIAL:
        if result == "turn2" and plan.home:
            return ("turn2_home",)
        return (f"flat_{result}",) if f"flat_{result}" in OPERATIONS else (result,)
    if result == "trig":
        return ("trig_x", "trig_y", "trig_z")
    given = plan.sequence is None and result in {"slide", "pull"}
    way = "_given" if given else "_home" if result == "S2" and plan.home else ""
    if way or plan.sequence is None or result not in {"S1", "axes", "omega1", "alpha1"}:
        return (f"{result}{way}",)
    kind = "proper" if find_sequence(plan.sequence).proper else "tait_bryan"
    name = {"S1": kind, "axes": f"{kind}_axes"}.get(result, result)
    return (name,) if plan.sequence == "XYZ" or result == "axes" else (name, f"place_{result}")
