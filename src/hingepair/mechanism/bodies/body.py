"""Mass properties of a body, and its shapes, which viewers draw."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.numeric.arrays import Frozen, call_text, finite_number, one_constant, read_only, set_frozen
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.rotations.matrices import check_rotation, skew
from hingepair.urdf.rigid import ZERO_MASS_PROPERTIES, FramePose, MassProperties

_ASSUMED_MASS: Final = 1.0  # kg, of a body whose mass is not given
_ASSUMED_GYRATION = 0.01  # m^2: inertia per mass of a body without shapes whose inertia is not given
NO_BODY: Final = "no principal moment above the sum of the other two"  # what is wrong about the inertia of no body
INERTIA_ENTRIES: Final = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
"""Rows and columns of the six entries that stand for an inertia matrix, in Pinocchio's order."""

SECOND_MOMENTS: Final = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Rows and columns of the entries of a second moment, in the order of programs."""


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Box(Frozen):
    """A solid box, one of the shapes of a body.

    Args:
        size: lengths of the three edges [m], each above zero; shape (3,).
        center: its centre from the body's reference point, body axes [m]; shape (3,).
        axes: rotation matrix whose columns are the directions of the edges, body axes; shape (3, 3); by default the
            identity.

    Raises:
        ArgumentError: a length is not above zero.
        RotationError: axes is no rotation.

    >>> import hingepair as hp
    >>> hp.Box(size=(1, 2, 3))
    Box(size=[1.0, 2.0, 3.0], center=[0.0, 0.0, 0.0])
    """

    size: NDArray[np.float64]
    center: NDArray[np.float64]
    axes: NDArray[np.float64]

    def __init__(self, size: ArrayLike, center: ArrayLike = (0.0, 0.0, 0.0), axes: ArrayLike | None = None) -> None:
        if isinstance(size, int | float):
            raise ShapeError("size", "shape (3,), as in Box((x, y, z))", size)
        edges = one_constant("size", size, 3)
        if not (edges > 0).all():
            raise ArgumentError("size", "three lengths above 0", size)
        turn = one_constant("axes", np.eye(3) if axes is None else axes, 3, 3)
        check_rotation("axes", turn)
        set_frozen(self, size=edges, center=one_constant("center", center, 3), axes=turn)

    def __repr__(self) -> str:
        return call_text(self, "size", "center", *(["axes"] if (self.axes != np.eye(3)).any() else []))


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Cylinder(Frozen):
    """A solid cylinder, one of the shapes of a body.

    Args:
        radius: radius, above zero [m].
        length: length along its axis, above zero [m].
        center: its centre from the body's reference point, body axes [m]; shape (3,).
        axis: direction of its axis, body axes; any non-zero length; shape (3,).

    Raises:
        ArgumentError: radius or length is not above zero.
        AxisError: axis is zero.

    >>> import hingepair as hp
    >>> hp.Cylinder(radius=0.1, length=2, axis=(0, 3, 0)).axis.tolist()
    [0.0, 1.0, 0.0]
    """

    radius: float
    length: float
    center: NDArray[np.float64]
    axis: NDArray[np.float64]

    def __init__(
        self,
        radius: float,
        length: float,
        center: ArrayLike = (0.0, 0.0, 0.0),
        axis: ArrayLike = (0.0, 0.0, 1.0),
    ) -> None:
        direction = read_only(unit_axis("axis", one_constant("axis", axis, 3)))
        values = {"radius": _positive_number("radius", radius), "length": _positive_number("length", length)}
        set_frozen(self, **values, center=one_constant("center", center, 3), axis=direction)

    def __repr__(self) -> str:
        return call_text(self, "radius", "length", "center", "axis")


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Sphere(Frozen):
    """A solid sphere, one of the shapes of a body.

    Args:
        radius: radius, above zero [m].
        center: its centre from the body's reference point, body axes [m]; shape (3,).

    Raises:
        ArgumentError: the radius is not above zero.

    >>> import hingepair as hp
    >>> hp.Sphere(radius=0.5)
    Sphere(radius=0.5, center=[0.0, 0.0, 0.0])
    """

    radius: float
    center: NDArray[np.float64]

    def __init__(self, radius: float, center: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        set_frozen(self, radius=_positive_number("radius", radius), center=one_constant("center", center, 3))

    def __repr__(self) -> str:
        return call_text(self, "radius", "center")


Shape: TypeAlias = Box | Cylinder | Sphere


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Body(Frozen):
    """Mass, centre of mass, inertia and shapes of one body, for dynamics, exports and pictures.

    `dataclasses.replace(body, mass=3)` computes again what was not given for `body`, such as an inertia from its
    shapes.

    Args:
        mass: mass, above zero [kg]. Without it, 1 kg is assumed, with a `DynamicsWarning` where it matters.
        centre_of_mass: from the body's reference point, body axes [m]; shape (3,). By default that of the shapes, or
            zero.
        inertia: about the centre of mass, body axes [kg m^2]: a symmetric matrix (3, 3), or the moments about axes
            parallel to x, y and z, (3,). Principal moments are above zero, and none exceeds the sum of the others
            by more than 1e-3 of all three, which rounded data may. By default
            that of the shapes about their own centre of mass, scaled to the mass; without shapes, a radius of
            gyration of 0.1 m, with a `DynamicsWarning` where it matters.
        shapes: Box, Cylinder and Sphere objects of one density, which viewers draw, and from which the inertia and
            the centre of mass follow unless given. What two shapes share counts twice. Without shapes, viewers draw
            an arm to the hinge.
        _computed: an internal argument that `dataclasses.replace` passes.

    Raises:
        ArgumentError: no rigid body can have a value.

    >>> import hingepair as hp
    >>> hp.Body(mass=2, centre_of_mass=(0.1, 0, 0)).inertia.diagonal().round(6).tolist()
    [0.02, 0.02, 0.02]
    >>> rod = hp.Body(mass=3, shapes=[hp.Cylinder(radius=0.02, length=2, center=(1, 0, 0), axis=(1, 0, 0))])
    >>> rod.centre_of_mass.tolist(), rod.inertia.diagonal().round(6).tolist()
    ([1.0, 0.0, 0.0], [0.0006, 1.0003, 1.0003])
    """

    mass: float
    centre_of_mass: NDArray[np.float64]
    inertia: NDArray[np.float64]
    shapes: tuple[Shape, ...]
    _computed: Mapping[str, Any]
    """The values of mass, centre_of_mass and inertia that were not given, by name."""

    def __init__(
        self,
        mass: float | None = None,
        centre_of_mass: ArrayLike | None = None,
        inertia: ArrayLike | None = None,
        shapes: Iterable[Shape] = (),
        *,
        _computed: Mapping[str, Any] | None = None,  # computed values of the body that dataclasses.replace copies
    ) -> None:
        # A value that is the object which the earlier body computed was not given by the user.
        earlier = _computed or {}
        mass = None if mass is earlier.get("mass") else mass
        centre_of_mass = None if centre_of_mass is earlier.get("centre_of_mass") else centre_of_mass
        inertia = None if inertia is earlier.get("inertia") else inertia
        if isinstance(mass, np.ndarray | list | tuple) and np.ndim(mass):
            expected = "a finite number; robot.with_payload(link, mass=...) takes masses with samples"
            raise ArgumentError("mass", expected, quoted(mass))
        mass_value = _ASSUMED_MASS if mass is None else _positive_number("mass", mass)
        if not isinstance(shapes, Iterable):
            raise ArgumentError("shapes", "a sequence of Box, Cylinder and Sphere", quoted(shapes))
        shape_tuple = tuple(shapes)
        for shape in shape_tuple:
            if not isinstance(shape, Shape):
                raise ArgumentError("shapes", "Box, Cylinder or Sphere", quoted(shape))
        default_centre, inertia_per_mass = _mass_distribution(
            shape_tuple if inertia is None or centre_of_mass is None else ()
        )
        centre = default_centre if centre_of_mass is None else one_constant("centre_of_mass", centre_of_mass, 3)
        with np.errstate(over="ignore"):
            tensor = mass_value * inertia_per_mass if inertia is None else _inertia_matrix(inertia)
        tensor = _checked_inertia(tensor)
        arguments = {"mass": mass, "centre_of_mass": centre_of_mass, "inertia": inertia}
        values = {"mass": mass_value, "centre_of_mass": centre, "inertia": tensor}
        computed = {name: value for name, value in values.items() if arguments[name] is None}
        set_frozen(self, **values, shapes=shape_tuple, _computed=computed)

    def __reduce__(self) -> tuple[Any, ...]:
        values = {name: getattr(self, name) for name in ("mass", "centre_of_mass", "inertia", "shapes")}
        return _body_again, (values, tuple(self._computed))

    @property
    def assumed(self) -> tuple[str, ...]:
        """Sentences about values that were assumed, such as the mass or the inertia."""
        sentences = []
        if "mass" in self._computed:
            sentences.append(
                "no mass is given, 1 kg is taken; Body(mass=...) gives it, in a scene the key mass of the body"
            )
        if "inertia" in self._computed and not self.shapes:
            sentences.append(
                "no inertia is given, a radius of gyration of 0.1 m is taken; Body(inertia=...) or Body(shapes=...) "
                "gives it, in a scene the key inertia or shapes of the body"
            )
        return tuple(sentences)

    def __repr__(self) -> str:
        return call_text(self, "mass", "centre_of_mass", "inertia", "shapes")


def _body_again(values: dict[str, Any], computed: tuple[str, ...]) -> Body:
    """Return a copied or unpickled body, of which the values that were not given are these very objects."""
    body: Body = object.__new__(Body)
    for array in (values["centre_of_mass"], values["inertia"]):
        array.flags.writeable = False
    set_frozen(body, **values, _computed={name: values[name] for name in computed})
    return body


def inertial_parameters(
    mass: float, centre_of_mass: NDArray[np.float64], inertia: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return mass m, first moment m c and the `INERTIA_ENTRIES` of J, both about the reference point; shape (10,)."""
    J = inertia - mass * skew(centre_of_mass) @ skew(centre_of_mass)
    return np.array([mass, *(mass * centre_of_mass), *(J[entry] for entry in INERTIA_ENTRIES)])


def body_masses(body: Body | None, pose: FramePose | None = None) -> MassProperties:
    """Return the mass properties of a Body, 0 of none, in axes in which it has a pose, or else in its own axes."""
    if body is None:
        return ZERO_MASS_PROPERTIES
    own = MassProperties(body.mass, body.centre_of_mass, body.inertia)
    return own if pose is None else own.placed(pose)


def moments_of(matter: Any, R: NDArray[np.float64], S: NDArray[np.float64]) -> Any:
    """Return mass, first moment and the `SECOND_MOMENTS` of matter - a Body, MassProperties or a Payload - (..., 10),
    in axes that its own axes are turned to by S (..., 3, 3), about the point from which R (..., 3) leads to its
    origin. All may have leading axes.
    """
    m, inertia = np.asarray(matter.mass), matter.inertia
    half = np.trace(inertia, axis1=-2, axis2=-1)[..., None, None] / 2
    c = (S @ matter.centre_of_mass[..., None])[..., 0] + R
    second = S @ (half * np.eye(3) - inertia) @ np.swapaxes(S, -1, -2)
    entries = [second[..., i, j] + m * c[..., i] * c[..., j] for i, j in SECOND_MOMENTS]
    return np.stack(np.broadcast_arrays(m, *np.moveaxis(m[..., None] * c, -1, 0), *entries), axis=-1) + 0.0


def _mass_distribution(shapes: tuple[Shape, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centre of mass [m] of shapes of one density, and their inertia about it per mass [m^2]; assume both
    where there are no shapes.
    """
    if not shapes:
        return read_only(np.zeros(3)), _ASSUMED_GYRATION * np.eye(3)
    with np.errstate(all="ignore"):
        volumes, moments = zip(*map(_volume_and_moments, shapes), strict=True)
        weights, centers = np.array(volumes) / sum(volumes), np.array([shape.center for shape in shapes])
        centre_of_mass = weights @ centers
        levers = centers - centre_of_mass
        second_moments = np.einsum("n,ni,nj->ij", weights, levers, levers) + np.einsum("n,nij->ij", weights, moments)
    if not (np.isfinite(second_moments).all() and second_moments.any()):
        raise ArgumentError("shapes", "sizes whose volume and inertia can be computed", shapes)
    return read_only(centre_of_mass), np.trace(second_moments) * np.eye(3) - second_moments


def _volume_and_moments(shape: Shape) -> tuple[float, NDArray[np.float64]]:
    """Return the volume [m^3] of a shape, and the mean of x x^T, with x from its centre in body axes [m^2]."""
    if isinstance(shape, Box):
        return float(shape.size.prod()), (shape.axes * shape.size**2) @ shape.axes.T / 12
    square = np.float64(shape.radius) ** 2  # inf, not OverflowError
    if isinstance(shape, Sphere):
        return 4 / 3 * np.pi * shape.radius * square, square / 5 * np.eye(3)
    along = np.outer(shape.axis, shape.axis)
    return np.pi * square * shape.length, square / 4 * (np.eye(3) - along) + shape.length**2 / 12 * along


def _inertia_matrix(inertia: ArrayLike) -> NDArray[np.float64]:
    """Return the argument `inertia` as a matrix; three moments become a diagonal one."""
    if np.ndim(inertia) == 1:
        return np.diag(one_constant("inertia", inertia, 3))
    return one_constant("inertia", inertia, 3, 3)


def _checked_inertia(inertia: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return an inertia, read-only and exactly symmetric; refuse that of no body, but for rounding."""
    size = float(np.abs(inertia).max())
    if not np.isfinite(size):
        raise ArgumentError("inertia", "finite numbers (mass times the size of the shapes overflows)", inertia)
    if size == 0:
        raise ArgumentError("inertia", "principal moments above 0", inertia)
    scaled = inertia / size
    if np.abs(scaled - scaled.T).max() > 1e-9:  # the tolerance of rotation matrices
        raise ArgumentError("inertia", "a symmetric matrix", inertia)
    small, middle, large = map(float, np.linalg.eigvalsh((scaled + scaled.T) / 2))
    moments = [moment * size for moment in (small, middle, large)]
    if small <= 0:
        raise ArgumentError("inertia", "principal moments above 0", moments)
    # Moments of a flat body that are written with three digits are off by as much.
    if large - small - middle > 1e-3 * (small + middle + large):
        raise ArgumentError("inertia", NO_BODY, moments)
    return read_only(inertia / 2 + inertia.T / 2)


def _positive_number(name: str, value: object) -> float:
    """Return a value as a float; refuse what is not above 0."""
    number = finite_number(name, value)
    if number <= 0:
        raise ArgumentError(name, "a number above 0", value)
    return number
