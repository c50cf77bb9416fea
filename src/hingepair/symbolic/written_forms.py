"""Closed forms written as text, LaTeX, NumPy source and SymPy source: what those of pairs and of robots share."""

from __future__ import annotations

import itertools
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
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
    sorted_terms,
    to_c_source,
    to_numpy_source,
    to_sympy_source,
    to_text,
)

_INDENT = " " * 6  # of continued lines of text
_MAX_LATEX = 90  # characters of the terms, as plain text, in a line of LaTeX


class Equation(NamedTuple):
    """Equal components and their expression."""

    labels: tuple[str, ...]
    expr: Expr


class Equations(NamedTuple):
    """Equations with what stands above them."""

    rows: Sequence[Equation]
    #: meanings of symbols, by their names; groups that share a line
    definitions: Sequence[Mapping[str, Expr]] = ()
    notes: Sequence[str] = ()


class Function(NamedTuple):
    """A function of floats, in Python or C, that computes the components of one output."""

    name: str
    #: text behind the name
    description: str
    #: clause on the shapes of arrays
    shapes: str
    arguments: Sequence[str]
    #: values by name, each of which may use earlier ones
    steps: Sequence[tuple[str, Expr]]
    results: Sequence[Expr]
    #: axes of the output
    shape: tuple[int, ...]
    #: arguments that are vectors, with their components
    vectors: Mapping[str, Sequence[str]] = MappingProxyType({})
    #: further arguments, with their values
    numbers: Mapping[str, float] = MappingProxyType({})


class WrittenForms(ABC):
    """Base class of closed forms, whose methods write them."""

    __slots__ = ()
    #: writers of text, of the names of components in text, and of LaTeX
    _writers: tuple[Writer, Callable[[str], str], Writer]
    #: whether repeated terms are abbreviated unless `short` says otherwise
    _abbreviated: bool
    #: whether the names of symbols order the terms of a sum
    _by_symbols = False

    @abstractmethod
    def _equations(self, names: Iterable[str] | None, short: bool) -> Equations:
        """Return the equations of the named outputs, of all for None; if they will be shortened, in symbols that
        shorten them.
        """

    @abstractmethod
    def _components(self, names: Iterable[str] | None) -> Iterable[tuple[str, Expr]]:
        """Yield label and expression of every component of the named outputs, of all for None."""

    @abstractmethod
    def _functions(self, names: Iterable[str] | None) -> Iterable[Function]:
        """Yield a function for each of the named outputs, of all for None."""

    def _heading(self, title: str) -> Sequence[str]:
        """Return the title and notes that stand above functions."""
        return [f"Closed forms{title_suffix(title)}."]

    def _sheet(self, names: Iterable[str] | None, short: bool | None) -> Equations:
        shortened = self._abbreviated if short is None else short
        sheet = self._equations(names, shortened)
        return abbreviated(sheet) if shortened else sheet

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
        sheet = self._sheet(names, short)
        lines = [*sheet.notes]
        lines += ["; ".join(f"{name} = {write(expr)}" for name, expr in group.items()) for group in sheet.definitions]
        for labels, expr in sheet.rows:
            lines.append(
                f"{' = '.join(map(write_name, labels))} = {join_terms(sorted_terms(expr, self._by_symbols), write)}"
            )
        return "".join(f"{wrap_equation(line, width)}\n" for line in lines if line)

    def to_latex(self, names: Iterable[str] | None = None, *, short: bool | None = None) -> str:
        r"""Return the equations as a LaTeX align* environment (amsmath); the arguments are those of `to_text`."""
        write = self._writers[2]
        sheet = self._sheet(names, short)
        meanings = [item for group in sheet.definitions for item in group.items()]
        lines = [f"{latex_name(name)} &= {write(expr)}" for name, expr in meanings]
        for labels, expr in sheet.rows:
            lines += _latex_lines(labels, sorted_terms(expr, self._by_symbols), write)
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
        first, *notes = self._heading(title)
        text = "\n".join((first, "", *notes)) + "\n" if notes else first
        return "\n\n".join([f'"""{text}"""\n\nimport numpy\n', *map(_python_source, self._functions(names))])

    def to_c(self, names: Iterable[str] | None = None, title: str = "") -> str:
        """Return C source (C99) with a function `void NAME(arguments, double out[])` for each output. It takes one
        state, with the arguments of `to_python`, and writes the components of the output to `out`, row by row.

        Args:
            names: names of outputs, out of `names`; None for all.
            title: stands in the comment at the top.

        Raises:
            ArgumentError: an unknown output, or one whose closed form is too long.
        """
        lines = [line for text in self._heading(title) for line in text.replace("*/", "* /").splitlines()]
        comment = "\n * ".join(lines)
        return "\n".join([f"/* {comment} */\n\n#include <math.h>\n", *map(_c_source, self._functions(names))])

    def to_sympy(self, names: Iterable[str] | None = None) -> dict[str, str]:
        """Return the components as text that `sympy.sympify` reads, by their labels, such as omega1_x or S2_xy.

        Choices are Piecewise, and symbols have no assumptions.

        Args:
            names: names of outputs, out of `names`; None for all.

        Raises:
            ArgumentError: an unknown output, or one whose closed form is too long.
        """
        return {label: to_sympy_source(expr) for label, expr in self._components(names)}


def abbreviated(sheet: Equations) -> Equations:
    """Return the equations with symbols k_1, k_2 and so on in place of repeated terms, and what they mean."""
    exprs = [row.expr for row in sheet.rows]
    names = Names((symbol.name for expr in exprs for symbol in expr.free_symbols), latex_name)
    letters = (name for name in (f"k_{i}" for i in itertools.count(1)) if names.free(name))
    repeated, short_exprs = sympy.cse(exprs, symbols=(sympy.Dummy(real=True) for _ in itertools.count()))
    shown: dict[Expr, Expr] = {}
    definitions = [*sheet.definitions]
    for symbol, expr in repeated:
        meaning = expr.xreplace(shown)
        if _is_short(meaning):
            shown[symbol] = meaning
        else:
            letter = next(letters)
            shown[symbol] = real_symbol(letter)
            definitions.append({letter: meaning})
    rows = [Equation(row.labels, expr.xreplace(shown)) for row, expr in zip(sheet.rows, short_exprs, strict=True)]
    return Equations(rows, definitions, sheet.notes)


def _is_short(expr: Expr) -> bool:
    """Return whether a term is a number or as short as 3t, -x or 2 sin 3t, and so needs no letter."""
    factor = expr.as_coeff_Mul()[1]
    is_wave = isinstance(factor, sympy.sin | sympy.cos) and factor.free_symbols == {real_symbol("t")}
    return bool(not expr.free_symbols or factor.is_Symbol or (is_wave and is_simple(factor.args[0])))


def common_parts(exprs: Sequence[Expr]) -> tuple[list[tuple[str, Expr]], list[Expr]]:
    """Return values w0, w1 and so on, each of which may use earlier ones, and the expressions in terms of these."""
    used = set().union(*(expr.free_symbols for expr in exprs))
    names = sympy.numbered_symbols("w", exclude=used, real=True)
    steps, results = sympy.cse(exprs, symbols=names, order="none", list=True)
    return [(symbol.name, step) for symbol, step in steps], results


def _python_source(function: Function) -> str:
    """Return the source of a NumPy function."""
    name, description, shapes, arguments, steps, results, tail, vectors, numbers = function
    width = max(len(results) // tail[0], 1) if tail else 1
    texts = [*map(to_numpy_source, results)]
    places = [
        f"{part} = {vector}[..., {i}]" for vector, parts in vectors.items() for i, part in enumerate(parts) if part
    ]
    if vectors:
        shape = f"numpy.broadcast_shapes({', '.join(f'{v}.shape' for v in vectors)})[:-1]"
    else:
        shape = f"numpy.broadcast({', '.join(arguments)}).shape"
    lines = [
        f'"""{name}{description}; {shapes}."""',
        *(f"{argument} = numpy.asarray({argument}, dtype=float)" for argument in arguments),
        *places,
        *(f"{symbol} = {to_numpy_source(step)}" for symbol, step in steps),
        "parts = (",
        *(f"    {', '.join(texts[i : i + width])}," for i in range(0, len(texts), width)),
        ")",
        f"shape = {shape}",
        "parts = [numpy.broadcast_to(part, shape) for part in parts]",
        f"return numpy.stack(parts, axis=-1).reshape(shape + {tail})",
    ]
    defaults = [f"{symbol}={value!r}" for symbol, value in numbers.items()]
    return f"def {name}({', '.join((*arguments, *defaults))}):\n" + "".join(f"    {line}\n" for line in lines)


def _c_source(function: Function) -> str:
    """Return the source of a C function, which computes one state."""
    name, description, _, arguments, steps, results, _, vectors, numbers = function
    taken = [
        f"const double {argument}[{len(vectors[argument])}]" if argument in vectors else f"double {argument}"
        for argument in arguments
    ]
    lines = [f"const double {symbol} = {value!r};" for symbol, value in numbers.items()]
    lines += [
        f"const double {part} = {v}[{i}];" for v, parts in vectors.items() for i, part in enumerate(parts) if part
    ]
    lines += [f"const double {symbol} = {to_c_source(step)};" for symbol, step in steps]
    lines += [f"out[{i}] = {to_c_source(result)};" for i, result in enumerate(results)]
    body = "".join(f"    {line}\n" for line in lines)
    taken.append(f"double out[{len(results)}]")
    return f"/* {name}{description} */\nvoid {name}({', '.join(taken)})\n{{\n{body}}}\n"


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
