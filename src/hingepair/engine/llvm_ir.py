"""A trace written out as LLVM code: a kernel, which loops over samples, eight at a time, one vector a value.

Two shapes of loop serve everything. Map: samples do not know of each other; what does not change from sample to
sample is computed once before the loop. Scan: the samples of the last axis follow one after the other, each given a
carry by the one before; eight such chains run side by side.

The loops bring inputs into the frame, call the steps of the arithmetic (`llvm_parts`), and bring results to where
they are wanted (`llvm_memory`, which says how they are stored). Samples that do not fill eight lanes are computed all
the same, with the lanes that are left repeating the first of them.

Every group of components (a row of seven coordinates, say) is given by a line of the kernel's table, four integers:
address, bytes between outer samples, between inner samples, and between components. Results are stored whole vectors
at a time where their samples follow each other without a gap, and past the caches where in addition there are many
components and too many samples for the caches.

Where the machine can, every sum with a product is fused with it, here and not at LLVM's choice, so that the bits of a
result do not depend on what else is computed. Nothing is reordered, and NaN stays NaN.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Final

from hingepair.engine.llvm_memory import MAX_STREAMED, PANEL, PREFETCH_DISTANCE
from hingepair.engine.llvm_parts import Arithmetic, Carry, Group, Step
from hingepair.engine.llvm_shared import declarations
from hingepair.engine.llvm_sines import lanewise_function
from hingepair.engine.llvm_writer import LANES, LINE, Function, number_type, shared_name

_DECLARED: Final = "declare void @llvm.prefetch.p0(ptr, i32, i32, i32)\ndeclare i64 @llvm.abs.i64(i64, i1)"

FIELDS: Final = 4
"""Integers of a line of the table."""

MIN_STREAMED_BYTES: Final = 2**21
"""Size of an output in bytes from which it is written past the caches."""


def kernel_ir(
    inputs: Sequence[Group],
    outputs: Sequence[Group],
    *,
    single: bool = False,
    fuse: bool = True,
    carry: Carry | None = None,
) -> str:
    """Return the code of `void kernel(i64* table, i64 outer, i64 inner)`; it calls the functions of `shared_ir`.

    Args:
        inputs: in the order of the table.
        outputs: those after them.
        single: float32 instead of float64; sines are taken in float64.
        fuse: whether sums are fused with products.
        carry: makes it a scan: each outer sample is a chain of inner ones.
    """
    return _Loops(Arithmetic(inputs, outputs, carry, number_type(single), fuse)).module()


class _Loops:
    """The loops of a kernel, around the steps of its arithmetic."""

    def __init__(self, arithmetic: Arithmetic) -> None:
        self.arithmetic = arithmetic
        self.inputs, self.outputs = arithmetic.inputs, arithmetic.outputs
        self.scan = arithmetic.carry is not None
        self.size = arithmetic.size
        self.tables: list[str] = []
        self.f = Function("void @kernel(ptr noalias %table, i64 %outer, i64 %inner)")

    def module(self) -> str:
        """Return the whole module."""
        number = self.arithmetic.number
        steps = self.arithmetic.functions()
        self.write()
        lanewise = [lanewise_function(name) for name in self.arithmetic.lanewise]
        return "\n\n".join([*self.tables, *declarations(number), _DECLARED, *lanewise, *steps, self.f.text()]) + "\n"

    def table(self, numbers: Sequence[int]) -> str:
        """Write numbers down as a constant of the module; returns its name."""
        name = f"@table{len(self.tables)}"
        listed = ", ".join(f"i32 {number}" for number in numbers)
        self.tables.append(f"{name} = internal constant [{len(numbers)} x i32] [{listed}]")
        return name

    def call(self, function: str, *arguments: str) -> None:
        """Write the call of a shared function."""
        self.f.do(f"call void {shared_name(function, self.arithmetic.number)}({', '.join(arguments)})")

    def write(self) -> None:
        """Write the kernel."""
        f, arithmetic = self.f, self.arithmetic
        lines = [
            [f.word("%table", 8 * (g * FIELDS + k)) for k in range(FIELDS)]
            for g in range(len(self.inputs) + len(self.outputs))
        ]
        f.do(f"%frame = alloca [{max(1, arithmetic.frame_size)} x {arithmetic.vector}], align {LINE}")
        f.do(f"%places = alloca [{arithmetic.words[-1] + len(self.outputs)} x i64], align 8")
        for number, slot in arithmetic.filled.items():
            arithmetic.keep(f, slot, arithmetic.of(number))
        readers = [_Reader(self, g, line) for g, line in enumerate(lines[: len(self.inputs)])]
        writers = [_Writer(self, g, line) for g, line in enumerate(lines[len(self.inputs) :])]
        lanes = str(LANES)
        with f.loop("%outer", step=lanes if self.scan else "1") as o:
            chains = f.put(f"sub i64 %outer, {o}")
            for reader in readers:
                reader.begin(o)
            for writer in writers:
                writer.begin(o)
            for reader in readers:
                if not reader.group.varies:
                    reader.read_shared(chains)
            self.run(arithmetic.once)
            if self.scan:
                with f.loop("%inner") as i:
                    self.block(readers, writers, i, chains)
            else:
                start = self.direct_blocks(readers, writers)
                with f.loop("%inner", start=start, step=lanes) as i:
                    self.block(readers, writers, i, f.put(f"sub i64 %inner, {i}"))
            for writer in writers:
                writer.end()
        streamed = [writer.streamed for writer in writers if writer.streamed != "false"]
        for one in streamed:
            with f.when(one):  # other threads see what was written past the caches
                f.do("fence seq_cst")
        f.do("ret void")

    def direct_blocks(self, readers: Sequence[_Reader], writers: Sequence[_Writer]) -> str:
        """Write the loop over whole blocks whose rows all go straight into the outputs; returns where it stops."""
        f = self.f
        direct = "true"
        for writer in writers:
            direct = f.put(f"and i1 {direct}, {writer.dense}")
            if writer.streamed != "false":
                direct = f.put(f"and i1 {direct}, {f.put(f'xor i1 {writer.streamed}, true')}")
        stop = f.put(f"select i1 {direct}, i64 {f.put(f'and i64 %inner, -{LANES}')}, i64 0")
        with f.loop(stop, step=str(LANES)) as i:
            for writer in writers:
                writer.place(writer.row(i))
            for reader in readers:
                reader.read(i, str(LANES))
            self.run(self.arithmetic.block)
            for writer in writers:
                if not writer.group.narrow:
                    writer.rows(writer.row(i), "false")
        return stop

    def block(self, readers: Sequence[_Reader], writers: Sequence[_Writer], i: str, rest: str) -> None:
        """Write a block of up to eight samples whose rows go wherever they are wanted."""
        for writer in writers:
            writer.open(i, rest)
        for reader in readers:
            reader.read(i, rest)
        self.run(self.arithmetic.block)
        for writer in writers:
            writer.write()

    def run(self, steps: Sequence[Step]) -> None:
        """Write the calls of steps."""
        for step in steps:
            if step.angles:
                slots, first = self.arithmetic.sine_slots(step)
                angles = f"ptr {self.table(slots)}, i64 {len(slots)}"
                self.call("sines", "ptr %frame", angles, f"ptr {self.arithmetic.slot(self.f, first)}")
            else:
                self.f.do(f"call void @{step.name}(ptr %frame, ptr %places)")


class _Reader:
    """An input in the loops.

    Args:
        loops: the loops.
        g: its number among the inputs.
        line: its line of the table.
    """

    def __init__(self, loops: _Loops, g: int, line: Sequence[str]) -> None:
        f = self.f = loops.f
        self.loops, self.g, self.group = loops, g, loops.inputs[g]
        self.count = len(self.group.values)
        self.at, self.outer, self.inner, self.step = line
        self.scan = loops.scan
        self.stride = self.outer if self.scan else self.inner if self.group.varies else "0"
        self.components, self.slot = loops.arithmetic.input_slots[g]
        self.word = 8 * loops.arithmetic.words[g]
        self.in_registers = g in loops.arithmetic.loaded
        if self.in_registers:
            f.do(f"store i64 {self.step}, ptr {f.step('%places', self.word + 8 * LANES)}, align 8")
            if not self.scan:
                self.prefetched = self.lines_ahead()
        else:
            self.components_table = loops.table(self.components)
        self.shared, self.shared_slot = loops.arithmetic.input_numbers[g]

    def lines_ahead(self) -> list[str]:
        """Write how far behind a sample the cache lines are that are asked for with it.

        Of rows, all lines of eight samples, or those in which needed components are, where these are fewer; of
        columns, one of each needed component.
        """
        f = self.f
        starts = self.components[:1]
        for c in self.components:
            if (c - starts[-1]) * self.loops.size >= LINE or c == self.components[-1] > starts[-1]:
                starts.append(c)
        if LANES * len(starts) < self.count:
            samples = [f.product(self.stride, k) for k in range(LANES)]
            rows = [f.put(f"add i64 {sample}, {f.product(self.step, c)}") for sample in samples for c in starts]
        else:
            along = f.put(f"sdiv i64 {f.product(self.stride, LANES)}, {self.count}")
            rows = [f.product(along, k) for k in range(self.count)]
        columns = [f.product(self.step, c) for c in self.components]
        wide, far = (f.put(f"call i64 @llvm.abs.i64(i64 {x}, i1 false)") for x in (self.stride, self.step))
        by_rows = f.put(f"icmp sle i64 {far}, {wide}")
        both = itertools.zip_longest(rows, columns, fillvalue="0")
        lines = [f.put(f"select i1 {by_rows}, i64 {row}, i64 {column}") for row, column in both]
        ahead = f.product(self.stride, PREFETCH_DISTANCE)
        return [f.put(f"add i64 {ahead}, {line}") for line in lines]

    def begin(self, o: str) -> None:
        """Begin with an outer sample: the first of eight chains, of a scan."""
        f = self.f
        self.base = f.step(f.put(f"inttoptr i64 {self.at} to ptr"), f.product(o, self.outer))
        if self.in_registers:
            self.place_lanes(f.put(f"sub i64 %outer, {o}") if self.scan else str(LANES))

    def place_lanes(self, rest: str) -> None:
        """Write down where the samples of the lanes are, so many of which there are."""
        to = self.f.step("%places", self.word + 8)
        self.loops.call("lanes", f"ptr {to}, i64 {self.stride}, i64 {rest}")

    def read(self, i: str, rest: str) -> None:
        """Bring an inner sample and those in the other lanes to where the steps read them."""
        f = self.f
        if not self.group.varies:
            return
        row = f.step(self.base, f.product(i, self.inner))
        if not self.in_registers:
            self.gather(row, rest)
            return
        f.do(f"store ptr {row}, ptr {f.step('%places', self.word)}, align 8")
        if self.scan:
            return
        for distance in self.prefetched:
            f.do(f"call void @llvm.prefetch.p0(ptr {f.step(row, distance)}, i32 0, i32 2, i32 1)")
        if not rest.isdigit():
            with f.when(f.put(f"icmp slt i64 {rest}, {LANES}")):
                self.place_lanes(rest)

    def read_shared(self, chains: str) -> None:
        """Bring what inner samples share into the frame: numbers, and vectors where steps need these."""
        f = self.f
        if self.shared:
            to = self.loops.arithmetic.slot(f, self.shared_slot)
            which = f"ptr {self.loops.table(self.shared)}, i64 {len(self.shared)}"
            self.loops.call("numbers", f"ptr {to}", which, f"ptr {self.base}, i64 {self.step}")
        if self.components:
            self.gather(self.base, chains)

    def gather(self, row: str, rest: str) -> None:
        """Write the loads of the components that are needed into the frame."""
        f = self.f
        to = self.loops.arithmetic.slot(f, self.slot)
        which = f"ptr {self.components_table}, i64 {len(self.components)}"
        source = f"ptr {row}, i64 {self.stride}, i64 {self.step}, i64 {rest}"
        if len(self.components) < self.count or self.count < LANES or not self.group.varies:
            self.loops.call("gather", f"ptr {to}", which, source)
            return
        dense = f.put(f"icmp eq i64 {self.step}, {self.loops.size}")
        full = f.put(f"icmp sge i64 {rest}, {LANES}")
        with f.choose(f.put(f"and i1 {dense}, {full}")) as otherwise:
            self.loops.call("columns", f"ptr {to}, i64 {self.count}, ptr {row}, i64 {self.stride}")
            otherwise()
            self.loops.call("gather", f"ptr {to}", which, source)


class _Writer:
    """An output in the loops.

    Args:
        loops: the loops.
        g: its number among the outputs.
        line: its line of the table.

    Attributes:
        dense: whether its samples follow each other without a gap.
        streamed: whether it is written past the caches.
    """

    def __init__(self, loops: _Loops, g: int, line: Sequence[str]) -> None:
        f = self.f = loops.f
        self.loops, self.group = loops, loops.outputs[g]
        self.at, self.outer, self.inner, self.step = line
        self.stride = self.outer if loops.scan else self.inner
        self.count, self.size = len(self.group.values), loops.size
        self.pitch = self.count * self.size
        self.word = 8 * (loops.arithmetic.words[-1] + g)
        self.dense = self.streamed = "false"
        if not loops.scan:
            joined = f.put(f"icmp eq i64 {self.inner}, {self.pitch}")
            side_by_side = f.put(f"icmp eq i64 {self.step}, {self.size}")
            self.dense = f.put(f"and i1 {joined}, {side_by_side}") if self.count > 1 else joined
        staged = self.count if self.count <= MAX_STREAMED else 2 * PANEL
        if not self.group.narrow:
            self.tiles = loops.table(loops.arithmetic.tiles(self.group))
            if not loops.scan and self.count <= MAX_STREAMED:
                large = f.put(f"icmp sge i64 {f.product('%inner', self.pitch)}, {MIN_STREAMED_BYTES}")
                odd = f.put(f"and i64 {f.put(f'or i64 {self.at}, {self.outer}')}, {self.size - 1}")
                aligned = f.put(f"icmp eq i64 {odd}, 0")
                self.streamed = f.put(f"and i1 {self.dense}, {f.put(f'and i1 {large}, {aligned}')}")
        carried = f.put(f"alloca [{LINE + LANES * staged * self.size} x i8], align {LINE}")
        self.stage = f.step(carried, LINE)

    def begin(self, o: str) -> None:
        """Begin with an outer sample: the first of eight chains, of a scan."""
        f = self.f
        self.start = f.put(f"add i64 {self.at}, {f.product(o, self.outer)}")
        self.base = f.put(f"inttoptr i64 {self.start} to ptr")

    def row(self, i: str) -> str:
        """Write the address of an inner sample."""
        return self.f.step(self.base, self.f.product(i, self.inner))

    def place(self, to: str) -> None:
        """Write down where the rows of a block go."""
        self.f.do(f"store ptr {to}, ptr {self.f.step('%places', self.word)}, align 8")

    def open(self, i: str, rest: str) -> None:
        """Choose where the rows of a block go: into the output, or into the stage."""
        f = self.f
        self.i, self.to, self.rest = i, self.row(i), rest
        full = f.put(f"icmp sge i64 {rest}, {LANES}")
        self.direct = f.put(f"and i1 {self.dense}, {full}")
        if self.streamed != "false":
            self.direct = f.put(f"and i1 {self.direct}, {f.put(f'xor i1 {self.streamed}, true')}")
        self.place(f.put(f"select i1 {self.direct}, ptr {self.to}, ptr {self.stage}"))

    def flush(self, i: str, samples: str, last: str) -> None:
        """Stream the samples of the stage, of which the first is the i-th."""
        f = self.f
        at = f.put(f"add i64 {self.start}, {f.product(i, self.pitch)}")
        block = f"ptr {self.stage}, i64 {at}, i64 {f.product(samples, self.pitch)}"
        self.loops.call("flush", block, f"i64 {self.start}, i1 {last}")

    def rows(self, to: str, filled: str) -> None:
        """Write the rows of a block from the frame; where `filled`, the constants among them stand there already."""
        target = f"ptr {to}, i64 {self.pitch}, i1 {filled}"
        self.loops.call("rows", f"ptr %frame, ptr {self.tiles}, i64 {self.count}, {target}")

    def write(self) -> None:
        """Write the rows of a block from where the steps left them."""
        f = self.f
        target = f"ptr {self.to}, i64 {self.stride}, i64 {self.step}, i64 {self.rest}"
        if self.count > MAX_STREAMED:
            with f.choose(self.direct) as otherwise:
                self.rows(self.to, "false")
                otherwise()
                source = f"ptr %frame, ptr {self.tiles}, i64 {self.count}, ptr {self.stage}"
                self.loops.call("panels", source, target)
            return
        if not self.group.narrow:
            filled = "false"
            if self.streamed != "false":
                filled = f.put(f"and i1 {self.streamed}, {f.put(f'icmp ne i64 {self.i}, 0')}")
                with f.when(filled):
                    self.flush(f.put(f"sub i64 {self.i}, {LANES}"), str(LANES), "false")
            self.rows(f.put(f"select i1 {self.direct}, ptr {self.to}, ptr {self.stage}"), filled)
        done = f.put(f"or i1 {self.direct}, {self.streamed}")
        with f.when(f.put(f"xor i1 {done}, true")):
            self.loops.call("scatter", f"ptr {self.stage}, i64 {self.count}", target)

    def end(self) -> None:
        """Write what is left of an outer sample in the stage."""
        f = self.f
        if self.streamed != "false":
            with f.when(self.streamed):
                block = f.put(f"and i64 {f.put('sub i64 %inner, 1')}, -{LANES}")
                self.flush(block, f.put(f"sub i64 %inner, {block}"), "true")
