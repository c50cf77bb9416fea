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
    MAX_PLAY,
    RANDOM_CORRELATION,
    RELIABLE_AXIS,
    RELIABLE_POINT,
    Finding,
    exceeded,
    outlier_finding,
    split_findings,
)
from hingepair.measured.hinge import first_axis_across, frame, sign_of, tilt_axis
from hingepair.measured.least_squares import (
    Equations,
    least_squares,
    neighbour_correlation,
    sandwich,
    solve_semidefinite,
)
from hingepair.measured.likelihood import FIRST_PASS, MAX_OFFSET_STD, MIN_OFFSET_GAIN, PosesAt
from hingepair.measured.relative_poses import FEW_SAMPLES, RelativePoses
from hingepair.measured.robust import OUTLIER, Loss, cauchy, loss_weights, median_variance
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import rotation_exp
from hingepair.tables.sheets import percent

_PARAMETERS = 6  # numbers of a step of `Circle.moved`; the clock offset follows them where it is sought
_SHIFT_ERROR = 1e-6  # largest residual that moving exact samples in time explains, in parts of the radius


class Circle(NamedTuple):
    """A circle in the axes of body 1, on which a point of body 2 moves."""

    n: Float64Array  # axis, unit; (3,)
    centre: Float64Array  # [m]; (3,)
    radius: float  # [m]

    def moved(self, step: Float64Array) -> Circle:
        """Return the circle after a step of six numbers: tilts of n [rad] towards the first two columns of
        `frame(n)`, shifts of the centre [m] along all three, and the growth of the radius [m].
        """
        centre = self.centre + frame(self.n) @ step[2:5]
        return Circle(tilt_axis(self.n, step[:2]), centre, self.radius + float(step[5]))

    def relative_size(self, step: Float64Array) -> float:
        """Return the largest magnitude of the six numbers of a step, its lengths in parts of the diameter."""
        return max(float(np.abs(step[:2]).max()), float(np.abs(step[2:6]).max()) / (2 * self.radius))

    def shortened(self, step: Float64Array) -> Float64Array:
        """Return a step, scaled as a whole so that it changes the circle by 0.3 rad, or diameters, at most."""
        return step * min(1.0, 0.3 / max(self.relative_size(step), 1e-300))

    @property
    def zero_direction(self) -> Float64Array:
        """Unit vector, in axes of body 1, from the centre to the point of the circle where psi = 0; (3,)."""
        across = np.eye(3)[first_axis_across(self.n)]
        start = across - (across @ self.n) * self.n
        return np.asarray(start / np.linalg.norm(start))

    def levers(self, gauge: str) -> tuple[Float64Array, Float64Array]:
        """Return u1 and u2 (3,), in axes of body 1 at psi = 0, with the hinge point that `gauge` names."""
        u1 = self.centre - (self.centre @ self.n) * self.n if gauge == "closest_to_R1" else self.centre
        return u1, u1 - self.centre - self.radius * self.zero_direction

    def results(self, gauge: str) -> Float64Array:
        """Return u1, u2, n and zeros for the rotation vector of home; (12,)."""
        return np.concatenate((*self.levers(gauge), self.n, np.zeros(3)))

    def result_derivatives(self, gauge: str) -> Float64Array:
        """Return the derivatives of `results` by the six numbers of a step, by central differences; (12, 6)."""
        h = 1e-6  # rad, m
        ends = [(self.moved(x).results(gauge), self.moved(-x).results(gauge)) for x in h * np.eye(_PARAMETERS)]
        return np.stack([(high - low) / (2 * h) for high, low in ends], axis=-1)

    def angles(self, p: Float64Array) -> Float64Array:
        """Return the hinge angles psi (N,) in [-pi, pi] [rad] at which the moving point is at positions p (N, 3)."""
        off = p - self.centre
        return np.asarray(np.arctan2(off @ np.cross(self.n, self.zero_direction), off @ self.zero_direction))

    def angle_derivatives(self, poses: RelativePoses) -> Float64Array:
        """Return the derivatives of the hinge angles by the six numbers of a step, by central differences, and by the
        clock offset where the poses have derivatives by it; (6 or 7, N).
        """
        h, p = 1e-6, poses.p.T  # rad, m
        ends = [(self.moved(x).angles(p), self.moved(-x).angles(p)) for x in h * np.eye(_PARAMETERS)]
        rows = [np.angle(np.exp(1j * (high - low))) / (2 * h) for high, low in ends]
        if poses.offset_derivatives is not None:
            off = p - self.centre
            out = np.cross(self.n, off)
            rows.append((poses.offset_derivatives[9:].T * out).sum(axis=1) / np.maximum((out**2).sum(axis=1), 1e-300))
        return np.stack(rows)


class CircleFit(NamedTuple):
    """The most likely circle of a moving point."""

    circle: Circle
    noise: float  # standard deviation of a coordinate [m]
    residuals: Float64Array  # out of the plane and across the circle [m]; (N, 2)
    weights: Float64Array  # of the poses, times those of the loss; (N,)
    is_outlier: NDArray[np.bool_]  # (N,)
    covariance: Float64Array  # of u1, u2, n and home; (12, 12)
    findings: tuple[Finding, ...]
    poses: RelativePoses  # at the clock offset
    has_converged: bool  # whether the steps came to rest
    offset: float  # clock offset [s]
    offset_std: float  # its standard deviation, 0 where it was not estimated [s]
    normal: Float64Array  # matrix of the normal equations, in squares of metres; (6, 6), or (7, 7) with the offset
    psi_std: Float64Array  # standard deviations of the hinge angles [rad]; (N,)

    def shows_offset(self, noise_poses: RelativePoses) -> bool:
        """Return whether the motion determines the clock offset, far better than derivatives by the offset that are
        noise alone, those of `noise_poses`, would.
        """
        k = _PARAMETERS
        across = np.linalg.lstsq(self.normal[:k, :k], self.normal[:k, k])[0]
        shown = self.normal[k, k] - self.normal[k, :k] @ across
        _, change = _residuals_and_derivatives(self.circle, noise_poses)
        noise = float(self.weights @ (change[:, :, k] ** 2).sum(axis=1))
        is_certain = shown * MAX_OFFSET_STD**2 > self.noise**2
        return self.has_converged and bool(shown > MIN_OFFSET_GAIN * noise and is_certain)


class _State(NamedTuple):
    """The unknowns of `fit_circle`, and the poses at the clock offset."""

    circle: Circle
    offset: float
    poses: RelativePoses


def fit_circle(
    poses: RelativePoses,
    loss: Loss | None,
    gauge: str,
    poses_at: PosesAt | None = None,
    offset: float = 0.0,
    *,
    is_body1_exact: bool = False,
    n_along: Float64Array | None = None,
) -> CircleFit:
    """Return the most likely circle of a point of body 2.

    Args:
        poses: all samples, of which the places and the weights count.
        loss: of a sample; None counts squares.
        gauge: rule that selects the point on the axis to which the levers lead.
        poses_at: returns the poses at a clock offset; given where the offset is an unknown too.
        offset: clock offset that the steps begin with [s].
        is_body1_exact: whether the attitudes of body 1 have no noise. Otherwise the covariance includes the bias that
            would result if all of the noise were theirs.
        n_along: direction that decides the sign of n.

    Raises:
        FitError: the places show no circle: fewer than four, or on a line.
    """
    find = poses_at or (lambda _, most: poses.thinned(most))

    def equations(state: _State) -> Equations:
        # Of residuals in standard deviations, by the parameters.
        residuals, change = _residuals_and_derivatives(state.circle, state.poses)
        variance, weights, _ = _variance_and_weights(residuals, state.poses.weights, loss)
        weights = weights / max(variance, 1e-300)
        normal = np.einsum("n,nij,nik->jk", weights, change, change)
        return Equations(normal, np.einsum("n,nij,ni->j", weights, change, residuals))

    def move(state: _State, step: Float64Array) -> tuple[_State, Float64Array]:
        # With the poses at the new clock offset; a step may be shortened.
        step = state.circle.shortened(step)
        some, later = state.poses, state.offset
        if some.offset_derivatives is not None:
            later += float(step[_PARAMETERS])
            some = find(later, most)
        return _State(state.circle.moved(step), later, some), step

    def at_rest(step: Float64Array, before: Equations, state: _State) -> bool:
        # In standard deviations of the parameters, or rounding.
        if step @ before.normal @ step <= 1e-6:
            return True
        if state.poses.offset_derivatives is None:
            return state.circle.relative_size(step) < 1e-15
        return abs(float(step[_PARAMETERS])) < 1e-6 and state.circle.relative_size(step) < _SHIFT_ERROR  # s

    # With some samples first, then with all.
    most, come_to_rest = FIRST_PASS, False
    some = find(offset, most)
    state = _State(_circle_of_random_triples(some.p.T), offset, some)
    for most in (FIRST_PASS, sys.maxsize) if poses.samples > FIRST_PASS else (sys.maxsize,):
        state = state._replace(poses=find(state.offset, most))
        state, come_to_rest = least_squares(state, equations, move, at_rest, 60)
    circle, offset, some = state

    # Noise makes circles too large.
    residuals, _ = _residuals_and_derivatives(circle, some)
    variance, *_ = _variance_and_weights(residuals, some.weights, loss)
    circle = circle.moved(-_bias(circle, some, variance, 0.0))
    circle = circle._replace(n=sign_of(circle.n, n_along) * circle.n)

    # Outliers, beyond what rounding explains.
    residuals, change = _residuals_and_derivatives(circle, some)
    _, weights, bend = _variance_and_weights(residuals, some.weights, loss)
    squares = some.weights * (residuals * residuals).sum(axis=1)
    explained = 1e-12 * np.abs(some.p).max() if some.offset_derivatives is None else _SHIFT_ERROR * circle.radius
    is_outlier = (squares > OUTLIER * max(median_variance(squares, 2), 1e-300)) & (np.sqrt(squares) > explained)

    # Covariance, and what the attitudes of body 1 may add to it.
    normal = np.einsum("n,nij,nik->jk", weights, change, change)
    scores = np.einsum("nij,ni->jn", change, residuals)
    inverse = solve_semidefinite(normal + (2 * bend * scores) @ scores.T, np.eye(normal.shape[0]))
    circle_covariance, _ = sandwich(inverse, weights * scores, 2)
    derivatives = circle.result_derivatives(gauge)
    random = derivatives @ circle_covariance[:_PARAMETERS, :_PARAMETERS] @ derivatives.T
    shift = np.zeros(_PARAMETERS) if is_body1_exact else _bias_by_attitudes(circle, some, variance)
    spread = derivatives @ shift
    covariance = random + np.outer(spread, spread)
    free = 2 * some.samples / max(2 * some.samples - normal.shape[0], 1)

    findings = outlier_finding(is_outlier, weights)
    findings += _circle_findings(circle, residuals, weights, covariance, gauge)
    findings += [] if come_to_rest else [Finding("steps", 1, 0, "The steps of the fit did not come to rest.")]
    findings.sort(key=lambda finding: finding.is_note)
    if max(neighbour_correlation(part) for part in residuals.T) <= RANDOM_CORRELATION:
        good = some.p.T[(weights > 0) & ~is_outlier]
        findings = _arc_findings(good, float(np.sqrt(circle_covariance[5, 5])) / circle.radius) or findings
    findings += split_findings(random, covariance, "of body 1 adds to that of the places")
    return CircleFit(
        circle=circle,
        noise=float(np.sqrt(variance * free)),
        residuals=residuals,
        weights=weights,
        is_outlier=is_outlier,
        covariance=covariance,
        findings=tuple(findings),
        poses=some,
        has_converged=come_to_rest,
        offset=offset,
        offset_std=0.0 if some.offset_derivatives is None else float(np.sqrt(circle_covariance[-1, -1])),
        normal=normal,
        psi_std=_angle_std(circle, some, variance * free, circle_covariance, shift),
    )


def _angle_std(
    circle: Circle, poses: RelativePoses, variance: float, covariance: Float64Array, shift: Float64Array
) -> Float64Array:
    """Return the standard deviations of the hinge angles [rad] (N,), from noise of `variance` [m^2] along the circle
    and from the circle, whose six parameters have `covariance` and a possible bias `shift`.
    """
    change = circle.angle_derivatives(poses)
    of_circle = (change * (covariance @ change)).sum(axis=0) + (shift @ change[:_PARAMETERS]) ** 2
    along = np.full(poses.samples, variance)  # [m^2]
    if shift.any():  # if that was noise of the attitudes of body 1, it may be larger along the circle
        p = poses.p.T
        tangent = np.cross(circle.n, p - circle.centre) / circle.radius
        turned = (p**2).sum(axis=1) - (p * tangent).sum(axis=1) ** 2
        along = np.maximum(along, _attitude_noise(circle, poses, variance) * turned)
    return np.asarray(np.sqrt(along / (poses.weights * circle.radius**2) + np.maximum(of_circle, 0.0)))


def circle_misfit(poses: RelativePoses) -> float:
    """Return how badly a circle fits: the logarithm of the median squared distance [m^2] from a circle found in a few
    steps.
    """
    fixed = poses._replace(offset_derivatives=None)

    def equations(circle: Circle) -> Equations:
        """Return the normal equations of distances with Cauchy weights."""
        residuals, change = _residuals_and_derivatives(circle, fixed)
        squares = (residuals * residuals).sum(axis=1)
        weights, _ = loss_weights(cauchy, squares / max(float(np.median(squares)), 1e-300), 2, np.inf)
        normal = np.einsum("n,nij,nik->jk", weights, change, change)
        return Equations(normal, np.einsum("n,nij,ni->j", weights, change, residuals))

    def move(circle: Circle, step: Float64Array) -> tuple[Circle, Float64Array]:
        step = circle.shortened(step)
        return circle.moved(step), step

    start = _circle_of_random_triples(poses.p.T, num_triples=60)
    circle, _ = least_squares(start, equations, move, lambda *_: False, 6)
    residuals, _ = _residuals_and_derivatives(circle, fixed)
    return float(np.log(np.median((residuals * residuals).sum(axis=1)) + 1e-30 * poses.size**2))


def _bias(circle: Circle, poses: RelativePoses, place: float, attitude: float) -> Float64Array:
    """Return the bias (estimate less truth) of the six parameters by noise, of the variances `place` [m^2] of
    positions and `attitude` [rad^2] of body 1: a step from exact samples, each coordinate off once up and once down.
    """
    thin = poses.thinned(FEW_SAMPLES)
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
        return np.zeros(_PARAMETERS)
    around = RelativePoses(thin.Q, np.concatenate(noisy).T, thin.size)
    residuals, change = _residuals_and_derivatives(circle, around)
    weights = np.tile(thin.weights, len(noisy))
    normal = np.einsum("n,nij,nik->jk", weights, change, change) / len(noisy)
    return -solve_semidefinite(normal, np.einsum("n,nij,ni->j", weights, change, residuals) / 2)


def _bias_by_attitudes(circle: Circle, poses: RelativePoses, variance: float) -> Float64Array:
    """Return the bias of the six parameters by noise of body 1's attitudes that gives residuals a variance [m^2]."""
    return _bias(circle, poses, 0.0, _attitude_noise(circle, poses, variance))


def _attitude_noise(circle: Circle, poses: RelativePoses, variance: float) -> float:
    """Return the variance of noise of the attitudes of body 1 [rad^2] that makes residuals of a variance [m^2]."""
    _, change = _residuals_and_derivatives(circle, poses)
    # Each turn of body 1 moves the point across the vector to it.
    directions = change[:, :, 2:5] @ frame(circle.n).T
    along = np.einsum("nij,jn->ni", directions, poses.p)
    turned = (poses.p**2).sum(axis=0)[:, None] - along**2
    return variance / max(float(turned.mean()), 1e-300)


def _variance_and_weights(
    residuals: Float64Array, given: Float64Array, loss: Loss | None
) -> tuple[float, Float64Array, Float64Array]:
    """Return the variance of a coordinate [m^2], the weights of the samples, `given` times those of the loss, and
    the derivatives of the weights by the squared residuals (N,).
    """
    squares = given * (residuals * residuals).sum(axis=1)
    if loss is None:
        return float(squares.sum() / (2 * given.sum())), given, np.zeros_like(given)
    variance = median_variance(squares, 2)
    weights, bend = loss_weights(loss, squares / max(variance, 1e-300), 2)
    return variance, given * weights, given**2 * bend / max(variance, 1e-300)


def _residuals_and_derivatives(circle: Circle, poses: RelativePoses) -> tuple[Float64Array, Float64Array]:
    """Return the distances from the plane of the circle, positive along n, and in it from the circle, positive
    outside (N, 2), and their derivatives by the six parameters and, if the poses have them, by the clock offset
    (N, 2, 6 or 7).
    """
    axes = frame(circle.n)
    x, y, z = ((poses.p.T - circle.centre) @ axes).T
    size = np.maximum(np.hypot(x, y), 1e-300)
    change = np.zeros((x.size, 2, _PARAMETERS + (poses.offset_derivatives is not None)))
    # n turns towards x: n' = n + s x, so that z grows by s x and x falls by s z
    change[:, 0, 0], change[:, 0, 1], change[:, 0, 4] = x, y, -1.0
    change[:, 1, 0], change[:, 1, 1] = -z * x / size, -z * y / size
    change[:, 1, 2], change[:, 1, 3], change[:, 1, 5] = -x / size, -y / size, -1.0
    if poses.offset_derivatives is not None:
        along_x, along_y, along_z = axes.T @ poses.offset_derivatives[9:]
        change[:, 0, _PARAMETERS] = along_z
        change[:, 1, _PARAMETERS] = (x * along_x + y * along_y) / size
    return np.stack((z, size - circle.radius), axis=-1), change


def _circle_of_random_triples(p: Float64Array, num_triples: int = 300) -> Circle:
    """Return the circle with the smallest median distance from the samples p (N, 3), among the circles through random
    triples of samples (fixed seed); refuse samples that show none.
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
    judges = p[:: -(-p.shape[0] // FEW_SAMPLES)]
    off = judges[None] - centres[:, None]
    out = np.einsum("kni,ki->kn", off, axes)
    across = np.sqrt(np.maximum((off * off).sum(axis=-1) - out**2, 0.0)) - radii[:, None]
    best = int(np.argmin(np.median(out**2 + across**2, axis=1)))
    return Circle(axes[best], centres[best], float(radii[best]))


def _arc_findings(p: Float64Array, relative_radius_std: float) -> list[Finding]:
    """Return a finding if the places p (N, 3) show hardly an arc; the standard deviation of its radius, in parts of
    the radius, selects the words.
    """
    widths = np.linalg.svd(p - p.mean(axis=0), compute_uv=False) / np.sqrt(p.shape[0])
    what = "straight within" if relative_radius_std > 1 / 3 else "hardly an arc beside"
    text = f"The path of the point is {what} its noise, {widths[2]:.2g} m: let the point turn further."
    return [Finding("arc", widths[2], widths[1] / 3, text)] if widths[1] < 3.0 * widths[2] else []


def _circle_findings(
    circle: Circle, residuals: Float64Array, weights: Float64Array, covariance: Float64Array, gauge: str
) -> list[Finding]:
    """Return findings on residuals that are not at random, and on large standard deviations."""
    findings = []
    sizes = np.sqrt(weights @ (residuals * residuals) / weights.sum()) / circle.radius
    words = (
        (
            "leaves the plane of the circle",
            "it slides along the axis, or the axis tilts",
            "The point moves along the axis",
        ),
        ("is off the circle", "its distance from the axis changes", "The point's distance from the axis changes"),
    )
    for column, size, (off, why, play) in zip(residuals.T, sizes, words, strict=True):
        if neighbour_correlation(column) <= RANDOM_CORRELATION or size <= 0.25 * MAX_PLAY:
            continue
        rms = f"by {size * circle.radius:.2g} m rms"
        if size >= MAX_PLAY:
            findings.append(Finding("play", size, MAX_PLAY, f"The point {off} {rms}, and not at random: {why}."))
        else:
            share = f"{percent(size)} of the radius, and not at random"
            text = f"{play} {rms}, {share}: the hinge is that of the mean circle."
            findings.append(Finding("play", size, 0.25 * MAX_PLAY, text, harmless=True))
    std = np.sqrt(np.diagonal(covariance))
    axis_std, point_std = float(np.sqrt((std[6:9] ** 2).sum() / 2)), float(std[:6].max())
    reach = max(float(np.linalg.norm(lever)) for lever in circle.levers(gauge))
    return findings + exceeded(
        Finding(
            "axis",
            axis_std,
            RELIABLE_AXIS,
            f"The axis is known to {np.degrees(axis_std):.2g} deg only: let the point turn further.",
        ),
        Finding(
            "point",
            point_std,
            RELIABLE_POINT * reach,
            f"The hinge point is known to {point_std:.2g} m only: let the point turn further.",
        ),
    )
