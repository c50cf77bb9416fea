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
from numpy.typing import ArrayLike

from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.pairs.accuracy import norm
from hingepair.mechanism.tree import Frame, Tree
from hingepair.numeric.arrays import Float64Array
from hingepair.validation.pinocchio_twin import LETTERS, joint_rules

Sizes = dict[str, Any]
"""Sizes of positions R, velocities v, angular velocities W, and accelerations a and A; sums have S beside them, the
number of rotations."""


class Scales:
    """Scales of the errors of a robot's outputs at N samples.

    Args:
        tree: the robot.
        coordinates: q and, as far as known, its derivatives; shape (N, dof) each.
        base: motion of the base; shape (N,), with as many derivatives.
        free: whether the columns of matrices begin with the six velocities of the base.
        gravity: acceleration of free fall [m/s^2]; shape (3,).
    """

    def __init__(
        self,
        tree: Tree,
        coordinates: list[Float64Array],
        base: BodyMotion,
        free: bool,
        gravity: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        ratios, offsets = joint_rules(tree)
        count, dof = coordinates[0].shape
        q, *rates = (one @ ratios.T for one in coordinates)
        places, self._rates, self._changes = (np.abs(x) for x in (q + offsets, *rates, *2 * [0.0 * q])[:3])
        self._ratios = np.abs(ratios)
        columns = np.zeros((6 + len(ratios), 6 + dof))
        columns[:6, :6], columns[6:, 6:] = np.eye(6), self._ratios
        self._columns = columns if free else columns[:, 6:]
        self._tree, self._gravity = tree, float(norm(gravity))
        self._turns, self._shifts = np.abs([joint.axis for joint in tree.joints]).reshape(-1, 2).T
        self._armature = np.array([joint.armature for joint in tree.joints])
        self._mass = np.array([abs(one.mass) for one in tree.bodies])
        self._lever = np.array([norm(one.centre_of_mass) for one in tree.bodies])
        self._inertia = np.array([norm(one.inertia.ravel()) for one in tree.bodies])
        R, v, W, a, A = (
            np.zeros(count) + (0.0 if (part := getattr(base, letter)) is None else norm(part))
            for letter in ("R", "v", "omega", "a", "alpha")
        )
        sizes: list[Sizes] = [{"R": R, "v": v, "W": W, "a": a + W * v, "A": A}]
        sums: list[Sizes] = [{**sizes[0], "S": np.ones(count)}]
        lengths = [np.zeros(count)]  # from the parent's reference point
        for k, joint in enumerate(tree.joints):
            turns, shifts = self._turns[k], self._shifts[k]
            lengths.append(float(norm(joint.u)) + shifts * places[:, k])
            motion = self._rates[:, k], self._changes[:, k], turns, shifts
            sizes.append(_sizes_behind(sizes[joint.parent], lengths[-1], *motion))
            weight = 1.0 if joint.mimic is None else 1.0 + turns * places[:, k]
            sums.append(_added(sums[joint.parent], sizes[-1], weight))
        self._lengths = np.stack(lengths, axis=1)  # of these, (N, bodies)
        self._sizes, self._sums = (
            {name: np.stack([one[name] for one in part], axis=1) for name in part[0]} for part in (sizes, sums)
        )

    def motion(self, frame: Frame) -> dict[str, Float64Array]:
        """Return the error scales of R, S, v, omega, a and alpha of a frame by name; shape (N,) each."""
        size, total = ({name: x[:, frame.body] for name, x in one.items()} for one in (self._sizes, self._sums))
        total = _added(total, _sizes_behind(size, float(norm(frame.R)), 0.0, 0.0, 0.0, 0.0), 1.0)
        return {name: total[{"omega": "W", "alpha": "A"}.get(name, name)] for name in LETTERS}

    def jacobian(self, frame: Frame) -> Float64Array:
        """Return the error scales of the Jacobian of a frame, shape (N, 6, columns).

        Pinocchio first computes the motions of the joints at the origin of the world; therefore positions count.
        """
        columns, bodies, turns, shifts = self._movers(frame.body)
        place = self._sizes["R"][:, frame.body] + float(norm(frame.R))
        steps = self._sums["S"][:, frame.body, None]
        scales = np.zeros((len(place), 6, len(self._columns)))
        lever = place[:, None] + self._sizes["R"][:, bodies]
        scales[:, :3, columns] = ((turns * lever + shifts) * steps)[:, None]
        scales[:, 3:, columns] = (turns * steps)[:, None]
        return scales @ self._columns

    def forces(self) -> dict[str, Float64Array]:
        """Return the error scales of force1 [N] and torque1 [N m], (N, 1), and tau, (N, dof), by name."""
        sums, sizes = self._sums, self._sizes
        turning = sums["A"] + sums["S"] * sizes["W"] ** 2
        force = self._mass * (sums["a"] + turning * self._lever + self._gravity * sums["S"])
        # Pinocchio adds v x m v, whose terms are rounded before they cancel.
        crossing = self._mass * sums["v"] * (sizes["v"] + sizes["W"] * self._lever)
        torque = self._inertia * turning + self._lever * force + crossing
        for k, joint in reversed([*enumerate(self._tree.joints, 1)]):
            force[:, joint.parent] += force[:, k]
            torque[:, joint.parent] += torque[:, k] + self._lengths[:, k] * force[:, k]
        along = self._turns * torque[:, 1:] + self._shifts * force[:, 1:] + self._changes * self._armature
        return {"force1": force[:, :1], "torque1": torque[:, :1], "tau": along @ self._ratios}

    def mass_matrix(self) -> Float64Array:
        """Return the sums of the sizes of the terms of each entry of the mass matrix, shape (N, columns, columns)."""
        path = [np.zeros(len(self._lengths))]  # from the base to each body
        for k, joint in enumerate(self._tree.joints, 1):
            path.append(path[joint.parent] + self._lengths[:, k])
        distance = np.stack(path, axis=1)
        scales = np.zeros((len(distance), *2 * (len(self._columns),)))
        for k in range(distance.shape[1]):
            columns, bodies, turns, shifts = self._movers(k)
            arms = turns * (distance[:, k, None] - distance[:, bodies] + self._lever[k]) + shifts
            both = self._mass[k] * arms[:, :, None] * arms[:, None, :]
            both += self._inertia[k] * np.multiply.outer(turns, turns)
            steps = 1.0 + self._sums["S"][:, k]  # turned from both sides
            scales[:, columns[:, None], columns] += steps[:, None, None] * both
        moving = np.arange(6, len(self._columns))
        scales[:, moving, moving] += self._armature
        return self._columns.T @ scales @ self._columns

    def energy_and_momentum(self) -> dict[str, Float64Array]:
        """Return the error scales of kinetic and potential energy, of the linear momentum and the angular momentum
        about the origin, by name; shape (N,) each.
        """
        mass, lever, sums, sizes = self._mass, self._lever, self._sums, self._sizes
        rate, place = sums["v"] + sums["W"] * lever, sums["R"] + sums["S"] * lever
        speed = sizes["v"] + sizes["W"] * lever
        of_bodies = {
            "kinetic": mass * rate * speed + self._inertia * sums["W"] * sizes["W"],
            "potential": mass * self._gravity * place,
            "linear": mass * rate,
            "angular": mass * (rate * (sizes["R"] + lever) + place * speed) + self._inertia * sums["W"],
        }
        scales = {name: x.sum(axis=1) for name, x in of_bodies.items()}
        scales["kinetic"] += (self._armature * self._rates**2).sum(axis=1)
        return scales

    def _movers(self, body: int) -> tuple[Any, ...]:
        """Return the columns of all velocities that move a body, the bodies that they move in their parents, and how
        far they turn and shift them.
        """
        rows = [(k, 0, 0.0, 1.0) for k in range(3)] + [(k, 0, 1.0, 0.0) for k in range(3, 6)]
        while body:
            rows.append((body + 5, body, self._turns[body - 1], self._shifts[body - 1]))
            body = self._tree.joints[body - 1].parent
        columns, bodies, turns, shifts = map(np.array, zip(*rows, strict=True))
        return columns, bodies, turns, shifts


def _sizes_behind(sizes: Sizes, length: Any, rate: Any, acceleration: Any, turns: float, shifts: float) -> Sizes:
    """Return the sizes of the motion of the body behind a joint that turns and shifts it so far."""
    W, A, v, a = (sizes[letter] for letter in "WAva")
    turn, shift = turns * rate, shifts * rate
    both = W + turn
    change = (A + W * W) * length + (W + both) * v + W * both * length
    return {
        "R": sizes["R"] + length,
        "v": v + W * length + shift,
        "W": both,
        "a": a + change + shifts * acceleration + 2 * W * shift,
        "A": A + turns * acceleration + W * turn + turn * turn,
    }


def _added(sums: Sizes, sizes: Sizes, weight: Any) -> Sizes:
    """Return sums of sizes, with those of a further joint times `weight`."""
    return {name: sums[name] + weight * sizes.get(name, 1.0) for name in sums}
