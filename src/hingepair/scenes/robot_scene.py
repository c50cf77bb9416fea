"""Scenes of robots, and their results."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.results import missing_attribute_error
from hingepair.equations.quantities import ACCELERATION, QUANTITIES, VELOCITY, unit_of
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.bodies.hinge_load import TORQUE_PARTS
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.methods import count_operations
from hingepair.mechanism.states import Energy, FrameState, MechanismForces, MechanismState, Momentum
from hingepair.motion.run import stop_overrun
from hingepair.motion.simulated import SimulatedRobotMotion
from hingepair.numeric.arrays import Float64Array, one_constant, read_only
from hingepair.plans.trees import FRAME_OUTPUTS
from hingepair.rotations.matrices import matrix_to_quaternion
from hingepair.scenes.forces import SceneForces, check_accelerations, robot_forces
from hingepair.scenes.instants import Rows
from hingepair.scenes.motions.joints import RATE_SUFFIXES, JointCoordinates, JointMotion, KnownJointMotion
from hingepair.scenes.motions.motion import LimitCounter
from hingepair.scenes.scene import Scene, ScenePlan, SceneResult
from hingepair.scenes.tables import Table

if TYPE_CHECKING:
    from hingepair.validation.report import CrossValidation

# Names of outputs, by what they are of.
_OF_FRAMES: Final = (*FRAME_OUTPUTS, "quat")  # quat is the quaternion (x, y, z, w) of S, w >= 0
_FRAME_DEFAULTS: Final = ("R", "S", "v", "omega", "a", "alpha")  # what the name of a frame alone requests
_COORDINATES: Final = ("q", "qd", "qdd")
_OF_JOINTS: Final = (*_COORDINATES, "tau")
_OF_BASE: Final = ("force1", "torque1")  # its load
_QUANTITIES: Final = (*_OF_FRAMES, *_OF_JOINTS, *_OF_BASE)  # all


def _order(quantity: str) -> int:
    return QUANTITIES[quantity].order


class RobotOutput(NamedTuple):
    """One requested output: a quantity of some frames or joints, or of the base."""

    quantity: str
    frames: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RobotResult(SceneResult):
    """Results of a robot's scene. An index selects the motion of one frame by its name.

    `result["tool"].R` is the position of a frame; `result.R` holds the positions of all frames, with an axis of
    frames behind the axis of samples; likewise S, v, omega, a, alpha. q, qd, qdd and tau have shape (samples, dof),
    in the order of `scene.mechanism.names`. force1 and torque1, shape (samples, 3), act on the base about its
    reference point.
    """

    state: MechanismState | None
    scene: RobotScene
    known: KnownJointMotion
    requested: tuple[RobotOutput, ...]
    #: the forces; None if none was requested
    forces: MechanismForces | None = None

    def requested_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the requested outputs by name, such as R_tool, tau_elbow, and, of q, qd and qdd, elbow, elbowd and
        elbowdd; shape (samples, ...). A quaternion has four arrays.
        """
        arrays: dict[str, NDArray[Any]] = {}
        columns = {name: i for i, name in enumerate(self.scene.mechanism.names)}
        for quantity, frames, joints in self.requested:
            for frame in frames:
                arrays |= self._frame_arrays(quantity, frame)
            for joint in joints:
                if quantity == "tau":
                    arrays[f"tau_{joint}"] = np.asarray(self.tau)[..., columns[joint]]
                else:
                    order = _COORDINATES.index(quantity)
                    arrays[joint + RATE_SUFFIXES[order]] = self.known.column(order, columns[joint])
            if quantity in _OF_BASE:
                arrays[quantity] = getattr(self, quantity)
        return arrays

    def energy(self) -> Energy:
        """Compute the kinetic and potential energy of the robot (equation T7), in the scene's gravity."""
        known = self._with_rates()
        arguments = known.arguments()[:2]
        return self.scene.mechanism.energy(*arguments, gravity=self.scene.gravity, base_motion=known.base)

    def momentum(self) -> Momentum:
        """Compute the linear and angular momentum of the robot (equation T8), about the world's origin."""
        known = self._with_rates()
        return self.scene.mechanism.momentum(*known.arguments()[:2], base_motion=known.base)

    def _with_rates(self) -> KnownJointMotion:
        if self.known.level < VELOCITY:
            raise ArgumentError("outputs", "some that need first derivatives, such as v", "none of them")
        return self.known

    def _frame_arrays(self, quantity: str, frame: str) -> dict[str, NDArray[Any]]:
        """Return a quantity of a frame by its output's name, a quaternion as four columns; empty if not computed."""
        if self.state is None:
            return {}
        if quantity == "quat":
            w, x, y, z = matrix_to_quaternion(np.asarray(self.state[frame].S, dtype=np.float64)).T
            return {f"quat_{frame}_{letter}": column for letter, column in zip("xyzw", (x, y, z, w), strict=True)}
        return {f"{quantity}_{frame}": np.asarray(getattr(self.state[frame], quantity))}

    def coincident_frames(self) -> dict[str, str]:
        """Return, by the frame, the earlier one with which it agrees exactly in all requested outputs."""
        motions: dict[str, list[NDArray[Any]]] = {}
        same = {}
        for frame in self.scene.frames:
            requested = [output.quantity for output in self.requested if frame in output.frames]
            motion = [array for quantity in requested for array in self._frame_arrays(quantity, frame).values()]
            alike = (
                earlier
                for earlier, other in motions.items()
                if len(motion) == len(other)
                and all(np.array_equal(a, b, equal_nan=True) for a, b in zip(motion, other, strict=True))
            )
            if motion and (earlier := next(alike, None)) is not None:
                same[frame] = earlier
            elif motion:
                motions[frame] = motion
        return same

    def __getitem__(self, frame: str) -> FrameState:
        """Return the motion of a frame that was computed."""
        if self.state is None:
            raise ArgumentError("frame", "no frame, since no output is of one", quoted(frame))
        state: FrameState = self.state[frame]
        return state

    def __getattr__(self, name: str) -> Any:
        if name in _COORDINATES:
            order = _COORDINATES.index(name)
            return self.known.array(order) if order <= self.known.level else None
        if name in {"tau", *_OF_BASE}:
            return None if self.forces is None else getattr(self.forces, name)
        if name in MechanismState.__slots__:
            return None if self.state is None else getattr(self.state, name)
        raise missing_attribute_error(self, name)

    def _of_what(self) -> str:
        return f"frames: {', '.join(self.state.frames) if self.state is not None else 'none'}"

    def _available_names(self) -> Iterable[str]:
        names = (*_COORDINATES, "tau", *_OF_BASE, *MechanismState.__slots__)
        return (*(name for name in names if getattr(self, name) is not None), "energy", "momentum")


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class RobotScene(Scene):
    """Scene of a robot."""

    motion: JointMotion
    #: the robot, with the frames and the payload of the file
    mechanism: Mechanism
    #: acceleration of free fall, world axes [m/s^2]; shape (3,)
    gravity: tuple[float, ...]
    #: whether springs, dampers and dry friction of the joints count among the forces
    joint_loads: bool
    #: frames that are computed by default, those of [mechanism.frames] or else the last links of the branches
    frames: tuple[str, ...]
    max_check_instants: ClassVar[int] = 501  # of a humanoid, some seconds
    _noted: ClassVar[str] = "q"

    def coordinates(self) -> JointCoordinates:
        """Return (q, qd, qdd) at all instants, each of shape (samples, dof) in the order of `mechanism.names`; None
        for derivatives that the motion does not have.
        """
        known = self.known(slice(len(self.times())), self.motion.level)
        return JointCoordinates(*(known.array(order) for order in range(known.level + 1)))

    def base_motion(self) -> BodyMotion | None:
        """Return the motion of the base at all instants, which methods of the robot take as `base_motion`; None if it
        rests at the origin.
        """
        return self.known(slice(len(self.times())), self.motion.level).base

    def known(self, rows: Rows, order: int) -> KnownJointMotion:
        """Return the motion of joints and base at some of the instants, with derivatives up to `order`."""
        return self.motion.part(rows, order)

    def unit(self, name: str) -> str:
        """Return the unit of an output, or of one of its components, such as R_tool_x or tau_elbow."""
        for joint in tree_of(self.mechanism).coordinates:
            if name == f"tau_{joint.name}":
                return joint.effort_unit
            for ending, per in zip(RATE_SUFFIXES, ("", "/s", "/s^2"), strict=True):
                if name == joint.name + ending:
                    return joint.unit + per
        quantity, _, _ = name.partition("_")
        return unit_of(quantity)

    def request(self, outputs: Iterable[str] | None) -> tuple[RobotOutput, ...]:
        """Return the requested outputs; by default those that the scene names, or else the motion of its frames and
        moving joints.
        """
        level = self.motion.level
        names = self.outputs if outputs is None else outputs
        if names is None:
            of_frames = [RobotOutput(name, self.frames) for name in _FRAME_DEFAULTS if _order(name) <= level]
            moving = self.motion.moving
            of_joints = [RobotOutput(name, (), moving) for name in _COORDINATES if _order(name) <= level]
            return (*of_frames, *of_joints)
        try:
            requested = [] if isinstance(names, str) else list(names)
        except TypeError:
            requested = []
        if not requested:
            raise ArgumentError("outputs", f"names out of {', '.join(_QUANTITIES)}, or of frames", quoted(names))
        return tuple(output for name in requested for output in self._parse_output(name))

    def _parse_output(self, name: object) -> Iterator[RobotOutput]:
        """Yield what one name requests: a quantity such as R or tau, a frame, or both such as R_tool."""
        quantity, _, owner = name.partition("_") if isinstance(name, str) else ("", "", "")
        level, robot = self.motion.level, self.mechanism
        if name in _OF_FRAMES:
            requested = [RobotOutput(str(name), self.frames)]
        elif name in _QUANTITIES:
            requested = [RobotOutput(str(name), (), robot.names if name in _OF_JOINTS else ())]
        elif isinstance(name, str) and tree_of(robot).frame(name) is not None:
            requested = [RobotOutput(kind, (name,)) for kind in _FRAME_DEFAULTS if _order(kind) <= level]
        elif quantity in _OF_FRAMES and tree_of(robot).frame(owner) is not None:
            requested = [RobotOutput(quantity, (owner,))]
        elif quantity == "tau" and owner in robot.names:
            requested = [RobotOutput(quantity, (), (owner,))]
        else:
            known = (*_QUANTITIES, *robot.links, *tree_of(robot).frames)
            close = nearest(str(name), (*known, *(f"tau_{joint}" for joint in robot.names)))
            several = f", or both such as R_{self.frames[0]}" if self.frames else ""
            raise ArgumentError("outputs", choices(known) + several + close, quoted(name))
        for output in requested:
            if _order(output.quantity) > level:
                possible = choices([kind for kind in _QUANTITIES if _order(kind) <= level])
                raise ArgumentError("outputs", possible + self.motion.hint, quoted(name))
        yield from requested

    def _evaluated(self, rows: Rows, request: tuple[RobotOutput, ...], min_order: int = 0) -> RobotResult:
        known = self.known(rows, max([*(_order(output.quantity) for output in request), min_order]))
        frames, of_frames, acting = _needed_quantities(request)
        state = forces = None
        if frames:
            order = max(_order(name) for name in of_frames)
            arguments = known.arguments()[: order + 1]
            state = self.mechanism.forward_kinematics(
                *arguments, frames=frames, outputs=of_frames, base_motion=known.base, backend=self.backend
            )
        if acting:
            forces = self.inverse_dynamics(known, rows, acting, backend=self.backend)
        first = (rows.start or 0) if isinstance(rows, slice) else 0
        t = np.asarray(read_only(self.instants[rows]))
        return RobotResult(t, state, self, known, request, first, forces)

    def inverse_dynamics(
        self,
        known: KnownJointMotion,
        rows: Rows,
        outputs: tuple[str, ...] | None = None,
        *,
        robot: Mechanism | None = None,
        gravity: tuple[float, ...] | None = None,
        backend: str = "auto",
    ) -> MechanismForces:
        """Compute the efforts of motors and the load on the base (equations T1 to T3) beside all other loads of the
        scene: those on links and, in a simulated motion, springs, dampers, friction and stops of the joints.

        Args:
            known: the motion at the instants with the indices `rows`.
            rows: these indices.
            outputs: names out of tau, force1 and torque1; None for all.
            robot: a robot with other masses, which may have an axis of variants; by default that of the scene.
            gravity: by default that of the scene.
            backend: "auto", "numpy" or "compiled".
        """
        simulated = self.motion.simulated
        wrenches = {} if simulated is None else simulated.wrenches
        forces = (robot or self.mechanism).inverse_dynamics(
            *known.arguments(),
            gravity=self.gravity if gravity is None else gravity,
            wrenches={link: (force[rows], torque[rows]) for link, (force, torque) in wrenches.items()} or None,
            joint_loads=self.joint_loads and simulated is None,  # those of a simulated motion are known
            base_motion=known.base,
            outputs=outputs,
            backend=backend,
        )
        if simulated is None or forces.tau is None:
            return forces
        others = [simulated.loads[part][rows] for part in TORQUE_PARTS if part != "motor" and part in simulated.loads]
        arrays = forces.arrays() | {"tau": forces.tau - sum(others)}
        return type(forces)(arrays, forces.shape)

    def plan(self, outputs: Iterable[str] | None = None) -> ScenePlan:
        """Return what `evaluate` would compute and skip, and why, as an object whose text says so.

        Args:
            outputs: as for `evaluate`.
        """
        request = self.request(outputs)
        order = max(_order(output.quantity) for output in request)
        known = self.known(np.zeros(2, dtype=np.intp), order)  # a single sample would be a known constant
        frames, of_frames, acting = _needed_quantities(request)
        counts = []
        if frames:
            arguments = known.arguments()[: 1 + max(_order(name) for name in of_frames)]
            counts.append(count_operations(self.mechanism, arguments, of_frames, frames, known.base))
        if acting:
            counts.append(count_operations(self.mechanism, known.arguments(), acting, base_motion=known.base))
        still = [name for i, name in enumerate(self.mechanism.names) if not np.ndim(known.derivatives[0][i])]
        names = (*(f"{name}_{frame}" for frame in frames for name in of_frames), *acting)
        return ScenePlan.of(names, counts, order, self.motion.level, still)

    def arrays(self, outputs: Iterable[str] | None = None) -> dict[str, NDArray[Any]]:
        """Return outputs by name; shape (samples, ...)."""
        found: dict[str, NDArray[Any]] = self.evaluate(outputs).requested_arrays()
        return found

    def _compared(self, rows: Rows) -> CrossValidation:
        from hingepair.validation.cross_validate import compare_loads, compare_rates, cross_validate

        known, motion = self.known(rows, self.motion.level), self.motion.simulated
        report: CrossValidation = cross_validate(
            self.mechanism, *known.arguments(), base_motion=known.base, gravity=self.gravity
        )
        if motion is None:
            return report
        forces = compare_loads(
            self.mechanism, known.array(0), known.array(1), known.array(2),
            known.base, self.gravity, {name: load[rows] for name, load in motion.loads.items()}, motion.base,
        )  # fmt: skip
        whole = self.known(slice(self.samples), ACCELERATION)
        rates = compare_rates(self.instants[:], [whole.array(order) for order in range(3)], self.mechanism.names)
        return replace(report, forces=(*forces, *rates), notes=self.motion.error_notes(report.u))

    def _forces(self, t: Float64Array, gravity: ArrayLike | None, record: dict[str, Any]) -> SceneForces:
        if gravity is not None and self.motion.simulated is not None:
            expected = "None, since the motion is simulated in the gravity of the scene"
            raise ArgumentError("gravity", expected, gravity)
        fall = self.gravity if gravity is None else tuple(one_constant("gravity", gravity, 3).tolist())
        check_accelerations(self.motion)
        rows = slice(len(t))
        known = self.known(rows, ACCELERATION)
        acting = self.inverse_dynamics(known, rows, gravity=fall)
        return robot_forces(self.mechanism, self.motion, known, acting, t, fall, record, self.joint_loads)

    def watches(self) -> list[LimitCounter]:
        """Return counters of the joints' positions and, where they are limited, rates."""
        watches, free = [], (-math.inf, math.inf)
        for i, joint in enumerate(tree_of(self.mechanism).coordinates):
            limits = [joint.position_limits]
            if self.motion.level and np.isfinite(joint.rate_limit):
                limits.append((-joint.rate_limit, joint.rate_limit))
            for order, own in enumerate(limits):
                unit = self.unit(joint.name + RATE_SUFFIXES[order])
                stops = self.motion.stops[i] if self.motion.stops and not order else free
                watches.append(LimitCounter(joint.name + "'" * order, own, unit, _column(order, i), stops))
        return watches

    def last_notes(self, _watches: Sequence[LimitCounter]) -> Iterable[str]:
        """Return sentences on soft stops and on the motion itself."""
        motion = self.motion
        if motion.simulated is not None and motion.stops:
            joints = zip(tree_of(self.mechanism).coordinates, motion.stops, motion.simulated.q_range, strict=True)
            for joint, stops, (least, most) in joints:
                if soft := stop_overrun(joint.name, joint.unit, stops, float(least), float(most)):
                    yield f"{soft}; stop_stiffness hardens them"
        yield from motion.notes
        if math.isnan(motion.error_estimate):
            yield motion.doubt

    def angle_limits(self) -> dict[str, Sequence[float]]:
        """Return the limits of the hinges by name."""
        joints = tree_of(self.mechanism).coordinates
        return {joint.name: joint.position_limits for joint in joints if joint.unit == "rad"}

    def _sizes(self, rows: Rows) -> tuple[Float64Array, Any, Any]:
        """Return the largest rate of a joint at each instant; there is no body 1."""
        known = self.known(rows, VELOCITY)
        rates = np.max([np.abs(known.column(1, i)) for i in range(len(known.names))], axis=0, initial=0.0)
        return np.broadcast_to(rates, (known.count,)), None, None

    def is_moved_by(self, keys: Sequence[Sequence[str | int]]) -> bool:
        """Return whether the motion may depend on numbers of the file: payloads, and what joints are, do not
        move it.
        """
        if self.motion.simulated is not None:
            return True
        resting = ("u1", "u2", "n", "home", "body1", "body2")
        of_joints = all(steps[0] == "joint" and (len(steps) <= 2 or steps[2] in resting) for steps in keys)
        return not of_joints and any(tuple(steps[:2]) != ("mechanism", "payload") for steps in keys)

    def require_pair(self) -> Any:
        """Raise an ArgumentError: the scene is none of a pair."""
        self.tables.refuse("pair", "the scene of a pair, which has a table [pair]", "the scene of a mechanism")

    def _subject(self) -> str:
        robot, moving = self.mechanism, self.motion.moving
        rest = f", {robot.dof - len(moving)} rest" if len(moving) < robot.dof else ""
        names = ", ".join(moving) or "none"
        return f"{robot.name}: {robot.dof} joints, {robot.base} base; moving: {names}{rest}"

    def _own_facts(self) -> dict[str, Any]:
        robot = self.mechanism
        facts = {"name": robot.name, "base": robot.base, "joints": robot.names, "frames": self.frames}
        return {"mechanism": facts, "moving": self.motion.moving}

    def _motion_rows(self) -> list[tuple[str, str]]:
        robot = self.mechanism
        return [
            ("mechanism", f"{robot.name}, {robot.dof} joints, {robot.base} base"),
            ("motion", f"{self.motion.description}, of {', '.join(self.motion.moving) or 'no joint'}"),
            ("frames", ", ".join(self.frames)),
            ("outputs", ", ".join(self.outputs or ("the motion of frames and joints",))),
        ]


def scene_of_simulation(found: SimulatedRobotMotion) -> RobotScene:
    """Return a simulated motion of a robot as a scene, for pictures; it has no file, and stops are not noted."""
    from hingepair.scenes.motions.simulated_joints import joint_motion

    robot = found.robot
    return RobotScene(
        path=Path(robot.name), title=found.described, motion=joint_motion(found, {}), outputs=None,
        constants={}, files=(), tables=Table(robot.name, "", {}, {}), mechanism=robot, gravity=found.gravity,
        frames=found.state().frames, joint_loads=False,
    )  # fmt: skip


def _column(order: int, joint: int) -> Any:
    return lambda known: known.column(order, joint)


def _needed_quantities(
    outputs: tuple[RobotOutput, ...],
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return the names of the frames, of their quantities and of the forces that outputs need; a quaternion needs the
    attitude S.
    """
    frames = tuple(dict.fromkeys(frame for output in outputs for frame in output.frames))
    named = {"S" if output.quantity == "quat" else output.quantity for output in outputs}
    of_frames = tuple(name for name in _OF_FRAMES if name in named)
    return frames, of_frames, tuple(name for name in ("tau", *_OF_BASE) if name in named)
