"""The bench measures what it says: every method computes the same, and its reports are whole. No speed here."""

from __future__ import annotations

import functools
import hashlib
import io
import itertools
import json
import math
import sys
import threading
import time

import numpy as np
import pytest

import hingepair as hp
from hingepair.bench import direct, engines, harness, plot, robots
from hingepair.bench.direct import LEVELS
from hingepair.bench.harness import Case, Method, Report, Row, installed, make_rows, time_interleaved
from hingepair.bench.plot import MethodCurve, Panel, draw_panels, write_picture
from hingepair.cli import bench as command
from support.commands import refusal, run_command
from support.drawn import drawn_texts
from support.states import generator

PRESENT, _ = installed(direct.METHODS, {engines.PINOCCHIO_CPP: "not here"})
MEASURED = [method for method in PRESENT if method.name not in {direct.COPY, direct.FRESH_COPY}]
FEW = tuple(method for method in PRESENT if method.name in {harness.HINGEPAIR, engines.PINOCCHIO, direct.COPY})


@pytest.fixture
def few(monkeypatch):
    """The methods that start quickly."""
    monkeypatch.setattr(direct, "METHODS", FEW)


@functools.cache
def ordinary():
    motion = direct.random_states(generator(80), 3, "acceleration")
    return motion, direct.truth_of(motion)


@pytest.mark.slow
@pytest.mark.parametrize("method", MEASURED, ids=lambda method: method.name)
def test_every_way_computes_the_truth(method):
    motion, truth = ordinary()
    for level in range(1, 4):
        assert direct.method_errors([method], motion[:level], truth)[method.name] < 20


@pytest.mark.slow
def test_one_state_is_computed_as_a_batch_is():
    one = [method for method in MEASURED if method.package != "jax" and method.min_samples == 1]
    motion = tuple(c[:1] for c in ordinary()[0])
    found = direct.method_errors(one, motion, direct.truth_of(motion))
    assert found.keys() == {method.name for method in one}
    assert max(found.values()) < 20


def _changed(change):
    """Our results, changed."""
    return lambda task: lambda: tuple(change(_named(task, direct.hingepair_job()(task)())).values())


def _named(task, results):
    return {name: result.copy() for name, result in zip(task.buffers, results, strict=True)}


def _with_nan(found):
    found["S2"][0, 1, 1] = np.nan
    return found


def _reduced(task):
    """Reduces psi modulo 2 pi in double."""
    q = task.motion[0].copy()
    q[:, 6] %= 2 * np.pi
    return direct.hingepair_job()(task._replace(motion=(q, *task.motion[1:])))


def _refuses(*_):
    raise hp.ArgumentError("q", "something else", 0)


@pytest.mark.slow
def test_the_error_columns_see_errors_and_what_is_not_finite():
    wrong = [
        Method("right", direct.hingepair_job()),
        Method("off", _changed(lambda found: {name: value + 1e-9 for name, value in found.items()})),
        Method("nan", _changed(_with_nan)),
        Method("refuses", _refuses),
        Method("reduced", _reduced),
    ]
    motion, truth = ordinary()
    found = direct.method_errors(wrong, motion[:2], truth)
    assert found["right"] < 12
    assert 1e4 < found["off"] < math.inf
    assert found["nan"] == found["refuses"] == math.inf
    motion = direct.hard_states(generator(82), "acceleration")
    found = direct.method_errors(wrong, motion, direct.truth_of(motion))
    assert found["right"] < 12
    assert found["reduced"] > 1e6


def test_rows_are_medians_of_one_run_and_ratios_to_the_first():
    """A call of b does 10 samples; its second repeat met noise that a's did not."""
    times = {"a": [1.0, 2.0, 4.0], "b": [5.0, 90.0, 16.0]}
    one, other = make_rows(Case("a case", {}, {"a": 1, "b": 10}, {"b": 2.0}), times)
    assert one == Row("a case", "a", 1, 2.0, 1.0, 1.0, None, {})
    assert other == Row("a case", "b", 10, 16.0, 5.0, 0.5, 2.0, {})
    assert (one.seconds_per_sample, other.seconds_per_sample) == (2.0, 1.6)


def test_every_repeat_goes_through_all_jobs():
    called = []
    times = time_interleaved({name: functools.partial(called.append, name) for name in "ab"}, 3)
    assert {name: len(own) for name, own in times.items()} == {"a": 3, "b": 3}
    order = [name for name, _ in itertools.groupby(called)]
    assert order == ["a", "b"] * 5


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux shows the states of threads")
def test_no_job_is_timed_while_a_neighbour_still_works():
    seen, threads, data = [], [threading.Thread()], bytes(60_000_000)

    def call_that_leaves_work_behind():
        begun = threading.Event()
        threads.append(threading.Thread(target=lambda: (begun.set(), hashlib.sha256(data))))
        threads[-1].start()
        begun.wait()
        time.sleep(0.002)  # or it is called several times for one measurement

    time_interleaved({"ours": lambda: seen.append(threads[-1].is_alive()), "theirs": call_that_leaves_work_behind}, 3)
    assert not any(seen[1:])  # the first call finds nothing before it


@pytest.mark.parametrize("shift", direct.OFFSETS.values())
def test_outputs_begin_where_they_are_said_to(shift):
    array = direct.array_at_offset((5, 3, 3), shift)
    assert array.shape == (5, 3, 3)
    assert array.flags.c_contiguous
    assert array.ctypes.data % 64 == shift


@pytest.mark.slow
def test_direct_prints_writes_and_draws(few, tmp_path):  # noqa: ARG001
    picture = tmp_path / "b.svg"
    options = ("--sizes", "1,2", "--levels", "pose", "--repeats", 1, "--no-cold")
    shown = run_command("bench", "direct", *options, "--plot", picture).stdout
    for words in (*(method.name for method in FEW), *direct.OFFSETS, "pose, N = 1", "pose, N = 2", "construction"):
        assert words in shown
    assert any(method.name in text for method in FEW for text in drawn_texts(picture))
    found = json.loads(run_command("bench", "direct", *options, "--json").stdout, parse_constant=pytest.fail)
    rows = {row["method"]: row for row in found["rows"] if row["case"] == "pose, N = 2"}
    assert rows.keys() == {method.name for method in FEW}
    assert rows[direct.COPY]["error"] is None
    assert rows[harness.HINGEPAIR]["error"] > 0
    assert rows[harness.HINGEPAIR]["extra_columns"][direct.HARD] > 0
    assert {"processor", "machine", "cores", "numpy", "pin"} <= found["facts"].keys()


def test_no_cell_of_the_report_is_cut(capsys):
    rows = [
        Row(f"{level}, N = 1,000,000", method.name, 10**6, 0.12, 0.12, 123.456, 1.2e-16, {direct.HARD: 3e14})
        for level in LEVELS
        for method in direct.METHODS
    ]
    rows += [Row(f"{'x' * 90}, N = 1", "y" * 40, 1, 1e-3, 1e-3, 123.0)]
    command._run_benchmark(lambda: Report(rows, "error"), False)
    assert "…" not in capsys.readouterr().out


@pytest.mark.slow
def test_more_methods_than_colours_are_drawn_each_with_its_name(tmp_path):
    curves = [
        MethodCurve(f"method {i}", [(10.0 + i, 3.0), (10.0 + i, 10.0 ** (i + 1))], second_is_hard=True)
        for i in range(14)
    ]
    curves.append(MethodCurve("infinite", [(5.0, 2.0), (5.0, math.inf)], second_is_hard=True))
    panel = Panel("a", "x", "y", curves, min_x=1.0, max_y=10.0)
    path = tmp_path / "p.svg"
    draw_panels([[panel, panel._replace(max_y=None, x_descending=True, curves=curves[:3])]]).savefig(path)
    text = path.read_text()
    for name in ("method 13", "infinite", "copying the outputs", "1e+14", "inf"):
        assert text.count(f"<!-- {name} -->") == 1


@pytest.mark.slow
def test_a_small_picture_keeps_the_colour_of_every_curve():
    from PIL import Image

    names = [f"robot {k}" for k in range(4)]
    methods = ["hingepair", "Python loop", "C++ loop", "batches", "MuJoCo", "frax"]
    curves = [MethodCurve(name, [(10.0**i, float(k)) for k in range(4)]) for i, name in enumerate(methods)]
    panel = Panel("pose", "run time", "", curves, y_names=names, x_range=(0.1, 1e6))
    file = io.BytesIO()
    write_picture([[panel, panel], [panel, panel]], file, "png")
    assert len(file.getvalue()) < 100_000
    colours = {colour for _, colour in Image.open(file).convert("RGB").getcolors(1_000_000)}
    wanted = [tuple(bytes.fromhex(colour[1:])) for colour in plot.COLOURS[: len(methods)]]
    assert [colour for colour in wanted if colour not in colours] == []


@pytest.mark.slow
@pytest.mark.parametrize("path", ["no/such/folder/b.png", "b.tiger"])
def test_a_picture_that_cannot_be_written_is_refused_before_measuring(path, tmp_path, monkeypatch):
    monkeypatch.setattr(direct, "bench_direct", lambda *_: pytest.fail("measured"))
    assert refusal("bench", "direct", "--plot", tmp_path / path).startswith("--plot: ")


def test_a_way_that_is_not_installed_is_a_line(monkeypatch):
    monkeypatch.setattr(harness, "find_spec", lambda name: None if name in {"jax", "mujoco"} else True)
    found, left_out = installed(direct.METHODS, engines.cpp_reasons(False))
    assert not [method for method in found if method.package in {"jax", "mujoco"}]
    named = {line.split(",")[0] for line in left_out}
    assert {f"left out: {name}" for name in ("MuJoCo", "JAX", "Pinocchio")} <= named


def test_without_a_compiler_or_headers_the_cpp_loop_is_a_line(monkeypatch):
    engines.compile_loops.cache_clear()
    monkeypatch.setattr(engines, "_header_folders", lambda: iter(()))
    assert "pinocchio/algorithm/" in engines.cpp_reasons(True)[engines.PINOCCHIO_CPP]
    monkeypatch.setenv("PATH", "")
    assert "a C++ compiler" in engines.cpp_reasons(True)[engines.PINOCCHIO_CPP]


@pytest.mark.proof(80)
def test_the_cpp_loop_computes_the_truth(monkeypatch):
    """Not optimised, and with what Pinocchio's library has compiled already."""
    engines.compile_loops.cache_clear()
    library = next(engines._header_folders()).parent / "lib"
    linked = ("-Wl,--no-as-needed", f"-L{library}", f"-Wl,-rpath,{library}", "-lpinocchio_default")
    kept = [flag for flag in engines._CPP_FLAGS if flag not in {"-O3", "-march=native"}]
    flags = (*kept, "-O0", "-DPINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION", *linked)
    monkeypatch.setattr(engines, "_CPP_FLAGS", flags)
    assert engines.cpp_reasons(True) == {}
    motion, truth = ordinary()
    method = next(method for method in direct.METHODS if method.name == engines.PINOCCHIO_CPP)
    for level in range(1, 4):
        assert direct.method_errors([method], motion[:level], truth)[method.name] < 20
    method = next(method for method in robots.METHODS if method.name == engines.PINOCCHIO_CPP)
    for name in ("ur5_robot", "panda", "solo12", "talos_reduced"):
        robot, model = robots.load_models(name)
        for workload in robots.WORKLOADS:
            task = robots.make_task(robot, model, workload, 1)
            limit = {engines.FORWARD: 1e-13, engines.ACCELERATION_SLOPES: 1e-11}.get(workload, 4e-15)
            assert robots.result_error(method, task, robots.exact_results(task)) < limit, (name, workload)


@pytest.mark.slow
def test_what_is_measured_in_fresh_processes_runs(monkeypatch):
    cases = {}
    monkeypatch.setattr(direct, "measure_cold", lambda case, codes, *_: cases.setdefault(case, codes) and [])
    monkeypatch.setattr(direct, "COLD_SIZES", (1, 5))
    direct.measure_starts(1)
    cases["robot"] = robots._cold_codes("panda")
    assert [*map(len, cases.values())] == [2, 1, 3, 3, 1]
    for codes in cases.values():
        for before, timed in codes.values():
            if "main()" in timed:
                compile(f"{before}\n{timed}", "run", "exec")
            else:
                exec(f"{before}\n{timed}", {})


@pytest.mark.slow
def test_first_calls_are_measured_in_fresh_processes_and_find_code_on_the_disk_the_second_time():
    before = """
import os
from pathlib import Path
known = Path(os.environ["HINGEPAIR_CACHE"], "code")
calls = []
"""
    timed = "time.sleep(0.01 if calls else 0.05 if known.exists() else 0.3); known.touch(); calls.append(1)"
    rows = harness.measure_cold("a case", {"a": (before, timed)}, 1)
    assert [row.method for row in rows] == [f"a, {call}" for call in (harness.FIRST, harness.ON_DISK, harness.SECOND)]
    first, on_disk, second = (row.seconds for row in rows)
    assert first > 0.3 > on_disk > 0.05 > second
    (started,) = harness.measure_cold("import", {"json": ("", "import json")}, 1, (harness.FIRST,))
    assert (started.method, started.ratio) == ("json, first call", 1)
