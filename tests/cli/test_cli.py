"""The command line as a user meets it: in a process of its own, with what it prints, writes and returns."""

from __future__ import annotations

import builtins
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hingepair as hp
from hingepair.engine.backend import execution_of
from hingepair.formats.robots import robot_urdf
from hingepair.tables.data_frames import column_names
from support.commands import refusal, run_command
from support.work import HANG

pytestmark = pytest.mark.filterwarnings("ignore:.*no mass properties:hingepair.DynamicsWarning")
MODELS = Path(__file__).parents[2] / "models"
REFERENCE = MODELS / "reference_3d.toml"
SCENES = sorted(MODELS.glob("*.toml"))


@pytest.fixture
def short_scene(tmp_path: Path) -> Path:
    text = REFERENCE.read_text().replace("10001", "11")
    assert "11" in text
    path = tmp_path / "short.toml"
    path.write_text(text)
    return path


FAST = ("reference_2d",)


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene",
    [pytest.param(scene, marks=() if scene.stem in FAST else pytest.mark.slow, id=scene.stem) for scene in SCENES],
)
def test_every_model_runs_and_passes_its_check(scene: Path) -> None:
    assert hp.load_scene(scene).title in run_command("run", scene).stdout
    report = json.loads(run_command("check", scene, "--json").stdout)
    assert report["ok"]
    turned = "phi2" if scene.stem == "reference_2d" else "S2"
    expected = {"R2", turned, "d", "v2", "omega2", "a2", "alpha2"}
    if scene.stem in {"excavator", "falling_rods", "talos_lift"}:
        expected = {"R", "S", "d", "v", "omega", "a", "alpha", "tau", "force1", "torque1", "mass_matrix", "jacobian"}
        expected |= {"kinetic", "potential", "linear", "angular", "forward_dynamics"}
    if scene.stem == "gyro_log":  # of rates alone
        expected -= {"a2", "alpha2"}
    if scene.stem == "hatch":
        expected |= {f"{point}{rate}" for point in ("handle", "edge", "catch") for rate in ("", "_v", "_a")}
    assert {row["output"] for row in report["rows"]} == expected
    assert report["compared"] > 100


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_what_is_written_is_what_was_computed(
    short_scene: Path, tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The process of the command computes so few instants with NumPy; this one may have compiled kernels by now.
    monkeypatch.setattr(
        "hingepair.mechanism.requests.execution_of", lambda _, workers: execution_of("numpy", workers)
    )
    target = tmp_path / f"result{suffix}"
    assert str(target) in run_command(
        "run", short_scene, "--out", target, "--outputs", "R2,S2,omega1"
    ).stdout.replace("\n", "")
    result = hp.load_scene(short_scene).evaluate(("R2", "S2", "omega1"))
    if suffix == ".npz":
        with np.load(target) as file:
            coordinates = {"x", "y", "z", "phi_x", "phi_y", "phi_z", "psi"}
            assert set(file) == {"t", "R2", "S2", "omega1"} | coordinates
            for name in ("R2", "S2", "omega1"):
                np.testing.assert_array_equal(file[name], getattr(result, name))
    else:
        names = target.read_text().splitlines()[0].split(",")
        assert names[:5] == ["t", "R2_x", "R2_y", "R2_z", "S2_xx"]
        columns = np.loadtxt(target, delimiter=",", skiprows=1)
        expected = np.concatenate([result.t[:, None], result.R2, result.S2.reshape(-1, 9), result.omega1], axis=1)
        np.testing.assert_array_equal(columns[:, : expected.shape[1]], expected)
        assert names[-1] == "psi"
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_run_json_is_strict_and_complete(short_scene: Path) -> None:
    def refuse(word: str) -> None:
        raise AssertionError(word)

    found = json.loads(run_command("run", short_scene, "--json").stdout, parse_constant=refuse)
    assert found["samples"] == 11
    assert found["outputs"]["R2_x"]["first"] == 0.75
    assert found["file"] is None


@pytest.mark.slow
def test_ranges_are_those_of_every_component(short_scene: Path) -> None:
    shown = json.loads(run_command("run", short_scene, "--json").stdout)["outputs"]
    result = hp.load_scene(short_scene).evaluate()
    for name, array in result.state.arrays().items():
        for label, column in zip(column_names({name: array}), array.reshape(11, -1).T, strict=True):
            expected = {"first": column[0], "last": column[-1], "smallest": column.min(), "largest": column.max()}
            assert shown.pop(label) == expected
    assert shown == {
        "psi": {"first": 0, "last": 100, "smallest": 0, "largest": 100},
        "psid": dict.fromkeys(("first", "last", "smallest", "largest"), 10),
        "psidd": dict.fromkeys(("first", "last", "smallest", "largest"), 0),
    }


def test_a_failed_check_exits_with_1(monkeypatch: pytest.MonkeyPatch, short_scene: Path) -> None:
    from hingepair.validation import report as cross_validation

    genuine = cross_validation.Comparison.of

    def spoiled(output, computed, expected, *others, **fields):
        return genuine(output, computed, expected + 1, *others, **fields)

    monkeypatch.setattr(cross_validation.Comparison, "of", spoiled)
    assert "FAILED" in run_command("check", short_scene, code=1).stdout


@pytest.mark.slow
def test_the_mechanism_of_a_scene_is_written_as_mjcf(tmp_path: Path) -> None:
    out = tmp_path / "excavator.xml"
    run_command("mjcf", MODELS / "excavator.toml", "-o", out, "--gravity", "0,0,-1.62")
    text = out.read_text()
    assert 'gravity="0.0 0.0 -1.62"' in text
    assert all(f'<joint name="{name}" type="hinge"' in text for name in ("swing", "boom", "stick", "bucket"))


def test_mjcf_is_written_and_exports_take_their_base_by_a_flag(short_scene: Path, tmp_path: Path) -> None:
    pair = hp.load_scene(short_scene).pair
    run_command("mjcf", short_scene, "-o", tmp_path / "pair.xml")
    assert (tmp_path / "pair.xml").read_text() == hp.to_mjcf(pair, base="fixed")
    for flag, base in (("--fixed-base", "fixed"), ("--floating-base", "floating")):
        assert run_command("urdf", short_scene, flag).stdout == hp.to_urdf(pair, base=base)
    assert run_command("mjcf", short_scene, "--free-base").stdout == hp.to_mjcf(pair)


def shell(line: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    command = f"{sys.executable} -c 'from hingepair.cli.main import main; main()'"
    script = f'set -o pipefail; hingepair() {{ {command} "$@"; }}; {line}'
    return subprocess.run(
        ["bash", "-c", script], capture_output=True, check=False, timeout=HANG, env={**os.environ, **environment}
    )


@pytest.mark.slow
def test_a_closed_pipe_is_no_failed_check(short_scene: Path) -> None:
    done = shell(f"hingepair run {short_scene} | true")
    assert done.stderr == b""
    assert done.returncode in {0, 128 + 13}  # the pipe was still open, or the signal that a shell expects


@pytest.mark.slow
def test_output_that_nobody_takes_is_said_with_exit_2(short_scene: Path) -> None:
    done = shell(f"hingepair run {short_scene} > /dev/full")
    assert done.stderr.endswith(b"hingepair: standard output: No space left on device\n")
    assert done.returncode == 2


@pytest.mark.slow
def test_a_terminal_of_ascii_shows_any_title_and_files_stay_utf8(short_scene: Path) -> None:
    text = re.sub("(?m)^title = .*$", 'title = "Kn\u00e4uel \u2603"', short_scene.read_text())
    short_scene.write_text(re.sub("(?m)^name = .*$", 'name = "\u2603"', text))
    both = f"hingepair run {short_scene} && hingepair urdf {short_scene}"
    done = shell(both, PYTHONIOENCODING="ascii", PYTHONUTF8="0")
    assert done.returncode == 0, done.stderr
    shown, text = done.stdout.split(b"<?xml", 1)
    assert rb"Kn\xe4uel \u2603" in shown
    assert "\u2603".encode() in text


ESCAPE = "\x1b]0;owned\x07\x1b[2J"


@pytest.mark.slow
def test_what_a_file_holds_is_not_obeyed_by_the_terminal(short_scene: Path, tmp_path: Path) -> None:
    escape, text = json.dumps(ESCAPE)[1:-1], short_scene.read_text()
    scenes = {
        "title": re.sub("(?m)^title = .*$", lambda _: f'title = "{escape}"', text),
        "name": re.sub("(?m)^name = .*$", lambda _: f'name = "{escape}"', text),
        "key": text.replace("[pair]", f'[pair]\n"{escape}" = 1'),
        "expression": re.sub("(?m)^psi = .*$", lambda _: f'psi = "{escape}"', text),
        "robot": f'[pair]\nrobot = "{escape}"\njoint = "{escape}"\n[motion]\n[time]',
        "output": text + f'\n[outputs]\nnames = ["{escape}"]\n',
        "log": text.split("[motion]")[0] + "[motion]\nfile = 'log.csv'\n",
    }
    (tmp_path / "log.csv").write_text(f"t,{ESCAPE}\n0,1\n")
    for name, content in scenes.items():
        path = tmp_path / f"{name}.toml"
        path.write_text(content)
        for command in ("run", "check"):
            message = refusal(command, path)
            assert str(tmp_path) in message
            assert not {"\x1b", "\x07"} & set(message), (name, command)


@pytest.mark.parametrize(("error", "code"), [("MemoryError", 2), ("ZeroDivisionError", 3), ("RecursionError", 3)])
def test_an_error_that_is_none_of_ours_is_no_failed_check(
    error: str, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from hingepair.cli import main

    def fail() -> None:
        raise getattr(builtins, error)("unforeseen")

    monkeypatch.setattr(main, "_command_tree", lambda: fail)
    assert main._run_app() == code
    assert "unforeseen" in capsys.readouterr().err


@pytest.mark.slow
def test_a_closed_standard_output_is_no_error(short_scene: Path) -> None:
    done = shell(f"hingepair urdf {short_scene} >&-")
    assert done.returncode == 0
    assert all(line.startswith(b"hingepair: warning: ") for line in done.stderr.splitlines())


@pytest.mark.slow
def test_a_warning_is_a_line(tmp_path: Path) -> None:
    text = re.sub(r'<mass value="[^"]*"', '<mass value="-1"', (MODELS / "talos_elbow.urdf").read_text())
    (tmp_path / "light.urdf").write_text(text)
    done = shell(f"hingepair urdf {tmp_path / 'light.urdf'} hinge")
    lines = done.stderr.splitlines()
    assert all(line.startswith(b"hingepair: warning: ") for line in lines)
    assert sum(b"the mass properties of the body of 'body" in line for line in lines) == 2
    assert done.stdout.startswith(b"<?xml")


@pytest.mark.slow
def test_an_input_is_not_written_over(short_scene: Path, tmp_path: Path) -> None:
    log = tmp_path / "logged_arm.csv"
    log.write_bytes((MODELS / "logged_arm.csv").read_bytes())
    scene = tmp_path / "logged_arm.toml"
    scene.write_bytes((MODELS / "logged_arm.toml").read_bytes())
    content = log.read_bytes()
    refused = "--out: expected a file other than those that are read"
    assert refused in refusal("run", scene, "--out", log)
    for command in ("urdf", "mjcf"):
        assert refused in refusal(command, scene, "--out", scene)
        assert refused in refusal(command, scene, "--out", log)
    assert refused in refusal("derive", short_scene, "--out", short_scene)
    assert log.read_bytes() == content


# ---------------------------------------------------------------- a pair without a motion


@pytest.mark.slow
def test_a_simulated_scene_is_viewed_as_it_moves_and_derived_as_any_motion_of_its_hinge(tmp_path: Path) -> None:
    path = tmp_path / "fall.toml"
    path.write_text(
        "[pair]\nu1 = [0, 0, 0]\nu2 = [-0.5, 0, 0]\nn = [0, 1, 0]\nbody2 = { mass = 2, inertia = [0.1, 1, 1] }\n"
        "[dynamics]\nbase = 'fixed'\n[time]\nstart = 0\nstop = 0.1\nsamples = 7\n"
    )
    assert "(7 instants;" in run_command("view", path, "-o", tmp_path / "fall.html").stdout
    assert "v2_x = -psid*sin(psi)/2" in run_command("derive", path, "--outputs", "v2").stdout


def test_a_robot_without_a_joint_is_exported_whole(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    file.write_text(
        f'<robot name="arm"><link name="a"/><link name="b">{mass}</link><link name="c">{mass}</link>'
        '<joint name="one" type="continuous"><parent link="a"/><child link="b"/></joint>'
        '<joint name="two" type="continuous"><parent link="b"/><child link="c"/></joint></robot>'
    )
    robot = hp.Mechanism.from_urdf(file)
    assert run_command("urdf", file, "--fixed-base").stdout == hp.to_urdf(robot, base="fixed")
    assert run_command("mjcf", file).stdout == hp.to_mjcf(robot)
    assert run_command("mjcf", file, "two").stdout != hp.to_mjcf(robot)
    bare = hp.to_urdf(hp.load_robot("ur5"), meshes=False)
    for name in ("ur5", "ur5_robot", "ur_description/ur5_robot"):
        assert run_command("urdf", name, "--no-meshes").stdout == bare
    assert "hingepair view shows it" in refusal("plot", file)


@pytest.mark.slow
def test_a_robots_frame_is_derived_by_name_or_from_a_urdf(tmp_path: Path) -> None:
    robot = hp.load_robot("ur5_robot", snap=1e-6)
    q = np.linspace(-2, 2, 6)
    for source in ("ur5_robot", robot_urdf("ur5_robot")):
        text = run_command("derive", source, "--frame", "tool0", "--python", "--outputs", "R,jacobian").stdout
        assert "up to 5e-12 rad from a multiple of pi/2 are taken for it (--snap)" in text
        module: dict[str, Any] = {}
        exec(compile(text, "generated", "exec"), module)
        np.testing.assert_allclose(module["R"](q), robot.forward_kinematics(q, frames="tool0")["tool0"].R, atol=1e-15)
        np.testing.assert_allclose(module["jacobian"](q), robot.jacobian(q, "tool0"), rtol=0, atol=1e-15)
    as_written = run_command("derive", "ur5_robot", "--frame", "tool0", "--snap", "0", "--outputs", "R").stdout
    assert "--snap" not in as_written
    assert "e-12" in as_written
    latex = run_command(
        "derive", "ur5_robot", "--frame", "tool0", "--symbolic", "u", "--latex", "--outputs", "R"
    ).stdout
    assert "  p_{y} &= 0.0823 \\\\\n" in latex
    assert (
        json.loads(run_command("derive", "ur5_robot", "--frame", "world", "--json", "--outputs", "S").stdout)["S_xx"]
        == "1"
    )
    full = run_command("derive", "ur5_robot", "--frame", "tool0", "--outputs", "R", "--full").stdout
    assert "sin" in full
    assert "k_1" not in full
    scene = tmp_path / "arm.toml"
    scene.write_text(
        '[mechanism]\nrobot = "ur5_robot"\n[motion]\nelbow_joint = "t"\n[time]\nstart = 0\nstop = 1\nsamples = 3\n'
    )
    assert run_command("derive", scene, "--frame", "tool0", "--outputs", "R").stdout == as_written
    assert "--snap a robot's name or a URDF file" in refusal("derive", scene, "--frame", "tool0", "--snap", "1e-9")
    out = tmp_path / "forms.txt"
    run_command("derive", "ur5_robot", "--frame", "tool0", "--snap", "0", "--outputs", "R", "--out", out)
    assert out.read_text() == as_written


@pytest.mark.slow
def test_no_shown_number_hangs_on_rounding(tmp_path: Path) -> None:
    """A turn by pi/2 leaves no exact zeros."""
    (tmp_path / "turned.toml").write_text(
        "[pair]\nu1 = [0, 0, 1]\nu2 = [-1, 0, 0]\nn = [0, 0, 1]\n[motion]\nx = 0\ny = 0\nz = 0\n"
        "phi_x = 0\nphi_y = 0\nphi_z = 'pi/2*t'\npsi = 0\n[time]\nstart = 0\nstop = 2\nsamples = 3\n"
    )
    shown = run_command("run", tmp_path / "turned.toml").stdout
    assert not re.search(r"[0-9]e-[12]\d\b", shown.split("\nE1")[0])


@pytest.mark.slow
def test_a_whole_robot_is_compared_with_pinocchio():
    said = run_command("check", "ur5_robot").stdout
    assert "17 outputs of 224 samples within 16 u*scale" in said
    assert json.loads(run_command("check", robot_urdf("ur5_robot"), "--json").stdout)["ok"] is True


@pytest.mark.slow
def test_a_robot_that_differs_from_pinocchio_fails_its_check(monkeypatch):
    turned = hp.Mechanism.jacobian
    monkeypatch.setattr(hp.Mechanism, "jacobian", lambda self, *a, **k: turned(self, *a, **k) * (1 + 1e-12))
    said = run_command("check", "ur5_robot", code=1).stdout
    assert "FAILED: jacobian" in said


@pytest.mark.slow
def test_a_mechanism_runs_as_a_pair_does(tmp_path: Path) -> None:
    scene, out = MODELS / "excavator.toml", tmp_path / "log.csv"
    shown = run_command("run", scene, "--outputs", "R,q,bucket", "--explain").stdout
    assert "swing, boom, stick, bucket" in shown
    assert "operations at each instant" in shown
    for name, unit in (("R_teeth_x", "m"), ("omega_bucket_z", "rad/s"), ("stick", "rad")):
        assert re.search(rf"^{name} +{unit} ", shown, re.MULTILINE), name
    run_command("run", scene, "--outputs", "q,qd,qdd", "--out", out)
    logged = tmp_path / "logged.toml"
    text = scene.read_text()
    logged.write_text(text[: text.index("[motion]")] + "[motion]\nfile = 'log.csv'\n")
    report = json.loads(run_command("run", logged, "--outputs", "tau", "--json").stdout)
    assert report["mechanism"]["joints"] == ["swing", "boom", "stick", "bucket"]
    assert report["moving"] == ["swing", "boom", "stick", "bucket"]
    largest = report["outputs"]["tau_boom"]["largest"]
    assert largest == pytest.approx(np.abs(hp.load_scene(scene).forces().tau_boom).max(), rel=1e-9)
    assert "no place" not in run_command("urdf", scene).stdout
    assert "(nearest: teeth), got 'R_teath'" in refusal("run", scene, "--outputs", "R_teath")
