"""What `bench direct` compares: ways to get body 2 from the same coordinates, each as a Python user would write it.

A method takes (pair, q, qd, qdd), of shape (N, 7) or None from the first level that is not wanted on, and returns the
outputs of the level by name. What it can prepare once, it prepares when it is made.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.util import find_spec
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.pair import HingePair
from hingepair.state import PairState

Array: TypeAlias = NDArray[Any]
Motion: TypeAlias = tuple[Array, ...]
Found: TypeAlias = Mapping[str, Array]
Job: TypeAlias = Callable[[], Found]

LEVELS = {"pose": ("R2", "S2"), "velocity": ("R2", "S2", "v2", "omega2")}
LEVELS["acceleration"] = (*LEVELS["velocity"], "a2", "alpha2")

PARTS = (("R1", "phi", "psi"), ("v1", "phid", "psid"), ("a1", "phidd", "psidd"))
"""What the seven coordinates and their derivatives are to the equations."""


class Method(NamedTuple):
    """One way: its name, what makes a job of a pair and a motion, the most samples it is asked for, its dtype."""

    name: str
    prepare: Callable[[HingePair, Motion], Job]
    most: int
    dtype: Any
    needs: str = ""


def ours(backend: str, *, workers: int = 1, fresh: bool = False) -> Callable[[HingePair, Motion], Job]:
    """This library, with fresh outputs or into arrays that are there."""

    def prepare(pair: HingePair, motion: Motion) -> Job:
        names = list(LEVELS.values())[len(motion) - 1]
        shape, dtype = motion[0].shape[:-1], motion[0].dtype
        out = {name: np.zeros((*shape, *((3, 3) if name == "S2" else (3,))), dtype) for name in names}

        def run() -> Found:
            room = None if fresh else out
            state: PairState = pair.forward_kinematics(
                *motion, outputs=names, out=room, backend=backend, workers=workers
            )
            return state.arrays()

        return run

    return prepare


def pinocchio_loop(pair: HingePair, motion: Motion) -> Job:
    """Pinocchio from Python, one sample after the other, results copied into arrays; its q, v, a made beforehand."""
    import pinocchio as pin

    from hingepair.motion import BodyMotion
    from hingepair.pinocchio import to_pinocchio

    twin = to_pinocchio(pair)
    model, data, frame = twin.model, twin.data, twin.body2_frame
    s = pair.forward_kinematics(*motion, outputs=("R1", "S1", "v1", "omega1", "a1", "alpha1")[: 2 * len(motion)])
    given: Any = {"R": s.R1, "S": s.S1, "v": s.v1, "omega": s.omega1, "a": s.a1, "alpha": s.alpha1}
    body1 = BodyMotion(**given)
    psi = [c[:, 6] for c in motion]
    made = [twin.configuration(body1, psi[0])]
    made += [twin.velocity(body1, *psi[:2])] if len(psi) > 1 else []
    made += [twin.acceleration(body1, *psi)] if len(psi) > 2 else []
    count = len(motion[0])
    out = {
        name: np.zeros((count, *((3, 3) if name == "S2" else (3,))))
        for name in list(LEVELS.values())[len(motion) - 1]
    }

    def run() -> Found:
        for i in range(count):
            pin.forwardKinematics(model, data, *(c[i] for c in made))
            placement = pin.updateFramePlacement(model, data, frame)
            out["R2"][i], out["S2"][i] = placement.translation, placement.rotation
            if len(made) > 1:
                twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
                out["v2"][i], out["omega2"][i] = twist.linear, twist.angular
            if len(made) > 2:
                change = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
                out["a2"][i], out["alpha2"][i] = change.linear, change.angular
        return out

    return run


def scipy_rotation(pair: HingePair, motion: Motion) -> Job:
    """SciPy's Rotation for the attitudes, NumPy for the rest."""
    from scipy.spatial.transform import Rotation

    home = Rotation.from_matrix(pair.home)

    def attitudes(q: Array) -> tuple[Array, Array]:
        first = Rotation.from_euler("XYZ", q[:, 3:6])
        return first.as_matrix(), (first * Rotation.from_rotvec(q[:, 6:] * pair.n) * home).as_matrix()

    return lambda: _by_stacks(pair, motion, *attitudes(motion[0]))


def numpy_stacks(pair: HingePair, motion: Motion) -> Job:
    """NumPy on stacks of 3 x 3 matrices: products with @, vector products with numpy.cross."""

    def about(axis: int, angle: Array) -> Array:
        S = np.zeros((len(angle), 3, 3))
        i, j = (axis + 1) % 3, (axis + 2) % 3
        S[:, axis, axis] = 1
        S[:, i, i] = S[:, j, j] = np.cos(angle)
        S[:, j, i] = np.sin(angle)
        S[:, i, j] = -S[:, j, i]
        return S

    x, y, z = pair.n
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])

    def run() -> Found:
        q = motion[0]
        S1 = about(0, q[:, 3]) @ about(1, q[:, 4]) @ about(2, q[:, 5])
        s, c = np.sin(q[:, 6])[:, None, None], np.cos(q[:, 6])[:, None, None]
        return _by_stacks(pair, motion, S1, S1 @ (np.eye(3) + s * K + (1 - c) * (K @ K)) @ pair.home)

    return run


def _by_stacks(pair: HingePair, motion: Motion, S1: Array, S2: Array) -> Found:
    """Body 2 from stacks of attitudes, written as a NumPy user would."""
    q = motion[0]
    r1, r2 = S1 @ pair.u1, S2 @ pair.u2
    found = {"R2": q[:, :3] + r1 - r2, "S2": S2}
    if len(motion) > 1:
        qd = motion[1]
        c, s = np.cos(q[:, 3]), np.sin(q[:, 3])
        zero = np.zeros_like(c)
        b = np.stack([zero, c, s], axis=-1)
        turn_x, turn_y = np.stack([qd[:, 3], zero, zero], axis=-1), b * qd[:, 4:5]
        omega1 = turn_x + turn_y + S1[:, :, 2] * qd[:, 5:6]
        axis = S1 @ pair.n
        omega2 = omega1 + axis * qd[:, 6:]
        found |= {"v2": qd[:, :3] + np.cross(omega1, r1) - np.cross(omega2, r2), "omega2": omega2}
    if len(motion) > 2:
        qdd = motion[2]
        alpha1 = np.stack([qdd[:, 3], zero, zero], axis=-1) + b * qdd[:, 4:5] + S1[:, :, 2] * qdd[:, 5:6]
        alpha1 += np.cross(turn_x, turn_y) + np.cross(turn_x + turn_y, S1[:, :, 2] * qd[:, 5:6])
        alpha2 = alpha1 + axis * qdd[:, 6:] + np.cross(omega1, axis) * qd[:, 6:]
        a1 = qdd[:, :3] + np.cross(alpha1, r1) + np.cross(omega1, np.cross(omega1, r1))
        found |= {"a2": a1 - np.cross(alpha2, r2) - np.cross(omega2, np.cross(omega2, r2)), "alpha2": alpha2}
    return found


def sympy_lambdify(pair: HingePair, motion: Motion) -> Job:
    """The equations as SymPy expressions in the coordinates, compiled by lambdify with common subexpressions."""
    import sympy

    from hingepair.plan import make_plan

    def terms(phi: Any) -> tuple[Any, ...]:
        return tuple(f(angle) for angle in phi for f in (sympy.sin, sympy.cos))

    names = list(LEVELS.values())[len(motion) - 1]
    symbols = [sympy.symbols(f"{letter}0:7") for letter in ("q", "v", "a")[: len(motion)]]
    plan = make_plan(names, "XYZ", True, (terms, lambda psi: (sympy.sin(psi), 2 * sympy.sin(psi / 2) ** 2)))
    values: dict[str, Any] = {key: tuple(getattr(pair, key).ravel().tolist()) for key in ("u1", "u2", "n", "home")}
    for keys, seven in zip(
        (("R1", "phi", "psi"), ("v1", "phid", "psid"), ("a1", "phidd", "psidd")), symbols, strict=False
    ):
        values |= dict(zip(keys, (seven[:3], seven[3:6], seven[6]), strict=True))
    plan.run(values)
    flat = [component for name in names for component in values[name]]
    function = sympy.lambdify(list(sum(symbols, ())), flat, "numpy", cse=True)

    def run() -> Found:
        columns = iter(function(*(c[:, i] for c in motion for i in range(7))))
        shape = {name: (3, 3) if name == "S2" else (3,) for name in names}
        count = len(motion[0])
        found = {}
        for name in names:
            parts = [next(columns) for _ in range(int(np.prod(shape[name])))]
            found[name] = np.stack(np.broadcast_arrays(*parts), axis=-1).reshape(count, *shape[name])
        return found

    return run


METHODS = (
    Method("hingepair numba, out=, 1 worker", ours("numba"), 10**7, np.float64),
    Method("hingepair numba, out=, 2 workers", ours("numba", workers=2), 10**7, np.float64),
    Method("hingepair numba, fresh, 1 worker", ours("numba", fresh=True), 10**7, np.float64),
    Method("hingepair numba float32, out=", ours("numba"), 10**7, np.float32),
    Method("hingepair numpy, out=", ours("numpy"), 10**7, np.float64),
    Method("Pinocchio, Python loop", pinocchio_loop, 10**4, np.float64, "pinocchio"),
    Method("SciPy Rotation + NumPy", scipy_rotation, 10**6, np.float64, "scipy"),
    Method("NumPy, 3x3 stacks", numpy_stacks, 10**6, np.float64),
    Method("SymPy lambdify + cse", sympy_lambdify, 10**6, np.float64, "sympy"),
)


def installed(method: Method) -> bool:
    """Whether the package that a method needs is there."""
    return not method.needs or find_spec(method.needs) is not None
