"""Closed forms: the equations evaluated on SymPy expressions, of a pair in t and of a robot's frame in q.

After every equation, products of sines and cosines are converted to sums of sines and cosines where these have fewer
symbols.
"""

from __future__ import annotations

import functools
import itertools
import operator
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

import sympy

from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.pairs.subject import check_single_pair
from hingepair.mechanism.requests import subject_of
from hingepair.mechanism.tree import Joint
from hingepair.plans.pairs import PLANE, SPACE, point_outputs, unit_among
from hingepair.rotations.sequences import find_sequence
from hingepair.symbolic.exact import TIME, Expr, exact, exact_axis, exact_entry, rate, real_symbol
from hingepair.symbolic.trig_sums import cosine_expression, sine_expression
from hingepair.symbolic.writing import RESERVED, ClosedForms, Equation, Exprs, Output

SYMBOLIC_CONSTANTS: Final = ("u1", "u2", "n")
"""Constants of a pair that can stay symbols."""

_IDENTITY = (1, 0, 0, 0, 1, 0, 0, 0, 1)
_ZERO_LENGTH = 4 * 2.0**-53  # of a component of a point beside its largest one: rounding


# ---- a pair


def pair_forms(
    pair: HingePair | PlanarPair,
    motion: Mapping[str, Expr | None] | None = None,
    sequence: str | None = "XYZ",
    symbolic: Collection[str] = (),
    exact_values: Mapping[str, Exprs] | None = None,
) -> ClosedForms:
    """Return closed forms of a pair's motion (E1-E11) as functions of `t`.

    The outputs are `R2`, `S2`, `d`, `v2`, `omega2`, `a2`, `alpha2`, `R1`, `S1`, `v1`, `omega1`, `a1`, `alpha1`, and
    of a point `tip` also `tip`, `tip_v`, `tip_a`; of a planar pair those of `PlanarPair`. Vectors of a planar pair
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
    check_single_pair(pair)
    planar, points = isinstance(pair, PlanarPair), subject_of(pair).points
    kind = PLANE if planar else SPACE
    names = (*kind.levels, *point_outputs(points))
    outputs = {}
    for name in names:
        unit = unit_among(names, name)
        outputs[name] = Output(kind.shapes.get(name, (3 - planar,)), f" [{unit}]" if unit != "1" else "")
    given = {name: expr for name, expr in (motion or {}).items() if expr is not None}
    values = {key: tuple(map(sympy.sympify, exprs)) for key, exprs in (exact_values or {}).items()}
    used = ["t", *(label for name, output in outputs.items() for label in output.labels(name))]
    used += [name + "d" * order for name in kind.coordinates if name not in given for order in range(3)]
    used += [f"{key}_{axis}" for key in symbolic for axis in "xyz"]
    constants = set().union(*(expr.free_symbols for expr in [*given.values(), *itertools.chain(*values.values())]))
    for name in sorted(symbol.name for symbol in constants - {TIME}):
        if name in used or name in RESERVED:
            expected = "constants that are called otherwise than coordinates, outputs and words of Python and C"
            raise ArgumentError("symbolic", expected, quoted(name))
    *R1, psi = (given.get(name, sympy.Function(name, real=True)(TIME)) for name in kind.coordinates)
    found: dict[str, Any] = {**_constants(pair, symbolic, values), "psi": psi}
    found |= {"R1": (*R1[:2], sympy.S.Zero), "phi1": R1[2]} if planar else {"R1": tuple(R1[:3]), "phi": tuple(R1[3:])}
    equations = {**_PAIR, **(_IN_PLANE if planar else _attitude_equations(sequence or "XYZ"))}
    for point in points:
        i, name, arm = point.body, point.name, f"arm of {point.name}"
        equations[arm] = (eq.rotate, (f"S{i}", point_key(name)))
        equations[name] = (eq.add, (f"R{i}", arm))
        equations[f"rate of {name}"] = (eq.cross, (f"omega{i}", arm))
        equations[f"{name}_v"] = (eq.add, (f"v{i}", f"rate of {name}"))
        equations[f"change of {name}"] = (eq.point_acceleration, (f"omega{i}", f"alpha{i}", arm))
        equations[f"{name}_a"] = (eq.add, (f"a{i}", f"change of {name}"))
    rates = {f"{name}{'d' * k}": (name, k) for name in kind.coordinates for k in (1, 2)}
    return ClosedForms(pair.name or "", outputs, equations, found, rates)


def _constants(
    pair: HingePair | PlanarPair, symbolic: Collection[str], exact_values: Mapping[str, Exprs]
) -> dict[str, Exprs]:
    """Return u1, u2, n, home and points: symbols, `exact_values`, or exact numbers made of the pair's floats."""
    subject = subject_of(pair)
    floats = {key: tuple(array.ravel().tolist()) for key, array in subject.arrays.items()}
    floats |= {point_key(name): tuple(R.tolist()) for name, R in {**pair.points1, **pair.points2}.items()}
    found: dict[str, Exprs] = {"n": (0, 0, 1), "home": _IDENTITY}
    for key, value in floats.items():
        if key in symbolic:
            found[key] = tuple(real_symbol(f"{key}_{axis}") for axis in "xyz"[: len(value)])
        elif key in exact_values:
            found[key] = exact_values[key]
        elif key == "home":
            found[key] = tuple(map(exact_entry, value)) if subject.has_home else _IDENTITY
        else:
            found[key] = exact_axis(value) if key == "n" else tuple(map(exact, value))
        if len(found[key]) == 2:
            found[key] = (*found[key], 0)
    return found


def point_key(name: str) -> str:
    """Return the name of the vector to a point, which its output has to be told from."""
    return f"vector to {name}"


def _trig(angle: Expr) -> tuple[Expr, Expr]:
    """Return sine and versine of an angle."""
    return sine_expression(angle), 1 - cosine_expression(angle)


def _rates(expr: Any) -> Any:
    return tuple(map(rate, expr)) if isinstance(expr, tuple) else rate(expr)


def _attitude_equations(sequence: str) -> dict[str, Equation]:
    """Return the equations of the attitude of body 1 by Euler angles (E4, E10)."""
    order = find_sequence(sequence)
    return {
        "angles": (order.angles, ("phi",)),
        "trig": (
            lambda angles: tuple(f(one) for one in angles for f in (sine_expression, cosine_expression)),
            ("angles",),
        ),
        "S1": (order.attitude, ("trig",)),
        "axes": (order.axes, ("trig",)),
        "phid": (_rates, ("phi",)),
        "omega1": (order.angular_velocity, ("axes", "phid")),
    }


def _difference(R: Exprs, r1: Exprs, r2: Exprs) -> Exprs:
    return eq.add(R, eq.subtract(r1, r2))


_IN_PLANE: Final[Mapping[str, Equation]] = {
    "S1": (lambda phi: eq.hinge_rotation((0, 0, 1), _trig(phi)), ("phi1",)),
    "omega1": (lambda phi: (0, 0, rate(phi)), ("phi1",)),
}
# Every quantity, of others (E5-E9): r1 = S1 u1 and r2 = S2 u2 lead to the hinge point.
_PAIR: Final[Mapping[str, Equation]] = {
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


def frame_forms(robot: Mechanism, frame: str | None = None) -> ClosedForms:
    """Return closed forms of the motion of one frame of a robot whose base rests at the origin (E2, E5, E7), in the
    symbols `q` and `qd` of the robot's coordinates and rates: `R` (3, 1), `S` (3, 3), `jacobian` (6, dof) with the
    rows of v before those of omega, `v` (3, 1) and `omega` (3, 1), all in world axes.

    Each number of the robot is the rational number that its shortest decimal form shows; a length that rounding left
    is 0. An entry of a rotation that equals 0, 1, -1 or the root of a simple fraction within rounding is exactly that
    number.

    Args:
        robot: a robot with a fixed base.
        frame: name of a link, a joint or another frame; None means the last link, if there is only one.

    Raises:
        ArgumentError: the base is free, or there is no such frame.
    """
    if robot.base != "fixed":
        expected = "a robot with base='fixed': the motion of its frames relative to its base"
        raise ArgumentError("scene_or_pair", expected, f"base={robot.base!r}")
    tree = tree_of(robot)
    last = tree.plain().tips
    if frame is None and len(last) != 1:
        which = f"the name of a link or joint, since {robot.name} ends in {len(last)} links: {choices(last)}"
        raise ArgumentError("frame", which, "none")
    name = last[0] if frame is None else frame
    place, path = tree.known_frame("frame", name), list[Joint]()
    body = place.body
    while body:
        path.insert(0, tree.joints[body - 1])
        body = path[0].parent
    moving = tree.coordinates
    q, qd = (tuple(real_symbol(f"{letter}_{k + 1}") for k in range(len(moving))) for letter in ("q", "qd"))
    by_name = dict(zip((joint.name for joint in moving), q, strict=True))
    own = [by_name[joint.rule.leader] for joint in path]
    positions = [
        one if joint.mimic is None else exact(joint.mimic.multiplier) * one + exact(joint.mimic.offset)
        for joint, one in zip(path, own, strict=True)
    ]
    found: dict[str, Any] = {"attitude 0": _IDENTITY, f"lever {len(path)}": _exact_point(place.R.tolist())}
    found["axes"] = _entries(place.S)
    equations: dict[str, Equation] = {
        "R": (tuple, ("lever 0",)),
        "S": (eq.compose, (f"attitude {len(path)}", "axes")),
        "v": (functools.partial(_times_rates, qd, 0), ("jacobian",)),
        "omega": (functools.partial(_times_rates, qd, 3), ("jacobian",)),
    }
    spins: list[tuple[Expr, Exprs, Expr]] = []
    for k, (joint, position) in enumerate(zip(path, positions, strict=True)):
        axes, n = _entries(joint.S), tuple(map(exact_entry, joint.n.tolist()))
        turned = eq.hinge_rotation(n, _trig(exact(joint.axis.turns) * position)) if joint.axis.turns else _IDENTITY
        along = eq.scale(eq.rotate(axes, n), exact(joint.axis.shifts) * position)
        found[f"turn {k}"] = eq.compose(axes, turned)
        found[f"foot {k}"] = eq.add(_exact_point(joint.u.tolist()), along)
        equations[f"attitude {k + 1}"] = (eq.compose, (f"attitude {k}", f"turn {k}"))
        # The frame's origin in the axes of the body that carries a joint, from its reference point (E7).
        equations[f"behind {k}"] = (eq.rotate, (f"turn {k}", f"lever {k + 1}"))
        equations[f"lever {k}"] = (eq.add, (f"foot {k}", f"behind {k}"))
        spins.append((own[k], eq.rotate(axes, n), exact(joint.axis.turns) * position.diff(own[k])))
    attitudes = tuple(f"attitude {k}" for k in range(len(path)))
    equations["jacobian"] = (functools.partial(_jacobian, q, spins), ("R", *attitudes))
    rows = [f"{row}_{axis}" for row in ("Jv", "Jomega") for axis in "xyz"]
    labels = [f"{row}{column}" for row in rows for column in range(1, len(q) + 1)]
    outputs = {
        "R": Output((3,), ": position of the frame's origin, world axes [m]"),
        "S": Output((3, 3), ": rotation from the frame's axes to those of the world"),
        "jacobian": Output((6, len(q)), ": (v, omega) = jacobian @ qd, world axes", labels),
        "v": Output((3,), ": velocity of the frame's origin, world axes [m/s]"),
        "omega": Output((3,), ": angular velocity of the frame, world axes [rad/s]"),
    }
    rates = {f"qd_{k + 1}": (f"q_{k + 1}", 1) for k in range(len(q))}
    title = f"frame {name} of {robot.name}"
    joints = [
        f"{one} {joint.name}{' [m]' * (joint.unit == 'm')}"
        for one, joint in zip(q, moving, strict=True)
        if one in own
    ]
    others = ["the other joints do not move the frame"] * (0 < len({*own}) < len(q))
    legend = f"{title}: {'; '.join((*joints, *others)) or 'no joint moves the frame'}"
    return ClosedForms(title, outputs, equations, found, rates, q, qd, {*own}, (legend,))


def _jacobian(q: Exprs, spins: Sequence[tuple[Expr, Exprs, Expr]], R: Exprs, *attitudes: Exprs) -> Exprs:
    """Return the rows of v and of omega (E2). `spins` has of each joint on the way to the frame the coordinate, the
    axis in the axes of the body that carries it, and the turn for each unit of the coordinate.
    """
    columns: dict[Expr, Any] = dict.fromkeys(q, (0, 0, 0))
    for (own, axis, ratio), attitude in zip(spins, attitudes, strict=True):
        columns[own] = eq.add(columns[own], eq.scale(eq.rotate(attitude, axis), ratio))
    linear = (part.diff(one) for part in R for one in q)
    return (*linear, *(spin[row] for row in range(3) for spin in columns.values()))


def _times_rates(qd: Exprs, first_row: int, jacobian: Exprs) -> Exprs:
    rows = (jacobian[row * len(qd) : (row + 1) * len(qd)] for row in range(first_row, first_row + 3))
    return tuple(sum(map(operator.mul, row, qd)) for row in rows)


def _exact_point(point: Sequence[float]) -> Exprs:
    """Return a point [m] as exact numbers; what rounding left is 0."""
    left = _ZERO_LENGTH * max(map(abs, point))
    return tuple(sympy.S.Zero if abs(value) <= left else exact(value) for value in point)


def _entries(S: Any) -> Exprs:
    return tuple(map(exact_entry, S.ravel().tolist()))
