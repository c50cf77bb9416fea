"""A kernel that takes NumPy's arrays themselves: machine code reads their heads, checks them and calls the kernel.

What Python has to look at before a kernel can run takes many times as long as a hundred samples do. Taken here are
contiguous arrays of float64, a row a sample, outputs apart from all other arrays, 2 to MOST samples; of anything
else nothing is computed, and the caller goes the long way, which says what is wrong with it if anything is.
"""

from __future__ import annotations

import ctypes
import functools
import math
import sys
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.evaluation.binding import address
from hingepair.evaluation.llvm_ir import FIELDS, SIDE_BY_SIDE
from hingepair.evaluation.native import Kernel, compiled_functions

MOST: Final = 4096
"""Samples: fifty microseconds, for which the interpreter's lock may be kept."""

_TYPE, _DATA, _AXES, _SHAPE, _STRIDES, _DTYPE, _FLAGS = 8, 16, 24, 32, 40, 56, 64  # bytes into the head of an array
_WRITEABLE: Final = 0x0400
_DOUBLE: Final = np.dtype(np.float64)


@functools.cache
def heads_are_known() -> bool:
    """Whether arrays begin as they do in CPython's NumPy of 64 bits (which its binary interface fixes)."""
    if sys.implementation.name != "cpython" or object.__basicsize__ != _DATA or sys.byteorder != "little":
        return False
    probe = np.empty((3, 5))

    def word(place: int, kind: Any = ctypes.c_int64) -> int:
        return int(kind.from_address(place).value)

    start = id(probe)
    found = [word(start + place) for place in (_TYPE, _DATA, _DTYPE)]
    found += [word(start + place, ctypes.c_int) for place in (_AXES, _FLAGS)]
    if found != [id(np.ndarray), probe.ctypes.data, id(_DOUBLE), 2, probe.flags.num]:
        return False
    lines = [word(word(start + place) + 8 * k) for place in (_SHAPE, _STRIDES) for k in (0, 1)]
    return lines == [3, 5, 40, 8]


class Front:
    """The two ways into a kernel of float64.

    Attributes:
        one: of (table, an array of each input, a buffer), one state: the outputs follow each other in the buffer.
        many: of (table, an array of each input, one of each output).

    Both return 1, or 0 where nothing was computed. The table is that of `table_of`; its addresses are filled in.
    """

    def __init__(
        self, kernel: Kernel, constants: bool, inputs: Sequence[int], outputs: Sequence[tuple[int, ...]]
    ) -> None:
        self.kernel = kernel
        writer = _Writer(kernel.address, constants, inputs, outputs)
        code = "\n\n".join((writer.one(), writer.many()))
        self._engine, (one, many) = compiled_functions(code, ("one", "many"))
        given: list[Any] = [ctypes.c_void_p, *[ctypes.py_object] * len(inputs)]
        self.one = ctypes.PYFUNCTYPE(ctypes.c_int, *given, ctypes.py_object)(one)
        self.many = ctypes.PYFUNCTYPE(ctypes.c_int, *given, *[ctypes.py_object] * len(outputs))(many)


def table_of(constants: NDArray[np.float64], inputs: Sequence[int], outputs: Sequence[tuple[int, ...]]) -> Any:
    """The lines that a kernel reads, as far as they are the same for all calls; the constants must outlive it."""
    lines = [(address(constants), 0, 0, 8, 0)] if constants.size else []
    lines += [(0, 0, 8 * count, 8, 0) for count in inputs]
    lines += [(0, 0, 8 * math.prod(tail), 8, SIDE_BY_SIDE) for tail in outputs]
    flat = [field for line in lines for field in line]
    return (ctypes.c_int64 * len(flat))(*flat)


class _Writer:
    """LLVM code of the two functions."""

    def __init__(
        self, kernel: int, constants: bool, inputs: Sequence[int], outputs: Sequence[tuple[int, ...]]
    ) -> None:
        self.kernel, self.inputs, self.outputs = kernel, inputs, outputs
        self.first = int(constants)
        self.lines: list[str] = []
        self.count = 0

    def one(self) -> str:
        self.lines = []
        for k, count in enumerate(self.inputs):
            self.check(f"%in{k}", (count,))
        for k in range(len(self.inputs)):
            self.enter(self.first + k, self.data(f"%in{k}"))
        start, done = self.data("%room"), 0
        for k, tail in enumerate(self.outputs):
            self.enter(self.first + len(self.inputs) + k, self.put(f"add i64 {start}, {8 * done}"))
            done += math.prod(tail)
        return self.function("one", ["%room"], "1")

    def many(self) -> str:
        self.lines = []
        samples, sizes = "", []
        for k, count in enumerate(self.inputs):
            samples = self.check(f"%in{k}", (samples, count))
            sizes.append((f"%in{k}", count))
        few = self.put(f"icmp ule i64 {samples}, {MOST}")
        some = self.put(f"icmp ugt i64 {samples}, 1")  # a batch of one is computed as constants are
        self.go_on(self.put(f"and i1 {few}, {some}"))
        for k, tail in enumerate(self.outputs):
            self.check(f"%out{k}", (samples, *tail), writeable=True)
            sizes.append((f"%out{k}", math.prod(tail)))
        ranges = []
        for array, count in sizes:
            start = self.data(array)
            ranges.append((start, self.put(f"add i64 {start}, {self.put(f'mul i64 {samples}, {8 * count}')}")))
        apart = "true"
        for j in range(len(self.inputs), len(ranges)):
            for k in range(j):
                before = self.put(f"icmp ule i64 {ranges[j][1]}, {ranges[k][0]}")
                behind = self.put(f"icmp ule i64 {ranges[k][1]}, {ranges[j][0]}")
                apart = self.put(f"and i1 {apart}, {self.put(f'or i1 {before}, {behind}')}")
        self.go_on(apart)
        for k, (start, _) in enumerate(ranges):
            self.enter(self.first + k, start)
        return self.function("many", [f"%out{k}" for k in range(len(self.outputs))], samples)

    def function(self, name: str, others: Sequence[str], samples: str) -> str:
        given = ", ".join(f"ptr {x}" for x in ("%table", *(f"%in{k}" for k in range(len(self.inputs))), *others))
        body = "\n".join(self.lines)
        return f"""define i32 @{name}({given}) {{
entry:
{body}
  call void inttoptr (i64 {self.kernel} to ptr)(ptr %table, i64 1, i64 {samples})
  ret i32 1
no:
  ret i32 0
}}"""

    def put(self, code: str) -> str:
        self.count += 1
        self.lines.append(f"  %t{self.count} = {code}")
        return f"%t{self.count}"

    def go_on(self, condition: str) -> None:
        self.count += 1
        self.lines += [f"  br i1 {condition}, label %on{self.count}, label %no", f"on{self.count}:"]

    def field(self, start: str, place: int, kind: str) -> str:
        return self.put(f"load {kind}, ptr {self.put(f'getelementptr i8, ptr {start}, i64 {place}')}")

    def data(self, array: str) -> str:
        return self.field(array, _DATA, "i64")

    def enter(self, line: int, start: str) -> None:
        """Put an address into a line of the table."""
        self.lines.append(
            f"  store i64 {start}, ptr {self.put(f'getelementptr i64, ptr %table, i64 {line * FIELDS}')}"
        )

    def check(self, array: str, shape: tuple[Any, ...], writeable: bool = False) -> str:
        """Go on only with an array of this dtype and shape, row after row; the length of its first axis, if open."""
        kind = self.put(f"icmp eq i64 {self.field(array, _TYPE, 'i64')}, {id(np.ndarray)}")
        self.go_on(kind)  # nothing else of what is no array can be looked at
        axes = self.put(f"icmp eq i32 {self.field(array, _AXES, 'i32')}, {len(shape)}")
        self.go_on(axes)
        good = self.put(f"icmp eq i64 {self.field(array, _DTYPE, 'i64')}, {id(_DOUBLE)}")
        lengths, strides = self.field(array, _SHAPE, "ptr"), self.field(array, _STRIDES, "ptr")
        stride, found = 8, ""
        for k in reversed(range(len(shape))):
            length = self.field(lengths, 8 * k, "i64")
            tests = [self.put(f"icmp eq i64 {self.field(strides, 8 * k, 'i64')}, {stride}")]
            if shape[k] == "":
                found = length
            else:
                tests.append(self.put(f"icmp eq i64 {length}, {shape[k]}"))
                stride *= shape[k] if k else 1
            for test in tests:
                good = self.put(f"and i1 {good}, {test}")
        if writeable:
            bit = self.put(f"and i32 {self.field(array, _FLAGS, 'i32')}, {_WRITEABLE}")
            good = self.put(f"and i1 {good}, {self.put(f'icmp ne i32 {bit}, 0')}")
        self.go_on(good)
        return found or str(shape[0])
