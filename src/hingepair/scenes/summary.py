"""Summaries of results over the instants of a scene: the table that commands print, and what --json has of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.arrays import Float64Array
from hingepair.tables.data_frames import column_names, plain_magnitudes, split_columns, with_magnitudes
from hingepair.tables.sheets import cell_text, instant_text, number_texts, offset_text, round_offset
from hingepair.tables.units import UnitsLike

_UNITS_OF_POSES = {"m", "rad", "1"}  # of what is known without rates


class Summary:
    """Summary of each component of some arrays, which may come block by block in order of time.

    Args:
        scene: the scene.
        units: units of the numbers; None for those of the scene.
        limits: limits of the sizes of components in SI units, for `table_of_sizes`.

    Attributes:
        lost: number of instants with a value that is not finite.
    """

    def __init__(self, scene: Any, units: UnitsLike = None, limits: Mapping[str, float] | None = None) -> None:
        self._scene, self._columns, self._limits = scene, scene.in_units(units), limits or {}
        self._instants = {0, (scene.samples - 1) // 2, scene.samples - 1}
        self._t: list[float] = []  # times of these instants, and the components at them
        self._values: list[Float64Array] = []
        self._components: dict[str, list[str]] = {}  # by array
        self._matrices: list[str] = []
        self._smallest = self._largest = np.array(np.nan)
        self._squares, self._known, self._peaks, self._t_of_peaks = np.zeros((4, 1))
        self.lost = 0

    def add(self, t: Float64Array, arrays: Mapping[str, NDArray[Any]], first: int = 0) -> None:
        """Take the arrays at the instants t, the first of which has the index `first`, into the summary."""
        self._matrices = [name for name, array in arrays.items() if array.ndim == 3]
        arrays = with_magnitudes(arrays, self._scene.unit)
        self._components = {}
        for name, array in arrays.items():
            self._components.setdefault(name.strip("|"), []).extend(column_names({name: array}))
        values = np.column_stack(split_columns(arrays)).astype(float, copy=False)
        for at in sorted(i - first for i in self._instants):
            if 0 <= at < len(t):
                self._t.append(float(t[at]))
                self._values.append(values[at].copy())
        lost = ~np.isfinite(values)
        self.lost += int(lost.any(axis=1).sum())
        values[lost] = np.nan
        if (sure := self._scene.motion.sure) is not None:  # rates that smoothing finds at ends are no extremes
            own = self._components.items()
            rate = [self._scene.unit(name) not in _UNITS_OF_POSES for name, names in own for _ in names]
            values[np.outer(~sure[first : first + len(values)], rate)] = np.nan
        self._smallest = np.fmin(self._smallest, np.fmin.reduce(values))
        self._largest = np.fmax(self._largest, np.fmax.reduce(values))
        sizes = np.nan_to_num(np.abs(values), nan=-1.0)
        at, peaks = sizes.argmax(axis=0), sizes.max(axis=0)
        self._t_of_peaks = np.where(peaks > self._peaks, t[at], self._t_of_peaks if first else t[at])
        self._peaks = np.maximum(self._peaks, peaks)
        self._squares = self._squares + np.nansum(values * values, axis=0)
        self._known = self._known + np.isfinite(values).sum(axis=0)

    @property
    def _rms(self) -> Float64Array:
        with np.errstate(invalid="ignore"):
            return np.asarray(np.sqrt(self._squares / self._known))

    def table(self, hides_matrices: bool = False) -> tuple[list[tuple[str, ...]], list[str]]:
        """Return the rows of a table, headings first, and sentences on what it leaves out.

        A row has a component, its unit, its values at the first, middle and last instant, and its range; so has the
        magnitude of a vector with several components that are not zero. Of numbers that are large against their
        variation, an offset is subtracted, which stands behind the name.
        """
        numbers = np.stack([*self._values, self._smallest, self._largest], axis=1)
        units, scene = self._columns.units, self._scene
        offset, name = units.offset_of_instants(scene.start, scene.stop)
        texts = [instant_text(units.factor("s") * t - offset) for t in self._t]
        unit = "" if units.unit("s") == "s" else f" {units.unit('s')}"
        at = [text if name else f"t = {text}{unit}" for text in texts]
        rows, sentences = self._rows(numbers, self._matrices if hides_matrices else [], offsets=True)
        return [(f"{name} =" if name else "", "unit", *at, "smallest", "largest"), *rows], sentences

    def table_of_sizes(self) -> tuple[list[tuple[str, ...]], list[str]]:
        """Return rows and sentences as `table`, with smallest, largest and rms value and the instant of the largest
        size of each component, and the limits of their sizes, if there are any.
        """
        units, limits = self._columns.units, self._limits
        offset, name = units.offset_of_instants(self._scene.start, self._scene.stop)
        at = name or ("t" if units.unit("s") == "s" else f"t [{units.unit('s')}]")
        rows, sentences = self._rows(np.stack([self._smallest, self._largest, self._rms], axis=1), [])
        peaks = dict(zip(self._names, zip(self._peaks, self._t_of_peaks, strict=True), strict=True))
        found = [
            ("", "unit", "smallest", "largest", "rms", f"max |.| at {at}", *["limit", "of limit"] * bool(limits))
        ]
        for row in rows:
            (peak, t), limit = peaks[row[0]], limits.get(row[0], math.inf)
            shown = units.factor(self._scene.unit(row[0])) * limit
            use = (cell_text(shown), f"{peak / limit:.0%}") if 0 < limit < math.inf else ("", "")
            found.append((*row, instant_text(units.factor("s") * t - offset), *use[: 2 * bool(limits)]))
        return found, sentences

    @property
    def _names(self) -> list[str]:
        return [own for names in self._components.values() for own in names]

    def _rows(
        self, numbers: Float64Array, hidden_arrays: list[str], *, offsets: bool = False
    ) -> tuple[list[tuple[str, ...]], list[str]]:
        """Return the cells (name, unit, numbers) of components that are not zero, and sentences on the others."""
        rows, start = {}, 0
        for array, names in self._components.items():
            part = self._columns.converted(array, numbers[start : start + len(names)])
            start += len(names)
            if array in hidden_arrays:
                continue
            off = np.zeros((len(names), 1))
            if offsets:
                variation = float(np.fmax.reduce(part[:, -1] - part[:, -2], initial=0.0))
                off = np.array([round_offset(low, high, variation) for low, high in part[:, -2:].tolist()])[:, None]
            with np.errstate(invalid="ignore"):
                shifted = part - off
                shifted[np.abs(shifted) < 64 * np.finfo(float).eps * np.abs(off)] = 0.0
            texts = number_texts(names, shifted.tolist())
            for name, one, own in zip(names, off.ravel().tolist(), texts, strict=True):
                rows[name] = (offset_text(name, one), self._columns.unit(array), *own)
        zeros = [own for own, (_, _, *texts) in rows.items() if {*texts} == {"0"}]
        zeros = zeros if len(zeros) < len(rows) else []
        hidden, sentences = {*zeros} | plain_magnitudes(rows, zeros), []
        if hidden_arrays:
            output = hidden_arrays[0] if len(hidden_arrays) == 1 else "S"
            sentences.append(f"not shown: {', '.join(hidden_arrays)} (--outputs {output})")
        if zeros:
            whole = {own: name for name, names in self._components.items() if {*names} <= {*zeros} for own in names}
            sentences.append(f"zero throughout: {', '.join(dict.fromkeys(whole.get(own, own) for own in zeros))}")
        if self.lost:
            some = "; the ranges are those of the others" * (self.lost < self._scene.samples)
            sentences.append(f"{self.lost} of {self._scene.samples} instants are not finite{some}")
        return [row for own, row in rows.items() if own not in hidden], sentences

    def ranges(self) -> dict[str, dict[str, float]]:
        """Return, by heading of each component, the first, last, smallest, largest and rms value, and the instant of
        the largest size.
        """
        columns = self._columns
        rows = {"first": self._values[0], "last": self._values[-1], "smallest": self._smallest}
        rows |= {"largest": self._largest, "rms": self._rms}
        found = {}
        for i, name in enumerate(self._names):
            if name.startswith("|"):
                continue
            own = {key: float(columns.converted(name, values[i])) for key, values in rows.items()}
            when = float(columns.converted("t", self._t_of_peaks[i])) if self._known[i] else math.nan
            found[columns.heading(name)] = own | {"t_of_largest_size": when}
        return found
