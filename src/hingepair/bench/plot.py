"""The work-precision picture of `bench direct`."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

from hingepair.errors import MissingDependencyError

if TYPE_CHECKING:
    from hingepair.bench.direct import Row


class Point(NamedTuple):
    """A method in the picture: its name, ns a sample, error in units of u * scale."""

    name: str
    time: float
    error: float


def figure_type() -> Any:
    """Matplotlib's Figure.

    Raises:
        MissingDependencyError: Matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        needed = "matplotlib (pip install '.[bench]' in the project's folder)"
        raise MissingDependencyError("--plot", needed, str(error)) from None
    return Figure


def work_precision(rows: list[Row], path: str) -> None:
    """Error against run time, log-log, a panel for each level at its largest N; labels at the points.

    Raises:
        MissingDependencyError: Matplotlib is not installed.
    """
    figure_class = figure_type()
    levels = list(dict.fromkeys(row.level for row in rows))
    figure = figure_class(figsize=(9.6, 4.8 * len(levels)), layout="constrained")
    panels = figure.subplots(len(levels), 1, squeeze=False)[:, 0]
    points = [
        _panel(panel, level, [row for row in rows if row.level == level])
        for panel, level in zip(panels, levels, strict=True)
    ]
    figure.draw_without_rendering()  # from here on it is known where points lie, and stays so
    figure.set_layout_engine("none")
    for panel, found in zip(panels, points, strict=True):
        _label(panel, found)
    figure.savefig(path, dpi=130)


def _panel(axes: Any, level: str, rows: list[Row]) -> list[Point]:
    """Each method at the largest N that it was measured at; ours filled, others hollow, the floor a line."""
    most = max(row.samples for row in rows)
    largest = {row.method: row for row in sorted(rows, key=lambda row: row.samples)}
    points = [
        Point(row.method + (f" (N = {row.samples:,})" if row.samples < most else ""), row.median_ns, row.error)
        for row in largest.values()
        if row.error is not None and isfinite(row.error)
    ]
    for point in points:
        ours = point.name.startswith("hingepair")
        axes.plot(point.time, point.error, "o", color="black", markerfacecolor="black" if ours else "white", ms=6)
    times, errors = [p.time for p in points], [p.error for p in points]
    floor = largest.get("copy floor")
    if floor is not None:
        times.append(floor.median_ns)
        axes.axvline(floor.median_ns, color="0.6", linestyle="--", linewidth=1)
        where = {"xytext": (-3, 0), "textcoords": "offset points", "xycoords": ("data", "axes fraction")}
        axes.annotate("copy floor", (floor.median_ns, 0.5), **where, rotation=90, fontsize=8, ha="right", va="center")
    axes.set(xscale="log", yscale="log", xlim=(min(times) / 1.6, max(times) * 12))
    axes.set(ylim=(min(errors) / 6, max(errors) * 6), title=f"{level}, N = {most:,}")
    axes.set(xlabel="ns a sample", ylabel="largest error on random states [u * scale]")
    axes.grid(visible=True, which="major", color="0.92")
    return points


def _label(axes: Any, points: list[Point]) -> None:
    """Names beside the points, moved up or down as far as they would cover a point or another name."""
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

    frame, pixel = axes.get_window_extent(), axes.figure.dpi / 72
    places = {p.name: axes.transData.transform((p.time, p.error)) for p in points}
    boxes = [Bbox.from_bounds(x - 5 * pixel, y - 5 * pixel, 10 * pixel, 10 * pixel) for x, y in places.values()]
    steps = [sign * step for step in range(0, 300, 2) for sign in (1, -1)]
    for point in sorted(points, key=lambda p: p.time):
        text = axes.annotate(
            point.name,
            (point.time, point.error),
            xytext=(9, 0),
            textcoords="offset points",
            fontsize=8,
            va="center",
            arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.5, "relpos": (0, 0.5), "shrinkB": 3},
        )
        size = Text.get_window_extent(text)
        x, y = places[point.name]
        for step in steps:
            offset = 9 + abs(step) / 6, step
            bottom = y + step * pixel - size.height / 2
            box = Bbox.from_bounds(x + offset[0] * pixel, bottom, size.width, size.height)
            if frame.y0 < box.y0 and box.y1 < frame.y1 and not any(box.overlaps(other) for other in boxes):
                break
        text.set_position(offset)
        boxes.append(box)
