"""The README's code runs and prints what the README says."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import hingepair as hp
from hingepair.pair.accuracy import PROMISES
from support.sparse import sparse
from support.work import HANG

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"```python\n(.*?)```\n(?:\n```text\n(.*?)```)?", README, re.DOTALL)


def test_there_is_code() -> None:
    assert BLOCKS
    assert BLOCKS[0][1]


@pytest.mark.slow
@pytest.mark.parametrize("block", sparse(range(len(BLOCKS)), len(BLOCKS), "block{}".format))
def test_code_prints_what_the_readme_says(block: int) -> None:
    code, printed = BLOCKS[block]
    if "import dask" in code:
        pytest.importorskip("dask", reason="the extra dask is not installed")
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT, timeout=HANG
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == printed


def test_linked_files_exist() -> None:
    links = re.findall(r"\]\((?!http|#)([^)#]+)\)", README)
    assert "models/hinge_pair.svg" in links
    for link in links:
        assert (ROOT / link).exists(), link


@pytest.mark.parametrize("page", ["README.md", "models/README.md"])
def test_names_of_the_package_exist(page: str) -> None:
    for name in set(re.findall(r"\bhp\.(\w+)", (ROOT / page).read_text())):
        assert hasattr(hp, name), name


@pytest.mark.parametrize("output", PROMISES)
def test_the_table_of_accuracy_is_the_promise(output: str) -> None:
    promise = PROMISES[output]
    assert f"| {output} | {promise.proved} | {promise.seen} | {promise.scale} |" in README


def test_ci_runs_the_command_that_the_readme_names() -> None:
    lines = [line for line in README.splitlines() if "bin/pytest" in line and line.startswith("python3 -m venv")]
    assert len(lines) == 1
    assert lines[0] == next(line for line in README.splitlines() if "bin/pytest" in line)  # .ci/run takes the first
