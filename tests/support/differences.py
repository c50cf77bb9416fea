"""Motions in many digits: rates are differences, rotations products of turns, and bodies clouds of points."""

from __future__ import annotations

import mpmath
from mpmath import mpf

STEP = mpf(10) ** -15
SMALL = mpf(10) ** -24
SEQUENCE_NAMES = {"tait_bryan": (0, 1, 2), "proper_euler": (0, 1, 0)}


def vector(seed, size=3):
    """Numbers of order one, as tuples."""
    return tuple(mpf((seed * 7919 + i * 104729) % 2003) / 1001 - 1 for i in range(1, size + 1))


def matrix(entries, columns=3):
    entries = list(entries)
    return mpmath.matrix([entries[i : i + columns] for i in range(0, len(entries), columns)])


def tuple_of(m):
    return tuple(m[i, j] for i in range(m.rows) for j in range(m.cols))


def hat(w):
    return mpmath.matrix([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def vee(W):
    """The vector of the antisymmetric part."""
    return (W[2, 1] - W[1, 2]) / 2, (W[0, 2] - W[2, 0]) / 2, (W[1, 0] - W[0, 1]) / 2


def turn(axis, angle):
    """The rotation about a unit axis; see `test_a_turn_is_an_exponential`."""
    W = hat(axis)
    return mpmath.eye(3) + mpmath.sin(angle) * W + (1 - mpmath.cos(angle)) * (W * W)


def unit(n):
    return tuple(part / mpmath.norm(n) for part in n)


def at(parts, s):
    """A polynomial motion: value, rate and second derivative at s = 0."""
    return [x + v * s + a * s * s / 2 for x, v, a in zip(*parts, strict=True)]


def rate(f, order=1):
    """The derivative of a matrix or a number by s, at s = 0."""
    if order == 1:
        return (f(STEP) - f(-STEP)) / (2 * STEP)
    return (f(STEP) - 2 * f(mpf(0)) + f(-STEP)) / STEP**2


def column(v):
    return mpmath.matrix(list(v))


def same(got, expected):
    got, expected = list(got), list(expected)
    assert len(got) == len(expected)
    for x, y in zip(got, expected, strict=True):
        assert abs(x - y) <= SMALL * (1 + abs(y)), (mpmath.nstr(x, 12), mpmath.nstr(y, 12))


class Body:
    """A motion of one body: R and Euler angles as polynomials."""

    def __init__(self, seed, kind="tait_bryan"):
        self.points = [vector(seed), vector(seed + 1), vector(seed + 2)]
        self.angles = [vector(seed + 3), vector(seed + 4), vector(seed + 5)]
        self.kind = kind

    def R(self, s=0):
        return column(at(self.points, s))

    def S(self, s=0):
        found = mpmath.eye(3)
        for axis, angle in zip(SEQUENCE_NAMES[self.kind], at(self.angles, s), strict=True):
            found *= turn([int(i == axis) for i in range(3)], angle)
        return found

    def omega(self, s=0):
        return column(vee(rate(lambda h: self.S(s + h)) * self.S(s).T))

    @property
    def alpha(self):
        return column(vee(rate(self.S, 2) * self.S().T))  # of S'' S^T = [alpha]x + [omega]x^2
