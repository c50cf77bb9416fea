"""How the compiled kernels reach memory: single numbers, blocks of LANES, and what to fetch ahead.

Imported with Numba, that is only when the first compiled kernel is asked for.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from hingepair.evaluation.kernel_rows import LANES

REGISTER = 32  # bytes of a row that are shuffled at a time


def _load(typing_context: Any, like: Any, address: Any) -> Any:
    """The number at an address, of the dtype of the array `like`; it need not be aligned."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = builder.inttoptr(arguments[1], context.get_data_type(like.dtype).as_pointer())
        return builder.load(pointer, align=1)

    return like.dtype(like, types.int64), generate


def _store(typing_context: Any, like: Any, address: Any, value: Any) -> Any:
    """Write a number of the dtype of the array `like` to an address; it need not be aligned."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = builder.inttoptr(arguments[1], context.get_data_type(like.dtype).as_pointer())
        builder.store(arguments[2], pointer, align=1)
        return context.get_dummy_value()

    return types.void(like, types.int64, like.dtype), generate


def _load_block(typing_context: Any, s: Any, row: Any, address: Any) -> Any:
    """Copy LANES numbers that lie side by side into a row of s, all at once: they cannot overlap s."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        number = context.get_data_type(s.dtype)
        block = ir.VectorType(number, LANES).as_pointer()
        scratch = context.make_array(s)(context, builder, arguments[0])
        target = builder.bitcast(builder.gep(scratch.data, [arguments[1]]), block)
        builder.store(
            builder.load(builder.inttoptr(arguments[2], block), align=1), target, align=s.dtype.bitwidth // 8
        )
        return context.get_dummy_value()

    return types.void(s, types.int64, types.int64), generate


def _store_side_by_side(rows: int, past: bool) -> Any:
    """A function that writes a register's worth of lanes of so many rows: pairs, vectors or matrices side by side.

    Past the caches it writes 16 bytes at a time, to an address that is a multiple of them.
    """

    def typed(typing_context: Any, s: Any, row: Any, address: Any) -> Any:
        size = s.dtype.bitwidth // 8
        width = REGISTER // size

        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            number, i32, i64 = context.get_data_type(s.dtype), ir.IntType(32), ir.IntType(64)
            scratch = context.make_array(s)(context, builder, arguments[0])

            def lanes(i: int) -> Any:
                at = builder.gep(scratch.data, [builder.add(arguments[1], ir.Constant(i64, i * LANES))])
                return builder.load(builder.bitcast(at, ir.VectorType(number, width).as_pointer()), align=size)

            def shuffle(a: Any, b: Any, order: list[int]) -> Any:
                return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(i32, len(order)), order))

            joined, length = [lanes(i) for i in range(rows)], width
            while len(joined) > 1:
                joined += [joined[-1]] * (len(joined) % 2)
                pairs = zip(joined[::2], joined[1::2], strict=True)
                joined, length = [shuffle(a, b, list(range(2 * length))) for a, b in pairs], 2 * length
            order = [j // rows + width * (j % rows) for j in range(rows * width)]
            mixed = shuffle(joined[0], joined[0], order)
            if not past:
                builder.store(mixed, builder.inttoptr(arguments[2], mixed.type.as_pointer()), align=1)
                return context.get_dummy_value()
            start, piece = builder.inttoptr(arguments[2], number.as_pointer()), 16 // size
            for j in range(0, rows * width, piece):
                part = shuffle(mixed, mixed, list(range(j, j + piece)))
                at = builder.bitcast(builder.gep(start, [ir.Constant(i32, j)]), part.type.as_pointer())
                written = builder.store(part, at, align=16)
                written.set_metadata("nontemporal", builder.module.add_metadata([ir.Constant(i32, 1)]))
            return context.get_dummy_value()

        return types.void(s, types.int64, types.int64), generate

    return typed


def _prefetch(typing_context: Any, address: Any) -> Any:
    """Ask for the cache line at an address soon to be read; a hint, which may point past the end of an array."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer, i32 = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [pointer, i32, i32, i32])
        function = builder.module.declare_intrinsic("llvm.prefetch", (pointer,), kind)
        to_read, keep, data = (ir.Constant(i32, k) for k in (0, 2, 1))
        builder.call(function, [builder.inttoptr(arguments[0], pointer), to_read, keep, data])
        return context.get_dummy_value()

    return types.void(types.int64), generate


def _fence(typing_context: Any) -> Any:
    """What was written past the caches is there for every thread from here on."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.fence("seq_cst")
        return context.get_dummy_value()

    return types.void(), generate


load: Any = intrinsic(_load)
store: Any = intrinsic(_store)
load_block: Any = intrinsic(_load_block)
fence: Any = intrinsic(_fence)
store_pairs: Any = intrinsic(_store_side_by_side(2, past=False))
store_vectors: Any = intrinsic(_store_side_by_side(3, past=False))
store_matrices: Any = intrinsic(_store_side_by_side(9, past=False))
store_pairs_past: Any = intrinsic(_store_side_by_side(2, past=True))
store_vectors_past: Any = intrinsic(_store_side_by_side(3, past=True))
store_matrices_past: Any = intrinsic(_store_side_by_side(9, past=True))
prefetch: Any = intrinsic(_prefetch)
