"""`hingepair bench skip`: what leaving out what a scene does not need is worth, each against the full path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.direct import interleaved
from hingepair.bench.methods import LEVELS, Job
from hingepair.evaluation.plan import PLANAR, SPATIAL, outputs_of
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.rotations.matrices import rodrigues


@dataclass(frozen=True, slots=True)
class Skip:
    """One thing that is skipped.

    Attributes:
        skipped: what.
        backend: numba or numpy.
        full_ns: nanoseconds a sample without the skip, median.
        skip_ns: with it.
        ratio: skip_ns / full_ns.
    """

    skipped: str
    backend: str
    full_ns: float
    skip_ns: float
    ratio: float


def skips(samples: int, repeats: int, tell: Callable[[str], None]) -> list[Skip]:
    """Measure each skip on and off, interleaved, for both backends."""
    rows = []
    for backend in ("numba", "numpy"):
        jobs = _jobs(samples, backend)
        tell(f"{backend}, N = {samples}: {len(jobs)} paths, {repeats} repeats")
        times = {name: median(found) / samples * 1e9 for name, found in interleaved(jobs, repeats).items()}
        for name, taken in times.items():
            if name not in _FULL:
                full = times[_AGAINST[name]]
                rows.append(Skip(name, backend, full, taken, taken / full))
    return rows


_FULL = ("velocity", "velocity with home", "velocity in the plane")
_AGAINST = {
    "velocities (pose only)": "velocity",
    "outputs not asked for (R2 alone)": "velocity",
    "constant attitude of body 1": "velocity",
    "constant phi_x and phi_y": "velocity",
    "constant hinge rate and position rates": "velocity",
    "home = identity": "velocity with home",
    "turns about x and y, proven absent (E11)": "velocity in the plane",
    "the third dimension (PlanarPair)": "velocity in the plane",
    "digits (float32)": "velocity",
}

Columns: TypeAlias = tuple[NDArray[np.float64], ...]

_PLANAR = ("R2", "phi2", "d", "v2", "omega2")


def _jobs(samples: int, backend: str) -> dict[str, Job]:
    rng = np.random.default_rng(21)
    q, qd = rng.normal(size=(2, samples, 7))
    columns, rates = tuple(np.ascontiguousarray(c) for c in q.T), tuple(np.ascontiguousarray(c) for c in qd.T)

    def job(pair: Any, *motion: Any, outputs: tuple[str, ...] = LEVELS["velocity"], dtype: type = np.float64) -> Job:
        layout = outputs_of(PLANAR if isinstance(pair, PlanarPair) else SPATIAL)
        out: dict[str, NDArray[Any]] = {name: np.zeros((samples, *layout[name].tail), dtype) for name in outputs}
        return lambda: pair.forward_kinematics(*motion, outputs=outputs, out=out, backend=backend).arrays()

    return _in_space(job, columns, rates) | _in_the_plane(job, columns, rates, np.zeros(samples))


def _in_space(job: Callable[..., Job], columns: Columns, rates: Columns) -> dict[str, Job]:
    plain = HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
    turned = HingePair(u1=plain.u1, u2=plain.u2, n=plain.n, home=rodrigues((1, -2, 0.5), 0.7))
    single = [tuple(c.astype(np.float32) for c in part) for part in (columns, rates)]
    return {
        "velocity": job(plain, columns, rates),
        "velocity with home": job(turned, columns, rates),
        "velocities (pose only)": job(plain, columns, outputs=LEVELS["pose"]),
        "outputs not asked for (R2 alone)": job(plain, columns, rates, outputs=("R2",)),
        "constant attitude of body 1": job(
            plain, (*columns[:3], 0.1, 0.2, 0.3, columns[6]), (*rates[:3], 0.0, 0.0, 0.0, rates[6])
        ),
        "constant phi_x and phi_y": job(plain, (*columns[:3], 0.1, 0.2, *columns[5:]), rates),
        "constant hinge rate and position rates": job(plain, columns, (1.0, 2.0, 3.0, *rates[3:6], 4.0)),
        "home = identity": job(plain, columns, rates),
        "digits (float32)": job(plain, *single, dtype=np.float32),
    }


def _in_the_plane(
    job: Callable[..., Job], columns: Columns, rates: Columns, zero: NDArray[np.float64]
) -> dict[str, Job]:
    flat = PlanarPair(u1=(0.5, 0.2), u2=(-0.25, 0.1))
    upright = flat.to_spatial()
    unproven = [(*part[:3], zero, zero, *part[5:]) for part in (columns, rates)]
    proven = [(*part[:3], 0.0, 0.0, *part[5:]) for part in (columns, rates)]
    four = [(*part[:2], *part[5:]) for part in (columns, rates)]
    return {
        "velocity in the plane": job(upright, *unproven),
        "turns about x and y, proven absent (E11)": job(upright, *proven),
        "the third dimension (PlanarPair)": job(flat, *four, outputs=_PLANAR),
    }
