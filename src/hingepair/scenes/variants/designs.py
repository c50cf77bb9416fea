"""Designs of experiments: which values the varied numbers of a scene take, variant by variant."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from hingepair.numeric.arrays import Float64Array
from hingepair.scenes.tables import Table

DESIGN_NAMES: Final = ("grid", "random", "sobol")
"""Names of the ways to place the variants of a sweep in the ranges of its numbers."""
MAX_VARIANTS: Final = 10_000_000
"""Variants of one sweep at most."""

_MAX_SOBOL: Final = 21201  # that SciPy has directions for


@dataclass(frozen=True, slots=True, eq=False)
class VariedNumber:
    """Number of a scene that a sweep varies."""

    #: where the number stands in the scene file, such as "pair.body2.mass" or "pair.u1[0]"
    key: str
    #: values of the number in a grid, each once; None in other designs
    values: Float64Array | None
    #: lower and upper end, or mean and standard deviation where `normal`; not used in a grid
    spread: tuple[float, float]
    #: whether the number is normally distributed; otherwise uniformly
    normal: bool = False


def read_varied_number(table: Table, design: str) -> VariedNumber:
    """Return the `VariedNumber` that one Table [[vary]] of a sweep file describes. `design` is one of `DESIGN_NAMES`,
    on which the allowed keys depend.
    """
    table.check_keys(("key", "values", "low", "high", "count", "mean", "std"))
    key = table.text("key")
    if design == "grid":
        if "values" in table.values:
            values = table.values["values"]
            if not isinstance(values, list) or not values or len(table.values) > 2:
                table.fail("values", "a list of numbers, together with key alone")
            return VariedNumber(key, np.array(table.numbers("values", len(values))), (0.0, 0.0))
        low, high = _read_two_numbers(table, "low", "high", ("key", "low", "high", "count"))
        count = table.values.get("count")
        if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MAX_VARIANTS:
            table.fail("count", "a whole number from 1, of a grid; or a list of values")
        return VariedNumber(key, np.linspace(low, high, count), (low, high))
    if "mean" in table.values or "std" in table.values:
        mean, std = _read_two_numbers(table, "mean", "std", ("key", "mean", "std"))
        if std < 0:
            table.fail("std", "a number not below 0")
        return VariedNumber(key, None, (mean, std), normal=True)
    low, high = _read_two_numbers(table, "low", "high", ("key", "low", "high"))
    if low > high:
        table.fail("low", f"a number not above high, {high:g}")
    return VariedNumber(key, None, (low, high))


def _read_two_numbers(
    table: Table, first_key: str, second_key: str, allowed_keys: tuple[str, ...]
) -> tuple[float, float]:
    """Return the numbers under two keys of a Table; refuse keys other than `allowed_keys`."""
    for key in table.values:
        if key not in allowed_keys:
            table.refuse(key, f"only the keys {', '.join(allowed_keys)}", "this key")
    return table.number(first_key), table.number(second_key)


def design_values(
    table: Table, design: str, varied: tuple[VariedNumber, ...], samples: int | None, seed: int
) -> Float64Array:
    """Return the values of varied numbers in every variant of a design, shape (variants, numbers); in a grid, the
    last number changes fastest.

    Args:
        table: the sweep file's table, which error messages name.
        design: one of `DESIGN_NAMES`.
        varied: the varied numbers.
        samples: number of variants of a random or Sobol design; None in a grid.
        seed: seed of a random or Sobol design.
    """
    if design == "grid":
        axes = [number.values for number in varied if number.values is not None]
        total = math.prod(len(axis) for axis in axes)
        if total > MAX_VARIANTS:
            table.refuse("vary", f"at most {MAX_VARIANTS} variants", total)
        return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=-1)
    if samples is None:
        table.fail("samples", f"the number of variants of a {design} design")
    if design == "sobol":
        uniform = _sobol_points(table, len(varied), samples, seed)
        normal = _normal_quantile(uniform)
    else:
        rng = np.random.default_rng(seed)
        uniform, normal = rng.random((samples, len(varied))), rng.standard_normal((samples, len(varied)))
    columns = [
        number.spread[0] + number.spread[1] * normal[:, k]
        if number.normal
        else number.spread[0] + (number.spread[1] - number.spread[0]) * uniform[:, k]
        for k, number in enumerate(varied)
    ]
    return np.stack(columns, axis=-1)


def _sobol_points(table: Table, dimensions: int, samples: int, seed: int) -> Float64Array:
    """Return scrambled Sobol points in the open unit cube; shape (samples, dimensions)."""
    if dimensions > _MAX_SOBOL:
        table.refuse("vary", f"at most {_MAX_SOBOL} numbers of a Sobol design", dimensions)
    from scipy.stats import qmc

    sobol = qmc.Sobol(dimensions, scramble=True, seed=seed)
    points = sobol.random_base2(max(0, math.ceil(math.log2(samples))))
    return np.asarray(np.clip(points[:samples], 2.0**-53, 1 - 2.0**-53))


def _normal_quantile(probability: Float64Array) -> Float64Array:
    from scipy.special import ndtri

    return np.asarray(ndtri(probability))
