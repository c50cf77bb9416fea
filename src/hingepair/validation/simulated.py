"""Comparison of a simulated motion with Pinocchio's inverse dynamics, and of its rates with slopes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

import numpy as np

from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.finite_differences import differentiate
from hingepair.pair.accuracy import norm, unit_roundoff
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.matrices import skew
from hingepair.validation.pinocchio_twin import import_pinocchio, to_pinocchio
from hingepair.validation.report import MAX_LOAD_RATIO, Comparison, RateComparison

# Components of Pinocchio's generalized force (force and torque on body 1, torque of the hinge) that only loads cause,
# by the base and by whether the motion is planar; for other bases, it is only the hinge torque.
_LOAD_COMPONENTS: Final[Mapping[tuple[str, bool], tuple[int, ...]]] = {
    ("free", False): (0, 1, 2, 3, 4, 5, 6),
    ("pinned", False): (3, 4, 5, 6),
    ("free", True): (0, 1, 5, 6),
    ("pinned", True): (5, 6),
}
_FORCE_SLICES: Final = {"force1": slice(0, 3), "torque1": slice(3, 6), "hinge_torque": slice(6, 7)}
_SCALE_TEXTS: Final = {
    "force1": "masses times the sizes of all terms of their accelerations and of gravity, and the loads",
    "torque1": "inertias times the sizes of all terms of alpha and omega^2, forces times levers, and the loads",
    "hinge_torque": "as for torque1, but of body 2 alone",
}
_SLOPE_ORDERS: Final = (6, 4)  # of the slopes, and of those that tell their errors


def compare_forces(
    pair: HingePair,
    body1: BodyMotion,
    hinge: tuple[Float64Array, ...],
    loads: Mapping[str, Float64Array],
    gravity: Iterable[float],
    *,
    base: str,
    is_planar: bool,
) -> tuple[Comparison, ...]:
    """Compare `loads`, the arrays of the loads of a simulated motion by name, with the forces that the motion
    requires according to Pinocchio's inverse dynamics (`rnea`); return a tuple with a Comparison for each load.

    Args:
        pair: the pair in space, with its masses.
        body1: motion of body 1, all its derivatives; shape (N,).
        hinge: psi, psi' and psi''; shape (N,) each.
        loads: acting loads by name, world axes: force1, torque1, force2 and torque2, shape (N, 3); hinge_torque and
            its parts, shape (N,).
        gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).
        base: "free", "pinned", "fixed" or "prescribed". Forces that hold body 1 are not loads.
        is_planar: whether the motion is in the plane z = 0. Forces that hold the bodies in the plane are not loads.

    Returns:
        A Comparison for each of force1, torque1 (in the axes of body 1) and hinge_torque that only loads cause.
    """
    pin = import_pinocchio("compare_forces")
    twin = to_pinocchio(pair)
    twin.model.gravity.linear = np.array([*gravity])
    psi, psid, psidd = hinge
    q, v = twin.configuration(body1, psi), twin.velocity(body1, psi, psid)
    a = twin.acceleration(body1, psi, psid, psidd)
    q[:, :3] = 0.0  # forces do not depend on the position, and a large one would round the levers
    to_body1_axes = np.swapaxes(np.asarray(body1.S), -1, -2)
    body1_loads = [(to_body1_axes @ loads[name][..., None])[..., 0] for name in ("force1", "torque1")]
    load_forces = np.concatenate([*body1_loads, loads["hinge_torque"][:, None]], axis=-1)
    on_body2 = np.concatenate([loads["force2"], loads["torque2"]], axis=-1)
    required_forces = np.full((len(q), 7), np.nan)
    for i in np.flatnonzero(np.isfinite(np.hstack([q, v, a])).all(axis=1)):
        required_forces[i] = pin.rnea(twin.model, twin.data, q[i], v[i], a[i])
        if on_body2[i].any():
            jacobian = pin.computeFrameJacobian(
                twin.model, twin.data, q[i], twin.body2_frame, pin.LOCAL_WORLD_ALIGNED
            )
            load_forces[i] += jacobian.T @ on_body2[i]
    load_components = _LOAD_COMPONENTS.get((base, is_planar), (6,))
    other_components = [i for i in range(7) if i not in load_components]
    load_forces[:, other_components] = required_forces[:, other_components]
    scales = _force_scales(pair, body1, psid, psidd, loads, float(norm([*gravity])))
    rows = []
    for name, columns in _FORCE_SLICES.items():
        if {*range(*columns.indices(7))} & {*load_components}:
            compared = load_forces[:, columns], required_forces[:, columns], scales[name]
            fields: dict[str, Any] = {"bound": MAX_LOAD_RATIO, "scale": _SCALE_TEXTS[name]}
            rows.append(Comparison.of(name, *compared, unit_roundoff(np.float64), psi.shape, **fields))
    return tuple(rows)


def _force_scales(
    pair: HingePair,
    body1: BodyMotion,
    psid: Float64Array,
    psidd: Float64Array,
    loads: Mapping[str, Float64Array],
    gravity: float,
) -> dict[str, Float64Array]:
    """Return the size of the terms of each force before they cancel, (N,)."""
    sizes: dict[str, Any] = {name: norm(getattr(body1, name)) for name in ("v", "a", "omega", "alpha")}
    W1, A1 = sizes["omega"], sizes["alpha"]
    W2, A2 = W1 + np.abs(psid), A1 + np.abs(psidd) + W1 * np.abs(psid)
    to_hinge = float(norm(pair.u1))
    acceleration = sizes["a"] + (W1 + W2) * sizes["v"] + W1 * W2 * to_hinge + gravity
    force = norm(loads["force1"]) + norm(loads["force2"])
    torque = norm(loads["torque1"]) + norm(loads["torque2"])
    if pair.body1 is not None:
        lever = float(norm(pair.body1.centre_of_mass))
        inertial_force = pair.body1.mass * (acceleration + (A1 + W1**2) * lever)
        force = force + inertial_force
        torque = torque + lever * inertial_force + np.abs(pair.body1.inertia).max() * (A1 + W1**2)
    parts = [np.abs(load) for name, load in loads.items() if name.endswith("_torque")]
    hinge_torque = np.sum(parts, axis=0) + norm(loads["torque2"]) + float(norm(pair.u2)) * norm(loads["force2"])
    if pair.body2 is not None:
        lever = float(norm(pair.body2.centre_of_mass)) + float(norm(pair.u2))
        inertial_force = pair.body2.mass * (acceleration + (A1 + W1**2) * to_hinge + (A2 + W2**2) * lever)
        turning = np.abs(pair.body2.inertia).max() * (A2 + W2**2) + lever * inertial_force
        hinge_torque, force = hinge_torque + turning, force + inertial_force
        torque = torque + turning + to_hinge * inertial_force
    torque = torque + (to_hinge + float(norm(pair.u2))) * norm(loads["force2"])
    return {"force1": force, "torque1": torque, "hinge_torque": hinge_torque}


def compare_rates(
    t: Float64Array, body1: BodyMotion, hinge: tuple[Float64Array, ...], *, body1_moves: bool
) -> tuple[RateComparison, ...]:
    """Compare the rates of a motion, such as v1, with slopes of their quantities, such as R1, by finite differences;
    return a tuple with a RateComparison for each rate.

    Instants are compared only if slopes of order 6 and of order 4 agree there. Instants near a kink are not compared,
    and no instants if they are too few for the motion. A rate that was not compared may be right or wrong.

    Args:
        t: instants [s]; shape (N,).
        body1: motion of body 1, all its derivatives; shape (N,).
        hinge: psi, psi' and psi''; shape (N,) each.
        body1_moves: whether the rates of body 1 are compared too.

    Returns:
        For each rate, the largest difference and the number of compared instants.
    """
    S, omega = np.asarray(body1.S), np.asarray(body1.omega)
    chains: list[tuple[tuple[str, str, str], tuple[Any, Any, Any]]] = [(("psi", "psid", "psidd"), hinge)]  # type: ignore[list-item]
    if body1_moves:
        chains += [(("R1", "v1", "a1"), (body1.R, body1.v, body1.a))]
        S_dot, S_ddot = skew(omega) @ S, skew(np.asarray(body1.alpha)) @ S + skew(omega) @ (skew(omega) @ S)
        chains += [(("S1", "omega1", "alpha1"), (S, S_dot, S_ddot))]
    return tuple(row for names, arrays in chains for row in _compare_chain(t, names, arrays))


def _compare_chain(
    t: Float64Array, names: tuple[str, str, str], arrays: tuple[Any, Any, Any]
) -> Iterator[RateComparison]:
    """Yield the comparisons of the first and the second of the rates; `arrays` holds a quantity and both."""
    x, xd, xdd = (np.asarray(array).reshape(len(t), -1) for array in arrays)
    sizes = [float(np.nanmax(np.abs(array), initial=0.0)) for array in (xd, xdd)]
    step = float(np.diff(t).max(initial=0.0))
    # Otherwise it may oscillate between samples.
    enough = len(t) > _SLOPE_ORDERS[0] and step * sizes[1] <= 0.5 * sizes[0]
    for name, quantity, values, rate in zip(names[1:], names, (x, xd), (xd, xdd), strict=False):
        error = _slope_errors(t - t[0], values, rate) if enough else np.full(len(t), np.nan)
        allowed = 0.05 * float(np.nanmax(np.abs(rate), initial=0.0))  # rates of another motion differ by more
        yield RateComparison.worst_of(name, quantity, error, allowed)


def compare_joint_rates(
    t: Float64Array, q: Float64Array, qd: Float64Array, qdd: Float64Array
) -> tuple[RateComparison, ...]:
    """Compare the rates and accelerations of all joints of a robot, (N, dof) each, with slopes."""
    return tuple(_compare_chain(t, ("q", "qd", "qdd"), (q, qd, qdd)))


def _slope_errors(t: Float64Array, values: Float64Array, rate: Float64Array) -> Float64Array:
    """Return the largest difference of a rate from the slope of values, at each instant."""
    fine, coarse = (np.stack([differentiate(t, c, order)[0] for c in values.T], axis=-1) for order in _SLOPE_ORDERS)
    disagreement = np.abs(fine - coarse).max(axis=-1)
    reach = 3  # samples to either side of an uncertain slope whose slopes are uncertain too
    shifts = [np.roll(np.pad(disagreement, reach), k) for k in range(-reach, reach + 1)]
    slope_error = np.max(shifts, axis=0)[reach:-reach]
    max_slope_error = 1e-3 * np.nanmax(np.abs(rate), initial=0.0)  # slopes across an impact say nothing
    is_resolved = slope_error <= max_slope_error
    return np.where(is_resolved, np.abs(rate - fine).max(axis=-1), np.nan)
