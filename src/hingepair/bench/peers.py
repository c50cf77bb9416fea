"""Ways to body 2 from the same coordinates: this library's, and what a Python user would take instead.

A way makes a job of a task: a pair, a motion (q, qd, qdd as far as they go, shape (N, 7)) and room for the outputs;
the job returns the outputs of the level in their order, or by name.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from operator import attrgetter
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.engines import CPP, FEW, MUJOCO, PYTHON_LOOP, cpp_job, mujoco_rows, pinocchio_rows
from hingepair.bench.measure import Job, Way
from hingepair.formats.model_writers import to_mjcf
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_pair import HingePair
from hingepair.validation.pinocchio_twin import to_pinocchio

Array: TypeAlias = NDArray[Any]
Motion: TypeAlias = tuple[Array, ...]
Room: TypeAlias = dict[str, Array]

LEVELS = {"pose": ("R2", "S2"), "velocity": ("R2", "S2", "v2", "omega2")}
LEVELS["acceleration"] = (*LEVELS["velocity"], "a2", "alpha2")

CONSTANTS: dict[str, Any] = {
    "u1": [0.5, 0.2, 0.1],
    "u2": [-0.25, 0.1, 0.3],
    "n": [1.0, 2.0, -0.5],
    "home": [[2 / 3, -2 / 3, -1 / 3], [1 / 3, 2 / 3, -2 / 3], [2 / 3, 1 / 3, 2 / 3]],
}
"""Of the pair that is measured."""


class Task(NamedTuple):
    """What all ways compute."""

    pair: HingePair
    motion: Motion
    room: Room

    @property
    def given(self) -> Motion:
        """The motion; of one sample, as one state."""
        return tuple(c[0] for c in self.motion) if len(self.motion[0]) == 1 else self.motion

    def first(self, count: int) -> Task:
        """The task of the first samples."""
        room = {name: array[:count] for name, array in self.room.items()}
        return Task(self.pair, tuple(c[:count] for c in self.motion), room)


def task_of(pair: HingePair, motion: Motion, outputs: tuple[str, ...]) -> Task:
    """A task with room, every page of it touched."""
    samples = len(motion[0])
    return Task(pair, motion, {name: np.ones((samples, 3, 3) if name == "S2" else (samples, 3)) for name in outputs})


def ours(*, fresh: bool = False, **how: Any) -> Callable[[Task], Job]:
    """`pair.forward_kinematics`, into arrays that are there or into fresh ones; one sample is given as one state."""

    def make(task: Task) -> Job:
        call, given, names = task.pair.forward_kinematics, task.given, tuple(task.room)
        out, read = None if given[0].ndim == 1 or fresh else task.room, attrgetter(*names)
        return lambda: read(call(*given, outputs=names, out=out, **how))

    return make


def prepared(task: Task) -> Job:
    """`pair.prepare`, called with one state or a batch; the outputs are new arrays."""
    given, names = task.given, tuple(task.room)
    call, read = task.pair.prepare(list(LEVELS)[len(given) - 1], outputs=names), attrgetter(*names)
    return lambda: read(call(*given))


def copies(task: Task) -> Job:
    """The floor: as many bytes as the outputs have, copied into arrays that are there."""
    source = {name: np.ones_like(array) for name, array in task.room.items()}

    def run() -> None:
        for name, array in source.items():
            np.copyto(task.room[name], array)

    return run


def fresh_copies(task: Task) -> Job:
    """The same into new arrays."""
    source = [np.ones_like(array) for array in task.room.values()]
    return lambda: [array.copy() for array in source]


def _engine_rows(task: Task) -> list[Array]:
    """Pinocchio's q, v, a, as far as the motion goes."""
    names = ("R1", "S1", "v1", "omega1", "a1", "alpha1")[: 2 * len(task.motion)]
    state = task.pair.forward_kinematics(*task.motion, outputs=names, backend="numpy")
    given: Any = {name[:-1]: getattr(state, name) for name in names}
    return pinocchio_rows(task.pair, BodyMotion(**given), [c[:, 6] for c in task.motion])


def pinocchio_loop(task: Task) -> Job:
    """Pinocchio from Python, sample by sample, results copied into arrays; of one sample, read and no more."""
    import pinocchio as pin

    twin = to_pinocchio(task.pair)
    model, data, frame = twin.model, twin.data, twin.body2_frame
    made, room = _engine_rows(task), task.room
    level, world = len(made), pin.LOCAL_WORLD_ALIGNED

    def read(*given: Array) -> Room:
        pin.forwardKinematics(model, data, *given)
        placement = pin.updateFramePlacement(model, data, frame)
        found = {"R2": placement.translation, "S2": placement.rotation}
        if level > 1:
            twist = pin.getFrameVelocity(model, data, frame, world)
            found["v2"], found["omega2"] = twist.linear, twist.angular
        if level > 2:
            change = pin.getFrameClassicalAcceleration(model, data, frame, world)
            found["a2"], found["alpha2"] = change.linear, change.angular
        return found

    if len(made[0]) == 1:
        first = tuple(c[0] for c in made)
        return lambda: read(*first)

    def run() -> Room:
        for i, given in enumerate(zip(*made, strict=True)):
            for name, value in read(*given).items():
                room[name][i] = value
        return room

    return run


def pinocchio_cpp(task: Task) -> Job:
    """Pinocchio from C++: the same inputs and outputs as from Python, the loop compiled."""
    rows = [*_engine_rows(task), None, None][:3]
    outputs = [task.room.get(name) for name in LEVELS["acceleration"]]
    return cpp_job(task.pair, [len(task.motion[0]), *rows, *outputs], task.room)


def mujoco_loop(task: Task) -> Job:
    """MuJoCo from Python: the stages of its dynamics that make poses, velocities, accelerations, and no others."""
    import mujoco as mj

    made, room = mujoco_rows(_engine_rows(task), *(c[:, :3] for c in task.motion[1:])), task.room
    model = mj.MjModel.from_xml_string(to_mjcf(task.pair))
    data = mj.MjData(model)
    body2, kind = model.body("body2").id, mj.mjtObj.mjOBJ_XBODY
    position, matrix = data.xpos[body2], data.xmat[body2].reshape(3, 3)
    targets = (data.qpos, data.qvel, data.qacc)
    six = np.zeros((6, 1))
    angular, linear = six[:3, 0], six[3:, 0]

    def run() -> Room:
        for i, given in enumerate(zip(*made, strict=True)):
            for target, source in zip(targets, given, strict=False):
                target[:] = source
            mj.mj_kinematics(model, data)
            room["R2"][i], room["S2"][i] = position, matrix
            if len(made) > 1:
                mj.mj_comPos(model, data)
                mj.mj_comVel(model, data)
                mj.mj_objectVelocity(model, data, kind, body2, six, 0)
                room["v2"][i], room["omega2"][i] = linear, angular
            if len(made) > 2:
                mj.mj_rnePostConstraint(model, data)
                mj.mj_objectAcceleration(model, data, kind, body2, six, 0)
                room["a2"][i], room["alpha2"][i] = linear, angular
        return room

    return run


def scipy_rotation(task: Task) -> Job:
    """SciPy's Rotation for the attitudes, NumPy for the rest."""
    from scipy.spatial.transform import Rotation

    pair, q = task.pair, task.motion[0]
    home = Rotation.from_matrix(pair.home)

    def run() -> Room:
        first = Rotation.from_euler("XYZ", q[:, 3:6])
        second = first * Rotation.from_rotvec(q[:, 6:] * pair.n) * home
        return _by_stacks(np, pair, task.motion, first.as_matrix(), second.as_matrix())

    return run


def numpy_stacks(task: Task) -> Job:
    """NumPy on stacks of 3 x 3 matrices: products with @, vector products with numpy.cross."""
    pair, motion, _ = task
    return lambda: _by_stacks(np, pair, motion, *_attitudes(np, pair, motion[0]))


def jax_compiled(task: Task) -> Job:
    """The same stacks, compiled by jax.jit, on one core; its inputs are JAX arrays beforehand."""
    with _one_core():
        import jax
        import jax.numpy as jnp

        device = jax.devices("cpu")[0]
    pair = task.pair
    function = jax.jit(lambda *given: _by_stacks(jnp, pair, given, *_attitudes(jnp, pair, given[0])))
    with jax.enable_x64(True):
        made = [jax.device_put(c, device) for c in task.motion]

    def run() -> Room:
        with jax.enable_x64(True):
            return {name: np.asarray(array) for name, array in function(*made).items()}

    return run


def _attitudes(xp: Any, pair: HingePair, q: Any) -> tuple[Any, Any]:
    """S1 and S2 as stacks, written as a NumPy user would, by NumPy or what is written like it."""
    x, y, z = pair.n
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    S1 = _about(xp, 0, q[:, 3]) @ _about(xp, 1, q[:, 4]) @ _about(xp, 2, q[:, 5])
    s, c = xp.sin(q[:, 6])[:, None, None], xp.cos(q[:, 6])[:, None, None]
    return S1, S1 @ (np.eye(3) + s * K + (1 - c) * (K @ K)) @ pair.home


def _about(xp: Any, axis: int, angle: Any) -> Any:
    """Turns about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rows: list[list[Any]] = [[xp.zeros_like(angle)] * 3 for _ in range(3)]
    rows[axis][axis] = xp.ones_like(angle)
    rows[i][i] = rows[j][j] = xp.cos(angle)
    rows[j][i] = xp.sin(angle)
    rows[i][j] = -rows[j][i]
    return xp.stack([xp.stack(row, -1) for row in rows], -2)


def _by_stacks(xp: Any, pair: HingePair, motion: tuple[Any, ...], S1: Any, S2: Any) -> Room:
    """Body 2 from stacks of attitudes."""
    q = motion[0]
    r1, r2 = S1 @ pair.u1, S2 @ pair.u2
    found = {"R2": q[:, :3] + r1 - r2, "S2": S2}
    if len(motion) > 1:
        qd = motion[1]
        c, s = xp.cos(q[:, 3]), xp.sin(q[:, 3])
        zero = xp.zeros_like(c)
        b = xp.stack([zero, c, s], axis=-1)
        turn_x, turn_y = xp.stack([qd[:, 3], zero, zero], axis=-1), b * qd[:, 4:5]
        omega1 = turn_x + turn_y + S1[:, :, 2] * qd[:, 5:6]
        axis = S1 @ pair.n
        omega2 = omega1 + axis * qd[:, 6:]
        found |= {"v2": qd[:, :3] + xp.cross(omega1, r1) - xp.cross(omega2, r2), "omega2": omega2}
    if len(motion) > 2:
        qdd = motion[2]
        alpha1 = xp.stack([qdd[:, 3], zero, zero], axis=-1) + b * qdd[:, 4:5] + S1[:, :, 2] * qdd[:, 5:6]
        alpha1 += xp.cross(turn_x, turn_y) + xp.cross(turn_x + turn_y, S1[:, :, 2] * qd[:, 5:6])
        alpha2 = alpha1 + axis * qdd[:, 6:] + xp.cross(omega1, axis) * qd[:, 6:]
        a1 = qdd[:, :3] + xp.cross(alpha1, r1) + xp.cross(omega1, xp.cross(omega1, r1))
        found |= {"a2": a1 - xp.cross(alpha2, r2) - xp.cross(omega2, xp.cross(omega2, r2)), "alpha2": alpha2}
    return found


@contextmanager
def _one_core() -> Iterator[None]:
    """JAX makes as many threads as the process may use cores when it first names its devices (Linux only)."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def our_cycle(pair: HingePair, *given: Any) -> Job:
    """Body 2, its Jacobian and its bias from R1, quat_xyzw, v1, omega1, psi, psi', as a controller asks for them."""
    names = ("R2", "S2", "v2", "omega2", "jacobian", "acceleration_bias")
    cycle = pair.prepare(("R1", "quat_xyzw", "v1", "omega1", "psi", "psid"), outputs=names)
    read = attrgetter(*names)
    return lambda: read(cycle(*given))


def pinocchio_cycle(pair: HingePair, R: Array, quat: Array, v: Array, omega: Array, psi: float, psid: float) -> Job:
    """The same of Pinocchio, whose q and v are made beforehand."""
    import pinocchio as pin

    twin = to_pinocchio(pair)
    model, data, frame, world = twin.model, twin.data, twin.body2_frame, pin.LOCAL_WORLD_ALIGNED
    body1 = BodyMotion.from_quaternion_xyzw(R=R, quat_xyzw=quat, v=v, omega=omega)
    q, rates, still = np.array([*R, *quat, psi]), twin.velocity(body1, psi, psid), np.zeros(7)

    def run() -> Any:
        pin.forwardKinematics(model, data, q, rates, still)
        placement = pin.updateFramePlacement(model, data, frame)
        twist = pin.getFrameVelocity(model, data, frame, world)
        pin.computeJointJacobians(model, data)
        jacobian = pin.getFrameJacobian(model, data, frame, world)
        bias = pin.getFrameClassicalAcceleration(model, data, frame, world)
        pose = placement.translation, placement.rotation
        return *pose, twist.linear, twist.angular, jacobian, bias.linear, bias.angular

    return run


FLOOR, FRESH_FLOOR = "copy floor", "copy floor, fresh"
OURS, FRESH, PREPARED, NUMPY = "hingepair", "hingepair, fresh", "hingepair, prepared", "hingepair, NumPy"

WAYS = (
    Way(OURS, ours(backend="compiled")),
    Way(PREPARED, prepared, drawn=False),
    Way(FRESH, ours(fresh=True, backend="compiled"), least=2, drawn=False),
    Way("hingepair, 2 workers", ours(workers=2, backend="compiled"), least=10**5),
    Way(NUMPY, ours(backend="numpy")),
    Way(PYTHON_LOOP, pinocchio_loop, most=FEW, needs="pinocchio"),
    Way(CPP, pinocchio_cpp, most=10**6, needs="pinocchio"),
    Way(MUJOCO, mujoco_loop, most=FEW, needs="mujoco"),
    Way("JAX, compiled, one core", jax_compiled, needs="jax"),
    Way("SciPy Rotation + NumPy", scipy_rotation, most=10**5, needs="scipy"),
    Way("NumPy, stacks of 3x3", numpy_stacks, most=10**5),
    Way(FLOOR, copies, least=2, drawn=False),
    Way(FRESH_FLOOR, fresh_copies, least=2, drawn=False),
)
