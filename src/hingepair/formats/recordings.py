"""Recordings of two bodies, and of the joints of a robot: from files or tables in memory, brought to one clock.

Results that were saved with R1, S1, R2, S2 can be read as they are. Columns of no concern have to be named, so that a
misspelt one is not missed; rates, angles and psi are passed over.
"""

from __future__ import annotations

import contextlib
import fnmatch
import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations.quantities import unit_of
from hingepair.errors import ArgumentError, RotationError, nearest, nearest_name
from hingepair.measured.imus import ImuRecording
from hingepair.measured.smoothing.resample import resample
from hingepair.measured.smoothing.smooth import smooth
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.numeric.arrays import Float64Array, check_choice
from hingepair.rotations.euler import euler_to_matrix
from hingepair.rotations.matrices import project_to_rotation
from hingepair.rotations.sequences import SEQUENCE_NAMES
from hingepair.tables.column_tables import ColumnTable
from hingepair.tables.data_frames import column_names
from hingepair.tables.instants import checked_gaps, increasing_seconds, warn_of_measurements
from hingepair.tables.recorded_columns import (
    Vocabulary,
    check_sources,
    doubts_about_angles,
    headings_among,
    open_columns,
    planar_zeros,
    read_recorded,
    read_sources,
)
from hingepair.tables.units import SCALES, read_heading

# Columns that results have and a recording of poses does not need.
_IGNORED_COLUMNS = re.compile(r"(v|omega|a|alpha|d|q|qd|qdd|phi|phid|phidd)[12]?(_[xyz])?|psi(d|dd)?[12]?")

# Names, in small letters, that other recorders give the column t.
_TIME_ALIASES = frozenset({"time", "times", "timestamp", "stamp", "seconds", "sec", "time_s", "t_s"})
# Names, in small letters, that other recorders give the columns x, y, z, x1 and so on.
_POSITION_ALIAS = re.compile(r"p(?:os(?:ition)?)?_?([xyz])([12]?)")


class Recording(NamedTuple):
    """Recorded poses of one body or two at common instants, NaN where not recorded.

    Attributes:
        body1: BodyMotion of body 1; shape (N,).
        body2: BodyMotion of body 2; None if one body was recorded.
        t: instants as the log has them, seconds, nanoseconds or dates; shape (N,); None if it has none.
    """

    body1: BodyMotion
    body2: BodyMotion | None
    t: NDArray[Any] | None


class ColumnAdvice(NamedTuple):
    """How a caller names columns: templates for messages on a column `name` that is `ours` here."""

    columns: str
    columns_with_unit: str
    ignore: str

    def degrees(self, name: str, headings: Collection[str]) -> str:
        """Return how a caller states that the angle `name` is in degrees, and one of `headings` one of a compass."""
        stated = self.columns_with_unit.format(ours=name, name="COLUMN", unit="deg")
        compass = ' ("compass" in place of "deg" for headings clockwise from north)'
        return stated + compass * (name in headings)


# By the arguments of `read_recording`.
_IN_PYTHON: Final = ColumnAdvice(
    "columns={{{ours!r}: {name!r}}}",
    "columns={{{ours!r}: {{'name': {name!r}, 'unit': {unit!r}}}}}",
    "ignore=[{name!r}]",
)


class _RecordedBody(NamedTuple):
    """Motion of one body, with what stands in its file; None for columns that the file lacks."""

    motion: BodyMotion
    t: NDArray[Any] | None
    path: ColumnTable


def read_recording(
    *sources: Any,
    columns: Mapping[str, str | Mapping[str, str]] | None = None,
    ignore: Sequence[str] = (),
    gaps: float = 0.05,
    sequence: str | None = None,
) -> Recording:
    """Read the recorded poses of one body or of two, for `fit`, `smooth` and `resample`.

    Args:
        *sources: one recording, or one of each body: path of a .csv, .npz or .parquet file, pandas DataFrame, xarray
            Dataset or dict of arrays. Columns of body 1 are `R1_x, R1_y, R1_z` or `x1, y1, z1` [m], and `S1_xx,
            S1_xy, ..., S1_zz`, `qx1, qy1, qz1, qw1` (qw1 the scalar) or Euler angles `phi_x1, phi_y1, phi_z1` [rad];
            those of body 2 have a 2. A recording of one body may leave the digit away, and one of a motion in the
            plane has `x1, y1, phi_z1` alone. `t` are seconds, nanoseconds since 1970 (integers) or dates; the index
            of a DataFrame may have it. Vectors may be whole arrays, such as `R1` of shape (N, 3).
        columns: names and units of columns that have others: {"t": "Zeit", "x1": {"name": "Ost", "unit": "mm"}}.
            The unit "compass" is that of headings: degrees, clockwise from north (y), of the angle that turns about
            z, which is phi_z1 unless `sequence` says otherwise. {"t": {"name": "Frame", "rate": "100 Hz"}} makes
            instants of frame numbers. Of other columns, "delay" ("0.12 s") is how late they are, and "rate" says
            how often they were sampled where rows between repeat the last sample or are empty; they are then
            interpolated to the instants of the rows. Columns of names that are unknown are then not read.
        ignore: names of columns that are not read; `*` stands for any text.
        gaps: longest time between samples over which one body is interpolated to the instants of the other [s].
        sequence: axes about which phi_x, phi_y, phi_z turn, such as "ZYX" of yaw, pitch and roll, in capitals about
            the body's own axes; by default "XYZ".

    Returns:
        The Recording: body1, body2 and t. The bodies have the instants of the one with the longer time
        steps. Empty cells and attitudes of zeros are missing samples, NaN. Body 2, or a body alone, whose attitude
        was not recorded is a point.

    Raises:
        ArgumentError: a file or a column cannot be used.
        MeasurementWarning: angles are probably in degrees.
        MissingDependencyError: a source is a .parquet file and PyArrow is not installed.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> log = {"time": [0, 1000, 2000], "x": [1, 2, 3], "y": 0 * np.ones(3), "z": 0 * np.ones(3)}
    >>> log |= {"qx": [0, 0, 0], "qy": [0, 0, 0], "qz": [0, 0, 0], "qw": [1, 1, 1]}
    >>> recording = hp.read_recording(log, columns={"t": {"name": "time", "unit": "ms"}})
    >>> recording.t, recording.body1.R[2]
    (array([0., 1., 2.]), array([3., 0., 0.]))
    """
    return read_poses(sources, columns, ignore, gaps, sequence, _IN_PYTHON)


def read_poses(
    sources: Sequence[Any],
    columns: Mapping[str, str | Mapping[str, str]] | None,
    ignore: Sequence[str],
    gaps: float,
    sequence: str | None,
    advice: ColumnAdvice,
) -> Recording:
    """Read recorded poses as `read_recording` does; messages on unknown columns take their words from `advice`."""
    if not 1 <= len(sources) <= 2:
        raise ArgumentError("sources", "one recording, or one of each body", f"{len(sources)}")
    tables = []
    for source in sources:
        with _naming(source):
            tables.append(open_columns(source))
    if sequence is not None:
        check_choice("sequence", sequence, SEQUENCE_NAMES)
    return _read_recording(tables, columns or {}, ignore, checked_gaps(gaps), sequence, advice)


@contextlib.contextmanager
def _naming(source: object) -> Iterator[None]:
    """Name a file, or a table by its kind, in the errors of the block."""
    try:
        yield
    except ArgumentError as error:
        if error.name == "sources":
            raise
        file = str(source) if isinstance(source, str | os.PathLike | ColumnTable) else type(source).__name__
        name = ": ".join(filter(None, (file, error.name)))
        raise ArgumentError(name, error.expected, error.got) from None


def _read_recording(
    paths: Sequence[ColumnTable],
    columns_by_name: Mapping[str, Any],
    ignored_columns: Sequence[str],
    max_gap: float,
    sequence: str | None,
    advice: ColumnAdvice,
) -> Recording:
    """Return the Recording of one or two files or tables, on one clock; refuse one without body 1 or body 2."""
    headings = _headings(sequence or "XYZ")
    bodies: dict[str, _RecordedBody] = {}
    has_angles = False
    is_alone = len(paths) == 1
    vocabulary = Vocabulary(_POSE_COLUMNS, unit_of, _component_names, headings)
    sources = read_sources(columns_by_name, vocabulary, {k: v for path in paths for k, v in path.units.items()})
    with _naming(paths[-1]):  # either recording may have a column
        check_sources(sources, [name for path in paths for name in path.shapes])
    for place, path in enumerate(paths, start=1):
        own = {name: source for name, source in sources.items() if source.column in path.shapes}
        taken = {source.column for source in own.values()}

        def choose(names: list[str], taken: Collection[str] = taken) -> list[str]:
            if sources:  # the file is another's: the rest is not ours to know
                names = [name for name in names if name in {*taken, *_POSE_COLUMNS}]
            return _columns_to_read(names, ignored_columns, advice, taken)

        with _naming(path):
            columns, stated = read_recorded(path, own, vocabulary, choose)
        digits = [
            digit
            for digit in ("1", "2", "")
            if any(not columns.keys().isdisjoint(names) for names in _position_column_names(digit))
        ]
        if "1" in digits and "" in digits:
            digits.remove("")  # coordinates beside poses, as results are saved
        for digit in digits:
            name = digit or str(place)
            if name in bodies:
                raise ArgumentError(f"{path}", f"body {name} once", "a second time")
            may_be_point = name == "2" or (is_alone and len(digits) == 1)
            angles = _angles_of(columns, digit)
            has_angles |= bool(angles)
            unstated = {angle: columns[angle] for angle in angles if angle not in stated}
            _judge_angles(path, unstated, advice, headings)
            motion = _body_motion(path, columns, digit, sequence or "XYZ", may_be_point=may_be_point)
            bodies[name] = _RecordedBody(motion, columns.get("t"), path)
    for name in ("1", "2")[: 1 + (len(paths) == 2 or "2" in bodies)]:
        if name not in bodies:
            raise no_body_error(name, paths)
    if sequence is not None and not has_angles:
        raise ArgumentError("sequence", "None, since no attitude is in Euler angles phi_x, phi_y, phi_z", sequence)
    first, second = bodies["1"], bodies.get("2")
    if second is None:
        return Recording(first.motion, None, first.t)
    if first.path is second.path:
        return Recording(first.motion, second.motion, first.t)
    return _resample_to_one_clock(first, second, max_gap)


def no_body_error(body: str, sources: Sequence[object]) -> ArgumentError:
    """Return the error on recordings without body "1" or "2"."""
    expected = f"columns of body {body}: R{body}_x, ... or x{body}, ... (without {body} in a file of its own); "
    expected += "hp.fit_cluster makes poses of positions of markers"
    return ArgumentError(", ".join(map(str, sources)), expected, "none")


def _resample_to_one_clock(first: _RecordedBody, second: _RecordedBody, max_gap: float) -> Recording:
    """Return both bodies at the instants of the body with the longer time steps."""
    t1, t2 = _body_instants(first), _body_instants(second)
    if np.array_equal(t1, t2):
        return Recording(first.motion, second.motion, t1)
    times = [increasing_seconds(f"{body.path}: t", t)[0] for body, t in ((first, t1), (second, t2))]
    steps = [float(np.median(np.diff(time))) for time in times]
    if steps[0] >= steps[1]:
        recording = Recording(first.motion, resample(t2, second.motion, t1, max_gap), t1)
    else:
        recording = Recording(resample(t1, first.motion, t2, max_gap), second.motion, t2)
    bodies = (recording.body1, recording.body2 or recording.body1)
    is_known = np.logical_and(*(np.isfinite(body.R).all(axis=-1) for body in bodies))
    if is_known.sum() < 2:
        spans = [f"{time[-1]:.4g} s in steps of {step:.4g} s" for time, step in zip(times, steps, strict=True)]
        expected = "recordings of the same time, by one clock and in one unit"
        raise ArgumentError(f"{first.path}: t, {second.path}: t", expected, " and ".join(spans))
    return recording


def _body_instants(body: _RecordedBody) -> NDArray[Any]:
    if body.t is None:
        raise ArgumentError(f"{body.path}: t", "a column, since each body has a file", "no such column")
    return body.t


def _position_column_names(digit: str) -> tuple[tuple[str, ...], ...]:
    return tuple(f"R{digit}_{c}" for c in "xyz"), tuple(f"{c}{digit}" for c in "xyz")


def _attitude_column_names(digit: str) -> tuple[tuple[str, ...], ...]:
    rotation, quaternion = (f"S{digit}_{r}{c}" for r in "xyz" for c in "xyz"), (f"q{c}{digit}" for c in "xyzw")
    return tuple(rotation), tuple(quaternion), *_angle_column_names(digit)


def _angle_column_names(digit: str) -> tuple[tuple[str, ...], ...]:
    return tuple(f"phi_{c}{digit}" for c in "xyz"), tuple(f"phi{digit}_{c}" for c in "xyz")


def _headings(sequence: str) -> tuple[str, ...]:
    """Return the angles that turn about z, of all bodies."""
    groups = (names for digit in ("1", "2", "") for names in _angle_column_names(digit))
    return tuple(name for names in groups for name in headings_among(names, sequence))


def _angles_of(columns: Mapping[str, NDArray[Any]], digit: str) -> tuple[str, ...]:
    """Return the columns with Euler angles of a body; none if others have its attitude, as those of results may."""
    rotation, quaternion, *angles = _attitude_column_names(digit)
    if not columns.keys().isdisjoint((*rotation, *quaternion)):
        return ()
    return tuple(name for names in angles for name in names if name in columns)


def _pose_column_names(digit: str) -> tuple[tuple[str, ...], ...]:
    return (*_position_column_names(digit), *_attitude_column_names(digit))


_POSE_COLUMNS: Final = (  # all names that columns of instants and of poses can have
    "t",
    *(name for digit in ("1", "2", "") for names in _pose_column_names(digit) for name in names),
)


def _judge_angles(
    path: ColumnTable, angles: Mapping[str, Float64Array], advice: ColumnAdvice, headings: Collection[str]
) -> None:
    """Warn of angles that are probably in degrees, or refuse them."""
    try:
        doubts = doubts_about_angles(angles, lambda name: advice.degrees(name, headings))
    except ArgumentError as error:
        raise error.renamed(f"{path}: {error.name}") from None
    warn_of_measurements([f"{path}: {doubt}" for doubt in doubts], stacklevel=6)


def _body_motion(
    path: ColumnTable, columns: Mapping[str, NDArray[Any]], column_digit: str, sequence: str, *, may_be_point: bool
) -> BodyMotion:
    """Return the poses of the body whose columns end in "1", "2" or ""; an attitude of which a part is missing, or
    all is 0, is NaN, and a body without columns of one is a point if it may be.
    """
    planar = {
        (z, *tilts): (x, y, turn)
        for x, y, z in _position_column_names(column_digit)
        for *tilts, turn in _angle_column_names(column_digit)
    }
    try:
        zeros = planar_zeros(columns, planar, sequence)
    except ArgumentError as error:
        raise error.renamed(f"{path}: {error.name}") from None
    columns = {**columns} | {name: np.zeros(len(next(iter(columns.values())))) for name in zeros}
    R = _stack_columns(path, columns, _position_column_names(column_digit))
    if all(columns.keys().isdisjoint(names) for names in _attitude_column_names(column_digit)):
        if may_be_point:
            return BodyMotion(R=R)
        _, quaternion, angles, _ = map(", ".join, _attitude_column_names(column_digit))
        expected = (
            f"columns of the attitude of body 1: S{column_digit}_xx, ..., S{column_digit}_zz, or {quaternion}, or "
            f"{angles} (a body that is known by its position alone must be body 2)"
        )
        raise ArgumentError(f"{path}", expected, "none")
    attitude = _stack_columns(path, columns, _attitude_column_names(column_digit))
    if attitude.shape[1] == 3:
        attitude[~np.isfinite(attitude).all(axis=-1)] = np.nan
        return BodyMotion(R=R, S=np.asarray(euler_to_matrix(attitude, sequence)))
    attitude[~np.isfinite(attitude).all(axis=-1) | (attitude == 0).all(axis=-1)] = np.nan
    if attitude.shape[1] == 9:
        S = attitude.reshape(-1, 3, 3)
        try:
            return BodyMotion(R=R, S=S)
        except RotationError:  # of a few digits
            return BodyMotion(R=R, S=project_to_rotation(S))
    return BodyMotion.from_quaternion_xyzw(R=R, quat_xyzw=attitude)


def _stack_columns(
    path: ColumnTable, columns: Mapping[str, NDArray[Any]], alternatives: tuple[tuple[str, ...], ...]
) -> Float64Array:
    """Return the columns (N, k) of the first alternative of which any is present; refuse it if one is missing."""
    names = next((names for names in alternatives if not columns.keys().isdisjoint(names)), alternatives[-1])
    for name in names:
        if name not in columns:
            present = ", ".join(other for other in names if other in columns)
            raise ArgumentError(f"{path}: {name}", f"a column, since the file has {present}", "none")
    return np.stack([columns[name] for name in names], axis=-1)


def _component_names(name: str, sample_shape: tuple[int, ...]) -> ArrayLike:
    """Return the names of the components of a vector or a matrix, in its shape; of anything else its own name."""
    if sample_shape not in {(3,), (3, 3)}:
        return name
    return np.reshape(column_names({name: np.empty((1, *sample_shape))}), sample_shape)


def _columns_to_read(
    names: Sequence[str],
    ignored_columns: Sequence[str],
    advice: ColumnAdvice,
    other_names: Collection[str] = (),
) -> list[str]:
    """Return the names to be read, without those that are ignored or of results; refuse unknown ones."""
    known_names = [*_POSE_COLUMNS, *other_names]
    wanted = []
    for name in names:
        if any(fnmatch.fnmatchcase(name, pattern) for pattern in ignored_columns):
            continue
        if name in known_names:
            wanted.append(name)
        elif not _IGNORED_COLUMNS.fullmatch(name):
            short = name[:40]
            ours, unit = _meant_column(name, known_names)
            template = advice.columns_with_unit if unit else advice.columns
            ways = [template.format(ours=ours or "NAME", name=short, unit=unit)]
            hint = f" (nearest: {ours})" if ours else ""
            expected = f"columns of poses{hint}, {', '.join(ways)}, or {advice.ignore.format(name=short)}"
            raise ArgumentError(repr(short), expected, "an unknown column")
    return wanted


def _meant_column(name: str, known_names: Sequence[str]) -> tuple[str, str]:
    """Return the known column that an unknown one probably stands for, and the unit in its name: t and ms for
    time_ms; "" where there is none.
    """
    lower = re.sub(r"\s*[(\[]\w+[)\]]$", "", name.lower())  # "Time (Seconds)"
    stem, _, unit = lower.rpartition("_")
    for text, its_unit in ((lower, ""), (stem, unit)):
        position = _POSITION_ALIAS.fullmatch(text)
        column = "t" if text in _TIME_ALIASES else "".join(position.groups()) if position else text
        if column in known_names and (not its_unit or its_unit in SCALES.get(unit_of(column), ())):
            return column, its_unit
    return nearest_name(name, known_names), ""


# ---- robots


def read_robot_recording(
    source: Any,
    robot: Mechanism,
    bandwidth: float | None = None,
    columns: Mapping[str, Any] | None = None,
) -> tuple[Float64Array | None, dict[str, Float64Array]]:
    """Return the instants t [s], None where there are none, and q, qd, qdd and tau of the joints, (N, dof) each.

    The columns are `t`, `q_JOINT`, `tau_JOINT`, and where recorded `qd_JOINT` and `qdd_JOINT`, or `JOINT`, `JOINTd`
    and `JOINTdd`, as scenes of robots write them. Missing qd and qdd are derived from q by `smooth` with `bandwidth`
    [Hz]. Other columns are passed over. `source` and `columns` are as for `read_recording`.
    """
    rows, joints = ("q", "qd", "qdd", "tau"), robot.names
    units = {"t": "s"}
    for joint in tree_of(robot).coordinates:
        per = (joint.unit, f"{joint.unit}/s", f"{joint.unit}/s^2", joint.effort_unit)
        units |= {f"{name}_{joint.name}": unit for name, unit in zip(rows, per, strict=True)}
    # Names of positions and rates in the results of scenes.
    of_scenes = {f"{joint}{name[1:]}": f"{name}_{joint}" for joint in joints for name in rows[:3]}
    of_scenes = {name: own for name, own in of_scenes.items() if name not in units}
    vocabulary = Vocabulary(
        tuple(units),
        lambda name: units.get(of_scenes.get(name, name), "1"),
        lambda name, _: of_scenes.get(name, name),
    )
    with _naming(source):
        table = open_columns(source)
        sources = read_sources(columns or {}, vocabulary, table.units)
        check_sources(sources, table.shapes)
        taken = {source.column for source in sources.values()}
        found, _ = read_recorded(
            table, sources, vocabulary, lambda names: [n for n in names if n in {*taken, *units}]
        )
    derived = [name for name in rows[1:3] if not all(f"{name}_{joint}" in found for joint in joints)]
    for name in units:
        needed = bool(derived) if name == "t" else name.partition("_")[0] not in rows[1:3]
        if needed and name not in found:
            why = f", or hold the joint by --lock {name.partition('_')[2]}=POSITION" if name != "t" else ""
            users = [other for other, source in sources.items() if source.column == name]
            near, got = (
                ("", f"it as {users[0]}, by columns") if users else (nearest(name, tuple(table.shapes)), "none")
            )
            raise ArgumentError(str(source), f"a column {name}{near}{why}", got)
    t = found.get("t")
    recorded = {
        name: np.stack([found[f"{name}_{joint}"] for joint in joints], axis=-1)
        for name in rows
        if name not in derived
    }
    if derived:
        smoothed = [smooth(t, column, bandwidth) for column in recorded["q"].T]  # type: ignore[arg-type]
        every = dict(zip(rows, zip(*smoothed, strict=True), strict=False))
        recorded |= {name: np.stack(every[name], axis=-1) for name in ("q", *derived)}
    return t, recorded


# ---- inertial sensors

_IMU_UNITS: Final = {
    "t": "s",
    **{f"omega_{c}": "rad/s" for c in "xyz"},
    **{f"force_{c}": "m/s^2" for c in "xyz"},
}


_IMU_VOCABULARY: Final = Vocabulary(tuple(_IMU_UNITS), lambda name: _IMU_UNITS.get(name, "1"))


def are_imus(sources: Sequence[Any], columns: Mapping[str, Any]) -> bool:
    """Return whether recordings are those of inertial sensors: the specific force of each is recorded."""
    shown = []
    for source in sources:
        with _naming(source):
            headings = open_columns(source).shapes
        shown.append({read_heading(heading, _IMU_VOCABULARY.unit_of)[0] for heading in headings})
    return "force_x" in columns or all("force_x" in names for names in shown)


def read_imus(sources: Sequence[Any], columns: Mapping[str, Any]) -> tuple[ImuRecording, ImuRecording]:
    """Read the recordings of two sensors, columns t, omega_x, ..., force_z.

    Args:
        sources: a recording of each, as for `read_recording`.
        columns: names and units of columns that have others, as there.

    Raises:
        ArgumentError: a file or a column cannot be used, or there are not two.
    """
    if len(sources) != 2:
        raise ArgumentError("FILE", "two files of inertial sensors, one on each body", f"{len(sources)}")
    recordings: list[ImuRecording] = []
    for source in sources:
        with _naming(source):
            recordings.append(_read_imu(source, columns))
    return recordings[0], recordings[1]


def _read_imu(source: Any, columns: Mapping[str, Any]) -> ImuRecording:
    table = open_columns(source)
    places = read_sources(columns, _IMU_VOCABULARY, table.units)
    check_sources(places, table.shapes)
    wanted = {*_IMU_UNITS, *(place.column for place in places.values())}
    found, _ = read_recorded(table, places, _IMU_VOCABULARY, lambda names: [name for name in names if name in wanted])
    for name in _IMU_UNITS:
        if name not in found:
            raise ArgumentError(name, f"a column of this name{nearest(name, tuple(table.shapes))}", "none")
    omega, force = (np.stack([found[f"{name}_{c}"] for c in "xyz"], axis=-1) for name in ("omega", "force"))
    return ImuRecording(found["t"], omega, force)
