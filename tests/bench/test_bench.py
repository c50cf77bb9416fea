"""`hingepair bench` and benchmarks/ measure what they say: every method computes the same. No speed here."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from hingepair.bench import pair
from support.commands import run_command
from support.states import generator

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 3])
def test_every_method_computes_the_truth(count):
    motion = pair.random_states(generator(80), count)
    assert max(pair.largest_errors(*motion, pair.jobs(*motion)).values()) < 20


def test_the_error_columns_see_errors_and_what_is_not_finite():
    q, qd = pair.random_states(generator(81), 3)
    right = pair.jobs(q, qd)["hingepair"]
    methods = {
        "right": right,
        "off": lambda: [result + 1e-9 for result in right()],
        "nan": lambda: [np.where(result == result.flat[0], np.nan, result) for result in right()],
    }
    found = pair.largest_errors(q, qd, methods)
    assert found["right"] < 12
    assert 1e4 < found["off"] < found["nan"] == math.inf
    q, qd = pair.hard_states(generator(82))
    reduced = q.copy()
    reduced[:, 6] %= 2 * np.pi  # in double
    methods = {"right": pair.jobs(q, qd)["hingepair"], "reduced": pair.jobs(reduced, qd)["hingepair"]}
    found = pair.largest_errors(q, qd, methods)
    assert found["right"] < 12
    assert found["reduced"] > 1e6


@pytest.mark.slow
def test_the_command_prints_a_row_for_each_method():
    options = ("bench", "--sizes", "1,2", "--repeats", 1)
    shown = run_command(*options).stdout
    assert all(words in shown for words in (*pair.jobs(*np.zeros((2, 2, 7))), "N = 1", "N = 2", "pin", "floor"))
    assert max(map(len, shown.splitlines())) <= 100
    found = json.loads(run_command(*options, "--json").stdout, parse_constant=pytest.fail)
    assert {"processor", "cores", "numpy", "pin"} <= found["facts"].keys()
    rows = {(row["states"], row["method"]): row for row in found["rows"]}
    assert len(rows) == 6 + 6
    assert all(row["next"] > 0 and row["pin"] > 0 and row["floor"] > 0 for row in rows.values())
    assert rows[2, pair.COPY]["error"] is None
    assert 0 < rows[2, "hingepair"]["error"] < 12


SCRIPTS = {
    "robots.py": ("--sizes", "1,10"),
    "inverse_kinematics.py": ("--size", "5"),
    "rollouts.py": ("--size", "4", "--steps", "10"),
    "linkages.py": ("--sizes", "10"),
}


@pytest.mark.proof
@pytest.mark.parametrize("script", SCRIPTS)
def test_methods_of_a_benchmark_agree(script):
    options = ("--names", "ur5_robot", "--repeats", "1", "--json")
    command = [sys.executable, str(BENCHMARKS / script), *options, *SCRIPTS[script]]
    process = subprocess.run(command, capture_output=True, text=True, check=True)
    rows = json.loads(process.stdout)
    assert {"hingepair", "Pinocchio, Python loop"} <= {row["method"] for row in rows}
    # Inverse kinematics stop at 1e-9, and loops are closed up to 1e-12 m there; all else is rounding.
    most = {"inverse_kinematics.py": 1e-9, "linkages.py": 1e-11}.get(script, 2e-13)
    assert max(row["error"] for row in rows) < most
