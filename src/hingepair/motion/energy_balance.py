"""Energy balance of a simulated motion: the work of each load, by Gauss quadrature over the steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hingepair.motion.collocation import NODE_TIMES, NODES, WEIGHTS
from hingepair.motion.run import Run, rate_jumps
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.tables.sheets import ruled_table

_CHUNK = 20_000  # intervals whose work is computed at a time


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
            states = [steps[i].polynomial.states_at(row) for i, row in zip(step_indices, times, strict=True)]
            of_nodes = [steps[i] for i in step_indices for _ in NODE_TIMES]
            nodes = motion.sample_steps(t[0] + times.ravel(), np.concatenate(states), of_nodes)
            powers = motion.powers(nodes)
            chunks.append({name: lengths * (power.reshape(-1, NODES) @ WEIGHTS) for name, power in powers.items()})
        instant_indices = np.searchsorted(edges, elapsed)
        for name in chunks[0]:
            work_of_load = np.hstack([0.0, np.cumsum(np.concatenate([part[name] for part in chunks]))])[
                instant_indices
            ]
            work |= {name: work_of_load} if work_of_load.any() else {}
        impacts = _impact_work(run)
        work |= {"impacts": impacts} if impacts.any() else {}
    kinetic, potential = motion.energies(run.samples)
    return EnergyBalance(t, work, kinetic, potential)


def _impact_work(run: Run) -> Array:
    """Return the kinetic energy [J] that impacts, jumps of the rates of joints between steps, have added up to each
    instant.
    """
    motion, t = run.motion, run.samples.t
    work = np.zeros(len(t))
    for last_step, next_step, end_state in rate_jumps(run):
        instant = next_step.polynomial.start
        states = np.stack([end_state, next_step.polynomial.state])
        samples = motion.sample_steps(np.full(2, t[0] + instant), states, [last_step, next_step])
        kinetic, _ = motion.energies(samples)
        work[t - t[0] > instant] += kinetic[1] - kinetic[0]
    return work
