"""Scene files as tables: TOML read within limits, and values read with errors that name file, table and key."""

from __future__ import annotations

import contextlib
import functools
import os
import re
import reprlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, NoReturn, TypeAlias

import numpy as np

from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError, SceneError, choices, line_with_caret, nearest, quoted
from hingepair.mechanism.results import RESULT_FILE_SUFFIXES
from hingepair.numeric.arrays import check_choice, finite_number
from hingepair.numeric.unit_vectors import finite_axis, unit_axis
from hingepair.symbolic.expressions import (
    Expression,
    constant_cosine,
    constant_name_fault,
    constant_sine,
    in_radians,
    parse_constant,
    parse_expression,
)
from hingepair.symbolic.expressions import number as exact_number

MAX_BYTES: Final = 1_000_000
"""Largest size of a file of tables that is read [bytes]."""
MAX_KEY_PARTS: Final = 16
"""Largest number of parts of a dotted key; the time to read one grows with its square."""

# One part of a dotted key, bare or in quotes, and the dot behind it; possessive, so that time stays linear.
_KEY_PART = re.compile(r"""(?:"(?:[^"\\\n]|\\.)*+"|'[^'\n]*'|[\w-]++)[ \t]*+(\.?)[ \t]*+""")

# Line and column in a message of the TOML parser.
_POSITION = re.compile(r"\(at line (\d+), column (\d+)\)")

_shown = reprlib.Repr()
_shown.maxstring = _shown.maxother = 80
_shown.maxlist = 9


@dataclass(eq=False)
class NamedSource:
    """Base class of Table and Log: a file, or a table in it, whose methods raise errors that name the file, the table
    and the key.
    """

    file: str
    name: str

    def label(self, key: str) -> str:
        """Return the string `file: table.key`, which names a key of this source in messages."""
        shown = key if key.isprintable() else repr(key)
        return ": ".join(filter(None, (self.file, ".".join(filter(None, (self.name, shown))))))

    def loc(self, key: str) -> tuple[str, ...]:
        """Return the tables that lead to a key of this source, and the key."""
        return tuple(filter(None, (*self.name.split("."), *key.split("."))))

    def refuse(self, key: str, expected: str, got: object) -> NoReturn:
        """Raise a SceneError on a key, with phrases on what was expected and what was got."""
        raise SceneError(self.label(key), expected, got, self.loc(key)) from None

    @contextlib.contextmanager
    def naming(self, key: str = "", **key_by_argument: str) -> Iterator[None]:
        """Return a context manager that converts an ArgumentError raised in its block into a SceneError with the
        file, the table and a key. Keyword arguments give the key by the name of the error's argument. If they have
        none for the argument, the key is `key`, or the name of the argument if `key` is empty.
        """
        try:
            yield
        except SceneError:
            raise
        except ArgumentError as error:
            place = key_by_argument.get(error.name) or key or error.name
            raise error.renamed(self.label(place), SceneError, self.loc(place)) from None


@dataclass(eq=False)
class Table(NamedSource):
    """One table of a scene file, with its values by key and the constants that its expressions may use."""

    #: values by key, as the TOML parser returns them
    values: dict[str, Any]
    #: values by name of the constants that expressions may use: numbers, and expressions in t
    constants: Mapping[str, float | Expression]
    #: what [constants] has, by name
    written: Mapping[str, Any] = field(default_factory=dict)

    def read(self, reader_by_key: Mapping[str, Key], required: Collection[str] = ()) -> dict[str, Any]:
        """Return what the readers, functions of (table, key), make of the keys that the table has or that are
        `required`; refuse keys without a reader.
        """
        self.check_keys(reader_by_key)
        return {key: read(self, key) for key, read in reader_by_key.items() if key in self.values or key in required}

    def check_keys(self, known_keys: Collection[str]) -> None:
        """Raise a SceneError if the table has a key outside `known_keys`."""
        for key in self.values:
            if key not in known_keys:
                self.refuse_key(key, known_keys)

    def refuse_key(self, key: str, known_keys: Collection[str], got: str = "an unknown key") -> NoReturn:
        """Raise a SceneError on a key that is none of the `known_keys`, with the nearest one."""
        self.refuse(key, choices(tuple(known_keys)) + nearest(key, known_keys), got)

    def fail(self, key: str, expected: str) -> NoReturn:
        """Raise a SceneError on the value of a key, or on its absence, with a phrase on what was expected."""
        self.refuse(key, expected, describe_value(self.values[key]) if key in self.values else "nothing")

    def table(self, key: str, *, required: bool = True) -> Table:
        """Return the table under a key as a Table. If the key is absent, return an empty one, or raise a SceneError
        if `required` is True.
        """
        value = self.values.get(key, None if required else {})
        if not isinstance(value, dict):
            self.fail(key, f"a table [{f'{self.name}.' if self.name else ''}{key}]")
        return replace(self, name=f"{self.name}.{key}" if self.name else key, values=value)

    def tables(self, key: str, expected: str, *, required: bool = True) -> list[Table]:
        """Return the list of tables under a key as Tables, with errors that say what was `expected`; an empty list
        if the key is absent and not `required`.
        """
        values = self.values.get(key, None if required else [])
        if not isinstance(values, list) or not all(isinstance(each, dict) for each in values):
            self.fail(key, expected)
        place = f"{self.name}.{key}" if self.name else key
        return [replace(self, name=f"{place}[{i}]", values=each) for i, each in enumerate(values)]

    def names(self, key: str, expected: str) -> tuple[str, ...] | None:
        """Return the names in the list under a key, each once; None if the key is absent."""
        value = self.values.get(key)
        if value is None:
            return None
        if not isinstance(value, list) or not value or not all(isinstance(name, str) for name in value):
            self.fail(key, expected)
        return tuple(dict.fromkeys(value))

    def entries(self, key: str, count: int, variables: str) -> Table:
        """Return the list of `count` (2 or 3) entries under a key as a Table with the keys key[0], key[1], ...;
        messages say that its expressions are in `variables`.
        """
        value = self.values.get(key)
        if not isinstance(value, list) or len(value) != count:
            self.fail(key, f"{('two', 'three')[count - 2]} numbers or expressions in {variables}")
        return replace(self, values={f"{key}[{i}]": entry for i, entry in enumerate(value)})

    def text(self, key: str, default: str | None = None) -> str:
        """Return the string under a key, with runs of blanks reduced to one. If the key is absent, return the
        default, or raise a SceneError if there is none.
        """
        value = self.values.get(key, default)
        text = " ".join(value.split()) if isinstance(value, str) else ""
        if not text or not text.isprintable():
            self.fail(key, "a text of printable characters that is not empty")
        return text

    def file_name(self, key: str) -> str:
        """Return the name of a file under a key, with all of its blanks; raise a SceneError if there is none."""
        self.text(key)
        return str(self.values[key]).strip()

    def flag(self, key: str) -> bool:
        """Return the boolean under a key; False if the key is absent."""
        value = self.values.get(key, False)
        if not isinstance(value, bool):
            self.fail(key, "true or false")
        return value

    def choice(self, key: str, allowed_names: Sequence[str], default: str | None = None) -> str:
        """Return the string under a key. If the key is absent, return the default, or the first allowed name if there
        is no default.
        """
        value = self.text(key, default or allowed_names[0])
        with self.naming(key):
            check_choice(key, value, allowed_names)
        return value

    def number(self, key: str, default: float | None = None) -> float:
        """Return the number or the constant expression under a key as a finite float. If the key is absent, return
        the default, or raise a SceneError if there is none.
        """
        value = self.values.get(key, default)
        if not isinstance(value, str | int | float):
            self.fail(key, "a finite number")
        return float(self._read(key, value))

    def numbers(self, key: str, *shape: int) -> list[Any]:
        """Return the finite numbers, or constant expressions, under a key as nested lists of floats. The further
        arguments are the shape, such as 3, 3.
        """
        value: Any = self.values.get(key)
        if not _has_shape(value, shape):
            more = isinstance(value, list) and len(value) > shape[0]
            hint = " (decimals follow a point)" * (more and _has_shape(value, (len(value), *shape[1:])))
            self.fail(key, f"{' lists of '.join(map(str, shape))} finite numbers{hint}")
        numbers: list[Any] = self._read(key, value)
        return numbers

    def expressions(self, key: str, *shape: int, symbolic_constants: Collection[str] = ()) -> Any:
        """Return the number or constant expression under a key of the table as an Expression, or nested lists of them
        if further arguments give a shape, such as 3, 3. The key must be present. The constants named in
        `symbolic_constants` stay symbols.
        """
        _ = self.numbers(key, *shape) if shape else self.number(key)  # refuses other shapes
        return self._read(key, self.values[key], exact_number, symbolic_constants)

    def rotation(self, key: str) -> list[list[float]]:
        """Return the rotation matrix under a key as three lists of three floats; turns by right angles are exact. The
        value is a matrix, { axis, deg | rad } or { rpy_deg | rpy }. Only the shape of a matrix is checked.
        """
        if isinstance(self.values.get(key), list):
            return self.numbers(key, 3, 3)
        value = self.values.get(key)
        if not isinstance(value, dict):
            self.fail(key, "3 lists of 3 finite numbers, { axis = [...], deg = ... } or { rpy_deg = [...] }")
        table = self.table(key)
        turns = [name for name in ("deg", "rad", "rpy_deg", "rpy") if name in value]
        if len(turns) != 1 or (turns[0] in {"deg", "rad"}) != ("axis" in value):
            forms = "{ axis, deg }, { axis, rad }, { rpy_deg } or { rpy }: a matrix in other words"
            self.refuse(key, forms, f"a table with {', '.join(map(repr, value)) or 'nothing'}")
        (turn,) = turns
        table.check_keys(("axis", turn))
        written = table.expressions(turn, *((3,) if turn.startswith("rpy") else ()))
        angles = [
            in_radians(x) if turn.endswith("deg") else x
            for x in (written if isinstance(written, list) else [written])
        ]
        axes = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
        if "axis" in value:
            with table.naming("axis"):
                n = unit_axis("axis", finite_axis("axis", np.array(table.numbers("axis", 3))))
            axes = [tuple(n.tolist())]
        turns_about = [_turn(axis, angle.constant) for axis, angle in zip(axes, angles, strict=True)]
        entries = functools.reduce(lambda first, then: eq.compose(then, first), turns_about)
        return [list(entries[:3]), list(entries[3:6]), list(entries[6:])]

    def _read(self, key: str, value: Any, convert: Any = float, symbolic_constants: Collection[str] = ()) -> Any:
        """Return nested lists of finite numbers, by `convert`, and of constant expressions, as floats unless numbers
        become something else.
        """
        if isinstance(value, list):
            return [self._read(key, part, convert, symbolic_constants) for part in value]
        if isinstance(value, str):
            with self.naming(key):
                expression = parse_constant(key, value, self.constants, symbolic_constants)
            return float(expression) if convert is float else expression
        try:
            return convert(finite_number(key, value))
        except ArgumentError:
            self.fail(key, "a finite number")


def _turn(axis: Any, angle: Any) -> Any:
    """Return the rotation by an exact angle about a unit axis; turns by right angles are exact."""
    sine, cosine = constant_sine(angle), constant_cosine(angle)
    versine = sine * sine / (1 + cosine) if cosine > 0 else 1 - cosine
    return eq.hinge_rotation(axis, (sine, versine))


def read_constants(table: Table, symbols: Collection[str] = ()) -> dict[str, float | Expression]:
    """Return the constants of a scene, which may use t and earlier ones; `symbols` are names that stay symbols."""
    found = {key: value for key, value in table.constants.items() if key not in table.written}
    constants = replace(table, name="constants", values=dict(table.written))
    for key, value in table.written.items():
        if (fault := constant_name_fault(key)) is not None:
            constants.refuse(key, fault, quoted(key))
        with constants.naming(key):
            found[key] = (
                parse_expression(key, value, found, symbols) if isinstance(value, str) else constants.number(key)
            )
    return found


Key: TypeAlias = Callable[[Table, str], Any]
"""Reads a key out of a table, or refuses what it holds: `Table.number`, `numbers(3)` and the like."""


def numbers_key(*shape: int) -> Key:
    """Return the reader `Table.numbers` of a shape such as 3, 3."""
    return lambda table, key: table.numbers(key, *shape)


def read_tables(path: str | os.PathLike[str]) -> Table:
    """Read a TOML file, and return its contents as one Table, whose [constants] are not evaluated yet."""
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
        raise SceneError(file, "a scene or sweep file that can be read", reason) from None
    if Path(name).suffix.lower() in RESULT_FILE_SUFFIXES:
        expected = f"a scene file (TOML), which names a log by [motion] file = {Path(name).name!r}"
        raise SceneError(file, expected, "a log")
    if len(content) > MAX_BYTES:
        raise SceneError(file, f"at most {MAX_BYTES} bytes", "a larger file")
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
        raise _toml_error(file, text, str(error)) from None


def _toml_error(file: str, text: str, reason: str) -> SceneError:
    """Return a SceneError on a file whose text is not valid TOML, from the parser's message `reason`."""
    place = _POSITION.search(reason)
    if place is None:
        return SceneError(file, "valid TOML", reason)
    hint = "; texts and expressions stand in quotes, decimals follow a point"
    error = SceneError(file, f"valid TOML{hint}", reason)
    error.add_note(line_with_caret(text.split("\n")[int(place[1]) - 1].rstrip("\r"), int(place[2])))
    return error


def describe_value(value: object) -> str:
    """Return a value of a scene file as one line for messages, shortened if it is long."""
    try:
        return "a table" if isinstance(value, dict) else _shown.repr(value)
    except ValueError:  # Python writes no integer of more than 4,300 digits
        return "a number of more than 4300 digits"


def _has_shape(value: object, shape: tuple[int, ...]) -> bool:
    if shape:
        return isinstance(value, list) and len(value) == shape[0] and all(_has_shape(v, shape[1:]) for v in value)
    return isinstance(value, str | int | float) and not isinstance(value, bool)


def _check_key_parts(file: str, text: str) -> None:
    """Raise a SceneError on a dotted key of more than MAX_KEY_PARTS parts, which the TOML parser reads too slowly."""
    end, parts = 0, 0
    for part in _KEY_PART.finditer(text):
        parts = parts + 1 if part[1] and part.start() == end else 1
        end = part.end()
        if parts > MAX_KEY_PARTS:
            line = text.count("\n", 0, end) + 1
            raise SceneError(file, f"keys of at most {MAX_KEY_PARTS} parts", f"a longer one at line {line}")
