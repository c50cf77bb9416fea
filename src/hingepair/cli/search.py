"""`hingepair search`: numbers of a scene for which results have wanted values."""

from __future__ import annotations

from typing import Annotated

import typer

from hingepair.cli.output import JsonOption, print_title
from hingepair.cli.scenes import SceneArgument
from hingepair.errors import ArgumentError, quoted
from hingepair.scenes.variants.search import Range, search
from hingepair.tables.sheets import json_text


def search_command(
    scene_file: SceneArgument,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="KEY[=LOW:HIGH]",
            help="Number of the scene to vary, such as dynamics.psi.damping=0.1:10, in the unit of the scene file; "
            "may be given several times.",
        ),
    ],
    until: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CONDITION",
            help='Condition, such as "psi_t_below(0.01) = 5" or "psid_min >= -0.2"; may be given several times.',
        ),
    ] = None,
    minimize: Annotated[
        str | None, typer.Option(metavar="RESULT", help="Result to be smallest, such as hinge_torque_absmax.")
    ] = None,
    maximize: Annotated[str | None, typer.Option(metavar="RESULT", help="Result to be largest.")] = None,
    units: Annotated[
        str | None,
        typer.Option(metavar="UNITS", help='Units of results and conditions, such as "deg, mm". Default: SI units.'),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find numbers of a scene for which results have wanted values.

    A result is a component of an output and a reduction: psi_last, R2_z_max, hinge_torque_absmax, or the time at a
    level: psi_t_below(0.01), psi_t_settled(0.02). --minimize and --maximize need a range for each number. Exit code
    1: no such numbers were found; the closest are printed.
    """
    found = search(
        scene_file, dict(map(_read_range, vary)), until or (), minimize=minimize, maximize=maximize, units=units
    )
    if as_json:
        facts = {
            field: getattr(found, field)
            for field in ("values", "start", "results", "units", "conditions", "notes", "ok", "evaluations")
        }
        print(json_text(facts))
    else:
        print_title(found.scene.title)
        print(found)
    if not found.ok:
        raise typer.Exit(1)


def _read_range(text: str) -> tuple[str, Range]:
    """Return the key and the range that KEY or KEY=LOW:HIGH gives."""
    key, equals, ends = text.partition("=")
    if not equals:
        return key.strip(), None
    try:
        low, high = map(float, ends.split(":"))
    except ValueError:
        raise ArgumentError(
            "--vary", "KEY or KEY=LOW:HIGH, such as dynamics.psi.damping=0.1:10", quoted(text)
        ) from None
    return key.strip(), (low, high)
