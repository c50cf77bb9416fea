"""What comes out: the state of the pair at every sample."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import Any, ClassVar, NoReturn, Self

import numpy as np
from numpy.typing import NDArray

from hingepair.evaluation.plan import PLANAR, SPATIAL, outputs_of
from hingepair.numeric.arrays import FloatArray, read_only


class _Result:
    """One output as a read-only attribute: an array, or None where it was not computed."""

    def __init__(self, meaning: str) -> None:
        self.__doc__ = meaning

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, state: _State, owner: type | None = None) -> FloatArray | None:
        if state is None:
            return self
        found = state._arrays.get(self.name)
        return state._array(self.name) if found is None else found

    def __set__(self, state: _State, value: object) -> None:
        raise AttributeError(f"{self.name}: a {type(state).__name__} cannot be changed")


class _State:
    """What was computed at every sample, by name."""

    __slots__ = ("_arrays", "_buffer", "_layout", "shape")

    _kind: ClassVar[str]
    shape: tuple[int, ...]

    def __init__(self, arrays: Mapping[str, NDArray[Any]], shape: tuple[int, ...]) -> None:
        self._arrays = {name: _unchangeable(array) for name, array in arrays.items()}
        self._buffer: NDArray[Any] | None = None
        self._layout: Mapping[str, slice] = {}
        self.shape = shape

    @classmethod
    def _of_one(cls, buffer: NDArray[np.float64], layout: Mapping[str, slice]) -> Self:
        """One state: its numbers one after the other; the arrays are made when they are looked at."""
        state = cls.__new__(cls)
        state._arrays = {}
        buffer.flags.writeable = False
        state._buffer = buffer
        state._layout = layout
        state.shape = ()
        return state

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of what was computed."""
        return tuple(self._layout or self._arrays)

    def arrays(self) -> dict[str, FloatArray]:
        """What was computed, by name."""
        return {name: array for name in self.outputs if (array := self._array(name)) is not None}

    def __getattr__(self, name: str) -> NoReturn:
        known = (key for owner in (_State, type(self)) for key in vars(owner) if not key.startswith("_"))
        raise AttributeError(f"{type(self).__name__} has no {name!r}; it has {', '.join(known)}", name=name, obj=self)

    def __repr__(self) -> str:
        names = ", ".join(self.outputs)
        return f"{type(self).__name__}(shape={self.shape}, outputs=({names}))"

    def __reduce__(self) -> tuple[type[Self], tuple[dict[str, FloatArray], tuple[int, ...]]]:
        return type(self), (self.arrays(), self.shape)

    def _array(self, name: str) -> FloatArray | None:
        array = self._arrays.get(name)
        if array is None and name in self._layout and self._buffer is not None:
            array = self._buffer[self._layout[name]].reshape(outputs_of(self._kind)[name].tail)
            self._arrays[name] = array
        return array


def _unchangeable(array: Any) -> Any:
    """A view that cannot be written to; arrays of other libraries are theirs."""
    return read_only(array) if isinstance(array, np.ndarray) else array


class PairState(_State):
    """Body 2 (and body 1, where named) at every sample, as far as it was computed; world axes, SI units.

    Arrays are read-only views. What was not asked for, or cannot be had from the inputs, is None.

    Attributes:
        shape: leading shape of the samples; () for one state.
        outputs: names of what was computed.
    """

    __slots__ = ()

    _kind = SPATIAL

    R2 = _Result("Reference point of body 2; (..., 3) m.")
    S2 = _Result("Rotation of body 2, body to world; (..., 3, 3).")
    d = _Result("R2 - R1 = S1 u1 - S2 u2, unharmed by a large R1; (..., 3) m.")
    v2 = _Result("Velocity of body 2's reference point; (..., 3) m/s.")
    omega2 = _Result("Angular velocity of body 2; (..., 3) rad/s.")
    a2 = _Result("Classical acceleration of body 2's reference point; (..., 3) m/s^2.")
    alpha2 = _Result("Angular acceleration of body 2; (..., 3) rad/s^2.")
    R1 = _Result("Reference point of body 1; (..., 3) m.")
    S1 = _Result("Rotation of body 1, body to world; (..., 3, 3).")
    v1 = _Result("Velocity of body 1's reference point; (..., 3) m/s.")
    omega1 = _Result("Angular velocity of body 1; (..., 3) rad/s.")
    a1 = _Result("Classical acceleration of body 1's reference point; (..., 3) m/s^2.")
    alpha1 = _Result("Angular acceleration of body 1; (..., 3) rad/s^2.")


class PlanarState(_State):
    """Body 2 of a planar pair at every sample, as far as it was computed; world axes, SI units.

    Arrays are read-only views. What was not asked for, or cannot be had from the inputs, is None.

    Attributes:
        shape: leading shape of the samples; () for one state.
        outputs: names of what was computed.
    """

    __slots__ = ()

    _kind = PLANAR

    R2 = _Result("Reference point of body 2; (..., 2) m.")
    phi2 = _Result("Angle of body 2, phi + psi; (...,) rad.")
    d = _Result("R2 - R1, unharmed by a large R1; (..., 2) m.")
    v2 = _Result("Velocity of body 2's reference point; (..., 2) m/s.")
    omega2 = _Result("Angular velocity of body 2; (...,) rad/s.")
    a2 = _Result("Acceleration of body 2's reference point; (..., 2) m/s^2.")
    alpha2 = _Result("Angular acceleration of body 2; (...,) rad/s^2.")


@functools.cache
def layout_of(outputs: tuple[str, ...], kind: str = SPATIAL) -> dict[str, slice]:
    """Where each output stands in the buffer of one state."""
    layout, start = {}, 0
    for name in outputs:
        stop = start + math.prod(outputs_of(kind)[name].tail)
        layout[name] = slice(start, stop)
        start = stop
    return layout
