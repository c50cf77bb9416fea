"""Energy balance of a simulated motion: the work of each load, by Gauss quadrature over the steps."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from hingepair.dynamics.collocation import (
    NODE_QUADRATURE_WEIGHTS,
    NODES_PER_STEP,
    RELATIVE_NODE_TIMES,
    StepPolynomial,
)
from hingepair.dynamics.pair_motion import MotionSamples, PairMotion
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.tables import ruled_table
from hingepair.pair.body_motion import BodyMotion, motion_of_rotations
from hingepair.pair.hinge_pair import HingePair

_MIN_RELATIVE_HINGE_RATE_CHANGE_BY_IMPACT = 1e-12  # of 1 + |psi'|: a larger jump of psi' between steps is an impact
_QUADRATURE_INTERVALS_PER_WORK_CHUNK = 20_000  # intervals whose work is computed at a time


class StepRecord(NamedTuple):
    """Record of one step of a simulation: its StepPolynomial, the attitude `quat` (4,) at its start, the pair `side`
    (angle, rate), which selects the smooth branch of the hinge torque, and `held`, whether the hinge is held.
    """

    polynomial: StepPolynomial
    quat: Array  # attitude at the start of the step; (4,)
    side: tuple[float, float]  # branch of the torque at the hinge
    held: bool  # whether the hinge is held


@dataclass(frozen=True, eq=False, repr=False)
class EnergyBalance:
    """Energy balance of a motion at instants t: the work of each load by name, and the kinetic and potential energies
    [J], an array (N,) each. `print` shows a table.

    Attributes:
        t: instants [s]; shape (N,).
        work: work of each load since the first instant [J], by name, shape (N,): force1, torque1, force2, torque2
            and hinge_torque (for a HingeLoad instead motor, spring, damper, friction and stop); impacts at rigid
            stops; base, which moves a body 1 whose motion is given. Loads that do no work are left out.
        kinetic: kinetic energy [J]; shape (N,); without body 1 where its motion is given or it has no mass.
        potential: potential energy in uniform gravity [J], zero at the world's origin; shape (N,).
    """

    t: Array
    work: Mapping[str, Array]
    kinetic: Array
    potential: Array

    @property
    def residual(self) -> Array:
        """Change of the kinetic and potential energy since the first instant minus the work of all loads [J], an
        array (N,); 0 except for numerical errors.
        """
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
    """Callable that returns an `EnergyBalance`, which is computed at the first call and then kept. A copy or a pickle
    computes the balance first.
    """

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
    """Compute the `EnergyBalance` of a simulated motion at the instants t: the work of each load by quadrature over
    `steps`, a sequence of StepRecords, and the energies from the MotionSamples `samples` at the instants. Loads that
    do no work are left out; if impacts change the energy, their work is named "impacts". `initial_state` is the state
    vector before the first event.

    Args:
        motion: the equations of the motion.
        initial_state: the state at the first instant; shape (k,).
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
        for first in range(0, max(len(edges) - 1, 1), _QUADRATURE_INTERVALS_PER_WORK_CHUNK):
            chunk_edges = edges[first : first + _QUADRATURE_INTERVALS_PER_WORK_CHUNK + 1]
            lengths = np.diff(chunk_edges)
            times = chunk_edges[:-1, None] + lengths[:, None] * RELATIVE_NODE_TIMES
            step_indices = (np.searchsorted(starts, chunk_edges[:-1], side="right") - 1).tolist()
            states = np.stack(
                [steps[i].polynomial.states_at(row) for i, row in zip(step_indices, times, strict=True)]
            )
            nodes = _sample_within_steps(
                motion,
                t[0] + times.ravel(),
                np.concatenate(states),
                [steps[i] for i in step_indices for _ in RELATIVE_NODE_TIMES],
            )
            powers = _powers_by_load(pair, nodes, gravity, is_carried=is_carried)
            chunks.append(
                {
                    name: lengths * (power.reshape(-1, NODES_PER_STEP) @ NODE_QUADRATURE_WEIGHTS)
                    for name, power in powers.items()
                }
            )
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
    """Return the motion of body 1 in MotionSamples as a BodyMotion. Accelerations, if any, are added by keyword."""
    motion = samples.motion
    return motion_of_rotations(R=motion.R1, S=motion.S1, v=motion.v1, omega=motion.omega1, **accelerations)


def _sample_within_steps(motion: PairMotion, t: Array, states: Array, steps: Sequence[StepRecord]) -> MotionSamples:
    """Return MotionSamples of motion and loads at n instants. `states`, (n, k), and `steps`, a StepRecord for each
    instant, give the state and the step.
    """
    sides = np.array([step.side for step in steps])
    held, quats = np.array([step.held for step in steps]), np.array([step.quat for step in steps])
    return motion.sample(t, states, quats, (sides[:, 0], sides[:, 1]), held)


def _powers_by_load(
    pair: HingePair, samples: MotionSamples, gravity: tuple[float, ...], *, is_carried: bool
) -> dict[str, Array]:
    """Compute the power of each load [W] from the motion and loads in MotionSamples; return a dict of arrays (n,) by
    name. Parts of a HingeLoad, such as "spring", take the place of "hinge_torque". If `is_carried` is True, the
    motion of body 1 is given: the powers of force1 and torque1 are then 0, and "base" is the power of the support
    that moves body 1.
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
    """Return an array (N,) of the kinetic energy [J] that impacts have added between t[0] and each instant, mostly
    negative. An impact is a jump of the hinge rate between two of the StepRecords `steps`, or between `initial_state`
    and the first of them.
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
        if rate_change <= _MIN_RELATIVE_HINGE_RATE_CHANGE_BY_IMPACT * (1 + abs(rate)):
            continue
        states = np.stack([end_state, next_step.polynomial.state])
        samples: Any = _sample_within_steps(motion, np.full(2, t[0] + instant), states, [last_step, next_step])
        kinetic = pair.energy(
            _body1_motion(samples), samples.motion.psi, samples.motion.psid, gravity=gravity
        ).kinetic
        work[t - t[0] > instant] += kinetic[1] - kinetic[0]
    return work
