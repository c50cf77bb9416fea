"""The LLVM functions that all kernels share, compiled once for each type of numbers."""

from __future__ import annotations

from typing import Final

from hingepair.engine.llvm_memory import MEMORY_PARAMETERS, memory_functions
from hingepair.engine.llvm_sines import SINE_PARAMETERS, sine_functions
from hingepair.engine.llvm_writer import shared_name

_PARAMETERS: Final = {**MEMORY_PARAMETERS, **SINE_PARAMETERS}


def shared_ir(number: str) -> str:
    """Return the code of the functions for numbers of a type, "double" or "float"."""
    return "\n\n".join([*memory_functions(number), *sine_functions(number), "!0 = !{i32 1}"]) + "\n"


def shared_symbols(number: str) -> list[str]:
    """Return the names under which kernels find the functions."""
    return [shared_name(name, number)[1:] for name in _PARAMETERS]


def declarations(number: str) -> list[str]:
    """Return the lines by which a kernel declares the functions."""
    return [f"declare void {shared_name(name, number)}({parameters})" for name, parameters in _PARAMETERS.items()]
