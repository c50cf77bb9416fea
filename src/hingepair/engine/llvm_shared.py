"""The LLVM functions that all kernels share, compiled once for each number type."""

from __future__ import annotations

from typing import Final

from hingepair.engine.llvm_builder import shared_name
from hingepair.engine.llvm_memory import MEMORY_PARAMETERS_BY_FUNCTION, memory_functions
from hingepair.engine.llvm_sines import SINE_PARAMETERS_BY_FUNCTION, sine_functions

_PARAMETERS_BY_SHARED_FUNCTION: Final = {**MEMORY_PARAMETERS_BY_FUNCTION, **SINE_PARAMETERS_BY_FUNCTION}
"""Parameter list (LLVM IR) of each shared function, by its name."""


def shared_ir(number: str) -> str:
    """Return the LLVM IR of the shared functions for numbers of type "double" or "float"."""
    return "\n\n".join([*memory_functions(number), *sine_functions(number), "!0 = !{i32 1}"]) + "\n"


def shared_symbols(number: str) -> list[str]:
    """Return the linker symbols of the shared functions for numbers of type "double" or "float"."""
    return [shared_name(name, number)[1:] for name in _PARAMETERS_BY_SHARED_FUNCTION]


def declarations(number: str) -> list[str]:
    """Return the lines of LLVM IR by which a kernel declares the shared functions."""
    return [
        f"declare void {shared_name(name, number)}({parameters})"
        for name, parameters in _PARAMETERS_BY_SHARED_FUNCTION.items()
    ]
