"""The benchmark measures what it says: every method computes the same, and its reports are whole. No speed here."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import hingepair as hp
from hingepair import bench
from hingepair.bench_contenders import METHODS, installed
from hingepair.bench_methods import LEVELS
from hingepair.cli import app
from states import coordinates, generator, rotations


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("method", METHODS, ids=lambda m: m.name)
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


def test_the_error_column_sees_an_error(monkeypatch):
    rng = generator(81)
    pair, motion = hp.HingePair(u1=(1, 0, 0), u2=(0, 1, 0), n=(0, 0, 1)), coordinates(rng, 5)[:2]
    assert max(bench._errors(pair, motion, "velocity").values()) < 100
    wrong = METHODS[4]._replace(
        prepare=lambda p, m: lambda: {k: v + 1e-9 for k, v in METHODS[4].prepare(p, m)().items()}
    )
    monkeypatch.setattr(bench, "METHODS", (wrong,))
    assert bench._errors(pair, motion, "velocity")[wrong.name] > 1e4


def test_direct_prints_writes_and_draws(tmp_path):
    picture = tmp_path / "b.png"
    options = ["bench", "direct", "--sizes", "1,20", "--levels", "pose", "--repeats", "1"]
    done = CliRunner().invoke(app, [*options, "--plot", str(picture)])
    assert done.exit_code == 0, done.output
    assert "copy floor" in done.output
    assert all(method.name in done.output for method in METHODS)
    assert picture.read_bytes().startswith(b"\x89PNG")
    found = json.loads(CliRunner().invoke(app, [*options, "--json"]).stdout)
    assert len(found["rows"]) == 2 * (len(METHODS) + 1)
    assert {"machine", "cores", "numpy", "numba", "pin"} <= found["facts"].keys()


def test_skip_reports_every_skip():
    found = json.loads(
        CliRunner().invoke(app, ["bench", "skip", "--samples", "50", "--repeats", "1", "--json"]).stdout
    )
    assert {row["backend"] for row in found["rows"]} == {"numba", "numpy"}
    assert len(found["rows"]) == 14


@pytest.mark.parametrize("option", [("--sizes", "x"), ("--sizes", "0"), ("--levels", "jerk")])
def test_bad_options(option):
    done = CliRunner().invoke(app, ["bench", "direct", *option])
    assert isinstance(done.exception, hp.ArgumentError)
