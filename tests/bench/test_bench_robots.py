"""Every engine of `bench robots` computes what Pinocchio computes; the report holds a row for each."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.bench import engines
from hingepair.bench import robots as bench
from support.sparse import sparse

CASES = [(name, workload) for name in bench.ROBOTS for workload in bench.WORKLOADS]


@pytest.mark.parametrize(("name", "workload"), sparse(CASES, 5))
def test_all_engines_agree(name, workload):
    robot, model = bench._models(name)
    task = bench.task_of(name, robot, model, workload, 3)
    for way in bench.WAYS:
        asked = workload in bench._WORKLOADS_OF.get(way.name, bench.WORKLOADS)
        if asked and way.name not in (bench.CPP, bench.FRAX):
            one = bench.task_of(name, robot, model, workload, 1) if way.name == bench.PREPARED else task
            assert bench.error_of(way, one) < 1e-11, way.name


def test_an_error_is_seen():
    robot, model = bench._models("ur5_robot")
    task = bench.task_of("ur5_robot", robot, model, bench.INVERSE, 3)
    wrong = bench.Way("wrong", lambda own: lambda: np.asarray(bench.ours(own)()) * (1 + 1e-3))
    assert 5e-4 < bench.error_of(wrong, task) < 2e-3


@pytest.mark.slow
def test_the_report_has_a_row_for_each_engine():
    report = bench.robots(["ur5_robot"], [1, 10], 1, False)
    assert {row.case for row in report.rows} == {
        f"ur5 (6 joints), {workload}, N = {size}" for workload in bench.WORKLOADS for size in (1, 10)
    }
    assert {bench.PREPARED, bench.OURS, bench.PYTHON_LOOP, bench.MUJOCO} <= {row.method for row in report.rows}
    assert len(report.panels[0]) == len(bench.WORKLOADS)
    assert all(row.error is not None and row.error < 1e-11 for row in report.rows)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # frax's own
def test_frax_agrees():
    robot, model = bench._models("ur5_robot")
    way = next(way for way in bench.WAYS if way.name == bench.FRAX)
    for workload in (bench.INVERSE, bench.FORWARD):
        assert bench.error_of(way, bench.task_of("ur5_robot", robot, model, workload, 4)) < 1e-11


@pytest.mark.proof
def test_the_cpp_loop_agrees(monkeypatch):
    """Not optimised, and with what Pinocchio's library has compiled already, which takes a tenth of the time."""
    engines.compiled_library.cache_clear()
    bench._robots_library.cache_clear()
    library = next(engines._headers()).parent / "lib"
    linked = ("-Wl,--no-as-needed", f"-L{library}", f"-Wl,-rpath,{library}", "-lpinocchio_default")
    kept = [flag for flag in engines._FLAGS if flag not in {"-O3", "-march=native"}]
    flags = (*kept, "-O0", "-DPINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION", *linked)
    monkeypatch.setattr(engines, "_FLAGS", flags)
    way = next(way for way in bench.WAYS if way.name == bench.CPP)
    for name, workload in CASES:
        robot, model = bench._models(name)
        assert bench.error_of(way, bench.task_of(name, robot, model, workload, 3)) < 1e-12, (name, workload)
