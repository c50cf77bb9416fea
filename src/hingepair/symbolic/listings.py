"""Closed forms as text: one line a component as a paper has it, LaTeX, or a Python module that needs only NumPy."""

from __future__ import annotations

from collections.abc import Iterable

import sympy

from hingepair.symbolic.closed_forms import Derivation
from hingepair.symbolic.jets import Expr
from hingepair.symbolic.printers import LATEX, PYTHON, TEXT, joined, latex_name, lettered

_UNITS = {"R": "m", "d": "m", "v": "m/s", "omega": "rad/s", "a": "m/s^2", "alpha": "rad/s^2", "phi": "rad"}


def to_text(forms: Derivation, names: Iterable[str]) -> str:
    """One line a component: `omega1_x = 3 + 5 sin t`; derivatives of x(t) are x', x''.

    Raises:
        ArgumentError: an unknown output, or one whose closed form is too long.
    """
    return "".join(f"{label} = {joined(terms, TEXT)}\n" for label, terms in _labelled(forms, names))


def to_sympy(forms: Derivation, names: Iterable[str]) -> dict[str, str]:
    """The SymPy source of each component by its label: omega1_x, S2_xy."""
    return {label: str(sympy.Add(*terms)) for label, terms in _labelled(forms, names)}


def to_latex(forms: Derivation, names: Iterable[str]) -> str:
    r"""An align* environment of the package amsmath, one line a component; derivatives of x(t) are \dot{x}.

    Raises:
        ArgumentError: as for `to_text`.
    """
    rows = [f"{latex_name(label)} &= {joined(terms, LATEX)}" for label, terms in _labelled(forms, names)]
    return "\\begin{align*}  % \\usepackage{amsmath}\n  " + " \\\\\n  ".join(rows) + "\n\\end{align*}\n"


def to_python(forms: Derivation, names: Iterable[str], title: str = "") -> str:
    """A Python module with one function an output, vectorised over its arguments: t, and what stayed a letter.

    Of a pair without a motion the arguments are the coordinates: x, phi_x, psi, their rates xd, phi_xd, psid, and so
    on. The module imports NumPy and nothing else.

    Raises:
        ArgumentError: as for `to_text`.
    """
    heading = "".join(sign for sign in " ".join(title.split()) if sign.isprintable() and sign not in '"\\')
    parts = [f'"""Closed forms{": " * bool(heading)}{heading}."""\n\nimport numpy\n']
    parts += [_function(forms, name) for name in names]
    return "\n\n".join(parts)


def _labelled(forms: Derivation, names: Iterable[str]) -> Iterable[tuple[str, tuple[Expr, ...]]]:
    """The terms of every component with its label."""
    for name in names:
        parts = forms.terms(name)
        for place, terms in zip(_places(len(parts)), parts, strict=True):
            yield f"{name}_{place}" if place else name, terms


def _places(count: int) -> list[str]:
    return [i + j for i in "xyz" for j in "xyz"] if count == 9 else list("xyz"[:count]) if count > 1 else [""]


def _function(forms: Derivation, name: str) -> str:
    """The source of the function of one output."""
    parts = [sympy.Add(*terms) for terms in forms.terms(name)]
    known = lettered([*parts, forms.t], "d")[:-1]
    letters = sorted({s.name for part in known for s in part.free_symbols} - {"t"})
    arguments = ["t", *letters] if any(forms.t in part.free_symbols for part in known) or not letters else letters
    temporary = sympy.numbered_symbols("w", real=True)
    steps, results = sympy.cse(known, symbols=temporary, order="none", list=True)
    tail = {1: (), 9: (3, 3)}.get(len(parts), (len(parts),))
    unit = _UNITS.get(name.rstrip("12"), "")
    every = ", ".join(arguments)
    lines = [
        f"def {name}({every}):",
        f'    """{name}{f" [{unit}]" if unit else ""}; the arguments broadcast, shape (...) gives {_shape(tail)}."""',
        *(f"    {argument} = numpy.asarray({argument}, dtype=float)" for argument in arguments),
        *(f"    {symbol} = {PYTHON(step)}" for symbol, step in steps),
        "    parts = (",
        *(f"        {PYTHON(result)}," for result in results),
        "    )",
        f"    parts = numpy.broadcast_arrays(*parts, {every})[:{len(parts)}]",
        f"    return numpy.stack(parts, axis=-1).reshape(parts[0].shape + {tail})",
    ]
    return "\n".join(lines) + "\n"


def _shape(tail: tuple[int, ...]) -> str:
    return f"(..., {', '.join(map(str, tail))})" if tail else "(...)"
