"""A trace: the operations of a function of scalars, recorded instead of computed.

The equations take any values that add and multiply. With traced values they record straight-line code: one value for
each operation, assigned once. Operations with known numbers fold away while they are recorded (x + 0, x * 1, x * 0,
x * -1), common subexpressions are recorded once, and values that no result needs are left out. The order of the
operations stays that of the equations, so that a folded program gives the bits of the unfolded one, except for the
sign of a zero and for the product of zero and NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final, TypeAlias

import numpy as np

from hingepair.numeric import array_libraries
from hingepair.numeric.bounded import Bounded
from hingepair.numeric.sampled import Sampled, sampled_value

Operand: TypeAlias = "TracedValue | float"

NON_ARITHMETIC_OPERATION_NAMES: Final = frozenset({"sin", "cos", "versine", "sqrt", "where", "<", "arctan2", "hypot"})
"""Names of the operations of a trace that are not plain arithmetic."""


class TracedValue:
    """A value of a trace: an input, or the result of a recorded operation on earlier values and numbers. Arithmetic
    with it records further operations.

    Attributes:
        trace: the trace that records the operations on this value.
        operation: "input", "+", "-", "*", "/", "negative", or one of NON_ARITHMETIC_OPERATION_NAMES.
        operands: values and numbers.
        varies: whether the value differs from sample to sample.
        name: name in generated code; "" if there is none.
    """

    __array_ufunc__ = None  # NumPy's numbers leave sums and products with a traced value to the methods below
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
        """Return the product of this value and a known number, which folds if the number is 0, 1 or -1 and is
        recorded otherwise. `factors` are the two factors in their original order.
        """
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
        """Record the sine of the value [rad], and return the traced result."""
        first = self.operands[0] if self.operation == "negative" else None
        return -first.sine() if isinstance(first, TracedValue) else self.trace.record("sin", self)

    def cosine(self) -> Operand:
        """Record the cosine of the value [rad], and return the traced result."""
        first = self.operands[0] if self.operation == "negative" else None
        return first.cosine() if isinstance(first, TracedValue) else self.trace.record("cos", self)

    def versine(self) -> Operand:
        """Record the versine, 1 - cos, of the value [rad], and return the traced result, which is accurate for small
        values too.
        """
        first = self.operands[0] if self.operation == "negative" else None
        if isinstance(first, TracedValue):
            return first.versine()
        return self.trace.record("versine", self, self.sine(), self.cosine())

    def __bool__(self) -> bool:
        raise TypeError("a traced value is neither true nor false: use `where`")


class Trace:
    """A recorder of operations on traced values. An operation that occurs several times is recorded once."""

    def __init__(self) -> None:
        self._recorded: dict[tuple[Any, ...], TracedValue] = {}

    def input(self, name: str, varies: bool = True) -> TracedValue:
        """Return a new traced value for an input, with this name in generated code. `varies` says whether the input
        differs from sample to sample.
        """
        return TracedValue(self, "input", (), varies, name)

    def record(self, operation: str, *operands: Operand) -> TracedValue:
        """Return the traced value of an operation, given by its name, such as "+" or "sqrt". The further positional
        arguments are its operands: traced values and numbers. The operation is recorded unless it has been recorded
        before; sums and products also count as recorded with their operands swapped.
        """
        key = (operation, *operands)
        value = self._recorded.get(key)
        if value is None and operation in {"+", "*"}:
            value = self._recorded.get((operation, operands[1], operands[0]))
        if value is None:
            varies = any(isinstance(operand, TracedValue) and operand.varies for operand in operands)
            value = self._recorded[key] = TracedValue(self, operation, operands, varies)
        return value


def needed_values(results: Iterable[Operand]) -> list[TracedValue]:
    """Return the list of traced values on which the results depend, inputs included, each after its operands."""
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
            waiting.extend((operand, False) for operand in reversed(value.operands))
    return needed


def operation_count(values: Iterable[TracedValue], varying: bool | None = None) -> int:
    """Return the number of operations among traced values. If `varying` is True, only operations whose values vary
    from sample to sample are counted; if it is False, only the others; if it is None, all.

    Args:
        values: values of a trace.
        varying: True counts only operations that vary from sample to sample, False only the others, None all.
    """
    return sum(v.operation != "input" and varying in {None, v.varies} for v in values)


def square_root(x: Any) -> Any:
    """Return the square root of a number or array x. For a traced value, record the operation and return its traced
    result.
    """
    if isinstance(x, TracedValue):
        return x.trace.record("sqrt", x)
    if isinstance(x, Sampled):
        return Sampled(square_root(x.value))
    return array_libraries.apply_function("square_root", x) if array_libraries.is_foreign(x) else np.sqrt(x)


def arc_tangent(y: Any, x: Any) -> Any:
    """Return the angle [rad] of the vector (x, y) from the x axis, for numbers or arrays. For traced values, record
    the operation and return its traced result.
    """
    return _apply_binary("arctan2", np.arctan2, y, x)


def hypotenuse(x: Any, y: Any) -> Any:
    """Return the square root of x^2 + y^2 without intermediate overflow, for numbers or arrays. For traced values,
    record the operation and return its traced result.
    """
    return _apply_binary("hypot", np.hypot, x, y)


def _apply_binary(operation: str, function: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
    """Return the value of `function`, a function of NumPy, at a and b. If one of them is a traced value, record the
    operation with the name `operation` instead and return its traced result.
    """
    if isinstance(a, TracedValue):
        return a.trace.record(operation, a, b)
    return b.trace.record(operation, a, b) if isinstance(b, TracedValue) else function(a, b)


def where_less(a: Any, b: Any, then: Any, otherwise: Any) -> Any:
    """Return `then` if a < b; otherwise, or if a or b is NaN, return `otherwise`. For arrays, choose element by
    element. For traced values, record the choice and return its traced result. If `then` and `otherwise` are tuples,
    return a tuple, component by component.
    """
    if isinstance(then, tuple):
        return tuple(where_less(a, b, x, y) for x, y in zip(then, otherwise, strict=True))
    for operand in (a, b):
        if isinstance(operand, TracedValue):
            return operand.trace.record("where", operand.trace.record("<", a, b), then, otherwise)
        if array_libraries.is_foreign(operand):
            return array_libraries.where_less(a, b, then, otherwise)
        if isinstance(operand, Sampled):
            return Sampled(where_less(*map(sampled_value, (a, b, then, otherwise))))
    if isinstance(a, Bounded) or isinstance(b, Bounded):
        return (b - a).where_above_0(then, otherwise)
    return np.where(a < b, then, otherwise)


# Suffixes of the names of components, by their number.
_NAME_SUFFIXES_BY_COMPONENT_COUNT: Final = {3: "xyz", 9: ("xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz")}


def component_name(name: str, k: int, count: int) -> str:
    """Return the name that component k of a result or input with `count` components has in generated code: `name`
    itself if count is 1, else `name` with a suffix such as _x or _1.
    """
    suffixes = _NAME_SUFFIXES_BY_COMPONENT_COUNT.get(count)
    return name if count == 1 else f"{name}_{suffixes[k] if suffixes else k + 1}"


def name_components(name: str, value: Any, labels: Sequence[str] | None = None) -> None:
    """Set in place the names that the traced components of a value, a scalar or a tuple, have in generated code. The
    names are `labels`, or `name` and a suffix if `labels` is None. Components that have a name already, and negated
    values, are skipped.
    """
    components = value if isinstance(value, tuple) else (value,)
    for k, component in enumerate(components):
        if isinstance(component, TracedValue) and not component.name and component.operation != "negative":
            component.name = labels[k] if labels else component_name(name, k, len(components))
