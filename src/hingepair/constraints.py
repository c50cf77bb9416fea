"""The constraints as residuals: how far two motions are from sharing a hinge (E1, E2)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair import equations as eq
from hingepair.blocks import Values, components_of, evaluate

_DOUBLE = np.dtype(np.float64)


def hinge_gap(
    constants: Values, R1: NDArray[Any], S1: NDArray[Any], R2: NDArray[Any], S2: NDArray[Any]
) -> NDArray[Any]:
    """The residual of E1, R1 + S1 u1 - (R2 + S2 u2), world axes [m]; shape (..., 3)."""

    def gap(values: Values) -> eq.Vector:
        r1, r2 = eq.rotate(values["S1"], constants["u1"]), eq.rotate(values["S2"], constants["u2"])
        return eq.hinge_gap(values["R1"], r1, values["R2"], r2)

    inputs = {
        "R1": components_of(R1),
        "S1": components_of(S1, 2),
        "R2": components_of(R2),
        "S2": components_of(S2, 2),
    }
    return evaluate(gap, inputs, (3,), _DOUBLE)


def hinge_slip(
    constants: Values, S2: NDArray[Any], omega1: NDArray[Any], omega2: NDArray[Any], psid: NDArray[Any]
) -> NDArray[Any]:
    """The residual of E2, omega2 - omega1 - S2 C^T n psi', world axes [rad/s]; shape (..., 3).

    The hinge axis is one line of both bodies, S1 n = S2 C^T n (E5); body 2's side of it tests more than E2's own.
    """
    n = constants["n"]
    n2 = eq.rotate(eq.transpose(constants["home"]), n) if "home" in constants else n

    def slip(values: Values) -> eq.Vector:
        axis = eq.rotate(values["S2"], n2)
        return eq.subtract(values["omega2"], eq.angular_velocity2(values["omega1"], axis, values["psid"]))

    inputs = {"S2": components_of(S2, 2), "omega1": components_of(omega1), "omega2": components_of(omega2)}
    return evaluate(slip, {**inputs, "psid": psid}, (3,), _DOUBLE)
