"""Results of a robot's methods: the motion of frames, forces and torques, and accelerations."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Final

import numpy as np

from hingepair.engine.results import Results
from hingepair.equations.quantities import attribute_texts, unit_of
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.numeric.arrays import FloatArray
from hingepair.plans.trees import FRAME_OUTPUTS
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


class MechanismState(_FrameMotion):
    """Motion of some frames of a robot at every sample, world axes; None where an output was not computed.
    `state["hand"]` is the FrameState of one frame. Only hingepair calls the constructor.

    Attributes:
        frames: names of the frames, in the order of the axis of the frames.
    """

    __slots__ = attribute_texts(FRAME_OUTPUTS, leading="..., frames")

    frames: ClassVar[tuple[str, ...]] = ()
    _robot_frames: ClassVar[tuple[str, ...]] = ()
    """Names of all frames of the robot, computed or not."""
    _further: ClassVar[tuple[str, ...]] = ()

    def __getitem__(self, name: str) -> Any:
        """Return the FrameState of a frame by its name."""
        if name not in self.frames:
            expected = choices(self.frames)
            if name in self._robot_frames:
                expected += f", since {name!r} was not computed: ask for it with frames=({name!r},)"
            else:
                expected += nearest(str(name), self._robot_frames)
            raise ArgumentError("frame", expected, quoted(name))
        place, axis = self.frames.index(name), len(self.shape)
        moving = {output: array for output, array in self.arrays().items() if output in FRAME_OUTPUTS}
        arrays = {output: array[(slice(None),) * axis + (place,)] for output, array in moving.items()}
        return FrameState(arrays, self.shape)

    def _recorded(self) -> dict[str, Any]:
        arrays = self.arrays()
        moving = {name: array for name, array in arrays.items() if name in FRAME_OUTPUTS}
        return _by_place(moving, self.frames) | {name: arrays[name] for name in arrays if name not in moving}

    def _unit(self, name: str) -> str:
        letter, _, place = name.partition("_")
        return unit_of(letter if place and letter in FRAME_OUTPUTS else name)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), "frames"]

    def __repr__(self) -> str:
        frames = self.frames if len(self.frames) <= 8 else (*self.frames[:6], f"... ({len(self.frames)} frames)")
        names = ", ".join(self.outputs)
        return f"{type(self).__name__}(shape={self.shape}, frames=({', '.join(frames)}), outputs=({names}))"

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild_state, (self.frames, self._robot_frames, self._further, self.arrays(), self.shape)


@functools.lru_cache(maxsize=256)
def mechanism_state_class(
    frames: tuple[str, ...], robot_frames: tuple[str, ...], further: tuple[str, ...] = ()
) -> type[MechanismState]:
    """Return the cached subclass of MechanismState for frames of these names.

    Args:
        frames: names of the frames that are computed.
        robot_frames: names of all frames of the robot.
        further: outputs that are no motion of frames, which are attributes as well.
    """
    names = {"frames": frames, "_robot_frames": robot_frames, "_further": further}
    slots = {**MechanismState.__slots__, **attribute_texts(further)}
    return type("MechanismState", (MechanismState,), {"__slots__": slots, "__module__": __name__, **names})


def _rebuild_state(
    frames: tuple[str, ...], robot_frames: tuple[str, ...], further: tuple[str, ...], *content: Any
) -> MechanismState:
    """Return a MechanismState from its pickled contents."""
    return mechanism_state_class(frames, robot_frames, further)(*content)


class JointResults(Results):
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

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), "names"]

    def __reduce__(self) -> tuple[Any, ...]:
        return _rebuild_joint_results, (type(self).__base__, self.names, self.arrays(), self.shape)


@functools.lru_cache(maxsize=256)
def joint_results_class(kind: type[JointResults], names: tuple[str, ...]) -> type[JointResults]:
    """Return the cached subclass of a class of joint results, `kind`, for joints of these names."""
    content = {"__slots__": kind.__slots__, "__module__": __name__, "__doc__": kind.__doc__, "names": names}
    return type(kind.__name__, (kind,), content)


def _rebuild_joint_results(
    kind: type[JointResults], names: tuple[str, ...], arrays: Mapping[str, Any], shape: tuple[int, ...]
) -> JointResults:
    """Return joint results from their pickled contents."""
    return joint_results_class(kind, names)(arrays, shape)  # type: ignore[arg-type]


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
        if name not in self.names:
            raise ArgumentError("joint", choices(self.names) + nearest(str(name), self.names), quoted(name))
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
    base (..., 6 + dof, 6 + dof), the base first. Those that were not computed are None. Only hingepair calls the
    constructor.
    """

    __slots__ = {  # noqa: RUF023 (the order of the documentation)
        "tau_q": "Derivatives of tau by q; (..., dof, dof).",
        "tau_qd": "Derivatives of tau by qd; (..., dof, dof).",
        "tau_qdd": "Derivatives of tau by qdd, which are the mass matrix; (..., dof, dof).",
        "qdd_q": "Derivatives of qdd by q; (..., dof, dof).",
        "qdd_qd": "Derivatives of qdd by qd; (..., dof, dof).",
        "qdd_tau": "Derivatives of qdd by tau, which are the inverse of the mass matrix; (..., dof, dof).",
    }

    tau_q: FloatArray
    tau_qd: FloatArray
    tau_qdd: FloatArray
    qdd_q: FloatArray
    qdd_qd: FloatArray
    qdd_tau: FloatArray
