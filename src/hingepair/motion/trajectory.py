"""Results of integration: attitudes and hinge angles at the instants, and the state of the pair."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass
from inspect import Signature
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.results import missing_attribute_error
from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.results import Result
from hingepair.mechanism.states import PairState, PlanarState
from hingepair.numeric.arrays import Frozen, read_only
from hingepair.numeric.blocks import components_of, tabulate_one
from hingepair.plans.pairs import unit_among
from hingepair.tables.sheets import instant_text


class Deferred:
    """Base class of what computes values when they are first asked for, by cached properties. A pickle holds these
    values as far as they were computed, and nothing else: what computes them is the whole integration, and often a
    lambda.
    """

    def __getstate__(self) -> dict[str, Any]:
        kind = type(self)
        computed = {
            n: x for n, x in vars(self).items() if isinstance(getattr(kind, n, None), functools.cached_property)
        }
        return {"_is_copy": True, **computed}

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or "_is_copy" not in vars(self):
            raise AttributeError(f"{type(self).__name__} has no {name!r}")
        raise ArgumentError("motion", "estimates and energy balance computed before the motion was pickled", "none")

    def __deepcopy__(self, _: Any) -> Self:
        return self


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Trajectory(Frozen, Result):
    """The motion of a pair over time, as `integrate` returns it (E12). All attributes of its `state`, such as R2, S2
    and v2, are also attributes of the trajectory.

    Attributes:
        t: the instants [s]; shape (N,).
        psi: hinge angle [rad]; shape (N,).
        quat_wxyz: attitude of body 1, body to world, as unit quaternions with the scalar first and without jumps of
            sign; shape (N, 4).
        R1: position of the reference point of body 1, world axes [m]; shape (N, 3).
        state: the PairState at the instants.
        pair: the HingePair.
        method: name of the integration method, such as "magnus6".
        steps: number of integration steps.
    """

    __signature__ = (
        Signature()
    )  # only `integrate` calls it; the private fields are no part of the documented signature

    t: NDArray[np.float64]
    psi: NDArray[np.float64]
    quat_wxyz: NDArray[np.float64]
    R1: NDArray[Any]
    state: PairState
    pair: HingePair
    method: str
    steps: int
    _solution: Any = None  # which tells the errors

    @property
    def described(self) -> str:
        """How the motion was computed, such as "motion by magnus6"."""
        return f"motion by {self.method}"

    def unit(self, name: str) -> str:
        """Return the unit of an output, or of one of its components such as R2_x or tip_x."""
        return unit_among(self.state.outputs, name)

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by name, the instants on the first axis: the outputs that were computed, R1, S1, psi."""
        return {**self.state.arrays(), "R1": self.R1, "S1": self.S1, "psi": self.psi}

    @property
    def error_estimate(self) -> float:
        """Estimate of the largest error of the attitude of body 1 at any instant, as an angle [rad], with
        rounding. It is computed at the first access.

        Where rates are smooth, it differs from the actual error by a few per cent. The result of each step is
        compared with that of steps of half its length or less. Of a callable that jumps or has a kink, the estimate
        is hardly ever below half of the actual error, and seldom above ten times it; a pulse that is shorter than
        about 1/500 of the total time may be missed.

        Of samples, it includes the error of interpolation, from how the motion differs from that of every second and
        every fourth sample. It is NaN for fewer than 4 samples. It does not include noise, rounded time stamps, nor
        motion that leaves no trace in the samples.
        """
        return self._solution.error  # type: ignore[no-any-return]

    @property
    def psi_error_estimate(self) -> float:
        """Estimate of the largest error of psi at any instant [rad], as `error_estimate`."""
        return self._solution.psi_error  # type: ignore[no-any-return]

    def __getattr__(self, name: str) -> Any:
        state = object.__getattribute__(self, "state")
        if not name.startswith("_") and hasattr(type(state), name):
            return getattr(state, name)
        raise missing_attribute_error(self, name)

    def __repr__(self) -> str:
        counts = f"steps={self.steps}, {describe_instants(self.t)}"
        return f"{type(self).__name__}({self.method}, {counts}, outputs=({', '.join(self.state.outputs)}))"

    def _available_names(self) -> Iterable[str]:
        return dir(object.__getattribute__(self, "state"))

    @property
    def quat_xyzw(self) -> NDArray[np.float64]:
        """Attitude of body 1, body to world, as unit quaternions with the scalar last; shape (N, 4)."""
        return self.quat_wxyz[..., [1, 2, 3, 0]]

    @property
    def S1(self) -> NDArray[Any]:
        """Attitude of body 1, body to world; shape (N, 3, 3). Unless S1 is an output, it is computed at each
        access.
        """
        S1 = self.state.arrays().get("S1")
        if S1 is not None:
            return S1
        return read_only(quaternions_to_matrices(self.quat_wxyz))


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PlanarTrajectory(Trajectory):
    """The motion of a planar pair over time, as `integrate` returns it (E11, E12): a `Trajectory` whose R1 and
    outputs, such as R2 and phi2, are those of the `PlanarState`, with two components.

    Attributes:
        phi: angle of body 1 [rad], with its turns; shape (N,).
    """

    phi: NDArray[np.float64]
    state: PlanarState  # type: ignore[assignment]
    pair: PlanarPair  # type: ignore[assignment]

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by name, the instants on the first axis: the outputs that were computed, R1, phi, psi."""
        return {**self.state.arrays(), "R1": self.R1, "phi": self.phi, "psi": self.psi}


def describe_instants(t: NDArray[np.float64]) -> str:
    """Return text on instants.

    >>> describe_instants(np.linspace(0, 2, 5))
    'samples=5, t=0..2'
    """
    return f"samples={len(t)}, t={instant_text(t[0])}..{instant_text(t[-1])}" if len(t) else "samples=0"


def quaternions_to_matrices(quat_wxyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotations (..., 3, 3) of unit quaternions, scalar first, orthonormal to 4 unit roundoffs."""
    parts = {"q": components_of(quat_wxyz)}
    return tabulate_one(
        lambda v: _orthonormalized(eq.quaternion_attitude(v["q"])), parts, (3, 3), np.dtype(np.float64)
    )


def _orthonormalized(S: eq.Matrix) -> eq.Matrix:
    """Return S + S (I - S^T S) / 2, which is orthonormal up to rounding if S is nearly so."""
    x, y, z = S[0::3], S[1::3], S[2::3]
    a, b, c = (0.5 - 0.5 * eq.dot(column, column) for column in (x, y, z))
    d, e, f = (-0.5 * eq.dot(*columns) for columns in ((x, y), (y, z), (z, x)))
    correction = eq.compose(S, (a, d, f, d, b, e, f, e, c))
    return tuple(s + r for s, r in zip(S, correction, strict=True))


def rotate_to_world(S1: NDArray[Any], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert vectors (..., 3) from axes of body 1 to world axes."""
    parts = {"S1": components_of(S1, 2), "w": components_of(vectors)}
    return tabulate_one(lambda v: eq.rotate(v["S1"], v["w"]), parts, (3,), np.dtype(np.float64))


def unwrap_euler_angles(phi: NDArray[Any]) -> NDArray[np.float64]:
    """Return Euler angles (..., N, 3) of the same attitudes, continuous from sample to sample, of a sequence whose
    axes differ.

    (a, b, c) and (a + pi, pi - b, c + pi) are one attitude.
    To exchange both of two neighbours does not change their distance, so that each pair of neighbours is decided on
    its own: stay, or change to the other triple.
    """
    other = np.stack([phi[..., 0] + np.pi, np.pi - phi[..., 1], phi[..., 2] + np.pi], axis=-1)
    before = phi[..., :-1, :]
    steps = (np.remainder(kind[..., 1:, :] - before + np.pi, 2 * np.pi) - np.pi for kind in (phi, other))
    stay, change = (np.abs(step).sum(axis=-1) for step in steps)
    first = np.zeros((*phi.shape[:-2], 1), int)
    changed = np.concatenate([first, np.cumsum(change < stay, axis=-1)], axis=-1) % 2 == 1
    return np.unwrap(np.where(changed[..., None], other, phi), axis=-2)
