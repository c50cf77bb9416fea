"""Paths: targets in order, each reached from the one before.

All solutions of the first target are followed side by side. Where one cannot go on, at a limit or where the robot
would have to turn over, it jumps to the solution next to it. Of the branches, one with the fewest jumps is taken, and
of these the one that moves least. Paths of redundant arms that jump are followed again: slowly towards the posture,
then towards the middle of the limits, then without a posture.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.inverse_kinematics.search import Solutions, Solver, Targets
from hingepair.numeric.arrays import Float64Array

_BRANCHES: Final = 16  # of a path, followed at once
_CHECKS: Final = (4, 2, 4, 10)  # steps to a sample; branches that have arrived after 4, 4 + 2, ... of them rest
_PULLS: Final = 1  # rounds towards a posture at each sample
_GENTLE: Final = 0.02  # of the way to a posture in a step, where the whole way led to a jump
_MAX_NUMBERS: Final = 20_000_000  # in the branches that are followed at once


class Path(NamedTuple):
    """P paths of N samples."""

    found: Solutions  # (P, N, ...)
    jumps: NDArray[np.bool_]  # (P, N)
    steps: NDArray[np.int64]  # (P, N)


def follow(solver: Solver, targets: Targets, shape: tuple[int, int], max_change: float, seed: int) -> Path:
    """Return the coordinates along paths of targets, with as few jumps as the branches found allow.

    Args:
        solver: the solver of the robot.
        targets: those of all samples, path after path; `near` is where a path starts.
        shape: number of paths, and of samples of each.
        max_change: greatest change of a coordinate from one sample to the next that is no jump [rad or m].
        seed: seed of the starts.
    """
    rows = np.arange(shape[0] * shape[1]).reshape(shape)
    q, steps, jumps = np.full((*shape, solver.dof), np.nan), np.zeros(shape, np.int64), np.ones(shape, bool)
    middle = np.broadcast_to(solver.middle, (rows.size, solver.dof))
    # A redundant arm may drift into limits or singular poses that it can also go round.
    gentle = [(targets.posture, _GENTLE)] if targets.posture is not None else []
    more = [*gentle, (middle, _GENTLE), *([(None, 1.0)] if gentle else [])] if solver.redundant else []
    size = max(1, _MAX_NUMBERS // (shape[1] * _BRANCHES * solver.dof))
    for posture, share in ((targets.posture, 1.0), *more):
        jumping = np.flatnonzero(jumps.any(axis=1))
        for first in range(0, len(jumping), size):
            paths = jumping[first : first + size]
            again = rows[paths].ravel()
            part = targets.at(again)._replace(posture=None if posture is None else posture[again])
            other, taken = _followed(solver, part, (len(paths), shape[1]), max_change, seed, share)
            steps[paths] += taken
            then = _jumps(other, max_change)
            fewer = (then.sum(axis=1) < jumps[paths].sum(axis=1)) | np.isnan(q[paths]).all(axis=(1, 2))
            q[paths[fewer]], jumps[paths[fewer]] = other[fewer], then[fewer]
    flat, found = q.reshape(-1, solver.dof), Solutions.nothing((rows.size,), solver)
    finite = np.flatnonzero(np.isfinite(flat).all(axis=1))
    if len(finite):
        found.put(finite, solver.measure(flat[finite], targets.at(finite)))
    return Path(found.reshape(*shape), jumps, steps)


def _jumps(q: Float64Array, max_change: float) -> NDArray[np.bool_]:
    """Return at which samples of paths (P, N, dof) a coordinate has changed by more than `max_change`."""
    jumps, last = np.zeros(q.shape[:2], bool), q[:, 0]
    for i in range(1, q.shape[1]):
        with np.errstate(invalid="ignore"):
            jumps[:, i] = (np.abs(q[:, i] - last) > max_change).any(axis=1)
        last = np.where(np.isnan(q[:, i]), last, q[:, i])
    return jumps


def _followed(
    solver: Solver, targets: Targets, shape: tuple[int, int], max_change: float, seed: int, share: float
) -> tuple[Float64Array, NDArray[np.int64]]:
    """Return the coordinates (P, N, dof) of the best branch of each of some paths, and the counts of steps (P, N). A
    posture is approached from sample to sample, by a share of the way in each step.
    """
    paths, samples = shape
    lanes = paths, _BRANCHES
    q, (reached, steps) = np.full((samples, *lanes, solver.dof), np.nan), _within_reach(solver, targets, shape, seed)
    last, alive = np.full((*lanes, solver.dof), np.nan), np.zeros(lanes, bool)
    jumps, travel = np.zeros(lanes, np.int64), np.zeros(lanes)
    finite = np.asarray(np.isfinite(targets.poses).all(axis=1)).reshape(shape)
    for i in range(samples):
        rows, arrived = np.arange(paths) * samples + i, np.zeros(paths, bool)
        path, branch = np.nonzero(alive & reached[:, i, None])
        if len(path):
            before, part = last[path, branch], targets.at(rows[path])
            found, taken = solver.descend(before, part, _CHECKS)
            np.add.at(steps[:, i], path, taken)
            if targets.posture is not None:
                pulled = solver.pull(found.at(np.arange(len(path))), part, _PULLS, share)  # of a copy
                near = np.abs(pulled.q - before).max(axis=1) <= max_change
                found.put(near, pulled.at(near))
            change = np.abs(found.q - before)
            there = found.ok & (change.max(axis=1) <= max_change)
            arrived[path[there]] = True
            ending = ~there & arrived[path]
            alive[path[ending], branch[ending]] = False
            last[path[there], branch[there]] = found.q[there]
            travel[path[there], branch[there]] += np.sqrt(np.square(change[there]).sum(axis=1))
        stuck = np.flatnonzero(finite[:, i] & ~arrived)
        if len(stuck):  # all go on from the best branch: with its solutions, or else the closest pose
            best = np.where(alive, travel, np.inf)[stuck].argmin(axis=1)
            was, part = last[stuck, best], targets.at(rows[stuck])
            first = np.isnan(was).any(axis=1)
            part = part._replace(
                near=np.where(first[:, None], solver.middle if part.near is None else part.near, was)
            )
            found = Solutions.nothing((len(stuck), _BRANCHES), solver)
            solved = first | reached[stuck, i]
            if solved.any():
                some, taken, _ = solver.several(part.at(solved), _BRANCHES, seed)
                found.put(solved, some)
                steps[stuck[solved], i] += taken
            if not solved.all():
                found.put((~solved, 0), solver.approached(was[~solved], part.at(~solved)))
            change = np.where(first[:, None, None], 0.0, np.abs(found.q - was[:, None]))
            q[:i, stuck] = q[:i, stuck, best][:, :, None]
            jumps[stuck] = jumps[stuck, best][:, None] + (change.max(axis=2) > max_change)
            travel[stuck] = travel[stuck, best][:, None] + np.sqrt(np.square(change).sum(axis=2))
            known = np.isfinite(found.q).all(axis=2)
            fewest = np.where(known, jumps[stuck], samples).min(axis=1, keepdims=True)
            alive[stuck], last[stuck] = known & (jumps[stuck] == fewest), found.q
            if targets.near is not None:  # a path starts at the solution nearest to q0
                alive[stuck[first], 1:] = False
        q[i] = np.where((alive & finite[:, i, None])[..., None], last, np.nan)
    best = np.where(alive, travel, np.inf).argmin(axis=1)
    return np.swapaxes(q[:, np.arange(paths), best], 0, 1), steps


def _within_reach(solver: Solver, targets: Targets, shape: tuple[int, int], seed: int) -> tuple[Any, Any]:
    """Return which samples of paths are within reach, and the counts of steps that tell so; (P, N) each."""
    finite = np.asarray(np.isfinite(targets.poses).all(axis=1))
    reached, steps = np.zeros(len(finite), bool), np.zeros(len(finite), np.int64)
    some = targets.at(finite)._replace(posture=None)
    found, steps[finite], _ = solver.first(some if solver.holds else some._replace(near=None), seed)
    reached[finite] = found.ok
    return reached.reshape(shape), steps.reshape(shape)
