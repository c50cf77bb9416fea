"""Exact results of robots in sixty-digit arithmetic: every pose a product of Taylor polynomials in t, as of pairs in
`hingepair.bench.truth`; forces are sums over bodies of the rates of their momenta.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mpmath
import numpy as np
from numpy.typing import ArrayLike

from hingepair.bench.truth import (
    DIGITS,
    Array,
    Series,
    angular_motion,
    exactly,
    given_motion,
    nearest_rotation,
    rotation,
    unit,
)

LETTERS = ("R", "S", "v", "omega", "a", "alpha")  # of a frame's motion


class Required(NamedTuple):
    """Force and torque that the motion of a body requires."""

    force: Array  # (N, 3)
    torque: Array  # about the centre of mass
    centre: Array  # where that is


def required(origin: Series, turn: Series, body: Sequence[Any], gravity: Array) -> Required:
    """Return what the motion of a body requires beside gravity: the rates of the momenta of its mass.

    Args:
        origin: the reference point.
        turn: rotation from body axes.
        body: mass, centre of mass and inertia about it, body axes.
        gravity: (3,), which adds no force of its own.
    """
    mass, centre, J = (exactly(part) for part in body)
    place = origin + turn @ centre[:, None]
    spread = exactly(np.eye(3)) * (J[0, 0] + J[1, 1] + J[2, 2]) / 2 - J  # second moments of the mass
    rate = turn.c0 @ spread @ np.swapaxes(2 * turn.c2, -1, -2)
    torque = np.stack([rate[:, i, j] - rate[:, j, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=-1)
    return Required(mass * (2 * place.c2[..., 0] - gravity), torque, place.c0[..., 0])


class ExactRobot:
    """A robot at N states.

    Args:
        tree: the record of the robot; its matrices stand for the rotations next to them.
        q: positions, (N, dof); qd and qdd likewise.
        qd: zero if None.
        qdd: zero if None.
        base: R, S, v, omega, a, alpha of the base, (N, 3) and (N, 3, 3); None for a base at rest at the origin.
        gravity: (3,).
    """

    def __init__(
        self,
        tree: Any,
        q: Any,
        qd: Any = None,
        qdd: Any = None,
        base: Sequence[Any] | None = None,
        gravity: Sequence[Any] | Array = (0, 0, -9.81),
    ) -> None:
        self._tree, self._gravity = tree, exactly(gravity)
        shape = np.shape(q)
        self._columns, self._ratios, offsets = _followers(tree)
        self._dof = shape[1]
        if base is None:
            zero = np.zeros((shape[0], 3))
            base = (zero, np.broadcast_to(np.eye(3), (shape[0], 3, 3)), zero, zero, zero, zero)
        with mpmath.workdps(DIGITS):
            q, qd, qdd = (
                (exactly(np.zeros(shape)) if c is None else exactly(c))[:, self._columns] * self._ratios
                for c in (q, qd, qdd)
            )
            q = q + offsets
            self.poses = [given_motion(base)]
            self._axes = [exactly(np.zeros(3))]
            self._points = [self.poses[0][0].c0[..., 0]]
            for k, joint in enumerate(tree.joints):
                origin, turn = self.poses[joint.parent]
                motion = q[:, k], qd[:, k], qdd[:, k] / 2
                point, turn = origin + turn @ exactly(joint.u)[:, None], turn @ nearest_rotation(exactly(joint.S))
                axis = unit(joint.n)
                turns, shifts = map(mpmath.mpf, joint.axis)
                point = point + turn @ Series(*(shifts * part[:, None, None] * axis[:, None] for part in motion))
                turn = turn @ rotation(axis, tuple(turns * part for part in motion))
                self._axes.append((turn @ axis[:, None]).c0[..., 0])
                self._points.append(point.c0[..., 0])
                self.poses.append((point, turn))

    def motion(self, frame: Any) -> dict[str, Array]:
        """Return R, S, v, omega, a, alpha and d of a frame of the tree; (N, 3) and (N, 3, 3)."""
        with mpmath.workdps(DIGITS):
            origin, turn = self.poses[frame.body]
            d = turn @ exactly(frame.R)[:, None] + (origin - self.poses[0][0])
            place = d + self.poses[0][0]
            omega, alpha = angular_motion(turn)
            R, v, a = place.c0[..., 0], place.c1[..., 0], 2 * place.c2[..., 0]
            values = (R, turn.c0 @ nearest_rotation(exactly(frame.S)), v, omega, a, alpha)
            return dict(zip(LETTERS, values, strict=True)) | {"d": d.c0[..., 0]}

    def forces(self, *, base_counts: bool = True) -> tuple[Array, Array, Array]:
        """Return force1, torque1 about R1, (N, 3), and tau, (N, dof).

        Args:
            base_counts: whether the base's own mass counts in force1 and torque1.
        """
        with mpmath.workdps(DIGITS):
            own = [self._required(k) for k in range(len(self.poses))]
            reference = self._points[0]
            counted = own if base_counts else own[1:]
            force1 = sum((force for force, *_ in counted), start=0 * reference)
            torque1 = sum((t + np.cross(x - reference, f) for f, t, x in counted), start=0 * reference)
            tau = exactly(np.zeros((len(reference), self._dof)))
            for k, joint in enumerate(self._tree.joints, 1):
                carried = [own[i] for i in range(1, len(own)) if k in self._path(i)]
                force = sum(f for f, *_ in carried)
                torque = sum(t + np.cross(x - self._points[k], f) for f, t, x in carried)
                effort = (self._axes[k] * (joint.axis.turns * torque + joint.axis.shifts * force)).sum(axis=-1)
                tau[:, self._columns[k - 1]] += self._ratios[k - 1] * effort
            return force1, torque1, tau

    def _path(self, body: int) -> list[int]:
        """Return the numbers, from 1, of the joints from a body to the base."""
        found = []
        while body:
            found.append(body)
            body = self._tree.joints[body - 1].parent
        return found

    def _required(self, body: int) -> Required:
        masses = self._tree.joints[body - 1].body if body else self._tree.base
        parts = masses.mass, masses.centre_of_mass, masses.inertia
        return required(*self.poses[body], parts, self._gravity)


def _followers(tree: Any) -> tuple[list[int], Array, Array]:
    """Return, of each joint, the column of its coordinate, and its ratio and offset to that."""
    columns = {joint.name: i for i, joint in enumerate(tree.coordinates)}
    own = [(joint, joint.mimic) for joint in tree.joints]
    leaders = [joint if mimic is None else tree.joints[mimic.leader - 1] for joint, mimic in own]
    ratios = [1.0 if mimic is None else mimic.multiplier for _, mimic in own]
    offsets = [0.0 if mimic is None else mimic.offset for _, mimic in own]
    return [columns[joint.name] for joint in leaders], exactly(ratios), exactly(offsets)


def exact_slopes(function: Any, arguments: Sequence[Any], by: int) -> Array:
    """Return the derivatives (N, m, n) of a function's results (N, m) by one of its arguments, (N, n).

    Central differences of steps of 10^-20 are right to some 35 digits.
    """
    with mpmath.workdps(DIGITS):
        given = [exactly(one) for one in arguments]
        n, step = given[by].shape[1], mpmath.mpf(10) ** -20
        columns = []
        for k in range(n):
            near = []
            for sign in (1, -1):
                moved = given[by].copy()
                moved[:, k] += sign * step
                near.append(function(*given[:by], moved, *given[by + 1 :]))
            columns.append((near[0] - near[1]) / (2 * step))
        return np.stack(columns, axis=-1)


def attitude_of_rotvec(rotvec: ArrayLike) -> Array:
    """Return the rotations (N, 3, 3) of rotation vectors (N, 3)."""
    with mpmath.workdps(DIGITS + 320):
        vector = exactly(rotvec)
        angle = np.frompyfunc(mpmath.sqrt, 1, 1)((vector * vector).sum(axis=-1))
        axis = vector / np.where(angle == 0, mpmath.mpf(1), angle)[..., None]
        zero = 0 * angle
        return rotation(axis, (angle, zero, zero)).c0


def attitude_of_quaternion(quat_xyzw: ArrayLike) -> Array:
    """Return the rotations (N, 3, 3) of quaternions (N, 4) of any length: q e q* for each e of Hamilton's i, j, k."""
    with mpmath.workdps(DIGITS):
        x, y, z, w = np.moveaxis(unit(quat_xyzw), -1, 0)
        columns = []
        for e in np.eye(3, dtype=int):
            left = _hamilton((w, x, y, z), (0, *e.tolist()))
            columns.append(np.stack(_hamilton(left, (w, -x, -y, -z))[1:], axis=-1))
        return np.stack(columns, axis=-1)


def _hamilton(p: Sequence[Any], q: Sequence[Any]) -> tuple[Any, ...]:
    """Return the product p q of quaternions (w, x, y, z)."""
    a, b, c, d = p
    e, f, g, h = q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )
