"""All products of the first k factors, and all sums of the first k terms, by a tree: steps do not add up round-off.

Groups of RADIX neighbours are combined one after the other, then the groups' results in groups of RADIX, and so on;
what stands before a group is then handed down to its members. A small rotation is rounded in proportion to its angle,
and the tree multiplies small ones by small ones: only the last few levels round at the size of 1, as often as the
whole motion has radians, where a running product would have done so at each of k steps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeAlias

from numpy.typing import NDArray

Components: TypeAlias = tuple[NDArray[Any], ...]
Combine: TypeAlias = Callable[[Any, Any], Components]

RADIX: Final = 8


def scan(parts: Components, combine: Combine) -> None:
    """Replace each element by the combination of all up to it, in place.

    Args:
        parts: the elements by component, arrays of shape (N,) in the order of time.
        combine: of a later and an earlier element; associative.
    """
    if len(parts[0]) < 2:
        return
    for i in range(1, RADIX):
        _absorb(tuple(p[i::RADIX] for p in parts), tuple(p[i - 1 :: RADIX] for p in parts), combine)
    ends = tuple(p[RADIX - 1 :: RADIX] for p in parts)
    scan(ends, combine)
    for i in range(RADIX, 2 * RADIX - 1):
        _absorb(tuple(p[i::RADIX] for p in parts), ends, combine)


def _absorb(later: Components, earlier: Components, combine: Combine) -> None:
    count = len(later[0])
    for target, result in zip(later, combine(later, tuple(p[:count] for p in earlier)), strict=True):
        target[:] = result
