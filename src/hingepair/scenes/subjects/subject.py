"""What a scene asks of what moves in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.loops import OperationCounts
from hingepair.equations.quantities import ACCELERATION
from hingepair.mechanism.bodies.hinge_load import TORQUE_PARTS
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.tree import Joint
from hingepair.numeric.arrays import Float64Array
from hingepair.plans.pairs import PLANE, SPACE
from hingepair.scenes.motions.known import Known, Rows
from hingepair.scenes.motions.motion import Motion
from hingepair.scenes.tables import Table

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
    struts: Mapping[str, Any] = field(default_factory=dict)  # StrutState by name


class SubjectBase:
    """What pairs and mechanisms share as what moves in a scene."""

    planar = False
    #: the mechanism, or the pair as one with the joint psi
    robot: Mechanism

    @property
    def dimensions(self) -> int:
        """Number of components of a vector such as gravity."""
        return 2 if self.planar else 3

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
        return names if set(names).isdisjoint(self.names) else ()

    @property
    def rests(self) -> Mapping[str, float]:
        """Where joints without a motion rest [rad or m]: at 0, or at the limit closest to 0."""
        return {joint.name: float(np.clip(0.0, *joint.position_limits)) for joint in self.joints}

    def moved_by(self, motion: Table) -> tuple[str, ...]:
        """Return the joints that are keys of the Table [motion], in order."""
        return tuple(name for name in self.names if name in motion.values)


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
