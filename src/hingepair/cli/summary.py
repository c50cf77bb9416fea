"""The summary of a scene's run: three instants, the range of each component, the largest residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.tables import instant_text, number_texts
from hingepair.pair.accuracy import error_ratios, output_scales
from hingepair.pair.constants import with_hinge_frames
from hingepair.pair.evaluate import compute_arrays
from hingepair.pair.results import column_names
from hingepair.scenes.motions.known import KnownMotion
from hingepair.scenes.robot_scene import FRAME_QUANTITIES, MechanismScene, MechanismSceneResult
from hingepair.scenes.scene import Scene, SceneResult

# Label, expression and unit of each residual.
_RESIDUALS = (
    ("E1", "R1 + S1 u1 - (R2 + S2 u2)", "m"),
    ("E2", "omega2 - omega1 - S2 C^T n psi'", "rad/s"),
)


class LargestResidual(NamedTuple):
    """Largest residual of a constraint over all instants."""

    label: str
    meaning: str
    unit: str
    largest: float
    ratio: float


class RunSummary:
    """Summary of a scene's run.

    Attributes:
        lost: number of instants with a value that is not finite.
    """

    def __init__(self, scene: Scene | MechanismScene) -> None:
        self._scene = scene
        self._notes: Any = scene.note_collector()
        self._instants = sorted({0, (scene.samples - 1) // 2, scene.samples - 1})
        self._t: list[float] = []  # times of these instants, and the components at them
        self._values_at_instants: list[NDArray[np.float64]] = []
        self._names: list[str] = []
        self._smallest = self._largest = np.array(np.nan)
        self._coincident: dict[str, str] | None = None
        self._residual_meanings = _RESIDUALS[: scene.motion.level + 1] if isinstance(scene, Scene) else ()
        self._largest_residuals = np.full((len(self._residual_meanings), 2), np.nan)
        self.lost = 0

    def add(self, part: SceneResult | MechanismSceneResult) -> None:
        """Take one block of the results into the summary. Update the number of instants with a value that is not
        finite (`lost`), the components at the first, middle and last instant, their smallest and largest values, the
        residuals of a pair, and the notes. The blocks must come in order of time.
        """
        arrays = part.requested_arrays()
        self._names = column_names(arrays)
        if isinstance(self._scene, MechanismScene):
            coincident = _coincident_frames(arrays, self._scene.frames)
            earlier = coincident if self._coincident is None else self._coincident
            self._coincident = dict(coincident.items() & earlier.items())
        values = np.concatenate([array.reshape(len(part.t), -1) for array in arrays.values()], axis=1, dtype=float)
        for at in (i - part.first for i in self._instants):
            if 0 <= at < len(part.t):
                self._t.append(float(part.t[at]))
                self._values_at_instants.append(values[at].copy())
        lost = ~np.isfinite(values)
        self.lost += int(lost.any(axis=1).sum())
        values[lost] = np.nan
        self._smallest = np.fmin(self._smallest, np.fmin.reduce(values))
        self._largest = np.fmax(self._largest, np.fmax.reduce(values))
        if isinstance(self._scene, Scene) and isinstance(part, SceneResult):
            self._largest_residuals = np.fmax(self._largest_residuals, _largest_residuals(self._scene, part.known))
        self._notes.add(part)

    def residuals(self) -> tuple[LargestResidual, ...]:
        """Return a tuple of LargestResiduals over all instants: one for equation E1 (position) and, if the motion has
        rates, one for E2 (angular velocity). Return an empty tuple for a mechanism.
        """
        return tuple(
            LargestResidual(*meaning, *worst)
            for meaning, worst in zip(self._residual_meanings, self._largest_residuals.tolist(), strict=True)
        )

    def notes(self) -> tuple[str, ...]:
        """Return the notes on the run, a tuple of sentences."""
        sentences: tuple[str, ...] = self._notes.sentences()
        return sentences

    @property
    def coincident_frames(self) -> dict[str, str]:
        """Dict of names of frames: it maps each frame of a mechanism that has moved exactly as an earlier frame in
        all blocks to this earlier frame. It is empty for a pair.
        """
        return self._coincident or {}

    def table(self) -> list[tuple[str, ...]]:
        """Return the rows of a table as tuples of strings, headings first: for each component its unit, its values at
        the first, middle and last instant, and its smallest and largest value. Leave out the `coincident_frames`.
        """
        numbers = np.stack([*self._values_at_instants, self._smallest, self._largest], axis=1).tolist()
        heading = ("", "unit", *(f"t = {instant_text(t)}" for t in self._t), "smallest", "largest")
        texts = number_texts(self._names, numbers)
        rows = [(name, self._scene.unit(name), *row) for name, row in zip(self._names, texts, strict=True)]
        hidden = {f"{quantity}_{frame}" for frame in self.coincident_frames for quantity in FRAME_QUANTITIES}
        return [heading, *(row for row in rows if row[0].rpartition("_")[0] not in hidden)]

    def ranges(self) -> dict[str, dict[str, float]]:
        """Return a dict from the name of each component to a dict of floats with the keys first, last, smallest and
        largest.
        """
        columns = {
            "first": self._values_at_instants[0],
            "last": self._values_at_instants[-1],
            "smallest": self._smallest,
            "largest": self._largest,
        }
        return {
            name: {key: float(values[i]) for key, values in columns.items()} for i, name in enumerate(self._names)
        }


def _coincident_frames(arrays: Mapping[str, NDArray[Any]], frames: Sequence[str]) -> dict[str, str]:
    """Return a dict of names of frames that maps each frame that moves exactly as an earlier one of `frames` to this
    earlier frame.
    """
    motions: dict[str, dict[str, NDArray[Any]]] = {}
    coincident = {}
    for frame in frames:
        names = {quantity: f"{quantity}_{frame}" for quantity in FRAME_QUANTITIES}
        motion = {quantity: arrays[name] for quantity, name in names.items() if name in arrays}
        for earlier, other in motions.items():
            if motion.keys() == other.keys() and all(
                np.array_equal(motion[name], other[name], equal_nan=True) for name in motion
            ):
                coincident[frame] = earlier
                break
        else:
            if motion:
                motions[frame] = motion
    return coincident


def _largest_residuals(scene: Scene, known_motion: KnownMotion) -> NDArray[np.float64]:
    """Return the largest residuals of the equation E1 (position) and, if the KnownMotion has rates, of E2 (angular
    velocity), as an array with a row for each.
    """
    pair, a = scene.space, known_motion.body_arrays(scene.pair)
    W1, psid = a.pop("W1", None), a.pop("psid", None)
    scales = output_scales(u1=pair.u1, u2=pair.u2, R1=a["R1"], W1=W1, psid=psid)
    names, rate = (("gap",), {}) if psid is None else (("gap", "slip"), {"psid_given": psid})
    constants = with_hinge_frames(pair.constants)
    measured = compute_arrays(constants, names, {**a, **rate}, {"R1": a["R1"].shape[:-1]})
    largest_residuals = []
    for name, residual in zip(("R2", "omega2"), measured.values(), strict=False):
        error, ratio = error_ratios(name, residual, np.zeros_like(residual), scales[name])
        largest_residuals.append([_largest_finite(error), _largest_finite(ratio)])
    return np.array(largest_residuals)


def _largest_finite(values: NDArray[Any]) -> float:
    """Return the largest finite value of an array as a float; NaN if there is none."""
    return float(np.fmax.reduce(np.where(np.isfinite(values), values, np.nan), axis=None, initial=np.nan))
