"""The report of a cross-validation: the largest difference of each output from Pinocchio, as a table or JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import printable
from hingepair.numeric.tables import Sheet, Shown, align_columns, json_text, left_out_remark
from hingepair.pair.accuracy import (
    MAX_PINOCCHIO_DIFFERENCE_IN_ROUNDOFFS_OF_SCALE,
    PINOCCHIO_EXTRA_SCALE_FORMULA_BY_OUTPUT,
    PROMISED_BOUND_BY_OUTPUT,
    SCALE_FORMULA_BY_PLANAR_ONLY_OUTPUT,
)

# The headings of the table of rates.
_RATE_HEADINGS = ("rate", "slope of", "largest error", "allowed", "at sample", "compared", "")
MAX_LOAD_RATIO: Final = 64
"""Largest difference of a load from Pinocchio's inverse dynamics that passes, in units of u * scale.

A load is compared with a sum of some thirty terms, and the accelerations in it are solutions of linear equations. The
largest difference in 1,000 motions was 11.
"""
# Descriptions of the scales of the loads' differences, by the load.
_LOAD_SCALES: Final[Mapping[str, str]] = {
    "force1": "masses times the sizes of all terms of their accelerations and of gravity, and the loads",
    "torque1": "inertias times the sizes of all terms of alpha and omega^2, forces times levers, and the loads",
    "hinge_torque": "as for torque1, but of body 2 alone",
}
# The headings of the table of outputs.
_HEADINGS = ("output", "largest error", "in u*scale", "bound", "at sample", "compared", "")


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of one output of the equations with Pinocchio's."""

    #: name of the output
    output: str
    #: largest difference of a component, in the unit of the output; inf if only one result is finite
    max_error: float
    #: largest difference in units of u * scale, where each sample has its own scale
    max_ratio: float
    #: index of the sample with the largest ratio; None if nothing was compared
    worst_sample: tuple[int, ...] | None
    #: number of compared samples
    samples: int
    #: the largest ratio that passes
    bound: float = MAX_PINOCCHIO_DIFFERENCE_IN_ROUNDOFFS_OF_SCALE

    @property
    def ok(self) -> bool:
        """Whether a sample was compared, and every compared sample is within the bound."""
        return self.samples > 0 and self.max_ratio <= self.bound

    @property
    def scale(self) -> str:
        """Formula of the scale of this output's error, as text for a reader."""
        added_terms = PINOCCHIO_EXTRA_SCALE_FORMULA_BY_OUTPUT.get(self.output)
        if self.output in _LOAD_SCALES:
            return _LOAD_SCALES[self.output]
        formula = SCALE_FORMULA_BY_PLANAR_ONLY_OUTPUT.get(self.output) or PROMISED_BOUND_BY_OUTPUT[self.output].scale
        return f"{formula} + {added_terms}" if added_terms else formula

    @classmethod
    def worst_of(
        cls,
        output: str,
        error: NDArray[np.float64],
        ratio: NDArray[np.float64],
        shape: tuple[int, ...],
        bound: float = MAX_PINOCCHIO_DIFFERENCE_IN_ROUNDOFFS_OF_SCALE,
    ) -> Comparison:
        """Return the Comparison of the output named `output` with the largest of its errors over the samples. `error`
        holds the errors, shape (N,), and `ratio` the same errors divided by u * scale, the unit roundoff times the
        scale of the output. `shape` is the leading shape of the samples, and `bound` the largest ratio that passes.
        NaN is not compared.
        """
        compared = ~np.isnan(ratio)
        if not compared.any():
            return cls(output, 0.0, 0.0, None, 0, bound)
        worst = int(np.nanargmax(ratio))
        where = tuple(int(i) for i in np.unravel_index(worst, shape))
        return cls(output, float(np.nanmax(error)), float(ratio[worst]), where, int(compared.sum()), bound)


@dataclass(frozen=True, slots=True)
class RateComparison:
    """Comparison of a rate, such as v1, with the slope of a quantity, such as R1, by finite differences."""

    #: name of the rate
    rate: str
    #: name of the quantity whose rate it is
    of: str
    #: largest difference of a component, in the rate's unit
    max_error: float
    #: largest difference that passes
    allowed: float
    #: the sample with the largest difference; None where nothing was compared
    worst_sample: int | None
    #: how many samples were compared
    samples: int

    @property
    def ok(self) -> bool:
        """Whether no difference is larger than allowed; a rate that was not compared passes."""
        return self.max_error <= self.allowed

    @classmethod
    def worst_of(cls, rate: str, quantity: str, error: NDArray[np.float64], allowed: float) -> RateComparison:
        """Return the RateComparison of the rate named `rate` with the largest of its errors over the samples. `error`
        holds the differences of the rate from the slope of the quantity named `quantity`, shape (N,), and `allowed`
        is the largest difference that passes. NaN is not compared.
        """
        compared = ~np.isnan(error)
        if not compared.any():
            return cls(rate, quantity, 0.0, allowed, None, 0)
        worst = int(np.nanargmax(error))
        return cls(rate, quantity, float(error[worst]), allowed, worst, int(compared.sum()))


@dataclass(frozen=True, slots=True, repr=False)
class CrossValidation(Shown):
    """Report on the comparison of the outputs of a pair with Pinocchio's: a row for each output, a verdict, and
    conversions to a table and to JSON.
    """

    #: name of the pair
    name: str
    #: Euler sequence; None if the attitude of body 1 was given as a matrix, and for planar pairs
    sequence: str | None
    #: leading shape of the samples
    shape: tuple[int, ...]
    #: number of samples that were left out because their input is not finite
    skipped: int
    #: unit roundoff of the dtype of the computation
    u: float
    #: one comparison for each output
    rows: tuple[Comparison, ...]
    #: for a simulated motion, comparisons of the loads with the forces that the motion requires according to
    #: Pinocchio's `rnea`
    forces: tuple[Comparison, ...] = ()
    #: for a simulated motion, comparisons of each rate with the slope of its quantity
    rates: tuple[RateComparison, ...] = ()
    #: remarks on the comparison, as sentences
    notes: tuple[str, ...] = ()

    @property
    def samples(self) -> int:
        """Number of given samples."""
        return math.prod(self.shape)

    @property
    def compared(self) -> int:
        """Number of compared samples."""
        return self.samples - self.skipped

    @property
    def ok(self) -> bool:
        """Whether every output of every finite sample is within its bound, and at least one output was compared."""
        compared = [row.ok for row in self.rows + self.forces] + [row.ok for row in self.rates]
        return bool(self.rows) and all(compared)

    @property
    def verdict(self) -> str:
        """One line of text that says PASSED, FAILED with the failed outputs, or NOTHING COMPARED, and how many
        samples, if any, were left out.
        """
        beside = left_out_remark(self.skipped, self.samples)
        if not self.compared:
            return f"NOTHING COMPARED: {'no finite sample' if self.samples else 'there are no samples'}{beside}"
        failed = [row.output for row in self.rows + self.forces if not row.ok]
        failed += [row.rate for row in self.rates if not row.ok]
        if failed:
            return f"FAILED: {', '.join(dict.fromkeys(failed))}{beside}"
        outputs = f"{len(self.rows)} outputs of {self.compared} sample{'s' if self.compared != 1 else ''}"
        forces = ", ".join(row.output for row in self.forces)
        more = f", and {forces} within {MAX_LOAD_RATIO} u*scale of its rnea" if forces else ""
        limit = f"{MAX_PINOCCHIO_DIFFERENCE_IN_ROUNDOFFS_OF_SCALE} u*scale"
        return f"PASSED: {outputs} within {limit} of Pinocchio{more}{beside}"

    def __str__(self) -> str:
        planar = any(row.output in SCALE_FORMULA_BY_PLANAR_ONLY_OUTPUT for row in self.rows)
        attitude_source = "in the plane" if planar else "attitude given"
        attitude = attitude_source if self.sequence is None else f"Euler sequence {self.sequence}"
        title = f"{printable(self.name)}: the equations against Pinocchio, {attitude}"
        unit = f"u = {self.u:.3g}; scale: the size of an output's terms before they cancel (in full: .rows, --json)"
        lines = [
            title,
            *align_columns([_HEADINGS, *map(_comparison_cells, self.rows)], {1, 2, 3, 4, 5}),
            unit,
        ]
        if self.forces:
            lines += ["the loads against the forces that the motion takes by Pinocchio's rnea, in body 1's axes"]
            lines += align_columns([_HEADINGS, *map(_comparison_cells, self.forces)], {1, 2, 3, 4, 5})
        if self.rates:
            lines += ["the rates against slopes by finite differences, where the instants are close enough for them"]
            lines += align_columns([_RATE_HEADINGS, *map(_rate_cells, self.rates)], {2, 3, 4, 5})
        return "\n".join((*lines, *(f"note: {note}" for note in self.notes), self.verdict))

    def __repr__(self) -> str:
        return f"CrossValidation({self.name!r}, {self.verdict})"

    def _sheet(self) -> Sheet:
        """Return the printed table of the comparison as a Sheet of strings: a title, a heading and a row for each
        output, load or rate, and notes with the verdict.
        """
        title = f"{self.name}: the equations against Pinocchio"
        rows = (
            _HEADINGS,
            *map(_comparison_cells, (*self.rows, *self.forces)),
            *map(_rate_cells, self.rates),
        )
        return Sheet(title, rows, (*self.notes, self.verdict))

    def to_json(self) -> str:
        """Return the report as JSON text; a number that is not finite becomes null."""
        facts = {name: getattr(self, name) for name in ("name", "ok", "verdict", "samples", "compared", "skipped")}
        facts |= {"sequence": self.sequence, "u": self.u, "notes": list(self.notes)}
        for name, rows in (("rows", self.rows), ("forces", self.forces)):
            facts[name] = [{**asdict(row), "ok": row.ok, "scale": row.scale} for row in rows]
        facts["rates"] = [{**asdict(row), "ok": row.ok} for row in self.rates]
        return json_text(facts)


def _rate_cells(row: RateComparison) -> tuple[str, ...]:
    """Return a tuple of the cells, as strings, of a row of a report's table that compares a rate with a slope."""
    if row.worst_sample is None:
        return row.rate, row.of, "-", f"{row.allowed:.2g}", "-", "0", "not compared"
    error, verdict = f"{row.max_error:.2e}", "ok" if row.ok else "FAILED"
    return row.rate, row.of, error, f"{row.allowed:.2g}", str(row.worst_sample), str(row.samples), verdict


def _comparison_cells(row: Comparison) -> tuple[str, ...]:
    """Return a tuple of the cells, as strings, of a row of a report's table that compares one output."""
    if row.worst_sample is None:
        return row.output, "-", "-", f"{row.bound:g}", "-", "0", "nothing compared"
    where = ",".join(map(str, row.worst_sample)) or "-"
    verdict = "ok" if row.ok else "FAILED"
    error, ratio = f"{row.max_error:.2e}", f"{row.max_ratio:.2f}" if row.max_ratio < 1e6 else f"{row.max_ratio:.1e}"
    return row.output, error, ratio, f"{row.bound:g}", where, str(row.samples), verdict
