"""`hingepair examples`: list and copy the scenes and sweeps that come with the package."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path
from typing import Annotated, Any

import typer

from hingepair.cli.options import JsonOption
from hingepair.cli.output import show
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.tables.sheets import align_columns

_INSTALLED = Path(__file__).parents[1] / "examples"
_FOLDER = _INSTALLED if _INSTALLED.is_dir() else Path(__file__).parents[3] / "models"  # of a checkout


def examples_command(
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help="Copy this example and the files that it reads; all: every example."),
    ] = None,
    directory: Annotated[
        Path, typer.Argument(metavar="DIRECTORY", help="Where the files go; made if it does not exist.")
    ] = Path(),
    as_json: JsonOption = False,
) -> None:
    """List the example scenes and sweeps, or copy one.

    An example is copied with the files that it reads. Nothing is overwritten: if one of the files is already there,
    none is copied.
    """
    examples = _examples()
    if name is None:
        rows = [("example", "description"), *((one, _read(path)["title"]) for one, path in examples.items())]
        hint = "Copy one with: hingepair examples NAME [DIRECTORY]"
        return show(as_json, {"examples": dict(rows[1:])}, *align_columns(rows, set()), "", hint)
    if name not in {"all", *examples}:
        names = ("all", *examples)
        raise ArgumentError("name", f"{choices(names)}{nearest(name, names)}", quoted(name))
    wanted = [*examples.values()] if name == "all" else [examples[name]]
    targets = {file: directory / file.relative_to(_FOLDER) for path in wanted for file in (path, *_read_by(path))}
    existing = [target for target in targets.values() if target.exists() or target.is_symlink()]
    if existing:
        expected = "a directory without files of these names, since nothing is overwritten"
        raise ArgumentError("directory", expected, ", ".join(map(str, existing)))
    try:
        for file, target in targets.items():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, target)
    except OSError as error:
        got = f"{str(directory)!r} ({error.strerror or error})"
        raise ArgumentError("directory", "a directory that can be written", got) from None
    lines = [f"written: {target}" for target in targets.values()]
    if name != "all":
        command = "sweep" if "scene" in _read(wanted[0]) else "run"
        lines.append(f"Now try: hingepair {command} {directory / f'{name}.toml'}")
    show(as_json, {"files": [str(target) for target in targets.values()]}, *lines)


def example_hint(typed: str) -> str:
    """Return a remark on the command `hingepair examples`, for a scene file that does not exist."""
    names = {Path(name).name: name for name in reversed(_examples())}
    if (stem := Path(typed).stem) in names:
        return f" (hingepair examples {names[stem]} copies the example of this name)"
    return f" (hingepair examples lists and copies worked examples{nearest(stem, names)})"


def _examples() -> dict[str, Path]:
    """Return the scene or sweep file of each example by its name."""
    return {path.relative_to(_FOLDER).with_suffix("").as_posix(): path for path in sorted(_FOLDER.rglob("*.toml"))}


def _read(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


def _read_by(path: Path) -> list[Path]:
    """Return the files that a scene or sweep refers to: log, URDF, the scene of a sweep, and the files of that."""
    table = _read(path)
    named = (table.get("motion", {}).get("file"), table.get("mechanism", {}).get("urdf"), table.get("scene"))
    files = [(path.parent / file).resolve() for file in named if file is not None]
    return [*files, *(inner for file in files if file.suffix == ".toml" for inner in _read_by(file))]
