"""An encoder beside the poses: the angle that both tell, and findings on readings that do not follow the hinge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.measured.findings import (
    MAX_NEIGHBOUR_CORRELATION_OF_RANDOM_RESIDUALS,
    MIN_OUTLIER_WHITENED_SQUARED_RESIDUAL,
    Finding,
)
from hingepair.measured.hinge import Hinge
from hingepair.measured.likelihood import (
    CHI2_MEDIAN_BY_DOF,
    EncoderLine,
    HingeResiduals,
    Noise,
    attitude_noise_share,
    iterate_residuals,
    score_scatter,
)
from hingepair.measured.relative_poses import RelativePoses
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.tables import percent

_MIN_OUTLIER_READING = 5.0  # in standard deviations of what is left
_MAX_NOISE = 0.3  # of an encoder, in parts of the scatter of psi
_MAX_SCALE_STD = 0.1  # in parts of the scale
_MIN_DELAY_IN_STDS = 4.0
_MIN_DELAY_EFFECT = 0.2  # of a delay on the residuals, in parts of their rms
_MAX_SYSTEMATIC = 0.1, 0.03  # residuals not at random, in parts of the scatter of psi: reliable, not mentioned


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EncoderFit:
    """The fitted relation between the hinge angle and the reading of an encoder, psi = zero + scale * reading, with
    the noise of the encoder and the standard deviations of zero and scale.

    Attributes:
        zero: hinge angle psi at which the encoder reads 0, in [-pi, pi] [rad].
        scale: change of psi per unit of the reading [rad per unit]. It is close to 1 for an encoder in radians whose
            reading grows with psi, and close to -1 for one whose reading falls as psi grows.
        noise: standard deviation of the encoder's measurement noise, converted to a hinge angle [rad]. It is
            inaccurate if it is smaller than the noise of the attitudes, `HingeFit.noise_angle`.
        std: dict of standard deviations with the keys "zero" [rad] and "scale" [rad per unit].
    """

    zero: float
    scale: float
    noise: float
    std: Mapping[str, np.float64]


class Fused(NamedTuple):
    """Angles psi (N,) from poses and readings, and which readings were left out, (N,)."""

    psi: Float64Array
    is_rejected: NDArray[np.bool_]


def fuse(
    poses: RelativePoses, hinge: Hinge, noise: Noise, residuals: HingeResiduals, line: EncoderLine | None
) -> Fused:
    """Return the hinge angles that poses and readings tell together. Where they contradict each other, the pose
    counts alone, or the reading if the pose is an outlier.
    """
    if line is None or poses.encoder is None:
        return Fused(residuals.psi, np.zeros(poses.samples, dtype=bool))
    turn, is_read = residuals.turn, np.isfinite(poses.encoder)
    variance = max(float(np.median(turn[is_read] ** 2)) / CHI2_MEDIAN_BY_DOF[1], 1e-24)
    is_rejected = is_read & (turn**2 > _MIN_OUTLIER_READING**2 * variance)
    share = np.array(attitude_noise_share(poses, noise, line))
    if is_rejected.any():
        seen = iterate_residuals(poses._replace(encoder=None), hinge)
        squares = np.concatenate([each.whitened_squares(noise) for _, each in seen])
        limit = MIN_OUTLIER_WHITENED_SQUARED_RESIDUAL * float(np.median(squares)) / CHI2_MEDIAN_BY_DOF[5]
        is_wrong_pose = is_rejected & (squares > limit)
        share[is_rejected], is_rejected = 0.0, is_rejected & ~is_wrong_pose
        share[is_wrong_pose] = 1.0
    return Fused(residuals.psi - share * turn, is_rejected)


def encoder_findings(
    psi: Float64Array,
    residuals: HingeResiduals,
    poses: RelativePoses,
    noise: Noise,
    is_rejected: NDArray[np.bool_],
    line: EncoderFit | None,
    t: Float64Array | None,
) -> list[Finding]:
    """Return a list of findings on an encoder: outliers, readings that do not follow the hinge, that are late, or
    that are off in a systematic way. `psi` (N,) are angles without jumps, `t` (N,) instants [s] or None.
    """
    if poses.encoder is None or line is None:
        return []
    good = np.isfinite(poses.encoder) & ~is_rejected & (residuals.weights > 0)
    findings = []
    if is_rejected.any():
        share = percent(is_rejected.sum() / np.isfinite(poses.encoder).sum())
        findings.append(Finding(f"{share} of the encoder's readings are outliers; psi leaves them out.", True))
    turn, angle = residuals.turn[good], psi[good]
    scatter, rms = float(np.std(angle)), float(np.sqrt(np.mean(turn**2)))
    size = f"it is off by {rms:.2g} rad rms, and the hinge turns by {scatter:.2g} rad rms"
    if np.sqrt(noise.encoder) > _MAX_NOISE * scatter or line.std["scale"] > _MAX_SCALE_STD * abs(line.scale):
        return [Finding(f"The encoder hardly follows the hinge: {size}.", False), *findings]
    # psi' times the delay is what a late reading leaves
    x = np.arange(poses.samples, dtype=np.float64)[good] if t is None else t[good]
    rate = np.gradient(angle, x) if x.size > 2 else np.zeros_like(angle)
    power = max(float(rate @ rate), 1e-300)
    delay = float(rate @ turn) / power
    scatter_of_scores, _ = score_scatter((rate * (turn - delay * rate))[None])
    std = float(np.sqrt(scatter_of_scores[0, 0])) / power
    if abs(delay) > _MIN_DELAY_IN_STDS * std and abs(delay) * np.sqrt(power / angle.size) > max(
        _MIN_DELAY_EFFECT * rms, 1e-12
    ):
        how = f"{abs(delay):.2g} samples" if t is None else f"{1e3 * abs(delay):.3g} ms"
        word = "late" if delay > 0 else "early"
        return [Finding(f"The encoder is read {how} {word}: {size}.", False), *findings]
    most, least = _MAX_SYSTEMATIC
    neighbours = float(turn[1:] @ turn[:-1]) / max(float(turn @ turn), 1e-300)
    if neighbours > MAX_NEIGHBOUR_CORRELATION_OF_RANDOM_RESIDUALS and rms > max(least * scatter, 1e-9):
        findings.append(
            Finding(f"The encoder is off the hinge angle, and not at random: {size}.", rms < most * scatter)
        )
    return findings
