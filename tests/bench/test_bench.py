"""The bench measures what it says: every method computes the same, and its reports are whole. No speed here."""

from __future__ import annotations

import functools
import hashlib
import io
import itertools
import json
import math
import os
import sys
import threading
import time

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench import direct, engines, measure, peers, plot, skip, truth
from hingepair.bench.measure import Method, Report, Row, available_methods, make_rows, time_interleaved
from hingepair.bench.peers import OUTPUT_NAMES_BY_LEVEL
from hingepair.bench.plot import MethodCurve, Panel, draw_panels, write_picture
from hingepair.cli import bench as command
from support.commands import refusal, run_command
from support.drawn import drawn_texts
from support.reference import from_euler
from support.states import generator

PAIR = hp.HingePair(**peers.BENCH_PAIR_ARGUMENT_BY_NAME)
PRESENT, _ = available_methods(peers.COMPARED_KINEMATICS_METHODS, {engines.PINOCCHIO_CPP_NAME: "not here"})
MEASURED = [method for method in PRESENT if method.name not in {peers.COPY_FLOOR_NAME, peers.FRESH_COPY_FLOOR_NAME}]
FEW = tuple(
    method
    for method in PRESENT
    if method.name in {peers.HINGEPAIR_NAME, engines.PINOCCHIO_LOOP_NAME, peers.COPY_FLOOR_NAME}
)


@pytest.fixture
def few(monkeypatch):
    """The methods that start quickly, and few states to compare them by."""
    monkeypatch.setattr(peers, "COMPARED_KINEMATICS_METHODS", FEW)
    monkeypatch.setattr(direct, "_NUM_RANDOM_STATES_COMPARED_WITH_EXACT", 3)
    monkeypatch.setattr(direct, "hard_states", lambda rng, parts: tuple(c[:3] for c in truth.hard_states(rng, parts)))


@pytest.fixture(scope="module")
def ordinary():
    return {
        level: truth.ExactResults(
            peers.BENCH_PAIR_ARGUMENT_BY_NAME,
            truth.random_states(generator(80), 3, parts),
            OUTPUT_NAMES_BY_LEVEL[level],
        )
        for parts, level in enumerate(OUTPUT_NAMES_BY_LEVEL, 1)
    }


@pytest.fixture(scope="module")
def hard():
    return truth.ExactResults(
        peers.BENCH_PAIR_ARGUMENT_BY_NAME, truth.hard_states(generator(82), 3), OUTPUT_NAMES_BY_LEVEL["acceleration"]
    )


@pytest.mark.slow
def test_the_truth_is_that_of_the_tests():
    """Two routes, differences in time and Taylor series, meet in 40 digits."""
    states = (*truth.random_states(generator(79), 1, 3), *truth.hard_states(generator(79), 3))
    for motion in (states[:3], states[3:]):
        constants = [np.array(peers.BENCH_PAIR_ARGUMENT_BY_NAME[key]) for key in ("u1", "u2", "n", "home")]
        expected = from_euler(constants, *motion)
        for i, state in enumerate(zip(*motion, strict=True)):
            found = truth.compute_exact_outputs(peers.BENCH_PAIR_ARGUMENT_BY_NAME, *state)
            with mpmath.workdps(60):
                for name in OUTPUT_NAMES_BY_LEVEL["acceleration"]:
                    true, scale = expected.values[name][i].ravel(), mpmath.mpf(float(expected.scales[name][i]))
                    gap = max(abs(a - b) for a, b in zip(found[name], true, strict=True))
                    assert gap <= mpmath.mpf("1e-40") * scale, (name, i)


def _cases():
    for method in MEASURED:
        for level in OUTPUT_NAMES_BY_LEVEL:
            slow = method.package == "jax" or level != "acceleration"
            yield pytest.param(method, level, marks=[pytest.mark.slow] * slow, id=f"{method.name}-{level}")


@pytest.mark.slow
@pytest.mark.parametrize(("method", "level"), [*_cases()])
def test_every_way_computes_the_truth(method, level, ordinary):
    assert direct.method_errors(PAIR, [method], ordinary[level])[method.name] < 20


@pytest.mark.slow
def test_one_state_is_computed_as_a_batch_is(ordinary):
    one = [method for method in MEASURED if method.package != "jax" and method.min_samples == 1]
    motion = tuple(c[:1] for c in ordinary["acceleration"].motion)
    single = truth.ExactResults(peers.BENCH_PAIR_ARGUMENT_BY_NAME, motion, OUTPUT_NAMES_BY_LEVEL["acceleration"])
    found = direct.method_errors(PAIR, one, single)
    assert found.keys() == {method.name for method in one}
    assert max(found.values()) < 20


def _changed(change):
    """Our results, changed."""
    return lambda task: lambda: change(_named(task, peers.hingepair_job_maker()(task)()))


def _named(task, results):
    return {name: result.copy() for name, result in zip(task.buffers, results, strict=True)}


def _with_nan(found):
    found["S2"][0, 1, 1] = np.nan
    return found


def _reduced(task):
    """Reduces psi modulo 2 pi in double."""
    q = task.motion[0].copy()
    q[:, 6] %= 2 * np.pi
    return peers.hingepair_job_maker()(task._replace(motion=(q, *task.motion[1:])))


def _refuses(*_):
    raise hp.ArgumentError("q", "something else", 0)


@pytest.mark.slow
def test_the_error_columns_see_errors_and_what_is_not_finite(ordinary, hard):
    wrong = [
        Method("right", peers.hingepair_job_maker()),
        Method("off", _changed(lambda found: {name: value + 1e-9 for name, value in found.items()})),
        Method("nan", _changed(_with_nan)),
        Method("refuses", _refuses),
        Method("reduced", _reduced),
    ]
    found = direct.method_errors(PAIR, wrong, ordinary["velocity"])
    assert found["right"] < 12
    assert 1e4 < found["off"] < math.inf
    assert found["nan"] == found["refuses"] == math.inf
    found = direct.method_errors(PAIR, wrong, hard)
    assert found["right"] < 12
    assert found["reduced"] > 1e6


def test_rows_are_medians_of_one_run_and_ratios_to_the_first():
    """A call of b does 10 samples; its second repeat met noise that a's did not."""
    times = {"a": [1.0, 2.0, 4.0], "b": [5.0, 90.0, 16.0]}
    one, other = make_rows("a case", times, {"a": 1, "b": 10}, {"b": 2.0})
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


@pytest.mark.parametrize("shift", direct.OUTPUT_OFFSET_BYTES_FROM_CACHE_LINE_BY_METHOD_NAME.values())
def test_outputs_begin_where_they_are_said_to(shift):
    array = direct.allocate_at_offset((5, 3, 3), shift)
    assert array.shape == (5, 3, 3)
    assert array.flags.c_contiguous
    assert array.ctypes.data % 64 == shift


@pytest.mark.slow
def test_each_offset_has_a_row_beside_the_floor():
    rows = direct.measure_offsets(9, ["pose", "velocity"], 1)
    assert [row.method for row in rows] == [
        peers.COPY_FLOOR_NAME,
        *direct.OUTPUT_OFFSET_BYTES_FROM_CACHE_LINE_BY_METHOD_NAME,
    ] * 2
    assert list(dict.fromkeys(row.case for row in rows)) == [
        f"{direct.OUTPUT_OFFSETS_CASE_NAME_PREFIX}: pose, N = 9",
        f"{direct.OUTPUT_OFFSETS_CASE_NAME_PREFIX}: velocity, N = 9",
    ]
    assert all(row.count == 9 and row.seconds > 0 for row in rows)
    assert direct.measure_offsets(1, ["pose"], 1) == []


@pytest.mark.slow
def test_direct_prints_writes_and_draws(few, tmp_path):  # noqa: ARG001
    picture = tmp_path / "b.svg"
    options = ("--sizes", "1,2", "--levels", "pose", "--repeats", 1, "--no-cold", "--plot", picture)
    shown = run_command("bench", "direct", *options).stdout
    for words in (
        *(method.name for method in FEW),
        *direct.OUTPUT_OFFSET_BYTES_FROM_CACHE_LINE_BY_METHOD_NAME,
        "pose, N = 1",
        "pose, N = 2",
        direct.PAIR_CONSTRUCTION_CASE_NAME,
    ):
        assert words in shown
    assert any(method.name in text for method in FEW for text in drawn_texts(picture))


@pytest.mark.slow
def test_json_has_every_row_both_errors_and_the_machine(few):  # noqa: ARG001
    options = ("--sizes", 2, "--levels", "pose", "--repeats", 1, "--no-cold", "--json")
    found = json.loads(run_command("bench", "direct", *options).stdout, parse_constant=pytest.fail)
    rows = {row["method"]: row for row in found["rows"] if row["case"] == "pose, N = 2"}
    assert rows.keys() == {method.name for method in FEW}
    assert rows[peers.COPY_FLOOR_NAME]["error"] is None
    assert rows[peers.HINGEPAIR_NAME]["error"] > 0
    assert rows[peers.HINGEPAIR_NAME]["extra_columns"][direct.HARD_STATE_ERROR_COLUMN_HEADING] > 0
    assert {"processor", "machine", "cores", "numpy", "pin"} <= found["facts"].keys()


def _row(case, method, ratio, seconds=1e-3):
    return Row(case, method, 1, seconds, seconds, ratio)


def test_no_cell_of_the_report_is_cut(capsys):
    rows = [
        Row(
            direct.case_name(level, size),
            method.name,
            10**6,
            0.123456,
            0.123456,
            123.456,
            1.2e-16,
            {direct.HARD_STATE_ERROR_COLUMN_HEADING: 3e14},
        )
        for level in OUTPUT_NAMES_BY_LEVEL
        for size in (1, 100, 10_000, 1_000_000)
        for method in peers.COMPARED_KINEMATICS_METHODS
    ]
    cases = [
        f"{direct.FRESH_PROCESS_CASE_NAME_PREFIX}: {name}"
        for name in (*direct.BATCH_SIZES_OF_CALLS_BY_SEQUENCE_NAME, "import")
    ]
    rows += [
        _row(case, method, 123.0)
        for case in cases
        for method in (*direct.BACKEND_NAMES_OF_CALL_SEQUENCES, "hingepair")
    ]
    rows += [
        _row(case, peers.HINGEPAIR_NAME, 1.0)
        for case in (direct.CONTROL_CYCLE_CASE_NAME, direct.PAIR_CONSTRUCTION_CASE_NAME)
    ]
    cases = [
        direct.case_name(f"{direct.OUTPUT_OFFSETS_CASE_NAME_PREFIX}: {level}", 1_000_000)
        for level in OUTPUT_NAMES_BY_LEVEL
    ]
    rows += [
        _row(case, method, 1.0)
        for case in cases
        for method in direct.OUTPUT_OFFSET_BYTES_FROM_CACHE_LINE_BY_METHOD_NAME
    ]
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
    wanted = [tuple(bytes.fromhex(colour[1:])) for colour in plot._CURVE_COLOUR_CYCLE[: len(methods)]]
    assert [colour for colour in wanted if colour not in colours] == []


@pytest.mark.slow
@pytest.mark.parametrize("bench", ["direct", "integrate"])
@pytest.mark.parametrize("path", ["no/such/folder/b.png", "b.tiger"])
def test_a_picture_that_cannot_be_written_is_refused_before_measuring(bench, path, tmp_path, monkeypatch):
    from hingepair.bench import integrate

    monkeypatch.setattr(direct, "measure_kinematics", lambda *_: pytest.fail("measured"))
    monkeypatch.setattr(integrate, "measure_integration", lambda *_: pytest.fail("measured"))
    assert refusal("bench", bench, "--plot", tmp_path / path).startswith("--plot: ")


def test_a_way_that_is_not_installed_is_a_line(monkeypatch):
    monkeypatch.setattr(measure, "find_spec", lambda name: None if name in {"jax", "mujoco"} else True)
    found, left_out = available_methods(
        peers.COMPARED_KINEMATICS_METHODS, {engines.PINOCCHIO_CPP_NAME: engines.cpp_missing_reason(False)}
    )
    assert not [method for method in found if method.package in {"jax", "mujoco"}]
    assert {f"left out: {name}" for name in ("MuJoCo", "JAX", "Pinocchio")} <= {
        line.split(",")[0] for line in left_out
    }


def test_without_a_compiler_or_headers_the_cpp_loop_is_a_line(monkeypatch):
    engines.compile_library.cache_clear()
    monkeypatch.setattr(engines, "_header_folders", lambda: iter(()))
    assert "pinocchio/algorithm/" in engines.cpp_missing_reason(True)
    monkeypatch.setenv("PATH", "")
    assert "a C++ compiler" in engines.cpp_missing_reason(True)


@pytest.mark.proof
def test_the_cpp_loop_computes_the_truth(ordinary, monkeypatch):
    """Not optimised, and with what Pinocchio's library has compiled already, which takes a tenth of the time."""
    engines.compile_library.cache_clear()
    library = next(engines._header_folders()).parent / "lib"
    linked = ("-Wl,--no-as-needed", f"-L{library}", f"-Wl,-rpath,{library}", "-lpinocchio_default")
    kept = [flag for flag in engines._CPP_COMPILER_FLAGS if flag not in {"-O3", "-march=native"}]
    flags = (*kept, "-O0", "-DPINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION", *linked)
    monkeypatch.setattr(engines, "_CPP_COMPILER_FLAGS", flags)
    assert engines.cpp_missing_reason(True) is None
    method = next(method for method in peers.COMPARED_KINEMATICS_METHODS if method.name == engines.PINOCCHIO_CPP_NAME)
    for level in OUTPUT_NAMES_BY_LEVEL:
        assert direct.method_errors(PAIR, [method], ordinary[level])[method.name] < 20


@pytest.mark.slow
def test_skip_compares_every_program_with_the_whole_one():
    found = json.loads(run_command("bench", "skip", "--samples", 50, "--repeats", 1, "--json").stdout)["rows"]
    for name in skip.make_folding_cases(2):
        assert len([row for row in found if row["method"] == name]) == 2
    assert [row["ratio"] for row in found if row["method"] == skip.UNFOLDED_CASE_NAME] == [1, 1]
    operations = {row["method"]: row["extra_columns"]["operations"] for row in found}
    whole = operations.pop(skip.UNFOLDED_CASE_NAME)
    assert operations.pop("float32") == operations.pop("constant rates") == whole
    assert all(0 < left < whole for left in operations.values())


@pytest.mark.slow
def test_what_is_known_changes_no_output():
    known = skip.make_folding_cases(20)
    for pair, motion, outputs in known.values():
        folded = pair.forward_kinematics(*motion, outputs=outputs)
        full = pair.forward_kinematics(
            *(np.stack(np.broadcast_arrays(*part), axis=-1) for part in motion), outputs=outputs, backend="numpy"
        )
        for name in outputs:
            unit = np.finfo(getattr(full, name).dtype).eps
            np.testing.assert_allclose(getattr(folded, name), getattr(full, name), rtol=0, atol=40 * unit)


@pytest.mark.slow(4)
def test_starts_are_measured_in_fresh_processes(monkeypatch):
    monkeypatch.setattr(
        direct, "BATCH_SIZES_OF_CALLS_BY_SEQUENCE_NAME", {direct.ONE_LARGE_CALL_SEQUENCE_NAME: "[3, 1]"}
    )
    fresh = direct._run_fresh_process
    monkeypatch.setattr(
        direct, "_run_fresh_process", lambda code, _: fresh(code, dict(os.environ))
    )  # compiled already
    rows = direct.measure_fresh_processes(1)
    assert len(rows) == 2 + 1 + len(direct.BACKEND_NAMES_OF_CALL_SEQUENCES)
    assert all(row.seconds > 0 for row in rows)
    assert {direct.IMPORT_CASE_NAME, direct.RUN_CASE_NAME} < {row.case for row in rows}
