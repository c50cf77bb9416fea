"""Tables in plain text and in notebooks, and numbers that JSON has words for."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from hingepair.equations.quantities import unit_of
from hingepair.errors import printable


def align_columns(rows: Sequence[Sequence[str]], right_columns: Collection[int]) -> list[str]:
    """Return rows of cells as lines of text, padded to the width of their column; some are aligned to the right.

    >>> align_columns([("name", "size"), ("d", "1.25")], {1})
    ['name  size', 'd     1.25']
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.rjust(width) if i in right_columns else cell.ljust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def ruled_table(rows: Sequence[Sequence[str]], key_column_count: int = 1, width: int | None = None) -> list[str]:
    r"""Return a table as lines of text, with a rule below its heading. Columns that do not fit follow in further
    tables; no cell is cut.

    Args:
        rows: the heading and the other rows, as many cells each; a row without cells is an empty line.
        key_column_count: number of the first columns, which further tables repeat.
        width: of a line [characters]; None for lines of any length.

    >>> print(*ruled_table([("", "t = 0", "t = 1"), ("psi", "-1.25", "3")], width=12), sep="\n")
         t = 0
    ----------
    psi  -1.25
    <BLANKLINE>
         t = 1
    ----------
    psi      3
    """
    full_rows = [row for row in rows if row]
    sizes = [max(map(len, column)) + 2 for column in zip(*full_rows, strict=True)]
    parts: list[list[int]] = []
    for column in range(key_column_count, len(sizes)):
        if not parts or (
            width is not None and sum(sizes[i] for i in (*range(key_column_count), *parts[-1], column)) - 2 > width
        ):
            parts.append([])
        parts[-1].append(column)
    text_lines: list[str] = []
    for part in parts:
        aligned_lines = iter(
            align_columns(
                [[row[i] for i in (*range(key_column_count), *part)] for row in full_rows],
                range(1, key_column_count + len(part)),
            )
        )
        drawn = [next(aligned_lines) if row else "" for row in rows]
        text_lines += ["", drawn[0], "-" * max(map(len, drawn)), *drawn[1:]]
    return text_lines[1:]


def left_out_remark(skipped: int, samples: int) -> str:
    """Return a remark, to follow a verdict, that says how many samples were left out because they are not finite.

    >>> left_out_remark(1, 20)
    ' (1 of 20 samples is not finite and was left out)'
    """
    if not skipped:
        return ""
    be, been = ("is", "was") if skipped == 1 else ("are", "were")
    return f" ({skipped} of {samples} samples {be} not finite and {been} left out)"


def instant_text(t: float) -> str:
    """Return an instant [s] with six digits; from 1e5 s on with all, since six would not tell it from its neighbours.

    >>> instant_text(1 / 3), instant_text(1763746391.25)
    ('0.333333', '1763746391.25')
    """
    return f"{t:.6g}" if abs(t) < 1e5 else repr(float(t))


_MIN_OFFSET = 1e4  # smaller numbers are shown as they are
_MIN_RATIO = 1e3  # of a number to its variation, of which six digits leave three
_MAX_RATIO = 1e12  # beyond, the variation is rounding


def round_offset(smallest: float, largest: float, variation: float | None = None) -> float:
    """Return a whole number, or one of few decimals, to be subtracted from numbers that are large against their
    variation, such as coordinates on a map; 0 for other numbers.

    Args:
        smallest: smallest number.
        largest: largest number.
        variation: range of numbers to compare with, that of a vector for its components; of these numbers by default.

    >>> round_offset(1718000005.25, 1718000010.25), round_offset(5334760.5, 5334760.5, 20), round_offset(0.5, 0.6)
    (1718000005.0, 5334760.0, 0.0)
    """
    own = largest - smallest
    span, size = own if variation is None else variation, max(abs(smallest), abs(largest))
    if not (size >= _MIN_OFFSET and size / _MAX_RATIO < span < size / _MIN_RATIO):
        return 0.0
    step = 10.0 ** min(0, math.floor(math.log10(span)))
    return math.floor(smallest / step) * step


def offset_text(name: str, offset: float) -> str:
    """Return a name with the number that is subtracted from what it stands for.

    >>> offset_text("x", 691607.0), offset_text("x", -2e4), offset_text("x", 0.0)
    ('x - 691607', 'x + 20000', 'x')
    """
    return f"{name} {'-' if offset > 0 else '+'} {abs(offset):.15g}" if offset else name


def percent(share: float) -> str:
    """Return a share of 1 as a percentage of two significant digits.

    >>> percent(0.0123), percent(0.996), percent(3.3e-13)
    ('1.2 %', '100 %', '3.3e-11 %')
    """
    return f"{100 * share:.0f} %" if share >= 0.995 else f"{100 * share:.2g} %"


def number_texts(names: Sequence[str], rows: Sequence[Sequence[float]]) -> list[list[str]]:
    """Return numbers of components as text, six digits each, with 0 for rounding errors beside the others.

    A number is shown as 0 if it is below half a unit of the last digit of the largest in its row, or of the size of
    rounding errors beside the largest of its vector: the digits of such numbers differ from processor to processor.

    Args:
        names: of the components; those of a vector have one name before the last underscore, as R2_x and R2_y.
        rows: numbers of each component.

    >>> number_texts(["a_x", "a_y"], [[-3e-7, 1.5], [2e-16, 1e-15]])
    [['0', '1.5'], ['0', '0']]
    """
    largest_in_rows = [max((abs(value) for value in row if math.isfinite(value)), default=0.0) for row in rows]
    vectors = [name.rpartition("_")[0] or name for name in names]
    largest_in_vectors: dict[str, float] = {}
    for vector, largest in zip(vectors, largest_in_rows, strict=True):
        largest_in_vectors[vector] = max(largest, largest_in_vectors.get(vector, 0.0))
    texts = []
    for vector, largest, row in zip(vectors, largest_in_rows, rows, strict=True):
        least = max(0.5 * 10.0**-5 * largest, 64 * 2.0**-53 * largest_in_vectors[vector])
        texts.append(["0" if abs(value) < least else f"{value + 0.0:.6g}" for value in row])
    return texts


def json_text(report: Any) -> str:
    """Return nested mappings, lists and values as JSON text; numbers that are not finite become null.

    >>> print(json_text({"largest": math.inf}))
    {
      "largest": null
    }
    """
    import json

    return json.dumps(_json_values(report), indent=2, allow_nan=False)


def _json_values(value: Any) -> Any:
    """Return nested values as JSON has them: lists in place of arrays, None for numbers that are not finite."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: _json_values(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_json_values(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


_MAX_CELL = 9  # numbers of a cell; of more only the count or the shape is shown


class Sheet(NamedTuple):
    """A table of strings, as notebooks show it."""

    title: str
    rows: Sequence[Sequence[str]]  # of cells; the first is the heading
    notes: Sequence[str] = ()  # sentences below the table


class Shown:
    """Base class of objects that notebooks show as the HTML table of their `_sheet`."""

    __slots__ = ()

    def _sheet(self) -> Sheet:
        """Return what notebooks show."""
        raise NotImplementedError

    def _repr_html_(self) -> str:
        """Return the table as HTML."""
        from html import escape

        title, (heading, *rows), notes = self._sheet()

        def row(cells: Iterable[str], tag: str) -> str:
            return f"<tr>{''.join(f'<{tag}>{escape(printable(cell))}</{tag}>' for cell in cells)}</tr>"

        body = "".join(row(cells, "td") for cells in rows)
        below = "".join(f"<p>{escape(printable(note))}</p>" for note in notes)
        caption = f"<caption>{escape(printable(title))}</caption>"
        return f"<table>{caption}<thead>{row(heading, 'th')}</thead><tbody>{body}</tbody></table>{below}"


def sheet_of(title: str, values: Iterable[tuple[str, Any]]) -> Sheet:
    """Return a sheet of names, values and units; an array of more than nine numbers is shown by its shape."""
    rows = ((name, cell_text(value), unit_of(name)) for name, value in values if value is not None)
    return Sheet(title, (("", "value", "unit"), *rows))


def cell_text(value: Any) -> str:
    """Return a string, a number, an array or a sequence of numbers as short text.

    >>> cell_text((0.5, 0, 1 / 3)), cell_text("a"), cell_text(range(10))
    ('0.5, 0, 0.333333', 'a', '10 numbers')
    """
    if isinstance(value, str):
        return value
    shape = getattr(value, "shape", None)
    if shape is not None and not (math.prod(shape) <= _MAX_CELL and hasattr(value, "tolist")):
        return f"array of shape {tuple(shape)}"
    items = value.tolist() if shape is not None else value
    if not hasattr(items, "__len__"):
        return f"{items + 0.0:.6g}"
    if len(items) > _MAX_CELL:
        return f"{len(items)} numbers"
    return ("; " if shape is not None and len(shape) > 1 else ", ").join(cell_text(item) for item in items)
