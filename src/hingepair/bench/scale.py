"""`hingepair bench scale`: the overhead of Dask over the plain call, the gain of threads, and the memory."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np

from hingepair.bench.measure import Job, Report, Row, make_rows, print_progress, time_interleaved
from hingepair.bench.peers import BENCH_PAIR_ARGUMENT_BY_NAME
from hingepair.errors import MissingDependencyError
from hingepair.formats.robots import load_robot
from hingepair.pair.hinge_pair import HingePair

MAX_DASK_CHUNK_SAMPLES: Final = 1_000_000
"""Samples of a chunk at most."""
PLAIN_NAME, DASK_NAME = "plain call", "Dask"  # names of the methods
# Headings of columns of the table.
PEAK_MEMORY_COLUMN_HEADING: Final = "peak memory [MB]"  # of a process
PROCESSOR_TIME_COLUMN_HEADING: Final = "processor time [s]"  # of all threads in a call

_MIN_NUM_DASK_CHUNKS = 8  # chunks of a case; with few samples the chunks are smaller
_NUM_VARIANTS_PER_SWEEP = 1000  # variants of each sweep

# A process that reduces lazy poses and prints its run time [s] and its peak memory [MB]; arguments: samples, threads.
# On Linux, ru_maxrss of a new process begins with the memory of the process that started it; VmHWM does not.
_DASK_REDUCTION_PYTHON_CODE = """
import re, resource, sys, time
from pathlib import Path
import dask, dask.array as da
import hingepair as hp
count, threads = int(sys.argv[1]), int(sys.argv[2])
pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, 3))
rng = da.random.default_rng(1)
q = rng.uniform(-1, 1, size=(count, 7), chunks=(500_000, 7))
start = time.perf_counter()
with dask.config.set(scheduler="threads", num_workers=threads):
    pair.forward_kinematics(q, outputs=("R2",)).R2.max(axis=0).compute()
seconds = time.perf_counter() - start
if Path("/proc/self/status").exists():
    peak = int(re.search(r"VmHWM:\\s*(\\d+)", Path("/proc/self/status").read_text())[1]) / 1024
else:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 1024)
print(seconds, peak)
"""

# Scenes of the sweeps.
_ARM_SCENE_TOML: Final = """
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
# Scene of a robot whose payload is varied.
_PANDA_SCENE_TOML: Final = """
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
# Scene, output and varied key of each sweep, by the name of its case.
_SCENE_TOML_OUTPUT_NAME_AND_VARIED_KEY_BY_CASE_NAME: Final = {
    "forces of a hinge, 2001 instants": (_ARM_SCENE_TOML, "hinge_torque", "pair.body2.mass"),
    "torques of Panda, 101 instants": (_PANDA_SCENE_TOML, "tau", "mechanism.payload.panda_hand.mass"),
}


def measure_scaling(samples: int, reduction_samples: int, threads: int, repeats: int) -> Report:
    """Measure run times of calls on NumPy and on Dask arrays of `samples` samples, with one thread and with
    `threads`, `repeats` times. Measure once the run times of sweeps, and the run time and peak memory of a Dask
    reduction of `reduction_samples` samples, unless `reduction_samples` is 0. Return the Report. Raise a
    MissingDependencyError if Dask is not installed.

    Args:
        samples: number of samples of the calls that are compared.
        reduction_samples: number of samples of the reduction whose memory is measured; 0 for no reduction.
        threads: number of threads that are compared with one thread.
        repeats: number of repeats of each measurement.

    Raises:
        MissingDependencyError: Dask is not installed.
    """
    try:
        import dask.array  # noqa: F401
    except ImportError as error:
        requirement = "the package dask: pip install 'hingepair[dask]'"
        raise MissingDependencyError("bench scale", requirement, str(error)) from None
    print_progress(f"velocities and forward dynamics, N = {samples:,}, 1 and {threads} threads, {repeats} repeats")
    rows = [
        *_measure_velocities(samples, threads, repeats),
        *_measure_forward_dynamics(samples, threads, repeats),
    ]
    if reduction_samples:
        print_progress(f"a reduction of {reduction_samples:,} samples in a process of its own")
        rows.append(_measure_long_reduction(reduction_samples, threads))
    print_progress(f"sweeps of {_NUM_VARIANTS_PER_SWEEP} variants")
    rows += _measure_sweeps(threads)
    notes = [
        f"plain call and {DASK_NAME} keep only the largest value of each component; {DASK_NAME}: chunks of "
        f"{MAX_DASK_CHUNK_SAMPLES:,} samples at most",
        f"{PROCESSOR_TIME_COLUMN_HEADING}: of all threads of the process; where T threads take X times that of one "
        "thread, they are at most T / X times as fast on idle cores",
        "the plain call writes into new memory, whose pages the system clears; chunks use their memory again",
        "velocity: the memory bandwidth limits the run time (112 bytes are read and 72 written for each sample), "
        "so threads gain less than for forward dynamics, which arithmetic limits",
    ]
    return Report(rows, notes=notes)


def _chunk_size(samples: int) -> int:
    """Return the number of samples of a chunk."""
    return max(1, min(MAX_DASK_CHUNK_SAMPLES, samples // _MIN_NUM_DASK_CHUNKS))


def _measure_velocities(samples: int, threads: int, repeats: int) -> list[Row]:
    """Measure run times of velocities of a pair for `samples` samples, on NumPy and on Dask arrays, with one thread
    and with `threads`, `repeats` times; return a list of table rows. The memory bandwidth limits these run times.
    """
    pair, rng = HingePair(**BENCH_PAIR_ARGUMENT_BY_NAME), np.random.default_rng(51)
    q, qd = rng.normal(size=(2, samples, 7))
    outputs = ("R2", "v2", "omega2")

    def largest(state: Any) -> list[Any]:
        return [state[name].max(axis=0) for name in outputs]

    def plain(workers: int) -> Job:
        return lambda: largest(pair.forward_kinematics(q, qd, outputs=outputs, workers=workers))

    def lazy(*arrays: Any) -> list[Any]:
        return largest(pair.forward_kinematics(*arrays, outputs=outputs))

    return _measure_beside_dask("velocity", plain, lazy, (q, qd), threads, repeats)


def _measure_forward_dynamics(samples: int, threads: int, repeats: int) -> list[Row]:
    """Measure run times of forward dynamics of a robot for `samples` samples, on NumPy and on Dask arrays, with one
    thread and with `threads`, `repeats` times; return a list of table rows. Arithmetic limits these run times.
    """
    locked_positions = {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02}  # [m]
    robot, rng = load_robot("panda", locked=locked_positions), np.random.default_rng(52)
    q, qd, tau = rng.uniform(-1, 1, (3, samples, robot.dof))

    def plain(workers: int) -> Job:
        return lambda: robot.forward_dynamics(q, qd, tau, workers=workers).qdd.max(axis=0)

    def lazy(*arrays: Any) -> list[Any]:
        return [robot.forward_dynamics(*arrays).qdd.max(axis=0)]

    return _measure_beside_dask("forward dynamics of panda", plain, lazy, (q, qd, tau), threads, repeats)


def _measure_beside_dask(
    case: str,
    make_plain_job: Callable[[int], Job],
    compute_lazily: Callable[..., list[Any]],
    arrays: Sequence[Any],
    threads: int,
    repeats: int,
) -> list[Row]:
    """Measure run times of a plain call and of the same call on Dask arrays, with one thread and with `threads`,
    `repeats` times; return a list of the table rows of the case. `make_plain_job` is a function from a number of
    threads to a job of the plain call; `compute_lazily` takes the Dask arrays and returns a list of lazy results.

    Args:
        case: name of the case.
        make_plain_job: returns the job of the plain call on a number of threads.
        compute_lazily: returns the lazy results of Dask arrays.
        arrays: inputs; shape (samples, ...).
        threads: number of threads that are compared with one thread.
        repeats: number of repeats of each measurement.
    """
    import dask
    import dask.array as da

    samples = len(arrays[0])
    chunked = [da.from_array(array, chunks=(_chunk_size(samples), array.shape[1]), name=False) for array in arrays]

    def by_dask(pool: ThreadPoolExecutor) -> Job:
        return lambda: dask.compute(*compute_lazily(*chunked), scheduler="threads", pool=pool)

    jobs: dict[str, Job] = {}
    cpu_seconds: dict[str, list[float]] = {}
    with contextlib.ExitStack() as pools:
        for workers in dict.fromkeys((1, threads)):
            threads_text = f"{workers} thread{'s' * (workers > 1)}"
            pool = pools.enter_context(ThreadPoolExecutor(workers))  # its threads keep their memory between calls
            for name, job in ((PLAIN_NAME, make_plain_job(workers)), (DASK_NAME, by_dask(pool))):
                method = f"{name}, {threads_text}"
                cpu_seconds[method] = []
                jobs[method] = _with_processor_time(job, cpu_seconds[method])
        times = time_interleaved(jobs, repeats)
    extra_columns = {
        name: {PROCESSOR_TIME_COLUMN_HEADING: round(median(seconds[-repeats:]), 3)}
        for name, seconds in cpu_seconds.items()
    }
    return make_rows(case, times, samples, extra_columns=extra_columns)


def _with_processor_time(job: Job, processor_seconds: list[float]) -> Job:
    """Return a job that runs the given job and returns its result. Each call appends the processor time of all
    threads [s] to the list `processor_seconds`.
    """

    def run() -> Any:
        """Run the job, append the processor time of the call [s] to the list, and return the result of the job."""
        start = time.process_time()
        result = job()
        processor_seconds.append(time.process_time() - start)
        return result

    return run


def _measure_long_reduction(samples: int, threads: int) -> Row:
    """Measure once the run time and the peak memory of a Dask reduction of `samples` random poses, with `threads`
    threads in a separate process; return one table row. Raise a CalledProcessError if the process fails.
    """
    command = [sys.executable, "-c", _DASK_REDUCTION_PYTHON_CODE, str(samples), str(threads)]
    seconds, peak = map(float, subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())
    case, method = "random poses, the largest of each component", f"{DASK_NAME}, {threads} threads"
    return Row(case, method, samples, seconds, seconds, 1.0, extra_columns={PEAK_MEMORY_COLUMN_HEADING: round(peak)})


def _measure_sweeps(threads: int) -> list[Row]:
    """Measure once the run time of the command `hingepair sweep` with `threads` workers on each of several sweeps,
    including the start of the process; return a list of table rows. Raise a CalledProcessError if a process fails.
    """
    rows = []
    for case, (scene, output, key) in _SCENE_TOML_OUTPUT_NAME_AND_VARIED_KEY_BY_CASE_NAME.items():
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "scene.toml").write_text(scene, encoding="utf-8")
            design = (
                f'design = "random"\nsamples = {_NUM_VARIANTS_PER_SWEEP}\nchunk = {_NUM_VARIANTS_PER_SWEEP // 8}\n'
            )
            vary = f'[[vary]]\nkey = "{key}"\nlow = 0.5\nhigh = 3\n'
            text = f'scene = "scene.toml"\noutputs = ["{output}"]\nreduce = ["absmax", "rms"]\n{design}{vary}'
            path = Path(folder, "sweep.toml")
            path.write_text(text, encoding="utf-8")
            command = [sys.executable, "-m", "hingepair", "sweep", str(path), "--workers", str(threads)]
            start = time.perf_counter()
            subprocess.run([*command, "--out", str(Path(folder, "out.parquet"))], capture_output=True, check=True)
            seconds = time.perf_counter() - start
        rows.append(Row(f"sweep: {case}", f"{threads} threads", _NUM_VARIANTS_PER_SWEEP, seconds, seconds, 1.0))
    return rows
