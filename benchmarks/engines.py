"""Pinocchio and MuJoCo at states of a robot: loops in Python, and in C++ (loops.cpp)."""

from __future__ import annotations

import ctypes
import functools
import subprocess
import tempfile
import weakref
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

import hingepair as hp
from hingepair.formats.robots import robot_urdf
from timing import Job

Array: TypeAlias = NDArray[Any]

POSE, JACOBIAN = "pose", "Jacobian"
INVERSE, FORWARD = "inverse dynamics", "forward dynamics"
TORQUE_SLOPES, ACCELERATION_SLOPES = "derivatives of torques", "derivatives of accelerations"  # by q and v
# How many of q, v and w (accelerations or efforts) each workload takes; in the order of loops.cpp.
WORKLOADS = {POSE: 1, JACOBIAN: 1, INVERSE: 3, FORWARD: 3, TORQUE_SLOPES: 3, ACCELERATION_SLOPES: 3}

PINOCCHIO, PINOCCHIO_CPP, MUJOCO = "Pinocchio, Python loop", "Pinocchio, C++ loop", "MuJoCo, Python loop"
LOCKED = {"panda": {"panda_finger_joint1": 0.0, "panda_finger_joint2": 0.0}}  # positions [m], by robot


class States(NamedTuple):
    """States of a robot, and what is computed at them."""

    workload: str  # one of WORKLOADS
    robot: hp.Mechanism
    model: Any  # of Pinocchio
    frame: int  # of the model, whose pose or Jacobian is computed
    rows: tuple[Array, ...]  # q, v and w, as many as the workload takes; (N, dof)


def load_models(name: str) -> tuple[hp.Mechanism, Any]:
    """Return a robot of example-robot-data and Pinocchio's model, read from the same file by Pinocchio itself."""
    full, locked = pin.buildModelFromUrdf(str(robot_urdf(name))), LOCKED.get(name, {})
    numbers = [full.getJointId(joint) for joint in locked]
    model = pin.buildReducedModel(full, numbers, pin.neutral(full)) if numbers else full
    robot = hp.load_robot(name, locked=locked)
    if model.nq != robot.dof or model.nv != robot.dof:
        raise SystemExit(
            f"--names: {name} has continuous or mimic joints, whose coordinates Pinocchio writes otherwise"
        )
    return robot, model


def joined(parts: Sequence[Any], count: int) -> Array:
    """Return what a job of `count` states returns as one array with a row for each state."""
    return np.concatenate([np.asarray(part, dtype=float).reshape(count, -1) for part in parts], axis=-1)


def _loop_over(compute: Callable[..., Any], rows: Sequence[Array]) -> Job:
    """Return a job that calls `compute` with one state after the other and copies the results into arrays; those of a
    single state are only read out.
    """
    first = [row[0] for row in rows]
    if len(rows[0]) == 1:
        return lambda: compute(*first)
    parts = tuple(np.ones((len(rows[0]), *np.shape(part))) for part in compute(*first))

    def job() -> tuple[Array, ...]:
        for i, state in enumerate(zip(*rows, strict=True)):
            for part, value in zip(parts, compute(*state), strict=True):
                part[i] = value
        return parts

    return job


def pinocchio_job(states: States) -> Job:
    """Return the job of Pinocchio's functions in a Python loop."""
    _, _, model, frame, rows = states
    data = model.createData()

    def pose(q: Array) -> tuple[Array, ...]:
        pin.forwardKinematics(model, data, q)
        place = pin.updateFramePlacement(model, data, frame)
        return place.translation, place.rotation

    def jacobian(q: Array) -> tuple[Array, ...]:
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacement(model, data, frame)
        return (pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED),)

    def torque_slopes(*state: Array) -> tuple[Array, ...]:
        pin.computeRNEADerivatives(model, data, *state)
        return data.dtau_dq, data.dtau_dv

    def acceleration_slopes(*state: Array) -> tuple[Array, ...]:
        pin.computeABADerivatives(model, data, *state)
        return data.ddq_dq, data.ddq_dv

    compute: dict[str, Callable[..., Any]] = {
        POSE: pose,
        JACOBIAN: jacobian,
        INVERSE: lambda *state: (pin.rnea(model, data, *state),),
        FORWARD: lambda *state: (pin.aba(model, data, *state),),
        TORQUE_SLOPES: torque_slopes,
        ACCELERATION_SLOPES: acceleration_slopes,
    }
    return _loop_over(compute[states.workload], rows)


def mujoco_job(states: States) -> Job:
    """Return the job of MuJoCo's inverse or forward dynamics in a Python loop."""
    import mujoco as mj

    model = mujoco_model(states.robot)
    data = mj.MjData(model)
    inverse = mj.mj_inverse, data.qacc, data.qfrc_inverse
    forward = mj.mj_forward, data.qfrc_applied, data.qacc
    call, given, result = inverse if states.workload == INVERSE else forward

    def compute(*state: Array) -> tuple[Array, ...]:
        data.qpos[:], data.qvel[:], given[:] = state
        call(model, data)
        return (result,)

    return _loop_over(compute, states.rows)


def mujoco_model(robot: hp.Mechanism) -> Any:
    """Return MuJoCo's model of a robot without limits, damping, friction and rotors."""
    import mujoco as mj

    model = mj.MjModel.from_xml_string(hp.to_urdf(robot, meshes=False))
    model.opt.disableflags |= mj.mjtDisableBit.mjDSBL_CONSTRAINT  # limits would exert forces beyond them
    model.dof_damping[:] = model.dof_frictionloss[:] = model.dof_armature[:] = 0.0
    return model


# Pinocchio's names of joints, in the order of their numbers in loops.cpp.
_JOINTS = ("RX", "RY", "RZ", "RevoluteUnaligned", "PX", "PY", "PZ", "PrismaticUnaligned")


class CppSystem:
    """A model of Pinocchio with one frame in C++, for the functions of loops.cpp."""

    def __init__(self, model: Any, index: int) -> None:
        self.library, frame = compile_loops(), model.frames[index]
        joints = [model.joints[k] for k in range(1, model.njoints)]
        kinds = [_JOINTS.index(joint.shortname().removeprefix("JointModel")) for joint in joints]
        bodies = list(model.inertias)[1:]
        constants = [
            np.array(list(model.parents)[1:], ctypes.c_long),
            np.array(kinds, ctypes.c_long),
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
    width = {POSE: 12, JACOBIAN: 6 * n, INVERSE: n, FORWARD: n}.get(workload, 2 * n * n)
    arrays = [*map(np.ascontiguousarray, rows), np.ones((len(rows[0]), width))]
    inputs = [array.ctypes.data for array in arrays[:-1]]
    pointers = [*inputs, *[None] * (3 - len(rows)), arrays[-1].ctypes.data]
    numbers = list(WORKLOADS).index(workload), len(rows[0]), width

    def job() -> tuple[Array, ...]:
        system.library.system_run(system.address, *numbers, *pointers)
        return (arrays[-1],)

    return job


def _placement(place: Any) -> list[float]:
    return [*place.rotation.ravel(), *place.translation]


@functools.cache
def compile_loops() -> Any:
    """Compile loops.cpp by c++, and return the library."""
    prefix = next(p for p in Path(pin.__file__).resolve().parents if (p / "include" / "pinocchio").is_dir())
    folders = (prefix / "include", prefix / "include" / "eigen3", "/usr/include/eigen3")
    headers = [part for path in folders for part in ("-isystem", str(path))]
    flags = ("-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-shared", "-fPIC", "-w")
    with tempfile.TemporaryDirectory() as folder:
        target = f"{folder}/loops.so"
        subprocess.run(["c++", *flags, *headers, Path(__file__).with_name("loops.cpp"), "-o", target], check=True)
        library = ctypes.CDLL(target)
    pointer, number, real = ctypes.c_void_p, ctypes.c_long, ctypes.c_double
    library.system_new.argtypes, library.system_new.restype = [number, *[pointer] * 7, number, pointer], pointer
    library.system_delete.argtypes, library.system_delete.restype = [pointer], None
    library.system_run.argtypes, library.system_run.restype = [pointer, *[number] * 3, *[pointer] * 4], None
    library.system_reach.argtypes = [pointer, *[number] * 3, real, real, *[pointer] * 5]
    library.system_reach.restype = None
    library.system_roll.argtypes = [pointer, number, number, real, *[pointer] * 3]
    library.system_roll.restype = None
    return library
