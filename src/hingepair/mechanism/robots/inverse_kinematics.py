"""The arguments of inverse kinematics: targets of frames, limits, what solutions are to be near."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, NamedTuple, Unpack

import numpy as np

from hingepair.engine.backend import execution_of
from hingepair.engine.threads import run_in_threads
from hingepair.errors import ArgumentError, ShapeError, choices, quoted
from hingepair.inverse_kinematics.goals import (
    Attitude,
    CentreOfMass,
    Direction,
    Goal,
    Position,
    target_slices,
)
from hingepair.inverse_kinematics.paths import follow
from hingepair.inverse_kinematics.results import InverseKinematics, InverseKinematicsPath
from hingepair.inverse_kinematics.search import MAX_TRIALS, Solutions, Solver, Targets
from hingepair.mechanism.bodies.body_motion import AT_REST, BodyMotion
from hingepair.mechanism.building.changes import BASE_JOINTS, on_moved_base, tree_with_base_joints
from hingepair.mechanism.options import SEARCH_DEFAULTS, SearchOptions, check_options
from hingepair.mechanism.robots.computations import RobotComputation
from hingepair.mechanism.robots.constants import RobotConstants, axes_along, robot_constants
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
from hingepair.rotations.euler import euler_to_matrix
from hingepair.rotations.matrices import check_rotation

_MAX_SOLVERS: Final = 32  # that a robot keeps; one more replaces all
_OF_CALLS: Final = {"frame", "q0", "direction", "centre_of_mass", "coordinates", "relative_to", "base_motion"}


class Query(NamedTuple):
    """Checked arguments of inverse kinematics, and their answers."""

    solver: Solver
    targets: Targets  # of all samples in one row
    shape: tuple[int, ...]  # of the targets
    by_frame: bool  # whether targets were given by frame
    frames: int  # count of frames that have targets
    base: BodyMotion | None  # where a base starts that is solved for
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
        arrays = self.result_arrays(found, shape)
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
        arrays = self.result_arrays(found, self.shape)
        arrays |= {"jumps": jumps.reshape(self.shape), "steps": steps.reshape(self.shape)}
        return InverseKinematicsPath(arrays, self.shape)

    def result_arrays(self, found: Solutions, shape: tuple[int, ...]) -> dict[str, Any]:
        """Return coordinates and errors by the names of results."""
        q, errors = found.q.reshape(*shape, self.solver.dof), found.errors.reshape(*shape, len(self.solver.goals))
        arrays = _split_base(q, self.base, shape) | {"ok": found.ok.reshape(shape)}
        goals = self.solver.goals
        for name in dict.fromkeys(goal.error_name for goal in goals):
            columns = [k for k, goal in enumerate(goals) if goal.error_name == name]
            if name == "centre_of_mass_error":
                arrays[name] = errors[..., columns[0]]
            else:
                of_frames = np.zeros((*shape, self.frames))
                of_frames[..., [goals[k].frame for k in columns]] = errors[..., columns]
                arrays[name] = of_frames if self.by_frame else of_frames[..., 0]
        return arrays


def _split_base(q: Float64Array, base: BodyMotion | None, shape: tuple[int, ...]) -> dict[str, Any]:
    """Return q and, where the base was solved for from a pose, the pose found."""
    if base is None:
        return {"q": q}
    S1 = np.asarray(base.S, np.float64)
    S1, R1 = (one.reshape(*one.shape[: one.ndim - rank], *(1,) * (len(shape) - one.ndim + rank), *one.shape[-rank:])
              for one, rank in ((S1, 2), (np.asarray(base.R, np.float64), 1)))  # fmt: skip
    R = R1 + (S1 @ q[..., :3, None])[..., 0]
    return {"q": q[..., BASE_JOINTS:], "base_R": R, "base_S": S1 @ np.asarray(euler_to_matrix(q[..., 3:6]))}


class PreparedInverseKinematics:
    """Inverse kinematics of one target at a time, which `robot.prepare("inverse_kinematics", ...)` returns.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> robot = hp.load_robot("ur5_robot")
    >>> q = np.array([0.1, -1.2, 1.5, 0.3, 1.1, 0.2])
    >>> hand = robot.forward_kinematics(q, frames="tool0")["tool0"]
    >>> solve = robot.prepare("inverse_kinematics", frames="tool0")
    >>> found = solve(hand.R + (0, 0, 0.01), hand.S, q)
    >>> bool(found.ok), found.q.shape
    (True, (6,))
    """

    def __init__(
        self,
        tree: Tree,
        constants: RobotConstants,
        frames: str | Iterable[str] | None,
        outputs: Any,
        options: Mapping[str, Any],
    ) -> None:
        if outputs is not None:
            raise ArgumentError("outputs", "None, since q and errors are returned", quoted(outputs))
        check_options('prepare("inverse_kinematics")', options, SEARCH_DEFAULTS)
        for name in _OF_CALLS & options.keys():
            expected = "nothing: prepare takes frames=..., and its call the targets"
            raise ArgumentError(name, expected, quoted(options[name]))
        if not isinstance(prefer := options.get("prefer"), str | None) and np.ndim(prefer) != 1:
            raise ArgumentError("prefer", "one posture", quoted(prefer))
        self._tree, self._constants, self._options = tree, constants, options
        if frames is None and len(tree.tips) == 1:
            frames = tree.tips[0]
        self._single = isinstance(frames, str)  # one frame by its name: targets and errors have no axis of frames
        given = tree.tips if frames is None else (frames,) if isinstance(frames, str) else frames
        self.frames: tuple[str, ...] = tuple(given) if isinstance(given, Iterable) else ()
        if not self.frames:
            raise ArgumentError("frames", "names of links or joints", quoted(frames))
        self._queries: dict[tuple[bool, bool], Query] = {}

    def _query(self, has_R: bool, has_S: bool) -> Query:
        """Return the arguments for targets of these kinds, with poses of no meaning."""
        query = self._queries.get((has_R, has_S))
        if query is None:
            R = {name: np.zeros(3) for name in self.frames} if has_R else None
            S = {name: np.eye(3) for name in self.frames} if has_S else None
            query = read_query(self._tree, self._constants, R, S, "inverse_kinematics", **self._options)
            self._queries[has_R, has_S] = query
        return query

    def __call__(
        self, R: Any = None, S: Any = None, q0: Any = None, base_motion: BodyMotion | None = None
    ) -> InverseKinematics:
        """Return coordinates at which the frames have wanted poses: steps lead there from q0, or else from other
        starts.

        Args:
            R: wanted positions [m]; shape (3,) of a single frame, (frames, 3) of a tuple; or None. Errors have an
                axis of frames where targets have one.
            S: wanted rotation matrices; shape (3, 3), (frames, 3, 3), or None.
            q0: coordinates at which the search begins; shape (dof,). By default those in the middle of the limits.
            base_motion: pose of the base, or the one at which it begins where it is solved for.

        Raises:
            ArgumentError: q0 is not finite, or no target is given.
            ShapeError: R, S or q0 is not that of one target.
        """
        query = self._query(R is not None, S is not None)
        solver, lead = query.solver, () if self._single else (len(self.frames),)
        given: list[Float64Array] = []  # by frame
        if R is not None:
            given.append(_checked_target("R", R, (*lead, 3)).reshape(len(self.frames), 3))
        if S is not None:
            turns = _checked_target("S", S, (*lead, 3, 3))
            check_rotation("S", turns)
            given.append(turns.reshape(len(self.frames), 9))
        pose = np.concatenate(given, axis=1).ravel()
        if base_motion is not None:
            parts = zip(solver.goals, target_slices(solver.goals), strict=True)
            targets = [_Target(goal, "", pose[part].reshape(goal.shape)) for goal, part in parts]
            pose = np.concatenate([_in_base_axes(one, _checked_base(base_motion), ())[0] for one in targets])
        near, count = solver.middle, len(self._constants.names)
        if q0 is not None:
            near = np.zeros(solver.dof)
            near[solver.dof - count :] = _checked_target("q0", q0, (count,))
            if not np.isfinite(near).all():
                raise ArgumentError("q0", "finite numbers", "NaN or infinity")
        one = query.targets._replace(poses=pose[None], near=near[None])
        found, steps, starts = solver.one(one, near, query.seed)
        start = None if query.base is None else base_motion or query.base
        arrays = query._replace(by_frame=np.ndim(R) == 2 or np.ndim(S) == 3, base=start).result_arrays(found, ())
        return InverseKinematics({**arrays, "steps": np.int64(steps), "starts": np.int64(starts)}, ())

    def __repr__(self) -> str:
        return f"PreparedInverseKinematics(frames={self.frames})"


def _checked_target(name: str, value: Any, shape: tuple[int, ...]) -> Float64Array:
    array = real_array(name, value).astype(np.float64, copy=False)
    if shape not in (array.shape, (1, *array.shape)):
        raise ShapeError(name, f"shape {shape}, one target", f"shape {array.shape}")
    return array


def _checked_base(base: Any) -> BodyMotion:
    if not isinstance(base, BodyMotion) or base.S is None:
        raise ArgumentError("base_motion", "a BodyMotion with R and S", quoted(base))
    return base


class _Target(NamedTuple):
    """A goal, and its targets of all samples."""

    goal: Goal
    label: str  # the argument that has them
    values: Float64Array  # (..., *goal.shape)


def read_query(
    tree: Tree, constants: RobotConstants, R: Any, S: Any, method: str, **options: Unpack[SearchOptions]
) -> Query:
    """Return the checked arguments of a method of inverse kinematics; all but q0 of paths have samples."""
    check_options(method, options, SEARCH_DEFAULTS)
    path = method == "inverse_kinematics_path"
    given: dict[str, Any] = {**SEARCH_DEFAULTS, **options}
    q0, prefer, base_motion, seed = (given[name] for name in ("q0", "prefer", "base_motion", "seed"))
    if tree.samples is not None and tree.samples.lengths:
        tree.single()
    workers = execution_of("auto", given["workers"]).workers
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or seed < 0:
        raise ArgumentError("seed", "an integer from 0", quoted(seed))
    check_choice("base", given["base"], ("hold", "solve"))
    solves = given["base"] == "solve"
    if solves and not constants.free:
        raise ArgumentError("base", '"hold", since the base is fixed (with_base("free") frees it)', quoted("solve"))
    if not constants.names and not solves:
        raise ArgumentError("robot", "a joint that moves", "none")
    tolerances = [number_not_below_0(name, given[name]) for name in ("position_tolerance", "angle_tolerance")]
    by_frame, count, frames, targets = _read_targets(tree, R, S, given)
    shapes = {one.label: one.values.shape[: one.values.ndim - len(one.goal.shape)] for one in targets}
    near = None if q0 is None else _read_posture("q0", q0, tree, path)
    posture = None if prefer is None or isinstance(prefer, str) else _read_posture("prefer", prefer, tree, False)
    shapes |= {name: one.shape[:-1] for name, one in (("q0", near), ("prefer", posture)) if one is not None}
    limits = _read_limits(given["limits"], tree)
    fixed = _read_fixed(given["coordinates"], tree, limits, path)
    shapes |= {label: value.shape for label, value in fixed.values()}
    if isinstance(prefer, str):
        check_choice("prefer", prefer, ("middle",))
    if base_motion is not None:
        shapes["base_motion"] = _checked_base(base_motion).shape
    shape = broadcast_shape(shapes)
    if path and not shape:
        raise ShapeError("R", "an axis of samples, shape (..., samples, 3)", "one target")

    solver = _solver(constants, frames, [one.goal for one in targets], limits, tuple(sorted(fixed)), solves)
    poses = np.concatenate([_in_base_axes(one, base_motion, shape) for one in targets], axis=1)
    middle = solver.middle[solver.dof - len(constants.names) :]
    if isinstance(prefer, str):
        posture = middle
    if near is None and (solves or fixed):  # a solution is wanted near where the base starts
        near = middle
    if near is not None and fixed:
        near = np.array(np.broadcast_to(near, (*shape, len(middle))))
        for column, (_, value) in fixed.items():
            near[..., column] = value
    near, posture = (_rows_of(one, shape, solver.dof) for one in (near, posture))
    start = (base_motion or AT_REST) if solves else None
    return Query(
        solver, Targets(poses, near, posture, *tolerances), shape, by_frame, count, start, int(seed), workers
    )


def _rows_of(posture: Float64Array | None, shape: tuple[int, ...], size: int) -> Float64Array | None:
    """Return coordinates for all samples, (N, size), those of a base 0; None for None."""
    if posture is None:
        return None
    rows = np.zeros((*shape, size))
    rows[..., size - posture.shape[-1] :] = posture
    return rows.reshape(-1, size)


def _read_fixed(
    coordinates: Any, tree: Tree, limits: Float64Array, path: bool
) -> dict[int, tuple[str, Float64Array]]:
    """Return the joints that do not move by column: the name of the argument that says so, and where they stand."""
    found = {}
    if not isinstance(coordinates, Mapping | None):
        raise ArgumentError("coordinates", "a dict of values by joint", quoted(coordinates))
    for name, value in (coordinates or {}).items():
        column, label = tree.column("coordinates", name), f"coordinates[{name!r}]"
        array = np.asarray(finite_number(label, value) if path else real_array(label, value), np.float64)
        found[column] = label, array
        low, high = limits[column]
        if not ((low <= array) & (array <= high)).all():
            raise ArgumentError(label, f"values within the limits, {low:g} to {high:g}", quoted(value))
    return found


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


def _by_frame(tree: Tree, R: Any, S: Any, given: Mapping[str, Any]) -> tuple[bool, dict[str, dict[str, Any]]]:
    """Return whether targets were given by frame, and R, S and direction, as far as given, by frame."""
    arguments = {"R": R, "S": S, "direction": given["direction"]}
    arguments = {name: value for name, value in arguments.items() if value is not None}
    frame = given["frame"]
    if any(isinstance(value, Mapping) for value in arguments.values()):
        if frame is not None:
            raise ArgumentError("frame", "None, since the targets are given by frame", quoted(frame))
        for name, value in arguments.items():
            if not isinstance(value, Mapping) or not value:
                raise ArgumentError(name, "a dict by frame, as the other targets", quoted(value))
        return True, arguments
    if not arguments and given["centre_of_mass"] is None:
        raise ArgumentError("R", "positions, or attitudes in S or direction", None)
    if arguments and frame is None and len(tree.tips) != 1:
        expected = f"the name of a link or joint, since the robot has several tips: {', '.join(tree.tips)}"
        raise ArgumentError("frame", expected, None)
    return False, {name: {tree.tips[0] if frame is None else frame: value} for name, value in arguments.items()}


def _read_targets(
    tree: Tree, R: Any, S: Any, given: Mapping[str, Any]
) -> tuple[bool, int, dict[tuple[str, str], Frame], list[_Target]]:
    """Return whether targets were given by frame, the count of frames that have some, the frames that goals compare,
    by name and role, and all targets.
    """
    by_frame, arguments = _by_frame(tree, R, S, given)
    names = [*dict.fromkeys(name for value in arguments.values() for name in value)]
    frames = {(name, ""): tree.known_frame("frame", name) for name in names}
    relative_to = given["relative_to"]
    origins = relative_to if isinstance(relative_to, Mapping) else dict.fromkeys(names, relative_to)
    for name in origins:
        if name not in names:
            raise ArgumentError("relative_to", choices(names), quoted(name))
    targets: list[_Target] = []
    for number, name in enumerate(names):
        own = {one: value[name] for one, value in arguments.items() if name in value}
        labels = {one: f"{one}[{name!r}]" if by_frame else one for one in ("R", "S", "direction", "axis")}
        place, origin = None, origins.get(name)
        if origin is not None:
            frames.setdefault((origin, "from"), tree.known_frame("relative_to", origin))
            place = [*frames].index((origin, "from"))
        targets += [_Target(kind(number, place), label, values) for kind, label, values in _of_frame(own, labels)]
        if "direction" in own:  # of the z axis of a turned frame
            frame, axis = frames[name, ""], given["axis"]
            axis = axis.get(name, (0, 0, 1)) if isinstance(axis, Mapping) else axis
            axis = _unit_vectors(labels["axis"], one_constant(labels["axis"], axis, 3))
            frames[name, ""] = Frame(frame.body, frame.R, frame.S @ axes_along(axis))
    if given["centre_of_mass"] is not None:
        tree.single()
        values = vectors("centre_of_mass", given["centre_of_mass"], 3).astype(np.float64)
        targets.append(_Target(CentreOfMass(-1), "centre_of_mass", values))
    return by_frame, len(names), frames, targets


def _of_frame(given: Mapping[str, Any], labels: Mapping[str, str]) -> Iterator[tuple[type[Goal], str, Float64Array]]:
    """Yield the kinds of the targets of a frame, the arguments that they are of, and their numbers."""
    R, S, toward = (given.get(one) for one in ("R", "S", "direction"))
    if S is not None and (toward is not None or isinstance(R, BodyMotion | FrameState)):
        raise ArgumentError(labels["S"], "None, since an attitude or a direction is given beside it", quoted(S))
    if isinstance(R, BodyMotion | FrameState):
        state: Any = R
        R, S = state.R, state.S if toward is None else None
    if R is not None:
        yield Position, labels["R"], np.asarray(vectors(labels["R"], R, 3), np.float64)
    if S is not None:
        turns = np.asarray(vectors(labels["S"], S, 3, 3), np.float64)
        check_rotation(labels["S"], turns)
        yield Attitude, labels["S"], turns
    if toward is not None:
        yield (
            Direction,
            labels["direction"],
            _unit_vectors(labels["direction"], vectors(labels["direction"], toward, 3)),
        )


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


def _in_base_axes(target: _Target, base: BodyMotion | None, shape: tuple[int, ...]) -> Float64Array:
    """Return the numbers of a target for all samples, (N, size), in axes of the base and from its reference point."""
    goal = target.goal
    rows = np.broadcast_to(target.values, (*shape, *goal.shape)).reshape(-1, *goal.shape)
    if base is not None and goal.seen_from is None and goal.shape:
        R1 = np.broadcast_to(base.R, (*shape, 3)).reshape(-1, 3).astype(np.float64)
        S1 = np.broadcast_to(base.S, (*shape, 3, 3)).reshape(-1, 3, 3).astype(np.float64)
        S1 = S1 if len(goal.shape) == 1 else S1[..., None]
        rows = rows - R1 if goal.is_length else rows
        # Not by matmul, which may add in another order in another batch.
        turned = [S1[:, 0, c] * rows[:, 0] + S1[:, 1, c] * rows[:, 1] + S1[:, 2, c] * rows[:, 2] for c in range(3)]
        rows = np.stack(turned, axis=1)
    return rows.reshape(len(rows), goal.size)


def _solver(
    constants: RobotConstants,
    frames: Mapping[tuple[str, str], Frame],
    goals: list[Goal],
    limits: Float64Array,
    held: tuple[int, ...],
    solves: bool,
) -> Solver:
    """Return the Solver of these goals and limits, which is made at its first use and cached."""
    tree, own = constants.tree, [*frames.values()]
    lengths = [_reach(tree, frame) for frame in own]
    whole = max([*lengths, *(_reach(tree, tree.known_frame("frame", tip)) for tip in tree.tips)])
    reaches = [lengths[goal.frame] if goal.frames else whole for goal in goals]
    # A metre of error counts as a radian where it is as long as the chain is.
    counts = [1 / reach if goal.is_length else 1.0 for goal, reach in zip(goals, reaches, strict=True)]
    axes = tuple(frame.S.tobytes() for frame in own)
    key = tuple(frames), tuple(goals), limits.tobytes(), held, solves, axes
    solvers: dict[Any, Solver] = constants.cache.others.setdefault("inverse_kinematics", {})
    solver = solvers.get(key)
    if solver is None:
        if solves:
            free = np.broadcast_to((-np.inf, np.inf), (BASE_JOINTS, 2))
            constants = robot_constants(tree_with_base_joints(tree), free=False)
            own, limits = [on_moved_base(frame) for frame in own], np.concatenate([free, limits])
            held = tuple(column + BASE_JOINTS for column in held)
        found = RobotComputation(constants, ("R", "S"), tuple(own))
        request, numbers = found.request._replace(free=False), found.known["constants"]  # no velocities of the base
        solver = Solver(found.form, request, numbers, tuple(goals), limits, tuple(reaches), counts, held)
        if len(solvers) >= _MAX_SOLVERS:
            solvers.clear()
        solvers[key] = solver
    return solver
