"""A tree of joints in 60 digits: everything that can be asked of it, from the poses and momenta of its bodies alone.

The trees are plain records made here, from the numbers of a pair or from Pinocchio's reading of a URDF file.
"""

from __future__ import annotations

import functools
from types import SimpleNamespace

import mpmath
import numpy as np
import pinocchio as pin

from hingepair.bench.truth import DIGITS, exactly, nearest_rotation
from support.exact_robot import LETTERS, ExactRobot, exact_slopes

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


class Exact:
    """A tree at N states.

    Args:
        tree: the record.
        frame: the frame that is asked for.
        free: whether forces move the base, so that its rates and its mass count.
        given: q, qd, qdd (N, dof) and R, S, v, omega, a, alpha of the base; what is absent is zero, or the identity.
        gravity: (3,).
    """

    def __init__(self, tree, frame, free, given, gravity=(0, 0, -9.81)):
        self.tree, self.frame, self.free, self.gravity = tree, frame, free, gravity
        self.count, self.dof = len(given["q"]), np.shape(given["q"])[1]
        self.zero = np.zeros((self.count, 3))
        still = dict.fromkeys(LETTERS, self.zero) | {"S": np.broadcast_to(np.eye(3), (self.count, 3, 3))}
        still |= dict.fromkeys(("qd", "qdd"), np.zeros((self.count, self.dof)))
        self.given = still | {name: value for name, value in given.items() if name in (*still, "q")}
        self.robot = ExactRobot(
            tree, *(self.given[name] for name in ("q", "qd", "qdd")),
            base=[self.given[letter] for letter in LETTERS], gravity=gravity,
        )  # fmt: skip

    def at(self, gravity=None, **given):
        """The same tree with other values of what is named."""
        gravity = self.gravity if gravity is None else gravity
        return Exact(self.tree, self.frame, self.free, self.given | given, gravity)

    @functools.cached_property
    def motion(self):
        """R, S, v, omega, a, alpha and d of the frame."""
        return self.robot.motion(self.frame)

    @functools.cached_property
    def forces(self):
        """(force1, torque1, tau)."""
        return self.robot.forces(base_counts=self.free)

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
            for body, (origin, turn) in enumerate(self.robot.poses):
                if not body and not self.free:
                    continue
                own = self.tree.joints[body - 1].body if body else self.tree.base
                m, c, inertia = (exactly(part) for part in (own.mass, own.centre_of_mass, own.inertia))
                m = m[()]
                centre = origin + turn @ c[:, None]
                spread = exactly(np.eye(3)) * (np.trace(inertia) / 2) - inertia  # second moments
                push = turn.c0 @ spread @ np.swapaxes(turn.c1, -1, -2)
                spin = np.stack([push[:, i, j] - push[:, j, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=-1)
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
        """The derivatives of `value(tree)`, (N, m), by one of q, qd, qdd."""
        return exact_slopes(lambda x: value(self.at(**{by: x})), (self.given[by],), 0)

    def torque_slopes(self):
        return {f"tau_{by}": self.slopes(lambda at: at.forces[2], by) for by in ("q", "qd", "qdd")}

    def acceleration_slopes(self, tau):
        """By q and qd of M^-1 (tau - bias); by tau, M^-1."""
        with mpmath.workdps(DIGITS):
            inverse = np.array([mpmath.inverse(mpmath.matrix(M)).tolist() for M in self.mass_matrix().tolist()])
            moved = self.at(qdd=self.accelerations(tau))
            found = {f"qdd_{by}": -inverse @ moved.slopes(lambda at: at.forces[2], by) for by in ("q", "qd")}
            return found | {"qdd_tau": inverse}
