"""Columns of recordings by the names of this package, in SI units and on one clock, whatever their source calls them.

Scenes, `fit` and `masses` read recordings by this room: they differ in their Vocabulary, and in what they do with
columns that are not in it.
"""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, choices, nearest, nearest_name, quoted
from hingepair.numeric.arrays import Float64Array
from hingepair.tables.column_file import file_table
from hingepair.tables.column_tables import ColumnTable, column_table
from hingepair.tables.instants import elapsed_seconds
from hingepair.tables.suspicions import suspicions
from hingepair.tables.units import COMPASS, SCALES, heading_unit, read_heading, scale_of, split_heading
from hingepair.tables.wrapped_angles import is_wrapped, unwrap_if_wrapped

PlanarColumns: TypeAlias = Mapping[tuple[str, ...], tuple[str, ...]]
"""Columns that a log in the plane leaves out together, and those that it then has."""

_ENTRY: Final = 'the name of a column, or { name = "Angle", unit = "deg", delay = "0.12 s", rate = "50 Hz" }'


class Vocabulary(NamedTuple):
    """Names of columns that a recording may have."""

    columns: Collection[str]
    unit_of: Callable[[str], str]  # SI unit of a column
    #: from the name of an array and the shape of one sample to the names of its columns, in that shape
    components: Callable[[str, tuple[int, ...]], Any] = lambda name, _: name
    #: angles that turn about z, whose unit may be that of a compass
    headings: Collection[str] = ()


class ColumnSource(NamedTuple):
    """Where a quantity stands in a recording that has names and units of its own."""

    column: str  # name in the recording
    scale: float = 1.0  # factor to SI units
    compass: bool = False  # whether it is a heading in degrees, clockwise from north
    delay: float = 0.0  # [s] by which the column is behind the instants of its rows
    rate: float = 0.0  # [Hz] at which it was sampled; 0 for that of the rows

    @property
    def states_unit(self) -> bool:
        """Whether the unit is another than the SI unit."""
        return self.compass or self.scale != 1.0

    def converted(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the values in SI units; a heading as an angle from east (x) towards north (y)."""
        if self.compass:
            return np.asarray(np.radians(90.0 - values))
        return values if self.scale == 1.0 else np.asarray(values * self.scale)


class Recorded(NamedTuple):
    """Columns of a recording: arrays of one length by name."""

    columns: dict[str, NDArray[Any]]
    #: names of those whose unit was stated, by their heading or an entry
    stated: frozenset[str]


def open_columns(source: Any, name: str = "sources") -> ColumnTable:
    """Return the table of a file, by its path, of a DataFrame, a Dataset or a dict; errors call others `name`."""
    if isinstance(source, ColumnTable):
        return source
    return file_table(Path(source)) if isinstance(source, str | os.PathLike) else column_table(name, source)


def read_sources(entries: Any, vocabulary: Vocabulary, *tables: ColumnTable) -> dict[str, ColumnSource]:
    """Return where quantities stand in recordings, by their names.

    Args:
        entries: for each quantity the name of its column, or a dict of `name`, `unit`, `delay` and `rate`.
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
        if isinstance(given, Mapping) and "column" in given and "name" not in given:
            given = {"name": given["column"], **{key: value for key, value in given.items() if key != "column"}}
        if not isinstance(given, Mapping) or not {*given} <= {"name", "unit", "delay", "rate"}:
            raise ArgumentError(f"columns.{name}", _ENTRY, quoted(entry))
        if not all(isinstance(given.get(key, ""), str) for key in ("name", "unit")):
            raise ArgumentError(f"columns.{name}", _ENTRY, quoted(entry))
        column = given.get("name", name)
        delay, rate = (_number_with_unit(name, key, given[key]) if key in given else 0.0 for key in ("delay", "rate"))
        if column not in present:
            raise ArgumentError(f"columns.{name}", f"{choices(present)}{nearest(column, present)}", quoted(column))
        if name == "t" and rate:  # frame numbers
            sources[name] = ColumnSource(column, 1.0 / rate)
            continue
        unit = given.get("unit") or units.get(column) or heading_unit(column)
        if name == "t" and "unit" not in given and unit not in ("", "s", *SCALES["s"]):
            table = next(table for table in tables if column in table.arrays)
            unit = "" if table.instants(column).dtype.kind in "mM" else unit  # "Time [UTC]" of dates
        sources[name] = _with_unit(name, unit, vocabulary)._replace(column=column, delay=delay, rate=rate)
    return sources


def _with_unit(name: str, unit: str, vocabulary: Vocabulary) -> ColumnSource:
    """Return the source of a quantity in a unit; one without a unit is in its SI unit."""
    own, headings = vocabulary.unit_of(name), vocabulary.headings
    if unit == COMPASS and name in headings:
        return ColumnSource("", compass=True)
    scale = scale_of(unit or own, own)
    if scale is not None:
        return ColumnSource("", scale)
    units = (own, *SCALES.get(own, {}), *((COMPASS,) if name in headings else ()))
    expected = f"{choices(units)}, or one of them with a - before it"
    if unit == COMPASS and own == "rad":
        near = nearest_name(name, headings)
        expected += ", since only a turn about z is a heading" + f", such as {near}" * bool(near)
    raise ArgumentError(f"columns.{name}.unit", expected, quoted(unit))


def _number_with_unit(name: str, key: str, value: object) -> float:
    """Return a delay [s] or a rate [Hz], a number or a text such as "120 ms"; refuse rates that are not above 0."""
    units = {"s": 1.0, **SCALES["s"]} if key == "delay" else {"Hz": 1.0, "kHz": 1e3}
    match = re.fullmatch(r"\s*([-+\d.eE]+)\s*([a-zA-Z]*)\s*", value if isinstance(value, str) else repr(value))
    try:
        number = float(match[1]) * units[match[2] or next(iter(units))] if match else np.nan
    except (KeyError, ValueError):
        number = np.nan
    if not np.isfinite(number) or (key == "rate" and number <= 0):
        expected = 'a time such as "0.12 s"' if key == "delay" else 'a rate above 0, such as "50 Hz"'
        raise ArgumentError(f"columns.{name}.{key}", expected, quoted(value))
    return float(number)


class _Column(NamedTuple):
    """What a column of a table holds."""

    names: NDArray[Any]  # of its components, in the shape of a sample
    #: to SI units; its scale is NaN of a unit that the quantity cannot have
    unit: ColumnSource = ColumnSource("")
    stated: bool = False  # whether its unit is


def _named(table: ColumnTable, heading: str, vocabulary: Vocabulary) -> _Column:
    """Return what a column holds that no entry names."""
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
    return _Column(names, ColumnSource("", factor, compass), not is_index and bool(unit or name != heading))


def read_recorded(
    table: ColumnTable,
    sources: Mapping[str, ColumnSource],
    vocabulary: Vocabulary,
    choose: Callable[[list[str]], list[str]],
) -> Recorded:
    """Return chosen columns of a table by the names of this package, in SI units: float64 but for `t`, whose integers
    and dates stay as they are.

    Args:
        table: the columns.
        sources: quantities whose columns have names of their own, all of which the table has.
        vocabulary: names of other columns.
        choose: from the names of all columns to those to read; may raise an error.

    Raises:
        ArgumentError: a column cannot be read, has another unit than it may have, or comes twice; columns differ in
            length or are empty; a column with a unit has dates.
    """
    taken = {source.column for source in sources.values()}
    held = {h: _Column(np.asarray(h)) if h in taken else _named(table, h, vocabulary) for h in table.arrays}
    wanted = choose([name for h in (*held, *table.doubled) for name in held[h].names.ravel().tolist()])
    for name in wanted:
        if wanted.count(name) > 1:
            raise ArgumentError(name, "a column once", "a second one")
    for name, source in sources.items():
        if name in wanted and name not in taken and source.column in wanted:
            raise ArgumentError(name, f"{name} once, from columns or from a column of this name", "both")
    clock = sources["t"].column if "t" in sources else next((h for h in held if held[h].names.tolist() == "t"), "")
    columns: dict[str, NDArray[Any]] = {}
    for heading, (names, unit, _) in held.items():
        if not {*wanted}.isdisjoint(names.ravel().tolist()):
            if np.isnan(unit.scale):
                expected = "the unit of this quantity, as a log may state it"
                raise ArgumentError(heading, expected, repr(table.units[heading]))
            array = table.instants(heading) if heading == clock else table.numbers(heading)
            if array.shape[1:] != names.shape or not array.ndim:
                expected = "shape " + str(("N", *names.shape)).replace("'", "")
                raise ArgumentError(heading, expected, f"shape {array.shape}")
            parts = array.reshape(len(array), names.size).T
            columns |= {
                name: unit.converted(np.array(part)) for name, part in zip(names.ravel().tolist(), parts, strict=True)
            }
    columns = {name: columns[name] for name in wanted if name in columns}
    counts = {column.size for column in columns.values()}
    if len(counts) > 1:
        lengths = ", ".join(f"{name}: {column.size}" for name, column in columns.items())
        raise ArgumentError("", "columns of one length", lengths)
    if 0 in counts:
        raise ArgumentError("", "at least one sample", "none")
    stated = {name for column in held.values() if column.stated for name in column.names.ravel().tolist()}
    stated |= {name for name, source in sources.items() if source.states_unit}
    return Recorded(_in_own_names(columns, sources, vocabulary), frozenset(stated))


_TIMES: Final = frozenset({"time", "times", "timestamp", "stamp", "seconds", "sec", "zeit"})  # what others call t


def nearest_column(name: str, known_names: Collection[str]) -> str:
    """Return a remark on the known column that an unknown one probably stands for, or nothing."""
    plain = re.sub(r"\s*[(\[].*", "", name).strip().lower()  # "Time (Seconds)"
    return " (nearest: t)" if plain in _TIMES else nearest(name, known_names)


def _in_own_names(
    columns: Mapping[str, NDArray[Any]], sources: Mapping[str, ColumnSource], vocabulary: Vocabulary
) -> dict[str, NDArray[Any]]:
    """Return columns by the names of this package, in SI units, on the clock of the rows."""
    taken = {source.column for source in sources.values()}
    found = {name: column for name, column in columns.items() if name not in taken}
    for name, source in sources.items():
        column = columns[source.column]
        if column.dtype.kind in "mM" and source.scale != 1.0:
            raise ArgumentError(name, "no unit, since the column has dates", "a unit")
        found[name] = source.converted(column)
    for name, source in sources.items():
        if source.delay or source.rate:
            if "t" not in found:
                raise ArgumentError(f"columns.{name}", "a column t beside a delay or a rate", "none")
            angle = vocabulary.unit_of(name) == "rad"
            found[name] = _at_the_rows(elapsed_seconds("t", found["t"])[0], found[name], source, angle)
    return found


def _at_the_rows(t: Float64Array, values: Float64Array, source: ColumnSource, angle: bool) -> Float64Array:
    """Return a column that is late, or was sampled at a rate of its own, at the instants of the rows, by straight
    lines between its samples; NaN where these are missing.
    """
    known = np.isfinite(values)
    if source.rate:  # rows between repeat the last sample, or are empty; what stays the same counts now and then
        last, value = -np.inf, np.nan
        for row in np.flatnonzero(known):
            known[row] = values[row] != value or t[row] - last >= 1.5 / source.rate
            last, value = (t[row], values[row]) if known[row] else (last, value)
    if known.sum() < 2:
        raise ArgumentError(source.column, "at least two samples beside a delay or a rate", f"{known.sum()}")
    at, samples = t[known] - source.delay, values[known]
    samples = unwrap_if_wrapped(samples) if angle else samples
    usual = 1.0 / source.rate if source.rate else float(np.median(np.diff(at)))
    after = np.clip(np.searchsorted(at, t), 1, at.size - 1)
    missing = (at[after] - at[after - 1] > 2.5 * usual) & (t > at[after - 1]) & (t < at[after])
    found = np.interp(t, at, samples, left=np.nan, right=np.nan)
    return np.where(missing, np.nan, found)


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
