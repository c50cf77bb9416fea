"""The README's code runs and prints what the README says."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.pages import run_page

ROOT = Path(__file__).parent.parent


@pytest.mark.slow
def test_code_prints_what_the_readme_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "models").symlink_to(ROOT / "models")
    monkeypatch.chdir(tmp_path)
    for step, printed in run_page(ROOT / "README.md"):
        assert printed == step.expected, f"line {step.line}"
