"""Error messages of commands: they name options as users type them, `--gravity` in place of `gravity`."""

from __future__ import annotations

import functools
import typing
from collections.abc import Callable
from typing import Any

from typer.models import ArgumentInfo, OptionInfo

from hingepair.cli.examples import missing_file_hint
from hingepair.errors import ArgumentError

# Parameters of commands whose values become arguments of the library, by the argument's name in errors.
_PARAMETERS = {
    "path": ("out",),
    "points": ("point",),
    "sources": ("files",),
    "path_or_text": ("source", "name_or_urdf_file"),
    "robot": ("source", "name_or_urdf_file", "names"),
}


def with_option_names(command: Callable[..., None]) -> Callable[..., None]:
    """Return the command with errors that name what a user types, and that end with a hint at `hingepair examples` if
    a file that the user typed does not exist.
    """

    @functools.wraps(command)
    def run(*args: Any, **values: Any) -> None:
        try:
            command(*args, **values)
        except ArgumentError as error:
            typed, files = _typed(command, values)
            parameters = _PARAMETERS.get(error.name, (error.name,))
            named = error.renamed(next((typed[name] for name in parameters if name in typed), error.name))
            missing = (file for file in files if file == error.name or repr(file) in str(error.got))
            if hint := next(filter(None, map(missing_file_hint, missing)), None):
                named.said += f"; {hint}"
            raise named from None

    return run


def _typed(command: Callable[..., None], values: dict[str, Any]) -> tuple[dict[str, str], list[str]]:
    """Return what a user types for each parameter, such as `--out` or `JOINT`, and the values of the positional ones,
    such as paths and names of robots.
    """
    typed: dict[str, str] = {}
    given: list[str] = []
    for name, hint in typing.get_type_hints(command, include_extras=True).items():
        for info in getattr(hint, "__metadata__", ()):
            if isinstance(info, OptionInfo):
                # Typer stores the first declaration as the default.
                declared = (info.default, *(info.param_decls or ()))
                options = [option for option in declared if isinstance(option, str) and option.startswith("--")]
                typed[name] = (*options, f"--{name.replace('_', '-')}")[0]
            elif isinstance(info, ArgumentInfo):
                typed[name] = (info.metavar or name.upper()).removesuffix("...")
                value = values.get(name)
                given += map(str, value if isinstance(value, list) else [] if value is None else [value])
    return typed, given
