"""Poses, Jacobians, dynamics and their derivatives of whole robots, beside Pinocchio, MuJoCo and frax (JAX).

The errors are those against arithmetic of 60 digits, relative to the largest component of a state's result.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from functools import cache, partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

import hingepair as hp
from engines import (
    ACCELERATION_SLOPES,
    FORWARD,
    INVERSE,
    JACOBIAN,
    MUJOCO,
    PINOCCHIO,
    PINOCCHIO_CPP,
    POSE,
    TORQUE_SLOPES,
    WORKLOADS,
    Array,
    States,
    cpp_job,
    joined,
    load_models,
    mujoco_job,
    pinocchio_job,
)
from hingepair.mechanism.mechanism import tree_of
from hingepair.mechanism.tree import Frame
from timing import HINGEPAIR, Case, Job, Method, able, batch_case, parser, run

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # for the truth of 60 digits
from support.exact import Exact

PREPARED, FRAX = "hingepair, prepared", "frax (JAX, one batch)"
SLOPES = (TORQUE_SLOPES, ACCELERATION_SLOPES)
OUTPUTS = {POSE: ("R", "S"), INVERSE: ("tau",), FORWARD: ("qdd",)}
OUTPUTS |= {TORQUE_SLOPES: ("tau_q", "tau_qd"), ACCELERATION_SLOPES: ("qdd_q", "qdd_qd")}
CHECKED = 4  # states whose results are compared with the exact ones; of derivatives one


def robot_cases(name: str, methods: Sequence[Method], sizes: Sequence[int]) -> Iterator[Case]:
    """Yield a case for each workload and size."""
    robot, model = load_models(name)
    for workload in WORKLOADS:
        measured = [method for method in methods if workload in _ONLY.get(method.name, WORKLOADS)]
        if robot.dof > 8 and workload in SLOPES:  # JAX compiles these for minutes
            measured = [method for method in measured if method.name != FRAX]
        make = cache(partial(make_task, robot, model, workload))
        checked = make(1 if workload in SLOPES else CHECKED)
        exact = exact_results(checked)
        errors = {
            method.name: {"error": result_error(method, make(1) if method.name == PREPARED else checked, exact)}
            for method in measured
        }
        for size in sizes:
            chosen = [method for method in measured if method.name != PREPARED or size == 1]
            yield batch_case(f"{robot.name} ({robot.dof} joints), {workload}", chosen, make, size, errors)


def make_task(robot: hp.Mechanism, model: Any, workload: str, count: int) -> States:
    """Return `count` random states, always the same ones, and the joint furthest from the base as the frame."""
    depths = [0]
    for joint in range(1, model.njoints):
        depths.append(depths[model.parents[joint]] + 1)
    tip = model.names[int(np.argmax(depths))]
    states = np.random.default_rng(31).uniform(-1, 1, (count, 3, robot.dof)).transpose(1, 0, 2)
    rows = tuple(np.ascontiguousarray(states)[: WORKLOADS[workload]])
    return States(workload, robot, model, model.getFrameId(tip), rows)


def exact_results(task: States) -> Array:
    """Return the exact results of the task as an array of mpf, with a row for each state."""
    tree, count = tree_of(task.robot), len(task.rows[0])
    body = 1 + [joint.name for joint in tree.joints].index(task.model.frames[task.frame].name)
    given = dict(zip(("q", "qd", "qdd"), task.rows, strict=False))
    exact = Exact(tree, Frame(body, np.zeros(3), np.eye(3)), False, given)
    if task.workload == FORWARD:
        return exact.accelerations(task.rows[2])
    if task.workload in SLOPES:
        of_accelerations = task.workload == ACCELERATION_SLOPES
        found = exact.acceleration_slopes(task.rows[2]) if of_accelerations else exact.torque_slopes()
        return np.concatenate([one.reshape(count, -1) for one in [*found.values()][:2]], axis=-1)
    if task.workload == INVERSE:
        return exact.forces[2]
    if task.workload == JACOBIAN:
        return exact.jacobian().reshape(count, -1)
    motion = exact.motion
    return np.concatenate([motion["R"], motion["S"].reshape(count, 9)], axis=-1)


def result_error(method: Method, task: States, exact: Array) -> float:
    """Return the largest error of a method's results, each relative to the largest component of its state's."""
    found = joined(method.make_job(task)(), len(task.rows[0]))
    pairs = zip(found, exact, strict=False)  # a prepared call computes the first state
    return max(float(abs(a - b).max() / abs(b).max()) for a, b in pairs)


def hingepair_job(task: States) -> Job:
    """Return the job of a method of `Mechanism`; its results are new arrays."""
    robot, tip, outputs = task.robot, task.model.frames[task.frame].name, OUTPUTS.get(task.workload)
    calls: dict[str, Any] = {
        POSE: partial(robot.forward_kinematics, frames=(tip,), outputs=outputs),
        JACOBIAN: partial(robot.jacobian, frames=tip),
        INVERSE: partial(robot.inverse_dynamics, outputs=outputs, joint_loads=False),
        FORWARD: partial(robot.forward_dynamics, joint_loads=False),
        TORQUE_SLOPES: partial(robot.inverse_dynamics_derivatives, outputs=outputs, joint_loads=False),
        ACCELERATION_SLOPES: partial(robot.forward_dynamics_derivatives, outputs=outputs, joint_loads=False),
    }
    return _read(partial(calls[task.workload], backend="compiled"), task.rows, task.workload)


def prepared_job(task: States) -> Job:
    """Return the job of a prepared call at the first state."""
    prepare, tip = task.robot.prepare, task.model.frames[task.frame].name
    calls = {
        POSE: lambda: prepare("pose", frames=(tip,), outputs=("R", "S")),
        JACOBIAN: lambda: prepare("jacobian", frames=(tip,)),
        INVERSE: lambda: prepare("inverse_dynamics", outputs=("tau",), joint_loads=False),
        FORWARD: lambda: prepare("forward_dynamics", joint_loads=False),
    }
    return _read(calls[task.workload](), [row[0].copy() for row in task.rows], task.workload)


def _read(call: Any, rows: Sequence[Array], workload: str) -> Job:
    """Return a job that calls and reads the outputs of a workload."""
    if workload == JACOBIAN:
        return lambda: (call(*rows),)
    read = attrgetter(*OUTPUTS[workload])
    if len(OUTPUTS[workload]) == 1:
        return lambda: (read(call(*rows)),)
    return lambda: read(call(*rows))


def frax_job(task: States) -> Job:
    """Return the job of frax, compiled by JAX for a whole batch; JAX computes in float64 from then on."""
    import jax

    jax.config.update("jax_enable_x64", True)
    with warnings.catch_warnings():  # frax warns about settings that it recommends
        warnings.simplefilter("ignore")
        from frax.core.robot import Robot

    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
        file.write(hp.to_urdf(task.robot))
        file.flush()
        robot = Robot(file.name, joint_ordering=list(task.robot.names))
    gravity = np.array([0, 0, 9.81, 0, 0, 0])
    functions = {
        INVERSE: lambda q, v, w: robot.rnea(q, v, w, gravity, None),
        FORWARD: lambda q, v, w: robot.forward_dynamics(q, v, w, None),
    }
    functions[TORQUE_SLOPES] = jax.jacfwd(functions[INVERSE], argnums=(0, 1))
    call = jax.jit(jax.vmap(functions[task.workload]))
    rows = [jax.numpy.asarray(row) for row in task.rows]
    return lambda: tuple(jax.tree_util.tree_leaves(jax.block_until_ready(call(*rows))))


METHODS = (
    Method(PREPARED, prepared_job),  # of one state only
    Method(HINGEPAIR, hingepair_job),
    Method(PINOCCHIO_CPP, cpp_job),
    Method(PINOCCHIO, pinocchio_job, max_samples=10**4),
    Method(MUJOCO, mujoco_job, max_samples=10**4, package="mujoco"),
    Method(FRAX, frax_job, max_samples=1_000, min_samples=2, package="frax"),  # derivatives take 0.3 MB a state
)
# The workloads of methods that do not compute all of them.
_ONLY = {MUJOCO: (INVERSE, FORWARD), FRAX: (INVERSE, FORWARD, TORQUE_SLOPES)}
_ONLY[PREPARED] = (POSE, JACOBIAN, INVERSE, FORWARD)


def main() -> None:
    """Measure the robots of the command line."""
    options = parser(__doc__.splitlines()[0], "ur5_robot,panda,solo12,talos_reduced")
    options.add_argument("--sizes", default="1,100,100000", help="batch sizes [states], separated by commas")
    given = options.parse_args()
    methods, sizes = able(METHODS, cpp=given.cpp), [int(size) for size in given.sizes.split(",")]
    cases = (case for name in given.names.split(",") for case in robot_cases(name, methods, sizes))
    run(cases, given.repeats, given.json)


if __name__ == "__main__":
    main()
