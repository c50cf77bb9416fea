"""The hinge of a body and a point: seen from body 1, a point of body 2 runs along a circle about the axis.

Off the circle it is by noise alike in all directions, so that the most likely circle makes the sum of squared
distances least, out of the plane and across it. Attitudes of body 2 are not seen: `home` is the identity.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import FitError
from hingepair.measured.findings import Finding
from hingepair.measured.hinge import frame, sign_of, turned
from hingepair.measured.likelihood import Loss, summed_neighbours
from hingepair.numeric.arrays import Float64Array

_TRIPLES = 300  # of samples, each of which gives a circle
_MAX_JUDGED = 300  # samples that tell which of these circles is best
_MAX_STEPS = 60
_MAX_LAST_STEP = 1e-3  # in standard deviations
_MAX_ACROSS_COMPONENT = 0.65
"""The first coordinate axis whose component of n is below this names the direction of psi = 0."""
_LOSS_SCALE, _GROSS_SIZE = 5.99, 900.0  # of squares, in variances, at which losses bend and samples stop to count
_OUTLIER_SIZE = 50.0
_MEDIAN = 1.3863  # of chi-squared with 2 degrees of freedom
_MIN_CURVE = 3.0  # width of the path across its chord, in parts of that out of its plane
_MAX_CORRELATION = 0.5  # of neighbours' residuals; above, they are no noise
_MAX_AXIS_STD = np.radians(2.0)  # [rad]
_MAX_POINT_STD = 0.1  # in parts of the levers' length
_MAX_SYSTEMATIC = 0.02  # of the radius: residuals that are no noise and can be put up with
_DIFFERENCE = 1e-6  # step of the derivatives of the results


class Circle(NamedTuple):
    """A circle in body 1's axes."""

    n: Float64Array  # axis, unit; (3,)
    centre: Float64Array  # [m]; (3,)
    radius: float  # [m]

    def moved(self, step: Float64Array) -> Circle:
        """Return the circle after a step: turns of n across (2), the centre in axes of `frame` (3), the radius."""
        centre = self.centre + frame(self.n) @ step[2:5]
        return Circle(turned(self.n, step[:2]), centre, self.radius + float(step[5]))

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


def fit_circle(p: Float64Array, given: Float64Array, loss: Loss | None, gauge: str) -> CircleFit:
    """Return the most likely circle through places (N, 3) of weights (N,) as body 1 sees them [m].

    Raises:
        FitError: the places show no circle: fewer than four, or on a line.
    """
    circle = _start(p)
    variance, still = np.inf, False
    for _ in range(_MAX_STEPS):
        rest, change = _linearised(circle, p)
        squares = (rest * rest).sum(axis=1)
        if loss is None:
            variance = float(given @ squares) / (2 * given.sum())
            weights = given
        else:
            variance = float(np.median(squares)) / _MEDIAN
            sizes = given * squares / max(variance, 1e-300)
            weights = np.where(sizes > _GROSS_SIZE, 0.0, given * loss(sizes / _LOSS_SCALE)[0])
        normal = np.einsum("n,nij,nik->jk", weights, change, change)
        gradient = np.einsum("n,nij,ni->j", weights, change, rest)
        step = -np.linalg.lstsq(normal, gradient)[0]
        turn = max(float(np.abs(step[:2]).max()), float(np.abs(step[2:]).max()) / (2 * circle.radius))
        circle = circle.moved(step * min(1.0, 0.3 / max(turn, 1e-300)))
        still = bool(step @ normal @ step <= _MAX_LAST_STEP**2 * variance or turn < 1e-15)
        if still:
            break
    n = sign_of(circle.n) * circle.n
    circle = Circle(n, circle.centre, circle.radius - variance / (2 * circle.radius))  # noise makes circles too large
    rest, change = _linearised(circle, p)
    squares = (rest * rest).sum(axis=1)
    outliers = squares > _OUTLIER_SIZE * max(float(np.median(squares)) / _MEDIAN, 1e-300)
    outliers &= np.sqrt(squares) > 1e-12 * np.abs(p).max()
    normal = np.einsum("n,nij,nik->jk", weights, change, change)
    scores = np.einsum("n,nij,ni->jn", weights, change, rest)
    together, _ = summed_neighbours(scores)
    sums = np.add.reduceat(scores, np.arange(0, scores.shape[1], together), axis=1)
    inverse = np.linalg.pinv(normal)
    free = 2 * p.shape[0] / max(2 * p.shape[0] - 6, 1)
    own = free * inverse @ (sums @ sums.T) @ inverse
    columns = [
        (_results(circle.moved(x), gauge) - _results(circle.moved(-x), gauge)) / (2 * _DIFFERENCE)
        for x in _DIFFERENCE * np.eye(6)
    ]
    derivatives = np.stack(columns, axis=-1)
    covariance = derivatives @ own @ derivatives.T
    noise = float(np.sqrt(variance * free))
    neighbours = (rest[1:] * rest[:-1]).sum(axis=0) / np.maximum((rest * rest).sum(axis=0), 1e-300)
    findings = _findings(circle, rest, neighbours, weights, outliers, covariance, still, gauge)
    good = p[(weights > 0) & ~outliers]
    widths = np.linalg.svd(good - good.mean(axis=0), compute_uv=False) / np.sqrt(good.shape[0])
    if widths[1] < _MIN_CURVE * widths[2] and neighbours.max() <= _MAX_CORRELATION:
        text = f"The path of the point is straight within its noise, {widths[2]:.2g} m: let the point turn further."
        findings = [Finding(text, False)]
    return CircleFit(circle, noise, rest, weights, outliers.astype(np.float64), covariance, tuple(findings))


def _results(circle: Circle, gauge: str) -> Float64Array:
    """Return u1, u2, n and the rotation vector of home, one after the other; (12,)."""
    return np.concatenate((*circle.levers(gauge), circle.n, np.zeros(3)))


def _linearised(circle: Circle, p: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return distances out of the plane and across the circle (N, 2), and their derivatives (N, 2, 6)."""
    x, y, z = ((p - circle.centre) @ frame(circle.n)).T
    size = np.maximum(np.hypot(x, y), 1e-300)
    change = np.zeros((x.size, 2, 6))
    # n turns towards x: n' = n + s x, so that z grows by s x and x falls by s z
    change[:, 0, 0], change[:, 0, 1], change[:, 0, 4] = x, y, -1.0
    change[:, 1, 0], change[:, 1, 1] = -z * x / size, -z * y / size
    change[:, 1, 2], change[:, 1, 3], change[:, 1, 5] = -x / size, -y / size, -1.0
    return np.stack((z, size - circle.radius), axis=-1), change


def _start(p: Float64Array) -> Circle:
    """Return the circle through three samples that most samples agree with."""
    if p.shape[0] < 4:
        raise FitError("body2", "at least four samples of a point", f"{p.shape[0]}")
    rng = np.random.default_rng(0)
    a, b, c = p[rng.integers(p.shape[0], size=(3, _TRIPLES))]
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
    judges = p[:: -(-p.shape[0] // _MAX_JUDGED)]
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
