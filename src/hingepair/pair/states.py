"""What comes out: the state of the pair at every sample."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from hingepair.evaluation.plan import SPATIAL, outputs_of
from hingepair.numeric.arrays import FloatArray, read_only


class _State:
    """What was computed at every sample, by name."""

    __slots__ = ("_found", "shape")

    shape: tuple[int, ...]
    _found: Any

    def __init__(self, arrays: Mapping[str, NDArray[Any]], shape: tuple[int, ...]) -> None:
        _set(self, "_found", {name: _unchangeable(array) for name, array in arrays.items()})
        _set(self, "shape", shape)

    @classmethod
    def of_one(cls, record: NDArray[np.void]) -> Self:
        """One state, of a record (`record_of`): the arrays are made when they are looked at."""
        state = cls.__new__(cls)
        record.setflags(write=False)
        _set(state, "_found", record)
        _set(state, "shape", ())
        return state

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of what was computed."""
        found = self._found
        return tuple(found) if type(found) is dict else found.dtype.names

    def arrays(self) -> dict[str, FloatArray]:
        """What was computed, by name."""
        return {name: self._found[name] for name in self.outputs}

    if not TYPE_CHECKING:  # the names of the outputs are known to a type checker, all others are mistakes

        def __getattr__(self, name: str) -> Any:
            """No such output: the message says which there are."""
            known = ", ".join(("shape", "outputs", "arrays", *_names_of(type(self))))
            raise AttributeError(f"{type(self).__name__} has no {name!r}; it has {known}", name=name, obj=self)

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"{name}: a {type(self).__name__} cannot be changed")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"{name}: a {type(self).__name__} cannot be changed")

    def __repr__(self) -> str:
        names = ", ".join(self.outputs)
        return f"{type(self).__name__}(shape={self.shape}, outputs=({names}))"

    def __reduce__(self) -> tuple[type[Self], tuple[dict[str, FloatArray], tuple[int, ...]]]:
        return type(self), (self.arrays(), self.shape)


_set = object.__setattr__


def _unchangeable(array: Any) -> Any:
    """A view that cannot be written to; arrays of other libraries are theirs."""
    return read_only(array) if isinstance(array, np.ndarray) else array


def _output(name: str, doc: str) -> Any:
    """An output as an attribute: an array, or None where it was not computed."""

    def read(state: Any) -> Any:
        try:
            return state._found[name]
        except (KeyError, ValueError):  # of a dict, of a record
            return None

    return property(read, doc=doc)


def _names_of(kind: type) -> tuple[str, ...]:
    """The outputs that a kind of state may have."""
    return tuple(kind.__annotations__)


class PairState(_State):
    """Body 2 (and body 1, where named) at every sample, as far as it was computed; world axes, SI units.

    Arrays are read-only views. What was not asked for, or cannot be had from the inputs, is None; to a type checker
    all are arrays, so that `state.R2[-1]` passes.

    Attributes:
        shape: leading shape of the samples; () for one state.
        outputs: names of what was computed.
    """

    __slots__ = ()

    R2: FloatArray = _output("R2", "Reference point of body 2; (..., 3) m.")
    S2: FloatArray = _output("S2", "Rotation of body 2, body to world; (..., 3, 3).")
    d: FloatArray = _output("d", "R2 - R1 = S1 u1 - S2 u2, unharmed by a large R1; (..., 3) m.")
    v2: FloatArray = _output("v2", "Velocity of body 2's reference point; (..., 3) m/s.")
    omega2: FloatArray = _output("omega2", "Angular velocity of body 2; (..., 3) rad/s.")
    a2: FloatArray = _output("a2", "Classical acceleration of body 2's reference point; (..., 3) m/s^2.")
    alpha2: FloatArray = _output("alpha2", "Angular acceleration of body 2; (..., 3) rad/s^2.")
    R1: FloatArray = _output("R1", "Reference point of body 1; (..., 3) m.")
    S1: FloatArray = _output("S1", "Rotation of body 1, body to world; (..., 3, 3).")
    v1: FloatArray = _output("v1", "Velocity of body 1's reference point; (..., 3) m/s.")
    omega1: FloatArray = _output("omega1", "Angular velocity of body 1; (..., 3) rad/s.")
    a1: FloatArray = _output("a1", "Classical acceleration of body 1's reference point; (..., 3) m/s^2.")
    alpha1: FloatArray = _output("alpha1", "Angular acceleration of body 1; (..., 3) rad/s^2.")


class PlanarState(_State):
    """Body 2 of a planar pair at every sample, as far as it was computed; world axes, SI units.

    Arrays are read-only views. What was not asked for, or cannot be had from the inputs, is None; to a type checker
    all are arrays.

    Attributes:
        shape: leading shape of the samples; () for one state.
        outputs: names of what was computed.
    """

    __slots__ = ()

    R2: FloatArray = _output("R2", "Reference point of body 2; (..., 2) m.")
    phi2: FloatArray = _output("phi2", "Angle of body 2, phi + psi; (...,) rad.")
    d: FloatArray = _output("d", "R2 - R1, unharmed by a large R1; (..., 2) m.")
    v2: FloatArray = _output("v2", "Velocity of body 2's reference point; (..., 2) m/s.")
    omega2: FloatArray = _output("omega2", "Angular velocity of body 2; (...,) rad/s.")
    a2: FloatArray = _output("a2", "Acceleration of body 2's reference point; (..., 2) m/s^2.")
    alpha2: FloatArray = _output("alpha2", "Angular acceleration of body 2; (...,) rad/s^2.")


@functools.cache
def record_of(outputs: tuple[str, ...], kind: str = SPATIAL) -> np.dtype[np.void]:
    """The type of one state: its outputs one after the other."""
    return np.dtype([(name, np.float64, outputs_of(kind)[name].tail) for name in outputs])
