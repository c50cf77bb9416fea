"""What a circle leaves of a body and a point: seen from body 1, a point of body 2 runs along a circle about the axis.

Off the circle it is by noise alike in all directions, so that the most likely circle makes the sum of squared
distances least, out of the plane and across it. Attitudes of body 2 are not seen: `home` is the identity. An offset
between the clocks of the bodies takes the point off the circle where body 1 moves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from hingepair.errors import FitError
from hingepair.measured.hinge import Results, first_axis_across, frame, sign_of, slopes, tilted
from hingepair.measured.hinge_model import Noise
from hingepair.measured.most_likely import Rows, noise_bias
from hingepair.measured.relative_poses import FEW_SAMPLES, RelativePoses
from hingepair.measured.statistics import Loss, median_variance
from hingepair.numeric.arrays import Float64Array

_TRIPLES = 300  # circles that are tried at first


class Circle(NamedTuple):
    """A circle in the axes of body 1, on which a point of body 2 moves."""

    axes: Float64Array  # orthonormal columns, the last is n
    centre: Float64Array  # [m]; (3,)
    radius: float  # [m]

    @property
    def n(self) -> Float64Array:
        """Axis, a unit vector (3,)."""
        return self.axes[:, 2]

    def moved(self, step: Float64Array) -> Circle:
        """Return the circle after a step of six numbers: tilts of n [rad] towards the first two columns of `axes`,
        shifts of the centre [m] along all three, and the growth of the radius [m].
        """
        return Circle(tilted(self.axes, step[:2]), self.centre + self.axes @ step[2:5], self.radius + float(step[5]))

    def coordinates(self, p: Float64Array) -> Float64Array:
        """Return places (N, 3) from the centre, along `axes`; (3, N)."""
        return self.axes.T @ (p - self.centre).T

    def levers(self, gauge: str) -> tuple[Float64Array, Float64Array]:
        """Return u1 and u2 (3,), in axes of body 1 at psi = 0, with the hinge point that `gauge` names."""
        u1 = self.centre - (self.centre @ self.n) * self.n if gauge == "closest_to_R1" else self.centre
        return u1, u1 - self.centre - self.radius * self.zero_direction

    @property
    def zero_direction(self) -> Float64Array:
        """Unit vector, in axes of body 1, from the centre to the point of the circle where psi = 0; (3,)."""
        across = np.eye(3)[first_axis_across(self.n)]
        start = across - (across @ self.n) * self.n
        return np.asarray(start / np.linalg.norm(start))

    def angles(self, p: Float64Array) -> Float64Array:
        """Return the hinge angles psi (N,) in [-pi, pi] [rad] at which the moving point is at places p (N, 3)."""
        off = p - self.centre
        return np.asarray(np.arctan2(off @ np.cross(self.n, self.zero_direction), off @ self.zero_direction))


@dataclass(frozen=True, slots=True, eq=False)
class PointModel:
    """A circle on which a point of body 2 moves, and the noise of its places."""

    circle: Circle
    variance: float  # of a coordinate [m^2]

    parameters: ClassVar = 6  # those of `Circle.moved`
    angles: ClassVar = 2
    components: ClassVar = 2
    unknown_split: ClassVar = "of body 1 adds to that of the places"

    @property
    def noise(self) -> Noise:
        """The noise; that of attitudes is NaN."""
        return Noise(self.variance, np.nan)

    @classmethod
    def start(cls, poses: RelativePoses, _loss: Loss | None, /) -> PointModel:
        """Return a first estimate; raise FitError if the places show no circle."""
        return cls(_circle_of_random_triples(poses.p.T), 1.0)

    def misfit(self, poses: RelativePoses, _loss: Loss | None, /) -> float:
        """Return the logarithm of the median squared distance [m^2] from a circle of these poses."""
        circle = _circle_of_random_triples(poses.p.T)
        for _ in range(4):
            squares = (_distances(circle, poses) ** 2).sum(axis=0)
            circle = _circle_of_least_squares(poses.p.T, 1 / (1 + squares / max(float(np.median(squares)), 1e-300)))
        return float(np.log(np.median((_distances(circle, poses) ** 2).sum(axis=0)) + 1e-30 * poses.size**2))

    def moved(self, step: Float64Array) -> PointModel:
        """Return the model after a step of `Circle.moved`."""
        return replace(self, circle=self.circle.moved(step))

    def settled(self, _gauge: str, /) -> PointModel:
        """Return the model with the sign of n that the rules choose."""
        n = self.circle.n
        return replace(self, circle=self.circle._replace(axes=frame(sign_of(n) * n)))

    def with_noise(self, poses: RelativePoses, loss: Loss | None) -> PointModel:
        """Return the model with the noise that the distances show."""
        squares, weights = (_distances(self.circle, poses) ** 2).sum(axis=0), 1 / poses.noise[0]
        free = 2 * poses.samples / max(2 * poses.samples - self.parameters, 1)
        variance = (
            free * float(weights @ squares / (2 * weights.sum()))
            if loss is None
            else median_variance(weights * squares, 2)
        )
        return replace(self, variance=max(variance, (1e-16 * poses.size) ** 2, 1e-300))

    def rows_near(self, poses: RelativePoses) -> Rows:
        """Return the function that gives whitened rows; residuals of a sample are its distances out of the plane of
        the circle, positive along n, and in it from the circle, positive outside.
        """
        scale = 1 / np.sqrt(poses.noise[0] * self.variance)

        def rows(model: PointModel, moved: RelativePoses) -> Float64Array:
            x, y, z = model.circle.coordinates(moved.p.T)
            size = np.maximum(np.hypot(x, y), 1e-300)
            change = np.zeros((self.parameters + len(moved.by_clock) + 1, 2, x.size))
            # n tilts towards x: z grows by x, and x falls by z
            change[0], change[1] = (x, -z * x / size), (y, -z * y / size)
            turn = self.circle.axes.T @ model.circle.axes  # the centre moves along the axes of this model
            change[2:5, 0], change[2:5, 1] = -turn[:, 2:], -turn[:, :2] @ ((x, y) / size)
            change[5, 1] = -1.0
            for k, by_clock in enumerate(moved.by_clock, self.parameters):
                dx, dy, dz = model.circle.axes.T @ by_clock[9:]
                change[k] = dz, (x * dx + y * dy) / size
            change[-1] = z, size - model.circle.radius
            return np.asarray(scale * change)

        return rows

    def exact(self, poses: RelativePoses) -> tuple[Float64Array, Float64Array]:
        """Return the relative attitudes of the samples, which do not count, and the places on the circle."""
        psi, x = self.circle.angles(poses.p.T)[:, None], self.circle.zero_direction
        around = np.cos(psi) * x + np.sin(psi) * np.cross(self.circle.n, x)
        return poses.attitudes, np.asarray(self.circle.centre + self.circle.radius * around)

    def bias(self, poses: RelativePoses) -> Float64Array:
        """Return the bias of the parameters by noise of places: circles come out too large."""
        return noise_bias(self, poses, np.outer((self.variance, 0.0, 0.0), poses.noise[0]))

    def doubt(self, poses: RelativePoses) -> Float64Array:
        """Return the bias of the parameters (6,) that would result if all of the noise were that of body 1's
        attitudes, which is not known.
        """
        return noise_bias(self, poses, np.outer((0.0, self._variance_of_attitudes(poses), 0.0), poses.noise[0]))

    def _variance_of_attitudes(self, poses: RelativePoses) -> float:
        """Return the variance of noise of body 1's attitudes [rad^2] that would leave what the places leave."""
        x, y, _ = self.circle.coordinates(poses.p.T)
        size = np.maximum(np.hypot(x, y), 1e-300)
        directions = np.stack((self.circle.axes @ ((x, y, 0 * x) / size), np.outer(self.circle.n, np.ones_like(x))))
        # Each turn of body 1 moves the point across the vector to it.
        turned = (poses.p**2).sum(axis=0) - (directions * poses.p).sum(axis=1) ** 2
        return self.variance / max(float(turned.mean()), 1e-300)

    def results(self, gauge: str) -> Results:
        """Return u1, u2, n and home, which is fixed."""
        return *self.circle.levers(gauge), self.circle.n, np.eye(3)

    def psi(self, poses: RelativePoses) -> Float64Array:
        """Return the hinge angles [rad] (N,), with jumps by 2 pi."""
        return self.circle.angles(poses.p.T)

    def psi_derivatives(self, poses: RelativePoses) -> Float64Array:
        """Return the derivatives of psi by the parameters and the clock; (k, N)."""
        psi = self.psi(poses)

        def off(step: Float64Array) -> Float64Array:
            return np.sin(self.circle.moved(step).angles(poses.p.T) - psi)

        rows = [*slopes(off, self.parameters).T]
        x, y, _ = self.circle.coordinates(poses.p.T)
        for by_clock in poses.by_clock:
            dx, dy, _ = self.circle.axes.T @ by_clock[9:]
            rows.append((x * dy - y * dx) / np.maximum(x * x + y * y, 1e-300))
        return np.stack(rows)

    def psi_variances(self, poses: RelativePoses, doubt: Float64Array, /) -> Float64Array:
        """Return the variances of psi [rad^2] by the noise of each sample, which may be larger along the circle than
        across it if it is that of body 1's attitudes (`doubt` is not 0); (N,).
        """
        along = np.full(poses.samples, self.variance)  # [m^2]
        if doubt.any():
            p = poses.p.T
            tangent = np.cross(self.circle.n, p - self.circle.centre) / self.circle.radius
            turned = (p**2).sum(axis=1) - (p * tangent).sum(axis=1) ** 2
            along = np.maximum(along, self._variance_of_attitudes(poses) * turned)
        return np.asarray(along * poses.noise[0] / self.circle.radius**2)

    def gap_and_tilt(self, poses: RelativePoses) -> tuple[Float64Array, Float64Array]:
        """Return the distances from the circle [m], (2, N), and NaN for the tilt."""
        return _distances(self.circle, poses), np.full(poses.samples, np.nan)


def _distances(circle: Circle, poses: RelativePoses) -> Float64Array:
    """Return the distances [m] from the plane of the circle, and in it from the circle; (2, N)."""
    x, y, z = circle.coordinates(poses.p.T)
    return np.stack((z, np.hypot(x, y) - circle.radius))


def _circle_of_least_squares(p: Float64Array, weights: Float64Array) -> Circle:
    """Return the circle of places p (N, 3) by linear least squares: a plane, and in it the squared distances."""
    root = np.sqrt(weights)[:, None]
    mean = (weights @ p) / weights.sum()
    axes = frame(np.linalg.svd(root * (p - mean), full_matrices=False)[2][2])
    x, y, _ = axes.T @ (p - mean).T
    rows = np.stack((2 * x, 2 * y, np.ones_like(x)), axis=1)
    a, b, c = np.linalg.lstsq(root * rows, root[:, 0] * (x * x + y * y))[0]
    return Circle(axes, mean + axes[:, 0] * a + axes[:, 1] * b, float(np.sqrt(max(c + a * a + b * b, 1e-300))))


def _circle_of_random_triples(p: Float64Array) -> Circle:
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
    off = p[:: -(-p.shape[0] // FEW_SAMPLES)] - centres[:, None]
    out = np.einsum("kni,ki->kn", off, axes)
    across = np.sqrt(np.maximum((off * off).sum(axis=-1) - out**2, 0.0)) - radii[:, None]
    best = int(np.argmin(np.median(out**2 + across**2, axis=1)))
    return Circle(frame(axes[best]), centres[best], float(radii[best]))
