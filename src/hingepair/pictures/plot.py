"""Plots of a motion: quantities over time, paths in space, and the residual of E1."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hingepair.dynamics.simulate_robot import SimulatedRobotMotion
from hingepair.equations.quantities import unit_of
from hingepair.measured.smoothing.smooth import SmoothedAngle, SmoothedMotion
from hingepair.pictures.curves import (
    PATHS,
    XYZ_COLOURS,
    Curve,
    CurveCollector,
    draw_over_time,
    draw_paths,
    draw_side_by_side,
    figure_class,
    finish_figure,
)
from hingepair.pictures.mechanism_plot import plot_mechanism
from hingepair.pictures.motion_samples import Array, MotionSource, ShownMotion, sample_pieces
from hingepair.pictures.smoothed_plot import plot_smoothed
from hingepair.scenes.robot_scene import RobotResult, RobotScene, scene_of_simulation

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours of the paths of the bodies' reference points and of the hinge point.
_PATH_COLOURS: Final = {"R1": "#4477aa", "R2": "#ee7733", "hinge point": "#222222"}
# Outputs in the rows of panels, by column.
_PANELS: Final = (("R2", "v2", "a2"), ("S2", "omega2", "alpha2"))
_AS_ANGLES: Final = ("S1", "S2")  # drawn as Euler angles
# Titles of the panels, by output.
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
    source: MotionSource | RobotScene | RobotResult | SimulatedRobotMotion | SmoothedMotion | SmoothedAngle,
    outputs: Iterable[str] | None = None,
) -> Figure:
    """Return a Matplotlib figure of a motion (a scene or its result, a trajectory, a pair or the result of `smooth`).
    For the motion of a pair, the figure shows position, attitude, velocities and accelerations of body 2 and the
    hinge angle psi over time, the paths of R1, R2 and the hinge point, and the residual of equation E1. No file is
    written.

    Equation E1 says that R1 + S1 u1 and R2 + S2 u2 are the same point, the hinge point. The residual is the largest
    component of the difference between the two [m]. For a scene of a robot, the figure shows position, rate and
    torque of each joint that moves, the limits of these quantities, and the paths of the frames of the scene. For the
    result of `smooth`, the figure shows each smoothed quantity and its derivatives over time, with a band from two
    standard deviations below the curve to two above it. Limits far from the curve are given as text. No extreme value
    is lost: for more than 4,000 samples, the curves go through the smallest and the largest value of each of 2,000
    intervals.

    Args:
        source: a scene or its result; a trajectory of `integrate` or `simulate`; a pair; or the result of `smooth`.
            For a pair, the hinge angle moves from its lower to its upper limit and back, or through a whole turn if
            the pair has no limits. For a PlanarPair, give `pair.to_spatial()`. The result of
            `simulate` for a PlanarPair can be drawn, but the result of `integrate` for it cannot.
        outputs: names of the outputs to draw over time instead of the whole figure. For a scene, these are outputs of
            its method `evaluate`; for a trajectory or the result of `smooth`, outputs that it holds; for a pair, R1,
            S1, R2, S2 and psi. Attitudes are drawn as XYZ Euler angles.

    Returns:
        A matplotlib Figure; `.savefig(path)` writes it. Vectors are in world axes. Quantities that the motion does
        not have are left out. Times at which a value is not finite are shaded.

    Raises:
        ArgumentError: the source is of another kind or is a trajectory that holds many motions, or `outputs` names an
            output that the source does not have.
        MissingDependencyError: matplotlib is not installed.

    >>> import hingepair as hp
    >>> figure = hp.plot(hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1)))
    >>> [axes.get_title() for axes in figure.axes][:2]
    ['position of body 2, R2', 'attitude of body 2, Euler angles XYZ']
    """
    if isinstance(source, SmoothedMotion | SmoothedAngle):
        return plot_smoothed(source, outputs)
    if isinstance(source, SimulatedRobotMotion):
        source = scene_of_simulation(source)
    if isinstance(source, RobotScene | RobotResult):
        return plot_mechanism(source, outputs)
    title, curves = _collect_curves(source, outputs)
    figure_type = figure_class()
    return finish_figure(
        _draw_motion(figure_type, curves)
        if outputs is None
        else draw_side_by_side(figure_type, curves, _title_and_unit),
        title,
    )


def _collect_curves(source: MotionSource, outputs: Iterable[str] | None) -> tuple[str, dict[str, Curve]]:
    """Collect the curves of the outputs named in `outputs` or, if it is None, of all quantities that a
    figure shows.
    """
    title, collector = "", CurveCollector()
    for samples in sample_pieces(source, outputs):
        title = samples.title
        collector.add_piece(
            samples.t,
            samples.samples,
            samples.outputs_by_name if outputs is not None else _plotted_quantities(samples),
        )
    return title, collector.curves()


def _plotted_quantities(samples: ShownMotion) -> dict[str, Array]:
    """Return a dict of arrays by name, all that a figure shows without `outputs`, computed from samples of a pair's
    motion: R2, S2, the velocities and accelerations of body 2, psi, the paths of both bodies and of the hinge point
    in one array (N, 9), and the residual of E1 with its rounding error, (N, 2).
    """
    pair, (R1, R2, S2) = samples.pair, (samples.pose_arrays_by_name[name] for name in ("R1", "R2", "S2"))
    scale = np.abs(R1).max(axis=1) + np.linalg.norm(pair.u1) + np.linalg.norm(pair.u2)
    with np.errstate(invalid="ignore"):
        residual = np.abs(samples.hinge - R2 - S2 @ pair.u2).max(axis=1)
        paths = np.concatenate([R1, R2, samples.hinge], axis=1)
    rounding = np.finfo(float).eps / 2 * scale
    quantities = {
        "R2": R2,
        "S2": S2,
        **samples.outputs_by_name,
        "psi": samples.psi,
        PATHS: paths,
    }
    return {**quantities, "residual": np.stack([residual, rounding], axis=1)}


def _title_and_unit(name: str) -> tuple[str, str]:
    """Return the title of the panel of the output called `name`, and the unit of the output, as two strings."""
    return _TITLES.get(name, name), "rad" if name in _AS_ANGLES else unit_of(name)


def _draw_motion(figure_type: type[Figure], curves: dict[str, Curve]) -> Figure:
    """Draw the curves of a pair's motion, a dict by name, the paths in space and the residual of E1 in a new figure
    of the class `figure_type`; return the figure.
    """
    columns = max(2, *(sum(name in curves for name in row) for row in _PANELS))
    figure = figure_type(figsize=(4.2 * columns, 8.4), layout="constrained")
    grid = figure.add_gridspec(3, 2 * columns, height_ratios=(1, 1, 1.25))
    first: Any = None
    for row, names in enumerate(_PANELS):
        for column, name in enumerate(name for name in names if name in curves):
            axes = figure.add_subplot(grid[row, 2 * column : 2 * column + 2], sharex=first)
            first = first or axes
            draw_over_time(axes, *_title_and_unit(name), curves[name])
    points = np.split(curves[PATHS].values, 3, axis=1)
    draw_paths(
        figure,
        grid[2, :columns],
        dict(zip(_PATH_COLOURS, points, strict=True)),
        tuple(_PATH_COLOURS.values()),
    )
    lower = grid[2, columns:].subgridspec(2, 1)
    draw_over_time(figure.add_subplot(lower[0], sharex=first), *_title_and_unit("psi"), curves["psi"])
    _draw_residual(figure.add_subplot(lower[1], sharex=first), curves["residual"])
    return figure


def _draw_residual(axes: Axes, curve: Curve) -> None:
    """Draw the residual of equation E1 [m] and 16 times its rounding error over time into Matplotlib axes, on a
    logarithmic scale.
    """
    residual, rounding = curve.values.T
    label = "residual of E1, exact ones at the bottom"
    axes.semilogy(curve.t, np.maximum(residual, rounding / 8), ".", color="#222222", ms=2, label=label)
    axes.semilogy(curve.t, 16 * rounding, color=XYZ_COLOURS[1], lw=1, label="16 u scale")
    axes.set(ylabel="m", xlabel="t [s]")
    axes.legend(fontsize=8, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 0.97), frameon=False)
