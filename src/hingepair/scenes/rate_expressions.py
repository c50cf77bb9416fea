"""Motion by rates that are expressions in t.

[motion]
omega1 = ["0.1*sin(t)", 0, "w"]  # rad/s; in a planar scene one number or expression
psi_dot = "0.5*cos(t)"           # rad/s
x = "3*t"                        # and y, z, m; 0 unless given
S1_0 = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]  # optional: attitude of body 1 at the start; in a planar scene phi_0, rad
psi_0 = 0.2                      # optional, rad
frame = "body"                   # optional: the axes of omega1, "world" unless given; not in a planar scene
method = "magnus6"               # optional, as for `integrate`
tol = 1e-12                      # optional: largest error, rad; what is not reached is refused
[motion.constants]               # optional
w = 1.5
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from hingepair.integration.signals import Function
from hingepair.scenes.expression_motion import check_real_values, read_constants, read_expression, read_instants
from hingepair.scenes.integrated_motion import (
    START,
    Float64Array,
    IntegratedMotion,
    integrated_in_plane,
    integrated_in_space,
)
from hingepair.scenes.tables import Table
from hingepair.symbolic.antiderivative import antiderivative
from hingepair.symbolic.jets import Expr
from hingepair.symbolic.time_functions import Coordinates, compile_coordinates, exact

TOLERANCE: Final = 1e-12
"""Largest error of the angles that is aimed at unless `tol` is given [rad]; what is left is reported."""

_OMEGA: Final = ("omega1[0]", "omega1[1]", "omega1[2]")


def read_rate_expressions(table: Table, time: Table, planar: bool) -> IntegratedMotion:
    """The motion whose rates the table [motion] has as expressions.

    Where psi_dot (and in the plane omega1) has an antiderivative that a rule knows, the angle is exact.

    Raises:
        SceneError: a value cannot be used; names file, table and key.
    """
    table.check_keys((*START, "tol", "omega1", "psi_dot", "constants", *_own_keys(planar)))
    t, constants = read_instants(time), read_constants(table)
    axes, omega_keys = ("x", "y", "z")[: 2 if planar else 3], ("omega1",) if planar else _OMEGA
    source = table if planar else _entries(table, "omega1")
    turning = tuple(read_expression(source, key, constants) for key in omega_keys)
    hinge = (read_expression(table, "psi_dot", constants),)
    point = tuple(read_expression(table, key, constants) if key in table.values else exact(0) for key in axes)
    check_real_values(table, (*omega_keys, "psi_dot", *axes), (*turning, *hinge, *point))
    known = dict(zip(("R1", "v1", "a1"), _columns(point, t, 2), strict=True))
    known |= dict(zip(("omega1", "alpha1"), _columns(turning, t, 1), strict=True))
    known |= dict(zip(("psid", "psidd"), (column[:, 0] for column in _columns(hinge, t, 1)), strict=True))
    if planar:
        known |= {name: known[name][:, 0] for name in ("omega1", "alpha1")}
    for name, rate in (("psi", hinge), *((("phi", turning),) if planar else ())):
        whole = antiderivative(rate[0])
        if whole is not None:
            known[name] = _columns((whole,), t, 0)[0][:, 0]
    tol = table.number("tol") if "tol" in table.values else TOLERANCE
    signals = _signal("omega1", turning, planar), _signal("psi_dot", hinge, True)
    return (integrated_in_plane if planar else integrated_in_space)(table, t, signals, known, tol)


def _own_keys(planar: bool) -> tuple[str, ...]:
    return ("x", "y", "phi_0") if planar else ("x", "y", "z", "S1_0", "frame")


def _signal(name: str, expressions: tuple[Expr, ...], single: bool) -> Function:
    def values(times: Float64Array) -> Float64Array:
        columns = _columns(expressions, times, 0)[0]
        return columns[:, 0] if single else columns

    return Function(name, values, () if single else (3,))


def _entries(table: Table, key: str) -> Table:
    """The three entries of a list, by the names omega1[0], ..."""
    values = table.values.get(key)
    if not isinstance(values, list) or len(values) != 3:
        table.fail(key, "three numbers or expressions in t")
    return Table(table.file, table.name, {f"{key}[{i}]": value for i, value in enumerate(values)})


def _columns(expressions: tuple[Expr, ...], t: Float64Array, order: int) -> list[Float64Array]:
    """Values and derivatives of expressions, shape (N, k) each."""
    derivatives = _compiled(expressions, order)(t)
    return [np.stack([np.broadcast_to(np.asarray(c, float), t.shape) for c in row], axis=-1) for row in derivatives]


@functools.lru_cache(maxsize=16)
def _compiled(expressions: tuple[Expr, ...], order: int) -> Callable[[ArrayLike], Coordinates]:
    return compile_coordinates(expressions, order)
