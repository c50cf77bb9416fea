"""The step of integration from rates (E12): its quadrature nodes, its integral and its rotation.

S' = [omega]x S, so S(t + h) = exp([Omega]x) S(t), and Omega is a Magnus series in commutators; those of [a]x and
[b]x are [a x b]x (Blanes, Casas, Ros: three Gauss nodes, order 6). Strapdown navigation knows the same terms as
multi-sample coning corrections (Bortz; Miller; Savage), with samples in place of nodes.

A rotation is a quaternion (w, x, y, z). As in `equations`, a scalar is any value that adds and multiplies.
"""

from __future__ import annotations

import functools
from typing import Any, Final, TypeAlias

import numpy as np

from hingepair.engine.loops import Loop
from hingepair.engine.trace import square_root, where_less
from hingepair.equations.spatial import Scalar, Vector, add, cross, dot, scale, subtract
from hingepair.numeric.blocks import cosine, sine
from hingepair.numeric.twofold import exact_product, twofold_product, twofold_quotient, twofold_sum

Quaternion: TypeAlias = tuple[Scalar, Scalar, Scalar, Scalar]

_SQRT_15 = 3.872983346207417
NODES: Final = (0.5 - _SQRT_15 / 10, 0.5, 0.5 + _SQRT_15 / 10)  # Gauss nodes, as fractions of a step
_WEIGHTS = (5, 8, 5)  # of the nodes in an integral, to be divided by their sum
ORDER: Final = 6  # the error of the integral goes as h^ORDER


def quaternion_product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the product p q of quaternions: the rotation q followed by the rotation p."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - (b * x + c * y + d * z),
        (a * x + b * w) + (c * z - d * y),
        (a * y + c * w) + (d * x - b * z),
        (a * z + d * w) + (b * y - c * x),
    )


def quaternion_unit(q: Quaternion) -> Quaternion:
    """Return a quaternion of nearly unit norm, normalised by one Newton step for the inverse square root."""
    w, x, y, z = q
    f = 1.5 - 0.5 * ((w * w + x * x) + (y * y + z * z))
    return w * f, x * f, y * f, z * f


def quaternion_exp(Omega: Vector) -> Quaternion:
    """Return the unit quaternion of a rotation vector Omega [rad], of floats or traced values."""
    square = 0.25 * dot(Omega, Omega)
    if square == 0:  # a float; a traced value never compares equal to 0
        return 1.0, *scale(Omega, 0.5)
    half = square_root(square)
    f = where_less(0.0, square, 0.5 * sine(half) / half, 0.5)
    return cosine(half), Omega[0] * f, Omega[1] * f, Omega[2] * f


def magnus6(w1: Vector, w2: Vector, w3: Vector, h: Scalar) -> Vector:
    """Return the rotation vector Omega [rad] of a step of length h, from omega at three Gauss nodes; order 6.

    a1, a2 and a3 are h times omega at the middle node and times its first and second difference:
    Omega = a1 + a3/12 + [-20 a1 - a3 + c1, a2 + c2] / 240, c1 = [a1, a2], c2 = -[a1, 2 a3 + c1] / 60.
    """
    a1 = scale(w2, h)
    a2 = scale(subtract(w3, w1), h * (_SQRT_15 / 3))
    a3 = scale(subtract(subtract(w3, w2), subtract(w2, w1)), h * (10 / 3))
    c1 = cross(a1, a2)
    c2 = scale(cross(a1, add(scale(a3, 2), c1)), -1 / 60)
    outer = cross(subtract(c1, add(scale(a1, 20), a3)), add(a2, c2))
    return add(a1, add(scale(a3, 1 / 12), scale(outer, 1 / 240)))


def step_integrals(values: Any, h: Any) -> Any:
    """Return the integrals (steps, columns) over steps of lengths h of a quantity whose `values` at the nodes have
    the shape (steps, nodes, ...).
    """
    columns = values.reshape(len(h), len(NODES), -1)
    return h[:, None] * np.einsum("n,snk->sk", np.array(_WEIGHTS) / sum(_WEIGHTS), columns)


@functools.cache
def rotation_loop() -> Loop:
    """Return the `Loop` that computes the quaternions of steps from omega at the nodes and the step length h. For
    omega in body axes, h is to be negated; the quaternions are then those of the inverse rotations.
    """

    def step(v: dict[str, Any]) -> dict[str, Any]:
        w = v["omega"]
        return {"q": quaternion_exp(magnus6(w[:3], w[3:6], w[6:], v["h"]))}

    return Loop("turns_magnus6", step, {"omega": (len(NODES), 3), "h": ()}, {"q": (4,)})


@functools.cache
def angle_loop() -> Loop:
    """Return the `Loop` that integrates a scalar rate over each step, from the rate at the nodes and the step length
    h. The step length and the integral are sums of two doubles.
    """

    def step(v: dict[str, Any]) -> dict[str, Any]:
        weighted = [exact_product(p, float(weight)) for p, weight in zip(v["rate"], _WEIGHTS, strict=True)]
        total = functools.reduce(twofold_sum, weighted)
        return {"sum": twofold_product(twofold_quotient(total, float(sum(_WEIGHTS))), v["h"])}

    return Loop("rises_magnus6", step, {"rate": (len(NODES),), "h": (2,)}, {"sum": (2,)}, exact=True)
