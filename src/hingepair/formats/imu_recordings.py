"""Recordings of inertial sensors: files of two sensors, one on each body of a hinge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from hingepair.errors import ArgumentError, nearest
from hingepair.measured.imus import ImuRecording
from hingepair.tables.recorded_columns import Vocabulary, check_sources, open_columns, read_recorded, read_sources
from hingepair.tables.units import read_heading

_UNITS: Final = {
    "t": "s",
    **{f"omega_{c}": "rad/s" for c in "xyz"},
    **{f"force_{c}": "m/s^2" for c in "xyz"},
}


def _unit(name: str) -> str:
    """Return the SI unit of a column."""
    return _UNITS.get(name, "1")


_VOCABULARY: Final = Vocabulary(tuple(_UNITS), _unit)


def are_imus(sources: Sequence[Any], columns: Mapping[str, Any]) -> bool:
    """Return whether recordings are those of inertial sensors: the specific force of each is recorded."""
    shown = [{read_heading(heading, _unit)[0] for heading in open_columns(source).shapes} for source in sources]
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
        try:
            recordings.append(_read_imu(source, columns))
        except ArgumentError as error:
            raise error.renamed(f"{source}: {error.name}") from None
    return recordings[0], recordings[1]


def _read_imu(source: Any, columns: Mapping[str, Any]) -> ImuRecording:
    table = open_columns(source)
    places = read_sources(columns, _VOCABULARY, table.units)
    check_sources(places, table.shapes)
    wanted = {*_UNITS, *(place.column for place in places.values())}
    found, _ = read_recorded(table, places, _VOCABULARY, lambda names: [name for name in names if name in wanted])
    for name in _UNITS:
        if name not in found:
            raise ArgumentError(name, f"a column of this name{nearest(name, tuple(table.shapes))}", "none")
    omega, force = (np.stack([found[f"{name}_{c}"] for c in "xyz"], axis=-1) for name in ("omega", "force"))
    return ImuRecording(found["t"], omega, force)
