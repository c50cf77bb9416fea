"""LLVM functions that all kernels share: they bring samples into vectors, and results to where they are wanted.

A vector holds one component of eight samples. Results leave a block of eight samples as rows, sample after sample:
straight into the output; or into a stage, memory of the kernel's own, from which they are scattered, or streamed.
A stream writes whole cache lines past the caches wherever the output starts: what is left of a line stays in front of
the stage until the next block fills it. Only the first and the last line of an output are written number by number,
so that no byte beside the output is touched. A block is streamed just before the next one takes its place: lines that
were stored a moment ago could not be loaded without waiting for them.
"""

from __future__ import annotations

from typing import Final

from hingepair.engine.llvm_writer import LANES, LINE, Function, shared_name

PREFETCH_DISTANCE: Final = 2 * LANES
"""Samples from the one being computed to the one whose inputs are asked for: longer than memory takes to answer."""

PANEL: Final = 64
"""Components of very wide outputs that are staged at a time."""

MAX_STREAMED: Final = 512
"""Number of components up to which a block of an output has a stage for itself, of 32 kB, and may be streamed."""

_LINE_TYPE: Final = f"<{LINE // 8} x i64>"
_OUTPUT: Final = "ptr %to, i64 %stride, i64 %step, i64 %rest"

MEMORY_PARAMETERS: Final = {
    "lanes": "ptr noalias %to, i64 %stride, i64 %rest",
    "gather": "ptr noalias %to, ptr noalias %which, i64 %count, ptr %row, i64 %stride, i64 %step, i64 %rest",
    "numbers": "ptr noalias %to, ptr noalias %which, i64 %count, ptr %row, i64 %step",
    "columns": "ptr noalias %to, i64 %count, ptr %row, i64 %stride",
    "scatter": f"ptr noalias %from, i64 %count, {_OUTPUT}",
    "rows": "ptr noalias %frame, ptr noalias %tiles, i64 %count, ptr noalias %to, i64 %pitch, i1 %filled",
    "panels": f"ptr noalias %frame, ptr noalias %tiles, i64 %count, ptr noalias %stage, {_OUTPUT}",
    "flush": "ptr noalias %stage, i64 %at, i64 %bytes, i64 %first, i1 %last",
}
"""Parameters of the functions by name; they return nothing.

`row` is the first of eight samples, `stride` the bytes between samples, `step` those between components, `rest` the
number of samples that are left, this one included.
"""

_DECLARED: Final = """declare void @llvm.prefetch.p0(ptr, i32, i32, i32)
declare i64 @llvm.umin.i64(i64, i64)"""


def memory_functions(number: str) -> list[str]:
    """Return the functions for numbers of a type, "double" or "float"."""
    makers = (_lanes, _gather, _numbers, _columns, _scatter, _rows, _panels, _flush)
    return [_DECLARED, *(make(number, 8 if number == "double" else 4) for make in makers)]


def _begin(name: str, number: str) -> Function:
    return Function(f"void {shared_name(name, number)}({MEMORY_PARAMETERS[name]})")


def _lanes(number: str, _: int) -> str:
    """Write `lanes`: write down how far behind the first sample those of the other lanes are.

    Lanes behind the last sample repeat the first.
    """
    f = _begin("lanes", number)
    for k, offset in enumerate(_lane_offsets(f)):
        f.do(f"store i64 {offset}, ptr {f.step('%to', 8 * k)}, align 8")
    f.do("ret void")
    return f.text()


def _lane_offsets(f: Function) -> list[str]:
    """Write the distances of the samples of all lanes but the first from that of the first."""
    inside = [f.put(f"icmp slt i64 {k}, %rest") for k in range(1, LANES)]
    return [f.put(f"select i1 {one}, i64 {f.product('%stride', k)}, i64 0") for k, one in enumerate(inside, 1)]


def _gather(number: str, size: int) -> str:
    """Write `gather`: load components of eight samples, whose numbers stand in `which`, into vectors."""
    f = _begin("gather", number)
    vector = f"<{LANES} x {number}>"

    def keep(c: str, value: str) -> None:
        f.do(f"store {vector} {value}, ptr {f.step('%to', f.product(c, LANES * size))}, align {LANES * size}")

    equal = f.put(f"or i1 {f.put('icmp eq i64 %rest, 1')}, {f.put('icmp eq i64 %stride, 0')}")
    with f.choose(equal) as otherwise:
        with f.loop("%count") as c:
            offset = f.product(f.entry("%which", c), "%step")
            one = f.put(f"load {number}, ptr {f.step('%row', offset)}, align 1")
            keep(c, f.splat(vector, f"{number} {one}"))
        otherwise()
        samples = ["%row", *(f.step("%row", offset) for offset in _lane_offsets(f))]
        with f.loop("%count") as c:
            offset, value = f.product(f.entry("%which", c), "%step"), "poison"
            for k, sample in enumerate(samples):
                one = f.put(f"load {number}, ptr {f.step(sample, offset)}, align 1")
                value = f.put(f"insertelement {vector} {value}, {number} {one}, i32 {k}")
            keep(c, value)
    f.do("ret void")
    return f.text()


def _numbers(number: str, size: int) -> str:
    """Write `numbers`: copy components of a sample, whose numbers stand in `which`, one behind the other."""
    f = _begin("numbers", number)
    with f.loop("%count") as c:
        source = f.step("%row", f.product(f.entry("%which", c), "%step"))
        one = f.put(f"load {number}, ptr {source}, align 1")
        f.do(f"store {number} {one}, ptr {f.step('%to', f.product(c, size))}, align {size}")
    f.do("ret void")
    return f.text()


def _columns(number: str, size: int) -> str:
    """Write `columns`: load eight rows of at least eight components, side by side, into vectors.

    Eight components are transposed at a time; the last eight overlap those before them where the count is no
    multiple of eight.
    """
    f = _begin("columns", number)
    vector = f"<{LANES} x {number}>"
    last = f.put(f"sub i64 %count, {LANES}")
    with f.loop("%count", step=str(LANES)) as c:
        first = f.put(f"call i64 @llvm.umin.i64(i64 {c}, i64 {last})")
        samples = [f.step(f.step("%row", f.product(first, size)), f.product("%stride", k)) for k in range(LANES)]
        ahead = f.product("%stride", PREFETCH_DISTANCE)
        rows = []
        for sample in samples:
            f.do(f"call void @llvm.prefetch.p0(ptr {f.step(sample, ahead)}, i32 0, i32 2, i32 1)")
            rows.append(f.put(f"load {vector}, ptr {sample}, align 1"))
        target = f.step("%to", f.product(first, LANES * size))
        for k, column in enumerate(f.transpose(vector, rows)):
            f.do(f"store {vector} {column}, ptr {f.step(target, LANES * size * k)}, align {LANES * size}")
    f.do("ret void")
    return f.text()


def _scatter(number: str, size: int) -> str:
    """Write `scatter`: copy rows that lie one behind the other to an output of any strides."""
    f = _begin("scatter", number)
    with f.loop(f.put(f"call i64 @llvm.umin.i64(i64 %rest, i64 {LANES})")) as r:
        target = f.step("%to", f.product(r, "%stride"))
        source = f.step("%from", f.product(f.product(r, "%count"), size))
        with f.loop("%count") as c:
            one = f.put(f"load {number}, ptr {f.step(source, f.product(c, size))}, align {size}")
            f.do(f"store {number} {one}, ptr {f.step(target, f.product(c, '%step'))}, align 1")
    f.do("ret void")
    return f.text()


def _rows(number: str, size: int) -> str:
    """Write `rows`: store eight rows of at least eight components, so many bytes apart as `pitch` says.

    Eight components are transposed at a time. How far into the frame their vectors are stands in `tiles`; of eight
    that are one constant, the bits of the first number are flipped; where `filled`, they stand in the rows already.
    The last eight overlap those before them where the count is no multiple of eight.
    """
    f = _begin("rows", number)
    vector = f"<{LANES} x {number}>"
    last = f.put(f"sub i64 %count, {LANES}")
    with f.loop("%count", step=str(LANES)) as c:
        target = f.step("%to", f.product(f.put(f"call i64 @llvm.umin.i64(i64 {c}, i64 {last})"), size))
        targets = [f.step(target, f.product("%pitch", k)) for k in range(LANES)]
        tile = f.step("%tiles", f.product(c, 4))
        lead = f.put(f"load i32, ptr {tile}, align 4")
        with f.choose(f.put(f"icmp slt i32 {lead}, 0")) as otherwise:
            with f.when(f.put("xor i1 %filled, true")):
                offset = f.put(f"zext i32 {f.put(f'xor i32 {lead}, -1')} to i64")
                constant = f.put(f"load {vector}, ptr {f.step('%frame', offset)}, align {LANES * size}")
                for place in targets:
                    f.do(f"store {vector} {constant}, ptr {place}, align 1")
            otherwise()
            places = [f.step("%frame", f.entry(tile, str(k))) for k in range(LANES)]
            columns = [f.put(f"load {vector}, ptr {place}, align {LANES * size}") for place in places]
            for place, row in zip(targets, f.transpose(vector, columns), strict=True):
                f.do(f"store {vector} {row}, ptr {place}, align 1")
    f.do("ret void")
    return f.text()


def _panels(number: str, size: int) -> str:
    """Write `panels`: scatter rows of many components, panel by panel; the last is up to twice as wide."""
    f = _begin("panels", number)
    with f.loop(f.put(f"sub i64 %count, {PANEL - 1}"), step=str(PANEL)) as c:
        left = f.put(f"sub i64 %count, {c}")
        count = f.put(f"select i1 {f.put(f'icmp slt i64 {left}, {2 * PANEL}')}, i64 {left}, i64 {PANEL}")
        tiles, to = f.step("%tiles", f.product(c, 4)), f.step("%to", f.product(c, "%step"))
        stage = f"ptr %stage, i64 {f.product(count, size)}"
        f.do(f"call void {shared_name('rows', number)}(ptr %frame, ptr {tiles}, i64 {count}, {stage}, i1 false)")
        target = f"ptr {to}, i64 %stride, i64 %step, i64 %rest"
        f.do(f"call void {shared_name('scatter', number)}(ptr %stage, i64 {count}, {target})")
    f.do("ret void")
    return f.text()


def _flush(number: str, size: int) -> str:
    """Write `flush`: stream a block of `bytes` bytes from its stage to the address `at`.

    Whole lines are written; what is left behind them is carried to the line in front of the stage, or written number
    by number where the block is the last one. The output begins at the address `first`.
    """
    f = _begin("flush", number)
    off = f.put(f"and i64 %at, {LINE - 1}")
    line, stop = f.put(f"sub i64 %at, {off}"), f.put("add i64 %at, %bytes")
    whole = f.put(f"and i64 {stop}, -{LINE}")
    to = f.put("inttoptr i64 %at to ptr")

    def copy_numbers(start: str, end: str) -> None:
        with f.loop(f.put(f"sub i64 {end}, %at"), start=f.put(f"sub i64 {start}, %at"), step=str(size)) as b:
            one = f.put(f"load {number}, ptr {f.step('%stage', b)}, align {size}")
            f.do(f"store {number} {one}, ptr {f.step(to, b)}, align {size}")

    cut = f.put(f"icmp slt i64 {line}, %first")
    behind = f.put(f"add i64 {line}, {LINE}")
    with f.when(cut):
        copy_numbers("%first", f.put(f"call i64 @llvm.umin.i64(i64 {behind}, i64 {stop})"))
    start = f.put(f"select i1 {cut}, i64 {behind}, i64 {line}")
    with f.loop(f.put(f"sub i64 {whole}, %at"), start=f.put(f"sub i64 {start}, %at"), step=str(LINE)) as b:
        bits = f.put(f"load {_LINE_TYPE}, ptr {f.step('%stage', b)}, align {size}")
        f.do(f"store {_LINE_TYPE} {bits}, ptr {f.step(to, b)}, align {LINE}, !nontemporal !0")
    with f.choose("%last") as otherwise:
        with f.when(f.put(f"icmp sge i64 {whole}, {start}")):
            copy_numbers(whole, stop)
        otherwise()
        end = f.step("%stage", "%bytes")
        bits = f.put(f"load {_LINE_TYPE}, ptr {f.step(end, -LINE)}, align {size}")
        f.do(f"store {_LINE_TYPE} {bits}, ptr {f.step('%stage', -LINE)}, align {LINE}")
    f.do("ret void")
    return f.text()
