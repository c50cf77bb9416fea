"""The start of every command."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module

import pytest

from hingepair.cli.main import COMMANDS


@pytest.mark.slow
def test_the_command_line_starts_without_the_libraries_that_only_some_commands_need() -> None:
    code = "import sys, hingepair.cli.main; print(*{name.partition('.')[0] for name in sys.modules})"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert "numpy" in loaded
    heavy = {"sympy", "scipy", "llvmlite", "matplotlib", "pandas", "pyarrow", "dask", "distributed", "pinocchio"}
    assert not heavy & {*loaded}


@pytest.mark.slow
def test_a_scene_of_expressions_is_evaluated_without_sympy() -> None:
    code = """if True:
        import sys, hingepair as hp
        hp.load_scene("models/landing_gear.toml").evaluate()
        print("sympy" in sys.modules)"""
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown == "False\n"


def test_the_list_of_commands_says_what_their_help_says() -> None:
    for commands in COMMANDS.values():
        for name, (module, text) in commands.items():
            command = getattr(import_module(f"hingepair.cli.{module}"), f"{name}_command")
            assert command.__doc__.partition("\n")[0] == text
