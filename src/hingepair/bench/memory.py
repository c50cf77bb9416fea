"""What `bench direct --memory` measures: how much memory a call takes beyond its inputs and outputs."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hingepair.bench.methods import LEVELS

STATUS = Path("/proc/self/status")

# Both children do the same up to the inputs (a few samples bring the kernels). Then
# one makes arrays as large as the outputs, the other computes them.
_CHILD = """
import sys
import numpy as np
import hingepair as hp
from hingepair.bench.methods import outputs_at, room_at
level, backend, workers, samples, compute = sys.argv[1], sys.argv[2], *map(int, sys.argv[3:])
pair = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
parts = {levels}.index(level) + 1
rng = np.random.default_rng(0)
how = dict(outputs=outputs_at(parts), backend=backend, workers=workers)
pair.forward_kinematics(*rng.normal(size=(parts, 8, 7)), **how)
motion = rng.normal(size=(parts, samples, 7))
if compute:
    found = pair.forward_kinematics(*motion, **how)
else:
    found = room_at(parts, samples)
    for array in found.values():
        array.fill(1.0)
peak = next(line for line in open("{status}") if line.startswith("VmHWM"))
print(int(peak.split()[1]) * 1024)
"""


@dataclass(frozen=True, slots=True)
class Peak:
    """The memory of one call at its highest.

    Attributes:
        backend: numba or numpy.
        workers: threads.
        level: pose, velocity or acceleration.
        samples: N.
        arrays_mb: 1e6 bytes of inputs and outputs.
        extra_mb: what the process needed beyond them.
    """

    backend: str
    workers: int
    level: str
    samples: int
    arrays_mb: float
    extra_mb: float


def peaks(samples: int, tell: Callable[[str], None]) -> list[Peak]:
    """Measure both backends at all levels; nothing where a system does not tell peaks (only Linux does)."""
    if not STATUS.exists():
        return []
    found = []
    for backend, workers in (("numba", 1), ("numba", 2), ("numpy", 1), ("numpy", 2)):
        tell(f"memory: {backend}, workers={workers}, N = {samples}")
        for parts, (level, outputs) in enumerate(LEVELS.items(), 1):
            extra = _peak(level, backend, workers, samples, True) - _peak(level, backend, workers, samples, False)
            numbers = parts * 7 + sum(9 if name == "S2" else 3 for name in outputs)
            found.append(Peak(backend, workers, level, samples, numbers * 8 * samples / 1e6, extra / 1e6))
    return found


def _peak(level: str, backend: str, workers: int, samples: int, compute: bool) -> int:
    """The largest resident size of a fresh process [bytes]."""
    code = _CHILD.format(levels=list(LEVELS), status=STATUS)
    options = [level, backend, str(workers), str(samples), str(int(compute))]
    done = subprocess.run([sys.executable, "-c", code, *options], capture_output=True, text=True, check=True)
    return int(done.stdout)
