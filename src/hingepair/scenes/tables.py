"""Scene files as tables: TOML read within limits, and values taken out with errors that name file, table and key."""

from __future__ import annotations

import contextlib
import os
import re
import reprlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, NoReturn, TypeAlias

from hingepair.errors import ArgumentError, SceneError, choices, nearest, pointed, quoted
from hingepair.numeric.arrays import check_choice, finite_number
from hingepair.numeric.unit_vectors import finite_axis
from hingepair.pair.results import RESULT_SUFFIXES

MAX_TABLE_BYTES: Final = 1_000_000
"""Largest size of a file of tables that is read [bytes]."""
MAX_KEY_PARTS: Final = 16
"""Of a dotted key; the time to read one grows with the square of its parts."""

# One part of a dotted key, bare or in quotes, and the dot behind it; possessive, so that time stays linear.
_KEY_PART_PATTERN = re.compile(r"""(?:"(?:[^"\\\n]|\\.)*+"|'[^'\n]*'|[\w-]++)[ \t]*+(\.?)[ \t]*+""")

# Line and column in a message of the TOML parser.
_PLACE_PATTERN = re.compile(r"\(at line (\d+), column (\d+)\)")
_VALUE = re.compile(r"[=,\[]([^=,\[\]{}#\"']++)")  # what stands for a value
# Bare text with a letter or an operator: an expression whose quotes are missing.
_FORMULA_PATTERN = re.compile(r"(?=.*(?:[A-Za-z]|\d\s*[-+*/]))[\w.+*/() \t-]+")

_shown = reprlib.Repr()
_shown.maxstring = _shown.maxother = 80
_shown.maxlist = 9


@dataclass(eq=False)
class Place:
    """Source of values, a table of a scene file or a file of samples, and its name in messages."""

    file: str
    name: str

    def label(self, key: str) -> str:
        """Return `file: table.key`, for messages."""
        shown = key if key.isprintable() else repr(key)
        return ": ".join(filter(None, (self.file, ".".join(filter(None, (self.name, shown))))))

    def refuse(self, key: str, expected: str, got: object) -> NoReturn:
        """Refuse what a key has."""
        raise SceneError(self.label(key), expected, got) from None

    @contextlib.contextmanager
    def naming(self, key: str = "", **keys: str) -> Iterator[None]:
        """Turn errors about an argument in the `with` block into errors about its key: keys[argument], or key."""
        try:
            yield
        except SceneError:
            raise
        except ArgumentError as error:
            label = self.label(keys.get(error.name) or key or error.name)
            named = SceneError(label, error.expected, error.got)
            named.args = (label + str(error).removeprefix(error.name),)
            for note in getattr(error, "__notes__", ()):
                named.add_note(note)
            raise named from None


@dataclass(eq=False)
class Table(Place):
    """One table of a scene file; the file's own keys stand in the table without a name.

    Attributes:
        values: what it holds.
        constants: numbers that expressions may name, or SymPy expressions of numbers.
    """

    values: dict[str, Any]
    constants: Mapping[str, Any]

    def read(self, keys: Mapping[str, Key], required: Collection[str] = ()) -> dict[str, Any]:
        """Return the values of keys that are there or required, each by its reader; refuse all other keys."""
        self.check_keys(keys)
        return {key: read(self, key) for key, read in keys.items() if key in self.values or key in required}

    def check_keys(self, known: Collection[str]) -> None:
        """Refuse keys that nothing reads, and say which was probably meant."""
        for key in self.values:
            if key not in known:
                self.refuse(key, choices(tuple(known)) + nearest(key, known), "an unknown key")

    def fail(self, key: str, expected: str) -> NoReturn:
        """Refuse the value of a key, or its absence."""
        self.refuse(key, expected, show(self.values[key]) if key in self.values else "nothing")

    def table(self, key: str, *, required: bool = True) -> Table:
        """Return the table below a key; an empty one where it is absent and need not be there."""
        value = self.values.get(key, None if required else {})
        if not isinstance(value, dict):
            self.fail(key, f"a table [{f'{self.name}.' if self.name else ''}{key}]")
        return replace(self, name=f"{self.name}.{key}" if self.name else key, values=value)

    def entries(self, key: str, count: int, of: str) -> Table:
        """Return the entries of a list, functions of `of`, as a table of key[0], key[1], ..."""
        value = self.values.get(key)
        if not isinstance(value, list) or len(value) != count:
            self.fail(key, f"{('two', 'three')[count - 2]} numbers or expressions in {of}")
        return replace(self, values={f"{key}[{i}]": entry for i, entry in enumerate(value)})

    def text(self, key: str, default: str | None = None) -> str:
        """Return the text of a key, which is not empty; the default, if there is one, where the key is absent."""
        value = self.values.get(key, default)
        text = " ".join(value.split()) if isinstance(value, str) else ""
        if not text or not text.isprintable():
            self.fail(key, "a text of printable characters that is not empty")
        return text

    def flag(self, key: str) -> bool:
        """Return whether a key is true; false where it is absent."""
        value = self.values.get(key, False)
        if not isinstance(value, bool):
            self.fail(key, "true or false")
        return value

    def choice(self, key: str, known: Sequence[str], default: str | None = None) -> str:
        """Return one of some names; the default, or else the first, where the key is absent."""
        value = self.text(key, default or known[0])
        with self.naming(key):
            check_choice(key, value, known)
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """Return the finite number of a key, or of an expression without t; the default where the key is absent."""
        return default if key not in self.values and default is not None else self._number(key, self.values.get(key))

    def numbers(self, key: str, *shape: int) -> list[Any]:
        """Return the nested list of finite numbers of a key, of a given shape."""
        value: Any = self.values.get(key)
        if not _has_shape(value, shape):
            self.fail(key, f"{' lists of '.join(map(str, shape))} finite numbers")
        found: list[Any] = self._nested(key, value)
        return found

    def expressions(self, key: str, *shape: int, letters: Collection[str] = ()) -> Any:
        """Return the number of a key, or nested lists of numbers of a given shape, as exact SymPy expressions.

        Args:
            key: the key.
            *shape: shape of the lists; none of one number.
            letters: constants that stay letters.
        """
        from hingepair.symbolic.exact_constants import exact

        def exactly(value: Any, number: Any) -> Any:
            if isinstance(value, list):
                return [exactly(*both) for both in zip(value, number, strict=True)]
            return self._constant(key, value, letters) if isinstance(value, str) else exact(number)

        return exactly(self.values[key], self.numbers(key, *shape) if shape else self.number(key))

    def rotation(self, key: str) -> list[list[float]]:
        """Return the rotation of a key as three rows of three floats, as written or rounded once from exact entries.

        It is written as a matrix, as { axis, deg | rad }, or as { rpy_deg | rpy }.
        """
        if isinstance(self.values.get(key), list):
            return self.numbers(key, 3, 3)
        from hingepair.symbolic.kinks import constant_value

        entries = [constant_value(entry) for entry in self.exact_rotation(key)]
        return [entries[:3], entries[3:6], entries[6:]]

    def exact_rotation(self, key: str, letters: Collection[str] = ()) -> tuple[Any, ...]:
        """Return the nine entries of the rotation of a key, row by row, as exact SymPy expressions.

        Args:
            key: the key.
            letters: constants that stay letters.
        """
        value = self.values.get(key)
        if isinstance(value, list):
            return tuple(entry for row in self.expressions(key, 3, 3, letters=letters) for entry in row)
        if not isinstance(value, dict):
            self.fail(key, "3 lists of 3 finite numbers, { axis = [...], deg = ... } or { rpy_deg = [...] }")
        table = self.table(key)
        turns = [own for own in ("deg", "rad", "rpy_deg", "rpy") if own in value]
        if len(turns) != 1 or (turns[0] in {"deg", "rad"}) != ("axis" in value):
            self.fail(key, "{ axis, deg }, { axis, rad }, { rpy_deg } or { rpy }: a matrix in other words")
        (turn,) = turns
        table.check_keys(("axis", turn))
        from sympy import pi

        from hingepair.symbolic.exact_constants import axis_rotation, roll_pitch_yaw_rotation
        from hingepair.symbolic.jets import SYMPY_ERRORS

        unit = pi / 180 if turn.endswith("deg") else 1
        try:
            if turn.startswith("rpy"):
                return roll_pitch_yaw_rotation(
                    [unit * angle for angle in table.expressions(turn, 3, letters=letters)]
                )
            with table.naming("axis"):
                finite_axis("axis", table.numbers("axis", 3))
            axis, angle = table.expressions("axis", 3, letters=letters), table.expressions(turn, letters=letters)
            return axis_rotation(axis, unit * angle)
        except SceneError:
            raise
        except SYMPY_ERRORS:
            self.fail(key, "a rotation that SymPy can work with")

    def _nested(self, key: str, value: Any) -> Any:
        return [self._nested(key, part) for part in value] if isinstance(value, list) else self._number(key, value)

    def _number(self, key: str, value: Any) -> float:
        """Return a finite number, given as such or as an expression in the constants of the scene."""
        if isinstance(value, str):
            from hingepair.symbolic.kinks import constant_value

            return constant_value(self._constant(key, value))
        try:
            return finite_number(key, value)
        except ArgumentError:
            self.fail(key, "a finite number")

    def _constant(self, key: str, text: str, letters: Collection[str] = ()) -> Any:
        """Return the SymPy expression without t that a text stands for."""
        from hingepair.symbolic.expressions import parse_constant

        with self.naming(key):
            return parse_constant(key, text, self.constants, letters)


Key: TypeAlias = Callable[[Table, str], Any]
"""Reads a key out of a table, or refuses what it holds: `Table.number`, `numbers(3)` and the like."""


def numbers_key(*shape: int) -> Key:
    """Return a reader of finite numbers of a given shape."""
    return lambda table, key: table.numbers(key, *shape)


def read_tables(path: str | os.PathLike[str]) -> Table:
    """Read the tables of a TOML file.

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
            content = stream.read(MAX_TABLE_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise SceneError(file, "a scene file that can be read", reason) from None
    if Path(name).suffix.lower() in RESULT_SUFFIXES:
        expected = f"a scene file (TOML), which names a log by [motion] file = {Path(name).name!r}"
        raise SceneError(file, expected, "a log")
    if len(content) > MAX_TABLE_BYTES:
        raise SceneError(file, f"at most {MAX_TABLE_BYTES} bytes", "a larger file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SceneError(file, "text in UTF-8", f"byte 0x{content[error.start]:02x} at byte {error.start}") from None
    _check_key_parts(file, text)
    try:
        return Table(file, "", tomllib.loads(text), {})
    except RecursionError:
        raise SceneError(file, "TOML with fewer nested brackets", "more than can be read") from None
    except ValueError as error:
        raise _fault(file, text, str(error)) from None


def _fault(file: str, text: str, reason: str) -> SceneError:
    """Return the error of a text that is no TOML, with the line and a caret, and what is probably meant."""
    place = _PLACE_PATTERN.search(reason)
    if place is None:
        return SceneError(file, "valid TOML", reason)
    column, line = int(place[2]), text.split("\n")[int(place[1]) - 1].rstrip("\r")
    value = next((found for found in _VALUE.finditer(line) if found.start() < column <= found.end() + 1), None)
    hint, word = "", value[1].strip() if value and reason.startswith(("Invalid value", "Expected newline")) else ""
    if word.lower() in {"true", "false"}:
        hint = f"; it is written {word.lower()}"
    elif len(word) <= _shown.maxstring and _FORMULA_PATTERN.fullmatch(word):
        hint = f'; an expression stands in quotes: "{word}"'
    error = SceneError(file, f"valid TOML{hint}", reason)
    error.add_note(pointed(line, column))
    return error


def show(value: object) -> str:
    """Return a value of a file in one line that a person can read."""
    try:
        return "a table" if isinstance(value, dict) else _shown.repr(value)
    except ValueError:  # Python writes no integer of more than 4,300 digits
        return "a number of more than 4300 digits"


def _has_shape(value: object, shape: tuple[int, ...]) -> bool:
    if shape:
        return isinstance(value, list) and len(value) == shape[0] and all(_has_shape(v, shape[1:]) for v in value)
    return isinstance(value, str | int | float) and not isinstance(value, bool)


def _check_key_parts(file: str, text: str) -> None:
    """Refuse a dotted key of too many parts, which the TOML reader would follow without end."""
    end, parts = 0, 0
    for part in _KEY_PART_PATTERN.finditer(text):
        parts = parts + 1 if part[1] and part.start() == end else 1
        end = part.end()
        if parts > MAX_KEY_PARTS:
            line = text.count("\n", 0, end) + 1
            raise SceneError(file, f"keys of at most {MAX_KEY_PARTS} parts", f"a longer one at line {line}")
