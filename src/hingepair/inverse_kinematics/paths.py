"""Paths: targets in order, each reached from the one before.

All solutions of the first target are followed at once. Where the last of them ends, at a limit or where the robot
would have to turn over, the path jumps, and all solutions of that target are followed from there. Of the branches,
the one that lasts longest is taken, so that there are as few jumps as the branches that were found allow. Paths of
redundant arms that jump are followed again: slowly towards the posture, then towards the middle of the limits, then
without a posture.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.inverse_kinematics.search import Solutions, Solver, Targets
from hingepair.numeric.arrays import Float64Array

_BRANCHES: Final = 16  # of a path, followed at once
_CHECKS: Final = (4, 2, 4, 10)  # steps to a sample; branches that have arrived after 4, 4 + 2, ... of them rest
_PULLS: Final = 1  # rounds towards a posture at each sample
_GENTLE: Final = 0.02  # of the way to a posture in a step, where the whole way led to a jump
_MAX_NUMBERS: Final = 20_000_000  # in the history of the branches that are followed at once


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
    q, steps, jumps = np.full((*shape, solver.dof), np.nan), np.zeros(shape, np.int64), np.zeros(shape, bool)
    size = max(1, _MAX_NUMBERS // (shape[1] * _BRANCHES * solver.dof))
    for first in range(0, shape[0], size):
        some = slice(first, first + size)
        branches = _Branches(solver, targets.at(rows[some].ravel()), rows[some].shape, max_change, seed)
        q[some], steps[some] = branches.run()
        jumps[some] = _jumps(q[some], max_change)
    middle = np.broadcast_to(solver.middle, (rows.size, solver.dof))
    others = (middle,) if targets.posture is None else (targets.posture, middle, None)
    # A redundant arm may drift into limits or singular poses that it can also go round.
    for posture in others if solver.redundant else ():
        jumping = np.flatnonzero(jumps.any(axis=1))
        for first in range(0, len(jumping), size):
            paths = jumping[first : first + size]
            again = rows[paths].ravel()
            part = targets.at(again) if posture is not None else targets.at(again)._replace(posture=None)
            branches = _Branches(solver, part, (len(paths), shape[1]), max_change, seed)
            if posture is not None:
                branches.attract(posture[again], _GENTLE)
            other, taken = branches.run()
            steps[paths] += taken
            jumps_then = _jumps(other, max_change)
            fewer = jumps_then.sum(axis=1) < jumps[paths].sum(axis=1)
            q[paths[fewer]], jumps[paths[fewer]] = other[fewer], jumps_then[fewer]
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


class _Branches:
    """Up to 16 solutions (branches) of each of some paths, followed side by side from sample to sample."""

    def __init__(
        self, solver: Solver, targets: Targets, shape: tuple[int, ...], max_change: float, seed: int
    ) -> None:
        self.solver, self.targets, self.max_change, self.seed = solver, targets, max_change, seed
        self.paths, self.samples = shape
        lanes = self.paths, _BRANCHES
        self.q = np.full((*lanes, solver.dof), np.nan)
        self.alive, self.travel = np.zeros(lanes, bool), np.zeros(lanes)
        self.history = np.full((self.samples, *lanes, solver.dof), np.nan)
        self.chosen = np.full((self.paths, self.samples, solver.dof), np.nan)
        self.begin = np.zeros(self.paths, np.int64)  # of the branches that are followed
        self.steps = np.zeros(shape, np.int64)
        self.last = np.full((self.paths, solver.dof), np.nan)  # the coordinates before that; NaN without any
        self.finite = np.logical_and.reduce(np.isfinite(targets.poses), axis=1)
        self.posture, self.share = targets.posture, 1.0  # what is approached from sample to sample, and how fast
        # One solution of each sample tells which are within reach.
        self.one = Solutions.nothing((len(targets.poses),), solver)
        some = targets.at(self.finite)._replace(posture=None)
        some = some if solver.holds else some._replace(near=None)
        found, self.steps.ravel()[self.finite], _ = solver.first(some, seed)
        self.one.put(self.finite, found)

    def attract(self, posture: Float64Array, share: float) -> None:
        """Approach another posture from sample to sample, by a share of the way in each step."""
        self.posture, self.share = posture, share

    def run(self) -> tuple[Float64Array, NDArray[np.int64]]:
        """Return the coordinates (P, N, dof), and the counts of steps (P, N)."""
        for i in range(self.samples):
            rows = np.arange(self.paths) * self.samples + i
            finite, within_reach = self.finite[rows], self.one.ok[rows]
            lasting = self._follow(i, rows, within_reach)
            lost = np.flatnonzero(finite & ~lasting)
            if len(lost):
                self._take_longest(lost, i)
                self._begin(lost, i, rows[lost])
            self.history[i] = np.where((self.alive & finite[:, None])[..., None], self.q, np.nan)
        self._take_longest(np.arange(self.paths), self.samples)
        return self.chosen, self.steps

    def _follow(self, i: int, rows: NDArray[np.int64], going: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Move the branches of the paths `going` to sample i, the targets in `rows`. Return which of these paths have
        branches that arrive; their other branches end.
        """
        path, branch = np.nonzero(self.alive & going[:, None])
        lasting = np.zeros(self.paths, bool)
        if not len(path):
            return lasting
        before, targets = self.q[path, branch], self.targets.at(rows[path])
        found, taken = self.solver.descend(before, targets, _CHECKS)
        np.add.at(self.steps[:, i], path, taken)
        if self.posture is not None:
            wanted = targets._replace(posture=self.posture[rows[path]])
            copy = found.at(np.arange(len(path)))  # a slice would be a view
            pulled = self.solver.pull(copy, wanted, _PULLS, self.share)
            near = (np.abs(pulled.q - before) <= self.max_change).all(axis=1)
            found.put(near, pulled.at(near))
        change = np.abs(found.q - before)
        there = found.ok & (change.max(axis=1) <= self.max_change)
        lasting[path[there]] = True
        ending = ~there & lasting[path]
        self.alive[path[ending], branch[ending]] = False
        path, branch = path[there], branch[there]
        self.q[path, branch] = found.q[there]
        self.travel[path, branch] += np.sqrt(np.square(change[there]).sum(axis=1))
        return lasting

    def _take_longest(self, paths: NDArray[np.int64], end: int) -> None:
        """Choose, for the samples before `end`, the branch that has moved least of those that have lasted."""
        best = np.where(self.alive[paths], self.travel[paths], np.inf).argmin(axis=1)
        for p, b in zip(paths, best, strict=True):
            if self.alive[p, b]:
                self.chosen[p, self.begin[p] : end] = self.history[self.begin[p] : end, p, b]
                self.last[p] = self.q[p, b]
            self.begin[p] = end

    def _begin(self, paths: NDArray[np.int64], i: int, rows: NDArray[np.int64]) -> None:
        """Begin branches at sample i, the targets in `rows`: at its solutions near the sample before, at all if none
        is near, at the closest pose if it is out of reach.
        """
        first = np.isnan(self.last[paths]).any(axis=1)
        near = self.solver.middle if self.targets.near is None else self.targets.near[rows]
        last = np.where(first[:, None], near, self.last[paths])
        found = Solutions.nothing((len(paths), _BRANCHES), self.solver)
        found.q[:, 0] = self.one.q[rows]  # the closest pose, where it is out of reach
        alive = np.zeros((len(paths), _BRANCHES), bool)
        alive[:, 0] = True
        within = self.one.ok[rows]
        if within.any():
            targets = self.targets.at(rows[within])._replace(near=last[within])
            some, taken, _ = self.solver.several(targets, _BRANCHES, self.seed)
            self.steps[paths[within], i] += taken
            found.put(within, some)
            alive[within] = some.ok
        change = np.abs(found.q - last[:, None]).max(axis=2)
        close = found.ok & (change <= self.max_change)
        alive = np.where((close.any(axis=1) & ~first)[:, None], close, alive)
        if self.targets.near is not None:  # a path starts at the solution nearest to q0
            alive[first, 1:] = False
        astray = ~found.ok[:, 0] & ~first
        if astray.any():  # the closest pose next to the one before
            alive[astray] = np.arange(_BRANCHES) == 0
            found.q[astray, 0] = self.solver.approached(last[astray], self.targets.at(rows[astray])).q
        self.q[paths], self.alive[paths] = found.q, alive
        self.travel[paths] = np.where(first[:, None] | ~alive, 0.0, change)
