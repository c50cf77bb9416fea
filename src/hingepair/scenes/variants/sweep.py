"""Sweeps: a design over the numbers of a scene, whose variants are computed and written to a table."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import numpy as np

from hingepair.errors import ArgumentError, MissingDependencyError, SceneError, quoted
from hingepair.numeric.arrays import Float64Array
from hingepair.scenes.numbers import number_path
from hingepair.scenes.scene import load_scene
from hingepair.scenes.tables import Table, read_tables
from hingepair.scenes.variants.reductions import check_reductions
from hingepair.scenes.variants.vary import Variants, lost_variants
from hingepair.tables.units import Units
from hingepair.tables.whole_file import check_writable, whole_file

STORE_SUFFIXES: Final = (".csv", ".parquet")
"""Endings of the names of tables."""
_KEYS: Final = ("title", "scene", "outputs", "reduce", "design", "samples", "seed", "units", "vary")
_SCENE_TABLES: Final = frozenset({"pair", "mechanism", "joint", "motion"})  # one of which every scene has
_MAX_VARIANTS: Final = 10_000_000

Progress = Callable[[int, int], None]
"""Takes the number of finished variants and the number of all variants."""


class SweepWarning(UserWarning):
    """Warns that variants of a sweep cannot be computed, and why."""


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """Sweep that a file describes."""

    #: title in a sentence
    title: str
    #: computer of the variants
    variants: Variants
    #: names of the reductions
    reductions: tuple[str, ...]
    #: units of results and levels in place of SI units
    units: str
    #: values of the varied numbers; (variants, numbers)
    numbers: Float64Array
    #: files that the sweep was read from: its own, and those of the scene
    files: tuple[Path, ...]

    def default_store(self) -> str:
        """Return the default name of the table: the sweep file's stem with .parquet, or .csv without pyarrow."""
        return f"{self.files[0].stem}{'.parquet' if find_spec('pyarrow') else '.csv'}"


def load_sweep(path: str | Path, units: str | None = None) -> Sweep:
    """Read a TOML sweep file, and return it as a Sweep.

    Args:
        path: path of the file.
        units: units of results and levels in place of SI units; by default those of the file.
    """
    table = read_tables(path)
    if "scene" not in table.values and not _SCENE_TABLES.isdisjoint(table.values):
        raise SceneError(table.file, "a sweep, whose key scene names a scene", "a scene (hingepair run computes it)")
    table.check_keys(_KEYS)
    scene_path = Path(path).parent / table.file_name("scene")
    scene = load_scene(scene_path)
    expected = "tables [[vary]], one for each number that is varied"
    entries = [replace(entry, name=f"vary[{i}]") for i, entry in enumerate(table.tables("vary", expected))]
    keys = tuple(entry.text("key") for entry in entries) or table.fail("vary", expected)
    for i, (entry, key) in enumerate(zip(entries, keys, strict=True)):
        if key in keys[:i]:
            entry.refuse("key", "a number that is varied once", quoted(key))
        number_path(entry, scene.tables.values, key)
    numbers = _read_design(table, entries)
    with table.naming("outputs"):
        variants = Variants(scene, keys, table.names("outputs", 'a list of names such as ["R2", "hinge_torque"]'))
    with table.naming("reduce"):
        wanted = 'a list of reductions such as ["max", "last"]; hp.vary keeps whole motions'
        reductions = check_reductions("reduce", table.names("reduce", wanted) or table.fail("reduce", wanted))
    if units is None:
        units = table.text("units") if "units" in table.values else ""
        with table.naming("units"):
            Units(units)
    title = table.text("title", default=f"{Path(path).stem}: {len(numbers)} variants of {scene_path.name}")
    return Sweep(title, variants, reductions, units, numbers, (Path(path), *scene.files))


def _read_design(table: Table, entries: Sequence[Table]) -> Float64Array:
    """Return the values of the numbers in every variant, shape (variants, numbers), of the Tables [[vary]]; in a
    grid, the last number changes fastest.
    """
    if table.choice("design", ("grid", "sobol")) == "grid":
        for name in ("samples", "seed"):
            if name in table.values:
                table.refuse(name, 'no such key of a grid (design = "sobol" has it)', table.values[name])
        axes = [_read_axis(entry) for entry in entries]
        if math.prod(map(len, axes)) > _MAX_VARIANTS:
            table.refuse("vary", f"at most {_MAX_VARIANTS} variants", math.prod(map(len, axes)))
        return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=-1)
    from scipy.special import ndtri
    from scipy.stats import qmc

    samples = _read_count(table, "samples")
    sobol = qmc.Sobol(len(entries), scramble=True, seed=_read_count(table, "seed", 0, least=0))
    points = np.clip(sobol.random_base2(math.ceil(math.log2(samples)))[:samples], 2.0**-53, 1 - 2.0**-53)
    for column, entry in zip(points.T, entries, strict=True):
        if {"mean", "std"} & entry.values.keys():
            entry.check_keys(("key", "mean", "std"))
            column[:] = entry.number("mean") + entry.number("std") * ndtri(column)
        else:
            entry.check_keys(("key", "low", "high"))
            column[:] = entry.number("low") + (entry.number("high") - entry.number("low")) * column
    return np.asarray(points)


def _read_axis(entry: Table) -> Float64Array:
    """Return the values of one number of a grid: a list, or `count` from `low` to `high`."""
    if "values" in entry.values:
        entry.check_keys(("key", "values"))
        values = entry.values["values"]
        if not isinstance(values, list) or not values:
            entry.fail("values", "a list of numbers")
        return np.array(entry.numbers("values", len(values)))
    entry.check_keys(("key", "low", "high", "count"))
    return np.linspace(entry.number("low"), entry.number("high"), _read_count(entry, "count"))


def _read_count(table: Table, key: str, default: int | None = None, *, least: int = 1) -> int:
    """Return the whole number under a key of a Table."""
    value = table.values.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= _MAX_VARIANTS:
        table.fail(key, f"a whole number from {least} to {_MAX_VARIANTS}")
    return value


def run_sweep(sweep: Sweep, out: Path, progress: Progress | None = None) -> None:
    """Compute a Sweep, and write its table: for each variant its number, the varied numbers by key, the reductions.

    Args:
        sweep: a sweep from `load_sweep`.
        out: path of the table; ends in .parquet or .csv.
        progress: is called now and then with the numbers of finished variants and of all variants.

    Raises:
        SceneError: no variant can be computed.
    """
    import pandas

    variants, numbers = sweep.variants, sweep.numbers
    if out.suffix.lower() not in STORE_SUFFIXES:
        raise ArgumentError("out", f"a name that ends in {', '.join(STORE_SUFFIXES)}", quoted(str(out)))
    if out.suffix.lower() == ".parquet" and find_spec("pyarrow") is None:
        expected = "the package pyarrow: pip install 'hingepair[data]'; or --out with a name that ends in .csv"
        raise MissingDependencyError("sweep", expected, "none")
    check_writable(out, sweep.files)
    reasons, frames = list[str](), []
    for batch in variants.batches(numbers):
        frames.append(pandas.DataFrame(batch.reduced(sweep.reductions, variants.scene.in_units(sweep.units))))
        reasons += batch.reasons
        if progress is not None:
            progress(len(reasons), len(numbers))
    found = pandas.concat(frames, ignore_index=True)
    if lost := lost_variants(variants.keys, numbers, reasons):
        if all(reasons) and found.isna().all(axis=None):
            raise SceneError(variants.scene.path.name, f"variants that can be computed, but {lost}", "none")
        warnings.warn(lost, SweepWarning, stacklevel=2)
    varied = pandas.DataFrame(numbers, columns=list(variants.keys))
    table = pandas.concat([varied, found], axis=1).rename_axis("variant").reset_index()
    with whole_file(out, sweep.files) as file:
        if out.suffix.lower() == ".csv":
            table.to_csv(file, index=False, lineterminator="\n")
        else:
            table.to_parquet(file, engine="pyarrow", index=False)
