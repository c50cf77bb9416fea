"""Energy balance of a simulated motion: the work of each load, by Gauss quadrature over the steps."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from hingepair.dynamics.collocation import (
    NODE_TIMES,
    NODES,
    WEIGHTS,
    StepPolynomial,
)
from hingepair.dynamics.pair_motion import MotionSamples, PairMotion
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.tables import ruled_table
from hingepair.pair.body_motion import BodyMotion, motion_of_rotations
from hingepair.pair.hinge_pair import HingePair

_CHUNK = 20_000  # intervals whose work is computed at a time


class StepRecord(NamedTuple):
    """One step of a simulation."""

    polynomial: StepPolynomial
    quat: Array  # attitude at the start of the step; (4,)
    side: tuple[float, float]  # branch of the torque at the hinge
    held: bool  # whether the hinge is held


@dataclass(frozen=True, eq=False, repr=False)
class EnergyBalance:
    """Energy balance of a motion: the work of each load, and the energies [J]. `print` shows a table."""

    #: instants [s]; shape (N,)
    t: Array
    #: work since the first instant [J], (N,), by load: force1, torque1, force2, torque2 and hinge_torque, or motor,
    #: spring, damper, friction and stop; impacts at rigid stops; base, which moves a body 1 whose motion is given.
    #: Loads that do no work are left out.
    work: Mapping[str, Array]
    #: kinetic energy [J]; shape (N,); without body 1 where its motion is given or it has no mass
    kinetic: Array
    #: potential energy in uniform gravity [J], zero at the world's origin; shape (N,)
    potential: Array

    @property
    def residual(self) -> Array:
        """Change of the energies since the first instant less the work of all loads [J], (N,); numerical errors."""
        total = self.kinetic + self.potential
        return np.asarray(total - total[:1] - sum(self.work.values()))

    def __str__(self) -> str:
        rows = [(name, f"{work[-1]:.6g}") for name, work in self.work.items()]
        rows += [("", "")]
        rows += [(f"{name} energy, change", f"{x[-1] - x[0]:.6g}") for name, x in self._energies()]
        rows += [("residual, largest", f"{np.abs(self.residual).max():.2g}")]
        return "\n".join(ruled_table([(f"work, {self.t[0]:g} to {self.t[-1]:g} s", "J"), *rows]))

    __repr__ = __str__

    def _energies(self) -> tuple[tuple[str, Array], ...]:
        return ("kinetic", self.kinetic), ("potential", self.potential)


class LazyBalance:
    """Callable that computes an `EnergyBalance` at the first call; a copy or a pickle computes it first."""

    def __init__(self, balance: Callable[[], EnergyBalance] | EnergyBalance) -> None:
        self._balance = balance

    def __call__(self) -> EnergyBalance:
        """Return the balance."""
        if not isinstance(self._balance, EnergyBalance):
            self._balance = self._balance()
        return self._balance

    def __reduce__(self) -> tuple[type, tuple[EnergyBalance]]:
        return type(self), (self(),)


def energy_balance(
    motion: PairMotion,
    initial_state: Array,
    steps: Sequence[StepRecord],
    t: Array,
    spatial_pair: HingePair,
    gravity: tuple[float, ...],
    samples: MotionSamples,
) -> EnergyBalance:
    """Return the `EnergyBalance` of a simulated motion, by quadrature over its steps.

    Args:
        motion: the equations of the motion.
        initial_state: the state at the first instant, before its events; shape (k,).
        steps: the steps.
        t: instants [s]; shape (N,).
        spatial_pair: the pair as a pair in space.
        gravity: acceleration of free fall [m/s^2].
        samples: the motion at the instants.
    """
    is_carried = "base" in motion.callable_names
    pair = replace(spatial_pair, body1=None) if is_carried else spatial_pair
    energies = pair.energy(_body1_motion(samples), samples.motion.psi, samples.motion.psid, gravity=gravity)
    work: dict[str, Array] = {}
    if steps:
        elapsed = t - t[0]
        starts = np.array([step.polynomial.start for step in steps])
        edges = np.unique(np.hstack([starts, elapsed]))
        chunks = []
        for first in range(0, max(len(edges) - 1, 1), _CHUNK):
            chunk_edges = edges[first : first + _CHUNK + 1]
            lengths = np.diff(chunk_edges)
            times = chunk_edges[:-1, None] + lengths[:, None] * NODE_TIMES
            step_indices = (np.searchsorted(starts, chunk_edges[:-1], side="right") - 1).tolist()
            states = np.stack(
                [steps[i].polynomial.states_at(row) for i, row in zip(step_indices, times, strict=True)]
            )
            nodes = _sample_within_steps(
                motion,
                t[0] + times.ravel(),
                np.concatenate(states),
                [steps[i] for i in step_indices for _ in NODE_TIMES],
            )
            powers = _powers_by_load(pair, nodes, gravity, is_carried=is_carried)
            chunks.append({name: lengths * (power.reshape(-1, NODES) @ WEIGHTS) for name, power in powers.items()})
        instant_indices = np.searchsorted(edges, elapsed)
        for name in chunks[0]:
            work_of_load = np.hstack([0.0, np.cumsum(np.concatenate([part[name] for part in chunks]))])[
                instant_indices
            ]
            work |= {name: work_of_load} if work_of_load.any() else {}
        impacts = _impact_work(motion, initial_state, steps, t, pair, gravity)
        work |= {"impacts": impacts} if impacts.any() else {}
    kinetic, potential = (np.asarray(energy, np.float64) for energy in energies)
    return EnergyBalance(t, work, kinetic, potential)


def _body1_motion(samples: MotionSamples, **accelerations: Array) -> BodyMotion:
    motion = samples.motion
    return motion_of_rotations(R=motion.R1, S=motion.S1, v=motion.v1, omega=motion.omega1, **accelerations)


def _sample_within_steps(motion: PairMotion, t: Array, states: Array, steps: Sequence[StepRecord]) -> MotionSamples:
    """Return motion and loads at n instants, each with its state and its step."""
    sides = np.array([step.side for step in steps])
    held, quats = np.array([step.held for step in steps]), np.array([step.quat for step in steps])
    return motion.sample(t, states, quats, (sides[:, 0], sides[:, 1]), held)


def _powers_by_load(
    pair: HingePair, samples: MotionSamples, gravity: tuple[float, ...], *, is_carried: bool
) -> dict[str, Array]:
    """Return the power of each load [W], (n,); parts of a HingeLoad take the place of hinge_torque. Where body 1 is
    carried, force1 and torque1 have none, and "base" has that of the support.
    """
    motion, loads = samples.motion, samples.loads
    body1 = _body1_motion(samples, a=samples.a1, alpha=samples.alpha1)
    state = pair.forward_kinematics_from_body1(body1, motion.psi, motion.psid, outputs=("R2", "v2", "omega2"))
    v2, omega2 = np.asarray(state.v2), np.asarray(state.omega2)
    velocities = {"force1": motion.v1, "torque1": motion.omega1, "force2": v2, "torque2": omega2}
    powers = {name: (loads[name] * speed).sum(axis=-1) for name, speed in velocities.items()}
    if is_carried:
        powers |= {"force1": 0 * motion.psi, "torque1": 0 * motion.psi}  # these do not change a given motion
        arm = (motion.S1 @ np.asarray(pair.u1)[:, None])[..., 0]
        point = motion.R1 + arm
        wrench = pair.hinge_wrench(body1, motion.psi, motion.psid, samples.psidd, gravity=gravity)
        force = wrench.force - loads["force2"]
        torque = wrench.torque - loads["torque2"] - np.cross(np.asarray(state.R2) - point, loads["force2"])
        base_power = (force * (motion.v1 + np.cross(motion.omega1, arm))).sum(axis=-1) + (torque * omega2).sum(
            axis=-1
        )
        powers["base"] = base_power - loads["hinge_torque"] * motion.psid
    hinge_parts = {name: load for name, load in loads.items() if name.endswith("_torque") and name != "hinge_torque"}
    hinge_torques = {name.removesuffix("_torque"): load for name, load in hinge_parts.items()} or {
        "hinge_torque": loads["hinge_torque"]
    }
    powers |= {name: load * motion.psid for name, load in hinge_torques.items()}
    return powers


def _impact_work(
    motion: PairMotion,
    initial_state: Array,
    steps: Sequence[StepRecord],
    t: Array,
    pair: HingePair,
    gravity: tuple[float, ...],
) -> Array:
    """Return the kinetic energy [J] that impacts, jumps of the hinge rate between steps, have added up to each
    instant.
    """
    work = np.zeros(len(t))
    column = motion.psi_index + 1
    for last_step, next_step in itertools.pairwise((steps[0], *steps)):
        instant = next_step.polynomial.start
        end_state = (
            initial_state if last_step is next_step else last_step.polynomial.states_at(np.array([instant]))[0]
        )
        rate = end_state[column]
        rate_change = abs(next_step.polynomial.state[column] - rate)
        if rate_change <= 1e-12 * (1 + abs(rate)):
            continue
        states = np.stack([end_state, next_step.polynomial.state])
        samples: Any = _sample_within_steps(motion, np.full(2, t[0] + instant), states, [last_step, next_step])
        kinetic = pair.energy(
            _body1_motion(samples), samples.motion.psi, samples.motion.psid, gravity=gravity
        ).kinetic
        work[t - t[0] > instant] += kinetic[1] - kinetic[0]
    return work
