"""How far any two motions are from sharing the hinge (E1, E2): the residuals, judged, and the hinge's own motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, ShapeError, choices, quoted
from hingepair.numeric.arrays import Float64Array, broadcast_shape, finite_number, read_only, real_array
from hingepair.pair.accuracy import largest, norm, unit_roundoff
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.constants import Constants
from hingepair.pair.constraints import TAILS, available, constraint_values
from hingepair.pair.residual_report import ResidualCheck, Residuals

ROUNDOFF = 32
"""Residuals that round-off explains, in units of u * scale: of motion that the library computed, 6 was the largest
seen; of motion that another program did, each component may be 16 off (as against Pinocchio), the norm sqrt(3) times
that."""


class Kind(NamedTuple):
    """One residual that is judged.

    Attributes:
        label: of the equation.
        unit: of its size.
        letters: what it takes of either body's motion.
        scale: formula of the scale that round-off is measured in.
        size: the array whose norm is its size.
    """

    label: str
    unit: str
    letters: tuple[str, ...]
    scale: str
    size: str


KINDS = {
    "gap": Kind("E1", "m", (), "max abs(R) + abs(u1) + abs(u2)", "gap"),
    "tilt": Kind("E2", "rad", (), "1", "tilt_angle"),
    "gap_rate": Kind("E1'", "m/s", ("v", "omega"), "max abs(v) + W1 abs(u1) + W2 abs(u2)", "gap_rate"),
    "tilt_rate": Kind("E2'", "rad/s", ("omega",), "W1 + W2", "tilt_rate"),
    "gap_acceleration": Kind(
        "E1''",
        "m/s^2",
        ("v", "omega", "a", "alpha"),
        "max abs(a) + (A1 + W1^2) abs(u1) + (A2 + W2^2) abs(u2)",
        "gap_acceleration",
    ),
    "tilt_acceleration": Kind("E2''", "rad/s^2", ("omega", "alpha"), "A1 + A2 + (W1 + W2)^2", "tilt_acceleration"),
}
"""What is judged; W_i = abs(omega_i), A_i = abs(alpha_i), max abs over the components of both bodies."""

_ARRAYS = tuple(name for name in TAILS if name != "slip" and not name.startswith("constraint"))


def residuals(
    pair: Constants,
    name: str,
    body1: BodyMotion,
    body2: BodyMotion,
    tolerances: Mapping[str, float] | None,
    t: ArrayLike | None,
) -> Residuals:
    """How far any two motions, measured ones included, are from this hinge (E1, E2 and their derivatives)."""
    given: dict[str, NDArray[Any]] = {}
    for argument, body in (("body1", body1), ("body2", body2)):
        motion_arrays(argument, body)
        letters = (letter for letter in ("R", "S", "v", "omega", "a", "alpha") if getattr(body, letter) is not None)
        given |= motion_arrays(argument, body, *letters)
    allowed = _checked(tolerances)
    for kind in allowed:
        _check_given(kind, given)
    shapes = {"body1": body1.shape, "body2": body2.shape}
    shape = broadcast_shape({**shapes, "pair": pair.shape})
    names = available(_ARRAYS, given)
    arrays = constraint_values(pair, names, given, shapes, np.dtype(np.float64))
    u = max(unit_roundoff(a.dtype if a.dtype.kind == "f" else np.float64) for a in given.values())
    scales = _scales(pair, given, [kind for kind in KINDS if kind in names])
    attitudes = np.isfinite(given["S1"]).all(axis=(-2, -1)) & np.isfinite(given["S2"]).all(axis=(-2, -1))
    instants = None if t is None else _instants(t, shape)
    rows, left_out = [], np.zeros(shape, dtype=bool)
    for kind, scale in scales.items():
        size = arrays[KINDS[kind].size]
        known = np.broadcast_to(attitudes & np.isfinite(scale), shape)
        size = size if size.ndim == len(shape) else norm(size)
        rows.append(_check(kind, size, scale, known, u, allowed, instants))
        left_out |= ~known
    values: dict[str, Any] = {key: read_only(arrays[key]) if key in arrays else None for key in _ARRAYS}
    facts: dict[str, Any] = {"shape": shape, "skipped": int(left_out.sum()), "u": u, "rows": tuple(rows)}
    return Residuals(name=name, t=instants, **facts, **values)


def _instants(t: ArrayLike, shape: tuple[int, ...]) -> NDArray[Any]:
    """One instant for each sample."""
    given = np.asarray(t)
    array = given if given.dtype.kind in "mM" else real_array("t", t)
    try:
        return read_only(np.broadcast_to(array, shape))
    except ValueError:
        wanted = f"instants that broadcast to the samples' shape {shape}"
        raise ShapeError("t", wanted, f"shape {array.shape}") from None


def _check(
    kind: str,
    size: Float64Array,
    scale: Float64Array,
    known: NDArray[np.bool_],
    u: float,
    allowed: dict[str, float],
    t: NDArray[Any] | None,
) -> ResidualCheck:
    """One residual judged: its worst sample is the one with the largest part of its tolerance."""
    label, unit, _, formula, _ = KINDS[kind]
    given = kind in allowed
    if given:
        tolerance = np.broadcast_to(allowed[kind], size.shape)
    else:
        with np.errstate(all="ignore"):
            tolerance = ROUNDOFF * np.maximum(np.broadcast_to(scale, size.shape) * u, np.finfo(np.float64).tiny)
    basis = "given" if given else f"{ROUNDOFF} u * ({formula})"
    if not known.any():
        return ResidualCheck(kind, label, unit, 0.0, 0.0, 0.0, math.nan, 0.0, None, None, 0, basis)
    found = np.where(known, np.where(np.isfinite(size), size, np.inf), -np.inf)
    with np.errstate(all="ignore"):
        ratio = np.where(known, found / tolerance, -np.inf)
    worst = np.unravel_index(int(np.argmax(ratio)), size.shape)
    where = tuple(int(i) for i in worst)
    highest = float(found.max())
    relative = np.where(known, found, 0.0) / (highest if 0 < highest < np.inf else 1.0)  # squares stay in range
    rms = highest if highest == np.inf else highest * math.sqrt(float(np.square(relative).sum()) / int(known.sum()))
    return ResidualCheck(
        kind,
        label,
        unit,
        highest,
        rms,
        float(found[worst]),
        float(tolerance[worst]),
        float(ratio[worst]),
        where,
        None if t is None else t[where].item() if t.dtype.kind not in "mM" else str(t[where]),
        int(known.sum()),
        basis,
    )


def _scales(pair: Constants, given: dict[str, NDArray[Any]], kinds: list[str]) -> dict[str, Float64Array]:
    """The scale of each residual, sample by sample (the formulas of KINDS); not finite where an input is not."""
    lever1, lever2 = norm(pair.arrays["u1"]), norm(pair.arrays["u2"])

    def both(letter: str) -> Float64Array:
        return np.asarray(np.maximum(largest(given[f"{letter}1"]), largest(given[f"{letter}2"])))

    scales: dict[str, Any] = {"gap": both("R") + (lever1 + lever2), "tilt": np.float64(1.0)}
    with np.errstate(all="ignore"):
        if "tilt_rate" in kinds:
            W1, W2 = norm(given["omega1"]), norm(given["omega2"])
            scales["tilt_rate"] = W1 + W2
        if "gap_rate" in kinds:
            scales["gap_rate"] = both("v") + W1 * lever1 + W2 * lever2
        if "tilt_acceleration" in kinds:
            A1, A2 = norm(given["alpha1"]), norm(given["alpha2"])
            scales["tilt_acceleration"] = A1 + A2 + (W1 + W2) * (W1 + W2)
        if "gap_acceleration" in kinds:
            scales["gap_acceleration"] = both("a") + (
                (A1 * lever1 + W1 * (W1 * lever1)) + (A2 * lever2 + W2 * (W2 * lever2))
            )
    return {kind: scales[kind] for kind in kinds}


def _check_given(kind: str, given: Mapping[str, NDArray[Any]]) -> None:
    """Refuse the tolerance of a residual that the motions do not tell."""
    letters = KINDS[kind].letters
    missing = [f"body{i}.{letter}" for i in (1, 2) for letter in letters if f"{letter}{i}" not in given]
    if missing:
        expected = f"motions with {' and '.join(letters)}, since {kind} needs them"
        raise ArgumentError(f"tolerances[{kind!r}]", expected, f"no {', '.join(missing)}")


def _checked(tolerances: Mapping[str, float] | None) -> dict[str, float]:
    """The tolerances that a user gives, by the residual's name."""
    if tolerances is None:
        return {}
    if not isinstance(tolerances, Mapping):
        raise ArgumentError("tolerances", "a dict of numbers by residual, such as {'gap': 1e-3}", quoted(tolerances))
    allowed = {}
    for key, value in tolerances.items():
        if key not in KINDS:
            raise ArgumentError("tolerances", choices(tuple(KINDS)), repr(key))
        number = finite_number(f"tolerances[{key!r}]", value)
        if number <= 0:
            raise ArgumentError(f"tolerances[{key!r}]", f"a positive number [{KINDS[key].unit}]", value)
        allowed[key] = number
    return allowed
