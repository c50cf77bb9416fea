"""What a scene asks of what moves in it."""

from __future__ import annotations

import abc
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.loops import OperationCounts
from hingepair.equations.quantities import ACCELERATION
from hingepair.mechanism.bodies.hinge_load import TORQUE_PARTS
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.tree import Joint
from hingepair.numeric.arrays import Float64Array
from hingepair.plans.pairs import PLANE, SPACE
from hingepair.scenes.motions.known import RATE_SUFFIXES, Known, Rows
from hingepair.scenes.motions.motion import LimitCounter, Motion
from hingepair.scenes.tables import Table

if TYPE_CHECKING:
    from hingepair.validation.report import CrossValidation

Arrays = dict[str, NDArray[Any]]
"""Arrays by name; shape (N, ...) for N instants."""


class Plan(NamedTuple):
    """Programs that compute the requested outputs."""

    outputs: tuple[str, ...]
    counts: list[OperationCounts]
    order: int  # of the derivatives that they need


@dataclass(frozen=True, slots=True, eq=False)
class Computed:
    """What was computed of a motion at some instants."""

    state: Any = None  # PairState, PlanarState or MechanismState; None if no output needs it
    forces: Any = None  # MechanismForces; None if none was requested


class Subject(abc.ABC):
    """What moves in a scene."""

    max_check_instants: ClassVar[int]  # that are compared with Pinocchio in a second or some
    noted: ClassVar[str]  # a cheap output, evaluated for the sake of the notes
    pair: HingePair | PlanarPair | None = None
    mechanism: Mechanism | None = None
    planar: bool = False

    @property
    def dimensions(self) -> int:
        """Number of components of a vector such as gravity."""
        return 2 if self.planar else 3

    @property
    @abc.abstractmethod
    def name(self) -> str:
        """Name of the pair or mechanism."""

    @property
    @abc.abstractmethod
    def robot(self) -> Mechanism:
        """The mechanism, or the pair as one with the joint psi."""

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Records of the joints that have a coordinate."""
        return tuple(tree_of(self.robot).coordinates)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints that have a coordinate."""
        return self.robot.names

    @property
    def base_names(self) -> tuple[str, ...]:
        """Keys of [motion] for the coordinates of body 1 or the base; not those that name joints."""
        names = (PLANE if self.planar else SPACE).coordinates[:-1]
        return names if self.names == ("psi",) or set(names).isdisjoint(self.names) else ()

    @property
    def rests(self) -> Mapping[str, float]:
        """Where joints without a motion rest [rad or m]: at 0, or at the limit closest to 0."""
        return {
            joint.name: min(max(0.0, joint.position_limits[0]), joint.position_limits[1]) for joint in self.joints
        }

    def moved_by(self, motion: Table) -> tuple[str, ...]:
        """Return the joints that are keys of the Table [motion], in order."""
        return tuple(name for name in self.names if name in motion.values)

    @abc.abstractmethod
    def check_motion_keys(self, motion: Table, further: Collection[str] = ()) -> None:
        """Refuse keys of [motion] other than those of joints, of the base and `further` options."""

    def unit_of_joint(self, column: str) -> str | None:
        """Return the unit of a joint's coordinate or of its derivative; None of another name."""
        for joint in self.joints:
            for ending, per in zip(RATE_SUFFIXES, ("", "/s", "/s^2"), strict=True):
                if column == joint.name + ending:
                    return joint.unit + per
        return None

    @abc.abstractmethod
    def unit(self, name: str) -> str:
        """Return the unit of an output, or of one of its components, such as R2_x or R_tool_x."""

    @abc.abstractmethod
    def request(self, outputs: Iterable[str] | None, motion: Motion) -> Any:
        """Return what is computed for these outputs, by default for what moves; refuse unknown ones, or outputs that
        need derivatives that the motion lacks.
        """

    @abc.abstractmethod
    def order(self, request: Any, level: int) -> int:
        """Return the order of the derivatives that a request needs."""

    @abc.abstractmethod
    def compute(self, request: Any, known: Known, acting: Acting, backend: str) -> Computed:
        """Compute the requested outputs of a known motion."""

    @abc.abstractmethod
    def arrays(self, request: Any, known: Known, computed: Computed) -> Arrays:
        """Return the requested outputs by name. Coordinates are named like columns of a log."""

    @abc.abstractmethod
    def attribute(self, name: str, known: Known, computed: Computed) -> Any:
        """Return an attribute of a result, such as R2; raise a KeyError for an unknown name."""

    @abc.abstractmethod
    def attribute_names(self, known: Known, computed: Computed) -> Iterable[str]:
        """Return the names of the attributes of a result."""

    @abc.abstractmethod
    def plan(self, request: Any, motion: Motion) -> Plan:
        """Return the programs that compute a request."""

    @abc.abstractmethod
    def forces(self, known: Known, acting: Acting) -> Arrays:
        """Return the forces that a motion with accelerations requires, by name."""

    @property
    @abc.abstractmethod
    def force_names(self) -> tuple[str, ...]:
        """Outputs that `forces` gives and `request` does not know."""

    @abc.abstractmethod
    def compare(self, known: Known, acting: Acting) -> CrossValidation:
        """Compare the equations, and loads of a simulated motion, with Pinocchio."""

    @abc.abstractmethod
    def describe(self, moving: tuple[str, ...]) -> str:
        """Return a line on what moves."""

    @abc.abstractmethod
    def facts(self, motion: Motion) -> dict[str, Any]:
        """Return what commands with --json print of what moves."""

    @abc.abstractmethod
    def rows(self, motion: Motion, outputs: tuple[str, ...] | None) -> list[tuple[str, str]]:
        """Return rows of a table on what moves, on the motion, and on the outputs."""

    def coincident_frames(self, _request: Any, _computed: Computed) -> dict[str, str]:
        """Return, by frame of a mechanism, the earlier frame that moves exactly as it."""
        return {}

    def watches(self, motion: Motion) -> list[LimitCounter]:
        """Return counters of the joints' positions and, where they are limited, rates."""
        from hingepair.mechanism.bodies.hinge_load import HingeLoad, stop_range

        watches = []
        for i, joint in enumerate(self.joints):
            limits = [joint.position_limits]
            if motion.level and np.isfinite(joint.rate_limit):
                limits.append((-joint.rate_limit, joint.rate_limit))
            for order, own in enumerate(limits):
                unit = joint.unit + "/s" * order
                stops = (-np.inf, np.inf) if order else stop_range(motion.loads.get(joint.name, HingeLoad()))
                watches.append(LimitCounter(joint.name + "'" * order, own, unit, _column(order, i), stops))
        return watches


@dataclass(frozen=True, slots=True, eq=False)
class Acting:
    """What acts on what moves at some instants, beside motors and what holds the base."""

    motion: Motion
    #: indices of the instants
    rows: Rows
    #: acceleration of free fall [m/s^2]; (3,)
    gravity: tuple[float, ...]

    def wrenches(self, known: Known) -> dict[str, tuple[Any, Any]] | None:
        """Return (force, torque) on links by name, world axes; None without any."""
        motion = self.motion
        if motion.simulated is not None:
            own = motion.simulated.wrenches
            return {link: (force[self.rows], torque[self.rows]) for link, (force, torque) in own.items()} or None
        t, now = np.asarray(motion.t[self.rows]), SimpleNamespace(q=known.array(0), qd=known.array(1))
        return {
            link: (_vectors(force, t, now), _vectors(torque, t, now))
            for link, (force, torque) in motion.wrenches.items()
        } or None

    def loads(self) -> Arrays:
        """Return the loads of a simulated motion by name; shape (N, ...)."""
        return {name: load[self.rows] for name, load in self.motion.simulated.loads.items()}

    def parts(self, known: Known) -> dict[str, Float64Array]:
        """Return the efforts of springs, dampers, friction and stops at the joints, as far as there are any; (N, dof)
        each.
        """
        if self.motion.simulated is not None:
            loads = self.loads()
            return {part: loads[part] for part in TORQUE_PARTS if part != "motor" and part in loads}
        found: dict[str, Float64Array] = {}
        for name, load in self.motion.loads.items():
            k = known.names.index(name)
            for part, effort in load.parts(0.0, known.column(0, k), known.column(1, k)).items():
                if part != "motor":
                    found.setdefault(part, np.zeros((known.count, len(known.names))))[:, k] = effort
        return found


def _vectors(load: Any, t: Float64Array, now: Any) -> Float64Array:
    """Return a force or torque at instants t; (N, 3)."""
    vectors = load(t, now) if callable(load) else load
    return np.broadcast_to(np.asarray(vectors, np.float64), (len(t), 3))


def compared_rates(motion: Motion, names: tuple[str, ...]) -> tuple[Any, ...]:
    """Return comparisons of the rates of a simulated motion with the slopes of its coordinates."""
    from hingepair.validation.cross_validate import compare_rates

    t = np.asarray(motion.t[:])
    known = motion.source.part(slice(len(t)), ACCELERATION)
    return tuple(compare_rates(t, [known.array(order) for order in range(3)], names))


def _column(order: int, joint: int) -> Any:
    return lambda known: known.column(order, joint)
