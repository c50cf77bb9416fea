"""The compiled kernels in memory and on disk."""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
import sys
import threading
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from hingepair.errors import MissingDependencyError

_SOURCES = (
    *("equations/spatial.py", "equations/planar.py", "evaluation/kernel_math.py", "evaluation/kernel_memory.py"),
    *("evaluation/kernel_rows.py", "evaluation/kernel_steps.py", "evaluation/kernel_flat_steps.py"),
    *("evaluation/kernels.py", "numeric/twofold.py"),
)
_lock = threading.Lock()


class Kernels(NamedTuple):
    """The compiled functions; Numba compiles each for a dtype when it is first called with it."""

    kernel: Any
    one_state: Any


def available() -> bool:
    """Whether Numba is installed."""
    return importlib.util.find_spec("numba") is not None


def loaded() -> bool:
    """Whether the kernels are in memory already."""
    return bool(_build.cache_info().currsize)


def kernels() -> Kernels:
    """The kernels, compiled or taken from the cache on disk when they are first called.

    Raises:
        MissingDependencyError: Numba is not installed, or does not work.
    """
    if loaded():
        return _build()
    with _lock:
        return _build()


@functools.cache
def _build() -> Kernels:
    try:
        from hingepair.evaluation import kernel_math
        from hingepair.evaluation import kernels as source
    except ImportError as error:
        raise MissingDependencyError("backend", "numba (pip install numba)", str(error)) from None
    return Kernels(*_compiled((source.kernel, source.one_state), kernel_math.FLAGS))


def _compiled(functions: tuple[Callable[..., Any], ...], fastmath: set[str]) -> list[Any]:
    """The functions, to be compiled or taken from the cache when they are called."""
    import numba

    folder = _cache_folder(numba.__version__)
    config: Any = numba.config
    before = config.CACHE_DIR
    try:
        if folder is not None:
            config.CACHE_DIR = str(folder)
        jit = numba.njit(cache=folder is not None, fastmath=fastmath, nogil=True)
        return [jit(function) for function in functions]
    finally:
        config.CACHE_DIR = before


def _cache_folder(version: str) -> Path | None:
    """Where compiled kernels are kept: its name carries a hash of all that is compiled; None where it cannot be made.

    Numba's own cache looks at the file of a kernel alone, and would go on with old equations.
    """
    sources = [(Path(__file__).parents[1] / name).read_bytes() for name in _SOURCES]
    key = hashlib.sha256(b"\0".join([version.encode(), sys.version.encode(), *sources])).hexdigest()[:16]
    root = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    try:
        folder = Path(root).expanduser() / "hingepair" / key
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".{os.getpid()}.{threading.get_ident()}"
        probe.touch()
        probe.unlink()
    except (OSError, RuntimeError) as error:
        warnings.warn(f"compiled kernels cannot be kept on disk: {error}", RuntimeWarning, stacklevel=2)
        return None
    return folder
