"""The noise of a log: how large it is, and what it makes of accelerations and of what follows from them.

Second differences multiply the noise of samples by 1/h^2 of their step h. The noise of each column is estimated by
what a local polynomial leaves of it. Then as much noise is added to the column once more and goes through the same
differences: the change of a result is as large as what the log's own noise has made of it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.finite_differences import differentiate, local_fit_residuals, stencils
from hingepair.pair.body_motion import BodyMotion
from hingepair.plans.steps import LOG_COLUMNS_OF, SPATIAL_COORDINATE_NAMES
from hingepair.rotations.matrices import rotation_exp, rotation_vector
from hingepair.scenes.motions.known import HINGE_NAMES, KnownMotion, MotionByBody1, MotionByCoordinates


def noise_rows(count: int) -> slice:
    """Return the slice of the samples from which the noise of a log with `count` samples is estimated: at most
    100,000 in the middle.
    """
    max_count = 100_000
    first = max(0, (count - max_count) // 2)
    return slice(first, first + max_count)


def finite_rms(values: Float64Array) -> Float64Array:
    """Return the root mean square of the finite values along the first axis; NaN if none is finite."""
    finite = np.isfinite(values)
    with np.errstate(invalid="ignore"):
        rms: Float64Array = np.sqrt((np.where(finite, values, 0.0) ** 2).sum(axis=0) / finite.sum(axis=0))
    return rms


def motion_with_errors(motion: MotionByBody1, errors: Mapping[str, Float64Array]) -> MotionByBody1:
    """Return a copy of a MotionByBody1, which must have second derivatives, with errors added. `errors` is a dict of
    arrays: (N, 3) by R1, v1, a1, S1 (rotation vectors), omega1 and alpha1, and (N,) by psi, psid and psidd.
    """
    moved = {
        letter: np.asarray(getattr(motion.body1, letter)) + errors[f"{letter}1"]
        for letter in ("R", "v", "a", "omega", "alpha")
    }
    moved["S"] = rotation_exp(errors["S1"]) @ np.asarray(motion.body1.S)
    hinge = tuple(angle + errors[name] for angle, name in zip(motion.hinge, HINGE_NAMES, strict=True))
    return MotionByBody1(BodyMotion(**moved), hinge)


class LogNoise:
    """Estimator of the noise in the samples of a log.

    Args:
        t: instants; shape (N,) s.
        derived: names of the derivatives that were found by finite differences.
        order: order of the error of these differences.

    Attributes:
        sizes: standard deviation of the noise by name: of each sampled quantity (the largest of its components; of S1
            an angle [rad]), and of psidd away from the ends. Quantities without noise are left out.
    """

    def __init__(self, t: Float64Array, derived: tuple[str, ...], order: int) -> None:
        self.sizes: dict[str, float] = {}
        self._t, self._derived, self._order = t, derived, order
        self._rng = np.random.default_rng(0)

    def with_noise_added(self, motion: KnownMotion) -> KnownMotion:
        """Return a copy of a KnownMotion, which must have second derivatives, with random noise added to all
        quantities. The size of the noise is estimated from the motion itself and stored in the attribute `sizes`.
        """
        return (
            self._add_to_coordinates(motion)
            if isinstance(motion, MotionByCoordinates)
            else self._add_to_body1(motion)
        )

    def column_with_noise_added(self, names: tuple[str, ...], values: tuple[Float64Array, ...]) -> list[Float64Array]:
        """Return a coordinate and its first and second derivative with random noise added, a list of arrays (N,).
        `values` are the three arrays and `names` their names. The size of the noise is estimated from `values` and
        stored in the attribute `sizes`.
        """
        noise = self._draw_noise(names, [column[:, None] for column in values])
        return [column + added[:, 0] for column, added in zip(values, noise, strict=True)]

    def _add_to_coordinates(self, motion: MotionByCoordinates) -> MotionByCoordinates:
        """Return a copy of a MotionByCoordinates in space, which must have second derivatives, with random noise of
        the estimated size added to all coordinates and derivatives.
        """
        columns = []
        for names, *derivatives in zip(
            zip(*LOG_COLUMNS_OF[SPATIAL_COORDINATE_NAMES].values(), strict=True),
            *motion.derivatives,
            strict=True,
        ):
            values = [np.broadcast_to(np.asarray(value, np.float64), self._t.shape)[:, None] for value in derivatives]
            columns.append(
                [
                    value + noise[:, 0]
                    for value, noise in zip(derivatives, self._draw_noise(names, values), strict=True)
                ]
            )
        return MotionByCoordinates(motion.count, tuple(zip(*columns, strict=True)), motion.sequence)

    def _add_to_body1(self, motion: MotionByBody1) -> MotionByBody1:
        """Return a copy of a MotionByBody1 with random noise of the estimated size added to the motion of body 1, to
        psi and to their derivatives.
        """
        errors: dict[str, Float64Array] = {}
        hinge = self._draw_noise(HINGE_NAMES, [angle[:, None] for angle in motion.hinge])
        errors |= {name: noise[:, 0] for name, noise in zip(HINGE_NAMES, hinge, strict=True)}
        for letters in (("R", "v", "a"), ("S", "omega", "alpha")):
            names = tuple(f"{letter}1" for letter in letters)
            values = [np.asarray(getattr(motion.body1, letter)) for letter in letters]
            errors |= dict(zip(names, self._draw_noise(names, values), strict=True))
        return motion_with_errors(motion, errors)

    def _draw_noise(self, names: tuple[str, ...], values: list[Float64Array]) -> list[Float64Array]:
        """Return noise (N, k) for a quantity and two derivatives, random and of the size of theirs; that of a derived
        one is the derivative of the noise before. Keep the sizes.
        """
        noise: list[Float64Array] = []
        slopes: list[Float64Array] = []
        for name, samples in zip(names, values, strict=True):
            if slopes and not {name, name.partition("_")[0]}.isdisjoint(self._derived):
                noise.append(slopes.pop(0))
                continue
            residuals = local_fit_residuals(self._t, samples, _rotation_vectors_from if name == "S1" else None)
            finite = np.isfinite(residuals).all(axis=1)
            deviations = (
                np.sqrt(np.mean(residuals[finite] ** 2, axis=0)) if finite.any() else np.zeros(samples.shape[1])
            )
            noise.append(deviations * self._rng.standard_normal((len(self._t), len(deviations))))
            self._keep(name, float(deviations.max()))
            pairs = [differentiate(self._t, column, self._order) for column in noise[-1].T]
            slopes = [np.stack(columns, axis=-1) for columns in zip(*pairs, strict=True)]
        if names[-1] == "psidd":
            half = self._order // 2
            self._keep("psidd", float(np.sqrt(np.mean(noise[-1][half:-half] ** 2))))
        return noise

    def _keep(self, name: str, size: float) -> None:
        """Store the standard deviation of the noise of a quantity in the attribute `sizes`, unless it is 0."""
        if size:
            self.sizes[name] = size


def derivative_noise(t: Float64Array, samples: Float64Array, order: int) -> tuple[float, float]:
    """Return (first, second): the standard deviations of the noise in the first and second derivative of `samples` at
    the instants t. The derivatives are finite differences whose error is of the given order. Both deviations are 0 if
    the noise of the samples is no more than rounding, or if there are too few samples to tell. For columns (N, k) a
    deviation is the rms over all columns; for rotations (N, 3, 3) it is the deviation of angles [rad].
    """
    rows = noise_rows(t.size)
    t, samples = t[rows] - t[rows.start], samples[rows]
    residuals = local_fit_residuals(t, samples, _rotation_vectors_from if samples.ndim == 3 else None)
    if not residuals.size:
        return 0.0, 0.0
    size = float(np.sqrt(np.mean(residuals**2)))
    max_rounding = 1e-12 * float(np.abs(samples).max())
    if size <= max_rounding:
        return 0.0, 0.0
    _, _, *weights = next(stencils(t, order))
    first, second = (float(np.sqrt(np.median((one**2).sum(axis=1)))) for one in weights)
    return size * first, size * second


def _rotation_vectors_from(S: Float64Array, reference: Float64Array) -> Float64Array:
    """Return the rotation vectors [rad], in world axes, that turn `reference` into S; shape (..., 3)."""
    return rotation_vector(S @ np.swapaxes(reference, -1, -2))
