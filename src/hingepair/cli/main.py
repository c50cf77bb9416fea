"""The command line `hingepair`: its commands, and how errors are printed."""

from __future__ import annotations

import functools
import json
import os
import signal
import sys
import traceback
import warnings
from importlib import import_module
from types import FrameType
from typing import Annotated, Any

import typer
import typer.core

from hingepair import __version__
from hingepair.errors import ArgumentError, HingePairError, printable, shorten

BAD_INPUT = 2
"""Exit code of bad input and of output that cannot be written; 1 means that a check failed."""
INTERNAL_ERROR = 3
"""Exit code of an internal error, whose traceback is printed."""

COMMANDS = {
    "Compute": {
        "run": ("scenes", "Compute and print the motion of body 2 or of a mechanism."),
        "forces": ("scenes", "Compute and print the forces that a motion requires."),
        "derive": ("derive", "Derive closed formulas of a motion, and print or write them."),
        "tolerance": ("variants", "Show how manufacturing tolerances affect the pose of body 2, and points."),
        "sweep": ("variants", "Compute all variants of a sweep, and write the results."),
        "search": ("variants", "Find numbers of a scene for which results have wanted values."),
        "fit": ("fit", "Fit a hinge to the recorded motion of two bodies."),
        "masses": ("masses", "Fit the masses of a robot, and friction, to a recorded motion and its torques."),
    },
    "Look": {
        "plot": ("pictures", "Draw the motion of a scene over time and in space."),
        "view": ("pictures", "Write a web page that shows a pair or a robot in motion."),
        "examples": ("examples", "List the example scenes and sweeps, or copy one."),
        "robots": ("robots", "List the example robots, or the joints of a robot."),
    },
    "Exchange": {
        "urdf": ("models", "Write a pair, or the mechanism of a scene, as a URDF file."),
        "mjcf": ("models", "Write a pair, or the mechanism of a scene, as a MuJoCo model (MJCF)."),
    },
    "Measure": {
        "check": ("scenes", "Compare a scene or a robot with Pinocchio, and print a report."),
        "bench": ("bench", "Measure forward kinematics of a pair: run time and error."),
    },
}
"""Module and first sentence of help of the commands, by the names that users type, under the headings of --help."""
_COMMANDS = {name: own for commands in COMMANDS.values() for name, own in commands.items()}


class _Commands(typer.core.TyperGroup):
    """The commands, imported when they are run; help lists them under the headings of `COMMANDS`."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = dict.fromkeys(_COMMANDS)  # type: ignore[assignment]  # names alone, for suggestions

    def get_command(self, ctx: Any, cmd_name: str) -> Any:  # noqa: ARG002
        """Return a command; None if there is none of this name."""
        return _command(cmd_name) if cmd_name in _COMMANDS else None

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write a section for each heading."""
        width = max(map(len, _COMMANDS))
        for heading, commands in COMMANDS.items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(width), text.rstrip(".")) for name, (_, text) in commands.items()])


@functools.cache
def _command(name: str) -> Any:
    """Return a command; its signature is read once."""
    from hingepair.cli.options import Command

    function = getattr(import_module(f"hingepair.cli.{_COMMANDS[name][0]}"), f"{name}_command")
    alone = typer.Typer(add_completion=False, rich_markup_mode=None, context_settings={"max_content_width": 110})
    alone.command(name, cls=Command)(function)
    return typer.main.get_command(alone)


app = typer.Typer(
    name="hingepair",
    cls=_Commands,
    help="Motion and forces of bodies joined by hinges: one hinge, or a whole robot. "
    "Most commands take a scene file (TOML); hingepair examples lists some to start from.",
    epilog="Exit codes: 0 ok, 1 a check failed, 2 bad input or output that cannot be written, 3 an internal error of "
    "hingepair, 128 + n stopped by signal n (130 by Ctrl-C).",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # rich would take brackets for markup and keep the line breaks of the source
    context_settings={"max_content_width": 110},
    pretty_exceptions_enable=False,
)


@app.callback(invoke_without_command=True)
def _handle_version_option(
    show_version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    """Print the version of hingepair and exit, if --version is given; otherwise let the command run."""
    if show_version:
        print(f"hingepair {__version__}")
        raise typer.Exit


def main() -> None:
    """Run the command line; an error of the user's input is one line on standard error, with exit code 2."""
    set_up_process()
    try:
        code = _run_app()
        sys.stdout.flush()
    except OSError as error:  # such as of a full disk
        print(f"hingepair: {error.filename or 'standard output'}: {error.strerror or error}", file=sys.stderr)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left would fail again at exit
        code = BAD_INPUT
    sys.exit(code)


def _run_app() -> int:
    """Run the command that the process's arguments name, and return the exit code."""
    try:
        return app(standalone_mode=False) or 0
    except HingePairError as error:
        return _failed(f"hingepair: {error}", error)
    except MemoryError as error:
        return _failed(f"hingepair: not enough memory ({error})", error)
    except OSError:
        raise
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else 0
    except Exception as error:
        if hasattr(error, "show"):  # an option or argument that is wrong or missing, which Typer tells
            error.show()
            return _failed("", error)
        traceback.print_exc()
        return _failed("", error, INTERNAL_ERROR)


def _failed(text: str, error: Exception, code: int = BAD_INPUT) -> int:
    """Print why a command failed: text on standard error and, with --json, an object on standard output. Return the
    exit code.
    """
    notes = getattr(error, "__notes__", ())
    if text:
        print("\n".join((text, *notes)), file=sys.stderr)
    if "--json" in sys.argv:
        message = str(error) or getattr(error, "message", "")
        facts = {"type": type(error).__name__, "message": message, "notes": list(notes)}
        if isinstance(error, ArgumentError):
            facts |= {"name": error.name, "expected": error.expected, "got": shorten(error.got), "loc": error.loc}
        print(json.dumps({"error": facts}, indent=2))
    return code


def set_up_process() -> None:
    """Set up the process: signals raise SystemExit, so that partly written files are deleted; a closed pipe ends it
    silently; characters that the terminal lacks are escaped; each warning is printed once.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the shell, >&-
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 - for as long as the process runs
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) in {signal.SIG_DFL, signal.default_int_handler}:
            signal.signal(number, _exit_on_signal)
    printed: set[str] = set()

    def print_new_warning(message: Warning | str, *_: Any, **__: Any) -> None:
        if str(message) not in printed:
            printed.add(str(message))
            print(f"hingepair: warning: {printable(str(message))}", file=sys.stderr)

    warnings.showwarning = print_new_warning
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _exit_on_signal(number: int, _: FrameType | None) -> None:
    """Raise SystemExit with the exit code of a signal, 128 plus its number."""
    raise SystemExit(128 + number)
