"""`hingepair bench direct`: run time and error of forward kinematics at several batch sizes, beside alternatives."""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench import engines
from hingepair.bench.harness import (
    FIRST,
    HINGEPAIR,
    ON_DISK,
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
from hingepair.bench.truth import Truth, from_euler
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_pair import HingePair

Array: TypeAlias = NDArray[Any]

# The outputs that are computed, by the level of the motion.
LEVELS = {"pose": ("R2", "S2"), "velocity": ("R2", "S2", "v2", "omega2")}
LEVELS["acceleration"] = (*LEVELS["velocity"], "a2", "alpha2")

PAIR_ARGUMENTS: dict[str, Any] = {  # of the pair of all benchmarks
    "u1": [0.5, 0.2, 0.1],
    "u2": [-0.25, 0.1, 0.3],
    "n": [1.0, 2.0, -0.5],
    "home": [[2 / 3, -2 / 3, -1 / 3], [1 / 3, 2 / 3, -2 / 3], [2 / 3, 1 / 3, 2 / 3]],
}
HARD = "on hard states"  # heading of the second column of errors
COPY, FRESH_COPY = "copy floor", "copy floor, fresh"


class Task(NamedTuple):
    """States of a pair, at which the motion of body 2 is computed."""

    pair: HingePair
    motion: tuple[Array, ...]  # q; q and qd; or q, qd and qdd; (N, 7)
    buffers: dict[str, Array]  # for the outputs

    @property
    def level(self) -> str:
        """Return the name of the motion's level."""
        return list(LEVELS)[len(self.motion) - 1]

    @property
    def arguments(self) -> tuple[Array, ...]:
        """Return the motion, or its only state without the leading axis."""
        return tuple(c[0] for c in self.motion) if len(self.motion[0]) == 1 else self.motion

    def first(self, count: int) -> Task:
        """Return the task of the first states, in views of the same arrays."""
        buffers = {name: array[:count] for name, array in self.buffers.items()}
        return Task(self.pair, tuple(c[:count] for c in self.motion), buffers)

    def states(self) -> engines.States:
        """Return the states as other engines take them."""
        names = ("R1", "S1", "v1", "omega1", "a1", "alpha1")[: 2 * len(self.motion)]
        state = self.pair.forward_kinematics(*self.motion, outputs=names, backend="numpy")
        parts: dict[str, Any] = {name[:-1]: getattr(state, name) for name in names}
        return engines.pair_states(self.level, self.pair, BodyMotion(**parts), [c[:, 6] for c in self.motion])


def make_task(pair: HingePair, motion: tuple[Array, ...]) -> Task:
    """Return the task of a motion, with buffers that have been written, so that no page fault is timed."""
    count = len(motion[0])
    shapes = {name: (count, 3, 3) if name == "S2" else (count, 3) for name in list(LEVELS.values())[len(motion) - 1]}
    return Task(pair, motion, {name: np.ones(shape) for name, shape in shapes.items()})


def hingepair_job(*, fresh: bool = False, **options: Any) -> Callable[[Task], Job]:
    """Return what makes the job of `forward_kinematics`.

    Args:
        fresh: whether the outputs are new arrays, as those of one state are; otherwise they are the buffers.
        options: of `forward_kinematics`.
    """

    def make(task: Task) -> Job:
        call, arguments, names = task.pair.forward_kinematics, task.arguments, tuple(task.buffers)
        out, read = None if arguments[0].ndim == 1 or fresh else task.buffers, attrgetter(*names)
        return lambda: read(call(*arguments, outputs=names, out=out, **options))

    return make


def prepared_job(task: Task) -> Job:
    """Return the job of the function that `pair.prepare` returns."""
    names = tuple(task.buffers)
    call, read, arguments = task.pair.prepare(task.level, outputs=names), attrgetter(*names), task.arguments
    return lambda: read(call(*arguments))


def copy_job(task: Task) -> Job:
    """Return a job that copies as many numbers as the outputs have into the buffers: no method is faster."""
    source = {name: np.ones_like(array) for name, array in task.buffers.items()}

    def run() -> None:
        for name, array in source.items():
            np.copyto(task.buffers[name], array)

    return run


def fresh_copy_job(task: Task) -> Job:
    """Return a job that copies as many numbers as the outputs have into new arrays."""
    source = [np.ones_like(array) for array in task.buffers.values()]
    return lambda: [array.copy() for array in source]


def scipy_job(task: Task) -> Job:
    """Return the job of SciPy's Rotation, and NumPy for all else."""
    from scipy.spatial.transform import Rotation

    pair, q = task.pair, task.motion[0]
    home = Rotation.from_matrix(pair.home)

    def run() -> tuple[Array, ...]:
        first = Rotation.from_euler("XYZ", q[:, 3:6])
        second = first * Rotation.from_rotvec(q[:, 6:] * pair.n) * home
        return _body2(np, pair, task.motion, first.as_matrix(), second.as_matrix())

    return run


def numpy_job(task: Task) -> Job:
    """Return the job of NumPy on stacks of 3 x 3 matrices, with @ and numpy.cross."""
    pair, motion, _ = task
    return lambda: _body2(np, pair, motion, *_attitudes(np, pair, motion[0]))


def jax_job(task: Task) -> Job:
    """Return the job of jax.jit on stacks of 3 x 3 matrices, on one core; inputs are on its device before."""
    with _one_core():  # JAX makes its threads when it first lists its devices
        import jax
        import jax.numpy as jnp

        device = jax.devices("cpu")[0]
    pair = task.pair
    function = jax.jit(lambda *motion: _body2(jnp, pair, motion, *_attitudes(jnp, pair, motion[0])))
    with jax.enable_x64(True):
        inputs = [jax.device_put(c, device) for c in task.motion]

    def run() -> tuple[Array, ...]:
        with jax.enable_x64(True):
            return tuple(np.asarray(array) for array in function(*inputs))

    return run


def _attitudes(xp: Any, pair: HingePair, q: Any) -> tuple[Any, Any]:
    """Return S1 and S2, (N, 3, 3), by whole-array operations of numpy or jax.numpy."""
    x, y, z = pair.n
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    S1 = _turn(xp, 0, q[:, 3]) @ _turn(xp, 1, q[:, 4]) @ _turn(xp, 2, q[:, 5])
    s, c = xp.sin(q[:, 6])[:, None, None], xp.cos(q[:, 6])[:, None, None]
    return S1, S1 @ (np.eye(3) + s * K + (1 - c) * (K @ K)) @ pair.home


def _turn(xp: Any, axis: int, angle: Any) -> Any:
    """Return the rotations (N, 3, 3) by angles (N,) about x, y or z (axis 0, 1 or 2)."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rows: list[list[Any]] = [[xp.zeros_like(angle)] * 3 for _ in range(3)]
    rows[axis][axis] = xp.ones_like(angle)
    rows[i][i] = rows[j][j] = xp.cos(angle)
    rows[j][i] = xp.sin(angle)
    rows[i][j] = -rows[j][i]
    return xp.stack([xp.stack(row, -1) for row in rows], -2)


def _body2(xp: Any, pair: HingePair, motion: tuple[Any, ...], S1: Any, S2: Any) -> tuple[Any, ...]:
    """Return the outputs of the motion's level, by numpy or jax.numpy."""
    q, qd, qdd = (*motion, None, None)[:3]
    r1, r2 = S1 @ pair.u1, S2 @ pair.u2
    outputs: tuple[Any, ...] = (q[:, :3] + r1 - r2, S2)
    if qd is not None:
        c, s = xp.cos(q[:, 3]), xp.sin(q[:, 3])
        zero = xp.zeros_like(c)
        b = xp.stack([zero, c, s], axis=-1)
        omega_x, omega_y = xp.stack([qd[:, 3], zero, zero], axis=-1), b * qd[:, 4:5]
        omega1 = omega_x + omega_y + S1[:, :, 2] * qd[:, 5:6]
        axis = S1 @ pair.n
        omega2 = omega1 + axis * qd[:, 6:]
        outputs = (*outputs, qd[:, :3] + xp.cross(omega1, r1) - xp.cross(omega2, r2), omega2)
    if qdd is not None:
        alpha1 = xp.stack([qdd[:, 3], zero, zero], axis=-1) + b * qdd[:, 4:5] + S1[:, :, 2] * qdd[:, 5:6]
        alpha1 += xp.cross(omega_x, omega_y) + xp.cross(omega_x + omega_y, S1[:, :, 2] * qd[:, 5:6])
        alpha2 = alpha1 + axis * qdd[:, 6:] + xp.cross(omega1, axis) * qd[:, 6:]
        a1 = qdd[:, :3] + xp.cross(alpha1, r1) + xp.cross(omega1, xp.cross(omega1, r1))
        outputs = (*outputs, a1 - xp.cross(alpha2, r2) - xp.cross(omega2, xp.cross(omega2, r2)), alpha2)
    return outputs


@contextmanager
def _one_core() -> Iterator[None]:
    """Restrict this thread and those that it starts to one core, where the system can."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


METHODS = (
    Method(HINGEPAIR, hingepair_job(backend="compiled")),
    Method(PREPARED, prepared_job, in_picture=False),
    Method("hingepair, fresh", hingepair_job(fresh=True, backend="compiled"), min_samples=2, in_picture=False),
    Method("hingepair, 2 workers", hingepair_job(workers=2, backend="compiled"), min_samples=10**5),
    Method("hingepair, NumPy", hingepair_job(backend="numpy")),
    *engines.methods(Task.states, max_cpp=10**6),
    Method("JAX, compiled, one core", jax_job, package="jax"),
    Method("SciPy Rotation + NumPy", scipy_job, max_samples=10**5, package="scipy"),
    Method("NumPy, stacks of 3x3", numpy_job, max_samples=10**5),
    Method(COPY, copy_job, min_samples=2, in_picture=False),
    Method(FRESH_COPY, fresh_copy_job, min_samples=2, in_picture=False),
)
"""Ratios refer to the first."""


def bench_direct(sizes: Sequence[int], levels: Sequence[str], repeats: int, with_cpp: bool, cold: bool) -> Report:
    """Measure forward kinematics.

    Args:
        sizes: batch sizes.
        levels: of LEVELS.
        repeats: of each measurement.
        with_cpp: whether the C++ loop of Pinocchio is compiled and measured; if this fails, a note says why.
        cold: whether imports and first calls are measured too, in fresh processes.
    """
    methods, left_out = installed(METHODS, engines.cpp_reasons(with_cpp))
    rows = measure(batch_cases(methods, sizes, levels), repeats)
    rows += measure((*offset_cases(max(sizes), levels), *single_state_cases()), repeats)
    rows += measure_starts(repeats) if cold else []
    note = (
        "a call, each: medians, kernels are compiled before; ratio: time of a sample divided by that of the first "
        "method of the case; errors: largest of any output against 60 digits [u * scale], on random and on hard "
        "states; inf: the method refuses a state, or its result is not finite where the exact one is"
    )
    return Report(rows, "error", [*left_out, note], [error_panels(rows)])


def random_states(rng: np.random.Generator, count: int, level: str) -> tuple[Array, ...]:
    """Return q, and qd and qdd as far as the level has them, of normally distributed numbers; (count, 7) each."""
    return tuple(rng.normal(size=(list(LEVELS).index(level) + 1, count, 7)))


def hard_states(rng: np.random.Generator, level: str) -> tuple[Array, ...]:
    """Return q, and qd and qdd as far as the level has them, of random states that are hard in one way each."""
    quarter = math.pi / 2
    psis = (1e-160, 1e-9, -1e-5, 0.0, math.pi, math.pi - 1e-9, math.pi + 1e-9, 1e5, -1e16, 1e300)
    changes: list[tuple[Any, Any, float]] = [(6, psi, 1.0) for psi in psis]
    changes += [(4, angle, 1.0) for angle in (quarter, -quarter, quarter - 1e-9, quarter + 1e-9)]  # gimbal lock
    changes += [(slice(3, 7), (quarter, 2 * quarter, -quarter, 4 * quarter), 1.0)]
    changes += [(slice(3, 7), angle, 1.0) for angle in (1e-9, 1e6, 1e16)]
    changes += [(slice(0, 3), (far, -far / 3, far), 1.0) for far in (1e8, 1e15)]
    changes += [(slice(0, 0), (), rate) for rate in (0.0, 1e-60, 1e20, 1e100)]
    motion = rng.normal(size=(3, len(changes), 7))
    for sample, (index, value, rate) in enumerate(changes):
        motion[0, sample, index] = value
        motion[1, sample] *= rate
        motion[2, sample] *= rate * rate
    return tuple(motion[: list(LEVELS).index(level) + 1])


def truth_of(motion: tuple[Array, ...]) -> Truth:
    """Return the exact results of the benchmark's pair."""
    u1, u2, n, home = (np.array(value) for value in PAIR_ARGUMENTS.values())
    q, qd, qdd = (*motion, None, None)[:3]
    return from_euler((u1, u2, n, home), q, qd, qdd)


def method_errors(methods: Iterable[Method], motion: tuple[Array, ...], truth: Truth) -> dict[str, float]:
    """Return the largest error of each method [u * scale], without those that copy; inf where it refuses a state."""
    errors = {}
    for method in methods:
        if method.name in {COPY, FRESH_COPY}:
            continue
        task = make_task(HingePair(**PAIR_ARGUMENTS), motion)
        try:
            with np.errstate(all="ignore"):
                found = engines.join_parts(method.make_job(task)(), len(motion[0]))
        except ValueError:
            found = np.full((1, 1), np.nan)
        widths = np.cumsum([9 if name == "S2" else 3 for name in task.buffers])[:-1]
        parts = np.split(np.broadcast_to(found, (len(motion[0]), 6 + 6 * len(motion))), widths, axis=-1)
        by_output = [truth.errors(name, part).max() for name, part in zip(task.buffers, parts, strict=True)]
        errors[method.name] = float(max(by_output))
    return errors


def batch_cases(methods: Sequence[Method], sizes: Sequence[int], levels: Sequence[str]) -> Iterator[Case]:
    """Yield a case for each level and size, with errors on random and on hard states."""
    rng, pair = np.random.default_rng(20), HingePair(**PAIR_ARGUMENTS)
    for level in levels:
        print_progress(f"{level}: errors")
        random, hard = (
            method_errors(methods, motion, truth_of(motion))
            for motion in (random_states(rng, 40, level), hard_states(rng, level))
        )
        columns = {name: {HARD: value} for name, value in hard.items()}
        task = make_task(pair, random_states(rng, max(sizes), level))
        for size in sizes:
            yield batch_case(level, methods, task.first, size, random, columns)


OFFSETS = {f"{shift} bytes after a line": shift for shift in (0, 8, 16, 32)}
"""Offsets of outputs from a cache line [bytes], by the name of the row; NumPy's large arrays are at 16."""


def offset_cases(size: int, levels: Sequence[str]) -> Iterator[Case]:
    """Yield a case for each level, of outputs at several offsets from a cache line; none of one state."""
    rng, pair = np.random.default_rng(22), HingePair(**PAIR_ARGUMENTS)
    make_job = hingepair_job(backend="compiled", workers=1)
    for level in levels if size > 1 else ():
        task = make_task(pair, random_states(rng, size, level))
        jobs = {COPY: copy_job(task)}
        for name, shift in OFFSETS.items():
            buffers = {output: array_at_offset(array.shape, shift) for output, array in task.buffers.items()}
            jobs[name] = make_job(task._replace(buffers=buffers))
        yield Case(f"outputs at offsets from a cache line: {level}, N = {size:,}", jobs, size)


def array_at_offset(shape: tuple[int, ...], shift: int) -> NDArray[np.float64]:
    """Return an array of ones that begins `shift` bytes, a multiple of 8, after a cache line."""
    line = 64  # bytes
    count = math.prod(shape)
    memory = np.ones(count + 2 * line // 8)
    start = (-memory.ctypes.data % line + shift) // 8
    return memory[start : start + count].reshape(shape)


def single_state_cases() -> Iterator[Case]:
    """Yield the case of a control cycle at one state, and that of the construction of a pair."""
    pair, rng = HingePair(**PAIR_ARGUMENTS), np.random.default_rng(21)
    R, quat, v, omega = (rng.normal(size=k) for k in (3, 4, 3, 3))
    state = R, quat / np.sqrt(quat @ quat), v, omega, 0.3, -0.7
    jobs = {"Pinocchio": _pinocchio_cycle(pair, *state), HINGEPAIR: _hingepair_cycle(pair, *state)}
    yield Case("one state: FK, Jacobian, bias from a quaternion", jobs)
    plain = PAIR_ARGUMENTS | {"home": None}
    yield Case("construction of a pair", {HINGEPAIR: lambda: HingePair(**plain)})


def _hingepair_cycle(pair: HingePair, *state: Any) -> Job:
    """Return the job of pose, velocities, Jacobian and bias of a state, by a prepared function."""
    names = ("R2", "S2", "v2", "omega2", "jacobian", "acceleration_bias")
    cycle = pair.prepare(("R1", "quat_xyzw", "v1", "omega1", "psi", "psid"), outputs=names)
    read = attrgetter(*names)
    return lambda: read(cycle(*state))


def _pinocchio_cycle(pair: HingePair, R: Array, quat: Array, v: Array, omega: Array, psi: float, psid: float) -> Job:
    """Return the job of the same by Pinocchio's functions; the conversion to its coordinates is not timed."""
    import pinocchio as pin

    body1 = BodyMotion.from_quaternion_xyzw(R=R[None], quat_xyzw=quat[None], v=v[None], omega=omega[None])
    states = engines.pair_states("velocity", pair, body1, [np.array([psi]), np.array([psid])])
    model, frame, world = states.model, states.frame, pin.LOCAL_WORLD_ALIGNED
    data, zeros = model.createData(), np.zeros(7)
    q, rates = (row[0] for row in states.rows)

    def run() -> Any:
        pin.forwardKinematics(model, data, q, rates, zeros)
        placement = pin.updateFramePlacement(model, data, frame)
        twist = pin.getFrameVelocity(model, data, frame, world)
        pin.computeJointJacobians(model, data)
        jacobian = pin.getFrameJacobian(model, data, frame, world)
        bias = pin.getFrameClassicalAcceleration(model, data, frame, world)
        pose = placement.translation, placement.rotation
        return *pose, twist.linear, twist.angular, jacobian, bias.linear, bias.angular

    return run


# Code that runs before the calls in fresh processes.
_STATES_CODE = """
import numpy as np
import hingepair as hp
pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
q, qd = np.random.default_rng(0).normal(size=(2, *{shape}))
"""
# Scene of `hingepair run` in fresh processes.
_SCENE = """
pair = {u1 = [0.5, 0.2, 0.1], u2 = [-0.25, 0.1, 0.3], n = [1, 0, 0]}
motion = {x = "3*t", y = "3*t", z = "3*t", phi_x = "3*t", phi_y = "t", phi_z = "5*t", psi = "10*t"}
time = {start = 0, stop = 10, samples = 10001}
"""
COLD_SIZES = (1, 1_000, 200_000)  # samples of the calls that are measured in fresh processes
_COLD = "a fresh process: "  # the cases' names begin with it


def measure_starts(repeats: int) -> list[Row]:
    """Measure imports, `hingepair run` and first and second calls with each backend, in fresh processes."""
    imports = {name: ("", f"import {name}") for name in ("numpy", "hingepair")}
    rows = measure_cold(f"{_COLD}import", imports, repeats, (FIRST,))
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder, "scene.toml")
        scene.write_text(_SCENE, encoding="utf-8")
        before = f"from contextlib import suppress\nsys.argv = ['hingepair', 'run', {str(scene)!r}]"
        timed = "with suppress(SystemExit): from hingepair.cli.main import main; main()"
        codes = {HINGEPAIR: (before, timed)}
        rows += measure_cold(f"{_COLD}hingepair run, reference scene", codes, repeats, (FIRST, ON_DISK))
    for size in COLD_SIZES:
        before = _STATES_CODE.format(shape=(size, 7) if size > 1 else (7,))
        codes = {
            backend: (before, f"pair.forward_kinematics(q, qd, backend={backend!r})")
            for backend in ("auto", "numpy", "compiled")
        }
        rows += measure_cold(f"{_COLD}velocity, N = {size:,}", codes, repeats)
    return rows


def error_panels(rows: Sequence[Row]) -> list[Panel]:
    """Return a panel for each level: errors on random and on hard states against the time of the last batch size.

    Run times are minima: medians change order when other programs run beside the benchmark.
    """
    drawn = {method.name for method in METHODS if method.in_picture}
    panels: list[Panel] = []
    for level in LEVELS:
        cases = [row.case for row in rows if row.case.startswith(f"{level},")]
        times = {row.method: (row.min_seconds / row.count * 1e9, row) for row in rows if row.case in cases[-1:]}
        curves = [
            MethodCurve(name, [(ns, row.error), (ns, row.extra_columns[HARD])], second_is_hard=True)
            for name, (ns, row) in times.items()
            if name in drawn and row.error is not None
        ]
        if curves:
            label, floor = "" if panels else "largest error [u * scale]", times.get(COPY)
            panels.append(Panel(cases[-1], "run time [ns a sample]", label, curves, floor and floor[0], max_y=10.0))
    return panels
