"""Kernels are made without pauses for unreachable objects."""

from __future__ import annotations

from support.work import python

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
    assert python(COLLECTED).split() == ["False", "True"]
