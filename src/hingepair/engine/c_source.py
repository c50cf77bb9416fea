"""A program as a function in C, for one state: what knows neither Python nor this package can call it."""

from __future__ import annotations

import functools
import itertools
import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from hingepair.engine.binding import NamedShapes
from hingepair.engine.interpreter import FUNCTIONS, interpreter
from hingepair.engine.loops import Program
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.blocks import VERSINE_SWITCH

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
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
        raise ArgumentError("name", "a name of a function in C, such as 'robot_tau'", quoted(name))
    traced, outputs = program.traced, program.loop.outputs
    needed = [one for one, _ in arguments if one in dict(program.loop.inputs)]
    inputs = [
        f"{_identifier(one)}[{k}]"
        for one, group in zip(needed, traced.arrays, strict=True)
        for k in range(len(group))
    ]
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
        found = interpreter([*traced.constants, *itertools.chain(*traced.arrays)], traced.results, written)
        results = iter(found.run(*map(float, numbers), *inputs))
    named = {one: f"{_identifier(one)}_out" if one in dict(arguments) else _identifier(one) for one, _ in outputs}
    for one, group in traced.outputs.items():
        lines += [
            f"{named[one]}[{k}] = {_text(part)};" for k, part in enumerate(itertools.islice(results, len(group)))
        ]
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
