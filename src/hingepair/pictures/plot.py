"""Plots of a motion: quantities over time, paths in space, and the residual of E1."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hingepair.measured.smooth import SmoothedAngle, SmoothedMotion
from hingepair.numeric.tables import unit_of
from hingepair.pictures.curves import (
    COLOURS,
    PATHS,
    Curve,
    Gathering,
    draw_paths,
    figure_class,
    finished,
    over_time,
    several,
)
from hingepair.pictures.frames import Array, Frames, Source, all_frames
from hingepair.pictures.mechanism_plot import plot_of_mechanism
from hingepair.pictures.smoothed_plot import plot_of_smoothed
from hingepair.scenes.mechanisms.scene import MechanismScene, MechanismSceneResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BODIES: Final = {"R1": "#4477aa", "R2": "#ee7733", "hinge point": "#222222"}
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


def plot(
    source: Source | MechanismScene | MechanismSceneResult | SmoothedMotion | SmoothedAngle,
    outputs: Iterable[str] | None = None,
) -> Figure:
    """Draw a motion: position, attitude and their rates over time, psi, paths in space, the residual of E1.

    Of a scene of a mechanism: position, rate and torque of each joint that moves, with its limits - those far from
    the curve are written - and the paths of the scene's frames. Or draw some outputs alone, each over time. Every
    sample counts: of more than 4,000 the curves go through the extremes of 2,000 intervals, so that fast oscillations
    fill a band and short spikes stay.

    Args:
        source: a scene or its result, a trajectory of `integrate` or `simulate`, or a pair, which then turns through
            its limits; or what `smooth` returned, which is drawn with a band of two standard deviations.
        outputs: what to draw instead, as for the scene's `evaluate`; of a trajectory what it has, of a pair R1, S1,
            R2, S2, psi. Attitudes are drawn as Euler angles XYZ.

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
    if isinstance(source, SmoothedMotion | SmoothedAngle):
        return plot_of_smoothed(source, outputs)
    if isinstance(source, MechanismScene | MechanismSceneResult):
        return plot_of_mechanism(source, outputs)
    title, curves = _curves(source, outputs)
    make = figure_class()
    return finished(_whole(make, curves) if outputs is None else several(make, curves, _labels), title)


def _curves(source: Source, outputs: Iterable[str] | None) -> tuple[str, dict[str, Curve]]:
    """Return the title of a figure and its curves by name: outputs, psi, the paths, and the residual of E1."""
    title, gathering = "", Gathering()
    for frames in all_frames(source, outputs):
        title = frames.title
        gathering.add(frames.t, frames.samples, frames.readings if outputs is not None else _quantities(frames))
    return title, gathering.curves()


def _quantities(frames: Frames) -> dict[str, Array]:
    """Return what a whole figure shows: R2, S2, rates and psi by name, the paths, and the residual of E1."""
    pair, (R1, R2, S2) = frames.pair, (frames.bodies[name] for name in ("R1", "R2", "S2"))
    scale = np.abs(R1).max(axis=1) + np.linalg.norm(pair.u1) + np.linalg.norm(pair.u2)
    with np.errstate(invalid="ignore"):
        gap = np.abs(frames.hinge - R2 - S2 @ pair.u2).max(axis=1)
        paths = np.concatenate([R1, R2, frames.hinge], axis=1)
    rounding = np.finfo(float).eps / 2 * scale
    quantities = {"R2": R2, "S2": S2, **frames.readings, "psi": frames.psi, PATHS: paths}
    return {**quantities, "gap": np.stack([gap, rounding], axis=1)}


def _labels(name: str) -> tuple[str, str]:
    """Return the title and the unit of an output."""
    return _TITLES.get(name, name), "rad" if name in _ATTITUDES else unit_of(name)


def _whole(make: type[Figure], curves: dict[str, Curve]) -> Figure:
    """Draw body 2 and its rates over time, the paths, psi and the residual of E1."""
    columns = max(2, *(sum(name in curves for name in row) for row in _ROWS))
    figure = make(figsize=(4.2 * columns, 8.4), layout="constrained")
    grid = figure.add_gridspec(3, 2 * columns, height_ratios=(1, 1, 1.25))
    first: Any = None
    for row, names in enumerate(_ROWS):
        for column, name in enumerate(name for name in names if name in curves):
            axes = figure.add_subplot(grid[row, 2 * column : 2 * column + 2], sharex=first)
            first = first or axes
            over_time(axes, *_labels(name), curves[name])
    points = np.split(curves[PATHS].values, 3, axis=1)
    draw_paths(figure, grid[2, :columns], dict(zip(_BODIES, points, strict=True)), tuple(_BODIES.values()))
    lower = grid[2, columns:].subgridspec(2, 1)
    over_time(figure.add_subplot(lower[0], sharex=first), *_labels("psi"), curves["psi"])
    _gap(figure.add_subplot(lower[1], sharex=first), curves["gap"])
    return figure


def _gap(axes: Axes, curve: Curve) -> None:
    """Draw the residual of E1 beside the rounding of the numbers that it is made of."""
    gap, rounding = curve.values.T
    label = "residual of E1, exact ones at the bottom"
    axes.semilogy(curve.t, np.maximum(gap, rounding / 8), ".", color="#222222", ms=2, label=label)
    axes.semilogy(curve.t, 16 * rounding, color=COLOURS[1], lw=1, label="16 u scale")
    axes.set(ylabel="m", xlabel="t [s]")
    axes.legend(fontsize=8, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 0.97), frameon=False)
