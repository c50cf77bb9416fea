"""`hingepair urdf` and `hingepair mjcf`: pairs and robots as files of other programs."""

from __future__ import annotations

import contextlib
import sys
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import numpy as np
import typer

from hingepair.cli.output import out_option, write_text
from hingepair.cli.sources import Body1FrameOption, Body2FrameOption, JointArgument, Source
from hingepair.errors import ArgumentError, HingePairError
from hingepair.formats.model_writers import to_mjcf, to_urdf
from hingepair.formats.xml_text import commented
from hingepair.mechanism.bodies.body import DynamicsWarning
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PLANAR_GRAVITY, PlanarPair
from hingepair.scenes.motions.dynamics import PRESCRIBED

if TYPE_CHECKING:
    from hingepair.scenes.motions.dynamics import Dynamics

ExportedArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="Scene file (TOML), which needs no motion; or a robot's name or a URDF file, whole or with JOINT.",
    ),
]
TextFileOption = Annotated[Path | None, out_option("Write to FILE instead of standard output.")]
MeshesOption = Annotated[
    bool, typer.Option("--meshes/--no-meshes", help="Whether the meshes of a whole robot are written.")
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


def urdf_command(
    source: ExportedArgument,
    joint: JointArgument = None,
    body1_frame: Body1FrameOption = None,
    body2_frame: Body2FrameOption = None,
    out: TextFileOption = None,
    fixed_base: FixedBaseOption = False,
    floating_base: Annotated[
        bool, typer.Option("--floating-base", help="Connect body 1 to a link `world` by a floating joint.")
    ] = False,
    meshes: MeshesOption = True,
) -> None:
    """Write a pair, or the mechanism of a scene, as a URDF file.

    A robot or URDF file without JOINT is written whole. By default the base is free, and the program that loads the
    file must add a root joint. Of a scene with [dynamics] the base, damping, friction and stops are written as well;
    a comment and a warning list the keys that URDF cannot express.
    """
    if fixed_base and floating_base:
        raise HingePairError("--fixed-base and --floating-base exclude each other; give one of them")
    named = Source(source, joint, body1_frame, body2_frame)
    named.print_suspicions()
    requested_base = "fixed" if fixed_base else "floating" if floating_base else None
    robot = _whole_robot(named)
    if robot is not None:
        return write_text(to_urdf(robot, base=requested_base or "free", meshes=meshes), out, named.files)
    pair = named.spatial_pair()
    setup = named.dynamics()
    if setup is None:
        return write_text(to_urdf(pair, base=requested_base or "free"), out, named.files)
    base = requested_base or ("fixed" if setup.base in {"fixed", PRESCRIBED} else "free")
    load = _load_of(setup, ("damping", "friction", "stops"))
    text = to_urdf(pair, base=base, hinge_torque=load, body1=setup.start if base == "fixed" else None)
    written = {"damping", "friction", "stops", *(_START_POSE if base == "fixed" else ())}
    written |= {"base"} if requested_base or setup.base in {"free", "fixed"} else set()
    return write_text(_add_omission_comment("URDF", text, setup, written), out, named.files)


def mjcf_command(
    source: ExportedArgument,
    joint: JointArgument = None,
    body1_frame: Body1FrameOption = None,
    body2_frame: Body2FrameOption = None,
    out: TextFileOption = None,
    fixed_base: FixedBaseOption = False,
    free_base: Annotated[bool, typer.Option("--free-base", help="Give body 1 a free joint.")] = False,
    gravity: GravityOption = None,
    meshes: MeshesOption = True,
) -> None:
    """Write a pair, or the mechanism of a scene, as a MuJoCo model (MJCF).

    A robot or URDF file without JOINT is written whole. Of a scene with [dynamics] the base, the pose of body 1 at
    the start, gravity, spring, damping, friction and stops are written; a comment and a warning list the keys that
    MJCF cannot express. Otherwise body 1 has a free joint if it has a mass, and is fixed in the world if it has none.
    """
    if fixed_base and free_base:
        raise HingePairError("--fixed-base and --free-base exclude each other; give one of them")
    named = Source(source, joint, body1_frame, body2_frame)
    named.print_suspicions()
    robot = _whole_robot(named)
    if robot is not None:
        chosen = "fixed" if fixed_base else "free" if free_base else None
        fall = DEFAULT_GRAVITY if gravity is None else parse_gravity(gravity, 3)
        return write_text(to_mjcf(robot, base=chosen, gravity=fall, meshes=meshes), out, named.files)
    pair, setup = named.pair(), named.dynamics()
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
        vector = PLANAR_GRAVITY if isinstance(pair, PlanarPair) else DEFAULT_GRAVITY
        if setup is not None and "gravity" in setup.keys:
            vector = setup.gravity[: len(pair.u1)]
        else:
            assumed.append(f"gravity is ({', '.join(f'{component:g}' for component in vector)}) m/s^2")
    hinge_keys = ("stiffness", "rest", "damping", "friction", "stops")
    text = to_mjcf(
        pair if isinstance(pair, HingePair) else pair.to_spatial(),
        base=base,
        hinge_torque=_load_of(setup, hinge_keys),
        body1=None if setup is None else setup.start,
        gravity=(*vector, 0.0)[:3],
    )
    if assumed:
        print(f"hingepair: assumed: {'; '.join(assumed)}", file=sys.stderr)
    if setup is not None:
        written = {*hinge_keys, "gravity", *_START_POSE}
        written |= {"base"} if fixed_base or free_base or setup.base != PRESCRIBED else set()
        text = _add_omission_comment("MJCF", text, setup, written)
    return write_text(text, out, named.files)


def _whole_robot(named: Source) -> Mechanism | None:
    """Return the robot of a scene, or that named without a hinge; None for a pair."""
    if named.is_scene:
        return named.scene_file.mechanism
    return named.robot() if named.is_whole else None


def parse_gravity(text: str, num_components: int) -> tuple[float, ...]:
    """Return the `num_components` finite numbers in the value of --gravity, X,Y,Z or X,Y."""
    with contextlib.suppress(ValueError):
        vector = tuple(map(float, text.split(",")))
        if len(vector) == num_components and np.isfinite(vector).all():
            return vector
    expected = "three finite numbers X,Y,Z" if num_components == 3 else "two finite numbers X,Y for a planar pair"
    raise ArgumentError("--gravity", expected, repr(text))


def _load_of(setup: Dynamics | None, keys: tuple[str, ...]) -> HingeLoad:
    """Return the load of the hinge as far as these fields go."""
    load = HingeLoad() if setup is None else setup.loads.get("psi", HingeLoad())
    return HingeLoad(**{key: getattr(load, key) for key in keys})


_START_POSE: Final = ("R1_0", "S1_0", "phi_0")
"""Keys of the table [dynamics] for the pose of body 1 at the start."""


def _add_omission_comment(file_format: str, text: str, setup: Dynamics, written_keys: set[str]) -> str:
    """Return a model with a comment on the keys of [dynamics] that are not in `written_keys`, but for those of the
    simulation alone (tol, until, ...); emit the same sentence as a DynamicsWarning.
    """
    known = {*written_keys, "tol", "breaks", "max_steps", "until"}
    keys = [key for key in setup.keys if key.removeprefix("psi.") not in known]
    if not keys:
        return text
    shown = ", ".join(f'base = "{setup.base}"' if key == "base" else key for key in keys)
    sentence = f"{file_format} cannot express these keys of [dynamics], which are left out: {shown}"
    warnings.warn(sentence, DynamicsWarning, stacklevel=2)
    return commented(text, sentence)
