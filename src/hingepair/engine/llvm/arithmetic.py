"""The arithmetic of a kernel: values of a trace as straight-line LLVM functions over a frame.

A frame is an array of vectors, with one slot for each value that more than one function reads. Where samples share
hundreds of inputs, these are stored in the frame as numbers. The values are computed in steps: arithmetic of limited
length, and sines that are computed together. LLVM's time grows faster than the length of a function, and values in
the frame need no registers between the functions.
"""

from __future__ import annotations

import itertools
import struct
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from hingepair.engine.llvm.builder import LANES, NUMBER_BYTES, FunctionBuilder, hexadecimal
from hingepair.engine.llvm.sines import DOUBLES, SINES
from hingepair.engine.trace import Operand, TracedValue, needed_values

MAX_NARROW: Final = 16  # most components of an output assembled in registers, and needed ones of an input there
# Where registers are few, loading a vector is quicker than a broadcast; but 256 vectors (16 kB) are half a cache.
MAX_UNIFORM_VECTORS: Final = 256  # inputs shared by all samples that the frame holds as vectors; more are numbers
_UNSPLIT: Final = 1000  # most operations of a program that is one LLVM function, so that few values pass the frame
_SPLIT: Final = 300  # operations of each function of a longer program: LLVM spills few registers then
_MAX_AGE: Final = 40  # operations after which a value is loaded again, which lowers register pressure
_INSTRUCTIONS: Final = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv", "negative": "fneg"}  # of LLVM


class ComponentGroup(NamedTuple):
    """The components of one array, which lie at one common stride in memory."""

    values: tuple[Operand, ...]  # traced inputs, or results
    varies: bool = True  # from sample to sample
    in_frame: bool = False  # whether the kernel itself moves it to or from the frame, however few components it has

    @property
    def narrow(self) -> bool:
        """Whether an output is assembled in registers; wider ones are copied from the frame."""
        return len(self.values) <= MAX_NARROW and not self.in_frame


class KernelStep(NamedTuple):
    """One step of a kernel: a function of its own, or sines."""

    name: str  # of the function
    lines: list[TracedValue]  # to compute, in order; none for sines
    angles: list[TracedValue]  # [rad] whose sines are computed; none for arithmetic
    loads: dict[int, list[int]]  # components to load, by the index of the input


class Arithmetic:
    """The steps that compute a kernel's values, and the frame through which they pass values.

    Args:
        inputs: groups of input components.
        outputs: groups of output components.
        float_type: LLVM's type of the numbers, "double" or "float".
        fuse: whether sums are fused with products (FMA).

    Attributes:
        uniform_steps: steps that compute the values which do not vary from sample to sample.
        varying_steps: steps that compute those which do.
        slots: number of the frame's slot of each value that has one, by the identity of the value.
        frame_size: number of slots.
        register_inputs: indices of the inputs that steps load into registers; other inputs are gathered into the
            frame.
        input_slots: for each input, the components needed as vectors, and the first slot of the gathered ones.
        input_scalars: for each input, the components needed as one number for all samples, and their first slot,
            which holds eight of them.
        constant_slots: number of the slot of each constant in a wide output.
        word_offsets: for each input in registers, the index of its first word in the array `places`; last, the index
            of the outputs' first word. The words of an input are the address of its row, the offsets of seven further
            samples, and the bytes between components; the word of an output is the address of its rows.
    """

    def __init__(
        self,
        inputs: Sequence[ComponentGroup],
        outputs: Sequence[ComponentGroup],
        float_type: str,
        fuse: bool,
    ) -> None:
        self.inputs, self.outputs = inputs, outputs
        self.float_type, self.fuse = float_type, fuse
        self.vector = f"<{LANES} x {float_type}>"
        self.number_bytes = NUMBER_BYTES[float_type]
        results = [value for group in outputs for value in group.values]
        lines = needed_values(results)
        self._operands = {id(line): self._operands_of(line) for line in lines}
        read = itertools.chain(results, *self._operands.values())
        self._read_values = {id(value) for value in read}
        self._needed = {id(value) for value in lines}
        self._sine_lines: defaultdict[int, list[TracedValue]] = defaultdict(list)
        self._declared: set[str] = set()
        self._lanewise: set[str] = set()
        self.uniform_steps = self._split_steps("once", (value for value in lines if not value.varies))
        self.varying_steps = self._split_steps("block", (value for value in lines if value.varies))
        used = [sum(id(value) in self._needed for value in group.values) for group in inputs]
        self.register_inputs = {
            g for g, group in enumerate(inputs) if group.varies and used[g] <= MAX_NARROW and not group.in_frame
        }
        self._outputs_after_value = self._schedule_row_stores()
        self._schedule_loads()
        self._assign_slots()

    # ---- the order of the operations

    def _fused_product(self, value: TracedValue) -> TracedValue | None:
        """Return the product that is fused with a sum or difference (the second of two), or None."""
        if self.fuse and value.operation in {"+", "-"}:
            for one in reversed(value.operands):
                if isinstance(one, TracedValue) and one.operation == "*":
                    return one
        return None

    def _operands_of(self, value: TracedValue) -> list[TracedValue]:
        """Return the traced values that the code of an operation reads: those of a fused product and of the
        comparison of a choice in their place, and only the angle of sine, cosine and versine.
        """
        read = list(value.operands)
        if value.operation in SINES:
            del read[1:]
        if value.operation == "where" and isinstance(read[0], TracedValue):
            read[:1] = read[0].operands
        product = self._fused_product(value)
        if product is not None:
            read.reverse()
            read.remove(product)
            read += product.operands
        return [one for one in read if isinstance(one, TracedValue)]

    def _split_steps(self, prefix: str, lines: Iterable[TracedValue]) -> list[KernelStep]:
        """Return the steps that compute these values, named by `prefix`; sines come as early as they can."""
        # A product that is fused into all of its sums is not read any more.
        rest = [value for value in lines if value.operation != "input" and id(value) in self._read_values]
        parts: list[tuple[list[TracedValue], list[TracedValue]]] = []
        while any(value.operation in SINES for value in rest):
            # Late are sines and all that needs them; this round computes the sines whose angles are not late.
            late: set[int] = set()
            angles: dict[int, TracedValue] = {}
            for value in rest:
                operands = self._operands[id(value)]
                if any(id(one) in late for one in operands):
                    late.add(id(value))
                elif value.operation in SINES:
                    late.add(id(value))
                    angles[id(operands[0])] = operands[0]
                    self._sine_lines[id(operands[0])].append(value)
            # What these angles need comes first, then the angles' sines; the rest waits for the next round.
            first = set(angles)
            for value in reversed(rest):
                if id(value) in first:
                    first.update(map(id, self._operands[id(value)]))
            parts += _split_lines([value for value in rest if id(value) in first])
            parts.append(([], [*angles.values()]))
            first.update(id(line) for angle in angles for line in self._sine_lines[angle])
            rest = [value for value in rest if id(value) not in first]
        parts += _split_lines(rest)
        if prefix == "block":  # the first step loads inputs, the last step stores outputs
            parts = [([], []), *parts] if not parts or parts[0][1] else parts
            parts = [*parts, ([], [])] if parts[-1][1] else parts
        return [KernelStep(f"{prefix}{k}", *part, defaultdict(list)) for k, part in enumerate(parts)]

    def _schedule_row_stores(self) -> dict[int, list[int]]:
        """Return the narrow outputs that are stored right after a value is computed, by the value's id; under 0 those
        that are stored at the end of the last step.
        """
        # By value: its place in the order, and its id, or 0 for sines, which a shared function computes.
        position: dict[int, tuple[int, int]] = {}
        for step in self.varying_steps:
            sines = [line for angle in step.angles for line in self._sine_lines[id(angle)]]
            for value in (*step.lines, *sines):
                position[id(value)] = len(position), 0 if step.angles else id(value)
        finished: dict[int, list[int]] = defaultdict(list)
        for g, group in enumerate(self.outputs):
            if group.narrow:
                places = [position[id(value)] for value in group.values if id(value) in position]
                finished[max(places)[1] if places else 0].append(g)
        return finished

    def _schedule_loads(self) -> None:
        """Enter each component of an input in registers in the `loads` of a step: the first that reads it, but none
        behind one that stores, since an output may overlap an input.
        """
        reads = [{id(value) for value in self._values_read_by(step)} for step in self.varying_steps]
        stores = [any(id(value) in self._outputs_after_value for value in step.lines) for step in self.varying_steps]
        latest = stores.index(True) if any(stores) else len(self.varying_steps) - 1  # step that may load
        for g, group in enumerate(self.inputs):
            for c, value in enumerate(group.values):
                if g in self.register_inputs and id(value) in self._needed:
                    s = next((s for s in range(latest) if id(value) in reads[s]), latest)
                    while self.varying_steps[s].angles:
                        s -= 1
                    self.varying_steps[s].loads[g].append(c)

    def _values_read_by(self, step: KernelStep) -> Iterator[TracedValue]:
        """Yield the traced values that a step reads or stores in outputs."""
        yield from step.angles
        for value in step.lines:
            yield from self._operands[id(value)]
        last = step is self.varying_steps[-1]
        results = [self._outputs_after_value.get(id(value), ()) for value in step.lines]
        for g in itertools.chain(*results, self._outputs_after_value.get(0, ()) if last else ()):
            yield from (value for value in self.outputs[g].values if isinstance(value, TracedValue))

    # ---- the frame

    def _assign_slots(self) -> None:
        """Assign a slot to each value that passes from one function to another; a slot is used again when its value
        is not needed any more.
        """
        self.slots: dict[int, int] = {}
        self.input_slots: list[tuple[list[int], int]] = []
        self.input_scalars: list[tuple[list[int], int]] = []
        self._scalar_positions: dict[int, int] = {}
        self.constant_slots: dict[float, int] = {}
        size = 0
        steps = [*self.uniform_steps, *self.varying_steps]
        wide = [value for group in self.outputs if not group.narrow for value in group.values]
        vectors = {id(value) for value in (*wide, *(angle for step in steps for angle in step.angles))}
        # Inputs that are gathered into the frame before the steps.
        for g, group in enumerate(self.inputs):
            used = [c for c, value in enumerate(group.values) if group.in_frame or id(value) in self._needed]
            shared = used if len(used) > MAX_UNIFORM_VECTORS and not group.varies else []
            gathered = [c for c in used if id(group.values[c]) in vectors] if shared else used
            self.input_scalars.append((shared, size))
            self._scalar_positions |= {id(group.values[c]): size * LANES + k for k, c in enumerate(shared)}
            size += -(-len(shared) // LANES)
            self.input_slots.append((gathered, size))
            if g not in self.register_inputs:
                self.slots |= {id(group.values[c]): size + k for k, c in enumerate(gathered)}
                size += len(gathered)
        # Constants of wide outputs, which `rows` reads from the frame.
        for value in wide:
            if not isinstance(value, TracedValue) and value not in self.constant_slots:
                self.constant_slots[value] = size
                size += 1
        # Sines have places behind each other, for they are computed together; other values share places in time.
        makers: dict[int, int] = {}  # the step that makes a value
        for s, step in enumerate(steps):
            makers |= {id(value): s for value in self._values_made_by(step)}
            for angle in step.angles:
                lines = self._sine_lines[id(angle)]
                self.slots |= {id(line): size + SINES.index(line.operation) for line in lines}
                size += len(SINES)
        last: dict[int, int] = {}  # the last other step that reads a value
        for s, step in enumerate(steps):
            last |= {id(value): s for value in self._values_read_by(step) if makers.get(id(value), s) != s}
        last |= {id(value): len(steps) for value in wide if id(value) in makers}
        ending: defaultdict[int, list[int]] = defaultdict(list)
        for value, s in last.items():
            first_varying = len(self.uniform_steps)
            # Uniform values that varying steps read keep their slots for all blocks.
            if s < first_varying or makers[value] >= first_varying:
                ending[s].append(value)
        free: list[int] = []
        for s, step in enumerate(steps):
            for value in self._values_made_by(step):
                if id(value) in last:
                    self.slots[id(value)] = free.pop() if free else size
                    size = max(size, self.slots[id(value)] + 1)
            free += [self.slots[value] for value in ending[s]]
        self.frame_size = size
        words = (LANES + 1 if g in self.register_inputs else 0 for g in range(len(self.inputs)))
        self.word_offsets = list(itertools.accumulate(words, initial=0))

    def _values_made_by(self, step: KernelStep) -> list[TracedValue]:
        """Return the values that a step loads or computes."""
        loaded = (self.inputs[g].values[c] for g, components in step.loads.items() for c in components)
        return [*(value for value in loaded if isinstance(value, TracedValue)), *step.lines]

    def slot_address(self, f: FunctionBuilder, slot_index: int) -> str:
        """Return the address of a slot of the frame."""
        return f.pointer_at("%frame", slot_index * LANES * self.number_bytes)

    def store_slot(self, f: FunctionBuilder, slot_index: int, value: str) -> None:
        """Store a vector in the frame."""
        address = self.slot_address(f, slot_index)
        f.do(f"store {self.vector} {value}, ptr {address}, align {LANES * self.number_bytes}")

    def output_slots(self, group: ComponentGroup) -> list[int]:
        """Return the slots of the components of an output that is copied from the frame."""
        return [self.slots[id(v)] if isinstance(v, TracedValue) else self.constant_slots[v] for v in group.values]

    def tile_offsets(self, group: ComponentGroup) -> list[int]:
        """Return the byte offsets in the frame of the components of a wide output, as the function `rows` takes them:
        in tiles of eight, of which the last may overlap the one before, and those of one constant are marked.
        """
        offsets: list[int] = []
        all_slots = self.output_slots(group)
        for c in range(0, len(group.values), LANES):
            first = min(c, len(group.values) - LANES)
            values, slots = group.values[first : first + LANES], all_slots[first : first + LANES]
            places = [slot * LANES * self.number_bytes for slot in slots]
            constant = len(set(slots)) == 1 and not isinstance(values[0], TracedValue)
            offsets += [~places[0], *places[1:]] if constant else places
        return offsets

    def sine_slots(self, step: KernelStep) -> tuple[list[int], int]:
        """Return the slots of the angles of a step of sines, and the first slot of the results."""
        line = self._sine_lines[id(step.angles[0])][0]
        first = self.slots[id(line)] - SINES.index(line.operation)
        return [self.slots[id(angle)] for angle in step.angles], first

    # ---- the functions of the steps

    def step_functions(self) -> list[str]:
        """Return the declarations of intrinsics, then one function for each step of arithmetic."""
        steps = [self._step_function(step) for step in (*self.uniform_steps, *self.varying_steps) if not step.angles]
        return [*sorted(self._declared), *steps]

    @property
    def lanewise_functions(self) -> list[str]:
        """Functions of the C library that `step_functions` calls for each lane."""
        return sorted(self._lanewise)

    def _step_function(self, step: KernelStep) -> str:
        """Return the LLVM function of a step of arithmetic."""
        self._f = f = FunctionBuilder(f"internal void @{step.name}(ptr noalias %frame, ptr noalias %places)")
        self._names: dict[int, tuple[str, int]] = {}
        self._position = 0
        for g, components in step.loads.items():
            self._load_components(g, components)
        for self._position, value in enumerate(step.lines):
            name = self._write_operation(value)
            self._names[id(value)] = name, self._position
            if id(value) in self.slots:
                self.store_slot(f, self.slots[id(value)], name)
            for g in self._outputs_after_value.get(id(value), ()):
                self._store_sample_rows(g)
        if step is self.varying_steps[-1]:
            for g in self._outputs_after_value.get(0, ()):
                self._store_sample_rows(g)
        f.do("ret void")
        return f.text()

    def operand(self, value: Operand) -> str:
        """Return an operand's vector: a number in all lanes, a register, or a load from the frame."""
        if not isinstance(value, TracedValue):
            rounded = value if self.number_bytes == 8 else struct.unpack("f", struct.pack("f", value))[0]
            return f"splat ({self.float_type} {hexadecimal(rounded)})"
        name, position = self._names.get(id(value), ("", 0))
        if not name or self._position - position > _MAX_AGE:
            if id(value) in self._scalar_positions:
                place = self._f.pointer_at("%frame", self._scalar_positions[id(value)] * self.number_bytes)
                number = self._f.put(f"load {self.float_type}, ptr {place}, align {self.number_bytes}")
                name = self._f.splat(self.vector, f"{self.float_type} {number}")
            elif id(value) in self.slots:
                place = self.slot_address(self._f, self.slots[id(value)])
                name = self._f.put(f"load {self.vector}, ptr {place}, align {LANES * self.number_bytes}")
        self._names[id(value)] = name, self._position
        return name

    def _write_operation(self, value: TracedValue) -> str:
        """Append the operation of a value, and return the name of its vector."""
        put, kind = self._f.put, self.vector
        if value.operation == "where":
            condition, *both = value.operands
            chosen = ", ".join(f"{kind} {self.operand(one)}" for one in both)
            return put(f"select <{LANES} x i1> {self._write_comparison(condition)}, {chosen}")
        product = self._fused_product(value)
        if product is not None:
            return self._write_fma(product, value)
        parts = [self.operand(one) for one in value.operands]
        if value.operation in _INSTRUCTIONS:
            return put(f"{_INSTRUCTIONS[value.operation]} {kind} {', '.join(parts)}")
        if value.operation == "sqrt":
            return self._call_intrinsic("sqrt", parts)
        return self._call_lanewise(value.operation.replace("arctan2", "atan2"), parts)

    def _write_comparison(self, condition: Operand) -> str:
        """Append a comparison a < b unless this function has it already, and return the name of its result."""
        name, _ = self._names.get(id(condition), ("", 0))
        if not name and isinstance(condition, TracedValue):
            both = ", ".join(self.operand(one) for one in condition.operands)
            name = self._f.put(f"fcmp olt {self.vector} {both}")
            self._names[id(condition)] = name, 0
        return name

    def _write_fma(self, product: TracedValue, value: TracedValue) -> str:
        """Append a sum or difference that is fused with its product, and return the name of its vector."""
        first, second = value.operands
        x, y = (self.operand(one) for one in product.operands)
        if second is product:
            if value.operation == "-":
                x = self._f.put(f"fneg {self.vector} {x}")
            return self._call_intrinsic("fma", [x, y, self.operand(first)])
        rest = self.operand(second)
        if value.operation == "-":
            rest = self._f.put(f"fneg {self.vector} {rest}")
        return self._call_intrinsic("fma", [x, y, rest])

    def _call_intrinsic(self, name: str, operands: Sequence[str]) -> str:
        kind, full = self.vector, f"@llvm.{name}.v{LANES}f{8 * self.number_bytes}"
        self._declared.add(f"declare {kind} {full}({', '.join([kind] * len(operands))})")
        return self._f.put(f"call {kind} {full}({', '.join(f'{kind} {operand}' for operand in operands)})")

    def _call_lanewise(self, name: str, operands: Sequence[str]) -> str:
        """Append the call, for each lane, of a function of the C library, which computes in double precision."""
        self._lanewise.add(name)
        if self.number_bytes == 4:
            operands = [self._f.put(f"fpext {self.vector} {operand} to {DOUBLES}") for operand in operands]
        typed_operands = ", ".join(f"{DOUBLES} {operand}" for operand in operands)
        value = self._f.put(f"call {DOUBLES} @lanes.{name}({typed_operands})")
        return value if self.number_bytes == 8 else self._f.put(f"fptrunc {DOUBLES} {value} to {self.vector}")

    # ---- narrow inputs and outputs

    def _load_components(self, input_index: int, components: Sequence[int]) -> None:
        """Append the loads of components of an input for eight samples."""
        f, word = self._f, 8 * self.word_offsets[input_index]
        group = self.inputs[input_index]
        row, step = f.load_word("%places", word, "ptr"), f.load_word("%places", word + 8 * LANES)
        offsets = [f.load_word("%places", word + 8 * k) for k in range(1, LANES)]
        starts = {c: f.pointer_at(row, f.multiply(step, c) if c else 0) for c in components}

        def load_vectors() -> list[str]:
            return [f.put(f"load {self.vector}, ptr {starts[c]}, align 1") for c in components]

        def load_numbers() -> list[str]:
            """Load each lane by itself."""
            vectors = []
            for c in components:
                vector = "poison"
                for k, offset in enumerate(["0", *offsets]):
                    one = f.put(f"load {self.float_type}, ptr {f.pointer_at(starts[c], offset)}, align 1")
                    vector = f.put(f"insertelement {self.vector} {vector}, {self.float_type} {one}, i32 {k}")
                vectors.append(vector)
            return vectors

        side_by_side = f.put(f"icmp eq i64 {offsets[-1]}, {(LANES - 1) * self.number_bytes}")
        vectors = f.either(self.vector, side_by_side, load_vectors, load_numbers)
        for c, vector in zip(components, vectors, strict=True):
            value = group.values[c]
            self._names[id(value)] = vector, 0
            if id(value) in self.slots:
                self.store_slot(f, self.slots[id(value)], vector)

    def _store_sample_rows(self, output_index: int) -> None:
        """Store eight samples of a narrow output as rows, from an address that the kernel has set."""
        f = self._f
        parts = [self.operand(value) for value in self.outputs[output_index].values]
        to = f.load_word("%places", 8 * (self.word_offsets[-1] + output_index), "ptr")
        blocked_count = len(parts) // LANES * LANES
        blocks = [f.transpose(self.vector, parts[k : k + LANES]) for k in range(0, blocked_count, LANES)]
        samples = [list(sample) for sample in zip(*blocks, strict=True)]
        for first in range(0, LANES * len(parts), LANES):
            piece = self._pack_numbers(samples, parts[blocked_count:], len(parts), first)
            f.do(f"store {self.vector} {piece}, ptr {f.pointer_at(to, self.number_bytes * first)}, align 1")

    def _pack_numbers(self, samples: list[list[str]], rest: list[str], count: int, first: int) -> str:
        """Return a vector of eight consecutive numbers of a block of rows.

        Args:
            samples: for each sample, vectors of eight of its components each.
            rest: vectors of the remaining components, each over all samples.
            count: number of components.
            first: index of the first number in the block.
        """
        picked = []
        for sample, c in (divmod(j, count) for j in range(first, first + LANES)):
            block, lane = divmod(c, LANES)
            picked.append((samples[sample][block], lane) if c < count - len(rest) else (rest[lane], sample))
        vector, *others = dict.fromkeys(name for name, _ in picked)
        lanes = [lane if name == vector else -1 for name, lane in picked]
        for other in others or ["poison"]:
            lanes = [LANES + lane if name == other else k for (name, lane), k in zip(picked, lanes, strict=True)]
            vector = self._f.shuffle(self.vector, vector, other, lanes)
            lanes = [m if k >= 0 else -1 for m, k in enumerate(lanes)]
        return vector


def _split_lines(lines: Sequence[TracedValue]) -> list[tuple[list[TracedValue], list[TracedValue]]]:
    """Return the lines in parts of about equal length, one for each step, as pairs (lines, []), without angles."""
    count = -(-len(lines) // _SPLIT) if len(lines) > _UNSPLIT else min(len(lines), 1)
    ends = [len(lines) * k // count for k in range(count + 1)] if count else [0]
    return [(list(lines[a:b]), []) for a, b in itertools.pairwise(ends)]
