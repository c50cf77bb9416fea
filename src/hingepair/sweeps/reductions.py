"""Reductions: what a sweep keeps of each component of an output over the instants of a variant."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.arrays import Float64Array
from hingepair.pair.results import column_names

# By name, from values (variants, samples, components) and instants (samples,) to (variants, components).
_REDUCTIONS: Final[Mapping[str, Callable[[Float64Array, Float64Array], Any]]] = {
    "min": lambda x, _: x.min(axis=1),
    "max": lambda x, _: x.max(axis=1),
    "absmax": lambda x, _: np.abs(x).max(axis=1),
    "mean": lambda x, _: x.mean(axis=1),
    "rms": lambda x, _: np.sqrt(np.square(x).mean(axis=1)),
    "std": lambda x, _: x.std(axis=1),
    "first": lambda x, _: x[:, 0],
    "last": lambda x, _: x[:, -1],
    "t_min": lambda x, t: t[x.argmin(axis=1)],
    "t_max": lambda x, t: t[x.argmax(axis=1)],
    "t_absmax": lambda x, t: t[np.abs(x).argmax(axis=1)],
}
REDUCTIONS: Final = (*_REDUCTIONS, "q5", "q50", "q95")
"""Names of reductions; of the quantiles, examples.

A NaN at an instant makes a reduction NaN; of t_min, t_max and t_absmax, it makes it the first such instant.
"""

# Name of a quantile; its group is the percentage, 0 to 100.
_QUANTILE: Final = re.compile(r"q(\d{1,2}(?:\.\d+)?|100)")


def is_reduction(name: object) -> bool:
    """Return whether an object is the name of a reduction, such as "max", or of a quantile from "q0" to "q100", such
    as "q2.5".
    """
    return isinstance(name, str) and (name in _REDUCTIONS or _QUANTILE.fullmatch(name) is not None)


def reduce_arrays(
    t: Float64Array, arrays: Mapping[str, NDArray[Any]], reductions: Sequence[str]
) -> dict[str, Float64Array]:
    """Return a dict of reductions over the instants t, one array (variants,) for each component of an output and each
    name in `reductions`. The keys are column names such as R2_x_max. `arrays` is a dict of the outputs by name; shape
    (variants, samples, ...).
    """
    names = column_names({name: array[0] for name, array in arrays.items()})
    flat = np.concatenate([np.asarray(a, np.float64).reshape(*a.shape[:2], -1) for a in arrays.values()], axis=2)
    reduced: dict[str, Any] = {}
    for reduction in reductions:
        quantile = _QUANTILE.fullmatch(reduction)
        if quantile:
            reduced[reduction] = np.quantile(flat, float(quantile[1]) / 100, axis=1)
        else:
            reduced[reduction] = _REDUCTIONS[reduction](flat, t)
    return {f"{name}_{r}": reduced[r][:, k] for k, name in enumerate(names) for r in reductions}
