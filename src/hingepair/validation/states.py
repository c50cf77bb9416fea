"""States for comparisons with Pinocchio: those of arguments, sample by sample; random ones; and hard ones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.numeric.arrays import Float64Array

_HARD_ANGLES = (0.0, 1e-9, -1e-160, np.pi, np.pi - 1e-9, -np.pi / 2, 1e6, -1e15)  # of hinges [rad]
_HARD_RATES = (0.0, 1e3, 1e-9)  # of hinges [rad/s], of sliders [m/s]


def samples_of(value: Any, shape: tuple[int, ...], rank: int) -> Float64Array:
    """Return a copy of an array, or of a tuple of components, broadcast to samples: shape (N, ...).

    Args:
        value: shape (..., ...), or a tuple whose entries have shape (...,).
        shape: leading shape of the N samples.
        rank: number of axes of one sample.
    """
    array = np.stack(np.broadcast_arrays(*value), axis=-1) if isinstance(value, tuple) else np.asarray(value)
    own = array.shape[array.ndim - rank :]
    return np.array(np.broadcast_to(array, (*shape, *own)), dtype=np.float64).reshape(math.prod(shape), *own)


def finite_samples(
    values: Mapping[str, Any], shape: tuple[int, ...], ranks: Mapping[str, int]
) -> tuple[dict[str, Float64Array], NDArray[np.bool_]]:
    """Return (arrays, finite): `samples_of` each value, NaN in all of them where one is not finite, and at which
    samples all are. `ranks` has the number of axes of a sample where it is not 1.
    """
    arrays = {name: samples_of(value, shape, ranks.get(name, 1)) for name, value in values.items()}
    finite = np.logical_and.reduce(
        [np.isfinite(array).all(axis=tuple(range(1, array.ndim))) for array in arrays.values()]
    )
    for array in arrays.values():
        array[~finite] = np.nan
    return arrays, finite


def random_and_hard_states(robot: Mechanism) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return q, q' and q'' of random states, and of states at which computations tend to fail, such as hinge angles
    near pi; shape (N, dof) each.
    """
    rng = np.random.default_rng(0)
    size = 200, robot.dof  # a humanoid takes some seconds
    hinges = np.array([joint.unit == "rad" for joint in tree_of(robot).joints if joint.mimic is None], dtype=bool)
    q = [rng.uniform(-np.pi, np.pi, size) * np.where(hinges, 1.0, 0.1)]
    qd, qdd = [rng.uniform(-2, 2, size)], [rng.uniform(-5, 5, size)]
    for angle in _HARD_ANGLES:
        for rate in _HARD_RATES:
            signs = rng.choice((-1.0, 1.0), (3, 1, robot.dof))
            q.append(signs[0] * np.where(hinges, angle, 0.0))  # sliders have no hard position
            qd.append(signs[1] * rate)
            qdd.append(signs[2] * rate * rate)
    return np.concatenate(q), np.concatenate(qd), np.concatenate(qdd)
