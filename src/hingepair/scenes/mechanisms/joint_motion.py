"""The motion of a mechanism: each joint's by an expression, way points or a log, that of the base by expressions.

A joint that nothing moves rests at 0, or at the limit that is closest to 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, NoReturn, Protocol

import numpy as np

from hingepair.errors import choices, nearest, quoted
from hingepair.mechanism.mechanism import Mechanism
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.suspicions import angle_suspicions
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_pair import HingePair
from hingepair.plans.plan import ACCELERATION
from hingepair.plans.steps import COORDINATES
from hingepair.rotations.sequences import SEQUENCES
from hingepair.scenes.instants import Instants, Rows, read_instants
from hingepair.scenes.known_motion import ByCoordinates, Derivatives
from hingepair.scenes.logged_motion import Layout, Log, log_file
from hingepair.scenes.tables import Table

if TYPE_CHECKING:
    from hingepair.scenes.expression_motion import FunctionsOfTime

RATES: Final = ("", "d", "dd")
"""What is behind a joint's name in the columns of a log, by the order of the derivative."""
BASE_KEYS: Final = COORDINATES[:-1]
"""The coordinates of the base, in the table [base]."""
_JOINT_OPTION_KEYS: Final = ("constants", "file", "differentiate", "unwrap")
"""Keys of [motion] that are options; every other key names a joint, and no joint may have one of these names."""
_CARRIER: Final = HingePair((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
"""A pair whose body 1 stands for the base."""


class JointCoordinates(NamedTuple):
    """Coordinates of all joints at some instants, in the order of the mechanism's names; None where not known.

    Attributes:
        q: shape (N, dof) rad or m.
        qd: first derivatives.
        qdd: second derivatives.
    """

    q: Float64Array
    qd: Float64Array | None = None
    qdd: Float64Array | None = None


@dataclass(frozen=True, slots=True, eq=False)
class KnownJoints:
    """The coordinates of a mechanism and the motion of its base at some instants.

    Attributes:
        names: of the joints, in order.
        count: number of instants.
        derivatives: (q[, qd[, qdd]]), tuples of one entry per joint: arrays of shape (count,), floats for what does
            not change.
        base: motion of the base; shape (count,) or (). None where it rests at the origin.
    """

    names: tuple[str, ...]
    count: int
    derivatives: Derivatives
    base: BodyMotion | None

    @property
    def level(self) -> int:
        """The highest derivative that is known."""
        return len(self.derivatives) - 1

    def column(self, order: int, joint: int) -> Float64Array:
        """Return one joint's coordinate, or a derivative of it; shape (count,)."""
        return np.broadcast_to(np.asarray(self.derivatives[order][joint], dtype=np.float64), (self.count,))

    def array(self, order: int) -> Float64Array:
        """Return the coordinates of all joints, or a derivative of them; shape (count, dof)."""
        columns = [self.column(order, joint) for joint in range(len(self.names))]
        return np.stack(columns, axis=-1) if columns else np.zeros((self.count, 0))

    def arguments(self) -> tuple[Any, ...]:
        """Return q, and as far as known qd and qdd, as a Mechanism takes them: numbers are known constants."""
        if not self.names:
            return tuple(np.zeros((self.count, 0)) for _ in self.derivatives)
        rows = [dict(zip(self.names, values, strict=True)) for values in self.derivatives]
        if not any(np.ndim(value) for value in rows[0].values()):
            rows[0][self.names[0]] = self.column(0, 0)  # an array shows the number of instants
        return tuple(rows)


class GivenJoints(Protocol):
    """Coordinates of joints at all instants, of which it gives some."""

    @property
    def level(self) -> int:
        """The highest derivative that there is."""

    def part(self, rows: Rows, order: int, /) -> Derivatives:
        """Return (q, qd, qdd) at some of the instants up to an order, a tuple with one entry per joint each."""


@dataclass(frozen=True, slots=True, eq=False)
class JointFunctions:
    """Coordinates of joints as functions of t, at any instants.

    Attributes:
        t: instants [s].
        functions: of the joints that are named.
        rests: by name, where each joint rests that is not named [rad or m].
        names: of all joints, in order.
    """

    t: Instants
    functions: FunctionsOfTime
    rests: dict[str, float]
    names: tuple[str, ...]
    level: int = ACCELERATION

    def part(self, rows: Rows, order: int) -> Derivatives:
        """Compute the coordinates at some of the instants, with derivatives up to an order."""
        moved = self.functions.derivatives(self.t[rows], order) if self.functions.names else ((),) * (order + 1)
        derivatives = []
        for k, values in enumerate(moved):
            rest = self.rests if k == 0 else dict.fromkeys(self.rests, 0.0)
            known = {**rest, **dict(zip(self.functions.names, values, strict=True))}
            derivatives.append(tuple(known[name] for name in self.names))
        return tuple(derivatives)


@dataclass(frozen=True, slots=True, eq=False)
class JointSamples:
    """Coordinates of joints as a log has them.

    Attributes:
        derivatives: (q[, qd[, qdd]]), one entry per joint each: arrays, floats for what does not change.
    """

    derivatives: Derivatives

    @property
    def level(self) -> int:
        """The highest derivative that there is."""
        return len(self.derivatives) - 1

    def part(self, rows: Rows, order: int) -> Derivatives:
        """Return the coordinates at some of the instants, with derivatives up to an order."""
        return tuple(
            tuple(value[rows] if isinstance(value, np.ndarray) else value for value in values)
            for values in self.derivatives[: order + 1]
        )


@dataclass(frozen=True, slots=True, eq=False)
class BaseMotion:
    """The motion of the base by its position and Euler angles.

    Attributes:
        functions: of x, y, z, phi_x, phi_y, phi_z [m, rad].
        sequence: of the angles.
    """

    functions: FunctionsOfTime
    sequence: str

    def at(self, t: Float64Array, order: int) -> BodyMotion:
        """Compute the motion of the base at instants, with derivatives up to an order; shape (N,)."""
        rows = tuple((*row, 0.0) for row in self.functions.derivatives(t, order))
        return ByCoordinates(t.size, rows, self.sequence).in_space(_CARRIER).body1


@dataclass(frozen=True, slots=True, eq=False)
class JointMotion:
    """The motion of a mechanism at instants, and what a reader of it should know.

    Attributes:
        t: instants [s].
        given: the coordinates of the joints at all of them.
        base: motion of the base; None where it rests at the origin.
        moving: names of the joints that the scene moves.
        origin: where the motion comes from, in words.
        hint: how to get derivatives that are missing, for messages.
        functions: of t that it is made of; they know where they switch.
        notes: sentences that every reader of the results should see.
        derived: names of the rates of a log that were found by finite differences, such as boomdd; None of what is
            no log.
    """

    t: Instants
    given: GivenJoints
    base: BaseMotion | None
    moving: tuple[str, ...]
    origin: str
    hint: str = ""
    functions: tuple[FunctionsOfTime, ...] = ()
    notes: tuple[str, ...] = ()
    derived: tuple[str, ...] | None = None

    @property
    def level(self) -> int:
        """The highest derivative that there is."""
        return self.given.level

    def part(self, names: tuple[str, ...], rows: Rows, order: int) -> KnownJoints:
        """Return the motion at some of the instants, with derivatives up to an order."""
        t = np.asarray(self.t[rows])
        base = None if self.base is None else self.base.at(t, order)
        return KnownJoints(names, t.size, self.given.part(rows, order), base)

    def kinks(self, start: int, stop: int) -> int:
        """Return the number of intervals that end at these instants and hold a kink or a jump of a function of t."""
        t = self.t[max(start - 1, 0) : stop]
        switched = np.zeros(max(0, t.size - 1), dtype=bool)
        for functions in self.functions:
            switched |= functions.switches(t)
        return int(switched.sum())


def read_joint_motion(tables: Table, folder: Path, robot: Mechanism) -> JointMotion:
    """Read the motion of the tables [motion], [base] and [time]; files are relative to the folder."""
    motion, base = tables.table("motion"), _read_base(tables)
    _check_joint_names(motion, robot)
    of_base = (base.functions,) if base else ()
    if "file" in motion.values:
        if "time" in tables.values:
            tables.fail("time", "no such table beside motion.file, whose column t has the instants")
        return replace(_read_log(motion, folder, robot, base), functions=of_base)
    for key in ("differentiate", "unwrap"):
        if key in motion.values:
            motion.fail(key, "file = ... beside it, whose samples it is about, or no such key")
    from hingepair.scenes.expression_motion import read_functions

    moving = _moving(motion, robot)
    functions = read_functions(motion, moving)
    t = read_instants(tables.table("time"))
    given = JointFunctions(t, functions, _rests(robot), robot.names)
    return JointMotion(t, given, base, moving, "functions of t", functions=(functions, *of_base))


def _check_joint_names(motion: Table, robot: Mechanism) -> None:
    """Refuse joints whose names are keys of [motion], or whose columns in a file are those of others."""
    columns = {"t": "the instants"}
    for name in robot.names:
        if name in _JOINT_OPTION_KEYS:
            motion.refuse(name, "joints of other names: this one is a key of [motion]", f"a joint {name!r}")
        for ending in RATES:
            column = name + ending
            if column in columns:
                wanted = f"joints of other names: column {column} of a file holds {columns[column]}"
                motion.refuse(name, wanted, f"a joint {name!r}")
            columns[column] = f"q{ending} of {name!r}"


def _read_base(tables: Table) -> BaseMotion | None:
    """Read the table [base]; None where there is none."""
    if "base" not in tables.values:
        return None
    table = tables.table("base")
    table.check_keys((*BASE_KEYS, "sequence"))
    from hingepair.scenes.expression_motion import read_functions

    given = replace(table, values=dict.fromkeys(BASE_KEYS, 0) | table.values)
    return BaseMotion(read_functions(given, BASE_KEYS), table.choice("sequence", SEQUENCES, "XYZ"))


def _moving(motion: Table, robot: Mechanism) -> tuple[str, ...]:
    """Return the joints that [motion] moves, in the robot's order; refuse keys that are none."""
    for key in motion.values:
        if key not in robot.names and key != "constants":
            _refuse_joint(motion, key, robot)
    return tuple(name for name in robot.names if name in motion.values)


def _refuse_joint(motion: Table, key: str, robot: Mechanism) -> NoReturn:
    """Refuse a key of [motion] that is no joint which moves by itself, and say why it is none."""
    joints = robot.tree.joints
    for joint in joints:
        if joint.name == key and joint.mimic is not None:
            leader = joints[joint.mimic.leader - 1].name
            motion.refuse(key, "a joint that moves by itself", f"one that follows {leader!r}, which may be moved")
    if key in robot.tree.frames or key in robot.links:
        motion.refuse(
            key, f"a joint that moves, {choices(robot.names)}", "a link, or a joint that is fixed or locked"
        )
    known = (*robot.names, "file", "constants")
    expected = choices(robot.names) if robot.names else "no joint, since none moves"
    motion.refuse(key, expected + nearest(key, known), f"{quoted(key)}, which is no joint of {robot.name}")


def _rests(robot: Mechanism) -> dict[str, float]:
    """Return where each joint rests: at 0, or at the limit that is closest to 0."""
    limits = robot.position_limits.tolist()
    return {name: min(max(0.0, least), most) for name, (least, most) in zip(robot.names, limits, strict=True)}


def _read_log(table: Table, folder: Path, robot: Mechanism, base: BaseMotion | None) -> JointMotion:
    """Read a log with a column a joint, by the joint's name, and its rates behind d and dd."""
    completed = table.flag("differentiate")
    unwrap = table.flag("unwrap") if "unwrap" in table.values else None
    if unwrap is not None and not completed:
        wanted = "differentiate = true beside it, or no such key: it decides how angles are differentiated"
        table.fail("unwrap", wanted)
    table.check_keys(_JOINT_OPTION_KEYS)
    log = Log(log_file(table, folder), _layout(robot), completed, unwrap)
    parts: dict[str, list[Float64Array]] = {}
    for joint in robot.names:
        names = tuple(joint + ending for ending in RATES)
        there = [name for name in names if name in log.columns]
        if there:
            part = log.part(names)
            parts[joint] = [part[name] for name in names if name in part]
            if names[2] in part and names[1] not in part:
                log.refuse(names[1], f"a column beside {names[2]}", "no such column")
            if joint in log.layout.angles:
                log.notes += angle_suspicions(joint, parts[joint][0])
    if not parts:
        log.refuse(robot.names[0] if robot.names else "t", "a column for each joint that moves", "none of them")
    level = max(map(len, parts.values())) - 1
    for joint, columns in parts.items():
        if len(columns) <= level:
            wanted = "a column, beside rates of other joints (or differentiate = true)"
            log.refuse(joint + RATES[len(columns)], wanted, "no such column")
    derived = tuple(joint + rate for joint in parts for rate in RATES[1:] if joint + rate in log.derived)
    rests = _rests(robot)
    rows = tuple(
        tuple(_plain(parts[name][k]) if name in parts else rests[name] * (k == 0) for name in robot.names)
        for k in range(level + 1)
    )
    notes = [*log.notes, *filter(None, [log.lacking_errors()])]
    origin = "samples in a file" + ", rates by finite differences" * bool(derived)
    hint = log.hint
    return JointMotion(log.t, JointSamples(rows), base, tuple(parts), origin, hint, (), tuple(notes), derived)


def _layout(robot: Mechanism) -> Layout:
    """Return what the columns of a log of a robot may be."""
    names = robot.names
    arrays = {f"q{ending}": tuple(name + ending for name in names) for ending in RATES}
    columns = tuple(dict.fromkeys(("t", *(column for group in arrays.values() for column in group))))
    angles = frozenset(joint.name for joint in robot.tree.coordinates if joint.kind == "hinge")
    written = "run --outputs q,qd,qdd --out FILE writes what is read here"
    results = frozenset({"R", "S", "d", "v", "omega", "a", "alpha", "tau", "force1", "torque1"})
    return Layout(arrays, columns, angles, results, written)


def _plain(column: Float64Array) -> float | Float64Array:
    """Return a column as one number where it never changes."""
    column = np.ascontiguousarray(column)
    return float(column[0]) if (column == column[0]).all() else column
