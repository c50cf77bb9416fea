"""The process of a command: signals, streams, warnings and exit codes."""

from __future__ import annotations

import functools
import os
import signal
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

from hingepair.errors import printable

BAD_INPUT = 2
"""Exit code of bad input and of output that cannot be written; 1 means that a check failed."""

INTERNAL_ERROR = 3
"""Exit code of an internal error, whose traceback is printed."""


def set_up_process() -> None:
    """Set up the signal handlers, output streams and warnings of the process. A signal raises SystemExit, a closed
    pipe ends the process silently, characters that the terminal lacks are escaped, and each warning is printed once.

    SystemExit lets a partly written file be deleted.
    """
    if sys.stdout is None:  # closed by the shell, >&-
        sys.stdout = Path(os.devnull).open("w")  # noqa: SIM115 - for as long as the process runs
    if sys.stderr is None:
        sys.stderr = Path(os.devnull).open("w")  # noqa: SIM115
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
    """Return the exit code of `run_command` after flushing standard output; print an OSError, such as of a full disk,
    and return BAD_INPUT.
    """
    try:
        code = run_command()
        sys.stdout.flush()
    except OSError as error:
        print(f"hingepair: {error.filename or 'standard output'}: {error.strerror or error}", file=sys.stderr)
        os.dup2(
            os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno()
        )  # the text in the buffer would fail again at exit
        return BAD_INPUT
    return code


def _print_new_warning(printed_texts: set[str], message: Warning | str, *_: Any, **__: Any) -> None:
    """Print a warning to standard error and add it to `printed_texts`, unless it is already there."""
    if str(message) not in printed_texts:
        printed_texts.add(str(message))
        print(f"hingepair: warning: {printable(str(message))}", file=sys.stderr)


def _exit_on_signal(number: int, _: FrameType | None) -> None:
    """Raise SystemExit with the exit code of a signal, 128 plus its number."""
    raise SystemExit(128 + number)
