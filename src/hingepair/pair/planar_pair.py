"""The planar pair: two bodies in a plane joined by a pin (E11)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.evaluation.backend import choose
from hingepair.numeric.arrays import broadcast_shape, constant
from hingepair.numeric.blocks import components_of, numbers
from hingepair.pair import forward_kinematics as kinematics
from hingepair.pair.accuracy import planar_error_bounds
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import Out, Outputs
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.states import PlanarState


@dataclass(frozen=True, slots=True, eq=False, init=False)
class PlanarPair:
    """Two bodies in a plane joined by a pin: R1 + S1 u1 = R2 + S2 u2, phi2 = phi + psi (E11).

    The spatial pair with n = e_z, in two coordinates. Values are copied in and read-only;
    `dataclasses.replace(pair, u1=...)` gives a pair with another u1. u1 and u2 may carry leading axes that broadcast
    against the samples.

    Args:
        u1: hinge point from body 1's reference point, body-1 axes [m]; shape (2,) or (..., 2).
        u2: hinge point from body 2's reference point, body-2 axes [m]; shape (2,) or (..., 2).
        name: what the pair is called in exports and messages.

    Raises:
        ArgumentError: a value is not finite or has the wrong shape; names the argument.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.PlanarPair(u1=(1, 0), u2=(-1, 0))
    >>> pair.forward_kinematics((0, 0, 0, np.pi / 2)).R2.round(12) + 0.0
    array([1., 1.])
    """

    u1: NDArray[np.float64]
    u2: NDArray[np.float64]
    name: str
    constants: Constants = field(init=False)

    def __init__(self, u1: ArrayLike, u2: ArrayLike, name: str = "planar_pair") -> None:
        if not isinstance(name, str) or not name.strip():
            raise ArgumentError("name", "a text that is not empty", quoted(name))
        arrays = {"u1": constant("u1", u1, 2), "u2": constant("u2", u2, 2)}
        values = {key: numbers(components_of(array)) for key, array in arrays.items()}
        shape = broadcast_shape({key: array.shape[:-1] for key, array in arrays.items()})
        for key, value in {**arrays, "name": name, "constants": Constants(values, arrays, shape)}.items():
            object.__setattr__(self, key, value)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.u1, self.u2, self.name)

    def __repr__(self) -> str:
        return f"PlanarPair(u1={self.u1.tolist()}, u2={self.u2.tolist()}, name={self.name!r})"

    def forward_kinematics(
        self,
        q: ArrayLike | tuple[Any, ...],
        qd: ArrayLike | tuple[Any, ...] | None = None,
        qdd: ArrayLike | tuple[Any, ...] | None = None,
        *,
        outputs: Outputs = None,
        out: Out = None,
        workers: int = 1,
        backend: str = "auto",
    ) -> PlanarState:
        """Body 2 from the four coordinates q = (x, y, phi, psi) (E11).

        As `HingePair.forward_kinematics`, without a sequence: q, qd and qdd are arrays of shape (..., 4), or tuples
        of four that broadcast [m, rad]; the outputs are R2, d, v2, a2 (..., 2) and phi2, omega2, alpha2 (...,).

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.PlanarPair(u1=(1, 0), u2=(-1, 0))
        >>> state = pair.forward_kinematics(np.zeros((5, 4)), np.ones((5, 4)))
        >>> state.v2[0], state.omega2[0]
        (array([1., 4.]), np.float64(2.0))
        """
        how = choose(backend, workers)
        return kinematics.planar_from_coordinates(self.constants, q, qd, qdd, outputs, out, how)

    def error_bounds(
        self,
        q: ArrayLike | tuple[Any, ...],
        qd: ArrayLike | tuple[Any, ...] | None = None,
        qdd: ArrayLike | tuple[Any, ...] | None = None,
        outputs: Outputs = None,
    ) -> dict[str, NDArray[np.float64]]:
        """How far rounding can have taken each output of forward_kinematics from the exact result, at every sample.

        As `HingePair.error_bounds`.

        >>> import hingepair as hp
        >>> pair = hp.PlanarPair(u1=(1, 0), u2=(-1, 0))
        >>> f"{pair.error_bounds((0, 0, 0.5, 0.25))['R2']:.0e}"
        '7e-16'
        """
        return planar_error_bounds(self.constants, q, qd, qdd, outputs)

    def to_spatial(self) -> HingePair:
        """The same pair in space: n = e_z, and the plane is z = 0.

        >>> import hingepair as hp
        >>> hp.PlanarPair(u1=(1, 0), u2=(-1, 0)).to_spatial().n
        array([0., 0., 1.])
        """
        u1, u2 = (np.concatenate([u, np.zeros((*u.shape[:-1], 1))], axis=-1) for u in (self.u1, self.u2))
        return HingePair(u1=u1, u2=u2, n=(0, 0, 1), name=self.name)
