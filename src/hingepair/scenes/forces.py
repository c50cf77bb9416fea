"""The forces that the motion of a scene takes (D1-D5), with what limits, gravity and noise mean for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.dynamics.simulate import SimulatedMotion, SimulatedPlanarMotion
from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import Float64Array, one_constant
from hingepair.numeric.tables import Sheet, instant_text, unit_of
from hingepair.pair.hinge_load import HINGE_PARTS
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.pair.results import Record
from hingepair.plans.plan import ACCELERATION
from hingepair.scenes.known_motion import ByBody1, KnownMotion
from hingepair.scenes.log_noise import LogNoise, finite_rms, noise_rows
from hingepair.scenes.logged_motion import ORDER
from hingepair.scenes.motion import Motion, massive

_MIN_NOISE_SHARE: Final = 0.01  # of the hinge torque's rms: from here on smoothing is recommended
_NOISE_UNITS: Final = {"S1": "rad"}
"""Units of the noise of measured quantities where they are not the unit of the quantity itself."""


class SceneForces(Record):
    """Forces over the instants of a scene: `forces.hinge_torque`, `forces["force1"]`, tables and files.

    Args:
        gravity: acceleration of free fall that they were computed with [m/s^2]; shape (3,), in the plane (2,).
        noise: of a log, the standard deviation that its noise causes in each of the arrays, away from the ends of the
            log; by name, shape () or (k,). Empty of other motions.
        notes: sentences that a reader should know.
        record: the arguments of a `Record`.
    """

    __slots__ = ("gravity", "noise", "notes")

    def __init__(
        self,
        *record: Any,
        gravity: tuple[float, ...],
        noise: Mapping[str, Float64Array],
        notes: tuple[str, ...],
    ) -> None:
        super().__init__(*record)
        self.gravity = gravity
        self.noise = noise
        self.notes = notes

    def _sheet(self) -> Sheet:
        return super()._sheet()._replace(notes=self.notes)


def pair_scene_forces(
    motion: Motion,
    pair: HingePair | PlanarPair,
    t: Float64Array,
    gravity: ArrayLike | None,
    title: str,
    files: tuple[Path, ...],
) -> SceneForces:
    """Compute what acts for a pair to move as a scene says; `Scene.forces` has the words.

    Raises:
        ArgumentError: body 2 has no mass properties, the motion has no accelerations, or gravity is given beside
            [dynamics].
    """
    if motion.level < ACCELERATION:
        raise ArgumentError("scene", f"a motion with accelerations, which forces need{motion.hint}", motion.origin)
    flat, size = isinstance(pair, PlanarPair), 2 if isinstance(pair, PlanarPair) else 3
    fall = motion.gravity(pair)
    if gravity is not None:
        if motion.simulated:
            raise ArgumentError("gravity", "none beside [dynamics], which has its own", gravity)
        fall = (*one_constant("gravity", gravity, size).tolist(), 0.0)[:3]
    known = motion.given.part(slice(None), ACCELERATION)
    arrays = _required(pair, known.in_space(pair), fall)
    if motion.simulated:
        given_already = _of_loads_on_body2(massive(pair), motion.simulated)
        arrays = {name: array - given_already[name] for name, array in arrays.items()}
        loads = motion.simulated.loads
        parts = {name: loads[name] for part in HINGE_PARTS if (name := f"{part}_torque") in loads}
        arrays = {"hinge_torque": arrays.pop("hinge_torque"), **parts, **arrays}
    notes = [*_not_finite_note(arrays), *_beyond_torque_limit(pair, t, arrays)]
    if flat and gravity is None and not motion.simulated:
        down = ", ".join(f"{component:g}" for component in fall[:size])
        notes.append(f"gravity is taken along -y of the plane, ({down}) m/s^2; seen from above it is --gravity 0,0")
    noise: dict[str, Float64Array] = {}
    if motion.derived is not None and len(t) > ORDER:
        noise, sentence = _force_noise(pair, t, known, motion.derived, fall, arrays)
        notes.append(sentence)
    record = t, _in_plane(arrays) if flat else arrays, f"forces: {title}", files
    return SceneForces(*record, gravity=fall[:size], noise=noise, notes=tuple(notes))


def _required(pair: HingePair | PlanarPair, known: ByBody1, gravity: tuple[float, ...]) -> dict[str, NDArray[Any]]:
    """Compute the forces that a motion in space takes, by name; world axes, shape (N,) or (N, 3)."""
    space = massive(pair)
    psi, psid, psidd = known.hinge
    wrench = space.hinge_wrench(known.body1, psi, psid, psidd, gravity)
    arrays = {"hinge_torque": wrench.hinge_torque, "bearing_torque": wrench.bearing_torque}
    arrays |= {"hinge_force": wrench.force}
    if pair.body1 is not None:
        forces = space.inverse_dynamics(known.body1, psi, psid, psidd, gravity)
        arrays |= {"force1": forces.force1, "torque1": forces.torque1}
    return arrays


def _of_loads_on_body2(pair: HingePair, motion: SimulatedMotion | SimulatedPlanarMotion) -> dict[str, NDArray[Any]]:
    """Compute the part of the forces, by name, that the loads on body 2 give already."""
    state = pair.forward_kinematics_from_body1(motion.body1, motion.psi, outputs=("S2", "d"))
    force, torque = motion.loads["force2"], motion.loads["torque2"]
    about = torque - np.cross(state.S2 @ pair.u2, force)
    axis = motion.body1.S @ pair.n
    turn = (axis * about).sum(axis=-1)
    return {
        "hinge_torque": turn,
        "bearing_torque": about - axis * turn[:, None],
        "hinge_force": force,
        "force1": force,
        "torque1": torque + np.cross(state.d, force),
    }


def _in_plane(arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the components in the plane z = 0: two of a force, one of a torque; no bearing torque is left."""
    components: dict[str, slice | int] = {"hinge_force": slice(2), "force1": slice(2), "torque1": 2}
    return {
        name: array[..., components[name]] if name in components else array
        for name, array in arrays.items()
        if name != "bearing_torque"
    }


def _not_finite_note(arrays: Mapping[str, NDArray[Any]]) -> Iterator[str]:
    """Yield a sentence on instants whose forces are not finite, if there are any."""
    finite = [np.isfinite(array).reshape(len(array), -1).all(axis=1) for array in arrays.values()]
    lost = int((~np.logical_and.reduce(finite)).sum())
    if lost:
        yield f"{lost} of {len(finite[0])} instants have forces that are not finite; ranges are those of the others"


def _beyond_torque_limit(
    pair: HingePair | PlanarPair, t: Float64Array, arrays: Mapping[str, NDArray[Any]]
) -> Iterator[str]:
    """Yield a sentence on instants at which the motor, or all that acts about the axis, exceeds the torque limit."""
    limit = getattr(pair, "torque_limit", None)
    if limit is None:
        return
    name = "motor_torque" if "motor_torque" in arrays else "hinge_torque"
    beyond = np.flatnonzero(np.abs(arrays[name]) > limit)
    if beyond.size:
        first = f"first at t = {instant_text(t[beyond[0]])} s ({arrays[name][beyond[0]]:.6g})"
        yield f"{name} exceeds the torque_limit, {limit:g} N m, at {beyond.size} of {len(t)} instants, {first}"


def _force_noise(
    pair: HingePair | PlanarPair,
    t: Float64Array,
    known: KnownMotion,
    derived: tuple[str, ...],
    gravity: tuple[float, ...],
    arrays: Mapping[str, NDArray[Any]],
) -> tuple[dict[str, Float64Array], str]:
    """Return the standard deviation that the noise of a log causes in each force, by name, and a sentence on it."""
    rows = noise_rows(len(t))
    log = LogNoise(t[rows] - t[rows.start], derived, ORDER)
    noisy = _required(pair, log.added_to(known.part(rows, ACCELERATION)).in_space(pair), gravity)
    inside, sizes = slice(ORDER // 2, -(ORDER // 2)), log.sizes
    changes = {name: (own - arrays[name][rows])[inside] for name, own in noisy.items()}
    noise = {name: finite_rms(change) for name, change in changes.items()}
    torque, rms = float(noise["hinge_torque"]), float(finite_rms(arrays["hinge_torque"]))
    psidd = _two_digits(sizes.pop("psidd", 0.0))
    columns = [
        f"{_two_digits(size)} {_NOISE_UNITS.get(name) or unit_of(name)} of {name}" for name, size in sizes.items()
    ]
    sentence = (
        f"noise of the log, by local fits: {', '.join(columns) or 'none'}; it makes {psidd} rad/s^2 of psi'' and "
        f"{_two_digits(torque)} N m of hinge_torque, whose rms is {_two_digits(rms)} "
        "(standard deviations; more near the ends)"
    )
    if torque > _MIN_NOISE_SHARE * rms:
        sentence += "; hp.smooth(t, psi) finds psi'' of noisy samples, hp.smooth(t, body1) the motion of body 1"
    return noise, sentence


def _two_digits(number: float) -> str:
    return f"{float(f'{number:.2g}'):g}"
