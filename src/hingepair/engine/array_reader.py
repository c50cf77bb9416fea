"""Machine code that reads the attributes of NumPy arrays directly from memory: shape, strides, dtype and address.

Reading these attributes in Python takes longer than a kernel takes for one state, and so does a call by ctypes. A
built-in function made of machine code takes a twentieth of either. It relies on the C structure of an array object,
which is part of NumPy's binary interface: data, number of axes, shape, strides, base, dtype, flags. Where the
interpreter or NumPy uses another structure, `knows_array_layout` returns False and calls go through Python.
"""

from __future__ import annotations

import ctypes
import functools
import math
import sys
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.llvm_ir import INTEGERS_PER_KERNEL_TABLE_ROW

# Offsets in bytes from the start of an object of CPython 3.11 to 3.14 with the interpreter's lock, on 64 bits.
_OBJECT_TYPE_ADDRESS_OFFSET_BYTES: Final = 8  # the address of the type of any object
_FLOAT_VALUE_OFFSET_BYTES: Final = 16  # the number of a float
_ARRAY_DATA_ADDRESS_OFFSET_BYTES: Final = 16  # the address of an array's first element
_ARRAY_RANK_OFFSET_BYTES: Final = 24  # the number of an array's axes
_ARRAY_SHAPE_ADDRESS_OFFSET_BYTES: Final = 32  # the address of an array's shape
_ARRAY_STRIDES_ADDRESS_OFFSET_BYTES: Final = 40  # the address of an array's strides
_ARRAY_DTYPE_ADDRESS_OFFSET_BYTES: Final = 56  # the address of the dtype of an array
_ARRAY_FLAGS_OFFSET_BYTES: Final = 64  # the flags of an array
_ARRAY_WRITEABLE_FLAG_MASK: Final = 0x0400  # the bit of the flags that says that an array is writable

MAX_SAMPLE_RANK_READ_BY_MACHINE_CODE: Final = 3
"""Largest number of axes of one sample; calls with arrays whose samples have more axes go through Python."""

_INTEGERS_PER_ARGUMENT_IN_CALL_DESCRIPTOR: Final = 3 + MAX_SAMPLE_RANK_READ_BY_MACHINE_CODE
"""Number of integers that describe an argument: row of the kernel's table, rank, components, lengths of axes."""

_read_pointer: Final = ctypes.c_void_p.from_address  # reads the pointer at an address


@functools.cache
def knows_array_layout() -> bool:
    """Return whether floats and NumPy arrays have the memory layout that this module reads. The first call compares a
    float and an array with the layout; the answer is cached.
    """
    if (
        sys.implementation.name != "cpython"
        or sys.byteorder != "little"
        or object.__basicsize__ != _FLOAT_VALUE_OFFSET_BYTES
    ):
        return False
    probe = np.empty((2, 3))
    pointer, integer = _read_pointer, ctypes.c_int64.from_address
    start = id(probe)
    return (
        pointer(start + _OBJECT_TYPE_ADDRESS_OFFSET_BYTES).value == id(np.ndarray)
        and pointer(start + _ARRAY_DATA_ADDRESS_OFFSET_BYTES).value == probe.ctypes.data
        and ctypes.c_int32.from_address(start + _ARRAY_RANK_OFFSET_BYTES).value == 2
        and [integer((pointer(start + _ARRAY_SHAPE_ADDRESS_OFFSET_BYTES).value or 0) + 8 * k).value for k in range(2)]
        == [2, 3]
        and [
            integer((pointer(start + _ARRAY_STRIDES_ADDRESS_OFFSET_BYTES).value or 0) + 8 * k).value for k in range(2)
        ]
        == [24, 8]
        and pointer(start + _ARRAY_DTYPE_ADDRESS_OFFSET_BYTES).value == id(probe.dtype)
        and ctypes.c_int32.from_address(start + _ARRAY_FLAGS_OFFSET_BYTES).value == probe.flags.num
        and ctypes.c_double.from_address(id(0.5) + _FLOAT_VALUE_OFFSET_BYTES).value == 0.5
        and ctypes.c_double.from_address(id(x := np.float64(0.5)) + _FLOAT_VALUE_OFFSET_BYTES).value == x
    )


def data_address(array: NDArray[Any]) -> int:
    """Return the address in memory of an array's first element, as an integer."""
    if knows_array_layout():  # `array.ctypes` takes as long as a kernel takes for 100 samples
        return _read_pointer(id(array) + _ARRAY_DATA_ADDRESS_OFFSET_BYTES).value or 0
    return int(array.ctypes.data)


def call_descriptor(
    inputs: Sequence[tuple[tuple[int, ...], int]],
    outputs: Sequence[tuple[int, ...]],
    *,
    has_constants: bool,
    kernel_address: int,
    min_unlocked_samples: int,
) -> list[int]:
    """Return the list of integers that tell the machine code of `call_ir` the address of the kernel, how many
    arguments to expect, and how each is laid out. `inputs` holds pairs (shape of one sample, index among the kernel's
    inputs, or -1 for an input that the kernel does not take), and `outputs` holds the shapes of one sample.
    `has_constants` says whether the kernel takes constants first. From `min_unlocked_samples` samples on, the machine
    code releases the interpreter's lock (GIL).

    Args:
        inputs: for each input, the shape of one sample and its index among the kernel's inputs; -1 for an input that
            the kernel does not take, which is checked too.
        outputs: for each output, the shape of one sample.
        has_constants: whether the kernel takes constants, as the first of its inputs.
        kernel_address: address of the kernel in memory.
        min_unlocked_samples: number of samples from which a call releases the interpreter's lock.
    """
    kernel_inputs = sum(place >= 0 for _, place in inputs)
    rows = [(sample_shape, place + has_constants if place >= 0 else -1) for sample_shape, place in inputs]
    rows += [(sample_shape, int(has_constants) + kernel_inputs + k) for k, sample_shape in enumerate(outputs)]
    group_count = int(has_constants) + kernel_inputs + len(outputs)
    integers = [
        kernel_address,
        len(inputs),
        len(rows),
        int(has_constants),
        group_count * INTEGERS_PER_KERNEL_TABLE_ROW,
        min_unlocked_samples,
    ]
    for sample_shape, row in rows:
        integers += [
            row,
            len(sample_shape),
            math.prod(sample_shape),
            *sample_shape,
            *(0,) * (MAX_SAMPLE_RANK_READ_BY_MACHINE_CODE - len(sample_shape)),
        ]
    return integers


_FIRST_ARGUMENT_INDEX_IN_CALL_DESCRIPTOR: Final = 6  # index of the first integer that describes an argument

# The instruction of LLVM that calls the kernel.
_LLVM_KERNEL_CALL_INSTRUCTION: Final = "call void %kernel(ptr %table, i64 1, i64 %length)"


def call_ir() -> str:
    """Return the LLVM module, as text, of the function `call`, which Python calls with arrays or floats. The function
    runs a kernel on these arguments without copying them, or does nothing if one of them is not supported; its result
    says which. The text holds addresses of Python objects and is valid in this process only.

    The function's `self` is an array of the integers of `call_descriptor`. The function takes (input, ..., output,
    ..., constants, fresh). It returns True if it has run the kernel; the number of samples if the inputs are a batch
    but the outputs have the shape of one sample; and False if an argument is not supported. Unless it returns True,
    nothing has been written. Inputs are float64 arrays with the axes of one sample, or one axis more, or floats.
    Where `fresh` is True, the outputs are new arrays, which become read-only; else the function checks that they do
    not overlap each other or an input.
    """
    return f"""
declare ptr @PyBool_FromLong(i64)
declare ptr @PyLong_FromLongLong(i64)
declare ptr @PyEval_SaveThread()
declare void @PyEval_RestoreThread(ptr)

define ptr @call(ptr %self, ptr %arguments, i64 %given) {{
entry:
  %numbers.field = getelementptr i8, ptr %self, i64 {_ARRAY_DATA_ADDRESS_OFFSET_BYTES}
  %numbers = load ptr, ptr %numbers.field
  %kernel = load ptr, ptr %numbers
  %inputs.field = getelementptr i64, ptr %numbers, i64 1
  %inputs = load i64, ptr %inputs.field
  %count.field = getelementptr i64, ptr %numbers, i64 2
  %count = load i64, ptr %count.field
  %constant.field = getelementptr i64, ptr %numbers, i64 3
  %constant = load i64, ptr %constant.field
  %fields.field = getelementptr i64, ptr %numbers, i64 4
  %fields = load i64, ptr %fields.field
  %long.field = getelementptr i64, ptr %numbers, i64 5
  %long_call = load i64, ptr %long.field
  %layouts = getelementptr i64, ptr %numbers, i64 {_FIRST_ARGUMENT_INDEX_IN_CALL_DESCRIPTOR}
  %expected = add i64 %count, 2
  %complete = icmp eq i64 %given, %expected
  br i1 %complete, label %constants, label %no
constants:
  %table = alloca i64, i64 %fields, align 64
  %ends = mul i64 %count, 2
  %extents = alloca i64, i64 %ends, align 64
  %constants.place = getelementptr ptr, ptr %arguments, i64 %count
  %constants.object = load ptr, ptr %constants.place
  %fresh.place = add i64 %count, 1
  %fresh.field = getelementptr ptr, ptr %arguments, i64 %fresh.place
  %fresh.object = load i64, ptr %fresh.field
  %fresh = icmp eq i64 %fresh.object, {id(True)}
  %no_constants = icmp eq i64 %constant, 0
  br i1 %no_constants, label %read, label %first
first:
  %constants.field = getelementptr i8, ptr %constants.object, i64 {_ARRAY_DATA_ADDRESS_OFFSET_BYTES}
  %constants.data = load i64, ptr %constants.field
  store i64 %constants.data, ptr %table
  %table1 = getelementptr i64, ptr %table, i64 1
  store i64 0, ptr %table1
  %table2 = getelementptr i64, ptr %table, i64 2
  store i64 0, ptr %table2
  %table3 = getelementptr i64, ptr %table, i64 3
  store i64 8, ptr %table3
  br label %read
read:
  %length = call i64 @read_arguments(
    ptr %arguments, ptr %layouts, i64 %inputs, i64 %count, ptr %table, ptr %extents, i1 %fresh)
  %supported = icmp sgt i64 %length, 0
  br i1 %supported, label %run, label %rest
run:
  %long = icmp sge i64 %length, %long_call
  br i1 %long, label %release, label %keep
release:
  %thread = call ptr @PyEval_SaveThread()
  {_LLVM_KERNEL_CALL_INSTRUCTION}
  call void @PyEval_RestoreThread(ptr %thread)
  br label %written
keep:
  {_LLVM_KERNEL_CALL_INSTRUCTION}
  br label %written
written:
  br i1 %fresh, label %freeze, label %yes
freeze:
  %k = phi i64 [%inputs, %written], [%k.next, %freeze]
  %array.field = getelementptr ptr, ptr %arguments, i64 %k
  %array = load ptr, ptr %array.field
  %flags.field = getelementptr i8, ptr %array, i64 {_ARRAY_FLAGS_OFFSET_BYTES}
  %flags = load i32, ptr %flags.field
  %flags.after = and i32 %flags, {~_ARRAY_WRITEABLE_FLAG_MASK}
  store i32 %flags.after, ptr %flags.field
  %k.next = add i64 %k, 1
  %k.more = icmp slt i64 %k.next, %count
  br i1 %k.more, label %freeze, label %yes
yes:
  %true = call ptr @PyBool_FromLong(i64 1)
  ret ptr %true
rest:
  %batch = icmp slt i64 %length, -1
  br i1 %batch, label %allocate, label %no
allocate:
  %samples = sub i64 -1, %length
  %number = call ptr @PyLong_FromLongLong(i64 %samples)
  ret ptr %number
no:
  %false = call ptr @PyBool_FromLong(i64 0)
  ret ptr %false
}}
{_read_arguments_ir()}"""


def _read_arguments_ir() -> str:
    """Return the LLVM code, as text, of the function `read_arguments`, which checks the arguments and writes their
    addresses and strides into a kernel's table. The text holds addresses of Python objects and is valid in this
    process only.

    The function reads the arguments in order, inputs first. It returns the number of samples (1 for a single state);
    -1 where an argument is not supported; and -1 - n where the inputs are a batch of n samples but the outputs have
    no axis for them.
    """
    return f"""
define i64 @read_arguments(
  ptr %arguments, ptr %layouts, i64 %inputs, i64 %count, ptr %table, ptr %extents, i1 %fresh
) {{
entry:
  br label %argument
argument:
  %a = phi i64 [0, %entry], [%a.next, %next]
  %length = phi i64 [1, %entry], [%length.after, %next]
  %batch = phi i64 [0, %entry], [%batch.after, %next]
  %a.more = icmp slt i64 %a, %count
  br i1 %a.more, label %look, label %read
look:
  %object.field = getelementptr ptr, ptr %arguments, i64 %a
  %object = load ptr, ptr %object.field
  %layout.place = mul i64 %a, {_INTEGERS_PER_ARGUMENT_IN_CALL_DESCRIPTOR}
  %layout = getelementptr i64, ptr %layouts, i64 %layout.place
  %row = load i64, ptr %layout
  %rank.field = getelementptr i64, ptr %layout, i64 1
  %rank = load i64, ptr %rank.field
  %components.field = getelementptr i64, ptr %layout, i64 2
  %components = load i64, ptr %components.field
  %scalar = icmp eq i64 %rank, 0
  %output = icmp sge i64 %a, %inputs
  %input = xor i1 %output, true
  %type.field = getelementptr i8, ptr %object, i64 {_OBJECT_TYPE_ADDRESS_OFFSET_BYTES}
  %type = load i64, ptr %type.field
  %is_array = icmp eq i64 %type, {id(np.ndarray)}
  br i1 %is_array, label %head, label %number
number:
  %python_float = icmp eq i64 %type, {id(float)}
  %numpy_float = icmp eq i64 %type, {id(np.float64)}
  %float = or i1 %python_float, %numpy_float
  %float_fits = and i1 %scalar, %input
  %number_fits = and i1 %float, %float_fits
  %value.field = getelementptr i8, ptr %object, i64 {_FLOAT_VALUE_OFFSET_BYTES}
  %value = ptrtoint ptr %value.field to i64
  br i1 %number_fits, label %placed, label %no
head:
  %axes.field = getelementptr i8, ptr %object, i64 {_ARRAY_RANK_OFFSET_BYTES}
  %axes.short = load i32, ptr %axes.field
  %axes = sext i32 %axes.short to i64
  %dtype.field = getelementptr i8, ptr %object, i64 {_ARRAY_DTYPE_ADDRESS_OFFSET_BYTES}
  %dtype = load i64, ptr %dtype.field
  %flags.field = getelementptr i8, ptr %object, i64 {_ARRAY_FLAGS_OFFSET_BYTES}
  %flags = load i32, ptr %flags.field
  %shape.field = getelementptr i8, ptr %object, i64 {_ARRAY_SHAPE_ADDRESS_OFFSET_BYTES}
  %shape = load ptr, ptr %shape.field
  %strides.field = getelementptr i8, ptr %object, i64 {_ARRAY_STRIDES_ADDRESS_OFFSET_BYTES}
  %strides = load ptr, ptr %strides.field
  %data.field = getelementptr i8, ptr %object, i64 {_ARRAY_DATA_ADDRESS_OFFSET_BYTES}
  %data = load i64, ptr %data.field
  %lead = sub i64 %axes, %rank
  %lead_fits = icmp ult i64 %lead, 2
  %dtype_fits = icmp eq i64 %dtype, {id(np.dtype(np.float64))}
  %head_fits = and i1 %lead_fits, %dtype_fits
  br i1 %head_fits, label %room, label %no
room:
  %other_lead = icmp ne i64 %lead, %batch
  %mismatch = and i1 %output, %other_lead
  br i1 %mismatch, label %smaller, label %writable
smaller:
  %too_small = icmp ult i64 %lead, %batch
  %wanted_length = sub i64 -1, %length
  %answer = select i1 %too_small, i64 %wanted_length, i64 -1
  ret i64 %answer
writable:
  %flag = and i32 %flags, {_ARRAY_WRITEABLE_FLAG_MASK}
  %has_flag = icmp ne i32 %flag, 0
  %writes = or i1 %has_flag, %input
  br i1 %writes, label %tail, label %no
tail:
  br i1 %scalar, label %tailed, label %last
last:
  %last.place = sub i64 %axes, 1
  %last.field = getelementptr i64, ptr %strides, i64 %last.place
  %last.step = load i64, ptr %last.field
  br label %axis
axis:
  %axis.left = phi i64 [%rank, %last], [%axis.place, %axis.fits]
  %expected = phi i64 [%last.step, %last], [%expected.next, %axis.fits]
  %axis.place = sub i64 %axis.left, 1
  %axis.own = add i64 %lead, %axis.place
  %size.field = getelementptr i64, ptr %shape, i64 %axis.own
  %size = load i64, ptr %size.field
  %step.field = getelementptr i64, ptr %strides, i64 %axis.own
  %axis.step = load i64, ptr %step.field
  %wanted.place = add i64 %axis.place, 3
  %wanted.field = getelementptr i64, ptr %layout, i64 %wanted.place
  %wanted = load i64, ptr %wanted.field
  %same_size = icmp eq i64 %size, %wanted
  %same_step = icmp eq i64 %axis.step, %expected
  %axis_fits = and i1 %same_size, %same_step
  br i1 %axis_fits, label %axis.fits, label %no
axis.fits:
  %expected.next = mul i64 %expected, %wanted
  %axis.more = icmp sgt i64 %axis.place, 0
  br i1 %axis.more, label %axis, label %tailed
tailed:
  %step = phi i64 [8, %tail], [%last.step, %axis.fits]
  %several = icmp eq i64 %lead, 1
  br i1 %several, label %samples, label %placed
samples:
  %own_length = load i64, ptr %shape
  %own_stride = load i64, ptr %strides
  %single = icmp eq i64 %own_length, 1
  %equal = icmp eq i64 %own_length, %length
  %first = icmp eq i64 %length, 1
  %broadcasts = or i1 %single, %first
  %input_broadcasts = and i1 %broadcasts, %input
  %samples_fit = or i1 %equal, %input_broadcasts
  %some = icmp ne i64 %own_length, 0
  %length_fits = and i1 %samples_fit, %some
  %longest = select i1 %single, i64 %length, i64 %own_length
  %stride.moving = select i1 %single, i64 0, i64 %own_stride
  br i1 %length_fits, label %placed, label %no
placed:
  %at = phi i64 [%value, %number], [%data, %tailed], [%data, %samples]
  %stride = phi i64 [0, %number], [0, %tailed], [%stride.moving, %samples]
  %part = phi i64 [8, %number], [%step, %tailed], [%step, %samples]
  %many = phi i64 [1, %number], [1, %tailed], [%own_length, %samples]
  %length.after = phi i64 [%length, %number], [%length, %tailed], [%longest, %samples]
  %batch.after = phi i64 [%batch, %number], [%batch, %tailed], [1, %samples]
  %many.steps = sub i64 %many, 1
  %walk = mul i64 %many.steps, %stride
  %walk.back = icmp slt i64 %walk, 0
  %walk.low = select i1 %walk.back, i64 %walk, i64 0
  %walk.high = select i1 %walk.back, i64 0, i64 %walk
  %part.steps = sub i64 %components, 1
  %reach = mul i64 %part.steps, %part
  %reach.back = icmp slt i64 %reach, 0
  %reach.low = select i1 %reach.back, i64 %reach, i64 0
  %reach.high = select i1 %reach.back, i64 0, i64 %reach
  %low.walk = add i64 %at, %walk.low
  %low = add i64 %low.walk, %reach.low
  %high.walk = add i64 %at, %walk.high
  %high.reach = add i64 %high.walk, %reach.high
  %high = add i64 %high.reach, 8
  %extent.place = mul i64 %a, 2
  %low.field = getelementptr i64, ptr %extents, i64 %extent.place
  store i64 %low, ptr %low.field
  %high.place = add i64 %extent.place, 1
  %high.field = getelementptr i64, ptr %extents, i64 %high.place
  store i64 %high, ptr %high.field
  %taken = icmp sge i64 %row, 0
  br i1 %taken, label %write, label %next
write:
  %row.place = mul i64 %row, {INTEGERS_PER_KERNEL_TABLE_ROW}
  %row.at = getelementptr i64, ptr %table, i64 %row.place
  store i64 %at, ptr %row.at
  %row.outer = getelementptr i64, ptr %row.at, i64 1
  store i64 0, ptr %row.outer
  %row.inner = getelementptr i64, ptr %row.at, i64 2
  store i64 %stride, ptr %row.inner
  %row.step = getelementptr i64, ptr %row.at, i64 3
  store i64 %part, ptr %row.step
  br label %next
next:
  %a.next = add i64 %a, 1
  br label %argument
read:
  br i1 %fresh, label %yes, label %output.each
output.each:
  %o = phi i64 [%inputs, %read], [%o.next, %output.next]
  %o.more = icmp slt i64 %o, %count
  br i1 %o.more, label %output.look, label %yes
output.look:
  %o.place = mul i64 %o, 2
  %o.low.field = getelementptr i64, ptr %extents, i64 %o.place
  %o.low = load i64, ptr %o.low.field
  %o.high.place = add i64 %o.place, 1
  %o.high.field = getelementptr i64, ptr %extents, i64 %o.high.place
  %o.high = load i64, ptr %o.high.field
  br label %beside
beside:
  %b = phi i64 [0, %output.look], [%b.next, %apart]
  %b.more = icmp slt i64 %b, %o
  br i1 %b.more, label %compare, label %output.next
compare:
  %b.place = mul i64 %b, 2
  %b.low.field = getelementptr i64, ptr %extents, i64 %b.place
  %b.low = load i64, ptr %b.low.field
  %b.high.place = add i64 %b.place, 1
  %b.high.field = getelementptr i64, ptr %extents, i64 %b.high.place
  %b.high = load i64, ptr %b.high.field
  %begins = icmp slt i64 %o.low, %b.high
  %ends = icmp slt i64 %b.low, %o.high
  %overlap = and i1 %begins, %ends
  br i1 %overlap, label %no, label %apart
apart:
  %b.next = add i64 %b, 1
  br label %beside
output.next:
  %o.next = add i64 %o, 1
  br label %output.each
yes:
  ret i64 %length
no:
  ret i64 -1
}}
"""
