"""The constraints E1 and E2 of two motions, by name: residuals, derivatives, Jacobian and bias, the hinge's angle."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.evaluation.plan import needed_steps
from hingepair.evaluation.steps import CONSTRAINT_STEPS
from hingepair.numeric.arrays import FloatArray
from hingepair.numeric.blocks import Named, numbers
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import follow_steps

TAILS = {
    "gap": (3,),
    "tilt": (2,),
    "tilt_angle": (),
    "psi": (),
    "gap_rate": (3,),
    "tilt_rate": (2,),
    "slip": (3,),
    "psid": (),
    "gap_acceleration": (3,),
    "tilt_acceleration": (2,),
    "psidd": (),
    "constraint_jacobian": (5, 12),
    "constraint_bias": (5,),
}
"""What can be had, and the shape of one sample of it."""


_FRAMES = ("u1", "u2", "n", "e1", "e2", "e1_in_2", "e2_in_2", "n_in_2")


def constraint_jacobian(pair: Constants, body1: BodyMotion, body2: BodyMotion) -> FloatArray:
    """The constraints' 5 x 12 Jacobian G, for solvers of differential-algebraic equations (E1, E2)."""
    values = {**motion_arrays("body1", body1, "S"), **motion_arrays("body2", body2, "S")}
    name = "constraint_jacobian"
    return constraint_values(pair, (name,), values, _shapes(body1, body2))[name]


def constraint_bias(pair: Constants, body1: BodyMotion, body2: BodyMotion) -> FloatArray:
    """What velocities alone add to the constraints' second derivative (E1, E2)."""
    values = {**motion_arrays("body1", body1, "S", "omega"), **motion_arrays("body2", body2, "S", "omega")}
    return constraint_values(pair, ("constraint_bias",), values, _shapes(body1, body2))["constraint_bias"]


def constraint_values(
    pair: Constants,
    names: Iterable[str],
    values: Named,
    shapes: Mapping[str, tuple[int, ...]],
    dtype: np.dtype[Any] | None = None,
) -> dict[str, NDArray[Any]]:
    """Some of TAILS at all samples.

    Args:
        pair: the pair's constants.
        names: out of TAILS.
        values: arrays of the two motions by name.
        shapes: of the samples, by argument.
        dtype: to compute in; unless given, that of the motions.
    """
    return follow_steps(
        CONSTRAINT_STEPS, {name: TAILS[name] for name in names}, with_hinge_frames(pair), values, shapes, dtype
    )


def available(names: Iterable[str], given: Iterable[str]) -> tuple[str, ...]:
    """Those of the names that can be had from the arrays given."""
    known = {*given, *_FRAMES}
    return tuple(name for name in names if needed_steps(CONSTRAINT_STEPS, (name,))[1] <= known)


def with_hinge_frames(pair: Constants) -> Constants:
    """The pair's constants, and the hinge's frame (e1, e2, n) in the axes of body 1 and of body 2.

    e1 is the axis of body 1 that is furthest from n, made perpendicular to it; e2 = n x e1. Body 2 has them turned by
    C^-1: by C^T a home that is a rotation to nine digits only would be seen as a tilt.
    """
    home = pair.values.get("home")
    if pair.single:
        frames = _frames_of_one(pair.values["n"], home)
    else:
        frames = _frames(pair.arrays["n"], None if home is None else pair.arrays["home"])
    return Constants({**pair.values, **frames}, {**pair.arrays, **frames}, pair.shape)


@functools.lru_cache(maxsize=256)
def _frames_of_one(n: tuple[float, ...], home: tuple[float, ...] | None) -> Named:
    return _frames(np.array(n), None if home is None else np.array(home))


def _frames(n: NDArray[np.float64], home: NDArray[np.float64] | None) -> Named:
    first = np.eye(3)[np.argmin(np.abs(n), axis=-1)]
    first = first - n * (n * first).sum(axis=-1, keepdims=True)
    first /= np.sqrt((first * first).sum(axis=-1, keepdims=True))
    own = other = {"e1": first, "e2": np.cross(n, first), "n": n}
    if home is not None:
        back = np.linalg.inv(home.reshape(*home.shape[:-1], 3, 3))
        other = {name: (back @ vector[..., None])[..., 0] for name, vector in own.items()}
    named = {**own, **{f"{name}_in_2": vector for name, vector in other.items()}}
    return {name: numbers(vector) for name, vector in named.items()}


def _shapes(body1: BodyMotion, body2: BodyMotion) -> dict[str, tuple[int, ...]]:
    return {"body1": body1.shape, "body2": body2.shape}
