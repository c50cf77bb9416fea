"""Motion by a log: what a file of samples says, as it is, smoothed or integrated.

docs/scenes.md lists the columns. Others are refused: a misspelt one would be missed.
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Mapping, Set
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.equations.quantities import ACCELERATION, unit_of
from hingepair.errors import SceneError, choices, nearest, quoted
from hingepair.measured.robust import LOSSES
from hingepair.measured.smoothing.smooth import longest_filled, smooth
from hingepair.measured.smoothing.spline import MIN_PIECE
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.motion.integrate import RATE_FRAME_NAMES
from hingepair.motion.signals import SampledSignal
from hingepair.motion.trajectory import rotate_to_world
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.plans.pairs import PLANE, SPACE
from hingepair.plans.trees import FRAME_OUTPUTS
from hingepair.rotations.euler import euler_to_matrix
from hingepair.rotations.matrices import quaternion_to_matrix
from hingepair.rotations.sequences import SEQUENCE_NAMES
from hingepair.scenes.motions.functions import FunctionsOfTime, base_at, base_phrase, read_base
from hingepair.scenes.motions.integrated import integrate_motion
from hingepair.scenes.motions.known import RATE_SUFFIXES, EulerBase, Known, known_by_body1
from hingepair.scenes.motions.motion import Motion
from hingepair.scenes.subjects.either import Subject
from hingepair.scenes.subjects.mechanism import MechanismSubject
from hingepair.scenes.tables import NamedSource, Table
from hingepair.tables.column_tables import ColumnTable
from hingepair.tables.instants import MeasurementWarning, gap_sentences, instants_of, split_at_gaps
from hingepair.tables.recorded_columns import (
    ColumnSource,
    PlanarColumns,
    Vocabulary,
    doubts_about_angles,
    headings_among,
    open_columns,
    planar_zeros,
    read_recorded,
    read_sources,
)
from hingepair.tables.suspicions import suspicions

LOG_ARRAYS: Final[dict[str, tuple[str, ...]]] = {
    "R1": ("x", "y", "z"),
    "quat_xyzw": ("qx", "qy", "qz", "qw"),
    "quat_wxyz": ("qw", "qx", "qy", "qz"),
    **{v: (f"{v}_x", f"{v}_y", f"{v}_z") for v in ("phi", "phid", "phidd", "v1", "a1", "omega1", "alpha1")},
    **SPACE.columns,
}
"""Names of the columns of each array that a log may have."""
_WRITING: Final = "run --outputs q,qd,qdd --out FILE writes what is read here"
_TIMES: Final = frozenset({"time", "timestamp", "stamp", "seconds", "zeit"})  # what others call t
HINGE_NAMES: Final = ("psi", "psid", "psidd")
"""Names of the hinge angle [rad] and its derivatives [rad/s, rad/s^2]."""

Part: TypeAlias = dict[str, Float64Array]
"""A quantity and its derivatives by name, as far as they are known; shape (N, k) each."""


class LogLayout(NamedTuple):
    """Names, units and quantities of the columns that a log may have."""

    #: names of the columns of each array, by the name of the array
    arrays: Mapping[str, tuple[str, ...]]
    #: names of all columns
    columns: tuple[str, ...]
    #: quantity of each array or column whose unit is judged
    judged: Mapping[str, str]
    #: beginnings (up to the first `_`) of the names of columns that hold results
    result_prefixes: frozenset[str]
    #: unit of each column that has none of the registry
    units: Mapping[str, str]
    #: columns that a log in the plane leaves out together, and those that it then has
    planar: PlanarColumns
    #: names of columns by other names that they may have
    other_names: Mapping[str, str]

    def unit_of(self, column: str) -> str:
        """Return the SI unit of a column."""
        if column == "t":
            return "s"
        array = next(
            (name for name, own in self.arrays.items() if column in own and name not in {"q", "qd", "qdd"}), column
        )
        return self.units.get(column) or self.units.get(array) or unit_of(array)

    def columns_of(self, name: str) -> tuple[str, ...]:
        """Return the names of the columns that form an array; of another name, which is a column's, itself."""
        return self.arrays.get(name, (name,))

    def vocabulary(self, sequence: object) -> Vocabulary:
        """Return the names that columns may have, whose Euler angles are about the axes of `sequence`."""

        def components(name: str, shape: tuple[int, ...]) -> Any:
            """Return the columns that form an array; one column may have another name, such as phi in a plane."""
            return self.arrays.get(name, name) if shape else self.other_names.get(name, name)

        headings = headings_among(self.arrays.get("phi", ()), sequence)
        return Vocabulary(self.columns, self.unit_of, components, headings)


_PLANAR: Final = {  # columns that a log in the plane leaves out together, and those that it then has
    ("z", "phi_x", "phi_y"): ("x", "y", "phi_z"),
    ("v1_z",): ("v1_x", "v1_y"),
    ("phid_x", "phid_y"): ("phid_z",),
    ("a1_z",): ("a1_x", "a1_y"),
    ("phidd_x", "phidd_y"): ("phidd_z",),
}
_PHI: Final = {"phi": "phi_z", "phid": "phid_z", "phidd": "phidd_z"}  # results in the plane have one angle


def log_layout(subject: Subject) -> LogLayout:
    """Return the LogLayout of the log of what moves: columns of body 1 or the base, and of the joints."""
    moves_base = bool(subject.base_names)
    arrays = dict(LOG_ARRAYS) if moves_base else {}
    if subject.pair is None:
        arrays |= {f"q{ending}": tuple(name + ending for name in subject.names) for ending in RATE_SUFFIXES}
    columns = tuple(dict.fromkeys(("t", *(column for own in arrays.values() for column in own))))
    arrays = {name: own for name, own in arrays.items() if own == (name,) or name not in columns}  # a joint may be q
    judged: dict[str, str] = {}
    if moves_base:
        judged |= {**dict.fromkeys(("phi_x", "phi_y", "phi_z"), "angle"), "qx": "quaternion x", "omega1": "gyroscope"}
    units = {"phi": "rad", "phid": "rad/s", "phidd": "rad/s^2"}
    for joint in subject.joints:
        for ending, per, quantity in zip(RATE_SUFFIXES, ("", "/s", "/s^2"), ("angle", "rate", ""), strict=True):
            units[joint.name + ending] = joint.unit + per
            if joint.unit == "rad" and quantity:
                judged[joint.name + ending] = quantity
    results = {*SPACE.levels, *PLANE.levels} if subject.pair is not None else {*FRAME_OUTPUTS, "quat", "tau"}
    others = (_PLANAR, _PHI) if moves_base else ({}, {})
    return LogLayout(arrays, columns, judged, frozenset(results | {"force1", "torque1"}), units, *others)


SMOOTHING_KEYS: Final = {
    "smooth": "",
    "loss": "whose outliers it makes count little",
    "gaps": "which fills shorter times without samples",
}
"""Keys of [motion] for smoothing, and what the others are for beside smooth = true."""
_POSITION = ("R1", "v1", "a1")
"""Arrays of a log with the position of body 1 [m] and its derivatives [m/s, m/s^2]."""
_EULER = ("phi", "phid", "phidd")
"""Arrays of a log with the Euler angles of body 1 [rad] and their derivatives [rad/s, rad/s^2]."""
_QUATERNION = ("quat_xyzw", "omega1", "alpha1")
"""Arrays of a log with the quaternion of body 1, its angular velocity [rad/s] and acceleration [rad/s^2]."""
_DEGREES: Final = 'unit = "deg" for {} in [motion.columns]'  # for messages
_HEADINGS: Final = f'{_DEGREES} (unit = "compass" for headings clockwise from north)'


def read_log(tables: Table, folder: Path, subject: Subject) -> Motion:
    """Return the motion of the log that [motion] names, as it is, smoothed or integrated."""
    table = tables.table("motion")
    if subject.planar:
        table.fail(
            "file",
            "no such key beside planar = true: without it, u1 and u2 have three numbers, n = [0, 0, 1], and a log in "
            "the plane needs no z, phi_x and phi_y",
        )
    if "time" in tables.values:
        tables.fail("time", "no such table, since the column t of motion.file has the instants")
    integrated = subject.pair is not None and table.flag("integrate")
    options = ("file", "columns", "ignore", *SMOOTHING_KEYS)
    given: tuple[str, ...] = ()
    if isinstance(subject, MechanismSubject):
        subject.check_joint_names(table, options)
        given = subject.base_names
    else:
        integration_keys = ("psi_0", "method", "S1_0")
        for key in integration_keys:
            if key in table.values and not integrated:
                table.fail(key, "no such key without integrate = true, which integrates a log of rates")
        options = (*options, "integrate", *(integration_keys if integrated else ()))
    table.check_keys((*options, "frame", *(() if integrated else ("sequence",)), *given))
    smooths = is_smoothed(table)
    if smooths and integrated:
        table.fail("smooth", "no such key together with integrate: smoothing computes all rates")
    log = Log(log_path(table, folder), log_layout(subject), table)
    return _integrate_rates(table, log) if integrated else _read_samples(table, log, subject, smooths)


def is_smoothed(table: Table) -> bool:
    """Return whether the Table [motion] asks for smoothing; refuse its keys of smoothing otherwise."""
    smoothed = table.flag("smooth")
    for key, purpose in SMOOTHING_KEYS.items():
        if key in table.values and not smoothed and key != "smooth":
            table.fail(key, f"no such key without smooth = true, {purpose}")
    return smoothed


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


def read_ignored_columns(table: Table) -> frozenset[str]:
    """Return the names of columns under the key `ignore` of [motion], which are not read; none without the key."""
    names = table.values.get("ignore", [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        table.fail("ignore", 'a list of names of columns, such as ["temperature"]')
    return frozenset(names)


def _velocity_frame(table: Table, log: Log) -> str:
    """Return the axes of angular velocities, "body" or "world"; only a log that has some has the key `frame`."""
    rates = [column for name in _QUATERNION[1:] for column in LOG_ARRAYS[name] if column in log.columns]
    if "frame" in table.values and not rates:
        table.fail("frame", "no such key, since the log has no omega1_x, omega1_y, omega1_z")
    if rates and "frame" not in table.values:
        axes = 'those of body 1, as a gyroscope has them, or "world", as hingepair writes them'
        table.fail("frame", f'the axes of {rates[0].partition("_")[0]} in the log: "body", {axes}')
    return table.choice("frame", RATE_FRAME_NAMES)


class Log(NamedSource):
    """Columns of a log file by name, read and checked by the constructor, which raises a SceneError for bad ones.

    Args:
        path: the file, or a table in its place.
        layout: names of the columns that it may have.
        table: [motion] of the scene, whose keys `columns` and `ignore` say how the file's columns are read.

    Attributes:
        notes: sentences on instants and on units.
        angle_doubts: those of them on angles that are, or may be, in degrees.
    """

    hint = "; motion.smooth = true finds the rates of poses"

    def __init__(self, path: Path | ColumnTable, layout: LogLayout, table: Table) -> None:
        ignored = read_ignored_columns(table)
        super().__init__(str(path) if str(path).isprintable() else repr(str(path)), "")
        self._has_lines = isinstance(path, Path) and path.suffix.lower() == ".csv"
        self.layout = layout
        self._sequence = table.values.get("sequence", "XYZ")
        self._file_columns: list[str] = []
        self._ignored = frozenset(column for name in ignored for column in layout.columns_of(name))
        self.notes: list[str] = []
        self.angle_doubts: list[str] = []
        vocabulary = layout.vocabulary(self._sequence)
        with self.naming():
            columns = open_columns(path)
        with table.naming():
            sources = read_sources(table.values.get("columns", {}), vocabulary, columns.units)
        self._check_sources(sources, list(columns.shapes))
        with self.naming():
            self.columns, stated = read_recorded(
                columns, sources, vocabulary, lambda names: self._check_column_names(names, sources)
            )
            if "t" not in self.columns:
                self.refuse("t", "a column", "no such column")
            kept = self._without_repeated_stamps()
            self._kept_rows = np.flatnonzero(kept)
            self._complete_planar_columns("no column was named for" if sources else "the log has no")
            stamps = self.columns["t"]
            rounded = stamps.astype(np.float64) if stamps.dtype == np.longdouble else stamps
            t = instants_of("t", rounded)
        if stamps.dtype.kind in "mM" or float(stamps[0]) != t[0]:
            unit = "" if stamps.dtype.kind in "mM" else " ns"
            self.notes.append(f"t is counted from the first stamp of the log, {stamps[0]}{unit}")
        if stamps.dtype.kind not in "mM":
            self.notes += suspicions("instants", "t", t)
        self.notes += gap_sentences("t", t)
        self._judge_units(stated)
        self.t = np.asarray(read_only(t))
        precise = stamps if stamps.dtype == np.longdouble else t
        self.since = np.asarray(precise - precise[0], dtype=np.float64)

    def _judge_units(self, stated: Set[str]) -> None:
        """Add notes on columns that are probably not in SI units, unless they are in `stated`."""
        angles: dict[str, Float64Array] = {}
        others: list[str] = []
        for name, quantity in self.layout.judged.items():
            names = self.layout.columns_of(name)
            if not stated.isdisjoint(names) or not all(column in self.columns for column in names):
                continue
            values = np.stack([self.columns[column] for column in names], axis=-1)
            if quantity == "angle":
                angles[name] = values[:, 0]
            else:
                rows = values if len(names) > 1 else values[:, 0]
                others += suspicions(quantity, name, rows, radians=_DEGREES.replace("deg", "deg/s"))
        with self.naming():
            headings = headings_among(self.layout.arrays.get("phi", ()), self._sequence)
            self.angle_doubts = doubts_about_angles(
                angles, lambda name: (_HEADINGS if name in headings else _DEGREES).format(name)
            )
        self.notes += [*self.angle_doubts, *others]

    def _without_repeated_stamps(self) -> NDArray[np.bool_]:
        """Take rows with the stamp of the row before out of `columns`, and return which rows are kept."""
        stamps = self.columns["t"]
        kept = np.append(True, stamps[1:] != stamps[:-1])
        if not kept.all():
            self.columns = {name: column[kept] for name, column in self.columns.items()}
            first, count = int(np.argmin(kept)), int((~kept).sum())
            place = f"line {first + 2}" if self._has_lines else f"row {first}, counted from 0"
            rows, verb = ("row has", "was") if count == 1 else ("rows have", "were")
            sentence = f"{count} {rows} the stamp of the row before and {verb} left out, the first in {place}"
            self.notes.append(sentence)
        return kept

    def _complete_planar_columns(self, absence: str) -> None:
        """Add what a log of a motion in the plane leaves out, as zeros; a note on them starts with `absence`."""
        added = planar_zeros(self.columns, self.layout.planar, self._sequence)
        self.columns |= dict.fromkeys(added, np.zeros(len(self.columns["t"])))
        if "psi" in self.columns and {*self.columns} <= {"t", *HINGE_NAMES}:
            order = max(k for k, name in enumerate(HINGE_NAMES) if name in self.columns)
            at_rest = [name for names in (_POSITION, _EULER) for name in names[: order + 1]]
            zeros = np.zeros(len(self.columns["t"]))
            self.columns |= {column: zeros for name in at_rest for column in LOG_ARRAYS[name]}
            self.notes.append("body 1 rests at the origin, since the log has psi alone")
        if added:
            self.notes.append(f"{absence} {', '.join(added)}: they were taken as 0, as of a motion in the plane")

    def _check_sources(self, sources: Mapping[str, ColumnSource], present: list[str]) -> None:
        """Refuse columns under [motion.columns] that the file lacks."""
        for name, source in sources.items():
            if source.column not in present:
                expected = f"{choices(present)}{nearest(source.column, present)}"
                self.refuse(f"motion.columns.{name}", expected, quoted(source.column))

    def _check_column_names(self, column_names: list[str], sources: Mapping[str, ColumnSource]) -> list[str]:
        """Return the columns of the file to read; refuse unknown ones, or leave them out if there are `sources`."""
        taken = {source.column for source in sources.values()}
        known_names: tuple[str, ...] = tuple(self.layout.columns)
        self._file_columns = column_names
        if sources:  # the file is another's: what it has beside them is not ours to know
            others = [name for name in column_names if name not in {*taken, *known_names}]
            if others:
                self.notes.append(f"columns that were not read: {', '.join(others[:20])}")
            self._ignored |= frozenset(others)
            known_names = (*known_names, *taken)
        for name in sorted(self._ignored.difference(column_names)):
            expected = f"names of columns of the log in motion.ignore{nearest(name, tuple(column_names))}"
            self.refuse(repr(name[:40]), expected, "no such column")
        read_names = [name for name in column_names if name not in self._ignored]
        for name in read_names:
            if name not in known_names:
                near = " (nearest: t)" if name.strip().lower() in _TIMES else nearest(name, known_names)
                got = f"an unknown column{near}"
                if name.partition("_")[0] in self.layout.result_prefixes:
                    got = f"a column of results, which are no motion ({_WRITING})"
                expected = (
                    f"{choices(known_names)}; [motion] ignore = [{name[:40]!r}] leaves the column out, and "
                    '[motion.columns] names the columns of another program, such as t = "Time"'
                )
                self.refuse(repr(name[:40]), expected, got)
        return read_names

    def quantity_and_rates(self, names: tuple[str, ...], required: bool = True) -> Part:
        """Return a quantity and its derivatives as a dict of arrays by name, as far as the log has them. `names` are
        the names of the quantity and of its derivatives, by order. If the log lacks the quantity, return an empty
        dict, or raise a SceneError if `required` is True.
        """
        arrays = {}
        for i, name in enumerate(names):
            array = self._stack_columns(name, required and i == 0)
            if array is not None:
                arrays[name] = array
        return {name: array if name in self.layout.arrays else array[:, 0] for name, array in arrays.items()}

    def _stack_columns(self, array_name: str, required: bool) -> NDArray[np.float64] | None:
        """Return the columns that form the array `array_name`, shape (N, k); None if the log has none of them and
        `required` is False.
        """
        column_names = self.layout.columns_of(array_name)
        present_names = [column for column in column_names if column in self.columns]
        if not present_names and not required:
            return None
        for column in column_names:
            if column not in self.columns:
                since = f", since the log has {present_names[0]}" if present_names else ""
                expected = f'a column{since}, or {column} = "NAME" in [motion.columns], which names it'
                self.refuse(column, expected, f"no such column among {', '.join(self._file_columns[:20])}")
        return np.stack([self.columns[column] for column in column_names], axis=-1)

    def check_finite(self, name: str, array: Float64Array, use: str) -> None:
        """Raise a SceneError that names a column of the array `name` if the array has a number that is not finite.
        `use` is a participle such as "integrated" that the message contains.
        """
        columns = array.reshape(len(array), -1)
        for sample, i in np.argwhere(~np.isfinite(columns))[:1]:
            line = f", line {self._kept_rows[sample] + 2} of the file" if self._has_lines else ""
            got = f"{columns[sample, i]} at sample {sample}{line}, t = {self.t[sample]:.10g} s"
            self.refuse(self.layout.columns_of(name)[i], f"finite numbers, to be {use}", got)

    def rotations(self, quat_xyzw: Float64Array) -> Float64Array:
        """Return the rotation matrices (N, 3, 3) of quaternions (x, y, z, w), shape (N, 4)."""
        zero = np.flatnonzero((quat_xyzw == 0).all(axis=-1))
        if zero.size:
            self.refuse("qx, qy, qz, qw", "quaternions that are not zero", f"a zero quaternion at sample {zero[0]}")
        return np.asarray(quaternion_to_matrix("quat_xyzw", quat_xyzw, scalar_first=False))


def _read_samples(table: Table, log: Log, subject: Subject, smooths: bool) -> Motion:
    """Return the motion of the samples of a log, with derivatives up to the highest order that the log has, or that
    smoothing finds.
    """
    attitude = _attitude_names(log, required=subject.pair is not None)
    if attitude is _QUATERNION and "sequence" in table.values:
        table.fail("sequence", "nothing, since the file has quaternions")
    groups = (_POSITION, attitude) if attitude else ()
    parts = {names[0]: log.quantity_and_rates(names) for names in groups}
    for name in subject.names:
        names = tuple(name + ending for ending in RATE_SUFFIXES)
        if subject.pair is not None or not {*names}.isdisjoint(log.columns):
            groups = (*groups, names)
            parts[name] = log.quantity_and_rates(names)
    joints = tuple(name for name in subject.names if name in parts)
    if not joints:
        log.refuse(subject.names[0] if subject.names else "t", "a column for each joint that moves", "none of them")
    sequence = table.choice("sequence", SEQUENCE_NAMES, "XYZ")
    functions: tuple[FunctionsOfTime, ...] = ()
    base: Any = None
    if smooths:
        return _smoothed_motion(table, log, subject, parts, attitude, sequence)
    level, frame = _highest_derivative(log, groups, parts), _velocity_frame(table, log)
    how = ""
    if attitude is _EULER:
        rows = [_columns(parts["R1"][_POSITION[i]], parts["phi"][_EULER[i]]) for i in range(level + 1)]
        base = EulerBase(tuple(rows), sequence)
        how = base_phrase(base, sequence)
    elif attitude is _QUATERNION:
        arrays = parts["R1"] | parts["quat_xyzw"]
        arrays["S1"] = log.rotations(arrays["quat_xyzw"])
        if frame == "body":
            rates = [name for name in _QUATERNION[1:] if name in arrays]
            arrays |= {name: rotate_to_world(arrays["S1"], arrays[name]) for name in rates}
        base = known_by_body1((), ((),) * (level + 1), arrays).base
        how = "attitude as quaternions"
    elif subject.pair is None:
        base_functions, _ = read_base(table, subject)
        functions = () if base_functions is None else (base_functions,)
        base = base_at(base_functions, sequence, log.t, level)
    rests = subject.rests
    rows_of_joints = tuple(
        tuple(
            _float_if_constant(parts[name][name + RATE_SUFFIXES[k]]) if name in parts else rests[name] * (k == 0)
            for name in subject.names
        )
        for k in range(level + 1)
    )
    if not level and subject.pair is not None:
        log.notes.append("the log has no rates: smooth = true in [motion] gives v2, a2, ...")
    return Motion(
        t=log.t,
        source=Known(subject.names, log.t.size, rows_of_joints, base),
        origin="samples in a file",
        how=how if subject.pair is not None else "",
        hint=log.hint,
        notes=tuple(log.notes),
        functions=functions,
        moving=joints,
    )


def _smoothed_motion(
    table: Table, log: Log, subject: Subject, parts: Mapping[str, Part], attitude: tuple[str, ...], sequence: str
) -> Motion:
    """Return the motion that smoothing of poses and coordinates finds, with first and second derivatives."""
    read = {"t", *(column for name in parts for column in log.layout.columns_of(name)), *LOG_ARRAYS["quat_xyzw"]}
    for column in log.columns:
        if column not in read:
            of_pair = "samples of x, y, z, of an attitude and of psi"
            wanted = of_pair if subject.pair is not None else "coordinates of joints alone"
            log.refuse(column, f"{wanted}, since motion.smooth is true", "a column")
    samples: dict[str, Any] = {name: parts[name][name] for name in subject.names if name in parts}
    if attitude:
        turns = parts[attitude[0]][attitude[0]]
        S1 = np.asarray(euler_to_matrix(turns, sequence)) if attitude is _EULER else log.rotations(turns)
        samples = {"body": BodyMotion(R=parts["R1"]["R1"], S=S1), **samples}
    found = dict(zip(samples, smoothed(table, log, samples), strict=True))
    sure = _sure_instants(log, [*found.values()])
    base_functions, _ = (None, None) if attitude else read_base(table, subject)
    base = found.pop("body") if attitude else base_at(base_functions, sequence, log.t, ACCELERATION)
    if isinstance(base, BodyMotion):
        base = BodyMotion(**{letter: getattr(base, letter) for letter in ("R", "S", "v", "omega", "a", "alpha")})
    rests = subject.rests
    joints = tuple(
        tuple(
            _float_if_constant(np.asarray(found[name][k])) if name in found else rests[name] * (k == 0)
            for name in subject.names
        )
        for k in range(3)
    )
    is_pair = subject.pair is not None
    return Motion(
        t=log.t,
        source=Known(subject.names, log.t.size, joints, base),
        origin="samples in a file" if is_pair else "samples in a file, smoothed, with their rates",
        how="smoothed, with their rates" if is_pair else "",
        notes=tuple(log.notes),
        functions=() if base_functions is None else (base_functions,),
        moving=tuple(found),
        sure=sure,
    )


def _sure_instants(log: Log, found: list[Any]) -> NDArray[np.bool_]:
    """Return at which instants the standard deviations of second derivatives are not those of ends and gaps, and add
    a note on the others.
    """
    sure = np.ones(log.t.size, dtype=bool)
    for one in found:
        if isinstance(one, BodyMotion) or hasattr(one, "std"):
            for name in ("a", "alpha", "psidd"):
                std = np.asarray(one.std.get(name, np.zeros(log.t.size))).reshape(log.t.size, -1)[:, 0]
                sure &= ~(std > 2 * np.nanmedian(std))
    lost = ~sure & np.isfinite(log.t)
    if sure.any() and lost.any():
        inside = np.flatnonzero(sure)
        log.notes.append(
            "rates at the ends of what is smoothed are inaccurate: their smallest and largest are from "
            f"t = {log.t[inside[0]]:.6g} to {log.t[inside[-1]]:.6g} s"
        )
    return sure


def smoothed(table: Table, log: Log, samples: Mapping[str, BodyMotion | Float64Array]) -> list[Any]:
    """Smooth samples of a log with the options of [motion]; the log's notes tell of noise and of missing samples.

    Returns:
        For each of the samples, what `smooth` returns for a BodyMotion, or three arrays (N,): the smoothed column and
        its derivatives.
    """
    loss = table.choice("loss", tuple(LOSSES))
    gaps = table.number("gaps") if "gaps" in table.values else None
    with table.naming():
        longest = longest_filled(log.since, gaps)
    found, texts, noise = [], [], []
    quantities: dict[str, tuple[NDArray[Any], NDArray[Any] | None]] = {}
    for name, own in samples.items():
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", MeasurementWarning)
            try:
                with log.naming(body=name):
                    result = _smooth(log, name, own, longest, loss)
            except SceneError as error:
                if not log.angle_doubts:
                    raise
                doubt = log.angle_doubts[0]
                raise SceneError(error.name, "angles in radians", f"probably degrees: {doubt}") from None
        said = [re.sub(r"\bbody\b|^angle(?=:)", name, str(warning.message)) for warning in caught]
        texts += [text for text in said if not (log.angle_doubts and "numpy.radians" in text)]  # said already
        if isinstance(own, BodyMotion):
            noise += [f"{result.noise['R']:.2g} m of position", f"{result.noise['S']:.2g} rad of attitude"]
            quantities |= {"position": (own.R, result.R), "attitude": (own.S, result.S)}
        else:
            *result, deviation = result
            noise.append(f"{deviation:.2g} {log.layout.unit_of(name)} of {name}")
            quantities[name] = own, result[0]
        found.append(result)
    for name, (recorded, result) in quantities.items():
        log.notes += _missing_sample_sentences(name, log.t, recorded, result)
    log.notes += _cut_sentences(log.t, {name: recorded for name, (recorded, _) in quantities.items()}, longest)
    log.notes.append(f"smoothed: noise of {', '.join(noise)} (standard deviation of a component)")
    python = re.compile(r"""hingepair\.smooth with the loss (["']\w+["'])""")
    texts = [python.sub(r"loss = \1 in [motion]", text) for text in texts]
    log.notes = list(dict.fromkeys((*log.notes, *texts)))
    return found


def _smooth(log: Log, name: str, samples: BodyMotion | Float64Array, gaps: float, loss: str) -> Any:
    """Return what `smooth` makes of a body; of a column itself, its derivatives, and the deviation of its noise."""
    if isinstance(samples, BodyMotion):
        return smooth(log.since, samples, gaps=gaps, loss=loss)
    if log.layout.unit_of(name) == "rad":
        angle = smooth(log.since, samples, gaps=gaps, loss=loss)
        return *angle, angle.noise["psi"]
    # The shift of a slider is no angle, whose jumps might be whole turns: it is smoothed as a position.
    zero = np.zeros_like(samples)
    body = BodyMotion(R=np.column_stack((samples, zero, zero)), S=np.broadcast_to(np.eye(3), (samples.size, 3, 3)))
    moved = smooth(log.since, body, gaps=gaps, loss=loss)
    return *(np.asarray(array)[:, 0] for array in (moved.R, moved.v, moved.a)), moved.noise["R"]


def _missing_sample_sentences(
    name: str, t: Float64Array, samples: NDArray[Any], result: NDArray[Any] | None
) -> list[str]:
    """Return sentences on the samples that are not finite, those that the smoothed `result` fills and the others."""
    is_missing = ~np.isfinite(samples.reshape(len(t), -1)).all(axis=1)
    is_filled = is_missing & np.isfinite(np.asarray(result).reshape(len(t), -1)).all(axis=1)
    sentences = []
    for rows, verdict in ((is_filled, "filled"), (is_missing & ~is_filled, "not filled, in gaps that are too long")):
        if count := int(rows.sum()):
            first = f"the first at t = {t[rows][0]:.6g} s"
            sentences.append(f"{name}: {count} of {len(t)} samples missing and {verdict}; {first}")
    return sentences


def _cut_sentences(t: Float64Array, samples_by_name: Mapping[str, NDArray[Any]], gaps: float) -> list[str]:
    """Return sentences on the gaps [s] that cut the smoothing of a log, and on samples between them that are too few
    to be smoothed. Each begins with the names of the quantities.
    """
    names_by_sentence: dict[str, list[str]] = {}
    for name, samples in samples_by_name.items():
        is_known = np.asarray(np.isfinite(samples.reshape(len(t), -1)).all(axis=1))
        pieces = split_at_gaps(t, is_known, gaps)
        if len(pieces) > 1:
            cuts = [f"{t[a[-1]]:.6g} to {t[b[0]]:.6g} s" for a, b in pairwise(pieces)]
            more = f" and in {len(cuts) - 3} more gaps" if len(cuts) > 3 else ""
            sentence = (
                f"smoothing is cut, with no samples from {', '.join(cuts[:3])}{more}; rates beside a cut are as "
                "inaccurate as at the ends. gaps in [motion] is the longest time that is filled [s]"
            )
            names_by_sentence.setdefault(sentence, []).append(name)
        if short := [piece for piece in pieces if piece.size < MIN_PIECE]:
            sentence = (
                f"samples recorded but left out, in series of fewer than {MIN_PIECE} between gaps: "
                f"{sum(piece.size for piece in short)}; the first at t = {t[short[0][0]]:.6g} s"
            )
            names_by_sentence.setdefault(sentence, []).append(name)
    return [f"{', '.join(names)}: {sentence}" for sentence, names in names_by_sentence.items()]


def _integrate_rates(table: Table, log: Log) -> Motion:
    """Return the motion by rates (E12); without columns of its position, body 1 stays at the origin."""
    rates = (
        _QUATERNION[1:],
        HINGE_NAMES[1:],
    )
    quantities = (name for names in (_POSITION, *rates) for name in names)
    read = {"t", *(column for name in quantities for column in log.layout.columns_of(name))}
    for column in log.columns:
        if column not in read:
            log.refuse(column, "columns of rates and of R1, since motion.integrate is true", "a column")
    turning, hinge = (log.quantity_and_rates(names) for names in rates)
    for part in (turning, hinge):
        name, array = next(iter(part.items()))
        log.check_finite(name, array, "integrated")
    position = log.quantity_and_rates(
        _POSITION,
        required=any(column in log.columns for column in (*LOG_ARRAYS["v1"], *LOG_ARRAYS["a1"])),
    )
    if not position:
        position = dict.fromkeys(_POSITION, np.zeros((log.t.size, 3)))
    if "v1" not in position:
        log.refuse("v1_x", "a column, since the log has x", "no such column")
    _velocity_frame(table, log)
    arrays = position | turning | hinge
    signals = (
        SampledSignal(log.since, arrays["omega1"]),
        SampledSignal(log.since, arrays["psid"]),
    )
    return replace(integrate_motion(table, log.since, signals, arrays, notes=tuple(log.notes)), t=log.t)


def _attitude_names(log: Log, *, required: bool) -> tuple[str, ...]:
    """Return _EULER or _QUATERNION, whichever the log has; refuse both and, if `required`, neither."""
    euler = any(column in log.columns for column in LOG_ARRAYS["phi"])
    attitude_names, other_names = (_EULER, _QUATERNION) if euler else (_QUATERNION, _EULER)
    if not euler and not any(column in log.columns for column in LOG_ARRAYS["quat_xyzw"]):
        if not required and not any(column in log.columns for column in LOG_ARRAYS["R1"]):
            return ()
        hint = ", or motion.integrate = true for a log of rates" if "omega1_x" in log.columns else ""
        log.refuse("phi_x", f"columns phi_x, phi_y, phi_z, or qx, qy, qz, qw{hint}", "neither")
    for column in (column for name in other_names for column in LOG_ARRAYS[name]):
        if column in log.columns:
            log.refuse(column, f"no such column in a log with {LOG_ARRAYS[attitude_names[0]][0]}", "a column")
    return attitude_names


def _highest_derivative(log: Log, groups: tuple[tuple[str, ...], ...], parts: Mapping[str, Part]) -> int:
    """Return the highest derivative order, 0 to 2, that any quantity has; refuse a log in which another lacks it."""
    level = max(i for names in groups for i in range(3) if names[i] in parts[names[0]])
    for names in groups:
        for name in names[: level + 1]:
            if name not in parts[names[0]]:
                column = log.layout.columns_of(name)[0]
                log.refuse(column, "a column, since the log has other rates", "no such column")
    return level


def _columns(position: Float64Array, angles: Float64Array) -> tuple[float | Float64Array, ...]:
    """Return the columns of position (N, 3) and Euler angles (N, 3); floats for what does not change."""
    return tuple(_float_if_constant(column) for column in np.column_stack((position, angles)).T)


def _float_if_constant(column: Float64Array) -> float | Float64Array:
    """Return a column, or one float if all its values are equal."""
    column = np.ascontiguousarray(column)
    return float(column[0]) if (column == column[0]).all() else column
