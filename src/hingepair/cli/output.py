"""Output of the commands: JSON or lines of text, tables, and files."""

from __future__ import annotations

import itertools
import os
import re
import shutil
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hingepair.errors import ArgumentError, printable, quoted
from hingepair.tables.sheets import json_text, ruled_table
from hingepair.tables.whole_file import check_writable, whole_file


def show(as_json: bool, facts: Mapping[str, Any], *lines: object) -> None:
    """Print facts as JSON, or lines of text, without what terminals obey."""
    print(
        json_text(facts) if as_json else "\n".join(printable(one) for line in lines for one in str(line).split("\n"))
    )


def table_lines(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table of components whose first row is the heading and whose first two columns are names
    and units, with an empty line between vectors.
    """
    heading, *others = rows
    spaced: list[Sequence[str]] = [heading]
    for row, following in itertools.zip_longest(others, others[1:]):
        spaced.append(row)
        if following is not None and _vector_of(following[0]) != _vector_of(row[0]):
            spaced.append(())
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    return ["", *ruled_table(spaced, 2, width), ""]


def _vector_of(component: str) -> str:
    """Return the vector or matrix of a component; "" if there is none.

    >>> _vector_of("R2_x - 691607"), _vector_of("|v2|"), _vector_of("tau_elbow")
    ('R2', 'v2', '')
    """
    match = re.match(r"(.+)_[xyz]{1,2}(?= |$)|\|(.+)\|", component)
    return match[1] or match[2] if match else ""


def check_output(path: Path | None, inputs: Iterable[str | os.PathLike[str]], endings: Sequence[str] = ()) -> None:
    """Raise an ArgumentError if `path`, unless it is None, has another ending, is one of `inputs`, or cannot be
    written. Commands call this before they compute.
    """
    if path is not None:
        if endings and path.suffix.lower() not in endings:
            raise ArgumentError("path", f"a file name that ends in {', '.join(endings)}", quoted(str(path)))
        check_writable(path, inputs)


def new_file(name: str) -> Path:
    """Return a path in the current folder; refuse one that exists."""
    path = Path(name)
    if path.exists() or path.is_symlink():
        wanted = f"another file name, or --out {name}, which overwrites it"
        raise ArgumentError("path", wanted, f"{name!r}, which exists")
    return path


def save_figure(figure: Any, path: Path, inputs: Iterable[Path]) -> None:
    """Write a Matplotlib figure to a file in the format of its suffix, completely or not at all."""
    with whole_file(path, inputs) as file:
        figure.savefig(file, format=path.suffix.lower()[1:], dpi=110)


def write_text(text: str, out: Path | None, inputs: Iterable[Path], as_json: bool = False) -> None:
    """Write text to the file `out`, completely or not at all, and say so; to standard output if `out` is None, in
    JSON if `as_json` is true.
    """
    if out is not None:
        with whole_file(out, inputs) as file:
            file.write(text.encode())
        show(as_json, {"file": str(out)}, f"written: {out}")
    elif as_json:
        show(as_json, {"file": None, "text": text})
    elif hasattr(sys.stdout, "buffer"):  # UTF-8, whatever the terminal takes
        sys.stdout.flush()
        sys.stdout.buffer.write(text.encode())
    else:  # a text stream that the caller has put in place
        sys.stdout.write(text)
