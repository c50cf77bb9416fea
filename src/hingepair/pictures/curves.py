"""Elements of figures: curves through all samples or through their extremes, and paths in space.

Curves are drawn through all samples. If there are many more samples than columns of pixels, a curve is drawn through
the first, the last, the smallest and the largest sample of each short interval, which looks the same: an oscillation
that is faster than a column fills the band between its extremes, and a spike of one sample stays visible.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
PATHS: Final = "paths"
"""Name of the curve that holds the paths in space."""
# Intervals of a curve whose extremes are drawn: more than a panel has columns of pixels, also in print.
_TIME_INTERVALS: Final = 2000
_PATH_INTERVALS: Final = 20_000  # more, since the shape of a path within an interval is visible
_MAX_DRAWN: Final = 1e100  # pictures square and multiply, which overflows for larger numbers


class Curve(NamedTuple):
    """Samples of a curve over time, from which offsets may have been subtracted."""

    #: shape (N,)
    t: Array
    #: shape (N,) or (N, components)
    values: Array
    #: label of the axis of time
    t_label: str = "t [s]"
    #: of the components; empty if there are none
    offsets: tuple[float, ...] = ()

    def converted(self, name: str, columns: Columns, shifts_values: bool = True) -> Curve:
        """Return the curve in units, less the offsets of t and, if wanted, of the values that hide its variation."""
        t, values = columns.converted("t", self.t), columns.converted(name, self.values)
        start, label = columns.units.offset_of_instants(*_ends(self.t))
        label = label or f"t [{columns.unit('t')}]"
        offsets: tuple[float, ...] = ()
        if shifts_values:
            ends = [_ends(component) for component in values.reshape(len(t), -1).T]
            variation = max((high - low for low, high in ends), default=0.0)
            offsets = tuple(round_offset(low, high, variation) for low, high in ends)
        if not any(offsets):
            return Curve(t - start if start else t, values, label)
        return Curve(t - start, values - np.reshape(offsets, values.shape[1:]), label, offsets)


def _ends(values: Array) -> tuple[float, float]:
    """Return the smallest and the largest finite number; zeros if there is none."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)


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

    def curves(
        self, columns: Columns, shifted: Callable[[str], bool] = lambda name: name != PATHS
    ) -> dict[str, Curve]:
        """Return the collected curves by name.

        Args:
            columns: units of the curves.
            shifted: whether offsets may be subtracted from the values of a curve, by its name.
        """
        pieces = self._pieces.items()
        curves = {
            name: Curve(np.concatenate([t for t, _ in parts]), np.concatenate([values for _, values in parts]))
            for name, parts in pieces
        }
        return {name: curve.converted(name, columns, shifted(name)) for name, curve in curves.items()}


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


def finish_figure(figure: Figure, title: str) -> Figure:
    """Set a figure's title, small tick labels, and a grid behind curves over time; return the figure itself."""
    figure.suptitle(plain(title))
    for axes in figure.axes:
        axes.tick_params(labelsize=8)
        axes.title.set_fontsize(9)
        if axes.name != "3d":
            axes.grid(alpha=0.3)
    return figure


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


def draw_side_by_side(
    figure_type: type[Figure], curves: Mapping[str, Curve], title_and_unit: Callable[[str], tuple[str, str]]
) -> Figure:
    """Draw each curve over time in a panel of its own, up to three panels in a row, in a new figure of the class
    `figure_type`; return the figure.

    Args:
        figure_type: matplotlib's class of figures.
        curves: curves by name.
        title_and_unit: function that returns the title and the unit of a curve by its name.
    """
    columns = min(3, len(curves))
    rows = -(-len(curves) // columns)
    figure = figure_type(figsize=(max(4.2 * columns, 6), 2.6 * rows + 0.5), layout="constrained")
    places = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for axes, (name, curve) in zip(places, curves.items(), strict=False):
        title, unit = title_and_unit(name)
        draw_over_time(axes, plain(title), unit, curve)
    for axes in places[len(curves) :]:
        axes.remove()
    return figure


def draw_over_time(axes: Axes, title: str, unit: str, curve: Curve) -> None:
    """Draw the components of a curve over time into Matplotlib axes, with a title, a unit and shaded gaps. Add a
    legend to the figure if it has none and the curve has several components.
    """
    t, values = break_at_gaps(curve.t, curve.values)
    shade_gaps(axes, t, values)
    axes.set(title=title, ylabel=unit, xlabel=curve.t_label)
    axes.tick_params(labelbottom=True)
    if values.ndim == 1:
        axes.plot(t, values, color="#222222", lw=1.2)
        if curve.offsets:
            axes.set_title(offset_text(title, *curve.offsets))
        return
    for part, colour, letter, style in zip(values.T, XYZ_COLOURS, "xyz", ("-", "--", "-."), strict=False):
        axes.plot(t, part, style, color=colour, lw=1.2, label=letter)
    if curve.offsets:
        labels = [offset_text(letter, offset) for letter, offset in zip("xyz", curve.offsets, strict=False)]
        axes.legend(axes.get_lines(), labels, fontsize=7)
    if not axes.figure.legends:
        handles, letters = axes.get_legend_handles_labels()
        axes.figure.legend(handles, letters, fontsize=8, ncols=3, loc="outside upper right")


def shade_gaps(axes: Axes, t: Array, values: Array) -> None:
    """Shade the times t at which a row of `values` is not finite, in Matplotlib axes."""
    lost = ~np.isfinite(values.reshape(len(t), -1)).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]]).astype(int)))
    for start, stop in edges.reshape(-1, 2):
        axes.axvspan(t[max(start - 1, 0)], t[min(stop, len(t) - 1)], color="0.85", lw=0)


def draw_paths(
    figure: Figure,
    grid_cell: Any,
    paths_by_name: Mapping[str, Array],
    colours: Sequence[str],
    unit: str,
    zoom: float = 1.0,
) -> None:
    """Draw paths in space, a dict of arrays (N, 3) by name, into a cell of a figure's grid, in 3D or, if z is
    constant, in the plane, at equal scales.

    Args:
        figure: the figure.
        grid_cell: cell of the figure's grid.
        paths_by_name: the paths by name, in world axes; shape (N, 3) each.
        colours: colours of the paths, in order.
        unit: unit of the paths.
        zoom: size of the drawing; 1 leaves space for the labels in a wide panel.
    """
    finite = [np.where(np.isfinite(path), path, np.nan) for path in paths_by_name.values()]
    ends = np.array([(np.nanmin(path, 0), np.nanmax(path, 0)) for path in finite if not np.isnan(path).all(0).any()])
    low, high = (ends[:, 0].min(0), ends[:, 1].max(0)) if len(ends) else (np.zeros(3), np.zeros(3))
    variation = float((high - low).max())
    offsets = [round_offset(*own, variation) for own in zip(low.tolist(), high.tolist(), strict=True)]
    finite = [path - offsets for path in finite] if any(offsets) else finite
    ends = ends - offsets if len(ends) else ends
    letters = "xy" if len(ends) and np.ptp(ends[..., 2]) == 0 else "xyz"
    axes: Any = figure.add_subplot(grid_cell, projection="3d" if letters == "xyz" else None)
    for name, colour, path in zip(paths_by_name, colours, finite, strict=True):
        shown = path.T[: len(letters)]
        axes.plot(*shown, color=colour, lw=1.2, label=plain(name))
        axes.plot(*shown[:, :1], "o", color=colour, ms=3)
    title = f"paths in space [{unit}], from the dots"
    if any(offsets):  # too long for the axes in space
        title += "\n" + ", ".join(offset_text(letter, own) for letter, own in zip(letters, offsets, strict=False))
    axes.set(title=title, **{f"{letter}label": letter for letter in letters})
    if letters == "xy":
        axes.set_aspect("equal", adjustable="datalim")
        axes.legend(fontsize=8)
        return
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(-0.35, 1))
    if not len(ends):
        return
    middle, size = (ends[:, 1].max(0) + ends[:, 0].min(0)) / 2, ends[:, 1].max(0) - ends[:, 0].min(0)
    # The short axes of a long path are widened, since their tick labels would overlap.
    size = 1.05 * np.maximum(size, 0.3 * size.max())
    for letter, centre, extent in zip(letters, middle, size, strict=True):
        getattr(axes, f"set_{letter}lim")(centre - extent / 2, centre + extent / 2)
        axes.locator_params(axis=letter, nbins=max(1, round(4 * extent / size.max())))
    long = max(0.0, 1 - max(size[2], size.min()) / size.max())  # a panel has more space to the sides than up and down
    axes.set_box_aspect(size, zoom=zoom * (0.7 + 0.6 * long))  # leaves space for the labels
