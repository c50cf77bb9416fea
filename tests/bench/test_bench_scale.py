"""`hingepair bench scale`."""

from __future__ import annotations

import json

import pytest
from typer.testing import CliRunner

from hingepair.bench import scale as bench
from hingepair.cli.main import app

pytest.importorskip("dask", reason="the extra dask is not installed")


@pytest.mark.slow
def test_the_command_prints_rows():
    words = ["bench", "scale", "--samples", "2000", "--long", "600000", "--repeats", "1", "--json"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)["rows"]
    cases = [row["case"] for row in rows]
    assert len(set(cases)) == 5
    methods = {row["method"] for row in rows if row["case"] == "velocity"}
    assert methods == {"plain call, 1 thread", "Dask, 1 thread", "plain call, 2 threads", "Dask, 2 threads"}
    (long,) = [row for row in rows if bench.MEMORY_COLUMN in row["more"]]
    assert long["count"] == 600_000
    assert long["more"][bench.MEMORY_COLUMN] > 0  # of the whole process, whatever else it holds
