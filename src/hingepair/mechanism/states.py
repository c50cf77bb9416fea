"""What a robot's methods give back: the motion of frames, what must act, and how a robot moves."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, ClassVar

from hingepair.engine.results import Results
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.numeric.arrays import FloatArray

_MOTION = {
    "R": "Origin; (..., 3) m.",
    "S": "Rotation, frame to world; (..., 3, 3).",
    "d": "Origin from the base's reference point, unharmed by a large base position; (..., 3) m.",
    "v": "Velocity of the origin; (..., 3) m/s.",
    "omega": "Angular velocity; (..., 3) rad/s.",
    "a": "Classical acceleration of the origin; (..., 3) m/s^2.",
    "alpha": "Angular acceleration; (..., 3) rad/s^2.",
}


class FrameState(Results):
    """The motion of one frame at every sample; world axes, SI units. What was not computed is None."""

    __slots__ = _MOTION

    R: FloatArray
    S: FloatArray
    d: FloatArray
    v: FloatArray
    omega: FloatArray
    a: FloatArray
    alpha: FloatArray


class MechanismState(Results):
    """The motion of some frames of a robot at every sample; world axes, SI units.

    Each array has an axis of frames behind the samples; `state["hand"]` is the motion of one frame, without that
    axis. What was not computed is None.

    Attributes:
        frames: names of the frames, in the order of the axis.
    """

    __slots__ = {name: text.replace("(...,", "(..., frames,") for name, text in _MOTION.items()}

    frames: ClassVar[tuple[str, ...]] = ()
    _robot_frames: ClassVar[tuple[str, ...]] = ()
    """Names of all frames of the robot, computed or not."""

    R: FloatArray
    S: FloatArray
    d: FloatArray
    v: FloatArray
    omega: FloatArray
    a: FloatArray
    alpha: FloatArray

    def __getitem__(self, name: str) -> Any:
        """Return the motion of a frame by its name, or an output by its own.

        Raises:
            ArgumentError: the frame is not among those that were computed.
        """
        if name in self.outputs:
            return super().__getitem__(name)
        if name not in self.frames:
            expected = choices(self.frames)
            if name in self._robot_frames:
                expected += f", since {name!r} was not computed: ask for it with frames=({name!r},)"
            else:
                expected += nearest(str(name), self._robot_frames)
            raise ArgumentError("frame", expected, quoted(name))
        place, axis = self.frames.index(name), len(self.shape)
        moving = {output: array for output, array in self.arrays().items() if output in _MOTION}
        arrays = {output: array[(slice(None),) * axis + (place,)] for output, array in moving.items()}
        return FrameState(arrays, self.shape)

    def __reduce__(self) -> tuple[Any, ...]:
        return _state_again, (self.frames, self._robot_frames, self.arrays(), self.shape)


@functools.lru_cache(maxsize=256)
def state_of(frames: tuple[str, ...], robot_frames: tuple[str, ...]) -> type[MechanismState]:
    """Return the class of the motions of some frames out of all that the robot has."""
    names = {"frames": frames, "_robot_frames": robot_frames}
    content = {"__slots__": MechanismState.__slots__, "__module__": __name__, **names}
    return type("MechanismState", (MechanismState,), content)


def _state_again(
    frames: tuple[str, ...], robot_frames: tuple[str, ...], arrays: Mapping[str, Any], shape: tuple[int, ...]
) -> MechanismState:
    return state_of(frames, robot_frames)(arrays, shape)


class MechanismForces(Results):
    """What must act for a robot to move as it does."""

    __slots__ = {  # noqa: RUF023 (the order of the documentation)
        "tau": "Along every coordinate: N m of hinges, N of sliders; (..., dof).",
        "force1": "On the base at R1, world axes; of a fixed base its reaction; (..., 3) N.",
        "torque1": "On the base about R1, world axes; (..., 3) N m.",
    }

    tau: FloatArray
    force1: FloatArray
    torque1: FloatArray


class MechanismAccelerations(Results):
    """How a robot moves under what acts."""

    __slots__ = {  # noqa: RUF023 (the order of the documentation)
        "qdd": "Second derivatives of the coordinates; (..., dof) rad/s^2, of sliders m/s^2.",
        "a1": "Of a free base: acceleration of its reference point, world axes, classical; (..., 3) m/s^2.",
        "alpha1": "Of a free base: angular acceleration, world axes; (..., 3) rad/s^2.",
    }

    qdd: FloatArray
    a1: FloatArray
    alpha1: FloatArray
