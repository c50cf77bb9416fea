"""Motions of a robot in time, step by step, many at once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.binding import ComponentSource, bind_constant
from hingepair.engine.outputs import output_arrays
from hingepair.engine.results import Results
from hingepair.engine.slices import run_in_threads
from hingepair.engine.ufunc import Layout, Operand, Ufunc
from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.mechanism.computations import RESTING_BASE_VALUE_BY_INPUT_NAME, RobotComputation
from hingepair.numeric.arrays import (
    Float64Array,
    FloatArray,
    Frozen,
    broadcast_shape,
    check_choice,
    finite_number,
    own_copy,
    real_array,
)
from hingepair.pair.body_motion import BodyMotion
from hingepair.plans.arguments import Coordinates, check_out, read_coordinates
from hingepair.plans.rollouts import BASE_STATE, METHODS, Control, stage_size, state_parts, step_loop
from hingepair.plans.trees import Form, Request, request_loop

_LANES: Final = 1024  # motions that are stepped together, so that their states stay in the cache
# Of each stage of "rk4": from the start of the step to the next stage, weight, and half steps from the start.
_STAGES: Final = ((0.5, 1 / 6, 0), (0.5, 1 / 3, 1), (1.0, 1 / 3, 1), (0.0, 1 / 6, 2))
_MOVING: Final = {"S1": "S", "omega1": "omega", "a1": "a", "alpha1": "alpha"}  # of a base that moves as given


@dataclass(frozen=True, slots=True, eq=False, init=False)
class Feedback(Frozen):
    """Controller of a rollout: tau = tau_ff + K (q_ref - q) + D (qd_ref - qd).

    Args:
        K: gains of the positions [N m/rad, N/m]: a number or shape (dof,), on the diagonal; or matrices, shape
            (dof, dof) or (..., steps, dof, dof).
        D: gains of the rates [N m s/rad, N s/m], in the same forms.
        q_ref: wanted coordinates: a number or shape (dof,), held; or shape (..., steps, dof), held over each step.
        qd_ref: wanted rates, in the same forms.
        tau_ff: efforts that are added [N m, N], in the same forms.

    Raises:
        ArgumentError: a value cannot be used.
    """

    K: NDArray[Any]
    D: NDArray[Any]
    q_ref: NDArray[Any]
    qd_ref: NDArray[Any]
    tau_ff: NDArray[Any]

    def __init__(
        self, K: ArrayLike, D: ArrayLike, q_ref: ArrayLike, qd_ref: ArrayLike = 0.0, tau_ff: ArrayLike = 0.0
    ) -> None:
        given = {"K": K, "D": D, "q_ref": q_ref, "qd_ref": qd_ref, "tau_ff": tau_ff}
        for name, value in given.items():
            object.__setattr__(self, name, own_copy(np.asarray(real_array(f"tau.{name}", value), np.float64)))


class Rollout(Results):
    """Motions of a robot at the recorded steps, the start first. Only hingepair calls the constructor."""

    __slots__ = {  # noqa: RUF023 (the order of the documentation)
        "q": "Coordinates; (..., steps + 1, dof).",
        "qd": "Their time derivatives; (..., steps + 1, dof).",
        "R1": "Reference point of a free base, world axes; (..., steps + 1, 3) m.",
        "S1": "Rotation of a free base, base to world; (..., steps + 1, 3, 3).",
        "v1": "Velocity of R1; (..., steps + 1, 3) m/s.",
        "omega1": "Angular velocity of a free base, world axes; (..., steps + 1, 3) rad/s.",
    }

    q: FloatArray
    qd: FloatArray
    R1: FloatArray
    S1: FloatArray
    v1: FloatArray
    omega1: FloatArray

    @property
    def base_motion(self) -> BodyMotion | None:
        """Motion of a free base, for the argument of this name of the robot's methods; None for any other base."""
        if self.R1 is None:
            return None
        return BodyMotion(R=self.R1, S=self.S1, v=self.v1, omega=self.omega1)


class Track(NamedTuple):
    """An argument along the steps."""

    label: str  # name in messages
    values: Float64Array  # (..., instants, *one sample); one instant holds for all
    tail: tuple[int, ...]  # shape of one sample

    @property
    def instants(self) -> int:
        """How many instants it has; 1 holds for all."""
        count: int = self.values.shape[self.values.ndim - len(self.tail) - 1]
        return count

    @property
    def lanes(self) -> tuple[int, ...]:
        """Leading shape: of the motions."""
        return self.values.shape[: self.values.ndim - len(self.tail) - 1]

    def at(self, lanes: tuple[int, ...], chunk: slice) -> Float64Array:
        """Return the values of a chunk of motions, which have the shape `lanes`: (motions or 1, instants, ...)."""
        own = self.values.shape[len(self.lanes) :]
        if math.prod(self.lanes) == 1:
            return self.values.reshape(1, *own)
        return np.broadcast_to(self.values, (*lanes, *own)).reshape(-1, *own)[chunk]


def track(label: str, value: Any, *tail: int) -> Track:
    """Return an argument as a Track. A number or one sample holds for all steps; further axes end with the steps.

    Raises:
        ArgumentError: the value cannot be used.
    """
    array = np.asarray(real_array(label, value), np.float64)
    if array.ndim == 0:
        array = np.broadcast_to(array, tail)
    if array.ndim < len(tail) or array.shape[array.ndim - len(tail) :] != tail:
        expected = f"shape {tail} or (..., steps, {', '.join(map(str, tail))})"
        raise ShapeError(label, expected, f"shape {array.shape}")
    return Track(label, array[None] if array.ndim == len(tail) else array, tail)


def control_tracks(tau: Any, dof: int, limit: Any) -> tuple[Control, dict[str, Track]]:
    """Return where efforts come from, and the tracks of its inputs; `limit` holds the largest efforts, or is None.

    Raises:
        ArgumentError: a value cannot be used.
    """
    limited = {} if limit is None else {"limit": track("effort_limits", limit, dof)}
    if not isinstance(tau, Feedback):
        return Control("none", bool(limited)), {"tau": track("tau", tau, dof), **limited}
    tracks = {name: track(f"tau.{name}", getattr(tau, name), dof) for name in ("q_ref", "qd_ref", "tau_ff")}
    full = tau.K.ndim > 1 or tau.D.ndim > 1
    for name in ("K", "D"):
        gain: Any = getattr(tau, name)
        if full and gain.ndim < 2:
            gain = np.diag(track(f"tau.{name}", gain, dof).values[0])
        tracks[name] = track(f"tau.{name}", gain, *((dof, dof) if full else (dof,)))
    return Control("full" if full else "diagonal", bool(limited)), {**tracks, **limited}


def base_tracks(base_motion: BodyMotion | None) -> dict[str, Track]:
    """Return the tracks of a base that moves as given; none where it rests at the origin, and only its attitude where
    it rests.

    Raises:
        ArgumentError: a derivative is missing.
    """
    if base_motion is None:
        return {}
    tracks = {}
    at_rest = all(getattr(base_motion, letter) is None for letter in ("v", "omega", "a", "alpha"))
    for name, letter in _MOVING.items():
        value = getattr(base_motion, letter)
        if value is None and at_rest:
            continue
        if value is None:
            raise ArgumentError(f"base_motion.{letter}", f"a value, as in BodyMotion(..., {letter}=...)", None)
        tracks[name] = track("base_motion", value, *((3, 3) if name == "S1" else (3,)))
    return tracks


def count_steps(tracks: Mapping[str, Track], steps: int | None, method: str) -> int:
    """Return the number of steps, on which all tracks agree. Those of the base have an instant for each step, those
    of "rk4" for its start, middle and end.

    Raises:
        ArgumentError: they do not agree, or nothing says how many steps there are.
    """
    if steps is not None and (isinstance(steps, bool) or not isinstance(steps, int | np.integer) or steps < 0):
        raise ArgumentError("steps", "a whole number from 0", quoted(steps))
    count = None if steps is None else int(steps)
    for name, one in tracks.items():
        halves = name in _MOVING and method == "rk4"
        own = (one.instants - 1) / 2 if halves else one.instants
        if one.instants == 1 or own == count:
            continue
        if count is None and own == int(own):
            count = int(own)
            continue
        wanted = (
            "2 steps + 1 instants, for rk4" if count is None else f"{2 * count + 1 if halves else count} instants"
        )
        raise ShapeError(one.label, f"values for {wanted}, or for one", f"{one.instants}")
    if count is None:
        raise ArgumentError("steps", "a number of steps, since no argument has an axis of steps", None)
    return count


@dataclass(frozen=True, slots=True, eq=False)
class Stepper:
    """The compiled step of a robot."""

    ufunc: Ufunc
    inputs: tuple[str, ...]  # of the ufunc, in order
    parts: Mapping[str, tuple[int, ...]]  # of a state, in order, with the shape of one sample
    stage: int  # components of a stage; 0 for methods without stages

    @classmethod
    def of(cls, form: Form, request: Request, method: str, control: Control, known: Mapping[str, Any]) -> Stepper:
        """Compile a step, in which the inputs in `known` are the same for all motions and steps.

        Raises:
            CompilationError: LLVM fails.
        """
        loop = step_loop(form, request, method, control)
        pattern: list[ComponentSource] = []
        constants: list[float] = []
        arguments: list[tuple[str, tuple[int, ...]]] = []
        for name, tail in loop.inputs:
            if name in known:
                bound = bind_constant(name, tail, known[name])
                pattern += bound.pattern
                constants += bound.constants
            else:
                pattern += [(len(arguments), k) for k in range(math.prod(tail))]
                arguments.append((name, tail))
        outputs = tuple(Operand(tail) for _, tail in loop.outputs)
        layout = Layout(tuple(Operand(tail) for _, tail in arguments), outputs, bool(constants))
        kernel = loop.program(tuple(pattern)).kernel(layout, "d")
        numbers = np.array(constants) if constants else None
        ufunc = Ufunc(loop.name, layout, [("d", kernel.address("loop"), numbers)], kernel)
        stages = stage_size(form, request) if method == "rk4" else 0
        return cls(ufunc, tuple(name for name, _ in arguments), state_parts(form, request), stages)

    def run(
        self,
        start: Float64Array,
        tracks: Mapping[str, Float64Array],
        steps: int,
        every: int,
        records: Mapping[str, Float64Array],
    ) -> None:
        """Step a chunk of motions from their states, (motions, size), and write every so many steps into the records
        of all parts, (motions, records, one sample), after the start.
        """
        unrecorded = [np.empty((len(start), *tail)) for tail in self.parts.values()]
        state, end = start, np.empty_like(start)
        stages = np.zeros((2, 2, len(start), self.stage)) if self.stage else None
        for k in range(steps):
            place = (k + 1) // every
            is_recorded = (k + 1) % every == 0
            targets = [array[:, place] for array in records.values()] if is_recorded else unrecorded
            if stages is None:
                values = (state if name == "state" else _at(tracks[name], k) for name in self.inputs)
                self.ufunc.call(*values, out=(end, *targets))
            else:
                self._rk4(k, state, stages, tracks, end, unrecorded, targets)
            state, end = end, state

    def _rk4(
        self,
        k: int,
        state: Float64Array,
        stages: Float64Array,
        tracks: Mapping[str, Float64Array],
        end: Float64Array,
        unrecorded: list[Float64Array],
        targets: list[Float64Array],
    ) -> None:
        """Make the step number k by four stages; only the last writes into the targets."""
        stage, total, next_stage, next_total = stages.reshape(4, *stages.shape[2:])
        same = self.stage - 3 * (state.shape[1] > self.stage)  # with a free base, its turn follows
        for vectors in (stage, total):
            vectors[:, :same] = state[:, :same]
            vectors[:, same:] = 0.0
        for ahead, weight, half in _STAGES:
            own: dict[str, Any] = {"state": state, "ahead": ahead, "weight": weight, "stage": stage, "total": total}
            values = [
                own[name] if name in own else _at(tracks[name], 2 * k + half if name in _MOVING else k)
                for name in self.inputs
            ]
            last = targets if half == _STAGES[-1][-1] else unrecorded
            self.ufunc.call(*values, out=(end, next_stage, next_total, *last))
            stage, total, next_stage, next_total = next_stage, next_total, stage, total


def _at(values: Float64Array, instant: int) -> Float64Array:
    """Return the values of an input at an instant; one instant holds for all."""
    return values[:, instant if values.shape[1] > 1 else 0]


def run_motions(
    stepper: Stepper,
    starts: Mapping[str, Float64Array],
    tracks: Mapping[str, Track],
    steps: int,
    every: int,
    out: Any,
    execution: Execution,
) -> Rollout:
    """Step all motions, and return them at the recorded steps.

    Args:
        stepper: the compiled step.
        starts: the parts of the states at the start, (..., one sample).
        tracks: all other inputs.
        steps: number of steps.
        every: how many steps lie between records.
        out: arrays by output name, or None.
        execution: number of threads.
    """
    tails = stepper.parts
    shapes = {name: array.shape[: array.ndim - len(tails[name])] for name, array in starts.items()}
    lanes = broadcast_shape({**shapes, **{one.label: one.lanes for one in tracks.values()}})
    count, records = math.prod(lanes), steps // every + 1
    inputs = {**starts, **{name: one.values for name, one in tracks.items()}}
    outputs = output_arrays(tails.items(), (*lanes, records), np.dtype(np.float64), out, inputs)
    flat = {name: array.reshape(count, records, *tails[name]) for name, array in outputs.items()}
    rows = []
    for name, start in starts.items():
        full = np.broadcast_to(start, (*lanes, *tails[name])).reshape(count, *tails[name])
        flat[name][:, 0] = full
        rows.append(full.reshape(count, math.prod(tails[name])))
    states = np.concatenate(rows, axis=1)

    def run(chunks: list[slice]) -> None:
        for chunk in chunks:
            own = {name: one.at(lanes, chunk) for name, one in tracks.items()}
            stepper.run(states[chunk].copy(), own, steps, every, {name: flat[name][chunk] for name in tails})

    workers = max(1, min(execution.workers, count))
    most = max(1, min(_LANES, -(-count // workers)))
    chunks = [slice(k, min(k + most, count)) for k in range(0, count, most)]
    if chunks:
        run_in_threads(run, [chunks[k::workers] for k in range(workers)])
    for name, array in flat.items():  # an array of the user's that has other strides was copied
        if not np.may_share_memory(array, outputs[name]):
            outputs[name][...] = array.reshape(outputs[name].shape)
    return Rollout(outputs, (*lanes, records))


def rolled_out(
    computation: RobotComputation,
    q0: Coordinates,
    qd0: Coordinates,
    tau: Any,
    dt: float,
    *,
    method: str,
    steps: int | None,
    every: int,
    limit: Any,
    gravity: tuple[float, ...],
    labelled_loads: Mapping[str, tuple[Any, str]],
    base_motion: Any,
    out: Any,
    execution: Execution,
) -> Rollout:
    """Return what `Mechanism.rollout` describes, by the computation of qdd under the given loads.

    Raises:
        ArgumentError: an argument cannot be used, or the robot has too many joints.
    """
    check_choice("method", method, METHODS)
    if not isinstance(every, int | np.integer) or isinstance(every, bool) or every < 1:
        raise ArgumentError("every", "a whole number from 1", quoted(every))
    if base_motion is not None and not isinstance(base_motion, BodyMotion):
        raise ArgumentError("base_motion", "a BodyMotion", quoted(base_motion))
    form, request, dof = computation.form, computation.request, computation.form.dof
    if not dof or not request_loop(form, request).traced:
        raise ArgumentError("robot", "joints that move, and not too many for one program", f"{dof}")
    starts = {}
    for name, value in (("q", q0), ("qd", qd0)):
        read, _ = read_coordinates(f"{name}0", value, computation.coordinates)
        row = np.stack(np.broadcast_arrays(*read), axis=-1) if isinstance(read, tuple) else read
        starts[name] = np.asarray(row, np.float64)
    known = {**RESTING_BASE_VALUE_BY_INPUT_NAME, "constants": computation.known["constants"], "gravity": gravity}
    known["h"] = finite_number("dt", dt)
    control, tracks = control_tracks(tau, dof, limit)
    tracks |= {name: track(label, value, 3) for name, (value, label) in labelled_loads.items()}
    if request.free:
        for name, tail in BASE_STATE.items():
            given = None if base_motion is None else getattr(base_motion, name[:-1])
            starts[name] = np.asarray(np.reshape(known.pop(name), tail) if given is None else given, np.float64)
    else:
        tracks |= base_tracks(base_motion)
    known = {name: value for name, value in known.items() if name not in tracks}
    count = count_steps(tracks, steps, method)
    stepper = Stepper.of(form, request, method, control, known)
    return run_motions(stepper, starts, tracks, count, int(every), check_out(out, tuple(starts)), execution)
