"""Results of kinematics: the state of the pair at every sample."""

from __future__ import annotations

from hingepair.engine.results import Results
from hingepair.equations.quantities import attribute_texts
from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import FloatArray
from hingepair.pair.body_motion import BodyMotion, motion_of_rotations
from hingepair.plans.plan import PLANAR_MOTION_KIND, SPATIAL_MOTION_KIND


class PairState(Results):
    """The outputs of a pair at every sample: read-only arrays in world axes; None where one was not computed.

    Those of body 1 are computed where `outputs` names them; those from `jacobian` on by prepared calls. Only
    hingepair calls the constructor.

    Attributes:
        shape: leading shape of all arrays, that of the samples; () for one state.
        outputs: names of the outputs that were computed.
    """

    __slots__ = attribute_texts(
        (
            *SPATIAL_MOTION_KIND.levels,
            *("jacobian", "acceleration_bias", "coordinate_jacobian", "coordinate_jacobian_rate"),
            *("force1", "torque1", "hinge_torque", "psidd"),
        ),
        SPATIAL_MOTION_KIND.shapes,
    )

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
        """The motion of body 2. In a chain of pairs, it is that of body 1 of the next pair.

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
        """The motion of body 1, of the outputs that `outputs` named.

        Raises:
            ArgumentError: R1 or S1 is not among the outputs.
        """
        return self._motion("1")

    def __dir__(self) -> list[str]:
        bodies = (f"body{body}" for body in "12" if {f"R{body}", f"S{body}"} <= set(self.outputs))
        return [*super().__dir__(), *bodies]

    def _motion(self, body: str) -> BodyMotion:
        for letter in "RS":
            if letter + body not in self.outputs:
                raise ArgumentError("outputs", f"R{body} and S{body}, of which body{body} is made", self.outputs)
        letters = (name for name in ("R", "S", "v", "omega", "a", "alpha") if name + body in self.outputs)
        return motion_of_rotations(**{name: self[name + body] for name in letters})


class PlanarState(Results):
    """The outputs of a planar pair at every sample: read-only arrays, and numbers for one state, in world axes; None
    where one was not computed. Only hingepair calls the constructor.

    Attributes:
        shape: leading shape of all arrays, that of the samples; () for one state.
        outputs: names of the outputs that were computed.
    """

    __slots__ = attribute_texts(PLANAR_MOTION_KIND.levels, PLANAR_MOTION_KIND.shapes)

    R2: FloatArray
    phi2: FloatArray
    d: FloatArray
    v2: FloatArray
    omega2: FloatArray
    a2: FloatArray
    alpha2: FloatArray
