"""Tolerances of the geometry of a pair: random pairs, and the covariance of the pose of body 2."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple, TypeAlias, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.backend import execution_of
from hingepair.errors import ArgumentError, ShapeError, choices, nearest, quoted
from hingepair.mechanism.bodies.body_motion import AT_REST, BodyMotion
from hingepair.mechanism.options import check_options, with_options
from hingepair.mechanism.pairs.geometry import Constants, check_pair, check_single_pair
from hingepair.mechanism.pairs.requests import INPUT_LABELS, body1_inputs, computation_of
from hingepair.numeric.arrays import Float64Array, Frozen, number_not_below_0, one_constant, read_only
from hingepair.plans.derivatives import Derivative
from hingepair.plans.geometry import GEOMETRY_SHAPES
from hingepair.rotations.matrices import rotation_exp
from hingepair.tables.units import SCALES

GEOMETRY_COMPONENT_NAMES: Final = tuple(
    f"{vector}_{letter}" for vector in ("u1", "u2", "n", "home") for letter in "xyz"
)
"""The twelve numbers of a pair's geometry, in the order of its covariance: u1 and u2 [m], n, and the rotation vector
that turns home [rad], both in body 1's axes. `HingeFit.covariance` has the same order."""

DEVIATIONS: Final = ("u1_std", "u2_std", "axis_std", "home_std")
"""The arguments that are standard deviations of the geometry."""

LIMITS: Final = ("u1", "u2", "axis", "home")
"""The arguments that are limits of the geometry as on drawings, such as "+-0.2 mm"; in the order of `DEVIATIONS`."""

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

# A comma between two digits is a decimal comma.
_SEPARATOR = re.compile(r"\s*(?:;|,(?=\s|[+±])|(?<!\d),)\s*")
# Size, exponent, unit and distribution of a limit such as "+-0.2 mm uniform".
_LIMIT = re.compile(
    r"(?:±|\+/?-)\s*(\d+(?:[.,]\d*)?|[.,]\d+)(e[+-]?\d+)?\s*([A-Za-z°µμ]+)(?:\s+(normal|uniform))?", re.ASCII
)
_UNIT_ALIASES: Final = {"°": "deg", "µm": "um", "μm": "um"}  # units as drawings write them


_UNIFORM: Final = np.sqrt(3.0)  # end of a uniform distribution, in standard deviations


class PointScatter(NamedTuple):
    """How the components of a point scatter, in body axes."""

    std: Float64Array  # [m]; (3,)
    uniform: NDArray[np.bool_]  # components that are uniformly distributed, not normally; (3,)

    def draws(self, rng: np.random.Generator, samples: int) -> Float64Array:
        """Return random deviations (samples, 3)."""
        normal, even = rng.standard_normal((samples, 3)), rng.uniform(-_UNIFORM, _UNIFORM, (samples, 3))
        return np.where(self.uniform, even, normal) * self.std


class Scatter(NamedTuple):
    """How the geometry of pairs scatters."""

    covariance: Float64Array  # in the order of `GEOMETRY_COMPONENT_NAMES`; (12, 12)
    uniform: NDArray[np.bool_]  # components that are uniformly distributed, not normally; (12,)


def _std(covariance: Any) -> Any:
    """Return standard deviations, the roots of the diagonal, 0 where rounding made it negative; shape (..., k)."""
    variances = np.linalg.diagonal(covariance)
    return np.sqrt(np.where(variances < 0, 0 * variances, variances))


def _contributions(jacobian: Any, geometry: Any, point: str = "") -> dict[str, Any]:
    """Return the variances that each component of the geometry, and of a point, alone causes, by name."""
    names = (*GEOMETRY_COMPONENT_NAMES, *(f"{point}_{letter}" for letter in "xyz"))[: geometry.shape[0]]
    columns = {"axis" if k == 6 else names[k]: slice(k, k + 3 if k == 6 else k + 1)
               for k in range(len(names)) if k not in {7, 8}}  # fmt: skip
    variances = {}
    for name, part in columns.items():
        slopes = jacobian[..., part]
        products = (slopes @ geometry[part, part]) * slopes
        variances[name] = products.sum(axis=-1)
    return variances


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class PointCovariance(Frozen):
    """Covariance of the position of a point that tolerances of the pair's geometry and of the point cause, to first
    order, at every sample; read-only arrays.

    Attributes:
        name: name of the point.
        R: covariance of the position, world axes [m^2]; shape (..., 3, 3).
        jacobian: derivatives of the position with respect to the geometry and to the point, body axes; shape
            (..., 3, 15).
        geometry: covariance of the geometry and of the point; shape (15, 15).
    """

    name: str
    R: Float64Array
    jacobian: Float64Array
    geometry: Float64Array

    def __repr__(self) -> str:
        return f"PointCovariance({self.name}, shape={tuple(self.R.shape[:-2])}: R, R_std, jacobian, geometry)"

    @property
    def R_std(self) -> Float64Array:
        """Standard deviations of the components of the position [m]; shape (..., 3)."""
        std: Float64Array = _std(self.R)
        return std

    def contributions(self) -> dict[str, Float64Array]:
        """Return the variances of the position [m^2], (..., 3), that each component of the geometry alone causes, as
        `PoseCovariance.contributions`, and each component of the point, such as handle_x.
        """
        return _contributions(self.jacobian, self.geometry, self.name)


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class PoseCovariance(Frozen):
    """Covariance of the pose of body 2 that tolerances of the pair's geometry cause, to first order, at every sample;
    read-only arrays.

    The pose is R2 [m] and the attitude error [rad], the rotation vector away from the attitude without tolerances,
    world axes. The geometry is u1, u2, n, and the rotation vector by which home deviates, body-1 axes.

    Attributes:
        covariance: covariance of the pose [m, rad]; shape (..., 6, 6).
        jacobian: derivatives of the pose with respect to the geometry; shape (..., 6, 12).
        geometry: covariance of the geometry; shape (12, 12).
        points: a PointCovariance for each point of the pair, or None; `found["handle"]` is that of the name handle.
    """

    covariance: Float64Array
    jacobian: Float64Array
    geometry: Float64Array
    points: tuple[PointCovariance, ...] | None = None

    def __repr__(self) -> str:
        names = ("R2", "R2_std", "attitude", "attitude_std", *(repr(point.name) for point in self.points or ()))
        return f"PoseCovariance(shape={tuple(self.covariance.shape[:-2])}: {', '.join(names)})"

    def __getitem__(self, point: str) -> PointCovariance:
        return {own.name: own for own in self.points or ()}[point]

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
        std: Float64Array = _std(self.covariance)[..., :3]
        return std

    @property
    def attitude_std(self) -> Float64Array:
        """Standard deviations of the components of the attitude error [rad]; shape (..., 3)."""
        std: Float64Array = _std(self.covariance)[..., 3:]
        return std

    def contributions(self) -> dict[str, Float64Array]:
        """Return the variances of the pose [m^2, rad^2], (..., 6), that each component of the geometry alone causes,
        by name: u1_x to u2_z, "axis" for n as a whole, and home_x to home_z. They add up if the components are
        independent.
        """
        return _contributions(self.jacobian, self.geometry)


def propagate_covariance(
    pair: Constants, body1: BodyMotion | None, psi: ArrayLike, tolerances: ToleranceOptions
) -> PoseCovariance:
    """Compute what `HingePair.propagate_covariance` returns, from a covariance, or else from tolerances."""
    if not pair.single:
        raise ShapeError("pair", "one pair, such as HingePair(u1[i], ...)", f"pairs of shape {pair.shape}")
    body1 = AT_REST if body1 is None else body1
    check_options("propagate_covariance", tolerances, TOLERANCE_DEFAULTS)
    own = point_scatter([point.name for point in pair.points], tolerances.get("points"))
    geometry, _ = geometry_scatter(pair.arrays["n"], tolerances, required=not own)
    turned = tuple(point.name for point in pair.points if point.body == 2)
    slopes = _geometry_jacobian(pair, body1, psi, turned)

    def scattered(jacobian: Any, variances: Float64Array) -> tuple[Any, ...]:
        arrays = (jacobian @ variances) @ np.matrix_transpose(jacobian), jacobian, variances
        return tuple(map(read_only, arrays))

    found = []
    if pair.points:
        attitudes = {1: body1.S + 0 * slopes[..., :3, :3], 2: _attitude_of_body2(pair, body1, psi)}
        for name, body in pair.points:
            row = 6 + 3 * turned.index(name) if body == 2 else 0
            by_geometry = slopes[..., row : row + 3, :] if body == 2 else 0 * slopes[..., :3, :]
            both = np.zeros((15, 15))
            both[:12, :12] = geometry
            both[12:, 12:] = np.diag(own[name].std ** 2) if name in own else 0.0
            R, jacobian, variances = scattered(np.concat([by_geometry, attitudes[body]], axis=-1), both)
            found.append(PointCovariance(name=name, R=R, jacobian=jacobian, geometry=variances))
    pose, slopes, variances = scattered(slopes[..., :6, :], geometry)
    return PoseCovariance(covariance=pose, jacobian=slopes, geometry=variances, points=tuple(found) or None)


def _geometry_jacobian(pair: Constants, body1: BodyMotion, psi: ArrayLike, points: tuple[str, ...] = ()) -> Any:
    """Compute the derivatives of R2, of body 2's attitude and of some points (rows) by u1, u2, n and home (columns);
    shape (..., 6 + 3 k, 12) (E5, E7). Changes of the attitude are rotation vectors in world axes; those of home, in
    body-1 axes.
    """
    names, outputs = ("u1", "u2", "n", "home"), ("d", "S2", *points)
    arguments = tuple((name, GEOMETRY_SHAPES[name]) for name in names)
    computation = computation_of(pair, outputs, by_geometry=True)
    derivative = Derivative("jacobian", outputs, arguments)
    given = body1_inputs(body1, psi)
    call = computation.call(tuple(given), "auto", derivatives=(derivative,))
    found = computation.answer(call, given, None, 1, INPUT_LABELS)
    rows = [[found[f"{output}_{name}"] for name in names] for output in outputs]
    return np.concat([np.concat(row, axis=-1) for row in rows], axis=-2)


def _attitude_of_body2(pair: Constants, body1: BodyMotion, psi: ArrayLike) -> Any:
    """Compute S2; shape (..., 3, 3) (E5)."""
    given = body1_inputs(body1, psi)
    return computation_of(pair, ("S2",)).compute(given, execution_of("auto", 1), labels=INPUT_LABELS)["S2"]


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
            standard deviations at the limit; "+-0.2 mm uniform", where all values between the limits are as likely;
            or three of these.
        u2: the same of u2, body-2 axes.
        axis: limit of the tilt of the hinge axis, "+-0.1 deg": as above in each of two directions across it;
            "uniform" makes all tilts up to the limit, in any direction, as likely.
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
    >>> drilled = hp.sample_pairs(pair, 20_000, u1="+-0.2 mm uniform", seed=1)
    >>> float(abs(drilled.u1 - pair.u1).max().round(6))
    0.0002
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
    own = point_scatter([*pair.points1, *pair.points2], tolerances.get("points"))
    geometry, uniform = geometry_scatter(n, tolerances, required=not own)
    values, axes = np.linalg.eigh(geometry)
    # The symmetric square root does not depend on the order of the eigenvectors.
    root = (axes * np.sqrt(np.maximum(values, 0.0))) @ axes.T
    du1, du2, tilt, turn = np.split(_unit_draws(rng, samples, n, uniform) @ root, 4, axis=1)
    variances = np.diagonal(geometry)
    changed: dict[str, Any] = {}
    if variances[:3].any():
        changed["u1"] = pair.u1 + du1
    if variances[3:6].any():
        changed["u2"] = pair.u2 + du2
    if variances[6:9].any():
        changed["n"] = (rotation_exp(np.cross(n, tilt)) @ n[:, None])[..., 0]
    if variances[9:].any():
        changed["home"] = rotation_exp(turn) @ pair.home
    for key, positions in (("points1", pair.points1), ("points2", pair.points2)):
        some = {name: positions[name] + own[name].draws(rng, samples) for name in positions if name in own}
        if some:
            changed[key] = {**positions, **some}
    return replace(pair, **changed)


def _unit_draws(rng: np.random.Generator, samples: int, n: Float64Array, uniform: NDArray[np.bool_]) -> Float64Array:
    """Return random numbers (samples, 12) of variance 1; those of the axis have it in each direction across n."""
    draws = rng.standard_normal((samples, 12))
    if uniform[6]:  # evenly over a disk
        across = draws[:, 6:9] - (draws[:, 6:9] @ n)[:, None] * n
        radii = 2.0 * np.sqrt(rng.random((samples, 1)))
        draws[:, 6:9] = radii * across / np.linalg.norm(across, axis=1, keepdims=True)
    others = [k for k in np.flatnonzero(uniform) if not 6 <= k < 9]
    draws[:, others] = rng.uniform(-_UNIFORM, _UNIFORM, (samples, len(others)))
    return draws


def point_scatter(names: Sequence[str], tolerances: PointTolerances) -> dict[str, PointScatter]:
    """Return how points scatter, by name.

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
        if any(isinstance(part, str) for part in parts):
            found[name] = PointScatter(*read_limits(label, value))
        else:
            found[name] = PointScatter(_three_deviations(label, value), np.zeros(3, np.bool_))
    return found


def geometry_scatter(n: Float64Array, tolerances: Mapping[str, Any], *, required: bool = True) -> Scatter:
    """Return how u1, u2, n and the rotation vector of home scatter: as a checked covariance says, or independently
    within tolerances.

    Args:
        n: hinge axis, of unit length; shape (3,).
        tolerances: values by the names of `LIMITS` and `DEVIATIONS`; or the covariance.
        required: whether at least one dimension must have a tolerance.

    Raises:
        ArgumentError: a dimension has two tolerances, or none has one.
    """
    sizes, uniform, names = np.zeros((4, 3)), np.zeros((4, 3), bool), []
    for k, (limit, deviation) in enumerate(zip(LIMITS, DEVIATIONS, strict=True)):
        std = _three_deviations(deviation, tolerances.get(deviation, 0.0))
        within = tolerances.get(limit)
        if within is not None:
            if std.any():
                raise ArgumentError(deviation, f"0, since {limit} gives the tolerance", quoted(tolerances[deviation]))
            std, uniform[k] = read_limits(limit, within)
        if std.any():
            sizes[k] = std
            names.append(limit if within is not None else deviation)
    if (covariance := tolerances.get("covariance")) is not None:
        if names:
            expected = f"{'None' if names[0] in LIMITS else '0'}, since covariance gives all standard deviations"
            raise ArgumentError(names[0], expected, quoted(tolerances[names[0]]))
        return Scatter(_checked_covariance(covariance), uniform.ravel())
    if required and not names:
        expected = (
            f"a tolerance ({', '.join(LIMITS)}), a standard deviation ({', '.join(DEVIATIONS)}), or a covariance"
        )
        raise ArgumentError("u1", expected, "none, or 0 for all")
    geometry = np.diag(sizes.ravel() ** 2)
    geometry[6:9, 6:9] = sizes[2, 0] ** 2 * (np.eye(3) - np.outer(n, n))
    return Scatter(geometry, uniform.ravel())


def read_limits(name: str, value: Any) -> tuple[Float64Array, NDArray[np.bool_]]:
    """Return the standard deviations (3,) that limits as on drawings mean, of normal ones a third, and which of them
    are of uniform distributions.

    >>> read_limits("u1", "+-0.3 mm, +-0,6 mm normal, 0")[0].round(6).tolist()
    [0.0001, 0.0002, 0.0]
    """
    si = "rad" if name in {"axis", "home"} else "m"
    parts = _SEPARATOR.split(value.strip()) if isinstance(value, str) else value
    if isinstance(parts, Sequence) and (len(parts) == 1 or (len(parts) == 3 and name != "axis")):
        found = [_read_limit(part, si, round_zone=name == "axis") for part in parts]
        if None not in found:
            std, uniform = zip(*(found * (3 // len(found))), strict=True)
            return np.array(std), np.array(uniform)
    example = {"m": "+-0.2 mm", "rad": "+-0.1 deg"}[si]
    many = "" if name == "axis" else ", or three of these"
    expected = f'"{example}" or "{example} uniform"{many}, in {choices([si, *SCALES[si]])}'
    number = f"{name}_std takes" if name in LIMITS else "a number is"
    raise ArgumentError(name, f"{expected}; {number} a standard deviation", quoted(value))


def _read_limit(part: Any, si: str, *, round_zone: bool) -> tuple[float, bool] | None:
    """Return the standard deviation [m or rad] that one limit such as "+-0.2 mm uniform" means, and whether it is of
    a uniform distribution; None if it cannot be read. A normal limit is three standard deviations; a uniform one half
    an interval or, with `round_zone`, the radius of a disc. `si` is the unit from which others are converted.
    """
    if isinstance(part, str) and part.strip() == "0":
        return 0.0, False
    match = _LIMIT.fullmatch(part.strip()) if isinstance(part, str) else None
    scales = {si: 1.0, **SCALES[si]}
    if match is None or (unit := _UNIT_ALIASES.get(match[3], match[3])) not in scales:
        return None
    if re.fullmatch(r"0*[1-9]\d*,\d{3}", match[1]):  # a thousand, or one?
        return None
    limit = float(match[1].replace(",", ".") + (match[2] or "")) * scales[unit]
    if match[4] != "uniform":
        return limit / 3.0, False
    return limit / (2.0 if round_zone else np.sqrt(3.0)), True


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
