"""The energy balance of a simulated motion: what each load has done, by Gauss quadrature along its steps."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from hingepair.dynamics.bases import Course, PairMotion
from hingepair.dynamics.collocation import NODES, TIMES, WEIGHTS, Array, Piece
from hingepair.numeric.tables import ruled_table
from hingepair.pair.body_motion import BodyMotion, motion_of_rotations
from hingepair.pair.hinge_pair import HingePair

_JUMP = 1e-12  # of 1 + |psi'|: between steps, from which on it is an impact


_CHUNK = 20_000  # intervals between instants and steps that are summed at once


class Leg(NamedTuple):
    """One step of a motion."""

    piece: Piece
    quat: Array  # the attitude with which it begins
    side: tuple[float, float]  # of the kinks of the torque at the hinge
    held: bool  # whether the hinge is


@dataclass(frozen=True, eq=False, repr=False)
class EnergyBalance:
    """Where the energy of a motion comes from and where it goes; `print` it.

    Attributes:
        t: instants [s]; shape (N,).
        work: what each load has done since the first instant [J], by name, shape (N,): force1, torque1, force2,
            torque2 and hinge_torque, of a HingeLoad in its place motor, spring, damper, friction and stop; impacts,
            at rigid stops; base, what moves a body 1 that moves as given. Only those that act.
        kinetic: kinetic energy [J]; shape (N,). Of a body 1 that moves as given, and of one without masses, none.
        potential: potential energy in uniform gravity [J], zero at the world's origin; shape (N,).
    """

    t: Array
    work: Mapping[str, Array]
    kinetic: Array
    potential: Array

    @property
    def residual(self) -> Array:
        """What the energies have grown by more than the work of all loads [J]; shape (N,)."""
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


class BalanceOnDemand:
    """An energy balance that is computed at the first call; copies and pickles hold the balance."""

    def __init__(self, work: Callable[[], EnergyBalance] | EnergyBalance) -> None:
        self._work = work

    def __call__(self) -> EnergyBalance:
        """Return the balance."""
        if not isinstance(self._work, EnergyBalance):
            self._work = self._work()
        return self._work

    def __reduce__(self) -> tuple[type, tuple[EnergyBalance]]:
        return type(self), (self(),)


def energy_balance(
    motion: PairMotion,
    begin: Array,
    legs: Sequence[Leg],
    t: Array,
    space: HingePair,
    gravity: tuple[float, ...],
    course: Course,
) -> EnergyBalance:
    """Compute the energy balance of a motion.

    Args:
        motion: the motion.
        begin: its state at the first instant; shape (k,).
        legs: its steps.
        t: instants [s]; shape (N,).
        space: the pair, in space.
        gravity: acceleration of free fall [m/s^2].
        course: the motion at the instants.
    """
    carried = "base" in motion.callables
    pair = replace(space, body1=None) if carried else space
    energies = pair.energy(_body1(course), course.now.psi, course.now.psid, gravity)
    work: dict[str, Array] = {}
    if legs:
        since = t - t[0]
        starts = np.array([leg.piece.start for leg in legs])
        edges = np.unique(np.hstack([starts, since]))
        parts = []
        for first in range(0, max(len(edges) - 1, 1), _CHUNK):
            some = edges[first : first + _CHUNK + 1]
            lengths = np.diff(some)
            times = some[:-1, None] + lengths[:, None] * TIMES
            within = (np.searchsorted(starts, some[:-1], side="right") - 1).tolist()
            states = np.stack([legs[i].piece.at(row) for i, row in zip(within, times, strict=True)])
            nodes = _read(
                motion, t[0] + times.ravel(), np.concatenate(states), [legs[i] for i in within for _ in TIMES]
            )
            powers = _powers(pair, nodes, gravity, carried=carried)
            parts.append({name: lengths * (power.reshape(-1, NODES) @ WEIGHTS) for name, power in powers.items()})
        at = np.searchsorted(edges, since)
        for name in parts[0]:
            done = np.hstack([0.0, np.cumsum(np.concatenate([part[name] for part in parts]))])[at]
            work |= {name: done} if done.any() else {}
        impacts = _impacts(motion, begin, legs, t, pair, gravity)
        work |= {"impacts": impacts} if impacts.any() else {}
    kinetic, potential = (np.asarray(energy, np.float64) for energy in energies)
    return EnergyBalance(t, work, kinetic, potential)


def _body1(course: Course, **accelerations: Array) -> BodyMotion:
    now = course.now
    return motion_of_rotations(R=now.R1, S=now.S1, v=now.v1, omega=now.omega1, **accelerations)


def _read(motion: PairMotion, t: Array, states: Array, legs: Sequence[Leg]) -> Course:
    """Read a motion out at instants, each of which lies in its own step."""
    sides = np.array([leg.side for leg in legs])
    held, quats = np.array([leg.held for leg in legs]), np.array([leg.quat for leg in legs])
    return motion.read(t, states, quats, (sides[:, 0], sides[:, 1]), held)


def _powers(pair: HingePair, course: Course, gravity: tuple[float, ...], *, carried: bool) -> dict[str, Array]:
    """Compute the power of each load [W]; shape (n,) each."""
    now, loads = course.now, course.loads
    body1 = _body1(course, a=course.a1, alpha=course.alpha1)
    state = pair.forward_kinematics_from_body1(body1, now.psi, now.psid, outputs=("R2", "v2", "omega2"))
    v2, omega2 = np.asarray(state.v2), np.asarray(state.omega2)
    speeds = {"force1": now.v1, "torque1": now.omega1, "force2": v2, "torque2": omega2}
    powers = {name: (loads[name] * speed).sum(axis=-1) for name, speed in speeds.items()}
    if carried:
        powers |= {"force1": 0 * now.psi, "torque1": 0 * now.psi}  # on what moves as given anyway
        arm = (now.S1 @ np.asarray(pair.u1)[:, None])[..., 0]
        point = now.R1 + arm
        wrench = pair.hinge_wrench(body1, now.psi, now.psid, course.psidd, gravity)
        force = wrench.force - loads["force2"]
        torque = wrench.torque - loads["torque2"] - np.cross(np.asarray(state.R2) - point, loads["force2"])
        through = (force * (now.v1 + np.cross(now.omega1, arm))).sum(axis=-1) + (torque * omega2).sum(axis=-1)
        powers["base"] = through - loads["hinge_torque"] * now.psid
    parts = {name: load for name, load in loads.items() if name.endswith("_torque") and name != "hinge_torque"}
    at_hinge = {name.removesuffix("_torque"): load for name, load in parts.items()} or {
        "hinge_torque": loads["hinge_torque"]
    }
    powers |= {name: load * now.psid for name, load in at_hinge.items()}
    return powers


def _impacts(
    motion: PairMotion, begin: Array, legs: Sequence[Leg], t: Array, pair: HingePair, gravity: tuple[float, ...]
) -> Array:
    """Compute the kinetic energy [J] that impacts have given until some instants; shape (N,)."""
    work = np.zeros(len(t))
    column = motion.angle + 1
    for before, after in itertools.pairwise((legs[0], *legs)):
        instant = after.piece.start
        end = begin if before is after else before.piece.at(np.array([instant]))[0]
        if abs(after.piece.state[column] - end[column]) <= _JUMP * (1 + abs(end[column])):
            continue
        states = np.stack([end, after.piece.state])
        course: Any = _read(motion, np.full(2, t[0] + instant), states, [before, after])
        kinetic = pair.energy(_body1(course), course.now.psi, course.now.psid, gravity).kinetic
        work[t - t[0] > instant] += kinetic[1] - kinetic[0]
    return work
