"""Recordings of robots in files: instants, and for each joint its position and torque, columns by name.

The columns are those that scenes of robots write: `t`, `q_JOINT`, `tau_JOINT`, and where recorded `qd_JOINT` and
`qdd_JOINT`, in a .csv, .npz or .parquet file. Empty cells are missing samples; other columns are passed over.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hingepair.errors import ArgumentError, nearest
from hingepair.measured.smoothing.smooth import smooth
from hingepair.numeric.arrays import Float64Array
from hingepair.tables.column_file import ColumnRequest, read_columns

_MOTION = ("q", "qd", "qdd")


def read_robot_recording(
    path: Path, joints: Sequence[str], bandwidth: float | None = None
) -> tuple[Float64Array | None, dict[str, Float64Array]]:
    """Return the instants t [s], None where there are none, and q, qd, qdd and tau of the joints, (N, dof) each.
    Missing qd and qdd are derived from q by `smooth` with `bandwidth` [Hz].
    """
    present: list[str] = []
    wanted = ["t", *(f"{name}_{joint}" for name in (*_MOTION, "tau") for joint in joints)]

    def choose(names: list[str]) -> list[str]:
        present.extend(names)
        return [name for name in wanted if name in names]

    try:
        columns = read_columns(path, ColumnRequest(choose, lambda name, _: name, exact="t"))
    except ArgumentError as error:
        raise ArgumentError(": ".join(filter(None, (str(path), error.name))), error.expected, error.got) from None
    derived = [name for name in _MOTION[1:] if not all(f"{name}_{joint}" in columns for joint in joints)]
    for name in wanted:
        needed = bool(derived) if name == "t" else name.partition("_")[0] not in _MOTION[1:]
        if needed and name not in columns:
            why = f", or hold the joint by --lock {name.partition('_')[2]}=POSITION" if name != "t" else ""
            raise ArgumentError(str(path), f"a column {name}{nearest(name, present)}{why}", "none")
    t = columns.get("t")
    recorded = {
        name: np.stack([columns[f"{name}_{joint}"] for joint in joints], axis=-1)
        for name in (*_MOTION, "tau")
        if name not in derived
    }
    if derived:
        smoothed = [smooth(t, column, bandwidth) for column in recorded["q"].T]  # type: ignore[arg-type]
        every = dict(zip(_MOTION, zip(*smoothed, strict=True), strict=True))
        recorded |= {name: np.stack(every[name], axis=-1) for name in ("q", *derived)}
    return t, recorded
