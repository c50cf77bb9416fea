"""Inverse kinematics: coordinates at which a frame of a robot has a wanted pose, for many targets at once.

One kernel does a step of Gauss and Newton (Levenberg's damping vanishes with the error, so that the last steps
converge quadratically). Python repeats it for the targets not yet solved, and starts stuck ones again elsewhere. What
happens to a target depends on nothing but the target: it gets the same bits in any batch.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.calls import Call
from hingepair.engine.loops import Loop
from hingepair.engine.results import Results
from hingepair.engine.trace import arc_tangent, hypotenuse, square_root, where_less
from hingepair.equations.dynamics import solve_symmetric
from hingepair.equations.spatial import add, cross, dot, scale, subtract
from hingepair.mechanism.arguments import RESTING_BASE_VALUE_BY_INPUT_NAME
from hingepair.mechanism.constants import RobotConstants
from hingepair.mechanism.evaluate import RobotComputation
from hingepair.mechanism.tree import Frame, Tree
from hingepair.numeric.arrays import Float64Array, FloatArray
from hingepair.plans.trees import Form, Request, compute_request

_DAMPING: Final = 1e-2  # times the squared error; errors are angles, and lengths by the robot's reach
_LEAST_DAMPING: Final = 1e-12  # keeps the matrix regular in a singular pose
_MAX_DISTANCE: Final = 10.0  # from a target, in reaches of the robot; beyond, the direction alone counts
_MAX_STEP: Final = 1.5  # norm of a step of the coordinates [rad or m]
_STEPS_PER_CHECK: Final = 5
_STEPS_PER_START: Final = 15
_STARTS: Final = 60
_CAUTIOUS_STARTS: Final = 8  # for the closest pose, where no start led to a solution
_CAUTIOUS_STEPS: Final = 40
_LAST_STEPS: Final = 200
_TURN: Final = 2 * np.pi
_LANES: Final = 2048  # targets in work at a time


class InverseKinematics(Results):
    """Coordinates at which a frame of a robot has the wanted poses, or comes closest. Only hingepair calls the
    constructor.
    """

    __slots__ = {  # noqa: RUF023 (the order of the documentation)
        "q": "Coordinates in the order of `names`; NaN where the target is not finite; (..., dof) rad or m.",
        "ok": "Whether both errors are within the tolerances; (...,).",
        "position_error": "Distance of the frame's origin from its target; (...,) m.",
        "angle_error": "Angle between the frame's attitude and the wanted one; None without that; (...,) rad.",
        "steps": "Number of steps that were taken; (...,).",
        "starts": "Number of starts that were tried; (...,).",
    }

    q: FloatArray
    ok: NDArray[np.bool_]
    position_error: FloatArray
    angle_error: FloatArray | None
    steps: NDArray[np.int64]
    starts: NDArray[np.int64]


class Solver:
    """Inverse kinematics of one frame, with its kernel.

    Args:
        tree: record of the robot.
        constants: constants of the robot.
        frame: the frame that is to reach targets.
        has_attitude: whether targets have an attitude.
        limits: lower and upper limits of the coordinates, shape (dof, 2).
    """

    def __init__(
        self, tree: Tree, constants: RobotConstants, frame: Frame, has_attitude: bool, limits: Float64Array
    ) -> None:
        outputs = ("R", "S", "jacobian") if has_attitude else ("R", "jacobian")
        found = RobotComputation(constants, outputs, False, (frame,), (), None)
        form = found.form
        path, reach = _path(tree, frame)
        self.moving = np.isin(np.arange(form.dof), [form.columns[k - 1] for k in path])
        self.low, self.high = np.ascontiguousarray(limits.T)
        self.slides = np.array([joint.kind == "slider" for joint in tree.coordinates])
        # A coordinate that also drives a mimic joint is not the same after a turn.
        alone = np.bincount(form.columns, minlength=form.dof) == 1
        self.turns = alone & ~self.slides
        self.reach, self.has_attitude = reach, has_attitude
        bounded = bool(np.isfinite(limits[self.moving]).any())
        loop = _step_loop(form, found.request, tuple(found.inputs.items()), has_attitude, bounded)
        arguments = {
            "q": (form.dof,),
            "R_wanted": (3,),
            **({"S_wanted": (3, 3)} if has_attitude else {}),
            "caution": (),
        }
        known: dict[str, Any] = {
            **RESTING_BASE_VALUE_BY_INPUT_NAME,
            "constants": found.known["constants"],
            "low": self.low,
            "high": self.high,
            "weight": 1 / reach,
        }
        constant_inputs = {name: known[name] for name, _ in loop.inputs if name not in arguments}
        self.call = Call(loop, arguments, constant_inputs, Results, backend="compiled", constants_name="robot")

    def run(
        self,
        targets: Sequence[Float64Array],
        q0: Float64Array | None,
        tolerances: tuple[float, float],
        nearest: bool,
        seed: int,
    ) -> dict[str, NDArray[Any]]:
        """Return the arrays of an InverseKinematics for N targets: positions (N, 3), and attitudes (N, 3, 3)."""
        count, dof = len(targets[0]), len(self.low)
        found = _Found(count, dof)
        finite = np.logical_and.reduce([np.isfinite(one).all(axis=tuple(range(1, one.ndim))) for one in targets])
        starts = _Starts(self, q0, seed)
        waiting = np.flatnonzero(finite)
        index, trial, age = (np.zeros(0, np.int64) for _ in range(3))
        q = np.zeros((0, dof))
        while len(index) or len(waiting):
            # Fill the lanes with new targets.
            fresh, waiting = np.split(waiting, [_LANES - len(index)])
            zeros = np.zeros(len(fresh), np.int64)
            q = np.concatenate([q, starts.at(fresh, zeros)])
            index, trial, age = (np.concatenate(pair) for pair in ((index, fresh), (trial, zeros), (age, zeros)))
            found.starts[fresh] = 1

            now, errors, after = self._steps(q, [one[index] for one in targets], _STEPS_PER_CHECK)
            found.steps[index] += _STEPS_PER_CHECK
            age += _STEPS_PER_CHECK
            solved = (errors[0] <= tolerances[0]) & (errors[1] <= tolerances[1])
            ended = solved | (age >= _STEPS_PER_START)
            if ended.any():
                at = index[ended]
                now[ended] = starts.turned(now[ended], at)
                score = self._misfit(errors[:, ended])
                if nearest:
                    score = np.where(solved[ended], starts.distance(now[ended], at), score)
                found.keep(at, solved[ended], score, now[ended], errors[:, ended])
            done = ended & ((solved & (not nearest)) | (trial + 1 == starts.count))
            again = ended & ~done
            trial[again] += 1
            age[again] = 0
            found.starts[index[again]] += 1
            after[again] = starts.at(index[again], trial[again])
            index, trial, age, q = index[~done], trial[~done], age[~done], after[~done]

        every = np.flatnonzero(finite)
        self._measure(found, every, targets, tolerances)  # full turns changed the last bits
        missed = every[~found.ok[every]]
        self._approach(found, starts, missed, targets, tolerances)
        self._measure(found, missed, targets, tolerances)
        arrays = {
            "q": found.q, "ok": found.ok, "position_error": found.errors[0], "angle_error": found.errors[1],
            "steps": found.steps, "starts": found.starts,
        }  # fmt: skip
        if not self.has_attitude:
            del arrays["angle_error"]
        return arrays

    def _measure(
        self,
        found: _Found,
        index: NDArray[np.int64],
        targets: Sequence[Float64Array],
        tolerances: tuple[float, float],
    ) -> None:
        """Compute the errors of the coordinates that are returned."""
        for first in range(0, len(index), _LANES):
            at = index[first : first + _LANES]
            _, errors, _ = self._steps(found.q[at], [one[at] for one in targets], 1)
            found.errors[:, at] = errors
            found.ok[at] = (errors[0] <= tolerances[0]) & (errors[1] <= tolerances[1])

    def _approach(
        self,
        found: _Found,
        starts: _Starts,
        missed: NDArray[np.int64],
        targets: Sequence[Float64Array],
        tolerances: tuple[float, float],
    ) -> None:
        """Come as close as possible to targets that no start has reached."""
        for first in range(0, len(missed), _LANES):
            at = missed[first : first + _LANES]
            found.score[at] = self._misfit(found.errors[:, at])
            # From the best end, from some starts, and on from the best of these.
            for trial in [None, *range(_CAUTIOUS_STARTS), None]:
                q = found.q[at] if trial is None else starts.at(at, np.full(len(at), trial))
                count = _LAST_STEPS if trial is None else _CAUTIOUS_STEPS
                now, errors, _ = self._steps(q, [one[at] for one in targets], count, 1.0)
                found.steps[at] += count
                solved = (errors[0] <= tolerances[0]) & (errors[1] <= tolerances[1])
                found.keep(at, solved, self._misfit(errors), starts.turned(now, at), errors)

    def _steps(
        self, q: Float64Array, targets: Sequence[Float64Array], count: int, caution: float = 0.0
    ) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Do some steps. Return the coordinates before the last one, the errors (2, N) there, and the coordinates
        after it. `caution` damps by the error itself, which finds the closest pose to targets out of reach.
        """
        now, after = q, q
        for _ in range(count):
            now = after
            step = self.call.rows(now, *targets, caution)
            after = step["q_new"]
        errors = np.zeros((2, len(q)))
        for row, name in zip(errors, step.outputs[1:], strict=False):
            row[:] = step[name]
        return now.copy(), errors, after.copy()

    def _misfit(self, errors: Float64Array) -> Float64Array:
        """Return the distances from targets, lengths by the robot's reach, from errors (2, N)."""
        distances: Float64Array = np.hypot(errors[0] / self.reach, errors[1])
        return np.minimum(distances, np.finfo(np.float64).max)  # below the score of nothing found


class _Starts:
    """The starts: q0 if it is given, then random ones, the same for every target.

    Random starts lie within the limits, and within a turn or twice the robot's reach of 0. Joints that do not move
    the frame keep q0, or stand in the middle of their limits.
    """

    def __init__(self, solver: Solver, q0: Float64Array | None, seed: int) -> None:
        self.low, self.high, self.turns, self.moving = solver.low, solver.high, solver.turns, solver.moving
        self.q0, self.first = q0, None if q0 is None else np.clip(q0, self.low, self.high)
        self.count = _STARTS + (q0 is not None)
        bounded = np.isfinite(self.low) & np.isfinite(self.high)
        middle = np.where(bounded, np.where(bounded, self.low, 0.0) / 2 + np.where(bounded, self.high, 0.0) / 2, 0.0)
        self.middle = np.clip(middle, self.low, self.high)
        width = np.where(solver.slides, 2 * solver.reach, _TURN)
        centre = np.clip(0.0, self.low, self.high)
        low, high = np.maximum(self.low, centre - width), np.minimum(self.high, centre + width)
        drawn = np.random.default_rng(seed).uniform(low, high, (_STARTS, len(low)))
        self.random = np.where(self.moving, np.clip(drawn, self.low, self.high), self.middle)

    def at(self, index: NDArray[np.int64], trial: NDArray[np.int64]) -> Float64Array:
        """Return the start of each target by the number of the trial."""
        if self.first is None:
            return self.random[trial]
        own = self.first[index]
        return np.where(self.moving & (trial > 0)[:, None], self.random[trial - 1], own)

    def turned(self, q: Float64Array, index: NDArray[np.int64]) -> Float64Array:
        """Turn hinges by full turns within their limits, as near to q0 or the middle as they get."""
        near = self.middle if self.q0 is None else self.q0[index]
        turns = np.round((near - q) / _TURN)
        turns = np.clip(turns, np.ceil((self.low - q) / _TURN), np.floor((self.high - q) / _TURN))
        return np.clip(np.where(self.turns & (turns != 0), q + turns * _TURN, q), self.low, self.high)

    def distance(self, q: Float64Array, index: NDArray[np.int64]) -> Float64Array:
        """Return the sums of squares of q - q0."""
        return np.zeros(len(q)) if self.q0 is None else np.square(q - self.q0[index]).sum(axis=1)


class _Found:
    """The best coordinates found so far, for each target."""

    def __init__(self, count: int, dof: int) -> None:
        self.q = np.full((count, dof), np.nan)
        self.errors = np.full((2, count), np.nan)
        self.ok = np.zeros(count, bool)
        self.score = np.full(count, np.inf)
        self.steps, self.starts = np.zeros(count, np.int64), np.zeros(count, np.int64)

    def keep(
        self,
        at: NDArray[np.int64],
        solved: NDArray[np.bool_],
        score: Float64Array,
        q: Float64Array,
        errors: Float64Array,
    ) -> None:
        """Take ends of starts that are better than those before: solutions first, then the lower score."""
        better = (solved & ~self.ok[at]) | ((solved == self.ok[at]) & (score < self.score[at]))
        at = at[better]
        self.ok[at], self.score[at], self.q[at] = solved[better], score[better], q[better]
        self.errors[:, at] = errors[:, better]


def _path(tree: Tree, frame: Frame) -> tuple[list[int], float]:
    """Return the bodies that carry the frame, and the stretched length of their chain [m]; 1 if it is 0."""
    path, reach = [], float(np.linalg.norm(frame.R))
    body = frame.body
    while body:
        joint = tree.joints[body - 1]
        path.append(body)
        reach += float(np.linalg.norm(joint.u))
        if joint.kind == "slider" and np.isfinite(joint.position_limits).all():
            reach += float(np.abs(joint.position_limits).max())
        body = joint.parent
    return path, reach or 1.0


@functools.lru_cache(maxsize=64)
def _step_loop(form: Form, request: Request, inputs: tuple[Any, ...], has_attitude: bool, bounded: bool) -> Loop:
    """Return the Loop of one step: coordinates after it, and errors before it."""
    n = form.dof
    shapes = {**dict(inputs), "R_wanted": (3,), "weight": (), "caution": ()}
    outputs: dict[str, tuple[int, ...]] = {"q_new": (n,), "position_error": ()}
    if has_attitude:
        shapes["S_wanted"] = (3, 3)
        outputs["angle_error"] = ()
    if bounded:
        shapes |= {"low": (n,), "high": (n,)}
    return Loop("inverse_kinematics", functools.partial(_step, form, request), shapes, outputs)


def _step(form: Form, request: Request, values: dict[str, Any]) -> dict[str, Any]:
    """Return the coordinates after a step towards a target, and the errors before it."""
    now = compute_request(form, request, values)
    n, weight, q = form.dof, values["weight"], values["q"]
    offset = subtract(values["R_wanted"], now["R"])
    distance = hypotenuse(hypotenuse(offset[0], offset[1]), offset[2])
    far = distance * weight
    # A target at 1e200 m must not overflow.
    near = where_less(far, _MAX_DISTANCE, far, _MAX_DISTANCE)
    error = [*scale(offset, weight * where_less(far, _MAX_DISTANCE, 1.0, _MAX_DISTANCE / far))]
    misfit, size = near * near, near
    results: dict[str, Any] = {"position_error": distance}
    rows = [[x * weight for x in now["jacobian"][i * n : (i + 1) * n]] for i in range(3)]
    if "S_wanted" in values:
        S, wanted = now["S"], values["S_wanted"]
        turn = (0.0, 0.0, 0.0)
        for c in range(3):
            turn = add(turn, cross((S[c], S[3 + c], S[6 + c]), (wanted[c], wanted[3 + c], wanted[6 + c])))
        # The sine is exact for small angles; the trace alone would lose half of the digits.
        sine = square_root(dot(turn, turn)) * 0.5
        cosine = (sum((S[k] * wanted[k] for k in range(1, 9)), S[0] * wanted[0]) - 1.0) * 0.5
        results["angle_error"] = angle = arc_tangent(sine, cosine)
        error += scale(turn, 0.5 * where_less(sine, 1e-9, 1.0, angle / sine))
        rows += [[*now["jacobian"][i * n : (i + 1) * n]] for i in range(3, 6)]
        misfit, size = misfit + (1.0 - cosine) * 0.5, size + angle
    damping = misfit * _DAMPING + size * values["caution"] + _LEAST_DAMPING
    moving = [k for k in range(n) if any(type(row[k]) is not float or row[k] != 0 for row in rows)]
    rows = [[row[k] for k in moving] for row in rows]
    new = [*q]
    if moving:
        step = _damped_step(rows, error, damping)
        if "low" in values:
            step = _bounded_step(step, rows, error, damping, q, moving, values)
        for k, change in zip(moving, step, strict=True):
            new[k] = q[k] + change
        if "low" in values:
            for k in moving:
                x = where_less(new[k], values["low"][k], values["low"][k], new[k])
                new[k] = where_less(values["high"][k], x, values["high"][k], x)
    return {"q_new": tuple(new), **results}


def _bounded_step(
    step: list[Any],
    rows: list[list[Any]],
    error: list[Any],
    damping: Any,
    q: Sequence[Any],
    moving: list[int],
    values: dict[str, Any],
) -> list[Any]:
    """Return the step in which joints that the given one takes beyond their limits stop there, and the others make up
    for it.
    """
    inside, to_limit, rest = [], [], [*error]
    for j, k in enumerate(moving):
        low, high, end = values["low"][k], values["high"][k], q[k] + step[j]
        inside.append(where_less(end, low, 0.0, where_less(high, end, 0.0, 1.0)))
        to_limit.append(where_less(end, low, low - q[k], where_less(high, end, high - q[k], 0.0)))
        rest = [rest[i] - row[j] * to_limit[j] for i, row in enumerate(rows)]
    second = _damped_step([[x * free for x, free in zip(row, inside, strict=True)] for row in rows], rest, damping)
    return [x * free + stop for x, free, stop in zip(second, inside, to_limit, strict=True)]


def _damped_step(rows: list[list[Any]], error: list[Any], damping: Any) -> list[Any]:
    """Return J^T (J J^T + damping)^-1 error, shortened to the longest permitted step."""
    products = []
    for i, row in enumerate(rows):
        for j in range(i + 1):
            entry = sum((x * y for x, y in zip(row[1:], rows[j][1:], strict=True)), row[0] * rows[j][0])
            products.append(entry + damping if i == j else entry)
    y, _ = solve_symmetric(tuple(products), tuple(error))
    step = [
        sum((row[k] * part for row, part in zip(rows[1:], y[1:], strict=True)), rows[0][k] * y[0])
        for k in range(len(rows[0]))
    ]
    square = sum((d * d for d in step[1:]), step[0] * step[0])
    factor = where_less(square, _MAX_STEP**2, 1.0, _MAX_STEP / square_root(square))
    return [d * factor for d in step]
