"""Scales of the errors of a robot's results: the sizes of the terms of each result before they cancel.

The sizes grow from the base to the tips. At a joint, l is the length of the offset and of the displacement along the
axis, W and A are the sizes of the angular velocity and acceleration, and q' is the rate of a hinge (that of a
displacement adds to v):

    R += l      W += abs(q')      v += W l      A += abs(q'') + W abs(q') + q'^2
    a += (A + W^2) l + (W + W2) v + W W2 l

The formulas are the same as for a pair, with the extra terms of Pinocchio. Rounding errors add up along the chain:
the scale of a frame is the sum of these sizes over the joints before it. The sizes of a mimic joint count 1 + abs(q)
times, because its angle q is rounded. The sizes of forces are masses times sizes of accelerations, summed over the
bodies that a joint carries.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.pairs.accuracy import norm
from hingepair.mechanism.tree import Frame, Tree
from hingepair.numeric.arrays import Float64Array


class Scales:
    """Scales of the errors of a robot's outputs at N samples.

    Args:
        tree: the robot.
        joints: position, rate and acceleration of each joint that moves, those that follow others too; as many as
            are known, shape (N, joints) each.
        base: motion of the base; shape (N,), with as many derivatives.
        gravity: acceleration of free fall [m/s^2]; shape (3,).
    """

    def __init__(
        self,
        tree: Tree,
        joints: list[Float64Array],
        base: BodyMotion,
        gravity: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        self._tree = tree
        count, number = joints[0].shape[0], len(tree.joints)
        zero = np.zeros((count, number))
        self._places, self._rates, self._changes = (np.abs(one) for one in (*joints, zero, zero)[:3])
        self._gravity = float(norm(gravity))
        self._bodies = [
            (abs(one.mass), float(norm(one.centre_of_mass)), float(norm(one.inertia.ravel())))
            for one in (tree.base, *(joint.body for joint in tree.joints))
        ]
        R, v, W, a, A = (
            np.zeros(count) + (0.0 if (part := getattr(base, letter)) is None else norm(part))
            for letter in ("R", "v", "omega", "a", "alpha")
        )
        size = {"R": R, "v": v, "W": W, "A": A, "a": a + W * v}
        self._sizes, self._sums, self._lengths = [size], [{**size, "S": np.ones(count)}], [np.zeros(count)]
        for k, joint in enumerate(tree.joints):
            turns, shifts = map(abs, joint.axis)
            length = float(norm(joint.u)) + shifts * self._places[:, k]
            motion = self._rates[:, k], self._changes[:, k]
            size = _sizes_behind_joint(self._sizes[joint.parent], length, *motion, (turns, shifts))
            self._sizes.append(size)
            weight = 1.0 if joint.mimic is None else 1.0 + turns * self._places[:, k]
            self._sums.append(_add_sizes(self._sums[joint.parent], size, weight))
            self._lengths.append(length + np.zeros(count))
        self._distances = self._distance_bounds()

    def motion(self, frame: Frame) -> dict[str, Float64Array]:
        """Return a dict of the error scales of R, S, v, omega, a and alpha of a frame by name; shape (N,) each."""
        size = _sizes_behind_joint(self._sizes[frame.body], float(norm(frame.R)), 0.0, 0.0, (0.0, 0.0))
        total = _add_sizes(self._sums[frame.body], size, 1.0)
        letters = {"R": "R", "S": "S", "v": "v", "omega": "W", "a": "a", "alpha": "A"}
        return {name: total[letter] for name, letter in letters.items()}

    def jacobian(self, frame: Frame) -> Float64Array:
        """Return the error scales of the Jacobian of a Frame object, shape (N, 6, 6 + joints). The first six columns
        belong to the base.

        Pinocchio first computes the motions of the joints at the origin of the world; therefore positions count.
        """
        steps = self._sums[frame.body]["S"][:, None]
        place = self._sizes[frame.body]["R"] + float(norm(frame.R))
        scales = np.zeros((len(place), 6, 6 + len(self._tree.joints)))
        for body in np.flatnonzero(self._carries[:, frame.body]):
            for column, (turns, shifts) in self._velocity_columns(int(body)):
                lever = (place + self._sizes[body]["R"])[:, None]
                scales[:, :3, column] = (turns * lever + shifts) * steps
                scales[:, 3:, column] = turns * steps
        return scales

    def forces(self) -> tuple[Float64Array, Float64Array]:
        """Return two arrays, shape (N, 1 + joints) each: the error scales of the force [N] and of the torque [N m] on
        each body at its reference point, the base first.
        """
        count, bodies = len(self._lengths[0]), len(self._lengths)
        force, torque = np.zeros((2, count, bodies))
        for k in reversed(range(bodies)):
            (mass, lever, inertia), sums, size = self._bodies[k], self._sums[k], self._sizes[k]
            turning = sums["A"] + sums["S"] * size["W"] ** 2
            body_force = mass * (sums["a"] + turning * lever + self._gravity * sums["S"])
            force[:, k] += body_force
            # Pinocchio adds v x m v, whose terms are rounded before they cancel.
            torque[:, k] += (
                inertia * turning + lever * body_force + mass * sums["v"] * (size["v"] + size["W"] * lever)
            )
            if k:
                parent = self._tree.joints[k - 1].parent
                force[:, parent] += force[:, k]
                torque[:, parent] += torque[:, k] + self._lengths[k] * force[:, k]
        return force, torque

    def rotor_efforts(self) -> Float64Array:
        """Return the size of the effort [N m or N] that accelerates each joint's rotor; shape (N, joints)."""
        return np.asarray(self._changes * [joint.armature for joint in self._tree.joints])

    def mass_matrix(self) -> Float64Array:
        """Return the scales by which errors of the mass matrix are measured: the sums of the sizes of the terms of
        each entry, shape (N, 6 + joints, 6 + joints). The columns are the six velocities of the base and the rates of
        all joints.
        """
        joints = len(self._tree.joints)
        scales = np.zeros((len(self._lengths[0]), 6 + joints, 6 + joints))
        for k in range(1 + joints):
            (mass, lever, inertia), steps = self._bodies[k], 1.0 + self._sums[k]["S"]  # turned from both sides
            carriers = [
                column for body in np.flatnonzero(self._carries[:, k]) for column in self._velocity_columns(int(body))
            ]
            bodies = [max(column - 5, 0) for column, _ in carriers]
            turns, shifts = np.array([axis for _, axis in carriers]).T
            arms = turns * (self._distances[:, bodies, k] + lever) + shifts
            place = np.array([column for column, _ in carriers])
            both = mass * arms[:, :, None] * arms[:, None, :]
            both += inertia * turns[:, None] * turns[None, :]
            scales[:, place[:, None], place[None, :]] += steps[:, None, None] * both
        for k, joint in enumerate(self._tree.joints):
            scales[:, k + 6, k + 6] += joint.armature
        return scales

    def energy_and_momentum(self) -> dict[str, Float64Array]:
        """Return a dict of the error scales of kinetic and potential energy, and of the linear momentum and the
        angular momentum about the origin, by name; shape (N,) each.
        """
        count = len(self._lengths[0])
        scales = {name: np.zeros(count) for name in ("kinetic", "potential", "linear", "angular")}
        for k in range(len(self._lengths)):
            (mass, lever, inertia), sums, size = self._bodies[k], self._sums[k], self._sizes[k]
            rate, place = sums["v"] + sums["W"] * lever, sums["R"] + sums["S"] * lever
            scales["kinetic"] += mass * rate * (size["v"] + size["W"] * lever) + inertia * sums["W"] * size["W"]
            scales["potential"] += mass * self._gravity * place
            scales["linear"] += mass * rate
            scales["angular"] += mass * (rate * (size["R"] + lever) + place * (size["v"] + size["W"] * lever))
            scales["angular"] += inertia * sums["W"]
        for k, joint in enumerate(self._tree.joints):
            scales["kinetic"] += joint.armature * self._rates[:, k] ** 2
        return scales

    def _velocity_columns(self, body: int) -> list[tuple[int, tuple[float, float]]]:
        """Return (index, (how far it turns, how far it shifts)) of each velocity that moves a body in its parent."""
        if body == 0:
            return [(column, (0.0, 1.0) if column < 3 else (1.0, 0.0)) for column in range(6)]
        turns, shifts = self._tree.joints[body - 1].axis
        return [(body + 5, (abs(turns), abs(shifts)))]

    def _distance_bounds(self) -> Float64Array:
        """Set `_carries`; return bounds on the distances [m] from bodies to those carried, (N, bodies, bodies)."""
        bodies = len(self._lengths)
        self._carries: NDArray[Any] = np.eye(bodies, dtype=bool)  # [i, k]: body i carries k
        bounds = np.zeros((len(self._lengths[0]), bodies, bodies))
        for k, joint in enumerate(self._tree.joints, 1):
            above = self._carries[:, joint.parent]
            self._carries[above, k] = True
            bounds[:, above, k] = bounds[:, above, joint.parent] + self._lengths[k][:, None]
        return bounds


def _sizes_behind_joint(
    sizes: dict[str, Any], length: Any, rate: Any, acceleration: Any, axis: tuple[float, float]
) -> dict[str, Any]:
    """Return the sizes of the motion of the body behind a joint whose `axis` says how far it turns and shifts."""
    W, A, v, a = (sizes[letter] for letter in "WAva")
    turns, shifts = axis
    turn, shift = turns * rate, shifts * rate
    both = W + turn
    grown = {"R": sizes["R"] + length, "W": both, "v": v + W * length + shift}
    grown["A"] = A + turns * acceleration + W * turn + turn * turn
    grown["a"] = a + (A + W * W) * length + (W + both) * v + W * both * length
    grown["a"] = grown["a"] + shifts * acceleration + 2 * W * shift
    return grown


def _add_sizes(sums: dict[str, Any], sizes: dict[str, Any], weight: Any) -> dict[str, Any]:
    """Return sums of sizes, with those of a further joint times `weight`."""
    added = {letter: sums[letter] + weight * value for letter, value in sizes.items()}
    return {**added, "S": sums["S"] + weight}
