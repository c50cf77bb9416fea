"""Tables of `run` and `forces`: units, offsets of large numbers, and what is left out."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from hingepair.cli.main import app
from hingepair.cli.summary import RunSummary
from hingepair.scenes.scene import Scene
from hingepair.tables.sheets import round_offset

MODELS = Path(__file__).parents[2] / "models"
START = 1718000005.25  # s since 1970
EAST, NORTH = 691607.25, 5334760.5  # m


def summary(scene: Scene, names: tuple[str, ...] | None = None, units: str | None = None) -> RunSummary:
    found = RunSummary(scene, names, units)
    found.add(scene.evaluate(names))
    return found


def rows(found: RunSummary) -> dict[str, list[str]]:
    return {name: cells for name, *cells in found.table()}


@pytest.fixture
def map_scene(tmp_path: Path) -> Scene:
    lines = [f"{START + 0.5 * i!r},{EAST + 4.0 * i!r},{NORTH!r},0,{0.01 * i!r}" for i in range(41)]
    (tmp_path / "log.csv").write_text("\n".join(["t,x,y,phi_z,psi", *lines]) + "\n", encoding="utf-8")
    text = "[pair]\nu1 = [0, 0, 0]\nu2 = [0, 0, 0]\nn = [0, 0, 1]\nbody2 = { mass = 1, inertia = [1, 1, 1] }\n"
    text += '[motion]\nfile = "log.csv"\nsmooth = true\n'
    (tmp_path / "map.toml").write_text(text, encoding="utf-8")
    return hp.load_scene(tmp_path / "map.toml")


def test_numbers_and_units_of_the_table_are_those_asked_for() -> None:
    scene = hp.load_scene(MODELS / "truck_trailer.toml")
    si, other = rows(summary(scene)), rows(summary(scene, units="deg, mm, km/h"))
    for name, factor, unit in (("R2_x", 1e3, "mm"), ("v2_x", 3.6, "km/h"), ("psi", 180 / np.pi, "deg")):
        assert other[name][0] == unit
        wanted = factor * np.array(si[name][1:], float)
        np.testing.assert_allclose(
            np.array(other[name][1:], float), wanted, rtol=2e-5, atol=1e-5 * np.abs(wanted).max()
        )


def test_json_names_the_units_too() -> None:
    scene = hp.load_scene(MODELS / "truck_trailer.toml")
    ranges = summary(scene, ("psi",), "deg").ranges()
    assert list(ranges) == ["psi [deg]"]
    assert ranges["psi [deg]"]["largest"] == pytest.approx(np.degrees(scene.evaluate(("psi",)).psi.max()))


def test_zeros_and_the_matrix_are_left_out_and_named() -> None:
    found = summary(hp.load_scene(MODELS / "truck_trailer.toml"))
    assert {"R2_x", "psi"} <= rows(found).keys()
    assert not {"R2_z", "S2_xx", "alpha2_x"} & rows(found).keys()
    matrix, zeros = found.omissions()
    assert matrix == "S2 is not shown (--outputs S2 shows it)"
    assert zeros.endswith(": R2_z, d_z, v2_z, omega2_x, omega2_y, a2_z, alpha2_x, alpha2_y")


@pytest.mark.slow
def test_magnitudes_of_vectors_with_several_components_are_shown() -> None:
    """The edge of the hatch is 1 m from the hinge; the angular velocity has one component."""
    scene = hp.load_scene(MODELS / "hatch.toml")
    found = summary(scene, ("R2", "edge_v", "omega2"), "mm")
    assert [name for name in rows(found) if "|" in name] == ["|edge_v|"]
    unit, *_, smallest, largest = rows(found)["|edge_v|"]
    speed = 1e3 * np.abs(scene.evaluate(("psid",)).psid).max()
    assert (unit, smallest) == ("mm/s", "0")
    assert float(largest) == pytest.approx(speed, rel=1e-5)
    assert not any("|" in name for name in found.ranges())


def test_magnitudes_of_forces_are_shown() -> None:
    forces = hp.load_scene(MODELS / "hatch.toml").forces()
    (table,) = forces.tables("kN")
    shown = {name: cells for name, *cells in table}
    assert [name for name in shown if "|" in name] == ["|hinge_force|", "|force1|"]
    unit, first, smallest, largest, rms, _ = shown["|hinge_force|"]
    sizes = 1e-3 * np.linalg.norm(forces.hinge_force, axis=1)
    wanted = (sizes[0], sizes.min(), sizes.max(), np.sqrt(np.mean(sizes**2)))
    assert unit == "kN"
    np.testing.assert_allclose(np.array([first, smallest, largest, rms], float), wanted, rtol=1e-4)
    assert not any("|" in name for name in forces.facts()["outputs"])
    assert "|hinge_force|" in forces._repr_html_()
    assert str(forces).count("|force1|") == 1


def test_the_matrix_is_shown_when_it_is_asked_for() -> None:
    found = summary(hp.load_scene(MODELS / "truck_trailer.toml"), ("S2", "R2"))
    assert {"S2_xx", "S2_xy"} <= rows(found).keys()
    assert not any("S2 is not shown" in text for text in found.omissions())


def test_a_motion_without_anything_but_zeros_is_shown(tmp_path: Path) -> None:
    text = "[pair]\nu1 = [0, 0, 0]\nu2 = [0, 0, 0]\nn = [0, 0, 1]\n[motion]\nx = 0\ny = 0\nz = 0\nphi_x = 0\n"
    text += "phi_y = 0\nphi_z = 0\npsi = 0\n[time]\nstart = 0\nstop = 1\nsamples = 3\n"
    (tmp_path / "still.toml").write_text(text, encoding="utf-8")
    found = summary(hp.load_scene(tmp_path / "still.toml"), ("R2",))
    assert {"R2_x", "R2_y", "R2_z"} <= rows(found).keys()
    assert not found.omissions()


def test_map_coordinates_and_stamps_are_shown_with_an_offset(map_scene: Scene) -> None:
    table = summary(map_scene, ("R2", "psi")).table()
    assert table[0][:5] == ("t - 1718000005 s =", "unit", "0.25", "10.25", "20.25")
    assert table[1][:5] == ("R2_x - 691607", "m", "0.25", "80.25", "160.25")
    assert table[2][:5] == ("R2_y - 5334760", "m", "0.5", "0.5", "0.5")
    assert table[-1][:3] == ("psi", "rad", "0")
    assert "max |.| at t - 1718000005 s" in map_scene.forces().tables()[0][0]


@pytest.mark.parametrize(
    ("smallest", "largest"), [(0.0, 1e7), (0.5, 0.5001), (1e6, 1e6), (1e6, 1e6 * (1 + 1e-15)), (np.nan, np.nan)]
)
def test_other_numbers_are_shown_as_they_are(smallest: float, largest: float) -> None:
    assert round_offset(smallest, largest) == 0.0


def test_the_option_works_on_the_command_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "motion.csv"
    scene = str(MODELS / "landing_gear.toml")
    with pytest.raises(SystemExit):
        app(["run", scene, "--outputs", "R2,psi", "--units", "deg, mm", "--out", str(out)])
    assert re.search(r"^R2_x +mm ", capsys.readouterr().out, re.MULTILINE)
    assert out.read_text(encoding="utf-8").startswith("t [s],R2_x [mm],")
    with pytest.raises(SystemExit):
        app(["forces", scene, "--units", "N mm"])
    assert re.search(r"^hinge_torque +N mm ", capsys.readouterr().out, re.MULTILINE)


def test_loads_of_joints_are_in_the_units_that_are_asked_for() -> None:
    forces = hp.load_scene(MODELS / "excavator.toml").forces()
    (_, swing, *_), _ = forces.tables("deg, kN m")
    assert swing[1] == "kN m, deg"
    joint = forces.facts("deg, kN m")["joints"]["swing"]
    assert joint["largest"] == pytest.approx(1e-3 * forces.loads[0].largest)
    assert joint["position"][1] == pytest.approx(np.degrees(forces.loads[0].position[1]))
    assert joint["units"] == {"effort": "kN m", "position": "deg", "rate": "deg/s", "time": "s"}
    assert "units" not in forces.facts()["joints"]["swing"]
