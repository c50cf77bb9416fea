"""The arrays of a kernel, and the table that tells it where they are.

The table has a row for the constants, if there are any, and one for each array: its address, and the bytes between
samples and between components.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from hingepair.engine.llvm.builder import FunctionBuilder
from hingepair.engine.llvm.ir import ROW_WORDS

FLOAT_TYPES: Final = {"d": "double", "f": "float"}  # LLVM's name of a type, by the character of the dtype


class Operand(NamedTuple):
    """An array that a kernel reads or writes."""

    sample_shape: tuple[int, ...]  # of one sample: the core dimensions
    used: bool = True  # whether the kernel has a row for it; others broadcast, but nothing reads them


class Layout(NamedTuple):
    """The arrays of a kernel, in order."""

    inputs: tuple[Operand, ...]
    outputs: tuple[Operand, ...]
    constants: bool  # whether the kernel takes constants, before all others

    @property
    def operands(self) -> tuple[Operand, ...]:
        """Inputs, then outputs."""
        return (*self.inputs, *self.outputs)

    @property
    def signature(self) -> str:
        """Signature of the ufunc; sizes are fixed, so that NumPy refuses arrays that are shorter.

        >>> Layout((Operand((7,)), Operand(())), (Operand((3, 3)),), False).signature
        '(7),()->(3,3)'
        """
        groups = ([f"({','.join(map(str, one.sample_shape))})" for one in g] for g in (self.inputs, self.outputs))
        return "->".join(map(",".join, groups))

    @property
    def rows(self) -> dict[int, int]:
        """Rows of the kernel's table, by the place of an operand that the kernel reads or writes."""
        used = (k for k, one in enumerate(self.operands) if one.used)
        return {k: row for row, k in enumerate(used, int(self.constants))}


def begin_table(f: FunctionBuilder, layout: Layout, constants: str, number_bytes: int) -> str:
    """Return the address of the kernel's table, in which the row of the constants is filled."""
    table = f.buffer(8 * ROW_WORDS * (len(layout.rows) + layout.constants))
    if layout.constants:
        store_row(f, table, 0, f.put(f"ptrtoint ptr {constants} to i64"), "0", str(number_bytes))
    return table


def store_row(f: FunctionBuilder, table: str, row: int, *values: str) -> None:
    """Store the integers of a row of the kernel's table."""
    for k, value in enumerate(values):
        f.store_word(value, table, 8 * (ROW_WORDS * row + k))
