"""The command line as a user meets it: in a process of its own, with what it prints, writes and returns."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from hingepair.evaluation.backend import choose

MODELS = Path(__file__).parents[2] / "models"
REFERENCE = MODELS / "reference_3d.toml"
SCENES = sorted(MODELS.glob("*.toml"))
EXIT_OK, EXIT_CHECK_FAILED, EXIT_BAD_INPUT = 0, 1, 2


def hingepair(*arguments: object, code: int = EXIT_OK) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from hingepair.cli.main import main; main()", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == code, done.stdout + done.stderr
    return done


@pytest.fixture
def short_scene(tmp_path: Path) -> Path:
    text = REFERENCE.read_text().replace("10001", "11")
    assert "11" in text
    path = tmp_path / "short.toml"
    path.write_text(text)
    return path


FAST = ("reference_2d",)


@pytest.mark.parametrize(
    "scene",
    [pytest.param(scene, marks=() if scene.stem in FAST else pytest.mark.slow, id=scene.stem) for scene in SCENES],
)
def test_every_model_runs_and_passes_its_check(scene: Path) -> None:
    assert hp.load_scene(scene).title in hingepair("run", scene).stdout
    report = json.loads(hingepair("check", scene, "--json").stdout)
    assert report["ok"]
    turned = "phi2" if scene.stem == "reference_2d" else "S2"
    assert {row["output"] for row in report["rows"]} == {"R2", turned, "d", "v2", "omega2", "a2", "alpha2"}
    assert report["compared"] > 100


def test_all_models_are_there() -> None:
    assert {scene.stem for scene in SCENES} >= {
        "reference_3d",
        "reference_2d",
        "satellite_panel",
        "truck_trailer",
        "talos_elbow",
        "logged_arm",
    }


def test_run_says_what_came_out(short_scene: Path) -> None:
    out = hingepair("run", short_scene).stdout
    for expected in (
        "t = 0",
        "t = 5",
        "t = 10",
        "smallest",
        "R2_x",
        "S2_zz",
        "alpha2_z",
        "E1",
        "E2",
        "nothing written",
    ):
        assert expected in out


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_what_is_written_is_what_was_computed(
    short_scene: Path, tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The process of the command computes so few instants with NumPy; this one may have compiled kernels by now.
    monkeypatch.setattr("hingepair.pair.hinge_pair.choose", lambda _, workers: choose("numpy", workers))
    target = tmp_path / f"result{suffix}"
    assert str(target) in hingepair("run", short_scene, "--out", target, "--outputs", "R2,S2,omega1").stdout.replace(
        "\n", ""
    )
    result = hp.load_scene(short_scene).evaluate(("R2", "S2", "omega1"))
    if suffix == ".npz":
        with np.load(target) as file:
            assert set(file) == {"t", "R2", "S2", "omega1"}
            for name in ("R2", "S2", "omega1"):
                np.testing.assert_array_equal(file[name], getattr(result, name))
    else:
        names = target.read_text().splitlines()[0].split(",")
        assert names[:5] == ["t", "R2_x", "R2_y", "R2_z", "S2_xx"]
        columns = np.loadtxt(target, delimiter=",", skiprows=1)
        expected = np.concatenate([result.t[:, None], result.R2, result.S2.reshape(-1, 9), result.omega1], axis=1)
        np.testing.assert_array_equal(columns, expected)
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_run_json_is_strict_and_complete(short_scene: Path) -> None:
    def refuse(word: str) -> None:
        raise AssertionError(word)

    found = json.loads(hingepair("run", short_scene, "--json").stdout, parse_constant=refuse)
    assert found["samples"] == 11
    assert found["outputs"]["R2_x"]["first"] == 0.75
    assert 0 < found["residuals"]["E1"]["in_u_scale"] < 16
    assert found["file"] is None


def test_residuals_see_a_broken_constraint(monkeypatch: pytest.MonkeyPatch, short_scene: Path) -> None:
    from hingepair.cli import summary

    scene = hp.load_scene(short_scene)
    assert max(r.ratio for r in summary.residuals(scene)) < 16
    genuine = summary.constraint_values
    moved = lambda pair, names, values, shapes: genuine(pair, names, values | {"R2": values["R2"] + 1e-9}, shapes)  # noqa: E731
    monkeypatch.setattr(summary, "constraint_values", moved)
    assert summary.residuals(scene)[0].ratio > 1e4


def test_a_failed_check_exits_with_1(monkeypatch: pytest.MonkeyPatch, short_scene: Path) -> None:
    from typer.testing import CliRunner

    from hingepair.cli.main import app
    from hingepair.validation import report as cross_validation

    genuine = cross_validation.Comparison.worst_of

    def spoiled(output, error, ratio, index, shape):
        return genuine(output, error, ratio + 17, index, shape)

    monkeypatch.setattr(cross_validation.Comparison, "worst_of", spoiled)
    done = CliRunner().invoke(app, ["check", str(short_scene)])
    assert done.exit_code == EXIT_CHECK_FAILED
    assert "FAILED" in done.stdout


def test_urdf_is_written_whole_and_read_back(short_scene: Path, tmp_path: Path) -> None:
    target = tmp_path / "pair.urdf"
    hingepair("urdf", short_scene, "-o", target)
    assert target.read_text().strip() == hingepair("urdf", short_scene).stdout.strip()
    back = hp.from_urdf(target, joint="hinge")
    np.testing.assert_array_equal(back.u1, (0.5, 0.2, 0.1))


@pytest.mark.slow
def test_mjcf_is_written_and_exports_take_their_base_by_a_flag(short_scene: Path, tmp_path: Path) -> None:
    pair = hp.load_scene(short_scene).pair
    hingepair("mjcf", short_scene, "-o", tmp_path / "pair.xml")
    assert (tmp_path / "pair.xml").read_text() == hp.to_mjcf(pair)
    for flag, base in (("--fixed-base", "fixed"), ("--floating-base", "floating")):
        assert hingepair("urdf", short_scene, flag).stdout == hp.to_urdf(pair, base=base)
    assert hingepair("mjcf", short_scene, "--fixed-base").stdout == hp.to_mjcf(pair, base="fixed")
    done = hingepair("urdf", short_scene, "--fixed-base", "--floating-base", code=EXIT_BAD_INPUT)
    assert done.stderr.strip() == "hingepair: --fixed-base: expected this or --floating-base, got both"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "no_such.toml"), ("no_such.toml", "expected")),
        (("check", "no_such.toml"), ("no_such.toml", "expected")),
        (("run", REFERENCE, "--outputs", "R9"), ("outputs", "R2", "R9")),
        (("run", REFERENCE, "--out", "result.txt"), (".npz", ".csv", "result.txt")),
        (("run", REFERENCE, "--out", "no/such/folder/result.npz"), ("no/such/folder",)),
        (("run", MODELS), ("expected",)),
    ],
    ids=["no_file", "check_no_file", "unknown_output", "unknown_ending", "no_folder", "a_folder"],
)
def test_bad_input_is_one_line_and_exit_2(arguments: tuple[object, ...], words: tuple[str, ...]) -> None:
    done = hingepair(*arguments, code=EXIT_BAD_INPUT)
    assert len(done.stderr.strip().splitlines()) == 1
    assert done.stdout == ""
    for word in words:
        assert word in done.stderr


def test_a_failed_write_keeps_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from hingepair.formats import results as export

    target = tmp_path / "result.csv"
    target.write_text("old")

    def disk_full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(export.np, "savetxt", disk_full)
    with pytest.raises(hp.ArgumentError, match="No space left"):
        export.save(target, np.zeros(3), {"R2": np.zeros((3, 3))})
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["result.csv"]


@pytest.mark.parametrize(
    "command", ["", "run", *(pytest.param(c, marks=pytest.mark.slow) for c in ("check", "urdf", "mjcf"))]
)
def test_help_explains(command: str) -> None:
    assert "Usage" in hingepair(*command.split(), "--help").stdout


@pytest.mark.slow
def test_robots_are_listed_with_their_hinges() -> None:
    robots = json.loads(hingepair("robots", "--json").stdout)
    assert {"robot": "talos_reduced", "hinges": 32} in robots
    assert sum(robot["hinges"] for robot in robots) >= 1200
    hinges = json.loads(hingepair("robots", "talos_reduced", "--json").stdout)
    assert "arm_left_4_joint" in [hinge["joint"] for hinge in hinges]
    assert "arm_left_4_joint" in hingepair("robots", "talos_reduced").stdout
    assert "ur5_robot" in hingepair("robots", "ur5", code=EXIT_BAD_INPUT).stderr


def test_a_scene_without_a_finite_instant_shows_no_residuals(short_scene: Path) -> None:
    short_scene.write_text(re.sub(r"(?m)^psi = .*$", 'psi = "sqrt(-1 - t)"', short_scene.read_text()))
    out = hingepair("run", short_scene).stdout
    assert "11 of 11 instants are not finite; there is nothing to show" in out
    assert "E1" not in out
    report = json.loads(hingepair("run", short_scene, "--json", "--explain").stdout)
    assert report["not_finite"] == 11
    assert report["residuals"]["E1"] == {"largest": None, "in_u_scale": None}
    assert report["plan"]["outputs"]


def test_version() -> None:
    assert hp.__version__ in hingepair("--version").stdout


def test_run_explains() -> None:
    out = hingepair("run", MODELS / "truck_trailer.toml", "--explain").stdout
    assert "rotations about x and y: constants prove that all turns are about z" in out
    assert "phi_x is constant" in out
    assert "skipped:" in out
