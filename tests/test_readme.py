"""The README's code and commands run and print what the README says; what it links and quotes exists."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import hingepair as hp
from support.pages import run_page

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_code_prints_what_the_readme_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "models").symlink_to(ROOT / "models")
    monkeypatch.chdir(tmp_path)
    for step, printed in run_page(ROOT / "README.md"):
        assert printed == step.expected, f"line {step.line}"


def test_linked_files_and_headings_exist() -> None:
    links = re.findall(r"\]\((?!http)([^)#]*)#?([^)]*)\)", README)
    links += [(file, "") for file in re.findall(r'<img src="([^"]*)"', README)]
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
