"""The command line `hingepair`: its commands, and how errors are printed."""

from __future__ import annotations

import functools
import sys
import traceback
from collections.abc import Callable
from typing import Annotated, Any

import typer
import typer.core

from hingepair import __version__
from hingepair.cli.bench import bench_command
from hingepair.cli.derive import derive_command
from hingepair.cli.examples import examples_command
from hingepair.cli.fit import fit_command
from hingepair.cli.masses import masses_command
from hingepair.cli.options import with_option_names
from hingepair.cli.output import BAD_INPUT, INTERNAL_ERROR, run_and_flush, set_up_process
from hingepair.cli.pairs import mjcf_command, urdf_command
from hingepair.cli.pictures import plot_command, view_command
from hingepair.cli.robots import robots_command
from hingepair.cli.scenes import check_command, forces_command, run_command
from hingepair.cli.search import search_command
from hingepair.cli.sweep import sweep_command
from hingepair.cli.tolerance import tolerance_command
from hingepair.errors import HingePairError

COMMANDS: dict[str, dict[str, Callable[..., None]]] = {
    "Compute": {
        "run": run_command,
        "forces": forces_command,
        "derive": derive_command,
        "tolerance": tolerance_command,
        "sweep": sweep_command,
        "search": search_command,
        "fit": fit_command,
        "masses": masses_command,
    },
    "Look": {
        "plot": plot_command,
        "view": view_command,
        "examples": examples_command,
        "robots": robots_command,
    },
    "Exchange": {
        "urdf": urdf_command,
        "mjcf": mjcf_command,
    },
    "Measure": {
        "check": check_command,
        "bench": bench_command,
    },
}
"""The commands by the names that users type, under the headings and in the order of --help."""


class _GroupedCommands(typer.core.TyperGroup):
    """The command line, whose help lists the commands under the headings of `COMMANDS`."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002, Typer hands it over
        """Write a section for each heading."""
        width = max(map(len, self.commands))
        rows: dict[str, list[tuple[str, str]]] = {}
        for name, command in self.commands.items():
            text = command.get_short_help_str(formatter.width - width - 6)
            rows.setdefault(getattr(command, "rich_help_panel", "Commands"), []).append((name.ljust(width), text))
        for heading, lines in rows.items():
            with formatter.section(heading):
                formatter.write_dl(lines)


app = typer.Typer(
    name="hingepair",
    cls=_GroupedCommands,
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

for heading, commands in COMMANDS.items():
    for command_name, command in commands.items():
        app.command(command_name, rich_help_panel=heading)(with_option_names(command))


def main() -> None:
    """Run the command line; an error of the user's input is one line on standard error, with exit code 2."""
    set_up_process()
    sys.exit(run_and_flush(_run_app))


def _run_app() -> int:
    """Run the command that the process's arguments name, and return the exit code."""
    try:
        _command_tree()()
    except HingePairError as error:
        print("\n".join((f"hingepair: {error}", *getattr(error, "__notes__", ()))), file=sys.stderr)
        return BAD_INPUT
    except MemoryError as error:
        print(f"hingepair: not enough memory ({error})", file=sys.stderr)
        return BAD_INPUT
    except OSError:
        raise
    except Exception:
        traceback.print_exc()
        return INTERNAL_ERROR
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else 0
    return 0


@functools.cache  # its signatures are read once, however many commands a process runs, as the tests do
def _command_tree() -> Callable[[], object]:
    """Return the command line as one callable that reads `sys.argv`, runs the command and exits."""
    return typer.main.get_command(app)


@app.callback(invoke_without_command=True)
def _handle_version_option(
    show_version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    """Print the version of hingepair and exit, if --version is given; otherwise let the command run."""
    if show_version:
        print(f"hingepair {__version__}")
        raise typer.Exit
