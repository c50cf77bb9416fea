"""Derivatives of the motion of body 2 by the geometry of a pair."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from hingepair.engine.backend import execution_of
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.computations import INPUT_LABELS, body1_inputs, computation_of
from hingepair.pair.constants import Constants
from hingepair.plans.constant_steps import CONSTANT_SHAPES
from hingepair.plans.derivatives import Derivative
from hingepair.plans.plan import SPATIAL_MOTION_KIND

_GEOMETRY: Final = ("u1", "u2", "n", "home")  # by which derivatives are taken
_POSE: Final = ("d", "S2")  # of which they are taken


def geometry_jacobian(pair: Constants, body1: BodyMotion, psi: ArrayLike, points: tuple[str, ...] = ()) -> Any:
    """Compute the derivatives of R2, of body 2's attitude and of some points (rows) by u1, u2, n and home (columns);
    shape (..., 6 + 3 k, 12) (E5, E7). Changes of the attitude are rotation vectors
    in world axes; those of home, in body-1 axes.
    """
    given, outputs = body1_inputs(body1, psi), (*_POSE, *points)
    arguments = tuple((name, CONSTANT_SHAPES[False][name]) for name in _GEOMETRY)
    computation = computation_of(SPATIAL_MOTION_KIND, pair, outputs, by_constants=True)
    derivative = Derivative("jacobian", outputs, arguments)
    found = computation.compute(given, execution_of("auto", 1), labels=INPUT_LABELS, derivative=derivative)
    rows = [[found[f"{output}_{name}"] for name in _GEOMETRY] for output in outputs]
    return np.concat([np.concat(row, axis=-1) for row in rows], axis=-2)


def attitude_of_body2(pair: Constants, body1: BodyMotion, psi: ArrayLike) -> Any:
    """Compute S2; shape (..., 3, 3) (E5)."""
    computation = computation_of(SPATIAL_MOTION_KIND, pair, ("S2",))
    return computation.compute(body1_inputs(body1, psi), execution_of("auto", 1), labels=INPUT_LABELS)["S2"]
