"""Inertial parameters of robots, ten numbers for each body, and the combinations of them on which torques depend."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError
from hingepair.mechanism.bodies.body import INERTIA_ENTRIES
from hingepair.mechanism.bodies.body import inertial_parameters as body_parameters
from hingepair.mechanism.tree import Tree
from hingepair.numeric.arrays import Float64Array, Frozen, read_only
from hingepair.rotations.matrices import skew
from hingepair.urdf.rigid import MassProperties

PARAMETERS: Final = ("m", "hx", "hy", "hz", "Jxx", "Jxy", "Jyy", "Jxz", "Jyz", "Jzz")
"""The parameters of a body: mass, first moment, and inertia about the reference point; Pinocchio's order."""
# Of dependent parameters of a body, the first are kept, so that masses count with the bodies that carry them.
_KEPT_FIRST: Final = ("Jxx", "Jxy", "Jxz", "Jyz", "Jzz", "Jyy", "hx", "hy", "hz", "m")
_DEPENDENT = 1e-7  # of the longest column of its kind (m, h or J); a shorter rest counts as 0
_STATES = 50  # random states that tell which columns are independent; a joint has ten columns


def inertial_parameters(tree: Tree, with_base: bool) -> Float64Array:
    """Return the parameters of all bodies, the base first if it counts; shape (10 * bodies,)."""
    bodies = [*([tree.single().base] if with_base else []), *(joint.body for joint in tree.joints)]
    rows = [body_parameters(body.mass, body.centre_of_mass, body.inertia) for body in bodies]
    return read_only(np.array(rows).ravel())


def inertia_matrices(parameters: Float64Array) -> NDArray[np.float64]:
    """Return J, about the reference point, of all bodies; shape (bodies, 3, 3)."""
    rows = parameters.reshape(-1, 10)
    J = np.empty((len(rows), 3, 3))
    for k, (i, j) in enumerate(INERTIA_ENTRIES):
        J[:, i, j] = J[:, j, i] = rows[:, 4 + k]
    return J


def tree_with_parameters(
    tree: Tree, with_base: bool, parameters: Float64Array, armature: Float64Array | None = None
) -> Tree:
    """Return a copy of a tree with other inertial parameters and, if given, rotors by coordinate."""
    names, masses = tree.single().body_names[not with_base :], []
    for name, row, J in zip(names, parameters.reshape(-1, 10), inertia_matrices(parameters), strict=True):
        m, h = float(row[0]), row[1:4]
        if m == 0 and h.any():
            raise ArgumentError("parameters", f"no first moment of {name!r}, whose mass is 0", tuple(h.tolist()))
        c = h / m if m else np.zeros(3)
        inertia = J + m * skew(c) @ skew(c)
        masses.append(MassProperties(m, read_only(c), read_only((inertia + inertia.T) / 2)))
    bodies = masses[1:] if with_base else masses
    rotors = [joint.armature for joint in tree.joints]
    if armature is not None:  # a rotor of a joint that follows another counts with the leader's
        own = iter(armature.tolist())
        rotors = [next(own) if joint.mimic is None else 0.0 for joint in tree.joints]
    return replace(
        tree,
        base=masses[0] if with_base else tree.base,
        joints=tuple(
            replace(joint, body=body, armature=rotor)
            for joint, body, rotor in zip(tree.joints, bodies, rotors, strict=True)
        ),
        assumed=(),
        source=None,
        without_mass={k: link for k, link in tree.without_mass.items() if k == 0 and not with_base},
    )


@dataclass(frozen=True, slots=True, eq=False)
class BaseParameters(Frozen):
    """The base parameters of a robot: the fewest combinations of its inertial parameters that torques depend on.

    For the regressor Y of `torque_regressor` and the inertial parameters p, Y @ p = Y[..., columns] @ (matrix @ p).
    Each combination is one inertial parameter, which gives it its name, and multiples of others, whose own columns of
    Y are combinations of the columns kept. Matter on the axis of a hinge, for instance, is counted with the body that
    carries the hinge (T9).

    Attributes:
        names: a name for each combination, such as "panda_link3 hx", in the order of `columns`.
        columns: indices of the inertial parameters that name the combinations, in the order of the regressor's
            columns; shape (B,).
        matrix: the combinations, as rows; shape (B, 10 * bodies).
        values: the combinations of the robot's own inertial parameters [kg, kg m, kg m^2]; shape (B,).
        parameter_names: names of all inertial parameters; 10 * bodies of them.
    """

    names: tuple[str, ...]
    columns: NDArray[np.intp]
    matrix: Float64Array
    values: Float64Array
    parameter_names: tuple[str, ...]


def find_base_parameters(
    tree: Tree, with_base: bool, regressor: Callable[[NDArray[np.float64]], Any], limits: Float64Array
) -> BaseParameters:
    """Return the base parameters of a robot, found numerically: from the base outward, a parameter is kept if its
    column of the regressor is no combination of those kept before.

    Args:
        tree: record of the robot.
        with_base: whether the mass of the base counts.
        regressor: function of q, qd, qdd at random states, shape (3, states, dof).
        limits: of q; shape (dof, 2).
    """
    rng = np.random.default_rng(0)
    states = rng.uniform(-1.0, 1.0, (3, _STATES, len(limits)))
    finite = np.asarray(np.isfinite(limits).all(axis=1, keepdims=True))
    low, high = np.where(finite, limits, np.array((-np.pi, np.pi))).T
    states[0] = (low + high) / 2 + states[0] * (high - low) / 2
    rows = np.asarray(regressor(states))
    # R of a QR decomposition has the same combinations of columns.
    rows = np.asarray(np.linalg.qr(rows.reshape(math.prod(rows.shape[:-1]), rows.shape[-1]), "r"))
    lengths = np.linalg.norm(rows, axis=0)
    bodies = rows.shape[1] // 10
    order = [10 * body + PARAMETERS.index(name) for body in range(bodies) for name in _KEPT_FIRST]
    kept = sorted(_independent(rows, lengths, order))
    unit = np.where(lengths > 0, lengths, 1.0)
    matrix = np.zeros((len(kept), rows.shape[1]))
    if kept:
        scaled = rows / unit
        matrix = np.linalg.lstsq(scaled[:, kept], scaled)[0] * unit / unit[kept][:, None]
    near = np.abs(matrix - np.rint(matrix)) < 1e-9  # rounding of lstsq
    matrix[near] = np.rint(matrix[near])
    matrix[:, kept] = np.eye(len(kept))
    names = tuple(f"{body} {name}" for body in tree.body_names[not with_base :] for name in PARAMETERS)
    return BaseParameters(
        tuple(names[k] for k in kept),
        read_only(np.array(kept, dtype=np.intp)),
        read_only(matrix),
        read_only(matrix @ inertial_parameters(tree, with_base)),
        names,
    )


def _independent(rows: NDArray[np.float64], lengths: Float64Array, order: Sequence[int]) -> list[int]:
    """Return the columns that are no combination of those before them in `order` (Gram-Schmidt, twice)."""
    kinds = [name[0] for name in PARAMETERS] * (len(lengths) // 10)
    longest = {kind: lengths[[one == kind for one in kinds]].max(initial=0.0) for kind in "mhJ"}
    sizes = [longest[kind] for kind in kinds]
    basis = np.empty_like(rows.T)
    kept: list[int] = []
    for k in order:
        rest, before = rows[:, k], basis[: len(kept)]
        for _ in range(2):
            rest = rest - (before @ rest) @ before
        length = np.linalg.norm(rest)
        if length > _DEPENDENT * sizes[k]:
            basis[len(kept)] = rest / length
            kept.append(k)
    return kept
