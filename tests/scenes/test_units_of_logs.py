"""Logs whose headings have units are read in them: what is written in degrees and millimetres comes back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hingepair as hp

MODELS = Path(__file__).parents[2] / "models"
PAIR = """
[pair]
u1 = [-1.2, 0, 0]
u2 = [7.5, 0, 0]
n = [0, 0, 1]
[motion]
file = "{}"
"""
OUTPUTS = ("R2", "v2", "a2", "alpha2")


@pytest.mark.parametrize("ending", [".csv", ".npz", ".parquet"])
def test_a_log_in_other_units_is_that_of_the_same_motion(tmp_path: Path, ending: str) -> None:
    scene = hp.load_scene(MODELS / "truck_trailer.toml")
    scene.evaluate(("q", "qd", "qdd")).save(tmp_path / f"log{ending}", units="deg, cm, km/h, g, rpm, ms")
    (tmp_path / "scene.toml").write_text(PAIR.format(f"log{ending}"), encoding="utf-8")
    again = hp.load_scene(tmp_path / "scene.toml")
    np.testing.assert_allclose(again.t, scene.t, rtol=1e-15)
    for name in OUTPUTS:
        expected = getattr(scene.evaluate(OUTPUTS), name)
        np.testing.assert_allclose(
            getattr(again.evaluate(OUTPUTS), name), expected, atol=1e-13 * np.abs(expected).max()
        )


def test_a_log_of_a_robot_too(tmp_path: Path) -> None:
    scene = hp.load_scene(MODELS / "excavator.toml")
    scene.evaluate(("q", "qd", "qdd")).save(tmp_path / "log.csv", units="deg")
    assert "boomd [deg/s]" in (tmp_path / "log.csv").read_text(encoding="utf-8").splitlines()[0]
    text = (MODELS / "excavator.toml").read_text(encoding="utf-8")
    start, _, _ = text.partition("[motion]")
    (tmp_path / "excavator.urdf").write_bytes((MODELS / "excavator.urdf").read_bytes())
    (tmp_path / "scene.toml").write_text(f'{start}[motion]\nfile = "log.csv"\n', encoding="utf-8")
    again = hp.load_scene(tmp_path / "scene.toml")
    np.testing.assert_allclose(again.coordinates().qdd, scene.coordinates().qdd, atol=1e-13)


def test_stamps_since_1970_in_milliseconds_keep_their_digits(tmp_path: Path) -> None:
    rows = "".join(f"{1718000005000 + 10 * i}.25,{0.1 * i},0,0,0\n" for i in range(20))
    (tmp_path / "log.csv").write_text("t [ms],psi [deg],x,y,phi_z\n" + rows, encoding="utf-8")
    (tmp_path / "scene.toml").write_text(PAIR.format("log.csv") + "smooth = true\n", encoding="utf-8")
    result = hp.load_scene(tmp_path / "scene.toml").evaluate(("psi", "psid"))
    np.testing.assert_allclose(result.t - 1718000005.0, 0.00025 + 0.01 * np.arange(20), atol=3e-7)
    np.testing.assert_allclose(result.psid, np.radians(10.0), rtol=1e-7)  # of doubles, 1e-5


@pytest.mark.parametrize("rates", [0, 1, 2])
def test_a_log_of_psi_alone_is_that_of_a_body_1_at_rest(tmp_path, rates):
    t = np.arange(30) / 10
    columns = {"t": t, "psi": np.sin(t), "psid": np.cos(t), "psidd": -np.sin(t)}
    names = list(columns)[: 2 + rates]
    rows = np.stack([columns[name] for name in names], axis=-1)
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=",".join(names), comments="")
    scene = "[pair]\nu1 = [0, 0, 1]\nu2 = [1, 0, 0]\nn = [0, 1, 0]\n[motion]\n"
    (tmp_path / "logged.toml").write_text(scene + "file = 'log.csv'\n")
    (tmp_path / "given.toml").write_text(scene + "psi = 'sin(t)'\n[time]\nstart = 0\nstop = 2.9\nsamples = 30\n")
    logged, given = (hp.load_scene(tmp_path / f"{name}.toml") for name in ("logged", "given"))
    assert logged.motion.level == rates
    outputs = ("R2", "v2", "a2")[: 1 + rates]
    found, expected = (scene.evaluate(outputs).requested_arrays() for scene in (logged, given))
    for one, other in zip(found.values(), expected.values(), strict=True):
        assert np.abs(one - other).max() < 16 * 2.0**-53
    assert "body 1 rests at the origin, since the log has psi alone" in logged.motion.notes
    assert given.motion.how == "body 1 rests at the origin"
    assert not given.evaluate(("R1", "omega1", "a1")).R1.any()
