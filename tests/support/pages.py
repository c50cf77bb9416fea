"""The code of a Markdown page: Python blocks, commands and files, run from the first to the last."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from support.commands import run_command

_FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_FILE_NAME = re.compile(r"Save this as `([^`\n]+)`:\n\n\Z")
_COMMAND = re.compile(r"^\$ (hingepair .*)\n((?:(?!\$ ).*\n)*)", re.MULTILINE)


class Step(NamedTuple):
    """One piece of code of a page."""

    kind: str
    """"python", "command" or "file"."""
    code: str
    """Source, command line, or content of the file."""
    expected: str
    """Output that the page shows; of a file its name."""
    line: int
    """Number of the line of the page on which the code starts."""


def page_steps(page: Path) -> list[Step]:
    """Return the steps of a page in their order.

    A step is a block of Python, whose output is the block of text behind it; or a command of a console block; or a
    block behind the sentence "Save this as `NAME`:", which is a file.
    """
    text = page.read_text(encoding="utf-8")
    steps: list[Step] = []
    end_of_python = -1
    for block in _FENCE.finditer(text):
        language, code = block[1], block[2]
        line = text.count("\n", 0, block.start(2)) + 1
        if name := _FILE_NAME.search(text, 0, block.start()):
            steps.append(Step("file", code, name[1], line))
        elif language == "python":
            steps.append(Step("python", code, "", line))
            end_of_python = block.end()
        elif language == "text" and block.start() == end_of_python + 2:
            steps[-1] = steps[-1]._replace(expected=code)
        elif language == "console":
            steps += (Step("command", command[1], command[2], line) for command in _COMMAND.finditer(code))
    return steps


def run_page(page: Path) -> Iterator[tuple[Step, str]]:
    """Run the steps of a page in the working directory, the Python blocks in one namespace.

    Yields:
        Each step that shows output, and what it printed. Lines that the page leaves out by a line "..." are left out
        of what a command printed.
    """
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for step in page_steps(page):
        if step.kind == "file":
            Path(step.expected).write_text(step.code, encoding="utf-8")
        elif step.kind == "python":
            printed = io.StringIO()
            source = "\n" * (step.line - 1) + step.code
            with contextlib.redirect_stdout(printed):
                exec(compile(source, str(page), "exec"), namespace)
            yield step, printed.getvalue()
        else:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # lines of standard error, which pages do not show
                printed = run_command(*shlex.split(step.code)[1:]).stdout
            yield step, _shortened(printed, step.expected)


def _shortened(printed: str, expected: str) -> str:
    """Return the expected text where the printed one has all its lines in order; else the printed one."""
    pattern = "(?:.*\n)*".join(map(re.escape, expected.split("...\n")))
    return expected if re.fullmatch(pattern, printed) else printed
