"""A trace written out as LLVM code: a loop over samples, eight at a time, one vector register a value.

Two shapes of loop serve everything. `map`: samples do not know of each other; what does not change from sample to
sample is computed once before the loop. `scan`: the samples of the last axis follow one after the other, each given a
carry by the one before; eight such chains run side by side.

Lanes are gathered by scalar loads with strides known at run time (wide loads and shuffles took twice as long), and
stored as whole cache lines where outputs lie side by side, past the caches where they are too many to stay in them.
What is left when the samples are no multiple of eight goes through the same code, one sample in all lanes.

Every group of components (a row of seven coordinates, say) is given by a line of five integers: address, bytes
between outer samples, between inner samples, between components, and for outputs how to store: SCATTERED,
SIDE_BY_SIDE, or past the caches: ON_LINES, where addresses are multiples of a vector's size, and OFF_LINES, where
they lie 16 bytes behind one, as they do in NumPy's own large arrays.

Where the machine can, every sum with a product is fused with it, here and not at LLVM's choice, so that the bits of a
result do not depend on what else is computed. Nothing is reordered, and NaN stays NaN.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

from hingepair.engine.trace import Operand, Value, needed_lines

LANES: Final = 8
FIELDS: Final = 5
SCATTERED, SIDE_BY_SIDE, ON_LINES, OFF_LINES = range(4)
PIECE: Final = 16  # bytes that OFF_LINES is off, and of its smallest stores
AHEAD: Final = 128  # samples from the one being computed to the one whose inputs are asked for

_REACH: Final = 1e6  # up to here the three parts of pi/2 reduce an angle without loss
_MAGIC: Final = 6755399441055744.0  # 1.5 * 2^52: adding it rounds to an integer, which then stands in the low bits
_HALF_PI: Final = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33)
# Minimax polynomials in r^2 on [0, (pi/4)^2], highest power first: (sin r / r - 1) / r^2 with a relative error of
# 2e-17 and (cos r - 1 + r^2/2) / r^4 with one of 1.3e-18.
_SINE: Final = (
    *(1.5918115263265974e-10, -2.505113165023518e-08, 2.7557316101617874e-06),
    *(-0.00019841269836756774, 0.008333333333330948, -0.16666666666666666),
)
_COSINE: Final = (
    *(-1.1382623647474604e-11, 2.087614614655861e-09, -2.7557317271145144e-07),
    *(2.480158729876456e-05, -0.0013888888888887398, 0.041666666666666664),
)
_SINES: Final = ("sin", "cos", "versine")
_PLAIN: Final = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv", "negative": "fneg", "<": "fcmp olt"}
_DOUBLES: Final = f"<{LANES} x double>"


class Group(NamedTuple):
    """Components that lie one stride apart.

    Attributes:
        values: the traced inputs, or results, in the order of the components.
        moves: whether they change along the inner axis (of a scan: along the samples that follow each other).
    """

    values: tuple[Operand, ...]
    moves: bool = True


class Carry(NamedTuple):
    """What a scan hands on: traced inputs, and what becomes of them; its start is the first of the input groups."""

    before: tuple[Value, ...]
    after: tuple[Operand, ...]


def kernel_ir(
    inputs: Sequence[Group],
    outputs: Sequence[Group],
    *,
    single: bool = False,
    fuse: bool = True,
    carry: Carry | None = None,
) -> str:
    """The code of `void kernel(i64* table, i64 outer, i64 inner)`.

    Args:
        inputs: in the order of the table.
        outputs: those after them.
        single: float32 instead of float64; sines are taken in float64.
        fuse: whether sums are fused with products.
        carry: makes it a scan: each outer sample is a chain of inner ones.
    """
    return _Kernel(inputs, outputs, "float" if single else "double", fuse, carry).text()


class _Kernel:
    def __init__(
        self, inputs: Sequence[Group], outputs: Sequence[Group], number: str, fuse: bool, carry: Carry | None
    ) -> None:
        self.inputs, self.outputs, self.carry = inputs, outputs, carry
        self.number, self.fuse = number, fuse
        self.vector = f"<{LANES} x {number}>"
        self.size = 8 if number == "double" else 4
        self.lines: list[str] = []
        self.names: dict[int, str] = {}
        self.taken: set[str] = set()
        self.count = 0
        self.block = "entry"
        self.declared: set[str] = set()

    # ---- writing

    def put(self, code: str, name: str = "") -> str:
        """Write an instruction; the name of what it gives."""
        own = self.fresh(name)
        self.lines.append(f"  {own} = {code}")
        return own

    def fresh(self, wish: str = "") -> str:
        if wish and f"%{wish}" not in self.taken:
            own = f"%{wish}"
        else:
            self.count += 1
            own = f"%{wish}.{self.count}"
        self.taken.add(own)
        return own

    def do(self, code: str) -> None:
        self.lines.append(f"  {code}")

    def start(self, label: str) -> None:
        self.lines.append(f"{label}:")
        self.block = label

    def go(self, label: str) -> str:
        """End the block, and begin the next; the name of the one that ended."""
        before = self.block
        self.do(f"br label %{label}")
        self.start(label)
        return before

    def declare(self, signature: str) -> None:
        self.declared.add(f"declare {signature}")

    def of(self, one: Operand) -> str:
        """An operand: the name of a value, or a number in all lanes."""
        return self.names[id(one)] if isinstance(one, Value) else self.splat(one)

    def splat(self, number: float) -> str:
        rounded = number if self.size == 8 else struct.unpack("f", struct.pack("f", number))[0]
        return f"splat ({self.number} {_hex(rounded)})"

    # ---- the loops

    def text(self) -> str:
        """The whole module."""
        results = [value for group in self.outputs for value in group.values]
        results += list(self.carry.after) if self.carry else []
        self.needed = needed_lines(results)
        self.alone = {id(value) for value in results}
        for value in self.needed:
            rest = list(value.operands)
            product = self.fused(value)
            if product is not None:
                rest.reverse()
                rest.remove(product)
            self.alone.update(map(id, rest))
        if self.carry:
            self.scan_loops(self.carry)
        else:
            self.map_loops()
        body = "\n".join(self.lines)
        parts = [f"define void @kernel(ptr noalias %table, i64 %outer, i64 %inner) {{\n{body}\n}}"]
        parts += [_FAR] if "@far" in body else []
        parts += [_by_lanes(name) for name in ("atan2", "hypot") if f"@lanes.{name}" in body]
        return "\n\n".join([*sorted(self.declared), *parts, _METADATA]) + "\n"

    def open_outer(self, axis: str) -> list[str]:
        """The table's lines, the loop over outer samples, and where in it each group begins.

        The samples of `axis`, "inner" or "outer", lie in the lanes.
        """
        self.start("entry")
        self.fields = []
        for g in range(len(self.inputs) + len(self.outputs)):
            line = []
            for k, field in enumerate(("at", "outer", "inner", "step", "mode")):
                place = self.put(f"getelementptr i64, ptr %table, i64 {g * FIELDS + k}")
                line.append(self.put(f"load i64, ptr {place}", f"{field}{g}"))
            self.fields.append(line)
        widest = max((len(group.values) for group in self.outputs), default=1)
        self.do(f"%scratch = alloca [{max(widest, 12) * LANES} x double], align 64")
        self.put(f"and i64 %{axis}, -{LANES}", "whole")
        self.go("outer.head")
        self.do("%o = phi i64 [0, %entry], [%o.next, %outer.next]")
        self.put("icmp slt i64 %o, %outer", "o.more")
        self.do("br i1 %o.more, label %outer.body, label %done")
        self.start("outer.body")
        return [
            self.put(f"add i64 {f[0]}, {self.put(f'mul i64 %o, {f[1]}')}", f"base{g}")
            for g, f in enumerate(self.fields)
        ]

    def close_outer(self, step: str) -> None:
        self.put(f"add i64 %o, {step}", "o.next")
        self.do("br label %outer.head")
        self.start("done")
        self.do("fence seq_cst")
        self.do("ret void")

    def close_inner(self, step: str) -> None:
        self.go("loop.next")
        self.put(f"add i64 %i, {step}", "i.next")
        self.do("br label %loop.head")

    def row(self, g: int, base: str) -> str:
        """Where the inner sample of a group is."""
        return self.put(f"add i64 {base}, {self.put(f'mul i64 %i, {self.fields[g][2]}')}")

    def map_loops(self) -> None:
        bases = self.open_outer("inner")
        for g, group in enumerate(self.inputs):
            if not group.moves:
                self.load_same(group, bases[g], self.fields[g][3])
        self.compute([value for value in self.needed if not value.moves])
        before = self.go("phase.head")
        self.do(f"%phase = phi i1 [false, %{before}], [true, %phase.next]")
        self.put("select i1 %phase, i64 %whole, i64 0", "first")
        self.put("select i1 %phase, i64 %inner, i64 %whole", "stop")
        self.put(f"select i1 %phase, i64 1, i64 {LANES}", "many")
        strides = {
            g: self.put(f"select i1 %phase, i64 0, i64 {self.fields[g][2]}", f"lane{g}")
            for g, group in enumerate(self.inputs)
            if group.moves
        }
        jumps = {g: self.jump(g, len(self.inputs[g].values)) for g in strides}
        self.go("loop.head")
        self.do("%i = phi i64 [%first, %phase.head], [%i.next, %loop.next]")
        self.put("icmp slt i64 %i, %stop", "i.more")
        self.do("br i1 %i.more, label %loop.body, label %phase.next")
        self.start("loop.body")
        for g, stride in strides.items():
            row = self.row(g, bases[g])
            self.prefetch(row, g, jumps[g])
            self.load_lanes(self.inputs[g], row, stride, self.fields[g][3])
        self.compute([value for value in self.needed if value.moves])
        for g, group in enumerate(self.outputs, len(self.inputs)):
            row = self.row(g, bases[g])
            mode = self.put(f"select i1 %phase, i64 {SCATTERED}, i64 {self.fields[g][4]}")
            self.store(group, row, g, mode)
        self.close_inner("%many")
        self.start("phase.next")
        self.do("br i1 %phase, label %outer.next, label %phase.head")
        self.start("outer.next")
        self.close_outer("1")

    def scan_loops(self, carry: Carry) -> None:
        """Chains side by side: eight outer samples in the lanes, the inner ones one after the other."""
        before, after = carry
        bases = self.open_outer("outer")
        self.put("icmp sge i64 %o, %whole", "phase")
        self.put(f"select i1 %phase, i64 1, i64 {LANES}", "many")
        lanes = [self.put(f"select i1 %phase, i64 0, i64 {f[1]}", f"lane{g}") for g, f in enumerate(self.fields)]
        for g, group in enumerate(self.inputs):
            if not group.moves:
                self.load_lanes(group, bases[g], lanes[g], self.fields[g][3])
        first = {id(value): self.names[id(value)] for value in before if id(value) in self.names}
        self.compute([value for value in self.needed if not value.moves])
        entry = self.go("loop.head")
        self.do(f"%i = phi i64 [0, %{entry}], [%i.next, %loop.next]")
        carried = []
        for k, value in enumerate(before):
            self.names[id(value)] = own = f"%carry{k}"
            carried.append(len(self.lines))
            self.do(f"{own} = phi {self.vector} [{first[id(value)]}, %{entry}], [AFTER{k}, %loop.next]")
        self.put("icmp slt i64 %i, %inner", "i.more")
        self.do("br i1 %i.more, label %loop.body, label %outer.next")
        self.start("loop.body")
        for g, group in enumerate(self.inputs):
            if group.moves:
                self.load_lanes(group, self.row(g, bases[g]), lanes[g], self.fields[g][3])
        self.compute([value for value in self.needed if value.moves])
        for g, group in enumerate(self.outputs, len(self.inputs)):
            self.scatter(group, self.row(g, bases[g]), self.fields[g][1], self.fields[g][3])
        for k, (line, later) in enumerate(zip(carried, after, strict=True)):
            self.lines[line] = self.lines[line].replace(f"AFTER{k}", self.of(later))
        self.close_inner("1")
        self.start("outer.next")
        self.close_outer("%many")

    # ---- memory

    def load_same(self, group: Group, base: str, step: str) -> None:
        """Components that all samples share: one load each, in all lanes."""
        for c, value in self.taken_of(group):
            one = self.load(self.further(base, step, c))
            lane = self.put(f"insertelement {self.vector} poison, {self.number} {one}, i32 0")
            spread = f"shufflevector {self.vector} {lane}, {self.vector} poison, <{LANES} x i32> zeroinitializer"
            self.names[id(value)] = self.put(spread, value.name)

    def load_lanes(self, group: Group, row: str, lane: str, step: str) -> None:
        """Components of eight samples: one scalar load a lane."""
        rows = [self.further(row, lane, k) for k in range(LANES)]
        for c, value in self.taken_of(group):
            offset = self.put(f"mul i64 {step}, {c}") if c else ""
            vector = "poison"
            for k in range(LANES):
                one = self.load(self.put(f"add i64 {rows[k]}, {offset}") if c else rows[k])
                name = value.name if k == LANES - 1 else ""
                vector = self.put(f"insertelement {self.vector} {vector}, {self.number} {one}, i32 {k}", name)
            self.names[id(value)] = vector

    def load(self, at: str) -> str:
        """The number at an address."""
        return self.put(f"load {self.number}, ptr {self.put(f'inttoptr i64 {at} to ptr')}, align 1")

    def further(self, at: str, step: str, count: int) -> str:
        """The address so many steps further on."""
        return self.put(f"add i64 {at}, {self.put(f'mul i64 {step}, {count}')}") if count else at

    def taken_of(self, group: Group) -> list[tuple[int, Value]]:
        """The components that something needs, each once."""
        used = {id(value) for value in self.needed} | {id(v) for v in (self.carry.before if self.carry else ())}
        found = [(c, value) for c, value in enumerate(group.values) if isinstance(value, Value)]
        return [(c, value) for c, value in found if id(value) in used]

    def jump(self, g: int, count: int) -> str:
        """Bytes between the cache lines that eight samples take: along rows, or from component to component."""
        stride, step = self.fields[g][2:4]
        self.declare("i64 @llvm.abs.i64(i64, i1)")
        wide, far = (self.put(f"call i64 @llvm.abs.i64(i64 {x}, i1 false)") for x in (stride, step))
        along = self.put(f"sdiv i64 {self.put(f'mul i64 {stride}, {LANES}')}, {count}")
        return self.put(f"select i1 {self.put(f'icmp sle i64 {far}, {wide}')}, i64 {along}, i64 {step}")

    def prefetch(self, row: str, g: int, jump: str) -> None:
        self.declare("void @llvm.prefetch.p0(ptr, i32, i32, i32)")
        ahead = self.further(row, self.fields[g][2], AHEAD)
        for c in range(len(self.inputs[g].values)):
            at = self.further(ahead, jump, c)
            self.do(f"call void @llvm.prefetch.p0(ptr {self.put(f'inttoptr i64 {at} to ptr')}, i32 0, i32 2, i32 1)")

    def store(self, group: Group, row: str, g: int, mode: str) -> None:
        """Eight samples side by side, or lane by lane."""
        count = len(group.values)
        scatter, dense, on, off, stored = (f"{kind}{g}" for kind in ("scatter", "dense", "on", "off", "stored"))
        cases = f"i64 {SIDE_BY_SIDE}, label %{dense} i64 {ON_LINES}, label %{on} i64 {OFF_LINES}, label %{off}"
        rows = self.rows(group)
        self.do(f"switch i64 {mode}, label %{scatter} [{cases}]")
        for label, align in ((dense, 1), (on, LANES * self.size)):
            self.start(label)
            for k in range(count):
                self.put_part(rows, count, row, LANES * k, align=align, past=label == on)
            self.do(f"br label %{stored}")
        self.start(off)
        piece = PIECE // self.size
        ahead, last = LANES - piece, LANES * count - piece
        for first in range(ahead, last, LANES):
            self.put_part(rows, count, row, first, align=LANES * self.size, past=True)
        for first in (*range(0, ahead, piece), last):
            self.put_part(rows, count, row, first, piece, align=PIECE, past=True)
        self.do(f"br label %{stored}")
        self.start(scatter)
        self.scatter(group, row, self.fields[g][2], self.fields[g][3])
        self.go(stored)

    def put_part(
        self, rows: list[list[str]], count: int, row: str, first: int, size: int = LANES, *, align: int, past: bool
    ) -> None:
        """Store numbers that follow each other, from the first-th of eight samples of `count` components on."""
        part = self.part(rows, count, first, size)
        place = self.put(f"inttoptr i64 {self.put(f'add i64 {row}, {self.size * first}')} to ptr")
        hint = ", !nontemporal !0" if past else ""
        self.do(f"store <{size} x {self.number}> {part}, ptr {place}, align {align}{hint}")

    def rows(self, group: Group) -> list[list[str]]:
        """Vectors from which the samples are put together: of a sample, of as many components as fill one.

        Where components are too few to fill a vector, and for those that are left: of a component, of all samples.
        """
        parts = [self.of(value) for value in group.values]
        full = len(parts) // LANES * LANES
        blocks = [self.transposed(parts[k : k + LANES]) for k in range(0, full, LANES)]
        return [*(list(sample) for sample in zip(*blocks, strict=True)), parts[full:]]

    def part(self, rows: list[list[str]], count: int, first: int, size: int) -> str:
        """These numbers, out of `rows`."""
        wish = []
        for sample, c in (divmod(j, count) for j in range(first, first + size)):
            block, lane = divmod(c, LANES)
            wish.append((rows[sample][block], lane) if c < count - len(rows[-1]) else (rows[-1][lane], sample))
        found, *others = dict.fromkeys(name for name, _ in wish)
        picks = [lane if name == found else -1 for name, lane in wish] + [-1] * (LANES - size)
        for other in others or ["poison"]:
            both = zip(wish, picks, strict=False)
            picks[:size] = [LANES + lane if name == other else own for (name, lane), own in both]
            found = self.shuffle(found, other, picks)
            picks = [m if pick >= 0 else -1 for m, pick in enumerate(picks)]
        return found if size == LANES else self.shuffle(found, "poison", picks[:size])

    def transposed(self, vectors: list[str]) -> list[str]:
        """Eight components of a sample each, from eight samples of a component each."""
        for step in (1, 2, 4):
            low = [m if not m & step else LANES + m - step for m in range(LANES)]
            high = [m + step if not m & step else LANES + m for m in range(LANES)]
            vectors = [
                self.shuffle(*(vectors[i & ~step], vectors[i | step]), high if i & step else low)
                for i in range(LANES)
            ]
        return vectors

    def shuffle(self, x: str, y: str, picks: Sequence[int]) -> str:
        mask = ", ".join(f"i32 {k}" if k >= 0 else "i32 poison" for k in picks)
        return self.put(f"shufflevector {self.vector} {x}, {self.vector} {y}, <{len(picks)} x i32> <{mask}>")

    def scatter(self, group: Group, row: str, stride: str, step: str) -> None:
        """As many lanes as there are samples, one after the other, by way of the scratch array."""
        for c, value in enumerate(group.values):
            place = self.put(f"getelementptr {self.number}, ptr %scratch, i64 {c * LANES}")
            self.do(f"store {self.vector} {self.of(value)}, ptr {place}, align 32")
        label = self.fresh("lanes")[1:]
        before = self.go(label)
        k, after = self.fresh("k"), self.fresh("k.next")
        self.do(f"{k} = phi i64 [0, %{before}], [{after}, %{label}]")
        at = self.put(f"add i64 {row}, {self.put(f'mul i64 {k}, {stride}')}")
        for c in range(len(group.values)):
            place = self.put(
                f"getelementptr {self.number}, ptr %scratch, i64 {self.put(f'add i64 {k}, {c * LANES}')}"
            )
            one = self.put(f"load {self.number}, ptr {place}")
            target = self.further(at, step, c)
            self.do(f"store {self.number} {one}, ptr {self.put(f'inttoptr i64 {target} to ptr')}, align 1")
        self.do(f"{after} = add i64 {k}, 1")
        more, done = self.put(f"icmp slt i64 {after}, %many"), self.fresh("written")[1:]
        self.do(f"br i1 {more}, label %{label}, label %{done}")
        self.start(done)

    # ---- arithmetic

    def compute(self, lines: Sequence[Value]) -> None:
        """Write the lines; sines of angles that are all known are taken together."""
        for i, value in enumerate(lines):
            if id(value) in self.names or value.operation == "input" or id(value) not in self.alone:
                continue
            if value.operation in _SINES:
                ready = dict.fromkeys(later.operands[0] for later in lines[i:] if later.operation in _SINES)
                self.sines([x for x in ready if isinstance(x, Value) and id(x) in self.names], lines)
            else:
                self.names[id(value)] = self.operation(value)

    def fused(self, value: Value) -> Value | None:
        """The product that a sum is fused with, if any: its second operand before its first."""
        if self.fuse and value.operation in {"+", "-"}:
            for one in reversed(value.operands):
                if isinstance(one, Value) and one.operation == "*":
                    return one
        return None

    def operation(self, value: Value) -> str:
        name, kind = value.name, self.vector
        if value.operation == "where":
            condition, *both = value.operands
            chosen = ", ".join(f"{kind} {self.of(one)}" for one in both)
            return self.put(f"select <{LANES} x i1> {self.of(condition)}, {chosen}", name)
        product = self.fused(value)
        if product is not None:
            return self.sum_with(product, value)
        parts = [self.of(one) for one in value.operands]
        if value.operation in _PLAIN:
            return self.put(f"{_PLAIN[value.operation]} {kind} {', '.join(parts)}", name)
        if value.operation == "sqrt":
            return self.intrinsic("sqrt", parts, name)
        return self.narrow(self.put(self.by_lanes(value.operation.replace("arctan2", "atan2"), parts)), name)

    def sum_with(self, product: Value, value: Value) -> str:
        """A sum or difference with a product, rounded once."""
        first, second = value.operands
        x, y = (self.of(one) for one in product.operands)
        if second is product:
            if value.operation == "-":
                x = self.put(f"fneg {self.vector} {x}")
            return self.intrinsic("fma", [x, y, self.of(first)], value.name)
        rest = self.of(second)
        if value.operation == "-":
            rest = self.put(f"fneg {self.vector} {rest}")
        return self.intrinsic("fma", [x, y, rest], value.name)

    def intrinsic(self, name: str, parts: Sequence[str], wish: str = "", doubles: bool = False) -> str:
        kind = _DOUBLES if doubles else self.vector
        full = f"@llvm.{name}.v{LANES}f{64 if doubles or self.size == 8 else 32}"
        self.declare(f"{kind} {full}({', '.join([kind] * len(parts))})")
        return self.put(f"call {kind} {full}({', '.join(f'{kind} {part}' for part in parts)})", wish)

    def by_lanes(self, name: str, parts: Sequence[str]) -> str:
        """The call of a function of the C library for each lane."""
        self.declare(f"double @{name}(double, double)")
        return f"call {_DOUBLES} @lanes.{name}({', '.join(f'{_DOUBLES} {self.widen(part)}' for part in parts)})"

    def widen(self, x: str) -> str:
        return x if self.size == 8 else self.put(f"fpext {self.vector} {x} to {_DOUBLES}")

    def narrow(self, x: str, wish: str = "") -> str:
        return x if self.size == 8 else self.put(f"fptrunc {_DOUBLES} {x} to {self.vector}", wish)

    def sines(self, angles: Sequence[Value], lines: Sequence[Value]) -> None:
        """Sine, cosine and 1 - cosine of some angles, to 1.5 ulp, the last to 2.5.

        An angle is reduced by the nearest multiple of pi/2, in three parts; the quadrant picks polynomial and sign.
        Lanes with an angle past 1e6, or none at all (inf, NaN), are computed again one by one.
        """
        wide = [self.widen(self.of(angle)) for angle in angles]
        near, found = "", []
        for x in wide:
            found.append(self.near_sines(x))
            size = self.intrinsic("fabs", [x], doubles=True)
            inside = self.put(f"fcmp ole {_DOUBLES} {size}, splat (double {_hex(_REACH)})")
            near = self.put(f"and <{LANES} x i1> {near}, {inside}") if near else inside
        bits = self.put(f"bitcast <{LANES} x i1> {near} to i{LANES}")
        before, far, done = self.block, self.fresh("far")[1:], self.fresh("turned")[1:]
        self.do(f"br i1 {self.put(f'icmp eq i{LANES} {bits}, -1')}, label %{done}, label %{far}")
        self.start(far)
        corrected = []
        for x, three in zip(wide, found, strict=True):
            places = [self.put(f"getelementptr double, ptr %scratch, i64 {LANES * k}") for k in range(4)]
            for part, place in zip((x, *three), places, strict=True):
                self.do(f"store {_DOUBLES} {part}, ptr {place}, align 64")
            self.do("call void @far(ptr %scratch)")
            corrected.append([self.put(f"load {_DOUBLES}, ptr {place}, align 64") for place in places[1:]])
        self.go(done)
        both = [
            [self.put(f"phi {_DOUBLES} [{a}, %{before}], [{b}, %{far}]") for a, b in zip(*two, strict=True)]
            for two in zip(found, corrected, strict=True)
        ]
        for value in lines:
            if value.operation in _SINES and value.operands[0] in angles and id(value) not in self.names:
                terms = both[angles.index(value.operands[0])]
                self.names[id(value)] = self.narrow(terms[_SINES.index(value.operation)])

    def near_sines(self, x: str) -> tuple[str, str, str]:
        put = self.put

        def fma(a: str, b: str, c: str) -> str:
            return self.intrinsic("fma", [a, b, c], doubles=True)

        def polynomial(z: str, coefficients: Sequence[float]) -> str:
            value = _same(coefficients[0])
            for c in coefficients[1:]:
                value = fma(z, value, _same(c))
            return value

        def bit(mask: int, number: str) -> str:
            kind = f"<{LANES} x i64>"
            return put(f"icmp ne {kind} {put(f'and {kind} {number}, splat (i64 {mask})')}, zeroinitializer")

        def pick(condition: str, a: str, b: str) -> str:
            return put(f"select <{LANES} x i1> {condition}, {_DOUBLES} {a}, {_DOUBLES} {b}")

        kind = f"<{LANES} x i64>"
        shifted = fma(x, _same(0.6366197723675814), _same(_MAGIC))
        quadrant = put(f"bitcast {_DOUBLES} {shifted} to {kind}")
        back = put(f"fsub {_DOUBLES} {_same(_MAGIC)}, {shifted}")
        r = x
        for part in _HALF_PI:
            r = fma(back, _same(part), r)
        z = put(f"fmul {_DOUBLES} {r}, {r}")
        small = fma(put(f"fmul {_DOUBLES} {r}, {z}"), polynomial(z, _SINE), r)
        square = put(f"fneg {_DOUBLES} {put(f'fmul {_DOUBLES} {z}, {z}')}")
        drop = fma(square, polynomial(z, _COSINE), put(f"fmul {_DOUBLES} {z}, {_same(0.5)}"))
        large = put(f"fsub {_DOUBLES} {_same(1.0)}, {drop}")
        odd = bit(1, quadrant)
        sine, cosine = pick(odd, large, small), pick(odd, small, large)
        sine = pick(bit(2, quadrant), put(f"fneg {_DOUBLES} {sine}"), sine)
        turned = put(f"add {kind} {quadrant}, splat (i64 1)")
        cosine = pick(bit(2, turned), put(f"fneg {_DOUBLES} {cosine}"), cosine)
        rest = put(f"fsub {_DOUBLES} {_same(1.0)}, {cosine}")
        return sine, cosine, pick(bit(3, quadrant), rest, drop)


def _same(number: float) -> str:
    return f"splat (double {_hex(number)})"


def _hex(number: float) -> str:
    """A number to the last bit; single precision is written likewise, once it is rounded."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', number))[0]:016X}"


_METADATA = "!0 = !{i32 1}"

_FAR = f"""define internal void @far(ptr %four) noinline cold {{
entry:
  br label %head
head:
  %k = phi i64 [0, %entry], [%k.next, %next]
  %place = getelementptr double, ptr %four, i64 %k
  %x = load double, ptr %place
  %size = call double @llvm.fabs.f64(double %x)
  %near = fcmp ole double %size, {_hex(_REACH)}
  br i1 %near, label %next, label %turn
turn:
  %sine = call double @sin(double %x)
  %cosine = call double @cos(double %x)
  %half = fmul double %x, 5.0e-01
  %root = call double @sin(double %half)
  %square = fmul double %root, %root
  %versine = fadd double %square, %square
  %place1 = getelementptr double, ptr %place, i64 {LANES}
  %place2 = getelementptr double, ptr %place, i64 {2 * LANES}
  %place3 = getelementptr double, ptr %place, i64 {3 * LANES}
  store double %sine, ptr %place1
  store double %cosine, ptr %place2
  store double %versine, ptr %place3
  br label %next
next:
  %k.next = add i64 %k, 1
  %more = icmp slt i64 %k.next, {LANES}
  br i1 %more, label %head, label %done
done:
  ret void
}}

declare double @llvm.fabs.f64(double)
declare double @sin(double)
declare double @cos(double)"""


def _by_lanes(name: str) -> str:
    return f"""define internal {_DOUBLES} @lanes.{name}({_DOUBLES} %a, {_DOUBLES} %b) noinline {{
entry:
  br label %head
head:
  %k = phi i64 [0, %entry], [%k.next, %head]
  %all = phi {_DOUBLES} [poison, %entry], [%all.next, %head]
  %x = extractelement {_DOUBLES} %a, i64 %k
  %y = extractelement {_DOUBLES} %b, i64 %k
  %one = call double @{name}(double %x, double %y)
  %all.next = insertelement {_DOUBLES} %all, double %one, i64 %k
  %k.next = add i64 %k, 1
  %more = icmp slt i64 %k.next, {LANES}
  br i1 %more, label %head, label %done
done:
  ret {_DOUBLES} %all.next
}}"""
