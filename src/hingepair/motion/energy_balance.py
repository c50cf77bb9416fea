"""Energy balance of a simulated motion: the work of each load, by Gauss quadrature over the steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hingepair.motion.collocation import NODE_TIMES, NODES, WEIGHTS, integration_matrix
from hingepair.motion.run import Run, rate_jumps
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.tables.sheets import ruled_table


@dataclass(frozen=True, eq=False, repr=False)
class EnergyBalance:
    """Energy balance of a motion: the work of each load, and the energies [J]. `print` shows a table."""

    #: instants [s]; shape (N,)
    t: Array
    #: work since the first instant [J], (N,), by load: force1, torque1, force2, torque2, motor, spring, damper,
    #: friction and stop; struts, their dampers and friction; impacts at rigid stops; base, which moves a body 1 whose
    #: motion is given.
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

    def facts(self) -> dict[str, Any]:
        """Return what the table shows: the work of each load and the changes of the energies [J] at the last instant,
        and the largest residual.
        """
        changes = {name: float(x[-1] - x[0]) for name, x in self._energies()}
        work = {name: float(x[-1]) for name, x in self.work.items()}
        return {"work": work, **changes, "residual": float(np.abs(self.residual).max())}

    def __str__(self) -> str:
        rows = [(name, f"{work[-1]:.6g}") for name, work in self.work.items()]
        rows += [("", "")]
        rows += [(f"{name} energy, change", f"{x[-1] - x[0]:.6g}") for name, x in self._energies()]
        rows += [("residual, largest", f"{np.abs(self.residual).max():.2g}")]
        return "\n".join(ruled_table([(f"work, {self.t[0]:g} to {self.t[-1]:g} s", "J"), *rows]))

    __repr__ = __str__

    def _energies(self) -> tuple[tuple[str, Array], ...]:
        return ("kinetic", self.kinetic), ("potential", self.potential)


def energy_balance(run: Run) -> EnergyBalance:
    """Return the `EnergyBalance` of a simulated motion, by quadrature over its steps."""
    motion, steps, t = run.motion, run.steps, run.samples.t
    kinetic, potential = motion.energies(run.samples)
    work: dict[str, Array] = {}
    if steps:
        pieces = [step.polynomial for step in steps]
        starts, lengths = (np.array([getattr(piece, name) for piece in pieces]) for name in ("start", "length"))
        times = starts[:, None] + lengths[:, None] * NODE_TIMES
        states = np.concatenate([piece.states_at(own) for piece, own in zip(pieces, times, strict=True)])
        nodes = motion.sample_steps(t[0] + times.ravel(), states, [step for step in steps for _ in NODE_TIMES])
        place = np.searchsorted(starts, t - t[0], side="right") - 1
        within = integration_matrix((t - t[0] - starts[place]) / lengths[place])  # to the instant within its step
        for name, powers in motion.powers(nodes).items():
            rates = lengths[:, None] * powers.reshape(-1, NODES)
            before = np.cumsum(np.append(0.0, rates @ WEIGHTS))
            work[name] = before[place] + (within * rates[place]).sum(axis=1)
        work["impacts"] = np.zeros(len(t))
        for last_step, next_step, end_state in rate_jumps(run):
            instant, both = next_step.polynomial.start, [end_state, next_step.polynomial.state]
            samples = motion.sample_steps(np.full(2, t[0] + instant), np.stack(both), [last_step, next_step])
            work["impacts"][t - t[0] > instant] += np.diff(motion.energies(samples)[0])
    return EnergyBalance(t, {name: own for name, own in work.items() if own.any()}, kinetic, potential)
