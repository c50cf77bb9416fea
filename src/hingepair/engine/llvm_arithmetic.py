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

from hingepair.engine.llvm_builder import LANE_COUNT, FunctionBuilder, hexadecimal
from hingepair.engine.llvm_sines import DOUBLE_VECTOR_TYPE, SINE_OPERATION_NAMES
from hingepair.engine.trace import Operand, TracedValue, needed_values

MAX_COMPONENTS_OF_ARRAY_IN_REGISTERS: Final = 16
"""Largest number of components of an output array that is assembled in registers, and of those that are needed of an
input array that is loaded into registers."""

MAX_UNIFORM_COMPONENTS_OF_INPUT_STORED_AS_VECTORS: Final = 256
"""Largest number of components shared by all samples that are each stored in the frame as a vector: 16 kB in all.

More of them are stored as single numbers, so that they leave space in the first-level cache. Processors with few
registers take longer to broadcast a number to a vector than to load a vector.
"""

_MAX_OPERATIONS_OF_UNSPLIT_STEP: Final = 1000
"""Number of operations in a row up to which they are one step, so that fewer values pass through the frame."""

_MAX_OPERATIONS_OF_STEP_AFTER_SPLITTING: Final = 300
"""Number of operations of each step into which more operations are split: LLVM spills few registers then."""

_MAX_OPERATIONS_SINCE_LAST_USE_OF_VALUE_IN_REGISTER: Final = 40
"""A value that was last used more operations ago is loaded again from the frame, which lowers register pressure."""

_LLVM_INSTRUCTION_NAME_BY_OPERATION_NAME: Final = {
    "+": "fadd",
    "-": "fsub",
    "*": "fmul",
    "/": "fdiv",
    "negative": "fneg",
}  # by the name of the traced operation


class ComponentGroup(NamedTuple):
    """The components of one input or output array, as traced values or numbers, which lie at one common stride in
    memory. `varies` says whether they vary along the inner axis of samples.

    Attributes:
        values: the traced inputs, or results, in the order of the components.
        varies: whether they vary along the inner axis (in a scan: along the chain).
    """

    values: tuple[Operand, ...]
    varies: bool = True

    @property
    def narrow(self) -> bool:
        """Whether the group has few enough components to be assembled in registers. Wider outputs are copied from the
        frame, the kernel's buffer of vectors.
        """
        return len(self.values) <= MAX_COMPONENTS_OF_ARRAY_IN_REGISTERS


class Carry(NamedTuple):
    """The values that a scan carries from each sample to the next: `before` holds the traced inputs of a sample,
    `after` the results that become these inputs at the next sample.

    Attributes:
        before: the traced inputs; their values at the first sample are inputs of the kernel.
        after: the results that become `before` at the next sample.
    """

    before: tuple[TracedValue, ...]
    after: tuple[Operand, ...]


class KernelStep(NamedTuple):
    """One LLVM function of a kernel's program: its `name`, the values to compute (`lines`), and the input components
    to load (`loads`, a dictionary from the index of an input to the list of component indices). A step of sines has
    no `lines`; it computes the sines of `angles` by a shared function.

    Attributes:
        name: name of the LLVM function.
        lines: the values to compute, in order; empty for a step of sines.
        angles: the angles [rad] whose sines are computed; empty for a step of arithmetic.
        loads: components of inputs to load, by the number of the input.
    """

    name: str
    lines: list[TracedValue]
    angles: list[TracedValue]
    loads: dict[int, list[int]]


class Arithmetic:
    """Builder of the LLVM functions (steps) that compute a kernel's values, and of the layout of the frame, the
    memory through which the steps pass values. `step_functions` returns the code of the steps.

    Args:
        inputs: groups of input components.
        outputs: groups of output components.
        carry: carried values of a scan, or None.
        float_type: LLVM's type of the numbers, "double" or "float".
        fuse: whether sums are fused with products (FMA).

    Attributes:
        uniform_steps: steps that compute the values which do not vary along the inner axis.
        varying_steps: steps that compute the values which vary along the inner axis.
        slots: number of the frame's slot of each value that has one, by the identity of the value.
        frame_size: number of slots.
        register_inputs: indices of the inputs that steps load into registers; other inputs are gathered into the
            frame.
        input_slots: for each input, the components needed as vectors, and the first slot of the gathered ones.
        input_scalars: for each input, the components needed as one number for all samples, and their first slot; such
            a slot holds LANE_COUNT numbers.
        constant_slots: number of the slot of each constant in a wide output.
        word_offsets: for each input in registers, the index of its first word in the array `places`; last, the index
            of the outputs' first word. The words of an input are the address of its row, the offsets of seven further
            samples, and the bytes between components; the word of an output is the address of its rows.
    """

    def __init__(
        self,
        inputs: Sequence[ComponentGroup],
        outputs: Sequence[ComponentGroup],
        carry: Carry | None,
        float_type: str,
        fuse: bool,
    ) -> None:
        self.inputs, self.outputs, self.carry = inputs, outputs, carry
        self.float_type, self.fuse = float_type, fuse
        self.vector = f"<{LANE_COUNT} x {float_type}>"
        self.number_bytes = 8 if float_type == "double" else 4
        results = [value for group in outputs for value in group.values]
        results += list(carry.after) if carry else []
        lines = needed_values(results)
        self._operands = {id(line): self._operands_of(line) for line in lines}
        read = itertools.chain(results, *self._operands.values())
        self._read_values = {id(value) for value in read}
        self._needed = {id(value) for value in (*lines, *(carry.before if carry else ()))}
        self._sine_lines: defaultdict[int, list[TracedValue]] = defaultdict(list)
        self._declared: set[str] = set()
        self._lanewise: set[str] = set()
        self.uniform_steps = self._split_steps("once", (value for value in lines if not value.varies))
        self.varying_steps = self._split_steps("block", (value for value in lines if value.varies))
        used = [sum(id(value) in self._needed for value in group.values) for group in inputs]
        self.register_inputs = {
            g for g, group in enumerate(inputs) if group.varies and used[g] <= MAX_COMPONENTS_OF_ARRAY_IN_REGISTERS
        }
        self._outputs_after_value = self._schedule_row_stores()
        self._schedule_loads()
        self._assign_slots()

    # ---- the order of the operations

    def _fused_product(self, value: TracedValue) -> TracedValue | None:
        """Return the product that is fused with a sum or difference, `value`, into one FMA instruction. Return None
        if `value` is another operation or has no product, or if the code does not fuse. If both operands are
        products, the second is fused.
        """
        if self.fuse and value.operation in {"+", "-"}:
            for one in reversed(value.operands):
                if isinstance(one, TracedValue) and one.operation == "*":
                    return one
        return None

    def _operands_of(self, value: TracedValue) -> list[TracedValue]:
        """Return the list of traced values that the code of an operation, `value`, reads. A fused product and the
        comparison of a choice are replaced by their operands; sine, cosine and versine read their angle only.
        """
        read = list(value.operands)
        if value.operation in SINE_OPERATION_NAMES:
            del read[1:]
        if value.operation == "where" and isinstance(read[0], TracedValue):
            read[:1] = read[0].operands
        product = self._fused_product(value)
        if product is not None:
            read.reverse()
            read.remove(product)
            read += product.operands
        return [one for one in read if isinstance(one, TracedValue)]

    def _split_steps(self, name_prefix: str, lines: Iterable[TracedValue]) -> list[KernelStep]:
        """Split traced values into steps, and return the list of `KernelStep`, whose names are name_prefix ("once" or
        "block") and a number. Steps of sines come as early as their angles allow; the list for "block" begins and
        ends with a step of arithmetic. Also records which values are the sines of each angle.
        """
        rest = [value for value in lines if value.operation != "input" and id(value) in self._read_values]
        parts: list[tuple[list[TracedValue], list[TracedValue]]] = []
        while any(value.operation in SINE_OPERATION_NAMES for value in rest):
            late: set[int] = set()
            angles: dict[int, TracedValue] = {}
            for value in rest:
                operands = self._operands[id(value)]
                if any(id(one) in late for one in operands):
                    late.add(id(value))
                elif value.operation in SINE_OPERATION_NAMES:
                    late.add(id(value))
                    angles[id(operands[0])] = operands[0]
                    self._sine_lines[id(operands[0])].append(value)
            first = set(angles)
            for value in reversed(rest):
                if id(value) in first:
                    first.update(map(id, self._operands[id(value)]))
            parts += _split_lines([value for value in rest if id(value) in first])
            parts.append(([], [*angles.values()]))
            first.update(id(line) for angle in angles for line in self._sine_lines[angle])
            rest = [value for value in rest if id(value) not in first]
        parts += _split_lines(rest)
        if name_prefix == "block":  # the first step loads inputs, the last step stores outputs
            parts = [([], []), *parts] if not parts or parts[0][1] else parts
            parts = [*parts, ([], [])] if parts[-1][1] else parts
        return [KernelStep(f"{name_prefix}{k}", *part, defaultdict(list)) for k, part in enumerate(parts)]

    def _schedule_row_stores(self) -> dict[int, list[int]]:
        """Return a dictionary from the identity (`id`) of a value to the list of the indices of the outputs that are
        stored right after the value is computed. Only outputs of few components (narrow ones) are included. The
        outputs under the key 0 are stored at the end of the last step.
        """
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
        """Choose, for each needed component of an input in registers, the step that loads the component, and append
        the component to the `loads` of that step.

        This is the first step that reads the component, but no step behind one that stores: an output may overlap an
        input.
        """
        reads = [{id(value) for value in self._values_read_by(step)} for step in self.varying_steps]
        stores = [any(id(value) in self._outputs_after_value for value in step.lines) for step in self.varying_steps]
        latest = stores.index(True) if any(stores) else len(self.varying_steps) - 1
        for g, group in enumerate(self.inputs):
            for c, value in enumerate(group.values):
                if g in self.register_inputs and id(value) in self._needed:
                    s = next((s for s in range(latest) if id(value) in reads[s]), latest)
                    while self.varying_steps[s].angles:
                        s -= 1
                    self.varying_steps[s].loads[g].append(c)

    def _values_read_by(self, step: KernelStep) -> Iterator[TracedValue]:
        """Yield the traced values that a step reads, including the values that it stores in outputs and, in a scan,
        the values that it carries to the next sample.
        """
        yield from step.angles
        for value in step.lines:
            yield from self._operands[id(value)]
        last = step is self.varying_steps[-1]
        results = [self._outputs_after_value.get(id(value), ()) for value in step.lines]
        for g in itertools.chain(*results, self._outputs_after_value.get(0, ()) if last else ()):
            yield from (value for value in self.outputs[g].values if isinstance(value, TracedValue))
        if self.carry and last:
            yield from (value for value in self.carry.after if isinstance(value, TracedValue))

    # ---- the frame

    def _assign_slots(self) -> None:
        """Assign a slot of the frame, the kernel's buffer of vectors, to each value that passes from one function of
        the kernel to another; slots are reused. Sets the attributes that describe the frame, such as `slots` and
        `frame_size`.

        A slot is used again when its value is not needed any more.
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
        for g, group in enumerate(self.inputs):
            used = [c for c, value in enumerate(group.values) if id(value) in self._needed]
            many = (
                len(used) > MAX_UNIFORM_COMPONENTS_OF_INPUT_STORED_AS_VECTORS
                and not group.varies
                and self.carry is None
            )
            shared = used if many else []
            gathered = [c for c in used if id(group.values[c]) in vectors] if shared else used
            self.input_scalars.append((shared, size))
            self._scalar_positions |= {id(group.values[c]): size * LANE_COUNT + k for k, c in enumerate(shared)}
            size += -(-len(shared) // LANE_COUNT)
            self.input_slots.append((gathered, size))
            if g not in self.register_inputs:
                self.slots |= {id(group.values[c]): size + k for k, c in enumerate(gathered)}
                size += len(gathered)
        for value in wide:
            if not isinstance(value, TracedValue) and value not in self.constant_slots:
                self.constant_slots[value] = size
                size += 1
        step_index_by_id: dict[int, int] = {}
        for s, step in enumerate(steps):
            step_index_by_id |= {id(value): s for value in self._values_made_by(step)}
            for angle in step.angles:
                lines = self._sine_lines[id(angle)]
                self.slots |= {id(line): size + SINE_OPERATION_NAMES.index(line.operation) for line in lines}
                size += len(SINE_OPERATION_NAMES)
        last: dict[int, int] = {}
        for s, step in enumerate(steps):
            last |= {id(value): s for value in self._values_read_by(step) if step_index_by_id.get(id(value), s) != s}
        last |= {id(value): len(steps) for value in wide if id(value) in step_index_by_id}
        ending: defaultdict[int, list[int]] = defaultdict(list)
        for value, s in last.items():
            first_varying = len(self.uniform_steps)
            # Uniform values that varying steps read keep their slots for all blocks.
            if s < first_varying or step_index_by_id[value] >= first_varying:
                ending[s].append(value)
        free: list[int] = []
        for s, step in enumerate(steps):
            for value in self._values_made_by(step):
                if id(value) in last:
                    self.slots[id(value)] = free.pop() if free else size
                    size = max(size, self.slots[id(value)] + 1)
            free += [self.slots[value] for value in ending[s]]
        self.frame_size = size
        words = (LANE_COUNT + 1 if g in self.register_inputs else 0 for g in range(len(self.inputs)))
        self.word_offsets = list(itertools.accumulate(words, initial=0))

    def _values_made_by(self, step: KernelStep) -> list[TracedValue]:
        """Return the list of values that a step loads from inputs or computes."""
        loaded = (self.inputs[g].values[c] for g, components in step.loads.items() for c in components)
        return [*(value for value in loaded if isinstance(value, TracedValue)), *step.lines]

    def slot_address(self, f: FunctionBuilder, slot_index: int) -> str:
        """Append to the function `f` the computation of the address of a slot in the frame, the kernel's buffer of
        vectors, and return the name of the address.
        """
        return f.pointer_at("%frame", slot_index * LANE_COUNT * self.number_bytes)

    def store_slot(self, f: FunctionBuilder, slot_index: int, value: str) -> None:
        """Append to the function `f` the store of a vector, whose name is `value`, into a slot of the frame."""
        address = self.slot_address(f, slot_index)
        f.do(f"store {self.vector} {value}, ptr {address}, align {LANE_COUNT * self.number_bytes}")

    def tile_offsets(self, group: ComponentGroup) -> list[int]:
        """Return a list with the byte offset in the frame of each component of `group`, a wide output, in tiles of
        eight; the last tile may overlap the one before. If all components of a tile are one constant, the first
        offset of the tile is stored as its bitwise complement (~) as a mark.

        The shared function `rows` takes them.
        """
        offsets: list[int] = []
        for c in range(0, len(group.values), LANE_COUNT):
            first = min(c, len(group.values) - LANE_COUNT)
            values = group.values[first : first + LANE_COUNT]
            slots = [self.slots[id(v)] if isinstance(v, TracedValue) else self.constant_slots[v] for v in values]
            places = [slot * LANE_COUNT * self.number_bytes for slot in slots]
            constant = len(set(slots)) == 1 and not isinstance(values[0], TracedValue)
            offsets += [~places[0], *places[1:]] if constant else places
        return offsets

    def sine_slots(self, step: KernelStep) -> tuple[list[int], int]:
        """Return the pair of the list of the slot numbers that hold the angles of a step of sines, and the number of
        the first slot of the results.
        """
        line = self._sine_lines[id(step.angles[0])][0]
        first = self.slots[id(line)] - SINE_OPERATION_NAMES.index(line.operation)
        return [self.slots[id(angle)] for angle in step.angles], first

    # ---- the functions of the steps

    def step_functions(self) -> list[str]:
        """Return a list of LLVM code: the declarations of intrinsics, then one function for each step of
        arithmetic.
        """
        steps = [self._step_function(step) for step in (*self.uniform_steps, *self.varying_steps) if not step.angles]
        return [*sorted(self._declared), *steps]

    @property
    def lanewise_functions(self) -> list[str]:
        """Sorted list of the names of the C library's functions that the steps call once for each lane. The list is
        complete once `step_functions` has run.
        """
        return sorted(self._lanewise)

    def _step_function(self, step: KernelStep) -> str:
        """Return the LLVM function of a step of arithmetic, as text. The function reads and writes the frame, loads
        inputs and stores narrow outputs; the intrinsics and C functions that it calls are recorded for the
        declarations.
        """
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
            if self.carry:
                after = [self.operand(value) for value in self.carry.after]
                for value, name in zip(self.carry.before, after, strict=True):
                    self.store_slot(f, self.slots[id(value)], name)
        f.do("ret void")
        return f.text()

    def operand(self, value: Operand) -> str:
        """Return the text that names an operand's vector in the function being built: the name of a value, or a
        number repeated in all lanes. Appends a load from the frame if the value is not in a register, or was last
        used many operations before.
        """
        if not isinstance(value, TracedValue):
            rounded = value if self.number_bytes == 8 else struct.unpack("f", struct.pack("f", value))[0]
            return f"splat ({self.float_type} {hexadecimal(rounded)})"
        name, position = self._names.get(id(value), ("", 0))
        if not name or self._position - position > _MAX_OPERATIONS_SINCE_LAST_USE_OF_VALUE_IN_REGISTER:
            if id(value) in self._scalar_positions:
                place = self._f.pointer_at("%frame", self._scalar_positions[id(value)] * self.number_bytes)
                number = self._f.put(f"load {self.float_type}, ptr {place}, align {self.number_bytes}", value.name)
                name = self._f.splat(self.vector, f"{self.float_type} {number}")
            elif id(value) in self.slots:
                place = self.slot_address(self._f, self.slots[id(value)])
                name = self._f.put(
                    f"load {self.vector}, ptr {place}, align {LANE_COUNT * self.number_bytes}", value.name
                )
        self._names[id(value)] = name, self._position
        return name

    def _write_operation(self, value: TracedValue) -> str:
        """Append the instructions that compute a traced value to the function being built, and return the name of the
        result.
        """
        put, kind, note = self._f.put, self.vector, value.name
        if value.operation == "where":
            condition, *both = value.operands
            chosen = ", ".join(f"{kind} {self.operand(one)}" for one in both)
            return put(f"select <{LANE_COUNT} x i1> {self._write_comparison(condition)}, {chosen}", note)
        product = self._fused_product(value)
        if product is not None:
            return self._write_fma(product, value)
        parts = [self.operand(one) for one in value.operands]
        if value.operation in _LLVM_INSTRUCTION_NAME_BY_OPERATION_NAME:
            return put(f"{_LLVM_INSTRUCTION_NAME_BY_OPERATION_NAME[value.operation]} {kind} {', '.join(parts)}", note)
        if value.operation == "sqrt":
            return self._call_intrinsic("sqrt", parts, note)
        return self._call_lanewise(value.operation.replace("arctan2", "atan2"), parts, note)

    def _write_comparison(self, condition: Operand) -> str:
        """Return the name of the result of `condition`, a traced comparison a < b. If the function being built does
        not contain the comparison yet, append it.
        """
        name, _ = self._names.get(id(condition), ("", 0))
        if not name and isinstance(condition, TracedValue):
            both = ", ".join(self.operand(one) for one in condition.operands)
            name = self._f.put(f"fcmp olt {self.vector} {both}")
            self._names[id(condition)] = name, 0
        return name

    def _write_fma(self, product: TracedValue, value: TracedValue) -> str:
        """Append a fused multiply-add (FMA) that computes a sum or difference (`value`) together with its product,
        and return the name of the result.
        """
        first, second = value.operands
        x, y = (self.operand(one) for one in product.operands)
        if second is product:
            if value.operation == "-":
                x = self._f.put(f"fneg {self.vector} {x}")
            return self._call_intrinsic("fma", [x, y, self.operand(first)], value.name)
        rest = self.operand(second)
        if value.operation == "-":
            rest = self._f.put(f"fneg {self.vector} {rest}")
        return self._call_intrinsic("fma", [x, y, rest], value.name)

    def _call_intrinsic(self, name: str, operands: Sequence[str], comment: str) -> str:
        """Append a call of an LLVM intrinsic, such as "fma", on operands given as names of vectors, and return the
        name of the result. Records the intrinsic's declaration; `comment` is written behind the instruction.
        """
        kind, full = self.vector, f"@llvm.{name}.v{LANE_COUNT}f{8 * self.number_bytes}"
        self._declared.add(f"declare {kind} {full}({', '.join([kind] * len(operands))})")
        return self._f.put(f"call {kind} {full}({', '.join(f'{kind} {operand}' for operand in operands)})", comment)

    def _call_lanewise(self, name: str, operands: Sequence[str], comment: str) -> str:
        """Append a call that applies a function of the C library, in double precision, to each lane of operands given
        as names of vectors, and return the name of the resulting vector. Records the function's name; `comment` is
        written behind the instruction.
        """
        self._lanewise.add(name)
        if self.number_bytes == 4:
            operands = [self._f.put(f"fpext {self.vector} {operand} to {DOUBLE_VECTOR_TYPE}") for operand in operands]
        typed_operands = ", ".join(f"{DOUBLE_VECTOR_TYPE} {operand}" for operand in operands)
        value = self._f.put(f"call {DOUBLE_VECTOR_TYPE} @lanes.{name}({typed_operands})", comment)
        return (
            value if self.number_bytes == 8 else self._f.put(f"fptrunc {DOUBLE_VECTOR_TYPE} {value} to {self.vector}")
        )

    # ---- narrow inputs and outputs

    def _load_components(self, input_index: int, components: Sequence[int]) -> None:
        """Append to the function being built instructions that load some components, given by their indices, of one
        input for eight samples. The vectors are recorded as the components' values and stored in their slots of the
        frame, if they have any.
        """
        f, word = self._f, 8 * self.word_offsets[input_index]
        group = self.inputs[input_index]
        row, step = f.load_word("%places", word, "ptr"), f.load_word("%places", word + 8 * LANE_COUNT)
        offsets = [f.load_word("%places", word + 8 * k) for k in range(1, LANE_COUNT)]
        starts = {c: f.pointer_at(row, f.multiply(step, c) if c else 0) for c in components}

        def load_vectors() -> list[str]:
            return [f.put(f"load {self.vector}, ptr {starts[c]}, align 1") for c in components]

        def load_numbers() -> list[str]:
            vectors = []
            for c in components:
                vector = "poison"
                for k, offset in enumerate(["0", *offsets]):
                    one = f.put(f"load {self.float_type}, ptr {f.pointer_at(starts[c], offset)}, align 1")
                    vector = f.put(f"insertelement {self.vector} {vector}, {self.float_type} {one}, i32 {k}")
                vectors.append(vector)
            return vectors

        side_by_side = f.put(f"icmp eq i64 {offsets[-1]}, {(LANE_COUNT - 1) * self.number_bytes}")
        vectors = f.either(self.vector, side_by_side, load_vectors, load_numbers)
        for c, vector in zip(components, vectors, strict=True):
            value = group.values[c]
            self._names[id(value)] = vector, 0
            if id(value) in self.slots:
                self.store_slot(f, self.slots[id(value)], vector)

    def _store_sample_rows(self, output_index: int) -> None:
        """Append to the function being built instructions that store eight samples of one output of few components
        from vectors in registers. The rows follow each other in memory, from an address that the kernel has set.
        """
        f = self._f
        parts = [self.operand(value) for value in self.outputs[output_index].values]
        to = f.load_word("%places", 8 * (self.word_offsets[-1] + output_index), "ptr")
        blocked_count = len(parts) // LANE_COUNT * LANE_COUNT
        blocks = [f.transpose(self.vector, parts[k : k + LANE_COUNT]) for k in range(0, blocked_count, LANE_COUNT)]
        samples = [list(sample) for sample in zip(*blocks, strict=True)]
        for first in range(0, LANE_COUNT * len(parts), LANE_COUNT):
            piece = self._pack_numbers(samples, parts[blocked_count:], len(parts), first)
            f.do(f"store {self.vector} {piece}, ptr {f.pointer_at(to, self.number_bytes * first)}, align 1")

    def _pack_numbers(
        self, sample_vectors: list[list[str]], remaining_vectors: list[str], component_count: int, first_number: int
    ) -> str:
        """Append to the function being built the shuffles that collect eight consecutive numbers of an output's block
        of rows, from number `first_number` on, and return the name of the vector. sample_vectors holds, for each
        sample, vectors of eight of its components each. remaining_vectors holds one vector, over all samples, for
        each of the last components.

        Args:
            sample_vectors: for each sample, vectors that hold eight of its components each.
            remaining_vectors: vectors of the remaining components, each over all samples.
            component_count: number of components.
            first_number: index of the first number in the block, whose rows follow each other.
        """
        picked = []
        for sample, c in (divmod(j, component_count) for j in range(first_number, first_number + LANE_COUNT)):
            block, lane = divmod(c, LANE_COUNT)
            picked.append(
                (sample_vectors[sample][block], lane)
                if c < component_count - len(remaining_vectors)
                else (remaining_vectors[lane], sample)
            )
        vector, *others = dict.fromkeys(name for name, _ in picked)
        lanes = [lane if name == vector else -1 for name, lane in picked]
        for other in others or ["poison"]:
            lanes = [LANE_COUNT + lane if name == other else k for (name, lane), k in zip(picked, lanes, strict=True)]
            vector = self._f.shuffle(self.vector, vector, other, lanes)
            lanes = [m if k >= 0 else -1 for m, k in enumerate(lanes)]
        return vector


def _split_lines(lines: Sequence[TracedValue]) -> list[tuple[list[TracedValue], list[TracedValue]]]:
    """Split a list of traced values into parts of about equal length, one for each step. A list that is short enough
    for one step gives one part, and an empty list gives none. Return a list of pairs (part, empty list); the empty
    list stands for the angles of a step.
    """
    count = (
        -(-len(lines) // _MAX_OPERATIONS_OF_STEP_AFTER_SPLITTING)
        if len(lines) > _MAX_OPERATIONS_OF_UNSPLIT_STEP
        else min(len(lines), 1)
    )
    ends = [len(lines) * k // count for k in range(count + 1)] if count else [0]
    return [(list(lines[a:b]), []) for a, b in itertools.pairwise(ends)]
