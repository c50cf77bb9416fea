"""Elements of figures: curves through all samples or through their extremes, and paths in space.

Curves are drawn through all samples. If there are many more samples than columns of pixels, a curve is drawn through
the first, the last, the smallest and the largest sample of each short interval, which looks the same: an oscillation
that is faster than a column fills the band between its extremes, and a spike of one sample stays visible.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from hingepair.errors import ArgumentError, printable
from hingepair.motion.trajectory import unwrap_euler_angles
from hingepair.numeric.optional import require
from hingepair.pictures.moving import Array
from hingepair.rotations.euler import matrix_to_euler
from hingepair.tables.instants import break_at_gaps
from hingepair.tables.sheets import offset_text, round_offset
from hingepair.tables.units import Columns

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Colours of the components x, y and z: Okabe and Ito's blue, vermilion and green.
XYZ_COLOURS: Final = ("#0072b2", "#d55e00", "#009e73")
# Colours of curves that share a panel, and of the paths of frames; they repeat.
COLOURS: Final = ("#ee7733", "#4477aa", "#222222", "#009e73", "#aa3377", "#bbaa00")
PATHS: Final = "paths"
"""Name of the curve that holds the paths in space."""
# Intervals of a curve whose extremes are drawn: more than a panel has columns of pixels, also in print.
_TIME_INTERVALS: Final = 2000
_PATH_INTERVALS: Final = 20_000  # more, since the shape of a path within an interval is visible
_MAX_DRAWN: Final = 1e100  # pictures square and multiply, which overflows for larger numbers


class Curve(NamedTuple):
    """Samples of a curve over time."""

    #: shape (N,)
    t: Array
    #: shape (N,) or (N, components)
    values: Array


class Panel(NamedTuple):
    """Curves over time that share axes."""

    #: names of the curves
    curves: Sequence[str]
    #: title
    title: str
    #: label of the axis of values
    label: str
    #: names of the curves in the legend, where there are several
    names: Sequence[str] = ()
    #: lower and upper limit of each curve, drawn if they are near it; infinite where there are none
    limits: Sequence[tuple[float, float]] = ()


class CurveCollector:
    """Collector of a figure's curves from consecutive pieces of a motion."""

    def __init__(self) -> None:
        self._pieces: dict[str, list[tuple[Array, Array]]] = {}  # t and values of each curve
        self._angles: dict[str, Array] = {}  # last Euler angles of each attitude, from which the next piece goes on

    def add_piece(self, t: Array, num_instants: int, arrays_by_name: Mapping[str, Array]) -> None:
        """Append the arrays of one piece of the motion, thinned to extremes, to the curves of the same names;
        rotation matrices as Euler angles.

        Args:
            t: instants of the piece [s]; shape (N,).
            num_instants: number of instants of all pieces together.
            arrays_by_name: quantities by name; shape (N, ...).
        """
        for name, array in {"t": t, **arrays_by_name}.items():
            check_drawable(name, array)
        for name, array in arrays_by_name.items():
            values = array
            if array.ndim == 3:
                values = _continuous_euler_angles(array, self._angles.get(name, np.empty((0, 3))))
                self._angles[name] = values[np.isfinite(values).all(axis=1)][-1:]
            is_path = name == PATHS
            intervals = _PATH_INTERVALS if is_path else _TIME_INTERVALS
            rows = _envelope_rows(values.reshape(len(t), -1), -(-num_instants // intervals))
            self._pieces.setdefault(name, []).append((t[rows], values[rows]))

    def curves(self, columns: Columns) -> dict[str, Curve]:
        """Return the collected curves by name, in the units of `columns`."""
        found = {}
        for name, parts in self._pieces.items():
            t, values = (np.concatenate(part) for part in zip(*parts, strict=True))
            found[name] = Curve(columns.converted("t", t), columns.converted(name, values))
        return found


def check_drawable(name: str, array: Array) -> None:
    """Raise an ArgumentError if a finite number of an array is too large for a picture."""
    largest = np.abs(array, where=np.isfinite(array), out=np.zeros(np.shape(array))).max(initial=0.0)
    if largest > _MAX_DRAWN:
        raise ArgumentError(name, f"numbers of at most {_MAX_DRAWN:g} in a picture", f"{largest:g}")


def figure_class() -> type[Figure]:
    """Import Matplotlib, and return its class `Figure`."""
    figure: type[Figure] = require("matplotlib.figure", "plot").Figure
    return figure


def plain(text: str) -> str:
    r"""Return a text that Matplotlib draws as it stands, not as a formula.

    >>> plain("cost $")
    'cost \\$'
    """
    shown = printable(text).replace("$", r"\$")
    return f" {shown}" if shown.startswith("_") else shown  # or legends leave it out


def _continuous_euler_angles(S: Array, previous_angles: Array) -> Array:
    """Return the Euler angles XYZ [rad] of rotation matrices S, shape (N, 3), without jumps between samples and from
    the last angles before, (1, 3) or (0, 3); NaN for a matrix that is not finite.
    """
    with np.errstate(invalid="ignore"):
        angles = np.array(matrix_to_euler(S))
    finite = np.isfinite(angles).all(axis=1)
    if finite.any():
        angles[finite] = unwrap_euler_angles(np.concatenate([previous_angles, angles[finite]]))[
            len(previous_angles) :
        ]
    return angles


def _envelope_rows(values: Array, interval_size: int) -> Array:
    """Return the indices of the samples (N, components) through which a curve looks the same as through all: of each
    interval of `interval_size` samples the first, the last, the extremes, and the ends of gaps.
    """
    count = len(values)
    if interval_size <= 2:
        return np.arange(count)
    start = np.arange(0, count, interval_size)
    padding = np.repeat(values[-1:], len(start) * interval_size - count, axis=0)
    parts = np.concatenate([values, padding]).reshape(len(start), interval_size, -1)
    lost = ~np.isfinite(parts)
    places = [
        np.where(lost, np.inf, parts).argmin(axis=1),
        np.where(lost, -np.inf, parts).argmax(axis=1),
        lost.argmax(axis=1),
        interval_size - 1 - lost[:, ::-1].argmax(axis=1),
    ]
    extremes = (start[:, None] + np.concatenate(places, axis=1)).ravel()
    return np.unique(np.minimum(np.concatenate([start, start + interval_size - 1, extremes]), count - 1))


def draw_figure(
    title: str, rows: Sequence[Sequence[Panel]], curves: Mapping[str, Curve], columns: Columns, *,
    t_label: str = "", paths: Mapping[str, str] = MappingProxyType({}), height: float = 2.6,
) -> Figure:  # fmt: skip
    """Draw rows of panels, and paths in space on the right, in a new figure.

    Args:
        title: title of the figure.
        rows: the panels.
        curves: curves by name; the one named PATHS has the paths side by side.
        columns: units of the curves.
        t_label: label of the axis of time; by default "t" with its unit.
        paths: colours of the paths by name.
        height: height of a row [in].
    """
    count, width = max(map(len, rows)), 3.5 if paths else 4.2
    size = max(width * count + 5.0 * bool(paths), 6), max(5.0 * bool(paths), height * len(rows) + 0.7)
    figure = figure_class()(figsize=size, layout="constrained")
    ratios = (*[width] * count, *[5.0] * bool(paths))
    grid = figure.add_gridspec(len(rows), len(ratios), width_ratios=ratios)
    ends = [end for curve in curves.values() for end in curve.t[[0, -1]]] or [0.0]
    start = round_offset(min(ends), max(ends))
    label = t_label or (f"{offset_text('t', start)} {columns.unit('t')}" if start else f"t [{columns.unit('t')}]")
    first: Any = None
    for row, panels in enumerate(rows):
        for column, panel in enumerate(panels):
            axes = figure.add_subplot(grid[row, column], sharex=first)
            first = first or axes
            is_last = all(len(later) <= column for later in rows[row + 1 :])
            _draw_panel(axes, panel, {name: curves[name] for name in panel.curves}, start)
            axes.set(title=panel.title, ylabel=panel.label, xlabel=label if is_last else "")
            axes.tick_params(labelbottom=is_last)
    if paths:
        points = np.split(curves[PATHS].values, len(paths), axis=1)
        _draw_paths(
            figure, grid[:, -1], dict(zip(paths, points, strict=True)), [*paths.values()], columns.unit(PATHS)
        )
    figure.suptitle(plain(title))
    for axes in figure.axes:
        axes.tick_params(labelsize=8)
        axes.title.set_fontsize(9)
        if axes.name != "3d":
            axes.grid(alpha=0.3)
    return figure


def _draw_panel(axes: Axes, panel: Panel, curves: Mapping[str, Curve], start: float) -> None:
    """Draw curves over time since a start into Matplotlib axes, with shaded gaps and limits."""
    for k, (name, curve) in enumerate(curves.items()):
        t, values = break_at_gaps(curve.t - start, curve.values)
        _shade_gaps(axes, t, values)
        if values.ndim > 1:
            for part, colour, letter, style in zip(values.T, XYZ_COLOURS, "xyz", ("-", "--", "-."), strict=False):
                axes.plot(t, part, style, color=colour, lw=1.2, label=letter)
            if not axes.figure.legends:
                handles, letters = axes.get_legend_handles_labels()
                axes.figure.legend(handles, letters, fontsize=8, ncols=3, loc="outside upper right")
            continue
        colour, label = (COLOURS[k % len(COLOURS)], panel.names[k]) if panel.names else ("#222222", name)
        axes.plot(t, values, color=colour, lw=1.2, label=plain(label))
        finite = values[np.isfinite(values)]
        if panel.limits and finite.size:
            least, most = float(finite.min()), float(finite.max())
            reach = 0.6 * max(most - least, 1e-3 * max(abs(least), abs(most)))
            for limit in panel.limits[k]:
                if least - reach <= limit <= most + reach:
                    axes.axhline(
                        limit, color=colour if panel.names else XYZ_COLOURS[1], lw=1, ls="--", label="_limit"
                    )
    if panel.names:
        axes.legend(fontsize=6, loc="best")


def _shade_gaps(axes: Axes, t: Array, values: Array) -> None:
    """Shade the times t at which a row of `values` is not finite, in Matplotlib axes."""
    lost = ~np.isfinite(values.reshape(len(t), -1)).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]]).astype(int)))
    for start, stop in edges.reshape(-1, 2):
        axes.axvspan(t[max(start - 1, 0)], t[min(stop, len(t) - 1)], color="0.85", lw=0)


def _draw_paths(
    figure: Figure, grid_cell: Any, paths_by_name: Mapping[str, Array], colours: Sequence[str], unit: str
) -> None:
    """Draw paths in space, arrays (N, 3) by name, into a cell of a figure's grid, in 3D or, if z is constant, in the
    plane, at equal scales.
    """
    finite = [np.where(np.isfinite(path), path, np.nan) for path in paths_by_name.values()]
    ends = np.array([(np.nanmin(path, 0), np.nanmax(path, 0)) for path in finite if not np.isnan(path).all(0).any()])
    letters = "xy" if len(ends) and np.ptp(ends[..., 2]) == 0 else "xyz"
    axes: Any = figure.add_subplot(grid_cell, projection="3d" if letters == "xyz" else None)
    for name, colour, path in zip(paths_by_name, colours, finite, strict=True):
        shown = path.T[: len(letters)]
        axes.plot(*shown, color=colour, lw=1.2, label=plain(name))
        axes.plot(*shown[:, :1], "o", color=colour, ms=3)
    labels = {f"{letter}label": letter for letter in letters}
    axes.set(title=f"paths in space [{unit}], from the dots", **labels)
    if letters == "xy":
        axes.set_aspect("equal", adjustable="datalim")
        axes.legend(fontsize=8)
        return
    axes.legend(fontsize=8, loc="upper left")
    if not len(ends):
        return
    middle, size = (ends[:, 1].max(0) + ends[:, 0].min(0)) / 2, ends[:, 1].max(0) - ends[:, 0].min(0)
    # The short axes of a long path are widened, since their tick labels would overlap.
    size = 1.05 * np.maximum(size, 0.3 * size.max())
    for letter, centre, extent in zip(letters, middle, size, strict=True):
        getattr(axes, f"set_{letter}lim")(centre - extent / 2, centre + extent / 2)
        axes.locator_params(axis=letter, nbins=max(1, round(4 * extent / size.max())))
    axes.set_box_aspect(size, zoom=0.75)  # leaves space for the labels
