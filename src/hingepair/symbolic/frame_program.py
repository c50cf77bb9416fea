"""The motion of one frame of a robot in closed form: E2, E5 and E7 handed from joint to joint, and named on the way.

Consecutive joints whose axes are parallel make one group: within it attitudes are rotations about one axis by sums of
angles, Sh(m, q_2 + q_3) and so on, so that no product of their sines and cosines arises. Of each group, P is the
attitude of the axes that it starts from and m its axis in these; l_i leads from the point of joint i to the frame:

    inward   l_i = Sh(m, q_i + ...) C u + l_{i+1} in the axes of the group, Q l in those of the group before     (E7)
    outward  P <- P Sh(m, sum of q) C                                                                            (E5)
    columns  (P (m x l_i), P m) of a hinge, (P m, 0) of a slider: the Jacobian, and so v and omega           (E2, E8)

A component that is a sum gets a name, in which later components are written; whoever prints them puts what is used
once back into its place.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Final, NamedTuple, TypeAlias

import numpy as np
import sympy

from hingepair.equations import spatial as eq
from hingepair.mechanism.tree import Frame, Joint, Tree
from hingepair.numeric.arrays import Float64Array
from hingepair.symbolic.exact_constants import exact, exact_angle, exact_entry
from hingepair.symbolic.kinks import Expr
from hingepair.symbolic.printers import count_letters

Vector: TypeAlias = tuple[Expr, Expr, Expr]
Matrix: TypeAlias = tuple[Expr, ...]

POINTS: Final = "u"
"""What of a robot can stay a letter: the points of its joints and the frame's origin."""
_PARALLEL_TOLERANCE: Final = 16 * 2.0**-53
"""Of the components of unit axes: what products of rotations leave between two that are parallel."""
_RIGHT_ANGLE_TOLERANCE: Final = 4 * 2.0**-53
"""[rad], relative to pi/2."""
_ZERO: Final = (sympy.S.Zero,) * 3
_IDENTITY: Final = tuple(sympy.Integer(i == j) for i in range(3) for j in range(3))


class _Arm(NamedTuple):
    """A vector that is fixed in a body: what it is at angle 0, in the axes of its group, and what angle turns it."""

    angle: Expr
    vector: Vector


class _Turn(NamedTuple):
    """A hinge of a group: its rate along the group's axis, by column of q."""

    column: int
    ratio: Expr


class _Slide(NamedTuple):
    """A slider: its direction at angle 0 in the axes of its group, the angle, how far it is out, and its rate."""

    angle: Expr
    direction: Vector
    shift: Expr
    column: int
    ratio: Expr


class _Group:
    """Joints one after the other that turn about parallel axes, sliders among them, in the axes it starts from.

    The first group has no axis: it holds what comes before the first hinge.
    """

    def __init__(self, axis: Float64Array | None = None) -> None:
        self.direction = axis
        self.axis: Vector = _ZERO if axis is None else _vector([exact_entry(part) for part in axis.tolist()])
        self.angle: Expr = sympy.S.Zero
        self.fixed = np.eye(3)  # rotation from the axes of the last body at angle 0
        self.parts: list[_Arm | _Turn | _Slide] = []

    def sign(self, axis: Float64Array) -> int:
        """Return 1 or -1 where an axis, in the last body's axes, is parallel to the group's; else 0."""
        if self.direction is None:
            return 0
        turned = self.fixed @ axis
        return next((k for k in (1, -1) if np.abs(turned - k * self.direction).max() <= _PARALLEL_TOLERANCE), 0)

    def place(self, vector: Sequence[Expr]) -> Vector:
        """Return a vector of the last body at angle 0."""
        return _vector(eq.rotate(self.turned(), tuple(vector)))

    def carry(self, point: Sequence[Expr]) -> None:
        """Append a point of the last body; one on the group's axis does not turn."""
        vector = self.place(point)
        turns = any(eq.cross(self.axis, vector))
        self.parts.append(_Arm(self.angle if turns else sympy.S.Zero, vector))

    def turned(self) -> Matrix:
        """Return the fixed rotation, exact."""
        return tuple(exact_entry(entry) for entry in self.fixed.ravel().tolist())

    def turn_on(self, S: Float64Array) -> None:
        """Append a fixed rotation; one about the group's own axis becomes a part of the angle."""
        n = None if self.direction is None else self.fixed.T @ self.direction
        if n is not None and np.abs(S @ n - n).max() <= _PARALLEL_TOLERANCE:
            across = np.array((S[2, 1] - S[1, 2], S[0, 2] - S[2, 0], S[1, 0] - S[0, 1]))
            angle = math.atan2(float(n @ across) / 2, float(np.trace(S) - 1) / 2)
            quarters = round(angle / (math.pi / 2))
            is_right = abs(angle - quarters * (math.pi / 2)) <= _RIGHT_ANGLE_TOLERANCE
            if not is_right or (quarters and np.count_nonzero(np.abs(n) > _PARALLEL_TOLERANCE) > 1):
                self.angle += exact_angle(angle)
                return
        self.fixed = self.fixed @ S  # of a right angle about x, y or z it exchanges components only


class FrameProgram:
    """The position, attitude, Jacobian and velocity of a frame, in letters that are named in turn.

    Args:
        tree: the robot, whose base rests at the origin.
        frame: one of its frames.
        symbolic: POINTS in it: points of joints and the frame's origin are letters, as far as they are not 0.

    Attributes:
        results: components by output: R (3), S (9, row by row), jacobian (6 dof, row by row), v (3), omega (3).
        meanings: what each further letter stands for, in an order in which each needs earlier ones only.
        waves: sines and cosines by their letter.
        numbers: values of the letters that stand for numbers.
        joints: the joints that the frame depends on, by their letter.
        rounded: the largest number that was taken for 0, since rounding left it.
    """

    def __init__(self, tree: Tree, frame: Frame, symbolic: Collection[str] = ()) -> None:
        coordinates = tree.coordinates
        self.dof = len(coordinates)
        self.q = tuple(_letter(f"q_{number}") for number in range(1, self.dof + 1))
        self.qd = tuple(_letter(f"qd_{number}") for number in range(1, self.dof + 1))
        self.meanings: dict[Expr, Expr] = {}
        self.waves: dict[Expr, Expr] = {}
        self.numbers: dict[Expr, float] = {}
        self.rounded = 0.0
        self._letters_of: dict[Expr, tuple[Expr, Expr]] = {}
        self._lettered = POINTS in symbolic
        self._columns = {joint.name: column for column, joint in enumerate(coordinates)}
        chain = _chain(tree, frame.body)
        columns = sorted({self._column(tree, tree.joints[number - 1]) for number in chain})
        self.joints = {self.q[column]: coordinates[column] for column in columns}
        groups = self._groups(tree, chain)
        groups[-1].carry(self._point("p", frame.R))
        groups[-1].turn_on(frame.S)
        attitudes, turned = self._attitudes(groups)
        motion = self._motion(groups, attitudes, turned)
        self.results: dict[str, tuple[Expr, ...]] = motion | {"S": attitudes[-1]}

    # ---- groups of joints

    def _groups(self, tree: Tree, chain: Sequence[int]) -> list[_Group]:
        groups = [_Group()]
        for number in chain:
            joint, group = tree.joints[number - 1], groups[-1]
            column = self._column(tree, joint)
            ratio, offset = (1.0, 0.0) if joint.mimic is None else joint.mimic[1:]
            position = exact(ratio) * self.q[column] + exact(offset)
            mark = f"m{number}" if joint.mimic is not None else str(column + 1)
            group.carry(self._point(f"u_{mark}", joint.u))
            if joint.kind == "slider":
                group.turn_on(joint.S)
                direction = group.place([exact_entry(part) for part in joint.n.tolist()])
                group.parts.append(_Slide(group.angle, direction, position, column, exact(ratio)))
                continue
            axis = joint.S @ joint.n
            if sign := group.sign(axis):
                group.angle += sign * position
                group.parts.append(_Turn(column, sign * exact(ratio)))
            else:
                group = _Group(axis)
                group.angle = position
                group.parts.append(_Turn(column, exact(ratio)))
                groups.append(group)
            group.turn_on(joint.S)
        return groups

    def _column(self, tree: Tree, joint: Joint) -> int:
        leader = joint if joint.mimic is None else tree.joints[joint.mimic.leader - 1]
        return self._columns[leader.name]

    def _point(self, name: str, point: Float64Array) -> Vector:
        """Return a point as exact numbers or, as far as its components are not 0, as letters."""
        size = float(np.abs(point).max())
        parts = []
        for axis, value in zip("xyz", point.tolist(), strict=True):
            number = exact(value)
            if abs(value) <= _RIGHT_ANGLE_TOLERANCE * size:
                self.rounded = max(self.rounded, abs(value))
                number = sympy.S.Zero
            if number and self._lettered:
                letter = _letter(f"{name}{axis}" if name[-1].isdigit() else f"{name}_{axis}")
                self.numbers[letter] = value
                number = letter
            parts.append(number)
        return _vector(parts)

    # ---- sines, cosines and names

    def _rotation(self, axis: Vector, angle: Expr) -> Matrix:
        """Return the rotation about a group's axis (E6), in letters for the sine and the cosine of the angle."""
        if not angle:
            return _IDENTITY
        s, c = self._wave(angle)
        return tuple(sympy.expand(entry) for entry in eq.hinge_rotation(axis, (s, 1 - c)))

    def _wave(self, angle: Expr) -> tuple[Expr, Expr]:
        """Return the sine and the cosine of an angle in letters: s_23 and c_23 of q_2 + q_3."""
        indices = [number for number, q in enumerate(self.q, 1) if q in angle.free_symbols]
        if angle.coeff(self.q[indices[0] - 1]).is_negative:
            s, c = self._wave(-angle)
            return -s, c
        if angle not in self._letters_of:
            index = ("" if indices[-1] < 10 else ",").join(map(str, indices))
            marks = ("", *"abcdefghijklmnopqrstuvwxyz")
            mark = next(mark for mark in marks if _letter(f"s_{index}{mark}") not in self.waves)
            s, c = _letter(f"s_{index}{mark}"), _letter(f"c_{index}{mark}")
            self.waves |= {c: sympy.cos(angle, evaluate=False), s: sympy.sin(angle, evaluate=False)}
            self._letters_of[angle] = s, c
        return self._letters_of[angle]

    def _named(self, parts: Sequence[Expr]) -> tuple[Expr, ...]:
        """Return components, of which those that are sums have names."""
        return tuple(self._name(sympy.sympify(part)) for part in parts)

    def _name(self, part: Expr) -> Expr:
        if not part.is_Add:
            return part
        if part.could_extract_minus_sign():
            return -self._name(-part)
        known = next((letter for letter, meaning in self.meanings.items() if meaning == part), None)
        if known is None:
            known = sympy.Dummy(f"k{len(self.meanings)}", real=True)
            self.meanings[known] = part
        return known

    # ---- attitudes outward, levers inward

    def _attitudes(self, groups: Sequence[_Group]) -> tuple[list[Matrix], list[Matrix]]:
        """Return the attitudes that groups start from, the frame's after them, and those as the groups turn them."""
        attitudes: list[Matrix] = [_IDENTITY]
        turned: list[Matrix] = []
        for group in groups:
            turned.append(self._named(eq.compose(attitudes[-1], self._rotation(group.axis, group.angle))))
            attitudes.append(self._named(eq.compose(turned[-1], group.turned())))
        return attitudes, turned

    def _motion(
        self, groups: Sequence[_Group], attitudes: Sequence[Matrix], turned: Sequence[Matrix]
    ) -> dict[str, tuple[Expr, ...]]:
        """Return position, Jacobian and velocities, by way of the levers from each joint's point to the frame."""
        lever = _ZERO
        columns: dict[int, tuple[Vector, Vector]] = {}
        v, omega = _ZERO, _ZERO
        for group, P, P_turned in reversed(list(zip(groups, attitudes, turned, strict=False))):
            parts = group.parts
            lever = group.place(lever)
            last = parts[-1]
            if isinstance(last, _Arm) and last.angle == group.angle:  # turned together, constants add up
                lever, parts = self._vector(eq.add(last.vector, lever)), parts[:-1]
            after = lever
            lever = self._vector(eq.rotate(self._rotation(group.axis, group.angle), lever))
            drift: Vector = _ZERO  # of the frame, in the axes of the group
            spin: Expr = sympy.S.Zero  # about its axis
            for part in reversed(parts):
                match part:
                    case _Arm():
                        arm = eq.rotate(self._rotation(group.axis, part.angle), part.vector)
                        lever = self._vector(eq.add(arm, lever))
                        continue
                    case _Slide():
                        direction = _vector(eq.rotate(self._rotation(group.axis, part.angle), part.direction))
                        lever = self._vector(eq.add(eq.scale(direction, part.shift), lever))
                        linear, angular = direction, _ZERO
                    case _Turn():
                        linear, angular = _vector(eq.cross(group.axis, lever)), group.axis
                        spin += part.ratio * self.qd[part.column]
                rate = part.ratio * self.qd[part.column]
                moves = _vector(eq.rotate(P, linear))
                if len(parts) == 1 and isinstance(part, _Turn):  # m x Sh l = Sh (m x l), the shorter of both
                    moves = min(moves, _vector(eq.rotate(P_turned, eq.cross(group.axis, after))), key=_size)
                    v = _vector(eq.add(eq.scale(moves, rate), v))
                else:
                    drift = _vector(eq.add(drift, eq.scale(linear, rate)))
                known = columns.get(part.column, (_ZERO, _ZERO))
                columns[part.column] = (
                    _vector(eq.add(known[0], eq.scale(moves, part.ratio))),
                    _vector(eq.add(known[1], eq.scale(eq.rotate(P, angular), part.ratio))),
                )
            v = _vector(eq.add(eq.rotate(P, self._vector(drift)), v))
            omega = _vector(eq.add(eq.scale(eq.rotate(P, group.axis), spin), omega))
        none = (_ZERO, _ZERO)
        jacobian = [columns.get(column, none)[row // 3][row % 3] for row in range(6) for column in range(self.dof)]
        named = {"R": lever, "jacobian": jacobian, "v": v, "omega": omega}
        return {name: self._named(parts) for name, parts in named.items()}

    def _vector(self, parts: Sequence[Expr]) -> Vector:
        return _vector(self._named(parts))


def _chain(tree: Tree, body: int) -> list[int]:
    """Return the numbers of the joints from the base to a body."""
    numbers = []
    while body:
        numbers.append(body)
        body = tree.joints[body - 1].parent
    return numbers[::-1]


def _vector(parts: Sequence[Expr]) -> Vector:
    x, y, z = map(sympy.sympify, parts)
    return x, y, z


def _size(parts: Vector) -> int:
    return sum(map(count_letters, parts))


def _letter(name: str) -> Expr:
    return sympy.Symbol(name, real=True)
