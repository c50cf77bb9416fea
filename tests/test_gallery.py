"""The gallery of the documentation: every script runs without a warning, prints its results and draws a figure."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

GALLERY = Path(__file__).parents[1] / "docs" / "gallery"
SCRIPTS = sorted(GALLERY.glob("plot_*.py"))


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=[script.stem.removeprefix("plot_") for script in SCRIPTS])
def test_a_script_of_the_gallery_runs(script: Path, capsys, monkeypatch, tmp_path) -> None:
    from matplotlib import pyplot as plt

    plt.switch_backend("Agg")
    monkeypatch.setattr(plt, "show", lambda: None)  # warns where there is no screen
    monkeypatch.chdir(tmp_path)
    try:
        runpy.run_path(str(script))
        (figure,) = map(plt.figure, plt.get_fignums())
        figure.savefig(tmp_path / "figure.png")
        assert all(axes.get_title() for axes in figure.axes if axes.get_label() != "<colorbar>")
    finally:
        plt.close("all")
    assert capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["figure.png"]


def test_the_picture_of_the_workspace_is_small() -> None:
    picture = GALLERY.parent / "_static" / "ur5_workspace.png"
    assert 10_000 < picture.stat().st_size < 100_000
