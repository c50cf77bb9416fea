"""Motion by functions of t: expressions, differentiated exactly, numbers and way points.

They are the coordinates themselves, or the rates that are integrated.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.evaluation.plan import ACCELERATION
from hingepair.evaluation.steps import COORDINATES, PLANAR_COORDINATES
from hingepair.integration.signals import Function as Signal
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.pair.results import MOST_HELD
from hingepair.rotations.sequences import SEQUENCES
from hingepair.scenes.instants import Rows, Uniform, read_instants
from hingepair.scenes.integrated_motion import START, integrated_in_plane, integrated_in_space
from hingepair.scenes.known_motion import ByCoordinates, HeldMotion, KnownMotion
from hingepair.scenes.tables import Table
from hingepair.scenes.waypoints import MAX_POINTS, PROFILES, WayPoints, through
from hingepair.symbolic.expressions import parse
from hingepair.symbolic.kinks import Expr
from hingepair.symbolic.time_functions import Derivatives, TimeFunctions, exact

TOLERANCE: Final = 1e-12
"""Largest error of integrated angles that is aimed at unless `tol` is given [rad]; what is left is reported."""

_OMEGA: Final = ("omega1[0]", "omega1[1]", "omega1[2]")


@dataclass(frozen=True, slots=True, eq=False)
class FunctionsOfTime:
    """Functions of t by name.

    Attributes:
        names: the keys of the table that they came from.
        functions: SymPy expressions or way points.
        texts: the expressions as they were written; "" for numbers and way points.
        constants: what they name.
    """

    names: tuple[str, ...]
    functions: tuple[Expr | WayPoints, ...]
    texts: tuple[str, ...]
    constants: Mapping[str, Any]

    def derivatives(self, t: ArrayLike, order: int) -> Derivatives:
        """(values, first derivatives, ...), each one entry per function; exact, at kinks those from the right."""
        rows = iter(zip(*self.compiled().derivatives(t, order), strict=True))
        columns = [f.derivatives(t, order) if isinstance(f, WayPoints) else next(rows) for f in self.functions]
        return tuple(zip(*columns, strict=True))

    def stacked(self, t: Float64Array, order: int) -> list[Float64Array]:
        """The same as arrays side by side; shape (N, functions) each."""
        shape = t.shape
        return [
            np.stack([np.broadcast_to(np.asarray(value, float), shape) for value in row], axis=-1)
            for row in self.derivatives(t, order)
        ]

    def switches(self, t: Float64Array) -> NDArray[np.bool_]:
        """Whether kinks or jumps lie between neighbouring instants; shape (N - 1,)."""
        switched = self.compiled().switches(t)
        for function in self.functions:
            if isinstance(function, WayPoints):
                switched |= function.switches(t)
        return switched

    def expressions(self, letters: Sequence[str] = ()) -> dict[str, Expr | None]:
        """The expressions by name; None for way points.

        Args:
            letters: which of the constants stay letters.
        """
        return {
            name: parse(name, text, self.constants, letters) if text else None if isinstance(f, WayPoints) else f
            for name, f, text in zip(self.names, self.functions, self.texts, strict=True)
        }

    def compiled(self) -> TimeFunctions:
        """The expressions among them, ready to be evaluated.

        Raises:
            ArgumentError: one is not real and finite, whatever t is; names it.
        """
        kept = [(name, f) for name, f in zip(self.names, self.functions, strict=True) if not isinstance(f, WayPoints)]
        return _time_functions(tuple(f for _, f in kept), tuple(name for name, _ in kept))


@functools.lru_cache(maxsize=16)
def _time_functions(expressions: tuple[Expr, ...], names: tuple[str, ...]) -> TimeFunctions:
    return TimeFunctions(expressions, names)


@dataclass(frozen=True, slots=True, eq=False)
class ExpressionMotion:
    """The coordinates as functions of t, and the instants to evaluate them at.

    Attributes:
        t: instants [s].
        functions: of x, y, z, phi_x, phi_y, phi_z, psi, or in the plane of x, y, phi, psi [m, rad].
        sequence: Euler sequence of body 1; None of a planar pair.
        level: the highest derivative that there is.
    """

    t: Uniform
    functions: FunctionsOfTime
    sequence: str | None
    level: ClassVar[int] = ACCELERATION
    error_estimate: ClassVar[float] = 0.0
    origin: ClassVar[str] = "coordinates as expressions in t"
    hint: ClassVar[str] = ""
    doubt: ClassVar[str] = ""

    @property
    def turning(self) -> str:
        """How body 1 turns, for a reader."""
        if self.sequence is None:
            return "in the plane z = 0"
        return f"phi_x, phi_y, phi_z turn about {', '.join(self.sequence)}"

    def kinks(self, start: int, stop: int) -> int:
        """How many of the intervals that end at these instants have a kink or a jump of a coordinate."""
        return int(self.functions.switches(self.t[max(start - 1, 0) : stop]).sum())

    def known(self, rows: Rows, order: int) -> KnownMotion:
        """The motion at some of the instants, with derivatives up to an order."""
        t = self.t[rows]
        return ByCoordinates(t.size, self.functions.derivatives(t, order), self.sequence)


def read_expression_motion(motion: Table, time: Table, planar: bool) -> ExpressionMotion | HeldMotion:
    """The motion that the tables [motion] and [time] describe: coordinates, or rates to be integrated (E12).

    Raises:
        SceneError: a value cannot be used; names file, table and key.
    """
    if "omega1" in motion.values or "psi_dot" in motion.values:
        return _by_rates(motion, held_instants(time), planar)
    names = PLANAR_COORDINATES if planar else COORDINATES
    motion.check_keys((*names, "constants", *(() if planar else ("sequence", "file", "omega1"))))
    functions = read_functions(motion, names)
    return ExpressionMotion(
        read_instants(time), functions, None if planar else motion.choice("sequence", SEQUENCES, "XYZ")
    )


def _by_rates(table: Table, t: Float64Array, planar: bool) -> HeldMotion:
    own = ("x", "y", "phi_0") if planar else ("x", "y", "z", "S1_0", "frame")
    table.check_keys((*START, "tol", "omega1", "psi_dot", "constants", *own))
    axes = ("x", "y") if planar else ("x", "y", "z")
    source = table if planar else table.entries("omega1", 3, "t")
    turning, hinge = read_functions(source, ("omega1",) if planar else _OMEGA), read_functions(table, ("psi_dot",))
    point = read_functions(replace(table, values=dict.fromkeys(axes, 0) | table.values), axes)
    known = dict(zip(("R1", "v1", "a1"), point.stacked(t, 2), strict=True))
    known |= dict(zip(("omega1", "alpha1"), turning.stacked(t, 1), strict=True))
    known |= dict(zip(("psid", "psidd"), (column[:, 0] for column in hinge.stacked(t, 1)), strict=True))
    if planar:
        known |= {name: known[name][:, 0] for name in ("omega1", "alpha1")}
    signals = _signal("omega1", turning, planar), _signal("psi_dot", hinge, True)
    switched = np.logical_or.reduce([functions.switches(t) for functions in (turning, hinge, point)])
    integrate = integrated_in_plane if planar else integrated_in_space
    return integrate(table, t, signals, known, table.number("tol", TOLERANCE), switched=switched)


def _signal(name: str, functions: FunctionsOfTime, single: bool) -> Signal:
    def values(times: Float64Array) -> Float64Array:
        columns = functions.stacked(times, 0)[0]
        return columns[:, 0] if single else columns

    return Signal(name, values, () if single else (3,))


def held_instants(time: Table) -> Float64Array:
    """The instants of the table [time], where all of them are in memory at once."""
    t = read_instants(time)
    if len(t) > MOST_HELD:
        time.fail("samples", f"at most {MOST_HELD} where a motion is integrated, which is done in memory")
    return np.asarray(read_only(t[:]))


def read_functions(table: Table, names: tuple[str, ...]) -> FunctionsOfTime:
    """The functions of t of some keys: numbers, expressions, way points."""
    found = tuple(_function(table, key) for key in names)
    texts = tuple(value if isinstance(value := table.values.get(key), str) else "" for key in names)
    functions = FunctionsOfTime(names, found, texts, table.constants)
    with table.naming():
        functions.compiled()
    return functions


def _function(table: Table, key: str) -> Expr | WayPoints:
    match table.values.get(key):
        case str() as text:
            with table.naming(key):
                return parse(key, text, table.constants)
        case dict():
            return _way_points(table.table(key))
        case bool() | None | list():
            table.fail(key, "a finite number, an expression in t, or way points { t = [...], value = [...] }")
    return exact(table.number(key))


def _way_points(table: Table) -> WayPoints:
    """Way points: { t = [...], value = [...], profile = "...", speed = ..., acceleration = ... }."""
    table.check_keys(("t", "value", "profile", "speed", "acceleration"))
    given: Any = table.values.get("t")
    count = len(given) if isinstance(given, list) else 0
    if not 2 <= count <= MAX_POINTS:
        table.fail("t", f"a list of 2 to {MAX_POINTS} instants")
    t, values = np.array(table.numbers("t", count)), np.array(table.numbers("value", count))
    if not (np.diff(t) > 0).all():
        table.fail("t", "instants that increase")
    limits = {key: table.number(key) for key in ("speed", "acceleration") if key in table.values}
    for key, limit in limits.items():
        if limit <= 0:
            table.fail(key, "a number above 0")
    with table.naming():
        return through(t, values, table.choice("profile", PROFILES), **limits)
