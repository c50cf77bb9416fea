"""The figure of a motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.commands import refusal, run_command
from support.drawn import drawn_texts
from support.near import U
from support.scenes import logged, moved, scene_of, time, toml
from support.sparse import sparse

MODELS = Path(__file__).parents[2] / "models"


def lines_of(figure, title):
    (axes,) = (axes for axes in figure.axes if axes.get_title() == title)
    return axes, [line.get_ydata() for line in axes.get_lines()]


@pytest.mark.slow
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
    paths, _ = lines_of(figure, "paths in space [m], from the dots")
    hinge = scene.evaluate(("R1", "S1"))
    points = {"R1": hinge.R1, "R2": state.R2, "hinge point": hinge.R1 + hinge.S1 @ scene.pair.u1}
    for i, (name, array) in enumerate(points.items()):
        line, start = paths.get_lines()[2 * i : 2 * i + 2]
        assert line.get_label() == name
        np.testing.assert_array_equal(np.stack(line.get_data_3d(), axis=1), array)
        np.testing.assert_array_equal(np.ravel(start.get_data_3d()), array[0])


def test_paths_are_seen_whole_and_at_one_scale():
    """A long path leaves room beside it for the numbers."""
    pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0.5, 0), n=(0, 0, 1))
    t = np.linspace(0, 1, 50)
    figure = hp.plot(hp.integrate(pair, t, omega1=(0, 0.3, 0), psid=1.0, R1=np.stack([30 * t, t, -t], axis=-1)))
    axes, _ = lines_of(figure, "paths in space [m], from the dots")
    ends = np.array([np.ptp(np.concatenate([line.get_data_3d()[i] for line in axes.get_lines()])) for i in range(3)])
    limits = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
    widths = np.diff(limits, axis=1)[:, 0]
    np.testing.assert_allclose(widths, 1.05 * np.maximum(ends, 0.3 * ends.max()), rtol=256 * U)
    for line in axes.get_lines():
        points = np.array(line.get_data_3d())
        assert ((points >= limits[:, :1]) & (points <= limits[:, 1:])).all()
    np.testing.assert_allclose(axes._box_aspect / axes._box_aspect.max(), widths / widths.max(), rtol=256 * U)


def log_scene(folder, rows):
    """A scene of a log with the columns t, x and psi; body 1 does not turn."""
    lines = (f"{t},{x},0,0,0,0,0,{psi}\n" for t, x, psi in rows)
    (folder / "log.csv").write_text("t,x,y,z,phi_x,phi_y,phi_z,psi\n" + "".join(lines))
    return scene_of(folder, logged([1, 0, 0], [0, 1, 0], [0, 0, 1]))


def test_a_gap_is_shaded(tmp_path):
    rows = [(i / 10, "nan" if i == 3 else "inf" if i == 4 else i, i) for i in range(9)]
    axes, lines = lines_of(hp.plot(log_scene(tmp_path, rows)), "position of body 2, R2")
    assert not np.isfinite(lines[0][3:5]).any()
    (patch,) = axes.patches
    assert (patch.get_x(), patch.get_x() + patch.get_width()) == pytest.approx((0.2, 0.5), rel=4 * U)


def test_no_line_crosses_rows_that_are_absent(tmp_path):
    rows = [(i / 10, i, i / 10) for i in (*range(20), *range(50, 70))]
    axes, lines = lines_of(hp.plot(log_scene(tmp_path, rows)), "position of body 2, R2")
    assert np.isnan(lines[0]).sum() == 1
    assert np.isnan(lines[0][20])
    (patch,) = axes.patches
    assert (patch.get_x(), patch.get_x() + patch.get_width()) == pytest.approx((1.9, 5.0), rel=4 * U)


def test_angles_go_on_after_a_gap(tmp_path):
    """One attitude that is not known does not take those after it away."""
    rows = [(i / 10, i, "nan" if i == 3 else i) for i in range(9)]
    _, (*_, angle) = lines_of(hp.plot(log_scene(tmp_path, rows)), "attitude of body 2, Euler angles XYZ")
    expected = np.arange(9.0)
    expected[3] = np.nan
    np.testing.assert_allclose(angle, expected, rtol=64 * U)


def moving(folder, samples, **motion):
    """A scene of expressions from 0 to 10 s."""
    pair = toml("pair", u1=[1, 0, 0], u2=[0, 1, 0], n=[0, 0, 1])
    return scene_of(folder, pair + moved(0, 10, samples, **{"psi": 0} | motion))


FAST = {
    "200 Hz": "sin(2*pi*200*t + 0.5)",
    "faster than its samples": "sin(2*pi*499.9*t)*t",
    "a spike": "where(abs(t - 5.001) < 0.0004, 1, 0)",
    "a dropout": "where(abs(t - 5.001) < 0.0004, sqrt(-t), t)",
    "spikes beside a dropout": "where(4.9995 < t < 5.0035, (1 + sqrt((t - 5.001)**2 - 1e-7))*sin(t/1e-3), 0)",
}


@pytest.mark.parametrize("text", FAST.values(), ids=FAST)
def test_fast_motion_fills_the_band_between_its_extremes(text, tmp_path):
    """Within a pixel of where the samples reach a value the curve does, and it goes through samples alone."""
    scene = moving(tmp_path, 10_001, psi=text)
    axes = hp.plot(scene, ("psi",)).axes[0]
    (line,), t, psi = axes.get_lines(), scene.t, scene.evaluate(("psi",)).psi
    at = np.searchsorted(t, line.get_xdata())
    np.testing.assert_array_equal(line.get_ydata(), psi[at])
    assert (np.diff(at) > 0).all()
    for start in range(0, 10_000, 50):
        sampled, drawn = psi[start : start + 51], psi[at[(at >= start - 6) & (at <= start + 56)]]
        assert np.nanmin(drawn) <= np.nanmin(sampled)
        assert np.nanmax(drawn) >= np.nanmax(sampled)
        assert np.isnan(drawn).any() or not np.isnan(sampled).any()
    assert len(axes.patches) == np.isnan(psi).any()


@pytest.mark.slow
def test_the_command_writes_the_figure_of_the_scene_in_the_format_of_the_name(tmp_path):
    scene, out = MODELS / "talos_elbow.toml", tmp_path / "a.svg"
    run_command("plot", scene, "--out", out)
    figure = hp.plot(hp.load_scene(scene))
    assert {axes.get_title() for axes in figure.axes} - {""} <= drawn_texts(out)
    assert {axes.get_ylabel() for axes in figure.axes} - {""} <= drawn_texts(out)
    run_command("plot", scene, "--out", tmp_path / "a.png", "--outputs", "R2")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert ".png, .svg, .pdf" in refusal("plot", scene, "--out", tmp_path / "a.doc")


def test_a_file_that_nobody_named_is_not_overwritten(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for command, scene, ending in (("plot", "reference_2d", "png"), ("view", "landing_gear", "html")):
        name = f"{scene}.{ending}"
        Path(name).write_text("mine")
        message = refusal(command, MODELS / f"{scene}.toml")
        assert message.startswith("--out: ")
        assert f"or --out {name}, which overwrites it" in message
        assert Path(name).read_text() == "mine"


def drawn(figure, title):
    axes, lines = lines_of(figure, title)
    return axes.get_ylabel(), np.stack(lines, axis=1)


def test_a_figure_is_in_the_units_that_are_asked_for():
    scene = hp.load_scene(MODELS / "landing_gear.toml")
    state = scene.evaluate()
    figure = hp.plot(scene, ("R2", "omega2", "S2", "psi"), units="deg, mm")
    for title, array, factor, unit in (
        ("position of body 2, R2", state.R2, 1e3, "mm"),
        ("angular velocity, omega2", state.omega2, 180 / np.pi, "deg/s"),
        ("hinge angle, psi", state.psi[:, None], 180 / np.pi, "deg"),
    ):  # fmt: skip
        label, lines = drawn(figure, title)
        assert label == unit
        np.testing.assert_allclose(lines, factor * array, rtol=64 * U)
    (label, degrees), (_, radians) = (
        drawn(own, "attitude of body 2, Euler angles XYZ") for own in (figure, hp.plot(scene, ("S2",)))
    )
    assert label == "deg"
    np.testing.assert_allclose(degrees, np.degrees(radians), rtol=64 * U)


def test_stamps_are_drawn_with_an_offset(tmp_path):
    rows = [f"{1718000005.25 + 0.5 * i!r},{691607.25 + 4.0 * i!r},5334760.5,0,0" for i in range(41)]
    (tmp_path / "log.csv").write_text("\n".join(["t,x,y,phi_z,psi", *rows]) + "\n", encoding="utf-8")
    figure = hp.plot(scene_of(tmp_path, logged([0, 0, 0], [0, 0, 0], [0, 0, 1])))
    axes, _ = lines_of(figure, "hinge angle, psi")
    assert axes.get_xlabel() == "t - 1718000005 s"
    np.testing.assert_allclose(
        axes.get_lines()[0].get_xdata(), 0.25 + 0.5 * np.arange(41), rtol=0, atol=2**33 * U
    )  # 1718000005 u


def test_paths_of_points_are_drawn():
    pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), points1={"seat": (0, 0, 1)}, points2={"tip": (0.5, 0, 0)})
    paths, _ = lines_of(hp.plot(pair), "paths in space [m], from the dots")
    drawn = {line.get_label(): np.stack(line.get_data_3d(), axis=1) for line in paths.get_lines()[::2]}
    psi = np.linspace(-np.pi, np.pi, 181)
    assert set(drawn) == {"R1", "R2", "hinge point", "seat", "tip"}
    expected = np.stack((1 + 1.5 * np.cos(psi), 1.5 * np.sin(psi), 0 * psi), axis=-1)
    np.testing.assert_allclose(drawn["tip"], expected, rtol=0, atol=16 * U)
    np.testing.assert_array_equal(drawn["seat"], np.tile((0, 0, 1), (181, 1)))


def test_a_trajectory_in_the_plane_is_drawn_as_that_of_the_pair_in_space():
    planar, t = hp.PlanarPair((-1.2, 0), (3, 0)), np.linspace(0, 2, 50)
    motions = (
        hp.integrate(planar, t, 0.1, 0.2, R1=(1, 2)),
        hp.integrate(planar.to_spatial(), t, (0, 0, 0.1), 0.2, R1=(1, 2, 0)),
    )
    (_, found), (_, expected) = (lines_of(hp.plot(one), "position of body 2, R2") for one in motions)
    np.testing.assert_allclose(found, expected, rtol=0, atol=16 * U)
    assert hp.view(motions[0]).frames == len(t)


@pytest.mark.parametrize("outputs", [None, "psi", ("psi",)])
def test_an_angle_is_drawn_with_the_band_of_its_standard_deviation(outputs):
    t = np.arange(300) / 100
    found = hp.smooth(t, np.sin(3 * t) + 2e-3 * np.random.default_rng(0).standard_normal(300))
    figure, names = hp.plot(found, outputs), ("psi", "psid", "psidd")[: None if outputs is None else 1]
    assert [axes.get_title() for axes in figure.axes] == [*names]
    for axes, name in zip(figure.axes, names, strict=True):
        (band,) = axes.collections
        corners = band.get_paths()[0].vertices
        values, std = getattr(found, name), found.std[name]
        assert corners[:, 1].max() == pytest.approx((values + 2 * std).max(), rel=4 * U)
        assert corners[:, 1].min() == pytest.approx((values - 2 * std).min(), rel=4 * U)


def test_a_mechanism_without_masses_is_drawn_without_torques(tmp_path):
    joint = toml("[joint]", name="a", u1=[0, 0, 1], u2=[-1, 0, 0], n=[0, 1, 0])
    scene = scene_of(tmp_path, joint + toml("motion", a="t**2") + time(0, 1, 11))
    titles = [axes.get_title() for axes in hp.plot(scene).axes]
    assert titles[:2] == ["position", "rate"]
    assert hp.view(scene).frames == 11


@pytest.mark.parametrize("name", sparse([r"$\frac{$", "_a", "lambda"], 3))
def test_a_name_is_drawn_as_it_stands(name, tmp_path):
    pair = hp.HingePair((1, 0, 0), (0, 1, 0), (0, 0, 1), name=name)
    hp.plot(pair).savefig(tmp_path / "pair.png")
    hp.plot(hp.Mechanism([pair]), q=np.zeros((3, 1))).savefig(tmp_path / "robot.png")
    assert hp.view(pair, tmp_path / "pair.html").frames == 181


def test_struts_are_drawn_by_length_rate_and_force():
    lid = hp.HingePair(
        (0, 0, 0), (0, 0, 0), (0, 1, 0), name="lid", points1={"foot": (0.1, 0, -0.25)}, points2={"eye": (0.3, 0, 0)}
    )
    robot = lid.with_strut("foot", "eye", "gas", force=hp.GasSpring(150, 200, 0.25), free_length=0.55)
    q = np.linspace(0, -1.2, 11)[:, None]
    *panels, _ = hp.plot(robot, q=q, qd=np.full((11, 1), -1.2)).axes
    state = robot.struts(q, np.full((11, 1), -1.2))["gas"]
    drawn = [axes.get_lines()[0].get_ydata() for axes in panels[-3:]]
    for curve, values in zip(drawn, (state.length, state.rate, state.force), strict=True):
        np.testing.assert_allclose(curve, values, rtol=1e-13)  # other kernels: last bits
    assert '"struts": [{"name": "gas"' in hp.view(robot).html
