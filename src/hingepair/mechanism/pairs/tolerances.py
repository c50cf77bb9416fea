"""Tolerances of the geometry of a pair: random pairs, and the covariance of the pose of body 2."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, TypeAlias, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism.bodies.body_motion import AT_REST, BodyMotion
from hingepair.mechanism.options import check_options, with_options
from hingepair.mechanism.pairs.subject import (
    INPUT_LABELS,
    PairSubject,
    body1_inputs,
    check_pair,
    check_single,
    check_single_pair,
)
from hingepair.numeric.arrays import Float64Array, Frozen, number_not_below_0, one_constant, read_only
from hingepair.plans.derivatives import Derivative
from hingepair.plans.geometry import GEOMETRY_SHAPES
from hingepair.rotations.matrices import rotation_exp
from hingepair.tables.units import SCALES

LIMITS: Final = ("u1", "u2", "axis", "home")
"""The arguments that are limits of the geometry as on drawings, such as "+-0.2 mm"."""
DEVIATIONS: Final = ("u1_std", "u2_std", "axis_std", "home_std")
"""The arguments that are standard deviations of the geometry, in the order of `LIMITS`."""
GEOMETRY_COMPONENT_NAMES: Final = tuple(f"{name}_{letter}" for name in ("u1", "u2", "n", "home") for letter in "xyz")
"""The twelve numbers of a pair's geometry, in the order of its covariance: u1 and u2 [m], n, and the rotation vector
that turns home [rad], both in body 1's axes. `HingeFit.covariance` has the same order."""

Limits: TypeAlias = str | Sequence[str] | None
"""Limits of a vector: one text for all components, three texts, or one text with three between commas."""
PointTolerances: TypeAlias = Mapping[str, Any] | None
"""Limits of points by name, or their standard deviations: a number or three [m]."""


class ToleranceOptions(TypedDict, total=False):
    """Tolerances of the geometry, in one of three forms, and of points."""

    u1: Limits
    u2: Limits
    axis: str | None
    home: Limits
    u1_std: ArrayLike
    u2_std: ArrayLike
    axis_std: float
    home_std: ArrayLike
    covariance: ArrayLike | None
    points: PointTolerances


TOLERANCE_DEFAULTS: Final[dict[str, Any]] = {
    **dict.fromkeys(LIMITS),
    **dict.fromkeys(DEVIATIONS, 0.0),
    **dict.fromkeys(("covariance", "points")),
}
"""Defaults of tolerances, in the order of signatures."""

# Size and unit of a limit such as "+-0.2 mm".
_LIMIT = re.compile(r"(?:±|\+/?-)\s*(\d+\.?\d*|\.\d+)\s*([A-Za-z°µμ]+)", re.ASCII)
_UNIT_ALIASES: Final = {"°": "deg", "µm": "um", "μm": "um"}  # units as drawings write them


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class _FirstOrder(Frozen):
    """Covariance that scattered numbers cause, to first order, at every sample; read-only arrays."""

    covariance: Float64Array
    jacobian: Float64Array
    geometry: Float64Array
    names: tuple[str, ...]

    def _std(self) -> Any:
        """Return the roots of the diagonal, 0 where rounding made it negative; shape (..., k)."""
        return np.sqrt(np.maximum(np.linalg.diagonal(self.covariance), 0.0))

    def contributions(self) -> dict[str, Float64Array]:
        """Return the variances that each component of the geometry alone causes, by name: u1_x to u2_z, "axis" for n
        as a whole, home_x to home_z, and of a point its own, such as handle_x. They add up if the components are
        independent.
        """
        variances = {}
        for k, name in enumerate(self.names):
            if k not in {7, 8}:
                part = slice(6, 9) if k == 6 else slice(k, k + 1)
                slopes = self.jacobian[..., part]
                variances["axis" if k == 6 else name] = ((slopes @ self.geometry[part, part]) * slopes).sum(axis=-1)
        return variances


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PointCovariance(_FirstOrder):
    """Covariance of the position of a point that tolerances of the pair's geometry and of the point cause, to first
    order, at every sample; read-only arrays.

    Attributes:
        R: covariance of the position, world axes [m^2]; shape (..., 3, 3).
        jacobian: derivatives of the position with respect to the geometry and to the point, body axes; shape
            (..., 3, 15).
        geometry: covariance of the geometry and of the point; shape (15, 15).
    """

    @property
    def R(self) -> Float64Array:
        """Covariance of the position, world axes [m^2]; shape (..., 3, 3)."""
        return self.covariance

    @property
    def R_std(self) -> Float64Array:
        """Standard deviations of the components of the position [m]; shape (..., 3)."""
        std: Float64Array = self._std()
        return std


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseCovariance(_FirstOrder):
    """Covariance of the pose of body 2 that tolerances of the pair's geometry cause, to first order, at every sample;
    read-only arrays. `found["handle"]` is the `PointCovariance` of the point with this name.

    The pose is R2 [m] and the attitude error [rad], the rotation vector away from the attitude without tolerances,
    world axes. The geometry is u1, u2, n, and the rotation vector by which home deviates, body-1 axes.

    Attributes:
        covariance: covariance of the pose [m, rad]; shape (..., 6, 6).
        jacobian: derivatives of the pose with respect to the geometry; shape (..., 6, 12).
        geometry: covariance of the geometry; shape (12, 12).
        points: a PointCovariance by the name of each point of the pair.
    """

    points: Mapping[str, PointCovariance] = field(default_factory=dict)

    def __repr__(self) -> str:
        names = ("R2", "R2_std", "attitude", "attitude_std", *self.points)
        return f"PoseCovariance(shape={tuple(self.covariance.shape[:-2])}: {', '.join(names)})"

    def __getitem__(self, point: str) -> PointCovariance:
        return self.points[point]

    @property
    def R2(self) -> Float64Array:
        """Covariance of R2, world axes [m^2]; shape (..., 3, 3)."""
        return self.covariance[..., :3, :3]

    @property
    def attitude(self) -> Float64Array:
        """Covariance of the attitude error of body 2, world axes [rad^2]; shape (..., 3, 3)."""
        return self.covariance[..., 3:, 3:]

    @property
    def R2_std(self) -> Float64Array:
        """Standard deviations of the components of R2 [m]; shape (..., 3)."""
        std: Float64Array = self._std()[..., :3]
        return std

    @property
    def attitude_std(self) -> Float64Array:
        """Standard deviations of the components of the attitude error [rad]; shape (..., 3)."""
        std: Float64Array = self._std()[..., 3:]
        return std


def propagate_covariance(
    pair: PairSubject, body1: BodyMotion | None, psi: ArrayLike, tolerances: ToleranceOptions
) -> PoseCovariance:
    """Compute what `HingePair.propagate_covariance` returns, from a covariance, or else from tolerances (E5, E7)."""
    check_single(pair)
    check_options("propagate_covariance", tolerances, TOLERANCE_DEFAULTS)
    points = [point.name for point in pair.points]
    own = point_covariances(points, tolerances.get("points"))
    geometry = geometry_covariance(pair.arrays["n"], tolerances, required=not own)
    shapes = {name: GEOMETRY_SHAPES[name] for name in ("u1", "u2", "n", "home")}
    if points:
        shapes["points"] = (3 * len(points),)
    outputs = ("d", "S2", *points)
    computation = pair.computation(outputs, by_geometry=True)
    given = body1_inputs(AT_REST if body1 is None else body1, psi)
    derivative = Derivative("jacobian", outputs, tuple(shapes.items()))
    call = computation.call(tuple(given), "auto", derivatives=(derivative,))
    found = computation.answer(call, given, None, 1, INPUT_LABELS)
    slopes = {one: np.concat([found[f"{one}_{name}"] for name in shapes], axis=-1) for one in outputs}

    def first_order(jacobian: Any, variances: Float64Array, *names: str) -> tuple[Any, Any, Any, tuple[str, ...]]:
        covariance = read_only((jacobian @ variances) @ np.matrix_transpose(jacobian))
        return covariance, read_only(jacobian), read_only(variances), (*GEOMETRY_COMPONENT_NAMES, *names)

    by_point = {}
    for k, name in enumerate(points):
        both = np.zeros((15, 15))
        both[:12, :12] = geometry
        if name in own:
            both[12:, 12:] = own[name]
        columns = [*range(12), *range(12 + 3 * k, 15 + 3 * k)]
        letters = (f"{name}_{letter}" for letter in "xyz")
        by_point[name] = PointCovariance(*first_order(slopes[name][..., columns], both, *letters))
    pose = np.concat([slopes["d"], slopes["S2"]], axis=-2)[..., :12]
    return PoseCovariance(*first_order(pose, geometry), by_point)


@with_options(**TOLERANCE_DEFAULTS)
def sample_pairs(
    pair: Any,
    samples: int = 10_000,
    *,
    seed: int | np.random.Generator | None = None,
    **tolerances: Unpack[ToleranceOptions],
) -> Any:
    """Return a HingePair that holds random pairs about a pair, for one call of its methods: one state gives a result
    for each, and of a motion of shape (samples,), state i is computed with pair i.

    Args:
        pair: the HingePair as designed, or as fitted; of a PlanarPair, pair.to_spatial().
        samples: number of pairs.
        u1: limits of each component of u1 as on drawings, body-1 axes: "+-0.2 mm", normally distributed with three
            standard deviations at the limit; or three of these.
        u2: the same of u2, body-2 axes.
        axis: limit of the tilt of the hinge axis in each of two directions across it, "+-0.1 deg".
        home: limits of each component of the rotation vector by which home deviates, body-1 axes, as those of u1.
        u1_std: in place of u1, the standard deviation of each component [m]: a number, or shape (3,).
        u2_std: the same of u2.
        axis_std: standard deviation of each of two tilt angles of the hinge axis, about directions across it [rad].
        home_std: standard deviation of each component of the rotation vector of home [rad]: a number, or shape (3,).
        covariance: in place of these, the covariance of the components of u1, u2, n and the rotation vector of home,
            in this order; shape (12, 12), such as `HingeFit.covariance`.
        points: tolerances of points of the bodies by name, {"handle": "+-0.5 mm"}: limits in body axes as those of
            u1, or standard deviations, a number or three [m].
        seed: an integer, for the same pairs in every call, or a numpy.random.Generator.

    Returns:
        A HingePair; what deviates has the leading shape (samples,).

    Raises:
        ArgumentError: no tolerance is given, or two for one dimension.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0), u2=(-0.5, 0, 0), n=(0, 0, 1))
    >>> made = hp.sample_pairs(pair, 20_000, u1_std=0.001, axis_std=0.002, seed=1)
    >>> R2 = made.forward_kinematics((0, 0, 0, 0, 0, 0, 1.0)).R2
    >>> R2.shape, R2.std(axis=0).round(4)
    ((20000, 3), array([0.001 , 0.001 , 0.0014]))
    >>> hp.sample_pairs(pair, 20_000, u1="+-0.3 mm", seed=1).u1.std(axis=0).round(6)
    array([0.0001, 0.0001, 0.0001])
    """
    check_pair(pair)
    check_single_pair(pair)
    if isinstance(samples, bool) or not isinstance(samples, int | np.integer) or samples < 1:
        raise ArgumentError("samples", "a whole number from 1", quoted(samples))
    try:
        rng = np.random.default_rng(seed)
    except (TypeError, ValueError):
        raise ArgumentError("seed", "an integer from 0 or a numpy.random.Generator", quoted(seed)) from None
    check_options("sample_pairs", tolerances, TOLERANCE_DEFAULTS)
    n = pair.n
    own = point_covariances([*pair.points1, *pair.points2], tolerances.get("points"))
    geometry = geometry_covariance(n, tolerances, required=not own)
    du1, du2, tilt, turn = np.split(_draws(geometry, rng, samples), 4, axis=1)
    made = {
        "u1": pair.u1 + du1,
        "u2": pair.u2 + du2,
        "n": (rotation_exp(np.cross(n, tilt)) @ n[:, None])[..., 0],
        "home": rotation_exp(turn) @ pair.home,
    }
    scattered = np.split(np.diagonal(geometry), 4)
    changed: dict[str, Any] = {name: made[name] for name, one in zip(made, scattered, strict=True) if one.any()}
    for key, positions in (("points1", pair.points1), ("points2", pair.points2)):
        some = {name: positions[name] + _draws(own[name], rng, samples) for name in positions if name in own}
        if some:
            changed[key] = {**positions, **some}
    return replace(pair, **changed)


def _draws(covariance: Float64Array, rng: np.random.Generator, samples: int) -> Float64Array:
    """Return random deviations (samples, k) with a covariance (k, k)."""
    values, axes = np.linalg.eigh(covariance)
    # The symmetric square root does not depend on the order of the eigenvectors.
    root = (axes * np.sqrt(np.maximum(values, 0.0))) @ axes.T
    found: Float64Array = rng.standard_normal((samples, len(root))) @ root
    return found


def point_covariances(names: Sequence[str], tolerances: PointTolerances) -> dict[str, Float64Array]:
    """Return the covariances of points, (3, 3), by name.

    Args:
        names: names of the points of a pair.
        tolerances: limits or standard deviations by name; None for none.

    Raises:
        ArgumentError: a point is unknown, or its tolerance cannot be used.
    """
    if not isinstance(tolerances, Mapping | None):
        raise ArgumentError("points", 'tolerances by name, such as {"handle": "+-0.5 mm"}', quoted(tolerances))
    found = {}
    for name, value in (tolerances or {}).items():
        if name not in names:
            expected = f"{choices(tuple(names))}{nearest(str(name), tuple(names))}" if names else "a pair with points"
            raise ArgumentError("points", expected, quoted(name))
        label, parts = f"points[{name!r}]", value if isinstance(value, list | tuple) else (value,)
        is_text = any(isinstance(part, str) for part in parts)
        found[name] = np.diag((read_limits(label, value) if is_text else _three_deviations(label, value)) ** 2)
    return found


def geometry_covariance(n: Float64Array, tolerances: Mapping[str, Any], *, required: bool = True) -> Float64Array:
    """Return the covariance of u1, u2, n and the rotation vector of home, (12, 12): the one that is given, checked,
    or that of independent tolerances.

    Args:
        n: hinge axis, of unit length; shape (3,).
        tolerances: values by the names of `LIMITS` and `DEVIATIONS`; or the covariance.
        required: whether at least one dimension must have a tolerance.

    Raises:
        ArgumentError: a dimension has two tolerances, or none has one.
    """
    sizes, names = np.zeros((4, 3)), []
    for k, (limit, deviation) in enumerate(zip(LIMITS, DEVIATIONS, strict=True)):
        sizes[k] = _three_deviations(deviation, tolerances.get(deviation, 0.0))
        within = tolerances.get(limit)
        if within is not None:
            if sizes[k].any():
                raise ArgumentError(deviation, f"0, since {limit} gives the tolerance", quoted(tolerances[deviation]))
            sizes[k] = read_limits(limit, within)
        if sizes[k].any():
            names.append(limit if within is not None else deviation)
    if (covariance := tolerances.get("covariance")) is not None:
        if names:
            expected = f"{'None' if names[0] in LIMITS else '0'}, since covariance gives all standard deviations"
            raise ArgumentError(names[0], expected, quoted(tolerances[names[0]]))
        return _checked_covariance(covariance)
    if required and not names:
        expected = (
            f"a tolerance ({', '.join(LIMITS)}), a standard deviation ({', '.join(DEVIATIONS)}), or a covariance"
        )
        raise ArgumentError("u1", expected, "none, or 0 for all")
    geometry = np.diag(sizes.ravel() ** 2)
    geometry[6:9, 6:9] = sizes[2, 0] ** 2 * (np.eye(3) - np.outer(n, n))
    return geometry


def read_limits(name: str, value: Any) -> Float64Array:
    """Return the standard deviations (3,) that limits as on drawings mean: a third of each.

    >>> read_limits("u1", "+-0.3 mm, +-0.6 mm, 0").round(6).tolist()
    [0.0001, 0.0002, 0.0]
    """
    si = "rad" if name in {"axis", "home"} else "m"
    parts = re.split("[,;]", value) if isinstance(value, str) else value
    if isinstance(parts, Sequence) and (len(parts) == 1 or (len(parts) == 3 and name != "axis")):
        found = [_read_limit(part, si) for part in parts]
        if None not in found:
            return np.array(found * (3 // len(found)), dtype=np.float64) / 3.0
    example = {"m": "+-0.2 mm", "rad": "+-0.1 deg"}[si]
    many = "" if name == "axis" else ", or three of these"
    expected = f'"{example}"{many}, in {choices([si, *SCALES[si]])}'
    number = f"{name}_std takes" if name in LIMITS else "a number is"
    raise ArgumentError(name, f"{expected}; {number} a standard deviation", quoted(value))


def _read_limit(part: Any, si: str) -> float | None:
    """Return one limit such as "+-0.2 mm" [m or rad]; None if it cannot be read."""
    text = part.strip() if isinstance(part, str) else ""
    if text == "0":
        return 0.0
    match, scales = _LIMIT.fullmatch(text), {si: 1.0, **SCALES[si]}
    if match is None or (unit := _UNIT_ALIASES.get(match[2], match[2])) not in scales:
        return None
    return float(match[1]) * scales[unit]


def _three_deviations(name: str, value: ArrayLike) -> Float64Array:
    """Return the argument `name` as three standard deviations, of a number equal ones; refuse negative ones."""
    if name == "axis_std" or np.ndim(value) == 0:
        number = value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value
        return np.full(3, number_not_below_0(name, number))
    sizes = one_constant(name, value, 3)
    if (sizes < 0).any():
        raise ArgumentError(name, "numbers not below 0", value)
    return sizes


def _checked_covariance(value: ArrayLike) -> Float64Array:
    """Return the argument `covariance`, (12, 12), exactly symmetric; refuse other matrices, and 0."""
    matrix = one_constant("covariance", value, 12, 12)
    largest = np.diagonal(matrix).max()
    allowed = 1e-9 * largest  # by which rounding may make a covariance asymmetric, and an eigenvalue negative
    if not largest > 0 or np.abs(matrix - matrix.T).max() > allowed or np.linalg.eigvalsh(matrix).min() < -allowed:
        expected = "a covariance: a symmetric matrix whose eigenvalues are not negative and not all 0"
        raise ArgumentError("covariance", expected, "another matrix")
    return np.asarray((matrix + matrix.T) / 2)
