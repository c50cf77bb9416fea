"""Derivatives of the motion of body 2 by the geometry of a pair."""

from __future__ import annotations

from typing import Any, Final

from numpy.typing import ArrayLike

from hingepair.engine.backend import execution_of
from hingepair.numeric.array_libraries import namespace_of
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.computations import INPUT_LABELS, body1_inputs, computation_of
from hingepair.pair.constants import Constants
from hingepair.plans.constant_steps import CONSTANT_SHAPES
from hingepair.plans.derivatives import Derivative
from hingepair.plans.plan import SPATIAL_MOTION_KIND

_GEOMETRY: Final = ("u1", "u2", "n", "home")
_BY_GEOMETRY: Final = Derivative(
    "jacobian", ("d", "S2"), tuple((name, CONSTANT_SHAPES[False][name]) for name in _GEOMETRY)
)


def geometry_jacobian(pair: Constants, body1: BodyMotion, psi: ArrayLike) -> Any:
    """Compute the derivatives of R2 and of body 2's attitude (rows) by u1, u2, n and home (columns); shape
    (..., 6, 12) (E5, E7), an array of the caller's library. Changes of the attitude are rotation vectors in world
    axes; those of home, in body-1 axes.
    """
    given = body1_inputs(body1, psi)
    computation = computation_of(SPATIAL_MOTION_KIND, pair, _BY_GEOMETRY.outputs, by_constants=True)
    found = computation.compute(given, execution_of("auto", 1), labels=INPUT_LABELS, derivative=_BY_GEOMETRY)
    rows = [[found[f"{output}_{name}"] for name in _GEOMETRY] for output in _BY_GEOMETRY.outputs]
    xp = namespace_of(rows[0][0])
    return xp.concat([xp.concat(row, axis=-1) for row in rows], axis=-2)
