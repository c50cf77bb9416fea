"""The README's code and commands run and print what the README says; what it links and quotes exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import hingepair as hp
from hingepair.cli.main import COMMANDS, app
from support.pages import page_steps, run_page

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_code_prints_what_the_readme_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "models").symlink_to(ROOT / "models")
    monkeypatch.chdir(tmp_path)
    for step, printed in run_page(ROOT / "README.md"):
        assert printed == step.expected, f"line {step.line}"


def test_every_block_of_code_is_run() -> None:
    kinds = [step.kind for step in page_steps(ROOT / "README.md")]
    assert kinds.count("python") == len(re.findall("^```python$", README, re.MULTILINE)) > 1
    assert kinds.count("command") == len(re.findall(r"^\$ hingepair", README, re.MULTILINE)) > 0


def test_the_first_screen_names_the_units() -> None:
    first_screen = " ".join(README.splitlines()[:25])
    assert "metres, seconds, kilograms, radians;" in first_screen


def test_the_log_is_quoted_as_it_stands() -> None:
    page = (ROOT / "docs" / "howto" / "csv_log.md").read_text(encoding="utf-8")
    log = (ROOT / "models" / "logged_arm.csv").read_text(encoding="utf-8")
    assert f"```text\n{''.join(log.splitlines(keepends=True)[:2])}" in page


def test_linked_files_and_headings_exist() -> None:
    links = re.findall(r"\]\((?!http)([^)#]*)#?([^)]*)\)", README)
    assert ("models/hinge_pair.svg", "") in links
    for file, heading in links:
        path = ROOT / file if file else ROOT / "README.md"
        assert path.exists(), file
        if heading:
            headings = re.findall("^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
            anchors = [re.sub(r"[^\w -]", "", one).lower().replace(" ", "-") for one in headings]
            assert heading in anchors, f"{file}#{heading}"


@pytest.mark.parametrize("page", ["README.md", "models/README.md"])
def test_names_of_the_package_exist(page: str) -> None:
    for name in set(re.findall(r"\bhp\.(\w+)", (ROOT / page).read_text(encoding="utf-8"))):
        assert hasattr(hp, name), name


def test_every_command_is_named_under_its_heading() -> None:
    table = README.partition("## Commands")[2].partition("```")[0]
    for heading, of_heading in COMMANDS.items():
        row = next(line for line in table.splitlines() if line.startswith(f"| {heading.lower()} |"))
        assert {*of_heading} <= {*re.findall("`(.*?)`", row)}
    named = {*re.findall("`(.*?)`", table)}
    groups = {group.name for group in app.registered_groups}
    commands = {one.name or getattr(one.callback, "__name__", "") for one in app.registered_commands} | groups
    assert commands <= named


def test_ci_runs_the_command_that_the_readme_names() -> None:
    lines = [line for line in README.splitlines() if "bin/pytest" in line and line.startswith("python3 -m venv")]
    assert len(lines) == 1
    assert lines[0] == next(line for line in README.splitlines() if "bin/pytest" in line)  # .ci/run takes the first
