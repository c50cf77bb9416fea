"""Python functions generated from a trace: of floats for one state, of arrays for many."""

from __future__ import annotations

import keyword
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from hingepair.engine.trace import Operand, TracedValue, needed_values, square_root
from hingepair.numeric.array_libraries import Library, is_foreign
from hingepair.numeric.blocks import VERSINE_SWITCH, cosine, sine, versine, versines

# Precedence of expressions in Python: a higher number binds more tightly.
_PRECEDENCES = {"+": 1, "-": 1, "*": 2, "/": 2}
_NEGATION, _ATOM = 3, 4


def function_source(name: str, inputs: Sequence[TracedValue], results: Sequence[Operand]) -> str:
    """Return the source of a Python function of the inputs that returns the results as one flat tuple.

    A value that is used once is written where it is used, unless its expression is long or it has a name. Characters
    that identifiers cannot have become underscores.
    """
    lines = needed_values(results)
    uses = Counter(id(one) for value in lines for one in value.operands)
    text: dict[int, tuple[str, int]] = {}
    names = _NameRegistry()
    for value in inputs:
        text[id(value)] = names.unused(value.name), _ATOM
    body = []
    for value in lines:
        if value.operation == "input":
            continue
        written = _expression(value, text)
        if value.name or uses[id(value)] > 1 or len(written[0]) > 300:  # Python nests 200 parentheses
            variable = names.unused(value.name or "t")
            body.append(f"    {variable} = {written[0]}")
            written = variable, _ATOM
        text[id(value)] = written
    arguments = _wrapped_list(f"def {identifier(name)}(", [text[id(value)][0] for value in inputs], "):")
    returned = [_operand_text(result, text)[0] for result in results]
    last_lines = _wrapped_list("    return (", returned, ",)" if len(returned) == 1 else ")")
    return "\n".join([*arguments, *body, *last_lines]) + "\n"


def compile_for_floats(name: str, source: str) -> Callable[..., tuple[Any, ...]]:
    """Return the function of a generated source for Python floats. Where Python raises an error (the sine of
    infinity, a division by zero), NumPy's numbers give the IEEE 754 result.
    """
    fast, safe = _compile_function(name, source, _FLOAT_FUNCTIONS), compile_for_arrays(name, source)

    def floats_function(*numbers: float) -> tuple[Any, ...]:
        """Return the results for Python floats."""
        try:
            return fast(*numbers)
        except (ValueError, ZeroDivisionError, OverflowError):
            with np.errstate(all="ignore"):
                return tuple(map(float, safe(*map(np.float64, numbers))))

    return floats_function


def compile_for_arrays(name: str, source: str) -> Callable[..., tuple[Any, ...]]:
    """Return the function of a generated source for NumPy arrays and numbers."""
    return _compile_function(name, source, _NUMPY_FUNCTIONS)


def compile_for_bounds(name: str, source: str) -> Callable[..., tuple[Any, ...]]:
    """Return the function of a generated source for numbers that carry a bound; the source may not have choices."""
    return _compile_function(name, source, {"sin": sine, "cos": cosine, "sqrt": square_root})


def compile_for_library(name: str, source: str, library: Library) -> Callable[..., tuple[Any, ...]]:
    """Return the function of a generated source for numbers and arrays of a library, which can differentiate it."""

    def library_or_float(numpy_name: str) -> Callable[..., Any]:
        """Return a function for arrays of the library, and for numbers."""
        numbers: Callable[..., Any] = _NUMPY_FUNCTIONS[numpy_name]
        arrays = getattr(library.namespace, numpy_name.replace("arctan2", "atan2"))  # array API's name

        def call(*operands: Any) -> Any:
            return arrays(*operands) if any(map(is_foreign, operands)) else float(numbers(*operands))

        return call

    def where(condition: Any, then: Any, otherwise: Any) -> Any:
        if not is_foreign(condition):
            return then if condition else otherwise
        return library.namespace.where(condition, library.array(then), library.array(otherwise))

    def versine_of(s: Any, c: Any) -> Any:
        """Return 1 - cos, without cancellation and with finite derivatives."""
        if not is_foreign(c):
            return versine(s, c)
        near = c > VERSINE_SWITCH
        # The denominator of the unused side is set to 1: a division by zero would make derivatives NaN.
        return where(near, s * s / where(near, 1.0 + c, 1.0), 1.0 - c)

    functions = {function: library_or_float(function) for function in ("sin", "cos", "sqrt", "arctan2", "hypot")}
    return _compile_function(name, source, {**functions, "where": where, "versine": versine_of})


def _compile_function(name: str, source: str, functions: dict[str, Any]) -> Callable[..., tuple[Any, ...]]:
    """Execute the source of a function, which calls `functions` by name, and return it."""
    scope: dict[str, Any] = {"nan": math.nan, "inf": math.inf, **functions}
    exec(compile(source, f"<hingepair: {name}>", "exec"), scope)
    function: Callable[..., tuple[Any, ...]] = scope[identifier(name)]
    return function


def identifier(name: str) -> str:
    """Convert a name to an identifier that differs from keywords and from functions that generated code calls.

    >>> identifier("arm-left.c d"), identifier("2nd"), identifier("lambda"), identifier("sin")
    ('arm_left_c_d', '_2nd', '_lambda', '_sin')
    """
    stem = re.sub(r"\W", "_", name, flags=re.ASCII)
    reserved = stem in _FLOAT_FUNCTIONS or stem in {"nan", "inf"}
    return f"_{stem}" if reserved or not stem.isidentifier() or keyword.iskeyword(stem) else stem


class _NameRegistry:
    """The identifiers that a generated source uses already."""

    def __init__(self) -> None:
        self._taken: set[str] = set()
        self._uses: Counter[str] = Counter()

    def unused(self, name: str) -> str:
        """Return an identifier made from a name, with a number where it is used already."""
        stem = identifier(name)
        unused = f"{stem}1" if stem == "t" else stem
        while unused in self._taken:
            self._uses[stem] += 1
            unused = f"{stem}{'' if stem == 't' else '_'}{self._uses[stem] + 1}"
        self._taken.add(unused)
        return unused


def _operand_text(operand: Operand, sources: dict[int, tuple[str, int]]) -> tuple[str, int]:
    """Return source and precedence of a traced value, by its id, or of a number."""
    if isinstance(operand, TracedValue):
        return sources[id(operand)]
    return repr(float(operand)), _ATOM if operand >= 0 else _NEGATION


def _expression(value: TracedValue, sources: dict[int, tuple[str, int]]) -> tuple[str, int]:
    """Return source and precedence of the operation of a traced value; `sources` are those of its operands by id."""
    parts = [_operand_text(one, sources) for one in value.operands]
    precedence = _PRECEDENCES.get(value.operation)
    if precedence is not None:
        (left, left_precedence), (right, right_precedence) = parts
        left = left if left_precedence >= precedence else f"({left})"
        right = right if right_precedence > precedence else f"({right})"
        return f"{left} {value.operation} {right}", precedence
    if value.operation == "negative":
        inner, precedence = parts[0]
        return f"-{inner}" if precedence >= _ATOM else f"-({inner})", _NEGATION
    if value.operation == "<":
        return f"{_parenthesise(parts[0], 1)} < {_parenthesise(parts[1], 1)}", 0
    # the versine is computed from sine and cosine, which are computed before it
    arguments = parts[1:] if value.operation == "versine" else parts
    return f"{value.operation}({', '.join(part for part, _ in arguments)})", _ATOM


def _parenthesise(part: tuple[str, int], precedence: int) -> str:
    return part[0] if part[1] >= precedence else f"({part[0]})"


def _wrapped_list(opening: str, items: Iterable[str], closing: str) -> list[str]:
    """Return lines of the opening text, the items separated by commas, and the closing text."""
    lines, indent = [opening], " " * (len(opening) - len(opening.lstrip()) + 4)
    for i, item in enumerate(items):
        piece = f", {item}" if i else item
        if len(lines[-1]) + len(piece) > 110:
            lines[-1] += "," if i else ""
            lines.append(indent + item)
        else:
            lines[-1] += piece
    lines[-1] += closing
    return lines


# Functions that generated code calls, for floats.
_FLOAT_FUNCTIONS: dict[str, Any] = {
    "sin": math.sin,
    "cos": math.cos,
    "versine": versine,
    "sqrt": math.sqrt,
    "arctan2": math.atan2,
    "hypot": math.hypot,
    "where": lambda condition, then, otherwise: then if condition else otherwise,
}
# The same for arrays.
_NUMPY_FUNCTIONS: dict[str, Any] = {
    "sin": np.sin,
    "cos": np.cos,
    "versine": versines,
    "sqrt": np.sqrt,
    "arctan2": np.arctan2,
    "hypot": np.hypot,
    "where": np.where,
}
