"""The arguments of inverse kinematics: targets of frames, limits, what solutions are to be near."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, NamedTuple, Unpack

import numpy as np

from hingepair.engine.backend import execution_of
from hingepair.engine.threads import run_in_threads
from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.inverse_kinematics.goals import Attitude, Direction, Goal, Position
from hingepair.inverse_kinematics.paths import follow
from hingepair.inverse_kinematics.results import InverseKinematics, InverseKinematicsPath
from hingepair.inverse_kinematics.search import MAX_TRIALS, Solutions, Solver, Targets
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.computations import RobotComputation
from hingepair.mechanism.constants import RobotConstants
from hingepair.mechanism.options import SEARCH_DEFAULTS, SearchOptions, check_options
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
from hingepair.rotations.matrices import check_rotation

_MAX_SOLVERS: Final = 32  # that a robot keeps; one more replaces all


class Query(NamedTuple):
    """Checked arguments of inverse kinematics, and their answers."""

    solver: Solver
    targets: Targets  # of all samples in one row
    shape: tuple[int, ...]  # of the targets
    by_frame: bool  # whether targets were given by frame
    seed: int
    workers: int

    def solve(self, count: int | None, nearest: bool) -> InverseKinematics:
        """Return one solution of each target, with `nearest` the nearest found to q0, or up to `count`."""
        solver, rows = self.solver, (len(self.targets.poses),)
        several = count or (1 if nearest else None)
        lead = rows if several is None else (*rows, several)
        found = Solutions.nothing(lead, solver)
        steps, starts = np.zeros(rows, np.int64), np.zeros(rows, np.int64)

        def solve_some(rows: Any) -> None:
            targets = self.targets.at(rows)
            some, steps[rows], starts[rows] = (
                solver.first(targets, self.seed) if several is None else solver.several(targets, several, self.seed)
            )
            found.put(rows, some)

        finite = np.flatnonzero(np.isfinite(self.targets.poses).all(axis=1))
        pieces = [piece for piece in np.array_split(finite, self.workers) if len(piece)]
        run_in_threads(solve_some, pieces, self.workers)
        shape = self.shape if count is None else (*self.shape, count)
        arrays = self._arrays(found, shape)
        arrays |= {"steps": steps.reshape(self.shape), "starts": starts.reshape(self.shape)}
        return InverseKinematics(arrays, self.shape)

    def follow(self, max_change: float) -> InverseKinematicsPath:
        """Return the coordinates along paths, whose samples stand in the last axis of the targets."""
        samples = self.shape[-1]
        count = len(self.targets.poses) // max(1, samples)
        found = Solutions.nothing((count, samples), self.solver)
        jumps, steps = np.zeros((count, samples), bool), np.zeros((count, samples), np.int64)

        def follow_some(paths: Any) -> None:
            rows = paths[:, None] * samples + np.arange(samples)
            targets = self.targets.at(rows.ravel())
            some, jumps[paths], steps[paths] = follow(self.solver, targets, rows.shape, max_change, self.seed)
            found.put(paths, some)

        pieces = [piece for piece in np.array_split(np.arange(count), self.workers) if len(piece) and samples]
        run_in_threads(follow_some, pieces, self.workers)
        arrays = self._arrays(found, self.shape)
        arrays |= {"jumps": jumps.reshape(self.shape), "steps": steps.reshape(self.shape)}
        return InverseKinematicsPath(arrays, self.shape)

    def _arrays(self, found: Solutions, shape: tuple[int, ...]) -> dict[str, Any]:
        """Return coordinates and errors by the names of results."""
        arrays = {"q": found.q.reshape(*shape, self.solver.dof), "ok": found.ok.reshape(shape)}
        goals, errors = self.solver.goals, found.errors.reshape(*shape, len(self.solver.goals))
        for name, is_length in (("position_error", True), ("angle_error", False)):
            columns = [k for k, goal in enumerate(goals) if goal.is_length == is_length]
            if columns:
                of_frames = np.zeros((*shape, 1 + goals[-1].frame))
                of_frames[..., [goals[k].frame for k in columns]] = errors[..., columns]
                arrays[name] = of_frames if self.by_frame else of_frames[..., 0]
        return arrays


class _FrameTargets(NamedTuple):
    """What one frame is to reach, at all samples."""

    frame: Frame  # whose z axis is the one that has a direction
    goals: tuple[Goal, ...]
    values: dict[str, Float64Array]  # of the goals, by the name of the argument that has them

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shapes of the samples."""
        named = zip(self.goals, self.values.items(), strict=True)
        return {name: array.shape[: array.ndim - len(goal.shape)] for goal, (name, array) in named}


def read_query(
    tree: Tree, constants: RobotConstants, R: Any, S: Any, method: str, **options: Unpack[SearchOptions]
) -> Query:
    """Return the checked arguments of a method of inverse kinematics; all but q0 of paths have samples."""
    check_options(method, options, SearchOptions)
    path = method == "inverse_kinematics_path"
    given: dict[str, Any] = {**SEARCH_DEFAULTS, **options}
    q0, prefer, base_motion, seed = (given[name] for name in ("q0", "prefer", "base_motion", "seed"))
    if not constants.names:
        raise ArgumentError("robot", "a joint that moves", "none")
    if tree.samples is not None and tree.samples.lengths:
        tree.single()
    workers = execution_of("auto", given["workers"]).workers
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise ArgumentError("seed", "an integer from 0", quoted(seed))
    tolerances = [number_not_below_0(name, given[name]) for name in ("position_tolerance", "angle_tolerance")]
    wanted = {"R": R, "S": S, "direction": given["direction"]}
    by_frame = any(isinstance(value, Mapping) for value in wanted.values())
    frames = {
        name: _read_target(tree, number, name, R, S, given["direction"], given["axis"], by_frame)
        for number, name in enumerate(_frame_names(tree, given["frame"], wanted))
    }
    shapes = {label: shape for target in frames.values() for label, shape in target.shapes().items()}
    near = posture = None
    if q0 is not None:
        near = _read_posture("q0", q0, tree, path)
        shapes["q0"] = near.shape[:-1]
    box = _read_limits(given["limits"], tree)
    if isinstance(prefer, str):
        check_choice("prefer", prefer, ("middle",))
    elif prefer is not None:
        posture = _read_posture("prefer", prefer, tree, False)
        shapes["prefer"] = posture.shape[:-1]
    if base_motion is not None:
        if not isinstance(base_motion, BodyMotion) or base_motion.S is None:
            raise ArgumentError("base_motion", "a BodyMotion with R and S", quoted(base_motion))
        shapes["base_motion"] = base_motion.shape
    shape = broadcast_shape(shapes)
    if path and not shape:
        raise ShapeError("R", "an axis of samples, shape (..., samples, 3)", "one target")

    reaches = {name: _reach(tree, one.frame) for name, one in frames.items()}
    solver = _solver(constants, frames, box, reaches, given["weights"])
    size = len(constants.names)
    if isinstance(prefer, str):
        posture = solver.middle
    rows = [
        None if one is None else np.broadcast_to(one, (*shape, size)).reshape(-1, size) for one in (near, posture)
    ]
    poses = np.concatenate([_in_base_axes(one, base_motion, shape) for one in frames.values()], axis=1)
    targets = Targets(poses, rows[0], rows[1], *tolerances)
    return Query(solver, targets, shape, by_frame, int(seed), workers)


def read_solutions(solutions: Any, select: str, q0: Any) -> int | None:
    """Return the argument `solutions`, checked with `select`; None: one solution, without an axis for it."""
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
    """Return the argument `max_change`, a positive number."""
    number = finite_number("max_change", max_change)
    if number <= 0:
        raise ArgumentError("max_change", "a positive number", max_change)
    return number


def _frame_names(tree: Tree, frame: str | None, given: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the frames that have targets, by default that of the only tip."""
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


def _vectors_of_targets(label: str, value: Any, *tail: int) -> Any:
    """Return positions or attitudes (..., *tail); the error on poses of other libraries says how to convert them."""
    try:
        return vectors(label, value, *tail)
    except ShapeError as error:
        shape, expected = np.shape(value), f"shape (..., {', '.join(map(str, tail))})"
        if shape[-2:] == (4, 4):
            expected += "; of poses T, 4 x 4, R is T[..., :3, 3] and S is T[..., :3, :3]"
        elif shape[-1:] == (4,) and label.startswith("S"):
            expected += "; R=hp.BodyMotion.from_quaternion_xyzw(R=..., quat_xyzw=...) takes a quaternion"
        else:
            raise
        raise ShapeError(label, expected, error.got) from None


def _read_target(
    tree: Tree, number: int, name: str, R: Any, S: Any, direction: Any, axis: Any, by_frame: bool
) -> _FrameTargets:
    """Return the checked targets of one frame, the one with this number; `by_frame`: arguments are dicts."""
    frame = tree.known_frame("frame", name)
    labels = {one: f"{one}[{name!r}]" if by_frame else one for one in ("R", "S", "direction", "axis")}
    given: list[Any] = [(one or {}).get(name) if by_frame else one for one in (R, S, direction)]
    if isinstance(given[0], BodyMotion | FrameState):
        if given[1] is not None:
            raise ArgumentError(labels["S"], f"None, since {labels['R']} has attitudes", quoted(given[1]))
        given[:2] = given[0].R, given[0].S
    place, attitude, toward = given
    goals: list[Goal] = []
    values: dict[str, Any] = {}
    if place is not None:
        goals.append(Position(number))
        values[labels["R"]] = _vectors_of_targets(labels["R"], place, 3)
    if attitude is not None and toward is not None:
        if by_frame or S is not None:
            raise ArgumentError(labels["direction"], f"None, since {labels['S']} is given", quoted(toward))
        attitude = None
    if attitude is not None:
        goals.append(Attitude(number))
        values[labels["S"]] = _vectors_of_targets(labels["S"], attitude, 3, 3)
        check_rotation(labels["S"], values[labels["S"]])
    if toward is not None:
        goals.append(Direction(number))
        values[labels["direction"]] = _unit_vectors(labels["direction"], vectors(labels["direction"], toward, 3))
        own = axis.get(name, (0, 0, 1)) if isinstance(axis, Mapping) else axis
        own = _unit_vectors(labels["axis"], one_constant(labels["axis"], own, 3))
        frame = Frame(frame.body, frame.R, frame.S @ _axes_about(own))
    return _FrameTargets(frame, tuple(goals), {label: np.asarray(one, np.float64) for label, one in values.items()})


def _unit_vectors(name: str, values: Any) -> Float64Array:
    """Return vectors of length 1; refuse zero, and leave those that are not finite as they are."""
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


def _read_posture(name: str, value: Any, tree: Tree, path: bool) -> Float64Array:
    """Return finite coordinates (..., dof), with an axis of one sample if there is one for each path."""
    array = tree.rows(name, value)
    if not np.isfinite(array).all():
        raise ArgumentError(name, "finite numbers", "NaN or infinity")
    return array[..., None, :] if path else array


def _read_limits(limits: Any, tree: Tree) -> Float64Array:
    """Return the argument `limits` as an array (dof, 2): the robot's own for True, infinite ones for False."""
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
    """Return for each frame the weights of a metre and of a radian of error, by default 1 / reach and 1."""
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
    lengths, travels, body = float(np.linalg.norm(frame.R)), [], frame.body
    while body:
        joint = tree.joints[body - 1]
        lengths += float(np.linalg.norm(joint.u))
        travels.append(joint.reach)
        body = joint.parent
    # Files write 999999 for no limit: what is much longer than the robot is none of its lengths.
    most = 10 * max(lengths, 1.0)
    return lengths + sum(travel for travel in travels if travel <= most) or 1.0


def _in_base_axes(target: _FrameTargets, base: BodyMotion | None, shape: tuple[int, ...]) -> Float64Array:
    """Return the numbers of a target for all samples, (N, size), in axes of the base and from its reference point."""
    columns = []
    for goal, values in zip(target.goals, target.values.values(), strict=True):
        rows = np.broadcast_to(values, (*shape, *goal.shape)).reshape(-1, *goal.shape)
        if base is not None:
            R1 = np.broadcast_to(base.R, (*shape, 3)).reshape(-1, 3).astype(np.float64)
            S1 = np.broadcast_to(base.S, (*shape, 3, 3)).reshape(-1, 3, 3).astype(np.float64)
            S1 = S1 if len(goal.shape) == 1 else S1[..., None]
            rows = rows - R1 if goal.is_length else rows
            # Not by matmul, which may add in another order in another batch.
            turned = [
                S1[:, 0, c] * rows[:, 0] + S1[:, 1, c] * rows[:, 1] + S1[:, 2, c] * rows[:, 2] for c in range(3)
            ]
            rows = np.stack(turned, axis=1)
        columns.append(rows.reshape(len(rows), goal.size))
    return np.concatenate(columns, axis=1)


def _solver(
    constants: RobotConstants,
    targets: Mapping[str, _FrameTargets],
    limits: Float64Array,
    reaches: Mapping[str, float],
    weights: Any,
) -> Solver:
    """Return the Solver of these goals, limits and weights, which is made at its first use and cached."""
    frames = tuple(target.frame for target in targets.values())
    goals = tuple(goal for target in targets.values() for goal in target.goals)
    pairs, lengths = _read_weights(weights, reaches), [*reaches.values()]
    counts = tuple(pairs[goal.frame][not goal.is_length] for goal in goals)
    key = tuple(targets), goals, counts, limits.tobytes(), tuple(frame.S.tobytes() for frame in frames)
    solvers: dict[Any, Solver] = constants.cache.others.setdefault("inverse_kinematics", {})
    solver = solvers.get(key)
    if solver is None:
        found = RobotComputation(constants, ("R", "S"), False, frames, (), None)
        numbers, own = found.known["constants"], tuple(lengths[goal.frame] for goal in goals)
        solver = Solver(found.form, found.request, numbers, goals, limits, own, counts)
        if len(solvers) >= _MAX_SOLVERS:
            solvers.clear()
        solvers[key] = solver
    return solver
