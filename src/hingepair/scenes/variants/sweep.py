"""Sweeps: a design over the numbers of a scene, computed in chunks of variants, on threads or on a cluster."""

from __future__ import annotations

import contextlib
import hashlib
import json
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import execution_of
from hingepair.errors import ArgumentError, HingePairError, SceneError, quoted
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.optional import require
from hingepair.scenes.load import load_scene
from hingepair.scenes.numbers import number_path
from hingepair.scenes.tables import Table, read_tables
from hingepair.scenes.variants.designs import DESIGN_NAMES, design_values, read_varied_number
from hingepair.scenes.variants.reductions import check_reductions
from hingepair.scenes.variants.stores import Store, check_package
from hingepair.scenes.variants.vary import MAX_STATES, VariantTask
from hingepair.tables.units import Units

# Keys that the file of a sweep may have.
_SWEEP_FILE_KEYS: Final = (
    "title",
    "scene",
    "outputs",
    "reduce",
    "design",
    "samples",
    "seed",
    "chunk",
    "units",
    "vary",
)
_SCENE_TABLES: Final = frozenset({"pair", "mechanism", "joint", "motion"})  # one of which every scene has
_TIMEOUT: Final = 10.0  # s; a scheduler that does not answer until then is given up

Progress = Callable[[int, int], None]
"""Takes the number of finished chunks and the number of all chunks."""


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """Sweep that a file describes."""

    #: title in a sentence
    title: str
    #: the part of the sweep that workers need
    task: VariantTask
    #: values of the varied numbers; (variants, numbers)
    numbers: Float64Array
    #: number of variants in a chunk; the last chunk may have fewer
    chunk: int
    #: JSON text of all that the results depend on
    identity: str
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

    def part(self, chunk: int) -> tuple[int, Float64Array]:
        """Return the index of a chunk's first variant, and the numbers of the chunk."""
        first = chunk * self.chunk
        return first, self.numbers[first : first + self.chunk]

    def default_store(self) -> Path:
        """Return the default path of the store: the sweep file's stem with .parquet, or .csv without pyarrow."""
        return Path(f"{self.files[0].stem}{'.parquet' if find_spec('pyarrow') else '.csv'}")


class SweepWarning(UserWarning):
    """Warns that a variant of a sweep cannot be computed, and why."""


def load_sweep(path: str | Path, units: str | None = None) -> Sweep:
    """Read a TOML sweep file, and return it as a Sweep. Compute its first variant as a check.

    Args:
        path: path of the file.
        units: units of results and levels in place of SI units; by default those of the file.
    """
    table = read_tables(path)
    if "scene" not in table.values and not _SCENE_TABLES.isdisjoint(table.values):
        raise SceneError(table.file, "a sweep, whose key scene names a scene", "a scene (hingepair run computes it)")
    table.check_keys(_SWEEP_FILE_KEYS)
    scene_path = Path(path).parent / table.file_name("scene")
    scene = load_scene(scene_path)
    design = table.choice("design", DESIGN_NAMES)
    expected = "tables [[vary]], one for each number that is varied"
    tables = [
        replace(entry, name=f"vary[{i}]") for i, entry in enumerate(table.tables("vary", expected))
    ] or table.fail("vary", expected)
    varied = tuple(read_varied_number(entry, design) for entry in tables)
    for i, (entry, number) in enumerate(zip(tables, varied, strict=True)):
        if number.key in {other.key for other in varied[:i]}:
            entry.refuse("key", "a number that is varied once", quoted(number.key))
        number_path(entry, scene.tables.values, number.key)
    samples, seed, chunk_size = (
        _read_whole_number(table, key, minimum) for key, minimum in (("samples", 1), ("seed", 0), ("chunk", 1))
    )
    if design == "grid":
        for name in ("samples", "seed"):
            if name in table.values:
                table.refuse(name, 'no such key of a grid (design = "random" or "sobol" has it)', table.values[name])
    numbers = design_values(table, design, varied, samples, seed or 0)
    names = 'a list of names such as ["R2", "hinge_torque"]'
    with table.naming("reduce"):
        reductions = check_reductions("reduce", table.names("reduce", names) or ())
    outputs = table.names("outputs", names)
    if outputs is not None:
        with table.naming("outputs"):
            scene.check_arrays(outputs)
    keys = tuple(number.key for number in varied)
    if units is None:
        units = table.text("units") if "units" in table.values else ""
        with table.naming("units"):
            Units(units)
    task = VariantTask.of(scene, keys, outputs, reductions, units)
    _check_any(task, numbers, scene_path.name)
    if chunk_size is None:
        # At least four chunks and about 1000 at most, of as many variants as are computed at once where that fits.
        variants_limit = max(len(numbers) // 1000, MAX_STATES // scene.samples)
        chunk_size = max(1, min(-(-len(numbers) // 4), variants_limit))
    return Sweep(
        title=table.text("title", default=f"{Path(path).stem}: {len(numbers)} variants of {scene_path.name}"),
        task=task,
        numbers=numbers,
        chunk=chunk_size,
        identity=_identity_json(task, numbers, chunk_size, scene.files[1:]),
        files=(Path(path), *scene.files),
    )


def _check_any(task: VariantTask, numbers: Float64Array, scene_name: str) -> None:
    """Compute the first variant or, if that fails, others; raise the error of the first if ten fail."""
    variants, reason = task.variants(), None
    for row in numbers[:10].tolist():
        try:
            variants.compute(row)
        except ArgumentError as error:
            reason = reason or error
        else:
            return
    if reason is not None:
        named = reason.name if isinstance(reason, SceneError) else f"{scene_name}: {reason.name}"
        raise SceneError(f"{_variant_text(task.keys, 0, numbers[0])}: {named}", reason.expected, reason.got)


def _read_whole_number(table: Table, key: str, minimum: int) -> int | None:
    """Return the integer from `minimum` to 10,000,000 under a key of a Table, or None if the key is missing."""
    value = table.values.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int) or not minimum <= value <= 10**7:
        table.fail(key, f"a whole number from {minimum} to 10000000")
    return int(value)


def _identity_json(task: VariantTask, numbers: Float64Array, chunk_size: int, data_files: Sequence[Path]) -> str:
    """Return JSON text of all that the results of a sweep depend on, the version of hingepair and hashes of the
    contents of `data_files` among it.
    """
    from hingepair import __version__

    digests = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in data_files}
    facts = {
        "hingepair": __version__,
        "scene": json.loads(task.tables),
        "files": digests,
        "vary": task.keys,
        "values": hashlib.sha256(numbers.tobytes()).hexdigest(),
        "variants": len(numbers),
        "chunk": chunk_size,
        "outputs": task.outputs,
        "reduce": task.reductions,
        "units": task.units,
    }
    return json.dumps(facts, indent=1)


def run_sweep(
    sweep: Sweep, out: Path, scheduler: str | None = None, workers: int = -1, progress: Progress | None = None
) -> Path:
    """Compute all chunks of a Sweep that are not stored yet, write the store, and return its path `out`.

    Args:
        sweep: a sweep from `load_sweep`.
        out: path of the store; ends in .parquet or .csv. Finished chunks are in the folder `<out>.parts` until all
            are finished; an interrupted sweep continues from them.
        scheduler: address of a `dask.distributed` scheduler; None computes on threads of this process.
        workers: number of these threads; -1 for one on every core.
        progress: is called after each chunk with the numbers of finished chunks and of all chunks.
    """
    check_package(out)
    with contextlib.ExitStack() as stack:
        # A scheduler that does not answer leaves nothing behind.
        client = None if scheduler is None else stack.enter_context(_connect(scheduler))
        pool: Any = ThreadPoolExecutor(execution_of("auto", workers).workers)
        pool = stack.enter_context(pool) if client is None else client.get_executor(pure=False)
        store = stack.enter_context(Store(out, sweep.identity))
        missing = store.missing(sweep.chunks)
        try:
            _compute_chunks(sweep, pool, store, missing, progress)
            store.finish(sweep.chunks)
        except ArgumentError as error:
            kept = sweep.chunks - len(store.missing(sweep.chunks))
            if kept and error.name in ("path", "out", "scheduler"):  # the sweep file need not change
                kept_text = f"{kept} of {sweep.chunks} chunks are kept in {store.parts}"
                error.add_note(f"{kept_text}: the sweep goes on from there")
            raise
    return out


def _compute_chunks(sweep: Sweep, pool: Any, store: Store, chunks: Sequence[int], progress: Progress | None) -> None:
    """Compute chunks on an executor, and store each when it is finished."""
    futures = {pool.submit(compute_chunk, sweep.task, *sweep.part(chunk)): chunk for chunk in chunks}
    try:
        for done, future in enumerate(as_completed(futures), sweep.chunks - len(chunks) + 1):
            try:
                columns = future.result()
            except (HingePairError, MemoryError):
                raise
            except (CancelledError, TimeoutError):
                expected = "a dask.distributed scheduler that runs until the sweep is done"
                raise ArgumentError("scheduler", expected, f"none any more at chunk {futures[future]}") from None
            except Exception as error:
                expected, got = f"workers that finish chunk {futures[future]}", f"{type(error).__name__}: {error}"
                raise ArgumentError("sweep", expected, got) from error
            store.add(futures[future], columns)
            if progress is not None:
                progress(done, sweep.chunks)
    finally:
        for future in futures:  # those that wait end at once, after Ctrl-C too
            future.cancel()


def _connect(scheduler_address: str) -> Any:
    """Return a Dask client that is connected to the scheduler at an address such as tcp://127.0.0.1:8786."""
    client = require("distributed", "scheduler").Client
    try:
        return client(scheduler_address, timeout=_TIMEOUT)
    except (OSError, ValueError, TimeoutError) as error:
        expected = "the address of a dask.distributed scheduler that answers, such as tcp://127.0.0.1:8786"
        raise ArgumentError("scheduler", expected, f"{scheduler_address!r} ({str(error).splitlines()[0]})") from None


def compute_chunk(task: VariantTask, first: int, numbers: Float64Array) -> dict[str, NDArray[Any]]:
    """Compute one chunk of a sweep, and return its columns, with a row for each variant.

    Args:
        task: what to compute for each variant.
        first: index of the chunk's first variant in the sweep.
        numbers: values of the varied numbers; (variants, numbers).

    Returns:
        "variant" (the index in the sweep), the varied numbers by key, and either the reductions, (variants,) each, or
        "t", (variants, samples), and the outputs, (variants, samples, ...).
    """
    shown = task.variants().scene.in_units(task.units)
    parts: list[dict[str, NDArray[Any]]] = []
    done = 0
    for batch in task.batches(numbers):
        for i, reason in enumerate(batch.reasons, done):
            if reason:
                where = _variant_text(task.keys, first + i, numbers[i])
                warnings.warn(f"{where} is NaN: {reason}", SweepWarning, stacklevel=2)
        done += len(batch.reasons)
        if task.reductions:
            parts.append({**batch.reduced(task.reductions, shown)})
        else:
            t = np.broadcast_to(batch.t, (len(batch.reasons), len(batch.t)))
            whole = {"t": t, **batch.arrays}
            parts.append({shown.heading(name): shown.converted(name, array) for name, array in whole.items()})
    columns = {"variant": np.arange(first, first + len(numbers))}
    columns |= {key: np.ascontiguousarray(numbers[:, k]) for k, key in enumerate(task.keys)}
    try:
        return columns | {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    except (ValueError, KeyError):
        expected = "variants with as many instants and the same outputs each, to be kept whole (or reduce = [...])"
        raise ArgumentError(f"variants from {first} on", expected, "variants that differ") from None


def _variant_text(keys: Sequence[str], variant_index: int, numbers: Float64Array) -> str:
    """Return the text that names a variant in messages: its index and the values of its varied numbers."""
    values = ", ".join(f"{key} = {value:.6g}" for key, value in zip(keys, numbers.tolist(), strict=True))
    return f"variant {variant_index} ({values})"
