"""`hingepair bench scale`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from hingepair.bench import scale as bench
from support.commands import run_command

MAX_MEGABYTES: Final = 600
"""Of a process that reduces chunks of 500,000 samples on two threads, with its libraries."""

pytest.importorskip("dask", reason="the extra dask is not installed")


@pytest.mark.proof
def test_the_command_prints_rows(monkeypatch):
    monkeypatch.setattr(bench, "VARIANTS", 16)
    options = ("--samples", 2000, "--long", 20_000, "--repeats", 1, "--json")
    rows = json.loads(run_command("bench", "scale", *options).stdout)["rows"]
    cases = [row["case"] for row in rows]
    assert len(set(cases)) == 5
    timed = [row for row in rows if row["case"] in {"velocity, N = 2,000", "forward dynamics of panda, N = 2,000"}]
    assert [row["count"] for row in timed] == [2000] * 8
    assert all(row["extra_columns"][bench.PROCESSOR_TIME] >= 0 for row in timed)
    methods = {row["method"] for row in rows if row["case"] == "velocity, N = 2,000"}
    assert methods == {"plain call, 1 thread", "Dask, 1 thread", "plain call, 2 threads", "Dask, 2 threads"}
    (long,) = [row for row in rows if bench.MEMORY in row["extra_columns"]]
    assert long["count"] == 20_000
    assert 0 < long["extra_columns"][bench.MEMORY] < MAX_MEGABYTES


@pytest.mark.proof
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="other systems show another peak")
def test_the_peak_memory_of_a_reduction_is_neither_that_of_its_caller_nor_grows_with_the_samples():
    held = np.ones(10**8)  # 800 MB of this process
    peaks = [bench.measure_reduction(samples, 2).extra_columns[bench.MEMORY] for samples in (1_000_000, 4_000_000)]
    assert held.nbytes / 1e6 > MAX_MEGABYTES > max(peaks)
    assert peaks[1] < 1.5 * peaks[0]
