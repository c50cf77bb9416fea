"""`hingepair bench robots`: poses, Jacobians and dynamics of whole robots, beside Pinocchio, MuJoCo and frax (JAX).

A new workload is an entry in `engines.WORKLOADS`, a case of each engine that computes it (here, in engines.py and in
loops.cpp), and its exact result in `exact_results`.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterator, Sequence
from functools import cache, partial
from operator import attrgetter
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench import engines
from hingepair.bench.engines import (
    ACCELERATION_SLOPES,
    FORWARD,
    GRADIENT,
    INVERSE,
    JACOBIAN,
    POSE,
    TORQUE_SLOPES,
    States,
    join_parts,
)
from hingepair.bench.harness import (
    HINGEPAIR,
    PREPARED,
    Case,
    Job,
    Method,
    Report,
    Row,
    batch_case,
    installed,
    measure,
    measure_cold,
    print_progress,
)
from hingepair.bench.plot import MethodCurve, Panel
from hingepair.bench.truth import DIGITS, ExactRobot
from hingepair.formats.model_writers import to_urdf
from hingepair.formats.robots import load_robot, robot_urdf
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.tree import Frame

Array: TypeAlias = NDArray[Any]

LOCKED = {"panda": {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}}  # positions [m], by robot
SLOPES = (TORQUE_SLOPES, ACCELERATION_SLOPES, GRADIENT)  # workloads of derivatives
REUSED = f"{HINGEPAIR}, out="  # results into arrays of the call before
WORKLOADS = (POSE, JACOBIAN, INVERSE, FORWARD, *SLOPES)  # in the order of the table
FRAX, BATCHES = "frax (JAX, one batch)", "Pinocchio, its own batches"  # names of methods
MAX_FRAX_SLOPES = 1_000  # states whose derivatives frax computes at a time: it needs 0.3 MB for each
MAX_FRAX_JOINTS = 8  # of more, JAX compiles the derivatives for minutes
CHECKED = 4  # states whose results are compared with the exact ones; of derivatives one


class Task(NamedTuple):
    """Random states of a robot; a larger task begins with the states of a smaller one."""

    robot: Mechanism
    workload: str
    tip: str  # the joint furthest from the base, whose pose and Jacobian are computed
    inputs: tuple[Array, ...]  # q, v and w (accelerations or efforts), as many as the workload takes; (N, dof)
    states: States  # as other engines take them


def bench_robots(names: Sequence[str], sizes: Sequence[int], repeats: int, with_cpp: bool, cold: bool) -> Report:
    """Measure every workload of the named robots.

    Args:
        names: of example-robot-data.
        sizes: batch sizes.
        repeats: of each measurement.
        with_cpp: whether the C++ loop of Pinocchio is compiled and measured; if this fails, a note says why.
        cold: whether loading a robot and its first calls are measured too, in fresh processes.
    """
    methods, left_out = installed(METHODS, engines.cpp_reasons(with_cpp))
    rows = [row for name in names for row in measure(robot_cases(name, methods, sizes), repeats)]
    for name in names if cold else ():
        rows += measure_cold(f"{name} in a fresh process: loading and {INVERSE} of 1,000", _cold_codes(name), repeats)
    notes = (
        "Each row is one engine on one task, on one thread (JAX chooses its threads itself), compiled before the "
        "measurement. N: states of a call; a call: median time of a call; each: time for one state; ratio: that "
        "time divided by the time of the first row.",
        f"error: largest difference from {DIGITS}-digit arithmetic at {CHECKED} random states, relative to the "
        "largest component of the result (the unit roundoff of a double is 1.1e-16).",
        f"{HINGEPAIR} returns new arrays, whose memory is that of an earlier result where there is one; {REUSED} and "
        "the loops write into the same arrays each time.",
        "pose, Jacobian: of the joint that is furthest from the base. hingepair, prepared: the result of "
        "robot.prepare, called with one state. Pinocchio, its own batches: rneaInParallel, abaInParallel. Python "
        f"loops compute at most {engines.MAX_IN_PYTHON:,} states.",
    )
    return Report(rows, "error", [*left_out, *notes], _panels(rows, max(sizes)))


def robot_cases(name: str, methods: Sequence[Method], sizes: Sequence[int]) -> Iterator[Case]:
    """Yield a case for each workload and size."""
    robot, model = load_models(name)
    for workload in WORKLOADS:
        able = [method for method in methods if workload in _ONLY.get(method.name, WORKLOADS)]
        if workload in SLOPES:
            able = [one._replace(max_samples=MAX_FRAX_SLOPES) if one.name == FRAX else one for one in able]
            if robot.dof > MAX_FRAX_JOINTS:
                able = [one for one in able if one.name != FRAX]
        make = cache(partial(make_task, robot, model, workload))
        print_progress(f"{name}, {workload}: {DIGITS} digits")
        checked = 1 if workload in SLOPES else CHECKED
        truth = exact_results(make(checked))
        errors = {one.name: result_error(one, make(1 if one.name == PREPARED else checked), truth) for one in able}
        for size in sizes:
            chosen = [method for method in able if method.name != PREPARED or size == 1]
            yield batch_case(f"{robot.name} ({robot.dof} joints), {workload}", chosen, make, size, errors)


def load_models(name: str) -> tuple[Mechanism, Any]:
    """Return a robot of example-robot-data and Pinocchio's model, read from the same file by Pinocchio itself."""
    import pinocchio as pin

    full, locked = pin.buildModelFromUrdf(str(robot_urdf(name))), LOCKED.get(name, {})
    numbers = [full.getJointId(joint) for joint in locked]
    model = pin.buildReducedModel(full, numbers, pin.neutral(full)) if numbers else full
    return load_robot(name, locked=locked), model


def make_task(robot: Mechanism, model: Any, workload: str, count: int) -> Task:
    """Return a task of `count` random states, always the same ones."""
    depths = [0]
    for joint in range(1, model.njoints):
        depths.append(depths[model.parents[joint]] + 1)
    tip = model.names[int(np.argmax(depths))]
    states = np.random.default_rng(31).uniform(-1, 1, (count, 3, robot.dof)).transpose(1, 0, 2)
    inputs = tuple(np.ascontiguousarray(states)[: engines.WORKLOADS[workload]])
    return Task(robot, workload, tip, inputs, States(workload, robot, model, model.getFrameId(tip), inputs))


def exact_results(task: Task) -> Array:
    """Return the exact results of the task as an array of mpf, with a row for each state."""
    tree, count = tree_of(task.robot), len(task.inputs[0])
    q, qd, w = (*task.inputs, None, None)[:3]
    if task.workload == FORWARD:
        return ExactRobot(tree, q, qd).accelerations(w)
    exact = ExactRobot(tree, q, qd, w)
    if task.workload in SLOPES:
        found = exact.acceleration_slopes(w) if task.workload == ACCELERATION_SLOPES else exact.torque_slopes()
        parts = [one.sum(axis=1) if task.workload == GRADIENT else one for one in found]
        return np.concatenate([one.reshape(count, -1) for one in parts], axis=-1)
    if task.workload == INVERSE:
        return exact.forces()[2]
    body = 1 + [joint.name for joint in tree.joints].index(task.tip)
    motion = exact.motion(Frame(body, np.zeros(3), np.eye(3)))
    if task.workload == JACOBIAN:
        return exact.jacobian(body, motion["R"]).reshape(count, -1)
    return np.concatenate([motion["R"], motion["S"].reshape(count, 9)], axis=-1)


def result_error(method: Method, task: Task, exact: Array) -> float:
    """Return the largest error of a method's results, each relative to the largest component of its state's."""
    found = join_parts(method.make_job(task)(), len(task.inputs[0]))
    pairs = zip(found, exact, strict=False)  # a prepared call computes the first state
    return max(float(abs(a - b).max() / abs(b).max()) for a, b in pairs)


def hingepair_job(task: Task) -> Job:
    """Return the job of a method of `Mechanism`."""
    robot, tip = task.robot, task.tip
    calls: dict[str, Any] = {
        POSE: partial(robot.forward_kinematics, frames=(tip,), outputs=("R", "S")),
        JACOBIAN: partial(robot.jacobian, frames=tip),
        INVERSE: partial(robot.inverse_dynamics, outputs=("tau",), joint_loads=False),
        FORWARD: partial(robot.forward_dynamics, joint_loads=False),
        TORQUE_SLOPES: partial(robot.inverse_dynamics_derivatives, outputs=("tau_q", "tau_qd"), joint_loads=False),
        ACCELERATION_SLOPES: partial(
            robot.forward_dynamics_derivatives, outputs=("qdd_q", "qdd_qd"), joint_loads=False
        ),
    }
    if task.workload == GRADIENT:
        return _gradient_job(robot, task.inputs)
    return _read(partial(calls[task.workload], backend="compiled"), task.inputs, task.workload)


def reused_job(task: Task) -> Job:
    """Return the job of derivatives that are written into the same arrays each time."""
    names = ("tau_q", "tau_qd") if task.workload == TORQUE_SLOPES else ("qdd_q", "qdd_qd")
    robot, size = task.robot, task.robot.dof
    out = {name: np.empty((len(task.inputs[0]), size, size)) for name in names}
    method = (
        robot.inverse_dynamics_derivatives if task.workload == TORQUE_SLOPES else robot.forward_dynamics_derivatives
    )
    return _read(partial(method, outputs=names, out=out, backend="compiled"), task.inputs, task.workload)


def _gradient_job(robot: Mechanism, inputs: Sequence[Array]) -> Job:
    """Return the job of the gradient of the sum of all torques, of a prepared call."""
    pull = robot.prepare("inverse_dynamics", outputs=("tau",), backend="compiled", joint_loads=False).vjp
    weights = {"tau": np.ones(robot.dof)}

    def run() -> tuple[Array, ...]:
        _, gradient = pull(tuple(inputs), weights, wrt=("q", "qd"))
        return gradient["q"], gradient["qd"]

    return run


def prepared_job(task: Task) -> Job:
    """Return the job of a prepared function at the first state."""
    prepare, state = task.robot.prepare, [row[0].copy() for row in task.inputs]
    calls = {
        POSE: lambda: prepare("pose", frames=(task.tip,), outputs=("R", "S")),
        JACOBIAN: lambda: prepare("jacobian", frames=(task.tip,)),
        INVERSE: lambda: prepare("inverse_dynamics", outputs=("tau",), joint_loads=False),
        FORWARD: lambda: prepare("forward_dynamics", joint_loads=False),
    }
    return _read(calls[task.workload](), state, task.workload)


def _read(call: Any, inputs: Sequence[Array], workload: str) -> Job:
    """Return a job that calls and reads the outputs of a workload."""
    if workload == JACOBIAN:
        return lambda: (call(*inputs),)
    if workload == POSE:
        read = attrgetter("R", "S")
        return lambda: read(call(*inputs))
    if workload in SLOPES:
        read = attrgetter(*(("tau_q", "tau_qd") if workload == TORQUE_SLOPES else ("qdd_q", "qdd_qd")))
        return lambda: read(call(*inputs))
    read = attrgetter("tau" if workload == INVERSE else "qdd")
    return lambda: (read(call(*inputs)),)


def frax_job(task: Task) -> Job:
    """Return the job of frax, compiled by JAX for a whole batch; JAX computes in float64 from then on."""
    import jax

    jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call]
    with warnings.catch_warnings():  # frax warns about settings that it recommends
        warnings.simplefilter("ignore")
        from frax.core.robot import Robot

    with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
        file.write(to_urdf(task.robot))
        file.flush()
        robot = Robot(file.name, joint_ordering=list(task.robot.names))
    gravity = np.array([0, 0, 9.81, 0, 0, 0])
    functions = {
        INVERSE: lambda q, v, w: robot.rnea(q, v, w, gravity, None),
        FORWARD: lambda q, v, w: robot.forward_dynamics(q, v, w, None),
    }
    functions[TORQUE_SLOPES] = jax.jacfwd(functions[INVERSE], argnums=(0, 1))
    call = jax.jit(jax.vmap(functions[task.workload]))
    rows = [jax.numpy.asarray(row) for row in task.inputs]
    wait: Any = jax.block_until_ready
    return lambda: tuple(jax.tree_util.tree_leaves(wait(call(*rows))))


METHODS = (  # ratios refer to the first
    Method(PREPARED, prepared_job),  # of one state only
    Method(HINGEPAIR, hingepair_job),
    *engines.methods(attrgetter("states")),
    Method(
        BATCHES,
        lambda task: engines.pinocchio_batch_job(task.states),
        min_samples=2,
        max_samples=engines.MAX_IN_PYTHON,
        package="pinocchio",
    ),
    Method(FRAX, frax_job, min_samples=2, package="frax"),
    Method(REUSED, reused_job, min_samples=2),
)
# The workloads of methods that do not compute all of them.
_ONLY: dict[str, tuple[str, ...]] = dict.fromkeys((BATCHES, engines.MUJOCO), (INVERSE, FORWARD))
_ONLY |= {FRAX: (INVERSE, FORWARD, TORQUE_SLOPES), PREPARED: (POSE, JACOBIAN, INVERSE, FORWARD)}
_ONLY[REUSED] = (TORQUE_SLOPES, ACCELERATION_SLOPES)


def _cold_codes(name: str) -> dict[str, tuple[str, str]]:
    """Return the codes of `measure_cold` that load a robot and call it."""
    locked = LOCKED.get(name, {})
    states = f"""
import numpy as np
import hingepair as hp
states = np.random.default_rng(0).uniform(-1, 1, (3, 1_000, {load_robot(name, locked=locked).dof}))
"""
    return {HINGEPAIR: (states, f"hp.load_robot({name!r}, locked={locked!r}).inverse_dynamics(*states)")}


def _panels(rows: Sequence[Row], size: int) -> list[list[Panel]]:
    """Return a panel for each workload, two in a row: a line for each robot, with the times of the largest batches.

    The legend shows the largest error of each engine.
    """
    ending = f", N = {size:,}"
    batches = [row for row in rows if row.case.endswith(ending) and row.method != PREPARED]
    errors: dict[str, float] = {}
    for row in batches:
        errors[row.method] = max(errors.get(row.method, 0.0), row.error or 0.0)
    times = [row.seconds_per_sample * 1e9 for row in batches]
    panels: list[Panel] = []
    for workload in WORKLOADS:
        cases = [row for row in batches if row.case.endswith(f", {workload}{ending}")]
        robots = list(dict.fromkeys(row.case.partition(",")[0] for row in cases))
        curves: dict[str, list[tuple[float, float]]] = {}
        for row in cases:
            point = row.seconds_per_sample * 1e9, float(robots.index(row.case.partition(",")[0]))
            curves.setdefault(f"{row.method}: error {errors[row.method]:.0e}", []).append(point)
        panels.append(
            Panel(
                f"{workload}{ending}",
                "run time per state [ns]",
                "",
                [MethodCurve(*item) for item in curves.items()],
                y_names=robots,
                x_range=(min(times) / 2, 2 * max(times)),
            )
        )
    return [panels[:2], panels[2:4], panels[4:6], panels[6:]]
