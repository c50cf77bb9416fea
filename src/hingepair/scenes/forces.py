"""The forces that the motion of a scene takes (D1-D5), with what limits, gravity and noise mean for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.dynamics.simulate import SimulatedMotion, SimulatedPlanarMotion
from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import Float64Array, one_constant
from hingepair.numeric.tables import Sheet, instant_text, unit_of
from hingepair.pair.hinge_load import HINGE_TORQUE_PART_NAMES
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.pair.results import Record
from hingepair.plans.plan import ACCELERATION
from hingepair.scenes.motions.known import KnownMotion, MotionByBody1
from hingepair.scenes.motions.logs import DIFFERENCE_ORDER
from hingepair.scenes.motions.motion import Motion, massive, non_finite_sentences
from hingepair.scenes.motions.noise import (
    NOISY_EFFORT,
    LogNoise,
    finite_rms,
    motion_with_errors,
    noise_rows,
)


class SceneForces(Record):
    """Forces of a pair at the instants of a scene.

    Args:
        gravity: acceleration of free fall that the forces were computed with [m/s^2]; shape (3,), in the plane (2,).
        noise: standard deviation that the noise of a log causes in each force array, away from the ends of the log;
            dict by name, shape () or (k,). Empty if the motion is not from a log.
        notes: sentences for readers of the forces.
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
    """Return the SceneForces that a pair's Motion requires; `t` holds all instants of the motion. `gravity` is a
    vector, with two components in the plane, or None for the motion's own gravity. `title` and `files` are the
    scene's title and input files.
    """
    if motion.level < ACCELERATION:
        raise ArgumentError("scene", f"a motion with accelerations, which forces need{motion.hint}", motion.origin)
    flat, size = isinstance(pair, PlanarPair), 2 if isinstance(pair, PlanarPair) else 3
    fall = motion.gravity(pair)
    if gravity is not None:
        if motion.simulated:
            raise ArgumentError("gravity", "None, since the table [dynamics] of the scene has a gravity", gravity)
        fall = (*one_constant("gravity", gravity, size).tolist(), 0.0)[:3]
    known_motion = motion.source.part(slice(None), ACCELERATION)
    arrays = _required_forces(pair, known_motion.in_space(pair), fall)
    if motion.simulated:
        given_already = _forces_from_body2_loads(massive(pair), motion.simulated)
        arrays = {name: array - given_already[name] for name, array in arrays.items()}
        loads = motion.simulated.loads
        parts = {name: loads[name] for part in HINGE_TORQUE_PART_NAMES if (name := f"{part}_torque") in loads}
        arrays = {"hinge_torque": arrays.pop("hinge_torque"), **parts, **arrays}
    notes = [*non_finite_sentences(arrays), *_torque_limit_sentences(pair, t, arrays)]
    if flat and gravity is None and not motion.simulated:
        down = ", ".join(f"{component:g}" for component in fall[:size])
        notes.append(f"gravity is taken along -y of the plane, ({down}) m/s^2; seen from above it is --gravity 0,0")
    noise: dict[str, Float64Array] = {}
    if motion.deviations is not None:
        noise, sentence = _smoothed_force_noise(pair, known_motion.in_space(pair), motion.deviations, fall, arrays)
        notes.append(sentence)
    elif motion.derived is not None and len(t) > DIFFERENCE_ORDER:
        noise, sentence = _force_noise(pair, t, known_motion, motion.derived, fall, arrays)
        notes.append(sentence)
    record = t, _plane_components(arrays) if flat else arrays, f"forces: {title}", files
    return SceneForces(*record, gravity=fall[:size], noise=noise, notes=tuple(notes))


def _required_forces(
    pair: HingePair | PlanarPair, body1_motion: MotionByBody1, gravity: tuple[float, ...]
) -> dict[str, NDArray[Any]]:
    """Return the forces and torques that a pair's motion requires, a dict of arrays by name, in world axes."""
    space = massive(pair)
    psi, psid, psidd = body1_motion.hinge
    wrench = space.hinge_wrench(body1_motion.body1, psi, psid, psidd, gravity=gravity)
    arrays = {"hinge_torque": wrench.hinge_torque, "bearing_torque": wrench.bearing_torque}
    arrays |= {"hinge_force": wrench.force}
    if pair.body1 is not None:
        forces = space.inverse_dynamics(body1_motion.body1, psi, psid, psidd, gravity=gravity)
        arrays |= {"force1": forces.force1, "torque1": forces.torque1}
    return arrays


def _forces_from_body2_loads(
    pair: HingePair, motion: SimulatedMotion | SimulatedPlanarMotion
) -> dict[str, NDArray[Any]]:
    """Return the part of each required force that the applied loads on body 2 of a simulated motion supply, a dict of
    arrays by name, in world axes.
    """
    state = pair.forward_kinematics_from_body1(motion.body1, motion.psi, outputs=("S2", "d"))
    force, torque = motion.loads["force2"], motion.loads["torque2"]
    hinge_point_torque = torque - np.cross(state.S2 @ pair.u2, force)
    axis = motion.body1.S @ pair.n
    axial_torque = (axis * hinge_point_torque).sum(axis=-1)
    return {
        "hinge_torque": axial_torque,
        "bearing_torque": hinge_point_torque - axis * axial_torque[:, None],
        "hinge_force": force,
        "force1": force,
        "torque1": torque + np.cross(state.d, force),
    }


def _plane_components(force_arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return a copy of a dict of arrays by name with the components in the plane only: x and y of hinge_force and
    force1, z of torque1.
    """
    components: dict[str, slice | int] = {"hinge_force": slice(2), "force1": slice(2), "torque1": 2}
    return {
        name: array[..., components[name]] if name in components else array
        for name, array in force_arrays.items()
        if name != "bearing_torque"
    }


def _torque_limit_sentences(
    pair: HingePair | PlanarPair, t: Float64Array, force_arrays: Mapping[str, NDArray[Any]]
) -> Iterator[str]:
    """Yield one sentence if the pair has a torque_limit and motor_torque, or hinge_torque if there is no motor,
    exceeds this limit at any of the instants t; otherwise yield nothing.
    """
    limit = getattr(pair, "torque_limit", None)
    if limit is None:
        return
    name = "motor_torque" if "motor_torque" in force_arrays else "hinge_torque"
    beyond = np.flatnonzero(np.abs(force_arrays[name]) > limit)
    if beyond.size:
        first = f"first at t = {instant_text(t[beyond[0]])} s ({force_arrays[name][beyond[0]]:.6g})"
        yield f"{name} exceeds the torque_limit, {limit:g} N m, at {beyond.size} of {len(t)} instants, {first}"


def _force_noise(
    pair: HingePair | PlanarPair,
    t: Float64Array,
    motion: KnownMotion,
    derived_names: tuple[str, ...],
    gravity: tuple[float, ...],
    force_arrays: Mapping[str, NDArray[Any]],
) -> tuple[dict[str, Float64Array], str]:
    """Return (deviations, note): the standard deviation that noise of the log causes in each force, a dict of arrays
    by name, and a sentence on that noise.
    """
    rows = noise_rows(len(t))
    log = LogNoise(t[rows] - t[rows.start], derived_names, DIFFERENCE_ORDER)
    noisy = _required_forces(pair, log.with_noise_added(motion.part(rows, ACCELERATION)).in_space(pair), gravity)
    inside, sizes = slice(DIFFERENCE_ORDER // 2, -(DIFFERENCE_ORDER // 2)), log.sizes
    changes = {name: (own - force_arrays[name][rows])[inside] for name, own in noisy.items()}
    noise = {name: finite_rms(change) for name, change in changes.items()}
    torque, rms = float(noise["hinge_torque"]), float(finite_rms(force_arrays["hinge_torque"]))
    psidd = _two_digits(sizes.pop("psidd", 0.0))
    columns = [
        f"{_two_digits(size)} {'rad' if name == 'S1' else unit_of(name)} of {name}" for name, size in sizes.items()
    ]
    sentence = (
        f"noise of the log, by local fits: {', '.join(columns) or 'none'}; it makes {psidd} rad/s^2 of psi'' and "
        f"{_two_digits(torque)} N m of hinge_torque, whose rms is {_two_digits(rms)} "
        "(standard deviations; more near the ends)"
    )
    if torque > NOISY_EFFORT * rms:
        sentence += "; hp.smooth(t, psi) finds psi'' of noisy samples, hp.smooth(t, body1) the motion of body 1"
    return noise, sentence


def _smoothed_force_noise(
    pair: HingePair | PlanarPair,
    motion: MotionByBody1,
    deviations: Mapping[str, Float64Array],
    gravity: tuple[float, ...],
    force_arrays: Mapping[str, NDArray[Any]],
) -> tuple[dict[str, Float64Array], str]:
    """Return (force_deviations, note): the standard deviation that the errors of a smoothed motion cause in each
    force, a dict of arrays by name, and a sentence on these errors.
    """
    rows = noise_rows(len(deviations["psi"]))
    random = np.random.default_rng(0)
    errors = {name: own[rows] * random.standard_normal(own[rows].shape) for name, own in deviations.items()}
    noisy = _required_forces(pair, motion_with_errors(motion.part(rows, ACCELERATION), errors), gravity)
    noise = {name: finite_rms(own - force_arrays[name][rows]) for name, own in noisy.items()}
    psidd, torque = float(finite_rms(deviations["psidd"][rows])), float(noise["hinge_torque"])
    rms = _two_digits(float(finite_rms(force_arrays["hinge_torque"])))
    return noise, (
        f"noise of the log, after smoothing: {_two_digits(psidd)} rad/s^2 of psi'' and {_two_digits(torque)} N m of "
        f"hinge_torque, whose rms is {rms} (standard deviations over the whole log; largest near its ends)"
    )


def _two_digits(number: float) -> str:
    return f"{float(f'{number:.2g}'):g}"
