"""The pair that a command line names: a scene's, or a hinge of a robot. `hingepair urdf` and `mjcf` write it."""

from __future__ import annotations

import contextlib
import os
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from hingepair.cli.output import file_option, give
from hingepair.errors import ArgumentError, HingePairError, MissingDependencyError, choices
from hingepair.formats.model_writers import to_mjcf, to_urdf
from hingepair.formats.robots import load_robot, robot_names, robot_urdf
from hingepair.formats.urdf_reader import from_urdf, hinge_pair
from hingepair.formats.xml_text import commented
from hingepair.mechanism.mechanism import Mechanism
from hingepair.pair.body import DynamicsWarning
from hingepair.pair.dynamics import GRAVITY
from hingepair.pair.hinge_load import HingeLoad
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PLANAR_GRAVITY, PlanarPair
from hingepair.scenes.scene import Scene, load_mechanism, load_pair, load_scene, load_setup, scene_files
from hingepair.scenes.simulated_motion import PRESCRIBED, DynamicsSetup
from hingepair.scenes.tables import read_tables
from hingepair.urdf.reader import read_urdf

if TYPE_CHECKING:
    from hingepair.scenes.mechanisms.scene import MechanismScene

Source = Annotated[
    str,
    typer.Argument(
        metavar="SCENE", help="Scene file (TOML), whose motion is not needed; with JOINT a robot or a URDF file."
    ),
]
Joint = Annotated[
    str | None,
    typer.Argument(metavar="JOINT", help="A hinge of the robot (hingepair robots NAME lists them)."),
]
TextFile = Annotated[Path | None, file_option("Write to FILE instead of standard output.")]
Frame1 = Annotated[
    str | None,
    typer.Option("--body1-frame", metavar="LINK", help="Link whose frame is body 1's: JOINT's parent unless given."),
]
Frame2 = Annotated[
    str | None,
    typer.Option("--body2-frame", metavar="LINK", help="Link whose frame is body 2's: JOINT's child unless given."),
]
FixedBase = Annotated[bool, typer.Option("--fixed-base", help="Body 1 stands still in the world.")]


def named_pair(source: str, joint: str | None, *frames: str | None) -> HingePair | PlanarPair:
    """Return the pair of a scene file, or the hinge of a robot or of a URDF file between two links' frames."""
    if is_urdf(source):
        return from_urdf(source, _given(source, joint), *frames)
    if joint is not None and source.lower().endswith(".toml"):
        raise ArgumentError("JOINT", "nothing after a scene file, which describes its own pair", repr(joint))
    if joint is not None:
        return hinge_pair(read_urdf(robot_urdf(source)), joint, *frames, name=f"{source}/{joint}")
    if any(frames):
        raise HingePairError("--body1-frame and --body2-frame need a JOINT, whose links they are")
    with contextlib.suppress(MissingDependencyError):
        if not os.path.exists(source) and source in robot_names():
            _given(source, joint)
    return load_pair(source)


def named_robot(source: str) -> Mechanism | None:
    """Return the robot of a URDF file, of example-robot-data, or of a scene file without a motion; else None."""
    if is_urdf(source):
        return Mechanism.from_urdf(source)
    if os.path.isfile(source) and "motion" not in read_tables(source).values:
        return load_mechanism(source)
    with contextlib.suppress(MissingDependencyError):
        if not os.path.exists(source) and source in robot_names():
            return load_robot(source)
        _check_word(source)
    return None


def named_scene(path: Path) -> Scene | MechanismScene:
    """Return the scene of a file; refuse a robot's name, and a word that names nothing."""
    word = str(path)
    with contextlib.suppress(MissingDependencyError):
        if not os.path.exists(word) and word in robot_names():
            expected = f"a scene file with a motion, and [mechanism] robot = {word!r}"
            raise ArgumentError(word, expected, "a robot, which alone has no motion")
        _check_word(word)
    return load_scene(path)


def _check_word(source: str) -> None:
    """Refuse a word without a suffix or a folder that is neither a file nor a robot; name close robots."""
    if os.path.exists(source) or Path(source).name != source or Path(source).suffix:
        return
    try:
        robot_urdf(source)
    except MissingDependencyError:
        raise
    except ArgumentError as error:
        raise ArgumentError(source, f"a file, or {error.expected}", "neither of them") from None


def named(source: str, joint: str | None, *frames: str | None) -> Scene | MechanismScene | HingePair | PlanarPair:
    """Return the scene of a file that has a motion, or else the pair."""
    scene = joint is None and not any(frames) and os.path.isfile(source) and not is_urdf(source)
    if scene and {"motion", "dynamics"} & read_tables(source).values.keys():
        return load_scene(source)
    return named_pair(source, joint, *frames)


def of_a_pair(found: Scene | MechanismScene | HingePair | PlanarPair) -> Scene | HingePair | PlanarPair:
    """Return the scene of a pair, or a pair; refuse the scene of a mechanism.

    Raises:
        ArgumentError: the scene is that of a mechanism.
    """
    if not isinstance(found, Scene | HingePair | PlanarPair):
        raise ArgumentError("SCENE", "the scene of a pair, or a hinge", "the scene of a whole mechanism")
    return found


def inputs_of(source: str) -> tuple[Path, ...]:
    """Return the files that a pair is read from."""
    path = Path(source)
    if not os.path.isfile(path):
        return ()
    return (path,) if is_urdf(source) else scene_files(path)


def is_urdf(source: str) -> bool:
    """Return whether the name is that of a URDF file: of any file that is no scene."""
    ending = Path(source).suffix.lower()
    return ending in {".urdf", ".xml"} or (ending != ".toml" and os.path.isfile(source))


def urdf(
    source: Source,
    joint: Joint = None,
    body1_frame: Frame1 = None,
    body2_frame: Frame2 = None,
    out: TextFile = None,
    fixed_base: FixedBase = False,
    floating_base: Annotated[
        bool, typer.Option("--floating-base", help="Body 1 hangs on a floating joint from a link `world`.")
    ] = False,
) -> None:
    """Write the pair, or the mechanism of a scene, as a URDF robot.

    Unless told otherwise its base is free: the loader gives it a root joint. Of a scene with [dynamics] its base,
    damping, friction and stops are written, too; a comment and a warning list what URDF has no place for.
    """
    if fixed_base and floating_base:
        raise HingePairError("--fixed-base and --floating-base exclude each other")
    wanted = "fixed" if fixed_base else "floating" if floating_base else None
    robot = load_mechanism(source) if _is_scene(source, joint, body1_frame, body2_frame) else None
    if robot is not None:
        return give(to_urdf(robot, base=wanted or "free"), out, inputs_of(source))
    pair = _in_space(named_pair(source, joint, body1_frame, body2_frame))
    setup = _setup_of(source, joint, body1_frame, body2_frame)
    if setup is None:
        return give(to_urdf(pair, base=wanted or "free"), out, inputs_of(source))
    base = wanted or ("fixed" if setup.base in {"fixed", PRESCRIBED} else "free")
    load = HingeLoad(**{key: value for key, value in setup.hinge.items() if key in {"damping", "friction", "stops"}})
    text = to_urdf(pair, base=base, hinge_torque=load, body1=setup.body1 if base == "fixed" else None)
    written = {"damping", "friction", "stops", *(_POSE if base == "fixed" else ())}
    written |= {"base"} if wanted or setup.base in {"free", "fixed"} else set()
    return give(_with_left_out("URDF", text, setup, written), out, inputs_of(source))


def mjcf(
    source: Source,
    joint: Joint = None,
    body1_frame: Frame1 = None,
    body2_frame: Frame2 = None,
    out: TextFile = None,
    fixed_base: FixedBase = False,
) -> None:
    """Write the pair as a MuJoCo model (MJCF): a free joint and a hinge.

    Of a scene with [dynamics] its base, the place of body 1 at the start, gravity, spring, damping, friction and
    stops are written, too; a comment and a warning list what MJCF has no place for.
    """
    pair = named_pair(source, joint, body1_frame, body2_frame)
    setup = _setup_of(source, joint, body1_frame, body2_frame)
    if setup is None:
        return give(to_mjcf(_in_space(pair), base="fixed" if fixed_base else "free"), out, inputs_of(source))
    base = "fixed" if fixed_base or setup.base == PRESCRIBED else setup.base
    held = ("stiffness", "rest", "damping", "friction", "stops")
    load = HingeLoad(**{key: value for key, value in setup.hinge.items() if key in held})
    fall = setup.others.get("gravity", PLANAR_GRAVITY if isinstance(pair, PlanarPair) else GRAVITY)
    gravity = (*fall, 0.0)[:3]
    text = to_mjcf(_in_space(pair), base=base, hinge_torque=load, body1=setup.body1, gravity=gravity)
    written = {*held, "gravity", *_POSE, *(("base",) if fixed_base or setup.base != PRESCRIBED else ())}
    return give(_with_left_out("MJCF", text, setup, written), out, inputs_of(source))


_POSE: Final = ("R1_0", "S1_0", "phi_0")


def _setup_of(source: str, joint: str | None, *frames: str | None) -> DynamicsSetup | None:
    """Return what the table [dynamics] of a scene file says; None of another source and of a scene without it."""
    return load_setup(source) if _is_scene(source, joint, *frames) else None


def _is_scene(source: str, joint: str | None, *frames: str | None) -> bool:
    """Return whether the source alone is named, and is a scene file."""
    return joint is None and not any(frames) and os.path.isfile(source) and not is_urdf(source)


def _with_left_out(kind: str, text: str, setup: DynamicsSetup, written: set[str]) -> str:
    """Return the text with a comment on the keys of [dynamics] that it does not hold, and warn of them."""
    keys = [key for key in setup.keys if key not in {*written, "tol", "breaks"}]
    if not keys:
        return text
    shown = ", ".join(f'base = "{setup.base}"' if key == "base" else key for key in keys)
    sentence = f"{kind} has no place for these keys of [dynamics], which are left out: {shown}"
    warnings.warn(sentence, DynamicsWarning, stacklevel=2)
    return commented(text, sentence)


def _in_space(pair: HingePair | PlanarPair) -> HingePair:
    return pair if isinstance(pair, HingePair) else pair.to_spatial()


def _given(source: str, joint: str | None) -> str:
    if joint is None:
        hinges = read_urdf(source if is_urdf(source) else robot_urdf(source)).hinges()
        raise ArgumentError("JOINT", f"a hinge of {source}: {choices([hinge.name for hinge in hinges])}", "none")
    return joint
