"""Closed mechanisms, beside loops over Pinocchio's constraints in Python: a four-bar and an excavator with cylinders.

"accelerations" closes the loops and returns all joints with rates and accelerations; "torque" are the efforts that a
motion takes, "forward" the accelerations that efforts cause. Pinocchio starts from joints that are closed up to 1e-3
rad, takes Newton steps to 1e-12 m, and solves for rates and accelerations with its constraint Jacobians; forward
dynamics is its `constraintDynamics` at closed joints. Errors are the largest differences between both, relative to
the largest component.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import hingepair as hp
from engines import PINOCCHIO
from timing import HINGEPAIR, Case, Job, Method, batch_case, parser, run

Array: TypeAlias = NDArray[np.float64]
WORKLOADS = ("accelerations", "torque", "forward")
FALL = (0.0, 0.0, -9.81)
WORLD = pin.LOCAL_WORLD_ALIGNED


class Linkage(NamedTuple):
    """A closed mechanism, the tree of which it is made, and its loops: two frames, and their distance or None."""

    name: str
    closed: hp.Mechanism
    tree: hp.Mechanism
    loops: tuple[tuple[str, str, int | None], ...]  # the last: place in q of the length, or None of one point
    middle: tuple[float, ...]  # of the coordinates
    reach: tuple[float, ...]


class Task(NamedTuple):
    """Motions of a linkage."""

    linkage: Linkage
    workload: str
    q: Array
    qd: Array
    last: Array  # qdd or tau


def bar(name: str, u1: tuple[float, ...], length: float) -> hp.HingePair:
    """Return a joint with a uniform bar."""
    body = hp.Body(2 * length, (length / 2, 0, 0), (0.01, length**3 / 6 + 0.01, length**3 / 6 + 0.01))
    return hp.HingePair(u1, (0, 0, 0), (0, 1, 0), name=name, body2=body)


def four_bar() -> Linkage:
    """Return a crank-rocker."""
    bars = [bar("crank", (0, 0, 0), 0.3), bar("coupler", (0.3, 0, 0), 0.9), bar("rocker", (1, 0, 0), 0.7)]
    tree = hp.Mechanism(bars, parents=[0, 1, 0]).with_frame("a", "coupler", R=(0.9, 0, 0))
    tree = tree.with_frame("b", "rocker", R=(0.7, 0, 0))
    at = {"crank": 0.3, "coupler": 0.8, "rocker": 1.9}
    closed = tree.closed(hp.Loop("a", "b"), coordinates="crank", at=at)
    return Linkage("four-bar", closed, tree, (("a", "b", None),), (0.0,), (np.pi,))


def excavator() -> Linkage:
    """Return the arm of an excavator, whose coordinates are the lengths of its three cylinders."""
    tree = hp.Mechanism([bar("boom", (0, 0, 1), 4), bar("stick", (4, 0, 0), 2), bar("bucket", (2, 0, 0), 1)])
    points = {
        "foot1": ("base", (0.4, 0, 0.3)), "eye1": ("boom", (1.8, 0, 0.4)), "foot2": ("boom", (1.6, 0, 0.7)),
        "eye2": ("stick", (-0.5, 0, 0.3)), "foot3": ("stick", (0.3, 0, 0.5)), "eye3": ("bucket", (0.2, 0, 0.35)),
    }  # fmt: skip
    for name, (link, R) in points.items():
        tree = tree.with_frame(name, link, R=R)
    arm = tree
    for k in "123":
        arm = arm.with_strut(f"foot{k}", f"eye{k}", f"cylinder{k}")
    names, at = tuple(f"cylinder{k}" for k in "123"), {"boom": -0.4, "stick": 1.2, "bucket": 0.6}
    closed = arm.closed(coordinates=names, at=at)
    lengths = tuple(float(arm.struts(at)[name].length) for name in names)
    loops = tuple((f"foot{k}", f"eye{k}", int(k) - 1) for k in "123")
    return Linkage("excavator, three cylinders", closed, tree, loops, lengths, (0.1, 0.1, 0.04))


def make_task(linkage: Linkage, workload: str, count: int) -> Task:
    """Return `count` random motions, always the same ones."""
    dof = linkage.closed.dof
    numbers = np.random.default_rng(41).uniform(-1, 1, (count, 3, dof))
    q = np.asarray(linkage.middle) + numbers[:, 0] * linkage.reach
    return Task(linkage, workload, q, *(np.ascontiguousarray(numbers[:, k]) for k in (1, 2)))


def hingepair_job(task: Task) -> Job:
    """Return a job of the methods."""
    closed, given = task.linkage.closed, (task.q, task.qd, task.last)
    if task.workload == "accelerations":
        return lambda: (closed.all_coordinates(*given)[2],)
    if task.workload == "torque":
        return lambda: (closed.inverse_dynamics(*given, outputs=("tau",)).tau,)
    return lambda: (closed.forward_dynamics(*given).qdd,)


class Pinocchio:
    """The tree of a linkage in Pinocchio, closed one state after another."""

    def __init__(self, task: Task) -> None:
        self.task, (_, closed, tree, loops, *_) = task, task.linkage
        twin = hp.to_pinocchio(tree)
        self.model, self.data = twin.model, twin.data
        self.model.gravity.linear = np.array(FALL)
        number = self.model.getFrameId
        self.frames = [(number(first), number(second), place) for first, second, place in loops]
        self.known = closed.all_coordinates(task.q, task.qd, 0 * task.qd)
        self.driving = [tree.names.index(name) for name in closed.names if name in tree.names]
        self.following = [k for k in range(tree.dof) if k not in self.driving]

    def conditions(self, q: Array, length: Array) -> tuple[Array, Array]:
        """Return gaps and their Jacobian by all joints."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        gaps, rows = [], []
        for first, second, place in self.frames:
            apart = data.oMf[first].translation - data.oMf[second].translation
            one, other = (pin.getFrameJacobian(model, data, frame, WORLD)[:3] for frame in (first, second))
            J = one - other
            if place is not None:
                distance = np.linalg.norm(apart)
                apart, J = np.array([distance - length[place]]), (apart / distance @ J)[None]
            gaps.append(apart)
            rows.append(J)
        return np.concatenate(gaps), np.concatenate(rows)

    def bias(self, q: Array, v: Array) -> Array:
        """Return the second derivatives of the gaps where no joint accelerates."""
        model, data = self.model, self.data
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        found = []
        for first, second, place in self.frames:
            motions = [
                (
                    pin.updateFramePlacement(model, data, frame).translation.copy(),
                    pin.getFrameVelocity(model, data, frame, WORLD).linear,
                    pin.getFrameClassicalAcceleration(model, data, frame, WORLD).linear,
                )
                for frame in (first, second)
            ]
            apart, rate, change = (x - y for x, y in zip(*motions, strict=True))
            if place is None:
                found.append(change)
            else:
                distance = np.linalg.norm(apart)
                along = apart / distance
                found.append([along @ change + (rate @ rate - (along @ rate) ** 2) / distance])
        return np.concatenate(found)

    def closed(self, k: int) -> tuple[Array, Array, Array, Array]:
        """Return all joints of a state, their rates and accelerations, and derivatives by the coordinates."""
        task, driving, following = self.task, self.driving, self.following
        q = self.known[0][k] + 1e-3
        if driving:
            q[driving] = task.q[k]
        for _ in range(10):
            gaps, J = self.conditions(q, task.q[k])
            if np.abs(gaps).max() < 1e-12:
                break
            q[following] -= np.linalg.lstsq(J[:, following], gaps, rcond=None)[0]
        sides = -J[:, driving] if driving else np.eye(len(J))
        G = np.zeros((len(q), task.q.shape[1]))
        for column, row in enumerate(driving):
            G[row, column] = 1
        G[following] = np.linalg.lstsq(J[:, following], sides, rcond=None)[0]
        v, a = G @ task.qd[k], G @ task.last[k]
        a[following] -= np.linalg.lstsq(J[:, following], self.bias(q, v), rcond=None)[0]
        return q, v, a, G

    def accelerations(self) -> tuple[Array]:
        """Return those of all joints."""
        return (np.array([self.closed(k)[2] for k in range(len(self.task.q))]),)

    def torque(self) -> tuple[Array]:
        """Return the efforts at the coordinates."""
        found = []
        for k in range(len(self.task.q)):
            q, v, a, G = self.closed(k)
            found.append(G.T @ pin.rnea(self.model, self.data, q, v, a))
        return (np.array(found),)

    def forward(self) -> Job:
        """Return a job of `constraintDynamics`, from joints that are closed."""
        model, data, driving = self.model, self.data, self.driving
        models, results = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for first, second, _ in self.frames:
            ends = [
                part for k in (first, second) for part in (model.frames[k].parentJoint, model.frames[k].placement)
            ]
            models.append(pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *ends, pin.LOCAL))
            results.append(models[-1].createData())
        pin.initConstraintDynamics(model, data, models, results)
        settings, tau = pin.ProximalSettings(1e-10, 1e-10, 20), np.zeros(model.nv)

        def job() -> tuple[Array]:
            found = np.empty_like(self.task.q)
            for k, (q, v) in enumerate(zip(*self.known[:2], strict=True)):
                tau[driving] = self.task.last[k]
                found[k] = pin.constraintDynamics(model, data, q, v, tau, models, results, settings)[driving]
            return (found,)

        return job


def pinocchio_job(task: Task) -> Job:
    """Return a job of a loop in Python."""
    loop = Pinocchio(task)
    return {"accelerations": loop.accelerations, "torque": loop.torque}.get(task.workload) or loop.forward()


METHODS = (Method(HINGEPAIR, hingepair_job), Method(PINOCCHIO, pinocchio_job, max_samples=1000))


def cases(sizes: tuple[int, ...]) -> Iterator[Case]:
    """Yield a case for each mechanism, workload and size."""
    for linkage in (four_bar(), excavator()):
        for workload in WORKLOADS[: 3 if linkage.loops[0][2] is None else 2]:  # its constraints have no lengths
            make: Callable[[int], Task] = cache(partial(make_task, linkage, workload))
            ours, theirs = (method.make_job(make(50))()[0] for method in METHODS)
            off = float(np.abs(ours - theirs).max() / np.abs(theirs).max())
            errors: dict[str, Any] = {HINGEPAIR: {"error": off}, PINOCCHIO: {"error": 0.0}}
            for size in sizes:
                yield batch_case(f"{linkage.name}, {workload}", METHODS, make, size, errors)


def main() -> None:
    """Measure all cases."""
    options = parser(__doc__.splitlines()[0], "")  # type: ignore[union-attr]
    options.add_argument("--sizes", default="100000", help="states of a call, separated by commas")
    given = options.parse_args()
    run(cases(tuple(map(int, given.sizes.split(",")))), given.repeats, given.json)


if __name__ == "__main__":
    main()
