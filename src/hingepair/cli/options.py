"""Error messages of commands: they name options as users type them, `--gravity` in place of `gravity`."""

from __future__ import annotations

import functools
import typing
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from typer.models import ArgumentInfo, OptionInfo

from hingepair.cli.examples import missing_file_hint
from hingepair.errors import ArgumentError

# The parameters of commands whose values become arguments of the library, by the argument's name in errors.
_PARAMETERS = {
    "path": ("out",),
    "path_or_text": ("source", "name_or_urdf_file"),
    "robot": ("source", "name_or_urdf_file", "names"),
}


def with_option_names(command: Callable[..., None]) -> Callable[..., None]:
    """Return a wrapped command function. The ArgumentErrors that it raises name options and arguments as a user types
    them, and end with a hint at `hingepair examples` if a file that the user typed does not exist.
    """

    @functools.wraps(command)
    def run_command(*args: Any, **values: Any) -> None:
        """Call the command with all arguments. If it raises an ArgumentError, raise the error again with the name of
        the option in place of the name of the Python argument, and with a hint if a typed file does not exist.
        """
        try:
            command(*args, **values)
        except ArgumentError as error:
            typed_names = _typed_names(command)
            parameters = _PARAMETERS.get(error.name, (error.name,))
            name = next((typed_names[name] for name in parameters if name in typed_names), error.name)
            missing = (
                value
                for value in _typed_arguments(command, values)
                if value == error.name or repr(value) in str(error.got)
            )
            hint = next(filter(None, map(missing_file_hint, missing)), None)
            if name == error.name and hint is None:
                raise
            named_error = error.renamed(name)
            if hint is not None:
                named_error.args = (f"{named_error}; {hint}",)
            raise named_error from None

    return run_command


def _typed_arguments(command: Callable[..., None], values: Mapping[str, Any]) -> Iterator[str]:
    """Yield the values of a command's positional arguments as strings, such as paths and names of robots."""
    for name, hint in typing.get_type_hints(command, include_extras=True).items():
        if any(isinstance(info, ArgumentInfo) for info in getattr(hint, "__metadata__", ())):
            value = values.get(name)
            yield from map(str, value if isinstance(value, list) else [] if value is None else [value])


def _typed_names(command: Callable[..., None]) -> dict[str, str]:
    """Return a dict from the name of each parameter of a command function to what a user types for it, such as
    `--out` or `JOINT`.
    """
    typed_names = {}
    for name, hint in typing.get_type_hints(command, include_extras=True).items():
        for info in getattr(hint, "__metadata__", ()):
            if isinstance(info, OptionInfo):
                # Typer stores the first declaration as the default.
                declared = (info.default, *(info.param_decls or ()))
                options = [option for option in declared if isinstance(option, str) and option.startswith("--")]
                typed_names[name] = (*options, f"--{name.replace('_', '-')}")[0]
            elif isinstance(info, ArgumentInfo):
                typed_names[name] = (info.metavar or name.upper()).removesuffix("...")
    return typed_names
