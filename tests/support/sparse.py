"""Many cases, of which the fast loop runs a few."""

from __future__ import annotations

import pytest


def sparse(values, every, ids=None):
    """Parameters of which every so manieth is fast and the others are slow; ids are texts, or made of each value."""
    names = ids or (lambda value: str(value).replace(" ", "_"))
    return [
        pytest.param(value, id=names(value), marks=[] if i % every == 0 else pytest.mark.slow)
        for i, value in enumerate(values)
    ]
