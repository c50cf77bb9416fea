"""One way to run a command of hingepair: as a user types it, with its exit code checked."""

from __future__ import annotations

import io
import sys
from typing import NamedTuple

import pytest

from hingepair.cli.main import main


class Printed(NamedTuple):
    """What a command printed."""

    stdout: str
    stderr: str


def run_command(*arguments: object, code: int = 0) -> Printed:
    """Run a command in this process, without its signal handlers, and check its exit code.

    Warnings stay warnings: they are not turned into lines of standard error.
    """
    streams = [io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["hingepair", *map(str, arguments)])
        patch.setattr("hingepair.cli.main.set_up_process", lambda: None)
        for name, stream in zip(("stdout", "stderr"), streams, strict=True):
            patch.setattr(sys, name, stream)
        with pytest.raises(SystemExit) as done:
            main()
    printed = Printed(*(stream.buffer.getvalue().decode() for stream in streams))
    assert done.value.code == code, f"exit code {done.value.code} of {arguments}\n{printed.stdout}{printed.stderr}"
    return printed


def refusal(*arguments: object) -> str:
    """Return the message of a command that refuses its input: exit code 2, no output."""
    printed = run_command(*arguments, code=2)
    assert printed.stdout == ""
    assert printed.stderr.startswith("hingepair: ")
    return printed.stderr.removeprefix("hingepair: ").rstrip("\n")
