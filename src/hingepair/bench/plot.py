"""The pictures of the benchmarks: errors and run times in panels side by side, with one legend."""

from __future__ import annotations

import io
from collections.abc import Sequence
from math import inf, isfinite
from typing import IO, Any, NamedTuple

from hingepair.numeric.optional import new_figure

# Colours that colour-blind readers can tell apart (Okabe and Ito; grey in place of yellow).
COLOURS = ("#000000", "#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#888888")
_MARKERS = "oDs^vP<>X*hpd"  # Matplotlib's codes; readers of a black-and-white print can tell them apart


class MethodCurve(NamedTuple):
    """The curve of one method in a panel."""

    name: str  # of the method, in the legend
    points: list[tuple[float, float]]  # (x, y)
    second_is_hard: bool = False  # the second point is the error on hard states; it is drawn hollow


class Panel(NamedTuple):
    """One diagram of a picture; x is logarithmic, and so is y unless `max_y` or `y_names` is given."""

    title: str
    x_label: str
    y_label: str
    curves: list[MethodCurve]
    min_x: float | None = None  # a vertical line marks this lower limit of x: the time of copying the outputs
    max_y: float | None = None  # end of a linear y axis from 0; points above it stand there with their number
    x_descending: bool = False  # x decreases to the right
    y_names: Sequence[str] = ()  # labels of y = 0, 1, ... from the top; the points of a curve are then not joined
    x_range: tuple[float, float] | None = None  # limits of x; those of the points if None


def draw_panels(panel_rows: Sequence[Sequence[Panel]]) -> Any:
    """Return a Matplotlib figure of the panels, row by row, with one legend of all methods below."""
    figure = new_figure(4.1 * len(panel_rows[0]) + 0.4, 3.4 * len(panel_rows) + 0.8, "--plot")
    names = list(dict.fromkeys(c.name for panels in panel_rows for panel in panels for c in panel.curves))
    styles = {name: (COLOURS[i % len(COLOURS)], _MARKERS[i % len(_MARKERS)]) for i, name in enumerate(names)}
    axes_grid = figure.subplots(len(panel_rows), len(panel_rows[0]), squeeze=False)
    legend: dict[str, Any] = {}
    for panels, axes_row in zip(panel_rows, axes_grid, strict=True):
        for axes in axes_row[len(panels) :]:
            axes.remove()
        for panel, axes in zip(panels, axes_row, strict=False):
            _draw_panel(axes, panel, styles)
            if panel.y_names and panel is not panels[0] and panel.y_names == panels[0].y_names:
                axes.tick_params(labelleft=False)  # the panel to the left has the same labels
            handles, labels = axes.get_legend_handles_labels()
            legend |= dict(zip(labels, handles, strict=True))
    columns = -(-len(legend) // 2) if len(legend) > 4 else len(legend)
    figure.legend(
        legend.values(), legend.keys(), loc="outside lower center", ncols=columns, frameon=False, fontsize=9
    )
    return figure


def write_picture(panel_rows: Sequence[Sequence[Panel]], file: IO[bytes], file_format: str) -> None:
    """Draw the panels, row by row, into an open file.

    Args:
        panel_rows: the panels.
        file: open for writing.
        file_format: "png", "svg" or "pdf".
    """
    figure = draw_panels(panel_rows)
    if file_format != "png":
        figure.savefig(file, format=file_format)
        return
    from PIL import Image  # Matplotlib depends on it

    pixels = io.BytesIO()
    figure.savefig(pixels, format="png", dpi=150)
    # A palette of the curves' colours and the shades of their edges takes a third of the bytes.
    picture = Image.open(pixels).convert("RGB").quantize(256)
    picture.save(file, format="png", optimize=True)


def _draw_panel(axes: Any, panel: Panel, styles: dict[str, tuple[str, str]]) -> None:
    """Draw a panel; `styles` are colour and marker by the method's name."""
    axes.set(xscale="log", title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)
    if panel.x_range is not None:
        axes.set_xlim(*panel.x_range)
    if panel.y_names:
        axes.set_yticks(range(len(panel.y_names)), panel.y_names)
        axes.set_ylim(len(panel.y_names) - 0.5, -0.5)
    elif panel.max_y is None:
        axes.set_yscale("log")
    else:
        axes.set_ylim(0, 1.15 * panel.max_y)
    edge = inf if panel.max_y is None else panel.max_y
    clipped: list[tuple[float, float]] = []
    for curve in panel.curves:
        colour, mark = styles[curve.name]
        points = [(x, y) for x, y in curve.points if isfinite(min(y, edge))]
        x_values, y_values = [x for x, _ in points], [min(y, edge) for _, y in points]
        style: dict[str, Any] = {"marker": mark, "color": colour, "markersize": 6}
        width = 0.0 if panel.y_names else 1.2
        axes.plot(
            x_values,
            y_values,
            **style,
            lw=width,
            markevery=slice(0, 1) if curve.second_is_hard else None,
            label=curve.name,
        )
        if curve.second_is_hard:
            axes.plot(x_values, y_values, **style, ls="none", markevery=slice(1, None), markerfacecolor="white")
        clipped += [(x, y) for x, y in points if y > edge]
    if any(curve.second_is_hard for curve in panel.curves):
        axes.plot([], [], "o", color="0.3", markerfacecolor="white", label="hollow: on hard states")
    for i, (x, y) in enumerate(sorted(clipped)):
        above = (0, 6 + 9 * (i % 2))
        axes.annotate(f"{y:.0e}", (x, edge), above, textcoords="offset points", ha="center", fontsize=7)
    if panel.min_x is not None:
        axes.axvline(panel.min_x, color="0.5", linestyle="--", linewidth=1, label="copying the outputs")
    if panel.x_descending:
        axes.invert_xaxis()
    axes.grid(visible=True, which="major", color="0.9")
