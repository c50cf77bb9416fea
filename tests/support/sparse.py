"""Many cases, of which the fast loop runs a few."""

from __future__ import annotations

import pytest


def sparse(values, every, ids=None):
    """Parameters of which every so manieth is fast and the others are slow.

    Args:
        values: of one parameter, or tuples of several.
        every: how many there are for one that is fast.
        ids: texts of a value; else its name, or made of it.
    """
    found = []
    for i, value in enumerate(values):
        parts = value if isinstance(value, tuple) else (value,)
        marks = [] if i % every == 0 else [pytest.mark.slow]
        found.append(pytest.param(*parts, id=(ids or _id)(value), marks=marks))
    return found


def _id(value):
    if isinstance(value, tuple):
        return "-".join(map(_id, value))
    return getattr(value, "__name__", str(value)).replace(" ", "_")
