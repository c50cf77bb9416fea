"""Lines of closed forms: text that is broken where a reader expects it, align* environments, headings."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Final

from hingepair.symbolic.kinks import Expr
from hingepair.symbolic.printers import TEXT, Write, joined, latex_name, signed

_MAX_LATEX_WIDTH: Final = 90  # characters of terms, as text, in a line of LaTeX
_INDENT: Final = " " * 6
_FIXED: Final = "\N{NO-BREAK SPACE}"


def wrapped(line: str, width: int) -> str:
    """Return a line broken after semicolons, or where none is before a + or -, or where it must be at any blank."""
    pieces = [line]
    for breaks in ((("; ", ";\0"),), ((" + ", "\0+ "), (" - ", "\0- ")), ((" ", "\0"),)):
        pieces = [part for piece in pieces for part in _folded(piece, breaks, width)]
    return "\n".join(pieces)


def _folded(line: str, breaks: Sequence[tuple[str, str]], width: int) -> list[str]:
    """Return the pieces of a line that is broken at some places only: at a null character of each second text."""
    fixed = line.lstrip()
    for place, marked in breaks:
        fixed = fixed.replace(place, marked)
    fixed = fixed.replace(" ", _FIXED).replace("\0", " ")
    pieces = textwrap.wrap(
        fixed,
        width,
        initial_indent=_INDENT if line.startswith(_INDENT) else "",
        subsequent_indent=_INDENT,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [piece.replace(_FIXED, " ") for piece in pieces]


def latex_lines(label: str, terms: Sequence[Expr], write: Write) -> list[str]:
    """Return the lines of one equation in an align* environment."""
    lines: list[str] = []
    line, filled = f"{latex_name(label)} &=", 0
    for text, term in zip([joined(terms[:1], write), *signed(terms[1:], write)], terms, strict=True):
        size = len(TEXT(term))
        if filled + size > _MAX_LATEX_WIDTH and filled:
            lines.append(line)
            line, filled = "&\\quad", 0
        line += f" {text}"
        filled += size
    return [*lines, line]


def align(lines: Sequence[str]) -> str:
    """Return an align* environment of these lines."""
    return "\\begin{align*}  % \\usepackage{amsmath}\n  " + " \\\\\n  ".join(lines) + "\n\\end{align*}\n"


def heading(title: str) -> str:
    """Return what the first line of a module adds for a title: a colon and as much of it as a docstring can hold."""
    held = docstring_text(title)
    return f": {held}" if held else ""


def docstring_text(text: str) -> str:
    """Return as much of a text as one line of a docstring or of a comment can hold."""
    return "".join(sign for sign in " ".join(text.split()) if sign.isprintable() and sign not in '"\\')


def shape_text(tail: Sequence[int]) -> str:
    """Return the shape of an array whose leading axes are those of the arguments.

    >>> shape_text(()), shape_text((3, 3))
    ('(...)', '(..., 3, 3)')
    """
    return f"(..., {', '.join(map(str, tail))})" if tail else "(...)"
