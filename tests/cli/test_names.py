"""Names that users choose: whatever is legal, nothing collides with names of ours, and every file is read back."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.commands import run_command

NAMES = (
    *(("shoulder, left", "a;b"), ("a", "S"), ("R", "omega"), ("q", "time"), ("allow_pickle", "xyz")),
    *(("R_tip", "tip"), ("R_tip_x", "tip"), ("a#", 'say "hi"'), ("$x^", "</script>"), ("{x} %s", "c\\d")),
    ("a/b", "\N{SNOWMAN}"),
)
ARM = """
[[joint]]
name = {a}
u1 = [0, 0, 1]
u2 = [0, 0, 0]
n = [0, 1, 0]
body2 = {{ mass = 3, inertia = [1, 1, 1], centre_of_mass = [1, 0, 0] }}
[[joint]]
name = {b}
u1 = [1, 0, 0]
u2 = [0, 0, 0]
n = [0, 1, 0]
parent = {a}
body2 = {{ mass = 3, inertia = [1, 1, 1], centre_of_mass = [1, 0, 0] }}
"""
MOVED = """
[motion]
{a} = "t**2"
{b} = "1 + t"
[time]
start = 0
stop = 1
samples = 5
"""


@pytest.mark.proof
@pytest.mark.parametrize("names", NAMES, ids=" ".join)
def test_a_motion_is_written_and_read_whatever_the_joints_are_called(names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    a, b = names
    quoted = {"a": json.dumps(a, ensure_ascii=False), "b": json.dumps(b, ensure_ascii=False)}
    Path("a.toml").write_text((ARM + MOVED).format(**quoted), encoding="utf-8")
    try:
        scene = hp.load_scene("a.toml")
    except hp.SceneError as error:
        if "joints of other names" in str(error):
            return
        raise
    t, moved = scene.t, {a: scene.t**2, b: 1 + scene.t}
    for ending in (".csv", ".npz", ".nc", ".parquet"):
        run_command("run", "a.toml", "--out", f"all{ending}")
        run_command("run", "a.toml", "--outputs", "q,qd,qdd", "--out", f"log{ending}")
    with open("all.csv", encoding="utf-8", newline="") as file:
        heading, *rows = csv.reader(file)
    assert len({*heading}) == len(heading) == len(rows[0])
    for name, values in moved.items():
        np.testing.assert_array_equal([float(row[heading.index(name)]) for row in rows], values)
    with np.load("all.npz") as arrays:
        np.testing.assert_array_equal(arrays[a], moved[a])
    for ending in (".csv", ".npz", ".parquet"):
        Path("log.toml").write_text(ARM.format(**quoted) + f"[motion]\nfile = 'log{ending}'\n", encoding="utf-8")
        found = hp.load_scene("log.toml").evaluate(("q", "qd"))
        np.testing.assert_array_equal(found.t, t)
        np.testing.assert_array_equal(
            found.q, np.stack([moved[name] for name in hp.load_scene("a.toml").mechanism.names], axis=1)
        )
    run_command("forces", "a.toml", "--out", "forces.csv")
    printed = json.loads(run_command("run", "a.toml", "--outputs", cell(f"R_{b}"), "--json").stdout)
    assert [*printed["outputs"]] == [f"R_{b}_{axis}" for axis in "xyz"]


def cell(name: str) -> str:
    """Return a name as one cell of a line of a .csv file, as --outputs takes it."""
    return '"{}"'.format(name.replace('"', '""'))
