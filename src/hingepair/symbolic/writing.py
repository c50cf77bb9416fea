"""Closed forms, kept in the shorter of two forms, as text, LaTeX, Python, C and SymPy source."""

from __future__ import annotations

import builtins
import functools
import itertools
import keyword
import math
import textwrap
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import sympy
from sympy.core.function import AppliedUndef
from sympy.printing.c import C99CodePrinter, reserved_words, reserved_words_c99
from sympy.printing.latex import LatexPrinter
from sympy.printing.numpy import NumPyPrinter
from sympy.printing.str import StrPrinter

from hingepair.errors import ArgumentError
from hingepair.numeric.names import Names
from hingepair.plans.arguments import check_outputs
from hingepair.symbolic.exact import TIME, Expr, real_symbol
from hingepair.symbolic.trig_sums import trig_sum

Exprs: TypeAlias = tuple[Expr, ...]
"""Components of a vector, or entries of a matrix row by row."""

MAX_SYMBOLS: Final = 20_000
"""Largest number of symbols in a component, with repetition; a longer one is of no use."""

_MAX_DENOMINATOR = 12  # 5/12 reads better than 0.41666...; other fractions are written as decimals, but of pi
_MAX_CHARACTERS = 8  # of an exact constant, or of a repeated term that is not abbreviated
_INDENT = " " * 6  # of continued lines of text

RESERVED: Final = frozenset(
    {
        *("t", "numpy", "float", "parts", "part", "shape", "out", "double", "const", "void", "NAN", "__debug__"),
        *keyword.kwlist,
        *reserved_words,
        *reserved_words_c99,
        "main",
    }
)
"""Names that generated functions use, and words of Python and C."""


class _Sheet(NamedTuple):
    """Equations, and what the symbols in them mean."""

    definitions: list[tuple[Expr, Expr]]
    rows: list[tuple[list[str], Expr]]  # equal components, and their expression


Equation: TypeAlias = tuple[Callable[..., Any], tuple[str, ...]]
"""A function, and the names of its arguments."""


class Output(NamedTuple):
    """What a closed form is of."""

    shape: tuple[int, ...]
    description: str  # or unit, as it stands behind the name
    own_labels: Sequence[str] = ()

    def labels(self, name: str) -> list[str]:
        """Return the labels of the components: omega1_x, S2_xy, phi2."""
        axes = ("xyz"[:size] for size in self.shape)
        places = map("".join, itertools.product(*axes)) if not self.own_labels else ()
        return [*self.own_labels, *(f"{name}_{place}" if place else name for place in places)]


class ClosedForms:
    """Closed forms, whose outputs are attributes: immutable SymPy matrices, or expressions of planar angles. Methods
    write them as text, LaTeX, Python, C and SymPy source.

    An output is derived at the first access, and intermediate results are kept.

    Attributes:
        names: names of the outputs.
        t: the SymPy symbol of time [s].
        q: symbols of a robot's coordinates, arguments of generated functions; qd of their rates.

    Args:
        title: what the forms are of.
        outputs: the outputs by name.
        equations: every quantity, of others.
        found: quantities that are known.
        rates: names of rates, with the coordinate and the order of the derivative.
        q: coordinates of a robot.
        qd: their rates.
        moving: the coordinates that move the frame.
        notes: sentences that stand above written forms.
    """

    t: Final = TIME

    def __init__(
        self,
        title: str,
        outputs: Mapping[str, Output],
        equations: Mapping[str, Equation],
        found: Mapping[str, Any],
        rates: Mapping[str, tuple[str, int]],
        q: Exprs = (),
        qd: Exprs = (),
        moving: Collection[Expr] = (),
        notes: Sequence[str] = (),
    ) -> None:
        self.title, self.rates, self.q, self.qd, self.moving, self.notes = title, rates, q, qd, moving, notes
        self.names = tuple(outputs)
        self._outputs, self._equations, self._found = outputs, equations, dict(found)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in self.names:
            raise AttributeError(f"{type(self).__name__} has no {name!r}; it has {', '.join(self.names)}")
        parts, shape = self.entries(name), self.output(name).shape
        return parts[0] if not shape else sympy.ImmutableMatrix(shape[0], len(parts) // shape[0], parts)

    def __dir__(self) -> list[str]:
        return [*object.__dir__(self), *self.names]

    def __repr__(self) -> str:
        return f"{type(self).__name__} of {', '.join(self.names)}"

    def output(self, name: str) -> Output:
        """Return what an output is of; refuse an unknown name."""
        check_outputs((name,), self.names)
        return self._outputs[name]

    def entries(self, name: str) -> Exprs:
        """Return the components of an output; in the plane those of the plane alone.

        Raises:
            ArgumentError: no such output, or its closed form is too long to be of use.
        """
        shape, value = self.output(name).shape, self.form(name)
        parts = value if isinstance(value, tuple) else (value,)
        if len(parts) == 3 and shape != (3,):
            parts = parts[:2] if shape else parts[2:]
        return tuple(map(_displayed, parts))

    def labels(self, name: str) -> list[str]:
        """Return the labels of the components of an output: omega1_x, S2_xy, phi2, Jv_x1."""
        return self.output(name).labels(name)

    def form(self, name: str) -> Any:
        """Return a quantity: an expression, or a tuple of them."""
        if name not in self._found:
            function, arguments = self._equations[name]
            value = function(*map(self.form, arguments))
            parts = value if isinstance(value, tuple) else (value,)
            short = tuple(map(_shorter, map(sympy.sympify, parts)))
            longest = max(map(count_symbols, short))
            if longest > MAX_SYMBOLS:
                expected = f"an output whose components have at most {MAX_SYMBOLS} symbols"
                raise ArgumentError("outputs", expected, f"{name} with {longest}")
            self._found[name] = short if isinstance(value, tuple) else short[0]
        return self._found[name]

    def _checked(self, names: Iterable[str] | None) -> tuple[str, ...]:
        return self.names if names is None else check_outputs(names, self.names)

    def to_text(self, names: Iterable[str] | None = None, *, short: bool | None = None, width: int = 100) -> str:
        """Return the equations as text, as SymPy writes them: `omega1_x = 5*sin(t) + 3`; the derivatives of x by t
        are xd and xdd. Equal components share a line, and those that are 0 stand in the last one.

        Args:
            names: names of outputs, out of `names`; None for all.
            short: whether repeated terms are abbreviated (k_1; of a robot also c_1, s_12); by default where a line
                would be longer than `width`.
            width: largest number of characters of a line; longer equations go on in the next.

        Raises:
            ArgumentError: an unknown output, or one whose closed form is too long.
        """
        lines = _lines(_fitting_sheet(self, self._checked(names), short, width))
        return "".join(
            textwrap.fill(line, width, subsequent_indent=_INDENT, break_long_words=False, break_on_hyphens=False)
            + "\n"
            for line in (*self.notes, *lines)
        )

    def to_latex(self, names: Iterable[str] | None = None, *, short: bool | None = None) -> str:
        r"""Return the equations as a LaTeX align* environment (amsmath); the arguments are those of `to_text`."""
        sheet = _fitting_sheet(self, self._checked(names), short, 100)
        exprs = [expr for _, expr in (*sheet.definitions, *sheet.rows)]
        rates = {name: _rate_name(*of) for name, of in self.rates.items()}
        symbols = set().union(*(expr.free_symbols for expr in exprs), *(s.free_symbols for s, _ in sheet.definitions))
        spelled = {symbol: rates.get(symbol.name) or _latex_name(symbol.name) for symbol in symbols}
        write = LatexPrinter({"symbol_names": spelled, "full_prec": False}).doprint
        lines = [f"{spelled[symbol]} &= {write(meaning)}" for symbol, meaning in sheet.definitions]
        for labels, expr in sheet.rows:
            lines += _latex_lines(" = ".join(map(_latex_name, labels)), [write(term) for term in _terms(expr)])
        notes = "".join(f"% {one_line(note)}\n" for note in self.notes)
        return (
            f"{notes}\\begin{{align*}}  % \\usepackage{{amsmath}}\n  " + " \\\\\n  ".join(lines) + "\n\\end{align*}\n"
        )

    def to_python(self, names: Iterable[str] | None = None, title: str = "") -> str:
        """Return the source of a Python module that needs only NumPy, with one vectorised function for each output.

        The arguments of the functions of a pair are t and the symbols: constants, coordinates such as x, phi_x, psi,
        their rates xd, phi_xd, psid, and so on. Those of a robot are q, or q and qd.

        Args:
            names: names of outputs, out of `names`; None for all.
            title: stands in the docstring of the module.

        Raises:
            ArgumentError: an unknown output, or one whose closed form is too long.
        """
        first, *notes = _heading(self, title)
        heading = "\n".join((first, "", *notes)) + "\n" if notes else first
        return "\n\n".join(
            [
                f'"""{heading}"""\n\nimport numpy\n',
                *(_python_function(_function(self, n)) for n in self._checked(names)),
            ]
        )

    def to_c(self, names: Iterable[str] | None = None, title: str = "") -> str:
        """Return C source (C99) with a function `void NAME(arguments, double out[])` for each output. It takes one
        state, with the arguments of `to_python`, and writes the components of the output to `out`, row by row.

        Args:
            names: names of outputs, out of `names`; None for all.
            title: stands in the comment at the top.

        Raises:
            ArgumentError: an unknown output, or one whose closed form is too long.
        """
        comment = "\n * ".join(line.replace("*/", "* /") for line in _heading(self, title))
        functions = [_c_function(_function(self, name)) for name in self._checked(names)]
        return "\n".join([f"/* {comment} */\n\n#include <math.h>\n", *functions])

    def to_sympy(self, names: Iterable[str] | None = None) -> dict[str, str]:
        """Return the components as text that `sympy.sympify` reads, by their labels, such as omega1_x or S2_xy.
        Symbols have no assumptions.

        Args:
            names: names of outputs, out of `names`; None for all.

        Raises:
            ArgumentError: an unknown output, or one whose closed form is too long.
        """
        parts = (
            part for name in self._checked(names) for part in zip(self.labels(name), self.entries(name), strict=True)
        )
        return {label: _sympy_expression(expr) for label, expr in parts}


def _shorter(expr: Expr) -> Expr:
    """Return the form of an expression with the fewest symbols: itself, a sum of sines and cosines, or such a sum
    times the factor that all terms share.
    """
    forms = [expr, trig_sum(expr)]
    terms = [{*sympy.Mul.make_args(term)} for term in sympy.Add.make_args(expr)]
    shared = [factor for factor in set.intersection(*terms) if not factor.is_number]
    if shared and len(terms) > 1:
        rest = trig_sum(sympy.Add(*(sympy.Mul(*(factors.difference(shared))) for factors in terms)))
        forms.append(rest and rest * sympy.Mul(*shared))
    return min((form for form in forms if form is not None), key=count_symbols)


def _displayed(expr: Expr) -> Expr:
    """Return an expression, or its sum of sines and cosines if that has as many symbols."""
    as_sum = trig_sum(expr)
    return expr if as_sum is None or count_symbols(as_sum) > count_symbols(expr) else as_sum


# ---- what is written


@functools.lru_cache(maxsize=65536)
def count_symbols(expr: Expr) -> int:
    """Return the number of symbols in an expression, with repetition; x(t) and its derivatives count as symbols."""
    if not expr.args or expr.is_Derivative or isinstance(expr, AppliedUndef):
        return 0 if expr.is_number else 1
    return sum(map(count_symbols, expr.args))


def _with_symbols(exprs: Sequence[Expr]) -> list[Expr]:
    """Return expressions with symbols in place of functions of t: psi, psid and psidd."""
    functions = set().union(*(expr.atoms(AppliedUndef) for expr in exprs))
    symbols = {f.diff((TIME, k)): real_symbol(f.func.__name__ + "d" * k) for f in functions for k in range(3)}
    return [expr.xreplace(symbols) for expr in exprs]


@functools.lru_cache(maxsize=4096)  # long forms repeat their parts
def _with_decimals(expr: Expr) -> Expr:
    """Return an expression with decimals in place of constants that are no simple fractions or roots."""
    if not isinstance(expr, sympy.Expr):  # a branch of a choice, or a condition
        return expr.func(*map(_with_decimals, expr.args)) if expr.args else expr
    if not expr.free_symbols:
        part_of_pi = (expr / sympy.pi).is_Rational and len(str(expr)) <= 2 * _MAX_CHARACTERS
        fractions = all(x.q <= _MAX_DENOMINATOR for x in expr.atoms(sympy.Rational))
        simple = part_of_pi or (fractions and len(str(expr)) <= _MAX_CHARACTERS)
        return expr if simple else sympy.Float(constant_value(expr), 15)
    if not expr.args:
        return expr
    if expr.is_Pow and expr.exp.is_Rational:
        return expr.func(_with_decimals(expr.base), expr.exp)
    constants = [part for part in expr.args if not part.free_symbols] if expr.is_Add or expr.is_Mul else []
    parts = [_with_decimals(expr.func(*constants))] if constants else []
    return expr.func(*parts, *(_with_decimals(part) for part in expr.args if part not in constants))


def constant_value(expr: Expr) -> float:
    """Return the float nearest to an expression without symbols; NaN if it has no real value."""
    number = expr.evalf(30)
    if not number.is_Float:
        return float(expr) if expr.is_Rational else math.nan
    return 0.0 if number._prec == 1 else float(number)  # SymPy found no digit that differs from 0


def _sheet(forms: ClosedForms, names: Sequence[str], short: bool) -> _Sheet:
    """Return the equations of outputs, those of equal components together and zeros last."""
    labelled = [pair for name in names for pair in zip(forms.labels(name), forms.entries(name), strict=True)]
    still = tuple(f"{axis}{k}" for k, q in enumerate(forms.q, 1) if q not in forms.moving for axis in "xyz")
    labels_by_expr: dict[Expr, list[str]] = {}
    exprs = map(_with_decimals, _with_symbols([expr for _, expr in labelled]))
    for (label, _), expr in zip(labelled, exprs, strict=True):
        if not label.endswith(still):
            labels_by_expr.setdefault(expr, []).append(label)
    zeros = labels_by_expr.pop(sympy.S.Zero, None)
    rows = [(labels, expr) for expr, labels in labels_by_expr.items()]
    rows += [(zeros, sympy.S.Zero)] if zeros else []
    return _abbreviated(forms, rows) if short else _Sheet([], rows)


def _fitting_sheet(forms: ClosedForms, names: Sequence[str], short: bool | None, width: int) -> _Sheet:
    """Return the equations, abbreviated if `short` is true or, if it is None, if a line would be too long."""
    sheet = _sheet(forms, names, bool(short))
    is_long = short is None and any(len(line) > width for line in _lines(sheet))
    return _sheet(forms, names, True) if is_long else sheet


def _abbreviated(forms: ClosedForms, rows: Sequence[tuple[list[str], Expr]]) -> _Sheet:
    """Return the equations with symbols k_1, k_2 and so on in place of repeated terms, and of a robot with s_1 and
    c_23 in place of sines and cosines.
    """
    exprs = [expr for _, expr in rows]
    waves = _wave_symbols(forms.q, exprs)
    exprs = [expr.xreplace(waves) for expr in exprs]
    definitions = [(symbol, wave) for wave, symbol in waves.items()]
    names = Names((symbol.name for expr in exprs for symbol in expr.free_symbols), _latex_name)
    letters = (name for name in (f"k_{i}" for i in itertools.count(1)) if names.free(name))
    repeated, results = sympy.cse(exprs, symbols=(sympy.Dummy(real=True) for _ in itertools.count()))
    shown: dict[Expr, Expr] = {}
    for symbol, expr in repeated:
        meaning = expr.xreplace(shown)
        if len(_text(meaning)) > _MAX_CHARACTERS or meaning.is_Relational:
            shown[symbol] = real_symbol(next(letters))
            definitions.append((shown[symbol], meaning))
        else:
            shown[symbol] = meaning
    abbreviated = [(labels, expr.xreplace(shown)) for (labels, _), expr in zip(rows, results, strict=True)]
    return _Sheet(definitions, abbreviated)


def _wave_symbols(q: Sequence[Expr], exprs: Iterable[Expr]) -> dict[Expr, Expr]:
    """Return the symbols of sines and cosines of a robot's angles: s_23 of sin(q_2 + q_3)."""
    waves = set().union(*(expr.atoms(sympy.sin, sympy.cos) for expr in exprs))
    found: dict[Expr, Expr] = {}
    taken = Names()
    for wave in sorted(waves, key=lambda wave: (len(wave.free_symbols), str(wave.args[0]), wave.func.__name__)):
        numbers = [str(k) for k, one in enumerate(q, 1) if one in wave.free_symbols]
        if numbers:
            indices = ("" if len(numbers[-1]) == 1 else ",").join(numbers)
            name = f"{wave.func.__name__[0]}_{indices}"
            found[wave] = real_symbol(taken.take(name, *(name + mark for mark in "abcdefghij")))
    return found


# ---- text and LaTeX


def _text(expr: Expr) -> str:
    return str(sympy.sstr(expr, full_prec=False))


def _lines(sheet: _Sheet) -> list[str]:
    lines = [f"{symbol} = {_text(meaning)}" for symbol, meaning in sheet.definitions]
    return lines + [f"{' = '.join(labels)} = {_text(expr)}" for labels, expr in sheet.rows]


def _latex_name(name: str) -> str:
    r"""Return the LaTeX of a symbol's name, as SymPy reads it: `u1_x` becomes u_{1,x}."""
    name = name.replace("Jv_", "J__v_").replace("Jomega_", "J__omega_")
    return str(sympy.latex(real_symbol(name))).replace(" ", ",")


def _rate_name(name: str, order: int) -> str:
    r"""Return the LaTeX of a derivative by its variable: \dot{\phi}_{x} of phi_x."""
    letter, underscore, index = _latex_name(name).partition("_")
    return f"\\{'d' * order}ot{{{letter}}}{underscore}{index}"


def _terms(expr: Expr) -> Sequence[Expr]:
    return list(expr.as_ordered_terms()) if expr.is_Add else [expr]


def _latex_lines(label: str, terms: Sequence[str]) -> list[str]:
    """Return the lines of an equation, eight terms in each."""
    signed = [terms[0], *(term if term.startswith("-") else f"+ {term}" for term in terms[1:])]
    rows = [" ".join(signed[i : i + 8]) for i in range(0, len(signed), 8)]
    return [f"{label} &= {rows[0]}", *(f"&\\quad {row}" for row in rows[1:])]


# ---- source


class _NumPySource(NumPyPrinter):  # type: ignore[misc]  # SymPy carries no types
    """Printer of NumPy source, with full names such as `numpy.sin`. A part without symbols is one number: an integer,
    a fraction or a NumPy float, which overflows to inf where a Python number raises.
    """

    def _print(self, expr: Expr, **settings: Any) -> str:
        if isinstance(expr, sympy.Expr) and not expr.free_symbols:
            if expr.is_Rational and max(abs(expr.p), expr.q) < 2**53:
                return f"{expr.p}/{expr.q}" if expr.q != 1 else str(expr.p)
            value = constant_value(expr)
            return f"numpy.float64({value!r})" if math.isfinite(value) else f"numpy.float64('{value!r}')"
        return str(super()._print(expr, **settings))


class _CSource(C99CodePrinter):  # type: ignore[misc]
    """Printer of C source, with a part without symbols as one double."""

    def _print(self, expr: Expr, **settings: Any) -> str:
        if isinstance(expr, sympy.Expr) and not expr.free_symbols:
            value = constant_value(expr)
            return repr(value) if math.isfinite(value) else "NAN" if math.isnan(value) else "INFINITY"
        return str(super()._print(expr, **settings))


class _SymPySource(StrPrinter):  # type: ignore[misc]
    """Printer of text that `sympy.sympify` reads; symbols with names of SymPy's own, such as gamma, say so."""

    def _print_Symbol(self, expr: Expr) -> str:
        known = hasattr(sympy, expr.name) or hasattr(builtins, expr.name)
        return f"Symbol({expr.name!r})" if known else str(expr.name)


numpy_source: Final = _NumPySource({"allow_unknown_functions": False}).doprint
_c_expression: Final = _CSource({"allow_unknown_functions": False}).doprint
_sympy_expression: Final = _SymPySource().doprint


class _Function(NamedTuple):
    """A function of floats that computes the components of one output."""

    name: str
    description: str
    arguments: Sequence[str]
    steps: list[tuple[str, Expr]]  # values by name, each of which may use earlier ones
    results: list[Expr]
    shape: tuple[int, ...]
    vectors: Mapping[str, Sequence[tuple[str, int]]]  # components that are used, by arguments that are vectors
    length: int  # of the vectors


def _function(forms: ClosedForms, name: str) -> _Function:
    """Return the function that computes an output."""
    *exprs, _ = _with_symbols([*forms.entries(name), TIME])
    used = set().union(*(expr.free_symbols for expr in exprs))
    parts = {"q": forms.q, "qd": forms.qd} if name in {"v", "omega"} else {"q": forms.q}
    vectors = {
        v: [(s.name, i) for i, s in enumerate(symbols) if s in used] for v, symbols in parts.items() if symbols
    }
    symbols = sorted(symbol.name for symbol in used - {TIME})
    arguments = list(vectors) or ["t"] * (TIME in used or not symbols) + symbols
    letters = sympy.numbered_symbols("w", exclude=used, real=True)
    steps, results = sympy.cse(exprs, symbols=letters, order="none", list=True)
    named_steps = [(symbol.name, step) for symbol, step in steps]
    described = forms.output(name).description
    return _Function(
        name, described, arguments, named_steps, results, forms.output(name).shape, vectors, len(forms.q)
    )


def _heading(forms: ClosedForms, title: str) -> Iterator[str]:
    """Yield the lines above the functions."""
    shown = one_line(title or forms.title)
    yield f"Closed forms{f': {shown}' if shown else ''}."
    for note in map(one_line, forms.notes):
        yield from textwrap.wrap(f"{note}.", 100, subsequent_indent=_INDENT)


def one_line(text: str) -> str:
    """Return a text as one line that a docstring or a comment can contain, without quotes and backslashes."""
    return "".join(sign for sign in " ".join(text.split()) if sign.isprintable() and sign not in '"\\')


def _python_function(function: _Function) -> str:
    arguments, tail = function.arguments, function.shape
    width = max(len(function.results) // tail[0], 1) if tail else 1
    texts = [*map(numpy_source, function.results)]
    if function.vectors:
        shape = f"numpy.broadcast_shapes({', '.join(f'{v}.shape' for v in function.vectors)})[:-1]"
        taken = f"{' and '.join(arguments)} of shape (..., {function.length}) give"
    else:
        shape = f"numpy.broadcast({', '.join(arguments)}).shape"
        taken = "the arguments broadcast; shape (...) gives"
    lines = [
        f'"""{function.name}{function.description}; {taken} (..., {", ".join(map(str, tail))})."""'.replace(
            ", )", ")"
        ),
        *(f"{argument} = numpy.asarray({argument}, dtype=float)" for argument in arguments),
        *(f"{part} = {v}[..., {i}]" for v, parts in function.vectors.items() for part, i in parts),
        *(f"{symbol} = {numpy_source(step)}" for symbol, step in function.steps),
        "parts = (",
        *(f"    {', '.join(texts[i : i + width])}," for i in range(0, len(texts), width)),
        ")",
        f"shape = {shape}",
        "parts = [numpy.broadcast_to(part, shape) for part in parts]",
        f"return numpy.stack(parts, axis=-1).reshape(shape + {tail})",
    ]
    return f"def {function.name}({', '.join(arguments)}):\n" + "".join(f"    {line}\n" for line in lines)


def _c_function(function: _Function) -> str:
    taken = [
        f"const double {argument}[{function.length}]" if function.vectors else f"double {argument}"
        for argument in function.arguments
    ]
    lines = [f"const double {part} = {v}[{i}];" for v, parts in function.vectors.items() for part, i in parts]
    lines += [f"const double {symbol} = {_c_expression(step)};" for symbol, step in function.steps]
    lines += [f"out[{i}] = {_c_expression(result)};" for i, result in enumerate(function.results)]
    body = "".join(f"    {line}\n" for line in lines)
    taken.append(f"double out[{len(function.results)}]")
    return f"/* {function.name}{function.description} */\nvoid {function.name}({', '.join(taken)})\n{{\n{body}}}\n"
