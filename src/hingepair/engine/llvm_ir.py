"""The LLVM IR of a kernel: loops over samples around the arithmetic of a trace, eight samples in each vector.

There are two kinds of loop. In a map, samples are independent; values that do not vary from sample to sample are
computed once before the loop. In a scan, the samples of the last axis form a chain, in which each sample takes the
carry of the sample before it; eight chains run side by side.

The loops load inputs into the frame, call the steps of the arithmetic (`llvm_arithmetic`), and store results
(`llvm_memory`). The last samples, which may not fill eight lanes, are computed in the same way: the remaining lanes
repeat the first of them.

A row of the kernel's table describes each group of components (a row of seven coordinates, say) by four integers:
address, bytes between outer samples, between inner samples, and between components. Results are stored as whole
vectors where their samples are contiguous, and past the caches (non-temporal stores) where in addition they have many
components and too many samples for the caches.

Where the machine has the instruction (FMA), every sum with a product is fused here rather than at LLVM's choice, so
that the bits of a result do not depend on what else is computed. Nothing is reordered, and NaN stays NaN.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Final

from hingepair.engine.llvm_arithmetic import Arithmetic, Carry, ComponentGroup, KernelStep
from hingepair.engine.llvm_builder import CACHE_LINE_BYTES, LANE_COUNT, FunctionBuilder, float_type_name, shared_name
from hingepair.engine.llvm_memory import (
    MAX_OUTPUT_COMPONENTS_FOR_STREAMING_STORES,
    PREFETCH_DISTANCE_SAMPLES,
    WIDE_OUTPUT_COMPONENTS_PER_PANEL,
)
from hingepair.engine.llvm_shared import declarations
from hingepair.engine.llvm_sines import lanewise_function

# Declarations of the functions of LLVM that kernels call.
_LLVM_DECLARATIONS_FOR_KERNEL_FUNCTION: Final = (
    "declare void @llvm.prefetch.p0(ptr, i32, i32, i32)\ndeclare i64 @llvm.abs.i64(i64, i1)"
)

INTEGERS_PER_KERNEL_TABLE_ROW: Final = 4
"""Number of integers in a row of the kernel's table."""

MIN_OUTPUT_BYTES_ALONG_INNER_AXIS_FOR_STREAMING_STORES: Final = 2**21
"""Size of an output along the inner axis from which it is written by streaming stores, past the caches."""


def kernel_ir(
    inputs: Sequence[ComponentGroup],
    outputs: Sequence[ComponentGroup],
    *,
    single: bool = False,
    fuse: bool = True,
    carry: Carry | None = None,
) -> str:
    """Return the LLVM module, as text, of the function `kernel(table, outer, inner)`, which computes outer times
    inner samples. `inputs` and `outputs` hold a `ComponentGroup` for each array. The kernel computes in float32
    instead of float64 if `single` is true, and with fused multiply-adds if `fuse` is true. If `carry` is given, the
    kernel is a scan along the inner samples; otherwise all samples are independent.

    Args:
        inputs: groups of input components, in the order of the table's rows.
        outputs: groups of output components, whose rows follow those of the inputs.
        single: whether to compute in float32 instead of float64; sines are computed in float64.
        fuse: whether sums are fused with products (FMA).
        carry: the carried values of a scan, in which each outer sample is a chain of inner samples; None for a map.
    """
    return _KernelBuilder(Arithmetic(inputs, outputs, carry, float_type_name(single), fuse)).module()


class _KernelBuilder:
    """Builder of the LLVM module of one kernel: loops over the samples around calls of the steps of its arithmetic.
    `module` returns the text of the module.
    """

    def __init__(self, arithmetic: Arithmetic) -> None:
        self.arithmetic = arithmetic
        self.inputs, self.outputs = arithmetic.inputs, arithmetic.outputs
        self.scan = arithmetic.carry is not None
        self.number_bytes = arithmetic.number_bytes
        self.tables: list[str] = []
        self.f = FunctionBuilder("void @kernel(ptr noalias %table, i64 %outer, i64 %inner)")

    def module(self) -> str:
        """Return the LLVM module as text: constant tables, declarations, the functions of the steps, and the kernel.
        It may be called only once, since it appends to the builder.
        """
        float_type = self.arithmetic.float_type
        steps = self.arithmetic.step_functions()
        self.write_kernel()
        lanewise = [lanewise_function(name) for name in self.arithmetic.lanewise_functions]
        definitions = [
            *self.tables,
            *declarations(float_type),
            _LLVM_DECLARATIONS_FOR_KERNEL_FUNCTION,
            *lanewise,
            *steps,
            self.f.text(),
        ]
        return "\n\n".join(definitions) + "\n"

    def add_table(self, numbers: Sequence[int]) -> str:
        """Add integers to the module as a constant array of 32-bit integers, and return the name of the array."""
        name = f"@table{len(self.tables)}"
        listed = ", ".join(f"i32 {number}" for number in numbers)
        self.tables.append(f"{name} = internal constant [{len(numbers)} x i32] [{listed}]")
        return name

    def call_shared(self, function_name: str, *arguments: str) -> None:
        """Append to the kernel the call of a shared function, given by its short name. The further positional
        arguments are the function's arguments as LLVM IR text.
        """
        self.f.do(f"call void {shared_name(function_name, self.arithmetic.float_type)}({', '.join(arguments)})")

    def write_kernel(self) -> None:
        """Append all instructions of the kernel function: the loops over outer and inner samples, and the memory
        fence after streaming stores.
        """
        f, arithmetic = self.f, self.arithmetic
        table = [
            [
                f.load_word("%table", 8 * (g * INTEGERS_PER_KERNEL_TABLE_ROW + k))
                for k in range(INTEGERS_PER_KERNEL_TABLE_ROW)
            ]
            for g in range(len(self.inputs) + len(self.outputs))
        ]
        f.do(f"%frame = alloca [{max(1, arithmetic.frame_size)} x {arithmetic.vector}], align {CACHE_LINE_BYTES}")
        f.do(f"%places = alloca [{arithmetic.word_offsets[-1] + len(self.outputs)} x i64], align 8")
        for number, slot in arithmetic.constant_slots.items():
            arithmetic.store_slot(f, slot, arithmetic.operand(number))
        readers = [_InputReader(self, g, row) for g, row in enumerate(table[: len(self.inputs)])]
        writers = [_OutputWriter(self, g, row) for g, row in enumerate(table[len(self.inputs) :])]
        lanes = str(LANE_COUNT)
        with f.loop("%outer", step=lanes if self.scan else "1") as o:
            chains = f.put(f"sub i64 %outer, {o}")
            for reader in readers:
                reader.begin_outer(o)
            for writer in writers:
                writer.begin_outer(o)
            for reader in readers:
                if not reader.group.varies:
                    reader.read_uniform(chains)
            self.call_steps(arithmetic.uniform_steps)
            if self.scan:
                with f.loop("%inner") as i:
                    self.write_block(readers, writers, i, chains)
            else:
                start = self.write_direct_blocks(readers, writers)
                with f.loop("%inner", start=start, step=lanes) as i:
                    self.write_block(readers, writers, i, f.put(f"sub i64 %inner, {i}"))
            for writer in writers:
                writer.end_outer()
        streamed = [writer.streamed for writer in writers if writer.streamed != "false"]
        for one in streamed:
            with f.when(one):  # makes the non-temporal stores visible to other threads
                f.do("fence seq_cst")
        f.do("ret void")

    def write_direct_blocks(self, readers: Sequence[_InputReader], writers: Sequence[_OutputWriter]) -> str:
        """Append to the kernel the loop over complete blocks of eight samples whose rows go directly into the
        outputs. The loop runs only if all outputs are contiguous and none is written by streaming stores. Return the
        name of the index of the first sample that is left.
        """
        f = self.f
        direct = "true"
        for writer in writers:
            direct = f.put(f"and i1 {direct}, {writer.dense}")
            if writer.streamed != "false":
                direct = f.put(f"and i1 {direct}, {f.put(f'xor i1 {writer.streamed}, true')}")
        stop = f.put(f"select i1 {direct}, i64 {f.put(f'and i64 %inner, -{LANE_COUNT}')}, i64 0")
        with f.loop(stop, step=str(LANE_COUNT)) as i:
            for writer in writers:
                writer.set_row_address(writer.row(i))
            for reader in readers:
                reader.read(i, str(LANE_COUNT))
            self.call_steps(self.arithmetic.varying_steps)
            for writer in writers:
                if not writer.group.narrow:
                    writer.write_rows(writer.row(i), "false")
        return stop

    def write_block(
        self, readers: Sequence[_InputReader], writers: Sequence[_OutputWriter], inner_index: str, samples_left: str
    ) -> None:
        """Append to the kernel the computation of the block of eight inner samples that begins at `inner_index`: the
        loads by all readers, the steps, and the stores by all writers. Only the first `samples_left` samples of the
        block exist.
        """
        for writer in writers:
            writer.begin_samples(inner_index, samples_left)
        for reader in readers:
            reader.read(inner_index, samples_left)
        self.call_steps(self.arithmetic.varying_steps)
        for writer in writers:
            writer.write_samples()

    def call_steps(self, steps: Sequence[KernelStep]) -> None:
        """Append calls of the steps, in order, to the kernel. A step of arithmetic is a call of the step's own LLVM
        function, which `module` defines; a step of sines is a call of the shared function `sines`, for which a
        constant table is added to the module.
        """
        for step in steps:
            if step.angles:
                slots, first = self.arithmetic.sine_slots(step)
                angles = f"ptr {self.add_table(slots)}, i64 {len(slots)}"
                self.call_shared("sines", "ptr %frame", angles, f"ptr {self.arithmetic.slot_address(self.f, first)}")
            else:
                self.f.do(f"call void @{step.name}(ptr %frame, ptr %places)")


class _InputReader:
    """Builder of the LLVM code that reads one input of a kernel. Its methods append instructions to the kernel.

    Args:
        kernel: builder of the kernel.
        index: index of the input.
        table_row: names of the four integers of the input's row of the table.
    """

    def __init__(self, kernel: _KernelBuilder, index: int, table_row: Sequence[str]) -> None:
        f = self.f = kernel.f
        self.kernel, self.group = kernel, kernel.inputs[index]
        self.count = len(self.group.values)
        self.address, self.outer, self.inner, self.step = table_row
        self.scan = kernel.scan
        self.stride = self.outer if self.scan else self.inner if self.group.varies else "0"
        self.components, self.slot = kernel.arithmetic.input_slots[index]
        self.word_offset = 8 * kernel.arithmetic.word_offsets[index]
        self.in_registers = index in kernel.arithmetic.register_inputs
        if self.in_registers:
            f.do(f"store i64 {self.step}, ptr {f.pointer_at('%places', self.word_offset + 8 * LANE_COUNT)}, align 8")
            if not self.scan:
                self.prefetched = self.prefetch_offsets()
        else:
            self.components_table = kernel.add_table(self.components)
        self.shared, self.shared_slot = kernel.arithmetic.input_scalars[index]

    def prefetch_offsets(self) -> list[str]:
        """Append to the kernel the computation of the byte offsets of the cache lines that are prefetched for a block
        of eight samples, and return the list of the names of the offsets.

        For an input stored in rows these are all lines of eight samples, or only those that hold needed components if
        these are fewer; for an input stored in columns, one line of each needed component.
        """
        f = self.f
        starts = self.components[:1]
        for c in self.components:
            last = c == self.components[-1] > starts[-1]
            if (c - starts[-1]) * self.kernel.number_bytes >= CACHE_LINE_BYTES or last:
                starts.append(c)
        if LANE_COUNT * len(starts) < self.count:
            samples = [f.multiply(self.stride, k) for k in range(LANE_COUNT)]
            rows = [f.put(f"add i64 {sample}, {f.multiply(self.step, c)}") for sample in samples for c in starts]
        else:
            along = f.put(f"sdiv i64 {f.multiply(self.stride, LANE_COUNT)}, {self.count}")
            rows = [f.multiply(along, k) for k in range(self.count)]
        columns = [f.multiply(self.step, c) for c in self.components]
        wide, far = (f.put(f"call i64 @llvm.abs.i64(i64 {x}, i1 false)") for x in (self.stride, self.step))
        by_rows = f.put(f"icmp sle i64 {far}, {wide}")
        both = itertools.zip_longest(rows, columns, fillvalue="0")
        lines = [f.put(f"select i1 {by_rows}, i64 {row}, i64 {column}") for row, column in both]
        ahead = f.multiply(self.stride, PREFETCH_DISTANCE_SAMPLES)
        return [f.put(f"add i64 {ahead}, {line}") for line in lines]

    def begin_outer(self, outer_index: str) -> None:
        """Append to the kernel the computation of the input's address at an outer sample, and keep the name of
        the address in the attribute `base`. For an input in registers, also append the store of the byte
        offsets of eight samples. In a scan, eight outer samples are computed at a time, and the address is that
        of the first of them.
        """
        f = self.f
        self.base = f.pointer_at(f.put(f"inttoptr i64 {self.address} to ptr"), f.multiply(outer_index, self.outer))
        if self.in_registers:
            self.store_lane_offsets(f.put(f"sub i64 %outer, {outer_index}") if self.scan else str(LANE_COUNT))

    def store_lane_offsets(self, samples_left: str) -> None:
        """Append to the kernel the store of the byte offsets of the eight samples of a block relative to the first of
        them, which the steps read. Only the first `samples_left` samples exist; the others get the offset 0.
        """
        to = self.f.pointer_at("%places", self.word_offset + 8)
        self.kernel.call_shared("lanes", f"ptr {to}, i64 {self.stride}, i64 {samples_left}")

    def read(self, inner_index: str, samples_left: str) -> None:
        """Append to the kernel instructions that load and prefetch this input for the eight inner samples that begin
        at `inner_index`, of which the first `samples_left` exist. Append nothing for an input that does not vary.
        """
        f = self.f
        if not self.group.varies:
            return
        row = f.pointer_at(self.base, f.multiply(inner_index, self.inner))
        if not self.in_registers:
            self.gather_components(row, samples_left)
            return
        f.do(f"store ptr {row}, ptr {f.pointer_at('%places', self.word_offset)}, align 8")
        if self.scan:
            return
        for distance in self.prefetched:
            f.do(f"call void @llvm.prefetch.p0(ptr {f.pointer_at(row, distance)}, i32 0, i32 2, i32 1)")
        if not samples_left.isdigit():
            with f.when(f.put(f"icmp slt i64 {samples_left}, {LANE_COUNT}")):
                self.store_lane_offsets(samples_left)

    def read_uniform(self, outer_samples_left: str) -> None:
        """Append to the kernel instructions that load this input, which is equal for all inner samples, into the
        frame, the kernel's buffer of vectors: each needed component as a vector, or as a single number if there are
        many components. In a scan, the lanes of a vector are eight outer samples, of which the first
        `outer_samples_left` exist.
        """
        f = self.f
        if self.shared:
            to = self.kernel.arithmetic.slot_address(f, self.shared_slot)
            which = f"ptr {self.kernel.add_table(self.shared)}, i64 {len(self.shared)}"
            self.kernel.call_shared("numbers", f"ptr {to}", which, f"ptr {self.base}, i64 {self.step}")
        if self.components:
            self.gather_components(self.base, outer_samples_left)

    def gather_components(self, row_address: str, samples_left: str) -> None:
        """Append to the kernel instructions that load the needed components of this input for eight samples into the
        frame, the kernel's buffer of vectors. The first sample is at `row_address`, and the first `samples_left`
        samples exist.
        """
        f = self.f
        to = self.kernel.arithmetic.slot_address(f, self.slot)
        which = f"ptr {self.components_table}, i64 {len(self.components)}"
        source = f"ptr {row_address}, i64 {self.stride}, i64 {self.step}, i64 {samples_left}"
        if len(self.components) < self.count or self.count < LANE_COUNT or not self.group.varies:
            self.kernel.call_shared("gather", f"ptr {to}", which, source)
            return
        dense = f.put(f"icmp eq i64 {self.step}, {self.kernel.number_bytes}")
        full = f.put(f"icmp sge i64 {samples_left}, {LANE_COUNT}")
        with f.when_else(f.put(f"and i1 {dense}, {full}")) as otherwise:
            self.kernel.call_shared("columns", f"ptr {to}, i64 {self.count}, ptr {row_address}, i64 {self.stride}")
            otherwise()
            self.kernel.call_shared("gather", f"ptr {to}", which, source)


class _OutputWriter:
    """Builder of the LLVM code that stores one output of a kernel, directly or through a buffer on the stack (the
    stage). Its methods append instructions to the kernel.

    Args:
        kernel: builder of the kernel.
        index: index of the output.
        table_row: names of the four integers of the output's row of the table.

    Attributes:
        dense: name of the condition that the output's samples are contiguous.
        streamed: name of the condition that the output is written past the caches; "false" if it never is.
    """

    def __init__(self, kernel: _KernelBuilder, index: int, table_row: Sequence[str]) -> None:
        f = self.f = kernel.f
        self.kernel, self.group = kernel, kernel.outputs[index]
        self.address, self.outer, self.inner, self.step = table_row
        self.stride = self.outer if kernel.scan else self.inner
        self.count, self.number_bytes = len(self.group.values), kernel.number_bytes
        self.row_bytes = self.count * self.number_bytes
        self.word_offset = 8 * (kernel.arithmetic.word_offsets[-1] + index)
        self.dense = self.streamed = "false"
        if not kernel.scan:
            joined = f.put(f"icmp eq i64 {self.inner}, {self.row_bytes}")
            side_by_side = f.put(f"icmp eq i64 {self.step}, {self.number_bytes}")
            self.dense = f.put(f"and i1 {joined}, {side_by_side}") if self.count > 1 else joined
        staged = (
            self.count
            if self.count <= MAX_OUTPUT_COMPONENTS_FOR_STREAMING_STORES
            else 2 * WIDE_OUTPUT_COMPONENTS_PER_PANEL
        )
        if not self.group.narrow:
            self.tiles = kernel.add_table(kernel.arithmetic.tile_offsets(self.group))
            if not kernel.scan and self.count <= MAX_OUTPUT_COMPONENTS_FOR_STREAMING_STORES:
                inner_bytes = f.multiply("%inner", self.row_bytes)
                large = f.put(f"icmp sge i64 {inner_bytes}, {MIN_OUTPUT_BYTES_ALONG_INNER_AXIS_FOR_STREAMING_STORES}")
                odd = f.put(f"and i64 {f.put(f'or i64 {self.address}, {self.outer}')}, {self.number_bytes - 1}")
                aligned = f.put(f"icmp eq i64 {odd}, 0")
                self.streamed = f.put(f"and i1 {self.dense}, {f.put(f'and i1 {large}, {aligned}')}")
        stage_bytes = CACHE_LINE_BYTES + LANE_COUNT * staged * self.number_bytes
        buffer = f.put(f"alloca [{stage_bytes} x i8], align {CACHE_LINE_BYTES}")
        self.stage = f.pointer_at(buffer, CACHE_LINE_BYTES)

    def begin_outer(self, outer_index: str) -> None:
        """Append to the kernel the computation of the output's address at an outer sample. The names of the address
        as an integer and as a pointer are kept in the attributes `start` and `base`. In a scan, eight outer samples
        are computed at a time, and the address is that of the first of them.
        """
        f = self.f
        self.start = f.put(f"add i64 {self.address}, {f.multiply(outer_index, self.outer)}")
        self.base = f.put(f"inttoptr i64 {self.start} to ptr")

    def row(self, inner_index: str) -> str:
        """Append to the kernel the computation of the address of an inner sample, and return the address's name."""
        return self.f.pointer_at(self.base, self.f.multiply(inner_index, self.inner))

    def set_row_address(self, address: str) -> None:
        """Append to the kernel the store of `address`, the name of the address to which the steps write the rows of a
        block.
        """
        self.f.do(f"store ptr {address}, ptr {self.f.pointer_at('%places', self.word_offset)}, align 8")

    def begin_samples(self, inner_index: str, samples_left: str) -> None:
        """Append to the kernel the choice of where the rows of the block at `inner_index` are written: into the
        output, or first into the stage, a buffer on the stack. The first `samples_left` of the block's eight samples
        exist. The names of index, address and choice are kept in attributes for `write_samples`.
        """
        f = self.f
        self.i, self.to, self.rest = inner_index, self.row(inner_index), samples_left
        full = f.put(f"icmp sge i64 {samples_left}, {LANE_COUNT}")
        self.direct = f.put(f"and i1 {self.dense}, {full}")
        if self.streamed != "false":
            self.direct = f.put(f"and i1 {self.direct}, {f.put(f'xor i1 {self.streamed}, true')}")
        self.set_row_address(f.put(f"select i1 {self.direct}, ptr {self.to}, ptr {self.stage}"))

    def flush(self, inner_index: str, sample_count: str, is_last: str) -> None:
        """Append to the kernel the copy, by streaming stores, of `sample_count` samples from the stage, a buffer on
        the stack, to the output from `inner_index` on. `is_last` is the LLVM condition that nothing follows.
        """
        f = self.f
        at = f.put(f"add i64 {self.start}, {f.multiply(inner_index, self.row_bytes)}")
        block = f"ptr {self.stage}, i64 {at}, i64 {f.multiply(sample_count, self.row_bytes)}"
        self.kernel.call_shared("flush", block, f"i64 {self.start}, i1 {is_last}")

    def write_rows(self, target_address: str, is_filled: str) -> None:
        """Append to the kernel the stores of a block's eight rows from the frame, the kernel's buffer of vectors, to
        target_address. `is_filled` is the LLVM condition that the rows there already contain the constants.
        """
        target = f"ptr {target_address}, i64 {self.row_bytes}, i1 {is_filled}"
        self.kernel.call_shared("rows", f"ptr %frame, ptr {self.tiles}, i64 {self.count}, {target}")

    def write_samples(self) -> None:
        """Append to the kernel the stores that bring the rows of the block of `begin_samples` into the output, from
        the frame (the kernel's buffer of vectors) or from the stage (a buffer on the stack). With streaming stores,
        they write the rows of the block before to the output, and leave the rows of this block in the stage.
        """
        f = self.f
        target = f"ptr {self.to}, i64 {self.stride}, i64 {self.step}, i64 {self.rest}"
        if self.count > MAX_OUTPUT_COMPONENTS_FOR_STREAMING_STORES:
            with f.when_else(self.direct) as otherwise:
                self.write_rows(self.to, "false")
                otherwise()
                source = f"ptr %frame, ptr {self.tiles}, i64 {self.count}, ptr {self.stage}"
                self.kernel.call_shared("panels", source, target)
            return
        if not self.group.narrow:
            filled = "false"
            if self.streamed != "false":
                filled = f.put(f"and i1 {self.streamed}, {f.put(f'icmp ne i64 {self.i}, 0')}")
                with f.when(filled):
                    self.flush(f.put(f"sub i64 {self.i}, {LANE_COUNT}"), str(LANE_COUNT), "false")
            self.write_rows(f.put(f"select i1 {self.direct}, ptr {self.to}, ptr {self.stage}"), filled)
        done = f.put(f"or i1 {self.direct}, {self.streamed}")
        with f.when(f.put(f"xor i1 {done}, true")):
            self.kernel.call_shared("scatter", f"ptr {self.stage}, i64 {self.count}", target)

    def end_outer(self) -> None:
        """Append to the kernel the streaming stores of an outer sample's last rows, which are still in the stage, a
        buffer on the stack. Append nothing for an output that is never streamed.
        """
        f = self.f
        if self.streamed != "false":
            with f.when(self.streamed):
                block = f.put(f"and i64 {f.put('sub i64 %inner, 1')}, -{LANE_COUNT}")
                self.flush(block, f.put(f"sub i64 %inner, {block}"), "true")
