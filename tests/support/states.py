"""Seeded random pairs and states, and the catalogue of hard ones; plain numbers, nothing of hingepair."""

from __future__ import annotations

import math

import numpy as np

from support.exact import attitude_of_quaternion

PSI, PHI_Y = 6, 4


def generator(*key):
    """A random generator of its own for every use."""
    return np.random.default_rng([2024, *key])


def rotations(rng, *shape):
    """Random rotations, each element the double next to the exact one; shape (*shape, 3, 3)."""
    quat = rng.normal(size=(math.prod(shape), 4))
    return attitude_of_quaternion(quat).astype(float).reshape(*shape, 3, 3)


def pair(rng, home=True):
    """(u1, u2, n, home) with an axis of any direction and of a length between 1e-3 and 1e3."""
    u1, u2, n = rng.normal(size=(3, 3))
    return u1, u2, n * 10 ** rng.uniform(-3, 3), rotations(rng, 1)[0] if home else None


def coordinates(rng, count):
    """q, qd, qdd of shape (count, 7): positions of metres, angles in [-pi, pi], rates and their change about one."""
    q = rng.uniform(-math.pi, math.pi, (count, 7))
    q[:, :3] = rng.normal(scale=10.0, size=(count, 3))
    qd, qdd = rng.normal(size=(2, count, 7))
    return q, qd, qdd


def body1(rng, count):
    """R1, S1, v1, omega1, a1, alpha1 of body 1 with a given attitude."""
    R1, v1, omega1, a1, alpha1 = rng.normal(size=(5, count, 3))
    return 10 * R1, rotations(rng, count), v1, omega1, a1, alpha1


REFERENCE_PAIR = (np.array([0.5, 0.2, 0.1]), np.array([-0.25, 0.1, 0.3]), np.array([1.0, 0.0, 0.0]), None)


def hard_states():
    """Name -> (pair, q, qd, qdd), one state of shape (7,) each."""
    cases = {}

    def add(name, pair_=None, q=None, rates=(1.0, 1.0), **constants):
        rng = generator(7, len(cases))
        u1, u2, n, home = pair_ or pair(rng)
        chosen = {"u1": u1, "u2": u2, "n": n, "home": home} | constants
        base, qd, qdd = (c[0] for c in coordinates(rng, 1))
        for index, value in (q or {}).items():
            base[index] = value
        cases[name] = (tuple(chosen.values()), base, qd * rates[0], qdd * rates[1])

    for psi in (5e-324, 1e-310, 1e-300, 1e-160, 1e-9, 1e-8, -1e-5, 3e-4):
        add(f"psi={psi}", q={PSI: psi})
    for gap in (0.0, 1e-9, -1e-9, 1e-15, -1e-5):
        add(f"psi=pi{gap:+.0e}", q={PSI: math.pi + gap})
    for psi in (1e5, 999999.5, 1000000.5, 1e15, 1e16, -1e16, 1e300):
        add(f"psi={psi:.0e}", q={PSI: psi})
    for angle in (1e6, 1e16, 1e300):
        add(f"all angles {angle:.0e}", q={3: angle, 4: -angle / 3, 5: angle / 7, PSI: angle})
    for gap in (0.0, 1e-9, -1e-9, 1e-16):
        add(f"phi_y=pi/2{gap:+.0e}", q={PHI_Y: math.pi / 2 + gap})
    add("phi_y=-pi/2", q={PHI_Y: -math.pi / 2})
    add("lock twice: phi_y=pi/2, psi=pi", q={PHI_Y: math.pi / 2, PSI: math.pi})
    add("all angles subnormal", q={3: 5e-324, 4: -1e-310, 5: 1e-315, PSI: 2e-320})
    add("angles multiples of pi/2", q={3: math.pi / 2, 4: math.pi, 5: -math.pi / 2, PSI: 2 * math.pi})
    for far in (1e8, 1e15):
        add(f"R1={far:.0e}", q={0: far, 1: -far / 3, 2: far})
    axis = generator(8).normal(size=3)
    for length in (1e-300, 1e-200, 1e-160, 1e160, 1e200, 1e300):
        add(f"axis of length {length:.0e}", n=axis * length)
    add("axis almost along x", n=np.array([1.0, 1e-12, -1e-170]))
    add("axis subnormal", n=np.array([5e-324, -1e-323, 1e-310]))
    add("axis along -z", n=np.array([0.0, 0.0, -7.0]))
    add("axis of six digits", n=np.full(3, 0.57735))
    for rate in (1e-300, 1e-160, 1e-60, 1e20, 1e100):
        add(f"rates {rate:.0e}", rates=(rate, rate * rate))
    add("rates 1e100 beside ordinary ones", rates=(np.array([1, 1, 1, 1e100, 1, 1, 1]), 1.0))
    same = generator(9).normal(size=3)
    add("u1=u2, psi=0: d cancels", u1=same, u2=same, home=None, q={PSI: 0.0})
    add("u1=u2, psi tiny: d almost cancels", u1=same, u2=same, home=None, q={PSI: 1e-7})
    add("u1=u2 along n: d cancels", u1=axis, u2=axis, n=axis, home=None)
    add("u1=0", u1=np.zeros(3))
    add("u2=0", u2=np.zeros(3))
    add("u1=1e8, u2=1e-8", u1=np.full(3, 1e8), u2=np.full(3, 1e-8))
    add("u1=1e-8, u2=1e8", u1=np.full(3, 1e-8), u2=np.full(3, 1e8))
    add("u1=1e200, u2=1e200", u1=np.full(3, 1e200), u2=np.array([1e200, 2e200, -1e200]))
    add(
        "u1=1e-290, u2=1e-290",
        u1=np.full(3, 1e-290),
        u2=np.array([1e-290, 2e-290, -1e-290]),
        q=dict.fromkeys(range(3), 0),
    )
    add("u1=1e200, u2=1e-200, only psi moves", u1=np.full(3, 1e200), u2=np.array([1e-200, 2e-200, -1e-200]),
        q=dict.fromkeys(range(3), 0), rates=(np.eye(7)[PSI], np.eye(7)[PSI]))  # fmt: skip
    add("u2 along n", u2=-3 * axis, n=axis, home=None)
    add("u1=0, body 1 at rest", u1=np.zeros(3), q=dict.fromkeys(range(3), 0), rates=(np.eye(7)[PSI], np.eye(7)[PSI]))
    add("v1 cancels the hinge", u1=np.zeros(3), u2=np.array([0.0, 1.0, 0.0]), n=np.eye(3)[0], home=None,
        q=dict.fromkeys(range(7), 0.0), rates=(np.array([0, 0, 1.0, 0, 0, 0, 1.0]), 0.0))  # fmt: skip
    add("at rest", rates=(0.0, 0.0))
    add("only psi moves", rates=(np.eye(7)[PSI], np.eye(7)[PSI]))
    add("psi undoes phi_x", n=np.eye(3)[0], q={4: 0.0, 5: 0.0}, rates=(np.array([0, 0, 0, 2, 0, 0, -2.0]), 0))
    add("all zero", (np.zeros(3), np.zeros(3), np.eye(3)[2], None), dict.fromkeys(range(7), 0.0), (0.0, 0.0))
    return cases


def immense_rates():
    """Name -> (pair, q, qd, qdd) with a hinge rate whose square leaves the range of numbers, unlike what it makes."""
    lever, hinge = np.array([1.0, 2.0, -1.0]), np.eye(7)[PSI]
    cases = {}
    for name, length, rate in (
        ("fast and short", 1e-30, 1e160),
        ("slow and long", 1e200, 1e-170),
        ("as fast as can be, no lever", 0.0, 1e308),
    ):
        _, _, n, home = pair(generator(19, len(cases)))
        q = coordinates(generator(19, len(cases)), 1)[0][0]
        q[:3] = 0.0
        cases[name] = (length * lever / 3, length * lever, n, home), q, rate * hinge, hinge
    return cases


def hard_attitudes():
    """Name -> (how it is given, its numbers): attitudes of body 1 from outside."""
    rng = generator(12)
    quat, turn = rng.normal(size=4), rng.normal(size=3)
    turn /= np.linalg.norm(turn)
    cases = {}
    for size in (1e-320, 1e-170, 1e-3, 1.000001, 1e170, 1e300):
        cases[f"quaternion of length {size:.0e}"] = ("quat_xyzw", quat * size)
        cases[f"scalar-first quaternion of length {size:.0e}"] = ("quat_wxyz", quat * size)
    cases["half turn about x"] = ("quat_xyzw", np.array([1.0, 0.0, 0.0, 0.0]))
    cases["half turn, almost"] = ("quat_xyzw", np.array([1.0, -2.0, 3.0, 1e-12]))
    cases["quaternion of hardly a turn"] = ("quat_wxyz", np.array([1.0, 1e-12, -3e-13, 1e-170]))
    cases["minus the identity's quaternion"] = ("quat_wxyz", np.array([-1.0, 0.0, 0.0, 0.0]))
    for angle in (0.0, 5e-324, 1e-160, 1e-12, 1e-8, 1e-3, math.pi - 1e-9, math.pi, 4.0, 100.0, 1e15):
        cases[f"rotation vector of length {angle:.0e}"] = ("rotvec", turn * angle)
    cases["matrix of a half turn"] = ("S", np.diag([1.0, -1.0, -1.0]))
    cases["matrix next to the identity"] = ("S", np.array([[1, -1e-9, 0], [1e-9, 1, 0], [0, 0, 1.0]]))
    cases["matrix of a permutation"] = ("S", np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]))
    return cases
