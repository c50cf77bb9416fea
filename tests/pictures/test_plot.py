"""The figure of a motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import hingepair as hp
from hingepair.cli.main import app
from support.sparse import sparse

MODELS = Path(__file__).parents[2] / "models"


def lines_of(figure, title):
    (axes,) = (axes for axes in figure.axes if axes.get_title() == title)
    return axes, [line.get_ydata() for line in axes.get_lines()]


def test_what_is_drawn_is_what_was_computed():
    scene = hp.load_scene(MODELS / "talos_elbow.toml")
    figure, state = hp.plot(scene), scene.evaluate().state
    for title, array, unit in (
        ("position of body 2, R2", state.R2, "m"), ("velocity, v2", state.v2, "m/s"),
        ("angular acceleration, alpha2", state.alpha2, "rad/s^2"),
    ):  # fmt: skip
        axes, lines = lines_of(figure, title)
        np.testing.assert_array_equal(np.stack(lines, axis=1), array)
        assert axes.get_ylabel() == unit
    _, (residual, _) = lines_of(figure, "")
    assert residual.max() < 1e-14


@pytest.mark.parametrize("name", sparse(["reference_2d", "landing_gear", "gyro_log", "logged_arm"], 4))
def test_every_kind_of_motion_has_a_figure(name):
    figure = hp.plot(hp.load_scene(MODELS / f"{name}.toml").evaluate())
    assert len(figure.axes) >= 7
    angles = lines_of(figure, "attitude of body 2, Euler angles XYZ")[1]
    assert all(np.abs(np.diff(angle)).max() < 3 for angle in angles)


@pytest.mark.slow
def test_axes_are_named_and_a_motion_in_the_plane_is_seen_from_above():
    for name, letters in (("reference_2d", "xy"), ("thrown_flail", "xyz")):
        figure = hp.plot(hp.load_scene(MODELS / f"{name}.toml"))
        (paths,) = (axes for axes in figure.axes if "paths" in axes.get_title())
        assert {axes.get_xlabel() for axes in figure.axes if axes is not paths} == {"t [s]"}
        figure.draw_without_rendering()
        inside = figure.get_window_extent()
        for letter in letters:
            label = getattr(paths, f"{letter}axis").label
            assert label.get_text() == letter
            assert inside.containsx(label.get_window_extent().x0)
            assert inside.containsy(label.get_window_extent().y0)
        assert (paths.name == "3d") == (letters == "xyz")


def test_far_paths_are_in_kilometres():
    scene = hp.load_scene(MODELS / "satellite_panel.toml")
    axes, _ = lines_of(hp.plot(scene), "paths in space [km], from the dots")
    (R1, *_), sampled = (line.get_data_3d() for line in axes.get_lines()), scene.sampled(2000, ("R1",))
    np.testing.assert_allclose(np.stack(R1, axis=1), sampled.R1 / 1000, rtol=1e-15, atol=0)


def test_a_gap_is_shaded(tmp_path):
    rows = (f"{i / 10},{'nan' if i == 3 else 'inf' if i == 4 else i},0,0,0,{i},0,{i}\n" for i in range(9))
    (tmp_path / "log.csv").write_text("t,x,y,z,phi_x,phi_y,phi_z,psi\n" + "".join(rows))
    text = "[pair]\nu1 = [1, 0, 0]\nu2 = [0, 1, 0]\nn = [0, 0, 1]\n[motion]\nfile = 'log.csv'\n"
    (tmp_path / "scene.toml").write_text(text)
    figure = hp.plot(hp.load_scene(tmp_path / "scene.toml"))
    axes, lines = lines_of(figure, "position of body 2, R2")
    assert not np.isfinite(lines[0][3:5]).any()
    assert [patch.get_extents().width > 0 for patch in axes.patches] == [True]


@pytest.mark.slow
def test_the_command_writes_a_picture_that_is_not_blank(tmp_path):
    scene, out = str(MODELS / "talos_elbow.toml"), tmp_path / "a.png"
    done = CliRunner().invoke(app, ["plot", scene, "--out", str(out)])
    assert done.exit_code == 0, done.output
    from matplotlib.image import imread

    assert imread(out).std() > 0.05
    refused = CliRunner().invoke(app, ["plot", scene, "--out", str(tmp_path / "a.doc")])
    assert "ends in .png, .svg, .pdf" in str(refused.exception)


def test_some_outputs_alone():
    scene = hp.load_scene(MODELS / "landing_gear.toml")
    asked = ("S1", "v1", "psi", "psid", "qdd")
    figure, result = hp.plot(scene, outputs=asked), scene.sampled(2000, asked)
    coordinates = ("a1_x", "a1_y", "a1_z", "phidd_x", "phidd_y", "phidd_z", "psidd")
    shown = {axes.get_title() for axes in figure.axes}
    assert shown == {"attitude of body 1, Euler angles XYZ", "v1", "hinge angle, psi", "psid", *coordinates}
    axes, lines = lines_of(figure, "v1")
    np.testing.assert_array_equal(np.stack(lines, axis=1), result.v1)
    assert axes.get_ylabel() == "m/s"
    axes, (line,) = lines_of(figure, "phidd_y")
    np.testing.assert_array_equal(line, result.qdd[:, 4])
    assert axes.get_ylabel() == "rad/s^2"
    with pytest.raises(hp.ArgumentError, match=r"outputs: expected one of .*, got 'R9'"):
        hp.plot(scene, outputs=("R9",))


def test_outputs_of_a_trajectory_and_of_a_pair():
    pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))
    t = np.linspace(0, 1, 5)
    moved = hp.integrate(pair, t, omega1=(0, 0, 1), psid=np.cos)
    lines = lines_of(hp.plot(moved, ("omega2", "psi")), "angular velocity, omega2")[1]
    np.testing.assert_array_equal(np.stack(lines, axis=1), moved.omega2)
    for source in (moved, pair):
        with pytest.raises(hp.ArgumentError, match=r"outputs: expected one of .*R2.*psi.*, got 'qdd'"):
            hp.plot(source, ("qdd",))
        for none in ((), "R2"):
            with pytest.raises(hp.ArgumentError, match=r"outputs: expected a tuple of names"):
                hp.plot(source, none)
    assert len(hp.plot(pair, ("R2", "psi")).axes) == 2


@pytest.mark.slow
def test_pictures_are_named_as_their_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (MODELS / "reference_2d.toml").read_text().replace('name = "reference_2d"', "")
    Path("two links.toml").write_text(text)
    for command in ("plot", "view"):
        done = CliRunner().invoke(app, [command, "two links.toml"])
        assert done.exit_code == 0, done.output
    Path("few").mkdir()
    monkeypatch.chdir("few")
    assert CliRunner().invoke(app, ["plot", "../two links.toml", "--outputs", "R2,psid"]).exit_code == 0
    assert sorted(map(str, tmp_path.rglob("*.*"))) == sorted(
        str(tmp_path / name) for name in ("two links.toml", "two links.png", "two links.html", "few/two links.png")
    )
    assert hp.load_scene("../two links.toml").pair.name == "two links"


def test_a_file_that_nobody_named_is_not_overwritten(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for command, scene, ending in (("plot", "reference_2d", "png"), ("view", "landing_gear", "html")):
        name = f"{scene}.{ending}"
        Path(name).write_text("mine")
        done = CliRunner().invoke(app, [command, str(MODELS / f"{scene}.toml")])
        assert done.exit_code != 0
        assert f"--out: expected a file name, since {name} exists (--out {name} overwrites it)" in str(done.exception)
        assert Path(name).read_text() == "mine"
