"""A program as a function in C, for one state: what knows neither Python nor this package can call it."""

from __future__ import annotations

import itertools
import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from hingepair.engine.binding import NamedShapes
from hingepair.engine.interpreter import interpreter
from hingepair.engine.loops import Program
from hingepair.engine.trace import Operand, TracedValue, needed_values
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
    values = needed_values(traced.results)
    # What depends on constants alone is a number; else it would be computed at each call.
    still = [value for value in values if not value.varies]
    with np.errstate(all="ignore"):
        known = interpreter(traced.constants, still).run(*map(np.float64, numbers))
    texts = dict(zip(map(id, still), map(_number, known), strict=True))
    needed = [one for one, _ in arguments if one in dict(program.loop.inputs)]
    names = {
        id(part): f"{_identifier(one)}[{k}]"
        for one, group in zip(needed, traced.arrays, strict=True)
        for k, part in enumerate(group)
    }
    lines, count = [], itertools.count()

    def text(one: Operand) -> str:
        return texts[id(one)] if isinstance(one, TracedValue) else _number(one)

    for value in values:
        if id(value) in texts:
            continue
        if value.operation == "input":
            expression = names[id(value)]
        else:
            operands = value.operands[value.operation == "versine" :]  # its sine and cosine stand behind the angle
            expression = _EXPRESSIONS[value.operation].format(*map(text, operands))
        texts[id(value)] = f"_{next(count)}"  # which is no name of an argument
        lines.append(f"const {'int' if value.operation == '<' else 'double'} {texts[id(value)]} = {expression};")
    named = {one: f"{_identifier(one)}_out" if one in dict(arguments) else _identifier(one) for one, _ in outputs}
    for one, group in traced.outputs.items():
        lines += [f"{named[one]}[{k}] = {text(part)};" for k, part in enumerate(group)]
    parameters = [f"const double *restrict {_identifier(one)}" for one, _ in arguments]
    parameters += [f"double *restrict {one}" for one in named.values()]
    comment = [title, ""]
    comment += [f"{_identifier(one)}{_shape(tail)}: {units[one]}" for one, tail in arguments]
    comment += [f"{named[one]}{_shape(tail)}: {units[one]}" for one, tail in outputs]
    return "\n".join([
        "/*", *(f" * {line}".rstrip() for line in comment), " */", "#include <math.h>", "",
        f"void {name}({', '.join(parameters)})", "{", textwrap.indent("\n".join(lines), "    "), "}", "",
    ])  # fmt: skip


def _number(x: float) -> str:
    """Return a number as C writes it, exact to the last bit."""
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
