"""The search for coordinates that reach targets, many targets at a time.

A trial begins at some coordinates and takes steps until the errors are within the tolerances, or up to a fixed
number. What happens in a trial depends on nothing but the target and the trial's number, and the trials of a target
are judged together: so a target gets the same bits in any batch.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.calls import Call
from hingepair.engine.results import Results
from hingepair.inverse_kinematics.goals import Goal, off_axis
from hingepair.inverse_kinematics.starts import PER_SHARE, Starts
from hingepair.inverse_kinematics.steps import Problem, measure_loop, shifts_by_column, slide_loop, step_loop
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.plans.trees import Form, TreeRequest

MAX_TRIALS: Final = 64  # of a target, and so the most solutions that it can have
_ROUNDS: Final = (0, 1, 2, 4, 8, 16, 32, 64)  # numbers of trials after which solved targets rest
_DIVERSE: Final = 8  # starts of which a trial takes the nearest where several solutions are wanted; else PER_SHARE
_CHECKS: Final = (5, 3, 4, 8)  # steps of a trial; targets solved after 5, 5 + 3, ... of them rest
_LANES: Final = 4096  # trials at a time, whose arrays stay in the cache of a core
_CLOSE_TRIALS: Final = 16  # of the search for the closest pose, where no trial led to a solution
_CLOSE_STEPS: Final = 60  # of each of these trials
_LAST_STEPS: Final = 200  # further steps from the best of these trials to the closest pose
_PULLS: Final = 40  # rounds of the approach to a posture
_PULL_STEPS: Final = 4  # of each round towards the posture
_LAST_PULLS: Final = 3  # further steps of a round without the posture, which bring the errors back
_STEPS_OF_ONE: Final = 25  # of a single target from q0; beyond, other starts are tried
_PULLS_OF_ONE: Final = 12  # of these, the first, that also approach a posture
_ROUNDS_OF_ONE: Final = (0, 1, 2, 4, 8, 16)  # numbers of other starts after which a solution ends its search
_AT_REST: Final = 1e-6  # rad or m; a step towards a posture that changes less is the last
_DISTINCT: Final = 1e-3  # rad, or m; solutions that differ by less are one
_TURN: Final = 2 * np.pi

Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]


class Targets(NamedTuple):
    """Poses that N targets prescribe, tolerances, and to which coordinates solutions are to be near."""

    poses: Float64Array  # (N, numbers of a target)
    near: Float64Array | None  # coordinates of the first trial (N, dof), to which solutions are near
    posture: Float64Array | None  # (N, dof), taken as far as it leaves the frames where they are
    position_tolerance: float  # m
    angle_tolerance: float  # rad

    def at(self, index: Any) -> Targets:
        """Return some of them."""
        near, posture = (None if one is None else one[index] for one in (self.near, self.posture))
        return self._replace(poses=self.poses[index], near=near, posture=posture)

    def options(self, caution: float = 0.0, pull: float = 0.0) -> Float64Array:
        """Return the numbers `steps.OPTIONS`, with tolerances in the form that programs compare."""
        angle = self.angle_tolerance
        limit = 3.0 if angle >= math.pi else float(off_axis(math.sin(angle), math.cos(angle)))
        return np.array((caution, *np.nextafter((self.position_tolerance, limit), np.inf), pull))


class Solutions(NamedTuple):
    """Coordinates with their errors for N targets, or (N, ...): ends of trials, or those chosen, NaN without any."""

    q: Float64Array  # (N, dof)
    errors: Float64Array  # (N, goals): distances [m] and angles [rad]
    ok: Booleans  # (N,)

    @classmethod
    def nothing(cls, shape: tuple[int, ...], solver: Solver) -> Solutions:
        """Return NaN for a shape of targets."""
        errors = np.full((*shape, len(solver.goals)), np.nan)
        return cls(np.full((*shape, solver.dof), np.nan), errors, np.zeros(shape, bool))

    def at(self, index: Any) -> Solutions:
        """Return copies of some of them."""
        return Solutions(self.q[index], self.errors[index], self.ok[index])

    def put(self, index: Any, other: Solutions) -> None:
        """Replace some of them."""
        self.q[index], self.errors[index], self.ok[index] = other

    def reshape(self, *shape: int) -> Solutions:
        """Return them in another shape."""
        errors = self.errors.reshape(*shape, self.errors.shape[-1])
        return Solutions(self.q.reshape(*shape, self.q.shape[-1]), errors, self.ok.reshape(shape))


class Solver:
    """Solver of the inverse kinematics of some frames of a robot, for any targets.

    Args:
        form: structure of the robot.
        request: request of the frames.
        constants: the numbers of the robot and the frames.
        goals: what the frames are to reach.
        limits: least and greatest coordinates, shape (dof, 2).
        reaches: for each goal, the stretched length of the chain that carries its frame [m].
        weights: for each goal, what a metre or a radian of its error counts where not all can vanish.
        held: columns of coordinates that stay where a trial begins near the target.
    """

    def __init__(
        self,
        form: Form,
        request: TreeRequest,
        constants: Float64Array,
        goals: tuple[Goal, ...],
        limits: Float64Array,
        reaches: tuple[float, ...],
        weights: Sequence[float],
        held: tuple[int, ...] = (),
    ) -> None:
        self.dof = form.dof
        self.low, self.high = np.ascontiguousarray(limits.T)
        self.goals, self._reaches = goals, reaches
        shifts = np.array(shifts_by_column(form))
        self._shifts = shifts > 0
        if form.closure is None:
            self._moving = np.isin(np.arange(form.dof), [*_columns_that_move(goals, form, request)])
            # A coordinate that also drives a mimic joint is not the same after a turn.
            self._turns = (np.bincount(form.columns, minlength=form.dof) == 1) & ~self._shifts
        else:  # loops may let every coordinate move every frame
            self._moving = np.ones(form.dof, bool)
            self._turns = ~self._shifts
        self._moving[[*held]] = False
        self.holds = bool(held)
        self.redundant = int(self._moving.sum()) > sum(goal.rank for goal in goals)
        sizes = [reach if goal.is_length else 1.0 for goal, reach in zip(goals, reaches, strict=True)]
        self._weights = np.array(weights, np.float64) / max(np.multiply(weights, sizes))
        bounded = bool(np.isfinite(limits[self._moving]).any())
        self._problem = Problem(form, request, goals, bounded, len(constants), held)
        self._known = {"constants": constants, "weights": self._weights, "low": self.low, "high": self.high}
        self._measure_call = self._call(measure_loop(self._problem))
        self._step_call = self._call(step_loop(self._problem, False))
        finite = np.isfinite(self.low) & np.isfinite(self.high)
        halves = np.where(finite, self.low, 0.0) / 2 + np.where(finite, self.high, 0.0) / 2
        self.middle = np.clip(halves, self.low, self.high)
        # Random starts reach half a turn to each side of the middle where a turn changes nothing, else a whole one,
        # and as far as the robot itself where a coordinate shifts.
        shifting = 2 * max(reaches) / np.where(self._shifts, shifts, 1.0)
        width = np.where(self._turns, _TURN / 2, np.where(self._shifts, shifting, _TURN))
        low = np.maximum(self.low, self.middle - width)
        high = np.minimum(self.high, low + 2 * width)
        low = np.maximum(self.low, high - 2 * width)
        far = self._moving & self._shifts & ((self.low < low) | (self.high > high))
        self._slide_call = None  # of those that may have to go farther
        if far.any() and any(goal.is_length for goal in goals):
            self._slide_call = self._call(slide_loop(self._problem, tuple(np.flatnonzero(far).tolist())))
        self._box = np.where(self._moving, low, self.middle), np.where(self._moving, high, self.middle)
        self._starts: dict[int, Starts] = {}

    def _call(self, loop: Any) -> Call:
        shapes = {name: tail for name, tail in loop.inputs if name not in self._known}
        known = {name: self._known[name] for name, _ in loop.inputs if name in self._known}
        return Call(loop, shapes, known, Results, backend="compiled", constants_name="robot")

    @lock_free_cached_property
    def _pull_call(self) -> Call:
        """Step that also moves towards a posture."""
        return self._call(step_loop(self._problem, True))

    def starts(self, seed: int) -> Starts:
        """Return the starts of a seed, within the limits and around their middle; only those of the last are kept."""
        found = self._starts.get(seed)
        if found is None:
            found = Starts(self._measure_call, self.goals, self._reaches, *self._box, seed)
            self._starts = {seed: found}
        return found

    # ---- one solution of each target

    def first(self, targets: Targets, seed: int) -> tuple[Solutions, Integers, Integers]:
        """Return for each target the solution of the first trial that leads to one, or the closest pose found; and
        the counts of steps and starts.
        """
        found, steps, starts = self.tried(targets, seed)
        for at in _pieces(np.flatnonzero(~found.ok), max(1, _LANES // _CLOSE_TRIALS)):
            ends, taken = self._closest(targets.at(at), seed)
            found.put(at, ends)
            steps[at] += taken
        return found, steps, starts

    def tried(
        self, targets: Targets, seed: int, rounds: Sequence[int] = _ROUNDS
    ) -> tuple[Solutions, Integers, Integers]:
        """Return what `first` does, without closest poses; `rounds` are numbers of trials after which solved targets
        rest.
        """
        count = len(targets.poses)
        found = Solutions.nothing((count,), self)
        steps, starts = np.zeros(count, np.int64), np.zeros(count, np.int64)
        left = np.arange(count)
        for first, end in itertools.pairwise(rounds):
            for at in _pieces(left, max(1, _LANES // (end - first))):
                ends, taken = self._trials(targets.at(at), range(first, end), PER_SHARE, seed)
                best = ends.ok.argmax(axis=1)  # the first of those that are True
                found.put(at, ends.at((np.arange(len(at)), best)))
                steps[at] += taken
                starts[at] = end
            left = left[~found.ok[left]]
        return found, steps, starts

    # ---- one target, from coordinates near it, for control loops

    def one(self, targets: Targets, q0: Float64Array, seed: int) -> tuple[Solutions, int, int]:
        """Return the solution of one target that steps from q0 lead to, or else another start, or else the closest
        pose next to where the steps from q0 lead; and the counts of steps and of starts.
        """
        if not np.isfinite(targets.poses).all():
            return Solutions.nothing((1,), self), 0, 0
        ends, steps = self._steps_from(q0, targets)
        if ends.ok[0]:
            return ends, steps, 1
        found, more, starts = self.tried(targets._replace(posture=None), seed, _ROUNDS_OF_ONE)
        steps += int(more[0])
        if not found.ok[0]:
            return self.approached(ends.q, targets), steps, int(starts[0])
        if targets.posture is not None:
            nearer, pulls = self._steps_from(found.q[0], targets)
            found, steps = nearer if nearer.ok[0] else found, steps + pulls
        return found, steps, int(starts[0])

    def _steps_from(self, q0: Float64Array, targets: Targets) -> tuple[Solutions, int]:
        """Return where steps from q0 lead, first also towards the posture, and their count."""
        plain, pulling, pose = targets.options(), targets.options(pull=1.0), targets.poses[0]
        q, steps = np.minimum(np.maximum(q0, self.low), self.high), 0
        if targets.posture is not None:
            for _ in range(_PULLS_OF_ONE):
                before, q = q, self._pull_call.rows(q, pose, pulling, targets.posture[0])["q_new"]
                steps += 1
                if np.abs(q - before).max() < _AT_REST:
                    break
        for _ in range(_STEPS_OF_ONE):
            found = self._step_call.rows(q, pose, plain)
            q, unmet = found["q_new"], found["unmet"]
            steps += 1
            if unmet == 0:
                break
        return self.measure(q[None], targets), steps

    # ---- several solutions of each target

    def several(self, targets: Targets, count: int, seed: int) -> tuple[Solutions, Integers, Integers]:
        """Return up to `count` solutions of each target, those nearest to `targets.near` first; without one, the
        closest pose found. What was not found is NaN. Return the counts of steps and starts, too.
        """
        size = len(targets.poses)
        found = Solutions.nothing((size, count), self)
        steps = np.zeros(size, np.int64)
        for at in _pieces(np.arange(size), 4 * _LANES // MAX_TRIALS):
            part = targets.at(at)
            ends, steps[at] = self._trials(part, range(MAX_TRIALS), _DIVERSE, seed)
            chosen = self._nearest(ends, self._centre(part), count)
            missed = ~chosen.ok[:, 0]
            if missed.any():
                closest, taken = self._closest(part.at(missed), seed)
                chosen.put((missed, 0), closest)
                steps[at[missed]] += taken
            found.put(at, chosen)
        return found, steps, np.full(size, MAX_TRIALS)

    def _nearest(self, ends: Solutions, centre: Float64Array, count: int) -> Solutions:
        """Return `count` distinct solutions of each target, the nearest first."""
        rows = np.arange(len(ends.q))
        distance = np.where(ends.ok, _sum_of_squares(ends.q - centre[:, None]), np.inf)
        order = np.argsort(distance, axis=1, kind="stable")
        chosen = Solutions.nothing((len(ends.q), count), self)
        place = np.zeros(len(ends.q), np.int64)
        for k in range(MAX_TRIALS):
            one = ends.at((rows, order[:, k]))
            same = np.abs(chosen.q - one.q[:, None]).max(axis=2) < _DISTINCT
            new = np.flatnonzero(one.ok & ~np.logical_or.reduce(same, axis=1) & (place < count))
            if not one.ok.any():
                break
            chosen.put((new, place[new]), one.at(new))
            place[new] += 1
        return chosen

    # ---- trials

    def _trials(self, targets: Targets, trials: range, among: int, seed: int) -> tuple[Solutions, Integers]:
        """Return the ends of these trials of N targets, (N, trials), and each target's count of steps in them all."""
        starts = [self._start(targets, k, among, seed) for k in trials]
        shape = len(targets.poses), len(trials)
        lanes = targets if len(trials) == 1 else targets.at(np.repeat(np.arange(shape[0]), shape[1]))
        ends, steps = self.descend(np.stack(starts, axis=1).reshape(-1, self.dof), lanes, near=self._centre(lanes))
        return self.pull(ends, lanes).reshape(*shape), steps.reshape(shape).sum(axis=1)

    def _start(self, targets: Targets, trial: int, among: int, seed: int) -> Float64Array:
        """Return where a trial begins: near the target or, for trial 0, at `near`. Joints that move no frame stand
        where they are to stay.
        """
        starts = self.starts(seed)
        if targets.near is None and targets.posture is None:
            return self._slid(starts.nearest(targets.poses, trial, among), targets)
        own = np.clip(self._centre(targets), self.low, self.high)
        if targets.near is not None:
            trial -= 1
        start = own
        if trial >= 0:
            start = np.where(self._moving, starts.nearest(targets.poses, trial, among), own)
        if targets.posture is not None:
            start = np.where(self._moving, start, np.clip(targets.posture, self.low, self.high))
        return start if trial < 0 else self._slid(start, targets)

    def _slid(self, start: Float64Array, targets: Targets) -> Float64Array:
        """Return random starts, moved towards targets by joints that shift farther than starts are drawn."""
        if self._slide_call is None:
            return start
        slid: Float64Array = np.clip(self._slide_call.rows(start, targets.poses)["q_new"], self.low, self.high)
        return slid

    def _centre(self, targets: Targets) -> Float64Array:
        """Return the coordinates to which solutions are to be near."""
        if targets.near is not None:
            return targets.near
        if targets.posture is not None:
            return targets.posture
        return np.broadcast_to(self.middle, (len(targets.poses), self.dof))

    def descend(
        self,
        q: Float64Array,
        targets: Targets,
        checks: Sequence[int] = _CHECKS,
        near: Float64Array | None = None,
    ) -> tuple[Solutions, Integers]:
        """Take up to sum(checks) steps until the errors are within the tolerances, and turn hinges by full turns
        towards `near`. Return where that leads, and the counts of steps.
        """
        judged, ends = np.empty_like(q), np.empty_like(q)
        steps, lanes = np.zeros(len(q), np.int64), np.arange(len(q))
        poses, options = targets.poses, targets.options()
        for count in checks:
            before, q, unmet = self._steps(q, poses, options, count)
            judged[lanes], ends[lanes] = before, q
            steps[lanes] += count
            going = unmet > 0
            lanes, q, poses = lanes[going], q[going], poses[going]
            if not len(lanes):
                break
        found = self._ended(ends, targets, near)
        # The last step, taken after the errors were judged, squares them, but in singular poses it may lead away.
        worse = np.flatnonzero(~found.ok)
        if len(worse):
            back = self._ended(judged[worse], targets.at(worse), None if near is None else near[worse])
            found.put(worse[back.ok], back.at(back.ok))
        return found, steps

    def _ended(self, q: Float64Array, targets: Targets, near: Float64Array | None) -> Solutions:
        return self.measure(q if near is None else self._turned(q, near), targets)

    def _turned(self, q: Float64Array, near: Float64Array) -> Float64Array:
        """Turn hinges by full turns within their limits, as near to some coordinates as they get."""
        turns = np.round((near - q) / _TURN)
        turns = np.clip(turns, np.ceil((self.low - q) / _TURN), np.floor((self.high - q) / _TURN))
        moved = np.where(self._turns & (turns != 0), q + turns * _TURN, q)
        turned: Float64Array = np.clip(moved, self.low, self.high)
        return turned

    def pull(self, found: Solutions, targets: Targets, rounds: int = _PULLS, share: float = 1.0) -> Solutions:
        """Move solutions towards the posture, in place, as far as that leaves the frames within the tolerances, at
        first by a share of the way in each step.
        """
        lanes = np.flatnonzero(found.ok)
        if targets.posture is None or not len(lanes):
            return found
        part, posture = targets.at(lanes), targets.posture[lanes]
        best = found.at(lanes)
        distance = _sum_of_squares(best.q - posture)
        options = np.tile(part.options(pull=share), (len(lanes), 1))
        for _ in range(rounds):
            q = best.q
            for _ in range(_PULL_STEPS):
                q = self._pull_call.rows(q, part.poses, options, posture)["q_new"]
            moved, _ = self.descend(q, part, (_LAST_PULLS,))
            now = _sum_of_squares(moved.q - posture)
            nearer = moved.ok & (now < distance)
            best.put(nearer, moved.at(nearer))
            distance = np.where(nearer, now, distance)
            # Where the way bends much, only short steps lead nearer.
            options[:, -1] = np.where(nearer, np.minimum(1.0, 1.5 * options[:, -1]), options[:, -1] / 3)
        found.put(lanes, best)
        return found

    # ---- targets out of reach

    def _closest(self, targets: Targets, seed: int) -> tuple[Solutions, Integers]:
        """Return the closest poses found of targets that no trial reached, and the counts of steps."""
        count = len(targets.poses)
        lanes = targets.at(np.repeat(np.arange(count), _CLOSE_TRIALS))
        starts = [self._start(targets, k, PER_SHARE, seed) for k in range(_CLOSE_TRIALS)]
        q = np.stack(starts, axis=1).reshape(-1, self.dof)
        q = self._approach(q, lanes, _CLOSE_STEPS)
        misfit = self._misfit(self.measure(q, lanes).errors)
        best = np.where(np.isnan(misfit), np.inf, misfit).reshape(count, -1).argmin(axis=1)
        q = q.reshape(count, _CLOSE_TRIALS, self.dof)[np.arange(count), best]
        return self.approached(q, targets), np.full(count, _CLOSE_TRIALS * _CLOSE_STEPS + _LAST_STEPS)

    def approached(self, q: Float64Array, targets: Targets) -> Solutions:
        """Return the closest poses to targets in the neighbourhood of coordinates."""
        q = self._approach(q, targets, _LAST_STEPS)
        return self.measure(self._turned(q, self._centre(targets)), targets)

    def _approach(self, q: Float64Array, targets: Targets, count: int) -> Float64Array:
        """Take cautious steps, which converge where the errors do not vanish."""
        return self._steps(q, targets.poses, targets.options(caution=1.0), count)[1]

    def _misfit(self, errors: Float64Array) -> Float64Array:
        """Return the weighted sums of squares of errors (N, goals)."""
        with np.errstate(over="ignore"):
            return _sum_of_squares(errors * self._weights)

    # ---- kernels

    def measure(self, q: Float64Array, targets: Targets) -> Solutions:
        """Return coordinates with their errors, and whether these are within the tolerances."""
        errors = np.array(self._measure_call.rows(q, targets.poses)["errors"])
        both = targets.angle_tolerance, targets.position_tolerance
        within = np.logical_and.reduce(errors <= [both[goal.is_length] for goal in self.goals], axis=1)
        return Solutions(q, errors, within)

    def _steps(
        self, q: Float64Array, poses: Float64Array, options: Float64Array, count: int
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Take `count` steps. Return the coordinates before and after the last one, and the counts of errors beyond
        their tolerances before it.
        """
        step = self._step_call.rows
        options = np.broadcast_to(options, (len(q), len(options)))
        for _ in range(count):
            before = q
            found = step(q, poses, options)
            q = found["q_new"]
        return before, q, found["unmet"]


def _columns_that_move(goals: Sequence[Goal], form: Form, request: TreeRequest) -> set[int]:
    """Return the columns of the coordinates that move what goals compare."""
    columns: set[int] = set()
    for goal in goals:
        if not goal.frames:  # the centre of mass
            columns |= {*form.columns}
        for frame in goal.frames:
            columns |= {form.columns[joint] for joint in joints_to_base(form, request.frames[frame])}
    return columns


def joints_to_base(form: Form, body: int) -> list[int]:
    """Return the indices, from 0, of the joints between a body and the base, the body's own first."""
    joints = []
    while body:
        joints.append(body - 1)
        body = form.parents[body - 1]
    return joints


def _pieces(index: Integers, size: int) -> Iterator[Integers]:
    """Yield `size` numbers at a time."""
    for first in range(0, len(index), size):
        yield index[first : first + size]


def _sum_of_squares(values: Float64Array) -> Float64Array:
    """Return the sums of squares along the last axis, added in its order for any shape."""
    total = np.square(values[..., 0])
    for k in range(1, values.shape[-1]):
        total = total + np.square(values[..., k])
    return total
