"""The record of a pair, checked, and the robot that it is. u1, u2, n, home and points may have leading axes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations import spatial as eq
from hingepair.equations.quantities import QUANTITIES
from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body import Body, body_masses, moments_of
from hingepair.mechanism.robots.samples import JointSamples, Samples
from hingepair.mechanism.tree import Frame, Joint, Tree
from hingepair.numeric.arrays import Float64Array, constant, read_only
from hingepair.numeric.blocks import Components, numbers
from hingepair.numeric.unit_vectors import direction, finite_axis
from hingepair.plans.geometry import GEOMETRY_SHAPES
from hingepair.plans.pairs import POINT_ENDINGS, Point
from hingepair.rotations.matrices import check_rotation
from hingepair.urdf.rigid import FramePose

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
    arrays |= {"n": read_only(joined(direction(numbers(axis)))), "home": rotation}
    return arrays, axis


def tree_of_arrays(
    name: str, arrays: Mapping[str, Float64Array], points: Sequence[tuple[Point, Float64Array]], bodies: Bodies
) -> Tree:
    """Return a pair as a robot with the joint `hinge`, whose body has the axes of body 1 at psi = 0: so a home that
    is a rotation to nine digits only opens no gap. body2 and the points are frames.

    Args:
        name: name of the pair.
        arrays: u1, u2, n, of any length, and home, in space.
        points: points and their positions.
        bodies: mass properties of both bodies.
    """
    u1, u2, n, home = (arrays[key] for key in GEOMETRY_SHAPES)
    still, carriers = np.eye(3), {"body2": 1, **{point.name: point.body - 1 for point, _ in points}}
    ends = ((point, numbers(p)) for point, p in points)
    origins = [*map(joined, frame_origins(numbers(home, 2), numbers(u2), ends))]
    frames = {
        key: Frame(body, _first(R), _first(home, 2) if body else still, R if R.ndim > 1 else None)
        for (key, body), R in zip(carriers.items(), origins, strict=True)
    }
    body2, seats = bodies[1], origins[0]
    own = body_masses(body2, FramePose(_first(home, 2), _first(seats)))
    hinge = Joint("hinge", "hinge", 0, _first(u1), still, _first(n), own)
    samples = Samples()
    if max(seats.ndim, home.ndim - 1) > 1 and body2 is not None:
        samples = samples.with_matter(1, moments_of(body2, seats, home) - moments_of(own, np.zeros(3), still))
    if max(u1.ndim, n.ndim) > 1:
        samples = samples.with_joints({1: JointSamples(u1, still, n)}, ())
    samples = samples.with_joints({}, [R for R in origins if R.ndim > 1])
    return Tree(
        name, (hinge,), body_masses(bodies[0]), {"body1": Frame(0, np.zeros(3), still)}, frames, ("body1",),
        tuple((k, f"body{k + 1}: {one}") for k, body in enumerate(bodies) if body for one in body.assumed),
        without_mass={k: f"body{k + 1}" for k, body in enumerate(bodies) if body is None},
        samples=samples if samples.shape else None,
    )  # fmt: skip


def frame_origins(home: Components, u2: Components, points: Iterable[tuple[Point, Components]]) -> list[Components]:
    """Return where body 2 and all points are, in body-1 axes at psi = 0: points of body 1 from its reference point,
    body 2 and its points from the hinge point.
    """

    def from_hinge(p: Components) -> Components:
        found: Components = eq.rotate(home, eq.subtract(p, u2))
        return found

    return [from_hinge((0.0, 0.0, 0.0)), *(p if point.body == 1 else from_hinge(p) for point, p in points)]


def _first(array: Float64Array, rank: int = 1) -> Float64Array:
    """Return a vector or matrix of the first sample."""
    first: Float64Array = array.reshape(-1, *array.shape[array.ndim - rank :])[0]
    return first


def joined(components: Components) -> Float64Array:
    """Return components that broadcast as one array, with the components on the last axis."""
    if all(type(c) is float for c in components):
        return np.array(components)
    return np.stack(np.broadcast_arrays(*components), axis=-1)


def lifted(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors of the plane as vectors in space with z = 0, and those of space as they are."""
    return u if u.shape[-1] == 3 else np.concatenate([u, np.zeros((*u.shape[:-1], 1))], axis=-1)
