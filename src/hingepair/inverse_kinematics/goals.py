"""Goals: a position, an attitude or a direction of the z axis of a frame, the centre of mass. Each is a class that
gives its equations.

A target is a row of numbers, those of all goals in order.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from hingepair.engine.trace import arc_tangent, hypotenuse, square_root, where_less
from hingepair.equations.spatial import (
    IDENTITY_MATRIX,
    ZERO_VECTOR,
    Scalar,
    Vector,
    add,
    compose,
    cross,
    dot,
    rotate,
    scale,
    subtract,
    transpose,
)
from hingepair.equations.trees import Pose
from hingepair.numeric.arrays import Float64Array
from hingepair.plans.trees import TreeQuantities

_MAX_DISTANCE = 10.0  # from a target, in reaches of the robot; beyond, the direction alone counts


class Place(NamedTuple):
    """Where a goal's frame is, and how it moves."""

    pose: Pose
    moves: list[list[Any]]  # the six rows of its Jacobian, by q


class Approach(NamedTuple):
    """Equations that a goal adds to a step: rows @ change = error, in the least squares sense."""

    rows: list[Any]  # of the Jacobian, weighted
    error: list[Any]  # weighted as the rows
    misfit: Scalar  # square of the weighted error
    unmet: Scalar  # 0 within the tolerance, otherwise 1


@dataclass(frozen=True)
class Goal(ABC):
    """Kind of target, without the target's numbers."""

    frame: int  # index of the frame in the request
    seen_from: int | None = None  # index of the frame in whose axes the target is given; None: in those of the base
    shape: ClassVar[tuple[int, ...]]  # of a target
    is_length: ClassVar[bool]  # whether its error is a distance [m], not an angle [rad]
    rank: ClassVar[int] = 3  # how many coordinates it determines
    error_name: ClassVar[str]  # the result that has its error

    @property
    def size(self) -> int:
        """Count of numbers of a target."""
        return int(np.prod(self.shape))

    @property
    def frames(self) -> tuple[int, ...]:
        """Indices of the frames on which it depends."""
        return (self.frame,) if self.seen_from is None else (self.frame, self.seen_from)

    def place(self, found: TreeQuantities, jacobian: Sequence[Any]) -> Place:
        """Return the place that is compared with a target; `jacobian` is that of all frames, row by row."""
        own = self._place_of(self.frame, found, jacobian)
        if self.seen_from is None:
            return own
        other = self._place_of(self.seen_from, found, jacobian)
        back, offset = transpose(other.pose.S), subtract(own.pose.d, other.pose.d)
        columns = []
        for one, two in zip(zip(*own.moves, strict=True), zip(*other.moves, strict=True), strict=True):
            turn = _vector(two[3:])
            linear = subtract(subtract(_vector(one[:3]), _vector(two[:3])), cross(turn, offset))
            columns.append((*rotate(back, linear), *rotate(back, subtract(_vector(one[3:]), turn))))
        pose = Pose(compose(back, own.pose.S), rotate(back, offset), ZERO_VECTOR)
        return Place(pose, [list(row) for row in zip(*columns, strict=True)])

    @staticmethod
    def _place_of(frame: int, found: TreeQuantities, jacobian: Sequence[Any]) -> Place:
        n = found.form.dof
        rows = [list(jacobian[i * n : (i + 1) * n]) for i in range(6 * frame, 6 * frame + 6)]
        return Place(found.frame_poses[frame], rows)

    @abstractmethod
    def pose(self, frame: Pose) -> tuple[Scalar, ...]:
        """Return what is compared with a target, in its order."""

    @abstractmethod
    def error(self, frame: Pose, target: Sequence[Any]) -> Scalar:
        """Return the distance [m] or the angle [rad] from a target."""

    @abstractmethod
    def approach(self, frame: Pose, moves: list[Any], target: Sequence[Any], weight: Any, tolerance: Any) -> Approach:
        """Return what a step towards a target needs; `moves` are the six rows of the place's Jacobian."""

    @abstractmethod
    def comparable(self, values: Float64Array, reach: float) -> Float64Array:
        """Return targets or poses (..., size) as numbers within (-1, 1), whatever their unit."""


class Position(Goal):
    """Goal that the origin of the frame is at a point."""

    shape = (3,)
    is_length = True
    error_name = "position_error"

    def pose(self, frame: Pose) -> tuple[Scalar, ...]:
        """Return the origin."""
        return tuple(frame.d)

    def error(self, frame: Pose, target: Sequence[Any]) -> Scalar:
        """Return the distance."""
        return _length(subtract(_vector(target), frame.d))

    def approach(self, frame: Pose, moves: list[Any], target: Sequence[Any], weight: Any, tolerance: Any) -> Approach:
        """Return the equations of the offset, which is shortened to `_MAX_DISTANCE` reaches."""
        offset = subtract(_vector(target), frame.d)
        distance = _length(offset)
        far = distance * weight
        near = where_less(far, _MAX_DISTANCE, far, _MAX_DISTANCE)
        # A target at 1e200 m must not overflow.
        error = scale(offset, weight * where_less(far, _MAX_DISTANCE, 1.0, _MAX_DISTANCE / far))
        rows = [[x * weight for x in row] for row in moves[:3]]
        return Approach(rows, [*error], near * near, where_less(distance, tolerance, 0.0, 1.0))

    def comparable(self, values: Float64Array, reach: float) -> Float64Array:
        """Return positions in units of 1.3 reaches; those beyond 1 are drawn towards the base."""
        with np.errstate(divide="ignore", under="ignore"):
            shrink = np.minimum(1.0, 1.3 * reach / np.abs(values).max(axis=1, initial=0.0))
        shares: Float64Array = values * shrink[:, None] / (1.3 * reach)
        return shares


class CentreOfMass(Position):
    """Goal that the centre of mass of the robot is at a point."""

    error_name = "centre_of_mass_error"

    @property
    def frames(self) -> tuple[int, ...]:
        """Return nothing: all bodies count."""
        return ()

    def place(self, found: TreeQuantities, jacobian: Sequence[Any]) -> Place:  # noqa: ARG002
        """Return the centre of mass with the axes of the base."""
        rows, n = found.centre_of_mass_jacobian(), found.form.dof
        moves = [list(rows[i * n : (i + 1) * n]) for i in range(3)]
        return Place(
            Pose(IDENTITY_MATRIX, found.centre_from_base, ZERO_VECTOR), [*moves, *([0.0] * n for _ in range(3))]
        )


class _Turned(Goal):
    """Base class of goals of the attitude, whose error is an angle."""

    is_length = False
    error_name = "angle_error"

    @abstractmethod
    def _turn(self, S: Sequence[Any], target: Sequence[Any]) -> tuple[Vector, Scalar, Scalar]:
        """Return the axis of the turn to a target, as long as the sine of the angle, and the sine and the cosine."""

    @abstractmethod
    def _rows(self, frame: Pose, moves: list[Any], turn: Vector) -> tuple[list[Any], list[Any]]:
        """Return the rows of angular velocity that change the error, and the turn along them."""

    def error(self, frame: Pose, target: Sequence[Any]) -> Scalar:
        """Return the angle."""
        _, sine, cosine = self._turn(frame.S, target)
        return arc_tangent(sine, cosine)

    def approach(self, frame: Pose, moves: list[Any], target: Sequence[Any], weight: Any, tolerance: Any) -> Approach:
        """Return the equations of a turn by the sine of the angle or, beyond a right angle, by 1 rad."""
        turn, sine, cosine = self._turn(frame.S, target)
        least = where_less(sine, 1e-9, 1e-9, sine)
        turn = scale(turn, weight * where_less(cosine, 0.0, 1.0 / least, 1.0))
        turns, error = self._rows(frame, moves, turn)
        rows = [[x * weight for x in row] for row in turns]
        unmet = where_less(off_axis(sine, cosine), tolerance, 0.0, 1.0)
        return Approach(rows, error, (1.0 - cosine) * (0.5 * weight * weight), unmet)

    def comparable(self, values: Float64Array, reach: float) -> Float64Array:  # noqa: ARG002
        """Return entries of rotations as they are."""
        return values


class Attitude(_Turned):
    """Goal that the frame has an attitude."""

    shape = (3, 3)

    def pose(self, frame: Pose) -> tuple[Scalar, ...]:
        """Return the rotation matrix row by row."""
        return tuple(frame.S)

    def _turn(self, S: Sequence[Any], target: Sequence[Any]) -> tuple[Vector, Scalar, Scalar]:
        """Return half the sum of the cross products of the axes, its length, and the cosine from the trace."""
        turn: Vector = (0.0, 0.0, 0.0)
        for c in range(3):
            turn = add(turn, cross((S[c], S[3 + c], S[6 + c]), (target[c], target[3 + c], target[6 + c])))
        turn = scale(turn, 0.5)
        # The trace alone would lose half of the digits of a small angle.
        cosine = (sum_of(S[k] * target[k] for k in range(9)) - 1.0) * 0.5
        return turn, square_root(dot(turn, turn)), cosine

    def _rows(self, frame: Pose, moves: list[Any], turn: Vector) -> tuple[list[Any], list[Any]]:  # noqa: ARG002
        return moves[3:], [*turn]


class Direction(_Turned):
    """Goal that the z axis of the frame has a direction; the turn about it is free."""

    shape = (3,)
    rank = 2

    def pose(self, frame: Pose) -> tuple[Scalar, ...]:
        """Return the z axis."""
        return tuple(frame.S[2::3])

    def _turn(self, S: Sequence[Any], target: Sequence[Any]) -> tuple[Vector, Scalar, Scalar]:
        z = _vector(S[2::3])
        turn = cross(z, _vector(target))
        return turn, square_root(dot(turn, turn)), dot(z, _vector(target))

    def _rows(self, frame: Pose, moves: list[Any], turn: Vector) -> tuple[list[Any], list[Any]]:
        axes = [_vector(frame.S[c::3]) for c in range(2)]  # a turn about z changes nothing
        rows = [[dot(axis, column) for column in zip(*moves[3:], strict=True)] for axis in axes]
        return rows, [dot(axis, turn) for axis in axes]


def target_slices(goals: Sequence[Goal]) -> Iterator[slice]:
    """Yield for each goal where its numbers stand in a target.

    >>> [*target_slices((Position(0), Direction(0), Attitude(1)))]
    [slice(0, 3, None), slice(3, 6, None), slice(6, 15, None)]
    """
    first = 0
    for goal in goals:
        yield slice(first, first + goal.size)
        first += goal.size


def target_size(goals: Sequence[Goal]) -> int:
    """Return the count of numbers of one target of all goals."""
    return sum(goal.size for goal in goals)


def off_axis(sine: Any, cosine: Any) -> Any:
    """Return a number that grows with an angle from 0 to pi: its sine up to pi/2, and 2 - sine beyond."""
    return where_less(cosine, 0.0, 2.0 - sine, sine)


def sum_of(parts: Any) -> Any:
    """Return the sum of at least one part, without adding them to 0."""
    first, *others = parts
    for part in others:
        first = first + part
    return first


def _vector(parts: Sequence[Any]) -> Vector:
    x, y, z = parts
    return x, y, z


def _length(v: Vector) -> Scalar:
    return hypotenuse(hypotenuse(v[0], v[1]), v[2])
