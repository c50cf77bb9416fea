"""Output of closed forms: one line per component in mathematical notation, LaTeX, or a Python module with NumPy."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable

import sympy

from hingepair.equations.quantities import unit_of
from hingepair.numeric.names import Names
from hingepair.symbolic.closed_forms import ClosedForms, SumTerms
from hingepair.symbolic.exact_expressions import time_symbol
from hingepair.symbolic.kinks import Expr, SideOfZero, real_symbol
from hingepair.symbolic.layout import align_environment, latex_lines, shape_text, title_suffix, wrap_equation
from hingepair.symbolic.printers import (
    is_simple,
    join_terms,
    latex_name,
    sorted_terms,
    to_latex,
    to_numpy_source,
    to_sympy_source,
    to_text,
    with_short_constants,
    with_symbols,
)

_PYTHON_NAMES = ("t", "numpy", "float", "parts", "__debug__")  # in the functions of Derivation.to_python


class Derivation(ClosedForms):
    """Closed forms of a pair's motion, with output as text, LaTeX, Python and SymPy source.

    The outputs are attributes: `R2`, `S2`, `d`, `v2`, `omega2`, `a2`, `alpha2`, and `R1`, `S1`, `v1`, `omega1`, `a1`,
    `alpha1`; of a planar pair those that `names` lists. Each is an immutable SymPy matrix, (3, 1) or (3, 3). Vectors
    of a planar pair are (2, 1), and its angles, angular velocities and accelerations are expressions. An output is
    derived at the first access.
    """

    __slots__ = ()

    def to_text(self, names: Iterable[str] | None = None, *, short: bool = False, width: int = 100) -> str:
        """Return the equations of the outputs named in `names`, all by default, as text, one equation per component:
        `omega1_x = 3 + 5 sin t`. With `short`, repeated functions are abbreviated; lines have at most `width`
        characters. Raise an ArgumentError for an unknown output, or one whose form is too long.

        First derivatives are written x', second derivatives x''.

        Args:
            names: names of outputs, out of `names`; None for all.
            short: whether sines, cosines and other repeated functions are abbreviated: c_1, s_12, k_1.
            width: largest number of characters of a line; longer equations go on in the next.

        Raises:
            ArgumentError: an unknown output, or one whose closed form is too long.
        """
        rows, meanings = _abbreviated_rows(self._labelled_terms(names), short)
        definitions = [f"{name} = {to_text(expr)}" for name, expr in meanings.items()]
        lines = ["; ".join(definitions)] if definitions else []
        lines += [f"{label} = {join_terms(terms, to_text)}" for label, terms in rows]
        return "".join(f"{wrap_equation(line, width)}\n" for line in lines)

    def to_latex(self, names: Iterable[str] | None = None, *, short: bool = False) -> str:
        r"""Return the equations of the outputs named in `names`, all by default, as the text of a LaTeX align*
        environment (amsmath). With `short`, repeated functions are abbreviated; the derivative of x(t) is written
        \dot{x}. Raise an ArgumentError for an unknown output, or one whose form is too long.
        """
        rows, meanings = _abbreviated_rows(self._labelled_terms(names), short)
        lines = [f"{latex_name(name)} &= {to_latex(expr)}" for name, expr in meanings.items()]
        for label, terms in rows:
            lines += latex_lines(label, terms, to_latex)
        return align_environment(lines)

    def to_python(self, names: Iterable[str] | None = None, title: str = "") -> str:
        """Return the source of a Python module that needs only NumPy, with one vectorised function for each output
        named in `names`, all by default. `title` is put into its docstring. Raise an ArgumentError for an unknown
        output.

        The arguments are t and the symbols: constants, coordinates such as x, phi_x, psi, their rates xd, phi_xd,
        psid, and so on.
        """
        parts = [f'"""Closed forms{title_suffix(title)}."""\n\nimport numpy\n']
        for name in self.names if names is None else names:
            parts.append(_function_source(name, [sympy.Add(*terms) for terms in self.terms(name)]))
        return "\n\n".join(parts)

    def to_sympy(self, names: Iterable[str] | None = None) -> dict[str, str]:
        """Return a dict from labels such as omega1_x or S2_xy to the text of the component's expression, which
        `sympy.sympify` reads, for the outputs named in `names`, all by default. Raise an ArgumentError for an unknown
        output.

        Choices are Piecewise, and symbols have no assumptions.
        """
        return {label: to_sympy_source(sympy.Add(*terms)) for label, terms in self._labelled_terms(names)}

    def _labelled_terms(self, names: Iterable[str] | None) -> list[tuple[str, SumTerms]]:
        """Return a list of (label, terms) for all components of the outputs in `names`, an iterable of names or None
        for all outputs. A label is, for example, omega1_x; the terms are a tuple of expressions.
        """
        labelled_terms = []
        for name in self.names if names is None else names:
            parts = self.terms(name)
            labelled_terms += list(zip(self.labels(name), parts, strict=True))
        return labelled_terms


def _abbreviated_rows(
    labelled_terms: list[tuple[str, SumTerms]], short: bool
) -> tuple[list[tuple[str, SumTerms]], dict[str, Expr]]:
    """Return (rows, definitions) for `labelled_terms`, a list of (label, terms of a sum). The rows are a copy of this
    list with sorted terms and short constants, in which symbols replace functions of t. If `short`, repeated
    functions are abbreviated too, and the dict `definitions` maps each abbreviation's name to its expression;
    otherwise it is empty.
    """
    rows = [
        (label, tuple(with_symbols(sorted_terms(with_short_constants(sympy.Add(*terms))), "'")))
        for label, terms in labelled_terms
    ]
    if not short:
        return rows, {}
    symbols_of = _abbreviations([term for _, terms in rows for term in terms])
    short_rows = [(label, tuple(term.xreplace(symbols_of) for term in terms)) for label, terms in rows]
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

    define(sympy.Tuple(*[term for _, terms in short_rows for term in terms]))
    return short_rows, definitions


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
    """Return the Python source of a NumPy function called `name`. The function computes an output whose components
    are the expressions in the list `component_exprs`.
    """
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
    all_arguments = ", ".join(arguments)
    lines = [
        f"def {name}({all_arguments}):",
        f'    """{name}{unit}; the arguments broadcast, shape (...) gives {shape_text(tail)}."""',
        *(f"    {argument} = numpy.asarray({argument}, dtype=float)" for argument in arguments),
        *(f"    {symbol} = {to_numpy_source(step)}" for symbol, step in steps),
        "    parts = (",
        *(f"        {to_numpy_source(result)}," for result in results),
        "    )",
        f"    parts = numpy.broadcast_arrays(*parts, {all_arguments})[:{len(component_exprs)}]",
        f"    return numpy.stack(parts, axis=-1).reshape(parts[0].shape + {tail})",
    ]
    return "\n".join(lines) + "\n"
