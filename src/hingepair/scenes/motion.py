"""The motion of a scene: whatever it comes from, what computes, explains or checks a scene asks it the same."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from hingepair.dynamics.simulate import SimulatedMotion, SimulatedPlanarMotion
from hingepair.integration.trajectory import Later
from hingepair.scenes.instants import Instants, Rows
from hingepair.scenes.known_motion import ByBody1, ByCoordinates, KnownMotion

if TYPE_CHECKING:
    from hingepair.scenes.expression_motion import ByFunctions, FunctionsOfTime

Given: TypeAlias = "ByFunctions | ByCoordinates | ByBody1"


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A motion at instants, and what a reader of it should know.

    Attributes:
        t: instants [s].
        given: the motion at all of them; gives some, and knows `level` and `sequence`.
        origin: where it comes from, in words.
        how: how body 1 turns, or how the motion was found.
        errors: how far each thing that was found is off at the worst instant, NaN where that is not known, by its
            unit; none of what is exact.
        doubt: why an error is not known, where one is not.
        hint: how to get derivatives that are missing, for messages.
        functions: of t that it is made of.
        simulated: the motion as it was simulated; None of others.
    """

    t: Instants
    given: Given
    origin: str
    how: str
    errors: Mapping[str, Later] = field(default_factory=dict)
    doubt: str = ""
    hint: str = ""
    functions: tuple[FunctionsOfTime, ...] = ()
    simulated: SimulatedMotion | SimulatedPlanarMotion | None = None

    @property
    def level(self) -> int:
        """The highest derivative that there is."""
        return self.given.level

    @property
    def sequence(self) -> str | None:
        """Euler sequence of body 1; None where its attitude does not come as three Euler angles."""
        return self.given.sequence

    @property
    def error_estimate(self) -> float:
        """How far attitude and psi [rad] are off at the worst instant; 0 of what is exact, NaN: not known."""
        unknown = [math.nan] * bool(self.doubt)
        return float(np.max([error() for error in self.errors.values()] or unknown, initial=0.0))

    @property
    def turning(self) -> str:
        """How body 1 turns, and how far that is off, for a reader."""
        if not self.errors:
            return self.how
        known = ", ".join(f"{error():.1g} {unit}" for unit, error in self.errors.items())
        return f"{self.how}, error {'unknown' if math.isnan(self.error_estimate) else f'about {known}'}"

    def kinks(self, start: int, stop: int) -> int:
        """How many of the intervals that end at these instants have a kink or a jump of a function of t."""
        t = self.t[max(start - 1, 0) : stop]
        return int(np.logical_or.reduce([functions.switches(t) for functions in self.functions]).sum())

    def known(self, rows: Rows, order: int) -> KnownMotion:
        """The motion at some of the instants, with derivatives up to an order."""
        return self.given.part(rows, order)


def turns_about(sequence: str) -> str:
    """How Euler angles turn body 1, for a reader."""
    return f"phi_x, phi_y, phi_z turn about {', '.join(sequence)}"
