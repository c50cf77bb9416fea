"""Derivatives of what a trace holds, recorded in the same trace: forwards by inputs, backwards from results.

At an edge of a choice (`where_less`), the derivative is that of the branch taken. Where a function has none, as a
root or `hypotenuse` at 0 and `arc_tangent` of (0, 0), it is infinite or NaN, and a NaN has the derivative NaN.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import TypeAlias

from hingepair.engine.trace import Operand, Trace, TracedValue, hypotenuse, needed_values, where_less
from hingepair.numeric.caching import lock_free_cached_property

Change: TypeAlias = Sequence[tuple[Operand, Operand]]
"""Pairs (input, its rate of change)."""

_SUMS = frozenset({"+", "-", "negative"})  # operations with slopes of 1 and -1


def variables(values: Sequence[Operand], others: Iterable[Operand] = ()) -> tuple[TracedValue, ...]:
    """Return values by which derivatives are taken. Known numbers, which would fold, and values that occur twice or
    among others become traced values of their own.
    """
    trace, times = Trace(), Counter(map(id, (*values, *others)))

    def variable(value: Operand) -> TracedValue:
        if isinstance(value, TracedValue):
            return value if times[id(value)] == 1 else TracedValue(trace, "+", (value, 0.0))
        return TracedValue(trace, "+", (value, 0.0))

    return tuple(map(variable, values))


class Solution:
    """Traced values that solve equations. They are differentiated as such: they change so that `lack` stays zero.

    Args:
        values: the values that were found.
        lack: returns what the equations lack at the unknowns, a value for each of them.
        solve: function of b that returns the x of A x = b, where -A are the derivatives of the lack by the unknowns,
            a symmetric matrix.
        doubt: NaN where the equations have no solution, else 0.

    Attributes:
        unknowns: the values, for use in their place; numbers and arrays stay as they are.
    """

    def __init__(
        self,
        values: Sequence[Operand],
        lack: Callable[[Sequence[Operand]], Sequence[Operand]],
        solve: Callable[[Sequence[Operand]], Sequence[Operand]],
        doubt: Operand,
    ) -> None:
        self.unknowns: Sequence[Operand] = values
        trace = next((x.trace for x in values if isinstance(x, TracedValue)), None)
        if trace is not None:
            self.unknowns = [TracedValue(trace, "+", (x, 0.0)) for x in values]
            trace.solved |= dict.fromkeys(map(id, self.unknowns), self)
        self._lack, self._solve, self._doubt = lack, solve, doubt

    @lock_free_cached_property
    def lack(self) -> Sequence[Operand]:
        """What the equations lack, recorded when a derivative is first taken."""
        return self._lack(self.unknowns)

    def rates(self, change: Change) -> dict[int, Operand]:
        """Return the rates of the unknowns, by id, for rates of inputs."""
        held = [(x, 0.0) for x in self.unknowns]
        found = self._solve(pushforward(self.lack, [*change, *held]))
        return {id(x): rate + self._doubt for x, rate in zip(self.unknowns, found, strict=True)}

    def gradients(self, weights: dict[int, Operand], inputs: Sequence[Operand]) -> list[Operand]:
        """Return the derivatives by inputs of the weighted sum of the unknowns, whose weights are by id."""
        found = self._solve([weights.get(id(x), 0.0) for x in self.unknowns])
        gradients = pullback(zip(self.lack, found, strict=True), [*inputs, *self.unknowns])
        return [x + self._doubt for x in gradients[: len(inputs)]]


def pushforward(results: Sequence[Operand], change: Change) -> list[Operand]:
    """Return the rates of change of results, for given rates of change of inputs (forward accumulation).

    >>> trace = Trace()
    >>> x, y = trace.input(), trace.input()
    >>> (rate,) = pushforward([3 * x + y], [(x, 1.0)])
    >>> rate
    3.0
    """
    return _pushforward(_steps(results), results, change)


def _steps(results: Sequence[Operand]) -> list[tuple[TracedValue, list[int]]]:
    """Return the values that results need, each with the identities of its operands."""
    return [(v, [id(x) for x in v.operands]) for v in needed_values(results, behind_solutions=False)]


def _pushforward(
    steps: Iterable[tuple[TracedValue, list[int]]], results: Sequence[Operand], change: Change
) -> list[Operand]:
    """Return the rates of change of results, from what `_steps` returns of them."""
    rates: dict[int, Operand] = {id(x): rate for x, rate in change}
    changing = rates.keys()
    for v, operands in steps:
        if id(v) in rates:
            continue
        if id(v) in v.trace.solved:
            rates |= v.trace.solved[id(v)].rates(change)
            continue
        if changing.isdisjoint(operands) and v.operation != "where":  # most do not change
            continue
        rate: Operand = 0.0
        if v.operation == "where":
            less = v.operands[0]
            then, otherwise = (_rate(rates, operand) for operand in v.operands[1:])
            if isinstance(less, TracedValue) and not (_is_zero(then) and _is_zero(otherwise)):
                rate = then if then is otherwise else _choose(less, then, otherwise)
        else:
            for operand, slope in _slopes(v, rates):
                rate = rate + rates[id(operand)] * slope
        if not _is_zero(rate):
            rates[id(v)] = rate
    return [_rate(rates, result) for result in results]


def _rate(rates: dict[int, Operand], operand: Operand) -> Operand:
    if isinstance(operand, TracedValue):
        return rates.get(id(operand), 0.0)
    return math.nan if math.isnan(operand) else 0.0


def pullback(results: Iterable[tuple[Operand, Operand]], inputs: Sequence[Operand]) -> list[Operand]:
    """Return the derivatives of one sum by inputs (reverse accumulation). The sum is given as pairs (result, weight).

    >>> trace = Trace()
    >>> x, y = trace.input(), trace.input()
    >>> pullback([(3 * x + y, 2.0)], [x, y])
    [6.0, 2.0]
    """
    pairs = [(v, weight) for v, weight in results if isinstance(v, TracedValue)]
    sums: dict[int, Operand] = {}
    chosen: set[int] = set()  # values that count at some samples only, and may be infinite at the others
    doubt: Operand = 0.0

    def add(operand: Operand, part: Operand, is_chosen: bool) -> None:
        """Add a part to the derivative by an operand; `is_chosen` if it counts at some samples only."""
        if isinstance(operand, TracedValue) and id(operand) in moving:
            sums[id(operand)] = sums.get(id(operand), 0.0) + part
            if is_chosen:
                chosen.add(id(operand))

    differentiated = {id(x) for x in inputs}
    needed, moving = needed_values((v for v, _ in pairs), behind_solutions=False), {*differentiated}
    solutions: dict[int, Solution] = {}
    for v in needed:  # values without inputs among what they are made of need no derivatives
        solution = v.trace.solved.get(id(v)) if id(v) not in differentiated else None
        if solution is not None:
            solutions[id(solution)] = solution
        doubtful = v.operation == "where" and _has_nan(v.operands)
        if solution is not None or doubtful or not moving.isdisjoint(map(id, v.operands)):
            moving.add(id(v))
    for v, weight in pairs:
        add(v, weight, False)
    for v in reversed(needed):
        weight = sums.get(id(v), 0.0)
        if _is_zero(weight) or id(v) in differentiated or id(v) in v.trace.solved:
            continue
        if v.operation == "where":
            less, then, otherwise = v.operands
            if isinstance(less, TracedValue):
                add(then, _choose(less, weight, 0.0), True)
                add(otherwise, _choose(less, 0.0, weight), True)
                if _has_nan((then, otherwise)):
                    doubt = doubt + _choose(less, *(_rate({}, x) for x in (then, otherwise)))
            continue
        is_chosen = id(v) in chosen
        for operand, slope in _slopes(v, None):
            part = weight * slope
            if is_chosen and v.operation not in _SUMS:  # no 0 * infinity from the branch that is not taken
                part = where_less(weight, 0.0, part, where_less(0.0, weight, part, weight))
            add(operand, part, is_chosen)
    found = [sums.get(id(x), 0.0) + doubt for x in inputs]
    for solution in solutions.values():
        found = [a + b for a, b in zip(found, solution.gradients(sums, inputs), strict=True)]
    return found


def jacobian(results: Sequence[Operand], changes: Sequence[Change]) -> list[list[Operand]]:
    """Return a row for each result, with its rate of change for each of several changes of inputs.

    >>> trace = Trace()
    >>> x, y = trace.input(), trace.input()
    >>> jacobian([3 * x + y, -y], [[(x, 1.0)], [(y, 1.0)]])
    [[3.0, 1.0], [0.0, -1.0]]
    """
    if 4 * len(results) < len(changes):  # few rows: backwards
        inputs = [*{id(x): x for change in changes for x, _ in change}.values()]
        rows = []
        for result in results:
            slopes = dict(zip(map(id, inputs), pullback([(result, 1.0)], inputs), strict=True))
            rows.append([weighted_sum((slopes[id(x)], rate) for x, rate in change) for change in changes])
        return rows
    steps = _steps(results)
    columns = [_pushforward(steps, results, change) for change in changes]
    return [[column[k] for column in columns] for k in range(len(results))]


def weighted_sum(pairs: Iterable[tuple[Operand, Operand]]) -> Operand:
    """Return the sum of the products of pairs."""
    total: Operand = 0.0
    for a, b in pairs:
        total = total + a * b
    return total


def _slopes(v: TracedValue, rates: dict[int, Operand] | None) -> list[tuple[TracedValue, Operand]]:
    """Return pairs (operand, derivative of a value by it): all traced operands, or those that have rates."""
    a = v.operands
    changing = [isinstance(x, TracedValue) and (rates is None or id(x) in rates) for x in a]
    if not any(changing):
        return []
    slopes: tuple[Operand, ...] = ()
    match v.operation:
        case "+":
            slopes = 1.0, 1.0
        case "-":
            slopes = 1.0, -1.0
        case "negative":
            slopes = (-1.0,)
        case "*":
            slopes = a[1], a[0]
        case "/":
            inverse = 1.0 / a[1]
            slopes = inverse, -(v * inverse) if changing[1] else 0.0
        case "sin" | "cos" | "versine":
            x = a[0]
            if isinstance(x, TracedValue) and changing[0]:
                slopes = (x.cosine() if v.operation == "sin" else -x.sine() if v.operation == "cos" else x.sine(),)
        case "sqrt":
            slopes = (0.5 / v,)
        case "hypot":
            slopes = a[0] / v, a[1] / v
        case "arctan2":
            r = hypotenuse(a[1], a[0])
            slopes = a[1] / r / r, -(a[0] / r / r)
    return [
        (x, slope)
        for x, slope, moves in zip(a, slopes, changing, strict=False)
        if moves and isinstance(x, TracedValue)
    ]


def _choose(less: TracedValue, then: Operand, otherwise: Operand) -> TracedValue:
    return less.trace.record("where", less, then, otherwise)


def _has_nan(operands: Iterable[Operand]) -> bool:
    return any(isinstance(x, float) and math.isnan(x) for x in operands)


def _is_zero(value: Operand) -> bool:
    return not isinstance(value, TracedValue) and value == 0
