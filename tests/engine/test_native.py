"""Kernels are made without pauses for unreachable objects."""

from __future__ import annotations

import subprocess
import sys

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
