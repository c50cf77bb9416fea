"""Scenes, or only what moves in them, read from TOML files."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hingepair.errors import SceneError, quoted
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.scenes.motions.motion import PairMotion
from hingepair.scenes.pair_scene import PairScene
from hingepair.scenes.pair_table import read_pair
from hingepair.scenes.scene import Scene
from hingepair.scenes.suspicions import file_suspicions
from hingepair.scenes.tables import Table, read_tables
from hingepair.symbolic.expressions import constant_name_fault, parse_constant
from hingepair.tables.column_tables import column_table
from hingepair.tables.units import Units

if TYPE_CHECKING:
    from hingepair.mechanism.mechanism import Mechanism
    from hingepair.scenes.motions.simulated import DynamicsSetup
    from hingepair.scenes.robot_scene import RobotScene

# Top-level keys of scene files, of both kinds and of each.
_COMMON_TABLES = ("title", "constants", "motion", "dynamics", "time", "outputs")
_PAIR_TABLES = (*_COMMON_TABLES, "planar", "pair", "tolerances")
_ROBOT_TABLES = (*_COMMON_TABLES, "mechanism", "joint", "base")


def load_scene(path: str | os.PathLike[str], log: Any = None) -> PairScene | RobotScene:
    """Read a TOML scene file, whose format docs/scenes.md describes.

    Args:
        path: path of the scene file. Relative paths in the file start from the folder of the file.
        log: recorded motion in place of the file that [motion] names: a pandas DataFrame, an xarray Dataset or a dict
            of arrays with the columns of a log, or the path of another file. [motion] then needs no `file`; its other
            keys count as for that file.

    Returns:
        A `PairScene` or, if the file describes a robot, a `RobotScene`. Both have a method `evaluate()`, which
        computes the outputs at the instants of the scene.

    Raises:
        SceneError: the file cannot be read as a scene. The message is one line; it names the file and, if a key of
            the scene is wrong, the table and the key.
        MissingDependencyError: the file names a robot of example-robot-data, and that package is not installed.
    """
    return SceneFile(path, log).scene()


def scene_from_tables(tables: Table, path: str | os.PathLike[str]) -> PairScene | RobotScene:
    """Return the scene of a top-level table with evaluated constants, from the file at `path`."""
    place = Path(path)
    common: dict[str, Any] = {
        "path": place,
        "outputs": None,
        "constants": {key: float(value) for key, value in tables.constants.items()},
        "files": tuple(file.absolute() for file in _source_files(tables, place)),
        "tables": tables,
    }
    scene: PairScene | RobotScene
    scene = _robot_scene(tables, common) if _is_of_robot(tables) else _pair_scene(tables, common)
    outputs = tables.table("outputs", required=False)
    outputs.check_keys(("names", "units"))
    if "units" in outputs.values:
        with outputs.naming("units"):
            scene = replace(scene, units=Units(outputs.text("units")))
    if "names" not in outputs.values:
        return scene
    names = outputs.values["names"]
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        outputs.fail("names", 'a list of names such as ["R2", "v2"], of a robot ["R", "tau"]')
    with outputs.naming("names"):
        scene.request(names)
    return replace(scene, outputs=tuple(dict.fromkeys(names)))


def _pair_scene(tables: Table, common: dict[str, Any]) -> PairScene:
    pair = _read_pair(tables)
    motion = _read_motion(tables, common["path"].parent, pair)
    return PairScene(title=tables.text("title", default=pair.name), pair=pair, motion=motion, **common)


def _robot_scene(tables: Table, common: dict[str, Any]) -> RobotScene:
    """Return the scene of a robot with the fields that it has in `common` with that of a pair."""
    from hingepair.scenes.motions.joints import read_joint_motion
    from hingepair.scenes.robot_scene import RobotScene
    from hingepair.scenes.robot_table import is_stray_joint, read_gravity, read_joint_loads, read_mechanism

    folder = common["path"].parent
    try:
        robot = read_mechanism(tables, folder)
        if "dynamics" in tables.values:
            from hingepair.scenes.motions.simulated_joints import read_simulated_joints

            motion = read_simulated_joints(tables, robot, read_gravity(tables))
            robot = motion.simulated.robot if motion.simulated else robot
        else:
            motion = read_joint_motion(tables, folder, robot)
    except SceneError as error:
        if is_stray_joint(tables, folder, error):
            raise SceneError(error.name, "the motion of a joint under [motion]", "a joint in another table") from None
        raise
    frames = tuple(tables.table("mechanism", required=False).table("frames", required=False).values)
    return RobotScene(
        title=tables.text("title", default=robot.name),
        mechanism=robot,
        motion=motion,
        gravity=read_gravity(tables) or DEFAULT_GRAVITY,
        joint_loads=read_joint_loads(tables),
        frames=frames or robot.tips,
        **common,
    )


def with_same_motion(scene: Scene, tables: Table) -> Scene:
    """Return the scene with its motion, but with the pair or robot of other tables."""
    if _is_of_robot(tables):
        from hingepair.scenes.robot_table import read_mechanism

        return replace(scene, mechanism=read_mechanism(tables, scene.path.parent), tables=tables)  # type: ignore[call-arg]
    return replace(scene, pair=_read_pair(tables), tables=tables)  # type: ignore[call-arg]


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
        """Whether there is [dynamics], [motion] with more than constants, or [motion] together with [time]."""
        tables = self.tables
        keys = tables.table("motion", required=False).values.keys() - {"constants"}
        return bool(keys) or "dynamics" in tables.values or {"motion", "time"} <= tables.values.keys()

    @lock_free_cached_property
    def pair(self) -> HingePair | PlanarPair:
        """The pair that the file describes; its motion is not read.

        Raises:
            SceneError: the scene is one of a robot.
        """
        return _read_pair(self.tables)

    @lock_free_cached_property
    def mechanism(self) -> Mechanism | None:
        """The robot; None in the scene of a pair."""
        if not _is_of_robot(self.tables):
            return None
        from hingepair.scenes.robot_table import read_mechanism

        return read_mechanism(self.tables, Path(self.path).parent)

    @lock_free_cached_property
    def dynamics(self) -> DynamicsSetup | None:
        """What the table [dynamics] of a pair's scene says; None if there is no such table."""
        if "dynamics" not in self.tables.values:
            return None
        from hingepair.scenes.motions.simulated import read_dynamics_setup

        motion = self.tables.table("motion", required=False)
        return read_dynamics_setup(self.tables.table("dynamics"), self.pair, motion)

    @property
    def suspicions(self) -> tuple[str, ...]:
        """Sentences on numbers that are probably in another unit."""
        if self.mechanism is None:
            limits: Any = {"psi": getattr(self.pair, "limits", None) or ()}
        else:
            from hingepair.mechanism.mechanism import tree_of

            joints = tree_of(self.mechanism).coordinates
            limits = {joint.name: joint.position_limits for joint in joints if joint.unit == "rad"}
        return tuple(dict.fromkeys(file_suspicions(self.tables.values, limits)))

    def scene(self) -> PairScene | RobotScene:
        """Return the scene with its motion, as `load_scene`."""
        return scene_from_tables(self.tables, self.path)


def with_constants_evaluated(tables: Table) -> Table:
    """Return a scene's top-level table with its constants evaluated; refuse a sweep and unknown tables."""
    if {"scene", "vary"} <= tables.values.keys():
        raise SceneError(tables.file, "a scene", f"a sweep (hingepair sweep {tables.file} computes it)")
    if _is_of_robot(tables):
        for key in tables.values:
            if key in _PAIR_TABLES and key not in _ROBOT_TABLES:
                tables.fail(key, "nothing of this name in the scene of a mechanism, by [mechanism] or [[joint]]")
        tables.check_keys(_ROBOT_TABLES)
    else:
        tables.check_keys((*_PAIR_TABLES, "mechanism", "joint"))
    constants = tables.table("constants", required=False)
    motion = tables.table("motion", required=False)
    if "constants" in motion.values:  # where scenes had them until 0.1
        if constants.values:
            tables.refuse("constants", "constants in one table", "[constants] and [motion.constants]")
        constants = motion.table("constants")
    values: dict[str, Any] = {}
    for key, value in constants.values.items():
        fault = constant_name_fault(key)
        if fault:
            constants.refuse(key, fault, quoted(key))
        with constants.naming(key):
            values[key] = parse_constant(key, value, values) if isinstance(value, str) else constants.number(key)
    return replace(tables, constants=values)


def _is_of_robot(tables: Table) -> bool:
    return not tables.values.keys().isdisjoint({"mechanism", "joint"})


def _read_pair(tables: Table) -> HingePair | PlanarPair:
    if _is_of_robot(tables):
        tables.refuse("pair", "the scene of a pair, which has a table [pair]", "the scene of a mechanism")
    return read_pair(tables.table("pair"), tables.flag("planar"))


def _read_motion(tables: Table, folder: Path, pair: HingePair | PlanarPair) -> PairMotion:
    """Return the motion that the tables [motion], [dynamics] and [time] define."""
    if "dynamics" in tables.values:
        from hingepair.scenes.motions.simulated import (
            gives_psi,
            read_dynamics_setup,
            read_simulated_motion,
            with_hinge_loads,
        )

        motion, dynamics = tables.table("motion", required=False), tables.table("dynamics")
        if gives_psi(motion):
            setup = read_dynamics_setup(dynamics, pair, motion)
            return with_hinge_loads(_read_given_motion(tables, motion, folder, pair), setup, dynamics)
        return read_simulated_motion(dynamics, motion, tables.table("time"), pair)
    return _read_given_motion(tables, tables.table("motion"), folder, pair)


def _read_given_motion(tables: Table, motion: Table, folder: Path, pair: HingePair | PlanarPair) -> PairMotion:
    """Return the motion that the Table [motion] defines by expressions, rates or a log."""
    planar = isinstance(pair, PlanarPair)
    if "file" not in motion.values:
        if "psi_dot" in motion.values and "omega1" not in motion.values:
            motion.fail("omega1", "the angular velocity of body 1, since psi_dot is given")
        from hingepair.scenes.motions.functions import read_expression_motion

        return read_expression_motion(motion, tables.table("time"), planar)
    from hingepair.scenes.motions.logs import read_log

    if planar:
        motion.fail(
            "file",
            "no such key beside planar = true: without it, u1 and u2 have three numbers, n = [0, 0, 1], and a log in "
            "the plane needs no z, phi_x and phi_y",
        )
    if "time" in tables.values:
        tables.fail("time", "no such table, since the column t of motion.file has the instants")
    return read_log(motion, folder)


def _source_files(tables: Table, path: Path) -> tuple[Path, ...]:
    named = (("mechanism", "urdf"), ("motion", "file"))
    files = [tables.table(table, required=False).values.get(key) for table, key in named]
    return (path, *(path.parent / file for file in files if isinstance(file, str)))
