"""The motion of a scene: whatever it comes from, what computes, explains or checks a scene asks it the same."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from hingepair.dynamics.simulate import SimulatedMotion, SimulatedPlanarMotion
from hingepair.integration.trajectory import LazyValue
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.tables import instant_text
from hingepair.pair.dynamics import GRAVITY
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PLANAR_GRAVITY, PlanarPair
from hingepair.scenes.instants import Instants, Rows
from hingepair.scenes.known_motion import KnownMotion


class Given(Protocol):
    """A motion at all of its instants, of which it gives some."""

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
    """A motion at instants, and what a reader of it should know.

    Attributes:
        t: instants [s].
        given: the motion at all of them.
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
    given: Given
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
        return self.given.level

    @property
    def error_estimate(self) -> float:
        """Largest errors of attitude and psi over the instants [rad]; 0: exact, NaN: not known."""
        unknown = [math.nan] * bool(self.doubt)
        return float(np.max([error() for error in self.errors.values()] or unknown, initial=0.0))

    @property
    def turning(self) -> str:
        """Description of the rotation of body 1 and of its error, for a report."""
        if not self.errors:
            return self.how
        known = ", ".join(f"{error():.1g} {unit}" for unit, error in self.errors.items())
        return f"{self.how}, error {'unknown' if math.isnan(self.error_estimate) else f'about {known}'}"

    def kinks(self, start: int, stop: int) -> int:
        """Return the number of intervals that end at these instants and hold a kink or a jump of a function of t."""
        t = self.t[max(start - 1, 0) : stop]
        return int(np.logical_or.reduce([functions.switches(t) for functions in self.functions]).sum())

    def gravity(self, pair: HingePair | PlanarPair) -> tuple[float, ...]:
        """Return the gravity vector in space [m/s^2]: that of the table [dynamics], or the default."""
        if self.simulated:
            return self.simulated.gravity
        return (*PLANAR_GRAVITY, 0.0) if isinstance(pair, PlanarPair) else GRAVITY


class LimitWatch:
    """Counts the instants at which a coordinate or a rate is past its limits, piece by piece.

    Args:
        shown: name of it, for readers.
        limits: least and greatest value; infinite where there is none.
        unit: of both.
    """

    def __init__(self, shown: str, limits: tuple[float, float], unit: str) -> None:
        self._shown, self._limits, self._unit = shown, limits, unit
        self._outside, self._first = 0, ""
        self.least, self.most = math.inf, -math.inf

    def add(self, t: Float64Array, values: Float64Array) -> None:
        """Look at the values at some instants; shape (N,) each."""
        self.least = float(np.fmin.reduce(values, initial=self.least))
        self.most = float(np.fmax.reduce(values, initial=self.most))
        lower, upper = self._limits
        outside = np.flatnonzero((values < lower) | (values > upper))
        if outside.size:
            self._first = (
                self._first or f"first at t = {instant_text(t[outside[0]])} s ({values[outside[0]] + 0.0:.6g})"
            )
            self._outside += outside.size

    def sentences(self, samples: int) -> Iterator[str]:
        """Yield a sentence if a value was past its limits; `samples` is the number of all instants."""
        if self._outside:
            lower, upper = self._limits
            yield (
                f"{self._shown} leaves its limits, {lower:g} to {upper:g} {self._unit}, "
                f"at {self._outside} of {samples} instants, {self._first}"
            )


def constant_suspicions(name: str, angles: tuple[float, ...]) -> Iterator[str]:
    """Yield a sentence if angles [rad] look like degrees: whole numbers, the largest of more than two turns."""
    if angles and all(angle % 1 == 0 for angle in angles) and abs(largest := max(angles, key=abs)) > 4 * math.pi:
        yield f'{name}: {largest:g} is taken for radians, as all angles are; for degrees write "{largest:g}*pi/180"'


def kink_sentences(kinks: int) -> Iterator[str]:
    """Yield a sentence if intervals hold kinks or jumps of functions of t."""
    if kinks:
        where = f"{kinks} interval{'s' * (kinks != 1)}"
        yield f"kinks or jumps in {where}; derivatives there are those from the right"


def turns_about(sequence: str) -> str:
    """Return a phrase on the axes that Euler angles turn body 1 about."""
    return f"phi_x, phi_y, phi_z turn about {', '.join(sequence)}"


def massive(pair: HingePair | PlanarPair) -> HingePair:
    """Return the pair in space, with the masses of its bodies."""
    return pair.massive() if isinstance(pair, PlanarPair) else pair
