"""Tables of `run` and `forces`: units, offsets of large numbers, and what is left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import hingepair as hp
from hingepair.cli.summary import RunSummary
from hingepair.scenes.scene import Scene

MODELS = Path(__file__).parents[2] / "models"


def summary(scene: Scene, names: tuple[str, ...] | None = None, units: str | None = None) -> RunSummary:
    found = RunSummary(scene, names, units)
    found.add(scene.evaluate(names))
    return found


def rows(found: RunSummary) -> dict[str, list[str]]:
    return {name: cells for name, *cells in found.table()}


def test_numbers_and_units_of_the_table_are_those_asked_for() -> None:
    scene = hp.load_scene(MODELS / "truck_trailer.toml")
    si, other = rows(summary(scene)), rows(summary(scene, units="deg, mm, km/h"))
    for name, factor, unit in (("R2_x", 1e3, "mm"), ("v2_x", 3.6, "km/h"), ("psi", 180 / np.pi, "deg")):
        assert other[name][0] == unit
        wanted = factor * np.array(si[name][1:], float)
        np.testing.assert_allclose(
            np.array(other[name][1:], float), wanted, rtol=2e-5, atol=1e-5 * np.abs(wanted).max()
        )
