"""A trace: the operations of a function of scalars, recorded instead of computed.

The equations take any values that add and multiply. With traced values they record straight-line code: one value for
each operation, assigned once. Operations with known numbers fold away while they are recorded (x + 0, x * 1, x * 0,
x * -1), common subexpressions are recorded once, and values that no result needs are left out. The order of the
operations stays that of the equations: by NumPy, folding changes no bits but the sign of a zero and the product of
zero and NaN. Kernels fuse products with sums, and which they fuse may change with what folds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Final, TypeAlias

import numpy as np

from hingepair.errors import ArgumentError

Operand: TypeAlias = "TracedValue | float"

MAX_OPERATIONS: Final = 1_000_000
"""Most operations that are recorded: LLVM compiles them in about a minute, with more than a gigabyte."""


def check_size(count: int) -> None:
    """Refuse a program of so many operations, or numbers among its results."""
    if count > MAX_OPERATIONS:
        expected = f"at most {MAX_OPERATIONS:,} operations, as fewer joints, outputs or derivatives take"
        raise ArgumentError("program", expected, "more")


class TracedValue:
    """An input, or the result of a recorded operation. Arithmetic with it records further operations."""

    __array_ufunc__ = None  # NumPy's numbers leave sums and products with a traced value to the methods below
    __slots__ = ("operands", "operation", "trace")

    def __init__(self, trace: Trace, operation: str, operands: tuple[Operand, ...]) -> None:
        self.trace = trace
        self.operation = operation  # "input", "+", "-", "*", "/", "negative", "<", or the name of a function
        self.operands = operands  # values and numbers

    def __add__(self, other: Operand) -> Operand:
        if isinstance(other, TracedValue):
            if other.operation == "negative":
                return self - other.operands[0]
            return self.trace.record("+", self, other)
        return self if other == 0 else self.trace.record("+", self, float(other))

    def __radd__(self, other: float) -> Operand:
        return self if other == 0 else self.trace.record("+", float(other), self)

    def __sub__(self, other: Operand) -> Operand:
        if isinstance(other, TracedValue):
            if other.operation == "negative":
                return self + other.operands[0]
            return self.trace.record("-", self, other)
        return self if other == 0 else self.trace.record("-", self, float(other))

    def __rsub__(self, other: float) -> Operand:
        return -self if other == 0 else self.trace.record("-", float(other), self)

    def __mul__(self, other: Operand) -> Operand:
        if isinstance(other, TracedValue):
            return self.trace.record("*", self, other)
        return self._multiply_number(float(other), (self, float(other)))

    def __rmul__(self, other: float) -> Operand:
        return self._multiply_number(float(other), (float(other), self))

    def _multiply_number(self, number: float, factors: tuple[Operand, Operand]) -> Operand:
        """Return the product with a known number, which may fold; `factors` are both in their order."""
        if number == 0:
            return 0.0
        if number == 1:
            return self
        return -self if number == -1 else self.trace.record("*", *factors)

    def __truediv__(self, other: Operand) -> Operand:
        if isinstance(other, TracedValue):
            return self.trace.record("/", self, other)
        return self if other == 1 else self.trace.record("/", self, float(other))

    def __rtruediv__(self, other: float) -> Operand:
        return 0.0 if other == 0 else self.trace.record("/", float(other), self)

    def __neg__(self) -> Operand:
        return self.operands[0] if self.operation == "negative" else self.trace.record("negative", self)

    def __pos__(self) -> TracedValue:
        return self

    def sine(self) -> Operand:
        """Record the sine [rad]."""
        first = self.operands[0] if self.operation == "negative" else None
        return -first.sine() if isinstance(first, TracedValue) else self.trace.record("sin", self)

    def cosine(self) -> Operand:
        """Record the cosine [rad]."""
        first = self.operands[0] if self.operation == "negative" else None
        return first.cosine() if isinstance(first, TracedValue) else self.trace.record("cos", self)

    def versine(self) -> Operand:
        """Record the versine 1 - cos [rad], which is accurate for small angles too."""
        first = self.operands[0] if self.operation == "negative" else None
        if isinstance(first, TracedValue):
            return first.versine()
        return self.trace.record("versine", self, self.sine(), self.cosine())

    def __bool__(self) -> bool:
        raise TypeError("a traced value is neither true nor false: use `where`")


class Trace:
    """A recorder of operations on traced values; one that occurs several times is recorded once."""

    def __init__(self) -> None:
        self._recorded: dict[tuple[Any, ...], TracedValue] = {}
        self.solved: dict[int, Any] = {}  # a `derivatives.Solution` by the id of each of its unknowns

    def input(self) -> TracedValue:
        """Return a new value for an input."""
        return TracedValue(self, "input", ())

    def record(self, operation: str, *operands: Operand) -> TracedValue:
        """Return the value of an operation on traced values and numbers, the same for both orders of + and *."""
        key = (operation, *operands)
        value = self._recorded.get(key)
        if value is None and operation in {"+", "*"}:
            value = self._recorded.get((operation, operands[1], operands[0]))
        if value is None:
            if len(self._recorded) >= MAX_OPERATIONS:
                check_size(len(self._recorded) + 1)
            value = self._recorded[key] = TracedValue(self, operation, operands)
        return value


def needed_values(results: Iterable[Operand], behind_solutions: bool = True) -> list[TracedValue]:
    """Return the traced values on which results depend, inputs included, each after its operands; unless
    `behind_solutions`, without those from which unknowns of a `derivatives.Solution` have been found.
    """
    needed: list[TracedValue] = []
    seen: set[int] = set()
    waiting: list[tuple[Operand, bool]] = [(result, False) for result in reversed(list(results))]
    while waiting:
        value, ready = waiting.pop()
        if not isinstance(value, TracedValue):
            continue
        if ready:
            needed.append(value)
        elif id(value) not in seen:
            seen.add(id(value))
            waiting.append((value, True))
            if behind_solutions or id(value) not in value.trace.solved:
                waiting.extend((operand, False) for operand in reversed(value.operands))
    return needed


def square_root(x: Any) -> Any:
    """Return the square root of a number, an array or a traced value."""
    if isinstance(x, TracedValue):
        return x.trace.record("sqrt", x)
    return np.sqrt(x)


def arc_tangent(y: Any, x: Any) -> Any:
    """Return the angle [rad] of the vector (x, y) from the x axis, for numbers, arrays or traced values."""
    return _apply_binary("arctan2", np.arctan2, y, x)


def hypotenuse(x: Any, y: Any) -> Any:
    """Return the square root of x^2 + y^2 without overflow on the way, for numbers, arrays or traced values."""
    return _apply_binary("hypot", np.hypot, x, y)


def _apply_binary(operation: str, function: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
    """Return a function of NumPy at a and b; record the operation where one of them is traced."""
    if isinstance(a, TracedValue):
        return a.trace.record(operation, a, b)
    return b.trace.record(operation, a, b) if isinstance(b, TracedValue) else function(a, b)


def where_less(a: Any, b: Any, then: Any, otherwise: Any) -> Any:
    """Return `then` if a < b, else, NaN included, `otherwise`: numbers, arrays, traced values, or tuples of them."""
    if isinstance(then, tuple):
        return tuple(where_less(a, b, x, y) for x, y in zip(then, otherwise, strict=True))
    for operand in (a, b):
        if isinstance(operand, TracedValue):
            return operand.trace.record("where", operand.trace.record("<", a, b), then, otherwise)
    return np.where(a < b, then, otherwise)
