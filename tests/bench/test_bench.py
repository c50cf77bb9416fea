"""The bench measures what it says: every way computes the same, and its reports are whole. No speed here."""

from __future__ import annotations

import functools
import hashlib
import io
import itertools
import json
import math
import sys
import threading

import mpmath
import numpy as np
import pytest
from typer.testing import CliRunner

import hingepair as hp
from hingepair.bench import direct, engines, measure, peers, plot, skip, truth
from hingepair.bench.measure import Report, Row, Way, interleaved, present, rows_of
from hingepair.bench.peers import LEVELS
from hingepair.bench.plot import Curve, Panel, drawn, write_picture
from hingepair.cli import bench as command
from hingepair.cli.main import app
from support.reference import from_euler
from support.states import generator

PAIR = hp.HingePair(**peers.CONSTANTS)
PRESENT, _ = present(peers.WAYS, {engines.CPP: "not here"})
MEASURED = [way for way in PRESENT if way.name not in {peers.FLOOR, peers.FRESH_FLOOR}]
FEW = tuple(way for way in PRESENT if way.name in {peers.OURS, engines.PYTHON_LOOP, peers.FLOOR})


def run(*options):
    return CliRunner().invoke(app, ["bench", *options])


@pytest.fixture
def few(monkeypatch):
    """The ways that start quickly, and few states to compare them by."""
    monkeypatch.setattr(peers, "WAYS", FEW)
    monkeypatch.setattr(direct, "_COMPARED", 3)
    monkeypatch.setattr(direct, "hard_states", lambda rng, parts: tuple(c[:3] for c in truth.hard_states(rng, parts)))


@pytest.fixture(scope="module")
def ordinary():
    return {
        level: truth.Truth(peers.CONSTANTS, truth.random_states(generator(80), 3, parts), LEVELS[level])
        for parts, level in enumerate(LEVELS, 1)
    }


@pytest.fixture(scope="module")
def hard():
    return truth.Truth(peers.CONSTANTS, truth.hard_states(generator(82), 3), LEVELS["acceleration"])


@pytest.mark.slow
def test_the_truth_is_that_of_the_tests():
    """Two routes, differences in time and Taylor series, meet in 40 digits."""
    states = (*truth.random_states(generator(79), 1, 3), *truth.hard_states(generator(79), 3))
    for motion in (states[:3], states[3:]):
        constants = [np.array(peers.CONSTANTS[key]) for key in ("u1", "u2", "n", "home")]
        expected = from_euler(constants, *motion)
        for i, state in enumerate(zip(*motion, strict=True)):
            found = truth.exact(peers.CONSTANTS, *state)
            with mpmath.workdps(60):
                for name in LEVELS["acceleration"]:
                    true, scale = expected.values[name][i].ravel(), mpmath.mpf(float(expected.scales[name][i]))
                    gap = max(abs(a - b) for a, b in zip(found[name], true, strict=True))
                    assert gap <= mpmath.mpf("1e-40") * scale, (name, i)


def _cases():
    for way in MEASURED:
        for level in LEVELS:
            slow = way.needs == "jax" or level != "acceleration"
            yield pytest.param(way, level, marks=[pytest.mark.slow] * slow, id=f"{way.name}-{level}")


@pytest.mark.slow
@pytest.mark.parametrize(("way", "level"), [*_cases()])
def test_every_way_computes_the_truth(way, level, ordinary):
    assert direct.errors(PAIR, [way], ordinary[level])[way.name] < 20


def test_one_state_is_computed_as_a_batch_is(ordinary):
    one = [way for way in MEASURED if way.needs != "jax" and way.least == 1]
    motion = tuple(c[:1] for c in ordinary["acceleration"].motion)
    single = truth.Truth(peers.CONSTANTS, motion, LEVELS["acceleration"])
    found = direct.errors(PAIR, one, single)
    assert found.keys() == {way.name for way in one}
    assert max(found.values()) < 20


def _changed(change):
    """Our results, changed."""
    return lambda task: lambda: change(_named(task, peers.ours()(task)()))


def _named(task, results):
    return {name: result.copy() for name, result in zip(task.room, results, strict=True)}


def _with_nan(found):
    found["S2"][0, 1, 1] = np.nan
    return found


def _reduced(task):
    """Reduces psi modulo 2 pi in double."""
    q = task.motion[0].copy()
    q[:, 6] %= 2 * np.pi
    return peers.ours()(task._replace(motion=(q, *task.motion[1:])))


def _refuses(*_):
    raise hp.ArgumentError("q", "something else", 0)


@pytest.mark.slow
def test_the_error_columns_see_errors_and_what_is_not_finite(ordinary, hard):
    wrong = [
        Way("right", peers.ours()),
        Way("off", _changed(lambda found: {name: value + 1e-9 for name, value in found.items()})),
        Way("nan", _changed(_with_nan)),
        Way("refuses", _refuses),
        Way("reduced", _reduced),
    ]
    found = direct.errors(PAIR, wrong, ordinary["velocity"])
    assert found["right"] < 12
    assert 1e4 < found["off"] < math.inf
    assert found["nan"] == found["refuses"] == math.inf
    found = direct.errors(PAIR, wrong, hard)
    assert found["right"] < 12
    assert found["reduced"] > 1e6


def test_rows_are_medians_of_one_run_and_ratios_to_the_first():
    """A call of b does 10 samples; its second repeat met noise that a's did not."""
    times = {"a": [1.0, 2.0, 4.0], "b": [5.0, 90.0, 16.0]}
    one, other = rows_of("a case", times, {"a": 1, "b": 10}, {"b": 2.0})
    assert one == Row("a case", "a", 1, 2.0, 1.0, 1.0, None, {})
    assert other == Row("a case", "b", 10, 16.0, 5.0, 0.5, 2.0, {})
    assert (one.each, other.each) == (2.0, 1.6)


def test_every_repeat_goes_through_all_jobs():
    called = []
    times = interleaved({name: functools.partial(called.append, name) for name in "ab"}, 3)
    assert {name: len(own) for name, own in times.items()} == {"a": 3, "b": 3}
    order = [name for name, _ in itertools.groupby(called)]
    assert order == ["a", "b"] * 5


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux shows the states of threads")
def test_no_job_is_timed_while_a_neighbour_still_works():
    seen, threads, data = [], [threading.Thread()], bytes(3_000_000)

    def call_that_leaves_work_behind():
        begun = threading.Event()
        threads.append(threading.Thread(target=lambda: (begun.set(), hashlib.sha256(data))))
        threads[-1].start()
        begun.wait()

    interleaved({"ours": lambda: seen.append(threads[-1].is_alive()), "theirs": call_that_leaves_work_behind}, 3)
    assert not any(seen[1:])  # the first call finds nothing before it


@pytest.mark.parametrize("shift", direct.SHIFTS.values())
def test_outputs_begin_where_they_are_said_to(shift):
    array = direct.array_at((5, 3, 3), shift)
    assert array.shape == (5, 3, 3)
    assert array.flags.c_contiguous
    assert array.ctypes.data % 64 == shift


def test_each_offset_has_a_row_beside_the_floor():
    rows = direct.offsets(9, ["pose", "velocity"], 1)
    assert [row.method for row in rows] == [peers.FLOOR, *direct.SHIFTS] * 2
    assert list(dict.fromkeys(row.case for row in rows)) == [
        f"{direct.OFFSETS}: pose, N = 9",
        f"{direct.OFFSETS}: velocity, N = 9",
    ]
    assert all(row.count == 9 and row.seconds > 0 for row in rows)
    assert direct.offsets(1, ["pose"], 1) == []


@pytest.mark.slow
def test_direct_prints_writes_and_draws(few, tmp_path):  # noqa: ARG001
    picture = tmp_path / "b.png"
    done = run("direct", "--sizes", "1,2", "--levels", "pose", "--repeats", "1", "--no-cold", "--plot", str(picture))
    assert done.exit_code == 0, done.output
    for words in (*(way.name for way in FEW), *direct.SHIFTS, "pose, N = 1", "pose, N = 2", direct.MADE):
        assert words in done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_json_has_every_row_both_errors_and_the_machine(few):  # noqa: ARG001
    done = run("direct", "--sizes", "2", "--levels", "pose", "--repeats", "1", "--no-cold", "--json")
    found = json.loads(done.stdout, parse_constant=pytest.fail)
    rows = {row["method"]: row for row in found["rows"] if row["case"] == "pose, N = 2"}
    assert rows.keys() == {way.name for way in FEW}
    assert rows[peers.FLOOR]["error"] is None
    assert rows[peers.OURS]["error"] > 0
    assert rows[peers.OURS]["more"][direct.HARD] > 0
    assert {"processor", "machine", "cores", "numpy", "pin"} <= found["facts"].keys()


def _row(case, method, ratio, seconds=1e-3):
    return Row(case, method, 1, seconds, seconds, ratio)


def test_no_cell_of_the_report_is_cut(capsys):
    rows = [
        Row(direct.case_of(level, size), way.name, 10**6, 0.123456, 0.123456, 123.456, 1.2e-16, {direct.HARD: 3e14})
        for level in LEVELS
        for size in (1, 100, 10_000, 1_000_000)
        for way in peers.WAYS
    ]
    cases = [f"{direct.STARTS}: {name}" for name in (*direct.SEQUENCES, "import")]
    rows += [_row(case, method, 123.0) for case in cases for method in (*direct.BACKENDS, "hingepair")]
    rows += [_row(case, peers.OURS, 1.0) for case in (direct.CYCLE, direct.MADE)]
    cases = [direct.case_of(f"{direct.OFFSETS}: {level}", 1_000_000) for level in LEVELS]
    rows += [_row(case, method, 1.0) for case in cases for method in direct.SHIFTS]
    command._report(lambda: Report(rows, "error"), False)
    assert "…" not in capsys.readouterr().out


@pytest.mark.slow
def test_more_methods_than_colours_are_drawn_each_with_its_name(tmp_path):
    curves = [Curve(f"method {i}", [(10.0 + i, 3.0), (10.0 + i, 10.0 ** (i + 1))], hard=True) for i in range(14)]
    curves.append(Curve("infinite", [(5.0, 2.0), (5.0, math.inf)], hard=True))
    panel = Panel("a", "x", "y", curves, floor=1.0, most=10.0)
    path = tmp_path / "p.svg"
    drawn([[panel, panel._replace(most=None, falling=True, curves=curves[:3])]]).savefig(path)
    text = path.read_text()
    for name in ("method 13", "infinite", "copying the outputs", "1e+14", "inf"):
        assert text.count(f"<!-- {name} -->") == 1


@pytest.mark.slow
def test_a_small_picture_keeps_the_colour_of_every_curve():
    from PIL import Image

    names = [f"robot {k}" for k in range(4)]
    methods = ["hingepair", "Python loop", "C++ loop", "batches", "MuJoCo", "frax"]
    curves = [Curve(name, [(10.0**i, float(k)) for k in range(4)]) for i, name in enumerate(methods)]
    panel = Panel("pose", "run time", "", curves, names=names, span=(0.1, 1e6))
    file = io.BytesIO()
    write_picture([[panel, panel], [panel, panel]], file, "png")
    assert len(file.getvalue()) < 100_000
    colours = {colour for _, colour in Image.open(file).convert("RGB").getcolors(1_000_000)}
    wanted = [tuple(bytes.fromhex(colour[1:])) for colour in plot._COLOURS[: len(methods)]]
    assert [colour for colour in wanted if colour not in colours] == []


@pytest.mark.slow
@pytest.mark.parametrize("bench", ["direct", "integrate"])
@pytest.mark.parametrize("path", ["no/such/folder/b.png", "b.tiger"])
def test_a_picture_that_cannot_be_written_is_refused_before_measuring(bench, path, tmp_path, monkeypatch):
    from hingepair.bench import integrate

    monkeypatch.setattr(direct, "direct", lambda *_: pytest.fail("measured"))
    monkeypatch.setattr(integrate, "integrate", lambda *_: pytest.fail("measured"))
    done = run(bench, "--plot", str(tmp_path / path))
    assert isinstance(done.exception, hp.ArgumentError)
    assert done.exception.name == "--plot"


@pytest.mark.parametrize("option", [("--sizes", "x"), ("--sizes", "0"), ("--levels", "jerk")])
def test_bad_options(option):
    assert isinstance(run("direct", *option).exception, hp.ArgumentError)


def test_a_way_that_is_not_installed_is_a_line(monkeypatch):
    monkeypatch.setattr(measure, "find_spec", lambda name: None if name in {"jax", "mujoco"} else True)
    found, left_out = present(peers.WAYS, {engines.CPP: engines.cpp_missing(False)})
    assert not [way for way in found if way.needs in {"jax", "mujoco"}]
    assert {f"left out: {name}" for name in ("MuJoCo", "JAX", "Pinocchio")} <= {
        line.split(",")[0] for line in left_out
    }


def test_without_a_compiler_or_headers_the_cpp_loop_is_a_line(monkeypatch):
    engines.compiled_library.cache_clear()
    monkeypatch.setattr(engines, "_headers", lambda: iter(()))
    assert "pinocchio/algorithm/" in engines.cpp_missing(True)
    monkeypatch.setenv("PATH", "")
    assert "a C++ compiler" in engines.cpp_missing(True)


@pytest.mark.slow(20)
def test_the_cpp_loop_computes_the_truth(ordinary, monkeypatch):
    """Not optimised, and with what Pinocchio's library has compiled already, which takes a tenth of the time."""
    engines.compiled_library.cache_clear()
    library = next(engines._headers()).parent / "lib"
    linked = ("-Wl,--no-as-needed", f"-L{library}", f"-Wl,-rpath,{library}", "-lpinocchio_default")
    kept = [flag for flag in engines._FLAGS if flag not in {"-O3", "-march=native"}]
    flags = (*kept, "-O0", "-DPINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION", *linked)
    monkeypatch.setattr(engines, "_FLAGS", flags)
    assert engines.cpp_missing(True) is None
    way = next(way for way in peers.WAYS if way.name == engines.CPP)
    for level in LEVELS:
        assert direct.errors(PAIR, [way], ordinary[level])[way.name] < 20


@pytest.mark.slow
def test_skip_compares_every_program_with_the_whole_one():
    done = run("skip", "--samples", "50", "--repeats", "1", "--json")
    found = json.loads(done.stdout)["rows"]
    for name in skip.cases(2):
        assert len([row for row in found if row["method"] == name]) == 2
    assert [row["ratio"] for row in found if row["method"] == skip.WHOLE] == [1, 1]
    operations = {row["method"]: row["more"]["operations"] for row in found}
    whole = operations.pop(skip.WHOLE)
    assert operations.pop("float32") == operations.pop("constant rates") == whole
    assert all(0 < left < whole for left in operations.values())


def test_what_is_known_changes_no_output():
    known = skip.cases(20)
    for pair, motion, outputs in known.values():
        folded = pair.forward_kinematics(*motion, outputs=outputs)
        full = pair.forward_kinematics(
            *(np.stack(np.broadcast_arrays(*part), axis=-1) for part in motion), outputs=outputs, backend="numpy"
        )
        for name in outputs:
            unit = np.finfo(getattr(full, name).dtype).eps
            np.testing.assert_allclose(getattr(folded, name), getattr(full, name), rtol=0, atol=40 * unit)


@pytest.mark.slow(9)
def test_starts_are_measured_in_fresh_processes(monkeypatch):
    monkeypatch.setattr(direct, "SEQUENCES", {direct.FIRST_CALL: "[3, 1]"})
    rows = direct.starts(1)
    assert len(rows) == 2 + 1 + len(direct.BACKENDS)
    assert all(row.seconds > 0 for row in rows)
    assert {direct.IMPORT, direct.RUN} < {row.case for row in rows}
