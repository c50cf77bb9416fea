"""Antiderivatives of the simplest expressions in t, by rule: SymPy's own search for one may take for ever."""

from __future__ import annotations

from hingepair.symbolic.jets import Expr, time_symbol


def antiderivative(expr: Expr) -> Expr | None:
    """The antiderivative of a sum of constants times t^k, sin, cos or exp of a t + b; None of anything else.

    >>> t = time_symbol()
    >>> antiderivative(3 * t**2 + 2)
    t**3 + 2*t
    >>> antiderivative(1 / (1 + t**2)) is None
    True
    """
    import sympy

    parts = [_of_term(term) for term in sympy.Add.make_args(expr)]
    return None if None in parts else sympy.Add(*parts)


def _of_term(term: Expr) -> Expr | None:
    import sympy

    t = time_symbol()
    factor, rest = term.as_independent(t, as_Add=False)
    if not rest.has(t):
        return term * t
    base, power = rest.as_base_exp()
    if base == t and power.is_Integer and power >= 0:
        return factor * t ** (power + 1) / (power + 1)
    turned = {sympy.sin: lambda x: -sympy.cos(x), sympy.cos: sympy.sin, sympy.exp: sympy.exp}.get(rest.func)
    if turned is None:
        return None
    rate = _slope(rest.args[0])
    return None if rate is None else factor * turned(rest.args[0]) / rate


def _slope(argument: Expr) -> Expr | None:
    """The a of a t + b, which does not vanish; None of anything else."""
    import sympy

    t = time_symbol()
    rate = sympy.Integer(0)
    for part in sympy.Add.make_args(argument):
        factor, rest = part.as_independent(t, as_Add=False)
        if rest == t:
            rate += factor
        elif rest.has(t):
            return None
    return None if rate.is_zero is not False else rate
