"""The motion of one frame of a robot written out: text with named intermediate quantities, LaTeX, NumPy source."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import sympy

from hingepair.errors import ArgumentError, choices, quoted
from hingepair.mechanism.mechanism import Mechanism
from hingepair.symbolic.exact_constants import exact
from hingepair.symbolic.frame_program import POINTS, FrameProgram
from hingepair.symbolic.kinks import Expr, constant_value
from hingepair.symbolic.layout import align, docstring_text, heading, latex_lines, shape_text, wrapped
from hingepair.symbolic.printers import (
    DECIMAL_LATEX,
    DECIMAL_TEXT,
    PYTHON,
    SYMPY,
    Write,
    in_order,
    joined,
    latex_name,
    with_short_constants,
)

FRAME_OUTPUTS: Final = ("R", "S", "jacobian", "v", "omega")
"""What can be derived of a robot's frame, and is unless something else is asked for."""
_MEANINGS: Final = {
    "R": "position of the frame's origin, world axes [m]",
    "S": "rotation from the frame's axes to those of the world",
    "jacobian": "(v, omega) = jacobian @ qd, world axes",
    "v": "velocity of the frame's origin, world axes [m/s]",
    "omega": "angular velocity of the frame, world axes [rad/s]",
}


class _Row(NamedTuple):
    """A line: the labels of equal components, the first of which may stand in later lines, and what they are."""

    labels: tuple[str, ...]
    expr: Expr


class FrameForms:
    """The closed forms of the motion of one frame of a robot whose base rests at the origin (E2, E5, E7).

    `R` and `S`, `jacobian` (6, dof) with rows (v, omega), `v` and `omega` are attributes: immutable SymPy matrices
    in the symbols `q` and `qd`, world axes. Numbers are those of the robot as their shortest decimals write them;
    entries of rotations that are 0, 1, -1 or roots of simple fractions to rounding are these, and sliders are joints
    like others.

    Args:
        robot: with a fixed base.
        frame: name of a link, a joint or another frame; that of the last link unless given, if there is one only.
        symbolic: ("u",) keeps the points of joints and the frame's origin as letters, as far as they are not 0.
        notes: sentences on the robot's numbers, which stand above what is written out.

    Raises:
        ArgumentError: the base is free, there is no such frame, or nothing such can stay a letter.
    """

    __slots__ = ("_notes", "_program", "_title")

    names: Final = FRAME_OUTPUTS

    def __init__(
        self,
        robot: Mechanism,
        frame: str | None = None,
        symbolic: Iterable[str] = (),
        notes: Sequence[str] = (),
    ) -> None:
        if robot.base != "fixed":
            expected = "a robot with base='fixed': the motion of its frames relative to its base"
            raise ArgumentError("scene_or_pair", expected, f"base={robot.base!r}")
        letters = symbolic if isinstance(symbolic, str) or not isinstance(symbolic, Iterable) else tuple(symbolic)
        if letters not in ((), (POINTS,)):
            raise ArgumentError(
                "symbolic", f"({POINTS!r},): points of a robot's joints, or nothing", quoted(symbolic)
            )
        tips = robot.tree.tips
        if frame is None and len(tips) != 1:
            raise ArgumentError(
                "frame",
                f"the name of a link or joint, since {robot.name} ends in {len(tips)} links: {choices(tips)}",
                "none",
            )
        name = tips[0] if frame is None else frame
        self._program = FrameProgram(robot.tree, robot.tree.known_frame("frame", name), letters)
        self._title = f"frame {name} of {robot.name}"
        small = self._program.rounded
        own = (f"lengths of at most {small:.2g} m, which rounding left, are taken for 0",) if small else ()
        self._notes = (*notes, *own)

    @property
    def q(self) -> tuple[Expr, ...]:
        """The symbols of the coordinates, in the order of the robot's q (rad for hinges, m for sliders)."""
        return self._program.q

    @property
    def qd(self) -> tuple[Expr, ...]:
        """The symbols of their rates."""
        return self._program.qd

    @property
    def numbers(self) -> Mapping[Expr, float]:
        """The values of the letters that stand for points, by their symbols [m]."""
        return dict(self._program.numbers)

    def __getattr__(self, name: str) -> Any:
        if name not in self.names:
            raise AttributeError(f"{type(self).__name__} has no {name!r}; it has q, qd, {', '.join(self.names)}")
        parts = [self._expanded(part) for part in self._program.results[name]]
        rows = {"S": 3, "jacobian": 6}.get(name, len(parts))
        return sympy.ImmutableMatrix(rows, len(parts) // rows, parts)

    def __dir__(self) -> list[str]:
        return [*object.__dir__(self), *self.names]

    def __repr__(self) -> str:
        return f"{type(self).__name__} of {self._title}: {', '.join(self.names)}"

    def to_text(self, names: Iterable[str] | None = None, *, short: bool = True, width: int = 100) -> str:
        """Return one equation a component, as a paper has it: `R_x = c_1 k_1 - s_1 k_2`; rates are q_1'.

        Components that are equal stand in one line; those that are 0 stand in the last one.

        Args:
            names: some of `names`; all unless given.
            short: whether sines and cosines are abbreviated (c_1, s_23 of q_2 + q_3) and sums that come again named.
            width: of a line; longer equations go on in the next.

        Raises:
            ArgumentError: an unknown output.
        """
        rows = self._shown(self._checked(names), short)
        lines = [docstring_text(f"{self._title}: {self._legend()}"), *self._notes]
        lines += _told(self._lengths(rows), DECIMAL_TEXT)
        lines += _told(self._waves(rows), DECIMAL_TEXT)
        for row in rows:
            shown = " = ".join(DECIMAL_TEXT(sympy.Symbol(label)) for label in row.labels)
            lines.append(f"{shown} = {joined(_terms(self._dashed(row.expr)), DECIMAL_TEXT)}")
        return "".join(f"{wrapped(line, width)}\n" for line in lines)

    def to_latex(self, names: Iterable[str] | None = None, *, short: bool = True) -> str:
        r"""Return an align* environment of the package amsmath; rates are \dot{q}_1. Arguments as for `to_text`."""
        rows = self._shown(self._checked(names), short)
        known = {**self._lengths(rows), **self._waves(rows)}
        lines = [f"{latex_name(letter.name)} &= {DECIMAL_LATEX(what)}" for letter, what in known.items()]
        for row in rows:
            equal = "".join(f"{latex_name(label)} = " for label in row.labels[:-1])
            first, *more = latex_lines(row.labels[-1], _terms(self._dashed(row.expr)), DECIMAL_LATEX)
            lines += [equal + first, *more]
        notes = "".join(f"% {docstring_text(note)}\n" for note in (f"{self._title}: {self._legend()}", *self._notes))
        return notes + align(lines)

    def to_python(self, names: Iterable[str] | None = None, title: str = "") -> str:
        """Return a Python module that needs only NumPy, one function an output, of q or q and qd as the robot's.

        Letters that stand for points are arguments, with the robot's numbers as defaults. `names` as for `to_text`.
        """
        lines = [wrapped(docstring_text(note), 100) for note in (f"{self._legend()}.", *self._notes)]
        module = "\n".join((f'"""Closed forms{heading(title or self._title)}.', "", *lines, '"""\n\nimport numpy\n'))
        return "\n\n".join([module, *map(self._function, self._checked(names))])

    def to_sympy(self, names: Iterable[str] | None = None) -> dict[str, str]:
        """Return the SymPy source of each component, which `sympy.sympify` reads, by its label: R_x, S_xy, Jv_x1.

        Components are written out in q_1, qd_1 and so on. `names` as for `to_text`.
        """
        return {label: SYMPY(self._expanded(expr)) for label, expr in self._labelled(self._checked(names))}

    # ---- lines

    def _checked(self, names: Iterable[str] | None) -> tuple[str, ...]:
        wanted = self.names if names is None else tuple(names)
        for name in wanted:
            if name not in self.names:
                raise ArgumentError("outputs", choices(self.names), quoted(name))
        return wanted

    def _legend(self) -> str:
        joints = (
            f"{letter} {joint.name}{' [m]' * (joint.kind == 'slider')}"
            for letter, joint in self._program.joints.items()
        )
        if not self._program.joints:
            return "no joint moves it"
        others = "; the other joints do not move it" if len(self._program.joints) < self._program.dof else ""
        return "; ".join(joints) + others

    def _labelled(self, names: Iterable[str]) -> Iterator[tuple[str, Expr]]:
        """Yield every component with its label."""
        for name in names:
            if name == "jacobian":
                columns = range(1, self._program.dof + 1)
                labels = [f"{row}{column}" for row in ("Jv_x", "Jv_y", "Jv_z") for column in columns]
                labels += [f"{row}{column}" for row in ("Jomega_x", "Jomega_y", "Jomega_z") for column in columns]
            else:
                labels = [f"{name}_{''.join(axes)}" for axes in itertools.product("xyz", repeat=1 + (name == "S"))]
            yield from zip(labels, self._program.results[name], strict=True)

    def _shown(self, names: Iterable[str], short: bool) -> list[_Row]:
        """Return the lines of outputs without those of the Jacobian's columns that are 0 altogether."""
        hidden = {number for number, q in enumerate(self.q, 1) if q not in self._program.joints}
        columns = tuple(f"_{axis}{number}" for axis in "xyz" for number in hidden)
        return self._rows([pair for pair in self._labelled(names) if not pair[0].endswith(columns)], short)

    def _rows(self, labelled: Iterable[tuple[str, Expr]], short: bool) -> list[_Row]:
        """Return the lines of components, each after those that it needs."""
        equal: dict[tuple[bool, Expr], list[str]] = {}
        for label, expr in labelled:
            shown = expr if short else self._expanded(expr)
            equal.setdefault((label.startswith("J"), shown), []).append(label)
        zeros = [label for (_, expr), labels in equal.items() if expr == 0 for label in labels]
        rows = [_Row(tuple(labels), expr) for (_, expr), labels in equal.items() if expr != 0]
        rows = _Namer(self._program.meanings, rows).ordered() if short else rows
        return [*rows, _Row(tuple(zeros), sympy.S.Zero)] if zeros else rows

    def _lengths(self, rows: Iterable[_Row]) -> dict[Expr, Expr]:
        """Return the numbers of the points that lines hold, by their letter."""
        letters = set().union(*(row.expr.free_symbols for row in rows))
        return {letter: exact(value) for letter, value in self._program.numbers.items() if letter in letters}

    def _waves(self, rows: Iterable[_Row]) -> dict[Expr, Expr]:
        """Return the sines and cosines that lines hold, by their letter."""
        letters = set().union(*(row.expr.free_symbols for row in rows))
        waves = [item for item in self._program.waves.items() if item[0] in letters]
        return dict(sorted(waves, key=lambda item: (item[0].name.count(","), len(item[0].name), item[0].name[2:])))

    def _expanded(self, expr: Expr) -> Expr:
        """Return a component in q and qd."""
        while held := expr.free_symbols & self._program.meanings.keys():
            expr = expr.xreplace({letter: self._program.meanings[letter] for letter in held})
        return expr.xreplace(self._program.waves)

    def _dashed(self, expr: Expr) -> Expr:
        """Return an expression with q_1' for qd_1."""
        return expr.xreplace(
            {rate: sympy.Symbol(f"{q.name}'", real=True) for rate, q in zip(self.qd, self.q, strict=True)}
        )

    def _function(self, name: str) -> str:
        """Return the source of the function of one output."""
        rows = self._rows(self._labelled((name,)), short=True)
        waves = self._waves(rows)
        letters = set().union(*(expr.free_symbols for expr in [*waves.values(), *(row.expr for row in rows)]))
        labels = [label for label, _ in self._labelled((name,))]
        moves = name in {"v", "omega"}
        arguments = ["q", *["qd"] * moves]
        points = [f"{letter}={value!r}" for letter, value in self._program.numbers.items() if letter in letters]
        tail = {"S": (3, 3), "jacobian": (6, self._program.dof)}.get(name, (3,))
        takes = f"{' and '.join(arguments)} of shape {shape_text((self._program.dof,))}"
        lines = [
            f"def {name}({', '.join((*arguments, *points))}):",
            f'    """{name}: {_MEANINGS[name]}; {takes} give{"s" * (not moves)} {shape_text(tail)}."""',
            *(f"    {argument} = numpy.asarray({argument}, dtype=float)" for argument in arguments),
        ]
        for argument, symbols in (("q", self.q), ("qd", self.qd)):
            lines += [f"    {one} = {argument}[..., {i}]" for i, one in enumerate(symbols) if one in letters]
        lines += [f"    {letter} = {PYTHON(_in_decimals(wave))}" for letter, wave in waves.items()]
        lines += [f"    {' = '.join(row.labels)} = {PYTHON(_in_decimals(row.expr))}" for row in rows]
        shape = "q.shape[:-1]" if not moves else "numpy.broadcast_shapes(q.shape, qd.shape)[:-1]"
        width = len(labels) // tail[0]
        lines += ["    parts = ("]
        lines += [f"        {', '.join(labels[i : i + width])}," for i in range(0, len(labels), max(width, 1))]
        lines += [
            "    )",
            f"    shape = {shape}",
            "    parts = [numpy.broadcast_to(part, shape) for part in parts]",
            f"    return numpy.stack(parts, axis=-1).reshape(shape + {tail})",
        ]
        return "\n".join(lines) + "\n"


class _Namer:
    """Puts lines into an order in which each needs earlier ones only, and names what comes again: k_1, k_2."""

    def __init__(self, meanings: Mapping[Expr, Expr], rows: Iterable[_Row]) -> None:
        self._meanings = meanings
        self._rows: list[_Row] = []
        self._names: dict[Expr, Expr] = {}  # by letter, what later lines have in its place
        self._defining: dict[Expr, _Row] = {}  # lines that say what a letter is
        self._asked: list[_Row] = []
        for row in rows:
            letter = _letter_of(row, meanings)
            if letter is not None:
                self._defining.setdefault(letter, row)
            self._asked.append(row)
        self._uses = self._count()
        self._count_of_names = 0

    def ordered(self) -> list[_Row]:
        """Return the lines."""
        for row in self._asked:
            self._write(row)
        return self._rows

    def _count(self) -> Counter[Expr]:
        """Return how often each letter stands in the lines and in what they need."""
        uses: Counter[Expr] = Counter()
        waiting = [row.expr for row in self._asked]
        while waiting:
            for part in sympy.preorder_traversal(waiting.pop()):
                if part in self._meanings:
                    uses[part] += 1
                    if uses[part] == 1:
                        waiting.append(self._meanings[part])
        return uses

    def _write(self, row: _Row) -> None:
        letter = _letter_of(row, self._meanings)
        if letter is None or letter in self._names or self._defining[letter] is not row:
            self._rows.append(_Row(row.labels, self._resolved(row.expr)))
            return
        sign = 1 if letter == row.expr else -1
        self._rows.append(_Row(row.labels, sign * self._resolved(self._meanings[letter])))
        self._names[letter] = sign * sympy.Symbol(row.labels[0], real=True)

    def _resolved(self, expr: Expr) -> Expr:
        """Return an expression in names that earlier lines define; writes these lines first."""
        held = sorted(expr.free_symbols & self._meanings.keys(), key=lambda letter: int(letter.name[1:]))
        return expr.xreplace({letter: self._resolved_letter(letter) for letter in held})

    def _resolved_letter(self, letter: Expr) -> Expr:
        if letter not in self._names:
            meaning = self._resolved(self._meanings[letter])
            if self._uses[letter] == 1:
                return meaning
            self._count_of_names += 1
            name = f"k_{self._count_of_names}"
            self._rows.append(_Row((name,), meaning))
            self._names[letter] = sympy.Symbol(name, real=True)
        return self._names[letter]


def _letter_of(row: _Row, meanings: Mapping[Expr, Expr]) -> Expr | None:
    """Return the letter that a line says the value of, with either sign; None of a line of another kind."""
    return next((letter for letter in (row.expr, -row.expr) if letter in meanings), None)


def _terms(expr: Expr) -> tuple[Expr, ...]:
    return in_order(with_short_constants(expr), by_letters=True)


def _told(meanings: Mapping[Expr, Expr], write: Write) -> list[str]:
    """Return one line of what letters mean; none where there are none."""
    told = "; ".join(f"{letter} = {write(what)}" for letter, what in meanings.items())
    return [told] if told else []


def _in_decimals(expr: Expr) -> Expr:
    """Return an expression whose numbers that are no integers are written as decimals, each as one symbol."""
    if not expr.free_symbols:
        value = constant_value(expr)
        letter = expr if expr.is_Integer else sympy.Symbol(repr(abs(value)))
        return letter if expr.is_Integer or value > 0 else -letter
    if not expr.args:
        return expr
    constants = [part for part in expr.args if not part.free_symbols] if expr.is_Add or expr.is_Mul else []
    parts = [_in_decimals(expr.func(*constants))] if constants else []
    if expr.is_Pow:
        return expr
    return expr.func(*parts, *(_in_decimals(part) for part in expr.args if part not in constants))
