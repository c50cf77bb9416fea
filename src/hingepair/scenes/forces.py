"""The forces that the motion of a scene takes (D1-D5, T1-T3), with what limits and gravity mean for them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.mechanism import tree_of
from hingepair.mechanism.results import Record
from hingepair.mechanism.tree import Joint, loads_note
from hingepair.scenes.motions.known import Known
from hingepair.scenes.motions.motion import impact_sentences
from hingepair.scenes.summary import Summary
from hingepair.tables.sheets import Sheet, instant_text, ruled_table
from hingepair.tables.units import UnitsLike


class SceneForces(Record):
    """Forces at the instants of a scene. They print as a table and can be saved to a file.

    Args:
        scene: the Scene.
        known: its motion at all instants, with accelerations.
        arrays: the forces by name.
        gravity: acceleration of free fall that the forces were computed with [m/s^2]; shape (3,).
        assumed: whether nobody gave gravity.

    Attributes:
        gravity: acceleration of free fall that the forces were computed with [m/s^2]; shape (3,), in the plane (2,).
        notes: sentences for readers of the forces.
        tau: of a robot, joint efforts: torques of hinges [N m], forces of sliders [N]; shape (N, dof).
    """

    __slots__ = ("_scene", "gravity", "notes", "tau")

    def __init__(
        self, scene: Any, known: Known, arrays: dict[str, Any], gravity: tuple[float, ...], *, assumed: bool
    ) -> None:
        self.tau, self.gravity, self._scene = arrays.pop("tau", None), gravity[: scene.assembly.dimensions], scene
        columns = known.joint_columns(0) | arrays
        super().__init__(scene.t, columns, f"forces: {scene.title}", scene.files, scene.unit, scene.units)
        self.notes = tuple(_notes(scene, known, arrays, assumed=assumed))

    def __str__(self) -> str:
        rows, sentences = self.table()
        lines = ("", *ruled_table(rows, 2), "", *sentences, *self.notes)
        return "\n".join((f"{self.described}: {len(self.t)} instants", *lines)).rstrip()

    def _sheet(self) -> Sheet:
        """Return what notebooks show."""
        return Sheet(f"{self.described}: {len(self.t)} instants", self.table()[0], self.notes)

    def summary(self, units: UnitsLike = None) -> Summary:
        """Return the summary of what is recorded beside coordinates, with the limits of joints.

        Args:
            units: units in place of SI units; by default those of the scene.
        """
        recorded, assembly = self.recorded(), self._scene.assembly
        limits = {_effort_name(joint, recorded): joint.effort_limit for joint in assembly.joints}
        limits = {name: limit for name, limit in limits.items() if math.isfinite(limit)}
        summary = Summary(self._scene, units, limits)
        summary.add(self.t, {name: array for name, array in recorded.items() if name not in assembly.names})
        return summary

    def ranges(self, units: UnitsLike = None) -> dict[str, dict[str, float]]:
        """Return, by component, the first, last, smallest, largest and rms value, and the instant of the largest
        size. `units` are as for `summary`.
        """
        return self.summary(units).ranges()

    def table(self, units: UnitsLike = None) -> tuple[list[tuple[str, ...]], list[str]]:
        """Return the rows of the table that `hingepair forces` prints, headings first, and sentences on what it
        leaves out. `units` are as for `summary`.
        """
        return self.summary(units).table_of_sizes()


def _effort_name(joint: Joint, forces: Mapping[str, Any]) -> str:
    """Return the name of what the motor of a joint gives, among forces."""
    names = (f"tau_{joint.name}", "motor_torque", "hinge_torque")  # of a mechanism; of a pair with loads; without
    return next(name for name in names if name in forces)


def _notes(scene: Any, known: Known, arrays: Mapping[str, NDArray[Any]], *, assumed: bool) -> Iterator[str]:
    """Yield sentences on forces that are not finite or not known, on gravity and on limits that are exceeded."""
    assembly, motion, count = scene.assembly, scene.motion, scene.samples
    dynamics = scene.tables.table("dynamics", required=False)
    joints = {joint.name: joint for joint in assembly.joints}
    if motion.simulated is not None:
        yield from impact_sentences(motion.simulated.impacts, {name: joint.unit for name, joint in joints.items()})
    for name, load in motion.loads.items() if motion.simulated is None else ():
        still = int((known.column(1, known.names.index(name)) == 0).sum())
        if name in dynamics.values and still and load.sticking_friction:
            yield (
                f"friction of {name} is 0 at {still} of {count} instants, where {name}' is 0; it may hold up to "
                f"{load.sticking_friction:g} {joints[name].effort_unit} there"
            )
    if motion.simulated is None and assembly.planar and assumed:
        down = ", ".join(f"{component:g}" for component in scene.gravity[:2])
        yield f"gravity is taken along -y of the plane, ({down}) m/s^2; seen from above it is --gravity 0,0"
    for joint in joints.values():
        effort, (least, most) = arrays[_effort_name(joint, arrays)], joint.effort_bounds
        beyond = np.flatnonzero((effort < least) | (effort > most))
        if beyond.size:
            yield (
                f"{joint.name} takes up to {np.nanmax(np.abs(effort)):.4g} {joint.effort_unit}, more than its limit "
                f"of {joint.effort_limit:g}, at {beyond.size} of {count} instants, first at t = "
                f"{instant_text(scene.t[beyond[0]])} s"
            )
    left_out = loads_note(tree_of(assembly.mechanism)) if assembly.mechanism is not None else ""
    if left_out and not dynamics.flag("joint_loads"):
        yield f"{left_out}; joint_loads = true in [dynamics] counts them"
