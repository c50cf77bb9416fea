"""Changes of arguments and results, by which programs are differentiated.

A change of an attitude is a rotation about world axes: three numbers, not nine.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, TypeAlias

from hingepair.engine.binding import ArrayShape
from hingepair.engine.derivatives import Change, variables, weighted_sum
from hingepair.engine.trace import Operand
from hingepair.numeric.blocks import components

Parts: TypeAlias = Mapping[str, Sequence[Operand]]
"""Components of outputs by name."""

Moves: TypeAlias = dict[str, list[Change]]
"""Changes by argument, one for each component of a change of it."""

# They change by rotations about world axes, home about those of body 1; next_S1 is S1 after a step in time.
_ATTITUDES: Final = frozenset({"S", "S1", "S2", "home", "next_S1"})
_WXYZ_PLACES: Final = {"quat_xyzw": (3, 0, 1, 2), "quat_wxyz": (0, 1, 2, 3)}  # places of w, x, y, z
# For each quantity of the joints, those of a free base that come before it, and itself.
_GROUPS: Final = {
    "q": ("R1", "S1", "q"),
    "qd": ("v1", "omega1", "qd"),
    "qdd": ("a1", "alpha1", "qdd"),
    "tau": ("force1", "torque1", "tau"),
}


def change_shape(name: str, sample_shape: ArrayShape) -> ArrayShape:
    """Return the shape of a change of one sample of an argument or output.

    >>> change_shape("S", (2, 3, 3)), change_shape("q", (7,))
    ((2, 3), (7,))
    """
    if name in _WXYZ_PLACES:
        return (3,)
    return sample_shape[:-1] if name in _ATTITUDES else sample_shape


def group_of(kind: str, free: bool) -> tuple[str, ...]:
    """Return the names of a quantity of the joints, and of what goes with it at a free base, in the order of M."""
    return _GROUPS[kind] if free else _GROUPS[kind][2:]


def with_variables(
    values: Mapping[str, Any], arguments: Iterable[tuple[str, ArrayShape]], entries: bool = False
) -> tuple[dict[str, Any], Moves]:
    """Return the values with variables in the place of arguments, and the changes of the arguments; attitudes change
    by their `entries`, or by rotations.
    """
    values, moves = dict(values), Moves()
    for name, tail in arguments:
        if name in values:
            others = [x for other, group in values.items() if other != name for x in components(group)]
            parts = variables(components(values[name]), others)
            values[name] = parts if tail else parts[0]
            changes = changes_of("" if entries else name, parts)
            moves[name] = [[(parts[k], rate) for k, rate in change] for change in changes]
        else:  # no output depends on it
            moves[name] = [[] for _ in range(math.prod(tail if entries else change_shape(name, tail)))]
    return values, moves


def sum_of(changes: Iterable[tuple[Operand, Change]]) -> list[tuple[Operand, Operand]]:
    """Return the sum of pairs (weight, change) as one change."""
    sums: dict[int, tuple[Operand, Operand]] = {}
    for weight, change in changes:
        for x, rate in change:
            sums[id(x)] = x, sums.get(id(x), (x, 0.0))[1] + weight * rate
    return [*sums.values()]


def changes_of(name: str, value: Sequence[Operand]) -> list[list[tuple[int, Operand]]]:
    """Return for each component of a change of a value which components of the value change, and how fast."""
    if name in _WXYZ_PLACES:  # half the product of a unit vector and the quaternion
        w, x, y, z = _WXYZ_PLACES[name]
        rows = [(w, -1.0, x), (x, 1.0, w), (y, -1.0, z), (z, 1.0, y)]  # of the x axis: w changes by -x/2, ...
        turns = {w: w, x: y, y: z, z: x}
        changes = []
        for _ in range(3):
            changes.append([(a, value[b] * (0.5 * sign)) for a, sign, b in rows])
            rows = [(turns[a], sign, turns[b]) for a, sign, b in rows]
        return changes
    if name == "n":  # stays a unit vector
        return [[(j, float(j == k) - value[j] * value[k]) for j in range(3)] for k in range(3)]
    if name not in _ATTITUDES:
        return [[(k, 1.0)] for k in range(len(value))]
    changes = []
    for first in range(0, len(value), 9):
        for k in range(3):  # a rotation about the k-th axis turns row a into row b, and row b into -a
            a, b = first + 3 * ((k + 1) % 3), first + 3 * ((k + 2) % 3)
            changes.append([(b + j, value[a + j]) for j in range(3)] + [(a + j, -value[b + j]) for j in range(3)])
    return changes


def change_of(name: str, value: Sequence[Operand], rates: Sequence[Operand]) -> list[Operand]:
    """Return the components of the change of an output from the rates of its components."""
    changes = changes_of(name, value)
    return [weighted_sum((rates[k], rate) for k, rate in change) * share_of(name) for change in changes]


def share_of(name: str) -> float:
    """Return the share of the changes of entries that makes a change: a rotation is read off two rows."""
    return 0.5 if name in _ATTITUDES else 1.0
