"""An encoder beside the poses: the angle that both tell, and findings on readings that do not follow the hinge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.measured.findings import RANDOM_CORRELATION, Finding
from hingepair.measured.hinge import Hinge
from hingepair.measured.least_squares import neighbour_correlation, score_scatter
from hingepair.measured.likelihood import (
    EncoderLine,
    HingeResiduals,
    Noise,
    attitude_noise_share,
    iterate_residuals,
)
from hingepair.measured.relative_poses import RelativePoses
from hingepair.measured.robust import OUTLIER, median_variance
from hingepair.numeric.arrays import Float64Array
from hingepair.tables.sheets import percent


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EncoderFit:
    """The fitted line psi = zero + scale * reading of an encoder.

    Attributes:
        zero: hinge angle psi at which the encoder reads 0, in [-pi, pi] [rad].
        scale: change of psi per unit of the reading [rad per unit].
        noise: standard deviation of a reading, as a hinge angle [rad]; inaccurate if it is smaller than the noise of
            the attitudes, `HingeFit.noise_angle`.
        std: standard deviations of "zero" [rad] and "scale" [rad per unit].
    """

    zero: float
    scale: float
    noise: float
    std: Mapping[str, np.float64]


class Fused(NamedTuple):
    """Angles from poses and readings; arrays (N,)."""

    psi: Float64Array
    is_rejected: NDArray[np.bool_]  # whether the reading was left out
    share: Float64Array | float  # weight of the reading in psi, 0 to 1; the rest is that of the pose


def fuse(
    poses: RelativePoses, hinge: Hinge, noise: Noise, residuals: HingeResiduals, line: EncoderLine | None
) -> Fused:
    """Return the hinge angles that poses and readings tell together. Where they contradict each other, the pose
    counts alone, or the reading if the pose is an outlier.
    """
    if line is None or poses.encoder is None:
        return Fused(residuals.psi, np.zeros(poses.samples, dtype=bool), 0.0)
    turn, is_read = residuals.turn, np.isfinite(poses.encoder)
    variance = max(median_variance(turn[is_read] ** 2, 1), 1e-24)
    is_rejected = is_read & (turn**2 > 25.0 * variance)  # five standard deviations
    share = np.where(is_read, attitude_noise_share(poses, noise, line), 0.0)
    if is_rejected.any():
        seen = iterate_residuals(poses._replace(encoder=None), hinge)
        squares = np.concatenate([each.whitened_squares(noise) for _, each in seen])
        is_wrong_pose = is_rejected & (squares > OUTLIER * median_variance(squares, 5))
        share[is_rejected], is_rejected = 0.0, is_rejected & ~is_wrong_pose
        share[is_wrong_pose] = 1.0
    return Fused(residuals.psi - share * turn, is_rejected, share)


def encoder_findings(
    psi: Float64Array,
    residuals: HingeResiduals,
    poses: RelativePoses,
    noise: Noise,
    is_rejected: NDArray[np.bool_],
    line: EncoderFit | None,
    t: Float64Array | None,
) -> list[Finding]:
    """Return findings on an encoder: outliers, readings that do not follow the hinge, are late, or off not at random.
    `psi` (N,) are angles without jumps.
    """
    if poses.encoder is None or line is None:
        return []
    good = np.isfinite(poses.encoder) & ~is_rejected & (residuals.weights > 0)
    findings = []
    if is_rejected.any():
        share = percent(is_rejected.sum() / np.isfinite(poses.encoder).sum())
        findings.append(
            Finding(f"{share} of the encoder's readings are outliers; psi leaves them out.", harmless=True)
        )
    turn, angle = residuals.turn[good], psi[good]
    scatter, rms = float(np.std(angle)), float(np.sqrt(np.mean(turn**2)))
    size = f"it is off by {rms:.2g} rad rms, and the hinge turns by {scatter:.2g} rad rms"
    if np.sqrt(noise.encoder) > 0.3 * scatter or line.std["scale"] > 0.1 * abs(line.scale):
        return [Finding(f"The encoder hardly follows the hinge: {size}."), *findings]
    # Psi' times the delay is what a late reading leaves.
    x = np.arange(poses.samples, dtype=np.float64)[good] if t is None else t[good]
    rate = np.gradient(angle, x) if x.size > 2 else np.zeros_like(angle)
    power = max(float(rate @ rate), 1e-300)
    delay = float(rate @ turn) / power
    scatter_of_scores, _ = score_scatter((rate * (turn - delay * rate))[None])
    std = float(np.sqrt(scatter_of_scores[0, 0])) / power
    if abs(delay) > 4.0 * std and abs(delay) * np.sqrt(power / angle.size) > max(0.2 * rms, 1e-12):
        how = f"{abs(delay):.2g} samples" if t is None else f"{1e3 * abs(delay):.3g} ms"
        word = "late" if delay > 0 else "early"
        return [Finding(f"The encoder is read {how} {word}: {size}."), *findings]
    if neighbour_correlation(turn) > RANDOM_CORRELATION and rms > max(0.03 * scatter, 1e-9):
        text = f"The encoder is off the hinge angle, and not at random: {size}."
        findings.append(Finding(text, harmless=rms < 0.1 * scatter))
    return findings
