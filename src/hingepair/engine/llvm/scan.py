"""The LLVM IR of a scan: a program that is repeated in steps, and passes a state from step to step.

Eight samples at a time are taken through all steps, so that their state stays in the frame. Each input is read again
where its address has changed since. The table has a row for each group of components: address, bytes between samples
and between components, and bytes between records, steps and stages. An output is written at the end of each record;
where it has a stride between steps, or between stages, at the end of each of these. One without an address is not
written.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from hingepair.engine.llvm.arithmetic import Arithmetic
from hingepair.engine.llvm.builder import CACHE_LINE, LANES, FunctionBuilder, default_float_environment
from hingepair.engine.llvm.ir import InputReader, KernelBuilder
from hingepair.engine.llvm.schedule import ComponentGroup, Schedule
from hingepair.engine.trace import Operand, TracedValue

SCAN_WORDS: Final = 6  # integers in a row of the table
COUNTS: Final = ("%records", "%every", "%stages")  # numbers of records, of steps of each, of stages of each step


def scan_ir(
    constants: Sequence[TracedValue],
    inputs: Mapping[str, Sequence[Operand]],
    outputs: Mapping[str, Sequence[Operand]],
    *,
    fuse: bool = True,
) -> str:
    """Return the LLVM module, as text, of the function `scan(table, samples, records, every, stages)`.

    Args:
        constants: inputs that are equal for all samples and steps, whose row comes first unless there are none.
        inputs: components of the other inputs by name, in the order of their rows. The next value of `x` is the
            output `next_x` if there is one; after the last step, it replaces `x` in memory.
        outputs: components of the outputs by name, whose rows follow.
        fuse: whether sums are fused with products (FMA).
    """
    groups = [ComponentGroup(tuple(parts), in_frame=True) for parts in inputs.values()]
    results = [ComponentGroup(tuple(parts), in_frame=True) for parts in outputs.values()]
    names = list(outputs)
    passed = {g: names.index(f"next_{one}") for g, one in enumerate(inputs) if f"next_{one}" in outputs}
    schedule = Schedule(constants, groups, results, fuse)
    return _ScanBuilder(Arithmetic(schedule, "double"), passed).module()


class _ScanBuilder(KernelBuilder):
    """Builder of one scan, which takes eight samples at a time through all steps.

    Args:
        arithmetic: the program.
        passed: of each input that is passed from step to step, the output that is its next value, by index.
    """

    SIGNATURE = f"void @scan(ptr noalias %table, i64 %samples, {', '.join(f'i64 {one}' for one in COUNTS)})"

    def __init__(self, arithmetic: Arithmetic, passed: Mapping[int, int]) -> None:
        super().__init__(arithmetic)
        self.passed = passed

    def write_kernel(self) -> None:
        """Write the loops over blocks of samples, and in them over records, steps and stages."""
        f, inputs = self.f, self.inputs
        environment, restore = default_float_environment(f)
        self.functions += environment
        rows = self.begin_kernel(SCAN_WORDS)
        most = max(len(group.values) for group in (*self.outputs, *inputs))
        f.do(f"%stage = getelementptr i8, ptr {f.buffer(LANES * most * 8)}, i64 0")
        f.do(f"%read = alloca [{len(inputs)} x i64], align 8")
        for g in range(len(inputs)):
            f.store_word(0, "%read", 8 * g)
        readers = [InputReader(self, g, rows[g]) for g in range(len(inputs))]
        read = {g: one for g, one in enumerate(readers) if g not in self.passed}
        passed = {readers[g]: _Writer(self, f"state{g}", self.input_slots(g), rows[g]) for g in self.passed}
        written = [
            _Writer(self, f"output{g}", self.schedule.slots_of(g), rows[len(inputs) + g])
            for g in range(len(self.outputs))
        ]
        with f.loop("%samples", step=str(LANES)) as i:
            left = f.put(f"sub i64 %samples, {i}")
            for reader in passed:
                reader.read(reader.address(i), left)
            with f.loop(COUNTS[0]) as r, f.loop(COUNTS[1]) as s, f.loop(COUNTS[2]) as j:
                for g, reader in read.items():
                    address, last = reader.address(i, r, s, j), f.pointer_at("%read", 8 * g)
                    with f.when(f.put(f"icmp ne i64 {address}, {f.load_word(last, 0)}")):
                        f.do(f"store i64 {address}, ptr {last}, align 8")
                        reader.read(address, left)
                self.call_steps()
                for one in written:
                    due = f.put(f"icmp ne i64 {one.start}, 0")
                    for k, count, stride in zip((s, j), COUNTS[1:], one.strides[1:], strict=True):
                        last = f.put(f"icmp eq i64 {f.put(f'add i64 {k}, 1')}, {count}")
                        moves = f.put(f"icmp ne i64 {stride}, 0")
                        due = f.put(f"and i1 {due}, {f.put(f'or i1 {last}, {moves}')}")
                    with f.when(due):
                        one.write(one.address(i, r, s, j), left)
                self.pass_on()
            for reader, state in passed.items():
                state.write(reader.address(i), left)
        restore()
        f.do("ret void")

    def input_slots(self, g: int) -> list[int]:
        """Return the slots of the components of an input, which follow each other."""
        used, first = self.schedule.input_slots[g]
        return [first + k for k in range(len(used))]

    def pass_on(self) -> None:
        """Copy the next state to the slots of the state, all values being loaded before the first is stored."""
        pairs: list[tuple[int, int]] = []
        for g, output in self.passed.items():
            following = self.schedule.slots_of(output)
            pairs += zip(following, self.input_slots(g), strict=True)
        f, vector = self.f, self.arithmetic.vector
        places = [self.arithmetic.slot_address(f, source) for source, _ in pairs]
        values = [f.put(f"load {vector}, ptr {place}, align {CACHE_LINE}") for place in places]
        for value, (_, slot) in zip(values, pairs, strict=True):
            self.arithmetic.store_slot(f, slot, value)


class _Writer:
    """Builder of the code that writes the components of eight samples from the frame into rows in memory.

    Args:
        scan: builder of the scan.
        name: name of the function.
        slots: slots of the components.
        row: the integers of the table's row.
    """

    def __init__(self, scan: _ScanBuilder, name: str, slots: Sequence[int], row: Sequence[str]) -> None:
        self.scan, self.slots, self.function = scan, slots, f"@write.{name}"
        self.start, self.stride, self.step, *self.strides = row
        self.dense = scan.f.put(f"icmp eq i64 {self.step}, 8")
        scan.functions.append(self._function())

    def address(self, *indices: str) -> str:
        """Return the address of a sample at a record, step and stage."""
        return self.scan.f.add_multiples(self.start, zip(indices, (self.stride, *self.strides), strict=True))

    def write(self, address: str, samples_left: str) -> None:
        """Write the eight samples from an address on, or the `samples_left` that exist."""
        f, count = self.scan.f, len(self.slots)
        row = f.put(f"inttoptr i64 {address} to ptr")
        full = f.put(f"icmp sge i64 {samples_left}, {LANES}")
        with f.when_else(f.put(f"and i1 {self.dense}, {full}")) as otherwise:
            f.do(f"call void {self.function}(ptr %frame, ptr {row}, i64 {self.stride})")
            otherwise()
            f.do(f"call void {self.function}(ptr %frame, ptr %stage, i64 {8 * count})")
            target = f"ptr {row}, i64 {self.stride}, i64 {self.step}, i64 {samples_left}"
            self.scan.call_shared("scatter", f"ptr %stage, i64 {count}", target)

    def _function(self) -> str:
        """Return the function: eight components of eight samples at a time are transposed, and the last eight overlap
        those before if need be.
        """
        f = FunctionBuilder(f"internal void {self.function}(ptr noalias %frame, ptr %row, i64 %stride)")
        arithmetic, vector, count = self.scan.arithmetic, self.scan.arithmetic.vector, len(self.slots)
        rows = [f.pointer_at("%row", f.multiply("%stride", k)) for k in range(LANES)]
        for c in range(0, count, LANES):
            first = max(0, min(c, count - LANES))
            addresses = [arithmetic.slot_address(f, slot) for slot in self.slots[first : first + LANES]]
            vectors = [f.put(f"load {vector}, ptr {address}, align {CACHE_LINE}") for address in addresses]
            vectors += ["poison"] * (LANES - len(vectors))
            for row, numbers in zip(rows, f.transpose(vector, vectors), strict=True):
                self._store_first(f, f.pointer_at(row, 8 * first), numbers, len(addresses))
        f.do("ret void")
        return f.text()

    def _store_first(self, f: FunctionBuilder, place: str, numbers: str, count: int) -> None:
        """Store the first `count` numbers of a vector, at most eight, in pieces of eight, four, two and one."""
        done, vector = 0, self.scan.arithmetic.vector
        for width in (8, 4, 2, 1):
            if count & width:
                lanes = ", ".join(f"i32 {done + k}" for k in range(width))
                piece = f"shufflevector {vector} {numbers}, {vector} poison, <{width} x i32> <{lanes}>"
                f.do(f"store <{width} x double> {f.put(piece)}, ptr {f.pointer_at(place, 8 * done)}, align 8")
                done += width
