"""The LLVM IR of a kernel: a loop over samples around the arithmetic of a trace, eight samples in each vector.

The loop loads inputs into the frame, calls the steps of the arithmetic (`arithmetic`), and stores results
(`memory`). The last samples, which may not fill eight lanes, are computed in the same way: the remaining lanes
repeat the first of them.

A row of the kernel's table describes each group of components (a row of seven coordinates, say) by three integers:
address, bytes between samples, and bytes between components. Results are stored as whole vectors where their samples
are contiguous, and past the caches (non-temporal stores) where in addition they have many components and too many
samples for the caches.

It computes with the default floating-point environment and restores that of the caller, flags included: a NaN stays
in its sample in silence. Where the machine has the instruction (FMA), every sum with a product is fused here rather
than at LLVM's choice, so that the bits of a result do not depend on what else is computed. Nothing is reordered.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from hingepair.engine.llvm.arithmetic import Arithmetic
from hingepair.engine.llvm.builder import CACHE_LINE, LANES, FunctionBuilder, default_float_environment, shared_name
from hingepair.engine.llvm.memory import MAX_STREAMED, MEMORY_FUNCTIONS, PREFETCH_SAMPLES, memory_functions
from hingepair.engine.llvm.schedule import Schedule
from hingepair.engine.llvm.sines import SINE_FUNCTIONS, lanewise_function, sine_functions

ROW_WORDS: Final = 3  # integers in a row of the kernel's table: address, bytes between samples and between components
MIN_STREAMED_BYTES: Final = 2**21  # of an output that is stored past the caches; fewer find room in them
_SHARED: Final = {**MEMORY_FUNCTIONS, **SINE_FUNCTIONS}  # parameters of the functions that kernels share


def shared_ir(float_type: str) -> str:
    """Return the LLVM module of the functions that kernels share, for numbers of type "double" or "float"."""
    return "\n\n".join([*memory_functions(float_type), *sine_functions(float_type), "!0 = !{i32 1}"]) + "\n"


def shared_symbols(float_type: str) -> list[str]:
    """Return the symbols of the functions that kernels share."""
    return [shared_name(name, float_type)[1:] for name in _SHARED]


def kernel_ir(schedule: Schedule, float_type: str) -> str:
    """Return the LLVM module, as text, of the function `kernel(table, samples)`.

    Args:
        schedule: the program. The table's rows are that of the constants, if there are any, those of the inputs, and
            those of the outputs.
        float_type: "double" or "float" (float32); sines are computed in float64.
    """
    return KernelBuilder(Arithmetic(schedule, float_type)).module()


class KernelBuilder:
    """Builder of one kernel; `module` may be called once."""

    SIGNATURE = "void @kernel(ptr noalias %table, i64 %samples)"

    def __init__(self, arithmetic: Arithmetic) -> None:
        self.arithmetic = arithmetic
        self.schedule = arithmetic.schedule
        self.inputs, self.outputs = self.schedule.inputs, self.schedule.outputs
        self.number_bytes = arithmetic.number_bytes
        self.tables: list[str] = []
        self.functions: list[str] = []  # that read inputs and write outputs
        self.f = FunctionBuilder(self.SIGNATURE)

    def module(self) -> str:
        """Return the LLVM module: constant tables, declarations, the functions of the steps, and the kernel."""
        steps = self.arithmetic.step_functions()
        self.write_kernel()
        declared = [
            f"declare void {shared_name(name, self.arithmetic.float_type)}({parameters})"
            for name, parameters in _SHARED.items()
        ]
        declared.append("declare ptr @malloc(i64)\ndeclare void @free(ptr)")
        vector, load = self.arithmetic.vector, f"@llvm.masked.load.v{LANES}f{8 * self.number_bytes}.p0"
        declared.append("declare void @llvm.prefetch.p0(ptr, i32, i32, i32)")
        declared.append(f"declare {vector} {load}(ptr, i32, <{LANES} x i1>, {vector})")
        lanewise = [lanewise_function(name) for name in sorted(self.arithmetic.lanewise_functions)]
        return "\n\n".join([*self.tables, *declared, *lanewise, *self.functions, *steps, self.f.text()]) + "\n"

    def add_table(self, numbers: Sequence[int]) -> str:
        """Return the name of a constant array of 32-bit integers."""
        name = f"@table{len(self.tables)}"
        listed = ", ".join(f"i32 {number}" for number in numbers)
        self.tables.append(f"{name} = internal constant [{len(numbers)} x i32] [{listed}]")
        return name

    def call_shared(self, function: str, *arguments: str) -> None:
        """Call a shared function."""
        self.f.do(f"call void {shared_name(function, self.arithmetic.float_type)}({', '.join(arguments)})")

    def write_kernel(self) -> None:
        """Write the kernel: the loops over samples, and the memory fence after streaming stores."""
        f = self.f
        environment, restore = default_float_environment(f)
        self.functions += environment
        rows = self.begin_kernel(ROW_WORDS)
        readers = [InputReader(self, g, row) for g, row in enumerate(rows[: len(self.inputs)])]
        writers = [_OutputWriter(self, g, row) for g, row in enumerate(rows[len(self.inputs) :])]
        with f.loop("%samples", step=str(LANES)) as i:
            left = f.put(f"sub i64 %samples, {i}")
            for writer in writers:
                writer.begin_samples(i, left)
            for reader in readers:
                reader.prefetch(i)
                reader.read(reader.address(i), left)
            self.call_steps()
            for writer in writers:
                writer.write_samples()
        for writer in writers:
            writer.end()
        for writer in writers:
            if writer.streamed != "false":
                with f.when(writer.streamed):  # makes the non-temporal stores visible to other threads
                    f.do("fence seq_cst")
        restore()
        f.do("ret void")

    def begin_kernel(self, row_words: int) -> list[list[str]]:
        """Load the address of the constants; make the frame, and store the constants that have slots there. Return
        the rows of the table of inputs and outputs, of so many words each.
        """
        f, arithmetic, schedule = self.f, self.arithmetic, self.schedule
        first = int(schedule.has_constants)
        f.do("%constants = load ptr, ptr %table, align 8")
        rows = [
            [f.load_word("%table", 8 * (g * row_words + k)) for k in range(row_words)]
            for g in range(first, first + len(self.inputs) + len(self.outputs))
        ]
        frame = f.buffer(max(1, schedule.frame_size) * LANES * arithmetic.number_bytes)
        f.do(f"%frame = getelementptr i8, ptr {frame}, i64 0")
        f.do(f"%places = alloca [{len(self.outputs)} x i64], align 8")
        for one, slot in schedule.constant_slots.items():
            arithmetic.store_slot(f, slot, arithmetic.constant(f, one))
        return rows

    def call_steps(self) -> None:
        """Call the steps in order."""
        for step in self.schedule.steps:
            if step.angles:
                slots, first = self.schedule.sine_slots(step)
                angles = f"ptr {self.add_table(slots)}, i64 {len(slots)}"
                self.call_shared("sines", "ptr %frame", angles, f"ptr {self.arithmetic.slot_address(self.f, first)}")
            else:
                self.f.do(f"call void @{step.name}(ptr %frame, ptr %places, ptr %constants)")


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
        return self.f.add_multiples(self.start, zip(indices, (self.stride, *self.strides), strict=False))

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


class _OutputWriter:
    """Builder of the code that stores one output, directly or through the stage, a buffer on the stack.

    Args:
        kernel: builder of the kernel.
        index: index of the output.
        row: the three integers of its row of the table.

    Attributes:
        dense: the condition that the output's samples are contiguous.
        streamed: the condition that it is written past the caches; "false" if it never is.
        takes_rows: the condition that rows of samples can be written directly into it.
    """

    def __init__(self, kernel: KernelBuilder, index: int, row: Sequence[str]) -> None:
        f = self.f = kernel.f
        self.kernel, self.index, self.group = kernel, index, kernel.outputs[index]
        self.start, self.stride, self.step = row
        self.base = f.put(f"inttoptr i64 {self.start} to ptr")
        self.count, number_bytes = len(self.group.values), kernel.number_bytes
        self.row_bytes = self.count * number_bytes
        self.streamed = "false"
        self.dense = f.put(f"icmp eq i64 {self.stride}, {self.row_bytes}")
        if self.count > 1:
            self.dense = f.put(f"and i1 {self.dense}, {f.put(f'icmp eq i64 {self.step}, {number_bytes}')}")
        if not self.group.narrow:
            self.tiles = kernel.add_table(kernel.arithmetic.tile_offsets(index))
            if self.count <= MAX_STREAMED:
                large = f.put(f"icmp sge i64 {f.multiply('%samples', self.row_bytes)}, {MIN_STREAMED_BYTES}")
                aligned = f.put(f"icmp eq i64 {f.put(f'and i64 {self.start}, {number_bytes - 1}')}, 0")
                self.streamed = f.put(f"and i1 {self.dense}, {f.put(f'and i1 {large}, {aligned}')}")
        self.takes_rows = f.put(f"and i1 {self.dense}, {f.put(f'xor i1 {self.streamed}, true')}")
        buffer = f.buffer(CACHE_LINE + LANES * self.row_bytes)
        self.stage = f.pointer_at(buffer, CACHE_LINE)  # behind the rest of a line that is not full yet

    def begin_samples(self, i: str, samples_left: str) -> None:
        """Choose where the rows of the block at i are written: into the output, or first into the stage."""
        f = self.f
        self.i, self.to, self.rest = i, f.pointer_at(self.base, f.multiply(i, self.stride)), samples_left
        self.direct = f.put(f"and i1 {self.takes_rows}, {f.put(f'icmp sge i64 {samples_left}, {LANES}')}")
        self.place = f.put(f"select i1 {self.direct}, ptr {self.to}, ptr {self.stage}")
        f.do(f"store ptr {self.place}, ptr {f.pointer_at('%places', 8 * self.index)}, align 8")  # for the steps

    def flush(self, i: str, count: str, is_last: str) -> None:
        """Stream `count` samples from the stage to the output, from sample i on."""
        f = self.f
        at = f.put(f"add i64 {self.start}, {f.multiply(i, self.row_bytes)}")
        block = f"ptr {self.stage}, i64 {at}, i64 {f.multiply(count, self.row_bytes)}"
        self.kernel.call_shared("flush", block, f"i64 {self.start}, i1 {is_last}")

    def write_samples(self) -> None:
        """Bring the rows of the block of `begin_samples` into the output, unless the steps have written them. With
        streaming stores, the rows of the block before go there, and those of this block stay in the stage.
        """
        f = self.f
        target = f"ptr {self.to}, i64 {self.stride}, i64 {self.step}, i64 {self.rest}"
        if not self.group.narrow:
            filled = "false"
            if self.streamed != "false":
                filled = f.put(f"and i1 {self.streamed}, {f.put(f'icmp ne i64 {self.i}, 0')}")
                with f.when(filled):
                    self.flush(f.put(f"sub i64 {self.i}, {LANES}"), str(LANES), "false")
            target_rows = f"ptr {self.place}, i64 {self.row_bytes}, i1 {filled}"  # filled: with the constants already
            self.kernel.call_shared("rows", f"ptr %frame, ptr {self.tiles}, i64 {self.count}, {target_rows}")
        done = f.put(f"or i1 {self.direct}, {self.streamed}")
        with f.when(f.put(f"xor i1 {done}, true")):
            self.kernel.call_shared("scatter", f"ptr {self.stage}, i64 {self.count}", target)

    def end(self) -> None:
        """Stream the last rows, which are still in the stage."""
        f = self.f
        if self.streamed != "false":
            with f.when(self.streamed):
                block = f.put(f"and i64 {f.put('sub i64 %samples, 1')}, -{LANES}")
                self.flush(block, f.put(f"sub i64 %samples, {block}"), "true")
