"""Exact results of robots in fifty-digit arithmetic: Newton's and Euler's laws, body by body in world axes.

The numbers of the robot's record are taken as exact. Forward dynamics solves M q'' = tau - bias; column k of M is the
efforts that a unit acceleration of joint k alone requires.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple, TypeAlias

import mpmath
import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.tree import Joint, Tree

Array: TypeAlias = NDArray[Any]

ROBOT_TRUTH_DECIMAL_DIGITS: Final = 50
"""Decimal digits of the exact results."""
_GRAVITY_MAGNITUDE: Final = 9.81  # m/s^2, along -z of the world

# Converts numbers into mpmath numbers without rounding, elementwise.
_to_mpf: Any = np.frompyfunc(mpmath.mpf, 1, 1)


class _BodyState(NamedTuple):
    """Motion of one body in world axes, as arrays of mpmath numbers. `R` and `axis` are the point and the unit axis
    of the joint that carries the body, `S` is the rotation from body to world axes, `omega` and `alpha` are the
    angular velocity and acceleration, and `a` is the acceleration of R minus the acceleration of gravity.
    """

    R: Array  # point of the joint that carries the body [m]
    S: Array  # rotation, body to world
    axis: Array  # unit axis of that joint
    omega: Array  # angular velocity [rad/s]
    alpha: Array  # angular acceleration [rad/s^2]
    a: Array  # acceleration of R minus that of gravity [m/s^2]


class ExactRobot:
    """A robot on a fixed base at given positions of its joints. The methods compute poses, Jacobians, inverse and
    forward dynamics in fifty-digit arithmetic and return them as arrays of mpmath numbers.

    Args:
        tree: the record of the robot.
        q: positions [rad, m]; shape (dof,).
    """

    def __init__(self, tree: Tree, q: Array) -> None:
        self._tree = tree
        coordinates = [joint.name for joint in tree.coordinates]
        leaders = [joint if joint.mimic is None else tree.joints[joint.mimic.leader - 1] for joint in tree.joints]
        self._columns = [coordinates.index(leader.name) for leader in leaders]
        self._ratios = [mpmath.mpf(1 if joint.mimic is None else joint.mimic.multiplier) for joint in tree.joints]
        self._dof = len(coordinates)
        offsets = [0.0 if joint.mimic is None else joint.mimic.offset for joint in tree.joints]
        self._q = self._joint_values(q) + _to_mpf(np.array(offsets))

    def pose(self, joint: str) -> Array:
        """Return position (3) and rotation matrix (9, row by row) of the body that the joint named `joint` carries,
        as one array of mpmath numbers, shape (12,).
        """
        with mpmath.workdps(ROBOT_TRUTH_DECIMAL_DIGITS):
            body = self._body_states(np.zeros(self._dof), np.zeros(self._dof), 0.0)[self._joint_number(joint)]
            return np.concatenate([body.R, body.S.ravel()])

    def jacobian(self, joint: str) -> Array:
        """Return the Jacobian of the velocity and the angular velocity (v, omega) of the body that the joint named
        `joint` carries, at the body's reference point, as an array of mpmath numbers, shape (6, dof).
        """
        with mpmath.workdps(ROBOT_TRUTH_DECIMAL_DIGITS):
            bodies = self._body_states(np.zeros(self._dof), np.zeros(self._dof), 0.0)
            number = tip = self._joint_number(joint)
            J: Array = _to_mpf(np.zeros((6, self._dof)))
            while number:
                ancestor, body = self._tree.joints[number - 1], bodies[number]
                hinged = ancestor.kind == "hinge"
                linear = _cross_product(body.axis, bodies[tip].R - body.R) if hinged else body.axis
                column = np.concatenate([linear, body.axis if hinged else 0 * body.axis])
                J[:, self._columns[number - 1]] += column * self._ratios[number - 1]
                number = ancestor.parent
            return J

    def inverse_dynamics(self, qd: Array, qdd: Array, gravity_magnitude: float = _GRAVITY_MAGNITUDE) -> Array:
        """Return the efforts [N m, N] that rates qd and accelerations qdd require, as an array of mpmath numbers,
        shape (dof,). `gravity_magnitude` is the acceleration of gravity along -z [m/s^2].
        """
        with mpmath.workdps(ROBOT_TRUTH_DECIMAL_DIGITS):
            bodies = self._body_states(qd, qdd, gravity_magnitude)
            zero = _to_mpf(np.zeros(3))
            force, torque = [zero] * len(bodies), [zero] * len(bodies)
            efforts: Array = _to_mpf(np.zeros(self._dof))
            for number in range(len(bodies) - 1, 0, -1):
                joint, body = self._tree.joints[number - 1], bodies[number]
                body_force, body_torque = _required_wrench(joint, body)
                f, t = force[number] + body_force, torque[number] + body_torque
                effort = body.axis @ (t if joint.kind == "hinge" else f)
                efforts[self._columns[number - 1]] += effort * self._ratios[number - 1]
                force[joint.parent] = force[joint.parent] + f
                arm = body.R - bodies[joint.parent].R
                torque[joint.parent] = torque[joint.parent] + t + _cross_product(arm, f)
            return efforts

    def forward_dynamics(self, qd: Array, tau: Array) -> Array:
        """Return the accelerations [rad/s^2, m/s^2] that efforts tau [N m, N] and gravity cause at rates qd, as an
        array of mpmath numbers, shape (dof,).
        """
        with mpmath.workdps(ROBOT_TRUTH_DECIMAL_DIGITS):
            zero = np.zeros(self._dof)
            columns = [self.inverse_dynamics(zero, unit, 0.0) for unit in np.eye(self._dof)]
            remaining = _to_mpf(tau) - self.inverse_dynamics(qd, zero)
            solution = mpmath.lu_solve(
                mpmath.matrix(np.stack(columns, axis=1).tolist()), mpmath.matrix(remaining.tolist())
            )
            return np.array(list(solution), dtype=object)

    def _joint_number(self, name: str) -> int:
        """Return the number of a joint, counted from 1."""
        return 1 + [joint.name for joint in self._tree.joints].index(name)

    def _joint_values(self, values: Array) -> Array:
        """Convert values of the coordinates to values of all joints in the order of the joints, with the multipliers
        but without the offsets of mimic joints; return an array of mpmath numbers.
        """
        joint_values: Array = _to_mpf(np.asarray(values, float))[self._columns] * np.array(self._ratios, dtype=object)
        return joint_values

    def _body_states(self, qd: Array, qdd: Array, gravity_magnitude: float) -> list[_BodyState]:
        """Return a list of the _BodyStates of the base and of all bodies, in the order of the joints, for rates qd
        and accelerations qdd. The base accelerates upwards by `gravity_magnitude`, which stands for gravity.
        """
        zero = _to_mpf(np.zeros(3))
        bodies = [
            _BodyState(zero, _to_mpf(np.eye(3)), zero, zero, zero, _to_mpf(np.array([0.0, 0.0, gravity_magnitude])))
        ]
        rates, accelerations = self._joint_values(qd), self._joint_values(qdd)
        for joint, q, v, w in zip(self._tree.joints, self._q, rates, accelerations, strict=True):
            p = bodies[joint.parent]
            S_fixed = p.S @ _to_mpf(joint.S)
            n = _to_mpf(joint.n)
            n = n / mpmath.sqrt(n @ n)
            axis = S_fixed @ n
            R = p.R + p.S @ _to_mpf(joint.u)
            if joint.kind == "hinge":
                S, omega = S_fixed @ _axis_rotation(n, q), p.omega + axis * v
                alpha, sliding = p.alpha + _cross_product(p.omega, axis) * v + axis * w, zero
            else:
                R, S, omega, alpha = R + axis * q, S_fixed, p.omega, p.alpha
                sliding = 2 * _cross_product(p.omega, axis) * v + axis * w
            arm = R - p.R
            a = p.a + _cross_product(p.alpha, arm) + _cross_product(p.omega, _cross_product(p.omega, arm)) + sliding
            bodies.append(_BodyState(R, S, axis, omega, alpha, a))
        return bodies


def _required_wrench(joint: Joint, body: _BodyState) -> tuple[Array, Array]:
    """Return the force [N] that the motion of a joint's body requires, gravity included, and the torque about the
    joint's point [N m], in world axes, as a tuple of two arrays of mpmath numbers, shape (3,) each. `body` is the
    _BodyState of the joint's body.
    """
    c = body.S @ _to_mpf(joint.body.center_of_mass)
    inertia = body.S @ _to_mpf(joint.body.inertia) @ body.S.T
    relative_a = _cross_product(body.alpha, c) + _cross_product(body.omega, _cross_product(body.omega, c))
    force = (body.a + relative_a) * mpmath.mpf(joint.body.mass)
    return force, inertia @ body.alpha + _cross_product(body.omega, inertia @ body.omega) + _cross_product(c, force)


def _axis_rotation(n: Array, angle: Any) -> Array:
    """Return the rotation matrix about a unit axis n by an angle [rad], by Rodrigues' formula, as an array of mpmath
    numbers, shape (3, 3).
    """
    x, y, z = n
    zero = mpmath.mpf(0)
    N = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]], dtype=object)
    rotation: Array = _to_mpf(np.eye(3)) + N * mpmath.sin(angle) + (N @ N) * (1 - mpmath.cos(angle))
    return rotation


def _cross_product(a: Array, b: Array) -> Array:
    """Return the cross product of two vectors."""
    products = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    return np.array(products, dtype=object)
