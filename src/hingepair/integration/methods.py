"""The methods that make each step from the rates alone (E12): which nodes they look at, and what they make of them.

S' = [omega]x S, so S(t + h) = exp([Omega]x) S(t), and Omega is a series in commutators; those of [a]x and [b]x are
[a x b]x. The rules with Gauss nodes are Magnus terms (Blanes, Casas, Ros: two nodes, order 4; three nodes, order 6)
and the commutator-free product of two exponentials (Celledoni, Marthinsen, Owren). Strapdown navigation knows the
same terms as multi-sample coning corrections (Bortz; Miller; Savage), with samples in the place of nodes.

A rotation is a quaternion (w, x, y, z). As in `equations`, a scalar is whatever adds and multiplies.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from hingepair.engine.loops import Loop
from hingepair.engine.trace import square_root, where_less
from hingepair.equations.spatial import Scalar, Vector, add, cross, dot, scale, subtract
from hingepair.numeric.blocks import cosine, sine
from hingepair.numeric.twofold import HighLow, exact_product, pair_product, pair_quotient, pair_sum

Quaternion: TypeAlias = tuple[Scalar, Scalar, Scalar, Scalar]

_ROOT_3 = 1.7320508075688772
_ROOT_15 = 3.872983346207417
_A, _B = 0.5 - _ROOT_3 / 6, 0.5 - _ROOT_15 / 10


def quaternion_product(p: Quaternion, q: Quaternion) -> Quaternion:
    """The rotation q, then the rotation p."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - (b * x + c * y + d * z),
        (a * x + b * w) + (c * z - d * y),
        (a * y + c * w) + (d * x - b * z),
        (a * z + d * w) + (b * y - c * x),
    )


def quaternion_unit(q: Quaternion) -> Quaternion:
    """A quaternion whose length is nearly 1 at that length: one Newton step for the root."""
    w, x, y, z = q
    f = 1.5 - 0.5 * ((w * w + x * x) + (y * y + z * z))
    return w * f, x * f, y * f, z * f


def quaternion_exp(Omega: Vector) -> Quaternion:
    """The rotation of a rotation vector; a scalar is a float or traced."""
    square = 0.25 * dot(Omega, Omega)
    if square == 0:  # a number: what is traced is not known
        return 1.0, *scale(Omega, 0.5)
    half = square_root(square)
    f = where_less(0.0, square, 0.5 * sine(half) / half, 0.5)
    return cosine(half), Omega[0] * f, Omega[1] * f, Omega[2] * f


def magnus4(w1: Vector, w2: Vector, h: Scalar) -> Vector:
    """Omega from omega at two Gauss nodes, order 4."""
    return subtract(scale(add(w1, w2), 0.5 * h), scale(cross(w1, w2), h * h * (_ROOT_3 / 12)))


def magnus6(w1: Vector, w2: Vector, w3: Vector, h: Scalar) -> Vector:
    """Omega from omega at three Gauss nodes, order 6.

    a1, a2, a3 are h times omega in the middle, its first and its second difference; then
    Omega = a1 + a3/12 + [-20 a1 - a3 + c1, a2 + c2] / 240, c1 = [a1, a2], c2 = -[a1, 2 a3 + c1] / 60.
    """
    a1 = scale(w2, h)
    a2 = scale(subtract(w3, w1), h * (_ROOT_15 / 3))
    a3 = scale(subtract(subtract(w3, w2), subtract(w2, w1)), h * (10 / 3))
    c1 = cross(a1, a2)
    c2 = scale(cross(a1, add(scale(a3, 2), c1)), -1 / 60)
    outer = cross(subtract(c1, add(scale(a1, 20), a3)), add(a2, c2))
    return add(a1, add(scale(a3, 1 / 12), scale(outer, 1 / 240)))


def two_exponentials(w1: Vector, w2: Vector, h: Scalar) -> tuple[Vector, Vector]:
    """Two rotation vectors, first and second, whose rotations make the step, order 4, from two Gauss nodes."""
    a, b = h * (0.25 + _ROOT_3 / 6), h * (0.25 - _ROOT_3 / 6)
    return add(scale(w1, a), scale(w2, b)), add(scale(w1, b), scale(w2, a))


def runge_kutta4(w1: Vector, w2: Vector, w3: Vector, h: Scalar) -> Quaternion:
    """The classical Runge-Kutta step for q' = omega q / 2, omega at start, middle and end, order 4.

    It is linear in q, so the step is a factor; its length is not yet 1.
    """
    k1 = (0.0, *scale(w1, 0.5 * h))
    k2 = _stage(w2, k1, h, 0.5)
    k3 = _stage(w2, k2, h, 0.5)
    k4 = _stage(w3, k3, h, 1.0)
    sixth = 1 / 6
    return (
        1 + sixth * (k1[0] + 2 * (k2[0] + k3[0]) + k4[0]),
        sixth * (k1[1] + 2 * (k2[1] + k3[1]) + k4[1]),
        sixth * (k1[2] + 2 * (k2[2] + k3[2]) + k4[2]),
        sixth * (k1[3] + 2 * (k2[3] + k3[3]) + k4[3]),
    )


def _stage(w: Vector, k: Quaternion, h: Scalar, part: float) -> Quaternion:
    """The quaternion h omega / 2 times (1 + part k)."""
    return quaternion_product((0.0, *scale(w, 0.5 * h)), (1 + part * k[0], part * k[1], part * k[2], part * k[3]))


def _by_one(Omega: Callable[..., Vector]) -> Callable[..., Quaternion]:
    return lambda *given: quaternion_exp(Omega(*given))


def _by_two(*given: Any) -> Quaternion:
    first, second = two_exponentials(*given)
    return quaternion_product(quaternion_exp(second), quaternion_exp(first))


def _by_runge_kutta(*given: Any) -> Quaternion:
    q = runge_kutta4(*given)
    f = 1 / square_root((q[0] * q[0] + q[1] * q[1]) + (q[2] * q[2] + q[3] * q[3]))
    return q[0] * f, q[1] * f, q[2] * f, q[3] * f


class Rule(NamedTuple):
    """A method that makes each step from omega alone."""

    name: str
    order: int  # of the error against h
    nodes: tuple[float, ...]  # where a step looks at omega and psi', as parts of the step
    weights: tuple[int, ...]  # of the nodes in an integral, integers
    turn: Callable[..., Quaternion]  # the rotation of a step, from omega at the nodes and the step's length

    def integral(self, values: Any, h: Any) -> Any:
        """The integrals over steps of lengths h from values at their nodes (steps, nodes, ...), by columns."""
        columns = values.reshape(len(h), len(self.nodes), -1)
        return h[:, None] * np.einsum("n,snk->sk", np.array(self.weights) / sum(self.weights), columns)


RULES: Final = {
    rule.name: rule
    for rule in (
        Rule("magnus6", 6, (_B, 0.5, 1 - _B), (5, 8, 5), _by_one(magnus6)),
        Rule("magnus4", 4, (_A, 1 - _A), (1, 1), _by_one(magnus4)),
        Rule("cf4", 4, (_A, 1 - _A), (1, 1), _by_two),
        Rule("midpoint", 2, (0.5,), (1,), _by_one(scale)),
        Rule("rk4_quaternion", 4, (0.0, 0.5, 1.0), (1, 4, 1), _by_runge_kutta),
    )
}


@functools.cache
def turns(rule: Rule) -> Loop:
    """The rotations q of steps, from omega at the nodes of each and its length h, negative in body axes."""

    def step(v: dict[str, Any]) -> dict[str, Any]:
        w = v["omega"]
        return {"q": rule.turn(*(w[i : i + 3] for i in range(0, len(w), 3)), v["h"])}

    return Loop(f"turns_{rule.name}", step, {"omega": (len(rule.nodes), 3), "h": ()}, {"q": (4,)})


@functools.cache
def rises(rule: Rule) -> Loop:
    """The integrals of a rate over steps from its values at the nodes; lengths and integrals are pairs."""

    def step(v: dict[str, Any]) -> dict[str, Any]:
        weighted = [_times(p, w) for p, w in zip(v["rate"], rule.weights, strict=True)]
        total = functools.reduce(pair_sum, weighted)
        mean = pair_quotient(total, float(sum(rule.weights))) if len(weighted) > 1 else total
        return {"sum": pair_product(mean, v["h"])}

    return Loop(f"rises_{rule.name}", step, {"rate": (len(rule.nodes),), "h": (2,)}, {"sum": (2,)}, exact=True)


def _times(p: Scalar, weight: int) -> HighLow:
    return (p, 0.0) if weight == 1 else exact_product(p, float(weight))
