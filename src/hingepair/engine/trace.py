"""A trace: what a function of scalars does, written down line by line instead of done.

The equations take whatever adds and multiplies. Given traced values they write straight-line code: one line an
operation, each value assigned once. What is known folds away as it is written (x + 0, x * 1, x * 0, x * -1), what is
computed twice is written once, and what no result needs is left out. The order of the operations stays that of the
equations, so that a folded program gives the bits of the full one, but for the sign of a zero and for what a zero
would have made of a NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, TypeAlias

import numpy as np

from hingepair.numeric import array_libraries
from hingepair.numeric.bounded import Bounded

Operand: TypeAlias = "Value | float"

FUNCTIONS: Final = frozenset({"sin", "cos", "versine", "sqrt", "where", "<", "arctan2", "hypot"})


class Value:
    """A traced value: an input, or the result of an operation on earlier values and numbers.

    Attributes:
        operation: "input", "+", "-", "*", "/", "negative", or one of FUNCTIONS.
        operands: values and numbers.
        varies: whether it differs from sample to sample.
        name: what it is called in generated code, "" where nobody named it.
    """

    __array_ufunc__ = None  # NumPy leaves sums and products with its numbers to the methods below
    __slots__ = ("name", "operands", "operation", "trace", "varies")

    def __init__(
        self, trace: Trace, operation: str, operands: tuple[Operand, ...], varies: bool, name: str = ""
    ) -> None:
        self.trace = trace
        self.operation = operation
        self.operands = operands
        self.varies = varies
        self.name = name

    def __add__(self, other: Operand) -> Operand:
        if isinstance(other, Value):
            if other.operation == "negative":
                return self - other.operands[0]
            return self.trace.line("+", self, other)
        return self if other == 0 else self.trace.line("+", self, float(other))

    def __radd__(self, other: float) -> Operand:
        return self if other == 0 else self.trace.line("+", float(other), self)

    def __sub__(self, other: Operand) -> Operand:
        if isinstance(other, Value):
            if other.operation == "negative":
                return self + other.operands[0]
            return self.trace.line("-", self, other)
        return self if other == 0 else self.trace.line("-", self, float(other))

    def __rsub__(self, other: float) -> Operand:
        return -self if other == 0 else self.trace.line("-", float(other), self)

    def __mul__(self, other: Operand) -> Operand:
        if isinstance(other, Value):
            return self.trace.line("*", self, other)
        return self._times(float(other), (self, float(other)))

    def __rmul__(self, other: float) -> Operand:
        return self._times(float(other), (float(other), self))

    def _times(self, number: float, both: tuple[Operand, Operand]) -> Operand:
        if number == 0:
            return 0.0
        if number == 1:
            return self
        return -self if number == -1 else self.trace.line("*", *both)

    def __truediv__(self, other: Operand) -> Operand:
        if isinstance(other, Value):
            return self.trace.line("/", self, other)
        return self if other == 1 else self.trace.line("/", self, float(other))

    def __rtruediv__(self, other: float) -> Operand:
        return 0.0 if other == 0 else self.trace.line("/", float(other), self)

    def __neg__(self) -> Operand:
        return self.operands[0] if self.operation == "negative" else self.trace.line("negative", self)

    def __pos__(self) -> Value:
        return self

    def sine(self) -> Operand:
        """Return the sine."""
        first = self.operands[0] if self.operation == "negative" else None
        return -first.sine() if isinstance(first, Value) else self.trace.line("sin", self)

    def cosine(self) -> Operand:
        """Return the cosine."""
        first = self.operands[0] if self.operation == "negative" else None
        return first.cosine() if isinstance(first, Value) else self.trace.line("cos", self)

    def versine(self) -> Operand:
        """Return 1 - cos, with all its digits where the value is small."""
        first = self.operands[0] if self.operation == "negative" else None
        if isinstance(first, Value):
            return first.versine()
        return self.trace.line("versine", self, self.sine(), self.cosine())

    def __bool__(self) -> bool:
        raise TypeError("a traced value is neither true nor false: use `where`")


class Trace:
    """A recorder of operations, from which straight-line code is made."""

    def __init__(self) -> None:
        self._known: dict[tuple[Any, ...], Value] = {}

    def input(self, name: str, varies: bool = True) -> Value:
        """Return the traced value of an input."""
        return Value(self, "input", (), varies, name)

    def line(self, operation: str, *operands: Operand) -> Value:
        """Return the value of an operation; an operation that was recorded before is recorded once."""
        key = (operation, *operands)
        found = self._known.get(key)
        if found is None and operation in {"+", "*"}:
            found = self._known.get((operation, operands[1], operands[0]))
        if found is None:
            varies = any(isinstance(one, Value) and one.varies for one in operands)
            found = self._known[key] = Value(self, operation, operands, varies)
        return found


def needed_values(results: Iterable[Operand]) -> list[Value]:
    """Return the values that lead to the results, inputs included, each after its operands."""
    lines: list[Value] = []
    seen: set[int] = set()
    waiting: list[tuple[Operand, bool]] = [(result, False) for result in reversed(list(results))]
    while waiting:
        value, ready = waiting.pop()
        if not isinstance(value, Value):
            continue
        if ready:
            lines.append(value)
        elif id(value) not in seen:
            seen.add(id(value))
            waiting.append((value, True))
            waiting.extend((one, False) for one in reversed(value.operands))
    return lines


def operation_count(lines: Iterable[Value], varying: bool | None = None) -> int:
    """Return the number of operations among the lines; where `varying` is given, of those that move or do not."""
    return sum(v.operation != "input" and varying in {None, v.varies} for v in lines)


def square_root(x: Any) -> Any:
    """Return the square root of a traced value, a number or an array."""
    if isinstance(x, Value):
        return x.trace.line("sqrt", x)
    return array_libraries.apply("square_root", x) if array_libraries.is_foreign(x) else np.sqrt(x)


def arc_tangent(y: Any, x: Any) -> Any:
    """Return the angle of the vector (x, y) from the x axis [rad]."""
    return _of_two("arctan2", np.arctan2, y, x)


def hypotenuse(x: Any, y: Any) -> Any:
    """Return the root of x^2 + y^2 without overflow on the way."""
    return _of_two("hypot", np.hypot, x, y)


def _of_two(operation: str, function: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
    if isinstance(a, Value):
        return a.trace.line(operation, a, b)
    return b.trace.line(operation, a, b) if isinstance(b, Value) else function(a, b)


def where_less(a: Any, b: Any, then: Any, otherwise: Any) -> Any:
    """Return `then` where a < b, `otherwise` elsewhere and where either is NaN; values, or tuples of them."""
    if isinstance(then, tuple):
        return tuple(where_less(a, b, x, y) for x, y in zip(then, otherwise, strict=True))
    for one in (a, b):
        if isinstance(one, Value):
            return one.trace.line("where", one.trace.line("<", a, b), then, otherwise)
        if array_libraries.is_foreign(one):
            return array_libraries.where_less(a, b, then, otherwise)
    if isinstance(a, Bounded) or isinstance(b, Bounded):
        return (b - a).where_above_0(then, otherwise)
    return np.where(a < b, then, otherwise)


_PARTS: Final = {3: "xyz", 9: ("xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz")}


def component_name(name: str, k: int, count: int) -> str:
    """Return the name of component k of `count` in generated code."""
    parts = _PARTS.get(count)
    return name if count == 1 else f"{name}_{parts[k] if parts else k + 1}"


def name_components(name: str, value: Any, labels: Sequence[str] | None = None) -> None:
    """Name the components of a result in generated code, where they are traced and have no name yet."""
    components = value if isinstance(value, tuple) else (value,)
    for k, component in enumerate(components):
        if isinstance(component, Value) and not component.name and component.operation != "negative":
            component.name = labels[k] if labels else component_name(name, k, len(components))
