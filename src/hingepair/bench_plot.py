"""The work-precision picture of `bench direct`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

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
    figure = Figure(figsize=(6.4 * len(levels), 4.2), layout="constrained")
    for panel, level in zip(figure.subplots(1, len(levels), squeeze=False)[0], levels, strict=True):
        _panel(panel, level, [row for row in rows if row.level == level])
    figure.savefig(path, dpi=130)


def _panel(axes: Any, level: str, rows: list[Row]) -> None:
    """Each method at the largest N that it was measured at; ours filled, others hollow, the floor a line."""
    largest = {row.method: row for row in sorted(rows, key=lambda row: row.samples)}
    floor = largest.pop("copy floor", None)
    for row in largest.values():
        ours = row.method.startswith("hingepair")
        axes.plot(row.median_ns, row.error, "o", color="black", markerfacecolor="black" if ours else "white", ms=7)
    if floor is not None:
        axes.axvline(floor.median_ns, color="0.6", linestyle="--", linewidth=1)
    axes.set(xscale="log", yscale="log", title=f"{level}, N = {max(row.samples for row in rows):,}")
    axes.set(xlabel="ns a sample", ylabel="largest error [u * scale]", xlim=(3, 3e4))
    low, high = min(r.error for r in largest.values()), max(r.error for r in largest.values())
    axes.set_ylim(low / 2, high * 2)
    ordered = sorted(largest.values(), key=lambda row: row.median_ns)
    for i, row in enumerate(ordered):
        text = row.method.removeprefix("hingepair ") + (f" (N = {row.samples:,})" if row.samples < 10**5 else "")
        axes.annotate(
            text,
            (row.median_ns, row.error),
            xytext=(1.03, 0.97 - 0.94 * i / max(1, len(ordered) - 1)),
            textcoords="axes fraction",
            fontsize=8,
            va="center",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": "0.7", "linewidth": 0.6, "relpos": (0, 0.5)},
        )
    axes.grid(visible=True, which="major", color="0.92")
