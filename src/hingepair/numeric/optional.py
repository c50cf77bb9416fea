"""Packages that are installed only where they are wanted, imported where they are used."""

from __future__ import annotations

import importlib
from typing import Any, Final

from hingepair.errors import MissingDependencyError

_EXTRAS: Final = {  # of a package, the extra of hingepair that installs it
    "casadi": "casadi", "dask": "dask", "distributed": "dask", "jax": "jax",
    "matplotlib": "plot", "mujoco": "mjcf", "pyarrow": "data", "torch": "torch",
}  # fmt: skip


def require(module: str, caller: str) -> Any:
    """Import a module of an optional package, and return it.

    Args:
        module: name, such as "matplotlib.figure".
        caller: the method or argument that needs it, which the error names.

    Raises:
        MissingDependencyError: the package is not installed, or fails.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        expected = f"the package {package}: pip install 'hingepair[{_EXTRAS[package]}]'"
        raise MissingDependencyError(caller, expected, str(error)) from None
