"""The reader of robots in MJCF, which MuJoCo parses.

MuJoCo's compiler resolves defaults, included files, angles and inertias of geoms; its result is read here.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hingepair.errors import ArgumentError, quoted, warn_of_dynamics
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.bodies.shapes import Drawing
from hingepair.mechanism.building.folding import (
    chosen_base,
    displaced,
    effort_fields,
    fold,
    framed,
    mass_properties,
    warn_of_gravity,
    written_joint,
)
from hingepair.mechanism.kinds import JointKind
from hingepair.mechanism.linkages import Loop, close_tree
from hingepair.mechanism.tree import Frame, Joint, Tree, unused_name
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.optional import require
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.rotations.matrices import quaternion_to_matrix
from hingepair.urdf.records import MimicRecord
from hingepair.urdf.rigid import ZERO_MASS_PROPERTIES, FramePose, MassProperties, exact_quarter_turns

_KINDS: dict[int, JointKind] = {2: "slider", 3: "hinge"}  # by mjtJoint, MuJoCo's type of a joint
_LOOP_KINDS = {0: "ball", 1: "weld"}  # of loops, by the type of an equality (mjtEq)
_SITE = 6  # what an equality joins (mjtObj)
_JOINT_EQUALITY = 2  # mjEQ_JOINT, the type of an equality by which a joint follows another
_UNKNOWN = Drawing(None)  # geoms are not read
_FREE, _TYPE_NAMES = 0, ("free", "ball", "slide", "hinge")


def tree_of_mjcf(model: Any, base: str | None, locked: Mapping[str, float] | None) -> tuple[Tree, str]:
    """Return the tree of a model in MJCF, and the kind of its base, as `Mechanism.from_mjcf` describes."""
    reader = _Reader(_compiled(model))
    tree = reader.closed(fold(reader.tree(), locked))
    return tree, chosen_base(base, "free" if reader.root else "fixed")


def _compiled(model: Any) -> Any:
    """Return the MjModel of a path, a text or an MjModel."""
    mujoco = require("mujoco", "from_mjcf")
    if isinstance(model, mujoco.MjModel):
        return model
    if not isinstance(model, str | os.PathLike):
        raise ArgumentError("model", "a path, text of MJCF or an MjModel", quoted(model))
    text = os.fspath(model)
    try:
        if text.lstrip("\ufeff \t\r\n").startswith("<"):
            return mujoco.MjModel.from_xml_string(text.lstrip("\ufeff \t\r\n"))
        return mujoco.MjModel.from_xml_path(text)
    except ValueError as error:
        raise ArgumentError("model", "MJCF that MuJoCo can read", str(error)) from None


class _Reader:
    """Reader of the bodies and joints of an MjModel, in MuJoCo's order, which is depth-first.

    The base is the only body of the world that moves, if it has a free joint, and otherwise the world.
    """

    def __init__(self, model: Any) -> None:
        self._model = model
        free = [joint for joint in range(model.njnt) if model.jnt_type[joint] == _FREE]
        moving = {int(model.body_rootid[model.jnt_bodyid[joint]]) for joint in range(model.njnt)}
        self.root = int(model.jnt_bodyid[free[0]]) if len(free) == 1 and len(moving) == 1 else 0
        if self.root and model.body_parentid[self.root] != 0:
            self.root = 0
        self._joint_names = _names(model.joint, model.njnt, "joint", set())
        self._body_names = _names(model.body, model.nbody, "body", set())
        named = [name for k, name in enumerate(self._joint_names) if model.jnt_type[k] != _FREE]
        frames = {*named, *self._body_names}
        self._site_names = _names(model.site, model.nsite, "site", frames)
        self._rules = self._mimic_rules()
        equalities = _names(model.equality, model.neq, "equality", frames)
        self._loops = [*_read_loops(model, equalities, self._site_names)]

    def tree(self) -> Tree:
        """Return the tree with all joints."""
        model, root = self._model, self.root
        joints, links, frames = list[Joint](), dict[str, Frame](), dict[str, Frame]()
        masses: list[list[MassProperties]] = [[]]
        places = {root: (0, _pose())}  # number of the body of each body of MuJoCo, and its pose there
        for body in self._bodies():
            if body != root:
                number, pose = places[int(model.body_parentid[body])]
                pose = pose.placed(_pose(model.body_pos[body], model.body_quat[body]))
                first = int(model.body_jntadr[body])
                for joint in range(first, first + int(model.body_jntnum[body])):
                    joints.append(self._joint(joint, number, pose))
                    masses.append([])
                    number, pose = len(joints), _pose(-model.jnt_pos[joint])
                places[body] = number, pose
            number, pose = places[body]
            links[self._body_names[body]] = framed(number, pose)
            masses[number].append(self._masses(body).placed(pose))
            for site in np.flatnonzero(model.site_bodyid == body).tolist():
                own = _pose(model.site_pos[site], model.site_quat[site])
                frames[self._site_names[site]] = framed(number, pose.placed(own))
            for name, place, own in (end for _, ends in self._loops for end in ends):
                if place == body:
                    frames[name] = framed(number, pose.placed(own))
        self._warn()
        carrying = {self._body_names[model.body_parentid[body]] for body in self._bodies() if body}
        base, *bodies = (mass_properties(self._title(), own) for own in masses)
        joints = [replace(joint, body=own) for joint, own in zip(joints, bodies, strict=True)]
        leaves = tuple(name for name in links if name not in carrying)
        return Tree(
            self._title(), tuple(joints), base, links, frames, leaves, drawings=(_UNKNOWN,) * (len(joints) + 1)
        )

    def closed(self, tree: Tree) -> Tree:
        """Return a tree with the loops of the model closed near qpos0 or a keyframe; else open, with a warning."""
        model, loops, refused = self._model, [loop for loop, _ in self._loops], None
        joints = {joint.name for joint in tree.own_coordinates}
        for qpos in (model.qpos0, *model.key_qpos) if loops else ():
            places = zip(self._joint_names, model.jnt_qposadr, strict=True)
            try:
                return close_tree(tree, loops, None, {name: float(qpos[k]) for name, k in places if name in joints})
            except ArgumentError as error:
                refused = error
        if refused is not None:
            names = ", ".join(str(loop.name) for loop in loops)
            left = f"the loops {names} are left open, and can be closed by robot.closed"
            warn_of_dynamics(f"{self._title()}: {left}: {refused}")
        return tree

    def _title(self) -> str:
        return self._model.names[: self._model.names.index(b"\0")].decode() or "model"

    def _bodies(self) -> Iterator[int]:
        """Yield the numbers of the bodies in order: with a free base, of those that it carries."""
        for body in range(self._model.nbody):
            if self.root == 0 or self._model.body_rootid[body] == self.root:
                yield body

    def _masses(self, body: int) -> MassProperties:
        """Return the mass properties of a body in its own axes; the world has none."""
        model = self._model
        if body == 0:
            return ZERO_MASS_PROPERTIES
        principal = MassProperties(float(model.body_mass[body]), np.zeros(3), np.diag(model.body_inertia[body]))
        return principal.placed(_pose(model.body_ipos[body], model.body_iquat[body]))

    def _joint(self, joint: int, parent: int, pose: FramePose) -> Joint:
        """Return a joint; `pose` is that of the joint's body in the part `parent`, which carries it."""
        model, name = self._model, self._joint_names[joint]
        kind = _KINDS.get(int(model.jnt_type[joint]))
        if kind is None:
            expected = "a hinge or a slide joint, or one free joint of the only moving body of the world"
            raise ArgumentError(f"joint {name!r}", expected, _TYPE_NAMES[int(model.jnt_type[joint])])
        dof, at = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
        own = written_joint(
            name, kind, parent, pose.placed(_pose(model.jnt_pos[joint])),
            unit_axis(f"joint {name!r}, axis", model.jnt_axis[joint]),
            limits=tuple(model.jnt_range[joint].tolist()) if model.jnt_limited[joint] else None,
            mimic=self._rules.get(joint),
            **(effort_fields(*model.jnt_actfrcrange[joint].tolist()) if model.jnt_actfrclimited[joint] else {}),
            armature=float(model.dof_armature[dof]),
            load=HingeLoad(
                stiffness=model.jnt_stiffness[joint],
                rest=model.qpos_spring[at] if model.jnt_stiffness[joint] else 0.0,
                damping=model.dof_damping[dof],
                friction=model.dof_frictionloss[dof],
            ),
        )  # fmt: skip
        # The body stands as written where q is the joint's ref.
        seat = own.pose.placed(displaced(own, -float(model.qpos0[at])))
        return replace(own, u=seat.origin, S=seat.rotation)

    def _mimic_rules(self) -> dict[int, MimicRecord]:
        """Return the rules by which joints follow others; of a joint with several, the first."""
        model, rules = self._model, dict[int, MimicRecord]()
        for number in range(model.neq):
            joint, leader = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
            constant, factor, *curve = model.eq_data[number, :5].tolist()
            linear = model.eq_type[number] == _JOINT_EQUALITY and leader >= 0 and factor and not any(curve)
            if linear and model.eq_active0[number] and joint not in rules:
                own, its = (float(model.qpos0[model.jnt_qposadr[one]]) for one in (joint, leader))
                rules[joint] = MimicRecord(self._joint_names[leader], factor, constant + own - factor * its)
        return rules

    def _warn(self) -> None:
        """Issue a DynamicsWarning that names what acts in MuJoCo and is not read."""
        model = self._model
        left_out = [f"{count} {noun}" for count, noun in (
            (model.neq - len(self._rules) - len(self._loops), "equality constraints"),
            (model.ntendon, "tendons"), (model.nu, "actuators"),
            (np.count_nonzero(model.body_gravcomp), "bodies with gravity compensation"),
            (np.count_nonzero(getattr(model, "dof_dampingpoly", ())), "polynomials of damping"),
            (np.count_nonzero(getattr(model, "jnt_stiffnesspoly", ())), "polynomials of stiffness"),
        ) if count]  # fmt: skip
        read = {0, *self._bodies()}
        if standing := [name for body, name in enumerate(self._body_names) if body not in read]:
            left_out.append(f"bodies that stand in the world ({', '.join(standing)})")
        if self.root:
            joint = int(model.body_jntadr[self.root])
            six = slice(first := int(model.jnt_dofadr[joint]), first + 6)
            loads = {"damping": model.dof_damping[six], "armature": model.dof_armature[six]}
            loads |= {"dry friction": model.dof_frictionloss[six], "stiffness": model.jnt_stiffness[joint]}
            if found := [name for name, values in loads.items() if np.any(values)]:
                left_out.append(f"{', '.join(found)} of the free joint")
        if model.opt.density or model.opt.viscosity or model.opt.wind.any():
            left_out.append("the medium (density, viscosity, wind)")
        if left_out:
            warn_of_dynamics(f"{self._title()}: not read from MJCF are {', '.join(left_out)}")
        warn_of_gravity(model.opt.gravity)


def _names(of: Any, count: int, kind: str, taken: set[str]) -> list[str]:
    """Return the names of all elements of a kind, `joint1` and so on of unnamed ones; none is in use twice."""
    given, taken = [str(of(number).name) for number in range(count)], {*taken}
    named = [unused_name(name, taken) if name else "" for name in given]
    return [name or unused_name(f"{kind}{number}", taken) for number, name in enumerate(named)]


def _pose(origin: Any = (0.0, 0.0, 0.0), quat_wxyz: Any = (1.0, 0.0, 0.0, 0.0)) -> FramePose:
    S: Float64Array = np.asarray(quaternion_to_matrix("quat", quat_wxyz, scalar_first=True), np.float64)
    return FramePose(exact_quarter_turns(S), np.array(origin, np.float64))


def _read_loops(
    model: Any, names: Sequence[str], sites: Sequence[str]
) -> Iterator[tuple[Loop, list[tuple[str, int, FramePose]]]]:
    """Yield the loops of a model, active equalities `connect` and `weld`, with the frames that they need: name, body
    and pose.
    """
    for number, name in enumerate(names):
        kind, data = _LOOP_KINDS.get(int(model.eq_type[number])), model.eq_data[number]
        if kind is None or not model.eq_active0[number]:
            continue
        first, second = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        if model.eq_objtype[number] == _SITE:
            yield Loop(sites[first], sites[second], kind, name=name), []
        else:
            one, other = _pose(data[:3]), _pose(data[3:6])
            if kind == "weld":
                one, other = _pose(data[3:6], data[6:10]), _pose(data[:3])
            ends = f"{name}_1", f"{name}_2"
            yield Loop(*ends, kind, name=name), [(ends[0], first, one), (ends[1], second, other)]
