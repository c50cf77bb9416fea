"""Masses and lengths of a robot that differ from sample to sample, such as ten thousand payloads of one hand.

The numbers of a robot's programs that they change become an input with samples; all others stay constants. Here,
matter counts with the body to which it is fixed, and is not moved to parents (T9), so that it changes the numbers of
that body alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.mechanism.bodies.body import NO_BODY, SECOND_MOMENTS
from hingepair.numeric.arrays import Float64Array, Frozen, broadcast_shape, read_only, real_array

_ROUNDING = 1e-9  # of an inertia's trace: by so much it may miss being that of a body


class JointSamples(NamedTuple):
    """Where a joint is, with leading axes where that differs from sample to sample."""

    point: Float64Array  # in the axes of the body that carries it [m]; (..., 3)
    S: Float64Array  # attitude of its body at q = 0, in these axes; (..., 3, 3)
    n: Float64Array  # its unit axis, in the axes of its own body; (..., 3)

    @property
    def shape(self) -> tuple[int, ...]:
        """Leading shape of all three."""
        return np.broadcast_shapes(self.point.shape[:-1], self.S.shape[:-2], self.n.shape[:-1])


@dataclass(frozen=True, slots=True, eq=False)
class Samples(Frozen):
    """What differs from sample to sample: matter fixed to bodies beside their own mass, and joints."""

    shape: tuple[int, ...] = ()  # leading shape of the samples
    # by the number of a body, what is fixed to it beside its own mass: mass, first moment and the entries xx, xy, xz,
    # yy, yz, zz of the second moment about the body's reference point, in its axes; (..., 10)
    matter: Mapping[int, Float64Array] = field(default_factory=dict)
    # by the number of a joint, where it is in the body that carries it
    joints: Mapping[int, JointSamples] = field(default_factory=dict)
    lengths: bool = False  # whether poses differ from sample to sample, not masses alone

    def with_matter(self, body: int, numbers: Float64Array) -> Samples:
        """Return a copy with more matter fixed to a body, numbers of shape (..., 10)."""
        shape = broadcast_shape({"payload": numbers.shape[:-1], "earlier payloads": self.shape})
        total = numbers + self.matter[body] if body in self.matter else numbers
        return replace(self, shape=shape, matter={**self.matter, body: read_only(np.array(total))})

    def with_joints(self, joints: Mapping[int, JointSamples], frames: Iterable[Float64Array]) -> Samples:
        """Return a copy with joints; `frames` are origins with samples, whose leading shape counts too."""
        shapes = {f"joint {k}": joint.shape for k, joint in joints.items()}
        shapes |= {f"frame {k}": array.shape[:-1] for k, array in enumerate(frames)}
        shape = broadcast_shape({**shapes, "payloads": self.shape})
        return replace(self, shape=shape, joints={**self.joints, **joints}, lengths=True)


@dataclass(frozen=True, slots=True, eq=False)
class Payload(Frozen):
    """Mass properties with leading axes, in the axes of the frame to which they are fixed."""

    mass: Float64Array  # [kg]; shape (...)
    centre_of_mass: Float64Array  # [m]; shape (..., 3)
    inertia: Float64Array  # about the centre of mass [kg m^2]; shape (..., 3, 3); zero for a point

    @property
    def shape(self) -> tuple[int, ...]:
        """Leading shape of all three."""
        return np.broadcast_shapes(self.mass.shape, self.centre_of_mass.shape[:-1], self.inertia.shape[:-2])


def read_payload(mass: ArrayLike, centre_of_mass: ArrayLike, inertia: ArrayLike | None) -> Payload:
    """Check mass properties with leading axes, and return them as a Payload."""
    values = {"mass": mass, "centre_of_mass": centre_of_mass}
    values["inertia"] = np.zeros((3, 3)) if inertia is None else inertia
    tails = {"mass": (), "centre_of_mass": (3,), "inertia": (3, 3)}
    arrays: dict[str, Any] = {}
    for name, value in values.items():
        array, tail = np.asarray(real_array(name, value), np.float64), tails[name]
        if array.ndim < len(tail) or array.shape[array.ndim - len(tail) :] != tail:
            raise ShapeError(name, f"shape (..., {', '.join(map(str, tail))})", f"shape {array.shape}")
        if not np.isfinite(array).all():
            raise ArgumentError(name, "finite numbers", "NaN or infinity")
        arrays[name] = read_only(array.copy())
    broadcast_shape({name: array.shape[: array.ndim - len(tails[name])] for name, array in arrays.items()})
    if (arrays["mass"] < 0).any():
        raise ArgumentError("mass", "masses of 0 or above", float(arrays["mass"].min()))
    J = arrays["inertia"]
    trace = np.trace(J, axis1=-2, axis2=-1)
    if (np.abs(J - np.swapaxes(J, -1, -2)).max(axis=(-2, -1)) > _ROUNDING * np.abs(trace)).any():
        raise ArgumentError("inertia", "symmetric matrices", "others")
    spread = np.linalg.eigvalsh(trace[..., None, None] / 2 * np.eye(3) - J)  # the principal second moments
    if (spread < -_ROUNDING * np.abs(trace)[..., None]).any():
        raise ArgumentError("inertia", NO_BODY, quoted(inertia) if J.ndim == 2 else "others")
    return Payload(arrays["mass"], arrays["centre_of_mass"], J)


def turned_moments(numbers: Float64Array, axes: Float64Array) -> Float64Array:
    """Return mass, first and second moments (..., 10) in a program's axes; `axes`, (..., 3, 3), rotates these to the
    body's.
    """
    N = np.empty((*numbers.shape[:-1], 3, 3))
    for k, (i, j) in enumerate(SECOND_MOMENTS):
        N[..., i, j] = N[..., j, i] = numbers[..., 4 + k]
    N = np.swapaxes(axes, -1, -2) @ N @ axes
    first = (numbers[..., None, 1:4] @ axes)[..., 0, :]
    columns = [numbers[..., 0], *np.moveaxis(first, -1, 0), *(N[..., i, j] for i, j in SECOND_MOMENTS)]
    return np.stack(np.broadcast_arrays(*columns), axis=-1)
