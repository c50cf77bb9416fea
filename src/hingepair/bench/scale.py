"""`hingepair bench scale`: the overhead of Dask over the plain call, the gain of threads, and the memory."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from hingepair.bench.direct import PAIR_ARGUMENTS
from hingepair.bench.harness import Case, Job, Report, Row, measure, print_progress
from hingepair.formats.robots import load_robot
from hingepair.numeric.optional import require
from hingepair.pair.hinge_pair import HingePair

MAX_CHUNK = 1_000_000  # samples of a Dask chunk
VARIANTS = 1000  # of a sweep
MEMORY, PROCESSOR_TIME = "peak memory [MB]", "processor time [s]"  # headings of columns

# On Linux, ru_maxrss of a new process begins with the memory of the process that started it; VmHWM does not.
# A process that reduces lazy poses and prints its run time [s] and its peak memory [MB]; arguments: samples, threads.
_REDUCTION = """
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
_ARM = """
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
_PANDA = """
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
# Scene, output and varied key of each sweep.
_SWEEPS = {
    "forces of a hinge, 2001 instants": (_ARM, "hinge_torque", "pair.body2.mass"),
    "torques of Panda, 101 instants": (_PANDA, "tau", "mechanism.payload.panda_hand.mass"),
}


def bench_scale(samples: int, reduction: int, threads: int, repeats: int) -> Report:
    """Measure calls on NumPy and on Dask arrays, a long reduction and sweeps.

    Args:
        samples: of the calls.
        reduction: samples of the reduction whose memory is measured; 0 for none.
        threads: that are compared with one.
        repeats: of the calls; the rest is measured once.

    Raises:
        MissingDependencyError: Dask is not installed.
    """
    require("dask.array", "bench scale")
    rows = []
    for case, plain, lazy, arrays in workloads(samples):
        rows += _measure_beside_dask(f"{case}, N = {samples:,}", plain, lazy, arrays, threads, repeats)
    if reduction:
        print_progress(f"a reduction of {reduction:,} samples in a process of its own")
        rows.append(measure_reduction(reduction, threads))
    print_progress(f"sweeps of {VARIANTS} variants")
    rows += [_measure_sweep(name, threads) for name in _SWEEPS]
    notes = [
        "plain call and Dask keep only the largest value of each component; Dask: chunks of "
        f"{MAX_CHUNK:,} samples at most",
        f"{PROCESSOR_TIME}: of all threads of the process; where T threads take X times that of one thread, they "
        "are at most T / X times as fast on idle cores",
        "the plain call writes into new memory, whose pages the system clears; chunks use their memory again",
        "velocity: the memory bandwidth limits the run time (112 bytes are read and 72 written for each sample), "
        "so threads gain less than for forward dynamics, which arithmetic limits",
    ]
    return Report(rows, notes=notes)


class Workload(NamedTuple):
    """A computation on arrays and its reduction."""

    name: str
    plain: Callable[[int], Any]  # by hingepair's own threads, of which the argument is the number
    lazy: Callable[..., list[Any]]  # of Dask arrays
    arrays: Sequence[Any]  # (samples, ...)


def workloads(samples: int) -> Iterator[Workload]:
    """Yield what is computed of so many samples: memory limits the first, arithmetic the second."""
    pair, outputs = HingePair(**PAIR_ARGUMENTS), ("R2", "v2", "omega2")
    q, qd = np.random.default_rng(51).normal(size=(2, samples, 7))

    def velocity(*motion: Any, **options: Any) -> list[Any]:
        state = pair.forward_kinematics(*motion, outputs=outputs, **options)
        return [state[name].max(axis=0) for name in outputs]

    yield Workload("velocity", lambda workers: velocity(q, qd, workers=workers), velocity, (q, qd))
    robot = load_robot("panda", locked={"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02})
    states = np.random.default_rng(52).uniform(-1, 1, (3, samples, robot.dof))

    def forward(*arrays: Any, **options: Any) -> list[Any]:
        return [robot.forward_dynamics(*arrays, **options).qdd.max(axis=0)]

    yield Workload("forward dynamics of panda", lambda workers: forward(*states, workers=workers), forward, [*states])


def _measure_beside_dask(
    case: str,
    plain: Callable[[int], Any],
    lazy: Callable[..., list[Any]],
    arrays: Sequence[Any],
    threads: int,
    repeats: int,
) -> list[Row]:
    """Return the rows of a plain call and of one on Dask arrays, with one thread and with several."""
    import dask
    import dask.array as da

    samples = len(arrays[0])
    chunk = max(1, min(MAX_CHUNK, samples // 8))
    chunked = [da.from_array(array, chunks=(chunk, array.shape[1]), name=False) for array in arrays]
    jobs: dict[str, Job] = {}
    processor: dict[str, list[float]] = {}

    def timed(name: str, call: Callable[[], Any]) -> None:
        """Add a job that also notes the processor time of each call."""
        own = processor.setdefault(name, [])

        def run() -> None:
            start = time.process_time()
            call()
            own.append(time.process_time() - start)

        jobs[name] = run

    def by_dask(pool: ThreadPoolExecutor) -> None:
        dask.compute(*lazy(*chunked), scheduler="threads", pool=pool)

    with ExitStack() as pools:
        for workers in dict.fromkeys((1, threads)):
            text = f"{workers} thread{'s' * (workers > 1)}"
            pool = pools.enter_context(ThreadPoolExecutor(workers))  # its threads keep their memory between calls
            timed(f"plain call, {text}", partial(plain, workers))
            timed(f"Dask, {text}", partial(by_dask, pool))
        rows = measure([Case(case, jobs, samples)], repeats)
    return [
        replace(row, extra_columns={PROCESSOR_TIME: round(median(processor[row.method][-repeats:]), 3)})
        for row in rows
    ]


def measure_reduction(samples: int, threads: int) -> Row:
    """Measure run time and peak memory of a Dask reduction of random poses, once, in a process of its own."""
    command = [sys.executable, "-c", _REDUCTION, str(samples), str(threads)]
    seconds, peak = map(float, subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())
    case = "random poses, the largest of each component"
    return Row(case, f"Dask, {threads} threads", samples, seconds, seconds, 1.0, extra_columns={MEMORY: round(peak)})


def _measure_sweep(name: str, threads: int) -> Row:
    """Measure `hingepair sweep`, once, with the start of its process."""
    scene, output, key = _SWEEPS[name]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "scene.toml").write_text(scene, encoding="utf-8")
        text = f"""
scene = "scene.toml"
outputs = ["{output}"]
reduce = ["absmax", "rms"]
design = "random"
samples = {VARIANTS}
chunk = {VARIANTS // 8}
[[vary]]
key = "{key}"
low = 0.5
high = 3
"""
        path = Path(folder, "sweep.toml")
        path.write_text(text, encoding="utf-8")
        command = [sys.executable, "-m", "hingepair", "sweep", str(path), "--workers", str(threads)]
        start = time.perf_counter()
        subprocess.run([*command, "--out", str(Path(folder, "out.parquet"))], capture_output=True, check=True)
        seconds = time.perf_counter() - start
    return Row(f"sweep: {name}", f"{threads} threads", VARIANTS, seconds, seconds, 1.0)
