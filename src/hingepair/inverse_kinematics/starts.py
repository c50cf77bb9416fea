"""Where a search begins: random coordinates, and which of them lead near a target.

The coordinates stand in shares. Trial k of a target begins at the coordinates of the k-th share whose pose is nearest
to the target, as an inner product with all poses of the share finds. Its numbers are small integers, so that it is
exact in whatever order a library adds: a target has the same starts in any batch.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.calls import Call
from hingepair.inverse_kinematics.goals import Goal, target_slices
from hingepair.numeric.arrays import Float64Array

PER_SHARE: Final = 256  # random coordinates of a share
_MAX_PRODUCTS: Final = 200_000  # in one matrix product; beyond 262,144, OpenBLAS starts threads, which gain nothing
_PLACES: Final = 384  # integers from 0 to 1.3 reaches
_FAR: Final = 2.0**100  # square of a distance that is never the least
_ATTITUDES: Final = 90  # integers from 0 to an entry 1 of a rotation


@dataclass
class Starts:
    """Random coordinates within limits, in shares of `PER_SHARE`, and the poses that they lead to."""

    measure: Call  # of `steps.measure_loop`
    goals: tuple[Goal, ...]  # what the frames are to reach
    reaches: tuple[float, ...]  # for each goal, the stretched length of the chain that carries its frame [m]
    low: Float64Array  # least random coordinates
    high: Float64Array  # greatest ones
    seed: int  # of the random numbers
    _shares: dict[int, tuple[Float64Array, NDArray[np.float32]]] = field(default_factory=dict)

    def nearest(self, targets: Float64Array, share: int, among: int) -> Float64Array:
        """Return the coordinates whose poses are nearest to N targets, out of the first `among` of one share."""
        coordinates, poses = (part[..., :among] for part in self._share(share))
        count, columns = len(targets), poses.shape[0]
        rows = max(1, _MAX_PRODUCTS // poses.size)
        padded = np.zeros((-(-count // rows) * rows, columns), np.float32)
        padded[:count, :-1] = -2 * self._integers(targets)
        padded[:count, -1] = 1
        squares = padded.reshape(-1, rows, columns) @ poses  # of the distances, less those of the targets
        chosen = squares.reshape(len(padded), -1)[:count].argmin(axis=1)
        return np.ascontiguousarray(coordinates[:, chosen].T)

    def _share(self, k: int) -> tuple[Float64Array, NDArray[np.float32]]:
        """Return coordinates as columns, and the matrix that gives squared distances from rows (-2 target, 1)."""
        share = self._shares.get(k)
        if share is None:
            drawn = np.random.default_rng((self.seed, k)).uniform(self.low, self.high, (PER_SHARE, len(self.low)))
            drawn = np.clip(drawn, self.low, self.high)
            pose = self.measure.rows(drawn, np.zeros(self.measure.argument_shapes["target"]))["pose"]
            closed = np.isfinite(pose).all(axis=1)  # loops cannot be closed at all coordinates
            poses = self._integers(np.where(closed[:, None], pose, 0.0))
            squares = np.where(closed, np.square(poses).sum(axis=1), _FAR).astype(np.float32)
            share = self._shares[k] = drawn.T, np.concatenate([poses.T, squares[None]])
        return share

    def _integers(self, poses: Any) -> NDArray[np.float32]:
        """Return targets or poses rounded to integers in float32, whose products are exact."""
        # The sum of products of a target with a pose stays below 2^24, up to which float32 holds integers.
        fine = min(1.0, (10 / max(1, sum(goal.is_length for goal in self.goals))) ** 0.5)
        integers = np.empty(poses.shape, np.float32)
        for goal, part, reach in zip(self.goals, target_slices(self.goals), self.reaches, strict=True):
            steps = _PLACES if goal.is_length else _ATTITUDES
            integers[:, part] = np.rint(goal.comparable(poses[:, part], reach) * (steps * fine))
        return integers
