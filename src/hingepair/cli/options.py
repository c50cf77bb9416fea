"""Errors of the library in the words of the command line: `--gravity`, not `gravity`."""

from __future__ import annotations

import functools
import typing
from collections.abc import Callable
from typing import Any

from typer.models import ArgumentInfo, OptionInfo

from hingepair.errors import ArgumentError

# Parameters of the library, and those of commands they come from.
_RENAMED = {"path": ("out",), "robot": ("name", "names")}


def naming_options(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command whose errors name its options and arguments as a user types them."""

    @functools.wraps(command)
    def run(*args: Any, **values: Any) -> None:
        try:
            command(*args, **values)
        except ArgumentError as error:
            typed = _shown_names(command)
            shown = next((typed[name] for name in _RENAMED.get(error.name, (error.name,)) if name in typed), None)
            if shown is None:
                raise
            named = type(error)(shown, error.expected, error.got)
            named.args = (shown + str(error).removeprefix(error.name),)
            for note in getattr(error, "__notes__", ()):
                named.add_note(note)
            raise named from None

    return run


def _shown_names(command: Callable[..., None]) -> dict[str, str]:
    """Return what a user types for each parameter of a command: `--out`, `JOINT`."""
    found = {}
    for name, hint in typing.get_type_hints(command, include_extras=True).items():
        for info in getattr(hint, "__metadata__", ()):
            if isinstance(info, OptionInfo):
                written = (info.default, *(info.param_decls or ()))  # typer takes the first for a default, at first
                options = [one for one in written if isinstance(one, str) and one.startswith("--")]
                found[name] = (*options, f"--{name.replace('_', '-')}")[0]
            elif isinstance(info, ArgumentInfo):
                found[name] = (info.metavar or name.upper()).removesuffix("...")
    return found
