"""Cached properties without a lock."""

from __future__ import annotations

import functools
from typing import Any, TypeVar

_Value = TypeVar("_Value")


class lock_free_cached_property(functools.cached_property[_Value]):  # noqa: N801 (used as a decorator)
    """A cached property that two threads may compute twice. In Python 3.11, a fork could leave the lock of
    `functools.cached_property`, one for all instances, held for ever in the child process.
    """

    def __get__(self, instance: Any, owner: type[Any] | None = None) -> _Value:  # type: ignore[override]
        if instance is None:
            return self  # type: ignore[return-value]
        value = instance.__dict__[self.attrname] = self.func(instance)
        return value
