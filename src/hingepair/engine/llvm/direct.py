"""Calls of a kernel without NumPy's ufunc, which takes longer for one state than the kernel.

Python calls two functions of machine code that stand beside the kernel, and look at arrays of NumPy as these lie in
memory. They compute samples in contiguous arrays that need no conversion, of which some may be single samples:

    make(q, qd)       returns a tuple of new arrays
    fill(q, qd, tau)  writes the outputs into arrays that share no memory with others

Whatever else they are given, they return None, and have written nothing.
"""

from __future__ import annotations

import ctypes
import functools
import math
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.engine.llvm.builder import NUMBER_BYTES, FunctionBuilder
from hingepair.engine.llvm.kernels import TYPE_NUMBERS, Code, Layout, begin_table, numpy_function, store_row
from hingepair.numeric.arrays import MAX_AXES

# Offsets [bytes] in an object of Python and in an array of NumPy; `_offsets_are_known` checks them.
_TYPE, _DATA, _AXES, _SIZES, _DTYPE, _FLAGS = 8, 16, 24, 32, 56, 64
_READABLE, _WRITABLE = 0x101, 0x501  # flags: contiguous, aligned and, for outputs, writeable
_WRITEABLE: Final = 0x400
# Words that the functions find in the array which is their `self`.
_WORDS: Final = ("PyArray_New", "PyTuple_New", "PyTuple_SetItem", "Py_IncRef", "Py_DecRef", "PyErr_Clear",
                 "PyEval_SaveThread", "PyEval_RestoreThread",
                 "none", "dtype", "number", "constants", "most", "flags")  # fmt: skip
_NEW_ARRAY: Final = 93  # entry of NumPy's table of functions, frozen in its ABI: PyArray_New
_LONG: Final = 1_000  # samples from which on other threads of Python go on meanwhile
_POSITIONAL: Final = 0x80  # METH_FASTCALL


class Direct(NamedTuple):
    """The two functions of a kernel, which own all that they need."""

    make: Callable[..., Any]
    fill: Callable[..., Any]


class _Method(ctypes.Structure):
    """PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("address", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


def direct_calls(code: Code, char: str, most: int, freeze: bool) -> Direct:
    """Return the functions of a kernel; where this interpreter or NumPy lays out arrays in another way, functions
    that compute nothing.

    Args:
        code: the kernel.
        char: character of its dtype.
        most: samples for which `make` makes arrays, at most.
        freeze: whether new arrays are read-only.
    """
    new_array = numpy_function("_ARRAY_API", _NEW_ARRAY)
    if not new_array or not _offsets_are_known():
        return Direct(lambda *_: None, lambda *_: None)
    values = {
        "PyArray_New": new_array, "none": id(None), "dtype": id(np.dtype(char)), "number": TYPE_NUMBERS[char],
        "constants": code.constants.ctypes.data, "flags": ~_WRITEABLE if freeze else -1,
    }  # fmt: skip
    create = ctypes.pythonapi.PyCFunction_NewEx
    create.restype, create.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.py_object, ctypes.py_object)
    made = []
    for name, limit in (("make", most), ("fill", 2**62)):
        values["most"] = limit
        words = np.array([values[one] if one in values else _python_function(one) for one in _WORDS], np.int64)
        method = _Method(name.encode(), code.kernel.address(name), _POSITIONAL, None)
        made.append(create(ctypes.addressof(method), words, (code, method)))
    return Direct(*made)


def _python_function(name: str) -> int:
    return ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value or 0


@functools.cache
def _offsets_are_known() -> bool:
    """Return whether an array lies in memory as the functions read it."""
    array = np.zeros((2, 3))

    def read(kind: Any, place: int) -> int:
        return int(kind.from_address(place).value)

    word, half, at = ctypes.c_size_t, ctypes.c_int32, id(array)
    if np.ndarray.__basicsize__ < _FLAGS + 8 or read(word, at + _TYPE) != id(np.ndarray):
        return False
    return (
        read(word, at + _DATA) == array.ctypes.data
        and read(half, at + _AXES) == 2
        and [read(word, read(word, at + _SIZES) + 8 * k) for k in range(2)] == [2, 3]
        and read(word, at + _DTYPE) == id(array.dtype)
        and read(half, at + _FLAGS) == array.flags.num
    )


def direct_ir(layout: Layout, float_type: str) -> str:
    """Return the LLVM code of `make` and `fill`, which call the function `kernel` of the same module."""
    return "\n\n".join(_Entry(layout, NUMBER_BYTES[float_type], fills).text() for fills in (False, True)) + "\n"


class _Entry:
    """Builder of one of the functions, as Python calls it: with its `self`, the arguments and their number.

    Args:
        layout: the arrays.
        number_bytes: size of a number.
        fills: whether arrays for the outputs stand behind the arguments.
    """

    def __init__(self, layout: Layout, number_bytes: int, fills: bool) -> None:
        self.layout, self.number_bytes, self.fills = layout, number_bytes, fills
        self.given = layout.operands if fills else layout.inputs
        self.bytes = [number_bytes * math.prod(one.sample_shape) for one in layout.operands]
        f = self.f = FunctionBuilder(f"ptr @{'fill' if fills else 'make'}(ptr %self, ptr %args, i64 %count)")
        words = f.load_word("%self", _DATA, "ptr")
        self.words = {name: f.load_word(words, 8 * k) for k, name in enumerate(_WORDS)}
        self.pointers = {name: f.put(f"inttoptr i64 {word} to ptr") for name, word in self.words.items()}
        self.table = begin_table(f, layout, self.pointers["constants"], number_bytes)
        self.result, self.samples, self.fitting = f.buffer(8), f.buffer(8), f.buffer(8)
        for place, value in ((self.result, 0), (self.samples, 1), (self.fitting, 1)):
            f.store_word(value, place)

    def text(self) -> str:
        """Return the function."""
        f = self.f
        with ExitStack() as self.fits:
            self.check_arrays()
            self.check_shapes()
            if self.fills:
                self.check_memory()
            self.compute()
        with f.when(f.put(f"icmp eq i64 {f.load_word(self.result, 0)}, 0")):
            f.do(f"call void {self.pointers['PyErr_Clear']}()")  # of memory that there was not
            f.do(f"call void {self.pointers['Py_IncRef']}(ptr {self.pointers['none']})")
            f.store_word(self.words["none"], self.result)
        f.do(f"ret ptr {f.load_word(self.result, 0, 'ptr')}")
        return f.text()

    def require(self, *conditions: str) -> None:
        """Leave the function if a condition does not hold."""
        self.fits.enter_context(self.f.when(self.all_of(conditions)))

    def all_of(self, conditions: Iterable[str]) -> str:
        return functools.reduce(lambda x, y: self.f.put(f"and i1 {x}, {y}"), conditions, "true")

    def combine(self, place: str, operation: str, value: str) -> None:
        """Combine an integer with the one that a buffer holds."""
        self.f.do(
            f"store i64 {self.f.put(f'{operation} i64 {self.f.load_word(place, 0)}, {value}')}, ptr {place}, align 8"
        )

    def check_arrays(self) -> None:
        """Require contiguous arrays of the dtype, with the axes of one sample, alone or behind as many others as the
        first argument has.
        """
        f = self.f
        self.require(f.put(f"icmp eq i64 %count, {len(self.given)}"))
        self.arrays = [f.load_word("%args", 8 * k, "ptr") for k in range(len(self.given))]
        self.kind = f.load_word("%self", _TYPE, "ptr")  # an array of NumPy, too
        self.require(*(f.put(f"icmp eq ptr {f.load_word(x, _TYPE, 'ptr')}, {self.kind}") for x in self.arrays))
        axes = [f.put(f"sext i32 {f.load_half(x, _AXES)} to i64") for x in self.arrays]
        self.leads = [f.put(f"sub i64 {n}, {len(x.sample_shape)}") for n, x in zip(axes, self.given, strict=True)]
        self.lead, self.single = self.leads[0], list[str]()  # number of leading axes; whether it is one sample
        conditions = [f.put(f"icmp ult i64 {self.lead}, {MAX_AXES}")]
        for k, x in enumerate(self.arrays):
            is_input = k < len(self.layout.inputs)
            flags = _READABLE if is_input else _WRITABLE
            conditions.append(f.put(f"icmp eq ptr {f.load_word(x, _DTYPE, 'ptr')}, {self.pointers['dtype']}"))
            conditions.append(f.put(f"icmp eq i32 {f.put(f'and i32 {f.load_half(x, _FLAGS)}, {flags}')}, {flags}"))
            self.single.append(f.put(f"icmp eq i64 {self.leads[k]}, 0") if is_input else "false")
            alike = f.put(f"icmp eq i64 {self.leads[k]}, {self.lead}")
            conditions.append(f.put(f"or i1 {self.single[k]}, {alike}"))
        self.require(*conditions)

    def check_shapes(self) -> None:
        """Require the shapes of one sample and equal leading shapes, of few samples; keep the leading shape."""
        f, conditions = self.f, []
        shapes = [f.load_word(x, _SIZES, "ptr") for x in self.arrays]
        for shape, lead, one in zip(shapes, self.leads, self.given, strict=True):
            tail = f.pointer_at(shape, f.multiply(lead, 8))
            found = [f.load_word(tail, 8 * k) for k in range(len(one.sample_shape))]
            conditions += [f.put(f"icmp eq i64 {x}, {n}") for x, n in zip(found, one.sample_shape, strict=True)]
        self.require(*conditions)
        self.shape = f.buffer(8 * (MAX_AXES + 3))
        with f.loop(self.lead) as axis:
            place = f.multiply(axis, 8)
            size = f.load_word(f.pointer_at(shapes[0], place), 0)
            f.store_word(size, self.shape, place)
            self.combine(self.samples, "mul", size)
            for shape, single in zip(shapes[1:], self.single[1:], strict=True):
                other = f.put(f"select i1 {single}, ptr {shapes[0]}, ptr {shape}")
                same = f.put(f"icmp eq i64 {f.load_word(f.pointer_at(other, place), 0)}, {size}")
                self.combine(self.fitting, "and", f.put(f"zext i1 {same} to i64"))
        self.count = f.load_word(self.samples, 0)
        few = f.put(f"icmp ult i64 {f.put(f'sub i64 {self.count}, 1')}, {self.words['most']}")  # and not 0
        self.require(few, f.put(f"trunc i64 {f.load_word(self.fitting, 0)} to i1"))

    def check_memory(self) -> None:
        """Require that no array of an output overlaps another array."""
        f, ends = self.f, self.f.buffer(16 * len(self.given))
        for k, x in enumerate(self.arrays):
            start, place = f.load_word(x, _DATA), f.pointer_at(ends, 16 * k)
            size = f.put(
                f"select i1 {self.single[k]}, i64 {self.bytes[k]}, i64 {f.multiply(self.count, self.bytes[k])}"
            )
            f.do(f"store i64 {start}, ptr {place}, align 8")
            f.do(f"store i64 {f.put(f'add i64 {start}, {size}')}, ptr {f.pointer_at(place, 8)}, align 8")
        with f.loop(str(len(self.given)), start=str(len(self.layout.inputs))) as i, f.loop(i) as j:
            one, other = (f.pointer_at(ends, f.multiply(k, 16)) for k in (i, j))
            before = f.put(f"icmp ule i64 {f.load_word(one, 8)}, {f.load_word(other, 0)}")
            behind = f.put(f"icmp ule i64 {f.load_word(other, 8)}, {f.load_word(one, 0)}")
            self.combine(self.fitting, "and", f.put(f"zext i1 {f.put(f'or i1 {before}, {behind}')} to i64"))
        self.require(f.put(f"trunc i64 {f.load_word(self.fitting, 0)} to i1"))

    def compute(self) -> None:
        """Make the tuple of the outputs, and call the kernel; no result if there is no memory."""
        f, inputs = self.f, len(self.layout.inputs)
        found = f.put(f"call ptr {self.pointers['PyTuple_New']}(i64 {len(self.layout.outputs)})")
        self.require(f.put(f"icmp ne ptr {found}, null"))
        results = self.arrays[inputs:] or [self.new_array(one.sample_shape) for one in self.layout.outputs]
        for k, x in enumerate(results):  # the tuple takes over what it is given
            if self.fills:
                f.do(f"call void {self.pointers['Py_IncRef']}(ptr {x})")
            f.put(f"call i32 {self.pointers['PyTuple_SetItem']}(ptr {found}, i64 {k}, ptr {x})")
        with f.when_else(self.all_of(f.put(f"icmp ne ptr {x}, null") for x in results)) as otherwise:
            mask = f.put(f"trunc i64 {self.words['flags']} to i32")
            for x in () if self.fills else results:
                flags = f.put(f"and i32 {f.load_half(x, _FLAGS)}, {mask}")
                f.do(f"store i32 {flags}, ptr {f.pointer_at(x, _FLAGS)}, align 4")
            arrays = [*self.arrays[:inputs], *results]
            for k, row in self.layout.rows.items():
                step = str(self.bytes[k])
                if k < inputs:
                    step = f.put(f"select i1 {self.single[k]}, i64 0, i64 {step}")
                store_row(f, self.table, row, f.load_word(arrays[k], _DATA), step, str(self.number_bytes))
            call = f"call void @kernel(ptr {self.table}, i64 {self.count})"
            with f.when_else(f.put(f"icmp ugt i64 {self.count}, {_LONG}")) as otherwise_short:
                state = f.put(f"call ptr {self.pointers['PyEval_SaveThread']}()")
                f.do(call)
                f.do(f"call void {self.pointers['PyEval_RestoreThread']}(ptr {state})")
                otherwise_short()
                f.do(call)
            f.do(f"store ptr {found}, ptr {self.result}, align 8")
            otherwise()
            f.do(f"call void {self.pointers['Py_DecRef']}(ptr {found})")

    def new_array(self, tail: tuple[int, ...]) -> str:
        """Return a new array of the leading shape and this one behind it; null if there is no memory."""
        f = self.f
        end = f.pointer_at(self.shape, f.multiply(self.lead, 8))
        for k, n in enumerate(tail):
            f.store_word(n, end, 8 * k)
        rank = f.put(f"trunc i64 {f.put(f'add i64 {self.lead}, {len(tail)}')} to i32")
        number = f.put(f"trunc i64 {self.words['number']} to i32")
        what = (
            f"ptr {self.kind}, i32 {rank}, ptr {self.shape}, i32 {number}, ptr null, ptr null, i32 0, i32 0, ptr null"
        )
        return f.put(f"call ptr {self.pointers['PyArray_New']}({what})")
