"""The directive `command-help`: a section for every command of the command line, with its `--help` text."""

from __future__ import annotations

from typing import Any

import typer
from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from hingepair.cli.main import app


class CommandHelp(SphinxDirective):
    """Show the help of every command, and of every command of a group."""

    def run(self) -> list[nodes.Node]:
        """Return one section for each command of `hingepair`."""
        return list(_sections(typer.main.get_command(app), "hingepair"))


def _sections(group: Any, name: str) -> Any:
    for command_name, command in group.commands.items():
        full_name = f"{name} {command_name}"
        section = nodes.section(ids=[nodes.make_id(full_name)])
        section += nodes.title(text=full_name)
        context = command.make_context(full_name, [], resilient_parsing=True, terminal_width=100)
        text = command.get_help(context)
        section += nodes.literal_block(text, text, language="text")
        if hasattr(command, "commands"):
            section.extend(_sections(command, full_name))
        yield section


def setup(sphinx: Any) -> dict[str, bool]:
    """Register the directive with Sphinx."""
    sphinx.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
