"""Plots of a motion: what moves how over time, the paths in space, and how well E1 holds."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hingepair.errors import MissingDependencyError
from hingepair.integration.trajectory import continuous
from hingepair.numeric.tables import unit_of
from hingepair.pictures.frames import Array, Frames, Source, frames_of
from hingepair.rotations.euler import matrix_to_euler

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLOURS: Final = ("#0072b2", "#d55e00", "#009e73")  # Okabe and Ito's blue, vermilion and green
_BODIES: Final = {"R1": "#4477aa", "R2": "#ee7733", "hinge point": "#222222"}
_ROWS: Final = (("R2", "v2", "a2"), ("S2", "omega2", "alpha2"))
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
    """A figure of a motion: position, attitude and their rates over time, psi, paths in space, the residual of E1.

    Or of some outputs alone, each over time.

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
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingDependencyError(
            "plot", "the package matplotlib: pip install 'hingepair[plot]'", "none"
        ) from None
    frames = frames_of(source, outputs)
    figure = _several(Figure, frames) if outputs is not None else _whole(Figure, frames)
    figure.suptitle(frames.title)
    for axes in figure.axes:
        axes.tick_params(labelsize=8)
        axes.title.set_fontsize(9)
        if axes.name != "3d":
            axes.grid(alpha=0.3)
    return figure


def _several(make: type[Figure], frames: Frames) -> Figure:
    """Some outputs over time, side by side."""
    columns = min(3, len(frames.readings))
    rows = -(-len(frames.readings) // columns)
    figure = make(figsize=(max(4.2 * columns, 6), 2.6 * rows + 0.5), layout="constrained")
    places = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for axes, (name, values) in zip(places, frames.readings.items(), strict=False):
        _over_time(axes, name, frames.t, values)
    for axes in places[len(frames.readings) :]:
        axes.remove()
    return figure


def _whole(make: type[Figure], frames: Frames) -> Figure:
    shown = {**frames.bodies, **frames.readings}
    columns = max(sum(name in shown for name in row) for row in _ROWS)
    figure = make(figsize=(4.2 * max(columns, 2), 8.4), layout="constrained")
    grid = figure.add_gridspec(3, 2 * max(columns, 2), height_ratios=(1, 1, 1.25))
    first: Any = None
    for row, names in enumerate(_ROWS):
        for column, name in enumerate(name for name in names if name in shown):
            axes = figure.add_subplot(grid[row, 2 * column : 2 * column + 2], sharex=first)
            first = first or axes
            _over_time(axes, name, frames.t, shown[name])
    half = max(columns, 2)
    _paths(figure, grid[2, :half], frames)
    lower = grid[2, half:].subgridspec(2, 1)
    psi = figure.add_subplot(lower[0], sharex=first)
    _over_time(psi, "psi", frames.t, frames.psi)
    _gap(figure.add_subplot(lower[1], sharex=first), frames)
    return figure


def _over_time(axes: Axes, name: str, t: Array, values: Array) -> None:
    attitude = values.ndim == 3
    if attitude:
        with np.errstate(invalid="ignore"):
            values = continuous(matrix_to_euler(values), proper=False)
    _shade(axes, t, values)
    axes.set(title=_TITLES.get(name, name), ylabel="rad" if attitude else unit_of(name), xlabel="t [s]")
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
    """Grey where something is no finite number."""
    lost = ~np.isfinite(values.reshape(len(t), -1)).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]]).astype(int)))
    for start, stop in edges.reshape(-1, 2):
        axes.axvspan(t[max(start - 1, 0)], t[min(stop, len(t) - 1)], color="0.85", lw=0)


def _paths(figure: Figure, place: Any, frames: Frames) -> None:
    """The paths of both reference points and of the hinge point, at one scale; from above where z stays."""
    with np.errstate(invalid="ignore"):
        paths = [frames.bodies["R1"], frames.bodies["R2"], frames.hinge]
    paths = [np.where(np.isfinite(path), path, np.nan) for path in paths]
    far = np.nanmax(np.abs(paths[0]), initial=0.0) >= 1e4
    paths = [path * (1e-3 if far else 1.0) for path in paths]
    ends = np.array([(np.nanmin(path, 0), np.nanmax(path, 0)) for path in paths if not np.isnan(path).all(0).any()])
    letters = "xy" if len(ends) and np.ptp(ends[..., 2]) == 0 else "xyz"
    axes: Any = figure.add_subplot(place, projection="3d" if letters == "xyz" else None)
    for (name, colour), path in zip(_BODIES.items(), paths, strict=True):
        own = path.T[: len(letters)]
        axes.plot(*own, color=colour, lw=1.2, label=name)
        axes.plot(*own[:, :1], "o", color=colour, ms=3)
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


def _gap(axes: Axes, frames: Frames) -> None:
    """The residual of E1 beside the rounding of the numbers that it is made of."""
    pair, (R1, R2, S2) = frames.pair, (frames.bodies[name] for name in ("R1", "R2", "S2"))
    size = np.abs(R1).max(axis=1) + np.linalg.norm(pair.u1) + np.linalg.norm(pair.u2)
    with np.errstate(invalid="ignore"):
        gap = np.abs(frames.hinge - R2 - S2 @ pair.u2).max(axis=1)
    least = np.finfo(float).eps / 2 * size
    label = "residual of E1, exact ones at the bottom"
    axes.semilogy(frames.t, np.maximum(gap, least / 8), ".", color="#222222", ms=2, label=label)
    axes.semilogy(frames.t, 16 * least, color=_COLOURS[1], lw=1, label="16 u scale")
    axes.set(ylabel="m", xlabel="t [s]")
    axes.legend(fontsize=8, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 0.97), frameon=False)
