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
from hingepair.validation.pinocchio_twin import LETTERS, joint_rules, with_base

Sizes = dict[str, Any]
"""Sizes of positions R and d (from the base's origin), velocities v, angular velocities W, and accelerations a and A;
sums have S beside them, the number of rotations."""


class Scales:
    """Scales of the errors of a robot's outputs at N samples.

    Args:
        tree: the robot.
        coordinates: q and, as far as known, its derivatives; shape (N, dof) each.
        base: motion of the base; shape (N,), with as many derivatives.
        gravity: acceleration of free fall [m/s^2]; shape (3,).
        velocities: from the robot's velocities to those of the base and the coordinates; shape (N, 6 + dof, columns).
    """

    def __init__(
        self,
        tree: Tree,
        coordinates: list[Float64Array],
        base: BodyMotion,
        gravity: ArrayLike = (0.0, 0.0, 0.0),
        velocities: Float64Array | None = None,
    ) -> None:
        ratios, offsets = joint_rules(tree)
        q, *rates = (one @ ratios.T for one in coordinates)
        places, self._rates, self._changes = (np.abs(x) for x in (q + offsets, *rates, *2 * [0.0 * q])[:3])
        own = with_base(np.abs(ratios))
        self._columns: Any = own if velocities is None else own @ np.abs(velocities)
        self._gravity = float(norm(gravity))
        self._armature = np.array([0.0] * 6 + [joint.armature for joint in tree.joints])
        self._mass = np.array([abs(one.mass) for one in tree.bodies])
        self._lever = np.array([norm(one.centre_of_mass) for one in tree.bodies])
        self._inertia = np.array([norm(one.inertia.ravel()) for one in tree.bodies])
        R, v, W, a, A = (
            np.zeros(len(q)) + (0.0 if (part := getattr(base, letter)) is None else norm(part))
            for letter in ("R", "v", "omega", "a", "alpha")
        )
        sizes: list[Sizes] = [{"R": R, "d": 0.0 * R, "v": v, "W": W, "a": a + W * v, "A": A}]
        sums: list[Sizes] = [{**sizes[0], "S": np.ones(len(q))}]
        # How far each velocity, of the base and of joints, turns each body about a point of `seats`, and shifts it.
        turns, shifts = np.zeros((2, 1 + len(tree.joints), 6 + len(tree.joints)))
        turns[0, 3:6] = shifts[0, :3] = 1
        for k, joint in enumerate(tree.joints, 1):
            turn, shift = abs(joint.axis.turns), abs(joint.axis.shifts)
            turns[k], shifts[k] = turns[joint.parent], shifts[joint.parent]
            turns[k, 5 + k], shifts[k, 5 + k] = turn, shift
            place, rate, change = (one[:, k - 1] for one in (places, self._rates, self._changes))
            length = float(norm(joint.u)) + shift * place  # from the parent's reference point
            sizes.append(_sizes_behind(sizes[joint.parent], length, rate, change, turn, shift))
            weight = 1.0 if joint.mimic is None else 1.0 + turn * place
            sums.append(_added(sums[joint.parent], sizes[-1], weight))
        self._turns, self._shifts, self._seats = turns, shifts, [*6 * [0], *range(1, len(sizes))]
        self._sizes, self._sums = (
            {name: np.stack([one[name] for one in part], axis=1) for name in part[0]} for part in (sizes, sums)
        )

    def motion(self, frame: Frame) -> dict[str, Float64Array]:
        """Return the error scales of R, S, v, omega, a, alpha and d of a frame by name; shape (N,) each."""
        size, total = ({name: x[:, frame.body] for name, x in one.items()} for one in (self._sizes, self._sums))
        total = _added(total, _sizes_behind(size, float(norm(frame.R)), 0.0, 0.0, 0.0, 0.0), 1.0)
        return {name: total[{"omega": "W", "alpha": "A"}.get(name, name)] for name in (*LETTERS, "d")}

    def jacobian(self, frame: Frame) -> Float64Array:
        """Return the error scales of the Jacobian of a frame, shape (N, 6, columns).

        Pinocchio first computes the motions of the joints at the origin of the world; therefore positions count.
        """
        turns, shifts, R = self._turns[frame.body], self._shifts[frame.body], self._sizes["R"]
        lever = R[:, frame.body, None] + float(norm(frame.R)) + R[:, self._seats]
        rows = [turns * lever + shifts] * 3 + [np.broadcast_to(turns, lever.shape)] * 3
        scales: Float64Array = np.stack(rows, axis=1) * self._sums["S"][:, frame.body, None, None] @ self._columns
        return scales

    def _arms(self) -> Float64Array:
        """Return how far each velocity moves the centre of mass of each body; shape (N, bodies, 6 + joints)."""
        distance = self._sizes["d"]
        levers = distance[:, :, None] - distance[:, None, self._seats] + self._lever[:, None]
        return np.asarray(self._turns * levers + self._shifts)

    def forces(self) -> Float64Array:
        """Return the error scales of the forces along the robot's velocities, shape (N, columns)."""
        sums, sizes = self._sums, self._sizes
        turning = sums["A"] + sums["S"] * sizes["W"] ** 2
        force = self._mass * (sums["a"] + turning * self._lever + self._gravity * sums["S"])
        # Pinocchio adds v x m v, whose terms are rounded before they cancel.
        crossing = self._mass * sums["v"] * (sizes["v"] + sizes["W"] * self._lever)
        along = (force[:, None] @ self._arms())[:, 0] + (self._inertia * turning + crossing) @ self._turns
        along[:, 6:] += self._changes * self._armature[6:]
        return np.asarray(along[:, None] @ self._columns)[:, 0]

    def mass_matrix(self) -> Float64Array:
        """Return the sums of the sizes of the terms of each entry of the mass matrix, shape (N, columns, columns)."""
        arms, steps = self._arms(), 1.0 + self._sums["S"]  # turned from both sides
        weighted = (steps * self._mass)[..., None] * arms, (steps * self._inertia)[..., None] * self._turns
        scales = np.swapaxes(arms, 1, 2) @ weighted[0] + self._turns.T @ weighted[1] + np.diag(self._armature)
        return np.asarray(np.swapaxes(self._columns, -1, -2) @ scales @ self._columns)

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
        scales["kinetic"] += self._rates**2 @ self._armature[6:]
        return scales


def _sizes_behind(sizes: Sizes, length: Any, rate: Any, acceleration: Any, turns: float, shifts: float) -> Sizes:
    """Return the sizes of the motion of the body behind a joint that turns and shifts it so far."""
    W, A, v, a = (sizes[letter] for letter in "WAva")
    turn, shift = turns * rate, shifts * rate
    both = W + turn
    change = (A + W * W) * length + (W + both) * v + W * both * length
    return {
        "R": sizes["R"] + length,
        "d": sizes["d"] + length,
        "v": v + W * length + shift,
        "W": both,
        "a": a + change + shifts * acceleration + 2 * W * shift,
        "A": A + turns * acceleration + W * turn + turn * turn,
    }


def _added(sums: Sizes, sizes: Sizes, weight: Any) -> Sizes:
    """Return sums of sizes, with those of a further joint times `weight`."""
    return {name: sums[name] + weight * sizes.get(name, 1.0) for name in sums}
