"""The hinge of a body and a point: seen from body 1, a point of body 2 runs along a circle about the axis.

Off the circle it is by noise alike in all directions, so that the most likely circle makes the sum of squared
distances least, out of the plane and across it. Attitudes of body 2 are not seen: `home` is the identity. An offset
between the clocks of the bodies takes the point off the circle where body 1 moves; it is one more parameter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import FitError
from hingepair.measured.findings import Finding
from hingepair.measured.hinge import frame, sign_of, tilt_axis
from hingepair.measured.likelihood import (
    MAX_OFFSET_STD,
    MIN_OFFSET_SIGNAL,
    Loss,
    PosesAt,
    solved,
    summed_neighbours,
)
from hingepair.measured.relative_poses import RelativePoses
from hingepair.numeric.arrays import Float64Array

_TRIPLES, _ROUGH_TRIPLES = 300, 60  # of samples, each of which gives a circle; where clock offsets are compared
_MAX_RANKING_SAMPLES = 300  # samples that tell which of these circles is best
_CIRCLE_PARAMETERS = 6
"""Those of `Circle.moved`, which come first; then the clock offset, where it is sought."""
_MAX_FIRST_SAMPLES = 16384  # samples that the first steps are taken with
# Limit on the number of samples that no recording reaches.
_ALL_SAMPLES = 2**62
_MAX_CIRCLE_STEPS, _ROUGH_STEPS = 60, 6  # of a fit; of one that compares clock offsets
_MAX_CIRCLE_TURN = 0.3  # of the axis in one step [rad]; of lengths, in parts of the diameter
_MAX_CIRCLE_LAST_STEP = 1e-3  # in standard deviations
_MAX_ACROSS_COMPONENT = 0.65
"""The first coordinate axis whose component of n is below this names the direction of psi = 0."""
_CIRCLE_LOSS_SCALE, _GROSS_SIZE = (
    5.99,
    900.0,
)  # of squares, in variances, at which losses bend and samples stop to count
# Squared residual, in parts of the squares' scale by their median, above which a sample is an outlier.
_OUTLIER_SIZE = 50.0
_MEDIAN = 1.3863  # of chi-squared with 2 degrees of freedom
_MIN_CURVE = 3.0  # width of the path across its chord, in parts of that out of its plane
_MAX_CORRELATION = 0.5  # of neighbours' residuals; above, they are no noise
_MAX_AXIS_STD = np.radians(2.0)  # [rad]
_MAX_POINT_STD = 0.1  # in parts of the levers' length
_MAX_SYSTEMATIC = 0.02  # of the radius: residuals that are no noise and can be put up with
_RESAMPLING_ERROR = 1e-6  # [s], [rad], parts of the radius: that of exact samples moved to other instants
_CIRCLE_DIFFERENCE = 1e-6  # step of the derivatives of the results


class Circle(NamedTuple):
    """A circle in body 1's axes."""

    n: Float64Array  # axis, unit; (3,)
    centre: Float64Array  # [m]; (3,)
    radius: float  # [m]

    def moved(self, step: Float64Array) -> Circle:
        """Return the circle after a step: turns of n across (2), the centre in axes of `frame` (3), the radius."""
        centre = self.centre + frame(self.n) @ step[2:5]
        return Circle(tilt_axis(self.n, step[:2]), centre, self.radius + float(step[5]))

    @property
    def start(self) -> Float64Array:
        """Return the direction from the centre in which psi = 0, unit; (3,)."""
        across = np.eye(3)[int(np.argmax(np.abs(self.n) < _MAX_ACROSS_COMPONENT))]
        start = across - (across @ self.n) * self.n
        return np.asarray(start / np.linalg.norm(start))

    def levers(self, gauge: str) -> tuple[Float64Array, Float64Array]:
        """Return u1 and u2 of the hinge, with the point of the axis that the gauge names."""
        u1 = self.centre - (self.centre @ self.n) * self.n if gauge == "closest_to_R1" else self.centre
        return u1, u1 - self.centre - self.radius * self.start

    def angles(self, p: Float64Array) -> Float64Array:
        """Return psi of points (N, 3) [rad]; (N,)."""
        off = p - self.centre
        return np.asarray(np.arctan2(off @ np.cross(self.n, self.start), off @ self.start))


class CircleFit(NamedTuple):
    """The most likely circle, what it leaves of every sample, and the covariance of what follows from it."""

    circle: Circle
    noise: float  # standard deviation of a coordinate [m]
    residuals: Float64Array  # out of the plane and across the circle [m]; (N, 2)
    weights: Float64Array  # (N,)
    outliers: Float64Array  # 1 where a sample is far off, else 0; (N,)
    covariance: Float64Array  # of u1, u2, n and home; (12, 12)
    findings: tuple[Finding, ...]
    poses: RelativePoses  # at the clock offset
    still: bool  # whether the steps came to rest
    offset: float  # clock offset [s]
    offset_std: float  # its standard deviation, 0 where it was not estimated [s]
    normal: Float64Array  # matrix of the normal equations, in squares of metres; (6, 6), or (7, 7) with the offset

    def shows_offset(self, noisy: RelativePoses) -> bool:
        """Return whether the motion determines the clock offset beside the circle.

        Args:
            noisy: poses at the offset of the fit whose derivatives are as large as the noise in those.
        """
        k = _CIRCLE_PARAMETERS
        across = np.linalg.lstsq(self.normal[:k, :k], self.normal[:k, k])[0]
        shown = self.normal[k, k] - self.normal[k, :k] @ across
        _, change = _linearised(self.circle, noisy)
        noise = float(self.weights @ (change[:, :, k] ** 2).sum(axis=1))
        certain = shown * MAX_OFFSET_STD**2 > self.noise**2
        return self.still and bool(shown > MIN_OFFSET_SIGNAL * noise and certain)


def fit_circle(
    poses: RelativePoses, loss: Loss | None, gauge: str, at: PosesAt | None = None, offset: float = 0.0
) -> CircleFit:
    """Return the most likely circle on which body 2 runs as body 1 sees it.

    Args:
        poses: all samples, of which the places and the weights count.
        loss: of a sample; None counts squares.
        gauge: which point of the axis the levers name.
        at: what gives the poses at other clock offsets, where the offset is an unknown too.
        offset: clock offset that the steps begin with [s].

    Raises:
        FitError: the places show no circle: fewer than four, or on a line.
    """
    every = poses.samples if at is None else _ALL_SAMPLES
    at = at or (lambda _, most: poses.thinned(most))
    some = at(offset, _MAX_FIRST_SAMPLES)
    circle = _circle_of_samples(some.p.T)
    variance, still = np.inf, False
    for most in (_MAX_FIRST_SAMPLES, every) if poses.samples > _MAX_FIRST_SAMPLES else (every,):
        some = at(offset, most)
        for _ in range(_MAX_CIRCLE_STEPS):
            rest, change = _linearised(circle, some)
            variance, weights = _variance_and_weights(rest, some.weights, loss)
            normal = np.einsum("n,nij,nik->jk", weights, change, change)
            gradient = np.einsum("n,nij,ni->j", weights, change, rest)
            step = -solved(normal, gradient)
            turn = max(float(np.abs(step[:2]).max()), float(np.abs(step[2:6]).max()) / (2 * circle.radius))
            share = min(1.0, _MAX_CIRCLE_TURN / max(turn, 1e-300))
            circle = circle.moved(share * step)
            least = 1e-15
            if some.rates is not None:
                delay = float(step[_CIRCLE_PARAMETERS])
                offset += share * delay
                some = at(offset, most)
                least = _RESAMPLING_ERROR if abs(delay) < _RESAMPLING_ERROR else 0.0
            still = bool(step @ normal @ step <= _MAX_CIRCLE_LAST_STEP**2 * variance or turn < least)
            if still:
                break
    n = sign_of(circle.n) * circle.n
    circle = Circle(n, circle.centre, circle.radius - variance / (2 * circle.radius))  # noise makes circles too large
    rest, change = _linearised(circle, some)
    _, weights = _variance_and_weights(rest, some.weights, loss)
    squares = (rest * rest).sum(axis=1)
    outliers = squares > _OUTLIER_SIZE * max(float(np.median(squares)) / _MEDIAN, 1e-300)
    explained = 1e-12 * np.abs(some.p).max() if some.rates is None else _RESAMPLING_ERROR * circle.radius
    outliers &= np.sqrt(squares) > explained
    normal = np.einsum("n,nij,nik->jk", weights, change, change)
    scores = np.einsum("n,nij,ni->jn", weights, change, rest)
    together, _ = summed_neighbours(scores)
    sums = np.add.reduceat(scores, np.arange(0, scores.shape[1], together), axis=1)
    inverse = solved(normal, np.eye(normal.shape[0]))
    free = 2 * some.samples / max(2 * some.samples - normal.shape[0], 1)
    own = free * inverse @ (sums @ sums.T) @ inverse.T
    columns = [
        (_results(circle.moved(x), gauge) - _results(circle.moved(-x), gauge)) / (2 * _CIRCLE_DIFFERENCE)
        for x in _CIRCLE_DIFFERENCE * np.eye(_CIRCLE_PARAMETERS)
    ]
    derivatives = np.stack(columns, axis=-1)
    covariance = derivatives @ own[:_CIRCLE_PARAMETERS, :_CIRCLE_PARAMETERS] @ derivatives.T
    neighbours = (rest[1:] * rest[:-1]).sum(axis=0) / np.maximum((rest * rest).sum(axis=0), 1e-300)
    findings = _findings(circle, rest, neighbours, weights, outliers, covariance, still, gauge)
    good = some.p.T[(weights > 0) & ~outliers]
    widths = np.linalg.svd(good - good.mean(axis=0), compute_uv=False) / np.sqrt(good.shape[0])
    if widths[1] < _MIN_CURVE * widths[2] and neighbours.max() <= _MAX_CORRELATION:
        text = f"The path of the point is straight within its noise, {widths[2]:.2g} m: let the point turn further."
        findings = [Finding(text, False)]
    return CircleFit(
        circle=circle,
        noise=float(np.sqrt(variance * free)),
        residuals=rest,
        weights=weights,
        outliers=outliers.astype(np.float64),
        covariance=covariance,
        findings=tuple(findings),
        poses=some,
        still=still,
        offset=offset,
        offset_std=0.0 if some.rates is None else float(np.sqrt(own[-1, -1])),
        normal=normal,
    )


def circle_misfit(poses: RelativePoses) -> float:
    """Return how badly a circle fits places: minus the logarithm of the likelihood of a sample, by medians."""
    circle = _circle_of_samples(poses.p.T, _ROUGH_TRIPLES)
    for _ in range(_ROUGH_STEPS):
        rest, change = _linearised(circle, poses._replace(rates=None))
        size = np.sqrt(np.median((rest * rest).sum(axis=1))) + 1e-300
        weights = 1 / (1 + (rest * rest).sum(axis=1) / (_CIRCLE_LOSS_SCALE * size * size))
        normal = np.einsum("n,nij,nik->jk", weights, change, change)
        step = -solved(normal, np.einsum("n,nij,ni->j", weights, change, rest))
        turn = max(float(np.abs(step[:2]).max()), float(np.abs(step[2:]).max()) / (2 * circle.radius))
        circle = circle.moved(step * min(1.0, _MAX_CIRCLE_TURN / max(turn, 1e-300)))
    rest, _ = _linearised(circle, poses)
    return float(np.log(np.median((rest * rest).sum(axis=1)) + 1e-30 * poses.size**2))


def _variance_and_weights(rest: Float64Array, given: Float64Array, loss: Loss | None) -> tuple[float, Float64Array]:
    """Return the variance of a coordinate [m^2] and the weights of samples that leave `rest` (N, 2); (N,)."""
    squares = (rest * rest).sum(axis=1)
    if loss is None:
        return float(given @ squares) / (2 * float(given.sum())), given
    variance = float(np.median(squares)) / _MEDIAN
    sizes = given * squares / max(variance, 1e-300)
    return variance, np.where(sizes > _GROSS_SIZE, 0.0, given * loss(sizes / _CIRCLE_LOSS_SCALE)[0])


def _results(circle: Circle, gauge: str) -> Float64Array:
    """Return u1, u2, n and the rotation vector of home, one after the other; (12,)."""
    return np.concatenate((*circle.levers(gauge), circle.n, np.zeros(3)))


def _linearised(circle: Circle, poses: RelativePoses) -> tuple[Float64Array, Float64Array]:
    """Return distances out of the plane and across the circle (N, 2), and their derivatives (N, 2, 6).

    With rates the derivatives by the clock offset come last; (N, 2, 7).
    """
    axes = frame(circle.n)
    x, y, z = ((poses.p.T - circle.centre) @ axes).T
    size = np.maximum(np.hypot(x, y), 1e-300)
    change = np.zeros((x.size, 2, _CIRCLE_PARAMETERS + (poses.rates is not None)))
    # n turns towards x: n' = n + s x, so that z grows by s x and x falls by s z
    change[:, 0, 0], change[:, 0, 1], change[:, 0, 4] = x, y, -1.0
    change[:, 1, 0], change[:, 1, 1] = -z * x / size, -z * y / size
    change[:, 1, 2], change[:, 1, 3], change[:, 1, 5] = -x / size, -y / size, -1.0
    if poses.rates is not None:
        along_x, along_y, along_z = axes.T @ poses.rates[9:]
        change[:, 0, _CIRCLE_PARAMETERS] = along_z
        change[:, 1, _CIRCLE_PARAMETERS] = (x * along_x + y * along_y) / size
    return np.stack((z, size - circle.radius), axis=-1), change


def _circle_of_samples(p: Float64Array, triples: int = _TRIPLES) -> Circle:
    """Return the circle through three samples that most samples agree with, of so many triples."""
    if p.shape[0] < 4:
        raise FitError("body2", "at least four samples of a point", f"{p.shape[0]}")
    rng = np.random.default_rng(0)
    a, b, c = p[rng.integers(p.shape[0], size=(3, triples))]
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
    judges = p[:: -(-p.shape[0] // _MAX_RANKING_SAMPLES)]
    off = judges[None] - centres[:, None]
    out = np.einsum("kni,ki->kn", off, axes)
    across = np.sqrt(np.maximum((off * off).sum(axis=-1) - out**2, 0.0)) - radii[:, None]
    best = int(np.argmin(np.median(out**2 + across**2, axis=1)))
    return Circle(axes[best], centres[best], float(radii[best]))


def _findings(
    circle: Circle,
    rest: Float64Array,
    neighbours: Float64Array,
    weights: Float64Array,
    outliers: NDArray[np.bool_],
    covariance: Float64Array,
    still: bool,
    gauge: str,
) -> list[Finding]:
    """Return what the numbers of the circle do not say by themselves."""
    found = []
    if outliers.any():
        share = f"{100 * outliers.mean():.2g} % of the samples are outliers"
        little = float(weights[outliers].sum()) < 0.5 * outliers.sum() * weights.mean()
        alike = ', and count like the others: loss="cauchy" makes them count little.'
        found.append(Finding(share + ("; they count little." if little else alike), little))
    sizes = np.sqrt(weights @ (rest * rest) / weights.sum())
    for size, correlation, no_circle, play in zip(
        sizes,
        neighbours,
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
        if correlation <= _MAX_CORRELATION or size <= max(1e-9, 0.25 * _MAX_SYSTEMATIC) * circle.radius:
            continue
        if size >= _MAX_SYSTEMATIC * circle.radius:
            found.append(Finding(no_circle.format(size), False))
        else:
            share = f"{100 * size / circle.radius:.2g} % of the radius, and not at random"
            found.append(Finding(f"{play.format(size)}, {share}: the hinge is that of the mean circle.", True))
    std = np.sqrt(np.diagonal(covariance))
    worst, vague = float(np.sqrt((std[6:9] ** 2).sum() / 2)), float(std[:6].max())
    if worst > _MAX_AXIS_STD:
        text = f"The axis is known to {np.degrees(worst):.2g} deg only: let the point turn further."
        found.append(Finding(text, False))
    levers = circle.levers(gauge)
    reach = max(float(np.linalg.norm(lever)) for lever in levers)
    if vague > _MAX_POINT_STD * reach:
        found.append(Finding(f"The hinge point is known to {vague:.2g} m only: let the point turn further.", False))
    if not still:
        found.append(Finding("The steps of the fit did not come to rest.", False))
    return sorted(found, key=lambda finding: finding.harmless)  # what decides the verdict comes first
