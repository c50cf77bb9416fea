"""The scene, pair or robot that a command line names; `hingepair urdf` and `hingepair mjcf`."""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import numpy as np
import typer

from hingepair.cli.output import out_option, write_text
from hingepair.errors import ArgumentError, HingePairError, MissingDependencyError, choices, printable
from hingepair.formats.model_writers import to_mjcf, to_urdf
from hingepair.formats.robots import load_robot, robot_names, robot_urdf
from hingepair.formats.urdf_reader import from_urdf, hinge_pair
from hingepair.formats.xml_text import commented
from hingepair.mechanism.mechanism import Mechanism
from hingepair.pair.body import DynamicsWarning
from hingepair.pair.dynamics import DEFAULT_GRAVITY_VECTOR
from hingepair.pair.hinge_load import HingeLoad
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import DEFAULT_PLANAR_GRAVITY_VECTOR, PlanarPair
from hingepair.pair.results import RESULT_FILE_SUFFIXES
from hingepair.scenes.load import (
    describes_motion,
    load_dynamics_setup,
    load_mechanism,
    load_pair,
    load_scene,
    load_suspicions,
    scene_files,
)
from hingepair.scenes.motions.motion import PRESCRIBED
from hingepair.scenes.pair_scene import PairScene
from hingepair.urdf.reader import read_urdf

if TYPE_CHECKING:
    from hingepair.scenes.motions.simulated import DynamicsSetup
    from hingepair.scenes.robot_scene import RobotScene

SourceArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="Scene file (TOML), which needs no motion; or, with JOINT, a robot's name or a URDF file.",
    ),
]
JointArgument = Annotated[
    str | None,
    typer.Argument(metavar="JOINT", help="Name of a hinge of the robot; hingepair robots NAME lists them."),
]
TextFileOption = Annotated[Path | None, out_option("Write to FILE instead of standard output.")]
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
FixedBaseOption = Annotated[bool, typer.Option("--fixed-base", help="Fix body 1 in the world.")]
GravityOption = Annotated[
    str | None,
    typer.Option(
        "--gravity",
        metavar="X,Y,Z",
        help="Acceleration of gravity in world axes [m/s^2]; default: 0,0,-9.81, of a planar pair 0,-9.81.",
    ),
]


def load_named_pair(source: str, joint: str | None, *frames: str | None) -> HingePair | PlanarPair:
    """Return the HingePair or PlanarPair of a scene file, or the HingePair of a hinge of a robot. `source` is a scene
    file, a robot's name or a URDF file; `joint` is the name of the hinge, None for a scene file. Two further
    positional arguments, for a hinge only, are the names of the links whose frames become those of body 1 and body 2;
    None means the joint's own link.
    """
    if joint is not None and source.lower().endswith(".toml"):
        raise ArgumentError("JOINT", "no JOINT after a scene file, which describes its own pair", repr(joint))
    if is_urdf(source) or (joint is not None and os.path.isfile(source)):
        return from_urdf(source, _require_joint(source, joint), *frames)
    if joint is not None:
        return hinge_pair(read_urdf(robot_urdf(source)), joint, *frames, name=f"{source}/{joint}")
    if any(frames):
        raise HingePairError("--body1-frame and --body2-frame: expected a JOINT, whose links they name, got none")
    if _names_robot(source):
        _require_joint(source, joint)
    return load_pair(source)


def load_named_robot(source: str) -> Mechanism | None:
    """Return the Mechanism of a URDF file, of a robot named `source`, or of a mechanism's scene file that has no
    table [motion]; return None for other sources.
    """
    if is_urdf(source):
        return Mechanism.from_urdf(source)
    if os.path.isfile(source) and not describes_motion(source):
        return load_mechanism(source)
    return load_robot(source) if _names_robot(source) else None


def load_named_scene(path: Path) -> PairScene | RobotScene:
    """Read a scene file that has a motion."""
    word = str(path)
    if _names_robot(word):
        expected = f"a scene file with a motion, and [mechanism] robot = {word!r}"
        raise ArgumentError(word, expected, "a robot, which alone has no motion")
    return load_scene(path)


def _names_robot(source: str) -> bool:
    """Return whether a string names a robot and no file."""
    if os.path.exists(source):
        return False
    is_word = Path(source).name == source and not Path(source).suffix
    try:
        if source in robot_names():
            return True
        if is_word:
            robot_urdf(source)
    except MissingDependencyError as error:
        if is_word:
            raise MissingDependencyError(source, f"a file, or {error.expected} for a robot", "neither") from None
    except ArgumentError as error:
        raise ArgumentError(source, f"a file, or {error.expected}", "neither of them") from None
    return False


def has_motion(source: str, joint: str | None, *frames: str | None) -> bool:
    """Return whether `source` alone names a scene file with a motion."""
    return is_scene_file(source, joint, *frames) and describes_motion(source)


def print_suspicions(source: str, joint: str | None, *frames: str | None) -> None:
    """Print notes on numbers of a scene file that are probably in another unit to standard error."""
    for sentence in load_suspicions(source) if is_scene_file(source, joint, *frames) else ():
        print(f"hingepair: note: {printable(sentence)}", file=sys.stderr)


def input_files(source: str) -> tuple[Path, ...]:
    """Return a tuple of the paths that a source is read from: a URDF file, or a scene file and the files that it
    names. It is empty if the source, such as a robot's name, is not a file.
    """
    path = Path(source)
    if not os.path.isfile(path):
        return ()
    return (path,) if is_urdf(source) else scene_files(path)


def is_urdf(source: str) -> bool:
    """Return whether a source, a path or a robot's name, is a URDF file. It is one if its suffix is .urdf or .xml, or
    if it is an existing file that is neither a scene (.toml) nor a log.
    """
    suffix = Path(source).suffix.lower()
    return suffix in {".urdf", ".xml"} or (suffix not in {".toml", *RESULT_FILE_SUFFIXES} and os.path.isfile(source))


def urdf_command(
    source: SourceArgument,
    joint: JointArgument = None,
    body1_frame: Body1FrameOption = None,
    body2_frame: Body2FrameOption = None,
    out: TextFileOption = None,
    fixed_base: FixedBaseOption = False,
    floating_base: Annotated[
        bool, typer.Option("--floating-base", help="Connect body 1 to a link `world` by a floating joint.")
    ] = False,
) -> None:
    """Write a pair, or the mechanism of a scene, as a URDF file.

    By default the base is free, and the program that loads the file must add a root joint. Of a scene with [dynamics]
    the base, damping, friction and stops are written as well; a comment and a warning list the keys that URDF cannot
    express.
    """
    if fixed_base and floating_base:
        raise HingePairError("--fixed-base and --floating-base exclude each other; give one of them")
    print_suspicions(source, joint, body1_frame, body2_frame)
    requested_base = "fixed" if fixed_base else "floating" if floating_base else None
    robot = load_mechanism(source) if is_scene_file(source, joint, body1_frame, body2_frame) else None
    if robot is not None:
        return write_text(to_urdf(robot, base=requested_base or "free"), out, input_files(source))
    pair = to_spatial(load_named_pair(source, joint, body1_frame, body2_frame))
    setup = _load_dynamics_setup(source, joint, body1_frame, body2_frame)
    if setup is None:
        return write_text(to_urdf(pair, base=requested_base or "free"), out, input_files(source))
    base = requested_base or ("fixed" if setup.base in {"fixed", PRESCRIBED} else "free")
    load = HingeLoad(**{key: value for key, value in setup.hinge.items() if key in {"damping", "friction", "stops"}})
    text = to_urdf(pair, base=base, hinge_torque=load, body1=setup.body1 if base == "fixed" else None)
    written = {"damping", "friction", "stops", *(_START_POSE if base == "fixed" else ())}
    written |= {"base"} if requested_base or setup.base in {"free", "fixed"} else set()
    return write_text(_add_omission_comment("URDF", text, setup, written), out, input_files(source))


def mjcf_command(
    source: SourceArgument,
    joint: JointArgument = None,
    body1_frame: Body1FrameOption = None,
    body2_frame: Body2FrameOption = None,
    out: TextFileOption = None,
    fixed_base: FixedBaseOption = False,
    free_base: Annotated[bool, typer.Option("--free-base", help="Give body 1 a free joint.")] = False,
    gravity: GravityOption = None,
) -> None:
    """Write a pair as a MuJoCo model (MJCF).

    Of a scene with [dynamics] the base, the pose of body 1 at the start, gravity, spring, damping, friction and stops
    are written; a comment and a warning list the keys that MJCF cannot express. Otherwise body 1 has a free joint if
    it has a mass, and is fixed in the world if it has none.
    """
    if fixed_base and free_base:
        raise HingePairError("--fixed-base and --free-base exclude each other; give one of them")
    print_suspicions(source, joint, body1_frame, body2_frame)
    pair = load_named_pair(source, joint, body1_frame, body2_frame)
    setup = _load_dynamics_setup(source, joint, body1_frame, body2_frame)
    assumed = []
    if setup is None:
        base = "fixed" if pair.body1 is None else "free"
    else:
        base = "fixed" if setup.base == PRESCRIBED else setup.base
    if fixed_base or free_base:
        base = "fixed" if fixed_base else "free"
    elif setup is None:
        assumed.append(f"body 1 is {base}, since it has {'no' if pair.body1 is None else 'a'} mass")
    if gravity is not None:
        vector: tuple[float, ...] = parse_gravity(gravity, len(pair.u1))
    else:
        vector = DEFAULT_PLANAR_GRAVITY_VECTOR if isinstance(pair, PlanarPair) else DEFAULT_GRAVITY_VECTOR
        if setup is not None and "gravity" in setup.keys:
            vector = setup.others["gravity"]
        else:
            assumed.append(f"gravity is ({', '.join(f'{component:g}' for component in vector)}) m/s^2")
    hinge_keys = ("stiffness", "rest", "damping", "friction", "stops")
    hinge = {} if setup is None else {key: value for key, value in setup.hinge.items() if key in hinge_keys}
    text = to_mjcf(
        to_spatial(pair),
        base=base,
        hinge_torque=HingeLoad(**hinge),
        body1=None if setup is None else setup.body1,
        gravity=(*vector, 0.0)[:3],
    )
    if assumed:
        print(f"hingepair: assumed: {'; '.join(assumed)}", file=sys.stderr)
    if setup is not None:
        written = {*hinge_keys, "gravity", *_START_POSE}
        written |= {"base"} if fixed_base or free_base or setup.base != PRESCRIBED else set()
        text = _add_omission_comment("MJCF", text, setup, written)
    write_text(text, out, input_files(source))


def parse_gravity(text: str, num_components: int) -> tuple[float, ...]:
    """Return the finite numbers in the text of the option --gravity, which are separated by commas, as a tuple of
    floats.
    """
    with contextlib.suppress(ValueError):
        vector = tuple(map(float, text.split(",")))
        if len(vector) == num_components and np.isfinite(vector).all():
            return vector
    expected = "three finite numbers X,Y,Z" if num_components == 3 else "two finite numbers X,Y for a planar pair"
    raise ArgumentError("--gravity", expected, repr(text))


_START_POSE: Final = ("R1_0", "S1_0", "phi_0")
"""Keys of the table [dynamics] for the pose of body 1 at the start."""


def _load_dynamics_setup(source: str, joint: str | None, *frames: str | None) -> DynamicsSetup | None:
    """Return the DynamicsSetup of the table [dynamics] of a scene file."""
    return load_dynamics_setup(source) if is_scene_file(source, joint, *frames) else None


def is_scene_file(source: str, joint: str | None, *frames: str | None) -> bool:
    """Return whether `source` is an existing file other than a URDF file, and nothing of a robot is named beside."""
    return joint is None and not any(frames) and os.path.isfile(source) and not is_urdf(source)


def _add_omission_comment(file_format: str, text: str, setup: DynamicsSetup, written_keys: set[str]) -> str:
    """Return the text of a model with an added comment that lists the keys of a DynamicsSetup that are not in
    `written_keys` (tol and breaks are never listed), and emit a DynamicsWarning with the same sentence.
    """
    keys = [key for key in setup.keys if key not in {*written_keys, "tol", "breaks"}]
    if not keys:
        return text
    shown = ", ".join(f'base = "{setup.base}"' if key == "base" else key for key in keys)
    sentence = f"{file_format} cannot express these keys of [dynamics], which are left out: {shown}"
    warnings.warn(sentence, DynamicsWarning, stacklevel=2)
    return commented(text, sentence)


def to_spatial(pair: HingePair | PlanarPair) -> HingePair:
    """Convert a planar pair to a spatial one; return a spatial pair unchanged."""
    return pair if isinstance(pair, HingePair) else pair.to_spatial()


def _require_joint(source: str, joint: str | None) -> str:
    """Return `joint`, the name of a hinge, unchanged."""
    if joint is None:
        hinges = read_urdf(source if is_urdf(source) else robot_urdf(source)).hinges()
        raise ArgumentError("JOINT", f"a hinge of {source}: {choices([hinge.name for hinge in hinges])}", "none")
    return joint
