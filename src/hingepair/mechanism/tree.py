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

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.equations.joints import Axis
from hingepair.errors import ArgumentError, ShapeError, choices, nearest, quoted
from hingepair.mechanism.kinds import KINDS, JointKind
from hingepair.mechanism.samples import Samples
from hingepair.mechanism.shapes import BodyDrawing
from hingepair.numeric.arrays import Frozen, read_only
from hingepair.pair.hinge_load import HingeLoad

NO_LOAD = HingeLoad()


class Mimic(NamedTuple):
    """Rule of a joint that follows another joint, its leader: q = multiplier * (q of the leader) + offset. `leader`
    is the number of a joint, from 1 on.

    Attributes:
        leader: number of the leading joint, from 1 on; it follows no joint itself, and may come later.
        multiplier: ratio of the joint's rate to the leader's.
        offset: q of the joint at q = 0 of the leader [rad or m].
    """

    leader: int
    multiplier: float
    offset: float


@dataclass(frozen=True, slots=True, eq=False)
class MassProperties(Frozen):
    """Mass, centre of mass and inertia of one body as they were given. Values that no rigid body can have are not
    changed.

    Attributes:
        mass: [kg].
        centre_of_mass: from the body's reference point, its own axes [m]; shape (3,). Zero where the mass is 0.
        inertia: about the centre of mass, own axes [kg m^2]; shape (3, 3), symmetric. Where the mass is 0: the sum of
            the inertias, about the reference point.
    """

    mass: float
    centre_of_mass: NDArray[np.float64]
    inertia: NDArray[np.float64]


# Mass properties of a body without mass.
ZERO_MASS_PROPERTIES = MassProperties(0.0, read_only(np.zeros(3)), read_only(np.zeros((3, 3))))


@dataclass(frozen=True, slots=True, eq=False)
class Joint(Frozen):
    """Record of a joint that moves: name, kind, number of the body that carries it (`parent`), point u, attitude S,
    axis n, MassProperties of the body that it moves (`body`), limits, armature of its motor, load, and a Mimic rule
    or None.

    Attributes:
        name: name of the joint.
        kind: a continuous joint is a hinge without limits.
        parent: number of the body that carries the joint; 0 is the base.
        u: the joint's point in the parent body's axes, from the parent's reference point [m]; shape (3,).
        S: attitude of the joint's body at q = 0 in the parent body's axes; shape (3, 3).
        n: the joint's unit axis, in the axes of its body; shape (3,).
        body: mass properties of the joint's body.
        position_limits: lower and upper limit of q [rad or m]; infinite where there is none.
        rate_limit: largest rate [rad/s or m/s]; infinite where there is none.
        effort_limit: largest torque or force of its motor [N m or N]; infinite where there is none.
        armature: inertia of its motor's rotor, referred to the joint by the square of the gear ratio [kg m^2 or kg].
        load: spring, damper and dry friction as they are written; a slider's in N/m, N s/m and N.
        mimic: rule of a joint that follows another; None for a joint with a coordinate of its own.
    """

    name: str
    kind: JointKind
    parent: int
    u: NDArray[np.float64]
    S: NDArray[np.float64]
    n: NDArray[np.float64]
    body: MassProperties
    position_limits: tuple[float, float] = (-np.inf, np.inf)
    rate_limit: float = np.inf
    effort_limit: float = np.inf
    armature: float = 0.0
    load: HingeLoad = NO_LOAD
    mimic: Mimic | None = None
    pitch: float = 0.0  # displacement for one radian of a joint that also turns [m/rad]

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
    def reach(self) -> float:
        """Largest displacement along the axis within the limits [m]; 0 where there are none."""
        largest = float(np.abs(self.position_limits).max())
        return abs(self.axis.shift(largest)) if np.isfinite(largest) else 0.0


LOAD_FIELDS = ("stiffness", "rest", "damping", "friction")
"""What files say of the load of a joint: fields of its HingeLoad."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame(Frozen):
    """A frame that is fixed in a body of a robot: the number of the body, and the position R and the rotation S of
    the frame in the axes of the body. Links, joints and further frames of the robot have such a record.

    Attributes:
        body: number of the body; 0 is the base.
        R: the frame's origin from the body's reference point, in the body's axes [m]; shape (3,).
        S: rotation from the frame's axes to the body's axes; shape (3, 3).
        samples: origins that differ from sample to sample, in place of R; (..., 3). None for one origin.
    """

    body: int
    R: NDArray[np.float64]
    S: NDArray[np.float64]
    samples: NDArray[np.float64] | None = None

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
class Tree(Frozen):
    """Record of a robot as a tree: a tuple of its moving `joints`, the MassProperties of the `base`, dicts of Frames
    by name (`links`, and further `frames`), the names of the last links (`tips`), notes on masses, and drawings of
    the bodies. Bodies that fixed and locked joints connect are merged.

    Attributes:
        name: name of the robot.
        joints: joints that move, mimic joints included, in the order of the module's docstring.
        base: mass properties of the base; on a fixed base they count nowhere.
        links: frames of the links by name, the root link first and each link after its parent.
        frames: further frames by name: fixed and locked joints (the child link's frame) and those that users added.
            A joint that moves is not among them: its frame is that of its body.
        tips: the links whose frames are computed unless others are named: those that carry no further link, on bodies
            that carry no further joint, in the order of `links`; at least one.
        notes: what a DynamicsWarning says at the first call of dynamics: masses that are assumed, and masses that no
            rigid body can have; whole sentences that name the link.
        drawings: what each body is drawn by, the base first.
        source: what the robot was read from, as long as it describes the links and masses of the robot.
    """

    name: str
    joints: tuple[Joint, ...]
    base: MassProperties
    links: Mapping[str, Frame]
    frames: Mapping[str, Frame]
    tips: tuple[str, ...]
    notes: tuple[str, ...] = ()
    drawings: tuple[BodyDrawing, ...] = ()
    source: Source | None = None
    without_mass: Mapping[int, str] = field(default_factory=dict)
    """Links whose mass was never given, by the number of the body."""
    samples: Samples | None = None
    """What differs from sample to sample beside all this; None for one robot."""
    leaves: tuple[str, ...] = ()
    """Names of all links that carry no further link, tips among them."""

    def single(self) -> Tree:
        """Return this tree, for what takes one robot.

        Raises:
            ShapeError: masses or lengths differ from sample to sample.
        """
        if self.samples is not None:
            expected = "one robot, with payloads and lengths that are the same for all samples"
            raise ShapeError("robot", expected, f"samples of shape {self.samples.shape}")
        return self

    @property
    def coordinates(self) -> tuple[Joint, ...]:
        """A tuple of the joints with a coordinate of their own, in the order of q; mimic joints have none."""
        return tuple(joint for joint in self.joints if joint.mimic is None)

    @property
    def frame_names(self) -> tuple[str, ...]:
        """A tuple of the names of all frames: links, further frames, joints."""
        return tuple(dict.fromkeys((*self.links, *self.frames, *(joint.name for joint in self.joints))))

    def frame(self, name: str) -> Frame | None:
        """Return the Frame of a link, a further frame or a joint by its name, searched in this order; return None if
        there is no such frame.
        """
        named_frame = self.links.get(name) or self.frames.get(name)
        if named_frame is not None:
            return named_frame
        for number, joint in enumerate(self.joints, 1):
            if joint.name == name:
                return Frame(number, read_only(np.zeros(3)), read_only(np.eye(3)))
        return None

    def body_frames(self, with_base: bool) -> tuple[Frame, ...]:
        """Return the frames of the bodies themselves, the base first if it is asked for."""
        numbers = range(0 if with_base else 1, len(self.joints) + 1)
        return tuple(Frame(number, read_only(np.zeros(3)), read_only(np.eye(3))) for number in numbers)

    def known_frame(self, argument: str, name: object) -> Frame:
        """Return the Frame with the given name. Raise an ArgumentError for the argument named `argument` if there is
        no such frame.

        Raises:
            ArgumentError: there is none.
        """
        frame = self.frame(name) if isinstance(name, str) else None
        if frame is None:
            frame_names = self.frame_names
            raise ArgumentError(argument, choices(frame_names) + nearest(str(name), frame_names), quoted(name))
        return frame


def loads_note(tree: Tree) -> str:
    """Return which loads of joints dynamics leave out unless they are asked for, or "" if there are none."""
    parts = {"springs": "stiffness", "damping": "damping", "dry friction": "friction"}
    found = [part for part, field in parts.items() if any(getattr(joint.load, field) for joint in tree.joints)]
    count = sum(any(getattr(joint.load, field) for field in parts.values()) for joint in tree.joints)
    listed = " and ".join((", ".join(found[:-1]), *found[-1:]) if len(found) > 1 else found)
    return f"left out are {listed} of {count} joint{'s' * (count > 1)}" if found else ""
