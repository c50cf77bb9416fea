"""Inputs that determine a pair's motion at some instants: its coordinates, or body 1's motion and the hinge angle.

Each kind answers the same calls, so that what computes, explains or checks a scene need not know which it has.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.arrays import Float64Array
from hingepair.pair.accuracy import euler_rate_sizes, given_rate_sizes
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.planar_pair import motion_in_space
from hingepair.pair.states import PairState, PlanarState
from hingepair.plans.steps import COLUMN_NAMES, COORDINATES, PARTS, PLANAR_COORDINATES, PLANAR_ROW_STEPS, ROW_STEPS
from hingepair.rotations.matrices import matrix_to_quaternion, rotation_exp
from hingepair.scenes.instants import Rows

if TYPE_CHECKING:
    from hingepair.validation.report import CrossValidation

Derivatives: TypeAlias = tuple[tuple[Any, ...], ...]  # arrays, or floats for what does not change
DERIVATIVE_ORDINALS = ("first", "second")
"""Orders of the derivatives of the coordinates, in words."""
_PARTS = (("R1", "S1", "psi"), ("v1", "omega1", "psid"), ("a1", "alpha1", "psidd"))
"""A motion by that of body 1 and the hinge angle, and its derivatives."""
_BODY_OUTPUTS = ("R1", "S1", "R2", "S2", "omega1", "omega2")
"""Outputs of forward kinematics that describe both bodies: the first four are positions and attitudes."""


@dataclass(frozen=True, slots=True, eq=False)
class ByCoordinates:
    """Motion given by the seven coordinates, in the plane four, and by the derivatives that are known.

    Attributes:
        count: number of instants.
        derivatives: (q[, qd[, qdd]]), tuples of seven or four: arrays of shape (count,), floats for what does not
            change.
        sequence: Euler sequence of body 1; None in the plane.
    """

    count: int
    derivatives: Derivatives
    sequence: str | None

    @property
    def level(self) -> int:
        """The highest derivative that is known."""
        return len(self.derivatives) - 1

    @property
    def psi(self) -> Float64Array:
        """The hinge angle; shape (count,) rad."""
        return self.hinge_angle(0)

    def hinge_angle(self, order: int) -> Float64Array:
        """Return psi, or its derivative of an order that is known; shape (count,) rad, rad/s, rad/s^2."""
        return self._column(order, -1)

    def coordinates(self) -> dict[str, Float64Array]:
        """Return what is kept beside all outputs: the coordinates by name; shape (count,) each."""
        return self.logged(0)

    def logged(self, order: int) -> dict[str, Float64Array]:
        """Return the coordinates, or their derivatives of an order that is known, by the names that a log has."""
        names = tuple(COLUMN_NAMES[self._names].values())[order]
        return {name: self._column(order, i) for i, name in enumerate(names)}

    def part(self, rows: Rows, order: int) -> ByCoordinates:
        """Return the motion at some of the instants, with the derivatives up to an order."""
        kept = tuple(
            tuple(value[rows] if isinstance(value, np.ndarray) else value for value in values)
            for values in self.derivatives[: order + 1]
        )
        count = len(range(*rows.indices(self.count))) if isinstance(rows, slice) else rows.size
        return ByCoordinates(count, kept, self.sequence)

    def forward_kinematics(
        self, pair: Any, outputs: tuple[str, ...] | None, backend: str = "auto"
    ) -> PairState | PlanarState:
        """Compute the state of the pair: all of body 2 that the derivatives allow unless outputs are named."""
        found: PairState | PlanarState = pair.forward_kinematics(
            *self._of_many(), outputs=outputs, backend=backend, **self._sequence()
        )
        return found

    def cross_validate(self, pair: Any) -> CrossValidation:
        """Compare the equations with Pinocchio."""
        from hingepair.validation.cross_validate import cross_validate

        report: CrossValidation = cross_validate(pair, *self.derivatives, **self._sequence())
        return report

    def constant(self) -> frozenset[str]:
        """Return the names of the coordinates, and of the inputs of a plan, that do not depend on t."""
        given = dict(zip(PARTS, self.derivatives, strict=False))
        values = dict(zip(self._names, self.derivatives[0], strict=True))
        for part, take, (name,) in ROW_STEPS if self.sequence else PLANAR_ROW_STEPS:
            if name in given:
                values[part] = take(given[name])
        return frozenset(name for name, value in values.items() if not _varies(value))

    def in_space(self, pair: Any) -> ByBody1:
        """Return the motion of body 1 in space and of the hinge, with the derivatives that are known."""
        if not self.sequence:
            body1, *hinge = motion_in_space(*self._of_many())
            return ByBody1(body1, tuple(hinge))
        names = [name for part in _PARTS[: self.level + 1] for name in part[:2]]
        known = self.forward_kinematics(pair, tuple(names)).arrays()
        return by_body1(known | {part[2]: self._column(i, -1) for i, part in enumerate(_PARTS[: self.level + 1])})

    def bodies(self, pair: Any) -> dict[str, NDArray[Any]]:
        """Compute R1, S1, R2, S2 in space and, of a motion with rates, omega1, omega2, psid, W1 (scale of omega1)."""
        if self.sequence:
            found = self.forward_kinematics(pair, _BODY_OUTPUTS if self.level else _BODY_OUTPUTS[:4]).arrays()
            if self.level:
                W1, _ = euler_rate_sizes(np.stack([self._column(1, i) for i in (3, 4, 5)], axis=-1))
                found |= {"psid": self._column(1, -1), "W1": np.asarray(W1)}
            return found
        body1, zero = self.in_space(pair).body1, np.zeros((self.count, 1))
        a = self.forward_kinematics(pair, None).arrays()
        found = {"R1": body1.R, "S1": body1.S, "R2": np.concatenate((a["R2"], zero), axis=-1)}
        found["S2"] = rotation_exp(np.concatenate((zero, zero, a["phi2"][:, None]), axis=-1))
        if body1.omega is not None:
            found |= {"omega1": body1.omega, "omega2": np.concatenate((zero, zero, a["omega2"][:, None]), axis=-1)}
            found |= {"psid": self._column(1, -1), "W1": np.abs(self._column(1, 2))}
        return found

    @property
    def _names(self) -> tuple[str, ...]:
        return COORDINATES if self.sequence else PLANAR_COORDINATES

    def _column(self, order: int, i: int) -> Float64Array:
        return np.broadcast_to(np.asarray(self.derivatives[order][i], dtype=np.float64), (self.count,))

    def _sequence(self) -> dict[str, Any]:
        return {"sequence": self.sequence} if self.sequence else {}

    def _of_many(self) -> Derivatives:
        """Return the derivatives with at least one coordinate as an array, which shows the number of instants."""
        q, *rates = self.derivatives
        return (q, *rates) if _varies(q) else ((np.full(self.count, q[0]), *q[1:]), *rates)


@dataclass(frozen=True, slots=True, eq=False)
class ByBody1:
    """The motion of body 1 by its attitude, and the hinge angle, with as many derivatives as are known.

    Attributes:
        body1: shape (count,); with v and omega where psi' is there, a and alpha where psi'' is.
        hinge: (psi[, psi'[, psi'']]); shape (count,) each.
    """

    body1: BodyMotion
    hinge: tuple[Float64Array, ...]
    sequence: ClassVar[None] = None
    derivatives: ClassVar[Derivatives] = ()

    @property
    def level(self) -> int:
        """The highest derivative that is known."""
        return len(self.hinge) - 1

    @property
    def psi(self) -> Float64Array:
        """The hinge angle; shape (count,) rad."""
        return self.hinge_angle(0)

    def hinge_angle(self, order: int) -> Float64Array:
        """Return psi, or its derivative of an order that is known; shape (count,) rad, rad/s, rad/s^2."""
        return self.hinge[order]

    def coordinates(self) -> dict[str, Float64Array]:
        """Return what is kept beside all outputs: the hinge angle by name; shape (count,)."""
        return {"psi": self.hinge[0]}

    def logged(self, order: int) -> dict[str, Float64Array]:
        """Return position, quaternion and hinge angle, or the rates of an order that is known, as a log has them."""
        place, turning, angle = _PARTS[order]
        own = {place: getattr(self.body1, place[:-1])}
        if order:
            own[turning] = getattr(self.body1, turning[:-1])
        found = {f"{name}_{c}" if order else c: v for name, a in own.items() for c, v in zip("xyz", a.T, strict=True)}
        attitude = {} if order else quaternion_columns(self.body1.S)
        return found | attitude | {angle: self.hinge[order]}

    def constant(self) -> frozenset[str]:
        """Return no name: inputs that do not depend on t are not looked for."""
        return frozenset()

    def part(self, rows: Rows, order: int) -> ByBody1:
        """Return the motion at some of the instants, with the derivatives up to an order."""
        letters = ("R", "S", "v", "omega", "a", "alpha")[: 2 * min(order, self.level) + 2]
        arrays = {letter: getattr(self.body1, letter)[rows] for letter in letters}
        return ByBody1(BodyMotion(**arrays), tuple(angle[rows] for angle in self.hinge[: order + 1]))

    def forward_kinematics(self, pair: Any, outputs: tuple[str, ...] | None, backend: str = "auto") -> PairState:
        """Compute the state of the pair: all of body 2 that the derivatives allow unless outputs are named."""
        found: PairState = pair.forward_kinematics_from_body1(
            self.body1, *self.hinge, outputs=outputs, backend=backend
        )
        return found

    def cross_validate(self, pair: Any) -> CrossValidation:
        """Compare the equations with Pinocchio."""
        from hingepair.validation.cross_validate import cross_validate_from_body1

        return cross_validate_from_body1(pair, self.body1, *self.hinge)

    def in_space(self, _: Any) -> ByBody1:
        """Return this motion."""
        return self

    def bodies(self, pair: Any) -> dict[str, NDArray[Any]]:
        """Compute R1, S1, R2, S2 and, of a motion with rates, omega1, omega2, psid and W1 (scale of omega1)."""
        if not self.level:
            return self.forward_kinematics(pair, _BODY_OUTPUTS[:4]).arrays()
        W1, _ = given_rate_sizes(self.body1.omega)
        return self.forward_kinematics(pair, _BODY_OUTPUTS).arrays() | {"psid": self.hinge[1], "W1": np.asarray(W1)}


def quaternion_columns(S: NDArray[Any], digit: str = "") -> dict[str, Float64Array]:
    """Return the unit quaternions of rotations as columns qx, qy, qz, qw with the digit of the body; qw >= 0."""
    w, x, y, z = matrix_to_quaternion(np.asarray(S, dtype=np.float64)).T
    return {f"q{letter}{digit}": column for letter, column in zip("xyzw", (x, y, z, w), strict=True)}


KnownMotion: TypeAlias = ByCoordinates | ByBody1
"""The kinds, which answer the same calls."""


def by_body1(known: Mapping[str, NDArray[Any]]) -> ByBody1:
    """Return the motion by R1, S1 and psi, with the derivatives that position, attitude and psi all have."""
    level = max(i for i, names in enumerate(_PARTS) if known.keys() >= {*names})
    arrays = {name[:-1]: known[name] for names in _PARTS[: level + 1] for name in names[:2]}
    return ByBody1(BodyMotion(**arrays), tuple(known[names[2]] for names in _PARTS[: level + 1]))


def _varies(group: Any) -> bool:
    return any(isinstance(value, np.ndarray) for value in (group if isinstance(group, tuple) else (group,)))
