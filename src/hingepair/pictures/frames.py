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
        pair: what moves.
        title: of the picture.
        t: instants [s]; shape (N,).
        bodies: R1, S1, R2 and S2 by name; shapes (N, 3), (N, 3, 3).
        psi: hinge angle [rad]; shape (N,).
        readings: what else is shown, by name, such as v2; shape (N, 3), or as it is where outputs were named.
    """

    pair: HingePair
    title: str
    t: Array
    bodies: dict[str, Array]
    psi: Array
    readings: dict[str, Array]

    @property
    def hinge(self) -> Array:
        """The hinge point as body 1 has it; shape (N, 3)."""
        point: Array = self.bodies["R1"] + self.bodies["S1"] @ self.pair.u1
        return point


def frames_of(source: object, outputs: Iterable[str] | None = None) -> Frames:
    """The frames of a source.

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
    if isinstance(source, SceneResult):
        source = source.scene
    if isinstance(source, Scene):
        names = (*RATES[: 2 * source.motion.level], "psi") if outputs is None else outputs
        part = source.sampled(MOST_FRAMES, names)
        found, bodies = part.chosen(), part.known.bodies(source.pair)
        readings = found if outputs is not None else _rates(found)
        return Frames(source.space, source.title, part.t, bodies, part.known.psi, readings)
    t, pair, body1, psi, recorded = _motion(source)
    rows = np.unique(np.linspace(0, len(t) - 1, min(len(t), MOST_FRAMES)).astype(np.intp))
    body1, psi = BodyMotion(R=body1.R[rows], S=body1.S[rows]), psi[rows]
    bodies = pair.forward_kinematics_from_body1(body1, psi, outputs=("R1", "S1", "R2", "S2")).arrays()
    found = {name: array[rows] for name, array in recorded.items()} if recorded else {**bodies, "psi": psi}
    for name in outputs or ():
        if name not in found:
            raise ArgumentError("outputs", choices(tuple(found)), quoted(name))
    readings = _rates(found) if outputs is None else {name: found[name] for name in outputs}
    return Frames(pair, pair.name, t[rows], bodies, psi, readings)


def _motion(source: object) -> tuple[Array, HingePair, BodyMotion, Array, dict[str, Array]]:
    """Instants, pair, body 1, psi and what was recorded; a bare pair turns its hinge to the limits and back."""
    if isinstance(source, Trajectory):
        return source.t, source.pair, BodyMotion(R=source.R1, S=source.S1), source.psi, source.recorded()
    if isinstance(source, SimulatedPlanarMotion):
        return source.t, source.space, source.body1, source.psi, source.recorded()
    if not isinstance(source, HingePair):
        expected = "a pair in space, a scene, its result, or a trajectory in space or by `simulate`"
        raise ArgumentError("source", expected, type(source).__name__)
    check_one(source)
    lower, upper = source.limits or (-np.pi, np.pi)
    share = np.linspace(0, 1, 181)
    psi = lower + (upper - lower) * (share if source.limits is None else (1 - np.cos(2 * np.pi * share)) / 2)
    still = BodyMotion(R=np.zeros((181, 3)), S=np.broadcast_to(np.eye(3), (181, 3, 3)))
    return 6 * share, source, still, psi, {}


def _rates(found: dict[str, Array]) -> dict[str, Array]:
    """The rates among them, in space."""
    return {name: _in_space(found[name]) for name in RATES if name in found}


def _in_space(vectors: Array) -> Array:
    """Vectors of the plane as vectors of space; numbers as vectors along z."""
    flat = vectors.reshape(len(vectors), -1)
    if flat.shape[1] == 3:
        return flat
    zero = np.zeros((len(flat), 3 - flat.shape[1]))
    return np.concatenate((flat, zero) if flat.shape[1] == 2 else (zero, flat), axis=1)
