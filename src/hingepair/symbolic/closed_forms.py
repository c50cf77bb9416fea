"""Closed forms: the equations over SymPy expressions in t, each result in the shorter of two forms.

After every step of a plan products of sines and cosines are multiplied out and turned into sums of sines and cosines.
Of each component the form with fewer letters is kept: where they are equal, the sum is what is shown, and the other
goes on to the next step, where a product of products reads better than a product of sums.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final, TypeAlias

import sympy

from hingepair.errors import ArgumentError
from hingepair.evaluation.plan import PLANAR, SPATIAL, check_outputs, make_plan, outputs_of
from hingepair.evaluation.steps import COORDINATES, PARTS, PLANAR_COORDINATES, PLANAR_PARTS
from hingepair.pair.constants import check_one
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.symbolic import listings
from hingepair.symbolic.jets import SYMPY_ERRORS, Jet, JetProgram, time_symbol
from hingepair.symbolic.kinks import Expr
from hingepair.symbolic.printers import count_letters, in_order
from hingepair.symbolic.time_functions import exact
from hingepair.symbolic.trig_sums import cosine, sine, trig_sum

Terms: TypeAlias = tuple[Expr, ...]

MAX_LETTERS: Final = 5_000
"""Letters in one component, each time it is written: what takes longer to print than anybody reads."""
MAX_LETTERS_GIVEN: Final = 2_000
"""Letters in a derivative of a coordinate."""
SYMBOLIC: Final = ("u1", "u2", "n")
"""What of a pair can stay a letter."""
_MAX_SQUARE: Final = 1_000  # the largest denominator of a squared axis component that is taken for exact
_ANGLES: Final = frozenset(("phi", "psi", "phi1", "angles", "phi2"))


@dataclass(frozen=True, eq=False)
class Derivation:
    """The closed forms of a pair's motion: `R2`, `S2`, `d`, `v2`, `omega2`, `a2`, `alpha2`, and body 1's.

    Each is an attribute: an immutable SymPy matrix (3, 1) or (3, 3), of a planar pair (2, 1) or an expression. It is
    derived when it is first looked at.

    Attributes:
        t: the SymPy symbol of time [s].
        names: what can be derived.
    """

    t: Expr
    names: tuple[str, ...]
    _forms: _Forms

    def __getattr__(self, name: str) -> Any:
        names = self.__dict__.get("names", ())  # not there yet in a copy that is being made
        if name not in names:
            raise AttributeError(f"Derivation has no {name!r}; it has t, {', '.join(names)}")
        parts = [sympy.Add(*terms) for terms in self.terms(name)]
        tail = outputs_of(self._forms.kind)[name].tail
        return parts[0] if not tail else sympy.ImmutableMatrix(tail[0], len(parts) // tail[0], parts)

    def __dir__(self) -> list[str]:
        return [*object.__dir__(self), *self.names]

    def terms(self, name: str) -> tuple[Terms, ...]:
        """The terms of each component of an output, in the order in which they arise.

        Args:
            name: one of `names`.

        Raises:
            ArgumentError: no such output, or its closed form is too long to be of use.
        """
        check_outputs((name,), self._forms.kind)
        return self._forms.terms(name)

    def to_text(self, names: Iterable[str] | None = None, *, short: bool = False, width: int = 100) -> str:
        """One equation a component, as a paper has it: `omega1_x = 3 + 5 sin t`.

        Args:
            names: some of `names`; all unless given.
            short: whether sines, cosines and other functions that come again are abbreviated: c_1, s_12, k_1.
            width: of a line; longer equations go on in the next.

        Raises:
            ArgumentError: an unknown output, or one whose closed form is too long.
        """
        return listings.to_text(self._chosen(names), short=short, width=width)

    def to_latex(self, names: Iterable[str] | None = None, *, short: bool = False) -> str:
        r"""An align* environment of the package amsmath; derivatives of x(t) are \dot{x}. As `to_text`."""
        return listings.to_latex(self._chosen(names), short=short)

    def to_python(self, names: Iterable[str] | None = None, title: str = "") -> str:
        """A Python module that needs only NumPy, one function an output, vectorised over its arguments.

        These are t and what stayed a letter; of coordinates that are letters x, phi_x, psi, their rates xd, phi_xd,
        psid, and so on. As `to_text`.
        """
        return listings.to_python(self._chosen(names), title)

    def to_sympy(self, names: Iterable[str] | None = None) -> dict[str, str]:
        """The SymPy source of each component by its label: omega1_x, S2_xy. As `to_text`."""
        return listings.to_sympy(self._chosen(names))

    def _chosen(self, names: Iterable[str] | None) -> dict[str, tuple[Terms, ...]]:
        return {name: self.terms(name) for name in (self.names if names is None else names)}


def closed_forms(
    pair: HingePair | PlanarPair,
    motion: Mapping[str, Expr | None] | None = None,
    sequence: str | None = "XYZ",
    symbolic: Collection[str] = (),
) -> Derivation:
    """The closed forms of a pair's motion as SymPy expressions (E1-E11).

    Args:
        pair: one pair; its numbers are taken as `hingepair.derive` says.
        motion: the coordinates as expressions in t; those that are None, and all unless given, are functions of t.
        sequence: of the Euler angles.
        symbolic: of u1, u2 and n those that stay letters; n is taken to have length 1.

    Raises:
        ArgumentError: more than one pair, or an expression's derivatives are too long; names it.
    """
    check_one(pair)
    kind = PLANAR if isinstance(pair, PlanarPair) else SPATIAL
    names = PLANAR_COORDINATES if kind == PLANAR else COORDINATES
    given = motion or {}
    jets = [_jet(name, given.get(name)) for name in names]
    inputs = constant_inputs(pair, symbolic) | motion_inputs(jets, kind)
    return Derivation(time_symbol(), tuple(outputs_of(kind)), _Forms(kind, sequence, inputs))


class _Forms:
    """The values of a plan's steps, each computed once: those to go on with, and those to show."""

    def __init__(self, kind: str, sequence: str | None, inputs: dict[str, Any]) -> None:
        self.kind = kind
        self.sequence = sequence if kind == SPATIAL else None
        self.home = "home" in inputs
        self.best = inputs
        self.shown: dict[str, tuple[Expr, ...]] = {}
        self.letters: dict[Expr, int] = {}

    def terms(self, name: str) -> tuple[Terms, ...]:
        """The terms of each component."""
        for result, function, arguments in make_plan((name,), self.sequence, self.home, _TERMS, self.kind).steps:
            if result not in self.best:
                built = function(*[self.best[key] for key in arguments])
                plain = result in _ANGLES or any(isinstance(part, tuple) for part in _flat(built))
                self.best[result] = built if plain else self._shortened(result, built)
        return tuple(map(in_order, self.shown.get(name, _flat(self.best[name]))))

    def _shortened(self, result: str, built: Any) -> Any:
        """Each component in its shorter form."""
        pairs = [self._forms(sympy.sympify(part)) for part in _flat(built)]
        longest = max(self._count(kept) for kept, _ in pairs)
        if longest > MAX_LETTERS:
            expected = f"an output whose components have at most {MAX_LETTERS} letters"
            raise ArgumentError("outputs", expected, f"{result} with {longest}")
        kept, self.shown[result] = zip(*pairs, strict=True)
        return kept if isinstance(built, tuple) else kept[0]

    def _forms(self, built: Expr) -> tuple[Expr, Expr]:
        """What to go on with, and what to show."""
        summed = trig_sum(built)
        gain = -1 if summed is None else self._count(built) - self._count(summed)
        return summed if gain > 0 else built, summed if gain >= 0 else built

    def _count(self, expr: Expr) -> int:
        return count_letters(expr, self.letters)


def _jet(name: str, expr: Expr | None) -> Jet:
    """A coordinate with its first and second derivative: an expression in t, or else a letter."""
    if expr is None:
        t = time_symbol()
        function = sympy.Function(name, real=True)(t)
        return function, function.diff(t), function.diff(t, 2)
    expected = f"an expression whose derivatives have at most {MAX_LETTERS_GIVEN} letters"
    program, known = JetProgram(), dict[Expr, int]()
    meaning: dict[Expr, Expr] = {}
    try:
        jet = program.jet(expr)
        for symbol, step in program.needed([part for part in jet if part.is_Symbol]):
            whole = meaning[symbol] = step.xreplace(meaning)
            if count_letters(whole, known) > MAX_LETTERS_GIVEN:
                raise ArgumentError(name, expected, f"{count_letters(whole, known)}")
        return expr, jet[1].xreplace(meaning), jet[2].xreplace(meaning)
    except ArgumentError:
        raise
    except SYMPY_ERRORS:
        raise ArgumentError(name, expected, "one that SymPy cannot differentiate") from None


def motion_inputs(jets: list[Jet], kind: str) -> dict[str, Any]:
    """The coordinates and their derivatives by the names of a plan's inputs."""
    size, parts = (2, PLANAR_PARTS) if kind == PLANAR else (3, PARTS)
    found: dict[str, Any] = {}
    for (point, angle, hinge), row in zip(parts.values(), zip(*jets, strict=True), strict=True):
        found[point] = row[:size]
        found[angle] = row[size] if kind == PLANAR else row[size : 2 * size]
        found[hinge] = row[-1]
    return found


def constant_inputs(pair: HingePair | PlanarPair, symbolic: Collection[str]) -> dict[str, Any]:
    """u1, u2, n and home as exact numbers or letters."""
    found: dict[str, Any] = {}
    given = pair.constants.values
    for key, value in ((key, given[key]) for key in ("u1", "u2", "n", "home") if key in given):
        if key in symbolic:
            found[key] = tuple(sympy.Symbol(f"{key}_{axis}", real=True) for axis in "xyz"[: len(value)])
        else:
            found[key] = exact_axis(value) if key == "n" else tuple(map(exact, value))
    return found


def exact_axis(n: tuple[float, ...]) -> tuple[Expr, ...]:
    """The axis of length 1 with rational squares that rounds to n, if there is a simple one; else n as written."""
    squares = [Fraction(c * c).limit_denominator(_MAX_SQUARE) for c in n]
    roots = tuple(
        sympy.sign(exact(c)) * sympy.sqrt(sympy.Rational(square)) for c, square in zip(n, squares, strict=True)
    )
    near = all(float(root) == c for root, c in zip(roots, n, strict=True))
    return roots if near and sum(squares) == 1 else tuple(map(exact, n))


def _flat(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _angle_terms(phi: tuple[Expr, ...]) -> tuple[Expr, ...]:
    return tuple(function(angle) for angle in phi for function in (sine, cosine))


def _hinge_terms(psi: Expr) -> tuple[Expr, Expr]:
    return sine(psi), 1 - cosine(psi)


_TERMS: Final = (_angle_terms, _hinge_terms)
