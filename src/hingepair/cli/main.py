"""The command line `hingepair`: its commands, and what an error of ours looks like."""

from __future__ import annotations

import sys
import traceback
from typing import Annotated

import typer

from hingepair import __version__
from hingepair.cli.bench import app as bench_app
from hingepair.cli.derive import derive
from hingepair.cli.examples import examples
from hingepair.cli.fit import fit_files
from hingepair.cli.options import naming_options
from hingepair.cli.output import EXIT_BAD, EXIT_FAULT, behave, printed
from hingepair.cli.pairs import mjcf, urdf
from hingepair.cli.pictures import plot, view
from hingepair.cli.robots import robots
from hingepair.cli.scenes import check, forces, run
from hingepair.cli.sweep import sweep
from hingepair.cli.tolerance import tolerance
from hingepair.errors import HingePairError

app = typer.Typer(
    name="hingepair",
    help="Two rigid bodies joined by a hinge: everything about body 2 from the motion of body 1 and the hinge angle.",
    epilog="Exit codes: 0 ok, 1 a check failed, 2 bad input or output that cannot be written, 3 a fault of ours, "
    "128 + n stopped by signal n: 130 by Ctrl-C.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # of rich boxes: brackets are taken for markup, paragraphs keep the source's lines
    context_settings={"max_content_width": 110},
    pretty_exceptions_enable=False,
)

for command in (run, check, forces, derive, urdf, mjcf, plot, view, robots, tolerance, sweep, examples):
    app.command()(naming_options(command))
app.command("fit")(naming_options(fit_files))
app.add_typer(bench_app, name="bench")


def main() -> None:
    """Run the command line; an error of ours is one line on standard error and exit code 2."""
    behave()
    sys.exit(printed(_run))


def _run() -> int:
    try:
        app()
    except HingePairError as error:
        print("\n".join((f"hingepair: {error}", *getattr(error, "__notes__", ()))), file=sys.stderr)
        return EXIT_BAD
    except MemoryError as error:
        print(f"hingepair: not enough memory ({error})", file=sys.stderr)
        return EXIT_BAD
    except OSError:
        raise
    except Exception:
        traceback.print_exc()
        return EXIT_FAULT
    except SystemExit as done:
        return done.code if isinstance(done.code, int) else 0
    return 0


@app.callback(invoke_without_command=True)
def _options(
    show_version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if show_version:
        print(f"hingepair {__version__}")
        raise typer.Exit
