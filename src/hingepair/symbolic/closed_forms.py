"""Closed forms: the equations evaluated on SymPy expressions, of a pair in t and of a robot's frame in q.

After every equation, products of sines and cosines are converted to sums of sines and cosines where these have fewer
symbols.
"""

from __future__ import annotations

import itertools
import operator
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, Final

import sympy

from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError, choices
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.pairs.requests import check_single_pair, constants_of
from hingepair.mechanism.tree import Joint
from hingepair.numeric.names import Names
from hingepair.plans.pairs import PLANE, SPACE, PairKind, point_outputs, unit_among
from hingepair.rotations.sequences import find_sequence
from hingepair.symbolic.exact import TIME, Expr, exact, exact_axis, exact_entry, rate, real_symbol
from hingepair.symbolic.trig_sums import cosine_expression, sine_expression
from hingepair.symbolic.writing import ClosedForms, Exprs, latex_name

SYMBOLIC_CONSTANTS: Final = ("u1", "u2", "n")
"""Constants of a pair that can stay symbols."""
FRAME_OUTPUTS: Final = {
    "R": "position of the frame's origin, world axes [m]",
    "S": "rotation from the frame's axes to those of the world",
    "jacobian": "(v, omega) = jacobian @ qd, world axes",
    "v": "velocity of the frame's origin, world axes [m/s]",
    "omega": "angular velocity of the frame, world axes [rad/s]",
}
"""What the outputs of a robot's frame are, by name."""

_IDENTITY = (1, 0, 0, 0, 1, 0, 0, 0, 1)
_ZERO_LENGTH = 4 * 2.0**-53  # of a component of a point beside its largest one: rounding


# ---- a pair


class PairForms(ClosedForms):
    """Closed forms of a pair's motion (E1-E11) as functions of `t`.

    The outputs are `R2`, `S2`, `d`, `v2`, `omega2`, `a2`, `alpha2`, `R1`, `S1`, `v1`, `omega1`, `a1`, `alpha1`, and
    of a point `tip` also `tip`, `tip_v`, `tip_a`; of a planar pair those that `names` lists. Vectors of a planar pair
    have two components, and its angles, angular velocities and accelerations are expressions.

    Args:
        pair: one pair; its numbers are made exact as `hingepair.derive` describes.
        motion: coordinates as expressions in t, by name. A coordinate that is missing or None is an unspecified
            function of t. By default all are.
        sequence: sequence of the Euler angles; ignored in the plane.
        symbolic: names of constants, out of u1, u2 and n, that stay symbols; n counts as having length 1.
        exact_values: exact components of u1, u2 and points, by name, where they are known.

    Raises:
        ArgumentError: `pair` holds more than one pair.
    """

    t: Final = TIME
    """The SymPy symbol of time [s]."""

    def __init__(
        self,
        pair: HingePair | PlanarPair,
        motion: Mapping[str, Expr | None] | None = None,
        sequence: str | None = "XYZ",
        symbolic: Collection[str] = (),
        exact_values: Mapping[str, Exprs] | None = None,
    ) -> None:
        super().__init__()
        check_single_pair(pair)
        points = constants_of(pair).points
        self.planar, self.title = isinstance(pair, PlanarPair), pair.name or ""
        self.names = (*self.kind.levels, *point_outputs(points))
        self.rates = {f"{name}{'d' * k}": (name, k) for name in self.kind.coordinates for k in (1, 2)}
        self._bodies = {point.name: point.body for point in points}
        given = {name: expr for name, expr in (motion or {}).items() if expr is not None}
        values = {key: tuple(map(sympy.sympify, exprs)) for key, exprs in (exact_values or {}).items()}
        renamed = self._renamed([*given.values(), *itertools.chain(*values.values())], given, symbolic)
        coordinates = [
            given[name].xreplace(renamed) if name in given else sympy.Function(name, real=True)(TIME)
            for name in self.kind.coordinates
        ]
        values = {key: tuple(expr.xreplace(renamed) for expr in exprs) for key, exprs in values.items()}
        self._found |= self._constants(pair, symbolic, values)
        *R1, psi = coordinates
        if self.planar:
            self._found |= {"R1": (*R1[:2], sympy.S.Zero), "phi1": R1[2], "psi": psi}
        else:
            self._found |= {"R1": tuple(R1[:3]), "phi": tuple(R1[3:]), "psi": psi}
        plane = {"S1": (_about_z, ("phi1",)), "omega1": (_spin_about_z, ("phi1",))}
        self._equations = {**_PAIR, **(plane if self.planar else _attitude_equations(sequence or "XYZ"))}

    @property
    def kind(self) -> PairKind:
        """Kind of motion of the pair, PLANE or SPACE."""
        return PLANE if self.planar else SPACE

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of an output."""
        shape = self.kind.shapes.get(name)
        return (3 - self.planar,) if shape is None else shape

    def description(self, name: str) -> str:
        """Return the unit of an output."""
        unit = unit_among(self.names, name)
        return f" [{unit}]" if unit != "1" else ""

    def entries(self, name: str) -> Exprs:
        """Return the components of an output; in the plane those of the plane alone."""
        parts = super().entries(name)
        if self.planar and len(parts) == 3:
            return parts[:2] if self.shape(name) else parts[2:]
        return parts

    def _renamed(self, exprs: Iterable[Expr], given: Collection[str], symbolic: Collection[str]) -> dict[Expr, Expr]:
        """Return the symbols that replace the constants in expressions of a scene; names in use get an underscore.
        `given` are the names of the coordinates, `symbolic` those of the pair's constants that are symbols.
        """
        used = ["t", *itertools.chain(*map(self.labels, self.names))]
        used += [name + "d" * order for name in self.kind.coordinates if name not in given for order in range(3)]
        used += [f"{key}_{axis}" for key in symbolic for axis in "xyz"]
        names = Names(used, latex_name)
        constants = set().union(*(expr.free_symbols for expr in exprs)) - {TIME}
        taken = names.take_all(sorted(symbol.name for symbol in constants))
        return {symbol: real_symbol(taken[symbol.name]) for symbol in constants}

    def _constants(
        self, pair: HingePair | PlanarPair, symbolic: Collection[str], exact_values: Mapping[str, Exprs]
    ) -> dict[str, Exprs]:
        """Return u1, u2, n, home and points: symbols, `exact_values`, or exact numbers made of the pair's floats."""
        constants = constants_of(pair)
        floats = {key: tuple(array.ravel().tolist()) for key, array in constants.arrays.items()}
        floats |= {point_key(name): tuple(R.tolist()) for name, R in {**pair.points1, **pair.points2}.items()}
        found: dict[str, Exprs] = {"n": (0, 0, 1), "home": _IDENTITY}
        for key, value in floats.items():
            if key == "home" and not constants.has_home:
                continue
            if key in symbolic:
                found[key] = tuple(real_symbol(f"{key}_{axis}") for axis in "xyz"[: len(value)])
            elif key in exact_values:
                found[key] = exact_values[key]
            else:
                found[key] = (
                    tuple(map(exact_entry if key == "home" else exact, value)) if key != "n" else exact_axis(value)
                )
            if len(found[key]) == 2:
                found[key] = (*found[key], 0)
        return found

    def _derive(self, name: str) -> Any:
        point, _, ending = name.rpartition("_") if name.endswith(("_v", "_a")) else (name, "", "R")
        if point in self._bodies:
            return self._of_point(ending, point, self._bodies[point])
        function, arguments = self._equations[name]
        return function(*map(self.form, arguments))

    def _of_point(self, letter: str, point: str, body: int) -> Exprs:
        """Return R = R_i + S_i p, or its velocity or acceleration (E1, E8, E9)."""
        form = self.form
        arm = eq.rotate(form(f"S{body}"), form(point_key(point)))
        if letter == "R":
            return eq.add(form(f"R{body}"), arm)
        omega = form(f"omega{body}")
        if letter == "v":
            return eq.add(form(f"v{body}"), eq.cross(omega, arm))
        return eq.add(form(f"a{body}"), eq.point_acceleration(omega, form(f"alpha{body}"), arm))


def point_key(name: str) -> str:
    """Return the name of the vector to a point, which its output has to be told from."""
    return f"vector to {name}"


def _trig(angle: Expr) -> tuple[Expr, Expr]:
    """Return sine and versine of an angle."""
    return sine_expression(angle), 1 - cosine_expression(angle)


def _rates(expr: Any) -> Any:
    return tuple(map(rate, expr)) if isinstance(expr, tuple) else rate(expr)


def _about_z(angle: Expr) -> Exprs:
    return eq.hinge_rotation((0, 0, 1), _trig(angle))


def _spin_about_z(angle: Expr) -> Exprs:
    return 0, 0, rate(angle)


def _attitude_equations(sequence: str) -> dict[str, _Equation]:
    """Return the equations of the attitude of body 1 by Euler angles (E4, E10)."""
    order = find_sequence(sequence)
    return {
        "angles": (order.angles, ("phi",)),
        "trig": (_sines_and_cosines, ("angles",)),
        "S1": (order.attitude, ("trig",)),
        "axes": (order.axes, ("trig",)),
        "phid": (_rates, ("phi",)),
        "omega1": (order.angular_velocity, ("axes", "phid")),
    }


def _sines_and_cosines(angles: Exprs) -> Exprs:
    return tuple(function(angle) for angle in angles for function in (sine_expression, cosine_expression))


def _difference(R: Exprs, r1: Exprs, r2: Exprs) -> Exprs:
    return eq.add(R, eq.subtract(r1, r2))


_Equation = tuple[Callable[..., Any], tuple[str, ...]]  # a function, and the names of its arguments

# Every quantity, of others (E5-E9): r1 = S1 u1 and r2 = S2 u2 lead to the hinge point.
_PAIR: Final[Mapping[str, _Equation]] = {
    "v1": (_rates, ("R1",)),
    "a1": (_rates, ("v1",)),
    "psid": (_rates, ("psi",)),
    "psidd": (_rates, ("psid",)),
    "alpha1": (_rates, ("omega1",)),
    "phi2": (operator.add, ("phi1", "psi")),
    "hinge": (_trig, ("psi",)),
    "Sh": (eq.hinge_rotation, ("n", "hinge")),
    "relative": (eq.compose, ("Sh", "home")),
    "S2": (eq.compose, ("S1", "relative")),
    "arm": (eq.rotate, ("relative", "u2")),
    "lever": (eq.subtract, ("u1", "arm")),
    "d": (eq.rotate, ("S1", "lever")),
    "R2": (eq.position2, ("R1", "d")),
    "axis": (eq.rotate, ("S1", "n")),
    "omega2": (eq.angular_velocity2, ("omega1", "axis", "psid")),
    "alpha2": (eq.angular_acceleration2, ("alpha1", "omega1", "axis", "psid", "psidd")),
    "r1": (eq.rotate, ("S1", "u1")),
    "r2": (eq.rotate, ("S2", "u2")),
    "r1'": (eq.cross, ("omega1", "r1")),
    "r2'": (eq.cross, ("omega2", "r2")),
    "r1''": (eq.point_acceleration, ("omega1", "alpha1", "r1")),
    "r2''": (eq.point_acceleration, ("omega2", "alpha2", "r2")),
    "v2": (_difference, ("v1", "r1'", "r2'")),
    "a2": (_difference, ("a1", "r1''", "r2''")),
}


# ---- a frame of a robot


class FrameForms(ClosedForms):
    """Closed forms of the motion of one frame of a robot whose base rests at the origin (E2, E5, E7), in the symbols
    `q` and `qd` of the robot's coordinates and rates: `R` (3, 1), `S` (3, 3), `jacobian` (6, dof) with the rows of v
    before those of omega, `v` (3, 1) and `omega` (3, 1), all in world axes.

    Each number of the robot is the rational number that its shortest decimal form shows; a length that rounding left
    is 0. An entry of a rotation that
    equals 0, 1, -1 or the root of a simple fraction within rounding is exactly that number.

    Args:
        robot: a robot with a fixed base.
        frame: name of a link, a joint or another frame; None means the last link, if there is only one.

    Raises:
        ArgumentError: the base is free, or there is no such frame.
    """

    names = tuple(FRAME_OUTPUTS)

    def __init__(self, robot: Mechanism, frame: str | None = None) -> None:
        super().__init__()
        if robot.base != "fixed":
            expected = "a robot with base='fixed': the motion of its frames relative to its base"
            raise ArgumentError("scene_or_pair", expected, f"base={robot.base!r}")
        self._tree = tree_of(robot)
        last = self._tree.plain().tips
        if frame is None and len(last) != 1:
            which = f"the name of a link or joint, since {robot.name} ends in {len(last)} links: {choices(last)}"
            raise ArgumentError("frame", which, "none")
        name = last[0] if frame is None else frame
        self._frame = self._tree.known_frame("frame", name)
        self.title = f"frame {name} of {robot.name}"
        moving = self._tree.coordinates
        self.q = tuple(real_symbol(f"q_{number}") for number in range(1, len(moving) + 1))
        self.qd = tuple(real_symbol(f"qd_{number}") for number in range(1, len(moving) + 1))
        self._columns = {joint.name: column for column, joint in enumerate(moving)}
        self._path = self._joints_to(self._frame.body)
        self.moving = {self.q[self._column(joint)] for joint in self._path}
        self.rates = {str(rate): (str(q), 1) for q, rate in zip(self.q, self.qd, strict=True)}
        vectors = (*(joint.u for joint in self._path), self._frame.R)
        self._points = [_exact_point(vector.tolist()) for vector in vectors]
        self.notes = (self._legend(),)

    def shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of an output."""
        return {"S": (3, 3), "jacobian": (6, len(self.q))}.get(name, (3,))

    def description(self, name: str) -> str:
        """Return what an output is."""
        return f": {FRAME_OUTPUTS[name]}"

    def labels(self, name: str) -> list[str]:
        """Return the labels of the components of an output: R_x, S_xy, Jv_x1, Jomega_z6."""
        if name != "jacobian":
            return super().labels(name)
        rows = [f"{row}_{axis}" for row in ("Jv", "Jomega") for axis in "xyz"]
        return [f"{row}{column}" for row in rows for column in range(1, len(self.q) + 1)]

    def _legend(self) -> str:
        """Return a text on which joint each coordinate q_1, q_2, ... belongs to."""
        moving, coordinates = self.moving, zip(self.q, self._tree.coordinates, strict=True)
        joints = [f"{q} {joint.name}{' [m]' * (joint.unit == 'm')}" for q, joint in coordinates if q in moving]
        others = ["the other joints do not move the frame"] * (0 < len(moving) < len(self.q))
        return f"{self.title}: {'; '.join((*joints, *others)) or 'no joint moves the frame'}"

    def _joints_to(self, body: int) -> list[Joint]:
        joints: list[Joint] = []
        while body:
            joints.append(self._tree.joints[body - 1])
            body = joints[-1].parent
        return joints[::-1]

    def _column(self, joint: Joint) -> int:
        leader = joint if joint.mimic is None else self._tree.joints[joint.mimic.leader - 1]
        return self._columns[leader.name]

    def _position(self, joint: Joint) -> Expr:
        """Return the coordinate of a joint, in that of its leader where it follows one."""
        q = self.q[self._column(joint)]
        return q if joint.mimic is None else exact(joint.mimic.multiplier) * q + exact(joint.mimic.offset)

    def _derive(self, name: str) -> Any:
        what, _, number = name.partition(" ")
        return getattr(self, f"_find_{what}")(*map(int, number.split()))

    def _find_R(self) -> Exprs:
        lever: Exprs = self.form("lever 0")
        return lever

    def _find_S(self) -> Exprs:
        return eq.compose(self.form(f"attitude {len(self._path)}"), _entries(self._frame.S))

    def _find_jacobian(self) -> Exprs:
        linear = [part.diff(q) for part in self.form("R") for q in self.q]
        return (*linear, *(spin[row] for row in range(3) for spin in self._spins()))

    def _find_v(self, first_row: int = 0) -> Exprs:
        jacobian, dof = self.form("jacobian"), len(self.q)
        rows = range(first_row, first_row + 3)
        return tuple(sum(jacobian[row * dof + k] * qd for k, qd in enumerate(self.qd)) for row in rows)

    def _find_omega(self) -> Exprs:
        return self._find_v(3)

    def _find_attitude(self, number: int) -> Exprs:
        """Return the attitude of the body behind so many joints (E5)."""
        if not number:
            return _IDENTITY
        return eq.compose(self.form(f"attitude {number - 1}"), self._turn(self._path[number - 1]))

    def _turn(self, joint: Joint) -> Exprs:
        """Return the rotation from the axes of a joint's body to those of its parent (E5)."""
        turns = joint.axis.turns
        if not turns:
            return _entries(joint.S)
        angle = exact(turns) * self._position(joint)
        return eq.compose(_entries(joint.S), eq.hinge_rotation(_axis(joint), _trig(angle)))

    def _find_lever(self, number: int) -> Exprs:
        """Return the frame's origin in the axes of the body behind so many joints, from its reference point (E7)."""
        point: Exprs = self._points[number]
        if number == len(self._path):
            return point
        joint = self._path[number]
        behind = eq.rotate(self._turn(joint), self.form(f"lever {number + 1}"))
        shift = exact(joint.axis.shifts) * self._position(joint)
        along = eq.scale(eq.rotate(_entries(joint.S), _axis(joint)), shift)
        return eq.add(point, eq.add(along, behind))

    def _spins(self) -> list[Exprs]:
        """Return the angular velocity of the frame for each coordinate's rate (E2)."""
        spins: list[Any] = [(0, 0, 0)] * len(self.q)
        for number, joint in enumerate(self._path):
            column, position = self._column(joint), self._position(joint)
            axis = eq.rotate(self.form(f"attitude {number}"), eq.rotate(_entries(joint.S), _axis(joint)))
            ratio = exact(joint.axis.turns) * position.diff(self.q[column])
            spins[column] = eq.add(spins[column], eq.scale(axis, ratio))
        return spins


def _exact_point(point: Sequence[float]) -> Exprs:
    """Return a point [m] as exact numbers; what rounding left is 0."""
    left = _ZERO_LENGTH * max(map(abs, point))
    return tuple(sympy.S.Zero if abs(value) <= left else exact(value) for value in point)


def _entries(S: Any) -> Exprs:
    return tuple(map(exact_entry, S.ravel().tolist()))


def _axis(joint: Joint) -> Exprs:
    return tuple(map(exact_entry, joint.n.tolist()))
