"""`hingepair bench skip`: how much time folding saves: known inputs and unneeded outputs, beside the full program."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hingepair.bench.direct import LEVELS, PAIR_ARGUMENTS
from hingepair.bench.harness import Case, Job, Report, measure
from hingepair.pair.computations import computation_of, read_rows
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.plans.plan import PLANAR_MOTION_KIND, SPATIAL_MOTION_KIND


class Folding(NamedTuple):
    """A call of `forward_kinematics` of which something is known in advance."""

    pair: HingePair | PlanarPair
    motion: tuple[Any, ...]  # q, or q and qd: arrays or tuples of components
    outputs: tuple[str, ...] = LEVELS["velocity"]

    def operations(self) -> int:
        """Return the operations for each sample that folding leaves."""
        is_planar = isinstance(self.pair, PlanarPair)
        kind, sequence = (PLANAR_MOTION_KIND, None) if is_planar else (SPATIAL_MOTION_KIND, "XYZ")
        computation = computation_of(kind, self.pair.constants, self.outputs, sequence)
        return computation.count_operations(read_rows(kind, *self.motion).values).per_sample

    def job(self, backend: str) -> Job:
        """Return the job of the call, into existing arrays."""
        pair, motion, outputs = self
        state = pair.forward_kinematics(*motion, outputs=outputs, backend=backend)
        out = {name: np.array(state[name]) for name in outputs}
        return lambda: pair.forward_kinematics(*motion, outputs=outputs, out=out, backend=backend)


def bench_skip(samples: int, repeats: int) -> Report:
    """Measure velocities of so many samples by each backend, in each case of what is known."""
    foldings = make_foldings(samples)
    columns = {name: {"operations": folding.operations()} for name, folding in foldings.items()}
    cases = (
        Case(
            f"velocity, {backend}",
            {name: folding.job(backend) for name, folding in foldings.items()},
            samples,
            columns=columns,
        )
        for backend in ("compiled", "numpy")
    )
    return Report(measure(cases, repeats))


def make_foldings(samples: int) -> dict[str, Folding]:
    """Return calls of random samples by what is known of them; of the first, nothing is."""
    rng = np.random.default_rng(21)
    q, qd = (tuple(np.ascontiguousarray(c) for c in part.T) for part in rng.normal(size=(2, samples, 7)))
    turned = HingePair(**PAIR_ARGUMENTS)
    plain = HingePair(**PAIR_ARGUMENTS | {"home": None})
    along = HingePair(**PAIR_ARGUMENTS | {"home": None, "n": [1, 0, 0]})
    flat = PlanarPair(u1=(0.5, 0.2), u2=(-0.25, 0.1))
    still = (*q[:3], 0.1, 0.2, 0.3, q[6]), (*qd[:3], 0.0, 0.0, 0.0, qd[6])
    yawing = (*q[:3], 0.1, 0.2, *q[5:]), (*qd[:3], 0.0, 0.0, *qd[5:])
    upright = tuple((*c[:3], 0.0, 0.0, *c[5:]) for c in (q, qd))
    return {
        "nothing known": Folding(turned, (q, qd)),
        "home = identity": Folding(plain, (q, qd)),
        "axis along e_x": Folding(along, (q, qd)),
        "pose only": Folding(turned, (q,), LEVELS["pose"]),
        "R2 alone": Folding(turned, (q, qd), ("R2",)),
        "constant attitude of body 1": Folding(turned, still),
        "constant phi_x and phi_y": Folding(turned, yawing),
        "constant rates": Folding(turned, (q, (1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 4.0))),
        "upright (phi_x = phi_y = 0, axis along e_z)": Folding(flat.to_spatial(), upright),
        "PlanarPair": Folding(flat, tuple((*c[:2], *c[5:]) for c in (q, qd)), ("R2", "phi2", "v2", "omega2")),
        "float32": Folding(turned, tuple(tuple(c.astype(np.float32) for c in part) for part in (q, qd))),
    }
