"""Poses of a body from the markers of a rigid cluster on it (Kabsch), and sentences on markers that do not fit.

Private functions take `places` (N, M, 3), the recorded positions [m] with any finite number where a marker is not
seen, `is_seen` (N, M), 1.0 or 0.0, and `cluster` (M, 3), the places of the markers on the body [m].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, FitError, ShapeError
from hingepair.measured.findings import RANDOM_CORRELATION, Finding, is_reliable
from hingepair.measured.least_squares import neighbour_correlation
from hingepair.measured.robust import OUTLIER
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_of_rotations
from hingepair.numeric.arrays import Float64Array, read_only, real_array
from hingepair.tables.sheets import percent

_MIN_MARKERS = 3  # that a sample must show to have a pose
_MIN_WIDTH = 0.02  # of a cluster, in parts of its length; below, the markers are on a line, which shows no attitude
_MAX_SIZE = 10.0  # [m] of a cluster, in root mean square; more is probably in another unit
_JUDGED_SAMPLES = 1000  # that tell which marker moved
_ROUNDING = 1e-9  # of the size of the cluster; smaller distances from the places are rounding


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ClusterFit:
    """The result of `fit_cluster`: the motion of a body that carries a rigid cluster of markers.

    Attributes:
        body: the motion of the body, a BodyMotion of shape (N,) with R and S. Its reference point and axes are those
            of the coordinates in `reference`; if none was given, the mean of the places of all markers, and the world
            axes at the first of the samples that show the most markers. R and S are NaN where fewer than three
            markers are seen, or only markers on a line.
        reference: places of the markers on the body, from its reference point, in its axes [m]; shape (M, 3).
        residuals: distance of each marker from its place at each sample [m]; shape (N, M), NaN where the marker is
            not seen, and where R and S are NaN.
        rms: root mean square of each marker's residuals [m]; shape (M,); 0 for a marker that is never seen.
        noise: standard deviation of the noise in each coordinate of a marker's position [m], without samples that are
            far off.
        findings: sentences on which marker moved, was exchanged with another or hidden at (0, 0, 0), and what else is
            wrong, as those of a HingeFit.
    """

    body: BodyMotion
    reference: Float64Array
    residuals: Float64Array
    rms: Float64Array
    noise: float
    findings: tuple[Finding, ...]

    @property
    def ok(self) -> bool:
        """Whether no finding says that a number may be wrong by more than its standard deviations."""
        return is_reliable(self.findings)


def fit_cluster(markers: ArrayLike, reference: ArrayLike | None = None) -> ClusterFit:
    """Fit the poses of a body to the recorded positions of markers on it, by least squares (Kabsch's algorithm).

    Args:
        markers: positions of the markers in world axes [m], NaN where a marker is not seen; shape (N, M, 3). There
            must be three markers or more, not all on one line.
        reference: places of the markers on the body: the vectors from the body's reference point to the markers, in
            the body's axes [m]; shape (M, 3). If it is None, the places are fitted too.

    Returns:
        A ClusterFit. Its `.body` is a BodyMotion (N,) with R and S, which `fit` and `smooth` accept.

    Raises:
        FitError: no sample shows three markers that are not on one line; or `reference` is None and the place of a
            marker cannot be found, for which a sample must show it with three markers whose places have been found
            before, from the sample that shows the most.

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
    seen: NDArray[np.bool_] = np.asarray(np.isfinite(places).all(axis=-1))
    if not (seen.sum(axis=1) >= _MIN_MARKERS).any():
        raise FitError("markers", "samples with three markers", "none")
    is_used = _markers_determine_attitude(np.where(seen[..., None], places, 0.0), seen.astype(np.float64))
    if not is_used.any():
        raise FitError("markers", "samples with three markers that are not on a line", "none")
    reference_places = None if reference is None else real_array("reference", reference).astype(np.float64)
    if reference_places is not None and (
        reference_places.shape != places.shape[1:] or not np.isfinite(reference_places).all()
    ):
        raise ArgumentError(
            "reference", f"finite numbers of shape {places.shape[1:]}", f"shape {reference_places.shape}"
        )
    seen_places, is_seen = np.where(seen[..., None], places, 0.0)[is_used], seen[is_used].astype(np.float64)
    cluster = reference_places if reference_places is not None else _first_marker_places(seen_places, is_seen)
    _check_not_on_line(cluster)
    given = reference_places is not None
    R, S, distances, cluster = _fit_poses_and_places(seen_places, is_seen, cluster, not given)
    size = float(np.sqrt(((cluster - cluster.mean(axis=0)) ** 2).sum() / cluster.shape[0]))
    good = ~_is_outlier(distances, is_seen, size)
    if not given and not good.all() and _markers_determine_attitude(seen_places[good], is_seen[good]).any():
        *_, cluster = _fit_poses_and_places(seen_places[good], is_seen[good], cluster, True)
        R, S, distances = _kabsch_poses(seen_places, is_seen, cluster)
    rms = _rms_by_marker(distances, is_seen)
    findings = [
        *_recording_sentences(seen_places, is_seen, distances, good),
        *(_reference_sentences(seen_places[good], is_seen[good], distances[good], size) if given else []),
        *_moved_marker_sentences(seen_places[good], is_seen[good], cluster, distances[good], size),
        *([f"The markers are {size:.2g} m from their middle: are they in metres?"] if size > _MAX_SIZE else []),
    ]
    whole_R, whole_S = np.full((places.shape[0], 3), np.nan), np.full((places.shape[0], 3, 3), np.nan)
    whole_R[is_used], whole_S[is_used] = R, S
    residuals = np.full(seen.shape, np.nan)
    residuals[is_used] = np.where(is_seen > 0, distances, np.nan)
    free = 3 * is_seen[good].sum() - 6 * good.sum() - (0 if given else 3 * cluster.shape[0] - 6)
    return ClusterFit(
        body=motion_of_rotations(R=read_only(whole_R), S=read_only(whole_S)),
        reference=read_only(cluster),
        residuals=read_only(residuals),
        rms=read_only(rms),
        noise=float(np.sqrt((distances[good] ** 2).sum() / max(free, 1.0))),
        findings=tuple(Finding("markers", 1, 0, text) for text in findings),
    )


def _is_outlier(distances: Float64Array, is_seen: Float64Array, size: float) -> NDArray[np.bool_]:
    """Return which samples (N,) have far larger residuals than most; `size` is that of the cluster [m]."""
    squares = (distances**2).sum(axis=1) / np.maximum(3 * is_seen.sum(axis=1) - 6, 1.0)
    typical = max(float(np.median(squares)), (_ROUNDING * size) ** 2)
    return np.asarray(squares > OUTLIER * typical)


def _recording_sentences(
    places: Float64Array, is_seen: Float64Array, distances: Float64Array, good: NDArray[np.bool_]
) -> list[str]:
    """Return sentences on markers that are hidden at (0, 0, 0), and on samples that are not `good`."""
    sentences = []
    for marker, count in enumerate(((places == 0).all(axis=2) & (is_seen > 0)).sum(axis=0)):
        if count > 1:
            sentences.append(f"Marker {marker} is at (0, 0, 0) in {count} samples: a marker that is not seen is NaN.")
    if not good.all():
        worst = float(np.sqrt((distances[~good] ** 2).sum() / is_seen[~good].sum()))
        share = percent(float(np.mean(~good)))
        sentences.append(
            f"In {share} of the samples, markers are off their places by {1e3 * worst:.2g} mm rms, far more "
            "than in the others: labels may be exchanged, or a reflection taken for a marker."
        )
    return sentences


def _reference_sentences(
    places: Float64Array, is_seen: Float64Array, distances: Float64Array, size: float
) -> list[str]:
    """Return a list with one sentence if the markers are not at the places that the user gave."""
    rms = float(np.sqrt((distances**2).sum() / is_seen.sum()))
    if rms <= 0.05 * size:
        return []
    count = is_seen.sum(axis=1)[:, None]
    centred = is_seen[..., None] * (places - ((is_seen[..., None] * places).sum(axis=1) / count)[:, None])
    ratio = float(np.sqrt((centred**2).sum() / is_seen.sum())) / size
    text = f"The markers are off the places of reference by {rms:.2g} m rms, in a cluster of the size {size:.2g} m"
    if 0.5 < ratio < 2:
        return [f"{text}: labels may be exchanged."]
    return [f"{text}; they are {ratio:.3g} times as far apart as reference says: is it in metres?"]


def _rms_by_marker(distances: Float64Array, is_seen: Float64Array) -> Float64Array:
    """Return the rms distance of each marker from its place [m]; (M,)."""
    return np.asarray(np.sqrt((distances**2).sum(axis=0) / np.maximum(is_seen.sum(axis=0), 1.0)))


def _first_marker_places(places: Float64Array, is_seen: Float64Array) -> Float64Array:
    """Return first places of the markers on the body (M, 3), about their mean: from the sample that shows the most;
    those that it lacks from samples that show them with three known ones. Raise FitError if there are none.
    """
    best = int(np.argmax(is_seen.sum(axis=1)))
    there = is_seen[best] > 0
    middle = places[best][there].mean(axis=0)
    cluster = np.where(there[:, None], places[best] - middle, 0.0)
    for marker in np.flatnonzero(~there):
        R, S, _ = _kabsch_poses(places, is_seen * there, cluster)
        rows = (is_seen[:, marker] > 0) & _markers_determine_attitude(places, is_seen * there)
        if not rows.any():
            raise FitError("markers", f"marker {marker} in a sample with three others", "none")
        body_places = np.einsum("nji,nj->ni", S[rows], places[rows, marker] - R[rows])
        cluster[marker] = np.median(body_places, axis=0)
        there[marker] = True
    return np.asarray(cluster - cluster.mean(axis=0))


def _markers_determine_attitude(places: Float64Array, is_seen: Float64Array) -> NDArray[np.bool_]:
    """Return which samples (N,) show three markers or more that are not on a line."""
    count = is_seen.sum(axis=1)
    middle = np.einsum("nm,nmi->ni", is_seen, places) / np.maximum(count, 1.0)[:, None]
    centred = is_seen[..., None] * (places - middle[:, None])
    squared_widths = np.linalg.eigvalsh(np.einsum("nmi,nmj->nij", centred, centred))
    is_on_line = squared_widths[:, 1] <= _MIN_WIDTH**2 * squared_widths[:, 2]
    return np.asarray((count >= _MIN_MARKERS) & ~is_on_line)


def _check_not_on_line(cluster: Float64Array) -> None:
    """Raise FitError if the places are on a line: the attitude about it would not be determined."""
    widths = np.linalg.svd(cluster - cluster.mean(axis=0), compute_uv=False)
    if widths[1] <= _MIN_WIDTH * widths[0]:
        raise FitError("markers", "markers that are not on a line", f"a cluster {widths[1]:.2g} m wide")


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


def _fit_poses_and_places(
    places: Float64Array, is_seen: Float64Array, cluster: Float64Array, refine_places: bool
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Fit the poses and, if `refine_places`, alternately the places on the body, from first places (M, 3). Return R,
    S, the distances (N, M) and the places.
    """
    axes = None
    before = np.inf
    for _ in range(60 if refine_places else 1):
        R, S, distances = _kabsch_poses(places, is_seen, cluster)
        axes = S[int(np.argmax(is_seen.sum(axis=1)))] if axes is None else axes
        total = float((distances**2).sum())
        if not refine_places or (np.isfinite(before) and before - total <= 1e-6 * before):
            break
        before = total
        body_places = np.einsum("nji,nmj->nmi", S, places - R[:, None])
        num_seen = is_seen.sum(axis=0)[:, None]
        cluster = np.where(
            num_seen > 0, (is_seen[..., None] * body_places).sum(axis=0) / np.maximum(num_seen, 1.0), cluster
        )
        cluster = cluster - cluster.mean(axis=0)
    if refine_places:
        turn = S[int(np.argmax(is_seen.sum(axis=1)))]
        cluster = cluster @ turn.T @ (axes if axes is not None else np.eye(3))
        R, S, distances = _kabsch_poses(places, is_seen, cluster)
    return R, S, distances, cluster


def _moved_marker_sentences(
    places: Float64Array, is_seen: Float64Array, cluster: Float64Array, distances: Float64Array, cluster_size: float
) -> list[str]:
    """Return a sentence on the marker that moved against the others, or on several of which one did."""
    rms = float(np.sqrt((distances**2).sum() / max(is_seen.sum(), 1.0)))
    if rms <= _ROUNDING * cluster_size:
        return []
    if cluster.shape[0] <= _MIN_MARKERS:
        return _triangle_sentences(places, is_seen, cluster_size)
    every = slice(None, None, -(-places.shape[0] // _JUDGED_SAMPLES))
    places, is_seen, distances = places[every], is_seen[every], distances[every]
    # The noise that each marker alone would leave behind if it were taken out.
    noise_without = []
    for marker in range(cluster.shape[0]):
        others = is_seen.copy()
        others[:, marker] = 0.0
        rows = _markers_determine_attitude(places, others)
        if rows.sum() < 2:
            noise_without.append(np.inf)
            continue
        _, _, remaining_distances, _ = _fit_poses_and_places(places[rows], others[rows], cluster, True)
        free = 3 * others[rows].sum() - 6 * rows.sum() - 3 * (cluster.shape[0] - 1) + 6
        noise_without.append(float(np.sqrt((remaining_distances**2).sum() / max(free, 1.0))))
    free = 3 * is_seen.sum() - 6 * is_seen.shape[0] - 3 * cluster.shape[0] + 6
    noise_with_all = float(np.sqrt((distances**2).sum() / max(free, 1.0)))
    best = int(np.argmin(noise_without))
    if noise_with_all < 3.0 * max(noise_without[best], _ROUNDING * cluster_size):
        return []
    suspects = [
        f"{marker}" for marker in range(len(noise_without)) if noise_without[marker] < 2 * noise_without[best]
    ]
    if len(suspects) > 1:
        return [f"The cluster is not rigid: one of the markers {', '.join(suspects)} moved against the others."]
    return [
        f"Marker {best} moved against the others: without it they stay in place to "
        f"{1e3 * noise_without[best]:.2g} mm, with it to {1e3 * noise_with_all:.2g} mm. Leave it out."
    ]


def _triangle_sentences(places: Float64Array, is_seen: Float64Array, cluster_size: float) -> list[str]:
    """Return a sentence if the sides of a triangle of markers change, and not at random."""
    whole = places[is_seen.all(axis=1)]
    if whole.shape[0] < 8:
        return []
    sides = np.linalg.norm(whole - np.roll(whole, 1, axis=1), axis=2)
    off = sides - sides.mean(axis=0)
    power = np.maximum((off * off).sum(axis=0), 1e-300)
    correlations = np.array([neighbour_correlation(side) for side in off.T])
    rms = np.sqrt(power / whole.shape[0])
    is_moved = (correlations > RANDOM_CORRELATION) & (rms > 0.02 * cluster_size)
    if not is_moved.any():
        return []
    worst = float(rms[is_moved].max())
    return [
        f"The cluster is not rigid: distances between its markers change by {1e3 * worst:.2g} mm rms, not at random."
    ]
