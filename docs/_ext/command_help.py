"""The directive `command-help`: a section for every command of the command line, with its `--help` text."""

from __future__ import annotations

from typing import Any

import typer
from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from hingepair.cli.main import app


class CommandHelp(SphinxDirective):
    """Show the help of every command."""

    def run(self) -> list[nodes.Node]:
        """Return one section for each command of `hingepair`."""
        group = typer.main.get_command(app)
        top = group.make_context("hingepair", [], resilient_parsing=True)
        return [_section(group.get_command(top, name), f"hingepair {name}") for name in group.list_commands(top)]


def _section(command: Any, name: str) -> nodes.Node:
    section = nodes.section(ids=[nodes.make_id(name)])
    section += nodes.title(text=name)
    text = command.get_help(command.make_context(name, [], resilient_parsing=True, terminal_width=100))
    section += nodes.literal_block(text, text, language="text")
    return section


def setup(sphinx: Any) -> dict[str, bool]:
    """Register the directive with Sphinx."""
    sphinx.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
