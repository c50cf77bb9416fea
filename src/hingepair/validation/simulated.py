"""Comparison of a simulated motion with Pinocchio's inverse dynamics, and of its rates with slopes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from hingepair.mechanism.mechanism import Mechanism
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.finite_differences import differentiate
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_load import TORQUE_PARTS
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.matrices import skew
from hingepair.validation.report import Comparison, RateComparison
from hingepair.validation.robot_check import compare_loads

_SCALE_TEXTS: Final = {  # what the scale of each load's error is, for reports
    "force1": "masses times the sizes of all terms of their accelerations and of gravity, and the loads",
    "torque1": "inertias times the sizes of all terms of alpha and omega^2, forces times levers, and the loads",
    "hinge_torque": "as for torque1, but of body 2 alone",
}
_LINK = "body2"  # name of body 2 in the robot of one joint
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
        A Comparison for each of force1, torque1 and hinge_torque that only loads cause.
    """
    robot = Mechanism([replace(pair, name=_LINK)], base="free" if base in {"free", "pinned"} else "fixed")
    of_joint = {"hinge_torque": "tau", **{f"{part}_torque": part for part in TORQUE_PARTS}}
    acting = {name: loads[given][:, None] for given, name in of_joint.items() if given in loads}
    acting |= {"force1": loads["force1"], "torque1": loads["torque1"]}
    acting |= {f"force_{_LINK}": loads["force2"], f"torque_{_LINK}": loads["torque2"]}
    q, qd, qdd = (np.asarray(values)[:, None] for values in hinge)
    torque, *on_body1 = compare_loads(robot, q, qd, qdd, body1, [*gravity], acting, base, is_planar=is_planar)
    rows = (*on_body1, replace(torque, output="hinge_torque", worst_part=""))
    return tuple(replace(row, scale=_SCALE_TEXTS[row.output]) for row in rows)


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
    """Return the largest difference of a rate from the slope of values, at each instant; NaN where slopes of two
    orders disagree.
    """
    fine, coarse = (np.stack([differentiate(t, c, order)[0] for c in values.T], axis=-1) for order in _SLOPE_ORDERS)
    disagreement = np.abs(fine - coarse).max(axis=-1)
    reach = 3  # samples to either side of an uncertain slope whose slopes are uncertain too
    shifts = [np.roll(np.pad(disagreement, reach), k) for k in range(-reach, reach + 1)]
    slope_error = np.max(shifts, axis=0)[reach:-reach]
    max_slope_error = 1e-3 * np.nanmax(np.abs(rate), initial=0.0)  # slopes across an impact say nothing
    is_resolved = slope_error <= max_slope_error
    return np.where(is_resolved, np.abs(rate - fine).max(axis=-1), np.nan)
