"""What is computed of pairs: outputs from coordinates, or from the motion of body 1."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import Execution, execution_of
from hingepair.engine.loops import Loop
from hingepair.engine.outputs import Out
from hingepair.engine.results import Results, writable_arrays
from hingepair.errors import ArgumentError
from hingepair.numeric.dask_arrays import apply_to_chunks
from hingepair.pair.body_motion import MOTION_SHAPES, BodyMotion, motion_inputs
from hingepair.pair.constants import Constants, check_single_pair, least_axis
from hingepair.pair.states import (
    Accelerations,
    Energy,
    Forces,
    HingeWrench,
    Momentum,
    PairState,
    PlanarState,
)
from hingepair.plans.arguments import (
    Arguments,
    CoordinateNames,
    Outputs,
    read_arguments,
    requested_outputs,
)
from hingepair.plans.computation import Cache, Computation
from hingepair.plans.constant_steps import CONSTANT_SHAPES
from hingepair.plans.dynamics_steps import ACCELERATIONS, FORCES
from hingepair.plans.plan import (
    PLANAR_MOTION_KIND,
    SPATIAL_MOTION_KIND,
    MotionKind,
    default_outputs,
    from_constants,
    make_plan,
    plan_loop,
)
from hingepair.plans.steps import (
    LOG_COLUMNS_OF,
)
from hingepair.rotations.sequences import find_sequence

Returned = TypeVar("Returned")

STATES: Mapping[Any, type[PairState | PlanarState]] = {
    SPATIAL_MOTION_KIND: PairState,
    PLANAR_MOTION_KIND: PlanarState,
}
"""The class of the results, by the kind of motion of a plan."""

INPUT_LABELS: Final = {f"{letter}{k}": f"body{k}.{letter}" for k in "12" for letter in MOTION_SHAPES}
"""Names of the arrays of bodies in messages, by input."""

COORDINATES: Mapping[Any, CoordinateNames] = {
    kind: CoordinateNames(kind.coordinates, LOG_COLUMNS_OF[kind.coordinates])
    for kind in (SPATIAL_MOTION_KIND, PLANAR_MOTION_KIND)
}
"""Names of the coordinates, by the kind of motion."""


class Task(NamedTuple):
    """Arguments and outputs of what is computed of a pair under one name: a method's, or one for `prepare`."""

    given: tuple[str, ...]
    outputs: tuple[str, ...]
    result: type[Results] | None = None  # None: the only output as an array
    masses: tuple[str, ...] = ()  # bodies whose masses it needs
    hint: str = ""  # end of the message where body 1 has none: what to call instead


BODIES: Final = ("body1", "body2")  # attributes of a pair that hold its mass properties
ROWS: Final = ("q", "qd", "qdd")  # all coordinates of a pair, and their derivatives
_HINGE: Final = ("psi", "psid", "psidd")
_MOVED: Final = ("S1", "omega1", "a1", "alpha1", *_HINGE)  # inputs of inverse dynamics
_WRENCH: Final = ("hinge_force", "hinge_moment", "hinge_torque", "bearing_torque")  # outputs of hinge_wrench
_HINT: Final = "; or pair.hinge_wrench, for which body 2 suffices"  # where body 1 has no mass


def _motion_tasks(kind: MotionKind) -> dict[str, Task]:
    levels = enumerate(("pose", "velocity", "acceleration"))
    return {level: Task(ROWS[: order + 1], default_outputs(order, kind), STATES[kind]) for order, level in levels}


TASKS: Final[Mapping[MotionKind, Mapping[str, Task]]] = {
    SPATIAL_MOTION_KIND: {
        **_motion_tasks(SPATIAL_MOTION_KIND),
        "jacobian": Task(("S1", "psi"), ("jacobian",)),
        "acceleration_bias": Task(("S1", "omega1", "psi", "psid"), ("acceleration_bias",)),
        "constraint_jacobian": Task(("S1", "S2"), ("constraint_jacobian",)),
        "constraint_bias": Task(("S1", "omega1", "S2", "omega2"), ("constraint_bias",)),
        "mass_matrix": Task(("S1", "psi"), ("mass_matrix",), masses=BODIES),
        "inverse_dynamics": Task(_MOVED, FORCES, Forces, BODIES, _HINT),
        "hinge_wrench": Task(_MOVED, _WRENCH, HingeWrench, ("body2",)),
        "forward_dynamics": Task(("S1", "omega1", "psi", "psid", *FORCES), ACCELERATIONS, Accelerations, BODIES),
        "energy": Task(("R1", "S1", "v1", "omega1", "psi", "psid"), ("kinetic", "potential"), Energy, ("body2",)),
        "momentum": Task(("R1", "S1", "v1", "omega1", "psi", "psid"), ("linear", "angular"), Momentum, BODIES),
    },
    PLANAR_MOTION_KIND: {
        **_motion_tasks(PLANAR_MOTION_KIND),
        "mass_matrix": Task(("q",), ("mass_matrix",), masses=BODIES),
        "inverse_dynamics": Task(ROWS, FORCES, Forces, BODIES, _HINT),
        "hinge_wrench": Task(ROWS, _WRENCH, HingeWrench, ("body2",)),
        "forward_dynamics": Task(("q", "qd", *FORCES), ("qdd",), masses=BODIES),
        "energy": Task(("q", "qd"), ("kinetic", "potential"), Energy, ("body2",)),
        "momentum": Task(("q", "qd"), ("linear", "angular"), Momentum, BODIES),
    },
}
"""All that can be asked of pairs in space and in the plane."""


def computation_of(
    kind: MotionKind,
    pair: Constants,
    outputs: tuple[str, ...],
    sequence: str | None = None,
    result: type[Results] | None = Results,
    by_constants: bool = False,
) -> Computation:
    """Return the Computation of outputs of a pair, which is made once.

    Args:
        kind: motion in space or in a plane.
        pair: constants of the pair.
        outputs: names of the outputs.
        sequence: Euler sequence of body 1; None if its attitude is given.
        result: class of the result; None to return the only output as an array.
        by_constants: begin with the geometry and the masses, for derivatives by them.
    """
    key = outputs, sequence, result, by_constants
    found: Computation | None = pair.cache.computations.get(key)
    if found is None:
        has_home = "home" in pair.values or by_constants
        known = pair.values if pair.single else pair.arrays
        if by_constants and kind is SPATIAL_MOTION_KIND:
            known = {"home": pair.arrays["home"], "least_axis": least_axis(pair.arrays["n"]), **known}

        def loop(names: tuple[str, ...], given: tuple[str, ...]) -> Loop:
            plan = make_plan(names, sequence, has_home, kind=kind, given_names=given, points=pair.points)
            return plan_loop(from_constants(plan) if by_constants else plan)

        found = pair.cache.computations[key] = Computation(
            loop, outputs, pair.shapes, known, result, COORDINATES[kind], shape=pair.shape,
            shared=True, constant_shapes=CONSTANT_SHAPES[kind is PLANAR_MOTION_KIND],
            by_constants=functools.partial(computation_of, kind, pair, outputs, sequence, result, True),
        )  # fmt: skip
    return found


def check_inputs(computation: Computation, given: Collection[str]) -> None:
    """Refuse inputs that do not suffice for the outputs."""
    missing = computation.missing(given)
    if missing is not None:
        output, name = missing
        raise ArgumentError(INPUT_LABELS.get(name, name), f"a value, since output {output} needs it", None)


def compute(
    kind: MotionKind,
    pair: Constants,
    outputs: tuple[str, ...],
    given: Mapping[str, Any],
    *,
    out: Any = None,
    sequence: str | None = None,
    backend: str = "auto",
    workers: int = 1,
    gravity: tuple[float, ...] | None = None,
    result: type[Results] | None = Results,
    key: Any = None,
    cache: Cache | None = None,
) -> Any:
    """Compute outputs of a pair from inputs by name, as users give them. The call is stored by
    `key` in `cache`, by default the pair's, for `Cache.again`.

    Raises:
        ArgumentError: an output needs an input that is not given.
    """
    what = kind, pair, outputs, sequence, result
    computation = computation_of(*what)
    check_inputs(computation, given)
    return computation.compute(
        given, execution_of(backend, workers), gravity, out, labels=INPUT_LABELS,
        keep=None if key is None else (cache or pair.cache, key), remade=functools.partial(computation_of, *what),
    )  # fmt: skip


def compute_arrays(
    pair: Constants,
    outputs: Iterable[str],
    values: Mapping[str, Any],
    shapes: Mapping[str, tuple[int, ...]],
    dtype: np.dtype[Any] | None = None,
) -> dict[str, NDArray[Any]]:
    """Compute outputs of a pair in space from checked inputs; return new, writable arrays by output name."""
    computation = computation_of(SPATIAL_MOTION_KIND, pair, tuple(outputs))
    arguments = Arguments(dict(values), dict(shapes), {})
    return writable_arrays(computation.run(arguments, Execution("auto", 1), dtype=dtype))


def coordinate_rows(q: Any, qd: Any, qdd: Any) -> dict[str, Any]:
    """Return q, qd and qdd by name, as far as given.

    Raises:
        ArgumentError: second derivatives without first, or no coordinates.
    """
    if qdd is not None and qd is None:
        raise ArgumentError("qd", "the first derivatives too, since the second are given", None)
    if q is None:
        raise ArgumentError("q", "coordinates", None)
    return {name: row for name, row in (("q", q), ("qd", qd), ("qdd", qdd)) if row is not None}


def read_rows(kind: MotionKind, q: Any, qd: Any = None, qdd: Any = None) -> Arguments:
    """Check the coordinates of a pair and their derivatives, and return them in the form that calls take."""
    return read_arguments(coordinate_rows(q, qd, qdd), kind.shapes, COORDINATES[kind])


def from_coordinates(
    kind: MotionKind,
    pair: Constants,
    q: Any,
    qd: Any,
    qdd: Any,
    outputs: Outputs,
    out: Out,
    sequence: str | None,
    backend: str,
    workers: int,
) -> Any:
    """Compute the state of a pair from coordinates and, if given, their derivatives (E1-E11)."""
    rows = (q,) if qd is None and qdd is None else (q, qd) if qdd is None else (q, qd, qdd)
    if type(outputs) is list:
        outputs = tuple(outputs)
    added = tuple(out) if outputs is None and type(out) is dict else None  # outputs that `out` asks for
    key = outputs, added, sequence, backend, len(rows)
    state = pair.cache.again(key, rows, out, workers)
    if state is not None:
        return state
    given = coordinate_rows(q, qd, qdd)
    if sequence is not None or kind is SPATIAL_MOTION_KIND:
        find_sequence(sequence)  # type: ignore[arg-type]
    names = requested_outputs(outputs, out, pair.levels, default_outputs(len(given) - 1, kind))
    lasts = isinstance(outputs, tuple | None) and (out is None or type(out) is dict)
    return compute(
        kind, pair, names, given, out=out, sequence=sequence, backend=backend, workers=workers,
        result=STATES[kind], key=key if lasts else None,
    )  # fmt: skip


def from_body1(
    pair: Constants,
    body1: BodyMotion,
    psi: Any,
    psid: Any,
    psidd: Any,
    outputs: Outputs,
    out: Out,
    backend: str,
    workers: int,
) -> Any:
    """Compute the state of a pair from the motion of body 1 and the hinge angle (E1, E2, E5-E9)."""
    given = body1_inputs(body1, psi, psid, psidd)
    level = ("psid" in given) + ("psidd" in given)
    names = requested_outputs(outputs, out, pair.levels, default_outputs(level))
    return compute(
        SPATIAL_MOTION_KIND, pair, names, given, out=out, backend=backend, workers=workers, result=PairState
    )


def body1_inputs(body1: BodyMotion, psi: Any, psid: Any = None, psidd: Any = None) -> dict[str, Any]:
    """Return the motion of body 1 and the hinge angle by input name.

    Raises:
        ArgumentError: `body1` is no BodyMotion, or a derivative is given without those before it.
    """
    if psidd is not None and psid is None:
        raise ArgumentError("psid", "the first derivative too, since the second is given", None)
    if psi is None:
        raise ArgumentError("psi", "hinge angles", None)
    hinge = {name: value for name, value in (("psi", psi), ("psid", psid), ("psidd", psidd)) if value is not None}
    return {**motion_inputs("body1", body1), **hinge}


def lazily(pair: Any, method: Callable[..., Returned], **arguments: Any) -> Returned:
    """Return lazy Dask arrays of the results of a method of a pair, which is called chunk by chunk."""
    check_single_pair(pair, " if the arguments are Dask arrays")
    kind = pair.constants.kind
    shapes = {**kind.shapes, **dict.fromkeys(("body1", "body2"), MOTION_SHAPES)}
    return apply_to_chunks(method, arguments, shapes, COORDINATES[kind].table_columns)
