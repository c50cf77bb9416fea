"""A trace written out as a Python function: of one state in floats, or of many in NumPy arrays."""

from __future__ import annotations

import keyword
import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from hingepair.engine.trace import Operand, Value, needed_values
from hingepair.numeric.array_libraries import Library, is_foreign
from hingepair.numeric.blocks import SMALL, versine, versines

_WIDTH = 110  # characters of a line of arguments or results
_MAX_EXPRESSION = 300  # characters past which an expression gets a name: Python nests 200 brackets at most
_INFIX = {"+": 1, "-": 1, "*": 2, "/": 2}
_NEGATIVE, _ATOM = 3, 4


def source_of(name: str, inputs: Sequence[Value], results: Sequence[Operand]) -> str:
    """Return the source of a function of the inputs that returns the results as one flat tuple.

    What is used once stands where it is used, unless it is long or has a name of its own. Names may be any text: what
    no identifier of Python can hold is replaced by underscores.
    """
    lines = needed_values(results)
    uses = Counter(id(one) for value in lines for one in value.operands)
    text: dict[int, tuple[str, int]] = {}
    names = _Names()
    for value in inputs:
        text[id(value)] = names.of(value.name), _ATOM
    body = []
    for value in lines:
        if value.operation == "input":
            continue
        written = _expression(value, text)
        if value.name or uses[id(value)] > 1 or len(written[0]) > _MAX_EXPRESSION:
            variable = names.of(value.name or "t")
            body.append(f"    {variable} = {written[0]}")
            written = variable, _ATOM
        text[id(value)] = written
    arguments = _list(f"def {identifier(name)}(", [text[id(value)][0] for value in inputs], "):")
    returned = [_text(result, text)[0] for result in results]
    return (
        "\n".join([*arguments, *body, *_list("    return (", returned, ",)" if len(returned) == 1 else ")")]) + "\n"
    )


def for_floats(name: str, source: str) -> Callable[..., tuple[Any, ...]]:
    """Compile a source into a function of Python floats.

    Where Python raises (the sine of infinity, a division by zero) NumPy's numbers give what IEEE 754 says.
    """
    quick, safe = _compile(name, source, _OF_FLOATS), for_arrays(name, source)

    def function(*numbers: float) -> tuple[Any, ...]:
        try:
            return quick(*numbers)
        except (ValueError, ZeroDivisionError, OverflowError):
            with np.errstate(all="ignore"):
                return tuple(map(float, safe(*map(np.float64, numbers))))

    return function


def for_arrays(name: str, source: str) -> Callable[..., tuple[Any, ...]]:
    """Compile a source into a function of NumPy arrays and numbers."""
    return _compile(name, source, _OF_ARRAYS)


def for_library(name: str, source: str, library: Library) -> Callable[..., tuple[Any, ...]]:
    """Compile a source into a function of arrays of another library and numbers; all of it has derivatives."""

    def library_or_float(function: str) -> Callable[..., Any]:
        numbers: Callable[..., Any] = _OF_ARRAYS[function]
        arrays = getattr(library.namespace, _STANDARD.get(function, function))

        def call(*given: Any) -> Any:
            return arrays(*given) if any(map(is_foreign, given)) else float(numbers(*given))

        return call

    def where(condition: Any, then: Any, otherwise: Any) -> Any:
        if not is_foreign(condition):
            return then if condition else otherwise
        return library.namespace.where(condition, library.array(then), library.array(otherwise))

    def versine_of(s: Any, c: Any) -> Any:
        if not is_foreign(c):
            return versine(s, c)
        near = c > SMALL
        # The denominator that is not used is 1: a division by zero would make derivatives NaN.
        return where(near, s * s / where(near, 1.0 + c, 1.0), 1.0 - c)

    functions = {function: library_or_float(function) for function in ("sin", "cos", "sqrt", "arctan2", "hypot")}
    return _compile(name, source, {**functions, "where": where, "versine": versine_of})


def _compile(name: str, source: str, functions: dict[str, Any]) -> Callable[..., tuple[Any, ...]]:
    scope: dict[str, Any] = {"nan": math.nan, "inf": math.inf, **functions}
    exec(compile(source, f"<hingepair: {name}>", "exec"), scope)
    function: Callable[..., tuple[Any, ...]] = scope[identifier(name)]
    return function


def identifier(name: str) -> str:
    """Return an identifier of Python that is like a name, and none that generated code uses itself.

    >>> identifier("arm-left.c d"), identifier("2nd"), identifier("lambda"), identifier("sin")
    ('arm_left_c_d', '_2nd', '_lambda', '_sin')
    """
    stem = re.sub(r"\W", "_", name, flags=re.ASCII)
    own = stem in _OF_FLOATS or stem in {"nan", "inf"}
    return f"_{stem}" if own or not stem.isidentifier() or keyword.iskeyword(stem) else stem


class _Names:
    """A dispenser of identifiers that no two values share."""

    def __init__(self) -> None:
        self._taken: set[str] = set()
        self._uses: Counter[str] = Counter()

    def of(self, wish: str) -> str:
        """Return an identifier made of a name: the name itself, or with a number."""
        stem = identifier(wish)
        name = f"{stem}1" if stem == "t" else stem
        while name in self._taken:
            self._uses[stem] += 1
            name = f"{stem}{'' if stem == 't' else '_'}{self._uses[stem] + 1}"
        self._taken.add(name)
        return name


def _text(one: Operand, text: dict[int, tuple[str, int]]) -> tuple[str, int]:
    if isinstance(one, Value):
        return text[id(one)]
    return repr(float(one)), _ATOM if one >= 0 else _NEGATIVE


def _expression(value: Value, text: dict[int, tuple[str, int]]) -> tuple[str, int]:
    """Return an operation as Python writes it, and its precedence."""
    parts = [_text(one, text) for one in value.operands]
    binding = _INFIX.get(value.operation)
    if binding is not None:
        (left, l_binding), (right, r_binding) = parts
        left = left if l_binding >= binding else f"({left})"
        right = right if r_binding > binding else f"({right})"
        return f"{left} {value.operation} {right}", binding
    if value.operation == "negative":
        inner, strength = parts[0]
        return f"-{inner}" if strength >= _ATOM else f"-({inner})", _NEGATIVE
    if value.operation == "<":
        return f"{_bracketed(parts[0], 1)} < {_bracketed(parts[1], 1)}", 0
    # 1 - cos x is had from sine and cosine, which are there already
    arguments = parts[1:] if value.operation == "versine" else parts
    return f"{value.operation}({', '.join(part for part, _ in arguments)})", _ATOM


def _bracketed(part: tuple[str, int], binding: int) -> str:
    return part[0] if part[1] >= binding else f"({part[0]})"


def _list(opening: str, parts: Iterable[str], closing: str) -> list[str]:
    """Return an opening, parts separated by commas and a closing, broken into lines."""
    lines, indent = [opening], " " * (len(opening) - len(opening.lstrip()) + 4)
    for i, part in enumerate(parts):
        piece = f", {part}" if i else part
        if len(lines[-1]) + len(piece) > _WIDTH:
            lines[-1] += "," if i else ""
            lines.append(indent + part)
        else:
            lines[-1] += piece
    lines[-1] += closing
    return lines


_OF_FLOATS: dict[str, Any] = {
    "sin": math.sin,
    "cos": math.cos,
    "versine": versine,
    "sqrt": math.sqrt,
    "arctan2": math.atan2,
    "hypot": math.hypot,
    "where": lambda condition, then, otherwise: then if condition else otherwise,
}
_OF_ARRAYS: dict[str, Any] = {
    "sin": np.sin,
    "cos": np.cos,
    "versine": versines,
    "sqrt": np.sqrt,
    "arctan2": np.arctan2,
    "hypot": np.hypot,
    "where": np.where,
}
_STANDARD = {"arctan2": "atan2"}
"""What the array API standard calls a function, where it has another name."""
