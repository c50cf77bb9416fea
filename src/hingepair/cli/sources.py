"""What a command line names: a scene file, or a robot by its name or URDF file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from hingepair.cli.examples import example_hint
from hingepair.errors import ArgumentError, MissingDependencyError
from hingepair.formats.robots import load_robot, robot_urdf
from hingepair.mechanism.mechanism import Mechanism
from hingepair.scenes.scene import Scene, read_scene_file


class Source(NamedTuple):
    """What SCENE names."""

    named: Scene | Mechanism
    files: tuple[Path, ...]  # which are read

    @property
    def subject(self) -> Scene | Mechanism:
        """The robot, also that of a scene; or the scene of a pair."""
        robot = None if isinstance(self.named, Mechanism) else self.named.mechanism
        return self.named if robot is None else robot

    @property
    def robot(self) -> Mechanism:
        """The robot, also that of a scene."""
        if not isinstance(self.subject, Mechanism):
            expected = "a URDF file, the name of a robot, or a scene of a robot"
            raise ArgumentError("source", expected, "the scene of a pair")
        return self.subject


def read_source(text: str, snap: float | None = None) -> Source:
    """Read a scene file, a URDF file, or a robot by its name; `snap` is that of `load_robot`."""
    path = Path(text)
    if path.suffix.lower() in {".urdf", ".xml", ".xacro"}:
        return Source(Mechanism.from_urdf(text, snap=snap), (path,))
    if not os.path.exists(text):
        try:
            robot_urdf(text)
        except (ArgumentError, MissingDependencyError) as error:
            if path.suffix or path.name != text:
                raise ArgumentError(text, f"a file{example_hint(text)}", "none of this name") from None
            raise type(error)(text, f"a file, or {error.expected}", "neither of them") from None
        return Source(load_robot(text, snap=snap), ())
    scene = read_scene_file(text)
    return Source(scene, scene.files)


def read_scene(path: Path) -> Scene:
    """Read a scene file; refuse a robot, which alone has no motion."""
    source = read_source(str(path))
    if isinstance(source.named, Mechanism):
        key = "urdf" if source.files else "robot"
        expected = f"a scene file with a motion, and [mechanism] {key} = {str(path)!r}"
        raise ArgumentError(str(path), expected, "a robot, which alone has no motion (hingepair view shows it)")
    return source.named.checked()
