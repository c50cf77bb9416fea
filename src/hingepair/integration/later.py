"""A number that is worked out when it is first asked for, and then known."""

from __future__ import annotations

from collections.abc import Callable


class Later:
    """A number to be worked out; call it. Copies and pickles hold the number.

    >>> later = Later(lambda: 6.0 * 7)
    >>> later()
    42.0
    """

    __slots__ = ("_number", "_work")

    def __init__(self, work: Callable[[], float] | None, number: float = 0.0) -> None:
        self._work = work
        self._number = number

    def __call__(self) -> float:
        """The number."""
        work = self._work
        if work is not None:  # two threads may both come here, and find the same number
            self._number = float(work())
            self._work = None
        return self._number

    @property
    def known(self) -> bool:
        """Whether the number has been worked out already."""
        return self._work is None

    def __reduce__(self) -> tuple[type[Later], tuple[None, float]]:
        return Later, (None, self())
