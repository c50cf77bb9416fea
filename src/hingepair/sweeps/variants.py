"""One variant of a scene: its numbers changed, its outputs computed. What does not change is computed once."""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism.mechanism import Mechanism
from hingepair.numeric.arrays import Float64Array
from hingepair.plans.plan import ACCELERATION
from hingepair.scenes.forces import pair_scene_forces
from hingepair.scenes.mechanisms.mechanism_table import read_mechanism, with_payload
from hingepair.scenes.mechanisms.scene import MechanismScene
from hingepair.scenes.pair_table import read_pair
from hingepair.scenes.scene import COORDINATE_OUTPUTS, SCENE_OUTPUTS, Scene, scene_of, with_constants
from hingepair.scenes.tables import Key, Table, numbers_key
from hingepair.sweeps.payloads import PayloadVariants, payload_variants

FORCE_OUTPUTS: Final = ("hinge_torque", "bearing_torque", "hinge_force", "force1", "torque1")
"""Outputs of a scene of a pair with masses, beside those of its motion."""

# One part of the path to a number of a scene: a key, then indices in brackets.
_KEY_STEP_PATTERN: Final = re.compile(r"([A-Za-z0-9_-]+)((?:\[\d+\])*)")
# Keys of [[joint]] that the motion of the coordinates does not depend on.
_GEOMETRY: Final = ("u1", "u2", "n", "home", "body1", "body2")


class HeldMotion:
    """A motion of which each part is computed once, as the scenes of all variants take it.

    Args:
        given: the motion.
        level: the highest derivative that there is.
        sequence: Euler sequence of body 1; None where its attitude does not come as three Euler angles.
    """

    def __init__(self, given: Any, level: int, sequence: str | None = None) -> None:
        self.level, self.sequence = level, sequence
        self._given = given
        self._parts: dict[Any, Any] = {}

    def part(self, rows: Any, order: int) -> Any:
        """Return the motion at some of the instants, with derivatives up to an order."""
        key = (rows.start, rows.stop, rows.step, order) if isinstance(rows, slice) else None
        if key is None or key not in self._parts:
            part = self._given.part(rows, order)
            if key is None:
                return part
            self._parts[key] = part
        return self._parts[key]


def parse_key(table: Table, key: str) -> tuple[str | int, ...]:
    """Return the steps that lead to a number: "pair.u1[0]" is ("pair", "u1", 0).

    Raises:
        SceneError: the key is not of this form.
    """
    steps: list[str | int] = []
    for part in key.split("."):
        found = _KEY_STEP_PATTERN.fullmatch(part)
        if found is None:
            table.fail("key", 'names with dots and places in brackets, such as "pair.u1[0]"')
        steps.append(found[1])
        steps += [int(place) for place in re.findall(r"\d+", found[2])]
    return tuple(steps)


def check_number(table: Table, values: Mapping[str, Any], steps: Sequence[str | int]) -> None:
    """Refuse steps that do not lead to a number of a scene, or an expression.

    Raises:
        SceneError: names the step.
    """
    here: Any = values
    for step in steps:
        if isinstance(here, dict) and step not in here:
            known = tuple(map(str, here))
            table.refuse("key", f"{choices(known)} at this place{nearest(str(step), known)}", repr(step))
        if isinstance(step, int) and (not isinstance(here, list) or step >= len(here)):
            size = f"a list of {len(here)}" if isinstance(here, list) else "no list"
            table.refuse("key", f"a place in a list: there is {size}", repr(step))
        if not isinstance(here, dict | list):
            table.refuse("key", "the key of a number of the scene", repr(".".join(map(str, steps))))
        here = here[step]  # type: ignore[index]
    if isinstance(here, bool) or not isinstance(here, int | float | str):
        table.refuse("key", "the key of a number of the scene, or of an expression", repr(".".join(map(str, steps))))


class VariantComputer:
    """Computes the outputs of a scene for any values of some of its numbers.

    Args:
        path: of the scene's file.
        values: what stands in it.
        keys: steps that lead to the varied numbers.
        outputs: what is computed of each variant.
    """

    def __init__(
        self, path: str, values: dict[str, Any], keys: Sequence[Sequence[str | int]], outputs: Sequence[str] | None
    ) -> None:
        self._path, self._keys = Path(path), keys
        self._tables = Table(path, "", values, {})
        self._outputs = None if outputs is None else tuple(outputs)
        self._scene = scene_of(with_constants(self._tables), path)
        self._kept = _leave_the_motion(self._scene, keys)
        self._together: PayloadVariants | None = None
        self._payload: Mechanism | None = None  # the robot without payload, where nothing else is varied
        if self._kept and isinstance(self._scene, Scene):
            motion = self._scene.motion
            given, sequence = motion.given, self._scene.sequence
            if sequence is not None and self._outputs and not {*COORDINATE_OUTPUTS[:3]} & {*self._outputs}:
                given, sequence = given.part(slice(None), motion.level).in_space(self._scene.pair), None
            self._scene = replace(
                self._scene, motion=replace(motion, given=HeldMotion(given, motion.level, sequence))
            )
            pair = _with_plain_numbers(self._scene.tables.table("pair"), keys)
            self._tables = replace(self._tables, values={**values, "pair": pair})
        elif self._kept and isinstance(self._scene, MechanismScene):
            joints = self._scene.joint_motion
            self._scene = replace(
                self._scene, joint_motion=replace(joints, given=HeldMotion(joints.given, joints.level))
            )
            if all(steps[:2] == ("mechanism", "payload") for steps in keys):
                table = self._tables.table("mechanism")
                bare = {name: own for name, own in table.values.items() if name != "payload"}
                tables = replace(self._scene.tables, values={**values, "mechanism": bare})
                self._payload = read_mechanism(tables, self._path.parent)
                self._together = payload_variants(self._scene, self._payload, table, keys, self._outputs)
        self.samples = self._scene.samples

    def compute(self, row: Float64Array) -> tuple[Float64Array, dict[str, NDArray[Any]]]:
        """Return the instants and the outputs of one variant, by name.

        Args:
            row: the varied numbers; shape (numbers,).

        Raises:
            ArgumentError: the scene cannot be read, or computed, with these numbers.
        """
        scene = self._variant(row)
        if isinstance(scene, MechanismScene):
            return _compute_mechanism_outputs(scene, self._outputs)
        return _compute_pair_outputs(scene, self._outputs)

    def compute_together(self, rows: Float64Array) -> tuple[Float64Array, dict[str, NDArray[Any]]] | None:
        """Return the instants, (samples,), and the outputs by name, (variants, samples, ...), of several variants.

        Args:
            rows: the varied numbers; (variants, numbers).

        Returns:
            None where variants can only be computed one by one.
        """
        return None if self._together is None else self._together.compute(rows)

    def _variant(self, row: Float64Array) -> Scene | MechanismScene:
        """Return the scene of one variant, whose varied numbers are those of a row."""
        values = dict(self._tables.values)
        for root in {steps[0] for steps in self._keys}:
            values[str(root)] = copy.deepcopy(values[str(root)])
        for steps, number in zip(self._keys, row.tolist(), strict=True):
            here: Any = values
            for step in steps[:-1]:
                here = here[step]
            here[steps[-1]] = number
        tables = replace(self._tables, values=values)
        if not self._kept:
            return scene_of(with_constants(tables), self._path)
        tables = replace(tables, constants=self._scene.tables.constants)
        if isinstance(self._scene, Scene):
            return replace(self._scene, pair=read_pair(tables.table("pair"), tables.flag("planar")), tables=tables)
        if self._payload is not None:
            robot = with_payload(self._payload, tables.table("mechanism"))
        else:
            robot = read_mechanism(tables, self._path.parent)
        return replace(self._scene, mechanism=robot, tables=tables)


def _with_plain_numbers(table: Table, keys: Sequence[Sequence[str | int]]) -> dict[str, Any]:
    """Return a table [pair] whose expressions are numbers, but for the keys that are varied.

    Shapes of a body whose inertia is given have no part in its masses; they are left out unless they are varied.
    """
    varied = {steps[1] for steps in keys}
    size = 2 if len(table.values.get("u1", ())) == 2 else 3
    readers: dict[str, Key] = {"u1": numbers_key(size), "u2": numbers_key(size), "n": numbers_key(3)}
    readers |= {"home": Table.rotation, "limits": numbers_key(2)}
    values = {key: read(table, key) for key, read in readers.items() if key in table.values and key not in varied}
    for name in ("body1", "body2"):
        body = table.values.get(name, {})
        if "inertia" in body and not any(tuple(steps[1:3]) == (name, "shapes") for steps in keys):
            values[name] = {key: value for key, value in body.items() if key != "shapes"}
    return {**table.values, **values}


def _leave_the_motion(scene: Scene | MechanismScene, keys: Sequence[Sequence[str | int]]) -> bool:
    """Return whether numbers are such that the motion of the scene does not depend on them."""
    if isinstance(scene, Scene):
        return scene.motion.simulated is None and all(steps[0] == "pair" for steps in keys)
    of_joints = all(steps[0] == "joint" and steps[2] in _GEOMETRY for steps in keys if len(steps) > 2)
    payload = all(steps[:2] == ("mechanism", "payload") for steps in keys)
    return payload or (of_joints and all(steps[0] == "joint" for steps in keys))


def _compute_pair_outputs(
    scene: Scene, outputs: tuple[str, ...] | None
) -> tuple[Float64Array, dict[str, NDArray[Any]]]:
    """Compute the instants (N,) [s] of the scene of a pair and the requested outputs, with forces, by name."""
    acting = [name for name in outputs or () if name in FORCE_OUTPUTS]
    moving = None if outputs is None else [name for name in outputs if name not in FORCE_OUTPUTS]
    known = (*scene.kind.levels, *SCENE_OUTPUTS, *FORCE_OUTPUTS)
    for name in outputs or ():
        if name not in known:
            raise ArgumentError("outputs", choices(known) + nearest(name, known), quoted(name))
    found: dict[str, NDArray[Any]] = {}
    if moving is None or moving:
        found |= scene.evaluate(moving).chosen()
    if acting:
        if scene.motion.level < ACCELERATION:
            scene.tables.refuse("motion", "a motion with accelerations, which forces need", scene.motion.origin)
        quiet = replace(scene.motion, derived=None)  # the noise of a log is not looked for in each variant
        forces = pair_scene_forces(quiet, scene.pair, scene.times(), None, scene.title, scene.files).recorded()
        for name in acting:
            if name not in forces:
                scene.tables.refuse("pair", f"masses and a kind of pair that {name} needs", "none")
            found[name] = forces[name]
    return scene.times(), found


def _compute_mechanism_outputs(
    scene: MechanismScene, outputs: tuple[str, ...] | None
) -> tuple[Float64Array, dict[str, NDArray[Any]]]:
    """Compute the instants (N,) [s] of the scene of a mechanism and the requested outputs by name."""
    return scene.t, scene.evaluate(outputs).chosen()
