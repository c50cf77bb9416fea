"""`hingepair examples`: the scenes and sweeps that come with the package, listed and copied."""

from __future__ import annotations

from pathlib import Path

import pytest

import hingepair as hp
from hingepair.scenes.variants.sweep import load_sweep
from support.commands import refusal, run_command

ROOT = Path(__file__).parents[2]
MODELS = ROOT / "models"
NAMES = sorted(path.relative_to(MODELS).with_suffix("").as_posix() for path in MODELS.rglob("*.toml"))


def examples(*arguments: object) -> str:
    return run_command("examples", *arguments).stdout


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
    out = examples(name, folder)
    assert copied(folder) == files
    command = "sweep" if "sweeps" in name else "run"
    assert out.splitlines()[-1] == f"Now try: hingepair {command} {folder / name}.toml"
    for file in files:
        assert (folder / file).read_bytes() == (MODELS / file).read_bytes()


@pytest.mark.slow
def test_all_examples_can_be_loaded_where_they_were_copied(tmp_path: Path) -> None:
    examples("all", tmp_path)
    for name in NAMES:
        path = tmp_path / f"{name}.toml"
        loaded = load_sweep(path) if "\nscene = " in path.read_text() else hp.load_scene(path)
        assert loaded.title


def test_an_example_goes_to_the_working_directory_unless_told(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    examples("logged_arm")
    assert copied(tmp_path) == {"logged_arm.toml", "logged_arm.csv"}


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    log = tmp_path / "logged_arm.csv"
    log.write_text("mine")
    message = refusal("examples", "logged_arm", tmp_path)
    assert message.startswith("DIRECTORY: ")
    assert message.endswith(f"got {log}")
    assert log.read_text() == "mine"
    assert copied(tmp_path) == {"logged_arm.csv"}
