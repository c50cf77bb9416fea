"""E12 over one step: the rotation that angular velocities at a few instants make, as plain arithmetic on tuples.

S' = [omega]x S, so S(t + h) = exp([Omega]x) S(t), and Omega is a series in commutators; those of [a]x and [b]x are
[a x b]x. The rules with Gauss nodes are Magnus terms (Blanes, Casas, Ros: two nodes, order 4; three nodes, order 6)
and the commutator-free product of two exponentials (Celledoni, Marthinsen, Owren). Strapdown navigation knows the
same terms as multi-sample coning corrections (Bortz; Miller; Savage), with samples in the place of nodes.

A rotation is a quaternion (w, x, y, z). As in `equations`, a scalar is a float or an array, and sines come in as
values: the same functions are compiled.
"""

from __future__ import annotations

from typing import TypeAlias

from hingepair.equations.spatial import Scalar, Vector, add, cross, dot, scale, subtract

Quaternion: TypeAlias = tuple[Scalar, Scalar, Scalar, Scalar]

_ROOT_3 = 1.7320508075688772
_ROOT_15 = 3.872983346207417


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


def half_turn(Omega: Vector) -> Scalar:
    """The square of half the angle of a rotation vector."""
    return 0.25 * dot(Omega, Omega)


def quaternion_exp(Omega: Vector, terms: tuple[Scalar, Scalar]) -> Quaternion:
    """The rotation of a rotation vector; terms = (sin x / x, cos x) of half its angle."""
    s, c = terms
    f = 0.5 * s
    return c, Omega[0] * f, Omega[1] * f, Omega[2] * f


def midpoint(w1: Vector, h: Scalar) -> Vector:
    """Omega from omega in the middle of the step, order 2."""
    return scale(w1, h)


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
    x, y, z = scale(w1, 0.5 * h)
    k1 = (0 * h, x, y, z)
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
    x, y, z = scale(w, 0.5 * h)
    return quaternion_product((0 * h, x, y, z), (1 + part * k[0], part * k[1], part * k[2], part * k[3]))
