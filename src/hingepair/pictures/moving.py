"""What moves in a picture: one record of a robot or a pair with its motion, whatever the motion comes from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations.quantities import ACCELERATION
from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_arrays
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.subject import check_single_pair
from hingepair.mechanism.results import RESULT_ROWS_PER_BLOCK
from hingepair.mechanism.tree import Joint
from hingepair.motion.simulated import SimulatedMotion, SimulatedRobotMotion
from hingepair.motion.trajectory import PlanarTrajectory, Trajectory
from hingepair.numeric.arrays import is_table, real_array
from hingepair.scenes.motions.known import PSI, Known
from hingepair.scenes.motions.motion import MotionSource
from hingepair.scenes.scene import Scene, SceneResult, scene_of_simulation

Array: TypeAlias = NDArray[Any]
Shown: TypeAlias = HingePair | Scene | SceneResult | Trajectory | Mechanism | SimulatedRobotMotion

MAX_SHOWN = 2000
"""Largest number of instants on a page that are spread evenly over the motion; a plot uses all instants."""
_MAX_MARKED = 200  # further instants on a page, at which something is beyond its limits


class Moving(NamedTuple):
    """A robot or a pair with its motion."""

    subject: Mechanism | HingePair
    title: str
    t: Array  # instants [s]; shape (N,)
    source: MotionSource  # coordinates of the joints, and of a pair psi; motion of the base, or of body 1
    scene: Scene | None = None
    arrays: Mapping[str, Array] = {}  # tau of a robot, outputs of a trajectory; shape (N, ...)

    def pieces(self, order: int) -> Iterator[tuple[slice, Known]]:
        """Yield rows and the motion at them, with derivatives up to `order` as far as they are known."""
        for start in range(0, len(self.t), RESULT_ROWS_PER_BLOCK):
            rows = slice(start, min(start + RESULT_ROWS_PER_BLOCK, len(self.t)))
            yield rows, self.source.part(rows, min(order, self.source.level))

    def tau(self) -> Array | None:
        """Return the efforts of the coordinates of a robot, (N, dof); None where they are not known."""
        if self.scene is None or isinstance(self.subject, HingePair):
            return self.arrays.get("tau")
        if self.source.level < ACCELERATION:
            return None
        try:
            self.scene.sampled(1, ("tau",))
        except ArgumentError:  # without masses
            return None
        return np.concatenate([np.asarray(part.tau) for part in self.scene.blocks(("tau",))])

    def coordinates(self, known: Known) -> tuple[Array, ...]:
        """Return the coordinates of all joints, those that loops close among them, and their rates if these are
        known; shape (N, joints) each.
        """
        own = tuple(known.array(order) for order in range(min(known.level, 1) + 1))
        if isinstance(self.subject, HingePair) or not self.subject.loops:
            return own
        found = self.subject.all_coordinates(*own)
        return found if isinstance(found, tuple) else (found,)


def moving(
    source: Shown, q: Any = None, t: Any = None, base_motion: Any = None, qd: Any = None, tau: Any = None
) -> Moving:
    """Return what a picture shows; q, t and the others give the motion of a robot and are refused beside others."""
    if isinstance(source, Mechanism):
        return _given(source, q, t, base_motion, qd, tau)
    given = {"q": q, "t": t, "base_motion": base_motion, "qd": qd, "tau": tau}
    for name, value in given.items():
        if value is not None:
            raise ArgumentError(name, "None, since only a robot (a Mechanism) takes a motion", quoted(value))
    source = source.scene if isinstance(source, SceneResult) else source
    source = scene_of_simulation(source) if isinstance(source, SimulatedRobotMotion) else source
    if isinstance(source, Scene):
        subject = source.space if source.mechanism is None else source.mechanism
        return Moving(subject, source.title, source.t, source.motion.source, source)
    if isinstance(source, Trajectory):
        psi: tuple[Any, ...] = ((source.psi,),)
        pair, R1 = source.pair, source.R1
        if isinstance(source, PlanarTrajectory):
            pair, R1 = source.pair.to_spatial(), np.pad(R1, ((0, 0), (0, 1)))
        body1 = BodyMotion(R=R1, S=source.S1)
        if isinstance(source, SimulatedMotion):
            psi, body1 = (*psi, (source.psid,), (source.psidd,)), source.body1
        known = Known(PSI, len(source.t), psi, body1)
        return Moving(pair, pair.name, source.t, known, arrays=source.recorded())
    if isinstance(source, HingePair):
        return _swept(source)
    expected = "a pair in space, a scene, its result, or a trajectory"
    raise ArgumentError("source", expected, type(source).__name__)


def _swept(pair: HingePair) -> Moving:
    """Return a pair that moves in 6 s from limit to limit and back, or through a turn."""
    check_single_pair(pair)
    lower, upper = pair.limits or (-np.pi, np.pi)
    share = np.linspace(0, 1, 181)
    psi = lower + (upper - lower) * (share if pair.limits is None else (1 - np.cos(2 * np.pi * share)) / 2)
    known = Known(PSI, 181, ((psi,),))
    names = ("R1", "S1", "R2", "S2", *pair.points1, *pair.points2)
    arrays = pair.forward_kinematics_from_body1(known.body1, psi, outputs=names).arrays()
    return Moving(pair, pair.name, 6 * share, known, arrays=arrays | {"psi": psi})


def _given(robot: Mechanism, q: Any, t: Any, base_motion: Any, qd: Any, tau: Any) -> Moving:
    """Return a robot with the motion that arguments give, checked; no instants without q, 30 a second without t."""
    if q is None and robot.loops:
        expected = "coordinates at instants, since the joints of a closed mechanism do not move one by one"
        raise ArgumentError("q", expected, None)
    positions = np.zeros((0, robot.dof)) if q is None else _joint_rows(robot, "q", q)
    if positions.ndim != 2 or positions.shape[1] != robot.dof or (q is not None and not len(positions)):
        raise ShapeError("q", f"shape (T, {robot.dof}) with T from 1 on", positions.shape)
    count = len(positions)
    instants = np.arange(count) / 30.0 if t is None else real_array("t", t).astype(np.float64)
    if instants.shape != (count,):
        raise ShapeError("t", f"shape {(count,)}, as many instants as q has", instants.shape)
    if not np.isfinite(instants).all() or (np.diff(instants) < 0).any():
        raise ArgumentError("t", "finite instants that do not decrease", quoted(t))
    arrays = {name: _joint_rows(robot, name, own) for name, own in (("qd", qd), ("tau", tau)) if own is not None}
    for name, values in arrays.items():
        if values.shape != positions.shape:
            raise ShapeError(name, f"shape {positions.shape}, that of q", values.shape)
    base = None if base_motion is None else _base(base_motion, count)
    columns = tuple(positions.T) if count else tuple(np.zeros((robot.dof, 1)))
    known = Known(robot.names, count or 1, (columns,), base)
    return Moving(robot, robot.name, instants, known, arrays=arrays)


def _joint_rows(robot: Mechanism, name: str, value: ArrayLike) -> Array:
    """Return numbers of the joints as float64; of a table the columns that have the joints' names."""
    if is_table(value):
        value = np.stack(tuple(tree_of(robot).coordinate_names.of_table(name, value).values()), axis=-1)
    return real_array(name, value).astype(np.float64)


def _base(base_motion: Any, count: int) -> BodyMotion:
    """Return the pose of a base at `count` instants, or at one of a robot without a motion, checked."""
    motion_arrays("base_motion", base_motion, "S")
    R, S = np.asarray(base_motion.R, np.float64), np.asarray(base_motion.S, np.float64)
    shape = np.broadcast_shapes(R.shape[:-1], S.shape[:-2])
    if shape not in {(), (1,), (count or 1,)}:
        raise ShapeError("base_motion", f"one instant, or the {count} instants of q", shape)
    return BodyMotion(R=np.broadcast_to(R, (count or 1, 3)), S=np.broadcast_to(S, (count or 1, 3, 3)))


class Event(NamedTuple):
    """A time during which a coordinate or an effort is beyond its limits."""

    name: str  # of the joint
    what: str  # "its limits" or "its torque"
    first: float  # instants [s]
    last: float
    worst: int  # index of the sample that is furthest beyond


def shown_rows(t: Array, q: Array, tau: Array | None, joints: Sequence[Joint]) -> tuple[Array, list[Event]]:
    """Return the indices of the samples that a page shows, evenly spread ones and those furthest beyond a limit, and
    the events of all samples.
    """
    events: list[Event] = []
    for i, joint in enumerate(joints):
        events += _events(joint.name, "its limits", t, q[:, i], *joint.position_limits)
        if tau is not None:
            events += _events(joint.name, "its torque", t, tau[:, i], *joint.effort_bounds)
    worst = [event.worst for event in events][:_MAX_MARKED]
    spread = np.linspace(0, len(t) - 1, min(len(t), MAX_SHOWN)).astype(np.intp)
    return np.unique(np.concatenate([spread, np.array(worst, dtype=np.intp)])), events


def _events(name: str, what: str, t: Array, values: Array, lower: float, upper: float) -> Iterator[Event]:
    """Yield the times during which values are beyond limits; what is missing is not beyond them."""
    with np.errstate(invalid="ignore"):
        excess = np.fmax(values - upper, lower - values)
        edges = np.diff(np.concatenate([[False], excess > 0, [False]]).astype(np.int8))
    for first, end in zip(np.flatnonzero(edges > 0).tolist(), np.flatnonzero(edges < 0).tolist(), strict=True):
        worst = first + int(np.argmax(excess[first:end]))
        yield Event(name, what, float(t[first]), float(t[end - 1]), worst)
