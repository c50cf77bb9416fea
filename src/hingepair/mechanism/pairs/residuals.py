"""Residuals of the hinge constraints for any two motions (E1, E2), their tolerances, and the hinge angle."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.results import Results
from hingepair.equations.quantities import attribute_texts
from hingepair.errors import ArgumentError, ShapeError, choices, quoted
from hingepair.mechanism.bodies.body_motion import MOTION_SHAPES, BodyMotion, motion_arrays
from hingepair.mechanism.pairs.accuracy import largest, norm, unit_roundoff
from hingepair.mechanism.pairs.geometry import Constants
from hingepair.mechanism.pairs.requests import compute_arrays
from hingepair.numeric.arrays import Float64Array, broadcast_shape, finite_number, read_only, real_array
from hingepair.plans.constraints import CONSTRAINTS
from hingepair.tables.sheets import Sheet, align_columns, instant_text, json_text, left_out_remark

# The headings of the printed table.
_HEADINGS = (
    *("residual", "", "rms", "largest", "worst", "unit", "tolerance", "worst/tolerance", "at sample", "at t"),
    *("compared", ""),
)


# Attributes of a report beside those of all results.
_OF_REPORTS = ("rows", "ok", "verdict", "skipped", "to_json", "unwrapped_psi", "name", "t", "u")


class ResidualCheck(NamedTuple):
    """Comparison of one residual with its tolerance at all samples, a row of the printed table. The worst sample is
    the one with the largest size / tolerance; the size is the norm of the residual's array, of `tilt` the angle
    between the hinge axes.
    """

    residual: str  #: name of the residual, such as "gap"
    label: str  #: label of its equation, with a prime for each time derivative
    unit: str  #: unit of rms, largest, worst and tolerance
    largest: float  #: largest size of all samples
    rms: float  #: root mean square of the sizes of all samples
    worst: float  #: size at the worst sample
    tolerance: float  #: tolerance at the worst sample
    ratio: float  #: worst / tolerance; the residual passes if this is at most 1
    worst_sample: tuple[int, ...] | None  #: index of the worst sample; None if no sample was compared
    worst_time: float | str | None  #: instant of the worst sample; None if no instants were given
    samples: int  #: number of samples that were compared
    basis: str  #: origin of the tolerance: "given", or the formula for rounding errors

    @property
    def ok(self) -> bool:
        """Whether at least one sample was compared and every compared sample is within its tolerance."""
        return self.samples > 0 and self.ratio <= 1

    def _cells(self) -> tuple[str, ...]:
        """Return the cells of the row in the printed table."""
        if self.worst_sample is None:
            return self.residual, self.label, "-", "-", "-", self.unit, "-", "-", "-", "-", "0", "nothing compared"
        where = ",".join(map(str, self.worst_sample)) or "-"
        when = "-" if self.worst_time is None else self.worst_time
        when = when if isinstance(when, str) else instant_text(when)
        sizes = f"{self.rms:.2e}", f"{self.largest:.2e}", f"{self.worst:.2e}"
        numbers = *sizes, self.unit, f"{self.tolerance:.2e}", f"{self.ratio:.2g}"
        return self.residual, self.label, *numbers, where, when, str(self.samples), "ok" if self.ok else "FAILED"


# The attributes of a report that are arrays over the samples.
_ARRAYS = (
    *("gap", "tilt", "tilt_angle", "psi"),
    *("gap_rate", "tilt_rate", "psid", "gap_acceleration", "tilt_acceleration", "psidd"),
)


class Residuals(Results):
    """Residuals of the hinge constraints for two motions (E1, E2), compared with tolerances, and the hinge angle
    between the motions.

    The arrays are float64 and read-only, None where they need what the motions do not have. Rates and accelerations
    are exact time derivatives of gap, tilt and psi, even if the motions violate the constraints. tilt has two
    components, as `constraint_jacobian` defines them; psi is in [-pi, pi], where the axes differ after the smallest
    rotation of body 2 that aligns them.
    """

    __slots__ = {
        **attribute_texts(_ARRAYS),
        "rows": "A `ResidualCheck` for each residual.",
        "name": "Name of the pair.",
        "skipped": "Number of samples at which a residual is not finite, where it is not compared.",
        "u": "Unit roundoff of the least precise array of the motions.",
        "t": "Instants of the samples; None if they were not given.",
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
    name: str
    skipped: int
    u: float
    t: NDArray[Any] | None

    def __init__(
        self,
        arrays: Mapping[str, Any],
        shape: tuple[int, ...],
        rows: tuple[ResidualCheck, ...],
        name: str,
        skipped: int,
        u: float,
        t: NDArray[Any] | None,
    ) -> None:
        super().__init__(arrays, shape)
        for key, value in {"rows": rows, "name": name, "skipped": skipped, "u": u, "t": t}.items():
            object.__setattr__(self, key, value)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.arrays(), self.shape, *self._facts())

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *_OF_REPORTS]

    def _facts(self) -> tuple[Any, ...]:
        return self.rows, self.name, self.skipped, self.u, self.t

    def _recorded(self) -> dict[str, Any]:
        return self.arrays() if self.t is None else {"t": self.t, **self.arrays()}

    @property
    def ok(self) -> bool:
        """Whether every residual was compared somewhere, and is within its tolerance wherever it was."""
        return all(row.ok for row in self.rows)

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

    def unwrapped_psi(self, axis: int = -1) -> Float64Array:
        """Return the hinge angle without jumps by 2 pi along the time axis [rad]; right if psi changes by less than
        pi between finite samples.

        Args:
            axis: index of the time axis among the axes of the samples.

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
        table = align_columns([_HEADINGS, *(row._cells() for row in self.rows)], {2, 3, 4, 6, 7, 8, 9, 10})
        title = f"{self.name}: two motions against the constraints, u = {self.u:.3g}"
        angle = {"tilt": " (the angle, tilt_angle)"}
        bases = [f"tolerance of {row.residual}{angle.get(row.residual, '')}: {row.basis}" for row in self.rows]
        return "\n".join((title, *table, "", *bases, self.verdict))

    def __repr__(self) -> str:
        return f"Residuals(shape={self.shape}, {self.verdict})"

    def _sheet(self) -> Sheet:
        """Return the printed table."""
        return Sheet(self.name, (_HEADINGS, *(row._cells() for row in self.rows)), (self.verdict,))

    def to_json(self) -> str:
        """Return the report without the arrays as a JSON text. Numbers that are not finite become null."""
        rows = [{**row._asdict(), "ok": row.ok} for row in self.rows]
        facts = {"name": self.name, "ok": self.ok, "verdict": self.verdict, "samples": math.prod(self.shape)}
        return json_text({**facts, "skipped": self.skipped, "u": self.u, "rows": rows})


# Size up to which round-off explains a residual, in units of u * scale: of motion that the library computed, 6 was
# the largest seen; of motion that another program did, each component may be 16 off (as against Pinocchio), the norm
# sqrt(3) times that.
_ROUNDOFFS = 32


class _Kind(NamedTuple):
    """Properties of a kind of residual."""

    label: str  # label of the equation, with a prime for each time derivative
    unit: str  # unit of the size of the residual
    letters: tuple[str, ...]  # names of the velocities and accelerations that both motions must have
    scale: str  # formula of the scale that rounding errors are relative to, as text
    size: str  # name of the array whose norm is the size of the residual


# The residuals that are compared with tolerances; W_i = abs(omega_i), A_i = abs(alpha_i), max abs over the components
# of both bodies.
_KINDS = {
    "gap": _Kind("E1", "m", (), "max abs(R) + abs(u1) + abs(u2)", "gap"),
    "tilt": _Kind("E2", "rad", (), "1", "tilt_angle"),
    "gap_rate": _Kind("E1'", "m/s", ("v", "omega"), "max abs(v) + W1 abs(u1) + W2 abs(u2)", "gap_rate"),
    "tilt_rate": _Kind("E2'", "rad/s", ("omega",), "W1 + W2", "tilt_rate"),
    "gap_acceleration": _Kind(
        "E1''",
        "m/s^2",
        ("v", "omega", "a", "alpha"),
        "max abs(a) + (A1 + W1^2) abs(u1) + (A2 + W2^2) abs(u2)",
        "gap_acceleration",
    ),
    "tilt_acceleration": _Kind("E2''", "rad/s^2", ("omega", "alpha"), "A1 + A2 + (W1 + W2)^2", "tilt_acceleration"),
}


def _instant_of(t: NDArray[Any] | None, sample: tuple[int, ...] | None) -> float | str | None:
    """Return the instant of a sample, a number or text; None without instants."""
    if t is None or sample is None:
        return None
    return str(t[sample]) if t.dtype.kind in "mM" else t[sample].item()


def _compute_residuals(
    pair: Constants, body1: BodyMotion, body2: BodyMotion, tolerances: Mapping[str, float] | None
) -> tuple[dict[str, NDArray[Any]], dict[str, tuple[Float64Array, Float64Array]], float]:
    """Compute all residuals for which two motions suffice: the arrays of a report; by kind the sizes, -inf where the
    motion is not finite, and their tolerances; and the unit roundoff of the least precise array given.
    """
    motions = _read_both_motions(body1, body2)
    given = _check_tolerances(tolerances)
    for kind in given:
        _check_rates_present(kind, motions)
    shapes = {"body1": body1.shape, "body2": body2.shape}
    shape = broadcast_shape({**shapes, "pair": pair.shape})
    arrays = _computable_arrays(pair, motions, shapes)
    u = _largest_roundoff(array.dtype for array in motions.values())
    attitudes = np.isfinite(motions["S1"]).all(axis=(-2, -1)) & np.isfinite(motions["S2"]).all(axis=(-2, -1))
    compared = {}
    for kind, scale in _residual_scales(pair, motions, [kind for kind in _KINDS if kind in arrays]).items():
        size = arrays[_KINDS[kind].size]
        size = size if size.ndim == len(shape) else norm(size)
        is_finite = np.broadcast_to(attitudes & np.isfinite(scale), shape)
        sizes = np.where(is_finite, np.where(np.isfinite(size), size, np.inf), -np.inf)
        with np.errstate(all="ignore"):
            rounding = _ROUNDOFFS * np.maximum(scale * u, np.finfo(np.float64).tiny)
        compared[kind] = sizes, np.broadcast_to(given.get(kind, rounding), shape)
    return arrays, compared, u


def _ratio(sizes: Float64Array, tolerance: Float64Array) -> Float64Array:
    """Return sizes in parts of their tolerances; -inf where the motion is not finite."""
    with np.errstate(all="ignore"):
        return np.where(sizes == -np.inf, -np.inf, sizes / tolerance)


def _basis(kind: str, given: Collection[str]) -> str:
    """Return where the tolerance of a kind of residual comes from: "given", or a formula."""
    return "given" if kind in given else f"{_ROUNDOFFS} u * ({_KINDS[kind].scale})"


def _largest_roundoff(dtypes: Iterable[np.dtype[Any]]) -> float:
    """Return the unit roundoff of the least precise of the dtypes, the largest one; integers count as float64."""
    return max(unit_roundoff(dtype if dtype.kind == "f" else np.float64) for dtype in dtypes)


def _read_both_motions(body1: BodyMotion, body2: BodyMotion) -> dict[str, NDArray[Any]]:
    """Return a dict of all arrays of two BodyMotions that are not None, with keys such as R1 and omega2."""
    motions: dict[str, NDArray[Any]] = {}
    for argument, body in (("body1", body1), ("body2", body2)):
        motion_arrays(argument, body, "S")
        letters = (letter for letter in ("R", "S", "v", "omega", "a", "alpha") if getattr(body, letter) is not None)
        motions |= motion_arrays(argument, body, *letters)
    return motions


def _computable_arrays(
    pair: Constants, motions: Mapping[str, NDArray[Any]], shapes: Mapping[str, tuple[int, ...]]
) -> dict[str, NDArray[Any]]:
    """Compute those residuals and hinge angles for which the motions suffice; float64 arrays by name."""
    bodies = {f"{letter}{k}" for letter in MOTION_SHAPES for k in "12"}
    names = [name for name in _ARRAYS if bodies.intersection(CONSTRAINTS[name][0]) <= motions.keys()]
    return compute_arrays(pair, names, motions, shapes, np.dtype(np.float64))


def residuals(
    pair: Constants,
    name: str,
    body1: BodyMotion,
    body2: BodyMotion,
    tolerances: Mapping[str, float] | None,
    t: ArrayLike | None,
) -> Residuals:
    """Compute what `HingePair.residuals` returns."""
    arrays, compared, u = _compute_residuals(pair, body1, body2, tolerances)
    checks, finite = [], np.True_
    for kind, (sizes, tolerance) in compared.items():
        checks.append(_worst_sample_check(kind, sizes, tolerance, _basis(kind, tolerances or ())))
        finite = finite & (sizes != -np.inf)
    instants = None if t is None else _broadcast_instants(t, finite.shape)
    rows = tuple(row._replace(worst_time=_instant_of(instants, row.worst_sample)) for row in checks)
    shown = {key: read_only(np.asarray(array)) for key, array in arrays.items()}
    return Residuals(shown, finite.shape, rows, name, int((~finite).sum()), u, instants)


def _broadcast_instants(t: ArrayLike, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return instants as a read-only array of the samples' shape."""
    stamps = np.asarray(t)
    array = stamps if stamps.dtype.kind in "mM" else real_array("t", t)
    try:
        return read_only(np.broadcast_to(array, shape))
    except ValueError:
        expected = f"instants that broadcast to the samples' shape {shape}"
        raise ShapeError("t", expected, f"shape {array.shape}") from None


def _worst_sample_check(kind: str, sizes: Float64Array, tolerance: Float64Array, basis: str) -> ResidualCheck:
    """Return the check of a residual, with its worst sample, but without the instant."""
    label, unit, *_ = _KINDS[kind]
    is_finite, ratio = sizes != -np.inf, _ratio(sizes, tolerance)
    samples = int(is_finite.sum())
    if not samples:
        return ResidualCheck(kind, label, unit, 0.0, 0.0, 0.0, math.nan, 0.0, None, None, 0, basis)
    where = tuple(int(i) for i in np.unravel_index(int(np.argmax(ratio)), sizes.shape))
    highest = float(sizes.max())
    relative = np.where(is_finite, sizes, 0.0) / (highest if 0 < highest < np.inf else 1.0)  # squares stay in range
    rms = highest if highest == np.inf else highest * math.sqrt(float(np.square(relative).sum()) / samples)
    worst = float(sizes[where]), float(tolerance[where]), float(ratio[where])
    return ResidualCheck(kind, label, unit, highest, rms, *worst, where, None, samples, basis)


def _residual_scales(pair: Constants, motions: dict[str, NDArray[Any]], kinds: list[str]) -> dict[str, Float64Array]:
    """Return the scales of rounding errors by kind, the formulas of `_KINDS`."""
    lever1, lever2 = norm(pair.arrays["u1"]), norm(pair.arrays["u2"])

    def largest_of_both(letter: str) -> Float64Array:
        """Return the largest absolute component of the arrays `letter` of both bodies; shape (...,)."""
        return np.asarray(np.maximum(largest(motions[f"{letter}1"]), largest(motions[f"{letter}2"])))

    scales: dict[str, Any] = {"gap": largest_of_both("R") + (lever1 + lever2), "tilt": np.float64(1.0)}
    with np.errstate(all="ignore"):
        if "tilt_rate" in kinds:
            W1, W2 = norm(motions["omega1"]), norm(motions["omega2"])
            scales["tilt_rate"] = W1 + W2
        if "gap_rate" in kinds:
            scales["gap_rate"] = largest_of_both("v") + W1 * lever1 + W2 * lever2
        if "tilt_acceleration" in kinds:
            A1, A2 = norm(motions["alpha1"]), norm(motions["alpha2"])
            scales["tilt_acceleration"] = A1 + A2 + (W1 + W2) * (W1 + W2)
        if "gap_acceleration" in kinds:
            scales["gap_acceleration"] = largest_of_both("a") + (
                (A1 * lever1 + W1 * (W1 * lever1)) + (A2 * lever2 + W2 * (W2 * lever2))
            )
    return {kind: scales[kind] for kind in kinds}


def _check_rates_present(kind: str, motions: Mapping[str, NDArray[Any]]) -> None:
    """Refuse a tolerance for a residual whose velocities or accelerations the motions do not have."""
    letters = _KINDS[kind].letters
    missing = [f"body{i}.{letter}" for i in (1, 2) for letter in letters if f"{letter}{i}" not in motions]
    if missing:
        expected = f"motions with {' and '.join(letters)}, since {kind} needs them"
        raise ArgumentError(f"tolerances[{kind!r}]", expected, f"no {', '.join(missing)}")


def _check_tolerances(tolerances: Mapping[str, float] | None) -> dict[str, float]:
    """Return the argument `tolerances` as positive floats by kind of residual."""
    if tolerances is None:
        return {}
    if not isinstance(tolerances, Mapping):
        raise ArgumentError("tolerances", "a dict of numbers by residual, such as {'gap': 1e-3}", quoted(tolerances))
    tolerance_by_kind = {}
    for key, value in tolerances.items():
        if key not in _KINDS:
            raise ArgumentError("tolerances", choices(tuple(_KINDS)), repr(key))
        number = finite_number(f"tolerances[{key!r}]", value)
        if number <= 0:
            raise ArgumentError(f"tolerances[{key!r}]", f"a positive number [{_KINDS[key].unit}]", value)
        tolerance_by_kind[key] = number
    return tolerance_by_kind
