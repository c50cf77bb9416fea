"""Output of the commands: tables, files, texts and figures, warnings, and the end by a signal."""

from __future__ import annotations

import contextlib
import csv
import itertools
import os
import re
import shutil
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from hingepair.errors import ArgumentError, printable, quoted
from hingepair.mechanism.results import RESULT_ROWS_PER_BLOCK
from hingepair.plans.pairs import PLANE, SPACE
from hingepair.scenes.subjects.pair import FURTHER_OUTPUTS
from hingepair.tables.sheets import ruled_table
from hingepair.tables.whole_file import check_writable, whole_file

Piece = TypeVar("Piece")

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
"""File name suffixes of figures."""

OutputsOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help=f"Outputs, separated by commas: {', '.join(SPACE.levels)}; of a planar pair: "
        f"{', '.join(PLANE.levels)}; coordinates and, unless planar, quaternions: "
        f"{', '.join(FURTHER_OUTPUTS)}; of a point, here tip: tip, tip_v, tip_a.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


def out_option(text: str) -> Any:
    """Return the Typer option --out FILE (-o), with `text` as its help."""
    return typer.Option("--out", "-o", metavar="FILE", help=text)


UnitsOption = Annotated[
    str | None,
    typer.Option(
        metavar="UNITS",
        help='Units in place of SI units, such as "deg, mm"; also km/h, g, rpm, ms, N mm. A unit of lengths or '
        "angles stands for their rates too. Default: [outputs] units of the scene, otherwise SI units.",
    ),
]


def print_component_table(lines: Sequence[Sequence[str]]) -> None:
    """Print a table of components, with an empty line between vectors. The first of the rows is the heading; the
    first two columns are names and units.
    """
    heading, *rows = lines
    spaced: list[Sequence[str]] = [heading]
    for row, following in itertools.zip_longest(rows, rows[1:]):
        spaced.append(row)
        if following is not None and _vector_of(following[0]) != _vector_of(row[0]):
            spaced.append(())
    print("", *ruled_table(spaced, 2, terminal_width()), "", sep="\n")


def _vector_of(component: str) -> str:
    """Return the vector or matrix of a component; "" if there is none.

    >>> _vector_of("R2_x - 691607"), _vector_of("|v2|"), _vector_of("tau_elbow")
    ('R2', 'v2', '')
    """
    match = re.match(r"(.+)_[xyz]{1,2}(?= |$)|\|(.+)\|", component)
    return match[1] or match[2] if match else ""


def print_title(title: str) -> None:
    """Print a title, in bold letters on a terminal; nothing if it is empty."""
    if title:
        text = printable(title)
        print(f"\033[1m{text}\033[0m" if sys.stdout.isatty() else text)


def terminal_width() -> int | None:
    """Return the width of the terminal [characters]; None if the output goes into a file or a pipe."""
    return shutil.get_terminal_size().columns if sys.stdout.isatty() else None


def check_picture_suffix(option: str, path: Path) -> None:
    """Raise an ArgumentError that names `option` unless a path ends in one of PICTURE_SUFFIXES."""
    if path.suffix.lower() not in PICTURE_SUFFIXES:
        raise ArgumentError(option, f"a file name that ends in {', '.join(PICTURE_SUFFIXES)}", quoted(str(path)))


def check_output(option: str, path: Path | None, inputs: Iterable[str | os.PathLike[str]] = ()) -> None:
    """Raise an ArgumentError that names `option` if no file can be written to `path` (None: nothing is checked) or if
    it is one of `inputs`. Commands call this before they compute.
    """
    if path is not None:
        with naming_option(option):
            check_writable(path, inputs)


@contextlib.contextmanager
def naming_option(option: str) -> Iterator[None]:
    """Make ArgumentErrors of the block that are about `path` name an option, such as --plot, instead."""
    try:
        yield
    except ArgumentError as error:
        raise error.renamed(option) if error.name == "path" else error from None


def save_figure(option: str, figure: Any, path: Path, inputs: Iterable[Path], **settings: Any) -> None:
    """Write a Matplotlib figure to a file in the format of its suffix, completely or not at all; `settings` are those
    of `savefig`.
    """
    with naming_option(option), whole_file(path, inputs) as file:
        figure.savefig(file, format=path.suffix.lower()[1:], **settings)


def with_progress_bar(parts: Iterable[Piece], num_instants: int) -> Iterator[Piece]:
    """Yield the blocks of a motion, with a progress bar if there are several and standard error is a terminal."""
    count = -(-num_instants // RESULT_ROWS_PER_BLOCK)
    if count == 1 or not sys.stderr.isatty():
        yield from parts
        return
    with typer.progressbar(parts, count, "computing", file=sys.stderr) as bar:
        yield from bar


@contextlib.contextmanager
def report_if_stopped(sentence: str) -> Iterator[None]:
    """Print a sentence to standard error if a signal stops the block."""
    try:
        yield
    except SystemExit:
        print(f"hingepair: {sentence}", file=sys.stderr)
        raise


def split_names(option: str, text: str | None) -> list[str] | None:
    """Return the names in the value of an option, split at commas outside of double quotes; None for None."""
    cells = [] if text is None else next(csv.reader([text], skipinitialspace=True), [])
    names = None if text is None else [name.strip() for name in cells if name.strip()]
    if names == []:
        raise ArgumentError(option, "names separated by commas", quoted(text))
    return names


def write_text(text: str, out: Path | None, inputs: Iterable[Path]) -> None:
    """Write text to the file `out`, completely or not at all, and say so; to standard output if `out` is None."""
    if out is None:
        sys.stdout.flush()
        if hasattr(sys.stdout, "buffer"):
            sys.stdout.buffer.write(text.encode())
        else:  # a text stream that the caller has put in place
            sys.stdout.write(text)
        return
    with whole_file(out, inputs) as file:
        file.write(text.encode())
    print(f"written: {out}")
