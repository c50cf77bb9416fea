"""Kernels are made in the main interpreter alone, without pauses for unreachable objects."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = """
import os, sys
import {interpreters} as interpreters
interpreters.run_string(interpreters.create(), '''
import sys, warnings
sys.path[:] = {path!r}
warnings.simplefilter("ignore")
from hingepair.engine.llvm.native import Kernel
from hingepair.errors import ArgumentError
try:
    Kernel("f", lambda: "")
except ArgumentError as error:
    print(error, "llvmlite" in sys.modules, flush=True)
''')
os._exit(0)  # NumPy does not always end a sub-interpreter
"""


@pytest.mark.slow(1)
def test_a_sub_interpreter_is_refused():
    name = "_interpreters" if sys.version_info >= (3, 13) else "_xxsubinterpreters"
    pytest.importorskip(name)
    program = PROGRAM.format(interpreters=name, path=sys.path)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    if not done.stdout:
        pytest.skip(f"NumPy does not run there: {done.stderr[-200:]}")
    expected = "backend: expected 'numpy' in a sub-interpreter, where no kernel can be called, got a kernel of 'f'"
    assert done.stdout.strip() == f"{expected} False"


COLLECTED = """
import gc
from hingepair.engine.llvm.native import Kernel

def ir():
    print(gc.isenabled())
    raise ValueError

try:
    Kernel("nothing", ir)
except ValueError:
    print(gc.isenabled())
"""


def test_no_objects_are_collected_while_code_is_written():
    # In a process of its own: threads of other tests may be writing code.
    done = subprocess.run([sys.executable, "-c", COLLECTED], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.split() == ["False", "True"]
