"""Names that do not collide, where users choose some of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable


class Names:
    """Allocator of names. `take` returns a name that no earlier one equals, and keeps it.

    Args:
        taken: names that are in use already.
        key: two names collide if their keys are equal, such as their LaTeX; by default the names themselves.

    >>> names = Names(["t"])
    >>> names.take("t"), names.take("t"), names.take("x", "x of arm"), names.take("x", "x of arm")
    ('t_', 't__', 'x', 'x of arm')
    """

    def __init__(self, taken: Iterable[str] = (), key: Callable[[str], str] = str) -> None:
        self._key = key
        self._taken = {*map(key, taken)}

    def free(self, *names: str) -> bool:
        """Return whether none of the names is in use."""
        return self._taken.isdisjoint(map(self._key, names))

    def take(self, *candidates: str) -> str:
        """Return the first candidate that is free, or the last with as many _ behind it as it needs; it is kept."""
        name = next(filter(self.free, candidates), candidates[-1])
        while not self.free(name):
            name += "_"
        self._taken.add(self._key(name))
        return name

    def take_all(self, wanted: Iterable[str]) -> dict[str, str]:
        """Return the taken name by wanted name; names that are free stay, and the others give way."""
        names = sorted(wanted, key=lambda name: not self.free(name))
        return {name: self.take(name) for name in names}
