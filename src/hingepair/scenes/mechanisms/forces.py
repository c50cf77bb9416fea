"""The forces that the motion of a mechanism takes (T1-T3): motors' beside their limits, and the base's reaction."""

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
from hingepair.scenes.log_noise import SMOOTHING_HINT_NOISE_RATIO, LogNoise, finite_rms, noise_rows
from hingepair.scenes.logged_motion import FINITE_DIFFERENCE_ORDER
from hingepair.scenes.mechanisms.joint_motion import DERIVATIVE_SUFFIXES, KnownJointMotion
from hingepair.scenes.motion import non_finite_sentences

_FORCE_TABLE_HEADINGS = (
    *("joint", "unit", "rms", "max |tau|", "at t", "limit", "of it"),
    *("least q", "limit", "largest q", "limit", "max |q'|", "limit"),
)
"""Headings of the table of joint forces: torques against their limits, then positions and rates."""


@dataclass(frozen=True, slots=True)
class JointLoad:
    """Extremes of a joint's motion and effort beside the joint's limits, which are infinite where there are none.

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
        noise: standard deviation of the torque or force that the noise of a log causes, away from the log's ends; NaN
            where there is no log.
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
    noise: float

    @property
    def unit(self) -> str:
        """The unit of what the motor gives."""
        return "N m" if self.kind == "hinge" else "N"

    @property
    def use(self) -> float:
        """The largest size as a share of the limit; NaN where there is no limit."""
        return self.largest / self.effort_limit if math.isfinite(self.effort_limit) else math.nan


class MechanismSceneForces(Record):
    """Joint efforts and base forces over the instants of a scene: `.tau`, `.force1`, `.torque1`, tables and files.

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


class JointLogNoise(NamedTuple):
    """Joint samples of a log, from which the noise of the log and its effect on torques are estimated.

    Attributes:
        robot: the mechanism.
        t: all instants of the log [s].
        middle: the motion at the instants of `noise_rows`, with accelerations.
        moving: names of the joints that have a column in the log.
        derived: names of the rates that were found by finite differences.
    """

    robot: Mechanism
    t: Float64Array
    middle: KnownJointMotion
    moving: tuple[str, ...]
    derived: tuple[str, ...]

    def torque_deviations(self, gravity: tuple[float, ...], tau: Float64Array) -> tuple[Float64Array, str]:
        """Return the standard deviation that noise of the log causes in each joint torque, and a note on it.

        Args:
            gravity: acceleration of free fall [m/s^2]; shape (3,).
            tau: torques and forces at all instants; shape (N, dof).

        Returns:
            The standard deviations, shape (dof,), and the note.
        """
        rows = noise_rows(len(self.t))
        log = LogNoise(self.t[rows] - self.t[rows.start], self.derived, FINITE_DIFFERENCE_ORDER)
        derivatives = [list(values) for values in self.middle.derivatives]
        units: dict[str, str] = {}
        for column, joint in enumerate(self.robot.tree.coordinates):
            if joint.name not in self.moving:
                continue
            names = tuple(joint.name + rate for rate in DERIVATIVE_SUFFIXES)
            length = "rad" if joint.kind == "hinge" else "m"
            units |= zip(names, (length, f"{length}/s", f"{length}/s^2"), strict=True)
            values = tuple(self.middle.column(order, column) for order in range(len(names)))
            for order, noisy_values in enumerate(log.added_to_column(names, values)):
                derivatives[order][column] = noisy_values
        noisy = replace(self.middle, derivatives=tuple(map(tuple, derivatives)))
        base = self.middle.base
        acting = self.robot.inverse_dynamics(*noisy.arguments(), gravity=gravity, base_motion=base, outputs=("tau",))
        change = (np.asarray(acting.tau, np.float64) - tau[rows])[
            FINITE_DIFFERENCE_ORDER // 2 : -(FINITE_DIFFERENCE_ORDER // 2)
        ]
        noise = finite_rms(change)
        sizes = ", ".join(f"{size:.2g} {units[name]} of {name}" for name, size in log.sizes.items())
        note = f"noise of the log, by local fits: {sizes or 'none'} (standard deviations)"
        if (noise > SMOOTHING_HINT_NOISE_RATIO * finite_rms(tau)).any():
            note += "; hp.smooth(t, q) finds the rates of a noisy column"
        return noise, note


def mechanism_scene_forces(
    robot: Mechanism,
    known_motion: KnownJointMotion,
    gravity: tuple[float, ...],
    record: Mapping[str, Any],
    noise: JointLogNoise | None,
) -> MechanismSceneForces:
    """Return the MechanismSceneForces that a known motion requires. `record` has further arguments of a Record;
    `noise`, if not None, estimates the noise of a log.

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
    if noise is not None and len(t) > FINITE_DIFFERENCE_ORDER:
        deviations, sentence = noise.torque_deviations(gravity, tau)
        sentences.append(sentence)
    loads = tuple(
        _summarize_joint(joint, i, t, known_motion, tau[:, i], float(deviations[i]))
        for i, joint in enumerate(robot.tree.coordinates)
    )
    notes = (*sentences, *(sentence for load in loads for sentence in _effort_limit_sentences(load, len(t))))
    return MechanismSceneForces(arrays=arrays, tau=tau, gravity=gravity, loads=loads, notes=notes, **record)


def load_rows(loads: tuple[JointLoad, ...]) -> list[tuple[str, ...]]:
    """Return the rows of a table of joint loads, headings first, as text; an infinite limit is an empty cell."""
    logged = any(math.isfinite(load.noise) for load in loads)
    rows: list[tuple[str, ...]] = [(*_FORCE_TABLE_HEADINGS, "by noise") if logged else _FORCE_TABLE_HEADINGS]
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
    """Return the JointLoad of one joint: extremes of its finite torques, positions and rates, beside its limits."""
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
    """Yield one sentence if a joint requires more than its effort limit at some instants; else nothing."""
    if load.beyond:
        yield (
            f"{load.joint} takes up to {load.largest:.4g} {load.unit}, more than its limit of {load.effort_limit:g}, "
            f"at {load.beyond} of {instant_count} instants, first at t = {instant_text(load.t_of_first)} s"
        )
