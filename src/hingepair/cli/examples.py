"""`hingepair examples`: list and copy the scenes and sweeps that come with the package."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.tables.sheets import align_columns

_ALL = "all"
"""The NAME that stands for every example."""


def examples_command(
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME",
            help=f"Copy this example and the files that it reads; {_ALL}: every example.",
        ),
    ] = None,
    directory: Annotated[
        Path, typer.Argument(metavar="DIRECTORY", help="Where the files go; made if it does not exist.")
    ] = Path(),
) -> None:
    """List the example scenes and sweeps, or copy one.

    An example is copied with the files that it reads. Nothing is overwritten: if one of the files is already there,
    none is copied.
    """
    folder, scenes = _examples_folder(), _files_by_example()
    if name is None:
        rows = [("example", "description"), *((one, _read_toml(path)["title"]) for one, path in scenes.items())]
        lines = [*align_columns(rows, set()), "", "Copy one with: hingepair examples NAME [DIRECTORY]"]
        print(*lines, sep="\n")
        return
    if name != _ALL and name not in scenes:
        names = (_ALL, *scenes)
        raise ArgumentError("name", f"{choices(names)}{nearest(name, names)}", quoted(name))
    wanted = scenes.values() if name == _ALL else [scenes[name]]
    files = sorted({file for path in wanted for file in (path, *_referenced_files(path))})
    targets = [directory / file.relative_to(folder) for file in files]
    _copy_all(files, targets, directory)
    lines = [f"written: {target}" for target in targets]
    if name != _ALL:
        command = "sweep" if "scene" in _read_toml(scenes[name]) else "run"
        lines.append(f"Now try: hingepair {command} {directory / f'{name}.toml'}")
    print(*lines, sep="\n")


def missing_file_hint(path: str) -> str | None:
    """Return a sentence that recommends the command `hingepair examples`, for a path or name that a user typed.
    Return None if the path exists, or if it neither ends in .toml nor resembles the name of an example.
    """
    if os.path.exists(path):
        return None
    typed = f"/{Path(path).with_suffix('').as_posix()}"
    examples = _files_by_example()
    names = [name for name in examples if Path(name).name == Path(typed).name]
    if names:
        # of a scene and a sweep with the same last name, the one whose folder was typed too
        name = max(names, key=lambda name: len(name) if typed.endswith(f"/{name}") else 0)
        return f"hingepair examples {name} copies the worked example of this name with the files that it reads"
    near = nearest(Path(typed).name, examples)
    if Path(path).suffix.lower() != ".toml" and not near:
        return None
    return f"hingepair examples lists and copies worked examples{near}"


def _files_by_example() -> dict[str, Path]:
    """Return the scene or sweep file of each example by its name."""
    folder = _examples_folder()
    return {path.relative_to(folder).with_suffix("").as_posix(): path for path in sorted(folder.rglob("*.toml"))}


def _examples_folder() -> Path:
    """Return the folder of the examples: a wheel has them in the package, a checkout beside src."""
    installed = Path(__file__).parents[1] / "examples"
    return installed if installed.is_dir() else Path(__file__).parents[3] / "models"


def _read_toml(path: Path) -> dict[str, Any]:
    """Return the contents of a TOML file as a dict."""
    import tomllib

    return tomllib.loads(path.read_text(encoding="utf-8"))


def _referenced_files(path: Path) -> list[Path]:
    """Return the files that a scene or sweep refers to: log, URDF, the scene of a sweep, and the files of that."""
    table = _read_toml(path)
    referenced = (
        table.get("motion", {}).get("file"),
        table.get("mechanism", {}).get("urdf"),
        table.get("scene"),
    )
    files = [(path.parent / file).resolve() for file in referenced if file is not None]
    return [*files, *(inner for file in files if file.suffix == ".toml" for inner in _referenced_files(file))]


def _copy_all(files: Sequence[Path], targets: Sequence[Path], directory: Path) -> None:
    """Copy files to targets in `directory`, with the folders that are missing; refuse to overwrite anything."""
    existing = [target for target in targets if target.exists() or target.is_symlink()]
    if existing:
        expected = "a directory without files of these names, since nothing is overwritten"
        raise ArgumentError("directory", expected, ", ".join(map(str, existing)))
    try:
        for file, target in zip(files, targets, strict=True):
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(file.read_bytes())
    except OSError as error:
        got = f"{str(directory)!r} ({error.strerror or error})"
        raise ArgumentError("directory", "a directory that can be written", got) from None
