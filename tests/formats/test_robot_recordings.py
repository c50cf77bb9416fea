"""Recordings of robots: columns by their own names and by others, each once."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import hingepair as hp
from hingepair.formats.recordings import read_robot_recording

ARM = hp.Mechanism([hp.HingePair((0, 0, 1), (-1, 0, 0), (0, 1, 0), name="elbow")])


def recording(folder: Path, *names: str) -> Path:
    """Return a file whose columns of these names hold 1, 2, 3 and so on, times the row."""
    rows = np.outer(np.arange(9), 1 + np.arange(len(names)))
    path = folder / "log.csv"
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="")
    return path


def test_columns_of_other_names_are_those_of_ours(tmp_path: Path) -> None:
    path = recording(tmp_path, "t", "Winkel", "qd_elbow", "qdd_elbow", "tau_elbow [N mm]")
    t, found = read_robot_recording(path, ARM, columns={"q_elbow": {"name": "Winkel", "unit": "deg"}})
    rows = np.arange(9.0)
    assert np.array_equal(t, rows)
    np.testing.assert_allclose(found["q"][:, 0], np.radians(2 * rows), rtol=4 * 2.0**-53, atol=0)
    np.testing.assert_allclose(found["tau"][:, 0], 5e-3 * rows, rtol=4 * 2.0**-53, atol=0)
    assert np.array_equal(found["qd"][:, 0], 3 * rows)
