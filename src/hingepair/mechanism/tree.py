"""The record of a robot that readers make and `Mechanism` computes with: a tree of bodies and joints that move.

A body is everything that moves together: links joined by fixed or locked joints are one body. Body 0 is the base,
body k >= 1 is what joint k moves; `Tree.joints[k - 1]` is joint k. Joints stand depth-first, siblings by the joint's
name, as in Pinocchio, so that a parent stands before its children.

The reference point of body k >= 1 is the point of joint k (the origin of the child link in URDF), and its axes are
those of the child link. In the axes of the parent, its reference point and axes are

    hinge:   R = u,            attitude S Sh(n, q)        (E5, E6 with u2 = 0: S Sh(n, q) = Sh(S n, q) S)
    slider:  R = u + S n q,    attitude S

with n the joint's axis in the body's own axes, of unit length. The base has the axes of the root link.

Numbers are trusted: whoever makes a record has checked them. Entries that are 0, 1 or -1 exactly fold away in every
program, so that an entry which should be one of them must be it to the last bit.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.equations.joints import Axis
from hingepair.errors import ArgumentError, ShapeError, choices, nearest, quoted
from hingepair.mechanism.bodies.body import Body
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.bodies.shapes import Drawing
from hingepair.mechanism.kinds import KINDS, JointKind
from hingepair.mechanism.robots.samples import Samples
from hingepair.numeric.arrays import Float64Array, Frozen, check_choice, read_only
from hingepair.plans.arguments import CoordinateNames, Coordinates, read_coordinates
from hingepair.plans.closures import Closure
from hingepair.plans.struts import Law
from hingepair.urdf.records import MimicRecord
from hingepair.urdf.rigid import ZERO_MASS_PROPERTIES, FramePose, MassProperties

BASE_KINDS = ("fixed", "free")
"""Accepted values of the argument `base`."""
NO_LOAD = HingeLoad()


@dataclass(frozen=True, slots=True, eq=False)
class Joint(Frozen):
    """Record of a joint that moves."""

    name: str  # name of the joint
    kind: JointKind  # a continuous joint is a hinge without limits; only readers make fixed ones, which `fold` merges
    parent: int  # number of the body that carries the joint; 0 is the base
    # the joint's point in the parent body's axes, from the parent's reference point [m]; shape (3,)
    u: NDArray[np.float64]
    S: NDArray[np.float64]  # attitude of the joint's body at q = 0 in the parent body's axes; shape (3, 3)
    n: NDArray[np.float64]  # the joint's unit axis, in the axes of its body; shape (3,)
    body: MassProperties  # mass properties of the joint's body
    # lower and upper limit of q [rad or m]; infinite where there is none
    position_limits: tuple[float, float] = (-np.inf, np.inf)
    rate_limit: float = np.inf  # largest rate [rad/s or m/s]; infinite where there is none
    effort_limit: float = np.inf  # largest torque or force of its motor [N m or N]; infinite where there is none
    effort_range: tuple[float, float] | None = None  # bounds that are not -effort_limit and effort_limit
    # inertia of its motor's rotor, referred to the joint by the square of the gear ratio [kg m^2 or kg]
    armature: float = 0.0
    ratio: float = 1.0  # turns of its motor for one of the joint, as files write it; `with_motor` reads it
    load: HingeLoad = NO_LOAD  # spring, damper and dry friction as they are written; a slider's in N/m, N s/m and N
    # rule of a joint that follows another, which follows none itself and may come later; None for a joint with a
    # coordinate of its own
    mimic: MimicRecord | None = None
    pitch: float = 0.0  # displacement for one radian of a joint that also turns [m/rad]
    # whether Pinocchio has cosine and sine in q for a hinge without limits; it has not where URDF says "revolute"
    continuous: bool = True

    @property
    def rule(self) -> MimicRecord:
        """How the joint follows one with a coordinate: another, or itself."""
        return self.mimic or MimicRecord(self.name, 1.0, 0.0)

    @property
    def pose(self) -> FramePose:
        """Pose of the joint's body at q = 0, in the axes of the parent body."""
        return FramePose(self.S, self.u)

    @property
    def axis(self) -> Axis:
        """How far q turns the body about its axis, and shifts it along the axis."""
        return KINDS[self.kind].axis(self.pitch)

    @property
    def unit(self) -> str:
        """Unit of q."""
        return KINDS[self.kind].unit

    @property
    def effort_unit(self) -> str:
        """Unit of the torque or force along q."""
        return KINDS[self.kind].effort

    @property
    def effort_bounds(self) -> tuple[float, float]:
        """Least and greatest effort of its motor [N m or N]."""
        return self.effort_range or (-self.effort_limit, self.effort_limit)

    @property
    def reach(self) -> float:
        """Largest displacement along the axis within the limits [m]; 0 where there are none."""
        largest = float(np.abs(self.position_limits).max())
        return abs(self.axis.shift(largest)) if np.isfinite(largest) else 0.0


LOAD_FIELDS = ("stiffness", "rest", "damping", "friction")
"""What files say of the load of a joint: fields of its HingeLoad."""


def unphysical_reason(masses: MassProperties) -> str:
    """Return why no rigid body has these mass properties; "" if one has, or if all are 0."""
    if not masses.mass and not masses.inertia.any():
        return ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            Body(masses.mass, masses.centre_of_mass, masses.inertia)
    except ArgumentError as error:
        return str(error)
    return ""


def check_name(argument: str, name: object) -> None:
    """Refuse a name that is no text, is empty, or holds half a character (a surrogate), which no file can hold."""
    if not isinstance(name, str) or not name.strip() or any("\ud800" <= letter <= "\udfff" for letter in name):
        raise ArgumentError(argument, "a name, a text that is not empty", quoted(name))


def unused_name(name: str, taken: set[str]) -> str:
    """Return a name, with "_" behind it as often as it is in use, and add it to those in use."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name


@dataclass(frozen=True, slots=True, eq=False)
class Frame(Frozen):
    """A frame that is fixed in a body of a robot: of a link, of a joint, or a further one."""

    body: int  # number of the body; 0 is the base
    R: NDArray[np.float64]  # the frame's origin from the body's reference point, in the body's axes [m]; shape (3,)
    S: NDArray[np.float64]  # rotation from the frame's axes to the body's axes; shape (3, 3)
    # origins that differ from sample to sample, in place of R; (..., 3). None for one origin
    samples: NDArray[np.float64] | None = None

    @property
    def pose(self) -> FramePose:
        """Pose in the axes of the body."""
        return FramePose(self.S, self.R)

    @property
    def origin(self) -> NDArray[np.float64]:
        """Origin of the frame, with leading axes where it differs from sample to sample."""
        return self.R if self.samples is None else self.samples


class Source(NamedTuple):
    """Text of a URDF, and how it was read."""

    text: str | bytes
    locked: Mapping[str, float]  # positions of joints that are held [rad or m]
    snap: float  # tolerance of angles [rad]


@dataclass(frozen=True, slots=True, eq=False)
class TreeStrut(Frozen):
    """A strut between two frames."""

    name: str
    ends: tuple[str, str]  # names of its frames
    frames: tuple[Frame, Frame]
    law: Law  # numbers of its force
    limits: tuple[float, float] = (-np.inf, np.inf)  # least and greatest length [m]
    # further force [N] of arrays length [m] and rate [m/s], which no program contains
    function: Callable[[Any, Any], Any] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TreeClosure(Frozen):
    """Loops of a closed mechanism, as programs close them."""

    loops: tuple[Any, ...]  # the Loops as they were given
    form: Closure  # their structure
    frames: tuple[tuple[Frame, Frame], ...]  # the two frames of each, z along the axis of a hinge
    size: float  # of the mechanism [m], by which a gap is judged
    starts: tuple[float, ...]  # numbers of the starts of all chains
    names: tuple[str, ...]  # of the coordinates: joints, and struts whose length is a coordinate
    assembled: Mapping[str, float]  # coordinates of the tree at which the mechanism was assembled
    redundant: int  # number of conditions that say nothing new
    sliding: tuple[int, ...] = ()  # columns of the tree's coordinates that are lengths


@dataclass(frozen=True, slots=True, eq=False)
class Tree(Frozen):
    """Record of a robot: a tree of joints that move. Bodies that fixed and locked joints connect are merged."""

    name: str  # name of the robot
    joints: tuple[Joint, ...]  # joints that move, mimic joints included, in the order of the module's docstring
    base: MassProperties  # mass properties of the base; on a fixed base they count nowhere
    links: Mapping[str, Frame]  # frames of the links by name, the root link first and each link after its parent
    # further frames by name: fixed and locked joints (the child link's frame) and those that users added. A joint
    # that moves is not among them: its frame is that of its body
    frames: Mapping[str, Frame]
    leaves: tuple[str, ...]  # names of the links that carry no further link, in the order of `links`
    assumed: tuple[tuple[int, str], ...] = ()  # sentences about masses that are assumed, each with the body's number
    drawings: tuple[Drawing, ...] = ()  # what each body is drawn by, the base first
    # what the robot was read from, as long as it describes the links and masses of the robot
    source: Source | None = None
    without_mass: Mapping[int, str] = field(default_factory=dict)
    """Links whose mass was never given, by the number of the body."""
    samples: Samples | None = None
    """What differs from sample to sample beside all this; None for one robot."""
    closure: TreeClosure | None = None
    """Loops that are closed; None of a tree."""
    struts: tuple[TreeStrut, ...] = ()

    @property
    def bodies(self) -> tuple[MassProperties, ...]:
        """Mass properties of all bodies, the base first."""
        return (self.base, *(joint.body for joint in self.joints))

    @property
    def body_names(self) -> tuple[str, ...]:
        """Names of all bodies: of the link whose frame is the body's, else of the joint or the root link."""
        names = [next(iter(self.links)), *(joint.name for joint in self.joints)]
        for name, frame in reversed([*self.links.items()]):
            if not frame.R.any() and np.array_equal(frame.S, np.eye(3)):
                names[frame.body] = name
        return tuple(names)

    @property
    def tips(self) -> tuple[str, ...]:
        """The links whose frames are computed unless others are named: leaves on bodies that carry no joint."""
        carrying = {joint.parent for joint in self.joints}
        return tuple(leaf for leaf in self.leaves if self.links[leaf].body not in carrying)

    def mass_notes(self, free: bool) -> list[str]:
        """Return what a DynamicsWarning says at the first call of dynamics: which masses are assumed, and which no
        rigid body can have. The base counts only if it is free.
        """
        notes = [note for body, note in self.assumed if body or free]
        for k, (name, masses) in enumerate(zip(self.body_names, self.bodies, strict=True)):
            if (k or free) and (reason := unphysical_reason(masses)):
                notes.append(
                    f"no rigid body has the mass properties of {name!r}, which are used as written: {reason}"
                )
        return notes

    @property
    def has_functions(self) -> bool:
        """Whether the force of a strut is a function, which no program contains."""
        return any(strut.function is not None for strut in self.struts)

    def refuse_functions(self) -> None:
        """Refuse struts whose force is a function, where programs would have to call it."""
        for strut in self.struts:
            if strut.function is not None:
                expected = "struts whose force is a GasSpring, a spring or a table; this needs more than its values"
                raise ArgumentError("robot", expected, f"a function as the force of {strut.name!r}")

    def single(self) -> Tree:
        """Return this tree where it is one robot; refuse masses or lengths that differ from sample to sample."""
        if self.samples is not None:
            expected = "one robot, with payloads and lengths that are the same for all samples"
            raise ShapeError("robot", expected, f"samples of shape {self.samples.shape}")
        return self

    def has_sampled_axes(self, body: int) -> bool:
        """Return whether the axis of a body's joint differs from sample to sample."""
        joint = None if self.samples is None else self.samples.joints.get(body)
        return joint is not None and joint.n.ndim > 1

    def loops(self) -> TreeClosure:
        """Return the loops of a closed mechanism; refuse a tree."""
        if self.closure is None:
            raise ArgumentError("robot", "one with loops, as robot.closed(...) returns", "a tree")
        return self.closure

    def plain(self) -> Tree:
        """Return this tree where it is one robot without loops and struts; refuse all else."""
        if self.closure is not None or self.struts:
            parts = ("loops", self.closure is not None), ("struts", bool(self.struts))
            got = " and ".join(part for part, has in parts if has)
            raise ArgumentError("robot", "one without loops and struts, as it was before closed and with_strut", got)
        return self.single()

    @property
    def coordinates(self) -> tuple[Joint, ...]:
        """Joints whose coordinates are q, in its order; the length of a strut stands as a slider."""
        own = self.own_coordinates
        if self.closure is None:
            return own
        pairs = zip(self.closure.names, self.closure.form.columns, strict=True)
        struts = {strut.name: strut for strut in self.struts}
        return tuple(_length(struts[name]) if column is None else own[column] for name, column in pairs)

    @property
    def own_coordinates(self) -> tuple[Joint, ...]:
        """Joints that follow no other by a rule, those that loops close among them."""
        return tuple(joint for joint in self.joints if joint.mimic is None)

    @property
    def coordinate_names(self) -> CoordinateNames:
        """Names of the joints with a coordinate, and of those that follow them, for arguments and messages."""
        leaders = {one.name: one.mimic.leader for one in self.joints if one.mimic is not None}
        return CoordinateNames(tuple(one.name for one in self.coordinates), noun="joints", leaders=leaders)

    def column(self, argument: str, name: object) -> int:
        """Return the column in q of a joint, or refuse the argument that names it."""
        names = [joint.name for joint in self.coordinates]
        check_choice(argument, name, names)
        return names.index(str(name))

    def rows(self, name: str, value: Coordinates) -> Float64Array:
        """Return coordinates, or their derivatives or efforts, in any form as an array (..., dof)."""
        read, _ = read_coordinates(name, value, self.coordinate_names)
        return np.asarray(
            np.stack(np.broadcast_arrays(*read), axis=-1) if isinstance(read, tuple) else read, np.float64
        )

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of all frames: links, further frames, joints."""
        return tuple(dict.fromkeys((*self.links, *self.frames, *(joint.name for joint in self.joints))))

    def frame(self, name: str) -> Frame | None:
        """Return the frame of a link, a further frame or a joint, searched in this order; None if there is none."""
        named_frame = self.links.get(name) or self.frames.get(name)
        if named_frame is not None:
            return named_frame
        for number, joint in enumerate(self.joints, 1):
            if joint.name == name:
                return Frame(number, read_only(np.zeros(3)), read_only(np.eye(3)))
        return None

    def known_frame(self, argument: str, name: object) -> Frame:
        """Return the frame with a name, or refuse the argument."""
        frame = self.frame(name) if isinstance(name, str) else None
        if frame is None:
            frame_names = self.frame_names
            raise ArgumentError(argument, choices(frame_names) + nearest(str(name), frame_names), quoted(name))
        return frame


def _length(strut: TreeStrut) -> Joint:
    """Return the record of a length that is a coordinate."""
    zero, axis = read_only(np.zeros(3)), read_only(np.array([0.0, 0.0, 1.0]))
    return Joint(
        strut.name, "slider", 0, zero, read_only(np.eye(3)), axis, ZERO_MASS_PROPERTIES, position_limits=strut.limits
    )


def loads_note(tree: Tree) -> str:
    """Return which loads of joints dynamics leave out unless they are asked for, or "" if there are none."""
    parts = {"springs": "stiffness", "damping": "damping", "dry friction": "friction"}
    found = [part for part, field in parts.items() if any(getattr(joint.load, field) for joint in tree.joints)]
    count = sum(any(getattr(joint.load, field) for field in parts.values()) for joint in tree.joints)
    listed = " and ".join((", ".join(found[:-1]), *found[-1:]) if len(found) > 1 else found)
    return f"left out are {listed} of {count} joint{'s' * (count > 1)}" if found else ""
