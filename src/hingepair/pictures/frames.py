"""What a picture shows: a motion at so many instants, of whatever holds one."""

from __future__ import annotations

from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError
from hingepair.integration.trajectory import Trajectory
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.constants import check_one
from hingepair.pair.hinge_pair import HingePair
from hingepair.scenes.scene import Scene, SceneResult

Array: TypeAlias = NDArray[Any]

MOST_FRAMES: Final = 2000
"""Instants of a picture at most, evenly spread: more than a screen has columns."""

RATES: Final = ("v2", "omega2", "a2", "alpha2")

Source: TypeAlias = HingePair | Scene | SceneResult | Trajectory


class Frames(NamedTuple):
    """A motion as a page shows it.

    Attributes:
        t: instants [s]; shape (N,).
        placements: of body 1 and of body 2, (R, S) each; shapes (N, 3), (N, 3, 3).
        psi: hinge angle [rad]; shape (N,).
        readings: further vectors by name, such as v2; shape (N, 3).
    """

    t: Array
    placements: tuple[tuple[Array, Array], tuple[Array, Array]]
    psi: Array
    readings: dict[str, Array]


def frames_of(source: object) -> tuple[HingePair, str, Frames]:
    """The pair, a title and the frames of a source.

    Raises:
        ArgumentError: it has no motion in space to show.
    """
    if isinstance(source, HingePair):
        return source, source.name, _turning(source)
    if isinstance(source, SceneResult):
        source = source.scene
    if isinstance(source, Scene):
        return source.space, source.title or source.pair.name, _of_scene(source)
    if isinstance(source, Trajectory):
        return source.pair, source.pair.name, _of_trajectory(source)
    expected = "a pair in space, a scene, its result, or a trajectory in space"
    raise ArgumentError("source", expected, type(source).__name__)


def _turning(pair: HingePair) -> Frames:
    """A pair whose hinge turns through its limits and back, body 1 at rest."""
    check_one(pair)
    lower, upper = pair.limits or (-np.pi, np.pi)
    share = np.linspace(0, 1, 181)
    psi = lower + (upper - lower) * (share if pair.limits is None else (1 - np.cos(2 * np.pi * share)) / 2)
    names = ("R1", "S1", "R2", "S2")
    a = pair.forward_kinematics((0.0, 0.0, 0.0, 0.0, 0.0, 0.0, psi), outputs=names).arrays()
    return Frames(6 * share, ((a["R1"], a["S1"]), (a["R2"], a["S2"])), psi, {})


def _of_scene(scene: Scene) -> Frames:
    rows = _spread(scene.samples)
    known = scene.motion.known(rows, scene.motion.level)
    bodies = known.bodies(scene.pair)
    state = known.forward_kinematics(scene.pair, None).arrays()
    readings: dict[str, Array] = {name: _in_space(state[name]) for name in RATES if name in state}
    placements = (bodies["R1"], bodies["S1"]), (bodies["R2"], bodies["S2"])
    return Frames(scene.motion.t[rows], placements, known.psi, readings)


def _of_trajectory(motion: Trajectory) -> Frames:
    rows = _spread(len(motion.t))
    body1 = BodyMotion(R=motion.R1[rows], S=motion.S1[rows])
    a = motion.pair.forward_kinematics_from_body1(body1, motion.psi[rows]).arrays()
    found = motion.state.arrays()
    readings: dict[str, Array] = {name: found[name][rows] for name in RATES if name in found}
    return Frames(motion.t[rows], ((body1.R, body1.S), (a["R2"], a["S2"])), motion.psi[rows], readings)


def _spread(count: int) -> NDArray[np.intp]:
    """Rows that a page shows."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST_FRAMES)).astype(np.intp))


def _in_space(vectors: Array) -> Array:
    """Vectors of the plane as vectors of space; numbers as vectors along z."""
    flat = vectors.reshape(len(vectors), -1)
    if flat.shape[1] == 3:
        return flat
    zero = np.zeros((len(flat), 3 - flat.shape[1]))
    return np.concatenate((flat, zero) if flat.shape[1] == 2 else (zero, flat), axis=1)
