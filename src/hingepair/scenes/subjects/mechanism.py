"""A mechanism in a scene: its outputs, forces and comparison with Pinocchio."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple, NoReturn

import numpy as np

from hingepair.equations.quantities import QUANTITIES, unit_of
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.robots.methods import requests_of
from hingepair.mechanism.robots.requests import count_operations
from hingepair.mechanism.states import MechanismForces, MechanismState
from hingepair.plans.trees import FRAME_OUTPUTS
from hingepair.rotations.matrices import matrix_to_quaternion
from hingepair.scenes.motions.known import RATE_SUFFIXES, Known
from hingepair.scenes.motions.motion import Motion
from hingepair.scenes.subjects.subject import Acting, Arrays, Computed, Plan, SubjectBase, compared_rates
from hingepair.scenes.tables import Table

if TYPE_CHECKING:
    from hingepair.validation.report import CrossValidation

# Names of outputs, by what they are of.
_OF_FRAMES: Final = (*FRAME_OUTPUTS, "quat")  # quat is the quaternion (x, y, z, w) of S, w >= 0
_FRAME_DEFAULTS: Final = ("R", "S", "v", "omega", "a", "alpha")  # what the name of a frame alone requests
_COORDINATES: Final = ("q", "qd", "qdd")
_OF_JOINTS: Final = (*_COORDINATES, "tau")
_FORCES: Final = ("tau", "force1", "torque1")
_OF_LOGS: Final = ("columns", "ignore", "smooth", "loss", "gaps", "frame")  # keys of [motion]
_OF_STRUTS: Final = {"length": "m", "rate": "m/s", "force": "N"}  # with their units
_QUANTITIES: Final = (*_OF_FRAMES, *_OF_JOINTS, *_FORCES[1:])  # all but those of struts


def _order(quantity: str) -> int:
    return int(quantity != "length") if quantity in _OF_STRUTS else QUANTITIES[quantity].order


class Output(NamedTuple):
    """One requested output: a quantity of some frames, joints or struts, or of the base."""

    quantity: str
    frames: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    struts: tuple[str, ...] = ()


Request = tuple[Output, ...]


class MechanismSubject(SubjectBase):
    """A mechanism, with the frames and the payload of the file.

    Args:
        mechanism: the mechanism.
        frames: frames that are computed by default, those of the file or else the last links of the branches.
    """

    max_check_instants: ClassVar[int] = 501  # of a humanoid, some seconds
    pair: None = None

    def __init__(self, mechanism: Mechanism, frames: tuple[str, ...]) -> None:
        self.mechanism = self.robot = mechanism
        self.frames = frames

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.mechanism.name

    @property
    def struts(self) -> tuple[str, ...]:
        """Names of the struts but those that are coordinates."""
        return tuple(s.name for s in tree_of(self.mechanism).struts if s.name not in self.names)

    def check_motion_keys(self, motion: Table, further: Collection[str] = ()) -> None:
        """Refuse keys of [motion] other than joints, coordinates of the base and `sequence`, with what they are."""
        for key in _OF_LOGS:
            if key in motion.values:
                motion.fail(key, "no such key without file = ..., whose samples it concerns")
        for key in motion.values:
            if key not in self.names and key not in (*self.base_names, "sequence"):
                self.refuse_joint(motion, key, further[:1] if isinstance(further, tuple) else ())

    def refuse_joint(self, motion: Table, key: str, further: tuple[str, ...] = ()) -> NoReturn:
        """Raise a SceneError for a key of a Table that is not a movable joint of the robot."""
        tree = tree_of(self.mechanism)
        for joint in tree.joints:
            if joint.name == key and joint.mimic is not None:
                leader = tree.joints[joint.mimic.leader - 1].name
                motion.refuse(key, "a joint that moves by itself", f"one that follows {leader!r}, which may be moved")
        if tree.closure is not None and key in {joint.name for joint in tree.joints}:
            motion.refuse(key, choices(self.names), f"{quoted(key)}, which follows them (coordinates in [mechanism])")
        if key in tree.frames or key in self.mechanism.links:
            got = "a link, or a joint that is fixed or locked"
            motion.refuse(key, f"a joint that moves, {choices(self.names)}", got)
        known_keys = (*self.names, *further)
        expected = choices(self.names) if self.names else "no joint, since none moves"
        got = f"{quoted(key)}, which is no joint of {self.name}"
        motion.refuse(key, expected + nearest(key, known_keys), got)

    def check_joint_names(self, table: Table, options: Collection[str]) -> None:
        """Raise a SceneError if a joint has the name of an option of the Table [motion] or [dynamics], or a name for
        which a column of a log would have two meanings.
        """
        columns = {"t": "the instants"}
        for name in self.names:
            if name in options:
                expected = f"joints of other names: this one is a key of [{table.name}]"
                table.refuse(name, expected, f"a joint {name!r}")
            for ending in RATE_SUFFIXES:
                column = name + ending
                if column in columns or self._is_output(column):
                    held = columns.get(column, "an output")
                    wanted = f"joints of other names: column {column} of a file holds {held}"
                    table.refuse(name, wanted, f"a joint {name!r}")
                columns[column] = f"q{ending} of {name!r}"

    def _is_output(self, column: str) -> bool:
        """Return whether a column of a file is an output other than a joint's coordinates, such as R_tool_x."""
        quantity, _, owner = column.partition("_")
        if quantity in _OF_STRUTS and owner in self.struts:
            return True
        owners = {*self.mechanism.links, *tree_of(self.mechanism).frames, *self.names}
        return quantity in {*_OF_FRAMES, *_FORCES} and (
            quantity in _FORCES[1:] or bool(owners & {owner, owner.rpartition("_")[0]})
        )

    def unit(self, name: str) -> str:
        """Return the unit of an output, or of one of its components, such as R_tool_x or tau_elbow."""
        for joint in self.joints:
            if name == f"tau_{joint.name}":
                return joint.effort_unit
            for ending, per in zip(RATE_SUFFIXES, ("", "/s", "/s^2"), strict=True):
                if name == joint.name + ending:
                    return joint.unit + per
        quantity, _, owner = name.partition("_")
        return _OF_STRUTS[quantity] if owner in self.struts and quantity in _OF_STRUTS else unit_of(quantity)

    def request(self, outputs: Iterable[str] | None, motion: Motion) -> Request:
        """Return the requested outputs, by default the motion of the scene's frames and of the joints that move."""
        level = motion.level
        if outputs is None:
            of_frames = [Output(name, self.frames) for name in _FRAME_DEFAULTS if _order(name) <= level]
            of_joints = [Output(name, (), motion.moving) for name in _COORDINATES if _order(name) <= level]
            return (*of_frames, *of_joints, *self._of_struts(self.struts, level))
        try:
            requested = [outputs] if isinstance(outputs, str) else list(outputs)
        except TypeError:
            requested = []
        if not requested:
            raise ArgumentError("outputs", f"names out of {', '.join(_QUANTITIES)}, or of frames", quoted(outputs))
        return tuple(output for name in requested for output in self._parse_output(name, motion))

    def _of_struts(self, names: tuple[str, ...], level: int) -> list[Output]:
        """Return all quantities of struts."""
        return [Output(kind, struts=names) for kind in _OF_STRUTS if names and _order(kind) <= level]

    def _parse_output(self, name: object, motion: Motion) -> Iterator[Output]:
        """Yield what one name requests: a quantity such as R or tau, a frame or strut, or both such as R_tool."""
        quantity, _, owner = name.partition("_") if isinstance(name, str) else ("", "", "")
        level, robot = motion.level, self.mechanism
        if name in _OF_FRAMES:
            requested = [Output(str(name), self.frames)]
        elif name in _QUANTITIES:
            requested = [Output(str(name), (), robot.names if name in _OF_JOINTS else ())]
        elif isinstance(name, str) and tree_of(robot).frame(name) is not None:
            requested = [Output(kind, (name,)) for kind in _FRAME_DEFAULTS if _order(kind) <= level]
        elif quantity in _OF_FRAMES and tree_of(robot).frame(owner) is not None:
            requested = [Output(quantity, (owner,))]
        elif quantity == "tau" and owner in robot.names:
            requested = [Output(quantity, (), (owner,))]
        elif name in self.struts:
            requested = self._of_struts((str(name),), level)
        elif quantity in _OF_STRUTS and (owner in self.struts or (self.struts and not owner)):
            requested = [Output(quantity, struts=(owner,) if owner else self.struts)]
        else:
            of_struts = (f"{kind}_{strut}" for kind in _OF_STRUTS for strut in self.struts)
            known = (*_QUANTITIES, *robot.links, *tree_of(robot).frames, *of_struts)
            close = nearest(str(name).replace(".", "_"), (*known, *(f"tau_{joint}" for joint in robot.names)))
            several = f", or both such as R_{self.frames[0]}" if self.frames else ""
            raise ArgumentError("outputs", choices(known) + several + close, quoted(name))
        for output in requested:
            if _order(output.quantity) > level:
                possible = choices([kind for kind in _QUANTITIES if _order(kind) <= level])
                raise ArgumentError("outputs", possible + motion.hint, quoted(name))
        yield from requested

    def order(self, request: Request, level: int) -> int:  # noqa: ARG002
        """Return the order of the derivatives that a request needs."""
        return max((_order(output.quantity) for output in request), default=0)

    def compute(self, request: Request, known: Known, acting: Acting, backend: str) -> Computed:
        """Compute the motion of the requested frames, and the requested forces."""
        frames, of_frames, forces = _needed(request)
        state = found = None
        if frames:
            arguments = known.arguments()[: max(map(_order, of_frames)) + 1]
            state = self.mechanism.forward_kinematics(
                *arguments, frames=frames, outputs=of_frames, base_motion=known.base_motion, backend=backend
            )
        if forces:
            found = self.efforts(known, acting, forces, backend=backend)
        of_struts = any(output.struts for output in request)
        return Computed(
            state, found, self.mechanism.struts(*known.arguments()[:2], backend=backend) if of_struts else {}
        )

    def efforts(
        self,
        known: Known,
        acting: Acting,
        outputs: tuple[str, ...] = _FORCES,
        *,
        robot: Mechanism | None = None,
        backend: str = "auto",
    ) -> MechanismForces:
        """Compute the efforts of motors and the load on the base (equations T1 to T3) beside all other loads.

        Args:
            known: the motion, with accelerations.
            acting: what acts beside motors.
            outputs: names out of tau, force1 and torque1.
            robot: a robot with other masses, which may have an axis of variants; by default that of the scene.
            backend: "auto", "numpy" or "compiled".
        """
        forces = (robot or self.mechanism).inverse_dynamics(
            *known.arguments(),
            gravity=acting.gravity,
            wrenches=acting.wrenches(known),
            joint_loads=False,  # they are among what acts
            base_motion=known.base_motion,
            outputs=outputs,
            backend=backend,
        )
        others = [*acting.parts(known).values()] if "tau" in outputs else []
        if not others:
            return forces
        return type(forces)(forces.arrays() | {"tau": forces.tau - sum(others)}, forces.shape)

    def arrays(self, request: Request, known: Known, computed: Computed) -> Arrays:
        """Return the requested outputs by name, such as R_tool, tau_elbow, and, of q, qd and qdd, elbow, elbowd and
        elbowdd; a quaternion has four arrays.
        """
        arrays: Arrays = {}
        columns = {name: i for i, name in enumerate(self.names)}
        for quantity, frames, joints, struts in request:
            for frame in frames:
                arrays |= _frame_arrays(computed.state, quantity, frame)
            for joint in joints:
                if quantity == "tau":
                    arrays[f"tau_{joint}"] = np.asarray(computed.forces.tau)[..., columns[joint]]
                else:
                    order = _COORDINATES.index(quantity)
                    arrays[joint + RATE_SUFFIXES[order]] = known.column(order, columns[joint])
            arrays |= {f"{quantity}_{strut}": getattr(computed.struts[strut], quantity) for strut in struts}
            if quantity in _FORCES[1:]:
                arrays[quantity] = getattr(computed.forces, quantity)
        return arrays

    def attribute(self, name: str, known: Known, computed: Computed) -> Any:
        """Return coordinates, forces or an attribute of the state of the frames."""
        if name in _COORDINATES:
            order = _COORDINATES.index(name)
            return known.array(order) if order <= known.level else None
        if name in _FORCES:
            return None if computed.forces is None else getattr(computed.forces, name)
        if name in MechanismState.__slots__:
            return None if computed.state is None else getattr(computed.state, name)
        raise KeyError(name)

    def plan(self, request: Request, motion: Motion) -> Plan:
        """Return the programs that compute a request."""
        order = self.order(request, motion.level)
        known = motion.source.part(np.zeros(2, dtype=np.intp), order)  # a single sample would be a known constant
        frames, of_frames, forces = _needed(request)
        counts, base = [], known.base_motion
        if frames:
            arguments = known.arguments()[: 1 + max(map(_order, of_frames))]
            counts.append(count_operations(requests_of(self.mechanism), arguments, of_frames, frames, base))
        if forces:
            given = known.arguments()
            counts.append(count_operations(requests_of(self.mechanism), given, forces, base_motion=base))
        return Plan((*(f"{name}_{frame}" for frame in frames for name in of_frames), *forces), counts, order)

    @property
    def force_names(self) -> tuple[str, ...]:
        """None: forces are outputs."""
        return ()

    def forces(self, known: Known, acting: Acting) -> Arrays:
        """Return tau of each joint, such as tau_elbow, lengths and forces of struts, and the load on the base."""
        found = self.efforts(known, acting)
        tau = np.asarray(found.tau, dtype=np.float64)
        own: Arrays = {f"tau_{name}": tau[:, i] for i, name in enumerate(self.names)}
        struts = self.mechanism.struts(*known.arguments()[:2]) if self.struts else {}
        for name, strut in struts.items():
            own |= {f"length_{name}": np.asarray(strut.length), f"force_{name}": np.asarray(strut.force)}
        return own | {"force1": found.force1, "torque1": found.torque1}

    def compare(self, known: Known, acting: Acting) -> CrossValidation:
        """Compare the robot, and what acts in a simulated motion, with Pinocchio."""
        from hingepair.validation import cross_validate as validation

        base, motion = known.base_motion, acting.motion
        report: CrossValidation = validation.cross_validate(
            self.mechanism, *known.arguments(), base_motion=base, gravity=acting.gravity
        )
        if motion.simulated is None:
            return report
        notes, rates = motion.error_notes(report.u), compared_rates(motion, self.names)
        if tree_of(self.mechanism).closure is not None or tree_of(self.mechanism).struts:
            left_out = "what acts beside loops and struts is not compared; hingepair run --energy shows its balance"
            return replace(report, forces=(*report.forces, *rates), notes=(*report.notes, *notes, left_out))
        q, qd, qdd = (known.array(order) for order in range(3))
        forces = validation.compare_loads(
            self.mechanism, q, qd, qdd, base, acting.gravity, acting.loads(), motion.simulated.base
        )
        return replace(report, forces=(*forces, *rates), notes=notes)

    def describe(self, moving: tuple[str, ...]) -> str:
        """Return a line on the joints that move."""
        robot = self.mechanism
        rest = f", {robot.dof - len(moving)} rest" if len(moving) < robot.dof else ""
        return f"{robot.name}: {_size(robot)}, {robot.base} base; moving: {', '.join(moving) or 'none'}{rest}"

    def facts(self, motion: Motion) -> dict[str, Any]:
        """Return names of the mechanism, its joints and frames."""
        robot = self.mechanism
        facts = {"name": robot.name, "base": robot.base, "joints": robot.names, "frames": self.frames}
        return {"mechanism": facts, "moving": motion.moving}


def _size(robot: Mechanism) -> str:
    """Return how many joints, or coordinates, joints and loops, a robot has, in words."""
    own = len(tree_of(robot).own_coordinates)
    counts = (
        {"coordinate": robot.dof, "joint": own, "loop": len(robot.loops)} if robot.loops else {"joint": robot.dof}
    )
    return ", ".join(f"{count} {name}{'s' * (count != 1)}" for name, count in counts.items())


def _frame_arrays(state: Any, quantity: str, frame: str) -> Arrays:
    """Return a quantity of a frame by its output's name, a quaternion as four columns; empty if not computed."""
    if state is None:
        return {}
    if quantity == "quat":
        w, x, y, z = matrix_to_quaternion(np.asarray(state[frame].S, dtype=np.float64)).T
        return {f"quat_{frame}_{letter}": column for letter, column in zip("xyzw", (x, y, z, w), strict=True)}
    return {f"{quantity}_{frame}": np.asarray(getattr(state[frame], quantity))}


def _needed(request: Request) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return the names of the frames, of their quantities and of the forces that outputs need; a quaternion needs the
    attitude S.
    """
    frames = tuple(dict.fromkeys(frame for output in request for frame in output.frames))
    named = {"S" if output.quantity == "quat" else output.quantity for output in request}
    of_frames = tuple(name for name in _OF_FRAMES if name in named)
    return frames, of_frames, tuple(name for name in _FORCES if name in named)
