"""`hingepair sweep SWEEP.toml`: every variant is the scene with its numbers."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
import pandas
import pytest
from numpy.testing import assert_array_equal

import hingepair as hp
from hingepair.scenes.variants import sweep as sweeps
from hingepair.scenes.variants.sweep import load_sweep, run_sweep
from support.commands import refusal, run_command
from support.near import U
from support.scenes import moved, toml

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")

ARM = (
    toml("pair", u1=[0.5, "0.1*2", 0.1], u2=[-0.25, 0.1, 0.3], n=[1, 2, 0])
    + toml("pair.body1", mass=5, inertia=[1, 1, 1])
    + toml("pair.body2", mass=2, inertia=[0.1, 0.2, 0.2], centre_of_mass=[0, 0, 0.1])
    + toml("constants", speed=1.5)
    + moved(0, 3, 31, y="0.1*t", phi_x="sin(speed*t)", phi_z="0.2*t", psi="t")
)
GRID = """
scene = "arm.toml"
outputs = ["R2", "hinge_torque"]
reduce = ["min", "max", "absmax", "mean", "rms", "std", "first", "last", "t_min", "t_max", "t_absmax", "q2.5"]
[[vary]]
key = "pair.u1[1]"
values = [0.1, 0.2, 0.3]
[[vary]]
key = "pair.body2.mass"
low = 1
high = 4
count = 3
"""


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    for name, text in (("arm", ARM), ("grid", GRID)):
        (tmp_path / f"{name}.toml").write_text(text)
    monkeypatch.chdir(tmp_path)


def swept(name: str, out: str, text: str | None = None) -> Path:
    if text is not None:
        Path(f"{name}.toml").write_text(text)
    run_sweep(load_sweep(f"{name}.toml"), Path(out))
    return Path(out)


def scene_with(text: str, *changes: tuple[str, str]):
    for old, new in changes:
        assert text.count(old) == 1
        text = text.replace(old, new)
    Path("one.toml").write_text(text)
    return hp.load_scene("one.toml")


def table(path: Path) -> dict[str, np.ndarray]:
    return {name: column.to_numpy() for name, column in pandas.read_parquet(path).items()}


@pytest.mark.slow
def test_a_grid_is_every_scene_with_its_numbers():
    found = table(swept("grid", "grid.parquet"))
    assert_array_equal(found["variant"], np.arange(9))
    assert_array_equal(found["pair.u1[1]"], np.repeat([0.1, 0.2, 0.3], 3))
    assert_array_equal(found["pair.body2.mass"], np.tile([1, 2.5, 4], 3))
    for i, (u1_y, mass) in enumerate(zip(found["pair.u1[1]"], found["pair.body2.mass"], strict=True)):
        scene = scene_with(ARM, ('"0.1*2"', str(u1_y)), ("mass = 2", f"mass = {mass}"))
        R2, torque, t = scene.evaluate(("R2",)).R2, scene.forces().hinge_torque, scene.t
        expected = {
            "R2_x_max": R2[:, 0].max(),
            "R2_y_min": R2[:, 1].min(),
            "R2_z_t_max": t[R2[:, 2].argmax()],
            "R2_x_first": R2[0, 0],
            "R2_y_last": R2[-1, 1],
            "hinge_torque_absmax": np.abs(torque).max(),
            "hinge_torque_t_absmax": t[np.abs(torque).argmax()],
            "hinge_torque_t_min": t[torque.argmin()],
            "hinge_torque_mean": torque.mean(),
            "hinge_torque_std": torque.std(),
            "hinge_torque_rms": np.sqrt((torque**2).mean()),
            "hinge_torque_q2.5": np.quantile(torque, 0.025),
        }
        for name, value in expected.items():
            assert found[name][i] == pytest.approx(value, rel=256 * U, abs=8 * U), name


@pytest.mark.slow
def test_a_sobol_design_is_spread_as_it_says_and_comes_back_with_its_seed():
    text = 'scene = "arm.toml"\noutputs = ["psi"]\nreduce = ["max"]\ndesign = "sobol"\nsamples = 512\nseed = %d\n'
    text += '[[vary]]\nkey = "pair.u1[0]"\nlow = -1\nhigh = 3\n[[vary]]\nkey = "pair.u2[0]"\nmean = 2\nstd = 0.5\n'
    numbers = []
    for seed in (1, 1, 2):
        Path("design.toml").write_text(text % seed)
        numbers.append(load_sweep("design.toml").numbers)
    assert numbers[0].shape == (512, 2)
    assert_array_equal(numbers[0], numbers[1])
    assert (numbers[0] != numbers[2]).any()
    uniform, normal = numbers[0].T
    assert (uniform.min() >= -1, uniform.max() <= 3) == (True, True)
    # A hundredth of the standard deviation, and two of itself: Sobol points are far more even than random ones.
    assert abs(uniform.mean() - 1) < 0.01 * 4 / np.sqrt(12)
    assert (abs(normal.mean() - 2) < 0.005, abs(normal.std() - 0.5) < 0.01) == (True, True)


MODELS = Path(__file__).parents[2] / "models" / "sweeps"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["landing_gear", "panda_payload"])
def test_the_examples_run(name):
    text = (MODELS / f"{name}.toml").read_text().replace("samples = 100_000", "samples = 8")
    scene = "../landing_gear.toml" if name == "landing_gear" else "panda_reach.toml"
    assert text.count(f'"{scene}"') == 1
    found = table(swept("few", "few.parquet", text.replace(scene, (MODELS / scene).resolve().as_posix())))
    assert len(found["variant"]) == 8
    assert all(np.isfinite(column).all() for column in found.values())


def test_a_sweep_needs_no_package_for_a_csv_file(monkeypatch):
    there = sweeps.find_spec
    whole = table(swept("grid", "whole.parquet"))
    monkeypatch.setattr(sweeps, "find_spec", lambda name: None if name == "pyarrow" else there(name))
    shown = refusal("sweep", "grid.toml", "--out", "grid.parquet")
    assert "sweep: expected the package pyarrow: pip install 'hingepair[data]'; or --out" in shown
    run_command("sweep", "grid.toml")
    header, *rows = Path("grid.csv").read_text().splitlines()
    found = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    assert header.split(",") == [*whole]
    assert_array_equal(found.T, list(whole.values()))


def test_a_full_disk_leaves_nothing_that_could_be_taken_for_whole(monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(pandas.DataFrame, "to_parquet", full)
    assert "No space left on device" in refusal("sweep", "grid.toml")
    assert not Path("grid.parquet").exists()


def test_a_variant_that_cannot_be_computed_is_nan_and_the_others_are_not():
    text = 'scene = "arm.toml"\noutputs = ["hinge_torque"]\nreduce = ["max"]\n'
    text += '[[vary]]\nkey = "pair.body2.mass"\nvalues = [%s]\n'
    for name, values in (("bad", "2.0, -1.0, 3.0"), ("first", "-1.0, 2.0, 3.0")):
        with pytest.warns(sweeps.SweepWarning, match=r"1 of 3 variants cannot .* pair.body2.mass = -1: .*mass"):
            found = table(swept(name, f"{name}.parquet", text % values))
        assert_array_equal(np.isnan(found["hinge_torque_max"]), found["pair.body2.mass"] < 0)
    with pytest.raises(hp.SceneError, match=r"2 of 2 variants .* = -1: .*mass"):
        swept("none", "none.parquet", text % "-1.0, -2.0")
