"""Recordings of robots in files: instants, and for each joint its position and torque, columns by name.

The columns are `t`, `q_JOINT`, `tau_JOINT`, and where recorded `qd_JOINT` and `qdd_JOINT`, or `JOINT`, `JOINTd` and
`JOINTdd`, as scenes of robots write them, in a .csv, .npz or .parquet file, in SI units or with their unit, such as
`q_JOINT [deg]`. Empty cells are missing samples; other columns are passed over.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from hingepair.errors import ArgumentError, nearest
from hingepair.measured.smoothing.smooth import smooth
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.numeric.arrays import Float64Array
from hingepair.tables.column_file import ColumnRequest, read_columns
from hingepair.tables.column_sources import check_once, in_own_names, read_column_sources
from hingepair.tables.units import read_heading

_MOTION = ("q", "qd", "qdd")  # the last two recorded or derived


def read_robot_recording(
    path: Path,
    robot: Mechanism,
    bandwidth: float | None = None,
    columns: Mapping[str, Mapping[str, str]] = MappingProxyType({}),
) -> tuple[Float64Array | None, dict[str, Float64Array]]:
    """Return the instants t [s], None where there are none, and q, qd, qdd and tau of the joints, (N, dof) each.
    Missing qd and qdd are derived from q by `smooth` with `bandwidth` [Hz]. `columns` has names and units of columns
    that have others, as for `read_recording`.
    """
    present: list[str] = []
    joints = robot.names
    units = {"t": "s"}
    for joint in tree_of(robot).coordinates:
        per = (joint.unit, f"{joint.unit}/s", f"{joint.unit}/s^2", joint.effort_unit)
        units |= {f"{name}_{joint.name}": unit for name, unit in zip((*_MOTION, "tau"), per, strict=True)}

    def unit_of(name: str) -> str:
        return units.get(name, "1")

    sources = read_column_sources(columns, tuple(units), unit_of, {})
    taken = {source.column for source in sources.values()}

    def choose(names: list[str]) -> list[str]:
        """Return those of the file's columns that are to be read."""
        present.extend(names)
        wanted = [name for name in names if name in taken or name in units]
        check_once(wanted, sources)
        return wanted

    # Names of positions and rates in the results of scenes.
    of_scenes = {
        f"{joint}{ending}": f"{name}_{joint}"
        for joint in joints
        for name, ending in zip(_MOTION, ("", "d", "dd"), strict=True)
        if f"{joint}{ending}" not in units
    }

    def read_own_heading(heading: str) -> tuple[str, float]:
        if heading in taken:
            return heading, 1.0
        name, factor = read_heading(heading, lambda name: unit_of(of_scenes.get(name, name)))
        return of_scenes.get(name, name), factor

    exact = sources["t"].column if "t" in sources else "t"
    try:
        read = read_columns(path, ColumnRequest(choose, lambda name, _: name, exact, read_own_heading))
        found = in_own_names(read, sources, present)
    except ArgumentError as error:
        raise ArgumentError(": ".join(filter(None, (str(path), error.name))), error.expected, error.got) from None
    derived = [name for name in _MOTION[1:] if not all(f"{name}_{joint}" in found for joint in joints)]
    for name in units:
        needed = bool(derived) if name == "t" else name.partition("_")[0] not in _MOTION[1:]
        if needed and name not in found:
            why = f", or hold the joint by --lock {name.partition('_')[2]}=POSITION" if name != "t" else ""
            users = [other for other, source in sources.items() if source.column == name]
            near, got = ("", f"it as {users[0]}, by columns") if users else (nearest(name, present), "none")
            raise ArgumentError(str(path), f"a column {name}{near}{why}", got)
    t = found.get("t")
    recorded = {
        name: np.stack([found[f"{name}_{joint}"] for joint in joints], axis=-1)
        for name in (*_MOTION, "tau")
        if name not in derived
    }
    if derived:
        smoothed = [smooth(t, column, bandwidth) for column in recorded["q"].T]  # type: ignore[arg-type]
        every = dict(zip(_MOTION, zip(*smoothed, strict=True), strict=True))
        recorded |= {name: np.stack(every[name], axis=-1) for name in ("q", *derived)}
    return t, recorded
