"""The plot of a smoothed recording: its quantities over time, with a band of twice their standard deviations."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

import numpy as np

from hingepair.equations.quantities import unit_of
from hingepair.errors import ArgumentError, choices
from hingepair.measured.smoothing.smooth import SmoothedAngle, SmoothedMotion
from hingepair.numeric.arrays import Float64Array
from hingepair.pictures.curves import (
    XYZ_COLOURS,
    Curve,
    CurveCollector,
    draw_side_by_side,
    figure_class,
    finish_figure,
)
from hingepair.tables.units import Columns, Units, UnitsLike

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Outputs of a SmoothedMotion that can be drawn.
_MOTION_OUTPUTS: Final = ("R", "v", "a", "S", "omega", "alpha")
# Outputs of a SmoothedAngle that can be drawn.
_ANGLE_OUTPUTS: Final = ("psi", "psid", "psidd")


def plot_smoothed(
    source: SmoothedMotion | SmoothedAngle, outputs: Iterable[str] | None = None, units: UnitsLike = None
) -> Figure:
    """Return a new figure of the result of `smooth` over time, with bands of two standard deviations.

    Args:
        source: the result of `smooth`.
        outputs: R, S, v, omega, a, alpha, or psi, psid, psidd; all of them unless given. S is drawn as Euler angles
            XYZ, without a band.
        units: units in place of SI units.
    """
    known = _ANGLE_OUTPUTS if isinstance(source, SmoothedAngle) else _MOTION_OUTPUTS
    names = known if outputs is None else tuple(outputs)
    for name in names:
        if name not in known:
            raise ArgumentError("outputs", choices(known), name)
    figure_type, collector = figure_class(), CurveCollector()
    collector.add_piece(source.t, source.t.size, {name: getattr(source, name) for name in names})
    columns = Columns(Units.of(units), lambda name: "rad" if name == "S" else unit_of(name))
    curves = collector.curves(columns)
    figure = draw_side_by_side(figure_type, curves, lambda name: (name, columns.unit(name)))
    for axes, (name, curve) in zip(figure.axes, curves.items(), strict=True):
        if name != "S":
            std = columns.converted(name, np.asarray(source.std[name]).reshape(source.t.size, -1))
            instants = Curve(source.t, source.t).converted("t", columns).t
            _draw_band(axes, curve.t, curve.values.reshape(curve.t.size, -1), instants, std)
    return finish_figure(figure, "smoothed: curves, and bands of two standard deviations")


def _draw_band(axes: Axes, t: Float64Array, values: Float64Array, instants: Float64Array, std: Float64Array) -> None:
    """Draw bands of two standard deviations, (M, k) at `instants`, around a curve with `values` (N, k) at t."""
    colours = XYZ_COLOURS if values.shape[1] > 1 else ("#222222",)
    for column, deviations, colour in zip(values.T, std.T, colours, strict=False):
        half = 2 * np.interp(t, instants, deviations)
        axes.fill_between(t, column - half, column + half, color=colour, alpha=0.25, lw=0)
