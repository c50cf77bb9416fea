"""The forces that the motion of a mechanism requires (T1-T3): motor torques with their limits, and base reaction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.tree import Joint
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.tables import Sheet, cell_text, instant_text
from hingepair.pair.results import Record
from hingepair.scenes.motions.joints import RATE_SUFFIXES, KnownJointMotion
from hingepair.scenes.motions.logs import DIFFERENCE_ORDER
from hingepair.scenes.motions.motion import non_finite_sentences
from hingepair.scenes.motions.noise import (
    NOISY_EFFORT,
    LogNoise,
    finite_rms,
    noise_rows,
)

_HEADINGS = (
    *("joint", "unit", "rms", "max |tau|", "at t", "limit", "of limit"),
    *("min q", "limit", "max q", "limit", "max |q'|", "limit"),
)
"""Headings of the table of joint forces: torques against their limits, then positions and rates."""


@dataclass(frozen=True, slots=True)
class JointLoad:
    """Summary of one joint of a mechanism over all instants."""

    #: name of the joint
    joint: str
    #: "hinge" or "slider"
    kind: str
    #: root mean square of the joint's effort: torque of a hinge [N m], force of a slider [N]; NaN if no value is
    #: finite
    rms: float
    #: largest absolute value of the effort
    largest: float
    #: instant of the largest effort [s]
    t_of_largest: float
    #: largest absolute value of the effort that the joint allows
    effort_limit: float
    #: number of instants at which the effort exceeds effort_limit
    beyond: int
    #: the first of these instants [s]; NaN if there are none
    t_of_first: float
    #: least and greatest coordinate [rad or m]
    position: tuple[float, float]
    #: limits of the coordinate
    position_limits: tuple[float, float]
    #: largest absolute value of the rate [rad/s or m/s]
    rate: float
    #: limit of the absolute value of the rate
    rate_limit: float
    #: standard deviation of the torque or force that the noise of a log causes, away from the log's ends; NaN without
    #: a log
    noise: float

    @property
    def unit(self) -> str:
        """Unit of the joint's effort: N m for a hinge, N for a slider."""
        return "N m" if self.kind == "hinge" else "N"

    @property
    def use(self) -> float:
        """The largest effort as a fraction of the effort limit; NaN without a limit."""
        if not math.isfinite(self.effort_limit):
            return math.nan
        if not self.effort_limit:  # a joint that may take no load
            return math.inf if self.largest else 0.0
        return self.largest / self.effort_limit


class MechanismSceneForces(Record):
    """Joint efforts `tau` and base forces `force1` and `torque1` at the instants of a mechanism's scene, with
    `loads`, a tuple of one JointLoad for each joint.

    Args:
        tau: joint efforts: torques of hinges [N m], forces of sliders [N]; shape (N, dof).
        gravity: acceleration of free fall that the forces were computed with [m/s^2]; shape (3,).
        loads: a JointLoad for each joint that has a coordinate of its own.
        notes: sentences for readers of the forces.
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
        return Sheet(f"{self.described}: {len(self.t)} instants", joint_load_table_rows(self.loads), self.notes)


class JointLogNoise(NamedTuple):
    """Joint samples of a log of a `robot` at instants `t`, from which the noise and its effect on joint efforts are
    estimated.
    """

    #: the mechanism
    robot: Mechanism
    #: all instants of the log [s]
    t: Float64Array
    #: the motion at the instants of `noise_rows`, with accelerations
    middle: KnownJointMotion
    #: names of the joints that have a column in the log
    moving: tuple[str, ...]
    #: names of the rates that were found by finite differences
    derived: tuple[str, ...]

    def effort_deviations(self, gravity: tuple[float, ...], tau: Float64Array) -> tuple[Float64Array, str]:
        """Return (deviations, note): the standard deviation that noise of the log causes in each joint effort, shape
        (dof,) [N m or N], and a sentence on the noise. `tau` are the efforts at all instants, shape (N, dof), and
        `gravity` is the gravity vector [m/s^2] that they were computed with.
        """
        rows = noise_rows(len(self.t))
        log = LogNoise(self.t[rows] - self.t[rows.start], self.derived, DIFFERENCE_ORDER)
        derivatives = [list(values) for values in self.middle.derivatives]
        units: dict[str, str] = {}
        for column, joint in enumerate(self.robot.tree.coordinates):
            if joint.name not in self.moving:
                continue
            names = tuple(joint.name + rate for rate in RATE_SUFFIXES)
            length = "rad" if joint.kind == "hinge" else "m"
            units |= zip(names, (length, f"{length}/s", f"{length}/s^2"), strict=True)
            values = tuple(self.middle.column(order, column) for order in range(len(names)))
            for order, noisy_values in enumerate(log.column_with_noise_added(names, values)):
                derivatives[order][column] = noisy_values
        noisy = replace(self.middle, derivatives=tuple(map(tuple, derivatives)))
        base = self.middle.base
        acting = self.robot.inverse_dynamics(*noisy.arguments(), gravity=gravity, base_motion=base, outputs=("tau",))
        change = (np.asarray(acting.tau, np.float64) - tau[rows])[DIFFERENCE_ORDER // 2 : -(DIFFERENCE_ORDER // 2)]
        noise = finite_rms(change)
        sizes = ", ".join(f"{size:.2g} {units[name]} of {name}" for name, size in log.sizes.items())
        note = f"noise of the log, by local fits: {sizes or 'none'} (standard deviations)"
        if (noise > NOISY_EFFORT * finite_rms(tau)).any():
            note += "; hp.smooth(t, q) finds the rates of a noisy column"
        return noise, note


def mechanism_scene_forces(
    robot: Mechanism,
    known_motion: KnownJointMotion,
    gravity: tuple[float, ...],
    record: Mapping[str, Any],
    noise: JointLogNoise | None,
) -> MechanismSceneForces:
    """Return the MechanismSceneForces that `known_motion`, a KnownJointMotion of a robot with accelerations, requires
    under the vector `gravity`.

    Args:
        robot: the mechanism.
        known_motion: its motion, with accelerations.
        gravity: acceleration of free fall [m/s^2]; shape (3,).
        record: t, and the arguments described, inputs and unit of a `Record`.
        noise: of a log, what its noise is estimated from.
    """
    t: Float64Array = record["t"]
    acting = robot.inverse_dynamics(*known_motion.arguments(), gravity=gravity, base_motion=known_motion.base)
    tau = np.asarray(acting.tau, dtype=np.float64)
    arrays: dict[str, NDArray[Any]] = {f"tau_{name}": tau[:, i] for i, name in enumerate(robot.names)}
    arrays |= {"force1": acting.force1, "torque1": acting.torque1}
    deviations, sentences = np.full(robot.dof, math.nan), list(non_finite_sentences(arrays))
    if noise is not None and len(t) > DIFFERENCE_ORDER:
        deviations, sentence = noise.effort_deviations(gravity, tau)
        sentences.append(sentence)
    loads = tuple(
        _summarize_joint(joint, i, t, known_motion, tau[:, i], float(deviations[i]))
        for i, joint in enumerate(robot.tree.coordinates)
    )
    notes = (*sentences, *(sentence for load in loads for sentence in _effort_limit_sentences(load, len(t))))
    return MechanismSceneForces(arrays=arrays, tau=tau, gravity=gravity, loads=loads, notes=notes, **record)


def joint_load_table_rows(loads: tuple[JointLoad, ...]) -> list[tuple[str, ...]]:
    """Return the rows of a table of JointLoads as a list of tuples of strings, headings first. An infinite limit is
    an empty cell. If any load has a noise, a column of noise is added.
    """
    logged = any(math.isfinite(load.noise) for load in loads)
    rows: list[tuple[str, ...]] = [(*_HEADINGS, "by noise") if logged else _HEADINGS]
    for load in loads:
        use = "" if math.isnan(load.use) else f"{load.use:.0%}"
        sizes = (
            cell_text(load.rms),
            cell_text(load.largest),
            instant_text(load.t_of_largest),
            _limit_text(load.effort_limit),
            use,
        )
        both = zip(load.position, load.position_limits, strict=True)
        q = (text for value, limit in both for text in (cell_text(value), _limit_text(limit)))
        noise = [f"{load.noise:.2g}"] if logged else []
        rows.append((load.joint, load.unit, *sizes, *q, cell_text(load.rate), _limit_text(load.rate_limit), *noise))
    return rows


def _limit_text(value: float) -> str:
    return cell_text(value) if math.isfinite(value) else ""


def _summarize_joint(
    joint: Joint, joint_index: int, t: Float64Array, known_motion: KnownJointMotion, tau: Float64Array, noise: float
) -> JointLoad:
    """Return the JointLoad of the joint with the index `joint_index`: the extremes of its effort `tau` (N,), of its
    position and of its rate at the instants t, and their limits.
    """
    finite = np.isfinite(tau)
    largest, when = (math.nan, math.nan)
    if finite.any():
        largest_index = int(np.where(finite, np.abs(tau), -1.0).argmax())
        largest, when = float(abs(tau[largest_index])), float(t[largest_index])
    beyond = np.flatnonzero(np.abs(tau) > joint.effort_limit)
    q, qd = known_motion.column(0, joint_index), np.abs(known_motion.column(1, joint_index))
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
        noise,
    )


def _effort_limit_sentences(load: JointLoad, instant_count: int) -> Iterator[str]:
    """Yield one sentence if a JointLoad exceeds the joint's effort limit at some instants, otherwise nothing."""
    if load.beyond:
        yield (
            f"{load.joint} takes up to {load.largest:.4g} {load.unit}, more than its limit of {load.effort_limit:g}, "
            f"at {load.beyond} of {instant_count} instants, first at t = {instant_text(load.t_of_first)} s"
        )
