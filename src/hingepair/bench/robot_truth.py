"""What is true of a robot, to fifty digits: Newton's and Euler's laws body by body in world axes, nothing folded.

The numbers of the robot's record stand for themselves. Forward dynamics solves M q'' = tau - bias, whose column k is
what unit acceleration of joint k alone needs.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple, TypeAlias

import mpmath
import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.tree import Joint, Tree

Array: TypeAlias = NDArray[Any]

DIGITS: Final = 50
_GRAVITY: Final = 9.81  # m/s^2, along -z of the world

_exactly: Any = np.frompyfunc(mpmath.mpf, 1, 1)


class _Body(NamedTuple):
    """A body at one state, world axes."""

    R: Array  # point of its joint
    S: Array
    axis: Array  # of its joint
    omega: Array
    alpha: Array
    a: Array  # of R, plus what holds against gravity


class RobotTruth:
    """A robot at one state, in arrays of mpmath numbers.

    Args:
        tree: the record of the robot, whose base stands.
        q: positions; shape (dof,).
    """

    def __init__(self, tree: Tree, q: Array) -> None:
        self._tree = tree
        coordinates = [joint.name for joint in tree.coordinates]
        leaders = [joint if joint.mimic is None else tree.joints[joint.mimic.leader - 1] for joint in tree.joints]
        self._columns = [coordinates.index(leader.name) for leader in leaders]
        self._ratios = [mpmath.mpf(1 if joint.mimic is None else joint.mimic.multiplier) for joint in tree.joints]
        self._dof = len(coordinates)
        offsets = [0.0 if joint.mimic is None else joint.mimic.offset for joint in tree.joints]
        self._q = self._of_joints(q) + _exactly(np.array(offsets))

    def pose(self, joint: str) -> Array:
        """Return position and rotation of a joint's body; shape (12,)."""
        with mpmath.workdps(DIGITS):
            body = self._bodies(np.zeros(self._dof), np.zeros(self._dof), 0.0)[self._number(joint)]
            return np.concatenate([body.R, body.S.ravel()])

    def jacobian(self, joint: str) -> Array:
        """Return the Jacobian of a joint's body, rows (v, omega) of its point; shape (6, dof)."""
        with mpmath.workdps(DIGITS):
            bodies = self._bodies(np.zeros(self._dof), np.zeros(self._dof), 0.0)
            number = tip = self._number(joint)
            J: Array = _exactly(np.zeros((6, self._dof)))
            while number:
                joint_here, body = self._tree.joints[number - 1], bodies[number]
                hinged = joint_here.kind == "hinge"
                linear = _cross(body.axis, bodies[tip].R - body.R) if hinged else body.axis
                column = np.concatenate([linear, body.axis if hinged else 0 * body.axis])
                J[:, self._columns[number - 1]] += column * self._ratios[number - 1]
                number = joint_here.parent
            return J

    def inverse_dynamics(self, qd: Array, qdd: Array, gravity: float = _GRAVITY) -> Array:
        """Return the efforts of a motion; shape (dof,)."""
        with mpmath.workdps(DIGITS):
            bodies = self._bodies(qd, qdd, gravity)
            zero = _exactly(np.zeros(3))
            force, torque = [zero] * len(bodies), [zero] * len(bodies)
            efforts: Array = _exactly(np.zeros(self._dof))
            for number in range(len(bodies) - 1, 0, -1):
                joint, body = self._tree.joints[number - 1], bodies[number]
                own_force, own_torque = _needed(joint, body)
                f, t = force[number] + own_force, torque[number] + own_torque
                effort = body.axis @ (t if joint.kind == "hinge" else f)
                efforts[self._columns[number - 1]] += effort * self._ratios[number - 1]
                force[joint.parent] = force[joint.parent] + f
                arm = body.R - bodies[joint.parent].R
                torque[joint.parent] = torque[joint.parent] + t + _cross(arm, f)
            return efforts

    def forward_dynamics(self, qd: Array, tau: Array) -> Array:
        """Return the accelerations that efforts make; shape (dof,)."""
        with mpmath.workdps(DIGITS):
            zero = np.zeros(self._dof)
            columns = [self.inverse_dynamics(zero, unit, 0.0) for unit in np.eye(self._dof)]
            left = _exactly(tau) - self.inverse_dynamics(qd, zero)
            solution = mpmath.lu_solve(
                mpmath.matrix(np.stack(columns, axis=1).tolist()), mpmath.matrix(left.tolist())
            )
            return np.array(list(solution), dtype=object)

    def _number(self, joint: str) -> int:
        return 1 + [one.name for one in self._tree.joints].index(joint)

    def _of_joints(self, values: Array) -> Array:
        """Return values of all joints, followers included, of those of the coordinates."""
        followed: Array = _exactly(np.asarray(values, float))[self._columns] * np.array(self._ratios, dtype=object)
        return followed

    def _bodies(self, qd: Array, qdd: Array, gravity: float) -> list[_Body]:
        zero = _exactly(np.zeros(3))
        bodies = [_Body(zero, _exactly(np.eye(3)), zero, zero, zero, _exactly(np.array([0.0, 0.0, gravity])))]
        rates, accelerations = self._of_joints(qd), self._of_joints(qdd)
        for joint, q, v, w in zip(self._tree.joints, self._q, rates, accelerations, strict=True):
            p = bodies[joint.parent]
            turned = p.S @ _exactly(joint.S)
            n = _exactly(joint.n)
            n = n / mpmath.sqrt(n @ n)
            axis = turned @ n
            R = p.R + p.S @ _exactly(joint.u)
            if joint.kind == "hinge":
                S, omega = turned @ _turn(n, q), p.omega + axis * v
                alpha, slide = p.alpha + _cross(p.omega, axis) * v + axis * w, zero
            else:
                R, S, omega, alpha = R + axis * q, turned, p.omega, p.alpha
                slide = 2 * _cross(p.omega, axis) * v + axis * w
            arm = R - p.R
            a = p.a + _cross(p.alpha, arm) + _cross(p.omega, _cross(p.omega, arm)) + slide
            bodies.append(_Body(R, S, axis, omega, alpha, a))
        return bodies


def _needed(joint: Joint, body: _Body) -> tuple[Array, Array]:
    """Return the force that a body's motion needs, and the torque about its joint's point."""
    c = body.S @ _exactly(joint.body.center_of_mass)
    inertia = body.S @ _exactly(joint.body.inertia) @ body.S.T
    swing = _cross(body.alpha, c) + _cross(body.omega, _cross(body.omega, c))
    force = (body.a + swing) * mpmath.mpf(joint.body.mass)
    return force, inertia @ body.alpha + _cross(body.omega, inertia @ body.omega) + _cross(c, force)


def _turn(n: Array, angle: Any) -> Array:
    """Return the rotation about a unit axis, by Rodrigues' formula."""
    x, y, z = n
    zero = mpmath.mpf(0)
    N = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]], dtype=object)
    turned: Array = _exactly(np.eye(3)) + N * mpmath.sin(angle) + (N @ N) * (1 - mpmath.cos(angle))
    return turned


def _cross(a: Array, b: Array) -> Array:
    products = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    return np.array(products, dtype=object)
