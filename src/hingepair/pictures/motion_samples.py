"""Motions as plots and pages take them: samples of whatever moves, a robot, a pair, a scene or a trajectory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations.quantities import ACCELERATION, VELOCITY
from hingepair.errors import ArgumentError, ShapeError, choices, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_of_rotations
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.pairs.geometry import check_single_pair
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.results import MAX_HELD_INSTANTS
from hingepair.mechanism.tree import Joint
from hingepair.motion.trajectory import Trajectory
from hingepair.numeric.arrays import is_table, real_array
from hingepair.scenes.motions.known import Known
from hingepair.scenes.scene import Scene, SceneResult

Array: TypeAlias = NDArray[Any]

MAX_SHOWN: Final = 2000
"""Largest number of instants on a page that are spread evenly over the motion; a plot uses all instants."""
_MAX_MARKED: Final = 200  # further instants on a page, at which something is beyond its limits

BODY2_RATES: Final = ("v2", "omega2", "a2", "alpha2")
"""Velocities, then accelerations of body 2: two for each order of derivatives."""

MotionSource: TypeAlias = HingePair | Scene | SceneResult | Trajectory


class Event(NamedTuple):
    """A time during which a coordinate or an effort is beyond its limits."""

    name: str  # of the joint
    what: str  # "its limits" or "its torque"
    first: float  # instants [s]
    last: float
    worst: int  # index of the sample that is furthest beyond


class ShownMotion(NamedTuple):
    """Samples of what moves: joints, and the base; of a pair the hinge, and body 1."""

    t: Array  # instants [s]; shape (N,)
    q: Array  # coordinates of the joints [rad or m]; shape (N, dof)
    R: Array  # position of the base [m]; shape (N, 3), or (1, 3)
    S: Array  # attitude of the base; shape (N, 3, 3), or (1, 3, 3)
    samples: int  # number of instants of the whole motion
    qd: Array | None = None  # rates of the coordinates; shape (N, dof)
    tau: Array | None = None  # torques and forces of the joints [N m or N]; shape (N, dof)
    base_rates: Mapping[str, Array] | None = None  # v and omega of the base; shape (N, 3), or (1, 3)
    readings: Mapping[str, Array] = {}  # further outputs whose numbers are shown, by name; shape (N, 3) or (N, 1)
    events: Sequence[Event] = ()  # of the whole motion

    def rows(self, rows: Array | slice) -> ShownMotion:
        """Return the samples with these indices."""

        def part(array: Array) -> Array:
            return array[rows] if len(array) > 1 or len(self.t) == 1 else array

        return self._replace(
            t=self.t[rows],
            q=self.q[rows],
            R=part(self.R),
            S=part(self.S),
            qd=None if self.qd is None else self.qd[rows],
            tau=None if self.tau is None else self.tau[rows],
            base_rates=self.base_rates and {name: part(array) for name, array in self.base_rates.items()},
            readings={name: array[rows] for name, array in self.readings.items()},
        )


# ---- motions that are given


def given_motion(
    robot: Mechanism,
    q: ArrayLike | None,
    t: ArrayLike | None,
    base_motion: BodyMotion | None,
    rate: float = 30.0,
    **others: ArrayLike | None,
) -> ShownMotion:
    """Return the checked arguments of a picture of a robot; N = 0 without q, `rate` instants a second without t. The
    others are qd and tau.
    """
    positions = np.zeros((0, robot.dof)) if q is None else _joint_rows(robot, "q", q)
    if positions.ndim != 2 or positions.shape[1] != robot.dof or (q is not None and not len(positions)):
        raise ShapeError("q", f"shape (T, {robot.dof}) with T from 1 on", positions.shape)
    count = len(positions)
    instants = np.arange(count) / rate if t is None else real_array("t", t).astype(np.float64)
    if instants.shape != (count,):
        raise ShapeError("t", f"shape {(count,)}, as many instants as q has", instants.shape)
    if not np.isfinite(instants).all() or (np.diff(instants) < 0).any():
        raise ArgumentError("t", "finite instants that do not decrease", quoted(t))
    rows: dict[str, Any] = {name: _joint_rows(robot, name, own) for name, own in others.items() if own is not None}
    for name, values in rows.items():
        if values.shape != positions.shape:
            raise ShapeError(name, f"shape {positions.shape}, that of q", values.shape)
    return ShownMotion(instants, positions, *_base_poses(base_motion, count), count, **rows)


def _joint_rows(robot: Mechanism, name: str, value: ArrayLike) -> Array:
    """Return numbers of the joints as float64; of a table the columns that have the joints' names."""
    if is_table(value):
        value = np.stack(tuple(tree_of(robot).coordinate_names.of_table(name, value).values()), axis=-1)
    return real_array(name, value).astype(np.float64)


def _base_poses(base_motion: BodyMotion | None, count: int) -> tuple[Array, Array]:
    """Return R and S of a base at one or `count` instants, checked; None is rest at the origin."""
    if base_motion is None:
        return np.zeros((1, 3)), np.eye(3)[None]
    if not isinstance(base_motion, BodyMotion):
        raise ArgumentError("base_motion", "a BodyMotion", quoted(base_motion))
    if base_motion.S is None:
        raise ArgumentError("base_motion.S", "a value, as in BodyMotion(..., S=...)", None)
    R, S = np.asarray(base_motion.R, np.float64), np.asarray(base_motion.S, np.float64)
    shape = np.broadcast_shapes(R.shape[:-1], S.shape[:-2])
    if shape not in {(), (1,), (count or 1,)}:
        raise ShapeError("base_motion", f"one instant, or the {count} instants of q", shape)
    places = shape[0] if shape else 1
    return np.broadcast_to(R, (places, 3)), np.broadcast_to(S, (places, 3, 3))


# ---- what a page shows


def page_motion(source: Scene | MotionSource | ShownMotion, joints: Sequence[Joint]) -> ShownMotion:
    """Return the motion that a page shows: evenly spread instants, and those at which a joint is furthest beyond a
    limit; its events are those of all samples.

    Args:
        source: a motion that is given, a scene, a trajectory or a pair.
        joints: the joints that have a coordinate, those that loops close among them.
    """
    if isinstance(source, Scene):
        return _scene_motion(source, joints)
    motion = source if isinstance(source, ShownMotion) else _recorded_motion(source).shown
    rows, events = _shown_rows(motion.t, motion.q, motion.tau, joints)
    return motion.rows(rows)._replace(events=events)


def _scene_motion(scene: Scene, joints: Sequence[Joint]) -> ShownMotion:
    """Return what a page shows of a scene; marks of a very long one are those of the shown samples."""
    level = scene.motion.level
    whole = scene.samples <= MAX_HELD_INSTANTS
    looked_at = np.arange(scene.samples) if whole else np.asarray(scene.spread(MAX_SHOWN))
    is_tree = scene.mechanism is not None and not scene.mechanism.loops
    tau = _efforts(scene) if whole and is_tree and has_efforts(scene) else None
    instants = np.asarray(scene.t[looked_at])
    rows, events = _shown_rows(instants, _joint_motion(scene, scene.known(looked_at, 0))[0], tau, joints)
    known, t = scene.known(looked_at[rows], level), instants[rows]
    base, (q, *rates_of_q) = known.base_motion, _joint_motion(scene, known)
    motion = ShownMotion(t, q, *_base_poses(base, len(t)), scene.samples, events=events)
    if level < VELOCITY:
        return motion._replace(readings={} if scene.pair is None else {"psi": motion.q})
    if scene.pair is None:
        rates = {
            name: np.zeros((1, 3)) if base is None else np.asarray(getattr(base, name)) for name in ("v", "omega")
        }
        return motion._replace(qd=rates_of_q[0], base_rates=rates, tau=None if tau is None else tau[rows])
    outputs = ("v2", "omega2")
    state = scene.space.forward_kinematics_from_body1(known.body1, *known.hinge[:2], outputs=outputs).arrays()
    return motion._replace(readings={"psi": motion.q, **state})


def _joint_motion(scene: Scene, known: Known) -> tuple[Array, ...]:
    """Return the coordinates of all joints of a scene, those that loops close among them, and their first derivatives
    if they are known; shape (N, joints) each.
    """
    own = tuple(known.array(order) for order in range(min(known.level, VELOCITY) + 1))
    if scene.mechanism is None or not scene.mechanism.loops:
        return own
    found = scene.mechanism.all_coordinates(*own)
    return found if isinstance(found, tuple) else (found,)


def has_efforts(scene: Scene) -> bool:
    """Return whether the torques and forces of the joints of a mechanism's scene are known: not without masses."""
    if scene.motion.level < ACCELERATION:
        return False
    try:
        scene.sampled(1, ("tau",))
    except ArgumentError:
        return False
    return True


def _efforts(scene: Scene) -> Array:
    """Return torques and forces of the joints of a mechanism's scene at all instants; shape (samples, dof)."""
    return np.concatenate([np.asarray(part.tau) for part in scene.blocks(("tau",))])


def _shown_rows(t: Array, q: Array, tau: Array | None, joints: Sequence[Joint]) -> tuple[Array, Sequence[Event]]:
    """Return the indices of the samples that a page shows, and the events of all samples."""
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


# ---- all samples of a pair


class PairSamples(NamedTuple):
    """Samples of the motion of a pair, or of a piece of it."""

    pair: HingePair
    title: str
    samples: int  # number of instants of the whole motion
    t: Array  # instants [s]; shape (N,)
    poses: Mapping[str, Array]  # R1, S1, R2 and S2; shapes (N, 3), (N, 3, 3)
    psi: Array  # hinge angle [rad]; shape (N,)
    outputs: Mapping[str, Array]  # velocities and accelerations of body 2, (N, 3), or the requested outputs

    @property
    def paths(self) -> dict[str, Array]:
        """Paths of the reference points, of the hinge and of the points of the bodies, by name; shape (N, 3)."""
        R1, S1, R2, S2 = (self.poses[name] for name in ("R1", "S1", "R2", "S2"))
        with np.errstate(invalid="ignore"):
            points = {name: R1 + S1 @ p for name, p in self.pair.points1.items()}
            points |= {name: R2 + S2 @ p for name, p in self.pair.points2.items()}
            return {"R1": R1, "R2": R2, "hinge point": R1 + S1 @ self.pair.u1, **points}


class _Recorded(NamedTuple):
    """The motion of a pair in memory."""

    t: Array
    pair: HingePair
    body1: BodyMotion
    psi: Array
    arrays: dict[str, Array]  # further outputs, by name

    @property
    def shown(self) -> ShownMotion:
        readings = {"psi": self.psi[:, None]} | {
            name: a for name, a in self.arrays.items() if name in BODY2_RATES[:2]
        }
        readings = {name: array if name == "psi" else _spatial_vectors(array) for name, array in readings.items()}
        R, S = np.asarray(self.body1.R), np.asarray(self.body1.S)
        return ShownMotion(self.t, self.psi[:, None], R, S, len(self.t), readings=readings)


def pair_of(source: object) -> HingePair:
    """Return the pair whose motion a trajectory is, or the pair itself; refuse other sources."""
    return _recorded_motion(source).pair


def pair_pieces(source: object, outputs: tuple[str, ...] | None = None) -> Iterator[PairSamples]:
    """Yield all samples of the motion of a pair's scene, of a trajectory or of a pair, piece by piece, with the
    outputs of these names, by default the velocities and accelerations of body 2 that it has.
    """
    if isinstance(source, Scene):
        names = (*BODY2_RATES[: 2 * source.motion.level], "psi") if outputs is None else outputs
        for part in source.blocks(names):
            arrays, poses = part.requested_arrays(), source.require_pair().poses(part.known)
            shown = _rate_vectors(arrays) if outputs is None else arrays
            yield PairSamples(source.space, source.title, source.samples, part.t, poses, part.known.psi, shown)
        return
    t, pair, body1, psi, recorded = _recorded_motion(source)
    points = (*pair.points1, *pair.points2)
    body1 = motion_of_rotations(R=body1.R, S=body1.S)
    found = pair.forward_kinematics_from_body1(body1, psi, outputs=("R1", "S1", "R2", "S2", *points)).arrays()
    poses = {name: array for name, array in found.items() if name not in points}
    arrays = recorded or {**found, "psi": psi}
    for name in outputs or ():
        if name not in arrays:
            raise ArgumentError("outputs", choices(tuple(arrays)), quoted(name))
    shown = _rate_vectors(arrays) if outputs is None else {name: arrays[name] for name in outputs}
    yield PairSamples(pair, pair.name, len(t), t, poses, psi, shown)


def _recorded_motion(source: object) -> _Recorded:
    """Return the motion of a trajectory, or of a pair, in 6 s from limit to limit and back or through a turn."""
    if isinstance(source, Trajectory):
        recorded = source.recorded()
        return _Recorded(source.t, source.pair, BodyMotion(R=source.R1, S=source.S1), source.psi, recorded)
    if not isinstance(source, HingePair):
        expected = "a pair in space, a scene, its result, or a trajectory in space"
        raise ArgumentError("source", expected, type(source).__name__)
    check_single_pair(source)
    lower, upper = source.limits or (-np.pi, np.pi)
    share = np.linspace(0, 1, 181)
    psi = lower + (upper - lower) * (share if source.limits is None else (1 - np.cos(2 * np.pi * share)) / 2)
    still = BodyMotion(R=np.zeros((181, 3)), S=np.broadcast_to(np.eye(3), (181, 3, 3)))
    return _Recorded(6 * share, source, still, psi, {})


def _rate_vectors(arrays: Mapping[str, Array]) -> dict[str, Array]:
    """Return the velocities and accelerations of body 2 among arrays, by name, as vectors in space (N, 3)."""
    return {name: _spatial_vectors(arrays[name]) for name in BODY2_RATES if name in arrays}


def _spatial_vectors(vectors: Array) -> Array:
    """Return vectors in the plane, or numbers along z, as vectors in space; shape (N, 3)."""
    flat = vectors.reshape(len(vectors), -1)
    if flat.shape[1] == 3:
        return flat
    zero = np.zeros((len(flat), 3 - flat.shape[1]))
    return np.concatenate((flat, zero) if flat.shape[1] == 2 else (zero, flat), axis=1)
