"""A builder of functions in LLVM IR, instruction by instruction: loops, branches, shuffles."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

LANE_COUNT: Final = 8  # number of samples in one vector
CACHE_LINE_BYTES: Final = 64  # size of a cache line of the processor


def float_type_name(single: bool) -> str:
    """Return LLVM's name of a floating-point type: "float" if `single` is true (single precision), else "double"."""
    return "float" if single else "double"


def shared_name(function_name: str, float_type: str) -> str:
    """Return the linker symbol of a function that kernels share, for numbers of type "double" or "float"."""
    return f"@hingepair.{function_name}.{float_type}"


def hexadecimal(number: float) -> str:
    """Return the text of a floating-point number in LLVM's hexadecimal notation, exact to the last bit. A number
    meant as float32 must be rounded beforehand.
    """
    return f"0x{struct.unpack('<Q', struct.pack('<d', number))[0]:016X}"


class FunctionBuilder:
    """Builder of the text of one LLVM IR function, instruction by instruction. Values and labels are numbered; names
    given by users appear only in comments.

    Each method appends instructions to the function; most return the name of the value that they compute.

    Args:
        signature: type of the result, name and parameters in LLVM IR.
    """

    def __init__(self, signature: str) -> None:
        self._lines = [f"define {signature} nounwind {{", "entry:"]
        self._count = 0
        self._block = "entry"

    def text(self) -> str:
        """Return the source of the finished function in LLVM IR."""
        return "\n".join([*self._lines, "}"])

    def put(self, code: str, comment: str = "") -> str:
        """Append an instruction that computes a value, given as LLVM IR (`code`), and return the new name of the
        value. The comment is written behind the instruction.
        """
        self._count += 1
        name = f"%v{self._count}"
        self._lines.append(f"  {name} = {code}  ; {' '.join(comment.split())}" if comment else f"  {name} = {code}")
        return name

    def do(self, code: str) -> None:
        """Append an instruction that has no value, such as a store or a branch, given as LLVM IR (`code`)."""
        self._lines.append(f"  {code}")

    def begin_block(self, label: str) -> None:
        """Append a label, which begins a new basic block of instructions."""
        self._lines.append(f"{label}:")
        self._block = label

    def new_labels(self, *kinds: str) -> list[str]:
        """Return a list of new labels, which are unique in the function: one for each positional argument, with which
        the label begins.
        """
        self._count += 1
        return [f"{kind}.{self._count}" for kind in kinds]

    @contextmanager
    def loop(self, stop: str, start: str = "0", step: str = "1") -> Iterator[str]:
        """Append a loop around the instructions of the `with` block (context manager), and yield the name of its
        64-bit counter. The counter begins at `start` and grows by `step`; the loop ends before it reaches `stop`. All
        three are names of LLVM values or digits.

        Args:
            stop: the value at which the loop ends; it is not reached.
            start: the first value of the counter.
            step: the increment.
        """
        head, body, after, done = self.new_labels("head", "body", "after", "done")
        before, counter = self._block, self.reserve_name()
        self.do(f"br label %{head}")
        self.begin_block(head)
        place = len(self._lines)
        self.do(f"br i1 {self.put(f'icmp slt i64 {counter}, {stop}')}, label %{body}, label %{done}")
        self.begin_block(body)
        yield counter
        self.do(f"br label %{after}")
        self.begin_block(after)
        more = self.put(f"add i64 {counter}, {step}")
        self.do(f"br label %{head}")
        self._lines.insert(place, f"  {counter} = phi i64 [{start}, %{before}], [{more}, %{after}]")
        self.begin_block(done)

    @contextmanager
    def when(self, condition: str) -> Iterator[None]:
        """Append a branch around the instructions of the `with` block (context manager), which run only if the
        condition, the name of an LLVM value of one bit, is true.
        """
        then, done = self.new_labels("then", "done")
        self.do(f"br i1 {condition}, label %{then}, label %{done}")
        self.begin_block(then)
        yield
        self.do(f"br label %{done}")
        self.begin_block(done)

    @contextmanager
    def when_else(self, condition: str) -> Iterator[Callable[[], None]]:
        """Append an if-else branch around the instructions of the `with` block (context manager); `condition` is the
        name of an LLVM value of one bit. Calling the yielded function ends the first branch and begins the second.
        """
        then, other, done = self.new_labels("then", "other", "done")
        self.do(f"br i1 {condition}, label %{then}, label %{other}")
        self.begin_block(then)

        def otherwise() -> None:
            self.do(f"br label %{done}")
            self.begin_block(other)

        yield otherwise
        self.do(f"br label %{done}")
        self.begin_block(done)

    def either(
        self, kind: str, condition: str, write: Callable[[], list[str]], write_otherwise: Callable[[], list[str]]
    ) -> list[str]:
        """Append an if-else branch. Both functions append instructions and return the names of equally many values of
        type `kind`; return the names of these values behind the branch.
        """
        ends: list[tuple[str, list[str]]] = []
        with self.when_else(condition) as otherwise:
            values = write()
            ends.append((self._block, values))
            otherwise()
            values = write_otherwise()
            ends.append((self._block, values))
        (block, values), (other_block, other_values) = ends
        return [
            self.put(f"phi {kind} [{x}, %{block}], [{y}, %{other_block}]")
            for x, y in zip(values, other_values, strict=True)
        ]

    def reserve_name(self) -> str:
        """Return a new name for a value whose instruction is appended later."""
        self._count += 1
        return f"%v{self._count}"

    def pointer_at(self, start: str, offset: str | int) -> str:
        """Append the computation of the pointer `offset` bytes after `start`, and return its name. For offset 0,
        append nothing and return `start`.
        """
        return start if offset in {0, "0"} else self.put(f"getelementptr i8, ptr {start}, i64 {offset}")

    def load_word(self, start: str, offset: int, kind: str = "i64") -> str:
        """Append the load of a 64-bit integer, or of a pointer (kind "ptr"), `offset` bytes after the address
        `start`, and return the name of the loaded value.
        """
        return self.put(f"load {kind}, ptr {self.pointer_at(start, offset)}, align 8")

    def multiply(self, x: str, y: str | int) -> str:
        """Append the product of two 64-bit integers, given as names or digits, and return the name of the product."""
        return self.put(f"mul i64 {x}, {y}")

    def load_entry(self, table: str, k: str) -> str:
        """Append the load of the k-th entry of a table of 32-bit integers, and return the name of the entry as a
        64-bit integer. `k` is the name of an LLVM value or digits.
        """
        place = self.pointer_at(table, 4 * int(k) if k.isdigit() else self.multiply(k, 4))
        return self.put(f"zext i32 {self.put(f'load i32, ptr {place}, align 4')} to i64")

    def splat(self, vector_type: str, typed_number: str) -> str:
        """Append the copy of a number to all lanes of a vector, and return the name of the vector. `typed_number` is
        the LLVM type and the name of the number, such as "double %v1".
        """
        return self.shuffle(
            vector_type,
            self.put(f"insertelement {vector_type} poison, {typed_number}, i32 0"),
            "poison",
            [0] * LANE_COUNT,
        )

    def shuffle(self, vector_type: str, x: str, y: str, picked_elements: Sequence[int]) -> str:
        """Append a shuffle, which makes a vector of elements picked from the vectors x and y, and return its name. An
        index in `picked_elements` counts the elements of x, then of y; -1 leaves the lane undefined.

        Args:
            vector_type: type of the vectors.
            x: the first vector.
            y: the second vector.
            picked_elements: for each lane the number of an element of x and y; -1 where any element will do.
        """
        mask = ", ".join(f"i32 {k}" if k >= 0 else "i32 poison" for k in picked_elements)
        return self.put(
            f"shufflevector {vector_type} {x}, {vector_type} {y}, <{len(picked_elements)} x i32> <{mask}>"
        )

    def transpose(self, vector_type: str, vectors: list[str]) -> list[str]:
        """Append the transpose of an 8 x 8 block of numbers, given as the names of eight vectors of type vector_type,
        and return the list of the names of the eight resulting vectors.
        """
        for step in (1, 2, 4):
            low = [m if not m & step else LANE_COUNT + m - step for m in range(LANE_COUNT)]
            high = [m + step if not m & step else LANE_COUNT + m for m in range(LANE_COUNT)]
            vectors = [
                self.shuffle(vector_type, vectors[i & ~step], vectors[i | step], high if i & step else low)
                for i in range(LANE_COUNT)
            ]
        return vectors
