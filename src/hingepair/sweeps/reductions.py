"""Reductions: what a sweep keeps of each component of an output over the instants of a variant."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.arrays import Float64Array
from hingepair.pair.results import column_names

_REDUCTIONS: Final[Mapping[str, Callable[[Float64Array, Float64Array], Any]]] = {
    "min": lambda x, _: x.min(axis=0),
    "max": lambda x, _: x.max(axis=0),
    "absmax": lambda x, _: np.abs(x).max(axis=0),
    "mean": lambda x, _: x.mean(axis=0),
    "rms": lambda x, _: np.sqrt(np.square(x).mean(axis=0)),
    "std": lambda x, _: x.std(axis=0),
    "first": lambda x, _: x[0],
    "last": lambda x, _: x[-1],
    "t_min": lambda x, t: t[x.argmin(axis=0)],
    "t_max": lambda x, t: t[x.argmax(axis=0)],
    "t_absmax": lambda x, t: t[np.abs(x).argmax(axis=0)],
}
NAMES: Final = (*_REDUCTIONS, "q5", "q50", "q95")
"""Names of reductions; of quantiles, examples. NaN at an instant makes them NaN, or the first such instant."""

_QUANTILE: Final = re.compile(r"q(\d{1,2}(?:\.\d+)?|100)")


def is_reduction(name: object) -> bool:
    """Return whether a value is the name of a reduction: one of `NAMES`, or a quantile in percent such as q2.5."""
    return isinstance(name, str) and (name in _REDUCTIONS or _QUANTILE.fullmatch(name) is not None)


def reduce_arrays(
    t: Float64Array, arrays: Mapping[str, NDArray[Any]], reductions: Sequence[str]
) -> dict[str, np.float64]:
    """Return the reductions of every component, by column name such as R2_x_max; one number each."""
    names = column_names(arrays)
    flat = np.concatenate([np.asarray(a, np.float64).reshape(len(t), -1) for a in arrays.values()], axis=1)
    found: dict[str, Any] = {}
    for reduction in reductions:
        quantile = _QUANTILE.fullmatch(reduction)
        part = float(quantile[1]) / 100 if quantile else None
        found[reduction] = _REDUCTIONS[reduction](flat, t) if part is None else np.quantile(flat, part, axis=0)
    return {f"{name}_{r}": found[r][k] for k, name in enumerate(names) for r in reductions}
