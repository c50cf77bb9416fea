"""Plots of a motion: quantities over time, paths in space, and the residual of E1.

Curves are drawn through all samples. Where these are many more than a picture has columns of pixels, a curve goes
through the first, the last, the smallest and the largest sample of each short interval, which looks the same: an
oscillation that is faster than a column fills the band between its extremes, and a spike of one sample stays.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from hingepair.errors import MissingDependencyError
from hingepair.integration.trajectory import continuous
from hingepair.numeric.tables import unit_of
from hingepair.pictures.frames import Array, Frames, Source, all_frames
from hingepair.rotations.euler import matrix_to_euler

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS: Final = ("#0072b2", "#d55e00", "#009e73")  # Okabe and Ito's blue, vermilion and green
_BODIES: Final = {"R1": "#4477aa", "R2": "#ee7733", "hinge point": "#222222"}
_MAX_INTERVALS: Final = 2000
"""Intervals of a curve over time; more than its panel has columns of pixels, in print and enlarged too."""
_MAX_PATH_INTERVALS: Final = 20_000
"""Intervals of a path in space, where the curve within an interval can be seen."""
_ROWS: Final = (("R2", "v2", "a2"), ("S2", "omega2", "alpha2"))
_ATTITUDES: Final = ("S1", "S2")
_TITLES: Final = {
    "R2": "position of body 2, R2",
    "v2": "velocity, v2",
    "a2": "acceleration, a2",
    "S2": "attitude of body 2, Euler angles XYZ",
    "S1": "attitude of body 1, Euler angles XYZ",
    "psi": "hinge angle, psi",
    "omega2": "angular velocity, omega2",
    "alpha2": "angular acceleration, alpha2",
}


def plot(source: Source, outputs: Iterable[str] | None = None) -> Figure:
    """Draw a motion: position, attitude and their rates over time, psi, paths in space, the residual of E1.

    Or draw some outputs alone, each over time. Every sample counts: of more than 4,000 the curves go through the
    extremes of 2,000 intervals, so that fast oscillations fill a band and short spikes stay.

    Args:
        source: a scene or its result, a trajectory of `integrate` or `simulate`, or a pair, which then turns through
            its limits.
        outputs: what to draw instead, as for `Scene.evaluate`; of a trajectory what it has, of a pair R1, S1, R2, S2,
            psi. Attitudes are drawn as Euler angles XYZ.

    Returns:
        A matplotlib Figure; `.savefig(path)` writes it. World axes; what the motion does not have stays out. Where
        something is not a finite number there is a gap, shaded.

    Raises:
        ArgumentError: what has no motion in space to show, or no such output.
        MissingDependencyError: matplotlib is not installed.

    >>> import hingepair as hp
    >>> figure = hp.plot(hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1)))
    >>> [axes.get_title() for axes in figure.axes][:2]
    ['position of body 2, R2', 'attitude of body 2, Euler angles XYZ']
    """
    title, curves = _curves(source, outputs)
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingDependencyError(
            "plot", "the package matplotlib: pip install 'hingepair[plot]'", "none"
        ) from None
    figure = _whole(Figure, curves) if outputs is None else _several(Figure, curves)
    figure.suptitle(title)
    for axes in figure.axes:
        axes.tick_params(labelsize=8)
        axes.title.set_fontsize(9)
        if axes.name != "3d":
            axes.grid(alpha=0.3)
    return figure


class _Curve(NamedTuple):
    """Samples that a curve goes through; t has shape (N,), values (N,) or (N, components)."""

    t: Array
    values: Array


def _curves(source: Source, outputs: Iterable[str] | None) -> tuple[str, dict[str, _Curve]]:
    """Return the title of a figure and its curves by name: outputs, psi, the paths, and the residual of E1."""
    title = ""
    pieces: dict[str, list[tuple[Array, Array]]] = {}  # t and values of each curve
    angles: dict[str, Array] = {}  # last Euler angles of each attitude, from which the next piece goes on
    for frames in all_frames(source, outputs):
        title = frames.title
        for name, array in (frames.readings if outputs is not None else _quantities(frames)).items():
            values = array
            if array.ndim == 3:
                values = _euler_angles(array, angles.get(name, np.empty((0, 3))))
                angles[name] = values[np.isfinite(values).all(axis=1)][-1:]
            intervals = _MAX_PATH_INTERVALS if name == "paths" else _MAX_INTERVALS
            rows = _envelope(values.reshape(len(frames.t), -1), -(-frames.samples // intervals))
            pieces.setdefault(name, []).append((frames.t[rows], values[rows]))
    return title, {name: _Curve(*map(np.concatenate, zip(*parts, strict=True))) for name, parts in pieces.items()}


def _quantities(frames: Frames) -> dict[str, Array]:
    """Return what a whole figure shows: R2, S2, rates and psi by name, the paths, and the residual of E1."""
    pair, (R1, R2, S2) = frames.pair, (frames.bodies[name] for name in ("R1", "R2", "S2"))
    scale = np.abs(R1).max(axis=1) + np.linalg.norm(pair.u1) + np.linalg.norm(pair.u2)
    with np.errstate(invalid="ignore"):
        gap = np.abs(frames.hinge - R2 - S2 @ pair.u2).max(axis=1)
        paths = np.concatenate([R1, R2, frames.hinge], axis=1)
    rounding = np.finfo(float).eps / 2 * scale
    quantities = {"R2": R2, "S2": S2, **frames.readings, "psi": frames.psi, "paths": paths}
    return {**quantities, "gap": np.stack([gap, rounding], axis=1)}


def _euler_angles(S: Array, before: Array) -> Array:
    """Return Euler angles XYZ of attitudes without jumps between neighbours; NaN where an attitude is not finite.

    Args:
        S: attitudes; shape (N, 3, 3).
        before: angles that these continue [rad]; shape (1, 3), or (0, 3) at the start.

    Returns:
        Angles [rad], shape (N, 3).
    """
    with np.errstate(invalid="ignore"):
        angles = np.array(matrix_to_euler(S))
    finite = np.isfinite(angles).all(axis=1)
    if finite.any():
        angles[finite] = continuous(np.concatenate([before, angles[finite]]), proper=False)[len(before) :]
    return angles


def _envelope(values: Array, size: int) -> Array:
    """Return the rows through which a curve looks as it does through all of them.

    These are the first and the last row of each interval, those with the smallest and the largest value of each
    component, and the first and the last with a value that is not finite.

    Args:
        values: samples of the curve's components; shape (N, components).
        size: rows of an interval; up to two, all rows are kept.

    Returns:
        Numbers of rows, increasing; shape (M,).
    """
    count = len(values)
    if size <= 2:
        return np.arange(count)
    start = np.arange(0, count, size)
    padding = np.repeat(values[-1:], len(start) * size - count, axis=0)
    parts = np.concatenate([values, padding]).reshape(len(start), size, -1)
    lost = ~np.isfinite(parts)
    places = [
        np.where(lost, np.inf, parts).argmin(axis=1),
        np.where(lost, -np.inf, parts).argmax(axis=1),
        lost.argmax(axis=1),
        size - 1 - lost[:, ::-1].argmax(axis=1),
    ]
    extremes = (start[:, None] + np.concatenate(places, axis=1)).ravel()
    return np.unique(np.minimum(np.concatenate([start, start + size - 1, extremes]), count - 1))


def _several(make: type[Figure], curves: dict[str, _Curve]) -> Figure:
    """Draw some outputs over time, side by side."""
    columns = min(3, len(curves))
    rows = -(-len(curves) // columns)
    figure = make(figsize=(max(4.2 * columns, 6), 2.6 * rows + 0.5), layout="constrained")
    places = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for axes, (name, curve) in zip(places, curves.items(), strict=False):
        _over_time(axes, name, curve)
    for axes in places[len(curves) :]:
        axes.remove()
    return figure


def _whole(make: type[Figure], curves: dict[str, _Curve]) -> Figure:
    """Draw body 2 and its rates over time, the paths, psi and the residual of E1."""
    columns = max(2, *(sum(name in curves for name in row) for row in _ROWS))
    figure = make(figsize=(4.2 * columns, 8.4), layout="constrained")
    grid = figure.add_gridspec(3, 2 * columns, height_ratios=(1, 1, 1.25))
    first: Any = None
    for row, names in enumerate(_ROWS):
        for column, name in enumerate(name for name in names if name in curves):
            axes = figure.add_subplot(grid[row, 2 * column : 2 * column + 2], sharex=first)
            first = first or axes
            _over_time(axes, name, curves[name])
    _paths(figure, grid[2, :columns], curves["paths"].values)
    lower = grid[2, columns:].subgridspec(2, 1)
    _over_time(figure.add_subplot(lower[0], sharex=first), "psi", curves["psi"])
    _gap(figure.add_subplot(lower[1], sharex=first), curves["gap"])
    return figure


def _over_time(axes: Axes, name: str, curve: _Curve) -> None:
    """Draw the components of a quantity over time."""
    t, values = curve
    _shade(axes, t, values)
    axes.set(title=_TITLES.get(name, name), ylabel="rad" if name in _ATTITUDES else unit_of(name), xlabel="t [s]")
    axes.tick_params(labelbottom=True)
    if values.ndim == 1:
        axes.plot(t, values, color="#222222", lw=1.2)
        return
    for part, colour, letter, style in zip(values.T, _COLOURS, "xyz", ("-", "--", "-."), strict=False):
        axes.plot(t, part, style, color=colour, lw=1.2, label=letter)
    if not axes.figure.legends:
        handles, letters = axes.get_legend_handles_labels()
        axes.figure.legend(handles, letters, fontsize=8, ncols=3, loc="outside upper right")


def _shade(axes: Axes, t: Array, values: Array) -> None:
    """Shade the times at which a value is not finite."""
    lost = ~np.isfinite(values.reshape(len(t), -1)).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]]).astype(int)))
    for start, stop in edges.reshape(-1, 2):
        axes.axvspan(t[max(start - 1, 0)], t[min(stop, len(t) - 1)], color="0.85", lw=0)


def _paths(figure: Figure, place: Any, points: Array) -> None:
    """Draw the paths of both reference points and of the hinge point, at one scale; from above where z stays.

    Args:
        figure: the figure.
        place: where in its grid.
        points: R1, R2 and the hinge point, side by side [m]; shape (N, 9).
    """
    points = np.where(np.isfinite(points), points, np.nan)
    far = np.nanmax(np.abs(points[:, :3]), initial=0.0) >= 1e4
    paths = np.split(points * (1e-3 if far else 1.0), 3, axis=1)
    ends = np.array([(np.nanmin(path, 0), np.nanmax(path, 0)) for path in paths if not np.isnan(path).all(0).any()])
    letters = "xy" if len(ends) and np.ptp(ends[..., 2]) == 0 else "xyz"
    axes: Any = figure.add_subplot(place, projection="3d" if letters == "xyz" else None)
    for (name, colour), path in zip(_BODIES.items(), paths, strict=True):
        shown = path.T[: len(letters)]
        axes.plot(*shown, color=colour, lw=1.2, label=name)
        axes.plot(*shown[:, :1], "o", color=colour, ms=3)
    unit = "km" if far else "m"
    axes.set(title=f"paths in space [{unit}], from the dots", **{f"{letter}label": letter for letter in letters})
    if letters == "xy":
        axes.set_aspect("equal", adjustable="datalim")
        axes.legend(fontsize=8)
        return
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(-0.35, 1))
    if not len(ends):
        return
    middle, size = (ends[:, 1].max(0) + ends[:, 0].min(0)) / 2, ends[:, 1].max(0) - ends[:, 0].min(0)
    size = 1.05 * np.maximum(size, 0.3 * size.max())  # room beside a long path, or the numbers there would be a blot
    for letter, centre, extent in zip(letters, middle, size, strict=True):
        getattr(axes, f"set_{letter}lim")(centre - extent / 2, centre + extent / 2)
        axes.locator_params(axis=letter, nbins=max(1, round(4 * extent / size.max())))
    long = max(0.0, 1 - max(size[2], size.min()) / size.max())  # there is more room to the sides than up and down
    axes.set_box_aspect(size, zoom=0.7 + 0.6 * long)  # leaves room for the labels


def _gap(axes: Axes, curve: _Curve) -> None:
    """Draw the residual of E1 beside the rounding of the numbers that it is made of."""
    gap, rounding = curve.values.T
    label = "residual of E1, exact ones at the bottom"
    axes.semilogy(curve.t, np.maximum(gap, rounding / 8), ".", color="#222222", ms=2, label=label)
    axes.semilogy(curve.t, 16 * rounding, color=_COLOURS[1], lw=1, label="16 u scale")
    axes.set(ylabel="m", xlabel="t [s]")
    axes.legend(fontsize=8, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 0.97), frameon=False)
