"""The summary of a scene's run: three instants, the range of each component, the largest residuals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.tables import instant_text, number_texts
from hingepair.pair.results import column_names
from hingepair.scenes.scene import Scene, SceneResult


class LargestResidual(NamedTuple):
    """Largest residual of a constraint over all instants, and its ratio to u * scale."""

    label: str
    meaning: str
    unit: str
    largest: float
    ratio: float


class RunSummary:
    """Summary of a scene's run, from results block by block in order of time.

    Attributes:
        lost: number of instants with a value that is not finite.
        coincident_frames: frames of a robot that move exactly as an earlier one in all blocks, and these.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._notes = scene.note_collector()
        self._instants = sorted({0, (scene.samples - 1) // 2, scene.samples - 1})
        self._t: list[float] = []  # times of these instants, and the components at them
        self._values: list[NDArray[np.float64]] = []
        self._names: list[str] = []
        self._smallest = self._largest = np.array(np.nan)
        self._residuals = np.full((len(scene.residuals), 2), np.nan)
        self.coincident_frames: dict[str, str] = {}
        self.lost = 0

    def add(self, part: SceneResult) -> None:
        """Take one block of the results into the summary."""
        arrays = part.requested_arrays()
        coincident = part.coincident_frames()
        together = coincident.items() if part.first == 0 else coincident.items() & self.coincident_frames.items()
        self.coincident_frames = dict(together)
        self._names = column_names(arrays)
        values = np.concatenate([array.reshape(len(part.t), -1) for array in arrays.values()], axis=1, dtype=float)
        for at in (i - part.first for i in self._instants):
            if 0 <= at < len(part.t):
                self._t.append(float(part.t[at]))
                self._values.append(values[at].copy())
        lost = ~np.isfinite(values)
        self.lost += int(lost.any(axis=1).sum())
        values[lost] = np.nan
        self._smallest = np.fmin(self._smallest, np.fmin.reduce(values))
        self._largest = np.fmax(self._largest, np.fmax.reduce(values))
        self._residuals = np.fmax(self._residuals, part.residual_sizes())
        self._notes.add(part)

    def residuals(self) -> tuple[LargestResidual, ...]:
        """Return the largest residuals of the scene's constraints."""
        both = zip(self._scene.residuals, self._residuals.tolist(), strict=True)
        return tuple(LargestResidual(*residual, *worst) for residual, worst in both)

    def notes(self) -> tuple[str, ...]:
        """Return the notes on the run."""
        return self._notes.sentences()

    def table(self) -> list[tuple[str, ...]]:
        """Return the rows of a table, headings first: of each component its unit, its values at the first, middle and
        last instant, and its range. The `coincident_frames` are left out.
        """
        numbers = np.stack([*self._values, self._smallest, self._largest], axis=1).tolist()
        heading = ("", "unit", *(f"t = {instant_text(t)}" for t in self._t), "smallest", "largest")
        texts = number_texts(self._names, numbers)
        rows = [(name, self._scene.unit(name), *row) for name, row in zip(self._names, texts, strict=True)]
        hidden = tuple(f"_{frame}" for frame in self.coincident_frames)
        return [heading, *(row for row in rows if not row[0].rpartition("_")[0].endswith(hidden))]

    def ranges(self) -> dict[str, dict[str, float]]:
        """Return the first, last, smallest and largest value of each component by its name."""
        columns = {"first": self._values[0], "last": self._values[-1]}
        columns |= {"smallest": self._smallest, "largest": self._largest}
        return {
            name: {key: float(values[i]) for key, values in columns.items()} for i, name in enumerate(self._names)
        }
