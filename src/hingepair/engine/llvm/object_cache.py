"""Machine code on disk: compiled once on a machine, and loaded by every later process.

The folder is `HINGEPAIR_CACHE`, or `hingepair` in the user's folder for caches; `HINGEPAIR_CACHE=off` turns it off.
What is read is run: the folder must belong to this user or to root, nobody else may write there, and the digest must
be right. A file that cannot be read or written is as if it were not there.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import stat
import warnings
from pathlib import Path
from typing import Final
from uuid import uuid4

MAX_BYTES: Final = 256 * 2**20  # of all files; past this, the files longest unused are deleted

TRACED_PACKAGES: Final = ("engine", "equations", "inverse_kinematics", "numeric", "plans", "rotations", "tables")
"""Packages whose code writes programs; they import no others."""

_TRIMMED: Final = 0.75  # share of the limit to which a folder past it is trimmed
_MAGIC: Final = b"hingepair object 1\n"  # begins a file; then come the digest and the value
_DIGEST_BYTES: Final = 32  # of SHA-256
_PREFIX: Final = "hingepair-"  # of names of files
_OFF: Final = {"off", "0"}  # values of HINGEPAIR_CACHE

_looked = False  # whether this process has looked at how full the folder is


def cache_folder() -> Path | None:
    """Return the folder of compiled code, which may not exist yet; None where the cache is turned off, where the user
    has no home, or, with a warning, where others could put files into the folder.
    """
    given = os.environ.get("HINGEPAIR_CACHE", "")
    path = Path(os.path.expanduser(given or _user_folder()))
    if given.lower() in _OFF or str(path).startswith("~"):
        return None
    if not path.is_absolute():
        _warn_of(path, "it is relative to the current folder")
        return None
    try:
        doubt = _doubt(path.stat())
    except OSError:  # it does not exist yet
        return path
    if doubt:
        _warn_of(path, doubt)
    return None if doubt else path


@functools.cache
def _user_folder() -> str:
    """Return this user's folder of compiled code; "~" without a home."""
    import platformdirs

    try:
        return platformdirs.user_cache_dir("hingepair", appauthor=False)
    except RuntimeError:
        return "~"


def cache_key(*parts: str) -> str:
    """Return the key of what these texts define, a digest in hexadecimal digits."""
    digest = hashlib.sha256()
    for part in parts:
        encoded = part.encode()
        digest.update(b"%d:" % len(encoded))
        digest.update(encoded)
    return digest.hexdigest()


def _source_digest() -> str | None:
    """Return the digest of the sources that decide what a form of a program computes; None where there are none. They
    are read, since times of files do not tell every edit.
    """
    digest, found = hashlib.sha256(), False
    for name in TRACED_PACKAGES:
        for path in sorted((Path(__file__).parents[2] / name).rglob("*.py")):
            found = True
            digest.update(b"%d:" % path.stat().st_size + path.read_bytes())
    return digest.hexdigest() if found else None


def read_object(key: str) -> bytes | None:
    """Return what is kept under a key; None if nothing is, or if the file is damaged."""
    folder = cache_folder()
    if folder is None:
        return None
    path = _path(folder, key)
    try:
        content = path.read_bytes()
    except OSError:
        return None
    value = content[len(_MAGIC) + _DIGEST_BYTES :]
    if content[: -len(value) or None] != _MAGIC + _digest(key, value):
        return None  # damaged: it is made again, and replaced
    with contextlib.suppress(OSError):
        os.utime(path)  # of the last use
    return value


def write_object(key: str, value: bytes) -> None:
    """Keep bytes under a key, if the folder can be written; the file appears when it is whole."""
    folder = cache_folder()
    if folder is None:
        return
    path = folder / f"{_PREFIX}{uuid4().hex}.part"
    try:
        folder.mkdir(mode=0o755, parents=True, exist_ok=True)
        path.write_bytes(_MAGIC + _digest(key, value) + value)
        path.replace(_path(folder, key))
    except OSError:  # a full or read-only disk
        with contextlib.suppress(OSError):
            path.unlink()
        return
    _trim(folder)


def _trim(folder: Path) -> None:
    """Delete what was not used for the longest time, where the folder has become too large, of what processes that
    were killed have left too. A process looks at its first write.
    """
    global _looked  # noqa: PLW0603 (of the process; that two threads look is no harm)
    if _looked:
        return
    _looked = True
    files = list[tuple[float, int, Path]]()  # time of last use [s], bytes, path
    for path in folder.glob(f"{_PREFIX}*"):
        with contextlib.suppress(OSError):
            status = path.lstat()
            files.append((status.st_mtime, status.st_size, path))
    total = sum(size for _, size, _ in files)
    most = MAX_BYTES if total <= MAX_BYTES else _TRIMMED * MAX_BYTES
    for _, size, path in sorted(files):
        if total > most:
            with contextlib.suppress(OSError):
                path.unlink()
                total -= size


def _path(folder: Path, key: str) -> Path:
    return folder / f"{_PREFIX}{key}.object"


def _digest(key: str, value: bytes) -> bytes:
    """Return the digest of a value under its key: a whole file under another name is not taken."""
    return hashlib.sha256(key.encode() + value).digest()


def _doubt(status: os.stat_result) -> str:
    """Return why a file or folder is not to be trusted, or an empty text."""
    if hasattr(os, "geteuid"):
        if status.st_uid not in {os.geteuid(), 0}:
            return f"it belongs to user {status.st_uid}"
        if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            return "others can write it"
    return ""


def _warn_of(path: Path, doubt: str) -> None:
    """Warn that a file or a folder is not used."""
    advice = "HINGEPAIR_CACHE can name another folder for compiled code"
    warnings.warn(f"{path} is not used: {doubt}. {advice}", RuntimeWarning, stacklevel=2)


SOURCE_DIGEST: Final = _source_digest()
"""Digest of the sources that this process has imported: an upgrade may replace them while it runs."""
