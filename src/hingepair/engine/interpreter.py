"""Traces that are run without a compiler: one operation after the other, on numbers or arrays of NumPy."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.engine.trace import Operand, TracedValue, needed_values
from hingepair.numeric.blocks import versines

FUNCTIONS: Final[Mapping[str, Callable[..., Any]]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "negative": operator.neg,
    "<": operator.lt,
    "sin": np.sin,
    "cos": np.cos,
    "versine": versines,
    "sqrt": np.sqrt,
    "arctan2": np.arctan2,
    "hypot": np.hypot,
    "where": np.where,
}


class Interpreter(NamedTuple):
    """A program as a function of its inputs, numbers or arrays of NumPy, that returns the results."""

    run: Callable[..., list[Any]]
    width: int  # how many values it holds at a time, about


def interpreter(
    inputs: Sequence[TracedValue],
    results: Sequence[Operand],
    functions: Mapping[str, Callable[..., Any]] = FUNCTIONS,
) -> Interpreter:
    """Return the function of a trace; `functions` compute its operations.

    A register holds each value until its last use, and then another one: a block's arrays stay in the cache.
    """
    lines = [value for value in needed_values(results) if value.operation != "input"]
    # The versine is computed from the sine and the cosine, which are recorded before it.
    operands = {id(v): v.operands[v.operation == "versine" :] for v in lines}
    last = {id(one): k for k, value in enumerate(lines) for one in operands[id(value)]}
    last |= {id(one): len(lines) for one in results}
    registers: list[Any] = [None] * len(inputs)
    places = {id(value): k for k, value in enumerate(inputs)}
    free: list[int] = []
    program: list[tuple[Callable[..., Any], int, Callable[[Any], Any], bool]] = []

    def place_of(one: Operand) -> int:
        """Return the register of a value, or of a number, which has one of its own."""
        if isinstance(one, TracedValue):
            return places[id(one)]
        registers.append(float(one))
        return len(registers) - 1

    for k, value in enumerate(lines):
        own = operands[id(value)]
        read = tuple(map(place_of, own))
        free += {places[id(one)] for one in own if isinstance(one, TracedValue) and last[id(one)] == k}
        if not free:
            registers.append(None)
            free.append(len(registers) - 1)
        places[id(value)] = free.pop()
        program.append((functions[value.operation], places[id(value)], operator.itemgetter(*read), len(read) == 1))
    ends, rest = [*map(place_of, results)], registers[len(inputs) :]

    def run(*given: Any) -> list[Any]:
        values = [*given, *rest]
        for function, target, operands_of, is_single in program:
            values[target] = function(operands_of(values)) if is_single else function(*operands_of(values))
        return [values[k] for k in ends]

    return Interpreter(run, len(registers))
