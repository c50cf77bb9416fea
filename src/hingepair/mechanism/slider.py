"""The slider: two rigid bodies that translate relative to each other along an axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import quoted
from hingepair.numeric.arrays import Frozen
from hingepair.numeric.tables import Sheet, Shown, sheet_of
from hingepair.pair.body import Body
from hingepair.pair.constants import check_single_pair
from hingepair.pair.hinge_pair import HingePair

# Names of the fields, in the order of the constructor's arguments.
_SLIDER_FIELD_NAMES = ("u1", "u2", "n", "home", "name", "limits", "body1", "body2", "torque_limit", "rate_limit")


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Slider(Frozen, Shown):
    """Two rigid bodies joined by a slider (prismatic joint): R2 = R1 + S1 (u1 + n q) - S2 u2 and S2 = S1 home. The
    coordinate q is the displacement along n [m]. Optional arguments are the mass properties of the bodies, the
    `limits` of q, and the largest magnitudes of the force (`torque_limit`) and of the rate (`rate_limit`).

    Like a `HingePair`, a Slider can be a joint of a `Mechanism`. The arguments have the same names as the arguments
    of a `HingePair`. They are stored as attributes of these names; the arrays are copied and read-only. The methods
    of a `Mechanism` do not enforce `limits`, `torque_limit` and `rate_limit`; reports and exports show them.

    Args:
        u1: vector from the reference point of body 1 to the position that a point P of body 2 has when q = 0, body-1
            axes [m]; shape (3,).
        u2: vector from the reference point of body 2 to the point P, body-2 axes [m]; shape (3,).
        n: direction in which body 2 moves, body-1 axes; any non-zero length, stored at unit length; shape (3,).
        home: constant attitude of body 2 relative to body 1, a rotation matrix from body-2 axes to body-1 axes; shape
            (3, 3); the identity by default.
        name: name of the joint; "slider" unless given.
        limits: lower and upper limit of q [m]; shape (2,); None (default) for no limits.
        body1: mass properties and shapes of body 1, a `Body`; None (default) if they are unknown.
        body2: mass properties and shapes of body 2, a `Body`; None (default) if they are unknown.
        torque_limit: largest magnitude of the force of the slider's motor [N]; None (default) for no limit. URDF
            calls this limit effort.
        rate_limit: largest magnitude of the rate q' [m/s]; None (default) for no limit.

    Raises:
        ArgumentError: a value cannot be used: it is not finite or has the wrong shape, n is zero, home is not a
            rotation, the lower limit is above the upper limit, or torque_limit or rate_limit is below 0. The
            message names the argument.

    >>> import hingepair as hp
    >>> lift = hp.Slider(u1=(0, 0, 0.5), u2=(0, 0, 0), n=(0, 0, 2), name="lift", limits=(0, 1.5))
    >>> lift.n.tolist(), lift.limits
    ([0.0, 0.0, 1.0], (0.0, 1.5))
    """

    u1: NDArray[np.float64]
    u2: NDArray[np.float64]
    n: NDArray[np.float64]
    home: NDArray[np.float64]
    name: str
    limits: tuple[float, float] | None
    body1: Body | None
    body2: Body | None
    torque_limit: float | None
    rate_limit: float | None

    def __init__(
        self,
        u1: ArrayLike,
        u2: ArrayLike,
        n: ArrayLike,
        home: ArrayLike | None = None,
        name: str = "slider",
        limits: ArrayLike | None = None,
        body1: Body | None = None,
        body2: Body | None = None,
        torque_limit: float | None = None,
        rate_limit: float | None = None,
    ) -> None:
        # The fields are those of a pair, and so are the checks.
        checked = HingePair(u1, u2, n, home, name, limits, body1, body2, torque_limit, rate_limit)
        check_single_pair(checked)
        for field in _SLIDER_FIELD_NAMES:
            object.__setattr__(self, field, getattr(checked, field))

    def __repr__(self) -> str:
        field_values: dict[str, Any] = {field: getattr(self, field) for field in _SLIDER_FIELD_NAMES}
        shown = (
            f"{field}={value.tolist() if isinstance(value, np.ndarray) else quoted(value)}"
            for field, value in field_values.items()
            if value is not None
        )
        return f"Slider({', '.join(shown)})"

    def _sheet(self) -> Sheet:
        names = ("u1", "u2", "n", "home", "limits", "torque_limit", "rate_limit")
        masses = (("mass1", self.body1 and self.body1.mass), ("mass2", self.body2 and self.body2.mass))
        return sheet_of(self.name, [*((name, getattr(self, name)) for name in names), *masses])
