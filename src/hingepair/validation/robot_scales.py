"""The scales by which a robot's results are compared with Pinocchio's: the size of their terms before they cancel.

Sizes grow along the way from the base: with l the length of a joint's offset (of a slider with its shift), W and A
those of angular velocity and acceleration, and a rate q' of hinges (of sliders it adds to v, not to W),

    R += l      W += abs(q')      v += W l      A += abs(q'') + W abs(q') + q'^2
    a += (A + W^2) l + (W + W2) v + W W2 l

as those of a pair do, Pinocchio's terms included. Roundings add up as well: the scale of a frame is the sum of these
sizes over the joints before it. A joint that follows another counts as often as its angle has radians, since that
angle rounds. Forces are the masses times these, summed over what a joint carries.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.tree import Frame, MassProperties, Tree
from hingepair.numeric.arrays import Float64Array
from hingepair.pair.accuracy import norm
from hingepair.pair.body_motion import BodyMotion

FRAME_MOTION_NAMES = ("R", "S", "v", "omega", "a", "alpha")
"""Names of the position, attitude, velocities and accelerations of a frame."""
_SCALE_SYMBOLS = {"R": "R", "v": "v", "omega": "W", "a": "a", "alpha": "A"}
"""Symbols of the scales of a frame's motion by the name of the quantity; the attitude's scale is by itself."""


class RobotScales:
    """The scales of a robot's results at N samples.

    Args:
        tree: the robot.
        joints: position, rate and acceleration of each joint that moves, those that follow others too; as many as
            are known, shape (N, joints) each.
        base: motion of the base; shape (N,) or (), with as many derivatives.
        gravity: acceleration of free fall [m/s^2]; shape (3,).
    """

    def __init__(self, tree: Tree, joints: list[Float64Array], base: BodyMotion, gravity: Float64Array) -> None:
        self._tree = tree
        count, number = joints[0].shape[0], len(tree.joints)
        zero = np.zeros((count, number))
        self._shift, self._rates, self._changes = (np.abs(one) for one in (*joints, zero, zero)[:3])
        self._gravity = float(norm(gravity))
        parts = {letter: getattr(base, letter, None) for letter in ("R", "v", "omega", "a", "alpha")}
        own = {letter: np.zeros(count) + (0.0 if part is None else norm(part)) for letter, part in parts.items()}
        size = {"R": own["R"], "v": own["v"], "W": own["omega"], "A": own["alpha"]}
        size["a"] = own["a"] + own["omega"] * own["v"]
        self._sizes = [size]
        self._sums = [{**size, "S": np.ones(count)}]
        self._lengths = [np.zeros(count)]
        for k, joint in enumerate(tree.joints):
            slides = joint.kind == "slider"
            length = float(norm(joint.u)) + (self._shift[:, k] if slides else 0.0)
            size = _grown(self._sizes[joint.parent], length, self._rates[:, k], self._changes[:, k], slides)
            self._sizes.append(size)
            turns = 1.0 if joint.mimic is None or slides else 1.0 + self._shift[:, k]
            self._sums.append(_added(self._sums[joint.parent], size, turns))
            self._lengths.append(length + np.zeros(count))
        self._distances = self._largest_distances()

    def motion(self, frame: Frame) -> dict[str, Float64Array]:
        """Return the scales of R, S, v, omega, a and alpha of a frame; shape (N,) each."""
        size = _grown(self._sizes[frame.body], float(norm(frame.R)), 0.0, 0.0, slides=False)
        total = _added(self._sums[frame.body], size, 1.0)
        return {"S": total["S"], **{name: total[letter] for name, letter in _SCALE_SYMBOLS.items()}}

    def jacobian(self, frame: Frame) -> Float64Array:
        """Return the scales of the Jacobian of a frame, of the six columns of the base before those of the joints.

        Pinocchio has the joints' motions at the world's origin first, so that positions count. Shape
        (N, 6, 6 + joints).
        """
        steps = self._sums[frame.body]["S"][:, None]
        place = self._sizes[frame.body]["R"] + float(norm(frame.R))
        found = np.zeros((len(place), 6, 6 + len(self._tree.joints)))
        for body in np.flatnonzero(self._carries[:, frame.body]):
            for column, slides in self._columns(int(body)):
                lever = (place + self._sizes[body]["R"])[:, None]
                found[:, :3, column] = steps if slides else lever * steps
                found[:, 3:, column] = 0.0 if slides else steps
        return found

    def forces(self) -> tuple[Float64Array, Float64Array]:
        """Return the scales of what acts on each body at its reference point: force [N] and torque [N m].

        The base is the first; shape (N, 1 + joints) each.
        """
        count, bodies = len(self._lengths[0]), len(self._lengths)
        force, torque = np.zeros((2, count, bodies))
        for k in reversed(range(bodies)):
            masses, sums, size = self._masses(k), self._sums[k], self._sizes[k]
            lever, inertia = float(norm(masses.center_of_mass)), float(norm(masses.inertia.ravel()))
            turning = sums["A"] + sums["S"] * size["W"] ** 2
            own = abs(masses.mass) * (sums["a"] + turning * lever + self._gravity * sums["S"])
            force[:, k] += own
            # Pinocchio adds v x m v, which rounds before it vanishes.
            torque[:, k] += (
                inertia * turning + lever * own + abs(masses.mass) * sums["v"] * (size["v"] + size["W"] * lever)
            )
            if k:
                parent = self._tree.joints[k - 1].parent
                force[:, parent] += force[:, k]
                torque[:, parent] += torque[:, k] + self._lengths[k] * force[:, k]
        return force, torque

    def rotor_efforts(self) -> Float64Array:
        """Return what each joint's rotor adds to its effort; shape (N, joints)."""
        return np.asarray(self._changes * [joint.armature for joint in self._tree.joints])

    def mass_matrix(self) -> Float64Array:
        """Return the scales of the mass matrix in the base's six velocities and the rates of all joints.

        Shape (N, 6 + joints, 6 + joints).
        """
        joints = len(self._tree.joints)
        found = np.zeros((len(self._lengths[0]), 6 + joints, 6 + joints))
        for k in range(1 + joints):
            masses, steps = self._masses(k), 1.0 + self._sums[k]["S"]  # inertias are turned from both sides
            lever, inertia = float(norm(masses.center_of_mass)), float(norm(masses.inertia.ravel()))
            carriers = [column for body in np.flatnonzero(self._carries[:, k]) for column in self._columns(int(body))]
            bodies = [max(column - 5, 0) for column, _ in carriers]
            slides = np.array([slides for _, slides in carriers])
            arms = np.where(slides, 1.0, self._distances[:, bodies, k] + lever)
            place = np.array([column for column, _ in carriers])
            both = abs(masses.mass) * arms[:, :, None] * arms[:, None, :]
            both += inertia * (~slides[:, None] & ~slides[None, :])
            found[:, place[:, None], place[None, :]] += steps[:, None, None] * both
        for k, joint in enumerate(self._tree.joints):
            found[:, k + 6, k + 6] += joint.armature
        return found

    def energy_and_momentum(self) -> dict[str, Float64Array]:
        """Return the scales of kinetic and potential energy and of both momenta about the origin; shape (N,) each."""
        count = len(self._lengths[0])
        found = {name: np.zeros(count) for name in ("kinetic", "potential", "linear", "angular")}
        for k in range(len(self._lengths)):
            masses, sums, size = self._masses(k), self._sums[k], self._sizes[k]
            lever, inertia = float(norm(masses.center_of_mass)), float(norm(masses.inertia.ravel()))
            mass = abs(masses.mass)
            rate, place = sums["v"] + sums["W"] * lever, sums["R"] + sums["S"] * lever
            found["kinetic"] += mass * rate * (size["v"] + size["W"] * lever) + inertia * sums["W"] * size["W"]
            found["potential"] += mass * self._gravity * place
            found["linear"] += mass * rate
            found["angular"] += mass * (rate * (size["R"] + lever) + place * (size["v"] + size["W"] * lever))
            found["angular"] += inertia * sums["W"]
        for k, joint in enumerate(self._tree.joints):
            found["kinetic"] += joint.armature * self._rates[:, k] ** 2
        return found

    def _masses(self, body: int) -> MassProperties:
        return self._tree.joints[body - 1].body if body else self._tree.base

    def _columns(self, body: int) -> list[tuple[int, bool]]:
        """Return the columns of a body's joint, of the base six, and whether its motion is a shift."""
        if body == 0:
            return [(column, column < 3) for column in range(6)]
        return [(body + 5, self._tree.joints[body - 1].kind == "slider")]

    def _largest_distances(self) -> Float64Array:
        """Return upper bounds on the distance [m] from each body to each that it carries; set `_carries`.

        The shape of the bounds is (N, bodies, bodies), 0 where a body does not carry the other; that of `_carries`,
        whether it does, is (bodies, bodies).
        """
        bodies = len(self._lengths)
        self._carries: NDArray[Any] = np.eye(bodies, dtype=bool)
        found = np.zeros((len(self._lengths[0]), bodies, bodies))
        for k, joint in enumerate(self._tree.joints, 1):
            above = self._carries[:, joint.parent]
            self._carries[above, k] = True
            found[:, above, k] = found[:, above, joint.parent] + self._lengths[k][:, None]
        return found


def _grown(size: dict[str, Any], length: Any, rate: Any, change: Any, slides: bool) -> dict[str, Any]:
    """Return the sizes behind a joint, of those before it."""
    W, A, v, a = (size[letter] for letter in "WAva")
    turn, shift = (0.0, rate) if slides else (rate, 0.0)
    both = W + turn
    found = {"R": size["R"] + length, "W": both, "v": v + W * length + shift}
    found["A"] = A + (0.0 if slides else change) + W * turn + turn * turn
    found["a"] = a + (A + W * W) * length + (W + both) * v + W * both * length
    if slides:
        found["a"] = found["a"] + change + 2 * W * rate
    return found


def _added(sums: dict[str, Any], size: dict[str, Any], weight: Any) -> dict[str, Any]:
    """Return the sums of sizes with those of a further joint."""
    more = {letter: sums[letter] + weight * value for letter, value in size.items()}
    return {**more, "S": sums["S"] + weight}
