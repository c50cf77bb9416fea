"""Body 2 by the equations and by Pinocchio, compared."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.evaluation.steps import COORDINATES, PLANAR_COORDINATES
from hingepair.numeric.arrays import Float64Array, result_dtype
from hingepair.pair.accuracy import error_ratios, euler_rate_sizes, given_rate_sizes, output_scales, unit_roundoff
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.evaluate import component, read_coordinates
from hingepair.pair.planar_pair import PlanarPair
from hingepair.pair.states import PairState, PlanarState
from hingepair.validation.pinocchio_twin import PinocchioTwin, import_pinocchio, to_pinocchio
from hingepair.validation.report import Comparison, CrossValidation

if TYPE_CHECKING:
    from hingepair.pair.hinge_pair import HingePair


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
        A `CrossValidation` (hingepair.validation.report): `.ok`, `.verdict`, str() a table, `.to_json()`; `.rows`, of
        each output `.output`, `.max_error` (in its unit), `.max_ratio` (in u * scale), `.worst_sample` (of
        max_ratio), `.samples`, `.bound`. Samples that are not finite are counted (`.skipped`) and left out.

    Raises:
        ArgumentError: an argument that `pair.forward_kinematics` refuses.
        MissingDependencyError: Pinocchio is not installed.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0))
    >>> hp.cross_validate(pair, np.linspace(0, 3, 70).reshape(10, 7)).ok
    True
    """
    planar = isinstance(pair, PlanarPair)
    space = pair.to_spatial() if isinstance(pair, PlanarPair) else pair
    twin = to_pinocchio(space)
    state: PairState | PlanarState
    if isinstance(pair, PlanarPair):
        state = pair.forward_kinematics(q, qd, qdd)
    else:
        state = pair.forward_kinematics(q, qd, qdd, sequence=sequence)
    shape = np.asarray(state.R2).shape[:-1]
    given = read_coordinates(q, qd, qdd, PLANAR_COORDINATES if planar else COORDINATES).parts.values()
    dtype = result_dtype(c for parts in given for c in ((parts,) if isinstance(parts, np.ndarray) else parts))
    flat = [_packed(parts, shape) for parts in given]
    finite = _finite(flat)
    seven = [np.insert(c, (2, 2, 2), 0.0, axis=1) if planar else c for c in (c[finite] for c in flat)]
    body1 = _body1_by_pinocchio(import_pinocchio("cross_validate"), seven, "XYZ" if planar else sequence)
    sizes = euler_rate_sizes(*(*(c[:, 3:6] for c in seven[1:]), None, None)[:2])
    hinge = [c[:, 6] for c in seven]
    return _compared(space, twin, state, finite, body1, hinge, sizes, dtype, None if planar else sequence)


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
    shape = state.shape
    angles = [component(name, c) for name, c in (("psi", psi), ("psid", psid), ("psidd", psidd)) if c is not None]
    arrays = {letter: getattr(body1, letter) for letter in ("R", "S", "v", "omega", "a", "alpha")[: 2 * len(angles)]}
    hinge = [_flat(angle, shape) for angle in angles]
    motion = {name: _flat(array, shape, *((3, 3) if name == "S" else (3,))) for name, array in arrays.items()}
    finite = _finite([*hinge, *motion.values()])
    hinge = [angle[finite] for angle in hinge]
    moving = BodyMotion(**{letter: array[finite] for letter, array in motion.items()})
    sizes = given_rate_sizes(moving.omega, moving.alpha)
    dtype = result_dtype((*arrays.values(), *angles))
    return _compared(pair, twin, state, finite, moving, hinge, sizes, dtype, None)


def _compared(
    pair: HingePair,
    twin: PinocchioTwin,
    state: PairState | PlanarState,
    finite: NDArray[np.bool_],
    body1: BodyMotion,
    hinge: list[Float64Array],
    sizes: tuple[Float64Array | None, Float64Array | None],
    dtype: np.dtype[Any],
    sequence: str | None,
) -> CrossValidation:
    """The state of all samples against Pinocchio's at those that are finite, of which is what follows `finite`."""
    _, psid, psidd = (*hinge, None, None)[:3]
    shape = np.asarray(state.R2).shape[:-1]
    scales = output_scales(
        u1=pair.u1, u2=pair.u2, R1=body1.R, v1=body1.v, a1=body1.a,
        W1=sizes[0], A1=sizes[1], psid=psid, psidd=psidd, pinocchio=True,
    )  # fmt: skip
    truths = _body2_by_pinocchio(twin, body1, hinge)
    if isinstance(state, PlanarState):
        phi2 = np.asarray(state.phi2, np.float64).reshape(-1)[finite]
        truths, scales["phi2"] = _in_the_plane(truths, phi2), 1 + np.abs(phi2) + np.abs(hinge[0])
    rows = []
    for name, truth in truths.items():
        got = np.asarray(getattr(state, name)).reshape(-1, *truth.shape[1:])[finite]
        error, ratio = error_ratios(name, got, truth, scales[name], dtype)
        rows.append(Comparison.worst_of(name, error, ratio, np.flatnonzero(finite), shape))
    skipped = int(np.count_nonzero(~finite))
    return CrossValidation(pair.name, sequence, shape, skipped, unit_roundoff(dtype), tuple(rows))


def _body2_by_pinocchio(twin: PinocchioTwin, body1: BodyMotion, hinge: list[Float64Array]) -> dict[str, Float64Array]:
    """Body 2 by Pinocchio, d by the twin at R1 = 0; finite motion of shape (N,)."""
    q = twin.configuration(body1, hinge[0])
    v = twin.velocity(body1, *hinge[:2]) if len(hinge) > 1 else None
    a = twin.acceleration(body1, *hinge) if len(hinge) > 2 else None
    body2 = twin.body2(q, v, a)
    d = twin.body2(np.concatenate([np.zeros_like(q[:, :3]), q[:, 3:]], axis=1)).R
    found = {"R2": body2.R, "S2": body2.S, "d": d, "v2": body2.v, "omega2": body2.omega, "a2": body2.a}
    return {name: values for name, values in (found | {"alpha2": body2.alpha}).items() if values is not None}


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
