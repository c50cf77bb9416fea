"""`hingepair examples`: the scenes and sweeps that come with the package, listed and copied."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from hingepair.cli.output import console
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.numeric.tables import aligned

ALL = "all"
"""The name that stands for every example."""


def examples(
    name: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help=f"Copy this example and the files that it reads; {ALL}: every example."),
    ] = None,
    directory: Annotated[
        Path, typer.Argument(metavar="DIRECTORY", help="Where the files go; made if it does not exist.")
    ] = Path(),
) -> None:
    """List the example scenes and sweeps, or copy one with the files that it reads.

    Nothing is overwritten: if one of the files is already there, none is copied.
    """
    folder = _folder()
    scenes = {path.relative_to(folder).with_suffix("").as_posix(): path for path in sorted(folder.rglob("*.toml"))}
    if name is None:
        rows = [("example", "what it is"), *((one, _read(path)["title"]) for one, path in scenes.items())]
        lines = [*aligned(rows, set()), "", "Copy one with: hingepair examples NAME [DIRECTORY]"]
        console().print(*lines, sep="\n")
        return
    if name != ALL and name not in scenes:
        names = (ALL, *scenes)
        raise ArgumentError("name", f"{choices(names)}{nearest(name, names)}", quoted(name))
    wanted = scenes.values() if name == ALL else [scenes[name]]
    files = sorted({file for path in wanted for file in (path, *_files_read(path))})
    targets = [directory / file.relative_to(folder) for file in files]
    _copy(files, targets, directory)
    lines = [f"written: {target}" for target in targets]
    if name != ALL:
        command = "sweep" if "scene" in _read(scenes[name]) else "run"
        lines.append(f"Now try: hingepair {command} {directory / f'{name}.toml'}")
    console().print(*lines, sep="\n")


def _folder() -> Path:
    """Return the folder of the examples: a wheel has them in the package, a checkout beside src."""
    installed = Path(__file__).parents[1] / "examples"
    return installed if installed.is_dir() else Path(__file__).parents[3] / "models"


def _read(path: Path) -> dict[str, Any]:
    import tomllib

    return tomllib.loads(path.read_text(encoding="utf-8"))


def _files_read(path: Path) -> list[Path]:
    """Return the files that a scene or a sweep names: its log, its URDF, the scene of a sweep and what that names."""
    table = _read(path)
    named = (table.get("motion", {}).get("file"), table.get("mechanism", {}).get("urdf"), table.get("scene"))
    files = [(path.parent / file).resolve() for file in named if file is not None]
    return [*files, *(inner for file in files if file.suffix == ".toml" for inner in _files_read(file))]


def _copy(files: Sequence[Path], targets: Sequence[Path], directory: Path) -> None:
    """Copy the files, all or none of them.

    Raises:
        ArgumentError: a target is there already, or cannot be written.
    """
    there = [target for target in targets if target.exists() or target.is_symlink()]
    if there:
        expected = "a directory without files of these names, since nothing is overwritten"
        raise ArgumentError("directory", expected, ", ".join(map(str, there)))
    try:
        for file, target in zip(files, targets, strict=True):
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(file.read_bytes())
    except OSError as error:
        got = f"{str(directory)!r} ({error.strerror or error})"
        raise ArgumentError("directory", "a directory that can be written", got) from None
