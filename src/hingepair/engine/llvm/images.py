"""Images: machine code that runs wherever it is mapped, linked from the object file that LLVM writes.

An image needs no LLVM: it is loaded in a fraction of a millisecond, where importing llvmlite takes twenty, and takes
the memory of its code alone. Objects of ELF for x86-64 are linked, which are those of Linux; elsewhere llvmlite
loads them (`native`).

    imports: one address for each function that is not the image's own, filled in when it is loaded
    stubs:   one jump through each of them, for calls
    sections of the object, whose references to each other do not depend on where the image is
"""

from __future__ import annotations

import ctypes
import mmap
import platform
import struct
import sys
from collections.abc import Callable
from typing import Final, NamedTuple

CAN_LINK: Final = sys.platform == "linux" and platform.machine() == "x86_64" and sys.maxsize > 2**32
"""Whether images run here."""

_ELF_X86_64: Final = b"\x7fELF\x02\x01", 62  # 64 bits, little-endian; the number of the processor
_PROGBITS, _SYMTAB, _RELA, _NOBITS = 1, 2, 4, 8  # kinds of sections; unwinding tables have another
_ALLOCATED: Final = 2  # flag of a section that is part of the code
_ABSOLUTE, _CALL = 1, 4  # kinds of references, R_X86_64_64 and PLT32
_FORMATS: Final = {_ABSOLUTE: "<Q", 2: "<i", _CALL: "<i", 24: "<q"}  # numbers that they fill in; 2, 24: PC32, PC64
_THROUGH_TABLE: Final = {9, 41, 42}  # references to an import, R_X86_64_GOTPCREL and its kin
_WORD: Final = 8  # bytes of an import and of a stub
_LINE: Final = 64  # alignment of the first section


class _Section(NamedTuple):
    """A section header of ELF."""

    name: int
    kind: int
    flags: int
    address: int
    offset: int
    size: int
    link: int
    info: int
    alignment: int
    entry_size: int


class _Symbol(NamedTuple):
    """A symbol of ELF; section 0 says that it is defined elsewhere."""

    name: str
    is_local: bool
    section: int
    value: int


def link(elf: bytes) -> bytes:
    """Return the image, as bytes, of an object file of ELF for x86-64 whose code is position-independent.

    Raises:
        ValueError: the object is of another kind, or refers to something in a way that is not known here.
    """
    if elf[:6] != _ELF_X86_64[0] or struct.unpack_from("<H", elf, 18)[0] != _ELF_X86_64[1]:
        raise ValueError("an object that is not ELF for x86-64")
    start, size, count = struct.unpack_from("<Q", elf, 40)[0], *struct.unpack_from("<HH", elf, 58)
    sections = [_Section(*struct.unpack_from("<IIQQQQIIQQ", elf, start + size * k)) for k in range(count)]
    symbols = _symbols(elf, sections)
    imports = [s.name for s in symbols if not s.section and s.name]

    # The imports, and a stub for each of them.
    image = bytearray(_WORD * len(imports))
    for k in range(len(imports)):  # jmp [rip + distance to the import]
        image += b"\xff\x25" + struct.pack("<i", _WORD * k - len(image) - 6) + b"\x90\x90"
    image += bytes(-len(image) % _LINE)
    # The sections that are part of the code.
    places: dict[int, int] = {}
    for k, section in enumerate(sections):
        if section.flags & _ALLOCATED and section.kind in {_PROGBITS, _NOBITS}:
            image += bytes(-len(image) % max(1, section.alignment))
            places[k] = len(image)
            data = elf[section.offset : section.offset + section.size]
            image += data if section.kind == _PROGBITS else bytes(section.size)

    slots = {name: _WORD * k for k, name in enumerate(imports)}
    # The references of these sections, of which only absolute addresses wait for the place of the image.
    absolute = []
    for section in sections:
        if section.kind != _RELA or section.info not in places:
            continue
        for offset, info, addend in struct.iter_unpack("<QQq", elf[section.offset : section.offset + section.size]):
            symbol, kind, at = symbols[info >> 32], info & 0xFFFFFFFF, places[section.info] + offset
            if symbol.section in places and kind in _FORMATS:
                to = places[symbol.section] + symbol.value
            elif symbol.name in slots and kind == _CALL:
                to = slots[symbol.name] + _WORD * len(imports)  # the stub
            elif symbol.name in slots and kind in _THROUGH_TABLE:
                to = slots[symbol.name]
            else:
                raise ValueError(f"a reference of kind {kind} to {symbol.name or 'a section'}, which is not linked")
            if kind == _ABSOLUTE:
                absolute.append(at)
            struct.pack_into(_FORMATS.get(kind, "<i"), image, at, to + addend - (0 if kind == _ABSOLUTE else at))
    functions = {s.name: places[s.section] + s.value for s in symbols if not s.is_local and s.section in places}
    lines = imports, [f"{name}:{at}" for name, at in functions.items()], map(str, absolute)
    head = "\n".join(" ".join(line) for line in lines).encode()  # names of LLVM's symbols have no spaces here
    return struct.pack("<I", len(head)) + head + image


def _symbols(elf: bytes, sections: list[_Section]) -> list[_Symbol]:
    """Return the symbols of an object file of ELF."""
    table = next(section for section in sections if section.kind == _SYMTAB)
    names = sections[table.link].offset
    symbols = []
    for name, info, _, section, value, _ in struct.iter_unpack(
        "<IBBHQQ", elf[table.offset : table.offset + table.size]
    ):
        text = elf[names + name : elf.index(b"\0", names + name)].decode()
        symbols.append(_Symbol(text, info >> 4 == 0, section, value))
    return symbols


class Image:
    """An image in the memory of this process, which is freed with this object.

    Args:
        linked: what `link` returned.
        import_address: function from the name of an imported function to its address.

    Raises:
        OSError: the system does not let this process have code of its own.
    """

    def __init__(self, linked: bytes, import_address: Callable[[str], int]) -> None:
        (head_size,) = struct.unpack_from("<I", linked)
        imports, functions, absolute = (line.split() for line in linked[4 : 4 + head_size].decode().split("\n"))
        code = linked[4 + head_size :]
        self._functions = {name: int(at) for name, _, at in (one.rpartition(":") for one in functions)}
        self._memory = mmap.mmap(
            -1, len(code), mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, mmap.PROT_READ | mmap.PROT_WRITE
        )
        self._memory[:] = code
        self._start = ctypes.addressof(ctypes.c_char.from_buffer(self._memory))
        struct.pack_into(f"<{len(imports)}Q", self._memory, 0, *map(import_address, imports))
        for at in map(int, absolute):
            (offset,) = struct.unpack_from("<Q", self._memory, at)
            struct.pack_into("<Q", self._memory, at, self._start + offset)
        protect = ctypes.CDLL(None, use_errno=True).mprotect
        protect.argtypes = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int
        if protect(self._start, len(code), mmap.PROT_READ | mmap.PROT_EXEC):
            raise OSError(ctypes.get_errno(), "memory cannot be made executable")

    def address(self, symbol: str) -> int:
        """Return the address of a function of the image."""
        return self._start + self._functions[symbol]
