"""Poses of a body from the markers of a rigid cluster on it (Kabsch), and findings on markers that do not fit.

Private functions take `places` (N, M, 3), the recorded positions [m] with any finite number where a marker is not
seen, `is_seen` (N, M), 1.0 or 0.0, and `cluster` (M, 3), the places of the markers on the body [m].
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, FitError, ShapeError
from hingepair.measured.findings import RANDOM_CORRELATION, Finding, Judged, exceeded
from hingepair.measured.statistics import OUTLIER, every_kth, neighbour_correlation, over_all
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_of_rotations
from hingepair.numeric.arrays import Float64Array, read_only, real_array
from hingepair.rotations.matrices import skew
from hingepair.tables.sheets import percent

_MIN_MARKERS = 3  # that a sample must show to have a pose
_MIN_WIDTH = 0.02  # of a cluster, in parts of its length; below, the markers are on a line, which shows no attitude
_MAX_SIZE = 10.0  # [m] of a cluster, in root mean square; more is probably in another unit
_JUDGED_SAMPLES = 1000  # that tell the usual distances between markers
_MAX_PLAY = 0.02  # of a marker, in parts of the size of the cluster, if it is not random
_MOST = 0.3  # of the samples whose markers are off their places; of more, it is not known which are right
_RELIABLE = np.radians(2.0)  # [rad]: attitudes that are known less well are not to be relied on
_ROUNDING = 1e-9  # of the size of the cluster; smaller distances from the places are rounding


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ClusterFit(Judged):
    """The result of `fit_cluster`: the motion of a body that carries a rigid cluster of markers.

    Attributes:
        body: the motion of the body, a BodyMotion of shape (N,) with R and S. Its reference point and axes are those
            of the coordinates in `reference`; if none was given, the mean of the places of all markers, and the world
            axes at the first of the samples that show the most markers. R and S are NaN where fewer than three
            markers are seen, or only markers on a line, and where markers are far off their places.
        std: standard deviations at every sample, by "R" [m] and by "S", those of the rotation vector of the error of
            the attitude [rad]; shape (N, 3), world axes, NaN where R and S are.
        reference: places of the markers on the body, from its reference point, in its axes [m]; shape (M, 3).
        residuals: distance of each marker from its place at each sample [m]; shape (N, M), NaN where the marker is
            not seen, and where too few are for a pose.
        rms: root mean square of each marker's residuals [m]; shape (M,); 0 for a marker that is never seen.
        noise: standard deviation of the noise in each coordinate of a marker's position [m], without samples that are
            far off.
        findings: sentences on which marker moved, was exchanged with another, and what else is wrong, as those of
            a HingeFit.
    """

    body: BodyMotion
    std: Mapping[str, Float64Array]
    reference: Float64Array
    residuals: Float64Array
    rms: Float64Array
    noise: float
    findings: tuple[Finding, ...]


def fit_cluster(markers: ArrayLike, reference: ArrayLike | None = None) -> ClusterFit:
    """Fit the poses of a body to the recorded positions of markers on it, by least squares (Kabsch's algorithm).

    Args:
        markers: positions of the markers in world axes [m], NaN or zeros where a marker is not seen; shape (N, M, 3).
            There must be three markers or more, not all on one line.
        reference: places of the markers on the body: the vectors from the body's reference point to the markers, in
            the body's axes [m]; shape (M, 3). If it is None, the places are fitted too.

    Returns:
        A ClusterFit. Its `.body` is a BodyMotion (N,) with R and S, which `fit` and `smooth` accept.

    Raises:
        FitError: no sample shows three markers that are not on one line; or `reference` is None and no sample shows
            all markers.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> places = np.array([(0.1, 0, 0), (-0.1, 0.05, 0), (0, -0.05, 0), (0, 0, 0.1)])
    >>> turn = hp.rodrigues((0, 0, 1), np.linspace(0, 1, 50))
    >>> fit = hp.fit_cluster(places @ np.swapaxes(turn, -1, -2))
    >>> fit.ok, bool(np.abs(fit.body.S - turn).max() < 1e-12)
    (True, True)
    """
    places = real_array("markers", markers).astype(np.float64)
    if places.ndim != 3 or places.shape[2] != 3 or places.shape[1] < _MIN_MARKERS:
        raise ShapeError("markers", "shape (N, M, 3) with three markers or more", f"shape {places.shape}")
    given = reference is not None
    cluster = (
        np.zeros(places.shape[1:]) if reference is None else real_array("reference", reference).astype(np.float64)
    )
    if cluster.shape != places.shape[1:] or not np.isfinite(cluster).all():
        raise ArgumentError("reference", f"finite numbers of shape {places.shape[1:]}", f"shape {cluster.shape}")
    zero = (places == 0).all(axis=-1)
    every_seen: NDArray[np.bool_] = np.isfinite(places).all(axis=-1) & ~(zero & ~zero.all(axis=0))
    places = np.where(every_seen[..., None], places, 0.0)
    is_used = _markers_determine_attitude(places, every_seen.astype(np.float64))
    if not is_used.any():
        raise FitError("markers", "samples with three markers that are not on a line", "none")
    places, is_seen = places[is_used], every_seen[is_used].astype(np.float64)
    if not given:
        cluster = _first_marker_places(places, is_seen)
    widths = np.linalg.svd(cluster - cluster.mean(axis=0), compute_uv=False)
    if widths[1] <= _MIN_WIDTH * widths[0]:  # the attitude about the line would not be determined
        raise FitError("markers", "markers that are not on a line", f"a cluster {widths[1]:.2g} m wide")
    size = float(np.linalg.norm(widths) / np.sqrt(len(cluster)))  # rms distance of the markers from their middle
    R, S, distances = _kabsch_poses(places, is_seen, cluster)
    good = ~_is_outlier(distances, is_seen, size)
    for _ in range(0 if given else 2):  # the places of the good samples, which may be others then
        cluster = _refined_places(places[good], is_seen[good], cluster)
        R, S, distances = _kabsch_poses(places, is_seen, cluster)
        good = ~_is_outlier(distances, is_seen, size)
    free = 3 * is_seen[good].sum() - 6 * good.sum() - (0 if given else 3 * cluster.shape[0] - 6)
    noise = float(np.sqrt((distances[good] ** 2).sum() / max(free, 1.0)))
    std_R, std_S = _deviations(S, is_seen, cluster, noise)
    off = is_seen[..., None] * (np.einsum("nji,nmj->nmi", S, places - R[:, None]) - cluster)  # body axes
    findings = [
        *_outlier_findings(is_seen, distances, good),
        *(_reference_findings(is_seen[good], distances[good], size) if given else []),
        *_moved_marker_findings(off[good], is_seen[good], size),
    ]
    unit = f"The markers are {size:.2g} m from their middle: are they in metres?"
    attitude = float(np.median(std_S[good].max(axis=1)))
    known = (
        f"The attitudes are known to {np.degrees(attitude):.2g} deg only: the markers are few, or nearly on a line."
    )
    findings += exceeded(Finding("unit", size, _MAX_SIZE, unit), Finding("attitude", attitude, _RELIABLE, known))

    def of_all(values: Float64Array) -> Float64Array:
        return over_all(values, is_used, is_used.size)

    for array in (R, S, std_R, std_S):
        array[~good] = np.nan
    return ClusterFit(
        body=motion_of_rotations(R=of_all(R), S=of_all(S)),
        std={"R": of_all(std_R), "S": of_all(std_S)},
        reference=read_only(cluster),
        residuals=of_all(np.where(is_seen > 0, distances, np.nan)),
        rms=read_only(np.sqrt((distances**2).sum(axis=0) / np.maximum(is_seen.sum(axis=0), 1.0))),
        noise=noise,
        findings=tuple(findings),
    )


def _is_outlier(distances: Float64Array, is_seen: Float64Array, size: float) -> NDArray[np.bool_]:
    """Return which samples (N,) have far larger residuals than most; `size` is that of the cluster [m]."""
    squares = (distances**2).sum(axis=1) / np.maximum(3 * is_seen.sum(axis=1) - 6, 1.0)
    typical = max(float(np.median(squares)), (_ROUNDING * size) ** 2)
    return np.asarray(squares > OUTLIER * typical)


def _deviations(
    S: Float64Array, is_seen: Float64Array, cluster: Float64Array, noise: float
) -> tuple[Float64Array, Float64Array]:
    """Return the standard deviations of R and of the rotation vector of S, world axes; (N, 3) each."""
    count = is_seen.sum(axis=1)[:, None]
    middle = is_seen @ cluster / count
    r = is_seen[..., None] * (cluster - middle[:, None])
    spread = np.einsum("nmi,nmj->nij", r, r)
    # In body axes, the covariance of the rotation vector is noise^2 (sum abs(r)^2 - r r^T)^-1; R is off by that of
    # the middle, and by the turn about it.
    inertia = np.trace(spread, axis1=1, axis2=2)[:, None, None] * np.eye(3) - spread
    turn = noise**2 * S @ np.linalg.pinv(inertia, hermitian=True) @ np.swapaxes(S, -1, -2)
    arm = np.asarray(skew(np.einsum("nij,nj->ni", S, middle)))
    variance = noise**2 / count + np.einsum("nij,njk,nik->ni", arm, turn, arm)
    return np.sqrt(variance), np.sqrt(np.diagonal(turn, axis1=1, axis2=2))


def _outlier_findings(is_seen: Float64Array, distances: Float64Array, good: NDArray[np.bool_]) -> list[Finding]:
    """Return a finding on samples that are not `good`."""
    if good.all():
        return []
    worst = float(np.sqrt((distances[~good] ** 2).sum() / is_seen[~good].sum()))
    share = float(np.mean(~good))
    text = (
        f"In {percent(share)} of the samples, markers are off their places by {1e3 * worst:.2g} mm rms, far more "
        "than in the others: labels may be exchanged, or a reflection taken for a marker. Poses there are NaN."
    )
    return [Finding("outliers", share, 0, text, harmless=share < _MOST)]


def _reference_findings(is_seen: Float64Array, distances: Float64Array, size: float) -> list[Finding]:
    """Return a finding if the markers are not at the places that the user gave."""
    rms = float(np.sqrt((distances**2).sum() / is_seen.sum()))
    text = f"The markers are off the places of reference by {rms:.2g} m rms, in a cluster of the size {size:.2g} m: "
    text += "labels may be exchanged, or units differ."
    return exceeded(Finding("reference", rms, 0.05 * size, text))


def _first_marker_places(places: Float64Array, is_seen: Float64Array) -> Float64Array:
    """Return first places of the markers on the body (M, 3), about their mean: those in the sample whose distances
    between markers are nearest to the usual ones, of samples that show all.
    """
    whole = places[is_seen.all(axis=1)]
    if not len(whole):
        raise FitError("reference", "the places of the markers, since no sample shows all", None)
    whole = whole[every_kth(len(whole), _JUDGED_SAMPLES)]
    apart = np.linalg.norm(whole[:, :, None] - whole[:, None], axis=-1)
    best = whole[np.argmin(((apart - np.median(apart, axis=0)) ** 2).sum(axis=(1, 2)))]
    return np.asarray(best - best.mean(axis=0))


def _markers_determine_attitude(places: Float64Array, is_seen: Float64Array) -> NDArray[np.bool_]:
    """Return which samples (N,) show three markers or more that are not on a line."""
    count = is_seen.sum(axis=1)
    middle = np.einsum("nm,nmi->ni", is_seen, places) / np.maximum(count, 1.0)[:, None]
    centred = is_seen[..., None] * (places - middle[:, None])
    squared_widths = np.linalg.eigvalsh(np.einsum("nmi,nmj->nij", centred, centred))
    is_on_line = squared_widths[:, 1] <= _MIN_WIDTH**2 * squared_widths[:, 2]
    return np.asarray((count >= _MIN_MARKERS) & ~is_on_line)


def _kabsch_poses(
    places: Float64Array, is_seen: Float64Array, cluster: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return R (N, 3) and S (N, 3, 3) of least squares, and the distances (N, M) from them, 0 where not seen."""
    count = np.maximum(is_seen.sum(axis=1), 1.0)[:, None]
    middle = (is_seen[..., None] * places).sum(axis=1) / count
    inner = is_seen @ cluster / count
    there = is_seen[..., None] * (places - middle[:, None])
    here = cluster - inner[:, None]
    left, _, right = np.linalg.svd(np.einsum("nmi,nmj->nij", there, here))
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    S = left @ right
    R = middle - np.einsum("nij,nj->ni", S, inner)
    off = places - R[:, None] - np.einsum("nij,mj->nmi", S, cluster)
    return R, S, is_seen * np.linalg.norm(off, axis=-1)


def _refined_places(places: Float64Array, is_seen: Float64Array, cluster: Float64Array) -> Float64Array:
    """Return the places (M, 3) that fit best, by poses and places in turn from first places, in the world axes at the
    first of the samples that show the most.
    """
    before, num_seen = np.inf, is_seen.sum(axis=0)[:, None]
    for _ in range(60):
        R, S, distances = _kabsch_poses(places, is_seen, cluster)
        total = float((distances**2).sum())
        if np.isfinite(before) and before - total <= 1e-6 * before:
            break
        before = total
        on_body = (is_seen[..., None] * np.einsum("nji,nmj->nmi", S, places - R[:, None])).sum(axis=0) / np.maximum(
            num_seen, 1.0
        )
        cluster = np.where(num_seen > 0, on_body, cluster)
        cluster = cluster - cluster.mean(axis=0)
    return np.asarray(cluster @ S[int(np.argmax(is_seen.sum(axis=1)))].T)


def _moved_marker_findings(off: Float64Array, is_seen: Float64Array, size: float) -> list[Finding]:
    """Return a finding on the marker that is farthest off its place if what is left of the places, `off` (N, M, 3),
    is not random: a marker that moved against the others.
    """
    markers = zip(off.swapaxes(0, 1), is_seen.T, strict=True)
    if max(neighbour_correlation(one[seen > 0].T) for one, seen in markers) <= RANDOM_CORRELATION:
        return []
    rms = np.sqrt((off**2).sum(axis=(0, 2)) / np.maximum(is_seen.sum(axis=0), 1.0))
    worst, last = int(np.argmax(rms)), off.shape[1] - 1
    which = f"Marker {worst}, of 0 to {last}," if last >= _MIN_MARKERS else "One of the markers"
    text = f"{which} moved against the others: it is off its place by {1e3 * rms[worst]:.2g} mm rms, not at random."
    return exceeded(Finding("moved", float(rms[worst]), _MAX_PLAY * size, text))
