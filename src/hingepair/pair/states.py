"""What comes out: the state of the pair at every sample."""

from __future__ import annotations

from hingepair.engine.results import Results
from hingepair.numeric.arrays import FloatArray


class PairState(Results):
    """Body 2 (and body 1, where named) at every sample, as far as it was computed; world axes, SI units.

    Arrays are read-only views. What was not asked for, or cannot be had from the inputs, is None; to a type checker
    all are arrays, so that `state.R2[-1]` passes.

    Attributes:
        shape: leading shape of the samples; () for one state.
        outputs: names of what was computed.
    """

    __slots__ = {  # noqa: RUF023 (the order of the documentation)
        "R2": "Reference point of body 2; (..., 3) m.",
        "S2": "Rotation of body 2, body to world; (..., 3, 3).",
        "d": "R2 - R1 = S1 u1 - S2 u2, unharmed by a large R1; (..., 3) m.",
        "v2": "Velocity of body 2's reference point; (..., 3) m/s.",
        "omega2": "Angular velocity of body 2; (..., 3) rad/s.",
        "a2": "Classical acceleration of body 2's reference point; (..., 3) m/s^2.",
        "alpha2": "Angular acceleration of body 2; (..., 3) rad/s^2.",
        "R1": "Reference point of body 1; (..., 3) m.",
        "S1": "Rotation of body 1, body to world; (..., 3, 3).",
        "v1": "Velocity of body 1's reference point; (..., 3) m/s.",
        "omega1": "Angular velocity of body 1; (..., 3) rad/s.",
        "a1": "Classical acceleration of body 1's reference point; (..., 3) m/s^2.",
        "alpha1": "Angular acceleration of body 1; (..., 3) rad/s^2.",
        "jacobian": "Of `prepare`: (v2, omega2) by (v1, omega1, psi'); (..., 6, 7).",
        "acceleration_bias": "Of `prepare`: (a2, alpha2) where a1, alpha1, psi'' are none; (..., 6).",
        "coordinate_jacobian": "Of `prepare`: (v2, omega2) by the rates of the coordinates; (..., 6, 7).",
        "coordinate_jacobian_rate": "Of `prepare`: its time derivative; (..., 6, 7).",
        "force1": "Of `prepare`: what must act on body 1 at R1; (..., 3) N.",
        "torque1": "Of `prepare`: what must act on body 1 about R1; (..., 3) N m.",
        "hinge_torque": "Of `prepare`: what must act about the hinge axis; (...) N m.",
        "psidd": "Of `prepare`: acceleration of the hinge angle under what acts; (...) rad/s^2.",
    }

    R2: FloatArray
    S2: FloatArray
    d: FloatArray
    v2: FloatArray
    omega2: FloatArray
    a2: FloatArray
    alpha2: FloatArray
    R1: FloatArray
    S1: FloatArray
    v1: FloatArray
    omega1: FloatArray
    a1: FloatArray
    alpha1: FloatArray
    jacobian: FloatArray
    acceleration_bias: FloatArray
    coordinate_jacobian: FloatArray
    coordinate_jacobian_rate: FloatArray
    force1: FloatArray
    torque1: FloatArray
    hinge_torque: FloatArray
    psidd: FloatArray


class PlanarState(Results):
    """Body 2 of a planar pair at every sample, as far as it was computed; world axes, SI units.

    Arrays are read-only views. What was not asked for, or cannot be had from the inputs, is None; to a type checker
    all are arrays.

    Attributes:
        shape: leading shape of the samples; () for one state.
        outputs: names of what was computed.
    """

    __slots__ = {  # noqa: RUF023 (the order of the documentation)
        "R2": "Reference point of body 2; (..., 2) m.",
        "phi2": "Angle of body 2, phi + psi; (...,) rad.",
        "d": "R2 - R1, unharmed by a large R1; (..., 2) m.",
        "v2": "Velocity of body 2's reference point; (..., 2) m/s.",
        "omega2": "Angular velocity of body 2; (...,) rad/s.",
        "a2": "Acceleration of body 2's reference point; (..., 2) m/s^2.",
        "alpha2": "Angular acceleration of body 2; (...,) rad/s^2.",
    }

    R2: FloatArray
    phi2: FloatArray
    d: FloatArray
    v2: FloatArray
    omega2: FloatArray
    a2: FloatArray
    alpha2: FloatArray
