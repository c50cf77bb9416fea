"""One variant of a scene: its numbers changed, its outputs computed. What does not change is computed once."""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import choices, nearest
from hingepair.mechanism.mechanism import Mechanism
from hingepair.numeric.arrays import Float64Array
from hingepair.scenes.load import scene_from_tables, with_constants_evaluated, with_same_motion
from hingepair.scenes.pair_scene import PairScene
from hingepair.scenes.pair_table import CENTRES
from hingepair.scenes.robot_scene import RobotScene
from hingepair.scenes.robot_table import read_mechanism, with_payload
from hingepair.scenes.scene import Scene
from hingepair.scenes.tables import Key, Table, numbers_key
from hingepair.sweeps.payloads import PayloadVariantComputer, payload_variant_computer
from hingepair.tables.units import Columns

# One part of the path to a number of a scene: a key, then indices in brackets. Each number has one spelling.
_KEY_PART: Final = re.compile(r"([A-Za-z0-9_-]+)((?:\[(?:0|[1-9][0-9]{0,8})\])*)")


class CachedMotion:
    """Source of a motion that the scenes of all variants share; a part at a slice of instants is computed once."""

    def __init__(self, motion: Any) -> None:
        self.level, self.sequence = motion.level, getattr(motion, "sequence", None)
        self._motion = motion
        self._parts: dict[Any, Any] = {}

    def part(self, rows: Any, order: int) -> Any:
        """Return the motion at the instants with the indices `rows`, with derivatives up to `order`."""
        key = (rows.start, rows.stop, rows.step, order) if isinstance(rows, slice) else None
        if key is None or key not in self._parts:
            part = self._motion.part(rows, order)
            if key is None:
                return part
            self._parts[key] = part
        return self._parts[key]


def parse_key(table: Table, key: str) -> tuple[str | int, ...]:
    """Return the path of keys and indices that a key states: ("pair", "u1", 0) of "pair.u1[0]"."""
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
        if isinstance(here, list) and not isinstance(step, int):
            table.refuse("key", f"a place in brackets after a list of {len(here)}, such as [0]", repr(step))
        if isinstance(step, int) and (not isinstance(here, list) or step >= len(here)):
            size = f"a list of {len(here)}" if isinstance(here, list) else "no list"
            table.refuse("key", f"a place in a list: there is {size}", repr(step))
        if not isinstance(here, dict | list):
            table.refuse("key", "the key of a number of the scene", repr(".".join(map(str, steps))))
        here = here[step]  # type: ignore[index]
    if isinstance(here, bool) or not isinstance(here, int | float | str):
        table.refuse("key", "the key of a number of the scene, or of an expression", repr(".".join(map(str, steps))))


class VariantComputer:
    """Computer of the outputs of a scene for any values of the varied numbers, one variant at a time or together.

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
        self._is_moved = self._scene.is_moved_by(keys)
        self._payload_computer: PayloadVariantComputer | None = None
        self._unloaded_robot: Mechanism | None = None  # the robot without payload, where nothing else is varied
        if not self._is_moved:
            self._share_motion(values)
        self.samples = self._scene.samples

    def _share_motion(self, values: dict[str, Any]) -> None:
        """Prepare what all variants have in common if their numbers do not change the motion."""
        scene, keys = self._scene, self._keys
        if isinstance(scene, PairScene):
            scene = scene.by_body1(self._outputs)
            pair = _evaluate_unvaried_expressions(scene.tables.table("pair"), keys)
            self._tables = replace(self._tables, values={**values, "pair": pair})
        motion: Any = replace(scene.motion, source=CachedMotion(scene.motion.source))
        self._scene = replace(scene, motion=motion)
        if isinstance(self._scene, RobotScene) and all(tuple(s[:2]) == ("mechanism", "payload") for s in keys):
            table = self._tables.table("mechanism")
            bare = {name: value for name, value in table.values.items() if name != "payload"}
            tables = replace(scene.tables, values={**values, "mechanism": bare})
            self._unloaded_robot = robot = read_mechanism(tables, self._path.parent)
            self._payload_computer = payload_variant_computer(self._scene, robot, table, keys, self._outputs)

    def in_units(self, units: str | None) -> Columns:
        """Return names and numbers of columns of the outputs in units; None for SI units."""
        return self._scene.in_units(units or "")

    def compute(self, numbers: Float64Array) -> tuple[Float64Array, dict[str, NDArray[Any]]]:
        """Return t, (samples,) s, and the outputs by name, (samples, ...), for one variant; `numbers` is
        (numbers,).
        """
        scene = self.scene(numbers)
        return scene.times(), scene.arrays(self._outputs)

    def compute_nothing(self) -> tuple[Float64Array, dict[str, NDArray[Any]]]:
        """Return what `compute` returns, for a variant that cannot be computed: NaN at all instants."""
        t, arrays = self._scene.times(), self._scene.arrays(self._outputs)
        return t, {name: np.full(array.shape, np.nan) for name, array in arrays.items()}

    def compute_together(self, numbers: Float64Array) -> tuple[Float64Array, dict[str, NDArray[Any]]] | None:
        """Return t, (samples,) s, and the outputs by name, (variants, samples, ...), for `numbers` (variants,
        numbers); None if variants must be computed one by one.
        """
        return None if self._payload_computer is None else self._payload_computer.compute(numbers)

    def scene(self, numbers: Float64Array) -> Scene:
        """Return the scene with these values of the varied numbers."""
        values = dict(self._tables.values)
        for root in {steps[0] for steps in self._keys}:
            values[str(root)] = copy.deepcopy(values[str(root)])
        for steps, number in zip(self._keys, numbers.tolist(), strict=True):
            here: Any = values
            for step in steps[:-1]:
                here = here[step]
            here[steps[-1]] = number
        tables = replace(self._tables, values=values)
        if self._is_moved:
            return scene_from_tables(with_constants_evaluated(tables), self._path)
        tables = replace(tables, constants=self._scene.tables.constants)
        if isinstance(self._scene, RobotScene) and self._unloaded_robot is not None:
            robot = with_payload(self._unloaded_robot, tables.table("mechanism"))
            return replace(self._scene, mechanism=robot, tables=tables)
        return with_same_motion(self._scene, tables)


def _evaluate_unvaried_expressions(table: Table, keys: Sequence[Sequence[str | int]]) -> dict[str, Any]:
    """Return the values of [pair] with numbers in place of expressions, except under varied keys, and without shapes
    of bodies that have their mass properties without them.
    """
    varied = {steps[1] for steps in keys}
    size = 2 if len(table.values.get("u1", ())) == 2 else 3
    readers: dict[str, Key] = {"u1": numbers_key(size), "u2": numbers_key(size), "n": numbers_key(3)}
    readers |= {"home": Table.rotation, "limits": numbers_key(2)}
    values = {key: read(table, key) for key, read in readers.items() if key in table.values and key not in varied}
    for name in ("body1", "body2"):
        body = table.values.get(name, {})
        if (
            "inertia" in body
            and not body.keys().isdisjoint(CENTRES)
            and not any(tuple(steps[1:3]) == (name, "shapes") for steps in keys)
        ):
            values[name] = {key: value for key, value in body.items() if key != "shapes"}
    return {**table.values, **values}
