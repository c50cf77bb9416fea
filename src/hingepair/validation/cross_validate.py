"""Comparison of the outputs of pairs and robots with those of Pinocchio, and of simulated loads with its `rnea`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.bodies.hinge_load import TORQUE_PARTS
from hingepair.mechanism.computations import BASE_LABELS, base_inputs
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.pairs.accuracy import (
    PINOCCHIO_EXTRA_SCALES,
    PLANAR_SCALES,
    PROMISED_BOUND_BY_OUTPUT,
    angular_rate_sizes,
    euler_rate_sizes,
    norm,
    output_scales,
    unit_roundoff,
)
from hingepair.mechanism.pairs.geometry import constants_of
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.pairs.requests import read_rows
from hingepair.mechanism.tree import Frame
from hingepair.numeric.arrays import Float64Array, broadcast_shape, one_constant
from hingepair.plans.arguments import Coordinates, read_arguments
from hingepair.plans.pairs import PLANE, POINT_ENDINGS, SPACE
from hingepair.plans.trees import BASE_MOTION
from hingepair.validation.pinocchio_twin import (
    BASE_AT_REST,
    PairTwin,
    Twin,
    frame_motions,
    import_pinocchio,
    joint_rules,
    robot_twin,
    to_pinocchio,
)
from hingepair.validation.report import MAX_LOAD_RATIO, Comparison, CrossValidation
from hingepair.validation.robot_scales import FRAME_MOTION, LinkWrench, RobotScales
from hingepair.validation.urdf_twin import urdf_twin

if TYPE_CHECKING:
    from hingepair.mechanism.pairs.hinge_pair import HingePair

_BODY2 = (("R2", "S2", "d"), ("v2", "omega2"), ("a2", "alpha2"))  # outputs of a pair by their order of derivatives
_LETTERS = ("R", "S", "v", "omega", "a", "alpha")  # of the motion of body 1
# Parts of the residual of forward dynamics on a free base.
_BASE_WRENCH = ("force1_x", "force1_y", "force1_z", "torque1_x", "torque1_y", "torque1_z")


@overload
def cross_validate(
    pair: HingePair | PlanarPair,
    q: ArrayLike | tuple[ArrayLike, ...],
    qd: ArrayLike | tuple[ArrayLike, ...] | None = None,
    qdd: ArrayLike | tuple[ArrayLike, ...] | None = None,
    *,
    sequence: str = "XYZ",
) -> CrossValidation: ...


@overload
def cross_validate(
    pair: HingePair,
    q: BodyMotion,
    qd: ArrayLike,
    qdd: ArrayLike | None = None,
    psidd: ArrayLike | None = None,
) -> CrossValidation: ...


@overload
def cross_validate(
    pair: Mechanism,
    q: Coordinates,
    qd: Coordinates | None = None,
    qdd: Coordinates | None = None,
    *,
    frames: str | Iterable[str] | None = None,
    base_motion: BodyMotion | None = None,
    gravity: ArrayLike = DEFAULT_GRAVITY,
) -> CrossValidation: ...


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
    with np.errstate(all="ignore"):  # scales may overflow
        if isinstance(pair, Mechanism):
            coordinates = {name: value for name, value in (("q", q), ("qd", qd), ("qdd", qdd)) if value is not None}
            return _compare_robot(pair, coordinates, frames, base_motion, gravity)
        if by_body1:
            return _compare_from_body1(pair, q, qd, qdd, psidd)  # type: ignore[arg-type]
        return _compare_pair(pair, q, qd, qdd, sequence)


# ---- samples


def _samples_of(value: Any, shape: tuple[int, ...], rank: int) -> Float64Array:
    """Return a copy of an array, or of a tuple of components, as N samples of the leading shape; (N, ...)."""
    array = np.stack(np.broadcast_arrays(*value), axis=-1) if isinstance(value, tuple) else np.asarray(value)
    own = array.shape[array.ndim - rank :]
    return np.array(np.broadcast_to(array, (*shape, *own)), dtype=np.float64).reshape(math.prod(shape), *own)


def _finite_samples(
    values: Mapping[str, Any], shape: tuple[int, ...], ranks: Mapping[str, int]
) -> tuple[dict[str, Float64Array], NDArray[np.bool_]]:
    """Return samples of all values, NaN in all of them where one is not finite, and at which samples all are. `ranks`
    has the number of axes of a sample where it is not 1.
    """
    arrays = {name: _samples_of(value, shape, ranks.get(name, 1)) for name, value in values.items()}
    finite = np.logical_and.reduce([np.isfinite(one).all(axis=tuple(range(1, one.ndim))) for one in arrays.values()])
    for array in arrays.values():
        array[~finite] = np.nan
    return arrays, finite


# ---- pairs


class _Given(NamedTuple):
    """What Pinocchio computes from, at N samples."""

    pair: HingePair
    twin: PairTwin
    body1: BodyMotion
    hinge: list[Float64Array]  # psi and, as far as given, its derivatives
    sizes: tuple[Float64Array | None, Float64Array | None]  # W1 and A1 of the scales


def _compared_outputs(pair: HingePair | PlanarPair, levels: int) -> tuple[str, ...]:
    """Return the outputs of body 2 and of points that coordinates and `levels - 1` of their derivatives determine."""
    names = [name for group in _BODY2[:levels] for name in group]
    planar = ["phi2" if name == "S2" else name for name in names]
    endings = [*POINT_ENDINGS.values()][:levels]
    of_points = [point + ending for point in (*pair.points1, *pair.points2) for ending in endings]
    return *(planar if isinstance(pair, PlanarPair) else names), *of_points


def _compare_pair(pair: HingePair | PlanarPair, q: Any, qd: Any, qdd: Any, sequence: str) -> CrossValidation:
    """Return the report on a pair in coordinates, which Pinocchio turns into the motion of body 1."""
    planar = isinstance(pair, PlanarPair)
    levels = 1 + (qd is not None) + (qdd is not None)
    options: dict[str, Any] = {} if planar else {"sequence": sequence}
    space = pair.to_spatial() if isinstance(pair, PlanarPair) else pair
    twin = to_pinocchio(space)
    state = pair.forward_kinematics(q, qd, qdd, outputs=_compared_outputs(pair, levels), **options)
    parts = read_rows(PLANE if planar else SPACE, q, qd, qdd).values
    flat, _ = _finite_samples(parts, np.shape(state.R2)[:-1], {})
    rows = [np.insert(c, (2, 2, 2), 0.0, axis=1) if planar else c for c in flat.values()]
    sizes = (None, None) if qd is None else euler_rate_sizes(*(c[:, 3:6] for c in rows[1:]))
    given = _Given(space, twin, _body1_by_pinocchio(rows, sequence), [c[:, 6] for c in rows], sizes)
    subject = "in the plane" if planar else f"Euler sequence {sequence}"
    return _pair_report(given, state, subject, None if planar else sequence)


def _compare_from_body1(pair: HingePair, body1: BodyMotion, psi: Any, psid: Any, psidd: Any) -> CrossValidation:
    """Return the report on a pair whose body 1 moves as given."""
    twin = to_pinocchio(pair)
    angles = {name: c for name, c in (("psi", psi), ("psid", psid), ("psidd", psidd)) if c is not None}
    outputs = _compared_outputs(pair, len(angles))
    state = pair.forward_kinematics_from_body1(body1, psi, psid, psidd, outputs=outputs)
    letters = _LETTERS[: 2 * len(angles)]
    values = angles | {letter: getattr(body1, letter) for letter in letters}
    flat, _ = _finite_samples(values, state.shape, {**dict.fromkeys(angles, 0), "S": 2})
    motion = BodyMotion(**{letter: flat[letter] for letter in letters})
    sizes = angular_rate_sizes(motion.omega, motion.alpha)
    given = _Given(pair, twin, motion, [flat[name] for name in angles], sizes)
    return _pair_report(given, state, "attitude given", None)


def _pair_report(given: _Given, state: Any, subject: str, sequence: str | None) -> CrossValidation:
    """Return the report on `state`, which the equations computed."""
    pair, _, body1, hinge, (W1, A1) = given
    _, psid, psidd = (*hinge, None, None)[:3]
    moving: dict[str, Any] = {"R1": body1.R, "v1": body1.v, "a1": body1.a, "W1": W1, "A1": A1, "pinocchio": True}
    scales = output_scales(u1=pair.u1, u2=pair.u2, psid=psid, psidd=psidd, **moving)
    outputs, formulas = _body2_by_pinocchio(given), {name: _scale_formula(name) for name in scales}
    for name in (*pair.points1, *pair.points2):
        # A point of body 2 is the end of a longer lever, a point of body 1 of one that psi does not turn.
        if name in pair.points2:
            levers: Any = pair.u1, (float(norm(pair.u2)) + float(norm(pair.points2[name])), 0, 0)
            rates, lever = (psid, psidd), "U2 + |p| in place of U2"
        else:
            levers, lever = (pair.points1[name], (0, 0, 0)), "|p| and 0 in place of U1 and U2"
            rates = (None if psid is None else 0 * psid, None if psidd is None else 0 * psidd)
        own = output_scales(u1=levers[0], u2=levers[1], psid=rates[0], psidd=rates[1], **moving)
        for output, ending in zip(("R2", "v2", "a2"), POINT_ENDINGS.values(), strict=True):
            if output in own:
                scales[name + ending] = own[output]
                formulas[name + ending] = f"{formulas[output]}, with {lever}"
    if "phi2" in state.arrays():
        phi2 = np.asarray(state.phi2, np.float64).reshape(-1)
        outputs, scales["phi2"] = _planar_part(outputs, phi2), 1 + np.abs(phi2) + np.abs(hinge[0])
        formulas["phi2"] = _scale_formula("phi2")
    shape, u = np.shape(state.R2)[:-1], unit_roundoff(np.asarray(state.R2).dtype)
    rows = tuple(
        Comparison.of(name, state.arrays()[name], expected, np.asarray(scales[name]), u, shape, scale=formulas[name])
        for name, expected in outputs.items()
    )
    return CrossValidation(pair.name, shape, int(np.isnan(hinge[0]).sum()), u, rows, subject, sequence)


def _scale_formula(output: str) -> str:
    """Return the formula of the scale of an output, with Pinocchio's extra terms."""
    formula = PLANAR_SCALES.get(output) or PROMISED_BOUND_BY_OUTPUT[output].scale
    added = PINOCCHIO_EXTRA_SCALES.get(output)
    return f"{formula} + {added}" if added else formula


def _body2_by_pinocchio(given: _Given) -> dict[str, Float64Array]:
    """Compute the motion of body 2 and of points by Pinocchio; d is the position of body 2 if R1 is zero."""
    pair, twin, body1, hinge, _ = given
    states = [twin.configuration(body1, hinge[0])]
    states += [twin.velocity(body1, *hinge[:2])] if len(hinge) > 1 else []
    states += [twin.acceleration(body1, *hinge)] if len(hinge) > 2 else []
    body2 = twin.body2(*states)
    names = [point.name for point in constants_of(pair).points]
    frames = [twin.model.getFrameId(name) for name in names]
    points = frame_motions(twin.model, twin.data, frames, states) if names else {}
    states[0][:, :3] = 0
    outputs = {"R2": body2.R, "S2": body2.S, "d": twin.body2(states[0]).R, "v2": body2.v, "omega2": body2.omega}
    outputs |= {"a2": body2.a, "alpha2": body2.alpha}
    outputs |= {
        name + ending: points[letter][:, k]
        for k, name in enumerate(names)
        for letter, ending in POINT_ENDINGS.items()
        if letter in points
    }
    return {name: values for name, values in outputs.items() if values is not None}


def _planar_part(outputs: Mapping[str, Float64Array], phi2: Float64Array) -> dict[str, Float64Array]:
    """Return the components in the plane z = 0; in place of S2 its angle, of all equal ones that nearest to phi2."""
    planar = {}
    for name, values in outputs.items():
        if name == "S2":
            difference = np.arctan2(values[:, 1, 0], values[:, 0, 0]) - phi2
            planar["phi2"] = (phi2 + np.arctan2(np.sin(difference), np.cos(difference)))[:, None]
        else:
            planar[name] = values[:, 2:] if name in {"omega2", "alpha2"} else values[:, :2]
    return planar


def _body1_by_pinocchio(rows: list[Float64Array], sequence: str) -> BodyMotion:
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
    return BodyMotion(**{name: array[:, 0] for name, array in motion.items()} | dict(translations))


# ---- robots


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


def _compare_robot(
    robot: Mechanism,
    coordinates: Mapping[str, Coordinates],
    frames: str | Iterable[str] | None,
    base_motion: BodyMotion | None,
    gravity: ArrayLike,
) -> CrossValidation:
    """Return the report on a robot; `coordinates` are q and, as far as given, qd and qdd."""
    tree, fall = tree_of(robot).single(), one_constant("gravity", gravity, 3)
    names = (frames,) if isinstance(frames, str) else tuple(tree.links if frames is None else frames)
    known = {name: tree.known_frame("frames", name) for name in names}
    tips = robot.tips if frames is None else names
    samples = _read_samples(robot, coordinates, base_motion)
    ours = _outputs_by_equations(robot, coordinates, names, tips, base_motion, fall, samples.shape)
    twin, compared_with, other_names = urdf_twin(robot)
    if other_names:  # nothing else can be compared
        rows: tuple[Comparison, ...] = (Comparison("names", np.inf, np.inf, (), 1, worst_part=other_names[0]),)
    else:
        rows = _robot_rows(_Case(robot, twin, samples, known, tips, fall), ours)
    return CrossValidation(
        robot.name, samples.shape, int((~samples.finite).sum()), samples.u, rows,
        f"{robot.base} base, {len(known)} frames", base=robot.base, frames=len(known), compared_with=compared_with,
    )  # fmt: skip


def _robot_rows(case: _Case, ours: dict[str, Float64Array]) -> tuple[Comparison, ...]:
    """Return a row for each output of Pinocchio's; write the residual of forward dynamics to `ours`."""
    robot, samples = case.robot, case.samples
    theirs = _outputs_by_pinocchio(case)
    singular = 0
    if "tau" in theirs:
        ours["forward_dynamics"], theirs["forward_dynamics"], singular = _residual(case, ours, theirs)
    scales = _output_scales(case, ours)
    parts = dict.fromkeys((*FRAME_MOTION, "d"), tuple(case.frames)) | {"jacobian": case.tips, "tau": robot.names}
    parts["forward_dynamics"] = (*(_BASE_WRENCH if robot.base == "free" else ()), *robot.names)
    rows = []
    for name, expected in theirs.items():
        if not expected.size and samples.finite.size:  # a robot without joints has neither tau nor mass matrix
            continue
        own = parts.get(name, ("",))
        left_out = {"singular": singular} if name == "forward_dynamics" else {}
        rows.append(
            Comparison.of(name, ours[name], expected, scales[name], samples.u, samples.shape, own, **left_out)
        )
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
    flat, finite = _finite_samples(at_rest | values.values, shape, {"S1": 2})
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
    return {name: _samples_of(value, shape, rank) for name, (value, rank) in outputs.items()}


def _outputs_by_pinocchio(case: _Case) -> dict[str, Float64Array]:
    """Compute the compared outputs by Pinocchio, NaN at samples that are not finite; shape (N, ...) each."""
    pin = import_pinocchio("cross_validate")
    finite, twin = case.samples.finite, case.twin
    if not finite.size:
        return {}
    twin.model.gravity = pin.Motion(case.gravity, np.zeros(3))
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
            outputs |= {"linear": momentum.linear.copy(), "angular": about_origin}
    return outputs


def _moved_base(case: _Case, ours: Mapping[str, Float64Array]) -> BodyMotion:
    """Return the motion of the base with the accelerations of forward dynamics, if it is free."""
    base = case.samples.base
    return replace(base, a=ours["a1"], alpha=ours["alpha1"]) if case.robot.base == "free" else base


def _residual(
    case: _Case, ours: Mapping[str, Float64Array], theirs: Mapping[str, Float64Array]
) -> tuple[Float64Array, Float64Array, int]:
    """Return the forces that our accelerations require by `rnea`, those that act, NaN where the mass matrix is
    singular, and at how many samples it is.
    """
    pin, twin, joints = import_pinocchio("cross_validate"), case.twin, case.samples.joints
    q, v = case.states()[:2]
    a = twin.acceleration(joints[0], joints[1], ours["qdd"], _moved_base(case, ours))
    columns = case.velocity_matrices()
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


def _output_scales(case: _Case, ours: Mapping[str, Float64Array]) -> dict[str, Float64Array]:
    """Return the error scales of all outputs by name, which broadcast against them; forward_dynamics if in `ours`."""
    robot, samples = case.robot, case.samples
    ratios, offsets = joint_rules(tree_of(robot))
    joints = [one @ ratios.T for one in samples.joints]
    joints[0] = joints[0] + offsets
    scales = RobotScales(tree_of(robot), joints, samples.base, case.gravity, case.wrenches)
    columns = np.zeros((6 + len(ratios), 6 + robot.dof))
    columns[:6, :6], columns[6:, 6:] = np.eye(6), np.abs(ratios)
    columns = columns if robot.base == "free" else columns[:, 6:]
    by_output: dict[str, Float64Array] = {}
    if case.frames:
        at_origin = replace(samples.base, R=np.zeros_like(samples.base.R))
        from_base = RobotScales(tree_of(robot), joints[:1], at_origin, case.gravity)
        motions = [scales.motion(frame) for frame in case.frames.values()]
        by_output |= {name: np.stack([one[name] for one in motions], axis=1)[..., None] for name in FRAME_MOTION}
        by_output["S"] = by_output["S"][..., None]
        by_output["d"] = np.stack([from_base.motion(frame)["R"] for frame in case.frames.values()], axis=1)[..., None]
        jacobians = [scales.jacobian(case.frames[name]) @ columns for name in case.tips]
        by_output["jacobian"] = np.stack(jacobians, axis=1)
    by_output["mass_matrix"] = columns.T @ scales.mass_matrix() @ columns
    by_output |= scales.energy_and_momentum()
    force, torque = scales.forces()
    tau = _generalized_scales(robot, scales, columns)
    by_output |= {"force1": force[:, 0], "torque1": torque[:, 0], "tau": tau[:, tau.shape[1] - robot.dof :]}
    if "forward_dynamics" in ours:
        moved = [*joints[:2], ours["qdd"] @ ratios.T]
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


# ---- loads of a simulated motion


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
    fall = one_constant("gravity", gravity, 3)
    links = tuple(link for link in robot.links if f"force_{link}" in loads)
    wrenches = tuple(
        LinkWrench(tree_of(robot).links[link], loads[f"force_{link}"], loads[f"torque_{link}"]) for link in links
    )
    case = _Case(robot, robot_twin(robot, has_free_flyer=True), samples, {}, links, fall, wrenches)
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
