"""The pictures of the bench: error against time, panels side by side, one legend."""

from __future__ import annotations

import io
from collections.abc import Sequence
from math import inf, isfinite
from typing import IO, Any, NamedTuple

from hingepair.errors import MissingDependencyError

# Colours that stay apart for colour-blind eyes (Okabe and Ito, grey for yellow), and marks that stay apart in grey.
_COLOURS = ("#000000", "#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#888888")
_MARKS = "oDs^vP<>X*hpd"
_DOTS_PER_INCH = 150  # of a PNG
_PALETTE_COLOURS = 256  # of a PNG: those of the curves, and the shades of their edges


class Curve(NamedTuple):
    """A method in a panel."""

    name: str  # it
    points: list[tuple[float, float]]  # (x, y) each
    hard: bool = False  # the second point is the same under hardship, and drawn hollow


class Panel(NamedTuple):
    """Curves over one axis."""

    title: str  # of the panel
    across: str  # what its x is
    up: str  # what its y is
    curves: list[Curve]  # in it
    floor: float | None = None  # x below which nothing can be
    # y runs from 0 to here, evenly; what lies beyond stands on the edge with its number. Logarithmic if None
    most: float | None = None
    falling: bool = False  # x falls to the right
    names: Sequence[str] = ()  # what stands at y = 0, 1, ..., from above; points are then not joined
    span: tuple[float, float] | None = None  # of x; as its points need it if None


def drawn(rows: Sequence[Sequence[Panel]]) -> Any:
    """Return a Matplotlib figure of rows of panels, with the names of all curves in one legend below.

    Raises:
        MissingDependencyError: Matplotlib is not installed.
    """
    figure = new_figure((4.1 * len(rows[0]) + 0.4, 3.4 * len(rows) + 0.8))
    names = list(dict.fromkeys(c.name for panels in rows for panel in panels for c in panel.curves))
    styles = {name: (_COLOURS[i % len(_COLOURS)], _MARKS[i % len(_MARKS)]) for i, name in enumerate(names)}
    grid = figure.subplots(len(rows), len(rows[0]), squeeze=False)
    shown: dict[str, Any] = {}
    for panels, line in zip(rows, grid, strict=True):
        for panel, axes in zip(panels, line, strict=True):
            _panel(axes, panel, styles)
            if panel.names and panel is not panels[0] and panel.names == panels[0].names:
                axes.tick_params(labelleft=False)  # the panel to the left names the same lines
            handles, labels = axes.get_legend_handles_labels()
            shown |= dict(zip(labels, handles, strict=True))
    columns = -(-len(shown) // 2) if len(shown) > 4 else len(shown)
    figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
    return figure


def write_picture(rows: Sequence[Sequence[Panel]], file: IO[bytes], kind: str) -> None:
    """Draw rows of panels and write the picture to a file.

    Args:
        rows: the panels, row by row.
        file: open for writing bytes.
        kind: "png", "svg" or "pdf". A PNG has a palette, which takes a third of the bytes.

    Raises:
        MissingDependencyError: Matplotlib is not installed.
    """
    figure = drawn(rows)
    if kind != "png":
        figure.savefig(file, format=kind)
        return
    from PIL import Image  # Matplotlib depends on it

    pixels = io.BytesIO()
    figure.savefig(pixels, format="png", dpi=_DOTS_PER_INCH)
    picture = Image.open(pixels).convert("RGB").quantize(_PALETTE_COLOURS)
    picture.save(file, format="png", optimize=True)


def _panel(axes: Any, panel: Panel, styles: dict[str, tuple[str, str]]) -> None:
    axes.set(xscale="log", title=panel.title, xlabel=panel.across, ylabel=panel.up)
    if panel.span is not None:
        axes.set_xlim(*panel.span)
    if panel.names:
        axes.set_yticks(range(len(panel.names)), panel.names)
        axes.set_ylim(len(panel.names) - 0.5, -0.5)
    elif panel.most is None:
        axes.set_yscale("log")
    else:
        axes.set_ylim(0, 1.15 * panel.most)
    edge = inf if panel.most is None else panel.most
    beyond: list[tuple[float, float]] = []
    for curve in panel.curves:
        colour, mark = styles[curve.name]
        points = [(x, y) for x, y in curve.points if isfinite(min(y, edge))]
        across, up = [x for x, _ in points], [min(y, edge) for _, y in points]
        style: dict[str, Any] = {"marker": mark, "color": colour, "markersize": 6}
        width = 0.0 if panel.names else 1.2
        axes.plot(across, up, **style, lw=width, markevery=slice(0, 1) if curve.hard else None, label=curve.name)
        if curve.hard:
            axes.plot(across, up, **style, ls="none", markevery=slice(1, None), markerfacecolor="white")
        beyond += [(x, y) for x, y in points if y > edge]
    if any(curve.hard for curve in panel.curves):
        axes.plot([], [], "o", color="0.3", markerfacecolor="white", label="hollow: on hard states")
    for i, (x, y) in enumerate(sorted(beyond)):
        above = (0, 6 + 9 * (i % 2))
        axes.annotate(f"{y:.0e}", (x, edge), above, textcoords="offset points", ha="center", fontsize=7)
    if panel.floor is not None:
        axes.axvline(panel.floor, color="0.5", linestyle="--", linewidth=1, label="copying the outputs")
    if panel.falling:
        axes.invert_xaxis()
    axes.grid(visible=True, which="major", color="0.9")


def new_figure(size: tuple[float, float]) -> Any:
    """Return an empty Matplotlib figure of a size [inch].

    Raises:
        MissingDependencyError: Matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        needed = "matplotlib (pip install '.[bench]' in the project's folder)"
        raise MissingDependencyError("--plot", needed, str(error)) from None
    return Figure(figsize=size, layout="constrained")
