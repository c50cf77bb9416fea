"""Derivatives of what a loop computes of a pair or a robot, by its arguments.

A change of an attitude is a rotation about world axes: three numbers, not nine.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

from hingepair.engine.binding import ArrayShape
from hingepair.engine.derivatives import Change, jacobian, pullback, pushforward, variables, weighted_sum
from hingepair.engine.loops import Loop
from hingepair.engine.trace import Operand
from hingepair.numeric.blocks import components

Flat: TypeAlias = Mapping[str, tuple[Any, ...]]
"""Components of outputs by name."""

Moves: TypeAlias = dict[str, list[Change]]
"""Changes by argument, one for each component of a change of it."""

_ATTITUDES: Final = frozenset({"S", "S1", "S2"})


class Derivative(NamedTuple):
    """What is differentiated, and how.

    Attributes:
        kind: "jacobian"; "vjp", gradients of a weighted sum of outputs; "jvp", the rates of change of all outputs.
        outputs: names of the outputs; of a vjp those with weights.
        arguments: arguments by which derivatives are taken, name and shape of one sample.
    """

    kind: str
    outputs: tuple[str, ...]
    arguments: tuple[tuple[str, ArrayShape], ...]


def change_shape(name: str, sample_shape: ArrayShape) -> ArrayShape:
    """Return the shape of a change of one sample of an argument or output.

    >>> change_shape("S", (2, 3, 3)), change_shape("q", (7,))
    ((2, 3), (7,))
    """
    return sample_shape[:-1] if name in _ATTITUDES else sample_shape


@functools.lru_cache(maxsize=512)
def derivative_loop(plain: Loop, derivative: Derivative) -> Loop:
    """Return the loop that computes a derivative of what another loop computes. The Jacobian of tau by q is called
    tau_q, the weight of tau weight_tau, a gradient gradient_q, a change of q change_q, the rate of tau rate_tau.
    """
    changes = {name: change_shape(name, tail) for name, tail in (*plain.outputs, *derivative.arguments)}
    inputs, names = dict(plain.inputs), [name for name, _ in derivative.arguments]
    outputs = dict(plain.outputs)
    if derivative.kind == "jacobian":
        outputs = {f"{one}_{name}": (*changes[one], *changes[name]) for one in derivative.outputs for name in names}
        outputs |= {one: tail for one, tail in plain.outputs if one not in derivative.outputs}
    elif derivative.kind == "vjp":
        inputs |= {f"weight_{one}": changes[one] for one in derivative.outputs}
        outputs |= {f"gradient_{name}": changes[name] for name in names}
    else:
        inputs |= {f"change_{name}": changes[name] for name in names}
        outputs |= {f"rate_{one}": changes[one] for one in derivative.outputs}
    function = functools.partial(_differentiate, plain.function, derivative)
    form = None if plain.form is None else (plain.form, derivative)
    return Loop("derivatives", function, inputs, outputs, labels=plain.labels, form=form)


def _differentiate(
    function: Callable[[dict[str, Any]], Mapping[str, Any]], derivative: Derivative, values: Mapping[str, Any]
) -> dict[str, Any]:
    values = dict(values)
    moves: Moves = {}
    for name, tail in derivative.arguments:
        if name in values:
            others = [x for other, group in values.items() if other != name for x in components(group)]
            parts = variables(components(values[name]), others)
            values[name] = parts if tail else parts[0]
            moves[name] = [[(parts[k], rate) for k, rate in change] for change in _changes(name, parts)]
        else:  # no output depends on it
            moves[name] = [[] for _ in range(math.prod(change_shape(name, tail)))]
    results = function(dict(values))
    flat = {name: components(results[name]) for name in derivative.outputs}
    rule = {"jacobian": _jacobian, "vjp": _gradients, "jvp": _rates}[derivative.kind]
    return {**results, **rule(flat, moves, values)}


def _jacobian(flat: Flat, moves: Moves, _: Mapping[str, Any]) -> dict[str, Any]:
    """Return the Jacobian of every output by every argument."""
    rows = iter(jacobian([part for parts in flat.values() for part in parts], [*itertools.chain(*moves.values())]))
    found = {}
    for output, parts in flat.items():
        columns = zip(*(next(rows) for _ in parts), strict=True)
        for name, changes in moves.items():
            block = [_change_of(output, parts, column) for column in itertools.islice(columns, len(changes))]
            found[f"{output}_{name}"] = tuple(itertools.chain(*zip(*block, strict=True)))
    return found


def _gradients(flat: Flat, moves: Moves, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the gradient of the weighted sum of the outputs by every argument."""
    pairs = []
    for output, parts in flat.items():
        weights = components(values[f"weight_{output}"])
        for weight, change in zip(weights, _changes(output, parts), strict=True):
            pairs += [(parts[k], weight * rate * _share(output)) for k, rate in change]
    inputs = [x for change in itertools.chain(*moves.values()) for x, _ in change]
    slopes = dict(zip(map(id, inputs), pullback(pairs, inputs), strict=True))
    return {
        f"gradient_{name}": tuple(weighted_sum((slopes[id(x)], rate) for x, rate in change) for change in changes)
        for name, changes in moves.items()
    }


def _rates(flat: Flat, moves: Moves, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the rates of change of all outputs."""
    sums: dict[int, tuple[Operand, Operand]] = {}
    for name, changes in moves.items():
        for weight, change in zip(components(values[f"change_{name}"]), changes, strict=True):
            for x, rate in change:
                sums[id(x)] = x, sums.get(id(x), (x, 0.0))[1] + weight * rate
    rates = iter(pushforward([part for parts in flat.values() for part in parts], [*sums.values()]))
    return {
        f"rate_{output}": tuple(_change_of(output, parts, [next(rates) for _ in parts]))
        for output, parts in flat.items()
    }


def _changes(name: str, value: Sequence[Operand]) -> list[list[tuple[int, Operand]]]:
    """Return for each component of a change of a value which components of the value change, and how fast."""
    if name not in _ATTITUDES:
        return [[(k, 1.0)] for k in range(len(value))]
    changes = []
    for first in range(0, len(value), 9):
        for k in range(3):  # a rotation about the k-th axis turns row a into row b, and row b into -a
            a, b = first + 3 * ((k + 1) % 3), first + 3 * ((k + 2) % 3)
            changes.append([(b + j, value[a + j]) for j in range(3)] + [(a + j, -value[b + j]) for j in range(3)])
    return changes


def _change_of(name: str, value: Sequence[Operand], rates: Sequence[Operand]) -> list[Operand]:
    """Return the components of the change of an output from the rates of its components."""
    return [weighted_sum((rates[k], rate) for k, rate in change) * _share(name) for change in _changes(name, value)]


def _share(name: str) -> float:
    return 0.5 if name in _ATTITUDES else 1.0  # a rotation is read off two rows
