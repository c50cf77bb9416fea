"""Closed forms written as text, LaTeX, NumPy source and SymPy source: what those of pairs and of robots share."""

from __future__ import annotations

import itertools
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import sympy

from hingepair.numeric.names import Names
from hingepair.symbolic.kinks import Expr, real_symbol
from hingepair.symbolic.printers import (
    Writer,
    is_simple,
    join_terms,
    latex_name,
    signed_terms,
    to_sympy_source,
    to_text,
)

_INDENT = " " * 6  # of continued lines of text
_MAX_LATEX = 90  # characters of the terms, as plain text, in a line of LaTeX


class Equation(NamedTuple):
    """Equal components and the terms of their sum, in the order of display."""

    labels: tuple[str, ...]
    terms: tuple[Expr, ...]


class Equations(NamedTuple):
    """Equations with what stands above them."""

    rows: Sequence[Equation]
    #: meanings of abbreviations, by their names; groups that share a line
    definitions: Sequence[Mapping[str, Expr]] = ()
    notes: Sequence[str] = ()


class WrittenForms(ABC):
    """Base class of closed forms, whose methods write them."""

    __slots__ = ()
    #: writers of text, of the names of components in text, and of LaTeX
    _writers: tuple[Writer, Callable[[str], str], Writer]
    #: whether repeated terms are abbreviated unless `short` says otherwise
    _abbreviated: bool

    @abstractmethod
    def _equations(self, names: Iterable[str] | None, short: bool) -> Equations:
        """Return the equations of the named outputs, of all for None."""

    @abstractmethod
    def _components(self, names: Iterable[str] | None) -> Iterable[tuple[str, Expr]]:
        """Yield label and expression of every component of the named outputs, of all for None."""

    @abstractmethod
    def _module(self, names: Iterable[str] | None, title: str) -> list[str]:
        """Return the head of a NumPy module, and the sources of its functions."""

    def to_text(self, names: Iterable[str] | None = None, *, short: bool | None = None, width: int = 100) -> str:
        """Return the equations as text, one for each component: `omega1_x = 3 + 5 sin t`; derivatives by t are x',
        x''. Equal components of a robot share a line, and those that are 0 stand in the last one.

        Args:
            names: names of outputs, out of `names`; None for all.
            short: whether terms that are repeated are abbreviated (k_1); by default those of robots (c_1, s_12).
            width: largest number of characters of a line; longer equations go on in the next.

        Raises:
            ArgumentError: an unknown output, or one whose closed form is too long.
        """
        write, write_name, _ = self._writers
        sheet = self._equations(names, self._abbreviated if short is None else short)
        lines = [*sheet.notes]
        lines += ["; ".join(f"{name} = {write(expr)}" for name, expr in group.items()) for group in sheet.definitions]
        for labels, terms in sheet.rows:
            lines.append(f"{' = '.join(map(write_name, labels))} = {join_terms(terms, write)}")
        return "".join(f"{wrap_equation(line, width)}\n" for line in lines if line)

    def to_latex(self, names: Iterable[str] | None = None, *, short: bool | None = None) -> str:
        r"""Return the equations as a LaTeX align* environment (amsmath); the arguments are those of `to_text`."""
        write = self._writers[2]
        sheet = self._equations(names, self._abbreviated if short is None else short)
        meanings = [item for group in sheet.definitions for item in group.items()]
        lines = [f"{latex_name(name)} &= {write(expr)}" for name, expr in meanings]
        for labels, terms in sheet.rows:
            lines += _latex_lines(labels, terms, write)
        notes = "".join(f"% {docstring_text(note)}\n" for note in sheet.notes)
        return (
            f"{notes}\\begin{{align*}}  % \\usepackage{{amsmath}}\n  " + " \\\\\n  ".join(lines) + "\n\\end{align*}\n"
        )

    def to_python(self, names: Iterable[str] | None = None, title: str = "") -> str:
        """Return the source of a Python module that needs only NumPy, with one vectorised function for each output.

        The arguments of the functions of a pair are t and the symbols: constants, coordinates such as x, phi_x, psi,
        their rates xd, phi_xd, psid, and so on. Those of a robot are q, or q and qd; symbols of points have the
        robot's numbers as defaults.

        Args:
            names: names of outputs, out of `names`; None for all.
            title: stands in the docstring of the module.

        Raises:
            ArgumentError: an unknown output, or one whose closed form is too long.
        """
        return "\n\n".join(self._module(names, title))

    def to_sympy(self, names: Iterable[str] | None = None) -> dict[str, str]:
        """Return the components as text that `sympy.sympify` reads, by their labels, such as omega1_x or S2_xy.

        Choices are Piecewise, and symbols have no assumptions.

        Args:
            names: names of outputs, out of `names`; None for all.

        Raises:
            ArgumentError: an unknown output, or one whose closed form is too long.
        """
        return {label: to_sympy_source(expr) for label, expr in self._components(names)}


def abbreviated(rows: Sequence[Equation]) -> Equations:
    """Return the equations with symbols k_1, k_2 and so on in place of repeated terms, and what they mean."""
    terms = [term for row in rows for term in row.terms]
    names = Names((symbol.name for term in terms for symbol in term.free_symbols), latex_name)
    letters = (name for name in (f"k_{i}" for i in itertools.count(1)) if names.free(name))
    repeated, short_terms = sympy.cse(terms, symbols=(sympy.Dummy(real=True) for _ in itertools.count()))
    shown: dict[Expr, Expr] = {}
    definitions = []
    for symbol, expr in repeated:
        meaning = expr.xreplace(shown)
        if _is_short(meaning):
            shown[symbol] = meaning
        else:
            letter = next(letters)
            shown[symbol] = real_symbol(letter)
            definitions.append({letter: meaning})
    remaining = iter(term.xreplace(shown) for term in short_terms)
    return Equations(
        [row._replace(terms=tuple(itertools.islice(remaining, len(row.terms)))) for row in rows], definitions
    )


def _is_short(expr: Expr) -> bool:
    """Return whether a term is a number or as short as 3t, -x or 2 sin 3t, and so needs no letter."""
    factor = expr.as_coeff_Mul()[1]
    is_wave = isinstance(factor, sympy.sin | sympy.cos) and factor.free_symbols == {real_symbol("t")}
    return bool(not expr.free_symbols or factor.is_Symbol or (is_wave and is_simple(factor.args[0])))


def function_source(
    name: str,
    description: str,
    arguments: Sequence[str],
    steps: Sequence[str],
    results: Sequence[str],
    shape: str,
    tail: tuple[int, ...],
    numbers: Sequence[str] = (),
) -> str:
    """Return the source of a NumPy function that computes the components of an output.

    Args:
        name: of the function.
        description: stands in its docstring after the name.
        arguments: names of those that broadcast.
        steps: `name = expression`, in the order of computation.
        results: expressions of the components, row by row.
        shape: expression of the leading axes of the result.
        tail: its other axes.
        numbers: further arguments, `name=value`.
    """
    width = max(len(results) // tail[0], 1) if tail else 1
    lines = [
        f'"""{name}{description}"""',
        *(f"{argument} = numpy.asarray({argument}, dtype=float)" for argument in arguments),
        *steps,
        "parts = (",
        *(f"    {', '.join(results[i : i + width])}," for i in range(0, len(results), width)),
        ")",
        f"shape = {shape}",
        "parts = [numpy.broadcast_to(part, shape) for part in parts]",
        f"return numpy.stack(parts, axis=-1).reshape(shape + {tail})",
    ]
    return f"def {name}({', '.join((*arguments, *numbers))}):\n" + "".join(f"    {line}\n" for line in lines)


def wrap_equation(line: str, width: int) -> str:
    """Return a line of text broken into lines of at most `width` characters where that is possible: after semicolons
    first, then before + or -, then at any space.
    """
    pieces = [line]
    for breaks in ((("; ", ";\0"),), ((" + ", "\0+ "), (" - ", "\0- ")), ((" ", "\0"),)):
        pieces = [part for piece in pieces for part in _break_line(piece, breaks, width)]
    return "\n".join(pieces)


def _break_line(line: str, breaks: Sequence[tuple[str, str]], width: int) -> list[str]:
    """Return a line broken at some texts; each comes with its copy, in which a NUL marks where it may break."""
    fixed = line.lstrip()
    for text, marked in breaks:
        fixed = fixed.replace(text, marked)
    blank = "\N{NO-BREAK SPACE}"
    pieces = textwrap.wrap(
        fixed.replace(" ", blank).replace("\0", " "),
        width,
        initial_indent=_INDENT if line.startswith(_INDENT) else "",
        subsequent_indent=_INDENT,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [piece.replace(blank, " ") for piece in pieces]


def _latex_lines(labels: Sequence[str], terms: Sequence[Expr], write: Writer) -> list[str]:
    """Return the lines of an equation, broken between terms where it is long."""
    lines: list[str] = []
    line, filled = f"{' = '.join(map(latex_name, labels))} &=", 0
    texts = [join_terms(terms[:1], write), *signed_terms(terms[1:], write)]
    for text, term in zip(texts, terms, strict=True):
        size = len(to_text(term))
        if filled + size > _MAX_LATEX and filled:
            lines.append(line)
            line, filled = "&\\quad", 0
        line += f" {text}"
        filled += size
    return [*lines, line]


def title_suffix(title: str) -> str:
    """Return a colon and the title for the first line of a module's docstring; an empty text without a title."""
    text = docstring_text(title)
    return f": {text}" if text else ""


def docstring_text(text: str) -> str:
    """Return a text as one line that a docstring or a comment can contain, without quotes and backslashes."""
    return "".join(sign for sign in " ".join(text.split()) if sign.isprintable() and sign not in '"\\')


def shape_text(tail: Sequence[int]) -> str:
    """Return the text of an array's shape.

    >>> shape_text(()), shape_text((3, 3))
    ('(...)', '(..., 3, 3)')
    """
    return f"(..., {', '.join(map(str, tail))})" if tail else "(...)"
