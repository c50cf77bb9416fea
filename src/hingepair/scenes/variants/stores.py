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

ChunkColumns = Mapping[str, NDArray[Any]]
"""Arrays by name, with a row for each variant of a chunk."""


class Store:
    """Results of a sweep on disk.

    While a sweep runs, the files of its chunks are in the folder `<store>.parts`, which the constructor makes; as a
    context manager, a Store holds a lock on it.

    Args:
        path: path of the store; ends in one of `STORE_SUFFIXES`.
        identity: text that identifies the sweep; chunks of a sweep with another text are refused.
    """

    def __init__(self, path: Path, identity: str) -> None:
        if path.suffix.lower() not in STORE_SUFFIXES:
            raise ArgumentError("out", f"a name that ends in {', '.join(STORE_SUFFIXES)}", quoted(str(path)))
        self.path, self.identity = path, identity
        self.parts = path.with_name(f"{path.name}.parts")
        self._lock: IO[bytes] | None = None

    def __enter__(self) -> Self:
        known = self.parts / "sweep.json"
        self._check_new()
        with _convert_os_errors(self.parts):
            self.parts.mkdir(exist_ok=True)
            if not known.exists() and {*os.listdir(self.parts)} - {"lock"}:
                raise ArgumentError("out", "no folder of another program in the way", quoted(str(self.parts)))
            self._lock = _lock(self.parts / "lock")
            self._check_new()  # the sweep that had the lock may have written it
            if not known.exists():
                with whole_file(known) as file:
                    file.write(self.identity.encode())
            elif known.read_bytes() != self.identity.encode():
                self.__exit__()
                expected = "a name of its own for each sweep (or remove this folder, of another sweep)"
                raise ArgumentError("out", expected, quoted(str(self.parts)))
        return self

    def __exit__(self, *_: object) -> None:
        if self._lock is not None:
            self._lock.close()

    def _check_new(self) -> None:
        if self.path.exists():
            expected = "a name that does not exist yet (or remove what is there)"
            raise ArgumentError("out", expected, quoted(str(self.path)))

    def missing(self, chunk_count: int) -> list[int]:
        """Return the indices of chunks, from 0 to `chunk_count` - 1, that are not finished."""
        return [chunk for chunk in range(chunk_count) if not self._part(chunk).exists()]

    def add(self, chunk: int, columns: ChunkColumns) -> None:
        """Write the columns of the chunk with this index to its file, completely or not at all."""
        with whole_file(self._part(chunk)) as file:
            write_npz(file, columns)

    def finish(self, chunk_count: int) -> None:
        """Write the store from the files of all chunks, and delete the folder of these files."""
        chunks = (_scalar_columns(self._read(chunk)) for chunk in range(chunk_count))
        with _convert_os_errors(self.path), whole_file(self.path) as file:
            (_write_csv if self.path.suffix.lower() == ".csv" else _write_parquet)(file, chunks, self.identity)
        with _convert_os_errors(self.parts):
            shutil.rmtree(self.parts)

    def _read(self, chunk: int) -> dict[str, NDArray[Any]]:
        """Return the columns of the finished chunk with this index."""
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
    """Return a file, locked until it is closed or the process ends; refuse it if another sweep has locked it."""
    file = path.open("ab")
    try:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except ImportError:  # Windows: two sweeps into one store are not told apart
        return file
    except BlockingIOError:
        file.close()
        raise ArgumentError("out", "a store that no other sweep is writing now", quoted(str(path.parent))) from None
    except OSError:  # a file system without locks
        return file
    return file


@contextlib.contextmanager
def _convert_os_errors(path: Path) -> Iterator[None]:
    """Convert an OSError in a block into an ArgumentError about `out`, whose message names `path`."""
    try:
        yield
    except OSError as error:
        got = f"{str(path)!r} ({error.strerror or error})"
        raise ArgumentError("out", "a place that can be written", got) from None


def check_package(path: Path) -> None:
    """Raise a MissingDependencyError if the package that writes a store with the suffix of `path` is missing."""
    if path.suffix.lower() == ".parquet" and find_spec("pyarrow") is None:
        expected = "the package pyarrow: pip install 'hingepair[data]'; or --out with a name that ends in .csv"
        raise MissingDependencyError("sweep", expected, "none")


def _write_csv(file: IO[bytes], chunks: Iterator[ChunkColumns], _identity: str) -> None:
    for number, columns in enumerate(chunks):
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        if number == 0:
            writer.writerow(columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
        file.write(text.getvalue().encode())


def _write_parquet(file: IO[bytes], chunks: Iterator[ChunkColumns], identity: str) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    writer: Any = None
    with contextlib.ExitStack() as opened:
        for columns in chunks:
            table = pa.table(dict(columns))
            if writer is None:
                schema = table.schema.with_metadata({"sweep": identity})
                writer = opened.enter_context(parquet.ParquetWriter(file, schema))
            writer.write_table(table.replace_schema_metadata(schema.metadata))


def _scalar_columns(columns: ChunkColumns) -> dict[str, NDArray[Any]]:
    """Return outputs of a chunk by component, such as R2_x, with a row for each variant and instant; reductions as
    they are.
    """
    t = next((array for name, array in columns.items() if name.partition(" [")[0] == "t"), None)
    if t is None:
        return dict(columns)
    count, samples = t.shape
    scalars: dict[str, NDArray[Any]] = {}
    for name, array in columns.items():
        if array.ndim == 1:
            scalars[name] = np.repeat(array, samples)
            continue
        output, bracket, unit = name.partition(" [")
        flat = {output: array.reshape(count * samples, *array.shape[2:])}
        for component, part in zip(column_names(flat), split_columns(flat), strict=True):
            scalars[component + bracket + unit] = np.ascontiguousarray(part)
    return scalars
