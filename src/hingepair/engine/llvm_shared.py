"""The LLVM functions that all kernels share, compiled once for each floating-point type."""

from __future__ import annotations

from typing import Final

from hingepair.engine.llvm_builder import shared_name
from hingepair.engine.llvm_memory import LLVM_PARAMETER_LIST_BY_MEMORY_FUNCTION_NAME, memory_functions
from hingepair.engine.llvm_sines import LLVM_PARAMETER_LIST_BY_SINE_FUNCTION_NAME, sine_functions

_LLVM_PARAMETER_LIST_BY_SHARED_FUNCTION_NAME: Final = {
    **LLVM_PARAMETER_LIST_BY_MEMORY_FUNCTION_NAME,
    **LLVM_PARAMETER_LIST_BY_SINE_FUNCTION_NAME,
}
"""Parameter list (LLVM IR) of each shared function, by its name."""


def shared_ir(float_type: str) -> str:
    """Return the LLVM module, as text, of all functions that kernels share, for numbers of type "double" or
    "float".
    """
    return "\n\n".join([*memory_functions(float_type), *sine_functions(float_type), "!0 = !{i32 1}"]) + "\n"


def shared_symbols(float_type: str) -> list[str]:
    """Return the list of linker symbols of the shared functions for numbers of type "double" or "float"."""
    return [shared_name(name, float_type)[1:] for name in _LLVM_PARAMETER_LIST_BY_SHARED_FUNCTION_NAME]


def declarations(float_type: str) -> list[str]:
    """Return a list of LLVM declarations of the shared functions, for numbers of type "double" or "float"."""
    return [
        f"declare void {shared_name(name, float_type)}({parameters})"
        for name, parameters in _LLVM_PARAMETER_LIST_BY_SHARED_FUNCTION_NAME.items()
    ]
