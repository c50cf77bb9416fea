"""The figure of a mechanism's motion: coordinates, rates and torques joint by joint, and the paths of frames."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hingepair.mechanism.mechanism import tree_of
from hingepair.mechanism.tree import Joint
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
    plain,
)
from hingepair.pictures.moving import Array, Moving
from hingepair.tables.units import Columns, Units, UnitsLike
from hingepair.urdf.rigid import ZERO_MASS_PROPERTIES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Columns of panels; a motion without rates has the first only, a motion without accelerations the first two.
_QUANTITIES: Final = ("q", "qd", "tau")
# Titles of the columns of panels.
_TITLES: Final = {"q": "position", "qd": "rate", "tau": "torque or force"}
# Colours of joints that share a panel, and of the paths of frames; they repeat.
_COLOURS: Final = ("#ee7733", "#4477aa", "#222222", "#009e73", "#aa3377", "#bbaa00")


def plot_mechanism(shown: Moving, outputs: Iterable[str] | None, units: UnitsLike, *, has_instants: bool) -> Figure:
    """Return a new figure of the motion of a robot: position, rate and effort of each joint that moves and of each
    strut over time, or over the number of the sample, and the paths of frames in space.

    Args:
        shown: the robot and its motion.
        outputs: names of outputs of a scene to draw instead, as for `Scene.evaluate`.
        units: units in place of SI units; by default those of the scene.
        has_instants: False: over the number of the sample.
    """
    if outputs is not None:
        return _plot_outputs(shown, outputs, units)
    robot: Any = shown.subject
    scene = shown.scene
    moving = robot.names if scene is None else scene.motion.moving
    struts = [strut for strut in tree_of(robot).struts if strut.name not in robot.names]
    drawn = [joint for joint in tree_of(robot).coordinates if joint.name in moving]
    drawn += [_row_of_strut(strut.name, strut.limits) for strut in struts]
    frames = robot.tips if scene is None else scene.frames
    si_units = {"t": "s" if has_instants else "1", PATHS: "m"}
    for joint in drawn:
        per = (joint.unit, f"{joint.unit}/s", joint.effort_unit)
        si_units |= {f"{name}_{joint.name}": unit for name, unit in zip(_QUANTITIES, per, strict=True)}
    columns = Columns(Units.of(units) if scene is None else scene.in_units(units).units, si_units.__getitem__)
    collector, tau, known_rates = CurveCollector(), shown.tau(), False
    for rows, known in shown.pieces(1):
        base = known.base_motion
        qd = known.array(1) if known.level else shown.arrays.get("qd")
        arrays: dict[str, Array] = {"q": known.array(0)}
        if qd is not None:
            known_rates = True
            arrays["qd"] = qd if known.level else qd[rows]
        if tau is not None:
            arrays["tau"] = tau[rows]
        curves = {
            f"{quantity}_{name}": array[:, i]
            for quantity, array in arrays.items()
            for i, name in enumerate(robot.names)
        }
        if struts:
            for name, state in robot.struts(arrays["q"], arrays.get("qd")).items():
                own = (state.length, *((state.rate, state.force) if known_rates else ()))
                curves |= {f"{quantity}_{name}": one for quantity, one in zip(_QUANTITIES, own, strict=False)}
        curves = {name: curve for name, curve in curves.items() if name in si_units}
        if frames:
            state = robot.forward_kinematics(arrays["q"], frames=frames, outputs=("R",), base_motion=base)
            curves[PATHS] = np.concatenate(
                [np.broadcast_to(state[one].R, (known.count, 3)) for one in frames], axis=1
            )
        collector.add_piece(shown.t[rows], len(shown.t), curves)
    found = collector.curves(columns, lambda _: False)  # limits are drawn beside the values
    if not has_instants:
        found = {name: curve._replace(t_label="sample") for name, curve in found.items()}
    quantities = tuple(one for one in _QUANTITIES if any(name.startswith(f"{one}_") for name in found))
    return finish_figure(_draw_joint_panels(figure_class(), drawn, frames, quantities, found, columns), shown.title)


def _row_of_strut(name: str, limits: tuple[float, float]) -> Joint:
    """Return what panels take of a joint: a strut is drawn like a slider, by length, rate and force."""
    return Joint(name, "slider", 0, np.zeros(3), np.eye(3), np.eye(3)[0], ZERO_MASS_PROPERTIES, limits)


def _plot_outputs(shown: Moving, outputs: Iterable[str], units: UnitsLike) -> Figure:
    scene: Any = shown.scene
    collector = CurveCollector()
    for part in scene.blocks(outputs):
        collector.add_piece(part.t, scene.samples, part.requested_arrays())

    def is_attitude(name: str) -> bool:  # drawn as Euler angles
        return name.startswith("S_") and bool(scene.unit(name) == "1")

    columns = scene.in_units(units)
    drawn = columns._replace(si_unit=lambda name: "rad" if is_attitude(name) else scene.unit(name))
    figure = draw_side_by_side(
        figure_class(),
        collector.curves(drawn),
        lambda name: (f"{name}, Euler angles XYZ" if is_attitude(name) else name, drawn.unit(name)),
    )
    return finish_figure(figure, shown.title)


def _draw_joint_panels(
    figure_type: type[Figure],
    joints: Sequence[Joint],
    frames: Sequence[str],
    quantities: tuple[str, ...],
    curves: dict[str, Curve],
    shown: Columns,
) -> Figure:
    """Return a new figure with a row of panels for each joint or group of joints, a column for each of `quantities`
    (q, qd, tau), and a panel of the frames' paths.
    """
    groups = _panel_groups(joints)
    rows, columns = max(1, len(groups)), len(quantities)
    width, height, paths_width = 3.5, 1.5, 5.0  # inches
    size = width * columns + paths_width, max(paths_width, height * rows + 0.9)
    figure = figure_type(figsize=size, layout="constrained")
    grid = figure.add_gridspec(rows, columns + 1, width_ratios=(*[width] * columns, paths_width))
    first: Any = None
    for row, group in enumerate(groups):
        for column, quantity in enumerate(quantities):
            axes = figure.add_subplot(grid[row, column], sharex=first)
            first = first or axes
            drawn = [joint for joint in group if f"{quantity}_{joint.name}" in curves]
            if not drawn:  # the force of a strut without rates
                axes.remove()
                continue
            unit = shown.unit(f"{quantity}_{drawn[0].name}")
            _draw_joints(axes, drawn, quantity, curves, shown)
            axes.set(title=_TITLES[quantity] if row == 0 else "", ylabel=unit)
            if row < rows - 1:
                axes.set(xlabel="")
                axes.tick_params(labelbottom=False)
            if column == 0:
                label = f"{_shorten_name(group[0].name)}\n[{unit}]" if len(group) == 1 else f"[{unit}]"
                axes.set_ylabel(label, fontsize=8)
                if len(group) > 1:
                    axes.legend(fontsize=6, loc="best")
    if PATHS in curves:
        points = np.split(curves[PATHS].values, len(frames), axis=1)
        colours = [_COLOURS[i % len(_COLOURS)] for i in range(len(points))]
        draw_paths(
            figure,
            grid[:6, columns],
            dict(zip(frames, points, strict=True)),
            colours,
            shown.unit(PATHS),
            zoom=0.75,
        )
    return figure


def _panel_groups(joints: Sequence[Joint]) -> list[list[Joint]]:
    """Return the joints in each row of panels: one, or, of more than 12, several with the same unit."""
    size = -(-len(joints) // 12)  # joints in a row
    if size <= 1:
        return [[joint] for joint in joints]
    hinges = [joint for joint in joints if joint.unit == "rad"]
    sliders = [joint for joint in joints if joint not in hinges]
    return [alike[start : start + size] for alike in (hinges, sliders) for start in range(0, len(alike), size)]


def _draw_joints(
    axes: Axes, joints: Sequence[Joint], quantity: str, curves: dict[str, Curve], columns: Columns
) -> None:
    """Draw q, qd or tau of joints over time, with their limits."""
    alone = len(joints) == 1
    for joint, colour in zip(joints, itertools.cycle(_COLOURS), strict=False):
        name = f"{quantity}_{joint.name}"
        curve = curves[name]
        draw_over_time(axes, "", "", curve)
        if not alone:
            axes.get_lines()[-1].set(color=colour, label=_shorten_name(joint.name))
        _draw_limits(
            axes,
            columns.converted(name, np.array(_joint_limits(joint, quantity))).tolist(),
            curve.values,
            XYZ_COLOURS[1] if alone else colour,
            alone,
        )


def _joint_limits(joint: Joint, quantity: str) -> tuple[float, float]:
    """Return the lower and upper limit of a joint's q, qd or tau; infinite where the joint has none."""
    if quantity == "q":
        return joint.position_limits
    return (-joint.rate_limit, joint.rate_limit) if quantity == "qd" else joint.effort_bounds


def _draw_limits(axes: Axes, limits: Sequence[float], values: Array, colour: str, writes_far_limits: bool) -> None:
    """Draw the limits that are near a curve's values as dashed lines; write the others as text if wanted."""
    finite = values[np.isfinite(values)]
    known = [limit for limit in limits if np.isfinite(limit)]
    if not known or not finite.size:
        return
    least, most = float(finite.min()), float(finite.max())
    reach = 0.6 * max(most - least, 1e-3 * max(abs(least), abs(most)))
    far = []
    for limit in known:
        if least - reach <= limit <= most + reach:
            axes.axhline(limit, color=colour, lw=1, ls="--", label="_limit")
        else:
            far.append(limit)
    if far and writes_far_limits:
        both = len(far) == 2 and far[0] == -far[1]
        text = f"±{far[1]:.6g}" if both else ", ".join(f"{limit:.6g}" for limit in far)
        bottom, top = axes.get_ylim()
        axes.set_ylim(bottom, top + 0.3 * (top - bottom))  # space for the text
        style: dict[str, Any] = {"ha": "right", "va": "top", "fontsize": 7, "color": colour}
        axes.text(0.98, 0.95, f"limit{'s' * (len(far) > 1)} {text}", transform=axes.transAxes, **style)


def _shorten_name(name: str) -> str:
    """Return a name, shortened in the middle if it has more than the 22 characters that fit beside a panel."""
    return plain(name if len(name) <= 22 else f"{name[:10]}…{name[-11:]}")
