"""Mistakes that hide a hinge in recorded poses: units, axes, transposes, orders of quaternions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.measured.hinge_model import constraints
from hingepair.measured.relative_poses import closed_form_hinge, compute_relative_poses
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import matrix_to_quaternion, quaternion_to_matrix

_SAMPLES = 400  # on which mistakes are tried, at most


class BodyPoses(NamedTuple):
    """Poses of both bodies at all samples, as the user gave them."""

    R1: NDArray[np.floating]  # shape (N, 3)
    S1: NDArray[np.floating]  # shape (N, 3, 3)
    R2: NDArray[np.floating]
    S2: NDArray[np.floating]

    def changed(self, bodies: str, letter: str, change: Callable[..., Any]) -> BodyPoses:
        """Return the poses with the array R or S (`letter`) of the bodies "1", "2" or "12" changed."""
        return self._replace(**{f"{letter}{digit}": change(getattr(self, f"{letter}{digit}")) for digit in bodies})

    def misfit(self) -> float:
        """Return how badly the closed-form hinge fits: the median tilt [rad] plus the median gap in parts of the
        distance between the bodies.
        """
        poses = compute_relative_poses(*self)
        distance = float(np.sqrt((poses.p**2).sum() / poses.samples))
        seen = constraints(closed_form_hinge(poses), poses)
        tilt, gap = (np.sqrt(np.median((part**2).sum(axis=0))) for part in (seen.tilt, seen.gap))
        return float(tilt + gap / max(distance, 1e-300))


def _reread(S: Float64Array, scalar_first: bool) -> Float64Array:
    """Return the rotations meant by quaternions that were written with `scalar_first` and read the other way."""
    read = matrix_to_quaternion(S)  # w, x, y, z
    written = np.roll(read, -1, axis=-1) if scalar_first else read
    return np.asarray(quaternion_to_matrix("quat", written, scalar_first=scalar_first), dtype=np.float64)


_Y_UP = np.array(((1.0, 0, 0), (0, 0, -1), (0, 1, 0)))
# Common mistakes in R and in S, and what takes them back.
_OF_PLACES: dict[str, Callable[[Float64Array], Float64Array]] = {
    "looks like millimetres": lambda R: 1e-3 * R,
    "looks like centimetres": lambda R: 1e-2 * R,
    "looks as if y and z were exchanged": lambda R: R[:, [0, 2, 1]],
    "looks as if x and y were exchanged": lambda R: R[:, [1, 0, 2]],
    "looks as if x and z were exchanged": lambda R: R[:, [2, 1, 0]],
}
_OF_ATTITUDES: dict[str, Callable[[Float64Array], Float64Array]] = {
    "like rotations from world to body, the transposes": lambda S: np.swapaxes(S, -1, -2),
    "like quaternions wxyz that were read as xyzw": lambda S: _reread(S, True),
    "like quaternions xyzw that were read as wxyz": lambda S: _reread(S, False),
}


def probable_mistakes(body_poses: BodyPoses) -> list[str]:
    """Return a sentence on a mistake in recorded poses (units, axes, transposes, quaternions), if a hinge fits far
    better with the mistake corrected.
    """
    every = slice(None, None, -(-body_poses.R1.shape[0] // _SAMPLES))
    poses = BodyPoses(*(array[every].astype(np.float64) for array in body_poses))
    misfit, corrected = poses.misfit(), [(changed.misfit(), text) for text, changed in _corrected_poses(poses)]
    least = min(each for each, _ in corrected)
    text = next(text for each, text in corrected if each < 1.01 * least + 1e-12)
    if least > min(0.2 * misfit, 0.1):
        return []
    return [f"{text}: with that taken back, a hinge fits {misfit / max(least, 1e-12):.2g} times as well."]


def _corrected_poses(poses: BodyPoses) -> Iterator[tuple[str, BodyPoses]]:
    """Yield each common mistake, in words, and the poses with the mistake corrected."""
    for digit in "21":
        for text, change in _OF_PLACES.items():
            yield f"body{digit}.R {text}", poses.changed(digit, "R", change)
        for up, other, turn in (("y", "z", _Y_UP), ("z", "y", _Y_UP.T)):
            turned = poses.changed(digit, "S", turn.__matmul__).changed(digit, "R", lambda R, turn=turn: R @ turn.T)
            yield f"body{digit} looks as if {up} were up in its world and {other} in that of the other body", turned
    for bodies, name in (("1", "body1.S looks"), ("2", "body2.S looks"), ("12", "body1.S and body2.S look")):
        for text, change in _OF_ATTITUDES.items():
            yield f"{name} {text}", poses.changed(bodies, "S", change)
