"""Results of integration: attitudes and hinge angles at the instants, and the state of the pair."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from inspect import Signature
from typing import Any, Final, Self

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.results import missing_attribute_error
from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import Frozen, check_choice, read_only
from hingepair.numeric.blocks import components_of, tabulate_one
from hingepair.numeric.dask_arrays import DaskCollection, apply_to_chunks, holds_dask
from hingepair.numeric.tables import instant_text
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.results import Result
from hingepair.pair.states import PairState, PlanarState
from hingepair.rotations.euler import matrix_to_euler
from hingepair.rotations.sequences import SEQUENCE_NAMES


class LazyValue:
    """A number, or an array of numbers, each of which is computed when it is first asked for.

    Args:
        values: a number, a function that returns it, or an array of these.

    >>> value = LazyValue(lambda: 6.0 * 7)
    >>> value(), LazyValue([1.0, lambda: 2.0])[1]()
    (42.0, 2.0)
    """

    __slots__ = ("_values",)

    def __init__(self, values: Any) -> None:
        self._values = np.asarray(values, object)

    def __call__(self) -> Any:
        """Return the number, or a read-only array of the numbers."""
        # Two threads may both compute a number, which is then the same.
        for index in np.ndindex(self._values.shape):
            value = self._values[index]
            self._values[index] = float(value()) if callable(value) else value
        return float(self._values[()]) if self._values.ndim == 0 else read_only(self._values.astype(np.float64))

    @property
    def is_computed(self) -> bool:
        """Whether all numbers have been computed already."""
        return not any(callable(value) for value in self._values.flat)

    def __getitem__(self, index: Any) -> LazyValue:
        """Return some of the numbers, which are computed once for both."""
        part = LazyValue(0.0)
        part._values = self._values[(*(index if isinstance(index, tuple) else (index,)), ...)]
        return part

    def __reduce__(self) -> tuple[type[LazyValue], tuple[Any]]:
        return LazyValue, (self(),)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class _TrajectoryBase(DaskCollection, Frozen, Result):
    """Base class of trajectories: instants, psi, method, number of steps, error estimates, and access to the
    attributes of the state.
    """

    __signature__ = (
        Signature()
    )  # only `integrate` calls it; the private fields are no part of the documented signature

    t: NDArray[np.float64]
    psi: NDArray[np.float64]
    state: Any
    method: str
    steps: Any
    _error: Any
    _psi_error: Any

    @property
    def described(self) -> str:
        """Text that names the integration method, such as "motion by magnus6"."""
        return f"motion by {self.method}"

    @property
    def motions(self) -> tuple[int, ...]:
        """Leading shape of the arrays of a trajectory that holds many motions, as a tuple; () for one motion. For N
        instants, the shape of psi is `motions + (N,)`.
        """
        shape: tuple[int, ...] = self.psi.shape[:-1]
        return shape

    def __getitem__(self, index: int | slice | tuple[int | slice, ...]) -> Self:
        """Return one motion, or some, of a trajectory of many motions; no array is copied.

        Args:
            index: indices or slices of the leading axes, those of the motions.

        Raises:
            ArgumentError: it is one motion already, or the index is of another kind.
            IndexError: there is no such motion.
        """
        key = index if isinstance(index, tuple) else (index,)
        is_index = all(isinstance(one, int | np.integer | slice) and not isinstance(one, bool) for one in key)
        if not is_index or len(key) > len(self.motions):
            expected = f"indices or slices of the {len(self.motions)} axes of motions"
            raise ArgumentError("index of the trajectory", expected, quoted(index))
        psi = self.psi[key]
        state = type(self.state)({name: array[key] for name, array in self.state.arrays().items()}, psi.shape)
        names = {one.name for one in fields(self)} & {"quat_wxyz", "R1", "phi", "_error", "_psi_error"}
        steps = self.steps[key]
        values = {name: getattr(self, name)[key] for name in names}
        steps = int(steps) if isinstance(steps, np.integer) else steps
        return replace(self, psi=psi, state=state, steps=steps, **values)

    def _dask_parts(self) -> tuple[Mapping[str, Any], Callable[[Mapping[str, Any]], Any]]:
        """Return a pair: a dict of the Dask arrays of the trajectory by name, and a function that makes a trajectory
        from a dict of these arrays, computed or lazy.
        """
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        state = values.pop("state")
        lazy = {name: value for name, value in values.items() if holds_dask(value)}
        others = {name: value for name, value in values.items() if name not in lazy}
        outputs, make_state = state._dask_parts()
        lazy |= {STATE_PREFIX + name: array for name, array in outputs.items()}
        return lazy, functools.partial(trajectory_from_arrays, type(self), others, make_state)

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of the trajectory, except the instants t, as a dict whose keys are their names. The first
        axis of every array is the axis of the instants. Raise an ArgumentError if the trajectory holds many motions
        or Dask arrays.

        The dict holds psi and the outputs that were computed, such as R2 and v2. For a Trajectory, it also holds R1
        and S1; for a PlanarTrajectory, it also holds phi.

        Raises:
            ArgumentError: the trajectory holds many motions, or its arrays are Dask arrays.
        """
        if self.motions:
            expected = "one motion, such as trajectory[0] (of many: trajectory.to_xarray())"
            raise ArgumentError("trajectory", expected, f"motions of shape {self.motions}")
        if holds_dask(self.psi):
            raise ArgumentError("trajectory", "a motion in memory, such as trajectory.compute()", "Dask arrays")
        return self._arrays()

    def _axes_and_arrays(self) -> tuple[tuple[str, ...], dict[str, NDArray[Any]]]:
        """Return a pair: a tuple of the names of the leading axes, and a dict of all arrays by name, except the
        instants t. The only axis of one motion is "time". For many motions, the axis "motion" comes first, or
        "motion_0", "motion_1", ... if the motions have several axes.
        """
        count = len(self.motions)
        if not count and not holds_dask(self.psi):
            return ("time",), self.recorded()
        motion_axes = tuple(f"motion_{axis}" for axis in range(count)) if count > 1 else ("motion",) * count
        return (*motion_axes, "time"), self._arrays()

    def _arrays(self) -> dict[str, NDArray[Any]]:
        """Return a dict of the state's outputs, the motion of body 1 and the hinge angle; shape (..., N, ...)."""
        names = ("R1", "S1", "psi") if isinstance(self, Trajectory) else ("phi", "psi")
        return {**self.state.arrays(), **{name: getattr(self, name) for name in names}}

    @property
    def error_estimate(self) -> Any:
        """Estimate of the largest error of the attitude of body 1 at any instant, as an angle [rad]. In a
        PlanarTrajectory, the attitude of body 1 is the angle phi. The estimate includes rounding errors. It is
        computed at the first access.

        For one motion the estimate is a number. For many motions it is an array of shape (...,). For a trajectory of
        Dask arrays it is a lazy array, whose tasks integrate the motions again. `psi_error_estimate` is the estimate
        for psi.

        The rates are the arguments omega1 and psid of `integrate`, which are constants, callables or samples. If the
        rates are smooth and rounding errors are small, the estimate differs from the actual error by a few per cent.

        If rates are callables, the result of each integration step is compared with the result of steps of half its
        length or less. This comparison can miss part of the effect of a jump or a kink, since a callable is known
        only at the times at which it was evaluated. The estimate therefore includes an estimate of the error that
        jumps and kinks between these times cause, which is computed from the values at these times. If a callable has
        a jump or a kink, the whole estimate is between a third of the actual error and ten times the actual error. If
        there are more than 65,536 integration steps, only some are compared: the steps over which the values of the
        callables change most abruptly, and one step from each of many short parts of the total time. Whatever the
        number of steps, a pulse of a callable that is shorter than about 1/500 of the total time may be missed.

        If rates are samples, the estimate includes the error of interpolation, which is due to long times without
        samples (gaps), to motion that the samples hardly resolve, and to jumps and kinks anywhere between two
        samples. It also includes the error
        that is due to time stamps rounded to double precision, single precision or decimals, if the samples show this
        rounding. The estimate is NaN for fewer than 4 samples.

        The estimate does not include errors that have one of these causes:

        - noise in the arguments of `integrate`;
        - motion that leaves no trace in the samples: motion that begins and ends within a gap, or that has fewer than
          two samples per period;
        - rounded time stamps whose rounding error changes so slowly from sample to sample that the samples do not
          show it.
        """
        return self._error() if isinstance(self._error, LazyValue) else self._error

    @property
    def psi_error_estimate(self) -> Any:
        """Estimate of the largest error of the hinge angle psi at any instant [rad]. It is a number for one motion
        and an array of shape (...,) for many motions. For a trajectory of Dask arrays, it is a lazy array.
        `error_estimate` describes which errors the estimate includes.
        """
        return self._psi_error() if isinstance(self._psi_error, LazyValue) else self._psi_error

    def __getattr__(self, name: str) -> Any:
        state = object.__getattribute__(self, "state")
        if not name.startswith("_") and hasattr(type(state), name):
            return getattr(state, name)
        raise missing_attribute_error(self, name)

    def __repr__(self) -> str:
        t, method, steps, error, psi = (
            object.__getattribute__(self, name) for name in ("t", "method", "steps", "_error", "psi")
        )
        computed = isinstance(error, LazyValue) and error.is_computed and psi.size > 0
        estimate = f", error_estimate={np.max(error()):.2g}" if computed else ""
        names = ", ".join(object.__getattribute__(self, "state").outputs)
        motions = f"motions={psi.shape[:-1]}, " if psi.ndim > 1 else ""
        counts = f"steps={_describe_steps(steps)}, {motions}{describe_instants(t)}{estimate}"
        return f"{type(self).__name__}({method}, {counts}, outputs=({names}))"

    def _available_names(self) -> Iterable[str]:
        """Return the names of the attributes of the state, which the trajectory has too."""
        return dir(object.__getattribute__(self, "state"))


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Trajectory(_TrajectoryBase):
    """The motion of a pair over time, as `integrate` returns it (E12). All attributes of its `state`, such as R2, S2
    and v2, are also attributes of the trajectory.

    A trajectory may hold many motions over the same instants. Its arrays, except t, then have leading axes, which the
    shapes below show as `...`. The attribute `motions` is the shape of these axes; it is () for one motion.
    `trajectory[3]` is the trajectory of the motion with index 3, `trajectory[:10]` is the trajectory of the first ten
    motions, and `to_xarray` returns all motions as labelled arrays. Only a single motion can be saved, plotted or
    converted to a DataFrame.

    Attributes:
        t: the instants [s]; shape (N,).
        quat_wxyz: attitude of body 1, body to world, as unit quaternions with the scalar first and without jumps of
            sign; shape (..., N, 4).
        psi: hinge angle [rad]; shape (..., N).
        R1: position of the reference point of body 1, world axes [m]; shape (..., N, 3).
        state: the PairState at the instants.
        pair: the HingePair.
        method: name of the integration method, such as "magnus6".
        steps: number of integration steps; for many motions an array of shape (...,).
    """

    quat_wxyz: NDArray[np.float64]
    R1: NDArray[Any]
    state: PairState
    pair: HingePair

    @property
    def quat_xyzw(self) -> NDArray[np.float64]:
        """Attitude of body 1, body to world, as unit quaternions with the scalar last; shape (..., N, 4)."""
        return self.quat_wxyz[..., [1, 2, 3, 0]]

    @property
    def S1(self) -> NDArray[Any]:
        """Rotation matrices from the axes of body 1 to world axes; shape (..., N, 3, 3). If the argument `outputs`
        of `integrate` or `simulate` names S1, they are stored; otherwise they are computed from `quat_wxyz` at each
        access.
        """
        S1 = self.state.S1
        if S1 is not None:
            return S1
        if holds_dask(self.quat_wxyz):
            return apply_to_chunks(quaternions_to_matrices, {"quat_wxyz": self.quat_wxyz}, {"quat_wxyz": (4,)})
        return read_only(quaternions_to_matrices(self.quat_wxyz))

    def euler_angles(self, body: int, sequence: str = "XYZ") -> NDArray[np.float64]:
        """Return the Euler angles of body 1 or 2 [rad], shape (..., N, 3). The angles do not jump between instants,
        unless an instant is at gimbal lock. Raise an ArgumentError if the arrays are Dask arrays, or if `body` is 2
        and S2 was not computed.

        Two triples of angles describe an attitude that is not at gimbal lock, and whole turns may be added to each
        angle. At the first instant, the method returns the triple of `matrix_to_euler`; at each later instant, it
        returns the triple nearest to the triple of the instant before. The angles are right only if each of them
        changes by less than half a turn from one instant to the next; this is not checked. They are also right if the
        middle angle passes through gimbal lock between two instants. At an instant at gimbal lock, only the sum or
        the difference of the first and the third angle is determined, and these two angles may jump.

        Args:
            body: 1 or 2. For body 2, the argument `outputs` of `integrate` or `simulate` must name S2 or be left at
                the default.
            sequence: one of 24 Euler sequences, such as "XYZ" (the default). Upper-case letters are rotations about
                the axes of the rotated body (intrinsic), lower-case letters rotations about fixed axes (extrinsic).

        Returns:
            Angles in the order of the sequence's letters [rad]; shape (..., N, 3).

        Raises:
            ArgumentError: body is not 1 or 2, the sequence is unknown, S2 was not computed, or the arrays are Dask
                arrays.
        """
        check_choice("sequence", sequence, SEQUENCE_NAMES)
        if body not in {1, 2}:
            raise ArgumentError("body", "1 or 2", quoted(body))
        S = self.S1 if body == 1 else self.state.S2
        if S is None:
            raise ArgumentError("body", "1, or S2 among the outputs", body)
        return unwrap_euler_angles(matrix_to_euler(S, sequence), proper=sequence[0] == sequence[2])


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class PlanarTrajectory(_TrajectoryBase):
    """The motion of a planar pair over time, as `integrate` returns it (E11, E12). All attributes of its `state`,
    such as R2, phi2 and v2, are also attributes of the trajectory.

    A trajectory may hold many motions over the same instants. Its arrays, except t, then have leading axes, which the
    shapes below show as `...`. The attribute `motions` is the shape of these axes; it is () for one motion.
    `trajectory[3]` is the trajectory of the motion with index 3.

    Attributes:
        t: the instants [s]; shape (N,).
        phi: angle of body 1 [rad]; shape (..., N). The angle of body 2 is `phi2`.
        psi: hinge angle [rad]; shape (..., N).
        state: the PlanarState at the instants.
        method: name of the integration method, such as "magnus6".
        steps: number of integration steps; for many motions an array of shape (...,).
    """

    phi: NDArray[np.float64]
    state: PlanarState


STATE_PREFIX: Final = "state."
"""Prefix of the names of a state's outputs among the arrays of a trajectory."""

_ERRORS = {"_error", "_psi_error"}  # names of the fields that hold errors


def trajectory_from_arrays(
    trajectory_class: type[_TrajectoryBase],
    other_values: Mapping[str, Any],
    state_function: Callable[[Mapping[str, Any]], Any],
    arrays: Mapping[str, Any],
) -> Any:
    """Return a trajectory of `trajectory_class` from two dicts of values by field name, `arrays` (NumPy or Dask) and
    `other_values`. `state_function` makes the state from a dict of the arrays whose names begin with
    STATE_PREFIX, without this prefix. If no array of a field is a Dask array, the arrays become
    read-only, a single number of steps an int, and the numbers of error estimates lazy values that return them.
    Otherwise the arrays stay as they are.
    """
    outputs = {name.removeprefix(STATE_PREFIX): a for name, a in arrays.items() if name.startswith(STATE_PREFIX)}
    field_arrays = {name: array for name, array in arrays.items() if not name.startswith(STATE_PREFIX)}
    if not holds_dask(field_arrays):
        errors = {name: LazyValue(np.asarray(field_arrays.pop(name))) for name in field_arrays.keys() & _ERRORS}
        field_arrays = {name: read_only(np.asarray(array)) for name, array in field_arrays.items()} | errors
        field_arrays |= {"steps": int(field_arrays["steps"])} if np.ndim(field_arrays.get("steps", ())) == 0 else {}
    return trajectory_class(**{**other_values, **field_arrays, "state": state_function(outputs)})


def _describe_steps(steps: Any) -> str:
    """Return the number of steps as text: the number for one motion, the range for many motions, or "not computed"
    for a Dask array.

    >>> _describe_steps(np.array([12, 40])), _describe_steps(7)
    ('12..40', '7')
    """
    if not isinstance(steps, np.ndarray):
        return str(steps) if isinstance(steps, int) else "not computed"
    return f"{steps.min()}..{steps.max()}" if steps.size else "0"


def describe_instants(t: NDArray[np.float64]) -> str:
    """Return text such as "samples=5, t=0..2" with the number of instants, the first and the last one.

    >>> describe_instants(np.linspace(0, 2, 5))
    'samples=5, t=0..2'
    """
    return f"samples={len(t)}, t={instant_text(t[0])}..{instant_text(t[-1])}" if len(t) else "samples=0"


def quaternions_to_matrices(quat_wxyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation matrices (..., 3, 3) of unit quaternions `quat_wxyz` (..., 4), scalar first. They are
    orthonormal to 4 unit roundoffs.
    """
    parts = {"q": components_of(quat_wxyz)}
    return tabulate_one(
        lambda v: _orthonormalized(eq.quaternion_attitude(v["q"])), parts, (3, 3), np.dtype(np.float64)
    )


def _orthonormalized(S: eq.Matrix) -> eq.Matrix:
    """Return the matrix S + S (I - S^T S) / 2 as a tuple of nine entries. If S is nearly orthonormal, the result is
    orthonormal up to rounding.
    """
    x, y, z = S[0::3], S[1::3], S[2::3]
    a, b, c = (0.5 - 0.5 * eq.dot(column, column) for column in (x, y, z))
    d, e, f = (-0.5 * eq.dot(*columns) for columns in ((x, y), (y, z), (z, x)))
    correction = eq.compose(S, (a, d, f, d, b, e, f, e, c))
    return tuple(s + r for s, r in zip(S, correction, strict=True))


def rotate_to_world(S1: NDArray[Any], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vectors (..., 3) rotated from the axes of body 1 to world axes by the attitudes S1 (..., 3, 3) of body
    1, as an array (..., 3).
    """
    parts = {"S1": components_of(S1, 2), "w": components_of(vectors)}
    return tabulate_one(lambda v: eq.rotate(v["S1"], v["w"]), parts, (3,), np.dtype(np.float64))


def unwrap_euler_angles(phi: NDArray[Any], *, proper: bool) -> NDArray[np.float64]:
    """Return Euler angles (..., N, 3) [rad] of the same attitudes as the angles `phi`, continuous from sample to
    sample. `proper` is True if the first and the third axis of the sequence coincide.

    (a, b, c) and (a + pi, pi - b, c + pi) are one attitude; for a sequence whose first axis comes back (`proper`),
    (a, b, c) and (a + pi, -b, c + pi). To exchange both of two neighbours does not change their distance, so that
    each pair of neighbours is decided on its own: stay, or change to the other triple.
    """
    other = np.stack([phi[..., 0] + np.pi, (0.0 if proper else np.pi) - phi[..., 1], phi[..., 2] + np.pi], axis=-1)
    before = phi[..., :-1, :]
    steps = (np.remainder(kind[..., 1:, :] - before + np.pi, 2 * np.pi) - np.pi for kind in (phi, other))
    stay, change = (np.abs(step).sum(axis=-1) for step in steps)
    first = np.zeros((*phi.shape[:-2], 1), int)
    changed = np.concatenate([first, np.cumsum(change < stay, axis=-1)], axis=-1) % 2 == 1
    return np.unwrap(np.where(changed[..., None], other, phi), axis=-2)
