"""Storage of the results of a sweep: finished chunks beside the store, and the store, whole or not at all."""

from __future__ import annotations

import contextlib
import csv
import io
import os
import shutil
import zlib
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any, Final, Self
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, MissingDependencyError, quoted
from hingepair.tables.column_file import write_npz
from hingepair.tables.data_frames import column_names, split_columns
from hingepair.tables.whole_file import whole_file

STORE_SUFFIXES: Final = (".csv", ".parquet")
"""Endings of the names of stores."""

_LOCK_NAME: Final = "lock"  # file in the folder of the chunks, locked while a sweep runs

ChunkColumns = Mapping[str, NDArray[Any]]
"""Arrays by name, with a row for each variant of a chunk."""


class Store:
    """Results of a sweep on disk.

    While a sweep runs, the files of its chunks are in the folder `<store>.parts`, which the constructor makes and
    locks; as a context manager, a Store unlocks it at the end of the block.

    Args:
        path: path of the store; ends in one of `STORE_SUFFIXES`.
        identity: text that identifies the sweep; chunks of a sweep with another text are refused.
    """

    def __init__(self, path: Path, identity: str) -> None:
        if path.suffix.lower() not in STORE_SUFFIXES:
            raise ArgumentError("out", f"a name that ends in {', '.join(STORE_SUFFIXES)}", quoted(str(path)))
        self.path, self.identity = path, identity
        self.parts = path.with_name(f"{path.name}.parts")
        self._check_new()
        with _convert_os_errors(self.parts):
            self.parts.mkdir(exist_ok=True)
            known = self.parts / "sweep.json"
            if not known.exists() and {*os.listdir(self.parts)} - {_LOCK_NAME}:
                raise ArgumentError("out", "no folder of another program in the way", quoted(str(self.parts)))
            self._lock = _lock(self.parts / _LOCK_NAME)
            try:
                self._check_new()  # the sweep that had the lock may have written it
                if not known.exists():
                    with whole_file(known) as file:
                        file.write(identity.encode())
                elif known.read_bytes() != identity.encode():
                    expected = "a name of its own for each sweep (or remove this folder, of another sweep)"
                    raise ArgumentError("out", expected, quoted(str(self.parts)))
            except BaseException:
                self._lock.close()
                raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.close()

    def _check_new(self) -> None:
        if self.path.exists():
            expected = "a name that does not exist yet (or remove what is there)"
            raise ArgumentError("out", expected, quoted(str(self.path)))

    def missing(self, chunk_count: int) -> list[int]:
        """Return the list of the indices of chunks, from 0 to `chunk_count` - 1, that are not finished."""
        return [chunk for chunk in range(chunk_count) if not self._part(chunk).exists()]

    def add(self, chunk: int, columns: ChunkColumns) -> None:
        """Write the columns of the chunk with this index to its file, completely or not at all."""
        with whole_file(self._part(chunk)) as file:
            write_npz(file, columns)

    def finish(self, chunk_count: int, chunk_size: int) -> None:
        """Write the store from the files of all `chunk_count` chunks, and delete the folder of these files.
        `chunk_size` is the number of variants in each chunk but the last.
        """
        write = {".csv": _write_csv, ".parquet": _write_parquet}[self.path.suffix.lower()]
        with _convert_os_errors(self.path):
            write(self, chunk_count, chunk_size)
            shutil.rmtree(self.parts)

    def read(self, chunk: int) -> dict[str, NDArray[Any]]:
        """Return the columns of the finished chunk with this index from its file."""
        path = self._part(chunk)
        try:
            with np.load(path) as archive:
                return {name: archive[name] for name in archive.files}
        except (EOFError, ValueError, KeyError, AttributeError, BadZipFile, zlib.error):
            expected = "finished chunks that can be read (remove this file, and the same command computes it again)"
            raise ArgumentError("out", expected, f"{str(path)!r}, which is damaged") from None

    def _part(self, chunk: int) -> Path:
        return self.parts / f"part-{chunk:07d}.npz"


def _lock(path: Path) -> IO[bytes]:
    """Return a file, locked until it is closed or the process ends; refuse it if another process has locked it."""
    file = path.open("ab")
    try:
        import fcntl
    except ImportError:  # Windows: two sweeps into one store are not told apart
        file.close()
        return file
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.close()
        raise ArgumentError("out", "a store that no other sweep is writing now", quoted(str(path.parent))) from None
    except OSError:  # a file system without locks
        return file
    if not path.exists() or not os.path.samestat(path.stat(), os.fstat(file.fileno())):
        file.close()  # the other sweep has just finished
        raise ArgumentError("out", "a store that no other sweep is writing now", quoted(str(path.parent)))
    return file


@contextlib.contextmanager
def _convert_os_errors(path: Path) -> Iterator[None]:
    """Convert an OSError in a block into an ArgumentError about `out`, whose message names `path`."""
    try:
        yield
    except OSError as error:
        raise ArgumentError(
            "out", "a place that can be written", f"{str(path)!r} ({error.strerror or error})"
        ) from None


def check_package(path: Path) -> None:
    """Raise a MissingDependencyError if the package that writes a store with the suffix of `path` is missing."""
    if path.suffix.lower() == ".parquet" and find_spec("pyarrow") is None:
        expected = "the package pyarrow: pip install 'hingepair[data]'; or --out with a name that ends in .csv"
        raise MissingDependencyError("sweep", expected, "none")


def _write_csv(store: Store, chunk_count: int, _chunk_size: int) -> None:
    """Write a Store as a CSV file from the files of its `chunk_count` chunks."""
    with whole_file(store.path) as file:
        for chunk in range(chunk_count):
            columns = _scalar_columns(store.read(chunk))
            text = io.StringIO()
            writer = csv.writer(text, lineterminator="\n")
            if chunk == 0:
                writer.writerow(columns)
            writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
            file.write(text.getvalue().encode())


def _write_parquet(store: Store, chunk_count: int, _chunk_size: int) -> None:
    """Write a Store as a Parquet file from the files of its `chunk_count` chunks."""
    import pyarrow as pa
    from pyarrow import parquet

    writer: Any = None
    with contextlib.ExitStack() as opened:
        file = opened.enter_context(whole_file(store.path))
        for chunk in range(chunk_count):
            table = pa.table(_scalar_columns(store.read(chunk)))
            if writer is None:
                schema = table.schema.with_metadata({"sweep": store.identity})
                writer = opened.enter_context(parquet.ParquetWriter(file, schema))
            writer.write_table(table.replace_schema_metadata(schema.metadata))


def _scalar_columns(columns: ChunkColumns) -> dict[str, NDArray[Any]]:
    """Return outputs of a chunk by component, such as R2_x, with a row for each variant and instant; reductions as
    they are.
    """
    t = next((array for name, array in columns.items() if _split_heading(name)[0] == "t"), None)
    if t is None:
        return dict(columns)
    count, samples = t.shape
    scalars: dict[str, NDArray[Any]] = {}
    for name, array in columns.items():
        if array.ndim == 1:
            scalars[name] = np.repeat(array, samples)
        else:
            output, unit = _split_heading(name)
            flat = {output: array.reshape(count * samples, *array.shape[2:])}
            scalars |= {
                f"{component}{unit and f' [{unit}]'}": np.ascontiguousarray(part)
                for component, part in zip(column_names(flat), split_columns(flat), strict=True)
            }
    return scalars


def _split_heading(heading: str) -> tuple[str, str]:
    """Return name and unit of a heading such as R2 [mm]; the unit is empty if there is none."""
    name, _, unit = heading.partition(" [")
    return name, unit.removesuffix("]")
