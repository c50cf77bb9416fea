"""A seven-joint arm against sixty digits: differences in time of a product of rotations, and virtual work."""

from __future__ import annotations

from dataclasses import replace

import mpmath
import numpy as np
import pytest

import hingepair as hp
from support.trees import Robot, random_model, record_of

DIGITS = 120
STEP = mpmath.mpf(10) ** -25  # s: differences are off by its square, and by 10^-DIGITS / STEP^2
STATES = 4
GRAVITY = (0.0, 0.0, -9.81)


@pytest.fixture(scope="module", params=["panda", "oblique"])
def robot(request):
    if request.param == "panda":
        return hp.load_robot("panda", locked={"panda_finger_joint1": 0.02})
    return Robot(exactly_turned(record_of(random_model(4, 7))))


def exactly_turned(tree):
    """The record with quarter turns from body to body: other matrices of doubles are rotations to rounding only."""
    rng = np.random.default_rng(3)
    quarters = [np.roll(np.eye(3), int(rng.integers(3)), axis=0) * rng.choice((-1, 1), 3) for _ in tree.joints]
    turns = [S * np.linalg.det(S) + 0.0 for S in quarters]
    return replace(tree, joints=tuple(replace(j, S=S) for j, S in zip(tree.joints, turns, strict=True)))


def matrix(array):
    return mpmath.matrix(np.asarray(array, float).tolist())


def turn(axis, angle):
    """The rotation about an axis by the exponential of its matrix, summed in sines."""
    x, y, z = axis
    K = mpmath.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return mpmath.eye(3) + mpmath.sin(angle) * K + (1 - mpmath.cos(angle)) * K * K


def poses(tree, q):
    """Attitude and reference point of every body, of coordinates of as many digits."""
    found = [(mpmath.eye(3), mpmath.zeros(3, 1))]
    for joint, angle in zip(tree.joints, q, strict=True):
        S, R = found[joint.parent]
        own, axis = S * matrix(joint.S), matrix(joint.n[:, None])
        if joint.kind == "slider":
            found.append((own, R + S * matrix(joint.u[:, None]) + own * axis * angle))
        else:
            length = mpmath.sqrt(sum(x * x for x in axis))
            found.append((own * turn([x / length for x in axis], angle), R + S * matrix(joint.u[:, None])))
    return found


def vector_of(W):
    return mpmath.matrix([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]]) / 2


def cross(a, b):
    return mpmath.matrix([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


class Exact:
    """Motion and torques of one state, from positions alone."""

    def __init__(self, tree, q, qd, qdd):
        q, qd, qdd = ([mpmath.mpf(x) for x in part.tolist()] for part in (q, qd, qdd))
        self.tree = tree

        def at(t):
            return poses(tree, [x + t * (v + t * a / 2) for x, v, a in zip(q, qd, qdd, strict=True)])

        self.before, self.now, self.after = at(-STEP), at(0), at(STEP)
        self.moved = []
        for k in range(len(q)):
            shifted = [poses(tree, [x + sign * STEP * (j == k) for j, x in enumerate(q)]) for sign in (-1, 1)]
            self.moved.append(shifted)

    def point(self, body, r):
        """Position, velocity and acceleration of a body's point."""
        r = matrix(np.asarray(r)[:, None])
        before, now, after = (R + S * r for S, R in (self.before[body], self.now[body], self.after[body]))
        return now, (after - before) / (2 * STEP), (after - 2 * now + before) / STEP**2

    def turning(self, body):
        """Angular velocity and acceleration of a body."""
        (S0, _), (S, _), (S1, _) = self.before[body], self.now[body], self.after[body]
        first, second = (S1 - S0) / (2 * STEP), (S1 - 2 * S + S0) / STEP**2
        return vector_of(first * S.T), vector_of(second * S.T + first * first.T)

    def efforts(self):
        """Tau by virtual work: what moves every mass, along what each coordinate moves it."""
        tau = [mpmath.mpf(0)] * len(self.tree.joints)
        g = matrix(np.array(GRAVITY)[:, None])
        for body, joint in enumerate(self.tree.joints, 1):
            own, S = joint.body, self.now[body][0]
            force = own.mass * (self.point(body, own.center_of_mass)[2] - g)
            inertia = S * matrix(own.inertia) * S.T
            omega, alpha = self.turning(body)
            torque = inertia * alpha + cross(omega, inertia * omega)
            c = matrix(own.center_of_mass[:, None])
            for k, (low, high) in enumerate(self.moved):
                (S0, R0), (S1, R1) = low[body], high[body]
                push = (R1 + S1 * c - R0 - S0 * c) / (2 * STEP)
                spin = vector_of((S1 - S0) * S.T) / (2 * STEP)
                tau[k] += (force.T * push)[0] + (torque.T * spin)[0]
        return tau


def off(found, exact):
    """The largest difference of numbers from those of many digits."""
    return max(abs(mpmath.mpf(float(x)) - y) for x, y in zip(np.ravel(found), exact, strict=True))


def test_motion_and_torques_are_as_near_as_their_bounds_say(robot):
    tree = robot.tree
    q, qd, qdd = np.random.default_rng(12).uniform(-3, 3, (3, STATES, robot.dof))
    q[1], qd[2] = 1e-9 * q[1], 1e3 * qd[2]
    frames = robot.tips[:2]
    state = robot.forward_kinematics(q, qd, qdd, frames=frames)
    bounds = robot.error_bounds(q, qd, qdd, frames=frames)
    tau = robot.inverse_dynamics(q, qd, qdd, gravity=GRAVITY).tau
    allowed = robot.error_bounds(q, qd, qdd, outputs=("tau",))["tau"]
    with mpmath.workdps(DIGITS):
        for k in range(STATES):
            exact = Exact(tree, q[k], qd[k], qdd[k])
            for j, name in enumerate(frames):
                frame = tree.frame(name)
                R, v, a = exact.point(frame.body, frame.R)
                omega, alpha = exact.turning(frame.body)
                S = exact.now[frame.body][0] * matrix(frame.S)
                expected = {"R": R, "d": R, "S": S, "v": v, "a": a, "omega": omega, "alpha": alpha}
                for output, value in expected.items():
                    assert off(state[name].arrays()[output][k], value) <= bounds[output][k, j], (name, output, k)
            assert off(tau[k], exact.efforts()) <= allowed[k], k
        assert allowed[0] < 1e-11 * max(map(abs, tau[0]))
