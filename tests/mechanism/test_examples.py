"""The examples beside the scenes run."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

MODELS = Path(__file__).parents[2] / "models"


@pytest.mark.slow
def test_the_workspace_of_a_robot_is_drawn(tmp_path):
    picture = tmp_path / "workspace.png"
    runpy.run_path(str(MODELS / "workspace.py"))["main"](str(picture))
    assert picture.read_bytes().startswith(b"\x89PNG")
