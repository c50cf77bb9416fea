"""Layout of closed forms: line breaks in equations, align* environments, titles."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Final

from hingepair.symbolic.kinks import Expr
from hingepair.symbolic.printers import Writer, join_terms, latex_name, signed_terms, to_text

_MAX_PLAIN_TEXT_CHARACTERS_PER_LATEX_LINE: Final = 90  # characters of the terms, as plain text, in a line of LaTeX
_CONTINUATION_LINE_PREFIX: Final = " " * 6  # of continued lines
_NO_BREAK_SPACE: Final = "\N{NO-BREAK SPACE}"  # a blank at which no line is broken


def wrap_equation(line: str, width: int) -> str:
    """Return a line of text with line breaks, so that lines have at most `width` characters if possible. Breaks are
    made after semicolons first, then before + or -, then at any space.
    """
    pieces = [line]
    for breaks in ((("; ", ";\0"),), ((" + ", "\0+ "), (" - ", "\0- ")), ((" ", "\0"),)):
        pieces = [part for piece in pieces for part in _break_line(piece, breaks, width)]
    return "\n".join(pieces)


def _break_line(line: str, marked_breaks: Sequence[tuple[str, str]], width: int) -> list[str]:
    """Wrap a line to `width` characters, and return a list of the resulting lines. Each pair in `marked_breaks` holds
    a string at which a break is possible, and a copy of this string with a null character at the place of the break.
    """
    fixed = line.lstrip()
    for text, marked_text in marked_breaks:
        fixed = fixed.replace(text, marked_text)
    fixed = fixed.replace(" ", _NO_BREAK_SPACE).replace("\0", " ")
    pieces = textwrap.wrap(
        fixed,
        width,
        initial_indent=_CONTINUATION_LINE_PREFIX if line.startswith(_CONTINUATION_LINE_PREFIX) else "",
        subsequent_indent=_CONTINUATION_LINE_PREFIX,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [piece.replace(_NO_BREAK_SPACE, " ") for piece in pieces]


def latex_lines(label: str, terms: Sequence[Expr], format_term: Writer) -> list[str]:
    """Return a list of the lines of the LaTeX equation `label = sum of terms` for an align* environment. A long
    equation is broken between terms. `format_term` is a function from a term to its LaTeX.
    """
    lines: list[str] = []
    line, filled = f"{latex_name(label)} &=", 0
    for text, term in zip(
        [join_terms(terms[:1], format_term), *signed_terms(terms[1:], format_term)], terms, strict=True
    ):
        size = len(to_text(term))
        if filled + size > _MAX_PLAIN_TEXT_CHARACTERS_PER_LATEX_LINE and filled:
            lines.append(line)
            line, filled = "&\\quad", 0
        line += f" {text}"
        filled += size
    return [*lines, line]


def align_environment(lines: Sequence[str]) -> str:
    """Return the text of a LaTeX align* environment with the given lines."""
    return "\\begin{align*}  % \\usepackage{amsmath}\n  " + " \\\\\n  ".join(lines) + "\n\\end{align*}\n"


def title_suffix(title: str) -> str:
    """Return a colon and the title for the first line of a module's docstring; an empty text without a title."""
    text = docstring_text(title)
    return f": {text}" if text else ""


def docstring_text(text: str) -> str:
    """Return a string as one line that a docstring or a comment can contain. Quotes, backslashes and unprintable
    characters are dropped.
    """
    return "".join(sign for sign in " ".join(text.split()) if sign.isprintable() and sign not in '"\\')


def shape_text(trailing_shape: Sequence[int]) -> str:
    """Return the text of an array's shape, "(..., 3, 3)" for the trailing shape (3, 3).

    >>> shape_text(()), shape_text((3, 3))
    ('(...)', '(..., 3, 3)')
    """
    return f"(..., {', '.join(map(str, trailing_shape))})" if trailing_shape else "(...)"
