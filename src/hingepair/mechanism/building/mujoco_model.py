"""The reader of robots in MJCF, which MuJoCo parses.

MuJoCo's compiler resolves defaults, included files, angles and inertias of geoms; its result is read here.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.building.folding import JointPart, chosen_base, displaced, fold_parts
from hingepair.mechanism.joints import JointKind
from hingepair.mechanism.shapes import LinkDrawing
from hingepair.mechanism.tree import Tree
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.optional import require
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.pair.body import warn_of_dynamics
from hingepair.pair.dynamics import DEFAULT_GRAVITY
from hingepair.pair.hinge_load import HingeLoad
from hingepair.rotations.matrices import quaternion_to_matrix
from hingepair.urdf.records import MimicRecord
from hingepair.urdf.rigid import FramePose, Inertia, exact_quarter_turns

_KINDS: dict[int, JointKind] = {2: "slider", 3: "hinge"}  # by mjtJoint, MuJoCo's type of a joint
_JOINT_EQUALITY = 2  # mjEQ_JOINT, the type of an equality by which a joint follows another
_FREE, _TYPE_NAMES = 0, ("free", "ball", "slide", "hinge")


def tree_of_mjcf(model: Any, base: str | None, locked: Mapping[str, float] | None) -> tuple[Tree, str]:
    """Return the tree of a model in MJCF, and the kind of its base, as `Mechanism.from_mjcf` describes."""
    name, own, parts = _Reader(_compiled(model)).parts()
    chosen = chosen_base(base, own)
    return fold_parts(name, parts, chosen, locked), chosen


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
        self._root = int(model.jnt_bodyid[free[0]]) if len(free) == 1 and len(moving) == 1 else 0
        if self._root and model.body_parentid[self._root] != 0:
            self._root = 0

    def parts(self) -> tuple[str, Literal["fixed", "free"], list[JointPart]]:
        """Return the name of the model, the kind of the base and the parts."""
        model, root = self._model, self._root
        parts = [_Part(JointPart("", "fixed", -1))]
        places = {root: (0, _pose())}  # part of each body, and the body's pose in it
        carrying = {int(model.body_parentid[body]) for body in self._bodies()}
        for body in self._bodies():
            if body != root:
                number, pose = places[int(model.body_parentid[body])]
                pose = pose.placed(self._pose_of(body))
                for joint in self._joints(body):
                    part = self._part(joint, number, pose)
                    number, pose = len(parts), _pose(-model.jnt_pos[joint])
                    parts.append(_Part(part))
                places[body] = number, pose
            number, pose = places[body]
            parts[number].add(self._name("body", body), pose, self._inertia(body), body not in carrying)
            for site in np.flatnonzero(model.site_bodyid == body).tolist():
                own = _pose(model.site_pos[site], model.site_quat[site])
                parts[number].frames[self._name("site", site)] = pose.placed(own)
        self._warn()
        return self._title(), ("free" if root else "fixed"), [part.made() for part in parts]

    def _title(self) -> str:
        return self._model.names[: self._model.names.index(b"\0")].decode() or "model"

    def _bodies(self) -> Iterator[int]:
        """Yield the numbers of the bodies in order: with a free base, of those that it carries."""
        for body in range(self._model.nbody):
            if self._root == 0 or self._model.body_rootid[body] == self._root:
                yield body

    def _joints(self, body: int) -> range:
        first = int(self._model.body_jntadr[body])
        return range(first, first + int(self._model.body_jntnum[body]))

    def _name(self, kind: str, number: int) -> str:
        found: str = getattr(self._model, kind)(number).name
        return found or f"{kind}{number}"

    def _pose_of(self, body: int) -> FramePose:
        return _pose(self._model.body_pos[body], self._model.body_quat[body])

    def _inertia(self, body: int) -> Inertia:
        """Return the mass properties of a body in its own axes; the world has none."""
        model = self._model
        if body == 0:
            return Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
        principal = Inertia(float(model.body_mass[body]), np.zeros(3), np.diag(model.body_inertia[body]))
        return principal.placed(_pose(model.body_ipos[body], model.body_iquat[body]))

    def _part(self, joint: int, parent: int, pose: FramePose) -> JointPart:
        """Return a joint as a part; `pose` is that of the joint's body in the part `parent`, which carries it."""
        model, name = self._model, self._name("joint", joint)
        kind = _KINDS.get(int(model.jnt_type[joint]))
        if kind is None:
            expected = "a hinge or a slide joint, or one free joint of the only moving body of the world"
            raise ArgumentError(f"joint {name!r}", expected, _TYPE_NAMES[int(model.jnt_type[joint])])
        dof, at = int(model.jnt_dofadr[joint]), int(model.jnt_qposadr[joint])
        part = JointPart(
            name, kind, parent, pose.placed(_pose(model.jnt_pos[joint])),
            unit_axis(f"joint {name!r}, axis", model.jnt_axis[joint]),
            limits=tuple(model.jnt_range[joint].tolist()) if model.jnt_limited[joint] else None,
            effort_limit=float(model.jnt_actfrcrange[joint].max()) if model.jnt_actfrclimited[joint] else None,
            armature=float(model.dof_armature[dof]),
            load=HingeLoad(
                stiffness=model.jnt_stiffness[joint],
                rest=model.qpos_spring[at] if model.jnt_stiffness[joint] else 0.0,
                damping=model.dof_damping[dof],
                friction=model.dof_frictionloss[dof],
            ),
        )  # fmt: skip
        # The body stands as written where q is the joint's ref.
        return replace(
            part, mimic=self._mimic(joint), pose=part.pose.placed(displaced(part, -float(model.qpos0[at])))
        )

    def _mimic(self, joint: int) -> MimicRecord | None:
        """Return the rule by which a linear equality makes a joint follow another; None if there is none."""
        model = self._model
        for number in self._mimic_equalities():
            if model.eq_obj1id[number] == joint:
                leader, (constant, factor) = int(model.eq_obj2id[number]), model.eq_data[number, :2].tolist()
                own, its = (float(model.qpos0[model.jnt_qposadr[one]]) for one in (joint, leader))
                return MimicRecord(self._name("joint", leader), factor, constant + own - factor * its)
        return None

    def _mimic_equalities(self) -> list[int]:
        """Return the numbers of the active, linear equalities by which a joint follows another."""
        model = self._model
        return [
            number for number in range(model.neq)
            if model.eq_type[number] == _JOINT_EQUALITY and model.eq_active0[number] and model.eq_obj2id[number] >= 0
            and model.eq_data[number, 1] and not model.eq_data[number, 2:5].any()
        ]  # fmt: skip

    def _warn(self) -> None:
        """Issue a DynamicsWarning that names what acts in MuJoCo and is not read."""
        model = self._model
        left_out = [f"{count} {noun}" for count, noun in (
            (model.neq - len(self._mimic_equalities()), "equality constraints"),
            (model.ntendon, "tendons"), (model.nu, "actuators"),
            (np.count_nonzero(model.body_gravcomp), "bodies with gravity compensation"),
            (np.count_nonzero(getattr(model, "dof_dampingpoly", ())), "damping polynomials"),
            (np.count_nonzero(getattr(model, "jnt_stiffnesspoly", ())), "stiffness polynomials"),
        ) if count]  # fmt: skip
        if model.opt.density or model.opt.viscosity or model.opt.wind.any():
            left_out.append("the medium (density, viscosity, wind)")
        if left_out:
            warn_of_dynamics(f"{self._title()}: not read from MJCF are {', '.join(left_out)}")
        if not np.array_equal(model.opt.gravity, DEFAULT_GRAVITY):
            gravity = model.opt.gravity.tolist()
            warn_of_dynamics(f"the model's gravity {gravity} is not the robot's: methods take gravity=")


class _Part:
    """A JointPart to which links and frames are added one by one."""

    def __init__(self, part: JointPart) -> None:
        self._part = part
        self._links: dict[str, FramePose] = {}
        self._inertias: dict[str, Inertia] = {}
        self._leaves: list[str] = []
        self.frames: dict[str, FramePose] = {}

    def add(self, link: str, pose: FramePose, inertia: Inertia, is_leaf: bool) -> None:
        """Add a link."""
        self._links[link], self._inertias[link] = pose, inertia.placed(pose)
        self._leaves += [link] if is_leaf else []

    def made(self) -> JointPart:
        """Return the JointPart with all that was added."""
        return replace(
            self._part, links=self._links, inertias=self._inertias, leaves=self._leaves, frames=self.frames,
            drawing=LinkDrawing(None),
        )  # fmt: skip


def _pose(origin: Any = (0.0, 0.0, 0.0), quat_wxyz: Any = (1.0, 0.0, 0.0, 0.0)) -> FramePose:
    S: Float64Array = np.asarray(quaternion_to_matrix("quat", quat_wxyz, scalar_first=True), np.float64)
    return FramePose(exact_quarter_turns(S), np.array(origin, np.float64))
