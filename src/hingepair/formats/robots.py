"""The robots of the package example-robot-data, and their hinges as pairs.

A robot is named by its URDF's file stem, `talos_reduced`. Where two files share a stem, the name is
`folder/stem`, the folder being the robot's own: `anymal_c_simple_description/anymal`. That form is understood for
every robot.
"""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from types import MappingProxyType

from hingepair.errors import ArgumentError, MissingDependencyError, quoted
from hingepair.formats.urdf_reader import hinge_pair
from hingepair.mechanism.mechanism import Mechanism
from hingepair.pair.hinge_pair import HingePair
from hingepair.urdf.reader import read_urdf

ROBOT_DATA_DISTRIBUTION_NAME = "example-robot-data"  # the distribution that holds the robots' URDF files


def load_robot(
    name: str, base: str | None = None, locked: Mapping[str, float] | None = None, snap: float | None = None
) -> Mechanism:
    """Return the robot `name` of the package example-robot-data as a Mechanism. `base` is "fixed", "free" or None.
    `locked` is a dict from names of joints to the positions at which these joints are held. Angles (rpy) of the
    URDF's origins that are within `snap` [rad] of a multiple of pi/2 are replaced by this multiple. Warn as
    `Mechanism.from_urdf` does, for example if a joint is locked beyond its limits.

    Args:
        name: name of the robot: the stem of its URDF file, such as "panda", or "folder/stem". The command
            `hingepair robots` lists the names.
        base: "fixed": the base rests, or moves as the argument `base_motion` of the methods prescribes; "free":
            forces move the base. By default, it is fixed unless the URDF has a floating root joint.
        locked: dict from names of joints to the positions [rad or m] at which these joints are held, as for
            `Mechanism.from_urdf`. By default, no joint is locked.
        snap: tolerance [rad] for angles near multiples of pi/2, as for `Mechanism.from_urdf`. By default, no angle is
            replaced.

    Raises:
        ArgumentError: there is no robot of this name, or there are several robots of this name; or base, locked or
            snap cannot be used.
        URDFError: the URDF file of the robot cannot be read.
        MissingDependencyError: example-robot-data is not installed.

    The second finger joint of the Panda is a mimic joint that follows the first, so locking the first is enough:

    >>> import hingepair as hp
    >>> robot = hp.load_robot("panda", locked={"panda_finger_joint1": 0.02})
    >>> robot.dof, robot.position_limits[0].tolist()
    (7, [-2.8973, 2.8973])
    """
    return Mechanism.from_urdf(robot_urdf(name), base, locked, snap)


def load_robot_hinge(robot: str, joint: str) -> HingePair:
    """Return one hinge of a robot of the package example-robot-data as a HingePair. `robot` and `joint` are the names
    of the robot and of the joint.

    (R1, S1) is the frame of the parent link of the joint, and (R2, S2) is the frame of the child link. u1 and home
    are the position and the rotation of the joint's `<origin>` (home is the attitude of body 2 relative to body 1 at
    psi = 0); u2 is zero.

    Args:
        robot: name of the robot: the stem of its URDF file, such as "talos_reduced", or "folder/stem".
        joint: name of a revolute or continuous joint, which may be a mimic joint.

    Returns:
        The pair, named `robot/joint`, with the limits and the mass properties that `hingepair.from_urdf` gives it.
        `body1` combines the parent link and all links that are rigidly fixed to it, and `body2` combines the child
        link and all links that are rigidly fixed to it. A body is None if none of its links has mass, or if no rigid
        body can have the combined mass properties. `hingepair.from_urdf` warns of such mass properties; this function
        does not.

    Raises:
        ArgumentError: there is no robot of this name, or there are several.
        URDFError: the robot has no such hinge; the message lists its hinges.
        MissingDependencyError: example-robot-data is not installed.

    >>> import hingepair as hp
    >>> pair = hp.load_robot_hinge("talos_reduced", "arm_left_4_joint")
    >>> pair.n.tolist(), pair.u1.tolist()
    ([0.0, 1.0, 0.0], [0.02, 0.0, -0.273])
    """
    return hinge_pair(read_urdf(robot_urdf(robot)), joint, name=f"{robot}/{joint}")


def robot_names() -> tuple[str, ...]:
    """Return the sorted names of all robots of example-robot-data: the stem of the URDF file if it is unique, else
    `folder/stem`.

    Raises:
        MissingDependencyError: example-robot-data is not installed.
    """
    files = _urdf_paths()
    count = Counter(_stem(name) for name in files)
    return tuple(sorted(_stem(name) if count[_stem(name)] == 1 else name for name in files))


def robot_urdf(robot: str) -> Path:
    """Return the path of the URDF file of a robot of example-robot-data.

    Raises:
        ArgumentError: no such robot, or more than one.
        MissingDependencyError: example-robot-data is not installed.

    >>> robot_urdf("anymal_c_simple_description/anymal").name
    'anymal.urdf'
    """
    files = _urdf_paths()
    matching_names = [name for name in files if robot in (name, _stem(name))]
    if len(matching_names) == 1:
        return files[matching_names[0]]
    if matching_names:
        raise ArgumentError("robot", "one robot: " + " or ".join(sorted(matching_names)), quoted(robot))
    raise ArgumentError("robot", _expected_robot_text(str(robot)), quoted(robot))


def _expected_robot_text(robot: str) -> str:
    """Return the part of the error message on an unknown robot that says what was expected: the number of robots and
    the nearest names.
    """
    import difflib

    names = robot_names()
    lower = {name.lower(): name for name in names}
    near = [name for key, name in lower.items() if robot and (robot.lower() in key or key in robot.lower())]
    near += [lower[key] for key in difflib.get_close_matches(robot.lower(), lower, n=5) if lower[key] not in near]
    hint = f", such as {', '.join(near[:5])}" if near else " (hingepair robots lists them)"
    return f"one of the {len(names)} robots of {ROBOT_DATA_DISTRIBUTION_NAME}{hint}"


def _stem(name: str) -> str:
    """Return the part of a robot's name after the last slash."""
    return name.rpartition("/")[2]


@functools.cache
def _urdf_paths() -> Mapping[str, Path]:
    """Return the paths of all URDF files of example-robot-data as a read-only mapping from `folder/stem` to a Path,
    which is cached. Raise a MissingDependencyError if the package is not installed.

    The package holds only data; the list of files that its installer wrote says where they are.
    """
    import importlib.metadata

    try:
        distribution = importlib.metadata.distribution(ROBOT_DATA_DISTRIBUTION_NAME)
    except importlib.metadata.PackageNotFoundError:
        raise MissingDependencyError(
            "robot", f"the package {ROBOT_DATA_DISTRIBUTION_NAME} (pip install 'hingepair[robots]')", "none installed"
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
        raise MissingDependencyError(
            "robot", f"{ROBOT_DATA_DISTRIBUTION_NAME} with its robots", "none of its files listed"
        )
    return MappingProxyType(paths)
