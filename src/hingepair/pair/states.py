"""Results of kinematics: the state of the pair at every sample."""

from __future__ import annotations

from hingepair.engine.results import Results
from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import FloatArray
from hingepair.pair.body_motion import BodyMotion, motion_of_rotations


class PairState(Results):
    """The computed outputs of a pair at every sample, in world axes and SI units. The attributes R2, S2, d, v2,
    omega2, a2 and alpha2 are read-only arrays for body 2. Outputs that were not computed are None.

    The attributes R1, S1, v1, omega1, a1 and alpha1 for body 1 are computed only if the argument `outputs` of the
    call names them. A state that a `Prepared` object returns can also have the attributes jacobian,
    acceleration_bias, coordinate_jacobian, coordinate_jacobian_rate, force1, torque1, hinge_torque and psidd; they
    are the results of the methods `jacobian`, `acceleration_bias`, `coordinate_jacobian`, `coordinate_jacobian_rate`,
    `inverse_dynamics` and `forward_dynamics` of HingePair. The leading axes of all arrays are the axes of the
    samples. Positions [m], velocities [m/s], accelerations [m/s^2], angular velocities [rad/s] and angular
    accelerations [rad/s^2] have shape (..., 3), and the rotations S1 and S2 (body to world) have shape (..., 3, 3).
    The type annotations declare every attribute as an array, although an output that was not computed is None. Only
    hingepair calls the constructor.

    Attributes:
        shape: leading shape of the arrays, as a tuple of the lengths of the axes of the samples; () for one state.
        outputs: tuple of the names of the outputs that were computed.
    """

    __slots__ = {  # noqa: RUF023 (the order of the documentation)
        "R2": "Reference point of body 2; (..., 3) m.",
        "S2": "Rotation of body 2, body to world; (..., 3, 3).",
        "d": "R2 - R1, computed as S1 u1 - S2 u2, so that a large R1 does not reduce its accuracy; (..., 3) m.",
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
        "jacobian": "Jacobian of (v2, omega2) with respect to (v1, omega1, psi'), from `prepare`; (..., 6, 7).",
        "acceleration_bias": "Value of (a2, alpha2) for a1 = alpha1 = psi'' = 0, from `prepare`; (..., 6).",
        "coordinate_jacobian": "Jacobian of (v2, omega2) with respect to `qd`, from `prepare`; (..., 6, 7).",
        "coordinate_jacobian_rate": "Time derivative of `coordinate_jacobian`, from `prepare`; (..., 6, 7).",
        "force1": "Force on body 1 at R1 that the motion requires, from `prepare`; (..., 3) N.",
        "torque1": "Torque on body 1 about R1 that the motion requires, from `prepare`; (..., 3) N m.",
        "hinge_torque": "Torque on body 2 about the hinge axis that the motion requires, from `prepare`; (...) N m.",
        "psidd": "Acceleration of the hinge angle under the loads, from `prepare`; (...) rad/s^2.",
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

    @property
    def body2(self) -> BodyMotion:
        """The motion of body 2 as a BodyMotion made of the computed outputs. In a chain of pairs, it is the motion of
        body 1 of the next pair. Reading this property raises ArgumentError unless both R2 and S2 were computed.

        Raises:
            ArgumentError: R2 or S2 is not among the outputs.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> upper = hp.HingePair(u1=(1, 0, 0), u2=(0, 0, 0), n=(0, 0, 1))
        >>> lower = hp.HingePair(u1=(1, 0, 0), u2=(0, 0, 0), n=(0, 1, 0))
        >>> arm = upper.forward_kinematics((0, 0, 0, 0, 0, 0, np.linspace(0, 1, 5)))
        >>> lower.forward_kinematics_from_body1(arm.body2, 0.5).R2[0]
        array([2., 0., 0.])
        """
        return self._motion("2")

    @property
    def body1(self) -> BodyMotion:
        """The motion of body 1 as a BodyMotion made of the computed outputs. Reading this property raises
        ArgumentError unless both R1 and S1 were computed. They are computed only if the argument `outputs` of the
        call that returned this state names them.

        Raises:
            ArgumentError: R1 or S1 is not among the outputs.
        """
        return self._motion("1")

    def __dir__(self) -> list[str]:
        bodies = (f"body{body}" for body in "12" if {f"R{body}", f"S{body}"} <= set(self.outputs))
        return [*super().__dir__(), *bodies]

    def _motion(self, body: str) -> BodyMotion:
        """Return the motion of body "1" or "2" as a BodyMotion made of the computed outputs."""
        for letter in "RS":
            if letter + body not in self.outputs:
                raise ArgumentError("outputs", f"R{body} and S{body}, of which body{body} is made", self.outputs)
        letters = (name for name in ("R", "S", "v", "omega", "a", "alpha") if name + body in self.outputs)
        return motion_of_rotations(**{name: self[name + body] for name in letters})


class PlanarState(Results):
    """The computed outputs of a planar pair at every sample, in world axes and SI units. The attributes R2, phi2, d,
    v2, omega2, a2 and alpha2 are read-only arrays. Outputs that were not computed are None.

    The leading axes of all arrays are the axes of the samples. R2 and d = R2 - R1 [m], v2 [m/s] and a2 [m/s^2] have
    shape (..., 2). phi2 = phi + psi [rad], omega2 [rad/s] and alpha2 [rad/s^2] have shape (...,); for one state they
    are NumPy numbers. The type annotations declare every attribute as an array, although an output that was not
    computed is None. Only hingepair calls the constructor.

    Attributes:
        shape: leading shape of the arrays, as a tuple of the lengths of the axes of the samples; () for one state.
        outputs: tuple of the names of the outputs that were computed.
    """

    __slots__ = {  # noqa: RUF023 (the order of the documentation)
        "R2": "Reference point of body 2; (..., 2) m.",
        "phi2": "Angle of body 2, phi + psi; (...,) rad.",
        "d": "R2 - R1, computed without R1, so that a large R1 does not reduce its accuracy; (..., 2) m.",
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
