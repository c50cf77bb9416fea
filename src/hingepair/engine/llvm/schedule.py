"""The schedule of a kernel's arithmetic: which step computes a value, and where the frame keeps it.

A frame is an array of vectors, with one slot for each value that more than one function reads. The values are
computed in steps: arithmetic of limited length, and sines that are computed together. LLVM's time grows faster than
the length of a function, and values in the frame need no registers between the functions.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

from hingepair.engine.llvm.sines import SINES
from hingepair.engine.trace import Operand, TracedValue, needed_values

MAX_NARROW: Final = 16  # most components of an output that is assembled in registers
_UNSPLIT: Final = 1000  # most operations of a program that is one LLVM function, so that few values pass the frame
_SPLIT: Final = 300  # operations of each function of a longer program: LLVM spills few registers then


class ComponentGroup(NamedTuple):
    """The components of one array, which lie at one common stride in memory."""

    values: tuple[Any, ...]  # traced inputs; results, numbers among them
    in_frame: bool = False  # whether all of it has slots of the frame

    @property
    def narrow(self) -> bool:
        """Whether an output is assembled in registers; wider ones are copied from the frame."""
        return len(self.values) <= MAX_NARROW and not self.in_frame


class Node:
    """A value of the trace that the kernel needs, and where the kernel has it."""

    __slots__ = ("is_read", "made", "number", "operands", "product", "sines", "slot", "stores", "value")

    def __init__(self, value: TracedValue) -> None:
        self.value = value
        self.operands: list[Operation] = []  # of its code: those of a fused product in the place of the product
        self.product: Node | None = None  # that is fused with this sum or difference
        self.is_read = False  # by any code; a product that is fused into all of its sums is not
        self.sines: list[Node] = []  # the sine, cosine and versine of this angle
        self.stores: list[int] = []  # narrow outputs that are stored right after it has been computed
        self.made = -1  # the step that makes it; -1 if there is none
        self.slot = -1  # of the frame; -1 if it has none
        self.number = -1  # its place among the constants; -1 if it is none of them

    @property
    def read_nodes(self) -> list[Node]:
        """The values that its code reads."""
        return [one for one in self.operands if isinstance(one, Node)]


Operation: TypeAlias = "Node | float"
"""A value, or a known number."""


class Step(NamedTuple):
    """One step of a kernel: a function of its own, or sines."""

    name: str  # of the function
    lines: list[Node]  # to compute, in order; none for sines
    angles: list[Node]  # [rad] whose sines are computed; none for arithmetic


class Schedule:
    """The steps that compute a kernel's values, and the frame through which they pass values.

    Args:
        constants: inputs that are equal at all samples, in their order in memory.
        inputs: groups of input components.
        outputs: groups of output components.
        fuse: whether sums are fused with products (FMA).

    Attributes:
        inputs, outputs: the groups.
        has_constants: whether there are constants.
        output_nodes: for each output, its components.
        steps: the steps, in order.
        stored_last: narrow outputs that are stored at the end of the last step.
        frame_size: number of slots.
        input_slots: for each input, the components that are read, and the first of their slots.
        constant_slots: slots of the constants and known numbers that sines and wide outputs read.
    """

    def __init__(
        self,
        constants: Sequence[TracedValue],
        inputs: Sequence[ComponentGroup],
        outputs: Sequence[ComponentGroup],
        fuse: bool,
    ) -> None:
        self.inputs, self.outputs, self.has_constants = inputs, outputs, bool(constants)
        lines = _nodes(needed_values(value for group in outputs for value in group.values), fuse)
        nodes = {node.value: node for node in lines}
        for k, value in enumerate(constants):
            if value in nodes:
                nodes[value].number = k
        self.output_nodes: list[list[Operation]] = [
            [nodes[value] if isinstance(value, TracedValue) else value for value in group.values] for group in outputs
        ]
        for node in itertools.chain(*self.output_nodes, *(node.operands for node in lines)):
            if isinstance(node, Node):
                node.is_read = True
        self.steps = _steps(lines)
        self.stored_last: list[int] = []
        self._schedule_stores()
        wide = [one for g, group in enumerate(outputs) if not group.narrow for one in self.output_nodes[g]]
        self._assign_slots(nodes, wide)
        self._share_slots(wide)

    # ---- stores

    def _schedule_stores(self) -> None:
        """Note for each narrow output the value after which it is stored: the last of its components; if sines, which
        a shared function computes, the end of the last step.
        """
        position: dict[Node, int] = {}
        by_sines: set[Node] = set()
        for step in self.steps:
            made = [*step.lines, *(line for angle in step.angles for line in angle.sines)]
            position |= {node: len(position) + k for k, node in enumerate(made)}
            if step.angles:
                by_sines.update(made)
        for g, (group, parts) in enumerate(zip(self.outputs, self.output_nodes, strict=True)):
            if group.narrow:
                varying = [node for node in parts if isinstance(node, Node) and node in position]
                last = max(varying, key=position.__getitem__, default=None)
                (self.stored_last if last is None or last in by_sines else last.stores).append(g)

    def _read_by(self, step: Step) -> Iterator[Node]:
        """Yield the values that a step reads or stores in outputs."""
        yield from step.angles
        outputs = [g for node in step.lines for g in node.stores]
        if step is self.steps[-1]:
            outputs += self.stored_last
        for node in step.lines:
            yield from node.read_nodes
        for g in outputs:
            yield from (one for one in self.output_nodes[g] if isinstance(one, Node))

    # ---- the frame

    def _assign_slots(self, nodes: Mapping[TracedValue, Node], wide: Sequence[Operation]) -> None:
        """Assign slots of their own to inputs, constants and sines; `wide` are the components of wide outputs."""
        self.frame_size = 0
        self.input_slots: list[tuple[list[int], int]] = []
        for group in self.inputs:
            parts = [nodes.get(value) for value in group.values]
            used = [c for c, node in enumerate(parts) if group.in_frame or node is not None]
            self.input_slots.append((used, self.frame_size))
            for k, c in enumerate(used, self.frame_size):
                if (node := parts[c]) is not None:
                    node.slot = k
            self.frame_size += len(used)
        self.constant_slots: dict[Operation, int] = {}
        for one in (*wide, *(angle for step in self.steps for angle in step.angles)):
            if one not in self.constant_slots and (not isinstance(one, Node) or one.number >= 0):
                self.constant_slots[one] = self.frame_size
                self.frame_size += 1
                if isinstance(one, Node):
                    one.slot = self.constant_slots[one]
        for angle in itertools.chain(*(step.angles for step in self.steps)):  # computed together: behind each other
            for line in angle.sines:
                line.slot = self.frame_size + SINES.index(line.value.operation)
            self.frame_size += len(SINES)

    def _share_slots(self, wide: Sequence[Operation]) -> None:
        """Assign a slot to each other value that passes from one step to another, until its last use."""
        for s, step in enumerate(self.steps):
            for node in step.lines:
                node.made = s
        last: dict[Node, int] = {}  # the last step that reads a value, other than that which makes it
        for s, step in enumerate(self.steps):
            last |= {node: s for node in self._read_by(step) if node.made not in {-1, s}}
        last |= {one: len(self.steps) for one in wide if isinstance(one, Node) and one.made >= 0}
        ending: defaultdict[int, list[Node]] = defaultdict(list)
        for node, s in last.items():
            ending[s].append(node)
        free: list[int] = []
        for s, step in enumerate(self.steps):
            for node in step.lines:
                if node in last:
                    node.slot = free.pop() if free else self.frame_size
                    self.frame_size = max(self.frame_size, node.slot + 1)
            free += [node.slot for node in ending[s]]

    def slots_of(self, output: int) -> list[int]:
        """Return the slots of the components of an output that is copied from the frame."""
        return [one.slot if isinstance(one, Node) else self.constant_slots[one] for one in self.output_nodes[output]]

    def sine_slots(self, step: Step) -> tuple[list[int], int]:
        """Return the slots of the angles of a step of sines, and the first slot of the results."""
        line = step.angles[0].sines[0]
        return [angle.slot for angle in step.angles], line.slot - SINES.index(line.value.operation)


def _nodes(values: Sequence[TracedValue], fuse: bool) -> list[Node]:
    """Return the nodes of traced values, in the same order, with the operands of their code."""
    nodes = {value: Node(value) for value in values}
    for node in nodes.values():
        value = node.value
        operands: list[Operand] = [*value.operands]
        if value.operation in SINES:  # only the angle is read
            del operands[1:]
        if value.operation == "where" and isinstance(operands[0], TracedValue):  # the comparison's operands
            operands[:1] = operands[0].operands
        if fuse and value.operation in {"+", "-"}:
            for one in reversed(value.operands):  # the second of two products
                if isinstance(one, TracedValue) and one.operation == "*":
                    operands.reverse()
                    operands.remove(one)
                    operands += one.operands
                    node.product = nodes[one]
                    break
        node.operands = [nodes[one] if isinstance(one, TracedValue) else one for one in operands]
    return [*nodes.values()]


def _steps(lines: Iterable[Node]) -> list[Step]:
    """Return the steps that compute these values; sines come as early as they can."""
    rest = [node for node in lines if node.value.operation != "input" and node.is_read]
    parts: list[tuple[list[Node], list[Node]]] = []
    while any(node.value.operation in SINES for node in rest):
        # Late are sines and all that needs them; this round computes the sines whose angles are not late.
        late: set[Node] = set()
        angles: dict[Node, None] = {}
        for node in rest:
            operands = node.read_nodes
            if not late.isdisjoint(operands):
                late.add(node)
            elif node.value.operation in SINES:
                late.add(node)
                angles[operands[0]] = None
                operands[0].sines.append(node)
        # What these angles need comes first, then the angles' sines; the rest waits for the next round.
        first = {*angles}
        for node in reversed(rest):
            if node in first:
                first.update(node.read_nodes)
        parts += _split([node for node in rest if node in first])
        parts.append(([], [*angles]))
        first.update(line for angle in angles for line in angle.sines)
        rest = [node for node in rest if node not in first]
    parts += _split(rest)
    if not parts or parts[-1][1]:  # the last step stores outputs
        parts.append(([], []))
    return [Step(f"step{k}", *part) for k, part in enumerate(parts)]


def _split(lines: Sequence[Node]) -> list[tuple[list[Node], list[Node]]]:
    """Return the lines in parts of about equal length, one for each step, as pairs (lines, []), without angles."""
    count = -(-len(lines) // _SPLIT) if len(lines) > _UNSPLIT else min(len(lines), 1)
    ends = [len(lines) * k // count for k in range(count + 1)] if count else [0]
    return [(list(lines[a:b]), []) for a, b in itertools.pairwise(ends)]
