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
_ERRORS |= {
    "centre_of_mass_error": "Distance of the centre of mass from its target; None without one; (...,) m.",
    "base_R": "Position of a base that was solved for; None of one that is held; (..., 3) m.",
    "base_S": "Attitude of a base that was solved for; None of one that is held; (..., 3, 3).",
}
_STEPS = "Number of steps that were taken; (...,)."


class _Solutions(Results):
    """Coordinates, and how far they are from their targets."""

    __slots__ = ()

    q: FloatArray
    ok: NDArray[np.bool_]
    position_error: FloatArray | None
    angle_error: FloatArray | None
    centre_of_mass_error: FloatArray | None
    base_R: FloatArray | None  # noqa: N815
    base_S: FloatArray | None  # noqa: N815
    steps: NDArray[np.int64]

    def __repr__(self) -> str:
        verdict = str(bool(self.ok)) if np.ndim(self.ok) == 0 else f"{int(np.sum(self.ok))} of {np.size(self.ok)}"
        return f"{super().__repr__()[:-1]}, ok={verdict})"


class InverseKinematics(_Solutions):
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

    starts: NDArray[np.int64]


class InverseKinematicsPath(_Solutions):
    """Coordinates along a path of targets, sample after sample. Only hingepair calls the constructor."""

    __slots__ = {
        "q": _COORDINATES,
        **_ERRORS,
        "jumps": "Whether a coordinate changes by more than `max_change` from the sample before; (...,).",
        "steps": _STEPS,
    }

    jumps: NDArray[np.bool_]
