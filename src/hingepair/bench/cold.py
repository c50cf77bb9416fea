"""What `bench direct --cold` measures: the first seconds of a process, each time in a fresh one."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median

_CLOCK = "import time; start = time.perf_counter(); {}; print(time.perf_counter() - start)"
_FIRST = """
import time
import numpy as np
import hingepair as hp
pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
q, qd = np.random.default_rng(0).normal(size=(2, 1_000_000, 7))
start = time.perf_counter()
pair.forward_kinematics(q, qd)
print(time.perf_counter() - start)
"""
_SCENE = """
[pair]
u1 = [0.5, 0.2, 0.1]
u2 = [-0.25, 0.1, 0.3]
n = [1, 0, 0]
[motion]
x = "3*t"
y = "3*t"
z = "3*t"
phi_x = "3*t"
phi_y = "t"
phi_z = "5*t"
psi = "10*t"
[time]
start = 0
stop = 10
samples = 10001
"""
_RUN = "import sys; from hingepair.cli.main import main; sys.argv = ['hingepair', 'run', {!r}]; main()"


@dataclass(frozen=True, slots=True)
class Start:
    """One thing that a fresh process does first.

    Attributes:
        what: it does.
        median_s: seconds, the median of the processes.
        min_s: the smallest.
    """

    what: str
    median_s: float
    min_s: float


def cold_starts(repeats: int, tell: Callable[[str], None]) -> list[Start]:
    """Measure imports, a first batch with kernels on disk and without, and a scene; interleaved."""
    tell(f"cold start: {repeats} fresh processes each")
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.toml"
        scene.write_text(_SCENE, encoding="utf-8")
        warm = Path(folder) / "warm"
        _inside(_FIRST, warm)
        times: dict[str, list[float]] = {}
        for i in range(repeats):
            found = {
                "import numpy": _inside(_CLOCK.format("import numpy")),
                "import hingepair": _inside(_CLOCK.format("import hingepair")),
                "first 1,000,000 samples, kernels on disk": _inside(_FIRST, warm),
                "hingepair run, reference scene, whole process": _whole(_RUN.format(str(scene))),
            }
            if i < 2:  # seconds each
                found["first 1,000,000 samples, kernels to compile"] = _inside(_FIRST, Path(folder) / str(i))
            for what, seconds in found.items():
                times.setdefault(what, []).append(seconds)
    return [Start(what, median(taken), min(taken)) for what, taken in times.items()]


def _inside(code: str, cache: Path | None = None) -> float:
    """The seconds that a fresh process prints; with its compiled kernels in a folder of their own."""
    own = {} if cache is None else {"NUMBA_CACHE_DIR": str(cache)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ | own
    )
    return float(done.stdout)


def _whole(code: str) -> float:
    """The seconds that a process takes, from its start to its end."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    return time.perf_counter() - start
