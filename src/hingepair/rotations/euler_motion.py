"""Euler angles in motion (E4): J, its inverse and its rate, and how near to gimbal lock it is."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hingepair.equations.derivatives import WORLD, beside
from hingepair.numeric.arrays import FloatArray, Frozen, broadcast_shape, read_only, result_dtype, vectors
from hingepair.numeric.blocks import Values, angle_terms, components_of, tabulate
from hingepair.rotations.euler import canonical_rates, lock_limit
from hingepair.rotations.sequences import Sequence, find_sequence


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EulerKinematics(Frozen):
    """omega = J phi', phi' = J^-1 omega, alpha = J phi'' + J' phi' (E4), omega and alpha in world axes.

    Attributes:
        J: (..., 3, 3).
        J_inverse: (..., 3, 3); NaN where `euler_rates` raises, nearer to lock than 1e-12 (float32: 5e-4).
        J_dot: rate of J; (..., 3, 3) 1/s; None where phid was not given.
        condition: of J in the 2-norm: by how much a relative error of omega may grow in phi'; 1 at best, inf at lock;
            (...,).
        lock_distance: angle between the middle angle and the nearest one at gimbal lock, in [0, pi/2]; (...,) rad.
    """

    J: FloatArray
    J_inverse: FloatArray
    condition: FloatArray
    lock_distance: FloatArray
    J_dot: FloatArray | None = None


def euler_kinematics(phi: ArrayLike, phid: ArrayLike | None = None, sequence: str = "XYZ") -> EulerKinematics:
    """J, J^-1, J' and the distance from gimbal lock (E4), for a body of which the Euler angles are known.

    The middle axis is perpendicular to the outer two, so with g the cosine between those the singular values of J are
    sqrt(1 + abs(g)), 1 and sqrt(1 - abs(g)), and the condition number is (1 + abs(g)) / sqrt(1 - g^2).

    Args:
        phi: angles in the order of the sequence's letters [rad]; shape (..., 3).
        phid: their rates [rad/s]; shape (..., 3).
        sequence: one of 24; upper case intrinsic, lower case extrinsic.

    Returns:
        A `hingepair.euler_motion.EulerKinematics`: `.J` (..., 3, 3), `.J_inverse` (..., 3, 3; NaN at lock), `.J_dot`
        (..., 3, 3) 1/s (None without phid), `.condition` (...,), `.lock_distance` (...,) rad.

    Raises:
        ArgumentError: an argument cannot be used; names it.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> near = hp.euler_kinematics((0, np.pi / 2 - 1e-3, 0))
    >>> f"{near.lock_distance:.6f} {near.condition:.0f}"
    '0.001000 2000'

    The angles of body 2 come from its attitude, their rates from its angular velocity:

    >>> pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
    >>> state = pair.forward_kinematics((0, 0, 0, 0, 0.25, 0, 0.5), (0, 0, 0, 0, 0, 0, 2))
    >>> phi2 = hp.matrix_to_euler(state.S2)
    >>> body2 = hp.euler_kinematics(phi2, hp.euler_rates(phi2, state.omega2))
    >>> bool(abs(body2.J_inverse @ state.omega2 - (0, 0, 2)).max() < 1e-15)
    True
    """
    order = find_sequence(sequence)
    given = {"phi": vectors("phi", phi, 3)}
    tails: dict[str, tuple[int, ...]] = {"J": (3, 3), "J_inverse": (3, 3), "condition": (), "lock_distance": ()}
    if phid is not None:
        given["phid"] = vectors("phid", phid, 3)
        tails["J_dot"] = (3, 3)
    shape = broadcast_shape({name: array.shape[:-1] for name, array in given.items()})
    inputs = {name: components_of(array) for name, array in given.items()}
    function = functools.partial(_of_one, order, lock_limit(given["phi"]))
    found = tabulate(function, inputs, tails, shape, result_dtype(given.values()))
    return EulerKinematics(**{name: read_only(array) for name, array in found.items()})


def _of_one(order: Sequence, limit: float, values: Values) -> Values:
    """Everything, by name, for components of phi and phid."""
    trig = angle_terms(order.angles(values["phi"]))
    axes = order.axes(trig)
    found: Values = {"J": beside(*order.columns(axes))}
    if "phid" in values:
        found["J_dot"] = beside(*order.column_rates(axes, values["phid"]))
    sine, cosine = np.abs(trig[2]), np.abs(trig[3])
    lock, common = (sine, cosine) if order.proper else (cosine, sine)
    inverse = [order.angles(canonical_rates(order, trig, unit)) for unit in WORLD]
    found["J_inverse"] = tuple(np.where(lock < limit, np.nan, entry) for entry in beside(*inverse))
    found["condition"] = np.divide(1.0 + common, lock)
    found["lock_distance"] = np.arctan2(lock, common)
    return found
