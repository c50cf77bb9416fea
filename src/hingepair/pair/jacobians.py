"""How body 2's velocity depends on the velocities that the equations are written in (E2, E8, E9)."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.equations import derivatives as by
from hingepair.equations import spatial as eq
from hingepair.equations.derivatives import Entries
from hingepair.equations.spatial import Vector
from hingepair.errors import ArgumentError
from hingepair.evaluation.plan import steps_of
from hingepair.evaluation.steps import ARM_STEPS, COORDINATES, ROW_STEPS, Step, together
from hingepair.numeric.arrays import FloatArray
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import component, follow_steps, leading_shapes, read_coordinates
from hingepair.rotations.sequences import find_sequence

_JACOBIAN = Step("jacobian", by.jacobian, ("turns", "d", "r2", "axis"))


def _both(a2: Vector, alpha2: Vector) -> Entries:
    return (*a2, *alpha2)


_ZERO: Vector = (0.0, 0.0, 0.0)

JACOBIAN_STEPS = (
    Step("turns", lambda: by.WORLD, ()),
    _JACOBIAN,
    Step(
        "relative_bias",
        lambda slide, pull, psid: eq.relative_acceleration(slide, pull, psid, 0.0),
        ("slide", "pull", "psid"),
    ),
    Step(
        "a2_bias",
        lambda omega1, d, slide, psid, own: eq.acceleration2(_ZERO, omega1, _ZERO, d, slide, psid, own),
        ("omega1", "d", "slide", "psid", "relative_bias"),
    ),
    Step(
        "alpha2_bias",
        lambda omega1, axis, psid: eq.angular_acceleration2(_ZERO, omega1, axis, psid, 0.0),
        ("omega1", "axis", "psid"),
    ),
    Step("acceleration_bias", _both, ("a2_bias", "alpha2_bias")),
)
"""By the world's axes; the bias is a2 and alpha2 where a1, alpha1 and psi'' are none."""

JACOBIAN_TAILS = {"jacobian": (6, 7), "acceleration_bias": (6,)}
COORDINATE_TAILS = {"coordinate_jacobian": (6, 7), "coordinate_jacobian_rate": (6, 7)}


def jacobian(pair: Constants, body1: BodyMotion, psi: ArrayLike) -> FloatArray:
    """Body 2's velocity by the velocities of the equations: (v2, omega2) = Jac @ (v1, omega1, psi') (E8, E2)."""
    values = {**motion_arrays("body1", body1, "S"), "psi": component("psi", psi)}
    shapes = {"body1": body1.shape, "psi": np.shape(psi)}
    steps = (*steps_of(None, "home" in pair.values), *ARM_STEPS, *JACOBIAN_STEPS)
    return follow_steps(steps, {"jacobian": (6, 7)}, pair, values, shapes)["jacobian"]


def acceleration_bias(pair: Constants, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike) -> FloatArray:
    """What velocities alone add to body 2's acceleration: (a2, alpha2) = Jac @ (a1, alpha1, psi'') + bias (E9)."""
    if psid is None:
        raise ArgumentError("psid", "hinge rates", None)
    values = motion_arrays("body1", body1, "S", "omega")
    hinge = {"psi": component("psi", psi), "psid": component("psid", psid)}
    shapes = {"body1": body1.shape, **{name: np.shape(value) for name, value in hinge.items()}}
    steps = (*steps_of(None, "home" in pair.values), *JACOBIAN_STEPS)
    return follow_steps(steps, {"acceleration_bias": (6,)}, pair, values | hinge, shapes)["acceleration_bias"]


def coordinate_jacobian(pair: Constants, q: ArrayLike | tuple[Any, ...], sequence: str) -> FloatArray:
    """Body 2's velocity by the rates of the seven coordinates: (v2, omega2) = Jq @ qd (E8, E2, E4)."""
    return _by_coordinates(pair, "coordinate_jacobian", q, None, sequence)


def coordinate_jacobian_rate(
    pair: Constants, q: ArrayLike | tuple[Any, ...], qd: ArrayLike | tuple[Any, ...], sequence: str
) -> FloatArray:
    """The time derivative of coordinate_jacobian: (a2, alpha2) = Jq @ qdd + Jq' @ qd (E9)."""
    if qd is None:
        raise ArgumentError("qd", "the coordinates' rates", None)
    return _by_coordinates(pair, "coordinate_jacobian_rate", q, qd, sequence)


def _by_coordinates(pair: Constants, result: str, q: Any, qd: Any, sequence: str) -> FloatArray:
    given = read_coordinates(q, qd, None, COORDINATES)
    steps = (*ROW_STEPS, *steps_of(sequence, "home" in pair.values), *ARM_STEPS, *coordinate_steps(sequence))
    return follow_steps(steps, {result: (6, 7)}, pair, given.parts, leading_shapes(given))[result]


@functools.lru_cache(maxsize=64)
def coordinate_steps(sequence: str) -> tuple[Step, ...]:
    """The Jacobian by the rates of the coordinates, and its own rate."""
    order = find_sequence(sequence)
    return (
        Step("own_turns", order.columns, ("axes",)),
        Step("own_turn_rates", order.column_rates, ("axes", "phid")),
        Step("coordinate_jacobian", by.jacobian, ("own_turns", "d", "r2", "axis")),
        Step("d_rate", by.difference_rate, ("omega1", "r1", "omega2", "r2")),
        Step("both_d", together, ("d", "d_rate")),
        Step("all_spins", together, ("omega1", "omega2", "axis")),
        Step(
            "coordinate_jacobian_rate", by.jacobian_rate, ("own_turns", "own_turn_rates", "both_d", "r2", "all_spins")
        ),
    )
