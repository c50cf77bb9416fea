"""What closed forms are made of: exact constants, letters, and coordinates in t with their derivatives."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import Any, Final

import sympy

from hingepair.errors import ArgumentError, quoted
from hingepair.evaluation.plan import PLANAR
from hingepair.pair.forward_kinematics import COORDINATES, PARTS, PLANAR_COORDINATES, PLANAR_PARTS
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.symbolic.jets import SYMPY_ERRORS, Expr, Jet, JetProgram, time_symbol
from hingepair.symbolic.printers import count_letters
from hingepair.symbolic.time_functions import exact

SYMBOLIC = ("u1", "u2", "n")
"""What can stay a letter."""

_MAX_LETTERS: Final = 2_000  # in a derivative of a coordinate
_MAX_SQUARE: Final = 1_000  # the largest denominator of a squared axis component that is taken for exact


def closed_jet(name: str, expr: Expr) -> Jet:
    """An expression in t with its first and second derivative.

    Raises:
        ArgumentError: they are too long, or none that SymPy can work with.
    """
    expected = f"an expression whose derivatives have at most {_MAX_LETTERS} letters"
    program, known = JetProgram(), dict[Expr, int]()
    meaning: dict[Expr, Expr] = {}
    try:
        jet = program.jet(expr)
        for symbol, step in program.needed([part for part in jet if part.is_Symbol]):
            whole = meaning[symbol] = step.xreplace(meaning)
            if count_letters(whole, known) > _MAX_LETTERS:
                raise ArgumentError(name, expected, f"{count_letters(whole, known)}")
        return expr, jet[1].xreplace(meaning), jet[2].xreplace(meaning)
    except ArgumentError:
        raise
    except SYMPY_ERRORS:
        raise ArgumentError(name, expected, "one that SymPy cannot differentiate") from None


def any_motion(kind: str) -> list[Jet]:
    """The coordinates as functions of t, with their derivatives."""
    names = PLANAR_COORDINATES if kind == PLANAR else COORDINATES
    t = time_symbol()
    functions = [sympy.Function(name, real=True)(t) for name in names]
    return [(f, f.diff(t), f.diff(t, 2)) for f in functions]


def motion_inputs(jets: list[Jet], kind: str) -> dict[str, Any]:
    """The coordinates and their derivatives by the names of a plan's inputs."""
    size, parts = (2, PLANAR_PARTS) if kind == PLANAR else (3, PARTS)
    found: dict[str, Any] = {}
    for (point, angle, hinge), row in zip(parts.values(), zip(*jets, strict=True), strict=True):
        found[point] = row[:size]
        found[angle] = row[size] if kind == PLANAR else row[size : 2 * size]
        found[hinge] = row[-1]
    return found


def check_symbolic(symbolic: Iterable[str], pair: HingePair | PlanarPair) -> tuple[str, ...]:
    """The names of what is to stay a letter.

    Raises:
        ArgumentError: not a collection of known names.
    """
    known = [key for key in SYMBOLIC if hasattr(pair, key)]
    expected = f"names out of {', '.join(known)}"
    if isinstance(symbolic, str) or not isinstance(symbolic, Iterable):
        raise ArgumentError("symbolic", f"a tuple of {expected}", quoted(symbolic))
    names = tuple(symbolic)
    for name in names:
        if name not in known:
            raise ArgumentError("symbolic", expected, quoted(name))
    return names


def constant_inputs(pair: HingePair | PlanarPair, symbolic: tuple[str, ...]) -> dict[str, Any]:
    """u1, u2, n and home as exact numbers or letters."""
    found: dict[str, Any] = {}
    for key in ("u1", "u2", "n", "home"):
        if key not in pair.constants.values:
            continue
        value = pair.constants.values[key]
        if key in symbolic:
            found[key] = tuple(sympy.Symbol(f"{key}_{axis}", real=True) for axis in "xyz"[: len(value)])
        else:
            found[key] = exact_axis(value) if key == "n" else tuple(map(exact, value))
    return found


def exact_axis(n: tuple[float, ...]) -> tuple[Expr, ...]:
    """The axis of length 1 with rational squares that rounds to n, if there is a simple one; else n as written."""
    squares = [Fraction(c * c).limit_denominator(_MAX_SQUARE) for c in n]
    roots = tuple(
        sympy.sign(c) * sympy.sqrt(sympy.Rational(square.numerator, square.denominator))
        for c, square in zip(map(exact, n), squares, strict=True)
    )
    near = all(float(root) == c for root, c in zip(roots, n, strict=True))
    return roots if near and sum(squares) == 1 else tuple(map(exact, n))
