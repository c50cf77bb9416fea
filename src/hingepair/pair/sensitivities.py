"""How body 2's position, attitude and velocity depend on the pair's constants and on the hinge angle (E2, E5-E8)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.equations import derivatives as by
from hingepair.equations import spatial as eq
from hingepair.evaluation.plan import steps_of
from hingepair.evaluation.steps import ARM_STEPS, Step
from hingepair.numeric.arrays import FloatArray, Frozen, read_only
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import component, follow_steps


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Sensitivities(Frozen):
    """Derivatives of d, S2, v2, omega2 by u1, u2, n and psi; `d_by_u1` is that of d by u1; world axes, read-only.

    The last axis is the component of what is varied (none for psi): where u1 changes by a small du, d changes by
    d_by_u1 @ du. Those of v2 and omega2 are None where rates were not given; those of S2 by u1 and u2 and of omega2
    by u1, u2 and psi are zero. n stays at unit length: its change is that of n / abs(n), so the derivative along n
    itself is zero.

    Attributes:
        d_by_u1: (..., 3, 3).
        d_by_u2: (..., 3, 3).
        d_by_n: (..., 3, 3) m.
        d_by_psi: (..., 3) m/rad.
        S2_by_n: (..., 3, 3, 3); [..., i, j, k] is that of S2[i, j] by n[k].
        S2_by_psi: (..., 3, 3).
        v2_by_u1: (..., 3, 3) 1/s.
        v2_by_u2: (..., 3, 3) 1/s.
        v2_by_n: (..., 3, 3) m/s.
        v2_by_psi: (..., 3) m/(s rad).
        omega2_by_n: (..., 3, 3) rad/s.
    """

    d_by_u1: FloatArray
    d_by_u2: FloatArray
    d_by_n: FloatArray
    d_by_psi: FloatArray
    S2_by_n: FloatArray
    S2_by_psi: FloatArray
    v2_by_u1: FloatArray | None = None
    v2_by_u2: FloatArray | None = None
    v2_by_n: FloatArray | None = None
    v2_by_psi: FloatArray | None = None
    omega2_by_n: FloatArray | None = None


POSE_TAILS = {
    "d_by_u1": (3, 3),
    "d_by_u2": (3, 3),
    "d_by_n": (3, 3),
    "d_by_psi": (3,),
    "S2_by_n": (3, 3, 3),
    "S2_by_psi": (3, 3),
}
VELOCITY_TAILS = {"v2_by_u1": (3, 3), "v2_by_u2": (3, 3), "v2_by_n": (3, 3), "v2_by_psi": (3,), "omega2_by_n": (3, 3)}
SENSITIVITY_STEPS = (
    Step("turned_by_n", by.turns_by_n, ("S1", "n", "hinge")),
    Step("d_by_u1", by.positive, ("S1",)),
    Step("d_by_u2", by.negative, ("S2",)),
    Step("d_by_n", by.difference_by_turns, ("turned_by_n", "r2")),
    Step("d_by_psi", eq.cross, ("r2", "axis")),
    Step("S2_by_n", by.attitude_by_turns, ("turned_by_n", "S2")),
    Step("S2_by_psi", by.spun, ("axis", "S2")),
    Step("spun_by_n", by.spins_by_n, ("S1", "n", "psid")),
    Step("v2_by_u1", by.spun, ("omega1", "S1")),
    Step("S2_rate", by.spun, ("omega2", "S2")),
    Step("v2_by_u2", by.negative, ("S2_rate",)),
    Step("v2_by_n", by.velocity_by_n, ("spun_by_n", "turned_by_n", "omega2", "r2")),
    Step("v2_by_psi", by.velocity_by_psi, ("omega2", "r2", "axis")),
    Step("omega2_by_n", lambda spins: by.beside(*spins), ("spun_by_n",)),
)


def sensitivities(pair: Constants, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike | None) -> Sensitivities:
    """Derivatives of (d, S2, v2, omega2) by u1, u2, n and psi (E2, E5-E8); those of R2 are those of d."""
    values: dict[str, Any] = {**motion_arrays("body1", body1, "S"), "psi": component("psi", psi)}
    shapes = {"body1": body1.shape, "psi": np.shape(psi)}
    tails: dict[str, tuple[int, ...]] = {**POSE_TAILS}
    if psid is not None:
        values |= {**motion_arrays("body1", body1, "omega"), "psid": component("psid", psid)}
        shapes["psid"] = np.shape(psid)
        tails |= VELOCITY_TAILS
    steps = (*steps_of(None, "home" in pair.values), *ARM_STEPS, *SENSITIVITY_STEPS)
    found = follow_steps(steps, tails, pair, values, shapes)
    return Sensitivities(**{name: read_only(array) for name, array in found.items()})
