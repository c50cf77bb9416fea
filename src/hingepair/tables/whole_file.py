"""Files that are there whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO
from uuid import uuid4

from hingepair.errors import ArgumentError


@contextlib.contextmanager
def whole_file(
    target: str | os.PathLike[str], input_paths: Iterable[str | os.PathLike[str]] = ()
) -> Iterator[IO[bytes]]:
    """Yield a binary file to write to, which replaces the target only when the `with` block ends without an error.

    Until then it stands beside the target, whose mode it keeps; through a symlink it is the file behind it
    that is replaced. Devices and pipes are written directly.

    Args:
        target: where the file shall be.
        input_paths: files that are being read from, which the target must not be.

    Raises:
        ArgumentError: `path`, the target, cannot be written, or is one of the inputs; what was there before stays.
    """
    with _os_errors_named(target):
        status = _checked_status(target, input_paths)
        if status is not None and not stat.S_ISREG(status.st_mode):
            with Path(target).open("wb") as file:
                yield file
            return
        behind = Path(os.path.realpath(target))
        path = behind.with_name(f".hingepair-{uuid4().hex}")
        # What replaces a private file is private from the first byte; a new file has the mode of the process.
        mode = 0o666 if status is None else 0o600
        with open(path, "xb", opener=lambda name, flags: os.open(name, flags, mode)) as file:
            try:
                yield file
                file.flush()
                os.fsync(file.fileno())
                if status is not None:
                    path.chmod(stat.S_IMODE(status.st_mode))
                path.replace(behind)
            except BaseException:
                path.unlink(missing_ok=True)
                raise


def check_writable(target: str | os.PathLike[str], input_paths: Iterable[str | os.PathLike[str]] = ()) -> None:
    """Raise the error that `whole_file` would raise at its start, and leave no file behind."""
    with _os_errors_named(target):
        status = _checked_status(target, input_paths)
        if status is None or stat.S_ISREG(status.st_mode):
            with tempfile.TemporaryFile(dir=Path(os.path.realpath(target)).parent):
                pass


@contextlib.contextmanager
def _os_errors_named(target: str | os.PathLike[str]) -> Iterator[None]:
    """Raise an ArgumentError about `path` in the place of an OSError of the block."""
    try:
        yield
    except OSError as error:
        got = f"{os.fspath(target)!r} ({error.strerror or error})"
        raise ArgumentError("path", "a file that can be written", got) from None


def _checked_status(
    target: str | os.PathLike[str], input_paths: Iterable[str | os.PathLike[str]]
) -> os.stat_result | None:
    """Return the status of the target, None if there is none; refuse a folder, what may not be written, and a target
    that is one of the inputs.
    """
    status = _file_status(target)
    if status is None:
        return None
    if any(os.path.samestat(status, other) for other in map(_file_status, input_paths) if other):
        raise ArgumentError("path", "a file other than those that are read", repr(os.fspath(target)))
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not os.access(target, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    return status


def _file_status(path: str | os.PathLike[str]) -> os.stat_result | None:
    """Return the status of a file, or of what a symlink leads to; None if there is none."""
    try:
        return Path(path).stat()
    except FileNotFoundError:
        return None
    except ValueError as error:  # a NUL in the name
        raise OSError(str(error)) from None
