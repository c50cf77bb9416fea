"""Recordings of two bodies, and of the joints of a robot: from files or tables in memory, brought to one clock.

Results that were saved with R1, S1, R2, S2 can be read as they are. Other columns are passed over.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations.quantities import unit_of
from hingepair.errors import ArgumentError, RotationError, nearest
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
    Recorded,
    Vocabulary,
    doubts_about_angles,
    headings_among,
    open_columns,
    planar_zeros,
    read_recorded,
    read_sources,
)
from hingepair.tables.units import read_heading


def _columns_of(digit: str) -> dict[str, tuple[str, ...]]:
    """Return the columns of a body, whose names have a digit or none, by what they hold."""
    return {
        "R": tuple(f"R{digit}_{c}" for c in "xyz"),
        "xyz": tuple(f"{c}{digit}" for c in "xyz"),
        "S": tuple(f"S{digit}_{row}{column}" for row in "xyz" for column in "xyz"),
        "quat": tuple(f"q{c}{digit}" for c in "xyzw"),
        "phi": tuple(f"phi_{c}{digit}" for c in "xyz"),
    }


_BODIES: Final = {digit: _columns_of(digit) for digit in ("1", "2", "")}
_POSE_COLUMNS: Final = ("t", *(name for own in _BODIES.values() for names in own.values() for name in names))


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


class _RecordedBody(NamedTuple):
    """Motion of one body, with what stands in its table; None for instants that it lacks."""

    motion: BodyMotion
    recorded: Recorded
    table: ColumnTable

    @property
    def t(self) -> NDArray[Any] | None:
        return self.recorded.columns.get("t")


def read_recording(
    *sources: Any,
    columns: Mapping[str, str | Mapping[str, str]] | None = None,
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
            instants of frame numbers.
        gaps: longest time between samples over which one body is interpolated to the instants of the other [s].
        sequence: axes about which phi_x, phi_y, phi_z turn, such as "ZYX" of yaw, pitch and roll, in capitals about
            the body's own axes; by default "XYZ".

    Returns:
        The Recording: body1, body2 and t. The bodies have the instants of the one with the longer time
        steps. Empty cells and attitudes of zeros are missing samples, NaN. Body 2, or a body alone, whose attitude
        was not recorded is a point.

    Raises:
        ArgumentError: a file or a column cannot be used.
        MeasurementWarning: angles are probably in degrees, or a body is a point beside columns that were not read.
        MissingDependencyError: a source is a .parquet file and PyArrow is not installed.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> log = {"time": [0, 1000, 2000], "x": [1, 2, 3], "y": 0 * np.ones(3), "z": 0 * np.ones(3)}
    >>> log |= {"qx": [0, 0, 0], "qy": [0, 0, 0], "qz": [0, 0, 0], "qw": [1, 1, 1]}
    >>> recording = hp.read_recording(log, columns={"t": {"name": "time", "unit": "ms"}})
    >>> recording.t, recording.body1.R[2]
    (array([0., 1., 2.]), array([3., 0., 0.]))
    """
    if not 1 <= len(sources) <= 2:
        raise ArgumentError("sources", "one recording, or one of each body", f"{len(sources)}")
    longest = checked_gaps(gaps)
    if sequence is not None:
        check_choice("sequence", sequence, SEQUENCE_NAMES)
    tables = []
    for source in sources:
        with _naming(source):
            tables.append(open_columns(source))
    order = sequence or "XYZ"
    headings = [name for own in _BODIES.values() for name in headings_among(own["phi"], order)]
    vocabulary = Vocabulary(_POSE_COLUMNS, unit_of, _component_names, headings)
    with _naming(tables[-1]):  # either recording may have a column
        places = read_sources(columns or {}, vocabulary, *tables)
    bodies: dict[str, _RecordedBody] = {}
    has_angles = False
    for number, table in enumerate(tables, start=1):
        own = {name: place for name, place in places.items() if place.column in table.arrays}
        with _naming(table):
            recorded = read_recorded(table, own, vocabulary)
            digits = [d for d, own in _BODIES.items() if not {*own["R"], *own["xyz"]}.isdisjoint(recorded.columns)]
            if "1" in digits and "" in digits:
                digits.remove("")  # coordinates beside poses, as results are saved
            of_coordinates = zip(_BODIES["1"]["phi"], _BODIES[""]["phi"], strict=True) if "1" in digits else ()
            known = recorded.columns
            known |= {name: known[own] for name, own in of_coordinates if own in known and name not in known}
            for digit in digits:
                name = digit or str(number)
                if name in bodies:
                    raise ArgumentError("", f"body {name} once", "a second time")
                may_be_point = name == "2" or (len(tables) == 1 and len(digits) == 1)
                motion, angles = _body_motion(recorded, digit, order, may_be_point=may_be_point)
                has_angles |= bool(angles)
                unstated = {angle: recorded.columns[angle] for angle in angles if angle not in recorded.stated}
                doubts = doubts_about_angles(unstated, lambda angle: _in_degrees(angle, headings))
                unread = [column for column in recorded.names if column not in recorded.columns]
                if motion.S is None and unread:
                    doubts.append(f"body {name} is taken for a point; not read are {', '.join(unread[:20])}")
                warn_of_measurements(f"{table}: {doubt}" for doubt in doubts)
                bodies[name] = _RecordedBody(motion, recorded, table)
    for name in ("1", "2")[: 1 + (len(tables) == 2 or "2" in bodies)]:
        if name not in bodies:
            raise no_body_error(name, tables)
    if sequence is not None and not has_angles:
        raise ArgumentError("sequence", "None, since no attitude is in Euler angles phi_x, phi_y, phi_z", sequence)
    first, second = bodies["1"], bodies.get("2")
    if second is None or first.table is second.table:
        return Recording(first.motion, second and second.motion, first.t)
    return _on_one_clock(first, second, longest)


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


def no_body_error(body: str, sources: Sequence[object]) -> ArgumentError:
    """Return the error on recordings without body "1" or "2"."""
    expected = f"columns of body {body}: R{body}_x, ... or x{body}, ... (without {body} in a file of its own); "
    expected += "hp.fit_cluster makes poses of positions of markers"
    return ArgumentError(", ".join(map(str, sources)), expected, "none")


def _in_degrees(angle: str, headings: Sequence[str]) -> str:
    """Return how a user states that an angle is in degrees, and one of `headings` one of a compass."""
    stated = f"columns={{{angle!r}: {{'name': 'COLUMN', 'unit': 'deg'}}}} (--column {angle}=COLUMN:deg)"
    return stated + ' ("compass" in place of "deg" for headings clockwise from north)' * (angle in headings)


def _component_names(name: str, sample_shape: tuple[int, ...]) -> ArrayLike:
    """Return the names of the components of a vector or a matrix, in its shape; of anything else its own name."""
    if not sample_shape:
        return {"phi": "phi_z", "phi2": "phi_z2"}.get(name, name)  # of results in the plane
    if sample_shape not in {(2,), (3,), (3, 3)}:
        return name
    return np.reshape(column_names({name: np.empty((1, *sample_shape))}), sample_shape)


def _body_motion(
    recorded: Recorded, digit: str, sequence: str, *, may_be_point: bool
) -> tuple[BodyMotion, tuple[str, ...]]:
    """Return the poses of the body whose columns end in a digit, and its columns of Euler angles. An attitude of
    which a part is missing, or all is 0, is NaN; a body without columns of one is a point if it may be.
    """
    own, columns = _BODIES[digit], recorded.columns
    *tilts, turn = own["phi"]
    planar = {(z, *tilts): (x, y, turn) for x, y, z in (own["R"], own["xyz"])}
    samples = len(next(iter(columns.values())))
    columns |= {name: np.zeros(samples) for name in planar_zeros(columns, planar, sequence)}
    R = _stacked(columns, own["R"] if not columns.keys().isdisjoint(own["R"]) else own["xyz"])
    kind = next((kind for kind in ("S", "quat", "phi") if not columns.keys().isdisjoint(own[kind])), None)
    if kind is None:
        if may_be_point:
            return BodyMotion(R=R), ()
        expected = (
            f"columns of the attitude of body 1: {own['S'][0]}, ..., {own['S'][-1]}, or {', '.join(own['quat'])}, or "
            f"{', '.join(own['phi'])} (a body that is known by its position alone must be body 2)"
        )
        raise ArgumentError("", expected, "none")
    attitude = _stacked(columns, own[kind])
    is_missing = ~np.isfinite(attitude).all(axis=-1) | ((kind != "phi") & (attitude == 0).all(axis=-1))
    attitude[is_missing] = np.nan
    if kind == "phi":
        return BodyMotion(R=R, S=np.asarray(euler_to_matrix(attitude, sequence))), own["phi"]
    if kind == "quat":
        return BodyMotion.from_quaternion_xyzw(R=R, quat_xyzw=attitude), ()
    S = attitude.reshape(-1, 3, 3)
    try:
        return BodyMotion(R=R, S=S), ()
    except RotationError:  # of a few digits
        return BodyMotion(R=R, S=project_to_rotation(S)), ()


def _stacked(columns: Mapping[str, NDArray[Any]], names: Sequence[str]) -> Float64Array:
    """Return columns (N, k); refuse that one of them is missing."""
    for name in names:
        if name not in columns:
            present = ", ".join(other for other in names if other in columns)
            raise ArgumentError(name, f"a column, since the file has {present}", "none")
    return np.stack([columns[name] for name in names], axis=-1)


def _on_one_clock(first: _RecordedBody, second: _RecordedBody, max_gap: float) -> Recording:
    """Return both bodies at the instants of the body with the longer time steps."""
    stamps = []
    for body in (first, second):
        if body.t is None:
            raise ArgumentError(f"{body.table}: t", "a column, since each body has a file", "no such column")
        stamps.append(body.t)
    if np.array_equal(stamps[0], stamps[1]):
        return Recording(first.motion, second.motion, first.t)
    times = [
        increasing_seconds(f"{body.table}: t", t, body.recorded.lines)[0]
        for body, t in zip((first, second), stamps, strict=True)
    ]
    steps = [float(np.median(np.diff(time))) for time in times]
    if steps[0] >= steps[1]:
        body1, body2, t = first.motion, resample(stamps[1], second.motion, stamps[0], max_gap), stamps[0]
    else:
        body1, body2, t = resample(stamps[0], first.motion, stamps[1], max_gap), second.motion, stamps[1]
    if (np.isfinite(body1.R) & np.isfinite(body2.R)).all(axis=-1).sum() < 2:
        spans = [f"{time[-1]:.4g} s in steps of {step:.4g} s" for time, step in zip(times, steps, strict=True)]
        expected = "recordings of the same time, by one clock and in one unit"
        raise ArgumentError(f"{first.table}: t, {second.table}: t", expected, " and ".join(spans))
    return Recording(body1, body2, t)


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
    rows, units = ("q", "qd", "qdd", "tau"), {"t": "s"}
    for own in tree_of(robot).coordinates:
        per = (own.unit, f"{own.unit}/s", f"{own.unit}/s^2", own.effort_unit)
        units |= {f"{name}_{own.name}": unit for name, unit in zip(rows, per, strict=True)}
    # Names of positions and rates in the results of scenes.
    of_scenes = {f"{joint}{name[1:]}": f"{name}_{joint}" for joint in robot.names for name in rows[:3]}
    of_scenes = {name: ours for name, ours in of_scenes.items() if name not in units}
    vocabulary = Vocabulary(
        tuple(units),
        lambda name: units.get(of_scenes.get(name, name), "1"),
        lambda name, _: of_scenes.get(name, name),
    )
    found, table = _known_columns(source, columns or {}, vocabulary)
    derived = [name for name in rows[1:3] if not all(f"{name}_{joint}" in found for joint in robot.names)]
    for name in units:
        kind, _, joint = name.partition("_")
        if name not in found and (bool(derived) if name == "t" else kind not in rows[1:3]):
            why = f", or hold the joint by --lock {joint}=POSITION" if joint else ""
            raise ArgumentError(str(source), f"a column {name}{nearest(name, tuple(table.arrays))}{why}", "none")
    t = found.get("t")
    recorded = {
        name: np.stack([found[f"{name}_{joint}"] for joint in robot.names], axis=-1)
        for name in rows
        if name not in derived
    }
    if derived:
        smoothed = [smooth(t, column, bandwidth) for column in recorded["q"].T]  # type: ignore[arg-type]
        every = dict(zip(rows, zip(*smoothed, strict=True), strict=False))
        recorded |= {name: np.stack(every[name], axis=-1) for name in ("q", *derived)}
    return t, recorded


def _known_columns(
    source: Any, columns: Mapping[str, Any], vocabulary: Vocabulary
) -> tuple[dict[str, NDArray[Any]], ColumnTable]:
    """Return the columns of a recording that a vocabulary knows or entries name, by the names of this package."""
    with _naming(source):
        table = open_columns(source)
        places = read_sources(columns, vocabulary, table)
        return read_recorded(table, places, vocabulary).columns, table


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
            headings = open_columns(source).arrays
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
    first, second = (_read_imu(source, columns) for source in sources)
    return first, second


def _read_imu(source: Any, columns: Mapping[str, Any]) -> ImuRecording:
    found, table = _known_columns(source, columns, _IMU_VOCABULARY)
    with _naming(source):
        for name in _IMU_UNITS:
            if name not in found:
                raise ArgumentError(name, f"a column of this name{nearest(name, tuple(table.arrays))}", "none")
        omega, force = (np.stack([found[f"{name}_{c}"] for c in "xyz"], axis=-1) for name in ("omega", "force"))
        return ImuRecording(found["t"], omega, force)
