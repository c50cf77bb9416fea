"""The compiled kernels of `integrate`: a slab's increments and their prefix products, and the sums of psi.

Imported with Numba, that is only when the first compiled kernel is asked for.
"""

from __future__ import annotations

import math
from types import FunctionType
from typing import Any

from numba.extending import register_jitable

from hingepair.equations import spatial as equations
from hingepair.integration import increments
from hingepair.integration.euler_steps import rates, runge_kutta
from hingepair.integration.prefix_product import RADIX
from hingepair.numeric import compensated, twofold

for _module in (equations, increments, twofold, compensated):
    for _function in vars(_module).values():
        if isinstance(_function, FunctionType) and _function.__module__ == _module.__name__:
            register_jitable(_function)
register_jitable(rates)

__all__ = ["place", "runge_kutta", "sums", "turns"]

_SMALL = 0.0625  # of x^2: up to here six terms of the series are exact to the last bit


@register_jitable
def _terms(x2: float) -> Any:
    """(sin x / x, cos x) from x^2."""
    if x2 <= _SMALL:
        s = 1 - x2 / 6 * (1 - x2 / 20 * (1 - x2 / 42 * (1 - x2 / 72 * (1 - x2 / 110 * (1 - x2 / 156)))))
        c = 1 - x2 / 2 * (1 - x2 / 12 * (1 - x2 / 30 * (1 - x2 / 56 * (1 - x2 / 90 * (1 - x2 / 132)))))
        return s, c
    x = math.sqrt(x2)
    return math.sin(x) / x, math.cos(x)


@register_jitable
def _exp(Omega: Any) -> Any:
    return increments.quaternion_exp(Omega, _terms(increments.half_turn(Omega)))


@register_jitable
def _three(rows: Any, k: int, i: int) -> Any:
    return rows[k, i, 0], rows[k, i, 1], rows[k, i, 2]


@register_jitable
def _four(rows: Any, k: int) -> Any:
    return rows[k, 0], rows[k, 1], rows[k, 2], rows[k, 3]


@register_jitable
def _write(rows: Any, k: int, q: Any) -> None:
    for i in range(4):
        rows[k, i] = q[i]


@register_jitable
def _unit(q: Any) -> Any:
    w, x, y, z = q
    f = 1 / math.sqrt(w * w + x * x + y * y + z * z)
    return w * f, x * f, y * f, z * f


@register_jitable
def _later(rows: Any, k: int, earlier: int) -> None:
    """Element k after an earlier one: a product of quaternions (four columns) or a sum of pairs (two)."""
    if rows.shape[1] == 4:
        _write(rows, k, increments.quaternion_product(_four(rows, k), _four(rows, earlier)))
    else:
        high, low = compensated.pair_sum((rows[earlier, 0], rows[earlier, 1]), (rows[k, 0], rows[k, 1]))
        rows[k, 0] = high
        rows[k, 1] = low


@register_jitable
def _scan(rows: Any) -> None:
    """`prefix_product.scan`, level by level: the elements of a level end at the multiples of its stride."""
    stride = 1
    while stride < len(rows):
        for i in range(len(rows) // stride):
            if i % RADIX != 0:
                _later(rows, (i + 1) * stride - 1, i * stride - 1)
        stride *= RADIX
    while stride > 1:
        stride //= RADIX
        for i in range(RADIX, len(rows) // stride):
            if i % RADIX != RADIX - 1:
                _later(rows, (i + 1) * stride - 1, (i - i % RADIX) * stride - 1)


def turns(omega: Any, h: Any, rule: int, rows: Any) -> None:
    """The products of a slab's first rotations.

    Args:
        omega: at the nodes of each step, shape (steps, nodes, 3).
        h: the steps, shape (steps,).
        rule: 0 midpoint, 1 magnus4, 2 magnus6, 3 two exponentials, 4 Runge-Kutta.
        rows: where the quaternions go, shape (steps, 4).
    """
    for k in range(len(h)):
        w1 = _three(omega, k, 0)
        if rule == 0:
            q = _exp(increments.midpoint(w1, h[k]))
        elif rule == 1:
            q = _exp(increments.magnus4(w1, _three(omega, k, 1), h[k]))
        elif rule == 2:
            q = _exp(increments.magnus6(w1, _three(omega, k, 1), _three(omega, k, 2), h[k]))
        elif rule == 3:
            first, second = increments.two_exponentials(w1, _three(omega, k, 1), h[k])
            q = increments.quaternion_product(_exp(second), _exp(first))
        else:
            q = _unit(increments.runge_kutta4(w1, _three(omega, k, 1), _three(omega, k, 2), h[k]))
        _write(rows, k, q)
    _scan(rows)


def place(rows: Any, carry: Any) -> None:
    """The rotations of a slab after the one before it, at unit length."""
    q = (carry[0], carry[1], carry[2], carry[3])
    for k in range(len(rows)):
        _write(rows, k, increments.quaternion_unit(increments.quaternion_product(_four(rows, k), q)))


def sums(psid: Any, high: Any, low: Any, rule: int, rows: Any) -> None:
    """The sums of a slab's first integrals of psi'.

    Args:
        psid: at the nodes of each step, shape (steps, nodes).
        high: the steps as sums of two doubles, shape (steps,).
        low: what is to be added to them.
        rule: as for `turns`.
        rows: where the sums go, as sums of two doubles, shape (steps, 2).
    """
    for k in range(len(high)):
        step = (high[k], low[k])
        count = psid.shape[1]
        if count == 1:
            pair = compensated.one_node(psid[k, 0], step)
        elif count == 2:
            pair = compensated.two_nodes(psid[k, 0], psid[k, 1], step)
        elif rule == 2:
            pair = compensated.three_nodes(psid[k, 0], psid[k, 1], psid[k, 2], 5.0, 8.0, step)
        else:
            pair = compensated.three_nodes(psid[k, 0], psid[k, 1], psid[k, 2], 1.0, 4.0, step)
        rows[k, 0] = pair[0]
        rows[k, 1] = pair[1]
    _scan(rows)
