"""What fits of a hinge report alike, from poses and from inertial sensors: text, JSON and tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hingepair.equations.quantities import unit_of
from hingepair.measured.findings import Judged
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.results import OverInstants, Record
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import rotation_vector
from hingepair.tables.sheets import Sheet, Shown, cell_text, json_text
from hingepair.tables.units import Units


class HingeReport(Judged, OverInstants, Shown):
    """Base of the results of `fit` and `fit_imus`, whose attributes it names."""

    __slots__ = ()
    pair: HingePair
    psi: Float64Array
    std: Mapping[str, Float64Array | np.float64]
    clock_offset: float | None
    clock_drift: float | None
    t: Float64Array | None
    _title: Callable[[], str]  # first line of the report
    _left: Callable[[Units], str]  # what is left of the samples
    _convention: Callable[[], str]  # what the motion does not determine
    _columns: Callable[[], dict[str, Float64Array]]  # arrays over instants beside psi
    _numbers: Callable[[], dict[str, Any]]  # further ones of the JSON report
    samples: int

    def _range(self) -> tuple[float, float]:
        """Return the smallest and the largest angle [rad]."""
        return float(np.nanmin(self.psi)), float(np.nanmax(self.psi))

    def record(self) -> Record:
        """Return psi with its standard deviation, and what is left of each sample, as a result that `save` writes."""
        t = np.arange(float(self.psi.size)) if self.t is None else self.t

        def unit(name: str) -> str:
            return "1" if name == "t" and self.t is None else unit_of(name)  # of places in the recording

        arrays = {"psi": self.psi, "psi_std": np.asarray(self.std["psi"])} | self._columns()
        return Record(t, arrays, "what is left of each sample", unit=unit)

    def __str__(self) -> str:
        return self.text()

    def text(self, units: str | None = None) -> str:
        """Return the report that `print` shows.

        Args:
            units: units in place of m for u1 and u2, mm for what is left, and deg for angles, such as "mm, rad".
        """
        lengths, shown = Units.of(units), fine_units(units)
        angle, per_rad = shown.unit("rad"), shown.factor("rad")
        lines = [self._title()]
        for name, unit in (("u1", lengths.unit("m")), ("u2", lengths.unit("m")), ("n", "")):
            both = (getattr(self.pair, name), np.asarray(self.std[name]))
            value, std = (lengths.converted(own, unit_of(name)) for own in both)
            numbers = ", ".join(f"{v:.6g} +- {s:.2g}" for v, s in zip(value, std, strict=True))
            lines.append(f"{name} = ({numbers}) {unit}".rstrip())
        turn = per_rad * np.asarray(rotation_vector(self.pair.home))
        home = f"home turns by ({', '.join(f'{angle:.5g}' for angle in turn)}) {angle}"
        is_point = not np.any(self.std["home"])
        lines.append("body 2 is a point without recorded attitude, so home is the identity" if is_point else home)
        low, high = (per_rad * end for end in self._range())
        each = per_rad * np.nanmedian(self.std["psi"])
        left = self._left(shown)
        lines.append(f"psi from {low:.4g} to {high:.4g} {angle}, each +- {each:.2g} {angle}; {left}")
        lines += self._clock_lines()
        lines.append(self._convention())
        findings = (finding.text(lengths) for finding in self.findings)
        return "\n".join((*lines, *findings, "ok" if self.ok else "NOT RELIABLE"))

    def _clock_lines(self) -> list[str]:
        """Return the lines of the report on the clocks."""
        if self.clock_offset is None or self.clock_drift is None:
            return []
        offset, std = 1e3 * self.clock_offset, 1e3 * float(self.std["clock_offset"])
        if not np.isfinite(std):
            return ["clock offset: not determined by this motion, taken as 0"]
        size = f"{offset:.4g} +- {std:.2g} ms" if std else f"{offset:.4g} ms (given)"
        order = "later" if offset > 0 else "earlier"
        said = f"clock offset: {size}" + f"; body 2 was recorded {order} than its time stamps say" * (offset != 0)
        drift = f"clock drift: {1e6 * self.clock_drift:.3g} +- {1e6 * self.std['clock_drift']:.2g} us in a second"
        return [said, drift] if std else [said]

    def __repr__(self) -> str:
        left = self._left(fine_units(None))
        return f"{type(self).__name__}({self.samples} samples, {left}, {'ok' if self.ok else 'not ok'})"

    def _sheet(self) -> Sheet:
        """Return what notebooks show."""
        names = ("u1", "u2", "n", "home")
        rows = [
            (name, cell_text(getattr(self.pair, name)), cell_text(self.std[name]), unit_of(name)) for name in names
        ]
        return Sheet(repr(self), (("", "value", "standard deviation", "unit"), *rows), self.findings)

    def to_json(self) -> str:
        """Return a report as JSON text, in m, rad and s. Numbers that are not finite become null.

        The keys are u1, u2, n and home of `pair`, psi for the smallest and the largest angle, missing for the number
        of samples that were not used, and names of attributes. The standard deviation of psi is the median of
        those of all samples.
        """
        std = {name: np.nanmedian(value) if name == "psi" else value for name, value in self.std.items()}
        report = {
            "ok": self.ok,
            "samples": self.samples,
            "missing": self.psi.size - self.samples,
            **{name: getattr(self.pair, name).tolist() for name in ("u1", "u2", "n", "home")},
            "std": {name: np.asarray(value).tolist() for name, value in std.items()},
            **self._numbers(),
            "clock_offset": self.clock_offset,
            "clock_drift": self.clock_drift,
            "psi": list(self._range()),
            "findings": list(self.findings),
        }
        return json_text(report)


def fine_units(units: str | None) -> Units:
    """Return units of angles and of small lengths: deg and mm unless others are named."""
    return Units.of(units).over(Units("deg, mm"))
