"""A builder of functions in LLVM IR, instruction by instruction: loops, branches, shuffles."""

from __future__ import annotations

import platform
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

LANES: Final = 8  # samples in one vector
CACHE_LINE: Final = 64  # bytes
MAX_STACK: Final = 2**14  # bytes of buffers on the stack of a function
_DEFAULT_MXCSR: Final = 0x1F80  # round to nearest, no traps, no flags
NUMBER_BYTES: Final = {"float": 4, "double": 8}  # by LLVM's name of the type of numbers


def shared_name(function: str, float_type: str) -> str:
    """Return the symbol of a function that kernels share, for numbers of type "double" or "float"."""
    return f"@hingepair.{function}.{float_type}"


def hexadecimal(number: float) -> str:
    """Return a number in LLVM's notation, exact to the last bit; one for float32 must have been rounded before."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', number))[0]:016X}"


class FunctionBuilder:
    """The text of one LLVM function, to which each method appends instructions.

    Values and labels are numbered; most methods return the name of the value that they compute.

    Args:
        signature: type of the result, name and parameters in LLVM IR.
    """

    def __init__(self, signature: str) -> None:
        self._lines = [f"define {signature} nounwind {{", "entry:"]
        self._count = 0
        self._block = "entry"
        self._buffer_bytes = 0

    def text(self) -> str:
        """Return the finished function, which ends with its only `ret`."""
        begin, end, size = [], [], self._buffer_bytes
        if size > MAX_STACK:
            begin = [
                f"  %heap = call ptr @malloc(i64 {size + CACHE_LINE})",
                "  %heap.address = ptrtoint ptr %heap to i64",
                f"  %heap.above = add i64 %heap.address, {CACHE_LINE}",
                f"  %heap.line = and i64 %heap.above, -{CACHE_LINE}",
                "  %buffers = inttoptr i64 %heap.line to ptr",
            ]
            end = ["  call void @free(ptr %heap)"]
        elif size:
            begin = [f"  %buffers = alloca [{size} x i8], align {CACHE_LINE}"]
        return "\n".join([*self._lines[:2], *begin, *self._lines[2:-1], *end, self._lines[-1], "}"])

    def buffer(self, size: int) -> str:
        """Return the address of a buffer of so many bytes, which begins with a cache line. All buffers of a function
        are on its stack, or if they are large in memory of their own: a thread may have a stack of 64 kB.
        """
        address = self.pointer_at("%buffers", self._buffer_bytes)
        self._buffer_bytes += -(-size // CACHE_LINE) * CACHE_LINE
        return address

    def put(self, code: str) -> str:
        """Append an instruction that computes a value, and return the value's name."""
        name = self._new_name()
        self._lines.append(f"  {name} = {code}")
        return name

    def do(self, code: str) -> None:
        """Append an instruction that has no value, such as a store."""
        self._lines.append(f"  {code}")

    def _new_name(self) -> str:
        self._count += 1
        return f"%v{self._count}"

    def _new_labels(self, *kinds: str) -> list[str]:
        self._count += 1
        return [f"{kind}.{self._count}" for kind in kinds]

    def _begin_block(self, label: str) -> None:
        self._lines.append(f"{label}:")
        self._block = label

    @contextmanager
    def loop(self, stop: str, start: str = "0", step: str = "1") -> Iterator[str]:
        """Append a loop around the instructions of the `with` block, and yield its 64-bit counter, which stays below
        `stop`. All three are names of values or digits.
        """
        head, body, after, done = self._new_labels("head", "body", "after", "done")
        before, counter = self._block, self._new_name()
        self.do(f"br label %{head}")
        self._begin_block(head)
        place = len(self._lines)
        self.do(f"br i1 {self.put(f'icmp slt i64 {counter}, {stop}')}, label %{body}, label %{done}")
        self._begin_block(body)
        yield counter
        self.do(f"br label %{after}")
        self._begin_block(after)
        more = self.put(f"add i64 {counter}, {step}")
        self.do(f"br label %{head}")
        self._lines.insert(place, f"  {counter} = phi i64 [{start}, %{before}], [{more}, %{after}]")
        self._begin_block(done)

    @contextmanager
    def when(self, condition: str) -> Iterator[None]:
        """Append a branch: the instructions of the `with` block run if the condition, a value of one bit, is true."""
        then, done = self._new_labels("then", "done")
        self.do(f"br i1 {condition}, label %{then}, label %{done}")
        self._begin_block(then)
        yield
        self.do(f"br label %{done}")
        self._begin_block(done)

    @contextmanager
    def when_else(self, condition: str) -> Iterator[Callable[[], None]]:
        """Append two branches; calling the yielded function ends the first and begins the second."""
        then, other, done = self._new_labels("then", "other", "done")
        self.do(f"br i1 {condition}, label %{then}, label %{other}")
        self._begin_block(then)

        def otherwise() -> None:
            self.do(f"br label %{done}")
            self._begin_block(other)

        yield otherwise
        self.do(f"br label %{done}")
        self._begin_block(done)

    def pointer_at(self, start: str, offset: str | int) -> str:
        """Return the pointer `offset` bytes after another."""
        return start if offset in {0, "0"} else self.put(f"getelementptr i8, ptr {start}, i64 {offset}")

    def load_word(self, start: str, offset: int, kind: str = "i64") -> str:
        """Return the 64-bit integer, or the pointer (kind "ptr"), `offset` bytes after an address."""
        return self.put(f"load {kind}, ptr {self.pointer_at(start, offset)}, align 8")

    def store_word(self, value: str | int, start: str, offset: str | int = 0) -> None:
        """Store a 64-bit integer `offset` bytes after an address."""
        self.do(f"store i64 {value}, ptr {self.pointer_at(start, offset)}, align 8")

    def load_half(self, start: str, offset: int) -> str:
        """Return the 32-bit integer `offset` bytes after an address."""
        return self.put(f"load i32, ptr {self.pointer_at(start, offset)}, align 4")

    def multiply(self, x: str, y: str | int) -> str:
        """Return the product of two 64-bit integers, each a name or digits."""
        return self.put(f"mul i64 {x}, {y}")

    def add_multiples(self, start: str, pairs: Iterable[tuple[str, str]]) -> str:
        """Return a 64-bit integer plus the products of pairs."""
        for x, y in pairs:
            start = self.put(f"add i64 {start}, {self.multiply(x, y)}")
        return start

    def load_entry(self, table: str, k: str) -> str:
        """Return the k-th entry of a table of 32-bit integers as a 64-bit integer; k is a name or digits."""
        place = self.pointer_at(table, 4 * int(k) if k.isdigit() else self.multiply(k, 4))
        return self.put(f"zext i32 {self.put(f'load i32, ptr {place}, align 4')} to i64")

    def splat(self, vector: str, number: str) -> str:
        """Return a vector with a number, such as "double %v1", in all lanes."""
        first = self.put(f"insertelement {vector} poison, {number}, i32 0")
        return self.shuffle(vector, first, "poison", [0] * LANES)

    def shuffle(self, vector: str, x: str, y: str, picked: Sequence[int]) -> str:
        """Return a vector of elements of x and y, which are counted through; -1 leaves a lane undefined."""
        mask = ", ".join(f"i32 {k}" if k >= 0 else "i32 poison" for k in picked)
        return self.put(f"shufflevector {vector} {x}, {vector} {y}, <{len(picked)} x i32> <{mask}>")

    def transpose(self, vector: str, vectors: list[str]) -> list[str]:
        """Return the transpose of 8 x 8 numbers, given and returned as eight vectors."""
        for step in (1, 2, 4):
            low = [m if not m & step else LANES + m - step for m in range(LANES)]
            high = [m + step if not m & step else LANES + m for m in range(LANES)]
            vectors = [
                self.shuffle(vector, vectors[i & ~step], vectors[i | step], high if i & step else low)
                for i in range(LANES)
            ]
        return vectors


def default_float_environment(f: FunctionBuilder) -> tuple[list[str], Callable[[], None]]:
    """Append that the function computes with the default floating-point environment. Return the declarations of what
    it calls for that, and a function that appends the return to the caller's.
    """
    machine = platform.machine().lower()
    if machine in {"x86_64", "amd64"}:
        f.do("%caller = alloca i32, align 4")
        f.do("%default = alloca i32, align 4")
        f.do(f"store i32 {_DEFAULT_MXCSR}, ptr %default, align 4")
        f.do("call void @llvm.x86.sse.stmxcsr(ptr %caller)")
        f.do("call void @llvm.x86.sse.ldmxcsr(ptr %default)")
        declared = [f"declare void @llvm.x86.sse.{name}mxcsr(ptr)" for name in ("st", "ld")]
        return declared, lambda: f.do("call void @llvm.x86.sse.ldmxcsr(ptr %caller)")
    if machine in {"arm64", "aarch64"}:
        control, status = (f.put(f"call i64 @llvm.aarch64.get.fp{name}()") for name in ("cr", "sr"))
        f.do("call void @llvm.aarch64.set.fpcr(i64 0)")

        def restore() -> None:
            f.do(f"call void @llvm.aarch64.set.fpcr(i64 {control})")
            f.do(f"call void @llvm.aarch64.set.fpsr(i64 {status})")

        gets = [f"declare i64 @llvm.aarch64.get.fp{name}()" for name in ("cr", "sr")]
        return [*gets, *(f"declare void @llvm.aarch64.set.fp{name}(i64)" for name in ("cr", "sr"))], restore
    return [], lambda: None
