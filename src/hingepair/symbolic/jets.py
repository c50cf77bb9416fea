"""Jets: expressions in t with their first and second derivatives, as programs of small steps.

The derivatives of one long expression can be a thousand times as long. Here every part is a step with a name, and is
differentiated by SymPy in terms of the names of its own parts; the chain rule combines the derivatives. There are as
many steps as the expression has parts. At a kink the derivatives are those from the right.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from typing import Final, TypeAlias

import sympy

from hingepair.symbolic.kinks import Choice, Expr, Remainder, SideOfZero, Where, constant_value

ValueAndDerivatives: TypeAlias = tuple[Expr, Expr, Expr]
"""Value, first and second derivative by t."""

SYMPY_ERROR_TYPES: Final = (
    ArithmeticError,
    AttributeError,
    NotImplementedError,
    RecursionError,
    TypeError,
    ValueError,
)
"""Errors that SymPy raises on unusual but harmless expressions, such as asin(cos(1e300))."""

MAX_EXACT_NUMBER_BITS: Final = 4_096
"""Largest number of bits of the numerator and of the denominator of an exact number."""

SMOOTH_FUNCTION_NAMES: Final = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
    *("asinh", "acosh", "atanh", "exp", "log", "sqrt"),
)
"""Names of functions that SymPy and math share."""

# Names of the functions that are compiled to NumPy.
_SYMPY_FUNCTION_NAMES_COMPILED_TO_NUMPY = (
    *SMOOTH_FUNCTION_NAMES,
    "Abs",
    "sign",
    "floor",
    "Where",
    "SideOfZero",
    "Larger",
    "Smaller",
    "Remainder",
)


class NotRealError(ArithmeticError):
    """Error on an expression or a derivative that is not real, or that contains a number beyond the range of
    floats.
    """


def time_symbol() -> Expr:
    """Return the real SymPy symbol t, which stands for time in every expression."""
    return sympy.Symbol("t", real=True)


def bit_length(number: Expr) -> int:
    """Return the larger of the numbers of bits of a rational number's numerator and denominator."""
    return max(int(number.p).bit_length(), int(number.q).bit_length())


class DerivativeProgram:
    """Program of named steps that compute expressions in t and their first and second derivatives.
    `value_and_derivatives` adds an expression; `steps` is the list of all steps, pairs (symbol, expression).

    Attributes:
        steps: pairs of a name and its expression in t and earlier names.
        switches: results whose value jumps where an expression has a kink or a jump.
    """

    def __init__(self) -> None:
        self.steps: list[tuple[Expr, Expr]] = []
        self.switches: list[Expr] = []
        self._names: dict[Expr, Expr] = {}
        self._derivatives: dict[Expr, ValueAndDerivatives] = {}
        self._sides: dict[Expr, Expr] = {}
        self._constants: dict[Expr, Expr] = {}

    def value_and_derivatives(self, expr: Expr) -> ValueAndDerivatives:
        """Return a tuple of the value and the first and second derivatives of an expression in t. Each is a number,
        t, or the symbol of a step; missing steps are added. Raise a NotRealError if one of them is not real and
        finite.

        Raises:
            NotRealError: one of them is not real and finite.
        """
        if expr not in self._derivatives:
            zero, one = sympy.S.Zero, sympy.S.One
            if not expr.free_symbols:
                self._derivatives[expr] = (self._name_step(expr), zero, zero)
            elif expr.is_Symbol:
                self._derivatives[expr] = (expr, one if expr == time_symbol() else zero, zero)
            else:
                self._derivatives[expr] = self._combine(
                    expr, [self.value_and_derivatives(part) for part in expr.args]
                )
        return self._derivatives[expr]

    def value(self, result: Expr) -> float | None:
        """Return the float of a program result that does not depend on t; None if it does."""
        constant: Expr = self._constants.get(result) or result
        return None if constant.free_symbols else constant_value(constant)

    def steps_for(self, results: list[Expr]) -> list[tuple[Expr, Expr]]:
        """Return a list of those steps (symbol, expression) that `results`, a list of numbers and symbols of steps,
        need, in the order of computation.
        """
        names = set().union(*(result.free_symbols for result in results))
        steps = []
        for name, step in reversed(self.steps):
            if name in names:
                steps.append((name, step))
                names |= step.free_symbols
        return steps[::-1]

    def _combine(self, expr: Expr, argument_derivatives: list[ValueAndDerivatives]) -> ValueAndDerivatives:
        """Return (value, first derivative, second derivative) of an expression, each a number or the symbol of a
        step. `argument_derivatives` lists such a tuple for each of its arguments. Add the steps that compute them,
        and append the steps whose values jump at kinks to `switches`.
        """
        if expr.is_Mul:
            return functools.reduce(self._multiply, argument_derivatives)
        value = expr.func(*[value for value, _, _ in argument_derivatives])
        match expr:
            case sympy.Add():
                return self._name_step(value), *(
                    self._name_step(sympy.Add(*[one[k] for one in argument_derivatives])) for k in (1, 2)
                )
            case Remainder():
                self.switches.append(
                    self._name_step(sympy.floor(argument_derivatives[0][0] / argument_derivatives[1][0]))
                )
                return self._name_step(value), *argument_derivatives[0][1:]
            case sympy.Abs():
                guard, x, y = (
                    expr.args[0],
                    argument_derivatives[0],
                    self._multiply(argument_derivatives[0], (sympy.S.NegativeOne, 0, 0)),
                )
            case sympy.sign():
                guard, x, y = expr.args[0], *[(sympy.S.Zero,) * 3] * 2
            case Choice():
                guard, x, y = expr.guard, *argument_derivatives[-2:]
            case _:
                return self._differentiate(value, argument_derivatives)
        side = self._name_sign_step(guard)
        self.switches.append(side)
        # Derivatives from the right.
        return self._name_step(value), *(self._name_step(Where(side, x[k], y[k])) for k in (1, 2))

    def _name_sign_step(self, guard: Expr) -> Expr:
        """Return the symbol of a step whose value is 1 or -1: the sign of `guard` just after t. The step is added at
        its first use.
        """
        if guard not in self._sides:
            match guard:
                case Choice():
                    side = guard.func(*map(self._name_sign_step, guard.args))
                case sympy.Number():
                    side = sympy.S.One if guard >= 0 else sympy.S.NegativeOne
                case _:
                    side = SideOfZero(*self.value_and_derivatives(guard))
            self._sides[guard] = self._name_step(side)
        return self._sides[guard]

    def _multiply(self, a: ValueAndDerivatives, b: ValueAndDerivatives) -> ValueAndDerivatives:
        """Return (value, first derivative, second derivative) of the product of two factors, which are given as
        such tuples, by (a b)'' = a'' b + 2 a' b' + a b''. The results are numbers and symbols of steps, which
        are added.
        """
        first = a[1] * b[0] + a[0] * b[1]
        second = a[2] * b[0] + 2 * a[1] * b[1] + a[0] * b[2]
        return self._name_step(a[0] * b[0]), self._name_step(first), self._name_step(second)

    def _differentiate(self, expr: Expr, argument_derivatives: list[ValueAndDerivatives]) -> ValueAndDerivatives:
        """Return (value, first derivative, second derivative) of `expr`, a function of the value symbols of its
        arguments, by the chain rule; `argument_derivatives` lists such a tuple for each argument. The results are
        numbers and symbols of steps, which are added.
        """
        parts = {value: (first, second) for value, first, second in argument_derivatives if value.is_Symbol}
        value, first, second = self._name_step(expr), 0, 0
        for u, (ud, udd) in parts.items():
            slope = expr.diff(u)
            _check_real(slope)
            first += self._name_functions(slope) * ud
            second += self._name_functions(slope) * udd
            for v, (vd, _) in parts.items():
                second += self._name_functions(slope.diff(v)) * ud * vd
        return value, self._name_step(first), self._name_step(second)

    def _name_functions(self, expr: Expr) -> Expr:
        """Return an expression in which the innermost functions are replaced by the symbols of steps, since f, f' and
        f'' often share them. The steps are added.
        """
        functions = [f for f in expr.atoms(sympy.Function) if all(part.is_Atom for part in f.args)]
        return expr.xreplace({f: self._name_step(f) for f in functions})

    def _name_step(self, expr: Expr) -> Expr:
        """Return the symbol of the step that computes an expression. The step is added at its first use; rational
        numbers and symbols are returned unchanged. Raise a NotRealError if the expression is not real.
        """
        expr = sympy.sympify(expr)
        if expr.free_symbols <= self._constants.keys():
            expr = expr.xreplace(self._constants)
        if expr.is_Symbol:
            return expr
        if expr not in self._names:
            _check_real(expr)
            if expr.is_Rational:
                return expr
            self._names[expr] = sympy.Symbol(f"λ{len(self.steps)}", real=True)  # no name that a constant can have
            self.steps.append((self._names[expr], expr))
            if not expr.free_symbols:
                self._constants[self._names[expr]] = expr
        return self._names[expr]


def _check_real(expr: Expr) -> None:
    """Raise a NotRealError if NumPy cannot evaluate an expression in real, finite numbers."""
    if expr.has(sympy.I, sympy.nan, sympy.zoo, sympy.oo, -sympy.oo):
        raise NotRealError("an imaginary or infinite part")
    if any(bit_length(number) > MAX_EXACT_NUMBER_BITS for number in expr.atoms(sympy.Rational)):
        raise NotRealError("a number of too many digits")
    if not all(math.isfinite(constant_value(constant)) for constant in _constant_parts(expr)):
        raise NotRealError("a number that is not real or past the range of floats")
    for power in expr.atoms(sympy.Pow):
        if power.base.is_Number and power.base.is_negative and not power.exp.is_integer:
            raise NotRealError(f"a power of the negative number {power.base}")
    for function in expr.atoms(sympy.Function, sympy.Derivative, sympy.Subs, sympy.Piecewise):
        if type(function).__name__ not in _SYMPY_FUNCTION_NAMES_COMPILED_TO_NUMPY:
            raise NotRealError(f"{type(function).__name__}(...)")


def _constant_parts(expr: Expr) -> Iterator[Expr]:
    """Yield the largest parts of an expression that contain no symbols."""
    parts = sympy.preorder_traversal(expr)
    for part in parts:
        if not part.free_symbols:
            yield part
            parts.skip()
