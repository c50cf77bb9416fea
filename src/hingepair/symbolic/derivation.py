"""Output of closed forms: one line per component in mathematical notation, LaTeX, or a Python module with NumPy."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

import sympy

from hingepair.equations.quantities import unit_of
from hingepair.numeric.names import Names
from hingepair.symbolic.closed_forms import ClosedForms
from hingepair.symbolic.exact_expressions import time_symbol
from hingepair.symbolic.kinks import Expr, SideOfZero, real_symbol
from hingepair.symbolic.printers import (
    is_simple,
    latex_name,
    sorted_terms,
    to_latex,
    to_numpy_source,
    to_text,
    with_short_constants,
    with_symbols,
)
from hingepair.symbolic.written_forms import (
    Equation,
    Equations,
    WrittenForms,
    function_source,
    shape_text,
    title_suffix,
)

_PYTHON_NAMES = (
    "t",
    "numpy",
    "float",
    "parts",
    "part",
    "shape",
    "__debug__",
)  # in the functions of Derivation.to_python


class Derivation(ClosedForms, WrittenForms):
    """Closed forms of a pair's motion, with output as text, LaTeX, Python and SymPy source.

    The outputs are attributes: `R2`, `S2`, `d`, `v2`, `omega2`, `a2`, `alpha2`, and `R1`, `S1`, `v1`, `omega1`, `a1`,
    `alpha1`; of a planar pair those that `names` lists. Each is an immutable SymPy matrix, (3, 1) or (3, 3). Vectors
    of a planar pair are (2, 1), and its angles, angular velocities and accelerations are expressions. An output is
    derived at the first access.
    """

    __slots__ = ()
    writers = to_text, str, to_latex
    abbreviated = False

    def _components(self, names: Iterable[str] | None) -> Iterator[tuple[str, Expr]]:
        for name in self.names if names is None else names:
            for label, terms in zip(self.labels(name), self.terms(name), strict=True):
                yield label, sympy.Add(*terms)

    def _equations(self, names: Iterable[str] | None, short: bool) -> Equations:
        rows = [
            Equation((label,), tuple(with_symbols(sorted_terms(with_short_constants(expr)), "'")))
            for label, expr in self._components(names)
        ]
        return _abbreviated(rows) if short else Equations(rows)

    def _module(self, names: Iterable[str] | None, title: str) -> list[str]:
        head = f'"""Closed forms{title_suffix(title)}."""\n\nimport numpy\n'
        chosen = self.names if names is None else names
        return [head, *(_function_source(name, [expr for _, expr in self._components((name,))]) for name in chosen)]


def _abbreviated(rows: Sequence[Equation]) -> Equations:
    """Return the equations with symbols in place of repeated functions, and the meanings of these."""
    symbols_of = _abbreviations([term for row in rows for term in row.terms])
    short_rows = [Equation(labels, tuple(term.xreplace(symbols_of) for term in terms)) for labels, terms in rows]
    meanings = {
        symbol: function.func(*[part.xreplace(symbols_of) for part in function.args])
        if function.free_symbols
        else function
        for function, symbol in symbols_of.items()
    }
    definitions: dict[str, Expr] = {}

    def define(expr: Expr) -> None:
        """Add the definitions of the symbols in an expression to the dict `definitions`. Each definition follows the
        definitions that it uses.
        """
        for symbol in sorted(expr.free_symbols & meanings.keys(), key=lambda a: (a.name[2:].zfill(9), a.name)):
            if symbol.name not in definitions:
                define(meanings[symbol])  # definitions that it needs come first
                definitions[symbol.name] = meanings[symbol]

    define(sympy.Tuple(*[term for row in short_rows for term in row.terms]))
    return Equations(short_rows, [definitions])


def _abbreviations(terms: list[Expr]) -> dict[Expr, Expr]:
    """Return a dict from the functions that occur in terms to the symbols that abbreviate them: c_1 and s_1 for an
    angle, c_12 for the sum of two, k_1 for other functions that occur repeatedly.

    Sines and cosines such as sin t and cos 3t, and functions that occur once, are not abbreviated.
    """
    counts: Counter[Expr] = Counter()
    for term in terms:
        counts.update(part for part in sympy.preorder_traversal(term) if isinstance(part, sympy.Function))
    waves = [f for f in counts if isinstance(f, sympy.sin | sympy.cos) and not _is_short_wave(f)]
    names = Names((symbol.name for term in terms for symbol in term.free_symbols), latex_name)
    indices: dict[Expr, str] = {}
    count = 0
    for angle in sorted({f.args[0] for f in waves}, key=lambda angle: (angle.is_Add, angle.sort_key())):
        parts = [indices.get(part, "") for part in sympy.Add.make_args(angle)]
        index = ("" if count < 10 else ",").join(sorted(parts)) if len(parts) > 1 and all(parts) else ""
        while not index or not names.free(f"c_{index}", f"s_{index}"):
            count += 1
            index = str(count)
        indices[angle] = index
        names.take_all((f"c_{index}", f"s_{index}"))
    trig_symbols = {f: real_symbol(f"{f.func.__name__[0]}_{indices[f.args[0]]}") for f in waves}
    others = [f for f in counts if counts[f] > 1 and not isinstance(f, sympy.sin | sympy.cos | SideOfZero)]
    others.sort(key=lambda f: (-counts[f], f.sort_key()))
    free = (name for name in (f"k_{i}" for i in itertools.count(1)) if names.free(name))
    return dict(zip(others, map(real_symbol, free), strict=False)) | trig_symbols


def _is_short_wave(wave: Expr) -> bool:
    """Return whether a sine or cosine is as short as sin t or cos 3t, and so needs no abbreviation."""
    return is_simple(wave.args[0]) and wave.free_symbols == {time_symbol()}


def _function_source(name: str, component_exprs: list[Expr]) -> str:
    """Return the source of a NumPy function that computes an output from t and the symbols of its components."""
    t = time_symbol()
    expressions = with_symbols([*map(with_short_constants, component_exprs), t], "d")[:-1]
    symbols = set().union(*(part.free_symbols for part in expressions)) - {t}
    names = Names(_PYTHON_NAMES).take_all(sorted(symbol.name for symbol in symbols))
    expressions = [part.xreplace({s: real_symbol(names[s.name]) for s in symbols}) for part in expressions]
    symbol_names = sorted(names.values())
    arguments = (
        ["t", *symbol_names]
        if any(t in part.free_symbols for part in expressions) or not symbol_names
        else symbol_names
    )
    reserved = [sympy.Symbol(name_of_symbol, real=True) for name_of_symbol in symbol_names]
    temporary = sympy.numbered_symbols("w", exclude=reserved, real=True)
    steps, results = sympy.cse(expressions, symbols=temporary, order="none", list=True)
    tail = {1: (), 9: (3, 3)}.get(len(component_exprs), (len(component_exprs),))
    unit = f" [{unit_of(name)}]" if unit_of(name) != "1" else ""
    return function_source(
        name,
        f"{unit}; the arguments broadcast, shape (...) gives {shape_text(tail)}.",
        arguments=arguments,
        steps=[f"{symbol} = {to_numpy_source(step)}" for symbol, step in steps],
        results=[to_numpy_source(result) for result in results],
        shape=f"numpy.broadcast({', '.join(arguments)}).shape",
        tail=tail,
    )
