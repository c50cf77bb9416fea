"""The arguments of inverse kinematics: targets of frames, limits, what solutions are to be near."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.engine.backend import execution_of
from hingepair.engine.slices import run_in_threads
from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.inverse_kinematics.goals import Goal
from hingepair.inverse_kinematics.paths import follow
from hingepair.inverse_kinematics.results import InverseKinematics, InverseKinematicsPath
from hingepair.inverse_kinematics.search import MAX_TRIALS, Found, Solver, Wish
from hingepair.mechanism.computations import RobotComputation
from hingepair.mechanism.constants import RobotConstants
from hingepair.mechanism.states import FrameState
from hingepair.mechanism.tree import Frame, Tree
from hingepair.numeric.arrays import (
    Float64Array,
    broadcast_shape,
    check_choice,
    finite_number,
    number_not_below_0,
    one_constant,
    real_array,
    row_norms,
    vectors,
)
from hingepair.pair.body_motion import BodyMotion
from hingepair.plans.arguments import CoordinateNames, read_coordinates
from hingepair.rotations.matrices import check_rotation

_MAX_SOLVERS: Final = 32  # that a robot keeps


class Question(NamedTuple):
    """What is asked of a robot, checked."""

    solver: Solver
    wish: Wish  # of all targets, in one row
    shape: tuple[int, ...]  # of the targets
    by_frame: bool  # whether targets were given by frame
    seed: int
    workers: int

    def solve(self, count: int | None, nearest: bool) -> InverseKinematics:
        """Return one solution of each target, or up to `count`."""
        solver, rows = self.solver, (len(self.wish.targets),)
        several = count or (1 if nearest else None)
        lead = rows if several is None else (*rows, several)
        found = Found.nothing(lead, solver)
        steps, starts = np.zeros(rows, np.int64), np.zeros(rows, np.int64)

        def solve_some(index: Any) -> None:
            wish = self.wish.at(index)
            some, steps[index], starts[index] = (
                solver.first(wish, self.seed) if several is None else solver.several(wish, several, self.seed)
            )
            found.put(index, some)

        finite = np.flatnonzero(np.isfinite(self.wish.targets).all(axis=1))
        pieces = [piece for piece in np.array_split(finite, self.workers) if len(piece)]
        if pieces:
            run_in_threads(solve_some, pieces)
        shape = self.shape if count is None else (*self.shape, count)
        arrays = self._arrays(found, shape)
        arrays |= {"steps": steps.reshape(self.shape), "starts": starts.reshape(self.shape)}
        return InverseKinematics(arrays, self.shape)

    def follow(self, max_change: float) -> InverseKinematicsPath:
        """Return the coordinates along paths, whose samples stand in the last axis of the targets."""
        samples = self.shape[-1]
        count = len(self.wish.targets) // max(1, samples)
        found = Found.nothing((count, samples), self.solver)
        jumps, steps = np.zeros((count, samples), bool), np.zeros((count, samples), np.int64)

        def follow_some(paths: Any) -> None:
            rows = paths[:, None] * samples + np.arange(samples)
            wish = self.wish.at(rows.ravel())
            some, jumps[paths], steps[paths] = follow(self.solver, wish, rows.shape, max_change, self.seed)
            found.put(paths, some)

        pieces = [piece for piece in np.array_split(np.arange(count), self.workers) if len(piece) and samples]
        if pieces:
            run_in_threads(follow_some, pieces)
        arrays = self._arrays(found, self.shape)
        arrays |= {"jumps": jumps.reshape(self.shape), "steps": steps.reshape(self.shape)}
        return InverseKinematicsPath(arrays, self.shape)

    def _arrays(self, found: Found, shape: tuple[int, ...]) -> dict[str, Any]:
        """Return coordinates and errors by the names of results."""
        goals = self.solver.goals
        errors = found.errors.reshape(*shape, len(goals), 2)
        errors = errors if self.by_frame else errors[..., 0, :]
        arrays = {"q": found.q.reshape(*shape, self.solver.dof), "ok": found.ok.reshape(shape)}
        if any(goal.position for goal in goals):
            arrays["position_error"] = errors[..., 0]
        if any(goal.attitude != "none" for goal in goals):
            arrays["angle_error"] = errors[..., 1]
        return arrays


class _Target(NamedTuple):
    """What one frame is to reach."""

    frame: Frame  # whose z axis is the one that has a direction
    goal: Goal
    parts: tuple[Float64Array, ...]  # positions, then rotation matrices or directions


def read_question(
    tree: Tree,
    constants: RobotConstants,
    R: Any,
    S: Any,
    *,
    frame: str | None,
    direction: Any,
    axis: Any,
    q0: Any,
    limits: Any,
    prefer: Any,
    weights: Any,
    position_tolerance: float,
    angle_tolerance: float,
    base_motion: BodyMotion | None,
    seed: int,
    workers: int,
    path: bool = False,
) -> Question:
    """Check the arguments of inverse kinematics. Those of a path have an axis of samples, which q0 has not."""
    if not constants.names:
        raise ArgumentError("robot", "a joint that moves", "none")
    if tree.samples is not None and tree.samples.lengths:
        tree.single()
    workers = execution_of("auto", workers).workers
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise ArgumentError("seed", "an integer from 0", quoted(seed))
    tolerances = (
        number_not_below_0("position_tolerance", position_tolerance),
        number_not_below_0("angle_tolerance", angle_tolerance),
    )
    by_frame = any(isinstance(value, Mapping) for value in (R, S, direction))
    shapes: dict[str, tuple[int, ...]] = {}
    targets = {
        name: _read_target(tree, number, name, R, S, direction, axis, by_frame, shapes)
        for number, name in enumerate(_frame_names(tree, frame, {"R": R, "S": S, "direction": direction}))
    }
    names = CoordinateNames(constants.names, noun="joints")
    near = None if q0 is None else _read_posture("q0", q0, names, shapes, path)
    box = _read_limits(limits, tree)
    posture = None
    if isinstance(prefer, str):
        check_choice("prefer", prefer, ("middle",))
    elif prefer is not None:
        posture = _read_posture("prefer", prefer, names, shapes, False)
    if base_motion is not None:
        if not isinstance(base_motion, BodyMotion) or base_motion.S is None:
            raise ArgumentError("base_motion", "a BodyMotion with R and S", quoted(base_motion))
        shapes["base_motion"] = base_motion.shape
    shape = broadcast_shape(shapes)
    if path and not shape:
        raise ShapeError("R", "an axis of samples, shape (..., samples, 3)", "one target")

    reaches = {name: _reach(tree, target.frame) for name, target in targets.items()}
    parts = {name: _in_base_axes(target, base_motion, shape) for name, target in targets.items()}
    solver = _solver(constants, targets, box, reaches, _read_weights(weights, reaches))
    size = len(constants.names)
    if isinstance(prefer, str):
        posture = solver.middle
    rows = [
        None if one is None else np.broadcast_to(one, (*shape, size)).reshape(-1, size) for one in (near, posture)
    ]
    wish = Wish(np.concatenate([*parts.values()], axis=1), rows[0], rows[1], *tolerances)
    return Question(solver, wish, shape, by_frame, int(seed), workers)


def read_solutions(solutions: Any, select: str, q0: Any) -> int | None:
    """Check how many solutions are wanted, and which.

    Raises:
        ArgumentError: no such choice.
    """
    check_choice("select", select, ("any", "nearest"))
    if select == "nearest" and q0 is None:
        raise ArgumentError("q0", 'coordinates, since select="nearest" needs them', None)
    if solutions is None:
        return None
    is_count = isinstance(solutions, int | np.integer) and not isinstance(solutions, bool)
    if not is_count or not 1 <= solutions <= MAX_TRIALS:
        raise ArgumentError("solutions", f"an integer from 1 to {MAX_TRIALS}", quoted(solutions))
    return int(solutions)


def read_max_change(max_change: Any) -> float:
    """Check a change of coordinates.

    Raises:
        ArgumentError: it is not a positive number.
    """
    number = finite_number("max_change", max_change)
    if number <= 0:
        raise ArgumentError("max_change", "a positive number", max_change)
    return number


def _frame_names(tree: Tree, frame: str | None, given: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the frames that have targets."""
    present = {name: value for name, value in given.items() if value is not None}
    if not present:
        raise ArgumentError("R", "positions, or attitudes in S or direction", None)
    if not any(isinstance(value, Mapping) for value in present.values()):
        if frame is not None:
            return (frame,)
        if len(tree.tips) != 1:
            expected = f"the name of a link or joint, since the robot has several tips: {', '.join(tree.tips)}"
            raise ArgumentError("frame", expected, None)
        return tree.tips
    if frame is not None:
        raise ArgumentError("frame", "None, since the targets are given by frame", quoted(frame))
    for name, value in present.items():
        if not isinstance(value, Mapping) or not value:
            raise ArgumentError(name, "a dict by frame, as the other targets", quoted(value))
    return tuple(dict.fromkeys(name for value in present.values() for name in value))


def _read_target(
    tree: Tree,
    number: int,
    name: str,
    R: Any,
    S: Any,
    direction: Any,
    axis: Any,
    by_frame: bool,
    shapes: dict[str, tuple[int, ...]],
) -> _Target:
    """Check the targets of one frame, and note the shapes of their samples."""
    frame = tree.known_frame("frame", name)
    labels = {one: f"{one}[{name!r}]" if by_frame else one for one in ("R", "S", "direction", "axis")}
    given = [(one or {}).get(name) if by_frame else one for one in (R, S, direction)]
    if isinstance(given[0], BodyMotion | FrameState):
        if given[1] is not None:
            raise ArgumentError(labels["S"], f"None, since {labels['R']} has attitudes", quoted(given[1]))
        given[:2] = given[0].R, given[0].S
    place, attitude, toward = given
    parts = []
    if place is not None:
        parts.append(vectors(labels["R"], place, 3))
        shapes[labels["R"]] = parts[-1].shape[:-1]
    if attitude is not None and toward is not None:
        if by_frame or S is not None:
            raise ArgumentError(labels["direction"], f"None, since {labels['S']} is given", quoted(toward))
        attitude = None
    if attitude is not None:
        parts.append(vectors(labels["S"], attitude, 3, 3))
        shapes[labels["S"]] = parts[-1].shape[:-2]
        check_rotation(labels["S"], parts[-1])
    if toward is not None:
        parts.append(_unit_vectors(labels["direction"], vectors(labels["direction"], toward, 3)))
        shapes[labels["direction"]] = parts[-1].shape[:-1]
        own = axis.get(name, (0, 0, 1)) if isinstance(axis, Mapping) else axis
        own = _unit_vectors(labels["axis"], one_constant(labels["axis"], own, 3))
        frame = Frame(frame.body, frame.R, frame.S @ _axes_about(own))
    kind = "full" if attitude is not None else "axis" if toward is not None else "none"
    return _Target(frame, Goal(number, place is not None, kind), tuple(np.asarray(one, np.float64) for one in parts))


def _unit_vectors(name: str, values: Any) -> Float64Array:
    """Return vectors of length 1; those that are not finite stay so."""
    values = np.asarray(values, np.float64)
    with np.errstate(all="ignore"):
        largest = np.abs(values).max(axis=-1, keepdims=True)
        if (largest == 0).any():
            raise ArgumentError(name, "vectors that are not zero", "(0, 0, 0)")
        values = values / largest
        found: Float64Array = values / row_norms(values)[..., None]
    return found


def _axes_about(z: Float64Array) -> Float64Array:
    """Return a rotation whose third column is a unit vector."""
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _read_posture(
    name: str, value: Any, names: CoordinateNames, shapes: dict[str, tuple[int, ...]], path: bool
) -> Float64Array:
    """Return finite coordinates (..., dof), with an axis of one sample if there is one for each path."""
    read, _ = read_coordinates(name, value, names)
    array = np.stack(np.broadcast_arrays(*read), axis=-1) if isinstance(read, tuple) else read
    array = np.asarray(array, np.float64)
    if not np.isfinite(array).all():
        raise ArgumentError(name, "finite numbers", "NaN or infinity")
    array = array[..., None, :] if path else array
    shapes[name] = array.shape[:-1]
    return array


def _read_limits(limits: Any, tree: Tree) -> Float64Array:
    """Return the limits of all coordinates, shape (dof, 2)."""
    own = np.array([joint.position_limits for joint in tree.coordinates], np.float64)
    if isinstance(limits, bool | np.bool_):
        return own if limits else np.broadcast_to((-np.inf, np.inf), own.shape)
    array = real_array("limits", limits).astype(np.float64)
    if array.shape != own.shape:
        raise ArgumentError("limits", f"True, False or an array of shape {own.shape}", f"shape {array.shape}")
    for joint, (low, high) in zip(tree.coordinates, array, strict=True):
        if not low <= high or low == np.inf or high == -np.inf:
            raise ArgumentError(f"limits of {joint.name!r}", "a lower and an upper limit", f"{low}, {high}")
    return array


def _read_weights(weights: Any, reaches: Mapping[str, float]) -> list[tuple[float, float]]:
    """Return for each frame what a metre and a radian count."""
    found = []
    for name, reach in reaches.items():
        pair = weights.get(name) if isinstance(weights, Mapping) else weights
        label = f"weights[{name!r}]" if isinstance(weights, Mapping) else "weights"
        values = (1 / reach, 1.0) if pair is None else tuple(one_constant(label, pair, 2).tolist())
        if min(values) <= 0:
            raise ArgumentError(label, "positive numbers", quoted(pair))
        found.append(values)
    return found


def _reach(tree: Tree, frame: Frame) -> float:
    """Return the stretched length of the chain that carries a frame [m]; 1 if it is 0."""
    reach, body = float(np.linalg.norm(frame.R)), frame.body
    while body:
        joint = tree.joints[body - 1]
        reach += float(np.linalg.norm(joint.u))
        reach += joint.reach
        body = joint.parent
    return reach or 1.0


def _in_base_axes(target: _Target, base: BodyMotion | None, shape: tuple[int, ...]) -> Float64Array:
    """Return the numbers of a target for all samples, (N, size), in axes of the base and from its reference point."""
    columns = []
    for k, part in enumerate(target.parts):
        is_place = target.goal.position and k == 0
        rank = 2 if target.goal.attitude == "full" and not is_place else 1
        rows = np.broadcast_to(part, (*shape, *(3,) * rank)).reshape(-1, *(3,) * rank)
        if base is not None:
            R1 = np.broadcast_to(base.R, (*shape, 3)).reshape(-1, 3).astype(np.float64)
            S1 = np.broadcast_to(base.S, (*shape, 3, 3)).reshape(-1, 3, 3).astype(np.float64)
            S1 = S1 if rank == 1 else S1[..., None]
            rows = rows - R1 if is_place else rows
            # Not by matmul, which may add in another order in another batch.
            turned = [
                S1[:, 0, c] * rows[:, 0] + S1[:, 1, c] * rows[:, 1] + S1[:, 2, c] * rows[:, 2] for c in range(3)
            ]
            rows = np.stack(turned, axis=1)
        columns.append(rows.reshape(len(rows), 3**rank))
    return np.concatenate(columns, axis=1)


def _solver(
    constants: RobotConstants,
    targets: Mapping[str, _Target],
    limits: Float64Array,
    reaches: Mapping[str, float],
    weights: list[tuple[float, float]],
) -> Solver:
    """Return the Solver, which is made at its first use and cached."""
    frames = tuple(target.frame for target in targets.values())
    goals = tuple(target.goal for target in targets.values())
    key = tuple(targets), goals, tuple(weights), limits.tobytes(), tuple(frame.S.tobytes() for frame in frames)
    solvers: dict[Any, Solver] = constants.cache.others.setdefault("inverse_kinematics", {})
    solver = solvers.get(key)
    if solver is None:
        found = RobotComputation(constants, ("R", "S"), False, frames, (), None)
        solver = Solver(
            found.form, found.request, found.known["constants"], goals, limits, tuple(reaches.values()), weights
        )
        if len(solvers) >= _MAX_SOLVERS:
            solvers.clear()
        solvers[key] = solver
    return solver
