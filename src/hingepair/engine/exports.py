"""Programs for one state in other languages: as a function in C, and as a function of CasADi."""

from __future__ import annotations

import functools
import itertools
import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from hingepair.engine.binding import NamedShapes
from hingepair.engine.loops import FUNCTIONS, Program
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.blocks import VERSINE_SWITCH
from hingepair.numeric.optional import require

# Keywords of C, and the functions that are called or called first.
_RESERVED: Final = (
    "auto|break|case|char|const|continue|default|do|double|else|enum|extern|float|for|goto|if|inline|int|long|register|"
    "restrict|return|short|signed|sizeof|static|struct|switch|typedef|union|unsigned|void|volatile|while|"
    "main|sin|cos|sqrt|atan2|hypot"
)
_EXPRESSIONS: Final = {
    **{sign: f"{{}} {sign} {{}}" for sign in "+-*/<"},
    "negative": "-{}", "sin": "sin({})", "cos": "cos({})", "sqrt": "sqrt({})", "arctan2": "atan2({}, {})",
    "hypot": "hypot({}, {})", "where": "{} ? {} : {}",
    # 1 - cos of an angle from its sine and cosine
    "versine": f"{{1}} > {VERSINE_SWITCH} ? {{0}} * {{0}} / (1.0 + {{1}}) : 1.0 - {{1}}",
}  # fmt: skip


def c_source(
    name: str,
    program: Program,
    numbers: Sequence[float],
    arguments: NamedShapes,
    units: Mapping[str, str],
    title: str,
) -> str:
    """Return the source of a C function whose parameters are the arguments and then the outputs of a program.

    Args:
        name: name of the function.
        program: the program; its arrays are the arguments that it needs, in their order.
        numbers: its constants.
        arguments: names of the arguments, and the shape of one sample of each.
        units: units of arguments and outputs, by name.
        title: what the function computes, for its comment.

    Raises:
        ArgumentError: the name is no name in C.
    """
    if not isinstance(name, str) or not re.fullmatch(rf"(?!({_RESERVED})$)[A-Za-z]\w*", name, re.ASCII):
        raise ArgumentError("name", "a name of a function in C, such as 'robot_tau'", quoted(name))
    outputs, needed = program.loop.outputs, dict(program.loop.inputs)
    inputs = [f"{_identifier(one)}[{k}]" for one, tail in arguments if one in needed for k in range(math.prod(tail))]
    lines: list[str] = []

    def write(operation: str, *operands: str | float) -> str | float:
        """Return the name of a variable with a result; a number of numbers, which C would compute at each call."""
        if not any(isinstance(one, str) for one in operands):
            return float(FUNCTIONS[operation](*map(np.float64, operands)))
        name = f"_{len(lines)}"  # which is no name of an argument
        expression = _EXPRESSIONS[operation].format(*map(_text, operands))
        lines.append(f"const {'int' if operation == '<' else 'double'} {name} = {expression};")
        return name

    written = {operation: functools.partial(write, operation) for operation in FUNCTIONS}
    with np.errstate(all="ignore"):
        results = program.evaluated(numbers, inputs, written)
    named = {one: f"{_identifier(one)}_out" if one in dict(arguments) else _identifier(one) for one, _ in outputs}
    for one, parts in results.items():
        lines += [f"{named[one]}[{k}] = {_text(part)};" for k, part in enumerate(parts)]
    parameters = [f"const double *restrict {_identifier(one)}" for one, _ in arguments]
    parameters += [f"double *restrict {one}" for one in named.values()]
    comment = [title, ""]
    comment += [f"{_identifier(one)}{_shape(tail)}: {units[one]}" for one, tail in arguments]
    comment += [f"{named[one]}{_shape(tail)}: {units[one]}" for one, tail in outputs]
    return "\n".join([
        "/*", *(f" * {line}".rstrip() for line in comment), " */", "#include <math.h>", "",
        f"void {name}({', '.join(parameters)})", "{", textwrap.indent("\n".join(lines), "    "), "}", "",
    ])  # fmt: skip


def _text(x: str | float) -> str:
    """Return a name as it is, and a number as C writes it, exact to the last bit."""
    if isinstance(x, str):
        return x
    if math.isnan(x):
        return "NAN"
    if math.isinf(x):
        return "INFINITY" if x > 0 else "(-INFINITY)"
    return repr(float(x)) if math.copysign(1.0, x) > 0 else f"({float(x)!r})"


def _identifier(name: str) -> str:
    """Return a name of an argument or output as C accepts it."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def _shape(tail: tuple[int, ...]) -> str:
    """Return the length of an array, and how a matrix lies in it."""
    return f"[{math.prod(tail)}]" + (f", {' x '.join(map(str, tail))} by rows" if len(tail) > 1 else "")


# ---- CasADi


def casadi_function(name: str, program: Program, numbers: Sequence[float], arguments: NamedShapes) -> Any:
    """Return a `casadi.Function` whose parameters are the arguments and whose results are the outputs of a program.
    Vectors are columns; of what has more than two axes, the first are joined to rows.

    Args:
        name: name of the function.
        program: the program; its arrays are the arguments that it needs, in their order.
        numbers: its constants.
        arguments: names of the arguments, and the shape of one sample of each.
    """
    casadi = require("casadi", "f.casadi")

    def versine(sine: Any, cosine: Any) -> Any:
        return casadi.if_else(cosine > VERSINE_SWITCH, sine * sine / (1 + cosine), 1 - cosine)

    functions = {
        **FUNCTIONS, "versine": versine, "arctan2": casadi.atan2, "where": casadi.if_else,
        **{one: getattr(casadi, one) for one in ("sin", "cos", "sqrt", "hypot")},
    }  # fmt: skip
    symbols = {one: casadi.SX.sym(one, *_sizes(tail)) for one, tail in arguments}
    outputs, needed = program.loop.outputs, dict(program.loop.inputs)
    rows = [casadi.vertsplit(casadi.vec(symbols[one].T)) for one in symbols if one in needed]  # row by row
    found = program.evaluated([*map(casadi.SX, numbers)], itertools.chain(*rows), functions)
    results = [casadi.reshape(casadi.vertcat(*found[one]), *_sizes(tail)[::-1]).T for one, tail in outputs]
    names = [f"{one}_out" if one in symbols else one for one, _ in outputs]
    return casadi.Function(name, [*symbols.values()], results, [*symbols], names)


def _sizes(tail: tuple[int, ...]) -> tuple[int, int]:
    """Return the rows and columns of an array in CasADi."""
    return (math.prod(tail[:-1]), tail[-1]) if len(tail) > 1 else (math.prod(tail), 1)
