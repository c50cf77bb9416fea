"""docs/scenes.md: every example on it runs, and every word of the language stands on it."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from hingepair.plans.pairs import SPACE
from support.sparse import sparse

ROOT = Path(__file__).parents[2]
MODELS = ROOT / "models"
PAGE = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
PAIR = "\n[pair]\nu1 = [0.5, 0.2, 0.1]\nu2 = [-0.25, 0.1, 0.3]\nn = [1, 2, 0]\n"
MOTION = "\n[motion]\n" + "".join(f"{name} = 'sin(t)'\n" for name in SPACE.coordinates)
TIME = "\n[time]\nstart = 0\nstop = 4\nsamples = 41\n"


def is_of_a_mechanism(example: str) -> bool:
    return "[mechanism]" in example or "[[joint]]" in example


def completed(example: str) -> str:
    """The example with the tables that it leaves out."""
    if is_of_a_mechanism(example):
        return example
    missing = [
        table for table, name in ((PAIR, "[pair]"), (MOTION, "[motion]"), (TIME, "[time]")) if name not in example
    ]
    if "[dynamics]" in example:
        missing = [table for table in missing if table is not MOTION]
    if re.search("^file = ", example, re.MULTILINE):
        missing = [table for table in missing if table is not TIME]
    return example + "".join(missing)


@pytest.mark.slow
@pytest.mark.parametrize("number", sparse(range(len(EXAMPLES)), 6))
def test_examples_run(number, tmp_path):
    example = EXAMPLES[number]
    for log in MODELS.glob("*.csv"):
        shutil.copy(log, tmp_path)
    drive = (f"{0.1 * k:.1f};{1e-3 * k:.3f};{k};{20 + k};{2 * k}".replace(".", ",") for k in range(12))
    (tmp_path / "fahrt.csv").write_text("\n".join(("Zeit;Ost;Nord;Kurs;Knick", *drive)))
    (tmp_path / "scene.toml").write_text(completed(example), encoding="utf-8")
    scene = hp.load_scene(tmp_path / "scene.toml")
    result = scene.evaluate(("R",)) if is_of_a_mechanism(example) else scene.evaluate()
    known = np.isfinite(result.R if is_of_a_mechanism(example) else result.R2)
    assert known.all()
    assert scene.notes() == () or not is_of_a_mechanism(example)
    assert scene.cross_validate(20).ok
    assert hp.view(scene, meshes=0).samples == scene.samples
