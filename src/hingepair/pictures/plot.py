"""Plots of a motion: quantities over time, and paths in space."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from hingepair.equations.quantities import ACCELERATION, unit_of
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.measured.smoothing.smooth import SmoothedAngle, SmoothedMotion
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.requests import constants_of
from hingepair.numeric.arrays import check_choice
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
from hingepair.pictures.moving import Array, Moving, Shown, moving
from hingepair.plans.pairs import point_outputs, unit_among
from hingepair.tables.units import Columns, Units

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Colours of the paths of the bodies' reference points and of the hinge point.
_PATH_COLOURS: Final = {"R1": "#4477aa", "R2": "#ee7733", "hinge point": "#222222"}
_POINT_COLOURS: Final = ("#d62839", "#228833", "#aa3377", "#bbaa00")  # of the paths of points, which repeat
# Outputs by row of panels, and in it by column.
_PANELS: Final = (("R2", "v2", "a2"), ("S2", "omega2", "alpha2"), ("hinge_torque", "hinge_force", "bearing_torque"))
_RATES: Final = ("v2", "omega2", "a2", "alpha2")  # two for each order of derivatives
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
    "hinge_torque": "torque about the hinge axis",
    "hinge_force": "force of the hinge on body 2",
    "bearing_torque": "torque across the hinge axis",
    "force1": "force on body 1, force1",
    "torque1": "torque on body 1, torque1",
}


def plot(
    source: Shown | SmoothedMotion | SmoothedAngle,
    outputs: Iterable[str] | None = None,
    units: str | None = None,
    *,
    q: ArrayLike | None = None,
    t: ArrayLike | None = None,
    base_motion: BodyMotion | None = None,
    qd: ArrayLike | None = None,
    tau: ArrayLike | None = None,
) -> Figure:
    """Return a Matplotlib figure of a motion (a scene or its result, a trajectory, a pair, a robot with coordinates,
    or the result of `smooth`). For the motion of a pair, the figure shows position,
    attitude, velocities and accelerations of body 2 and the hinge angle psi over time, the torque and the force of
    the hinge if body 2 has masses, and the paths of R1, R2, the hinge point and the points of the bodies. No file is
    written. For a robot or a scene of one, the figure shows position, rate
    and torque of each joint that moves, the limits of these quantities, and the paths of the frames of the scene, or
    else of the last links. For the result of `smooth`, the figure shows each smoothed quantity and its derivatives
    over time, with a band from two standard deviations below the curve to two above it. Limits far from the curve are
    given as text. No extreme value is lost: for more than 4,000 samples, the curves go through the smallest and the
    largest value of each of 2,000 intervals.

    Args:
        source: a scene or its result; a trajectory of `integrate` or `simulate`; a pair; a robot, with q; or the
            result of `smooth`.
            For a pair, the hinge angle moves from its lower to its upper limit and back, or through a whole turn if
            the pair has no limits. For a PlanarPair, give `pair.to_spatial()`.
        outputs: names of the outputs to draw over time instead of the whole figure. For a scene, these are outputs of
            its method `evaluate` and, of a pair with masses, hinge_torque, bearing_torque, hinge_force, force1 and
            torque1; for a trajectory or the result of `smooth`, outputs that it holds; for a pair, R1,
            S1, R2, S2, psi and its points. Attitudes are drawn as XYZ Euler angles.
        units: units in place of SI units, such as "deg, mm"; by default those of the scene.
        q: coordinates of a robot at T instants [rad or m]; shape (T, dof), in the order of `robot.names`, or a table
            with a column for each of these names.
        t: instants of q [s]; shape (T,), not decreasing; by default the curves are drawn over the number of the
            sample.
        base_motion: as for `view`: position and attitude of a robot's base, which the paths in space show.
        qd: rates of the coordinates [rad/s or m/s], in the forms of q; drawn if they are given.
        tau: torques and forces of the joints [N m or N], in the forms of q; drawn if they are given.

    Returns:
        A matplotlib Figure; `.savefig(path)` writes it. Vectors are in world axes. Quantities that the motion does
        not have are left out. Times at which a value is not finite are shaded.

    Raises:
        ArgumentError: the source is of another kind, or `outputs` names an
            output that the source does not have.
        MissingDependencyError: matplotlib is not installed.

    >>> import hingepair as hp
    >>> figure = hp.plot(hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1)))
    >>> [axes.get_title() for axes in figure.axes][:2]
    ['position of body 2, R2', 'attitude of body 2, Euler angles XYZ']
    """
    if outputs is not None:
        outputs = (outputs,) if isinstance(outputs, str) else tuple(outputs)
        if not outputs:
            raise ArgumentError("outputs", "a tuple of names such as ('R2', 'v2')", "none")
    if isinstance(source, SmoothedMotion | SmoothedAngle):
        return _plot_smoothed(source, outputs, units)
    if isinstance(source, Mechanism) and (outputs is not None or q is None):
        name, expected = ("q", "coordinates of the robot, as in hp.plot(robot, q=q)")
        if outputs is not None:
            name, expected = "outputs", "None, since q, qd and tau of a robot are drawn as given"
        raise ArgumentError(name, expected, quoted(outputs))
    shown = moving(source, q, t, base_motion, qd, tau)
    if isinstance(shown.subject, Mechanism):
        has_instants = t is not None or shown.scene is not None
        shown = shown if has_instants else shown._replace(t=np.arange(float(len(shown.t))))
        return plot_mechanism(shown, outputs, units, has_instants=has_instants)
    pair, scene = shown.subject, shown.scene
    points = point_outputs(constants_of(pair).points)
    columns = (
        Columns(Units.of(units), lambda name: unit_among(points, name)) if scene is None else scene.in_units(units)
    )
    columns = columns._replace(si_unit=_drawn_unit(columns.si_unit))
    collector, title = CurveCollector(), shown.title if scene is not None or isinstance(source, HingePair) else ""
    if outputs is not None:
        _collect_outputs(shown, outputs, collector)
        curves = collector.curves(columns)
        return finish_figure(draw_side_by_side(figure_class(), curves, lambda n: _title_and_unit(n, columns)), title)
    paths = _collect_motion(shown, pair, collector)
    return finish_figure(_draw_motion(figure_class(), collector.curves(columns), columns, paths), title)


def _drawn_unit(unit: Callable[[str], str]) -> Callable[[str], str]:
    """Return the function from the name of a curve to its SI unit that extends `unit`, that of quantities."""
    own = {**dict.fromkeys(_AS_ANGLES, "rad"), PATHS: "m"}
    return lambda name: own.get(name) or unit(name)


def _chosen(arrays: Mapping[str, Array], names: Iterable[str] | None) -> dict[str, Array]:
    """Return the arrays of these names; all for None."""
    for name in names or ():
        if name not in arrays:
            raise ArgumentError("outputs", choices(tuple(arrays)), quoted(name))
    return {name: arrays[name] for name in (arrays if names is None else names)}


def _collect_outputs(shown: Moving, outputs: tuple[str, ...], collector: CurveCollector) -> None:
    """Collect the curves of outputs of a pair."""
    if shown.scene is None:
        collector.add_piece(shown.t, len(shown.t), _chosen(shown.arrays, outputs))
        return
    for part in shown.scene.blocks(outputs):
        collector.add_piece(part.t, len(shown.t), part.requested_arrays())


def _collect_motion(shown: Moving, pair: HingePair, collector: CurveCollector) -> tuple[str, ...]:
    """Collect all curves of a figure of a pair; return the names of the paths."""
    points = (*pair.points1, *pair.points2)
    for rows, known in shown.pieces(ACCELERATION):
        names = ("R1", "S1", "R2", "S2", *points, *_RATES[: 2 * known.level])
        arrays = pair.forward_kinematics_from_body1(known.body1, *known.hinge, outputs=names).arrays()
        recorded = {name: shown.arrays[name][rows] for name in _RATES if name in shown.arrays}
        rates = {name: arrays[name] for name in names[4 + len(points) :]} or recorded
        with np.errstate(invalid="ignore"):
            hinge = arrays["R1"] + arrays["S1"] @ pair.u1
        path = np.concatenate([arrays["R1"], arrays["R2"], hinge, *(arrays[name] for name in points)], axis=1)
        own = {"R2": arrays["R2"], "S2": arrays["S2"], **rates, "psi": known.psi, PATHS: path}
        collector.add_piece(shown.t[rows], len(shown.t), own)
    loads = {name: shown.arrays[name] for name in ("hinge_torque",) if name in shown.arrays}
    scene = shown.scene
    if scene is not None and pair.body2 is not None and scene.motion.level == ACCELERATION:
        forces = ("hinge_torque", "hinge_force", *["bearing_torque"] * (scene.dimensions == 3))
        loads = scene.arrays(forces)
    if loads:
        collector.add_piece(shown.t, len(shown.t), loads)
    return ("R1", "R2", "hinge point", *points)


def _title_and_unit(name: str, columns: Columns) -> tuple[str, str]:
    """Return the title of an output's panel, and the unit of the output."""
    return _TITLES.get(name, name), columns.unit(name)


def _draw_motion(
    figure_type: type[Figure], curves: dict[str, Curve], columns: Columns, paths: Sequence[str]
) -> Figure:
    """Return a new figure of a pair's motion: curves over time, and paths in space."""
    panels = [own for names in _PANELS if (own := [name for name in names if name in curves])]
    beside = ["psi", *(panels.pop() if panels[-1] == ["hinge_torque"] else [])]  # one panel is no row
    width = max(2, *map(len, panels))
    figure = figure_type(figsize=(4.2 * width, 3.1 + 2.65 * len(panels)), layout="constrained")
    grid = figure.add_gridspec(len(panels) + 1, 2 * width, height_ratios=(*[1] * len(panels), 1.25))
    first: Any = None
    for row, names in enumerate(panels):
        for column, name in enumerate(names):
            axes = figure.add_subplot(grid[row, 2 * column : 2 * column + 2], sharex=first)
            first = first or axes
            draw_over_time(axes, *_title_and_unit(name, columns), curves[name])
    points = dict(zip(paths, np.split(curves[PATHS].values, len(paths), axis=1), strict=True))
    others = itertools.cycle(_POINT_COLOURS)
    colours = [_PATH_COLOURS.get(name) or next(others) for name in paths]
    draw_paths(figure, grid[-1, :width], points, colours, columns.unit(PATHS))
    lower = grid[-1, width:].subgridspec(len(beside), 1)
    for row, shown in enumerate(beside):
        axes = figure.add_subplot(lower[row], sharex=first)
        draw_over_time(axes, *_title_and_unit(shown, columns), curves[shown])
    return figure


def _plot_smoothed(
    source: SmoothedMotion | SmoothedAngle, outputs: tuple[str, ...] | None, units: str | None
) -> Figure:
    """Return the figure of the result of `smooth`: its quantities over time, with bands of two standard deviations
    (none of the attitude, which is drawn as Euler angles XYZ).
    """
    is_angle = isinstance(source, SmoothedAngle)
    known = ("psi", "psid", "psidd") if is_angle else ("R", "v", "a", "S", "omega", "alpha")
    for name in outputs or ():
        check_choice("outputs", name, known)
    collector = CurveCollector()
    collector.add_piece(source.t, source.t.size, {name: getattr(source, name) for name in outputs or known})
    columns = Columns(Units.of(units), lambda name: "rad" if name == "S" else unit_of(name))
    curves = collector.curves(columns)
    figure = draw_side_by_side(figure_class(), curves, lambda name: (name, columns.unit(name)))
    instants = Curve(source.t, source.t).converted("t", columns).t
    for axes, (name, curve) in zip(figure.axes, curves.items(), strict=True):
        if name == "S":
            continue
        std = columns.converted(name, np.asarray(source.std[name]).reshape(source.t.size, -1))
        values = curve.values.reshape(curve.t.size, -1)
        colours = XYZ_COLOURS if values.shape[1] > 1 else ("#222222",)
        for column, deviations, colour in zip(values.T, std.T, colours, strict=False):
            half = 2 * np.interp(curve.t, instants, deviations)
            axes.fill_between(curve.t, column - half, column + half, color=colour, alpha=0.25, lw=0)
    return finish_figure(figure, "smoothed: curves, and bands of two standard deviations")
