"""The work-precision picture of `bench direct`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hingepair.errors import MissingDependencyError

if TYPE_CHECKING:
    from hingepair.bench import Row


def work_precision(rows: list[Row], path: str) -> None:
    """Error against run time, log-log, a panel for each level at its largest N; labels at the points.

    Raises:
        MissingDependencyError: Matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependencyError("--plot", "matplotlib (pip install 'hingepair[bench]')", str(error)) from None
    levels = list(dict.fromkeys(row.level for row in rows))
    figure = Figure(figsize=(7.2 * len(levels), 4.6), layout="constrained")
    for panel, level in zip(figure.subplots(1, len(levels), squeeze=False)[0], levels, strict=True):
        _panel(panel, level, [row for row in rows if row.level == level])
    figure.savefig(path, dpi=130)


def _panel(axes: Any, level: str, rows: list[Row]) -> None:
    """Each method at the largest N that it was measured at; ours filled, others hollow, the floor a line."""
    largest = {row.method: row for row in sorted(rows, key=lambda row: row.samples)}
    points = [
        (row.method, row.samples, row.median_ns, row.error) for row in largest.values() if row.error is not None
    ]
    points = sorted((p for p in points if np.isfinite(p[3])), key=lambda p: p[2])
    for method, _, time, error in points:
        ours = method.startswith("hingepair")
        axes.plot(time, error, "o", color="black", markerfacecolor="black" if ours else "white", ms=6)
    most = max(row.samples for row in rows)
    axes.set(xscale="log", yscale="log", title=f"{level}, N = {most:,}")
    axes.set(xlabel="ns a sample", ylabel="largest error on random states [u * scale]")
    times, errors = [p[2] for p in points], [p[3] for p in points]
    axes.set(xlim=(min(times) / 4, max(times) * 2), ylim=(min(errors) / 2, max(errors) * 2))
    floor = largest.get("copy floor")
    if floor is not None:
        axes.axvline(floor.median_ns, color="0.6", linestyle="--", linewidth=1)
        axes.annotate(
            "copy floor", (floor.median_ns, 0.5), xycoords=("data", "axes fraction"), rotation=90, fontsize=8,
            color="0.4", ha="right", va="center",
        )  # fmt: skip
    for i, (method, samples, time, error) in enumerate(points):
        axes.annotate(
            method + (f" (N = {samples:,})" if samples < most else ""),
            (time, error),
            xytext=(1.03, 0.98 - 0.96 * i / max(1, len(points) - 1)),
            textcoords="axes fraction",
            fontsize=8,
            va="center",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": "0.75", "linewidth": 0.5, "relpos": (0, 0.5)},
        )
    axes.grid(visible=True, which="major", color="0.92")
