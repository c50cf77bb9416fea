"""Derivatives of what a loop computes of a pair or a robot, by its arguments.

A change of an attitude is a rotation about world axes: three numbers, not nine.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from hingepair.engine.binding import ArrayShape
from hingepair.engine.derivatives import jacobian, pullback, pushforward, weighted_sum
from hingepair.engine.loops import Loop
from hingepair.engine.trace import Operand
from hingepair.numeric.blocks import components
from hingepair.plans.changes import (
    Moves,
    change_of,
    change_shape,
    changes_of,
    share_of,
    sum_of,
    with_variables,
)
from hingepair.plans.trees import BODY_CONSTANTS, TreeForm, axes_shape, changes_of_bodies


class Derivative(NamedTuple):
    """What is differentiated, and how."""

    # "jacobian"; "vjp", gradients of a weighted sum of outputs; "jvp", the rates of change of all outputs
    kind: str
    outputs: tuple[str, ...]  # names of the outputs; of a vjp those with weights
    # arguments by which derivatives are taken, name and shape of one sample
    arguments: tuple[tuple[str, ArrayShape], ...]
    # as other libraries differentiate: attitudes change by their entries in place of rotations, and the outputs
    # themselves are left out
    entries: bool = False
    prefix: str = ""  # of the names of its changes and weights, where those of a derivative before it exist


def body_constants(joints: int, free: bool) -> dict[str, ArrayShape]:
    """Return the shapes of the constants of a robot by which outputs can be differentiated."""
    bodies = joints + free
    return {"masses": (bodies,), "first_moments": (bodies, 3), "inertias": (bodies, 6), "lengths": (joints, 3)}


@functools.lru_cache(maxsize=512)
def derivative_loop(plain: Loop, derivative: Derivative) -> Loop:
    """Return the loop that computes a derivative of what another loop computes. The Jacobian of tau by q is called
    tau_q, the weight of tau weight_tau, a gradient gradient_q, a change of q change_q, the rate of tau rate_tau.

    Args:
        plain: the other loop.
        derivative: the derivative.
    """
    changes = {name: change_shape(name, tail) for name, tail in (*plain.outputs, *derivative.arguments)}
    if derivative.entries:
        changes = dict((*plain.outputs, *derivative.arguments))
    inputs, names = dict(plain.inputs), [name for name, _ in derivative.arguments]
    if isinstance(plain.form, TreeForm) and not BODY_CONSTANTS.keys().isdisjoint(names):
        inputs["axes"] = axes_shape(plain.form.form)
    outputs = {} if derivative.entries else dict(plain.outputs)
    if derivative.kind == "jacobian":
        outputs = {f"{one}_{name}": (*changes[one], *changes[name]) for one in derivative.outputs for name in names}
        outputs |= {one: tail for one, tail in plain.outputs if one not in derivative.outputs}
    elif derivative.kind == "vjp":
        inputs |= {f"{derivative.prefix}weight_{one}": changes[one] for one in derivative.outputs}
        outputs |= {f"gradient_{name}": changes[name] for name in names}
    else:
        inputs |= {f"{derivative.prefix}change_{name}": changes[name] for name in names}
        outputs |= {f"rate_{one}": changes[one] for one in derivative.outputs}
    rule = {"jacobian": _jacobian, "vjp": _gradients, "jvp": _rates}
    function = functools.partial(rule[derivative.kind], plain, derivative)
    form = None if plain.form is None else (plain.form, derivative)
    return Loop("derivatives", function, inputs, outputs, form=form)


def _jacobian(plain: Loop, derivative: Derivative, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the outputs and the Jacobian of each by every argument."""
    values, moves = _variables(plain, given, derivative.arguments)
    results = _results(plain, values)
    rows = iter(jacobian(_flat(results, derivative.outputs), [*itertools.chain(*moves.values())]))
    found: dict[str, Any] = {}
    for output in derivative.outputs:
        parts = results[output]
        columns = zip(*itertools.islice(rows, len(parts)), strict=True)
        for name, changes in moves.items():
            block = [change_of(output, parts, column) for column in itertools.islice(columns, len(changes))]
            found[f"{output}_{name}"] = tuple(itertools.chain(*zip(*block, strict=True)))
    return {**results, **found}


def _gradients(plain: Loop, derivative: Derivative, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the outputs, and the gradient of their weighted sum by every argument."""
    values, moves = _variables(plain, given, derivative.arguments, derivative.entries)
    results = _results(plain, values)
    weights: dict[str, list[Operand]] = {}
    for output in derivative.outputs:
        parts, kind = results[output], "" if derivative.entries else output
        given_weights = components(values[f"{derivative.prefix}weight_{output}"])
        sums: list[Operand] = [0.0] * len(parts)
        weights[output] = sums
        for weight, change in zip(given_weights, changes_of(kind, parts), strict=True):
            for k, rate in change:
                sums[k] = sums[k] + weight * rate * share_of(kind)
    inputs = [x for change in itertools.chain(*moves.values()) for x, _ in change]
    pairs = zip(_flat(results, weights), itertools.chain(*weights.values()), strict=True)
    slopes = dict(zip(map(id, inputs), pullback(pairs, inputs), strict=True))
    gradients = {
        f"gradient_{name}": tuple(weighted_sum((slopes[id(x)], rate) for x, rate in change) for change in changes)
        for name, changes in moves.items()
    }
    return {**results, **gradients}


def _rates(plain: Loop, derivative: Derivative, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the outputs and their rates of change."""
    values, moves = _variables(plain, given, derivative.arguments, derivative.entries)
    changes = [
        (weight, change)
        for name, group in moves.items()
        for weight, change in zip(components(values[f"{derivative.prefix}change_{name}"]), group, strict=True)
    ]
    results = _results(plain, values)
    rates = iter(pushforward(_flat(results, derivative.outputs), sum_of(changes)))
    changed = {
        f"rate_{one}": tuple(
            change_of("" if derivative.entries else one, results[one], [*itertools.islice(rates, len(results[one]))])
        )
        for one in derivative.outputs
    }
    return {**results, **changed}


def _results(plain: Loop, values: dict[str, Any]) -> dict[str, Any]:
    """Return the components of a loop's outputs by name."""
    return {name: components(value) for name, value in plain.function(values).items()}


def _flat(results: Mapping[str, Sequence[Operand]], names: Iterable[str]) -> list[Operand]:
    return [part for name in names for part in results[name]]


def _variables(
    plain: Loop, given: Mapping[str, Any], arguments: Iterable[tuple[str, ArrayShape]], entries: bool = False
) -> tuple[dict[str, Any], Moves]:
    """Return the values with variables in the place of arguments, and the changes of the arguments."""
    values, arguments = dict(given), [*arguments]
    of_bodies = Moves()
    if "axes" in values:
        tree: Any = plain.form
        of_bodies = changes_of_bodies(tree, values, {name for name, _ in arguments})
    values, moves = with_variables(values, [one for one in arguments if one[0] not in of_bodies], entries)
    return values, of_bodies | moves
