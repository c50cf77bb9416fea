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
from hingepair.mechanism.pairs.accuracy import euler_rate_sizes, unit_roundoff
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.pairs.requests import check_pair, read_rows
from hingepair.mechanism.robots.computations import BASE_LABELS, base_inputs
from hingepair.mechanism.tree import Frame, Tree
from hingepair.numeric.arrays import Float64Array, broadcast_shape, one_constant
from hingepair.plans.arguments import Coordinates, read_arguments
from hingepair.plans.pairs import PLANE, POINT_ENDINGS, SPACE
from hingepair.plans.trees import BASE_MOTION
from hingepair.validation.loops import Linkage
from hingepair.validation.pinocchio_twin import (
    LETTERS,
    Twin,
    frame_motions,
    import_pinocchio,
    pair_twin,
    robot_twin,
    urdf_twin,
)
from hingepair.validation.report import MAX_LOAD_RATIO, Comparison, CrossValidation
from hingepair.validation.scales import Scales

Outputs = dict[str, Float64Array]

_FORCES = ("force1", "torque1", "tau")
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
    in_space = not isinstance(pair, Mechanism | PlanarPair)
    if by_body1 and not in_space:
        raise ArgumentError("q", "coordinates, unless of a HingePair", quoted(q))
    of_robots = {
        "frames": frames,
        "base_motion": base_motion,
        "gravity": None if gravity is DEFAULT_GRAVITY else gravity,
    }
    meaningless = {} if is_robot else of_robots
    meaningless |= {} if by_body1 else {"psidd": psidd}
    meaningless |= {} if in_space and not by_body1 else {"sequence": None if sequence == "XYZ" else sequence}
    for name, value in meaningless.items():
        if value is not None:
            raise ArgumentError(name, "nothing, since it has no meaning here", quoted(value))
    if in_space:
        check_pair(pair)
    with np.errstate(all="ignore"):  # scales may overflow
        if isinstance(pair, Mechanism):
            coordinates = {name: value for name, value in (("q", q), ("qd", qd), ("qdd", qdd)) if value is not None}
            return _compare_robot(pair, coordinates, frames, base_motion, gravity)
        return _compare_pair(pair, (q, qd, qdd, psidd), sequence)


class _Samples(NamedTuple):
    """Coordinates of joints and motion of the base at N samples; one that is not finite is NaN in all arrays."""

    shape: tuple[int, ...]  # leading shape, of N elements
    joints: list[Float64Array]  # q and, as far as given, qd and qdd; (N, dof) each
    base: BodyMotion  # with as many derivatives
    finite: NDArray[np.bool_]

    @classmethod
    def of(cls, base: Mapping[str, Any], joints: Sequence[Any], shape: tuple[int, ...]) -> _Samples:
        """Return samples of the parts of the base's motion by letter, and of coordinates with their derivatives."""
        moved = {name: _rows(value, shape, 2 if name == "S" else 1) for name, value in base.items()}
        rows = [_rows(value, shape, 1) for value in joints]
        own = [np.isfinite(one).all(axis=tuple(range(1, one.ndim))) for one in (*moved.values(), *rows)]
        finite = np.logical_and.reduce(own)
        for array in (*moved.values(), *rows):
            array[~finite] = np.nan
        return cls(shape, rows, BodyMotion(**moved), finite)

    def states(self, twin: Twin) -> list[Float64Array]:
        """Return Pinocchio's q, v (if there are rates) and a (if there are accelerations); shape (N, ...) each."""
        convert: tuple[Any, ...] = (twin.configuration, twin.velocity, twin.acceleration)
        return [convert[k](*self.joints[: k + 1], self.base) for k in range(len(self.joints))]

    def frames(self, twin: Twin, numbers: Sequence[int]) -> Outputs:
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


def _at_origin(base: BodyMotion) -> BodyMotion:
    return replace(base, R=np.zeros_like(base.R))


def _frame_scales(scales: Scales, from_origin: Scales, frames: Iterable[Frame]) -> Outputs:
    """Return the error scales of the motion of frames by name, d among them; shape (N, frames, 1 or 1, 1) each."""
    motions = [scales.motion(frame) | {"d": from_origin.motion(frame)["R"]} for frame in frames]
    found = {name: np.stack([one[name] for one in motions], axis=1)[..., None] for name in motions[0]}
    return found | {"S": found["S"][..., None]}


# ---- pairs


def _compare_pair(pair: HingePair | PlanarPair, given: tuple[Any, ...], sequence: str) -> CrossValidation:
    """Return the report on a pair, given coordinates, which Pinocchio turns into the motion of body 1, or that motion
    itself with psi and, as far as known, its derivatives.
    """
    planar, by_body1 = isinstance(pair, PlanarPair), isinstance(given[0], BodyMotion)
    levels = sum(one is not None for one in given) - by_body1
    space: HingePair = pair.to_spatial() if isinstance(pair, PlanarPair) else pair
    points = (*space.points1, *space.points2)
    attitude = "phi2" if planar else "S2"
    names = [name for group in (("R2", attitude, "d"), ("v2", "omega2"), ("a2", "alpha2"))[:levels] for name in group]
    outputs = (*names, *(point + ending for point in points for ending in [*POINT_ENDINGS.values()][:levels]))
    options: dict[str, Any] = {} if planar or by_body1 else {"sequence": sequence}
    state: Any
    if by_body1 and isinstance(pair, HingePair):
        state = pair.forward_kinematics_from_body1(*given, outputs=outputs)
        angles = [np.asarray(one)[..., None] for one in given[1 : 1 + levels]]
        base = {letter: getattr(given[0], letter) for letter in LETTERS[: 2 * levels]}
        samples = _Samples.of(base, angles, state.shape)
        of_scales = samples.base
    else:
        state = pair.forward_kinematics(*given[:3], outputs=outputs, **options)
        shape = np.shape(state.R2)[:-1]
        rows = [_rows(one, shape, 1) for one in read_rows(PLANE if planar else SPACE, *given[:3]).values.values()]
        rows = [np.insert(one, (2, 2, 2), 0.0, axis=1) if planar else one for one in rows]
        samples = _Samples.of(_body1_by_pinocchio(rows, sequence), [one[:, 6:] for one in rows], (len(rows[0]),))
        samples = samples._replace(shape=shape)
        # The rates of Euler angles may be larger than what they add up to.
        sizes = euler_rate_sizes(*(one[:, 3:6] for one in rows[1:])) if levels > 1 else ()
        along = (size[:, None] * np.eye(3)[0] for size in sizes if size is not None)
        of_scales = replace(samples.base, **dict(zip(("omega", "alpha"), along, strict=False)))
    twin, tree = pair_twin(space).robot, tree_of_pair(space)
    frames = {name: tree.known_frame("frames", name) for name in ("body2", *points)}
    motion = samples.frames(twin, [twin.model.getFrameId(name) for name in frames])
    own, near = (Scales(tree, samples.joints, one, True) for one in (of_scales, _at_origin(of_scales)))
    scale = _frame_scales(own, near, frames.values())
    theirs, scales = {}, {}
    for letter, array in motion.items():
        for k, name in enumerate(frames):
            ending = POINT_ENDINGS.get(letter)
            output = letter + "2" * (letter != "d") if k == 0 else None if ending is None else name + ending
            if output is not None:
                theirs[output], scales[output] = array[:, k], scale[letter][:, k]
    if planar:
        phi2 = np.asarray(state.phi2, np.float64).reshape(-1, 1)
        S2 = theirs.pop("S2")
        off = np.arctan2(S2[:, 1, :1], S2[:, 0, :1]) - phi2  # the attitude does not tell whole turns
        theirs = {name: one[:, 2:] if name in {"omega2", "alpha2"} else one[:, :2] for name, one in theirs.items()}
        theirs["phi2"] = phi2 + np.arctan2(np.sin(off), np.cos(off))
        scales["phi2"] = 1 + np.abs(phi2) + np.abs(samples.joints[0])
    u = unit_roundoff(np.asarray(state.R2).dtype)
    ours = state.arrays()
    compared = tuple(
        Comparison.of(name, ours[name], theirs[name], scales[name], u, samples.shape) for name in outputs
    )
    subject = "in the plane" if planar else "attitude given" if by_body1 else f"Euler sequence {sequence}"
    return CrossValidation(pair.name, samples.shape, int((~samples.finite).sum()), u, compared, subject)


def _body1_by_pinocchio(rows: list[Float64Array], sequence: str) -> Outputs:
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

    robot: Mechanism  # a tree without struts
    twin: Twin
    samples: _Samples
    frames: Mapping[str, Frame]
    tips: Mapping[str, Frame]  # frames with Jacobians
    gravity: Float64Array

    @property
    def tree(self) -> Tree:
        return tree_of(self.robot)

    @property
    def free(self) -> bool:
        return self.robot.base == "free"

    def scales(self, base: BodyMotion | None = None) -> Scales:
        """Return the scales of errors, for another motion of the base if given."""
        return Scales(self.tree, self.samples.joints, base or self.samples.base, self.free, self.gravity)

    def velocity_matrices(self) -> Float64Array:
        """Return the matrices from the velocities of the robot to Pinocchio's v; shape (N, nv, columns)."""
        (joints, dof), count = self.twin.ratios.shape, len(self.samples.finite)
        matrices = np.zeros((count, 6 + joints, 6 + dof))
        matrices[:, :3, :3] = matrices[:, 3:6, 3:6] = np.swapaxes(np.asarray(self.samples.base.S), -1, -2)
        matrices[:, 6:, 6:] = self.twin.ratios
        return matrices if self.free else matrices[..., 6:]


def _compare_robot(
    robot: Mechanism,
    coordinates: Mapping[str, Coordinates],
    frames: str | Iterable[str] | None,
    base_motion: BodyMotion | None,
    gravity: ArrayLike,
) -> CrossValidation:
    """Return the report on a robot; `coordinates` are q and, as far as given, qd and qdd."""
    tree, fall = tree_of(robot).single(), one_constant("gravity", gravity, 3)
    linkage = Linkage.of(robot, coordinates)
    inner = robot if linkage is None else linkage.plain
    names = (frames,) if isinstance(frames, str) else tuple(tree.links if frames is None else frames)
    known = {name: tree.known_frame("frames", name) for name in names}
    tips = {name: tree.known_frame("frames", name) for name in (robot.tips if frames is None else names)}
    samples, u = _read_samples(inner, coordinates if linkage is None else linkage.coordinates, base_motion)
    ours = _outputs_by_equations(robot, coordinates, names, (*tips,), base_motion, fall, samples.shape)
    twin, compared_with, other_names = urdf_twin(inner)
    if other_names:  # nothing else can be compared
        rows: tuple[Comparison, ...] = (Comparison("names", np.inf, np.inf, (), 1, worst_part=other_names[0]),)
    else:
        rows = _robot_rows(_Case(inner, twin, samples, known, tips, fall), ours, u, linkage, robot.names)
    return CrossValidation(
        robot.name, samples.shape, int((~samples.finite).sum()), u, rows,
        f"{robot.base} base, {len(known)} frames", compared_with=compared_with,
    )  # fmt: skip


def _robot_rows(
    case: _Case, ours: Outputs, u: float, linkage: Linkage | None, names: tuple[str, ...]
) -> tuple[Comparison, ...]:
    """Return a row for each output of Pinocchio's; with a linkage, the case is of its tree."""
    theirs, scales, singular = _outputs_by_pinocchio(case), _output_scales(case), 0
    if "tau" in theirs:
        qdd, base = ours["qdd"] if linkage is None else linkage.accelerations(ours["qdd"]), case.samples.base
        base = replace(base, a=ours["a1"], alpha=ours["alpha1"]) if case.free else base
        found = case._replace(samples=case.samples._replace(joints=[*case.samples.joints[:2], qdd], base=base))
        ours["forward_dynamics"], theirs["forward_dynamics"], singular = _residual(found, theirs)
        scales["forward_dynamics"] = _generalized(found.scales().forces(), case.free)
    if linkage is not None and theirs:
        gaps = linkage.gaps(
            case.samples.frames(case.twin, [_frame_number(case, name) for name in linkage.ends]),
            case.scales(_at_origin(case.samples.base)),
        )
        linkage.reduce(ours, theirs, scales)
        for name, values in gaps.items():
            ours[name], theirs[name], scales[name] = values
    parts = dict.fromkeys((*LETTERS, "d"), (*case.frames,)) | {"jacobian": (*case.tips,), "tau": names}
    on_base = tuple(f"{part}_{axis}" for part in _FORCES[:2] for axis in "xyz") if case.free else ()
    parts["forward_dynamics"] = (*on_base, *names)
    rows = []
    for name, expected in theirs.items():
        if expected.size or not case.samples.finite.size:  # a robot without joints has neither tau nor mass matrix
            left_out = {"singular": singular} if name == "forward_dynamics" else {}
            own, shape = parts.get(name, ("",)), case.samples.shape
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
    of_joints = [read.values[name] for name in coordinates]
    single = base_motion is None and all(getattr(part, "dtype", None) == np.float32 for part in of_joints)
    samples = _Samples.of(at_rest | of_base, of_joints, broadcast_shape(read.shapes))
    return samples, unit_roundoff(np.float32 if single else np.float64)


def _outputs_by_equations(
    robot: Mechanism,
    coordinates: Mapping[str, Coordinates],
    frames: tuple[str, ...],
    tips: tuple[str, ...],
    base_motion: BodyMotion | None,
    gravity: Float64Array,
    shape: tuple[int, ...],
) -> Outputs:
    """Compute the compared outputs by the equations; shape (N, ...) each."""
    q, *rates = coordinates.values()
    base: dict[str, Any] = {"base_motion": base_motion}
    fall: dict[str, Any] = {"gravity": gravity, **base}
    outputs: dict[str, tuple[Any, int]] = {}  # values, and the number of axes of one sample
    if frames:
        state = robot.forward_kinematics(q, *rates, frames=frames, **base)
        outputs |= {name: (getattr(state, name), 3 if name == "S" else 2) for name in state.outputs}
        outputs["jacobian"] = robot.jacobian(q, tips, **base), 3
    outputs["mass_matrix"] = robot.mass_matrix(q, **base), 2
    if rates:
        energy, momentum = robot.energy(q, rates[0], **fall), robot.momentum(q, rates[0], **base)
        outputs |= {"kinetic": (energy.kinetic, 0), "potential": (energy.potential, 0)}
        outputs |= {"linear": (momentum.linear, 1), "angular": (momentum.angular, 1)}
    if len(rates) > 1:
        forces = robot.inverse_dynamics(q, *rates, joint_loads=False, **fall)
        loads: dict[str, Any] = {name: forces[name] for name in _FORCES[:2]} if robot.base == "free" else {}
        moved = robot.forward_dynamics(q, rates[0], forces.tau, joint_loads=False, **loads, **fall)
        outputs |= {name: (one[name], 1) for one in (forces, moved) for name in one.outputs}
    return {name: _rows(value, shape, rank) for name, (value, rank) in outputs.items()}


def _outputs_by_pinocchio(case: _Case) -> Outputs:
    """Compute the compared outputs by Pinocchio, NaN at samples that are not finite; shape (N, ...) each."""
    pin = import_pinocchio("cross_validate")
    twin, count = case.twin, len(case.samples.finite)
    if not count:
        return {}
    twin.model.gravity = pin.Motion(case.gravity, np.zeros(3))
    outputs = case.samples.frames(twin, [_frame_number(case, name) for name in case.frames]) if case.frames else {}
    tips = [_frame_number(case, name) for name in case.tips]
    found: Outputs = {}
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


def _generalized(forces: Mapping[str, Float64Array], free: bool) -> Float64Array:
    """Return the generalized forces (force1, torque1, tau) of a free base, or tau, from these by name."""
    parts = [np.broadcast_to(forces[name], (len(forces[name]), 3)) for name in _FORCES[:2]] if free else []
    return np.concatenate((*parts, forces["tau"]), axis=1)


def _residual(case: _Case, theirs: Outputs) -> tuple[Float64Array, Float64Array, int]:
    """Return the forces that the accelerations of forward dynamics require by `rnea`, those that act, NaN where the
    mass matrix is singular, and at how many samples it is.
    """
    pin, twin, columns = import_pinocchio("cross_validate"), case.twin, case.velocity_matrices()
    q, v, a = case.samples.states(twin)
    acting = _generalized(theirs, case.free)
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


def _output_scales(case: _Case) -> Outputs:
    """Return the error scales of all outputs by name, which broadcast against them."""
    scales, found = case.scales(), Outputs()
    if case.frames:
        found |= _frame_scales(scales, case.scales(_at_origin(case.samples.base)), case.frames.values())
        found["jacobian"] = np.stack([scales.jacobian(frame) for frame in case.tips.values()], axis=1)
    return found | {"mass_matrix": scales.mass_matrix()} | scales.forces() | scales.energy_and_momentum()


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
    samples, tree, free = samples._replace(base=_at_origin(samples.base)), tree_of(robot), robot.base == "free"
    links = {link: tree.known_frame("links", link) for link in robot.links if f"force_{link}" in loads}
    twin = robot_twin(robot, has_free_flyer=True)
    case = _Case(robot, twin, samples, {}, links, one_constant("gravity", gravity, 3))
    theirs, scales = _outputs_by_pinocchio(case), case.scales().forces()
    # What acts, and the sizes of its terms.
    acting, sizes = _generalized(loads, free), _generalized(scales, free)
    parts = sum((np.abs(loads[part]) for part in TORQUE_PARTS if part in loads), np.zeros_like(loads["tau"]))
    sizes = sizes + np.abs(acting)
    sizes[:, 6 * free :] += parts  # which may cancel
    for k, link in enumerate(links):
        on_link = np.concatenate((loads[f"force_{link}"], loads[f"torque_{link}"]), axis=1)[:, None]
        jacobian = theirs["jacobian"][:, k]
        acting = acting + (on_link @ jacobian)[:, 0]
        sizes = sizes + (np.abs(on_link) @ np.abs(jacobian))[:, 0]
    required = _generalized(theirs, free)
    columns = {"tau": slice(6 * free, None), "force1": slice(3), "torque1": slice(3, 6)}
    if is_planar and free:
        acting[:, 2:5] = required[:, 2:5]
    rows = []
    for name in {"free": ("tau", "force1", "torque1"), "pinned": ("tau", "torque1")}.get(held, ("tau",)):
        own, names = columns[name], robot.names if name == "tau" else ("",)
        size = sizes[:, own] if name == "tau" else sizes[:, own].max(axis=1)
        values = acting[:, own], required[:, own], size
        rows.append(Comparison.of(name, *values, u, samples.shape, names, bound=MAX_LOAD_RATIO))
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
