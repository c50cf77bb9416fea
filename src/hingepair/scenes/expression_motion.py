"""Motion by expressions: the coordinates as functions of t, differentiated exactly."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, SceneError, quoted
from hingepair.evaluation.plan import ACCELERATION
from hingepair.numeric.arrays import read_only
from hingepair.pair.forward_kinematics import COORDINATES, PLANAR_COORDINATES
from hingepair.rotations.sequences import find_sequence
from hingepair.scenes.known_motion import CoordinateSamples, PlanarSamples, Rows, Samples
from hingepair.scenes.tables import Table
from hingepair.symbolic.jets import Expr
from hingepair.symbolic.time_functions import Coordinates, check_real, compile_coordinates, exact

MAX_SAMPLES: Final = 10_000_000


@dataclass(frozen=True, slots=True, eq=False)
class ExpressionMotion:
    """The coordinates as expressions in t, and the instants to evaluate them at.

    Attributes:
        t: instants; shape (N,) s.
        expressions: SymPy expressions of x, y, z, phi_x, phi_y, phi_z, psi in t, or x, y, phi, psi [m, rad].
        sequence: Euler sequence of body 1; None of a planar pair.
        level: the highest derivative that there is.
    """

    t: NDArray[np.float64]
    expressions: tuple[Expr, ...]
    sequence: str | None
    level: ClassVar[int] = ACCELERATION

    @property
    def names(self) -> tuple[str, ...]:
        """The coordinates."""
        return PLANAR_COORDINATES if self.sequence is None else COORDINATES

    @property
    def turning(self) -> str:
        """How body 1 turns, for a reader."""
        if self.sequence is None:
            return "in the plane z = 0"
        return f"phi_x, phi_y, phi_z turn about {', '.join(self.sequence)}"

    def samples(self, rows: Rows, order: int) -> Samples:
        """The motion at some of the instants, with derivatives up to an order."""
        t = self.t[rows]
        if self.sequence is None:
            return PlanarSamples(t.size, self.coordinates(t, order))
        return CoordinateSamples(t.size, self.coordinates(t, order), self.sequence)

    def coordinates(self, t: ArrayLike, order: int = ACCELERATION) -> Coordinates:
        """(q[, qd[, qdd]]) at any instants; shape (...)."""
        return _compiled(self.expressions, order)(t)


def read_expression_motion(motion: Table, time: Table, planar: bool) -> ExpressionMotion:
    """The motion that the tables [motion] and [time] of a scene describe.

    Raises:
        SceneError: a value cannot be used; names file, table and key.
    """
    t = read_instants(time)
    if planar:
        return ExpressionMotion(t, _expressions(motion, PLANAR_COORDINATES, ("constants",)), None)
    expressions = _expressions(motion, COORDINATES, ("sequence", "constants", "file", "omega1"))
    return ExpressionMotion(t, expressions, read_sequence(motion))


def read_instants(time: Table) -> NDArray[np.float64]:
    """The instants of the table [time]."""
    time.check_keys(("start", "stop", "samples"))
    start, stop = time.number("start"), time.number("stop")
    if not 0 <= stop - start < np.inf:
        time.fail("stop", f"a number from start = {start!r} on, at a finite distance")
    samples = time.integer("samples", 1, MAX_SAMPLES)
    return np.asarray(read_only(np.linspace(start, stop, samples)))


def read_sequence(table: Table) -> str:
    """The Euler sequence of the table [motion]; XYZ unless given."""
    sequence = table.text("sequence", default="XYZ")
    try:
        find_sequence(sequence)
    except ArgumentError as error:
        raise SceneError(table.label("sequence"), error.expected, error.got) from None
    return sequence


def _expressions(table: Table, names: tuple[str, ...], others: tuple[str, ...]) -> tuple[Expr, ...]:
    table.check_keys((*names, *others))
    constants = read_constants(table)
    expressions = tuple(read_expression(table, key, constants) for key in names)
    check_real_values(table, names, expressions)
    return expressions


def check_real_values(table: Table, names: tuple[str, ...], expressions: tuple[Expr, ...]) -> None:
    """Refuse expressions that are not real and finite, as far as that does not depend on t."""
    try:
        check_real([table.label(key) for key in names], expressions)
    except ArgumentError as error:
        raise SceneError(error.name, error.expected, error.got) from None


def read_expression(table: Table, key: str, constants: dict[str, float]) -> Expr:
    """The number or expression of a key."""
    value = table.values.get(key)
    if not isinstance(value, str):
        if isinstance(value, bool) or not isinstance(value, int | float):
            table.fail(key, "a finite number or an expression in t")
        return exact(table.number(key))
    from hingepair.symbolic.expressions import parse

    return parse(table.label(key), value, constants)


def read_constants(motion: Table) -> dict[str, float]:
    """The named numbers of the table [motion.constants]."""
    from hingepair.symbolic.expressions import constant_name_fault

    table = motion.table("constants", required=False)
    for key in table.values:
        fault = constant_name_fault(key)
        if fault:
            raise SceneError(table.label(key), fault, quoted(key))
    return {key: table.number(key) for key in table.values}


@functools.lru_cache(maxsize=16)
def _compiled(motion: tuple[Expr, ...], order: int) -> Callable[[ArrayLike], Coordinates]:
    return compile_coordinates(motion, order)
