"""How the compiled kernels reach memory: single numbers, blocks of LANES, and what to fetch ahead.

Imported with Numba, that is only when the first compiled kernel is asked for.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from hingepair.kernel_rows import LANES

_WIDTH = 4  # lanes shuffled at a time: of float64, a 256-bit register


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


def _store_vectors(typing_context: Any, s: Any, row: Any, address: Any) -> Any:
    """Write three rows of s as LANES vectors side by side, by shuffles."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        number, i32, i64 = context.get_data_type(s.dtype), ir.IntType(32), ir.IntType(64)
        block, scratch = ir.VectorType(number, _WIDTH), context.make_array(s)(context, builder, arguments[0])
        start = builder.inttoptr(arguments[2], number.as_pointer())

        def shuffle(a: Any, b: Any, order: list[int]) -> Any:
            return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(i32, len(order)), order))

        for k in range(0, LANES, _WIDTH):
            rows = []
            for i in range(3):
                at = builder.gep(scratch.data, [builder.add(arguments[1], ir.Constant(i64, i * LANES + k))])
                rows.append(builder.load(builder.bitcast(at, block.as_pointer()), align=s.dtype.bitwidth // 8))
            two = shuffle(rows[0], rows[1], list(range(2 * _WIDTH)))
            third = shuffle(rows[2], rows[2], [*range(_WIDTH), *range(_WIDTH)])
            mixed = shuffle(two, third, [j // 3 + _WIDTH * (j % 3) for j in range(3 * _WIDTH)])
            place = builder.gep(start, [ir.Constant(i32, 3 * k)])
            builder.store(mixed, builder.bitcast(place, mixed.type.as_pointer()), align=1)
        return context.get_dummy_value()

    return types.void(s, types.int64, types.int64), generate


def _prefetch(typing_context: Any, address: Any) -> Any:
    """Ask for the cache line at an address soon to be read; a hint, which may point past the end of an array."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer, i32 = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [pointer, i32, i32, i32])
        function = builder.module.declare_intrinsic("llvm.prefetch", (pointer,), kind)
        to_read, keep, data = (ir.Constant(i32, k) for k in (0, 3, 1))
        builder.call(function, [builder.inttoptr(arguments[0], pointer), to_read, keep, data])
        return context.get_dummy_value()

    return types.void(types.int64), generate


load: Any = intrinsic(_load)
store: Any = intrinsic(_store)
load_block: Any = intrinsic(_load_block)
store_vectors: Any = intrinsic(_store_vectors)
prefetch: Any = intrinsic(_prefetch)
