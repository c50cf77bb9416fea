"""The pair in Pinocchio (`to_pinocchio`), and both routes to body 2 compared (`cross_validate`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.numeric.arrays import result_dtype
from hingepair.pair.accuracy import error_ratios, euler_rate_sizes, given_rate_sizes, output_scales, unit_roundoff
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.evaluate import component, read_coordinates
from hingepair.pair.forward_kinematics import COORDINATES, PLANAR_COORDINATES
from hingepair.pair.planar_pair import PlanarPair
from hingepair.pair.states import PairState, PlanarState
from hingepair.validation.pinocchio_twin import PinocchioTwin, import_pinocchio, to_pinocchio
from hingepair.validation.report import Comparison, CrossValidation

if TYPE_CHECKING:
    from hingepair.pair.hinge_pair import HingePair

__all__ = [
    "Comparison",
    "CrossValidation",
    "PinocchioTwin",
    "cross_validate",
    "cross_validate_from_body1",
    "to_pinocchio",
]

Float64Array = NDArray[np.float64]

LEVELS = (("R2", "S2", "d"), ("v2", "omega2"), ("a2", "alpha2"))
"""What is compared, by the level at which it appears."""


def cross_validate(
    pair: HingePair | PlanarPair,
    q: ArrayLike | tuple[ArrayLike, ...],
    qd: ArrayLike | tuple[ArrayLike, ...] | None = None,
    qdd: ArrayLike | tuple[ArrayLike, ...] | None = None,
    *,
    sequence: str = "XYZ",
) -> CrossValidation:
    """Compute body 2 by the equations and by Pinocchio, and compare.

    Pinocchio's route shares nothing with ours: body 1's attitude and rates come from Pinocchio too, from a chain
    of three revolute joints in the order of the sequence. R2, S2 and d are compared, with qd also v2 and omega2,
    with qdd also a2 and alpha2. d is that of a twin placed at R1 = 0, since Pinocchio has only R2 - R1.

    Args:
        pair: the pair; a planar one is compared in the plane, phi2 in place of S2.
        q: (x, y, z, phi_x, phi_y, phi_z, psi); shape (..., 7) or a tuple of seven coordinates. Of a planar pair
            (x, y, phi, psi).
        qd: its time derivative; likewise.
        qdd: its second time derivative; likewise.
        sequence: of the Euler angles.

    Returns:
        A `hingepair.pinocchio.CrossValidation`: `.ok`, `.verdict`, str() a table, `.to_json()`; `.rows`, of each
        output `.output`, `.max_error` (in its unit), `.max_ratio` (in u * scale), `.worst_sample` (of max_ratio),
        `.samples`, `.bound`. Samples that are not finite are counted (`.skipped`) and left out.

    Raises:
        ArgumentError: an argument that `pair.forward_kinematics` refuses.
        MissingDependencyError: Pinocchio is not installed.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0))
    >>> hp.cross_validate(pair, np.linspace(0, 3, 70).reshape(10, 7)).ok
    True
    """
    if isinstance(pair, PlanarPair):
        return _cross_validate_planar(pair, q, qd, qdd)
    twin = to_pinocchio(pair)
    state = pair.forward_kinematics(q, qd, qdd, sequence=sequence)
    shape = np.asarray(state.R2).shape[:-1]
    given = read_coordinates(q, qd, qdd, COORDINATES).parts.values()
    dtype = result_dtype(c for seven in given for c in ((seven,) if isinstance(seven, np.ndarray) else seven))
    coordinates = [_packed(seven, shape) for seven in given]
    finite = _finite(coordinates)
    coordinates = [c[finite] for c in coordinates]
    body1 = _body1_by_pinocchio(import_pinocchio("cross_validate"), coordinates, sequence)
    W1, A1 = euler_rate_sizes(*(*(c[:, 3:6] for c in coordinates[1:]), None, None)[:2])
    hinge = [c[:, 6] for c in coordinates]
    return _compared(pair, twin, state, _Finite(shape, finite, body1, hinge, W1, A1), dtype, sequence)


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
        A `hingepair.pinocchio.CrossValidation`, as of `cross_validate`.

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
    shape = state.shape
    angles = [component(name, c) for name, c in (("psi", psi), ("psid", psid), ("psidd", psidd)) if c is not None]
    arrays = {letter: getattr(body1, letter) for letter in ("R", "S", "v", "omega", "a", "alpha")[: 2 * len(angles)]}
    hinge = [_flat(angle, shape) for angle in angles]
    motion = {name: _flat(array, shape, *((3, 3) if name == "S" else (3,))) for name, array in arrays.items()}
    finite = _finite([*hinge, *motion.values()])
    hinge = [angle[finite] for angle in hinge]
    moving = BodyMotion(**{letter: array[finite] for letter, array in motion.items()})
    W1, A1 = given_rate_sizes(moving.omega, moving.alpha)
    dtype = result_dtype((*arrays.values(), *angles))
    return _compared(pair, twin, state, _Finite(shape, finite, moving, hinge, W1, A1), dtype, None)


class _Finite(NamedTuple):
    """The motion at those samples that are finite.

    Attributes:
        shape: leading shape of all samples.
        mask: which of them are finite; shape (N,).
        body1: motion of body 1.
        hinge: psi[, psi'[, psi'']].
        W1: size of body 1's angular velocity.
        A1: size of body 1's angular acceleration.
    """

    shape: tuple[int, ...]
    mask: NDArray[np.bool_]
    body1: BodyMotion
    hinge: list[Float64Array]
    W1: Float64Array | None
    A1: Float64Array | None


def _cross_validate_planar(pair: PlanarPair, q: Any, qd: Any, qdd: Any) -> CrossValidation:
    """E11 against Pinocchio in space."""
    state, space = pair.forward_kinematics(q, qd, qdd), pair.to_spatial()
    given = read_coordinates(q, qd, qdd, PLANAR_COORDINATES).parts.values()
    dtype = result_dtype(c for four in given for c in ((four,) if isinstance(four, np.ndarray) else four))
    flat = [_packed(four, state.shape) for four in given]
    finite = _finite(flat)
    flat = [c[finite] for c in flat]
    seven = [np.insert(c, (2, 2, 2), 0.0, axis=1) for c in flat]
    body1 = _body1_by_pinocchio(import_pinocchio("cross_validate"), seven, "XYZ")
    W1, A1 = euler_rate_sizes(*(*(c[:, 3:6] for c in seven[1:]), None, None)[:2])
    motion = _Finite(state.shape, finite, body1, [c[:, 3] for c in flat], W1, A1)
    return _compared(space, to_pinocchio(space), state, motion, dtype, None)


def _compared(
    pair: HingePair,
    twin: PinocchioTwin,
    state: PairState | PlanarState,
    motion: _Finite,
    dtype: np.dtype[Any],
    sequence: str | None,
) -> CrossValidation:
    """The state, which is that of all samples, against Pinocchio's."""
    _, psid, psidd = (*motion.hinge, None, None)[:3]
    scales = output_scales(
        u1=pair.u1, u2=pair.u2, R1=motion.body1.R, v1=motion.body1.v, a1=motion.body1.a,
        W1=motion.W1, A1=motion.A1, psid=psid, psidd=psidd, pinocchio=True,
    )  # fmt: skip
    truths = _body2_by_pinocchio(twin, motion.body1, motion.hinge)
    if isinstance(state, PlanarState):
        phi2 = np.asarray(state.phi2).reshape(-1)[motion.mask]
        truths, scales["phi2"] = _in_the_plane(truths, phi2), 1 + np.abs(phi2) + np.abs(motion.hinge[0])
    rows = []
    for name, truth in truths.items():
        got = np.asarray(getattr(state, name)).reshape(-1, *truth.shape[1:])[motion.mask]
        error, ratio = error_ratios(name, got, truth, scales[name], dtype)
        rows.append(Comparison.worst_of(name, error, ratio, np.flatnonzero(motion.mask), motion.shape))
    skipped = int(np.count_nonzero(~motion.mask))
    return CrossValidation(pair.name, sequence, motion.shape, skipped, unit_roundoff(dtype), tuple(rows))


def _body2_by_pinocchio(twin: PinocchioTwin, body1: BodyMotion, hinge: list[Float64Array]) -> dict[str, Float64Array]:
    """Body 2 by Pinocchio, one sample at a time; finite motion of shape (N,)."""
    pin = import_pinocchio("cross_validate")
    model, data, frame = twin.model, twin.data, twin.body2_frame
    level = len(hinge) - 1
    inputs = [twin.configuration(body1, hinge[0])]
    inputs += [twin.velocity(body1, *hinge[:2])] if level > 0 else []
    inputs += [twin.acceleration(body1, *hinge)] if level > 1 else []
    at_origin = inputs[0].copy()
    at_origin[:, :3] = 0.0
    names = [name for own in LEVELS[: level + 1] for name in own]
    found = {name: np.empty((len(at_origin), *((3, 3) if name == "S2" else (3,)))) for name in names}
    for i, sample in enumerate(zip(*inputs, strict=True)):
        pin.forwardKinematics(model, data, at_origin[i])
        found["d"][i] = pin.updateFramePlacement(model, data, frame).translation
        pin.forwardKinematics(model, data, *sample)
        placement = pin.updateFramePlacement(model, data, frame)
        found["R2"][i], found["S2"][i] = placement.translation, placement.rotation
        if level > 0:
            twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            found["v2"][i], found["omega2"][i] = twist.linear, twist.angular
        if level > 1:
            classical = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            found["a2"][i], found["alpha2"][i] = classical.linear, classical.angular
    return found


def _in_the_plane(truths: dict[str, Float64Array], phi2: Float64Array) -> dict[str, Float64Array]:
    """What is in the plane z = 0, and the angle about z that is nearest to phi2 in place of the rotation."""
    found = {}
    for name, truth in truths.items():
        if name == "S2":
            apart = np.arctan2(truth[:, 1, 0], truth[:, 0, 0]) - phi2
            found["phi2"] = (phi2 + np.arctan2(np.sin(apart), np.cos(apart)))[:, None]
        else:
            found[name] = truth[:, 2:] if name in {"omega2", "alpha2"} else truth[:, :2]
    return found


def _body1_by_pinocchio(pin: Any, coordinates: list[Float64Array], sequence: str) -> BodyMotion:
    """Body 1's motion, by a chain of three Pinocchio joints that turn by its Euler angles (extrinsic: last first)."""
    order = -1 if sequence.islower() else 1
    model, joint = pin.Model(), 0
    for letter in sequence.upper()[::order]:
        joint = model.addJoint(joint, getattr(pin, f"JointModelR{letter}")(), pin.SE3.Identity(), f"R{letter}{joint}")
    data, count = model.createData(), len(coordinates[0])
    S, omega, alpha = np.empty((count, 3, 3)), np.empty((count, 3)), np.empty((count, 3))
    angles = [np.ascontiguousarray(c[:, 3:6][:, ::order]) for c in coordinates]
    for i, sample in enumerate(zip(*angles, strict=True)):
        pin.forwardKinematics(model, data, *sample)
        S[i] = data.oMi[joint].rotation
        if len(angles) > 1:
            omega[i] = pin.getVelocity(model, data, joint, pin.LOCAL_WORLD_ALIGNED).angular
        if len(angles) > 2:
            alpha[i] = pin.getClassicalAcceleration(model, data, joint, pin.LOCAL_WORLD_ALIGNED).angular
    motion = {"R": coordinates[0][:, :3], "S": S}
    motion |= {"v": coordinates[1][:, :3], "omega": omega} if len(angles) > 1 else {}
    motion |= {"a": coordinates[2][:, :3], "alpha": alpha} if len(angles) > 2 else {}
    return BodyMotion(**motion)


def _finite(arrays: list[Float64Array]) -> NDArray[np.bool_]:
    """At which samples everything is finite; arrays of shape (N, ...)."""
    finite: NDArray[np.bool_] = np.logical_and.reduce(
        [np.isfinite(a).all(axis=tuple(range(1, a.ndim))) for a in arrays]
    )
    return finite


def _flat(value: ArrayLike, shape: tuple[int, ...], *tail: int) -> Float64Array:
    """The value at every sample as float64; shape (N, *tail)."""
    return np.broadcast_to(value, (*shape, *tail)).reshape(-1, *tail).astype(np.float64)


def _packed(parts: tuple[Any, ...] | NDArray[Any], shape: tuple[int, ...]) -> Float64Array:
    """Coordinates as float64, side by side; shape (N, 7), or (N, 4) in the plane."""
    if isinstance(parts, np.ndarray):
        return _flat(parts, shape, parts.shape[-1])
    return np.stack([_flat(c, shape) for c in parts], axis=-1)
