"""Constants of a pair in the form that calls take: u1, u2, n, home, and the levers computed from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.binding import ArrayShape
from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.numeric.arrays import broadcast_shape, constant, read_only
from hingepair.numeric.blocks import Components, Named, numbers
from hingepair.numeric.twofold import Twofold
from hingepair.numeric.unit_vectors import finite_axis, polar, scaled_by_power_of_two, times_power_of_two
from hingepair.pair.points import Points, named_points
from hingepair.plans.computation import Cache
from hingepair.plans.plan import PLANAR_MOTION_KIND, SPATIAL_MOTION_KIND, MotionKind, shapes_with_points
from hingepair.plans.points import Point, point_outputs
from hingepair.plans.steps import LEVER_CONSTANT_STEPS
from hingepair.rotations.matrices import check_rotation

_IDENTITY_ROTATION_MATRIX = read_only(np.eye(3))  # the default of home


@dataclass(frozen=True, slots=True, eq=False)
class Constants:
    """Constants of a pair in the form in which calls take them."""

    values: Named  # u1, u2, n, the levers and, unless it is the identity, home: tuples of components by name
    arrays: Named  # the same with the components last, and home in any case
    shape: tuple[int, ...]  # leading shape of the pair; () for a single pair
    axis: NDArray[np.float64] | None = None  # hinge axis as it was given, of any length; None for a planar pair
    points: tuple[Point, ...] = ()  # fixed to the bodies; their vectors are among the values
    cache: Cache = field(default_factory=Cache, repr=False)

    def __reduce__(self) -> tuple[Any, ...]:
        return Constants, (self.values, self.arrays, self.shape, self.axis, self.points)

    @property
    def single(self) -> bool:
        """Whether these are the constants of a single pair, without leading axes."""
        return self.shape == ()

    @property
    def kind(self) -> MotionKind:
        """Motion in space or in the plane."""
        return SPATIAL_MOTION_KIND if "n" in self.values else PLANAR_MOTION_KIND

    @property
    def levels(self) -> Mapping[str, int | None]:
        """The outputs of kinematics, those of points too; the level from which it is a default output, or None."""
        return {**self.kind.levels, **dict.fromkeys(point_outputs(self.points))} if self.points else self.kind.levels

    @property
    def shapes(self) -> Mapping[str, ArrayShape]:
        """Shape of one sample of all that can be given or computed."""
        return shapes_with_points(self.kind, self.points)

    def extended(self, arrays: Mapping[str, NDArray[Any]]) -> Constants:
        """Return these constants with further ones, whose components are on the last axis."""
        values = {name: numbers(array) if array.ndim else float(array) for name, array in arrays.items()}
        return Constants({**self.values, **values}, {**self.arrays, **arrays}, self.shape, points=self.points)


def pair_constants(
    u1: ArrayLike, u2: ArrayLike, n: ArrayLike, home: ArrayLike | None, points1: Points, points2: Points
) -> Constants:
    """Return the Constants of a pair. u1 and u2 are the vectors from the reference points to the hinge point, in the
    axes of body 1 and of body 2, and n is the hinge axis. `home` is the rotation matrix from body-2 to body-1 axes at
    psi = 0, or None for the identity. `points1` and `points2` are the points of the bodies, checked.

    Raises:
        ArgumentError: a value is not finite or has the wrong shape; names the argument.
        AxisError: n is zero or not finite.
        RotationError: home is not a rotation.
    """
    vectors = {"u1": constant("u1", u1, 3), "u2": constant("u2", u2, 3)}
    axis = read_only(np.array(finite_axis("n", n), dtype=np.float64))
    rotation = _IDENTITY_ROTATION_MATRIX if home is None else constant("home", home, 3, 3)
    if home is not None:
        check_rotation("home", rotation)
    points, positions = named_points(points1, points2)
    shapes = {name: array.shape[:-1] for name, array in {**vectors, "n": axis, **positions}.items()}
    shape = broadcast_shape({**shapes, "home": rotation.shape[:-2]})
    values: Named = {name: numbers(vector) for name, vector in vectors.items()}
    if not (rotation == _IDENTITY_ROTATION_MATRIX).all():
        values["home"] = numbers(rotation, 2)
    values |= _axis_and_levers(values, numbers(axis))
    computed = {
        name: read_only(_stack_components(values[name])) for name in ("n", "lever_fixed", "lever_cos", "lever_sin")
    }
    arrays = {**vectors, **computed, "home": rotation.reshape(*rotation.shape[:-2], 9), **positions}
    values |= {name: numbers(position) for name, position in positions.items()}
    return Constants(values, arrays, shape, axis, points)


def _axis_and_levers(values: Named, axis: Components) -> Named:
    """Return n at unit length, and the levers [m] in R2 - R1 = S1 (lever_fixed - cos psi lever_cos - sin psi
    lever_sin).

    Each component is rounded once: the levers come from the axis as it was given, not from the rounded unit axis.
    """
    lever2, exponent2 = scaled_by_power_of_two(values["u2"])
    u1_and_u2, exponent = scaled_by_power_of_two((*values["u1"], *values["u2"]))
    n, _ = polar(axis)
    values_by_name: dict[str, Any] = {"arm": tuple(map(Twofold, lever2)), "n": n}
    *of_u2, lever_fixed = LEVER_CONSTANT_STEPS if "home" in values else LEVER_CONSTANT_STEPS[1:]
    if "home" in values:
        values_by_name |= {"u2": values_by_name["arm"], "home": tuple(map(Twofold, values["home"]))}
    for result, function, arguments in of_u2:
        values_by_name[result] = function(*[values_by_name[name] for name in arguments])
    # Only `lever_fixed` contains both u1 and u2, so only here may the shorter one be lost in rounding.
    shift = exponent2 - exponent
    shifted_vectors = (
        tuple(
            Twofold(times_power_of_two(c.high, shift), times_power_of_two(c.low, shift)) for c in values_by_name[name]
        )
        for name in lever_fixed.arguments[1:]
    )
    values_by_name["lever_fixed"] = lever_fixed.function(tuple(map(Twofold, u1_and_u2[:3])), *shifted_vectors)
    exponents = {"lever_fixed": exponent, "lever_cos": exponent2, "lever_sin": exponent2}
    levers = {
        name: tuple(times_power_of_two(c.high, e) for c in values_by_name[name]) for name, e in exponents.items()
    }
    return {"n": tuple(c.high for c in n), **levers}


def _stack_components(components: Components) -> NDArray[np.float64]:
    """Return components that broadcast as one array, with the components on the last axis."""
    if all(type(c) is float for c in components):
        return np.array(components)
    return np.stack(np.broadcast_arrays(*components), axis=-1)


HINGE_FRAMES = frozenset({"e1", "e2", "e1_in_2", "e2_in_2", "n_in_2"})
"""Names of the vectors that `with_hinge_frames` adds."""


def with_hinge_frames(pair: Constants) -> Constants:
    """Return the Constants of a pair, extended by orthogonal unit vectors along and across its hinge axis: e1, e2 in
    body-1 axes, and e1_in_2, e2_in_2 and n_in_2 in body-2 axes. They are computed once.

    e1 is the axis of body 1 with the largest angle to n, made perpendicular to n; e2 = n x e1. The vectors of body 2
    are C^-1 times the vectors of body 1. With C^T instead, a home that is a rotation to only nine digits would appear
    as a tilt.
    """
    constants: Constants | None = pair.cache.others.get(HINGE_FRAMES)
    if constants is None:
        frames = _hinge_frames(pair.arrays["n"], pair.arrays["home"] if "home" in pair.values else None)
        constants = Constants({**pair.values, **frames}, {**pair.arrays, **frames}, pair.shape, points=pair.points)
        pair.cache.others[HINGE_FRAMES] = constants
    return constants


def least_axis(n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit vector along the coordinate axis with the largest angle to n; shape (..., 3)."""
    axis: NDArray[np.float64] = np.eye(3)[np.argmin(np.abs(n), axis=-1)]
    return axis


def _hinge_frames(n: NDArray[np.float64], home: NDArray[np.float64] | None) -> Named:
    """Return e1, e2 and n in the axes of body 1, and in those of body 2, as tuples of components."""
    with np.errstate(under="ignore"):
        first = least_axis(n)
        first = first - n * (n * first).sum(axis=-1, keepdims=True)
        first /= np.sqrt((first * first).sum(axis=-1, keepdims=True))
        in_body1 = in_body2 = {"e1": first, "e2": np.cross(n, first), "n": n}
        if home is not None:
            home_inverse = np.linalg.inv(home.reshape(*home.shape[:-1], 3, 3))
            in_body2 = {name: (home_inverse @ vector[..., None])[..., 0] for name, vector in in_body1.items()}
    named = {**in_body1, **{f"{name}_in_2": vector for name, vector in in_body2.items()}}
    return {name: numbers(vector) for name, vector in named.items()}


def check_pair(pair: object) -> None:
    """Raise ArgumentError if `pair` is not a HingePair."""
    if not all(hasattr(pair, name) for name in ("u1", "u2", "n", "home", "forward_kinematics")):
        hint = " (a PlanarPair's is pair.to_spatial())" if hasattr(pair, "to_spatial") else ""
        raise ArgumentError("pair", f"a HingePair{hint}", quoted(pair))


def check_single_pair(pair: Any, condition: str = "") -> None:
    """Raise ShapeError if a HingePair or PlanarPair holds more than one pair, that is, if its geometry has leading
    axes.

    Args:
        pair: a HingePair or a PlanarPair.
        condition: text that follows "one pair" in the message, such as " if the arguments are Dask arrays".

    Raises:
        ShapeError: u1, u2, n or home have leading axes.
    """
    if not pair.constants.single:
        expected = f"one pair{condition}, such as {type(pair).__name__}(u1[i], ...)"
        raise ShapeError("pair", expected, f"pairs of shape {pair.constants.shape}")
