"""Units of the workshop: their factors to SI units, and tables, plots and files in them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple, TypeAlias

from numpy.typing import NDArray

from hingepair.equations.quantities import unit_of
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.tables.sheets import offset_text, round_offset

_PER_SECOND: Final = ("", "/s", "/s^2")  # a length or an angle, its rate, its acceleration
_LENGTHS: Final = {"mm": 1e-3, "um": 1e-6, "cm": 1e-2, "km": 1e3, "in": 0.0254, "ft": 0.3048}  # m
_ANGLES: Final = {"mrad": 1e-3, "deg": math.pi / 180, "turn": 2 * math.pi}  # rad
_RATES: Final = {  # further units of rates and accelerations, by the SI unit
    "m/s": {"km/h": 1 / 3.6, "kn": 1852 / 3600},
    "m/s^2": {"g": 9.80665},
    "rad/s": {"rpm": math.pi / 30},
}
SCALES: Final[Mapping[str, Mapping[str, float]]] = {
    "s": {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    "N": {"kN": 1e3},
    "N m": {"N mm": 1e-3, "kN m": 1e3},
    **{
        f"{si}{per}": {f"{unit}{per}": scale for unit, scale in scales.items()} | _RATES.get(f"{si}{per}", {})
        for per in _PER_SECOND
        for si, scales in (("m", _LENGTHS), ("rad", _ANGLES))
    },
}
"""Factors of the units that may stand for an SI unit, by the SI unit."""
COMPASS: Final = "compass"
"""Unit of headings in degrees, clockwise from north."""
_HEADING: Final = re.compile(r"(.+?)\s*[\[(]([^][()]+)[\])]\s*")  # a name and its unit


def _in_ascii(name: str) -> str:
    """Return the name of a unit with letters in place of signs."""
    for sign, letters in (("\N{DEGREE SIGN}", "deg"), ("\N{MICRO SIGN}", "u"), ("\N{GREEK SMALL LETTER MU}", "u")):
        name = name.replace(sign, letters)
    return name


class Units:
    """Units that replace SI units in tables, plots and files.

    Args:
        text: names separated by commas, such as "deg, mm"; none for SI units. A unit of lengths or angles stands for
            their rates and accelerations too, unless these have a unit of their own.

    >>> units = Units("deg, mm, km/h")
    >>> [units.unit(si) for si in ("rad", "rad/s", "m", "m/s", "m/s^2", "N m")]
    ['deg', 'deg/s', 'mm', 'km/h', 'mm/s^2', 'N m']
    >>> units.heading("R2_x", "m"), units.heading("S2_xx", "1"), Units().heading("R2_x", "m")
    ('R2_x [mm]', 'S2_xx', 'R2_x')
    """

    __slots__ = ("_chosen",)

    def __init__(self, text: str = "") -> None:
        chosen: dict[str, str] = {}  # by SI unit
        known = {unit: si for si, scales in SCALES.items() for unit in (si, *scales)}
        for name in filter(None, map(str.strip, text.split(","))):
            si = known.get(name)
            if si is None:
                expected = f"{choices(tuple(known))}, separated by commas{nearest(_in_ascii(name), tuple(known))}"
                raise ArgumentError("units", expected, quoted(name))
            if chosen.setdefault(si, name) != name:
                raise ArgumentError("units", f"one unit in place of {si}", f"{chosen[si]} and {name}")
        for si in ("m", "rad"):
            if si in chosen:
                for per in _PER_SECOND:
                    chosen.setdefault(f"{si}{per}", f"{chosen[si]}{per}")
        self._chosen = chosen

    @classmethod
    def of(cls, units: str | Units | None) -> Units:
        """Return units that are given by their names or as they are; SI units for None."""
        if isinstance(units, Units):
            return units
        if units is not None and not isinstance(units, str):
            raise ArgumentError("units", 'names of units in one text, such as "deg, mm"', quoted(units))
        return cls(units or "")

    def __bool__(self) -> bool:
        """Whether any unit was named."""
        return bool(self._chosen)

    def __repr__(self) -> str:
        return f"Units({', '.join(self._chosen.values())!r})"

    def over(self, defaults: Units) -> Units:
        """Return these units and, for what they do not name, those of `defaults`.

        >>> Units("deg").over(Units("mm, mrad")).unit("m"), Units("deg").over(Units("mm, mrad")).unit("rad")
        ('mm', 'deg')
        """
        both = Units()
        both._chosen = defaults._chosen | self._chosen
        return both

    def unit(self, si: str) -> str:
        """Return the unit that stands for an SI unit."""
        return self._chosen.get(si, si)

    def factor(self, si: str) -> float:
        """Return the factor from an SI unit to the unit that stands for it.

        >>> Units("mm").factor("m"), Units("mm").factor("rad")
        (1000.0, 1.0)
        """
        return 1 / SCALES.get(si, {}).get(self.unit(si), 1.0)

    def heading(self, name: str, si: str) -> str:
        """Return the heading of a column: its name, with the unit in brackets if units were named and it has one."""
        return f"{name} [{self.unit(si)}]" if self and si != "1" else name

    def offset_of_instants(self, first: float, last: float) -> tuple[float, str]:
        """Return what is subtracted from the instants of a motion in these units, and how the rest is called; 0 and
        an empty text where they need no offset.

        Args:
            first: first instant [s].
            last: last instant [s].

        >>> Units().offset_of_instants(1718000005.0, 1718000015.0), Units("ms").offset_of_instants(0.0, 10.0)
        ((1718000005.0, 't - 1718000005 s'), (0.0, ''))
        """
        factor = self.factor("s")
        offset = round_offset(factor * first, factor * last)
        return (offset, f"{offset_text('t', offset)} {self.unit('s')}") if offset else (0.0, "")

    def converted(self, values: NDArray[Any], si: str) -> NDArray[Any]:
        """Return an array of numbers in an SI unit in the unit that stands for it; the array itself if that is SI."""
        factor = self.factor(si)
        return values if factor == 1.0 else values * factor


UnitsLike: TypeAlias = str | Units | None
"""Units by their names, such as "deg, mm", as they are, or None for SI units."""

SI: Final = Units()
"""SI units, and headings without a unit."""


class Columns(NamedTuple):
    """Headings of the columns of quantities, and their numbers, in units.

    >>> Columns(Units("mm")).heading("R2_x")
    'R2_x [mm]'
    """

    units: Units = SI
    si_unit: Callable[[str], str] = unit_of  # SI unit of a quantity or of one of its components

    def unit(self, name: str) -> str:
        """Return the unit of a quantity."""
        return self.units.unit(self.si_unit(name))

    def heading(self, name: str) -> str:
        """Return the heading of a column."""
        return self.units.heading(name, self.si_unit(name))

    def converted(self, name: str, values: NDArray[Any]) -> NDArray[Any]:
        """Return the numbers of a quantity in its unit."""
        return self.units.converted(values, self.si_unit(name))


IN_SI: Final = Columns()
"""Quantities of the registry in SI units."""


def split_heading(heading: str) -> tuple[str, str]:
    """Return the name in a heading and what stands behind it in brackets or parentheses, an empty text without these.

    >>> split_heading("Angle [deg]"), split_heading("Kurs (\N{DEGREE SIGN})"), split_heading("Angle")
    (('Angle', 'deg'), ('Kurs', 'deg'), ('Angle', ''))
    """
    match = _HEADING.fullmatch(heading)
    return (match[1], _in_ascii(match[2].strip())) if match else (heading, "")


def scale_of(unit: str, si: str) -> float | None:
    """Return the factor from a unit to an SI unit, negative with a - before it; None of a unit of something else.

    >>> scale_of("mm", "m"), scale_of("-mm", "m"), scale_of("m", "m"), scale_of("deg", "m")
    (0.001, -0.001, 1.0, None)
    """
    scale = {si: 1.0, **SCALES.get(si, {})}.get(unit.removeprefix("-"))
    return -scale if scale is not None and unit.startswith("-") else scale


def heading_unit(heading: str) -> str:
    """Return the unit in a heading: what stands in brackets behind a name, but for an index or a dash; what stands in
    parentheses only if it is a known unit, with or without a - before it. An empty text if there is none.

    >>> [heading_unit(one) for one in ("Angle [-deg]", "Angle (deg)", "Angle [grad]", "Angle (raw)", "position[0]")]
    ['-deg', 'deg', 'grad', '', '']
    """
    unit = split_heading(heading)[1]
    if heading.rstrip().endswith("]"):
        return "" if unit == "-" or unit.isdecimal() else unit
    return unit if unit == COMPASS or any(scale_of(unit, si) is not None for si in SCALES) else ""


def read_heading(heading: str, si_unit: Callable[[str], str]) -> tuple[str, float]:
    """Return the name in a heading with a unit, and the factor from that unit, negative with a - before it, to the SI
    unit; other headings are names.

    >>> [read_heading(f"R2_x{unit}", unit_of) for unit in (" [mm]", " [-mm]", " [deg]", "")]
    [('R2_x', 0.001), ('R2_x', -0.001), ('R2_x [deg]', 1.0), ('R2_x', 1.0)]
    """
    name, unit = split_heading(heading)
    scale = scale_of(unit, si_unit(name)) if unit else None
    return (heading, 1.0) if scale is None else (name, scale)
