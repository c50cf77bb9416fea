"""The figure of a mechanism's motion: coordinates, rates and torques joint by joint, and the paths of frames."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

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
from hingepair.pictures.frames import Array
from hingepair.scenes.mechanisms.scene import MechanismScene, MechanismSceneResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hingepair.mechanism.tree import Joint

_QUANTITIES: Final = ("q", "qd", "tau")
_TITLES: Final = {"q": "position", "qd": "rate", "tau": "torque or force of the motor"}
_PATH_COLOURS: Final = ("#ee7733", "#4477aa", "#222222", "#009e73", "#aa3377", "#bbaa00")
_LIMIT_REACH: Final = 0.6
"""A limit is drawn where it is at most this far from a curve, in units of the curve's span; else it is written."""
_PANEL_SIZE: Final = (3.5, 1.5)
_PATHS_WIDTH: Final = 5.0
"""Width and height of a panel, and width of the paths [inch]."""
_MAX_ROWS: Final = 12
"""Rows of panels, at most, and one more where there are hinges and sliders; more joints share panels."""
_PATHS_ROWS: Final = 6
"""Rows of panels beside which the paths stand, at most: the first ones."""
_HEADROOM: Final = 0.3
"""Room above a curve for a limit that is written, in units of the curve's span."""


def plot_of_mechanism(source: MechanismScene | MechanismSceneResult, outputs: Iterable[str] | None) -> Figure:
    """Draw the motion of a mechanism; `plot` has the words.

    Args:
        source: a scene of a mechanism, or its result, of which the scene is drawn.
        outputs: what to draw instead, as for `MechanismScene.evaluate`.
    """
    scene = source if isinstance(source, MechanismScene) else source.scene
    gathering = Gathering()
    if outputs is not None:
        for part in scene.blocks(outputs):
            gathering.add(part.t, scene.samples, part.chosen())
        make = figure_class()
        return finished(several(make, gathering.curves(), lambda name: _labels(scene, name)), scene.title)
    quantities = _QUANTITIES[: scene.joint_motion.level + 1]
    frames = [f"R_{frame}" for frame in scene.frames]
    for part in scene.blocks((*quantities, *frames)):
        columns = {
            f"{name}_{joint}": values for name in quantities for joint, values in _by_joint(part, name).items()
        }
        positions = [part[frame].R for frame in scene.frames]
        paths = {PATHS: np.concatenate(positions, axis=1)} if positions else {}
        gathering.add(part.t, scene.samples, columns | paths)
    make = figure_class()
    return finished(_whole(make, scene, quantities, gathering.curves()), scene.title)


def _by_joint(part: MechanismSceneResult, name: str) -> dict[str, Array]:
    """Return a quantity of the joints that move, by joint; shape (N,)."""
    array = getattr(part, name)
    moving = part.scene.joint_motion.moving
    return {joint: array[:, i] for i, joint in enumerate(part.scene.mechanism.names) if joint in moving}


def _labels(scene: MechanismScene, name: str) -> tuple[str, str]:
    """Return the title and the unit of an output."""
    if name.startswith("S_") and scene.unit(name) == "1":
        return f"{name}, Euler angles XYZ", "rad"
    return name, scene.unit(name)


def _whole(
    make: type[Figure], scene: MechanismScene, quantities: tuple[str, ...], curves: dict[str, Curve]
) -> Figure:
    """Draw a row of panels for each joint that moves, or for some of many joints, and the paths of the frames."""
    joints = [joint for joint in scene.mechanism.tree.coordinates if joint.name in scene.joint_motion.moving]
    groups = _grouped(scene, joints)
    rows, columns = max(1, len(groups)), len(quantities)
    width, height = _PANEL_SIZE
    size = width * columns + _PATHS_WIDTH, max(_PATHS_WIDTH, height * rows + 0.9)
    figure = make(figsize=size, layout="constrained")
    grid = figure.add_gridspec(rows, columns + 1, width_ratios=(*[width] * columns, _PATHS_WIDTH))
    first: Any = None
    for row, group in enumerate(groups):
        for column, quantity in enumerate(quantities):
            axes = figure.add_subplot(grid[row, column], sharex=first)
            first = first or axes
            name = group[0].name
            unit = scene.unit(f"tau_{name}" if quantity == "tau" else name + quantity[1:])
            _draw_joints(axes, group, quantity, curves)
            axes.set(title=_TITLES[quantity] if row == 0 else "", ylabel=unit)
            if row < rows - 1:
                axes.set(xlabel="")
                axes.tick_params(labelbottom=False)
            if column == 0:
                label = f"{_shortened(name)}\n[{unit}]" if len(group) == 1 else f"[{unit}]"
                axes.set_ylabel(label, fontsize=8)
                if len(group) > 1:
                    axes.legend(fontsize=6, loc="best")
    if PATHS in curves:
        points = np.split(curves[PATHS].values, len(scene.frames), axis=1)
        colours = [_PATH_COLOURS[i % len(_PATH_COLOURS)] for i in range(len(points))]
        draw_paths(
            figure, grid[:_PATHS_ROWS, columns], dict(zip(scene.frames, points, strict=True)), colours, zoom=0.75
        )
    return figure


def _grouped(scene: MechanismScene, joints: Sequence[Joint]) -> list[list[Joint]]:
    """Return the joints that share a row of panels, in order; hinges and sliders, whose units differ, share none."""
    size = -(-len(joints) // _MAX_ROWS)
    if size <= 1:
        return [[joint] for joint in joints]
    hinges = [joint for joint in joints if scene.unit(joint.name) == "rad"]
    sliders = [joint for joint in joints if joint not in hinges]
    return [alike[start : start + size] for alike in (hinges, sliders) for start in range(0, len(alike), size)]


def _draw_joints(axes: Axes, joints: Sequence[Joint], quantity: str, curves: dict[str, Curve]) -> None:
    """Draw a quantity of one joint or several over time; of one, limits that are far from its curve are written."""
    alone = len(joints) == 1
    for joint, colour in zip(joints, itertools.cycle(_PATH_COLOURS), strict=False):
        curve = curves[f"{quantity}_{joint.name}"]
        over_time(axes, "", "", curve)
        if not alone:
            axes.get_lines()[-1].set(color=colour, label=_shortened(joint.name))
        _draw_limits(axes, _limits(joint, quantity), curve.values, COLOURS[1] if alone else colour, alone)


def _limits(joint: Joint, quantity: str) -> tuple[float, float]:
    """Return the least and the greatest value that a joint may have; infinite where there is no limit."""
    if quantity == "q":
        return joint.position_limits
    largest = joint.rate_limit if quantity == "qd" else joint.effort_limit
    return -largest, largest


def _draw_limits(axes: Axes, limits: tuple[float, float], values: Array, colour: str, written: bool) -> None:
    """Draw the limits that are close to a curve; write those that are not, where there is room for words."""
    finite = values[np.isfinite(values)]
    known = [limit for limit in limits if np.isfinite(limit)]
    if not known or not finite.size:
        return
    least, most = float(finite.min()), float(finite.max())
    reach = _LIMIT_REACH * max(most - least, 1e-3 * max(abs(least), abs(most)))
    far = []
    for limit in known:
        if least - reach <= limit <= most + reach:
            axes.axhline(limit, color=colour, lw=1, ls="--", label="_limit")
        else:
            far.append(limit)
    if far and written:
        both = len(far) == 2 and far[0] == -far[1]
        text = f"±{far[1]:.6g}" if both else ", ".join(f"{limit:.6g}" for limit in far)
        bottom, top = axes.get_ylim()
        axes.set_ylim(bottom, top + _HEADROOM * (top - bottom))
        style: dict[str, Any] = {"ha": "right", "va": "top", "fontsize": 7, "color": colour}
        axes.text(0.98, 0.95, f"limit{'s' * (len(far) > 1)} {text}", transform=axes.transAxes, **style)


def _shortened(name: str) -> str:
    """Return a name that fits beside a panel."""
    return name if len(name) <= 22 else f"{name[:10]}…{name[-11:]}"
