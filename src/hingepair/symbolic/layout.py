"""Layout of closed forms: line breaks in equations, align* environments, titles."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Final

from hingepair.symbolic.kinks import Expr
from hingepair.symbolic.printers import Writer, join_terms, latex_name, signed_terms, to_text

_MAX_LATEX_WIDTH: Final = 90  # characters of the terms, as plain text, in a line of LaTeX
_INDENT: Final = " " * 6  # of continued lines
_NO_BREAK_SPACE: Final = "\N{NO-BREAK SPACE}"  # a blank at which no line is broken


def wrap_equation(line: str, width: int) -> str:
    """Break a line after semicolons, where there are none before + or -, and otherwise at any blank."""
    pieces = [line]
    for breaks in ((("; ", ";\0"),), ((" + ", "\0+ "), (" - ", "\0- ")), ((" ", "\0"),)):
        pieces = [part for piece in pieces for part in _break_line(piece, breaks, width)]
    return "\n".join(pieces)


def _break_line(line: str, breaks: Sequence[tuple[str, str]], width: int) -> list[str]:
    """Return the pieces of a line that is broken only at a null character in the second text of each pair."""
    fixed = line.lstrip()
    for place, marked in breaks:
        fixed = fixed.replace(place, marked)
    fixed = fixed.replace(" ", _NO_BREAK_SPACE).replace("\0", " ")
    pieces = textwrap.wrap(
        fixed,
        width,
        initial_indent=_INDENT if line.startswith(_INDENT) else "",
        subsequent_indent=_INDENT,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [piece.replace(_NO_BREAK_SPACE, " ") for piece in pieces]


def latex_lines(label: str, terms: Sequence[Expr], write: Writer) -> list[str]:
    """Return the lines of one equation in an align* environment."""
    lines: list[str] = []
    line, filled = f"{latex_name(label)} &=", 0
    for text, term in zip([join_terms(terms[:1], write), *signed_terms(terms[1:], write)], terms, strict=True):
        size = len(to_text(term))
        if filled + size > _MAX_LATEX_WIDTH and filled:
            lines.append(line)
            line, filled = "&\\quad", 0
        line += f" {text}"
        filled += size
    return [*lines, line]


def align_environment(lines: Sequence[str]) -> str:
    """Return an align* environment of lines."""
    return "\\begin{align*}  % \\usepackage{amsmath}\n  " + " \\\\\n  ".join(lines) + "\n\\end{align*}\n"


def title_suffix(title: str) -> str:
    """Return what a title adds to the first line of a module's docstring: a colon and the title."""
    text = docstring_text(title)
    return f": {text}" if text else ""


def docstring_text(text: str) -> str:
    """Return a text as one line that a docstring or comment can contain; other characters are dropped."""
    return "".join(sign for sign in " ".join(text.split()) if sign.isprintable() and sign not in '"\\')


def shape_text(tail: Sequence[int]) -> str:
    """Return the shape of an array whose leading axes are those of the arguments.

    >>> shape_text(()), shape_text((3, 3))
    ('(...)', '(..., 3, 3)')
    """
    return f"(..., {', '.join(map(str, tail))})" if tail else "(...)"
