"""Closed forms: the equations over SymPy expressions in t, each result in the shorter of two forms.

Every step of a plan is taken twice: over expressions as they come, and over trigonometric sums, in which products of
sines and cosines are multiplied out and turned into sums of sines and cosines. Of each component the form with fewer
letters is kept: where they are equal, the sum is what is shown, and the other goes on to the next step, where a
product of products reads better than a product of sums.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import sympy

from hingepair.errors import ArgumentError, quoted
from hingepair.evaluation.plan import PLANAR, SPATIAL, Plan, check_outputs, make_plan, outputs_of
from hingepair.pair.constants import check_one
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.scenes.scene import Scene
from hingepair.symbolic.form_inputs import (
    any_motion,
    check_symbolic,
    closed_jet,
    constant_inputs,
    motion_inputs,
)
from hingepair.symbolic.jets import Expr, time_symbol
from hingepair.symbolic.printers import count_letters, in_order
from hingepair.symbolic.trig_sums import TooManyTermsError, TrigSum, cosine, cosine_sum, sine, sine_sum, trig_sum

Terms: TypeAlias = tuple[Expr, ...]

MAX_LETTERS: Final = 5_000
"""Letters in one component, each time it is written: what takes longer to print than anybody reads."""
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
        parts = [sympy.Add(*terms) for terms in self.terms(name)]
        tail = outputs_of(self._forms.kind)[name].tail
        return parts[0] if not tail else sympy.ImmutableMatrix(tail[0], len(parts) // tail[0], parts)

    def __dir__(self) -> list[str]:
        return ["names", "t", "terms", *self.names]

    def terms(self, name: str) -> tuple[Terms, ...]:
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

    >>> import hingepair as hp
    >>> pair = hp.PlanarPair(u1=(1, 0), u2=(-1, 0))
    >>> hp.derive(pair).R2
    Matrix([
    [x(t) + cos(phi(t) + psi(t)) + cos(phi(t))],
    [y(t) + sin(phi(t) + psi(t)) + sin(phi(t))]])
    """
    pair = scene_or_pair.pair if isinstance(scene_or_pair, Scene) else scene_or_pair
    if not isinstance(pair, HingePair | PlanarPair):
        raise ArgumentError("scene_or_pair", "a Scene, a HingePair or a PlanarPair", quoted(scene_or_pair))
    check_one(pair)
    kind = PLANAR if isinstance(pair, PlanarPair) else SPATIAL
    sequence: str | None = "XYZ"
    if isinstance(scene_or_pair, Scene):
        jets = [closed_jet(f"motion.{key}", expr) for key, expr in scene_or_pair.expressions.items()]
        sequence = scene_or_pair.sequence
    else:
        jets = any_motion(kind)
    inputs = constant_inputs(pair, check_symbolic(symbolic, pair)) | motion_inputs(jets, kind)
    names = tuple(outputs_of(kind))
    return Derivation(time_symbol(), names, _Forms(kind, sequence, inputs))


class _Forms:
    """The values of a plan's steps, as expressions and as trigonometric sums; each computed once."""

    def __init__(self, kind: str, sequence: str | None, inputs: dict[str, Any]) -> None:
        self.kind = kind
        self.sequence = sequence if kind == SPATIAL else None
        self.home = "home" in inputs
        self.best = inputs
        self.sums: dict[str, Any] = {}
        self.order: dict[str, tuple[Terms | None, ...]] = {}
        self.letters: dict[Expr, int] = {}

    def terms(self, name: str) -> tuple[Terms, ...]:
        """The terms of each component."""
        exprs, sums = self._plan(name, _EXPRESSIONS), self._plan(name, _SUMS)
        for (result, function, arguments), (_, summed, _) in zip(exprs.steps, sums.steps, strict=True):
            if result not in self.best:
                built = function(*[self.best[key] for key in arguments])
                self._keep(result, _each(sympy.sympify, built), self._summed(summed, arguments))
        parts = _flat(self.best[name])
        orders = self.order.get(name, (None,) * len(parts))
        return tuple(order or in_order(part) for order, part in zip(orders, parts, strict=True))

    def _plan(self, name: str, terms: Any) -> Plan:
        return make_plan((name,), self.sequence, self.home, terms, self.kind)

    def _summed(self, function: Any, arguments: tuple[str, ...]) -> Any:
        """A step over sums; None where they grow too long."""
        values = [self._sum_of(key) for key in arguments]
        return None if any(value is None for value in values) else _bounded(lambda: function(*values))

    def _sum_of(self, key: str) -> Any:
        if key not in self.sums:
            value = self.best[key]
            self.sums[key] = value if key in _ANGLES else _bounded(lambda: _each(trig_sum, value))
        return self.sums[key]

    def _keep(self, result: str, built: Any, summed: Any) -> None:
        """Keep the shorter form of each component."""
        if result in _ANGLES:
            self.best[result] = built
            return
        self.sums[result] = summed
        parts, orders = [], []
        for i, part in enumerate(_flat(built)):
            total = None if summed is None else _flat(summed)[i].terms()
            kept, terms = self._shorter(part, total)
            if self._count(kept) > MAX_LETTERS:
                expected = f"an output whose components have at most {MAX_LETTERS} letters"
                raise ArgumentError("outputs", expected, f"{result} with {self._count(kept)}")
            parts.append(kept)
            orders.append(terms)
        self.best[result] = tuple(parts) if isinstance(built, tuple) else parts[0]
        self.order[result] = tuple(orders)

    def _shorter(self, built: Expr, total: Terms | None) -> tuple[Expr, Terms | None]:
        """What to go on with, and the terms to show where these have an order."""
        if total is None:
            return built, None
        summed = sympy.Add(*total)
        gain = self._count(built) - self._count(summed)
        return summed if gain > 0 else built, total if gain >= 0 else None

    def _count(self, expr: Expr) -> int:
        return count_letters(expr, self.letters)


def _bounded(compute: Callable[[], Any]) -> Any:
    """What a computation gives, or None where its sums grow too long."""
    try:
        return compute()
    except TooManyTermsError:
        return None


def _each(change: Any, value: Any) -> Any:
    return tuple(map(change, value)) if isinstance(value, tuple) else change(value)


def _flat(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


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
