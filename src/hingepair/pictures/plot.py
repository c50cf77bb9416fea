"""Plots of a motion: quantities over time, and paths in space."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hingepair.equations.quantities import ACCELERATION, unit_of
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.requests import subject_of
from hingepair.mechanism.results import OverInstants, Record
from hingepair.numeric.arrays import check_choice
from hingepair.pictures.curves import (
    COLOURS,
    PATHS,
    XYZ_COLOURS,
    Curve,
    CurveCollector,
    Panel,
    draw_figure,
    plain,
)
from hingepair.pictures.moving import Array, Moving, Shown, moving
from hingepair.plans.pairs import point_outputs, unit_among
from hingepair.tables.units import Columns, Units

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Colours of the paths of the bodies' reference points and of the hinge point.
_PATH_COLOURS: Final = {"R1": "#4477aa", "R2": "#ee7733", "hinge point": "#222222"}
_POINT_COLOURS: Final = ("#d62839", "#228833", "#aa3377", "#bbaa00")  # of the paths of points, which repeat
# Outputs of pairs by row of panels, and in it by column.
_PANELS: Final = (
    ("R2", "v2", "a2"), ("S2", "omega2", "alpha2"), ("psi", "hinge_torque", "hinge_force"), ("bearing_torque",)
)  # fmt: skip
_RATES: Final = ("v2", "omega2", "a2", "alpha2")  # two for each order of derivatives
# Titles of the panels, by output, or by quantity of joints.
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
_OF_JOINTS: Final = {"q": "position", "qd": "rate", "tau": "torque or force"}  # titles of columns of panels


def plot(
    source: Shown | OverInstants,
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
    or the result of `smooth` or of a fit). For the motion of a pair, the figure shows position, attitude, velocities
    and accelerations of body 2 and the hinge angle psi over time, the torque and the force of the hinge if body 2 has
    masses, and the paths of R1, R2, the hinge point and the points of the bodies. For a robot or a scene of one, it
    shows position, rate and torque of each joint that moves, the limits that these come near, and the paths of the
    frames of the scene, or else of the last links. For the result of `smooth` or a fit, it shows each quantity and
    its derivatives over time, with a band from two standard deviations below the curve to two above it. No extreme
    value is lost: for more than 4,000 samples, the curves go through the smallest and the largest value of each of
    2,000 intervals. No file is written.

    Args:
        source: a scene or its result; a trajectory of `integrate` or `simulate`; a pair; a robot, with q; or the
            result of `smooth`, `fit` or `fit_imus`.
            For a pair, the hinge angle moves from its lower to its upper limit and back, or through a whole turn if
            the pair has no limits. For a PlanarPair, give `pair.to_spatial()`.
        outputs: names of the outputs to draw over time instead of the whole figure. For a scene, these are outputs of
            its method `evaluate` and, of a pair with masses, hinge_torque, bearing_torque, hinge_force, force1 and
            torque1; for a trajectory or the result of `smooth` or a fit, outputs that it holds; for a pair, R1,
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
    if isinstance(source, OverInstants):
        return _plot_record(source.record(), outputs, units)
    if isinstance(source, Mechanism) and (outputs is not None or q is None):
        name, expected = ("q", "coordinates of the robot, as in hp.plot(robot, q=q)")
        if outputs is not None:
            name, expected = "outputs", "None, since q, qd and tau of a robot are drawn as given"
        raise ArgumentError(name, expected, quoted(outputs))
    shown, t_label = moving(source, q, t, base_motion, qd, tau), ""
    if isinstance(source, Mechanism) and t is None:
        shown, t_label = shown._replace(t=np.arange(float(len(shown.t)))), "sample"
    title = shown.title if shown.scene is not None or isinstance(source, HingePair | Mechanism) else ""
    columns = _columns(shown, units)
    if outputs is not None:
        curves = _outputs(shown, outputs, columns)
        return draw_figure(title, _side_by_side(_panels(curves, columns)), curves, columns)
    if isinstance(shown.subject, Mechanism):
        rows, curves, paths = _robot(shown, shown.subject, columns)
        return draw_figure(title, rows, curves, columns, t_label=t_label, paths=paths, height=1.5)
    curves, paths = _pair(shown, shown.subject, columns)
    rows = [_panels([name for name in names if name in curves], columns) for names in _PANELS]
    return draw_figure(title, [row for row in rows if row], curves, columns, paths=paths)


def _columns(shown: Moving, units: str | None) -> Columns:
    """Return the units of curves. Rotation matrices are drawn as Euler angles; `q_elbow` is a joint's coordinate."""
    subject, scene = shown.subject, shown.scene
    own = {PATHS: "m", "S1": "rad", "S2": "rad"}
    unit: Callable[[str], str]
    if isinstance(subject, Mechanism):
        for row in _joint_rows(shown, subject):
            own |= zip((f"{quantity}_{row.name}" for quantity in _OF_JOINTS), row.units, strict=True)
        unit = unit_of if scene is None else scene.unit
    else:
        points = point_outputs(subject_of(subject).points)
        unit = (lambda name: unit_among(points, name)) if scene is None else scene.in_units(units).si_unit
    of_units = Units.of(units) if scene is None else scene.in_units(units).units

    def si_unit(name: str) -> str:
        return own.get(name) or ("rad" if _is_attitude(name) else unit(name))

    return Columns(of_units, si_unit)


def _is_attitude(name: str) -> bool:
    """Return whether an output is a rotation matrix of a frame."""
    return name.startswith("S_")


def _panels(names: Iterable[str], columns: Columns) -> list[Panel]:
    """Return a panel for each curve."""
    titles = {name: f"{name}, Euler angles XYZ" if _is_attitude(name) else name for name in names}
    return [Panel((one,), plain(_TITLES.get(one, title)), columns.unit(one)) for one, title in titles.items()]


def _side_by_side(panels: list[Panel]) -> list[list[Panel]]:
    """Return rows of up to three panels."""
    return [panels[start : start + 3] for start in range(0, len(panels), 3)]


def _outputs(shown: Moving, outputs: tuple[str, ...], columns: Columns) -> dict[str, Curve]:
    """Return the curves of outputs."""
    collector = CurveCollector()
    if shown.scene is None:
        for name in outputs:
            if name not in shown.arrays:
                raise ArgumentError("outputs", choices(tuple(shown.arrays)), quoted(name))
        collector.add_piece(shown.t, len(shown.t), {name: shown.arrays[name] for name in outputs})
    else:
        for part in shown.scene.blocks(outputs):
            collector.add_piece(part.t, len(shown.t), part.requested_arrays())
    return collector.curves(columns)


def _pair(shown: Moving, pair: HingePair, columns: Columns) -> tuple[dict[str, Curve], dict[str, str]]:
    """Return all curves of a figure of a pair, and the colours of the paths."""
    points, collector = (*pair.points1, *pair.points2), CurveCollector()
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
    return collector.curves(columns), _PATH_COLOURS | dict(zip(points, itertools.cycle(_POINT_COLOURS), strict=False))


class _JointRow(NamedTuple):
    """What is drawn of a joint, or of a strut, which is like a slider: length, rate and force."""

    name: str
    units: tuple[str, str, str]  # of q, qd and tau
    limits: tuple[tuple[float, float], ...]  # of q, qd and tau


def _joint_rows(shown: Moving, robot: Mechanism) -> list[_JointRow]:
    """Return the joints of a robot that move, and its struts."""
    moves = robot.names if shown.scene is None else shown.scene.motion.moving
    rows = []
    for joint in tree_of(robot).coordinates:
        limits = joint.position_limits, (-joint.rate_limit, joint.rate_limit), joint.effort_bounds
        if joint.name in moves:
            rows.append(_JointRow(joint.name, (joint.unit, f"{joint.unit}/s", joint.effort_unit), limits))
    struts = [strut for strut in tree_of(robot).struts if strut.name not in robot.names]
    free = (-np.inf, np.inf)
    return rows + [_JointRow(strut.name, ("m", "m/s", "N"), (strut.limits, free, free)) for strut in struts]


def _robot(
    shown: Moving, robot: Mechanism, columns: Columns
) -> tuple[list[list[Panel]], dict[str, Curve], dict[str, str]]:
    """Return a row of panels for each joint, or of more than 12 for several with the same unit, all curves of a
    figure of a robot, and the colours of the paths.
    """
    scene, drawn, tau, collector = shown.scene, _joint_rows(shown, robot), shown.tau(), CurveCollector()
    frames, has_struts = robot.tips if scene is None else scene.frames, bool(tree_of(robot).struts)
    wanted = {f"{quantity}_{row.name}" for row in drawn for quantity in _OF_JOINTS}
    for rows, known in shown.pieces(1):
        given = {name: shown.arrays[name][rows] for name in ("qd",) if name in shown.arrays}
        arrays: dict[str, Array] = {"q": known.array(0), **({"qd": known.array(1)} if known.level else given)}
        arrays |= {} if tau is None else {"tau": tau[rows]}
        curves = {f"{kind}_{name}": a[:, i] for kind, a in arrays.items() for i, name in enumerate(robot.names)}
        for name, strut in robot.struts(arrays["q"], arrays.get("qd")).items() if has_struts else ():
            known_parts = (strut.length, *((strut.rate, strut.force) if "qd" in arrays else ()))
            curves |= {f"{kind}_{name}": part for kind, part in zip(_OF_JOINTS, known_parts, strict=False)}
        curves = {name: curve for name, curve in curves.items() if name in wanted}
        if frames:
            state = robot.forward_kinematics(
                arrays["q"], frames=frames, outputs=("R",), base_motion=known.base_motion
            )
            curves[PATHS] = np.concatenate([np.broadcast_to(state[f].R, (known.count, 3)) for f in frames], axis=1)
        collector.add_piece(shown.t[rows], len(shown.t), curves)
    found, size = collector.curves(columns), -(-len(drawn) // 12)
    alike = [[row for row in drawn if row.units == units] for units in dict.fromkeys(row.units for row in drawn)]
    groups = [own[start : start + size] for own in alike for start in range(0, len(own), size)]
    panels: list[list[Panel]] = []
    for group in groups:
        panels.append([])
        for kind, quantity in enumerate(_OF_JOINTS):
            names = [name for row in group if (name := f"{quantity}_{row.name}") in found]
            if names:
                limits = [columns.converted(names[0], np.array(row.limits[kind])).tolist() for row in group]
                label = f"[{columns.unit(names[0])}]" if size > 1 else columns.unit(names[0])
                if not panels[-1] and size == 1:
                    label = f"{_shortened(group[0].name)}\n[{label}]"
                title = _OF_JOINTS[quantity] if len(panels) == 1 else ""
                legend = [_shortened(row.name) for row in group] if size > 1 else []
                panels[-1].append(Panel(names, title, label, legend, limits))
    return panels, found, dict(zip(frames if PATHS in found else (), itertools.cycle(COLOURS), strict=False))


def _shortened(name: str) -> str:
    """Return a name, shortened in the middle if it has more than the 22 characters that fit beside a panel."""
    return plain(name if len(name) <= 22 else f"{name[:10]}…{name[-11:]}")


def _plot_record(record: Record, outputs: tuple[str, ...] | None, units: str | None) -> Figure:
    """Return the figure of a record: its quantities over time, with bands of two standard deviations of those that
    have them (none of the attitude, which is drawn as Euler angles XYZ).
    """
    arrays = record.recorded()
    known = tuple(name for name in arrays if not name.endswith("_std") and name != "weight")
    for name in outputs or ():
        check_choice("outputs", name, known)
    collector = CurveCollector()
    collector.add_piece(record.t, record.t.size, {name: arrays[name] for name in outputs or known})
    columns = Columns(Units.of(units), lambda name: "rad" if name == "S" else record.unit(name))
    curves = collector.curves(columns)
    panels = [Panel((name,), name, columns.unit(name)) for name in curves]
    title = f"{record.described}, with bands of two standard deviations"
    t_label = "" if record.unit("t") == "s" else "sample"
    figure = draw_figure(title, _side_by_side(panels), curves, columns, t_label=t_label)
    for axes, (name, curve) in zip(figure.axes, curves.items(), strict=True):
        if name == "S" or f"{name}_std" not in arrays:
            continue
        std, values = columns.converted(name, arrays[f"{name}_std"]), curve.values.reshape(curve.t.size, -1)
        colours = XYZ_COLOURS if values.shape[1] > 1 else ("#222222",)
        t = curve.t - (curve.t - axes.get_lines()[0].get_xdata())[0]
        half = 2 * np.interp(curve.t, columns.converted("t", record.t), np.where(np.isfinite(std), std, np.nan))
        for column, colour in zip(values.T, colours, strict=False):
            axes.fill_between(t, column - half, column + half, color=colour, alpha=0.25, lw=0)
    return figure
