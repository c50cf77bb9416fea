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
from hingepair.numeric.suspicions import DEGREES_IN_SCENES
from hingepair.numeric.suspicions import suspicions as judge
from hingepair.numeric.tables import Sheet, cell_text, unit_of
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.dynamics import DEFAULT_GRAVITY_VECTOR, Energy, Momentum
from hingepair.pair.results import Result
from hingepair.plans.plan import ACCELERATION, POSE, VELOCITY
from hingepair.rotations.matrices import matrix_to_quaternion
from hingepair.scenes.instants import Instants, Rows, SampledScene
from hingepair.scenes.motions.joints import (
    RATE_SUFFIXES,
    JointCoordinates,
    JointMotion,
    KnownJointMotion,
    read_joint_motion,
)
from hingepair.scenes.motions.motion import LimitCounter, kink_sentences
from hingepair.scenes.motions.noise import noise_rows
from hingepair.scenes.robot_forces import JointLogNoise, MechanismSceneForces, mechanism_scene_forces
from hingepair.scenes.robot_table import read_gravity, read_mechanism
from hingepair.scenes.tables import Table

if TYPE_CHECKING:
    from hingepair.validation.report import CrossValidation

_FRAME_LEVELS: Final = {
    **dict.fromkeys(("R", "S", "quat", "d"), POSE),
    **dict.fromkeys(("v", "omega"), VELOCITY),
    **dict.fromkeys(("a", "alpha"), ACCELERATION),
}
"""Order of the derivatives that each quantity of a frame needs; quat is the quaternion (x, y, z, w) of S, w >= 0."""
FRAME_QUANTITIES: Final = tuple(_FRAME_LEVELS)
"""Quantities that a frame has; an output is named by one of them and the frame, such as R_tool."""
_FRAME_DEFAULTS: Final = ("R", "S", "v", "omega", "a", "alpha")
"""Quantities that are computed of a frame by default."""
_COORDINATES: Final = ("q", "qd", "qdd")
"""Outputs that are coordinates of the joints, and their derivatives by order."""
_JOINT_LEVELS: Final = {"q": POSE, "qd": VELOCITY, "qdd": ACCELERATION, "tau": ACCELERATION}
"""Derivatives that outputs with a value for each joint need."""
_FORCE_LEVELS: Final = dict.fromkeys(("force1", "torque1"), ACCELERATION)
"""Derivatives that the force and the torque on the base need."""
_LEVELS: Final = {
    **_FRAME_LEVELS,
    **_JOINT_LEVELS,
    **_FORCE_LEVELS,
}
"""Derivatives that each output of a scene of a mechanism needs; frames' outputs by their quantity."""
ROBOT_QUANTITIES: Final = tuple(_LEVELS)
"""Quantities that a scene of a mechanism can be asked for."""


class MechanismOutput(NamedTuple):
    """One requested output of a mechanism's scene: the name of the `quantity`, and the names of the `frames` or of
    the `joints` for which it is requested.
    """

    #: R, S, quat, d, v, omega, a or alpha of a frame; q, qd, qdd or tau of joints; force1, torque1
    quantity: str
    #: names of the frames; empty of what is no quantity of a frame
    frames: tuple[str, ...] = ()
    #: names of the joints; empty of what is no quantity of joints
    joints: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MechanismSceneResult(Frozen, Result):
    """Results of a mechanism's scene: its instants `t`, the `state` of the frames (a MechanismState or None), the
    `forces` (a MechanismForces or None), and the joint coordinates.

    `result["tool"].R` is the position of a frame; `result.R` holds the positions of all frames, with an axis of
    frames behind the axis of samples; likewise S, v, omega, a, alpha. q, qd, qdd and tau have shape (samples, dof),
    in the order of `scene.mechanism.names`. force1 and torque1, shape (samples, 3), act on the base about its
    reference point. An output that was not computed is None.
    """

    #: instants; shape (samples,) s
    t: NDArray[np.float64]
    #: the MechanismState of the frames; None if no output of a frame was requested
    state: MechanismState | None
    #: the MechanismForces; None if no force was requested
    forces: MechanismForces | None
    #: the MechanismScene that was evaluated
    scene: MechanismScene
    #: the motion of the joints and of the base
    known: KnownJointMotion
    #: the requested outputs
    outputs: tuple[MechanismOutput, ...]
    #: index of the first instant; 0 except in blocks
    first: int = 0
    _names_hidden_from_dir: ClassVar[frozenset[str]] = Result._names_hidden_from_dir | {
        "requested_arrays",
        "first",
        "known",
        "outputs",
    }

    @property
    def described(self) -> str:
        """The title of the scene."""
        return self.scene.title

    @property
    def inputs(self) -> tuple[Path, ...]:
        """The files of the scene, which `save` refuses to overwrite."""
        return self.scene.files

    def unit(self, name: str) -> str:
        """Return the unit of a recorded array, or of one of its components, by its name."""
        return self.scene.unit(name)

    def requested_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the requested outputs as a dict of arrays by name, such as R_tool and tau_elbow; shape (samples,
        ...). The arrays of q, qd and qdd are named like the columns of a log, one for each joint. A quaternion has
        four arrays.

        Names are R_tool, S_tool and so on. The arrays of q, qd and qdd have the name of the joint with the suffix of
        the derivative; those of tau have the prefix `tau_`.
        """
        arrays: dict[str, NDArray[Any]] = {}
        for quantity, frames, joints in self.outputs:
            for frame in frames:
                arrays |= self._frame_arrays(quantity, frame)
            columns = {name: i for i, name in enumerate(self.scene.mechanism.names)} if joints else {}
            for joint in joints:
                if quantity == "tau":
                    arrays[f"tau_{joint}"] = np.asarray(self.tau)[..., columns[joint]]
                else:
                    order = _COORDINATES.index(quantity)
                    arrays[joint + RATE_SUFFIXES[order]] = self.known.column(order, columns[joint])
            if quantity in _FORCE_LEVELS:
                arrays[quantity] = getattr(self, quantity)
        return arrays

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return the requested outputs and the coordinates of all joints as a dict of arrays by name; shape (samples,
        ...).
        """
        names = self.scene.mechanism.names
        return self.requested_arrays() | {name: self.known.column(0, i) for i, name in enumerate(names)}

    def energy(self) -> Energy:
        """Compute the kinetic and potential energy of the robot at the instants (equation T7), in the scene's
        gravity; return an Energy.
        """
        robot, known = self.scene.mechanism, self._motion_with_rates()
        return robot.energy(*known.arguments()[:2], gravity=self.scene.gravity, base_motion=known.base)

    def momentum(self) -> Momentum:
        """Compute the linear and angular momentum of the robot at the instants (equation T8), about the world's
        origin; return a Momentum.
        """
        known = self._motion_with_rates()
        return self.scene.mechanism.momentum(*known.arguments()[:2], base_motion=known.base)

    def _motion_with_rates(self) -> KnownJointMotion:
        """Return the known motion of the result."""
        if self.known.level < VELOCITY:
            raise ArgumentError("outputs", "some that need first derivatives, such as v", "none of them")
        return self.known

    def _frame_arrays(self, quantity: str, frame: str) -> dict[str, NDArray[Any]]:
        """Return a quantity of the frame named `frame` as a dict of one array by output name, or of four arrays for
        the quantity "quat"; empty if no frame was computed.
        """
        if self.state is None:
            return {}
        if quantity == "quat":
            w, x, y, z = matrix_to_quaternion(np.asarray(self.state[frame].S, dtype=np.float64)).T
            return {f"quat_{frame}_{letter}": column for letter, column in zip("xyzw", (x, y, z, w), strict=True)}
        return {f"{quantity}_{frame}": np.asarray(getattr(self.state[frame], quantity))}

    def __getitem__(self, frame: str) -> FrameState:
        """Return the motion of a frame."""
        if self.state is None:
            raise ArgumentError("frame", "no frame, since no output is of one", quoted(frame))
        state: FrameState = self.state[frame]
        return state

    def __getattr__(self, name: str) -> Any:
        if name in _COORDINATES:
            order = _COORDINATES.index(name)
            return self.known.array(order) if order <= self.known.level else None
        if name in {"tau", *_FORCE_LEVELS}:
            return None if self.forces is None else getattr(self.forces, name)
        if name in MechanismState.__slots__:
            return None if self.state is None else getattr(self.state, name)
        raise missing_attribute_error(self, name)

    def __repr__(self) -> str:
        frames = ", ".join(self.state.frames) if self.state is not None else "none"
        return f"MechanismSceneResult({describe_instants(self.t)}, frames: {frames})"

    def _available_names(self) -> Iterable[str]:
        """Return a tuple of the names of the attributes and methods that are available in this result, for `dir`."""
        names = (
            *_COORDINATES,
            "tau",
            *_FORCE_LEVELS,
            *MechanismState.__slots__,
        )
        return (*(name for name in names if getattr(self, name) is not None), "energy", "momentum")


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class MechanismScene(SampledScene):
    """Scene of a mechanism, as read from a scene file: the robot, the motion of its joints and base, and the
    instants.
    """

    #: path of the scene file
    path: Path
    #: title of the scene, a sentence
    title: str
    #: the robot, with the frames and the payload of the file
    mechanism: Mechanism
    #: the motion of the joints and the base, and its instants
    joint_motion: JointMotion
    #: acceleration of free fall, world axes [m/s^2]; shape (3,)
    gravity: tuple[float, ...]
    #: names of the frames that are computed by default: those of [mechanism.frames], otherwise the last links of the
    #: branches
    frames: tuple[str, ...]
    #: names of the outputs that `evaluate` computes by default, as in [outputs]; None for the motion of the frames
    #: and of the joints that move
    outputs: tuple[str, ...] | None
    #: constants of the file by name
    constants: Mapping[str, float]
    #: absolute paths of the files that the scene was read from: the scene file, its URDF file and its log
    files: tuple[Path, ...]
    #: contents of the file; expressions are kept as text
    tables: Table

    def __repr__(self) -> str:
        return f"MechanismScene({str(self.path)!r}, {self.title!r}, samples={self.samples}, t={self.span})"

    def _sheet(self) -> Sheet:
        """Return the Sheet that prints the scene: title, and rows of name, value and unit."""
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
        """The instants [s], an array or UniformInstants."""
        return self.joint_motion.t

    @property
    def t(self) -> NDArray[np.float64]:
        """All instants of the scene; shape (samples,) s."""
        return self.times()

    def motion(self) -> JointCoordinates:
        """Return the JointCoordinates (q, qd, qdd) at all instants, each of shape (samples, dof); derivatives that
        the scene lacks are None.

        Returns:
            (q, qd, qdd), each of shape (samples, dof) in the order of `mechanism.names`; None for derivatives that
            the motion does not have.
        """
        known = self.known(slice(len(self.times())), self.joint_motion.level)
        return JointCoordinates(*(known.array(order) for order in range(known.level + 1)))

    def base_motion(self) -> BodyMotion | None:
        """Return the motion of the base at all instants as a BodyMotion; None if the base rests at the origin.

        It is what the methods of the mechanism take as base_motion.
        """
        return self.known(slice(len(self.times())), self.joint_motion.level).base

    def known(self, rows: Rows, order: int) -> KnownJointMotion:
        """Return the KnownJointMotion of the joints and the base at the instants with the indices `rows`, with
        derivatives up to `order`.

        Args:
            rows: indices of the instants, a slice or an array.
            order: highest order of the derivatives.
        """
        return self.joint_motion.part(self.mechanism.names, rows, order)

    def unit(self, name: str) -> str:
        """Return the unit of an output, or of one of its components, as a string. `name` is the name of the output or
        component in a result file, such as R_tool_x or tau_elbow.
        """
        for joint in self.mechanism.tree.coordinates:
            hinge = joint.kind == "hinge"
            if name == f"tau_{joint.name}":
                return "N m" if hinge else "N"
            for ending, per in zip(RATE_SUFFIXES, ("", "/s", "/s^2"), strict=True):
                if name == joint.name + ending:
                    return ("rad" if hinge else "m") + per
        quantity, _, _ = name.partition("_")
        return unit_of(quantity)

    def evaluate(self, outputs: Iterable[str] | None = None) -> MechanismSceneResult:
        """Compute outputs of the mechanism at all instants of the scene; return a MechanismSceneResult.

        Args:
            outputs: names of outputs. R, S, quat, d, v, omega, a or alpha requests the quantity for all frames of the
                scene; the name of a link, a joint or another frame requests all motion of it; a name such as R_tool
                requests one quantity of one frame. q, qd, qdd or tau requests all joints; tau_elbow requests tau of
                one joint. force1 and torque1 are the load on the base. By default the outputs that the scene file
                names; if it names none, the motion of the scene's frames and of the joints that move.

        Raises:
            ArgumentError: an unknown output, one that needs what the motion does not have, or more instants than can
                be held in memory.
        """
        return self._evaluate_rows(slice(len(self.times())), self.outputs_of(outputs))

    def sampled(self, max_instants: int, outputs: Iterable[str] | None = None) -> MechanismSceneResult:
        """Compute outputs of the mechanism at `max_instants` evenly spread instants, or at every instant if there are
        fewer; return a MechanismSceneResult.

        Args:
            max_instants: largest number of instants.
            outputs: as for `evaluate`.
        """
        return self._evaluate_rows(self.spread(max_instants), self.outputs_of(outputs))

    def blocks(self, outputs: Iterable[str] | None = None) -> Iterator[MechanismSceneResult]:
        """Yield a MechanismSceneResult for each block of 131,072 instants in turn, for scenes that do not fit into
        memory.

        The `known` motion of each block has first derivatives if the scene's motion has them.

        Args:
            outputs: as for `evaluate`.
        """
        chosen = self.outputs_of(outputs)
        for rows in self.block_rows():
            yield self._evaluate_rows(rows, chosen, min(self.joint_motion.level, VELOCITY))

    def _evaluate_rows(
        self, rows: Rows, outputs: tuple[MechanismOutput, ...], min_order: int = 0
    ) -> MechanismSceneResult:
        """Return the MechanismSceneResult of outputs, a tuple of MechanismOutputs, at the instants with the indices
        `rows`.
        """
        levels = [_LEVELS[output.quantity] for output in outputs]
        known_motion = self.known(rows, max([*levels, min_order]))
        options: dict[str, Any] = {"base_motion": known_motion.base, "backend": self.backend}
        frames, frame_outputs, force_outputs = _needed_quantities(outputs)
        state = forces = None
        if frames:
            order = max(_FRAME_LEVELS[name] for name in frame_outputs)
            state = self.mechanism.forward_kinematics(
                *known_motion.arguments()[: order + 1], frames=frames, outputs=frame_outputs, **options
            )
        if force_outputs:
            forces = self.mechanism.inverse_dynamics(
                *known_motion.arguments(), gravity=self.gravity, outputs=force_outputs, **options
            )
        first = (rows.start or 0) if isinstance(rows, slice) else 0
        t = np.asarray(read_only(self.instants[rows]))
        return MechanismSceneResult(t, state, forces, self, known_motion, outputs, first)

    def plan(self, outputs: Iterable[str] | None = None) -> MechanismPlan:
        """Return the MechanismPlan of `evaluate` with these outputs: its text lists what is computed and what is
        skipped, and why.

        Args:
            outputs: as for `evaluate`.
        """
        chosen = self.outputs_of(outputs)
        order = max(_LEVELS[output.quantity] for output in chosen)
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
        """Return requested output names as a tuple of MechanismOutputs. None means the outputs that the scene names,
        or else the motion of its frames and moving joints.

        Args:
            outputs: as for `evaluate`.
        """
        level = self.joint_motion.level
        names = self.outputs if outputs is None else outputs
        if names is None:
            joints = self.joint_motion.moving
            of_frames = [MechanismOutput(name, self.frames) for name in _FRAME_DEFAULTS if _LEVELS[name] <= level]
            of_joints = [MechanismOutput(name, (), joints) for name in _COORDINATES if _LEVELS[name] <= level]
            return (*of_frames, *of_joints)
        try:
            requested = [] if isinstance(names, str) else list(names)
        except TypeError:
            requested = []
        if not requested:
            raise ArgumentError("outputs", f"names out of {', '.join(ROBOT_QUANTITIES)}, or of frames", quoted(names))
        return tuple(output for name in requested for output in self._parse_output(name))

    def _parse_output(self, name: object) -> Iterator[MechanismOutput]:
        """Yield the MechanismOutputs that one name requests: a quantity such as R or tau, a frame, or both such as
        R_tool.
        """
        quantity, _, frame = name.partition("_") if isinstance(name, str) else ("", "", "")
        level, robot = self.joint_motion.level, self.mechanism
        if name in _FRAME_LEVELS:
            requested = [MechanismOutput(str(name), self.frames)]
        elif name in _LEVELS:
            requested = [MechanismOutput(str(name), (), robot.names if name in _JOINT_LEVELS else ())]
        elif isinstance(name, str) and robot.tree.frame(name) is not None:
            requested = [MechanismOutput(kind, (name,)) for kind in _FRAME_DEFAULTS if _LEVELS[kind] <= level]
        elif quantity in _FRAME_LEVELS and robot.tree.frame(frame) is not None:
            requested = [MechanismOutput(quantity, (frame,))]
        elif quantity == "tau" and frame in robot.names:
            requested = [MechanismOutput(quantity, (), (frame,))]
        else:
            known_names = (*ROBOT_QUANTITIES, *robot.links, *robot.tree.frames)
            close = nearest(str(name), (*known_names, *(f"tau_{joint}" for joint in robot.names)))
            several = (
                f"{choices(known_names)}, or both such as R_{self.frames[0]}" if self.frames else choices(known_names)
            )
            raise ArgumentError("outputs", several + close, quoted(name))
        for output in requested:
            if _LEVELS[output.quantity] > level:
                kinds = choices([kind for kind in ROBOT_QUANTITIES if _LEVELS[kind] <= level])
                raise ArgumentError("outputs", kinds + self.joint_motion.hint, quoted(name))
        yield from requested

    def cross_validate(self, max_instants: int | None = None) -> CrossValidation:
        """Compare the mechanism's equations with Pinocchio at `max_instants` evenly spread instants of the motion, by
        default at all; return a CrossValidation.

        The motion of all links, Jacobians, the mass matrix, energies, momenta, forces and accelerations are compared,
        as far as the motion has derivatives.

        Args:
            max_instants: largest number of instants to compare, evenly spread; all instants by default.

        Raises:
            MissingDependencyError: Pinocchio is not installed.
        """
        from hingepair.validation.cross_validate import cross_validate

        rows = slice(len(self.times())) if max_instants is None else self.spread(max_instants)
        known = self.known(rows, self.joint_motion.level)
        return cross_validate(self.mechanism, *known.arguments(), base_motion=known.base, gravity=self.gravity)

    def forces(self, gravity: ArrayLike | None = None) -> MechanismSceneForces:
        """Compute the joint efforts and base forces that the scene's motion requires (equations T1 to T3); return a
        MechanismSceneForces.

        Args:
            gravity: acceleration of free fall, world axes [m/s^2]; shape (3,). By default the gravity of the scene.

        Returns:
            A `MechanismSceneForces` with these attributes:

            - tau, (samples, dof): torques of hinges [N m] and forces of sliders [N];
            - force1 [N] and torque1 [N m], (samples, 3): the load on the base about its reference point; of a fixed
              base, its reaction;
            - loads: a JointLoad for each joint with a coordinate of its own, with the rms and the largest value of
              its effort, its extremes beside its limits, and the effect of the noise of a log;
            - notes: sentences on limits that are exceeded and on that noise.
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
            noise = JointLogNoise(self.mechanism, t, middle, motion.moving, motion.derived)
        return mechanism_scene_forces(self.mechanism, known, fall, record, noise)

    def notes(self) -> tuple[str, ...]:
        """Evaluate the whole motion, and return a tuple of sentences for readers of the results: on joints outside
        their limits, on kinks, on angles that look like degrees, and on the motion itself.
        """
        notes = self.note_collector()
        for block in self.blocks(("q",)):
            notes.add(block)
        return notes.sentences()

    def suspicions(self) -> tuple[str, ...]:
        """Return a tuple of sentences on numbers of the file, and on the motion at up to 101 instants, that are
        probably in another unit, such as degrees or millimetres.
        """
        from hingepair.scenes import suspicions

        rows, motion = self.spread(suspicions.MAX_JUDGED), self.joint_motion
        t = np.asarray(motion.t[rows])
        hinges = [joint for joint in self.mechanism.tree.coordinates if joint.kind == "hinge"]
        angles = dict.fromkeys((joint.name for joint in hinges), "written angles")
        sentences: list[str] = []
        for joint in hinges:
            sentences += judge(
                "written angles", f"limits of {joint.name}", joint.position_limits, radians=DEGREES_IN_SCENES
            )
        sentences += suspicions.table_suspicions(self.tables.values, angles)
        sentences += suspicions.function_suspicions(motion.functions, t, angles)
        if motion.level:
            known = self.known(rows, 1)
            rates = np.max([np.abs(known.column(1, i)) for i in range(len(known.names))], axis=0, initial=0.0)
            sentences += suspicions.motion_suspicions(motion.t, np.broadcast_to(rates, t.shape), None, None)
        return tuple(dict.fromkeys(sentences))

    def note_collector(self) -> MechanismNoteCollector:
        """Return a MechanismNoteCollector, which collects notes from blocks of results."""
        return MechanismNoteCollector(self)


def _needed_quantities(
    outputs: tuple[MechanismOutput, ...],
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Return (frame names, frame quantities, force quantities) that MechanismOutputs need, three tuples of names."""
    frames = tuple(dict.fromkeys(frame for output in outputs for frame in output.frames))
    named = {"S" if output.quantity == "quat" else output.quantity for output in outputs}
    of_frames = tuple(name for name in _FRAME_LEVELS if name in named)
    return (
        frames,
        of_frames,
        tuple(name for name in ("tau", *_FORCE_LEVELS) if name in named),
    )


@dataclass(frozen=True, slots=True)
class MechanismPlan:
    """Plan of a mechanism's scene."""

    #: number of operations by the description of the computed outputs
    computed: Mapping[str, OperationCounts]
    #: names of the joints that do not move
    still: tuple[str, ...]
    #: highest order of the needed derivatives
    order: int
    #: highest order of the derivatives that the motion has
    level: int
    #: whether the base rests at the origin
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
            f"{('first', 'second')[i]} derivatives of the coordinates: {reasons[i]}" for i in range(self.order, 2)
        ]
        skipped += ["the motion of the base: it rests at the origin"] * self.base_rests
        return "\n".join([*lines, *(["skipped:"] if skipped else []), *(f"  {reason}" for reason in skipped)])


class MechanismNoteCollector:
    """Collector of notes on a mechanism's scene that is evaluated in blocks."""

    def __init__(self, scene: MechanismScene) -> None:
        self._scene = scene
        self._watches: list[tuple[int, int, LimitCounter]] = []
        self._kinks = 0
        robot = scene.mechanism
        for i, joint in enumerate(robot.tree.coordinates):
            limits = [joint.position_limits]
            if scene.joint_motion.level and np.isfinite(joint.rate_limit):
                limits.append((-joint.rate_limit, joint.rate_limit))
            for order, pair in enumerate(limits):
                unit = scene.unit(joint.name + RATE_SUFFIXES[order])
                self._watches.append((order, i, LimitCounter(joint.name + "'" * order, pair, unit)))

    def add(self, block: MechanismSceneResult) -> None:
        """Update the counts of kinks and of instants outside limits with one block of results, a
        MechanismSceneResult; the blocks must come in order of time.
        """
        self._kinks += self._scene.joint_motion.count_kinks(block.first, block.first + len(block.t))
        for order, joint, watch in self._watches:
            watch.add(block.t, block.known.column(order, joint))

    def sentences(self) -> tuple[str, ...]:
        """Return the notes on all added blocks and on the motion itself as a tuple of sentences."""
        sentences = [*self._scene.suspicions()]
        for _, _, watch in self._watches:
            sentences += watch.sentences(self._scene.samples)
        return tuple(dict.fromkeys((*sentences, *kink_sentences(self._kinks), *self._scene.joint_motion.notes)))


def read_mechanism_scene(tables: Table, path: Path, files: tuple[Path, ...]) -> MechanismScene:
    """Return the MechanismScene that `tables`, the top-level Table of the scene file at `path`, defines. Paths in the
    tables are relative to the folder of the file. `files` are the absolute paths of all files that the scene is read
    from.
    """
    try:
        return _read_scene(tables, path, files)
    except SceneError as error:
        if _is_stray_joint(tables, path.parent, error.name):
            raise SceneError(error.name, "the motion of a joint under [motion]", "a joint in another table") from None
        raise


def _is_stray_joint(tables: Table, folder: Path, label: str) -> bool:
    """Return whether the key that a SceneError names is a joint of the robot that was put outside the table
    [motion].
    """
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
    source = {name: entry for name, entry in table.values.items() if name in {"robot", "urdf"}}
    try:
        return key in read_mechanism(replace(tables, values={"mechanism": source}), folder).names
    except SceneError:
        return False


def _read_scene(tables: Table, path: Path, files: tuple[Path, ...]) -> MechanismScene:
    """Return the MechanismScene that the top-level Table of the scene file at `path` defines; `files` are all files
    that it is read from.
    """
    folder, outputs = path.parent, tables.table("outputs", required=False)
    robot = read_mechanism(tables, folder)
    motion = read_joint_motion(tables, folder, robot)
    frames = tuple(tables.table("mechanism", required=False).table("frames", required=False).values)
    scene = MechanismScene(
        path,
        tables.text("title", default=robot.name),
        robot,
        motion,
        read_gravity(tables) or DEFAULT_GRAVITY_VECTOR,
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
