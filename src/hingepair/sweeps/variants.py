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
from hingepair.scenes.pair_table import read_pair
from hingepair.scenes.robot_scene import MechanismScene
from hingepair.scenes.robot_table import read_mechanism, with_payload
from hingepair.scenes.scene import (
    COORDINATE_OUTPUTS,
    FURTHER_OUTPUTS,
    Scene,
    scene_from_tables,
    with_constants_evaluated,
)
from hingepair.scenes.tables import Key, Table, numbers_key
from hingepair.sweeps.payloads import PayloadVariantComputer, payload_variant_computer

PAIR_FORCES: Final = ("hinge_torque", "bearing_torque", "hinge_force", "force1", "torque1")
"""Outputs of a scene of a pair with masses, beside those of its motion."""

# One part of the path to a number of a scene: a key, then indices in brackets. Each number has one spelling.
_KEY_PART: Final = re.compile(r"([A-Za-z0-9_-]+)((?:\[(?:0|[1-9][0-9]{0,8})\])*)")
# Keys of [[joint]] that the motion of the coordinates does not depend on.
_NOT_IN_MOTION: Final = ("u1", "u2", "n", "home", "body1", "body2")


class CachedMotion:
    """Motion of a scene that the scenes of all variants share.

    Args:
        motion: the motion whose parts are kept.
        level: the highest derivative that the motion has.
        sequence: Euler sequence of body 1; None where its attitude does not come as three Euler angles.
    """

    def __init__(self, motion: Any, level: int, sequence: str | None = None) -> None:
        self.level, self.sequence = level, sequence
        self._motion = motion
        self._parts: dict[Any, Any] = {}

    def part(self, rows: Any, order: int) -> Any:
        """Return the motion at the instants with the indices `rows`, a slice or an array, with derivatives up to
        `order`, as the `part` of the original motion returns it. If `rows` is a slice, cache the result and return
        the same object in later calls.
        """
        key = (rows.start, rows.stop, rows.step, order) if isinstance(rows, slice) else None
        if key is None or key not in self._parts:
            part = self._motion.part(rows, order)
            if key is None:
                return part
            self._parts[key] = part
        return self._parts[key]


def parse_key(table: Table, key: str) -> tuple[str | int, ...]:
    """Parse the string `key` into a path of keys and list indices, and return the path as a tuple of strings and
    integers: "pair.u1[0]" gives ("pair", "u1", 0).
    """
    steps: list[str | int] = []
    for part in key.split("."):
        match = _KEY_PART.fullmatch(part)
        if match is None:
            table.fail("key", 'names with dots, and places in brackets counted from 0, such as "pair.u1[0]"')
        steps.append(match[1])
        steps += [int(place) for place in re.findall(r"\d+", match[2])]
    return tuple(steps)


def check_number_path(table: Table, values: Mapping[str, Any], steps: Sequence[str | int]) -> None:
    """Raise a SceneError that names `table` unless the path `steps` of keys and list indices leads to a number or an
    expression in `values`, the nested tables of a scene file. The message names the step that fails.
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
    """Computer of the outputs of a scene for any values of the varied numbers: the method `compute` computes one
    variant, and `compute_together` many.

    Args:
        path: path of the scene file.
        values: tables of the scene file.
        keys: paths of keys and indices that lead to the varied numbers, from `parse_key`.
        outputs: names of the outputs to compute for each variant; None for all that the scene has.
    """

    def __init__(
        self, path: str, values: dict[str, Any], keys: Sequence[Sequence[str | int]], outputs: Sequence[str] | None
    ) -> None:
        self._path, self._keys = Path(path), keys
        self._tables = Table(path, "", values, {})
        self._outputs = None if outputs is None else tuple(outputs)
        self._scene = scene_from_tables(with_constants_evaluated(self._tables), path)
        self._motion_unaffected = _is_motion_unaffected(self._scene, keys)
        self._payload_computer: PayloadVariantComputer | None = None
        self._unloaded_robot: Mechanism | None = None  # the robot without payload, where nothing else is varied
        if self._motion_unaffected and isinstance(self._scene, Scene):
            motion = self._scene.motion
            coordinates, sequence = motion.source, self._scene.sequence
            if sequence is not None and self._outputs and not {*COORDINATE_OUTPUTS[:3]} & {*self._outputs}:
                coordinates = coordinates.part(slice(None), motion.level).in_space(self._scene.pair)
                sequence = None
            self._scene = replace(
                self._scene, motion=replace(motion, source=CachedMotion(coordinates, motion.level, sequence))
            )
            pair = _evaluate_unvaried_expressions(self._scene.tables.table("pair"), keys)
            self._tables = replace(self._tables, values={**values, "pair": pair})
        elif self._motion_unaffected and isinstance(self._scene, MechanismScene):
            joints = self._scene.joint_motion
            self._scene = replace(
                self._scene, joint_motion=replace(joints, source=CachedMotion(joints.source, joints.level))
            )
            if all(steps[:2] == ("mechanism", "payload") for steps in keys):
                table = self._tables.table("mechanism")
                bare = {name: value for name, value in table.values.items() if name != "payload"}
                tables = replace(self._scene.tables, values={**values, "mechanism": bare})
                self._unloaded_robot = read_mechanism(tables, self._path.parent)
                self._payload_computer = payload_variant_computer(
                    self._scene, self._unloaded_robot, table, keys, self._outputs
                )
        self.samples = self._scene.samples

    def compute(self, numbers: Float64Array) -> tuple[Float64Array, dict[str, NDArray[Any]]]:
        """Return (t, arrays) for one variant: the instants [s], (samples,), and a dict of the outputs by name,
        (samples, ...). `numbers` are the values of the varied numbers; shape (numbers,).
        """
        scene = self._scene_of_variant(numbers)
        if isinstance(scene, MechanismScene):
            return _compute_mechanism_outputs(scene, self._outputs)
        return _compute_pair_outputs(scene, self._outputs)

    def compute_together(self, numbers: Float64Array) -> tuple[Float64Array, dict[str, NDArray[Any]]] | None:
        """Return (t, arrays) for many variants: the instants [s] and a dict of the outputs by name, (variants,
        samples, ...). Return None if variants must be computed one by one. `numbers` are the values of the varied
        numbers; shape (variants, numbers).
        """
        return None if self._payload_computer is None else self._payload_computer.compute(numbers)

    def _scene_of_variant(self, numbers: Float64Array) -> Scene | MechanismScene:
        """Return a copy of the Scene or MechanismScene in which the varied numbers have the values `numbers`; shape
        (numbers,).
        """
        values = dict(self._tables.values)
        for root in {steps[0] for steps in self._keys}:
            values[str(root)] = copy.deepcopy(values[str(root)])
        for steps, number in zip(self._keys, numbers.tolist(), strict=True):
            here: Any = values
            for step in steps[:-1]:
                here = here[step]
            here[steps[-1]] = number
        tables = replace(self._tables, values=values)
        if not self._motion_unaffected:
            return scene_from_tables(with_constants_evaluated(tables), self._path)
        tables = replace(tables, constants=self._scene.tables.constants)
        if isinstance(self._scene, Scene):
            return replace(self._scene, pair=read_pair(tables.table("pair"), tables.flag("planar")), tables=tables)
        if self._unloaded_robot is not None:
            robot = with_payload(self._unloaded_robot, tables.table("mechanism"))
        else:
            robot = read_mechanism(tables, self._path.parent)
        return replace(self._scene, mechanism=robot, tables=tables)


def _evaluate_unvaried_expressions(table: Table, keys: Sequence[Sequence[str | int]]) -> dict[str, Any]:
    """Return the values of the Table [pair] as a dict, with numbers in place of expressions except under varied keys,
    the paths `keys`.
    """
    varied = {steps[1] for steps in keys}
    size = 2 if len(table.values.get("u1", ())) == 2 else 3
    readers: dict[str, Key] = {"u1": numbers_key(size), "u2": numbers_key(size), "n": numbers_key(3)}
    readers |= {"home": Table.rotation, "limits": numbers_key(2)}
    values = {key: read(table, key) for key, read in readers.items() if key in table.values and key not in varied}
    for name in ("body1", "body2"):
        body = table.values.get(name, {})
        if {"inertia", "center_of_mass"} <= body.keys() and not any(
            tuple(steps[1:3]) == (name, "shapes") for steps in keys
        ):
            values[name] = {key: value for key, value in body.items() if key != "shapes"}
    return {**table.values, **values}


def _is_motion_unaffected(scene: Scene | MechanismScene, keys: Sequence[Sequence[str | int]]) -> bool:
    """Return whether the motion of a Scene or MechanismScene does not depend on the varied numbers, to which the
    paths `keys` lead.
    """
    if isinstance(scene, Scene):
        return scene.motion.simulated is None and all(steps[0] == "pair" for steps in keys)
    of_joints = all(steps[0] == "joint" and steps[2] in _NOT_IN_MOTION for steps in keys if len(steps) > 2)
    payload = all(steps[:2] == ("mechanism", "payload") for steps in keys)
    return payload or (of_joints and all(steps[0] == "joint" for steps in keys))


def _compute_pair_outputs(
    scene: Scene, outputs: tuple[str, ...] | None
) -> tuple[Float64Array, dict[str, NDArray[Any]]]:
    """Return (t, arrays) of a Scene: all its instants [s] and a dict of the outputs by name, which may be forces."""
    force_names = [name for name in outputs or () if name in PAIR_FORCES]
    motion_names = None if outputs is None else [name for name in outputs if name not in PAIR_FORCES]
    known = (*scene.kind.levels, *FURTHER_OUTPUTS, *PAIR_FORCES)
    for name in outputs or ():
        if name not in known:
            raise ArgumentError("outputs", choices(known) + nearest(name, known), quoted(name))
    arrays: dict[str, NDArray[Any]] = {}
    if motion_names is None or motion_names:
        arrays |= scene.evaluate(motion_names).requested_arrays()
    if force_names:
        if scene.motion.level < ACCELERATION:
            scene.tables.refuse("motion", "a motion with accelerations, which forces need", scene.motion.origin)
        quiet = replace(scene.motion, derived=None)  # the noise of a log is not looked for in each variant
        forces = pair_scene_forces(quiet, scene.pair, scene.times(), None, scene.title, scene.files).recorded()
        for name in force_names:
            if name not in forces:
                scene.tables.refuse("pair", f"masses and a kind of pair that {name} needs", "none")
            arrays[name] = forces[name]
    return scene.times(), arrays


def _compute_mechanism_outputs(
    scene: MechanismScene, outputs: tuple[str, ...] | None
) -> tuple[Float64Array, dict[str, NDArray[Any]]]:
    """Return (t, arrays) of a MechanismScene: all its instants [s] and a dict of the outputs by name."""
    return scene.t, scene.evaluate(outputs).requested_arrays()
