"""Inverse kinematics of robots, beside Pinocchio's loop in C++ and Python, mink and ikpy.

All have the same random poses within the limits, the same tolerances and the same starts, on one thread. Pinocchio's
loop is that of its example (CLIK), with whole steps, and coordinates put back within the limits. ikpy stops where
SciPy does. What is solved is judged by Pinocchio's forward kinematics.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

import hingepair as hp
from engines import PINOCCHIO, PINOCCHIO_CPP, Array, CppSystem, load_models
from hingepair.mechanism.mechanism import tree_of
from timing import HINGEPAIR, Case, Job, Method, able, batch_case, parser, run

TOLERANCE = 1e-9  # m and rad
LOOSE = 1e-3  # m and rad: what libraries for control are tuned to
_TRIALS = 64  # starts of every method that starts again; hingepair has as many
_STEPS = 50  # of a trial
_DAMPING = 1e-6  # of the loops; Pinocchio's example has 1e-12, with which fewer targets are solved


class Task(NamedTuple):
    """Random targets of a robot that can be reached; a larger task begins with the targets of a smaller one."""

    robot: hp.Mechanism
    model: Any  # of Pinocchio
    link: str  # the child link of the last joint, whose frame all engines have
    R: Array  # (N, 3)
    S: Array  # (N, 3, 3)
    limits: Array  # (dof, 2)
    starts: Array  # (trials, dof), the same for all targets


class Outcome(NamedTuple):
    """What the coordinates that a method found are worth, by Pinocchio."""

    solved: float  # share of the targets within TOLERANCE and the limits
    loosely: float  # within LOOSE
    error: float  # median of the distances [m] and angles [rad]


def robot_case(name: str, methods: Sequence[Method], size: int) -> Case:
    """Return the case of a robot: all methods on `size` targets, and what they solve."""
    robot, model = load_models(name)
    make = cache(partial(make_task, robot, model))
    columns = {}
    for method in methods:
        task = make(min(size, method.max_samples))
        found = outcome(task, method.make_job(task)()[0])
        columns[method.name] = {"solved": found.solved, f"within {LOOSE:g}": found.loosely, "error": found.error}
    return batch_case(f"{robot.name} ({robot.dof} joints)", methods, make, size, columns)


def make_task(robot: hp.Mechanism, model: Any, count: int) -> Task:
    """Return a task of `count` targets, always the same ones."""
    limits = np.clip(robot.position_limits, -np.pi, np.pi)
    q = np.random.default_rng(41).uniform(limits[:, 0], limits[:, 1], (count, robot.dof))
    link = robot.links[-1]
    for name, frame in tree_of(robot).links.items():
        if frame.body == len(tree_of(robot).joints) and not frame.R.any() and np.array_equal(frame.S, np.eye(3)):
            link = name
    data, index = model.createData(), model.getFrameId(link)
    places = []
    for state in q:
        pin.framesForwardKinematics(model, data, state)
        places.append(data.oMf[index].copy())
    starts = np.random.default_rng(42).uniform(limits[:, 0], limits[:, 1], (_TRIALS, robot.dof))
    R, S = (np.array([getattr(place, name) for place in places]) for name in ("translation", "rotation"))
    return Task(robot, model, link, R, S, robot.position_limits, starts)


def outcome(task: Task, q: Array) -> Outcome:
    """Return what coordinates q (N, dof) for the first N targets are worth."""
    data, index = task.model.createData(), task.model.getFrameId(task.link)
    errors = []
    for state, R, S in zip(q, task.R, task.S, strict=True):
        pin.framesForwardKinematics(task.model, data, state)
        place = data.oMf[index]
        errors.append((np.linalg.norm(place.translation - R), np.linalg.norm(pin.log3(place.rotation.T @ S))))
    largest = np.max(errors, axis=1)
    inside = ((task.limits[:, 0] - 1e-12 <= q) & (q <= task.limits[:, 1] + 1e-12)).all(axis=1)
    margin = 1e-14  # rounding of the judge
    solved, loosely = (float((inside & (largest <= limit + margin)).mean()) for limit in (TOLERANCE, LOOSE))
    return Outcome(solved, loosely, float(np.median(largest)))


def hingepair_job(task: Task) -> Job:
    """Return the job of `Mechanism.inverse_kinematics`."""
    solve = partial(task.robot.inverse_kinematics, task.R, task.S, frame=task.link)
    return lambda: (solve(position_tolerance=TOLERANCE, angle_tolerance=TOLERANCE).q,)


def _each(task: Task, descend: Callable[[int, Array], tuple[Array, bool]], trials: int = _TRIALS) -> Job:
    """Return a job that starts again until `descend(target, start)` says that it has solved a target."""
    q = np.empty((len(task.R), task.robot.dof))

    def run() -> tuple[Array]:
        for k in range(len(q)):
            for start in task.starts[:trials]:
                q[k], solved = descend(k, start)
                if solved:
                    break
        return (q,)

    return run


def pinocchio_job(task: Task) -> Job:
    """Return the job of Pinocchio's loop of closed-loop inverse kinematics in Python."""
    model, data = task.model, task.model.createData()
    index, (low, high) = model.getFrameId(task.link), task.limits.T
    targets = [pin.SE3(S, R) for R, S in zip(task.R, task.S, strict=True)]

    def descend(k: int, q: Array) -> tuple[Array, bool]:
        for _ in range(_STEPS):
            pin.forwardKinematics(model, data, q)
            place = pin.updateFramePlacement(model, data, index)
            off = place.actInv(targets[k])
            error = pin.log6(off).vector
            if np.linalg.norm(off.translation) <= TOLERANCE and np.linalg.norm(error[3:]) <= TOLERANCE:
                return q, True
            J = -pin.Jlog6(off.inverse()) @ pin.computeFrameJacobian(model, data, q, index, pin.LOCAL)
            v = -J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(6), error)
            q = np.clip(pin.integrate(model, q, v), low, high)
        return q, False

    return _each(task, descend)


def pinocchio_cpp_job(task: Task) -> Job:
    """Return the job of the same loop in C++, which is compiled first."""
    found = np.empty((len(task.R), task.robot.dof))
    poses = np.concatenate([task.S.reshape(-1, 9), task.R], axis=1)  # as loops.cpp takes placements
    arrays = [np.ascontiguousarray(one) for one in (*task.limits.T, poses, task.starts)]
    system = CppSystem(task.model, task.model.getFrameId(task.link))
    counts = len(found), len(task.starts), _STEPS

    def run() -> tuple[Array]:
        addresses = (one.ctypes.data for one in (*arrays, found))
        system.library.system_reach(system.address, *counts, TOLERANCE, _DAMPING, *addresses)
        return (found,)

    return run


def mink_job(task: Task) -> Job:
    """Return the job of mink's `solve_ik`, one quadratic program a step, with limits of the coordinates."""
    import mink
    import mujoco

    model = mujoco.MjModel.from_xml_string(hp.to_urdf(task.robot, meshes=False))
    configuration = mink.Configuration(model)
    goal = mink.FrameTask(task.link, "body", position_cost=1.0, orientation_cost=1.0, lm_damping=_DAMPING)
    limits = [mink.ConfigurationLimit(model)]
    targets = [
        mink.SE3.from_rotation_and_translation(mink.SO3.from_matrix(S), R)
        for R, S in zip(task.R, task.S, strict=True)
    ]

    def descend(k: int, q: Array) -> tuple[Array, bool]:
        configuration.update(q)
        goal.set_target(targets[k])
        for _ in range(_STEPS):
            error = goal.compute_error(configuration)
            if np.linalg.norm(error[:3]) <= TOLERANCE and np.linalg.norm(error[3:]) <= TOLERANCE:
                return configuration.q, True
            try:
                v = mink.solve_ik(configuration, [goal], 1.0, "daqp", damping=_DAMPING, limits=limits)
            except mink.NoSolutionFound:
                break
            configuration.integrate_inplace(v, 1.0)
        return configuration.q, False

    return _each(task, descend)


def ikpy_job(task: Task) -> Job:
    """Return the job of ikpy, which minimises by SciPy."""
    from ikpy.chain import Chain

    root = next(iter(tree_of(task.robot).links))
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of fixed joints
        path = Path(folder) / "robot.urdf"
        path.write_text(hp.to_urdf(task.robot, meshes=False))
        links = Chain.from_urdf_file(str(path), base_elements=_elements(path, task.link, root)).links
    moving = [k for k, link in enumerate(links) if link.name in task.robot.names]
    links = links[: moving[-1] + 1]  # it goes on to the end of the robot
    chain = Chain(links, active_links_mask=np.isin(np.arange(len(links)), moving))
    targets = np.tile(np.eye(4), (len(task.R), 1, 1))
    targets[:, :3, :3], targets[:, :3, 3] = task.S, task.R

    def descend(k: int, start: Array) -> tuple[Array, bool]:
        full = np.zeros(len(links))
        full[moving] = start
        full = chain.inverse_kinematics_frame(targets[k], initial_position=full, orientation_mode="all")
        off = np.abs(chain.forward_kinematics(full) - targets[k]).max()
        return full[moving], bool(off <= LOOSE)

    return _each(task, descend, trials=3)


def _elements(path: Path, link: str, root: str) -> list[str]:
    """Return links and joints of a URDF in turn, from the root to a link."""
    parents = {}
    for joint in ElementTree.parse(path).getroot().iter("joint"):
        child, parent = joint.find("child"), joint.find("parent")
        if child is not None and parent is not None:
            parents[child.get("link")] = joint.get("name"), parent.get("link")
    found: list[Any] = [link]
    while found[0] != root:
        joint_name, parent_name = parents[found[0]]
        found[:0] = parent_name, joint_name
    return found


METHODS = (
    Method(HINGEPAIR, hingepair_job),
    Method(PINOCCHIO_CPP, pinocchio_cpp_job, max_samples=1000),
    Method(PINOCCHIO, pinocchio_job, max_samples=100),
    Method("mink", mink_job, max_samples=30, package="mink"),
    Method("ikpy", ikpy_job, max_samples=10, package="ikpy"),
)


def main() -> None:
    """Measure the robots of the command line."""
    options = parser(__doc__.splitlines()[0], "ur5_robot,panda")
    options.add_argument("--size", type=int, default=10_000, help="number of targets")
    given = options.parse_args()
    methods = able(METHODS, cpp=given.cpp)
    run((robot_case(name, methods, given.size) for name in given.names.split(",")), given.repeats, given.json)


if __name__ == "__main__":
    main()
