"""The residuals of two motions as a value: arrays, the worst of each beside its tolerance, a table, JSON."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import Float64Array, Frozen
from hingepair.numeric.tables import aligned, finite_or_none, left_out

_HEADER = (
    *("residual", "", "rms", "largest", "worst", "unit", "tolerance", "worst/tolerance", "at sample", "at t"),
    *("compared", ""),
)


@dataclass(frozen=True, slots=True)
class ResidualCheck:
    """One residual beside its tolerance.

    Attributes:
        residual: its name.
        label: of the equation, with a prime for each derivative.
        unit: of rms, largest, worst and tolerance.
        largest: largest size of all samples: the norm, of the tilt the angle between the axes (`tilt_angle`).
        rms: root of the mean square of the sizes.
        worst: size at the worst sample, which is that with the largest part of its tolerance.
        tolerance: what is allowed at the worst sample.
        ratio: worst / tolerance; up to 1 passes.
        worst_sample: index of that sample; None where nothing was compared.
        worst_time: instant of that sample, where instants were given.
        samples: how many samples were compared.
        basis: where the tolerance comes from: "given", or the formula of round-off.
    """

    residual: str
    label: str
    unit: str
    largest: float
    rms: float
    worst: float
    tolerance: float
    ratio: float
    worst_sample: tuple[int, ...] | None
    worst_time: float | str | None
    samples: int
    basis: str

    @property
    def ok(self) -> bool:
        """Something was compared, and every sample is within its tolerance."""
        return self.samples > 0 and self.ratio <= 1

    def _cells(self) -> tuple[str, ...]:
        if self.worst_sample is None:
            return self.residual, self.label, "-", "-", "-", self.unit, "-", "-", "-", "-", "0", "nothing compared"
        where = ",".join(map(str, self.worst_sample)) or "-"
        when = "-" if self.worst_time is None else str(self.worst_time)
        sizes = f"{self.rms:.2e}", f"{self.largest:.2e}", f"{self.worst:.2e}"
        numbers = *sizes, self.unit, f"{self.tolerance:.2e}", f"{self.ratio:.2g}"
        return self.residual, self.label, *numbers, where, when, str(self.samples), "ok" if self.ok else "FAILED"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Residuals(Frozen):
    """How far two motions are from one hinge (E1, E2), and the hinge angle between them.

    Everything is float64 and read-only; None where the motions do not hold what it takes. The components of the tilt
    are those of S1 n x S2 C^-1 n along S1 e1 and S1 e2 (`HingePair.constraint_jacobian` says which axes). The rates
    and accelerations are the exact derivatives of gap, tilt and psi, for motions that are no hinge as well.

    Attributes:
        gap: R1 + S1 u1 - (R2 + S2 u2), world axes; (..., 3) m.
        tilt: components of the misalignment of the axes, the SINE of the angle: about 0 for an axis that is flipped
            by pi as well; (..., 2). What the row `tilt` judges is tilt_angle.
        tilt_angle: the angle between S1 n and S2 C^-1 n, in [0, pi]; (...,) rad.
        psi: hinge angle in [-pi, pi], of tilted axes the twist about them; (...,) rad.
        gap_rate: rate of the gap; (..., 3) m/s.
        tilt_rate: rate of the tilt: omega2 - omega1 across the axis; (..., 2) rad/s.
        psid: rate of psi; (...,) rad/s.
        gap_acceleration: second derivative of the gap; (..., 3) m/s^2.
        tilt_acceleration: second derivative of the tilt; (..., 2) rad/s^2.
        psidd: second derivative of psi; (...,) rad/s^2.
        rows: every residual beside its tolerance.
        name: the pair's.
        shape: leading shape of the samples.
        skipped: samples of which at least one residual is not finite; they are left out where they are not.
        u: unit roundoff of the least precise array given.
        t: instants of the samples; None where they were not given.
    """

    gap: Float64Array
    tilt: Float64Array
    tilt_angle: Float64Array
    psi: Float64Array
    gap_rate: Float64Array | None
    tilt_rate: Float64Array | None
    psid: Float64Array | None
    gap_acceleration: Float64Array | None
    tilt_acceleration: Float64Array | None
    psidd: Float64Array | None
    rows: tuple[ResidualCheck, ...]
    name: str
    shape: tuple[int, ...]
    skipped: int
    u: float
    t: NDArray[Any] | None

    @property
    def ok(self) -> bool:
        """Every residual of every finite sample is within its tolerance, and there was something to compare."""
        return all(row.ok for row in self.rows)

    @property
    def verdict(self) -> str:
        """The outcome in a line."""
        samples = math.prod(self.shape)
        beside = left_out(self.skipped, samples)
        failed = [row.residual for row in self.rows if row.samples and not row.ok]
        if failed:
            return f"FAILED: {', '.join(failed)}{beside}"
        nothing = [row.residual for row in self.rows if not row.samples]
        if nothing:
            return f"NOTHING COMPARED: no finite sample of {', '.join(nothing)}{beside}"
        count = f"{samples} sample{'s' if samples != 1 else ''}"
        return f"PASSED: {len(self.rows)} residuals of {count} within tolerance{beside}"

    def unwrapped_psi(self, axis: int = -1) -> Float64Array:
        """The hinge angle without jumps of 2 pi along an axis of the samples, such as time; (...,) rad.

        Right where psi changes by less than pi from one finite sample to the next; samples that are not finite are
        stepped over.

        Args:
            axis: the axis of time.

        Raises:
            ArgumentError: the samples have no such axis.
        """
        if isinstance(axis, bool) or not isinstance(axis, int) or not -len(self.shape) <= axis < len(self.shape):
            raise ArgumentError("axis", f"an axis of samples of shape {self.shape}", quoted(axis))
        psi = np.array(self.psi)
        rows = np.moveaxis(psi, axis, -1)
        for index in np.ndindex(rows.shape[:-1]):
            finite = np.isfinite(rows[index])
            rows[index][finite] = np.unwrap(rows[index][finite])
        return psi

    def __str__(self) -> str:
        table = aligned([_HEADER, *(row._cells() for row in self.rows)], {2, 3, 4, 6, 7, 8, 9, 10})
        title = f"{self.name}: two motions against the constraints, u = {self.u:.3g}"
        angle = {"tilt": " (the angle, tilt_angle)"}
        bases = [f"tolerance of {row.residual}{angle.get(row.residual, '')}: {row.basis}" for row in self.rows]
        return "\n".join((title, *table, "", *bases, self.verdict))

    def __repr__(self) -> str:
        return f"Residuals(shape={self.shape}, {self.verdict})"

    def to_json(self) -> str:
        """The report, without the arrays, as JSON; a number that is not finite is null."""
        import json

        rows = [
            {
                "residual": row.residual,
                "label": row.label,
                "unit": row.unit,
                "largest": finite_or_none(row.largest),
                "rms": finite_or_none(row.rms),
                "worst": finite_or_none(row.worst),
                "tolerance": finite_or_none(row.tolerance),
                "ratio": finite_or_none(row.ratio),
                "worst_sample": None if row.worst_sample is None else list(row.worst_sample),
                "worst_time": finite_or_none(row.worst_time) if isinstance(row.worst_time, float) else row.worst_time,
                "samples": row.samples,
                "ok": row.ok,
                "basis": row.basis,
            }
            for row in self.rows
        ]
        report = {
            "name": self.name,
            "ok": self.ok,
            "verdict": self.verdict,
            "samples": math.prod(self.shape),
            "skipped": self.skipped,
            "u": self.u,
            "rows": rows,
        }
        return json.dumps(report, indent=2, allow_nan=False)
