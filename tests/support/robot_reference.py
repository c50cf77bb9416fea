"""The oracle of whole robots: a tree of hinges and sliders in 60-digit arithmetic, from its definitions alone.

Every joint's position is a Taylor polynomial in t, cut after t^2; the pose of each body is a product of poses.
Velocities and accelerations are read off the coefficients (`support.reference`). Forces are sums over bodies of
d/dt (m v) and of the rate of angular momentum: no recursion, and no formula for omega, alpha or an acceleration.
Jacobians and the mass matrix are what unit rates and unit accelerations give.
"""

from __future__ import annotations

import mpmath
import numpy as np

from support.reference import DIGITS, Series, angular_motion, exactly, nearest_rotation, rotation, skew, unit

LETTERS = ("R", "S", "v", "omega", "a", "alpha")


class RobotReference:
    """A robot at N states.

    Args:
        tree: the record of a robot, of which none follows another; its matrices stand for the rotations next to them.
        base: (R, S, v, omega, a, alpha) of the base, (N, 3) and (N, 3, 3); S stands for the rotation next to it.
        q: positions, (N, dof); qd and qdd likewise.
        gravity: (3,).
    """

    def __init__(self, tree, base, q, qd, qdd, gravity=(0, 0, -9.81)):
        self.tree, self.gravity = tree, exactly(gravity)
        with mpmath.workdps(DIGITS):
            R, S, v, omega, a, alpha = (exactly(part) for part in base)
            S, W = nearest_rotation(S), skew(omega)
            turn = Series(S, W @ S, (skew(alpha) + W @ W) @ S / 2)
            self.poses = [(Series(R[..., None], v[..., None], a[..., None] / 2), turn)]
            self.axes, self.points = [None], [None]
            q, qd, qdd = (exactly(part) for part in (q, qd, qdd))
            for k, joint in enumerate(tree.joints):
                origin, turn = self.poses[joint.parent]
                motion = q[:, k], qd[:, k], qdd[:, k] / 2
                point, turn = origin + turn @ exactly(joint.u)[:, None], turn @ nearest_rotation(exactly(joint.S))
                axis = unit(joint.n)
                if joint.kind == "hinge":
                    turn = turn @ rotation(axis, motion)
                else:
                    point = point + turn @ Series(*(part[:, None, None] * axis[:, None] for part in motion))
                self.axes.append((turn @ axis[:, None]).c0[..., 0])
                self.points.append(point.c0[..., 0])
                self.poses.append((point, turn))

    def motion(self, frame):
        """R, S, v, omega, a, alpha and d of a frame: arrays of mpf, (N, 3) and (N, 3, 3)."""
        with mpmath.workdps(DIGITS):
            origin, turn = self.poses[frame.body]
            d = turn @ exactly(frame.R)[:, None] + (origin - self.poses[0][0])
            place = d + self.poses[0][0]
            omega, alpha = angular_motion(turn)
            R, v, a = place.c0[..., 0], place.c1[..., 0], 2 * place.c2[..., 0]
            values = (R, turn.c0 @ nearest_rotation(exactly(frame.S)), v, omega, a, alpha)
            return dict(zip(LETTERS, values, strict=True)) | {"d": d.c0[..., 0]}

    def forces(self, *, base_counts):
        """force1, torque1 about R1, (N, 3), and tau, (N, dof): arrays of mpf."""
        with mpmath.workdps(DIGITS):
            own = [self._force_and_torque(k) for k in range(len(self.poses))]
            reference = self.poses[0][0].c0[..., 0]
            counted = own if base_counts else own[1:]
            force1 = sum((force for force, *_ in counted), start=0 * reference)
            torque1 = sum((t + np.cross(x - reference, f) for f, t, x in counted), start=0 * reference)
            tau = []
            for k, joint in enumerate(self.tree.joints, 1):
                carried = [own[i] for i in range(1, len(own)) if k in self._path(i)]
                force = sum(f for f, *_ in carried)
                torque = sum(t + np.cross(x - self.points[k], f) for f, t, x in carried)
                tau.append((self.axes[k] * (torque if joint.kind == "hinge" else force)).sum(axis=-1))
            return force1, torque1, np.stack(tau, axis=-1)

    def _path(self, body):
        found = []
        while body:
            found.append(body)
            body = self.tree.joints[body - 1].parent
        return found

    def _force_and_torque(self, body):
        """What moves the centre of mass, what turns the body about it, and where it is."""
        masses = self.tree.joints[body - 1].body if body else self.tree.base
        origin, turn = self.poses[body]
        centre, inertia = origin + turn @ exactly(masses.center_of_mass)[:, None], exactly(masses.inertia)
        half = (inertia[0, 0] + inertia[1, 1] + inertia[2, 2]) / 2
        spread = exactly(np.eye(3)) * half - inertia  # second moments of the mass
        rate = turn.c0 @ spread @ np.swapaxes(2 * turn.c2, -1, -2)
        torque = np.stack([rate[:, i, j] - rate[:, j, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=-1)
        return exactly(masses.mass) * (2 * centre.c2[..., 0] - self.gravity), torque, centre.c0[..., 0]


def errors(got, truth, axes):
    """The largest error of a component of each sample, as floats; `axes` is how many axes one sample has."""
    with mpmath.workdps(DIGITS):
        gap = np.abs(np.asarray(got).astype(object) - truth).reshape(*np.shape(truth)[: np.ndim(truth) - axes], -1)
        return gap.max(axis=-1).astype(float)
