"""The command line as a user meets it: what it prints, writes and returns, some of it in a process of its own."""

from __future__ import annotations

import builtins
import json
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from hingepair.cli.main import COMMANDS
from hingepair.engine.backend import execution_of
from support.commands import refusal, run_command
from support.work import HANG, python

pytestmark = pytest.mark.filterwarnings("ignore:.*no mass properties:hingepair.DynamicsWarning")
MODELS = Path(__file__).parents[2] / "models"
REFERENCE = MODELS / "reference_3d.toml"
SCENES = sorted(MODELS.glob("*.toml"))


@pytest.fixture
def short_scene(tmp_path: Path) -> Path:
    path = tmp_path / "short.toml"
    path.write_text(REFERENCE.read_text().replace("10001", "11"))
    return path


@pytest.mark.slow
@pytest.mark.parametrize("scene", [pytest.param(scene, id=scene.stem) for scene in SCENES])
def test_every_model_runs_and_passes_its_check(scene: Path) -> None:
    loaded = hp.load_scene(scene)
    assert loaded.suspicions() == ()
    assert loaded.title in run_command("run", scene).stdout
    report = json.loads(run_command("check", scene, "--json").stdout)
    assert report["ok"]
    assert report["compared"] > 100


def test_what_is_written_is_what_was_computed(
    short_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The process of the command computes so few instants with NumPy; this one may have compiled kernels by now.
    monkeypatch.setattr(
        "hingepair.mechanism.requests.execution_of", lambda _, workers: execution_of("numpy", workers)
    )
    target, names = tmp_path / "result.csv", ("R2", "S2", "omega1")
    assert (
        f"written: {target}\n"
        in run_command("run", short_scene, "--out", target, "--outputs", ",".join(names)).stdout
    )
    result = hp.load_scene(short_scene).evaluate(names)
    assert target.read_text().splitlines()[0].split(",")[:5] == ["t", "R2_x", "R2_y", "R2_z", "S2_xx"]
    columns = np.loadtxt(target, delimiter=",", skiprows=1)
    expected = np.concatenate([result.t[:, None], result.R2, result.S2.reshape(-1, 9), result.omega1], axis=1)
    np.testing.assert_array_equal(columns[:, : expected.shape[1]], expected)
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


@pytest.mark.slow
def test_what_differs_from_pinocchio_fails_its_check(monkeypatch: pytest.MonkeyPatch, short_scene: Path) -> None:
    turned = hp.Mechanism.jacobian
    monkeypatch.setattr(hp.Mechanism, "jacobian", lambda self, *a, **k: turned(self, *a, **k) * (1 + 1e-12))
    assert "FAILED: jacobian" in run_command("check", "ur5_robot", code=1).stdout
    from hingepair.validation.report import Comparison

    genuine = Comparison.of
    monkeypatch.setattr(
        Comparison, "of", lambda output, own, other, *more, **fields: genuine(output, own, other + 1, *more, **fields)
    )
    assert "FAILED" in run_command("check", short_scene, code=1).stdout


def shell(line: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    command = f"{sys.executable} -c 'from hingepair.cli.main import main; main()'"
    script = f'set -o pipefail; hingepair() {{ {command} "$@"; }}; {line}'
    return subprocess.run(
        ["bash", "-c", script], capture_output=True, check=False, timeout=HANG, env={**os.environ, **environment}
    )


@pytest.mark.slow
def test_what_becomes_of_the_output_decides_the_exit_code(short_scene: Path) -> None:
    closed_pipe = shell(f"hingepair run {short_scene} | true")
    assert closed_pipe.stderr == b""
    assert closed_pipe.returncode in {0, 128 + 13}  # the pipe was still open, or the signal that a shell expects
    full = shell(f"hingepair run {short_scene} > /dev/full")
    assert full.stderr.endswith(b"hingepair: standard output: No space left on device\n")
    assert full.returncode == 2
    closed = shell(f"hingepair urdf {short_scene} >&-")
    assert closed.returncode == 0
    assert all(line.startswith(b"hingepair: warning: ") for line in closed.stderr.splitlines())
    silent = shell("hingepair run nowhere.toml 2>&-")
    assert (silent.returncode, silent.stdout, silent.stderr) == (2, b"", b"")


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
    error: str, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(**_: object) -> None:
        raise getattr(builtins, error)("unforeseen")

    monkeypatch.setattr("hingepair.cli.main.app", fail)
    assert "unforeseen" in run_command(code=code).stderr


@pytest.mark.slow
def test_a_mechanism_runs_as_a_pair_does(tmp_path: Path) -> None:
    scene, out = MODELS / "excavator.toml", tmp_path / "log.csv"
    shown = run_command("run", scene, "--outputs", "R,q,bucket").stdout
    for name, unit in (("R_teeth_x", "m"), ("omega_bucket_z", "rad/s"), ("stick", "rad")):
        assert re.search(rf"^{name} +{unit} ", shown, re.MULTILINE), name
    run_command("run", scene, "--outputs", "q,qd,qdd", "--out", out)
    logged = tmp_path / "logged.toml"
    text = scene.read_text()
    logged.write_text(text[: text.index("[motion]")] + "[motion]\nfile = 'log.csv'\n")
    report = json.loads(run_command("run", logged, "--outputs", "tau", "--json").stdout)
    assert report["moving"] == ["swing", "boom", "stick", "bucket"]
    largest = report["outputs"]["tau_boom"]["largest"]
    assert largest == pytest.approx(
        np.abs(hp.load_scene(scene).forces().tau_boom).max(), rel=1e-9
    )  # of the digits that are printed
    assert "(nearest: R_teeth), got 'R_teath'" in refusal("run", scene, "--outputs", "R_teath")


# ---- the start of every command


@pytest.mark.slow
def test_libraries_that_only_some_commands_need_are_not_loaded() -> None:
    heavy = {"numpy", "sympy", "scipy", "llvmlite", "matplotlib", "pandas", "pyarrow", "dask", "pinocchio"}
    evaluated = 'import hingepair as hp; hp.load_scene("models/landing_gear.toml").evaluate(); '
    for before, absent in (("import hingepair.cli.main; ", heavy), (evaluated, {"sympy"})):
        code = f"{before}import sys; print(*{{name.partition('.')[0] for name in sys.modules}})"
        shown = python(code).split()
        assert "hingepair" in shown
        assert not absent & {*shown}


def test_the_list_of_commands_says_what_their_help_says() -> None:
    for commands in COMMANDS.values():
        for name, (module, text) in commands.items():
            command = getattr(import_module(f"hingepair.cli.{module}"), f"{name}_command")
            assert command.__doc__.partition("\n")[0] == text


# ---- examples and robots


def copied(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("name", "files"),
    [
        ("excavator", {"excavator.toml"}),
        ("logged_arm", {"logged_arm.toml", "logged_arm.csv"}),
        ("sweeps/landing_gear", {"landing_gear.toml", "sweeps/landing_gear.toml"}),
    ],
)
def test_an_example_is_copied_with_the_files_that_it_reads(tmp_path: Path, name: str, files: set[str]) -> None:
    folder = tmp_path / "new" / "folder"
    out = run_command("examples", name, folder).stdout
    assert copied(folder) == files
    command = "sweep" if "sweeps" in name else "run"
    assert out.splitlines()[-1] == f"Now try: hingepair {command} {folder / name}.toml"
    for file in files:
        assert (folder / file).read_bytes() == (MODELS / file).read_bytes()
    told = json.loads(run_command("examples", name, folder / "again", "--json").stdout)
    assert {*told["files"]} == {str(folder / "again" / file) for file in files}


def test_an_example_overwrites_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    log = tmp_path / "logged_arm.csv"
    log.write_text("mine")
    message = refusal("examples", "logged_arm")
    assert message.startswith("DIRECTORY: ")
    assert log.read_text() == "mine"
    assert copied(tmp_path) == {"logged_arm.csv"}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "talos_full_v2", "romeo", "kinova"])
def test_the_joints_of_a_robot_are_those_of_its_mechanism(name: str) -> None:
    robot, report = hp.load_robot(name), json.loads(run_command("robots", name, "--json").stdout)
    leading = [row for row in report["joints"] if "mimic" not in row]
    assert tuple(row["joint"] for row in leading) == robot.names
    for row, limits, rate, effort in zip(
        leading, robot.position_limits, robot.rate_limits, robot.effort_limits, strict=True
    ):
        assert [None if np.isinf(one) else one for one in limits] == row["limits"]
        assert rate == (np.inf if row["rate_limit"] is None else row["rate_limit"])
        assert effort == (np.inf if row["effort_limit"] is None else row["effort_limit"])
    for row in report["joints"]:
        assert row["kind"] == ("slider" if isinstance(robot[row["joint"]], hp.Slider) else "hinge")
    assert report["dof"] == robot.dof


@pytest.mark.parametrize("typed", ["run no_such.toml", "run", "run --no-such-option", "no_such_command", "sweep ."])
def test_a_command_that_fails_says_so_in_json_too(typed):
    error = json.loads(run_command(*typed.split(), "--json", code=2).stdout)["error"]
    assert error["message"]
    assert (error["type"] in {"ArgumentError", "SceneError"}) == ("expected" in error)
