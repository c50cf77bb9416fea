"""Closed forms: the equations over SymPy expressions in t, each result in the shorter of two forms.

Every step of a plan is taken twice: over expressions as they come, and over trigonometric sums, in which products of
sines and cosines are multiplied out and turned into sums of sines and cosines. Of each component the form with fewer
letters goes on to the next step; the sum where they are equal.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.coordinates import exact
from hingepair.errors import ArgumentError
from hingepair.jets import SYMPY_ERRORS, Expr, Jet, JetProgram, time_symbol
from hingepair.kinematics import COORDINATES, PARTS, PLANAR_PARTS
from hingepair.pair import HingePair
from hingepair.plan import PLANAR, SPATIAL, Plan, check_outputs, make_plan, outputs_of
from hingepair.planar import PlanarPair
from hingepair.scene import Scene
from hingepair.trig_sums import TooManyTermsError, TrigSum, cosine, cosine_sum, sine, sine_sum, trig_sum

PLANAR_COORDINATES = ("x", "y", "phi", "psi")
SYMBOLIC = ("u1", "u2", "n")
"""What can stay a letter."""

MAX_LETTERS: Final = 50_000
"""Letters in one component, each time it is written: what takes longer to print than anybody reads."""
_MAX_RATE_LETTERS = 2_000
_MAX_SQUARE = 1_000  # the largest denominator of a squared axis component that is taken for exact
_ANGLES = frozenset(("phi", "psi", "phi1", "angles", "phi2"))


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
        if name.startswith("_") or name not in self.names:
            raise AttributeError(f"Derivation has no {name!r}; it has t, {', '.join(self.names)}")
        import sympy

        parts = [sympy.Add(*terms) for terms in self.terms(name)]
        tail = outputs_of(self._forms.kind)[name].tail
        return parts[0] if not tail else sympy.ImmutableMatrix(tail[0], len(parts) // tail[0], parts)

    def __dir__(self) -> list[str]:
        return ["names", "t", "terms", *self.names]

    def terms(self, name: str) -> tuple[tuple[Expr, ...], ...]:
        """The terms of each component of an output, in the order in which they arise.

        Args:
            name: one of `names`.

        Raises:
            ArgumentError: no such output, or its closed form is too long to be of use.
        """
        check_outputs((name,), self._forms.kind)
        return self._forms.terms(name)


def derive(scene_or_pair: Scene | HingePair | PlanarPair, symbolic: Iterable[str] = ()) -> Derivation:
    """The closed forms of a scene's motion, or of any motion of a pair, as SymPy expressions (E1-E11).

    Of a bare pair the coordinates are functions of t: x(t), y(t), z(t), phi_x(t), phi_y(t), phi_z(t) (XYZ), psi(t);
    of a planar pair x(t), y(t), phi(t), psi(t). Numbers are exact: a float is the number that its shortest decimal
    form writes (0.1 is 1/10), and an axis whose squared components are rational numbers with denominators up to 1000
    is that axis: (1, 1, 0) gives sqrt(2)/2. Products of sines and cosines become sums where that is no longer.

    Args:
        scene_or_pair: a Scene, a HingePair or a PlanarPair.
        symbolic: of u1, u2 and n those that stay letters: u1_x, u1_y, u1_z and so on; n is taken to have length 1.

    Returns:
        The derivation; `.omega1`, `.R2` and so on are SymPy matrices in `.t`.

    Raises:
        ArgumentError: an argument cannot be used, or an expression's derivatives are too long; names it.

    >>> pair = PlanarPair(u1=(1, 0), u2=(-1, 0))
    >>> derive(pair).R2
    Matrix([
    [x(t) + cos(phi(t)) + cos(phi(t) + psi(t))],
    [y(t) + sin(phi(t)) + sin(phi(t) + psi(t))]])
    """
    pair = scene_or_pair.pair if isinstance(scene_or_pair, Scene) else scene_or_pair
    if not isinstance(pair, HingePair | PlanarPair):
        raise ArgumentError("scene_or_pair", "a Scene, a HingePair or a PlanarPair", scene_or_pair)
    if not pair._constants.single:
        raise ArgumentError("pair", "one pair", f"pairs of shape {pair._constants.shape}")
    kind = PLANAR if isinstance(pair, PlanarPair) else SPATIAL
    if isinstance(scene_or_pair, Scene):
        jets = [closed_jet(f"motion.{key}", expr) for key, expr in scene_or_pair.expressions.items()]
        sequence = scene_or_pair.sequence
    else:
        jets, sequence = _functions(PLANAR_COORDINATES if kind == PLANAR else COORDINATES), "XYZ"
    inputs = _constants(pair, _check_symbolic(symbolic, pair)) | _motion(jets, kind)
    names = tuple(outputs_of(kind))
    return Derivation(time_symbol(), names, _Forms(kind, sequence, inputs))


class _Forms:
    """The values of a plan's steps, as expressions and as trigonometric sums; each computed once."""

    def __init__(self, kind: str, sequence: str, inputs: dict[str, Any]) -> None:
        self.kind = kind
        self.sequence = sequence if kind == SPATIAL else None
        self.home = "home" in inputs
        self.best = inputs
        self.sums: dict[str, Any] = {}
        self.order: dict[str, tuple[tuple[Expr, ...], ...]] = {}
        self.letters: dict[Expr, int] = {}

    def terms(self, name: str) -> tuple[tuple[Expr, ...], ...]:
        """The terms of each component."""
        import sympy

        exprs, sums = self._plan(name, _EXPRESSIONS), self._plan(name, _SUMS)
        for (result, function, arguments), (_, summed, _) in zip(exprs.steps, sums.steps, strict=True):
            if result not in self.best:
                built = function(*[self.best[key] for key in arguments])
                self._keep(result, _each(sympy.sympify, built), self._summed(summed, arguments))
        if name not in self.order:
            self.order[name] = tuple(sympy.Add.make_args(part) for part in _flat(self.best[name]))
        return self.order[name]

    def _plan(self, name: str, terms: Any) -> Plan:
        return make_plan((name,), self.sequence, self.home, terms, self.kind)

    def _summed(self, function: Any, arguments: tuple[str, ...]) -> Any:
        """A step over sums; None where they grow too long."""
        try:
            values = [self._sum_of(key) for key in arguments]
            return None if None in values else function(*values)
        except TooManyTermsError:
            return None

    def _sum_of(self, key: str) -> Any:
        if key not in self.sums:
            self.sums[key] = self.best[key] if key in _ANGLES else _each(trig_sum, self.best[key])
        return self.sums[key]

    def _keep(self, result: str, built: Any, summed: Any) -> None:
        """Keep the shorter form of each component."""
        import sympy

        if result in _ANGLES:
            self.best[result] = built
            return
        self.sums[result] = summed
        orders, parts = [], []
        for i, part in enumerate(_flat(built)):
            total = _flat(summed)[i] if summed is not None else None
            terms = sympy.Add.make_args(part)
            if total is not None:
                other = _sum(total).terms()
                expr = sympy.Add(*other)
                if self._count(expr) <= self._count(part):
                    part, terms = expr, other
            if self._count(part) > MAX_LETTERS:
                expected = f"an output whose components have at most {MAX_LETTERS} letters"
                raise ArgumentError("outputs", expected, f"{result} with {self._count(part)}")
            parts.append(part)
            orders.append(terms)
        self.best[result] = tuple(parts) if isinstance(built, tuple) else parts[0]
        self.order[result] = tuple(orders)

    def _count(self, expr: Expr) -> int:
        return count_letters(expr, self.letters)


def count_letters(expr: Expr, known: dict[Expr, int]) -> int:
    """How often letters stand in an expression; x(t) and its derivatives are letters, numbers are none."""
    if expr not in known:
        if not expr.args or expr.is_Derivative or _is_function_of_t(expr):
            known[expr] = 0 if expr.is_number else 1
        else:
            known[expr] = sum(count_letters(part, known) for part in expr.args)
    return known[expr]


def closed_jet(name: str, expr: Expr) -> Jet:
    """An expression in t with its first and second derivative.

    Raises:
        ArgumentError: they are too long, or none that SymPy can work with.
    """
    expected = f"an expression whose derivatives have at most {_MAX_RATE_LETTERS} letters"
    program, known = JetProgram(), dict[Expr, int]()
    meaning: dict[Expr, Expr] = {}
    try:
        jet = program.jet(expr)
        for symbol, step in program.needed([part for part in jet if part.is_Symbol]):
            whole = meaning[symbol] = step.xreplace(meaning)
            if count_letters(whole, known) > _MAX_RATE_LETTERS:
                raise ArgumentError(name, expected, f"{count_letters(whole, known)}")
        return expr, jet[1].xreplace(meaning), jet[2].xreplace(meaning)
    except ArgumentError:
        raise
    except SYMPY_ERRORS:
        raise ArgumentError(name, expected, "one that SymPy cannot differentiate") from None


def _functions(names: tuple[str, ...]) -> list[Jet]:
    import sympy

    t = time_symbol()
    functions = [sympy.Function(name, real=True)(t) for name in names]
    return [(f, f.diff(t), f.diff(t, 2)) for f in functions]


def _motion(jets: list[Jet], kind: str) -> dict[str, Any]:
    """The coordinates and their derivatives by the names of a plan's inputs."""
    size, parts = (2, PLANAR_PARTS) if kind == PLANAR else (3, PARTS)
    found: dict[str, Any] = {}
    for (point, angle, hinge), row in zip(parts.values(), zip(*jets, strict=True), strict=True):
        found[point] = row[:size]
        found[angle] = row[size] if kind == PLANAR else row[size : 2 * size]
        found[hinge] = row[-1]
    return found


def _check_symbolic(symbolic: Iterable[str], pair: HingePair | PlanarPair) -> tuple[str, ...]:
    known = [key for key in SYMBOLIC if hasattr(pair, key)]
    expected = f"names out of {', '.join(known)}"
    if isinstance(symbolic, str) or not isinstance(symbolic, Iterable):
        raise ArgumentError("symbolic", f"a tuple of {expected}", symbolic)
    names = tuple(symbolic)
    for name in names:
        if name not in known:
            raise ArgumentError("symbolic", expected, name)
    return names


def _constants(pair: HingePair | PlanarPair, symbolic: tuple[str, ...]) -> dict[str, Any]:
    """u1, u2, n and home as exact numbers or letters."""
    import sympy

    found: dict[str, Any] = {}
    for key, value in pair._constants.values.items():
        if key in symbolic:
            found[key] = tuple(sympy.Symbol(f"{key}_{axis}", real=True) for axis in "xyz"[: len(value)])
        else:
            found[key] = exact_axis(value) if key == "n" else tuple(map(exact, value))
    return found


def exact_axis(n: tuple[float, ...]) -> tuple[Expr, ...]:
    """The axis of length 1 with rational squares that rounds to n, if there is a simple one; else n as written."""
    import sympy

    squares = [Fraction(c * c).limit_denominator(_MAX_SQUARE) for c in n]
    roots = tuple(
        sympy.sign(c) * sympy.sqrt(sympy.Rational(square.numerator, square.denominator))
        for c, square in zip(map(exact, n), squares, strict=True)
    )
    near = all(float(root) == c for root, c in zip(roots, n, strict=True))
    return roots if near and sum(squares) == 1 else tuple(map(exact, n))


def _is_function_of_t(expr: Expr) -> bool:
    from sympy.core.function import AppliedUndef

    return isinstance(expr, AppliedUndef)


def _each(change: Any, value: Any) -> Any:
    return tuple(map(change, value)) if isinstance(value, tuple) else change(value)


def _flat(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _sum(value: TrigSum | Expr | int) -> TrigSum:
    import sympy

    return value if isinstance(value, TrigSum) else trig_sum(sympy.sympify(value))


def _angle_terms(phi: tuple[Expr, ...]) -> tuple[Expr, ...]:
    return tuple(function(angle) for angle in phi for function in (sine, cosine))


def _hinge_terms(psi: Expr) -> tuple[Expr, Expr]:
    return sine(psi), 1 - cosine(psi)


def _angle_sums(phi: tuple[Expr, ...]) -> tuple[TrigSum, ...]:
    return tuple(function(angle) for angle in phi for function in (sine_sum, cosine_sum))


def _hinge_sums(psi: Expr) -> tuple[TrigSum, TrigSum]:
    return sine_sum(psi), 1 - cosine_sum(psi)


_EXPRESSIONS = (_angle_terms, _hinge_terms)
_SUMS = (_angle_sums, _hinge_sums)
