"""What acts for a pair to move as a scene says (D1-D5)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hingepair.dynamics.simulate import SimulatedMotion, SimulatedPlanarMotion
from hingepair.errors import ArgumentError
from hingepair.evaluation.plan import ACCELERATION
from hingepair.numeric.arrays import Float64Array, one_constant
from hingepair.pair.dynamics import GRAVITY
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PLANAR_GRAVITY, PlanarPair
from hingepair.scenes.motion import Motion


def massive(pair: HingePair | PlanarPair) -> HingePair:
    """The pair in space, of bodies with their masses."""
    return pair.massive() if isinstance(pair, PlanarPair) else pair


def fall_of(pair: HingePair | PlanarPair, motion: Motion) -> tuple[float, ...]:
    """Acceleration of free fall in space: that of [dynamics], or the usual."""
    if motion.simulated:
        return motion.simulated.gravity
    return (*PLANAR_GRAVITY, 0.0) if isinstance(pair, PlanarPair) else GRAVITY


def forces(own: HingePair | PlanarPair, motion: Motion, gravity: ArrayLike | None) -> dict[str, Float64Array]:
    """By name, as `Scene.forces` says.

    Args:
        own: the pair.
        motion: its motion.
        gravity: as for `Scene.forces`.
    """
    flat = isinstance(own, PlanarPair)
    if motion.level < ACCELERATION:
        raise ArgumentError("scene", f"a motion with accelerations, which forces need{motion.hint}", motion.origin)
    if gravity is None:
        gravity = fall_of(own, motion)
    elif motion.simulated:
        raise ArgumentError("gravity", "none beside [dynamics], which has its own", gravity)
    elif flat:
        gravity = (*one_constant("gravity", gravity, 2), 0.0)
    pair, moved = massive(own), motion.known(slice(None), ACCELERATION).accelerated(own)
    wrench = pair.hinge_wrench(*moved, gravity)
    found = {
        "hinge_torque": wrench.hinge_torque,
        "bearing_torque": wrench.bearing_torque,
        "hinge_force": wrench.force,
    }
    if pair.body1 is not None:
        given = pair.inverse_dynamics(*moved, gravity)
        found |= {"force1": given.force1, "torque1": given.torque1}
    if motion.simulated:
        others = _of_others(pair, motion.simulated)
        found = {name: array - others[name] for name, array in found.items()}
    if flat:
        del found["bearing_torque"]
        found |= {name: found[name][:, :2] for name in ("hinge_force", "force1") if name in found}
        found |= {name: found[name][:, 2] for name in ("torque1",) if name in found}
    return found


def _of_others(pair: HingePair, found: SimulatedMotion | SimulatedPlanarMotion) -> dict[str, Float64Array]:
    """What of the forces the loads on body 2 give already."""
    state = pair.forward_kinematics_from_body1(found.body1, found.psi, outputs=("S2", "d"))
    force, torque = found.loads["force2"], found.loads["torque2"]
    about = torque - np.cross(state.S2 @ pair.u2, force)
    axis = found.body1.S @ pair.n
    turn = (axis * about).sum(axis=-1)
    return {
        "hinge_torque": turn,
        "bearing_torque": about - axis * turn[:, None],
        "hinge_force": force,
        "force1": force,
        "torque1": torque + np.cross(state.d, force),
    }
