"""Sweeps: a design over the numbers of a scene, computed in chunks of variants and written to a table.

While a sweep runs, finished chunks are files in the folder `<table>.parts`; an interrupted sweep continues from them.
"""

from __future__ import annotations

import hashlib
import json
import math
import shutil
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, MissingDependencyError, SceneError, quoted
from hingepair.numeric.arrays import Float64Array
from hingepair.scenes.load import load_scene
from hingepair.scenes.numbers import number_path
from hingepair.scenes.tables import Table, read_tables
from hingepair.scenes.variants.reductions import check_reductions
from hingepair.scenes.variants.vary import MAX_STATES, Variants, lost_variants
from hingepair.tables.column_file import write_npz
from hingepair.tables.units import Units
from hingepair.tables.whole_file import whole_file

STORE_SUFFIXES: Final = (".csv", ".parquet")
"""Endings of the names of tables."""
_KEYS: Final = ("title", "scene", "outputs", "reduce", "design", "samples", "seed", "units", "vary")
_SCENE_TABLES: Final = frozenset({"pair", "mechanism", "joint", "motion"})  # one of which every scene has
_MAX_VARIANTS: Final = 10_000_000

Progress = Callable[[int, int], None]
"""Takes the number of finished chunks and the number of all chunks."""


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

    @property
    def chunks(self) -> int:
        """The number of chunks, of as many variants as are computed at once: 4 at least, and about 1000 at most."""
        count = len(self.numbers)
        at_once = max(count // 1000, MAX_STATES // self.variants.scene.samples, 1)
        return min(count, max(4, -(-count // at_once)))

    def identity(self) -> str:
        """Return JSON text of all that the results depend on, the version of hingepair and the contents of the log
        and of the URDF of the scene among it.
        """
        from hingepair import __version__

        facts = {
            "hingepair": __version__,
            "scene": self.variants.scene.tables.values,
            "files": {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in self.files[2:]},
            "vary": self.variants.keys,
            "values": hashlib.sha256(self.numbers.tobytes()).hexdigest(),
            "outputs": self.variants.outputs,
            "reduce": self.reductions,
            "units": self.units,
        }
        return json.dumps(facts, indent=1, default=str)

    def default_store(self) -> Path:
        """Return the default path of the table: the sweep file's stem with .parquet, or .csv without pyarrow."""
        return Path(f"{self.files[0].stem}{'.parquet' if find_spec('pyarrow') else '.csv'}")


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


def run_sweep(sweep: Sweep, out: Path, progress: Progress | None = None) -> Path:
    """Compute all chunks of a Sweep that are not stored yet, write the table, and return its path `out`.

    Args:
        sweep: a sweep from `load_sweep`.
        out: path of the table; ends in .parquet or .csv. Finished chunks are in the folder `<out>.parts` until all
            are finished; an interrupted sweep continues from them.
        progress: is called after each chunk with the numbers of finished chunks and of all chunks.

    Raises:
        SceneError: no variant can be computed.
    """
    import pandas

    if out.suffix.lower() not in STORE_SUFFIXES:
        raise ArgumentError("out", f"a name that ends in {', '.join(STORE_SUFFIXES)}", quoted(str(out)))
    if out.suffix.lower() == ".parquet" and find_spec("pyarrow") is None:
        expected = "the package pyarrow: pip install 'hingepair[data]'; or --out with a name that ends in .csv"
        raise MissingDependencyError("sweep", expected, "none")
    if out.exists():
        raise ArgumentError("out", "a name that does not exist yet (or remove what is there)", quoted(str(out)))
    parts, frames = _open_parts(out, sweep.identity()), []
    reasons: list[str] = []
    try:
        for k, rows in enumerate(np.array_split(np.arange(len(sweep.numbers)), sweep.chunks)):
            part = parts / f"part-{k:07d}.npz"
            if not part.exists():
                columns = compute_chunk(sweep, rows)
                with whole_file(part) as file:
                    write_npz(file, columns)
            with np.load(part) as archive:
                columns = {name: archive[name] for name in archive.files}
            reasons += columns.pop("reason").tolist()
            frames.append(pandas.DataFrame(columns))
            if progress is not None:
                progress(k + 1, sweep.chunks)
        frame = pandas.concat(frames)
        if all(reasons) and frame.iloc[:, 1 + len(sweep.variants.keys) :].isna().all(axis=None):
            shutil.rmtree(parts)
            sentence = lost_variants(sweep.variants.keys, sweep.numbers, reasons)
            path = sweep.variants.scene.path
            raise SceneError(path.name, f"variants that can be computed, but {sentence}", "none")
    finally:
        if not any(parts.glob("part-*")):
            shutil.rmtree(parts, ignore_errors=True)
    with whole_file(out) as file:
        if out.suffix.lower() == ".csv":
            frame.to_csv(file, index=False, lineterminator="\n")
        else:
            frame.attrs = {"sweep": json.loads(sweep.identity())}
            frame.to_parquet(file, engine="pyarrow", index=False)
    shutil.rmtree(parts)
    return out


def _open_parts(out: Path, identity: str) -> Path:
    """Return the folder of the finished chunks of a table; refuse that of another sweep or program."""
    parts = out.with_name(f"{out.name}.parts")
    known = parts / "sweep.json"
    parts.mkdir(exist_ok=True)
    if any(parts.iterdir()) and not (known.exists() and known.read_bytes() == identity.encode()):
        expected = "a name of its own for each sweep (or remove this folder, which is of another one)"
        raise ArgumentError("out", expected, quoted(str(parts)))
    with whole_file(known) as file:
        file.write(identity.encode())
    return parts


def compute_chunk(sweep: Sweep, rows: NDArray[np.intp]) -> dict[str, NDArray[Any]]:
    """Compute some variants of a sweep, and return their columns, with a row for each variant: its index in the
    sweep, the varied numbers by key, the reductions, and why it cannot be computed, if so.
    """
    variants, numbers = sweep.variants, sweep.numbers[rows]
    batches = [*variants.batches(numbers)]
    reasons = [reason for batch in batches for reason in batch.reasons]
    if sentence := lost_variants(variants.keys, numbers, reasons):
        warnings.warn(f"variants {rows[0]} to {rows[-1]}: {sentence}", SweepWarning, stacklevel=2)
    reduced = [batch.reduced(sweep.reductions, variants.scene.in_units(sweep.units)) for batch in batches]
    columns = {"variant": rows, **dict(zip(variants.keys, numbers.T, strict=True))}
    columns |= {name: np.concatenate([own[name] for own in reduced]) for name in reduced[0]}
    return columns | {"reason": np.array(reasons)}
