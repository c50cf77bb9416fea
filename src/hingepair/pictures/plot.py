"""Plots of a motion: what moves how over time, the paths in space, and how well E1 holds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hingepair.errors import MissingDependencyError
from hingepair.integration.trajectory import continuous
from hingepair.numeric.notebook import unit_of
from hingepair.pictures.frames import Array, Frames, Source, frames_of
from hingepair.rotations.euler import matrix_to_euler

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hingepair.pair.hinge_pair import HingePair

_COLOURS: Final = ("#0072b2", "#d55e00", "#009e73")  # Okabe and Ito's blue, vermilion and green
_BODIES: Final = {"R1": "#4477aa", "R2": "#ee7733", "hinge point": "#222222"}
_ROWS: Final = (("R2", "v2", "a2"), ("attitude", "omega2", "alpha2"))
_TITLES: Final = {
    "R2": "position of body 2, R2",
    "v2": "velocity, v2",
    "a2": "acceleration, a2",
    "attitude": "attitude of body 2, Euler angles XYZ",
    "omega2": "angular velocity, omega2",
    "alpha2": "angular acceleration, alpha2",
}


def plot(source: Source) -> Figure:
    """A figure of a motion: position, attitude and their rates over time, psi, paths in space, the residual of E1.

    Args:
        source: a scene or its result, a trajectory of `integrate` or `simulate`, or a pair, which then turns through
            its limits.

    Returns:
        A matplotlib Figure; `.savefig(path)` writes it. World axes; what the motion does not have stays out. Where
        something is not a finite number there is a gap, shaded.

    Raises:
        ArgumentError: what has no motion in space to show.
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
    pair, title, frames = frames_of(source)
    (_, _), (R2, S2) = frames.placements
    with np.errstate(invalid="ignore"):
        angles = continuous(matrix_to_euler(S2), proper=False)
    shown = {"R2": R2, "attitude": angles, **frames.readings}
    columns = max(sum(name in shown for name in row) for row in _ROWS)
    figure = Figure(figsize=(4.2 * max(columns, 2), 8.4), layout="constrained")
    figure.suptitle(title)
    grid = figure.add_gridspec(3, 2 * max(columns, 2), height_ratios=(1, 1, 1.25))
    first: Any = None
    for row, names in enumerate(_ROWS):
        for column, name in enumerate(name for name in names if name in shown):
            axes = figure.add_subplot(grid[row, 2 * column : 2 * column + 2], sharex=first)
            first = first or axes
            _over_time(axes, name, frames.t, shown[name])
    half = max(columns, 2)
    _in_space(figure.add_subplot(grid[2, :half], projection="3d"), pair, frames)
    lower = grid[2, half:].subgridspec(2, 1)
    psi = figure.add_subplot(lower[0], sharex=first)
    psi.plot(frames.t, frames.psi, color="#222222", lw=1.2)
    psi.set(title="hinge angle, psi", ylabel="rad")
    _shade(psi, frames.t, frames.psi)
    _gap(figure.add_subplot(lower[1], sharex=first), pair, frames)
    for axes in figure.axes:
        axes.tick_params(labelsize=8)
        axes.title.set_fontsize(9)
        if axes.name != "3d":
            axes.grid(alpha=0.3)
    return figure


def _over_time(axes: Axes, name: str, t: Array, values: Array) -> None:
    unit = "rad" if name == "attitude" else unit_of(name)
    for part, colour, letter, style in zip(values.T, _COLOURS, "xyz", ("-", "--", "-."), strict=True):
        axes.plot(t, part, style, color=colour, lw=1.2, label=letter)
    axes.set(title=_TITLES[name], ylabel=unit)
    _shade(axes, t, values)
    if name == "R2":
        axes.legend(fontsize=8, ncols=3)


def _shade(axes: Axes, t: Array, values: Array) -> None:
    """Grey where something is no finite number."""
    lost = ~np.isfinite(values.reshape(len(t), -1)).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]]).astype(int)))
    for start, stop in edges.reshape(-1, 2):
        axes.axvspan(t[max(start - 1, 0)], t[min(stop, len(t) - 1)], color="0.85", lw=0)


def _in_space(axes: Any, pair: HingePair, frames: Frames) -> None:
    """The paths of both reference points and of the hinge point, at one scale."""
    (R1, S1), (R2, _) = frames.placements
    for (name, colour), path in zip(_BODIES.items(), (R1, R2, R1 + S1 @ pair.u1), strict=True):
        axes.plot(*path.T, color=colour, lw=1.2, label=name)
        axes.plot(*path[:1].T, "o", color=colour, ms=3)
    axes.set(title="paths in space [m], from the dots", xlabel="x", ylabel="y", zlabel="z")
    axes.set_aspect("equal")
    axes.legend(fontsize=8)


def _gap(axes: Axes, pair: HingePair, frames: Frames) -> None:
    """The residual of E1 beside the rounding of the numbers that it is made of."""
    (R1, S1), (R2, S2) = frames.placements
    size = np.abs(R1).max(axis=1) + np.linalg.norm(pair.u1) + np.linalg.norm(pair.u2)
    gap = np.abs(R1 + S1 @ pair.u1 - R2 - S2 @ pair.u2).max(axis=1)
    least = np.finfo(float).eps / 2 * size
    axes.semilogy(frames.t, np.maximum(gap, least / 8), ".", color="#222222", ms=2, label="residual")
    axes.semilogy(frames.t, 16 * least, color=_COLOURS[1], lw=1, label="16 u scale")
    axes.set(title="residual of E1 (exact ones at the bottom)", ylabel="m", xlabel="t [s]")
    axes.legend(fontsize=8)
