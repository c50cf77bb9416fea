"""Sizes below which the pivots of a mass matrix (T5) are rounding, of pairs and robots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.equations.joints import Axis
from hingepair.numeric.arrays import Float64Array

_ROUNDING: Final = 64 * 2.0**-53  # a pivot below this share of all inertia is rounding


class Resisted(NamedTuple):
    """A joint, and what resists it at least; numbers may have leading axes."""

    parent: int  # number of the body that carries it; 0 is the base
    axis: Axis
    own: Any  # inertia along the joint of its own body and rotor
    reach: Any  # largest distance of its point from the reference point of the parent [m]


def smallest_pivots(bodies: Sequence[tuple[Any, Any, Any]], joints: Sequence[Resisted]) -> list[Float64Array]:
    """Return the sizes below which pivots are rounding, 0 where a pivot cannot be that small: of each joint, then of
    forces and of torques on a free base. What resists a joint is at most all bodies beyond it, stretched out.

    Args:
        bodies: mass, centre of mass and inertia about it of each body, the base first.
        joints: the joints, which carry the bodies behind the base in this order.
    """
    mass = [abs(m) for m, _, _ in bodies]
    levers = [np.abs(c).sum(axis=-1) for _, c, _ in bodies]
    moment = [m * lever for m, lever in zip(mass, levers, strict=True)]
    spread = [h * lever + np.abs(J).max() for h, lever, (_, _, J) in zip(moment, levers, bodies, strict=True)]
    found: list[Float64Array] = []
    for k in range(len(joints), 0, -1):
        p, axis, own, reach = joints[k - 1]
        least = _ROUNDING * (axis.turns**2 * spread[k] + axis.shifts**2 * mass[k])
        found.insert(0, _limit(own > least, least))
        mass[p] = mass[p] + mass[k]
        spread[p] = spread[p] + spread[k] + 2 * reach * moment[k] + mass[k] * reach * reach
        moment[p] = moment[p] + moment[k] + mass[k] * reach
    force, torque = _ROUNDING * mass[0], _ROUNDING * spread[0]
    m, c, J = bodies[0]
    resistance = float(np.linalg.eigvalsh(J)[0])
    is_regular: Any = False
    if m > 0 and resistance > 0:
        # A force may also turn the base about its centre of mass, which resists it least.
        is_regular = (resistance > torque) & (1 / (1 / m + float(c @ c) / resistance) > force)
    return [*found, _limit(is_regular, force), _limit(is_regular, torque)]


def _limit(is_regular: Any, least: Any) -> Float64Array:
    """Return the size below which a pivot is rounding; not 0, which stands for a pivot that is never small."""
    return np.where(is_regular, 0.0, np.maximum(least, 1e-300))
