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
    "excavator": (r"boom .* digging +32\d", r"stick .* digging +2[23]\d", r"bucket .* digging +8\d"),
    "five_bar": (r"95% of the angles", r"met to 0\.\d nm; largest torque 0\.36 N m"),
    "four_bar": (r"stroke 239 mm .* straight to 0\.59 mm", r"torque 0\.49 N m"),
    "gimbal": (
        " 5 degrees from the zenith: .* 229 deg/s",
        " 2 degrees from the zenith: .* 573 deg/s",
    ),  # 20/sin(5), ...
    "hatch": (r"closing: hand force  -95 to   8 N", r"from 2 degrees on; without springs the hand needs 124 N"),
    "knee": (r"\nok\n", r"axis off by 0\.[01]", r"in the plane off by 0\.\d mm"),
    "landing_gear": (r"40 m/s, 1 g +down after 1\.0", r"65 m/s, 1 g +down after 0\.8"),
    "panda_hand_down": (r"hand down: 7[45]% of", r"hand level, to the front: 8[01]% of"),
    "panda_masses": (r"\nok\n", r"as described: 6\.\d+ N m", r"fitted: 0\.(19|2\d) N m"),
    "satellite_panel": (r"no damper .* ends at 14\.68 degrees", r"1 N m s/rad .* ends at 14\.68 degrees"),
    "scissor_lift": (r"ground: stroke 641 mm, force 66 kN at 0\.60 m", r"arms: stroke 648 mm, force 25 kN"),
    "slider_crank": (r"mean torque 4\.02 N m.* 4\.02 N m", r"pin 1220 N, on the wall 206 N"),
    "suspension": (r"toe is out of 10 minutes in 1[12] %", r"to first order: toe 6\.3 minutes, camber 6\.1"),
    "talos_lift": (r"largest mass: 1\.7\d kg, limited by joint 4",),
    "trebuchet": (r"release at -3[0-3] degrees .* (200|201) m", r"friction +-7\d\d"),
    "trailer": (r"at 5\.43 m: passes",),
    "ur5_circle": (r"each by itself: True [1-9]", r"as a path: +True 0 jumps", "8 solutions of the first point"),
    "ur5_shooting": (r"\d iterations", r"effort: (29|30|31)% of that", r"misses by 0\.\d mm"),
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
