"""The equations are written once: the same functions over floats, NumPy, SymPy, mpmath agree."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
import sympy

from hingepair.equations import spatial as eq

U = 2.0**-53
GROUPS = {"R1": 3, "v1": 3, "a1": 3, "phi": 3, "phid": 3, "phidd": 3, "u1": 3, "u2": 3, "n": 3, "home": 9, "psi": 3}
SIZE = sum(GROUPS.values())
KINDS = ["tait_bryan", "proper_euler"]


def everything(numbers, sin, cos, kind):
    """All outputs of all levels as one flat list, from the flat numbers that GROUPS describes."""
    parts, start = {}, 0
    for name, count in GROUPS.items():
        parts[name] = tuple(numbers[start : start + count])
        start += count
    R1, v1, a1, phi, phid, phidd, u1, u2, n, home, (psi, psid, psidd) = parts.values()
    trig = tuple(f(x) for x in phi for f in (sin, cos))
    half = sin(psi / 2)
    S1 = getattr(eq, f"{kind}_attitude")(trig)
    axes = getattr(eq, f"{kind}_axes")(trig)
    omega1 = eq.angular_velocity1(axes, phid)
    alpha1 = eq.angular_acceleration1(axes, phid, phidd)
    S2 = eq.attitude2(S1, eq.hinge_rotation(n, (sin(psi), 2 * half * half)), home)
    r1, r2, axis = eq.rotate(S1, u1), eq.rotate(S2, u2), eq.rotate(S1, n)
    d = eq.subtract(r1, r2)
    lever_by_psi = eq.cross(axis, r2)
    centripetal = eq.cross(lever_by_psi, axis)
    R2 = eq.position2(R1, d)
    omega2 = eq.angular_velocity2(omega1, axis, psid)
    v2 = eq.velocity2(v1, omega1, d, lever_by_psi, psid)
    alpha2 = eq.angular_acceleration2(alpha1, omega1, axis, psid, psidd)
    relative = eq.relative_acceleration(lever_by_psi, centripetal, psid, psidd)
    a2 = eq.acceleration2(a1, omega1, alpha1, d, lever_by_psi, psid, relative)
    gap = eq.hinge_gap(R1, r1, R2, r2)
    return [*S1, *S2, *d, *R2, *omega1, *omega2, *v2, *alpha1, *alpha2, *a2, *gap, *eq.transpose(S2), eq.dot(u1, u2)]


def samples(count, seed=20):
    numbers = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, SIZE))
    axis = slice(sum(GROUPS[k] for k in list(GROUPS)[:8]), None)
    n = numbers[:, axis][:, :3]
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    return numbers


@pytest.fixture(scope="module", params=KINDS)
def case(request):
    """The kind of sequence, the samples, and what 40-digit numbers give for them."""
    numbers = samples(40)
    with mpmath.workdps(40):
        rows = [everything([mpmath.mpf(x) for x in row], mpmath.sin, mpmath.cos, request.param) for row in numbers]
        truth = np.array([[float(x) for x in row] for row in rows])
    return request.param, numbers, truth


# Every term has a size below 30 here (rates below 2 each, squared, times lever arms below 2 sqrt 3).
TOLERANCE = 6 * U * 30


def test_floats_agree_with_forty_digits(case):
    kind, numbers, truth = case
    got = [everything(row, math.sin, math.cos, kind) for row in numbers.tolist()]
    assert all(type(x) is float for x in got[0])
    assert abs(np.array(got) - truth).max() <= TOLERANCE


def test_component_arrays_agree_with_forty_digits(case):
    kind, numbers, truth = case
    got = everything(numbers.T, np.sin, np.cos, kind)
    assert abs(np.array(got).T - truth).max() <= TOLERANCE


@pytest.mark.slow
def test_symbols_agree_with_forty_digits(case):
    kind, numbers, truth = case
    symbols = sympy.symbols(f"x:{SIZE}", real=True)
    expressions = everything(symbols, sympy.sin, sympy.cos, kind)
    assert all(isinstance(x, sympy.Expr) for x in expressions)
    compiled = sympy.lambdify([symbols], expressions, modules="math", cse=True)
    got = [compiled(row) for row in numbers.tolist()]
    assert abs(np.array(got) - truth).max() <= TOLERANCE
