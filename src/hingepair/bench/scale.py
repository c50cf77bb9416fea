"""`hingepair bench scale`: what Dask costs beside the plain call, what threads gain, how much memory it takes."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from hingepair.bench.measure import Job, Report, Row, interleaved, rows_of, tell
from hingepair.bench.peers import CONSTANTS
from hingepair.errors import MissingDependencyError
from hingepair.formats.robots import load_robot
from hingepair.pair.hinge_pair import HingePair

CHUNK: Final = 1_000_000
"""Samples of a chunk."""
PLAIN, LAZY = "plain call", "Dask"
MEMORY: Final = "peak memory [MB]"

_LEAST_CHUNKS = 8  # of a case, however few samples it has
_ROBOT = "panda"
_LOCKED = {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02}
_VARIANTS = 1000  # of a sweep
_OUTPUTS = ("R2", "v2", "omega2")

_REDUCED_IN_LITTLE_MEMORY = """
import resource, sys, time
import dask, dask.array as da
import hingepair as hp
count, threads = int(sys.argv[1]), int(sys.argv[2])
pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, 3))
rng = da.random.default_rng(1)
q = rng.uniform(-1, 1, size=(count, 7), chunks=(500_000, 7))
start = time.perf_counter()
with dask.config.set(scheduler="threads", num_workers=threads):
    pair.forward_kinematics(q, outputs=("R2",)).R2.max(axis=0).compute()
print(time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""

_ARM: Final = """
[pair]
u1 = [0.5, 0.2, 0.1]
u2 = [-0.25, 0.1, 0.3]
n = [1, 2, 0]
body2 = { mass = 2, inertia = [0.1, 0.2, 0.2] }
[motion]
x = 0
y = 0
z = 0
phi_x = "0.3*sin(t)"
phi_y = 0
phi_z = 0
psi = { t = [0, 9], value = [0, "pi/2"], profile = "quintic" }
[time]
start = 0
stop = 10
samples = 2001
"""
_PANDA: Final = """
[mechanism]
robot = "panda"
locked = { panda_finger_joint1 = 0.02, panda_finger_joint2 = 0.02 }
[mechanism.payload.panda_hand]
mass = 1.5
inertia = [0.01, 0.01, 0.01]
[motion]
panda_joint2 = { t = [0, 2], value = [-0.4, 0.6], profile = "quintic" }
[time]
start = 0
stop = 2
samples = 101
"""
_SWEEPS: Final = {
    "forces of a hinge, 2001 instants": (_ARM, "hinge_torque", "pair.body2.mass"),
    "torques of Panda, 101 instants": (_PANDA, "tau", "mechanism.payload.panda_hand.mass"),
}


def scale(samples: int, long: int, threads: int, repeats: int) -> Report:
    """Measure Dask beside the plain call, threads beside one, a long reduction, and sweeps.

    Args:
        samples: of the calls that are compared.
        long: samples of the reduction whose memory is measured; 0 for none.
        threads: that are compared with one.
        repeats: of each measurement.

    Raises:
        MissingDependencyError: Dask is not installed.
    """
    try:
        import dask.array  # noqa: F401
    except ImportError as error:
        needed = "the package dask: pip install 'hingepair[dask]'"
        raise MissingDependencyError("bench scale", needed, str(error)) from None
    tell(f"velocities and forward dynamics, N = {samples:,}, 1 and {threads} threads, {repeats} repeats")
    rows = [*_velocities(samples, threads, repeats), *_dynamics(max(samples // 10, 1), threads, repeats)]
    if long:
        tell(f"a reduction of {long:,} samples in a process of its own")
        rows.append(_long(long, threads))
    tell(f"sweeps of {_VARIANTS} variants")
    rows += _swept(threads)
    notes = [
        f"{LAZY}: chunks of {CHUNK:,} samples at most; the largest value of every component is kept by both",
        "velocities move 112 bytes in and 72 out for each sample: there memory is the wall, and threads gain "
        "less than for forward dynamics, whose arithmetic is",
    ]
    return Report(rows, notes=notes)


def _chunk(samples: int) -> int:
    return max(1, min(CHUNK, samples // _LEAST_CHUNKS))


def _velocities(samples: int, threads: int, repeats: int) -> list[Row]:
    """Measure velocities of a pair: little arithmetic, much memory."""
    pair, rng = HingePair(**CONSTANTS), np.random.default_rng(51)
    q, qd = rng.normal(size=(2, samples, 7))

    def largest(state: Any) -> list[Any]:
        return [state[name].max(axis=0) for name in _OUTPUTS]

    def plain(workers: int) -> Job:
        return lambda: largest(pair.forward_kinematics(q, qd, outputs=_OUTPUTS, workers=workers))

    def lazy(*arrays: Any) -> list[Any]:
        return largest(pair.forward_kinematics(*arrays, outputs=_OUTPUTS))

    return _measure_beside_dask("velocity", plain, lazy, (q, qd), threads, repeats)


def _dynamics(samples: int, threads: int, repeats: int) -> list[Row]:
    """Measure forward dynamics of a robot: much arithmetic, little memory."""
    robot, rng = load_robot(_ROBOT, locked=_LOCKED), np.random.default_rng(52)
    q, qd, tau = rng.uniform(-1, 1, (3, samples, robot.dof))

    def plain(workers: int) -> Job:
        return lambda: robot.forward_dynamics(q, qd, tau, workers=workers).qdd.max(axis=0)

    def lazy(*arrays: Any) -> list[Any]:
        return [robot.forward_dynamics(*arrays).qdd.max(axis=0)]

    return _measure_beside_dask(f"forward dynamics of {_ROBOT}", plain, lazy, (q, qd, tau), threads, repeats)


def _measure_beside_dask(
    case: str,
    plain: Callable[[int], Job],
    lazy: Callable[..., list[Any]],
    arrays: Sequence[Any],
    threads: int,
    repeats: int,
) -> list[Row]:
    """Measure plain calls and Dask on one thread and on several, in one run."""
    import dask
    import dask.array as da

    samples = len(arrays[0])
    chunked = [da.from_array(own, chunks=(_chunk(samples), own.shape[1]), name=False) for own in arrays]

    def by_dask(workers: int) -> Job:
        return lambda: dask.compute(*lazy(*chunked), scheduler="threads", num_workers=workers)

    jobs: dict[str, Job] = {}
    for workers in dict.fromkeys((1, threads)):
        of = f"{workers} thread{'s' * (workers > 1)}"
        jobs |= {f"{PLAIN}, {of}": plain(workers), f"{LAZY}, {of}": by_dask(workers)}
    return rows_of(case, interleaved(jobs, repeats), samples)


def _long(samples: int, threads: int) -> Row:
    """Measure run time and memory of a reduction that holds a few chunks at a time."""
    command = [sys.executable, "-c", _REDUCED_IN_LITTLE_MEMORY, str(samples), str(threads)]
    seconds, peak = map(float, subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())
    case, method = "random poses, the largest of each component", f"{LAZY}, {threads} threads"
    return Row(case, method, samples, seconds, seconds, 1.0, more={MEMORY: round(peak)})


def _swept(threads: int) -> list[Row]:
    """Measure `hingepair sweep`, the start of its process included."""
    rows = []
    for case, (scene, output, key) in _SWEEPS.items():
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "scene.toml").write_text(scene, encoding="utf-8")
            design = f'design = "random"\nsamples = {_VARIANTS}\nchunk = {_VARIANTS // 8}\n'
            vary = f'[[vary]]\nkey = "{key}"\nlow = 0.5\nhigh = 3\n'
            text = f'scene = "scene.toml"\noutputs = ["{output}"]\nreduce = ["absmax", "rms"]\n{design}{vary}'
            path = Path(folder, "sweep.toml")
            path.write_text(text, encoding="utf-8")
            command = [sys.executable, "-m", "hingepair", "sweep", str(path), "--workers", str(threads)]
            start = time.perf_counter()
            subprocess.run([*command, "--out", str(Path(folder, "out.parquet"))], capture_output=True, check=True)
            seconds = time.perf_counter() - start
        rows.append(Row(f"sweep: {case}", f"{threads} threads", _VARIANTS, seconds, seconds, 1.0))
    return rows
