"""Output of the commands: tables, files, texts and figures, warnings, and the end by a signal."""

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
from hingepair.pair.results import ROWS_PER_BLOCK
from hingepair.plans.plan import PLANAR_MOTION, SPATIAL_MOTION
from hingepair.scenes.scene import COORDINATE_AND_QUATERNION_OUTPUT_NAMES

Piece = TypeVar("Piece")

BAD_INPUT_EXIT_CODE = 2
"""Of bad input and of output that cannot be written; 1 means that a check failed."""

INTERNAL_ERROR_EXIT_CODE = 3
"""Of an internal error, whose traceback is printed."""

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
"""File name suffixes of figures."""

OutputsOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help=f"Outputs, separated by commas: {', '.join(SPATIAL_MOTION.levels)}; of a planar pair: "
        f"{', '.join(PLANAR_MOTION.levels)}; coordinates and, unless planar, quaternions: "
        f"{', '.join(COORDINATE_AND_QUATERNION_OUTPUT_NAMES)}.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


def out_option(text: str) -> Any:
    """Return the option --out FILE."""
    return typer.Option("--out", "-o", metavar="FILE", help=text)


def make_console() -> Console:
    """Return a console that prints text to standard output without markup and without wrapping lines."""
    return Console(highlight=False, markup=False, soft_wrap=True)


def print_component_table(screen: Console, lines: Sequence[Sequence[str]]) -> None:
    """Print a table of components, with an empty line below each vector.

    Args:
        screen: where it is printed.
        lines: heading and rows; the first two columns are names and units.
    """
    spaced = [row for line in lines for row in ((line, ()) if line[0].endswith(("_z", "_zz")) else (line,))]
    spaced = spaced[:-1] if not spaced[-1] else spaced
    screen.print("", *ruled_table(spaced, 2, terminal_width(screen)), "", sep="\n")


def terminal_width(screen: Console) -> int | None:
    """Return the width of the terminal [characters]; None if the text goes into a file or a pipe."""
    return screen.width if screen.is_terminal else None


def check_picture_suffix(option: str, path: Path) -> None:
    """Raise an error if the suffix of a figure's file name names no format of figures."""
    if path.suffix.lower() not in PICTURE_SUFFIXES:
        raise ArgumentError(option, f"a file name that ends in {', '.join(PICTURE_SUFFIXES)}", quoted(str(path)))


def save_figure(figure: Any, path: Path, inputs: Iterable[Path], **options: Any) -> None:
    """Write a figure to a file, completely or not at all."""
    with whole_file(path, inputs) as file:
        figure.savefig(file, format=path.suffix.lower()[1:], **options)


def with_progress_bar(parts: Iterable[Piece], num_instants: int) -> Iterable[Piece]:
    """Return an iterable of the same pieces that shows a progress bar on a terminal, if there are several.

    Args:
        parts: pieces of ROWS_PER_BLOCK instants each.
        num_instants: number of instants of all pieces together.
    """
    screen = Console(stderr=True)
    if num_instants <= ROWS_PER_BLOCK or not screen.is_terminal:
        return parts
    from rich.progress import track

    return track(parts, "computing", -(-num_instants // ROWS_PER_BLOCK), console=screen, transient=True)


@contextlib.contextmanager
def report_if_stopped(out: Path) -> Iterator[None]:
    """Return a context manager that prints a message if a signal stops the process before `out` is written."""
    try:
        yield
    except SystemExit:
        print(f"hingepair: stopped by a signal; {out} is not written", file=sys.stderr)
        raise


def split_names(option: str, text: str | None) -> list[str] | None:
    """Split the value of an option into names at its commas; return None if the option is not given.

    Raises:
        ArgumentError: the value contains no name.
    """
    names = None if text is None else [name.strip() for name in text.split(",") if name.strip()]
    if names == []:
        raise ArgumentError(option, "names separated by commas", quoted(text))
    return names


def write_text(text: str, out: Path | None, inputs: Iterable[Path]) -> None:
    """Write a text to the file `out`, which must be none of `inputs`, or to standard output if it is None."""
    if out is None:
        sys.stdout.flush()
        if hasattr(sys.stdout, "buffer"):
            sys.stdout.buffer.write(text.encode())
        else:  # a text stream that the caller has put in place
            sys.stdout.write(text)
        return
    with whole_file(out, inputs) as file:
        file.write(text.encode())
    make_console().print(f"written: {out}")


def set_up_process() -> None:
    """Set up signals, output streams and warnings of the process: a signal ends it silently, as SystemExit.

    SystemExit lets a partly written file be deleted. A closed pipe ends the process silently, characters that the
    terminal lacks are escaped, and each warning is printed once.
    """
    if sys.stdout is None:  # closed by the shell, >&-
        sys.stdout = Path(os.devnull).open("w")  # noqa: SIM115 - for as long as the process runs
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) in {signal.SIG_DFL, signal.default_int_handler}:
            signal.signal(number, _exit_on_signal)
    warnings.showwarning = functools.partial(_print_new_warning, set())
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def run_and_flush(run_command: Callable[[], int]) -> int:
    """Run a command and flush its output; return its exit code, or that of bad input if printing fails."""
    try:
        code = run_command()
        sys.stdout.flush()
    except OSError as error:
        print(f"hingepair: {error.filename or 'standard output'}: {error.strerror or error}", file=sys.stderr)
        os.dup2(
            os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno()
        )  # the text in the buffer would fail again at exit
        return BAD_INPUT_EXIT_CODE
    return code


def _print_new_warning(printed_texts: set[str], message: Warning | str, *_: Any, **__: Any) -> None:
    """Print a warning and add its text to `printed_texts`, unless the text is there already."""
    if str(message) not in printed_texts:
        printed_texts.add(str(message))
        print(f"hingepair: warning: {printable(str(message))}", file=sys.stderr)


def _exit_on_signal(number: int, _: FrameType | None) -> None:
    """Raise SystemExit with the exit code of a signal, 128 plus its number."""
    raise SystemExit(128 + number)
