"""Sweeps: a design over the numbers of a scene, computed in chunks of variants, on threads or on a cluster."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import itertools
import json
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import compile_at_first_call, execution_of
from hingepair.errors import ArgumentError, HingePairError, MissingDependencyError, SceneError, choices, quoted
from hingepair.numeric.arrays import Float64Array
from hingepair.scenes.scene import scene_files
from hingepair.scenes.tables import Table, read_tables
from hingepair.sweeps.designs import DESIGNS, design_values, read_varied
from hingepair.sweeps.reductions import NAMES, is_reduction, reduce_arrays
from hingepair.sweeps.stores import Store, check_packages
from hingepair.sweeps.variants import VariantComputer, check_number, parse_key

# Keys and tables that the file of a sweep may have.
_SWEEP_KEYS: Final = ("title", "scene", "outputs", "reduce", "design", "samples", "seed", "chunk", "vary")
_SCENE_TABLES: Final = frozenset({"pair", "mechanism", "joint", "motion"})  # one of which every scene has
_MAX_CHUNKS: Final = 1000  # of a sweep whose file does not say how many variants a chunk has
_CHUNK_STATES: Final = 200_000  # states of a chunk, likewise
_OUTSIDE_ERRORS: Final = ("path", "out", "scheduler")  # arguments in errors that need no other sweep file
_CONNECT_SECONDS: Final = 10.0  # until a scheduler that does not answer is given up

Progress = Callable[[int, int], None]
"""Is told the numbers of finished chunks and of all."""


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """Sweep that a file describes: a scene, the varied numbers, and the division into chunks.

    Attributes:
        title: what it is, in a sentence.
        job: what a worker needs of it.
        keys: the varied numbers, as they are written.
        numbers: their values; (variants, numbers).
        chunk: variants of a chunk.
        identity: all that the results depend on, as JSON.
        files: that it was read from.
    """

    title: str
    job: SweepTask
    keys: tuple[str, ...]
    numbers: Float64Array
    chunk: int
    identity: str
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
        """Return the name of the store unless another is given: the file's, .parquet of reductions, .zarr of all."""
        return Path(f"{self.files[0].stem}{'.parquet' if self.job.reductions else '.zarr'}")


@dataclass(frozen=True, slots=True)
class SweepTask:
    """Part of a sweep that is sent to workers; it can be pickled.

    Attributes:
        path: of the scene's file.
        tables: what stands in it, as JSON.
        keys: the varied numbers, as they are written.
        outputs: what is computed; None for all that the scene has.
        reductions: what is kept of it; empty for the whole motion.
    """

    path: str
    tables: str
    keys: tuple[str, ...]
    outputs: tuple[str, ...] | None
    reductions: tuple[str, ...]


def load_sweep(path: str | Path) -> Sweep:
    """Read a sweep from a TOML file; docs/scenes.md describes the format.

    Raises:
        SceneError: the file cannot be read as a sweep; names file, table and key.
    """
    table = read_tables(path)
    if "scene" not in table.values and not _SCENE_TABLES.isdisjoint(table.values):
        raise SceneError(table.file, "a sweep, whose key scene names a scene", "a scene (hingepair run computes it)")
    table.check_keys(_SWEEP_KEYS)
    scene_path = Path(path).parent / table.text("scene")
    scene = read_tables(scene_path)
    design = table.choice("design", DESIGNS)
    given = table.values.get("vary")
    if not isinstance(given, list) or not given or not all(isinstance(own, dict) for own in given):
        table.fail("vary", "tables [[vary]], one for each number that is varied")
    varied = tuple(read_varied(_entry(table, i, own), design) for i, own in enumerate(given))
    for i, own in enumerate(varied):
        entry = _entry(table, i, given[i])
        if own.key in {other.key for other in varied[:i]}:
            entry.refuse("key", "a number that is varied once", quoted(own.key))
        check_number(entry, scene.values, parse_key(entry, own.key))
    samples, seed, chunk = (_read_whole_number(table, *one) for one in (("samples", 1), ("seed", 0), ("chunk", 1)))
    if design == "grid":
        for name in ("samples", "seed"):
            if name in table.values:
                table.refuse(name, 'no such key of a grid (design = "random" or "sobol" has it)', table.values[name])
    numbers = design_values(table, design, varied, samples, seed or 0)
    reductions = _names(table, "reduce") or ()
    for name in reductions:
        if not is_reduction(name):
            table.refuse("reduce", f"{choices(NAMES)}; of quantiles any, such as q2.5", quoted(name))
    files = (Path(path), *scene_files(scene_path))
    contents = json.dumps(scene.values, sort_keys=True, default=str)
    job = SweepTask(str(scene_path), contents, tuple(own.key for own in varied), _names(table, "outputs"), reductions)
    first = _variants(job)
    with table.naming("outputs"), compile_at_first_call():
        try:
            first.compute(numbers[0])  # says at once what cannot be computed
        except SceneError as error:
            raise SceneError(f"{_described(job, 0, numbers[0])}: {error.name}", error.expected, error.got) from None
    size = chunk or max(
        1, min(-(-len(numbers) // 4), max(len(numbers) // _MAX_CHUNKS, _CHUNK_STATES // first.samples))
    )
    return Sweep(
        title=table.text("title", default=f"{Path(path).stem}: {len(numbers)} variants of {scene_path.name}"),
        job=job,
        keys=job.keys,
        numbers=numbers,
        chunk=size,
        identity=_identity(job, numbers, size, files[1:]),
        files=files,
    )


def _entry(table: Table, number: int, values: dict[str, Any]) -> Table:
    return Table(table.file, f"vary[{number}]", values, table.constants)


def _read_whole_number(table: Table, name: str, least: int) -> int | None:
    """Return the integer under a key, None where the key is missing; refuse one below `least`."""
    value = table.values.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= 10**7:
        table.fail(name, f"a whole number from {least} to 10000000")
    return int(value)


def _names(table: Table, name: str) -> tuple[str, ...] | None:
    """Return the list of names under a key without repetitions, None where the key is missing."""
    value = table.values.get(name)
    if value is None:
        return None
    if not isinstance(value, list) or not value or not all(isinstance(own, str) for own in value):
        table.fail(name, 'a list of names such as ["R2", "hinge_torque"]')
    return tuple(dict.fromkeys(value))


def _identity(job: SweepTask, numbers: Float64Array, chunk: int, files: Sequence[Path]) -> str:
    """Return all that the results depend on, as JSON."""
    from hingepair import __version__

    digests = {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files[1:]}
    facts = {
        "hingepair": __version__,
        "scene": json.loads(job.tables),
        "files": digests,
        "vary": job.keys,
        "values": hashlib.sha256(numbers.tobytes()).hexdigest(),
        "variants": len(numbers),
        "chunk": chunk,
        "outputs": job.outputs,
        "reduce": job.reductions,
    }
    return json.dumps(facts, indent=1)


def run_sweep(
    sweep: Sweep, out: Path, scheduler: str | None = None, workers: int = -1, progress: Progress | None = None
) -> Path:
    """Compute all variants of a sweep that are not computed yet, and write its store.

    Args:
        sweep: from `load_sweep`.
        out: the store: .parquet or .zarr. What is finished stands beside it until all is; an interrupted sweep is
            taken up where it was.
        scheduler: address of a `dask.distributed` scheduler; threads of this process unless given.
        workers: number of these threads; -1 for one on every core.
        progress: is told how far it is.

    Returns:
        The path of the store.

    Raises:
        ArgumentError: the store exists, cannot be written, the scheduler does not answer, or a variant cannot be
            computed: names chunk, variant and its numbers.
        MissingDependencyError: the extra dask is not installed.
    """
    check_packages(out)
    with contextlib.ExitStack() as connected:
        # A scheduler that does not answer leaves nothing behind.
        client = None if scheduler is None else connected.enter_context(_client(scheduler))
        _run(sweep, Store(out, sweep.identity), client, workers, progress)
    return out


def _run(sweep: Sweep, store: Store, client: Any, workers: int, progress: Progress | None) -> None:
    """Compute the chunks that are missing, on a cluster's workers or on threads, and finish the store."""
    missing = store.missing(sweep.chunks)
    finished = itertools.count(sweep.chunks - len(missing) + 1)

    def add(number: int, columns: Mapping[str, NDArray[Any]]) -> None:
        """Store the columns of one finished chunk, and report the progress."""
        store.add(number, columns)
        with _LOCK:
            done = next(finished)
        if progress is not None:
            progress(done, sweep.chunks)

    try:
        if missing and client is None:
            _on_threads(sweep, missing, add, execution_of("auto", workers).workers)
        elif missing:
            _on_cluster(client, sweep, missing, add)
        store.finish(sweep.chunks, sweep.chunk)
    except ArgumentError as error:
        kept = sweep.chunks - len(store.missing(sweep.chunks))
        if kept and error.name in _OUTSIDE_ERRORS:
            error.add_note(f"{kept} of {sweep.chunks} chunks are kept in {store.parts}: the sweep goes on from there")
        raise


ChunkWriter = Callable[[int, Mapping[str, NDArray[Any]]], None]
"""Takes the number and the results of a finished chunk."""


def _on_threads(sweep: Sweep, missing: Sequence[int], add: ChunkWriter, threads: int) -> None:
    """Compute chunks on threads of this process."""
    import dask

    def task(number: int) -> None:
        first = number * sweep.chunk
        add(number, compute_chunk(sweep.job, number, first, sweep.numbers[first : first + sweep.chunk]))

    tasks = [dask.delayed(task, pure=False)(number) for number in missing]
    try:
        dask.compute(*tasks, scheduler="threads", num_workers=threads, optimize_graph=False)
    except (HingePairError, MemoryError, OSError):
        raise
    except Exception as error:
        raise _chunk_error(error, "all chunks") from error


def _client(scheduler: str) -> Any:
    """Return a client of a cluster.

    Raises:
        ArgumentError: the scheduler does not answer.
        MissingDependencyError: distributed is not installed.
    """
    try:
        from distributed import Client
    except ImportError as error:
        needed = "the package distributed: pip install 'hingepair[dask]'"
        raise MissingDependencyError("scheduler", needed, str(error)) from None
    try:
        return Client(scheduler, timeout=_CONNECT_SECONDS)
    except (OSError, ValueError, TimeoutError) as error:
        expected = "the address of a dask.distributed scheduler that answers, such as tcp://127.0.0.1:8786"
        raise ArgumentError("scheduler", expected, f"{scheduler!r} ({str(error).splitlines()[0]})") from None


def _on_cluster(client: Any, sweep: Sweep, missing: Sequence[int], add: ChunkWriter) -> None:
    """Compute chunks on the workers of a cluster; a chunk whose worker dies is computed by another."""
    from distributed import as_completed

    if not client.scheduler_info()["workers"]:
        address = client.scheduler.address
        sentence = f"the scheduler has no worker yet, and the sweep waits for one: dask worker {address} starts one"
        warnings.warn(sentence, stacklevel=2)
    parts = {number: sweep.numbers[number * sweep.chunk : (number + 1) * sweep.chunk] for number in missing}
    futures = {
        client.submit(
            compute_chunk, sweep.job, number, number * sweep.chunk, part, key=f"{_key(sweep)}-{number}", pure=False
        ): number
        for number, part in parts.items()
    }
    try:
        for future in as_completed(list(futures)):
            number = futures.pop(future)
            if future.status == "error":
                raise _chunk_error(future.exception(), f"chunk {number}") from None
            try:
                columns = future.result()
            except (CancelledError, OSError, TimeoutError):
                expected = "a dask.distributed scheduler that runs until the sweep is done"
                raise ArgumentError("scheduler", expected, f"none any more at chunk {number}") from None
            add(number, columns)
            future.release()
    finally:
        client.cancel(list(futures))


def _key(sweep: Sweep) -> str:
    return f"hingepair-sweep-{hashlib.sha256(sweep.identity.encode()).hexdigest()[:16]}"


def _chunk_error(error: Any, where: str) -> Exception:
    """Return an error that names a chunk."""
    if isinstance(error, ArgumentError):
        return error
    if isinstance(error, HingePairError | MemoryError):
        error.add_note(f"in {where}")
        return error
    return ArgumentError("sweep", f"workers that finish {where}", f"{type(error).__name__}: {error}")


def compute_chunk(job: SweepTask, chunk: int, first: int, numbers: Float64Array) -> dict[str, NDArray[Any]]:
    """Compute some variants of a sweep: what a task does.

    Args:
        job: of the sweep.
        chunk: number of the chunk, for messages.
        first: number of its first variant.
        numbers: the varied numbers; (variants, numbers).

    Returns:
        By name: "variant", the varied numbers by key, and the reductions, (variants,) each; of whole motions "t",
        (variants, samples), and the outputs, (variants, samples, ...).

    Raises:
        ArgumentError: a variant cannot be computed: names it.
    """
    variants = _variants(job)
    step = max(1, _CHUNK_STATES // variants.samples)
    parts: list[dict[str, NDArray[Any]]] = []
    with compile_at_first_call():
        for start in range(0, len(numbers), step):
            rows = numbers[start : start + step]
            together = variants.compute_together(rows)
            if together is None:
                parts += _one_by_one(variants, job, chunk, first + start, rows)
            else:
                parts.append(_kept(*together, job))
    columns = {"variant": np.arange(first, first + len(numbers))}
    columns |= {key: np.ascontiguousarray(numbers[:, k]) for k, key in enumerate(job.keys)}
    try:
        return columns | {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    except (ValueError, KeyError):
        expected = "variants with as many instants and the same outputs each, to be kept whole (or reduce = [...])"
        raise ArgumentError(f"chunk {chunk}", expected, "variants that differ") from None


def _one_by_one(
    variants: VariantComputer, job: SweepTask, chunk: int, first: int, numbers: Float64Array
) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield what is kept of each variant; arguments and errors are those of `compute_chunk`."""
    for i, row in enumerate(numbers):
        try:
            t, arrays = variants.compute(row)
            yield _kept(t, {name: array[None] for name, array in arrays.items()}, job)
        except ArgumentError as error:
            where = f"chunk {chunk}, {_described(job, first + i, row)}: {error.name}"
            raise ArgumentError(where, error.expected, error.got) from None


def _described(job: SweepTask, variant: int, row: Float64Array) -> str:
    """Return how messages name a variant: by its number and its values."""
    values = ", ".join(f"{key} = {value:.6g}" for key, value in zip(job.keys, row.tolist(), strict=True))
    return f"variant {variant} ({values})"


def _kept(t: Float64Array, arrays: Mapping[str, NDArray[Any]], job: SweepTask) -> dict[str, NDArray[Any]]:
    """Return the reductions of variants, (variants,) each, or "t" and all outputs, (variants, samples, ...)."""
    if job.reductions:
        return {**reduce_arrays(t, arrays, job.reductions)}
    count = len(next(iter(arrays.values())))
    return {"t": np.broadcast_to(t, (count, len(t))), **arrays}


_LOCK = threading.Lock()  # of what the threads of a worker share


def _variants(job: SweepTask) -> VariantComputer:
    """Return the variants of a job, which a worker makes once."""
    with _LOCK, compile_at_first_call():
        return _made_variants(job)


@functools.lru_cache(maxsize=4)
def _made_variants(job: SweepTask) -> VariantComputer:
    values = json.loads(job.tables)
    keys = [parse_key(Table("", "", {}, {}), key) for key in job.keys]
    return VariantComputer(job.path, values, keys, job.outputs)
