"""`hingepair bench robots`: poses, Jacobians and dynamics of whole robots, beside Pinocchio, MuJoCo and frax (JAX).

The error of a result is its distance from what fifty-digit arithmetic says, relative to its largest component.
"""

from __future__ import annotations

import ctypes
import functools
import warnings
import weakref
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.direct import case_of
from hingepair.bench.engines import CPP, FEW, MUJOCO, PYTHON_LOOP, compiled_library, cpp_missing
from hingepair.bench.measure import Job, Report, Row, Way, compared, present, tell
from hingepair.bench.peers import OURS, PREPARED
from hingepair.bench.plot import Curve, Panel
from hingepair.bench.robot_truth import DIGITS, RobotTruth
from hingepair.formats.robots import load_robot, robot_urdf
from hingepair.mechanism.mechanism import Mechanism

Array: TypeAlias = NDArray[Any]

ROBOTS: Final = {
    "ur5_robot": {},
    "panda": {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0},
    "solo12": {},
    "talos_reduced": {},
}
"""Robots, and the joints of each that are locked."""

POSE, JACOBIAN, INVERSE, FORWARD = "pose", "Jacobian", "inverse dynamics", "forward dynamics"
WORKLOADS: Final = (POSE, JACOBIAN, INVERSE, FORWARD)

_COMPARED: Final = 4
"""States whose results are compared with the exact ones."""
_NOTES: Final = (
    "A row is one engine at one task, on one thread (JAX takes as many as it likes), its code compiled before. N: "
    "states of a call; a call: its time, the median of the repeats; each: that for one state; ratio: of that to the "
    "first row of the block.",
    f"error: largest difference from {DIGITS}-digit arithmetic at {_COMPARED} random states, relative to the largest "
    "component of the result (a double has 1.1e-16).",
    "pose, Jacobian: of the joint furthest from the base. hingepair, prepared: a call made ready for one state. "
    "Pinocchio, its own batches: rneaInParallel, abaInParallel. Python loops are given at most 10,000 states.",
)

PARALLEL, FRAX = "Pinocchio, its own batches", "frax (JAX, one batch)"

_KINDS: Final = ("RX", "RY", "RZ", "RevoluteUnaligned", "PX", "PY", "PZ", "PrismaticUnaligned")
_AXES: Final = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}


class Task(NamedTuple):
    """Random states of a robot, and what is computed of them."""

    name: str  # of the robot
    robot: Mechanism
    model: Any  # Pinocchio's, of the same robot
    workload: str  # one of WORKLOADS
    tip: int  # Pinocchio's number of the joint furthest from the base
    rows: tuple[Array, Array, Array]  # q, q', and q'' or, of forward dynamics, the efforts


def robots(names: Sequence[str], sizes: Sequence[int], repeats: int, cpp: bool) -> Report:
    """Measure every workload of some robots at some numbers of states."""
    if cpp:
        tell("compiling Pinocchio's C++ loop (one or two minutes)")
    ways, left_out = present(WAYS, {CPP: cpp_missing(cpp, "robots_loop.cpp")})
    rows = list[Row]()
    for name in names:
        robot, model = _models(name)
        for workload in WORKLOADS:
            task = functools.cache(functools.partial(task_of, name, robot, model, workload))
            suited = [way for way in ways if workload in _WORKLOADS_OF.get(way.name, WORKLOADS)]
            errors = _errors(suited, task)
            for size in sizes:
                tell(f"{name}, {workload}, N = {size:,}: {repeats} repeats")
                asked = [way for way in suited if way.name != PREPARED or size == 1]
                rows += compared(_case(robot, workload, size), asked, task, size, repeats, errors)
    return Report(rows, "error", [*left_out, *_NOTES], _panels(rows, max(sizes)))


def _case(robot: Mechanism, workload: str, size: int) -> str:
    return case_of(f"{robot.name} ({robot.dof} joints), {workload}", size)


def _errors(ways: Sequence[Way], task: Callable[[int], Task]) -> dict[str, float]:
    """Return each way's largest error."""
    tell(f"{task(1).name}, {task(1).workload}: {DIGITS} digits")
    truth = truth_of(task(_COMPARED))
    return {way.name: error_of(way, task(1 if way.name == PREPARED else _COMPARED), truth) for way in ways}


def _panels(rows: Sequence[Row], size: int) -> list[list[Panel]]:
    """Return the picture: run times of the largest batch, a panel for each workload and a line for each robot.

    The names of the engines say the largest of all their errors.
    """
    batches = [row for row in rows if row.case.endswith(case_of("", size)) and row.method != PREPARED]
    errors: dict[str, float] = {}
    for row in batches:
        errors[row.method] = max(errors.get(row.method, 0.0), row.error or 0.0)
    times = [row.least / row.count * 1e9 for row in batches]
    span = (min(times) / 2, 2 * max(times))
    found: list[Panel] = []
    for workload in WORKLOADS:
        cases = [row for row in batches if row.case.endswith(case_of(f", {workload}", size))]
        names = list(dict.fromkeys(row.case.partition(",")[0] for row in cases))
        curves: dict[str, list[tuple[float, float]]] = {}
        for row in cases:
            place = row.least / row.count * 1e9, float(names.index(row.case.partition(",")[0]))
            curves.setdefault(f"{row.method}: error {errors[row.method]:.0e}", []).append(place)
        drawn = [Curve(*item) for item in curves.items()]
        found.append(Panel(case_of(workload, size), "run time [ns a state]", "", drawn, names=names, span=span))
    return [found[:2], found[2:]]


def _models(name: str) -> tuple[Mechanism, Any]:
    """Return a robot and Pinocchio's model of it, read from the same file."""
    import pinocchio as pin

    full = pin.buildModelFromUrdf(str(robot_urdf(name)))
    locked = [full.getJointId(joint) for joint in ROBOTS.get(name, {})]
    model = pin.buildReducedModel(full, locked, pin.neutral(full)) if locked else full
    return load_robot(name, locked=ROBOTS.get(name, {})), model


def task_of(name: str, robot: Mechanism, model: Any, workload: str, count: int) -> Task:
    """Return so many random states of a robot."""
    rng = np.random.default_rng(31)
    depth = [0]
    for joint in range(1, model.njoints):
        depth.append(depth[model.parents[joint]] + 1)
    states = rng.uniform(-1, 1, (count, 3, robot.dof))  # the first are the same, however many there are
    q, v, w = np.ascontiguousarray(states.transpose(1, 0, 2))
    return Task(name, robot, model, workload, int(np.argmax(depth)), (q, v, w))


def truth_of(task: Task) -> Array:
    """Return the results in numbers of many digits; an array of mpmath numbers, a row a state."""
    joint, rows = task.model.names[task.tip], []
    for q, v, w in zip(*task.rows, strict=True):
        truth = RobotTruth(task.robot.tree, q)
        match task.workload:
            case "pose":
                rows.append(truth.pose(joint))
            case "Jacobian":
                rows.append(truth.jacobian(joint).ravel())
            case "inverse dynamics":
                rows.append(truth.inverse_dynamics(v, w))
            case _:
                rows.append(truth.forward_dynamics(v, w))
    return np.array(rows)


def error_of(way: Way, task: Task, truth: Array) -> float:
    """Return the largest error of an engine's results, relative to the largest component of the true ones."""
    known = truth[: len(task.rows[0])]
    result = np.asarray(way.make(task)(), dtype=float).reshape(known.shape)
    return max(float(abs(a - b).max() / abs(b).max()) for a, b in zip(result, known, strict=True))


def _read_pose(state: Any) -> Array:
    R, S = state.R[..., 0, :], state.S[..., 0, :, :]
    return np.concatenate([R, S.reshape(*R.shape[:-1], 9)], axis=-1)


def ours(task: Task) -> Job:
    """Return a call of the robot's method, compiled from the first call on."""
    (q, v, w), tip = task.rows, task.model.names[task.tip]
    if task.workload == POSE:
        # both arrays are ready to be read; to put them side by side is no part of the work of any engine
        job = functools.partial(
            task.robot.forward_kinematics, q, frames=(tip,), outputs=("R", "S"), backend="compiled"
        )
        return _Reading(job, _read_pose)
    calls = {
        JACOBIAN: lambda: task.robot.jacobian(q, tip, backend="compiled"),
        INVERSE: lambda: task.robot.inverse_dynamics(q, v, w, outputs=("tau",), backend="compiled").tau,
        FORWARD: lambda: task.robot.forward_dynamics(q, v, w, backend="compiled").qdd,
    }
    return calls[task.workload]


class _Reading:
    """A job whose result is put into one array when it is compared, not when it is timed."""

    def __init__(self, job: Job, read: Any) -> None:
        self._job, self._read = job, read

    def __call__(self) -> Any:
        return _Lazy(self._job(), self._read)


class _Lazy:
    """A result that is read when NumPy asks for it."""

    def __init__(self, result: Any, read: Any) -> None:
        self._result, self._read = result, read

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.array(self._read(self._result), dtype=dtype, copy=copy)


def prepared(task: Task) -> Job:
    """One state by a prepared call."""
    q, v, w = (row[0].copy() for row in task.rows)
    tip = task.model.names[task.tip]
    if task.workload == POSE:
        pose = task.robot.prepare("pose", frames=(tip,), outputs=("R", "S"))
        return _Reading(lambda: pose(q), _read_pose)
    if task.workload == JACOBIAN:
        jacobian = task.robot.prepare("jacobian", frames=(tip,))
        return lambda: jacobian(q)
    if task.workload == INVERSE:
        inverse = task.robot.prepare("inverse_dynamics", outputs=("tau",))
        return lambda: inverse(q, v, w).tau
    forward = task.robot.prepare("forward_dynamics")
    return lambda: forward(q, v, w).qdd


def pinocchio_loop(task: Task) -> Job:
    """Pinocchio's calls from Python, one state after the other."""
    import pinocchio as pin

    model, (q, v, w), tip = task.model, task.rows, task.tip
    data, frame = model.createData(), pin.LOCAL_WORLD_ALIGNED
    results = np.empty((len(q), {POSE: 12, JACOBIAN: 6 * model.nv}.get(task.workload, model.nv)))

    def pose(i: int) -> None:
        pin.forwardKinematics(model, data, q[i])
        place = data.oMi[tip]
        results[i, :3], results[i, 3:] = place.translation, place.rotation.ravel()

    def jacobian(i: int) -> None:
        pin.computeJointJacobians(model, data, q[i])
        results[i] = pin.getJointJacobian(model, data, tip, frame).ravel()

    def inverse(i: int) -> None:
        results[i] = pin.rnea(model, data, q[i], v[i], w[i])

    def forward(i: int) -> None:
        results[i] = pin.aba(model, data, q[i], v[i], w[i])

    one = {POSE: pose, JACOBIAN: jacobian, INVERSE: inverse, FORWARD: forward}[task.workload]

    def run() -> Array:
        for i in range(len(q)):
            one(i)
        return results

    return run


def pinocchio_batches(task: Task) -> Job:
    """Pinocchio's own batches of dynamics, on one thread as all others here."""
    import pinocchio as pin

    pool = pin.ModelPool(task.model, 1)
    rows = [np.asfortranarray(row.T) for row in task.rows]
    batch = pin.rneaInParallel if task.workload == INVERSE else pin.abaInParallel
    return lambda: batch(1, pool, *rows).T


def pinocchio_cpp(task: Task) -> Job:
    """The same loop in C++."""
    library, model = _robots_library(), task.model
    joints = [model.joints[k] for k in range(1, model.njoints)]
    kinds = [_KINDS.index(joint.shortname().removeprefix("JointModel")) for joint in joints]
    axes = [_AXES.get(joint.shortname()[-1]) or joint.extract().axis for joint in joints]
    places = list(model.jointPlacements)[1:]
    bodies = list(model.inertias)[1:]
    arrays = [
        np.array(list(model.parents)[1:], ctypes.c_long),
        np.array(kinds, ctypes.c_long),
        np.array([[*place.rotation.ravel(), *place.translation] for place in places]),
        np.array(axes, dtype=float),
        np.array([body.mass for body in bodies]),
        np.array([body.lever for body in bodies]),
        np.array([body.inertia.ravel() for body in bodies]),
    ]
    handle = library.robot_new(len(joints), task.tip, *(array.ctypes.data for array in arrays))
    count, what = len(task.rows[0]), WORKLOADS.index(task.workload)
    results = np.empty((count, {POSE: 12, JACOBIAN: 6 * model.nv}.get(task.workload, model.nv)))
    inputs = [np.ascontiguousarray(row) for row in task.rows]
    pointers = [array.ctypes.data for array in (*inputs, results)]

    def run() -> Array:
        library.robot_run(handle, what, count, *pointers)
        return results

    weakref.finalize(run, lambda *_: library.robot_delete(handle), *inputs)  # which live as long
    return run


@functools.cache
def _robots_library() -> Any:
    library = compiled_library("robots_loop.cpp")
    pointer: Any = ctypes.c_void_p
    number: Any = ctypes.c_long
    library.robot_new.argtypes, library.robot_new.restype = [number, number] + [pointer] * 7, pointer
    library.robot_delete.argtypes, library.robot_delete.restype = [pointer], None
    library.robot_run.argtypes, library.robot_run.restype = [pointer, number, number] + [pointer] * 4, None
    return library


def mujoco_loop(task: Task) -> Job:
    """MuJoCo on the exported robot."""
    import mujoco as mj

    from hingepair.formats.model_writers import to_urdf

    model = mj.MjModel.from_xml_string(to_urdf(task.robot))
    model.opt.disableflags |= mj.mjtDisableBit.mjDSBL_CONSTRAINT  # limits push back where a state is beyond them
    model.dof_damping[:] = model.dof_frictionloss[:] = model.dof_armature[:] = 0.0
    data, rows = mj.MjData(model), task.rows
    last, solve, result = (
        (data.qacc, mj.mj_inverse, data.qfrc_inverse)
        if task.workload == INVERSE
        else (data.qfrc_applied, mj.mj_forward, data.qacc)
    )
    results = np.empty_like(rows[1])

    def run() -> Array:
        for i, given in enumerate(zip(*rows, strict=True)):
            data.qpos[:], data.qvel[:], last[:] = given
            solve(model, data)
            results[i] = result
        return results

    return run


def frax_batch(task: Task) -> Job:
    """frax, compiled by JAX for a whole batch in float64."""
    import tempfile

    import jax

    from hingepair.formats.model_writers import to_urdf

    jax.config.update("jax_enable_x64", True)  # type: ignore[no-untyped-call]
    with warnings.catch_warnings():  # frax recommends settings of its own
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
    call = jax.jit(jax.vmap(functions[task.workload]))
    rows = [jax.numpy.asarray(row) for row in task.rows]
    return lambda: call(*rows).block_until_ready()


WAYS: Final = (
    Way(PREPARED, prepared),
    Way(OURS, ours),
    Way(PYTHON_LOOP, pinocchio_loop, most=FEW, needs="pinocchio"),
    Way(PARALLEL, pinocchio_batches, least=2, most=FEW, needs="pinocchio"),
    Way(CPP, pinocchio_cpp, needs="pinocchio"),
    Way(MUJOCO, mujoco_loop, most=FEW, needs="mujoco"),
    Way(FRAX, frax_batch, least=2, needs="frax"),
)
"""The first is of one state only."""

_WORKLOADS_OF: Final = dict.fromkeys((PARALLEL, MUJOCO, FRAX), (INVERSE, FORWARD))
