"""The scene of a mechanism: what moves, how, and when to look; evaluated, compared with Pinocchio, and its forces."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.loops import OperationCounts
from hingepair.engine.results import missing_attribute_error
from hingepair.errors import ArgumentError, SceneError, choices, nearest, quoted
from hingepair.integration.trajectory import describe_instants
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.states import FrameState, MechanismForces, MechanismState
from hingepair.numeric.arrays import Frozen, one_constant, read_only
from hingepair.numeric.tables import Sheet, cell_text, unit_of
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.dynamics import GRAVITY, Energy, Momentum
from hingepair.pair.results import Result
from hingepair.plans.plan import ACCELERATION, POSE, VELOCITY
from hingepair.rotations.matrices import matrix_to_quaternion
from hingepair.scenes.instants import Instants, Rows, Sampled
from hingepair.scenes.known_motion import DERIVATIVE_ORDINALS
from hingepair.scenes.log_noise import noise_rows
from hingepair.scenes.mechanisms.forces import JointNoise, MechanismSceneForces, mechanism_scene_forces
from hingepair.scenes.mechanisms.joint_motion import (
    RATES,
    JointCoordinates,
    JointMotion,
    KnownJoints,
    read_joint_motion,
)
from hingepair.scenes.mechanisms.mechanism_table import read_gravity, read_mechanism
from hingepair.scenes.motion import LimitWatch, constant_suspicions, kink_sentences
from hingepair.scenes.tables import Table

if TYPE_CHECKING:
    from hingepair.validation.robot_report import RobotValidation

_FRAME_LEVELS: Final = {
    **dict.fromkeys(("R", "S", "quat", "d"), POSE),
    **dict.fromkeys(("v", "omega"), VELOCITY),
    **dict.fromkeys(("a", "alpha"), ACCELERATION),
}
"""What there is of a frame, by the derivatives that it needs; quat is the quaternion (x, y, z, w) of S, w >= 0."""
FRAME_QUANTITIES: Final = tuple(_FRAME_LEVELS)
"""Quantities that a frame has; an output is named by one of them and the frame, such as R_tool."""
_OF_A_FRAME: Final = ("R", "S", "v", "omega", "a", "alpha")
"""What is computed of a frame unless it is named."""
_COORDINATE_OUTPUTS: Final = ("q", "qd", "qdd")
"""Outputs that are coordinates of the joints, and their derivatives by order."""
_JOINT_OUTPUT_LEVELS: Final = {"q": POSE, "qd": VELOCITY, "qdd": ACCELERATION, "tau": ACCELERATION}
"""Derivatives that outputs with a value for each joint need."""
_BASE_OUTPUT_LEVELS: Final = dict.fromkeys(("force1", "torque1"), ACCELERATION)
"""Derivatives that the force and the torque on the base need."""
_MECHANISM_OUTPUT_LEVELS: Final = {**_FRAME_LEVELS, **_JOINT_OUTPUT_LEVELS, **_BASE_OUTPUT_LEVELS}
"""Derivatives that each output of a scene of a mechanism needs; frames' outputs by their quantity."""
MECHANISM_OUTPUTS: Final = tuple(_MECHANISM_OUTPUT_LEVELS)
"""Quantities that a scene of a mechanism can be asked for."""


class MechanismOutput(NamedTuple):
    """One output of a scene.

    Attributes:
        quantity: R, S, quat, d, v, omega, a or alpha of a frame; q, qd, qdd or tau of joints; force1, torque1.
        frames: names of the frames; empty of what is no quantity of a frame.
        joints: names of the joints; empty of what is no quantity of joints.
    """

    quantity: str
    frames: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MechanismSceneResult(Frozen, Result):
    """A scene of a mechanism, evaluated: `t`, `state`, and what was asked for.

    `result["tool"].R` is the position of a frame, `result.R` that of all frames with an axis of frames behind the
    samples; likewise S, v, omega, a, alpha. q, qd, qdd and tau have shape (samples, dof), in the order of
    `scene.mechanism.names`; force1 and torque1, (samples, 3), act on the base about its reference point. What was
    not computed is None.

    Attributes:
        t: instants; shape (samples,) s.
        state: the MechanismState of the frames; None where none was asked for.
        forces: the MechanismForces; None where none was asked for.
        scene: where it comes from.
        known: the motion of the joints and of the base.
        outputs: what was asked for.
        first: number of the first instant; 0 but for blocks.
    """

    t: NDArray[np.float64]
    state: MechanismState | None
    forces: MechanismForces | None
    scene: MechanismScene
    known: KnownJoints
    outputs: tuple[MechanismOutput, ...]
    first: int = 0
    _inner: ClassVar[frozenset[str]] = Result._inner | {"chosen", "first", "known", "outputs"}

    @property
    def described(self) -> str:
        """The title of the scene."""
        return self.scene.title

    @property
    def inputs(self) -> tuple[Path, ...]:
        """The files of the scene, which `save` refuses to overwrite."""
        return self.scene.files

    def unit(self, name: str) -> str:
        """Return the unit of what is kept by a name, or of one of its components."""
        return self.scene.unit(name)

    def chosen(self) -> dict[str, NDArray[Any]]:
        """Return what was asked for, by name; shape (samples, ...).

        Names are R_tool, S_tool and so on; of q, qd and qdd each joint has an array of its own, named as in a log;
        of tau it is `tau_` and the joint's name.
        """
        arrays: dict[str, NDArray[Any]] = {}
        for quantity, frames, joints in self.outputs:
            for frame in frames:
                arrays |= self._of_frame(quantity, frame)
            columns = {name: i for i, name in enumerate(self.scene.mechanism.names)} if joints else {}
            for joint in joints:
                if quantity == "tau":
                    arrays[f"tau_{joint}"] = np.asarray(self.tau)[..., columns[joint]]
                else:
                    order = _COORDINATE_OUTPUTS.index(quantity)
                    arrays[joint + RATES[order]] = self.known.column(order, columns[joint])
            if quantity in _BASE_OUTPUT_LEVELS:
                arrays[quantity] = getattr(self, quantity)
        return arrays

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return what was asked for and the coordinates of all joints, by name; shape (samples, ...)."""
        names = self.scene.mechanism.names
        return self.chosen() | {name: self.known.column(0, i) for i, name in enumerate(names)}

    def energy(self) -> Energy:
        """Compute kinetic and potential energy at the instants (T7), in the scene's gravity.

        Raises:
            ArgumentError: no output has first derivatives.
        """
        robot, known = self.scene.mechanism, self._moved()
        return robot.energy(*known.arguments()[:2], gravity=self.scene.gravity, base_motion=known.base)

    def momentum(self) -> Momentum:
        """Compute linear and angular momentum at the instants (T8), about the origin.

        Raises:
            ArgumentError: no output has first derivatives.
        """
        known = self._moved()
        return self.scene.mechanism.momentum(*known.arguments()[:2], base_motion=known.base)

    def _moved(self) -> KnownJoints:
        """Return the motion, which must have first derivatives."""
        if self.known.level < VELOCITY:
            raise ArgumentError("outputs", "some that need first derivatives, such as v", "none of them")
        return self.known

    def _of_frame(self, quantity: str, frame: str) -> dict[str, NDArray[Any]]:
        """Return a quantity of a frame by name; of a quaternion each component by itself."""
        if self.state is None:
            return {}
        if quantity == "quat":
            w, x, y, z = matrix_to_quaternion(np.asarray(self.state[frame].S, dtype=np.float64)).T
            return {f"quat_{frame}_{letter}": column for letter, column in zip("xyzw", (x, y, z, w), strict=True)}
        return {f"{quantity}_{frame}": np.asarray(getattr(self.state[frame], quantity))}

    def __getitem__(self, frame: str) -> FrameState:
        """Return the motion of a frame.

        Raises:
            ArgumentError: the frame is not among those that were computed.
        """
        if self.state is None:
            raise ArgumentError("frame", "no frame, since no output is of one", quoted(frame))
        state: FrameState = self.state[frame]
        return state

    def __getattr__(self, name: str) -> Any:
        if name in _COORDINATE_OUTPUTS:
            order = _COORDINATE_OUTPUTS.index(name)
            return self.known.array(order) if order <= self.known.level else None
        if name in {"tau", *_BASE_OUTPUT_LEVELS}:
            return None if self.forces is None else getattr(self.forces, name)
        if name in MechanismState.__slots__:
            return None if self.state is None else getattr(self.state, name)
        raise missing_attribute_error(self, name)

    def __repr__(self) -> str:
        frames = ", ".join(self.state.frames) if self.state is not None else "none"
        return f"MechanismSceneResult({describe_instants(self.t)}, frames: {frames})"

    def _named(self) -> Iterable[str]:
        names = (*_COORDINATE_OUTPUTS, "tau", *_BASE_OUTPUT_LEVELS, *MechanismState.__slots__)
        return (*(name for name in names if getattr(self, name) is not None), "energy", "momentum")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MechanismScene(Sampled):
    """A mechanism, the motion of its joints and of its base, and the instants to evaluate it at.

    Attributes:
        path: the file it came from.
        title: what it is, in a sentence.
        mechanism: the robot, with the frames and the payload of the file.
        joint_motion: where the motion comes from; knows the instants.
        gravity: acceleration of free fall, world axes [m/s^2].
        frames: the frames that are computed unless others are named: those of [mechanism.frames], else the last links
            of the branches.
        outputs: what `evaluate` computes unless told, as in [outputs]; None for the motion of the frames and of the
            joints that move.
        constants: the named numbers of the file.
        files: the files that the scene was read from, as absolute paths: its own, its URDF file and its log.
        tables: what stands in the file, in which expressions are as they were written.
    """

    path: Path
    title: str
    mechanism: Mechanism
    joint_motion: JointMotion
    gravity: tuple[float, ...]
    frames: tuple[str, ...]
    outputs: tuple[str, ...] | None
    constants: Mapping[str, float]
    files: tuple[Path, ...]
    tables: Table

    def __repr__(self) -> str:
        return f"MechanismScene({str(self.path)!r}, {self.title!r}, samples={self.samples}, t={self.span})"

    def _sheet(self) -> Sheet:
        """Return the table of the scene: title, and rows of name, value and unit."""
        robot = self.mechanism
        rows = [
            ("mechanism", f"{robot.name}, {robot.dof} joints, {robot.base} base", ""),
            ("motion", f"{self.joint_motion.origin}, of {', '.join(self.joint_motion.moving) or 'no joint'}", ""),
            ("instants", str(self.samples), ""),
            ("t", self.span, "s"),
            ("frames", ", ".join(self.frames), ""),
            ("outputs", ", ".join(self.outputs or ("the motion of frames and joints",)), ""),
            *((name, cell_text(value), "") for name, value in self.constants.items()),
        ]
        return Sheet(self.title, (("", "value", "unit"), *rows))

    @property
    def instants(self) -> Instants:
        """The instants, held in memory or not [s]."""
        return self.joint_motion.t

    @property
    def t(self) -> NDArray[np.float64]:
        """The instants; shape (samples,) s.

        Raises:
            ArgumentError: there are too many to be held in memory.
        """
        return self.times()

    def motion(self) -> JointCoordinates:
        """Compute the joint coordinates q (samples, dof) and their derivatives at the instants of the scene.

        Returns:
            (q, qd, qdd), each of shape (samples, dof) in the order of `mechanism.names`; None for derivatives that a
            log does not have.
        """
        known = self.known(slice(len(self.times())), self.joint_motion.level)
        return JointCoordinates(*(known.array(order) for order in range(known.level + 1)))

    def base_motion(self) -> BodyMotion | None:
        """Compute the motion of the base at the instants; None where it rests at the origin.

        It is what the methods of the mechanism take as base_motion.
        """
        return self.known(slice(len(self.times())), self.joint_motion.level).base

    def known(self, rows: Rows, order: int) -> KnownJoints:
        """Return the motion of the joints and of the base at some of the instants.

        Args:
            rows: their numbers.
            order: the highest derivative.
        """
        return self.joint_motion.part(self.mechanism.names, rows, order)

    def unit(self, name: str) -> str:
        """Return the unit of an output, or of one of its components, by its name in a file: R_tool_x, tau_elbow."""
        for joint in self.mechanism.tree.coordinates:
            hinge = joint.kind == "hinge"
            if name == f"tau_{joint.name}":
                return "N m" if hinge else "N"
            for ending, per in zip(RATES, ("", "/s", "/s^2"), strict=True):
                if name == joint.name + ending:
                    return ("rad" if hinge else "m") + per
        quantity, _, _ = name.partition("_")
        return unit_of(quantity)

    def evaluate(self, outputs: Iterable[str] | None = None) -> MechanismSceneResult:
        """Compute the motion of the mechanism at the scene's instants.

        Args:
            outputs: quantities R, S, quat, d, v, omega, a, alpha of the scene's frames; a link, a joint or another
                frame by name, for all motion of it; both by a name such as R_tool; q, qd, qdd and tau of all joints,
                tau of one by a name such as tau_elbow;
                force1, torque1 on the base. Those of the scene file unless given, and without these the motion of the
                scene's frames and of the joints that move.

        Raises:
            ArgumentError: an unknown output, one that needs what the motion does not have, or more instants than can
                be held in memory.
        """
        return self._part(slice(len(self.times())), self.outputs_of(outputs))

    def sampled(self, most: int, outputs: Iterable[str] | None = None) -> MechanismSceneResult:
        """Compute the motion at a limited number of instants, evenly spread.

        Args:
            most: how many.
            outputs: as for `evaluate`.
        """
        return self._part(self.spread(most), self.outputs_of(outputs))

    def blocks(self, outputs: Iterable[str] | None = None) -> Iterator[MechanismSceneResult]:
        """Compute the motion in pieces of 131,072 instants, for motions longer than memory.

        The motion that a piece comes from, `known`, has rates where the scene has any.

        Args:
            outputs: as for `evaluate`.

        Raises:
            ArgumentError: as for `evaluate`, but for the number of instants.
        """
        chosen = self.outputs_of(outputs)
        for rows in self.block_rows():
            yield self._part(rows, chosen, min(self.joint_motion.level, VELOCITY))

    def _part(self, rows: Rows, outputs: tuple[MechanismOutput, ...], least: int = 0) -> MechanismSceneResult:
        """Compute the outputs at some instants; derivatives up to the order `least` are kept beside them."""
        levels = [_MECHANISM_OUTPUT_LEVELS[output.quantity] for output in outputs]
        known = self.known(rows, max([*levels, least]))
        how: dict[str, Any] = {"base_motion": known.base, "backend": self.backend}
        frames, wanted, acting = _needed_quantities(outputs)
        state = forces = None
        if frames:
            order = max(_FRAME_LEVELS[name] for name in wanted)
            state = self.mechanism.forward_kinematics(
                *known.arguments()[: order + 1], frames=frames, outputs=wanted, **how
            )
        if acting:
            forces = self.mechanism.inverse_dynamics(*known.arguments(), gravity=self.gravity, outputs=acting, **how)
        first = (rows.start or 0) if isinstance(rows, slice) else 0
        t = np.asarray(read_only(self.instants[rows]))
        return MechanismSceneResult(t, state, forces, self, known, outputs, first)

    def plan(self, outputs: Iterable[str] | None = None) -> MechanismPlan:
        """Return what `evaluate` computes and what it leaves out, and why; print it.

        Args:
            outputs: as for `evaluate`.

        Raises:
            ArgumentError: as for `evaluate`.
        """
        chosen = self.outputs_of(outputs)
        order = max(_MECHANISM_OUTPUT_LEVELS[output.quantity] for output in chosen)
        known = self.known(np.zeros(2, dtype=np.intp), order)  # a single sample would be a known constant
        frames, of_frames, acting = _needed_quantities(chosen)
        counted = {}
        if frames:
            arguments = known.arguments()[: 1 + max(_FRAME_LEVELS[name] for name in of_frames)]
            how: dict[str, Any] = {"outputs": of_frames, "frames": frames, "base_motion": known.base}
            counted[f"{', '.join(of_frames)} of {', '.join(frames)}"] = self.mechanism.count_operations(
                *arguments, **how
            )
        if acting:
            arguments = known.arguments()
            how = {"outputs": acting, "base_motion": known.base}
            counted[", ".join(acting)] = self.mechanism.count_operations(*arguments, **how)
        still = [name for i, name in enumerate(self.mechanism.names) if not np.ndim(known.derivatives[0][i])]
        return MechanismPlan(counted, tuple(still), order, self.joint_motion.level, known.base is None)

    def outputs_of(self, outputs: Iterable[str] | None) -> tuple[MechanismOutput, ...]:
        """Return the outputs that are asked for; those of the file unless given, else the motion of what moves.

        Args:
            outputs: as for `evaluate`.

        Raises:
            ArgumentError: as for `evaluate`.
        """
        level = self.joint_motion.level
        names = self.outputs if outputs is None else outputs
        if names is None:
            joints = self.joint_motion.moving
            of_frames = [
                MechanismOutput(name, self.frames) for name in _OF_A_FRAME if _MECHANISM_OUTPUT_LEVELS[name] <= level
            ]
            of_joints = [
                MechanismOutput(name, (), joints)
                for name in _COORDINATE_OUTPUTS
                if _MECHANISM_OUTPUT_LEVELS[name] <= level
            ]
            return (*of_frames, *of_joints)
        try:
            asked = [] if isinstance(names, str) else list(names)
        except TypeError:
            asked = []
        if not asked:
            raise ArgumentError(
                "outputs", f"names out of {', '.join(MECHANISM_OUTPUTS)}, or of frames", quoted(names)
            )
        return tuple(output for name in asked for output in self._output(name))

    def _output(self, name: object) -> Iterator[MechanismOutput]:
        """Yield what a name asks for."""
        quantity, _, frame = name.partition("_") if isinstance(name, str) else ("", "", "")
        level, robot = self.joint_motion.level, self.mechanism
        if name in _FRAME_LEVELS:
            asked = [MechanismOutput(str(name), self.frames)]
        elif name in _MECHANISM_OUTPUT_LEVELS:
            asked = [MechanismOutput(str(name), (), robot.names if name in _JOINT_OUTPUT_LEVELS else ())]
        elif isinstance(name, str) and robot.tree.frame(name) is not None:
            asked = [
                MechanismOutput(kind, (name,)) for kind in _OF_A_FRAME if _MECHANISM_OUTPUT_LEVELS[kind] <= level
            ]
        elif quantity in _FRAME_LEVELS and robot.tree.frame(frame) is not None:
            asked = [MechanismOutput(quantity, (frame,))]
        elif quantity == "tau" and frame in robot.names:
            asked = [MechanismOutput(quantity, (), (frame,))]
        else:
            known = (*MECHANISM_OUTPUTS, *robot.links, *robot.tree.frames)
            close = nearest(str(name), (*known, *(f"tau_{joint}" for joint in robot.names)))
            several = f"{choices(known)}, or both such as R_{self.frames[0]}" if self.frames else choices(known)
            raise ArgumentError("outputs", several + close, quoted(name))
        for output in asked:
            if _MECHANISM_OUTPUT_LEVELS[output.quantity] > level:
                kinds = choices([kind for kind in MECHANISM_OUTPUTS if _MECHANISM_OUTPUT_LEVELS[kind] <= level])
                raise ArgumentError("outputs", kinds + self.joint_motion.hint, quoted(name))
        yield from asked

    def cross_validate(self, most: int | None = None) -> RobotValidation:
        """Compute the mechanism along the motion by the equations and by Pinocchio, and compare.

        All links, Jacobians, the mass matrix, energies, momenta, forces and accelerations are compared, as far as the
        motion has derivatives.

        Args:
            most: so many instants at most, evenly spread; all unless given.

        Raises:
            MissingDependencyError: Pinocchio is not installed.
        """
        from hingepair.validation.cross_validate import cross_validate

        rows = slice(len(self.times())) if most is None else self.spread(most)
        known = self.known(rows, self.joint_motion.level)
        return cross_validate(self.mechanism, *known.arguments(), base_motion=known.base, gravity=self.gravity)

    def forces(self, gravity: ArrayLike | None = None) -> MechanismSceneForces:
        """Compute the joint efforts and base forces that the scene's motion requires (T1-T3), at its instants.

        Args:
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,). That of the scene unless given.

        Returns:
            A `MechanismSceneForces`: `.tau`, (samples, dof), N m of hinges and N of sliders; `.force1` and
            `.torque1`, (samples, 3), on the base about its reference point, of a fixed base its reaction; `.loads`,
            one of each joint that moves by itself, with rms, largest size, and the limits of effort, position and
            rate beside them, and of a log what its noise causes; `.notes`, sentences on limits that are passed and
            on this noise.

        Raises:
            ArgumentError: the motion has no accelerations.
        """
        motion, t = self.joint_motion, self.times()
        if motion.level < ACCELERATION:
            wanted = f"a motion with accelerations, which forces need{motion.hint}"
            raise ArgumentError("scene", wanted, motion.origin)
        fall = self.gravity if gravity is None else tuple(one_constant("gravity", gravity, 3).tolist())
        known = self.known(slice(len(t)), ACCELERATION)
        record = {"t": t, "described": f"forces: {self.title}", "inputs": self.files, "unit": self.unit}
        noise = None
        if motion.derived is not None:
            middle = self.known(noise_rows(len(t)), ACCELERATION)
            noise = JointNoise(self.mechanism, t, middle, motion.moving, motion.derived)
        return mechanism_scene_forces(self.mechanism, known, fall, record, noise)

    def notes(self) -> tuple[str, ...]:
        """Return sentences that a reader of the results should see: limits that are passed, kinks, doubtful units."""
        notes = self.collected_notes()
        for part in self.blocks(("q",)):
            notes.add(part)
        return notes.sentences()

    def collected_notes(self) -> MechanismNotes:
        """Return what gathers the notes from pieces of the motion."""
        return MechanismNotes(self)


def _needed_quantities(
    outputs: tuple[MechanismOutput, ...],
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return the frames, what is computed of frames, and what is computed of forces, for some outputs."""
    frames = tuple(dict.fromkeys(frame for output in outputs for frame in output.frames))
    named = {"S" if output.quantity == "quat" else output.quantity for output in outputs}
    of_frames = tuple(name for name in _FRAME_LEVELS if name in named)
    return frames, of_frames, tuple(name for name in ("tau", *_BASE_OUTPUT_LEVELS) if name in named)


@dataclass(frozen=True, slots=True)
class MechanismPlan:
    """Outputs that a scene of a mechanism computes, and those that it leaves out.

    Attributes:
        computed: operations by what is computed.
        still: joints that do not move.
        order: of the derivatives that are needed.
        level: of those that the motion has.
        base_rests: whether the base rests at the origin.
    """

    computed: Mapping[str, OperationCounts]
    still: tuple[str, ...]
    order: int
    level: int
    base_rests: bool

    def __str__(self) -> str:
        lines = ["computed:"]
        for what, operations in self.computed.items():
            left = f"{operations.per_sample} operations at each instant"
            lines.append(f"  {what}: {left}, of {operations.unfolded} in all")
            if operations.shared:
                lines.append(f"    and {operations.shared} once, since they depend on constants only")
        skipped = [f"joints that do not move, whose sines and cosines are constants: {', '.join(self.still)}"]
        reasons = ["no output needs them" if i < self.level else "the motion does not give them" for i in range(2)]
        skipped = skipped if self.still else []
        skipped += [
            f"{DERIVATIVE_ORDINALS[i]} derivatives of the coordinates: {reasons[i]}" for i in range(self.order, 2)
        ]
        skipped += ["the motion of the base: it rests at the origin"] * self.base_rests
        return "\n".join([*lines, *(["skipped:"] if skipped else []), *(f"  {reason}" for reason in skipped)])


class MechanismNotes:
    """Notes for a reader of the results, gathered from the pieces of a motion: limits, kinks, doubtful units."""

    def __init__(self, scene: MechanismScene) -> None:
        self._scene = scene
        self._watches: list[tuple[int, int, LimitWatch]] = []
        self._kinks = 0
        robot = scene.mechanism
        for i, joint in enumerate(robot.tree.coordinates):
            limits = [joint.position_limits]
            if scene.joint_motion.level and np.isfinite(joint.rate_limit):
                limits.append((-joint.rate_limit, joint.rate_limit))
            for order, pair in enumerate(limits):
                unit = scene.unit(joint.name + RATES[order])
                self._watches.append((order, i, LimitWatch(joint.name + "'" * order, pair, unit)))

    def add(self, part: MechanismSceneResult) -> None:
        """Look at one piece."""
        self._kinks += self._scene.joint_motion.kinks(part.first, part.first + len(part.t))
        for order, joint, watch in self._watches:
            watch.add(part.t, part.known.column(order, joint))

    def sentences(self) -> tuple[str, ...]:
        """Return the notes."""
        joints, samples = self._scene.mechanism.tree.coordinates, self._scene.samples
        sentences: list[str] = []
        for order, i, watch in self._watches:
            joint = joints[i]
            if order == 0 and joint.kind == "hinge":
                limits = tuple(limit for limit in joint.position_limits if np.isfinite(limit))
                sentences += constant_suspicions(f"limits of {joint.name}", limits)
                sentences += constant_suspicions(joint.name, (watch.most,) * (watch.least == watch.most))
        for _, _, watch in self._watches:
            sentences += watch.sentences(samples)
        return (*sentences, *kink_sentences(self._kinks), *self._scene.joint_motion.notes)


def read_mechanism_scene(tables: Table, path: Path, files: tuple[Path, ...]) -> MechanismScene:
    """Return the scene that the tables of a file describe, files being relative to the file's folder.

    Args:
        tables: of the file.
        path: the file.
        files: all files that the scene is read from, as absolute paths.

    Raises:
        SceneError: the file cannot be read as a scene of a mechanism; names file, table and key, in one line.
        MissingDependencyError: the mechanism is a robot of example-robot-data, which is not installed.
    """
    try:
        return _read_scene(tables, path, files)
    except SceneError as error:
        if _is_stray_joint(tables, path.parent, error.name):
            raise SceneError(error.name, "the motion of a joint under [motion]", "a joint in another table") from None
        raise


def _is_stray_joint(tables: Table, folder: Path, label: str) -> bool:
    """Return whether a refused key, by its label, is a joint whose motion stands in a table that is not [motion]."""
    *parents, key = label.removeprefix(f"{tables.file}: ").split(".")
    if not parents or parents[0] == "motion" or parents[-1] == "locked":
        return False
    value: Any = tables.values
    for step in (*parents, key):
        value = value.get(step) if isinstance(value, dict) else None
    if isinstance(value, dict) and "value" not in value:  # no way points: a frame, or a payload
        return False
    if "joint" in tables.values:
        return key in (joint.get("name") for joint in tables.values["joint"] if isinstance(joint, dict))
    table = tables.table("mechanism")
    source = {name: own for name, own in table.values.items() if name in {"robot", "urdf"}}
    try:
        return key in read_mechanism(replace(tables, values={"mechanism": source}), folder).names
    except SceneError:
        return False


def _read_scene(tables: Table, path: Path, files: tuple[Path, ...]) -> MechanismScene:
    """Return the scene that the tables of a file describe; `read_mechanism_scene` has the words."""
    folder, outputs = path.parent, tables.table("outputs", required=False)
    robot = read_mechanism(tables, folder)
    motion = read_joint_motion(tables, folder, robot)
    frames = tuple(tables.table("mechanism", required=False).table("frames", required=False).values)
    scene = MechanismScene(
        path,
        tables.text("title", default=robot.name),
        robot,
        motion,
        read_gravity(tables) or GRAVITY,
        frames or robot.tips,
        None,
        {key: float(value) for key, value in tables.constants.items()},
        files,
        tables,
    )
    outputs.check_keys(("names",))
    if "names" not in outputs.values:
        return scene
    names = outputs.values["names"]
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        outputs.fail("names", 'a list of names such as ["R", "tau"]')
    with outputs.naming("names"):
        scene.outputs_of(names)
    return replace(scene, outputs=tuple(names))
