"""Sweeps: a design over the numbers of a scene, computed in chunks of variants, here or on a cluster.

While a sweep runs, finished chunks are files in the folder `<store>.parts`; an interrupted sweep continues from them.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import shutil
import warnings
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, MissingDependencyError, SceneError, quoted
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.optional import require
from hingepair.scenes.load import load_scene
from hingepair.scenes.numbers import number_path
from hingepair.scenes.tables import Table, read_tables
from hingepair.scenes.variants.reductions import check_reductions
from hingepair.scenes.variants.vary import MAX_STATES, Variants
from hingepair.tables.column_file import write_npz
from hingepair.tables.units import Units
from hingepair.tables.whole_file import whole_file

STORE_SUFFIXES: Final = (".csv", ".parquet")
"""Endings of the names of stores."""
_KEYS: Final = ("title", "scene", "outputs", "reduce", "design", "samples", "seed", "chunk", "units", "vary")
_SCENE_TABLES: Final = frozenset({"pair", "mechanism", "joint", "motion"})  # one of which every scene has
_MAX_VARIANTS: Final = 10_000_000
_MAX_SOBOL: Final = 21_201  # numbers for which SciPy has directions
_TIMEOUT: Final = 10.0  # s; a scheduler that does not answer until then is given up

Progress = Callable[[int, int], None]
"""Takes the number of finished chunks and the number of all chunks."""


class SweepWarning(UserWarning):
    """Warns that a variant of a sweep cannot be computed, and why."""


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """Sweep that a file describes."""

    #: title in a sentence
    title: str
    #: computer of the variants
    computer: Variants
    #: names of the reductions
    reductions: tuple[str, ...]
    #: units of results and levels in place of SI units
    units: str
    #: values of the varied numbers; (variants, numbers)
    numbers: Float64Array
    #: number of variants in a chunk; the last chunk may have fewer
    chunk: int
    #: files that the sweep was read from: its own, and those of the scene
    files: tuple[Path, ...]

    @property
    def variants(self) -> int:
        """The number of variants."""
        return len(self.numbers)

    @property
    def chunks(self) -> int:
        """The number of chunks."""
        return -(-self.variants // self.chunk)

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of the varied numbers in the scene file."""
        return self.computer.keys

    def identity(self) -> str:
        """Return JSON text of all that the results depend on, the version of hingepair and the contents of the log
        and of the URDF of the scene among it.
        """
        from hingepair import __version__

        facts = {
            "hingepair": __version__,
            "scene": self.computer.scene.tables.values,
            "files": {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in self.files[2:]},
            "vary": self.keys,
            "values": hashlib.sha256(self.numbers.tobytes()).hexdigest(),
            "chunk": self.chunk,
            "outputs": self.computer.outputs,
            "reduce": self.reductions,
            "units": self.units,
        }
        return json.dumps(facts, indent=1, default=str)

    def default_store(self) -> Path:
        """Return the default path of the store: the sweep file's stem with .parquet, or .csv without pyarrow."""
        return Path(f"{self.files[0].stem}{'.parquet' if find_spec('pyarrow') else '.csv'}")


def load_sweep(path: str | Path, units: str | None = None) -> Sweep:
    """Read a TOML sweep file, and return it as a Sweep. Compute its first variant as a check.

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
    names = 'a list of names such as ["R2", "hinge_torque"]'
    outputs = table.names("outputs", names)
    with table.naming("outputs"):
        computer = Variants(scene, keys, outputs)
    with table.naming("reduce"):
        wanted = 'a list of reductions such as ["max", "last"]; hp.vary keeps whole motions'
        reductions = check_reductions("reduce", table.names("reduce", wanted) or table.fail("reduce", wanted))
    if units is None:
        units = table.text("units") if "units" in table.values else ""
        with table.naming("units"):
            Units(units)
    _check_any(computer, numbers, scene_path.name)
    # At least four chunks and about 1000 at most, of as many variants as are computed at once where that fits.
    most = max(len(numbers) // 1000, MAX_STATES // scene.samples)
    chunk = _read_count(table, "chunk", max(1, min(-(-len(numbers) // 4), most)))
    return Sweep(
        title=table.text("title", default=f"{Path(path).stem}: {len(numbers)} variants of {scene_path.name}"),
        computer=computer,
        reductions=reductions,
        units=units,
        numbers=numbers,
        chunk=chunk,
        files=(Path(path), *scene.files),
    )


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

    if len(entries) > _MAX_SOBOL:
        table.refuse("vary", f"at most {_MAX_SOBOL} numbers of a Sobol design", len(entries))
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


def _check_any(computer: Variants, numbers: Float64Array, scene_name: str) -> None:
    """Compute the first variant or, if that fails, others; raise the error of the first if ten fail."""
    reason = None
    for row in numbers[:10].tolist():
        try:
            computer.compute(row)
        except ArgumentError as error:
            reason = reason or error
        else:
            return
    if reason is not None:
        named = reason.name if isinstance(reason, SceneError) else f"{scene_name}: {reason.name}"
        raise SceneError(f"{_variant_text(computer.keys, 0, numbers[0])}: {named}", reason.expected, reason.got)


def run_sweep(sweep: Sweep, out: Path, scheduler: str | None = None, progress: Progress | None = None) -> Path:
    """Compute all chunks of a Sweep that are not stored yet, write the store, and return its path `out`.

    Args:
        sweep: a sweep from `load_sweep`.
        out: path of the store; ends in .parquet or .csv. Finished chunks are in the folder `<out>.parts` until all
            are finished; an interrupted sweep continues from them.
        scheduler: address of a `dask.distributed` scheduler; None computes in this process.
        progress: is called after each chunk with the numbers of finished chunks and of all chunks.
    """
    if out.suffix.lower() not in STORE_SUFFIXES:
        raise ArgumentError("out", f"a name that ends in {', '.join(STORE_SUFFIXES)}", quoted(str(out)))
    if out.suffix.lower() == ".parquet" and find_spec("pyarrow") is None:
        expected = "the package pyarrow: pip install 'hingepair[data]'; or --out with a name that ends in .csv"
        raise MissingDependencyError("sweep", expected, "none")
    if out.exists():
        raise ArgumentError("out", "a name that does not exist yet (or remove what is there)", quoted(str(out)))
    with contextlib.nullcontext() if scheduler is None else _connect(scheduler) as client:
        parts = _open_parts(out, sweep.identity())
        files = [parts / f"part-{chunk:07d}.npz" for chunk in range(sweep.chunks)]
        missing = [chunk for chunk, file in enumerate(files) if not file.exists()]
        try:
            for done, (chunk, columns) in enumerate(_computed(sweep, missing, client), len(files) - len(missing) + 1):
                with whole_file(files[chunk]) as file:
                    write_npz(file, columns)
                if progress is not None:
                    progress(done, sweep.chunks)
            _write_store(out, files, sweep.identity())
        except ArgumentError as error:
            if kept := sum(file.exists() for file in files):
                error.add_note(f"{kept} of {len(files)} chunks are kept in {parts}: the sweep goes on from there")
            raise
    shutil.rmtree(parts)
    return out


def _open_parts(out: Path, identity: str) -> Path:
    """Return the folder of the finished chunks of a store; refuse that of another sweep."""
    parts = out.with_name(f"{out.name}.parts")
    known = parts / "sweep.json"
    try:
        parts.mkdir(exist_ok=True)
        if not known.exists() and any(parts.iterdir()):
            raise ArgumentError("out", "no folder of another program in the way", quoted(str(parts)))
        if known.exists() and known.read_bytes() != identity.encode():
            expected = "a name of its own for each sweep (or remove this folder, of another sweep)"
            raise ArgumentError("out", expected, quoted(str(parts)))
    except OSError as error:
        got = f"{str(parts)!r} ({error.strerror or error})"
        raise ArgumentError("out", "a place that can be written", got) from None
    with whole_file(known) as file:
        file.write(identity.encode())
    return parts


def _computed(sweep: Sweep, chunks: Sequence[int], client: Any) -> Iterator[tuple[int, dict[str, NDArray[Any]]]]:
    """Yield the columns of chunks with their indices, as they are finished, computed here or on a Dask cluster."""
    tasks = [
        (sweep.computer, sweep.reductions, sweep.units, chunk * sweep.chunk,
         sweep.numbers[chunk * sweep.chunk : (chunk + 1) * sweep.chunk])
        for chunk in chunks
    ]  # fmt: skip
    if client is None:
        yield from ((chunk, compute_chunk(*task)) for chunk, task in zip(chunks, tasks, strict=True))
        return
    futures = {
        client.submit(compute_chunk, *task, pure=False): chunk for chunk, task in zip(chunks, tasks, strict=True)
    }
    distributed = require("distributed", "scheduler")
    try:
        for future in distributed.as_completed(futures):
            yield futures[future], future.result()
    except (distributed.CancelledError, OSError, RuntimeError) as error:
        expected = "a dask.distributed scheduler and workers that run until the sweep is done"
        raise ArgumentError("scheduler", expected, f"{type(error).__name__}: {error}") from None


def _connect(scheduler_address: str) -> Any:
    """Return a Dask client that is connected to the scheduler at an address such as tcp://127.0.0.1:8786."""
    client = require("distributed", "scheduler").Client
    try:
        return client(scheduler_address, timeout=_TIMEOUT)
    except (OSError, ValueError) as error:
        expected = "the address of a dask.distributed scheduler that answers, such as tcp://127.0.0.1:8786"
        raise ArgumentError("scheduler", expected, f"{scheduler_address!r} ({str(error).splitlines()[0]})") from None


def compute_chunk(
    computer: Variants, reductions: Sequence[str], units: str, first: int, numbers: Float64Array
) -> dict[str, NDArray[Any]]:
    """Compute one chunk of a sweep, and return its columns, with a row for each variant: its index in the sweep, the
    varied numbers by key, and the reductions.

    Args:
        computer: computer of the variants.
        reductions: names of the reductions.
        units: units of results and levels.
        first: index of the chunk's first variant in the sweep.
        numbers: values of the varied numbers; (variants, numbers).
    """
    batches, shown = [*computer.batches(numbers)], computer.scene.in_units(units)
    for i, reason in enumerate(reason for batch in batches for reason in batch.reasons):
        if reason:
            where = _variant_text(computer.keys, first + i, numbers[i])
            warnings.warn(f"{where} is NaN: {reason}", SweepWarning, stacklevel=2)
    reduced = [batch.reduced(reductions, shown) for batch in batches]
    columns = {"variant": np.arange(first, first + len(numbers)), **dict(zip(computer.keys, numbers.T, strict=True))}
    return columns | {name: np.concatenate([own[name] for own in reduced]) for name in reduced[0]}


def _write_store(out: Path, files: Sequence[Path], identity: str) -> None:
    """Write the store from the files of all chunks."""
    import pandas

    frames = []
    for path in files:
        try:
            with np.load(path) as archive:
                frames.append(pandas.DataFrame({name: archive[name] for name in archive.files}))
        except (EOFError, ValueError, KeyError, AttributeError, BadZipFile, zlib.error):
            expected = "finished chunks that can be read (remove this file, and the same command computes it again)"
            raise ArgumentError("out", expected, f"{str(path)!r}, which is damaged") from None
    frame = pandas.concat(frames)
    with whole_file(out) as file:
        if out.suffix.lower() == ".csv":
            frame.to_csv(file, index=False, lineterminator="\n")
        else:
            frame.attrs = {"sweep": json.loads(identity)}
            frame.to_parquet(file, engine="pyarrow", index=False)


def _variant_text(keys: Sequence[str], variant_index: int, numbers: Float64Array) -> str:
    """Return the text that names a variant in messages: its index and the values of its varied numbers."""
    values = ", ".join(f"{key} = {value:.6g}" for key, value in zip(keys, numbers.tolist(), strict=True))
    return f"variant {variant_index} ({values})"
