"""Logs of scenes: the columns of a file of samples, or of a table in its place, read and checked.

docs/scenes.md lists the columns. A note names others, which are not read.
"""

from __future__ import annotations

import os
from collections.abc import Set
from pathlib import Path
from typing import Any, Final

import numpy as np

from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.plans.pairs import SPACE
from hingepair.rotations.matrices import quaternion_to_matrix
from hingepair.scenes.assembly import Assembly
from hingepair.scenes.motions.known import RATE_SUFFIXES
from hingepair.scenes.tables import NamedSource, Table
from hingepair.tables.column_tables import ColumnTable
from hingepair.tables.instants import gap_sentences, instants_of, sample_text
from hingepair.tables.recorded_columns import (
    Vocabulary,
    doubts_about_angles,
    headings_among,
    open_columns,
    planar_zeros,
    read_recorded,
    read_sources,
)
from hingepair.tables.suspicions import suspicions
from hingepair.tables.units import split_heading

LOG_ARRAYS: Final[dict[str, tuple[str, ...]]] = {
    "R1": ("x", "y", "z"),
    "quat_xyzw": ("qx", "qy", "qz", "qw"),
    "quat_wxyz": ("qw", "qx", "qy", "qz"),
    **{v: (f"{v}_x", f"{v}_y", f"{v}_z") for v in ("phi", "phid", "phidd", "v1", "a1", "omega1", "alpha1")},
    **SPACE.columns,
}
"""Names of the columns of each array that a log may have."""
POSITION: Final = ("R1", "v1", "a1")
"""Arrays of a log with the position of body 1 [m] and its derivatives [m/s, m/s^2]."""
EULER: Final = ("phi", "phid", "phidd")
"""Arrays of a log with the Euler angles of body 1 [rad] and their derivatives [rad/s, rad/s^2]."""
QUATERNION: Final = ("quat_xyzw", "omega1", "alpha1")
"""Arrays of a log with the quaternion of body 1, its angular velocity [rad/s] and acceleration [rad/s^2]."""
HINGE_NAMES: Final = ("psi", "psid", "psidd")
"""Names of the hinge angle [rad] and its derivatives [rad/s, rad/s^2]."""

_DEGREES: Final = 'unit = "deg" for {} in [motion.columns]'  # for messages
_HEADINGS: Final = f'{_DEGREES} (unit = "compass" for headings clockwise from north)'
_PLANAR: Final = {  # columns that a log in the plane leaves out together, and those that it then has
    ("z", "phi_x", "phi_y"): ("x", "y", "phi_z"),
    ("v1_z",): ("v1_x", "v1_y"),
    ("phid_x", "phid_y"): ("phid_z",),
    ("a1_z",): ("a1_x", "a1_y"),
    ("phidd_x", "phidd_y"): ("phidd_z",),
}
_PHI: Final = {name: f"{name}_z" for name in EULER}  # results in the plane have one angle


def log_path(table: Table, folder: Path) -> Path | ColumnTable:
    """Return the path of the log that the key `file` of the Table [motion] names, relative to `folder`; or the table
    that stands in its place.
    """
    given = table.values.get("file")
    if isinstance(given, ColumnTable):
        return given
    file = folder / table.file_name("file")
    if not os.path.isfile(file):  # of a name that is too long Path.is_file would raise
        table.refuse("file", "a file of samples that can be read", f"no such file: {file}")
    return file


class Log(NamedSource):
    """Columns of a log file by name, read and checked by the constructor, which raises a SceneError for bad ones.

    Args:
        path: the file, or a table in its place.
        assembly: what moves.
        table: [motion] of the scene, whose key `columns` says how the file's columns are read.

    Attributes:
        columns: the columns.
        t: instants [s], as they are counted in the scene.
        since: time since the first instant [s].
        notes: sentences on instants and on units.
    """

    hint = "; motion.smooth = true finds the rates of poses"

    def __init__(self, path: Path | ColumnTable, assembly: Assembly, table: Table) -> None:
        super().__init__(str(path) if str(path).isprintable() else repr(str(path)), "")
        self._assembly, self._sequence = assembly, table.values.get("sequence", "XYZ")
        self.notes: list[str] = []
        arrays = dict(LOG_ARRAYS) if assembly.base_names else {}
        if assembly.pair is None:
            arrays |= {f"q{ending}": tuple(name + ending for name in assembly.names) for ending in RATE_SUFFIXES}
        self._known = tuple(dict.fromkeys(("t", *(column for own in arrays.values() for column in own))))
        # A joint may be called q.
        self._arrays = {name: own for name, own in arrays.items() if own == (name,) or name not in self._known}
        self._headings = headings_among(self._arrays.get("phi", ()), self._sequence)

        def components(name: str, shape: tuple[int, ...]) -> Any:
            """Return the columns that form an array; one column may have another name, such as phi in a plane."""
            return self.columns_of(name) if shape else _PHI.get(name, name) if assembly.base_names else name

        vocabulary = Vocabulary(self._known, assembly.unit, components, self._headings)
        with self.naming():
            columns = open_columns(path)
        with table.naming():
            sources = read_sources(table.values.get("columns", {}), vocabulary, columns)
        with self.naming():
            self.columns, stated, self._file_columns, self._lines = read_recorded(columns, sources, vocabulary)
            self._note_unknown()
            self._require("t")
            self._leave_out_repeated_stamps()
            self._complete_planar_columns("no column was named for" if sources else "the log has no")
            stamps = self.columns["t"]
            t = instants_of("t", stamps, lines=self._lines)
            dated = stamps.dtype.kind in "mM"
            if dated or float(stamps[0]) != t[0]:
                unit = "" if dated else " ns"
                self.notes.append(f"t is counted from the first stamp of the log, {stamps[0]}{unit}")
            self.notes += [*([] if dated else suspicions("instants", "t", t)), *gap_sentences("t", t)]
            self._judge_units(stated)
        self.t = np.asarray(read_only(t))
        self.since = t - t[0]

    def columns_of(self, name: str) -> tuple[str, ...]:
        """Return the names of the columns that form an array; of another name, which is a column's, itself."""
        return self._arrays.get(name, (name,))

    def unit_of(self, column: str) -> str:
        """Return the SI unit of a column."""
        return self._assembly.unit(column)

    def _note_unknown(self) -> None:
        """Say which columns of the file are not read."""
        unknown = [name for name in self._file_columns if name not in self._known]
        if unknown:
            note = f"columns that were not read: {', '.join(unknown[:20])}"
            for name in unknown:
                bare, unit = split_heading(name)
                if unit and bare in self._known:
                    note += f'; {bare} = {{ name = "{name}", unit = "{self.unit_of(bare)}" }} reads it in that unit'
            self.notes.append(note)

    def _judge_units(self, stated: Set[str]) -> None:
        """Add notes on columns that are probably not in SI units, unless they are in `stated`."""
        hinges = [joint.name for joint in self._assembly.joints if joint.unit == "rad"]
        written = {name: own for name, own in self.columns.items() if name not in stated}
        angles = {name: written[name] for name in (*self.columns_of("phi"), *hinges) if name in written}
        self.notes += doubts_about_angles(
            angles, lambda name: (_HEADINGS if name in self._headings else _DEGREES).format(name)
        )
        judged = dict.fromkeys((f"{name}d" for name in hinges), "rate")
        judged |= {"qx": "quaternion x", "omega1": "gyroscope"} if self._assembly.base_names else {}
        for name, quantity in judged.items():
            names = self.columns_of(name)
            if stated.isdisjoint(names) and all(column in self.columns for column in names):
                values = np.stack([self.columns[column] for column in names], axis=-1)
                rows = values if len(names) > 1 else values[:, 0]
                self.notes += suspicions(quantity, name, rows, radians=_DEGREES.replace("deg", "deg/s"))

    def _leave_out_repeated_stamps(self) -> None:
        """Take rows with the stamp of the row before out of `columns`."""
        stamps = self.columns["t"]
        kept = np.append(True, stamps[1:] != stamps[:-1])
        if not kept.all():
            first, count = int(np.argmin(kept)), int((~kept).sum())
            rows, verb = ("row has", "was") if count == 1 else ("rows have", "were")
            place = sample_text(first, self._lines)
            self.notes.append(f"{count} {rows} the stamp of the row before and {verb} left out, the first in {place}")
            self.columns = {name: column[kept] for name, column in self.columns.items()}
            self._lines = None if self._lines is None else self._lines[kept]

    def _complete_planar_columns(self, absence: str) -> None:
        """Add what a log of a motion in the plane leaves out, as zeros; a note on them starts with `absence`."""
        added = planar_zeros(self.columns, _PLANAR, self._sequence) if self._assembly.base_names else []
        self.columns |= dict.fromkeys(added, np.zeros(len(self.columns["t"])))
        if added:
            self.notes.append(f"{absence} {', '.join(added)}: they were taken as 0, as of a motion in the plane")

    def derivatives(self, names: tuple[str, ...]) -> list[Any]:
        """Return a quantity and its derivatives, whose names are given, None where the log has no column of a
        derivative; refuse a log that lacks the quantity or some of the columns of an array.
        """
        found: list[Any] = []
        for order, name in enumerate(names):
            columns = self.columns_of(name)
            present = [column for column in columns if column in self.columns]
            for column in columns if present or not order else ():
                self._require(column, f", since the log has {present[0]}" if present else "")
            array = np.stack([self.columns[column] for column in columns], axis=-1) if present else None
            found.append(array if array is None or name in self._arrays else array[:, 0])
        return found

    def _require(self, column: str, since: str = "") -> None:
        """Refuse a log without a column."""
        if column not in self.columns:
            expected = f'a column{since}, or {column} = "NAME" in [motion.columns], which names it'
            self.refuse(column, expected, f"no such column among {', '.join(self._file_columns[:20])}")

    def check_finite(self, name: str, array: Float64Array) -> None:
        """Refuse an array, which is to be integrated, with a number that is not finite."""
        columns = array.reshape(len(array), -1)
        for sample, i in np.argwhere(~np.isfinite(columns))[:1]:
            got = f"{columns[sample, i]} at {sample_text(sample, self._lines)}, t = {self.t[sample]:.10g} s"
            self.refuse(self.columns_of(name)[i], "finite numbers, to be integrated", got)

    def rotations(self, quat_xyzw: Float64Array) -> Float64Array:
        """Return the rotation matrices (N, 3, 3) of quaternions (x, y, z, w), shape (N, 4)."""
        zero = np.flatnonzero((quat_xyzw == 0).all(axis=-1))
        if zero.size:
            self.refuse("qx, qy, qz, qw", "quaternions that are not zero", f"a zero quaternion at sample {zero[0]}")
        return np.asarray(quaternion_to_matrix("quat_xyzw", quat_xyzw, scalar_first=False))
