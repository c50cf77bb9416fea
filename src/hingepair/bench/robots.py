"""`hingepair bench robots`: poses, Jacobians and dynamics of whole robots, beside Pinocchio, MuJoCo and frax (JAX).

The error of a result is its difference from the result of fifty-digit arithmetic, relative to its largest component.
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

from hingepair.bench.engines import (
    FORWARD_WORKLOAD,
    INVERSE_WORKLOAD,
    MAX_SAMPLES_IN_PYTHON_LOOP,
    MUJOCO_NAME,
    PINOCCHIO_CPP_NAME,
    PINOCCHIO_LOOP_NAME,
    compile_library,
    cpp_missing_reason,
)
from hingepair.bench.measure import (
    Job,
    Method,
    Report,
    Row,
    available_methods,
    case_name,
    measure_methods,
    print_progress,
)
from hingepair.bench.peers import HINGEPAIR_NAME, PREPARED_NAME
from hingepair.bench.plot import MethodCurve, Panel
from hingepair.bench.robot_truth import ROBOT_TRUTH_DECIMAL_DIGITS, ExactRobot
from hingepair.formats.robots import load_robot, robot_urdf
from hingepair.mechanism.mechanism import Mechanism

Array: TypeAlias = NDArray[Any]

LOCKED_JOINT_POSITIONS_BY_ROBOT_NAME: Final = {
    "ur5_robot": {},
    "panda": {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0},
    "solo12": {},
    "talos_reduced": {},
}
"""The robots that are measured unless given, and the positions of their locked joints [m]."""

POSE_WORKLOAD, JACOBIAN_WORKLOAD = "pose", "Jacobian"  # names of workloads
# All workloads, in the order of the table and of the constants in robots_loop.cpp.
WORKLOAD_NAMES: Final = (POSE_WORKLOAD, JACOBIAN_WORKLOAD, INVERSE_WORKLOAD, FORWARD_WORKLOAD)

_NUM_STATES_COMPARED_WITH_EXACT: Final = 4
"""Number of states whose results are compared with the exact ones."""

# Sentences below the table.
_TABLE_NOTES: Final = (
    "Each row is one engine on one task, on one thread (JAX chooses its threads itself), compiled before the "
    "measurement. N: states of a call; a call: median time of a call; each: time for one state; ratio: that time "
    "divided by the time of the first row.",
    f"error: largest difference from {ROBOT_TRUTH_DECIMAL_DIGITS}-digit arithmetic at "
    f"{_NUM_STATES_COMPARED_WITH_EXACT} random states, relative to the largest component of the "
    "result (the unit roundoff of a double is 1.1e-16).",
    "pose, Jacobian: of the joint that is furthest from the base. hingepair, prepared: the result of robot.prepare, "
    "called with one state. Pinocchio, its own batches: rneaInParallel, abaInParallel. Python loops compute at most "
    f"{MAX_SAMPLES_IN_PYTHON_LOOP:,} states.",
)

# Names of further methods.
PINOCCHIO_PARALLEL_NAME, FRAX_NAME = "Pinocchio, its own batches", "frax (JAX, one batch)"

# Pinocchio's joint models, in the order of the constants in robots_loop.cpp, and the axes of those along x, y, z.
_PINOCCHIO_JOINT_TYPE_NAMES_IN_CPP_ORDER: Final = (
    "RX",
    "RY",
    "RZ",
    "RevoluteUnaligned",
    "PX",
    "PY",
    "PZ",
    "PrismaticUnaligned",
)
# axes of joint models, by their last letter
_UNIT_AXIS_BY_LAST_LETTER_OF_PINOCCHIO_JOINT_TYPE: Final = {
    "X": (1.0, 0.0, 0.0),
    "Y": (0.0, 1.0, 0.0),
    "Z": (0.0, 0.0, 1.0),
}


class RobotTask(NamedTuple):
    """Random states of a robot (`robot`, a Mechanism), and the workload ("pose", "Jacobian", "inverse dynamics" or
    "forward dynamics") that is computed at them. `model` is Pinocchio's model of the robot, and `tip` is the number
    that the model gives to the joint furthest from the base. `rows` is a tuple of q, q' and, for forward dynamics,
    the efforts, otherwise q'', shape (N, dof) each.
    """

    name: str  # of the robot
    robot: Mechanism
    model: Any  # Pinocchio's model of the same robot
    workload: str  # one of WORKLOAD_NAMES
    tip: int  # Pinocchio's number of the joint furthest from the base
    rows: tuple[Array, Array, Array]  # q, q' and q'', or for forward dynamics the efforts; shape (N, dof)


def measure_robots(names: Sequence[str], sizes: Sequence[int], repeats: int, with_cpp: bool) -> Report:
    """Measure run times and errors of all engines for every workload of the named robots at batch sizes `sizes`,
    `repeats` times; return the Report. `with_cpp` compiles and adds Pinocchio's C++ loop.
    """
    if with_cpp:
        print_progress("compiling Pinocchio's C++ loop (one or two minutes)")
    methods, left_out = available_methods(
        COMPARED_ROBOT_METHODS, {PINOCCHIO_CPP_NAME: cpp_missing_reason(with_cpp, "robots_loop.cpp")}
    )
    rows = list[Row]()
    for name in names:
        robot, model = _load_models(name)
        for workload in WORKLOAD_NAMES:
            make_task = functools.cache(functools.partial(make_robot_task, name, robot, model, workload))
            suitable = [
                method
                for method in methods
                if workload in _WORKLOAD_NAMES_BY_NAME_OF_RESTRICTED_METHOD.get(method.name, WORKLOAD_NAMES)
            ]
            errors = _robot_errors(suitable, make_task)
            for size in sizes:
                print_progress(f"{name}, {workload}, N = {size:,}: {repeats} repeats")
                measured = [method for method in suitable if method.name != PREPARED_NAME or size == 1]
                rows += measure_methods(
                    _robot_case_name(robot, workload, size), measured, make_task, size, repeats, errors
                )
    return Report(rows, "error", [*left_out, *_TABLE_NOTES], _run_time_panels(rows, max(sizes)))


def _robot_case_name(robot: Mechanism, workload: str, size: int) -> str:
    """Return the name of the case of a robot's workload at `size` states, as text with the robot's name and number of
    joints.
    """
    return case_name(f"{robot.name} ({robot.dof} joints), {workload}", size)


def _robot_errors(methods: Sequence[Method], make_task: Callable[[int], RobotTask]) -> dict[str, float]:
    """Compute a few states of one robot and workload by each method and exactly; return a dict from the method's name
    to its largest relative error. `make_task` is a function from a number of states to a RobotTask.
    """
    print_progress(f"{make_task(1).name}, {make_task(1).workload}: {ROBOT_TRUTH_DECIMAL_DIGITS} digits")
    truth = exact_robot_results(make_task(_NUM_STATES_COMPARED_WITH_EXACT))
    return {
        method.name: robot_error(
            method, make_task(1 if method.name == PREPARED_NAME else _NUM_STATES_COMPARED_WITH_EXACT), truth
        )
        for method in methods
    }


def _run_time_panels(rows: Sequence[Row], size: int) -> list[list[Panel]]:
    """Return the picture's panels, one for each workload, as a list of two rows of two panels. A panel has a line for
    each robot and shows, along x, the run times per state of batches of `size` states by each method.

    The legend shows the largest error of each engine.
    """
    batches = [row for row in rows if row.case.endswith(case_name("", size)) and row.method != PREPARED_NAME]
    errors: dict[str, float] = {}
    for row in batches:
        errors[row.method] = max(errors.get(row.method, 0.0), row.error or 0.0)
    times = [row.seconds / row.count * 1e9 for row in batches]
    x_range = (min(times) / 2, 2 * max(times))
    panels: list[Panel] = []
    for workload in WORKLOAD_NAMES:
        cases = [row for row in batches if row.case.endswith(case_name(f", {workload}", size))]
        names = list(dict.fromkeys(row.case.partition(",")[0] for row in cases))
        curves: dict[str, list[tuple[float, float]]] = {}
        for row in cases:
            point = row.seconds / row.count * 1e9, float(names.index(row.case.partition(",")[0]))
            curves.setdefault(f"{row.method}: error {errors[row.method]:.0e}", []).append(point)
        workload_curves = [MethodCurve(*item) for item in curves.items()]
        panels.append(
            Panel(
                case_name(workload, size),
                "run time per state [ns]",
                "",
                workload_curves,
                y_names=names,
                x_range=x_range,
            )
        )
    return [panels[:2], panels[2:]]


def _load_models(name: str) -> tuple[Mechanism, Any]:
    """Load the robot of example-robot-data named `name`; return a tuple of its Mechanism and of Pinocchio's model,
    from the same file and with the same locked joints.
    """
    import pinocchio as pin

    full = pin.buildModelFromUrdf(str(robot_urdf(name)))
    locked = [full.getJointId(joint) for joint in LOCKED_JOINT_POSITIONS_BY_ROBOT_NAME.get(name, {})]
    model = pin.buildReducedModel(full, locked, pin.neutral(full)) if locked else full
    return load_robot(name, locked=LOCKED_JOINT_POSITIONS_BY_ROBOT_NAME.get(name, {})), model


def make_robot_task(name: str, robot: Mechanism, model: Any, workload: str, count: int) -> RobotTask:
    """Return a RobotTask of `count` random states of a robot for the named workload; `model` is Pinocchio's model of
    the robot. A larger task begins with the states of a smaller one.
    """
    rng = np.random.default_rng(31)
    depth = [0]
    for joint in range(1, model.njoints):
        depth.append(depth[model.parents[joint]] + 1)
    states = rng.uniform(-1, 1, (count, 3, robot.dof))
    q, v, w = np.ascontiguousarray(states.transpose(1, 0, 2))
    return RobotTask(name, robot, model, workload, int(np.argmax(depth)), (q, v, w))


def exact_robot_results(task: RobotTask) -> Array:
    """Compute the task's workload at all its states in fifty-digit arithmetic; return an array of mpmath numbers,
    shape (N, components), with matrices flattened row by row.
    """
    joint, rows = task.model.names[task.tip], []
    for q, v, w in zip(*task.rows, strict=True):
        truth = ExactRobot(task.robot.tree, q)
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


def robot_error(method: Method, task: RobotTask, exact_results: Array) -> float:
    """Run the method's job of a task; return the largest error of its results, each relative to the largest component
    of the exact result of its state. `exact_results` has a row for each state.
    """
    expected = exact_results[: len(task.rows[0])]
    result = np.asarray(method.make_job(task)(), dtype=float).reshape(expected.shape)
    return max(float(abs(a - b).max() / abs(b).max()) for a, b in zip(result, expected, strict=True))


def _read_pose(state: Any) -> Array:
    """Return position and rotation of the first frame of a state; shape (..., 12)."""
    R, S = state.R[..., 0, :], state.S[..., 0, :, :]
    return np.concatenate([R, S.reshape(*R.shape[:-1], 9)], axis=-1)


def hingepair_robot_job(task: RobotTask) -> Job:
    """Return a job that computes the task's workload for all states at once by a method of `Mechanism`. The job
    returns the result, an array or an object that NumPy converts into one. The first call of the job compiles.
    """
    (q, v, w), tip = task.rows, task.model.names[task.tip]
    if task.workload == POSE_WORKLOAD:
        # Position and rotation are put into one array only for the comparison, which is no work of the engine.
        job = functools.partial(
            task.robot.forward_kinematics, q, frames=(tip,), outputs=("R", "S"), backend="compiled"
        )
        return _JobWithReader(job, _read_pose)
    calls = {
        JACOBIAN_WORKLOAD: lambda: task.robot.jacobian(q, tip, backend="compiled"),
        INVERSE_WORKLOAD: lambda: task.robot.inverse_dynamics(q, v, w, outputs=("tau",), backend="compiled").tau,
        FORWARD_WORKLOAD: lambda: task.robot.forward_dynamics(q, v, w, backend="compiled").qdd,
    }
    return calls[task.workload]


class _JobWithReader:
    """A job that calls another job and returns its result as a _LazyArray, which is converted into an array by `read`
    only when results are compared. The conversion is therefore not timed.
    """

    def __init__(self, job: Job, read: Any) -> None:
        self._job, self._read = job, read

    def __call__(self) -> Any:
        return _LazyArray(self._job(), self._read)


class _LazyArray:
    """A result that is converted into an array, by the function `read`, when NumPy converts this object into one."""

    def __init__(self, result: Any, read: Any) -> None:
        self._result, self._read = result, read

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.array(self._read(self._result), dtype=dtype, copy=copy)


def prepared_robot_job(task: RobotTask) -> Job:
    """Return a job that computes the task's workload at its first state by the function that `robot.prepare` returns.
    The job returns the result, an array or an object that NumPy converts into one.
    """
    q, v, w = (row[0].copy() for row in task.rows)
    tip = task.model.names[task.tip]
    if task.workload == POSE_WORKLOAD:
        pose = task.robot.prepare("pose", frames=(tip,), outputs=("R", "S"))
        return _JobWithReader(lambda: pose(q), _read_pose)
    if task.workload == JACOBIAN_WORKLOAD:
        jacobian = task.robot.prepare("jacobian", frames=(tip,))
        return lambda: jacobian(q)
    if task.workload == INVERSE_WORKLOAD:
        inverse = task.robot.prepare("inverse_dynamics", outputs=("tau",))
        return lambda: inverse(q, v, w).tau
    forward = task.robot.prepare("forward_dynamics")
    return lambda: forward(q, v, w).qdd


def pinocchio_robot_job(task: RobotTask) -> Job:
    """Return a job that computes the task's workload by Pinocchio, in a Python loop over the states, and returns an
    array with a row for each state.
    """
    import pinocchio as pin

    model, (q, v, w), tip = task.model, task.rows, task.tip
    data, frame = model.createData(), pin.LOCAL_WORLD_ALIGNED
    results = np.empty((len(q), {POSE_WORKLOAD: 12, JACOBIAN_WORKLOAD: 6 * model.nv}.get(task.workload, model.nv)))

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

    compute = {
        POSE_WORKLOAD: pose,
        JACOBIAN_WORKLOAD: jacobian,
        INVERSE_WORKLOAD: inverse,
        FORWARD_WORKLOAD: forward,
    }[task.workload]

    def run() -> Array:
        for i in range(len(q)):
            compute(i)
        return results

    return run


def pinocchio_batch_job(task: RobotTask) -> Job:
    """Return a job that computes the task's inverse or forward dynamics by Pinocchio's own batch functions on one
    thread, and returns an array with a row for each state.
    """
    import pinocchio as pin

    pool = pin.ModelPool(task.model, 1)
    rows = [np.asfortranarray(row.T) for row in task.rows]
    batch = pin.rneaInParallel if task.workload == INVERSE_WORKLOAD else pin.abaInParallel
    return lambda: batch(1, pool, *rows).T


def pinocchio_cpp_robot_job(task: RobotTask) -> Job:
    """Compile Pinocchio's C++ loops, unless they have been compiled before, and return a job that computes the task's
    workload by a C++ loop over the states. The job returns an array with a row for each state. Raise a
    MissingDependencyError if the loops cannot be compiled.
    """
    library, model = _load_robots_library(), task.model
    joints = [model.joints[k] for k in range(1, model.njoints)]
    kinds = [
        _PINOCCHIO_JOINT_TYPE_NAMES_IN_CPP_ORDER.index(joint.shortname().removeprefix("JointModel"))
        for joint in joints
    ]
    axes = [
        _UNIT_AXIS_BY_LAST_LETTER_OF_PINOCCHIO_JOINT_TYPE.get(joint.shortname()[-1]) or joint.extract().axis
        for joint in joints
    ]
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
    count, workload = len(task.rows[0]), WORKLOAD_NAMES.index(task.workload)
    results = np.empty((count, {POSE_WORKLOAD: 12, JACOBIAN_WORKLOAD: 6 * model.nv}.get(task.workload, model.nv)))
    inputs = [np.ascontiguousarray(row) for row in task.rows]
    pointers = [array.ctypes.data for array in (*inputs, results)]

    def run() -> Array:
        library.robot_run(handle, workload, count, *pointers)
        return results

    weakref.finalize(
        run, lambda *_: library.robot_delete(handle), *inputs
    )  # keeps the inputs alive as long as the job
    return run


@functools.cache
def _load_robots_library() -> Any:
    """Compile the C++ loops over robots; return the ctypes library. The library is cached. Raise a
    MissingDependencyError if the compiler or a header is missing.
    """
    library = compile_library("robots_loop.cpp")
    pointer: Any = ctypes.c_void_p
    number: Any = ctypes.c_long
    library.robot_new.argtypes, library.robot_new.restype = [number, number] + [pointer] * 7, pointer
    library.robot_delete.argtypes, library.robot_delete.restype = [pointer], None
    library.robot_run.argtypes, library.robot_run.restype = [pointer, number, number] + [pointer] * 4, None
    return library


def mujoco_robot_job(task: RobotTask) -> Job:
    """Return a job that computes the task's inverse or forward dynamics by MuJoCo, in a Python loop over the states,
    on the robot that `to_urdf` exports. The job returns an array with a row for each state.
    """
    import mujoco as mj

    from hingepair.formats.model_writers import to_urdf

    model = mj.MjModel.from_xml_string(to_urdf(task.robot))
    model.opt.disableflags |= (
        mj.mjtDisableBit.mjDSBL_CONSTRAINT
    )  # joint limits would exert forces on states outside them
    model.dof_damping[:] = model.dof_frictionloss[:] = model.dof_armature[:] = 0.0
    data, rows = mj.MjData(model), task.rows
    last, solve, result = (
        (data.qacc, mj.mj_inverse, data.qfrc_inverse)
        if task.workload == INVERSE_WORKLOAD
        else (data.qfrc_applied, mj.mj_forward, data.qacc)
    )
    results = np.empty_like(rows[1])

    def run() -> Array:
        """Compute the efforts or accelerations of every state by MuJoCo; return an array with a row per state."""
        for i, row in enumerate(zip(*rows, strict=True)):
            data.qpos[:], data.qvel[:], last[:] = row
            solve(model, data)
            results[i] = result
        return results

    return run


def frax_job(task: RobotTask) -> Job:
    """Return a job that computes the task's inverse or forward dynamics by frax, compiled by JAX for a whole batch,
    and returns a JAX array. Switch JAX to float64 for the whole process.
    """
    import tempfile

    import jax

    from hingepair.formats.model_writers import to_urdf

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
        INVERSE_WORKLOAD: lambda q, v, w: robot.rnea(q, v, w, gravity, None),
        FORWARD_WORKLOAD: lambda q, v, w: robot.forward_dynamics(q, v, w, None),
    }
    call = jax.jit(jax.vmap(functions[task.workload]))
    rows = [jax.numpy.asarray(row) for row in task.rows]
    return lambda: call(*rows).block_until_ready()


COMPARED_ROBOT_METHODS: Final = (
    Method(PREPARED_NAME, prepared_robot_job),
    Method(HINGEPAIR_NAME, hingepair_robot_job),
    Method(PINOCCHIO_LOOP_NAME, pinocchio_robot_job, max_samples=MAX_SAMPLES_IN_PYTHON_LOOP, package="pinocchio"),
    Method(
        PINOCCHIO_PARALLEL_NAME,
        pinocchio_batch_job,
        min_samples=2,
        max_samples=MAX_SAMPLES_IN_PYTHON_LOOP,
        package="pinocchio",
    ),
    Method(PINOCCHIO_CPP_NAME, pinocchio_cpp_robot_job, package="pinocchio"),
    Method(MUJOCO_NAME, mujoco_robot_job, max_samples=MAX_SAMPLES_IN_PYTHON_LOOP, package="mujoco"),
    Method(FRAX_NAME, frax_job, min_samples=2, package="frax"),
)
"""All methods of `hingepair bench robots`; the first one computes one state only."""

# The workloads of the methods that do not compute all of them.
_WORKLOAD_NAMES_BY_NAME_OF_RESTRICTED_METHOD: Final = dict.fromkeys(
    (PINOCCHIO_PARALLEL_NAME, MUJOCO_NAME, FRAX_NAME), (INVERSE_WORKLOAD, FORWARD_WORKLOAD)
)
