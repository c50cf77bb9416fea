"""What comes out: the state of the pair at every sample."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.arrays import FloatArray, read_only
from hingepair.numeric.tables import Sheet, Shown, sheet_of

Spans: TypeAlias = Mapping[str, tuple[int, int, tuple[int, ...]] | None]
"""Where each output stands in the buffer, and its shape; None of one that is an array of its own."""


class State(Shown):
    """What was computed at every sample, by name."""

    __slots__ = ("_content",)

    _content: tuple[Any, Spans, tuple[int, ...]]  # a buffer or arrays by name, where in the buffer, shape

    def __init__(self, arrays: Mapping[str, NDArray[Any]], shape: tuple[int, ...]) -> None:
        _set(self, "_content", (arrays, dict.fromkeys(arrays), shape))

    @classmethod
    def of_buffer(cls, buffer: NDArray[np.float64], layout: Spans, shape: tuple[int, ...] = ()) -> Self:
        """The outputs one after the other in one array; those of their own are made when they are looked at."""
        state = cls.__new__(cls)
        buffer.setflags(write=False)
        _set(state, "_content", (buffer, layout, shape))
        return state

    @property
    def shape(self) -> tuple[int, ...]:
        """Leading shape of the samples; () for one state."""
        return self._content[2]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of what was computed."""
        return tuple(self._content[1])

    def arrays(self) -> dict[str, FloatArray]:
        """What was computed, by name."""
        return {name: self[name] for name in self._content[1]}

    def released(self) -> dict[str, FloatArray]:
        """What was computed, by name, of a state that nobody else holds: arrays that can be written to."""
        content = self._content[0]
        if not isinstance(content, np.ndarray):
            return dict(content)
        content.flags.writeable = True
        return self.arrays()

    def __getitem__(self, name: str) -> FloatArray:
        """An output by its name; what `prepare` computes beyond kinematics has no attribute of its own.

        Raises:
            KeyError: it was not computed.
        """
        content, layout, _ = self._content
        place = layout[name]
        if place is None:  # a view that cannot be written to; arrays of other libraries are theirs
            found: FloatArray = content[name]
            return read_only(found) if isinstance(found, np.ndarray) else found
        start, stop, shape = place
        array: FloatArray = content.reshape(-1)[start:stop]
        return array if len(shape) == 1 else array.reshape(shape)

    if not TYPE_CHECKING:  # the names of the outputs are known to a type checker, all others are mistakes

        def __getattr__(self, name: str) -> Any:
            """An output of one state that is looked at for the first time, or one that was not computed."""
            if name not in type(self).__slots__:
                raise lacking(self, name)
            array = self[name] if name in self._content[1] else None
            _set(self, name, array)
            return array

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"{name}: a {type(self).__name__} cannot be changed")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"{name}: a {type(self).__name__} cannot be changed")

    def __dir__(self) -> list[str]:
        return [*(name for name in type(self).__slots__ if name in self.outputs), "arrays", "outputs", "shape"]

    def __repr__(self) -> str:
        names = ", ".join(self.outputs)
        return f"{type(self).__name__}(shape={self.shape}, outputs=({names}))"

    def _sheet(self) -> Sheet:
        return sheet_of(f"{type(self).__name__}, shape {self.shape}", self.arrays().items())

    def __reduce__(self) -> tuple[type[Self], tuple[dict[str, FloatArray], tuple[int, ...]]]:
        return type(self), (self.arrays(), self.shape)


_set = object.__setattr__


def lacking(thing: object, name: str) -> AttributeError:
    """That a state or a result has no such attribute; says what it has."""
    known = "" if name.startswith("_") else f"; it has {', '.join(dir(thing))}"
    return AttributeError(f"{type(thing).__name__} has no {name!r}{known}", name=name, obj=thing)


class PairState(State):
    """Body 2 (and body 1, where named) at every sample, as far as it was computed; world axes, SI units.

    Arrays are read-only views. What was not asked for, or cannot be had from the inputs, is None; to a type checker
    all are arrays, so that `state.R2[-1]` passes.

    Attributes:
        shape: leading shape of the samples; () for one state.
        outputs: names of what was computed.
    """

    __slots__ = {  # noqa: RUF023 (the order of the documentation)
        "R2": "Reference point of body 2; (..., 3) m.",
        "S2": "Rotation of body 2, body to world; (..., 3, 3).",
        "d": "R2 - R1 = S1 u1 - S2 u2, unharmed by a large R1; (..., 3) m.",
        "v2": "Velocity of body 2's reference point; (..., 3) m/s.",
        "omega2": "Angular velocity of body 2; (..., 3) rad/s.",
        "a2": "Classical acceleration of body 2's reference point; (..., 3) m/s^2.",
        "alpha2": "Angular acceleration of body 2; (..., 3) rad/s^2.",
        "R1": "Reference point of body 1; (..., 3) m.",
        "S1": "Rotation of body 1, body to world; (..., 3, 3).",
        "v1": "Velocity of body 1's reference point; (..., 3) m/s.",
        "omega1": "Angular velocity of body 1; (..., 3) rad/s.",
        "a1": "Classical acceleration of body 1's reference point; (..., 3) m/s^2.",
        "alpha1": "Angular acceleration of body 1; (..., 3) rad/s^2.",
        "jacobian": "Of `prepare`: (v2, omega2) by (v1, omega1, psi'); (..., 6, 7).",
        "acceleration_bias": "Of `prepare`: (a2, alpha2) where a1, alpha1, psi'' are none; (..., 6).",
        "coordinate_jacobian": "Of `prepare`: (v2, omega2) by the rates of the coordinates; (..., 6, 7).",
        "coordinate_jacobian_rate": "Of `prepare`: its time derivative; (..., 6, 7).",
        "force1": "Of `prepare`: what must act on body 1 at R1; (..., 3) N.",
        "torque1": "Of `prepare`: what must act on body 1 about R1; (..., 3) N m.",
        "hinge_torque": "Of `prepare`: what must act about the hinge axis; (...) N m.",
        "psidd": "Of `prepare`: acceleration of the hinge angle under what acts; (...) rad/s^2.",
    }

    R2: FloatArray
    S2: FloatArray
    d: FloatArray
    v2: FloatArray
    omega2: FloatArray
    a2: FloatArray
    alpha2: FloatArray
    R1: FloatArray
    S1: FloatArray
    v1: FloatArray
    omega1: FloatArray
    a1: FloatArray
    alpha1: FloatArray
    jacobian: FloatArray
    acceleration_bias: FloatArray
    coordinate_jacobian: FloatArray
    coordinate_jacobian_rate: FloatArray
    force1: FloatArray
    torque1: FloatArray
    hinge_torque: FloatArray
    psidd: FloatArray


class PlanarState(State):
    """Body 2 of a planar pair at every sample, as far as it was computed; world axes, SI units.

    Arrays are read-only views. What was not asked for, or cannot be had from the inputs, is None; to a type checker
    all are arrays.

    Attributes:
        shape: leading shape of the samples; () for one state.
        outputs: names of what was computed.
    """

    __slots__ = {  # noqa: RUF023 (the order of the documentation)
        "R2": "Reference point of body 2; (..., 2) m.",
        "phi2": "Angle of body 2, phi + psi; (...,) rad.",
        "d": "R2 - R1, unharmed by a large R1; (..., 2) m.",
        "v2": "Velocity of body 2's reference point; (..., 2) m/s.",
        "omega2": "Angular velocity of body 2; (...,) rad/s.",
        "a2": "Acceleration of body 2's reference point; (..., 2) m/s^2.",
        "alpha2": "Angular acceleration of body 2; (...,) rad/s^2.",
    }

    R2: FloatArray
    phi2: FloatArray
    d: FloatArray
    v2: FloatArray
    omega2: FloatArray
    a2: FloatArray
    alpha2: FloatArray


@functools.lru_cache(maxsize=1024)
def spans_of(
    tails: tuple[tuple[str, tuple[int, ...]], ...], shape: tuple[int, ...] = ()
) -> dict[str, tuple[int, int, tuple[int, ...]]]:
    """Where each output of these tails stands in one buffer of all samples."""
    spans, start = {}, 0
    for name, tail in tails:
        stop = start + math.prod(shape + tail)
        spans[name] = start, stop, shape + tail
        start = stop
    return spans
