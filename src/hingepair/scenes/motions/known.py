"""Inputs that determine a pair's motion at some instants: its coordinates, or body 1's motion and the hinge angle.

Each kind answers the same calls, so that what computes, explains or checks a scene need not know which it has.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.pairs.accuracy import angular_rate_sizes, euler_rate_sizes
from hingepair.mechanism.pairs.planar_pair import motion_in_space
from hingepair.mechanism.states import PairState, PlanarState
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.plans.pairs import PLANE, SPACE, PairKind
from hingepair.rotations.matrices import matrix_to_quaternion, rotation_exp
from hingepair.scenes.instants import Rows

if TYPE_CHECKING:
    from hingepair.validation.report import CrossValidation

Derivatives: TypeAlias = tuple[tuple[Any, ...], ...]  # arrays, or floats for what does not change
HINGE_NAMES = ("psi", "psid", "psidd")
"""Names of the hinge angle [rad] and its derivatives [rad/s, rad/s^2]."""
_GIVEN = tuple(zip(("R1", "v1", "a1"), ("S1", "omega1", "alpha1"), HINGE_NAMES, strict=True))
"""By the order of the derivative, names of body 1's position and attitude and of the hinge angle."""
_POSES = ("R1", "S1", "R2", "S2")  # outputs of both bodies
_ANGULAR_VELOCITIES = ("omega1", "omega2")  # likewise


@dataclass(frozen=True, slots=True, eq=False)
class MotionByCoordinates:
    """Motion of a pair by its seven coordinates, or four in the plane."""

    #: number of instants
    count: int
    #: (q[, qd[, qdd]]), tuples of seven or four: arrays of shape (count,), floats for what does not change
    derivatives: Derivatives
    #: Euler sequence of body 1; None in the plane
    sequence: str | None

    @property
    def level(self) -> int:
        """Order of the highest known derivative: 0, 1 or 2."""
        return len(self.derivatives) - 1

    @property
    def psi(self) -> Float64Array:
        """The hinge angle; shape (count,) rad."""
        return self.hinge_angle(0)

    def hinge_angle(self, order: int) -> Float64Array:
        """Return psi, or its derivative of an order that is known; shape (count,) rad, rad/s, rad/s^2."""
        return self._column(order, -1)

    def coordinates(self) -> dict[str, Float64Array]:
        """Return the coordinates as a dict of arrays by name, shape (count,) each. Results record them beside the
        requested outputs.
        """
        return self.log_columns(0)

    def log_columns(self, order: int) -> dict[str, Float64Array]:
        """Return the coordinates (`order` 0) or their known derivatives of the given order as a dict of arrays, shape
        (count,) each, by the column names of a log.
        """
        names = tuple(self._kind.columns.values())[order]
        return {name: self._column(order, i) for i, name in enumerate(names)}

    def part(self, rows: Rows, order: int) -> MotionByCoordinates:
        """Return the MotionByCoordinates at the instants with the indices `rows`, with the known derivatives up to
        `order`.
        """
        kept = tuple(
            tuple(value[rows] if isinstance(value, np.ndarray) else value for value in values)
            for values in self.derivatives[: order + 1]
        )
        count = len(range(*rows.indices(self.count))) if isinstance(rows, slice) else rows.size
        return MotionByCoordinates(count, kept, self.sequence)

    def forward_kinematics(
        self, pair: Any, outputs: tuple[str, ...] | None, backend: str = "auto"
    ) -> PairState | PlanarState:
        """Compute outputs of a pair along the motion; return a PairState, in the plane a PlanarState. `outputs` are
        names of outputs, or None for all outputs of body 2 that the known derivatives allow. `backend` is "auto",
        "numpy" or "compiled".
        """
        state: PairState | PlanarState = pair.forward_kinematics(
            *self._of_many(), outputs=outputs, backend=backend, **self._sequence()
        )
        return state

    def cross_validate(self, pair: Any) -> CrossValidation:
        """Compare the pair's equations with Pinocchio along this motion; return a CrossValidation."""
        from hingepair.validation.cross_validate import cross_validate

        report: CrossValidation = cross_validate(pair, *self.derivatives, **self._sequence())
        return report

    def constant_names(self) -> tuple[str, ...]:
        """Return the names of the coordinates that are floats and so do not change."""
        return tuple(
            name
            for name, value in zip(self._kind.coordinates, self.derivatives[0], strict=True)
            if not _varies(value)
        )

    def in_space(self, pair: Any) -> MotionByBody1:
        """Return this motion of the pair in space as a MotionByBody1, with all known derivatives. A planar motion
        becomes a motion in the plane z = 0.
        """
        if not self.sequence:
            body1, *hinge = motion_in_space(*self._of_many())
            return MotionByBody1(body1, tuple(hinge))
        names = [name for part in _GIVEN[: self.level + 1] for name in part[:2]]
        arrays = self.forward_kinematics(pair, tuple(names)).arrays()
        return motion_by_body1(
            arrays | {part[2]: self._column(i, -1) for i, part in enumerate(_GIVEN[: self.level + 1])}
        )

    def body_arrays(self, pair: Any) -> dict[str, NDArray[Any]]:
        """Return R1, S1, R2, S2 of a pair as a dict of arrays in space. For a planar pair, they lie in the plane z =
        0. If first derivatives are known, add omega1, omega2, psid and W1, the size [rad/s] relative to which errors
        of omega1 are measured.
        """
        if self.sequence:
            arrays = self.forward_kinematics(pair, _POSES + _ANGULAR_VELOCITIES * bool(self.level)).arrays()
            if self.level:
                W1, _ = euler_rate_sizes(np.stack([self._column(1, i) for i in (3, 4, 5)], axis=-1))
                arrays |= {"psid": self._column(1, -1), "W1": np.asarray(W1)}
            return arrays
        body1, zero = self.in_space(pair).body1, np.zeros((self.count, 1))
        state_arrays = self.forward_kinematics(pair, None).arrays()
        arrays = {"R1": body1.R, "S1": body1.S, "R2": np.concatenate((state_arrays["R2"], zero), axis=-1)}
        arrays["S2"] = rotation_exp(np.concatenate((zero, zero, state_arrays["phi2"][:, None]), axis=-1))
        if body1.omega is not None:
            arrays |= {
                "omega1": body1.omega,
                "omega2": np.concatenate((zero, zero, state_arrays["omega2"][:, None]), axis=-1),
            }
            arrays |= {"psid": self._column(1, -1), "W1": np.abs(self._column(1, 2))}
        return arrays

    @property
    def _kind(self) -> PairKind:
        return SPACE if self.sequence else PLANE

    def _column(self, order: int, i: int) -> Float64Array:
        return np.broadcast_to(np.asarray(self.derivatives[order][i], dtype=np.float64), (self.count,))

    def _sequence(self) -> dict[str, Any]:
        return {"sequence": self.sequence} if self.sequence else {}

    def _of_many(self) -> Derivatives:
        """Return the derivatives with at least one coordinate as an array, which shows the number of instants."""
        q, *rates = self.derivatives
        return (q, *rates) if _varies(q) else ((np.full(self.count, q[0]), *q[1:]), *rates)


@dataclass(frozen=True, slots=True, eq=False)
class MotionByBody1:
    """Motion of a pair by the motion of body 1 in space and the hinge angle."""

    #: shape (count,); with v and omega where psi' is there, a and alpha where psi'' is
    body1: BodyMotion
    #: (psi[, psi'[, psi'']]); shape (count,) each
    hinge: tuple[Float64Array, ...]
    sequence: ClassVar[None] = None
    derivatives: ClassVar[Derivatives] = ()

    @property
    def level(self) -> int:
        """Order of the highest known derivative: 0, 1 or 2."""
        return len(self.hinge) - 1

    @property
    def psi(self) -> Float64Array:
        """The hinge angle; shape (count,) rad."""
        return self.hinge_angle(0)

    def hinge_angle(self, order: int) -> Float64Array:
        """Return psi, or its derivative of an order that is known; shape (count,) rad, rad/s, rad/s^2."""
        return read_only(self.hinge[order])

    def coordinates(self) -> dict[str, Float64Array]:
        """Return the hinge angle as a dict with the key psi, shape (count,). Results record it beside the requested
        outputs.
        """
        return {"psi": self.psi}

    def log_columns(self, order: int) -> dict[str, Float64Array]:
        """Return columns of a log as a dict of arrays, shape (count,) each: position, quaternion and psi for `order`
        0, velocities and psi' for 1, accelerations and psi'' for 2.
        """
        place, turning, angle = _GIVEN[order]
        body1_arrays = {place: getattr(self.body1, place[:-1])}
        if order:
            body1_arrays[turning] = getattr(self.body1, turning[:-1])
        columns = {
            f"{name}_{c}" if order else c: v
            for name, a in body1_arrays.items()
            for c, v in zip("xyz", a.T, strict=True)
        }
        attitude = {} if order else quaternion_columns(self.body1.S)
        return columns | attitude | {angle: self.hinge_angle(order)}

    def constant_names(self) -> tuple[str, ...]:
        """Return no names: constant inputs are not looked for in this kind of motion."""
        return ()

    def part(self, rows: Rows, order: int) -> MotionByBody1:
        """Return the MotionByBody1 at the instants with the indices `rows`, with the known derivatives up to
        `order`.
        """
        letters = ("R", "S", "v", "omega", "a", "alpha")[: 2 * min(order, self.level) + 2]
        arrays = {letter: getattr(self.body1, letter)[rows] for letter in letters}
        return MotionByBody1(BodyMotion(**arrays), tuple(angle[rows] for angle in self.hinge[: order + 1]))

    def forward_kinematics(self, pair: Any, outputs: tuple[str, ...] | None, backend: str = "auto") -> PairState:
        """Compute outputs of a pair along the motion; return a PairState. `outputs` are names of outputs, or None for
        all outputs of body 2 that the known derivatives allow. `backend` is "auto", "numpy" or "compiled".
        """
        state: PairState = pair.forward_kinematics_from_body1(
            self.body1, *self.hinge, outputs=outputs, backend=backend
        )
        return state

    def cross_validate(self, pair: Any) -> CrossValidation:
        """Compare the pair's equations with Pinocchio along this motion; return a CrossValidation."""
        from hingepair.validation.cross_validate import cross_validate

        return cross_validate(pair, self.body1, *self.hinge)

    def in_space(self, _: Any) -> MotionByBody1:
        """Return this motion unchanged; it is already in space."""
        return self

    def body_arrays(self, pair: Any) -> dict[str, NDArray[Any]]:
        """Return R1, S1, R2, S2 of a HingePair as a dict of arrays. If first derivatives are known, add omega1,
        omega2, psid and W1, the size [rad/s] relative to which errors of omega1 are measured.
        """
        if not self.level:
            return self.forward_kinematics(pair, _POSES).arrays()
        W1, _ = angular_rate_sizes(self.body1.omega)
        return self.forward_kinematics(pair, _POSES + _ANGULAR_VELOCITIES).arrays() | {
            "psid": self.hinge[1],
            "W1": np.asarray(W1),
        }


def quaternion_columns(S: NDArray[Any], digit: str = "") -> dict[str, Float64Array]:
    """Return the quaternions (qw >= 0) of rotation matrices (N, 3, 3) as columns qx, qy, qz, qw + `digit`, (N,)."""
    w, x, y, z = matrix_to_quaternion(np.asarray(S, dtype=np.float64)).T
    return {f"q{letter}{digit}": column for letter, column in zip("xyzw", (x, y, z, w), strict=True)}


KnownMotion: TypeAlias = MotionByCoordinates | MotionByBody1
"""The kinds, which answer the same calls."""


def motion_by_body1(array_by_name: Mapping[str, NDArray[Any]]) -> MotionByBody1:
    """Return the MotionByBody1 of arrays by name: R1, S1, psi and, as far as known, v1, omega1, psid, a1, alpha1,
    psidd. Its derivatives go up to the highest order of which all three arrays are present.
    """
    level = max(i for i, names in enumerate(_GIVEN) if array_by_name.keys() >= {*names})
    arrays = {name[:-1]: array_by_name[name] for names in _GIVEN[: level + 1] for name in names[:2]}
    return MotionByBody1(
        BodyMotion(**arrays),
        tuple(array_by_name[names[2]] for names in _GIVEN[: level + 1]),
    )


def _varies(group: Any) -> bool:
    return any(isinstance(value, np.ndarray) for value in (group if isinstance(group, tuple) else (group,)))
