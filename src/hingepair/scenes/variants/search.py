"""Search: numbers of a scene for which results have wanted values, or for which a result is smallest or largest."""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hingepair.errors import ArgumentError, choices, quoted
from hingepair.mechanism.bodies.body import DynamicsWarning
from hingepair.numeric.arrays import Float64Array
from hingepair.scenes.load import load_scene
from hingepair.scenes.numbers import number_at
from hingepair.scenes.scene import Scene
from hingepair.scenes.variants.reductions import REDUCTIONS, reduction_ending
from hingepair.scenes.variants.vary import Variants
from hingepair.tables.sheets import align_columns, cell_text

Range = tuple[float, float] | None
"""Lower and upper end of a number; None for any."""

_CONDITION = re.compile(r"\s*(\S+?)\s*(<=|>=|=|<|>)\s*(\S+)\s*")  # result, sign and value
_TOLERANCE = 1e-6  # of a wanted value, relative to it or to the size of the result at the start
_BRACKET_STEPS = 40  # of a factor of 1.5 each: seven decades to either side
_SCAN = 25  # places at which a number with a range is tried before the search is local


class Condition(NamedTuple):
    """What a result is to be, such as psi_t_min = 5."""

    result: str  # column and reduction
    sign: str  # "=", "<=" or ">="
    value: float

    def miss(self, got: float) -> float:
        """Return by how much a result is above (or, negative, below) the value; 0 for an inequality that holds."""
        excess = got - self.value
        if self.sign == "<=":
            return max(excess, 0.0)  # in this order, NaN stays NaN
        return min(excess, 0.0) if self.sign == ">=" else excess

    def __str__(self) -> str:
        return f"{self.result} {self.sign} {self.value:.9g}"


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """Numbers that `search` found."""

    #: the numbers, by their key in the scene file
    values: dict[str, float]
    #: what they are in the scene file, also outside of their ranges
    start: dict[str, float]
    #: the results that the conditions and the aim name, at the numbers found
    results: dict[str, float]
    #: units of the results; "1" where there is none
    units: dict[str, str]
    #: the conditions, as text
    conditions: tuple[str, ...]
    #: whether all conditions hold, and results change with the numbers
    ok: bool
    #: sentences on why a condition does not hold, or a smallest or largest result is not one
    notes: tuple[str, ...]
    #: number of variants of the scene that were computed
    evaluations: int
    #: the scene with these numbers
    scene: Scene

    def __str__(self) -> str:
        rows = [("number", "in the scene", "found" if self.ok else "closest")]
        rows += [(key, cell_text(self.start[key]), cell_text(value)) for key, value in self.values.items()]
        results = [("result", "value", "unit")]
        results += [(name, cell_text(value), self.units[name]) for name, value in self.results.items()]
        wanted = [f"wanted: {', '.join(self.conditions)}"] if self.conditions else []
        verdict = f"{'found' if self.ok else 'NOT FOUND'} after {self.evaluations} variants"
        lines = (*align_columns(rows, {1, 2}), "", *align_columns(results, {1}), *wanted, *self.notes, verdict)
        return "\n".join(lines)


def search(
    scene: Scene | str | os.PathLike[str],
    vary: str | Sequence[str] | Mapping[str, Range],
    until: str | Sequence[str] = (),
    *,
    minimize: str | None = None,
    maximize: str | None = None,
    units: str | None = None,
) -> Search:
    """Return numbers of a scene for which results have wanted values, or for which one result is smallest or largest.

    A result is a component of an output and a reduction, joined by `_`, as columns of sweeps are called: `psi_last`,
    `R2_z_max`, `hinge_torque_absmax`, `psi_t_below(0.01)`.

    One number and one condition with `=` are solved by bracketing, from the value in the scene outwards; several by
    least squares; a smallest or largest result by a scan of the ranges and a local search. What is found is near the
    value in the scene, not the best of all.

    Args:
        scene: a Scene, or the path of its file.
        vary: keys of the numbers, such as "dynamics.psi.damping" or "pair.u1[0]", or a dict that gives a range (low,
            high), or None, for each. Numbers without a range keep their sign.
        until: conditions such as "psi_t_below(0.01) = 5", "psid_min >= -0.2".
        minimize: the result that is to be smallest; needs ranges. Inequalities hold strictly where numbers are found.
        maximize: the result that is to be largest.
        units: units of results, conditions and levels in place of SI units, such as "deg, mm". Numbers of the scene
            stay as the scene has them.

    Raises:
        ArgumentError: a key leads to no number, a condition cannot be read, or a result is none of the scene.

    >>> import hingepair as hp
    >>> found = hp.search("models/landing_gear.toml", "pair.body2.mass", "hinge_torque_absmax = 700")
    >>> found.ok, round(found.values["pair.body2.mass"], 2)  # kg
    (True, 95.85)
    """
    from scipy import optimize

    conditions = [read_condition(text) for text in ([until] if isinstance(until, str) else until)]
    if minimize is not None and maximize is not None:
        raise ArgumentError("maximize", "None beside minimize", quoted(maximize))
    aim = minimize if maximize is None else maximize
    if not conditions and aim is None:
        raise ArgumentError("until", 'a condition such as "psi_last = 1.5", or minimize=', "none")
    names = (*(condition.result for condition in conditions), *(() if aim is None else (aim,)))
    variants = _Variants(scene, vary, names, units)
    if aim is not None:
        sign = 1.0 if maximize is None else -1.0
        x = _smallest(optimize, variants, lambda x: sign * variants.results(x)[-1], conditions)
    elif len(variants.keys) == 1 and len(conditions) == 1 and conditions[0].sign == "=":
        x = _root(optimize, variants, lambda x: conditions[0].miss(variants.results(x)[0]))
    else:
        x = _least_misses(optimize, variants, conditions, variants.start)
    results = dict(zip(names, variants.results(x), strict=True))
    held = variants.meet(x, conditions) and all(map(math.isfinite, results.values()))
    ends = [] if aim is None else variants.at_ends(x)
    changes = len({tuple(own) for own in variants.known.values()}) > 1 or len(variants.known) == 1
    if not changes:
        ends.append(f"{', '.join(names)} does not change with {', '.join(variants.keys)}")
    return Search(
        values=dict(zip(variants.keys, x.tolist(), strict=True)),
        start=dict(zip(variants.keys, variants.given.tolist(), strict=True)),
        results=results,
        units=variants.units(),
        conditions=tuple(map(str, conditions)),
        notes=(*(() if held else variants.doubts(x, conditions)), *ends),
        ok=held and changes,
        evaluations=len(variants.known),
        scene=variants.variants.scene_of(x.tolist()),
    )


def read_condition(text: object) -> Condition:
    """Return the condition that a text such as "psi_t_min = 5" states."""
    match = _CONDITION.fullmatch(text) if isinstance(text, str) else None
    try:
        if match is None:
            raise ValueError
        value = float(match[3])
        if not math.isfinite(value):
            raise ValueError
    except ValueError:
        expected = 'conditions such as "psi_t_min = 5" or "psid_max <= 1": result, sign, number'
        raise ArgumentError("until", expected, quoted(text)) from None
    return Condition(match[1], match[2] if match[2] == "=" else f"{match[2][0]}=", value)


class _Variants:
    """The scene with other numbers, and its results, each computed once."""

    def __init__(
        self,
        scene: Scene | str | os.PathLike[str],
        vary: str | Sequence[str] | Mapping[str, Range],
        names: Sequence[str],
        units: str | None,
    ) -> None:
        scene = scene if isinstance(scene, Scene) else load_scene(scene)
        keys = [vary] if isinstance(vary, str) else list(vary)
        if not keys:
            raise ArgumentError("vary", 'a key such as "dynamics.psi.damping"', quoted(vary))
        self.keys: list[str] = keys
        ranges = [vary[key] if isinstance(vary, Mapping) else None for key in keys]
        self._names = names
        self._columns = [_column(name) for name in names]
        self.variants = Variants(scene, keys, self._outputs_in(scene))
        self.given = np.array([number_at(scene.tables, path) for path in self.variants.paths])
        self.low, self.high = np.array([_ends(*each) for each in zip(keys, ranges, self.given, strict=True)]).T
        self.has_ranges = all(one is not None for one in ranges)
        self.start = np.clip(self.given, self.low, self.high)
        self.known: dict[bytes, list[float]] = {}
        self._in_units = scene.in_units(units or "")
        self.results(self.start)  # says at once what cannot be computed

    def _outputs_in(self, scene: Scene) -> tuple[str, ...]:
        """Return the outputs whose components the results are: of each, the longest name that the scene has."""
        found: dict[str, None] = {}
        for name, (column, _) in zip(self._names, self._columns, strict=True):
            parts = column.split("_")
            refusals = []
            for count in range(len(parts), 0, -1):
                output = "_".join(parts[:count])
                try:
                    scene.check_arrays((output,))
                except ArgumentError as error:
                    refusals.append(error)
                else:
                    found[output] = None
                    break
            else:
                expected = f"a component of an output of the scene ({refusals[0].expected})"
                raise ArgumentError(name, expected, quoted(column))
        return tuple(found)

    def results(self, x: Float64Array) -> list[float]:
        """Return the results at numbers x, each computed once."""
        key = np.asarray(x, np.float64).tobytes()
        if key not in self.known:
            self.known[key] = self._computed(np.asarray(x, np.float64))
        return self.known[key]

    def _computed(self, x: Float64Array) -> list[float]:
        """Compute the results at numbers x; NaN where that fails, but an error with the first numbers."""
        try:
            with warnings.catch_warnings():
                if self.known:  # a result that is NaN is not found
                    warnings.filterwarnings("ignore", ".* is beyond its stroke", DynamicsWarning)
                batch = self.variants.compute(x.tolist())
        except ArgumentError:
            if not self.known:
                raise
            return [math.nan] * len(self._names)
        reductions = tuple(dict.fromkeys(reduction for _, reduction in self._columns))
        reduced = batch.reduced(reductions, self._in_units)
        columns = {heading.partition(" [")[0]: values for heading, values in reduced.items()}
        for name in self._names:
            if name not in columns:
                reduction = _column(name)[1]
                known = [column for column in columns if column.endswith(f"_{reduction}")]
                raise ArgumentError("until", choices(known), quoted(name))
        return [float(columns[name][0]) for name in self._names]

    def units(self) -> dict[str, str]:
        """Return the units of the results by name."""
        own, si = self._in_units.units, self._in_units.si_unit
        columns = zip(self._names, self._columns, strict=True)
        return {name: own.unit("s" if end.startswith("t_") else si(column)) for name, (column, end) in columns}

    def meet(self, x: Float64Array, conditions: Sequence[Condition], tolerance: float = _TOLERANCE) -> bool:
        """Return whether the conditions hold at numbers x; `tolerance` is that of inequalities."""
        return all(
            abs(one.miss(got))
            <= (_TOLERANCE if one.sign == "=" else tolerance) * max(abs(one.value) or _size(first, 0.0), 1e-9)
            for one, got, first in zip(conditions, self.results(x), self.results(self.start), strict=False)
        )

    def doubts(self, x: Float64Array, conditions: Sequence[Condition]) -> Iterator[str]:
        """Yield sentences on why numbers were not found: a result without a value, an instant behind the motion, or a
        result that jumps.
        """
        for name, values in dict(zip(self._names, zip(*self.known.values(), strict=True), strict=True)).items():
            if not any(map(math.isfinite, values)):
                one_range = len(self.keys) == 1 and self.has_ranges
                where = (
                    f"anywhere in {self.low[0]:g}..{self.high[0]:g}" if one_range else "at any of the numbers tried"
                )
                yield f"{name} has no value {where}"
        stop, unit = (
            self._in_units.units.factor("s") * self.variants.scene_of(x.tolist()).stop,
            self._in_units.unit("t"),
        )
        for place, one in enumerate(conditions):
            if self._columns[place][1].startswith("t_") and one.value >= stop:
                yield f"{one} is not within the motion, which ends at t = {stop:.6g} {unit} (time.stop)"
            sides = {np.sign(one.miss(got[place])) for key, got in self.known.items() if self._is_beside(key, x)}
            if len(self.keys) == 1 and {-1.0, 1.0} <= sides:
                yield f"{one.result} jumps past {one.value:.6g} at {self.keys[0]} = {x[0]:.6g}"

    def _is_beside(self, key: bytes, x: Float64Array) -> bool:
        return bool(np.allclose(np.frombuffer(key), x, rtol=1e-9, atol=0.0))

    def at_ends(self, x: Float64Array) -> list[str]:
        """Return sentences on numbers that are at an end of their ranges."""
        near = 1e-6 * (self.high - self.low)
        is_near = (x - self.low < near) | (self.high - x < near)
        ended = zip(self.keys, x, is_near, strict=True)
        return [f"{key} = {value:.6g} is at an end of its range" for key, value, is_end in ended if is_end]


def _column(name: str) -> tuple[str, str]:
    """Return (column, reduction) of the name of a result."""
    reduction = reduction_ending(name)
    if reduction is None:
        raise ArgumentError("until", f"a result that ends in a reduction, _ and {choices(REDUCTIONS)}", quoted(name))
    return name[: -len(reduction) - 1], reduction


def _ends(key: str, ends: Range, start: float) -> tuple[float, float]:
    """Return the lower and the upper end of a number; one without a range keeps the sign of `start`, if not 0."""
    if ends is None:
        return (0.0, math.inf) if start > 0 else (-math.inf, 0.0) if start < 0 else (-math.inf, math.inf)
    try:
        low, high = map(float, ends)
    except (TypeError, ValueError):
        low, high = math.nan, math.nan
    if not low < high:
        raise ArgumentError(f"vary[{key!r}]", "a range (low, high), or None", quoted(ends))
    return low, high


def _root(optimize: Any, variants: _Variants, miss: Any) -> Float64Array:
    """Return the number at which `miss` is 0, nearest to the start; the best one that was seen if there is none."""
    low, high, start = float(variants.low[0]), float(variants.high[0]), float(variants.start[0])
    if math.isfinite(high - low):
        places = sorted({start, *np.linspace(low, high, _SCAN).tolist()}, key=lambda x: abs(x - start))
    else:  # outwards by factors; from 0 by steps that grow
        size = abs(start) or 1.0
        grown = [size * 1.5**k for k in range(-_BRACKET_STEPS // 2, _BRACKET_STEPS)]
        offsets = (
            grown if start == 0 else [x - size for x in grown] + [size / 1.5**k - size for k in range(_BRACKET_STEPS)]
        )
        steps = [math.copysign(1.0, start) * x for x in offsets] + ([-x for x in offsets] if start == 0 else [])
        places = [start, *sorted((start + x for x in steps), key=lambda x: abs(x - start))]
    seen: dict[float, float] = {}

    def missed(x: float) -> float:
        if x not in seen:
            seen[x] = float(miss(np.array([x])))
        return seen[x]

    for x in places:
        if missed(x) == 0:
            return np.array([x])
        neighbours = max((y for y in seen if y < x), default=None), min((y for y in seen if y > x), default=None)
        for other in neighbours:
            ends = None if other is None else _bracket(missed, x, other)
            if ends is not None:
                return np.array([optimize.brentq(missed, *sorted(ends), xtol=1e-14, rtol=1e-13)])
    return np.array([min((x for x in seen if math.isfinite(seen[x])), key=lambda x: abs(seen[x]), default=start)])


def _bracket(missed: Callable[[float], float], x: float, y: float) -> tuple[float, float] | None:
    """Return two numbers from x to y between which `missed` changes its sign, if any. An end at which it is NaN, as
    the time of what does not happen within the motion, is moved inwards first.
    """
    at, to = (x, y) if math.isfinite(missed(x)) else (y, x)
    if not math.isfinite(missed(at)):
        return None
    shortest = 1e-4 * max(abs(x), abs(y))
    while math.isnan(missed(to)) and abs(to - at) > shortest:
        middle = (at + to) / 2
        if missed(middle) * missed(at) > 0:
            at = middle
        else:
            to = middle
    return (at, to) if missed(at) * missed(to) <= 0 else None


def _size(x: float, default: float = 1.0) -> float:
    """Return the magnitude of a number to which others are relative; `default` for 0 and NaN."""
    return abs(x) if math.isfinite(x) and x else default


def _least_misses(
    optimize: Any, variants: _Variants, conditions: Sequence[Condition], start: Float64Array
) -> Float64Array:
    """Return the numbers with the least squares of what the conditions miss, each relative to that at `start`."""
    scales = np.array([_size(one.miss(got)) for one, got in _with_results(conditions, variants, start)])
    size = np.where(variants.start == 0, 1.0, np.abs(variants.start))

    def solved(start: Float64Array, conditions: Sequence[Condition]) -> Float64Array:
        """Return the numbers with the least squares that a search from `start` within the ranges finds."""

        def residuals(x: Float64Array) -> Float64Array:
            found = np.array([one.miss(got) for one, got in _with_results(conditions, variants, x)]) / scales
            return np.where(np.isfinite(found), found, 1e6)

        inside = np.clip(start, variants.low + 1e-9 * size, variants.high - 1e-9 * size)
        bounds, least = (variants.low, variants.high), 1e-12
        found = optimize.least_squares(
            residuals, inside, bounds=bounds, x_scale=size, diff_step=1e-5, xtol=least, ftol=least, gtol=least
        )
        return np.asarray(found.x, np.float64)

    x = solved(start, conditions)
    # A search ends just outside of an inequality, whose miss has no slope within: it ends on it as an equation.
    equations = [
        one._replace(sign="=") if one.miss(got) else one for one, got in _with_results(conditions, variants, x)
    ]
    return x if equations == [*conditions] else solved(x, equations)


def _with_results(
    conditions: Sequence[Condition], variants: _Variants, x: Float64Array
) -> Iterator[tuple[Condition, float]]:
    """Yield the conditions with their results at numbers x; these stand first among the results."""
    return zip(conditions, variants.results(x), strict=False)


def _smallest(optimize: Any, variants: _Variants, aim: Any, conditions: Sequence[Condition]) -> Float64Array:
    """Return the numbers at which `aim` is smallest while the conditions hold, of those that a scan and then a local
    search find; those with the least misses if the conditions hold nowhere.
    """
    from scipy.stats import qmc

    if not variants.has_ranges:
        raise ArgumentError("vary", 'ranges, as in {"dynamics.psi.damping": (0.1, 10)}, beside minimize', "none")
    width, count = variants.high - variants.low, len(variants.keys)
    shares = np.linspace(0, 1, _SCAN)[:, None] if count == 1 else qmc.Sobol(count, seed=0).random(64)
    tried = [variants.start, *(variants.low + share * width for share in shares)]
    scales = np.array([_size(one.value) for one in conditions], np.float64)
    equations = any(one.sign == "=" for one in conditions)
    tolerance = _TOLERANCE if equations else 0.0  # inequalities alone hold strictly

    def excesses(x: Float64Array) -> Float64Array:
        """Return by how much results exceed the values of conditions, or, with >=, fall short of them."""
        signed = [
            (-1.0 if one.sign == ">=" else 1.0) * (got - one.value)
            for one, got in _with_results(conditions, variants, x)
        ]
        return np.nan_to_num(np.array(signed, np.float64) / scales, nan=1.0)

    def missed(x: Float64Array) -> tuple[float, float]:
        """Return what orders numbers: by how much they miss the conditions, then the aim."""
        short = [one.miss(got) for one, got in _with_results(conditions, variants, x)] / scales
        total = float(np.nan_to_num(np.abs(short), nan=math.inf).sum())
        return (0.0 if variants.meet(x, conditions, tolerance) else total), float(np.nan_to_num(aim(x), nan=math.inf))

    size = _size(next((value for value in map(aim, tried) if math.isfinite(value)), 0.0))
    lowest = [0.0 if one.sign == "=" else -math.inf for one in conditions]
    limits = optimize.NonlinearConstraint(lambda s: excesses(variants.low + s * width), lowest, 0.0)
    optimize.minimize(
        lambda s: np.nan_to_num(aim(variants.low + s * width) / size, nan=1e6),
        (min(tried, key=missed) - variants.low) / width,
        method="COBYQA",
        bounds=[(0.0, 1.0)] * count,
        constraints=[limits] * bool(conditions),
        options={"initial_tr_radius": 0.02, "final_tr_radius": 1e-9, "maxfev": 300},
    )
    best = min((np.frombuffer(key) for key in variants.known), key=missed)
    if not equations and variants.meet(best, conditions, 0.0):
        return best
    nearest = _least_misses(optimize, variants, conditions, best)
    return min(best, nearest, key=lambda x: missed(x)[0]) if not equations else nearest
