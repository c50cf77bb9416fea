"""The state of a simulated robot whose base is free or pinned: the motion that it stands for, and its derivative.

A state is one vector: base point, momentum P, angular momentum L, Cayley coordinates g of the base's attitude
relative to S0, q and q'. The base point is the common centre of mass, about which L is; of a pinned base it is R1.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

from hingepair.engine.binding import ArrayShape
from hingepair.engine.loops import Loop
from hingepair.equations import trees as eq
from hingepair.equations.dynamics import cayley_attitude, cayley_rate, solve_symmetric
from hingepair.equations.spatial import ZERO_VECTOR, Scalar, Vector, add, cross, scale, subtract
from hingepair.plans.trees import (
    OUTPUTS,
    Form,
    TreeQuantities,
    TreeRequest,
    input_shapes,
    output_shape,
)

MOTION = ("R1", "S1", "v1", "omega1")
"""Outputs that are the motion of the base."""
# Also that of the vector from R1 to the centre of mass.
_MOTION_SHAPES: dict[str, ArrayShape] = {"R1": (3,), "S1": (3, 3), "v1": (3,), "omega1": (3,), "centre": (3,)}

Values = Mapping[str, Any]


def state_size(form: Form) -> int:
    """Return the number of components of a state."""
    return 12 + 2 * form.dof


@functools.lru_cache(maxsize=128)
def state_loop(form: Form, request: TreeRequest, pinned: bool, outputs: tuple[str, ...]) -> Loop:
    """Return the cached loop from `state` and `S0` to outputs: those of `MOTION`, "centre" (from R1 to the centre of
    mass), outputs of trees, and "rates", the derivative of the state. The request, which has no outputs, says where
    wrenches act.
    """
    of_tree = tuple(name for name in outputs if name in OUTPUTS and name not in _MOTION_SHAPES)
    pushed = request if "rates" in outputs else request._replace(pushed=())
    asked = pushed._replace(outputs=(*of_tree, *(("qdd",) if "rates" in outputs else ())))
    needed = input_shapes(form, asked)
    inputs = {name: tail for name, tail in needed.items() if name not in {"q", "qd", *MOTION}}
    inputs |= {"state": (state_size(form),), "S0": (3, 3)}
    shapes: dict[str, ArrayShape] = {**_MOTION_SHAPES, "rates": (state_size(form),)}
    shapes |= {name: output_shape(name, form, request) for name in of_tree}
    return Loop(
        "state", functools.partial(_outputs, form, pushed, pinned, outputs), inputs,
        {name: shapes[name] for name in outputs}, form=("state", form, pushed, pinned, outputs),
    )  # fmt: skip


def _outputs(
    form: Form, request: TreeRequest, pinned: bool, outputs: tuple[str, ...], values: Values
) -> dict[str, Any]:
    """Return the named outputs of the motion that a state stands for."""
    dof, state = form.dof, values["state"]
    base_point, P, L, g = (state[3 * k : 3 * k + 3] for k in range(4))
    q, qd = state[12 : 12 + dof], state[12 + dof :]
    S1 = cayley_attitude(g, values["S0"])
    v = {"gravity": ZERO_VECTOR, **values, "q": q, "qd": qd, "S1": S1}
    still = TreeQuantities(form, request, {**v, "v1": ZERO_VECTOR, "omega1": ZERO_VECTOR})
    centre = still.centre_from_base
    omega1, v1 = _base_rates(still, centre, P, L, pinned)
    R1 = base_point if pinned else subtract(base_point, centre)
    moving = TreeQuantities(form, request, {**v, "R1": R1, "v1": v1, "omega1": omega1})
    found: dict[str, Any] = {"R1": R1, "S1": S1, "v1": v1, "omega1": omega1, "centre": centre}
    if "rates" in outputs:
        mass = still.composites[0].mass
        found["rates"] = _rates(moving, centre, mass, P, cayley_rate(g, omega1), pinned)
    return {name: found[name] if name in found else moving.outputs((name,))[name] for name in outputs}


def _base_rates(still: TreeQuantities, centre: Vector, P: Vector, L: Vector, pinned: bool) -> tuple[Vector, Vector]:
    """Return omega1 and v1 from the momenta; `still` has a base at rest."""
    rows = eq.base_mass_rows(still.values["S1"], still.composites[0])  # about R1
    P_joints, L_joints = still.momentum
    if pinned:
        omega1: Any = solve_symmetric(tuple(x for row in rows[3:] for x in row[3:]), subtract(L, L_joints))[0]
        return omega1, ZERO_VECTOR
    momentum = (*subtract(P, P_joints), *subtract(add(L, cross(centre, P)), L_joints))
    *v1, x, y, z = solve_symmetric(tuple(x for row in rows for x in row), momentum)[0]
    return (x, y, z), (v1[0], v1[1], v1[2])


def _rates(
    moving: TreeQuantities, centre: Vector, mass: Scalar, P: Vector, g_rate: Vector, pinned: bool
) -> tuple[Scalar, ...]:
    """Return the time derivative of the state."""
    values = moving.values
    force, torque = values["force1"], values["torque1"]
    for k, place in enumerate(moving.request.pushed):
        pose = moving.frame_poses[place]
        force = add(force, values[f"force_{k}"])
        torque = add(torque, add(values[f"torque_{k}"], cross(pose.d, values[f"force_{k}"])))
    weight = scale(values["gravity"], mass)
    if pinned:
        qdd = _pinned_accelerations(moving)
        return (*ZERO_VECTOR, *ZERO_VECTOR, *add(torque, cross(centre, weight)), *g_rate, *values["qd"], *qdd)
    momentum_rates = (*add(force, weight), *subtract(torque, cross(centre, force)))
    return (*scale(P, 1 / mass), *momentum_rates, *g_rate, *values["qd"], *moving.solved[2])


def _pinned_accelerations(moving: TreeQuantities) -> tuple[Scalar, ...]:
    """Return q'' where a1 is 0: the rows of M for a1, which come last, are left out."""
    bias, values = moving.coasting.balance(), moving.values
    size = 3 + moving.form.dof
    loads = [load - force for load, force in zip((*values["torque1"], *values["tau"]), bias[3:], strict=True)]
    solved = solve_symmetric(moving.mass_entries[: size * (size + 1) // 2], tuple(loads[::-1]))[0]
    return tuple(solved[::-1][3:])
