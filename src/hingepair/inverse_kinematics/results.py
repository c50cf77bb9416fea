"""Results of inverse kinematics."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.results import Results
from hingepair.numeric.arrays import FloatArray

_COORDINATES = "Coordinates in the order of `names`; NaN where the target is not finite; (..., dof) rad or m."
_ERRORS = {  # texts of attributes
    "ok": "Whether all errors are within the tolerances; (...,).",
    "position_error": "Distance of the frame's origin from its target; None without targets of position; (...,) m. "
    "With targets by frame (..., frames), and 0 where no position is wanted.",
    "angle_error": "Angle between the frame's attitude, or axis, and the wanted one; None without such targets; "
    "(...,) rad. With targets by frame (..., frames), and 0 where none is wanted.",
}
_STEPS = "Number of steps that were taken; (...,)."


def _with_verdict(text: str, ok: NDArray[np.bool_]) -> str:
    """Return the text of a result with how many targets are reached."""
    verdict = str(bool(ok)) if np.ndim(ok) == 0 else f"{int(np.sum(ok))} of {np.size(ok)}"
    return f"{text[:-1]}, ok={verdict})"


class InverseKinematics(Results):
    """Coordinates at which frames of a robot have the wanted poses, or come as close as was found. Only hingepair
    calls the constructor.

    With `solutions=k`, the first three have an axis of k before the last of q: distinct solutions, the nearest first,
    and NaN where no more were found.
    """

    __slots__ = {
        "q": _COORDINATES,
        **_ERRORS,
        "steps": _STEPS,
        "starts": "Number of starts that were tried; (...,).",
    }

    q: FloatArray
    ok: NDArray[np.bool_]
    position_error: FloatArray | None
    angle_error: FloatArray | None
    steps: NDArray[np.int64]
    starts: NDArray[np.int64]

    def __repr__(self) -> str:
        return _with_verdict(super().__repr__(), self.ok)


class InverseKinematicsPath(Results):
    """Coordinates along a path of targets, sample after sample. Only hingepair calls the constructor."""

    __slots__ = {
        "q": _COORDINATES,
        **_ERRORS,
        "jumps": "Whether a coordinate changes by more than `max_change` from the sample before; (...,).",
        "steps": _STEPS,
    }

    q: FloatArray
    ok: NDArray[np.bool_]
    position_error: FloatArray | None
    angle_error: FloatArray | None
    jumps: NDArray[np.bool_]
    steps: NDArray[np.int64]

    def __repr__(self) -> str:
        return _with_verdict(super().__repr__(), self.ok)
