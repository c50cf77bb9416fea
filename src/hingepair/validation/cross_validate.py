"""Comparison of the outputs of pairs and robots with the outputs of Pinocchio."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.mechanism import Mechanism
from hingepair.numeric.arrays import Float64Array
from hingepair.pair.accuracy import (
    PINOCCHIO_EXTRA_SCALES,
    PLANAR_SCALES,
    PROMISED_BOUND_BY_OUTPUT,
    angular_rate_sizes,
    euler_rate_sizes,
    norm,
    output_scales,
    unit_roundoff,
)
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.planar_pair import PlanarPair
from hingepair.pair.requests import DEFAULT_GRAVITY, read_rows
from hingepair.pair.states import PairState, PlanarState
from hingepair.plans.arguments import Coordinates
from hingepair.plans.pairs import PLANE, POINT_ENDINGS, SPACE, PairKind, Point, point_outputs
from hingepair.validation.pinocchio_twin import PairTwin, frame_motions, import_pinocchio, to_pinocchio
from hingepair.validation.report import Comparison, CrossValidation
from hingepair.validation.robot_check import cross_validate_robot
from hingepair.validation.states import finite_samples

if TYPE_CHECKING:
    from hingepair.pair.hinge_pair import HingePair


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

    A robot that was read from a URDF is compared with the model that Pinocchio itself makes of the same text: names
    and placements of joints, masses and inertias, and all results. Pinocchio also holds the locked joints. A robot
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
    if by_body1:
        return _compare_from_body1(pair, q, qd, qdd, psidd)  # type: ignore[arg-type]
    if isinstance(pair, Mechanism):
        coordinates = {name: value for name, value in (("q", q), ("qd", qd), ("qdd", qdd)) if value is not None}
        with np.errstate(all="ignore"):  # scales may overflow
            return cross_validate_robot(pair, coordinates, frames, base_motion, gravity)
    state: PairState | PlanarState
    if isinstance(pair, PlanarPair):
        space, kind, subject = pair.to_spatial(), PLANE, "in the plane"
        twin = to_pinocchio(space)
        state = pair.forward_kinematics(q, qd, qdd, outputs=_compared_outputs(pair, kind, qd, qdd))
    else:
        space, kind, subject = pair, SPACE, f"Euler sequence {sequence}"
        twin = to_pinocchio(space)
        outputs = _compared_outputs(pair, kind, qd, qdd)
        state = pair.forward_kinematics(q, qd, qdd, outputs=outputs, sequence=sequence)
    parts = read_rows(kind, q, qd, qdd).values
    flat, _ = finite_samples(parts, np.shape(state.R2)[:-1], {})
    planar = kind is PLANE
    rows = [np.insert(c, (2, 2, 2), 0.0, axis=1) if planar else c for c in flat.values()]
    body1 = _body1_by_pinocchio(rows, sequence)
    sizes = (None, None) if qd is None else euler_rate_sizes(*(c[:, 3:6] for c in rows[1:]))
    given = _Given(space, twin, body1, [c[:, 6] for c in rows], sizes)
    return _compare(given, state, subject, None if planar else sequence)


def _compare_from_body1(
    pair: HingePair, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike | None, psidd: ArrayLike | None
) -> CrossValidation:
    """Return the report on a pair whose body 1 moves as given."""
    twin = to_pinocchio(pair)
    outputs = _compared_outputs(pair, SPACE, psid, psidd)
    state = pair.forward_kinematics_from_body1(body1, psi, psid, psidd, outputs=outputs)
    angles = {name: c for name, c in (("psi", psi), ("psid", psid), ("psidd", psidd)) if c is not None}
    letters = ("R", "S", "v", "omega", "a", "alpha")[: 2 * len(angles)]
    values = angles | {letter: getattr(body1, letter) for letter in letters}
    flat, _ = finite_samples(values, state.shape, {**dict.fromkeys(angles, 0), "S": 2})
    motion = BodyMotion(**{letter: flat[letter] for letter in letters})
    sizes = angular_rate_sizes(motion.omega, motion.alpha)
    return _compare(_Given(pair, twin, motion, [flat[name] for name in angles], sizes), state, "attitude given", None)


def _compared_outputs(pair: HingePair | PlanarPair, kind: PairKind, *derivatives: Any) -> tuple[str, ...]:
    """Return the outputs that coordinates and those derivatives that are not None determine."""
    level = sum(given is not None for given in derivatives)
    of_points = point_outputs(pair.constants.points)
    return *kind.default_outputs(level), *(name for name, own in of_points.items() if own.order <= level)


class _Given(NamedTuple):
    """What Pinocchio computes from, at N samples."""

    pair: HingePair
    twin: PairTwin
    body1: BodyMotion
    hinge: list[Float64Array]  # psi and, as far as given, its derivatives
    sizes: tuple[Float64Array | None, Float64Array | None]  # W1 and A1 of the scales


def _compare(given: _Given, state: PairState | PlanarState, subject: str, sequence: str | None) -> CrossValidation:
    """Return the report on `state`, which the equations computed."""
    pair, _, body1, hinge, (W1, A1) = given
    _, psid, psidd = (*hinge, None, None)[:3]
    moving: dict[str, Any] = {"R1": body1.R, "v1": body1.v, "a1": body1.a, "W1": W1, "A1": A1, "pinocchio": True}
    scales = output_scales(u1=pair.u1, u2=pair.u2, psid=psid, psidd=psidd, **moving)
    outputs, formulas = _body2_by_pinocchio(given), {name: _scale_formula(name) for name in scales}
    for point in pair.constants.points:
        # A point of body 2 is the end of a longer lever, a point of body 1 of one that psi does not turn.
        own, lever = _point_scales(pair, point, psid, psidd, moving)
        for output, ending in zip(("R2", "v2", "a2"), POINT_ENDINGS.values(), strict=True):
            if output in own:
                scales[point.name + ending] = own[output]
                formulas[point.name + ending] = f"{formulas[output]}, with {lever}"
    if isinstance(state, PlanarState):
        phi2 = np.asarray(state.phi2, np.float64).reshape(-1)
        outputs, scales["phi2"] = _planar_part(outputs, phi2), 1 + np.abs(phi2) + np.abs(hinge[0])
        formulas["phi2"] = _scale_formula("phi2")
    shape, u = np.shape(state.R2)[:-1], unit_roundoff(np.asarray(state.R2).dtype)
    rows = tuple(
        Comparison.of(name, state.arrays()[name], expected, np.asarray(scales[name]), u, shape, scale=formulas[name])
        for name, expected in outputs.items()
    )
    return CrossValidation(pair.name, shape, int(np.isnan(hinge[0]).sum()), u, rows, subject, sequence)


def _point_scales(
    pair: HingePair, point: Point, psid: Float64Array | None, psidd: Float64Array | None, moving: Mapping[str, Any]
) -> tuple[dict[str, Float64Array], str]:
    """Return the scales of a point as those of R2, v2 and a2 of a pair with other levers, and these in words."""
    if point.body == 2:
        u2 = float(norm(pair.u2)) + float(norm(pair.points2[point.name]))
        scales = output_scales(u1=pair.u1, u2=(u2, 0, 0), psid=psid, psidd=psidd, **moving)
        return scales, "U2 + |p| in place of U2"
    rates = [None if rate is None else 0 * rate for rate in (psid, psidd)]
    u1 = pair.points1[point.name]
    scales = output_scales(u1=u1, u2=(0, 0, 0), psid=rates[0], psidd=rates[1], **moving)
    return scales, "|p| and 0 in place of U1 and U2"


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
    names = [point.name for point in pair.constants.points]
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
