"""Closed form of the motion of one frame of a robot: E2, E5 and E7 from joint to joint.

Consecutive joints whose axes are parallel make one group: within it attitudes are rotations about one axis by sums of
angles, Sh(m, q_2 + q_3) and so on, so that no product of their sines and cosines arises. Of each group, P is the
attitude of the axes that it starts from and m its axis in these; l_i leads from the point of joint i to the frame:

    inward   l_i = Sh(m, q_i + ...) C u + l_{i+1} in the axes of the group, Q l in those of the group before     (E7)
    outward  P <- P Sh(m, sum of q) C                                                                            (E5)
    columns  (P (m x l_i), P m) of a hinge, (P m, 0) of a slider: the Jacobian, and so v and omega           (E2, E8)
"""

from __future__ import annotations

import copy
import math
from collections.abc import Collection, Sequence
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import sympy

from hingepair.equations import spatial as eq
from hingepair.mechanism.tree import Frame, Joint, Tree
from hingepair.numeric.arrays import Float64Array
from hingepair.symbolic.exact_constants import exact, exact_angle, exact_entry
from hingepair.symbolic.kinks import Expr, real_symbol
from hingepair.symbolic.printers import count_symbols

VectorExpr: TypeAlias = tuple[Expr, Expr, Expr]
"""Three components."""
MatrixExpr: TypeAlias = tuple[Expr, ...]
"""Nine entries, row by row."""

POINTS: Final = "u"
"""Name of the constants of a robot that can stay symbols: the points of its joints and the frame's origin."""
# What rounding leaves: of the components of parallel axes, of right angles [rad], of components of a point beside
# its largest one.
_PARALLEL, _RIGHT_ANGLE, _ZERO = 16 * 2.0**-53, 4 * 2.0**-53, 4 * 2.0**-53
_ORIGIN: Final = (sympy.S.Zero,) * 3  # the zero vector, too
_IDENTITY: Final = tuple(sympy.Integer(i == j) for i in range(3) for j in range(3))


class _GroupLever(NamedTuple):
    """Vector that is fixed in a body of a group of parallel joints."""

    angle: Expr  # that rotates it about the group's axis [rad]
    vector: VectorExpr  # at angle 0, in the axes of the group [m]


class _GroupHinge(NamedTuple):
    """Hinge in a group of parallel joints."""

    column: int  # of its coordinate in q
    ratio: Expr  # of its rate about the group's axis to that of the coordinate


class _GroupSlider(NamedTuple):
    """Slider in a group of parallel joints."""

    angle: Expr  # that rotates it about the group's axis [rad]
    direction: VectorExpr  # at angle 0, in the axes of the group
    shift: Expr  # position along the direction [m]
    column: int  # of its coordinate in q
    ratio: Expr  # of its rate to that of the coordinate


class _ParallelJoints:
    """Consecutive joints with parallel axes, and the sliders between them, in the axes of the first one's parent
    body. The first group has no axis: it holds what comes before the first hinge.
    """

    def __init__(self, axis: Float64Array | None = None) -> None:
        self.direction = axis
        self.axis: VectorExpr = _ORIGIN if axis is None else _vector([exact_entry(part) for part in axis.tolist()])
        self.angle: Expr = sympy.S.Zero
        self.fixed = np.eye(3)  # rotation from the axes of the last body at angle 0
        self.members: list[_GroupLever | _GroupHinge | _GroupSlider] = []

    def sign(self, axis: Float64Array) -> int:
        """Return 1 if `axis`, in the axes of the last body, is along the group's axis, -1 if opposite, else 0."""
        if self.direction is None:
            return 0
        turned = self.fixed @ axis
        return next((k for k in (1, -1) if np.abs(turned - k * self.direction).max() <= _PARALLEL), 0)

    def to_group_axes(self, vector: Sequence[Expr]) -> VectorExpr:
        return _vector(eq.rotate(self.fixed_rotation(), tuple(vector)))

    def append_lever(self, point: Sequence[Expr]) -> None:
        """Append a vector that is fixed in the last body."""
        vector = self.to_group_axes(point)
        turns = any(eq.cross(self.axis, vector))
        self.members.append(_GroupLever(self.angle if turns else sympy.S.Zero, vector))

    def fixed_rotation(self) -> MatrixExpr:
        """Return the rotation from the axes of the last body to those of the group at angle 0."""
        return tuple(exact_entry(entry) for entry in self.fixed.ravel().tolist())

    def append_rotation(self, S: Float64Array) -> None:
        """Rotate the axes of the last body; a rotation about the group's axis, unless it is a multiple of a right
        angle about x, y or z, is added to the group's angle.
        """
        n = None if self.direction is None else self.fixed.T @ self.direction
        if n is not None and np.abs(S @ n - n).max() <= _PARALLEL:
            doubled_sines = np.array((S[2, 1] - S[1, 2], S[0, 2] - S[2, 0], S[1, 0] - S[0, 1]))
            angle = math.atan2(float(n @ doubled_sines) / 2, float(np.trace(S) - 1) / 2)
            quarters = round(angle / (math.pi / 2))
            is_right = abs(angle - quarters * (math.pi / 2)) <= _RIGHT_ANGLE
            if not is_right or (quarters and np.count_nonzero(np.abs(n) > _PARALLEL) > 1):
                self.angle += exact_angle(angle)
                return
        self.fixed = self.fixed @ S  # a right angle about x, y or z only exchanges components


class FrameProgram:
    """Program of expressions for the position, attitude, Jacobian and velocity of one frame of a robot: `results`
    maps each output's name to a tuple of components. Sines and cosines are symbols.

    Args:
        tree: the robot, whose base rests at the origin.
        frame: one of its frames.
        symbolic: if it contains POINTS, components of joint points and of the
            frame's origin that are not 0 are symbols.

    Attributes:
        results: components by output: R (3), S (9, row by row), jacobian (6 dof, row by row), v (3), omega (3).
        waves: sines and cosines, by their symbols.
        numbers: values of the symbols of points [m].
        joints: joints that the frame depends on, by the symbols of their coordinates.
        largest_rounded: largest number that counts as 0, a rounding error.
    """

    def __init__(self, tree: Tree, frame: Frame, symbolic: Collection[str] = ()) -> None:
        coordinates = tree.coordinates
        self.dof = len(coordinates)
        self.q = tuple(real_symbol(f"q_{number}") for number in range(1, self.dof + 1))
        self.qd = tuple(real_symbol(f"qd_{number}") for number in range(1, self.dof + 1))
        self.waves: dict[Expr, Expr] = {}
        self.numbers: dict[Expr, float] = {}
        self.largest_rounded = 0.0
        self._trig_symbols: dict[Expr, tuple[Expr, Expr]] = {}
        self._points_are_symbols = POINTS in symbolic
        self._columns = {joint.name: column for column, joint in enumerate(coordinates)}
        chain = _joint_path(tree, frame.body)
        columns = sorted({self._column(tree, tree.joints[number - 1]) for number in chain})
        self.joints = {self.q[column]: coordinates[column] for column in columns}
        groups = self._groups(tree, chain)
        groups[-1].append_lever(self._point_vector("p", frame.R))
        groups[-1].append_rotation(frame.S)
        attitudes, rotated = self._attitudes(groups)
        motion = self._motion(groups, attitudes, rotated)
        self.results: dict[str, tuple[Expr, ...]] = motion | {"S": attitudes[-1]}

    # ---- groups of joints

    def _groups(self, tree: Tree, joint_numbers: Sequence[int]) -> list[_ParallelJoints]:
        """Return the groups of the joints with these numbers, counted from 1, on a path from the base."""
        groups = [_ParallelJoints()]
        for number in joint_numbers:
            joint, group = tree.joints[number - 1], groups[-1]
            column = self._column(tree, joint)
            ratio, offset = (1.0, 0.0) if joint.mimic is None else joint.mimic[1:]
            position = exact(ratio) * self.q[column] + exact(offset)
            mark = f"m{number}" if joint.mimic is not None else str(column + 1)
            group.append_lever(self._point_vector(f"u_{mark}", joint.u))
            turns, shifts = map(exact, joint.axis)
            if shifts:
                before = copy.deepcopy(group) if turns else group
                before.append_rotation(joint.S)
                direction = before.to_group_axes([exact_entry(part) for part in joint.n.tolist()])
                group.members.append(
                    _GroupSlider(before.angle, direction, shifts * position, column, shifts * exact(ratio))
                )
            if not turns:
                continue
            with np.errstate(under="ignore"):
                axis = joint.S @ joint.n
            if sign := group.sign(axis):
                group.angle += sign * position
                group.members.append(_GroupHinge(column, sign * exact(ratio)))
            else:
                group = _ParallelJoints(axis)
                group.angle = position
                group.members.append(_GroupHinge(column, exact(ratio)))
                groups.append(group)
            group.append_rotation(joint.S)
        return groups

    def _column(self, tree: Tree, joint: Joint) -> int:
        leader = joint if joint.mimic is None else tree.joints[joint.mimic.leader - 1]
        return self._columns[leader.name]

    def _point_vector(self, name: str, point: Float64Array) -> VectorExpr:
        """Return a point [m] as exact numbers, or symbols whose names begin with `name`; what rounding left is 0."""
        size = float(np.abs(point).max())
        parts = []
        for axis, value in zip("xyz", point.tolist(), strict=True):
            number = exact(value)
            if abs(value) <= _ZERO * size:
                self.largest_rounded = max(self.largest_rounded, abs(value))
                number = sympy.S.Zero
            if number and self._points_are_symbols:
                symbol = real_symbol(f"{name}{axis}" if name[-1].isdigit() else f"{name}_{axis}")
                self.numbers[symbol] = value
                number = symbol
            parts.append(number)
        return _vector(parts)

    # ---- sines and cosines

    def _rotation(self, axis: VectorExpr, angle: Expr) -> MatrixExpr:
        """Return the rotation about a group's axis (E6), in symbols of the angle's sine and cosine."""
        if not angle:
            return _IDENTITY
        s, c = self._trig_of(angle)
        return tuple(sympy.expand(entry) for entry in eq.hinge_rotation(axis, (s, 1 - c)))

    def _trig_of(self, angle: Expr) -> tuple[Expr, Expr]:
        """Return the symbols of the sine and cosine of an angle, such as s_23 and c_23 for q_2 + q_3."""
        indices = [number for number, q in enumerate(self.q, 1) if q in angle.free_symbols]
        if angle.coeff(self.q[indices[0] - 1]).is_negative:
            s, c = self._trig_of(-angle)
            return -s, c
        if angle not in self._trig_symbols:
            suffix = ("" if indices[-1] < 10 else ",").join(map(str, indices))
            marks = ("", *"abcdefghijklmnopqrstuvwxyz")
            mark = next(mark for mark in marks if real_symbol(f"s_{suffix}{mark}") not in self.waves)
            s, c = real_symbol(f"s_{suffix}{mark}"), real_symbol(f"c_{suffix}{mark}")
            self.waves |= {c: sympy.cos(angle, evaluate=False), s: sympy.sin(angle, evaluate=False)}
            self._trig_symbols[angle] = s, c
        return self._trig_symbols[angle]

    # ---- attitudes outward, levers inward

    def _attitudes(self, groups: Sequence[_ParallelJoints]) -> tuple[list[MatrixExpr], list[MatrixExpr]]:
        """Return the attitudes at the start of each group and of the frame, and those after each group's rotation."""
        attitudes: list[MatrixExpr] = [_IDENTITY]
        rotated: list[MatrixExpr] = []
        for group in groups:
            rotated.append(_entries(eq.compose(attitudes[-1], self._rotation(group.axis, group.angle))))
            attitudes.append(_entries(eq.compose(rotated[-1], group.fixed_rotation())))
        return attitudes, rotated

    def _motion(
        self,
        groups: Sequence[_ParallelJoints],
        attitudes: Sequence[MatrixExpr],
        rotated_attitudes: Sequence[MatrixExpr],
    ) -> dict[str, tuple[Expr, ...]]:
        """Return R, jacobian, v and omega of the frame."""
        lever = _ORIGIN
        columns: dict[int, tuple[VectorExpr, VectorExpr]] = {}
        v, omega = _ORIGIN, _ORIGIN
        for group, P, P_rotated in reversed(list(zip(groups, attitudes, rotated_attitudes, strict=False))):
            parts = group.members
            lever = group.to_group_axes(lever)
            last = parts[-1]
            if (
                isinstance(last, _GroupLever) and last.angle == group.angle
            ):  # both rotate together, so that constants add up
                lever, parts = _vector(eq.add(last.vector, lever)), parts[:-1]
            unrotated_lever = lever
            lever = _vector(eq.rotate(self._rotation(group.axis, group.angle), lever))
            drift: VectorExpr = _ORIGIN  # velocity of the frame in the axes of the group
            spin: Expr = sympy.S.Zero  # rate about the group's axis
            for part in reversed(parts):
                match part:
                    case _GroupLever():
                        rotated_lever = eq.rotate(self._rotation(group.axis, part.angle), part.vector)
                        lever = _vector(eq.add(rotated_lever, lever))
                        continue
                    case _GroupSlider():
                        direction = _vector(eq.rotate(self._rotation(group.axis, part.angle), part.direction))
                        lever = _vector(eq.add(eq.scale(direction, part.shift), lever))
                        linear, angular = direction, _ORIGIN
                    case _GroupHinge():
                        linear, angular = _vector(eq.cross(group.axis, lever)), group.axis
                        spin += part.ratio * self.qd[part.column]
                rate = part.ratio * self.qd[part.column]
                moves = _vector(eq.rotate(P, linear))
                if len(parts) == 1 and isinstance(part, _GroupHinge):  # m x Sh l = Sh (m x l): take the shorter form
                    moves = min(
                        moves,
                        _vector(eq.rotate(P_rotated, eq.cross(group.axis, unrotated_lever))),
                        key=_count_all_symbols,
                    )
                    v = _vector(eq.add(eq.scale(moves, rate), v))
                else:
                    drift = _vector(eq.add(drift, eq.scale(linear, rate)))
                columns_so_far = columns.get(part.column, (_ORIGIN, _ORIGIN))
                columns[part.column] = (
                    _vector(eq.add(columns_so_far[0], eq.scale(moves, part.ratio))),
                    _vector(eq.add(columns_so_far[1], eq.scale(eq.rotate(P, angular), part.ratio))),
                )
            v = _vector(eq.add(eq.rotate(P, _vector(drift)), v))
            omega = _vector(eq.add(eq.scale(eq.rotate(P, group.axis), spin), omega))
        zero_column = (_ORIGIN, _ORIGIN)
        jacobian = [
            columns.get(column, zero_column)[row // 3][row % 3] for row in range(6) for column in range(self.dof)
        ]
        found = {"R": lever, "jacobian": jacobian, "v": v, "omega": omega}
        return {name: _entries(parts) for name, parts in found.items()}


def _joint_path(tree: Tree, body: int) -> list[int]:
    """Return the numbers, counted from 1, of the joints from the base to a body."""
    numbers = []
    while body:
        numbers.append(body)
        body = tree.joints[body - 1].parent
    return numbers[::-1]


def _vector(components: Sequence[Expr]) -> VectorExpr:
    x, y, z = map(sympy.sympify, components)
    return x, y, z


def _entries(components: Sequence[Expr]) -> tuple[Expr, ...]:
    return tuple(map(sympy.sympify, components))


def _count_all_symbols(components: VectorExpr) -> int:
    return sum(map(count_symbols, components))
