"""The errors of this package: one base, each also the built-in exception that fits; and the warning of dynamics."""

from __future__ import annotations

import reprlib
import sys
import warnings
from collections.abc import Collection, Sequence

# A longer text of a value is cut to this length, and the text of an array of more entries is left out.
_MAX_SHOWN = 120


class HingePairError(Exception):
    """Base of every error that hingepair raises."""


class ArgumentError(HingePairError, ValueError):
    """An argument, a key of a file or an option has a value that cannot be used.

    Attributes:
        name: name of the argument, key or option.
        expected: text that says which values are accepted.
        got: the value that was given, or a text that describes it.
        said: the message behind the name.
        loc: where the value stands in a file: tables and key; empty for an argument.
    """

    def __init__(self, name: str, expected: str, got: object, loc: tuple[str, ...] = ()) -> None:
        super().__init__(name, expected, got, loc)
        self.name = name
        self.expected = expected
        self.got = got
        self.said = f"expected {expected}, got {shorten(got)}"
        self.loc = loc

    def __str__(self) -> str:
        return printable(f"{self.name}: {self.said}")

    def renamed(self, name: str, kind: type[ArgumentError] | None = None, loc: tuple[str, ...] = ()) -> ArgumentError:
        """Return a copy of the error, with its notes, about the same value under another name. `kind` is the class of
        the copy, by default that of the error.
        """
        error = (kind or type(self))(name, self.expected, self.got, loc or self.loc)
        error.said = self.said
        for note in getattr(self, "__notes__", ()):
            error.add_note(note)
        return error


class UnknownOutputError(ArgumentError, KeyError):
    """A result has no output, frame or point of this name. The attributes are those of `ArgumentError`: `expected`
    lists the names that there are.
    """


class AxisError(ArgumentError):
    """An axis, such as a hinge axis, is zero or not finite. The attributes `name`, `expected` and `got` are those of
    `ArgumentError`.
    """


class RotationError(ArgumentError):
    """A matrix or quaternion does not describe a rotation. The attributes `name`, `expected` and `got` are those of
    `ArgumentError`.
    """


class ShapeError(ArgumentError):
    """An array has the wrong shape. The attributes `name`, `expected` and `got` are those of `ArgumentError`:
    `expected` says which shape is accepted, and `got` says which shape the array has.
    """


class DtypeError(ArgumentError, TypeError):
    """An array has a dtype that is not supported. The attributes are those of `ArgumentError`: `name` is the
    argument, `expected` says which dtypes are supported, and `got` says which dtype was given.
    """


class GimbalLockError(ArgumentError):
    """An attitude is at gimbal lock, where the rates of its Euler angles do not exist (equation E4). The attributes
    `name`, `expected` and `got` are those of `ArgumentError`.
    """


class FitError(ArgumentError):
    """Recorded data do not determine the quantities to be fitted, such as a hinge, or the attitude of a body with
    markers. The attributes `name`, `expected` and `got` are those of `ArgumentError`; `name` holds the names of the
    arguments with these data.
    """


class SceneError(ArgumentError):
    """A file cannot be read as a scene. The attributes `name`, `expected` and `got` are those of `ArgumentError`;
    `name` is the place in the file, in the form `file: table.key`.
    """


class URDFError(ArgumentError):
    """A text is not valid URDF, or it has no joint or link of the given name. The attributes `name`,
    `expected` and `got` are those of `ArgumentError`; `name` is the name of an argument, or a text that says which
    element of the URDF text is wrong, such as `joint 'elbow'`.
    """


class MissingDependencyError(HingePairError, ImportError):
    """An optional package is not installed.

    Attributes:
        name: the argument or function that needs the package.
        expected: text that names the package and says how to install it.
        got: text that says what was found instead.
    """

    def __init__(self, name: str, expected: str, got: str) -> None:
        super().__init__(printable(f"{name}: expected {expected}, got {got}"))
        self.name = name  # behind the constructor of ImportError, which sets it, too
        self.expected = expected
        self.got = got

    def __reduce__(self) -> tuple[type, tuple[str | None, str, str]]:
        return type(self), (self.name, self.expected, self.got)


class SimulationError(HingePairError, RuntimeError):
    """The simulation cannot be continued past the instant `t` [s], for the reason `why`."""

    def __init__(self, t: float, why: str) -> None:
        self.t = t
        self.why = why
        super().__init__(f"the simulation cannot go past t = {t!r}: {why}")

    def __reduce__(self) -> tuple[type, tuple[float, str]]:
        return type(self), (self.t, self.why)


class CompilationError(HingePairError, RuntimeError):
    """LLVM could not compile a kernel. A kernel is a function in machine code that evaluates the equations.

    Attributes:
        name: the kernel's name.
        reason: the message of LLVM or llvmlite.
    """

    def __init__(self, name: str, reason: str) -> None:
        self.name = name
        self.reason = reason
        advice = 'backend="numpy" computes without it'
        super().__init__(printable(f"llvmlite could not compile the kernel of {name!r}: {shorten(reason)}; {advice}"))

    def __reduce__(self) -> tuple[type, tuple[str, str]]:
        return type(self), (self.name, self.reason)


def shorten(value: object) -> str:
    """Return a value as one line of text for a message: a string as it is, anything else by its repr, without line
    breaks and cut to 120 characters; for an array of more than 120 elements, only its shape. The work is bounded
    however large the value is.
    """
    if getattr(value, "size", 0) > _MAX_SHOWN and hasattr(value, "shape"):  # its text would be cut
        return f"an array of shape {value.shape}"
    plain_value = value.tolist() if hasattr(value, "tolist") else value
    text = " ".join((plain_value[: 2 * _MAX_SHOWN] if isinstance(plain_value, str) else _brief(plain_value)).split())
    return text if len(text) <= _MAX_SHOWN else text[: _MAX_SHOWN - 3] + "..."


def _brief(value: object) -> str:
    """Return the shortened repr of a value. For a long collection, it shows only the first 30 items, and for a long
    string only the two ends. An integer with too many digits to be written is described by its type.
    """
    brief = reprlib.Repr()
    brief.maxlist = brief.maxtuple = brief.maxdict = brief.maxset = brief.maxfrozenset = _MAX_SHOWN // 4
    brief.maxlong = brief.maxstring = brief.maxother = 2 * _MAX_SHOWN
    try:
        return brief.repr(value)
    except ValueError:  # an integer with too many digits to be written
        return f"a {type(value).__name__} too long to be written"


def quoted(value: object) -> object:
    """Return a value for the argument `got` of an ArgumentError: for a string, the repr of its first 240 characters,
    since '2' is not 2; any other value unchanged.
    """
    return repr(value[: 2 * _MAX_SHOWN]) if isinstance(value, str) else value


def nearest(name: str, known_names: Collection[str]) -> str:
    """Return ` (nearest: NAME)` for messages, with the `nearest_name`; an empty string if there is none, or if
    only one name is known.
    """
    near = nearest_name(name, known_names) if len(known_names) > 1 else ""
    return f" (nearest: {near})" if near else ""


def nearest_name(name: str, known_names: Collection[str]) -> str:
    """Return the one of the known names that is most similar to a misspelt `name`, or else contains it; an empty
    string if there is none.
    """
    import difflib

    for known_name in known_names:
        if known_name.lower() == name.lower():
            return known_name
    is_quick = len(known_names) <= 2000  # the search for similar names takes long among more
    near = difflib.get_close_matches(name[:40], known_names, 1, cutoff=0.6) if is_quick else []
    if not near and len(name) >= 3:
        near = [known_name for known_name in known_names if name in known_name][:1]
    return near[0] if near else ""


def choices(names: Sequence[str]) -> str:
    """Return `one of a, b, c` for messages. For more than 64 names, it gives their number and only the first 32."""
    if len(names) <= 64:
        return "one of " + ", ".join(names)
    return f"one of {len(names)} names: {', '.join(names[:32])}, ..."


def line_with_caret(line: str, column: int) -> str:
    """Return text of two lines, both indented by two spaces: `line` with escaped control characters, and a caret
    under the character at `column`, counted from 1. A long line is cut to the 60 characters before the column and the
    61 from it on.

    >>> print(line_with_caret("psi = 2*", 9))
      psi = 2*
              ^
    """
    start = max(0, column - 61)
    before, behind = printable(line[start : column - 1]), printable(line[column - 1 : column + 60])
    return f"  {before}{behind}".rstrip() + f"\n  {' ' * len(before)}^"


def printable(text: str) -> str:
    """Return the text with characters that are not printable, newlines included, replaced by backslash escapes.

    >>> print(printable("arm" + chr(27) + "[2J").replace(chr(92), "/"))
    arm/x1b[2J
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class DynamicsWarning(UserWarning):
    """Warns that forces or motion may be wrong: a mass was not given or no rigid body can have it, a mass matrix is
    singular, a joint is beyond its limits.
    """


def warn_of_dynamics(message: str) -> None:
    """Issue a DynamicsWarning that points at the line which called the package."""
    frame, level = sys._getframe(), 1
    while frame.f_back is not None and str(frame.f_globals.get("__name__")).startswith(("hingepair.", "functools")):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, DynamicsWarning, level)
