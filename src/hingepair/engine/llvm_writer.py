"""Functions in LLVM's language, written instruction by instruction: loops, branches, shuffles."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final

LANES: Final = 8  # samples that one vector holds
LINE: Final = 64  # bytes of a cache line


def number_type(single: bool) -> str:
    """Return how LLVM calls the numbers of float32, or of float64."""
    return "float" if single else "double"


def shared_name(function: str, number: str) -> str:
    """Return the symbol of a shared function for numbers of a type, "double" or "float"."""
    return f"@hingepair.{function}.{number}"


def hexadecimal(number: float) -> str:
    """Return a number to the last bit, as LLVM writes it; single precision likewise, once it is rounded."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', number))[0]:016X}"


class Function:
    """A function that is being written. Its values and labels are numbered; names of users stand in notes only.

    Args:
        signature: the result's type, the name and the parameters, as LLVM writes them.
    """

    def __init__(self, signature: str) -> None:
        self._lines = [f"define {signature} nounwind {{", "entry:"]
        self._count = 0
        self._block = "entry"

    def text(self) -> str:
        """Return the finished function."""
        return "\n".join([*self._lines, "}"])

    def put(self, code: str, note: str = "") -> str:
        """Write an instruction, with a note that says what it computes; returns the name of its value."""
        self._count += 1
        name = f"%v{self._count}"
        self._lines.append(f"  {name} = {code}  ; {' '.join(note.split())}" if note else f"  {name} = {code}")
        return name

    def do(self, code: str) -> None:
        """Write an instruction that has no value."""
        self._lines.append(f"  {code}")

    def begin(self, label: str) -> None:
        """Begin a block of instructions."""
        self._lines.append(f"{label}:")
        self._block = label

    def labels(self, *kinds: str) -> list[str]:
        """Return new labels."""
        self._count += 1
        return [f"{kind}.{self._count}" for kind in kinds]

    @contextmanager
    def loop(self, stop: str, start: str = "0", step: str = "1") -> Iterator[str]:
        """Write a loop over what is written inside, for a counter from `start` up to `stop`; yields the counter."""
        head, body, after, done = self.labels("head", "body", "after", "done")
        before, counter = self._block, self.put_later()
        self.do(f"br label %{head}")
        self.begin(head)
        place = len(self._lines)
        self.do(f"br i1 {self.put(f'icmp slt i64 {counter}, {stop}')}, label %{body}, label %{done}")
        self.begin(body)
        yield counter
        self.do(f"br label %{after}")
        self.begin(after)
        more = self.put(f"add i64 {counter}, {step}")
        self.do(f"br label %{head}")
        self._lines.insert(place, f"  {counter} = phi i64 [{start}, %{before}], [{more}, %{after}]")
        self.begin(done)

    @contextmanager
    def when(self, condition: str) -> Iterator[None]:
        """Write a branch: what is written inside runs only where a condition holds."""
        then, done = self.labels("then", "done")
        self.do(f"br i1 {condition}, label %{then}, label %{done}")
        self.begin(then)
        yield
        self.do(f"br label %{done}")
        self.begin(done)

    @contextmanager
    def choose(self, condition: str) -> Iterator[Callable[[], None]]:
        """Write a branch of two sides; a call of what is yielded ends the first and begins the second."""
        then, other, done = self.labels("then", "other", "done")
        self.do(f"br i1 {condition}, label %{then}, label %{other}")
        self.begin(then)

        def otherwise() -> None:
            self.do(f"br label %{done}")
            self.begin(other)

        yield otherwise
        self.do(f"br label %{done}")
        self.begin(done)

    def put_later(self) -> str:
        """Return the name of a value whose instruction is written later."""
        self._count += 1
        return f"%v{self._count}"

    def step(self, start: str, offset: str | int) -> str:
        """Write the pointer so many bytes behind another."""
        return start if offset in {0, "0"} else self.put(f"getelementptr i8, ptr {start}, i64 {offset}")

    def word(self, start: str, offset: int, kind: str = "i64") -> str:
        """Write the load of an integer or pointer that stands so many bytes behind an address."""
        return self.put(f"load {kind}, ptr {self.step(start, offset)}, align 8")

    def product(self, x: str, y: str | int) -> str:
        """Write the product of two integers."""
        return self.put(f"mul i64 {x}, {y}")

    def entry(self, table: str, k: str) -> str:
        """Write the load of the k-th number of a table of 32-bit numbers."""
        place = self.step(table, 4 * int(k) if k.isdigit() else self.product(k, 4))
        return self.put(f"zext i32 {self.put(f'load i32, ptr {place}, align 4')} to i64")

    def splat(self, kind: str, one: str) -> str:
        """Write a number, given with its type, into all lanes of a vector."""
        return self.shuffle(kind, self.put(f"insertelement {kind} poison, {one}, i32 0"), "poison", [0] * LANES)

    def shuffle(self, kind: str, x: str, y: str, picks: Sequence[int]) -> str:
        """Write a vector of elements of two others, by number; -1 where any will do."""
        mask = ", ".join(f"i32 {k}" if k >= 0 else "i32 poison" for k in picks)
        return self.put(f"shufflevector {kind} {x}, {kind} {y}, <{len(picks)} x i32> <{mask}>")

    def transpose(self, kind: str, vectors: list[str]) -> list[str]:
        """Write the transpose of eight vectors: components of all samples become samples of all components."""
        for step in (1, 2, 4):
            low = [m if not m & step else LANES + m - step for m in range(LANES)]
            high = [m + step if not m & step else LANES + m for m in range(LANES)]
            vectors = [
                self.shuffle(kind, vectors[i & ~step], vectors[i | step], high if i & step else low)
                for i in range(LANES)
            ]
        return vectors
