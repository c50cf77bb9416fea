"""A tree of joints in 60 digits: everything that can be asked of it, from the poses and momenta of its bodies alone.

Every pose is a product of Taylor polynomials in t, as of pairs in `hingepair.bench.truth`; forces are sums over
bodies of the rates of their momenta. The trees are records of the library, or plain ones made here, from the numbers
of a pair or from Pinocchio's reading of a URDF file.
"""

from __future__ import annotations

import functools
from types import SimpleNamespace

import mpmath
import numpy as np
import pinocchio as pin

from hingepair.bench.truth import (
    DIGITS,
    Series,
    angular_motion,
    exactly,
    given_motion,
    nearest_rotation,
    rotation,
    skew,
    unit,
)

LETTERS = ("R", "S", "v", "omega", "a", "alpha")  # of a frame's motion
NOTHING = SimpleNamespace(mass=0.0, centre_of_mass=np.zeros(3), inertia=np.zeros((3, 3)))


def mass_record(mass, centre_of_mass, inertia):
    return SimpleNamespace(mass=mass, centre_of_mass=np.array(centre_of_mass), inertia=np.array(inertia))


def tree_record(joints, base):
    """A tree of joints (parent, u, S, n, (turns, shifts), masses), each with a coordinate of its own."""
    made = []
    for k, (parent, u, S, n, (turns, shifts), body) in enumerate(joints):
        axis = type("Axis", (tuple,), {"turns": turns, "shifts": shifts})((turns, shifts))
        made.append(SimpleNamespace(name=str(k), parent=parent, u=u, S=S, n=n, axis=axis, body=body, mimic=None))
    return SimpleNamespace(joints=made, coordinates=made, base=base)


def tree_of_pair(pair):
    """The tree of a pair and the frame of its body 2; masses about the hinge point, in body 1's axes at psi = 0."""
    C, one, two = np.asarray(pair.home), pair.body1, pair.body2
    with mpmath.workdps(DIGITS):
        C = nearest_rotation(exactly(C))
        arm = -C @ exactly(pair.u2)
        carried = NOTHING
        if two is not None:
            inertia = C @ exactly(two.inertia) @ C.T
            carried = mass_record(two.mass, arm + C @ exactly(two.centre_of_mass), inertia)
    base = NOTHING if one is None else mass_record(one.mass, one.centre_of_mass, one.inertia)
    tree = tree_record([(0, pair.u1, np.eye(3), np.asarray(pair.n), (1, 0), carried)], base)
    return tree, SimpleNamespace(body=1, R=arm, S=C)


def tree_of_model(model, link):
    """The tree of Pinocchio's model of joints with one coordinate, and the frame of a link."""

    def masses(inertia):
        return mass_record(float(inertia.mass), inertia.lever, inertia.inertia)

    joints = []
    for k in range(1, model.njoints):
        linear, angular = np.split(np.ravel(model.joints[k].createData().S), 2)
        axis, n = ((0, 1), linear) if linear.any() else ((1, 0), angular)
        place = model.jointPlacements[k]
        joints.append((model.parents[k], place.translation, place.rotation, n, axis, masses(model.inertias[k])))
    frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
    place = SimpleNamespace(
        body=int(frame.parentJoint), R=np.array(frame.placement.translation), S=np.array(frame.placement.rotation)
    )
    return tree_record(joints, masses(model.inertias[0])), place


def followers(tree):
    """Of each joint, the column of its coordinate, and its ratio and offset to that."""
    columns = {joint.name: i for i, joint in enumerate(tree.coordinates)}
    leaders, ratios, offsets = zip(*((joint.mimic or (joint.name, 1.0, 0.0)) for joint in tree.joints), strict=True)
    return [columns[leader] for leader in leaders], exactly(ratios), exactly(offsets)


def twice_the_odd_part(matrices):
    """Of (N, 3, 3), the vectors (N, 3) of M - M^T."""
    return np.stack([matrices[:, i, j] - matrices[:, j, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=-1)


class Exact:
    """A tree at N states.

    Args:
        tree: the record; its matrices stand for the rotations next to them.
        frame: the frame that is asked for.
        free: whether forces move the base, so that its rates and its mass count.
        given: q, qd, qdd (N, dof) and R, S, v, omega, a, alpha of the base; what is absent is zero, or the identity.
        gravity: (3,).
    """

    def __init__(self, tree, frame, free, given, gravity=(0, 0, -9.81)):
        self.tree, self.frame, self.free, self.gravity = tree, frame, free, gravity
        self.count, self.dof = np.shape(given["q"])
        self.zero = np.zeros((self.count, 3))
        still = dict.fromkeys(LETTERS, self.zero) | {"S": np.broadcast_to(np.eye(3), (self.count, 3, 3))}
        still |= dict.fromkeys(("qd", "qdd"), np.zeros((self.count, self.dof)))
        self.given = still | {name: value for name, value in given.items() if name in (*still, "q")}
        self.columns, self.ratios, offsets = followers(tree)
        with mpmath.workdps(DIGITS):
            q, qd, qdd = (exactly(self.given[name])[:, self.columns] * self.ratios for name in ("q", "qd", "qdd"))
            self.poses = [given_motion([self.given[letter] for letter in LETTERS])]
            for k, joint in enumerate(tree.joints):
                origin, turn = self.poses[joint.parent]
                motion = q[:, k] + offsets[k], qd[:, k], qdd[:, k] / 2
                point, turn = origin + turn @ exactly(joint.u)[:, None], turn @ nearest_rotation(exactly(joint.S))
                axis = unit(joint.n)
                turns, shifts = map(mpmath.mpf, joint.axis)
                point = point + turn @ Series(*(shifts * part[:, None, None] * axis[:, None] for part in motion))
                self.poses.append((point, turn @ rotation(axis, tuple(turns * part for part in motion))))

    def at(self, gravity=None, **given):
        """The same tree with other values of what is named."""
        gravity = self.gravity if gravity is None else gravity
        return Exact(self.tree, self.frame, self.free, self.given | given, gravity)

    def motion_of(self, frame):
        """R, S, v, omega, a, alpha and d of a frame of the tree."""
        with mpmath.workdps(DIGITS):
            origin, turn = self.poses[frame.body]
            d = turn @ exactly(frame.R)[:, None] + (origin - self.poses[0][0])
            place = d + self.poses[0][0]
            omega, alpha = angular_motion(turn)
            R, v, a = place.c0[..., 0], place.c1[..., 0], 2 * place.c2[..., 0]
            values = (R, turn.c0 @ nearest_rotation(exactly(frame.S)), v, omega, a, alpha)
            return dict(zip(LETTERS, values, strict=True)) | {"d": d.c0[..., 0]}

    @functools.cached_property
    def motion(self):
        """R, S, v, omega, a, alpha and d of the frame."""
        return self.motion_of(self.frame)

    def masses(self, body):
        """Mass, centre of mass and inertia of a body, and the second moments of its mass."""
        own = self.tree.joints[body - 1].body if body else self.tree.base
        mass, centre, inertia = (exactly(part) for part in (own.mass, own.centre_of_mass, own.inertia))
        return mass[()], centre, exactly(np.eye(3)) * (np.trace(inertia) / 2) - inertia

    def required(self, body):
        """The force that a body's motion requires beside gravity, the torque about its centre, and that centre."""
        (origin, turn), (mass, centre, spread) = self.poses[body], self.masses(body)
        place = origin + turn @ centre[:, None]
        rate = turn.c0 @ spread @ np.swapaxes(2 * turn.c2, -1, -2)
        return mass * (2 * place.c2[..., 0] - exactly(self.gravity)), twice_the_odd_part(rate), place.c0[..., 0]

    @functools.cached_property
    def wrenches(self):
        """(force, torque) about its joint's point, or the base's, of each body and all that it carries."""
        carried = [[k] if k or self.free else [] for k in range(len(self.poses))]
        for k, joint in reversed([*enumerate(self.tree.joints, 1)]):
            carried[joint.parent] += carried[k]
        with mpmath.workdps(DIGITS):
            own, found = [self.required(k) for k in range(len(self.poses))], []
            for (origin, _), bodies in zip(self.poses, carried, strict=True):
                each = [own[body] for body in bodies]
                force = sum((f for f, *_ in each), start=exactly(self.zero))
                turning = (t + np.cross(x - origin.c0[..., 0], f) for f, t, x in each)
                found.append((force, sum(turning, start=exactly(self.zero))))
            return found

    @functools.cached_property
    def forces(self):
        """(force1, torque1, tau)."""
        with mpmath.workdps(DIGITS):
            tau = exactly(np.zeros((self.count, self.dof)))
            for k, joint in enumerate(self.tree.joints):
                force, torque = self.wrenches[k + 1]
                acting = joint.axis.turns * torque + joint.axis.shifts * force
                tau[:, self.columns[k]] += self.ratios[k] * (acting * self.axis(k + 1)).sum(axis=-1)
            return *self.wrenches[0], tau

    def axis(self, body):
        return (self.poses[body][1] @ unit(self.tree.joints[body - 1].n)[:, None]).c0[..., 0]

    @property
    def efforts(self):
        """Forces along the rates: (N, 6 + dof) of a free base, else (N, dof)."""
        return np.concatenate(self.forces, axis=-1) if self.free else self.forces[2]

    def _units(self, linear, angular, joints):
        """The tree with each of its rates, or accelerations, one and the others zero."""
        rest = {linear: self.zero, angular: self.zero, joints: np.zeros((self.count, self.dof))}
        for name, size in ((linear, 3), (angular, 3), (joints, self.dof)):
            for k in range(size if self.free or name == joints else 0):
                column = np.zeros((self.count, size))
                column[:, k] = 1
                yield rest | {name: column}

    def jacobian(self):
        """Of (v, omega) of the frame by the rates."""
        columns = [self.at(**unit).motion for unit in self._units("v", "omega", "qd")]
        return np.stack([np.concatenate((m["v"], m["omega"]), axis=-1) for m in columns], axis=-1)

    def acceleration_bias(self):
        """(a, alpha) of the frame that the rates cause."""
        motion = self.at(a=self.zero, alpha=self.zero, qdd=0 * self.given["qdd"]).motion
        return np.concatenate((motion["a"], motion["alpha"]), axis=-1)

    def mass_matrix(self):
        still = {"v": self.zero, "omega": self.zero, "qd": 0 * self.given["qd"], "gravity": (0, 0, 0)}
        units = self._units("a", "alpha", "qdd")
        return np.stack([self.at(**still | unit).efforts for unit in units], axis=-1)

    def bias_forces(self):
        base = {"a": self.zero, "alpha": self.zero} if self.free else {}
        return self.at(**base, qdd=0 * self.given["qdd"]).efforts

    def gravity_forces(self):
        still = dict.fromkeys(("v", "omega", "a", "alpha"), self.zero)
        return self.at(**still, qd=0 * self.given["qd"], qdd=0 * self.given["qdd"]).efforts

    def accelerations(self, acting, wrench=None):
        """What forces along the rates cause, and a force and torque (N, 6) on the frame."""
        with mpmath.workdps(DIGITS):
            remaining = exactly(acting) - self.bias_forces()
            if wrench is not None:
                remaining = remaining + (np.swapaxes(self.jacobian(), -1, -2) @ exactly(wrench)[..., None])[..., 0]
            systems = zip(self.mass_matrix().tolist(), remaining.tolist(), strict=True)
            return np.array([list(mpmath.lu_solve(mpmath.matrix(M), b)) for M, b in systems], dtype=object)

    @functools.cached_property
    def sums(self):
        """Of all bodies that count: mass, mass times centre, kinetic energy, linear and angular momentum."""
        with mpmath.workdps(DIGITS):
            mass = kinetic = mpmath.mpf(0)
            weighed = linear = angular = exactly(self.zero)
            for body, (origin, turn) in enumerate(self.poses):
                if not body and not self.free:
                    continue
                m, c, spread = self.masses(body)
                centre = origin + turn @ c[:, None]
                spin = twice_the_odd_part(turn.c0 @ spread @ np.swapaxes(turn.c1, -1, -2))
                turning = turn.c1 @ spread @ np.swapaxes(turn.c1, -1, -2)
                place, rate = centre.c0[..., 0], centre.c1[..., 0]
                mass, weighed, linear = mass + m, weighed + m * place, linear + m * rate
                angular = angular + m * np.cross(place, rate) + spin
                kinetic = kinetic + (m * (rate * rate).sum(axis=-1) + np.trace(turning, axis1=-2, axis2=-1)) / 2
            return mass, weighed, kinetic, linear, angular

    def centre_of_mass(self):
        return self.sums[1] / self.sums[0]

    def centre_of_mass_jacobian(self):
        columns = [self.at(**unit).sums for unit in self._units("v", "omega", "qd")]
        return np.stack([linear / mass for mass, _, _, linear, _ in columns], axis=-1)

    def energy(self):
        return {"kinetic": self.sums[2], "potential": -(self.sums[1] * exactly(self.gravity)).sum(axis=-1)}

    def momentum(self):
        return {"linear": self.sums[3], "angular": self.sums[4]}

    def slopes(self, value, by):
        """The derivatives of `value(tree)`, (N, m), by one of q, qd, qdd.

        Central differences of steps of 10^-20 are right to some 35 digits.
        """
        with mpmath.workdps(DIGITS):
            step = exactly(np.eye(self.dof)) * mpmath.mpf(10) ** -20
            ends = [[value(self.at(**{by: exactly(self.given[by]) + side})) for side in (h, -h)] for h in step]
            return np.stack([(after - before) / (2 * step[0, 0]) for after, before in ends], axis=-1)

    def torque_slopes(self):
        return {f"tau_{by}": self.slopes(lambda at: at.forces[2], by) for by in ("q", "qd", "qdd")}

    def acceleration_slopes(self, tau):
        """By q and qd of M^-1 (tau - bias); by tau, M^-1."""
        with mpmath.workdps(DIGITS):
            inverse = np.array([mpmath.inverse(mpmath.matrix(M)).tolist() for M in self.mass_matrix().tolist()])
            moved = self.at(qdd=self.accelerations(tau))
            found = {f"qdd_{by}": -inverse @ moved.slopes(lambda at: at.forces[2], by) for by in ("q", "qd")}
            return found | {"qdd_tau": inverse}


def attitude_of_rotvec(rotvec):
    """The rotations (N, 3, 3) of rotation vectors (N, 3)."""
    with mpmath.workdps(DIGITS + 320):
        vector = exactly(rotvec)
        angle = np.frompyfunc(mpmath.sqrt, 1, 1)((vector * vector).sum(axis=-1))
        axis = vector / np.where(angle == 0, mpmath.mpf(1), angle)[..., None]
        zero = 0 * angle
        return rotation(axis, (angle, zero, zero)).c0


def attitude_of_quaternion(quat_xyzw):
    """The rotations (N, 3, 3) of quaternions (N, 4) of any length, of 60 digits."""
    with mpmath.workdps(DIGITS):
        return matrices_of_quaternions(exactly(quat_xyzw))


def matrices_of_quaternions(quat_xyzw):
    """w^2 - v.v + 2 v v^T + 2 w [v]x of the unit one, in the numbers of the quaternion."""
    quat = quat_xyzw / np.sqrt((quat_xyzw * quat_xyzw).sum(axis=-1, keepdims=True))
    v, w = quat[:, :3], quat[:, 3][:, None, None]
    square = (v * v).sum(axis=-1)[:, None, None]
    return (w * w - square) * np.eye(3, dtype=int) + 2 * v[:, :, None] * v[:, None, :] + 2 * w * skew(v)
