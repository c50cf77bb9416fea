"""Options and arguments that several commands have, and errors that name them as users type them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.core

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.results import RESULT_FILE_SUFFIXES
from hingepair.plans.pairs import PLANE, SPACE
from hingepair.scenes.assembly import FURTHER_OUTPUTS

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
"""File name suffixes of figures."""

SceneArgument = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).")]
SourceArgument = Annotated[
    str, typer.Argument(metavar="SCENE", help="Scene file (TOML); or a robot, by its name or URDF file.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
OutputsOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAMES",
        help=f"Outputs, separated by commas: {', '.join(SPACE.levels)}; of a planar pair: {', '.join(PLANE.levels)}; "
        f"coordinates and, unless planar, quaternions: {', '.join(FURTHER_OUTPUTS)}; of a point, here tip: tip, "
        "tip_v, tip_a.",
    ),
]
UnitsOption = Annotated[
    str | None,
    typer.Option(
        metavar="UNITS",
        help='Units in place of SI units, such as "deg, mm"; also km/h, g, rpm, ms, N mm. A unit of lengths or '
        "angles stands for their rates too. Default: [outputs] units of the scene, otherwise SI units.",
    ),
]
ColumnOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=COLUMN[:UNIT]",
        help="Column of another program, such as t=Zeit or x1=Ost:mm; may be repeated. Unknown columns are then not "
        "read.",
    ),
]
GravityOption = Annotated[
    str | None,
    typer.Option(metavar="X,Y,Z", help="Acceleration of gravity in world axes [m/s^2]; X,Y of a planar pair."),
]


def out_option(text: str) -> Any:
    """Return the Typer option --out FILE (-o), with `text` as its help."""
    return typer.Option("--out", "-o", metavar="FILE", help=text)


ResultsOption = Annotated[Path | None, out_option(f"Write all instants to FILE ({', '.join(RESULT_FILE_SUFFIXES)}).")]
TextFileOption = Annotated[Path | None, out_option("Write to FILE instead of standard output.")]

# Parameters of commands whose values become arguments of the library, by the argument's name in errors.
_PARAMETERS = {
    **{"path": "out", "sources": "files", "points": "tolerance", "path_or_text": "source", "robot": "source"},
    "values: key": "vary",
}


class Command(typer.core.TyperCommand):
    """A command whose errors name options as users type them, `--gravity` in place of `gravity`."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except ArgumentError as error:
            typed: dict[str | None, Any] = {
                one.name: next((text for text in one.opts if text.startswith("--")), getattr(one, "metavar", None))
                for one in self.params
            }
            name = error.name if error.name in typed else _PARAMETERS.get(error.name)
            raise error.renamed(typed.get(name) or error.name) from None


def split_names(option: str, text: str | None) -> list[str] | None:
    """Return the names in the value of an option, split at commas outside of double quotes; None for None."""
    import csv

    if text is None:
        return None
    names = [name.strip() for name in next(csv.reader([text], skipinitialspace=True), []) if name.strip()]
    if not names:
        raise ArgumentError(option, "names separated by commas", quoted(text))
    return names


def parse_columns(options: Sequence[str] | None) -> dict[str, dict[str, str]]:
    """Return names and units of columns by the names that they have here, from the values of the option --column.

    >>> parse_columns(["t=Zeit", "x1=Ost:mm"])
    {'t': {'name': 'Zeit'}, 'x1': {'name': 'Ost', 'unit': 'mm'}}
    """
    columns = {}
    for option in options or ():
        name, _, rest = option.partition("=")
        column, colon, unit = rest.rpartition(":") if ":" in rest else (rest, "", "")
        if not (name.strip() and column.strip()):
            raise ArgumentError("column", "such as t=Zeit or x1=Ost:mm", quoted(option))
        columns[name.strip()] = {"name": column.strip()} | ({"unit": unit.strip()} if colon else {})
    return columns


def parse_gravity(text: str | None) -> tuple[float, ...] | None:
    """Return the numbers in the value of --gravity; None for None."""
    try:
        return None if text is None else tuple(map(float, text.split(",")))
    except ValueError:
        raise ArgumentError("gravity", "numbers X,Y,Z, of a planar pair X,Y", quoted(text)) from None
