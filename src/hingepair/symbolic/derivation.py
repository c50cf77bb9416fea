"""Closed forms written out: a line a component as a paper has it, LaTeX, or a Python module that needs only NumPy."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable

import sympy

from hingepair.numeric.tables import unit_of
from hingepair.symbolic.closed_forms import ClosedForms, Terms
from hingepair.symbolic.jets import time_symbol
from hingepair.symbolic.kinks import Expr, Side
from hingepair.symbolic.layout import align, heading, latex_lines, shape_text, wrapped
from hingepair.symbolic.printers import (
    LATEX,
    PYTHON,
    SYMPY,
    TEXT,
    in_order,
    is_simple,
    joined,
    latex_name,
    lettered,
    with_short_constants,
)


class Derivation(ClosedForms):
    """The closed forms of a pair's motion, and how to write them out.

    `R2`, `S2`, `d`, `v2`, `omega2`, `a2`, `alpha2` and body 1's are attributes: immutable SymPy matrices (3, 1) or
    (3, 3), of a planar pair (2, 1) or expressions. Each is derived when it is first looked at.
    """

    __slots__ = ()

    def to_text(self, names: Iterable[str] | None = None, *, short: bool = False, width: int = 100) -> str:
        """One equation a component, as a paper has it: `omega1_x = 3 + 5 sin t`; derivatives of x(t) are x', x''.

        Args:
            names: some of `names`; all unless given.
            short: whether sines, cosines and other functions that come again are abbreviated: c_1, s_12, k_1.
            width: of a line; longer equations go on in the next.

        Raises:
            ArgumentError: an unknown output, or one whose closed form is too long.
        """
        rows, meanings = _rows(self._labelled(names), short)
        told = [f"{name} = {TEXT(expr)}" for name, expr in meanings.items()]
        lines = ["; ".join(told)] if told else []
        lines += [f"{label} = {joined(terms, TEXT)}" for label, terms in rows]
        return "".join(f"{wrapped(line, width)}\n" for line in lines)

    def to_latex(self, names: Iterable[str] | None = None, *, short: bool = False) -> str:
        r"""An align* environment of the package amsmath; derivatives of x(t) are \dot{x}. As `to_text`."""
        rows, meanings = _rows(self._labelled(names), short)
        lines = [f"{latex_name(name)} &= {LATEX(expr)}" for name, expr in meanings.items()]
        for label, terms in rows:
            lines += latex_lines(label, terms, LATEX)
        return align(lines)

    def to_python(self, names: Iterable[str] | None = None, title: str = "") -> str:
        """A Python module that needs only NumPy, one function an output, vectorised over its arguments.

        These are t and what stayed a letter; of coordinates that are letters x, phi_x, psi, their rates xd, phi_xd,
        psid, and so on. As `to_text`.
        """
        parts = [f'"""Closed forms{heading(title)}."""\n\nimport numpy\n']
        for name in self.names if names is None else names:
            parts.append(_function(name, [sympy.Add(*terms) for terms in self.terms(name)]))
        return "\n\n".join(parts)

    def to_sympy(self, names: Iterable[str] | None = None) -> dict[str, str]:
        """Return the SymPy source of each component, which `sympy.sympify` reads, by its label: omega1_x, S2_xy.

        Choices are Piecewise, and symbols have no assumptions. As `to_text`.
        """
        return {label: SYMPY(sympy.Add(*terms)) for label, terms in self._labelled(names)}

    def _labelled(self, names: Iterable[str] | None) -> list[tuple[str, Terms]]:
        """The terms of every component with its label."""
        found = []
        for name in self.names if names is None else names:
            parts = self.terms(name)
            places = map("".join, itertools.product("xyz", repeat=len(self.kind.shapes[name])))
            labels = (f"{name}_{place}" if place else name for place in places)
            found += list(zip(labels, parts, strict=False))
        return found


def _rows(labelled: list[tuple[str, Terms]], short: bool) -> tuple[list[tuple[str, Terms]], dict[str, Expr]]:
    """The components, letters for functions of t, and what further letters abbreviate."""
    rows = [
        (label, tuple(lettered(in_order(with_short_constants(sympy.Add(*terms))), "'"))) for label, terms in labelled
    ]
    if not short:
        return rows, {}
    letters = _abbreviations([term for _, terms in rows for term in terms])
    found = [(label, tuple(term.xreplace(letters) for term in terms)) for label, terms in rows]
    meanings = {
        letter: whole.func(*[part.xreplace(letters) for part in whole.args]) if whole.free_symbols else whole
        for whole, letter in letters.items()
    }
    told: dict[str, Expr] = {}

    def tell(expr: Expr) -> None:
        for letter in sorted(expr.free_symbols & meanings.keys(), key=lambda a: (a.name[2:].zfill(9), a.name)):
            if letter.name not in told:
                tell(meanings[letter])  # first what it is made of
                told[letter.name] = meanings[letter]

    tell(sympy.Tuple(*[term for _, terms in found for term in terms]))
    return found, told


def _abbreviations(terms: list[Expr]) -> dict[Expr, Expr]:
    """Letters for functions: c_1 and s_1 of an angle, c_12 of the sum of the first and second, k_1 of others.

    Sines and cosines of t and 3t are short as they are, and so is what stands but once.
    """
    often: Counter[Expr] = Counter()
    for term in terms:
        often.update(part for part in sympy.preorder_traversal(term) if isinstance(part, sympy.Function))
    waves = [f for f in often if isinstance(f, sympy.sin | sympy.cos) and not _is_short(f)]
    places: dict[Expr, str] = {}
    count = 0
    for angle in sorted({f.args[0] for f in waves}, key=lambda angle: (angle.is_Add, angle.sort_key())):
        parts = [places.get(part, "") for part in sympy.Add.make_args(angle)]
        if len(parts) > 1 and all(parts):
            places[angle] = ("" if count < 10 else ",").join(sorted(parts))
        else:
            count += 1
            places[angle] = str(count)
    letters = {f: _letter(f"{f.func.__name__[0]}_{places[f.args[0]]}") for f in waves}
    others = [f for f in often if often[f] > 1 and not isinstance(f, sympy.sin | sympy.cos | Side)]
    others.sort(key=lambda f: (-often[f], f.sort_key()))
    return {f: _letter(f"k_{i}") for i, f in enumerate(others, 1)} | letters


def _is_short(wave: Expr) -> bool:
    """Whether it is sin t, cos 3t and the like."""
    return is_simple(wave.args[0]) and wave.free_symbols == {time_symbol()}


def _letter(name: str) -> Expr:
    return sympy.Symbol(name, real=True)


def _function(name: str, parts: list[Expr]) -> str:
    """The source of the function of one output."""
    t = time_symbol()
    known = lettered([*map(with_short_constants, parts), t], "d")[:-1]
    letters = sorted({s.name for part in known for s in part.free_symbols} - {"t"})
    arguments = ["t", *letters] if any(t in part.free_symbols for part in known) or not letters else letters
    taken = [sympy.Symbol(letter, real=True) for letter in letters]
    temporary = sympy.numbered_symbols("w", exclude=taken, real=True)
    steps, results = sympy.cse(known, symbols=temporary, order="none", list=True)
    tail = {1: (), 9: (3, 3)}.get(len(parts), (len(parts),))
    unit = f" [{unit_of(name)}]" if unit_of(name) != "1" else ""
    every = ", ".join(arguments)
    lines = [
        f"def {name}({every}):",
        f'    """{name}{unit}; the arguments broadcast, shape (...) gives {shape_text(tail)}."""',
        *(f"    {argument} = numpy.asarray({argument}, dtype=float)" for argument in arguments),
        *(f"    {symbol} = {PYTHON(step)}" for symbol, step in steps),
        "    parts = (",
        *(f"        {PYTHON(result)}," for result in results),
        "    )",
        f"    parts = numpy.broadcast_arrays(*parts, {every})[:{len(parts)}]",
        f"    return numpy.stack(parts, axis=-1).reshape(parts[0].shape + {tail})",
    ]
    return "\n".join(lines) + "\n"
