"""What integration gives: the attitudes and the hinge angle at the instants, and the state of the pair."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from inspect import Signature
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.results import missing_attribute_error
from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import Frozen, check_choice, read_only
from hingepair.numeric.blocks import components_of, tabulate_one
from hingepair.numeric.tables import instant
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.results import Result
from hingepair.pair.states import PairState, PlanarState
from hingepair.rotations.euler import matrix_to_euler
from hingepair.rotations.sequences import SEQUENCES


class Later:
    """A number to be worked out; call it. Copies and pickles hold the number.

    >>> later = Later(lambda: 6.0 * 7)
    >>> later()
    42.0
    """

    __slots__ = ("_number", "_work")

    def __init__(self, work: Callable[[], float] | None, number: float = 0.0) -> None:
        self._work = work
        self._number = number

    def __call__(self) -> float:
        """The number."""
        work = self._work
        if work is not None:  # two threads may both come here, and find the same number
            self._number = float(work())
            self._work = None
        return self._number

    @property
    def known(self) -> bool:
        """Whether the number has been worked out already."""
        return self._work is None

    def __reduce__(self) -> tuple[type[Later], tuple[None, float]]:
        return Later, (None, self())


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class _OfState(Frozen, Result):
    """The fields of the state as attributes."""

    __signature__ = Signature()  # `integrate` makes it, of more than its readers need to know

    t: NDArray[np.float64]
    psi: NDArray[np.float64]
    method: str
    steps: int
    _error: Later
    _psi_error: Later

    @property
    def described(self) -> str:
        """The method."""
        return f"motion by {self.method}"

    def recorded(self) -> dict[str, NDArray[Any]]:
        """The outputs of the state, the motion of body 1 and the hinge angle, by name; shape (N, ...)."""
        own = ("R1", "S1", "psi") if isinstance(self, Trajectory) else ("phi", "psi")
        return {**self.state.arrays(), **{name: getattr(self, name) for name in own}}

    @property
    def error_estimate(self) -> float:
        """Error of the attitude of body 1, or of its angle phi, at the worst instant [rad], rounding included.

        `psi_error_estimate` is that of psi. The estimate is computed when it is first asked for. It is within a few
        per cent of the error where the rates are smooth and rounding is small; where a callable jumps or bends within
        a step, chance makes it a third of the error at worst, or ten times as large.

        Of a callable the errors of steps are measured by steps of half the length or less, and by how its values at
        the nodes and beside the instants may hide a jump or a kink between two of them. All steps are measured, or,
        of more than 65,536, those over which values change most abruptly and one of each part of the time. What is
        narrower than a 509th of the time and leaves no trace in such values is missed.

        Of samples the estimate counts what interpolation misses: gaps, motion that the samples hardly follow, jumps
        and kinks, which may be anywhere between two of them. It counts the rounding of stamps to doubles, single
        floats or decimals as far as the values are as rough as that makes them. It is NaN of fewer than four samples.
        Noise in what was given is not part of it, nor are stamps whose rounding drifts too slowly to be seen in so
        few samples, nor what happens in a gap or faster than two samples a period and leaves no trace in the samples.
        """
        return self._error()

    @property
    def psi_error_estimate(self) -> float:
        """Error of the hinge angle psi at the worst instant [rad], estimated in the same way."""
        return self._psi_error()

    def __getattr__(self, name: str) -> Any:
        state = object.__getattribute__(self, "state")
        if not name.startswith("_") and hasattr(type(state), name):
            return getattr(state, name)
        raise missing_attribute_error(self, name)

    def __repr__(self) -> str:
        t, method, steps, error = (object.__getattribute__(self, name) for name in ("t", "method", "steps", "_error"))
        known = f", error_estimate={error():.2g}" if error.known else ""
        names = ", ".join(object.__getattribute__(self, "state").outputs)
        return f"{type(self).__name__}({method}, steps={steps}, {span(t)}{known}, outputs=({names}))"

    def _named(self) -> Iterable[str]:
        return dir(object.__getattribute__(self, "state"))


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Trajectory(_OfState):
    """The motion of a pair that `integrate` found (E12); also has every attribute of its state (R2, S2, v2, ...).

    Attributes:
        t: the instants [s]; shape (N,).
        quat_wxyz: attitude of body 1, body to world, unit quaternions without a jump of sign; shape (N, 4).
        psi: hinge angle [rad]; shape (N,).
        R1: reference point of body 1, world axes [m]; shape (N, 3).
        state: the PairState at the instants.
        pair: the pair that moves.
        method: the method.
        steps: how many steps were made; 0 where SciPy chose them.
    """

    quat_wxyz: NDArray[np.float64]
    R1: NDArray[Any]
    state: PairState
    pair: HingePair

    @property
    def quat_xyzw(self) -> NDArray[np.float64]:
        """Attitude of body 1 with the scalar last; shape (N, 4)."""
        return np.roll(self.quat_wxyz, -1, axis=-1)

    @property
    def S1(self) -> NDArray[Any]:
        """Rotation of body 1, body to world; shape (N, 3, 3)."""
        found = self.state.S1
        return read_only(rotations(self.quat_wxyz)) if found is None else found

    def euler_angles(self, body: int, sequence: str = "XYZ") -> NDArray[np.float64]:
        """Euler angles phi_1(t) or phi_2(t), continuous in time, through gimbal lock too.

        Of the two triples that give the same attitude, and of their whole turns, each instant has those nearest to
        the instant before: instants must be close enough for less than half a turn between them.

        Args:
            body: 1 or 2; the second needs S2 among the outputs.
            sequence: one of 24, as SciPy writes them; angles in the order of its letters.

        Returns:
            Angles [rad]; shape (N, 3).

        Raises:
            ArgumentError: another body, an unknown sequence, or S2 was not computed.
        """
        check_choice("sequence", sequence, SEQUENCES)
        if body not in {1, 2}:
            raise ArgumentError("body", "1 or 2", quoted(body))
        S = self.S1 if body == 1 else self.state.S2
        if S is None:
            raise ArgumentError("body", "1, or S2 among the outputs", body)
        return continuous(matrix_to_euler(S, sequence), proper=sequence[0] == sequence[2])


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PlanarTrajectory(_OfState):
    """The motion of a planar pair that `integrate` found (E11, E12); also has every attribute of its state.

    Attributes:
        t: the instants [s]; shape (N,).
        phi: angle of body 1 [rad]; shape (N,). That of body 2 is `phi2`.
        psi: hinge angle [rad]; shape (N,).
        state: the PlanarState at the instants.
        method: the method.
        steps: how many steps were made.
    """

    phi: NDArray[np.float64]
    state: PlanarState


def span(t: NDArray[np.float64]) -> str:
    """How many instants, and from when to when, for a reader.

    >>> span(np.linspace(0, 2, 5))
    'samples=5, t=0..2'
    """
    return f"samples={len(t)}, t={instant(t[0])}..{instant(t[-1])}" if len(t) else "samples=0"


def rotations(quat_wxyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrices of unit quaternions, shape (N, 3, 3), orthonormal to 4 u."""
    parts = {"q": components_of(quat_wxyz)}
    return tabulate_one(lambda v: _mended(eq.quaternion_attitude(v["q"])), parts, (3, 3), np.dtype(np.float64))


def _mended(S: eq.Matrix) -> eq.Matrix:
    """S + S (I - S^T S) / 2: S without what rounding made of its lengths and right angles; it is not turned."""
    x, y, z = S[0::3], S[1::3], S[2::3]
    a, b, c = (0.5 - 0.5 * eq.dot(column, column) for column in (x, y, z))
    d, e, f = (-0.5 * eq.dot(*columns) for columns in ((x, y), (y, z), (z, x)))
    rest = eq.compose(S, (a, d, f, d, b, e, f, e, c))
    return tuple(s + r for s, r in zip(S, rest, strict=True))


def world_vectors(S1: NDArray[Any], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors from body 1's axes to the world's."""
    parts = {"S1": components_of(S1, 2), "w": components_of(vectors)}
    return tabulate_one(lambda v: eq.rotate(v["S1"], v["w"]), parts, (3,), np.dtype(np.float64))


def continuous(phi: NDArray[Any], *, proper: bool) -> NDArray[np.float64]:
    """Euler angles (N, 3) made continuous.

    (a, b, c) and (a + pi, pi - b, c + pi), or (a + pi, -b, c + pi) where the first axis comes back, are one attitude.
    Both members of a pair of neighbours can be exchanged without changing how far they are apart, so that only the
    exchanges between neighbours are decided, all at once.
    """
    other = np.stack([phi[:, 0] + np.pi, (0.0 if proper else np.pi) - phi[:, 1], phi[:, 2] + np.pi], axis=-1)
    steps = (np.remainder(kind[1:] - phi[:-1] + np.pi, 2 * np.pi) - np.pi for kind in (phi, other))
    stay, change = (np.abs(step).sum(axis=1) for step in steps)
    changed = np.concatenate([[0], np.cumsum(change < stay)]) % 2 == 1
    chosen = np.where(changed[:, None], other, phi)
    return np.unwrap(chosen, axis=0)
