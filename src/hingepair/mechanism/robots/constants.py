"""The constants of a robot's programs (T1-T10), from its record: each body in axes whose z axis is its joint's axis.

Where an axis lies along x, y or z of the body, the axes change by exact permutations; masses are added up and shifted
in exact arithmetic (T9), and rounded once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.binding import FOLDED
from hingepair.equations.spatial import cross, matrix_from_columns
from hingepair.mechanism.bodies.body import SECOND_MOMENTS, moments_of
from hingepair.mechanism.bodies.pivots import Resisted, smallest_pivots
from hingepair.mechanism.robots.samples import JointSamples, turned_moments
from hingepair.mechanism.tree import LOAD_FIELDS, Frame, Tree
from hingepair.numeric.arrays import read_only
from hingepair.numeric.blocks import numbers as components
from hingepair.numeric.bounded import UNIT_ROUNDOFF, Bounded
from hingepair.numeric.twofold import Twofold
from hingepair.numeric.unit_vectors import least_axis, polar
from hingepair.plans.bounds import Known
from hingepair.plans.closures import PRECISION
from hingepair.plans.computation import Cache
from hingepair.plans.struts import StrutForm
from hingepair.plans.trees import Form, constant_place
from hingepair.urdf.rigid import ZERO_MASS_PROPERTIES, MassProperties

Exact: TypeAlias = NDArray[np.object_]
"""Array of Fractions; or for bounds of `Bounded`s."""

_ROTATION_ROUNDING: Final = 4 * UNIT_ROUNDOFF  # of an entry made of products of three sines, or of a quaternion
_AXIS_ROUNDING: Final = 2 * UNIT_ROUNDOFF  # of a normalised vector, and what it turns the other axes by

# A program's axes x, y, z in the body's axes, by the absolute components of a joint axis along x, y or z.
_AXES_ALONG: Final = {
    (1.0, 0.0, 0.0): ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    (0.0, 1.0, 0.0): ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
    (0.0, 0.0, 1.0): ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
}


@dataclass(frozen=True, slots=True, eq=False)
class RobotConstants:
    """Constants of a robot's generated programs."""

    tree: Tree  # record of the robot
    free: bool  # whether the base is free, so that its mass counts
    form: Form  # structure of the robot, on which programs depend
    names: tuple[str, ...]  # names of the joints with a coordinate of their own, in the order of q
    numbers: tuple[float, ...]  # the constants that are parameters of programs, in order
    # for each coordinate, the size below which a pivot D is rounding (T5); 0 if D is never that small
    pivot_thresholds: NDArray[np.float64]
    # the same for the six pivots of a free base; shape (6,). 0 for any other base
    base_pivot_thresholds: NDArray[np.float64]
    # for each body, the base first, the rotation from the program's axes to the body's own axes
    axes: tuple[NDArray[np.float64], ...]
    whole: bool  # whether all matter counts with its own body, as wrenches of joints need it (T9)
    # numbers that differ from sample to sample, arrays by place
    varied: Mapping[int, NDArray[np.float64]] = field(default_factory=dict)
    cache: Cache = field(default_factory=Cache, repr=False)  # what is made once for the robot

    @property
    def may_be_singular(self) -> bool:
        """Whether the mass matrix may be singular: a joint or the base may move without any inertia that resists."""
        return bool(self.pivot_thresholds.any() or self.base_pivot_thresholds.any())

    @property
    def overflows(self) -> bool:
        """Whether a mass times the square of a length is too large for a float."""
        finite = all(np.isfinite(column).all() for column in self.varied.values())
        return not (finite and all(map(math.isfinite, self.numbers)))


def robot_constants(tree: Tree, free: bool, whole: bool = False) -> RobotConstants:
    """Return the constants of a robot's programs. The mass of the base counts only if it is free. With `whole`, no
    mass is shifted to parent bodies (T9).
    """
    with np.errstate(all="ignore"):  # what overflows is refused where masses are used
        axes = _axes_of_bodies(tree)
        poses = _poses_in_program_axes(tree, axes)
        *thresholds, force, torque = _pivot_thresholds(tree, axes)
    base_thresholds = (force, torque) if free else (0.0, 0.0)
    exact_poses = [(_numbers_of(S), _numbers_of(u)) for S, u in poses]
    moments = _mass_moments(tree, free, [*map(_numbers_of, axes)], exact_poses, whole)
    numbers = _rounded_numbers(moments[0])
    for k, (joint, (S, u)) in enumerate(zip(tree.joints, poses, strict=True), 1):
        numbers += [*S.ravel().tolist(), *u.tolist(), *_rounded_numbers(moments[k])]
        numbers += [joint.armature, *joint.rule[1:], thresholds[k - 1]]
    numbers += base_thresholds
    closure = tree.closure
    if closure is not None:
        numbers += [PRECISION, closure.size]
        for (first, second), loop in zip(closure.frames, closure.loops, strict=True):
            numbers += [*_numbers_of_frame(axes, first), *_numbers_of_frame(axes, second), loop.length or 0.0]
        numbers += closure.starts
    for strut in tree.struts:
        points = [_numbers_of_frame(axes, frame)[:3] for frame in strut.frames]
        numbers += [*points[0], *points[1], *strut.law.flat()]
    varied = _varied_numbers(tree, free, axes, numbers)
    folded, parameters = split_numbers(numbers, varied)
    form = Form(
        tuple(joint.parent for joint in tree.joints),
        tuple(joint.axis for joint in tree.joints),
        _columns_of_joints(tree),
        folded,
        None if closure is None else closure.form,
        tuple(
            StrutForm(
                (one.frames[0].body, one.frames[1].body),
                len(one.law.knots),
                bool(one.law.limits),
            )
            for one in tree.struts
        ),
    )
    by_column = np.zeros(form.tree_dof)
    for joint, column, value in zip(tree.joints, form.columns, thresholds, strict=True):
        by_column[column] += value * joint.rule.multiplier**2
    if closure is not None:  # each coordinate may move all joints
        by_column = np.full(form.dof, by_column.sum())
    return RobotConstants(
        tree,
        free,
        form,
        tuple(joint.name for joint in tree.coordinates),
        parameters,
        read_only(by_column),
        read_only(np.repeat(base_thresholds, 3)),
        tuple(map(read_only, axes)),
        whole,
        varied,
    )


def _varied_numbers(
    tree: Tree, free: bool, axes: Sequence[NDArray[np.float64]], numbers: Sequence[float]
) -> dict[int, NDArray[np.float64]]:
    """Return, by place among the `numbers` of one robot, arrays of those that differ from sample to sample."""
    found: dict[int, NDArray[np.float64]] = {}
    samples = tree.samples
    if samples is None:
        return found

    def keep(place: int, columns: NDArray[np.float64]) -> None:
        for k, column in enumerate(np.moveaxis(columns, -1, 0), place):
            if (column != numbers[k]).any():
                found[k] = column

    sampled = axes_with_samples(tree, axes)
    for number, joint in enumerate(tree.joints, 1):
        if _is_placed_by_samples(tree, number):
            placed = samples.joints.get(number) or JointSamples(joint.u, joint.S, joint.n)
            back = np.swapaxes(sampled[joint.parent], -1, -2)
            S = back @ placed.S @ sampled[number]
            keep(constant_place(number, "S"), S.reshape(*S.shape[:-2], 9))
            keep(constant_place(number, "u"), (back @ placed.point[..., None])[..., 0])
    for body in range(not free, len(tree.joints) + 1):
        place, matter = constant_place(body, "mass"), samples.matter.get(body)
        if tree.has_sampled_axes(body):
            own = moments_of(tree.joints[body - 1].body, np.zeros(3), np.eye(3))
            keep(place, turned_moments(own if matter is None else own + matter, sampled[body]))
        elif matter is not None:
            moved = turned_moments(matter, axes[body])
            keep(place, moved + numbers[place : place + 10])
    return {place: np.broadcast_to(found[place], samples.shape) for place in sorted(found)}


def axes_with_samples(tree: Tree, axes: Sequence[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Return the rotation of each body from the program's axes to its own, (..., 3, 3) where its joint has samples of
    the axis.
    """
    samples = tree.samples
    return [
        axes_along(samples.joints[body].n) if samples is not None and tree.has_sampled_axes(body) else own
        for body, own in enumerate(axes)
    ]


def _is_placed_by_samples(tree: Tree, number: int) -> bool:
    """Return whether the pose of a joint differs from sample to sample, in the program's axes of its bodies."""
    own = tree.samples is not None and number in tree.samples.joints
    return own or tree.has_sampled_axes(tree.joints[number - 1].parent)


def program_numbers(constants: RobotConstants) -> list[float]:
    """Return a list of all numbers of a robot's programs in order, the folded ones (0, 1, -1) and the parameters."""
    numbers = iter(constants.numbers)
    return [next(numbers) if known is None else known for known in constants.form.known]


def numbers_with_bounds(
    constants: RobotConstants, frames: Sequence[Frame], origins: Sequence[Exact] | None = None
) -> Known:
    """Return the `program_numbers` and, behind them, the `frame_numbers` of all frames, with bounds on their errors.

    Exact are the lengths and masses of the robot's record, the rotation next to each matrix S, and a unit axis along
    each n. S and n may be off by what their rounding to double precision does.

    Args:
        constants: constants of the robot.
        frames: frames.
        origins: of a pair, origins of the frames with bounds on their errors; then each n is exact.
    """
    tree, rounding = constants.tree, _AXIS_ROUNDING if origins is None else 0.0
    with np.errstate(all="ignore"):
        axes = [_bounded(np.eye(3), np.zeros((3, 3)))]
        pairs = zip(constants.axes[1:], tree.joints, strict=True)
        axes += [_axes_with_bounds(P, joint.n, rounding) for P, joint in pairs]
        poses = []
        for joint, P in zip(tree.joints, axes[1:], strict=True):
            back = axes[joint.parent].T
            poses.append((back @ _rotation_with_bounds(joint.S) @ P, back @ _numbers_of(joint.u, Bounded)))
        masses = _mass_moments(tree, constants.free, axes, poses, constants.whole, Bounded)
        stored, exact = program_numbers(constants), _ten_numbers(masses[0])
        for (S, u), moments in zip(poses, masses[1:], strict=True):
            given = stored[len(exact) + 22 : len(exact) + 26]  # armature, multiplier, offset, threshold
            exact += [*S.ravel(), *u, *_ten_numbers(moments), *given]
        exact += stored[len(exact) :]  # the smallest pivots of the base
        stored += frame_numbers(constants, frames)
        for k, frame in enumerate(frames):
            back, R = axes[frame.body].T, _numbers_of(frame.R, Bounded) if origins is None else origins[k]
            exact += [*(back @ R), *(back @ _rotation_with_bounds(frame.S)).ravel()]
        bounds = [
            abs(number - one.value) + one.error if isinstance(one, Bounded) else 0.0
            for number, one in zip(stored, exact, strict=True)
        ]
    errors = (math.inf if math.isnan(bound) else float(bound) * (1 + UNIT_ROUNDOFF) for bound in bounds)
    return Known(tuple(stored), tuple(errors))


def _rotation_with_bounds(S: NDArray[np.float64]) -> Exact:
    """Return the entries of S (3, 3) with bounds on their distances from those of the rotation next to S and of any
    rotation that rounds to S. Entries 0 and 1 of a turn about x, y or z are exact.
    """
    unit = np.abs(S) == 1
    unit &= (np.count_nonzero(S, axis=0) == 1) & (np.count_nonzero(S, axis=1) == 1)[:, None]
    exact = unit.any(axis=0) | unit.any(axis=1)[:, None]
    errors = np.where(exact, 0.0, _distance_from_rotation(S) + _ROTATION_ROUNDING)
    return _bounded(S, errors)


def _axes_with_bounds(P: NDArray[np.float64], n: NDArray[np.float64], rounding: float) -> Exact:
    """Return the entries of P, `axes_along(n)`, with bounds on their errors, where n may be off by `rounding`."""
    if np.isin(P, (-1.0, 0.0, 1.0)).all():  # such a matrix is exact
        return _bounded(P, np.zeros((3, 3)))
    lost = [abs(c.low) + 2.0**-90 + rounding for c in _axes_in_twofold(n)]
    return _bounded(P, np.array(lost).reshape(3, 3))


def _bounded(matrix: NDArray[np.float64], errors: NDArray[np.float64]) -> Exact:
    numbers = zip(matrix.ravel().tolist(), errors.ravel().tolist(), strict=True)
    return np.array([Bounded(x, error) if x or error else 0 for x, error in numbers], dtype=object).reshape(3, 3)


def _distance_from_rotation(S: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return bounds on the distances of the entries of S from those of the next rotation."""
    # With S^T S = I + E, S = Q (I + E/2 + ...) where Q is the next rotation.
    columns = [[Fraction(x) for x in column] for column in S.T.tolist()]
    off = [[sum(x * y for x, y in zip(a, b, strict=True)) - (a is b) for b in columns] for a in columns]
    E = np.abs(np.array([[float(entry) for entry in row] for row in off]))  # exact until it is rounded here
    return np.asarray((0.5 * (np.abs(S) @ E) + 8 * (E**2).sum()) * (1 + 2.0**-40))


def frame_numbers(constants: RobotConstants, frames: Iterable[Frame]) -> list[float]:
    """Return position R and rotation S of Frames, in the program's axes of their bodies, 12 numbers each."""
    return [number for frame in frames for number in _numbers_of_frame(constants.axes, frame)]


def _numbers_of_frame(axes: Sequence[NDArray[np.float64]], frame: Frame) -> list[float]:
    back = axes[frame.body].T
    return [*_matrix_product(back, frame.R).tolist(), *_matrix_product(back, frame.S).ravel().tolist()]


def load_numbers(tree: Tree) -> list[float]:
    """Return stiffness, rest, damping and friction of all joints in a list."""
    return [float(getattr(joint.load, field)) for joint in tree.joints for field in LOAD_FIELDS]


def split_numbers(
    numbers: Iterable[float], varied: Collection[int] = ()
) -> tuple[tuple[float | None, ...], tuple[float, ...]]:
    """Return each number that programs fold (0, 1 or -1), None in place of all others, and these others, the
    parameters; numbers at the places `varied` are parameters in any case.

    >>> split_numbers([1.0, 0.3, 0.0])
    ((1.0, None, 0.0), (0.3,))
    """
    all_numbers = [number + 0.0 for number in numbers]  # no -0.0
    folded = tuple(
        number if number in FOLDED and place not in varied else None for place, number in enumerate(all_numbers)
    )
    return folded, tuple(number for number, known in zip(all_numbers, folded, strict=True) if known is None)


def _columns_of_joints(tree: Tree) -> tuple[int, ...]:
    """Return the column in q of every joint; a mimic joint has that of its leader."""
    places = {joint.name: column for column, joint in enumerate(tree.own_coordinates)}
    return tuple(places[joint.rule.leader] for joint in tree.joints)


def _axes_of_bodies(tree: Tree) -> list[NDArray[np.float64]]:
    """Return the rotation of each body, the base first, from the program's axes to its own."""
    return [np.eye(3), *(axes_along(joint.n) for joint in tree.joints)]


def _poses_in_program_axes(tree: Tree, axes: Sequence[NDArray[np.float64]]) -> list[tuple[Any, Any]]:
    """Return S and u of every joint between the program's axes of the two bodies."""
    backs = [axes[joint.parent].T for joint in tree.joints]
    return [
        (_matrix_product(back, _matrix_product(joint.S, P)), _matrix_product(back, joint.u))
        for joint, back, P in zip(tree.joints, backs, axes[1:], strict=True)
    ]


def axes_along(n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rotations (..., 3, 3) whose third column is along n, (..., 3), of any length, each entry rounded once;
    an exact permutation where a single n is of unit length along x, y or z.
    """
    size = tuple(np.abs(n).tolist()) if n.ndim == 1 else ()
    if size in _AXES_ALONG:
        columns = np.array(_AXES_ALONG[size], float).T
        if n.sum() < 0:  # turned by pi about the new x axis
            columns = columns * (1.0, -1.0, -1.0)
        return columns + 0.0
    high = np.stack(np.broadcast_arrays(*(c.high for c in _axes_in_twofold(n))), axis=-1)
    return np.asarray(high.reshape(*n.shape[:-1], 3, 3) + 0.0)


def _axes_in_twofold(n: NDArray[np.float64]) -> tuple[Twofold, ...]:
    """Return the entries of rotations whose third column is along n, (..., 3), in twice the precision."""
    z: Any = polar(components(n))[0]
    across: Any = cross(components(n), components(least_axis(n)))
    y: Any = polar(tuple(c + 0.0 for c in across))[0]
    return matrix_from_columns(cross(y, z), y, z)


def _matrix_product(A: NDArray[np.float64], B: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return A B, in which products with 0 and 1 are exact, and without -0.0."""
    if B.ndim == 1:
        return _matrix_product(A, B[:, None])[:, 0]
    with np.errstate(all="ignore"):
        product = A[:, :1] * B[:1] + A[:, 1:2] * B[1:2] + A[:, 2:] * B[2:]
    return np.asarray(product + 0.0)


# ---- masses
#
# The mass m, first moment h and second moment N of a body about a point are one matrix, [[N, h], [h^T, m]]. A pose
# T = [[S, u], [0, 1]] carries it into other axes and to another point, T [...] T^T.


def _mass_moments(
    tree: Tree,
    free: bool,
    axes: Sequence[Exact],
    poses: Sequence[tuple[Exact, Exact]],
    whole: bool,
    kind: Callable[[float], Any] = Fraction,
) -> list[Exact]:
    """Return the moments of every body, the base first (0 if held), shifted to the parents (T9) unless `whole`."""
    bodies = [tree.base if free else ZERO_MASS_PROPERTIES, *(joint.body for joint in tree.joints)]
    moments = [_moved(_moments_of_body(body, kind), P.T) for body, P in zip(bodies, axes, strict=True)]
    for k in () if whole else range(len(tree.joints), 0, -1):
        joint, own = tree.joints[k - 1], moments[k]
        moments[k] = own = _shortened(own)
        # No matter of a screw moves with both bodies; and what does where a joint is placed by samples differs.
        if (joint.axis.turns and joint.axis.shifts) or _is_placed_by_samples(tree, k):
            continue
        # What moves with both bodies: matter on the axis of a hinge, and the turning of what slides.
        both = slice(0, 3) if joint.axis.shifts else slice(2, 4)
        shared = np.zeros((4, 4), dtype=object)
        shared[both, both] = own[both, both]
        moments[joint.parent] = moments[joint.parent] + _moved(shared, *poses[k - 1])
        own[both, both] = 0
    return moments


def _moments_of_body(body: MassProperties, kind: Callable[[float], Any]) -> Exact:
    """Return the moments of a body in its own axes, in numbers of a kind."""
    if not body.mass and not body.inertia.any():
        return np.zeros((4, 4), dtype=object)
    m, J = kind(body.mass), _numbers_of(body.inertia, kind)
    c = [*_numbers_of(body.centre_of_mass, kind)]
    J = (J + J.T) * np.array([[kind(0.5)]], dtype=object)
    half = (J[0, 0] + J[1, 1] + J[2, 2]) * kind(0.5)
    h = [m * x for x in c]
    N = [[(half if i == j else 0) - J[i, j] + h[i] * c[j] for j in range(3)] for i in range(3)]
    return np.array([*([*row, x] for row, x in zip(N, h, strict=True)), [*h, m]], dtype=object)


def _moved(moments: Exact, S: Exact, u: Any = 0) -> Exact:
    """Return moments in other axes, by the rotation to them, and about another point, by the vector from it."""
    T = np.zeros((4, 4), dtype=object)
    T[:3, :3], T[:3, 3], T[3, 3] = S, u, 1
    return _product(_product(T, moments), T.T)


def _product(A: Exact, B: Exact) -> Exact:
    """Return A B; products with 0, which are most, are skipped."""
    columns = B.T.tolist()
    rows = [[sum(a * b for a, b in zip(row, one, strict=True) if a and b) for one in columns] for row in A.tolist()]
    return np.array(rows, dtype=object)


def _shortened(moments: Exact) -> Exact:
    """Return a copy whose fractions have no more than some digits, of which each joint of a chain adds many."""

    def short(x: Any) -> Any:
        if not isinstance(x, Fraction) or x.denominator.bit_length() <= 2000:
            return x
        shift = 512 + x.denominator.bit_length() - x.numerator.bit_length()
        return Fraction((x.numerator << shift) // x.denominator, 1 << shift)

    return np.array([[short(x) for x in row] for row in moments], dtype=object)


def _ten_numbers(moments: Exact) -> list[Any]:
    """Return mass, first moment and second moment of a body."""
    return [moments[3, 3], *moments[:3, 3], *(moments[entry] for entry in SECOND_MOMENTS)]


def _rounded_numbers(moments: Exact) -> list[float]:
    """Return the floats nearest to the numbers of a body, infinite beyond the largest."""
    found = []
    for x in _ten_numbers(moments):
        try:
            found.append(float(x))
        except OverflowError:
            found.append(math.inf if x > 0 else -math.inf)
    return found


def _numbers_of(array: NDArray[np.float64], kind: Callable[[float], Any] = Fraction) -> Exact:
    """Return an array of numbers of a kind, in which 0 stays 0."""
    return np.array([kind(x) if x else 0 for x in array.ravel().tolist()], dtype=object).reshape(array.shape)


def _pivot_thresholds(tree: Tree, axes: Sequence[NDArray[np.float64]]) -> list[float]:
    """Return the sizes below which pivots are rounding: of every joint, then of forces and torques on a free base."""
    joints = []
    for joint, P in zip(tree.joints, axes[1:], strict=True):
        axis, reach = joint.axis, float(np.abs(joint.u).sum()) + joint.reach
        turning = _inertia_about_axis(joint.body, P[:, 2]) if axis.turns else 0.0
        own = axis.turns**2 * turning + axis.shifts**2 * joint.body.mass + joint.armature
        joints.append(Resisted(joint.parent, axis, own, reach))
    bodies = [(body.mass, body.centre_of_mass, body.inertia) for body in tree.bodies]
    return [float(limit) for limit in smallest_pivots(bodies, joints)]


def _inertia_about_axis(body: MassProperties, n: NDArray[np.float64]) -> float:
    """Return the moment of inertia [kg m^2] about an axis n, body axes, through the reference point."""
    across = np.cross(n, body.centre_of_mass)
    return float(n @ body.inertia @ n + body.mass * (across @ across))
