"""One-step methods of integration from rates (E12): their quadrature nodes, and the rotation of a step.

S' = [omega]x S, so S(t + h) = exp([Omega]x) S(t), and Omega is a series in commutators; those of [a]x and [b]x are
[a x b]x. The rules with Gauss nodes are Magnus terms (Blanes, Casas, Ros: two nodes, order 4; three nodes, order 6)
and the commutator-free product of two exponentials (Celledoni, Marthinsen, Owren). Strapdown navigation knows the
same terms as multi-sample coning corrections (Bortz; Miller; Savage), with samples in place of nodes.

A rotation is a quaternion (w, x, y, z). As in `equations`, a scalar is any value that adds and multiplies.
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
from hingepair.numeric.twofold import HighLow, exact_product, twofold_product, twofold_quotient, twofold_sum

Quaternion: TypeAlias = tuple[Scalar, Scalar, Scalar, Scalar]

_SQRT_3 = 1.7320508075688772  # square root of 3
_SQRT_15 = 3.872983346207417  # square root of 15
_GAUSS2_NODE, _GAUSS3_NODE = 0.5 - _SQRT_3 / 6, 0.5 - _SQRT_15 / 10  # first of 2 and of 3 Gauss nodes on [0, 1]


def quaternion_product(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the product p q of quaternions (w, x, y, z) as a tuple: the rotation q followed by the rotation p."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - (b * x + c * y + d * z),
        (a * x + b * w) + (c * z - d * y),
        (a * y + c * w) + (d * x - b * z),
        (a * z + d * w) + (b * y - c * x),
    )


def quaternion_unit(q: Quaternion) -> Quaternion:
    """Return a quaternion (w, x, y, z) whose norm is nearly 1 as a tuple, normalised by one Newton step for the
    inverse square root.
    """
    w, x, y, z = q
    f = 1.5 - 0.5 * ((w * w + x * x) + (y * y + z * z))
    return w * f, x * f, y * f, z * f


def quaternion_exp(Omega: Vector) -> Quaternion:
    """Return the unit quaternion (w, x, y, z) of a rotation vector Omega [rad] as a tuple. The components of Omega
    are floats or traced values.
    """
    square = 0.25 * dot(Omega, Omega)
    if square == 0:  # a float; a traced value never compares equal to 0
        return 1.0, *scale(Omega, 0.5)
    half = square_root(square)
    f = where_less(0.0, square, 0.5 * sine(half) / half, 0.5)
    return cosine(half), Omega[0] * f, Omega[1] * f, Omega[2] * f


def magnus4(w1: Vector, w2: Vector, h: Scalar) -> Vector:
    """Return the rotation vector Omega [rad] of a Magnus step of length h as a tuple, from omega at two Gauss nodes
    (w1, w2); order 4.
    """
    return subtract(scale(add(w1, w2), 0.5 * h), scale(cross(w1, w2), h * h * (_SQRT_3 / 12)))


def magnus6(w1: Vector, w2: Vector, w3: Vector, h: Scalar) -> Vector:
    """Return the rotation vector Omega [rad] of a Magnus step of length h as a tuple, from omega at three Gauss nodes
    (w1, w2, w3); order 6.

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


def two_exponentials(w1: Vector, w2: Vector, h: Scalar) -> tuple[Vector, Vector]:
    """Return the pair of the rotation vectors [rad] of the first and the second rotation of a commutator-free step of
    length h, from omega at two Gauss nodes (w1, w2); order 4.
    """
    a, b = h * (0.25 + _SQRT_3 / 6), h * (0.25 - _SQRT_3 / 6)
    return add(scale(w1, a), scale(w2, b)), add(scale(w1, b), scale(w2, a))


def runge_kutta4(w1: Vector, w2: Vector, w3: Vector, h: Scalar) -> Quaternion:
    """Return the quaternion (w, x, y, z) of a Runge-Kutta step of length h of q' = omega q / 2 as a tuple, from omega
    at the start (w1), the middle (w2) and the end (w3) of the step; order 4. The quaternion is not normalised.

    The step is linear in q, so it is a quaternion that multiplies q; its norm is 1 only approximately.
    """
    k1 = (0.0, *scale(w1, 0.5 * h))
    k2 = _runge_kutta_stage(w2, k1, h, 0.5)
    k3 = _runge_kutta_stage(w2, k2, h, 0.5)
    k4 = _runge_kutta_stage(w3, k3, h, 1.0)
    sixth = 1 / 6
    return (
        1 + sixth * (k1[0] + 2 * (k2[0] + k3[0]) + k4[0]),
        sixth * (k1[1] + 2 * (k2[1] + k3[1]) + k4[1]),
        sixth * (k1[2] + 2 * (k2[2] + k3[2]) + k4[2]),
        sixth * (k1[3] + 2 * (k2[3] + k3[3]) + k4[3]),
    )


def _runge_kutta_stage(w: Vector, k: Quaternion, h: Scalar, part: float) -> Quaternion:
    """Return h times the derivative of the quaternion at a Runge-Kutta stage, a tuple: the product of the quaternions
    h omega / 2 and 1 + part k. `w` is omega at the stage, `k` the result of the stage before, and `part` the fraction
    of the step at the stage.
    """
    return quaternion_product((0.0, *scale(w, 0.5 * h)), (1 + part * k[0], part * k[1], part * k[2], part * k[3]))


def _exponential_of(Omega: Callable[..., Vector]) -> Callable[..., Quaternion]:
    """Return a function that takes omega at the nodes and the step length, and returns the unit quaternion exp(Omega)
    of a step. `Omega` is a function of the same arguments that returns the rotation vector.
    """
    return lambda *rates_and_length: quaternion_exp(Omega(*rates_and_length))


def _two_exponential_rotation(*rates_and_length: Any) -> Quaternion:
    """Return the unit quaternion of a commutator-free step, the product of two exponentials, from omega at two Gauss
    nodes and the step length.
    """
    first, second = two_exponentials(*rates_and_length)
    return quaternion_product(quaternion_exp(second), quaternion_exp(first))


def _runge_kutta_rotation(*rates_and_length: Any) -> Quaternion:
    """Return the unit quaternion of a Runge-Kutta step, from omega at start, middle and end, and the step length."""
    q = runge_kutta4(*rates_and_length)
    f = 1 / square_root((q[0] * q[0] + q[1] * q[1]) + (q[2] * q[2] + q[3] * q[3]))
    return q[0] * f, q[1] * f, q[2] * f, q[3] * f


class StepRule(NamedTuple):
    """One-step integration method: name, order, nodes and weights of the rates, and the function of the rotation. The
    function returns the quaternion of a step from omega at the nodes and the length of the step.
    """

    name: str
    order: int  # the error of the integral goes as h^order
    nodes: tuple[float, ...]  # where a step evaluates omega and psi', as fractions of the step
    weights: tuple[int, ...]  # of the nodes in an integral, to be divided by their sum
    rotation: Callable[..., Quaternion]  # of a step, from omega at the nodes and the length of the step

    def integral(self, values: Any, h: Any) -> Any:
        """Return the integrals of a quantity over steps of lengths h, shape (steps, columns). `values` are the
        quantity at the nodes of the steps, shape (steps, nodes, ...).
        """
        columns = values.reshape(len(h), len(self.nodes), -1)
        return h[:, None] * np.einsum("n,snk->sk", np.array(self.weights) / sum(self.weights), columns)


# Rules of one-step methods by name.
STEP_RULE_BY_NAME: Final = {
    rule.name: rule
    for rule in (
        StepRule("magnus6", 6, (_GAUSS3_NODE, 0.5, 1 - _GAUSS3_NODE), (5, 8, 5), _exponential_of(magnus6)),
        StepRule("magnus4", 4, (_GAUSS2_NODE, 1 - _GAUSS2_NODE), (1, 1), _exponential_of(magnus4)),
        StepRule("cf4", 4, (_GAUSS2_NODE, 1 - _GAUSS2_NODE), (1, 1), _two_exponential_rotation),
        StepRule("midpoint", 2, (0.5,), (1,), _exponential_of(scale)),
        StepRule("rk4_quaternion", 4, (0.0, 0.5, 1.0), (1, 4, 1), _runge_kutta_rotation),
    )
}


@functools.cache
def rotation_loop(rule: StepRule) -> Loop:
    """Return the cached `Loop` that computes the quaternions (w, x, y, z) of steps by a rule, from omega at the nodes
    and the step length h. For omega in body axes, h must be negated; the quaternions are then those of the inverse
    rotations.
    """

    def step(v: dict[str, Any]) -> dict[str, Any]:
        """Return the quaternion of one step as {"q": ...}; `v` is a dict of omega at the nodes and the length h."""
        w = v["omega"]
        return {"q": rule.rotation(*(w[i : i + 3] for i in range(0, len(w), 3)), v["h"])}

    return Loop(f"turns_{rule.name}", step, {"omega": (len(rule.nodes), 3), "h": ()}, {"q": (4,)})


@functools.cache
def angle_loop(rule: StepRule) -> Loop:
    """Return the cached `Loop` that integrates a scalar rate over each step by a rule, from the rate at the nodes and
    the step length h. The step length and the integral are sums of two doubles.
    """

    def step(v: dict[str, Any]) -> dict[str, Any]:
        """Return the integral of the rate over one step as {"sum": two doubles}. `v` is a dict of the rate at the
        nodes and the step length h, two doubles.
        """
        weighted = [_weighted(p, w) for p, w in zip(v["rate"], rule.weights, strict=True)]
        total = functools.reduce(twofold_sum, weighted)
        mean = twofold_quotient(total, float(sum(rule.weights))) if len(weighted) > 1 else total
        return {"sum": twofold_product(mean, v["h"])}

    return Loop(f"rises_{rule.name}", step, {"rate": (len(rule.nodes),), "h": (2,)}, {"sum": (2,)}, exact=True)


def _weighted(p: Scalar, weight: int) -> HighLow:
    """Return a rate p times an integer weight exactly, as a sum of two doubles."""
    return (p, 0.0) if weight == 1 else exact_product(p, float(weight))
