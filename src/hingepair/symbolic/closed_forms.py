"""Closed forms: the equations over SymPy expressions in t, each result in the shorter of two forms.

After every step of a plan products of sines and cosines are multiplied out and turned into sums of sines and cosines.
Of each component the form with fewer letters is kept: where they are equal, the sum is what is shown, and the other
goes on to the next step, where a product of products reads better than a product of sums.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from fractions import Fraction
from typing import Any, Final, TypeAlias

import sympy

from hingepair.engine.loops import components
from hingepair.errors import ArgumentError
from hingepair.pair.constants import check_one
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.plans.plan import PLANAR, SPATIAL, Kind, check_outputs, make_plan
from hingepair.symbolic.exact_constants import exact
from hingepair.symbolic.jets import SYMPY_ERRORS, Jet, JetProgram, time_symbol
from hingepair.symbolic.kinks import Expr
from hingepair.symbolic.printers import count_letters, in_order
from hingepair.symbolic.trig_sums import cosine, sine, trig_sum

Terms: TypeAlias = tuple[Expr, ...]

MAX_LETTERS: Final = 5_000
"""Letters in one component, each time it is written: what takes longer to print than anybody reads."""
MAX_LETTERS_GIVEN: Final = 2_000
"""Letters in a derivative of a coordinate."""
SYMBOLIC: Final = ("u1", "u2", "n")
"""What of a pair can stay a letter."""
PAIR_CONSTANTS: Final = ("u1", "u2", "n", "home")
"""Constants of a pair that closed forms hold."""
_MAX_SQUARE: Final = 1_000  # the largest denominator of a squared axis component that is taken for exact
_ROWS: Final = ("q", "qd", "qdd")
_ANGLES: Final = ("angles", "phi2")


class ClosedForms:
    """The closed forms of a pair's motion (E1-E11): attributes `R2`, `S2`, `d`, `v2` and so on, and those of body 1.

    Each is an immutable SymPy matrix (3, 1) or (3, 3), of a planar pair (2, 1) or an expression. It is derived when
    it is first looked at, and what other forms need of it is kept.

    Args:
        pair: one pair; its numbers are taken as `hingepair.derive` says.
        motion: the coordinates as expressions in t; those that are None, and all unless given, are functions of t.
        sequence: of the Euler angles.
        symbolic: of u1, u2 and n those that stay letters; n is taken to have length 1.
        written: exact values of u1, u2, n (of length 1) and home, where they are known; components by name.

    Raises:
        ArgumentError: more than one pair, or an expression's derivatives are too long; names it.
    """

    __slots__ = ("_best", "_home", "_planar", "_sequence", "_shown")

    def __init__(
        self,
        pair: HingePair | PlanarPair,
        motion: Mapping[str, Expr | None] | None = None,
        sequence: str | None = "XYZ",
        symbolic: Collection[str] = (),
        written: Mapping[str, Terms] | None = None,
    ) -> None:
        check_one(pair)
        self._planar = isinstance(pair, PlanarPair)
        jets = [_jet(name, (motion or {}).get(name)) for name in self.kind.coordinates]
        constants = constant_inputs(pair, symbolic, written or {})
        self._sequence = None if self._planar else sequence
        self._home = "home" in constants
        self._best: dict[str, Any] = constants | dict(zip(_ROWS, zip(*jets, strict=True), strict=True))
        self._shown: dict[str, tuple[Expr, ...]] = {}

    @property
    def t(self) -> Expr:
        """The SymPy symbol of time [s]."""
        return time_symbol()

    @property
    def kind(self) -> Kind:
        """PLANAR or SPATIAL."""
        return PLANAR if self._planar else SPATIAL

    @property
    def names(self) -> tuple[str, ...]:
        """What can be derived."""
        return tuple(self.kind.levels)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # of a copy that is being made
            raise AttributeError(name)
        if name not in self.names:
            raise AttributeError(f"{type(self).__name__} has no {name!r}; it has t, {', '.join(self.names)}")
        parts = [sympy.Add(*terms) for terms in self.terms(name)]
        tail = self.kind.shapes[name]
        return parts[0] if not tail else sympy.ImmutableMatrix(tail[0], len(parts) // tail[0], parts)

    def __dir__(self) -> list[str]:
        return [*object.__dir__(self), *self.names]

    def __repr__(self) -> str:
        return f"{type(self).__name__} of {', '.join(self.names)}"

    def terms(self, name: str) -> tuple[Terms, ...]:
        """The terms of each component of an output, in the order in which they arise.

        Args:
            name: one of `names`.

        Raises:
            ArgumentError: no such output, or its closed form is too long to be of use.
        """
        check_outputs((name,), self.kind.levels)
        plan = make_plan((name,), self._sequence, self._home, _TERMS, self.kind, _ROWS)
        for result, function, arguments in plan.steps:
            if result not in self._best:
                built = function(*[self._best[key] for key in arguments])
                plain = result in _ANGLES or bool({*arguments} & {*_ROWS}) or isinstance(components(built)[0], tuple)
                self._best[result] = built if plain else self._shortened(result, built)
        return tuple(map(in_order, self._shown.get(name, components(self._best[name]))))

    def _shortened(self, result: str, built: Any) -> Any:
        """Each component in its shorter form: those to go on with; those to show are kept aside."""
        pairs = [self._forms(sympy.sympify(part)) for part in components(built)]
        longest = max(count_letters(kept) for kept, _ in pairs)
        if longest > MAX_LETTERS:
            expected = f"an output whose components have at most {MAX_LETTERS} letters"
            raise ArgumentError("outputs", expected, f"{result} with {longest}")
        kept, self._shown[result] = zip(*pairs, strict=True)
        return kept if isinstance(built, tuple) else kept[0]

    def _forms(self, built: Expr) -> tuple[Expr, Expr]:
        """What to go on with, and what to show."""
        summed = trig_sum(built)
        if summed is None:
            return built, built
        gain = count_letters(built) - count_letters(summed)
        return summed if gain > 0 else built, summed if gain >= 0 else built


def _jet(name: str, expr: Expr | None) -> Jet:
    """A coordinate with its first and second derivative: an expression in t, or else a letter."""
    if expr is None:
        t = time_symbol()
        function = sympy.Function(name, real=True)(t)
        return function, function.diff(t), function.diff(t, 2)
    expected = f"an expression whose derivatives have at most {MAX_LETTERS_GIVEN} letters"
    program = JetProgram()
    meaning: dict[Expr, Expr] = {}
    try:
        jet = program.jet(expr)
        for symbol, step in program.needed([part for part in jet if part.is_Symbol]):
            whole = meaning[symbol] = step.xreplace(meaning)
            if count_letters(whole) > MAX_LETTERS_GIVEN:
                raise ArgumentError(name, expected, f"{count_letters(whole)}")
        return expr, jet[1].xreplace(meaning), jet[2].xreplace(meaning)
    except ArgumentError:
        raise
    except SYMPY_ERRORS:
        raise ArgumentError(name, expected, "one that SymPy cannot differentiate") from None


def constant_inputs(
    pair: HingePair | PlanarPair, symbolic: Collection[str], written: Mapping[str, Terms]
) -> dict[str, Terms]:
    """Return u1, u2, n and home, those that the pair has, as letters, as they were written, or as exact numbers."""
    inputs: dict[str, Terms] = {}
    values = pair.constants.values
    for key, value in ((key, values[key]) for key in PAIR_CONSTANTS if key in values):
        if key in symbolic:
            inputs[key] = tuple(sympy.Symbol(f"{key}_{axis}", real=True) for axis in "xyz"[: len(value)])
        elif key in written:
            inputs[key] = written[key]
        else:
            inputs[key] = exact_axis(value) if key == "n" else tuple(map(exact, value))
    return inputs


def exact_axis(n: tuple[float, ...]) -> tuple[Expr, ...]:
    """The axis of length 1 with rational squares beside n, if there is a simple one; else n as written.

    A component may be off by its last place: 0.3 is taken for 3/10, as everywhere in closed forms, and n was not.
    """
    squares = [Fraction(c * c).limit_denominator(_MAX_SQUARE) for c in n]
    roots = tuple(
        sympy.sign(exact(c)) * sympy.sqrt(sympy.Rational(square)) for c, square in zip(n, squares, strict=True)
    )
    near = all(abs(float(root) - c) <= 2 * math.ulp(c) for root, c in zip(roots, n, strict=True))
    return roots if near and sum(squares) == 1 else tuple(map(exact, n))


def _angle_terms(phi: tuple[Expr, ...]) -> tuple[Expr, ...]:
    return tuple(function(angle) for angle in phi for function in (sine, cosine))


def _hinge_terms(psi: Expr) -> tuple[Expr, Expr]:
    return sine(psi), 1 - cosine(psi)


_TERMS: Final = (_angle_terms, _hinge_terms)
