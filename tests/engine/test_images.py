"""Images: code that runs wherever it is mapped."""

from __future__ import annotations

import ctypes
import gc
import math
from pathlib import Path

import pytest

from hingepair.engine.llvm import images, native
from hingepair.errors import CompilationError

pytestmark = pytest.mark.skipif(not images.CAN_LINK, reason="images are of Linux on x86-64")

ALL_REFERENCES = """
@table = internal constant [3 x double] [double 1.5, double 2.5, double 3.5], align 64
@place = internal global ptr getelementptr ([3 x double], ptr @table, i64 0, i64 1)
@zeros = internal global [100 x double] zeroinitializer
declare double @sin(double)
declare double @atan2(double, double)

define internal double @from_table(i64 %k) noinline {
  %at = getelementptr [3 x double], ptr @table, i64 0, i64 %k
  %x = load double, ptr %at
  ret double %x
}

define double @other(double %x) noinline {
  %y = fadd double %x, 0.25
  ret double %y
}

define double @kernel(double %x, i64 %k) {
  %base = load ptr, ptr @place
  %second = load double, ptr %base
  %zero.at = getelementptr [100 x double], ptr @zeros, i64 0, i64 %k
  %zero = load double, ptr %zero.at
  %one = call double @from_table(i64 %k)
  %sine = call double @sin(double %x)
  %angle = call double @atan2(double %sine, double %one)
  %a = fadd double %angle, %second
  %b = fadd double %a, %zero
  %c = call double @other(double %b)
  ret double %c
}
"""


def test_every_kind_of_reference_is_linked_at_any_address():
    kernels = [native.Kernel("references", lambda: ALL_REFERENCES) for _ in range(3)]
    assert len({kernel.address("kernel") for kernel in kernels}) == 3
    for kernel in kernels:
        function = ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double, ctypes.c_int64)(kernel.address("kernel"))
        for k, entry in enumerate((1.5, 2.5, 3.5)):
            assert function(0.7, k) == math.atan2(math.sin(0.7), entry) + 2.5 + 0.25


def test_what_cannot_be_linked_is_an_error_of_ours():
    unknown = (
        "declare void @no_such_function()\ndefine void @kernel() {\n  call void @no_such_function()\n  ret void\n}"
    )
    own = "@x = thread_local global i64 0\ndefine ptr @kernel() {\n  ret ptr @x\n}"
    for ir in (unknown, own, "define void @kernel() { ret i64 0 }", "define void @kernel() { br label %nowhere }"):
        with pytest.raises(CompilationError):
            native.Kernel("broken", lambda ir=ir: ir)
    for elf in (b"", b"\x7fELF\x01\x01" + bytes(99), b"\x7fELF\x02\x01" + bytes(99)):
        with pytest.raises(ValueError, match="ELF"):
            images.link(elf)


def test_code_is_freed_with_its_kernel():
    """Neither LLVM nor anything else keeps it: 512 patterns of broadcast inputs once took 762 MB."""

    def mapped():
        """Bytes of executable memory that belongs to no file."""
        lines = Path("/proc/self/maps").read_text().splitlines()
        ends = [line.split()[0].split("-") for line in lines if "r-xp 00000000 00:00 0" in line]
        return sum(int(end, 16) - int(start, 16) for start, end in ends)

    gc.collect()  # kernels of other tests
    before = mapped()
    kernels = [native.Kernel("references", lambda: ALL_REFERENCES) for _ in range(20)]
    assert mapped() > before
    kernels.clear()
    assert mapped() <= before
