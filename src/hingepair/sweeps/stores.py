"""Storage of the results of a sweep: finished chunks beside the store, and the store, whole or not at all."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import zlib
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, MissingDependencyError, quoted
from hingepair.numeric.whole_file import whole_file

STORE_SUFFIXES: Final = (".parquet", ".zarr")
"""Endings of stores."""

Columns = Mapping[str, NDArray[Any]]


class Store:
    """The results of a sweep, chunk by chunk.

    While a sweep runs, its finished chunks stand in the folder `<store>.parts`. The store itself appears when all of
    them are there, and the folder goes.

    Args:
        path: of the store; ends in one of `STORE_SUFFIXES`.
        identity: what the sweep is, in full: chunks of another one are not taken.

    Raises:
        ArgumentError: `out`: the store exists, its folder has chunks of another sweep, or it cannot be written.
    """

    def __init__(self, path: Path, identity: str) -> None:
        if path.suffix.lower() not in STORE_SUFFIXES:
            raise ArgumentError("out", f"a name that ends in {' or '.join(STORE_SUFFIXES)}", quoted(str(path)))
        if path.exists():
            raise ArgumentError("out", "a name that does not exist yet (or remove what is there)", quoted(str(path)))
        self.path, self.identity = path, identity
        self.parts = path.with_name(f"{path.name}.parts")
        with _naming_errors(self.parts):
            self.parts.mkdir(exist_ok=True)
            known = self.parts / "sweep.json"
            if not known.exists():
                if any(self.parts.iterdir()):
                    raise ArgumentError("out", "no folder of another program in the way", quoted(str(self.parts)))
                with whole_file(known) as file:
                    file.write(identity.encode())
            elif known.read_text(encoding="utf-8") != identity:
                expected = "a name of its own for each sweep (or remove this folder, whose chunks are of another one)"
                raise ArgumentError("out", expected, quoted(str(self.parts)))

    def missing(self, chunks: int) -> list[int]:
        """Return the numbers of the chunks that are not finished."""
        return [chunk for chunk in range(chunks) if not self._part(chunk).exists()]

    def add(self, chunk: int, columns: Columns) -> None:
        """Keep the results of a chunk, whole or not at all."""
        with whole_file(self._part(chunk)) as file:
            arrays: dict[str, Any] = dict(columns)
            np.savez(file, **arrays)

    def finish(self, chunks: int, chunk_size: int) -> None:
        """Make the store of all chunks, and remove them."""
        write = _write_parquet if self.path.suffix.lower() == ".parquet" else _write_zarr
        with _naming_errors(self.path):
            write(self, chunks, chunk_size)
            shutil.rmtree(self.parts)

    def read(self, chunk: int) -> dict[str, NDArray[Any]]:
        """Return the results of a finished chunk.

        Raises:
            ArgumentError: `out`: the file of the chunk is damaged.
        """
        path = self._part(chunk)
        try:
            with np.load(path) as archive:
                return {name: archive[name] for name in archive.files}
        except (EOFError, ValueError, KeyError, AttributeError, BadZipFile, zlib.error):
            expected = "finished chunks that can be read (remove this file, and the same command computes it again)"
            raise ArgumentError("out", expected, f"{str(path)!r}, which is damaged") from None

    def _part(self, chunk: int) -> Path:
        return self.parts / f"part-{chunk:07d}.npz"


@contextlib.contextmanager
def _naming_errors(path: Path) -> Iterator[None]:
    """Turn errors of the system in the `with` block into errors about `out`."""
    try:
        yield
    except OSError as error:
        raise ArgumentError(
            "out", "a place that can be written", f"{str(path)!r} ({error.strerror or error})"
        ) from None


def check_packages(path: Path) -> None:
    """Refuse to begin where Dask, or the package of the store, is not installed.

    Raises:
        MissingDependencyError: names the package.
    """
    for package in ("dask", {".parquet": "pyarrow", ".zarr": "zarr"}.get(path.suffix.lower(), "numpy")):
        if find_spec(package) is None:
            raise MissingDependencyError("sweep", f"the package {package}: pip install 'hingepair[dask]'", "none")


def _write_parquet(store: Store, chunks: int, _: int) -> None:
    """Write one row for each variant, or for each variant and instant; one row group for each chunk."""
    import pyarrow as pa
    from pyarrow import parquet

    writer: Any = None
    with contextlib.ExitStack() as opened:
        file = opened.enter_context(whole_file(store.path))
        for chunk in range(chunks):
            table = pa.table(_number_columns(store.read(chunk)))
            if writer is None:
                schema = table.schema.with_metadata({"sweep": store.identity})
                writer = opened.enter_context(parquet.ParquetWriter(file, schema))
            writer.write_table(table.replace_schema_metadata(schema.metadata))


def _number_columns(columns: Columns) -> dict[str, NDArray[Any]]:
    """Return columns of scalars; where results have instants, with one row for each variant and instant."""
    if "t" not in columns:
        return dict(columns)
    count, samples = columns["t"].shape
    found: dict[str, NDArray[Any]] = {}
    for name, array in columns.items():
        if array.ndim == 1:
            found[name] = np.repeat(array, samples)
        else:
            flat = array.reshape(count * samples, -1)
            endings = _component_suffixes(array.shape[2:])
            found |= {f"{name}{ending}": np.ascontiguousarray(flat[:, k]) for k, ending in enumerate(endings)}
    return found


def _component_suffixes(tail: tuple[int, ...]) -> list[str]:
    letters = ["".join("xyz"[i] for i in index) for index in np.ndindex(tail)]
    return [f"_{own}" if own else "" for own in letters]


def _write_zarr(store: Store, chunks: int, chunk_size: int) -> None:
    """Write a group of arrays whose first axis is that of the variants; the second is that of the instants."""
    import zarr

    unfinished = store.parts / "store.zarr"
    if unfinished.exists():
        shutil.rmtree(unfinished)
    group: Any = zarr.create_group(store=str(unfinished))
    group.attrs["sweep"] = json.loads(store.identity)
    total = (chunks - 1) * chunk_size + len(store.read(chunks - 1)["variant"])
    for chunk in range(chunks):
        columns = store.read(chunk)
        first = chunk * chunk_size
        for name, array in columns.items():
            if chunk == 0:
                sizes = (min(chunk_size, total), *array.shape[1:])
                group.create_array(name, shape=(total, *array.shape[1:]), chunks=sizes, dtype=array.dtype)
            group[name][first : first + len(array)] = array
    os.replace(unfinished, store.path)
