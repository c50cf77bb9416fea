"""Findings: sentences on what the numbers of a fitted hinge do not say, such as what the motion did not show."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import FitError
from hingepair.measured.hinge import Hinge
from hingepair.measured.likelihood import CHI2_MEDIAN_BY_DOF, HingeResiduals, Noise, iterate_residuals
from hingepair.measured.relative_poses import RelativePoses, closed_form_hinge, compute_relative_poses
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.tables import percent
from hingepair.rotations.matrices import (
    matrix_to_quaternion,
    project_to_rotation,
    quaternion_to_matrix,
    rotation_vector,
)

# Samples that tell whether the bodies turn, and what other joint they have.
_MAX_THINNED_SAMPLES_FOR_JOINT_TYPE = 2048
_MAX_THINNED_SAMPLES_FOR_FINDINGS = 65536  # samples that findings are made of
# [rad]: below, noise and motion cannot be told apart by the scatter of relative attitudes.
_MIN_ATTITUDE_SCATTER_OF_TURNING_BODIES_IN_RADIANS = 0.05
# Of relative attitudes; counts where both scatters are small.
_MIN_ATTITUDE_SCATTER_ABOUT_FIRST_TO_SECOND_PRINCIPAL_AXIS = 2.0
MAX_NEIGHBOUR_CORRELATION_OF_RANDOM_RESIDUALS = 0.5  # of neighbouring samples; above, residuals are not noise
# Of r^T C^-1 r, scaled so that its median is that of noise, from which a sample is an outlier.
MIN_OUTLIER_WHITENED_SQUARED_RESIDUAL = 50.0
_MAX_THINNED_SAMPLES_PER_RECORDING_MISTAKE_TRIAL = 400  # samples that mistakes are tried with
_MAX_HINGE_MISFIT_OF_CORRECTED_TO_RECORDED_POSES = 0.2
"""`BodyPoses.misfit` after the correction of a probable mistake, divided by the misfit before."""
_MAX_HINGE_MISFIT_OF_CORRECTED_POSES = 0.1
"""`BodyPoses.misfit` after the correction of a probable mistake."""
# Motion of the hinge point that is not random: a hinge is still reported below this.
_MAX_HARMLESS_HINGE_POINT_MOTION_TO_LEVER_LENGTH = 0.02
# [rad]: an axis that is known less well is not to be relied on.
MAX_RELIABLE_HINGE_AXIS_STD_IN_RADIANS = np.radians(2.0)
MAX_RELIABLE_HINGE_POINT_STD_TO_LEVER_LENGTH = 0.1  # likewise of the hinge point


class Finding(NamedTuple):
    """One sentence of a report on a fit (`text`), and whether the hinge is reliable in spite of it (`harmless`).

    A harmless one says how large something is; any other says why the hinge is not reliable.
    """

    text: str
    harmless: bool  # whether the hinge can be relied on in spite of it


def check_turning(poses: RelativePoses) -> None:
    """Raise FitError if body 2 does not rotate relative to body 1, or no more than by noise. `poses` are
    RelativePoses. The error's message says whether the bodies slide or are fixed.
    """
    thin = poses.thinned(_MAX_THINNED_SAMPLES_FOR_JOINT_TYPE)
    Q = thin.Q.T.reshape(-1, 3, 3)
    mean = np.median(Q, axis=0)
    if np.linalg.det(mean) < 0.1:
        return
    off = rotation_vector(np.asarray(project_to_rotation(mean), dtype=np.float64).T @ Q)
    size = np.sqrt((off * off).sum(axis=-1))
    near = off[size <= 4 * np.median(size)]
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(near.T @ near / near.shape[0]), 0.0))[::-1]
    if spread[0] >= _MIN_ATTITUDE_SCATTER_OF_TURNING_BODIES_IN_RADIANS or (
        spread[0] >= _MIN_ATTITUDE_SCATTER_ABOUT_FIRST_TO_SECOND_PRINCIPAL_AXIS * spread[1] and spread[0] > 1e-12
    ):
        return
    p = thin.p
    slide = float(np.sqrt(np.median(((p - np.median(p, axis=1, keepdims=True)) ** 2).sum(axis=0))))
    beside = f", and it slides by {slide:.2g} m: a sliding joint" if slide > 20 * spread[0] * _rms_distance(p) else ""
    about = " about any axis" if beside else ", about one axis no more than about others: a fixed pair"
    raise FitError(
        "body1, body2",
        "bodies that turn against each other about one axis",
        f"relative attitudes that scatter by {np.degrees(spread[0]):.2g} deg{about}{beside}",
    )


def judge_hinge(
    poses: RelativePoses,
    hinge: Hinge,
    noise: Noise,
    residuals: HingeResiduals,
    is_outlier: NDArray[np.bool_],
    has_converged: bool,
    std: dict[str, Float64Array],
) -> list[Finding]:
    """Return a list of Finding objects on a fitted Hinge, its Noise and its HingeResiduals: outliers (marked by
    `is_outlier`), a tilting axis, a moving hinge point, large standard deviations (`std`, a dict with the keys n, u1
    and u2), steps that did not converge, and correlated residuals. Findings that make the hinge unreliable come
    first; after serious outliers or a serious tilt, further checks are left out.
    """
    every = slice(None, None, -(-poses.samples // _MAX_THINNED_SAMPLES_FOR_FINDINGS))
    residuals = residuals._replace(
        **{
            name: getattr(residuals, name)[..., every]
            for name in ("tilt", "gap", "psi", "whitened_squares", "weights")
        }
    )
    poses, is_outlier = poses.thinned(_MAX_THINNED_SAMPLES_FOR_FINDINGS), is_outlier[every]
    turning = _angle_scatter(residuals.psi, residuals.weights / residuals.weights.sum())
    lever_length = max(float(np.linalg.norm(hinge.u1)), float(np.linalg.norm(hinge.u2)), _rms_distance(poses.p))
    outliers = _outlier_findings(residuals, is_outlier)
    if any(not finding.harmless for finding in outliers):
        return outliers  # whatever else is seen is theirs
    axis_findings = _axis_findings(poses, residuals, turning)
    if any(not finding.harmless for finding in axis_findings):
        return [*outliers, *axis_findings]
    listed = [*outliers, *axis_findings, *_point_findings(poses, noise, residuals, lever_length)]
    worst = float(np.sqrt((std["n"] ** 2).sum() / 2))
    if worst > MAX_RELIABLE_HINGE_AXIS_STD_IN_RADIANS:
        text = f"The axis is known to {np.degrees(worst):.2g} deg only: let the bodies turn further, or longer."
        listed.append(Finding(text, False))
    vague = max(float(std["u1"].max()), float(std["u2"].max()))
    if vague > MAX_RELIABLE_HINGE_POINT_STD_TO_LEVER_LENGTH * lever_length:
        listed.append(Finding(f"The hinge point is known to {vague:.2g} m only, across the axis.", False))
    if not has_converged:
        listed.append(Finding("The steps of the fit did not come to rest.", False))
    if residuals.unresolved_lag and not _residuals_are_rounding(residuals, poses, np.ones_like(is_outlier)):
        text = (
            f"What is left of the samples is correlated over {residuals.unresolved_lag} samples and more, too long "
            "relative to the whole recording: the standard deviations are too small."
        )
        listed.append(Finding(text, True))
    return sorted(listed, key=lambda finding: finding.harmless)  # what decides the verdict comes first


def split_findings(random: Float64Array, whole: Float64Array, how: str) -> list[Finding]:
    """Return a list with one Finding if the covariance (12, 12) of the results, `whole`, is far larger than that by
    the noise alone, `random`, because it is not known to which body the noise of the attitudes belongs. `how` ends
    the sentence.
    """
    added = np.sqrt(np.maximum(np.diagonal(whole - random), 0.0))[:6]
    if not (added > np.maximum(0.5 * np.sqrt(np.diagonal(random))[:6], 1e-12)).any():
        return []
    return [Finding(f"u1 and u2 depend by {added.max():.2g} m on how the noise of the attitudes {how}.", True)]


def find_outliers(residuals: HingeResiduals, poses: RelativePoses) -> NDArray[np.bool_]:
    """Return a boolean array (N,) that marks outliers, samples of the relative poses whose HingeResiduals are far
    larger than the residuals of most samples. No sample is marked if residuals of neighbouring samples are
    correlated, or if rounding explains the large residuals.
    """
    is_outlier = _scaled_whitened_squares(residuals) > MIN_OUTLIER_WHITENED_SQUARED_RESIDUAL
    if (
        not is_outlier.any()
        or max(residuals.neighbour_correlations) > MAX_NEIGHBOUR_CORRELATION_OF_RANDOM_RESIDUALS
        or _residuals_are_rounding(residuals, poses, is_outlier)
    ):
        return np.zeros_like(is_outlier)
    return is_outlier


def _scaled_whitened_squares(residuals: HingeResiduals) -> Float64Array:
    """Return the whitened squared residual of each sample (N,) from HingeResiduals, scaled so that the median over
    the samples is the median of chi-squared with 5 degrees of freedom.
    """
    return (
        residuals.whitened_squares / max(float(np.median(residuals.whitened_squares)), 1e-300) * CHI2_MEDIAN_BY_DOF[5]
    )


def _residuals_are_rounding(residuals: HingeResiduals, poses: RelativePoses, samples: NDArray[np.bool_]) -> bool:
    """Return whether rounding explains the residuals of the samples that the boolean array `samples` marks."""
    largest = max(np.abs(residuals.gap[:, samples]).max() / poses.size, residuals.tilt[samples].max())
    return bool(largest < 1e-12)


def _outlier_findings(residuals: HingeResiduals, is_outlier: NDArray[np.bool_]) -> list[Finding]:
    """Return a list with one Finding on the share of outliers, which the boolean array `is_outlier` marks, and on
    whether the weights of the outliers in the HingeResiduals `residuals` are reduced. The list is empty if there are
    no outliers.
    """
    if not is_outlier.any():
        return []
    share = f"{percent(is_outlier.mean())} of the samples are outliers"
    if float(residuals.weights[is_outlier].sum()) < 0.5 * is_outlier.sum():
        return [Finding(f"{share}; they count little.", True)]
    harmless = bool(residuals.whitened_squares[is_outlier].sum() < residuals.whitened_squares[~is_outlier].sum())
    return [Finding(f'{share}, and count like the others: loss="cauchy" makes them count little.', harmless)]


def _axis_findings(poses: RelativePoses, residuals: HingeResiduals, turning: float) -> list[Finding]:
    """Return a list with at most one Finding on the tilt between the hinge axes of both bodies. The Finding says
    which joint the motion shows if it is not a hinge, that the bodies turn too little relative to the noise of the
    attitudes, or that the axes tilt slightly and not at random. The list is empty if the tilt is negligible.
    `residuals` are the HingeResiduals, and `turning` is the rms scatter of the hinge angle [rad].
    """
    weights = residuals.weights / residuals.weights.sum()
    tilt = float(np.sqrt(weights @ (residuals.tilt * residuals.tilt)))
    degrees = f"{np.degrees(tilt):.2g} deg rms"
    is_systematic = residuals.neighbour_correlations[0] > MAX_NEIGHBOUR_CORRELATION_OF_RANDOM_RESIDUALS
    if tilt < 0.03 * turning or tilt < 1e-9:
        return []
    if not is_systematic and tilt < 0.2:
        if tilt < 0.2 * turning:
            return []
        text = f"They turn by {np.degrees(turning):.2g} deg rms, little relative to attitude errors of {degrees}."
        return [Finding(text, False)]
    if tilt < 0.1 * turning:
        share = f"{percent(tilt / turning)} of the turning, and not at random"
        return [Finding(f"The axes tilt against each other by {degrees}, {share}: n is their mean.", True)]
    return [Finding(_other_joint_sentence(poses, tilt, degrees), False)]


def _other_joint_sentence(poses: RelativePoses, tilt: float, tilt_text: str) -> str:
    """Return a string of one or two sentences that say which joint the relative poses show instead of a hinge: two
    hinges in series, a ball joint, or neither. `tilt` [rad] is the rms tilt between the axes, and the string
    `tilt_text` states it in degrees.
    """
    thin = poses.thinned(_MAX_THINNED_SAMPLES_FOR_JOINT_TYPE)
    vectors = np.linalg.eigh(np.cov(thin.Q))
    left, sizes, right = np.linalg.svd(vectors.eigenvectors[:, 0].reshape(3, 3))
    axes_residual = float(np.sqrt(max(vectors.eigenvalues[0], 0.0)))
    no_hinge = f"They do not turn about one axis: it tilts by {tilt_text}"
    if axes_residual < 0.2 * tilt and sizes[1] < 0.3:
        a, b = (", ".join(f"{c:.3g}" for c in axis) for axis in (left[:, 0], right[0]))
        return (
            f"{no_hinge}. Two hinges one after the other would do, about ({a}) in body 1 and ({b}) in body 2: "
            f"that leaves {np.degrees(axes_residual):.2g} deg."
        )
    off = _common_point_distance(thin)
    if off < 0.1 * _rms_distance(thin.p):
        return f"{no_hinge}. A ball joint: one point stays in both bodies to {off:.2g} m rms."
    return f"{no_hinge}, and no point stays in both bodies either."


def _common_point_distance(poses: RelativePoses) -> float:
    """Return the rms distance [m], over relative poses, between a point fixed in body 1 and a point fixed in body 2,
    for the two points that stay closest to each other.
    """
    Q = poses.Q.T.reshape(-1, 3, 3)
    rows = np.concatenate((np.broadcast_to(np.eye(3), Q.shape), -Q), axis=-1).reshape(-1, 6)
    p = poses.p.T.ravel()
    gaps = rows @ np.linalg.lstsq(rows, p)[0] - p
    return float(np.sqrt(3 * (gaps @ gaps) / gaps.size))


def _point_findings(
    poses: RelativePoses, noise: Noise, residuals: HingeResiduals, lever_length: float
) -> list[Finding]:
    """Return a list with at most one Finding on the motion of the hinge point in the bodies, such as sliding along
    the axis, small play, or large noise. The list is empty if the point stays fixed in both bodies. `residuals` are
    the HingeResiduals, and `lever_length` [m] is the length with which the motion is compared.
    """
    weights = residuals.weights / residuals.weights.sum()
    x, y, z = (float(weights @ (g * g)) for g in residuals.gap)
    across, along = (x + y) / 2, z
    attitude = noise.attitude / 2 * float(weights @ (poses.p**2).sum(axis=0)) / 3
    size = float(np.sqrt(2 * across + along))
    is_systematic = residuals.neighbour_correlations[1] > MAX_NEIGHBOUR_CORRELATION_OF_RANDOM_RESIDUALS
    if size < max(1e-9 * poses.size, 0.005 * lever_length) or not (is_systematic or size > 0.1 * lever_length):
        return []
    if along > 9 * across:
        kind = _PointMotion(
            float(np.sqrt(along)),
            "Body 2 slides along the axis, by {size:.2g} m rms: a sliding hinge, or a screw.",
            "Body 2 moves along the axis by {size:.2g} m rms",
        )
    elif across - along > 4 * (along + attitude):
        kind = _PointMotion(
            float(np.sqrt(2 * across)),
            "They turn about one direction, but no point stays: it is off by {size:.2g} m rms across the axis. Two "
            "parallel hinges one after the other, or an axis that wanders.",
            "The axis moves sideways by {size:.2g} m rms",
        )
    elif is_systematic:
        kind = _PointMotion(
            size,
            "No hinge point stays in both bodies: it is off by {size:.2g} m rms, and not at random.",
            "The hinge point moves by {size:.2g} m rms",
        )
    else:
        text = f"The hinge point is off by {size:.2g} m rms at random: noise that is large relative to the levers."
        return [Finding(text, False)]
    if size >= _MAX_HARMLESS_HINGE_POINT_MOTION_TO_LEVER_LENGTH * lever_length:
        return [Finding(kind.no_hinge.format(size=kind.size), False)]
    share = f"{percent(kind.size / lever_length)} of the levers, and not at random"
    return [Finding(f"{kind.play.format(size=kind.size)}, {share}: u1 and u2 name its mean place.", True)]


class _PointMotion(NamedTuple):
    """Size of the hinge point's motion relative to the bodies [m], and two templates of sentences with a field
    `{size}` that report the motion: `no_hinge` if the motion is too large for a hinge, and `play` if it is small.
    """

    size: float  # rms [m]
    no_hinge: str  # where the gap is too large for a hinge
    play: str  # where the gap is small relative to the lever lengths


def _angle_scatter(psi: Float64Array, weights: Float64Array) -> float:
    """Return the rms scatter [rad] of angles psi (N,) about their circular mean, or 1 if the scatter is larger. The
    angles are weighted by `weights` (N,), whose sum is 1.
    """
    mean = np.hypot(weights @ np.cos(psi), weights @ np.sin(psi))
    about = np.arctan2(weights @ np.sin(psi), weights @ np.cos(psi))
    off = np.abs(2 * np.sin((psi - about) / 2))
    return float(min(np.sqrt(weights @ (off * off)), 1.0)) if mean < 1 else 0.0


def _rms_distance(p: Float64Array) -> float:
    """Return the rms length of vectors p (3, N)."""
    return float(np.sqrt((p * p).sum() / max(p.shape[1], 1)))


class BodyPoses(NamedTuple):
    """Positions R1 and R2 (N, 3) and rotation matrices S1 and S2 (N, 3, 3) of both bodies at all samples, as the user
    gave them.
    """

    R1: NDArray[np.floating]  # shape (N, 3)
    S1: NDArray[np.floating]  # shape (N, 3, 3)
    R2: NDArray[np.floating]
    S2: NDArray[np.floating]

    def changed(self, bodies: str, letter: str, change: Callable[..., Any]) -> BodyPoses:
        """Return the poses with the array R or S (`letter`) of the bodies "1", "2" or "12" replaced. `change` is a
        function that returns the new array from the old one.
        """
        return self._replace(**{f"{letter}{digit}": change(getattr(self, f"{letter}{digit}")) for digit in bodies})

    def misfit(self) -> float:
        """Return how badly the closed-form hinge fits the poses, as one number: the median tilt of the axes [rad]
        plus the ratio of the median gap at the hinge point to the rms distance between the bodies.
        """
        poses = compute_relative_poses(*self)
        distance = _rms_distance(poses.p)
        _, seen = next(iterate_residuals(poses, closed_form_hinge(poses)))
        tilt, gap = (np.sqrt(np.median((part**2).sum(axis=0))) for part in (seen.tilt, seen.gap))
        return float(tilt + gap / max(distance, 1e-300))


def probable_mistakes(body_poses: BodyPoses) -> list[str]:
    """Return a list with one sentence on a mistake in recorded poses, such as a wrong unit, exchanged axes,
    transposed rotations or reordered quaternions, if a hinge fits far better with the mistake corrected. The list is
    empty if no mistake is likely. `body_poses` are the BodyPoses as recorded.
    """
    every = slice(None, None, -(-body_poses.R1.shape[0] // _MAX_THINNED_SAMPLES_PER_RECORDING_MISTAKE_TRIAL))
    poses = BodyPoses(*(array[every].astype(np.float64) for array in body_poses))
    misfit = poses.misfit()
    corrected_misfits = [(changed.misfit(), text) for text, changed in _corrected_poses(poses)]
    least_misfit, text = min(corrected_misfits)
    if (
        least_misfit > _MAX_HINGE_MISFIT_OF_CORRECTED_TO_RECORDED_POSES * misfit
        or least_misfit > _MAX_HINGE_MISFIT_OF_CORRECTED_POSES
    ):
        return []
    return [f"{text}: with that taken back, a hinge fits {misfit / max(least_misfit, 1e-12):.2g} times as well."]


def _corrected_poses(poses: BodyPoses) -> Iterator[tuple[str, BodyPoses]]:
    """Yield a pair for each common mistake in recorded poses: a string that describes the mistake, and the BodyPoses
    with the mistake corrected.
    """
    for digit in "12":
        name = f"body{digit}"
        for unit, factor in (("millimetres", 1e-3), ("centimetres", 1e-2)):
            yield f"{name}.R looks like {unit}", poses.changed(digit, "R", functools.partial(np.multiply, factor))
        for pair, order in (("y and z", [0, 2, 1]), ("x and y", [1, 0, 2]), ("x and z", [2, 1, 0])):
            swap = functools.partial(np.take, indices=order, axis=1)
            yield f"{name}.R looks as if {pair} were exchanged", poses.changed(digit, "R", swap)
        for up, other, sign in (("y", "z", 1.0), ("z", "y", -1.0)):
            turn = np.array(((1.0, 0, 0), (0, 0, -sign), (0, sign, 0)))
            turned = poses.changed(digit, "S", functools.partial(np.matmul, turn))
            yield (
                f"{name} looks as if {up} were up in its world and {other} in that of the other body",
                turned.changed(digit, "R", functools.partial(np.einsum, "ij,nj->ni", turn)),
            )
    for bodies in ("1", "2", "12"):
        names, look = " and ".join(f"body{digit}.S" for digit in bodies), "looks" if len(bodies) == 1 else "look"
        turned = poses.changed(bodies, "S", lambda S: np.swapaxes(S, -1, -2))
        yield f"{names} {look} like rotations from world to body, the transposes", turned
        for written, read in (("wxyz", "xyzw"), ("xyzw", "wxyz")):
            yield (
                f"{names} {look} like quaternions {written} that were read as {read}",
                poses.changed(
                    bodies, "S", functools.partial(_with_reordered_quaternions, scalar_first=written == "wxyz")
                ),
            )


def _with_reordered_quaternions(S: Float64Array, scalar_first: bool) -> Float64Array:
    """Return rotation matrices S (N, 3, 3) corrected for quaternions that were read in the wrong order of components.
    If `scalar_first`, the quaternions were written scalar first and read scalar last; otherwise the reverse.
    """
    read = matrix_to_quaternion(S)  # w, x, y, z
    written = np.roll(read, -1, axis=-1) if scalar_first else read
    return np.asarray(quaternion_to_matrix("quat", written, scalar_first=scalar_first), dtype=np.float64)
