"""From the markers of a rigid cluster to the poses of its body (Kabsch), marker by marker judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, FitError, ShapeError
from hingepair.numeric.arrays import Float64Array, read_only, real_array
from hingepair.pair.body_motion import BodyMotion, motion_of_rotations

_MAX_ROUNDS = 60  # of poses by the markers' places in the body, and of these places by the poses
_MIN_PROGRESS = 1e-6  # of the rms distance in a round, from which another follows
# Markers in a sample from which it has an attitude.
_MIN_MARKERS = 3
_MIN_WIDTH = 0.02  # second extent of a cluster in parts of the first, from which its attitude is shown
_MIN_EXCESS = 3.0  # of a marker's distances to those without it, from which it is said to have moved
_MIN_MOVED = 1e-9  # of the cluster's size: distances that rounding explains


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ClusterFit:
    """The motion of a rigid cluster of markers.

    Attributes:
        body: R, the mean of the cluster's markers, and S; NaN where fewer than three markers are seen; shape (N,).
        reference: places of the markers in the body's axes [m]; (M, 3).
        residuals: distance of each marker from its place [m], NaN where it is missing; (N, M).
        rms: of these distances, marker by marker [m]; (M,).
        noise: standard deviation of a coordinate of a marker [m].
        ok: the cluster is rigid.
        findings: in sentences: which marker moved.
    """

    body: BodyMotion
    reference: Float64Array
    residuals: Float64Array
    rms: Float64Array
    noise: float
    ok: bool
    findings: tuple[str, ...]


def fit_cluster(markers: ArrayLike, reference: ArrayLike | None = None) -> ClusterFit:
    """Fit the poses of a body to the markers on it: least squares of distances (Kabsch), sample by sample.

    Args:
        markers: places in the world [m], NaN where a marker is not seen; shape (N, M, 3), three markers or more that
            are not on a line.
        reference: their places in the body's axes [m]; (M, 3). Unless given, they are fitted too: the axes are those
            of the world at the first sample with all markers, the reference point is the markers' mean.

    Returns:
        The motion, ready for `fit` and `smooth`.

    Raises:
        FitError: no sample has three markers, or they lie on a line.
        ArgumentError: an argument cannot be used; names it.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> places = np.array([(0.1, 0, 0), (-0.1, 0.05, 0), (0, -0.05, 0), (0, 0, 0.1)])
    >>> turn = hp.rodrigues((0, 0, 1), np.linspace(0, 1, 50))
    >>> found = hp.fit_cluster(places @ np.swapaxes(turn, -1, -2))
    >>> found.ok, bool(np.abs(found.body.S - turn).max() < 1e-12)
    (True, True)
    """
    places = real_array("markers", markers).astype(np.float64)
    if places.ndim != 3 or places.shape[2] != 3 or places.shape[1] < _MIN_MARKERS:
        raise ShapeError("markers", "shape (N, M, 3) with three markers or more", f"shape {places.shape}")
    seen: NDArray[np.bool_] = np.asarray(np.isfinite(places).all(axis=-1))
    used = seen.sum(axis=1) >= _MIN_MARKERS
    if not used.any():
        raise FitError("markers", "samples with three markers", "none")
    given = None if reference is None else real_array("reference", reference).astype(np.float64)
    if given is not None and (given.shape != places.shape[1:] or not np.isfinite(given).all()):
        raise ArgumentError("reference", f"finite numbers of shape {places.shape[1:]}", f"shape {given.shape}")
    own, known = np.where(seen[..., None], places, 0.0)[used], seen[used].astype(np.float64)
    cluster = given if given is not None else _first_cluster(own, known)
    _check_width(cluster)
    R, S, off, cluster = _fit_poses_and_places(own, known, cluster, given is None)
    size = float(np.sqrt((cluster**2).sum() / cluster.shape[0]))
    rms = _rms(off, known)
    findings = _moved(own, known, cluster, off, size)
    whole_R, whole_S = np.full((places.shape[0], 3), np.nan), np.full((places.shape[0], 3, 3), np.nan)
    whole_R[used], whole_S[used] = R, S
    residuals = np.full(seen.shape, np.nan)
    residuals[used] = np.where(known > 0, off, np.nan)
    free = 3 * known.sum() - 6 * known.shape[0] - (3 * cluster.shape[0] - 6 if given is None else 0)
    return ClusterFit(
        body=motion_of_rotations(R=read_only(whole_R), S=read_only(whole_S)),
        reference=read_only(cluster),
        residuals=read_only(residuals),
        rms=read_only(rms),
        noise=float(np.sqrt((off**2).sum() / max(free, 1.0))),
        ok=not findings,
        findings=tuple(findings),
    )


def _rms(off: Float64Array, known: Float64Array) -> Float64Array:
    """Return the rms distance of each marker over the samples that show it [m]; (M,)."""
    return np.asarray(np.sqrt((off**2).sum(axis=0) / np.maximum(known.sum(axis=0), 1.0)))


def _first_cluster(places: Float64Array, known: Float64Array) -> Float64Array:
    """Return places of the markers at the first sample with most of them; unseen ones are set beside those seen."""
    best = int(np.argmax(known.sum(axis=1)))
    there = known[best] > 0
    middle = places[best][there].mean(axis=0)
    cluster = np.where(there[:, None], places[best] - middle, 0.0)
    for marker in np.flatnonzero(~there):
        R, S, _ = _poses(places, known * there, cluster)
        rows = (known[:, marker] > 0) & ((known * there).sum(axis=1) >= _MIN_MARKERS)
        if not rows.any():
            raise FitError("markers", f"marker {marker} in a sample with three others", "none")
        own = np.einsum("nji,nj->ni", S[rows], places[rows, marker] - R[rows])
        cluster[marker] = np.median(own, axis=0)
        there[marker] = True
    return np.asarray(cluster - cluster.mean(axis=0))


def _check_width(cluster: Float64Array) -> None:
    """Refuse markers on a line, about which an attitude is not shown."""
    widths = np.linalg.svd(cluster - cluster.mean(axis=0), compute_uv=False)
    if widths[1] <= _MIN_WIDTH * widths[0]:
        raise FitError("markers", "markers that are not on a line", f"a cluster {widths[1]:.2g} m wide")


def _poses(
    places: Float64Array, known: Float64Array, cluster: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return R, S of each sample and the distances of its markers from their places; (N, 3), (N, 3, 3), (N, M)."""
    count = np.maximum(known.sum(axis=1), 1.0)[:, None]
    middle = (known[..., None] * places).sum(axis=1) / count
    inner = known @ cluster / count
    there = known[..., None] * (places - middle[:, None])
    here = cluster - inner[:, None]
    left, _, right = np.linalg.svd(np.einsum("nmi,nmj->nij", there, here))
    left[..., 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    S = left @ right
    R = middle - np.einsum("nij,nj->ni", S, inner)
    off = places - R[:, None] - np.einsum("nij,mj->nmi", S, cluster)
    return R, S, known * np.linalg.norm(off, axis=-1)


def _fit_poses_and_places(
    places: Float64Array, known: Float64Array, cluster: Float64Array, refine: bool
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Return R, S, distances, and the places of the markers in the body, refined by turns with the poses."""
    axes = None
    before = np.inf
    for _ in range(_MAX_ROUNDS if refine else 1):
        R, S, off = _poses(places, known, cluster)
        axes = S[int(np.argmax(known.sum(axis=1)))] if axes is None else axes
        total = float((off**2).sum())
        if not refine or (np.isfinite(before) and before - total <= _MIN_PROGRESS * before):
            break
        before = total
        own = np.einsum("nji,nmj->nmi", S, places - R[:, None])
        seen = known.sum(axis=0)[:, None]
        cluster = np.where(seen > 0, (known[..., None] * own).sum(axis=0) / np.maximum(seen, 1.0), cluster)
        cluster = cluster - cluster.mean(axis=0)
    if refine:
        turn = S[int(np.argmax(known.sum(axis=1)))]
        cluster = cluster @ turn.T @ (axes if axes is not None else np.eye(3))
        R, S, off = _poses(places, known, cluster)
    return R, S, off, cluster


def _moved(
    places: Float64Array, known: Float64Array, cluster: Float64Array, off: Float64Array, size: float
) -> list[str]:
    """Return a sentence on the marker without which the others stay in place."""
    rms = float(np.sqrt((off**2).sum() / max(known.sum(), 1.0)))
    if cluster.shape[0] <= _MIN_MARKERS or rms <= _MIN_MOVED * size:
        return []
    left = []
    for marker in range(cluster.shape[0]):
        others = known.copy()
        others[:, marker] = 0.0
        rows = others.sum(axis=1) >= _MIN_MARKERS
        if rows.sum() < 2:
            left.append(np.inf)
            continue
        _, _, rest, _ = _fit_poses_and_places(places[rows], others[rows], cluster, True)
        free = 3 * others[rows].sum() - 6 * rows.sum() - 3 * (cluster.shape[0] - 1) + 6
        left.append(float(np.sqrt((rest**2).sum() / max(free, 1.0))))
    free = 3 * known.sum() - 6 * known.shape[0] - 3 * cluster.shape[0] + 6
    own = float(np.sqrt((off**2).sum() / max(free, 1.0)))
    best = int(np.argmin(left))
    if own < _MIN_EXCESS * max(left[best], _MIN_MOVED * size):
        return []
    alike = [f"{marker}" for marker in range(len(left)) if left[marker] < 2 * left[best]]
    if len(alike) > 1:
        return [f"The cluster is not rigid: one of the markers {', '.join(alike)} moved against the others."]
    return [
        f"Marker {best} moved against the others: without it they stay in place to {1e3 * left[best]:.2g} mm, with "
        f"it to {1e3 * own:.2g} mm. Leave it out."
    ]
