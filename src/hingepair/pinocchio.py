"""The pair in Pinocchio (`to_pinocchio`), and both routes to body 2 compared (`cross_validate`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.accuracy import error_ratios, euler_rate_sizes, output_scales, unit_roundoff
from hingepair.arrays import result_dtype
from hingepair.cross_validation import Comparison, CrossValidation
from hingepair.evaluate import coordinates as read
from hingepair.motion import BodyMotion
from hingepair.pinocchio_twin import PinocchioTwin, import_pinocchio, to_pinocchio

if TYPE_CHECKING:
    from hingepair.pair import HingePair

__all__ = ["Comparison", "CrossValidation", "PinocchioTwin", "cross_validate", "to_pinocchio"]

Float64Array = NDArray[np.float64]

LEVELS = (("R2", "S2", "d"), ("v2", "omega2"), ("a2", "alpha2"))
"""What is compared, by the level at which it appears."""


def cross_validate(
    pair: HingePair,
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
        pair: the pair.
        q: (x, y, z, phi_x, phi_y, phi_z, psi); shape (..., 7) or a tuple of seven coordinates.
        qd: its time derivative; likewise.
        qdd: its second time derivative; likewise.
        sequence: of the Euler angles.

    Returns:
        The report; samples that are not finite are counted and left out.

    Raises:
        ArgumentError: an argument that `pair.forward_kinematics` refuses.
        MissingDependencyError: Pinocchio is not installed.

    >>> from hingepair.pair import HingePair
    >>> pair = HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0))
    >>> cross_validate(pair, np.linspace(0, 3, 70).reshape(10, 7)).ok
    True
    """
    twin = to_pinocchio(pair)
    state = pair.forward_kinematics(q, qd, qdd, sequence=sequence)
    results = {name: np.asarray(getattr(state, name)) for level in LEVELS for name in level}
    given = [read(name, c, 7) for name, c in (("q", q), ("qd", qd), ("qdd", qdd)) if c is not None]
    dtype = result_dtype(c for seven in given for c in ((seven,) if isinstance(seven, np.ndarray) else seven))
    shape = results["R2"].shape[:-1]
    coordinates = [_packed(seven, shape) for seven in given]
    finite = np.logical_and.reduce([np.isfinite(c).all(axis=-1) for c in coordinates])
    coordinates = [c[finite] for c in coordinates]
    expected = _by_pinocchio(twin, coordinates, sequence)
    scales = _scales(pair, coordinates)
    rows = []
    for name, truth in expected.items():
        got = results[name].reshape(-1, *truth.shape[1:])[finite]
        error, ratio = error_ratios(name, got, truth, scales[name], dtype)
        rows.append(Comparison.worst_of(name, error, ratio, np.flatnonzero(finite), shape))
    skipped = int(np.count_nonzero(~finite))
    return CrossValidation(pair.name, sequence, shape, skipped, unit_roundoff(dtype), tuple(rows))


def _by_pinocchio(twin: PinocchioTwin, coordinates: list[Float64Array], sequence: str) -> dict[str, Float64Array]:
    """Body 2 by Pinocchio, one sample at a time; finite coordinates q[, qd[, qdd]] of shape (N, 7)."""
    pin = import_pinocchio("cross_validate")
    model, data, frame = twin.model, twin.data, twin.body2_frame
    q, *rates = coordinates
    body1 = _body1_by_pinocchio(pin, coordinates, sequence)
    psi = [c[:, 6] for c in coordinates]
    inputs = [twin.configuration(body1, psi[0])]
    inputs += [twin.velocity(body1, *psi[:2])] if rates else []
    inputs += [twin.acceleration(body1, *psi)] if len(rates) == 2 else []
    at_origin = inputs[0].copy()
    at_origin[:, :3] = 0.0
    names = [name for level in LEVELS[: len(coordinates)] for name in level]
    found = {name: np.empty((len(q), *((3, 3) if name == "S2" else (3,)))) for name in names}
    for i, sample in enumerate(zip(*inputs, strict=True)):
        pin.forwardKinematics(model, data, at_origin[i])
        found["d"][i] = pin.updateFramePlacement(model, data, frame).translation
        pin.forwardKinematics(model, data, *sample)
        placement = pin.updateFramePlacement(model, data, frame)
        found["R2"][i], found["S2"][i] = placement.translation, placement.rotation
        if rates:
            twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            found["v2"][i], found["omega2"][i] = twist.linear, twist.angular
        if len(rates) == 2:
            classical = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            found["a2"][i], found["alpha2"][i] = classical.linear, classical.angular
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


def _scales(pair: HingePair, coordinates: list[Float64Array]) -> dict[str, Float64Array]:
    """The scales of these samples, with the terms that Pinocchio's route has."""
    q, qd, qdd = (*coordinates, None, None)[:3]
    W1, A1 = euler_rate_sizes(None if qd is None else qd[:, 3:6], None if qdd is None else qdd[:, 3:6])
    linear = {name: c[:, :3] for name, c in (("R1", q), ("v1", qd), ("a1", qdd)) if c is not None}
    hinge = {name: c[:, 6] for name, c in (("psid", qd), ("psidd", qdd)) if c is not None}
    return output_scales(u1=pair.u1, u2=pair.u2, W1=W1, A1=A1, pinocchio=True, **linear, **hinge)


def _packed(seven: tuple[Any, ...] | NDArray[Any], shape: tuple[int, ...]) -> Float64Array:
    """Seven coordinates as float64, side by side; shape (N, 7)."""
    if isinstance(seven, np.ndarray):
        return np.broadcast_to(seven, (*shape, 7)).reshape(-1, 7).astype(np.float64)
    return np.stack([np.broadcast_to(c, shape).reshape(-1) for c in seven], axis=-1, dtype=np.float64)
