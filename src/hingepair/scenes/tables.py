"""Scene files as tables: TOML read within limits, and values taken out with errors that name file, table and key."""

from __future__ import annotations

import math
import os
import re
import reprlib
from collections.abc import Collection
from pathlib import Path
from typing import Any, Final, NoReturn

from hingepair.errors import ArgumentError, SceneError, choices, nearest, quoted
from hingepair.numeric.arrays import finite_number

MAX_BYTES: Final = 1_000_000
MAX_KEY_PARTS: Final = 16
"""Of a dotted key; the time to read one grows with the square of its parts."""

_KEY_PART = re.compile(r"""(?:"(?:[^"\\\n]|\\.)*+"|'[^'\n]*'|[\w-]++)[ \t]*+(\.?)[ \t]*+""")

_shown = reprlib.Repr()
_shown.maxstring = _shown.maxother = 80
_shown.maxlist = 9


class Table:
    """One table of a scene file; the file's own keys stand in the table without a name."""

    def __init__(self, file: str, name: str, values: dict[str, Any]) -> None:
        self.file = file
        self.name = name
        self.values = values

    def label(self, key: str) -> str:
        """`file: table.key`, for messages."""
        shown = key if key.isprintable() else repr(key)
        return f"{self.file}: {self.name}.{shown}" if self.name else f"{self.file}: {shown}"

    def fail(self, key: str, expected: str) -> NoReturn:
        """Refuse the value of a key, or its absence."""
        got = show(self.values[key]) if key in self.values else "nothing"
        raise SceneError(self.label(key), expected, got)

    def check_keys(self, known: Collection[str]) -> None:
        """Refuse keys that nothing reads, and say which was probably meant."""
        for key in self.values:
            if key not in known:
                raise SceneError(self.label(key), choices(tuple(known)) + nearest(key, known), "an unknown key")

    def table(self, key: str, *, required: bool = True) -> Table:
        """The table below a key; an empty one where it is absent and need not be there."""
        value = self.values.get(key, None if required else {})
        if not isinstance(value, dict):
            self.fail(key, f"a table [{f'{self.name}.' if self.name else ''}{key}]")
        return Table(self.file, f"{self.name}.{key}" if self.name else key, value)

    def text(self, key: str, default: str | None = None) -> str:
        """The text of a key that is not empty; the default, if there is one, where the key is absent."""
        value = self.values.get(key, default)
        if not isinstance(value, str) or not value.strip():
            self.fail(key, "a text that is not empty")
        return value

    def number(self, key: str) -> float:
        """The finite number of a key."""
        try:
            return finite_number(key, self.values.get(key))
        except ArgumentError:
            self.fail(key, "a finite number")

    def integer(self, key: str, smallest: int, largest: int) -> int:
        """The whole number of a key, within limits."""
        value = self.values.get(key)
        if type(value) is not int or not smallest <= value <= largest:
            self.fail(key, f"an integer from {smallest} to {largest}")
        return value

    def numbers(self, key: str, *shape: int) -> list[Any]:
        """The nested list of finite numbers of a key, of a given shape."""
        value: Any = self.values.get(key)
        if not _is_numbers(value, shape):
            self.fail(key, f"{' lists of '.join(map(str, shape))} finite numbers")
        return list(value)


def read_tables(path: str | os.PathLike[str]) -> Table:
    """The tables of a TOML file.

    Raises:
        SceneError: no such file, not to be read, too large, no UTF-8, no TOML.
    """
    import tomllib

    try:
        name = os.fsdecode(os.fspath(path))
    except TypeError:
        raise SceneError("path", "the path of a scene file", quoted(path)) from None
    file = name if name.isprintable() and name else repr(name)
    try:
        with Path(name).open("rb") as stream:
            content = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise SceneError(file, "a scene file that can be read", reason) from None
    if len(content) > MAX_BYTES:
        raise SceneError(file, f"at most {MAX_BYTES} bytes", "a larger file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SceneError(file, "text in UTF-8", f"byte 0x{content[error.start]:02x} at byte {error.start}") from None
    _check_key_parts(file, text)
    try:
        return Table(file, "", tomllib.loads(text))
    except RecursionError:
        raise SceneError(file, "TOML with fewer nested brackets", "more than can be read") from None
    except ValueError as error:
        raise SceneError(file, "valid TOML", str(error)) from None


def show(value: object) -> str:
    """A value of a file in one line that a person can read."""
    return "a table" if isinstance(value, dict) else _shown.repr(value)


def _is_numbers(value: object, shape: tuple[int, ...]) -> bool:
    if shape:
        return isinstance(value, list) and len(value) == shape[0] and all(_is_numbers(v, shape[1:]) for v in value)
    try:
        return math.isfinite(finite_number("", value))
    except ArgumentError:
        return False


def _check_key_parts(file: str, text: str) -> None:
    end, parts = 0, 0
    for part in _KEY_PART.finditer(text):
        parts = parts + 1 if part[1] and part.start() == end else 1
        end = part.end()
        if parts > MAX_KEY_PARTS:
            line = text.count("\n", 0, end) + 1
            raise SceneError(file, f"keys of at most {MAX_KEY_PARTS} parts", f"a longer one at line {line}")
