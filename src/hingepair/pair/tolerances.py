"""Tolerances of the geometry of a pair: random pairs, and the covariance of the pose of body 2."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.numeric.arrays import Float64Array, Frozen, number_not_below_0, one_constant, read_only
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.constants import Constants, check_pair, check_single_pair
from hingepair.pair.derivatives import geometry_jacobian
from hingepair.rotations.matrices import rotation_exp

GEOMETRY_COMPONENT_NAMES: Final = tuple(
    f"{vector}_{letter}" for vector in ("u1", "u2", "n", "home") for letter in "xyz"
)
"""The twelve numbers of a pair's geometry, in the order of its covariance: u1 and u2 [m], n, and the rotation vector
that turns home [rad], both in body 1's axes. `HingeFit.covariance` has the same order."""

DEVIATIONS: Final = ("u1_std", "u2_std", "axis_std", "home_std")
"""The arguments that are standard deviations of the geometry."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PoseCovariance(Frozen):
    """Covariance of the pose of body 2 that tolerances of the pair's geometry cause, to first order, at every sample;
    read-only arrays.

    The pose is R2 [m] and the attitude error [rad], the rotation vector away from the attitude without tolerances,
    world axes. The geometry is u1, u2, n, and the rotation vector by which home deviates, body-1 axes.

    Attributes:
        covariance: covariance of the pose [m, rad]; shape (..., 6, 6).
        jacobian: derivatives of the pose with respect to the geometry; shape (..., 6, 12).
        geometry: covariance of the geometry; shape (12, 12).
    """

    covariance: Float64Array
    jacobian: Float64Array
    geometry: Float64Array

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
        return self._std()[..., :3]

    @property
    def attitude_std(self) -> Float64Array:
        """Standard deviations of the components of the attitude error [rad]; shape (..., 3)."""
        return self._std()[..., 3:]

    def _std(self) -> Float64Array:
        """Return the standard deviations of the pose [m, rad]; shape (..., 6)."""
        return np.asarray(np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=-2, axis2=-1), 0.0)))

    def contributions(self) -> dict[str, Float64Array]:
        """Return the variances of the pose [m^2, rad^2], (..., 6), that each component of the geometry alone causes,
        by name: u1_x to u2_z, "axis" for n as a whole, and home_x to home_z. They add up if the components are
        independent.
        """
        indices = {name: [k] for k, name in enumerate(GEOMETRY_COMPONENT_NAMES) if not name.startswith("n_")}
        columns_by_name = {**dict(list(indices.items())[:6]), "axis": [6, 7, 8], **dict(list(indices.items())[6:])}
        variances = {}
        for name, columns in columns_by_name.items():
            slopes = self.jacobian[..., columns]
            variances[name] = ((slopes @ self.geometry[np.ix_(columns, columns)]) * slopes).sum(axis=-1)
        return variances


def propagate_covariance(
    pair: Constants, body1: BodyMotion, psi: ArrayLike, covariance: ArrayLike | None, **std: ArrayLike
) -> PoseCovariance:
    """Compute what `HingePair.propagate_covariance` returns, from a covariance, or else from standard deviations."""
    if not pair.single:
        raise ShapeError("pair", "one pair, such as HingePair(u1[i], ...)", f"pairs of shape {pair.shape}")
    geometry = geometry_covariance(pair.arrays["n"], covariance, **std)
    slopes = geometry_jacobian(pair, body1, psi)
    pose = (slopes @ geometry) @ np.swapaxes(slopes, -1, -2)
    return PoseCovariance(covariance=read_only(pose), jacobian=read_only(slopes), geometry=read_only(geometry))


def sample_pairs(
    pair: Any,
    samples: int = 10_000,
    *,
    u1_std: ArrayLike = 0.0,
    u2_std: ArrayLike = 0.0,
    axis_std: float = 0.0,
    home_std: ArrayLike = 0.0,
    covariance: ArrayLike | None = None,
    seed: int | np.random.Generator | None = None,
) -> Any:
    """Return a HingePair that holds random pairs within tolerances, normally distributed about a pair, for one call
    of its methods: one state gives a result for each, and of a motion of shape (samples,), state i is computed with
    pair i.

    Args:
        pair: the HingePair as designed, or as fitted; of a PlanarPair, pair.to_spatial().
        samples: number of pairs.
        u1_std: standard deviation of each component of u1, body-1 axes [m]: a number, or shape (3,).
        u2_std: the same of u2, body-2 axes.
        axis_std: standard deviation of each of two tilt angles of the hinge axis, about directions across it [rad].
        home_std: standard deviation of each component of the rotation vector by which home deviates, body-1 axes
            [rad]: a number, or shape (3,).
        covariance: in place of these, the covariance of the components of u1, u2, n and the rotation vector of home,
            in this order; shape (12, 12), such as `HingeFit.covariance`.
        seed: an integer, for the same pairs in every call, or a numpy.random.Generator.

    Returns:
        A HingePair; what deviates has the leading shape (samples,).

    Raises:
        ArgumentError: no tolerance is given, or a covariance beside standard deviations.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0), u2=(-0.5, 0, 0), n=(0, 0, 1))
    >>> made = hp.sample_pairs(pair, 20_000, u1_std=0.001, axis_std=0.002, seed=1)
    >>> R2 = made.forward_kinematics((0, 0, 0, 0, 0, 0, 1.0)).R2
    >>> R2.shape, R2.std(axis=0).round(4)
    ((20000, 3), array([0.001 , 0.001 , 0.0014]))
    """
    check_pair(pair)
    check_single_pair(pair)
    if isinstance(samples, bool) or not isinstance(samples, int | np.integer) or samples < 1:
        raise ArgumentError("samples", "a whole number from 1", quoted(samples))
    try:
        rng = np.random.default_rng(seed)
    except (TypeError, ValueError):
        raise ArgumentError("seed", "an integer from 0 or a numpy.random.Generator", quoted(seed)) from None
    n = pair.n
    geometry = geometry_covariance(n, covariance, u1_std=u1_std, u2_std=u2_std, axis_std=axis_std, home_std=home_std)
    values, axes = np.linalg.eigh(geometry)
    root = (
        axes * np.sqrt(np.maximum(values, 0.0))
    ) @ axes.T  # the symmetric square root, which does not depend on the order of the axes
    du1, du2, tilt, turn = np.split(rng.standard_normal((samples, 12)) @ root, 4, axis=1)
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
    return replace(pair, **changed)


def geometry_covariance(n: Float64Array, covariance: ArrayLike | None, **std: ArrayLike) -> Float64Array:
    """Return the covariance of u1, u2, n and the rotation vector of home, shape (12, 12): the checked `covariance`,
    or that of independent deviations.

    Args:
        n: hinge axis, of unit length; shape (3,).
        covariance: the covariance, or None to use standard deviations.
        **std: standard deviations by the names of `DEVIATIONS`.

    Raises:
        ArgumentError: both are given, or neither.
    """
    sizes = {name: _three_deviations(name, value) for name, value in std.items()}
    names = [name for name, deviations in sizes.items() if deviations.any()]
    if covariance is not None:
        if names:
            expected = "0, since covariance gives all standard deviations"
            raise ArgumentError(names[0], expected, quoted(std[names[0]]))
        return _checked_covariance(covariance)
    if not names:
        expected = f"a positive standard deviation: {', '.join(std)}, or a covariance"
        raise ArgumentError("u1_std", expected, "0 for all of them")
    geometry = np.zeros((12, 12))
    for name, start in (("u1_std", 0), ("u2_std", 3), ("home_std", 9)):
        geometry[start : start + 3, start : start + 3] = np.diag(sizes[name] ** 2)
    geometry[6:9, 6:9] = sizes["axis_std"][0] ** 2 * (np.eye(3) - np.outer(n, n))
    return geometry


def _three_deviations(name: str, value: ArrayLike) -> Float64Array:
    """Return three standard deviations; a number stands for three equal ones."""
    if name == "axis_std" or np.ndim(value) == 0:
        number = value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value
        return np.full(3, number_not_below_0(name, number))
    sizes = one_constant(name, value, 3)
    if (sizes < 0).any():
        raise ArgumentError(name, "numbers not below 0", value)
    return sizes


def _checked_covariance(value: ArrayLike) -> Float64Array:
    """Return the argument `covariance`, exactly symmetric."""
    matrix = one_constant("covariance", value, 12, 12)
    largest = np.diagonal(matrix).max()
    allowed = 1e-9 * largest  # by which rounding may make a covariance asymmetric, and an eigenvalue negative
    if not largest > 0 or np.abs(matrix - matrix.T).max() > allowed or np.linalg.eigvalsh(matrix).min() < -allowed:
        expected = "a covariance: a symmetric matrix whose eigenvalues are not negative and not all 0"
        raise ArgumentError("covariance", expected, "another matrix")
    return np.asarray((matrix + matrix.T) / 2)
