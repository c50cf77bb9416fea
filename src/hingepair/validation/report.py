"""The report of a cross-validation: the largest difference of each output from Pinocchio, as a table or JSON."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import printable
from hingepair.numeric.arrays import Float64Array
from hingepair.pair.accuracy import PINOCCHIO_ROUNDOFFS as MAX_RATIO
from hingepair.tables.sheets import Sheet, Shown, align_columns, json_text, left_out_remark

# A load is compared with a sum of some thirty terms, and the accelerations in it are solutions of linear equations.
MAX_LOAD_RATIO = 64  # u * scale by which a load may differ; the largest difference in 1,000 motions was 11


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of one output with Pinocchio's, over all samples and all links or joints that have it."""

    output: str
    #: largest difference of a component, in the unit of the output; inf if only one result is finite
    max_error: float
    #: largest difference in units of u * scale, where each sample has its own scale
    max_ratio: float
    #: sample with the largest ratio; None if nothing was compared
    worst_sample: tuple[int, ...] | None
    #: number of compared samples
    samples: int
    #: the largest ratio that passes
    bound: float = MAX_RATIO
    #: formula of the scale; "" where it is a sum over joints
    scale: str = ""
    #: link or joint with the largest ratio; "" for an output that has no parts
    worst_part: str = ""
    #: number of samples that were left out because the mass matrix is singular there
    singular: int = 0
    #: which joint nothing resists at the first of these samples
    unresisted: str = ""

    @property
    def ok(self) -> bool:
        """Whether something was compared, or excused by a singular mass matrix, and all of it is within the bound."""
        return (self.samples > 0 or self.singular > 0) and self.max_ratio <= self.bound

    @property
    def note(self) -> str:
        """Sentence on the samples that were left out because the mass matrix is singular; "" if there are none."""
        if not self.singular:
            return ""
        where = f"{self.singular} of {self.samples + self.singular} samples"
        return f"{self.output} is not compared at {where}, where the mass matrix is singular: {self.unresisted}"

    @classmethod
    def of(
        cls,
        output: str,
        computed: ArrayLike,
        expected: Float64Array,
        sizes: Float64Array,
        u: float,
        shape: tuple[int, ...],
        parts: Sequence[str] = ("",),
        **fields: Any,
    ) -> Comparison:
        """Return the comparison of computed with expected values.

        Args:
            output: name of the output.
            computed: shape (N, ...); with several parts (N, parts, ...).
            expected: like `computed`; what is not finite is not compared.
            sizes: scale of the errors; shape (N,), or any that broadcasts against `expected`.
            u: unit roundoff of the computation.
            shape: leading shape of the N samples.
            parts: names of the links or joints.
            **fields: further fields of the comparison.
        """
        sizes = sizes.reshape(sizes.shape + (1,) * (expected.ndim - 1)) if sizes.ndim == 1 else sizes
        comparable = np.isfinite(expected) & np.isfinite(sizes)
        smallest = float(np.finfo(np.float64 if u < 1e-12 else np.float32).tiny)  # the ratio of bodies at rest
        with np.errstate(all="ignore"):
            error = np.abs(np.asarray(computed, dtype=np.float64).reshape(expected.shape) - expected)
            error = np.where(comparable, np.where(np.isfinite(error), error, np.inf), np.nan)
            ratio = error / np.maximum(sizes * u, smallest)
        by_part = len(expected), len(parts), error[0].size // len(parts) if len(expected) else 1
        error, ratio = (values.reshape(by_part).max(axis=-1) for values in (error, ratio))
        return cls.worst_of(output, error, ratio, shape, parts, **fields)

    @classmethod
    def worst_of(
        cls,
        output: str,
        error: Float64Array,
        ratio: Float64Array,
        shape: tuple[int, ...],
        parts: Sequence[str],
        **fields: Any,
    ) -> Comparison:
        """Return the comparison with the largest of the ratios; `error` and `ratio` have shape (N, parts)."""
        compared = ~np.isnan(ratio).all(axis=1)
        if not compared.any():
            return cls(output, 0.0, 0.0, None, 0, **fields)
        sample, part = (int(i) for i in np.unravel_index(np.nanargmax(ratio), ratio.shape))
        where = tuple(int(i) for i in np.unravel_index(sample, shape))
        worst = float(np.nanmax(error)), float(ratio[sample, part])
        return cls(output, *worst, where, int(compared.sum()), worst_part=parts[part], **fields)

    def cells(self, with_parts: bool) -> tuple[str, ...]:
        """Return the row of this comparison in a table."""
        if self.worst_sample is None:
            verdict = "not compared" if self.singular else "nothing compared"
            return self.output, "-", "-", f"{self.bound:g}", "-", *("-",) * with_parts, "0", verdict
        error, ratio = (
            f"{self.max_error:.2e}",
            f"{self.max_ratio:.2f}" if self.max_ratio < 1e6 else f"{self.max_ratio:.1e}",
        )
        where, part = ",".join(map(str, self.worst_sample)) or "-", printable(self.worst_part) or "-"
        found = (self.output, error, ratio, f"{self.bound:g}", where, *(part,) * with_parts)
        return *found, str(self.samples), "ok" if self.ok else "FAILED"


@dataclass(frozen=True, slots=True)
class RateComparison:
    """Comparison of a rate, such as v1, with the slope of a quantity, such as R1, by finite differences."""

    rate: str
    #: the quantity whose rate it is
    of: str
    #: largest difference of a component, in the rate's unit
    max_error: float
    #: largest difference that passes
    allowed: float
    #: sample with the largest difference; None where nothing was compared
    worst_sample: int | None
    #: number of compared samples
    samples: int

    @property
    def ok(self) -> bool:
        """Whether no difference is larger than allowed; a rate that was not compared passes."""
        return self.max_error <= self.allowed

    @classmethod
    def worst_of(cls, rate: str, quantity: str, error: NDArray[np.float64], allowed: float) -> RateComparison:
        """Return the comparison with the largest of the errors, shape (N,); NaN is not compared."""
        compared = ~np.isnan(error)
        if not compared.any():
            return cls(rate, quantity, 0.0, allowed, None, 0)
        worst = int(np.nanargmax(error))
        return cls(rate, quantity, float(error[worst]), allowed, worst, int(compared.sum()))

    def cells(self) -> tuple[str, ...]:
        """Return the row of this comparison in a table."""
        if self.worst_sample is None:
            return self.rate, self.of, "-", f"{self.allowed:.2g}", "-", "0", "not compared"
        found = self.rate, self.of, f"{self.max_error:.2e}", f"{self.allowed:.2g}", str(self.worst_sample)
        return *found, str(self.samples), "ok" if self.ok else "FAILED"


class _Section(NamedTuple):
    """A table of the printed report."""

    title: str
    rows: Sequence[Sequence[str]]  # the first is the heading
    right: Collection[int]  # columns that are aligned to the right

    def lines(self) -> list[str]:
        return [*([self.title] if self.title else []), *align_columns(self.rows, self.right)]


@dataclass(frozen=True, slots=True, repr=False)
class CrossValidation(Shown):
    """Report on the comparison of the outputs of a pair or a robot with Pinocchio's."""

    name: str
    #: leading shape of the samples
    shape: tuple[int, ...]
    #: number of samples that were left out because their input is not finite
    skipped: int
    #: unit roundoff of the dtype of the computation
    u: float
    #: one comparison for each output
    rows: tuple[Comparison, ...]
    #: what was compared, for the title
    subject: str = ""
    #: Euler sequence of a pair; None if the attitude of body 1 was given as a matrix, in the plane, and of a robot
    sequence: str | None = None
    #: "fixed" or "free" of a robot; None of a pair
    base: str | None = None
    #: number of compared frames of a robot
    frames: int = 0
    #: where Pinocchio's model comes from
    compared_with: str = ""
    #: names, placements and inertias of a robot from a URDF, compared with Pinocchio's reading of it
    description: tuple[Comparison, ...] = ()
    #: of a simulated motion, its loads and the forces that it requires according to Pinocchio's `rnea`
    forces: tuple[Comparison, ...] = ()
    #: of a simulated motion, each rate and the slope of its quantity
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
        """Whether an output was compared, and all that was compared is within its bound."""
        oks = [row.ok for row in (*self.description, *self.rows, *self.forces)] + [row.ok for row in self.rates]
        return any(row.samples for row in self.rows) and all(oks)

    @property
    def verdict(self) -> str:
        """One line that says PASSED, FAILED with the failed outputs, or NOTHING COMPARED, and how many samples, if
        any, were left out.
        """
        beside = left_out_remark(self.skipped, self.samples)
        if not self.compared:
            return f"NOTHING COMPARED: {'no finite sample' if self.samples else 'there are no samples'}{beside}"
        failed = [row.output for row in (*self.description, *self.rows, *self.forces) if not row.ok]
        failed += [row.rate for row in self.rates if not row.ok]
        if failed:
            return f"FAILED: {', '.join(dict.fromkeys(failed))}{beside}"
        left = [row.output for row in self.rows if not row.samples]
        outputs = f"{len(self.rows) - len(left)} outputs of {self.compared} sample{'s' if self.compared != 1 else ''}"
        read = "the description and " if self.description else ""
        loads = ", ".join(row.output for row in self.forces)
        more = f", and {loads} within {MAX_LOAD_RATIO} u*scale of its rnea" if loads else ""
        without = f"; not compared: {', '.join(left)}" if left else ""
        return f"PASSED: {read}{outputs} within {MAX_RATIO} u*scale of Pinocchio{more}{without}{beside}"

    def _sections(self) -> list[_Section]:
        """Return the tables: of the outputs and, of a simulated motion, of its loads and rates."""
        rows = (*self.description, *self.rows)
        with_parts = any(row.worst_part for row in rows)
        parts = ("of",) * with_parts
        heading = ("output", "largest error", "in u*scale", "bound", "at sample", *parts, "compared", "")
        right = {1, 2, 3, 4, 5 + with_parts}
        sections = [_Section("", [heading, *(row.cells(with_parts) for row in rows)], right)]
        if self.forces:
            title = "the loads against the forces that the motion takes by Pinocchio's rnea"
            sections.append(_Section(title, [heading, *(row.cells(with_parts) for row in self.forces)], right))
        if self.rates:
            title = "the rates against slopes by finite differences, where the instants are close enough for them"
            heading = ("rate", "slope of", "largest error", "allowed", "at sample", "compared", "")
            sections.append(_Section(title, [heading, *(row.cells() for row in self.rates)], {2, 3, 4, 5}))
        return sections

    def _remarks(self) -> tuple[list[str], list[str]]:
        """Return the lines below the first table, and the last lines: notes and the verdict."""
        how = "summed over the joints" if self.base else "in full: .rows, --json"
        below = [f"u = {self.u:.3g}; scale: the size of an output's terms before they cancel ({how})"]
        below += [f"compared with {self.compared_with}"] if self.compared_with else []
        below += [row.note for row in self.rows if row.note]
        return below, [*(f"note: {note}" for note in self.notes), self.verdict]

    def __str__(self) -> str:
        (first, *others), (below, last) = self._sections(), self._remarks()
        more = (line for section in others for line in section.lines())
        return "\n".join((printable(self._title()), *first.lines(), *below, *more, *last))

    def __repr__(self) -> str:
        return f"CrossValidation({self.name!r}, {self.verdict})"

    def _title(self) -> str:
        return f"{self.name}: the equations against Pinocchio, {self.subject}"

    def _sheet(self) -> Sheet:
        """Return what notebooks show."""
        (first, *others), (below, last) = self._sections(), self._remarks()
        width = len(first.rows[0])
        more = (row for section in others for row in section.rows)
        rows = [tuple(row) + ("",) * (width - len(row)) for row in (*first.rows, *more)]
        return Sheet(self._title(), rows, (*below, *last))

    def to_json(self) -> str:
        """Return the report as JSON text; a number that is not finite becomes null."""
        names = ("name", "ok", "verdict", "samples", "compared", "skipped", "u", "notes")
        own = ("base", "frames", "compared_with") if self.base else ("sequence",)
        facts = {name: getattr(self, name) for name in (*names, *own)}
        for group in ("description", "rows", "forces", "rates"):
            facts[group] = [
                {**asdict(row), "ok": row.ok} | ({"note": row.note} if isinstance(row, Comparison) else {})
                for row in getattr(self, group)
            ]
        return json_text(facts)
