"""Residuals of the hinge constraints for any two motions (E1, E2), their tolerances, and the hinge angle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.results import Results
from hingepair.equations.quantities import QUANTITIES, attribute_texts
from hingepair.errors import ArgumentError, ShapeError, choices, quoted
from hingepair.mechanism.bodies.body_motion import MOTION_SHAPES, BodyMotion, motion_arrays
from hingepair.mechanism.pairs.accuracy import largest, norm, unit_roundoff
from hingepair.mechanism.pairs.subject import PairSubject
from hingepair.numeric.arrays import Float64Array, broadcast_shape, finite_number, read_only, real_array
from hingepair.plans.constraints import CONSTRAINTS
from hingepair.tables.sheets import Sheet, align_columns, instant_text, left_out_remark

_HEADINGS = ("residual", "rms", "largest", "unit", "tolerance", "of tolerance", "at sample", "at t", "compared", "")
_KINDS = ("gap", "tilt", "gap_rate", "tilt_rate", "gap_acceleration", "tilt_acceleration")
_ARRAYS = ("gap", "tilt", "tilt_angle", "psi", *_KINDS[2:4], "psid", *_KINDS[4:], "psidd")
# Size up to which round-off explains a residual, in units of u * scale: of motion that the library computed, 6 was
# the largest seen; of motion that another program did, each component may be 16 off (as against Pinocchio), the norm
# sqrt(3) times that.
_ROUNDOFFS = 32


class ResidualCheck(NamedTuple):
    """Comparison of one residual with its tolerance at all samples, a row of the printed table. The size of a
    residual is the norm of its array, of `tilt` the angle between the hinge axes.
    """

    residual: str  #: name of the residual, such as "gap"
    unit: str  #: unit of rms, largest and tolerance
    rms: float  #: root mean square of the sizes of all samples
    largest: float  #: largest size of all samples
    tolerance: float  #: tolerance at the worst sample, where size / tolerance is largest
    ratio: float  #: size / tolerance at the worst sample; the residual passes if this is at most 1
    worst_sample: tuple[int, ...] | None  #: index of the worst sample; None if no sample was compared
    worst_time: float | str | None  #: instant of the worst sample; None if no instants were given
    samples: int  #: number of samples that were compared
    basis: str  #: origin of the tolerance: "given", or "32 u * scale" for rounding errors

    @property
    def ok(self) -> bool:
        """Whether at least one sample was compared and every compared sample is within its tolerance."""
        return self.samples > 0 and self.ratio <= 1

    def _cells(self) -> tuple[str, ...]:
        """Return the cells of the row in the printed table."""
        if self.worst_sample is None:
            return self.residual, "-", "-", self.unit, "-", "-", "-", "-", "0", "nothing compared"
        where = ",".join(map(str, self.worst_sample)) or "-"
        when = "-" if self.worst_time is None else self.worst_time
        when = when if isinstance(when, str) else instant_text(when)
        sizes = f"{self.rms:.2e}", f"{self.largest:.2e}", self.unit, f"{self.tolerance:.2e}", f"{self.ratio:.2g}"
        return self.residual, *sizes, where, when, str(self.samples), "ok" if self.ok else "FAILED"


class Residuals(Results):
    """Residuals of the hinge constraints for two motions (E1, E2), compared with tolerances, and the hinge angle
    between the motions.

    The arrays are float64 and read-only, None where they need what the motions do not have. Rates and accelerations
    are exact time derivatives of gap, tilt and psi, even if the motions violate the constraints. tilt has two
    components, (h1 x h2) . (S1 e1) and (h1 x h2) . (S1 e2), with the hinge axis as it is fixed in body 1 and in body
    2, h1 = S1 n and h2 = S2 C^-1 n; e1 is the coordinate axis of body 1 along which n has its smallest component,
    made perpendicular to n and of unit length; e2 is n x e1. psi is in [-pi, pi], where the axes differ after the
    smallest rotation of body 2 that aligns them.
    """

    __slots__ = {
        **attribute_texts(_ARRAYS),
        "rows": "A `ResidualCheck` for each residual.",
        "u": "Unit roundoff of the least precise array of the motions.",
    }

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
    u: float

    def __init__(
        self, arrays: Mapping[str, Any], shape: tuple[int, ...], rows: tuple[ResidualCheck, ...], u: float
    ) -> None:
        super().__init__(arrays, shape)
        object.__setattr__(self, "rows", rows)
        object.__setattr__(self, "u", u)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.arrays(), self.shape, self.rows, self.u)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), "rows", "ok", "verdict", "skipped", "u"]

    @property
    def ok(self) -> bool:
        """Whether every residual was compared somewhere, and is within its tolerance wherever it was."""
        return all(row.ok for row in self.rows)

    @property
    def skipped(self) -> int:
        """Largest number of samples at which one residual is not finite, where it is not compared."""
        return math.prod(self.shape) - min(row.samples for row in self.rows)

    @property
    def verdict(self) -> str:
        """The result in one line, which begins with PASSED, FAILED or NOTHING COMPARED."""
        samples = math.prod(self.shape)
        beside = left_out_remark(self.skipped, samples)
        failed = [row.residual for row in self.rows if row.samples and not row.ok]
        if failed:
            return f"FAILED: {', '.join(failed)}{beside}"
        nothing = [row.residual for row in self.rows if not row.samples]
        if nothing:
            return f"NOTHING COMPARED: no finite sample of {', '.join(nothing)}{beside}"
        count = f"{samples} sample{'s' if samples != 1 else ''}"
        return f"PASSED: {len(self.rows)} residuals of {count} within tolerance{beside}"

    def __str__(self) -> str:
        title, rows, notes = self._sheet()
        return "\n".join((title, *align_columns(rows, {1, 2, 4, 5, 6, 7, 8}), *notes))

    def __repr__(self) -> str:
        return f"Residuals(shape={self.shape}, {self.verdict})"

    def _sheet(self) -> Sheet:
        """Return the printed table."""
        title = f"two motions against the constraints E1 and E2, u = {self.u:.3g}"
        return Sheet(title, (_HEADINGS, *(row._cells() for row in self.rows)), (self.verdict,))


def residuals(
    pair: PairSubject,
    body1: BodyMotion,
    body2: BodyMotion,
    tolerances: Mapping[str, float] | None,
    t: ArrayLike | None,
) -> Residuals:
    """Compute what `HingePair.residuals` returns."""
    motions: dict[str, NDArray[Any]] = {}
    for argument, body in (("body1", body1), ("body2", body2)):
        motion_arrays(argument, body, "S")
        motions |= motion_arrays(argument, body, *(one for one in MOTION_SHAPES if getattr(body, one) is not None))
    given = _checked_tolerances({} if tolerances is None else tolerances, motions)
    shapes = {"body1": body1.shape, "body2": body2.shape}
    shape = broadcast_shape({**shapes, "pair": pair.shape})
    instants = None if t is None else _broadcast_instants(t, shape)
    names = [name for name in _ARRAYS if not _missing(name, motions)]
    arrays = pair.compute_arrays(names, motions, shapes, np.dtype(np.float64))
    # That of the least precise array; integers count as float64.
    u = max(unit_roundoff(one.dtype if one.dtype.kind == "f" else np.float64) for one in motions.values())
    attitudes = np.isfinite(motions["S1"]).all(axis=(-2, -1)) & np.isfinite(motions["S2"]).all(axis=(-2, -1))
    with np.errstate(all="ignore"):
        scales = _scales(pair, motions)
        rows = [
            _check(
                name,
                arrays["tilt_angle"] if name == "tilt" else norm(arrays[name]),
                np.broadcast_to(attitudes & np.isfinite(scales[name]), shape),
                np.maximum(scales[name] * u, np.finfo(np.float64).tiny) * _ROUNDOFFS,
                given.get(name),
                instants,
            )
            for name in _KINDS
            if name in arrays
        ]
    return Residuals({key: read_only(np.asarray(one)) for key, one in arrays.items()}, shape, tuple(rows), u)


def _missing(name: str, motions: Mapping[str, Any]) -> list[str]:
    """Return the arrays of bodies that an output needs beside those given."""
    needed = CONSTRAINTS[name][0]
    return [f"body{k}.{letter}" for letter in MOTION_SHAPES for k in "12"
            if f"{letter}{k}" in needed and f"{letter}{k}" not in motions]  # fmt: skip


def _scales(pair: PairSubject, motions: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return the scales that the rounding errors of residuals are relative to, 0 in place of what is not given."""
    u1, u2 = norm(pair.arrays["u1"]), norm(pair.arrays["u2"])
    size = {name: (largest if name[0] in "Rva" and len(name) == 2 else norm)(one) for name, one in motions.items()}
    R, v, a = (np.maximum(size.get(f"{letter}1", 0.0), size.get(f"{letter}2", 0.0)) for letter in "Rva")
    W1, W2, A1, A2 = (size.get(name, 0.0) for name in ("omega1", "omega2", "alpha1", "alpha2"))
    return {
        "gap": R + (u1 + u2),
        "tilt": np.float64(1.0),
        "gap_rate": v + W1 * u1 + W2 * u2,
        "tilt_rate": W1 + W2,
        # Squares alone could overflow.
        "gap_acceleration": a + (A1 * u1 + W1 * (W1 * u1)) + (A2 * u2 + W2 * (W2 * u2)),
        "tilt_acceleration": A1 + A2 + (W1 + W2) * (W1 + W2),
    }


def _broadcast_instants(t: ArrayLike, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return instants as an array of the samples' shape."""
    stamps = np.asarray(t)
    array = stamps if stamps.dtype.kind in "mM" else real_array("t", t)
    try:
        return np.broadcast_to(array, shape)
    except ValueError:
        expected = f"instants that broadcast to the samples' shape {shape}"
        raise ShapeError("t", expected, f"shape {array.shape}") from None


def _check(
    name: str, size: Any, known: Any, rounding: Any, given: float | None, t: NDArray[Any] | None
) -> ResidualCheck:
    """Return the check of a residual at the samples where the motions are known."""
    unit, samples = QUANTITIES[name].unit, int(known.sum())
    basis = f"{_ROUNDOFFS} u * scale" if given is None else "given"
    if not samples:
        return ResidualCheck(name, unit, 0.0, 0.0, math.nan, 0.0, None, None, 0, basis)
    tolerance = np.broadcast_to(rounding if given is None else given, known.shape)
    size = np.where(known, np.where(np.isfinite(size), size, np.inf), 0.0)
    ratio = np.where(known, size / tolerance, -np.inf)
    where = tuple(int(i) for i in np.unravel_index(int(np.argmax(ratio)), known.shape))
    when = None if t is None else str(t[where]) if t.dtype.kind in "mM" else t[where].item()
    rms = float(norm(size.ravel()) / math.sqrt(samples))
    worst = float(tolerance[where]), float(ratio[where])
    return ResidualCheck(name, unit, rms, float(size.max()), *worst, where, when, samples, basis)


def _checked_tolerances(tolerances: object, motions: Mapping[str, Any]) -> dict[str, float]:
    """Return the argument `tolerances` as positive floats by residual."""
    if not isinstance(tolerances, Mapping):
        raise ArgumentError("tolerances", "a dict of numbers by residual, such as {'gap': 1e-3}", quoted(tolerances))
    checked = {}
    for name, value in tolerances.items():
        if name not in _KINDS:
            raise ArgumentError("tolerances", choices(_KINDS), repr(name))
        label = f"tolerances[{name!r}]"
        checked[name] = finite_number(label, value)
        if checked[name] <= 0:
            raise ArgumentError(label, f"a positive number [{QUANTITIES[name].unit}]", value)
        if missing := _missing(name, motions):
            raise ArgumentError(label, f"motions with what {name} needs", f"no {', '.join(missing)}")
    return checked
