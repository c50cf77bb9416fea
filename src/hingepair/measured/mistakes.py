"""Mistakes that hide a hinge in recorded poses: units, axes, transposes, orders of quaternions."""

from __future__ import annotations

import functools
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


def probable_mistakes(body_poses: BodyPoses) -> list[str]:
    """Return a sentence on a mistake in recorded poses (units, axes, transposes, quaternions), if a hinge fits far
    better with the mistake corrected.
    """
    every = slice(None, None, -(-body_poses.R1.shape[0] // _SAMPLES))
    poses = BodyPoses(*(array[every].astype(np.float64) for array in body_poses))
    misfit = poses.misfit()
    corrected_misfits = [(changed.misfit(), text) for text, changed in _corrected_poses(poses)]
    least_misfit = min(each for each, _ in corrected_misfits)
    text = next(text for each, text in corrected_misfits if each < 1.01 * least_misfit + 1e-12)
    if least_misfit > min(0.2 * misfit, 0.1):
        return []
    return [f"{text}: with that taken back, a hinge fits {misfit / max(least_misfit, 1e-12):.2g} times as well."]


def _corrected_poses(poses: BodyPoses) -> Iterator[tuple[str, BodyPoses]]:
    """Yield each common mistake, in words, and the poses with the mistake corrected."""
    for digit in "21":
        name = f"body{digit}"
        for unit, factor in (("millimetres", 1e-3), ("centimetres", 1e-2)):
            yield f"{name}.R looks like {unit}", poses.changed(digit, "R", functools.partial(np.multiply, factor))
        for pair, order in (("y and z", [0, 2, 1]), ("x and y", [1, 0, 2]), ("x and z", [2, 1, 0])):
            swap = functools.partial(np.take, indices=order, axis=1)
            yield f"{name}.R looks as if {pair} were exchanged", poses.changed(digit, "R", swap)
        for up, other, sign in (("y", "z", 1.0), ("z", "y", -1.0)):
            turn = np.array(((1.0, 0, 0), (0, 0, -sign), (0, sign, 0)))
            turned = poses.changed(digit, "S", functools.partial(np.matmul, turn))
            yield (
                f"{name} looks as if {up} were up in its world and {other} in that of the other body",
                turned.changed(digit, "R", functools.partial(np.einsum, "ij,nj->ni", turn)),
            )
    for bodies in ("1", "2", "12"):
        names, look = " and ".join(f"body{digit}.S" for digit in bodies), "looks" if len(bodies) == 1 else "look"
        turned = poses.changed(bodies, "S", lambda S: np.swapaxes(S, -1, -2))
        yield f"{names} {look} like rotations from world to body, the transposes", turned
        for written, read in (("wxyz", "xyzw"), ("xyzw", "wxyz")):
            yield (
                f"{names} {look} like quaternions {written} that were read as {read}",
                poses.changed(
                    bodies, "S", functools.partial(_with_reordered_quaternions, scalar_first=written == "wxyz")
                ),
            )


def _with_reordered_quaternions(S: Float64Array, scalar_first: bool) -> Float64Array:
    """Return the rotations meant by quaternions that were written with `scalar_first` and read the other way."""
    read = matrix_to_quaternion(S)  # w, x, y, z
    written = np.roll(read, -1, axis=-1) if scalar_first else read
    return np.asarray(quaternion_to_matrix("quat", written, scalar_first=scalar_first), dtype=np.float64)
