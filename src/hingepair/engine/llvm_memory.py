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

from hingepair.engine.llvm_builder import CACHE_LINE_BYTES, LANE_COUNT, FunctionBuilder, shared_name

PREFETCH_DISTANCE_SAMPLES: Final = 2 * LANE_COUNT
"""Number of samples by which inputs are prefetched ahead: enough to cover the latency of memory."""

WIDE_OUTPUT_COMPONENTS_PER_PANEL: Final = 64
"""Number of components of a very wide output that are staged at a time."""

MAX_OUTPUT_COMPONENTS_FOR_STREAMING_STORES: Final = 512
"""Largest number of components of an output whose blocks have a stage (of 32 kB) and may be streamed."""

_LLVM_CACHE_LINE_TYPE: Final = f"<{CACHE_LINE_BYTES // 8} x i64>"  # LLVM's type of a cache line
# Parameters of a function that stores samples into an output of any strides.
_LLVM_STRIDED_OUTPUT_PARAMETERS: Final = "ptr %to, i64 %stride, i64 %step, i64 %rest"

LLVM_PARAMETER_LIST_BY_MEMORY_FUNCTION_NAME: Final = {
    "lanes": "ptr noalias %to, i64 %stride, i64 %rest",
    "gather": "ptr noalias %to, ptr noalias %which, i64 %count, ptr %row, i64 %stride, i64 %step, i64 %rest",
    "numbers": "ptr noalias %to, ptr noalias %which, i64 %count, ptr %row, i64 %step",
    "columns": "ptr noalias %to, i64 %count, ptr %row, i64 %stride",
    "scatter": f"ptr noalias %from, i64 %count, {_LLVM_STRIDED_OUTPUT_PARAMETERS}",
    "rows": "ptr noalias %frame, ptr noalias %tiles, i64 %count, ptr noalias %to, i64 %pitch, i1 %filled",
    "panels": "ptr noalias %frame, ptr noalias %tiles, i64 %count, ptr noalias %stage, "
    f"{_LLVM_STRIDED_OUTPUT_PARAMETERS}",
    "flush": "ptr noalias %stage, i64 %at, i64 %bytes, i64 %first, i1 %last",
}
"""Parameter list (LLVM IR) of each memory function, by its name; the functions return nothing.

`row` is the address of the first of eight samples, `stride` the number of bytes between samples, `step` the number of
bytes between components, `rest` the number of remaining samples including the first of these eight.
"""

# Declarations of the functions of LLVM that the functions here call.
_LLVM_DECLARATIONS_CALLED_BY_LOAD_AND_STORE_FUNCTIONS: Final = """declare void @llvm.prefetch.p0(ptr, i32, i32, i32)
declare i64 @llvm.umin.i64(i64, i64)"""


def memory_functions(float_type: str) -> list[str]:
    """Return a list of LLVM code for numbers of type "double" or "float": declarations, then the shared functions
    that load samples into vectors and store results.
    """
    makers = (
        _lanes_function,
        _gather_function,
        _numbers_function,
        _columns_function,
        _scatter_function,
        _rows_function,
        _panels_function,
        _flush_function,
    )
    return [
        _LLVM_DECLARATIONS_CALLED_BY_LOAD_AND_STORE_FUNCTIONS,
        *(make(float_type, 8 if float_type == "double" else 4) for make in makers),
    ]


def _begin_function(name: str, float_type: str) -> FunctionBuilder:
    """Return the builder of the function with this short name, one of the functions by which all kernels read and
    write memory, for numbers of type "double" or "float". The builder holds only the function's signature.
    """
    return FunctionBuilder(
        f"void {shared_name(name, float_type)}({LLVM_PARAMETER_LIST_BY_MEMORY_FUNCTION_NAME[name]})"
    )


def _lanes_function(float_type: str, _: int) -> str:
    """Return the LLVM code of the function `lanes`, which stores the byte offset of the sample in each of the lanes 1
    to 7 from the sample in lane 0. Lanes beyond the last sample get the offset 0. The second argument is not used.

    With the offset 0, these lanes repeat the first sample.
    """
    f = _begin_function("lanes", float_type)
    for k, offset in enumerate(_lane_offsets(f)):
        f.do(f"store i64 {offset}, ptr {f.pointer_at('%to', 8 * k)}, align 8")
    f.do("ret void")
    return f.text()


def _lane_offsets(f: FunctionBuilder) -> list[str]:
    """Append to the function `f` the computation of the byte offset of the sample in each of the lanes 1 to 7 from
    the sample in lane 0; the offset is 0 beyond the last sample. Return the list of the names of the offsets.
    """
    inside = [f.put(f"icmp slt i64 {k}, %rest") for k in range(1, LANE_COUNT)]
    return [f.put(f"select i1 {one}, i64 {f.multiply('%stride', k)}, i64 0") for k, one in enumerate(inside, 1)]


def _gather_function(float_type: str, number_bytes: int) -> str:
    """Return the LLVM code of the function `gather`, which loads selected components of eight samples into vectors,
    from memory of any strides.
    """
    f = _begin_function("gather", float_type)
    vector, vector_bytes = f"<{LANE_COUNT} x {float_type}>", LANE_COUNT * number_bytes

    def keep(c: str, value: str) -> None:
        f.do(f"store {vector} {value}, ptr {f.pointer_at('%to', f.multiply(c, vector_bytes))}, align {vector_bytes}")

    equal = f.put(f"or i1 {f.put('icmp eq i64 %rest, 1')}, {f.put('icmp eq i64 %stride, 0')}")
    with f.when_else(equal) as otherwise:
        with f.loop("%count") as c:
            offset = f.multiply(f.load_entry("%which", c), "%step")
            one = f.put(f"load {float_type}, ptr {f.pointer_at('%row', offset)}, align 1")
            keep(c, f.splat(vector, f"{float_type} {one}"))
        otherwise()
        full = f.put(f"icmp sge i64 %rest, {LANE_COUNT}")
        side_by_side = f.put(f"and i1 {full}, {f.put(f'icmp eq i64 %stride, {number_bytes}')}")
        with f.when_else(side_by_side) as otherwise_scattered:
            with f.loop("%count") as c:
                offset = f.multiply(f.load_entry("%which", c), "%step")
                keep(c, f.put(f"load {vector}, ptr {f.pointer_at('%row', offset)}, align 1"))
            otherwise_scattered()
            samples = ["%row", *(f.pointer_at("%row", offset) for offset in _lane_offsets(f))]
            with f.loop("%count") as c:
                offset, value = f.multiply(f.load_entry("%which", c), "%step"), "poison"
                for k, sample in enumerate(samples):
                    one = f.put(f"load {float_type}, ptr {f.pointer_at(sample, offset)}, align 1")
                    value = f.put(f"insertelement {vector} {value}, {float_type} {one}, i32 {k}")
                keep(c, value)
    f.do("ret void")
    return f.text()


def _numbers_function(float_type: str, number_bytes: int) -> str:
    """Return the LLVM code of the function `numbers`, which copies selected components of one sample into a
    contiguous array.
    """
    f = _begin_function("numbers", float_type)
    with f.loop("%count") as c:
        source = f.pointer_at("%row", f.multiply(f.load_entry("%which", c), "%step"))
        one = f.put(f"load {float_type}, ptr {source}, align 1")
        f.do(
            f"store {float_type} {one}, ptr {f.pointer_at('%to', f.multiply(c, number_bytes))}, align {number_bytes}"
        )
    f.do("ret void")
    return f.text()


def _columns_function(float_type: str, number_bytes: int) -> str:
    """Return the LLVM code of the function `columns`, which loads eight contiguous rows of eight or more components
    and stores each component as a vector of eight samples.

    Eight components are transposed at a time; the last eight overlap those before them if the count is not a
    multiple of eight.
    """
    f = _begin_function("columns", float_type)
    vector, vector_bytes = f"<{LANE_COUNT} x {float_type}>", LANE_COUNT * number_bytes
    last = f.put(f"sub i64 %count, {LANE_COUNT}")
    with f.loop("%count", step=str(LANE_COUNT)) as c:
        first = f.put(f"call i64 @llvm.umin.i64(i64 {c}, i64 {last})")
        samples = [
            f.pointer_at(f.pointer_at("%row", f.multiply(first, number_bytes)), f.multiply("%stride", k))
            for k in range(LANE_COUNT)
        ]
        ahead = f.multiply("%stride", PREFETCH_DISTANCE_SAMPLES)
        rows = []
        for sample in samples:
            f.do(f"call void @llvm.prefetch.p0(ptr {f.pointer_at(sample, ahead)}, i32 0, i32 2, i32 1)")
            rows.append(f.put(f"load {vector}, ptr {sample}, align 1"))
        target = f.pointer_at("%to", f.multiply(first, vector_bytes))
        for k, column in enumerate(f.transpose(vector, rows)):
            f.do(f"store {vector} {column}, ptr {f.pointer_at(target, vector_bytes * k)}, align {vector_bytes}")
    f.do("ret void")
    return f.text()


def _scatter_function(float_type: str, number_bytes: int) -> str:
    """Return the LLVM code of the function `scatter`, which copies up to eight contiguous rows into an output of any
    strides.
    """
    f = _begin_function("scatter", float_type)
    with f.loop(f.put(f"call i64 @llvm.umin.i64(i64 %rest, i64 {LANE_COUNT})")) as r:
        target = f.pointer_at("%to", f.multiply(r, "%stride"))
        source = f.pointer_at("%from", f.multiply(f.multiply(r, "%count"), number_bytes))
        with f.loop("%count") as c:
            one = f.put(
                f"load {float_type}, ptr {f.pointer_at(source, f.multiply(c, number_bytes))}, align {number_bytes}"
            )
            f.do(f"store {float_type} {one}, ptr {f.pointer_at(target, f.multiply(c, '%step'))}, align 1")
    f.do("ret void")
    return f.text()


def _rows_function(float_type: str, number_bytes: int) -> str:
    """Return the LLVM code of the function `rows`, which reads the vectors of components from the frame, a kernel's
    buffer of vectors, and stores them as eight rows. Its argument `pitch` is the distance [bytes] from row to row.

    Eight components (a tile) are transposed at a time. `tiles` holds the byte offset of each component's vector in
    the frame. The first offset of a tile of one constant has its bits flipped; where `filled`, the rows hold such
    constants already. The last tile overlaps the one before it if the count is not a multiple of eight.
    """
    f = _begin_function("rows", float_type)
    vector, vector_bytes = f"<{LANE_COUNT} x {float_type}>", LANE_COUNT * number_bytes
    last = f.put(f"sub i64 %count, {LANE_COUNT}")
    with f.loop("%count", step=str(LANE_COUNT)) as c:
        target = f.pointer_at("%to", f.multiply(f.put(f"call i64 @llvm.umin.i64(i64 {c}, i64 {last})"), number_bytes))
        targets = [f.pointer_at(target, f.multiply("%pitch", k)) for k in range(LANE_COUNT)]
        tile = f.pointer_at("%tiles", f.multiply(c, 4))
        lead = f.put(f"load i32, ptr {tile}, align 4")
        with f.when_else(f.put(f"icmp slt i32 {lead}, 0")) as otherwise:
            with f.when(f.put("xor i1 %filled, true")):
                offset = f.put(f"zext i32 {f.put(f'xor i32 {lead}, -1')} to i64")
                constant = f.put(f"load {vector}, ptr {f.pointer_at('%frame', offset)}, align {vector_bytes}")
                for place in targets:
                    f.do(f"store {vector} {constant}, ptr {place}, align 1")
            otherwise()
            places = [f.pointer_at("%frame", f.load_entry(tile, str(k))) for k in range(LANE_COUNT)]
            columns = [f.put(f"load {vector}, ptr {place}, align {vector_bytes}") for place in places]
            for place, row in zip(targets, f.transpose(vector, columns), strict=True):
                f.do(f"store {vector} {row}, ptr {place}, align 1")
    f.do("ret void")
    return f.text()


def _panels_function(float_type: str, number_bytes: int) -> str:
    """Return the LLVM code of the function `panels`, which stores up to eight samples of an output with very many
    components into memory of any strides. It reads 64 components at a time (up to 127 the last time) from the frame
    (the buffer in which a kernel keeps its vectors), writes them as rows into the stage (a buffer on the stack), and
    copies these rows to the output.

    The last panel may be twice as wide as the others.
    """
    f = _begin_function("panels", float_type)
    with f.loop(
        f.put(f"sub i64 %count, {WIDE_OUTPUT_COMPONENTS_PER_PANEL - 1}"), step=str(WIDE_OUTPUT_COMPONENTS_PER_PANEL)
    ) as c:
        left = f.put(f"sub i64 %count, {c}")
        is_last = f.put(f"icmp slt i64 {left}, {2 * WIDE_OUTPUT_COMPONENTS_PER_PANEL}")
        count = f.put(f"select i1 {is_last}, i64 {left}, i64 {WIDE_OUTPUT_COMPONENTS_PER_PANEL}")
        tiles, to = f.pointer_at("%tiles", f.multiply(c, 4)), f.pointer_at("%to", f.multiply(c, "%step"))
        stage = f"ptr %stage, i64 {f.multiply(count, number_bytes)}"
        f.do(f"call void {shared_name('rows', float_type)}(ptr %frame, ptr {tiles}, i64 {count}, {stage}, i1 false)")
        target = f"ptr {to}, i64 %stride, i64 %step, i64 %rest"
        f.do(f"call void {shared_name('scatter', float_type)}(ptr %stage, i64 {count}, {target})")
    f.do("ret void")
    return f.text()


def _flush_function(float_type: str, number_bytes: int) -> str:
    """Return the LLVM code of the function `flush`, which copies a block from the stage, a buffer on the stack, to
    the output by streaming stores of complete cache lines.

    The block is `bytes` bytes long and goes to the address `at`; the output begins at the address `first`. The rest
    of the block is copied in front of the stage, or written number by number if the block is the last one.
    """
    f = _begin_function("flush", float_type)
    off = f.put(f"and i64 %at, {CACHE_LINE_BYTES - 1}")
    line, stop = f.put(f"sub i64 %at, {off}"), f.put("add i64 %at, %bytes")
    complete_end = f.put(f"and i64 {stop}, -{CACHE_LINE_BYTES}")
    to = f.put("inttoptr i64 %at to ptr")

    def copy_numbers(start: str, end: str) -> None:
        with f.loop(f.put(f"sub i64 {end}, %at"), start=f.put(f"sub i64 {start}, %at"), step=str(number_bytes)) as b:
            one = f.put(f"load {float_type}, ptr {f.pointer_at('%stage', b)}, align {number_bytes}")
            f.do(f"store {float_type} {one}, ptr {f.pointer_at(to, b)}, align {number_bytes}")

    cut = f.put(f"icmp slt i64 {line}, %first")
    behind = f.put(f"add i64 {line}, {CACHE_LINE_BYTES}")
    with f.when(cut):
        copy_numbers("%first", f.put(f"call i64 @llvm.umin.i64(i64 {behind}, i64 {stop})"))
    start = f.put(f"select i1 {cut}, i64 {behind}, i64 {line}")
    with f.loop(
        f.put(f"sub i64 {complete_end}, %at"), start=f.put(f"sub i64 {start}, %at"), step=str(CACHE_LINE_BYTES)
    ) as b:
        bits = f.put(f"load {_LLVM_CACHE_LINE_TYPE}, ptr {f.pointer_at('%stage', b)}, align {number_bytes}")
        target = f.pointer_at(to, b)
        f.do(f"store {_LLVM_CACHE_LINE_TYPE} {bits}, ptr {target}, align {CACHE_LINE_BYTES}, !nontemporal !0")
    with f.when_else("%last") as otherwise:
        with f.when(f.put(f"icmp sge i64 {complete_end}, {start}")):
            copy_numbers(complete_end, stop)
        otherwise()
        end = f.pointer_at("%stage", "%bytes")
        bits = f.put(
            f"load {_LLVM_CACHE_LINE_TYPE}, ptr {f.pointer_at(end, -CACHE_LINE_BYTES)}, align {number_bytes}"
        )
        before = f.pointer_at("%stage", -CACHE_LINE_BYTES)
        f.do(f"store {_LLVM_CACHE_LINE_TYPE} {bits}, ptr {before}, align {CACHE_LINE_BYTES}")
    f.do("ret void")
    return f.text()
