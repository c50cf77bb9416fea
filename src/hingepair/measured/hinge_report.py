"""What fits of a hinge report alike, from poses and from inertial sensors: text, JSON and tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from hingepair.equations.quantities import unit_of
from hingepair.measured.findings import Finding, Report
from hingepair.measured.hinge import RULE_OF_HOME, RULE_OF_SIGN
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.results import OverInstants, Record
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import rotation_vector
from hingepair.tables.sheets import Sheet
from hingepair.tables.units import Units


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class HingeReport(Report, OverInstants):
    """What the results of `fit` and `fit_imus` have in common; `fit` and `fit_imus` say what it is."""

    pair: HingePair
    psi: Float64Array
    psi_range: tuple[float, float]
    covariance: Float64Array
    std: Mapping[str, Float64Array | np.float64]
    clock_offset: float | None
    clock_drift: float | None
    t: Float64Array | None
    samples: int
    findings: tuple[Finding, ...]
    gauge: str

    _title: ClassVar[Any]
    _left: ClassVar[dict[str, str]]  # names of root mean squares, and their units
    _reported: ClassVar[tuple[str, ...]]  # names of attributes that are reported in JSON alone
    _over_instants: ClassVar[dict[str, str]]  # names of arrays beside psi, by those of their columns

    def record(self) -> Record:
        """Return psi with its standard deviation, and what is left of each sample, as a result that `save` writes."""
        t = np.arange(float(self.psi.size)) if self.t is None else self.t

        def unit(name: str) -> str:
            return "1" if name == "t" and self.t is None else unit_of(name)  # of places in the recording

        arrays = {"psi": self.psi, "psi_std": np.asarray(self.std["psi"])}
        arrays |= {column: getattr(self, name) for column, name in self._over_instants.items()}
        arrays = {column: array for column, array in arrays.items() if not np.isnan(array).all()}
        return Record(t, arrays, "what is left of each sample", unit=unit)

    def text(self, units: str | None = None) -> str:
        """Return the report that `print` shows.

        Args:
            units: units in place of m for u1 and u2, mm for what is left, and deg for angles, such as "mm, rad".
        """
        return self.printed(self._sheet(units))

    def _sheet(self, units: str | None = None) -> Sheet:
        lengths = Units.of(units)
        fine = lengths.over(Units("deg, mm, ms"))  # of angles, of what is left, and of clocks
        rows = [("", "value +- standard deviation", "unit")]

        def add(name: str, values: ArrayLike, std: ArrayLike, unit: str, shown: Units) -> None:
            both = np.broadcast_arrays(*(shown.factor(unit) * np.atleast_1d(each) for each in (values, std)))
            cells = [
                f"{value:.6g}" + f" +- {error:.2g}" * bool(error > 0) for value, error in zip(*both, strict=True)
            ]
            rows.append((name, ", ".join(cells), shown.unit(unit)))

        for name, unit in (("u1", "m"), ("u2", "m"), ("n", "")):
            add(name, getattr(self.pair, name), self.std[name], unit, lengths)
        add("home", np.asarray(rotation_vector(self.pair.home)), self.std["home"], "rad", fine)
        add("psi, from and to", self.psi_range, np.nanmedian(self.std["psi"]), "rad", fine)
        for name, unit in self._left.items():
            if not np.isnan(getattr(self, name)):
                add(f"{name}, left", getattr(self, name), 0.0, unit, fine)
        if self.clock_offset is not None and self.clock_drift is not None:
            if np.isfinite(self.std["clock_offset"]):
                add("clock_offset", self.clock_offset, self.std["clock_offset"], "s", fine)
                add("clock_drift", 1e6 * self.clock_drift, 1e6 * self.std["clock_drift"], "us/s", lengths)
            else:
                rows.append(("clock_offset", "not determined by this motion, taken as 0", ""))
        convention = (
            f"u1 and u2 lead to the point on the axis {self.gauge.replace('_', ' ')}; along the axis, motion "
        )
        convention += f"determines only their difference. {RULE_OF_SIGN} {RULE_OF_HOME}"
        sentences = (convention, *(finding.text(lengths) for finding in self.findings))
        return Sheet(f"{self._title}, {self.samples} of {self.psi.size} samples", rows, sentences)

    def _numbers(self) -> dict[str, Any]:
        """Return numbers by name, of psi the smallest and the largest, with the median of its standard deviations."""
        std = {name: np.nanmedian(value) if name == "psi" else value for name, value in self.std.items()}
        return {
            "missing": self.psi.size - self.samples,
            **{name: getattr(self.pair, name) for name in ("u1", "u2", "n", "home")},
            "std": std,
            **{name: getattr(self, name) for name in (*self._reported, *self._left, "clock_offset", "clock_drift")},
            "psi": self.psi_range,
        }
