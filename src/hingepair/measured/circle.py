"""The hinge of a body and a point: seen from body 1, a point of body 2 runs along a circle about the axis.

Off the circle it is by noise alike in all directions, so that the most likely circle makes the sum of squared
distances least, out of the plane and across it. Attitudes of body 2 are not seen: `home` is the identity. An offset
between the clocks of the bodies takes the point off the circle where body 1 moves; it is one more parameter.
"""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import FitError
from hingepair.measured.findings import (
    MAX_NEIGHBOUR_CORRELATION_OF_RANDOM_RESIDUALS,
    MAX_RELIABLE_HINGE_AXIS_STD_IN_RADIANS,
    MAX_RELIABLE_HINGE_POINT_STD_TO_LEVER_LENGTH,
    MIN_OUTLIER_WHITENED_SQUARED_RESIDUAL,
    Finding,
    split_findings,
)
from hingepair.measured.hinge import first_axis_across, frame, sign_of, tilt_axis
from hingepair.measured.likelihood import (
    CHI2_MEDIAN_BY_DOF,
    MAX_STD_OF_DETERMINED_CLOCK_OFFSET_IN_SECONDS,
    MAX_THINNED_SAMPLES_FOR_FIRST_FIT_PASS,
    MIN_SIGNAL_TO_NOISE_POWER_OF_DETERMINED_CLOCK_OFFSET,
    Loss,
    PosesAt,
    score_scatter,
    solve_semidefinite,
)
from hingepair.measured.relative_poses import MAX_THINNED_SAMPLES_FOR_CANDIDATE_RANKING, RelativePoses
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.tables import percent
from hingepair.rotations.matrices import rotation_exp

_NUM_CIRCLE_PARAMETERS = 6
"""Those of `Circle.moved`, which come first; then the clock offset, where it is sought."""
# A fit of many samples makes two passes: with thinned samples, then with all.
_MAX_GAUSS_NEWTON_STEPS_PER_CIRCLE_FIT_PASS = 60
# Change as `Circle.relative_change` returns it, above which a Gauss-Newton step is shortened.
_MAX_RELATIVE_CIRCLE_CHANGE_PER_GAUSS_NEWTON_STEP = 0.3
_MAX_CONVERGED_CIRCLE_STEP_NORM_IN_PARAMETER_STDS = 1e-3  # in standard deviations of the parameters
# Of squared distances, above which samples count less.
_LOSS_SCALE_OF_SQUARED_CIRCLE_DISTANCE_IN_NOISE_VARIANCES = 5.99
_MIN_SQUARED_CIRCLE_DISTANCE_OF_ZERO_WEIGHT_IN_NOISE_VARIANCES = 900.0  # above, samples have no weight
_MAX_STRAIGHT_PATH_WIDTH_TO_OUT_OF_PLANE_EXTENT = 3.0  # in the plane across the chord, to across the plane
# Of residuals that are not noise: a hinge is still reported below this.
_MAX_HARMLESS_SYSTEMATIC_RESIDUAL_TO_CIRCLE_RADIUS = 0.02
_POSITION_ERROR_OF_TIME_SHIFTED_SAMPLE_TO_CIRCLE_RADIUS = 1e-6  # of exact samples moved by `ClockedPoses`
_MAX_CONVERGED_CLOCK_OFFSET_STEP_IN_SECONDS = 1e-6  # of the clock offset [s]
# [rad, m] of the central differences of the results.
_DIFFERENCE_STEP_OF_CIRCLE_PARAMETERS_IN_RADIANS_OR_METRES = 1e-6


class Circle(NamedTuple):
    """A circle in the axes of body 1, on which a point of body 2 moves: the unit vector n along the axis of the
    circle, the centre [m] and the radius [m]. Methods return the levers of the hinge and the hinge angles.
    """

    n: Float64Array  # axis, unit; (3,)
    centre: Float64Array  # [m]; (3,)
    radius: float  # [m]

    def moved(self, step: Float64Array) -> Circle:
        """Return the circle after a step of six numbers: two angles [rad] by which n turns towards the first and the
        second axis of `frame(n)`, three shifts [m] of the centre along the axes of `frame(n)`, and a change of the
        radius [m]. `frame` returns three orthonormal axes, of which n is the third.
        """
        centre = self.centre + frame(self.n) @ step[2:5]
        return Circle(tilt_axis(self.n, step[:2]), centre, self.radius + float(step[5]))

    def relative_change(self, step: Float64Array) -> float:
        """Return the largest absolute value among the six numbers of a step of `moved`, after the shifts and the
        change of the radius are divided by the diameter. Rotations [rad] count as they are.
        """
        return max(float(np.abs(step[:2]).max()), float(np.abs(step[2:6]).max()) / (2 * self.radius))

    @property
    def zero_direction(self) -> Float64Array:
        """Return the unit vector, in axes of body 1, from the centre to the point of the circle where psi = 0;
        (3,).
        """
        across = np.eye(3)[first_axis_across(self.n)]
        start = across - (across @ self.n) * self.n
        return np.asarray(start / np.linalg.norm(start))

    def levers(self, gauge: str) -> tuple[Float64Array, Float64Array]:
        """Return the tuple (u1, u2) of the levers (3,) of the hinge, in axes of body 1 at psi = 0: u1 leads from R1
        to the hinge point, and u2 from the moving point to the hinge point. `gauge`, "closest_to_R1" or
        "closest_to_R2", names the point on the axis that is the hinge point.
        """
        u1 = self.centre - (self.centre @ self.n) * self.n if gauge == "closest_to_R1" else self.centre
        return u1, u1 - self.centre - self.radius * self.zero_direction

    def angles(self, p: Float64Array) -> Float64Array:
        """Return the hinge angles psi (N,) [rad] at which the moving point is at positions p (N, 3)."""
        off = p - self.centre
        return np.asarray(np.arctan2(off @ np.cross(self.n, self.zero_direction), off @ self.zero_direction))


class CircleFit(NamedTuple):
    """The most likely Circle of a moving point (`circle`), with the RelativePoses used (`poses`), the `residuals` (N,
    2), `weights` (N,) and `outliers` (N,) of the samples (an outlier has 1.0, any other sample 0.0), the `noise` of a
    coordinate [m], findings, the `covariance` (12, 12) of the hinge that follows from the circle, the normal matrix
    (`normal`), whether the fit converged, and the clock offset with its standard deviation [s].
    """

    circle: Circle
    noise: float  # standard deviation of a coordinate [m]
    residuals: Float64Array  # out of the plane and across the circle [m]; (N, 2)
    weights: Float64Array  # (N,)
    outliers: Float64Array  # 1 where a sample is far off, else 0; (N,)
    covariance: Float64Array  # of u1, u2, n and home; (12, 12)
    findings: tuple[Finding, ...]
    poses: RelativePoses  # at the clock offset
    has_converged: bool  # whether the steps came to rest
    offset: float  # clock offset [s]
    offset_std: float  # its standard deviation, 0 where it was not estimated [s]
    normal: Float64Array  # matrix of the normal equations, in squares of metres; (6, 6), or (7, 7) with the offset

    def shows_offset(self, noise_poses: RelativePoses) -> bool:
        """Return whether the motion determines the clock offset: whether the fit has converged, the residuals depend
        on the offset far more than they would by noise alone, and the offset is certain enough. `noise_poses` are
        RelativePoses whose derivatives with respect to the offset are noise alone.
        """
        k = _NUM_CIRCLE_PARAMETERS
        across = np.linalg.lstsq(self.normal[:k, :k], self.normal[:k, k])[0]
        shown = self.normal[k, k] - self.normal[k, :k] @ across
        _, change = _residuals_and_derivatives(self.circle, noise_poses)
        noise = float(self.weights @ (change[:, :, k] ** 2).sum(axis=1))
        certain = shown * MAX_STD_OF_DETERMINED_CLOCK_OFFSET_IN_SECONDS**2 > self.noise**2
        return self.has_converged and bool(
            shown > MIN_SIGNAL_TO_NOISE_POWER_OF_DETERMINED_CLOCK_OFFSET * noise and certain
        )


def fit_circle(
    poses: RelativePoses,
    loss: Loss | None,
    gauge: str,
    poses_at: PosesAt | None = None,
    offset: float = 0.0,
    *,
    is_body1_exact: bool = False,
) -> CircleFit:
    """Fit the most likely circle to the path of a point of body 2 relative to body 1 (`poses`); return a CircleFit.
    `loss`, a function that returns the derivatives of the loss, reduces the weights of outliers; None means least
    squares. `gauge` names the hinge point on the axis. If `poses_at`, a function of the clock offset and of the
    largest number of samples that returns RelativePoses, is given, estimate the offset too, from the first value
    `offset` [s]. Raise FitError if the samples show no circle. Unless `is_body1_exact`, the covariance includes the
    bias that would result if all of the noise were noise of the attitude of body 1.

    Args:
        poses: all samples, of which the places and the weights count.
        loss: of a sample; None counts squares.
        gauge: rule that selects the point on the axis to which the levers lead.
        poses_at: function of the clock offset that returns the poses; given where the offset is an unknown too.
        offset: clock offset that the steps begin with [s].
        is_body1_exact: whether the attitudes of body 1 have no noise.

    Raises:
        FitError: the places show no circle: fewer than four, or on a line.
    """
    poses_at = poses_at or (lambda _, max_samples: poses.thinned(max_samples))
    some = poses_at(offset, MAX_THINNED_SAMPLES_FOR_FIRST_FIT_PASS)
    circle = _circle_of_random_triples(some.p.T)
    variance, has_converged = np.inf, False
    for most in (
        (MAX_THINNED_SAMPLES_FOR_FIRST_FIT_PASS, sys.maxsize)
        if poses.samples > MAX_THINNED_SAMPLES_FOR_FIRST_FIT_PASS
        else (sys.maxsize,)
    ):
        some = poses_at(offset, most)
        for _ in range(_MAX_GAUSS_NEWTON_STEPS_PER_CIRCLE_FIT_PASS):
            residuals, change = _residuals_and_derivatives(circle, some)
            variance, weights = _variance_and_weights(residuals, some.weights, loss)
            normal = np.einsum("n,nij,nik->jk", weights, change, change)
            gradient = np.einsum("n,nij,ni->j", weights, change, residuals)
            step = -solve_semidefinite(normal, gradient)
            relative_change = circle.relative_change(step)
            share = min(1.0, _MAX_RELATIVE_CIRCLE_CHANGE_PER_GAUSS_NEWTON_STEP / max(relative_change, 1e-300))
            circle = circle.moved(share * step)
            least = 1e-15
            if some.offset_derivatives is not None:
                delay = float(step[_NUM_CIRCLE_PARAMETERS])
                offset += share * delay
                some = poses_at(offset, most)
                least = (
                    _POSITION_ERROR_OF_TIME_SHIFTED_SAMPLE_TO_CIRCLE_RADIUS
                    if abs(delay) < _MAX_CONVERGED_CLOCK_OFFSET_STEP_IN_SECONDS
                    else 0.0
                )
            has_converged = bool(
                step @ normal @ step <= _MAX_CONVERGED_CIRCLE_STEP_NORM_IN_PARAMETER_STDS**2 * variance
                or relative_change < least
            )
            if has_converged:
                break
    circle = circle.moved(-_bias(circle, some, variance, 0.0))  # noise makes circles too large
    circle = circle._replace(n=sign_of(circle.n) * circle.n)
    residuals, change = _residuals_and_derivatives(circle, some)
    _, weights = _variance_and_weights(residuals, some.weights, loss)
    squares = some.weights * (residuals * residuals).sum(axis=1)
    outliers = squares > MIN_OUTLIER_WHITENED_SQUARED_RESIDUAL * max(
        float(np.median(squares)) / CHI2_MEDIAN_BY_DOF[2], 1e-300
    )
    explained = (
        1e-12 * np.abs(some.p).max()
        if some.offset_derivatives is None
        else _POSITION_ERROR_OF_TIME_SHIFTED_SAMPLE_TO_CIRCLE_RADIUS * circle.radius
    )
    outliers &= np.sqrt(squares) > explained
    normal = np.einsum("n,nij,nik->jk", weights, change, change)
    free = 2 * some.samples / max(2 * some.samples - normal.shape[0], 1)
    scores = np.einsum("n,nij,ni->jn", weights, change, residuals)
    slope = normal + _bending(residuals, change, some.weights, variance, loss)
    inverse = solve_semidefinite(slope, np.eye(normal.shape[0]))
    circle_covariance = free * inverse @ score_scatter(scores)[0] @ inverse.T
    columns = [
        (_result_vector(circle.moved(x), gauge) - _result_vector(circle.moved(-x), gauge))
        / (2 * _DIFFERENCE_STEP_OF_CIRCLE_PARAMETERS_IN_RADIANS_OR_METRES)
        for x in _DIFFERENCE_STEP_OF_CIRCLE_PARAMETERS_IN_RADIANS_OR_METRES * np.eye(_NUM_CIRCLE_PARAMETERS)
    ]
    derivatives = np.stack(columns, axis=-1)
    random = derivatives @ circle_covariance[:_NUM_CIRCLE_PARAMETERS, :_NUM_CIRCLE_PARAMETERS] @ derivatives.T
    spread = np.zeros(12) if is_body1_exact else derivatives @ _bias_by_attitudes(circle, some, variance)
    covariance = random + np.outer(spread, spread)
    neighbour_correlations = (residuals[1:] * residuals[:-1]).sum(axis=0) / np.maximum(
        (residuals * residuals).sum(axis=0), 1e-300
    )
    findings = _circle_findings(
        circle, residuals, neighbour_correlations, weights, outliers, covariance, has_converged, gauge
    )
    good = some.p.T[(weights > 0) & ~outliers]
    if neighbour_correlations.max() <= MAX_NEIGHBOUR_CORRELATION_OF_RANDOM_RESIDUALS:
        findings = _arc_findings(good, np.sqrt(circle_covariance[5, 5]) / circle.radius) or findings
    findings += split_findings(random, covariance, "of body 1 adds to that of the places")
    return CircleFit(
        circle=circle,
        noise=float(np.sqrt(variance * free)),
        residuals=residuals,
        weights=weights,
        outliers=outliers.astype(np.float64),
        covariance=covariance,
        findings=tuple(findings),
        poses=some,
        has_converged=has_converged,
        offset=offset,
        offset_std=0.0 if some.offset_derivatives is None else float(np.sqrt(circle_covariance[-1, -1])),
        normal=normal,
    )


def circle_misfit(poses: RelativePoses) -> float:
    """Return how badly a circle fits the positions of a point in the relative poses, a float: the logarithm of the
    median squared distance [m^2] from a circle found in a few steps. Raise FitError for fewer than four samples or
    samples on a line.
    """
    circle = _circle_of_random_triples(poses.p.T, num_triples=60)
    for _ in range(6):
        distances, derivatives = _residuals_and_derivatives(circle, poses._replace(offset_derivatives=None))
        median_distance = np.sqrt(np.median((distances * distances).sum(axis=1))) + 1e-300
        weights = 1 / (
            1
            + (distances * distances).sum(axis=1)
            / (_LOSS_SCALE_OF_SQUARED_CIRCLE_DISTANCE_IN_NOISE_VARIANCES * median_distance * median_distance)
        )
        normal = np.einsum("n,nij,nik->jk", weights, derivatives, derivatives)
        step = -solve_semidefinite(normal, np.einsum("n,nij,ni->j", weights, derivatives, distances))
        share = min(
            1.0, _MAX_RELATIVE_CIRCLE_CHANGE_PER_GAUSS_NEWTON_STEP / max(circle.relative_change(step), 1e-300)
        )
        circle = circle.moved(share * step)
    distances, _ = _residuals_and_derivatives(circle, poses)
    return float(np.log(np.median((distances * distances).sum(axis=1)) + 1e-30 * poses.size**2))


def _bias(circle: Circle, poses: RelativePoses, place: float, attitude: float) -> Float64Array:
    """Return the bias of the six parameters of a circle by noise of the variances `place` [m^2], of positions, and
    `attitude` [rad^2], of the attitudes of body 1: the mean step that exact samples make, each coordinate of noise
    once up and once down.
    """
    thin = poses.thinned(MAX_THINNED_SAMPLES_FOR_CANDIDATE_RANKING)
    relative = np.sqrt(1 / thin.weights)[:, None]
    psi = circle.angles(thin.p.T)[:, None]
    x, y = circle.zero_direction, np.cross(circle.n, circle.zero_direction)
    p = circle.centre + circle.radius * (np.cos(psi) * x + np.sin(psi) * y)
    noisy = []
    for axis in np.concatenate((np.eye(3), -np.eye(3))):
        if place > 0:
            noisy.append(p + np.sqrt(place) * relative * axis)
        if attitude > 0:
            turn = np.asarray(rotation_exp(np.sqrt(attitude) * relative * axis))
            noisy.append(np.einsum("nij,nj->ni", turn, p))
    if not noisy:
        return np.zeros(_NUM_CIRCLE_PARAMETERS)
    around = RelativePoses(thin.Q, np.concatenate(noisy).T, thin.size)
    residuals, change = _residuals_and_derivatives(circle, around)
    weights = np.tile(thin.weights, len(noisy))
    normal = np.einsum("n,nij,nik->jk", weights, change, change) / len(noisy)
    return -solve_semidefinite(normal, np.einsum("n,nij,ni->j", weights, change, residuals) / 2)


def _bias_by_attitudes(circle: Circle, poses: RelativePoses, variance: float) -> Float64Array:
    """Return the bias of the six parameters of a circle if noise of the attitudes of body 1 alone made the variance
    of the residuals. Each turn of body 1 moves the point across the vector to it.
    """
    _, change = _residuals_and_derivatives(circle, poses)
    directions = change[:, :, 2:5] @ frame(circle.n).T
    along = np.einsum("nij,jn->ni", directions, poses.p)
    turned = (poses.p**2).sum(axis=0)[:, None] - along**2
    return _bias(circle, poses, 0.0, variance / max(float(turned.mean()), 1e-300))


def _variance_and_weights(
    residuals: Float64Array, sample_weights: Float64Array, loss: Loss | None
) -> tuple[float, Float64Array]:
    """Return the variance of a coordinate [m^2], estimated from the residuals (N, 2), and the weights of the samples
    (N,). If `loss` is None, the variance is a mean and the weights are `sample_weights`. Otherwise the variance comes
    from a median, and `loss`, a function, reduces the weights of outliers.
    """
    squares = (residuals * residuals).sum(axis=1)
    if loss is None:
        return float(sample_weights @ squares) / (2 * float(sample_weights.sum())), sample_weights
    variance = float(np.median(sample_weights * squares)) / CHI2_MEDIAN_BY_DOF[2]
    sizes = sample_weights * squares / max(variance, 1e-300)
    return variance, np.where(
        sizes > _MIN_SQUARED_CIRCLE_DISTANCE_OF_ZERO_WEIGHT_IN_NOISE_VARIANCES,
        0.0,
        sample_weights * loss(sizes / _LOSS_SCALE_OF_SQUARED_CIRCLE_DISTANCE_IN_NOISE_VARIANCES)[0],
    )


def _bending(
    residuals: Float64Array, change: Float64Array, sample_weights: Float64Array, variance: float, loss: Loss | None
) -> Float64Array | float:
    """Return what the second derivative of the loss adds to the derivative of the scores; (k, k), or 0 without a
    loss. The arguments are those of `_variance_and_weights`, and the derivatives of the residuals (N, 2, k).
    """
    if loss is None:
        return 0.0
    scale = _LOSS_SCALE_OF_SQUARED_CIRCLE_DISTANCE_IN_NOISE_VARIANCES * max(variance, 1e-300)
    sizes = sample_weights * (residuals * residuals).sum(axis=1) / scale
    scores = np.einsum("nij,ni->jn", change, residuals)
    return np.asarray((2 / scale * sample_weights**2 * loss(sizes)[1] * scores) @ scores.T)


def _result_vector(circle: Circle, gauge: str) -> Float64Array:
    """Return u1, u2, n and zeros for the rotation vector of home, joined to one vector (12,). `gauge` names the rule
    for the hinge point along the axis.
    """
    return np.concatenate((*circle.levers(gauge), circle.n, np.zeros(3)))


def _residuals_and_derivatives(circle: Circle, poses: RelativePoses) -> tuple[Float64Array, Float64Array]:
    """Return the distances of the samples from the plane of the circle and, in that plane, from the circle (N, 2),
    and the derivatives of both distances with respect to the six parameters of the circle (N, 2, 6). If the poses
    have `offset_derivatives`, the derivatives with respect to the clock offset come last (N, 2, 7).
    """
    axes = frame(circle.n)
    x, y, z = ((poses.p.T - circle.centre) @ axes).T
    size = np.maximum(np.hypot(x, y), 1e-300)
    change = np.zeros((x.size, 2, _NUM_CIRCLE_PARAMETERS + (poses.offset_derivatives is not None)))
    # n turns towards x: n' = n + s x, so that z grows by s x and x falls by s z
    change[:, 0, 0], change[:, 0, 1], change[:, 0, 4] = x, y, -1.0
    change[:, 1, 0], change[:, 1, 1] = -z * x / size, -z * y / size
    change[:, 1, 2], change[:, 1, 3], change[:, 1, 5] = -x / size, -y / size, -1.0
    if poses.offset_derivatives is not None:
        along_x, along_y, along_z = axes.T @ poses.offset_derivatives[9:]
        change[:, 0, _NUM_CIRCLE_PARAMETERS] = along_z
        change[:, 1, _NUM_CIRCLE_PARAMETERS] = (x * along_x + y * along_y) / size
    return np.stack((z, size - circle.radius), axis=-1), change


def _circle_of_random_triples(p: Float64Array, num_triples: int = 300) -> Circle:
    """Return the circle with the smallest median distance from the samples p (N, 3), among the circles through
    `num_triples` random triples of samples (fixed seed). The median is taken over samples thinned evenly. Raise
    FitError for fewer than four samples, or if all triples are on lines.
    """
    if p.shape[0] < 4:
        raise FitError("body2", "at least four samples of a point", f"{p.shape[0]}")
    rng = np.random.default_rng(0)
    a, b, c = p[rng.integers(p.shape[0], size=(3, num_triples))]
    ab, ac = b - a, c - a
    normal = np.cross(ab, ac)
    area = np.linalg.norm(normal, axis=1)
    sides = np.linalg.norm(ab, axis=1) * np.linalg.norm(ac, axis=1)
    shown = area > 1e-6 * np.maximum(sides, 1e-300)
    if not (shown & (sides > 0)).any():
        raise FitError("body2", "a point that moves along an arc about an axis", "places on a line, or one place")
    a, ab, ac, normal, area = a[shown], ab[shown], ac[shown], normal[shown], area[shown]
    bb, cc = (np.einsum("ni,ni->n", v, v)[:, None] for v in (ab, ac))
    centres = a + np.cross(normal, bb * ac - cc * ab) / (-2 * area**2)[:, None]
    axes, radii = normal / area[:, None], np.linalg.norm(a - centres, axis=1)
    judges = p[:: -(-p.shape[0] // MAX_THINNED_SAMPLES_FOR_CANDIDATE_RANKING)]
    off = judges[None] - centres[:, None]
    out = np.einsum("kni,ki->kn", off, axes)
    across = np.sqrt(np.maximum((off * off).sum(axis=-1) - out**2, 0.0)) - radii[:, None]
    best = int(np.argmin(np.median(out**2 + across**2, axis=1)))
    return Circle(axes[best], centres[best], float(radii[best]))


def _arc_findings(p: Float64Array, relative_radius_std: float) -> list[Finding]:
    """Return a list with one Finding if the places p (N, 3) show hardly an arc; `relative_radius_std` is the standard
    deviation of its radius, in parts of the radius.
    """
    widths = np.linalg.svd(p - p.mean(axis=0), compute_uv=False) / np.sqrt(p.shape[0])
    if widths[1] >= _MAX_STRAIGHT_PATH_WIDTH_TO_OUT_OF_PLANE_EXTENT * widths[2]:
        return []
    what = "straight within" if relative_radius_std > 1 / 3 else "hardly an arc beside"
    return [
        Finding(f"The path of the point is {what} its noise, {widths[2]:.2g} m: let the point turn further.", False)
    ]


def _circle_findings(
    circle: Circle,
    residuals: Float64Array,
    neighbour_correlations: Float64Array,
    weights: Float64Array,
    is_outlier: NDArray[np.bool_],
    covariance: Float64Array,
    has_converged: bool,
    gauge: str,
) -> list[Finding]:
    """Return a list of Finding objects on a fitted circle: outliers, systematic residuals, a large standard deviation
    of the axis or of the hinge point, and steps that did not converge. `neighbour_correlations` are the correlations
    of residuals of neighbouring samples, out of the plane and in it. `is_outlier` (N,) marks the outliers, and
    `covariance` (12, 12) is the covariance of the hinge in the given gauge. Findings that make the hinge unreliable
    come first.
    """
    findings = []
    if is_outlier.any():
        share = f"{percent(is_outlier.mean())} of the samples are outliers"
        little = float(weights[is_outlier].sum()) < 0.5 * is_outlier.sum() * weights.mean()
        alike = ', and count like the others: loss="cauchy" makes them count little.'
        findings.append(Finding(share + ("; they count little." if little else alike), little))
    sizes = np.sqrt(weights @ (residuals * residuals) / weights.sum())
    for size, correlation, no_circle, play in zip(
        sizes,
        neighbour_correlations,
        (
            "The point leaves the plane of the circle by {:.2g} m rms, and not at random: it slides along the axis, "
            "or the axis tilts.",
            "The point is off the circle by {:.2g} m rms, and not at random: its distance from the axis changes.",
        ),
        (
            "The point moves along the axis by {:.2g} m rms",
            "The point's distance from the axis changes by {:.2g} m rms",
        ),
        strict=True,
    ):
        if (
            correlation <= MAX_NEIGHBOUR_CORRELATION_OF_RANDOM_RESIDUALS
            or size <= max(1e-9, 0.25 * _MAX_HARMLESS_SYSTEMATIC_RESIDUAL_TO_CIRCLE_RADIUS) * circle.radius
        ):
            continue
        if size >= _MAX_HARMLESS_SYSTEMATIC_RESIDUAL_TO_CIRCLE_RADIUS * circle.radius:
            findings.append(Finding(no_circle.format(size), False))
        else:
            share = f"{percent(size / circle.radius)} of the radius, and not at random"
            findings.append(Finding(f"{play.format(size)}, {share}: the hinge is that of the mean circle.", True))
    std = np.sqrt(np.diagonal(covariance))
    worst, vague = float(np.sqrt((std[6:9] ** 2).sum() / 2)), float(std[:6].max())
    if worst > MAX_RELIABLE_HINGE_AXIS_STD_IN_RADIANS:
        text = f"The axis is known to {np.degrees(worst):.2g} deg only: let the point turn further."
        findings.append(Finding(text, False))
    levers = circle.levers(gauge)
    reach = max(float(np.linalg.norm(lever)) for lever in levers)
    if vague > MAX_RELIABLE_HINGE_POINT_STD_TO_LEVER_LENGTH * reach:
        findings.append(
            Finding(f"The hinge point is known to {vague:.2g} m only: let the point turn further.", False)
        )
    if not has_converged:
        findings.append(Finding("The steps of the fit did not come to rest.", False))
    return sorted(findings, key=lambda finding: finding.harmless)  # what decides the verdict comes first
