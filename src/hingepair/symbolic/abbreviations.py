"""Abbreviations of repeated functions in the closed forms of a pair: c_1, s_12, k_1."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence

import sympy

from hingepair.numeric.names import Names
from hingepair.symbolic.exact_expressions import time_symbol
from hingepair.symbolic.kinks import Expr, SideOfZero, real_symbol
from hingepair.symbolic.printers import is_simple, latex_name
from hingepair.symbolic.written_forms import Equation, Equations


def abbreviated(rows: Sequence[Equation]) -> Equations:
    """Return the equations with symbols in place of repeated functions, and the definitions of these symbols."""
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
