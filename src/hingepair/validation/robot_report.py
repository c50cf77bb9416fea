"""The report of a robot's cross-validation: the largest difference of each output from Pinocchio."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from hingepair.errors import printable
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.tables import Sheet, Shown, align_columns, json_text, left_out_remark
from hingepair.pair.accuracy import MAX_PINOCCHIO_DIFFERENCE_IN_ROUNDOFFS_OF_SCALE

_HEADINGS = ("output", "largest error", "in u*scale", "bound", "at sample", "of", "compared", "")
"""Headings of the columns of a report on a robot; errors in u * scale, or in the unit of the output."""


@dataclass(frozen=True, slots=True)
class RobotComparison:
    """Comparison of one output of a robot with Pinocchio's, over all links or joints that have it."""

    #: name of the output
    output: str
    #: largest difference of a component, in the unit of the output; inf if only one result is finite
    max_error: float
    #: largest difference in units of u * scale, where each sample has its own scale
    max_ratio: float
    #: index of the sample with the largest ratio; None if nothing was compared
    worst_sample: tuple[int, ...] | None
    #: name of the link or joint with the largest ratio; "" for an output of the whole robot
    worst_part: str
    #: number of compared samples
    samples: int
    #: the largest ratio that passes
    bound: float = MAX_PINOCCHIO_DIFFERENCE_IN_ROUNDOFFS_OF_SCALE
    #: number of samples that were left out because the mass matrix is singular there
    singular: int = 0
    #: text on the joint that nothing resists at the first of these samples; "" if there are none
    unresisted: str = ""

    @property
    def ok(self) -> bool:
        """Whether every compared sample is within the bound. False if no sample was compared, unless the mass matrix
        is singular at some of the samples that were left out.
        """
        return (self.samples > 0 or self.singular > 0) and self.max_ratio <= self.bound

    @property
    def note(self) -> str:
        """Sentence on the samples that were left out because the mass matrix is singular; "" if there are none."""
        if not self.singular:
            return ""
        where = f"{self.singular} of {self.samples + self.singular} samples"
        return f"{self.output} is not compared at {where}, where the mass matrix is singular: {self.unresisted}"

    @classmethod
    def worst_of(
        cls, output: str, error: Float64Array, ratio: Float64Array, shape: tuple[int, ...], parts: Sequence[str]
    ) -> RobotComparison:
        """Return the RobotComparison of the output named `output` with the largest of its errors over all samples and
        parts. NaN is not compared.

        Args:
            output: name of the output.
            error: differences, NaN where not comparable; shape (N, parts).
            ratio: differences in units of u * scale; shape (N, parts).
            shape: leading shape of the samples, of N elements.
            parts: names of the links or joints.
        """
        compared = ~np.isnan(ratio).all(axis=1)
        if not compared.any():
            return cls(output, 0.0, 0.0, None, "", 0)
        worst, part = (int(i) for i in np.unravel_index(np.nanargmax(ratio), ratio.shape))
        sample = tuple(int(i) for i in np.unravel_index(worst, shape))
        size, off = float(np.nanmax(error)), float(ratio[worst, part])
        return cls(output, size, off, sample, parts[part], int(compared.sum()))


@dataclass(frozen=True, slots=True, repr=False)
class RobotValidation(Shown):
    """Report on the comparison of the outputs of a robot with Pinocchio's: a row for each output, a verdict, and
    conversions to a table and to JSON.
    """

    #: name of the robot
    name: str
    #: "fixed" or "free"
    base: str
    #: number of compared frames
    frames: int
    #: leading shape of the samples
    shape: tuple[int, ...]
    #: number of samples that were left out because their input is not finite
    skipped: int
    #: unit roundoff of the dtype of the computation
    u: float
    #: one comparison for each output
    rows: tuple[RobotComparison, ...]
    #: if the robot was read from a URDF, comparisons with Pinocchio's reading of it: "names" of joints, "placements"
    #: (points, attitudes and axes of joints) and "inertias" (mass, centre of mass and inertia of the bodies)
    description: tuple[RobotComparison, ...] = ()
    #: where Pinocchio's model comes from
    compared_with: str = "a model built from the robot as hingepair holds it"

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
        """Whether every output of every finite sample, and every part of the description, is within its bound, and at
        least one sample was compared.
        """
        return any(row.samples for row in self.rows) and all(row.ok for row in (*self.description, *self.rows))

    @property
    def verdict(self) -> str:
        """One line of text that says PASSED, FAILED with the failed outputs, or NOTHING COMPARED, and how many
        samples, if any, were left out.
        """
        beside = left_out_remark(self.skipped, self.samples)
        if not self.compared:
            return f"NOTHING COMPARED: {'no finite sample' if self.samples else 'there are no samples'}{beside}"
        failed = [row.output for row in (*self.description, *self.rows) if not row.ok]
        if failed:
            return f"FAILED: {', '.join(failed)}{beside}"
        left = [row.output for row in self.rows if not row.samples]
        outputs = f"{len(self.rows) - len(left)} outputs of {self.compared} sample{'s' if self.compared != 1 else ''}"
        without = f"; not compared: {', '.join(left)}" if left else ""
        limit = f"{MAX_PINOCCHIO_DIFFERENCE_IN_ROUNDOFFS_OF_SCALE} u*scale"
        read = "the description and " if self.description else ""
        return f"PASSED: {read}{outputs} within {limit} of Pinocchio{without}{beside}"

    def __str__(self) -> str:
        title, lines, notes = self._sheet()
        return "\n".join((printable(title), *align_columns(lines, {1, 2, 3, 4, 6}), *notes))

    def __repr__(self) -> str:
        return f"RobotValidation({self.name!r}, {self.verdict})"

    def _sheet(self) -> Sheet:
        """Return the printed table of the comparison as a Sheet of strings: a title, a heading and a row for each
        output, and notes on the unit, on samples that were left out, and on the verdict.
        """
        title = f"{self.name}: the equations against Pinocchio, {self.base} base, {self.frames} frames"
        unit = f"u = {self.u:.3g}; scale: the size of an output's terms before they cancel, summed over the joints"
        notes = [row.note for row in self.rows if row.note]
        return Sheet(
            title,
            (_HEADINGS, *map(_robot_comparison_cells, (*self.description, *self.rows))),
            (unit, f"compared with {self.compared_with}", *notes, self.verdict),
        )

    def to_json(self) -> str:
        """Return the report as JSON text; a number that is not finite becomes null."""
        names = ("name", "base", "frames", "ok", "verdict", "samples", "compared", "skipped", "u", "compared_with")
        groups = {
            field: [{**asdict(row), "ok": row.ok, "note": row.note} for row in getattr(self, field)]
            for field in ("description", "rows")
        }
        return json_text({**{name: getattr(self, name) for name in names}, **groups})


def _robot_comparison_cells(row: RobotComparison) -> tuple[str, ...]:
    """Return a tuple of the cells, as strings, of a row of a report's table that compares one output of a robot with
    Pinocchio's.
    """
    if row.worst_sample is None:
        verdict = "not compared" if row.singular else "nothing compared"
        return row.output, "-", "-", f"{row.bound:g}", "-", "-", "0", verdict
    where = ",".join(map(str, row.worst_sample)) or "-"
    ratio = f"{row.max_ratio:.2f}" if row.max_ratio < 1e6 else f"{row.max_ratio:.1e}"
    part, verdict = printable(row.worst_part) or "-", "ok" if row.ok else "FAILED"
    return row.output, f"{row.max_error:.2e}", ratio, f"{row.bound:g}", where, part, str(row.samples), verdict
