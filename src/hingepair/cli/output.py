"""What every command does with what it found: tables for any terminal, files, texts that other tools read."""

from __future__ import annotations

import contextlib
import functools
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, TypeVar

import typer
from rich.console import Console

from hingepair.errors import ArgumentError, printable, quoted
from hingepair.numeric.tables import ruled_table
from hingepair.numeric.whole_file import whole_file
from hingepair.pair.results import ROWS
from hingepair.plans.plan import PLANAR, SPATIAL
from hingepair.scenes.scene import SCENE_OUTPUTS

Part = TypeVar("Part")

EXIT_BAD = 2
"""The exit code of what could not be done; 1 means that a check failed."""

EXIT_FAULT = 3
"""That of an error which is none of ours: a traceback follows."""

PICTURES = (".png", ".svg", ".pdf")
"""Endings of figures."""

Outputs = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help=f"Which: of {', '.join(SPATIAL.levels)}; in the plane of {', '.join(PLANAR.levels)}; "
        f"of the coordinates, and in space of the quaternions, {', '.join(SCENE_OUTPUTS)}.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


def file_option(text: str) -> Any:
    """Return the option --out FILE."""
    return typer.Option("--out", "-o", metavar="FILE", help=text)


def console() -> Console:
    """Return where the text of a command goes, line by line as it is."""
    return Console(highlight=False, markup=False, soft_wrap=True)


def print_components(screen: Console, lines: Sequence[Sequence[str]]) -> None:
    """Print a table of components, names and units first, with an empty line below each vector."""
    spaced = [row for line in lines for row in ((line, ()) if line[0].endswith(("_z", "_zz")) else (line,))]
    spaced = spaced[:-1] if not spaced[-1] else spaced
    screen.print("", *ruled_table(spaced, 2, line_width(screen)), "", sep="\n")


def line_width(screen: Console) -> int | None:
    """Return the width of the terminal [characters]; None where the text goes into a file or a pipe."""
    return screen.width if screen.is_terminal else None


def check_picture(option: str, path: Path) -> None:
    """Refuse a figure's file name whose ending names no format."""
    if path.suffix.lower() not in PICTURES:
        raise ArgumentError(option, f"a file name that ends in {', '.join(PICTURES)}", quoted(str(path)))


def save_figure(figure: Any, path: Path, inputs: Iterable[Path], **how: Any) -> None:
    """Write a figure, whole or not at all."""
    with whole_file(path, inputs) as file:
        figure.savefig(file, format=path.suffix.lower()[1:], **how)


def watched(parts: Iterable[Part], samples: int) -> Iterable[Part]:
    """Return the pieces of so many instants, with a progress bar on a terminal where there are many."""
    screen = Console(stderr=True)
    if samples <= ROWS or not screen.is_terminal:
        return parts
    from rich.progress import track

    return track(parts, "computing", -(-samples // ROWS), console=screen, transient=True)


@contextlib.contextmanager
def said_if_stopped(out: Path) -> Iterator[None]:
    """Say that a signal kept a file from being written; what was there before stays."""
    try:
        yield
    except SystemExit:
        print(f"hingepair: stopped; {out} is not written", file=sys.stderr)
        raise


def listed(option: str, text: str | None) -> list[str] | None:
    """Return the names, separated by commas, that an option has; None where it is not given.

    Raises:
        ArgumentError: there is no name.
    """
    names = None if text is None else [name.strip() for name in text.split(",") if name.strip()]
    if names == []:
        raise ArgumentError(option, "names separated by commas", quoted(text))
    return names


def give(text: str, out: Path | None, inputs: Iterable[Path]) -> None:
    """Write a text in UTF-8 to standard output, or to a file that is none of the inputs."""
    if out is None:
        sys.stdout.flush()
        if hasattr(sys.stdout, "buffer"):
            sys.stdout.buffer.write(text.encode())
        else:  # a caller's, made of text
            sys.stdout.write(text)
        return
    with whole_file(out, inputs) as file:
        file.write(text.encode())
    console().print(f"written: {out}")


def behave() -> None:
    """Act as a command should: end at a closed pipe or a signal without a word, and print whatever the terminal can.

    A signal becomes SystemExit, so that a file which is half written is taken away.
    """
    if sys.stdout is None:  # closed by the shell, >&-
        sys.stdout = Path(os.devnull).open("w")  # noqa: SIM115 - for as long as the process runs
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) in {signal.SIG_DFL, signal.default_int_handler}:
            signal.signal(number, _stop)
    warnings.showwarning = functools.partial(_warn, set())
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def printed(run: Callable[[], int]) -> int:
    """Run a command and return its exit code; where its output cannot be printed, say so and return EXIT_BAD."""
    try:
        code = run()
        sys.stdout.flush()
    except OSError as error:
        print(f"hingepair: {error.filename or 'standard output'}: {error.strerror or error}", file=sys.stderr)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left would fail again at the end
        return EXIT_BAD
    return code


def _warn(said: set[str], message: Warning | str, *_: Any, **__: Any) -> None:
    """Print a warning once, from wherever it comes."""
    if str(message) not in said:
        said.add(str(message))
        print(f"hingepair: warning: {printable(str(message))}", file=sys.stderr)


def _stop(number: int, _: FrameType | None) -> None:
    raise SystemExit(128 + number)
