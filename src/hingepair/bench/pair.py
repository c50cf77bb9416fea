"""Run time and error of the pose and the velocity of body 2 of one pair, beside Pinocchio and NumPy.

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

COPY, PINOCCHIO = "copying the outputs (the floor)", "Pinocchio, Python loop"  # names of methods

_OUTPUTS = ("R2", "S2", "v2", "omega2")
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
    error: float | None  # largest on random and on hard states [u * scale]; infinite where a result is not finite


_read = attrgetter(*_OUTPUTS)


def jobs(q: Array, qd: Array) -> dict[str, Job]:
    """Return the methods that suit so many states by name; what a user sets up once is set up here and not timed.

    Args:
        q: coordinates of the pair, (N, 7).
        qd: their rates.
    """
    pair, lead = _pair(), q.shape[:-1] if len(q) > 1 else ()
    motion = q.reshape(*lead, 7), qd.reshape(*lead, 7)
    call, prepared = pair.forward_kinematics, pair.prepare("velocity", outputs=_OUTPUTS)
    # Arrays that have been written, so that no page fault is timed.
    out = {name: np.ones((*lead, 3, 3) if name == "S2" else (*lead, 3)) for name in _OUTPUTS}
    copies = [(array, np.ones_like(array)) for array in out.values()]

    def copy() -> None:
        for target, source in copies:
            np.copyto(target, source)

    found: dict[str, Job] = {
        "hingepair": lambda: _read(call(*motion, outputs=_OUTPUTS)),
        "hingepair, prepared": lambda: _read(prepared(*motion)),
        "hingepair, out=": lambda: _read(call(*motion, outputs=_OUTPUTS, out=out)),
    }
    if len(q) <= 10**4:
        found[PINOCCHIO] = _pinocchio_job(pair, q, qd, tuple(out.values()))
    if len(q) <= 10**5:
        found["NumPy and SciPy, 3 x 3"] = _numpy_job(pair, q, qd)
    return found | {COPY: copy}


def _pinocchio_job(pair: HingePair, q: Array, qd: Array, out: tuple[Array, ...]) -> Job:
    """Return the job of Pinocchio's functions, one state after the other; its coordinates are made before."""
    import pinocchio as pin

    state = pair.forward_kinematics(q, qd, outputs=("R1", "S1", "v1", "omega1"))
    body1 = BodyMotion(R=state.R1, S=state.S1, v=state.v1, omega=state.omega1)
    twin = to_pinocchio(pair)
    configurations: Any = twin.configuration(body1, q[:, 6])
    velocities: Any = twin.velocity(body1, q[:, 6], qd[:, 6])
    model, frame, world = twin.model, twin.body2_frame, pin.LOCAL_WORLD_ALIGNED
    data = model.createData()

    def compute(configuration: Array, velocity: Array) -> tuple[Array, ...]:
        pin.forwardKinematics(model, data, configuration, velocity)
        place = pin.updateFramePlacement(model, data, frame)
        twist = pin.getFrameVelocity(model, data, frame, world)
        return place.translation, place.rotation, twist.linear, twist.angular

    def loop() -> tuple[Array, ...]:
        for i, one in enumerate(zip(configurations, velocities, strict=True)):
            for array, value in zip(out, compute(*one), strict=True):
                array[i] = value
        return out

    return loop if len(q) > 1 else lambda: compute(configurations[0], velocities[0])


def _numpy_job(pair: HingePair, q: Array, qd: Array) -> Job:
    """Return the job of NumPy on stacks of 3 x 3 matrices by SciPy, with @ and numpy.cross."""
    from scipy.spatial.transform import Rotation

    def compute() -> tuple[Array, ...]:
        S1 = Rotation.from_euler("XYZ", q[:, 3:6]).as_matrix()
        S2 = S1 @ Rotation.from_rotvec(q[:, 6:] * pair.n).as_matrix() @ pair.home
        r1, r2 = S1 @ pair.u1, S2 @ pair.u2
        zero = np.zeros(len(q))
        e_x, e_y = np.stack([zero + 1, zero, zero], -1), np.stack([zero, np.cos(q[:, 3]), np.sin(q[:, 3])], -1)
        omega1 = e_x * qd[:, 3:4] + e_y * qd[:, 4:5] + S1[:, :, 2] * qd[:, 5:6]
        omega2 = omega1 + (S1 @ pair.n) * qd[:, 6:]
        return q[:, :3] + r1 - r2, S2, qd[:, :3] + np.cross(omega1, r1) - np.cross(omega2, r2), omega2

    return compute


def bench(counts: Sequence[int], repeats: int) -> Iterator[Row]:
    """Measure all methods for several numbers of states.

    Args:
        counts: numbers of states.
        repeats: number of processes, of which the medians are returned.
    """
    rng = np.random.default_rng(20)
    q, qd = np.concatenate((random_states(rng, 40), hard_states(rng)), axis=1)
    errors = largest_errors(q, qd, jobs(q, qd))
    for count in counts:
        times = [_times_of_process(count) for _ in range(repeats)]
        for method in times[0]["methods"]:
            first, later = (median(one["methods"][method][k] for one in times) for k in (0, 1))
            pin, floor = (median(one["methods"][method][1] / one[unit] for one in times) for unit in ("pin", "floor"))
            yield Row(method, count, first, later, pin, floor, errors.get(method))


def _times_of_process(count: int) -> dict[str, Any]:
    """Return what `print_times` prints in a new process."""
    code = f"from hingepair.bench.pair import print_times; print_times({count})"
    # -P: files of the current folder are not imported.
    process = subprocess.run([sys.executable, "-P", "-c", code], stdout=subprocess.PIPE, text=True, check=True)
    times: dict[str, Any] = json.loads(process.stdout)
    return times


def print_times(count: int) -> None:
    """Print times of the methods in this process [s] as JSON: of the first call and of a later one of each method, of
    Pinocchio's calls for one state, and of copying.
    """
    q, qd = random_states(np.random.default_rng(21), count)
    methods, pin = jobs(q, qd), jobs(q[:1], qd[:1])[PINOCCHIO]
    first = {name: _time_of(job, 1) for name, job in methods.items()}
    later: dict[str, list[float]] = {name: [] for name in (*methods, "pin")}
    for _ in range(3):  # in turn, so that disturbances meet all alike
        for name, job in {**methods, "pin": pin}.items():
            later[name].append(_time_of(job, max(1, int(2e-3 / max(_time_of(job, 1), 1e-7)))))
    times = {name: min(own) for name, own in later.items()}
    pairs = {name: (first[name], times[name]) for name in methods}
    print(json.dumps({"methods": pairs, "pin": times["pin"], "floor": times[COPY]}))


def _time_of(job: Job, calls: int) -> float:
    """Return the mean time of so many calls [s]."""
    start = time.perf_counter()
    for _ in range(calls):
        job()
    return (time.perf_counter() - start) / calls


def _pair() -> HingePair:
    return HingePair(u1=_U1, u2=_U2, n=_N, home=_HOME)


def random_states(rng: np.random.Generator, count: int) -> Array:
    """Return q and qd of normally distributed numbers; (2, count, 7)."""
    return rng.normal(size=(2, count, 7))


def hard_states(rng: np.random.Generator) -> Array:
    """Return q and qd of random states that are hard in one way each; (2, N, 7)."""
    quarter = math.pi / 2
    psis = (1e-160, 1e-9, -1e-5, 0.0, math.pi, math.pi - 1e-9, math.pi + 1e-9, 1e5, -1e16, 1e300)
    changes: list[tuple[Any, Any, float]] = [(6, psi, 1.0) for psi in psis]
    changes += [(4, angle, 1.0) for angle in (quarter, -quarter, quarter - 1e-9, quarter + 1e-9)]  # gimbal lock
    changes += [(slice(3, 7), (quarter, 2 * quarter, -quarter, 4 * quarter), 1.0)]
    changes += [(slice(3, 7), angle, 1.0) for angle in (1e-9, 1e6, 1e16)]
    changes += [(slice(0, 3), (far, -far / 3, far), 1.0) for far in (1e8, 1e15)]
    changes += [(slice(0, 0), (), rate) for rate in (0.0, 1e-60, 1e20, 1e100)]
    motion = random_states(rng, len(changes))
    for sample, (index, value, rate) in enumerate(changes):
        motion[0, sample, index] = value
        motion[1, sample] *= rate
    return motion


def largest_errors(q: Array, qd: Array, methods: Mapping[str, Job]) -> dict[str, float]:
    """Return the largest error of any output of each method but the copy [u * scale], against 60 digits."""
    pair, errors = _pair(), {}
    truth = from_euler((pair.u1, pair.u2, np.array(_N), pair.home), q, qd)
    for name, method in methods.items():
        if name != COPY:
            with np.errstate(all="ignore"):
                pairs = zip(_OUTPUTS, method(), strict=True)
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
