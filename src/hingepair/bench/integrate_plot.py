"""The picture of `bench integrate`: error against the step, and error against run time, a row for each motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hingepair.bench.plot import figure_type

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hingepair.bench.integrate import Row

_LINES = ("-", "--", "-.", ":")
_MARKS = "osD^v<>Px*"


def draw(rows: Sequence[Row], path: str) -> None:
    """Log-log curves with their names at the ends, legible in grey.

    Raises:
        MissingDependencyError: Matplotlib is not installed.
    """
    figure_class = figure_type()
    spins = list(dict.fromkeys(row.spin for row in rows))
    methods = list(dict.fromkeys(row.method for row in rows))
    figure = figure_class(figsize=(14, 5.4 * len(spins)), layout="constrained")
    panels = figure.subplots(len(spins), 2, squeeze=False)
    for spin, (left, right) in zip(spins, panels, strict=True):
        for axes, against in ((left, "h"), (right, "min_ms")):
            curves: dict[str, list[Any]] = {
                name: [(getattr(r, against), r.error) for r in rows if _drawn(r, spin, name, against)]
                for name in methods
            }
            _panel(axes, {name: points for name, points in curves.items() if points}, methods)
        left.invert_xaxis()
        left.set(xlabel="step h [s], finer to the right", title=f"{spin}: error against the step")
        right.set(xlabel="run time [ms]", title=f"{spin}: error against run time, t = 0 to 10 s")
    figure.savefig(path, dpi=110)


def _drawn(row: Row, spin: str, method: str, against: str) -> bool:
    return (row.spin, row.method) == (spin, method) and None not in {getattr(row, against), row.error}


def _panel(axes: Any, curves: dict[str, list[Any]], methods: list[str]) -> None:
    """The curves, each with its name beside its last point, moved apart where names would meet."""
    axes.set(xscale="log", yscale="log", ylabel="largest error of the attitude [rad]", ylim=(1e-16, 10))
    for name, points in curves.items():
        i = methods.index(name)
        ours = not name.startswith("SciPy")
        axes.plot(
            *zip(*points, strict=True), linestyle=_LINES[i % 4], marker=_MARKS[i], markersize=5, linewidth=1.2,
            color="black" if ours else "0.5", markerfacecolor="black" if ours else "white",
        )  # fmt: skip
    ordered = sorted(curves, key=lambda name: -curves[name][-1][1])
    for k, name in enumerate(ordered):
        axes.annotate(
            name,
            curves[name][-1],
            xytext=(1.02, 0.95 - 0.9 * k / max(1, len(ordered) - 1)),
            textcoords="axes fraction",
            fontsize=8,
            va="center",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": "0.75", "linewidth": 0.6, "relpos": (0, 0.5)},
        )
    axes.grid(visible=True, which="major", color="0.92")
