"""The motion of a mechanism: each joint's by an expression, way points or a log, that of the base by expressions.

A joint that nothing moves rests at 0, or at the limit that is closest to 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, NoReturn

import numpy as np

from hingepair.equations.quantities import ACCELERATION
from hingepair.errors import choices, nearest, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_of_rotations
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.motion.simulated import SimulatedRobotMotion
from hingepair.numeric.arrays import Float64Array
from hingepair.plans.pairs import SPACE
from hingepair.rotations.sequences import SEQUENCE_NAMES
from hingepair.scenes.instants import Instants, Rows, read_instants
from hingepair.scenes.motions.known import Derivatives, MotionByCoordinates
from hingepair.scenes.motions.logs import SMOOTHING_KEYS, Log, LogLayout, is_smoothed, log_path, smoothed
from hingepair.scenes.motions.motion import Motion
from hingepair.scenes.tables import Table

if TYPE_CHECKING:
    from hingepair.scenes.motions.functions import FunctionsOfTime

RATE_SUFFIXES: Final = ("", "d", "dd")
"""Suffixes of a joint's name in the columns of a log, by the order of the derivative."""
BASE_COORDINATES: Final = SPACE.coordinates[:-1]
"""Keys of the table [base] for the coordinates of the base."""
_OPTIONS: Final = ("constants", "file", "columns", "ignore", *SMOOTHING_KEYS)
"""Keys of [motion] that are options; every other key names a joint, and no joint may have one of these names."""
_CARRIER: Final = HingePair((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
"""A pair of which only body 1 counts: it stands for the base."""


_RESULT_PREFIXES: Final = frozenset({"R", "S", "quat", "d", "v", "omega", "a", "alpha", "tau", "force1", "torque1"})
"""Beginnings (up to the first _) of the names of columns that hold outputs other than coordinates of joints."""


class JointCoordinates(NamedTuple):
    """Coordinates (q, qd, qdd) of all joints at some instants, in the order of the mechanism's names; unknown
    derivatives are None.
    """

    #: shape (N, dof) rad or m
    q: Float64Array
    #: first derivatives
    qd: Float64Array | None = None
    #: second derivatives
    qdd: Float64Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class KnownJointMotion:
    """Motion of a robot's joints and base at some instants, as far as its derivatives are known."""

    #: names of the joints, in order
    names: tuple[str, ...]
    #: number of instants
    count: int
    #: (q[, qd[, qdd]]), tuples of one entry per joint: arrays of shape (count,), floats for what does not change
    derivatives: Derivatives
    #: motion of the base; shape (count,) or (). None where it rests at the origin
    base: BodyMotion | None

    @property
    def level(self) -> int:
        """Order of the highest known derivative: 0, 1 or 2."""
        return len(self.derivatives) - 1

    def column(self, order: int, joint: int) -> Float64Array:
        """Return the coordinate (`order` 0) of the joint with the index `joint`, or its derivative of that order;
        shape (count,).
        """
        return np.broadcast_to(np.asarray(self.derivatives[order][joint], dtype=np.float64), (self.count,))

    def array(self, order: int) -> Float64Array:
        """Return the coordinates (`order` 0) of all joints, or their derivatives of the given order; shape (count,
        dof).
        """
        columns = [self.column(order, joint) for joint in range(len(self.names))]
        return np.stack(columns, axis=-1) if columns else np.zeros((self.count, 0))

    def coordinates(self) -> dict[str, Float64Array]:
        """Return the coordinates of all joints by name; shape (count,) each."""
        return {name: self.column(0, i) for i, name in enumerate(self.names)}

    def arguments(self) -> tuple[Any, ...]:
        """Return (q[, qd[, qdd]]) as methods of Mechanism take them. Each is a dict by joint name, with an array for
        each joint or a float for a joint that does not move. For a robot without joints, each is an array of shape
        (count, 0).
        """
        if not self.names:
            return tuple(np.zeros((self.count, 0)) for _ in self.derivatives)
        rows = [dict(zip(self.names, values, strict=True)) for values in self.derivatives]
        if not any(np.ndim(value) for value in rows[0].values()):
            rows[0][self.names[0]] = self.column(0, 0)  # an array shows the number of instants
        return tuple(rows)


@dataclass(frozen=True, slots=True, eq=False)
class JointFunctions:
    """Motion of a robot's joints by functions of t; the others stay at rest."""

    #: instants [s]
    t: Instants
    #: functions of t of some joints, by the names of the joints
    functions: FunctionsOfTime
    #: rest position of each joint by name [rad or m]
    rests: dict[str, float]
    #: names of all joints, in order
    names: tuple[str, ...]
    level: int = ACCELERATION

    def part(self, rows: Rows, order: int) -> Derivatives:
        """Return (q[, qd[, qdd]]) up to `order` at the instants `rows`, an array or float for each joint."""
        moved = self.functions.derivatives(self.t[rows], order) if self.functions.names else ((),) * (order + 1)
        derivatives = []
        for k, values in enumerate(moved):
            rest = self.rests if k == 0 else dict.fromkeys(self.rests, 0.0)
            values_by_joint = {**rest, **dict(zip(self.functions.names, values, strict=True))}
            derivatives.append(tuple(values_by_joint[name] for name in self.names))
        return tuple(derivatives)


@dataclass(frozen=True, slots=True, eq=False)
class JointSamples:
    """Motion of a robot's joints by a log."""

    #: (q[, qd[, qdd]]), one entry per joint each: arrays, floats for what does not change
    derivatives: Derivatives

    @property
    def level(self) -> int:
        """Order of the highest derivative that there is: 0, 1 or 2."""
        return len(self.derivatives) - 1

    def part(self, rows: Rows, order: int) -> Derivatives:
        """Return (q[, qd[, qdd]]) up to `order` at the instants `rows`, an array or float for each joint."""
        return tuple(
            tuple(value[rows] if isinstance(value, np.ndarray) else value for value in values)
            for values in self.derivatives[: order + 1]
        )


@dataclass(frozen=True, slots=True, eq=False)
class BaseMotion:
    """Motion of a robot's base by functions of t."""

    #: of x, y, z, phi_x, phi_y, phi_z [m, rad]
    functions: FunctionsOfTime
    #: Euler sequence of the angles
    sequence: str

    def part(self, _: Rows, t: Float64Array, order: int) -> BodyMotion:
        """Return the motion of the base at the instants t, with derivatives up to `order`; shape (N,)."""
        return self.at(t, order)

    def at(self, t: Float64Array, order: int) -> BodyMotion:
        """Return the motion of the base at any instants t; shape (N,)."""
        rows = tuple((*row, 0.0) for row in self.functions.derivatives(t, order))
        return MotionByCoordinates(t.size, rows, self.sequence).in_space(_CARRIER).body1


@dataclass(frozen=True, slots=True, eq=False)
class SampledBase:
    """Motion of a robot's base by samples at the instants of a scene."""

    #: with all derivatives; shape (samples,)
    motion: BodyMotion

    def part(self, rows: Rows, _: Float64Array, order: int) -> BodyMotion:
        """Return the motion at the instants with the indices `rows`, with derivatives up to `order`."""
        letters = ("R", "S", "v", "omega", "a", "alpha")[: 2 * (order + 1)]
        return motion_of_rotations(**{letter: np.asarray(getattr(self.motion, letter))[rows] for letter in letters})


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class JointMotion(Motion):
    """Motion of a robot's joints and base at the instants of a scene."""

    #: names of all joints, in order
    names: tuple[str, ...]
    #: names of the joints that the scene moves
    moving: tuple[str, ...]
    #: motion of the base; None where it rests at the origin
    base: BaseMotion | SampledBase | None = None
    #: the simulated motion; None if the motion was not simulated
    simulated: SimulatedRobotMotion | None = None
    #: lower and upper stop of each joint of a simulated motion; infinite without stops
    stops: tuple[tuple[float, float], ...] = ()

    @property
    def description(self) -> str:
        """Where the motion comes from; of a simulated one also its steps and its estimated error."""
        if self.simulated is None:
            return self.origin
        return self.with_error(f"{self.origin} in {self.simulated.steps} steps, base {self.simulated.base}")

    def part(self, rows: Rows, order: int) -> KnownJointMotion:
        """Return the motion at the instants with the indices `rows`, with derivatives up to `order`."""
        t = np.asarray(self.t[rows])
        base = None if self.base is None else self.base.part(rows, t, order)
        return KnownJointMotion(self.names, t.size, self.source.part(rows, order), base)


def read_joint_motion(tables: Table, folder: Path, robot: Mechanism) -> JointMotion:
    """Return the JointMotion of a robot, a Mechanism, that the tables [motion], [base] and [time] define by functions
    of t or a log. The path of a log is relative to `folder`.
    """
    motion, base = tables.table("motion"), read_base(tables)
    check_joint_names(motion, robot)
    base_functions = (base.functions,) if base else ()
    if "file" in motion.values:
        if "time" in tables.values:
            tables.fail("time", "no such table, since the column t of motion.file has the instants")
        return replace(_read_joint_log(motion, folder, robot, base), functions=base_functions)
    for key in ("ignore", *SMOOTHING_KEYS):
        if key in motion.values:
            motion.fail(key, "no such key without file = ..., whose samples it concerns")
    from hingepair.scenes.motions.functions import read_functions

    moving = moving_joints(motion, robot)
    functions = read_functions(motion, moving)
    t = read_instants(tables.table("time"))
    source = JointFunctions(t, functions, _rest_positions(robot), robot.names)
    return JointMotion(
        t=t,
        source=source,
        origin="functions of t",
        functions=(functions, *base_functions),
        names=robot.names,
        moving=moving,
        base=base,
    )


def check_joint_names(motion: Table, robot: Mechanism, options: tuple[str, ...] = _OPTIONS) -> None:
    """Raise a SceneError if a joint of a robot has the name of an option of the Table [motion] or [dynamics], or a
    name for which a column of a log would have two meanings.
    """
    columns = {"t": "the instants"}
    for name in robot.names:
        if name in options:
            motion.refuse(name, f"joints of other names: this one is a key of [{motion.name}]", f"a joint {name!r}")
        for ending in RATE_SUFFIXES:
            column = name + ending
            if column in columns or _is_output(column, robot):
                wanted = f"joints of other names: column {column} of a file holds {columns.get(column, 'an output')}"
                motion.refuse(name, wanted, f"a joint {name!r}")
            columns[column] = f"q{ending} of {name!r}"


def _is_output(column: str, robot: Mechanism) -> bool:
    """Return whether a column of a file is an output other than a joint's coordinates, such as R_tool_x."""
    quantity, _, owner = column.partition("_")
    owners = {*robot.links, *tree_of(robot).frames, *robot.names}
    return quantity in _RESULT_PREFIXES and (
        quantity in {"force1", "torque1"} or bool(owners & {owner, owner.rpartition("_")[0]})
    )


def read_base(tables: Table) -> BaseMotion | None:
    """Return the BaseMotion of the table [base], in which missing coordinates are 0; None without the table."""
    if "base" not in tables.values:
        return None
    table = tables.table("base")
    table.check_keys((*BASE_COORDINATES, "sequence"))
    from hingepair.scenes.motions.functions import read_functions

    completed_table = replace(table, values=dict.fromkeys(BASE_COORDINATES, 0) | table.values)
    return BaseMotion(
        read_functions(completed_table, BASE_COORDINATES), table.choice("sequence", SEQUENCE_NAMES, "XYZ")
    )


def moving_joints(motion: Table, robot: Mechanism) -> tuple[str, ...]:
    """Return the joints that are keys of the Table [motion], in the robot's order; refuse other keys."""
    for key in motion.values:
        if key not in robot.names and key != "constants":
            refuse_joint(motion, key, robot)
    return tuple(name for name in robot.names if name in motion.values)


def refuse_joint(motion: Table, key: str, robot: Mechanism) -> NoReturn:
    """Raise a SceneError for a key of the Table [motion] that is not a movable joint of the robot."""
    joints = tree_of(robot).joints
    for joint in joints:
        if joint.name == key and joint.mimic is not None:
            leader = joints[joint.mimic.leader - 1].name
            motion.refuse(key, "a joint that moves by itself", f"one that follows {leader!r}, which may be moved")
    if key in tree_of(robot).frames or key in robot.links:
        motion.refuse(
            key, f"a joint that moves, {choices(robot.names)}", "a link, or a joint that is fixed or locked"
        )
    known_keys = (*robot.names, "file", "constants")
    expected = choices(robot.names) if robot.names else "no joint, since none moves"
    motion.refuse(key, expected + nearest(key, known_keys), f"{quoted(key)}, which is no joint of {robot.name}")


def _rest_positions(robot: Mechanism) -> dict[str, float]:
    """Return the rest position [rad or m] of each joint by name: 0, or the limit closest to 0."""
    limits = robot.position_limits.tolist()
    return {name: min(max(0.0, least), most) for name, (least, most) in zip(robot.names, limits, strict=True)}


def _read_joint_log(table: Table, folder: Path, robot: Mechanism, base: BaseMotion | None) -> JointMotion:
    """Return the JointMotion of the log that the Table [motion] names by a path relative to `folder`."""
    table.check_keys(_OPTIONS)
    smooths = is_smoothed(table)
    log = Log(log_path(table, folder), _joint_log_layout(robot), table)
    parts: dict[str, list[Float64Array]] = {}
    for joint in robot.names:
        names = tuple(joint + ending for ending in RATE_SUFFIXES)
        present_names = [name for name in names if name in log.columns]
        if present_names:
            part = log.quantity_and_rates(names)
            parts[joint] = [part[name] for name in names if name in part]
            if names[2] in part and names[1] not in part:
                log.refuse(names[1], f"a column, since the log has {names[2]}", "no such column")
    if not parts:
        log.refuse(robot.names[0] if robot.names else "t", "a column for each joint that moves", "none of them")
    level = max(map(len, parts.values())) - 1
    for joint, columns in parts.items():
        if len(columns) <= level:
            wanted = "a column, since the log has rates of other joints"
            log.refuse(joint + RATE_SUFFIXES[len(columns)], wanted, "no such column")
    if smooths:
        if level:
            rate = next(name for name in log.columns if name not in ("t", *robot.names))
            log.refuse(rate, "coordinates of joints alone, since motion.smooth is true", "a column")
        found = smoothed(table, log, {joint: columns[0] for joint, columns in parts.items()})
        parts = dict(zip(parts, found, strict=True))
        level = ACCELERATION
    rests = _rest_positions(robot)
    rows = tuple(
        tuple(_float_if_constant(parts[name][k]) if name in parts else rests[name] * (k == 0) for name in robot.names)
        for k in range(level + 1)
    )
    return JointMotion(
        t=log.t,
        source=JointSamples(rows),
        origin="samples in a file" + ", smoothed, with their rates" * smooths,
        hint=log.hint,
        notes=tuple(log.notes),
        names=robot.names,
        moving=tuple(parts),
        base=base,
    )


def _joint_log_layout(robot: Mechanism) -> LogLayout:
    """Return the LogLayout of a robot's log: one column for each joint's q, qd and qdd."""
    names = robot.names
    arrays = {f"q{ending}": tuple(name + ending for name in names) for ending in RATE_SUFFIXES}
    columns = tuple(dict.fromkeys(("t", *(column for group in arrays.values() for column in group))))
    arrays = {name: group for name, group in arrays.items() if name not in columns}  # a joint may be called q
    angle_names = frozenset(joint.name for joint in tree_of(robot).coordinates if joint.unit == "rad")
    writing_hint = "run --outputs q,qd,qdd --out FILE writes what is read here"
    judged = dict.fromkeys(sorted(angle_names), "angle")
    units = {
        joint.name + ending: joint.unit + per
        for joint in tree_of(robot).coordinates
        for ending, per in zip(RATE_SUFFIXES, ("", "/s", "/s^2"), strict=True)
    }
    return LogLayout(arrays, columns, angle_names, judged, _RESULT_PREFIXES, writing_hint, units)


def _float_if_constant(column: Float64Array) -> float | Float64Array:
    """Return a column, or one float if all its values are equal."""
    column = np.ascontiguousarray(column)
    return float(column[0]) if (column == column[0]).all() else column
