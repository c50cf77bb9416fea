"""Loops that close inside a program: all coordinates of a tree, and their derivatives, from those that are driven.

A closed mechanism is a tree of which frames meet in pairs. The conditions c(q_all) = 0 of its loops (E1 and E2, or a
distance) determine the dependent coordinates from q. Newton steps from a start that is a function of q alone solve
them; with A and B, the derivatives of c by the dependent coordinates and by q, follow

    q_all' = G q',  G = (1, -A^-1 B),    q_all'' = G q'' + g,  g = (0, -A^-1 c''(q'' = 0)).

A is solved in the sense of least squares, so that conditions may say the same twice; those that fold to 0, such as z
in a plane, cost nothing. Coordinates are NaN where the loops do not close, or where A loses its rank.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from hingepair.engine.derivatives import pushforward, variables
from hingepair.engine.trace import arc_tangent, square_root, where_less
from hingepair.equations import trees as eq
from hingepair.equations.spatial import (
    IDENTITY_MATRIX,
    WORLD_UNIT_VECTORS,
    ZERO_VECTOR,
    Scalar,
    Vector,
    cross,
    dot,
    rotate,
    scale,
    subtract,
)
from hingepair.numeric.blocks import cosine, sine

# Loops with a larger gap, over the size of the mechanism, count as open; of float32 and float64. At an angle of many
# radians, whose rounding is larger, the gap may be larger in proportion.
MAX_GAPS: Final = (1e-4, 1e-12)
# Least pivots of A over the entries of A and B; less is a dead point.
MIN_TRANSMISSIONS: Final = (1e-3, 1e-8)
_MAX_GROWTH: Final = 0.4  # of the rates by those of the coordinates, in a step of a rollout
PRECISION: Final = 1 + 2.0**-30  # which is 1 in float32
CONDITIONS: Final = {"ball": 3, "hinge": 5, "weld": 6, "distance": 1}
"""Kinds of loops - a shared point, point and axis, or frame, and two points at a distance - and their conditions."""
# Axes of the first and of the second frame that stay square to each other, where more than a point is shared.
_SQUARE: Final = {"ball": (), "hinge": ((0, 2), (1, 2)), "weld": ((0, 2), (1, 2), (0, 1))}


class Chain(NamedTuple):
    """The joints that close one or several loops together, from the last body that carries them all. Coordinates are
    known by keys, see `Closure.key`.
    """

    joints: tuple[int, ...]  # numbers of the joints in the tree
    loops: tuple[int, ...]  # places of the loops
    dependent: tuple[int, ...]  # keys of the coordinates that the loops determine
    driving: tuple[int, ...]  # keys of those that move the chain: in q, or dependent ones of chains before
    turning: tuple[bool, ...]  # for each of these, whether a full turn leads back to the start
    start: str  # where Newton steps start: "exact", "turn", "range" or "line", see `Chains._start`
    source: int  # key of the coordinate by which the start is a series
    terms: int  # of the series of a start, or steps along the line
    steps: int  # Newton steps
    # Of "line": conditions that determine the dependent coordinates where the mechanism is assembled, and the sign of
    # the determinant of their derivatives there. Where it is another one, the loops are closed in another assembly.
    rows: tuple[int, ...] = ()
    sign: float = 1.0


class Closure(NamedTuple):
    """Structure of the loops of a robot."""

    columns: tuple[int | None, ...]  # for each coordinate in q, its column in the tree's; None of a length
    lengths: tuple[int | None, ...]  # for each coordinate in q, the loop whose length it is; None of a joint
    loops: tuple[str, ...]  # kinds
    bodies: tuple[tuple[int, int], ...]  # for each loop, the numbers of its two bodies
    chains: tuple[Chain, ...]
    turning: tuple[bool, ...]  # for each coordinate in q, whether a full turn leads back to the start

    def key(self, k: int) -> int:
        """Return by what the k-th coordinate in q is known: its column in the tree, or -1 - k of a length."""
        column = self.columns[k]
        return -1 - k if column is None else column

    @property
    def size(self) -> int:
        """How many numbers `Chains` takes."""
        return 2 + 25 * len(self.loops) + sum(start_size(chain) for chain in self.chains)


def start_size(chain: Chain) -> int:
    """Return how many numbers the start of a chain has."""
    unknowns, driving = len(chain.dependent), len(chain.driving)
    return driving + unknowns if chain.start == "line" else 2 + unknowns * (2 + 2 * chain.terms)


class Condition(NamedTuple):
    """A condition of a loop at given coordinates."""

    loop: int  # place of the loop
    gap: Scalar  # its value [m]; an angle times the size of the mechanism
    row: dict[int, Scalar]  # its derivatives, by `Closure.key`
    wrench: eq.Rates  # force and torque by which it holds the first body, axes of the body that carries the chain


class Series(NamedTuple):
    """A coordinate as winding s + mean + the sum of a_k cos(k angle) + b_k sin(k angle)."""

    winding: Scalar
    mean: Scalar
    a: Sequence[Scalar]
    b: Sequence[Scalar]

    def value(self, s: Scalar, sin: Scalar, cos: Scalar) -> Scalar:
        """Return its value at s, for the sine and the cosine of the angle."""
        (u1, u2), (v1, _) = _clenshaw(self.a, cos), _clenshaw(self.b, cos)
        return self.mean + self.winding * s + (cos * u1 - u2) + sin * v1

    def slope(self) -> Series:
        """Return its derivative by s, where that is the angle."""
        a, b = ([x * float(k) for k, x in enumerate(part, 1)] for part in (self.b, self.a))
        return Series(0.0, self.winding, a, [-x for x in b])


def _clenshaw(coefficients: Sequence[Scalar], x: Scalar) -> tuple[Scalar, Scalar]:
    """Return u1 and u2 of Clenshaw's recurrence u_k = a_k + 2 x u_(k+1) - u_(k+2), for a_1, a_2, ..."""
    now, after, double = 0.0, 0.0, x + x
    for a in reversed(coefficients):
        now, after = a + (double * now - after), now
    return now, after


class _Factor(NamedTuple):
    """A chain where it is closed."""

    chain: Chain
    matrix: list[list[Scalar]]  # A, derivatives of its conditions by its dependent coordinates
    by_driving: list[list[Scalar]]  # for each coordinate that drives it, derivatives of the dependent ones
    curvatures: list[Scalar] | None  # second derivatives by the one that drives it, where they are known exactly


class Chains:
    """All coordinates of a tree with loops, from q, for numbers, arrays or traced values.

    Args:
        closure: structure of the loops.
        numbers: `PRECISION` and the size of the mechanism; of each loop, R and S of both frames in the axes of their
            bodies, and the length; of each chain the numbers of its start.
        links: the joints of the tree.
        ratios: for each joint its multiplier and offset.
        joint_columns: for each joint its column among the tree's coordinates.
        q: the coordinates of the closed mechanism.
    """

    def __init__(
        self,
        closure: Closure,
        numbers: Sequence[Scalar],
        links: Sequence[eq.Link],
        ratios: Sequence[tuple[Scalar, Scalar]],
        joint_columns: Sequence[int],
        q: Sequence[Scalar],
    ) -> None:
        self.closure, self._links, self._ratios, self._joint_columns = closure, links, ratios, joint_columns
        self._q: dict[int, Scalar] = {closure.key(k): value for k, value in enumerate(q)}
        left = iter(numbers)

        def take(count: int) -> tuple[Scalar, ...]:
            return tuple(next(left) for _ in range(count))

        self._precision, self._size = take(2)
        self._frames: list[Any] = [((take(3), take(9)), (take(3), take(9)), take(1)[0]) for _ in closure.loops]
        self._starts = [take(start_size(chain)) for chain in closure.chains]
        self._width = max(joint_columns, default=-1) + 1
        self._close()

    # ---- conditions of one chain

    def conditions(self, chain: Chain, values: Mapping[int, Scalar]) -> list[Condition]:
        """Return the conditions of a chain at values by key."""
        places = {number: k for k, number in enumerate(chain.joints, 1)}  # 0: the body that carries all
        own = [self._links[number - 1] for number in chain.joints]
        links = [link._replace(parent=places.get(link.parent, 0)) for link in own]
        moved = ((self._joint_columns[number - 1], *self._ratios[number - 1]) for number in chain.joints)
        q = [values[column] * ratio + offset for column, ratio, offset in moved]
        poses = eq.poses(links, placements(links, q), IDENTITY_MATRIX)
        found = []
        for place in chain.loops:
            ends = [places.get(body, 0) for body in self.closure.bodies[place]]
            *frames, length = self._frames[place]
            pair = [eq.frame_pose(poses[body], *frame) for body, frame in zip(ends, frames, strict=True)]
            first, second = (
                eq.point_jacobian_columns(links, poses, body, pose.d) for body, pose in zip(ends, pair, strict=True)
            )
            common = eq.joints_to_base(links, ends[0]) & eq.joints_to_base(links, ends[1])
            apart = [
                (subtract(v1, v2), subtract(w1, w2)) if k not in common else (ZERO_VECTOR, ZERO_VECTOR)
                for k, ((v1, w1), (v2, w2)) in enumerate(zip(first, second, strict=True), 1)
            ]
            own_length = place in self.closure.lengths
            key = -1 - self.closure.lengths.index(place) if own_length else 0
            length = values[key] if own_length else length
            for gap, (force, torque) in _gaps(self.closure.loops[place], pair[0], pair[1], length, self._size):
                row: dict[int, Scalar] = {key: -1.0} if own_length else {}
                for number, (v, omega) in zip(chain.joints, apart, strict=True):
                    column, (ratio, _) = self._joint_columns[number - 1], self._ratios[number - 1]
                    row[column] = row.get(column, 0.0) + (dot(force, v) + dot(torque, omega)) * ratio
                found.append(Condition(place, gap, row, (force, torque)))
        return found

    def _biases(self, chain: Chain, qd: Sequence[Scalar]) -> list[Scalar]:
        """Return the second time derivatives of the conditions of a chain at q'' = 0, of traced values."""
        keys, rates = (*chain.driving, *chain.dependent), self.rates(qd)
        at = variables([self._q[key] for key in keys])
        change = [(x, qd[-1 - key] if key < 0 else rates[key]) for x, key in zip(at, keys, strict=True)]
        gaps = [one.gap for one in self.conditions(chain, dict(zip(keys, at, strict=True)))]
        held = [(rate, 0.0) for _, rate in change]
        return pushforward(pushforward(gaps, change), [*held, *change])

    # ---- the solution

    def _start(self, place: int) -> list[Scalar]:
        """Return where the dependent coordinates of a chain are sought from."""
        chain = self.closure.chains[place]
        if chain.start == "line":
            return self._along_line(chain, self._starts[place])
        series, at = self._series(place)
        return [one.value(*at) for one in series]

    def _series(self, place: int) -> tuple[list[Series], tuple[Scalar, Scalar, Scalar]]:
        """Return the series of the dependent coordinates of a chain, and their arguments: s, sine and cosine."""
        chain, (centre, share, *numbers) = self.closure.chains[place], self._starts[place]
        size, terms, s = 2 + 2 * chain.terms, chain.terms, self._q[chain.source]
        rows = [numbers[k : k + size] for k in range(0, len(numbers), size)]
        series = [Series(row[0], row[1], row[2 : 2 + terms], row[2 + terms :]) for row in rows]
        if chain.start != "range":  # a turn leads back
            return series, (s, sine(s), cosine(s))
        x = (s - centre) * share  # from -1 to 1 between dead points
        x = where_less(x, -1.0, -1.0, where_less(1.0, x, 1.0, x))
        rest = 1.0 - x * x
        return series, (s, square_root(where_less(rest, 1e-12, 1e-12, rest)), x)  # the derivative stays finite

    def _along_line(self, chain: Chain, assembled: Sequence[Scalar]) -> list[Scalar]:
        """Return the dependent coordinates of a chain after steps along the line from the assembly to q."""
        count, steps = len(chain.driving), list[Scalar]()
        origin, found = assembled[:count], list(assembled[count:])
        for key, turns, start in zip(chain.driving, chain.turning, origin, strict=True):
            way = self._q[key] - start
            way = arc_tangent(sine(way), cosine(way)) if turns else way
            steps.append(way * (1 / chain.terms))
        for number in range(chain.terms):
            here = [start + step * float(number) for start, step in zip(origin, steps, strict=True)]
            values = dict(zip((*chain.driving, *chain.dependent), (*here, *found), strict=True))
            conditions = self.conditions(chain, values)
            ahead = [
                _total(
                    (one.gap, *(one.row.get(key, 0.0) * step for key, step in zip(chain.driving, steps, strict=True)))
                )
                for one in conditions
            ]
            found = _stepped(chain, conditions, ahead, found)
        return found

    def _close(self) -> None:
        """Close all loops."""
        self._G: dict[int, dict[int, Scalar]] = {self.closure.key(k): {k: 1.0} for k in range(len(self._q))}
        self._factors: list[_Factor] = []
        self._closed: list[Condition] = []
        for place, chain in enumerate(self.closure.chains):
            known = {key: self._q[key] for key in chain.driving}
            found = self._start(place)
            for _ in range(chain.steps):
                conditions = self.conditions(chain, known | dict(zip(chain.dependent, found, strict=True)))
                found = _stepped(chain, conditions, [one.gap for one in conditions], found)
            conditions = self.conditions(chain, known | dict(zip(chain.dependent, found, strict=True)))
            matrix = _derivatives(conditions, chain.dependent)
            sides = [[-one.row.get(key, 0.0) for one in conditions] for key in chain.driving]
            by_driving, pivots = _least_squares(matrix, sides)
            doubt = self._doubt(chain, conditions, pivots)
            if chain.start == "line":
                volume = _determinant([matrix[row] for row in chain.rows]) * chain.sign
                doubt = doubt + where_less(0.0, volume, 0.0, math.nan)
            self._closed += conditions
            curvatures: list[Scalar] | None = None
            if chain.start == "exact":  # which hold next to a change point, too, where A is ill conditioned
                series, at = self._series(place)
                slopes = [one.slope() for one in series]
                by_driving, curvatures = [[x.value(*at) for x in slopes]], [x.slope().value(*at) for x in slopes]
            self._factors.append(_Factor(chain, matrix, by_driving, curvatures))
            for i, (key, value) in enumerate(zip(chain.dependent, found, strict=True)):
                self._q[key] = value + doubt
                sums: dict[int, Scalar] = {}
                for driver, column in zip(chain.driving, by_driving, strict=True):
                    for k, x in self._G[driver].items():
                        sums[k] = sums.get(k, 0.0) + (column[i] + doubt) * x
                self._G[key] = sums

    def _doubt(self, chain: Chain, conditions: Sequence[Condition], pivots: Sequence[Scalar]) -> Scalar:
        """Return NaN where a loop is open, or at a dead point, else 0."""
        max_gap, min_transmission = (
            where_less(1.0, self._precision, double * double, single * single)
            for single, double in (MAX_GAPS, MIN_TRANSMISSIONS)
        )
        drivers = zip(chain.driving, chain.turning, strict=True)
        turned = _total(self._q[key] * self._q[key] for key, turns in drivers if turns)
        limit = max_gap * (self._size * self._size) * (1.0 + turned)
        doubt = where_less(_total(one.gap * one.gap for one in conditions), limit, 0.0, math.nan)
        largest = _total(entry * entry for one in conditions for entry in one.row.values())
        for pivot in pivots:
            doubt = doubt + where_less(largest * min_transmission, pivot, 0.0, math.nan)
        return doubt

    # ---- what users of the chains ask for

    def coordinates(self) -> tuple[Scalar, ...]:
        """Return all coordinates of the tree."""
        return tuple(self._q[column] for column in range(self._width))

    def gaps(self) -> tuple[Scalar, ...]:
        """Return by how much each loop is open [m], with angles times the size of the mechanism."""
        loops = range(len(self.closure.loops))
        return tuple(square_root(_total(one.gap * one.gap for one in self._closed if one.loop == k)) for k in loops)

    def transfer(self) -> list[dict[int, Scalar]]:
        """Return for each coordinate of the tree its derivatives by those in q on which it depends, a row of G."""
        return [self._G[column] for column in range(self._width)]

    def rates(self, qd: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Return the rates of all coordinates of the tree, G q'."""
        return tuple(_total(x * qd[k] for k, x in row.items()) for row in self.transfer())

    def bias(self, qd: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Return the second derivatives of all coordinates of the tree at q'' = 0, g."""
        found: dict[int, Scalar] = {}
        for chain, matrix, by_driving, curvatures in self._factors:
            if curvatures is None:
                (left,), _ = _least_squares(matrix, [self._biases(chain, qd)])
            else:
                rate = self.rates(qd)[chain.source]
                left = [-x * (rate * rate) for x in curvatures]
            for i, (key, value) in enumerate(zip(chain.dependent, left, strict=True)):
                parts = zip(chain.driving, by_driving, strict=True)
                found[key] = _total(found.get(driver, 0.0) * column[i] for driver, column in parts) - value
        return tuple(found.get(column, 0.0) for column in range(self._width))

    def accelerations(self, qd: Sequence[Scalar], qdd: Sequence[Scalar]) -> tuple[Scalar, ...]:
        """Return the second derivatives of all coordinates of the tree, G q'' + g."""
        return tuple(
            _total(x * qdd[k] for k, x in row.items()) + g
            for row, g in zip(self.transfer(), self.bias(qd), strict=True)
        )

    def crossing(self, qd: Sequence[Scalar], step: Scalar) -> Scalar:
        """Return NaN where a step of this length [s] leads to a dead point, else 0.

        At a distance D = L - q, G grows as 1 / sqrt(D): D is passed in a step where G would grow by half of itself.
        Steps of semi-implicit Euler halve D then, and pass it never.
        """
        rates, bias, doubt = self.rates(qd), self.bias(qd), 0.0
        slides = {
            column for column, link in zip(self._joint_columns, self._links, strict=True) if not link.axis.turns
        }
        for chain, *_ in self._factors:
            weights = [1.0 if key in slides else self._size * self._size for key in chain.dependent]
            pairs = [(rates[key] * weight, key) for key, weight in zip(chain.dependent, weights, strict=True)]
            growth = _total(rate * bias[key] for rate, key in pairs)
            square = _total(rate * rates[key] for rate, key in pairs)
            doubt = doubt + where_less(_MAX_GROWTH * square, step * growth, math.nan, 0.0)
        return doubt

    def wrenches(self, poses: Sequence[eq.Pose]) -> tuple[Scalar, ...]:
        """Return for each condition of all loops the wrench on the second body by which it acts, world axes, six
        numbers each. `poses` are those of the bodies of the tree.
        """
        carriers = {
            place: poses[self._links[chain.joints[0] - 1].parent]
            for chain in self.closure.chains
            for place in chain.loops
        }
        return tuple(
            -x for one in self._conditions() for part in one.wrench for x in rotate(carriers[one.loop].S, part)
        )

    def loop_jacobian(self) -> tuple[Scalar, ...]:
        """Return the derivatives of the conditions of all loops by all coordinates of the tree, as a flat tuple row
        by row: those of a loop's points, then of its angles times the size of the mechanism.
        """
        return tuple(one.row.get(column, 0.0) for one in self._conditions() for column in range(self._width))

    def _conditions(self) -> list[Condition]:
        """Return the conditions of all loops in their order, NaN where they cannot be closed."""
        found = [one for chain in self.closure.chains for one in self.conditions(chain, self._q)]
        return sorted(found, key=lambda one: one.loop)


def placements(links: Sequence[eq.Link], q: Sequence[Scalar]) -> list[eq.Placement]:
    """Return the placements of joints at their coordinates."""
    angles = [link.axis.turn(value) if link.axis.turns else None for link, value in zip(links, q, strict=True)]
    return eq.joint_placements(links, [None if x is None else (sine(x), cosine(x)) for x in angles], q)


def condition_count(closure: Closure) -> int:
    """Return the number of conditions of all loops."""
    return sum(CONDITIONS[kind] for kind in closure.loops)


def _gaps(kind: str, first: eq.Pose, second: eq.Pose, length: Scalar, size: Scalar) -> list[tuple[Scalar, eq.Rates]]:
    """Return the values of a loop's conditions, each with the pair (f, t) of vectors in its rate
    f . (v1 - v2) + t . (omega1 - omega2).
    """
    apart = subtract(first.d, second.d)
    if kind == "distance":
        distance = square_root(dot(apart, apart))
        return [(distance - length, (scale(apart, 1.0 / distance), ZERO_VECTOR))]
    found = [(gap, (axis, ZERO_VECTOR)) for gap, axis in zip(apart, WORLD_UNIT_VECTORS, strict=True)]
    for i, j in _SQUARE[kind]:
        a, b = _columns(first)[i], _columns(second)[j]
        found.append((dot(a, b) * size, (ZERO_VECTOR, scale(cross(a, b), size))))
    return found


def _derivatives(conditions: Sequence[Condition], keys: Sequence[int]) -> list[list[Scalar]]:
    """Return the derivatives of conditions by some coordinates, row by row."""
    return [[one.row.get(key, 0.0) for key in keys] for one in conditions]


def _stepped(
    chain: Chain, conditions: Sequence[Condition], gaps: Sequence[Scalar], found: Sequence[Scalar]
) -> list[Scalar]:
    """Return the dependent coordinates of a chain after a Newton step."""
    (moved,), _ = _least_squares(_derivatives(conditions, chain.dependent), [gaps])
    return [x - dx for x, dx in zip(found, moved, strict=True)]


def _columns(pose: eq.Pose) -> tuple[Vector, Vector, Vector]:
    S = pose.S
    return (S[0], S[3], S[6]), (S[1], S[4], S[7]), (S[2], S[5], S[8])


def _least_squares(
    matrix: Sequence[Sequence[Scalar]], sides: Sequence[Sequence[Scalar]]
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """Return for each right side the x that minimises |A x - side|, and the squares of the pivots of A.

    The columns of A are made orthogonal one after the other, as by Gram and Schmidt, and with them the sides: what
    remains of a later column then has no part along an earlier one, however ill A is conditioned.
    """
    count = len(matrix[0])
    columns = [[row[j] for row in matrix] for j in range(count)]
    rests = [list(side) for side in sides]
    upper: list[list[Scalar]] = []
    pivots: list[Scalar] = []
    projected: list[list[Scalar]] = [[] for _ in sides]
    for j, column in enumerate(columns):
        pivot = _total(x * x for x in column)
        share = math.nan if isinstance(pivot, float) and pivot == 0 else 1.0 / pivot
        direction = [x * share for x in column]
        row: list[Scalar] = []
        for other in columns[j + 1 :]:
            part = _total(x * y for x, y in zip(direction, other, strict=True))
            other[:] = [y - part * x for x, y in zip(column, other, strict=True)]
            row.append(part)
        for rest, parts in zip(rests, projected, strict=True):
            part = _total(x * y for x, y in zip(direction, rest, strict=True))
            rest[:] = [y - part * x for x, y in zip(column, rest, strict=True)]
            parts.append(part)
        upper.append(row)
        pivots.append(pivot)
    solutions = []
    for parts in projected:
        x = list(parts)
        for j in reversed(range(count)):
            for k, part in enumerate(upper[j], j + 1):
                x[j] = x[j] - part * x[k]
        solutions.append(x)
    return solutions, pivots


def _determinant(rows: Sequence[Sequence[Scalar]]) -> Scalar:
    """Return the determinant of a matrix, by elimination."""
    found: Scalar = 1.0
    left = [list(row) for row in rows]
    while left:
        first, *others = left
        found = found * first[0]
        share = 1.0 / first[0]
        left = [[x - row[0] * share * y for x, y in zip(row[1:], first[1:], strict=True)] for row in others]
    return found


def _total(parts: Iterable[Scalar]) -> Scalar:
    total: Scalar = 0.0
    for part in parts:
        total = total + part
    return total
