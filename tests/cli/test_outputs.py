"""Files that commands write: checked before any work, named by their option, and nothing is left behind."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from hingepair.mechanism.results import Record
from support.commands import refusal, run_command
from support.recorded import recording

MODELS = Path(__file__).parents[2] / "models"


def work(*_: object, **__: object) -> None:
    raise AssertionError("the work begins before the outputs are checked")


@pytest.mark.parametrize(
    ("command", "ending"),
    [
        ("run a.toml", ".csv"), ("forces a.toml", ".csv"), ("plot a.toml", ".png"), ("view a.toml", ".html"),
        ("derive a.toml", ".txt"), ("fit a.toml", ".csv"), ("fit a.toml --out psi.csv", ".png"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("target", ["missing/x", "folder", "input"])
def test_outputs_are_checked_before_work(command, ending, target, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in (
        "scenes.read_scene",
        "pictures.read_scene",
        "pictures.read_source",
        "derive.read_source",
        "fit.read_recording",
    ):
        monkeypatch.setattr(f"hingepair.cli.{name}", work)
    Path("a.toml").write_text("")
    Path(f"folder{ending}").mkdir()
    Path(f"input{ending}").symlink_to("a.toml")
    before = {*os.listdir()}
    assert refusal(*command.split(), "--out", target + ending).startswith("--out: expected a file ")
    assert {*os.listdir()} == before


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hingepair.DynamicsWarning")
@pytest.mark.parametrize(
    ("command", "ending"), [("plot", ".png"), ("view", ".html"), ("urdf", ".urdf"), ("mjcf", ".xml")]
)
def test_commands_that_write_files_name_them_in_json(command, ending, tmp_path):
    scene, out = MODELS / "reference_2d.toml", tmp_path / f"out{ending}"
    assert json.loads(run_command(command, scene, "--json", "--out", out).stdout)["file"] == str(out)
    assert out.stat().st_size
    if command in ("urdf", "mjcf"):
        told = json.loads(run_command(command, scene, "--json").stdout)
        assert (told["file"], told["text"]) == (None, out.read_text(encoding="utf-8"))


@pytest.mark.slow
def test_a_log_that_is_read_is_not_written_over(tmp_path):
    for ending in (".toml", ".csv"):
        (tmp_path / f"arm{ending}").write_bytes(
            (MODELS / f"logged_arm{ending}").read_bytes().replace(b"logged_", b"")
        )
    log = tmp_path / "arm.csv"
    content = log.read_bytes()
    for command in ("run", "urdf", "mjcf"):
        message = refusal(command, tmp_path / "arm.toml", "--out", log)
        assert "--out: expected a file other than those that are read" in message
    assert log.read_bytes() == content


@pytest.mark.slow(3)
def test_what_fails_after_the_check_names_its_option_and_what_is_written(tmp_path, monkeypatch):
    made = recording(300, 1e-3, 2e-3)
    file = Record(made.t, {"R1": made.R1, "S1": made.S1, "R2": made.R2, "S2": made.S2}).save(tmp_path / "a.npz")
    out, plot = tmp_path / "psi.csv", tmp_path / "there" / "fit.png"
    plot.parent.mkdir()
    monkeypatch.setattr("hingepair.cli.fit.plot", lambda *_, **__: plot.parent.rmdir())
    printed = run_command("fit", file, "--out", out, "--out", plot, code=2)
    assert printed.stderr.startswith("hingepair: --out: expected a file that can be written")
    assert printed.stdout.endswith(f"\nwritten: {out}\n")
