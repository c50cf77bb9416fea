"""The figure of a mechanism's motion: coordinates, rates and torques joint by joint, and the paths of frames."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.mechanism import Mechanism, tree_of
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
from hingepair.pictures.motion_samples import Array, ShownMotion, has_efforts
from hingepair.scenes.scene import Scene
from hingepair.tables.units import Columns, Units, UnitsLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hingepair.mechanism.tree import Joint

# Columns of panels; a motion without rates has the first only, a motion without accelerations the first two.
_QUANTITIES: Final = ("q", "qd", "tau")
# Titles of the columns of panels.
_TITLES: Final = {"q": "position", "qd": "rate", "tau": "torque or force of the motor"}
_BLOCK: Final = 65_536  # instants of which the paths are computed in one call
# Colours of joints that share a panel, and of the paths of frames; they repeat.
_COLOURS: Final = ("#ee7733", "#4477aa", "#222222", "#009e73", "#aa3377", "#bbaa00")


_Piece: TypeAlias = tuple[Array, Mapping[str, Array], Sequence[Array]]
"""Instants, q, qd and tau as far as known, (N, dof), and positions of frames, (N, 3)."""


def plot_mechanism(scene: Scene, outputs: Iterable[str] | None, units: UnitsLike = None) -> Figure:
    """Return a new figure of the motion of a robot: position, rate and motor torque or force of each moving joint
    over time, and the paths of the scene's frames in space.

    Args:
        scene: a scene of a mechanism.
        outputs: names of the outputs to draw instead, as for `Scene.evaluate`.
        units: units in place of SI units; by default those of the scene.
    """
    columns = scene.in_units(units)
    if outputs is not None:
        collector = CurveCollector()
        for part in scene.blocks(outputs):
            collector.add_piece(part.t, scene.samples, part.requested_arrays())

        def is_attitude(name: str) -> bool:  # drawn as Euler angles
            return name.startswith("S_") and scene.unit(name) == "1"

        drawn = columns._replace(si_unit=lambda name: "rad" if is_attitude(name) else scene.unit(name))
        figure = draw_side_by_side(
            figure_class(),
            collector.curves(drawn),
            lambda name: (f"{name}, Euler angles XYZ" if is_attitude(name) else name, drawn.unit(name)),
        )
        return finish_figure(figure, scene.title)
    quantities = _QUANTITIES[: 2 + has_efforts(scene)][: scene.motion.level + 1]
    pieces = (
        (part.t, {name: getattr(part, name) for name in quantities}, [part[frame].R for frame in scene.frames])
        for part in scene.blocks((*quantities, *(f"R_{frame}" for frame in scene.frames)))
    )
    figure = _plot_joints(
        scene.mechanism_only, scene.motion.moving, scene.frames, scene.samples, pieces, columns.units
    )
    return finish_figure(figure, scene.title)


def plot_robot(robot: Mechanism, given: ShownMotion, *, has_instants: bool, units: UnitsLike = None) -> Figure:
    """Return a new figure of coordinates of a robot and of the rates and efforts that are given, over time (over the
    number of the sample without `has_instants`), and of the paths of its last links.
    """
    pieces = _given_pieces(robot, given)
    count, shown = len(given.t), Units.of(units)
    return finish_figure(_plot_joints(robot, robot.names, robot.tips, count, pieces, shown, has_instants), robot.name)


def _given_pieces(robot: Mechanism, given: ShownMotion) -> Iterator[_Piece]:
    known = {name: array for name in _QUANTITIES if (array := getattr(given, name)) is not None}
    for start in range(0, len(given.t), _BLOCK):
        rows = slice(start, start + _BLOCK)
        R, S = (part[rows] if len(part) > 1 else part[0] for part in (given.R, given.S))
        base = BodyMotion(R=R, S=S)
        state = robot.forward_kinematics(given.q[rows], frames=robot.tips, outputs=("R",), base_motion=base)
        yield (
            given.t[rows],
            {name: array[rows] for name, array in known.items()},
            [state[tip].R for tip in robot.tips],
        )


def _plot_joints(
    robot: Mechanism,
    moving: Collection[str],
    frames: Sequence[str],
    samples: int,
    pieces: Iterable[_Piece],
    units: Units,
    has_instants: bool = True,
) -> Figure:
    """Return a new figure of the joints that move, and of the paths of frames, from pieces of a motion of so many
    samples.
    """
    joints = tree_of(robot).coordinates
    si_units = {"t": "s" if has_instants else "1", PATHS: "m"}
    for joint in joints:
        per = (joint.unit, f"{joint.unit}/s", joint.effort_unit)
        si_units |= {f"{name}_{joint.name}": unit for name, unit in zip(_QUANTITIES, per, strict=True)}
    collector = CurveCollector()
    quantities: tuple[str, ...] = ("q",)
    for t, arrays, positions in pieces:
        quantities = tuple(arrays)
        by_joint = {f"{name}_{joint.name}": arrays[name][:, i] for name in arrays for i, joint in enumerate(joints)}
        paths = {PATHS: np.concatenate(positions, axis=1)} if positions else {}
        collector.add_piece(t, samples, by_joint | paths)
    columns = Columns(units, si_units.__getitem__)
    curves = collector.curves(columns, lambda _: False)  # limits are drawn beside the values
    if not has_instants:
        curves = {name: curve._replace(t_label="sample") for name, curve in curves.items()}
    shown = [joint for joint in joints if joint.name in moving]
    return _draw_joint_panels(figure_class(), shown, frames, quantities, curves, columns)


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
            name = group[0].name
            unit = shown.unit(f"{quantity}_{name}")
            _draw_joints(axes, group, quantity, curves, shown)
            axes.set(title=_TITLES[quantity] if row == 0 else "", ylabel=unit)
            if row < rows - 1:
                axes.set(xlabel="")
                axes.tick_params(labelbottom=False)
            if column == 0:
                label = f"{_shorten_name(name)}\n[{unit}]" if len(group) == 1 else f"[{unit}]"
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
    return name if len(name) <= 22 else f"{name[:10]}…{name[-11:]}"
