"""`hingepair bench skip`: what leaving out what a scene does not need is worth, each against the whole program."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from hingepair.bench.measure import Job, Report, Tell, measured
from hingepair.bench.peers import CONSTANTS, LEVELS
from hingepair.pair.evaluate import count_operations
from hingepair.pair.forward_kinematics import plan_from_coordinates, plan_planar
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair

WHOLE = "nothing known"
OPERATIONS = "operations"

AnyPair: TypeAlias = HingePair | PlanarPair


def skip(samples: int, repeats: int, tell: Tell) -> Report:
    """Velocities with more and more known beforehand, by each backend."""
    rows, known = [], cases(samples)
    more = {name: {OPERATIONS: operations(*case)} for name, case in known.items()}
    for backend in ("compiled", "numpy"):
        tell(f"{backend}, N = {samples:,}: {len(known)} programs, {repeats} repeats")
        jobs = {name: _job(*case, backend) for name, case in known.items()}
        rows += measured(f"velocity, {backend}", jobs, repeats, samples, more=more)
    return Report(rows)


def operations(pair: AnyPair, motion: tuple[Any, ...], outputs: tuple[str, ...]) -> int:
    """How many a sample are left, those taken once for all samples not counted."""
    q, qd = (*motion, None)[:2]
    if isinstance(pair, PlanarPair):
        plan, given = plan_planar(pair.constants, q, qd, None, outputs, None)
    else:
        plan, given = plan_from_coordinates(pair.constants, q, qd, None, outputs, None, "XYZ")
    return count_operations(plan, pair.constants, given.parts).each


def cases(samples: int) -> dict[str, tuple[AnyPair, tuple[Any, ...], tuple[str, ...]]]:
    """What is known, and the pair, motion and outputs that say so."""
    rng = np.random.default_rng(21)
    q, qd = (tuple(np.ascontiguousarray(c) for c in part.T) for part in rng.normal(size=(2, samples, 7)))
    turned = HingePair(**CONSTANTS)
    plain = HingePair(**CONSTANTS | {"home": None})
    along = HingePair(**CONSTANTS | {"home": None, "n": [1, 0, 0]})
    flat = PlanarPair(u1=(0.5, 0.2), u2=(-0.25, 0.1))
    every = LEVELS["velocity"]
    still = (*q[:3], 0.1, 0.2, 0.3, q[6]), (*qd[:3], 0.0, 0.0, 0.0, qd[6])
    yawing = (*q[:3], 0.1, 0.2, *q[5:]), (*qd[:3], 0.0, 0.0, *qd[5:])
    upright = tuple((*c[:3], 0.0, 0.0, *c[5:]) for c in (q, qd))
    return {
        WHOLE: (turned, (q, qd), every),
        "home = identity": (plain, (q, qd), every),
        "axis along e_x": (along, (q, qd), every),
        "pose only": (turned, (q,), LEVELS["pose"]),
        "R2 alone": (turned, (q, qd), ("R2",)),
        "constant attitude of body 1": (turned, still, every),
        "constant phi_x and phi_y": (turned, yawing, every),
        "constant rates": (turned, (q, (1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 4.0)), every),
        "upright (phi_x = phi_y = 0, axis along e_z)": (flat.to_spatial(), upright, every),
        "PlanarPair": (flat, tuple((*c[:2], *c[5:]) for c in (q, qd)), ("R2", "phi2", "v2", "omega2")),
        "float32": (turned, tuple(tuple(c.astype(np.float32) for c in part) for part in (q, qd)), every),
    }


def _job(pair: AnyPair, motion: tuple[Any, ...], outputs: tuple[str, ...], backend: str) -> Job:
    """The program into arrays that are there."""
    state = pair.forward_kinematics(*motion, outputs=outputs, backend=backend)
    out = {name: np.array(state[name]) for name in outputs}
    return lambda: pair.forward_kinematics(*motion, outputs=outputs, out=out, backend=backend)
