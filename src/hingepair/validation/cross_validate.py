"""Body 2 by the equations and by Pinocchio, compared."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

from hingepair.mechanism.arguments import Coordinates
from hingepair.mechanism.mechanism import Mechanism
from hingepair.numeric.arrays import Float64Array
from hingepair.pair.accuracy import error_ratios, euler_rate_sizes, given_rate_sizes, output_scales, unit_roundoff
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.dynamics import GRAVITY
from hingepair.pair.forward_kinematics import read_pair_coordinates
from hingepair.pair.planar_pair import PlanarPair
from hingepair.pair.states import PairState, PlanarState
from hingepair.plans.plan import PLANAR_MOTION, SPATIAL_MOTION
from hingepair.validation.free_flyer import frame_motion, import_pinocchio
from hingepair.validation.pinocchio_twin import PinocchioTwin, to_pinocchio
from hingepair.validation.report import Comparison, CrossValidation
from hingepair.validation.robot_check import cross_validate_robot
from hingepair.validation.robot_report import RobotValidation

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
    pair: Mechanism,
    q: Coordinates,
    qd: Coordinates | None = None,
    qdd: Coordinates | None = None,
    *,
    frames: str | Iterable[str] | None = None,
    base_motion: BodyMotion | None = None,
    gravity: ArrayLike = GRAVITY,
) -> RobotValidation: ...


def cross_validate(
    pair: HingePair | PlanarPair | Mechanism,
    q: Any,
    qd: Any = None,
    qdd: Any = None,
    *,
    sequence: str = "XYZ",
    frames: str | Iterable[str] | None = None,
    base_motion: BodyMotion | None = None,
    gravity: ArrayLike = GRAVITY,
) -> CrossValidation | RobotValidation:
    """Compare a pair or a robot, computed by the equations, with Pinocchio, state by state.

    Pinocchio's route shares nothing with ours: body 1's attitude and rates come from Pinocchio too, from a chain
    of three revolute joints in the order of the sequence. R2, S2 and d are compared, with qd also v2 and omega2,
    with qdd also a2 and alpha2. d is that of a twin placed at R1 = 0, since Pinocchio has only R2 - R1.

    Of a robot: motion of all links, Jacobians of the last of each branch, the mass matrix; with qd energies and
    momenta; with qdd forces, and forward dynamics by what it leaves: the forces that Pinocchio says our accelerations
    take, against those that act.

    Args:
        pair: the pair; a planar one is compared in the plane, phi2 in place of S2. Or a robot, whose q is as its
            methods take it.
        q: (x, y, z, phi_x, phi_y, phi_z, psi); shape (..., 7) or a tuple of seven coordinates. Of a planar pair
            (x, y, phi, psi).
        qd: its time derivative; likewise.
        qdd: its second time derivative; likewise.
        sequence: of the Euler angles; not of a robot.
        frames: of a robot, names of links or joints whose motion and Jacobians are compared, in place of those.
        base_motion: of a robot, how its base moves; it rests at the origin unless given.
        gravity: of a robot, acceleration of free fall [m/s^2]; shape (3,).

    Returns:
        A `CrossValidation` (hingepair.validation.report): `.ok`, `.verdict`, str() a table, `.to_json()`; `.rows`, of
        each output `.output`, `.max_error` (in its unit), `.max_ratio` (in u * scale), `.worst_sample` (of
        max_ratio), `.samples`, `.bound`. Samples that are not finite are counted (`.skipped`) and left out. Of a
        robot a `RobotValidation` (hingepair.validation.robot_report), whose rows also say `.worst_part`, a link or a
        joint.

    Raises:
        ArgumentError: an argument that `pair.forward_kinematics` refuses.
        MissingDependencyError: Pinocchio is not installed.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0))
    >>> hp.cross_validate(pair, np.linspace(0, 3, 70).reshape(10, 7)).ok
    True
    """
    if isinstance(pair, Mechanism):
        coordinates = {name: value for name, value in (("q", q), ("qd", qd), ("qdd", qdd)) if value is not None}
        return cross_validate_robot(pair, coordinates, frames, base_motion, gravity)
    planar = isinstance(pair, PlanarPair)
    space = pair.to_spatial() if isinstance(pair, PlanarPair) else pair
    twin = to_pinocchio(space)
    state: PairState | PlanarState
    if isinstance(pair, PlanarPair):
        state = pair.forward_kinematics(q, qd, qdd)
    else:
        state = pair.forward_kinematics(q, qd, qdd, sequence=sequence)
    given = read_pair_coordinates(PLANAR_MOTION if planar else SPATIAL_MOTION, q, qd, qdd).parts
    flat = _argument_arrays(given, np.shape(state.R2)[:-1])
    seven = [np.insert(c, (2, 2, 2), 0.0, axis=1) if planar else c for c in flat.values()]
    body1 = _body1_by_pinocchio(seven, "XYZ" if planar else sequence)
    sizes = (None, None) if qd is None else euler_rate_sizes(*(c[:, 3:6] for c in seven[1:]))
    return _compared(space, twin, state, body1, [c[:, 6] for c in seven], sizes, None if planar else sequence)


def cross_validate_from_body1(
    pair: HingePair,
    body1: BodyMotion,
    psi: ArrayLike,
    psid: ArrayLike | None = None,
    psidd: ArrayLike | None = None,
) -> CrossValidation:
    """Compute body 2 from the motion of body 1 by the equations and by Pinocchio, and compare.

    As `cross_validate`, but with the attitude of body 1 given. Pinocchio takes it as a quaternion, so S must be a
    rotation to round-off (`project_to_rotation`) for the two to agree.

    Args:
        pair: the pair.
        body1: the motion of body 1; with v and omega where psid is given, with a and alpha where psidd is.
        psi: hinge angle [rad]; shape (...,), broadcasts against body1.
        psid: its time derivative [rad/s].
        psidd: its second time derivative [rad/s^2].

    Returns:
        A `CrossValidation`, as of `cross_validate`.

    Raises:
        ArgumentError: an argument that `pair.forward_kinematics_from_body1` refuses.
        MissingDependencyError: Pinocchio is not installed.

    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0))
    >>> hp.cross_validate_from_body1(pair, hp.BodyMotion.from_rotvec(R=(1, 2, 3), rotvec=(0.1, 0.2, 0.3)), 0.5).ok
    True
    """
    twin = to_pinocchio(pair)
    state = pair.forward_kinematics_from_body1(body1, psi, psid, psidd)
    angles = {name: c for name, c in (("psi", psi), ("psid", psid), ("psidd", psidd)) if c is not None}
    letters = ("R", "S", "v", "omega", "a", "alpha")[: 2 * len(angles)]
    flat = _argument_arrays(angles | {letter: getattr(body1, letter) for letter in letters}, state.shape)
    moving = BodyMotion(**{letter: flat[letter] for letter in letters})
    sizes = given_rate_sizes(moving.omega, moving.alpha)
    return _compared(pair, twin, state, moving, [flat[name] for name in angles], sizes, None)


def _argument_arrays(given: Mapping[str, Any], shape: tuple[int, ...]) -> dict[str, Float64Array]:
    """Return the arguments at every sample as float64, shape (N, ...); all NaN where one of them is not finite."""
    found: dict[str, Float64Array] = {}
    for name, value in given.items():
        array = np.stack(np.broadcast_arrays(*value), axis=-1) if isinstance(value, tuple) else np.asarray(value)
        rank = 0 if name in {"psi", "psid", "psidd"} else 2 if name == "S" else 1
        tail = array.shape[array.ndim - rank :]
        found[name] = np.broadcast_to(array, (*shape, *tail)).reshape(-1, *tail).astype(np.float64)
    finite = [np.isfinite(c).all(axis=tuple(range(1, c.ndim))) for c in found.values()]
    for values in found.values():
        values[~np.logical_and.reduce(finite)] = np.nan
    return found


def _compared(
    pair: HingePair,
    twin: PinocchioTwin,
    state: PairState | PlanarState,
    body1: BodyMotion,
    hinge: list[Float64Array],
    sizes: tuple[Float64Array | None, Float64Array | None],
    sequence: str | None,
) -> CrossValidation:
    """Return the comparison of the state with Pinocchio's, for a motion from `_argument_arrays`."""
    _, psid, psidd = (*hinge, None, None)[:3]
    scales = output_scales(
        u1=pair.u1, u2=pair.u2, R1=body1.R, v1=body1.v, a1=body1.a,
        W1=sizes[0], A1=sizes[1], psid=psid, psidd=psidd, pinocchio=True,
    )  # fmt: skip
    truths = _body2_by_pinocchio(twin, body1, hinge)
    if isinstance(state, PlanarState):
        phi2 = np.asarray(state.phi2, np.float64).reshape(-1)
        truths, scales["phi2"] = _in_the_plane(truths, phi2), 1 + np.abs(phi2) + np.abs(hinge[0])
    shape, dtype = np.shape(state.R2)[:-1], np.asarray(state.R2).dtype
    rows = []
    for name, truth in truths.items():
        got = np.asarray(getattr(state, name)).reshape(truth.shape)
        rows.append(Comparison.worst_of(name, *error_ratios(name, got, truth, scales[name], dtype), shape))
    skipped = int(np.isnan(hinge[0]).sum())
    return CrossValidation(pair.name, sequence, shape, skipped, unit_roundoff(dtype), tuple(rows))


def _body2_by_pinocchio(twin: PinocchioTwin, body1: BodyMotion, hinge: list[Float64Array]) -> dict[str, Float64Array]:
    """Compute body 2 by Pinocchio, d by the twin at R1 = 0; motion of shape (N,)."""
    q = twin.configuration(body1, hinge[0])
    v = twin.velocity(body1, *hinge[:2]) if len(hinge) > 1 else None
    a = twin.acceleration(body1, *hinge) if len(hinge) > 2 else None
    body2 = twin.body2(q, v, a)
    q[:, :3] = 0
    found = {"R2": body2.R, "S2": body2.S, "d": twin.body2(q).R, "v2": body2.v, "omega2": body2.omega}
    found |= {"a2": body2.a, "alpha2": body2.alpha}
    return {name: values for name, values in found.items() if values is not None}


def _in_the_plane(truths: dict[str, Float64Array], phi2: Float64Array) -> dict[str, Float64Array]:
    """Return the part in the plane z = 0, and instead of the rotation the angle about z that is nearest to phi2."""
    found = {}
    for name, truth in truths.items():
        if name == "S2":
            apart = np.arctan2(truth[:, 1, 0], truth[:, 0, 0]) - phi2
            found["phi2"] = (phi2 + np.arctan2(np.sin(apart), np.cos(apart)))[:, None]
        else:
            found[name] = truth[:, 2:] if name in {"omega2", "alpha2"} else truth[:, :2]
    return found


def _body1_by_pinocchio(coordinates: list[Float64Array], sequence: str) -> BodyMotion:
    """Compute body 1's motion by three Pinocchio joints that turn by its Euler angles (extrinsic: last first)."""
    pin = import_pinocchio("cross_validate")
    order = -1 if sequence.islower() else 1
    model, joint, here = pin.Model(), 0, pin.SE3.Identity()
    for letter in sequence.upper()[::order]:
        joint = model.addJoint(joint, getattr(pin, f"JointModelR{letter}")(), here, f"R{letter}{joint}")
    frame = model.addFrame(pin.Frame("body1", joint, here, pin.FrameType.OP_FRAME))
    angles = [np.ascontiguousarray(c[:, 3:6][:, ::order]) for c in coordinates]
    turning = frame_motion(model, model.createData(), frame, angles)
    points = zip(("R", "v", "a"), (c[:, :3] for c in coordinates), strict=False)
    return BodyMotion(**turning | dict(points))
