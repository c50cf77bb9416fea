"""Closed forms of a pair: the equations evaluated on SymPy expressions in t, each result in the shorter of two forms.

After every equation, products of sines and cosines are converted to sums of sines and cosines. The form of each
component with fewer symbols is kept. Where both have equally many, the sum is displayed, and the next step uses the
product, since a product of products is more readable than a product of sums.
"""

from __future__ import annotations

import itertools
import keyword
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any, Final, TypeAlias

import sympy

from hingepair.errors import ArgumentError
from hingepair.mechanism.pairs.geometry import check_single_pair, constants_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.requests import ROWS
from hingepair.numeric.blocks import components
from hingepair.numeric.names import Names
from hingepair.plans.arguments import check_outputs
from hingepair.plans.pairs import PLANE, SPACE, PairKind, point_outputs, unit_among
from hingepair.symbolic.exact_constants import exact, exact_entry
from hingepair.symbolic.exact_expressions import derivatives, time_symbol
from hingepair.symbolic.kinks import Expr, real_symbol
from hingepair.symbolic.pair_equations import Equation as PairEquation
from hingepair.symbolic.pair_equations import equations_of, point_vector, result_of
from hingepair.symbolic.printers import (
    count_symbols,
    latex_name,
    sorted_terms,
    to_latex,
    to_text,
    with_short_constants,
    with_symbols,
)
from hingepair.symbolic.trig_sums import trig_sum
from hingepair.symbolic.written_forms import (
    Equation,
    Equations,
    Function,
    WrittenForms,
    common_parts,
    shape_text,
)

# Names that are in use in generated functions, and words of Python and C.
_TAKEN_NAMES: Final = (
    *("t", "numpy", "float", "parts", "part", "shape", "__debug__", "out", "double", "const", "void", "NAN"),
    *keyword.kwlist,
    *("auto", "case", "char", "default", "do", "enum", "extern", "goto", "inline", "int", "long", "register"),
    *("restrict", "short", "signed", "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned"),
    *("volatile", "main", "j0", "j1", "jn", "y0", "y1", "yn", "gamma"),
)

SumTerms: TypeAlias = tuple[Expr, ...]
"""Terms of a sum, or components of a constant."""

MAX_COMPONENT_SYMBOLS: Final = 5_000
"""Largest number of symbols in a component, with repetition; a longer one is not readable."""
SYMBOLIC_CONSTANTS: Final = ("u1", "u2", "n")
"""Constants of a pair that can stay symbols."""
_CONSTANTS: Final = (*SYMBOLIC_CONSTANTS, "home")  # all constants of a pair


class Derivation(WrittenForms):
    """Closed forms of a pair's motion (E1-E11) as functions of t, written as text, LaTeX, Python or SymPy source.

    The outputs are attributes: `R2`, `S2`, `d`, `v2`, `omega2`, `a2`, `alpha2`, and `R1`, `S1`, `v1`, `omega1`, `a1`,
    `alpha1`, and of a point `tip` also `tip`, `tip_v`, `tip_a`; of a planar pair those that `names` lists. Each is an
    immutable SymPy matrix, (3, 1) or (3, 3). Vectors of a planar pair are (2, 1), and its angles, angular velocities
    and accelerations are expressions. An output is derived at the first access; intermediate results are kept.

    Args:
        pair: one pair; its numbers are made exact as `hingepair.derive` describes.
        motion: coordinates as expressions in t, by name. A coordinate that is missing or None is an unspecified
            function of t. By default all are.
        sequence: sequence of the Euler angles; ignored in the plane.
        symbolic: names of constants, out of u1, u2 and n, that stay symbols; n counts as having length 1.
        exact_values: exact components of u1, u2, n (of length 1), home and points, by name, where they are known.

    Raises:
        ArgumentError: `pair` holds more than one pair, or the derivatives of a coordinate are too long.
    """

    __slots__ = ("_display_forms", "_equations_by_result", "_planar", "_points", "_working_forms")
    _writers = to_text, str, to_latex
    _abbreviated = False

    def __init__(
        self,
        pair: HingePair | PlanarPair,
        motion: Mapping[str, Expr | None] | None = None,
        sequence: str | None = "XYZ",
        symbolic: Collection[str] = (),
        exact_values: Mapping[str, SumTerms] | None = None,
    ) -> None:
        check_single_pair(pair)
        self._planar, self._points = isinstance(pair, PlanarPair), constants_of(pair).points
        given = {name: expr for name, expr in (motion or {}).items() if expr is not None}
        written = {key: tuple(map(sympy.sympify, exprs)) for key, exprs in (exact_values or {}).items()}
        renamed = self._distinct_constants([*given.values(), *sum(written.values(), ())], given, symbolic)
        coordinates = [
            derivatives(name, given[name].xreplace(renamed)) if name in given else _unknown_function(name)
            for name in self.kind.coordinates
        ]
        written = {key: tuple(expr.xreplace(renamed) for expr in exprs) for key, exprs in written.items()}
        constants = constant_inputs(pair, symbolic, written)
        self._equations_by_result: dict[str, PairEquation] = equations_of(
            None if self._planar else sequence, "home" in constants, self._points
        )
        self._working_forms: dict[str, Any] = constants | dict(zip(ROWS, zip(*coordinates, strict=True), strict=True))
        self._display_forms: dict[str, tuple[Expr, ...]] = {}

    @property
    def t(self) -> Expr:
        """The SymPy symbol of time [s]."""
        return time_symbol()

    @property
    def kind(self) -> PairKind:
        """Kind of motion of the pair, PLANE or SPACE."""
        return PLANE if self._planar else SPACE

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the closed forms."""
        return (*self.kind.levels, *point_outputs(self._points))

    def _shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of an output."""
        shape = self.kind.shapes.get(name)
        return (3 - self._planar,) if shape is None else shape

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # while a copy is being made
            raise AttributeError(name)
        if name not in self.names:
            raise AttributeError(f"{type(self).__name__} has no {name!r}; it has t, {', '.join(self.names)}")
        parts = [sympy.Add(*terms) for terms in self.terms(name)]
        tail = self._shape(name)
        return parts[0] if not tail else sympy.ImmutableMatrix(tail[0], len(parts) // tail[0], parts)

    def __dir__(self) -> list[str]:
        return [*object.__dir__(self), *self.names]

    def __repr__(self) -> str:
        return f"{type(self).__name__} of {', '.join(self.names)}"

    def labels(self, name: str) -> list[str]:
        """Return the labels of the components of the output called `name`: omega1_x, S2_xy, phi2."""
        places = map("".join, itertools.product("xyz"[: 3 - self._planar], repeat=len(self._shape(name))))
        return [f"{name}_{place}" if place else name for place in places]

    def _distinct_constants(
        self, exprs: Iterable[Expr], given: Collection[str], symbolic: Collection[str]
    ) -> dict[Expr, Expr]:
        """Return the symbols that replace the constants in expressions of a scene; names in use get an underscore.
        `given` are the names of the coordinates, `symbolic` those of the pair's constants that are symbols.
        """
        used = ["t", *(label for name in self.names for label in self.labels(name))]
        used += [name + "d" * order for name in self.kind.coordinates if name not in given for order in range(3)]
        used += [f"{key}_{axis}" for key in symbolic for axis in "xyz"]
        names = Names(used, latex_name)
        constants = set().union(*(expr.free_symbols for expr in exprs)) - {time_symbol()}
        taken = names.take_all(sorted(symbol.name for symbol in constants))
        return {symbol: real_symbol(taken[symbol.name]) for symbol in constants}

    def terms(self, name: str) -> tuple[SumTerms, ...]:
        """Return the components of the output called `name`, each as the terms of its sum in the order of display.

        Raises:
            ArgumentError: no such output, or its closed form is too long to be of use.
        """
        check_outputs((name,), self.names)
        result_name = name if name in self.kind.levels else result_of(name)
        value = self._working_form(result_name)
        return tuple(map(sorted_terms, self._display_forms.get(result_name, components(value))))

    def _working_form(self, result: str) -> Any:
        """Return a quantity in the form that further equations use."""
        if result not in self._working_forms:
            function, arguments = self._equations_by_result[result]
            value = function(*map(self._working_form, arguments))
            keep = (
                result in ("angles", "phi2")  # sums of angles
                or bool({*arguments} & {*ROWS})
                or isinstance(components(value)[0], tuple)
            )
            self._working_forms[result] = value if keep else self._shorten(result, value)
        return self._working_forms[result]

    def _shorten(self, result_name: str, value: Any) -> Any:
        """Return a result in the form that further steps use, and store the form that is displayed."""
        pairs = [self._choose_forms(sympy.sympify(part)) for part in components(value)]
        longest = max(count_symbols(working) for working, _ in pairs)
        if longest > MAX_COMPONENT_SYMBOLS:
            expected = f"an output whose components have at most {MAX_COMPONENT_SYMBOLS} symbols"
            raise ArgumentError("outputs", expected, f"{result_name} with {longest}")
        working, self._display_forms[result_name] = zip(*pairs, strict=True)
        return working if isinstance(value, tuple) else working[0]

    def _choose_forms(self, expr: Expr) -> tuple[Expr, Expr]:
        """Return the forms for further steps and for display: the expression or its trig_sum, the shorter one."""
        as_sum = trig_sum(expr)
        if as_sum is None:
            return expr, expr
        gain = count_symbols(expr) - count_symbols(as_sum)
        return as_sum if gain > 0 else expr, as_sum if gain >= 0 else expr

    def _components(self, names: Iterable[str] | None) -> Iterator[tuple[str, Expr]]:
        for name in self.names if names is None else names:
            for label, terms in zip(self.labels(name), self.terms(name), strict=True):
                yield label, sympy.Add(*terms)

    def _equations(self, names: Iterable[str] | None, short: bool) -> Equations:  # noqa: ARG002
        """Return an equation for each component."""
        labels, exprs = zip(*self._components(names), strict=True)
        shown = with_symbols(map(with_short_constants, exprs), "'")
        return Equations([Equation((label,), expr) for label, expr in zip(labels, shown, strict=True)])

    def _functions(self, names: Iterable[str] | None) -> Iterator[Function]:
        for name in self.names if names is None else names:
            unit = unit_among(self.names, name)
            yield _function(name, f" [{unit}]" if unit != "1" else "", [e for _, e in self._components((name,))])


def _function(name: str, unit: str, component_exprs: list[Expr]) -> Function:
    """Return the function that computes an output, with a unit, from t and the symbols of its components."""
    t = time_symbol()
    expressions = with_symbols([*map(with_short_constants, component_exprs), t], "d")[:-1]
    symbols = set().union(*(part.free_symbols for part in expressions)) - {t}
    names = Names(_TAKEN_NAMES).take_all(sorted(symbol.name for symbol in symbols))
    expressions = [part.xreplace({s: real_symbol(names[s.name]) for s in symbols}) for part in expressions]
    symbol_names = sorted(names.values())
    has_time = any(t in part.free_symbols for part in expressions) or not symbol_names
    tail = {1: (), 9: (3, 3)}.get(len(component_exprs), (len(component_exprs),))
    shapes = f"the arguments broadcast, shape (...) gives {shape_text(tail)}"
    return Function(name, unit, shapes, ["t"] * has_time + symbol_names, *common_parts(expressions), tail)


def _unknown_function(name: str) -> tuple[Expr, Expr, Expr]:
    """Return a coordinate as an unspecified function of t, with its first and second derivative."""
    t = time_symbol()
    function = sympy.Function(name, real=True)(t)
    return function, function.diff(t), function.diff(t, 2)


def constant_inputs(
    pair: HingePair | PlanarPair, symbolic: Collection[str], exact_values: Mapping[str, SumTerms]
) -> dict[str, SumTerms]:
    """Return the pair's constants as expressions: symbols, `exact_values`, or exact numbers made of its floats."""
    inputs: dict[str, SumTerms] = {}
    constants = constants_of(pair)
    names = [key for key in _CONSTANTS if key in constants.arrays and (key != "home" or constants.has_home)]
    for key in names:
        value = tuple(constants.arrays[key].ravel().tolist())
        if key in symbolic:
            inputs[key] = tuple(sympy.Symbol(f"{key}_{axis}", real=True) for axis in "xyz"[: len(value)])
        elif key in exact_values:
            inputs[key] = exact_values[key]
        else:
            inputs[key] = exact_axis(value) if key == "n" else tuple(map(exact, value))
    for name, position in {**pair.points1, **pair.points2}.items():
        point = point_vector(name)
        inputs[point] = exact_values[point] if point in exact_values else tuple(map(exact, position.tolist()))
    return inputs


def exact_axis(n: tuple[float, ...]) -> tuple[Expr, ...]:
    """Return a unit axis as roots of simple fractions if they equal its components within rounding, otherwise as the
    numbers that the shortest decimals show.
    """
    roots = tuple(map(exact_entry, n))
    return roots if sum(root**2 for root in roots) == 1 else tuple(map(exact, n))
