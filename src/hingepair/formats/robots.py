"""The robots of the package example-robot-data, and their hinges as pairs.

A robot is named by its URDF's file stem, `talos_reduced`; the ending `_robot` may be left out. Where two files share
a stem, the name is `folder/stem`, the folder being the robot's own: `anymal_c_simple_description/anymal`. That form
is understood for every robot.
"""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path, PurePosixPath
from types import MappingProxyType

from hingepair.errors import ArgumentError, MissingDependencyError, nearest, quoted
from hingepair.mechanism.building.urdf import from_urdf
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.pairs.hinge_pair import HingePair

_DATA = "example-robot-data"  # the package with the URDF files


def load_robot(
    name: str, base: str | None = None, locked: Mapping[str, float] | None = None, snap: float | None = None
) -> Mechanism:
    """Return a robot of the package example-robot-data, as `Mechanism.from_urdf` does.

    Args:
        name: the stem of its URDF file, such as "panda", or "folder/stem"; "ur5" is "ur5_robot". The command
            `hingepair robots` lists the names.
        base: "fixed" or "free", as for `Mechanism.from_urdf`.
        locked: positions [rad or m] at which joints are held, by their names.
        snap: tolerance [rad] for angles near multiples of pi/2.

    Raises:
        ArgumentError: no robot has this name, or several have it.
        MissingDependencyError: example-robot-data is not installed.

    The second finger joint of the Panda is a mimic joint that follows the first, so locking the first is enough:

    >>> import hingepair as hp
    >>> robot = hp.load_robot("panda", locked={"panda_finger_joint1": 0.02})
    >>> robot.dof, robot.position_limits[0].tolist()
    (7, [-2.8973, 2.8973])
    """
    if str(name).endswith((".urdf", ".xml", ".mjcf", ".xacro")):
        reader = "from_urdf" if str(name).endswith((".urdf", ".xacro")) else "from_mjcf"
        expected = f"a robot of {_DATA}; hp.Mechanism.{reader} reads a file"
        raise ArgumentError("robot", expected, quoted(str(name)))
    return Mechanism.from_urdf(robot_urdf(name), base, locked, snap)


def load_robot_hinge(robot: str, joint: str) -> HingePair:
    """Return one hinge of a robot of the package example-robot-data, as `hingepair.from_urdf` does, but without its
    warnings of masses that no rigid body can have.

    Args:
        robot: name of the robot, as for `load_robot`.
        joint: name of a revolute or continuous joint, which may be a mimic joint.

    Returns:
        The HingePair, named `robot/joint`, between the frames of the parent link and of the child link.

    Raises:
        ArgumentError: no robot has this name, or several have it.
        URDFError: the robot has no such hinge; the message lists its hinges.
        MissingDependencyError: example-robot-data is not installed.

    >>> import hingepair as hp
    >>> pair = hp.load_robot_hinge("talos_reduced", "arm_left_4_joint")
    >>> pair.n.tolist(), pair.u1.tolist()
    ([0.0, 1.0, 0.0], [0.02, 0.0, -0.273])
    """
    return replace(from_urdf(robot_urdf(robot), joint), name=f"{robot}/{joint}")


def robot_names() -> tuple[str, ...]:
    """Return the sorted names of all robots: the stem of a file, or folder/stem if several have it."""
    files = _urdf_paths()
    count = Counter(_stem(name) for name in files)
    return tuple(sorted(_stem(name) if count[_stem(name)] == 1 else name for name in files))


def robot_urdf(robot: str) -> Path:
    """Return the path of the URDF file of a robot of example-robot-data.

    >>> robot_urdf("anymal_c_simple_description/anymal").name
    'anymal.urdf'
    """
    files = _urdf_paths()
    matching_names = [name for name in files if robot in (name, _stem(name))]
    matching_names = matching_names or [name for name in files if _stem(name) == f"{robot}_robot"]
    if len(matching_names) == 1:
        return files[matching_names[0]]
    if matching_names:
        raise ArgumentError("robot", "one robot: " + " or ".join(sorted(matching_names)), quoted(robot))
    names = robot_names()
    hint = nearest(str(robot).lower(), names) or " (hingepair robots lists them)"
    raise ArgumentError("robot", f"one of the {len(names)} robots of {_DATA}{hint}", quoted(robot))


def _stem(name: str) -> str:
    return name.rpartition("/")[2]


@functools.cache
def _urdf_paths() -> Mapping[str, Path]:
    """Return the paths of all URDF files of example-robot-data by `folder/stem`."""
    import importlib.metadata

    # The package holds only data; the list of files that its installer wrote says where they are.
    try:
        distribution = importlib.metadata.distribution(_DATA)
    except importlib.metadata.PackageNotFoundError:
        raise MissingDependencyError(
            "robot", f"the package {_DATA} (pip install 'hingepair[robots]')", "none installed"
        ) from None
    paths: dict[str, Path] = {}
    for file in distribution.files or ():
        if file.suffix != ".urdf" or "robots" not in file.parts:
            continue
        inside = PurePosixPath(*file.parts[file.parts.index("robots") + 1 :])
        path = Path(str(distribution.locate_file(file)))
        if path.is_file() and b"<link" in path.read_bytes():  # ur3.urdf holds no robot
            paths[f"{inside.parts[0]}/{inside.stem}"] = path
    if not paths:
        raise MissingDependencyError("robot", f"{_DATA} with its robots", "none of its files listed")
    return MappingProxyType(paths)
