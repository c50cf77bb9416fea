"""What a hinge leaves of two recorded bodies, sample by sample, and the covariance of its noise.

Each pose is off by isotropic noise, of place and of attitude. What the constraints leave of sample i, the tilt
Q m - n (two components) and the gap u1 - p - Q u2 (three), is linear in that noise, so that the most likely hinge,
with psi and every true pose eliminated, makes `sum r_i^T C_i^-1 r_i` least, C_i the covariance of r_i (the adjustment
of condition equations with parameters, Helmert 1872; Förstner and Wrobel, Photogrammetric Computer Vision, 2016,
4.8). All is written in axes along the hinge. There the tilt is seen free of the gap; half of the arms times the tilt
is taken from the gap, after which it is

    C = a + b (abs(p)^2 - p p^T) + c w w^T,   w = 2 n x (k S1 u1 + (1 - k) S2 u2),

a the variance of R2 - R1, k the part of body 1 in the variance s of the relative attitude, b = k (1 - k) s and
c = s / 4.

Seen from body 1, a point of body 2 runs along a circle about the axis, off which it is by noise alike in all
directions: two distances, out of the plane of the circle and in it, take the place of tilt and gap.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple, Self

import numpy as np

from hingepair.errors import FitError
from hingepair.measured.hinge import Hinge, Results, home_angle, home_of, sign_of, tilted
from hingepair.measured.most_likely import noise_bias
from hingepair.measured.relative_poses import (
    FEW_SAMPLES,
    RelativePoses,
    closed_form_hinge,
    robust_closed_form_hinge,
)
from hingepair.measured.statistics import Loss, every_kth, median_variance
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.bounded import UNIT_ROUNDOFF

_NOISE_SAMPLES = 4096  # samples that the variances of the noise are estimated from
_ROUNDING = 4 * UNIT_ROUNDOFF  # of attitudes, and of places in parts of their size
_LEAST_NOISE = 1e-3  # least variance of positions, in parts of the mean squared residual
_OPPOSITE = -0.999999  # cosine of axes below which they point against each other
_TRIPLES = 300  # circles that are tried at first


class Noise(NamedTuple):
    """Variances of the noise of a usual sample."""

    place: float  # of a component of R2 - R1 [m^2]
    attitude: float  # of a component of the relative attitude [rad^2]; NaN of a point


class Constraints(NamedTuple):
    """What a hinge leaves of M samples, in axes of which the third is the hinge axis."""

    q: Float64Array  # relative attitude, row by row; (9, M)
    p: Float64Array  # relative place [m]; (3, M)
    arms: Float64Array  # S1 u1 + S2 u2, by the parts of the bodies in the noise, k and 1 - k, doubled [m]; (3, M)
    tilt: Float64Array  # of Q m - n the direction, its length the chord; (2, M)
    gap: Float64Array  # of E1 [m]; (3, M)

    def free_gap(self, tilts: Float64Array, gaps: Float64Array) -> Float64Array:
        """Return gaps (..., 3, M) without the part that tilts (..., 2, M) cause."""
        x, y, z = self.arms
        across, along = 0.5 * z * tilts, -0.5 * (tilts[..., 0, :] * x + tilts[..., 1, :] * y)
        return np.asarray(gaps + np.concatenate((across, along[..., None, :]), axis=-2))


def constraints(hinge: Hinge, poses: RelativePoses) -> Constraints:
    """Return what a hinge leaves of poses."""
    q, p = np.kron(hinge.first.T, hinge.second.T) @ poses.Q, hinge.first.T @ poses.p
    lever1, lever2 = (hinge.first.T @ hinge.u1)[:, None], (hinge.second.T @ hinge.u2)[:, None]
    arm = (q.reshape(3, 3, -1) * lever2).sum(axis=1)
    tilt = q[2:6:3] / np.sqrt(np.maximum((1 + q[8]) / 2, 1e-12))
    tilt[0] = np.where(q[8] < _OPPOSITE, 2.0, tilt[0])
    return Constraints(q, p, 2 * (poses.share * lever1 + (1 - poses.share) * arm), tilt, lever1 - p - arm)


@dataclass(frozen=True, slots=True, eq=False)
class BodyModel:
    """A hinge of two bodies with attitudes, and the noise of their poses."""

    hinge: Hinge
    noise: Noise

    parameters: ClassVar[int] = 9  # those of `Hinge.moved`
    angles: ClassVar[int] = 4  # of these; the others are lengths
    components: ClassVar[int] = 5  # of the residuals of a sample: two tilts and three gaps
    turns_samples: ClassVar[bool] = False  # whether parameters change the angles of samples each in its way
    unknown_split: ClassVar[str] = "is divided between the bodies, which is not known: give noise1 and noise2"

    @classmethod
    def start(cls, poses: RelativePoses, loss: Loss | None) -> Self:
        """Return a first estimate."""
        hinge = closed_form_hinge(poses) if loss is None else robust_closed_form_hinge(poses)
        return cls(hinge, _noise_by_medians(constraints(hinge, poses), poses))

    def misfit(self, poses: RelativePoses, loss: Loss | None) -> float:
        """Return the negative log-likelihood of poses per sample: of the closed form of their own by means of squared
        residuals, or with a loss of this hinge by medians.
        """
        seen = constraints(closed_form_hinge(poses) if loss is None else self.hinge, poses)
        middle = np.mean if loss is None else np.median
        tilt, gap = (middle((part**2).sum(axis=0)) for part in (seen.tilt, seen.gap))
        return float(np.log(tilt + 1e-30) + 1.5 * np.log(gap + 1e-30 * poses.size**2))

    def moved(self, step: Float64Array) -> Self:
        """Return the model after a step of its parameters."""
        return replace(self, hinge=self.hinge.moved(step).balanced())

    def settled(self, gauge: str) -> Self:
        """Return the model with the sign of n and the hinge point that the rules choose."""
        return replace(self, hinge=self.hinge.signed().in_gauge(gauge))

    def with_noise(self, poses: RelativePoses, loss: Loss | None) -> Self:
        """Return the model with the most likely noise, or with a loss that of medians without samples far off."""
        seen = constraints(self.hinge, poses)
        if loss is None:
            start = _noise_by_medians(seen, poses)
            return replace(self, noise=_most_likely_noise(poses.thinned(_NOISE_SAMPLES), self.hinge, start))
        near = (self.rows(poses)[-1] ** 2).sum(axis=0) < 100.0
        some = poses.part(near if 2 * near.sum() > near.size else slice(None))
        return replace(self, noise=_noise_by_medians(constraints(self.hinge, some), some))

    def results(self, gauge: str) -> Results:
        """Return u1, u2, n and home."""
        return self.hinge.results(gauge)

    def rows(self, poses: RelativePoses) -> Float64Array:
        """Return whitened rows (parameters + clock + 1, components, N): the derivatives of the residuals of the
        samples by each unknown, and the residuals as the last row.
        """
        seen, hinge = constraints(self.hinge, poses), self.hinge
        count = self.parameters + len(poses.by_clock) + 1
        tilts, gaps = np.zeros((count, 2, poses.samples)), np.zeros((count, 3, poses.samples))
        tilts[0, 0] = tilts[1, 1] = -1.0
        tilts[2], tilts[3], tilts[-1] = seen.q[0:6:3], seen.q[1:6:3], seen.tilt
        gaps[4, 0] = gaps[5, 1] = gaps[6, 2] = 1.0
        gaps[7], gaps[8], gaps[-1] = -seen.q[0::3], -seen.q[1::3], seen.gap
        lever2 = (hinge.second.T @ hinge.u2)[:, None]
        for k, change in enumerate(poses.by_clock, self.parameters):
            dq, dp = np.kron(hinge.first.T, hinge.second.T) @ change[:9], hinge.first.T @ change[9:]
            tilts[k] = dq[2:6:3]
            gaps[k] = -dp - (dq.reshape(3, 3, -1) * lever2).sum(axis=1)
        return _whitened(seen, poses, self.noise, tilts, seen.free_gap(tilts, gaps))

    def exact(self, poses: RelativePoses) -> tuple[Float64Array, Float64Array]:
        """Return the relative poses, attitudes (N, 3, 3) and places (N, 3), of the hinge at the angles of samples."""
        q = constraints(self.hinge, poses).q
        psi = np.arctan2(q[3] - q[1], q[0] + q[4])
        c, s, zero = np.cos(psi), np.sin(psi), np.zeros_like(psi)
        turn = np.stack((c, -s, zero, s, c, zero, zero, zero, zero + 1), axis=-1).reshape(-1, 3, 3)
        Q = self.hinge.first @ turn @ self.hinge.second.T
        return Q, self.hinge.u1 - Q @ self.hinge.u2

    def bias(self, poses: RelativePoses, share: float | None = None) -> Float64Array:
        """Return the bias of the parameters, if body 1 has this share in the variance of the attitudes; None: that by
        which residuals are whitened.
        """
        reach = max(float(np.sqrt((poses.p**2).sum() / poses.samples)), 1e-300)
        size = np.sqrt(self.noise.attitude) + np.sqrt(self.noise.place) / reach
        if np.sqrt(poses.samples) * size < 0.1:  # in standard deviations
            return np.zeros(self.parameters)
        part = poses.share if share is None else share
        place, attitude = self.noise
        return noise_bias(self, poses, (place, attitude * part, attitude * (1 - part)))

    def doubt(self, poses: RelativePoses) -> Float64Array:
        """Return the standard deviation of the parameters, all off alike, if it is not known how much of the noise is
        that of body 1's attitudes.
        """
        # The variance of a number between 0 and 1 is 1/12.
        return np.asarray((self.bias(poses, 1.0) - self.bias(poses, 0.0)) / np.sqrt(12))

    def psi(self, poses: RelativePoses) -> Float64Array:
        """Return the hinge angles [rad] (N,), with jumps by 2 pi."""
        turned = np.kron(self.hinge.first.T, self.hinge.second.T)
        psi = np.arctan2((turned[3] - turned[1]) @ poses.Q, (turned[0] + turned[4]) @ poses.Q)
        return np.asarray(psi - home_angle(self.hinge, home_of(self.hinge)))

    def psi_variances(self, poses: RelativePoses, _doubt: Float64Array) -> Float64Array:
        """Return the variances of psi [rad^2] by the noise of each sample; (N,)."""
        return np.asarray(self.noise.attitude * poses.variances)

    def gap_and_tilt(self, poses: RelativePoses) -> tuple[Float64Array, Float64Array]:
        """Return the gap [m], in axes along the hinge, and the angle between the axes [rad]; (3, N) and (N,)."""
        seen = constraints(self.hinge, poses)
        return seen.gap, np.arctan2(np.hypot(seen.q[2], seen.q[5]), seen.q[8])


@dataclass(frozen=True, slots=True, eq=False)
class PointModel(BodyModel):
    """A hinge, made by `Hinge.around`, about which a point of body 2 moves, and the noise of its places.

    The parameters are tilts of n towards the first two columns of `hinge.first` [rad], shifts of the centre along all
    three, and the growth of the radius [m].
    """

    parameters: ClassVar[int] = 6
    angles: ClassVar[int] = 2
    components: ClassVar[int] = 2
    turns_samples: ClassVar[bool] = True
    unknown_split: ClassVar[str] = "of body 1 adds to that of the places"

    @property
    def radius(self) -> float:
        """Radius of the circle [m]."""
        return float(-self.hinge.u2 @ self.hinge.second[:, 0])

    @classmethod
    def start(cls, poses: RelativePoses, _loss: Loss | None) -> Self:
        """Return a first estimate; raise FitError if the places show no circle."""
        return cls(_circle_of_random_triples(poses.p.T), Noise(1.0, np.nan))

    def misfit(self, poses: RelativePoses, _loss: Loss | None) -> float:
        """Return the logarithm of the median squared distance [m^2] from a circle of these poses."""
        circle = self.start(poses, None)
        for _ in range(4):
            squares = (circle.distances(poses) ** 2).sum(axis=0)
            weights = 1 / (1 + squares / max(float(np.median(squares)), 1e-300))
            circle = replace(self, hinge=_circle_of_least_squares(poses.p.T, weights))
        return float(np.log(np.median((circle.distances(poses) ** 2).sum(axis=0)) + 1e-30 * poses.size**2))

    def moved(self, step: Float64Array) -> Self:
        """Return the model after a step of its parameters."""
        n, centre = tilted(self.hinge.first, step[:2])[:, 2], self.hinge.u1 + self.hinge.first @ step[2:5]
        return replace(self, hinge=Hinge.around(n, centre, self.radius + float(step[5])))

    def settled(self, _gauge: str) -> Self:
        """Return the model with the sign of n that the rules choose."""
        n = self.hinge.n
        return replace(self, hinge=Hinge.around(sign_of(n) * n, self.hinge.u1, self.radius))

    def results(self, gauge: str) -> Results:
        """Return u1, u2, n and home, which is exactly the identity."""
        return *self.hinge.results(gauge)[:3], np.eye(3)

    def with_noise(self, poses: RelativePoses, loss: Loss | None) -> Self:
        """Return the model with the noise that the distances show."""
        squares, weights = (self.distances(poses) ** 2).sum(axis=0), 1 / poses.variances
        free = 2 * poses.samples / max(2 * poses.samples - self.parameters, 1)
        variance = free * float(weights @ squares / (2 * weights.sum()))
        if loss is not None:
            variance = median_variance(weights * squares, 2)
        return replace(self, noise=Noise(max(variance, (1e-16 * poses.size) ** 2, 1e-300), np.nan))

    def coordinates(self, poses: RelativePoses) -> Float64Array:
        """Return the places from the centre, along `hinge.first`; (3, N)."""
        return self.hinge.first.T @ (poses.p - self.hinge.u1[:, None])

    def distances(self, poses: RelativePoses) -> Float64Array:
        """Return the distances [m] out of the plane of the circle, positive along n, and in it, positive outside."""
        x, y, z = self.coordinates(poses)
        return np.stack((z, np.hypot(x, y) - self.radius))

    def rows(self, poses: RelativePoses) -> Float64Array:
        """Return whitened rows as of a BodyModel; the residuals of a sample are its distances."""
        x, y, z = self.coordinates(poses)
        size = np.maximum(np.hypot(x, y), 1e-300)
        rows = np.zeros((self.parameters + len(poses.by_clock) + 1, 2, poses.samples))
        # n tilts towards x: z grows by x, and the distance from the axis falls by z.
        rows[0], rows[1] = (x, -z * x / size), (y, -z * y / size)
        rows[2, 1], rows[3, 1], rows[4, 0], rows[5, 1] = -x / size, -y / size, -1.0, -1.0
        for k, by_clock in enumerate(poses.by_clock, self.parameters):
            dx, dy, dz = self.hinge.first.T @ by_clock[9:]
            rows[k] = dz, (x * dx + y * dy) / size
        rows[-1] = z, size - self.radius
        return np.asarray(rows / np.sqrt(poses.variances * self.noise.place))

    def exact(self, poses: RelativePoses) -> tuple[Float64Array, Float64Array]:
        """Return the relative attitudes of the samples, which do not count, and the places on the circle."""
        x, y, _ = self.coordinates(poses)
        along = self.radius / np.maximum(np.hypot(x, y), 1e-300)
        return poses.attitudes, self.hinge.u1 + np.stack((along * x, along * y, 0 * x), axis=1) @ self.hinge.first.T

    def bias(self, poses: RelativePoses, _share: float | None = None) -> Float64Array:
        """Return the bias of the parameters by noise of places: circles come out too large."""
        return noise_bias(self, poses, (self.noise.place, 0.0, 0.0))

    def doubt(self, poses: RelativePoses) -> Float64Array:
        """Return the bias of the parameters if all noise were that of body 1's attitudes, which is not known."""
        turned = max(float(self._turned(poses)[0].mean()), 1e-300)
        return noise_bias(self, poses, (0.0, self.noise.place / turned, 0.0))

    def _turned(self, poses: RelativePoses) -> Float64Array:
        """Return the squares by which turns of body 1 move the point off the circle, and along it [m^2]; (2, N)."""
        x, y, _ = self.coordinates(poses)
        size = np.maximum(np.hypot(x, y), 1e-300)
        ways = np.stack(
            [self.hinge.first @ way for way in ((x / size, y / size, 0 * x), (-y / size, x / size, 0 * x))]
        )
        # Each turn moves it across the vector to it.
        radial, along = (ways * poses.p).sum(axis=1) ** 2
        whole, axial = (poses.p**2).sum(axis=0), (self.hinge.n @ poses.p) ** 2
        return np.stack((whole - (radial + axial) / 2, whole - along))

    def psi(self, poses: RelativePoses) -> Float64Array:
        """Return the hinge angles [rad] (N,), with jumps by 2 pi."""
        x, y, _ = self.coordinates(poses)
        return np.asarray(np.arctan2(y, x))

    def psi_variances(self, poses: RelativePoses, doubt: Float64Array) -> Float64Array:
        """Return the variances of psi [rad^2] by the noise of each sample, which may be larger along the circle than
        across it if it is that of body 1's attitudes (`doubt` is not 0); (N,).
        """
        along = np.full(poses.samples, self.noise.place)  # [m^2]
        if doubt.any():
            across, by_turns = self._turned(poses)
            along = np.maximum(along, self.noise.place / max(float(across.mean()), 1e-300) * by_turns)
        return np.asarray(along * poses.variances / self.radius**2)

    def gap_and_tilt(self, poses: RelativePoses) -> tuple[Float64Array, Float64Array]:
        """Return the distances from the circle [m], (2, N), and NaN for the tilt."""
        return self.distances(poses), np.full(poses.samples, np.nan)


def _whitened(
    seen: Constraints, poses: RelativePoses, noise: Noise, tilts: Float64Array, free_gaps: Float64Array
) -> Float64Array:
    """Return rows (k, 5, M) of tilts (k, 2, M) and of gaps without their part (k, 3, M), divided by the Cholesky
    factor of their covariance.
    """
    a, s = noise.place * poses.variances, noise.attitude * poses.variances
    b, c = s * poses.share * (1 - poses.share), s / 4
    (p, q, r), (x, y, _) = seen.p, seen.arms
    # w = (-y, x, 0); no eigenvalue of the covariance is below a.
    xy, zx, yz = -b * p * q - c * x * y, -b * r * p, -b * q * r
    l1 = np.sqrt(a + b * (q * q + r * r) + c * y * y)
    l2, l3 = xy / l1, zx / l1
    m2 = np.sqrt(np.maximum(a + b * (r * r + p * p) + c * x * x - l2**2, a))
    m3 = (yz - l2 * l3) / m2
    n3 = np.sqrt(np.maximum(a + b * (p * p + q * q) - l3**2 - m3**2, a))
    rows = np.empty((tilts.shape[0], 5, tilts.shape[2]))
    rows[:, :2] = tilts / np.sqrt(s)
    rows[:, 2] = free_gaps[:, 0] / l1
    rows[:, 3] = (free_gaps[:, 1] - l2 * rows[:, 2]) / m2
    rows[:, 4] = (free_gaps[:, 2] - l3 * rows[:, 2] - m3 * rows[:, 3]) / n3
    return rows


def _noise_by_medians(seen: Constraints, poses: RelativePoses) -> Noise:
    """Return the noise by medians of squared residuals, at least that of rounding."""
    tilt, gap = ((part**2).sum(axis=0) / poses.variances for part in (seen.tilt, seen.free_gap(seen.tilt, seen.gap)))
    attitude = max(median_variance(tilt, 2), _ROUNDING**2)
    # The variance of positions is what the gaps show beyond the effect of the attitudes.
    by_attitude = 2 * poses.share * (1 - poses.share) * (seen.p**2).sum(axis=0) + (seen.arms[:2] ** 2).sum(axis=0) / 4
    across = median_variance(gap, 3)
    variance = max(across - attitude * float(by_attitude.mean()) / 3, _LEAST_NOISE * across)
    return Noise(max(variance, (_ROUNDING * poses.size) ** 2, 1e-300), attitude)


def _most_likely_noise(poses: RelativePoses, hinge: Hinge, start: Noise) -> Noise:
    """Return the variance of attitudes that the tilts show, and the most likely one of positions beside it."""
    seen = constraints(hinge, poses)
    free = max(1 - BodyModel.parameters / (BodyModel.components * poses.samples), 0.1)
    attitude = max(float((seen.tilt**2 / poses.variances).mean()) / free, _ROUNDING**2)
    w = np.stack((-seen.arms[1], seen.arms[0], np.zeros(poses.samples)), axis=-1)
    p, b = seen.p.T, poses.share * (1 - poses.share)
    matrix = b * ((p * p).sum(axis=1)[:, None, None] * np.eye(3) - p[:, :, None] * p[:, None])
    # In these eigenvectors the parts of a gap are independent.
    values, axes = np.linalg.eigh(matrix + w[:, :, None] * w[:, None] / 4)
    gap = np.einsum("nij,in->nj", axes, seen.free_gap(seen.tilt, seen.gap))
    squares = gap**2 / (poses.variances[:, None] * free)
    by_attitude = attitude * np.maximum(values, 0.0)
    least, variance = max(_LEAST_NOISE * squares.mean(), (_ROUNDING * poses.size) ** 2, 1e-300), start.place
    for _ in range(25):  # Fisher scoring
        weights = (variance + by_attitude) ** -2.0
        before, variance = variance, max(float((weights * (squares - by_attitude)).sum() / weights.sum()), least)
        if abs(variance / before - 1) < 1e-3:
            break
    return Noise(variance, attitude)


def _circle_of_least_squares(p: Float64Array, weights: Float64Array) -> Hinge:
    """Return the circle of places p (N, 3) by linear least squares: a plane, and in it the squared distances."""
    root = np.sqrt(weights)[:, None]
    mean = (weights @ p) / weights.sum()
    axes = np.linalg.svd(root * (p - mean), full_matrices=False)[2]
    x, y, _ = axes @ (p - mean).T
    rows = np.stack((2 * x, 2 * y, np.ones_like(x)), axis=1)
    a, b, c = np.linalg.lstsq(root * rows, root[:, 0] * (x * x + y * y))[0]
    return Hinge.around(axes[2], mean + a * axes[0] + b * axes[1], float(np.sqrt(max(c + a * a + b * b, 1e-300))))


def _circle_of_random_triples(p: Float64Array) -> Hinge:
    """Return the circle with the smallest median distance from the samples p (N, 3), among the circles through random
    triples of samples (fixed seed); refuse samples that show none.
    """
    if p.shape[0] < 4:
        raise FitError("body2", "at least four samples of a point", f"{p.shape[0]}")
    a, b, c = p[np.random.default_rng(0).integers(p.shape[0], size=(3, _TRIPLES))]
    ab, ac = b - a, c - a
    normal = np.cross(ab, ac)
    area = np.linalg.norm(normal, axis=1)
    sides = np.linalg.norm(ab, axis=1) * np.linalg.norm(ac, axis=1)
    shown = (area > 1e-6 * np.maximum(sides, 1e-300)) & (sides > 0)
    if not shown.any():
        raise FitError("body2", "a point that moves along an arc about an axis", "places on a line, or one place")
    a, ab, ac, normal, area = a[shown], ab[shown], ac[shown], normal[shown], area[shown]
    bb, cc = (np.einsum("ni,ni->n", v, v)[:, None] for v in (ab, ac))
    centres = a + np.cross(normal, bb * ac - cc * ab) / (-2 * area**2)[:, None]
    axes, radii = normal / area[:, None], np.linalg.norm(a - centres, axis=1)
    off = p[every_kth(p.shape[0], FEW_SAMPLES)] - centres[:, None]
    out = np.einsum("kni,ki->kn", off, axes)
    across = np.sqrt(np.maximum((off * off).sum(axis=-1) - out**2, 0.0)) - radii[:, None]
    best = int(np.argmin(np.median(out**2 + across**2, axis=1)))
    return Hinge.around(axes[best], centres[best], float(radii[best]))
