"""Comparison of the outputs of a robot with the outputs of Pinocchio."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.computations import BASE_LABELS, base_inputs
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.tree import Frame
from hingepair.numeric.arrays import Float64Array, broadcast_shape, one_constant
from hingepair.pair.accuracy import unit_roundoff
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_load import TORQUE_PARTS
from hingepair.plans.arguments import Coordinates, read_arguments
from hingepair.plans.trees import BASE_MOTION
from hingepair.validation.pinocchio_twin import (
    BASE_AT_REST,
    Twin,
    frame_motions,
    import_pinocchio,
    joins_wrongly,
    robot_twin,
)
from hingepair.validation.report import MAX_LOAD_RATIO, Comparison, CrossValidation
from hingepair.validation.robot_scales import FRAME_MOTION, LinkWrench, RobotScales
from hingepair.validation.states import finite_samples, samples_of
from hingepair.validation.urdf_twin import compare_descriptions, urdf_twin

# Parts of the residual of forward dynamics on a free base.
_BASE_WRENCH = ("force1_x", "force1_y", "force1_z", "torque1_x", "torque1_y", "torque1_z")


class _Samples(NamedTuple):
    """Coordinates of a robot and motion of its base at N samples; one that is not finite is NaN in all arrays."""

    shape: tuple[int, ...]  # leading shape, of N elements
    joints: list[Float64Array]  # q and, as far as given, qd and qdd; (N, dof) each
    base: BodyMotion  # with as many derivatives
    finite: NDArray[np.bool_]
    u: float  # unit roundoff of the robot's computation


class _Case(NamedTuple):
    """What both computations have in common."""

    robot: Mechanism
    twin: Twin
    samples: _Samples
    frames: Mapping[str, Frame]
    tips: tuple[str, ...]  # frames with Jacobians
    gravity: Float64Array
    wrenches: tuple[LinkWrench, ...] = ()

    def states(self) -> list[Float64Array]:
        """Return Pinocchio's q, v (if there are rates) and a (if there are accelerations); shape (N, ...) each."""
        joints, base = self.samples.joints, self.samples.base
        convert: tuple[Any, ...] = (self.twin.configuration, self.twin.velocity, self.twin.acceleration)
        return [convert[k](*joints[: k + 1], base) for k in range(len(joints))]

    def velocity_matrices(self) -> Float64Array:
        """Return the matrices from the velocities of the robot to Pinocchio's v; shape (N, nv, columns)."""
        (joints, dof), count = self.twin.ratios.shape, len(self.samples.finite)
        matrices = np.zeros((count, 6 + joints, 6 + dof))
        matrices[:, :3, :3] = matrices[:, 3:6, 3:6] = np.swapaxes(np.asarray(self.samples.base.S), -1, -2)
        matrices[:, 6:, 6:] = self.twin.ratios
        return matrices if self.robot.base == "free" else matrices[..., 6:]


def cross_validate_robot(
    robot: Mechanism,
    coordinates: Mapping[str, Coordinates],
    frames: str | Iterable[str] | None,
    base_motion: BodyMotion | None,
    gravity: ArrayLike,
) -> CrossValidation:
    """Compute the outputs of a robot by the equations and by Pinocchio, and compare them.

    Args:
        robot: the robot.
        coordinates: q, or q and qd, or q, qd and qdd, by name.
        frames: names of links, joints or further frames; all links unless given.
        base_motion: motion of the base; at rest at the origin unless given.
        gravity: acceleration of free fall [m/s^2]; shape (3,).
    """
    fall = one_constant("gravity", gravity, 3)
    names = (
        tuple(tree_of(robot).plain().links)
        if frames is None
        else (frames,)
        if isinstance(frames, str)
        else tuple(frames)
    )
    tips = robot.tips if frames is None else names
    known = {name: tree_of(robot).known_frame("frames", name) for name in names}
    samples = _read_samples(robot, coordinates, base_motion)
    ours = _outputs_by_equations(robot, coordinates, names, tips, base_motion, fall, samples.shape)
    twin, compared_with = urdf_twin(robot)
    description = () if twin is None else compare_descriptions(robot, twin)
    rows: tuple[Comparison, ...] = ()
    if all(row.ok for row in description[:1]):  # else the joints have other names
        twin = twin or robot_twin(robot, has_free_flyer=True)
        rows = _compare(_Case(robot, twin, samples, known, tips, fall), ours)
    return CrossValidation(
        robot.name, samples.shape, int((~samples.finite).sum()), samples.u, rows,
        f"{robot.base} base, {len(known)} frames",
        base=robot.base, frames=len(known), compared_with=compared_with, description=description,
    )  # fmt: skip


def compare_loads(
    robot: Mechanism,
    q: Float64Array,
    qd: Float64Array,
    qdd: Float64Array,
    base_motion: BodyMotion | None,
    gravity: ArrayLike,
    loads: Mapping[str, Float64Array],
    held: str,
    *,
    is_planar: bool = False,
) -> tuple[Comparison, ...]:
    """Compare the loads of a simulated motion with the forces that it requires by Pinocchio's `rnea`.

    Args:
        robot: the robot.
        q: coordinates; shape (N, dof).
        qd: their rates.
        qdd: their second derivatives.
        base_motion: motion of the base.
        gravity: acceleration of free fall [m/s^2]; shape (3,).
        loads: tau and its parts, such as spring, (N, dof), force1 and torque1 on the base, and wrenches on links,
            such as force_hand and torque_hand, (N, 3).
        held: what holds the base: what holds it gives further forces, which are no loads.
        is_planar: whether the motion is in the plane z = 0. What holds the base in it is no load.
    """
    coordinates = {"q": q, "qd": qd, "qdd": qdd}
    samples = _read_samples(robot, coordinates, base_motion)
    # Forces do not depend on the position of the base, and a large one would round the levers.
    samples = samples._replace(base=replace(samples.base, R=np.zeros_like(samples.base.R)))
    twin, _ = urdf_twin(robot)
    twin = twin or robot_twin(robot, has_free_flyer=True)
    fall = one_constant("gravity", gravity, 3)
    twin.model.gravity = import_pinocchio("cross_validate").Motion(fall, np.zeros(3))
    links = tuple(link for link in robot.links if f"force_{link}" in loads)
    wrenches = tuple(
        LinkWrench(tree_of(robot).links[link], loads[f"force_{link}"], loads[f"torque_{link}"]) for link in links
    )
    case = _Case(robot, twin, samples, {}, links, fall, wrenches)
    required, scales = _outputs_by_pinocchio(case), _output_scales(case, {})
    acting = {name: np.array(loads[name]) for name in ("tau", "force1", "torque1")}
    for k, wrench in enumerate(wrenches):
        on_link = np.concatenate((wrench.force, wrench.torque), axis=1)
        forces = np.einsum("nij,ni->nj", required["jacobian"][:, k], on_link)
        acting["tau"] += forces[:, forces.shape[1] - robot.dof :]
        if robot.base == "free":
            acting["force1"] += forces[:, :3]
            acting["torque1"] += forces[:, 3:6]
    if is_planar:
        for name, out_of_plane in (("force1", [2]), ("torque1", [0, 1])):
            acting[name][:, out_of_plane] = required[name][:, out_of_plane]
    names = {"free": ("tau", "force1", "torque1"), "pinned": ("tau", "torque1")}.get(held, ("tau",))
    rows = []
    for name in names:
        size = np.abs(loads[name])
        if name == "tau":  # whose parts may cancel
            size = size + sum(np.abs(loads[part]) for part in TORQUE_PARTS if part in loads)
        scale = scales[name] + (size if scales[name].ndim > 1 else size.max(axis=1))
        parts = robot.names if name == "tau" else ("",)
        rows.append(
            Comparison.of(
                name, acting[name], required[name], scale, samples.u, samples.shape, parts, bound=MAX_LOAD_RATIO
            )
        )
    return tuple(rows)


def _compare(case: _Case, ours: dict[str, Float64Array]) -> tuple[Comparison, ...]:
    """Return a row for each output of Pinocchio's; write the residual of forward dynamics to `ours`."""
    robot, samples = case.robot, case.samples
    case.twin.model.gravity = import_pinocchio("cross_validate").Motion(case.gravity, np.zeros(3))
    theirs = _outputs_by_pinocchio(case)
    singular: list[str] = []
    if "tau" in theirs:
        ours["forward_dynamics"], theirs["forward_dynamics"], singular = _residual(case, ours, theirs)
    scales = _output_scales(case, ours)
    parts = dict.fromkeys((*FRAME_MOTION, "d"), tuple(case.frames)) | {"jacobian": case.tips, "tau": robot.names}
    parts["forward_dynamics"] = (*(_BASE_WRENCH if robot.base == "free" else ()), *robot.names)
    rows = []
    for name, expected in theirs.items():
        if not expected.size and samples.finite.size:  # a robot without joints has neither tau nor mass matrix
            continue
        excused = {"singular": len(singular), "unresisted": singular[0]} if singular else {}
        fields = excused if name == "forward_dynamics" else {}
        own = parts.get(name, ("",))
        rows.append(Comparison.of(name, ours[name], expected, scales[name], samples.u, samples.shape, own, **fields))
    return tuple(rows)


def _read_samples(
    robot: Mechanism, coordinates: Mapping[str, Coordinates], base_motion: BodyMotion | None
) -> _Samples:
    """Return the checked coordinates and motion of the base, broadcast to samples."""
    names = BASE_MOTION[: 2 * len(coordinates)]
    attributes = {name: name[:-1] for name in names}
    shapes = {**dict.fromkeys(names, (3,)), "S1": (3, 3), **dict.fromkeys(coordinates, (robot.dof,))}
    motion = base_inputs(base_motion, names)
    given = {**coordinates, **{name: motion[name] for name in names if name in motion}}
    values = read_arguments(given, shapes, tree_of(robot).coordinate_names, BASE_LABELS)
    shape = broadcast_shape(values.shapes)
    at_rest = {name: np.asarray(getattr(BASE_AT_REST, attribute)) for name, attribute in attributes.items()}
    flat, finite = finite_samples(at_rest | values.values, shape, {"S1": 2})
    leaves = [part for name, part in values.values.items() if name in coordinates]
    single = base_motion is None and all(getattr(part, "dtype", None) == np.float32 for part in leaves)
    base = BodyMotion(**{attribute: flat[name] for name, attribute in attributes.items()})
    u = unit_roundoff(np.float32 if single else np.float64)
    return _Samples(shape, [flat[name] for name in coordinates], base, finite, u)


def _outputs_by_equations(
    robot: Mechanism,
    coordinates: Mapping[str, Coordinates],
    frames: tuple[str, ...],
    tips: tuple[str, ...],
    base_motion: BodyMotion | None,
    gravity: Float64Array,
    shape: tuple[int, ...],
) -> dict[str, Float64Array]:
    """Compute the compared outputs by the equations; shape (N, ...) each."""
    q, *rates = coordinates.values()
    base: dict[str, Any] = {"base_motion": base_motion}
    outputs: dict[str, tuple[Any, int]] = {}  # values, and the number of axes of one sample
    if frames:
        state = robot.forward_kinematics(q, *rates, frames=frames, **base)
        outputs |= {name: (getattr(state, name), 3 if name == "S" else 2) for name in state.outputs}
        outputs["jacobian"] = np.stack([robot.jacobian(q, name, **base) for name in tips], axis=-3), 3
    outputs["mass_matrix"] = robot.mass_matrix(q, **base), 2
    if rates:
        energy = robot.energy(q, rates[0], gravity=gravity, **base)
        momentum = robot.momentum(q, rates[0], **base)
        outputs |= {"kinetic": (energy.kinetic, 0), "potential": (energy.potential, 0)}
        outputs |= {"linear": (momentum.linear, 1), "angular": (momentum.angular, 1)}
    if len(rates) > 1:
        forces = robot.inverse_dynamics(q, *rates, gravity=gravity, joint_loads=False, **base)
        outputs |= {name: (forces[name], 1) for name in forces.outputs}
        loads: dict[str, Any] = {name: forces[name] for name in ("force1", "torque1")} if robot.base == "free" else {}
        accelerations = robot.forward_dynamics(
            q, rates[0], forces.tau, gravity=gravity, joint_loads=False, **loads, **base
        )
        outputs |= {name: (accelerations[name], 1) for name in accelerations.outputs}
    return {name: samples_of(value, shape, rank) for name, (value, rank) in outputs.items()}


def _outputs_by_pinocchio(case: _Case) -> dict[str, Float64Array]:
    """Compute the compared outputs by Pinocchio, NaN at samples that are not finite; shape (N, ...) each."""
    pin = import_pinocchio("cross_validate")
    finite, twin = case.samples.finite, case.twin
    if not finite.size:
        return {}
    states = case.states()
    for state in states:
        state[~finite] = 0.0
    states[0][~finite, 6] = 1.0  # the scalar part of the base's quaternion
    outputs: dict[str, Float64Array] = {}
    if case.frames:
        frames = [_frame_number(case, name) for name in case.frames]
        at_origin = states[0].copy()
        at_origin[:, :3] = 0  # R would contain the rounding errors of the base's position
        outputs["d"] = frame_motions(twin.model, twin.data, frames, [at_origin])["R"]
        outputs |= frame_motions(twin.model, twin.data, frames, states)
    tips = [_frame_number(case, name) for name in case.tips]
    columns = case.velocity_matrices()
    rows = []
    for i in range(len(finite)):
        now = [one[i] for one in states]
        row = _mass_outputs(pin, twin, tips, now, columns[i])
        if len(now) > 2:
            force = pin.rnea(twin.model, twin.data, *now)
            S = np.asarray(case.samples.base.S)[i] if finite[i] else np.eye(3)
            row |= {"tau": force[6:] @ twin.ratios, "force1": S @ force[:3], "torque1": S @ force[3:6]}
        rows.append(row)
    outputs |= {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    for array in outputs.values():
        array[~finite] = np.nan
    return outputs


def _frame_number(case: _Case, name: str) -> int:
    """Return the number of a frame in Pinocchio's model; a name that a link shares with a joint is the link's."""
    pin, is_link = import_pinocchio("cross_validate"), name in tree_of(case.robot).links
    for number, frame in enumerate(case.twin.model.frames):
        if frame.name == name and (frame.type == pin.FrameType.BODY) is is_link:
            return number
    raise ArgumentError("frames", "a frame that Pinocchio's model has, too", quoted(name))


def _mass_outputs(
    pin: Any, twin: Twin, tips: list[int], state: list[Float64Array], columns: Float64Array
) -> dict[str, Any]:
    """Compute Jacobians, mass matrix and, with rates, energies and momenta at a state (q, v, a) of Pinocchio's. The
    matrix `columns` leads from the robot's velocities to v.
    """
    model, data = twin.model, twin.data
    outputs: dict[str, Any] = {}
    pin.computeJointJacobians(model, data, state[0])
    pin.updateFramePlacements(model, data)
    if tips:
        jacobians = [pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED) for frame in tips]
        outputs["jacobian"] = np.array([one @ columns for one in jacobians])
    outputs["mass_matrix"] = columns.T @ _mass_matrix(pin, twin, state[0]) @ columns
    if len(state) > 1:
        outputs["kinetic"] = _kinetic_energy(pin, twin, *state[:2])
        outputs["potential"] = pin.computePotentialEnergy(model, data, state[0])
        if sum(inertia.mass for inertia in model.inertias):
            momentum = pin.computeCentroidalMomentum(model, data, *state[:2])
            about_origin = momentum.angular + np.cross(data.com[0], momentum.linear)
            outputs |= {"linear": momentum.linear.copy(), "angular": about_origin}
    return outputs


def _mass_matrix(pin: Any, twin: Twin, q: Float64Array) -> Float64Array:
    """Return the mass matrix at one configuration, by `rnea` where `crba` would add inertias wrongly."""
    model, data = twin.model, twin.data
    if not any(joins_wrongly(inertia.mass) for inertia in model.inertias):
        upper = np.triu(pin.crba(model, data, q))
        matrix: Float64Array = upper + np.triu(upper, 1).T
        return matrix
    gravity, rest = model.gravity.copy(), np.zeros(model.nv)
    model.gravity = pin.Motion.Zero()
    columns = [pin.rnea(model, data, q, rest, unit) for unit in np.eye(model.nv)]
    model.gravity = gravity
    return np.stack(columns, axis=-1)


def _kinetic_energy(pin: Any, twin: Twin, q: Float64Array, v: Float64Array) -> float:
    """Return the kinetic energy [J] of links and rotors."""
    armature = twin.model.armature.copy()
    # Pinocchio 4.1 includes rotors here, except the rotors of oblique hinges.
    twin.model.armature = np.zeros_like(armature)
    links: float = pin.computeKineticEnergy(twin.model, twin.data, q, v)
    twin.model.armature = armature
    return links + 0.5 * float(armature @ (v * v))


def _moved_base(case: _Case, ours: Mapping[str, Float64Array]) -> BodyMotion:
    """Return the motion of the base with the accelerations of forward dynamics, if it is free."""
    base = case.samples.base
    return replace(base, a=ours["a1"], alpha=ours["alpha1"]) if case.robot.base == "free" else base


def _residual(
    case: _Case, ours: Mapping[str, Float64Array], theirs: Mapping[str, Float64Array]
) -> tuple[Float64Array, Float64Array, list[str]]:
    """Return the forces that our accelerations require by `rnea`, those that act, NaN where the mass matrix is
    singular, and for each such sample what nothing resists.
    """
    pin, twin, joints = import_pinocchio("cross_validate"), case.twin, case.samples.joints
    q, v = case.states()[:2]
    a = twin.acceleration(joints[0], joints[1], ours["qdd"], _moved_base(case, ours))
    columns = case.velocity_matrices()
    acting = theirs["tau"].copy()
    if case.robot.base == "free":
        acting = np.concatenate((theirs["force1"], theirs["torque1"], acting), axis=-1)
    required = np.full_like(acting, np.nan)
    singular: list[str] = []
    for i in np.flatnonzero(case.samples.finite):
        if np.isfinite(a[i]).all():
            required[i] = pin.rnea(twin.model, twin.data, q[i], v[i], a[i]) @ columns[i]
        elif joint := _unresisted_joint(case.robot, theirs["mass_matrix"][i]):
            acting[i] = np.nan  # so that the sample is not compared
            singular.append(joint)
    return required, acting, singular


def _unresisted_joint(robot: Mechanism, matrix: Float64Array) -> str:
    """Return a clause on what moves most where a mass matrix resists nothing; "" if it is regular."""
    size = np.sqrt(np.abs(np.diagonal(matrix)))
    motion = (size == 0).astype(float)
    if size.all():
        least, motions = np.linalg.eigh(matrix / size / size[:, None])
        motion = motions[:, 0] if least[0] < 1e-12 else motion  # smaller eigenvalues consist of rounding errors
    if not motion.any():
        return ""
    names = ("the base",) * (len(size) - robot.dof) + tuple(f"joint {name!r}" for name in robot.names)
    return f"nothing resists {names[int(np.argmax(np.abs(motion)))]}"


def _output_scales(case: _Case, ours: Mapping[str, Float64Array]) -> dict[str, Float64Array]:
    """Return the error scales of all outputs by name, which broadcast against them; forward_dynamics if in `ours`."""
    robot, twin, samples = case.robot, case.twin, case.samples
    joints = [twin.joint_positions(samples.joints[0]), *(one[:, 6:] for one in case.states()[1:])]
    scales = RobotScales(tree_of(robot), joints, samples.base, case.gravity, case.wrenches)
    columns = np.zeros((6 + len(twin.ratios), 6 + robot.dof))
    columns[:6, :6], columns[6:, 6:] = np.eye(6), np.abs(twin.ratios)
    columns = columns if robot.base == "free" else columns[:, 6:]
    by_output: dict[str, Float64Array] = {}
    if case.frames:
        at_origin = replace(samples.base, R=np.zeros_like(samples.base.R))
        offsets = RobotScales(tree_of(robot), joints[:1], at_origin, case.gravity)
        motions = [scales.motion(frame) for frame in case.frames.values()]
        by_output |= {name: np.stack([one[name] for one in motions], axis=1)[..., None] for name in FRAME_MOTION}
        by_output["S"] = by_output["S"][..., None]
        by_output["d"] = np.stack([offsets.motion(frame)["R"] for frame in case.frames.values()], axis=1)[..., None]
        jacobians = [scales.jacobian(case.frames[name]) @ columns for name in case.tips]
        by_output["jacobian"] = np.stack(jacobians, axis=1)
    by_output["mass_matrix"] = columns.T @ scales.mass_matrix() @ columns
    by_output |= scales.energy_and_momentum()
    force, torque = scales.forces()
    tau = _generalized_scales(robot, scales, columns)
    by_output |= {"force1": force[:, 0], "torque1": torque[:, 0], "tau": tau[:, tau.shape[1] - robot.dof :]}
    if "forward_dynamics" in ours:
        moved = [*joints[:2], ours["qdd"] @ twin.ratios.T]
        found = RobotScales(tree_of(robot), moved, _moved_base(case, ours), case.gravity)
        by_output["forward_dynamics"] = _generalized_scales(robot, found, columns)
    return by_output


def _generalized_scales(robot: Mechanism, scales: RobotScales, columns: Float64Array) -> Float64Array:
    """Return the scales of generalized forces; `columns` leads from the robot's velocities to the joints'."""
    force, torque = scales.forces()
    turns, shifts = np.abs([joint.axis for joint in tree_of(robot).joints]).reshape(-1, 2).T
    along = turns * torque[:, 1:] + shifts * force[:, 1:] + scales.rotor_efforts()
    base = [np.repeat(force[:, :1], 3, axis=1), np.repeat(torque[:, :1], 3, axis=1)]
    return np.concatenate((*base, along), axis=1) @ columns
