"""Motion by a log: what a file of samples says; on request derivatives are found from it, or rates integrated.

docs/scenes.md lists the columns. Others are refused: a misspelt one would be missed.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import choices, nearest
from hingepair.integration.integrate import FRAMES
from hingepair.integration.signals import SampledSignal
from hingepair.integration.trajectory import rotate_to_world
from hingepair.measured.smooth import smooth
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.numeric.column_file import ColumnRequest, csv_column, read_columns
from hingepair.numeric.finite_differences import differentiate
from hingepair.numeric.instants import MeasurementWarning, instants_of
from hingepair.numeric.suspicions import angle_suspicions, instant_suspicions
from hingepair.numeric.wrapped_angles import is_wrapped
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.evaluate import AUTO
from hingepair.plans.plan import PLANAR, SPATIAL
from hingepair.plans.steps import COLUMN_NAMES, COORDINATES
from hingepair.rotations.angular_velocity import angular_velocity_from_samples
from hingepair.rotations.euler import euler_to_matrix
from hingepair.rotations.matrices import quaternion_to_matrix
from hingepair.rotations.sequences import SEQUENCES
from hingepair.scenes.integrated_motion import START, integrated
from hingepair.scenes.known_motion import ByCoordinates, by_body1
from hingepair.scenes.motion import Given, Motion, turns_about
from hingepair.scenes.tables import Place, Table

ORDER: Final = 6
"""Of the derivatives in the step between samples."""

ARRAYS: Final[dict[str, tuple[str, ...]]] = {
    "R1": ("x", "y", "z"),
    "quat_xyzw": ("qx", "qy", "qz", "qw"),
    "quat_wxyz": ("qw", "qx", "qy", "qz"),
    **{v: (f"{v}_x", f"{v}_y", f"{v}_z") for v in ("phi", "phid", "phidd", "v1", "a1", "omega1", "alpha1")},
    **COLUMN_NAMES[COORDINATES],
}
"""Array -> its columns."""
PAIR_LOG_COLUMNS: Final = tuple(dict.fromkeys(("t", *(column for own in ARRAYS.values() for column in own))))
"""Names of all columns that a log of a pair may have: t and the columns of the arrays."""

Part: TypeAlias = dict[str, Float64Array]
"""A quantity and its derivatives by name, as far as they are known; shape (N, k) each."""


class Layout(NamedTuple):
    """Columns that a log may have.

    Attributes:
        arrays: columns of each array, by name; what is in no array is a column by itself.
        columns: all of them.
        angles: the arrays and columns that hold angles.
        results: what the names of columns of results begin with, up to the first `_`.
        written: how `hingepair run` writes such a log, for messages.
    """

    arrays: Mapping[str, tuple[str, ...]]
    columns: tuple[str, ...]
    angles: frozenset[str]
    results: frozenset[str]
    written: str

    def columns_of(self, name: str) -> tuple[str, ...]:
        """Return the names of the columns of an array; what is no array is a column itself."""
        return self.arrays.get(name, (name,))


_PAIR_LOG_LAYOUT: Final = Layout(
    ARRAYS,
    PAIR_LOG_COLUMNS,
    frozenset({"phi", "psi"}),
    frozenset({*SPATIAL.levels, *PLANAR.levels}),
    "run --outputs q,qd,qdd --out FILE writes what is read here",
)
"""Layout of the log of a pair: its angles, its results and the command that writes it."""
_POSITION_ARRAYS = ("R1", "v1", "a1")
"""Arrays of a log with the position of body 1 [m] and its derivatives [m/s, m/s^2]."""
_HINGE_COLUMNS = ("psi", "psid", "psidd")
"""Columns of a log with the hinge angle [rad] and its derivatives [rad/s, rad/s^2]."""
_EULER_ARRAYS = ("phi", "phid", "phidd")
"""Arrays of a log with the Euler angles of body 1 [rad] and their derivatives [rad/s, rad/s^2]."""
_QUATERNION_ARRAYS = ("quat_xyzw", "omega1", "alpha1")
"""Arrays of a log with the quaternion of body 1, its angular velocity [rad/s] and acceleration [rad/s^2]."""
_MIN_ROUNDED_INSTANT: Final = 1e5  # s: from here on instants are rounded to more than 1e-11 s


def read_log(table: Table, folder: Path) -> Motion:
    """Return the motion in the file that the table [motion] names, relative to a folder."""
    integrated, completed = table.flag("integrate"), table.flag("differentiate")
    start = (*START, "S1_0")
    for key in start:
        if key in table.values and not integrated:
            table.fail(key, "integrate = true beside it, as a log of rates has, or no such key")
    unwrap = table.flag("unwrap") if "unwrap" in table.values else None
    if unwrap is not None and (integrated or not completed):
        wanted = "differentiate = true" if not integrated else "a log with angles"
        table.fail("unwrap", f"{wanted} beside it, or no such key: it decides how angles are differentiated")
    keys = start if integrated else ("sequence", "unwrap")
    table.check_keys(("file", "differentiate", "integrate", "smooth", "frame", *keys))
    smoothed = table.flag("smooth")
    if smoothed and (integrated or completed):
        table.fail("smooth", "neither differentiate nor integrate beside it: it finds all rates itself")
    log = Log(log_file(table, folder), _PAIR_LOG_LAYOUT, completed, unwrap)
    if smoothed:
        return _smoothed_motion(table, log)
    return _integrated(table, log) if integrated else _stated(table, log)


def log_file(table: Table, folder: Path) -> Path:
    """Return the path of the file that [motion] names, relative to a folder; refuse one that is not there."""
    file = folder / table.text("file")
    if not os.path.isfile(file):  # of a name that is too long Path.is_file would raise
        table.refuse("file", "a file of samples that can be read", f"no such file: {file}")
    return file


def _frame(table: Table, log: Log) -> str:
    """Return the axes of a log's angular velocities, which the table must name; "world" where the log has none."""
    rates = [column for name in _QUATERNION_ARRAYS[1:] for column in ARRAYS[name] if column in log.columns]
    if "frame" in table.values and not rates:
        table.fail("frame", "no such key, since the log has no omega1_x, omega1_y, omega1_z")
    if rates and "frame" not in table.values:
        axes = 'those of body 1, as a gyroscope has them, or "world", as hingepair writes them'
        table.fail("frame", f'the axes of {rates[0].partition("_")[0]} in the log: "body", {axes}')
    return table.choice("frame", FRAMES)


class Log(Place):
    """The columns of a file, and derivatives of them.

    Args:
        path: the file.
        layout: what its columns may be.
        completed: whether derivatives that the file lacks are found by finite differences.
        unwrap: whether angles are unwrapped before; None where they are if they jump by whole turns.

    Attributes:
        derived: names of the derivatives that were found by finite differences.
        notes: sentences on instants, on angles that were unwrapped or may have to be, and on units.
    """

    def __init__(self, path: Path, layout: Layout, completed: bool, unwrap: bool | None) -> None:
        super().__init__(str(path) if str(path).isprintable() else repr(str(path)), "")
        self.layout = layout
        self.completed = completed
        self.unwrap = unwrap
        self.hint = "" if completed else "; motion.differentiate = true gives the others"
        self.derived: list[str] = []
        self.notes: list[str] = []
        kind = path.suffix.lower()
        known = (*layout.arrays, *layout.columns) if kind == ".npz" else layout.columns
        wanted = ColumnRequest(
            lambda names: self._checked(names, known), lambda name, _: layout.arrays.get(name, name), exact="t"
        )
        with self.naming():
            self.columns = read_columns(path, wanted)
            if "t" not in self.columns:
                self.refuse("t", "a column", "no such column")
            stamps = self.columns["t"]
            t = instants_of("t", stamps, ORDER if completed else 0)
            late = kind == ".csv" and abs(t[0]) > _MIN_ROUNDED_INSTANT
            instants = csv_column(path, "t", np.longdouble) if late else t
        if stamps.dtype.kind in "mM" or float(stamps[0]) != t[0]:
            unit = "" if stamps.dtype.kind in "mM" else " ns"
            self.notes.append(f"t is counted from the first stamp of the log, {stamps[0]}{unit}")
        self.notes += instant_suspicions("t", t)
        self.t = np.asarray(read_only(t))
        self.since = np.asarray(instants - instants[0], dtype=np.float64)

    def _checked(self, names: list[str], known: tuple[str, ...]) -> list[str]:
        """Return the names of the columns; refuse one that is not known or comes twice."""
        for i, name in enumerate(names):
            if name not in known:
                got = f"an unknown column{nearest(name, known)}"
                if name.partition("_")[0] in self.layout.results:
                    got = f"a column of results, which are no motion ({self.layout.written})"
                self.refuse(repr(name[:40]), choices(known), got)
            if name in names[:i]:
                self.refuse(name, "a column once", "a second one")
        return names

    def part(self, names: tuple[str, ...], required: bool = True) -> Part:
        """Return a quantity and its derivatives: those in the file and, with differentiate = true, the others.

        What is missing is the derivative (order 6) of the highest that is there: of the rates, or twice of positions,
        angles and attitudes.
        """
        found = {}
        for i, name in enumerate(names):
            array = self._together(name, required and i == 0)
            if array is not None:
                found[name] = array
        if self.completed and names[0] in found:
            for i, name in enumerate(names[1:]):
                if name not in found:
                    derivatives = self._derivatives(names[i], found[names[i]])
                    for key, derivative in zip(names[i + 1 :], derivatives, strict=False):
                        if key not in found:
                            found[key] = derivative
                            self.derived.append(key)
        return {name: array if name in self.layout.arrays else array[:, 0] for name, array in found.items()}

    def _together(self, name: str, required: bool) -> NDArray[np.float64] | None:
        """Return the columns of an array side by side; None where none of them is there and none need be."""
        own = self.layout.columns_of(name)
        there = [column for column in own if column in self.columns]
        if not there and not required:
            return None
        for column in own:
            if column not in self.columns:
                self.refuse(column, f"a column beside {there[0]}" if there else "a column", "no such column")
        return np.stack([self.columns[column] for column in own], axis=-1)

    def finite(self, name: str, array: Float64Array, use: str) -> None:
        """Refuse numbers that are not finite."""
        columns = array.reshape(len(array), -1)
        for sample, i in np.argwhere(~np.isfinite(columns))[:1]:
            got = f"{columns[sample, i]} at sample {sample}"
            self.refuse(self.layout.columns_of(name)[i], f"finite numbers, to be {use}", got)

    def rotations(self, quat_xyzw: Float64Array) -> Float64Array:
        """Return the rotation matrices of quaternions; refuse one that is zero."""
        zero = np.flatnonzero((quat_xyzw == 0).all(axis=-1))
        if zero.size:
            self.refuse("qx, qy, qz, qw", "quaternions that are not zero", f"a zero quaternion at sample {zero[0]}")
        return np.asarray(quaternion_to_matrix("quat_xyzw", quat_xyzw, scalar_first=False))

    def _derivatives(self, name: str, array: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return the first and second derivatives of columns; of an attitude, omega and alpha."""
        self.finite(name, array, "differentiated")
        if name == "quat_xyzw":
            with self.naming(", ".join(ARRAYS[name])):
                omega, alpha = angular_velocity_from_samples(
                    self.since, self.rotations(array), ORDER, with_alpha=True
                )
            return np.asarray(omega), np.asarray(alpha)
        columns = list(array.T)
        if name in self.layout.angles:
            named = zip(self.layout.columns_of(name), columns, strict=True)
            columns = [self._continuous(*own) for own in named]
        found = [differentiate(self.since, column, ORDER) for column in columns]
        return np.stack([first for first, _ in found], axis=-1), np.stack([second for _, second in found], axis=-1)

    def _continuous(self, name: str, angles: Float64Array) -> Float64Array:
        """Return a column of angles [rad] to be differentiated, unwrapped or as it stands, and note which."""
        jumps = np.abs(np.diff(angles))
        jumps = jumps[jumps > np.pi]
        unwrap = self.unwrap
        if unwrap is None and jumps.size:
            unwrap = is_wrapped(angles)
            if unwrap:
                times = f"at {jumps.size} instants" if jumps.size > 1 else "once"
                self.notes.append(
                    f"{name} jumps by about a whole turn {times} and was unwrapped before it was differentiated; "
                    "unwrap = false takes it as it stands"
                )
            else:
                self.notes.append(
                    f"{name} changes by up to {jumps.max():.3g} rad between samples and was differentiated as it "
                    "stands; unwrap = true takes changes of more than half a turn for jumps by 2 pi"
                )
        return np.unwrap(angles) if unwrap else angles

    def lacking_errors(self) -> str:
        """Return a sentence on the derivatives that were found by finite differences; an empty text without any."""
        if not self.derived:
            return ""
        be = "were" if len(self.derived) > 1 else "was"
        return f"{', '.join(self.derived)} {be} found by finite differences; how far off is not known"


def _stated(table: Table, log: Log) -> Motion:
    """Return the motion that the file states: position, attitude, hinge angle."""
    attitude = _attitude(log)
    if attitude is _QUATERNION_ARRAYS and "sequence" in table.values:
        table.fail("sequence", "nothing, since the file has quaternions")
    parts = {names: log.part(names) for names in (_POSITION_ARRAYS, attitude, _HINGE_COLUMNS)}
    level, frame = _highest_derivative(log, parts), _frame(table, log)
    for name in (*(ARRAYS["phi"] if attitude is _EULER_ARRAYS else ()), "psi"):
        log.notes += angle_suspicions(name, log.columns[name])
    sequence = table.choice("sequence", SEQUENCES, "XYZ")
    given: Given
    if attitude is _EULER_ARRAYS:
        rows = tuple(_seven([part[names[i]] for names, part in parts.items()]) for i in range(level + 1))
        given, how = ByCoordinates(log.t.size, rows, sequence), turns_about(sequence)
    else:
        known = {name: array for part in parts.values() for name, array in part.items()}
        known["S1"] = log.rotations(known["quat_xyzw"])
        if frame == "body":  # of what was found from quaternions, omega1 is in world axes already
            start = 1 if "omega1" not in log.derived else 2
            own = [name for name in _QUATERNION_ARRAYS[start:] if name in known]
            known |= {name: rotate_to_world(known["S1"], known[name]) for name in own}
        given, how = by_body1(known), "attitude as quaternions"
    how += ", rates by finite differences" * bool(log.derived)
    doubt, notes, derived = log.lacking_errors(), tuple(log.notes), tuple(log.derived)
    return Motion(log.t, given, "samples in a file", how, {}, doubt, log.hint, notes=notes, derived=derived)


def _smoothed_motion(table: Table, log: Log) -> Motion:
    """Return the motion of noisy samples of position, attitude and psi, smoothed, with all rates."""
    attitude = _attitude(log)
    read = {
        "t",
        *(
            column
            for names in (_POSITION_ARRAYS, attitude, _HINGE_COLUMNS)
            for column in ARRAYS.get(names[0], names[:1])
        ),
    }
    for column in log.columns:
        if column not in read:
            log.refuse(
                column, "samples of x, y, z, of an attitude and of psi, since motion.smooth is true", "a column"
            )
    table.check_keys(("file", "smooth", *(("sequence",) if attitude is _EULER_ARRAYS else ())))
    R1, turns, psi = (log.part(names)[names[0]] for names in (_POSITION_ARRAYS, attitude, _HINGE_COLUMNS))
    if attitude is _EULER_ARRAYS:
        S1 = np.asarray(euler_to_matrix(turns, table.choice("sequence", SEQUENCES, "XYZ")))
    else:
        S1 = log.rotations(turns)
    with warnings.catch_warnings(record=True) as caught, log.naming():
        warnings.simplefilter("always", MeasurementWarning)
        body, angle = smooth(log.since, BodyMotion(R=R1, S=S1)), smooth(log.since, psi)
    known = {f"{name}1": getattr(body, name) for name in ("R", "v", "a", "S", "omega", "alpha")}
    known |= {name: getattr(angle, name) for name in _HINGE_COLUMNS}
    deviations = {
        "position": (body.noise["R"], "m"),
        "attitude": (body.noise["S"], "rad"),
        "psi": (angle.noise["psi"], "rad"),
    }
    noise = ", ".join(f"{size:.2g} {unit} of {name}" for name, (size, unit) in deviations.items())
    texts = dict.fromkeys(str(warning.message) for warning in caught)
    notes = (*log.notes, f"smoothed: noise of {noise} (standard deviation of a component)", *texts)
    names = tuple(name for name in known if name not in {"R1", "S1", "psi"})
    return Motion(
        log.t,
        by_body1(known),
        "samples in a file",
        "smoothed, with their rates",
        {},
        "",
        "",
        notes=notes,
        derived=names,
    )


def _integrated(table: Table, log: Log) -> Motion:
    """Return the motion whose rates the file states, integrated (E12)."""
    rates = (_QUATERNION_ARRAYS[1:], _HINGE_COLUMNS[1:])
    quantities = (name for names in (_POSITION_ARRAYS, *rates) for name in names)
    read = {"t", *(column for name in quantities for column in log.layout.columns_of(name))}
    for column in log.columns:
        if column not in read:
            log.refuse(column, "columns of rates and of R1, since motion.integrate is true", "a column")
    turning, hinge = (log.part(names) for names in rates)
    for part in (turning, hinge):
        name, array = next(iter(part.items()))
        log.finite(name, array, "integrated")
    position = log.part(
        _POSITION_ARRAYS, required=any(column in log.columns for column in (*ARRAYS["v1"], *ARRAYS["a1"]))
    )
    if not position:
        position = dict.fromkeys(_POSITION_ARRAYS, np.zeros((log.t.size, 3)))
    if "v1" not in position:
        log.refuse("v1_x", "a column beside x (or differentiate = true)", "no such column")
    _frame(table, log)
    known = position | turning | hinge
    signals = SampledSignal(log.since, known["omega1"], AUTO), SampledSignal(log.since, known["psid"], AUTO)
    notes = (*log.notes, *filter(None, [log.lacking_errors()]))
    return replace(
        integrated(table, log.since, signals, known, hint=log.hint, notes=notes), t=log.t, derived=tuple(log.derived)
    )


def _attitude(log: Log) -> tuple[str, ...]:
    """Return the names of the attitude and its rates, angles or quaternions; refuse columns of the other kind."""
    euler = any(column in log.columns for column in ARRAYS["phi"])
    own, other = (_EULER_ARRAYS, _QUATERNION_ARRAYS) if euler else (_QUATERNION_ARRAYS, _EULER_ARRAYS)
    if not euler and not any(column in log.columns for column in ARRAYS["quat_xyzw"]):
        hint = ", or motion.integrate = true for a log of rates" if "omega1_x" in log.columns else ""
        log.refuse("phi_x", f"columns phi_x, phi_y, phi_z, or qx, qy, qz, qw{hint}", "neither")
    for column in (column for name in other for column in ARRAYS[name]):
        if column in log.columns:
            log.refuse(column, f"nothing of this kind beside {ARRAYS[own[0]][0]}", "a column")
    return own


def _highest_derivative(log: Log, parts: dict[tuple[str, ...], Part]) -> int:
    """Return the highest derivative of the motion; refuse derivatives of some parts without those of the others."""
    level = max(i for names, part in parts.items() for i in range(3) if names[i] in part)
    for names, part in parts.items():
        for name in names[: level + 1]:
            if name not in part:
                column = log.layout.columns_of(name)[0]
                log.refuse(column, "a column, beside rates of others (or differentiate = true)", "no such column")
    return level


def _seven(parts: list[Float64Array]) -> tuple[float | Float64Array, ...]:
    """Return the seven coordinates, those that never change as one number."""
    columns = [np.ascontiguousarray(column) for column in np.column_stack(parts).T]
    return tuple(float(column[0]) if (column == column[0]).all() else column for column in columns)
