"""Motion by functions of t: expressions, differentiated exactly, numbers and way points.

They are the coordinates themselves, or the rates that are integrated.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.integration.signals import CallableSignal as Signal
from hingepair.numeric.arrays import Float64Array
from hingepair.plans.plan import ACCELERATION
from hingepair.plans.steps import COORDINATES, PLANAR_COORDINATES
from hingepair.rotations.sequences import SEQUENCES
from hingepair.scenes.instants import Instants, Rows, held_instants, read_instants
from hingepair.scenes.integrated_motion import START, integrated
from hingepair.scenes.known_motion import ByCoordinates
from hingepair.scenes.motion import Motion, turns_about
from hingepair.scenes.tables import Table
from hingepair.scenes.waypoints import MAX_POINTS, PROFILES, WayPoints, through
from hingepair.symbolic.exact_constants import exact
from hingepair.symbolic.expressions import parse_expression
from hingepair.symbolic.kinks import Expr
from hingepair.symbolic.time_functions import TimeDerivatives, TimeFunctions

DEFAULT_ANGLE_TOL: Final = 1e-12
"""Largest error of integrated angles that is aimed at unless `tol` is given [rad]; what is left is reported."""
_PROFILE_LIMIT_KEYS: Final = ("speed", "acceleration")
"""Keys of the largest rate and the largest acceleration that a motion through waypoints may reach."""


@dataclass(frozen=True, slots=True, eq=False)
class FunctionsOfTime:
    """Functions of t by name.

    Attributes:
        names: the keys of the table that they came from.
        functions: SymPy expressions or way points.
        table: where they were written.
    """

    names: tuple[str, ...]
    functions: tuple[Expr | WayPoints, ...]
    table: Table

    @property
    def tail(self) -> tuple[int, ...]:
        """The shape of their values at one instant: a vector, or a number."""
        return () if len(self.names) == 1 else (len(self.names),)

    def derivatives(self, t: ArrayLike, order: int) -> TimeDerivatives:
        """Compute (values, first derivatives, ...), one entry per function each; at kinks those from the right."""
        rows = iter(zip(*self.compiled().derivatives(t, order), strict=True))
        columns = [f.derivatives(t, order) if isinstance(f, WayPoints) else next(rows) for f in self.functions]
        return tuple(zip(*columns, strict=True))

    def stacked(self, t: Float64Array, order: int) -> list[Float64Array]:
        """Compute the values and derivatives as arrays; shape (N, *tail) each."""
        rows = self.derivatives(t, order)
        return [np.stack(np.broadcast_arrays(*row, t)[:-1], axis=-1).reshape(*t.shape, *self.tail) for row in rows]

    def switches(self, t: Float64Array) -> NDArray[np.bool_]:
        """Return whether kinks or jumps lie between neighbouring instants; shape (N - 1,)."""
        points = (function.switches(t) for function in self.functions if isinstance(function, WayPoints))
        return functools.reduce(np.logical_or, points, self.compiled().switches(t))

    def expressions(self, letters: Sequence[str] = ()) -> dict[str, Expr | None]:
        """Return the expressions by name, some of the constants as letters; None for way points."""
        found: dict[str, Expr | None] = {}
        for name, function in zip(self.names, self.functions, strict=True):
            written = self.table.values[name]
            if isinstance(written, str):
                found[name] = parse_expression(name, written, self.table.constants, letters)
            else:
                found[name] = None if isinstance(function, WayPoints) else function
        return found

    def compiled(self) -> TimeFunctions:
        """Compile the expressions among the functions; refuse one that is never real and finite."""
        kept = {name: f for name, f in zip(self.names, self.functions, strict=True) if not isinstance(f, WayPoints)}
        return _time_functions(tuple(kept.values()), tuple(kept))


@functools.lru_cache(maxsize=16)
def _time_functions(expressions: tuple[Expr, ...], names: tuple[str, ...]) -> TimeFunctions:
    return TimeFunctions(expressions, names)


@dataclass(frozen=True, slots=True, eq=False)
class ByFunctions:
    """The coordinates as functions of t, at any instants.

    Attributes:
        t: instants [s].
        functions: of x, y, z, phi_x, phi_y, phi_z, psi, or in the plane of x, y, phi, psi [m, rad].
        sequence: Euler sequence of body 1; None of a planar pair.
    """

    t: Instants
    functions: FunctionsOfTime
    sequence: str | None
    level: ClassVar[int] = ACCELERATION

    def part(self, rows: Rows, order: int) -> ByCoordinates:
        """Compute the motion at some of the instants, with derivatives up to an order."""
        t = self.t[rows]
        return ByCoordinates(t.size, self.functions.derivatives(t, order), self.sequence)


def read_expression_motion(motion: Table, time: Table, planar: bool) -> Motion:
    """Read the motion of the tables [motion] and [time]: coordinates, or rates to be integrated (E12)."""
    if "omega1" in motion.values or "psi_dot" in motion.values:
        return _by_rates(motion, held_instants(time), planar)
    names = PLANAR_COORDINATES if planar else COORDINATES
    functions, sequence = read_coordinate_functions(motion, names, () if planar else ("file", "omega1"))
    t = read_instants(time)
    how = turns_about(sequence) if sequence else "in the plane z = 0"
    given = ByFunctions(t, functions, sequence)
    return Motion(t, given, "coordinates as expressions in t", how, functions=(functions,))


def read_coordinate_functions(
    motion: Table, names: tuple[str, ...], also: tuple[str, ...] = ()
) -> tuple[FunctionsOfTime, str | None]:
    """Read coordinates as functions of t, and the sequence of their Euler angles; None in the plane."""
    planar = "phi" in names
    motion.check_keys((*names, "constants", *(() if planar else ("sequence",)), *also))
    return read_functions(motion, names), None if planar else motion.choice("sequence", SEQUENCES, "XYZ")


def _by_rates(table: Table, t: Float64Array, planar: bool) -> Motion:
    """Read the table of a motion that is given by angular velocities, and integrate it."""
    own = ("x", "y", "phi_0") if planar else ("x", "y", "z", "S1_0", "frame")
    table.check_keys((*START, "tol", "omega1", "psi_dot", "constants", *own))
    axes = own[:2] if planar else own[:3]
    omega = (
        replace(table, values={"omega1": table.values.get("omega1")}) if planar else table.entries("omega1", 3, "t")
    )
    turning, hinge = read_functions(omega, tuple(omega.values)), read_functions(table, ("psi_dot",))
    point = read_functions(replace(table, values=dict.fromkeys(axes, 0) | table.values), axes)
    known = dict(zip(("R1", "v1", "a1"), point.stacked(t, 2), strict=True))
    known |= dict(zip(("omega1", "alpha1"), turning.stacked(t, 1), strict=True))
    known |= dict(zip(("psid", "psidd"), hinge.stacked(t, 1), strict=True))
    signals = _signal("omega1", turning), _signal("psi_dot", hinge)
    tol = table.number("tol", DEFAULT_ANGLE_TOL)
    return integrated(table, t, signals, known, tol, planar=planar, functions=(turning, hinge, point))


def _signal(name: str, functions: FunctionsOfTime) -> Signal:
    return Signal(name, lambda t: functions.stacked(t, 0)[0], functions.tail)


def read_functions(table: Table, names: tuple[str, ...]) -> FunctionsOfTime:
    """Read the functions of t of some keys: numbers, expressions, way points."""
    functions = FunctionsOfTime(names, tuple(_read_coordinate(table, key) for key in names), table)
    with table.naming():
        functions.compiled()
    return functions


def _read_coordinate(table: Table, key: str) -> Expr | WayPoints:
    """Read a coordinate of the table: an expression in t, or way points."""
    match table.values.get(key):
        case str() as text:
            with table.naming(key):
                return parse_expression(key, text, table.constants)
        case dict():
            return _way_points(table.table(key))
        case bool() | None | list():
            table.fail(key, "a finite number, an expression in t, or way points { t = [...], value = [...] }")
    return exact(table.number(key))


def _way_points(table: Table) -> WayPoints:
    """Read way points: { t = [...], value = [...], profile = "...", speed = ..., acceleration = ... }."""
    table.check_keys(("t", "value", "profile", *_PROFILE_LIMIT_KEYS))
    given: Any = table.values.get("t")
    count = len(given) if isinstance(given, list) else 0
    if not 2 <= count <= MAX_POINTS:
        table.fail("t", f"a list of 2 to {MAX_POINTS} instants")
    t, values = np.array(table.numbers("t", count)), np.array(table.numbers("value", count))
    if not (np.diff(t) > 0).all():
        table.fail("t", "instants that increase")
    limits = {key: table.number(key) for key in _PROFILE_LIMIT_KEYS if key in table.values}
    for key, limit in limits.items():
        if limit <= 0:
            table.fail(key, "a number above 0")
    with table.naming():
        return through(t, values, table.choice("profile", PROFILES), **limits)
