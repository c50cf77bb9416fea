"""Samples of a motion for plots and pages, taken from any object that holds a motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, choices, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_of_rotations
from hingepair.mechanism.pairs.geometry import check_single_pair
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.motion.simulated import SimulatedPlanarMotion
from hingepair.motion.trajectory import Trajectory
from hingepair.scenes.motions.known import Rows
from hingepair.scenes.scene import Scene, SceneResult

Array: TypeAlias = NDArray[Any]

MAX_SHOWN: Final = 2000
"""Largest number of instants on a page, spread evenly over the motion; a plot uses all instants."""

# Velocities, then accelerations of body 2: two for each order of derivatives.
BODY2_RATES: Final = ("v2", "omega2", "a2", "alpha2")

MotionSource: TypeAlias = HingePair | Scene | SceneResult | Trajectory | SimulatedPlanarMotion

RecordedMotion: TypeAlias = tuple[Array, HingePair, BodyMotion, Array, dict[str, Array]]
"""A motion in memory: instants [s], pair, motion of body 1, psi [rad], and further arrays by name."""


class ShownMotion(NamedTuple):
    """Samples of the motion of a pair, or of a piece of it."""

    #: the pair that moves
    pair: HingePair
    #: title of the plot or the page
    title: str
    #: number of instants of the whole motion
    samples: int
    #: instants [s]; shape (N,)
    t: Array
    #: R1, S1, R2 and S2 by name; shapes (N, 3), (N, 3, 3)
    pose_arrays_by_name: dict[str, Array]
    #: hinge angle [rad]; shape (N,)
    psi: Array
    #: further outputs by name, such as v2: vectors in space, shape (N, 3), or the requested outputs, of any shape (N,
    #: ...)
    outputs_by_name: dict[str, Array]

    @property
    def hinge(self) -> Array:
        """Position of the hinge point, computed from body 1 [m]; shape (N, 3)."""
        point: Array = self.pose_arrays_by_name["R1"] + self.pose_arrays_by_name["S1"] @ self.pair.u1
        return point


def spread_samples(source: object) -> ShownMotion:
    """Return a `ShownMotion` of at most MAX_SHOWN evenly spread samples of the motion of a scene or its result, a
    trajectory or a pair, with the available velocities and accelerations of body 2.
    """
    source = source.scene if isinstance(source, SceneResult) else source
    if isinstance(source, Scene):
        return _scene_samples(source, source.sampled(MAX_SHOWN, _scene_outputs(source, None)), None)
    motion = _recorded_motion(source)
    return _recorded_samples(motion, spread_rows(len(motion[0])), None)


def spread_rows(count: int) -> Rows:
    """Return the indices of at most MAX_SHOWN evenly spread instants out of `count`."""
    return np.unique(np.linspace(0, count - 1, min(count, MAX_SHOWN)).astype(np.intp))


def sample_pieces(source: object, outputs: Iterable[str] | None = None) -> Iterator[ShownMotion]:
    """Yield all samples of the motion of a scene or its result, a trajectory or a pair, piece by piece, as
    `ShownMotion` objects, with the outputs named in `outputs` or, if `outputs` is None, the velocities and
    accelerations of body 2.

    Args:
        source: a scene or its result, a trajectory in space or by `simulate`, or a pair in space.
        outputs: names of the outputs; by default the available rates of body 2.
    """
    if outputs is not None:
        outputs = (outputs,) if isinstance(outputs, str) else tuple(outputs)
        if not outputs:
            raise ArgumentError("outputs", "a tuple of names such as ('R2', 'v2')", "none")
    source = source.scene if isinstance(source, SceneResult) else source
    if isinstance(source, Scene):
        for part in source.blocks(_scene_outputs(source, outputs)):
            yield _scene_samples(source, part, outputs)
    else:
        yield _recorded_samples(_recorded_motion(source), slice(None), outputs)


def _scene_outputs(scene: Scene, outputs: tuple[str, ...] | None) -> tuple[str, ...]:
    """Return `outputs` or, of None, the velocities and accelerations of body 2 that the motion has, and psi."""
    if outputs is not None:
        return outputs
    return (*BODY2_RATES[: 2 * scene.motion.level], "psi")


def _scene_samples(scene: Scene, piece: SceneResult, outputs: tuple[str, ...] | None) -> ShownMotion:
    """Return a piece of a scene's result with `outputs`; None: velocities and accelerations of body 2."""
    arrays, bodies = piece.requested_arrays(), scene.require_pair().poses(piece.known)
    outputs_by_name = arrays if outputs is not None else _rate_vectors(arrays)
    return ShownMotion(scene.space, scene.title, scene.samples, piece.t, bodies, piece.known.psi, outputs_by_name)


def _recorded_samples(motion: RecordedMotion, rows: Rows, outputs: tuple[str, ...] | None) -> ShownMotion:
    """Return the instants `rows` of a motion with `outputs`; None: velocities and accelerations of body 2."""
    t, pair, body1, psi, recorded = motion
    body1, psi = motion_of_rotations(R=body1.R[rows], S=body1.S[rows]), psi[rows]
    points = (*pair.points1, *pair.points2)
    found = pair.forward_kinematics_from_body1(body1, psi, outputs=("R1", "S1", "R2", "S2", *points)).arrays()
    bodies = {name: array for name, array in found.items() if name not in points}
    arrays = {name: array[rows] for name, array in recorded.items()} if recorded else {**found, "psi": psi}
    for name in outputs or ():
        if name not in arrays:
            raise ArgumentError("outputs", choices(tuple(arrays)), quoted(name))
    outputs_by_name = _rate_vectors(arrays) if outputs is None else {name: arrays[name] for name in outputs}
    return ShownMotion(pair, pair.name, len(t), t[rows], bodies, psi, outputs_by_name)


def _recorded_motion(source: object) -> RecordedMotion:
    """Return the motion of a trajectory, or of a pair, in 6 s from limit to limit and back or through a turn."""
    if isinstance(source, Trajectory):
        recorded = source.recorded()  # refuses many motions
        return source.t, source.pair, BodyMotion(R=source.R1, S=source.S1), source.psi, recorded
    if isinstance(source, SimulatedPlanarMotion):
        return source.t, source.space, source.body1, source.psi, source.recorded()
    if not isinstance(source, HingePair):
        expected = "a pair in space, a scene, its result, or a trajectory in space or by `simulate`"
        raise ArgumentError("source", expected, type(source).__name__)
    check_single_pair(source)
    lower, upper = source.limits or (-np.pi, np.pi)
    share = np.linspace(0, 1, 181)
    psi = lower + (upper - lower) * (share if source.limits is None else (1 - np.cos(2 * np.pi * share)) / 2)
    still = BodyMotion(R=np.zeros((181, 3)), S=np.broadcast_to(np.eye(3), (181, 3, 3)))
    return 6 * share, source, still, psi, {}


def _rate_vectors(arrays: dict[str, Array]) -> dict[str, Array]:
    """Return the velocities and accelerations of body 2 among arrays, by name, as vectors in space (N, 3)."""
    return {name: _spatial_vectors(arrays[name]) for name in BODY2_RATES if name in arrays}


def _spatial_vectors(vectors: Array) -> Array:
    """Return vectors in the plane, or numbers along z, as vectors in space; shape (N, 3)."""
    flat = vectors.reshape(len(vectors), -1)
    if flat.shape[1] == 3:
        return flat
    zero = np.zeros((len(flat), 3 - flat.shape[1]))
    return np.concatenate((flat, zero) if flat.shape[1] == 2 else (zero, flat), axis=1)
