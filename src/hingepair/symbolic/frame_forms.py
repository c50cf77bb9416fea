"""Output of the closed form of a robot's frame as text, LaTeX, Python and C."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import sympy

from hingepair.errors import ArgumentError, choices, quoted
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.symbolic.exact_constants import exact
from hingepair.symbolic.frame_program import POINTS, FrameProgram
from hingepair.symbolic.kinks import Expr, constant_value
from hingepair.symbolic.printers import (
    to_decimal_latex,
    to_decimal_text,
    with_short_constants,
)
from hingepair.symbolic.written_forms import (
    Equation,
    Equations,
    Function,
    WrittenForms,
    common_parts,
    docstring_text,
    shape_text,
    title_suffix,
    wrap_equation,
)

FRAME_OUTPUTS: Final = ("R", "S", "jacobian", "v", "omega")
"""Outputs of a robot's frame, all of which are derived by default."""
# Descriptions of the outputs with their units.
_DESCRIPTIONS: Final = {
    "R": "position of the frame's origin, world axes [m]",
    "S": "rotation from the frame's axes to those of the world",
    "jacobian": "(v, omega) = jacobian @ qd, world axes",
    "v": "velocity of the frame's origin, world axes [m/s]",
    "omega": "angular velocity of the frame, world axes [rad/s]",
}


class FrameForms(WrittenForms):
    """Closed forms of the motion of one frame of a robot whose base rests at the origin (E2, E5, E7): attributes R,
    S, jacobian, v and omega, immutable SymPy matrices in the symbols of the robot's coordinates and rates. The
    methods write them as text, LaTeX, Python and SymPy source.

    The matrices are in world axes and in the symbols `q` and `qd`: R (3, 1), S (3, 3), jacobian (6, dof) with the
    rows of v before those of omega, v (3, 1) and omega (3, 1). Each number of the robot is the rational number that
    its shortest decimal form shows. An entry of a rotation that equals 0, 1, -1 or the root of a simple fraction
    within rounding is exactly that number.

    Args:
        robot: a robot with a fixed base.
        frame: name of a link, a joint or another frame; None means the last link, if there is only one.
        symbolic: (), or ("u",) to keep the components of joint points and of the frame's origin as symbols, except
            zeros.
        notes: sentences on the robot's numbers, which the output shows above the equations.

    Raises:
        ArgumentError: the base is free, there is no such frame, or `symbolic` is neither () nor ("u",).
    """

    __slots__ = ("_notes", "_program", "_title")

    names: Final = FRAME_OUTPUTS
    _writers = to_decimal_text, lambda label: to_decimal_text(sympy.Symbol(label)), to_decimal_latex
    _abbreviated = True
    _by_symbols = True

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
        symbols = symbolic if isinstance(symbolic, str) or not isinstance(symbolic, Iterable) else tuple(symbolic)
        if symbols not in ((), (POINTS,)):
            raise ArgumentError(
                "symbolic",
                f"({POINTS!r},): points of a robot's joints, or nothing",
                quoted(symbolic),
            )
        end_links = tree_of(robot).plain().tips
        if frame is None and len(end_links) != 1:
            raise ArgumentError(
                "frame",
                f"the name of a link or joint, since {robot.name} ends in {len(end_links)} links: "
                f"{choices(end_links)}",
                "none",
            )
        name = end_links[0] if frame is None else frame
        self._program = FrameProgram(tree_of(robot), tree_of(robot).known_frame("frame", name), symbols)
        self._title = f"frame {name} of {robot.name}"
        small = self._program.largest_rounded
        rounding_note = (f"lengths of at most {small:.2g} m, which rounding left, are taken for 0",) if small else ()
        self._notes = (*notes, *rounding_note)

    @property
    def q(self) -> tuple[Expr, ...]:
        """Symbols of the coordinates, in the order of the robot's q (rad for hinges, m for sliders)."""
        return self._program.q

    @property
    def qd(self) -> tuple[Expr, ...]:
        """Symbols of the rates of the coordinates (rad/s for hinges, m/s for sliders)."""
        return self._program.qd

    @property
    def numbers(self) -> Mapping[Expr, float]:
        """Values of the components of points that are symbols, by symbol [m]."""
        return dict(self._program.numbers)

    def __getattr__(self, name: str) -> Any:
        if name not in self.names:
            raise AttributeError(f"{type(self).__name__} has no {name!r}; it has q, qd, {', '.join(self.names)}")
        parts = [self._in_coordinates(part) for part in self._program.results[name]]
        rows = {"S": 3, "jacobian": 6}.get(name, len(parts))
        return sympy.ImmutableMatrix(rows, len(parts) // rows, parts)

    def __dir__(self) -> list[str]:
        return [*object.__dir__(self), *self.names]

    def __repr__(self) -> str:
        return f"{type(self).__name__} of {self._title}: {', '.join(self.names)}"

    def _equations(self, names: Iterable[str] | None, short: bool) -> Equations:
        """Return the equations of the outputs without columns of joints that do not move the frame, below the points
        and, if they will be shortened, the sines and cosines that they use. Equal components share a line, and those
        that are 0 are in the last one.
        """
        hidden = {number for number, q in enumerate(self.q, 1) if q not in self._program.joints}
        columns = tuple(f"_{axis}{number}" for axis in "xyz" for number in hidden)
        labels_by_expr: dict[tuple[bool, Expr], list[str]] = {}
        for label, expr in self._labelled_components(self._checked_names(names)):
            if not label.endswith(columns):
                shown = expr if short else self._in_coordinates(expr)
                labels_by_expr.setdefault((shown != 0 and label.startswith("J"), shown), []).append(label)
        zeros = labels_by_expr.pop((False, sympy.S.Zero), None)
        rows = [
            Equation(tuple(labels), self._with_primes(with_short_constants(expr)))
            for (_, expr), labels in labels_by_expr.items()
        ]
        rows += [Equation(tuple(zeros), sympy.S.Zero)] if zeros else []
        exprs = [row.expr for row in rows]
        definitions = [
            {symbol.name: meaning for symbol, meaning in group.items()}
            for group in (self._point_values(exprs), self._used_trig(exprs))
        ]
        return Equations(rows, definitions, (docstring_text(f"{self._title}: {self._legend()}"), *self._notes))

    def _components(self, names: Iterable[str] | None) -> Iterator[tuple[str, Expr]]:
        for label, expr in self._labelled_components(self._checked_names(names)):
            yield label, self._in_coordinates(expr)

    def _heading(self, title: str) -> Sequence[str]:
        lines = [wrap_equation(docstring_text(note), 100) for note in (f"{self._legend()}.", *self._notes)]
        return [f"Closed forms{title_suffix(title or self._title)}.", *lines]

    # ---- lines

    def _checked_names(self, names: Iterable[str] | None) -> tuple[str, ...]:
        """Return the argument `names`, by default all outputs; refuse unknown ones."""
        checked = self.names if names is None else tuple(names)
        for name in checked:
            if name not in self.names:
                raise ArgumentError("outputs", choices(self.names), quoted(name))
        return checked

    def _legend(self) -> str:
        """Return a text on which joint each coordinate q_1, q_2, ... belongs to."""
        joints = (
            f"{symbol} {joint.name}{' [m]' * (joint.unit == 'm')}" for symbol, joint in self._program.joints.items()
        )
        if not self._program.joints:
            return "no joint moves the frame"
        others = "; the other joints do not move the frame" if len(self._program.joints) < self._program.dof else ""
        return "; ".join(joints) + others

    def _labelled_components(self, names: Iterable[str]) -> Iterator[tuple[str, Expr]]:
        """Yield the components of outputs with their labels, such as R_x or Jv_x1, in symbols of the program."""
        for name in names:
            if name == "jacobian":
                columns = range(1, self._program.dof + 1)
                labels = [f"{row}{column}" for row in ("Jv_x", "Jv_y", "Jv_z") for column in columns]
                labels += [f"{row}{column}" for row in ("Jomega_x", "Jomega_y", "Jomega_z") for column in columns]
            else:
                labels = [f"{name}_{''.join(axes)}" for axes in itertools.product("xyz", repeat=1 + (name == "S"))]
            yield from zip(labels, self._program.results[name], strict=True)

    def _point_values(self, exprs: Iterable[Expr]) -> dict[Expr, Expr]:
        """Return the values [m] of the symbols of points in expressions."""
        symbols = set().union(*(expr.free_symbols for expr in exprs))
        return {symbol: exact(value) for symbol, value in self._program.numbers.items() if symbol in symbols}

    def _used_trig(self, exprs: Iterable[Expr]) -> dict[Expr, Expr]:
        """Return the sines and cosines that expressions use, by their symbols, in the order of display."""
        symbols = set().union(*(expr.free_symbols for expr in exprs))
        used_items = [item for item in self._program.waves.items() if item[0] in symbols]
        return dict(
            sorted(used_items, key=lambda item: (item[0].name.count(","), len(item[0].name), item[0].name[2:]))
        )

    def _in_coordinates(self, expr: Expr) -> Expr:
        """Return an expression in q and qd alone."""
        return expr.xreplace(self._program.waves)

    def _with_primes(self, expr: Expr) -> Expr:
        """Return an expression with q_1' in place of qd_1, and so on."""
        return expr.xreplace(
            {rate: sympy.Symbol(f"{q.name}'", real=True) for rate, q in zip(self.qd, self.q, strict=True)}
        )

    def _functions(self, names: Iterable[str] | None) -> Iterator[Function]:
        """Yield functions of q, or of q and qd."""
        for name in self._checked_names(names):
            exprs = [_with_decimals(expr) for _, expr in self._labelled_components((name,))]
            waves = {symbol: _with_decimals(wave) for symbol, wave in self._used_trig(exprs).items()}
            symbols = set().union(*(expr.free_symbols for expr in [*waves.values(), *exprs]))
            moves = name in {"v", "omega"}
            vectors = {"q": self.q, "qd": self.qd} if moves else {"q": self.q}
            tail = {"S": (3, 3), "jacobian": (6, self._program.dof)}.get(name, (3,))
            takes = f"{' and '.join(vectors)} of shape {shape_text((self._program.dof,))}"
            steps, results = common_parts(exprs)
            yield Function(
                name,
                f": {_DESCRIPTIONS[name]}",
                f"{takes} give{'s' * (not moves)} {shape_text(tail)}",
                tuple(vectors),
                [*((symbol.name, wave) for symbol, wave in waves.items()), *steps],
                results,
                tail,
                {v: [part.name if part in symbols else "" for part in parts] for v, parts in vectors.items()},
                {symbol.name: value for symbol, value in self._program.numbers.items() if symbol in symbols},
            )


def _with_decimals(expr: Expr) -> Expr:
    """Return an expression whose constant parts are symbols that print as decimals, except in powers of symbols."""
    if not expr.free_symbols:
        value = constant_value(expr)
        symbol = expr if expr.is_Integer else sympy.Symbol(repr(abs(value)))
        return symbol if expr.is_Integer or value > 0 else -symbol
    if not expr.args:
        return expr
    constants = [part for part in expr.args if not part.free_symbols] if expr.is_Add or expr.is_Mul else []
    parts = [_with_decimals(expr.func(*constants))] if constants else []
    if expr.is_Pow:
        return expr
    return expr.func(*parts, *(_with_decimals(part) for part in expr.args if part not in constants))
