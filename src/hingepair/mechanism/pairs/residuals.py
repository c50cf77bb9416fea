"""Residuals of the hinge constraints for any two motions (E1, E2), their tolerances, and the hinge angle."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
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
_OF_REPORTS = ("rows", "ok", "verdict", "skipped", "to_json", "name", "t", "u")


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
    components, (h1 x h2) . (S1 e1) and (h1 x h2) . (S1 e2), with the hinge axis as it is fixed in body 1 and in body
    2, h1 = S1 n and h2 = S2 C^-1 n; e1 is the coordinate axis of body 1 along which n has its smallest component,
    made perpendicular to n and of unit length; e2 is n x e1. psi is in [-pi, pi], where the axes differ after the
    smallest rotation of body 2 that aligns them.
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
_ORDER = ("R", "S", "v", "omega", "a", "alpha")


class _Kind(NamedTuple):
    """A kind of residual that is compared with tolerances."""

    label: str  # label of the equation, with a prime for each time derivative
    unit: str  # unit of the size of the residual
    letters: tuple[str, ...]  # names of the velocities and accelerations that both motions must have
    formula: str  # of the scale that rounding errors are relative to
    scale: Callable[[Mapping[str, Any]], Any]  # the same, of sizes by name
    size: str = ""  # name of the array whose norm is the size of the residual, where it is not its own


# W_i = abs(omega_i), A_i = abs(alpha_i); max abs over the components of both bodies. Squares alone could overflow.
_KINDS = {
    "gap": _Kind("E1", "m", (), "max abs(R) + abs(u1) + abs(u2)", lambda s: s["R"] + (s["u1"] + s["u2"])),
    "tilt": _Kind("E2", "rad", (), "1", lambda _: np.float64(1.0), "tilt_angle"),
    "gap_rate": _Kind(
        "E1'", "m/s", ("v", "omega"), "max abs(v) + W1 abs(u1) + W2 abs(u2)",
        lambda s: s["v"] + s["W1"] * s["u1"] + s["W2"] * s["u2"],
    ),
    "tilt_rate": _Kind("E2'", "rad/s", ("omega",), "W1 + W2", lambda s: s["W1"] + s["W2"]),
    "gap_acceleration": _Kind(
        "E1''", "m/s^2", ("v", "omega", "a", "alpha"),
        "max abs(a) + (A1 + W1^2) abs(u1) + (A2 + W2^2) abs(u2)",
        lambda s: s["a"] + sum(s[f"A{k}"] * s[f"u{k}"] + s[f"W{k}"] * (s[f"W{k}"] * s[f"u{k}"]) for k in "12"),
    ),
    "tilt_acceleration": _Kind(
        "E2''", "rad/s^2", ("omega", "alpha"), "A1 + A2 + (W1 + W2)^2",
        lambda s: s["A1"] + s["A2"] + (s["W1"] + s["W2"]) * (s["W1"] + s["W2"]),
    ),
}  # fmt: skip


def residuals(
    pair: Constants,
    name: str,
    body1: BodyMotion,
    body2: BodyMotion,
    tolerances: Mapping[str, float] | None,
    t: ArrayLike | None,
) -> Residuals:
    """Compute what `HingePair.residuals` returns."""
    motions: dict[str, NDArray[Any]] = {}
    for argument, body in (("body1", body1), ("body2", body2)):
        motion_arrays(argument, body, "S")
        motions |= motion_arrays(argument, body, *(one for one in _ORDER if getattr(body, one) is not None))
    given = _checked_tolerances({} if tolerances is None else tolerances, motions)
    shapes = {"body1": body1.shape, "body2": body2.shape}
    shape = broadcast_shape({**shapes, "pair": pair.shape})
    bodies = {f"{letter}{k}" for letter in MOTION_SHAPES for k in "12"}
    names = [one for one in _ARRAYS if bodies.intersection(CONSTRAINTS[one][0]) <= motions.keys()]
    arrays = compute_arrays(pair, names, motions, shapes, np.dtype(np.float64))
    # That of the least precise array; integers count as float64.
    u = max(unit_roundoff(one.dtype if one.dtype.kind == "f" else np.float64) for one in motions.values())
    instants = None if t is None else _broadcast_instants(t, shape)
    attitudes = np.isfinite(motions["S1"]).all(axis=(-2, -1)) & np.isfinite(motions["S2"]).all(axis=(-2, -1))
    rows, finite, sizes = [], np.ones(shape, bool), _sizes(pair, motions)
    for key, kind in _KINDS.items():
        if key not in arrays:
            continue
        size = arrays[kind.size or key]
        with np.errstate(all="ignore"):
            scale = kind.scale(sizes)
            rounding = _ROUNDOFFS * np.maximum(scale * u, np.finfo(np.float64).tiny)
        known = np.broadcast_to(attitudes & np.isfinite(scale), shape)
        size = size if size.ndim == len(shape) else norm(size)
        size = np.where(np.isfinite(size), size, np.inf)
        basis = "given" if key in given else f"{_ROUNDOFFS} u * ({kind.formula})"
        tolerance = np.broadcast_to(given.get(key, rounding), shape)
        rows.append(_check(key, size, known, tolerance, basis, instants))
        finite &= known
    shown = {key: read_only(np.asarray(array)) for key, array in arrays.items()}
    return Residuals(shown, shape, tuple(rows), name, int((~finite).sum()), u, instants)


def _sizes(pair: Constants, motions: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return the sizes of which scales are made, by their names in `_KINDS`, as far as the motions have them."""
    sizes: dict[str, Any] = {name: norm(pair.arrays[name]) for name in ("u1", "u2")}
    for letter in ("R", "v", "a"):
        if {f"{letter}1", f"{letter}2"} <= motions.keys():
            sizes[letter] = np.maximum(largest(motions[f"{letter}1"]), largest(motions[f"{letter}2"]))
    rates = (("W", "omega"), ("A", "alpha"))
    return sizes | {
        f"{size}{k}": norm(motions[f"{letter}{k}"])
        for size, letter in rates
        for k in "12"
        if f"{letter}{k}" in motions
    }


def _broadcast_instants(t: ArrayLike, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return instants as a read-only array of the samples' shape."""
    stamps = np.asarray(t)
    array = stamps if stamps.dtype.kind in "mM" else real_array("t", t)
    try:
        return read_only(np.broadcast_to(array, shape))
    except ValueError:
        expected = f"instants that broadcast to the samples' shape {shape}"
        raise ShapeError("t", expected, f"shape {array.shape}") from None


def _check(
    kind: str, size: Any, known: Any, tolerance: Float64Array, basis: str, t: NDArray[Any] | None
) -> ResidualCheck:
    """Return the check of a residual at the samples where the motions are known."""
    label, unit = _KINDS[kind][:2]
    samples = int(known.sum())
    if not samples:
        return ResidualCheck(kind, label, unit, 0.0, 0.0, 0.0, math.nan, 0.0, None, None, 0, basis)
    with np.errstate(all="ignore"):
        ratio = np.where(known, size / tolerance, -np.inf)
    where = tuple(int(i) for i in np.unravel_index(int(np.argmax(ratio)), size.shape))
    size = np.where(known, size, 0.0)
    highest = float(size.max())
    relative = size / (highest if 0 < highest < np.inf else 1.0)  # squares stay in range
    rms = highest if highest == np.inf else highest * math.sqrt(float(np.square(relative).sum()) / samples)
    when = None if t is None else str(t[where]) if t.dtype.kind in "mM" else t[where].item()
    worst = float(size[where]), float(tolerance[where]), float(ratio[where])
    return ResidualCheck(kind, label, unit, highest, rms, *worst, where, when, samples, basis)


def _checked_tolerances(tolerances: object, motions: Mapping[str, Any]) -> dict[str, float]:
    """Return the argument `tolerances` as positive floats by kind of residual."""
    if not isinstance(tolerances, Mapping):
        raise ArgumentError("tolerances", "a dict of numbers by residual, such as {'gap': 1e-3}", quoted(tolerances))
    checked = {}
    for key, value in tolerances.items():
        label = f"tolerances[{key!r}]"
        if key not in _KINDS:
            raise ArgumentError("tolerances", choices(tuple(_KINDS)), repr(key))
        checked[key] = finite_number(label, value)
        if checked[key] <= 0:
            raise ArgumentError(label, f"a positive number [{_KINDS[key].unit}]", value)
        letters = _KINDS[key].letters
        missing = [f"body{i}.{letter}" for i in (1, 2) for letter in letters if f"{letter}{i}" not in motions]
        if missing:
            expected = f"motions with {' and '.join(letters)}, since {key} needs them"
            raise ArgumentError(label, expected, f"no {', '.join(missing)}")
    return checked
