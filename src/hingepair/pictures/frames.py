"""What a picture shows: a motion at so many instants, of whatever holds one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.dynamics.simulate import SimulatedPlanarMotion
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.integration.trajectory import Trajectory
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.constants import check_one
from hingepair.pair.hinge_pair import HingePair
from hingepair.scenes.scene import Scene, SceneResult

Array: TypeAlias = NDArray[Any]

MOST_FRAMES: Final = 2000
"""Instants of a picture at most, evenly spread: more than a screen has columns."""

RATES: Final = ("v2", "omega2", "a2", "alpha2")

Source: TypeAlias = HingePair | Scene | SceneResult | Trajectory | SimulatedPlanarMotion


class Frames(NamedTuple):
    """A motion as a page shows it.

    Attributes:
        t: instants [s]; shape (N,).
        placements: of body 1 and of body 2, (R, S) each; shapes (N, 3), (N, 3, 3).
        psi: hinge angle [rad]; shape (N,).
        readings: what else is shown, by name, such as v2; shape (N, 3), or as it is where outputs were named.
    """

    t: Array
    placements: tuple[tuple[Array, Array], tuple[Array, Array]]
    psi: Array
    readings: dict[str, Array]


def frames_of(source: object, outputs: Iterable[str] | None = None) -> tuple[HingePair, str, Frames]:
    """The pair, a title and the frames of a source.

    Args:
        source: what holds a motion.
        outputs: the readings; the rates of body 2 that there are unless given.

    Raises:
        ArgumentError: it has no motion in space to show, or no such output.
    """
    if outputs is not None:
        outputs = () if isinstance(outputs, str) else tuple(outputs)
        if not outputs:
            raise ArgumentError("outputs", "a tuple of names such as ('R2', 'v2')", "none, or a text")
    if isinstance(source, HingePair):
        return source, source.name, _turning(source, outputs)
    if isinstance(source, SceneResult):
        source = source.scene
    if isinstance(source, Scene):
        return source.space, source.title, _of_scene(source, outputs)
    if isinstance(source, Trajectory):
        return source.pair, source.pair.name, _of_trajectory(source, source.pair, source.R1, source.S1, outputs)
    if isinstance(source, SimulatedPlanarMotion):
        pair, body1 = source.space, source.body1
        return pair, pair.name, _of_trajectory(source, pair, body1.R, body1.S, outputs)
    expected = "a pair in space, a scene, its result, or a trajectory in space or by `simulate`"
    raise ArgumentError("source", expected, type(source).__name__)


def _turning(pair: HingePair, outputs: Iterable[str] | None) -> Frames:
    """A pair whose hinge turns through its limits and back, body 1 at rest."""
    check_one(pair)
    lower, upper = pair.limits or (-np.pi, np.pi)
    share = np.linspace(0, 1, 181)
    psi = lower + (upper - lower) * (share if pair.limits is None else (1 - np.cos(2 * np.pi * share)) / 2)
    q = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, psi)
    a = pair.forward_kinematics(q, outputs=("R1", "S1", "R2", "S2")).arrays()
    readings = {name: _chosen({**a, "psi": psi}, name) for name in outputs or ()}
    return Frames(6 * share, ((a["R1"], a["S1"]), (a["R2"], a["S2"])), psi, readings)


def _of_scene(scene: Scene, outputs: Iterable[str] | None) -> Frames:
    part = scene.sampled(MOST_FRAMES, (*RATES[: 2 * scene.motion.level], "psi") if outputs is None else outputs)
    bodies, found = part.known.bodies(scene.pair), part.chosen()
    readings = found if outputs is not None else {name: _in_space(a) for name, a in part.state.arrays().items()}
    return Frames(part.t, ((bodies["R1"], bodies["S1"]), (bodies["R2"], bodies["S2"])), part.known.psi, readings)


def _of_trajectory(
    motion: Trajectory | SimulatedPlanarMotion, pair: HingePair, R1: Array, S1: Array, outputs: Iterable[str] | None
) -> Frames:
    rows = np.unique(np.linspace(0, len(motion.t) - 1, min(len(motion.t), MOST_FRAMES)).astype(np.intp))
    body1 = BodyMotion(R=R1[rows], S=S1[rows])
    a = pair.forward_kinematics_from_body1(body1, motion.psi[rows]).arrays()
    found = motion.recorded()
    names = [name for name in RATES if name in found] if outputs is None else outputs
    readings = {name: _chosen(found, name)[rows] for name in names}
    if outputs is None:
        readings = {name: _in_space(array) for name, array in readings.items()}
    return Frames(motion.t[rows], ((body1.R, body1.S), (a["R2"], a["S2"])), motion.psi[rows], readings)


def _chosen(found: dict[str, Array], name: str) -> Array:
    if name not in found:
        raise ArgumentError("outputs", choices(tuple(found)), quoted(name))
    return found[name]


def _in_space(vectors: Array) -> Array:
    """Vectors of the plane as vectors of space; numbers as vectors along z."""
    flat = vectors.reshape(len(vectors), -1)
    if flat.shape[1] == 3:
        return flat
    zero = np.zeros((len(flat), 3 - flat.shape[1]))
    return np.concatenate((flat, zero) if flat.shape[1] == 2 else (zero, flat), axis=1)
