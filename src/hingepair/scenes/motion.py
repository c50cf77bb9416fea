"""The motion of a scene: whatever it comes from, what computes, explains or checks a scene asks it the same."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from hingepair.dynamics.simulate import SimulatedMotion, SimulatedPlanarMotion
from hingepair.integration.trajectory import LazyValue
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.tables import instant_text
from hingepair.pair.dynamics import GRAVITY
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PLANAR_GRAVITY, PlanarPair
from hingepair.scenes.instants import Instants, Rows
from hingepair.scenes.known_motion import KnownMotion


class PairMotionSource(Protocol):
    """Protocol of a pair's motion at all instants of a scene; `part` returns it at some of these."""

    @property
    def level(self) -> int:
        """The highest derivative that there is."""

    @property
    def sequence(self) -> str | None:
        """Euler sequence of body 1; None where its attitude does not come as three Euler angles."""

    def part(self, rows: Rows, order: int, /) -> KnownMotion:
        """Return the motion at some of the instants, with derivatives up to an order."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Motion of a pair at a scene's instants, with its origin, its error estimates and notes for reports.

    Attributes:
        t: instants [s].
        source: the motion at all of them.
        origin: where it comes from, in words.
        how: how body 1 turns, or how the motion was found.
        errors: how far each thing that was found is off at the worst instant, NaN where that is not known, by its
            unit; none of what is exact.
        doubt: why an error is not known, where one is not.
        hint: how to get derivatives that are missing, for messages.
        functions: of t that it is made of; they know where they switch.
        simulated: the motion as it was simulated; None of others.
        stops: lower and upper stop of the simulated hinge [rad]; infinite where there is none.
        notes: sentences that every reader of the results should see.
        derived: names of the rates of a log that were found by finite differences; None of what is no log.
    """

    t: Instants
    source: PairMotionSource
    origin: str
    how: str
    errors: Mapping[str, LazyValue] = field(default_factory=dict)
    doubt: str = ""
    hint: str = ""
    functions: tuple[Any, ...] = ()
    simulated: SimulatedMotion | SimulatedPlanarMotion | None = None
    stops: tuple[float, float] = (-math.inf, math.inf)
    notes: tuple[str, ...] = ()
    derived: tuple[str, ...] | None = None

    @property
    def level(self) -> int:
        """The highest derivative that there is."""
        return self.source.level

    @property
    def error_estimate(self) -> float:
        """Largest errors of attitude and psi over the instants [rad]; 0: exact, NaN: not known."""
        unknown = [math.nan] * bool(self.doubt)
        return float(np.max([error() for error in self.errors.values()] or unknown, initial=0.0))

    @property
    def turning_description(self) -> str:
        """Description of how body 1 turns, or how the motion was found, and of the error, for a report."""
        if not self.errors:
            return self.how
        estimates = ", ".join(f"{error():.1g} {unit}" for unit, error in self.errors.items())
        return f"{self.how}, error {'unknown' if math.isnan(self.error_estimate) else f'about {estimates}'}"

    def count_kinks(self, start: int, stop: int) -> int:
        """Count the intervals that end at the instants start to stop - 1 and hold a kink or a jump of a function of
        t.
        """
        t = self.t[max(start - 1, 0) : stop]
        return int(np.logical_or.reduce([functions.switches(t) for functions in self.functions]).sum())

    def gravity(self, pair: HingePair | PlanarPair) -> tuple[float, ...]:
        """Return the gravity vector in space [m/s^2]: that of a simulated motion, or the default of the pair."""
        if self.simulated:
            return self.simulated.gravity
        return (*PLANAR_GRAVITY, 0.0) if isinstance(pair, PlanarPair) else GRAVITY


class LimitCounter:
    """Counter of the instants at which a coordinate or a rate is past its limits, and its extremes.

    Args:
        shown: name of the quantity in the sentence.
        limits: least and greatest value; infinite where there is none.
        unit: unit of both limits.
    """

    def __init__(self, shown: str, limits: tuple[float, float], unit: str) -> None:
        self._shown, self._limits, self._unit = shown, limits, unit
        self._outside, self._first = 0, ""
        self.least, self.most = math.inf, -math.inf

    def add(self, t: Float64Array, values: Float64Array) -> None:
        """Update counts and extremes with the values at some instants; shape (N,) each."""
        self.least = float(np.fmin.reduce(values, initial=self.least))
        self.most = float(np.fmax.reduce(values, initial=self.most))
        lower, upper = self._limits
        outside = np.flatnonzero((values < lower) | (values > upper))
        if outside.size:
            self._first = (
                self._first or f"first at t = {instant_text(t[outside[0]])} s ({values[outside[0]] + 0.0:.6g})"
            )
            self._outside += outside.size

    def sentences(self, instant_count: int) -> Iterator[str]:
        """Yield one sentence if a value was past its limits; `instant_count` is the number of all instants."""
        if self._outside:
            lower, upper = self._limits
            yield (
                f"{self._shown} leaves its limits, {lower:g} to {upper:g} {self._unit}, "
                f"at {self._outside} of {instant_count} instants, {self._first}"
            )


def constant_suspicions(name: str, angles: tuple[float, ...]) -> Iterator[str]:
    """Yield a sentence if angles [rad] look like degrees: whole numbers, the largest of more than two turns."""
    if angles and all(angle % 1 == 0 for angle in angles) and abs(largest := max(angles, key=abs)) > 4 * math.pi:
        yield f'{name}: {largest:g} is taken for radians, as all angles are; for degrees write "{largest:g}*pi/180"'


def kink_sentences(kink_count: int) -> Iterator[str]:
    """Yield one sentence that `kink_count` intervals hold kinks or jumps of functions of t; nothing for 0."""
    if kink_count:
        where = f"{kink_count} interval{'s' * (kink_count != 1)}"
        yield f"kinks or jumps in {where}; derivatives there are those from the right"


def non_finite_sentences(arrays: Mapping[str, NDArray[Any]]) -> Iterator[str]:
    """Yield one sentence that counts the instants with forces that are not finite; nothing if all are finite.
    `arrays` are the forces by name.
    """
    finite = [np.isfinite(array).reshape(len(array), -1).all(axis=1) for array in arrays.values()]
    lost = int((~np.logical_and.reduce(finite)).sum())
    if lost:
        yield f"{lost} of {len(finite[0])} instants have forces that are not finite; ranges are those of the others"


def turns_about(sequence: str) -> str:
    """Return a phrase on the axes that Euler angles turn body 1 about."""
    return f"phi_x, phi_y, phi_z turn about {', '.join(sequence)}"


def massive(pair: HingePair | PlanarPair) -> HingePair:
    """Return the pair in space, with the masses of its bodies."""
    return pair.massive() if isinstance(pair, PlanarPair) else pair
