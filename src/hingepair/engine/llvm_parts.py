"""The arithmetic of a kernel: lines of a trace as straight LLVM functions over a frame.

A frame is an array of vectors, one slot for each value that more than one function reads; where samples share
hundreds of inputs, these stand there as numbers. The lines are cut into
steps: arithmetic of some length, and sines that are computed together. LLVM's time grows faster than the length of
a function, and what stands in the frame need not be kept in registers meanwhile.
"""

from __future__ import annotations

import itertools
import struct
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

from hingepair.engine.llvm_sines import DOUBLES, SINES
from hingepair.engine.llvm_writer import LANES, Function, hexadecimal
from hingepair.engine.trace import Operand, Value, needed_values

MAX_NARROW: Final = 16
"""Number of components up to which outputs are put together in registers, and inputs loaded into them."""

MAX_SHARED_VECTORS: Final = 256
"""Number of components that all samples share up to which each stands in the frame as a vector, of 16 kB in all.

More of them stand there as single numbers, so that they leave room in the first cache. Processors with few registers
take longer to spread a number over a vector than to load one.
"""

_MAX_WHOLE_LENGTH: Final = 1000  # operations up to which a part stays whole: fewer values pass through the frame
_STEP_LENGTH: Final = 300  # operations of the steps of longer parts, in which LLVM keeps to the registers there are
_RELOAD_DISTANCE: Final = 40  # operations after which a value is loaded from the frame again instead of kept
_OPERATORS: Final = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv", "negative": "fneg"}


class Group(NamedTuple):
    """Components that lie one stride apart.

    Attributes:
        values: the traced inputs, or results, in the order of the components.
        varies: whether they vary along the inner axis (of a scan: along the samples that follow each other).
    """

    values: tuple[Operand, ...]
    varies: bool = True

    @property
    def narrow(self) -> bool:
        """Whether it is an output that is put together in registers; others are taken from the frame."""
        return len(self.values) <= MAX_NARROW


class Carry(NamedTuple):
    """Values that a scan hands on.

    Attributes:
        before: the traced inputs; the first of them stand where the kernel finds them among its inputs.
        after: what becomes of them.
    """

    before: tuple[Value, ...]
    after: tuple[Operand, ...]


class Step(NamedTuple):
    """A part of the program: lines of arithmetic, or angles whose sines are computed together.

    Attributes:
        name: of its function.
        lines: in order.
        angles: where it is a step of sines; then it has no lines.
        loads: components of inputs that it loads, by the number of the input.
    """

    name: str
    lines: list[Value]
    angles: list[Value]
    loads: dict[int, list[int]]


class Arithmetic:
    """The steps of a program, and the frame between them.

    Args:
        inputs: groups of inputs.
        outputs: groups of results.
        carry: of a scan.
        number: "double" or "float".
        fuse: whether sums are fused with products.

    Attributes:
        once: steps of what does not change along the inner axis.
        block: steps of what does.
        slots: the slot of each value that has one, by its identity.
        frame_size: number of slots.
        loaded: numbers of the inputs that steps load into registers; the others are gathered into the frame.
        input_slots: for each input the components that are needed as vectors, and the first slot of those that are
            gathered.
        input_numbers: for each input the components that are needed as one number of all samples, and the first slot
            of them; a slot holds a number a lane.
        words: where the words of each loaded input begin among the places, and where those of the outputs do: of an
            input the address of its row, the distances of seven further samples, the bytes between components; of a
            narrow output the address to which its rows go.
    """

    def __init__(
        self, inputs: Sequence[Group], outputs: Sequence[Group], carry: Carry | None, number: str, fuse: bool
    ) -> None:
        self.inputs, self.outputs, self.carry = inputs, outputs, carry
        self.number, self.fuse = number, fuse
        self.vector = f"<{LANES} x {number}>"
        self.size = 8 if number == "double" else 4
        results = [value for group in outputs for value in group.values]
        results += list(carry.after) if carry else []
        lines = needed_values(results)
        self._operands = {id(line): self._operands_of(line) for line in lines}
        read = itertools.chain(results, *self._operands.values())
        self._kept = {id(value) for value in read}
        self._needed = {id(value) for value in (*lines, *(carry.before if carry else ()))}
        self._sine_lines: defaultdict[int, list[Value]] = defaultdict(list)
        self._declared: set[str] = set()
        self._lanewise: set[str] = set()
        self.once = self._steps("once", (value for value in lines if not value.varies))
        self.block = self._steps("block", (value for value in lines if value.varies))
        used = [sum(id(value) in self._needed for value in group.values) for group in inputs]
        self.loaded = {g for g, group in enumerate(inputs) if group.varies and used[g] <= MAX_NARROW}
        self._finished = self._order_rows()
        self._order_loads()
        self._place_values()

    # ---- the order of the operations

    def _fused_product(self, value: Value) -> Value | None:
        """Return the product that a sum is fused with, if any: its second operand before its first."""
        if self.fuse and value.operation in {"+", "-"}:
            for one in reversed(value.operands):
                if isinstance(one, Value) and one.operation == "*":
                    return one
        return None

    def _operands_of(self, value: Value) -> list[Value]:
        """Return the values that the code of a line reads: what is computed within the line is none of them."""
        read = list(value.operands)
        if value.operation in SINES:
            del read[1:]
        if value.operation == "where" and isinstance(read[0], Value):
            read[:1] = read[0].operands
        product = self._fused_product(value)
        if product is not None:
            read.reverse()
            read.remove(product)
            read += product.operands
        return [one for one in read if isinstance(one, Value)]

    def _steps(self, kind: str, lines: Iterable[Value]) -> list[Step]:
        """Return lines as steps: sines as soon as their angles are there, with what the angles need before them."""
        rest = [value for value in lines if value.operation != "input" and id(value) in self._kept]
        parts: list[tuple[list[Value], list[Value]]] = []
        while any(value.operation in SINES for value in rest):
            late: set[int] = set()
            angles: dict[int, Value] = {}
            for value in rest:
                operands = self._operands[id(value)]
                if any(id(one) in late for one in operands):
                    late.add(id(value))
                elif value.operation in SINES:
                    late.add(id(value))
                    angles[id(operands[0])] = operands[0]
                    self._sine_lines[id(operands[0])].append(value)
            first = set(angles)
            for value in reversed(rest):
                if id(value) in first:
                    first.update(map(id, self._operands[id(value)]))
            parts += _cut([value for value in rest if id(value) in first])
            parts.append(([], [*angles.values()]))
            first.update(id(line) for angle in angles for line in self._sine_lines[angle])
            rest = [value for value in rest if id(value) not in first]
        parts += _cut(rest)
        if kind == "block":  # it begins with loads, and ends with stores
            parts = [([], []), *parts] if not parts or parts[0][1] else parts
            parts = [*parts, ([], [])] if parts[-1][1] else parts
        return [Step(f"{kind}{k}", *part, defaultdict(list)) for k, part in enumerate(parts)]

    def _order_rows(self) -> dict[int, list[int]]:
        """Return the narrow outputs that are complete behind a line, by its identity; 0: at the end of the block."""
        position: dict[int, tuple[int, int]] = {}
        for step in self.block:
            sines = [line for angle in step.angles for line in self._sine_lines[id(angle)]]
            for value in (*step.lines, *sines):
                position[id(value)] = len(position), 0 if step.angles else id(value)
        finished: dict[int, list[int]] = defaultdict(list)
        for g, group in enumerate(self.outputs):
            if group.narrow:
                places = [position[id(value)] for value in group.values if id(value) in position]
                finished[max(places)[1] if places else 0].append(g)
        return finished

    def _order_loads(self) -> None:
        """Choose for each component of a loaded input the step that loads it.

        It is the step that reads it first, but none behind a step that stores: an output may lie over an input.
        """
        reads = [{id(value) for value in self._read_by(step)} for step in self.block]
        stores = [any(id(value) in self._finished for value in step.lines) for step in self.block]
        latest = stores.index(True) if any(stores) else len(self.block) - 1
        for g, group in enumerate(self.inputs):
            for c, value in enumerate(group.values):
                if g in self.loaded and id(value) in self._needed:
                    s = next((s for s in range(latest) if id(value) in reads[s]), latest)
                    while self.block[s].angles:
                        s -= 1
                    self.block[s].loads[g].append(c)

    def _read_by(self, step: Step) -> Iterator[Value]:
        """Return the values that a step reads."""
        yield from step.angles
        for value in step.lines:
            yield from self._operands[id(value)]
        last = step is self.block[-1]
        results = [self._finished.get(id(value), ()) for value in step.lines]
        for g in itertools.chain(*results, self._finished.get(0, ()) if last else ()):
            yield from (value for value in self.outputs[g].values if isinstance(value, Value))
        if self.carry and last:
            yield from (value for value in self.carry.after if isinstance(value, Value))

    # ---- the frame

    def _place_values(self) -> None:
        """Give a slot of the frame to each value that more than one function reads."""
        self.slots: dict[int, int] = {}
        self.input_slots: list[tuple[list[int], int]] = []
        self.input_numbers: list[tuple[list[int], int]] = []
        self._numbers: dict[int, int] = {}
        self.filled: dict[float, int] = {}
        size = 0
        steps = [*self.once, *self.block]
        wide = [value for group in self.outputs if not group.narrow for value in group.values]
        vectors = {id(value) for value in (*wide, *(angle for step in steps for angle in step.angles))}
        for g, group in enumerate(self.inputs):
            used = [c for c, value in enumerate(group.values) if id(value) in self._needed]
            many = len(used) > MAX_SHARED_VECTORS and not group.varies and self.carry is None
            shared = used if many else []
            own = [c for c in used if id(group.values[c]) in vectors] if shared else used
            self.input_numbers.append((shared, size))
            self._numbers |= {id(group.values[c]): size * LANES + k for k, c in enumerate(shared)}
            size += -(-len(shared) // LANES)
            self.input_slots.append((own, size))
            if g not in self.loaded:
                self.slots |= {id(group.values[c]): size + k for k, c in enumerate(own)}
                size += len(own)
        for value in wide:
            if not isinstance(value, Value) and value not in self.filled:
                self.filled[value] = size
                size += 1
        made: dict[int, int] = {}
        for s, step in enumerate(steps):
            made |= {id(value): s for value in self._made_by(step)}
            for angle in step.angles:
                lines = self._sine_lines[id(angle)]
                self.slots |= {id(line): size + SINES.index(line.operation) for line in lines}
                size += len(SINES)
        last: dict[int, int] = {}
        for s, step in enumerate(steps):
            last |= {id(value): s for value in self._read_by(step) if made.get(id(value), s) != s}
        last |= {id(value): len(steps) for value in wide if id(value) in made}
        ending: defaultdict[int, list[int]] = defaultdict(list)
        for value, s in last.items():
            if s < len(self.once) or made[value] >= len(self.once):  # what is made once stays for all blocks
                ending[s].append(value)
        free: list[int] = []
        for s, step in enumerate(steps):
            for value in self._made_by(step):
                if id(value) in last:
                    self.slots[id(value)] = free.pop() if free else size
                    size = max(size, self.slots[id(value)] + 1)
            free += [self.slots[value] for value in ending[s]]
        self.frame_size = size
        words = (LANES + 1 if g in self.loaded else 0 for g in range(len(self.inputs)))
        self.words = list(itertools.accumulate(words, initial=0))

    def _made_by(self, step: Step) -> list[Value]:
        """Return the values that a step of arithmetic loads or computes."""
        loaded = (self.inputs[g].values[c] for g, components in step.loads.items() for c in components)
        return [*(value for value in loaded if isinstance(value, Value)), *step.lines]

    def slot(self, f: Function, number: int) -> str:
        """Write the address of a slot."""
        return f.step("%frame", number * LANES * self.size)

    def keep(self, f: Function, number: int, value: str) -> None:
        """Write the store of a vector in a slot."""
        f.do(f"store {self.vector} {value}, ptr {self.slot(f, number)}, align {LANES * self.size}")

    def tiles(self, group: Group) -> list[int]:
        """Return where in the frame the components of a wide output are, as `llvm_memory` takes them."""
        offsets: list[int] = []
        for c in range(0, len(group.values), LANES):
            first = min(c, len(group.values) - LANES)
            values = group.values[first : first + LANES]
            slots = [self.slots[id(v)] if isinstance(v, Value) else self.filled[v] for v in values]
            places = [slot * LANES * self.size for slot in slots]
            constant = len(set(slots)) == 1 and not isinstance(values[0], Value)
            offsets += [~places[0], *places[1:]] if constant else places
        return offsets

    def sine_slots(self, step: Step) -> tuple[list[int], int]:
        """Return the slots of the angles of a step of sines, and the first slot of its results."""
        line = self._sine_lines[id(step.angles[0])][0]
        return [self.slots[id(angle)] for angle in step.angles], self.slots[id(line)] - SINES.index(line.operation)

    # ---- the functions of the steps

    def functions(self) -> list[str]:
        """Return the code of all steps of arithmetic, and the declarations of what they call."""
        steps = [self._function(step) for step in (*self.once, *self.block) if not step.angles]
        return [*sorted(self._declared), *steps]

    @property
    def lanewise(self) -> list[str]:
        """Names of the functions of the C library that the steps call lane by lane."""
        return sorted(self._lanewise)

    def _function(self, step: Step) -> str:
        """Return the function of a step of arithmetic, from the frame to the frame; it stores narrow outputs."""
        self._f = f = Function(f"internal void @{step.name}(ptr noalias %frame, ptr noalias %places)")
        self._names: dict[int, tuple[str, int]] = {}
        self._position = 0
        for g, components in step.loads.items():
            self._load_lanes(g, components)
        for self._position, value in enumerate(step.lines):
            name = self._operation(value)
            self._names[id(value)] = name, self._position
            if id(value) in self.slots:
                self.keep(f, self.slots[id(value)], name)
            for g in self._finished.get(id(value), ()):
                self._store_rows(g)
        if step is self.block[-1]:
            for g in self._finished.get(0, ()):
                self._store_rows(g)
            if self.carry:
                after = [self.of(value) for value in self.carry.after]
                for value, name in zip(self.carry.before, after, strict=True):
                    self.keep(f, self.slots[id(value)], name)
        f.do("ret void")
        return f.text()

    def of(self, one: Operand) -> str:
        """Write what is needed to name an operand: a vector, or a number in all lanes."""
        if not isinstance(one, Value):
            rounded = one if self.size == 8 else struct.unpack("f", struct.pack("f", one))[0]
            return f"splat ({self.number} {hexadecimal(rounded)})"
        name, seen = self._names.get(id(one), ("", 0))
        if not name or self._position - seen > _RELOAD_DISTANCE:
            if id(one) in self._numbers:
                place = self._f.step("%frame", self._numbers[id(one)] * self.size)
                number = self._f.put(f"load {self.number}, ptr {place}, align {self.size}", one.name)
                name = self._f.splat(self.vector, f"{self.number} {number}")
            elif id(one) in self.slots:
                place = self.slot(self._f, self.slots[id(one)])
                name = self._f.put(f"load {self.vector}, ptr {place}, align {LANES * self.size}", one.name)
        self._names[id(one)] = name, self._position
        return name

    def _operation(self, value: Value) -> str:
        """Write a line; returns the name of its value."""
        put, kind, note = self._f.put, self.vector, value.name
        if value.operation == "where":
            condition, *both = value.operands
            chosen = ", ".join(f"{kind} {self.of(one)}" for one in both)
            return put(f"select <{LANES} x i1> {self._comparison(condition)}, {chosen}", note)
        product = self._fused_product(value)
        if product is not None:
            return self._fused_sum(product, value)
        parts = [self.of(one) for one in value.operands]
        if value.operation in _OPERATORS:
            return put(f"{_OPERATORS[value.operation]} {kind} {', '.join(parts)}", note)
        if value.operation == "sqrt":
            return self._intrinsic("sqrt", parts, note)
        return self._call_by_lanes(value.operation.replace("arctan2", "atan2"), parts, note)

    def _comparison(self, condition: Operand) -> str:
        """Write the comparison of two values, once in a function; the frame holds none."""
        name, _ = self._names.get(id(condition), ("", 0))
        if not name and isinstance(condition, Value):
            both = ", ".join(self.of(one) for one in condition.operands)
            name = self._f.put(f"fcmp olt {self.vector} {both}")
            self._names[id(condition)] = name, 0
        return name

    def _fused_sum(self, product: Value, value: Value) -> str:
        """Write a sum or difference with a product, rounded once."""
        first, second = value.operands
        x, y = (self.of(one) for one in product.operands)
        if second is product:
            if value.operation == "-":
                x = self._f.put(f"fneg {self.vector} {x}")
            return self._intrinsic("fma", [x, y, self.of(first)], value.name)
        rest = self.of(second)
        if value.operation == "-":
            rest = self._f.put(f"fneg {self.vector} {rest}")
        return self._intrinsic("fma", [x, y, rest], value.name)

    def _intrinsic(self, name: str, parts: Sequence[str], note: str) -> str:
        """Write a call of one of LLVM's own functions."""
        kind, full = self.vector, f"@llvm.{name}.v{LANES}f{8 * self.size}"
        self._declared.add(f"declare {kind} {full}({', '.join([kind] * len(parts))})")
        return self._f.put(f"call {kind} {full}({', '.join(f'{kind} {part}' for part in parts)})", note)

    def _call_by_lanes(self, name: str, parts: Sequence[str], note: str) -> str:
        """Write the call of a function of the C library for each lane."""
        self._lanewise.add(name)
        if self.size == 4:
            parts = [self._f.put(f"fpext {self.vector} {part} to {DOUBLES}") for part in parts]
        value = self._f.put(f"call {DOUBLES} @lanes.{name}({', '.join(f'{DOUBLES} {part}' for part in parts)})", note)
        return value if self.size == 8 else self._f.put(f"fptrunc {DOUBLES} {value} to {self.vector}")

    # ---- narrow inputs and outputs

    def _load_lanes(self, g: int, components: Sequence[int]) -> None:
        """Write the loads of components of eight samples: one scalar load a lane."""
        f, word = self._f, 8 * self.words[g]
        row, step = f.word("%places", word, "ptr"), f.word("%places", word + 8 * LANES)
        samples = [row, *(f.step(row, f.word("%places", word + 8 * k)) for k in range(1, LANES))]
        for c in components:
            value, offset, vector = self.inputs[g].values[c], f.product(step, c) if c else 0, "poison"
            for k, sample in enumerate(samples):
                one = f.put(f"load {self.number}, ptr {f.step(sample, offset)}, align 1")
                note = value.name if k == LANES - 1 and isinstance(value, Value) else ""
                vector = f.put(f"insertelement {self.vector} {vector}, {self.number} {one}, i32 {k}", note)
            self._names[id(value)] = vector, 0
            if id(value) in self.slots:
                self.keep(f, self.slots[id(value)], vector)

    def _store_rows(self, g: int) -> None:
        """Write the stores of an output's eight samples, one behind the other."""
        f = self._f
        parts = [self.of(value) for value in self.outputs[g].values]
        to = f.word("%places", 8 * (self.words[-1] + g), "ptr")
        whole = len(parts) // LANES * LANES
        blocks = [f.transpose(self.vector, parts[k : k + LANES]) for k in range(0, whole, LANES)]
        samples = [list(sample) for sample in zip(*blocks, strict=True)]
        for first in range(0, LANES * len(parts), LANES):
            piece = self._piece(samples, parts[whole:], len(parts), first)
            f.do(f"store {self.vector} {piece}, ptr {f.step(to, self.size * first)}, align 1")

    def _piece(self, samples: list[list[str]], left: list[str], count: int, first: int) -> str:
        """Write eight numbers that follow each other, from the first-th of eight samples of `count` components on.

        They come out of vectors of a sample, of as many components as fill one, and of what is left of the
        components, vectors of a component.
        """
        picked = []
        for sample, c in (divmod(j, count) for j in range(first, first + LANES)):
            block, lane = divmod(c, LANES)
            picked.append((samples[sample][block], lane) if c < count - len(left) else (left[lane], sample))
        vector, *others = dict.fromkeys(name for name, _ in picked)
        lanes = [lane if name == vector else -1 for name, lane in picked]
        for other in others or ["poison"]:
            lanes = [LANES + lane if name == other else k for (name, lane), k in zip(picked, lanes, strict=True)]
            vector = self._f.shuffle(self.vector, vector, other, lanes)
            lanes = [m if k >= 0 else -1 for m, k in enumerate(lanes)]
        return vector


def _cut(lines: Sequence[Value]) -> list[tuple[list[Value], list[Value]]]:
    """Return lines whole, or in parts of about the same length."""
    count = -(-len(lines) // _STEP_LENGTH) if len(lines) > _MAX_WHOLE_LENGTH else min(len(lines), 1)
    ends = [len(lines) * k // count for k in range(count + 1)] if count else [0]
    return [(list(lines[a:b]), []) for a, b in itertools.pairwise(ends)]
