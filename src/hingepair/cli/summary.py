"""The summary of a scene's run: three instants, the range of each component."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from hingepair.scenes.scene import Scene, SceneResult
from hingepair.tables.data_frames import column_names, plain_magnitudes, split_columns, with_magnitudes
from hingepair.tables.sheets import instant_text, number_texts, offset_text, round_offset
from hingepair.tables.units import UnitsLike

_UNITS_OF_POSES = {"m", "rad", "1"}  # of what is known without rates


class RunSummary:
    """Summary of a scene's run, from results block by block in order of time.

    Args:
        scene: the scene.
        names: the requested outputs; None for those of the scene.
        units: units of the numbers; None for those of the scene.

    Attributes:
        lost: number of instants with a value that is not finite.
    """

    def __init__(self, scene: Scene, names: Iterable[str] | None = None, units: UnitsLike = None) -> None:
        self._scene, self._columns = scene, scene.in_units(units)
        self._hides_matrices = names is None and scene.outputs is None
        self._instants = {0, (scene.samples - 1) // 2, scene.samples - 1}
        self._t: list[float] = []  # times of these instants, and the components at them
        self._values: list[NDArray[np.float64]] = []
        self._components: dict[str, list[str]] = {}  # by array
        self._matrices: list[str] = []
        self._smallest = self._largest = np.array(np.nan)
        self.lost = 0

    def add(self, part: SceneResult) -> None:
        """Take one block of the results into the summary."""
        arrays = part.requested_arrays()
        self._matrices = [name for name, array in arrays.items() if array.ndim == 3]
        arrays = with_magnitudes(arrays, self._scene.unit)
        self._components = {}
        for name, array in arrays.items():
            self._components.setdefault(name.strip("|"), []).extend(column_names({name: array}))
        values = np.column_stack(split_columns(arrays)).astype(float, copy=False)
        for at in sorted(i - part.first for i in self._instants):
            if 0 <= at < len(part.t):
                self._t.append(float(part.t[at]))
                self._values.append(values[at].copy())
        lost = ~np.isfinite(values)
        self.lost += int(lost.any(axis=1).sum())
        values[lost] = np.nan
        if (sure := self._scene.motion.sure) is not None:  # rates that smoothing finds at ends are no extremes
            own = self._components.items()
            rate = [self._scene.unit(name) not in _UNITS_OF_POSES for name, names in own for _ in names]
            values[np.outer(~sure[part.first : part.first + len(values)], rate)] = np.nan
        self._smallest = np.fmin(self._smallest, np.fmin.reduce(values))
        self._largest = np.fmax(self._largest, np.fmax.reduce(values))

    def table(self) -> tuple[list[tuple[str, ...]], list[str]]:
        """Return the rows of a table, headings first, and sentences on what it leaves out.

        A row has a component, its unit, its values at the first, middle and last instant, and its range; so has the
        magnitude of a vector with several components that are not zero. Of numbers that are large against their
        variation, an offset is subtracted, which stands behind the name.
        """
        matrices = self._matrices if self._hides_matrices else []
        shown = [name for name in self._components if name not in matrices]
        rows = self._rows()
        rows = {own: rows[own] for name in shown for own in self._components[name]}
        zeros = [own for own, (_, _, *texts) in rows.items() if {*texts} == {"0"}]
        zeros = zeros if len(zeros) < len(rows) else []
        hidden = {*zeros} | plain_magnitudes(rows, zeros)
        sentences = []
        if matrices:
            output = matrices[0] if len(matrices) == 1 else "S"
            sentences.append(f"not shown: {', '.join(matrices)} (--outputs {output})")
        if zeros:
            whole = {own: name for name, names in self._components.items() if {*names} <= {*zeros} for own in names}
            sentences.append(f"zero throughout: {', '.join(dict.fromkeys(whole.get(own, own) for own in zeros))}")
        if self.lost:
            some = "; the ranges are those of the others" * (self.lost < self._scene.samples)
            sentences.append(f"{self.lost} of {self._scene.samples} instants are not finite{some}")
        return [self._heading(), *(tuple(row) for own, row in rows.items() if own not in hidden)], sentences

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
        rows, start = {}, 0
        numbers = np.stack([*self._values, self._smallest, self._largest], axis=1)
        for array, names in self._components.items():
            part = self._columns.converted(array, numbers[start : start + len(names)])
            start += len(names)
            variation = float(np.fmax.reduce(part[:, -1] - part[:, -2], initial=0.0))
            offsets = np.array([round_offset(low, high, variation) for low, high in part[:, -2:].tolist()])[:, None]
            with np.errstate(invalid="ignore"):
                shifted = part - offsets
                shifted[np.abs(shifted) < 64 * np.finfo(float).eps * np.abs(offsets)] = 0.0
            texts = number_texts(names, shifted.tolist())
            for name, offset, own in zip(names, offsets.ravel().tolist(), texts, strict=True):
                rows[name] = [offset_text(name, offset), self._columns.unit(array), *own]
        return rows

    def ranges(self) -> dict[str, dict[str, float]]:
        """Return the first, last, smallest and largest value of each component by its heading."""
        columns, names = self._columns, [own for _, components in self._components.items() for own in components]
        values = {"first": self._values[0], "last": self._values[-1]}
        values |= {"smallest": self._smallest, "largest": self._largest}
        return {
            columns.heading(name): {key: float(columns.converted(name, own[i])) for key, own in values.items()}
            for i, name in enumerate(names)
            if not name.startswith("|")
        }
