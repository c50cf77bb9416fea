"""The gallery: every script runs without a warning, prints the results that its text speaks of and draws a figure."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

GALLERY = Path(__file__).parents[1] / "docs" / "gallery"
PRINTED = {
    "backhoe": (r"boom   moves: boom 129 kN, stick 44 kN, bucket 10 kN",),
    "cart_pole": (r"upright from [3-6]\.\d s on, with 4\.0 N", r"way of the cart: 0\.\d m"),
    "door_closer": (r"spring alone .* at 1\.9\d m/s", r"100 N m s/rad +at 12 degrees after 5\.8 s"),
    "four_bar": (r"stroke 239 mm .* straight to 0\.59 mm", r"torque 0\.49 N m"),
    "hatch": (r"closing: hand force  -97 to   8 N", r"from 2 degrees on; without springs the hand needs 124 N"),
    "knee": (r"\nok\n", r"axis off by 0\.[01]", r"in the plane off by 0\.\d mm"),
    "satellite_panel": (r"no damper .* ends at 14\.68 degrees", r"1 N m s/rad .* ends at 14\.68 degrees"),
    "slider_crank": (r"mean torque 4\.02 N m.* 4\.02 N m", r"pin 1220 N, on the wall 206 N"),
    "suspension": (r"toe is out of 10 minutes in 1[12] %", r"to first order: toe 6\.3 minutes, camber 6\.1"),
    "talos_lift": (r"largest mass: 1\.7\d kg, limited by joint 4",),
    "trebuchet": (r"release at -3[0-3] degrees .* (200|201) m", r"friction +-7\d\d"),
    "trailer": (r"at 5\.43 m: passes",),
    "ur5_circle": (r"each by itself: True [1-9]", r"as a path: +True 0 jumps", "8 solutions of the first point"),
    "ur5_workspace": (r"axis of joint 1: 0\.027 m", r"shoulder: 0\.9[45]"),
}
"""Results that the text of each script speaks of, as patterns."""


@pytest.mark.slow
@pytest.mark.parametrize("name", PRINTED)
def test_a_script_of_the_gallery_runs(name: str, capsys, monkeypatch, tmp_path) -> None:
    from matplotlib import pyplot as plt

    plt.switch_backend("Agg")
    monkeypatch.setattr(plt, "show", lambda: None)  # warns where there is no screen
    monkeypatch.chdir(tmp_path)
    try:
        runpy.run_path(str(GALLERY / f"plot_{name}.py"))
        (figure,) = map(plt.figure, plt.get_fignums())
        figure.savefig(tmp_path / "figure.png")
        assert all(axes.get_title() for axes in figure.axes if axes.get_label() != "<colorbar>")
    finally:
        plt.close("all")
    printed = capsys.readouterr().out
    for pattern in PRINTED[name]:
        assert re.search(pattern, printed), (pattern, printed)
    assert [path.name for path in tmp_path.iterdir()] == ["figure.png"]
