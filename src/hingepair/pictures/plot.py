"""Plots of a motion: quantities over time, paths in space, and the residual of E1."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from hingepair.equations.quantities import ACCELERATION
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.measured.smoothing.smooth import SmoothedAngle, SmoothedMotion
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.pairs.geometry import constants_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.results import MAX_HELD_INSTANTS, Record, Result
from hingepair.motion.simulated import SimulatedMotion, SimulatedPlanarMotion, SimulatedRobotMotion
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
from hingepair.pictures.mechanism_plot import plot_mechanism, plot_robot
from hingepair.pictures.motion_samples import Array, MotionSource, ShownMotion, sample_pieces
from hingepair.pictures.robot_motion import read_robot_motion
from hingepair.pictures.smoothed_plot import plot_smoothed
from hingepair.plans.pairs import point_outputs, unit_among
from hingepair.scenes.scene import Scene, SceneResult, scene_of_simulation
from hingepair.scenes.subjects.pair import PAIR_FORCES
from hingepair.tables.units import Columns, Units

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours of the paths of the bodies' reference points and of the hinge point.
_PATH_COLOURS: Final = {"R1": "#4477aa", "R2": "#ee7733", "hinge point": "#222222"}
# Outputs by row of panels, and in it by column.
_PANELS: Final = (("R2", "v2", "a2"), ("S2", "omega2", "alpha2"), ("hinge_torque", "hinge_force", "bearing_torque"))
_AS_ANGLES: Final = ("S1", "S2")  # drawn as Euler angles
_RESIDUAL: Final = "residual"  # name of the curve of the residual of E1
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
    source: MotionSource | Mechanism | SimulatedRobotMotion | SmoothedMotion | SmoothedAngle | Record,
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
    or the result of `smooth`) or of the forces of a scene. For the motion of a pair, the figure shows position,
    attitude, velocities and accelerations of body 2 and the hinge angle psi over time, the torque and the force of
    the hinge if body 2 has masses, the paths of R1, R2 and the hinge point, and the residual of equation E1. No file
    is written.

    Equation E1 says that R1 + S1 u1 and R2 + S2 u2 are the same point, the hinge point. The residual is the largest
    component of the difference between the two [m]. For a robot or a scene of one, the figure shows position, rate
    and torque of each joint that moves, the limits of these quantities, and the paths of the frames of the scene, or
    else of the last links. For the result of `smooth`, the figure shows each smoothed quantity and its derivatives
    over time, with a band from two standard deviations below the curve to two above it. Limits far from the curve are
    given as text. No extreme value is lost: for more than 4,000 samples, the curves go through the smallest and the
    largest value of each of 2,000 intervals.

    Args:
        source: a scene or its result; a trajectory of `integrate` or `simulate`; a pair; a robot, with q; the result
            of `smooth`; or the forces of a scene, `scene.forces()`.
            For a pair, the hinge angle moves from its lower to its upper limit and back, or through a whole turn if
            the pair has no limits. For a PlanarPair, give `pair.to_spatial()`. The result of
            `simulate` for a PlanarPair can be drawn, but the result of `integrate` for it cannot.
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
        ArgumentError: the source is of another kind or is a trajectory that holds many motions, or `outputs` names an
            output that the source does not have.
        MissingDependencyError: matplotlib is not installed.

    >>> import hingepair as hp
    >>> figure = hp.plot(hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1)))
    >>> [axes.get_title() for axes in figure.axes][:2]
    ['position of body 2, R2', 'attitude of body 2, Euler angles XYZ']
    """
    given: dict[str, Any] = {"q": q, "t": t, "base_motion": base_motion, "qd": qd, "tau": tau}
    if isinstance(source, Mechanism):
        if outputs is not None:
            raise ArgumentError("outputs", "None, since q, qd and tau of a robot are drawn as given", quoted(outputs))
        return _plot_given(source, units, **given)
    for name, value in given.items():
        if value is not None:
            raise ArgumentError(name, "None, since only a robot (a Mechanism) takes a motion", quoted(value))
    if isinstance(source, SmoothedMotion | SmoothedAngle):
        return plot_smoothed(source, outputs, units)
    if isinstance(source, SimulatedRobotMotion):
        source = scene_of_simulation(source)
    source = source.scene if isinstance(source, SceneResult) else source
    if isinstance(source, Scene) and source.mechanism is not None:
        return plot_mechanism(source, outputs, units)
    points = point_outputs(constants_of(source).points) if isinstance(source, HingePair) else ()
    columns = Columns(Units.of(units), lambda name: unit_among(points, name))
    columns = source.in_units(units) if isinstance(source, Scene | Result) else columns
    columns = columns._replace(si_unit=_drawn_unit(columns.si_unit))
    if outputs is not None:
        outputs = (outputs,) if isinstance(outputs, str) else tuple(outputs)
        if not outputs:
            raise ArgumentError("outputs", "a tuple of names such as ('R2', 'v2')", "none")
    if isinstance(source, Record):
        title, collector = source.described, _collect_record(source, outputs)
    else:
        title, collector = _collect_motion(source, outputs)
    curves, figure_type = collector.curves(columns, lambda name: name not in {PATHS, _RESIDUAL}), figure_class()
    if outputs is None and not isinstance(source, Record):
        return finish_figure(_draw_motion(figure_type, curves, columns), title)
    return finish_figure(draw_side_by_side(figure_type, curves, lambda name: _title_and_unit(name, columns)), title)


def _plot_given(
    robot: Mechanism, units: str | None, *, q: Any, t: Any, base_motion: BodyMotion | None, **others: Any
) -> Figure:
    """Return the figure of the motion of a robot that is given as arrays; refuse it without q."""
    if q is None:
        raise ArgumentError("q", "coordinates of the robot, as in hp.plot(robot, q=q)", None)
    motion = read_robot_motion(robot, q, t, base_motion, rate=1.0, **others)
    return plot_robot(robot, motion, has_instants=t is not None, units=units)


def _drawn_unit(unit: Callable[[str], str]) -> Callable[[str], str]:
    """Return the function from the name of a curve to its SI unit that extends `unit`, that of quantities."""
    own = {**dict.fromkeys(_AS_ANGLES, "rad"), PATHS: "m", _RESIDUAL: "m"}
    return lambda name: own.get(name) or unit(name)


def _collect_record(source: Record, outputs: tuple[str, ...] | None) -> CurveCollector:
    """Return the curves of the arrays of a record, or of some of them."""
    arrays, collector = source.recorded(), CurveCollector()
    for name in outputs or ():
        if name not in arrays:
            raise ArgumentError("outputs", choices(tuple(arrays)), quoted(name))
    collector.add_piece(source.t, len(source.t), {name: arrays[name] for name in outputs or arrays})
    return collector


def _collect_motion(source: MotionSource, outputs: tuple[str, ...] | None) -> tuple[str, CurveCollector]:
    """Return the title of a motion, and the curves of `outputs` or, if it is None, of all that a figure shows."""
    collector = CurveCollector()
    t, loads = _loads(source, outputs)
    moving = None if outputs is None else tuple(name for name in outputs if name not in loads)
    title = source.title if isinstance(source, Scene) else ""
    for samples in sample_pieces(source, moving) if moving != () else ():
        title = samples.title
        collector.add_piece(
            samples.t,
            samples.samples,
            samples.outputs_by_name if outputs is not None else _plotted_quantities(samples),
        )
    if loads:
        collector.add_piece(t, len(t), loads)
    return title, collector


def _loads(source: MotionSource, outputs: tuple[str, ...] | None) -> tuple[Array, dict[str, Array]]:
    """Return instants, and of a pair with masses the forces among `outputs`, by default those of the hinge."""
    if isinstance(source, Scene):
        names = [name for name in outputs or () if name in PAIR_FORCES]
        known = source.space.body2 is not None and source.motion.level == ACCELERATION
        if outputs is None and known and source.samples <= MAX_HELD_INSTANTS:
            names = ["hinge_torque", "hinge_force", *["bearing_torque"] * (source.dimensions == 3)]
        return (source.t, source.arrays(names)) if names else (np.zeros(0), {})
    if outputs is None and isinstance(source, SimulatedMotion | SimulatedPlanarMotion):
        return source.t, {"hinge_torque": source.recorded()["hinge_torque"]}
    return np.zeros(0), {}


def _plotted_quantities(samples: ShownMotion) -> dict[str, Array]:
    """Return all that a figure shows without `outputs`, by name, the paths of R1, R2 and the hinge point in one array
    (N, 9), and the residual of E1 and its rounding error in another (N, 2).
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
    return {**quantities, _RESIDUAL: np.stack([residual, rounding], axis=1)}


def _title_and_unit(name: str, columns: Columns) -> tuple[str, str]:
    """Return the title of an output's panel, and the unit of the output."""
    return _TITLES.get(name, name), columns.unit(name)


def _draw_motion(figure_type: type[Figure], curves: dict[str, Curve], columns: Columns) -> Figure:
    """Return a new figure of a pair's motion: curves over time, paths in space, and the residual of E1."""
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
    points = np.split(curves[PATHS].values, 3, axis=1)
    draw_paths(
        figure,
        grid[-1, :width],
        dict(zip(_PATH_COLOURS, points, strict=True)),
        tuple(_PATH_COLOURS.values()),
        columns.unit(PATHS),
    )
    lower = grid[-1, width:].subgridspec(len(beside) + 1, 1)
    for row, shown in enumerate(beside):
        axes = figure.add_subplot(lower[row], sharex=first)
        draw_over_time(axes, *_title_and_unit(shown, columns), curves[shown])
    _draw_residual(figure.add_subplot(lower[-1], sharex=first), curves[_RESIDUAL], columns.unit(_RESIDUAL))
    return figure


def _draw_residual(axes: Axes, curve: Curve, unit: str) -> None:
    """Draw the residual of equation E1 and 16 times its rounding error over time into Matplotlib axes, on a
    logarithmic scale.
    """
    residual, rounding = curve.values.T
    label = "residual of E1, exact ones at the bottom"
    axes.semilogy(curve.t, np.maximum(residual, rounding / 8), ".", color="#222222", ms=2, label=label)
    axes.semilogy(curve.t, 16 * rounding, color=XYZ_COLOURS[1], lw=1, label="16 u scale")
    axes.set(ylabel=unit, xlabel=curve.t_label)
    axes.legend(fontsize=8, ncols=2, loc="lower center", bbox_to_anchor=(0.5, 0.97), frameon=False)
