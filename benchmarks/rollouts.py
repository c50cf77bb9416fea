"""Motions of robots in time and gradients through them, beside Pinocchio's loops in C++ and Python and MuJoCo's.

Steps of semi-implicit Euler, each under efforts of its own, on one thread; all states are returned. The gradient is
that of a loss of q at all steps, by the efforts of all steps. N is the number of steps of a call, of all motions. The
errors are the largest differences from Pinocchio's loop in Python, relative to the largest component.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

import hingepair as hp
from engines import PINOCCHIO, PINOCCHIO_CPP, Array, CppSystem, load_models, mujoco_model
from timing import HINGEPAIR, Case, Job, Method, able, parser, run

DT = 1e-3  # s, of a step
MOTION, GRADIENT = "rollout", "gradient"
REUSED, MUJOCO = "hingepair, into the same arrays", "mujoco.rollout"  # names of methods
_CHECKED = 3  # motions that are compared with those of Pinocchio's loop


class Task(NamedTuple):
    """Motions from random states under random efforts; a larger task begins with the motions of a smaller one."""

    workload: str
    robot: hp.Mechanism
    model: Any  # of Pinocchio
    q0: Array  # (motions, dof)
    qd0: Array
    tau: Array  # (motions, steps, dof)
    weights: Array  # derivatives of a loss by q at all steps, the start included


def robot_case(name: str, workload: str, methods: Sequence[Method], size: int, steps: int) -> Case:
    """Return the case of a robot and a workload, with errors of the first motions."""
    robot, model = load_models(name)
    chosen = [method for method in methods if workload == MOTION or method.name in _DIFFERENTIABLE]
    make = cache(partial(make_task, workload, robot, model, steps))
    counts = {method.name: min(size, method.max_samples) for method in chosen}
    jobs = {method.name: method.make_job(make(counts[method.name])) for method in chosen}
    checked = make(min(_CHECKED, size))
    truth, errors = pinocchio_job(checked)()[0], {}
    for method in chosen:
        found = method.make_job(checked)()[0]
        errors[method.name] = {"error": float(np.abs(found - truth).max() / np.abs(truth).max())}
    title = f"{robot.name} ({robot.dof} joints), {workload}, {size:,} motions of {steps} steps"
    return Case(title, jobs, {name: steps * count for name, count in counts.items()}, errors)


def make_task(workload: str, robot: hp.Mechanism, model: Any, steps: int, count: int) -> Task:
    """Return a task of `count` motions, always the same ones."""
    numbers = np.random.default_rng(51).uniform(-1, 1, (count, 2 * steps + 3, robot.dof))
    parts = (numbers[:, 0], numbers[:, 1], numbers[:, 2 : steps + 2], numbers[:, steps + 2 :])
    return Task(workload, robot, model, *map(np.ascontiguousarray, parts))


def hingepair_job(task: Task, out: dict[str, Array] | None = None) -> Job:
    """Return the job of `Mechanism.rollout`, with `vjp` for a gradient."""
    roll = partial(task.robot.rollout, task.q0, task.qd0, task.tau, DT, joint_loads=False, out=out)
    if task.workload == GRADIENT:
        return lambda: (roll().vjp({"q": task.weights}, wrt="tau")["tau"],)
    return lambda: (roll().q,)


def reused_job(task: Task) -> Job:
    """Return the job of the same call, which writes into the same arrays each time."""
    motions, steps, dof = task.tau.shape
    return hingepair_job(task, {name: np.empty((motions, steps + 1, dof)) for name in ("q", "qd")})


def pinocchio_job(task: Task) -> Job:
    """Return the job of a loop of `pin.aba` in Python; gradients take `pin.computeABADerivatives` on the way back."""
    model, data = task.model, task.model.createData()
    q, v = np.empty((2, *task.weights.shape))
    q[:, 0], v[:, 0] = task.q0, task.qd0
    gradient = np.empty_like(task.tau)

    def roll() -> tuple[Array]:
        """Return q of all motions by semi-implicit Euler steps."""
        for own_q, own_v, own_tau in zip(q, v, task.tau, strict=True):
            qi, vi = own_q[0], own_v[0]
            for k, tau in enumerate(own_tau):
                vi = vi + DT * pin.aba(model, data, qi, vi, tau)
                qi = qi + DT * vi
                own_q[k + 1], own_v[k + 1] = qi, vi
        return (q,)

    def differentiate() -> tuple[Array]:
        """Roll, and return the derivatives of the loss by tau, backwards through the steps."""
        roll()
        for i, (own_tau, weights) in enumerate(zip(task.tau, task.weights, strict=True)):
            by_q, by_v = np.zeros((2, model.nv))
            for k in reversed(range(len(own_tau))):
                by_q = by_q + weights[k + 1]
                by_v = by_v + DT * by_q
                pin.computeABADerivatives(model, data, q[i, k], v[i, k], own_tau[k])
                load = DT * by_v
                gradient[i, k] = data.Minv @ load
                by_q, by_v = by_q + data.ddq_dq.T @ load, by_v + data.ddq_dv.T @ load
        return (gradient,)

    return roll if task.workload == MOTION else differentiate


def pinocchio_cpp_job(task: Task) -> Job:
    """Return the job of a loop of `aba` in C++, which is compiled first."""
    system = CppSystem(task.model, 0)
    q, v = np.empty((2, *task.weights.shape))
    q[:, 0], v[:, 0] = task.q0, task.qd0
    counts = task.tau.shape[:2]

    def run() -> tuple[Array]:
        system.library.system_roll(system.address, *counts, DT, *(one.ctypes.data for one in (task.tau, q, v)))
        return (q,)

    return run


def mujoco_job(task: Task) -> Job:
    """Return the job of `mujoco.rollout`, on one thread."""
    import mujoco as mj
    from mujoco import rollout

    model = mujoco_model(task.robot)
    model.opt.timestep = DT
    data, dof = mj.MjData(model), task.robot.dof
    start = np.hstack([np.zeros((len(task.q0), 1)), task.q0, task.qd0])  # time, positions, velocities
    state = np.empty((*task.tau.shape[:2], start.shape[1]))
    applied = int(mj.mjtState.mjSTATE_QFRC_APPLIED)

    def run() -> tuple[Array]:
        rollout.rollout(model, data, start, task.tau, control_spec=applied, state=state)
        return (np.concatenate([task.q0[:, None], state[:, :, 1 : dof + 1]], axis=1),)

    return run


METHODS = (
    Method(HINGEPAIR, hingepair_job),
    Method(REUSED, reused_job),
    Method(PINOCCHIO_CPP, pinocchio_cpp_job, max_samples=256),
    Method(PINOCCHIO, pinocchio_job, max_samples=16),
    Method(MUJOCO, mujoco_job, max_samples=128, package="mujoco"),
)
_DIFFERENTIABLE = {HINGEPAIR, PINOCCHIO}  # methods that compute gradients


def main() -> None:
    """Measure the robots of the command line."""
    options = parser(__doc__.splitlines()[0], "ur5_robot,panda")
    options.add_argument("--size", type=int, default=4096, help="number of motions")
    options.add_argument("--steps", type=int, default=100, help="of each motion")
    given = options.parse_args()
    methods = able(METHODS, cpp=given.cpp)
    run(
        (
            robot_case(name, workload, methods, given.size, given.steps)
            for name in given.names.split(",")
            for workload in (MOTION, GRADIENT)
        ),
        given.repeats,
        given.json,
    )


if __name__ == "__main__":
    main()
