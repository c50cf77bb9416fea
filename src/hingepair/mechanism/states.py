"""Results of what pairs and robots compute: motion, forces and torques, accelerations, energy and momentum."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, Final

import numpy as np

from hingepair.engine.results import Results
from hingepair.equations.quantities import QUANTITIES, attribute_texts, unit_of
from hingepair.errors import ArgumentError, UnknownOutputError, choices, nearest, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_of_rotations
from hingepair.numeric.arrays import FloatArray, check_choice
from hingepair.plans.pairs import PLANE, POINT_ENDINGS, SPACE, unit_among
from hingepair.plans.trees import DYNAMICS_MATRICES, FRAME_OUTPUTS
from hingepair.tables.data_frames import column_names, sample_rows, split_columns
from hingepair.tables.sheets import Sheet, align_columns, cell_text

_BY_COORDINATE: Final = ("tau", "qdd")
"""Outputs with a component for each coordinate."""


def _by_place(arrays: Mapping[str, FloatArray], places: Sequence[str]) -> dict[str, FloatArray]:
    """Return vectors and matrices by output and frame or joint, such as R_hand, as saved results have them."""
    return {
        f"{name}_{place}": array[..., k, :, :] if name == "S" else array[..., k, :]
        for name, array in arrays.items()
        for k, place in enumerate(places)
    }


class Named(Results):
    """Results of a robot whose class has the names of its frames or joints."""

    __slots__ = ()

    _made_of: ClassVar[tuple[Any, ...]] = ()  # arguments of `with_names`

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuilt, (self._made_of, self.arrays(), self.shape)


@functools.lru_cache(maxsize=256)
def with_names(
    kind: type[Results], names: tuple[tuple[str, Any], ...], further: tuple[str, ...] = ()
) -> type[Results]:
    """Return the cached subclass of a class of results for frames or joints of these names.

    Args:
        kind: the class.
        names: class attributes and their values, such as the names of frames or joints.
        further: further outputs that are attributes.
    """
    content = {"__slots__": {**kind.__slots__, **attribute_texts(further)}, "__doc__": kind.__doc__}  # type: ignore[dict-item]
    made_of = {"_made_of": (kind, names, further), "__module__": __name__}
    return type(kind.__name__, (kind,), {**content, **made_of, **dict(names)})


def _rebuilt(made_of: tuple[Any, ...], *content: Any) -> Results:
    """Return results from their pickled contents."""
    return with_names(*made_of)(*content)


class _FrameMotion(Results):
    """Outputs of frames."""

    __slots__ = ()

    R: FloatArray
    S: FloatArray
    d: FloatArray
    v: FloatArray
    omega: FloatArray
    a: FloatArray
    alpha: FloatArray


class FrameState(_FrameMotion):
    """Motion of one frame at every sample, world axes; None where an output was not computed."""

    __slots__ = attribute_texts(FRAME_OUTPUTS)


class MechanismState(Named, _FrameMotion):
    """Motion of some frames of a robot at every sample, world axes; None where an output was not computed.
    `state["hand"]` is the FrameState of one frame. Only hingepair calls the constructor.

    Attributes:
        frames: names of the frames, in the order of the axis of the frames.
    """

    __slots__ = attribute_texts(FRAME_OUTPUTS, leading="..., frames")

    frames: ClassVar[tuple[str, ...]] = ()
    _robot_frames: ClassVar[tuple[str, ...]] = ()
    """Names of all frames of the robot, computed or not."""
    _single: ClassVar[bool] = False  # whether the arrays have no axis of frames

    def __getitem__(self, name: str) -> Any:
        """Return the FrameState of a frame by its name."""
        if name not in self.frames:
            expected = choices(self.frames)
            if name in self._robot_frames:
                expected += f", since {name!r} was not computed: ask for it with frames=({name!r},)"
            else:
                expected += nearest(str(name), self._robot_frames)
            raise UnknownOutputError("frame", expected, quoted(name))
        moving = {output: array for output, array in self.arrays().items() if output in FRAME_OUTPUTS}
        if not self._single:
            at = (slice(None),) * len(self.shape) + (self.frames.index(name),)
            moving = {output: array[at] for output, array in moving.items()}
        return FrameState(moving, self.shape)

    def _recorded(self) -> dict[str, Any]:
        arrays = self.arrays()
        moving = {name: array for name, array in arrays.items() if name in FRAME_OUTPUTS}
        if self._single:
            moving = {
                name: array[..., None, :, :] if name == "S" else array[..., None, :] for name, array in moving.items()
            }
        return _by_place(moving, self.frames) | {name: arrays[name] for name in arrays if name not in moving}

    def _unit(self, name: str) -> str:
        letter, _, place = name.partition("_")
        return unit_of(letter if place and letter in FRAME_OUTPUTS else name)

    def __repr__(self) -> str:
        frames = self.frames if len(self.frames) <= 8 else (*self.frames[:6], f"... ({len(self.frames)} frames)")
        names = ", ".join(self.outputs)
        return f"{type(self).__name__}(shape={self.shape}, frames=({', '.join(frames)}), outputs=({names}))"


class JointResults(Named):
    """Base class of results with a column for each coordinate of a robot, such as torques."""

    __slots__ = ()

    names: ClassVar[tuple[str, ...]] = ()  # names of the joints with a coordinate, in the order of the columns

    def _recorded(self) -> dict[str, Any]:
        """Return the outputs by column; those of joints have the names of the joints, so that a table of qdd or tau
        alone is taken as this argument.
        """
        recorded: dict[str, Any] = {}
        for name, array in self.arrays().items():
            if name in _BY_COORDINATE:
                recorded |= {joint: array[..., k] for k, joint in enumerate(self.names)}
            else:
                recorded[name] = array
        return recorded

    def _sheet(self) -> Sheet:
        """Return the printed table: the values of one sample, or the largest sizes."""
        if not all(isinstance(array, np.ndarray) for array in self.arrays().values()):
            return super()._sheet()  # arrays of Dask or JAX are not computed only to be printed
        arrays, shown = sample_rows(self._recorded(), len(self.shape)), "largest size" if self.shape else "value"
        parts = split_columns(arrays)
        sizes = [part[0] if self.shape == () else np.abs(part).max(initial=0.0) for part in parts]
        rows = ((name, cell_text(float(size))) for name, size in zip(column_names(arrays), sizes, strict=True))
        return Sheet(f"{type(self).__name__}, shape {self.shape}", (("", shown), *rows))

    def __str__(self) -> str:
        title, rows, _ = self._sheet()
        return "\n".join((title, *align_columns(rows, {1})))


class MechanismForces(JointResults):
    """Forces and torques that a motion of a robot requires; body 1 is the base. Only hingepair calls the
    constructor.
    """

    __slots__ = attribute_texts(("tau", "force1", "torque1"))

    tau: FloatArray
    force1: FloatArray
    torque1: FloatArray


class JointWrench(Results):
    """Force [N] of the carrying body on the body of one joint, and torque about the joint's point [N m]; world axes,
    shape (..., 3) each.
    """

    __slots__ = ("force", "torque")

    force: FloatArray
    torque: FloatArray


class JointWrenches(JointResults):
    """Forces and torques that all joints of a robot transmit during a motion, world axes. `wrenches["joint"]` is the
    JointWrench of one joint. Only hingepair calls the constructor.

    Attributes:
        names: names of the joints, those that follow others included.
    """

    __slots__ = attribute_texts(("force", "torque"))

    force: FloatArray
    torque: FloatArray

    def __getitem__(self, name: str) -> Any:
        """Return the JointWrench of a joint."""
        arrays = self.arrays()
        check_choice("joint", name, self.names)
        place = self.names.index(name)
        return JointWrench({output: array[..., place, :] for output, array in arrays.items()}, self.shape)

    def _recorded(self) -> dict[str, Any]:
        return _by_place(self.arrays(), self.names)

    def _unit(self, name: str) -> str:
        return unit_of(name.partition("_")[0])


class MechanismAccelerations(JointResults):
    """Accelerations of a robot under given torques and forces; body 1 is a free base, and a1 and alpha1 are None for
    any other. Only hingepair calls the constructor.
    """

    __slots__ = attribute_texts(("qdd", "a1", "alpha1"))

    qdd: FloatArray
    a1: FloatArray
    alpha1: FloatArray


class MechanismDerivatives(Results):
    """Derivatives of the torques or accelerations of a robot by its coordinates, their rates and accelerations or
    torques: a row for each torque or acceleration, a column for each coordinate, shape (..., dof, dof); with a free
    base (..., 6 + dof, 6 + dof), the base first. tau_qdd is the mass matrix and qdd_tau its inverse; those that were
    not computed are None. Only hingepair calls the constructor.
    """

    __slots__ = attribute_texts(DYNAMICS_MATRICES)

    tau_q: FloatArray
    tau_qd: FloatArray
    tau_qdd: FloatArray
    qdd_q: FloatArray
    qdd_qd: FloatArray
    qdd_tau: FloatArray


# ---- pairs


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
            UnknownOutputError: the output was not computed.
        """
        if name not in QUANTITIES:
            outputs = {letter: f"{name}{ending}" for letter, ending in POINT_ENDINGS.items()}
            moving = {
                letter: Results.__getitem__(self, one) for letter, one in outputs.items() if one in self.outputs
            }
            if moving and not name.endswith((POINT_ENDINGS["v"], POINT_ENDINGS["a"])):
                return PointState(moving, self.shape)
            if name not in self.outputs:
                expected = (
                    f"{choices(self.outputs)}{nearest(str(name), self.outputs)}; a point is computed if asked for"
                )
                raise UnknownOutputError("output", expected + ", as outputs=('tip', 'tip_v', 'tip_a')", quoted(name))
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
