"""Logs whose headings have units are read in them: what is written in degrees and millimetres comes back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.near import U
from support.scenes import logged, scene_of, time, toml

MODELS = Path(__file__).parents[2] / "models"
PAIR = logged([-1.2, 0, 0], [7.5, 0, 0], [0, 0, 1], "{}")
OUTPUTS = ("R2", "v2", "a2", "alpha2")


@pytest.mark.parametrize("ending", [".csv", ".npz", ".parquet"])
def test_a_log_in_other_units_is_that_of_the_same_motion(tmp_path: Path, ending: str) -> None:
    scene = hp.load_scene(MODELS / "truck_trailer.toml")
    scene.evaluate(("q", "qd", "qdd")).save(tmp_path / f"log{ending}", units="deg, cm, km/h, g, rpm, ms")
    again = scene_of(tmp_path, PAIR.format(f"log{ending}"))
    np.testing.assert_allclose(again.t, scene.t, rtol=8 * U)
    for name in OUTPUTS:
        expected = getattr(scene.evaluate(OUTPUTS), name)
        np.testing.assert_allclose(
            getattr(again.evaluate(OUTPUTS), name), expected, rtol=0, atol=1024 * U * np.abs(expected).max()
        )


@pytest.mark.parametrize("rates", [0, 1, 2])
def test_a_log_of_psi_alone_is_that_of_a_body_1_at_rest(tmp_path, rates):
    t = np.arange(30) / 10
    columns = {"t": t, "psi": np.sin(t), "psid": np.cos(t), "psidd": -np.sin(t)}
    names = list(columns)[: 2 + rates]
    rows = np.stack([columns[name] for name in names], axis=-1)
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=",".join(names), comments="")
    pair = toml("pair", u1=[0, 0, 1], u2=[1, 0, 0], n=[0, 1, 0])
    given = scene_of(tmp_path, pair + toml("motion", psi="sin(t)") + time(0, 2.9, 30))
    again = scene_of(tmp_path, pair + toml("motion", file="log.csv"))
    assert again.motion.level == rates
    outputs = ("R2", "v2", "a2")[: 1 + rates]
    found, expected = (scene.evaluate(outputs).requested_arrays() for scene in (again, given))
    for one, other in zip(found.values(), expected.values(), strict=True):
        assert np.abs(one - other).max() < 16 * 2.0**-53
    assert "body 1 rests at the origin, since the log has psi alone" in again.motion.notes
    assert given.motion.how == "body 1 rests at the origin"
    assert not given.evaluate(("R1", "omega1", "a1")).R1.any()
