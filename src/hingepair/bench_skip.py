"""`hingepair bench skip`: what leaving out what a scene does not need is worth, each against the full path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.bench import interleaved
from hingepair.bench_methods import LEVELS, Job
from hingepair.pair import HingePair
from hingepair.planar import PlanarPair
from hingepair.rotations import rodrigues


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

_PLANAR = ("R2", "phi2", "d", "v2", "omega2")


def _jobs(samples: int, backend: str) -> dict[str, Job]:
    rng = np.random.default_rng(21)
    q, qd = rng.normal(size=(2, samples, 7))
    plain = HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
    turned = HingePair(u1=plain.u1, u2=plain.u2, n=plain.n, home=rodrigues((1, -2, 0.5), 0.7))
    names = LEVELS["velocity"]
    columns, rates = tuple(np.ascontiguousarray(c) for c in q.T), tuple(np.ascontiguousarray(c) for c in qd.T)
    zero = np.zeros(samples)

    def room(outputs: tuple[str, ...], dtype: type) -> dict[str, NDArray[Any]]:
        return {name: np.zeros((samples, *((3, 3) if name == "S2" else (3,))), dtype) for name in outputs}

    upright, flat = HingePair(u1=plain.u1, u2=plain.u2, n=(0, 0, 1)), PlanarPair(u1=plain.u1[:2], u2=plain.u2[:2])
    planar_out = {name: np.zeros((samples, 2) if name in {"R2", "d", "v2"} else samples) for name in _PLANAR}

    def job(pair: HingePair, *motion: Any, outputs: tuple[str, ...] = names, dtype: type = np.float64) -> Job:
        out = room(outputs, dtype)
        return lambda: pair.forward_kinematics(*motion, outputs=outputs, out=out, backend=backend).arrays()

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
        "velocity in the plane": job(
            upright, (*columns[:3], zero, zero, *columns[5:]), (*rates[:3], zero, zero, *rates[5:])
        ),
        "turns about x and y, proven absent (E11)": job(
            upright, (*columns[:3], 0.0, 0.0, *columns[5:]), (*rates[:3], 0.0, 0.0, *rates[5:])
        ),
        "the third dimension (PlanarPair)": lambda: flat.forward_kinematics(
            (*columns[:2], *columns[5:]), (*rates[:2], *rates[5:]), outputs=_PLANAR, out=planar_out, backend=backend
        ).arrays(),
        "digits (float32)": job(
            plain, tuple(c.astype(np.float32) for c in columns), tuple(c.astype(np.float32) for c in rates),
            dtype=np.float32,
        ),
    }  # fmt: skip
