"""Set up a virtual environment for this project and do a job in it: `python3 .ci/job.py main|test|lint`.

Needs Python 3.11 or newer and nothing else: the environment is `.venv` beside the README, made on the first call,
used again as long as pyproject.toml stays the same.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
BIN = VENV / ("Scripts" if os.name == "nt" else "bin")
PYTHON = BIN / ("python.exe" if os.name == "nt" else "python")
MARK = VENV / "installed"

MODELS = [f"models/{name}.toml" for name in ("reference_3d", "talos_elbow")]
JOBS = {
    "main": ("robots", [["hingepair", command, model] for model in MODELS for command in ("run", "check")]),
    "test": ("test", [["pytest", "-q", "-m", "slow or not slow", "--durations=5"]]),
    "lint": (
        "dev",
        [
            ["ruff", "check", "."],
            ["ruff", "format", "--check", "."],
            ["mypy"],
            ["pytest", "-q", "--doctest-modules", "src"],
            ["pytest", "-q", "tests/test_readme.py"],
        ],
    ),
}


def environment(extra: str) -> None:
    """Make .venv, and install the project with an extra in it, unless that was done before."""
    stamp = hashlib.sha256((ROOT / "pyproject.toml").read_bytes() + str(ROOT).encode()).hexdigest()
    done = MARK.read_text().split() if MARK.is_file() and PYTHON.is_file() else []
    if done[:1] == [stamp] and extra in done:
        return
    if done[:1] != [stamp]:
        done = [stamp]
        shutil.rmtree(VENV, ignore_errors=True)
        print(f"making {VENV.name} ...", flush=True)
        pip = make_venv()
    else:
        pip = [str(PYTHON), "-m", "pip"]
    print(f"installing hingepair[{extra}] in {VENV.name} (a minute or two the first time) ...", flush=True)
    subprocess.run(
        [*pip, "install", "--quiet", "--disable-pip-version-check", "--editable", f".[{extra}]"], check=True
    )
    MARK.write_text(" ".join([*done, extra]) + "\n")


def make_venv() -> list[str]:
    """The environment, and the pip that installs into it: its own, or this Python's where ensurepip is missing."""
    try:
        venv.create(VENV, with_pip=True)
    except (subprocess.CalledProcessError, ImportError):
        shutil.rmtree(VENV, ignore_errors=True)
        venv.create(VENV, with_pip=False)
        return [sys.executable, "-m", "pip", "--python", str(PYTHON)]
    return [str(PYTHON), "-m", "pip"]


def main() -> int:
    """Do the job that the command line names; the exit code is that of the first command that fails."""
    if sys.version_info < (3, 11):
        print(f"hingepair needs Python 3.11 or newer, this is {sys.version.split()[0]}", file=sys.stderr)
        return 2
    if len(sys.argv) != 2 or sys.argv[1] not in JOBS:
        print(f"usage: python3 .ci/job.py {'|'.join(JOBS)}", file=sys.stderr)
        return 2
    os.chdir(ROOT)
    extra, commands = JOBS[sys.argv[1]]
    try:
        environment(extra)
    except subprocess.CalledProcessError as error:
        print(f"setting up {VENV} failed (see above)", file=sys.stderr)
        return error.returncode or 1
    for tool, *arguments in commands:
        print(f"\n$ {' '.join([tool, *arguments])}", flush=True)
        code = subprocess.run([str(BIN / tool), *arguments], check=False).returncode
        if code:
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
