"""`hingepair bench skip`: what leaving out what a scene does not need is worth, each against the whole program."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hingepair.bench.measure import Job, Report, interleaved, rows_of, tell
from hingepair.bench.peers import CONSTANTS, LEVELS
from hingepair.pair.evaluate import count_operations
from hingepair.pair.forward_kinematics import plan_from_coordinates
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.plans.plan import PLANAR, SPATIAL

WHOLE = "nothing known"
OPERATIONS = "operations"


class Case(NamedTuple):
    """What is known: the pair, motion and outputs that say so."""

    pair: HingePair | PlanarPair
    motion: tuple[Any, ...]
    outputs: tuple[str, ...] = LEVELS["velocity"]

    def operations(self) -> int:
        """How many a sample are left, those taken once for all samples not counted."""
        q, qd = (*self.motion, None)[:2]
        if isinstance(self.pair, PlanarPair):
            plan, given = plan_from_coordinates(PLANAR, self.pair.constants, q, qd, None, self.outputs, None, None)
        else:
            plan, given = plan_from_coordinates(SPATIAL, self.pair.constants, q, qd, None, self.outputs, None, "XYZ")
        return count_operations(plan, self.pair.constants, given.parts).per_sample

    def job(self, backend: str) -> Job:
        """The program into arrays that are there."""
        pair, motion, outputs = self
        state = pair.forward_kinematics(*motion, outputs=outputs, backend=backend)
        out = {name: np.array(state[name]) for name in outputs}
        return lambda: pair.forward_kinematics(*motion, outputs=outputs, out=out, backend=backend)


def skip(samples: int, repeats: int) -> Report:
    """Velocities with more and more known beforehand, by each backend."""
    rows, known = [], cases(samples)
    more = {name: {OPERATIONS: case.operations()} for name, case in known.items()}
    for backend in ("compiled", "numpy"):
        tell(f"{backend}, N = {samples:,}: {len(known)} programs, {repeats} repeats")
        jobs = {name: case.job(backend) for name, case in known.items()}
        rows += rows_of(f"velocity, {backend}", interleaved(jobs, repeats), samples, more=more)
    return Report(rows)


def cases(samples: int) -> dict[str, Case]:
    """What is known, by its name."""
    rng = np.random.default_rng(21)
    q, qd = (tuple(np.ascontiguousarray(c) for c in part.T) for part in rng.normal(size=(2, samples, 7)))
    turned = HingePair(**CONSTANTS)
    plain = HingePair(**CONSTANTS | {"home": None})
    along = HingePair(**CONSTANTS | {"home": None, "n": [1, 0, 0]})
    flat = PlanarPair(u1=(0.5, 0.2), u2=(-0.25, 0.1))
    still = (*q[:3], 0.1, 0.2, 0.3, q[6]), (*qd[:3], 0.0, 0.0, 0.0, qd[6])
    yawing = (*q[:3], 0.1, 0.2, *q[5:]), (*qd[:3], 0.0, 0.0, *qd[5:])
    upright = tuple((*c[:3], 0.0, 0.0, *c[5:]) for c in (q, qd))
    return {
        WHOLE: Case(turned, (q, qd)),
        "home = identity": Case(plain, (q, qd)),
        "axis along e_x": Case(along, (q, qd)),
        "pose only": Case(turned, (q,), LEVELS["pose"]),
        "R2 alone": Case(turned, (q, qd), ("R2",)),
        "constant attitude of body 1": Case(turned, still),
        "constant phi_x and phi_y": Case(turned, yawing),
        "constant rates": Case(turned, (q, (1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 4.0))),
        "upright (phi_x = phi_y = 0, axis along e_z)": Case(flat.to_spatial(), upright),
        "PlanarPair": Case(flat, tuple((*c[:2], *c[5:]) for c in (q, qd)), ("R2", "phi2", "v2", "omega2")),
        "float32": Case(turned, tuple(tuple(c.astype(np.float32) for c in part) for part in (q, qd))),
    }
