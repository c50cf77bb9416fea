"""What reports have in common: a table in plain text, and numbers that JSON has words for."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

_LATE = 1e5  # s


def aligned(lines: Sequence[Sequence[str]], right: Collection[int]) -> list[str]:
    """The lines of a table, cells padded to columns; the columns numbered in `right` to the right.

    >>> aligned([("name", "size"), ("d", "1.25")], {1})
    ['name  size', 'd     1.25']
    """
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return [
        "  ".join(
            cell.rjust(width) if i in right else cell.ljust(width)
            for i, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]


def left_out(skipped: int, samples: int) -> str:
    """How many samples were not finite, to go behind a verdict; nothing where all were.

    >>> left_out(1, 20)
    ' (1 of 20 samples is not finite and was left out)'
    """
    if not skipped:
        return ""
    be, been = ("is", "was") if skipped == 1 else ("are", "were")
    return f" ({skipped} of {samples} samples {be} not finite and {been} left out)"


def instant(t: float) -> str:
    """An instant [s] for a reader: six digits, or as many as tell it from its neighbours where it is late.

    >>> instant(1 / 3), instant(1763746391.25)
    ('0.333333', '1763746391.25')
    """
    return f"{t:.6g}" if abs(t) < _LATE else repr(float(t))


def finite_or_none(number: float) -> float | None:
    """The number, or None where JSON has no word for it."""
    return number if math.isfinite(number) else None


def json_text(report: Any) -> str:
    """A report as JSON; a number that is not finite is null.

    >>> print(json_text({"largest": math.inf}))
    {
      "largest": null
    }
    """
    import json

    return json.dumps(_finite(report), indent=2, allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(own) for key, own in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(own) for own in value]
    return finite_or_none(value) if isinstance(value, float) else value
