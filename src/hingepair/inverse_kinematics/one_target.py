"""The search for one target at a time, from coordinates near it, for control loops."""

from __future__ import annotations

from typing import Final

import numpy as np

from hingepair.inverse_kinematics.search import Solutions, Solver, Targets
from hingepair.numeric.arrays import Float64Array

_STEPS: Final = 25  # from q0; beyond, other starts are tried
_PULLS: Final = 12  # steps that also approach a posture
_AT_REST: Final = 1e-6  # rad or m; a step towards a posture that changes less is the last


def solve_one(
    solver: Solver,
    pose: Float64Array,
    q0: Float64Array,
    posture: Float64Array | None,
    tolerances: tuple[float, float],
    seed: int,
) -> tuple[Solutions, int, int]:
    """Return the solution of one target that steps from q0 lead to, or else what `Solver.first` finds; and the counts
    of steps and of starts. Arrays have no axis of targets.
    """
    if not np.isfinite(pose).all():
        return Solutions.nothing((1,), solver), 0, 0
    near = None if posture is None else posture[None]
    targets = Targets(pose[None], q0[None], near, *tolerances)
    ends, steps = _steps_from(solver, q0, targets)
    if ends.ok[0]:
        return ends, steps, 1
    ends, more, starts = solver.first(targets._replace(posture=None), seed)
    steps += int(more[0])
    if posture is not None and ends.ok[0]:
        nearer, more_steps = _steps_from(solver, ends.q[0], targets)
        return (nearer if nearer.ok[0] else ends), steps + more_steps, int(starts[0])
    return ends, steps, int(starts[0])


def _steps_from(solver: Solver, q0: Float64Array, targets: Targets) -> tuple[Solutions, int]:
    """Return where steps from q0 lead, first also towards the posture, and their count."""
    plain, pulling, pose = targets.options(), targets.options(pull=1.0), targets.poses[0]
    q, steps = np.minimum(np.maximum(q0, solver.low), solver.high), 0
    if targets.posture is not None:
        for _ in range(_PULLS):
            before, q = q, solver.step_to_posture(q, pose, pulling, targets.posture[0])["q_new"]
            steps += 1
            if np.abs(q - before).max() < _AT_REST:
                break
    for _ in range(_STEPS):
        found = solver.step(q, pose, plain)
        q, unmet = found["q_new"], found["unmet"]
        steps += 1
        if unmet == 0:
            break
    return solver.measure(q[None], targets), steps
