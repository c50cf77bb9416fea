"""A program as a function of CasADi for one state: the operations of its trace on CasADi's symbols."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from hingepair.engine.binding import NamedShapes
from hingepair.engine.interpreter import FUNCTIONS, interpreter
from hingepair.engine.loops import Program
from hingepair.numeric.blocks import VERSINE_SWITCH
from hingepair.numeric.optional import require


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
    traced, outputs = program.traced, program.loop.outputs
    needed = [one for one, _ in arguments if one in dict(program.loop.inputs)]
    values = [casadi.SX(x) for x in numbers]
    for one in needed:
        values += casadi.vertsplit(casadi.vec(symbols[one].T))  # row by row
    inputs = [*traced.constants, *(part for group in traced.arrays for part in group)]
    parts = iter(interpreter(inputs, traced.results, functions).run(*values))
    results = []
    for _, tail in outputs:
        rows, columns = _sizes(tail)
        flat = casadi.vertcat(*(next(parts) for _ in range(rows * columns)))
        results.append(casadi.reshape(flat, columns, rows).T)
    names = [f"{one}_out" if one in symbols else one for one, _ in outputs]
    return casadi.Function(name, [*symbols.values()], results, [*symbols], names)


def _sizes(tail: tuple[int, ...]) -> tuple[int, int]:
    """Return the rows and columns of an array in CasADi."""
    return (math.prod(tail[:-1]), tail[-1]) if len(tail) > 1 else (math.prod(tail), 1)
