"""Run time and error of the kinematics of one pair, beside Pinocchio and NumPy.

The times are those that a user meets: of the first and of the next call in a fresh process.
"""

from __future__ import annotations

import json
import math
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.metadata import version
from operator import attrgetter
from statistics import median
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.truth import from_euler
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.validation.pinocchio_twin import to_pinocchio

Array: TypeAlias = NDArray[Any]
Job: TypeAlias = Callable[[], Any]
"""A call that is timed; it returns the outputs."""

# The outputs that are computed, by the level of the motion.
LEVELS = {"pose": ("R2", "S2"), "velocity": ("R2", "S2", "v2", "omega2")}
LEVELS["acceleration"] = (*LEVELS["velocity"], "a2", "alpha2")

_U1, _U2, _N = (0.5, 0.2, 0.1), (-0.25, 0.1, 0.3), (1.0, 2.0, -0.5)
_HOME = np.array([[2, -2, -1], [1, 2, -2], [2, 1, 2]]) / 3


class Row(NamedTuple):
    """What was measured of a method for one number of states."""

    method: str
    states: int  # of a call
    first: float  # time of the first call of a process [s]
    next: float  # time of a later call [s]
    pin: float  # `next` over the time of Pinocchio's calls for one state
    floor: float  # `next` over the time of copying as many numbers as the outputs have
    error: float | None  # largest on random states [u * scale]; infinite where a result is not finite
    hard_error: float | None  # on states that are numerically difficult


class _Task(NamedTuple):
    """Motions of a pair, (N, 7) each, at which its outputs are computed."""

    pair: HingePair
    motion: tuple[Array, ...]  # q; q and qd; or q, qd and qdd

    @property
    def level(self) -> str:
        return list(LEVELS)[len(self.motion) - 1]

    @property
    def outputs(self) -> tuple[str, ...]:
        return LEVELS[self.level]

    @property
    def arguments(self) -> tuple[Array, ...]:
        """The motion; that of a single state without the leading axis."""
        return tuple(c[0] for c in self.motion) if len(self.motion[0]) == 1 else self.motion

    def buffers(self) -> dict[str, Array]:
        """Return arrays for the outputs that have been written, so that no page fault is timed."""
        count = len(self.motion[0])
        return {name: np.ones((count, 3, 3) if name == "S2" else (count, 3)) for name in self.outputs}


def _call_job(task: _Task, *, reuse: bool = False) -> Job:
    """Return the job of `forward_kinematics`, into new arrays or into the same ones each time."""
    call, arguments, names = task.pair.forward_kinematics, task.arguments, task.outputs
    out, read = task.buffers() if reuse else None, attrgetter(*names)
    return lambda: read(call(*arguments, outputs=names, out=out))


def _prepared_job(task: _Task) -> Job:
    names, arguments = task.outputs, task.arguments
    call, read = task.pair.prepare(task.level, outputs=names), attrgetter(*names)
    return lambda: read(call(*arguments))


def _pinocchio_job(task: _Task) -> Job:
    """Return the job of Pinocchio's functions, one state after the other; its coordinates are made before."""
    import pinocchio as pin

    names = ("R1", "S1", "v1", "omega1", "a1", "alpha1")[: 2 * len(task.motion)]
    state = task.pair.forward_kinematics(*task.motion, outputs=names)
    values: dict[str, Any] = {name[:-1]: getattr(state, name) for name in names}
    body1, hinge, twin = BodyMotion(**values), [c[:, 6] for c in task.motion], to_pinocchio(task.pair)
    convert = (twin.configuration, twin.velocity, twin.acceleration)[: len(hinge)]
    rows: list[Any] = [one(body1, *hinge[: i + 1]) for i, one in enumerate(convert)]
    model, frame, world = twin.model, twin.body2_frame, pin.LOCAL_WORLD_ALIGNED
    data = model.createData()

    def compute(*one: Array) -> tuple[Array, ...]:
        pin.forwardKinematics(model, data, *one)
        place = pin.updateFramePlacement(model, data, frame)
        parts: tuple[Array, ...] = place.translation, place.rotation
        if len(one) > 1:
            twist = pin.getFrameVelocity(model, data, frame, world)
            parts = *parts, twist.linear, twist.angular
        if len(one) > 2:
            change = pin.getFrameClassicalAcceleration(model, data, frame, world)
            parts = *parts, change.linear, change.angular
        return parts

    if len(rows[0]) == 1:
        first = [row[0] for row in rows]
        return lambda: compute(*first)
    out = tuple(task.buffers().values())

    def loop() -> tuple[Array, ...]:
        for i, one in enumerate(zip(*rows, strict=True)):
            for array, value in zip(out, compute(*one), strict=True):
                array[i] = value
        return out

    return loop


def _numpy_job(task: _Task) -> Job:
    """Return the job of NumPy on stacks of 3 x 3 matrices by SciPy, with @ and numpy.cross."""
    from scipy.spatial.transform import Rotation

    pair = task.pair
    motion: tuple[Any, ...] = (*task.motion, None, None)
    q, qd, qdd = motion[:3]

    def compute() -> tuple[Array, ...]:
        S1 = Rotation.from_euler("XYZ", q[:, 3:6]).as_matrix()
        S2 = S1 @ Rotation.from_rotvec(q[:, 6:] * pair.n).as_matrix() @ pair.home
        r1, r2 = S1 @ pair.u1, S2 @ pair.u2
        if qd is None:
            return q[:, :3] + r1 - r2, S2
        zero = np.zeros(len(q))
        e_x, e_y = np.stack([zero + 1, zero, zero], -1), np.stack([zero, np.cos(q[:, 3]), np.sin(q[:, 3])], -1)
        e_z, axis = S1[:, :, 2], S1 @ pair.n
        half = e_x * qd[:, 3:4] + e_y * qd[:, 4:5]
        omega1 = half + e_z * qd[:, 5:6]
        omega2 = omega1 + axis * qd[:, 6:]
        outputs = q[:, :3] + r1 - r2, S2, qd[:, :3] + np.cross(omega1, r1) - np.cross(omega2, r2), omega2
        if qdd is None:
            return outputs
        alpha1 = e_x * qdd[:, 3:4] + e_y * qdd[:, 4:5] + e_z * qdd[:, 5:6]
        alpha1 += np.cross(e_x * qd[:, 3:4], e_y * qd[:, 4:5]) + np.cross(half, e_z * qd[:, 5:6])
        alpha2 = alpha1 + axis * qdd[:, 6:] + np.cross(omega1, axis) * qd[:, 6:]
        a2 = qdd[:, :3] + np.cross(alpha1, r1) + np.cross(omega1, np.cross(omega1, r1))
        return *outputs, a2 - np.cross(alpha2, r2) - np.cross(omega2, np.cross(omega2, r2)), alpha2

    return compute


def _copy_job(task: _Task) -> Job:
    """Return a job that copies as many numbers as the outputs have: no method is faster."""
    pairs = [(array, np.ones_like(array)) for array in task.buffers().values()]

    def copy() -> None:
        for target, source in pairs:
            np.copyto(target, source)

    return copy


class Method(NamedTuple):
    """A way to compute the outputs."""

    make_job: Callable[[_Task], Job]  # what a user sets up once is set up here and not timed
    min_count: int = 1  # smallest number of states for which it is measured
    max_count: int = 10**7


COPY = "copying the outputs (the floor)"
METHODS = {
    "hingepair": Method(_call_job),
    "hingepair, prepared": Method(_prepared_job),
    "hingepair, out=": Method(lambda task: _call_job(task, reuse=True), min_count=2),
    "Pinocchio, Python loop": Method(_pinocchio_job, max_count=10**4),
    "NumPy and SciPy, 3 x 3": Method(_numpy_job, max_count=10**5),
    COPY: Method(_copy_job, min_count=2),
}


def bench(counts: Sequence[int], level: str, repeats: int) -> Iterator[Row]:
    """Measure all methods for several numbers of states.

    Args:
        counts: numbers of states.
        level: of LEVELS.
        repeats: number of processes, of which the medians are returned.
    """
    rng = np.random.default_rng(20)
    errors = largest_errors(random_states(rng, 40, level)), largest_errors(hard_states(rng, level))
    for count in counts:
        times = [_times_of_process(count, level) for _ in range(repeats)]
        for method in times[0]["methods"]:
            first, later = (median(one["methods"][method][k] for one in times) for k in (0, 1))
            pin, floor = (median(one["methods"][method][1] / one[unit] for one in times) for unit in ("pin", "floor"))
            yield Row(method, count, first, later, pin, floor, *(one.get(method) for one in errors))


def _times_of_process(count: int, level: str) -> dict[str, Any]:
    """Return what `print_times` prints in a new process."""
    code = f"from hingepair.bench.pair import print_times; print_times({count}, {level!r})"
    # -P: files of the current folder are not imported.
    process = subprocess.run([sys.executable, "-P", "-c", code], stdout=subprocess.PIPE, text=True, check=True)
    times: dict[str, Any] = json.loads(process.stdout)
    return times


def print_times(count: int, level: str) -> None:
    """Print times of the methods in this process [s] as JSON: of the first call and of a later one of each method, of
    Pinocchio's calls for one state, and of copying.
    """
    motion = random_states(np.random.default_rng(21), count, level)
    task, one = _Task(_pair(), motion), _Task(_pair(), tuple(c[:1] for c in motion))
    jobs = {name: m.make_job(task) for name, m in METHODS.items() if m.min_count <= count <= m.max_count}
    first = {name: _time_of(job, 1) for name, job in jobs.items()}
    references = {"pin": _pinocchio_job(one), "floor": _copy_job(task)}
    later: dict[str, list[float]] = {name: [] for name in (*jobs, *references)}
    for _ in range(3):  # in turn, so that disturbances meet all alike
        for name, job in (jobs | references).items():
            later[name].append(_time_of(job, max(1, int(2e-3 / max(_time_of(job, 1), 1e-7)))))
    times = {name: min(own) for name, own in later.items()}
    methods = {name: (first[name], times[name]) for name in jobs}
    print(json.dumps({"methods": methods} | {name: times[name] for name in references}))


def _time_of(job: Job, calls: int) -> float:
    """Return the mean time of so many calls [s]."""
    start = time.perf_counter()
    for _ in range(calls):
        job()
    return (time.perf_counter() - start) / calls


def _pair() -> HingePair:
    return HingePair(u1=_U1, u2=_U2, n=_N, home=_HOME)


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


def largest_errors(motion: tuple[Array, ...], methods: Mapping[str, Method] = METHODS) -> dict[str, float]:
    """Return the largest error of any output of each method but the copy [u * scale], against 60 digits."""
    pair, errors = _pair(), {}
    rates: Any = motion[1:]
    truth = from_euler((pair.u1, pair.u2, np.array(_N), pair.home), motion[0], *rates)
    task = _Task(pair, motion)
    for name, method in methods.items():
        if name != COPY and method.min_count <= len(motion[0]):
            with np.errstate(all="ignore"):
                found = method.make_job(task)()
            pairs = zip(task.outputs, found, strict=True)
            errors[name] = float(max(truth.errors(output, value).max() for output, value in pairs))
    return errors


def machine_facts() -> dict[str, Any]:
    """Return the processor, its cores, the system, and the versions of Python and of the packages measured."""
    processor = platform.processor()
    if os.path.exists("/proc/cpuinfo"):
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
            processor = next(named, processor)
    facts = {"processor": processor, "machine": platform.machine(), "cores": os.cpu_count()}
    facts |= {"system": platform.system(), "python": platform.python_version()}
    return facts | {name: version(name) for name in ("hingepair", "numpy", "llvmlite", "pin")}
