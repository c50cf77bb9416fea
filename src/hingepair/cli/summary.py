"""The summary of a scene's run: three instants, the range of each component."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hingepair.scenes.scene import NoteCollector, Scene, SceneResult
from hingepair.tables.data_frames import column_names, plain_magnitudes, split_columns, with_magnitudes
from hingepair.tables.sheets import instant_text, number_texts, offset_text, round_offset
from hingepair.tables.units import UnitsLike

_UNITS_OF_POSES: Final = frozenset({"m", "rad", "1"})  # of what is known without rates


class RunSummary:
    """Summary of a scene's run, from results block by block in order of time.

    Args:
        scene: the scene.
        names: the requested outputs; None for those of the scene.
        units: units of the numbers; None for those of the scene.

    Attributes:
        lost: number of instants with a value that is not finite.
        coincident_frames: by frame of a robot, the earlier one that moves exactly as it in all blocks.
    """

    def __init__(self, scene: Scene, names: Iterable[str] | None = None, units: UnitsLike = None) -> None:
        self._scene, self._columns = scene, scene.in_units(units)
        self._hides_matrices = names is None and scene.outputs is None
        self._notes = NoteCollector(scene, units)
        self._instants = sorted({0, (scene.samples - 1) // 2, scene.samples - 1})
        self._t: list[float] = []  # times of these instants, and the components at them
        self._values: list[NDArray[np.float64]] = []
        self._components: dict[str, list[str]] = {}  # by array
        self._matrices: list[str] = []
        self._smallest = self._largest = np.array(np.nan)
        self.coincident_frames: dict[str, str] = {}
        self.lost = 0

    def add(self, part: SceneResult) -> None:
        """Take one block of the results into the summary."""
        arrays = part.requested_arrays()
        coincident = part.coincident_frames()
        together = coincident.items() if part.first == 0 else coincident.items() & self.coincident_frames.items()
        self.coincident_frames = dict(together)
        self._matrices = [name for name, array in arrays.items() if array.ndim == 3]
        arrays = with_magnitudes(arrays, self._scene.unit)
        self._components = {}
        for name, array in arrays.items():
            self._components.setdefault(name.strip("|"), []).extend(column_names({name: array}))
        values = np.column_stack(split_columns(arrays)).astype(float, copy=False)
        for at in (i - part.first for i in self._instants):
            if 0 <= at < len(part.t):
                self._t.append(float(part.t[at]))
                self._values.append(values[at].copy())
        sure = self._scene.motion.sure
        lost = ~np.isfinite(values)
        self.lost += int(lost.any(axis=1).sum())
        values[lost] = np.nan
        if sure is not None:  # rates that smoothing finds at ends are no extremes
            own = [len(names) for names in self._components.values()]
            is_rate = np.repeat([self._scene.unit(name) not in _UNITS_OF_POSES for name in self._components], own)
            values[np.ix_(~sure[part.first : part.first + len(values)], is_rate)] = np.nan
        self._smallest = np.fmin(self._smallest, np.fmin.reduce(values))
        self._largest = np.fmax(self._largest, np.fmax.reduce(values))
        self._notes.add(part)

    def notes(self) -> tuple[str, ...]:
        """Return the notes on the run."""
        return self._notes.sentences()

    def table(self) -> list[tuple[str, ...]]:
        """Return the rows of a table, headings first: of each component its unit, its values at the first, middle and
        last instant, and its range; then the magnitude of a vector with several components that are not zero. The
        `coincident_frames` and what `omissions` names are left out.

        Of numbers that are large against their variation, an offset is subtracted, which stands behind the name.
        """
        rows = self._rows()
        hidden = {own for name in self._hidden_arrays() for own in self._components[name]} | {*self._zeros(rows)}
        hidden |= plain_magnitudes(rows, [own for own, (_, _, *texts) in rows.items() if {*texts} == {"0"}])
        return [self._heading(), *((name, *row) for own, (name, *row) in rows.items() if own not in hidden)]

    def omissions(self) -> list[str]:
        """Return sentences on what the table leaves out, but for the `coincident_frames`."""
        sentences = []
        if self._hides_matrices and self._matrices:
            output = self._matrices[0] if len(self._matrices) == 1 else "S"
            be, them = ("is", "it") if len(self._matrices) == 1 else ("are", "them")
            sentences.append(f"{', '.join(self._matrices)} {be} not shown (--outputs {output} shows {them})")
        if zeros := self._zeros(self._rows()):
            whole = {name: own for name, own in self._components.items() if len(own) > 1 and {*own} <= {*zeros}}
            part_of = {component: name for name, own in whole.items() for component in own}
            names = dict.fromkeys(part_of.get(name, name) for name in zeros)
            sentences.append(f"zero at all instants and not shown: {', '.join(names)}")
        return sentences

    def _heading(self) -> tuple[str, ...]:
        """Return the headings of the table, the instants in units; an offset of theirs stands in the first cell."""
        units = self._columns.units
        offset, name = units.offset_of_instants(self._scene.start, self._scene.stop)
        texts = [instant_text(units.factor("s") * t - offset) for t in self._t]
        if name:
            return (f"{name} =", "unit", *texts, "smallest", "largest")
        unit = "" if units.unit("s") == "s" else f" {units.unit('s')}"
        return ("", "unit", *(f"t = {text}{unit}" for text in texts), "smallest", "largest")

    def _rows(self) -> dict[str, list[str]]:
        """Return the cells of each component: name, unit, numbers."""
        rows = {}
        numbers = np.stack([*self._values, self._smallest, self._largest], axis=1)
        start = 0
        for array, names in self._components.items():
            part = self._columns.converted(array, numbers[start : start + len(names)])
            start += len(names)
            variation = float(np.fmax.reduce(part[:, -1] - part[:, -2], initial=0.0))
            offsets = np.array([round_offset(low, high, variation) for low, high in part[:, -2:].tolist()])[:, None]
            with np.errstate(invalid="ignore"):
                shifted = part - offsets
                shifted[np.abs(shifted) < 64 * np.finfo(float).eps * np.abs(offsets)] = 0.0
            shown = [offset_text(name, offset) for name, offset in zip(names, offsets.ravel().tolist(), strict=True)]
            for name, title, texts in zip(names, shown, number_texts(names, shifted.tolist()), strict=True):
                rows[name] = [title, self._columns.unit(array), *texts]
        return rows

    def _hidden_arrays(self) -> list[str]:
        """Return the arrays that the table leaves out: matrices, if not asked for, and those of coincident frames."""
        coincident = tuple(f"_{frame}" for frame in self.coincident_frames)
        matrices = self._matrices if self._hides_matrices else []
        return [*matrices, *(name for name in self._components if name.endswith(coincident))]

    def _zeros(self, rows: Mapping[str, Sequence[str]]) -> list[str]:
        """Return the components that are zero at all instants and not hidden otherwise; none if all are."""
        hidden = {own for name in self._hidden_arrays() for own in self._components[name]}
        shown = {name: texts for name, (_, _, *texts) in rows.items() if name not in hidden}
        zeros = [name for name, texts in shown.items() if {*texts} == {"0"}]
        return zeros if len(zeros) < len(shown) else []

    def ranges(self) -> dict[str, dict[str, float]]:
        """Return the first, last, smallest and largest value of each component by its heading."""
        values = {"first": self._values[0], "last": self._values[-1]}
        values |= {"smallest": self._smallest, "largest": self._largest}
        names = [own for components in self._components.values() for own in components]
        return {
            self._columns.heading(name): {
                key: float(self._columns.converted(name, own[i])) for key, own in values.items()
            }
            for i, name in enumerate(names)
            if not name.startswith("|")
        }
