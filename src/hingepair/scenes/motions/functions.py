"""Motion by functions of t: expressions, differentiated exactly, numbers and way points."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations.quantities import ACCELERATION
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.sequences import SEQUENCE_NAMES
from hingepair.scenes.assembly import Assembly
from hingepair.scenes.motions.known import PSI, EulerBase, Known, Rows
from hingepair.scenes.motions.motion import Motion, read_instants
from hingepair.scenes.motions.waypoints import MAX_WAY_POINTS, PROFILES, WayPoints, interpolate_way_points
from hingepair.scenes.tables import Table, read_constants
from hingepair.symbolic.expressions import Expression, number, parse_expression
from hingepair.symbolic.time_functions import TimeFunctions

if TYPE_CHECKING:
    from hingepair.symbolic.exact import Expr


@dataclass(frozen=True, slots=True, eq=False)
class FunctionsOfTime:
    """Functions of t that a table of a scene defines."""

    #: the keys of the table that they came from
    names: tuple[str, ...]
    functions: tuple[Expression | WayPoints, ...]
    #: where they were written
    table: Table

    def rows(self, t: ArrayLike, order: int, given: Mapping[str, Float64Array] | None = None) -> list[dict[str, Any]]:
        """Return dicts of values, first derivatives, ... at the instants t up to `order`, arrays or floats; at a kink
        those from the right. `given` are values of further symbols, of t's shape.
        """
        rows = iter(zip(*self._of_expressions().derivatives(t, order, given), strict=True))
        columns = [f.derivatives(t, order) if isinstance(f, WayPoints) else next(rows) for f in self.functions]
        return [dict(zip(self.names, [column[k] for column in columns], strict=True)) for k in range(order + 1)]

    def switches(self, t: Float64Array) -> NDArray[np.bool_]:
        """Return, for each interval between instants t, whether a function has a kink or a jump in it; (N - 1,)."""
        points = (function.switches(t) for function in self.functions if isinstance(function, WayPoints))
        return functools.reduce(np.logical_or, points, self._of_expressions().switches(t))

    def expressions(self, symbolic_constants: Sequence[str] = ()) -> dict[str, Expr | None]:
        """Return the functions as a dict of SymPy expressions by name, parsed again so that the constants named in
        `symbolic_constants` stay symbols. The value of a function by way points is None.
        """
        from hingepair.symbolic.exact import to_sympy

        found: dict[str, Expr | None] = {}
        for name, function in zip(self.names, self.functions, strict=True):
            if isinstance(function, WayPoints):
                found[name] = None
                continue
            text, written = self.table.values[name], function
            with self.table.naming(name):
                if isinstance(text, str):
                    known = read_constants(self.table, symbolic_constants)
                    written = parse_expression(name, text, known, symbolic_constants)
                found[name] = to_sympy(name, written)
        return found

    def _of_expressions(self) -> TimeFunctions:
        """Return all functions except way points."""
        return _time_functions(tuple(f for f in self.functions if isinstance(f, Expression)))


_time_functions = functools.lru_cache(maxsize=16)(TimeFunctions)


@dataclass(frozen=True, slots=True, eq=False)
class FunctionSource:
    """Motion of joints, and of body 1 or a base, by functions of time."""

    #: instants [s]
    t: Float64Array
    assembly: Assembly
    #: of the joints that move [rad or m], and of body 1 or the base unless it rests at the origin [m, rad]
    functions: FunctionsOfTime
    #: Euler sequence of the base; None in the plane
    sequence: str | None
    level: ClassVar[int] = ACCELERATION

    def part(self, rows: Rows, order: int) -> Known:
        """Return the motion at the instants with the indices `rows`, with derivatives up to `order`."""
        return self.at(self.t[rows], order)

    def at(self, t: Float64Array, order: int, given: Mapping[str, Float64Array] | None = None) -> Known:
        """Return the motion at instants t, with derivatives up to `order`; `given` are values of further symbols."""
        found, rests = self.functions.rows(t, order, given), self.assembly.rests
        joints = tuple(
            tuple(row.get(name, rests[name] if k == 0 else 0.0) for name in rests) for k, row in enumerate(found)
        )
        return Known(self.assembly.names, t.size, joints, base_of(self.assembly, found, self.sequence))


def base_of(assembly: Assembly, rows: Sequence[Mapping[str, Any]], sequence: str | None) -> EulerBase | None:
    """Return the motion of body 1 or a base by functions of time, from their rows; None where it rests."""
    names = [name for name in assembly.base_names if name in rows[0]]
    return EulerBase(tuple(tuple(row[name] for name in names) for row in rows), sequence) if names else None


def read_function_motion(tables: Table, assembly: Assembly) -> Motion:
    """Return the Motion that the tables [motion] and [time] define by functions of t."""
    motion = tables.table("motion")
    assembly.check_motion_keys(motion)
    joints = PSI if assembly.pair is not None else assembly.moved_by(motion)
    functions, sequence = read_functions(motion, assembly, joints), read_sequence(motion, assembly)
    t = read_instants(tables.table("time"))
    source = FunctionSource(t, assembly, functions, sequence)
    how = ""
    if assembly.pair is not None:
        turns = f"phi_x, phi_y, phi_z turn about {', '.join(sequence)}" if sequence else "in the plane z = 0"
        how = "body 1 rests at the origin" if functions.names == PSI else turns
    return Motion(t=t, source=source, origin="functions of t", how=how, functions=functions, moving=joints)


def read_sequence(motion: Table, assembly: Assembly) -> str | None:
    """Return the Euler sequence of body 1 or the base; None in the plane."""
    return None if assembly.planar else motion.choice("sequence", SEQUENCE_NAMES, "XYZ")


def read_functions(motion: Table, assembly: Assembly, joints: tuple[str, ...]) -> FunctionsOfTime:
    """Return the functions of joints in [motion], and of body 1 or the base if it has any of its coordinates: of a
    pair all are required, of a mechanism they are 0 unless given.
    """
    base = assembly.base_names if not motion.values.keys().isdisjoint(assembly.base_names) else ()
    zeros = dict.fromkeys(base, 0) if assembly.pair is None else {}
    table, names = replace(motion, values=zeros | motion.values), (*base, *joints)
    return FunctionsOfTime(names, tuple(_read_coordinate(table, key) for key in names), table)


def _read_coordinate(table: Table, key: str) -> Expression | WayPoints:
    """Return the function of t under a key of a Table: a number, an expression or a table of way points."""
    match table.values.get(key):
        case str() as text:
            with table.naming(key):
                return parse_expression(key, text, table.constants)
        case dict():
            return _read_way_points(table.table(key))
        case bool() | None | list():
            table.fail(key, "a finite number, an expression in t, or way points { t = [...], value = [...] }")
    return number(table.number(key))


def _read_way_points(table: Table) -> WayPoints:
    """Return the WayPoints of a table with the keys t, value, profile, speed and acceleration."""
    limit_keys = ("speed", "acceleration")
    table.check_keys(("t", "value", "profile", *limit_keys))
    instants: Any = table.values.get("t")
    count = len(instants) if isinstance(instants, list) else 0
    if not 2 <= count <= MAX_WAY_POINTS:
        table.fail("t", f"a list of 2 to {MAX_WAY_POINTS} instants")
    t, values = np.array(table.numbers("t", count)), np.array(table.numbers("value", count))
    if not (np.diff(t) > 0).all():
        table.fail("t", "instants that increase")
    limits = {key: table.number(key) for key in limit_keys if key in table.values}
    for key, limit in limits.items():
        if limit <= 0:
            table.fail(key, "a number above 0")
    profile = table.choice("profile", PROFILES)
    with table.naming():
        return interpolate_way_points(t, values, profile, **limits)
