"""The forces that the motion of a mechanism takes (T1-T3): motors' beside their limits, and the base's reaction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.tree import Joint
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.tables import Sheet, cell, instant
from hingepair.pair.results import Record
from hingepair.scenes.mechanisms.joint_motion import KnownJoints

_HEADINGS = (
    *("joint", "unit", "rms", "max |tau|", "at t", "limit", "of it"),
    *("least q", "limit", "largest q", "limit", "max |q'|", "limit"),
)


@dataclass(frozen=True, slots=True)
class JointLoad:
    """What the motion takes of a joint, beside the joint's limits, which are infinite where there are none.

    Attributes:
        joint: its name.
        kind: "hinge" or "slider".
        rms: root mean square of the motor's torque [N m], of a slider force [N]; NaN where none is finite.
        largest: largest size of it.
        t_of_largest: when [s].
        effort_limit: largest size that the motor gives.
        beyond: number of instants at which it is more.
        t_of_first: the first of them [s]; NaN where there is none.
        position: least and greatest coordinate [rad or m].
        position_limits: of it.
        rate: largest size of the rate [rad/s or m/s].
        rate_limit: of it.
    """

    joint: str
    kind: str
    rms: float
    largest: float
    t_of_largest: float
    effort_limit: float
    beyond: int
    t_of_first: float
    position: tuple[float, float]
    position_limits: tuple[float, float]
    rate: float
    rate_limit: float

    @property
    def unit(self) -> str:
        """The unit of what the motor gives."""
        return "N m" if self.kind == "hinge" else "N"

    @property
    def use(self) -> float:
        """The largest size as a share of the limit; NaN where there is no limit."""
        return self.largest / self.effort_limit if math.isfinite(self.effort_limit) else math.nan


class MechanismSceneForces(Record):
    """What acts over the instants of a scene: `.tau`, `.force1`, `.torque1`, tables and files.

    Args:
        tau: motors' torques and forces; shape (N, dof).
        gravity: acceleration of free fall that they were computed with [m/s^2]; shape (3,).
        loads: of each joint with a coordinate of its own, beside its limits.
        notes: sentences that a reader should know.
        record: the arguments of a `Record`.
    """

    __slots__ = ("gravity", "loads", "notes", "tau")

    def __init__(
        self,
        *,
        tau: Float64Array,
        gravity: tuple[float, ...],
        loads: tuple[JointLoad, ...],
        notes: tuple[str, ...],
        **record: Any,
    ) -> None:
        super().__init__(**record)
        self.tau = tau
        self.gravity = gravity
        self.loads = loads
        self.notes = notes

    def _sheet(self) -> Sheet:
        return Sheet(f"{self.described}: {len(self.t)} instants", load_rows(self.loads), self.notes)


def forces_of(
    robot: Mechanism, known: KnownJoints, gravity: tuple[float, ...], record: Mapping[str, Any]
) -> MechanismSceneForces:
    """Compute what acts for a mechanism to move as its scene says; `MechanismScene.forces` has the words.

    Args:
        robot: the mechanism.
        known: its motion, with accelerations.
        gravity: acceleration of free fall [m/s^2]; shape (3,).
        record: t, and the arguments described, inputs and unit of a `Record`.
    """
    t: Float64Array = record["t"]
    acting = robot.inverse_dynamics(*known.arguments(), gravity=gravity, base_motion=known.base)
    tau = np.asarray(acting.tau, dtype=np.float64)
    arrays: dict[str, NDArray[Any]] = {f"tau_{name}": tau[:, i] for i, name in enumerate(robot.names)}
    arrays |= {"force1": acting.force1, "torque1": acting.torque1}
    loads = tuple(_load(joint, i, t, known, tau[:, i]) for i, joint in enumerate(robot.tree.coordinates))
    notes = (*_lost(arrays), *(sentence for load in loads for sentence in _beyond(load, len(t))))
    return MechanismSceneForces(arrays=arrays, tau=tau, gravity=gravity, loads=loads, notes=notes, **record)


def load_rows(loads: tuple[JointLoad, ...]) -> list[tuple[str, ...]]:
    """Return the heading and the rows of a table of loads beside limits; a limit that is none is empty."""
    rows: list[tuple[str, ...]] = [_HEADINGS]
    for load in loads:
        use = "" if math.isnan(load.use) else f"{load.use:.0%}"
        sizes = cell(load.rms), cell(load.largest), instant(load.t_of_largest), _limit(load.effort_limit), use
        both = zip(load.position, load.position_limits, strict=True)
        q = (text for value, limit in both for text in (cell(value), _limit(limit)))
        rows.append((load.joint, load.unit, *sizes, *q, cell(load.rate), _limit(load.rate_limit)))
    return rows


def _limit(value: float) -> str:
    return cell(value) if math.isfinite(value) else ""


def _load(joint: Joint, column: int, t: Float64Array, known: KnownJoints, tau: Float64Array) -> JointLoad:
    """Return what the motion takes of a joint; of instants that are finite."""
    finite = np.isfinite(tau)
    largest, when = (math.nan, math.nan)
    if finite.any():
        at = int(np.where(finite, np.abs(tau), -1.0).argmax())
        largest, when = float(abs(tau[at])), float(t[at])
    beyond = np.flatnonzero(np.abs(tau) > joint.effort_limit)
    q, qd = known.column(0, column), np.abs(known.column(1, column))
    return JointLoad(
        joint.name,
        joint.kind,
        float(np.sqrt(np.mean(tau[finite] ** 2))) if finite.any() else math.nan,
        largest,
        when,
        joint.effort_limit,
        int(beyond.size),
        float(t[beyond[0]]) if beyond.size else math.nan,
        (float(np.fmin.reduce(q)), float(np.fmax.reduce(q))),
        joint.position_limits,
        float(np.fmax.reduce(qd)),
        joint.rate_limit,
    )


def _lost(arrays: Mapping[str, NDArray[Any]]) -> Iterator[str]:
    """Yield a sentence on instants whose forces are not finite, if there are any."""
    finite = [np.isfinite(array).reshape(len(array), -1).all(axis=1) for array in arrays.values()]
    lost = int((~np.logical_and.reduce(finite)).sum())
    if lost:
        yield f"{lost} of {len(finite[0])} instants have forces that are not finite; ranges are those of the others"


def _beyond(load: JointLoad, samples: int) -> Iterator[str]:
    """Yield a sentence on instants at which a joint takes more than its motor gives, if there are any."""
    if load.beyond:
        yield (
            f"{load.joint} takes up to {load.largest:.4g} {load.unit}, more than its limit of {load.effort_limit:g}, "
            f"at {load.beyond} of {samples} instants, first at t = {instant(load.t_of_first)} s"
        )
