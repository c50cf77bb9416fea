"""The geometry and the masses of a pair, checked, and the constants of its tree that follow from them.

Every constant is computed in twice the precision and rounded once. u1, u2, n, home and points may have leading axes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType, SimpleNamespace
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations import spatial as eq
from hingepair.equations.joints import HINGE
from hingepair.equations.quantities import QUANTITIES
from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body import Body, moments_of
from hingepair.mechanism.bodies.pivots import Resisted, smallest_pivots
from hingepair.numeric.arrays import Float64Array, broadcast_shape, constant, read_only
from hingepair.numeric.blocks import Components, numbers
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.numeric.twofold import Twofold
from hingepair.numeric.unit_vectors import finite_axis, polar, scaled_by_power_of_two, times_power_of_two
from hingepair.plans.pairs import POINT_ENDINGS, PairKind, Point, point_outputs, point_shapes
from hingepair.rotations.matrices import check_rotation

Points: TypeAlias = Mapping[str, NDArray[np.float64]]
Bodies: TypeAlias = tuple[Body | None, Body | None]

IDENTITY: Final = read_only(np.eye(3))  # the default of home
_RESERVED: Final = {  # names that a point cannot have
    *QUANTITIES,
    *("home", "next_S1"),  # attitudes among the inputs of programs
    *("constants", "samples", "points"),  # further inputs of programs
    *("quat1", "quat2", "qx", "qy", "qz", "qw"),  # in scenes
    *("body1", "body2", "body2_at_hinge", "hinge", "base", "world"),  # in models and pages
}
_NOTHING: Final = SimpleNamespace(mass=0.0, centre_of_mass=np.zeros(3), inertia=np.zeros((3, 3)))  # no body
_COMPONENTS: Final = ("_x", "_y", "_z")  # endings of the columns of a vector


def checked_record(
    size: int,
    name: str,
    body1: Body | None,
    body2: Body | None,
    points1: Mapping[str, ArrayLike] | None,
    points2: Mapping[str, ArrayLike] | None,
) -> dict[str, Any]:
    """Return the checked arguments of a pair beside the geometry of its hinge; `size` is that of vectors."""
    if not isinstance(name, str) or not name.strip():
        raise ArgumentError("name", "a text that is not empty", quoted(name))
    bodies = {"body1": body1, "body2": body2}
    for key, body in bodies.items():
        if not isinstance(body, Body | None):
            raise ArgumentError(key, "a Body", quoted(body))
    points = {"points1": points1, "points2": points2}
    return {"name": name, **bodies, **{key: checked_points(key, value, size) for key, value in points.items()}}


def checked_points(argument: str, points: Mapping[str, ArrayLike] | None, size: int) -> Points:
    """Return the argument points1 or points2 as read-only positions (..., size) by name; refuse names in use."""
    if points is None:
        return MappingProxyType({})
    if not isinstance(points, Mapping):
        raise ArgumentError(argument, "a dict of positions by name", quoted(points))
    for name in points:
        if not isinstance(name, str) or not name.isidentifier():
            expected = "names of letters, digits and _ that begin with a letter"
            raise ArgumentError(argument, expected, quoted(name))
        for ending in (*filter(None, POINT_ENDINGS.values()), *_COMPONENTS):
            if name.endswith(ending):
                expected = f"names that do not end in {ending}, as columns of points do"
                raise ArgumentError(argument, expected, quoted(name))
        if name in _RESERVED:
            raise ArgumentError(argument, "names that no output and no part of a model has", quoted(name))
    return MappingProxyType({name: constant(f"{argument}[{name!r}]", value, size) for name, value in points.items()})


class Constants:
    """Geometry and masses of a pair, and the numbers of its programs, which are made once.

    Args:
        name: name of the pair.
        kind: in space or in the plane.
        arrays: u1 and u2 [m]; in space also n, of unit length, and home.
        axis: hinge axis as it was given, of any length; None for a planar pair.
        points: points of body 1 and of body 2 by name, from the reference point of the body, its axes [m]; checked.
        bodies: mass properties of body 1 and of body 2.

    Raises:
        ArgumentError: a point stands twice.
        ShapeError: leading axes do not broadcast.
    """

    def __init__(
        self,
        name: str,
        kind: PairKind,
        arrays: Mapping[str, NDArray[np.float64]],
        axis: NDArray[np.float64] | None,
        points: tuple[Points, Points],
        bodies: Bodies,
    ) -> None:
        self.name, self.kind, self.arrays, self.axis, self.bodies = name, kind, arrays, axis, bodies
        for one in points[1]:
            if one in points[0]:
                raise ArgumentError("points2", "names that points1 does not have", quoted(one))
        self.points = tuple(Point(one, body) for body, group in enumerate(points, 1) for one in group)
        self.positions = (*points[0].values(), *points[1].values())
        places = {**arrays, **points[0], **points[1]}
        tails = {"home": 2}
        self.shape = broadcast_shape(  # leading shape of the pair; () for a single pair
            {one: array.shape[: array.ndim - tails.get(one, 1)] for one, array in places.items()}
        )
        self._given = name, kind, arrays, axis, tuple(map(dict, points)), bodies

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), self._given

    @property
    def single(self) -> bool:
        """Whether these are the constants of a single pair, without leading axes."""
        return self.shape == ()

    @property
    def has_home(self) -> bool:
        """Whether home differs from the identity."""
        return "home" in self.arrays and not (self.arrays["home"] == IDENTITY).all()

    @property
    def levels(self) -> Mapping[str, int | None]:
        """The outputs of kinematics, those of points too; the level from which it is a default output, or None."""
        return {**self.kind.levels, **dict.fromkeys(point_outputs(self.points))} if self.points else self.kind.levels

    @property
    def shapes(self) -> Mapping[str, tuple[int, ...]]:
        """Shape of one sample of all that can be given or computed."""
        return (
            {**self.kind.shapes, **point_shapes(self.points, self.kind.planar)} if self.points else self.kind.shapes
        )

    @lock_free_cached_property
    def frames(self) -> HingeFrames:
        """The frames of the hinge.

        e1 is the axis of body 1 with the largest angle to n, made perpendicular to n; e2 = n x e1. Where n lies along
        x, y or z, the axes are an exact permutation. The attitude of body 2 is home as it was given, and its hinge
        axis n: a home that is a rotation to nine digits only opens no gap.
        """
        return _hinge_frames(self)

    @lock_free_cached_property
    def tree(self) -> TreeNumbers:
        """The constants of the pair's tree without masses."""
        return _tree_numbers(self, (0.0,) * 10, (0.0,) * 10, (0.0,) * 3)

    @lock_free_cached_property
    def tree_with_masses(self) -> TreeNumbers:
        """The constants of the pair's tree; a body that is None has no mass."""
        return _tree_numbers(self, *map(numbers, self.masses))

    @lock_free_cached_property
    def masses(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Mass, first and second moment, (..., 10), of body 1 about R1 in its axes, and of body 2 about the hinge
        point in the tree's axes; and the `pivot_limits`.
        """
        return _masses(self)

    @property
    def pivot_limits(self) -> Float64Array:
        """Sizes below which pivots of the hinge, of forces and of torques on body 1 are rounding, (..., 3); 0 where
        they cannot be that small.
        """
        return self.masses[2]

    @lock_free_cached_property
    def constraint_vectors(self) -> dict[str, Components]:
        """u1, u2, and e1, e2 and n in the axes of body 1 and, times C^-1, of body 2: the constants of E1 and E2.

        With C^T instead, a home that is a rotation to only nine digits would appear as a tilt.
        """
        axes: Any = tuple(_rounded(self.frames.axes))
        in_body1 = in_body2 = {"e1": axes[0::3], "e2": axes[1::3], "n": numbers(self.arrays["n"])}
        if self.has_home:
            inverse = np.linalg.inv(self.arrays["home"])
            turned = {name: (inverse @ _joined(one)[..., None])[..., 0] for name, one in in_body1.items()}
            in_body2 = {name: numbers(one) for name, one in turned.items()}
        arms = {name: numbers(self.arrays[name]) for name in ("u1", "u2")}
        return arms | in_body1 | {f"{name}_in_2": one for name, one in in_body2.items()}


def spatial_arrays(
    u1: ArrayLike, u2: ArrayLike, n: ArrayLike, home: ArrayLike | None
) -> tuple[dict[str, NDArray[np.float64]], NDArray[np.float64]]:
    """Return u1, u2, n at unit length and home of a pair in space, None for the identity, and n as it was given.

    Raises:
        ArgumentError: a value is not finite or has the wrong shape; names the argument.
        AxisError: n is zero or not finite.
        RotationError: home is not a rotation.
    """
    arrays = {"u1": constant("u1", u1, 3), "u2": constant("u2", u2, 3)}
    axis = read_only(np.array(finite_axis("n", n), dtype=np.float64))
    rotation = IDENTITY if home is None else constant("home", home, 3, 3)
    if home is not None:
        check_rotation("home", rotation)
    arrays |= {"n": read_only(_joined(tuple(c.high for c in polar(numbers(axis))[0]))), "home": rotation}
    return arrays, axis


# ---- the tree


class HingeFrames(NamedTuple):
    """Where the tree has the hinge and the frames of the pair, in twice the precision; of floats, or of arrays where
    they have samples.
    """

    n: tuple[Twofold, ...]  # hinge axis, body-1 axes
    axes: tuple[Twofold, ...]  # from the axes of the tree's body 2 at psi = 0, e1, e2 and n, to those of body 1
    turn: tuple[Twofold, ...]  # from the axes of body 2 to those of the tree's
    frames: list[tuple[Twofold, ...]]  # the constants of each frame, see `plans.pairs.LEVER_SHAPES`


def _hinge_frames(constants: Constants) -> HingeFrames:
    u1, u2 = (numbers(lifted(constants.arrays[name])) for name in ("u1", "u2"))
    axes: Any = tuple(map(Twofold, numbers(IDENTITY, 2)))  # in the plane, those of both bodies at psi = 0
    n: Any = axes[2::3]
    turn: Any = axes
    home: Any = None
    with np.errstate(all="ignore"):
        if constants.axis is not None:
            axis: Any = numbers(constants.axis)
            n = polar(axis)[0]
            least: Any = numbers(least_axis(constants.arrays["n"]))
            e2: Any = polar(tuple(c + 0.0 for c in eq.cross(axis, least)))[0]
            axes = eq.matrix_from_columns(eq.cross(e2, n), e2, n)
            turn = eq.transpose(axes)
            if constants.has_home:
                home = tuple(map(Twofold, numbers(constants.arrays["home"], 2)))
                turn = eq.compose(turn, home)
        frames = [_turned_frame(n, axes, home, u1, u2, (0.0, 0.0, 0.0))]
        for point, position in zip(constants.points, constants.positions, strict=True):
            p = numbers(lifted(position))
            if point.body == 1:
                frames.append((*map(Twofold, (*p, *p)), *(Twofold(0.0),) * 6))
            else:
                frames.append(_turned_frame(n, axes, home, u1, u2, p))
    return HingeFrames(n, axes, turn, frames)


def _turned_frame(n: Any, axes: Any, home: Any, u1: Any, u2: Any, p: Any) -> tuple[Twofold, ...]:
    """Return the constants of the frame at the point p of body 2."""
    scaled, exponent = scaled_by_power_of_two((*p, *u2))
    ends: Any = tuple(map(Twofold, scaled))
    arm = eq.subtract(ends[:3], ends[3:])  # from the hinge point, at psi = 0
    arm = arm if home is None else eq.rotate(home, arm)
    along, ahead = eq.scale(n, eq.dot(n, arm)), eq.cross(n, arm)
    parts = (*eq.rotate(eq.transpose(axes), arm), *along, *eq.subtract(arm, along), *ahead)
    scaled_back = [Twofold(*(times_power_of_two(x, exponent) for x in (c.high, c.low))) for c in parts]
    fixed: Any = [Twofold(u) + c for u, c in zip(u1, scaled_back[3:6], strict=True)]
    return (*scaled_back[:3], *fixed, *scaled_back[6:])


def _rounded(parts: Iterable[Twofold]) -> list[Any]:
    """Return numbers of twice the precision as doubles, without -0.0."""
    return [c.high + 0.0 for c in parts]


def least_axis(n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit vector along the coordinate axis with the largest angle to n; shape (..., 3)."""
    axis: NDArray[np.float64] = np.eye(3)[np.argmin(np.abs(n), axis=-1)]
    return axis


class TreeNumbers(NamedTuple):
    """The constants of a pair's tree, in the order of `plans.trees`."""

    components: Components  # floats, or arrays where they have samples
    numbers: tuple[float, ...]  # the same of the first pair, if there are several
    varied: tuple[int, ...]  # places of those that differ from sample to sample
    samples: Float64Array | None  # these, shape (..., len(varied)); None if there are none


def _tree_numbers(constants: Constants, base: Components, body2: Components, pivots: Components) -> TreeNumbers:
    found = constants.frames
    rotor = (0.0, 1.0, 0.0)  # armature, multiplier and offset of a hinge that follows none
    u1 = numbers(lifted(constants.arrays["u1"]))
    parts = [*base, *_rounded(found.axes), *u1, *body2, *rotor, *pivots]
    parts += _rounded(c for frame in found.frames for c in frame)
    varied = tuple(k for k, part in enumerate(parts) if isinstance(part, np.ndarray) and np.ptp(part))
    samples = read_only(_joined(tuple(parts[k] for k in varied))) if varied else None
    return TreeNumbers(tuple(parts), tuple(float(np.ravel(part)[0]) for part in parts), varied, samples)


def tree_errors(constants: Constants) -> Components:
    """Return bounds on the errors of the `components` of the tree: what their rounding lost,
    and what twice the precision leaves.
    """
    found, parts = constants.frames, constants.tree.components
    errors: list[Any] = [0.0] * len(parts)
    exact = _is_aligned(constants)
    errors[10:19] = _errors(found.axes, 0.0 if exact else 1.0)
    positions = [np.zeros(3), *(lifted(one) for one in constants.positions)]
    size = sum(np.abs(lifted(constants.arrays[name])).max(axis=-1) for name in ("u1", "u2"))
    behind = len(parts) - 12 * len(found.frames)
    for k, (frame, position) in enumerate(zip(found.frames, positions, strict=True)):
        start = behind + 12 * k
        own = size + np.abs(position).max(axis=-1)
        errors[start : start + 12] = _errors(frame, own)
        if not k and exact and not constants.has_home:  # but u1 plus the part of u2 along n
            errors[start : start + 12] = [*[0.0] * 3, *errors[start + 3 : start + 6], *[0.0] * 6]
    return tuple(errors)


def axis_errors(constants: Constants) -> Components:
    """Return bounds on the errors of n: 0 along x, y or z, where it is exact."""
    return tuple(_errors(constants.frames.n, 0.0 if _is_aligned(constants) else 1.0))


def _is_aligned(constants: Constants) -> bool:
    """Return whether the hinge axis lies along x, y or z, so that the axes of the tree are exact."""
    return constants.axis is None or (constants.single and np.count_nonzero(constants.axis) == 1)


def _errors(parts: Iterable[Twofold], size: Any) -> list[Any]:
    """Return the largest errors of numbers that are computed from others of a size and rounded; 0 of size 0."""
    left = 2.0**-90 * size + 2.0**-1074 * (size > 0)
    return [np.abs(c.low) + left for c in parts]


def _masses(constants: Constants) -> tuple[Float64Array, Float64Array, Float64Array]:
    body1, body2 = (_NOTHING if body is None else body for body in constants.bodies)
    turn = _joined(tuple(_rounded(constants.frames.turn)))
    u1, u2 = (lifted(constants.arrays[name]) for name in ("u1", "u2"))
    origin, lever = np.zeros(3), body2.centre_of_mass - u2
    with np.errstate(all="ignore"):
        matter1 = moments_of(body1.mass, body1.centre_of_mass, body1.inertia, origin, np.eye(3))
        matter2 = moments_of(body2.mass, lever, body2.inertia, origin, turn.reshape(*turn.shape[:-1], 3, 3))
        turning = matter2[..., 4] + matter2[..., 7]
        lowest = smallest_pivots(
            [(body1.mass, body1.centre_of_mass, body1.inertia), (body2.mass, lever, body2.inertia)],
            [Resisted(0, HINGE, turning, np.abs(u1).sum(axis=-1))],
        )
    if not (np.isfinite(matter1).all() and np.isfinite(matter2).all()):
        expected = "masses and lengths whose products mass x length^2 stay below 1.8e308 kg m^2"
        raise ArgumentError("pair", expected, "products that overflow")
    return matter1, matter2, np.stack(np.broadcast_arrays(*lowest), axis=-1)


def _joined(components: Components) -> Float64Array:
    """Return components that broadcast as one array, with the components on the last axis."""
    if all(type(c) is float for c in components):
        return np.array(components)
    return np.stack(np.broadcast_arrays(*components), axis=-1)


def lifted(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors of the plane as vectors in space with z = 0, and those of space as they are."""
    return u if u.shape[-1] == 3 else np.concatenate([u, np.zeros((*u.shape[:-1], 1))], axis=-1)
