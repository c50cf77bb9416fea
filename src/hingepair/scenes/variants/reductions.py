"""Reductions: what a sweep keeps of each component of an output over the instants of a variant."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, choices, quoted
from hingepair.numeric.arrays import Float64Array
from hingepair.tables.data_frames import column_names
from hingepair.tables.units import IN_SI, Columns

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
    "t_last": lambda x, t: np.full((len(x), x.shape[2]), t[-1]),
}
REDUCTIONS: Final = (*_REDUCTIONS, "q5", "q50", "q95", "t_below(0.1)", "t_above(0.1)", "t_at(0.1)", "t_settled(0.1)")
"""Names of reductions; of quantiles and levels, examples.

A NaN at an instant makes a reduction NaN; of t_min, t_max and t_absmax, it makes it the first such instant.
"""

# Name of a quantile; its group is the percentage, 0 to 100.
_QUANTILE: Final = re.compile(r"q(\d{1,2}(?:\.\d+)?|100)")

# Name of the time at a level; its groups are the kind and the level.
_LEVEL: Final = re.compile(r"(t_below|t_above|t_at|t_settled)\(([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\)")


def reduction_of(name: object) -> Callable[[Float64Array, Float64Array], Any] | None:
    """Return the reduction of a name: "max", a quantile such as "q2.5", or the time at a level, such as
    "t_below(0.1)"; None if there is none.
    """
    if not isinstance(name, str):
        return None
    if at_level := _LEVEL.fullmatch(name):
        return lambda x, t: _time_at_level(at_level[1], float(at_level[2]), x, t)
    if quantile := _QUANTILE.fullmatch(name):
        return lambda x, _: np.quantile(x, float(quantile[1]) / 100, axis=1)
    return _REDUCTIONS.get(name)


def check_reductions(name: str, reductions: object) -> tuple[str, ...]:
    """Return names of reductions as a tuple; refuse others, as the argument `name`."""
    names = (reductions,) if isinstance(reductions, str) else tuple(reductions)  # type: ignore[arg-type]
    for one in names:
        if reduction_of(one) is None:
            raise ArgumentError(name, f"{choices(REDUCTIONS)}; of quantiles any, such as q2.5", quoted(one))
    return names


def reduction_ending(column: str) -> str | None:
    """Return the reduction in which the name of a column ends, such as t_min of psi_t_min; None if there is none."""
    places = (place + 1 for place, letter in enumerate(column) if letter == "_")
    return next((column[place:] for place in places if reduction_of(column[place:])), None)


def _time_at_level(kind: str, level: Any, x: Float64Array, t: Float64Array) -> Float64Array:
    """Return when components are below, above or at a level for the first time, or stay within it of their last value
    from then on, for a hundredth of the time at least; linear between instants, and NaN if never; shape (variants,
    components). x is (variants, samples,
    components).
    """
    if kind == "t_settled":
        x = x - x[:, -1:]
        outside = np.abs(x) > level
        before, has = x.shape[1] - 1 - np.argmax(outside[:, ::-1], axis=1), outside.any(axis=1)
        missing = np.full(has.shape, t[0])
    else:
        start = np.sign(x[:, :1] - level)
        there = {"t_below": x < level, "t_above": x > level, "t_at": np.sign(x - level) != start}[kind]
        there[:, 0] |= (kind == "t_at") & (start[:, 0] == 0)
        before, has = np.argmax(there, axis=1) - 1, there.any(axis=1) & ~there[:, 0]
        missing = np.where(there[:, 0], t[0], np.nan)
    before = np.clip(before, 0, len(t) - 2)
    here, after = (np.take_along_axis(x, (before + k)[:, None], axis=1)[:, 0] for k in (0, 1))
    if kind == "t_settled":
        level = np.copysign(level, here)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(after == here, 0.0, (level - here) / (after - here))
    time = t[before] + share * (t[before + 1] - t[before])
    if kind == "t_settled":  # a swing without end is near its last value at its end, too
        has &= t[-1] - time > 0.01 * (t[-1] - t[0])
        missing = np.where(outside.any(axis=1), np.nan, t[0])
    found: Float64Array = np.where(np.isnan(x).any(axis=1), np.nan, np.where(has, time, missing))
    return found


def reduced_heading(columns: Columns, component: str, reduction: str) -> str:
    """Return the heading of a reduced component, in units.

    >>> from hingepair.tables.units import Units
    >>> [reduced_heading(Columns(Units("deg")), "psi", reduction) for reduction in ("t_below(5)", "max")]
    ['psi_t_below(5) [s]', 'psi_max [deg]']
    """
    si = "s" if reduction.startswith("t_") else columns.si_unit(component)
    return columns.units.heading(f"{component}_{reduction}", si)


def _with_magnitudes(arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return arrays (variants, samples, ...), with the magnitude of each vector, such as v2_norm, behind it."""
    found: dict[str, NDArray[Any]] = {}
    for name, array in arrays.items():
        found[name] = array
        if array.shape[2:] in {(2,), (3,)}:
            found[f"{name}_norm"] = np.linalg.norm(array, axis=2)
    return found


def reduce_arrays(
    t: Float64Array,
    arrays: Mapping[str, NDArray[Any]],
    reductions: Sequence[str],
    columns: Columns = IN_SI,
) -> dict[str, Float64Array]:
    """Return a dict of reductions over the instants t, one array (variants,) for each component of an output, and for
    the magnitude of each vector, and each name in `reductions`. The keys are column names such as R2_x_max and
    v2_norm_max, with units if `columns` has any.

    Args:
        t: instants [s]; shape (samples,).
        arrays: outputs by name, in SI units; shape (variants, samples, ...).
        reductions: names of reductions.
        columns: units of the results, and of levels.
    """
    t = columns.converted("t", t)
    arrays = _with_magnitudes({name: columns.converted(name, array) for name, array in arrays.items()})
    names = column_names({name: array[0] for name, array in arrays.items()})
    flat = np.concatenate([np.asarray(a, np.float64).reshape(*a.shape[:2], -1) for a in arrays.values()], axis=2)
    functions: dict[str, Any] = {reduction: reduction_of(reduction) for reduction in reductions}
    reduced = {reduction: function(flat, t) for reduction, function in functions.items()}
    return {reduced_heading(columns, name, r): reduced[r][:, k] for k, name in enumerate(names) for r in reductions}
