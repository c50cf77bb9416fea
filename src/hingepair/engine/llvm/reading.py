"""LLVM functions that read eight samples of an input into the frame, one vector for each component that is needed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from hingepair.engine.llvm.builder import LANES, FunctionBuilder, shared_name
from hingepair.engine.llvm.memory import PREFETCH_SAMPLES

if TYPE_CHECKING:
    from hingepair.engine.llvm.ir import KernelBuilder


class InputReader:
    """Builder of the code that reads one input.

    Args:
        kernel: builder of the kernel.
        index: index of the input.
        row: the integers of its row of the table, of which address and strides come first.
    """

    def __init__(self, kernel: KernelBuilder, index: int, row: Sequence[str]) -> None:
        f = self.f = kernel.f
        self.count = len(kernel.inputs[index].values)
        self.start, self.stride, self.step, *self.strides = row
        self.base = f.put(f"inttoptr i64 {self.start} to ptr")
        self.components, self.slot = kernel.schedule.input_slots[index]
        self.function = f"@read.{index}"
        kernel.functions.append(self._function(kernel))
        # What is read some samples later, which hides the latency of memory: of rows the lines of eight samples, of
        # columns a line of each.
        by_rows = f.put(f"icmp sle i64 {self.step}, {self.stride}")
        line = f.put(f"sdiv i64 {f.multiply(self.stride, LANES)}, {self.count}")
        apart = f.put(f"select i1 {by_rows}, i64 {line}, i64 {self.step}")
        ahead = f.multiply(self.stride, PREFETCH_SAMPLES)
        self.ahead = [f.put(f"add i64 {ahead}, {f.multiply(apart, k)}") for k in range(self.count)]

    def prefetch(self, i: str) -> None:
        """Prefetch what is read soon after sample i."""
        row = self.f.pointer_at(self.base, self.f.multiply(i, self.stride))
        for offset in self.ahead:
            self.f.do(f"call void @llvm.prefetch.p0(ptr {self.f.pointer_at(row, offset)}, i32 0, i32 2, i32 1)")

    def address(self, *indices: str) -> str:
        """Return the address of a sample, and of a record, step and stage of a scan; those left out are the first."""
        address = self.start
        for index, stride in zip(indices, (self.stride, *self.strides), strict=False):
            address = self.f.put(f"add i64 {address}, {self.f.multiply(index, stride)}")
        return address

    def read(self, address: str, samples_left: str) -> None:
        """Read the eight samples from an address on, or the `samples_left` that exist."""
        row = self.f.put(f"inttoptr i64 {address} to ptr")
        strides = f"i64 {self.stride}, i64 {self.step}, i64 {samples_left}"
        self.f.do(f"call void {self.function}(ptr %frame, ptr {row}, {strides})")

    def _function(self, kernel: KernelBuilder) -> str:
        """Return the function, with a way for samples side by side, one for rows, and one for any others."""
        parameters = "ptr noalias %frame, ptr %row, i64 %stride, i64 %step, i64 %rest"
        f = FunctionBuilder(f"internal void {self.function}({parameters})")
        arithmetic, vector, size = kernel.arithmetic, kernel.arithmetic.vector, kernel.number_bytes
        full = f.put(f"icmp sge i64 %rest, {LANES}")
        beside = f.put(f"and i1 {full}, {f.put(f'icmp eq i64 %stride, {size}')}")
        with f.when_else(beside) as otherwise:
            for k, c in enumerate(self.components):
                place = f.pointer_at("%row", f.multiply("%step", c) if c else 0)
                arithmetic.store_slot(f, self.slot + k, f.put(f"load {vector}, ptr {place}, align 1"))
            otherwise()
            differ = f.put(f"and i1 {full}, {f.put('icmp ne i64 %stride, 0')}")
            rows = f.put(f"and i1 {differ}, {f.put(f'icmp eq i64 %step, {size}')}")
            with f.when_else(rows) as otherwise_any:
                self._read_rows(f, kernel)
                otherwise_any()
                which = f"ptr {kernel.add_table(self.components)}, i64 {len(self.components)}"
                to = arithmetic.slot_address(f, self.slot)
                source = "ptr %row, i64 %stride, i64 %step, i64 %rest"
                f.do(f"call void {shared_name('gather', arithmetic.float_type)}(ptr {to}, {which}, {source})")
        f.do("ret void")
        return f.text()

    def _read_rows(self, f: FunctionBuilder, kernel: KernelBuilder) -> None:
        """Append the loads of eight rows, of which eight components at a time are transposed; the last eight overlap
        those before if need be.
        """
        arithmetic, vector, size = kernel.arithmetic, kernel.arithmetic.vector, kernel.number_bytes
        rows = ["%row", *(f.pointer_at("%row", f.multiply("%stride", k)) for k in range(1, LANES))]
        slots = {c: self.slot + k for k, c in enumerate(self.components)}
        for c in range(0, self.count, LANES):
            first = max(0, min(c, self.count - LANES))
            block = range(first, min(first + LANES, self.count))
            if not slots.keys() & {*block}:
                continue
            places = [f.pointer_at(row, size * first) for row in rows]
            if len(block) == LANES:
                vectors = [f.put(f"load {vector}, ptr {place}, align 1") for place in places]
            else:
                exist = ", ".join(f"i1 {k < len(block)}".lower() for k in range(LANES))
                options = f"i32 {size}, <{LANES} x i1> <{exist}>, {vector} poison"
                load = f"@llvm.masked.load.v{LANES}f{8 * size}.p0"
                vectors = [f.put(f"call {vector} {load}(ptr {place}, {options})") for place in places]
            for component, column in zip(block, f.transpose(vector, vectors), strict=False):
                if component in slots:
                    arithmetic.store_slot(f, slots[component], column)
