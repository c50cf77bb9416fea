"""Columns of recordings by the names of this package, in SI units and on one clock, whatever their source calls them.

Scenes, `fit` and `masses` read recordings by this room: they differ in their Vocabulary, and in what they do with
columns that are not in it.
"""

from __future__ import annotations

import contextlib
import itertools
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, choices, nearest, nearest_name, quoted
from hingepair.numeric.arrays import Float64Array
from hingepair.tables.column_file import file_table
from hingepair.tables.column_tables import ColumnTable, column_table
from hingepair.tables.suspicions import suspicions
from hingepair.tables.units import COMPASS, SCALES, heading_unit, read_heading, scale_of, split_heading
from hingepair.tables.wrapped_angles import is_wrapped

PlanarColumns: TypeAlias = Mapping[tuple[str, ...], tuple[str, ...]]
"""Columns that a log in the plane leaves out together, and those that it then has."""

_ENTRY: Final = (
    'the name of a column, or { name = "Angle", unit = "deg" }, of t also { name = "Frame", rate = "50 Hz" }'
)


class Vocabulary(NamedTuple):
    """Names of columns that a recording may have."""

    columns: Collection[str]
    unit_of: Callable[[str], str]  # SI unit of a column
    #: from the name of an array and the shape of one sample to the names of its columns, in that shape
    components: Callable[[str, tuple[int, ...]], Any] = lambda name, _: name
    #: angles that turn about z, whose unit may be that of a compass
    headings: Collection[str] = ()


class ColumnSource(NamedTuple):
    """Where a quantity stands in a recording."""

    column: str  # name in the recording
    #: factor to SI units; NaN of a unit that the quantity cannot have
    scale: float = 1.0
    compass: bool = False  # whether it is a heading in degrees, clockwise from north
    stated: bool = False  # whether its unit is
    place: tuple[int, ...] = ()  # of its numbers in samples of the column

    def converted(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values in SI units; a heading as an angle from east (x) towards north (y)."""
        if self.compass:
            return np.asarray(np.radians(90.0 - values))
        return values if self.scale == 1.0 else np.asarray(values * self.scale)


class Recorded(NamedTuple):
    """Columns of a recording."""

    #: arrays of one length by name
    columns: dict[str, NDArray[Any]]
    #: names of those whose unit was stated, by their heading or an entry
    stated: frozenset[str]
    #: names of all columns, by which what is not read is known
    names: tuple[str, ...]
    #: of the file in which the samples stand
    lines: NDArray[Any] | None


def open_columns(source: Any) -> ColumnTable:
    """Return the table of a file, by its path, of a DataFrame, a Dataset or a dict; errors call others `sources`."""
    if isinstance(source, ColumnTable):
        return source
    return file_table(Path(source)) if isinstance(source, str | os.PathLike) else column_table("sources", source)


def read_sources(entries: Any, vocabulary: Vocabulary, *tables: ColumnTable) -> dict[str, ColumnSource]:
    """Return where quantities stand in recordings, by their names.

    Args:
        entries: for each quantity the name of its column, or a dict of `name` and `unit`; of t also `rate`.
        vocabulary: names that quantities may have.
        tables: the recordings; one of them has the column.

    Raises:
        ArgumentError: an entry cannot be used; `name` is `columns` or such as `columns.psi.unit`.
    """
    if not isinstance(entries, Mapping):
        expected = 'a table such as { t = "Time", psi = { name = "Angle", unit = "deg" } }'
        raise ArgumentError("columns", expected, quoted(entries))
    known = tuple(vocabulary.columns)
    present = [column for table in tables for column in table.arrays]
    units = {column: unit for table in tables for column, unit in table.units.items()}
    sources = {}
    for name, entry in entries.items():
        if name not in known:
            raise ArgumentError(f"columns.{name}", f"{choices(known)}{nearest(str(name), known)}", "no such name")
        given: Any = {"name": entry} if isinstance(entry, str) else entry
        keys = {"name", "unit", "rate"} if name == "t" else {"name", "unit"}
        if not isinstance(given, Mapping) or not all(
            k in keys and isinstance(text, str) for k, text in given.items()
        ):
            raise ArgumentError(f"columns.{name}", _ENTRY, quoted(entry))
        column = given.get("name", name)
        if column not in present:
            raise ArgumentError(f"columns.{name}", f"{choices(present)}{nearest(column, present)}", quoted(column))
        if "rate" in given:
            sources[name] = ColumnSource(column, 1.0 / _rate(given["rate"]))
            continue
        unit = given.get("unit") or units.get(column) or heading_unit(column)
        if name == "t" and "unit" not in given and unit not in ("", "s", *SCALES["s"]):
            table = next(table for table in tables if column in table.arrays)
            unit = "" if table.instants(column).dtype.kind in "mM" else unit  # "Time [UTC]" of dates
        sources[name] = _with_unit(name, unit, vocabulary)._replace(column=column)
    return sources


def _with_unit(name: str, unit: str, vocabulary: Vocabulary) -> ColumnSource:
    """Return the source of a quantity in a unit; one without a unit is in its SI unit."""
    own, headings = vocabulary.unit_of(name), vocabulary.headings
    if unit == COMPASS and name in headings:
        return ColumnSource("", compass=True, stated=True)
    scale = scale_of(unit or own, own)
    if scale is not None:
        return ColumnSource("", scale, stated=scale != 1.0)
    units = (own, *SCALES.get(own, {}), *((COMPASS,) if name in headings else ()))
    expected = f"{choices(units)}, or one of them with a - before it"
    if unit == COMPASS and own == "rad":
        near = nearest_name(name, headings)
        expected += ", since only a turn about z is a heading" + f", such as {near}" * bool(near)
    raise ArgumentError(f"columns.{name}.unit", expected, quoted(unit))


def _rate(value: str) -> float:
    """Return the rate of frame numbers [Hz], a text such as "120 Hz"."""
    number, _, unit = value.strip().partition(" ")
    with contextlib.suppress(ValueError):
        rate = float(number) * {"Hz": 1.0, "kHz": 1e3, "": 1.0}.get(unit.strip(), np.nan)
        if 0 < rate < np.inf:
            return rate
    raise ArgumentError("columns.t.rate", 'a rate above 0, such as "50 Hz"', quoted(value))


def _named(table: ColumnTable, heading: str, vocabulary: Vocabulary) -> list[tuple[str, ColumnSource]]:
    """Return what a column holds that no entry names: names, each with its source."""
    is_index, unit = heading == table.row_index and "t" not in table.arrays, table.units.get(heading, "")
    own = "t" if is_index else heading
    full = f"{own} [{unit}]" if unit else own
    name, factor = read_heading(full, vocabulary.unit_of)
    bare, in_brackets = split_heading(full)
    compass = in_brackets == COMPASS and bare in vocabulary.headings
    if compass:
        name = bare
    elif unit and name != own:
        name, factor = own, np.nan
    names = np.asarray(vocabulary.components(name, table.arrays[heading].shape[1:]))
    source = ColumnSource(heading, factor, compass, not is_index and bool(unit or name != heading))
    return [(str(names[place]), source._replace(place=place)) for place in np.ndindex(names.shape)]


def read_recorded(table: ColumnTable, sources: Mapping[str, ColumnSource], vocabulary: Vocabulary) -> Recorded:
    """Return the columns of a table that a vocabulary knows, by the names of this package, in SI units: float64 but
    for `t`, whose integers and dates stay as they are.

    Args:
        table: the columns.
        sources: quantities whose columns have names of their own, all of which the table has.
        vocabulary: names of columns.

    Raises:
        ArgumentError: a column cannot be read, has another unit than it may have, or comes twice; columns differ in
            length or are empty; a column with a unit has dates.
    """
    taken = {source.column for source in sources.values()}
    found = [*sources.items()]
    for heading in table.arrays:
        found += [] if heading in taken else _named(table, heading, vocabulary)
    arrays, columns = dict[str, NDArray[Any]](), dict[str, NDArray[Any]]()
    for name, source in found:
        heading, place = source.column, source.place
        if name not in vocabulary.columns:
            continue
        if name in columns and name in sources:
            raise ArgumentError(name, f"{name} once, from columns or from a column of this name", "both")
        if name in columns or heading in table.doubled:
            raise ArgumentError(name, "a column once", "a second one")
        if np.isnan(source.scale):
            expected = "the unit of this quantity, as a log may state it"
            raise ArgumentError(heading, expected, repr(table.units[heading]))
        if heading not in arrays:
            arrays[heading] = table.instants(heading) if name == "t" else table.numbers(heading)
        array = arrays[heading]
        if array.ndim != 1 + len(place):
            raise ArgumentError(heading, f"shape (N,{' 3,' * len(place)})", f"shape {array.shape}")
        if array.dtype.kind in "mM" and source.scale != 1.0:
            raise ArgumentError(name, "no unit, since the column has dates", "a unit")
        at: Any = (..., *place)
        columns[name] = source.converted(np.array(array[at]))
    counts = {column.size for column in columns.values()}
    if len(counts) > 1:
        lengths = ", ".join(f"{name}: {column.size}" for name, column in columns.items())
        raise ArgumentError("", "columns of one length", lengths)
    if 0 in counts:
        raise ArgumentError("", "at least one sample", "none")
    stated = frozenset(name for name, source in found if source.stated)
    return Recorded(columns, stated, tuple(name for name, _ in found), table.lines)


# ---- angles


def planar_zeros(names: Collection[str], planar: PlanarColumns, sequence: object = "XYZ") -> list[str]:
    """Return the columns that a log leaves out since they are 0 in the plane; none if it has one of them.

    Args:
        names: columns that the log has.
        planar: columns that such logs leave out together, and those that they then have.
        sequence: axes of the Euler angles.

    Raises:
        ArgumentError: the third angle, which such logs have, is not about z.

    >>> planar_zeros({"t", "x", "y", "phi_z"}, {("z", "phi_x"): ("x", "y", "phi_z"), ("v_z",): ("v_x", "v_y")})
    ['z', 'phi_x']
    """
    left_out = (flat for flat, beside in planar.items() if {*beside} <= {*names} and {*names}.isdisjoint(flat))
    zeros = list(itertools.chain(*left_out))
    if zeros and str(sequence)[2:].upper() != "Z":
        expected = f"a sequence that ends in Z, such as XYZ, since the log has no {', '.join(zeros)}"
        raise ArgumentError("sequence", expected, quoted(sequence))
    return zeros


def headings_among(angles: Sequence[str], sequence: object = "XYZ") -> list[str]:
    """Return those of three Euler angles that turn about z, as a heading does.

    >>> headings_among(("phi_x", "phi_y", "phi_z"), "ZYX")
    ['phi_x']
    """
    return [name for name, axis in zip(angles, str(sequence).upper(), strict=False) if axis == "Z"]


def doubts_about_angles(angles: Mapping[str, Float64Array], conversion: Callable[[str], str]) -> list[str]:
    """Return sentences on angles that are probably in degrees, and on those that may then be, too.

    Args:
        angles: samples of angles that are taken for radians, by name; shape (N,) each.
        conversion: function from the name of an angle to how the user states that it is in degrees.

    Raises:
        ArgumentError: an angle jumps by nearly 360, as degrees that were brought into one turn.

    >>> import numpy as np
    >>> angles = {"psi": np.linspace(0, 90, 9), "phi_x": np.linspace(0, 3, 9)}
    >>> doubts_about_angles(angles, lambda name: f"{name}_deg")[1]
    'phi_x may be in the same unit as psi'
    """
    sentences, large, small = [], [], []
    for name, samples in angles.items():
        stated = conversion(name)
        if is_wrapped(samples, 360.0):
            raise ArgumentError(name, f"angles in radians, or {stated}", "jumps by nearly 360, as of degrees")
        doubts = suspicions("angle", name, samples, radians=stated.replace("{", "{{").replace("}", "}}"))
        sentences += doubts
        if doubts:
            large.append(name)
        elif np.unique(samples[np.isfinite(samples)]).size > 1:
            small.append(name)
    if large and small:  # a few degrees are not suspicious by themselves
        sentences.append(f"{', '.join(small)} may be in the same unit as {large[0]}")
    return sentences
