"""Dask in tests: a scheduler that computes nothing, and a function that computes on purpose."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import dask
import pytest


def refuse(*_: Any, **__: Any) -> None:
    """Fail the test: used as Dask's scheduler, where nothing may be computed."""
    pytest.fail("computed without being asked")


def refusing_scheduler() -> Iterator[None]:
    """Let nothing be computed but by `computed`; the function of a fixture."""
    with dask.config.set(scheduler=refuse):
        yield


def computed(*lazy: Any) -> Any:
    """Return lazy values, computed: one value for one, a tuple for several."""
    values = dask.compute(*lazy, scheduler="synchronous")
    return values if len(lazy) > 1 else values[0]
