"""Jacobians and sensitivities of body 2 and of the constraints, and the accelerations that velocities cause."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import FloatArray, Frozen, read_only
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.constants import Constants, with_hinge_frames
from hingepair.pair.evaluate import compute_arrays
from hingepair.pair.forward_kinematics import CoordinateInput, read_component, read_pair_coordinates
from hingepair.plans.plan import SPATIAL_MOTION_KIND
from hingepair.rotations.sequences import find_sequence


def jacobian(pair: Constants, body1: BodyMotion, psi: ArrayLike) -> FloatArray:
    """Compute the Jacobian Jac in (v2, omega2) = Jac @ (v1, omega1, psi'), an array of shape (..., 6, 7) (E8, E2).
    `pair` holds the Constants of the pair; of the BodyMotion `body1`, only S is used. Raise ArgumentError if S is
    missing.
    """
    return _outputs_from_body1(pair, ("jacobian",), body1, "S", psi=psi)["jacobian"]


def acceleration_bias(pair: Constants, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike) -> FloatArray:
    """Compute the bias in (a2, alpha2) = Jac @ (a1, alpha1, psi'') + bias, the part of body 2's acceleration that
    velocities cause, an array of shape (..., 6) (E9). `pair` holds the Constants of the pair; of the BodyMotion
    `body1`, only S and omega are used. Raise ArgumentError if one of them is missing.
    """
    name = "acceleration_bias"
    return _outputs_from_body1(pair, (name,), body1, "S", "omega", psi=psi, psid=psid)[name]


def _outputs_from_body1(
    pair: Constants, names: tuple[str, ...], body1: BodyMotion, *letters: str, **hinge: ArrayLike
) -> dict[str, FloatArray]:
    """Compute the outputs `names` of a pair and return them as a dict of arrays by name. The arguments after `body1`
    are the letters of the arrays of this BodyMotion to use, such as "S"; psi and, if needed, psid are keyword
    arguments. Raise ArgumentError if one of these arrays is missing.
    """
    values = {
        **motion_arrays("body1", body1, *letters),
        **{n: read_component(n, value) for n, value in hinge.items()},
    }
    shapes = {"body1": body1.shape, **{name: np.shape(values[name]) for name in hinge}}
    return compute_arrays(pair, names, values, shapes)


def coordinate_jacobian(pair: Constants, q: CoordinateInput, sequence: str) -> FloatArray:
    """Compute the Jacobian Jq in (v2, omega2) = Jq @ qd, an array of shape (..., 6, 7), where qd are the time
    derivatives of the seven coordinates q (E8, E2, E4). `pair` holds the Constants of the pair, `sequence` is the
    Euler sequence.
    """
    return _output_from_coordinates(pair, "coordinate_jacobian", q, None, sequence)


def coordinate_jacobian_rate(pair: Constants, q: CoordinateInput, qd: CoordinateInput, sequence: str) -> FloatArray:
    """Compute the time derivative Jq' of the Jacobian Jq that coordinate_jacobian returns, an array of shape (..., 6,
    7), for which (a2, alpha2) = Jq @ qdd + Jq' @ qd (E9). `pair` holds the Constants of the pair, `sequence` is the
    Euler sequence. Raise ArgumentError if qd is None.
    """
    if qd is None:
        raise ArgumentError("qd", "the coordinates' rates", None)
    return _output_from_coordinates(pair, "coordinate_jacobian_rate", q, qd, sequence)


def _output_from_coordinates(pair: Constants, name: str, q: Any, qd: Any, sequence: str) -> FloatArray:
    """Compute the output `name` of a pair from q and, if it is not None, qd, and return it as an array. Raise
    ArgumentError for an unknown Euler sequence or unusable coordinates.
    """
    find_sequence(sequence)
    coordinates = read_pair_coordinates(SPATIAL_MOTION_KIND, q, qd, None)
    return compute_arrays(pair, (name,), coordinates.parts, coordinates.shapes, sequence=sequence)[name]


def constraint_jacobian(pair: Constants, body1: BodyMotion, body2: BodyMotion) -> FloatArray:
    """Compute the Jacobian G of the five hinge constraints in (gap', tilt') = G @ (v1, omega1, v2, omega2), an array
    of shape (..., 5, 12) (E1, E2). `pair` holds the Constants of the pair; of the BodyMotions `body1` and `body2`,
    only S is used. Raise ArgumentError if S is missing.
    """
    return _outputs_from_both_bodies(pair, "constraint_jacobian", body1, body2, "S")


def constraint_bias(pair: Constants, body1: BodyMotion, body2: BodyMotion) -> FloatArray:
    """Compute the bias in (gap'', tilt'') = G @ (a1, alpha1, a2, alpha2) + bias, the part of the constraints' second
    time derivatives that velocities cause, an array of shape (..., 5) (E1, E2). `pair` holds the Constants of the
    pair; of the BodyMotions `body1` and `body2`, only S and omega are used. Raise ArgumentError if one of these
    arrays is missing.
    """
    return _outputs_from_both_bodies(pair, "constraint_bias", body1, body2, "S", "omega")


def _outputs_from_both_bodies(
    pair: Constants, name: str, body1: BodyMotion, body2: BodyMotion, *letters: str
) -> FloatArray:
    """Compute one output `name` of a pair from two BodyMotions and return it as an array. The further arguments are
    the letters of the arrays to use, such as "S", from both motions. Raise ArgumentError if one of these arrays is
    missing.
    """
    values = {**motion_arrays("body1", body1, *letters), **motion_arrays("body2", body2, *letters)}
    shapes = {"body1": body1.shape, "body2": body2.shape}
    return compute_arrays(with_hinge_frames(pair), (name,), values, shapes)[name]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sensitivities(Frozen):
    """Derivatives of d = R2 - R1, S2, v2 and omega2 with respect to u1, u2, n and psi, as read-only arrays in world
    axes. For example, `d_by_u1` is the derivative of d with respect to u1.

    The last axis is the component of u1, u2 or n: if u1 changes by a small du, d changes by d_by_u1 @ du. Derivatives
    with respect to psi do not have this axis. Derivatives of v2 and omega2 are None if psid was not given. Some
    derivatives are always zero and not listed: those of S2 with respect to u1 and u2, and those of omega2 with
    respect to u1, u2 and psi. n is scaled to unit length, so the derivative with respect to a change along n is zero.

    Attributes:
        d_by_u1: derivative of d with respect to u1; shape (..., 3, 3). The other names are formed alike.
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
    """Compute the derivatives of R2 and of body 2's attitude (rows) with respect to u1, u2, n and home (columns), an
    array of shape (..., 6, 12) (E5, E7). Changes of the attitude are rotation vectors in world axes; changes of home
    are rotation vectors in body 1's axes. `pair` holds the Constants of the pair; of the BodyMotion `body1`, only S
    is used. Raise ArgumentError if S is missing.
    """
    arrays = _outputs_from_body1(pair, ("S2", "d_by_u1", "d_by_u2", "d_by_n", "S2_by_n"), body1, "S", psi=psi)
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


# Sensitivities that depend only on the pose.
POSE_SENSITIVITY_NAMES = ("d_by_u1", "d_by_u2", "d_by_n", "d_by_psi", "S2_by_n", "S2_by_psi")
# Sensitivities that depend on velocities too.
VELOCITY_SENSITIVITY_NAMES = ("v2_by_u1", "v2_by_u2", "v2_by_n", "v2_by_psi", "omega2_by_n")


def sensitivities(pair: Constants, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike | None) -> Sensitivities:
    """Compute the Sensitivities, a record of the derivatives of d, S2, v2 and omega2 with respect to u1, u2, n and
    psi (E2, E5-E8). Without psid, the derivatives of v2 and omega2 are None. `pair` holds the Constants of the pair;
    of the BodyMotion `body1`, only S is used, and omega if psid is given.
    """
    if psid is None:
        outputs = _outputs_from_body1(pair, POSE_SENSITIVITY_NAMES, body1, "S", psi=psi)
    else:
        names = (*POSE_SENSITIVITY_NAMES, *VELOCITY_SENSITIVITY_NAMES)
        outputs = _outputs_from_body1(pair, names, body1, "S", "omega", psi=psi, psid=psid)
    return Sensitivities(**{name: read_only(array) for name, array in outputs.items()})
