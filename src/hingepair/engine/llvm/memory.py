"""LLVM functions that all kernels share: loads of samples into vectors, and stores of results into the outputs.

A vector holds one component of eight samples. The results of a block of eight samples are stored as rows, sample
after sample: directly into the output; or into a stage, a small buffer of the kernel, from which they are scattered
(to outputs of any strides) or streamed (by non-temporal stores, past the caches).

A stream writes whole cache lines wherever the output starts: the rest of a line stays in front of the stage until the
next block fills the line. Only the first and the last line of an output are written number by number, so that no byte
beside the output is touched. A block is streamed just before the next block takes its place in the stage: lines that
have just been stored could not be loaded without a stall.
"""

from __future__ import annotations

from typing import Final

from hingepair.engine.llvm.builder import CACHE_LINE, LANES, NUMBER_BYTES, FunctionBuilder, shared_name

PREFETCH_SAMPLES: Final = 2 * LANES  # that inputs are prefetched ahead: covers the latency of memory
MAX_STREAMED: Final = 512  # most components of an output that is stored past the caches: its stage has 32 kB

_LINE: Final = f"<{CACHE_LINE // 8} x i64>"  # LLVM's type of a cache line, which is copied as a whole
_TARGET: Final = "ptr %to, i64 %stride, i64 %step, i64 %rest"  # parameters that say where samples go
MEMORY_FUNCTIONS: Final = {
    "gather": "ptr noalias %to, ptr noalias %which, i64 %count, ptr %row, i64 %stride, i64 %step, i64 %rest",
    "scatter": f"ptr noalias %from, i64 %count, {_TARGET}",
    "rows": "ptr noalias %frame, ptr noalias %tiles, i64 %count, ptr noalias %to, i64 %pitch, i1 %filled",
    "flush": "ptr noalias %stage, i64 %at, i64 %bytes, i64 %first, i1 %last",
}
"""Parameters of the functions by name: `row` is the address of the first of eight samples, `stride` the bytes between
samples, `step` those between components, and `rest` the number of samples that are left, these eight included."""


def memory_functions(float_type: str) -> list[str]:
    """Return LLVM code of the functions for numbers of type "double" or "float"."""
    makers = (_gather, _scatter, _rows, _flush)
    declared = "declare i64 @llvm.umin.i64(i64, i64)"
    return [declared, *(make(float_type, NUMBER_BYTES[float_type]) for make in makers)]


def _begin(name: str, float_type: str) -> FunctionBuilder:
    return FunctionBuilder(f"void {shared_name(name, float_type)}({MEMORY_FUNCTIONS[name]})")


def _lane_offsets(f: FunctionBuilder) -> list[str]:
    """Compute the byte offsets of lanes 1 to 7; 0 beyond the last sample, where the first is repeated."""
    inside = [f.put(f"icmp slt i64 {k}, %rest") for k in range(1, LANES)]
    return [f.put(f"select i1 {one}, i64 {f.multiply('%stride', k)}, i64 0") for k, one in enumerate(inside, 1)]


def _gather(float_type: str, number_bytes: int) -> str:
    """Return the function `gather`, which loads selected components of eight samples of any strides into vectors."""
    f = _begin("gather", float_type)
    vector, vector_bytes = f"<{LANES} x {float_type}>", LANES * number_bytes

    def keep(c: str, value: str) -> None:
        f.do(f"store {vector} {value}, ptr {f.pointer_at('%to', f.multiply(c, vector_bytes))}, align {vector_bytes}")

    equal = f.put(f"or i1 {f.put('icmp eq i64 %rest, 1')}, {f.put('icmp eq i64 %stride, 0')}")
    with f.when_else(equal) as otherwise:
        with f.loop("%count") as c:
            offset = f.multiply(f.load_entry("%which", c), "%step")
            one = f.put(f"load {float_type}, ptr {f.pointer_at('%row', offset)}, align 1")
            keep(c, f.splat(vector, f"{float_type} {one}"))
        otherwise()
        samples = ["%row", *(f.pointer_at("%row", offset) for offset in _lane_offsets(f))]
        with f.loop("%count") as c:
            offset, value = f.multiply(f.load_entry("%which", c), "%step"), "poison"
            for k, sample in enumerate(samples):
                one = f.put(f"load {float_type}, ptr {f.pointer_at(sample, offset)}, align 1")
                value = f.put(f"insertelement {vector} {value}, {float_type} {one}, i32 {k}")
            keep(c, value)
    f.do("ret void")
    return f.text()


def _scatter(float_type: str, number_bytes: int) -> str:
    """Return the function `scatter`, which copies up to eight contiguous rows into an output of any strides."""
    f = _begin("scatter", float_type)
    with f.loop(f.put(f"call i64 @llvm.umin.i64(i64 %rest, i64 {LANES})")) as r:
        target = f.pointer_at("%to", f.multiply(r, "%stride"))
        source = f.pointer_at("%from", f.multiply(f.multiply(r, "%count"), number_bytes))
        with f.loop("%count") as c:
            place = f.pointer_at(source, f.multiply(c, number_bytes))
            one = f.put(f"load {float_type}, ptr {place}, align {number_bytes}")
            f.do(f"store {float_type} {one}, ptr {f.pointer_at(target, f.multiply(c, '%step'))}, align 1")
    f.do("ret void")
    return f.text()


def _rows(float_type: str, number_bytes: int) -> str:
    """Return the function `rows`, which stores vectors of components of the frame as eight rows, `pitch` bytes apart.

    Eight components (a tile) are transposed at a time. `tiles` holds the byte offset of each component's vector in
    the frame. The first offset of a tile of one constant has its bits flipped; where `filled`, the rows hold such
    constants already. The last tile overlaps the one before if need be.
    """
    f = _begin("rows", float_type)
    vector, vector_bytes = f"<{LANES} x {float_type}>", LANES * number_bytes
    last = f.put(f"sub i64 %count, {LANES}")
    with f.loop("%count", step=str(LANES)) as c:
        target = f.pointer_at("%to", f.multiply(f.put(f"call i64 @llvm.umin.i64(i64 {c}, i64 {last})"), number_bytes))
        targets = [f.pointer_at(target, f.multiply("%pitch", k)) for k in range(LANES)]
        tile = f.pointer_at("%tiles", f.multiply(c, 4))
        lead = f.put(f"load i32, ptr {tile}, align 4")
        with f.when_else(f.put(f"icmp slt i32 {lead}, 0")) as otherwise:
            with f.when(f.put("xor i1 %filled, true")):
                offset = f.put(f"zext i32 {f.put(f'xor i32 {lead}, -1')} to i64")
                constant = f.put(f"load {vector}, ptr {f.pointer_at('%frame', offset)}, align {vector_bytes}")
                for place in targets:
                    f.do(f"store {vector} {constant}, ptr {place}, align 1")
            otherwise()
            places = [f.pointer_at("%frame", f.load_entry(tile, str(k))) for k in range(LANES)]
            columns = [f.put(f"load {vector}, ptr {place}, align {vector_bytes}") for place in places]
            for place, row in zip(targets, f.transpose(vector, columns), strict=True):
                f.do(f"store {vector} {row}, ptr {place}, align 1")
    f.do("ret void")
    return f.text()


def _flush(float_type: str, number_bytes: int) -> str:
    """Return the function `flush`, which streams a block from the stage to the address `at`, `bytes` long, in
    complete cache lines; the output begins at the address `first`. What is left of the block is copied in front of
    the stage, or written number by number if the block is the last one.
    """
    f = _begin("flush", float_type)
    off = f.put(f"and i64 %at, {CACHE_LINE - 1}")
    line, stop = f.put(f"sub i64 %at, {off}"), f.put("add i64 %at, %bytes")
    complete = f.put(f"and i64 {stop}, -{CACHE_LINE}")  # end of the complete lines
    to = f.put("inttoptr i64 %at to ptr")

    def copy_numbers(start: str, end: str) -> None:
        with f.loop(f.put(f"sub i64 {end}, %at"), start=f.put(f"sub i64 {start}, %at"), step=str(number_bytes)) as b:
            one = f.put(f"load {float_type}, ptr {f.pointer_at('%stage', b)}, align {number_bytes}")
            f.do(f"store {float_type} {one}, ptr {f.pointer_at(to, b)}, align {number_bytes}")

    cut = f.put(f"icmp slt i64 {line}, %first")
    behind = f.put(f"add i64 {line}, {CACHE_LINE}")
    with f.when(cut):
        copy_numbers("%first", f.put(f"call i64 @llvm.umin.i64(i64 {behind}, i64 {stop})"))
    start = f.put(f"select i1 {cut}, i64 {behind}, i64 {line}")
    begin, end = f.put(f"sub i64 {start}, %at"), f.put(f"sub i64 {complete}, %at")
    with f.loop(end, start=begin, step=str(CACHE_LINE)) as b:
        bits = f.put(f"load {_LINE}, ptr {f.pointer_at('%stage', b)}, align {number_bytes}")
        f.do(f"store {_LINE} {bits}, ptr {f.pointer_at(to, b)}, align {CACHE_LINE}, !nontemporal !0")
    with f.when_else("%last") as otherwise:
        with f.when(f.put(f"icmp sge i64 {complete}, {start}")):
            copy_numbers(complete, stop)
        otherwise()
        stage_end = f.pointer_at("%stage", "%bytes")
        bits = f.put(f"load {_LINE}, ptr {f.pointer_at(stage_end, -CACHE_LINE)}, align {number_bytes}")
        f.do(f"store {_LINE} {bits}, ptr {f.pointer_at('%stage', -CACHE_LINE)}, align {CACHE_LINE}")
    f.do("ret void")
    return f.text()
