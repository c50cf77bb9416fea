"""`hingepair bench`: run time and error of a pair's kinematics on this machine."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from hingepair.cli.options import JsonOption
from hingepair.cli.output import show
from hingepair.errors import ArgumentError, quoted
from hingepair.tables.sheets import ruled_table

if TYPE_CHECKING:
    from hingepair.bench.pair import Row

_NOTE = (
    "first: the first call of a process, whose machine code may be on the disk; next: a later call; each: its time "
    "for one state; pin: ratio to Pinocchio's calls from Python for one state; floor: ratio to copying the outputs. "
    "Medians of fresh processes. error: largest of any output on random and on numerically difficult states, against "
    "60 digits [u * scale]; inf: not finite."
)


def bench_command(
    sizes: Annotated[str, typer.Option(help="Numbers of states, separated by commas.")] = "1,100,10000,1000000",
    repeats: Annotated[int, typer.Option(min=1, max=1000, help="Number of fresh processes for each size.")] = 5,
    as_json: JsonOption = False,
) -> None:
    """Measure forward kinematics of a pair: run time and error.

    hingepair, a Python loop over Pinocchio and NumPy compute R2, S2, v2 and omega2 of the same states; errors are
    those against arithmetic of 60 digits. Whole robots are measured by the scripts in the folder benchmarks of the
    repository.
    """
    from hingepair.bench import pair

    counts = [int(part) if part.strip().isdecimal() else 0 for part in sizes.split(",")]
    if not all(1 <= count <= 10**7 for count in counts):
        raise ArgumentError("sizes", "integers from 1 to 10000000, separated by commas", quoted(sizes))
    print("each size is measured in fresh processes, which takes some seconds", file=sys.stderr)
    rows, facts = list(pair.bench(counts, repeats)), pair.machine_facts()
    machine = ", ".join(f"{key} {value}" for key, value in facts.items())
    texts = [part for text in (_NOTE, machine) for part in ("", textwrap.fill(text, 100))]
    show(as_json, {"facts": facts, "rows": [row._asdict() for row in rows]}, *_table(rows), *texts)


def _table(rows: Sequence[Row]) -> list[str]:
    """Return the lines of a table, a block for each number of states."""
    lines: list[Sequence[str]] = [("", "first", "next", "each", "pin", "floor", "error")]
    for i, row in enumerate(rows):
        if i == 0 or rows[i - 1].states != row.states:
            lines += [()] if i else []
            lines.append((f"N = {row.states:,}", *[""] * 6))
        times = map(duration_text, (row.first, row.next, row.next / row.states))
        error = "-" if row.error is None else f"{row.error:.2g}"
        lines.append((f"  {row.method}", *times, f"{row.pin:,.3g}", f"{row.floor:,.3g}", error))
    return ruled_table(lines)


def duration_text(seconds: float) -> str:
    """Return a duration in the largest unit in which it is at least 1.

    >>> duration_text(1.234e-8), duration_text(0.25)
    ('12.3 ns', '250 ms')
    """
    units = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    unit = next((unit for unit, size in units.items() if seconds >= size), "ns")
    return f"{seconds / units[unit]:.3g} {unit}"
