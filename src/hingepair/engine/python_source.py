"""Python functions generated from a trace: of floats for one state, of arrays for many."""

from __future__ import annotations

import keyword
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from hingepair.engine.trace import Operand, TracedValue, needed_values
from hingepair.numeric.array_libraries import Library, is_foreign
from hingepair.numeric.blocks import MIN_COSINE_TO_COMPUTE_VERSINE_FROM_SINE, versine, versines

_MAX_CHARACTERS_PER_LINE_OF_ARGUMENTS_OR_RESULTS = 110  # in generated source
# Number of characters of an expression beyond which its value gets a name: Python nests 200 parentheses at most.
_MAX_CHARACTERS_OF_UNNAMED_EXPRESSION = 300
# Precedence of expressions in Python: a higher number binds more tightly.
_PRECEDENCE_BY_OPERATOR = {"+": 1, "-": 1, "*": 2, "/": 2}
_NEGATION_PRECEDENCE, _ATOM_PRECEDENCE = 3, 4


def function_source(name: str, inputs: Sequence[TracedValue], results: Sequence[Operand]) -> str:
    """Return the source of a Python function with this name that takes the traced inputs and returns the traced
    results, each computed from the inputs, as one flat tuple.

    A value that is used once is written where it is used, unless its expression is long or it has a name. Names may
    be any text: characters that are not allowed in an identifier are replaced by underscores.
    """
    lines = needed_values(results)
    uses = Counter(id(one) for value in lines for one in value.operands)
    text: dict[int, tuple[str, int]] = {}
    names = _NameRegistry()
    for value in inputs:
        text[id(value)] = names.unused(value.name), _ATOM_PRECEDENCE
    body = []
    for value in lines:
        if value.operation == "input":
            continue
        written = _expression(value, text)
        if value.name or uses[id(value)] > 1 or len(written[0]) > _MAX_CHARACTERS_OF_UNNAMED_EXPRESSION:
            variable = names.unused(value.name or "t")
            body.append(f"    {variable} = {written[0]}")
            written = variable, _ATOM_PRECEDENCE
        text[id(value)] = written
    arguments = _wrapped_list(f"def {identifier(name)}(", [text[id(value)][0] for value in inputs], "):")
    returned = [_operand_text(result, text)[0] for result in results]
    last_lines = _wrapped_list("    return (", returned, ",)" if len(returned) == 1 else ")")
    return "\n".join([*arguments, *body, *last_lines]) + "\n"


def compile_for_floats(name: str, source: str) -> Callable[..., tuple[Any, ...]]:
    """Execute the source of the function with this name, and return the function for Python floats. The function
    returns a tuple of floats and never raises an arithmetic error.

    Where Python raises an error (the sine of infinity, a division by zero), NumPy's numbers give the IEEE 754 result.
    """
    fast, safe = _compile_function(name, source, _FLOAT_FUNCTION_BY_OPERATION_NAME), compile_for_arrays(name, source)

    def floats_function(*numbers: float) -> tuple[Any, ...]:
        """Return the tuple of results for Python floats, computed with NumPy's numbers if Python raises an arithmetic
        error.
        """
        try:
            return fast(*numbers)
        except (ValueError, ZeroDivisionError, OverflowError):
            with np.errstate(all="ignore"):
                return tuple(map(float, safe(*map(np.float64, numbers))))

    return floats_function


def compile_for_arrays(name: str, source: str) -> Callable[..., tuple[Any, ...]]:
    """Execute the source of the function with this name, and return the function for NumPy arrays and numbers. The
    function returns a tuple of arrays and numbers.
    """
    return _compile_function(name, source, _NUMPY_FUNCTION_BY_OPERATION_NAME)


def compile_for_library(name: str, source: str, library: Library) -> Callable[..., tuple[Any, ...]]:
    """Execute the source of the function with this name, and return the function for numbers and arrays of another
    array library, which can differentiate the function. The function returns a tuple.
    """

    def library_or_float(numpy_name: str) -> Callable[..., Any]:
        """Return a function that calls the library's function for arrays of the library and NumPy's function for
        numbers. The result for numbers is converted to a float.
        """
        numbers: Callable[..., Any] = _NUMPY_FUNCTION_BY_OPERATION_NAME[numpy_name]
        arrays = getattr(library.namespace, _ARRAY_API_FUNCTION_NAME_BY_NUMPY_NAME.get(numpy_name, numpy_name))

        def call(*operands: Any) -> Any:
            return arrays(*operands) if any(map(is_foreign, operands)) else float(numbers(*operands))

        return call

    def where(condition: Any, then: Any, otherwise: Any) -> Any:
        if not is_foreign(condition):
            return then if condition else otherwise
        return library.namespace.where(condition, library.array(then), library.array(otherwise))

    def versine_of(s: Any, c: Any) -> Any:
        """Return 1 - cos computed from the sine s and the cosine c, without cancellation and with finite
        derivatives.
        """
        if not is_foreign(c):
            return versine(s, c)
        near = c > MIN_COSINE_TO_COMPUTE_VERSINE_FROM_SINE
        # The denominator of the unused side is set to 1: a division by zero would make derivatives NaN.
        return where(near, s * s / where(near, 1.0 + c, 1.0), 1.0 - c)

    functions = {function: library_or_float(function) for function in ("sin", "cos", "sqrt", "arctan2", "hypot")}
    return _compile_function(name, source, {**functions, "where": where, "versine": versine_of})


def _compile_function(name: str, source: str, functions: dict[str, Any]) -> Callable[..., tuple[Any, ...]]:
    """Execute the source of a function, and return the function with this name. `functions` are the functions that
    the source calls, by name.
    """
    scope: dict[str, Any] = {"nan": math.nan, "inf": math.inf, **functions}
    exec(compile(source, f"<hingepair: {name}>", "exec"), scope)
    function: Callable[..., tuple[Any, ...]] = scope[identifier(name)]
    return function


def identifier(name: str) -> str:
    """Convert a name to a Python identifier that differs from keywords and from functions that generated code calls.

    >>> identifier("arm-left.c d"), identifier("2nd"), identifier("lambda"), identifier("sin")
    ('arm_left_c_d', '_2nd', '_lambda', '_sin')
    """
    stem = re.sub(r"\W", "_", name, flags=re.ASCII)
    reserved = stem in _FLOAT_FUNCTION_BY_OPERATION_NAME or stem in {"nan", "inf"}
    return f"_{stem}" if reserved or not stem.isidentifier() or keyword.iskeyword(stem) else stem


class _NameRegistry:
    """A registry of the identifiers that a generated source uses already."""

    def __init__(self) -> None:
        self._taken: set[str] = set()
        self._uses: Counter[str] = Counter()

    def unused(self, name: str) -> str:
        """Register and return an identifier made from a name, with a number added if the identifier is used
        already.
        """
        stem = identifier(name)
        unused = f"{stem}1" if stem == "t" else stem
        while unused in self._taken:
            self._uses[stem] += 1
            unused = f"{stem}{'' if stem == 't' else '_'}{self._uses[stem] + 1}"
        self._taken.add(unused)
        return unused


def _operand_text(operand: Operand, source_by_id: dict[int, tuple[str, int]]) -> tuple[str, int]:
    """Return the pair (Python source, precedence) of a traced value or number. `source_by_id` holds these pairs by
    the identity of the traced values.
    """
    if isinstance(operand, TracedValue):
        return source_by_id[id(operand)]
    return repr(float(operand)), _ATOM_PRECEDENCE if operand >= 0 else _NEGATION_PRECEDENCE


def _expression(value: TracedValue, source_by_id: dict[int, tuple[str, int]]) -> tuple[str, int]:
    """Return the pair (Python source, precedence) of the operation of a traced value. `source_by_id` holds these
    pairs by the identity of its operands.
    """
    parts = [_operand_text(one, source_by_id) for one in value.operands]
    precedence = _PRECEDENCE_BY_OPERATOR.get(value.operation)
    if precedence is not None:
        (left, left_precedence), (right, right_precedence) = parts
        left = left if left_precedence >= precedence else f"({left})"
        right = right if right_precedence > precedence else f"({right})"
        return f"{left} {value.operation} {right}", precedence
    if value.operation == "negative":
        inner, precedence = parts[0]
        return f"-{inner}" if precedence >= _ATOM_PRECEDENCE else f"-({inner})", _NEGATION_PRECEDENCE
    if value.operation == "<":
        return f"{_parenthesise(parts[0], 1)} < {_parenthesise(parts[1], 1)}", 0
    # the versine is computed from sine and cosine, which are computed before it
    arguments = parts[1:] if value.operation == "versine" else parts
    return f"{value.operation}({', '.join(part for part, _ in arguments)})", _ATOM_PRECEDENCE


def _parenthesise(part: tuple[str, int], precedence: int) -> str:
    """Return the source of `part`, a pair (Python source, its precedence), in parentheses if the precedence of the
    part is below `precedence`.
    """
    return part[0] if part[1] >= precedence else f"({part[0]})"


def _wrapped_list(opening: str, items: Iterable[str], closing: str) -> list[str]:
    """Return the list of source lines that contain the opening text, the items separated by commas, and the closing
    text. The lines are wrapped at a maximum length.
    """
    lines, indent = [opening], " " * (len(opening) - len(opening.lstrip()) + 4)
    for i, item in enumerate(items):
        piece = f", {item}" if i else item
        if len(lines[-1]) + len(piece) > _MAX_CHARACTERS_PER_LINE_OF_ARGUMENTS_OR_RESULTS:
            lines[-1] += "," if i else ""
            lines.append(indent + item)
        else:
            lines[-1] += piece
    lines[-1] += closing
    return lines


# Functions that generated code calls for Python floats, by name.
_FLOAT_FUNCTION_BY_OPERATION_NAME: dict[str, Any] = {
    "sin": math.sin,
    "cos": math.cos,
    "versine": versine,
    "sqrt": math.sqrt,
    "arctan2": math.atan2,
    "hypot": math.hypot,
    "where": lambda condition, then, otherwise: then if condition else otherwise,
}
# Functions that generated code calls for NumPy arrays, by name.
_NUMPY_FUNCTION_BY_OPERATION_NAME: dict[str, Any] = {
    "sin": np.sin,
    "cos": np.cos,
    "versine": versines,
    "sqrt": np.sqrt,
    "arctan2": np.arctan2,
    "hypot": np.hypot,
    "where": np.where,
}
_ARRAY_API_FUNCTION_NAME_BY_NUMPY_NAME = {"arctan2": "atan2"}
"""Names of functions in the array API standard, where they differ from NumPy's."""
