"""The command line as a user meets it: in a process of its own, with what it prints, writes and returns."""

from __future__ import annotations

import builtins
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from hingepair.engine.backend import execution_of
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


def test_a_failed_check_exits_with_1(monkeypatch: pytest.MonkeyPatch, short_scene: Path) -> None:
    from hingepair.validation import report as cross_validation

    genuine = cross_validation.Comparison.of

    def spoiled(output, computed, expected, *others, **fields):
        return genuine(output, computed, expected + 1, *others, **fields)

    monkeypatch.setattr(cross_validation.Comparison, "of", spoiled)
    assert "FAILED" in run_command("check", short_scene, code=1).stdout


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
