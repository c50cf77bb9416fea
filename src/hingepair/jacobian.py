"""How body 2's velocity depends on the velocities that the equations are written in (E2, E8, E9)."""

from __future__ import annotations

from typing import Any

import numpy as np

from hingepair import derivative_equations as by
from hingepair import kinematics
from hingepair.arrays import FloatArray
from hingepair.backend import choose
from hingepair.errors import ArgumentError
from hingepair.euler import find_sequence
from hingepair.evaluate import Constants, component, follow_steps, leading_shapes, read_coordinates
from hingepair.motion import BodyMotion, motion_arrays
from hingepair.plan import Step, steps_of

_JACOBIAN = Step("jacobian", by.jacobian, ("turns", "d", "r2", "axis"))
_RATE = (
    Step("d_rate", by.difference_rate, ("omega1", "r1", "omega2", "r2")),
    Step("both_d", lambda *both: both, ("d", "d_rate")),
    Step("spin", lambda *all_: all_, ("omega1", "omega2", "axis")),
    Step("jacobian_rate", by.jacobian_rate, ("turns", "turn_rates", "both_d", "r2", "spin")),
)


def jacobian(pair: Constants, body1: BodyMotion, psi: Any) -> FloatArray:
    """(v2, omega2) by (v1, omega1, psi'); shape (..., 6, 7)."""
    values = {**motion_arrays("body1", body1, "S"), "psi": component("psi", psi)}
    shapes = {"body1": body1.shape, "psi": np.shape(psi)}
    world = Step("turns", lambda: by.WORLD, ())
    steps = (*steps_of(None, "home" in pair.values), world, _JACOBIAN)
    return follow_steps(steps, {"jacobian": (6, 7)}, pair, values, shapes)["jacobian"]


def acceleration_bias(pair: Constants, body1: BodyMotion, psi: Any, psid: Any) -> FloatArray:
    """(a2, alpha2) where a1, alpha1 and psi'' are zero; shape (..., 6)."""
    arrays = motion_arrays("body1", body1, "R", "S", "omega")
    if psid is None:
        raise ArgumentError("psid", "hinge rates", None)
    still = np.zeros(3, arrays["S1"].dtype)
    moving = BodyMotion(R=arrays["R1"], S=arrays["S1"], omega=arrays["omega1"], a=still, alpha=still)
    how = choose("numpy", 1)
    state = kinematics.from_body1(pair, moving, psi, psid, 0.0, ("a2", "alpha2"), None, how)
    found = state.arrays()
    return np.concatenate([found["a2"], found["alpha2"]], axis=-1)


def coordinate_jacobian(pair: Constants, q: Any, sequence: str) -> FloatArray:
    """(v2, omega2) by qd; shape (..., 6, 7)."""
    return _by_coordinates(pair, "jacobian", q, None, sequence)


def coordinate_jacobian_rate(pair: Constants, q: Any, qd: Any, sequence: str) -> FloatArray:
    """The time derivative of `coordinate_jacobian`; shape (..., 6, 7)."""
    if qd is None:
        raise ArgumentError("qd", "the coordinates' rates", None)
    return _by_coordinates(pair, "jacobian_rate", q, qd, sequence)


def _by_coordinates(pair: Constants, result: str, q: Any, qd: Any, sequence: str) -> FloatArray:
    order = find_sequence(sequence)
    given = read_coordinates(q, qd, None, len(kinematics.COORDINATES))
    steps = (
        *steps_of(sequence, "home" in pair.values),
        Step("turns", order.columns, ("axes",)),
        Step("turn_rates", order.column_rates, ("axes", "phid")),
        _JACOBIAN,
        *_RATE,
    )
    values = kinematics.values_of(given)
    return follow_steps(steps, {result: (6, 7)}, pair, values, leading_shapes(given))[result]
