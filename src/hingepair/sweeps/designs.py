"""Designs of experiments: which values the varied numbers of a scene take, variant by variant."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from hingepair.errors import MissingDependencyError
from hingepair.numeric.arrays import Float64Array
from hingepair.scenes.tables import Table

DESIGNS: Final = ("grid", "random", "sobol")
"""Names of the ways to place the variants of a sweep in the ranges of its numbers."""
MAX_VARIANTS: Final = 10_000_000
"""Variants of one sweep at most."""

_MAX_SOBOL_NUMBERS: Final = 21201  # that SciPy has directions for


@dataclass(frozen=True, slots=True, eq=False)
class Varied:
    """A number of a scene that is varied.

    Attributes:
        key: where it stands, such as "pair.body2.mass" or "pair.u1[0]".
        values: of a grid; None of other designs.
        spread: of other designs: lower and upper end, or mean and standard deviation.
        normal: whether it is normally distributed; else uniformly.
    """

    key: str
    values: Float64Array | None
    spread: tuple[float, float]
    normal: bool = False


def read_varied(table: Table, design: str) -> Varied:
    """Read one table [[vary]].

    Raises:
        SceneError: a key that is missing, unknown, or of another design; names it.
    """
    table.check_keys(("key", "values", "low", "high", "count", "mean", "std"))
    key = table.text("key")
    if design == "grid":
        if "values" in table.values:
            given = table.values["values"]
            if not isinstance(given, list) or not given or len(table.values) > 2:
                table.fail("values", "a list of numbers, and key beside it")
            return Varied(key, np.array(table.numbers("values", len(given))), (0.0, 0.0))
        low, high = _ends(table, "low", "high", ("key", "low", "high", "count"))
        count = table.values.get("count")
        if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MAX_VARIANTS:
            table.fail("count", "a whole number from 1, of a grid; or a list of values")
        return Varied(key, np.linspace(low, high, count), (low, high))
    if "mean" in table.values or "std" in table.values:
        mean, std = _ends(table, "mean", "std", ("key", "mean", "std"))
        if std < 0:
            table.fail("std", "a number not below 0")
        return Varied(key, None, (mean, std), normal=True)
    low, high = _ends(table, "low", "high", ("key", "low", "high"))
    if low > high:
        table.fail("low", f"a number not above high, {high:g}")
    return Varied(key, None, (low, high))


def _ends(table: Table, first: str, second: str, known: tuple[str, ...]) -> tuple[float, float]:
    """Return the lower and upper end of a varied number; refuse any other key beside those known."""
    for name in table.values:
        if name not in known:
            table.refuse(name, f"nothing beside {', '.join(known)}", "this key")
    return table.number(first), table.number(second)


def design_values(
    table: Table, design: str, varied: tuple[Varied, ...], samples: int | None, seed: int
) -> Float64Array:
    """Return the values of all variants; shape (variants, numbers). Of a grid the last number runs fastest.

    Args:
        table: for messages.
        design: one of `DESIGNS`.
        varied: the numbers.
        samples: number of variants of a random or Sobol design.
        seed: of these.

    Raises:
        SceneError: too many variants, or too many numbers.
        MissingDependencyError: SciPy is not installed, which has Sobol's points.
    """
    if design == "grid":
        axes = [own.values for own in varied if own.values is not None]
        total = math.prod(len(axis) for axis in axes)
        if total > MAX_VARIANTS:
            table.refuse("vary", f"at most {MAX_VARIANTS} variants", total)
        return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=-1)
    if samples is None:
        table.fail("samples", f"the number of variants of a {design} design")
    if design == "sobol":
        parts = _sobol(table, len(varied), samples, seed)
        normal = _normal_quantile(parts)
    else:
        rng = np.random.default_rng(seed)
        parts, normal = rng.random((samples, len(varied))), rng.standard_normal((samples, len(varied)))
    columns = [
        own.spread[0] + own.spread[1] * normal[:, k]
        if own.normal
        else own.spread[0] + (own.spread[1] - own.spread[0]) * parts[:, k]
        for k, own in enumerate(varied)
    ]
    return np.stack(columns, axis=-1)


def _sobol(table: Table, numbers: int, samples: int, seed: int) -> Float64Array:
    """Return scrambled points of Sobol in the open unit cube; shape (samples, numbers)."""
    try:
        from scipy.stats.qmc import Sobol
    except ImportError as error:
        raise MissingDependencyError("design", "SciPy (pip install 'hingepair[dask]')", str(error)) from None
    if numbers > _MAX_SOBOL_NUMBERS:
        table.refuse("vary", f"at most {_MAX_SOBOL_NUMBERS} numbers of a Sobol design", numbers)
    points = Sobol(numbers, scramble=True, seed=seed).random_base2(max(0, math.ceil(math.log2(samples))))
    return np.asarray(np.clip(points[:samples], 2.0**-53, 1 - 2.0**-53))


def _normal_quantile(parts: Float64Array) -> Float64Array:
    from scipy.special import ndtri

    return np.asarray(ndtri(parts))
