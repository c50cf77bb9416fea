"""Ways to body 2 from the same coordinates: this library's, and what a Python user would take instead.

A way makes a job of a pair, a motion (q, qd, qdd as far as they go, shape (N, 7)) and room for the outputs; the job
returns the outputs of the level by name. What can be made once is made before the job; what a user would read out of
an engine is read out in it.
"""

from __future__ import annotations

import ctypes
import functools
import os
import shutil
import subprocess
import tempfile
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import MissingDependencyError
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_pair import HingePair
from hingepair.validation.pinocchio_twin import to_pinocchio

Array: TypeAlias = NDArray[Any]
Motion: TypeAlias = tuple[Array, ...]
Room: TypeAlias = dict[str, Array]
Make: TypeAlias = Callable[[HingePair, Motion, Room], Callable[[], Any]]

LEVELS = {"pose": ("R2", "S2"), "velocity": ("R2", "S2", "v2", "omega2")}
LEVELS["acceleration"] = (*LEVELS["velocity"], "a2", "alpha2")

CONSTANTS: dict[str, Any] = {
    "u1": [0.5, 0.2, 0.1],
    "u2": [-0.25, 0.1, 0.3],
    "n": [1.0, 2.0, -0.5],
    "home": [[2 / 3, -2 / 3, -1 / 3], [1 / 3, 2 / 3, -2 / 3], [2 / 3, 1 / 3, 2 / 3]],
}
"""Of the pair that is measured."""


class Way(NamedTuple):
    """One way.

    Attributes:
        name: it.
        make: makes a job.
        least: samples below which it is not asked.
        most: samples that it is given at most, the first of all.
        needs: the package it needs.
        drawn: whether it is in the picture.
    """

    name: str
    make: Make
    least: int = 1
    most: int = 10**7
    needs: str = ""
    drawn: bool = True


def room_for(outputs: tuple[str, ...], samples: int) -> Room:
    """Arrays for outputs, every page of them touched."""
    return {name: np.ones((samples, 3, 3) if name == "S2" else (samples, 3)) for name in outputs}


def ours(*, fresh: bool = False, **how: Any) -> Make:
    """`pair.forward_kinematics`, into arrays that are there or into fresh ones; one sample is given as one state."""

    def make(pair: HingePair, motion: Motion, room: Room) -> Callable[[], Any]:
        one = len(motion[0]) == 1
        given = tuple(c[0] for c in motion) if one else motion
        names = tuple(room)
        out = None if one or fresh else room

        def run() -> Room:
            state = pair.forward_kinematics(*given, outputs=names, out=out, **how)
            return {name: getattr(state, name) for name in names}

        return run

    return make


def prepared(pair: HingePair, motion: Motion, room: Room) -> Callable[[], Any]:
    """`pair.prepare`, called with one state or a batch; the outputs are new arrays."""
    names = tuple(room)
    fk = pair.prepare(list(LEVELS)[len(motion) - 1], outputs=names)
    given = tuple(c[0] for c in motion) if len(motion[0]) == 1 else motion

    def run() -> Room:
        state = fk(*given)
        return {name: getattr(state, name) for name in names}

    return run


def copies(*, fresh: bool = False) -> Make:
    """The floor: as many bytes as the outputs have, copied into arrays that are there, or into new ones."""

    def make(pair: HingePair, motion: Motion, room: Room) -> Callable[[], Any]:  # noqa: ARG001
        source = {name: np.ones_like(array) for name, array in room.items()}

        def run() -> None:
            for name, array in source.items():
                np.copyto(room[name], array)

        return (lambda: [array.copy() for array in source.values()]) if fresh else run

    return make


def pinocchio_loop(pair: HingePair, motion: Motion, room: Room) -> Callable[[], Any]:
    """Pinocchio from Python, sample by sample, results copied into arrays; of one sample, read and no more."""
    import pinocchio as pin

    twin = to_pinocchio(pair)
    model, data, frame = twin.model, twin.data, twin.body2_frame
    made = _engine_inputs(pair, motion)
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


def our_cycle(pair: HingePair, *given: Any) -> Callable[[], Any]:
    """Body 2, its Jacobian and its bias from R1, quat_xyzw, v1, omega1, psi, psi', as a controller asks for them."""
    names = ("R2", "S2", "v2", "omega2", "jacobian", "acceleration_bias")
    cycle = pair.prepare(("R1", "quat_xyzw", "v1", "omega1", "psi", "psid"), outputs=names)

    def run() -> Any:
        state = cycle(*given)
        return state.R2, state.S2, state.v2, state.omega2, state.jacobian, state.acceleration_bias

    return run


def pinocchio_cycle(
    pair: HingePair, R: Array, quat: Array, v: Array, omega: Array, psi: float, psid: float
) -> Callable[[], Any]:
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


def mujoco_loop(pair: HingePair, motion: Motion, room: Room) -> Callable[[], Any]:
    """MuJoCo from Python: the stages of its dynamics that make poses, velocities, accelerations, and no others."""
    import mujoco as mj

    q, *rates = _engine_inputs(pair, motion)
    made = [np.ascontiguousarray(q[:, [0, 1, 2, 6, 3, 4, 5, 7]])]  # its quaternions are wxyz
    made += [np.hstack([c[:, :3], rate[:, 3:]]) for c, rate in zip(motion[1:], rates, strict=True)]
    model = mj.MjModel.from_xml_string(_mjcf(pair))
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


def _engine_inputs(pair: HingePair, motion: Motion) -> list[Array]:
    """Pinocchio's q, v, a, as far as the motion goes."""
    twin = to_pinocchio(pair)
    names = ("R1", "S1", "v1", "omega1", "a1", "alpha1")[: 2 * len(motion)]
    state = pair.forward_kinematics(*motion, outputs=names, backend="numpy")
    given: Any = {name[:-1]: getattr(state, name) for name in names}
    body1, hinge = BodyMotion(**given), [c[:, 6] for c in motion]
    makers = (twin.configuration, twin.velocity, twin.acceleration)
    return [make(body1, *hinge[: i + 1]) for i, make in enumerate(makers[: len(motion)])]


def _mjcf(pair: HingePair) -> str:
    """The pair as MuJoCo reads it, body 2 at psi = 0; without gravity, which MuJoCo counts as an acceleration."""

    def text(vector: Array) -> str:
        return " ".join(repr(float(x)) for x in vector)

    C = pair.home
    quat = to_pinocchio(pair).configuration(BodyMotion(R=np.zeros(3), S=C), 0.0)[[6, 3, 4, 5]]
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    return f"""<mujoco><option gravity="0 0 0"/><worldbody><body><freejoint/>{inertial}
      <body name="body2" pos="{text(pair.u1 - C @ pair.u2)}" quat="{text(quat)}">{inertial}
        <joint type="hinge" pos="{text(pair.u2)}" axis="{text(C.T @ pair.n)}"/>
      </body></body></worldbody></mujoco>"""


def scipy_rotation(pair: HingePair, motion: Motion, room: Room) -> Callable[[], Any]:  # noqa: ARG001
    """SciPy's Rotation for the attitudes, NumPy for the rest."""
    from scipy.spatial.transform import Rotation

    home = Rotation.from_matrix(pair.home)

    def run() -> Room:
        q = motion[0]
        first = Rotation.from_euler("XYZ", q[:, 3:6])
        second = first * Rotation.from_rotvec(q[:, 6:] * pair.n) * home
        return _by_stacks(np, pair, motion, first.as_matrix(), second.as_matrix())

    return run


def numpy_stacks(pair: HingePair, motion: Motion, room: Room) -> Callable[[], Any]:  # noqa: ARG001
    """NumPy on stacks of 3 x 3 matrices: products with @, vector products with numpy.cross."""
    return lambda: _by_stacks(np, pair, motion, *_attitudes(np, pair, motion[0]))


def jax_compiled(pair: HingePair, motion: Motion, room: Room) -> Callable[[], Any]:  # noqa: ARG001
    """The same stacks, compiled by jax.jit, on one core; its inputs are JAX arrays beforehand."""
    with _one_core():
        import jax
        import jax.numpy as jnp

        device = jax.devices("cpu")[0]
    function = jax.jit(lambda *given: _by_stacks(jnp, pair, given, *_attitudes(jnp, pair, given[0])))
    with jax.enable_x64(True):
        made = [jax.device_put(c, device) for c in motion]

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


def pinocchio_cpp(pair: HingePair, motion: Motion, room: Room) -> Callable[[], Any]:
    """Pinocchio from C++: the same inputs and outputs as from Python, the loop compiled."""
    made = _engine_inputs(pair, motion)
    library = compiled_loop()
    constants = [np.ascontiguousarray(c) for c in (pair.u1, pair.u2, pair.n, pair.home)]
    handle = library.pair_new(*map(address_of, constants))
    arrays = [*(*made, None, None)[:3], *(room.get(name) for name in LEVELS["acceleration"])]
    samples, addresses = len(motion[0]), [address_of(array) for array in arrays]

    def run() -> Room:
        library.pair_loop(handle, samples, *addresses)
        return room

    def release(*kept: Array | None) -> None:  # noqa: ARG001 (arrays that live as long as what runs on their addresses)
        library.pair_delete(handle)

    weakref.finalize(run, release, *arrays)
    return run


def address_of(array: Array | None) -> int | None:
    """Where an array lies."""
    return None if array is None else array.ctypes.data


SOURCE = Path(__file__).with_name("pinocchio_loop.cpp")
_FLAGS = ("-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-shared", "-fPIC", "-w")
_COMPILERS = ("c++", "g++", "clang++")
_HOW = "a C++ compiler and the headers of Pinocchio, Boost and Eigen (pip install '.[bench]' in the project's folder)"


@functools.cache
def compiled_loop(*, dynamics: bool = False) -> Any:
    """The library with the compiled loop; a process compiles it once: half a minute, with dynamics up to two.

    Raises:
        MissingDependencyError: there is no compiler, or a header is missing.
    """
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        raise MissingDependencyError("--cpp", _HOW, f"none of {', '.join(_COMPILERS)} is on the path")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "pinocchio_loop.so"
        headers = [part for path in _headers() for part in ("-isystem", str(path))]
        command = [compiler, *_FLAGS, *["-DDYNAMICS"] * dynamics, *headers, str(SOURCE), "-o", str(target)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {"LC_ALL": "C"})
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error" in line]
            raise MissingDependencyError("--cpp", _HOW, (lines or ["the compiler failed"])[0])
        loaded = ctypes.CDLL(str(target))
    pointer: Any = ctypes.c_void_p
    loaded.pair_new.argtypes, loaded.pair_new.restype = [pointer] * 4, pointer
    loaded.pair_delete.argtypes, loaded.pair_delete.restype = [pointer], None
    loaded.pair_loop.argtypes, loaded.pair_loop.restype = [pointer, ctypes.c_long] + [pointer] * 9, None
    if dynamics:
        loaded.pair_masses.argtypes, loaded.pair_masses.restype = [pointer] * 4, None
        loaded.pair_dynamics.argtypes = [pointer, ctypes.c_long, ctypes.c_long] + [pointer] * 4
        loaded.pair_dynamics.restype = None
    return loaded


def _headers() -> Iterator[Path]:
    """Folders of headers beside the Pinocchio that Python imports, and Eigen's where systems have it."""
    import pinocchio

    for parent in Path(pinocchio.__file__).resolve().parents:
        if (parent / "include" / "pinocchio").is_dir():
            yield from (parent / "include", parent / "include" / "eigen3")
            break
    yield from (Path("/usr/include/eigen3"), Path("/usr/local/include/eigen3"))


FLOOR, FRESH_FLOOR = "copy floor", "copy floor, fresh"
OURS, FRESH, PREPARED, NUMPY = "hingepair", "hingepair, fresh", "hingepair, prepared", "hingepair, NumPy"
PYTHON_LOOP, CPP = "Pinocchio, Python loop", "Pinocchio, C++ loop"

WAYS = (
    Way(OURS, ours(backend="compiled")),
    Way(PREPARED, prepared, drawn=False),
    Way(FRESH, ours(fresh=True, backend="compiled"), least=2, drawn=False),
    Way("hingepair, 2 workers", ours(workers=2, backend="compiled"), least=10**5),
    Way(NUMPY, ours(backend="numpy")),
    Way(PYTHON_LOOP, pinocchio_loop, most=10**4, needs="pinocchio"),
    Way(CPP, pinocchio_cpp, most=10**6, needs="pinocchio"),
    Way("MuJoCo, Python loop", mujoco_loop, most=10**4, needs="mujoco"),
    Way("JAX, compiled, one core", jax_compiled, needs="jax"),
    Way("SciPy Rotation + NumPy", scipy_rotation, most=10**5, needs="scipy"),
    Way("NumPy, stacks of 3x3", numpy_stacks, most=10**5),
    Way(FLOOR, copies(), least=2, drawn=False),
    Way(FRESH_FLOOR, copies(fresh=True), least=2, drawn=False),
)


def ways(cpp: bool) -> tuple[list[Way], list[str]]:
    """The ways that can be had, and a line for each that cannot.

    Args:
        cpp: compile Pinocchio's C++ loop.
    """
    found, missing = [], []
    for way in WAYS:
        reason = None
        if way.needs and find_spec(way.needs) is None:
            reason = f"{way.needs} is not installed"
        elif way.name == CPP:
            reason = cpp_missing() if cpp else "compiled where --cpp asks for it"
        if reason is None:
            found.append(way)
        else:
            missing.append(f"{way.name} ({reason})")
    return found, missing


def cpp_missing(*, dynamics: bool = False) -> str | None:
    """Why the compiled loop cannot be had; None where it can."""
    try:
        compiled_loop(dynamics=dynamics)
    except MissingDependencyError as error:
        return str(error)
    return None
