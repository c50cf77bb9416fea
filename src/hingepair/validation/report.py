"""The report of a cross-validation: the largest difference of each output from Pinocchio, as a table or JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import printable
from hingepair.mechanism.pairs.accuracy import PINOCCHIO_ROUNDOFFS as MAX_RATIO
from hingepair.numeric.arrays import Float64Array
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
    #: link or joint with the largest ratio; "" for an output that has no parts
    worst_part: str = ""

    @property
    def ok(self) -> bool:
        """Whether something was compared, and all of it is within the bound."""
        return self.samples > 0 and self.max_ratio <= self.bound

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
            return self.output, "-", "-", f"{self.bound:g}", "-", *("-",) * with_parts, "0", "nothing compared"
        ratio = f"{self.max_ratio:.2f}" if self.max_ratio < 1e6 else f"{self.max_ratio:.1e}"
        where, part = ",".join(map(str, self.worst_sample)) or "-", printable(self.worst_part) or "-"
        found = (self.output, f"{self.max_error:.2e}", ratio, f"{self.bound:g}", where, *(part,) * with_parts)
        return *found, str(self.samples), "ok" if self.ok else "FAILED"


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
    #: one comparison for each output; of a simulated motion, of its loads and rates, too
    rows: tuple[Comparison, ...]
    #: what was compared, for the title
    subject: str = ""
    #: where Pinocchio's model comes from
    compared_with: str = ""
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
        """Whether outputs were compared, and all that was compared is within its bound."""
        return bool(self.rows) and all(row.ok for row in self.rows)

    @property
    def verdict(self) -> str:
        """One line that says PASSED, FAILED with the failed outputs, or NOTHING COMPARED, and how many samples, if
        any, were left out.
        """
        beside = left_out_remark(self.skipped, self.samples)
        if not self.compared:
            return f"NOTHING COMPARED: {'no finite sample' if self.samples else 'there are no samples'}{beside}"
        failed = [row.output for row in self.rows if not row.ok]
        if failed:
            return f"FAILED: {', '.join(dict.fromkeys(failed))}{beside}"
        count, several = sum(row.bound == MAX_RATIO for row in self.rows), "s" * (self.compared != 1)
        loads = ", ".join(row.output for row in self.rows if row.bound == MAX_LOAD_RATIO)
        more = f", and {loads} within {MAX_LOAD_RATIO} u*scale of its rnea" if loads else ""
        within = f"within {MAX_RATIO} u*scale of Pinocchio{more}"
        return f"PASSED: {count} outputs of {self.compared} sample{several} {within}{beside}"

    def __str__(self) -> str:
        title, rows, notes = self._sheet()
        right = {*range(1, len(rows[0]) - 1)} - {5 if "of" in rows[0] else 0}
        return "\n".join((printable(title), *align_columns(rows, right), *notes))

    def _sheet(self) -> Sheet:
        """Return the table of outputs; then remarks and the verdict."""
        with_parts = any(row.worst_part for row in self.rows)
        first = ("output", "largest error", "in u*scale", "bound", "at sample")
        rows = [(*first, *("of",) * with_parts, "compared", ""), *(row.cells(with_parts) for row in self.rows)]
        notes = [f"u = {self.u:.3g}; scale: the size of an output's terms before they cancel"]
        notes += [f"compared with {self.compared_with}"] if self.compared_with else []
        notes += [f"note: {note}" for note in self.notes]
        return Sheet(f"{self.name}: the equations against Pinocchio, {self.subject}", rows, (*notes, self.verdict))

    def __repr__(self) -> str:
        return f"CrossValidation({self.name!r}, {self.verdict})"

    def to_json(self) -> str:
        """Return the report as JSON text; a number that is not finite becomes null."""
        names = ("name", "subject", "compared_with", "ok", "verdict", "samples", "compared", "skipped", "u", "notes")
        facts = {name: getattr(self, name) for name in names}
        return json_text(facts | {"rows": [{**asdict(row), "ok": row.ok} for row in self.rows]})
