"""What can be asked of pairs and robots, and how a call of a method is answered.

`ROBOT_TASKS` and `PAIR_TASKS` have a row for each method and each word of `prepare`: arguments, outputs, result,
options. What an output is made of says `plans.trees.OUTPUTS`, its unit and shape `equations.quantities`.

A method calls `ask`. A call that differs from an earlier one by its arrays alone goes to the kernel at once. Any
other is planned as a `MethodCall`: the `Subject`, a pair or a robot, says what it computes and from what. Then it is
computed, and kept.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from hingepair.engine.backend import Execution, execution_of
from hingepair.engine.results import Results
from hingepair.equations.quantities import QUANTITIES
from hingepair.errors import ArgumentError, choices, nearest, quoted, warn_of_dynamics
from hingepair.mechanism.options import (
    BASE_OPTIONS,
    DEFAULT_GRAVITY,
    DYNAMICS_OPTIONS,
    EULER_OPTIONS,
    FORWARD_OPTIONS,
    GRAVITY_OPTIONS,
    LOOP_OPTIONS,
    OUT_OPTIONS,
    RUN_OPTIONS,
    WEIGHT_OPTIONS,
    WRENCHES_OPTIONS,
    check_options,
)
from hingepair.mechanism.states import (
    Accelerations,
    Energy,
    Forces,
    HingeWrench,
    JointWrenches,
    MechanismAccelerations,
    MechanismDerivatives,
    MechanismForces,
    MechanismState,
    Momentum,
    PairState,
    PlanarState,
)
from hingepair.numeric.arrays import one_constant
from hingepair.plans.arguments import check_out, requested_outputs
from hingepair.plans.computation import Cache, Computation
from hingepair.plans.pairs import ACCELERATIONS, APPLIED_LOADS, FORCES, PLANE, SPACE, PairKind
from hingepair.plans.prepared import Prepared
from hingepair.plans.trees import DYNAMICS_MATRICES, FRAME_OUTPUTS, JACOBIANS


class Task(NamedTuple):
    """What is computed under one name: by a method, or by a prepared call."""

    given: tuple[str, ...]  # names of the arguments
    outputs: tuple[str, ...]
    result: type[Results] | None = None  # None: the only output as an array
    options: tuple[str, ...] = OUT_OPTIONS  # those of the method


MOTION_LEVELS: Final = ("pose", "velocity", "acceleration")  # tasks of motion, by the order of the time derivative
LOAD_ARGUMENTS: Final = frozenset(("tau", *APPLIED_LOADS))
"""Arguments of which forward dynamics have one at least."""
ROWS: Final = ("q", "qd", "qdd")
"""Names of all coordinates, and of their derivatives."""
PARTS_OF_LOOPS: Final = ("loop_gaps", "loop_jacobian", "loop_wrenches", "tree_tau")
"""Tasks of which messages, `transmission` and `loop_wrenches` are made; a prepared call has none of them."""
FREE_BASE_OUTPUTS: Final = ("a1", "alpha1")  # of forward dynamics, where forces move the base
ALL_COORDINATES: Final = ("q_all", "qd_all", "qdd_all")  # of a closed mechanism; each is a task, with those before it
_J: Final = ("frames", *BASE_OPTIONS)
_OF_POSE: Final = ("mass_matrix", "centre_of_mass", "centre_of_mass_jacobian", "centroidal_momentum_matrix")

ROBOT_TASKS: Final[Mapping[str, Task]] = {
    **{
        level: Task(
            ROWS[: k + 1],
            tuple(x for x in FRAME_OUTPUTS if QUANTITIES[x].order <= k),
            MechanismState,
            ("outputs", *_J),
        )
        for k, level in enumerate(MOTION_LEVELS)
    },
    **{name: Task(ROWS[: 1 + name.endswith("_rate")], (name,), None, _J) for name in JACOBIANS},
    "acceleration_bias": Task(("q", "qd"), ("acceleration_bias",), None, _J),
    "inverse_dynamics": Task(ROWS, ("tau", "force1", "torque1"), MechanismForces, DYNAMICS_OPTIONS),
    "inverse_dynamics_derivatives": Task(ROWS, DYNAMICS_MATRICES[:3], MechanismDerivatives, DYNAMICS_OPTIONS),
    "joint_wrenches": Task(ROWS, ("force", "torque"), JointWrenches, WRENCHES_OPTIONS),
    "torque_regressor": Task(ROWS, ("torque_regressor",), None, WEIGHT_OPTIONS),
    "forward_dynamics": Task(
        ("q", "qd", "tau"), ("qdd", *FREE_BASE_OUTPUTS), MechanismAccelerations, FORWARD_OPTIONS
    ),
    "forward_dynamics_derivatives": Task(
        ("q", "qd", "tau"), DYNAMICS_MATRICES[3:], MechanismDerivatives, FORWARD_OPTIONS
    ),
    **{
        name: Task(ROWS[:order], ALL_COORDINATES[:order], None, RUN_OPTIONS)
        for order, name in enumerate(ALL_COORDINATES, 1)
    },
    "struts": Task(("q", "qd"), ("strut_length", "strut_rate", "strut_force"), None, RUN_OPTIONS),
    **{name: Task(("q",), (name,), None, BASE_OPTIONS) for name in (*_OF_POSE, *PARTS_OF_LOOPS[:3])},
    "tree_tau": Task(ROWS, ("tree_tau",), None, LOOP_OPTIONS),
    "bias_forces": Task(("q", "qd"), ("bias_forces",), None, WEIGHT_OPTIONS),
    "gravity_forces": Task(("q",), ("gravity_forces",), None, WEIGHT_OPTIONS),
    "centroidal_momentum_matrix_rate": Task(("q", "qd"), ("centroidal_momentum_matrix_rate",), None, BASE_OPTIONS),
    "energy": Task(("q", "qd"), ("kinetic", "potential"), Energy, WEIGHT_OPTIONS),
    "momentum": Task(("q", "qd"), ("linear", "angular_about_origin", "angular_about_centre"), Momentum, BASE_OPTIONS),
    **{
        f"momentum_about_{point}": Task(("q", "qd"), ("linear", f"angular_about_{point}"), Momentum, BASE_OPTIONS)
        for point in ("origin", "centre")
    },
}
"""All that can be asked of a robot."""
SOLVED: Final = ROBOT_TASKS["forward_dynamics"].outputs  # NaN where nothing resists

STATES: Final[Mapping[PairKind, type[PairState | PlanarState]]] = {SPACE: PairState, PLANE: PlanarState}
"""Classes of the state of a pair."""
_MOVED: Final = ("S1", "omega1", "a1", "alpha1", "psi", "psid", "psidd")  # arguments of inverse dynamics
_PLACED: Final = ("R1", "S1", "v1", "omega1", "psi", "psid")  # arguments of energy and momentum
_OF_BODY1: Final = ("S1", "omega1", "psi", "psid")
_WRENCH: Final = ("hinge_force", "hinge_moment", "hinge_torque", "bearing_torque")  # outputs of hinge_wrench


def _levels(kind: PairKind) -> dict[str, Task]:
    levels, options = enumerate(MOTION_LEVELS), ("outputs", *OUT_OPTIONS) if kind.planar else EULER_OPTIONS
    return {level: Task(ROWS[: k + 1], kind.default_outputs(k), STATES[kind], options) for k, level in levels}


PAIR_TASKS: Final[Mapping[PairKind, Mapping[str, Task]]] = {
    SPACE: {
        **_levels(SPACE),
        "from_body1": Task((), (), PairState, ("outputs", *OUT_OPTIONS)),
        "jacobian": Task(("S1", "psi"), ("jacobian",)),
        "acceleration_bias": Task(_OF_BODY1, ("acceleration_bias",)),
        "mass_matrix": Task(("S1", "psi"), ("mass_matrix",)),
        "inverse_dynamics": Task(_MOVED, FORCES, Forces, GRAVITY_OPTIONS),
        "forward_dynamics": Task((*_OF_BODY1, *FORCES), ACCELERATIONS, Accelerations, GRAVITY_OPTIONS),
        "hinge_wrench": Task(_MOVED, _WRENCH, HingeWrench, GRAVITY_OPTIONS),
        "energy": Task(_PLACED, ("kinetic", "potential"), Energy, GRAVITY_OPTIONS),
        "momentum": Task(_PLACED, ("linear", "angular"), Momentum),
    },
    PLANE: _levels(PLANE),
}
"""All that can be asked of pairs in space and in the plane."""
_METHODS: Final = {  # where a method has not the name of its task
    **dict.fromkeys(MOTION_LEVELS, "forward_kinematics"), "from_body1": "forward_kinematics_from_body1"
}  # fmt: skip


# ---- the call of a method

Watch = Callable[[Any, Mapping[str, Any]], None]
"""Function of results and arguments, which warns where a mass matrix is singular or loops cannot be closed."""


class MethodCall(NamedTuple):
    """A call of a method, planned: what is computed, and from what."""

    computation: Computation
    given: Mapping[str, Any]  # the arguments by input name
    labels: Mapping[str, str]  # names of inputs in messages, where they differ
    gravity: tuple[float, ...] | None  # where it matters
    watch: Watch | None = None
    lasts: bool = True  # whether the next such call is the same


class PreparedCall(NamedTuple):
    """A call of `prepare`, planned: what is computed, and from what."""

    computation: Computation
    options: Mapping[str, Any]  # of `prepare`, as they make the call anew
    watch: Watch | None = None
    further: tuple[str, ...] = ()  # names of arguments behind those that are named


class Subject:
    """A pair or a robot: what can be asked of it, and its computations, which are made once."""

    tasks: Mapping[str, Task]
    inputs: Collection[str]  # that a prepared call can take
    _further_words: tuple[str, ...] = ()  # words that `prepare` takes beside the tasks

    def __init__(self) -> None:
        self.cache = Cache()

    def _method_call(self, task: Task, given: dict[str, Any], options: Mapping[str, Any], out: Any) -> MethodCall:
        """Return the call of a method, planned."""
        raise NotImplementedError

    def _prepared_call(
        self, task: str | None, names: tuple[str, ...], outputs: tuple[str, ...], options: Any
    ) -> PreparedCall:
        """Return what a prepared call computes: of a task, or of arguments with these names."""
        raise NotImplementedError

    def computation(self, *args: Any, **kwargs: Any) -> Computation:
        """Return the Computation of outputs, which is made once; `Computation.asked` makes it anew."""
        raise NotImplementedError

    def _accepted(self, names: tuple[str, ...]) -> Collection[str]:
        """Return the outputs that a prepared call with these arguments can have."""
        raise NotImplementedError

    def available(self, outputs: tuple[str, ...]) -> tuple[str, ...]:
        """Return those of the outputs of a task that exist."""
        return outputs

    def named(self, given: str | Iterable[str]) -> tuple[str, ...]:
        """Return the names of the arguments of a prepared call: of a task, or as they are given."""
        words = tuple(name for name, task in self.tasks.items() if task.given and name not in PARTS_OF_LOOPS)
        if isinstance(given, str) and given in words:
            return self.tasks[given].given
        if isinstance(given, str) or not isinstance(given, Iterable):
            known = *words, *self._further_words
            near = nearest(given, known) if isinstance(given, str) else ""
            raise ArgumentError("given", f"{choices(known)}, or a tuple of names{near}", quoted(given))
        names = tuple(given)
        for name in names:
            if name not in self.inputs:
                raise ArgumentError("given", choices(tuple(self.inputs)), quoted(name))
        if len({*names}) < len(names):
            raise ArgumentError("given", "each name once", quoted(names))
        return names

    def prepare(
        self,
        prepare: Callable[..., Prepared],
        given: str | Iterable[str],
        outputs: Iterable[str] | None,
        execution: Execution,
        **options: Any,
    ) -> Prepared:
        """Return what the method `prepare` of the pair or robot describes, by which the call is made anew."""
        names, word = self.named(given), given if isinstance(given, str) else None
        if isinstance(outputs, Iterable) and not isinstance(outputs, str):
            outputs = tuple(outputs)
        task = word or (motion_level(names) if LOAD_ARGUMENTS.isdisjoint(names) else "forward_dynamics")
        default = self.available(self.tasks[task].outputs)
        asked = requested_outputs(outputs, None, self._accepted(names), default)
        planned = self._prepared_call(word, names, asked, options)
        computation, all_names = planned.computation, (*names, *planned.further)
        for output in asked:
            if missing := computation.missing_inputs(output, all_names):
                expected = f"names with {', '.join(missing)}, which output {output} needs"
                raise ArgumentError("given", expected, ", ".join(all_names))
        remade = functools.partial(
            prepare, word or names, outputs=outputs, workers=execution.workers,
            backend=execution.backend, **planned.options,
        )  # fmt: skip
        vector = read_gravity(options.get("gravity", DEFAULT_GRAVITY))
        return Prepared(computation, all_names, execution, vector, remade, planned.watch)


S_co = TypeVar("S_co", bound=Subject, covariant=True)


class _OfSubject(Protocol[S_co]):
    """A HingePair, a PlanarPair or a Mechanism."""

    @property
    def _subject(self) -> S_co: ...


def subject_of(one: _OfSubject[S_co]) -> S_co:
    """Return what answers the calls of a pair or a robot."""
    return one._subject


def warn_of_pivots(name: str, bad: Any, pivots: Any, limits: Any, labels: Sequence[str]) -> None:
    """Issue a DynamicsWarning that names what no inertia resists, where accelerations are NaN for that.

    Args:
        name: name of the pair or robot.
        bad: whether accelerations are NaN; (...,).
        pivots: of the mass matrix; (..., k), those of joints first.
        limits: sizes below which they are rounding; 0 where they cannot be that small.
        labels: what they stand for; those of a free base are alike.
    """
    low = ~(np.abs(pivots) > limits) & (limits > 0) & bad[..., None]  # NaN are low
    if low.any():
        first = low.reshape(-1, low.shape[-1])[int(np.argmax(low.any(axis=-1)))]
        count = int(low.any(axis=-1).sum())
        where = f"at {count} of {bad.size} samples" if bad.shape else "here"
        of_joints = [k for k, is_low in enumerate(first) if is_low and labels[k] != labels[-1]]
        which = labels[of_joints[-1] if of_joints else -1]
        warn_of_dynamics(f"{name}: no mass resists {which} {where}; accelerations are NaN there")


def ask(subject: Subject, task: str, values: Sequence[Any], options: Any, names: tuple[str, ...] = ()) -> Any:
    """Compute what a method returns.

    Args:
        subject: the pair or the robot.
        task: name of the row of the subject's tasks.
        values: the arguments.
        options: the options of the method.
        names: names of the arguments; by default those of the row.
    """
    key: Any = task
    out = None
    if options or names:
        out = options.pop("out", None)
        asked = tuple(out) if type(out) is dict and "outputs" not in options else None  # outputs that `out` asks for
        key = task, names, asked, *options, *options.values()

    # Answer by the call that was kept, if there is one. Its key has the names and values of the options, which were
    # therefore checked when it was planned.
    try:
        kept = subject.cache.calls.get(key)
    except TypeError:  # an option that cannot be hashed
        kept, key = None, None
    if kept is not None:
        call, watch = kept
        if out is None:
            result = call.rows(*values)
        else:  # of other names than the outputs', `rows` returns None
            result = call.rows(*values, out=out if type(out) is dict else check_out(out, call.outputs))
        if result is not None:
            if watch is not None:
                watch(result, dict(zip(call.argument_shapes, values, strict=True)))
            return result

    # Plan what is computed, and from what.
    row = subject.tasks[task]
    check_options(_METHODS.get(task, task), options, row.options)
    execution = execution_of(options.get("backend", "auto"), options.get("workers", 1))
    given = dict(zip(names or row.given, values, strict=bool(names)))
    planned = subject._method_call(row, given, options, out)
    computation, watch = planned.computation, planned.watch

    # Compute it.
    remade = functools.partial(subject.computation, *computation.asked)
    result = computation.compute(planned.given, execution, planned.gravity, out, labels=planned.labels, remade=remade)

    # Keep it, if the next call with this key means the same.
    if kept is None and key is not None and planned.lasts and all(map(_lasts, options.values())):
        call = computation.call(tuple(planned.given), execution.backend, planned.gravity)
        subject.cache.calls[key] = call, watch

    # Look at the results.
    if watch is not None:
        watch(result, given)
    return result


def _lasts(option: object) -> bool:
    """Return whether an option means the same at the next call: others are arguments, or change."""
    return type(option) in (str, bool, type(None)) or (
        type(option) is tuple and all(type(one) is str for one in option)
    )


def read_gravity(gravity: ArrayLike) -> tuple[float, ...]:
    """Return the argument `gravity` as numbers."""
    if gravity is DEFAULT_GRAVITY:
        return DEFAULT_GRAVITY
    return tuple(one_constant("gravity", gravity, 3).tolist())


def motion_level(given: Mapping[str, Any] | Sequence[str]) -> str:
    """Return the task of motion for which arguments of these names suffice."""
    return MOTION_LEVELS[sum(name in given or other in given for name, other in (("qd", "psid"), ("qdd", "psidd")))]


def coordinate_rows(q: Any, qd: Any, qdd: Any) -> tuple[Any, ...]:
    """Return q, qd and qdd as far as given.

    Raises:
        ArgumentError: second derivatives without first, or no coordinates.
    """
    if qdd is None:
        if q is None:
            raise ArgumentError("q", "coordinates", None)
        return (q,) if qd is None else (q, qd)
    if qd is None:
        raise ArgumentError("qd", "the first derivatives too, since the second are given", None)
    return q, qd, qdd
