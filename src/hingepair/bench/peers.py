"""Methods that compute body 2 from the same coordinates: those of this library and its alternatives.

A method makes the job of a task: a pair, a motion (q; q and qd; or q, qd and qdd, each of shape (N, 7)) and buffers
for the outputs. The job returns the outputs of the level in their order, or by name.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from operator import attrgetter
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.engines import (
    MAX_SAMPLES_IN_PYTHON_LOOP,
    MUJOCO_NAME,
    PINOCCHIO_CPP_NAME,
    PINOCCHIO_LOOP_NAME,
    make_cpp_job,
    mujoco_coordinates,
    pinocchio_coordinates,
)
from hingepair.bench.measure import Job, Method
from hingepair.bench.truth import MotionArrays
from hingepair.formats.model_writers import to_mjcf
from hingepair.pair.body import Body
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_pair import HingePair
from hingepair.validation.pinocchio_twin import to_pinocchio

Array: TypeAlias = NDArray[Any]
OutputArrays: TypeAlias = dict[str, Array]

# The outputs that are computed, by the level of the motion.
OUTPUT_NAMES_BY_LEVEL = {"pose": ("R2", "S2"), "velocity": ("R2", "S2", "v2", "omega2")}
OUTPUT_NAMES_BY_LEVEL["acceleration"] = (*OUTPUT_NAMES_BY_LEVEL["velocity"], "a2", "alpha2")

BENCH_PAIR_ARGUMENT_BY_NAME: dict[str, Any] = {
    "u1": [0.5, 0.2, 0.1],
    "u2": [-0.25, 0.1, 0.3],
    "n": [1.0, 2.0, -0.5],
    "home": [[2 / 3, -2 / 3, -1 / 3], [1 / 3, 2 / 3, -2 / 3], [2 / 3, 1 / 3, 2 / 3]],
}
"""The arguments of the pair that is measured."""


class KinematicsTask(NamedTuple):
    """A batch of states of a pair, at which every method computes the motion of body 2. `motion` is one of the tuples
    (q,), (q, qd) and (q, qd, qdd) of arrays of shape (N, 7); `buffers` is a dict of arrays for the outputs by name.
    """

    pair: HingePair
    motion: MotionArrays
    buffers: OutputArrays

    @property
    def arguments(self) -> MotionArrays:
        """Return the arrays of the motion as one of the tuples (q,), (q, qd) and (q, qd, qdd). The arrays have shape
        (N, 7), but shape (7,) for a batch of one sample.
        """
        return tuple(c[0] for c in self.motion) if len(self.motion[0]) == 1 else self.motion

    def first_samples(self, count: int) -> KinematicsTask:
        """Return the task of the first `count` samples, whose arrays are views of those of this task."""
        buffers = {name: array[:count] for name, array in self.buffers.items()}
        return KinematicsTask(self.pair, tuple(c[:count] for c in self.motion), buffers)


def make_kinematics_task(pair: HingePair, motion: MotionArrays, outputs: tuple[str, ...]) -> KinematicsTask:
    """Return a KinematicsTask with a buffer for each named output, allocated and written, so that no page fault is
    timed. `motion` is one of the tuples (q,), (q, qd) and (q, qd, qdd) of arrays of shape (N, 7).
    """
    samples = len(motion[0])
    return KinematicsTask(
        pair, motion, {name: np.ones((samples, 3, 3) if name == "S2" else (samples, 3)) for name in outputs}
    )


def hingepair_job_maker(*, allocates_outputs: bool = False, **options: Any) -> Callable[[KinematicsTask], Job]:
    """Return a function from a KinematicsTask to a job, which calls `pair.forward_kinematics` and returns a tuple of
    the outputs. The outputs are new arrays if `allocates_outputs` or for one state; otherwise they are the task's
    buffers. The further keyword arguments are options of `forward_kinematics`.

    Args:
        allocates_outputs: whether the outputs are new arrays; otherwise they are the buffers of the task.
        options: further options of `forward_kinematics`.
    """

    def make(task: KinematicsTask) -> Job:
        call, arguments, names = task.pair.forward_kinematics, task.arguments, tuple(task.buffers)
        out, read = None if arguments[0].ndim == 1 or allocates_outputs else task.buffers, attrgetter(*names)
        return lambda: read(call(*arguments, outputs=names, out=out, **options))

    return make


def prepared_kinematics_job(task: KinematicsTask) -> Job:
    """Return a job that calls the function that `pair.prepare` returns with the task's state or batch. The job
    returns a tuple of the outputs, which are new arrays.
    """
    arguments, names = task.arguments, tuple(task.buffers)
    call, read = task.pair.prepare(list(OUTPUT_NAMES_BY_LEVEL)[len(arguments) - 1], outputs=names), attrgetter(*names)
    return lambda: read(call(*arguments))


def copy_job(task: KinematicsTask) -> Job:
    """Return a job that fills the task's buffers by copying arrays of the same size, and returns None. Its run time
    is a lower bound of the run time of any method.
    """
    source = {name: np.ones_like(array) for name, array in task.buffers.items()}

    def run() -> None:
        for name, array in source.items():
            np.copyto(task.buffers[name], array)

    return run


def fresh_copy_job(task: KinematicsTask) -> Job:
    """Return a job that copies arrays of the size of the task's buffers, and returns a list of the new arrays."""
    source = [np.ones_like(array) for array in task.buffers.values()]
    return lambda: [array.copy() for array in source]


def _pinocchio_inputs(task: KinematicsTask) -> list[Array]:
    """Return the task's motion as Pinocchio's q, v, a: a list of one to three arrays."""
    names = ("R1", "S1", "v1", "omega1", "a1", "alpha1")[: 2 * len(task.motion)]
    state = task.pair.forward_kinematics(*task.motion, outputs=names, backend="numpy")
    quantities: Any = {name[:-1]: getattr(state, name) for name in names}
    return pinocchio_coordinates(task.pair, BodyMotion(**quantities), [c[:, 6] for c in task.motion])


def pinocchio_kinematics_job(task: KinematicsTask) -> Job:
    """Return a job that calls Pinocchio for each sample of the task in a Python loop. The job returns a dict of the
    outputs by name: the task's buffers, filled, or for a single sample Pinocchio's arrays.

    The results are copied into the buffers; those of a single sample are only read out.
    """
    import pinocchio as pin

    twin = to_pinocchio(task.pair)
    model, data, frame = twin.model, twin.data, twin.body2_frame
    inputs, buffers = _pinocchio_inputs(task), task.buffers
    level, world = len(inputs), pin.LOCAL_WORLD_ALIGNED

    def read(*rows: Array) -> OutputArrays:
        """Compute the outputs of body 2 by Pinocchio for one sample, whose q, v and a are the arguments; return a
        dict of arrays by output name.
        """
        pin.forwardKinematics(model, data, *rows)
        placement = pin.updateFramePlacement(model, data, frame)
        outputs = {"R2": placement.translation, "S2": placement.rotation}
        if level > 1:
            twist = pin.getFrameVelocity(model, data, frame, world)
            outputs["v2"], outputs["omega2"] = twist.linear, twist.angular
        if level > 2:
            change = pin.getFrameClassicalAcceleration(model, data, frame, world)
            outputs["a2"], outputs["alpha2"] = change.linear, change.angular
        return outputs

    if len(inputs[0]) == 1:
        first = tuple(c[0] for c in inputs)
        return lambda: read(*first)

    def run() -> OutputArrays:
        """Compute the outputs of body 2 by Pinocchio, one sample at a time; return the task's buffers, filled."""
        for i, rows in enumerate(zip(*inputs, strict=True)):
            for name, value in read(*rows).items():
                buffers[name][i] = value
        return buffers

    return run


def pinocchio_cpp_kinematics_job(task: KinematicsTask) -> Job:
    """Compile Pinocchio's C++ loop, unless it has been compiled before, and return a job that calls Pinocchio for
    each sample of the task in this loop. The job writes the outputs into the task's buffers and returns these, a dict
    by name. Raise a MissingDependencyError if the loop cannot be compiled.
    """
    rows = [*_pinocchio_inputs(task), None, None][:3]
    outputs = [task.buffers.get(name) for name in OUTPUT_NAMES_BY_LEVEL["acceleration"]]
    return make_cpp_job(task.pair, [len(task.motion[0]), *rows, *outputs], task.buffers)


def mujoco_kinematics_job(task: KinematicsTask) -> Job:
    """Return a job that calls the functions of MuJoCo that compute the task's outputs, for each sample of the task in
    a Python loop. The job writes the outputs into the task's buffers and returns these, a dict by name.
    """
    import mujoco as mj

    inputs, buffers = mujoco_coordinates(_pinocchio_inputs(task), *(c[:, :3] for c in task.motion[1:])), task.buffers
    body = Body(1.0, inertia=(0.01, 0.01, 0.01))  # MuJoCo's kinematics want masses, and no gravity in accelerations
    model = mj.MjModel.from_xml_string(to_mjcf(replace(task.pair, body1=body, body2=body), gravity=(0, 0, 0)))
    data = mj.MjData(model)
    body2, kind = model.body("body2").id, mj.mjtObj.mjOBJ_XBODY
    position, matrix = data.xpos[body2], data.xmat[body2].reshape(3, 3)
    targets = (data.qpos, data.qvel, data.qacc)
    six = np.zeros((6, 1))
    angular, linear = six[:3, 0], six[3:, 0]

    def run() -> OutputArrays:
        """Compute the outputs of body 2 by MuJoCo, one sample at a time; return the task's buffers, filled."""
        for i, rows in enumerate(zip(*inputs, strict=True)):
            for target, source in zip(targets, rows, strict=False):
                target[:] = source
            mj.mj_kinematics(model, data)
            buffers["R2"][i], buffers["S2"][i] = position, matrix
            if len(inputs) > 1:
                mj.mj_comPos(model, data)
                mj.mj_comVel(model, data)
                mj.mj_objectVelocity(model, data, kind, body2, six, 0)
                buffers["v2"][i], buffers["omega2"][i] = linear, angular
            if len(inputs) > 2:
                mj.mj_rnePostConstraint(model, data)
                mj.mj_objectAcceleration(model, data, kind, body2, six, 0)
                buffers["a2"][i], buffers["alpha2"][i] = linear, angular
        return buffers

    return run


def scipy_rotation_job(task: KinematicsTask) -> Job:
    """Return a job that computes the outputs of the whole batch, the attitudes by SciPy's Rotation and all else by
    NumPy. The job returns a dict of new arrays by output name.
    """
    from scipy.spatial.transform import Rotation

    pair, q = task.pair, task.motion[0]
    home = Rotation.from_matrix(pair.home)

    def run() -> OutputArrays:
        first = Rotation.from_euler("XYZ", q[:, 3:6])
        second = first * Rotation.from_rotvec(q[:, 6:] * pair.n) * home
        return _body2_from_stacks(np, pair, task.motion, first.as_matrix(), second.as_matrix())

    return run


def numpy_stacks_job(task: KinematicsTask) -> Job:
    """Return a job that computes the outputs of the whole batch by NumPy on stacks of 3 x 3 matrices, with @ and
    numpy.cross. The job returns a dict of new arrays by output name.
    """
    pair, motion, _ = task
    return lambda: _body2_from_stacks(np, pair, motion, *_stacked_attitudes(np, pair, motion[0]))


def jax_job(task: KinematicsTask) -> Job:
    """Return a job that computes the outputs of the whole batch by jax.jit on stacks of 3 x 3 matrices, on one core.
    The job returns a dict of NumPy arrays by output name. Inputs are converted to JAX arrays when the job is made.
    """
    with _restrict_to_one_core():
        import jax
        import jax.numpy as jnp

        device = jax.devices("cpu")[0]
    pair = task.pair
    function = jax.jit(
        lambda *motion: _body2_from_stacks(jnp, pair, motion, *_stacked_attitudes(jnp, pair, motion[0]))
    )
    with jax.enable_x64(True):
        inputs = [jax.device_put(c, device) for c in task.motion]

    def run() -> OutputArrays:
        with jax.enable_x64(True):
            return {name: np.asarray(array) for name, array in function(*inputs).items()}

    return run


def _stacked_attitudes(xp: Any, pair: HingePair, q: Any) -> tuple[Any, Any]:
    """Return the attitudes S1 and S2 of both bodies, shape (N, 3, 3) each, for coordinates q, shape (N, 7). They are
    computed by whole-array operations of `xp`, which is numpy or jax.numpy.

    Args:
        xp: the array library, numpy or jax.numpy.
        pair: its axis and home rotation are used.
        q: coordinates; shape (N, 7).
    """
    x, y, z = pair.n
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    S1 = _stacked_rotation(xp, 0, q[:, 3]) @ _stacked_rotation(xp, 1, q[:, 4]) @ _stacked_rotation(xp, 2, q[:, 5])
    s, c = xp.sin(q[:, 6])[:, None, None], xp.cos(q[:, 6])[:, None, None]
    return S1, S1 @ (np.eye(3) + s * K + (1 - c) * (K @ K)) @ pair.home


def _stacked_rotation(xp: Any, axis_index: int, angle: Any) -> Any:
    """Return rotation matrices about the axis x, y or z (index 0, 1 or 2) by an array of angles [rad], shape (N, 3,
    3). `xp` is numpy or jax.numpy.
    """
    i, j = (axis_index + 1) % 3, (axis_index + 2) % 3
    rows: list[list[Any]] = [[xp.zeros_like(angle)] * 3 for _ in range(3)]
    rows[axis_index][axis_index] = xp.ones_like(angle)
    rows[i][i] = rows[j][j] = xp.cos(angle)
    rows[j][i] = xp.sin(angle)
    rows[i][j] = -rows[j][i]
    return xp.stack([xp.stack(row, -1) for row in rows], -2)


def _body2_from_stacks(xp: Any, pair: HingePair, motion: tuple[Any, ...], S1: Any, S2: Any) -> OutputArrays:
    """Return a dict of R2, S2, v2, omega2, a2 and alpha2 by name, computed from the attitudes S1, S2, shape (N, 3,
    3), by `xp`, which is numpy or jax.numpy. `motion` is one of the tuples (q,), (q, qd) and (q, qd, qdd). The dict
    has no rates without qd, and no accelerations without qdd.
    """
    q = motion[0]
    r1, r2 = S1 @ pair.u1, S2 @ pair.u2
    outputs = {"R2": q[:, :3] + r1 - r2, "S2": S2}
    if len(motion) > 1:
        qd = motion[1]
        c, s = xp.cos(q[:, 3]), xp.sin(q[:, 3])
        zero = xp.zeros_like(c)
        b = xp.stack([zero, c, s], axis=-1)
        omega_x, omega_y = xp.stack([qd[:, 3], zero, zero], axis=-1), b * qd[:, 4:5]
        omega1 = omega_x + omega_y + S1[:, :, 2] * qd[:, 5:6]
        axis = S1 @ pair.n
        omega2 = omega1 + axis * qd[:, 6:]
        outputs |= {"v2": qd[:, :3] + xp.cross(omega1, r1) - xp.cross(omega2, r2), "omega2": omega2}
    if len(motion) > 2:
        qdd = motion[2]
        alpha1 = xp.stack([qdd[:, 3], zero, zero], axis=-1) + b * qdd[:, 4:5] + S1[:, :, 2] * qdd[:, 5:6]
        alpha1 += xp.cross(omega_x, omega_y) + xp.cross(omega_x + omega_y, S1[:, :, 2] * qd[:, 5:6])
        alpha2 = alpha1 + axis * qdd[:, 6:] + xp.cross(omega1, axis) * qd[:, 6:]
        a1 = qdd[:, :3] + xp.cross(alpha1, r1) + xp.cross(omega1, xp.cross(omega1, r1))
        outputs |= {"a2": a1 - xp.cross(alpha2, r2) - xp.cross(omega2, xp.cross(omega2, r2)), "alpha2": alpha2}
    return outputs


@contextmanager
def _restrict_to_one_core() -> Iterator[None]:
    """Return a context manager whose block runs on one core: it restricts the calling thread and the threads that the
    block starts. At the end, the calling thread may use its former cores again. Do nothing on a system that cannot
    restrict threads.

    JAX then makes one thread when it first lists its devices.
    """
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def hingepair_cycle_job(pair: HingePair, *state: Any) -> Job:
    """Return a job that computes a control cycle at one state of the pair: R2, S2, v2, omega2, Jacobian and
    acceleration bias of body 2, as a tuple. The further arguments are the state: R1, quat_xyzw, v1, omega1, psi and
    psi'.

    Args:
        pair: the pair.
        state: R1, quat_xyzw, v1, omega1, psi, psi'.
    """
    names = ("R2", "S2", "v2", "omega2", "jacobian", "acceleration_bias")
    cycle = pair.prepare(("R1", "quat_xyzw", "v1", "omega1", "psi", "psid"), outputs=names)
    read = attrgetter(*names)
    return lambda: read(cycle(*state))


def pinocchio_cycle_job(
    pair: HingePair, R: Array, quat: Array, v: Array, omega: Array, psi: float, psid: float
) -> Job:
    """Return a job that computes a control cycle at one state by Pinocchio: a tuple of R2, S2, v2, omega2 and
    Jacobian of body 2, and the linear and the angular acceleration bias. The state is position, quaternion (x, y, z,
    w), velocity and angular velocity of body 1, psi and psi'; its conversion to Pinocchio's coordinates is not timed.
    """
    import pinocchio as pin

    twin = to_pinocchio(pair)
    model, data, frame, world = twin.model, twin.data, twin.body2_frame, pin.LOCAL_WORLD_ALIGNED
    body1 = BodyMotion.from_quaternion_xyzw(R=R, quat_xyzw=quat, v=v, omega=omega)
    q, rates, zeros = np.array([*R, *quat, psi]), twin.velocity(body1, psi, psid), np.zeros(7)

    def run() -> Any:
        """Return a tuple of seven arrays of body 2 for one state, computed by Pinocchio: R2, S2, v2, omega2,
        Jacobian, and the linear and the angular acceleration bias.
        """
        pin.forwardKinematics(model, data, q, rates, zeros)
        placement = pin.updateFramePlacement(model, data, frame)
        twist = pin.getFrameVelocity(model, data, frame, world)
        pin.computeJointJacobians(model, data)
        jacobian = pin.getFrameJacobian(model, data, frame, world)
        bias = pin.getFrameClassicalAcceleration(model, data, frame, world)
        pose = placement.translation, placement.rotation
        return *pose, twist.linear, twist.angular, jacobian, bias.linear, bias.angular

    return run


# Names of the methods.
COPY_FLOOR_NAME, FRESH_COPY_FLOOR_NAME = "copy floor", "copy floor, fresh"
HINGEPAIR_NAME, FRESH_NAME, PREPARED_NAME, NUMPY_NAME = (
    "hingepair",
    "hingepair, fresh",
    "hingepair, prepared",
    "hingepair, NumPy",
)

# All methods of `hingepair bench direct`; ratios refer to the first one.
COMPARED_KINEMATICS_METHODS = (
    Method(HINGEPAIR_NAME, hingepair_job_maker(backend="compiled")),
    Method(PREPARED_NAME, prepared_kinematics_job, in_picture=False),
    Method(
        FRESH_NAME, hingepair_job_maker(allocates_outputs=True, backend="compiled"), min_samples=2, in_picture=False
    ),
    Method("hingepair, 2 workers", hingepair_job_maker(workers=2, backend="compiled"), min_samples=10**5),
    Method(NUMPY_NAME, hingepair_job_maker(backend="numpy")),
    Method(
        PINOCCHIO_LOOP_NAME, pinocchio_kinematics_job, max_samples=MAX_SAMPLES_IN_PYTHON_LOOP, package="pinocchio"
    ),
    Method(PINOCCHIO_CPP_NAME, pinocchio_cpp_kinematics_job, max_samples=10**6, package="pinocchio"),
    Method(MUJOCO_NAME, mujoco_kinematics_job, max_samples=MAX_SAMPLES_IN_PYTHON_LOOP, package="mujoco"),
    Method("JAX, compiled, one core", jax_job, package="jax"),
    Method("SciPy Rotation + NumPy", scipy_rotation_job, max_samples=10**5, package="scipy"),
    Method("NumPy, stacks of 3x3", numpy_stacks_job, max_samples=10**5),
    Method(COPY_FLOOR_NAME, copy_job, min_samples=2, in_picture=False),
    Method(FRESH_COPY_FLOOR_NAME, fresh_copy_job, min_samples=2, in_picture=False),
)
