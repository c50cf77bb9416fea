"""The arithmetic of a kernel: the steps of a schedule as straight-line LLVM functions over the frame."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final

from hingepair.engine.llvm.builder import LANES, NUMBER_BYTES, FunctionBuilder, hexadecimal
from hingepair.engine.llvm.schedule import Node, Operation, Schedule, Step
from hingepair.engine.llvm.sines import DOUBLES
from hingepair.engine.trace import Operand

STEP_PARAMETERS: Final = "ptr noalias %frame, ptr noalias %places, ptr noalias %constants"
"""Of the functions: `places` holds the addresses where narrow outputs go."""

_MAX_AGE: Final = 40  # operations after which a value is loaded again, which lowers register pressure
_INSTRUCTIONS: Final = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv", "negative": "fneg"}  # of LLVM


class Arithmetic:
    """Where the vectors of a kernel are, and the functions of its steps.

    Args:
        schedule: the steps and the frame.
        float_type: LLVM's type of the numbers, "double" or "float".
    """

    def __init__(self, schedule: Schedule, float_type: str) -> None:
        self.schedule = schedule
        self.float_type = float_type
        self.vector = f"<{LANES} x {float_type}>"
        self.number_bytes = NUMBER_BYTES[float_type]
        self.lanewise_functions: set[str] = set()  # of the C library, which `step_functions` calls for each lane

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

    def constant(self, f: FunctionBuilder, value: Operation) -> str:
        """Return the vector of a known number or of a constant."""
        if not isinstance(value, Node):
            rounded = value if self.number_bytes == 8 else struct.unpack("f", struct.pack("f", value))[0]
            return f"splat ({self.float_type} {hexadecimal(rounded)})"
        place = f.pointer_at("%constants", value.number * self.number_bytes)
        number = f.put(f"load {self.float_type}, ptr {place}, align {self.number_bytes}")
        return f.splat(self.vector, f"{self.float_type} {number}")

    def step_functions(self) -> list[str]:
        """Return the declarations of intrinsics, then one function for each step of arithmetic."""
        vectors = {"sqrt": self.vector, "fma": ", ".join(3 * [self.vector])}
        declared = [f"declare {self.vector} {self.intrinsic(name)}({taken})" for name, taken in vectors.items()]
        return [*declared, *(_StepWriter(self, step).text() for step in self.schedule.steps if not step.angles)]

    def intrinsic(self, name: str) -> str:
        """Return the symbol of an intrinsic function of LLVM for the vectors of this kernel."""
        return f"@llvm.{name}.v{LANES}f{8 * self.number_bytes}"


class _StepWriter:
    """Builder of the function of a step of arithmetic."""

    def __init__(self, arithmetic: Arithmetic, step: Step) -> None:
        self.arithmetic, self.step = arithmetic, step
        self.vector, self.number_bytes = arithmetic.vector, arithmetic.number_bytes
        self.f = FunctionBuilder(f"internal void @{step.name}({STEP_PARAMETERS})")
        self.names: dict[Node, tuple[str, int]] = {}  # of vectors, and the position at which they were last used
        self.comparisons: dict[Operand, str] = {}  # names of their results
        self.position = 0  # of the operation that is being written

    def text(self) -> str:
        """Return the LLVM function."""
        schedule = self.arithmetic.schedule
        for position, node in enumerate(self.step.lines):
            self.position = position
            name = self.operation(node)
            self.names[node] = name, self.position
            if node.slot >= 0:
                self.arithmetic.store_slot(self.f, node.slot, name)
            for g in node.stores:
                self.store_rows(g)
        if self.step is schedule.steps[-1]:
            for g in schedule.stored_last:
                self.store_rows(g)
        self.f.do("ret void")
        return self.f.text()

    def operand(self, value: Operation) -> str:
        """Return an operand's vector: a number in all lanes, a register, or a load from the frame."""
        if not isinstance(value, Node):
            return self.arithmetic.constant(self.f, value)
        name, position = self.names.get(value, ("", 0))
        if not name or self.position - position > _MAX_AGE:
            if value.number >= 0:
                name = self.arithmetic.constant(self.f, value)
            elif value.slot >= 0:
                place = self.arithmetic.slot_address(self.f, value.slot)
                name = self.f.put(f"load {self.vector}, ptr {place}, align {LANES * self.number_bytes}")
        self.names[value] = name, self.position
        return name

    def operation(self, node: Node) -> str:
        """Append the operation of a value, and return the name of its vector."""
        operation, parts = node.value.operation, [self.operand(one) for one in node.operands]
        if operation == "where":
            less, a, b, *both = node.value.operands[0], *parts
            if less not in self.comparisons:
                self.comparisons[less] = self.f.put(f"fcmp olt {self.vector} {a}, {b}")
            chosen = ", ".join(f"{self.vector} {one}" for one in both)
            return self.f.put(f"select <{LANES} x i1> {self.comparisons[less]}, {chosen}")
        if node.product is not None:  # x y + rest, x y - rest, or rest - x y
            rest, x, y = parts
            if operation == "-" and node.value.operands[1] is node.product.value:
                x = self.f.put(f"fneg {self.vector} {x}")
            elif operation == "-":
                rest = self.f.put(f"fneg {self.vector} {rest}")
            return self.call(self.arithmetic.intrinsic("fma"), [x, y, rest], self.vector)
        if operation in _INSTRUCTIONS:
            return self.f.put(f"{_INSTRUCTIONS[operation]} {self.vector} {', '.join(parts)}")
        if operation == "sqrt":
            return self.call(self.arithmetic.intrinsic("sqrt"), parts, self.vector)
        return self.call_lanewise(operation.replace("arctan2", "atan2"), parts)

    def call(self, function: str, operands: Sequence[str], kind: str) -> str:
        """Append the call of a function of vectors of a type."""
        return self.f.put(f"call {kind} {function}({', '.join(f'{kind} {one}' for one in operands)})")

    def call_lanewise(self, name: str, operands: Sequence[str]) -> str:
        """Append the call, for each lane, of a function of the C library, which computes in double precision."""
        self.arithmetic.lanewise_functions.add(name)
        if self.number_bytes == 8:
            return self.call(f"@lanes.{name}", operands, DOUBLES)
        wide = [self.f.put(f"fpext {self.vector} {one} to {DOUBLES}") for one in operands]
        return self.f.put(f"fptrunc {DOUBLES} {self.call(f'@lanes.{name}', wide, DOUBLES)} to {self.vector}")

    def store_rows(self, output_index: int) -> None:
        """Store eight samples of a narrow output as rows, from an address that the kernel has set."""
        f = self.f
        parts = [self.operand(value) for value in self.arithmetic.schedule.output_nodes[output_index]]
        to = f.load_word("%places", 8 * output_index, "ptr")
        blocked_count = len(parts) // LANES * LANES
        blocks = [f.transpose(self.vector, parts[k : k + LANES]) for k in range(0, blocked_count, LANES)]
        samples = [list(sample) for sample in zip(*blocks, strict=True)]
        for first in range(0, LANES * len(parts), LANES):
            piece = self.pack(samples, parts[blocked_count:], len(parts), first)
            f.do(f"store {self.vector} {piece}, ptr {f.pointer_at(to, self.number_bytes * first)}, align 1")

    def pack(self, samples: list[list[str]], rest: list[str], count: int, first: int) -> str:
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
            vector = self.f.shuffle(self.vector, vector, other, lanes)
            lanes = [m if k >= 0 else -1 for m, k in enumerate(lanes)]
        return vector
