"""Comparison of the outputs of a robot with the outputs of Pinocchio."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.arguments import BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME, read_robot_arguments
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.tree import Frame
from hingepair.numeric.arrays import Float64Array, broadcast_shape, one_constant
from hingepair.pair.accuracy import unit_roundoff
from hingepair.pair.body_motion import BodyMotion
from hingepair.plans.arguments import Coordinates
from hingepair.validation.free_flyer import import_pinocchio
from hingepair.validation.robot_report import RobotComparison, RobotValidation
from hingepair.validation.robot_scales import FRAME_MOTION, RobotScales
from hingepair.validation.robot_twin import BASE_AT_REST, RobotTwin, robot_twin
from hingepair.validation.urdf_twin import compare_descriptions, urdf_twin

_BASE_WRENCH = ("force1_x", "force1_y", "force1_z", "torque1_x", "torque1_y", "torque1_z")
"""Labels of the force [N] and the torque [N m] on the base, by component."""
_SINGULAR = 1e-12  # smaller eigenvalues consist of rounding errors, and the mass matrix counts as singular


def cross_validate_robot(
    robot: Mechanism,
    coordinates: Mapping[str, Coordinates],
    frames: str | Iterable[str] | None,
    base_motion: BodyMotion | None,
    gravity: ArrayLike,
) -> RobotValidation:
    """Compute the outputs of a robot by the equations and by Pinocchio; return a RobotValidation, the report on their
    comparison.

    Args:
        robot: the robot.
        coordinates: q, or q and qd, or q, qd and qdd, by name.
        frames: names of links, joints or further frames; all links unless given.
        base_motion: motion of the base; at rest at the origin unless given.
        gravity: acceleration of free fall [m/s^2]; shape (3,).
    """
    gravity_array = one_constant("gravity", gravity, 3)
    names = tuple(robot.tree.links) if frames is None else (frames,) if isinstance(frames, str) else tuple(frames)
    tips = robot.tips if frames is None else names
    frame_by_name = {name: robot.tree.known_frame("frames", name) for name in names}
    samples = _RobotSamples(robot, coordinates, base_motion)
    our_outputs = _outputs_by_equations(robot, coordinates, names, tips, base_motion, gravity_array, samples.shape)
    twin, compared_with = urdf_twin(robot)
    description = () if twin is None else compare_descriptions(robot, twin)
    heading = robot.name, robot.base, len(frame_by_name), samples.shape, samples.skipped, samples.u
    if not all(row.ok for row in description[:1]):
        return RobotValidation(*heading, (), description, compared_with)
    twin = twin or robot_twin(robot, has_free_flyer=True)
    twin.model.gravity = import_pinocchio("cross_validate").Motion(gravity_array, np.zeros(3))
    pinocchio_outputs = _outputs_by_pinocchio(robot, twin, samples, names, tips)
    singular: list[str] = []
    if "tau" in pinocchio_outputs:
        our_outputs["forward_dynamics"], pinocchio_outputs["forward_dynamics"], singular = _forward_dynamics_residual(
            robot, twin, samples, our_outputs, pinocchio_outputs
        )
    scales = _output_scales(robot, twin, samples, frame_by_name, tips, gravity_array, our_outputs)
    labels = dict.fromkeys((*FRAME_MOTION, "d"), names) | {"jacobian": tips, "tau": robot.names}
    labels["forward_dynamics"] = (*_BASE_WRENCH, *robot.names) if robot.base == "free" else robot.names
    rows = []
    for name, expected in pinocchio_outputs.items():
        parts = labels.get(name, ("",))
        if expected.size or not samples.finite.size:  # a robot without joints has neither tau nor mass matrix
            error, ratio = _errors_by_part(our_outputs[name], expected, scales[name], samples.u, len(parts))
            rows.append(RobotComparison.worst_of(name, error, ratio, samples.shape, parts))
            if name == "forward_dynamics" and singular:
                rows[-1] = replace(rows[-1], singular=len(singular), unresisted=singular[0])
    return RobotValidation(*heading, tuple(rows), description, compared_with)


class _RobotSamples:
    """Coordinates of a robot and motion of its base at N samples: `joints` is a list of the arrays q and, as far as
    given, qd and qdd, and `base` is a BodyMotion.
    """

    def __init__(
        self, robot: Mechanism, coordinates: Mapping[str, Coordinates], base_motion: BodyMotion | None
    ) -> None:
        needed = tuple(BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME)[: 2 * len(coordinates)]
        values = read_robot_arguments(robot.names, coordinates, base_motion, needed, {})
        self.shape = broadcast_shape(values.shapes)
        parts = {
            name: np.asarray(getattr(BASE_AT_REST, BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME[name])) for name in needed
        } | values.values
        flat = {
            name: _samples_of_argument(part, self.shape, 2 if name == "S1" else 1) for name, part in parts.items()
        }
        finite = [np.isfinite(array).all(axis=tuple(range(1, array.ndim))) for array in flat.values()]
        self.finite = np.logical_and.reduce(finite)
        for array in flat.values():
            array[~self.finite] = np.nan
        self.skipped = int((~self.finite).sum())
        self.joints = [flat[name] for name in coordinates]
        self.base = BodyMotion(**{BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME[name]: flat[name] for name in needed})
        leaves = [part for name, part in values.values.items() if name in coordinates]
        single = all(getattr(part, "dtype", None) == np.float32 for part in leaves) and base_motion is None
        self.u = unit_roundoff(np.float32 if single else np.float64)


def _samples_of_argument(value: Any, shape: tuple[int, ...], sample_rank: int) -> Float64Array:
    """Return a copy of `value`, an array or a tuple of components, as a float64 array (N, ...) with `sample_rank`
    axes after the first.
    """
    array = np.stack(np.broadcast_arrays(*value), axis=-1) if isinstance(value, tuple) else np.asarray(value)
    sample_shape = array.shape[array.ndim - sample_rank :]
    count = int(np.prod(shape))
    return np.array(np.broadcast_to(array, (*shape, *sample_shape)), dtype=np.float64).reshape(count, *sample_shape)


def _outputs_by_equations(
    robot: Mechanism,
    coordinates: Mapping[str, Coordinates],
    frames: tuple[str, ...],
    tips: tuple[str, ...],
    base_motion: BodyMotion | None,
    gravity: Float64Array,
    shape: tuple[int, ...],
) -> dict[str, Float64Array]:
    """Compute the compared outputs of a robot by the equations, and return a dict of arrays (N, ...) by
    output name.
    """
    q, *rates = coordinates.values()
    base_argument: dict[str, Any] = {"base_motion": base_motion}
    outputs: dict[str, tuple[Any, int]] = {}  # values, and the number of axes of one sample
    if frames:
        state = robot.forward_kinematics(q, *rates, frames=frames, **base_argument)
        outputs |= {name: (getattr(state, name), 3 if name == "S" else 2) for name in state.outputs}
        columns = [robot.jacobian(q, name, **base_argument) for name in tips]
        outputs["jacobian"] = np.stack(columns, axis=-3), 3
    outputs["mass_matrix"] = robot.mass_matrix(q, **base_argument), 2
    if rates:
        energy = robot.energy(q, rates[0], gravity=gravity, **base_argument)
        momentum = robot.momentum(q, rates[0], **base_argument)
        outputs |= {"kinetic": (energy.kinetic, 0), "potential": (energy.potential, 0)}
        outputs |= {"linear": (momentum.linear, 1), "angular": (momentum.angular, 1)}
    if len(rates) > 1:
        forces = robot.inverse_dynamics(q, *rates, gravity=gravity, **base_argument)
        outputs |= {name: (forces[name], 1) for name in forces.outputs}
        free = robot.base == "free"
        loads: dict[str, Any] = {name: forces[name] for name in ("force1", "torque1")} if free else {}
        accelerations = robot.forward_dynamics(q, rates[0], forces.tau, gravity=gravity, **loads, **base_argument)
        outputs |= {name: (accelerations[name], 1) for name in accelerations.outputs}
    return {name: _samples_of_argument(value, shape, rank) for name, (value, rank) in outputs.items()}


def _outputs_by_pinocchio(
    robot: Mechanism, twin: RobotTwin, samples: _RobotSamples, frames: tuple[str, ...], tips: tuple[str, ...]
) -> dict[str, Float64Array]:
    """Compute the compared outputs of a robot by Pinocchio's model `twin`, and return a dict of arrays (N, ...) by
    output name, which are NaN at samples that are not finite.
    """
    pin = import_pinocchio("cross_validate")
    frame_numbers, tip_numbers = (
        [_frame_number(pin, twin, robot, name) for name in names] for names in (frames, tips)
    )
    states = _pinocchio_states(twin, samples)
    columns = _velocity_matrices(robot, twin, samples)
    rows = []
    for i in range(len(samples.finite)):
        state = [one[i] for one in states]
        if not samples.finite[i]:
            state = [np.zeros_like(one) for one in state]
            state[0][6] = 1.0  # the scalar part of the base's quaternion
        outputs = _frame_outputs(pin, twin, frame_numbers, state) if frame_numbers else {}
        outputs |= _mass_outputs(pin, twin, tip_numbers, state, columns[i])
        if len(state) > 2:
            force = pin.rnea(twin.model, twin.data, *state)
            turn = samples.base.S[i] if samples.finite[i] else np.eye(3)
            outputs |= {"tau": force[6:] @ twin.ratios, "force1": turn @ force[:3], "torque1": turn @ force[3:6]}
        rows.append(outputs)
    if not rows:
        return {}
    outputs_of_all = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    for array in outputs_of_all.values():
        array[~samples.finite] = np.nan
    return outputs_of_all


def _pinocchio_states(twin: RobotTwin, samples: _RobotSamples) -> list[Float64Array]:
    """Return a list of Pinocchio's arrays q, v (if the samples have rates) and a (if they have accelerations), shape
    (N, ...) each.
    """
    joints, base = samples.joints, samples.base
    conversions: list[Callable[..., Float64Array]] = [twin.configuration, twin.velocity, twin.acceleration]
    return [convert(*joints[: k + 1], base) for k, convert in enumerate(conversions[: len(joints)])]


def _velocity_matrices(robot: Mechanism, twin: RobotTwin, samples: _RobotSamples) -> Float64Array:
    """Return an array of the matrices, one for each sample, that convert the velocities of the robot to the v of
    Pinocchio's model `twin`; shape (N, nv, columns).
    """
    count, (joints, dof) = len(samples.finite), twin.ratios.shape
    matrices = np.zeros((count, 6 + joints, 6 + dof))
    matrices[:, :3, :3] = matrices[:, 3:6, 3:6] = np.swapaxes(np.asarray(samples.base.S), -1, -2)
    matrices[:, 6:, 6:] = twin.ratios
    return matrices if robot.base == "free" else matrices[..., 6:]


def _frame_number(pin: Any, twin: RobotTwin, robot: Mechanism, name: str) -> int:
    """Return the number in Pinocchio's model of the robot's frame called `name`; a name that a joint or another frame
    shares with a link is the link's.
    """
    is_link = name in robot.tree.links
    for number, frame in enumerate(twin.model.frames):
        if frame.name == name and (frame.type == pin.FrameType.BODY) is is_link:
            return number
    raise ArgumentError("frames", "a frame that Pinocchio's model has, too", quoted(name))


def _frame_outputs(
    pin: Any, twin: RobotTwin, frames: list[int], state: list[Float64Array]
) -> dict[str, Float64Array]:
    """Compute the motion of the frames with the indices `frames` by Pinocchio's model `twin` at one state, a list of
    q and, as far as given, v and a.
    """
    model, data, world = twin.model, twin.data, pin.LOCAL_WORLD_ALIGNED
    at_origin = state[0].copy()
    at_origin[:3] = 0
    pin.framesForwardKinematics(model, data, at_origin)
    outputs: dict[str, Any] = {"d": np.array([data.oMf[frame].translation for frame in frames])}
    pin.forwardKinematics(model, data, *state)
    pin.updateFramePlacements(model, data)
    outputs |= {"R": np.array([data.oMf[frame].translation for frame in frames])}
    outputs |= {"S": np.array([data.oMf[frame].rotation for frame in frames])}
    if len(state) > 1:
        twists = [pin.getFrameVelocity(model, data, frame, world) for frame in frames]
        outputs |= {"v": np.array([one.linear for one in twists]), "omega": np.array([one.angular for one in twists])}
    if len(state) > 2:
        changes = [pin.getFrameClassicalAcceleration(model, data, frame, world) for frame in frames]
        outputs |= {
            "a": np.array([one.linear for one in changes]),
            "alpha": np.array([one.angular for one in changes]),
        }
    return outputs


def _mass_outputs(
    pin: Any, twin: RobotTwin, frames: list[int], state: list[Float64Array], velocity_matrix: Float64Array
) -> dict[str, Any]:
    """Compute the mass matrix and the Jacobians of the frames with the indices `frames` by Pinocchio's model `twin`
    at one state, a list of q and, as far as given, v and a.
    """
    model, data = twin.model, twin.data
    outputs: dict[str, Any] = {}
    pin.computeJointJacobians(model, data, state[0])
    pin.updateFramePlacements(model, data)
    if frames:
        jacobians = [pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED) for frame in frames]
        outputs["jacobian"] = np.array([one @ velocity_matrix for one in jacobians])
    upper = np.triu(pin.crba(model, data, state[0]))
    outputs["mass_matrix"] = velocity_matrix.T @ (upper + np.triu(upper, 1).T) @ velocity_matrix
    if len(state) > 1:
        outputs["kinetic"] = _kinetic_energy(pin, twin, *state[:2])
        outputs["potential"] = pin.computePotentialEnergy(model, data, state[0])
        if sum(inertia.mass for inertia in model.inertias):
            momentum = pin.computeCentroidalMomentum(model, data, *state[:2])
            about_origin = momentum.angular + np.cross(data.com[0], momentum.linear)
            outputs |= {"linear": momentum.linear.copy(), "angular": about_origin}
    return outputs


def _kinetic_energy(pin: Any, twin: RobotTwin, q: Float64Array, v: Float64Array) -> float:
    """Return the kinetic energy [J] of links and rotors at one state, given by Pinocchio's q and v."""
    armature = twin.model.armature.copy()
    twin.model.armature = np.zeros_like(
        armature
    )  # Pinocchio 4.1 includes rotors here, except the rotors of oblique hinges
    links: float = pin.computeKineticEnergy(twin.model, twin.data, q, v)
    twin.model.armature = armature
    return links + 0.5 * float(armature @ (v * v))


def _forward_dynamics_residual(
    robot: Mechanism,
    twin: RobotTwin,
    samples: _RobotSamples,
    our_outputs: Mapping[str, Float64Array],
    pinocchio_outputs: Mapping[str, Float64Array],
) -> tuple[Float64Array, Float64Array, list[str]]:
    """Return a tuple of three: the forces that hingepair's accelerations require by Pinocchio's inverse dynamics
    `rnea`, shape (N, k); the forces that act, shape (N, k); and a list of phrases on joints that nothing resists, one
    for each sample with a singular mass matrix.
    """
    pin = import_pinocchio("cross_validate")
    base = samples.base
    if robot.base == "free":
        base = replace(base, a=our_outputs["a1"], alpha=our_outputs["alpha1"])
    q, v = _pinocchio_states(twin, samples)[:2]
    a = twin.acceleration(samples.joints[0], samples.joints[1], our_outputs["qdd"], base)
    columns = _velocity_matrices(robot, twin, samples)
    acting_forces = pinocchio_outputs["tau"].copy()
    if robot.base == "free":
        wrench = pinocchio_outputs["force1"], pinocchio_outputs["torque1"]
        acting_forces = np.concatenate((*wrench, acting_forces), axis=-1)
    required_forces = np.full_like(acting_forces, np.nan)
    singular: list[str] = []
    for i in np.flatnonzero(samples.finite):
        if np.isfinite(a[i]).all():
            required_forces[i] = pin.rnea(twin.model, twin.data, q[i], v[i], a[i]) @ columns[i]
        elif joint := _unresisted_joint(robot, pinocchio_outputs["mass_matrix"][i]):
            acting_forces[i] = np.nan  # so that the sample is not compared
            singular.append(joint)
    return required_forces, acting_forces, singular


def _unresisted_joint(robot: Mechanism, matrix: Float64Array) -> str:
    """Return a phrase, such as "nothing resists joint 'elbow'", on the joint with the largest part in a motion that a
    singular mass matrix does not resist.
    """
    size = np.sqrt(np.abs(np.diagonal(matrix)))
    motion = (size == 0).astype(float)
    if size.all():
        least, motions = np.linalg.eigh(matrix / size / size[:, None])
        motion = motions[:, 0] if least[0] < _SINGULAR else motion
    if not motion.any():
        return ""
    names = ("the base",) * (len(size) - robot.dof) + tuple(f"joint {name!r}" for name in robot.names)
    return f"nothing resists {names[int(np.argmax(np.abs(motion)))]}"


def _output_scales(
    robot: Mechanism,
    twin: RobotTwin,
    samples: _RobotSamples,
    frames: Mapping[str, Frame],
    tips: tuple[str, ...],
    gravity: Float64Array,
    our_outputs: Mapping[str, Float64Array],
) -> dict[str, Float64Array]:
    """Return a dict of the error scales of all outputs by name; the shapes of the scales broadcast against the
    outputs.
    """
    states = _pinocchio_states(twin, samples)
    joints = [twin.joint_positions(samples.joints[0]), *(one[:, 6:] for one in states[1:])]
    scales = RobotScales(robot.tree, joints, samples.base, gravity)
    columns = np.zeros((6 + len(twin.ratios), 6 + robot.dof))
    columns[:6, :6], columns[6:, 6:] = np.eye(6), np.abs(twin.ratios)
    columns = columns if robot.base == "free" else columns[:, 6:]
    by_output: dict[str, Float64Array] = {}
    if frames:
        at_origin = replace(samples.base, R=np.zeros_like(samples.base.R))
        scales_at_rest = RobotScales(robot.tree, joints[:1], at_origin, gravity)
        motions = [scales.motion(frame) for frame in frames.values()]
        by_output |= {name: np.stack([one[name] for one in motions], axis=1)[..., None] for name in FRAME_MOTION}
        by_output["S"] = by_output["S"][..., None]
        by_output["d"] = np.stack([scales_at_rest.motion(frame)["R"] for frame in frames.values()], axis=1)[..., None]
        by_output["jacobian"] = np.stack([scales.jacobian(frames[name]) @ columns for name in tips], axis=1)
    by_output["mass_matrix"] = columns.T @ scales.mass_matrix() @ columns
    by_output |= {name: one[:, None] for name, one in scales.energy_and_momentum().items()}
    by_output |= {name: by_output[name][:, 0] for name in ("kinetic", "potential")}
    force, torque = scales.forces()
    by_output |= {
        "force1": force[:, :1],
        "torque1": torque[:, :1],
        "tau": _generalized_scales(robot, scales, columns),
    }
    if robot.base == "free":
        by_output["tau"] = by_output["tau"][:, 6:]
    if "forward_dynamics" in our_outputs:
        joints_with_our_qdd = [*joints[:2], our_outputs["qdd"] @ twin.ratios.T]
        base = samples.base
        if robot.base == "free":
            base = replace(base, a=our_outputs["a1"], alpha=our_outputs["alpha1"])
        by_output["forward_dynamics"] = _generalized_scales(
            robot, RobotScales(robot.tree, joints_with_our_qdd, base, gravity), columns
        )
    return by_output


def _generalized_scales(robot: Mechanism, scales: RobotScales, columns: Float64Array) -> Float64Array:
    """Return the error scales of the generalized forces of a robot, shape (N, columns), from the RobotScales `scales`
    of forces, torques and rotors.
    """
    force, torque = scales.forces()
    slides = np.array([joint.kind == "slider" for joint in robot.tree.joints], dtype=bool)
    along = np.where(slides, force[:, 1:], torque[:, 1:]) + scales.rotor_efforts()
    base = [np.repeat(force[:, :1], 3, axis=1), np.repeat(torque[:, :1], 3, axis=1)]
    return np.concatenate((*base, along), axis=1) @ columns


def _errors_by_part(
    computed: Float64Array, expected: Float64Array, scale: Float64Array, u: float, part_count: int
) -> tuple[Float64Array, Float64Array]:
    """Compare computed and expected arrays (N, ...)."""
    comparable = np.isfinite(expected) & np.isfinite(scale)
    smallest = float(np.finfo(np.float64 if u < 1e-12 else np.float32).tiny)
    with np.errstate(all="ignore"):
        error = np.abs(computed - expected)
        error = np.where(comparable, np.where(np.isfinite(error), error, np.inf), np.nan)
        ratio = error / np.maximum(scale * u, smallest)
    shape = len(expected), part_count, error[0].size // part_count if len(expected) else 1
    return error.reshape(shape).max(axis=-1), ratio.reshape(shape).max(axis=-1)
