"""The mechanism: a whole robot, a tree of hinges, sliders and screws."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism.bodies.body import Body
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.building import changes
from hingepair.mechanism.building.folding import fold
from hingepair.mechanism.building.mujoco_model import tree_of_mjcf
from hingepair.mechanism.building.pairs import tree_of_pairs
from hingepair.mechanism.building.pinocchio_model import tree_of_pinocchio
from hingepair.mechanism.building.urdf import tree_of_urdf
from hingepair.mechanism.joints import JointOfSeveral, RobotJoint
from hingepair.mechanism.linkages import Loop, close_tree
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.robots.inertial_parameters import (
    BaseParameters,
    find_base_parameters,
    inertial_parameters,
    tree_with_parameters,
)
from hingepair.mechanism.robots.methods import MechanismMethods
from hingepair.mechanism.robots.samples import read_payload
from hingepair.mechanism.struts import GasSpring, add_strut
from hingepair.mechanism.tree import BASE_KINDS, LOAD_FIELDS, NO_LOAD, Tree, loads_note
from hingepair.numeric.arrays import Float64Array, FloatArray, check_choice, one_constant, read_only, set_frozen
from hingepair.rotations.matrices import rotation_exp
from hingepair.tables.sheets import Sheet, align_columns, cell_text


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Mechanism(MechanismMethods):
    """A robot: a tree of hinges, sliders and screws on a base that rests, moves as prescribed, or is free.

    Links connected by fixed or locked joints form one rigid body. R1 is the base's reference point, the origin of the
    base link. Vectors are in world axes, and accelerations are classical. `robot["elbow"]` is a joint as a HingePair,
    a Slider or a Screw.

    The methods share these arguments:

    - q, qd, qdd, tau: coordinates [rad of hinges, m of sliders] in the order of `names` (depth-first, with the joints
      on a link sorted by name, as in Pinocchio), their time derivatives, and torques [N m] and forces [N]. Each is an
      array (..., dof); a tuple, or a dict by joint, of numbers, the same for all samples, and arrays that broadcast;
      or a table (such as a DataFrame) whose columns have the joints' names.
    - frames: names of links, joints or added frames. Results of a tuple have an axis of frames, also of a tuple of
      one; those of one name alone have none. By default `tips`, the last links of all branches, a tuple; Jacobians
      and accelerations of frames at qdd = 0 take the name of the only tip. A name that a joint and a link share means
      the link. The frame of a joint moves with its child link.
    - base_motion: pose and motion of the base, at rest if it has only R and S, and at the origin of the world unless
      given.
    - gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).
    - wrenches: further loads by link or other frame: pairs (force, torque), world axes, at its origin [N, N m]; shape
      (..., 3) each, or the number 0.
    - joint_loads: whether springs, dampers and dry friction of the joints (`robot.joint_loads`) act beside tau (T14).
      By default they do not, and the first call of a robot that has any says so in a DynamicsWarning.
    - out: array into which the result is written; of methods with several outputs, arrays by output name.
    - workers: number of threads; -1 for one thread per core.
    - backend: "numpy"; "compiled", machine code that the first call compiles (0.1 to 0.3 s; derivatives of twenty
      joints take seconds; milliseconds where it is on disk); or "auto", which compiles.

    Results are float32 if all arrays given are float32, else float64, which rollouts and inverse kinematics always
    are. The first computation that uses masses issues a DynamicsWarning if a mass or an inertia was not given or is
    physically impossible.

    Args:
        pairs: HingePairs, Sliders and Screws, one for each joint, in the order of q. The name of a pair is that of
            the joint, and of the link that is its body 2, whose frame has the origin R2; pairs without names get
            `hinge_pair_1`, `hinge_pair_2`, ... by their places. Body 1 of the first pair is the link "base". Of a
            body that two pairs share, one gives the mass properties, or both give equal ones. Geometry of pairs with
            leading axes broadcasts with q: each sample has its own robot. In place of a pair may stand any object
            with a method `in_series()`, which returns pairs in series: a joint of several coordinates, such as a ball
            joint, with bodies of no mass between the pairs.
        parents: for each pair, the number of its body 1: 0 for the base, 1 for body 2 of the first pair, and so on;
            a joint of several coordinates counts as one.
            By default, body 1 of each pair is body 2 of the pair before it.
        base: "fixed": the base rests, or moves as `base_motion` prescribes; "free": forces move it.
        name: name of the robot; by default "mechanism".

    Raises:
        ArgumentError: the pairs do not form a tree, or are not in the order of q, which the message then gives.

    >>> import hingepair as hp
    >>> upper = hp.HingePair(u1=(0, 0, 1), u2=(0, 0, 0), n=(0, 1, 0), name="upper")
    >>> lower = hp.HingePair(u1=(0.4, 0, 0), u2=(-0.5, 0, 0), n=(0, 1, 0), name="lower")
    >>> robot = hp.Mechanism([upper, lower], name="arm")
    >>> robot.names, robot.dof, robot.links
    (('upper', 'lower'), 2, ('base', 'upper', 'lower'))
    >>> robot.forward_kinematics((0, 0))["lower"].R.tolist()
    [0.9, 0.0, 1.0]
    """

    _tree: Tree
    base: str

    def __init__(
        self,
        pairs: Iterable[RobotJoint | JointOfSeveral] = (),
        parents: Sequence[int] | None = None,
        base: str = "fixed",
        name: str | None = None,
    ) -> None:
        set_frozen(self, _tree=tree_of_pairs(pairs, parents, base, name), base=base)

    @classmethod
    def from_urdf(
        cls,
        path_or_text: str | os.PathLike[str],
        base: str | None = None,
        locked: Mapping[str, float] | None = None,
        snap: float | None = None,
    ) -> Mechanism:
        """Read a robot from a URDF file or from URDF text.

        Revolute and continuous joints become hinges, and prismatic joints become sliders. A mimic joint has no
        coordinate in q: its position is computed from the joint that it follows. If that joint does not exist, the
        mimic joint moves by itself, and a DynamicsWarning says so. A link without <inertial> has no mass. Masses and
        inertias are used as they are written, even if no rigid body can have them; a DynamicsWarning names such
        bodies at the first computation that uses masses.

        Args:
            path_or_text: path of a file, or the URDF itself (text that starts with "<"). Limits whose lower and upper
                value are both 0 count as none, as many URDFs write them; other equal limits are kept.
            base: "fixed" or "free"; the base is the root link, or the child link of a floating root joint. By
                default, the base is free if the URDF has such a joint, whose origin and parent link are left out, and
                otherwise fixed.
            locked: positions [rad or m] at which joints are held, by name, as in {"panda_finger_joint1": 0.02}. Mimic
                joints that follow these joints are held too; a mimic joint is named only beside the joint that it
                follows. A position beyond the joint's limits is used, with a
                DynamicsWarning.
            snap: tolerance [rad], such as 1e-5; at most 0.1. If an rpy angle of an <origin> differs from a multiple
                of pi/2 by at most `snap`, it is replaced by that multiple, and its sine and cosine are exactly 0, 1
                or -1. By default, only an angle that is the floating-point number nearest to a multiple of pi/2 is
                replaced.

        Raises:
            URDFError: the URDF cannot be read or has macros (xacro), its links and joints do not form a tree, a joint
                is planar, or floating but not the only joint of the root link, or a value is not a number; the
                message names the joint or the link.

        >>> import hingepair as hp
        >>> beam = hp.Body(mass=2, shapes=[hp.Box((1, 0.2, 0.1))])
        >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(0, 0, 0), n=(0, 1, 0), body1=beam, body2=beam)
        >>> hp.Mechanism.from_urdf(hp.to_urdf(pair)).names
        ('hinge',)
        """
        return _new_mechanism(cls, *tree_of_urdf(path_or_text, base, locked, snap))

    @classmethod
    def from_pinocchio(
        cls, model: Any, base: str | None = None, locked: Mapping[str, float] | None = None
    ) -> Mechanism:
        """Return the robot of a Pinocchio model, such as a model that Pinocchio has read from MJCF.

        The inertias of the motors' rotors (`model.armature`) are included in forces, the mass matrix, forward
        dynamics and kinetic energy, as in Pinocchio. There is one difference: for a joint whose axis is not a
        coordinate axis, Pinocchio 4.1 omits the rotor from the kinetic energy; hingepair includes it. Position
        limits, limits of effort, upper limits of velocity, damping and dry friction are read. Not read are
        `rotorInertia` and `rotorGearRatio`, lower limits of velocity, reference configurations and margins
        of limits; nor gravity, which is an argument of the methods, with a DynamicsWarning unless it is their
        default. Constraints that close loops, such as those of MJCF's `<equality>`, are no part of a Pinocchio model:
        the loops of the robot are open.

        Args:
            model: a Pinocchio model with revolute, continuous, prismatic, helical and mimic joints, and composites of
                these, in depth-first order. The joint at its root may be a free-flyer; links that are fixed to the
                world are then left out. The robot's q is Pinocchio's, without the seven numbers of a
                free-flyer (`base_motion` gives the pose of the base), and with the angle of a continuous joint in
                place of its cosine and sine.
            base: "fixed" or "free". By default, the base is free if the model has a free-flyer, and otherwise fixed.
            locked: positions at which joints are held, as for `from_urdf`.

        Raises:
            ArgumentError: a joint is of a kind that is not listed under `model`, a joint is not in depth-first order,
                the armature of a joint is negative or not finite, the free-flyer has an armature, or frames in
                different places have one name. The message names the joint or the frame.

        >>> import pinocchio
        >>> import hingepair as hp
        >>> hp.Mechanism.from_pinocchio(pinocchio.buildSampleModelManipulator()).dof
        6
        """
        return _new_mechanism(cls, *tree_of_pinocchio(model, base, locked))

    @classmethod
    def from_mjcf(cls, model: Any, base: str | None = None, locked: Mapping[str, float] | None = None) -> Mechanism:
        """Read a robot from MJCF, the model format of MuJoCo. MuJoCo reads the file, so that defaults, included files
        and inertias of geoms are as there; it must be installed.

        Read are bodies with their masses, hinges and slide joints with `ref`, `range`, `armature`, `damping`,
        `frictionloss`, `stiffness`, `springref` and `actuatorfrcrange` (`effort_bounds`), linear equalities of two
        joints as mimic joints, sites as frames, and a free joint of the only body of the world that moves, which is
        the base. Without it, the base is the world. q is MuJoCo's qpos of the joints in its order, without mimic
        joints. What has no name is `joint1`, `body2` and so on; a site with the name of a body or a joint gets "_"
        behind it. Not read are shapes and contacts, actuators, tendons and other equalities, gravity compensation,
        the medium, loads of the free joint and bodies that stand beside it; a DynamicsWarning names those that the
        model has.

        Equalities `connect` and `weld` close loops (`closed`), and q is then of the joints that determine the others,
        those near the base; `robot.opened()` has all joints in q. Loops are assembled near
        qpos0 or else a keyframe.

        Args:
            model: path of a file, its text (which starts with "<"), or a mujoco.MjModel.
            base: "fixed" or "free", as for `from_pinocchio`.
            locked: positions at which joints are held, as for `from_urdf`.

        Raises:
            ArgumentError: MuJoCo cannot read the model, or it has a ball joint, or a free joint elsewhere; the
                message names the joint.
            MissingDependencyError: MuJoCo is not installed.

        >>> import hingepair as hp
        >>> robot = hp.Mechanism.from_mjcf('''
        ...   <mujoco model="door"><worldbody><body name="door"><geom size="0.4 0.02 1" type="box" mass="20"/>
        ...     <joint name="hinge" axis="0 0 1" pos="-0.4 0 0" damping="0.5" frictionloss="0.2"/>
        ...   </body></worldbody></mujoco>''')
        >>> robot.joint_loads["hinge"].damping, robot.joint_loads["hinge"].friction
        (0.5, 0.2)
        >>> robot.forward_dynamics([0], [1], [0], joint_loads=True).qdd.round(4).tolist()
        [-0.164]
        """
        return _new_mechanism(cls, *tree_of_mjcf(model, base, locked))

    # ---- properties

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self._tree.name

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints that have a coordinate, in the order of q; mimic joints have none."""
        return tuple(joint.name for joint in self._tree.coordinates)

    @property
    def dof(self) -> int:
        """Number of coordinates in q, without the six of a free base."""
        return len(self._tree.coordinates)

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links, the base first, and each after the link that carries it."""
        return tuple(self._tree.links)

    @property
    def tips(self) -> tuple[str, ...]:
        """Names of the links that carry no other, on bodies that carry no further joint; the default `frames`."""
        return self._tree.tips

    @property
    def position_limits(self) -> Float64Array:
        """Lower and upper limits of q [rad or m], -inf and inf where there are none; shape (dof, 2)."""
        return self._joint_values("position_limits", 2)

    @property
    def rate_limits(self) -> Float64Array:
        """Largest permitted rates [rad/s or m/s], inf where there is no limit; shape (dof,)."""
        return self._joint_values("rate_limit")

    @property
    def effort_limits(self) -> Float64Array:
        """Largest permitted torques [N m] and forces [N] of the motors, inf where there is no limit; shape (dof,)."""
        return self._joint_values("effort_limit")

    @property
    def effort_bounds(self) -> Float64Array:
        """Least and greatest torques [N m] and forces [N] of the motors; shape (dof, 2). They are minus and plus
        `effort_limits`, but for joints of MJCF and Pinocchio with other bounds.
        """
        return self._joint_values("effort_bounds", 2)

    @property
    def armature(self) -> Float64Array:
        """Inertias of the motors' rotors, times the square of the gear ratio, which are added to the diagonal of the
        mass matrix [kg m^2 or kg]; shape (dof,). A mimic joint adds its own, times the square of its multiplier, to
        its leader's; of a closed mechanism those of its coordinates. Robots of URDF have none.
        """
        sums = dict.fromkeys((joint.name for joint in self._tree.own_coordinates), 0.0)
        for joint in self._tree.joints:
            sums[joint.rule.leader] += joint.armature * joint.rule.multiplier**2
        return read_only(np.array([sums.get(name, 0.0) for name in self.names], dtype=np.float64))

    @property
    def mass(self) -> Any:
        """Total mass of the robot [kg], that of the base only if the base is free; with payloads that have samples an
        array of their shape.

        >>> import hingepair as hp
        >>> round(hp.load_robot("ur5_robot").mass, 3)
        16.994
        """
        counted = 0 if self.base == "free" else 1
        total = float(sum(body.mass for body in self._tree.bodies[counted:]))
        samples = self._tree.samples
        if samples is None:
            return total
        matter = (numbers[..., 0] for body, numbers in samples.matter.items() if body >= counted)
        return read_only(np.array(np.broadcast_to(sum(matter, np.float64(total)), samples.shape)))

    @property
    def joint_loads(self) -> dict[str, HingeLoad]:
        """Loads of joints as the robot's file describes them, HingeLoads by the joint's name, with spring, damper and
        dry friction, and the position limits as `stops`. Joints without any of these are left out. The load of a
        slider is in N/m, N s/m and N.

        The methods of dynamics count springs, dampers and friction with `joint_loads=True`, stops never;
        `hp.simulate(robot, ..., loads=robot.joint_loads)` counts all.
        """
        loads = {}
        for joint in self._tree.joints:
            bounded = np.isfinite(joint.position_limits).any() and joint.position_limits[0] < joint.position_limits[1]
            load = replace(joint.load, stops=joint.position_limits) if bounded else joint.load
            if load != NO_LOAD:
                loads[joint.name] = load
        return loads

    def _joint_values(self, field: str, *tail: int) -> Float64Array:
        """Return a field of all joints that have a coordinate, shape (dof, ...)."""
        values = [getattr(joint, field) for joint in self._tree.coordinates]
        return read_only(np.array(values, dtype=np.float64).reshape(self.dof, *tail))

    def __getitem__(self, joint: str) -> RobotJoint:
        """Return a moving joint by name, as a HingePair, Slider or Screw between the frames of the links behind their
        joints. A body that has no mass, or no possible one, is None.
        """
        names = [one.name for one in self._tree.joints]
        if joint not in names:
            expected = choices(names) + nearest(str(joint), names) if names else "no joint, since none moves"
            raise ArgumentError("joint", expected, quoted(joint))
        return changes.pair_of(self._tree, names.index(joint) + 1)

    # ---- extended copies

    def _with_tree(self, tree: Tree) -> Mechanism:
        return _new_mechanism(type(self), tree, self.base)

    def with_payload(
        self,
        link: str,
        body: Body | None = None,
        *,
        mass: ArrayLike | None = None,
        centre_of_mass: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None,
    ) -> Mechanism:
        """Return a copy of the robot with an additional body that is fixed to a link or other frame.

        The body is a Body, or mass properties with samples. Their leading axes broadcast with those of coordinates in
        every output that depends on masses, as if `mass` were an argument of the call: masses of shape (10_000, 1)
        and q of shape (100, dof) give `tau` of shape (10_000, 100, dof). Error bounds, exports and comparisons are of
        one robot, and refuse others.

        Args:
            link: name of the link or other frame, whose origin and axes are those of the body. The name of a joint
                stands for the link that the joint carries; for a HingePair, this link is body 2 with the origin R2
                and the axes S2.
            body: mass properties and shapes of the body. A Body without inertia and shapes gets a radius of gyration
                of 0.1 m, with a DynamicsWarning; `mass` alone is a point.
            mass: in place of `body`, masses [kg] of 0 or above; shape (...).
            centre_of_mass: centres of mass from the frame's origin, in the axes of the frame [m]; shape (..., 3).
            inertia: inertias about the centre of mass, axes of the frame [kg m^2]; shape (..., 3, 3). By default
                zero: the payload is a point.

        >>> import hingepair as hp
        >>> ball = hp.Body(2, inertia=(1, 1, 1))
        >>> hand = hp.HingePair(u1=(0, 0, 1), u2=(0, 0, 0), n=(0, 1, 0), name="hand", body2=ball)
        >>> robot = hp.Mechanism([hand]).with_payload("hand", hp.Body(3, inertia=(1, 1, 1)))
        >>> robot["hand"].body2.mass  # robot["hand"] is the HingePair; body 2 is the ball with the payload
        5.0
        """
        if mass is None:
            return self._with_tree(changes.add_body(self._tree, link, body))
        if body is not None:
            raise ArgumentError("mass", "None, since `body` has a mass", quoted(mass))
        payload = read_payload(mass, centre_of_mass, inertia)
        return self._with_tree(changes.add_payload(self._tree, link, payload))

    def with_locked(self, positions: Mapping[str, float]) -> Mechanism:
        """Return a copy of the robot in which joints are held.

        Args:
            positions: positions [rad or m] by joint, as `locked` of `from_urdf`.

        Raises:
            ShapeError: the robot has payloads with samples; they are added after this.

        >>> import hingepair as hp
        >>> hp.load_robot("panda").with_locked({"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02}).dof
        7
        """
        return self._with_tree(fold(self._tree.plain(), positions))

    def with_motor(self, joint: str, *, armature: float, ratio: float | None = None) -> Mechanism:
        """Return a copy of the robot with a motor at a joint, whose rotor's inertia replaces that of the file.

        Args:
            joint: name of the joint.
            armature: inertia of the rotor about its own axis [kg m^2].
            ratio: turns of the rotor for one turn of the joint; of a slider rad/m. The joint feels armature times
                ratio^2. By default the `mechanicalReduction` of its transmission in the URDF, or 1.

        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot").with_motor("elbow_joint", armature=2e-5, ratio=101)
        >>> robot.armature.round(3).tolist()
        [0.0, 0.0, 0.204, 0.0, 0.0, 0.0]
        """
        return self._with_tree(changes.set_motor(self._tree, joint, armature, ratio))

    def with_joint_loads(self, loads: Mapping[str, HingeLoad]) -> Mechanism:
        """Return a copy of the robot with other `joint_loads`; joints that are not named keep theirs.

        Args:
            loads: HingeLoads by joint, with stiffness, rest, damping and friction; of a slider in N/m, m, N s/m and
                N. Their `stops`, if given, become the position limits.

        Raises:
            ArgumentError: a load has other parts, such as a motor.

        >>> import hingepair as hp
        >>> robot = hp.load_robot("ur5_robot").with_joint_loads({"elbow_joint": hp.HingeLoad(damping=2)})
        >>> robot.joint_loads["elbow_joint"].damping
        2.0
        """
        return self._with_tree(changes.set_loads(self._tree, loads))

    def with_frame(
        self, name: str, link: str, R: ArrayLike = (0.0, 0.0, 0.0), S: ArrayLike | None = None
    ) -> Mechanism:
        """Return a copy of the robot with an additional frame, such as a tool frame, which is fixed to a link or
        other frame.

        Args:
            name: name of the new frame; no link, joint or frame may have it already.
            link: name of the link or other frame. The name of a joint stands for the link that the joint carries.
            R: vector from the origin of `link` to the origin of the new frame, in the axes of `link` [m]; shape (3,),
                or (..., 3), whose leading axes broadcast with those of coordinates.
            S: rotation matrix from the axes of the new frame to the axes of `link`; shape (3, 3). By default, it is
                the identity.

        >>> import hingepair as hp
        >>> hand = hp.HingePair(u1=(0, 0, 1), u2=(0, 0, 0), n=(0, 1, 0), name="hand")
        >>> robot = hp.Mechanism([hand]).with_frame("tool", link="hand", R=(0, 0, 0.5))
        >>> robot.forward_kinematics((0,), frames="tool")["tool"].R.tolist()
        [0.0, 0.0, 1.5]
        """
        frame = self._tree.known_frame("link", link)
        return self._with_tree(changes.add_frame(self._tree, name, frame, R, S))

    # ---- struts and loops

    def with_strut(
        self,
        frame1: str,
        frame2: str,
        name: str,
        *,
        force: GasSpring | ArrayLike | Callable[[Any, Any], ArrayLike] | None = None,
        stiffness: float = 0.0,
        free_length: float | None = None,
        damping: float = 0.0,
        limits: ArrayLike | None = None,
    ) -> Mechanism:
        """Return a copy of the robot with a strut between two frames: a spring, a damper, a gas spring.

        A positive force pushes the points apart. It acts in dynamics beside tau, and its potential is part of
        `energy`. A strut without a force can be a coordinate of `closed`: q is its length, and tau its force.

        Args:
            frame1: name of a frame, link or joint, in whose origin the strut begins.
            frame2: where it ends.
            name: name of the strut.
            force: a GasSpring; a table (lengths [m], forces [N]) between whose lines the force is linear; or a
                function force(length, rate) of arrays [m, m/s] that returns an array [N]. A function acts in the
                methods and in `simulate`; prepared calls, derivatives and rollouts refuse it, and it has no energy.
            stiffness: of a spring [N/m].
            free_length: length [m] at which the spring exerts nothing, or the gas spring is extended.
            damping: of a damper [N s/m].
            limits: least and greatest length [m]; shape (2,). Those of a gas spring are by default those of its
                stroke. Beyond them a strut that pushes does so by NaN, and a DynamicsWarning counts the samples;
                `simulate` ends there. Elastic stops within them are a further strut with a table.

        >>> import hingepair as hp
        >>> lid = hp.HingePair(u1=(0, 0, 0), u2=(0, 0, 0), n=(0, 1, 0), name="lid")
        >>> hatch = hp.Mechanism([lid]).with_frame("a", "base", R=(0.3, 0, -0.2))
        >>> hatch = hatch.with_frame("b", "lid", R=(0.5, 0, 0))
        >>> hatch = hatch.with_strut("a", "b", "gas", force=hp.GasSpring(300, 400, 0.2), free_length=0.4)
        >>> round(float(hatch.struts([0.0])["gas"].length), 4)
        0.2828
        """
        ends = frame1, frame2
        tree = add_strut(self._tree, ends, name, force, stiffness, free_length, damping, limits)
        return self._with_tree(tree)

    def closed(
        self,
        *loops: Loop,
        coordinates: str | Iterable[str] | None = None,
        at: Mapping[str, float] | None = None,
    ) -> Mechanism:
        """Return the mechanism with loops closed: a robot with fewer coordinates, which determine all joints.

        Methods work on it as on other robots, but for `joint_wrenches`, `error_bounds` and exports: q, tau and
        Jacobians are of its coordinates, and what the other joints do follows within the same program. All joints are
        a function of q alone: the assembly near `at`, as far as it can be followed without taking the loops apart.
        Where they cannot be closed, and at dead points, results are NaN.

        Args:
            loops: Loops between frames of this robot; all that are to be closed.
            coordinates: names of what determines all joints: joints, or struts, whose coordinate is their length. By
                default joints are found, near the base first.
            at: coordinates [rad or m] by joint near which the mechanism is assembled, 0 of those not named.

        Raises:
            ArgumentError: the loops cannot be closed near `at`, or `coordinates` are too few, too many, or do not
                determine the others.

        >>> import hingepair as hp
        >>> bars = [("crank", (0, 0, 0)), ("coupler", (0.3, 0, 0)), ("rocker", (1, 0, 0))]
        >>> joints = [hp.HingePair(u1, (0, 0, 0), (0, 0, 1), name=name) for name, u1 in bars]
        >>> chain = hp.Mechanism(joints, parents=[0, 1, 0])
        >>> ends = chain.with_frame("a", link="coupler", R=(0.9, 0, 0)).with_frame("b", link="rocker", R=(0.7, 0, 0))
        >>> four_bar = ends.closed(hp.Loop("a", "b"), coordinates="crank", at={"coupler": 0.8, "rocker": 1.9})
        >>> four_bar.dof, four_bar.all_coordinates([0.3]).round(4).tolist()
        (1, [0.3, 0.4439, 1.644])
        """
        return self._with_tree(close_tree(self._tree, loops, coordinates, at))

    def opened(self) -> Mechanism:
        """Return the mechanism with its loops open, whose coordinates are those of `all_coordinates`."""
        return self._with_tree(replace(self._tree, closure=None))

    @property
    def loops(self) -> tuple[Loop, ...]:
        """Loops of a closed mechanism; none of a tree."""
        return () if self._tree.closure is None else self._tree.closure.loops

    # ---- inertial parameters

    @property
    def inertial_parameters(self) -> Float64Array:
        """Inertial parameters of the bodies, ten for each; shape (10 * bodies,). Those of the base come first, if it
        is free; then those of the body that each joint moves.

        The ten are, in the axes of the body and about its reference point, the point of its joint: the mass [kg], the
        first moment, mass times centre of mass, hx, hy, hz [kg m], and the inertia Jxx, Jxy, Jyy, Jxz, Jyz, Jzz
        [kg m^2]. They are those of `toDynamicParameters` of Pinocchio's inertias, in its order.
        """
        return inertial_parameters(self._tree, self.base == "free")

    def with_inertial_parameters(self, parameters: ArrayLike, *, armature: ArrayLike | None = None) -> Mechanism:
        """Return a copy of the robot with other `inertial_parameters`. Computations use them as they are, even if no
        rigid body can have them; a DynamicsWarning then names the body.

        Args:
            parameters: in the form of `inertial_parameters`; shape (10 * bodies,).
            armature: inertias of the motors' rotors in the form of `robot.armature`, shape (dof,); by default they
                stay.

        Raises:
            ArgumentError: parameters are missing or not finite, or a body without mass has a first moment.

        >>> import hingepair as hp
        >>> ball = hp.Body(2, inertia=(1, 1, 1))
        >>> robot = hp.Mechanism([hp.HingePair(u1=(0, 0, 1), u2=(0, 0, 0), n=(0, 1, 0), name="hand", body2=ball)])
        >>> robot.with_inertial_parameters(2 * robot.inertial_parameters)["hand"].body2.mass
        4.0
        """
        bodies = len(self._tree.joints) + (self.base == "free")
        checked = one_constant("parameters", parameters, 10 * bodies)
        rotors = None if armature is None else one_constant("armature", armature, self.dof)
        if rotors is not None and (rotors < 0).any():
            raise ArgumentError("armature", "inertias of at least 0", tuple(rotors.tolist()))
        tree = tree_with_parameters(self._tree, self.base == "free", checked, rotors)
        return self._with_tree(tree)

    def base_parameters(self, *, gravity: ArrayLike = DEFAULT_GRAVITY) -> BaseParameters:
        """Find the base parameters: the fewest combinations of `inertial_parameters` on which the torques of
        `torque_regressor` depend. Only they can be identified from motions and torques. A fixed base is at rest.

        >>> import hingepair as hp
        >>> base = hp.load_robot("panda", locked={"panda_finger_joint1": 0.02}).base_parameters()
        >>> len(base.names), len(base.parameter_names)
        (43, 70)
        """
        free, rng = self.base == "free", np.random.default_rng(1)

        def regressor(states: Float64Array) -> FloatArray:
            motion = None
            if free:
                v = rng.uniform(-1.0, 1.0, (4, states.shape[1], 3))
                motion = BodyMotion(R=0 * v[0], S=rotation_exp(3 * v[0]), omega=v[1], a=v[2], alpha=v[3])
            return self.torque_regressor(*states, gravity=gravity, base_motion=motion)

        return find_base_parameters(self._tree, free, regressor, self.position_limits)

    def with_base(self, base: str) -> Mechanism:
        """Return the robot with the given kind of base: "fixed", which rests or moves as given, or "free".

        >>> import hingepair as hp
        >>> hand = hp.HingePair(u1=(0, 0, 1), u2=(0, 0, 0), n=(0, 1, 0), name="hand")
        >>> hp.Mechanism([hand]).with_base("free").base
        'free'
        """
        check_choice("base", base, BASE_KINDS)
        return _new_mechanism(type(self), self._tree, base)

    def __repr__(self) -> str:
        return f"Mechanism({self.name!r}, dof={self.dof}, links={len(self.links)}, base={self.base!r})"

    def __str__(self) -> str:
        title, rows, notes = self._sheet()
        return "\n".join((title, *align_columns(rows, {4, 5, 6, 7, 8, *range(10, len(rows[0]))}), *notes))

    def _sheet(self) -> Sheet:
        """Return the printed table of the moving joints; armature and loads have columns if a joint has them."""
        tree, joints, closure = self._tree, self._tree.joints, self._tree.closure
        names = ["base", *(joint.name for joint in joints)]  # of what carries a joint
        ranges = (one.effort_range or (one.effort_limit,) for one in joints)
        columns = {
            "joint": names[1:],
            "kind": [joint.kind for joint in joints],
            "carried by": [names[joint.parent] for joint in joints],
            "axis (joint axes)": [" ".join(f"{x:g}" for x in joint.n.round(3) + 0.0) for joint in joints],
            "least": [_finite(joint.position_limits[0]) for joint in joints],
            "greatest": [_finite(joint.position_limits[1]) for joint in joints],
            "rate": [_finite(joint.rate_limit) for joint in joints],
            "effort": [" to ".join(map(_finite, one)) for one in ranges],
            "mass [kg]": [cell_text(joint.body.mass) for joint in joints],
            "follows": [str(joint.mimic or "") for joint in joints],
        }
        extra = {"armature": [joint.armature for joint in joints]}
        extra |= {name: [getattr(joint.load, name) for joint in joints] for name in LOAD_FIELDS}
        columns |= {name: [*map(cell_text, values)] for name, values in extra.items() if any(values)}
        rows = [tuple(columns), *zip(*columns.values(), strict=True)]
        title = f"{self.name}: {self.dof} degrees of freedom, {len(self.links)} links, {self.base} base"
        notes = tree.mass_notes(self.base == "free")
        if note := loads_note(tree):
            notes.append(f"dynamics: {note}, unless joint_loads=True")
        if tree.samples is not None:
            notes.append(f"payloads or lengths differ from sample to sample, shape {tree.samples.shape}")
        if closure is not None:
            loops = ", ".join(f"{loop.name} ({loop.kind})" for loop in closure.loops)
            notes.append(f"closed loops: {loops}; coordinates: {', '.join(closure.names)}")
            if closure.redundant:
                notes.append(f"conditions of the loops that are redundant: {closure.redundant}")
        if tree.struts:
            ends = ", ".join(f"{strut.name} ({strut.ends[0]} to {strut.ends[1]})" for strut in tree.struts)
            notes.append(f"struts: {ends}")
        return Sheet(title, rows, notes)


def _finite(limit: float) -> str:
    return "" if np.isinf(limit) else cell_text(limit)


def tree_of(robot: Mechanism) -> Tree:
    """Return the record of a robot's joints, links and masses."""
    return robot._tree


def robot_of(tree: Tree, base: str) -> Mechanism:
    """Return the robot of a record."""
    return _new_mechanism(Mechanism, tree, base)


def _new_mechanism(mechanism_class: type[Mechanism], tree: Tree, base: str) -> Mechanism:
    """Return a robot without the checks of the constructor."""
    mechanism = object.__new__(mechanism_class)
    set_frozen(mechanism, _tree=tree, base=base)
    return mechanism
