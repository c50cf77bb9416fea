"""The mechanism: a whole robot, a tree of hinges and sliders."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism import building
from hingepair.mechanism.methods import MechanismMethods
from hingepair.mechanism.slider import Slider
from hingepair.mechanism.tree import Tree
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.numeric.tables import Sheet, align_columns, cell_text
from hingepair.pair.body import Body
from hingepair.pair.hinge_pair import HingePair
from hingepair.urdf import records

# Headings of the printed table of joints.
_JOINT_TABLE_HEADINGS = (
    "joint",
    "kind",
    "carried by",
    "axis (joint axes)",
    "least",
    "greatest",
    "rate",
    "effort",
    "mass [kg]",
    "follows",
)


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Mechanism(MechanismMethods):
    """A robot: a tree of hinges and sliders on a base that is fixed, moves as given, or is free.

    A body is a group of links that fixed or locked joints hold together. The coordinates q are in the order of
    `names`: depth-first, siblings by the joint's name, as in Pinocchio; in rad for hinges, in m for sliders. The
    arguments q, qd, qdd and tau are an array of shape (..., dof), a table whose columns have the joints' names, or a
    dict with a number or an array for each joint; a plain number is the same at every sample. The argument
    `base_motion` is the pose and the motion of the base. By default the base rests at the origin; given position and
    attitude alone, it rests there. Vectors are in world axes, accelerations are classical.

    Args:
        pairs: HingePairs and Sliders, each named for its joint. Body 2 of a pair is the link of the pair's name, with
            the frame (R2, S2); body 1 of the first pair is the link "base". A body that two pairs share is given in
            one of them, or equally in both.
        parents: for each pair, the number of its body 1: 0 for the base, j (from 1 on) for body 2 of the j-th pair.
            By default, body 1 of each pair is body 2 of the pair before.
        base: "fixed": the base rests, or moves as `base_motion` says; "free": forces move the base.
        name: name of the robot.

    Raises:
        ArgumentError: the pairs are no tree, or do not stand in the order of q, which the message names.

    >>> import hingepair as hp
    >>> upper = hp.HingePair(u1=(0, 0, 1), u2=(0, 0, 0), n=(0, 1, 0), name="upper")
    >>> lower = hp.HingePair(u1=(0.4, 0, 0), u2=(-0.5, 0, 0), n=(0, 1, 0), name="lower")
    >>> robot = hp.Mechanism([upper, lower], name="arm")
    >>> robot.names, robot.dof, robot.links
    (('upper', 'lower'), 2, ('base', 'upper', 'lower'))
    >>> robot.forward_kinematics((0, 0))["lower"].R.tolist()
    [0.9, 0.0, 1.0]
    """

    tree: Tree
    base: str

    def __init__(
        self,
        pairs: Iterable[HingePair | Slider],
        parents: Sequence[int] | None = None,
        base: str = "fixed",
        name: str | None = None,
    ) -> None:
        self._set(building.tree_of_pairs(pairs, parents, base, name), base)

    def _set(self, tree: Tree, base: str) -> None:
        object.__setattr__(self, "tree", tree)
        object.__setattr__(self, "base", base)

    @classmethod
    def from_urdf(
        cls,
        path_or_text: str | os.PathLike[str],
        base: str = "fixed",
        locked: Mapping[str, float] | None = None,
        snap: float | None = None,
    ) -> Mechanism:
        """Read a robot from URDF, and return it as a Mechanism.

        Revolute and continuous joints are hinges, prismatic ones sliders; fixed joints are folded into the links that
        carry them, masses included; a mimic joint follows its leader. Masses are used as they are written, even those
        that no rigid body can have; a `DynamicsWarning` names these when forces or accelerations are computed.

        Args:
            path_or_text: a file's path, or the URDF itself (text that starts with "<").
            base: "fixed" or "free"; the base is the root link.
            locked: positions [rad or m] at which joints are held, by name, such as {"panda_finger_joint1": 0.02};
                joints that follow them are held too. A position beyond the joint's limits is used, with a
                `DynamicsWarning`.
            snap: angles of origins (rpy) that are within `snap` [rad] of a multiple of pi/2 become that multiple;
                for example 1e-6. Unless given, only the double nearest to a multiple of pi/2 is that turn exactly.

        Raises:
            URDFError: no readable URDF, links and joints that are no tree, a joint that is planar or floating, a
                number that is none; names the joint or the link.
            ArgumentError: base, locked or snap cannot be used.

        >>> import hingepair as hp
        >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(0, 0, 0), n=(0, 1, 0))
        >>> hp.Mechanism.from_urdf(hp.to_urdf(pair)).names
        ('hinge',)
        """
        return _new_mechanism(cls, building.tree_of_urdf(path_or_text, base, locked, snap), base)

    @classmethod
    def from_pinocchio(
        cls, model: Any, base: str | None = None, locked: Mapping[str, float] | None = None
    ) -> Mechanism:
        """Return the robot of a Pinocchio model as a Mechanism, for example one that Pinocchio has read from MJCF.

        Inertias of rotors (`model.armature`) count as they do in Pinocchio: in forces, the mass matrix, forward
        dynamics and kinetic energy (where Pinocchio 4.1 leaves out those of oblique hinges). As in Pinocchio's own
        algorithms, `rotorInertia` and `rotorGearRatio` count only where they are part of `armature`, and damping and
        dry friction nowhere. Limits are the upper ones of effort and velocity; reference configurations and margins
        of limits are not used. Gravity is an argument of the methods; a DynamicsWarning reports a model whose gravity
        differs from their default.

        Args:
            model: a Pinocchio model with revolute, continuous, prismatic, mimic and composite joints, depth-first;
                at its root there may be a free-flyer. Its q is that of the robot where nq is nv: a continuous joint
                has cos and sin in Pinocchio's q.
            base: "fixed" or "free"; unless given, free where the model has a free-flyer.
            locked: as for `from_urdf`.

        Raises:
            ArgumentError: a joint of another kind, or not depth-first, or with an armature that is negative, not
                finite or that of the free base; the error names it.

        >>> import pinocchio
        >>> import hingepair as hp
        >>> hp.Mechanism.from_pinocchio(pinocchio.buildSampleModelManipulator()).dof
        6
        """
        return _new_mechanism(cls, *building.tree_of_pinocchio(model, base, locked))

    # ---- properties

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.tree.name

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints with a coordinate, in the order of q; mimic joints have none."""
        return tuple(joint.name for joint in self.tree.coordinates)

    @property
    def dof(self) -> int:
        """Number of coordinates."""
        return len(self.tree.coordinates)

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links, the base first, each after the link that carries it."""
        return tuple(self.tree.links)

    @property
    def tips(self) -> tuple[str, ...]:
        """Names of the last links of all branches, whose motion is computed by default."""
        return self.tree.tips

    @property
    def position_limits(self) -> Float64Array:
        """Lower and upper limits of q [rad or m], infinite where there is none; shape (dof, 2)."""
        return self._limits("position_limits", 2)

    @property
    def rate_limits(self) -> Float64Array:
        """Largest rates [rad/s or m/s], infinite where there is none; shape (dof,)."""
        return self._limits("rate_limit")

    @property
    def effort_limits(self) -> Float64Array:
        """Largest torques [N m] and forces [N] of the motors, infinite where there is none; shape (dof,)."""
        return self._limits("effort_limit")

    @property
    def armature(self) -> Float64Array:
        """Inertias of the motors' rotors, which add to the diagonal of the mass matrix; shape (dof,).

        The unit is kg m^2 for hinges and kg for sliders, referred to the coordinate by the square of the gear ratio.
        They are 0 unless a Pinocchio model has them.
        """
        sums = dict.fromkeys((joint.name for joint in self.tree.coordinates), 0.0)
        for joint in self.tree.joints:
            leader, ratio = joint.name, 1.0
            if joint.mimic is not None:
                leader, ratio = self.tree.joints[joint.mimic.leader - 1].name, joint.mimic.multiplier
            sums[leader] += joint.armature * ratio * ratio
        return read_only(np.array([*sums.values()], dtype=np.float64))

    def _limits(self, field: str, *tail: int) -> Float64Array:
        values = [getattr(joint, field) for joint in self.tree.coordinates]
        return read_only(np.array(values, dtype=np.float64).reshape(self.dof, *tail))

    def __getitem__(self, joint: str) -> HingePair | Slider:
        """Return a moving joint as a pair between the frames of the two bodies that it connects.

        A body's frame is that of the link behind its joint; its mass properties are in the pair where a rigid body
        can have them. A pair has no armature.

        Raises:
            ArgumentError: no such joint; lists those that move.
        """
        for candidate in self.tree.joints:
            if candidate.name == joint:
                return building.pair_of(self.tree, candidate)
        names = [candidate.name for candidate in self.tree.joints]
        expected = choices(names) + nearest(str(joint), names) if names else "no joint, since none moves"
        raise ArgumentError("joint", expected, quoted(joint))

    def __iter__(self) -> Any:
        raise TypeError("a Mechanism is no sequence of joints; robot.names are their names")

    # ---- extended copies

    def with_payload(self, link: str, body: Body) -> Mechanism:
        """Return a copy of the robot with a further body fixed to a link.

        Args:
            link: name of a link, a joint or another frame, whose origin and axes are the body's reference point and
                axes.
            body: mass properties and shapes of the body.

        Raises:
            ArgumentError: no such link, or no Body.

        >>> import hingepair as hp
        >>> ball = hp.Body(2, inertia=(1, 1, 1))
        >>> hand = hp.HingePair(u1=(0, 0, 1), u2=(0, 0, 0), n=(0, 1, 0), name="hand", body2=ball)
        >>> hp.Mechanism([hand]).with_payload("hand", hp.Body(3, inertia=(1, 1, 1)))["hand"].body2.mass
        5.0
        """
        return _new_mechanism(type(self), building.add_payload(self.tree, self.base, link, body), self.base)

    def with_frame(
        self, name: str, link: str, R: ArrayLike = (0.0, 0.0, 0.0), S: ArrayLike | None = None
    ) -> Mechanism:
        """Return a copy of the robot with a further frame, for example that of a tool.

        Args:
            name: name of the new frame, which no link, joint or frame has yet.
            link: name of the link, the joint or the other frame to which the new frame is fixed.
            R: origin of the new frame from that of `link`, in the axes of `link` [m]; shape (3,).
            S: rotation from the axes of the new frame to those of `link`; identity unless given; shape (3, 3).

        Raises:
            ArgumentError: no such link, a name that is taken, or R or S that cannot be used.

        >>> import hingepair as hp
        >>> hand = hp.HingePair(u1=(0, 0, 1), u2=(0, 0, 0), n=(0, 1, 0), name="hand")
        >>> robot = hp.Mechanism([hand]).with_frame("tool", link="hand", R=(0, 0, 0.5))
        >>> robot.forward_kinematics((0,), frames="tool")["tool"].R.tolist()
        [0.0, 0.0, 1.5]
        """
        frame = self.tree.known_frame("link", link)
        return _new_mechanism(type(self), building.add_frame(self.tree, name, frame, R, S), self.base)

    def __reduce__(self) -> tuple[Any, ...]:
        return _new_mechanism, (type(self), self.tree, self.base)

    def __repr__(self) -> str:
        return f"Mechanism({self.name!r}, dof={self.dof}, links={len(self.links)}, base={self.base!r})"

    def __str__(self) -> str:
        title, rows, notes = self._sheet()
        return "\n".join((title, *align_columns(rows, {4, 5, 6, 7, 8, 10}), *notes))

    def _sheet(self) -> Sheet:
        """Return the printed table of the moving joints: title, rows and notes; robots with rotors have a column of
        armatures.
        """
        joints = self.tree.joints
        geared = any(joint.armature for joint in joints)
        rows: list[tuple[str, ...]] = [(*_JOINT_TABLE_HEADINGS, "armature") if geared else _JOINT_TABLE_HEADINGS]
        for joint in joints:
            rule = joint.mimic
            follows = "" if rule is None else str(records.MimicRecord(joints[rule.leader - 1].name, *rule[1:]))
            carrier = "base" if joint.parent == 0 else joints[joint.parent - 1].name
            limits = (*joint.position_limits, joint.rate_limit, joint.effort_limit)
            shown = ("" if np.isinf(limit) else cell_text(limit) for limit in limits)
            axis = " ".join(f"{round(component, 3) + 0.0:g}" for component in joint.n.tolist())
            rotor = (cell_text(joint.armature),) if geared else ()
            rows.append((joint.name, joint.kind, carrier, axis, *shown, cell_text(joint.body.mass), follows, *rotor))
        title = f"{self.name}: {self.dof} degrees of freedom, {len(self.links)} links, {self.base} base"
        return Sheet(title, rows, self.tree.notes)


def _new_mechanism(mechanism_class: type[Mechanism], tree: Tree, base: str) -> Mechanism:
    """Return a robot with a given tree, without the checks of the constructor."""
    mechanism = object.__new__(mechanism_class)
    mechanism._set(tree, base)
    return mechanism
