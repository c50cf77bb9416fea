"""Sweeps: a design over the numbers of a scene, computed in chunks of variants, on threads or on a cluster."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import json
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
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
from hingepair.scenes.variants.vary import MAX_STATES, Batch, VariantTask
from hingepair.tables.units import Columns, Units

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
    task: SweepTask
    #: keys of the varied numbers, as the file writes them, such as "pair.u1[0]"
    keys: tuple[str, ...]
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

    def default_store(self) -> Path:
        """Return the default path of the store: the sweep file's stem with .parquet, or .csv without pyarrow."""
        return Path(f"{self.files[0].stem}{'.parquet' if find_spec('pyarrow') else '.csv'}")


class SweepWarning(UserWarning):
    """Warns that a variant of a sweep cannot be computed, and why."""


@dataclass(frozen=True, slots=True)
class SweepTask:
    """Part of a sweep that is sent to workers."""

    #: the scene, its varied numbers and its outputs
    variants: VariantTask
    #: names of the reductions to store; empty to store the outputs at all instants
    reductions: tuple[str, ...]
    #: units of results and levels in place of SI units
    units: str = ""


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
    task = SweepTask(VariantTask.of(scene, keys, outputs), reductions, _read_units(table) if units is None else units)
    _check_any(task, numbers, scene_path.name)
    if chunk_size is None:
        # At least four chunks and about 1000 at most, of as many variants as are computed at once where that fits.
        variants_limit = max(len(numbers) // 1000, MAX_STATES // scene.samples)
        chunk_size = max(1, min(-(-len(numbers) // 4), variants_limit))
    return Sweep(
        title=table.text("title", default=f"{Path(path).stem}: {len(numbers)} variants of {scene_path.name}"),
        task=task,
        keys=keys,
        numbers=numbers,
        chunk=chunk_size,
        identity=_identity_json(task, numbers, chunk_size, scene.files[1:]),
        files=(Path(path), *scene.files),
    )


def _check_any(task: SweepTask, numbers: Float64Array, scene_name: str) -> None:
    """Compute the first variant or, if that fails, others; raise the error of the first if ten fail."""
    variants, reason = task.variants.variants(), None
    for row in numbers[:10].tolist():
        try:
            variants.compute(row)
        except ArgumentError as error:
            reason = reason or error
        else:
            return
    if reason is not None:
        named = reason.name if isinstance(reason, SceneError) else f"{scene_name}: {reason.name}"
        raise SceneError(f"{_variant_text(task, 0, numbers[0])}: {named}", reason.expected, reason.got)


def _read_whole_number(table: Table, key: str, minimum: int) -> int | None:
    """Return the integer from `minimum` to 10,000,000 under a key of a Table, or None if the key is missing."""
    value = table.values.get(key)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int) or not minimum <= value <= 10**7:
        table.fail(key, f"a whole number from {minimum} to 10000000")
    return int(value)


def _read_units(table: Table) -> str:
    """Return the units that a Table names, checked; an empty text if it names none."""
    if "units" not in table.values:
        return ""
    text = table.text("units")
    with table.naming("units"):
        Units(text)
    return text


def _identity_json(task: SweepTask, numbers: Float64Array, chunk_size: int, data_files: Sequence[Path]) -> str:
    """Return JSON text of all that the results of a sweep depend on, the version of hingepair and hashes of the
    contents of `data_files` among it.
    """
    from hingepair import __version__

    digests = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in data_files}
    facts = {
        "hingepair": __version__,
        "scene": json.loads(task.variants.tables),
        "files": digests,
        "vary": task.variants.keys,
        "values": hashlib.sha256(numbers.tobytes()).hexdigest(),
        "variants": len(numbers),
        "chunk": chunk_size,
        "outputs": task.variants.outputs,
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
    with contextlib.ExitStack() as connected:
        # A scheduler that does not answer leaves nothing behind.
        client = None if scheduler is None else connected.enter_context(_connect(scheduler))
        store = connected.enter_context(Store(out, sweep.identity))
        _compute_missing_chunks(sweep, store, client, workers, progress)
    return out


def _compute_missing_chunks(sweep: Sweep, store: Store, client: Any, workers: int, progress: Progress | None) -> None:
    """Compute the chunks that a Store lacks, on the cluster of a Dask client or, if it is None, on `workers` threads,
    and then write the store.
    """
    missing = store.missing(sweep.chunks)
    finished, lock = itertools.count(sweep.chunks - len(missing) + 1), threading.Lock()

    def store_chunk(chunk_index: int, columns: Mapping[str, NDArray[Any]]) -> None:
        store.add(chunk_index, columns)
        with lock:
            done = next(finished)
        if progress is not None:
            progress(done, sweep.chunks)

    try:
        if missing and client is None:
            _compute_on_threads(sweep, missing, store_chunk, execution_of("auto", workers).workers)
        elif missing:
            _compute_on_cluster(client, sweep, missing, store_chunk)
        store.finish(sweep.chunks, sweep.chunk)
    except ArgumentError as error:
        kept = sweep.chunks - len(store.missing(sweep.chunks))
        if kept and error.name in ("path", "out", "scheduler"):  # the sweep file need not change
            error.add_note(f"{kept} of {sweep.chunks} chunks are kept in {store.parts}: the sweep goes on from there")
        raise


ChunkWriter = Callable[[int, Mapping[str, NDArray[Any]]], None]
"""Takes the index and the columns of a finished chunk."""


def _compute_on_threads(
    sweep: Sweep, chunk_indices: Sequence[int], store_chunk: ChunkWriter, thread_count: int
) -> None:
    """Compute chunks of a Sweep on threads of this process, and hand each to `store_chunk` when it is finished."""
    stopped = threading.Event()

    def compute_and_store(chunk_index: int) -> None:
        if stopped.is_set():
            return
        first = chunk_index * sweep.chunk
        try:
            store_chunk(
                chunk_index, compute_chunk(sweep.task, chunk_index, first, sweep.numbers[first : first + sweep.chunk])
            )
        except BaseException:
            stopped.set()
            raise

    with ThreadPoolExecutor(thread_count) as pool:
        try:
            for done in as_completed([pool.submit(compute_and_store, chunk_index) for chunk_index in chunk_indices]):
                done.result()
        except (HingePairError, MemoryError, OSError):
            raise
        except Exception as error:
            raise _error_of_chunk(error, "all chunks") from error
        finally:
            stopped.set()  # chunks that wait end at once, after Ctrl-C too


def _connect(scheduler_address: str) -> Any:
    """Return a Dask client that is connected to the scheduler at an address such as tcp://127.0.0.1:8786."""
    client = require("distributed", "scheduler").Client
    try:
        return client(scheduler_address, timeout=_TIMEOUT)
    except (OSError, ValueError, TimeoutError) as error:
        expected = "the address of a dask.distributed scheduler that answers, such as tcp://127.0.0.1:8786"
        raise ArgumentError("scheduler", expected, f"{scheduler_address!r} ({str(error).splitlines()[0]})") from None


def _compute_on_cluster(client: Any, sweep: Sweep, chunk_indices: Sequence[int], store_chunk: ChunkWriter) -> None:
    """Compute chunks of a Sweep on a Dask client's cluster, and hand each to `store_chunk` when it is finished."""
    from distributed import as_completed as as_finished

    if not client.scheduler_info()["workers"]:
        address = client.scheduler.address
        sentence = f"the scheduler has no worker yet, and the sweep waits for one: dask worker {address} starts one"
        warnings.warn(sentence, stacklevel=2)
    parts = {number: sweep.numbers[number * sweep.chunk : (number + 1) * sweep.chunk] for number in chunk_indices}
    futures = {
        client.submit(
            compute_chunk, sweep.task, number, number * sweep.chunk, part, key=f"{_key(sweep)}-{number}", pure=False
        ): number
        for number, part in parts.items()
    }
    try:
        for future in as_finished(list(futures)):
            number = futures.pop(future)
            if future.status == "error":
                raise _error_of_chunk(future.exception(), f"chunk {number}") from None
            try:
                columns = future.result()
            except (CancelledError, OSError, TimeoutError):
                expected = "a dask.distributed scheduler that runs until the sweep is done"
                raise ArgumentError("scheduler", expected, f"none any more at chunk {number}") from None
            store_chunk(number, columns)
            future.release()
    finally:
        client.cancel(list(futures))


def _key(sweep: Sweep) -> str:
    return f"hingepair-sweep-{hashlib.sha256(sweep.identity.encode()).hexdigest()[:16]}"


def _error_of_chunk(error: Any, chunk_text: str) -> Exception:
    """Return the exception to raise for an error of a worker; it names the chunk unless it names an argument."""
    if isinstance(error, ArgumentError):
        return error
    if isinstance(error, HingePairError | MemoryError):
        error.add_note(f"in {chunk_text}")
        return error
    return ArgumentError("sweep", f"workers that finish {chunk_text}", f"{type(error).__name__}: {error}")


def compute_chunk(
    task: SweepTask, chunk_index: int, first_variant: int, numbers: Float64Array
) -> dict[str, NDArray[Any]]:
    """Compute one chunk of a sweep, and return its columns, with a row for each variant.

    Args:
        task: what to compute for each variant.
        chunk_index: index of the chunk, for messages.
        first_variant: index of the chunk's first variant in the sweep.
        numbers: values of the varied numbers; (variants, numbers).

    Returns:
        "variant" (the index in the sweep), the varied numbers by key, and either the reductions, (variants,) each, or
        "t", (variants, samples), and the outputs, (variants, samples, ...).
    """
    shown = task.variants.variants().scene.in_units(task.units)
    parts: list[dict[str, NDArray[Any]]] = []
    done = first_variant
    for batch in task.variants.batches(numbers):
        for i, reason in enumerate(batch.reasons):
            if reason:
                where = _variant_text(task, done + i, numbers[done + i - first_variant])
                warnings.warn(f"{where} is NaN: {reason}", SweepWarning, stacklevel=2)
        parts.append(_result_columns(batch, task, shown))
        done += len(batch.reasons)
    columns = {"variant": np.arange(first_variant, first_variant + len(numbers))}
    columns |= {key: np.ascontiguousarray(numbers[:, k]) for k, key in enumerate(task.variants.keys)}
    try:
        return columns | {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    except (ValueError, KeyError):
        expected = "variants with as many instants and the same outputs each, to be kept whole (or reduce = [...])"
        raise ArgumentError(f"chunk {chunk_index}", expected, "variants that differ") from None


def _variant_text(task: SweepTask, variant_index: int, numbers: Float64Array) -> str:
    """Return the text that names a variant in messages: its index and the values of its varied numbers."""
    values = ", ".join(
        f"{key} = {value:.6g}" for key, value in zip(task.variants.keys, numbers.tolist(), strict=True)
    )
    return f"variant {variant_index} ({values})"


def _result_columns(batch: Batch, task: SweepTask, columns: Columns) -> dict[str, NDArray[Any]]:
    """Return the reductions, (variants,), that a SweepTask names, or else "t" and the outputs, (variants, samples,
    ...), under headings in the units of `columns`.
    """
    if task.reductions:
        return {**batch.reduced(task.reductions, columns)}
    t = np.broadcast_to(batch.t, (len(batch.reasons), len(batch.t)))
    whole = {"t": t, **batch.arrays}
    return {columns.heading(name): columns.converted(name, array) for name, array in whole.items()}
