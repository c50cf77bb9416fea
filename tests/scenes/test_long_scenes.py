"""Motions longer than memory: piece by piece, into files, to the same bits; and the coordinates as results."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from hingepair.scenes.summary import Summary
from support.near import U
from support.sparse import sparse
from support.work import python

MODELS = Path(__file__).parents[2] / "models"
PEAK = r"""
import re
from hingepair.cli.main import main
try:
    main()
finally:
    with open("/proc/self/status") as file:  # ru_maxrss begins with that of the process it was forked from
        print("peak", *re.findall(r"VmHWM:\s*(\d+)", file.read()))
"""


def long_scene(folder: Path, samples: int | str, model: str = "reference_3d") -> Path:
    path = folder / f"{model}_{samples}.toml"
    text = re.sub(r"(?m)^samples = \d+", f"samples = {samples}", (MODELS / f"{model}.toml").read_text())
    path.write_text(text)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("model", sparse(["reference_2d", "landing_gear", "logged_arm"], 3))
def test_pieces_are_the_whole_to_the_bit(tmp_path, monkeypatch, model):
    monkeypatch.setattr("hingepair.scenes.scene.RESULT_ROWS_PER_BLOCK", 1024)
    logged = model == "logged_arm"
    scene = hp.load_scene(MODELS / f"{model}.toml" if logged else long_scene(tmp_path, 5003, model))
    whole = scene.evaluate()
    parts = list(scene.blocks())
    assert sum(len(part.t) for part in parts) == scene.samples == len(whole.t)
    for name, array in whole.recorded().items():
        np.testing.assert_array_equal(np.concatenate([part.recorded()[name] for part in parts]), array)
    at_once, piecewise = Summary(scene), Summary(scene)
    at_once.add(whole.t, whole.requested_arrays())
    for part in parts:
        piecewise.add(part.t, part.requested_arrays(), part.first)
    for name, own in piecewise.ranges().items():
        assert own == pytest.approx(
            at_once.ranges()[name], rel=64 * U, nan_ok=True
        )  # squares are added in another order


@pytest.mark.proof
def test_a_long_run_takes_little_memory(tmp_path):
    """Four million instants: their outputs alone are 0.9 GB."""
    target = tmp_path / "long.parquet"
    arguments = ["run", str(long_scene(tmp_path, 4_000_000)), "--out", str(target), "--outputs", "v2"]
    printed = python(PEAK, *arguments)
    (peak,) = re.findall(r"peak (\d+)", printed)
    assert int(peak) < 700_000  # KiB
    import pyarrow.parquet

    assert pyarrow.parquet.read_metadata(target).num_rows == 4_000_000
    assert "E2" in printed


def test_coordinates_are_results(tmp_path):
    scene = hp.load_scene(long_scene(tmp_path, 11))
    t = scene.t
    result = scene.evaluate()
    np.testing.assert_allclose(result.psi, 10 * t, rtol=4 * U)
    np.testing.assert_array_equal(result.qd[:, 3:], np.tile([3.0, 1, 5, 10], (11, 1)))
    assert (result.q.shape, result.qdd.shape, result.psidd.shape) == ((11, 7), (11, 7), (11,))
    named = scene.evaluate(("R2", "psi", "qd", "v1"))
    assert list(named.recorded())[:4] == ["R2", "psi", "phid_x", "phid_y"]
    assert set(named.recorded()) == {"R2", "v1", "x", "y", "z", "phi_x", "phi_y", "phi_z"} | {
        *("psi", "phid_x", "phid_y", "phid_z", "psid")
    }
    assert named.qdd is None
    alone = scene.evaluate(("psidd",))
    assert alone.state.outputs == ()
    np.testing.assert_array_equal(alone.psidd, np.zeros(11))
    assert scene.plan(("q",)).outputs == ()
