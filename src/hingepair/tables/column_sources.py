"""Columns that have names and units of another program, and how they become ours."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, choices, nearest, nearest_name, quoted
from hingepair.tables.units import SCALES, heading_unit

_COMPASS: Final = "compass"  # unit of headings in degrees, clockwise from north


class ColumnSource(NamedTuple):
    """Where a quantity stands in a log that has names and units of its own."""

    column: str  # name in the log
    scale: float = 1.0  # factor to SI units
    compass: bool = False  # whether it is a heading in degrees, clockwise from north

    def converted(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values in SI units; a heading as an angle from east (x) towards north (y)."""
        if self.compass:
            return np.asarray(np.radians(90.0 - values))
        return values if self.scale == 1.0 else np.asarray(values * self.scale)


def read_column_sources(
    entries: Any,
    names: Collection[str],
    unit_of: Callable[[str], str],
    stated_units: Mapping[str, str],
    headings: Collection[str] = (),
) -> dict[str, ColumnSource]:
    """Return where quantities stand, by their names.

    Args:
        entries: for each quantity the name of its column, or a dict of name and unit.
        names: names that quantities may have.
        unit_of: function from such a name to its SI unit.
        stated_units: units that columns themselves state, by their names.
        headings: names of angles that turn about z, whose unit may be that of a compass.

    Raises:
        ArgumentError: an entry cannot be used; `name` is `columns` or such as `columns.psi.unit`.
    """
    if not isinstance(entries, Mapping):
        expected = 'a table such as { t = "Time", psi = { name = "Angle", unit = "deg" } }'
        raise ArgumentError("columns", expected, quoted(entries))
    sources = {}
    for name, entry in entries.items():
        if name not in names:
            expected = f"{choices(tuple(names))}{nearest(str(name), tuple(names))}"
            raise ArgumentError(f"columns.{name}", expected, "no such name")
        given: Any = {"name": entry} if isinstance(entry, str) else entry
        if (
            not isinstance(given, Mapping)
            or not {*given} <= {"name", "unit"}
            or not all(isinstance(value, str) for value in given.values())
        ):
            expected = 'the name of a column, or { name = "Angle", unit = "deg" }'
            raise ArgumentError(f"columns.{name}", expected, quoted(entry))
        own = unit_of(name)
        column = str(given.get("name", name))
        unit = str(given.get("unit") or stated_units.get(column) or heading_unit(column) or own)
        if unit == _COMPASS and name in headings:
            sources[name] = ColumnSource(column, compass=True)
            continue
        sign = -1.0 if unit.startswith("-") else 1.0
        known = {own: 1.0, **SCALES.get(own, {})}
        if unit.removeprefix("-") not in known:
            units = (*known, _COMPASS) if name in headings else tuple(known)
            expected = f"{choices(units)}, or one of them with a - before it"
            if unit == _COMPASS and own == "rad":
                near = nearest_name(name, headings)
                expected += ", since only a turn about z is a heading" + f", such as {near}" * bool(near)
            raise ArgumentError(f"columns.{name}.unit", expected, quoted(unit))
        sources[name] = ColumnSource(column, sign * known[unit.removeprefix("-")])
    return sources


def check_once(names: Sequence[str], sources: Mapping[str, ColumnSource]) -> None:
    """Refuse columns that are to be read, of these `names`, if one comes twice, also under another name.

    Raises:
        ArgumentError: two columns have one name, or a quantity has a source and a column of its own name.

    >>> check_once(["Time", "t"], {"t": ColumnSource("Time")})
    Traceback (most recent call last):
    hingepair.errors.ArgumentError: t: expected t once, from columns or from a column of this name, got both
    """
    taken = {source.column for source in sources.values()}
    found = set()
    for name in names:
        if name in found:
            raise ArgumentError(name, "a column once", "a second one")
        found.add(name)
    for name, source in sources.items():
        if name in found and name not in taken and source.column in found:
            raise ArgumentError(name, f"{name} once, from columns or from a column of this name", "both")


def in_own_names(
    columns: Mapping[str, NDArray[Any]], sources: Mapping[str, ColumnSource], present: Collection[str]
) -> dict[str, NDArray[Any]]:
    """Return columns by the names of this package, in SI units; columns without a source stay as they are.

    Raises:
        ArgumentError: a log, whose columns `present` names, lacks a source, or it has a unit and dates.
    """
    taken = {source.column for source in sources.values()}
    found = {name: column for name, column in columns.items() if name not in taken}
    for name, source in sources.items():
        if source.column not in columns:
            expected = f"{choices(tuple(present))}{nearest(source.column, tuple(present))}"
            raise ArgumentError(f"columns.{name}", expected, quoted(source.column))
        column = columns[source.column]
        if column.dtype.kind in "mM" and source.scale != 1.0:
            raise ArgumentError(name, "no unit, since the column has dates", "a unit")
        found[name] = source.converted(column)
    return found
