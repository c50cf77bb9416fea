"""The motion of a scene at some instants: coordinates of joints, and the motion of body 1 or of a base.

A pair has one joint, psi; its body 1 is the base.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_of_rotations
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import motion_in_space
from hingepair.numeric.arrays import Float64Array
from hingepair.plans.pairs import PLANE, SPACE
from hingepair.rotations.matrices import matrix_to_quaternion

Rows: TypeAlias = slice | NDArray[np.intp]
"""Indices of some of the instants."""
Derivatives: TypeAlias = tuple[tuple[Any, ...], ...]
"""Values, rates and accelerations as far as known: a tuple each, of arrays, or floats for what does not change."""

RATE_SUFFIXES: Final = ("", "d", "dd")
"""Suffixes of a joint's name in columns, by the order of the derivative."""
PSI: Final = ("psi",)
"""The joint of a pair."""
_CARRIER: Final = HingePair((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))  # only its body 1 counts
_LETTERS: Final = ("R", "S", "v", "omega", "a", "alpha")


class EulerBase(NamedTuple):
    """Motion of body 1 or of a base by x, y, z and three Euler angles, or in the plane by x, y, phi."""

    derivatives: Derivatives
    #: Euler sequence such as "XYZ"; None in the plane
    sequence: str | None

    def body(self, count: int) -> BodyMotion:
        """Return this motion as a BodyMotion in space, shape (count,)."""
        q, *rates = ((*row, 0.0) for row in self.derivatives)
        if not any(isinstance(value, np.ndarray) for value in q):
            q = (np.full(count, q[0]), *q[1:])  # an array shows the number of instants
        if self.sequence is None:
            body, *_ = motion_in_space(q, *rates)
            found: BodyMotion = body
            return found
        names = ("R1", "S1", "v1", "omega1", "a1", "alpha1")[: 2 * len(self.derivatives)]
        arrays = _CARRIER.forward_kinematics(q, *rates, outputs=names, sequence=self.sequence).arrays()
        return motion_of_rotations(**{name[:-1]: array for name, array in arrays.items()})


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """Motion at some instants, as far as its derivatives are known."""

    #: names of the joints, in order; psi of a pair
    names: tuple[str, ...]
    #: number of instants
    count: int
    #: coordinates of the joints
    joints: Derivatives
    #: motion of body 1 or of the base; None where it rests at the origin
    base: EulerBase | BodyMotion | None = None

    @property
    def level(self) -> int:
        """Order of the highest known derivative: 0, 1 or 2."""
        return len(self.joints) - 1

    @property
    def sequence(self) -> str | None:
        """Euler sequence of the base; None if its attitude is not given by three Euler angles."""
        return self.base.sequence if isinstance(self.base, EulerBase) else None

    @property
    def derivatives(self) -> Derivatives:
        """All coordinates of a pair by Euler angles or in the plane: those of body 1, then psi."""
        base = self.base.derivatives if isinstance(self.base, EulerBase) else ()
        return tuple((*own, *joint) for own, joint in zip(base, self.joints, strict=False))

    @property
    def body1(self) -> BodyMotion:
        """Motion of body 1 or of the base in space; shape (count,)."""
        if self.base is None:
            still = np.zeros((self.count, 3))
            return motion_of_rotations(
                S=np.broadcast_to(np.eye(3), (self.count, 3, 3)),
                **dict.fromkeys([letter for letter in _LETTERS[: 2 * self.level + 2] if letter != "S"], still),
            )
        return self.base.body(self.count) if isinstance(self.base, EulerBase) else self.base

    @property
    def base_motion(self) -> BodyMotion | None:
        """What methods of a Mechanism take as `base_motion`."""
        return None if self.base is None else self.body1

    @property
    def hinge(self) -> tuple[Float64Array, ...]:
        """(psi[, psi'[, psi'']]) of a pair; shape (count,) each."""
        return tuple(self.column(order, 0) for order in range(self.level + 1))

    @property
    def psi(self) -> Float64Array:
        """The hinge angle of a pair; shape (count,) rad."""
        return self.column(0, 0)

    def column(self, order: int, joint: int) -> Float64Array:
        """Return the coordinate (`order` 0) of the joint with the index `joint`, or its derivative, (count,)."""
        return np.broadcast_to(np.asarray(self.joints[order][joint], dtype=np.float64), (self.count,))

    def array(self, order: int) -> Float64Array:
        """Return the coordinates (`order` 0) of all joints, or their derivatives; shape (count, dof)."""
        columns = [self.column(order, joint) for joint in range(len(self.names))]
        return np.stack(columns, axis=-1) if columns else np.zeros((self.count, 0))

    def part(self, rows: Rows, order: int) -> Known:
        """Return the motion at the instants with the indices `rows`, with the known derivatives up to `order`."""
        count = len(range(*rows.indices(self.count))) if isinstance(rows, slice) else rows.size
        base = self.base
        if isinstance(base, EulerBase):
            base = base._replace(derivatives=_rows_of(base.derivatives, rows, order))
        elif base is not None:
            letters = _LETTERS[: 2 * (min(order, self.level) + 1)]
            base = motion_of_rotations(**{letter: np.asarray(getattr(base, letter))[rows] for letter in letters})
        return replace(self, count=count, joints=_rows_of(self.joints, rows, order), base=base)

    def arguments(self) -> tuple[Any, ...]:
        """Return (q[, qd[, qdd]]) as methods of Mechanism take them: dicts by joint name, with an array for each
        joint or a float for one that does not move; arrays (count, 0) of a robot without joints.
        """
        if not self.names:
            return tuple(np.zeros((self.count, 0)) for _ in self.joints)
        rows = [dict(zip(self.names, values, strict=True)) for values in self.joints]
        if not any(np.ndim(value) for value in rows[0].values()):
            rows[0][self.names[0]] = self.column(0, 0)  # an array shows the number of instants
        return tuple(rows)

    def coordinates(self) -> dict[str, Float64Array]:
        """Return the coordinates that results record beside the outputs, by name; shape (count,) each."""
        base = self.base_columns(0) if isinstance(self.base, EulerBase) and self.names == PSI else {}
        return base | self.joint_columns(0)

    def joint_columns(self, order: int) -> dict[str, Float64Array]:
        """Return the coordinates of the joints, or their derivatives, as columns of a log by name."""
        return {name + RATE_SUFFIXES[order]: self.column(order, i) for i, name in enumerate(self.names)}

    def base_columns(self, order: int) -> dict[str, Float64Array]:
        """Return the columns of a log that give body 1: Euler angles, or position and quaternion, or their rates."""
        if isinstance(self.base, EulerBase):
            kind = SPACE if self.base.sequence else PLANE
            names, values = (*kind.columns.values(),)[order], self.base.derivatives[order]
            return {
                name: np.broadcast_to(np.asarray(value, np.float64), (self.count,))
                for name, value in zip(names[:-1], values, strict=True)
            }
        place, turning = (("R1", "S1"), ("v1", "omega1"), ("a1", "alpha1"))[order]
        arrays = {name: getattr(self.body1, name[:-1]) for name in ((place, turning) if order else (place,))}
        columns = {
            f"{name}_{letter}" if order else letter: column
            for name, array in arrays.items()
            for letter, column in zip("xyz", np.asarray(array).T, strict=True)
        }
        return columns | ({} if order else quaternion_columns(self.body1.S))


def quaternion_columns(S: NDArray[Any] | None, before: str = "q", behind: str = "") -> dict[str, Float64Array]:
    """Return the quaternions (w >= 0) of rotation matrices (N, 3, 3) as columns such as qx, qy, qz, qw, (N,)."""
    w, x, y, z = matrix_to_quaternion(np.asarray(S, dtype=np.float64)).T
    return {f"{before}{letter}{behind}": column for letter, column in zip("xyzw", (x, y, z, w), strict=True)}


def _rows_of(derivatives: Derivatives, rows: Rows, order: int) -> Derivatives:
    return tuple(
        tuple(value[rows] if isinstance(value, np.ndarray) else value for value in values)
        for values in derivatives[: order + 1]
    )
