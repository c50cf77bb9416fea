"""Derivatives of the motion of body 2 by the geometry of a pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hingepair.numeric.arrays import FloatArray, Frozen
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.computations import body1_inputs, compute
from hingepair.pair.constants import Constants
from hingepair.plans.plan import SPATIAL_MOTION_KIND


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sensitivities(Frozen):
    """Derivatives of d = R2 - R1, S2, v2 and omega2 with respect to u1, u2, n and psi, read-only, world axes.

    The last axis is the component of u1, u2 or n: if u1 changes by a small du, d changes by d_by_u1 @ du. Derivatives
    with respect to psi do not have it. n is scaled to unit length, so that a change along n has no effect. Those not
    listed are always zero; those of v2 and omega2 are None if psid was not given.

    Attributes:
        d_by_u1: shape (..., 3, 3).
        d_by_u2: (..., 3, 3).
        d_by_n: (..., 3, 3) m.
        d_by_psi: (..., 3) m/rad.
        S2_by_n: (..., 3, 3, 3); element [..., i, j, k] is the derivative of S2[i, j] with respect to n[k].
        S2_by_psi: (..., 3, 3).
        v2_by_u1: (..., 3, 3) 1/s.
        v2_by_u2: (..., 3, 3) 1/s.
        v2_by_n: (..., 3, 3) m/s.
        v2_by_psi: (..., 3) m/(s rad).
        omega2_by_n: (..., 3, 3) rad/s.
    """

    d_by_u1: FloatArray
    d_by_u2: FloatArray
    d_by_n: FloatArray
    d_by_psi: FloatArray
    S2_by_n: FloatArray
    S2_by_psi: FloatArray
    v2_by_u1: FloatArray | None = None
    v2_by_u2: FloatArray | None = None
    v2_by_n: FloatArray | None = None
    v2_by_psi: FloatArray | None = None
    omega2_by_n: FloatArray | None = None


def geometry_jacobian(pair: Constants, body1: BodyMotion, psi: ArrayLike) -> FloatArray:
    """Compute the derivatives of R2 and of body 2's attitude (rows) by u1, u2, n and home (columns); shape
    (..., 6, 12) (E5, E7). Changes of the attitude are rotation vectors in world axes; those of home, in body-1 axes.
    """
    names = ("S2", "d_by_u1", "d_by_u2", "d_by_n", "S2_by_n")
    state = compute(SPATIAL_MOTION_KIND, pair, names, body1_inputs(body1, psi))
    arrays = {name: np.asarray(state[name]) for name in names}
    S2 = arrays["S2"]
    slopes = np.zeros((*S2.shape[:-2], 6, 12))
    slopes[..., :3, 0:3], slopes[..., :3, 3:6], slopes[..., :3, 6:9] = (
        arrays[f"d_by_{x}"] for x in ("u1", "u2", "n")
    )
    turn = np.einsum("...ijk,...lj->...ilk", arrays["S2_by_n"], S2)  # (dS2/dn_k) S2^T = [rotation vector]x
    for row, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        slopes[..., 3 + row, 6:9] = (turn[..., i, j, :] - turn[..., j, i, :]) / 2
    home = pair.arrays["home"]
    slopes[..., 3:, 9:] = S2 @ np.swapaxes(home.reshape(*home.shape[:-1], 3, 3), -1, -2)
    arm = (S2 @ pair.arrays["u2"][..., None])[..., 0]
    slopes[..., :3, 9:] = np.cross(arm[..., None], slopes[..., 3:, 9:], axis=-2)  # -(turn x S2 u2)
    return slopes
