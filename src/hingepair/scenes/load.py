"""Scenes, or only what moves in them, read from TOML files."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from hingepair.errors import SceneError, quoted
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.scenes.bodies import MECHANISM_TABLES, is_of_mechanism, read_mechanism, read_pair
from hingepair.scenes.motions.dynamics import Dynamics, read_dynamics, read_simulated_motion, simulates
from hingepair.scenes.motions.functions import read_function_motion
from hingepair.scenes.motions.motion import Motion
from hingepair.scenes.scene import Scene
from hingepair.scenes.subject import Subject
from hingepair.scenes.suspicions import file_suspicions
from hingepair.scenes.tables import Table, read_let, read_tables
from hingepair.symbolic.expressions import constant_name_fault, parse_constant
from hingepair.tables.column_tables import column_table
from hingepair.tables.units import Units

_COMMON: Final = ("title", "constants", "let", "motion", "dynamics", "time", "outputs")
_OF_PAIRS: Final = (*_COMMON, "planar", "pair", "tolerances")
_OF_MECHANISMS: Final = (*_COMMON, *MECHANISM_TABLES)


def load_scene(path: str | os.PathLike[str], log: Any = None) -> Scene:
    """Read a TOML scene file, whose format docs/scenes.md describes.

    Args:
        path: path of the scene file. Relative paths in the file start from the folder of the file.
        log: recorded motion in place of the file that [motion] names: a pandas DataFrame, an xarray Dataset or a dict
            of arrays with the columns of a log, or the path of another file. [motion] then needs no `file`; its other
            keys count as for that file.

    Returns:
        A `Scene`. Its method `evaluate()` computes the outputs at the instants of the scene.

    Raises:
        SceneError: the file cannot be read as a scene. The message is one line; it names the file and, if a key of
            the scene is wrong, the table and the key.
        MissingDependencyError: the file names a robot of example-robot-data, and that package is not installed.
    """
    return SceneFile(path, log).scene()


def scene_from_tables(
    tables: Table, path: Path, subject: Subject | None = None, motion: Motion | None = None
) -> Scene:
    """Return the scene of a top-level table with evaluated constants, from the file at `path`.

    Args:
        tables: the top-level table.
        path: path of its file.
        subject: what moves; by default it is read.
        motion: the motion; by default it is read or simulated.
    """
    subject = read_subject(tables, path.parent) if subject is None else subject
    dynamics = read_dynamics(tables, subject)
    if motion is None:
        motion = _read_motion(tables, path.parent, subject, dynamics)
    elif motion.simulated is None:
        motion = replace(motion, loads=dynamics.loads, wrenches=dynamics.wrenches)
    simulated = motion.simulated
    if simulated is not None and subject.mechanism is not None:
        subject = Subject(simulated.robot, subject.frames)
    scene = Scene(
        path=path,
        title=tables.text("title", default=subject.name),
        subject=subject,
        motion=motion,
        gravity=dynamics.gravity,
        outputs=None,
        constants={key: float(value) for key, value in tables.constants.items() if key not in tables.let},
        files=tuple(file.absolute() for file in _source_files(tables, path)),
        tables=tables,
        read=_read_again,
    )
    outputs = tables.table("outputs", required=False)
    outputs.check_keys(("names", "units"))
    if "units" in outputs.values:
        with outputs.naming("units"):
            scene = replace(scene, units=Units(outputs.text("units")))
    names = outputs.names("names", 'a list of names such as ["R2", "v2"], of a robot ["R", "tau"]')
    if names is None:
        return scene
    with outputs.naming("names"):
        scene.request(names)
    return replace(scene, outputs=names)


def _read_again(tables: Table, *others: Any) -> Scene:
    """Return the scene of tables whose numbers were changed, with what they leave as it was."""
    return scene_from_tables(with_constants_evaluated(replace(tables, constants={}, let={})), *others)


def read_subject(tables: Table, folder: Path) -> Subject:
    """Return what moves in a scene."""
    if not is_of_mechanism(tables):
        return Subject(read_pair(tables))
    mechanism = tables.table("mechanism", required=False)
    base = tables.table("dynamics", required=False).values.get("base")
    robot = read_mechanism(tables, folder, base="free" if base == "free" else "fixed")
    return Subject(robot, tuple(mechanism.table("frames", required=False).values) or robot.tips)


def _read_motion(tables: Table, folder: Path, subject: Subject, dynamics: Dynamics) -> Motion:
    """Return the motion that the tables [motion], [dynamics] and [time] define."""
    if simulates(tables, subject):
        return read_simulated_motion(tables, subject, dynamics)
    if "file" in tables.table("motion").values:
        from hingepair.scenes.motions.sampled import read_log

        motion = read_log(tables, folder, subject)
    else:
        motion = read_function_motion(tables, subject)
    return replace(motion, loads=dynamics.loads, wrenches=dynamics.wrenches)


class SceneFile:
    """A scene file, read once, with what it says of bodies, forces and files; its motion is computed by `scene`.

    Args:
        path: path of the scene file.
        log: table of columns or path, in place of the file that [motion] names.
    """

    def __init__(self, path: str | os.PathLike[str], log: Any = None) -> None:
        self.path = path
        is_file = log is None or isinstance(log, str | os.PathLike)
        self._log = log and os.path.abspath(log) if is_file else column_table("log", log)

    @lock_free_cached_property
    def tables(self) -> Table:
        """The top-level table, with evaluated constants."""
        tables = read_tables(self.path)
        if self._log is not None:
            motion = {**tables.table("motion", required=False).values, "file": self._log}
            tables = replace(tables, values={**tables.values, "motion": motion})
        return with_constants_evaluated(tables)

    @property
    def files(self) -> tuple[Path, ...]:
        """Paths of the files that the scene is read from: its own, and those of its URDF and its log."""
        return _source_files(self.tables, Path(self.path))

    @property
    def has_motion(self) -> bool:
        """Whether there is [dynamics], [motion] with keys, or [motion] together with [time]."""
        tables = self.tables
        keys = tables.table("motion", required=False).values
        return bool(keys) or "dynamics" in tables.values or {"motion", "time"} <= tables.values.keys()

    @property
    def is_simulated(self) -> bool:
        """Whether [dynamics] simulates the motion, so that it has no closed form."""
        return simulates(self.tables, self.subject)

    @lock_free_cached_property
    def subject(self) -> Subject:
        """What moves; the motion is not read."""
        return read_subject(self.tables, Path(self.path).parent)

    @property
    def pair(self) -> HingePair | PlanarPair:
        """The pair that the file describes; a SceneError in the scene of a robot."""
        pair: HingePair | PlanarPair | None = self.subject.pair
        if pair is None:
            self.tables.refuse("pair", "the scene of a pair, which has a table [pair]", "the scene of a mechanism")
        return pair

    @property
    def mechanism(self) -> Mechanism | None:
        """The robot; None in the scene of a pair."""
        return self.subject.mechanism

    @lock_free_cached_property
    def dynamics(self) -> Dynamics | None:
        """What the table [dynamics] says; None if there is no such table."""
        return read_dynamics(self.tables, self.subject) if "dynamics" in self.tables.values else None

    @property
    def suspicions(self) -> tuple[str, ...]:
        """Sentences on numbers that are probably in another unit."""
        joints = self.subject.joints
        limits = {joint.name: joint.position_limits for joint in joints if joint.unit == "rad"}
        return tuple(dict.fromkeys(file_suspicions(self.tables.values, limits)))

    def refuse_linkage(self, reason: str) -> None:
        """Raise a SceneError if the scene has loops or struts."""
        for key in ("loop", "strut"):
            if key in self.tables.values:
                self.tables.refuse(f"[[{key}]]", f"no such table, since {reason}", "a linkage")

    def scene(self) -> Scene:
        """Return the scene with its motion, as `load_scene`."""
        return scene_from_tables(self.tables, Path(self.path))


def with_constants_evaluated(tables: Table) -> Table:
    """Return a scene's top-level table with its constants and [let] evaluated, behind those that the table has
    already; refuse a sweep and unknown tables.
    """
    if {"scene", "vary"} <= tables.values.keys():
        raise SceneError(tables.file, "a scene", f"a sweep (hingepair sweep {tables.file} computes it)")
    tables.check_keys(_OF_MECHANISMS if is_of_mechanism(tables) else (*_OF_PAIRS, "mechanism", "joint"))
    constants = tables.table("constants", required=False)
    values: dict[str, Any] = dict(tables.constants)
    for key, value in constants.values.items():
        fault = constant_name_fault(key)
        if fault:
            constants.refuse(key, fault, quoted(key))
        with constants.naming(key):
            values[key] = parse_constant(key, value, values) if isinstance(value, str) else constants.number(key)
    tables = replace(tables, constants=values, let=tables.table("let", required=False).values)
    return replace(tables, constants=read_let(tables, values))


def _source_files(tables: Table, path: Path) -> tuple[Path, ...]:
    named = (("mechanism", "urdf"), ("motion", "file"))
    files = [tables.table(table, required=False).values.get(key) for table, key in named]
    return (path, *(path.parent / file for file in files if isinstance(file, str)))
