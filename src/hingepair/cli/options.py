"""Error messages of commands: they name options as users type them, `--gravity` in place of `gravity`."""

from __future__ import annotations

import functools
import typing
from collections.abc import Callable
from typing import Any

from typer.models import ArgumentInfo, OptionInfo

from hingepair.errors import ArgumentError

# The parameters of commands that parameters of the library, named in its errors, come from.
_PARAMETER_ALIASES = {"path": ("out",), "robot": ("name", "names")}


def with_option_names(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command whose errors name its options and arguments as a user types them."""

    @functools.wraps(command)
    def run_command(*args: Any, **values: Any) -> None:
        """Run the command; errors name the option of the command line instead of the Python argument."""
        try:
            command(*args, **values)
        except ArgumentError as error:
            typed_names = _typed_names(command)
            parameters = _PARAMETER_ALIASES.get(error.name, (error.name,))
            shown = next((typed_names[name] for name in parameters if name in typed_names), None)
            if shown is None:
                raise
            named_error = type(error)(shown, error.expected, error.got)
            named_error.args = (shown + str(error).removeprefix(error.name),)
            for note in getattr(error, "__notes__", ()):
                named_error.add_note(note)
            raise named_error from None

    return run_command


def _typed_names(command: Callable[..., None]) -> dict[str, str]:
    """Return what a user types for each parameter of a command: `--out`, `JOINT`."""
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
