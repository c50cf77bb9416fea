"""Results of the methods of pairs: states, forces, accelerations, energy and momentum at every sample."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from hingepair.engine.results import Results
from hingepair.equations.quantities import QUANTITIES, attribute_texts
from hingepair.errors import ArgumentError
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_of_rotations
from hingepair.numeric.arrays import FloatArray
from hingepair.plans.pairs import PLANE, POINT_ENDINGS, SPACE, unit_among


class PointState(Results):
    """Motion of one point of a pair at every sample, world axes; None where an output was not computed."""

    __slots__ = attribute_texts(POINT_ENDINGS)

    R: FloatArray
    v: FloatArray
    a: FloatArray


class _StateWithPoints(Results):
    """Base class of outputs of a pair, in which `state["tip"]` is the PointState of a point."""

    __slots__ = ()

    def __getitem__(self, name: str) -> Any:
        """Return an output by its name, or the PointState of a point.

        Raises:
            KeyError: the output was not computed.
        """
        if name not in QUANTITIES:
            outputs = {letter: f"{name}{ending}" for letter, ending in POINT_ENDINGS.items()}
            moving = {
                letter: Results.__getitem__(self, one) for letter, one in outputs.items() if one in self.outputs
            }
            if moving and not name.endswith((POINT_ENDINGS["v"], POINT_ENDINGS["a"])):
                return PointState(moving, self.shape)
        return Results.__getitem__(self, name)

    def _unit(self, name: str) -> str:
        return unit_among(self.outputs, name)


class PairState(_StateWithPoints):
    """The outputs of a pair at every sample: read-only arrays in world axes; None where one was not computed.
    `state["tip"]` is the PointState of a point.

    Those of body 1 are computed where `outputs` names them; those from `jacobian` on by prepared calls. Only
    hingepair calls the constructor.

    Attributes:
        shape: leading shape of all arrays, that of the samples; () for one state.
        outputs: names of the outputs that were computed.
    """

    __slots__ = attribute_texts(
        (
            *SPACE.levels,
            *("jacobian", "acceleration_bias", "force1", "torque1", "hinge_torque", "psidd"),
        ),
        SPACE.shapes,
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
        """Return the motion of body "1" or "2"; refuse one without R or S."""
        for letter in "RS":
            if letter + body not in self.outputs:
                raise ArgumentError("outputs", f"R{body} and S{body}, of which body{body} is made", self.outputs)
        letters = (name for name in ("R", "S", "v", "omega", "a", "alpha") if name + body in self.outputs)
        return motion_of_rotations(**{name: self[name + body] for name in letters})


class PlanarState(_StateWithPoints):
    """The outputs of a planar pair at every sample: read-only arrays, and numbers for one state, in world axes; None
    where one was not computed. `state["tip"]` is the PointState of a point. Only hingepair calls the constructor.

    Attributes:
        shape: leading shape of all arrays, that of the samples; () for one state.
        outputs: names of the outputs that were computed.
    """

    __slots__ = attribute_texts(PLANE.levels, PLANE.shapes)

    R2: FloatArray
    phi2: FloatArray
    d: FloatArray
    v2: FloatArray
    omega2: FloatArray
    a2: FloatArray
    alpha2: FloatArray


class _Parts(Results):
    """Results that can be unpacked in the order of their outputs."""

    __slots__ = ()

    def __iter__(self) -> Iterator[FloatArray]:
        return iter(self.arrays().values())

    def __repr__(self) -> str:
        arrays = self.arrays().items()
        parts = (f"{name}={a!r}" if np.size(a) <= 9 else f"{name}: shape {np.shape(a)}" for name, a in arrays)
        return f"{type(self).__name__}({', '.join(parts)})"


class Forces(_Parts):
    """Forces and torques that a motion of a pair requires (T1-T3). They can be unpacked, here as in all results of
    dynamics: `force1, torque1, hinge_torque = pair.inverse_dynamics(...)`. Those on body 1 of a planar pair have the
    shapes (..., 2) and (...,).
    """

    __slots__ = attribute_texts(("force1", "torque1", "hinge_torque"))

    force1: FloatArray
    torque1: FloatArray
    hinge_torque: FloatArray


class Accelerations(_Parts):
    """Accelerations of a pair that forces and torques cause (T5, T6)."""

    __slots__ = attribute_texts(("a1", "alpha1", "psidd"))

    a1: FloatArray
    alpha1: FloatArray
    psidd: FloatArray


class HingeWrench(_Parts):
    """Force and torque that body 1 exerts on body 2 at the hinge point, world axes (T3). Those of a planar pair have
    the shapes (..., 2) and (...,).
    """

    __slots__ = attribute_texts(("hinge_force", "hinge_moment", "hinge_torque", "bearing_torque"))

    hinge_force: FloatArray
    hinge_moment: FloatArray
    hinge_torque: FloatArray
    bearing_torque: FloatArray

    @property
    def force(self) -> FloatArray:
        """The force, hinge_force."""
        return self.hinge_force

    @property
    def torque(self) -> FloatArray:
        """The torque about the hinge point, hinge_moment."""
        return self.hinge_moment

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), "force", "torque"]


class Energy(_Parts):
    """Energy of a pair or a robot (T7)."""

    __slots__ = attribute_texts(("kinetic", "potential"))

    kinetic: FloatArray
    potential: FloatArray


class Momentum(_Parts):
    """Momentum of a pair or a robot, world axes (T8)."""

    __slots__ = attribute_texts(("linear",))

    linear: FloatArray

    @property
    def angular(self) -> FloatArray:
        """Angular momentum, of a pair about the world's origin [kg m^2/s]; (..., 3), of a planar pair (...,)."""
        return self[next(name for name in self.outputs if name.startswith("angular"))]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), "angular"]
