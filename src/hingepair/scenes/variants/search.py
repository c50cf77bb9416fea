"""Search: numbers of a scene for which results have wanted values, or for which a result is smallest or largest."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.numeric.arrays import Float64Array
from hingepair.scenes.numbers import number_at
from hingepair.scenes.scene import Scene, load_scene
from hingepair.scenes.variants.reductions import REDUCTIONS, reduction_ending
from hingepair.scenes.variants.vary import Variants, lost_variants
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
    conditions = [read_condition(text) for text in ([until] if isinstance(until, str) else until)]
    if minimize is not None and maximize is not None:
        raise ArgumentError("maximize", "None beside minimize", quoted(maximize))
    aim = minimize if maximize is None else maximize
    if not conditions and aim is None:
        raise ArgumentError(
            "until", 'a condition such as "psi_last = 1.5", or a result to minimize or maximize', "none"
        )
    names = (*(condition.result for condition in conditions), *(() if aim is None else (aim,)))
    tried = _Tried(scene, vary, names, conditions, units, "minimize" if maximize is None else "maximize")
    if aim is not None:
        x = _smallest(tried, 1.0 if maximize is None else -1.0)
    elif len(tried.keys) == 1 and len(conditions) == 1 and conditions[0].sign == "=":
        x = _root(tried)
    else:
        x = _least_misses(tried, tried.start)
    results = dict(zip(names, tried.results(x), strict=True))
    held = tried.meets(x) and all(map(math.isfinite, results.values()))
    changes = len({tuple(own) for own in tried.known.values()}) > 1 or len(tried.known) == 1
    return Search(
        values=dict(zip(tried.keys, x.tolist(), strict=True)),
        start=dict(zip(tried.keys, tried.given.tolist(), strict=True)),
        results=results,
        units=tried.units(),
        conditions=tuple(map(str, conditions)),
        notes=tuple(tried.notes(x, held, changes, aim is not None)),
        ok=held and changes,
        evaluations=len(tried.known),
        scene=tried.variants.scene_of(x.tolist()),
    )


def read_condition(text: object) -> Condition:
    """Return the condition that a text such as "psi_t_min = 5" states."""
    match = _CONDITION.fullmatch(text) if isinstance(text, str) else None
    try:
        value = float(match[3]) if match else math.nan
    except ValueError:
        value = math.nan
    if match is None or not math.isfinite(value):
        expected = 'conditions such as "psi_t_min = 5" or "psid_max <= 1": result, sign, number'
        raise ArgumentError("until", expected, quoted(text))
    return Condition(match[1], match[2] if match[2] == "=" else f"{match[2][0]}=", value)


class _Tried:
    """The numbers that were tried, with their results."""

    def __init__(
        self,
        scene: Scene | str | os.PathLike[str],
        vary: str | Sequence[str] | Mapping[str, Range],
        names: Sequence[str],
        conditions: Sequence[Condition],
        units: str | None,
        aim_name: str,
    ) -> None:
        scene = scene if isinstance(scene, Scene) else load_scene(scene)
        keys = [vary] if isinstance(vary, str) else list(vary)
        if not keys:
            raise ArgumentError("vary", 'a key such as "dynamics.psi.damping"', quoted(vary))
        self.keys, self.conditions, self._names = keys, conditions, names
        ranges = [vary[key] if isinstance(vary, Mapping) else None for key in keys]
        self._arguments = ["until" if place < len(conditions) else aim_name for place in range(len(names))]
        self._columns = [_column(*each) for each in zip(names, self._arguments, strict=True)]
        wanted = zip(self._columns, self._arguments, strict=True)
        outputs = tuple(dict.fromkeys(_output_in(scene, column, argument) for (column, _), argument in wanted))
        self.variants = Variants(scene, keys, outputs)
        self.given = np.array([number_at(scene.tables, path) for path in self.variants.paths])
        self.low, self.high = np.array([_ends(*each) for each in zip(keys, ranges, self.given, strict=True)]).T
        self.has_ranges = all(one is not None for one in ranges)
        self.start = np.clip(self.given, self.low, self.high)
        self.known: dict[bytes, list[float]] = {}
        self.reasons: dict[bytes, str] = {}  # why numbers have no results
        self._in_units = scene.in_units(units or "")
        self.results(self.start)  # says at once what cannot be computed

    def results(self, x: Float64Array) -> list[float]:
        """Return the results at numbers x, each computed once; NaN where that fails, but an error with the first."""
        key = np.asarray(x, np.float64).tobytes()
        if key not in self.known:
            try:
                batch = self.variants.compute(np.asarray(x, np.float64).tolist())
            except ArgumentError as error:
                if not self.known:
                    raise
                self.reasons[key] = str(error)
                self.known[key] = [math.nan] * len(self._names)
                return self.known[key]
            self.reasons[key] = batch.reasons[0]
            reduced = batch.reduced(tuple({reduction for _, reduction in self._columns}), self._in_units)
            columns = {heading.partition(" [")[0]: float(values[0]) for heading, values in reduced.items()}
            for name, argument in zip(self._names, self._arguments, strict=True):
                if name not in columns:
                    raise ArgumentError(argument, choices(tuple(columns)) + nearest(name, columns), quoted(name))
            self.known[key] = [columns[name] for name in self._names]
        return self.known[key]

    def misses(self, x: Float64Array) -> Float64Array:
        """Return what the conditions miss at numbers x."""
        return np.array([one.miss(got) for one, got in zip(self.conditions, self.results(x), strict=False)])

    def units(self) -> dict[str, str]:
        """Return the units of the results by name."""
        own, si = self._in_units.units, self._in_units.si_unit
        columns = zip(self._names, self._columns, strict=True)
        return {name: own.unit("s" if end.startswith("t_") else si(column)) for name, (column, end) in columns}

    def meets(self, x: Float64Array, tolerance: float = _TOLERANCE) -> bool:
        """Return whether the conditions hold at numbers x; `tolerance` is that of inequalities."""
        return all(
            abs(one.miss(got))
            <= (_TOLERANCE if one.sign == "=" else tolerance) * max(abs(one.value) or _size(first, 0.0), 1e-9)
            for one, got, first in zip(self.conditions, self.results(x), self.results(self.start), strict=False)
        )

    def notes(self, x: Float64Array, held: bool, changes: bool, is_aim: bool) -> Iterator[str]:
        """Yield sentences on what was found at numbers x: why conditions do not hold, numbers at an end of their
        range, results that do not change, and variants that cannot be computed.
        """
        for place, name in enumerate(self._names if not held else ()):
            if not any(math.isfinite(got[place]) for got in self.known.values()):
                yield f"{name} has no value at any of the numbers tried"
        for key, value, low, high in zip(self.keys, x, self.low, self.high, strict=True) if is_aim else ():
            if min(value - low, high - value) < 1e-6 * (high - low):
                yield f"{key} = {value:.6g} is at an end of its range"
        if not changes:
            yield f"{', '.join(self._names)} does not change with {', '.join(self.keys)}"
        rows = np.array([np.frombuffer(key) for key in self.known])
        if lost := lost_variants(self.keys, rows, [self.reasons.get(key, "") for key in self.known]):
            yield lost


def _output_in(scene: Scene, column: str, argument: str) -> str:
    """Return the output whose component, or the magnitude of which, a column is."""
    item = scene.assembly.item(column)
    if item is None:
        raise ArgumentError(
            argument, f"a component of an output of the scene{nearest(column, scene.assembly.items)}", quoted(column)
        )
    return item.name


def _column(name: str, argument: str) -> tuple[str, str]:
    """Return (column, reduction) of the name of a result, which an argument of `search` gave."""
    reduction = reduction_ending(name)
    if reduction is None:
        hint = nearest(name.rpartition("_")[2], REDUCTIONS)
        raise ArgumentError(argument, f"a result that ends in _ and {choices(REDUCTIONS)}{hint}", quoted(name))
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


def _size(x: float, default: float = 1.0) -> float:
    """Return the magnitude of a number to which others are relative; `default` for 0 and NaN."""
    return abs(x) if math.isfinite(x) and x else default


def _root(tried: _Tried) -> Float64Array:
    """Return the number at which the condition holds, nearest to the start; the best one that was seen if there is
    none.
    """
    from scipy import optimize

    low, high, start = float(tried.low[0]), float(tried.high[0]), float(tried.start[0])
    if math.isfinite(high - low):
        places = np.linspace(low, high, _SCAN).tolist()
    else:  # outwards by factors, also across 0 where no sign is to be kept
        factors = 1.5 ** np.arange(-_BRACKET_STEPS, _BRACKET_STEPS + 1)
        places = (start * factors).tolist() if start else [*factors.tolist(), *(-factors).tolist()]
    seen: dict[float, float] = {}

    def missed(x: float) -> float:
        if x not in seen:
            seen[x] = float(tried.misses(np.array([x]))[0])
        return seen[x]

    for x in (start, *sorted(places, key=lambda x: abs(x - start))):
        if missed(x) == 0:
            return np.array([x])
        for other in (max((y for y in seen if y < x), default=None), min((y for y in seen if y > x), default=None)):
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


def _least_misses(tried: _Tried, start: Float64Array) -> Float64Array:
    """Return the numbers with the least squares of what the conditions miss, each relative to that at `start`."""
    from scipy import optimize

    scales = np.array([_size(miss) for miss in tried.misses(start).tolist()])
    size = np.where(tried.start == 0, 1.0, np.abs(tried.start))

    def solved(start: Float64Array, conditions: Sequence[Condition]) -> Float64Array:
        """Return the numbers with the least squares that a search from `start` within the ranges finds."""

        def residuals(x: Float64Array) -> Float64Array:
            found = [one.miss(got) for one, got in zip(conditions, tried.results(x), strict=False)] / scales
            return np.where(np.isfinite(found), found, 1e6)

        inside = np.clip(start, tried.low + 1e-9 * size, tried.high - 1e-9 * size)
        bounds, least = (tried.low, tried.high), 1e-12
        found = optimize.least_squares(
            residuals, inside, bounds=bounds, x_scale=size, diff_step=1e-5, xtol=least, ftol=least, gtol=least
        )
        return np.asarray(found.x, np.float64)

    x = solved(start, tried.conditions)
    # A search ends just outside of an inequality, whose miss has no slope within: it ends on it as an equation.
    pairs = zip(tried.conditions, tried.misses(x).tolist(), strict=True)
    equations = [one._replace(sign="=") if miss else one for one, miss in pairs]
    return x if equations == [*tried.conditions] else solved(x, equations)


def _smallest(tried: _Tried, sign: float) -> Float64Array:
    """Return the numbers at which the last result, times `sign`, is smallest while the conditions hold, of those that
    a scan and then a local search find; those with the least misses if the conditions hold nowhere.
    """
    from scipy import optimize
    from scipy.stats import qmc

    if not tried.has_ranges:
        raise ArgumentError("vary", 'ranges, as in {"dynamics.psi.damping": (0.1, 10)}, beside minimize', "none")
    low, width, count = tried.low, tried.high - tried.low, len(tried.keys)
    shares = np.linspace(0, 1, _SCAN)[:, None] if count == 1 else qmc.Sobol(count, seed=0).random(64)
    scales = np.array([_size(one.value) for one in tried.conditions], np.float64)
    equations = any(one.sign == "=" for one in tried.conditions)
    tolerance = _TOLERANCE if equations else 0.0  # inequalities alone hold strictly

    def aim(x: Float64Array) -> float:
        return sign * tried.results(x)[-1]

    def excesses(s: Float64Array) -> Float64Array:
        """Return by how much results exceed the values of conditions, or, with >=, fall short of them."""
        pairs = zip(tried.conditions, tried.results(low + s * width), strict=False)
        signed = [(-1.0 if one.sign == ">=" else 1.0) * (got - one.value) for one, got in pairs]
        return np.nan_to_num(np.array(signed, np.float64) / scales, nan=1.0)

    def order(x: Float64Array) -> tuple[float, float]:
        """Return what orders numbers: by how much they miss the conditions, then the aim."""
        total = float(np.nan_to_num(np.abs(tried.misses(x) / scales), nan=math.inf).sum())
        return (0.0 if tried.meets(x, tolerance) else total), float(np.nan_to_num(aim(x), nan=math.inf))

    scanned = [tried.start, *(low + share * width for share in shares)]
    size = _size(next((value for value in map(aim, scanned) if math.isfinite(value)), 0.0))
    least = [0.0 if one.sign == "=" else -math.inf for one in tried.conditions]
    optimize.minimize(
        lambda s: np.nan_to_num(aim(low + s * width) / size, nan=1e6),
        (min(scanned, key=order) - low) / width,
        method="COBYQA",
        bounds=[(0.0, 1.0)] * count,
        constraints=[optimize.NonlinearConstraint(excesses, least, 0.0)] * bool(least),
        options={"initial_tr_radius": 0.02, "final_tr_radius": 1e-9, "maxfev": 300},
    )
    best = min((np.frombuffer(key) for key in tried.known), key=order)
    if not equations and tried.meets(best, 0.0):
        return best
    nearest = _least_misses(tried, best)
    return nearest if equations else min(best, nearest, key=lambda x: order(x)[0])
