"""What a command line names: a scene file, a robot, a URDF file, or a hinge of one of the latter two."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hingepair.errors import ArgumentError, HingePairError, MissingDependencyError, choices, printable, quoted
from hingepair.formats.robots import load_robot, robot_urdf
from hingepair.mechanism.building.urdf import from_urdf, hinge_of_urdf
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.results import RESULT_FILE_SUFFIXES
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.scenes.load import SceneFile, load_scene
from hingepair.scenes.scene import Scene
from hingepair.urdf.reader import read_urdf
from hingepair.urdf.records import HINGE_TYPES

if TYPE_CHECKING:
    from hingepair.scenes.motions.dynamics import Dynamics

ColumnOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=COLUMN[:UNIT]",
        help="Column of another program, such as t=Zeit or x1=Ost:mm; may be repeated. Unknown columns are then "
        "not read.",
    ),
]
JointArgument = Annotated[
    str | None,
    typer.Argument(metavar="JOINT", help="Name of a hinge of the robot; hingepair robots NAME lists them."),
]
Body1FrameOption = Annotated[
    str | None,
    typer.Option(
        "--body1-frame", metavar="LINK", help="Link whose frame is that of body 1; default: JOINT's parent link."
    ),
]
Body2FrameOption = Annotated[
    str | None,
    typer.Option(
        "--body2-frame", metavar="LINK", help="Link whose frame is that of body 2; default: JOINT's child link."
    ),
]


def parse_columns(options: Sequence[str]) -> dict[str, dict[str, str]]:
    """Return names and units of columns by the names that they have here, from the values of the option --column.

    >>> parse_columns(["t=Zeit", "x1=Ost:mm"])
    {'t': {'name': 'Zeit'}, 'x1': {'name': 'Ost', 'unit': 'mm'}}
    """
    columns = {}
    for option in options:
        name, equals, rest = option.partition("=")
        column, colon, unit = rest.rpartition(":") if ":" in rest else (rest, "", "")
        if not (name.strip() and equals and column.strip()):
            raise ArgumentError("column", "such as t=Zeit or x1=Ost:mm", quoted(option))
        columns[name.strip()] = {"name": column.strip()} | ({"unit": unit.strip()} if colon else {})
    return columns


@dataclass(frozen=True)
class Source:
    """What a command line names."""

    text: str  # a scene file, a robot's name or a URDF file
    joint: str | None = None
    body1_frame: str | None = None  # links whose frames become those of the bodies; by default those of the joint
    body2_frame: str | None = None

    @lock_free_cached_property
    def scene_file(self) -> SceneFile:
        """The scene file, if the text names one."""
        return SceneFile(self.text)

    @property
    def is_whole(self) -> bool:
        """Whether no hinge of a robot is named."""
        return not any((self.joint, self.body1_frame, self.body2_frame))

    @property
    def is_urdf(self) -> bool:
        """Whether this is a URDF file: by its suffix, or its first character."""
        suffix = Path(self.text).suffix.lower()
        if suffix in {".urdf", ".xml"}:
            return True
        if suffix in {".toml", *RESULT_FILE_SUFFIXES} or not os.path.isfile(self.text):
            return False
        with open(self.text, "rb") as file:
            return file.read(64).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<")

    @property
    def is_scene(self) -> bool:
        """Whether this is an existing scene file alone."""
        return self.is_whole and os.path.isfile(self.text) and not self.is_urdf

    @property
    def has_motion(self) -> bool:
        """Whether this is a scene file with a motion."""
        return self.is_scene and self.scene_file.has_motion

    @property
    def files(self) -> tuple[Path, ...]:
        """The URDF file, or the scene file and the files that it names; nothing of a robot's name."""
        path = Path(self.text)
        if not os.path.isfile(path):
            return ()
        return (path,) if self.is_urdf else self.scene_file.files

    def pair(self) -> HingePair | PlanarPair:
        """Return the pair of a scene file, or that of the hinge."""
        text, joint, frames = self.text, self.joint, (self.body1_frame, self.body2_frame)
        if joint is not None and text.lower().endswith(".toml"):
            raise ArgumentError("JOINT", "no JOINT after a scene file, which describes its own pair", repr(joint))
        if self.is_urdf or (joint is not None and os.path.isfile(text)):
            return from_urdf(text, self._require_joint(), *frames)
        if joint is not None:
            return hinge_of_urdf(robot_urdf(text), joint, *frames, name=f"{text}/{joint}")
        if any(frames):
            raise HingePairError("--body1-frame and --body2-frame: expected a JOINT, whose links they name, got none")
        if names_robot(text):
            self._require_joint()
        return self.scene_file.pair

    def spatial_pair(self) -> HingePair:
        """Return the pair; a planar one in space."""
        pair = self.pair()
        return pair if isinstance(pair, HingePair) else pair.to_spatial()

    def robot(self) -> Mechanism | None:
        """Return the robot of a URDF file, of a name, or of a scene file without a motion; None for anything else."""
        if self.is_urdf:
            return Mechanism.from_urdf(self.text)
        if os.path.isfile(self.text) and not self.scene_file.has_motion:
            return self.scene_file.mechanism
        return load_robot(self.text) if names_robot(self.text) else None

    def dynamics(self) -> Dynamics | None:
        """Return what the table [dynamics] of a scene file says."""
        return self.scene_file.dynamics if self.is_scene else None

    def print_suspicions(self) -> None:
        """Print notes on numbers of a scene file that are probably in another unit to standard error."""
        for sentence in self.scene_file.suspicions if self.is_scene else ():
            print(f"hingepair: note: {printable(sentence)}", file=sys.stderr)

    def _require_joint(self) -> str:
        """Return JOINT; raise an ArgumentError with the names of the hinges if it is missing."""
        if self.joint is None:
            joints = read_urdf(self.text if self.is_urdf else robot_urdf(self.text)).joints
            names = choices([joint.name for joint in joints if joint.type in HINGE_TYPES])
            raise ArgumentError("JOINT", f"a hinge of {self.text}: {names}", "none")
        return self.joint


def load_named_scene(path: Path) -> Scene:
    """Read a scene file; refuse a robot's name and a URDF file, which have no motion."""
    word = str(path)
    if names_robot(word):
        expected = f"a scene file with a motion, and [mechanism] robot = {word!r}"
        raise ArgumentError(word, expected, "a robot, which alone has no motion (hingepair view shows it)")
    if path.suffix.lower() in {".urdf", ".xml"}:
        expected = f"a scene file with a motion, and [mechanism] urdf = {word!r}"
        raise ArgumentError(word, expected, "a URDF file, which has no motion (hingepair view shows it)")
    return load_scene(path)


def names_robot(text: str) -> bool:
    """Return whether a text names a robot and no file; refuse a word that names neither."""
    if os.path.exists(text):
        return False
    is_word = Path(text).name == text and not Path(text).suffix
    try:
        robot_urdf(text)
    except MissingDependencyError as error:
        if is_word:
            raise MissingDependencyError(text, f"a file, or {error.expected} for a robot", "neither") from None
        return False
    except ArgumentError as error:
        if is_word:
            raise ArgumentError(text, f"a file, or {error.expected}", "neither of them") from None
        return False
    return True
