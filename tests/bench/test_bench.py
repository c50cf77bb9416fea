"""The benchmark measures what it says: every method computes the same, and its reports are whole. No speed here."""

from __future__ import annotations

import json

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from typer.testing import CliRunner

import hingepair as hp
from hingepair.bench import contenders as bench_contenders
from hingepair.bench import cpp as bench_cpp
from hingepair.bench import skip as bench_skip
from hingepair.bench.contenders import CPP, METHODS, contenders, installed
from hingepair.bench.cpp import compiled_loop
from hingepair.bench.direct import Row
from hingepair.bench.engines import pinocchio_loop
from hingepair.bench.methods import LEVELS
from hingepair.bench.plot import work_precision
from hingepair.bench.truth import hard_states, worst_errors
from hingepair.cli import bench as bench_cli
from hingepair.cli.main import app
from support.states import coordinates, generator, rotations


def _cases():
    """Every way at every level; what compiles for long, at the lowest alone in the fast loop."""
    for method in METHODS:
        for level in LEVELS:
            slow = method.needs in {"jax", "sympy"} and level != "pose"
            yield pytest.param(method, level, marks=[pytest.mark.slow] * slow, id=f"{method.name}-{level}")


@pytest.mark.parametrize(("method", "level"), [*_cases()])
def test_every_method_computes_the_same(method, level):
    assert installed(method)
    rng = generator(80)
    pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, 3), home=rotations(rng, 1)[0])
    motion = coordinates(rng, 30)[: list(LEVELS).index(level) + 1]
    found = method.prepare(pair, tuple(c.astype(method.dtype) for c in motion))()
    expected = pair.forward_kinematics(*motion, backend="numpy")
    for name in LEVELS[level]:
        size = 1 + np.abs(getattr(expected, name)).max()
        np.testing.assert_allclose(
            found[name], getattr(expected, name), rtol=0, atol=500 * np.finfo(method.dtype).eps * size
        )


def test_the_error_columns_see_an_error():
    rng = generator(81)
    pair = hp.HingePair(u1=(1, 0, 0), u2=(0, 1, 0), n=(0, 0, 1))
    right = METHODS[0]
    wrong = right._replace(
        name="wrong", prepare=lambda p, m: lambda: {k: v + 1e-9 for k, v in right.prepare(p, m)().items()}
    )
    found = worst_errors([right, wrong], pair, coordinates(rng, 5)[:2], "velocity")
    assert found[right.name] < 10
    assert found["wrong"] > 1e4


def test_hard_states_are_hard_and_exact_where_a_dtype_holds_them():
    states = hard_states(generator(82), 3)
    pair = hp.HingePair(u1=(1, 0, 0), u2=(0, 1, 0), n=(0, 0, 1))
    ours = [m for m in METHODS if m.name.startswith("hingepair")]
    assert {m.dtype for m in ours} == {np.float32, np.float64}
    found = worst_errors([*ours, HALF_TURN], pair, states, "acceleration")
    assert max(found[m.name] for m in ours) <= 12
    assert found[HALF_TURN.name] > 1e6


def _with_reduced_angle(pair, motion):
    """Reduces psi modulo 2 pi in double, which hard states must notice."""
    q = motion[0].copy()
    q[:, 6] %= 2 * np.pi
    return METHODS[0].prepare(pair, (q, *motion[1:]))


HALF_TURN = METHODS[0]._replace(name="reduced", prepare=_with_reduced_angle)


def test_direct_prints_writes_and_draws(tmp_path):
    picture = tmp_path / "b.png"
    options = ["bench", "direct", "--sizes", "1", "--levels", "pose", "--repeats", "1"]
    done = CliRunner().invoke(app, [*options, "--plot", str(picture)])
    assert done.exit_code == 0, done.output
    assert "copy floor" in done.output
    assert "left out: Pinocchio, C++ loop" in done.output
    assert all(method.name in done.output for method in METHODS)
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_no_name_in_the_picture_covers_another(tmp_path, monkeypatch):
    monkeypatch.setattr(Figure, "savefig", lambda self, path, dpi: drawn.append(self))  # noqa: ARG005
    drawn = []
    rows = [Row(m.name, "pose", 10, 20.0 + i % 4, 20.0, 1.0, 3.0 + i % 3, 3.0) for i, m in enumerate(METHODS)]
    work_precision(rows, str(tmp_path / "p.png"))
    drawn[0].draw_without_rendering()
    axes = drawn[0].axes[0]
    boxes = {text.get_text(): Text.get_window_extent(text) for text in axes.texts}
    assert set(boxes) == {m.name for m in METHODS}
    for name, box in boxes.items():
        assert not [other for other, o in boxes.items() if other != name and box.overlaps(o)]
        assert axes.get_window_extent().overlaps(box)


def test_json_has_every_row_both_errors_and_the_machine(monkeypatch):
    monkeypatch.setattr(bench_contenders, "METHODS", METHODS[:3])
    options = ["bench", "direct", "--sizes", "1", "--levels", "pose", "--repeats", "1", "--json"]
    text = CliRunner().invoke(app, options).stdout
    found = json.loads(text, parse_constant=pytest.fail)
    assert len(found["rows"]) == 3 + 2
    for row in found["rows"]:
        assert (row["error"] is None) == row["method"].startswith("copy floor")
        assert "hard_error" in row
    assert {"processor", "machine", "cores", "numpy", "numba", "pin", "jax", "mujoco"} <= found["facts"].keys()


def test_a_way_that_is_not_installed_is_a_line(monkeypatch):
    monkeypatch.setattr(bench_contenders, "find_spec", lambda name: None if name in {"jax", "mujoco"} else True)
    found, left_out = contenders(cpp=False)
    assert not [m for m in found if m.needs in {"jax", "mujoco"}]
    assert [line.split(",")[0] for line in left_out] == ["MuJoCo", "JAX", "Pinocchio"]


def test_without_a_compiler_the_cpp_loop_is_a_line(monkeypatch):
    compiled_loop.cache_clear()
    monkeypatch.setenv("PATH", "")
    found, left_out = contenders(cpp=True)
    assert CPP not in found
    assert "a C++ compiler" in left_out[-1]


def test_without_headers_the_cpp_loop_is_a_line(monkeypatch):
    compiled_loop.cache_clear()
    monkeypatch.setattr(bench_cpp, "_headers", lambda: iter(()))
    _, left_out = contenders(cpp=True)
    assert "pinocchio/algorithm/frames.hpp" in left_out[-1]


@pytest.mark.slow
@pytest.mark.parametrize("level", LEVELS)
def test_the_cpp_loop_computes_what_the_python_loop_does(level):
    compiled_loop()
    pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, 3), home=rotations(generator(83), 1)[0])
    motion = coordinates(generator(84), 30)[: list(LEVELS).index(level) + 1]
    expected = pinocchio_loop(pair, motion)()
    found = CPP.prepare(pair, motion)()
    for name in LEVELS[level]:
        size = 1 + np.abs(expected[name]).max()
        np.testing.assert_allclose(found[name], expected[name], rtol=0, atol=64 * 2.0**-53 * size)


def test_skip_reports_every_skip():
    found = json.loads(
        CliRunner().invoke(app, ["bench", "skip", "--samples", "50", "--repeats", "1", "--json"]).stdout
    )
    assert {row["backend"] for row in found["rows"]} == {"numba", "numpy"}
    assert len(found["rows"]) == 2 * len(bench_skip._AGAINST)


@pytest.mark.slow
def test_cold_starts_and_peak_memory_are_in_the_report(monkeypatch):
    monkeypatch.setattr(bench_cli, "MILLION", 100_000)
    options = ["bench", "direct", "--sizes", "1", "--levels", "pose", "--repeats", "1", "--cold", "--memory"]
    found = json.loads(CliRunner().invoke(app, [*options, "--json"]).stdout)
    assert len(found["cold"]) == 5
    assert all(0 < row["min_s"] <= row["median_s"] for row in found["cold"])
    assert {(row["backend"], row["workers"], row["level"]) for row in found["memory"]} == {
        (backend, workers, level) for backend in ("numba", "numpy") for workers in (1, 2) for level in LEVELS
    }
    assert all(row["extra_mb"] <= 10 for row in found["memory"])


@pytest.mark.parametrize("option", [("--sizes", "x"), ("--sizes", "0"), ("--levels", "jerk")])
def test_bad_options(option):
    done = CliRunner().invoke(app, ["bench", "direct", *option])
    assert isinstance(done.exception, hp.ArgumentError)
