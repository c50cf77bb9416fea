"""The records of two inertial sensors: checked, cut at gaps, their angular velocities smoothed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import FitError, ShapeError
from hingepair.measured.findings import Finding
from hingepair.measured.smoothing.spline import MIN_PIECE, smooth_columns
from hingepair.numeric.arrays import Float64Array, number_not_below_0, vectors
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.tables.instants import checked_gaps, increasing_seconds, split_at_gaps
from hingepair.tables.suspicions import suspicions


class Sensors(NamedTuple):
    """Records of two sensors at N instants, of which M can be used."""

    t: Float64Array  # since the first instant [s]; (N,)
    omega: Float64Array  # angular velocities in the axes of their bodies [rad/s]; (2, N, 3)
    force: Float64Array  # specific forces, likewise [m/s^2]; (2, N, 3)
    used: NDArray[np.intp]  # indices of the instants that can be used; (M,)
    starts: NDArray[np.intp]  # which of these are the first after a gap
    smooth: Float64Array  # smoothed angular velocities and their derivatives; (2, 2, M, 3), by body, then order
    alpha_deviations: Float64Array  # standard deviations of the derivatives [rad/s^2]; (2, M)
    gyroscope_bias: float  # expected size [rad/s]
    accelerometer_bias: float  # [m/s^2]

    @property
    def step(self) -> float:
        """Median time step [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def used_forces(self) -> Float64Array:
        """Specific forces at the instants that can be used; (2, M, 3)."""
        return self.force[:, self.used]


def read_sensors(
    t: ArrayLike, named: Mapping[str, ArrayLike], gaps: float, gyroscope_bias: float, accelerometer_bias: float
) -> Sensors:
    """Check and cut the records omega1, f1, omega2, f2, which `named` has by the names of the arguments, and smooth
    the angular velocities. The biases are their expected sizes [rad/s, m/s^2].
    """
    time, _ = increasing_seconds("t", t)
    columns = np.stack(checked_vectors(named, time.size))
    known: NDArray[np.bool_] = np.asarray(np.isfinite(columns).all(axis=(0, 2)))
    pieces = split_at_gaps(time, known, checked_gaps(gaps), MIN_PIECE)
    if not pieces:
        raise FitError(", ".join(named), f"at least {MIN_PIECE} finite samples without a gap", int(known.sum()))
    used = np.concatenate(pieces)
    smooth = [smooth_columns(time, omega, pieces, None) for omega in columns[::2]]
    return Sensors(
        time,
        columns[::2],
        columns[1::2],
        used,
        np.cumsum([piece.size for piece in pieces])[:-1],
        np.stack([each.values[:2, used] for each in smooth]),
        np.stack([each.deviations[1, used] for each in smooth]),
        number_not_below_0("gyroscope_bias", gyroscope_bias),
        number_not_below_0("accelerometer_bias", accelerometer_bias),
    )


def checked_vectors(named: Mapping[str, ArrayLike], count: int | None = None) -> list[Float64Array]:
    """Return vectors, by argument name, as float64 arrays of one shape (N, 3); with `count`, of as many as t."""
    arrays = [vectors(name, value, 3).astype(np.float64) for name, value in named.items()]
    first = next(iter(named))
    for name, array in zip(named, arrays, strict=True):
        shape, as_what = ((count, 3), "t") if count is not None else (arrays[0].shape, first)
        if array.ndim != 2 or array.shape != shape:
            expected = f"shape {shape}, as {as_what}" if len(shape) == 2 else "shape (N, 3)"
            raise ShapeError(name, expected, f"shape {array.shape}")
    return arrays


def axis_arguments(n1: ArrayLike, n2: ArrayLike) -> list[Float64Array]:
    """Return the arguments n1 and n2 as unit vectors."""
    return [np.asarray(unit_axis(name, np.asarray(n))) for name, n in (("n1", n1), ("n2", n2))]


def record_doubts(t: ArrayLike, named: Mapping[str, ArrayLike]) -> list[Finding]:
    """Return findings on readings or instants that are probably in another unit than expected."""
    texts = suspicions("instants", "t", increasing_seconds("t", t)[0])
    for name, column in named.items():
        texts += suspicions("gyroscope" if name.startswith("omega") else "accelerometer", name, column)
    return [Finding(text) for text in texts]


def local_slopes(values: Float64Array) -> Float64Array:
    """Return the slopes [per row] of parabolas through seven successive readings (N, 3), in which the middle one has
    no part; NaN at three rows of either end.
    """
    slopes, weights = np.full_like(values, np.nan), np.arange(-3, 4)
    if values.shape[0] >= weights.size:
        windows = np.lib.stride_tricks.sliding_window_view(values, weights.size, axis=0)
        slopes[3:-3] = windows @ weights / (weights @ weights)
    return slopes


def report(lines: Sequence[str], findings: Sequence[str], ok: bool) -> str:
    """Return the text of a report: lines, findings, and a last line that says whether it is reliable."""
    return "\n".join((*lines, *findings, "ok" if ok else "NOT RELIABLE"))
