"""The report of a cross-validation: per output, how far two routes are apart; as values, a table, or JSON."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import printable
from hingepair.numeric.tables import Sheet, Shown, aligned, json_text, left_out
from hingepair.pair.accuracy import PINOCCHIO_BOUND, PINOCCHIO_TERMS, PLANAR_SCALES, PROMISES

_HEADER = ("output", "largest error", "in u*scale", "bound", "at sample", "compared", "")


@dataclass(frozen=True, slots=True)
class Comparison:
    """One output by both routes.

    Attributes:
        output: its name.
        max_error: largest difference of a component, in the output's unit; inf where one route alone is finite.
        max_ratio: largest difference in units of u * scale, each sample by its own scale.
        worst_sample: index of the sample with the largest ratio; None where nothing was compared.
        samples: how many samples were compared.
        bound: the ratio that passes.
    """

    output: str
    max_error: float
    max_ratio: float
    worst_sample: tuple[int, ...] | None
    samples: int
    bound: float = PINOCCHIO_BOUND

    @property
    def ok(self) -> bool:
        """Something was compared, and every sample is within the bound."""
        return self.samples > 0 and self.max_ratio <= self.bound

    @property
    def scale(self) -> str:
        """The formula of the scale, for a reader."""
        more = PINOCCHIO_TERMS.get(self.output)
        own = PLANAR_SCALES.get(self.output) or PROMISES[self.output].scale
        return f"{own} + {more}" if more else own

    @classmethod
    def worst_of(
        cls, output: str, error: NDArray[np.float64], ratio: NDArray[np.float64], shape: tuple[int, ...]
    ) -> Comparison:
        """The worst of errors and ratios, (N,) each, NaN where not comparable; `shape` is that of the samples."""
        compared = ~np.isnan(ratio)
        if not compared.any():
            return cls(output, 0.0, 0.0, None, 0)
        worst = int(np.nanargmax(ratio))
        where = tuple(int(i) for i in np.unravel_index(worst, shape))
        return cls(output, float(np.nanmax(error)), float(ratio[worst]), where, int(compared.sum()))


@dataclass(frozen=True, slots=True, repr=False)
class CrossValidation(Shown):
    """The equations against Pinocchio.

    Attributes:
        name: the pair's name.
        sequence: of the Euler angles; None where the attitude of body 1 was given.
        shape: leading shape of the samples.
        skipped: samples left out because their input is not finite.
        u: unit roundoff of the type computed in.
        rows: one comparison for each output.
    """

    name: str
    sequence: str | None
    shape: tuple[int, ...]
    skipped: int
    u: float
    rows: tuple[Comparison, ...]

    @property
    def samples(self) -> int:
        """How many samples were given."""
        return math.prod(self.shape)

    @property
    def compared(self) -> int:
        """How many samples were compared."""
        return self.samples - self.skipped

    @property
    def ok(self) -> bool:
        """Every output of every finite sample is within its bound, and there was something to compare."""
        return bool(self.rows) and all(row.ok for row in self.rows)

    @property
    def verdict(self) -> str:
        """The outcome in a line."""
        beside = left_out(self.skipped, self.samples)
        if not self.compared:
            return f"NOTHING COMPARED: {'no finite sample' if self.samples else 'there are no samples'}{beside}"
        failed = [row.output for row in self.rows if not row.ok]
        if failed:
            return f"FAILED: {', '.join(failed)}{beside}"
        outputs = f"{len(self.rows)} outputs of {self.compared} sample{'s' if self.compared != 1 else ''}"
        return f"PASSED: {outputs} within {PINOCCHIO_BOUND} u*scale of Pinocchio{beside}"

    def __str__(self) -> str:
        lines = [_HEADER, *(_cells(row) for row in self.rows)]
        planar = any(row.output in PLANAR_SCALES for row in self.rows)
        given = "in the plane" if planar else "attitude given"
        attitude = given if self.sequence is None else f"Euler sequence {self.sequence}"
        title = f"{printable(self.name)}: the equations against Pinocchio, {attitude}"
        unit = f"u = {self.u:.3g}; scale: the size of an output's terms before they cancel (in full: .rows, --json)"
        return "\n".join((title, *aligned(lines, {1, 2, 3, 4, 5}), unit, self.verdict))

    def __repr__(self) -> str:
        return f"CrossValidation({self.name!r}, {self.verdict})"

    def _sheet(self) -> Sheet:
        title = f"{self.name}: the equations against Pinocchio"
        return Sheet(title, (_HEADER, *map(_cells, self.rows)), (self.verdict,))

    def to_json(self) -> str:
        """The report as JSON; a number that is not finite is null."""
        rows = [{**asdict(row), "ok": row.ok, "scale": row.scale} for row in self.rows]
        facts = {name: getattr(self, name) for name in ("name", "ok", "verdict", "samples", "compared", "skipped")}
        return json_text({**facts, "sequence": self.sequence, "u": self.u, "rows": rows})


def _cells(row: Comparison) -> tuple[str, ...]:
    if row.worst_sample is None:
        return row.output, "-", "-", f"{row.bound:g}", "-", "0", "nothing compared"
    where = ",".join(map(str, row.worst_sample)) or "-"
    verdict = "ok" if row.ok else "FAILED"
    error, ratio = f"{row.max_error:.2e}", f"{row.max_ratio:.2f}" if row.max_ratio < 1e6 else f"{row.max_ratio:.1e}"
    return row.output, error, ratio, f"{row.bound:g}", where, str(row.samples), verdict
