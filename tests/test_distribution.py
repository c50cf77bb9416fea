"""What a user installs: the source distribution, the wheel built from it, and the metadata of both."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
from pathlib import Path

import pytest

import hingepair as hp

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CITATION = (ROOT / "CITATION.cff").read_text()


def test_one_version_stands_everywhere() -> None:
    assert hp.__version__ == PROJECT["version"]
    assert f"\nversion: {PROJECT['version']}\n" in CITATION
    assert f"\nlicense: {PROJECT['license']}\n" in CITATION


def built(folder: Path, kind: str, source: Path) -> Path:
    """Return the distribution that hatchling builds of a source tree."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(folder)]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    (made,) = folder.glob({"sdist": "*.tar.gz", "wheel": "*.whl"}[kind])
    return made


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory) -> Path:
    """The source distribution, unpacked."""
    pytest.importorskip("hatchling", reason="the build backend is not installed")
    folder = tmp_path_factory.mktemp("sdist")
    with tarfile.open(built(folder, "sdist", ROOT)) as archive:
        archive.extractall(folder, filter="data")
    (tree,) = (path for path in folder.iterdir() if path.is_dir())
    return tree


@pytest.fixture(scope="module")
def installed(unpacked, tmp_path_factory) -> Path:
    """The folder of the programs of a new environment into which the wheel was installed."""
    folder = tmp_path_factory.mktemp("wheel")
    wheel = built(folder, "wheel", unpacked)
    subprocess.run([sys.executable, "-m", "venv", str(folder / "venv")], check=True, capture_output=True)
    paths = {"base": str(folder / "venv"), "platbase": str(folder / "venv")}
    programs = Path(sysconfig.get_path("scripts", "venv", paths))
    install = [str(programs / "python"), "-m", "pip", "install", "--no-deps", "--no-index", str(wheel)]
    subprocess.run(install, check=True, capture_output=True)
    # the dependencies are those of this environment; the new one's own packages come first
    dependencies = Path(sysconfig.get_path("purelib", "venv", paths)) / "dependencies.pth"
    dependencies.write_text(f"{sysconfig.get_path('purelib')}\n{sysconfig.get_path('platlib')}\n")
    return programs


def outside(command: list[str], folder: Path) -> str:
    """Return what a command prints that sees nothing of the source tree."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_source_distribution_holds_what_a_maintainer_needs(unpacked: Path) -> None:
    for path in (
        "README.md",
        "CONTRIBUTING.md",
        "CHANGELOG.md",
        "CITATION.cff",
        "LICENSE",
        "models",
        "docs",
        "tests",
    ):
        assert (unpacked / path).exists(), path


@pytest.mark.slow
def test_the_installed_wheel_runs_its_commands_and_an_example(installed: Path, tmp_path: Path) -> None:
    where = outside([str(installed / "python"), "-c", "import hingepair; print(hingepair.__file__)"], tmp_path)
    assert Path(where.strip()).is_relative_to(installed.parent)
    command = str(installed / "hingepair")
    assert PROJECT["version"] in outside([command, "--version"], tmp_path)
    listed = outside([command, "--help"], tmp_path)
    assert all(name in listed for name in ("run", "check", "examples"))
    outside([command, "examples", "logged_arm", str(tmp_path)], tmp_path)
    assert "R2" in outside([command, "run", "logged_arm.toml"], tmp_path)


@pytest.mark.slow
def test_the_wheel_holds_every_module_example_and_file_of_the_package(installed: Path, tmp_path: Path) -> None:
    code = "import hingepair, pathlib; print(pathlib.Path(hingepair.__file__).parent)"
    package = Path(outside([str(installed / "python"), "-c", code], tmp_path).strip())

    def files(folder: Path) -> set[str]:
        return {
            path.relative_to(folder).as_posix()
            for path in folder.rglob("*")
            if path.is_file() and path.suffix not in {".pyc", ".pyo"}
        }

    examples = {f"examples/{name}" for name in files(ROOT / "models") if name.endswith((".toml", ".csv"))}
    assert files(package) == files(ROOT / "src" / "hingepair") | examples


@pytest.mark.slow
def test_the_metadata_is_valid(installed: Path, tmp_path: Path) -> None:
    code = "from importlib.metadata import distribution as d; print(d('hingepair').read_text('METADATA'))"
    metadata = pytest.importorskip("packaging.metadata")
    text = outside([str(installed / "python"), "-c", code], tmp_path)
    found = metadata.Metadata.from_email(text, validate=True)  # refuses what the index of packages refuses
    assert found.summary == PROJECT["description"]
    assert found.license_expression == PROJECT["license"]
    assert found.description.startswith("# hingepair")
