"""What determines the motion of a pair at some instants: seven coordinates, or body 1's motion and the hinge angle.

Either kind answers the same calls, so that what computes, explains or checks a scene need not know which it has.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.accuracy import euler_rate_sizes, given_rate_sizes
from hingepair.coordinates import Coordinates
from hingepair.explain import ScenePlan, explain
from hingepair.kinematics import COORDINATES, PARTS
from hingepair.motion import BodyMotion
from hingepair.plan import default_outputs, make_plan
from hingepair.state import PairState

if TYPE_CHECKING:
    from hingepair.cross_validation import CrossValidation
    from hingepair.pair import HingePair

Float64Array: TypeAlias = NDArray[np.float64]
Rows: TypeAlias = slice | NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class CoordinateSamples:
    """The seven coordinates and as many derivatives as are known.

    Attributes:
        count: number of instants.
        derivatives: (q[, qd[, qdd]]), tuples of seven: arrays of shape (count,), floats for what does not change.
        sequence: Euler sequence of body 1.
    """

    count: int
    derivatives: Coordinates
    sequence: str

    @property
    def level(self) -> int:
        """The highest derivative that is known."""
        return len(self.derivatives) - 1

    def part(self, rows: Rows, order: int) -> CoordinateSamples:
        """Some of the instants, with the derivatives up to an order."""
        parts = tuple(
            tuple(value[rows] if isinstance(value, np.ndarray) else value for value in seven)
            for seven in self.derivatives[: order + 1]
        )
        return CoordinateSamples(_count(self.count, rows), parts, self.sequence)

    def forward_kinematics(self, pair: HingePair, outputs: tuple[str, ...] | None) -> PairState:
        """The state of the pair; all of body 2 that the derivatives allow unless outputs are named."""
        q, *rates = self.derivatives
        if not any(isinstance(value, np.ndarray) for value in q):
            q = (np.full(self.count, q[0]), *q[1:])
        return pair.forward_kinematics(q, *rates, outputs=outputs, sequence=self.sequence)

    def plan(self, pair: HingePair, outputs: tuple[str, ...] | None, level: int) -> ScenePlan:
        """What `forward_kinematics` computes and skips; `level`: the highest derivative that the motion has."""
        constant = set()
        for parts, seven in zip(PARTS.values(), self.derivatives, strict=False):
            still = [not isinstance(value, np.ndarray) for value in seven]
            constant |= {
                part for part, own in zip(parts, (still[:3], still[3:6], still[6:]), strict=True) if all(own)
            }
        q = self.derivatives[0]
        constant |= {name for name, value in zip(COORDINATES, q, strict=True) if not isinstance(value, np.ndarray)}
        names = outputs or default_outputs(self.level)
        plan = make_plan(names, self.sequence, "home" in pair._constants.values)
        return explain(plan, self.level, level, frozenset(constant))

    def cross_validate(self, pair: HingePair) -> CrossValidation:
        """The equations against Pinocchio."""
        from hingepair.pinocchio import cross_validate

        return cross_validate(pair, *self.derivatives, sequence=self.sequence)

    def rates(self) -> tuple[Float64Array, Float64Array]:
        """W1, the size of body 1's turning, and psi'; shape (count,) rad/s; needs first derivatives."""
        qd = [np.broadcast_to(np.asarray(value, dtype=np.float64), (self.count,)) for value in self.derivatives[1]]
        W1, _ = euler_rate_sizes(np.stack(qd[3:6], axis=-1))
        return np.asarray(W1), qd[6]


@dataclass(frozen=True, slots=True, eq=False)
class BodySamples:
    """The motion of body 1 by its attitude, and the hinge angle, with as many derivatives as are known.

    Attributes:
        body1: shape (count,); with v and omega where psi' is there, a and alpha where psi'' is.
        hinge: (psi[, psi'[, psi'']]); shape (count,) each.
    """

    body1: BodyMotion
    hinge: tuple[Float64Array, ...]

    @property
    def level(self) -> int:
        """The highest derivative that is known."""
        return len(self.hinge) - 1

    def part(self, rows: Rows, order: int) -> BodySamples:
        """Some of the instants, with the derivatives up to an order."""
        letters = ("R", "S", "v", "omega", "a", "alpha")[: 2 * order + 2]
        arrays = {letter: array[rows] for letter in letters if (array := getattr(self.body1, letter)) is not None}
        return BodySamples(BodyMotion(**arrays), tuple(angle[rows] for angle in self.hinge[: order + 1]))

    def forward_kinematics(self, pair: HingePair, outputs: tuple[str, ...] | None) -> PairState:
        """The state of the pair; all of body 2 that the derivatives allow unless outputs are named."""
        return pair.forward_kinematics_from_body1(self.body1, *self.hinge, outputs=outputs)

    def plan(self, pair: HingePair, outputs: tuple[str, ...] | None, level: int) -> ScenePlan:
        """What `forward_kinematics` computes and skips; `level`: the highest derivative that the motion has."""
        names = outputs or default_outputs(self.level)
        plan = make_plan(names, None, "home" in pair._constants.values)
        return explain(plan, self.level, level, frozenset())

    def cross_validate(self, pair: HingePair) -> CrossValidation:
        """The equations against Pinocchio."""
        from hingepair.pinocchio import cross_validate_from_body1

        return cross_validate_from_body1(pair, self.body1, *self.hinge)

    def rates(self) -> tuple[Float64Array, Float64Array]:
        """W1, the size of body 1's turning, and psi'; shape (count,) rad/s; needs first derivatives."""
        W1, _ = given_rate_sizes(self.body1.omega)
        return np.asarray(W1), self.hinge[1]


Samples: TypeAlias = CoordinateSamples | BodySamples


def _count(count: int, rows: Rows) -> int:
    return len(range(*rows.indices(count))) if isinstance(rows, slice) else rows.size
