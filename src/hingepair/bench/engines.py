"""Pinocchio and MuJoCo at the states of a pair or a robot: loops in Python and C++, and Pinocchio's own batches.

A job computes one workload at all states and returns a tuple of arrays; their rows side by side are the result.
"""

from __future__ import annotations

import ctypes
import functools
import os
import shutil
import subprocess
import tempfile
import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.harness import Job, Method, print_progress
from hingepair.errors import MissingDependencyError
from hingepair.formats.model_writers import to_mjcf, to_urdf
from hingepair.mechanism.mechanism import Mechanism
from hingepair.pair.body import Body
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_pair import HingePair
from hingepair.validation.pinocchio_twin import to_pinocchio

Array: TypeAlias = NDArray[Any]

POSE, VELOCITY, ACCELERATION, JACOBIAN = "pose", "velocity", "acceleration", "Jacobian"
INVERSE, FORWARD = "inverse dynamics", "forward dynamics"
TORQUE_SLOPES, ACCELERATION_SLOPES = "derivatives of torques", "derivatives of accelerations"  # by q and v
GRADIENT = "gradient of torques"  # of their sum, by q and v
# How many of q, v and w (accelerations or efforts) each workload takes; in the order of loops.cpp.
WORKLOADS = {POSE: 1, VELOCITY: 2, ACCELERATION: 3, JACOBIAN: 1, INVERSE: 3, FORWARD: 3}
WORKLOADS |= {TORQUE_SLOPES: 3, ACCELERATION_SLOPES: 3, GRADIENT: 3}

PINOCCHIO, PINOCCHIO_CPP, MUJOCO = "Pinocchio, Python loop", "Pinocchio, C++ loop", "MuJoCo, Python loop"
MAX_IN_PYTHON = 10**4  # states of a Python loop, which takes microseconds for each


class States(NamedTuple):
    """States of a pair or a robot, and what is computed at them."""

    workload: str  # one of WORKLOADS
    system: HingePair | Mechanism
    model: Any  # of Pinocchio
    frame: int  # of the model, whose motion or Jacobian is computed
    rows: tuple[Array, ...]  # q, v and w in the model's coordinates, as many as the workload takes; (N, ...)


def pair_states(workload: str, pair: HingePair, body1: BodyMotion, hinge: Sequence[Array]) -> States:
    """Return the states of a pair, in which w are accelerations.

    Args:
        workload: one of WORKLOADS.
        pair: the pair.
        body1: motion of body 1.
        hinge: psi; psi and psi'; or psi, psi' and psi'': as many as the workload takes.
    """
    twin = to_pinocchio(pair)
    convert = (twin.configuration, twin.velocity, twin.acceleration)[: WORKLOADS[workload]]
    rows: list[Any] = [one(body1, *hinge[: i + 1]) for i, one in enumerate(convert)]
    return States(workload, pair, twin.model, twin.body2_frame, tuple(rows))


def join_parts(parts: Sequence[Any], count: int) -> Array:
    """Return what a job of `count` states returns as one float64 array with a row for each state."""
    return np.concatenate([np.asarray(part, dtype=float).reshape(count, -1) for part in parts], axis=-1)


def _loop_over(compute: Callable[..., Any], rows: Sequence[Array]) -> Job:
    """Return a job that calls `compute` with the inputs of one state after the other, a row of each of `rows`, and
    copies the results into arrays; those of a single state are only read out.
    """
    first = [row[0] for row in rows]
    if len(rows[0]) == 1:
        return lambda: compute(*first)
    parts = tuple(np.ones((len(rows[0]), *np.shape(part))) for part in compute(*first))

    def run() -> tuple[Array, ...]:
        for i, state in enumerate(zip(*rows, strict=True)):
            for part, value in zip(parts, compute(*state), strict=True):
                part[i] = value
        return parts

    return run


def pinocchio_job(states: States) -> Job:
    """Return the job of Pinocchio's functions in a Python loop."""
    import pinocchio as pin

    _, _, model, frame, rows = states
    data, world = model.createData(), pin.LOCAL_WORLD_ALIGNED

    def pose(*state: Array) -> tuple[Array, ...]:
        pin.forwardKinematics(model, data, *state)
        place = pin.updateFramePlacement(model, data, frame)
        return place.translation, place.rotation

    def velocity(*state: Array) -> tuple[Array, ...]:
        parts, twist = pose(*state), pin.getFrameVelocity(model, data, frame, world)
        return *parts, twist.linear, twist.angular

    def acceleration(*state: Array) -> tuple[Array, ...]:
        parts, change = velocity(*state), pin.getFrameClassicalAcceleration(model, data, frame, world)
        return *parts, change.linear, change.angular

    def jacobian(q: Array) -> tuple[Array, ...]:
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacement(model, data, frame)
        return (pin.getFrameJacobian(model, data, frame, world),)

    def torque_slopes(*state: Array) -> tuple[Array, ...]:
        pin.computeRNEADerivatives(model, data, *state)
        return data.dtau_dq, data.dtau_dv

    def acceleration_slopes(*state: Array) -> tuple[Array, ...]:
        pin.computeABADerivatives(model, data, *state)
        return data.ddq_dq, data.ddq_dv

    compute: dict[str, Callable[..., Any]] = {
        POSE: pose,
        VELOCITY: velocity,
        ACCELERATION: acceleration,
        JACOBIAN: jacobian,
        INVERSE: lambda *state: (pin.rnea(model, data, *state),),
        FORWARD: lambda *state: (pin.aba(model, data, *state),),
        TORQUE_SLOPES: torque_slopes,
        ACCELERATION_SLOPES: acceleration_slopes,
        GRADIENT: lambda *state: tuple(part.sum(axis=0) for part in torque_slopes(*state)),
    }
    return _loop_over(compute[states.workload], rows)


def pinocchio_batch_job(states: States) -> Job:
    """Return the job of Pinocchio's own batch functions, on one thread, for inverse or forward dynamics."""
    import pinocchio as pin

    pool = pin.ModelPool(states.model, 1)
    rows = [np.asfortranarray(row.T) for row in states.rows]
    batch = {INVERSE: pin.rneaInParallel, FORWARD: pin.abaInParallel}[states.workload]
    return lambda: (batch(1, pool, *rows).T,)


def mujoco_job(states: States) -> Job:
    """Return the job of MuJoCo's functions in a Python loop, on the model that is exported; for all but Jacobians.

    Free bases: accelerations, forces and rates are MuJoCo's, linear ones in world axes and classical.
    """
    import mujoco as mj

    workload, system, _, _, rows = states
    has_dynamics = workload in {INVERSE, FORWARD}
    if isinstance(system, HingePair):
        if not has_dynamics:  # MuJoCo wants masses, and adds gravity to accelerations
            body = Body(1.0, inertia=(0.01, 0.01, 0.01))
            text = to_mjcf(replace(system, body1=body, body2=body), gravity=(0, 0, 0))
        else:
            text = to_mjcf(system)
    else:
        text = to_urdf(system, meshes=False)
    model = mujoco_model(text)
    data = mj.MjData(model)
    if states.model.nq > states.model.nv:
        rows = _mujoco_rows(rows, w_are_forces=workload == FORWARD)

    def solve(call: Any, w: Array, result: Array) -> Callable[..., Any]:
        """Return a function of q, v and w, which it writes into MuJoCo's arrays before the call."""

        def compute(*state: Array) -> tuple[Array, ...]:
            data.qpos[:], data.qvel[:], w[:] = state
            call(model, data)
            return (result,)

        return compute

    if has_dynamics:
        inverse = mj.mj_inverse, data.qacc, data.qfrc_inverse
        forward = mj.mj_forward, data.qfrc_applied, data.qacc
        return _loop_over(solve(*(inverse if workload == INVERSE else forward)), rows)
    body2, kind = model.body("body2").id, mj.mjtObj.mjOBJ_XBODY
    targets = (data.qpos, data.qvel, data.qacc)
    pose = data.xpos[body2], data.xmat[body2].reshape(3, 3)
    twist, change = np.zeros((6, 1)), np.zeros((6, 1))  # angular, then linear

    def motion(*state: Array) -> tuple[Array, ...]:
        """Return position, attitude and, as far as given, velocities and accelerations of body 2."""
        for target, source in zip(targets, state, strict=False):
            target[:] = source
        mj.mj_kinematics(model, data)
        parts: tuple[Array, ...] = pose
        if len(state) > 1:
            mj.mj_comPos(model, data)
            mj.mj_comVel(model, data)
            mj.mj_objectVelocity(model, data, kind, body2, twist, 0)
            parts = *parts, twist[3:, 0], twist[:3, 0]
        if len(state) > 2:
            mj.mj_rnePostConstraint(model, data)
            mj.mj_objectAcceleration(model, data, kind, body2, change, 0)
            parts = *parts, change[3:, 0], change[:3, 0]
        return parts

    return _loop_over(motion, rows)


def mujoco_model(text: str) -> Any:
    """Return MuJoCo's model without limits, damping, friction and rotors."""
    import mujoco as mj

    model = mj.MjModel.from_xml_string(text)
    model.opt.disableflags |= mj.mjtDisableBit.mjDSBL_CONSTRAINT  # limits would exert forces beyond them
    model.dof_damping[:] = model.dof_frictionloss[:] = model.dof_armature[:] = 0.0
    return model


def _mujoco_rows(rows: Sequence[Array], *, w_are_forces: bool) -> tuple[Array, ...]:
    """Convert q, v and w, accelerations or forces, of a free base from Pinocchio's conventions to MuJoCo's:
    quaternions wxyz, linear parts in world axes.
    """
    q, *others = rows
    S = BodyMotion.from_quaternion_xyzw(R=q[:, :3], quat_xyzw=q[:, 3:7]).S
    found = [np.hstack([q[:, :3], q[:, 6:7], q[:, 3:6], q[:, 7:]])]
    for i, row in enumerate(others):
        linear = row[:, :3]
        if i == 1 and not w_are_forces:  # Pinocchio's acceleration is spatial
            linear = linear + np.cross(others[0][:, 3:6], others[0][:, :3])
        found.append(np.hstack([(S @ linear[..., None])[..., 0], row[:, 3:]]))
    return tuple(found)


# Pinocchio's names of joints, in the order of their numbers in loops.cpp.
_JOINTS = ("RX", "RY", "RZ", "RevoluteUnaligned", "PX", "PY", "PZ", "PrismaticUnaligned", "FreeFlyer")


class CppSystem:
    """A model of Pinocchio with one frame in C++, for the functions of loops.cpp.

    Raises:
        MissingDependencyError: no compiler is on the path, or a header is missing.
    """

    def __init__(self, model: Any, index: int) -> None:
        self.library, frame = compile_loops(), model.frames[index]
        joints = [model.joints[k] for k in range(1, model.njoints)]
        bodies = list(model.inertias)[1:]
        constants = [
            np.array(list(model.parents)[1:], ctypes.c_long),
            np.array(
                [_JOINTS.index(joint.shortname().removeprefix("JointModel")) for joint in joints], ctypes.c_long
            ),
            np.array([_placement(place) for place in list(model.jointPlacements)[1:]]),
            np.array([getattr(joint.extract(), "axis", np.zeros(3)) for joint in joints]),
            np.array([body.mass for body in bodies]),
            np.array([body.lever for body in bodies]),
            np.array([body.inertia.ravel() for body in bodies]),
        ]
        place = np.array(_placement(frame.placement))
        addresses = [array.ctypes.data for array in constants]
        self.address = self.library.system_new(len(joints), *addresses, frame.parentJoint, place.ctypes.data)
        weakref.finalize(self, self.library.system_delete, self.address)


def cpp_job(states: States) -> Job:
    """Return the job of Pinocchio's functions in a C++ loop, which is compiled first."""
    workload, _, model, index, rows = states
    system, n = CppSystem(model, index), model.nv
    widths = {POSE: 12, VELOCITY: 18, ACCELERATION: 24, JACOBIAN: 6 * n, INVERSE: n, FORWARD: n, GRADIENT: 2 * n}
    width = widths.get(workload, 2 * n * n)
    arrays = [*map(np.ascontiguousarray, rows), np.ones((len(rows[0]), width))]
    inputs = [array.ctypes.data for array in arrays[:-1]]
    pointers = [*inputs, *[None] * (3 - len(rows)), arrays[-1].ctypes.data]
    numbers = list(WORKLOADS).index(workload), len(rows[0]), width

    def run() -> tuple[Array, ...]:
        system.library.system_run(system.address, *numbers, *pointers)
        return (arrays[-1],)

    return run


def _placement(place: Any) -> list[float]:
    return [*place.rotation.ravel(), *place.translation]


_CPP_NEEDS = (  # in messages
    "a C++ compiler and the headers of Pinocchio, Boost and Eigen (pip install '.[bench]' in the project's folder)"
)
_CPP_FLAGS = ("-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-shared", "-fPIC", "-w")


@functools.cache
def compile_loops() -> Any:
    """Compile loops.cpp, which takes one or two minutes, and return the library.

    Raises:
        MissingDependencyError: no compiler is on the path, or a header is missing.
    """
    names = ("c++", "g++", "clang++")
    compiler = next(filter(None, map(shutil.which, names)), None)
    if compiler is None:
        raise MissingDependencyError("--cpp", _CPP_NEEDS, f"none of {', '.join(names)} is on the path")
    with tempfile.TemporaryDirectory() as folder:
        target = f"{folder}/loops.so"
        headers = [part for path in _header_folders() for part in ("-isystem", str(path))]
        command = [compiler, *_CPP_FLAGS, *headers, str(Path(__file__).with_name("loops.cpp")), "-o", target]
        environment = os.environ | {"LC_ALL": "C"}
        process = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        if process.returncode:
            lines = [line for line in process.stderr.splitlines() if "error" in line]
            raise MissingDependencyError("--cpp", _CPP_NEEDS, (lines or ["the compiler failed"])[0])
        library = ctypes.CDLL(target)
    pointer, number = ctypes.c_void_p, ctypes.c_long
    library.system_new.argtypes, library.system_new.restype = [number, *[pointer] * 7, number, pointer], pointer
    library.system_delete.argtypes, library.system_delete.restype = [pointer], None
    library.system_run.argtypes, library.system_run.restype = [pointer, *[number] * 3, *[pointer] * 4], None
    reals = [ctypes.c_double] * 2
    library.system_reach.argtypes = [pointer, *[number] * 3, *reals, *[pointer] * 5]
    library.system_reach.restype = None
    library.system_roll.argtypes = [pointer, number, number, reals[0], *[pointer] * 3]
    library.system_roll.restype = None
    return library


def methods(states_of: Callable[[Any], States], max_cpp: int = 10**7) -> tuple[Method, ...]:
    """Return the loops of Pinocchio and MuJoCo as methods of a benchmark.

    Args:
        states_of: returns the states of a task.
        max_cpp: largest batch of the C++ loop.
    """
    return (
        Method(PINOCCHIO, lambda task: pinocchio_job(states_of(task)), 1, MAX_IN_PYTHON, "pinocchio"),
        Method(PINOCCHIO_CPP, lambda task: cpp_job(states_of(task)), 1, max_cpp, "pinocchio"),
        Method(MUJOCO, lambda task: mujoco_job(states_of(task)), 1, MAX_IN_PYTHON, "mujoco"),
    )


def cpp_reasons(is_requested: bool) -> dict[str, str | None]:
    """Compile the C++ loops if they are asked for; return why they cannot be measured, as `installed` takes it."""
    if not is_requested:
        return {PINOCCHIO_CPP: "--cpp compiles and measures it"}
    print_progress("compiling Pinocchio's C++ loops (one or two minutes)")
    try:
        compile_loops()
    except MissingDependencyError as error:
        return {PINOCCHIO_CPP: str(error)}
    return {}


def _header_folders() -> Iterator[Path]:
    """Yield folders that may hold the headers of Pinocchio, of its dependencies and of Eigen."""
    import pinocchio

    for parent in Path(pinocchio.__file__).resolve().parents:
        if (parent / "include" / "pinocchio").is_dir():
            yield from (parent / "include", parent / "include" / "eigen3")
            break
    yield from (Path("/usr/include/eigen3"), Path("/usr/local/include/eigen3"))
