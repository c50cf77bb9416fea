"""What frames are to reach, and how the numbers of a target are ordered."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple


class Goal(NamedTuple):
    """What one frame is to reach: a position, an attitude or a direction of its z axis, or two of them."""

    frame: int  # its index in the request
    position: bool
    attitude: str  # "none", "axis" or "full"

    @property
    def size(self) -> int:
        """Count of numbers of one target: the position, then the direction, or the rotation matrix row by row.

        >>> Goal(0, True, "full").size, Goal(0, True, "axis").size
        (12, 6)
        """
        return 3 * self.position + {"none": 0, "axis": 3, "full": 9}[self.attitude]


def target_slices(goals: Sequence[Goal]) -> Iterator[tuple[slice, slice]]:
    """Yield for each goal where its position and its attitude stand in a target.

    >>> [*target_slices((Goal(0, True, "axis"), Goal(1, False, "full")))]
    [(slice(0, 3, None), slice(3, 6, None)), (slice(6, 6, None), slice(6, 15, None))]
    """
    first = 0
    for goal in goals:
        middle, end = first + 3 * goal.position, first + goal.size
        yield slice(first, middle), slice(middle, end)
        first = end


def target_size(goals: Sequence[Goal]) -> int:
    """Return the count of numbers of one target of all goals."""
    return sum(goal.size for goal in goals)
