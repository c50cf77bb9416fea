"""The arithmetic of a kernel: the steps of a schedule as straight-line LLVM functions over the frame."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

from hingepair.engine.llvm.builder import LANES, NUMBER_BYTES, FunctionBuilder, hexadecimal
from hingepair.engine.llvm.schedule import Node, Operation, Schedule, Step
from hingepair.engine.llvm.sines import DOUBLES

STEP_PARAMETERS: Final = "ptr noalias %frame, ptr noalias %places, ptr noalias %constants"
"""Of the functions: `places` holds the addresses where narrow outputs go."""

_MAX_AGE: Final = 40  # operations after which a value is loaded again, which lowers register pressure
_INSTRUCTIONS: Final = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv", "negative": "fneg"}  # of LLVM


class Arithmetic:
    """The functions of a kernel's steps.

    Args:
        schedule: the steps and the frame.
        float_type: LLVM's type of the numbers, "double" or "float".
    """

    def __init__(self, schedule: Schedule, float_type: str) -> None:
        self.schedule = schedule
        self.float_type = float_type
        self.vector = f"<{LANES} x {float_type}>"
        self.number_bytes = NUMBER_BYTES[float_type]
        self._declared: set[str] = set()
        self._lanewise: set[str] = set()

    # ---- the frame

    def slot_address(self, f: FunctionBuilder, slot_index: int) -> str:
        """Return the address of a slot of the frame."""
        return f.pointer_at("%frame", slot_index * LANES * self.number_bytes)

    def store_slot(self, f: FunctionBuilder, slot_index: int, value: str) -> None:
        """Store a vector in the frame."""
        address = self.slot_address(f, slot_index)
        f.do(f"store {self.vector} {value}, ptr {address}, align {LANES * self.number_bytes}")

    def tile_offsets(self, output: int) -> list[int]:
        """Return the byte offsets in the frame of the components of a wide output, as the function `rows` takes them:
        in tiles of eight, of which the last may overlap the one before, and those of one constant are marked.
        """
        offsets: list[int] = []
        parts, all_slots = self.schedule.output_nodes[output], self.schedule.slots_of(output)
        for c in range(0, len(parts), LANES):
            first = min(c, len(parts) - LANES)
            slots = all_slots[first : first + LANES]
            places = [slot * LANES * self.number_bytes for slot in slots]
            constant = len(set(slots)) == 1 and not isinstance(parts[first], Node)
            offsets += [~places[0], *places[1:]] if constant else places
        return offsets

    # ---- the functions of the steps

    def step_functions(self) -> list[str]:
        """Return the declarations of intrinsics, then one function for each step of arithmetic."""
        steps = (*self.schedule.uniform_steps, *self.schedule.varying_steps)
        functions = [self._step_function(step) for step in steps if not step.angles]
        return [*sorted(self._declared), *functions]

    @property
    def lanewise_functions(self) -> list[str]:
        """Functions of the C library that `step_functions` calls for each lane."""
        return sorted(self._lanewise)

    def _step_function(self, step: Step) -> str:
        """Return the LLVM function of a step of arithmetic."""
        self._f = f = FunctionBuilder(f"internal void @{step.name}({STEP_PARAMETERS})")
        self._names: dict[Node, tuple[str, int]] = {}  # of vectors, and the position at which they were last used
        self._comparisons: dict[int, str] = {}  # names by the identity of the comparison
        self._position = 0
        for self._position, node in enumerate(step.lines):
            name = self._write_operation(node)
            self._names[node] = name, self._position
            if node.slot >= 0:
                self.store_slot(f, node.slot, name)
            for g in node.stores:
                self._store_sample_rows(g)
        if step is self.schedule.varying_steps[-1]:
            for g in self.schedule.stored_last:
                self._store_sample_rows(g)
        f.do("ret void")
        return f.text()

    def constant(self, f: FunctionBuilder, value: Operation) -> str:
        """Return the vector of a known number or of a constant."""
        if not isinstance(value, Node):
            rounded = value if self.number_bytes == 8 else struct.unpack("f", struct.pack("f", value))[0]
            return f"splat ({self.float_type} {hexadecimal(rounded)})"
        place = f.pointer_at("%constants", value.number * self.number_bytes)
        number = f.put(f"load {self.float_type}, ptr {place}, align {self.number_bytes}")
        return f.splat(self.vector, f"{self.float_type} {number}")

    def operand(self, value: Operation) -> str:
        """Return an operand's vector: a number in all lanes, a register, or a load from the frame."""
        if not isinstance(value, Node):
            return self.constant(self._f, value)
        name, position = self._names.get(value, ("", 0))
        if not name or self._position - position > _MAX_AGE:
            if value.number >= 0:
                name = self.constant(self._f, value)
            elif value.slot >= 0:
                place = self.slot_address(self._f, value.slot)
                name = self._f.put(f"load {self.vector}, ptr {place}, align {LANES * self.number_bytes}")
        self._names[value] = name, self._position
        return name

    def _write_operation(self, node: Node) -> str:
        """Append the operation of a value, and return the name of its vector."""
        put, kind, operation = self._f.put, self.vector, node.value.operation
        if operation == "where":
            a, b, *both = node.operands
            chosen = ", ".join(f"{kind} {self.operand(one)}" for one in both)
            condition = self._write_comparison(id(node.value.operands[0]), a, b)
            return put(f"select <{LANES} x i1> {condition}, {chosen}")
        if node.product is not None:
            return self._write_fma(node)
        parts = [self.operand(one) for one in node.operands]
        if operation in _INSTRUCTIONS:
            return put(f"{_INSTRUCTIONS[operation]} {kind} {', '.join(parts)}")
        if operation == "sqrt":
            return self._call_intrinsic("sqrt", parts)
        return self._call_lanewise(operation.replace("arctan2", "atan2"), parts)

    def _write_comparison(self, key: int, a: Operation, b: Operation) -> str:
        """Append a comparison a < b unless this function has it already, and return the name of its result."""
        if key not in self._comparisons:
            both = f"{self.operand(a)}, {self.operand(b)}"
            self._comparisons[key] = self._f.put(f"fcmp olt {self.vector} {both}")
        return self._comparisons[key]

    def _write_fma(self, node: Node) -> str:
        """Append a sum or difference that is fused with its product, and return the name of its vector."""
        other, *factors = node.operands
        x, y = (self.operand(one) for one in factors)
        subtracts = node.value.operation == "-"
        if node.product is not None and node.value.operands[1] is node.product.value:
            if subtracts:
                x = self._f.put(f"fneg {self.vector} {x}")
            return self._call_intrinsic("fma", [x, y, self.operand(other)])
        rest = self.operand(other)
        if subtracts:
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

    # ---- narrow outputs

    def _store_sample_rows(self, output_index: int) -> None:
        """Store eight samples of a narrow output as rows, from an address that the kernel has set."""
        f = self._f
        parts = [self.operand(value) for value in self.schedule.output_nodes[output_index]]
        to = f.load_word("%places", 8 * output_index, "ptr")
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
