"""The motion of a scene, whatever it comes from: its instants, its source, its errors, and what is noted about it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.pairs.accuracy import PINOCCHIO_ROUNDOFFS as MAX_RATIO
from hingepair.mechanism.results import MAX_HELD_INSTANTS
from hingepair.motion.run import Impact
from hingepair.numeric.arrays import Float64Array, read_only
from hingepair.scenes.motions.known import Known, Rows
from hingepair.scenes.tables import Key, Table
from hingepair.tables.sheets import instant_text
from hingepair.tables.units import SI, Units


def read_instants(time: Table) -> Float64Array:
    """Return the instants that the keys start, stop and samples of the Table [time] define; (samples,) s."""
    keys: dict[str, Key] = {"start": Table.number, "stop": Table.number, "samples": _read_sample_count}
    start, stop, samples = time.read(keys, required=keys).values()
    if not 0 <= stop - start < np.inf:
        time.fail("stop", f"a number from start = {start!r} on, at a finite distance")
    if samples == 1 and stop > start:
        time.fail("samples", f"at least 2, from start = {start!r} to stop = {stop!r}, or stop = start")
    closest = 2 * float(np.spacing(max(abs(start), abs(stop))))
    if samples > 1 and 0 < stop - start < (samples - 1) * closest:
        time.fail("samples", f"fewer: near t = {stop:.9g} s, floats tell instants {closest:.2g} s apart")
    return np.asarray(read_only(np.linspace(start, stop, samples)))


def _read_sample_count(time: Table, key: str) -> int:
    """Return the integer from 1 to MAX_HELD_INSTANTS under a key of [time]; 1e6 is one, too."""
    value: Any = time.values.get(key)
    if type(value) is float and value.is_integer():
        value = int(value)
    if type(value) is not int or not 1 <= value <= MAX_HELD_INSTANTS:
        time.fail(key, f"an integer from 1 to {MAX_HELD_INSTANTS}")
    return value


class MotionSource(Protocol):
    """A motion at all instants of a scene: functions of t, or a `Known` motion."""

    @property
    def level(self) -> int:
        """Order of the highest derivative that the motion has: 0, 1 or 2."""

    @property
    def sequence(self) -> str | None:
        """Euler sequence of the base; None if its attitude is not given by three Euler angles."""

    def part(self, rows: Rows, order: int, /) -> Known:
        """Return the motion at the instants with the indices `rows`, with derivatives up to `order`."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Motion:
    """Motion at the instants of a scene."""

    #: instants [s]
    t: Float64Array
    #: the motion at all instants
    source: MotionSource
    #: where the motion comes from, in words
    origin: str
    #: how body 1 turns, or how the motion was computed, in words; may be empty
    how: str = ""
    #: names of the joints that the scene moves
    moving: tuple[str, ...]
    #: how to get derivatives that are missing, for messages
    hint: str = ""
    #: functions of t that define the motion; they tell in which intervals they have kinks
    functions: Any = None
    #: sentences that every reader of the results should see
    notes: tuple[str, ...] = ()
    #: functions that return estimates of the largest error over the instants, by unit; NaN if unknown. Empty for
    #: exact motion
    errors: Mapping[str, Callable[[], float]] = field(default_factory=dict)
    #: why an error is unknown, in words; otherwise empty
    doubt: str = ""
    #: the simulated motion, a SimulatedRobotMotion; None if the motion was not simulated
    simulated: Any = None
    #: what acts at joints beside their motors, by name
    loads: Mapping[str, HingeLoad] = field(default_factory=dict)
    #: (force, torque) on links of a motion that is given, by name: vectors, or callables of (t, now)
    wrenches: Mapping[str, tuple[Any, Any]] = field(default_factory=dict)
    #: at which instants smoothed rates are as accurate as elsewhere, not at ends and gaps; None for all
    sure: NDArray[np.bool_] | None = None

    @property
    def error_estimate(self) -> float:
        """Estimate of the largest error over the instants [rad or m]; 0 if exact, NaN if unknown."""
        unknown = [math.nan] * bool(self.doubt)
        return float(np.max([error() for error in self.errors.values()] or unknown, initial=0.0))

    @property
    def level(self) -> int:
        """Order of the highest derivative that the motion has: 0, 1 or 2."""
        return self.source.level

    @property
    def description(self) -> str:
        """How body 1 turns or how the motion was computed, with the estimated error of a computed motion."""
        how = self.how or self.origin
        if not self.errors:
            return how
        estimates = ", ".join(f"{error():.1g} {unit}" for unit, error in self.errors.items())
        return f"{how}, error {'unknown' if math.isnan(self.error_estimate) else f'about {estimates}'}"

    def error_notes(self, u: float) -> tuple[str, ...]:
        """Return sentences if errors of the motion are unknown or exceed the bound of a comparison, MAX_RATIO * u."""
        errors = {unit: error() for unit, error in self.errors.items()}
        large = [f"{error:.1g} {unit}" for unit, error in errors.items() if error > MAX_RATIO * u]
        notes = [self.doubt] if math.isnan(self.error_estimate) and self.doubt else []
        if large:
            bound = f"the bound of {MAX_RATIO * u:.1g} rad"
            held = "the comparison is one of the equations at each instant, not of the way there"
            notes.append(
                f"by its own estimate the motion is off by about {' and '.join(large)}, above {bound}: {held}"
            )
        return tuple(notes)


def limit_sentences(
    shown: str, limits: tuple[float, float], unit: str, t: Float64Array, values: Float64Array, units: Units = SI
) -> Iterator[str]:
    """Yield one sentence, in `units`, if a quantity is outside its limits at some instants, otherwise nothing.

    Args:
        shown: name of the quantity in the sentence.
        limits: least and greatest value; infinite where there is none.
        unit: unit of both limits.
        t: the instants [s]; (N,).
        values: the quantity at them; (N,).
        units: units of the numbers in the sentence.
    """
    lower, upper = limits
    rounding = 1e-9 * max(1.0, *(abs(end) for end in limits if math.isfinite(end)), 1.0)
    outside = np.flatnonzero((values < lower - rounding) | (values > upper + rounding))
    if outside.size:
        factor, unit = units.factor(unit), units.unit(unit)
        yield (
            f"{shown} leaves its limits, {factor * lower:g} to {factor * upper:g} {unit}, at {outside.size} of "
            f"{len(t)} instants, first at t = {instant_text(t[outside[0]])} s "
            f"({factor * values[outside[0]] + 0.0:.6g})"
        )


def stop_sentences(
    shown: str,
    stops: tuple[float, float],
    unit: str,
    at_instants: tuple[float, float],
    whole: tuple[float, float],
    units: Units = SI,
) -> Iterator[str]:
    """Yield one sentence if a coordinate, whose least and greatest values are given at the instants and in the whole
    motion, presses into soft stops.
    """
    factor, unit = units.factor(unit), units.unit(unit)
    seen, deepest = (max(stops[0] - least, most - stops[1]) for least, most in (at_instants, whole))
    if deepest > 1e-9:  # rad or m; less is rounding
        at_them = f", at the instants {factor * max(seen, 0.0):.3g} {unit}: more of them show the peak of its force"
        yield (
            f"{shown} presses up to {factor * deepest:.3g} {unit} into its stops, which are springs "
            f"(stop_stiffness hardens them){at_them * (deepest > 1.05 * seen)}"
        )


def impact_sentences(impacts: Iterable[Impact], unit_of_joint: Mapping[str, str]) -> Iterator[str]:
    """Yield one sentence on the hardest impact of each joint at rigid stops, whose force is infinite."""
    by_joint: dict[str, list[Impact]] = {}
    for impact in impacts:
        by_joint.setdefault(impact.joint, []).append(impact)
    for name, own in by_joint.items():
        hardest = max(own, key=lambda impact: abs(impact.after - impact.before))
        rates = f"{name}' from {hardest.before:.3g} to {hardest.after + 0.0:.3g} {unit_of_joint[name]}/s"
        others = len(own) - 1
        more = f", and less hard {others} more time{'s' * (others > 1)}" if others else ""
        yield (
            f"{name} hits a rigid stop at t = {instant_text(hardest.t)} s ({rates}){more}: forces are without that "
            "of an impact; stop_stiffness in place of stop_restitution shows it"
        )
