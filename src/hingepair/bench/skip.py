"""`hingepair bench skip`: how much time folding saves: known inputs and unneeded outputs, beside the full program."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hingepair.bench.measure import Job, Report, make_rows, print_progress, time_interleaved
from hingepair.bench.peers import BENCH_PAIR_ARGUMENT_BY_NAME, OUTPUT_NAMES_BY_LEVEL
from hingepair.pair.evaluate import count_operations
from hingepair.pair.forward_kinematics import plan_from_coordinates
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.plans.plan import PLANAR_MOTION_KIND, SPATIAL_MOTION_KIND

UNFOLDED_CASE_NAME = "nothing known"  # name of the case without folding
OPERATION_COUNT_COLUMN_HEADING = "operations"  # heading of a column of the table


class FoldingCase(NamedTuple):
    """A call of `forward_kinematics` about which something is known in advance: constants of the pair, constant
    coordinates, or outputs that are not needed. `motion` is the tuple (q,) or (q, qd), each an array or a tuple of
    components; `outputs` is a tuple of names.
    """

    pair: HingePair | PlanarPair
    motion: tuple[Any, ...]
    outputs: tuple[str, ...] = OUTPUT_NAMES_BY_LEVEL["velocity"]

    def count_operations_left(self) -> int:
        """Return the number of operations for each sample that remain after folding. Operations that are done once
        for all samples do not count.
        """
        q, qd = (*self.motion, None)[:2]
        if isinstance(self.pair, PlanarPair):
            plan, arguments = plan_from_coordinates(
                PLANAR_MOTION_KIND, self.pair.constants, q, qd, None, self.outputs, None, None
            )
        else:
            plan, arguments = plan_from_coordinates(
                SPATIAL_MOTION_KIND, self.pair.constants, q, qd, None, self.outputs, None, "XYZ"
            )
        return count_operations(plan, self.pair.constants, arguments.parts).per_sample

    def make_job(self, backend: str) -> Job:
        """Return a job that computes the outputs by the named backend into existing arrays, and returns the PairState
        or PlanarState that holds them.
        """
        pair, motion, outputs = self
        state = pair.forward_kinematics(*motion, outputs=outputs, backend=backend)
        out = {name: np.array(state[name]) for name in outputs}
        return lambda: pair.forward_kinematics(*motion, outputs=outputs, out=out, backend=backend)


def measure_folding(samples: int, repeats: int) -> Report:
    """Measure run times of velocities of `samples` samples by each backend, `repeats` times, in cases with known
    inputs and in a case without known inputs. Return the Report, whose table also has the numbers of operations.
    """
    rows, folding_cases = [], make_folding_cases(samples)
    extra_columns = {
        name: {OPERATION_COUNT_COLUMN_HEADING: case.count_operations_left()} for name, case in folding_cases.items()
    }
    for backend in ("compiled", "numpy"):
        print_progress(f"{backend}, N = {samples:,}: {len(folding_cases)} programs, {repeats} repeats")
        jobs = {name: case.make_job(backend) for name, case in folding_cases.items()}
        rows += make_rows(
            f"velocity, {backend}", time_interleaved(jobs, repeats), samples, extra_columns=extra_columns
        )
    return Report(rows)


def make_folding_cases(samples: int) -> dict[str, FoldingCase]:
    """Return a dict from a name to a FoldingCase of `samples` random samples. The name says what is known about the
    inputs; in the first case nothing is known.
    """
    rng = np.random.default_rng(21)
    q, qd = (tuple(np.ascontiguousarray(c) for c in part.T) for part in rng.normal(size=(2, samples, 7)))
    turned = HingePair(**BENCH_PAIR_ARGUMENT_BY_NAME)
    plain = HingePair(**BENCH_PAIR_ARGUMENT_BY_NAME | {"home": None})
    along = HingePair(**BENCH_PAIR_ARGUMENT_BY_NAME | {"home": None, "n": [1, 0, 0]})
    flat = PlanarPair(u1=(0.5, 0.2), u2=(-0.25, 0.1))
    still = (*q[:3], 0.1, 0.2, 0.3, q[6]), (*qd[:3], 0.0, 0.0, 0.0, qd[6])
    yawing = (*q[:3], 0.1, 0.2, *q[5:]), (*qd[:3], 0.0, 0.0, *qd[5:])
    upright = tuple((*c[:3], 0.0, 0.0, *c[5:]) for c in (q, qd))
    return {
        UNFOLDED_CASE_NAME: FoldingCase(turned, (q, qd)),
        "home = identity": FoldingCase(plain, (q, qd)),
        "axis along e_x": FoldingCase(along, (q, qd)),
        "pose only": FoldingCase(turned, (q,), OUTPUT_NAMES_BY_LEVEL["pose"]),
        "R2 alone": FoldingCase(turned, (q, qd), ("R2",)),
        "constant attitude of body 1": FoldingCase(turned, still),
        "constant phi_x and phi_y": FoldingCase(turned, yawing),
        "constant rates": FoldingCase(turned, (q, (1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 4.0))),
        "upright (phi_x = phi_y = 0, axis along e_z)": FoldingCase(flat.to_spatial(), upright),
        "PlanarPair": FoldingCase(flat, tuple((*c[:2], *c[5:]) for c in (q, qd)), ("R2", "phi2", "v2", "omega2")),
        "float32": FoldingCase(turned, tuple(tuple(c.astype(np.float32) for c in part) for part in (q, qd))),
    }
