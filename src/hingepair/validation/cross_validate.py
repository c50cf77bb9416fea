"""Comparison of the outputs of pairs and robots with those of Pinocchio, and of simulated loads with its `rnea`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.bodies.hinge_load import TORQUE_PARTS
from hingepair.mechanism.building.pairs import tree_of_pair
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.pairs.accuracy import euler_rate_sizes, norm, output_scales, unit_roundoff
from hingepair.mechanism.pairs.geometry import check_pair
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.pairs.requests import read_rows
from hingepair.mechanism.robots.computations import BASE_LABELS, base_inputs
from hingepair.mechanism.tree import Frame, Tree
from hingepair.numeric.arrays import Float64Array, broadcast_shape, one_constant
from hingepair.plans.arguments import Coordinates, read_arguments
from hingepair.plans.pairs import PLANE, POINT_ENDINGS, SPACE
from hingepair.plans.trees import BASE_MOTION
from hingepair.validation.loops import Linkage
from hingepair.validation.pinocchio_twin import (
    Twin,
    frame_motions,
    import_pinocchio,
    joint_rules,
    pair_twin,
    robot_twin,
)
from hingepair.validation.report import MAX_LOAD_RATIO, Comparison, CrossValidation
from hingepair.validation.scales import Scales
from hingepair.validation.urdf_twin import urdf_twin

_LETTERS = ("R", "S", "v", "omega", "a", "alpha")  # of the motion of a frame
_BASE_WRENCH = tuple(f"{part}_{axis}" for part in ("force1", "torque1") for axis in "xyz")
_LEAST_INSTANTS = 8  # of a motion whose rates are compared with slopes
_RATE_SHARE = 1e-3  # of the largest rate; a rate that is off by less is not told from errors of a simulation


def cross_validate(
    pair: HingePair | PlanarPair | Mechanism,
    q: Any,
    qd: Any = None,
    qdd: Any = None,
    psidd: ArrayLike | None = None,
    *,
    sequence: str = "XYZ",
    frames: str | Iterable[str] | None = None,
    base_motion: BodyMotion | None = None,
    gravity: ArrayLike = DEFAULT_GRAVITY,
) -> CrossValidation:
    """Compare the outputs that hingepair computes for a pair or a robot with those that Pinocchio computes.

    The two computations share no code. For a pair, Pinocchio also computes the attitude and the angular velocity of
    body 1 from the Euler angles, with a chain of three revolute joints in the order of the Euler sequence. R2, S2 and
    d = R2 - R1 are compared, with qd also v2 and omega2, with qdd also a2 and alpha2, and the motion of points, which
    are frames there. Pinocchio computes d as the position of body 2 for R1 = 0, because the difference of R2 and R1
    would contain the rounding errors of both.

    A robot that was read from a URDF is compared with the model that Pinocchio itself makes of the same text. A robot
    that came from pairs or from a Pinocchio model, has a payload, or was read with `snap` is compared with a model
    that is built from the robot, which shows errors of the computations but not of the reading. The report says which
    (`.compared_with`).

    For a robot, the motion and the Jacobians of links (see `frames`) and the mass matrix are compared. If qd is
    given, energies and momenta are compared too, and if qdd is given, forces and torques. Forward dynamics is checked
    by its residual: Pinocchio's inverse dynamics computes the forces that hingepair's accelerations require, and
    these forces are compared with the applied forces. Samples at which the mass matrix is singular are left out of
    this comparison.

    Args:
        pair: a `HingePair`, a `PlanarPair` or a `Mechanism` (robot). A planar pair is compared in the plane, with the
            angle phi2 in place of S2.
        q: coordinates. For a pair (x, y, z, phi_x, phi_y, phi_z, psi) [m, rad], shape (..., 7) or a tuple of seven
            coordinates; for a planar pair (x, y, phi, psi) [m, rad], shape (..., 4) or a tuple of four. For a robot,
            an array of shape (..., dof), a table whose columns have the joints' names, or a dict with a number or an
            array for each joint's name. Or, of a `HingePair`, body1, a BodyMotion, before psi, psid and psidd. Its S
            must be a rotation to within rounding errors, as `project_to_rotation` returns it, because Pinocchio
            stores attitudes as quaternions.
        qd: first time derivatives of q, in the same form as q.
        qdd: second time derivatives of q, in the same form as q.
        psidd: second time derivative of psi [rad/s^2], after body1, psi and psid.
        sequence: Euler sequence of body 1 of a `HingePair`; "XYZ" unless given.
        frames: for a robot, names of the links, joints or other frames whose motion and Jacobians are compared. By
            default, the motion of all links and the Jacobians of all links without children are compared.
        base_motion: for a robot, BodyMotion of its base; by default the base rests at the origin.
        gravity: for a robot, acceleration of free fall, world axes [m/s^2]; shape (3,); (0, 0, -9.81) by default.

    Returns:
        A `CrossValidation` (hingepair.validation.report). It has `.ok` (True if all compared outputs agree; False if
        one does not, or if no sample could be compared), `.verdict` (text of one line), `.to_json()` (the report as
        JSON text), `.skipped` (number of samples that were left out because an input is not finite) and `.rows`.
        `print` shows the report as a table. `.rows` is a tuple with a row for each output, with these attributes:

        - `.output`: name of the output;
        - `.max_error`: largest error, in the unit of the output;
        - `.max_ratio`: largest ratio of the error to u * scale, where u is the unit roundoff (2^-53 for float64), and
          the scale is the size of the terms that are added to form the output;
        - `.bound`: the largest ratio at which the output counts as agreeing;
        - `.worst_sample`: index of the sample with the largest ratio, as a tuple;
        - `.worst_part`: name of the link or joint with the largest ratio, for a robot only;
        - `.samples`: number of compared samples.

    Raises:
        ArgumentError: an argument cannot be used by `forward_kinematics` of the pair or robot, or has no meaning for
            it, such as `gravity` for a pair.
        MissingDependencyError: Pinocchio is not installed.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0))
    >>> hp.cross_validate(pair, np.linspace(0, 3, 70).reshape(10, 7)).ok
    True
    >>> hp.cross_validate(pair, hp.BodyMotion.from_rotvec(R=(1, 2, 3), rotvec=(0.1, 0.2, 0.3)), 0.5).ok
    True
    """
    is_robot, by_body1 = isinstance(pair, Mechanism), isinstance(q, BodyMotion)
    if psidd is not None and not by_body1:
        raise ArgumentError("psidd", "nothing, since q is no BodyMotion", quoted(psidd))
    if by_body1 and (is_robot or isinstance(pair, PlanarPair)):
        raise ArgumentError("q", "coordinates, unless of a HingePair", quoted(q))
    if (by_body1 or is_robot or isinstance(pair, PlanarPair)) and sequence != "XYZ":
        raise ArgumentError("sequence", "nothing, since there are no Euler angles", quoted(sequence))
    given_gravity = None if gravity is DEFAULT_GRAVITY else gravity
    of_robots: dict[str, Any] = {"frames": frames, "base_motion": base_motion, "gravity": given_gravity}
    for name, value in of_robots.items():
        if value is not None and not is_robot:
            raise ArgumentError(name, "nothing, since it is for robots", quoted(value))
    if not isinstance(pair, Mechanism | PlanarPair):
        check_pair(pair)
    with np.errstate(all="ignore"):  # scales may overflow
        if isinstance(pair, Mechanism):
            coordinates = {name: value for name, value in (("q", q), ("qd", qd), ("qdd", qdd)) if value is not None}
            return _compare_robot(pair, coordinates, frames, base_motion, gravity)
        if by_body1 and not isinstance(pair, PlanarPair):
            return _compare_from_body1(pair, q, [c for c in (qd, qdd, psidd) if c is not None])
        return _compare_pair(pair, q, qd, qdd, sequence)


class _Samples(NamedTuple):
    """Coordinates of joints and motion of the base at N samples; one that is not finite is NaN in all arrays."""

    shape: tuple[int, ...]  # leading shape, of N elements
    joints: list[Float64Array]  # q and, as far as given, qd and qdd; (N, dof) each
    base: BodyMotion  # with as many derivatives
    finite: NDArray[np.bool_]

    @classmethod
    def of(cls, values: Mapping[str, Any], shape: tuple[int, ...], joints: int) -> _Samples:
        """Return samples of the parts of the base's motion by letter and, the last `joints` ones, of coordinates."""
        arrays = {name: _rows(value, shape, 2 if name == "S" else 1) for name, value in values.items()}
        own = [np.isfinite(one).all(axis=tuple(range(1, one.ndim))) for one in arrays.values()]
        finite = np.logical_and.reduce(own)
        for array in arrays.values():
            array[~finite] = np.nan
        base = BodyMotion(**{name: array for name, array in arrays.items() if name in _LETTERS})
        return cls(shape, [*arrays.values()][-joints:], base, finite)

    def states(self, twin: Twin) -> list[Float64Array]:
        """Return Pinocchio's q, v (if there are rates) and a (if there are accelerations); shape (N, ...) each."""
        convert: tuple[Any, ...] = (twin.configuration, twin.velocity, twin.acceleration)
        return [convert[k](*self.joints[: k + 1], self.base) for k in range(len(self.joints))]

    def frames(self, twin: Twin, numbers: Sequence[int]) -> dict[str, Float64Array]:
        """Return the motion of frames by Pinocchio, and d, the position for a base at the origin; (N, frames, ...).
        Positions from a base far away would contain its rounding errors.
        """
        states = self.states(twin)
        at_origin = states[0].copy()
        at_origin[:, :3] = 0
        found = {"d": frame_motions(twin.model, twin.data, numbers, [at_origin])["R"]}
        return found | frame_motions(twin.model, twin.data, numbers, states)


def _rows(value: Any, shape: tuple[int, ...], rank: int) -> Float64Array:
    """Return a copy of an array, or of a tuple of components, as N samples of the leading shape; (N, ...)."""
    array = np.stack(np.broadcast_arrays(*value), axis=-1) if isinstance(value, tuple) else np.asarray(value)
    own = array.shape[array.ndim - rank :]
    return np.array(np.broadcast_to(array, (*shape, *own)), dtype=np.float64).reshape(math.prod(shape), *own)


# ---- pairs


def _outputs_of(pair: HingePair | PlanarPair, levels: int) -> tuple[str, ...]:
    """Return the outputs of body 2 and of points that coordinates and `levels - 1` of their derivatives determine."""
    attitude = "phi2" if isinstance(pair, PlanarPair) else "S2"
    groups = (("R2", attitude, "d"), ("v2", "omega2"), ("a2", "alpha2"))[:levels]
    endings = [*POINT_ENDINGS.values()][:levels]
    points = (*pair.points1, *pair.points2)
    return *(name for group in groups for name in group), *(point + ending for point in points for ending in endings)


def _compare_pair(pair: HingePair | PlanarPair, q: Any, qd: Any, qdd: Any, sequence: str) -> CrossValidation:
    """Return the report on a pair in coordinates, which Pinocchio turns into the motion of body 1."""
    planar = isinstance(pair, PlanarPair)
    levels = 1 + (qd is not None) + (qdd is not None)
    options: dict[str, Any] = {} if planar else {"sequence": sequence}
    state = pair.forward_kinematics(q, qd, qdd, outputs=_outputs_of(pair, levels), **options)
    shape = np.shape(state.R2)[:-1]
    rows = [_rows(one, shape, 1) for one in read_rows(PLANE if planar else SPACE, q, qd, qdd).values.values()]
    rows = [np.insert(one, (2, 2, 2), 0.0, axis=1) if planar else one for one in rows]
    values = {**_body1_by_pinocchio(rows, sequence), **{f"psi{k}": one[:, 6:] for k, one in enumerate(rows)}}
    samples = _Samples.of(values, (len(rows[0]),), levels)._replace(shape=shape)
    sizes = euler_rate_sizes(*(one[:, 3:6] for one in rows[1:])) if levels > 1 else (None, None)
    subject = "in the plane" if planar else f"Euler sequence {sequence}"
    return _pair_report(pair, samples, sizes, state, subject, None if planar else sequence)


def _compare_from_body1(pair: HingePair, body1: BodyMotion, angles: list[ArrayLike]) -> CrossValidation:
    """Return the report on a pair whose body 1 moves as given, with psi and, as far as given, its derivatives."""
    state = pair.forward_kinematics_from_body1(body1, *angles, outputs=_outputs_of(pair, len(angles)))
    columns = {f"psi{k}": np.asarray(one)[..., None] for k, one in enumerate(angles)}
    values = {letter: getattr(body1, letter) for letter in _LETTERS[: 2 * len(angles)]} | columns
    samples = _Samples.of(values, state.shape, len(angles))
    sizes = [None if part is None else norm(part) for part in (samples.base.omega, samples.base.alpha)]
    return _pair_report(pair, samples, sizes, state, "attitude given", None)


def _pair_report(
    pair: HingePair | PlanarPair, samples: _Samples, sizes: Any, state: Any, subject: str, sequence: str | None
) -> CrossValidation:
    """Return the report on `state`, which the equations computed; `sizes` are W1 and A1 of the scales."""
    space = pair.to_spatial() if isinstance(pair, PlanarPair) else pair
    twin, tree, base = pair_twin(space).robot, tree_of_pair(space), samples.base
    names = ("body2", *space.points1, *space.points2)
    motion = samples.frames(twin, [twin.model.getFrameId(name) for name in names])
    angles = [*(one[:, 0] for one in samples.joints), None, None][:3]
    moving: dict[str, Any] = {"R1": base.R, "v1": base.v, "a1": base.a, "W1": sizes[0], "A1": sizes[1]}
    scales = output_scales(u1=space.u1, u2=space.u2, psid=angles[1], psidd=angles[2], pinocchio=True, **moving)
    outputs = {("d" if letter == "d" else letter + "2"): values[:, 0] for letter, values in motion.items()}
    of_frames = Scales(tree, samples.joints, base)
    for k, name in enumerate(names[1:], 1):
        own = of_frames.motion(tree.frames[name])
        for letter, ending in POINT_ENDINGS.items():
            if letter in motion:
                outputs[name + ending], scales[name + ending] = motion[letter][:, k], own[letter]
    if isinstance(pair, PlanarPair):
        phi2 = np.asarray(state.phi2, np.float64).reshape(-1)
        outputs = {name: one[:, 2:] if name in {"omega2", "alpha2"} else one[:, :2] for name, one in outputs.items()}
        S2 = outputs.pop("S2")
        off = np.arctan2(S2[:, 1, 0], S2[:, 0, 0]) - phi2  # the attitude does not tell whole turns
        outputs["phi2"] = (phi2 + np.arctan2(np.sin(off), np.cos(off)))[:, None]
        scales["phi2"] = 1 + np.abs(phi2) + np.abs(np.asarray(angles[0]))
    u = unit_roundoff(np.asarray(state.R2).dtype)
    computed = state.arrays()
    rows = tuple(
        Comparison.of(name, computed[name], outputs[name], np.asarray(scales[name]), u, samples.shape)
        for name in _outputs_of(pair, len(samples.joints))
    )
    return CrossValidation(pair.name, samples.shape, int((~samples.finite).sum()), u, rows, subject, sequence)


def _body1_by_pinocchio(rows: list[Float64Array], sequence: str) -> dict[str, Float64Array]:
    """Compute the motion of body 1 from q and, as far as given, its derivatives, shape (N, 7) each: its attitude is
    that of the last link of a chain of three joints, in reverse order for an extrinsic sequence.
    """
    pin = import_pinocchio("cross_validate")
    order = -1 if sequence.islower() else 1
    model, joint, identity = pin.Model(), 0, pin.SE3.Identity()
    for letter in sequence.upper()[::order]:
        joint = model.addJoint(joint, getattr(pin, f"JointModelR{letter}")(), identity, f"R{letter}{joint}")
    frame = model.addFrame(pin.Frame("body1", joint, identity, pin.FrameType.OP_FRAME))
    angles = [np.ascontiguousarray(c[:, 3:6][:, ::order]) for c in rows]
    motion = frame_motions(model, model.createData(), [frame], angles)
    translations = zip(("R", "v", "a"), (c[:, :3] for c in rows), strict=False)
    return {name: array[:, 0] for name, array in motion.items()} | dict(translations)


# ---- robots


class _Case(NamedTuple):
    """What both computations of a robot have in common."""

    robot: Mechanism
    twin: Twin
    samples: _Samples
    frames: Mapping[str, Frame]
    tips: tuple[str, ...]  # frames with Jacobians
    gravity: Float64Array

    @property
    def tree(self) -> Tree:
        return tree_of(self.robot)

    def velocity_matrices(self) -> Float64Array:
        """Return the matrices from the velocities of the robot to Pinocchio's v; shape (N, nv, columns)."""
        (joints, dof), count = self.twin.ratios.shape, len(self.samples.finite)
        matrices = np.zeros((count, 6 + joints, 6 + dof))
        matrices[:, :3, :3] = matrices[:, 3:6, 3:6] = np.swapaxes(np.asarray(self.samples.base.S), -1, -2)
        matrices[:, 6:, 6:] = self.twin.ratios
        return matrices if self.robot.base == "free" else matrices[..., 6:]

    def with_accelerations(self, found: Mapping[str, Float64Array]) -> _Case:
        """Return the case with the accelerations of forward dynamics."""
        samples, base = self.samples, self.samples.base
        if self.robot.base == "free":
            base = replace(base, a=found["a1"], alpha=found["alpha1"])
        return self._replace(samples=samples._replace(joints=[*samples.joints[:2], found["qdd"]], base=base))


def _compare_robot(
    robot: Mechanism,
    coordinates: Mapping[str, Coordinates],
    frames: str | Iterable[str] | None,
    base_motion: BodyMotion | None,
    gravity: ArrayLike,
) -> CrossValidation:
    """Return the report on a robot; `coordinates` are q and, as far as given, qd and qdd."""
    tree, fall = tree_of(robot).single(), one_constant("gravity", gravity, 3)
    linkage = Linkage.of(robot)
    inner = robot if linkage is None else linkage.plain
    everything = coordinates if linkage is None else linkage.of_all_joints(coordinates)
    names = (frames,) if isinstance(frames, str) else tuple(tree.links if frames is None else frames)
    known = {name: tree.known_frame("frames", name) for name in names}
    tips = robot.tips if frames is None else names
    samples, u = _read_samples(inner, everything, base_motion)
    ours = _outputs_by_equations(robot, coordinates, names, tips, base_motion, fall, samples.shape)
    twin, compared_with, other_names = urdf_twin(inner)
    if other_names:  # nothing else can be compared
        rows: tuple[Comparison, ...] = (Comparison("names", np.inf, np.inf, (), 1, worst_part=other_names[0]),)
    else:
        case = _Case(inner, twin, samples, known, tips, fall)
        rows = _robot_rows(case, ours, u, linkage, coordinates)
    return CrossValidation(
        robot.name, samples.shape, int((~samples.finite).sum()), u, rows,
        f"{robot.base} base, {len(known)} frames", base=robot.base, frames=len(known), compared_with=compared_with,
    )  # fmt: skip


def _robot_rows(
    case: _Case,
    ours: dict[str, Float64Array],
    u: float,
    linkage: Linkage | None = None,
    coordinates: Mapping[str, Any] | None = None,
) -> tuple[Comparison, ...]:
    """Return a row for each output of Pinocchio's; write the residual of forward dynamics to `ours`. With a linkage,
    the case is of its tree, and `ours` and the coordinates of the closed robot.
    """
    names, shape = case.robot.names if linkage is None else linkage.robot.names, case.samples.shape
    theirs, scales = _outputs_by_pinocchio(case), _output_scales(case)
    singular = 0
    if "tau" in theirs:
        moved = ours if linkage is None else ours | {"qdd": linkage.accelerations(coordinates or {}, ours["qdd"])}
        found = case.with_accelerations(moved)
        ours["forward_dynamics"], theirs["forward_dynamics"], singular = _residual(found, theirs)
        scales["forward_dynamics"] = _generalized_scales(found)[1]
    if linkage is not None and theirs:
        samples = case.samples
        reduction, of_loops = linkage.compared(
            case.twin, samples.joints, samples.states(case.twin), coordinates or {}
        )
        if "tau" in theirs:
            ours["forward_dynamics"], _ = linkage.onto_coordinates(reduction, ours["forward_dynamics"])
        theirs, scales = linkage.reduced(reduction, theirs, scales)
        for name, values in of_loops.items():
            ours[name], theirs[name], scales[name] = values
    parts = dict.fromkeys((*_LETTERS, "d"), tuple(case.frames)) | {"jacobian": case.tips, "tau": names}
    parts["forward_dynamics"] = (*(_BASE_WRENCH if case.robot.base == "free" else ()), *names)
    rows = []
    for name, expected in theirs.items():
        if expected.size or not case.samples.finite.size:  # a robot without joints has neither tau nor mass matrix
            left_out = {"singular": singular} if name == "forward_dynamics" else {}
            own = parts.get(name, ("",))
            rows.append(Comparison.of(name, ours[name], expected, scales[name], u, shape, own, **left_out))
    return tuple(rows)


def _read_samples(
    robot: Mechanism, coordinates: Mapping[str, Coordinates], base_motion: BodyMotion | None
) -> tuple[_Samples, float]:
    """Return the checked coordinates and motion of the base, broadcast, and the unit roundoff of computations."""
    names = BASE_MOTION[: 2 * len(coordinates)]
    shapes = {**dict.fromkeys(names, (3,)), "S1": (3, 3), **dict.fromkeys(coordinates, (robot.dof,))}
    motion = base_inputs(base_motion, names)
    given = {**coordinates, **{name: motion[name] for name in names if name in motion}}
    read = read_arguments(given, shapes, tree_of(robot).coordinate_names, BASE_LABELS)
    at_rest = {name[:-1]: np.eye(3) if name == "S1" else np.zeros(3) for name in names}
    of_base = {name[:-1]: value for name, value in read.values.items() if name not in coordinates}
    of_joints = {name: read.values[name] for name in coordinates}
    single = base_motion is None and all(getattr(part, "dtype", None) == np.float32 for part in of_joints.values())
    samples = _Samples.of(at_rest | of_base | of_joints, broadcast_shape(read.shapes), len(coordinates))
    return samples, unit_roundoff(np.float32 if single else np.float64)


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
    fall: dict[str, Any] = {"gravity": gravity, **base}
    outputs: dict[str, tuple[Any, int]] = {}  # values, and the number of axes of one sample
    if frames:
        state = robot.forward_kinematics(q, *rates, frames=frames, **base)
        outputs |= {name: (getattr(state, name), 3 if name == "S" else 2) for name in state.outputs}
        outputs["jacobian"] = np.stack([robot.jacobian(q, name, **base) for name in tips], axis=-3), 3
    outputs["mass_matrix"] = robot.mass_matrix(q, **base), 2
    if rates:
        energy, momentum = robot.energy(q, rates[0], **fall), robot.momentum(q, rates[0], **base)
        outputs |= {"kinetic": (energy.kinetic, 0), "potential": (energy.potential, 0)}
        outputs |= {"linear": (momentum.linear, 1), "angular": (momentum.angular, 1)}
    if len(rates) > 1:
        forces = robot.inverse_dynamics(q, *rates, joint_loads=False, **fall)
        loads: dict[str, Any] = {name: forces[name] for name in ("force1", "torque1")} if robot.base == "free" else {}
        moved = robot.forward_dynamics(q, rates[0], forces.tau, joint_loads=False, **loads, **fall)
        outputs |= {name: (one[name], 1) for one in (forces, moved) for name in one.outputs}
    return {name: _rows(value, shape, rank) for name, (value, rank) in outputs.items()}


def _outputs_by_pinocchio(case: _Case) -> dict[str, Float64Array]:
    """Compute the compared outputs by Pinocchio, NaN at samples that are not finite; shape (N, ...) each."""
    pin = import_pinocchio("cross_validate")
    twin, count = case.twin, len(case.samples.finite)
    if not count:
        return {}
    twin.model.gravity = pin.Motion(case.gravity, np.zeros(3))
    outputs = case.samples.frames(twin, [_frame_number(case, name) for name in case.frames]) if case.frames else {}
    tips = [_frame_number(case, name) for name in case.tips]
    found: dict[str, Float64Array] = {}
    sides = zip(*case.samples.states(twin), case.velocity_matrices(), np.asarray(case.samples.base.S), strict=True)
    for i, (*state, columns, S) in enumerate(sides):
        for name, value in _outputs_of_state(pin, twin, tips, state, columns, S).items():
            found.setdefault(name, np.full((count, *np.shape(value)), np.nan))[i] = value
    outputs |= found
    for array in outputs.values():
        array[~case.samples.finite] = np.nan
    return outputs


def _frame_number(case: _Case, name: str) -> int:
    """Return the number of a frame in Pinocchio's model; a name that a link shares with a joint is the link's."""
    pin, is_link = import_pinocchio("cross_validate"), name in case.tree.links
    for number, frame in enumerate(case.twin.model.frames):
        if frame.name == name and (frame.type == pin.FrameType.BODY) is is_link:
            return number
    raise ArgumentError("frames", "a frame that Pinocchio's model has, too", quoted(name))


def _outputs_of_state(
    pin: Any,
    twin: Twin,
    tips: list[int],
    state: list[Float64Array],
    columns: Float64Array,
    S: Float64Array,
) -> dict[str, Any]:
    """Compute Jacobians, mass matrix, energies, momenta and forces at a state (q, v, a) of Pinocchio's. The matrix
    `columns` leads from the robot's velocities to v, and S is the attitude of the base.
    """
    model, data = twin.model, twin.data
    outputs: dict[str, Any] = {}
    pin.computeJointJacobians(model, data, state[0])
    pin.updateFramePlacements(model, data)
    if tips:
        jacobians = [pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED) for frame in tips]
        outputs["jacobian"] = np.array([one @ columns for one in jacobians])
    upper = np.triu(pin.crba(model, data, state[0]))
    matrix = upper + np.triu(upper, 1).T
    outputs["mass_matrix"] = columns.T @ matrix @ columns
    if len(state) > 1:
        # Not by computeKineticEnergy, which in Pinocchio 4.1 leaves out the rotors of oblique hinges.
        outputs["kinetic"] = 0.5 * float(state[1] @ matrix @ state[1])
        outputs["potential"] = pin.computePotentialEnergy(model, data, state[0])
        if sum(inertia.mass for inertia in model.inertias):
            momentum = pin.computeCentroidalMomentum(model, data, *state[:2])
            about_origin = momentum.angular + np.cross(data.com[0], momentum.linear)
            outputs |= {"linear": momentum.linear, "angular": about_origin}
    if len(state) > 2:
        force = pin.rnea(model, data, *state)
        outputs |= {"tau": force[6:] @ twin.ratios, "force1": S @ force[:3], "torque1": S @ force[3:6]}
    return outputs


def _residual(case: _Case, theirs: Mapping[str, Float64Array]) -> tuple[Float64Array, Float64Array, int]:
    """Return the forces that the accelerations of forward dynamics require by `rnea`, those that act, NaN where the
    mass matrix is singular, and at how many samples it is.
    """
    pin, twin, columns = import_pinocchio("cross_validate"), case.twin, case.velocity_matrices()
    q, v, a = case.samples.states(twin)
    acting = theirs["tau"].copy()
    if case.robot.base == "free":
        acting = np.concatenate((theirs["force1"], theirs["torque1"], acting), axis=-1)
    required, singular = np.full_like(acting, np.nan), 0
    for i in np.flatnonzero(case.samples.finite):
        if np.isfinite(a[i]).all():
            required[i] = pin.rnea(twin.model, twin.data, q[i], v[i], a[i]) @ columns[i]
        elif _is_singular(theirs["mass_matrix"][i]):
            acting[i] = np.nan  # so that the sample is not compared
            singular += 1
    return required, acting, singular


def _is_singular(matrix: Float64Array) -> bool:
    """Return whether a mass matrix resists some motion by nothing but rounding errors."""
    size = np.sqrt(np.abs(np.diagonal(matrix)))
    return not size.all() or bool(np.linalg.eigvalsh(matrix / size / size[:, None])[0] < 1e-12)


# ---- scales


def _scales_of(case: _Case, base: BodyMotion | None = None) -> tuple[Scales, Float64Array]:
    """Return the Scales of a robot, and the matrix from the sizes of its velocities to those of all joints."""
    ratios, offsets = joint_rules(case.tree)  # without joints that are held, which the twin may have
    joints = [one @ ratios.T for one in case.samples.joints]
    joints[0] = joints[0] + offsets
    columns = np.zeros((6 + len(ratios), 6 + case.robot.dof))
    columns[:6, :6], columns[6:, 6:] = np.eye(6), np.abs(ratios)
    scales = Scales(case.tree, joints, base or case.samples.base, case.gravity)
    return scales, columns if case.robot.base == "free" else columns[:, 6:]


def _output_scales(case: _Case) -> dict[str, Float64Array]:
    """Return the error scales of all outputs by name, which broadcast against them."""
    scales, columns = _scales_of(case)
    by_output: dict[str, Float64Array] = {}
    if case.frames:
        base = case.samples.base
        from_base, _ = _scales_of(case, replace(base, R=np.zeros_like(base.R)))
        motions = [scales.motion(frame) for frame in case.frames.values()]
        by_output |= {name: np.stack([one[name] for one in motions], axis=1)[..., None] for name in motions[0]}
        by_output["S"] = by_output["S"][..., None]
        by_output["d"] = np.stack([from_base.motion(frame)["R"] for frame in case.frames.values()], axis=1)[..., None]
        jacobians = [scales.jacobian(case.frames[name]) @ columns for name in case.tips]
        by_output["jacobian"] = np.stack(jacobians, axis=1)
    by_output["mass_matrix"] = columns.T @ scales.mass_matrix() @ columns
    (force, torque), tau = _generalized_scales(case)
    by_output |= {"force1": force[:, 0], "torque1": torque[:, 0], "tau": tau[:, tau.shape[1] - case.robot.dof :]}
    return by_output | scales.energy_and_momentum()


def _generalized_scales(case: _Case) -> tuple[tuple[Float64Array, Float64Array], Float64Array]:
    """Return the scales of the forces and torques on all bodies, and of generalized forces."""
    scales, columns = _scales_of(case)
    force, torque = scales.forces()
    turns, shifts = np.abs([joint.axis for joint in case.tree.joints]).reshape(-1, 2).T
    along = turns * torque[:, 1:] + shifts * force[:, 1:] + scales.rotor_efforts()
    base = [np.repeat(force[:, :1], 3, axis=1), np.repeat(torque[:, :1], 3, axis=1)]
    return (force, torque), np.concatenate((*base, along), axis=1) @ columns


# ---- simulated motions


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
    samples, u = _read_samples(robot, {"q": q, "qd": qd, "qdd": qdd}, base_motion)
    # Forces do not depend on the position of the base, and a large one would round the levers.
    samples = samples._replace(base=replace(samples.base, R=np.zeros_like(samples.base.R)))
    links = tuple(link for link in robot.links if f"force_{link}" in loads)
    fall = one_constant("gravity", gravity, 3)
    case = _Case(robot, robot_twin(robot, has_free_flyer=True), samples, {}, links, fall)
    required, scales = _outputs_by_pinocchio(case), _output_scales(case)
    acting = {name: np.array(loads[name]) for name in ("tau", "force1", "torque1")}
    columns = {"tau": slice(6 * (robot.base == "free"), None), "force1": slice(3), "torque1": slice(3, 6)}
    for k, link in enumerate(links):
        on_link = np.concatenate((loads[f"force_{link}"], loads[f"torque_{link}"]), axis=1)
        jacobian = required["jacobian"][:, k]
        forces = np.einsum("nij,ni->nj", jacobian, on_link)
        sizes = np.einsum("nij,ni->nj", np.abs(jacobian), np.abs(on_link))
        for name in acting if robot.base == "free" else ("tau",):
            acting[name] += forces[:, columns[name]]
            scales[name] = scales[name] + (sizes[:, columns[name]] if scales[name].ndim > 1 else sizes.max(axis=1))
    if is_planar:
        for name, out_of_plane in (("force1", [2]), ("torque1", [0, 1])):
            acting[name][:, out_of_plane] = required[name][:, out_of_plane]
    rows = []
    for name in {"free": ("tau", "force1", "torque1"), "pinned": ("tau", "torque1")}.get(held, ("tau",)):
        size = np.abs(loads[name])
        if name == "tau":  # whose parts may cancel
            size = size + sum(np.abs(loads[part]) for part in TORQUE_PARTS if part in loads)
        scale = scales[name] + (size if scales[name].ndim > 1 else size.max(axis=1))
        parts = robot.names if name == "tau" else ("",)
        rows.append(
            Comparison.of(name, acting[name], required[name], scale, u, samples.shape, parts, bound=MAX_LOAD_RATIO)
        )
    return tuple(rows)


def compare_rates(t: Float64Array, motion: Sequence[Float64Array], names: tuple[str, ...]) -> tuple[Comparison, ...]:
    """Compare the rates of a simulated motion (q, qd, qdd), (N, dof) each, with the slopes that coordinates and
    accelerations tell from either side, if there are enough instants t [s].

    The two slopes differ by h^3 q'''' / 12, which is much more than the error of their mean. Where they differ much,
    as at impacts or at instants that are far apart, little is known of the motion between them: the largest
    difference is allowed everywhere.
    """
    if len(t) < _LEAST_INSTANTS:
        return ()
    q, qd, qdd = motion
    h, chords = np.diff(t)[:, None], np.diff(q, axis=0) / np.diff(t)[:, None]
    after = chords[1:] - h[1:] * (2 * qdd[1:-1] + qdd[2:]) / 6
    before = chords[:-1] + h[:-1] * (qdd[:-2] + 2 * qdd[1:-1]) / 6
    size = np.nanmax(np.abs(qd), initial=0) + np.nanmax(np.abs(q), initial=0) / (t[-1] - t[0])
    expected = np.full_like(qd, np.nan)
    expected[1:-1] = (after + before) / 2
    allowed = np.zeros_like(qd) + np.nanmax(np.abs(after - before), axis=0, initial=0) + _RATE_SHARE * size
    return (Comparison.of("rates", qd, expected, allowed, 1.0, t.shape, names, bound=1.0),)
